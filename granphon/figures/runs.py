"""The runs of a figure of several: what each holds, and what they can share: a load, a quantity, and measured points."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field, replace
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from granphon.balls.loads import force_of_frame
from granphon.base.errors import InputError, brief, message
from granphon.base.text import closest
from granphon.figures.curves import Curve, describe_lines, find_load, list_parameters, read_curve
from granphon.figures.fits import write_width
from granphon.figures.words import write_value
from granphon.fits.fit import WidthFit
from granphon.fits.measurements import Measurements
from granphon.observables.catalogue import CATALOGUE
from granphon.phonons.bands import Bands
from granphon.phonons.dos import DensityOfStates
from granphon.runs.dataset import find_dataset, tabulate

if TYPE_CHECKING:
    from granphon.runs.dataset import Dataset


Array = NDArray[np.float64]
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
        if self.dataset is None:
            return ()
        dims = {"load", "medium", *list_parameters(self.dataset)}
        return tuple(
            str(name)
            for name, values in self.dataset.variables.items()
            if "load" in values.dims and set(values.dims) <= dims and values.dtype.kind in "fiu"
        )

    def find_curves(self, x: str, y: str) -> Iterable[Curve]:
        """Yield the curves of a quantity ``y`` over the load ``x``, both of which the run holds; those of data first."""
        dataset, name = self.dataset, {"name": self.name} if self.named else {}
        if dataset is None:
            return
        for one in (x, y):
            if not np.any(np.isfinite(dataset[one])):
                why = "It is infinite for equal balls" if one == "reduced_force" else ""
                raise InputError(message(f"{one} of {self.name} is nowhere finite", why, "Draw it over another load"))
        if self.measured is not None:
            yield replace(read_curve(self.measured, y, x, {"medium": 0}, self.name), measured=True)
        for facts, index in describe_lines(dataset, y):
            yield read_curve(dataset, y, x, index, self.name, name | facts | self.facts)


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


def require_one_axis(curves: Sequence[Curve], x: str, y: str) -> None:
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


def read_points(given: Any, runs: Sequence[Run], x: str, y: str, balls: int | None) -> Curve:
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
