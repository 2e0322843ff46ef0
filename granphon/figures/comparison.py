"""Figures of several results on one Axes: sweeps, states, fits and data over the load; bands; densities of states.

What all curves share stands in the title, and the legend says in words what each has of its own.
"""

from __future__ import annotations

import os
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

# before matplotlib, whose import this module guards
from granphon.figures.curves import (
    MOST_LOOKS,
    Curve,
    draw_curve,
    make_handle,
    make_looks,
    make_outside,
    make_serving,
)
from granphon.figures.scales import scale_axis

# isort: split
import matplotlib
import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.font_manager import FontProperties
from matplotlib.lines import Line2D

from granphon.base.errors import InputError, message
from granphon.base.scales import HertzPrefix
from granphon.base.text import closest
from granphon.figures.runs import LOADS_OF_AXES, Run
from granphon.figures.style import COLUMN_WIDTH, DPI, FRAME, STYLE, print_hertz
from granphon.figures.words import find_differing, join_facts, write_value
from granphon.figures.zones import print_label
from granphon.fits.measurements import Measurements
from granphon.observables.catalogue import CATALOGUE, axis_label

__all__ = ["comparison_figure", "plot_together"]

#: what is drawn if nothing is said: the first of these that all runs hold
_FIRST = ("longitudinal", "transverse", "transverse_fast", "transverse_slow", "bulk")
#: letters of a line of a legend, and of a title, in a column; letters of labels that stand two in a row
_LETTERS, _TITLE_LETTERS, _SHORT = 50, 60, 24
#: width of a letter over the size of the font; length of a handle in a legend that shows dashes, in letters
_LETTER, _LONG_HANDLE = 0.55, 2.8
#: height of a line of a legend or a title, in inches
_LINE_HEIGHT = 0.145
#: periods of a lattice by the unit of its pressure
_PERIODS = {"N": 1, "N/m": 2, "Pa": 3}
#: relative difference of loads in proportion that is rounding
_SAME = 1e-9
#: marks of measured points, which are black
_DATA_MARKS = ("o", "s", "^", "D", "v", "P")


@dataclass(frozen=True)
class _Drawn:
    """What the caption of a drawn Axes needs: entries of the legend, and what all curves share, in words."""

    handles: list[Line2D]
    common: list[str]


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
    drawn = _draw(_name_runs(results), ax, x, y, _read_list(data), balls_per_side)
    if legend:
        ax.legend(handles=drawn.handles, handlelength=_find_length(drawn.handles))
        size = FontProperties(size=matplotlib.rcParams["font.size"]).get_size_in_points()
        figure: Any = ax.get_figure()
        points = 72.0 * figure.get_figwidth() * ax.get_position().width
        ax.set_title(join_facts(drawn.common, max(20, int(points / (_LETTER * size)))), fontsize=size)
    return ax


def _find_length(handles: Sequence[Line2D]) -> float | None:
    """Return the length of the handles of a legend, in letters; longer if dashes tell lines apart, None for the usual."""
    return _LONG_HANDLE if any(handle.is_dashed() and handle.get_linewidth() > 0.9 for handle in handles) else None


