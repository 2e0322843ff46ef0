"""Figures over the load: curves of sweeps, states, fits and data; and bands, or densities of
states, one over the other.

As in :mod:`granphon.figures.bands`, every function that takes an Axes draws on the Axes and returns
the Axes. A data set of a sweep has a curve for each medium, combination of parameters and
direction. In the figure of a sweep each medium has a colour, and each combination of parameters a
shade of the colour. In the figure of several results each curve has its own look; facts that all
curves share stand in the title, and the legend gives the facts in which the curves differ. A line
is dashed where its medium is not valid.
"""

from __future__ import annotations

import itertools
import json
import math
import os
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import partial
from pathlib import Path
from typing import Any, NamedTuple

from granphon.figures.scales import (
    add_legend,
    draw_error_band,
    find_axis,
    make_error_handle,
    name_axis,
    scale_axis,
    styled_figure,
)

import matplotlib
import numpy as np
from matplotlib.axes import Axes
from matplotlib.colors import to_rgb
from matplotlib.figure import Figure
from matplotlib.font_manager import FontProperties
from matplotlib.lines import Line2D
from matplotlib.ticker import MaxNLocator
from numpy.typing import NDArray

from granphon.balls.hertz import FREQUENCY_EXPONENT
from granphon.balls.lattices import find_lattice
from granphon.balls.loads import force_of_frame
from granphon.balls.packing import Packing
from granphon.base.arrays import Array
from granphon.base.errors import FigureError, InputError, brief
from granphon.base.results import restore
from granphon.base.scales import HertzPrefix, write_uncertain
from granphon.base.text import closest, suggest
from granphon.base.validation import require, text
from granphon.figures.bands import name_corners
from granphon.figures.choices import (
    arrange,
    describe_value,
    find_longest_parameter,
    list_parameters,
    require_axes,
    turn_over,
)
from granphon.figures.multiples import Panel, draw_panels
from granphon.figures.style import (
    COLOURS,
    GUIDE,
    POINTS_PER_INCH,
    STYLE,
    VERMILION,
    pick_evenly,
    write_hertz,
)
from granphon.figures.words import (
    describe_medium,
    describe_overlap,
    find_differing,
    join_facts,
    list_facts,
    write_unit,
    write_value,
)
from granphon.fits.fit import WidthFit
from granphon.fits.measurements import Measurements
from granphon.media.choice import MEDIA, AutoMedium, split_label
from granphon.media.simulation import DirectSimulation
from granphon.observables.catalogue import CATALOGUE, axis_label
from granphon.phonons.bands import Bands
from granphon.phonons.dos import DensityOfStates
from granphon.runs.dataset import Dataset, find_dataset, find_load, list_finite_overlap, tabulate

#: how measured points are drawn
_DATA_STYLE: dict[str, Any] = {
    "fmt": "o",
    "color": "black",
    "markersize": 2.6,
    "elinewidth": 0.7,
    "capsize": 0.0,
    "zorder": 2.0,
}
#: width of a line that is alone; limits of the widths of several lines, of which the later lie on
#: the earlier; points
_LONE_WIDTH = 1.6
_GREATEST_WIDTH = 2.2
_LEAST_WIDTH = 1.0
#: the largest number on an axis; matplotlib overflows at margins and ticks beyond larger numbers
_LARGEST_NUMBER = 1e280
#: dashes of lines of the same colour, the first solid; they differ from those outside the range
_DASHES = (None, (1.0, 1.4), (5.0, 1.6, 1.0, 1.6), (8.0, 2.5))
#: marks of points, one for each of these dashes
_MARKERS = ("o", "s", "^", "D")
#: the greatest number of lines that colours and dashes tell apart
MOST_LOOKS = len(COLOURS) * len(_DASHES)
#: marks of the media that an automatic medium chose; a simulation has the mark of its points
_MARKS_OF_MEDIA = {"ala": "s", "afa": "v", "ema": "^"}
#: looks of a line, and of marks, where the medium is not valid
_LOOK_OUTSIDE: dict[str, Any] = {"linewidth": 0.7, "dashes": (3.0, 1.5)}
_HOLLOW_LOOK: dict[str, Any] = {"markerfacecolor": "white"}
#: sizes of marks, points: of points, and of marks for the medium that served
_SIZE = 3.0
_SIZE_OF_MEDIA = 3.6
#: look of points in a legend, without colour and mark
_LOOK_OF_POINTS: dict[str, Any] = {"markersize": _SIZE, "linestyle": "none"}
#: the velocity of pulses through simulated arrays
_PULSE = "pulse_velocity"
#: the velocities that a sweep may have, with their symbols
_VELOCITIES = {
    "transverse": "$v_T$",
    "transverse_slow": "$v_{T1}$",
    "transverse_fast": "$v_{T2}$",
    "longitudinal": "$v_L$",
    _PULSE: "velocity of pulses",
}
#: of the two transverse waves in space the fast one has an ordinary line, the slow one is
#: dash-dotted; points differ too
_SLOW_WAVE = "transverse_slow"
_DASHES_OF_SLOW_WAVE = (6.0, 1.5, 1.0, 1.5)
_VELOCITY_MARKERS = {_SLOW_WAVE: "v", "transverse_fast": "^", _PULSE: "s"}
#: greatest number of letters of a line of a legend in a column, and of a title
_LETTERS = 50
_LETTERS_OF_TITLE = 60
#: greatest number of letters of a line of the legend of a fit
_LETTERS_OF_FIT = 28
#: greatest number of combinations of parameters in a legend
_MOST_NAMES = 8
#: number of marks for the medium that served along a curve
_MARKS_OF_CURVE = 12
#: symbols of velocities are written in one text if they are nearer than this, over the height
_LEAST_HEIGHT = 0.06
#: width of a letter, over the size of its font
_WIDTH_OF_LETTER = 0.55
#: least number of letters of a line of a title, however narrow its axes are
_LEAST_LETTERS_OF_TITLE = 20
#: number of forces of a curve that is drawn from a fit
_N_FORCES = 200
#: marks of measured points, which are black
_DATA_MARKS = ("o", "s", "^", "D", "v", "P")
#: quantities of the axis of loads
_LOADS = ("force", "pressure", "overlap", "reduced_force")

#: ratios of loads that differ by less than this part are the same
_SAME_RATIO = 1e-9

#: the caption of an Axes: entries of the legend, and the facts that all curves share
_Caption = tuple[list[Line2D], list[str]]


def plot_fit(fit: WidthFit, ax: Axes, residual_ax: Axes) -> tuple[Axes, Axes]:
    """Draw measured velocities with standard errors, the fit, and the ideal lattice on ``ax``, and
    residuals in units of the standard errors on ``residual_ax``; return both.

    Where each pulse has a frequency of its own, the fit is drawn at the data only, and the ideal
    lattice is left out.
    """
    ax.errorbar(fit.force, fit.velocity, fit.sigma, **_DATA_STYLE, label="data", gid="data")
    _draw_fit(ax, fit)
    residual_ax.axhline(0.0, color=VERMILION, linewidth=1.2, zorder=1.0)
    residuals = fit.residuals / fit.sigma
    residual_ax.errorbar(fit.force, residuals, 1.0, **_DATA_STYLE, gid="residuals")
    for panel in (ax, residual_ax):
        scale_axis(panel, "x", fit.force)
    scale_axis(ax, "y", fit.velocity)
    if fit.waves.frequency is None:
        ax.set_ylabel(axis_label(fit.waves.branch))
    else:
        ax.set_ylabel("Group velocity (m/s)")
    residual_ax.set(xlabel=axis_label("force"), ylabel="Residual / σ")
    residual_ax.yaxis.set_major_locator(MaxNLocator(5, integer=True))
    return ax, residual_ax


def _draw_fit(ax: Axes, fit: WidthFit) -> None:
    """Draw the velocities of a fit, and those of equal balls; where each pulse has a frequency of
    its own, the velocities of the fit at the data alone.
    """
    label = _describe_fit(fit)
    fit_style: dict[str, Any] = {"color": VERMILION, "label": label, "gid": "fit", "zorder": 1.5}
    has_many_frequencies = np.ndim(fit.waves.frequency) > 0
    if has_many_frequencies:
        ax.plot(fit.force, fit.velocities, "_", markersize=6.0, **fit_style)
    else:
        forces = np.geomspace(fit.force.min(), fit.force.max(), _N_FORCES)
        ax.plot(forces, fit.velocity_at(forces), linewidth=1.2, **fit_style)
        ideal_style: dict[str, Any] = {
            "color": GUIDE,
            "label": "equal balls",
            "gid": "ideal",
            "zorder": 1.0,
        }
        ax.plot(forces, fit.velocity_at(forces, "ala"), linewidth=0.8, **ideal_style)


def _describe_fit(fit: WidthFit) -> str:
    """Return the label of the curve of a fit: the medium, and the width if the width is fitted."""
    structure = fit.packing.structure
    medium = describe_medium(fit.medium, structure.periods, structure.n_balls)
    # short lines, so that the legend has room below the curve
    label = join_facts([medium], _LETTERS_OF_FIT)
    if "width" in fit.parameters:
        label += f":\nW = {write_width(fit)}"
    return label


def write_width(fit: WidthFit) -> str:
    """Return the text of the fitted width with two digits of its standard error, "2.026 ± 0.021
    µm"; without the error if errors are not known.
    """
    if not fit.errors_are_known:
        return write_value(fit.width, "m")
    return write_unit(write_uncertain(fit.width, fit.stderr, "m")).replace("+/-", "±")


def fit_figure(fit: WidthFit) -> Figure:
    """Draw a figure of a fit above its residuals, see :func:`plot_fit`; one column wide."""
    with styled_figure(3.6) as figure:
        axes = figure.subplots(2, sharex=True, height_ratios=[3.0, 1.0])
        plot_fit(fit, axes[0], axes[1])
        entries = list(zip(*axes[0].get_legend_handles_labels(), strict=True))
        # the data come first, and the other entries in their order
        entries.sort(key=lambda entry: entry[1] != "data")
        handles = [handle for handle, _ in entries]
        labels = [label for _, label in entries]
        # velocities rise with the force, so that the lower right corner is free
        axes[0].legend(handles, labels, loc="lower right")
    return figure


@dataclass(frozen=True)
class Look:
    """How a curve is drawn: colour, width of its line, dashes (None: solid), and the mark of its
    points.
    """

    colour: Any
    width: float = 1.2
    dashes: tuple[float, ...] | None = None
    marker: str = "o"


@dataclass(frozen=True, eq=False)
class Curve:
    """A quantity y over x, in order of x, or of the path that the loads take; arrays are (n,).

    Attributes
    ----------
    run : the name of the curve's run, for messages.
    facts : facts of the curve, in words by kind.
    x, y : the values.
    error : the standard errors of y, nan where unknown.
    valid : where the medium is valid.
    simulated : where a simulation gave the values, or they are data: such values are drawn as
        points, the others as a line.
    served : for an automatic medium the label of the medium that served each load; else empty.
    units : the units of x and y.
    is_measured : whether the values are data.
    is_path : whether the values are in the order of a path, on which the loads go up and down.
    """

    run: str
    facts: dict[str, str]
    x: Array
    y: Array
    error: Array
    valid: NDArray[np.bool_]
    simulated: NDArray[np.bool_]
    served: tuple[str, ...] = ()
    units: tuple[str, str] = ("", "")
    is_measured: bool = False
    is_path: bool = False

    def sorted(self) -> Curve:
        """Return the same curve in order of x; a path keeps its order."""
        if self.is_path:
            return self
        order = np.argsort(self.x, kind="stable")
        served = tuple(self.served[n] for n in order.tolist()) if self.served else ()
        return replace(
            self,
            x=self.x[order],
            y=self.y[order],
            error=self.error[order],
            valid=self.valid[order],
            simulated=self.simulated[order],
            served=served,
        )

    def join(self, other: Curve) -> Curve:
        """Return one curve with the points of this curve and of an ``other``, which has the same
        facts and units, in order of x. The curve has the names of both runs. Of a path, the points
        of the other come last.
        """
        return replace(
            self,
            run=f"{self.run}, {other.run}",
            x=np.concatenate([self.x, other.x]),
            y=np.concatenate([self.y, other.y]),
            error=np.concatenate([self.error, other.error]),
            valid=np.concatenate([self.valid, other.valid]),
            simulated=np.concatenate([self.simulated, other.simulated]),
            served=self.served + other.served,
        ).sorted()

    @property
    def is_points(self) -> bool:
        """Whether the curve is one of points: all values are from simulations or data, or there is
        only one value. A thin line joins the points of a path, and a thin line with marks takes
        their place if an automatic medium served.
        """
        return bool(np.all(self.simulated)) or self.x.size == 1


