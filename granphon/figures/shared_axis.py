"""What several runs share: the load and the quantity on the axes of their figure, and measured points between them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any

# before matplotlib, whose import this module guards
from granphon.figures.curves import Curve

# isort: split
import numpy as np

from granphon.balls.loads import force_of_frame
from granphon.base.errors import InputError, message
from granphon.base.text import closest
from granphon.figures.runs import LOADS_OF_AXES, Run
from granphon.figures.words import write_value
from granphon.fits.measurements import Measurements
from granphon.observables.catalogue import CATALOGUE

#: what is drawn if nothing is said: the first of these that all runs hold
_FIRST = ("longitudinal", "transverse", "transverse_fast", "transverse_slow", "bulk")
#: periods of a lattice by the unit of its pressure
_PERIODS = {"N": 1, "N/m": 2, "Pa": 3}
#: relative difference of loads in proportion that is rounding
_SAME = 1e-9


def choose_axes(runs: Sequence[Run], x: str | None, y: str | None) -> tuple[str, str]:
    """Return the load and the quantity that are drawn; ``x`` and ``y`` are what is asked for.

    Raises :class:`~granphon.base.errors.InputError` if there is no such load or quantity, or a run does not hold it.
    """
    if spectra := [run for run in runs if not run.quantities]:
        other = next((run for run in runs if run.quantities), None)
        what = f"{_list(spectra)} {'holds' if len(spectra) == 1 else 'hold'} {spectra[0].what} and no velocities"
        why = f"{other.name} is {other.what}: they cannot share an axis" if other else "There is nothing over a load"
        raise InputError(message(what, why, "Draw them in figures of their own"))
    return _choose_load(runs, x), _choose_quantity(runs, y)


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
    return name


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
    ratios = np.concatenate([run.find_loads(x) for run in runs]) if x in ("pressure", "reduced_force") else np.zeros(0)
    if not ratios.size or not np.all(np.isfinite(ratios)) or np.ptp(ratios) > _SAME * np.max(np.abs(ratios)):
        why = "It is not the same multiple of the contact force in all of them"
        if x == "overlap":
            why = "The overlap of balls was not measured"
        raise InputError(message(f"the {x} of measured points is not known from these runs", why, mend))
    return float(np.median(ratios))


def read_points(given: Any, runs: Sequence[Run], x: str, y: str, balls: int | None) -> Curve:
    """Return measured velocities, read from a file if need be, as a curve."""
    entry = CATALOGUE.get(y)
    if entry is None or entry.cost not in ("velocities", "pulse") or entry.unit != "m/s":
        raise InputError(message(f"measured velocities share no axis with {y}", mend="Take a velocity, as longitudinal"))
    name = "measured"
    if not isinstance(given, Measurements):
        name = Path(given).stem
        periods = _PERIODS.get(runs[0].pressure_unit, 2)
        frame = None if balls is None else partial(force_of_frame, balls_per_side=balls)

        def press(pressure: float) -> float:
            return pressure / _find_ratio(runs, "pressure", "Give the contact forces in the file")

        given = Measurements.read(given, frame=frame, pressed=press, periods=periods)
    ratio = _find_ratio(runs, x)
    sigma = np.nan if given.sigma is None else given.sigma
    facts = {"run": name}
    if given.frequency is not None:
        frequency = np.unique(given.frequency)
        facts["waves"] = f"pulses of {write_value(float(frequency[0]), 'Hz')}" if frequency.size == 1 else "pulses"
    return replace(Curve.of_points(name, facts, ratio * given.force, given.velocity, sigma), measured=True)