def comparison_figure(results: Sequence[Any] | Mapping[str, Any], **options: Any) -> Figure:
    """Draw :func:`plot_together` as a figure, one column wide, with the legend below it; ``options`` are those of it."""
    options = {"x": None, "y": None, "data": (), "balls_per_side": None} | options
    with matplotlib.rc_context(STYLE):
        figure = Figure((COLUMN_WIDTH, 2.6), dpi=DPI, layout="constrained")
        drawn = _draw(
            _name_runs(results), figure.subplots(), options["x"], options["y"], _read_list(options["data"]),
            options["balls_per_side"],
        )  # fmt: skip
        labels = [str(handle.get_label()) for handle in drawn.handles]
        columns = 1 if max(map(len, labels), default=0) > _SHORT else min(2, len(labels))
        rows = sum(1 + label.count("\n") for label in labels) if columns == 1 else -(-len(labels) // 2)
        title = join_facts(drawn.common, _TITLE_LETTERS)
        lines = rows + (1 + title.count("\n") if title else 0)
        figure.set_size_inches(COLUMN_WIDTH, 2.5 + _LINE_HEIGHT * lines)
        if labels:
            length = _find_length(drawn.handles)
            figure.legend(handles=drawn.handles, loc="outside lower center", ncols=max(columns, 1), handlelength=length)
        if title:
            figure.suptitle(title, fontsize=STYLE["axes.titlesize"])
    return figure


def _name_runs(results: Sequence[Any] | Mapping[str, Any]) -> list[Run]:
    """Return the results as runs; those of a sequence are counted."""
    if isinstance(results, Mapping):
        return [Run.of(str(name), one, named=True) for name, one in results.items()]
    return [Run.of(f"result {n}", one) for n, one in enumerate(results, 1)]


def _read_list(given: Any) -> list[Any]:
    return [given] if isinstance(given, str | os.PathLike | Measurements) else list(given)


def _draw(runs: list[Run], ax: Axes, x: str | None, y: str | None, data: list[Any], balls: int | None) -> _Drawn:
    if not runs:
        raise InputError(message("there is nothing to draw", mend="Give results"))
    asked = x is not None or y is not None or bool(data)
    if not asked and all(run.bands is not None for run in runs):
        return _draw_bands(runs, ax)
    if not asked and all(run.dos is not None for run in runs):
        return _draw_dos(runs, ax)
    if spectra := [run for run in runs if not run.quantities]:
        others = [run for run in runs if run.quantities]
        what = f"{_list(spectra)} {'holds' if len(spectra) == 1 else 'hold'} {spectra[0].what} and no velocities"
        why = (
            f"{others[0].name} is {others[0].what}: they cannot share an axis" if others else "There is nothing over a load"
        )
        raise InputError(message(what, why, "Draw them in figures of their own"))
    across = _choose_load(runs, x)
    along = _choose_quantity(runs, y)
    curves = [curve for run in runs for curve in run.find_curves(across, along)]
    measured = [_read_points(one, runs, across, along, balls) for one in data]
    _require_one_axis(curves, across, along)
    return _draw_curves(ax, curves, measured, across, along)


def _list(runs: Sequence[Run]) -> str:
    """Return the names of runs in words."""
    return " and ".join(", ".join(run.name for run in runs).rsplit(", ", 1))


def _choose_load(runs: Sequence[Run], x: str | None) -> str:
    """Return the name of the load on the axis; :class:`InputError` if there is no such load, or a run does not have it."""
    if x is None:
        loads = {run.load for run in runs}
        return loads.pop() if len(loads) == 1 else "force"
    name = x.strip().lower().replace(" ", "_")
    if name not in LOADS_OF_AXES:
        meant = closest(name, LOADS_OF_AXES)
        raise InputError(
            message(f"{x!r} is no load", mend=f"Did you mean {meant}" if meant else "Use " + ", ".join(LOADS_OF_AXES))
        )
    if without := [run for run in runs if run.fit is None and name not in run.quantities]:
        held = [one for one in LOADS_OF_AXES if all(run.fit is not None or one in run.quantities for run in runs)]
        what = f"{_list(without)} {'has' if len(without) == 1 else 'have'} no {name}"
        raise InputError(
            message(what, "The runs cannot share that axis", "Use " + (", ".join(held) or "figures of their own"))
        )
    return name


def _choose_quantity(runs: Sequence[Run], y: str | None) -> str:
    """Return the name of the quantity that is drawn; :class:`InputError` if there is none such, or a run lacks it."""
    common = [one for one in runs[0].quantities if all(one in run.quantities for run in runs)]
    if y is None:
        if (first := next((name for name in _FIRST if name in common), None)) is not None:
            return first
        each = ", ".join(f"{run.name} {run.what}" for run in runs)
        other = next((name for name in common if name not in LOADS_OF_AXES and not name.endswith("_error")), None)
        mend = f"Name a quantity that all hold, as --y {other} (y={other!r})" if other else "Draw each by itself"
        what = (
            f"{_list(runs)} cannot share an axis: no velocity is in all"
            if len(runs) > 1
            else f"{runs[0].name} has no velocity"
        )
        raise InputError(message(what, f"Found {each}", mend))
    name = y.strip().lower().replace(" ", "_")
    if without := [run for run in runs if name not in run.quantities]:
        if name not in CATALOGUE and (meant := closest(name, common)):
            raise InputError(message(f"there is no variable {y!r}", mend=f"Did you mean {meant}"))
        what = f"{_list(without)} {'holds' if len(without) == 1 else 'hold'} no {name}"
        why = f"All runs hold {', '.join(common)}" if common else "No quantity is in all runs"
        raise InputError(message(what, why, "Draw another quantity, or leave these runs out"))
    return name


def _require_one_axis(curves: Sequence[Curve], x: str, y: str) -> None:
    """Raise :class:`InputError` if the units of the curves differ, or a load is infinite."""
    for which, name in enumerate((x, y)):
        runs: dict[str, str] = {}
        for curve in curves:
            runs.setdefault(curve.units[which], curve.run)
        if len(runs) > 1:
            told = "; ".join(f"{run} has it {f'in {unit}' if unit else 'without a unit'}" for unit, run in runs.items())
            what = f"{' and '.join(runs.values())} cannot share an axis of {name}"
            mend = "Take --x force (x='force')" if name == x else "Draw another quantity"
            raise InputError(message(what, told, mend))
    for curve in curves:
        if not np.all(np.isfinite(curve.x)):
            why = "It is infinite for equal balls" if x == "reduced_force" else ""
            raise InputError(message(f"{x} of {curve.run} is not finite", why, "Take --x force (x='force')"))
        if not np.any(np.isfinite(curve.y)):
            raise InputError(message(f"{y} of {curve.run} has no finite value", mend="Draw another quantity"))


# -- measured points ------------------------------------------------------------------------------------------------


def _find_ratio(runs: Sequence[Run], x: str) -> float:
    """Return the load ``x`` over the contact force; :class:`InputError` if it is not one number for all runs."""
    if x == "force":
        return 1.0
    ratios = np.concatenate([run.find_loads(x) for run in runs]) if x in ("pressure", "reduced_force") else np.zeros(0)
    if not ratios.size or not np.all(np.isfinite(ratios)) or np.ptp(ratios) > _SAME * np.max(np.abs(ratios)):
        why = "It is not the same multiple of the contact force in all of them"
        if x == "overlap":
            why = "The overlap of balls was not measured"
        raise InputError(message(f"the {x} of measured points is not known from these runs", why, "Draw over the force"))
    return float(np.median(ratios))


def _read_points(given: Any, runs: Sequence[Run], x: str, y: str, balls: int | None) -> Curve:
    """Return measured velocities, read from a file if need be, as a curve."""
    entry = CATALOGUE.get(y)
    if entry is None or entry.cost not in ("velocities", "pulse") or entry.unit != "m/s":
        raise InputError(message(f"measured velocities share no axis with {y}", mend="Take a velocity, as longitudinal"))
    name = "measured"
    if not isinstance(given, Measurements):
        from granphon.balls.loads import force_of_frame

        name = Path(given).stem
        units = (
            {curve.units[0] for run in runs for curve in run.find_curves("pressure", y)}
            if _all_have_pressure(runs)
            else set()
        )
        periods = _PERIODS.get(next(iter(units), "N/m"), 2)
        frame: Callable[[float], float] | None = None
        if balls is not None:
            frame = lambda force: force_of_frame(force, balls)  # noqa: E731
        given = Measurements.read(given, frame=frame, pressed=lambda p: p / _find_ratio(runs, "pressure"), periods=periods)
    ratio = _find_ratio(runs, x)
    sigma = np.nan if given.sigma is None else given.sigma
    facts = {"run": name}
    if given.frequency is not None:
        frequency = np.unique(given.frequency)
        facts["waves"] = f"pulses of {write_value(float(frequency[0]), 'Hz')}" if frequency.size == 1 else "pulses"
    return replace(Curve.of_points(name, facts, ratio * given.force, given.velocity, sigma), measured=True)


def _all_have_pressure(runs: Sequence[Run]) -> bool:
    return all(run.fit is not None or "pressure" in run.quantities for run in runs)


# -- curves ---------------------------------------------------------------------------------------------------------


def _join_points(curves: Sequence[Curve]) -> list[Curve]:
    """Return the curves with single states of the same facts joined; curves that are the same get the names of runs."""
    joined, single = list[Curve](), set[int]()
    for curve in curves:
        alike = [n for n, other in enumerate(joined) if other.facts == curve.facts and other.units == curve.units]
        alike = [n for n in alike if curve.x.size == 1 and n in single]
        if alike:
            other = joined[alike[0]]
            joined[alike[0]] = replace(other.merge(curve), run=f"{other.run}, {curve.run}")
        else:
            single |= {len(joined)} if curve.x.size == 1 else set()
            joined.append(curve)
    double = [curve for curve in joined if sum(other.facts == curve.facts for other in joined) > 1]
    return [replace(one, facts={"run": one.run} | one.facts) if one in double else one for one in joined]


def _write_legend(curves: Sequence[Curve]) -> tuple[list[tuple[str, str]], list[str]]:
    """Return for each curve a heading, empty for most, and its own label; and what all curves share.

    What the curves of one run share stands in a heading before them.
    """
    differing, common = find_differing([curve.facts for curve in curves])
    if len(curves) == 1:
        own = curves[0].facts.get("medium", curves[0].run)
        return [("", own)], [text for text in common if text != own]
    labels, told = [], set[str]()
    for curve in curves:
        alike = [one.facts for one in curves if one.run == curve.run]
        kinds = [kind for kind in differing if kind in curve.facts]
        same = [kind for kind in kinds if len({one.get(kind) for one in alike}) == 1]
        if "name" in same:  # it stands for all that is the same in the run
            kinds, same = [kind for kind in kinds if kind == "name" or kind not in same], ["name"]
        shared = same if len(alike) > 1 else []
        heading = join_facts([curve.facts[kind] for kind in shared], _LETTERS)
        label = join_facts([curve.facts[kind] for kind in kinds if kind not in shared] or [curve.run], _LETTERS)
        labels.append((f"{heading}:" if heading and curve.run not in told else "", label))
        told.add(curve.run)
    return labels, common


def _draw_curves(ax: Axes, found: list[Curve], measured: list[Curve], x: str, y: str) -> _Drawn:
    models = _join_points([curve for curve in found if not curve.measured])
    points = [curve for curve in found if curve.measured] + measured
    if len(models) > MOST_LOOKS:
        what = f"{len(models)} curves are too many to be told apart"
        raise InputError(message(what, f"Colours and dashes tell {MOST_LOOKS} apart", "Draw fewer runs in one figure"))
    labels, common = _write_legend(models)
    handles = []
    for curve, look, (heading, label) in zip(models, make_looks(len(models)), labels, strict=True):
        draw_curve(ax, curve, look, y)
        if heading:
            handles.append(Line2D([], [], linestyle="none", label=heading))
        handles.append(make_handle(curve, look, label))
    for n, curve in enumerate(points):
        told = ["data", *[curve.run] * (len(points) > 1), *([curve.facts["waves"]] if "waves" in curve.facts else [])]
        style: dict[str, Any] = {
            "fmt": _DATA_MARKS[n % len(_DATA_MARKS)],
            "color": "black",
            "markersize": 2.6,
            "zorder": 3.0,
        }
        error = None if np.all(np.isnan(curve.error)) else curve.error
        ax.errorbar(curve.x, curve.y, error, elinewidth=0.7, gid=f"measured-{n}", **style)
        plain: dict[str, Any] = {"marker": style["fmt"], "markersize": 2.6, "linestyle": "none"}
        handles.append(Line2D([], [], color="black", label=join_facts(told, _LETTERS), **plain))
    if not all(np.all(curve.valid) for curve in models):
        handles.append(make_outside(all(curve.as_points for curve in models)))
    handles += make_serving(models)
    every = [*models, *points]
    for which, values in (("x", [curve.x for curve in every]), ("y", [curve.y for curve in every])):
        scale_axis(ax, which, np.concatenate(values))
    ax.set(xlabel=axis_label(x, models[0].units[0]), ylabel=axis_label(y, models[0].units[1]))
    return _Drawn(handles, common)


# -- bands, and densities of states ---------------------------------------------------------------------------------


def _describe_spectra(runs: Sequence[Run]) -> tuple[list[str], list[str]]:
    """Return the label of each run of bands or densities, and what all share."""
    facts = []
    for run in runs:
        told = {"name": run.name} if run.named else {}
        if run.state is not None:
            load = run.state.load
            value = write_value(float(run.state.numbers[load]), run.state.units.get(load, ""))
            told |= run.state.facts | {"load": f"{load} {value}"}
        facts.append(told)
    facts = [
        {"run": run.name} | one if facts.count(one) > 1 or not one else one for run, one in zip(runs, facts, strict=True)
    ]
    differing, common = find_differing(facts)
    labels = [
        join_facts(
            [one["name"]] if "name" in one else [one[kind] for kind in differing if kind in one] or [run.name], _LETTERS
        )
        for run, one in zip(runs, facts, strict=True)
    ]
    return labels, common if len(runs) > 1 else []


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
    labels, common = _describe_spectra(runs)
    handles = []
    for n, (bands, look, label) in enumerate(zip(every, make_looks(len(runs)), labels, strict=True)):
        style: dict[str, Any] = {"color": look.colour, "linewidth": look.width} | (
            {"dashes": look.dashes} if look.dashes else {}
        )
        for s, along in enumerate(bands.distances):
            ax.plot(along, bands.connected_frequencies[s] / unit.hertz, gid=f"bands-{n}", **style)
        handles.append(Line2D([], [], label=label, **style))
    corners = np.append(first.distances[:, 0], first.distances[-1, -1])
    for corner in corners[1:-1]:
        ax.axvline(float(corner), color=FRAME, linewidth=0.5, zorder=0.5)
    ax.set_xticks(corners, [print_label(label) for label in first.labels])
    ax.tick_params(axis="x", length=0)
    ax.set(xlabel="Wave vector", ylabel=f"Frequency ({print_hertz(unit)})", xlim=corners[[0, -1]], ylim=(0.0, None))
    return _Drawn(handles, common)


def _draw_dos(runs: Sequence[Run], ax: Axes) -> _Drawn:
    """Draw densities of states one over the other, a colour for each run."""
    every = [run.dos for run in runs if run.dos is not None]
    unit = HertzPrefix.for_top(max(float(dos.frequencies.max()) for dos in every))
    labels, common = _describe_spectra(runs)
    handles = []
    for n, (dos, look, label) in enumerate(zip(every, make_looks(len(runs)), labels, strict=True)):
        style: dict[str, Any] = {"color": look.colour, "linewidth": look.width} | (
            {"dashes": look.dashes} if look.dashes else {}
        )
        ax.plot(dos.frequencies / unit.hertz, dos.total * unit.hertz, gid=f"dos-{n}", **style)
        handles.append(Line2D([], [], label=label, **style))
    name = print_hertz(unit)
    ax.set(xlabel=f"Frequency ({name})", ylabel=f"DOS per ball (1/{name})", xlim=(0.0, None), ylim=(0.0, None))
    return _Drawn(handles, common)