def choose_widths(count: int) -> list[float]:
    """Return the widths of ``count`` lines, in points: later lines are thinner, so that all lines
    are seen.
    """
    if count == 1:
        return [_LONE_WIDTH]
    widths: list[float] = np.linspace(_GREATEST_WIDTH, _LEAST_WIDTH, count + 1)[1:].tolist()
    return widths


def make_looks(count: int) -> list[Look]:
    """Return looks of ``count`` curves: colours first, then dashes and marks.

    Beyond :data:`MOST_LOOKS` the colours and dashes are repeated, so that curves differ in the
    width of their lines alone.
    """
    widths = choose_widths(count)
    looks = []
    for number in range(count):
        # all colours are used up before the dashes change
        turn, colour = divmod(number, len(COLOURS))
        dash = turn % len(_DASHES)
        looks.append(Look(COLOURS[colour], widths[number], _DASHES[dash], _MARKERS[dash]))
    return looks


def _choose_styles(curve: Curve, look: Look) -> tuple[dict[str, Any], dict[str, Any]]:
    """Return two styles of a ``curve`` with a ``look``, as options of ``Axes.plot``: that of the
    part where the medium is valid, and that of the whole curve, which is drawn beneath this part.
    """
    common: dict[str, Any] = {"color": look.colour, "markersize": _SIZE}
    if curve.is_points and not curve.served:
        points = common | {"marker": look.marker}
        # a path joins its points by a thin line
        line = {"linestyle": "-", "linewidth": 0.6} if curve.is_path else {"linestyle": "none"}
        return points | {"linestyle": "none"}, points | line | _HOLLOW_LOOK
    # a line is thinner below marks, so that the marks are seen
    width = 0.8 if curve.served else look.width
    valid_line = common | {"marker": "", "linewidth": width}
    if look.dashes:
        valid_line |= {"dashes": look.dashes}
    thin_line = common | {"marker": ""} | _LOOK_OUTSIDE
    return valid_line, thin_line


def draw_curve(ax: Axes, curve: Curve, look: Look, gid: str) -> None:
    """Draw a curve in a ``look``. A line is as in the look where the medium is valid, and thin and
    dashed elsewhere; its errors are a band. A simulation has points with bars of their errors.

    The points of a path are joined, and triangles mark those that are reached by a fall of x. On
    the curve of an automatic medium each kind of mark stands for the medium that served. The names
    of the drawn parts in an SVG file begin with ``gid``.
    """
    _draw_errors(ax, curve, look.colour, gid)
    valid_y = np.where(curve.valid, curve.y, np.nan)
    valid_style, style_of_all = _choose_styles(curve, look)
    if "dashes" in valid_style:
        # a thin line below would be seen through the gaps of the dashes: only stretches outside
        # the range are thin, with the points at their ends
        is_outside = ~curve.valid
        is_outside[1:] |= ~curve.valid[:-1]
        is_outside[:-1] |= ~curve.valid[1:]
        outside_y = np.where(is_outside, curve.y, np.nan)
        ax.plot(curve.x, outside_y, gid=f"{gid}-outside", **style_of_all)
        style_of_all = {"linestyle": "none"}
    ax.plot(curve.x, curve.y, gid=f"{gid}-all", **style_of_all)
    ax.plot(curve.x, valid_y, gid=f"{gid}-valid", **valid_style)
    is_fall = np.diff(curve.x, prepend=curve.x[0]) < 0.0
    if curve.is_path and np.any(is_fall):
        triangles = valid_style | {"marker": "v", "markersize": 5.0}
        # hollow ones remain seen where the medium is not valid
        falls = curve.x[is_fall], curve.y[is_fall]
        ax.plot(*falls, gid=f"{gid}-falling-all", **triangles | _HOLLOW_LOOK)
        ax.plot(curve.x[is_fall], valid_y[is_fall], gid=f"{gid}-falling", **triangles)
    if curve.served:
        _mark_media(ax, curve, look.colour, gid)


def _draw_errors(ax: Axes, curve: Curve, colour: Any, gid: str) -> None:
    """Draw the standard errors of a curve in its ``colour``: bars at simulated values, at data and
    at a value that is alone, and a band along the line. ``gid`` is that of :func:`draw_curve`.
    """
    is_point = curve.simulated | curve.is_points
    errors_of_line = np.where(is_point, np.nan, curve.error)
    draw_error_band(ax, curve.x, curve.y, errors_of_line, colour, f"{gid}-errors")
    has_bar = is_point & (curve.error > 0.0)
    if np.any(has_bar):
        bars = np.where(has_bar, curve.error, np.nan)
        style: dict[str, Any] = {"fmt": "none", "elinewidth": 0.8, "color": colour}
        ax.errorbar(curve.x, curve.y, bars, gid=f"{gid}-errors", **style)


def _mark_media(ax: Axes, curve: Curve, colour: Any, gid: str) -> None:
    """Draw marks on the curve of an automatic medium, which show the medium that served at a load:
    at the first and the last load, at some between, on both sides of each change of the medium,
    and at each load at which a simulation served. A mark is hollow where the medium is not valid.
    ``gid`` is that of :func:`draw_curve`.
    """
    n = curve.x.size
    media = np.array([split_label(label)[0] for label in curve.served])
    changes = np.flatnonzero(media[1:] != media[:-1])  # the last loads before each change
    step = max(1, math.ceil(n / _MARKS_OF_CURVE))
    even_loads = np.arange(0, n, step)
    marked_loads = np.concatenate([even_loads, changes, changes + 1, [n - 1]])
    is_chosen = np.isin(np.arange(n), marked_loads) | curve.simulated
    names = dict.fromkeys(media.tolist())  # each once, in order
    for name, is_valid in itertools.product(names, (True, False)):
        is_marked = is_chosen & (media == name) & (curve.valid == is_valid)
        filling: dict[str, Any] = {} if is_valid else _HOLLOW_LOOK
        suffix = "" if is_valid else "-hollow"  # ids in an SVG are unique
        if np.any(is_marked):
            ax.plot(
                curve.x[is_marked],
                curve.y[is_marked],
                _MARKS_OF_MEDIA.get(name, "o"),
                color=colour,
                markersize=_SIZE_OF_MEDIA,
                linestyle="none",
                gid=f"{gid}-served-{name}{suffix}",
                **filling,
            )


def label_axes(ax: Axes, curves: Sequence[Curve], x: str, y: str) -> None:
    """Scale the axes for curves of the quantity ``y`` over ``x``, and name them with their
    units, which are those of the first curve. Raises what
    :func:`~granphon.figures.scales.scale_axis` raises.
    """
    xs = np.concatenate([curve.x for curve in curves])
    ys = np.concatenate([curve.y for curve in curves])
    for letter, values, name, unit in zip("xy", (xs, ys), (x, y), curves[0].units, strict=True):
        scale_axis(ax, letter, values)
        finite_values = values[np.isfinite(values)]
        largest = float(np.max(np.abs(finite_values), initial=0.0))
        name_axis(find_axis(ax, letter), largest, axis_label(name, ""), unit)


def _make_handle(look: Look, label: str, *, is_points: bool) -> Line2D:
    """Return the entry of a legend with a ``label`` for a curve in a ``look``: points if
    ``is_points``, else a line.
    """
    if is_points:
        style: dict[str, Any] = {"marker": look.marker} | _LOOK_OF_POINTS
    else:
        # in the legend no line is wider than a line that is alone
        style = {"linewidth": min(look.width, _LONE_WIDTH)}
        if look.dashes:
            style |= {"dashes": look.dashes}
    return Line2D([], [], color=look.colour, label=label, **style)


def _make_remarks(curves: Sequence[Curve]) -> list[Line2D]:
    """Return the last entries of the legend of ``curves``: the look of loads at which a medium is
    not valid, the bands of standard errors, and the mark of each medium that served an automatic
    medium. What no curve has gets no entry.
    """
    handles = list[Line2D]()
    grey = "0.3"
    if not all(np.all(curve.valid) for curve in curves):
        hollow_points: dict[str, Any] = {"marker": "o"} | _LOOK_OF_POINTS | _HOLLOW_LOOK
        look = hollow_points if all(curve.is_points for curve in curves) else _LOOK_OUTSIDE
        handles.append(Line2D([], [], label="outside its range", color=grey, **look))
    lines = [curve for curve in curves if not curve.is_points]
    errors = np.concatenate([[0.0], *(line.error * ~line.simulated for line in lines)])
    if np.any(errors > 0.0):
        handles.append(
            make_error_handle(np.concatenate([[0.0], *(line.y for line in lines)]), errors)
        )
    names = {split_label(label)[0] for curve in curves for label in curve.served}
    for name in sorted(names, key=list(MEDIA).index):
        handle = Line2D(
            [],
            [],
            color=grey,
            marker=_MARKS_OF_MEDIA.get(name, "o"),
            markersize=_SIZE_OF_MEDIA,
            linestyle="none",
            label=f"{describe_medium(name)} served",
        )
        handles.append(handle)
    return handles


# -- the curves of a data set


def read_values(dataset: Dataset, name: str, run: str = "") -> Any:
    """Return the variable ``name`` of a data set, an array with the axis "load"; ``run`` names the
    data set in messages.

    Raises :class:`~granphon.base.errors.InputError` for a ``name`` that is no text or that the data
    set does not have, for a variable that is not one number or truth value at each load, and for
    one without a finite value; :class:`~granphon.base.errors.FigureError` for a number beyond the
    axes of matplotlib.
    """
    quantities = list_quantities(dataset, "fiub")
    if require("variable", text, name) not in dataset.variables:
        raise InputError(f"the sweep has no variable {name!r}", mend=suggest(name, quantities))
    values = dataset[name]
    if name not in quantities:
        raise InputError(f"{name!r} is not one number at each load", mend="Draw another variable")
    if not np.any(np.isfinite(values)):
        why = "It is infinite for equal balls" if name == "reduced_force" else ""
        raise InputError(
            f"{name} of {run or 'the sweep'} has no finite value", why, "Draw another variable"
        )
    magnitudes = np.abs(np.asarray(values, float))
    is_too_large = np.isfinite(magnitudes) & (magnitudes > _LARGEST_NUMBER)
    is_too_small = (magnitudes > 0.0) & (magnitudes < 1.0 / _LARGEST_NUMBER)
    is_far = is_too_large | is_too_small
    if np.any(is_far):
        problem = f"{name!r} has the value {np.asarray(values)[is_far].flat[0]:g}"
        why = f"Figures have axes from {1.0 / _LARGEST_NUMBER:g} to {_LARGEST_NUMBER:g}"
        raise FigureError(problem, why, "Draw another variable")
    return values


