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
import os
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import partial
from pathlib import Path
from typing import Any

from granphon.figures.scales import add_legend, find_axis, name_axis, scale_axis, styled_figure

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
from granphon.figures.bands import name_corners
from granphon.figures.style import COLOURS, GUIDE, STYLE, VERMILION, pick_evenly, print_hertz
from granphon.figures.words import (
    describe_medium,
    describe_overlap,
    describe_parameter,
    find_differing,
    join_facts,
    list_facts,
    write_value,
)
from granphon.fits.fit import WidthFit
from granphon.fits.measurements import Measurements
from granphon.media.choice import MEDIA, AutoMedium
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
#: the largest number on an axis; matplotlib overflows at margins and ticks beyond larger numbers
_LARGEST = 1e280
#: dashes of lines of the same colour, the first solid; they differ from those outside the range
_DASHES = (None, (1.0, 1.4), (5.0, 1.6, 1.0, 1.6), (8.0, 2.5))
#: the greatest number of lines that colours and dashes tell apart
MOST_LOOKS = len(COLOURS) * len(_DASHES)
#: marks of the media that an automatic medium chose; a simulation has the mark of its points
_SERVING = {"ala": "s", "afa": "v", "ema": "^"}
#: looks of a line, and of marks, where the medium is not valid
_OUTSIDE: dict[str, Any] = {"linewidth": 0.7, "dashes": (3.0, 1.5)}
_HOLLOW: dict[str, Any] = {"markerfacecolor": "white"}
#: sizes of marks: of points, and of marks for the medium that served
_SIZE = 3.0
_SERVING_SIZE = 3.6
#: look of points in a legend, without colour and mark
_POINTS: dict[str, Any] = {"markersize": _SIZE, "linestyle": "none"}
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
_SLOW = "transverse_slow"
_SLOW_DASHES = (6.0, 1.5, 1.0, 1.5)
_VELOCITY_MARKERS = {_SLOW: "v", "transverse_fast": "^", _PULSE: "s"}
#: greatest number of letters of a line of a legend in a column, and of a title
_LETTERS = 50
_LETTERS_OF_TITLE = 60
#: greatest number of combinations of parameters in a legend
_MOST_NAMED = 8
#: number of marks for the medium that served along a curve
_MARKS_OF_CURVE = 12
#: symbols of velocities are written in one text if they are nearer than this, over the height
_LEAST_HEIGHT = 0.06
#: width of a letter, over the size of its font
_WIDTH_OF_LETTER = 0.55
#: number of forces of a curve that is drawn from a fit
_FORCES = 200
#: marks of measured points, which are black
_DATA_MARKS = ("o", "s", "^", "D", "v", "P")
#: quantities of the axis of loads
_LOADS = ("force", "pressure", "overlap", "reduced_force")

#: data of the caption of an Axes: entries of the legend, and the facts that all curves share
_Drawn = tuple[list[Line2D], list[str]]


def plot_fit(fit: WidthFit, ax: Axes, residual_ax: Axes) -> tuple[Axes, Axes]:
    """Draw measured velocities with standard errors, the fit, and the ideal lattice; below,
    residuals in units of sigma.

    Where each pulse has a frequency of its own, the fit is drawn at the data only, and the ideal
    lattice is left out.
    """
    ax.errorbar(fit.force, fit.velocity, fit.sigma, **_DATA_STYLE, label="data", gid="data")
    structure = fit.packing.structure
    # short lines, so that the legend has room below the curve
    label = join_facts([describe_medium(fit.medium, structure.periods, structure.n_balls)], 28)
    label += f":\nW = {write_width(fit)}" if "width" in fit.parameters else ""
    style: dict[str, Any] = {"color": VERMILION, "label": label, "gid": "fit", "zorder": 1.5}
    if np.ndim(fit.waves.frequency):
        ax.plot(fit.force, fit.velocities, "_", markersize=6.0, **style)
    else:
        force = np.geomspace(fit.force.min(), fit.force.max(), _FORCES)
        ax.plot(force, fit.velocity_at(force), linewidth=1.2, **style)
        equal: dict[str, Any] = {
            "color": GUIDE,
            "label": "equal balls",
            "gid": "ideal",
            "zorder": 1.0,
        }
        ax.plot(force, fit.velocity_at(force, "ala"), linewidth=0.8, **equal)
    residual_ax.axhline(0.0, color=VERMILION, linewidth=1.2, zorder=1.0)
    residual_ax.errorbar(fit.force, fit.residuals / fit.sigma, 1.0, **_DATA_STYLE, gid="residuals")
    for axes in (ax, residual_ax):
        scale_axis(axes, "x", fit.force)
    scale_axis(ax, "y", fit.velocity)
    if fit.waves.frequency is None:
        ax.set_ylabel(axis_label(fit.waves.branch))
    else:
        ax.set_ylabel("Group velocity (m/s)")
    residual_ax.set(xlabel=axis_label("force"), ylabel="Residual / σ")
    residual_ax.yaxis.set_major_locator(MaxNLocator(5, integer=True))
    return ax, residual_ax


def write_width(fit: WidthFit) -> str:
    """Return the fitted width with its standard error, if known, of which two digits are written:
    "2.026 ± 0.021 µm".
    """
    if not fit.errors_are_known:
        return write_value(fit.width, "m")
    return write_uncertain(fit.width, fit.stderr, "m").replace("+/-", "±").replace("u", "µ")


def fit_figure(fit: WidthFit) -> Figure:
    """Draw a figure of a fit above its residuals, see :func:`plot_fit`; one column wide."""
    with styled_figure(3.6) as figure:
        axes = figure.subplots(2, sharex=True, height_ratios=[3.0, 1.0])
        plot_fit(fit, axes[0], axes[1])
        handles, labels = axes[0].get_legend_handles_labels()
        order = [labels.index("data"), *(i for i, label in enumerate(labels) if label != "data")]
        # velocities rise with the force, so that the lower right corner is free
        axes[0].legend([handles[i] for i in order], [labels[i] for i in order], loc="lower right")
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
    simulated : where a simulation gave the values: simulated values are points, others a line.
    served : for an automatic medium the name of the medium that served each load; else empty.
    units : the units of x and y.
    measured : whether the values are data.
    path : whether the loads go up and down in the order of the values.
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
    measured: bool = False
    path: bool = False

    def sorted(self) -> Curve:
        """Return the same curve in order of x; a path keeps its order."""
        if self.path:
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

    def join(self, curve: Curve) -> Curve:
        """Return the points of two curves as one curve, in order of x."""
        return replace(
            self,
            run=f"{self.run}, {curve.run}",
            x=np.concatenate([self.x, curve.x]),
            y=np.concatenate([self.y, curve.y]),
            error=np.concatenate([self.error, curve.error]),
            valid=np.concatenate([self.valid, curve.valid]),
            simulated=np.concatenate([self.simulated, curve.simulated]),
            served=self.served + curve.served,
        ).sorted()

    @property
    def as_points(self) -> bool:
        """Whether no line is drawn: all values are simulated or measured, or there is only one."""
        return bool(np.all(self.simulated)) or self.x.size == 1


