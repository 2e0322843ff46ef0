"""Figures of several results on one Axes: sweeps, states, fits and data over the load; bands; densities of states.

What all curves share stands in the title, and the legend says in words what each has of its own.
"""

from __future__ import annotations

import os
from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Any

from granphon.figures.scales import add_legend

import matplotlib
import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.font_manager import FontProperties
from matplotlib.lines import Line2D
from numpy.typing import NDArray

from granphon.base.errors import InputError, message
from granphon.base.scales import HertzPrefix
from granphon.figures.curves import (
    MOST_LOOKS,
    POINTS,
    Curve,
    describe_lines,
    draw_curve,
    find_load,
    label_axes,
    make_looks,
    make_outside,
    make_serving,
)
from granphon.figures.runs import Run, choose_axes, read_points, require_one_axis
from granphon.figures.style import COLUMN_WIDTH, DPI, STYLE, print_hertz
from granphon.figures.words import find_differing, join_facts, write_value
from granphon.figures.zones import name_corners
from granphon.fits.measurements import Measurements

Array = NDArray[np.float64]
#: letters of a line of a legend, and of a title, in a column
_LETTERS, _TITLE_LETTERS = 50, 60
#: width of a letter over the size of the font; length of a handle in a legend that shows dashes, in letters
_LETTER, _LONG_HANDLE = 0.55, 2.8
#: height of a figure without legend and title, in inches
_HEIGHT = 2.5
#: marks of measured points, which are black
_DATA_MARKS = ("o", "s", "^", "D", "v", "P")