def list_quantities(dataset: Dataset, kinds: str = "fiu") -> tuple[str, ...]:
    """Return the names of the variables and coordinates that are one number at each load;
    ``kinds`` holds the letters of the types of NumPy that count as numbers.
    """
    dimensions_of_curves = {"load", "medium", *list_parameters(dataset)}
    names = []
    for name, values in dataset.variables.items():
        is_over_load = "load" in values.dims and set(values.dims) <= dimensions_of_curves
        if is_over_load and values.dtype.kind in kinds:
            names.append(str(name))
    return tuple(names)


def read_curve(
    dataset: Dataset,
    variable: str,
    x: str,
    index: dict[str, int],
    run: str = "",
    facts: dict[str, str] | None = None,
) -> Curve:
    """Return the curve of a ``variable`` over ``x``, both names, along the load; ``index`` has an
    index in each other dimension. ``run`` names the data set in messages, and ``facts`` are those
    of the curve. The curve is in order of ``x``, unless its loads are a path, whose order it keeps.

    Raises what :func:`read_values` raises.
    """

    def select(values: Any) -> Any:
        """Return the numbers (n,) of an array of the data set along the load."""
        return np.asarray(values.isel(index, missing_dims="ignore"))

    x_values = select(read_values(dataset, x, run)).astype(float)
    y_values = select(read_values(dataset, variable, run)).astype(float)
    unknown_errors = dataset[variable] * np.nan
    errors = select(dataset.get(f"{variable}_error", unknown_errors)).astype(float)
    served: tuple[str, ...] = ()
    medium = str(np.atleast_1d(dataset["medium"].values)[index["medium"]])
    # the label tells the options of a medium, also where the data set is a part of a sweep
    name_of_medium, options = split_label(medium)
    if name_of_medium == AutoMedium.name and "choice" in dataset:
        served = tuple(map(str, select(dataset["choice"]).tolist()))
    labels = served or (medium,)
    is_simulated = [split_label(label)[0] == DirectSimulation.name for label in labels]
    # the data set of a fit says so itself: a fit is a line, whatever its medium
    simulated = np.asarray(dataset.attrs.get("points", is_simulated), bool)
    curve = Curve(
        run=run,
        facts=facts or {},
        x=x_values,
        y=y_values,
        error=errors,
        valid=select(dataset["valid"]),
        simulated=np.broadcast_to(simulated, x_values.shape),
        served=served,
        units=(_read_unit(dataset, x), _read_unit(dataset, variable)),
        is_path=options.get("ordered") == "true",
    )
    return curve.sorted()


def _read_unit(dataset: Dataset, name: str) -> str:
    """Return the unit of a variable; empty if the data set does not say one."""
    return str(dataset[name].attrs.get("units", ""))


def describe_lines(dataset: Dataset, variable: str) -> list[tuple[dict[str, str], dict[str, int]]]:
    """Return for each line of a variable its facts, in words by kind, and its index in each
    dimension besides the load.

    A variable that is the same in all directions has one line for all of them. The words of a
    simulation count cells, not balls, if a cell has several balls or the lattice is not known.
    """
    facts_of_balls, periods, n_balls = _describe_balls(dataset)
    has_overlap = "overlap" in facts_of_balls
    media = _describe_media(dataset, periods, n_balls, has_overlap=has_overlap)
    names = list_parameters(dataset)
    if variable in dataset and "direction" not in dataset[variable].dims:
        names = [name for name in names if name != "direction"]
    if "direction" in dataset.coords and dataset["direction"].ndim == 0:
        facts_of_balls["direction"] = f"along {dataset['direction'].item()}"
    lines = []
    for numbers in np.ndindex(*(dataset.sizes[name] for name in names)):
        index = dict(zip(names, numbers, strict=True))
        facts = dict(facts_of_balls)
        for name, number in index.items():
            kind, text = describe_value(dataset, name, number)
            facts[kind] = text
        for medium, facts_of_medium in enumerate(media):
            lines.append((facts | facts_of_medium, index | {"medium": medium}))
    return lines


def _describe_media(
    dataset: Dataset, periods: int, n_balls: int, *, has_overlap: bool
) -> list[dict[str, str]]:
    """Return the facts of each medium of a data set, in words by kind: the medium, and if
    ``has_overlap`` whether its states have terms of overlap/diameter. ``periods`` and ``n_balls``
    are those of :func:`_describe_balls`.
    """
    labels = map(str, np.atleast_1d(dataset["medium"].values).tolist())
    media = [{"medium": describe_medium(label, periods, n_balls)} for label in labels]
    if has_overlap:
        has_finite_overlap = list_finite_overlap(dataset)  # None where the load decides
        # a medium whose geometry the load decides has the words of the others, if these agree
        words_of_others = True in has_finite_overlap and False not in has_finite_overlap
        for facts_of_medium, is_finite in zip(media, has_finite_overlap, strict=True):
            has_terms = words_of_others if is_finite is None else is_finite
            facts_of_medium["overlap"] = describe_overlap(has_terms=has_terms)
    return media


def _describe_balls(dataset: Dataset) -> tuple[dict[str, str], int, int]:
    """Return the facts of the balls of a data set, in words by kind, the number of periods of the
    lattice, and the number of balls in its cell. A number that is not known is 2: a cell of several
    balls makes words count cells. Several lattices have the number of balls of the largest cell.
    """
    description: dict[str, Any] = json.loads(dataset.attrs.get("packing", "null")) or {}
    if "kinds" in description:  # a crystal
        kinds = description["order"] or [name for name, _ in description["kinds"]]
        lattice = description["lattice"] or "crystal"
        return {"lattice": f"{lattice} of {' '.join(kinds)}"}, 2, 2
    if "files" in description:  # a packing of another program
        return {"lattice": f"packing of {description['format']}"}, 2, 2
    if not description:
        return {}, 2, 2
    packing: Packing = restore(description, Packing, "the packing of the sweep")
    facts = list_facts(packing)
    if "lattice" not in dataset.coords:
        return facts, packing.structure.periods, packing.structure.n_balls
    names = map(str, np.atleast_1d(dataset["lattice"].values))
    try:
        lattices = [find_lattice(name) for name in names]
    except InputError:  # a lattice of the user, whose balls in a cell are not known
        return facts, packing.structure.periods, 2
    return facts, lattices[0].periods, max(lattice.n_balls for lattice in lattices)


# -- figures of a sweep ----------------------------------------------------------------------------


def plot_sweep(
    dataset: Dataset,
    ax: Axes,
    variable: str = "longitudinal",
    x: str | None = None,
    *,
    legend: bool = True,
) -> Axes:
    """Draw a variable of a sweep, one line for each medium and combination of parameters, in order
    of ``x``.

    Media have colours. Of one medium with several parameters the values of the first parameter
    that has at most six have colours. All other combinations are shades of these.

    Parameters
    ----------
    dataset : a data set made by :func:`granphon.sweep`.
    variable, x : names of variables or coordinates over load. ``x`` may also be a parameter in
        numbers, such as A.diameter; then each load has a line. By default ``x`` is the load of the
        sweep, a force, a pressure or an overlap, or at a single load the parameter in numbers with
        the most values.
    legend : whether to draw a legend; it names at most eight shades, and gives the number of all
        if there are more.

    Axes are logarithmic where all values are above zero. Lines are solid where the medium is valid,
    thin and dashed elsewhere. Each line is thinner than the one before, so that all remain visible
    where they coincide. A simulation has points in place of a line, open where it is not valid;
    points of several samples are means, with bars of their standard errors; the standard errors of
    lines are bands. On an ordered path a line joins the points in the order of the path, and
    triangles mark the points that are reached by a fall of ``x``. Marks on the line of an automatic
    medium name the medium that served. The slow transverse wave in space has a dash-dotted line.

    Raises
    ------
    InputError : ``variable`` or ``x`` is no name, or the sweep does not have it, or it is not one
        number or truth value at each load, or is nowhere finite; or the data set has no axis of
        loads or of media, as one load was chosen from it; or the values of an axis that would be
        logarithmic are not all from 1e-150 to 1e150.
    FigureError : a value is beyond the axes of matplotlib.
    """
    _, handles = _draw_sweep(dataset, ax, variable, x)
    if legend:
        ax.legend(handles=handles)
    return ax


def _draw_sweep(
    dataset: Dataset, ax: Axes, variable: str, x: str | None
) -> tuple[list[Curve], list[Line2D]]:
    """Draw the curves of :func:`plot_sweep`; return the curves and the entries of the legend."""
    x_name = choose_x(dataset, x)
    curves, handles = _draw_lines(dataset, ax, variable, x_name)
    label_axes(ax, curves, x_name, variable)
    return curves, handles


def choose_x(dataset: Dataset, x: str | None) -> str:
    """Return the name of the quantity on the axis of x, which is ``x`` unless that is None.
    Otherwise it is the load; but at a single load it is the parameter in numbers with the most
    values, if a parameter in numbers varies. :class:`~granphon.base.errors.InputError` if ``x`` is
    no name, and for a data set without an axis of loads or of media; whether the sweep has the name
    is not checked here.
    """
    require_axes(dataset)
    if x is not None:
        return str(require("x", text, x))
    if dataset.sizes["load"] == 1:
        return find_longest_parameter(dataset) or find_load(dataset)
    return find_load(dataset)


def _draw_lines(
    dataset: Dataset, ax: Axes, variable: str, x: str
) -> tuple[list[Curve], list[Line2D]]:
    """Draw the curves of a variable of a sweep over ``x`` without naming the axes; return the
    curves and the entries of the legend.
    """
    over_x = turn_over(dataset, x)
    read_values(over_x, variable)  # refuses a variable that cannot be drawn
    coloured_dimension = _choose_coloured_dimension(over_x)
    groups = _read_groups(over_x, variable, x, coloured_dimension)
    n_shades = len(groups[0])  # groups have equal sizes
    curves = [curve for group in groups for curve in group]
    shades = []
    for number in range(len(groups)):
        shades += _make_shades(COLOURS[number % len(COLOURS)], n_shades)
    dashes = _DASHES_OF_SLOW_WAVE if variable == _SLOW_WAVE else None
    marker = _VELOCITY_MARKERS.get(variable, "o")
    widths = choose_widths(len(curves))
    for curve, shade, width in zip(curves, shades, widths, strict=True):
        draw_curve(ax, curve, Look(shade, width, dashes, marker), variable)
    handles = list[Line2D]()
    has_colours = len(groups) > 1
    if has_colours or n_shades == 1:
        handles += _name_colours(groups, coloured_dimension)
    if n_shades > 1:
        # shades that all colours have are named in grey
        handles += _name_shades(groups, "0.5" if has_colours else COLOURS[0])
    return curves, handles + _make_remarks(curves)


def _read_groups(
    dataset: Dataset, variable: str, x: str, coloured_dimension: str
) -> list[list[Curve]]:
    """Return the curves of a variable over ``x`` in groups of equal size, one for each value of the
    ``coloured_dimension``.
    """
    groups: dict[int, list[Curve]] = {}
    for facts, index in describe_lines(dataset, variable):
        curve = read_curve(dataset, variable, x, index, facts=facts)
        groups.setdefault(index.get(coloured_dimension, 0), []).append(curve)
    return [groups[number] for number in sorted(groups)]


def _are_points(curves: Sequence[Curve]) -> bool:
    """Whether the legend shows all curves as points: all are drawn as points, and none is that of
    an automatic medium, whose points have the marks of the media that served.
    """
    return all(curve.is_points and not curve.served for curve in curves)


def _name_colours(groups: Sequence[Sequence[Curve]], coloured_dimension: str) -> list[Line2D]:
    """Return the entries of a legend for the colours, one for each of the ``groups`` of curves,
    which differ in the ``coloured_dimension``.
    """
    kinds = ["medium"]  # of facts that a label gives
    if coloured_dimension != "medium":
        kinds, _ = find_differing([group[0].facts for group in groups])
    handles = []
    for number, group in enumerate(groups):
        label = ", ".join(group[0].facts[kind] for kind in kinds)
        look = Look(COLOURS[number % len(COLOURS)], 1.5)
        handles.append(_make_handle(look, label, is_points=_are_points(group)))
    return handles


