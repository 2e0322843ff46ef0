"""The candidates among which an automatic medium takes the cheapest that is accurate enough, and their expected errors.

They are the media of the table of :mod:`granphon.media.accuracy`, the simulation with samples of many sizes. They are sorted
by rough times.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from granphon.balls.lattices import Lattice
from granphon.balls.loads import Load
from granphon.balls.packing import Packing
from granphon.base.errors import InputError, message
from granphon.media.accuracy import FRICTIONLESS, accuracy
from granphon.media.cost import estimate
from granphon.media.equilibria import reduce_load
from granphon.media.friction_history import REST, FrictionHistory
from granphon.media.left_out import EXACT, expect_shear_deficit, find_left_out
from granphon.media.mean_field import AveragedLattice, EffectiveMedium
from granphon.media.medium import Medium
from granphon.media.simulation import DirectSimulation

Array = NDArray[np.float64]
#: sides, in diameters, of the samples that an automatic medium chooses among, with two and with three periods
SIDES = {
    2: (16, 24, 32, 48, 64, 96, 128, 192, 256, 384, 512, 768, 1024),
    3: (8, 10, 12, 16, 20, 24, 32, 40, 48, 64, 80, 96),
}
#: rough time of a simulation besides the time for its balls, s
_SIMULATION_TIME = 0.04
#: rough time for each ball of a simulation, s
_BALL_TIME = 3e-6


def list_candidates(packing: Packing, against: FrictionHistory = REST) -> list[tuple[str, dict[str, Any]]]:
    """Return the name and the options of each candidate, a medium; the last is the largest simulation of the truth."""
    if not packing.spread_matters:
        return [(AveragedLattice.name, {})]  # exact for equal balls, and on a line
    laws: list[tuple[str, dict[str, Any]]] = [(name, {}) for name in accuracy().media() if name != DirectSimulation.name]
    structure = packing.structure
    shapes = [even_shape(structure, side) for side in SIDES[structure.periods]]
    # samples at rest without friction cost less than those of a truth with it, and may differ from these by little
    truths = dict.fromkeys((REST, against))
    return laws + [(DirectSimulation.name, {"shape": shape, **truth.options}) for truth in truths for shape in shapes]


def expected_error(
    name: str, options: Mapping[str, Any], packing: Packing, load: Load, against: FrictionHistory = REST
) -> Array:
    """Return the expected relative error of a medium's velocities and frequencies, with the shape of the load.

    The medium has a name, and ``options`` that are not at their defaults.

    It is +inf where the error is not known, as with a history of friction that is not that of the truth, and zero where
    every medium is exact: for equal balls, and on a line. That of a simulation at rest without friction against arrays that
    were loaded with friction is what these differ by, and the chance in its samples.

    The arrays of the truth have true directions at the W/d of the packing. To the errors of the table, which were measured
    at another W/d, is added the part of the transverse velocity by which the truth differs from that at this one: half of
    that of the shear modulus. To the chance of a simulation is added what its own directions leave out.
    """
    if not packing.spread_matters:
        return np.zeros(load.shape)
    deficit = expect_shear_deficit(packing, load, against.is_loaded).reshape(load.shape)
    known, own = accuracy(), FrictionHistory.read(options)
    loaded_otherwise = own.is_loaded and (own != against or options.get("geometry", EXACT) != EXACT)
    if name not in known.media() or options.get("local_field") == "paper" or loaded_otherwise:
        return np.full(load.shape, np.inf)
    ratio = known.ratio(packing, against)
    elsewhere = 0.5 * np.abs(deficit - expect_shear_deficit(packing, load, against.is_loaded, ratio).reshape(load.shape))
    if name != DirectSimulation.name:
        return known.error(name, packing, load, truth=against) + elsewhere
    medium = DirectSimulation(packing, **options)
    chance = known.error(name, packing, load, medium.balls * medium.samples, own)
    if own == against:
        return chance + 0.5 * find_left_out(deficit, medium.geometry)
    rest = expect_shear_deficit(packing, load).reshape(load.shape)
    apart = known.error(FRICTIONLESS, packing, load, truth=against) + elsewhere
    return apart + chance + 0.5 * find_left_out(rest, medium.geometry)


def require_known(packing: Packing, against: FrictionHistory) -> None:
    """Raise :class:`~granphon.base.errors.InputError` for a packing or a truth for which no errors are known."""
    if (why := accuracy().explain_uncovered(packing, against)) is not None:
        raise InputError(message(f"the errors of the media are not known here: {why}", mend="Name a medium"))


def require_within(tolerance: float, errors: Array, packing: Packing, load: Load, against: FrictionHistory) -> None:
    """Raise :class:`~granphon.base.errors.InputError` if at one of the loads no medium is within a tolerance.

    ``errors`` (n_media, n_loads) are those of all media. The error says what can be had at the worst of the loads, whose
    index is its ``load_index``.
    """
    least = np.min(errors, axis=0)
    if np.all(least <= tolerance):
        return
    worst = int(np.argmax(least))
    error = InputError(_explain_unmet(tolerance, float(least[worst]), packing, load[worst], against))
    error.load_index = worst
    raise error


def _explain_unmet(tolerance: float, least: float, packing: Packing, load: Load, against: FrictionHistory) -> str:
    """Return the message for one load at which the least error of all media is above the tolerance, or not known (+inf)."""
    structure = packing.structure
    where = load.describe(structure.periods) + f" against {against}" * against.is_loaded
    if np.isfinite(least):
        what = f"no medium has an expected error of {tolerance:g} or less at {where}"
        balls = math.prod(even_shape(structure, SIDES[structure.periods][-1])) * structure.n_balls
        why = f"The smallest expected error there is {least:.2g}, of a simulation of {balls:,} balls"
        return message(what, why, "Raise the tolerance, or simulate more samples by hand")
    name = "a*" if load.kind == "overlap" else "f*"
    at, lowest = float(reduce_load(packing, load)), accuracy().least(packing, load.kind, against)
    what = f"the errors of the media are not known at {where}, {name} = {at:.3g}"
    return message(what, f"They are known from {name} = {lowest:g} on", "Raise the load, or name a medium")


def rough_time(medium: Medium, load: Load) -> float:
    """Return the rough time of a medium at all values of an applied load, s; zero for those that only evaluate a law.

    That of a simulation is the time at one of the loads: at the least, whose equilibrium takes longest; with a history of
    friction at the greatest, on the way to which it passes the others.
    """
    if isinstance(medium, DirectSimulation):
        decisive = np.argmax if medium.friction_history else np.argmin
        return _SIMULATION_TIME + _BALL_TIME * estimate(medium, load[int(decisive(load.array))]).work
    return medium.seconds if isinstance(medium, EffectiveMedium) else 0.0


def even_shape(structure: Lattice, side: float) -> tuple[int, ...]:
    """Return the numbers of cells along each period of a sample whose sides are about ``side`` diameters."""
    lengths = np.linalg.norm(structure.vectors, axis=1)
    return tuple(max(round(side / length), 1) for length in lengths.tolist())