#: what the caption of a drawn Axes needs: entries of the legend, and what all curves share, in words
_Drawn = tuple[list[Line2D], list[str]]


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

    Sweeps, states and fits are curves and points of ``y`` over ``x``. If all results have bands and neither ``x`` nor ``y``
    nor data are given, their bands are drawn one over the other; so are densities of states.

    Parameters
    ----------
    results : sweeps, fits, bands, densities of states, results of scenes. The names of a mapping stand in the legend for
        all that the curves of a result share.
    x : "force", "pressure", "overlap" or "reduced_force"; by default the load that was given if it is that of all, else the
        force.
    y : a quantity of :data:`~granphon.observables.catalogue.CATALOGUE` that all results hold; by default the longitudinal
        velocity, or another one that all hold.
    data : measured velocities, one or several: files in the form of ``granphon fit``, or
        :class:`~granphon.fits.measurements.Measurements`.
    balls_per_side : that of the hexagonal frame, where a file of data gives side forces.
    legend : whether to draw the legend, and the title.

    A line is solid where its medium is valid, thin and dashed elsewhere; a simulation has points, with bars of standard
    errors over samples; measured points are black. States that differ in their load alone are one set of points.

    Raises
    ------
    InputError : the results cannot share an axis: one of them does not hold ``x`` or ``y``, the units differ, or some are
        bands and others are not; the error names them. Data that are no velocities, or whose loads cannot be converted.
    """
    handles, common = _draw(results, ax, x, y, data, balls_per_side)
    if legend:
        ax.legend(handles=handles, handlelength=_find_length(handles))
        size = FontProperties(size=matplotlib.rcParams["font.size"]).get_size_in_points()
        figure: Any = ax.get_figure()
        points = 72.0 * figure.get_figwidth() * ax.get_position().width
        ax.set_title(join_facts(common, max(20, int(points / (_LETTER * size)))), fontsize=size)
    return ax


def _find_length(handles: Sequence[Line2D]) -> float | None:
    """Return the length of the handles of a legend, in letters; longer if dashes tell lines apart, None for the usual."""
    return _LONG_HANDLE if any(handle.is_dashed() and handle.get_linewidth() > 0.9 for handle in handles) else None


def comparison_figure(results: Sequence[Any] | Mapping[str, Any], *, legend: bool = True, **options: Any) -> Figure:
    """Draw :func:`plot_together`, whose ``options`` these are, as a figure, one column wide, with the legend below it."""
    with matplotlib.rc_context(STYLE):
        figure = Figure((COLUMN_WIDTH, _HEIGHT), dpi=DPI, layout="constrained")
        handles, common = _draw(results, figure.subplots(), **options)
        if not legend:
            return figure
        title = join_facts(common, _TITLE_LETTERS)
        lines = 1 + title.count("\n") if title else 0
        add_legend(figure, handles, -lines, handlelength=_find_length(handles))
        if title:
            figure.suptitle(title, fontsize=STYLE["axes.titlesize"])
    return figure


def _draw(
    results: Sequence[Any] | Mapping[str, Any], ax: Axes, x: str | None = None, y: str | None = None, data: Any = (),
    balls_per_side: int | None = None,
) -> _Drawn:  # fmt: skip
    """Draw what :func:`plot_together` draws, without legend and title."""
    if isinstance(results, Mapping):
        runs = [Run.of(str(name), one, named=True) for name, one in results.items()]
    else:
        runs = [Run.of(f"result {n}", one) for n, one in enumerate(results, 1)]
    given = [data] if isinstance(data, str | os.PathLike | Measurements) else list(data)
    if not runs:
        raise InputError(message("there is nothing to draw", mend="Give results"))
    asked = x is not None or y is not None or bool(given)
    if not asked and all(run.bands is not None for run in runs):
        return _draw_bands(runs, ax)
    if not asked and (dos := [run.dos for run in runs if run.dos is not None]) and len(dos) == len(runs):
        unit = HertzPrefix.for_top(max(float(one.frequencies.max()) for one in dos))
        drawn = _draw_spectra(runs, ax, "dos", [[(one.frequencies / unit.hertz, one.total * unit.hertz)] for one in dos])
        name = print_hertz(unit)
        ax.set(xlabel=f"Frequency ({name})", ylabel=f"DOS per ball (1/{name})", xlim=(0.0, None), ylim=(0.0, None))
        return drawn
    across, along = choose_axes(runs, x, y)
    curves = [curve for run in runs for curve in run.find_curves(across, along)]
    measured = [read_points(one, runs, across, along, balls_per_side) for one in given]
    require_one_axis(curves, across, along)
    return _draw_curves(ax, curves, measured, across, along)


# -- curves ---------------------------------------------------------------------------------------------------------


def _write_legend(curves: Sequence[Curve]) -> tuple[list[tuple[str, str]], list[str]]:
    """Return for each curve the heading that it stands under, empty for most, and its own label; and what all curves share.

    What the curves of one run share is their heading. A run of one curve stands under that of another run if it shares it.
    """
    differing, common = find_differing([curve.facts for curve in curves])
    if len(curves) == 1:
        own = curves[0].facts.get("medium", curves[0].run)
        return [("", own)], [text for text in common if text != own]
    own_kinds, shared_kinds = list[list[str]](), list[list[str]]()
    for curve in curves:
        alike = [one.facts for one in curves if one.run == curve.run]
        kinds = [kind for kind in differing if kind in curve.facts]
        same = [kind for kind in kinds if len({one.get(kind) for one in alike}) == 1]
        if "name" in same:  # it stands for all that is the same in the run
            kinds, same = [kind for kind in kinds if kind == "name" or kind not in same], ["name"]
        own_kinds.append(kinds)
        shared_kinds.append(same if len(alike) > 1 else [])
    labels = []
    for curve, kinds, shared in zip(curves, own_kinds, shared_kinds, strict=True):
        others = (
            other for one, other in zip(curves, shared_kinds, strict=True)
            if other and set(other) < set(kinds) and all(one.facts[kind] == curve.facts[kind] for kind in other)
        )  # fmt: skip
        above = shared or next(others, [])
        heading = join_facts([curve.facts[kind] for kind in above], _LETTERS)
        label = join_facts([curve.facts[kind] for kind in kinds if kind not in above] or [curve.run], _LETTERS)
        labels.append((f"{heading}:" if heading else "", label))
    return labels, common


def _draw_curves(ax: Axes, found: list[Curve], measured: list[Curve], x: str, y: str) -> _Drawn:
    """Draw curves, those that are measured as points; single states of the same facts are one curve of points."""
    models, single = list[Curve](), set[int]()
    for curve in (one for one in found if not one.measured):
        alike = [n for n, other in enumerate(models) if other.facts == curve.facts and other.units == curve.units]
        alike = [n for n in alike if curve.x.size == 1 and n in single]
        if alike:
            other = models[alike[0]]
            parts: dict[str, Any] = {
                name: np.concatenate([getattr(other, name), getattr(curve, name)])
                for name in ("x", "y", "error", "valid", "simulated")
            }
            names, served = f"{other.run}, {curve.run}", other.served + curve.served
            models[alike[0]] = replace(other, run=names, served=served, **parts).sorted()
        else:
            single |= {len(models)} if curve.x.size == 1 else set()
            models.append(curve)
    # curves that are the same get the names of their runs
    double = [curve for curve in models if sum(other.facts == curve.facts for other in models) > 1]
    models = [replace(one, facts={"run": one.run} | one.facts) if one in double else one for one in models]
    points = [curve for curve in found if curve.measured] + measured
    if len(models) > MOST_LOOKS:
        what = f"{len(models)} curves are too many to be told apart"
        raise InputError(message(what, f"Colours and dashes tell {MOST_LOOKS} apart", "Draw fewer runs in one figure"))
    labels, common = _write_legend(models)
    # entries below a heading come last, so that none that does not belong there stands there
    groups: dict[str, list[Line2D]] = {"": []}
    for curve, look, (heading, label) in zip(models, make_looks(len(models)), labels, strict=True):
        draw_curve(ax, curve, look, y)
        line: dict[str, Any] = {"linewidth": min(look.width, 1.6)} | ({"dashes": look.dashes} if look.dashes else {})
        shown = {"marker": look.marker} | POINTS if curve.as_points and not curve.served else line
        groups.setdefault(heading, []).append(Line2D([], [], color=look.colour, label=label, **shown))
    handles = groups.pop("")
    headed = [one for text, group in groups.items() for one in (Line2D([], [], linestyle="none", label=text), *group)]
    for n, curve in enumerate(points):
        told = ["data", *[curve.run] * (len(points) > 1), *([curve.facts["waves"]] if "waves" in curve.facts else [])]
        style: dict[str, Any] = {"marker": _DATA_MARKS[n % len(_DATA_MARKS)], "markersize": 2.6, "linestyle": "none"}
        style |= {"color": "black"}
        error = None if np.all(np.isnan(curve.error)) else curve.error
        ax.errorbar(curve.x, curve.y, error, elinewidth=0.7, gid=f"measured-{n}", zorder=3.0, **style)
        handles.append(Line2D([], [], label=join_facts(told, _LETTERS), **style))
    if not all(np.all(curve.valid) for curve in models):
        handles.append(make_outside(all(curve.as_points for curve in models)))
    handles += make_serving(models) + headed
    label_axes(ax, [*models, *points], x, y)
    return handles, common


# -- bands, and densities of states ---------------------------------------------------------------------------------


def _draw_spectra(runs: Sequence[Run], ax: Axes, name: str, lines: Sequence[Sequence[tuple[Array, Array]]]) -> _Drawn:
    """Draw the lines of each run, each in one look; their group ids begin with ``name``."""
    facts = []
    for run in runs:
        told = {"name": run.name} if run.named else {}
        if run.dataset is not None:
            kind = find_load(run.dataset)
            load = run.dataset[kind]
            (facts_of_state, _), *_ = describe_lines(run.dataset, "force")
            value = write_value(float(load.values[0]), load.attrs.get("units", ""))
            told |= facts_of_state | {"load": f"{kind} {value}"}
        facts.append(told)
    known = all(facts)  # what one run does not tell of itself is no difference between it and the others
    facts = [
        one if known and facts.count(one) == 1 else {"run": run.name} | (one if known else {})
        for run, one in zip(runs, facts, strict=True)
    ]
    differing, common = find_differing(facts)
    labels = [
        join_facts([one["name"]] if "name" in one else [one[k] for k in differing if k in one] or [run.name], _LETTERS)
        for run, one in zip(runs, facts, strict=True)
    ]
    handles = []
    for n, (parts, look, label) in enumerate(zip(lines, make_looks(len(runs)), labels, strict=True)):
        dashes: dict[str, Any] = {"dashes": look.dashes} if look.dashes else {}
        for x, y in parts:
            ax.plot(x, y, gid=f"{name}-{n}", color=look.colour, linewidth=look.width, **dashes)
        handles.append(Line2D([], [], label=label, color=look.colour, linewidth=look.width, **dashes))
    return handles, common if len(runs) > 1 else []


def _draw_bands(runs: Sequence[Run], ax: Axes) -> _Drawn:
    """Draw bands one over the other, a colour for each run; :class:`InputError` if their paths differ."""
    every = [run.bands for run in runs if run.bands is not None]
    first = every[0]
    for run, bands in zip(runs, every, strict=True):
        same = bands.labels == first.labels and bands.distances.shape[0] == first.distances.shape[0]
        if not same or not np.allclose(bands.distances[:, [0, -1]], first.distances[:, [0, -1]], rtol=0.0, atol=1e-6):
            paths = f"The one is {'-'.join(first.labels)}, the other {'-'.join(bands.labels)}"
            what = f"the bands of {runs[0].name} and {run.name} cannot share an axis: their paths differ"
            why = paths if bands.labels != first.labels else "The zones of the lattices have other sizes"
            raise InputError(message(what, why, "Compute them along one path"))
    unit = HertzPrefix.for_top(max(float(bands.frequencies.max()) for bands in every))
    lines = [list(zip(one.distances, one.connected_frequencies / unit.hertz, strict=True)) for one in every]
    drawn = _draw_spectra(runs, ax, "bands", lines)
    name_corners(ax, np.append(first.distances[:, 0], first.distances[-1, -1]), first.labels)
    ax.set(ylabel=f"Frequency ({print_hertz(unit)})", ylim=(0.0, None))
    return drawn