def _name_shades(groups: Sequence[Sequence[Curve]], colour: str) -> list[Line2D]:
    """Return the entries of a legend for the shades, which are the same in all ``groups`` of
    curves, as shades of one ``colour``. Of many shades ``_MOST_NAMES`` are named, and a last entry
    gives the number of all.
    """
    curves = groups[0]
    are_points = all(_are_points(group) for group in groups)
    kinds, _ = find_differing([curve.facts for curve in curves])
    shades = _make_shades(colour, len(curves))
    numbers = pick_evenly(len(curves), _MOST_NAMES)
    handles = []
    for number in numbers:
        label = ", ".join(curves[number].facts[kind] for kind in kinds)
        handles.append(_make_handle(Look(shades[number], 1.5), label, is_points=are_points))
    if len(numbers) < len(curves):
        remark = f"{len(numbers)} of {len(curves)} are named"
        handles.append(Line2D([], [], linestyle="none", label=remark))
    return handles


def _choose_coloured_dimension(dataset: Dataset) -> str:
    """Return the name of the dimension whose values have colours. It is the medium; but if the data
    set has one medium and several parameters of several values, it is the first of these that has
    no more values than there are colours, if one has.
    """
    names = [name for name in list_parameters(dataset) if dataset.sizes[name] > 1]
    if dataset.sizes["medium"] > 1 or len(names) < 2:
        return "medium"
    for name in names:
        if dataset.sizes[name] <= len(COLOURS):
            return name
    return "medium"


def _make_shades(name: str, count: int) -> list[Any]:
    """Return ``count`` shades (r, g, b) of the colour called ``name``, from darker to lighter than
    the colour; a single shade is the colour.
    """
    colour = np.array(to_rgb(name))
    # -1 is black, 0 the colour, and 1 white
    changes = np.linspace(-0.5, 0.6, count).tolist() if count > 1 else [0.0]
    shades = []
    for change in changes:
        darkened = colour * (1.0 + min(change, 0.0))
        whitening = max(change, 0.0) * (1.0 - colour)
        shades.append(tuple(darkened + whitening))
    return shades


def plot_exponent(dataset: Dataset, ax: Axes, x: str | None = None) -> Axes:
    """Draw the local exponent d log v_L / d log P of a sweep, with lines at 1/6, the exponent of
    equal balls by Hertz's law, and at the popular 1/4.

    The exponent of v_T is the same, except in a simulation. A crystal whose velocities have no
    exponent in common, as by JKR's law with friction, has no curve. The points of a simulation of
    several samples have bars of their standard errors. There is no legend. ``x``, and what is
    raised, are those of :func:`plot_sweep`. See :func:`granphon.local_exponent`.
    """
    plot_sweep(dataset, ax, "exponent", x, legend=False)
    # an exponent is a slope of logarithms already, and may be zero or below
    ax.set_yscale("linear")
    for value, name in ((FREQUENCY_EXPONENT, "1/6"), (0.25, "1/4")):
        ax.axhline(value, color=GUIDE, linewidth=0.6, zorder=0.5)
        _write_beside(ax, name, value, color="0.4")
    ax.margins(y=0.16)
    return ax


def _write_beside(ax: Axes, text: str, value: float, **options: Any) -> None:
    """Write a text to the right of the Axes, at the ``value`` of y; ``options`` are those of a text
    of matplotlib.
    """
    ax.annotate(
        text,
        (1.0, value),
        xycoords=ax.get_yaxis_transform(),
        xytext=(3, 0),
        textcoords="offset points",
        va="center",
        annotation_clip=False,
        **options,
    )


def sweep_figure(
    dataset: Dataset,
    x: str | None = None,
    *,
    variable: str | None = None,
    rows: str | None = None,
    columns: str | None = None,
    tell: Callable[[str], object] | None = None,
) -> Figure:
    """Draw a figure with velocities of a sweep above, their local exponent below, on one axis of
    ``x``; one column wide.

    ``x`` is that of :func:`plot_sweep`. With ``rows`` or ``columns``, the names of parameters or
    "medium", each value has a row or column of small panels with shared axes, which show one
    variable, by default the longitudinal velocity. Without these, too many curves for one panel are
    shared out likewise, see :func:`granphon.figures.choices.arrange`, and ``tell`` is called with a
    sentence that says what stands where.

    Velocities that are zero at all loads, as those of waves across a chain, or known at none are
    left out. Without any other velocity, as for a mechanism, the normal stiffness is drawn; for
    motions without velocities the velocity of the peak, or the greatest force. For a sweep without
    exponents (finite overlap), or for one ``variable``, there is the upper panel alone. Raises what
    :func:`plot_sweep` raises, and InputError for ``rows`` and ``columns`` that are no different
    names of what tells curves apart, or take too many panels.
    """
    velocities, variables = _choose_variables(dataset, variable)
    x_name = choose_x(dataset, x)
    main = _choose_main(velocities, variables)
    read_values(turn_over(dataset, x_name), main)  # refuses a variable that cannot be drawn
    layout = arrange(dataset, main, x_name, rows, columns)
    if layout.is_chosen and tell is not None:
        tell(f"too many curves of {main} for one panel: {layout.describe(dataset)}")
    if layout.has_panels or layout.shown:
        draw = partial(_draw_panel, variable=main, x=x_name)
        return draw_panels(dataset, layout, draw, partial(label_axes, x=x_name, y=main))
    has_exponent = (
        variable is None
        and bool(velocities)
        and "exponent" in dataset
        and bool(np.any(np.isfinite(dataset["exponent"])))
    )
    return _draw_large_panels(dataset, velocities, variables, x_name, has_exponent=has_exponent)


def _draw_large_panels(
    dataset: Dataset,
    velocities: Sequence[str],
    variables: Sequence[str],
    x: str,
    *,
    has_exponent: bool,
) -> Figure:
    """Return a figure of a sweep whose curves have room in one panel: the ``variables`` over ``x``,
    of which the ``velocities`` share a scale and have their symbols beside them, and if
    ``has_exponent`` a lower panel with the exponent. Below is the legend, and above the values of
    parameters that do not vary.
    """
    with styled_figure(4.0 if has_exponent else 2.6) as figure:
        ratios = [1.6, 1.0] if has_exponent else [1.0]
        axes = figure.subplots(len(ratios), sharex=True, squeeze=False, height_ratios=ratios)[:, 0]
        curves: dict[str, list[Curve]] = {}
        legends: dict[str, list[Line2D]] = {}
        for name in variables:
            curves[name], legends[name] = _draw_sweep(dataset, axes[0], name, x)
        if velocities:
            # one scale for all velocities
            all_curves = itertools.chain(*curves.values())
            scale_axis(axes[0], "y", np.concatenate([curve.y for curve in all_curves]))
            axes[0].set_ylabel(f"Sound velocity ({CATALOGUE['longitudinal'].unit})")
            _write_symbols(axes[0], curves)
        if has_exponent:
            plot_exponent(dataset, axes[1], x)
            axes[0].set_xlabel("")
        for ax in axes:
            ax.margins(x=0.08)
        # a velocity that is the same in all directions has a shorter legend than the others
        longest = max(variables, key=lambda name: len(legends[name]))
        are_points = _are_points(curves[longest])
        handles = legends[longest] + _name_velocities(velocities, are_points=are_points)
        medium = curves[longest][0].facts["medium"]
        # a single medium that no entry names heads the legend
        is_heading = dataset.sizes["medium"] == 1 and handles[0].get_label() != medium
        heading = _break_label(medium) if is_heading else None
        for handle in handles:
            handle.set_label(_break_label(str(handle.get_label())))
        add_legend(figure, handles, 4, heading)
        _name_single_values(figure, dataset, curves[longest][0], x)
    return figure


def _choose_variables(dataset: Dataset, variable: str | None) -> tuple[list[str], list[str]]:
    """Return the velocities that the figure of a sweep shows, and all variables in it: the one
    ``variable`` that is requested; without one the velocities that are not all zero or nan, or what
    stands for them. The list of velocities is empty where one variable is requested, and where
    another variable stands for velocities.
    """
    # a table of numbers that are not from a sweep has no "observe"
    observed = json.loads(dataset.attrs.get("observe", "[]"))
    single_variable = variable
    if variable is None and "motion" in observed and "velocities" not in observed:
        single_variable = "peak_velocity" if "peak_velocity" in dataset else "greatest_force"
    if single_variable is not None:
        return [], [single_variable]
    velocities = []
    for name in _VELOCITIES:
        # a velocity may be zero, across a chain, or nan, where none was found
        if name in dataset and np.any(np.nan_to_num(dataset[name]) != 0.0):
            velocities.append(name)
    return velocities, velocities or ["normal_stiffness"]


def _choose_main(velocities: Sequence[str], variables: Sequence[str]) -> str:
    """Return the one variable of small panels, of the ``variables`` that a larger panel shows: the
    longitudinal velocity if it is among the ``velocities``, else the first variable.
    """
    return "longitudinal" if "longitudinal" in velocities else variables[0]


def _draw_panel(dataset: Dataset, ax: Axes, variable: str, x: str) -> Panel:
    """Draw the curves of ``variable`` over ``x`` for the states of one panel, and return them with
    the entries of the legend and the facts of the first curve.
    """
    curves, handles = _draw_lines(dataset, ax, variable, x)
    return Panel(curves, handles, curves[0].facts)


def _name_single_values(figure: Figure, dataset: Dataset, curve: Curve, x: str) -> None:
    """Write above a figure the values of the parameters that have one value in a data set, such as
    a value that a user has chosen. A single load is written too, unless it is on the axis of ``x``.
    ``curve`` is any of the curves; a direction without effect on the curves is not among its facts,
    and not written.
    """
    names = [name for name in list_parameters(dataset) if dataset[name].size == 1 and name != x]
    kinds = [describe_value(dataset, name, 0)[0] for name in names]
    facts = [curve.facts[kind] for kind in kinds if kind in curve.facts]
    if dataset.sizes["load"] == 1 and x != find_load(dataset):
        facts.append(_describe_first_load(dataset))
    if facts:
        title = join_facts(facts, _LETTERS_OF_TITLE)
        figure.suptitle(title, fontsize=STYLE["axes.titlesize"])


def _name_velocities(velocities: Sequence[str], *, are_points: bool) -> list[Line2D]:
    """Return the entries of a legend for those of the drawn ``velocities`` that look unlike the
    others: pulses, and where the slow transverse wave is drawn, both transverse waves.
    ``are_points`` says whether velocities are drawn as points.
    """
    handles = []
    for name, marker in _VELOCITY_MARKERS.items():
        # a transverse wave alone, without the slow one, needs no entry
        has_entry = name == _PULSE or _SLOW_WAVE in velocities
        if name in velocities and has_entry:
            dashes = _DASHES_OF_SLOW_WAVE if name == _SLOW_WAVE else None
            look = Look("0.3", 1.2, dashes, marker)
            is_points = are_points or name == _PULSE
            handles.append(_make_handle(look, _VELOCITIES[name], is_points=is_points))
    return handles


def _break_label(label: str) -> str:
    """Return a ``label`` as it is if it fits into a line of a legend, else broken into lines."""
    return label if len(label) <= _LETTERS else join_facts([label], _LETTERS)


