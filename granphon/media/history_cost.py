"""Estimate of the time that loading with friction takes, from counts of its steps and of iterations in them.

The counts were made in arrays of 16^2 to 128^2 balls, and of 8^3 and 14^3 in fcc, with mu from 0.02 to infinity and zero,
from a* = 1/2 to 0.52 to 1.5 in one load and in ten, with tolerances of the steps from 1e-2 to 1e-5: they are met within a
factor of four.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from granphon.media.friction_history import FrictionHistory

Array = NDArray[np.float64]
#: steps of the load for each unit of a*, at a tolerance of :data:`_STEPS_TOLERANCE`; they grow as its inverse root
_STEPS = 30.0
_STEPS_TOLERANCE = 1e-4
#: longest way in a* from one load to the next that counts
_MOST_WAY = 0.5
#: iterations of GMRES in a step of an array of one ball without a limit on T
_ITERATIONS = 8.0
#: their power of the number of balls
_ITERATIONS_POWER = 0.2
#: what Coulomb's limit adds to them, as a part of 1/mu^(3/2), in an array of :data:`_SLIDING_BALLS`
_SLIDING = 0.035
_SLIDING_BALLS = 1024.0
#: its power of the number of balls
_SLIDING_POWER = 0.35
#: time of an iteration for each ball of a large array
_ITERATION_TIME = 0.07
#: number of balls of an array in which it is twice as long
_FEW_BALLS = 2300.0
#: the same in the exact geometry, over that on the lattice
_EXACT_TIME = 3.0
#: iterations from the gas to where an array stands, over those of a step; there were up to ten times as many
_GAS_STEPS = 200.0
#: steps of further loading for an exponent
_BESIDE_STEPS = 3.0
#: least mu above zero for which there are counts: below it an estimate is a lower bound
_LEAST_FRICTION = 0.02
#: the same for the tolerance of steps
_LEAST_TOLERANCE = 1e-5


def count_steps(loading: FrictionHistory, path: Array, start: float) -> float:
    """Return about how many steps a history takes from the a* of its start to those of its ordered ``path``."""
    ways = np.minimum(np.abs(np.diff(path, prepend=start)), _MOST_WAY)
    return float(np.sum(np.maximum(_STEPS * ways * math.sqrt(_STEPS_TOLERANCE / loading.step_tolerance), 1.0)))


def count_iterations(balls: int, friction_coefficient: float) -> float:
    """Return about how many iterations of GMRES a step takes in an array of ``balls``."""
    sliding = 0.0
    if 0.0 < friction_coefficient < math.inf:
        held = max(friction_coefficient, _LEAST_FRICTION)
        sliding = _SLIDING * (balls / _SLIDING_BALLS) ** _SLIDING_POWER / held / math.sqrt(held)
    return float(_ITERATIONS * balls**_ITERATIONS_POWER * (1.0 + sliding))


def estimate_history(
    loading: FrictionHistory, balls: int, path: Array, start: float, exponents: bool = False, exact: bool = True
) -> tuple[float, bool]:
    """Return the time of a history per ball, in the units of :mod:`granphon.media.cost`, and whether it is a lower bound.

    Responses are not in it, but for ``exponents`` the further steps that they take at each load are.
    """
    mu, loose = loading.friction_coefficient or 0.0, loading.from_gas
    steps = count_steps(loading, path, start) + _BESIDE_STEPS * len(path) * exponents + _GAS_STEPS * loose
    time = _ITERATION_TIME * (1.0 + _FEW_BALLS / balls) * (_EXACT_TIME if exact else 1.0)
    bounds = loose or 0.0 < mu < _LEAST_FRICTION or loading.step_tolerance < _LEAST_TOLERANCE
    return time * steps * count_iterations(balls, mu), bounds