def make_looks(count: int) -> list[Look]:
    """Return looks of ``count`` curves: colours first, then dashes and marks. Later lines are
    thinner, so that all lines are seen.

    Beyond :data:`MOST_LOOKS` the looks are repeated.
    """
    turns = [(n % len(COLOURS), n // len(COLOURS) % len(_DASHES)) for n in range(count)]
    widths = np.linspace(2.2, 1.0, count + 1)[1:].tolist() if count > 1 else [1.6]
    return [
        Look(COLOURS[colour], width, _DASHES[turn], ("o", "s", "^", "D")[turn])
        for (colour, turn), width in zip(turns, widths, strict=True)
    ]


def _choose_styles(curve: Curve, look: Look) -> tuple[dict[str, Any], dict[str, Any]]:
    """Return the styles of a curve where the medium is valid, and elsewhere."""
    common: dict[str, Any] = {"color": look.colour, "markersize": _SIZE}
    if curve.as_points and not curve.served:
        line = {"linestyle": "-", "linewidth": 0.6} if curve.path else {"linestyle": "none"}
        points = common | {"marker": look.marker}
        return points | {"linestyle": "none"}, points | line | _HOLLOW
    # a line is thinner below marks, so that the marks are seen
    solid = common | {"marker": "", "linewidth": 0.8 if curve.served else look.width}
    if look.dashes:
        solid |= {"dashes": look.dashes}
    return solid, common | {"marker": ""} | _OUTSIDE


def draw_curve(ax: Axes, curve: Curve, look: Look, gid: str) -> None:
    """Draw a curve: solid where the medium is valid, thin and dashed elsewhere; points of a
    simulation, with bars of their errors.

    A path joins its points, and triangles mark the points that are reached by a fall of x. On an
    automatic medium each kind of mark stands for the medium that served.
    """
    has_bars = curve.as_points or np.any(curve.simulated)
    if has_bars and np.any(curve.error > 0.0):
        bars = np.where(curve.error > 0.0, curve.error, np.nan)
        ax.errorbar(
            curve.x,
            curve.y,
            bars,
            fmt="none",
            elinewidth=0.8,
            color=look.colour,
            gid=f"{gid}-errors",
        )
    valid_y = np.where(curve.valid, curve.y, np.nan)
    solid, thin = _choose_styles(curve, look)
    if "dashes" in solid:
        # a thin line below would be seen through the gaps of the dashes: only stretches outside
        # the range are thin, with the points at their ends
        is_outside = ~curve.valid
        is_outside[1:] |= ~curve.valid[:-1]
        is_outside[:-1] |= ~curve.valid[1:]
        ax.plot(curve.x, np.where(is_outside, curve.y, np.nan), gid=f"{gid}-outside", **thin)
        thin = {"linestyle": "none"}
    ax.plot(curve.x, curve.y, gid=f"{gid}-all", **thin)
    ax.plot(curve.x, valid_y, gid=f"{gid}-valid", **solid)
    falls = np.diff(curve.x, prepend=curve.x[0]) < 0.0
    if curve.path and np.any(falls):
        fallen = solid | {"marker": "v", "markersize": 5.0}
        ax.plot(curve.x[falls], valid_y[falls], gid=f"{gid}-falling", **fallen)
    if curve.served:
        _mark_media(ax, curve, look.colour, gid)


def _mark_media(ax: Axes, curve: Curve, colour: Any, gid: str) -> None:
    """Draw marks of the media that served an automatic medium: at its first and last loads, at
    some between, and on both sides of each change of the medium.
    """
    n = curve.x.size
    media = np.array([label.partition("(")[0] for label in curve.served])
    change = np.flatnonzero(media[1:] != media[:-1])
    evenly = np.arange(0, n, max(1, -(-n // _MARKS_OF_CURVE)))
    chosen = np.concatenate([evenly, change, change + 1, [n - 1]])
    is_chosen = np.isin(np.arange(n), chosen) | curve.simulated
    for name, valid in itertools.product(dict.fromkeys(media.tolist()), (True, False)):
        is_marked = is_chosen & (media == name) & (curve.valid == valid)
        if np.any(is_marked):
            ax.plot(
                curve.x[is_marked],
                curve.y[is_marked],
                _SERVING.get(name, "o"),
                color=colour,
                markersize=_SERVING_SIZE,
                linestyle="none",
                gid=f"{gid}-served-{name}",
                **({} if valid else _HOLLOW),
            )


def label_axes(ax: Axes, curves: Sequence[Curve], x: str, y: str) -> None:
    """Scale the axes for curves of the quantity ``y`` over ``x``, and name them with their
    units.
    """
    xs = np.concatenate([curve.x for curve in curves])
    ys = np.concatenate([curve.y for curve in curves])
    for which, values, name, unit in zip("xy", (xs, ys), (x, y), curves[0].units, strict=True):
        scale_axis(ax, which, values)
        most = float(np.max(np.abs(values[np.isfinite(values)]), initial=0.0))
        name_axis(find_axis(ax, which), most, axis_label(name, ""), unit)


def _make_handle(look: Look, label: str, points: bool) -> Line2D:
    """Return the entry of a legend for a line, or for ``points``, of this look."""
    style: dict[str, Any] = {"linewidth": min(look.width, 1.6)}
    if look.dashes:
        style |= {"dashes": look.dashes}
    if points:
        style = {"marker": look.marker} | _POINTS
    return Line2D([], [], color=look.colour, label=label, **style)


def _make_remarks(curves: Sequence[Curve]) -> list[Line2D]:
    """Return the last entries of a legend: loads at which a medium is not valid, and media that
    served automatic media.
    """
    handles = list[Line2D]()
    grey = dict[str, Any](color="0.3")
    if not all(np.all(curve.valid) for curve in curves):
        points: dict[str, Any] = {"marker": "o"} | _POINTS | _HOLLOW
        look = points if all(curve.as_points for curve in curves) else _OUTSIDE
        handles.append(Line2D([], [], label="outside its range", **grey, **look))
    names = {label.partition("(")[0] for curve in curves for label in curve.served}
    style = grey | {"markersize": _SERVING_SIZE, "linestyle": "none"}
    return handles + [
        Line2D(
            [], [], marker=_SERVING.get(name, "o"), label=f"{describe_medium(name)} served", **style
        )
        for name in sorted(names, key=list(MEDIA).index)
    ]


# -- the curves of a data set


def read_values(dataset: Dataset, name: str, run: str = "") -> Any:
    """Return a variable over the load; :class:`InputError` for a variable that cannot be drawn,
    FigureError beyond matplotlib's axes.
    """
    if name not in dataset.variables:
        raise InputError(
            f"the sweep has no variable {name!r}",
            f"It has {', '.join(map(str, dataset.data_vars))}",
        )
    values = dataset[name]
    if name not in list_quantities(dataset, "fiub"):
        raise InputError(f"{name!r} is not one number at each load", mend="Draw another variable")
    if not np.any(np.isfinite(values)):
        why = "It is infinite for equal balls" if name == "reduced_force" else ""
        raise InputError(
            f"{name} of {run or 'the sweep'} has no finite value", why, "Draw another variable"
        )
    sizes = np.abs(np.asarray(values, float))
    is_far = (np.isfinite(sizes) & (sizes > _LARGEST)) | ((sizes > 0.0) & (sizes < 1.0 / _LARGEST))
    if np.any(is_far):
        problem = f"{name!r} has the value {np.asarray(values)[is_far].flat[0]:g}"
        why = f"Figures have axes from {1.0 / _LARGEST:g} to {_LARGEST:g}"
        raise FigureError(problem, why, "Draw another variable")
    return values


def list_quantities(dataset: Dataset, kinds: str = "fiu") -> tuple[str, ...]:
    """Return the names of the variables that are one number, of these ``kinds`` of dtype, at each
    load.
    """
    dims = {"load", "medium", *list_parameters(dataset)}
    return tuple(
        str(name)
        for name, values in dataset.variables.items()
        if "load" in values.dims and set(values.dims) <= dims and values.dtype.kind in kinds
    )


def list_parameters(dataset: Dataset) -> list[str]:
    """Return the dimensions of the sweep besides load and medium: its parameters, and directions if
    there are several.
    """
    along = ("direction",) * ("direction" in dataset.dims)
    return [
        str(name) for name in (*dataset["valid"].dims, *along) if name not in ("load", "medium")
    ]


def turn_over(dataset: Dataset, x: str | None) -> Dataset:
    """Return the data set with the parameter ``x`` in the place of the load, if the parameter has
    numbers: curves lie over the parameter.
    """
    if x not in list_parameters(dataset) or dataset[x].dtype.kind not in "fiu":
        return dataset
    return (
        dataset.drop_vars("load", errors="ignore")
        .swap_dims({"load": find_load(dataset)})
        .rename_dims({x: "load"})
    )


def read_curve(
    dataset: Dataset,
    variable: str,
    x: str,
    index: dict[str, int],
    run: str = "",
    facts: dict[str, str] | None = None,
) -> Curve:
    """Return the curve of a variable over ``x`` at an index of each dimension besides the load."""

    def take(values: Any) -> Any:
        return np.asarray(values.isel(index, missing_dims="ignore"))

    across = read_values(dataset, x, run)
    along = read_values(dataset, variable, run)
    error = dataset.get(f"{variable}_error", dataset[variable] * np.nan)
    served: tuple[str, ...] = ()
    medium = str(np.atleast_1d(dataset["medium"].values)[index["medium"]])
    if medium.startswith(AutoMedium.name) and "choice" in dataset:
        served = tuple(map(str, take(dataset["choice"]).tolist()))
    horizontal = take(across).astype(float)
    media = served or (medium,)
    simulated = [label.partition("(")[0] == DirectSimulation.name for label in media]
    simulated = dataset.attrs.get("points", simulated)  # a fit is a line, whatever its medium
    units = tuple(str(dataset[name].attrs.get("units", "")) for name in (x, variable))
    media_of_sweep = json.loads(dataset.attrs.get("media", "[{}]"))  # {name: options} of each
    options: dict[str, Any] = next(iter(media_of_sweep[index["medium"]].values()), {})
    return Curve(
        run,
        facts or {},
        horizontal,
        take(along).astype(float),
        take(error).astype(float),
        take(dataset["valid"]),
        np.broadcast_to(np.asarray(simulated, bool), horizontal.shape),
        served,
        (units[0], units[1]),
        path=bool(options.get("ordered")),
    ).sorted()


def describe_lines(dataset: Dataset, variable: str) -> list[tuple[dict[str, str], dict[str, int]]]:
    """Return for each line of a variable its facts, in words by kind, and its index in each
    dimension besides the load.

    Directions are no lines of a variable that is the same in all directions. Cells of a lattice are
    called cells if the data set does not describe the lattice, or has several lattices.
    """
    base, periods, balls = _describe_balls(dataset)
    overlaps = [dict[str, str]()] * dataset.sizes["medium"]
    if "overlap" in base:
        overlaps = [
            {"overlap": describe_overlap(finite)} for finite in list_finite_overlap(dataset)
        ]
    labels = map(str, np.atleast_1d(dataset["medium"].values).tolist())
    media = [
        overlap | {"medium": describe_medium(label, periods, balls)}
        for overlap, label in zip(overlaps, labels, strict=True)
    ]
    names = list_parameters(dataset)
    if variable in dataset and "direction" not in dataset[variable].dims:
        names = [name for name in names if name != "direction"]
    if "direction" in dataset.coords and dataset["direction"].ndim == 0:
        base["direction"] = f"along {dataset['direction'].item()}"
    lines = []
    for numbers in np.ndindex(*(dataset.sizes[name] for name in names)):
        index = dict(zip(names, numbers, strict=True))
        facts = dict(base)
        for name, number in index.items():
            kind, text = _describe_value(dataset, name, number)
            facts[kind] = text
        lines += [(facts | medium, index | {"medium": m}) for m, medium in enumerate(media)]
    return lines


def _describe_balls(dataset: Dataset) -> tuple[dict[str, str], int, int]:
    """Return the facts of the balls of a data set, in words by kind, and the numbers of periods and
    of balls in a cell of the lattice; 2 where unknown.
    """
    description: dict[str, Any] = json.loads(dataset.attrs.get("packing", "null")) or {}
    if "kinds" in description:  # a crystal
        kinds = description["order"] or [name for name, _ in description["kinds"]]
        return {"lattice": f"{description['lattice'] or 'crystal'} of {' '.join(kinds)}"}, 2, 2
    if not description:
        return {}, 2, 2
    packing: Packing = restore(description, Packing, "the packing of the sweep")
    facts = list_facts(packing)
    if "lattice" not in dataset.coords:
        return facts, packing.structure.periods, packing.structure.n_balls
    names = map(str, np.atleast_1d(dataset["lattice"].values))
    try:
        lattices = [find_lattice(name) for name in names]
    except InputError:  # a lattice of the user
        return facts, packing.structure.periods, 2
    return facts, lattices[0].periods, max(lattice.n_balls for lattice in lattices)


def _describe_value(dataset: Dataset, name: str, number: int) -> tuple[str, str]:
    """Return the kind of fact of a coordinate, and its value of this number in words."""
    value = dataset[name].values[number]
    value = value.item() if hasattr(value, "item") else value
    if name == "direction":
        return "direction", f"along {value}"
    kind, text = describe_parameter(name, value)
    if name in _LOADS:
        unit = str(dataset[name].attrs.get("units", ""))
        text = f"{name} {write_value(float(value), unit)}"
    return kind, text


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

    Media have colours, or of one medium the values of the first of several parameters; the
    combinations of the others are shades of them.

    Parameters
    ----------
    dataset : a data set made by :func:`granphon.sweep`.
    variable, x : names of variables or coordinates over load; ``x`` is by default the load of the
        sweep, a force, a pressure or an overlap; or a parameter in numbers, such as A.diameter,
        with a line for each load. At a single load ``x`` is by default the parameter in numbers
        with the most values.
    legend : whether to draw a legend; it names at most eight combinations, and gives the
        number of all.

    Axes are logarithmic where all values are above zero. Lines are solid where the medium is valid,
    thin and dashed elsewhere. Each line is thinner than the one before, so that all remain visible
    where they coincide. A simulation has points in place of a line, open where it is not valid;
    points of several samples are means, with bars of their standard errors. On an ordered path a
    line joins the points in the order of the path, and triangles mark the points that are reached
    by a fall of ``x``. Marks on the line of an automatic medium name the medium that served. The
    slow transverse wave in space has a dash-dotted line.

    Raises
    ------
    InputError : the sweep has no such variable, or the variable is not one number at each load, or
        is nowhere finite.
    """
    _, handles = _draw_sweep(dataset, ax, variable, x)
    if legend:
        ax.legend(handles=handles)
    return ax


def _draw_sweep(
    dataset: Dataset, ax: Axes, variable: str, x: str | None
) -> tuple[list[Curve], list[Line2D]]:
    """Draw the curves of :func:`plot_sweep`; return the curves and the entries of the legend."""
    if dataset.sizes["load"] == 1:
        x = x or _find_longest_parameter(dataset)
    dataset = turn_over(dataset, x)
    x = x or find_load(dataset)
    read_values(dataset, variable)
    coloured = _choose_coloured(dataset)
    lines = sorted(describe_lines(dataset, variable), key=lambda line: line[1].get(coloured, 0))
    curves = [read_curve(dataset, variable, x, index, facts=facts) for facts, index in lines]
    # curves of one colour follow each other
    n_shades = len(lines) // len({index.get(coloured, 0) for _, index in lines})
    groups = [curves[n : n + n_shades] for n in range(0, len(curves), n_shades)]
    shades = []
    for number in range(len(groups)):
        shades += _make_shades(COLOURS[number % len(COLOURS)], n_shades)
    dashes = _SLOW_DASHES if variable == _SLOW else None
    marker = _VELOCITY_MARKERS.get(variable, "o")
    widths = np.linspace(2.2, 1.0, len(lines) + 1)[1:]
    for curve, shade, width in zip(curves, shades, widths, strict=True):
        draw_curve(ax, curve, Look(shade, width, dashes, marker), variable)
    label_axes(ax, curves, x, variable)
    handles = list[Line2D]()
    has_colours = len(groups) > 1
    if has_colours or n_shades == 1:
        handles += _name_colours(groups, coloured)
    if n_shades > 1:
        handles += _name_shades(groups, "0.5" if has_colours else COLOURS[0])
    return curves, handles + _make_remarks(curves)


def _are_points(curves: Sequence[Curve]) -> bool:
    """Whether all curves are points in a legend: those of simulations, and not of an automatic
    medium.
    """
    return all(np.all(curve.simulated) and not curve.served for curve in curves)


def _name_colours(groups: Sequence[Sequence[Curve]], coloured: str) -> list[Line2D]:
    """Return the entries of a legend for the colours, one of each of the ``groups`` of curves,
    which differ in the dimension ``coloured``.
    """
    kinds = ["medium"]
    if coloured != "medium":
        kinds, _ = find_differing([group[0].facts for group in groups])
    handles = []
    for number, group in enumerate(groups):
        label = ", ".join(group[0].facts[kind] for kind in kinds)
        look = Look(COLOURS[number % len(COLOURS)], 1.5)
        handles.append(_make_handle(look, label, _are_points(group)))
    return handles


def _name_shades(groups: Sequence[Sequence[Curve]], colour: str) -> list[Line2D]:
    """Return the entries of a legend for the shades, the same in all ``groups`` of curves, as
    shades of one ``colour``; of many shades some are named.
    """
    curves = groups[0]
    are_points = all(_are_points(group) for group in groups)
    kinds, _ = find_differing([curve.facts for curve in curves])
    shades = _make_shades(colour, len(curves))
    chosen = pick_evenly(len(curves), _MOST_NAMED)
    handles = []
    for n in chosen:
        label = ", ".join(curves[n].facts[kind] for kind in kinds)
        handles.append(_make_handle(Look(shades[n], 1.5), label, are_points))
    if len(chosen) < len(curves):
        words = f"{len(chosen)} of {len(curves)} are named"
        handles.append(Line2D([], [], linestyle="none", label=words))
    return handles


def _find_longest_parameter(dataset: Dataset) -> str | None:
    """Return the parameter in numbers that has the most values; None if none has several."""
    sizes = {
        name: dataset.sizes[name]
        for name in list_parameters(dataset)
        if dataset[name].dtype.kind in "fiu" and dataset.sizes[name] > 1
    }
    return max(sizes, key=lambda name: sizes[name], default=None)


def _choose_coloured(dataset: Dataset) -> str:
    """Return the dimension whose values have colours: the medium, or of one medium the first of
    several parameters for whose values the colours suffice.
    """
    sizes = {name: dataset.sizes[name] for name in list_parameters(dataset)}
    sizes = {name: size for name, size in sizes.items() if size > 1}
    if dataset.sizes["medium"] > 1 or len(sizes) < 2:
        return "medium"
    return next((name for name, size in sizes.items() if size <= len(COLOURS)), "medium")


def _make_shades(name: str, count: int) -> list[Any]:
    """Return ``count`` shades of a colour, from darker to lighter than the colour; a single shade
    is the colour.
    """
    colour = np.array(to_rgb(name))
    change = np.linspace(-0.5, 0.6, count) if count > 1 else np.zeros(1)
    return [
        tuple(colour * (1.0 + min(t, 0.0)) + max(t, 0.0) * (1.0 - colour)) for t in change.tolist()
    ]


def plot_exponent(dataset: Dataset, ax: Axes, x: str | None = None) -> Axes:
    """Draw the local exponent d log v_L / d log P of a sweep, with that of the ideal lattice, 1/6,
    and the popular 1/4.

    The exponent of v_T is the same, except in a simulation. The points of a simulation of several
    samples have bars of their standard errors. ``x`` is that of :func:`plot_sweep`. See
    :func:`granphon.local_exponent`.
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
    """Write a text to the right of the Axes, at the ``value`` of y."""
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


def sweep_figure(dataset: Dataset, x: str | None = None, *, variable: str | None = None) -> Figure:
    """Draw a figure with velocities of a sweep above, their local exponent below, on one axis of
    ``x``; one column wide.

    ``x`` is that of :func:`plot_sweep`.

    Velocities that are zero, of waves across a chain, are left out. Without any other velocity, as
    for a mechanism, the normal stiffness is drawn; for motions without velocities the velocity of
    the peak, or the greatest force. For a sweep without exponents (finite overlap), or for one
    ``variable``, there is the upper panel only. Raises what :func:`plot_sweep` raises.
    """
    # a table of numbers that are not from a sweep has no "observe"
    observed = json.loads(dataset.attrs.get("observe", "[]"))
    if variable is None and "motion" in observed and "velocities" not in observed:
        variable = "peak_velocity" if "peak_velocity" in dataset else "greatest_force"
    has_exponent = variable is None and "exponent" in dataset
    velocities = []
    if not variable:
        velocities = [
            name for name in _VELOCITIES if name in dataset and np.any(dataset[name] != 0.0)
        ]
    shown = velocities or [variable or "normal_stiffness"]
    with styled_figure(4.0 if has_exponent else 2.6) as figure:
        ratios = [1.6, 1.0] if has_exponent else [1.0]
        axes = figure.subplots(len(ratios), sharex=True, squeeze=False, height_ratios=ratios)[:, 0]
        curves: dict[str, list[Curve]] = {}
        legends: dict[str, list[Line2D]] = {}
        for name in shown:
            curves[name], legends[name] = _draw_sweep(dataset, axes[0], name, x)
        if velocities:
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
        longest = max(shown, key=lambda name: len(legends[name]))
        handles = legends[longest] + _name_velocities(velocities, _are_points(curves[longest]))
        medium = curves[longest][0].facts["medium"]
        is_alone = dataset.sizes["medium"] == 1 and handles[0].get_label() != medium
        for handle in handles:
            handle.set_label(_break_label(str(handle.get_label())))
        add_legend(figure, handles, 4, _break_label(medium) if is_alone else None)
    return figure


def _name_velocities(velocities: Sequence[str], are_points: bool) -> list[Line2D]:
    """Return the entries of a legend for the dashes of the slow transverse wave, the marks of both
    transverse waves, and those of pulses, if they are among the drawn ``velocities``.
    """
    handles = []
    for name, marker in _VELOCITY_MARKERS.items():
        if name in velocities and (name == _PULSE or _SLOW in velocities):
            look = Look("0.3", 1.2, _SLOW_DASHES if name == _SLOW else None, marker)
            is_point = are_points or name == _PULSE
            handles.append(_make_handle(look, _VELOCITIES[name], is_point))
    return handles


def _break_label(label: str) -> str:
    """Return a label in lines for which a column has room."""
    return label if len(label) <= _LETTERS else join_facts([label], _LETTERS)


def _write_symbols(ax: Axes, curves: Mapping[str, Sequence[Curve]]) -> None:
    """Write the symbols of velocities beside the right ends of their ``curves``, in one text where
    the ends are close.

    Marks of pulses, which are often near long waves, are in the legend, and have no symbol.
    """
    ends: dict[str, float] = {}
    for name, group in curves.items():
        # a path may turn, and end anywhere
        velocities = [float(curve.y[np.argmax(curve.x)]) for curve in group]
        velocities = [velocity for velocity in velocities if np.isfinite(velocity)]
        if name != _PULSE and velocities:
            ends[_VELOCITIES[name]] = max(velocities)
    to_axes = ax.transData - ax.transAxes
    last_height = -np.inf
    symbols: dict[float, list[str]] = {}
    for symbol, velocity in sorted(ends.items(), key=lambda item: item[1]):
        height = float(to_axes.transform((ax.get_xlim()[0], velocity))[1])
        if height - last_height > _LEAST_HEIGHT:
            last_height = height
            symbols[velocity] = []
        symbols[max(symbols)].append(symbol)
    for velocity, names in symbols.items():
        _write_beside(ax, ", ".join(names), velocity)


# -- figures of several results --------------------------------------------------------------------


def plot_together(
    results: Sequence[Any] | Mapping[str, Any],
    ax: Axes,
    *,
    x: str | None = None,
    y: str | None = None,
    data: Any = (),
    balls_per_side: int | None = None,
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
    x : "force", "pressure", "overlap" or "reduced_force"; by default the load of the results if all
        have the same kind of load, else the force.
    y : a quantity of :data:`~granphon.observables.catalogue.CATALOGUE` that all results hold; by
        default the longitudinal velocity, or another velocity that all hold.
    data : measured velocities, one or several: files in the form of ``granphon fit``, or
        :class:`~granphon.fits.measurements.Measurements`.
    balls_per_side : number of balls at a side of the hexagonal frame, for files of data with side
        forces.
    legend : whether to draw the legend, and the title.

    A line is solid where its medium is valid, thin and dashed elsewhere; a simulation has points,
    with bars of standard errors over samples; measured points are black. States that differ in
    their load alone are one set of points.

    Raises
    ------
    InputError : the results cannot share an axis: one of them does not hold ``x`` or ``y``, the
        units differ, or some are bands and others are not; the error names the results. Data are
        no velocities, or their loads cannot be converted.
    """
    handles, common = _draw_together(results, ax, x, y, data, balls_per_side)
    if legend:
        ax.legend(handles=handles, handlelength=_find_length(handles))
        size = FontProperties(size=matplotlib.rcParams["font.size"]).get_size_in_points()
        figure: Any = ax.get_figure()
        points = 72.0 * figure.get_figwidth() * ax.get_position().width
        letters = int(points / (_WIDTH_OF_LETTER * size))
        ax.set_title(join_facts(common, max(20, letters)), fontsize=size)
    return ax


def _find_length(handles: Sequence[Line2D]) -> float | None:
    """Return the length of the handles of a legend, in letters: longer if dashes tell lines apart,
    None for the usual length.
    """
    is_dashed = any(handle.is_dashed() and handle.get_linewidth() > 0.9 for handle in handles)
    return 2.8 if is_dashed else None


def comparison_figure(
    results: Sequence[Any] | Mapping[str, Any], *, legend: bool = True, **options: Any
) -> Figure:
    """Draw :func:`plot_together`, whose ``options`` these are, as a figure, one column wide, with
    the legend below it.
    """
    with styled_figure(2.5) as figure:  # without legend and title, which make it higher
        handles, common = _draw_together(results, figure.subplots(), **options)
        if not legend:
            return figure
        title = join_facts(common, _LETTERS_OF_TITLE)
        lines = 1 + title.count("\n") if title else 0
        add_legend(figure, handles, -lines, handlelength=_find_length(handles))
        if title:
            figure.suptitle(title, fontsize=STYLE["axes.titlesize"])
    return figure


def _draw_together(
    results: Sequence[Any] | Mapping[str, Any],
    ax: Axes,
    x: str | None = None,
    y: str | None = None,
    data: Any = (),
    balls_per_side: int | None = None,
) -> _Drawn:
    """Draw the curves of :func:`plot_together`; return the data of the caption."""
    if isinstance(results, Mapping):
        runs = [Run.of(str(name), result, named=True) for name, result in results.items()]
    else:
        runs = [Run.of(f"result {n}", result) for n, result in enumerate(results, 1)]
    data_sets = [data] if isinstance(data, str | os.PathLike | Measurements) else list(data)
    if not runs:
        raise InputError("there is nothing to draw", mend="Give results")
    if x is None and y is None and not data_sets:
        all_bands = [run.bands for run in runs if run.bands is not None]
        if len(all_bands) == len(runs):
            return _draw_bands_together(runs, all_bands, ax)
        densities = [run.dos for run in runs if run.dos is not None]
        if len(densities) == len(runs):
            return _draw_densities_together(runs, densities, ax)
    if x:
        runs = [
            run if run.dataset is None else replace(run, dataset=turn_over(run.dataset, x.strip()))
            for run in runs
        ]
    across, along = choose_axes(runs, x, y)
    curves = list[Curve]()
    for run in runs:
        assert run.dataset is not None  # choose_axes raises for other runs
        if run.measured is not None:
            points = read_curve(run.measured, along, across, {"medium": 0}, run.name)
            curves.append(replace(points, measured=True))
        named = {"name": run.name} if run.named else {}
        for facts, index in describe_lines(run.dataset, along):
            curves.append(
                read_curve(run.dataset, along, across, index, run.name, named | facts | run.facts)
            )
    measured = [_read_points(points, runs, across, along, balls_per_side) for points in data_sets]
    _require_shared_axes(curves, across, along)
    return _draw_curves(ax, curves, measured, across, along)


def _draw_bands_together(runs: Sequence[Run], all_bands: Sequence[Bands], ax: Axes) -> _Drawn:
    """Draw the bands of each run over those of the others; InputError if their paths differ."""
    first = all_bands[0]
    for run, bands in zip(runs, all_bands, strict=True):
        has_labels = bands.labels == first.labels
        has_corners = bands.distances.shape[0] == first.distances.shape[0] and np.allclose(
            bands.distances[:, [0, -1]], first.distances[:, [0, -1]], rtol=0.0, atol=1e-6
        )
        if not (has_labels and has_corners):
            problem = (
                f"the bands of {runs[0].name} and {run.name} cannot share an axis: their"
                f" paths differ"
            )
            why = "The zones of the lattices have other sizes"
            if not has_labels:
                why = f"The one is {'-'.join(first.labels)}, the other {'-'.join(bands.labels)}"
            raise InputError(problem, why, "Compute them along one path")
    unit = HertzPrefix.for_top(max(float(bands.frequencies.max()) for bands in all_bands))
    lines = [
        list(zip(bands.distances, bands.connected_frequencies / unit.hertz, strict=True))
        for bands in all_bands
    ]
    drawn = _draw_spectra(runs, ax, "bands", lines)
    name_corners(ax, np.append(first.distances[:, 0], first.distances[-1, -1]), first.labels)
    ax.set(ylabel=f"Frequency ({print_hertz(unit)})", ylim=(0.0, None))
    return drawn


def _draw_densities_together(
    runs: Sequence[Run], densities: Sequence[DensityOfStates], ax: Axes
) -> _Drawn:
    """Draw the density of states of each run over those of the others."""
    unit = HertzPrefix.for_top(max(float(dos.frequencies.max()) for dos in densities))
    lines = [[(dos.frequencies / unit.hertz, dos.total * unit.hertz)] for dos in densities]
    drawn = _draw_spectra(runs, ax, "dos", lines)
    name = print_hertz(unit)
    ax.set(xlabel=f"Frequency ({name})", ylabel=f"DOS per ball (1/{name})")
    ax.set(xlim=(0.0, None), ylim=(0.0, None))
    return drawn


def _require_shared_axes(curves: Sequence[Curve], across: str, along: str) -> None:
    """Raise InputError for curves with several units, infinite loads, or no finite values."""
    for axis, name in enumerate((across, along)):
        units: dict[str, str] = {}
        for curve in curves:
            units.setdefault(curve.units[axis], curve.run)
        if len(units) > 1:
            reasons = [
                f"{run} has it {f'in {unit}' if unit else 'without a unit'}"
                for unit, run in units.items()
            ]
            problem = f"{' and '.join(units.values())} cannot share an axis of {name}"
            mend = "Take --x force (x='force')" if name == across else "Draw another quantity"
            raise InputError(problem, "; ".join(reasons), mend)
    for curve in curves:
        if not np.all(np.isfinite(curve.x)):
            why = "It is infinite for equal balls" if across == "reduced_force" else ""
            raise InputError(
                f"{across} of {curve.run} is not finite", why, "Take --x force (x='force')"
            )
        if not np.any(np.isfinite(curve.y)):
            raise InputError(
                f"{along} of {curve.run} has no finite value", mend="Draw another quantity"
            )


# -- the runs of a figure, and the quantities that they share --------------------------------------


@dataclass(frozen=True, eq=False)
class Run:
    """A run: a data set of states, which a fit has too; of one state also bands, a density of
    states or both.

    Attributes
    ----------
    name : name of the run in messages; where ``named``, also in legends, for all facts that the
        curves of the run share.
    dataset, bands, dos : the results of the run; None without such a result.
    measured : the data of a fit, at their loads.
    facts : facts of the curves of a fit besides those of its data set, in words by kind.
    """

    name: str
    dataset: Dataset | None = None
    bands: Bands | None = None
    dos: DensityOfStates | None = None
    named: bool = False
    measured: Dataset | None = None
    facts: dict[str, str] = field(default_factory=dict)

    @classmethod
    def of(cls, name: str, result: Any, named: bool = False) -> Run:
        """Return the run of a result of the library; :class:`~granphon.base.errors.InputError` for
        a result that shares no figure with others.
        """
        if isinstance(result, Run):
            return result
        if isinstance(result, WidthFit):
            return _tabulate_fit(name, result, named)
        if isinstance(result, Bands):
            return cls(name, bands=result, named=named)
        if isinstance(result, DensityOfStates):
            return cls(name, dos=result, named=named)
        dataset = find_dataset(result)
        if dataset is not None:
            bands = getattr(result, "bands", None)
            dos = getattr(result, "dos", None)
            return cls(name, dataset, bands, dos, named)
        mend = "Give sweeps, fits, bands, densities of states, or results of scenes"
        raise InputError(f"{brief(result)} shares no figure with others", mend=mend)

    @property
    def words(self) -> str:
        """The results of the run, in words."""
        spectra = (("bands", self.bands), ("a density of states", self.dos))
        held = [name for name, result in spectra if result is not None]
        if held or self.dataset is None:
            return " and ".join(held)
        if self.measured is not None:
            return "a fit"
        return "a sweep" if self.dataset["valid"].size > 1 else "a single state"

    @property
    def quantities(self) -> tuple[str, ...]:
        """Names of the quantities with one number at each load."""
        return () if self.dataset is None else list_quantities(self.dataset)


def _tabulate_fit(name: str, fit: WidthFit, named: bool) -> Run:
    """Return the run of a fit: its curve, and its data at their loads."""
    frequency = fit.waves.frequency
    branch = fit.waves.branch
    finite = fit.waves.finite_overlap
    # a fit of pulses that each have a frequency is known at the data alone
    at_data = np.ndim(frequency) > 0
    force = fit.force
    velocity = fit.velocities
    if not at_data:
        force = np.geomspace(fit.force.min(), fit.force.max(), _FORCES)
        velocity = fit.velocity_at(force)
    # measured velocities do not determine the overlap of a simulation
    choice = fit.choice.stand_in
    loads = [load for load in _LOADS[1:] if load != "overlap" or choice == fit.choice]

    def make(force: Array, points: bool, **velocities: Array) -> Dataset:
        state = choice.of(fit.packing).at_force(force, finite_overlap=finite)
        values = {load: np.asarray(getattr(state, load), float) for load in loads} | velocities
        attributes = {"finite_overlap": int(finite), "points": int(points)}
        return tabulate(fit.packing, fit.medium, force, values, attributes)

    facts = {"spread": f"fitted W = {write_width(fit)}"} if "width" in fit.parameters else {}
    if at_data:
        facts["waves"] = "pulses"
    elif frequency is not None:
        facts["waves"] = f"pulses of {write_value(float(frequency), 'Hz')}"
    measured = make(fit.force, True, **{branch: fit.velocity, f"{branch}_error": fit.sigma})
    curve = make(force, at_data, **{branch: velocity})
    return Run(name, curve, named=named, measured=measured, facts=facts)


def choose_axes(runs: Sequence[Run], x: str | None, y: str | None) -> tuple[str, str]:
    """Return the load and the quantity of the axes; ``x`` and ``y`` are the requested ones.

    Raises :class:`~granphon.base.errors.InputError` if there is no such load or quantity, or a run
    does not hold it.
    """
    spectra = [run for run in runs if not run.quantities]
    if spectra:
        problem = f"{_join_names(spectra, 'holds', 'hold')} {spectra[0].words} and no velocities"
        other_run = next((run for run in runs if run.quantities), None)
        why_apart = "There is nothing over a load"
        if other_run:
            why_apart = f"{other_run.name} is {other_run.words}: they cannot share an axis"
        raise InputError(problem, why_apart, "Draw them in figures of their own")
    common = [name for name in runs[0].quantities if all(name in run.quantities for run in runs)]
    load = _choose_load(runs, common, x)
    if y is None:
        return load, _choose_velocity(runs, common)
    name = y.strip().lower().replace(" ", "_")
    without = [run for run in runs if name not in run.quantities]
    if without:
        closest_name = closest(name, common)
        if name not in CATALOGUE and closest_name:
            raise InputError(f"there is no variable {y!r}", mend=f"Did you mean {closest_name}?")
        problem = f"{_join_names(without, 'holds', 'hold')} no {name}"
        why = f"All runs hold {', '.join(common)}" if common else "No quantity is in all runs"
        raise InputError(problem, why, "Draw another quantity, or leave these runs out")
    return load, name


def _choose_load(runs: Sequence[Run], common: Sequence[str], x: str | None) -> str:
    """Return the load ``x``, or a parameter in numbers, by default the load of all runs, else the
    force; InputError if a run does not hold ``x``.
    """
    if x is None:
        loads = {find_load(run.dataset) for run in runs if run.dataset is not None}
        return loads.pop() if len(loads) == 1 else "force"
    load = x.strip()
    is_parameter = all(run.dataset is not None and load in run.dataset.coords for run in runs)
    if not is_parameter:
        load = load.lower().replace(" ", "_")
    if load not in _LOADS and not is_parameter:
        dataset = runs[0].dataset
        names = [] if dataset is None else list_parameters(dataset)
        parameters = [
            name for name in names if dataset is not None and dataset[name].dtype.kind in "fiu"
        ]
        raise InputError(f"{x!r} is no load", mend=suggest(load, (*_LOADS, *parameters)))
    without = [run for run in runs if load not in run.quantities]
    if without:
        problem = f"{_join_names(without, 'has', 'have')} no {load}"
        shared = ", ".join(name for name in _LOADS if name in common) or "figures of their own"
        raise InputError(problem, "The runs cannot share that axis", f"Use {shared}")
    return load


def _choose_velocity(runs: Sequence[Run], common: Sequence[str]) -> str:
    """Return the first usual velocity among the ``common`` quantities of runs; InputError without
    any.
    """
    usual = ("longitudinal", "transverse", "transverse_fast", "transverse_slow", "bulk")
    velocity = next((name for name in usual if name in common), None)
    if velocity is not None:
        return velocity
    problem = f"{_join_names(runs)} cannot share an axis: no velocity is in all"
    if len(runs) == 1:
        problem = f"{runs[0].name} has no velocity"
    words = ", ".join(f"{run.name} {run.words}" for run in runs)
    quantities = [name for name in common if name not in _LOADS and not name.endswith("_error")]
    mend = "Draw each by itself"
    if quantities:
        first = quantities[0]
        mend = f"Name a quantity that all hold, as --y {first} (y={first!r})"
    raise InputError(problem, f"Found {words}", mend)


def _join_names(runs: Sequence[Run], verb: str = "", verb_of_several: str = "") -> str:
    """Return the names of runs, and a verb for a single run or for several."""
    names = " and ".join(", ".join(run.name for run in runs).rsplit(", ", 1))
    return f"{names} {verb if len(runs) == 1 else verb_of_several}".rstrip()


def _find_ratio(runs: Sequence[Run], x: str, mend: str = "Draw over the force") -> float:
    """Return the load ``x`` over the contact force; :class:`InputError` if the ratio is not one
    number for all runs.
    """
    if x == "force":
        return 1.0
    ratios = [np.zeros(0)]
    for run in runs:
        if run.dataset is not None and x in run.dataset and x != "overlap":
            ratios.append(np.ravel(run.dataset[x] / run.dataset["force"]))
    values = np.concatenate(ratios)
    is_known = values.size > 0 and np.all(np.isfinite(values))
    if not is_known or np.ptp(values) > 1e-9 * np.max(np.abs(values)):
        why = "It is not the same multiple of the contact force in all of them"
        why = "The overlap of balls was not measured" if x == "overlap" else why
        raise InputError(f"the {x} of measured points is not known from these runs", why, mend)
    return float(np.median(values))


def _read_points(points: Any, runs: Sequence[Run], x: str, y: str, balls: int | None) -> Curve:
    """Return the curve of measured velocities, from a file or
    :class:`~granphon.fits.measurements.Measurements`, over the load ``x``.
    """
    entry = CATALOGUE.get(y)
    if entry is None or entry.cost not in ("velocities", "pulse") or entry.unit != "m/s":
        raise InputError(
            f"measured velocities share no axis with {y}", mend="Take a velocity, as longitudinal"
        )
    name = "measured"
    if not isinstance(points, Measurements):
        name = Path(points).stem
        dataset = runs[0].dataset
        unit = ""
        if dataset is not None and "pressure" in dataset:
            unit = str(dataset["pressure"].attrs.get("units", ""))
        frame = None if balls is None else partial(force_of_frame, balls_per_side=balls)

        def press(pressure: float) -> float:
            return pressure / _find_ratio(runs, "pressure", "Give the contact forces in the file")

        periods = {"N": 1, "N/m": 2, "Pa": 3}.get(unit, 2)
        points = Measurements.read(points, frame=frame, pressed=press, periods=periods)
    facts = {"run": name}
    if points.frequency is not None:
        frequency = np.unique(points.frequency)
        facts["waves"] = "pulses"
        if frequency.size == 1:
            facts["waves"] = f"pulses of {write_value(float(frequency[0]), 'Hz')}"
    loads = _find_ratio(runs, x) * points.force
    sigma = np.nan if points.sigma is None else points.sigma
    errors = np.broadcast_to(np.asarray(sigma, float), loads.shape)
    everywhere = np.ones(loads.shape, bool)
    curve = Curve(
        name, facts, loads, points.velocity, errors, everywhere, everywhere, measured=True
    )
    return curve.sorted()


# -- curves ----------------------------------------------------------------------------------------


def _write_legend(curves: Sequence[Curve]) -> tuple[list[tuple[str, str]], list[str]]:
    """Return the heading and the label of each curve, and the facts that all curves share.

    The facts that the curves of a run share are their heading. A run of one curve stands under the
    heading of another run if the run shares its facts; most curves have an empty heading.
    """
    differing, common = find_differing([curve.facts for curve in curves])
    if len(curves) == 1:
        label = curves[0].facts.get("medium", curves[0].run)
        return [("", label)], [text for text in common if text != label]
    label_kinds = list[list[str]]()
    heading_kinds = list[list[str]]()
    for curve in curves:
        facts_of_run = [model.facts for model in curves if model.run == curve.run]
        kinds = [kind for kind in differing if kind in curve.facts]
        same = [kind for kind in kinds if len({facts.get(kind) for facts in facts_of_run}) == 1]
        if "name" in same:  # the name stands for all that is the same in the run
            kinds = [kind for kind in kinds if kind == "name" or kind not in same]
            same = ["name"]
        label_kinds.append(kinds)
        heading_kinds.append(same if len(facts_of_run) > 1 else [])
    labels = []
    for curve, kinds, headed in zip(curves, label_kinds, heading_kinds, strict=True):
        above = headed or _find_heading(curve, kinds, curves, heading_kinds)
        heading = join_facts([curve.facts[kind] for kind in above], _LETTERS)
        facts = [curve.facts[kind] for kind in kinds if kind not in above]
        label = join_facts(facts or [curve.run], _LETTERS)
        labels.append((f"{heading}:" if heading else "", label))
    return labels, common


def _find_heading(
    curve: Curve,
    kinds: Sequence[str],
    curves: Sequence[Curve],
    heading_kinds: Sequence[Sequence[str]],
) -> Sequence[str]:
    """Return the kinds of the heading of another run whose facts the ``curve`` with facts of these
    ``kinds`` shares; empty without such a run.
    """
    for headed, heading in zip(curves, heading_kinds, strict=True):
        is_part = heading and set(heading) < set(kinds)
        if is_part and all(headed.facts[kind] == curve.facts[kind] for kind in heading):
            return heading
    return []


def _draw_curves(ax: Axes, curves: list[Curve], measured: list[Curve], x: str, y: str) -> _Drawn:
    """Draw curves of runs and measured points; return the data of the caption."""
    models = _name_runs(_join_states([curve for curve in curves if not curve.measured]))
    points = [curve for curve in curves if curve.measured] + measured
    if len(models) > MOST_LOOKS:
        problem = f"{len(models)} curves are too many to be told apart"
        why = f"Colours and dashes tell {MOST_LOOKS} apart"
        raise InputError(problem, why, "Draw fewer runs in one figure")
    labels, common = _write_legend(models)
    # entries below a heading come last, so that no other entry stands below a heading
    groups: dict[str, list[Line2D]] = {"": []}
    for curve, look, (heading, label) in zip(models, make_looks(len(models)), labels, strict=True):
        draw_curve(ax, curve, look, y)
        is_points = curve.as_points and not curve.served
        groups.setdefault(heading, []).append(_make_handle(look, label, is_points))
    handles = groups.pop("")
    headed = list[Line2D]()
    for heading, group in groups.items():
        headed += [Line2D([], [], linestyle="none", label=heading), *group]
    for n, curve in enumerate(points):
        handles.append(_draw_measured(ax, curve, n, is_alone=len(points) == 1))
    handles += _make_remarks(models) + headed
    label_axes(ax, [*models, *points], x, y)
    return handles, common


def _draw_measured(ax: Axes, curve: Curve, number: int, is_alone: bool) -> Line2D:
    """Draw measured points, with bars of their errors if these are known, and return their entry in
    the legend; ``number`` chooses the mark.
    """
    words = ["data"]
    if not is_alone:
        words.append(curve.run)
    if "waves" in curve.facts:
        words.append(curve.facts["waves"])
    style: dict[str, Any] = {
        "marker": _DATA_MARKS[number % len(_DATA_MARKS)],
        "markersize": 2.6,
        "linestyle": "none",
        "color": "black",
    }
    error = None if np.all(np.isnan(curve.error)) else curve.error
    gid = f"measured-{number}"
    ax.errorbar(curve.x, curve.y, error, elinewidth=0.7, gid=gid, zorder=3.0, **style)
    return Line2D([], [], label=join_facts(words, _LETTERS), **style)


def _join_states(curves: Sequence[Curve]) -> list[Curve]:
    """Return curves, in which single states that differ in their load alone are one curve."""
    joined = list[Curve]()
    singles = set[int]()  # numbers of curves that are made of single states
    for curve in curves:
        is_single = curve.x.size == 1
        like = [
            n
            for n in sorted(singles)
            if joined[n].facts == curve.facts and joined[n].units == curve.units
        ]
        if is_single and like:
            joined[like[0]] = joined[like[0]].join(curve)
            continue
        if is_single:
            singles.add(len(joined))
        joined.append(curve)
    return joined


def _name_runs(curves: Sequence[Curve]) -> list[Curve]:
    """Return curves, in which curves with the same facts have the names of their runs too."""
    facts = [curve.facts for curve in curves]
    return [
        replace(curve, facts={"run": curve.run} | curve.facts)
        if facts.count(curve.facts) > 1
        else curve
        for curve in curves
    ]


# -- bands, and densities of states ----------------------------------------------------------------


def _draw_spectra(
    runs: Sequence[Run], ax: Axes, name: str, lines: Sequence[Sequence[tuple[Array, Array]]]
) -> _Drawn:
    """Draw the lines of each run, each in one look; their group ids begin with ``name``."""
    known_facts = [_describe_state(run) for run in runs]
    facts = []
    for run, facts_of_run in zip(runs, known_facts, strict=True):
        if not all(known_facts):
            # a run without facts does not differ from the others by its facts
            facts.append({"run": run.name})
        elif known_facts.count(facts_of_run) > 1:
            facts.append({"run": run.name} | facts_of_run)
        else:
            facts.append(facts_of_run)
    differing, common = find_differing(facts)
    labels = []
    for run, facts_of_run in zip(runs, facts, strict=True):
        words = [facts_of_run[kind] for kind in differing if kind in facts_of_run] or [run.name]
        if "name" in facts_of_run:
            words = [facts_of_run["name"]]
        labels.append(join_facts(words, _LETTERS))
    handles = []
    looks = make_looks(len(runs))
    for n, (lines_of_run, look, label) in enumerate(zip(lines, looks, labels, strict=True)):
        style: dict[str, Any] = {"color": look.colour, "linewidth": look.width}
        if look.dashes:
            style |= {"dashes": look.dashes}
        for x, y in lines_of_run:
            ax.plot(x, y, gid=f"{name}-{n}", **style)
        handles.append(Line2D([], [], label=label, **style))
    return handles, common if len(runs) > 1 else []


def _describe_state(run: Run) -> dict[str, str]:
    """Return the facts of a run of one state, in words by kind."""
    facts = {"name": run.name} if run.named else {}
    if run.dataset is None:
        return facts
    kind = find_load(run.dataset)
    load = run.dataset[kind]
    (facts_of_state, _), *_ = describe_lines(run.dataset, "force")
    value = write_value(float(load.values[0]), load.attrs.get("units", ""))
    return facts | facts_of_state | {"load": f"{kind} {value}"}