def _write_symbols(ax: Axes, curves: Mapping[str, Sequence[Curve]]) -> None:
    """Write the symbols of velocities beside the right ends of their ``curves``, which are given by
    the names of the velocities. Of neighbouring curves of one velocity the fastest has the symbol.
    Curves of another velocity may divide them into parts; then each part has the symbol. Where ends
    are close, one text has the symbols.

    Marks of pulses, which are often near long waves, are in the legend, and have no symbol.
    """
    all_ends: list[tuple[float, str]] = []  # velocity at the right end, m/s, and symbol
    for name, curves_of_velocity in curves.items():
        # the right end is at the greatest x: a path may turn, and end anywhere
        velocities = [float(curve.y[np.argmax(curve.x)]) for curve in curves_of_velocity]
        finite_velocities = [velocity for velocity in velocities if np.isfinite(velocity)]
        if name != _PULSE:
            all_ends += [(velocity, _VELOCITIES[name]) for velocity in finite_velocities]
    parts = itertools.groupby(sorted(all_ends), key=lambda end: end[1])
    ends = [max(part) for _symbol, part in parts]
    to_axes = ax.transData - ax.transAxes
    left = ax.get_xlim()[0]
    last_height = -np.inf
    texts: list[tuple[float, list[str]]] = []  # velocity and symbols of each text, upwards
    for velocity, symbol in ends:
        _, height = to_axes.transform((left, velocity))
        if height - last_height > _LEAST_HEIGHT:
            last_height = height
            texts.append((velocity, []))
        _, symbols = texts[-1]
        if symbol not in symbols:
            symbols.append(symbol)
    for velocity, symbols in texts:
        _write_beside(ax, ", ".join(symbols), velocity)


# -- figures of several results --------------------------------------------------------------------


def plot_together(
    results: Sequence[Any] | Mapping[str, Any],
    ax: Axes,
    *,
    x: str | None = None,
    y: str | None = None,
    data: Any = (),
    balls_per_side: int | None = None,
    distance: float | tuple[float, float] | None = None,
    legend: bool = True,
) -> Axes:
    """Draw several results on one Axes.

    Sweeps, states and fits are curves and points of ``y`` over ``x``. If all results have bands and
    there is no ``x``, no ``y`` and no data, the bands are drawn one over the other; densities of
    states likewise.

    Parameters
    ----------
    results : sweeps, fits, bands, densities of states, results of scenes. The names of a mapping
        stand in the legend for all that the curves of a result share.
    x : "force", "pressure", "overlap" or "reduced_force", or a parameter in numbers over which all
        results are swept; by default the load of the results if all have the same kind of load,
        else the force.
    y : a quantity of :data:`~granphon.observables.catalogue.CATALOGUE` that all results hold; by
        default the longitudinal velocity, or another velocity that all hold, or the bulk modulus.
    data : measured velocities, one or several: files in the form of ``granphon fit``, or
        :class:`~granphon.fits.measurements.Measurements`.
    balls_per_side : number of balls at a side of the hexagonal frame, for files of data with side
        forces.
    distance : distance of times of flight, m, for files of data that do not give one; or
        (distance, standard error).
    legend : whether to draw the legend, and the title.

    A line is solid where its medium is valid, thin and dashed elsewhere; a simulation has points,
    with bars of standard errors over samples; measured points are black. States that differ in
    their load alone are one set of points.

    Raises
    ------
    InputError : there is no result, or something else than results; the results cannot share an
        axis: one of them does not hold ``x`` or ``y``, or has no finite value of it, the units
        differ, the paths of bands differ, or some are bands and others are not (the error names
        the results); there are more curves than colours and dashes tell apart. Data are neither
        measurements nor files of them, ``y`` is then no velocity, or the loads of data cannot be
        converted.
    FigureError : a value is beyond the axes of matplotlib.
    """
    runs = _list_runs(results)
    handles, common = _draw_together(runs, ax, x, y, data, balls_per_side, distance)
    if legend:
        ax.legend(handles=handles, handlelength=_find_handle_length(handles))
        font_size = FontProperties(size=matplotlib.rcParams["font.size"]).get_size_in_points()
        figure: Any = ax.get_figure()
        inches = figure.get_figwidth() * ax.get_position().width
        # lines of the title are as long as the axes are wide
        n_letters = int(POINTS_PER_INCH * inches / (_WIDTH_OF_LETTER * font_size))
        title = join_facts(common, max(_LEAST_LETTERS_OF_TITLE, n_letters))
        ax.set_title(title, fontsize=font_size)
    return ax


def _find_handle_length(handles: Sequence[Line2D]) -> float | None:
    """Return the length of the handles of a legend, in units of the size of its font: longer if
    dashes tell lines apart, None for the usual length.
    """
    # a thin dashed line only says where a medium is not valid
    is_dashed = any(handle.is_dashed() and handle.get_linewidth() > 0.9 for handle in handles)
    return 2.8 if is_dashed else None


def comparison_figure(
    results: Sequence[Any] | Mapping[str, Any],
    *,
    legend: bool = True,
    rows: str | None = None,
    columns: str | None = None,
    tell: Callable[[str], object] | None = None,
    **options: Any,
) -> Figure:
    """Draw :func:`plot_together`, whose ``options`` these are, as a figure, one column wide, with
    the legend below it.

    A single sweep has panels for ``rows`` and ``columns``, and for too many curves, of which
    ``tell`` is told, as in :func:`sweep_figure`; measured points stand in each panel, and the
    legend below the panels is always drawn. Raises what :func:`plot_together` raises, and
    :class:`~granphon.base.errors.InputError` for ``rows`` and ``columns`` of anything but one
    sweep.
    """
    runs = _list_runs(results)
    if len(runs) == 1 and runs[0].dataset is not None and runs[0].measured is None:
        figure_of_panels = _draw_run_in_panels(runs[0], rows, columns, tell, **options)
        if figure_of_panels is not None:
            return figure_of_panels
    elif rows is not None or columns is not None:
        problem = "--rows and --columns are given for other results than one sweep"
        raise InputError(problem, "Panels are those of one sweep", "Give one sweep")
    with styled_figure(2.5) as figure:  # without legend and title, which make it higher
        handles, common = _draw_together(runs, figure.subplots(), **options)
        if not legend:
            return figure
        title = join_facts(common, _LETTERS_OF_TITLE)
        n_lines = len(title.splitlines())
        add_legend(figure, handles, -n_lines, handlelength=_find_handle_length(handles))
        if title:
            figure.suptitle(title, fontsize=STYLE["axes.titlesize"])
    return figure


def _list_runs(results: Sequence[Any] | Mapping[str, Any]) -> list[Run]:
    """Return the runs of several ``results``, by name or in a list; InputError if there is none,
    for a single result that is not in a list, and for what is no result.
    """
    # a data set is a mapping too, of variables
    is_single = isinstance(results, str) or find_dataset(results) is not None
    if is_single:
        raise InputError(f"results are {brief(results)}", mend="Give a list, or results by name")
    if isinstance(results, Mapping):
        runs = [Run.of(str(name), result, is_named=True) for name, result in results.items()]
    elif isinstance(results, Iterable):
        runs = [Run.of(f"result {n}", result) for n, result in enumerate(results, 1)]
    else:
        raise InputError(f"results are {brief(results)}", mend="Give a list, or results by name")
    if not runs:
        raise InputError("there is nothing to draw", mend="Give results")
    return runs


def _list_data(data: Any) -> list[Any]:
    """Return the sets of measured velocities, or their files, that an argument gives, one or
    several; InputError for what is neither one nor a list.
    """
    if isinstance(data, str | os.PathLike | Measurements):
        return [data]
    if not isinstance(data, Iterable):
        raise InputError(f"data are {brief(data)}", mend="Give measurements, a file, or a list")
    return list(data)


def _draw_run_in_panels(
    run: Run,
    rows: str | None,
    columns: str | None,
    tell: Callable[[str], object] | None,
    x: str | None = None,
    y: str | None = None,
    data: Any = (),
    balls_per_side: int | None = None,
    distance: float | tuple[float, float] | None = None,
) -> Figure | None:
    """Return a figure of the sweep of a run in panels, with measured points in each; None if all
    curves have room in one panel and each can have a colour of its own. ``rows``, ``columns`` and
    ``tell`` are those of :func:`comparison_figure`, and the other arguments those of
    :func:`plot_together`.
    """
    dataset: Any = run.dataset
    requested_x = _read_axis("x", x)
    dataset_over_x = turn_over(dataset, requested_x)
    run_over_x = replace(run, dataset=dataset_over_x)
    x_name, y_name = choose_axes([run_over_x], requested_x, _read_axis("y", y))
    layout = arrange(dataset, y_name, x_name, rows, columns)
    n_curves = len(describe_lines(dataset_over_x, y_name))
    is_plain = not layout.has_panels and not layout.shown
    if is_plain and n_curves <= len(COLOURS):
        return None
    if layout.is_chosen and tell is not None:
        tell(f"too many curves of {y_name} for one panel: {layout.describe(dataset)}")
    measured = [
        _read_points(points, [run_over_x], x_name, y_name, balls_per_side, distance)
        for points in _list_data(data)
    ]

    def draw(states: Dataset, ax: Axes) -> Panel:
        """Draw the states of a panel, and the measured points."""
        panel = _draw_panel(states, ax, y_name, x_name)
        handles = list(panel.handles)
        for number, points in enumerate(measured):
            is_alone = len(measured) == 1
            handles.append(_draw_measured(ax, points, number, is_alone=is_alone))
        return Panel([*panel.curves, *measured], handles, panel.facts)

    return draw_panels(dataset, layout, draw, partial(label_axes, x=x_name, y=y_name))


def _draw_together(
    runs: Sequence[Run],
    ax: Axes,
    x: str | None = None,
    y: str | None = None,
    data: Any = (),
    balls_per_side: int | None = None,
    distance: float | tuple[float, float] | None = None,
) -> _Caption:
    """Draw the curves of ``runs``; return the entries of the legend, and the facts that all curves
    share. The other arguments are those of :func:`plot_together`.
    """
    data_sets = _list_data(data)
    may_be_spectra = x is None and y is None and not data_sets
    if may_be_spectra:
        all_bands = [run.bands for run in runs if run.bands is not None]
        if len(all_bands) == len(runs):
            return _draw_bands_together(runs, all_bands, ax)
        densities = [run.dos for run in runs if run.dos is not None]
        if len(densities) == len(runs):
            return _draw_densities_together(runs, densities, ax)
    requested_x = _read_axis("x", x)
    runs_over_x = []  # over the parameter x, if it is one
    for run in runs:
        if run.dataset is None:
            runs_over_x.append(run)
        else:
            runs_over_x.append(replace(run, dataset=turn_over(run.dataset, requested_x)))
    x_name, y_name = choose_axes(runs_over_x, requested_x, _read_axis("y", y))
    curves = list[Curve]()
    for run in runs_over_x:
        curves += _read_curves_of_run(run, x_name, y_name)
    measured = [
        _read_points(points, runs_over_x, x_name, y_name, balls_per_side, distance)
        for points in data_sets
    ]
    _require_shared_axes(curves, x_name, y_name)
    return _draw_curves(ax, curves, measured, x_name, y_name)


def _read_curves_of_run(run: Run, x: str, y: str) -> list[Curve]:
    """Return the curves of ``y`` over ``x`` of a run: the data of a fit first, then a curve for
    each line of its data set.
    """
    assert run.dataset is not None  # choose_axes raises for other runs
    curves = []
    if run.measured is not None:
        points = read_curve(run.measured, y, x, {"medium": 0}, run.name)
        curves.append(replace(points, is_measured=True))
    name_of_run = {"name": run.name} if run.is_named else {}
    for facts_of_line, index in describe_lines(run.dataset, y):
        facts = name_of_run | facts_of_line | run.facts
        if x in run.dataset.coords:  # a parameter that is the axis is no fact
            facts.pop(describe_value(run.dataset, x, 0)[0], None)
        curves.append(read_curve(run.dataset, y, x, index, run.name, facts))
    return curves


