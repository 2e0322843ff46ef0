"""Sizes of the samples that an automatic medium chooses among, and rough times of media, by which it sorts them."""

from __future__ import annotations

import numpy as np

from granphon.balls.distributions import PointShape
from granphon.balls.lattices import Lattice
from granphon.balls.loads import Load
from granphon.balls.packing import Packing
from granphon.media.cost import estimate
from granphon.media.mean_field import EffectiveMedium
from granphon.media.medium import Medium
from granphon.media.simulation import DirectSimulation

#: sides, in diameters, of the samples that an automatic medium chooses among, with two and with three periods
SIDES = {
    2: (16, 24, 32, 48, 64, 96, 128, 192, 256, 384, 512, 768, 1024),
    3: (8, 10, 12, 16, 20, 24, 32, 40, 48, 64, 80, 96),
}
#: rough time of the effective medium for a density of diameters, s
_DENSITY_TIME = 0.03
#: rough time of the effective medium for 64 listed diameters, s
_LIST_TIME = 0.25
#: number of overlaps at which contacts open for 64 listed diameters: one for each pair of diameters, 64 * 65 / 2
_LIST_OPENINGS = 2080.0
#: exponent with which the time for listed diameters grows with the number of these overlaps
_LIST_POWER = 1.25
#: rough time of a simulation besides the time for its balls, s
_SIMULATION_TIME = 0.04
#: rough time for each ball of a simulation, s
_BALL_TIME = 3e-6
#: time below which work is done even when a scene is only checked and not run, s
MOMENT = 0.1


def solving_time(packing: Packing) -> float:
    """Return the rough time of the effective medium for the distribution of a packing, s, for any number of loads."""
    shape = packing.spread.shape if packing.spread and packing.width else None
    listed = _LIST_TIME * (shape.openings.size / _LIST_OPENINGS) ** _LIST_POWER if isinstance(shape, PointShape) else 0.0
    return max(_DENSITY_TIME, listed) if shape else 0.0


def rough_time(medium: Medium, load: Load) -> float:
    """Return the rough time of a medium at all values of an applied load, s; zero for those that only evaluate a law.

    That of a simulation is the time at one of the loads: at the least, whose equilibrium takes longest; with a history of
    friction at the greatest, on the way to which it passes the others.
    """
    if isinstance(medium, DirectSimulation):
        decisive = np.argmax if medium.friction_history else np.argmin
        return _SIMULATION_TIME + _BALL_TIME * estimate(medium, load[int(decisive(load.array))]).work
    return solving_time(medium.packing) if isinstance(medium, EffectiveMedium) else 0.0


def even_shape(structure: Lattice, side: float) -> tuple[int, ...]:
    """Return the numbers of cells along each period of a sample whose sides are about ``side`` diameters."""
    lengths = np.linalg.norm(structure.vectors, axis=1)
    return tuple(max(round(side / length), 1) for length in lengths.tolist())
