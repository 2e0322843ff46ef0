"""Figures of several results on one Axes: sweeps, states, fits and data over the load; bands; densities of states.

What all curves share stands in the title, and the legend says in words what each has of its own.
"""

from __future__ import annotations

import os
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

from granphon.figures.scales import add_legend, styled_figure

import matplotlib
import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.font_manager import FontProperties
from matplotlib.lines import Line2D
from numpy.typing import NDArray

from granphon.balls.loads import force_of_frame
from granphon.base.errors import InputError, brief, message
from granphon.base.scales import HertzPrefix
from granphon.base.text import closest
from granphon.figures.curves import (
    MOST_LOOKS,
    Curve,
    describe_lines,
    draw_curve,
    find_load,
    label_axes,
    list_quantities,
    make_handle,
    make_looks,
    make_remarks,
    read_curve,
)
from granphon.figures.fits import write_width
from granphon.figures.style import STYLE, print_hertz
from granphon.figures.words import find_differing, join_facts, write_value
from granphon.figures.zones import name_corners
from granphon.fits.fit import WidthFit
from granphon.fits.measurements import Measurements
from granphon.observables.catalogue import CATALOGUE
from granphon.phonons.bands import Bands
from granphon.phonons.dos import DensityOfStates
from granphon.runs.dataset import find_dataset, tabulate

if TYPE_CHECKING:
    from granphon.runs.dataset import Dataset


Array = NDArray[np.float64]
#: letters of a line of a legend, and of a title, in a column
_LETTERS, _TITLE_LETTERS = 50, 60
#: width of a letter over the size of the font; length of a handle in a legend that shows dashes, in letters
_LETTER, _LONG_HANDLE = 0.55, 2.8
#: height of a figure without legend and title, in inches
_HEIGHT = 2.5
#: marks of measured points, which are black
_DATA_MARKS = ("o", "s", "^", "D", "v", "P")
#: what may be on the axis of loads
_LOADS = ("force", "pressure", "overlap", "reduced_force")
#: what is drawn if nothing is said: the first of these that all runs hold
_FIRST = ("longitudinal", "transverse", "transverse_fast", "transverse_slow", "bulk")
#: number of forces at which the line of a fit is drawn
_LINE = 200
#: periods of a lattice by the unit of its pressure
_PERIODS = {"N": 1, "N/m": 2, "Pa": 3}
#: relative difference of loads in proportion that is rounding
_SAME = 1e-9


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
    with styled_figure(_HEIGHT) as figure:
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
    curves = list[Curve]()
    for run in runs:
        assert run.dataset is not None  # choose_axes has seen that
        for name in (across, along):
            if not np.any(np.isfinite(run.dataset[name])):
                why = "It is infinite for equal balls" if name == "reduced_force" else ""
                raise InputError(message(f"{name} of {run.name} is nowhere finite", why, "Draw it over another load"))
        if run.measured is not None:
            curves.append(replace(read_curve(run.measured, along, across, {"medium": 0}, run.name), measured=True))
        named = {"name": run.name} if run.named else {}
        for facts, index in describe_lines(run.dataset, along):
            curves.append(read_curve(run.dataset, along, across, index, run.name, named | facts | run.facts))
    measured = [_read_points(one, runs, across, along, balls_per_side) for one in given]
    # what they cannot share: an axis of two units, a load that is infinite
    for which, name in enumerate((across, along)):
        units: dict[str, str] = {}
        for curve in curves:
            units.setdefault(curve.units[which], curve.run)
        if len(units) > 1:
            told = "; ".join(f"{run} has it {f'in {unit}' if unit else 'without a unit'}" for unit, run in units.items())
            what = f"{' and '.join(units.values())} cannot share an axis of {name}"
            mend = "Take --x force (x='force')" if name == across else "Draw another quantity"
            raise InputError(message(what, told, mend))
    for curve in curves:
        if not np.all(np.isfinite(curve.x)):
            why = "It is infinite for equal balls" if across == "reduced_force" else ""
            raise InputError(message(f"{across} of {curve.run} is not finite", why, "Take --x force (x='force')"))
        if not np.any(np.isfinite(curve.y)):
            raise InputError(message(f"{along} of {curve.run} has no finite value", mend="Draw another quantity"))
    return _draw_curves(ax, curves, measured, across, along)


# -- the runs of a figure: what each holds, and what they can share ---------------------------------------------------