def _draw_bands_together(runs: Sequence[Run], all_bands: Sequence[Bands], ax: Axes) -> _Caption:
    """Draw the bands of all ``runs`` one over the other; ``all_bands`` are those of each run.
    Branches are followed through their crossings if the bands have eigenvectors. Return the entries
    of the legend, and the facts that all runs share. InputError if the paths of the bands differ.
    """
    first = all_bands[0]
    for run, bands in zip(runs[1:], all_bands[1:], strict=True):
        _require_same_path(first, bands, f"{runs[0].name} and {run.name}")
    unit = HertzPrefix.for_top(max(float(bands.frequencies.max()) for bands in all_bands))
    lines = []
    for bands in all_bands:
        has_vectors = bands.eigenvectors is not None
        hertz = bands.connected_frequencies if has_vectors else bands.frequencies
        lines.append(list(zip(bands.distances, hertz / unit.hertz, strict=True)))
    caption = _draw_spectra(runs, ax, "bands", lines)
    corners = np.append(first.distances[:, 0], first.distances[-1, -1])
    name_corners(ax, corners, first.labels)
    ax.set(ylabel=f"Frequency ({write_hertz(unit)})", ylim=(0.0, None))
    return caption


def _require_same_path(first: Bands, second: Bands, names: str) -> None:
    """Raise InputError if the paths of two bands have different labels of corners, or corners at
    different distances; the message has the ``names`` of both runs.
    """
    has_labels = first.labels == second.labels
    has_corners = len(first.distances) == len(second.distances) and np.allclose(
        second.distances[:, [0, -1]], first.distances[:, [0, -1]], rtol=0.0, atol=1e-6
    )
    if has_labels and has_corners:
        return
    why = "The zones of the lattices have other sizes"
    if not has_labels:
        why = f"The one is {'-'.join(first.labels)}, the other {'-'.join(second.labels)}"
    raise InputError(
        f"the bands of {names} cannot share an axis: their paths differ",
        why,
        "Compute them along one path",
    )


def _draw_densities_together(
    runs: Sequence[Run], densities: Sequence[DensityOfStates], ax: Axes
) -> _Caption:
    """Draw the densities of states of all ``runs`` one over the other; ``densities`` has that of
    each run. Return the entries of the legend, and the facts that all runs share.
    """
    unit = HertzPrefix.for_top(max(float(dos.frequencies.max()) for dos in densities))
    lines = [[(dos.frequencies / unit.hertz, dos.total * unit.hertz)] for dos in densities]
    caption = _draw_spectra(runs, ax, "dos", lines)
    unit_name = write_hertz(unit)
    ax.set(xlabel=f"Frequency ({unit_name})", ylabel=f"DOS per ball (1/{unit_name})")
    ax.set(xlim=(0.0, None), ylim=(0.0, None))
    return caption


def _require_shared_axes(curves: Sequence[Curve], x: str, y: str) -> None:
    """Raise InputError if curves of ``y`` over ``x`` have several units on one axis, or if a curve
    has an ``x`` that is not finite, or no finite ``y``.
    """
    mend_of_x = "Take --x force (x='force')"
    mend_of_y = "Draw another quantity"
    for axis, (name, mend) in enumerate(((x, mend_of_x), (y, mend_of_y))):
        runs_by_unit: dict[str, str] = {}  # the first run of each unit
        for curve in curves:
            runs_by_unit.setdefault(curve.units[axis], curve.run)
        if len(runs_by_unit) > 1:
            reasons = []
            for unit, run in runs_by_unit.items():
                unit_words = f"in {unit}" if unit else "without a unit"
                reasons.append(f"{run} has it {unit_words}")
            problem = f"{' and '.join(runs_by_unit.values())} cannot share an axis of {name}"
            raise InputError(problem, "; ".join(reasons), mend)
    for curve in curves:
        if not np.all(np.isfinite(curve.x)):
            why = "It is infinite for equal balls" if x == "reduced_force" else ""
            raise InputError(f"{x} of {curve.run} is not finite", why, mend_of_x)
        if not np.any(np.isfinite(curve.y)):
            raise InputError(f"{y} of {curve.run} has no finite value", mend=mend_of_y)


# -- the runs of a figure, and the quantities that they share --------------------------------------


@dataclass(frozen=True, eq=False)
class Run:
    """A run: a data set of states, which a fit has too; of one state also bands, a density of
    states or both.

    Attributes
    ----------
    name : name of the run in messages; where ``is_named``, also in legends, for all facts that the
        curves of the run share.
    dataset, bands, dos : the results of the run; None without such a result.
    measured : the data of a fit, at their loads.
    facts : facts of the curves of a fit besides those of its data set, in words by kind.
    """

    name: str
    dataset: Dataset | None = None
    bands: Bands | None = None
    dos: DensityOfStates | None = None
    is_named: bool = False
    measured: Dataset | None = None
    facts: dict[str, str] = field(default_factory=dict)

    @classmethod
    def of(cls, name: str, result: Any, is_named: bool = False) -> Run:
        """Return the run of a ``result`` of the library, called ``name``, also in legends if
        ``is_named``; a run is returned as it is. :class:`~granphon.base.errors.InputError` for a
        result that shares no figure with others.
        """
        if isinstance(result, Run):
            return result
        if isinstance(result, WidthFit):
            return _tabulate_fit(name, result, is_named=is_named)
        if isinstance(result, Bands):
            return cls(name, bands=result, is_named=is_named)
        if isinstance(result, DensityOfStates):
            return cls(name, dos=result, is_named=is_named)
        dataset = find_dataset(result)
        if dataset is not None:
            bands = getattr(result, "bands", None)
            dos = getattr(result, "dos", None)
            return cls(name, dataset, bands, dos, is_named)
        mend = "Give sweeps, fits, bands, densities of states, or results of scenes"
        raise InputError(f"{brief(result)} shares no figure with others", mend=mend)

    @property
    def words(self) -> str:
        """The bands and the density of states of the run, in words; of a run without these, what
        its data set is: a fit, a sweep or a single state. Empty for a run that has none of these.
        """
        spectra = []
        if self.bands is not None:
            spectra.append("bands")
        if self.dos is not None:
            spectra.append("a density of states")
        if spectra or self.dataset is None:
            return " and ".join(spectra)
        if self.measured is not None:
            return "a fit"
        return "a sweep" if self.dataset["valid"].size > 1 else "a single state"

    @property
    def quantities(self) -> tuple[str, ...]:
        """Names of the quantities with one number at each load."""
        return () if self.dataset is None else list_quantities(self.dataset)


def _tabulate_fit(name: str, fit: WidthFit, *, is_named: bool) -> Run:
    """Return the run of a ``fit``, called ``name``: a data set of the curve, and one of the
    measured data. ``is_named`` says whether a legend gives the name.
    """
    frequency = fit.waves.frequency
    branch = fit.waves.branch
    # a fit of pulses that each have a frequency is known at the data alone
    is_at_data = np.ndim(frequency) > 0
    if is_at_data:
        force = fit.force
        velocity = fit.velocities
    else:
        force = np.geomspace(fit.force.min(), fit.force.max(), _N_FORCES)
        velocity = fit.velocity_at(force)
    facts = {}
    if "width" in fit.parameters:
        facts["spread"] = f"fitted W = {write_width(fit)}"
    if is_at_data:
        facts["waves"] = "pulses"
    elif frequency is not None:
        facts["waves"] = f"pulses of {write_value(float(frequency), 'Hz')}"
    data = {branch: fit.velocity, f"{branch}_error": fit.sigma}
    measured = _tabulate_over_force(fit, fit.force, data, are_points=True)
    curve = _tabulate_over_force(fit, force, {branch: velocity}, are_points=is_at_data)
    return Run(name, curve, is_named=is_named, measured=measured, facts=facts)


def _tabulate_over_force(
    fit: WidthFit, force: Array, velocities: Mapping[str, Array], *, are_points: bool
) -> Dataset:
    """Return the data set of ``velocities`` (n,), m/s, by their names, over the contact ``force``
    (n,), N, of a fit, with the other loads at this force, but without the overlap if another medium
    stands in for that of the fit. ``are_points`` says whether figures draw points in place of a
    line.
    """
    choice = fit.choice.stand_in
    finite_overlap = fit.waves.finite_overlap
    state = choice.of(fit.packing).at_force(force, finite_overlap=finite_overlap)
    values = {}
    for load in _LOADS:
        # a simulation has another overlap at this force than the medium that stands in for it
        is_unknown = load == "overlap" and choice != fit.choice
        if load != "force" and not is_unknown:
            values[load] = np.asarray(getattr(state, load), float)
    attributes = {"finite_overlap": int(finite_overlap), "points": int(are_points)}
    return tabulate(fit.packing, fit.medium, force, {**values, **velocities}, attributes)


def _read_axis(letter: str, name: str | None) -> str | None:
    """Return the ``name`` that a user requests for the axis of this ``letter``, without blanks
    about it, or None if the choice is free; InputError for what is no name.
    """
    return None if name is None else str(require(letter, text, name)).strip()


def choose_axes(runs: Sequence[Run], x: str | None, y: str | None) -> tuple[str, str]:
    """Return the names of what stands on the axes of x and y: a load or a parameter in numbers, and
    a quantity. ``x`` and ``y`` are the requested names, None where the choice is free.

    Raises :class:`~granphon.base.errors.InputError` if a run has spectra instead of curves, if
    there is no such load or quantity, and if a run does not hold it.
    """
    spectra = [run for run in runs if not run.quantities]
    runs_over_load = [run for run in runs if run.quantities]
    if spectra:
        why = "There is nothing over a load"
        if runs_over_load:
            run = runs_over_load[0]
            why = f"{run.name} is {run.words}: they cannot share an axis"
        raise InputError(
            f"{_join_names(spectra, 'holds', 'hold')} {spectra[0].words} and no velocities",
            why,
            "Draw them in figures of their own",
        )
    common = [name for name in runs[0].quantities if all(name in run.quantities for run in runs)]
    load = _choose_load(runs, common, x)
    if y is None:
        return load, _choose_y(runs, common)
    name = y.lower().replace(" ", "_")
    failing_runs = [run for run in runs if name not in run.quantities]
    if failing_runs:
        closest_name = closest(name, common)
        if name not in CATALOGUE and closest_name:
            raise InputError(f"there is no variable {y!r}", mend=f"Did you mean {closest_name}?")
        raise _explain_no_curve(runs, failing_runs, name)
    return load, name


def _explain_no_curve(runs: Sequence[Run], failing_runs: Sequence[Run], name: str) -> InputError:
    """Return the error for a quantity ``name`` that the ``failing_runs``, some or all of the
    ``runs``, do not have as a curve: they do not hold it, or not as one number at each load.
    """
    drawable = [
        quantity
        for quantity in runs[0].quantities
        if quantity in CATALOGUE and all(quantity in run.quantities for run in runs)
    ]
    runs_without = [run for run in failing_runs if run.dataset is None or name not in run.dataset]
    runs_with_table = [run for run in failing_runs if run not in runs_without]
    problems = []
    if runs_without:
        problems.append(f"{_join_names(runs_without, 'holds', 'hold')} no {name}")
    if runs_with_table:
        problems.append(f"{name} of {_join_names(runs_with_table)} is no curve over the load")
    holder = "All runs hold" if len(runs) > 1 else "It has"
    why = f"{holder} {', '.join(drawable)}" if drawable else "No quantity is in all runs"
    mends = []
    if drawable:
        mends.append("draw another quantity")
    if len(failing_runs) < len(runs):
        mends.append("leave these runs out")
    return InputError("; ".join(problems), why, ", or ".join(mends).capitalize())


def _choose_load(runs: Sequence[Run], common: Sequence[str], x: str | None) -> str:
    """Return the name of the x axis: the load or parameter in numbers ``x``, or if ``x`` is None
    the load that all runs have, else the force; InputError if ``x`` is neither a load nor a
    parameter, and if a run does not hold it as one number at each load.

    ``common`` are the quantities that all runs hold.
    """
    if x is None:
        loads = {find_load(run.dataset) for run in runs if run.dataset is not None}
        return loads.pop() if len(loads) == 1 else "force"
    is_parameter = any(run.dataset is not None and x in run.dataset.coords for run in runs)
    load = x if is_parameter else x.lower().replace(" ", "_")
    if load not in _LOADS and not is_parameter:
        dataset = runs[0].dataset
        parameters = []
        if dataset is not None:
            for parameter in list_parameters(dataset):
                if dataset[parameter].dtype.kind in "fiu":
                    parameters.append(parameter)
        raise InputError(f"{x!r} is no load", mend=suggest(load, (*_LOADS, *parameters)))
    runs_without = [run for run in runs if load not in run.quantities]
    if runs_without:
        problem = f"{_join_names(runs_without, 'has', 'have')} no {load}"
        if is_parameter and load not in _LOADS:
            problem = f"{_join_names(runs_without, 'is', 'are')} not swept over numbers of {load}"
        shared_loads = ", ".join(name for name in _LOADS if name in common)
        mend = f"Use {shared_loads or 'figures of their own'}"
        raise InputError(problem, "The runs cannot share that axis", mend)
    return load


def _choose_y(runs: Sequence[Run], common: Sequence[str]) -> str:
    """Return the first velocity among the ``common`` quantities of ``runs``, or without one the
    bulk modulus; InputError if this is not common either.
    """
    for name in ("longitudinal", "transverse", "transverse_fast", "transverse_slow", "bulk"):
        if name in common:
            return name
    problem = f"{_join_names(runs)} cannot share an axis: no velocity is in all"
    if len(runs) == 1:
        problem = f"{runs[0].name} has no velocity"
    contents = ", ".join(f"{run.name} {run.words}" for run in runs)
    quantities = [name for name in common if name not in _LOADS and not name.endswith("_error")]
    mend = "Draw each by itself"
    if quantities:
        example = quantities[0]
        mend = f"Name a quantity that all hold, as --y {example} (y={example!r})"
    raise InputError(problem, f"Found {contents}", mend)


def _join_names(runs: Sequence[Run], verb: str = "", verb_of_several: str = "") -> str:
    """Return the names of ``runs``, and after them the ``verb`` of a single run, or else the
    ``verb_of_several``.
    """
    names = " and ".join(", ".join(run.name for run in runs).rsplit(", ", 1))
    return f"{names} {verb if len(runs) == 1 else verb_of_several}".rstrip()


def _find_load_ratio(runs: Sequence[Run], x: str, mend: str = "Draw over the force") -> float:
    """Return the ratio of the load ``x`` to the contact force, SI, by which the forces of measured
    points become loads. :class:`~granphon.base.errors.InputError`, with the advice ``mend``, if the
    ratio is not the same at all loads of all ``runs``, or not finite, and for an overlap or a
    parameter ``x``.
    """
    if x == "force":
        return 1.0
    ratios = np.zeros(0)
    for run in runs:
        # an overlap is no multiple of the force, and a parameter is no load
        is_multiple = x in _LOADS and x != "overlap"
        if run.dataset is not None and x in run.dataset and is_multiple:
            ratios_of_run = np.ravel(run.dataset[x] / run.dataset["force"])
            ratios = np.concatenate([ratios, ratios_of_run])
    is_known = ratios.size > 0 and np.all(np.isfinite(ratios))
    if not is_known or np.ptp(ratios) > _SAME_RATIO * np.max(np.abs(ratios)):
        why = "It is not the same multiple of the contact force in all of them"
        if x == "overlap":
            why = "The overlap of balls was not measured"
        elif x not in _LOADS:
            why = "They are measured over a load"
        raise InputError(f"the {x} of measured points is not known from these runs", why, mend)
    return float(np.median(ratios))


def _read_points(
    points: Any,
    runs: Sequence[Run],
    x: str,
    y: str,
    balls_per_side: int | None,
    distance: float | tuple[float, float] | None,
) -> Curve:
    """Return the curve of measured velocities over the load ``x``, from a file or
    :class:`~granphon.fits.measurements.Measurements`. InputError if ``y`` is no velocity, if the
    file cannot be read, and if the loads of the points cannot be converted to ``x`` from ``runs``.
    Points without an error have the error nan. ``balls_per_side`` and
    ``distance`` are those of :func:`plot_together`.
    """
    entry = CATALOGUE.get(y)
    is_velocity = entry is not None and entry.cost in ("velocities", "pulse")
    if entry is None or not is_velocity or entry.unit != "m/s":
        raise InputError(
            f"measured velocities share no axis with {y}", mend="Take a velocity, as longitudinal"
        )
    if isinstance(points, Measurements):
        measurements = points
        name = "measured"
    else:
        measurements = _read_measurements(points, runs, balls_per_side, distance)
        name = Path(points).stem
    facts = {"run": name}
    if measurements.frequency is not None:
        frequencies = np.unique(measurements.frequency)
        facts["waves"] = "pulses"
        if frequencies.size == 1:
            facts["waves"] = f"pulses of {write_value(float(frequencies[0]), 'Hz')}"
    loads = _find_load_ratio(runs, x) * measurements.force
    sigma = np.nan if measurements.sigma is None else measurements.sigma
    all_true = np.ones(loads.shape, bool)
    curve = Curve(
        run=name,
        facts=facts,
        x=loads,
        y=measurements.velocity,
        error=np.broadcast_to(np.asarray(sigma, float), loads.shape),
        valid=all_true,
        simulated=all_true,
        is_measured=True,
    )
    return curve.sorted()


def _read_measurements(
    path: Any,
    runs: Sequence[Run],
    balls_per_side: int | None,
    distance: float | tuple[float, float] | None,
) -> Measurements:
    """Return the measurements of the file ``path``. Its pressures act on the packing of ``runs``,
    and its side forces on a hexagonal frame with ``balls_per_side``. ``distance``, m, or (distance,
    standard error), is that of times of flight. Raises what
    :meth:`~granphon.fits.measurements.Measurements.read` raises, and what :func:`_find_load_ratio`
    raises for pressures.
    """
    frame = None
    if balls_per_side is not None:
        frame = partial(force_of_frame, balls_per_side=balls_per_side)

    def find_force(pressure: float) -> float:
        """Return the contact force, N, of a pressure in SI units."""
        return pressure / _find_load_ratio(runs, "pressure", "Give the contact forces in the file")

    dataset = runs[0].dataset
    unit_of_pressure = ""
    if dataset is not None and "pressure" in dataset:
        unit_of_pressure = _read_unit(dataset, "pressure")
    # the unit of pressure tells along how many periods balls repeat; two if it is not known
    periods = {"N": 1, "N/m": 2, "Pa": 3}.get(unit_of_pressure, 2)
    return Measurements.read(
        path, distance=distance, frame=frame, pressed=find_force, periods=periods
    )


# -- curves ----------------------------------------------------------------------------------------


def _write_legend(curves: Sequence[Curve]) -> tuple[list[tuple[str, str]], list[str]]:
    """Return a pair of a heading and a label for each curve in the legend, and the facts that all
    curves share, which the title gives. A curve that is alone has its medium as the label, without
    a heading.

    Heading and label of a curve together give the facts in which curves differ, as far as the curve
    has them: the heading those that all curves of its run share, if the run has several curves. A
    curve without such a heading stands below the heading of another run that also holds for the
    curve; otherwise its heading is empty. Where no fact is left for the label, the label is the
    name of the run.
    """
    differing_kinds, shared_facts = find_differing([curve.facts for curve in curves])
    if len(curves) == 1:
        label = curves[0].facts.get("medium", curves[0].run)
        return [("", label)], [text for text in shared_facts if text != label]
    kinds_by_curve = list[list[str]]()  # the kinds of facts in heading and label
    heading_kinds = list[list[str]]()  # the kinds of facts in the heading of the curve's run
    for curve in curves:
        curves_of_run = [other for other in curves if other.run == curve.run]
        kinds = [kind for kind in differing_kinds if kind in curve.facts]
        shared_kinds = _list_constant(kinds, curves_of_run, [curve.run] * len(curves_of_run))
        if "name" in shared_kinds:  # the name stands for all facts that the curves of the run share
            kinds = [kind for kind in kinds if kind == "name" or kind not in shared_kinds]
            shared_kinds = ["name"]
        kinds_by_curve.append(kinds)
        heading_kinds.append(shared_kinds if len(curves_of_run) > 1 else [])
    labels = []
    for curve, kinds, kinds_of_run in zip(curves, kinds_by_curve, heading_kinds, strict=True):
        kinds_above = kinds_of_run or _find_heading(curve, kinds, curves, heading_kinds)
        heading = join_facts([curve.facts[kind] for kind in kinds_above], _LETTERS)
        if heading:
            heading += ":"
        facts_below = [curve.facts[kind] for kind in kinds if kind not in kinds_above]
        label = join_facts(facts_below or [curve.run], _LETTERS)
        labels.append((heading, label))
    return labels, shared_facts


def _find_heading(
    curve: Curve,
    kinds: Sequence[str],
    curves: Sequence[Curve],
    heading_kinds: Sequence[Sequence[str]],
) -> Sequence[str]:
    """Return the kinds of facts in a heading of another run that also holds for the ``curve``,
    whose label would give facts of the ``kinds``; empty if there is no such heading.

    ``heading_kinds`` are the kinds of facts in the heading of each of the ``curves``.
    """
    for headed_curve, heading in zip(curves, heading_kinds, strict=True):
        # a fact must be left for the label of the curve
        is_part = heading and set(heading) < set(kinds)
        if is_part and all(headed_curve.facts[kind] == curve.facts[kind] for kind in heading):
            return heading
    return []


class _CurveTable(NamedTuple):
    """The looks of curves as a table of colours, shades and dashes, each with labels of its own.

    Attributes
    ----------
    labels : the labels of the colours, of the shades, and of the dashes; a single label where all
        curves have the same look.
    places : the index, in each of the three lists of labels, of the look of each curve.
    """

    labels: tuple[list[str], list[str], list[str]]
    places: list[tuple[int, int, int]]

    @property
    def size(self) -> int:
        """Number of entries in the legend: a look that all curves have has none."""
        return sum(len(labels) for labels in self.labels if len(labels) > 1)


def _tabulate_curves(curves: Sequence[Curve]) -> _CurveTable | None:
    """Return the table of colours, shades and dashes with the shortest legend for many curves; None
    if no table both gives each curve a look of its own, with the colours, shades and dashes that
    there are, and has fewer entries than there are curves.

    Each table that is tried gives a colour to each value of one kind of facts, and shades to the
    facts that vary within a colour (:func:`_tabulate_by`). The tables are tried without dashes, and
    with dashes for the facts that are the same in all curves of a run.
    """
    differing_kinds, _ = find_differing([curve.facts for curve in curves])
    # of tables with equally short legends the first is taken: media have colours in a sweep too
    differing_kinds.sort(key=lambda kind: kind != "medium")
    kinds_of_runs = _list_constant(differing_kinds, curves, [curve.run for curve in curves])
    tables = []
    for kinds_of_dashes in ([], kinds_of_runs):
        kinds = [kind for kind in differing_kinds if kind not in kinds_of_dashes]
        tables += [_tabulate_by(kind, kinds, kinds_of_dashes, curves) for kind in kinds]
    limits = (len(COLOURS), _MOST_NAMES, len(_DASHES))
    possible_tables = []
    for table in tables:
        counts = [len(labels) for labels in table.labels]
        is_within_limits = all(count <= limit for count, limit in zip(counts, limits, strict=True))
        tells_all_apart = len(set(table.places)) == len(curves)
        if is_within_limits and tells_all_apart and table.size < len(curves):
            possible_tables.append(table)
    return min(possible_tables, key=lambda table: table.size, default=None)