@dataclass(frozen=True, eq=False)
class Run:
    """One run: a data set of states, of which a fit has one too; of one state also bands, a density of states or both.

    What it does not hold is None.

    Attributes
    ----------
    name : that in messages; where ``named``, it also stands in legends, for all that the curves of the run share.
    measured : the data of a fit, at whose loads they were measured.
    facts : what is said of the curves of a fit beside what its data set tells, in words by kind.
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
        """Take a result of the library; :class:`~granphon.base.errors.InputError` for what shares no figure with others."""
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
            bands, dos = (getattr(result, one, None) for one in ("bands", "dos"))
            return cls(name, dataset, bands, dos, named)
        mend = "Give sweeps, fits, bands, densities of states, or results of scenes"
        raise InputError(message(f"{brief(result)} shares no figure with others", mend=mend))

    @property
    def what(self) -> str:
        """What the run holds, in words."""
        held = [name for name, one in (("bands", self.bands), ("a density of states", self.dos)) if one is not None]
        if not held and self.dataset is not None:
            single = "a sweep" if self.dataset["valid"].size > 1 else "a single state"
            return single if self.measured is None else "a fit"
        return " and ".join(held)

    @property
    def quantities(self) -> tuple[str, ...]:
        """Names of the quantities that are one number at each load."""
        return () if self.dataset is None else list_quantities(self.dataset)


def _tabulate_fit(name: str, fit: WidthFit, named: bool) -> Run:
    """Return the measured velocities of a fit, and its line over the force, as data sets of states."""
    frequency, branch, finite = fit.waves.frequency, fit.waves.branch, fit.waves.finite_overlap
    several = np.ndim(frequency) > 0  # a fit of pulses that each have a frequency is known at the data alone
    force = fit.force if several else np.geomspace(fit.force.min(), fit.force.max(), _LINE)
    # the overlap of a simulation follows from nothing that was measured
    choice = fit.choice.stand_in
    loads = [load for load in _LOADS[1:] if load != "overlap" or choice == fit.choice]

    def make(force: Array, velocity: Array, points: bool, **more: Array) -> Dataset:
        state = choice.of(fit.packing).at_force(force, finite_overlap=finite)
        values = {load: np.asarray(getattr(state, load), float) for load in loads} | {branch: velocity} | more
        attributes = {"finite_overlap": int(finite), "points": int(points)}
        return tabulate(fit.packing, fit.medium, force, values, attributes)

    velocity = fit.velocities if several else fit.velocity_at(force)
    facts = {"spread": f"fitted W = {write_width(fit)}"} if "width" in fit.parameters else {}
    if frequency is not None:
        facts["waves"] = "pulses" if several else f"pulses of {write_value(float(frequency), 'Hz')}"
    measured = make(fit.force, fit.velocity, True, **{f"{branch}_error": fit.sigma})
    return Run(name, make(force, velocity, several), named=named, measured=measured, facts=facts)


def choose_axes(runs: Sequence[Run], x: str | None, y: str | None) -> tuple[str, str]:
    """Return the load and the quantity that are drawn; ``x`` and ``y`` are what is asked for.

    Raises :class:`~granphon.base.errors.InputError` if there is no such load or quantity, or a run does not hold it.
    """
    if spectra := [run for run in runs if not run.quantities]:
        other = next((run for run in runs if run.quantities), None)
        what = f"{_list(spectra)} {'holds' if len(spectra) == 1 else 'hold'} {spectra[0].what} and no velocities"
        why = f"{other.name} is {other.what}: they cannot share an axis" if other else "There is nothing over a load"
        raise InputError(message(what, why, "Draw them in figures of their own"))
    common = [one for one in runs[0].quantities if all(one in run.quantities for run in runs)]
    if x is None:
        loads = {find_load(run.dataset) for run in runs if run.dataset is not None}
        load = loads.pop() if len(loads) == 1 else "force"
    else:
        load = x.strip().lower().replace(" ", "_")
        if load not in _LOADS:
            meant = closest(load, _LOADS)
            mend = f"Did you mean {meant}" if meant else "Use " + ", ".join(_LOADS)
            raise InputError(message(f"{x!r} is no load", mend=mend))
        if without := [run for run in runs if load not in run.quantities]:
            what = f"{_list(without)} {'has' if len(without) == 1 else 'have'} no {load}"
            held = ", ".join(one for one in _LOADS if one in common) or "figures of their own"
            raise InputError(message(what, "The runs cannot share that axis", f"Use {held}"))
    if y is None:
        if (first := next((name for name in _FIRST if name in common), None)) is not None:
            return load, first
        each = ", ".join(f"{run.name} {run.what}" for run in runs)
        first = next((one for one in common if one not in _LOADS and not one.endswith("_error")), None)
        mend = f"Name a quantity that all hold, as --y {first} (y={first!r})" if first else "Draw each by itself"
        what = f"{_list(runs)} cannot share an axis: no velocity is in all"
        what = what if len(runs) > 1 else f"{runs[0].name} has no velocity"
        raise InputError(message(what, f"Found {each}", mend))
    name = y.strip().lower().replace(" ", "_")
    if without := [run for run in runs if name not in run.quantities]:
        if name not in CATALOGUE and (meant := closest(name, common)):
            raise InputError(message(f"there is no variable {y!r}", mend=f"Did you mean {meant}"))
        what = f"{_list(without)} {'holds' if len(without) == 1 else 'hold'} no {name}"
        why = f"All runs hold {', '.join(common)}" if common else "No quantity is in all runs"
        raise InputError(message(what, why, "Draw another quantity, or leave these runs out"))
    return load, name


def _list(runs: Sequence[Run]) -> str:
    """Return the names of runs in words."""
    return " and ".join(", ".join(run.name for run in runs).rsplit(", ", 1))


def _find_ratio(runs: Sequence[Run], x: str, mend: str = "Draw over the force") -> float:
    """Return the load ``x`` over the contact force; :class:`InputError` if it is not one number for all runs."""
    if x == "force":
        return 1.0
    found = [run.dataset for run in runs if run.dataset is not None and x in run.dataset and x != "overlap"]
    ratios = np.concatenate([np.zeros(0), *(np.ravel(dataset[x] / dataset["force"]) for dataset in found)])
    if not ratios.size or not np.all(np.isfinite(ratios)) or np.ptp(ratios) > _SAME * np.max(np.abs(ratios)):
        why = "It is not the same multiple of the contact force in all of them"
        why = "The overlap of balls was not measured" if x == "overlap" else why
        raise InputError(message(f"the {x} of measured points is not known from these runs", why, mend))
    return float(np.median(ratios))


def _read_points(given: Any, runs: Sequence[Run], x: str, y: str, balls: int | None) -> Curve:
    """Return measured velocities, read from a file if need be, as a curve."""
    entry = CATALOGUE.get(y)
    if entry is None or entry.cost not in ("velocities", "pulse") or entry.unit != "m/s":
        raise InputError(message(f"measured velocities share no axis with {y}", mend="Take a velocity, as longitudinal"))
    name = "measured"
    if not isinstance(given, Measurements):
        name, first = Path(given).stem, runs[0].dataset
        unit = "" if first is None or "pressure" not in first else str(first["pressure"].attrs.get("units", ""))
        frame = None if balls is None else partial(force_of_frame, balls_per_side=balls)

        def press(pressure: float) -> float:
            return pressure / _find_ratio(runs, "pressure", "Give the contact forces in the file")

        given = Measurements.read(given, frame=frame, pressed=press, periods=_PERIODS.get(unit, 2))
    sigma = np.nan if given.sigma is None else given.sigma
    facts = {"run": name}
    if given.frequency is not None:
        frequency = np.unique(given.frequency)
        facts["waves"] = f"pulses of {write_value(float(frequency[0]), 'Hz')}" if frequency.size == 1 else "pulses"
    across = _find_ratio(runs, x) * given.force
    spread, every = np.broadcast_to(np.asarray(sigma, float), across.shape), np.ones(across.shape, bool)
    return Curve(name, facts, across, given.velocity, spread, every, every, measured=True).sorted()


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
        groups.setdefault(heading, []).append(make_handle(look, label, curve.as_points and not curve.served))
    handles = groups.pop("")
    headed = [one for text, group in groups.items() for one in (Line2D([], [], linestyle="none", label=text), *group)]
    for n, curve in enumerate(points):
        told = ["data", *[curve.run] * (len(points) > 1), *([curve.facts["waves"]] if "waves" in curve.facts else [])]
        style: dict[str, Any] = {"marker": _DATA_MARKS[n % len(_DATA_MARKS)], "markersize": 2.6, "linestyle": "none"}
        style |= {"color": "black"}
        error = None if np.all(np.isnan(curve.error)) else curve.error
        ax.errorbar(curve.x, curve.y, error, elinewidth=0.7, gid=f"measured-{n}", zorder=3.0, **style)
        handles.append(Line2D([], [], label=join_facts(told, _LETTERS), **style))
    handles += make_remarks(models) + headed
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