def _list_constant(
    kinds: Sequence[str], curves: Sequence[Curve], groups: Sequence[Any]
) -> list[str]:
    """Return those of the ``kinds`` of facts that do not vary within any group of ``curves``;
    ``groups`` has the group of each curve, a value that all curves of a group share.
    """
    facts_of_groups: dict[Any, list[Mapping[str, str]]] = {}
    for curve, group in zip(curves, groups, strict=True):
        facts_of_groups.setdefault(group, []).append(curve.facts)
    return [
        kind
        for kind in kinds
        if all(
            len({facts.get(kind) for facts in facts_of_curves}) == 1
            for facts_of_curves in facts_of_groups.values()
        )
    ]


def _tabulate_by(
    kind: str, kinds: Sequence[str], kinds_of_dashes: Sequence[str], curves: Sequence[Curve]
) -> _CurveTable:
    """Return the table of the curves in which each value of the facts of one ``kind`` has a colour,
    also the lack of such a fact.

    Of the other ``kinds``, those that do not vary within a colour are in the label of the colour
    too, and all others have shades. ``kinds_of_dashes``, which are not among ``kinds``, have
    dashes. Where a colour, shade or dashes would give the name of a run among other facts, they
    give the name alone, and curves that differ in the other facts have one look.
    """
    kinds_of_colours = _list_constant(kinds, curves, [curve.facts.get(kind) for curve in curves])
    kinds_of_shades = [other for other in kinds if other not in kinds_of_colours]
    labels: list[list[str]] = []
    numbers: list[list[int]] = []
    for kinds_of_look in (kinds_of_colours, kinds_of_shades, kinds_of_dashes):
        kinds_of_label = ["name"] if "name" in kinds_of_look else kinds_of_look
        texts = []
        for curve in curves:
            facts = [curve.facts[label] for label in kinds_of_label if label in curve.facts]
            texts.append(join_facts(facts, _LETTERS))
        distinct_texts = list(dict.fromkeys(texts))
        labels.append(distinct_texts)
        numbers.append([distinct_texts.index(text) for text in texts])
    colours, shades, dashes = labels
    return _CurveTable((colours, shades, dashes), list(zip(*numbers, strict=True)))


def _draw_table(
    ax: Axes, curves: Sequence[Curve], table: _CurveTable, variable: str
) -> list[Line2D]:
    """Draw the curves of a ``variable`` with the colours, shades and dashes of their ``table``;
    return the entries of the legend: the colours, then shades and dashes in grey.
    """
    colours, shades, dashes = table.labels
    looks = []
    widths = choose_widths(len(curves))
    for (colour, shade, dash), width in zip(table.places, widths, strict=True):
        colour_of_curve = _make_shades(COLOURS[colour], len(shades))[shade]
        looks.append(Look(colour_of_curve, width, _DASHES[dash], _MARKERS[dash]))
    for curve, look in zip(curves, looks, strict=True):
        draw_curve(ax, curve, look, variable)
    looks_of_legend = [Look(COLOURS[number], 1.5) for number in range(len(colours))]
    entries = [*zip(looks_of_legend, colours, strict=True)]
    if len(shades) > 1:
        greys = [Look(grey, 1.5) for grey in _make_shades("0.5", len(shades))]
        entries += zip(greys, shades, strict=True)
    if len(dashes) > 1:
        dashed_looks = [Look("0.3", 1.5, _DASHES[n], _MARKERS[n]) for n in range(len(dashes))]
        entries += zip(dashed_looks, dashes, strict=True)
    are_points = _are_points(curves)
    return [_make_handle(look, label, is_points=are_points) for look, label in entries]


def _draw_curves(ax: Axes, curves: list[Curve], measured: list[Curve], x: str, y: str) -> _Caption:
    """Draw ``y`` over ``x``: the ``curves`` of runs, among which may be the measured points of
    fits, and other ``measured`` points. Return the entries of the legend, and the facts that all
    curves but measured points share. InputError for more curves than looks tell apart, and what
    :func:`label_axes` raises.
    """
    states = [curve for curve in curves if not curve.is_measured]
    models = _name_runs(_join_states(states))
    points = _drop_doubles([curve for curve in curves if curve.is_measured] + measured)
    groups, common = _draw_models(ax, models, y)
    # entries below a heading come last, so that no other entry stands below a heading
    handles = groups.pop("", [])
    is_alone = len(points) == 1
    for number, curve in enumerate(points):
        handles.append(_draw_measured(ax, curve, number, is_alone=is_alone))
    handles += _make_remarks(models)
    for heading, group in groups.items():
        handles.append(Line2D([], [], linestyle="none", label=heading))
        handles += group
    label_axes(ax, [*models, *points], x, y)
    return handles, common


def _draw_models(
    ax: Axes, models: Sequence[Curve], variable: str
) -> tuple[dict[str, list[Line2D]], list[str]]:
    """Draw the curves ``models`` of a ``variable``, each in a look of its own. Return the entries
    of the legend by their heading, which may be empty, and the facts that all curves share.
    InputError for more curves than looks tell apart.

    Many curves have the looks of a table if there is one with a shorter legend.
    """
    table = _tabulate_curves(models) if len(models) > len(COLOURS) else None
    if table is not None:
        _, common = find_differing([curve.facts for curve in models])
        return {"": _draw_table(ax, models, table, variable)}, common
    _require_looks(len(models), "Choose some of the states, as by --where, or draw fewer runs")
    labels, common = _write_legend(models)
    looks = make_looks(len(models))
    groups: dict[str, list[Line2D]] = {}
    for curve, look, (heading, label) in zip(models, looks, labels, strict=True):
        draw_curve(ax, curve, look, variable)
        handle = _make_handle(look, label, is_points=_are_points([curve]))
        groups.setdefault(heading, []).append(handle)
    return groups, common


def _require_looks(n_curves: int, mend: str) -> None:
    """Raise InputError, with the advice ``mend``, for more curves than looks tell apart."""
    if n_curves > MOST_LOOKS:
        problem = f"{n_curves} curves are too many to be told apart"
        raise InputError(problem, f"Colours and dashes tell {MOST_LOOKS} apart", mend)


def _drop_doubles(curves: Sequence[Curve]) -> list[Curve]:
    """Return the curves of measured points without those whose points equal the points of an
    earlier curve: several fits of one table have the same data.
    """
    distinct_curves = list[Curve]()
    tables = list[Array]()
    for curve in curves:
        table = np.array([curve.x, curve.y, curve.error])
        if not any(np.array_equal(table, earlier, equal_nan=True) for earlier in tables):
            distinct_curves.append(curve)
            tables.append(table)
    return distinct_curves


def _draw_measured(ax: Axes, curve: Curve, number: int, *, is_alone: bool) -> Line2D:
    """Draw measured points, with bars of their errors if these are known; return the entry of the
    legend. ``number``, that of the set of points, chooses the mark. Unless ``is_alone``, the entry
    has the name of the run.
    """
    facts = ["data"]
    if not is_alone:
        facts.append(curve.run)
    if "waves" in curve.facts:
        facts.append(curve.facts["waves"])
    style: dict[str, Any] = {
        "marker": _DATA_MARKS[number % len(_DATA_MARKS)],
        "markersize": 2.6,
        "linestyle": "none",
        "color": "black",
    }
    error = None if np.all(np.isnan(curve.error)) else curve.error
    gid = f"measured-{number}"
    ax.errorbar(curve.x, curve.y, error, elinewidth=0.7, gid=gid, zorder=3.0, **style)
    return Line2D([], [], label=join_facts(facts, _LETTERS), **style)


def _join_states(curves: Sequence[Curve]) -> list[Curve]:
    """Return the curves, with single states that have the same facts, so that they differ in their
    load at most, joined to one curve, in the place of the first.
    """
    joined_curves = list[Curve]()
    indices: dict[Any, int] = {}  # of the joined curves of states, by facts and units
    for curve in curves:
        is_state = curve.x.size == 1
        key = (frozenset(curve.facts.items()), curve.units)
        if is_state and key in indices:
            index = indices[key]
            joined_curves[index] = joined_curves[index].join(curve)
        else:
            if is_state:
                indices[key] = len(joined_curves)
            joined_curves.append(curve)
    return joined_curves


def _name_runs(curves: Sequence[Curve]) -> list[Curve]:
    """Return the curves, in which each curve that has the same facts as another one gets the name
    of its run as a further fact.
    """
    all_facts = [curve.facts for curve in curves]
    named_curves = []
    for curve in curves:
        has_twin = all_facts.count(curve.facts) > 1
        facts = {"run": curve.run} | curve.facts if has_twin else curve.facts
        named_curves.append(replace(curve, facts=facts))
    return named_curves


# -- bands, and densities of states ----------------------------------------------------------------


def _draw_spectra(
    runs: Sequence[Run], ax: Axes, name: str, lines: Sequence[Sequence[tuple[Array, Array]]]
) -> _Caption:
    """Draw the lines of each run in one look; return the entries of the legend, and the facts that
    all runs share, which are the title. For a single run no facts are returned. InputError for more
    runs than looks tell apart.

    ``lines`` has for each run its lines, pairs of x (n,) and y (n,). In an SVG file the names of
    the lines begin with ``name``.
    """
    _require_looks(len(runs), "Draw fewer runs")
    labels, common = _label_runs(runs)
    handles = []
    looks = make_looks(len(runs))
    for number, (lines_of_run, look, label) in enumerate(zip(lines, looks, labels, strict=True)):
        style: dict[str, Any] = {"color": look.colour, "linewidth": look.width}
        if look.dashes:
            style |= {"dashes": look.dashes}
        for x, y in lines_of_run:
            ax.plot(x, y, gid=f"{name}-{number}", **style)
        handles.append(Line2D([], [], label=label, **style))
    return handles, common if len(runs) > 1 else []


def _label_runs(runs: Sequence[Run]) -> tuple[list[str], list[str]]:
    """Return the label of each of the ``runs``, which have one state each, and the facts that all
    runs share.
    """
    facts_of_states = [_describe_state(run) for run in runs]
    facts = []  # by kind, of each run
    for run, facts_of_state in zip(runs, facts_of_states, strict=True):
        if not all(facts_of_states):
            # a run without facts does not differ from the others by its facts
            facts.append({"run": run.name})
        elif facts_of_states.count(facts_of_state) > 1:
            facts.append({"run": run.name} | facts_of_state)
        else:
            facts.append(facts_of_state)
    differing_kinds, shared_facts = find_differing(facts)
    labels = []
    for run, facts_of_run in zip(runs, facts, strict=True):
        kinds = [kind for kind in differing_kinds if kind in facts_of_run]
        if "name" in facts_of_run:
            kinds = ["name"]
        labels.append(join_facts([facts_of_run[kind] for kind in kinds] or [run.name], _LETTERS))
    return labels, shared_facts


def _describe_state(run: Run) -> dict[str, str]:
    """Return the facts of a run of one state, in words by kind."""
    facts = {"name": run.name} if run.is_named else {}
    if run.dataset is None:
        return facts
    facts_of_state, _ = describe_lines(run.dataset, "force")[0]
    return facts | facts_of_state | {"load": _describe_first_load(run.dataset)}


def _describe_first_load(dataset: Dataset) -> str:
    """Return in words the kind and the value of the first load of a data set, "force 3 N"."""
    kind = find_load(dataset)
    load = float(dataset[kind].values[0])
    return f"{kind} {write_value(load, _read_unit(dataset, kind))}"
