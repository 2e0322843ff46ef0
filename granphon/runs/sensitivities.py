"""What the velocities, moduli and cut-off frequencies of states depend on, by the parameters of the
balls and their load: the variable ``sensitivity`` of a data set.
"""

from __future__ import annotations

import math
from dataclasses import replace
from functools import cache, partial
from typing import Any

import numpy as np

from granphon.balls.ball import Ball
from granphon.balls.loads import Load
from granphon.balls.material import Material
from granphon.base.arrays import Array
from granphon.base.differences import N_VALUES
from granphon.base.text import counted
from granphon.media import cost as costs
from granphon.media.arrangement import Balls
from granphon.media.choice import ServingMedium
from granphon.media.crystal import Crystal
from granphon.media.state import as_state
from granphon.observables.catalogue import CATALOGUE, Analysis, find_all
from granphon.observables.parameters import (
    find_parameter_sensitivities,
    list_parameters,
    name_parameters,
)

#: name of the variable
NAME = "sensitivity"
#: magnitude of a logarithmic derivative that is rounding
_ROUNDING = 1e-8
#: for each dimension the lattice of a crystal whose velocities and moduli are timed, and the power
#: of the number of balls with which their time grows, as measured from 200 to 2300 balls
_TIMED = {1: ("chain", 1.0), 2: ("triangular", 1.0), 3: ("fcc", 1.75)}
#: most balls of that crystal
_TIMED_BALLS = 200


def list_axes(balls: Balls, load: Load, *, has_cutoffs: bool) -> tuple[list[str], list[str]]:
    """Return the names of the quantities of which derivatives are found, and those of the
    parameters of the ``balls`` and their ``load``.

    The quantities are velocities and moduli, and with ``has_cutoffs`` the lower cut-off frequencies
    of all branches and then the upper ones.
    """
    quantities = [
        name
        for name, entry in CATALOGUE.items()
        if entry.cost == "velocities"
        and not (entry.dims or entry.sampled or CATALOGUE.is_added(name))
        and (entry.unit == "m/s" or entry.per_dimension == "modulus")
    ]
    if has_cutoffs:
        n_branches = balls.ball_motions.count * balls.structure.n_balls
        quantities += [
            f"cutoff_{end} {number}" for end in ("lower", "upper") for number in range(n_branches)
        ]
    return quantities, [*name_parameters(balls), load.kind]


def observe_sensitivities(
    serving: ServingMedium,
    load: Load,
    direction: Any,
    *,
    finite_overlap: bool,
    has_cutoffs: bool,
) -> Array:
    """Return the logarithmic derivatives (loads, quantities, parameters) of the quantities by the
    parameters of :func:`list_axes`, in the medium that serves a ``load``.

    A derivative is nan if the state does not have the quantity, if the quantity is zero, or if the
    parameter cannot change; it is zero where it is rounding. Of many directions of sound the first
    counts.
    """
    balls = serving.packing
    quantities, parameters = list_axes(balls, load, has_cutoffs=has_cutoffs)

    derivatives = np.full((load.size, len(quantities), len(parameters)), np.nan)
    for index in range(load.size):
        single = load.flat[index]
        find = _Quantities(quantities, direction, has_cutoffs).find
        names = list_parameters(balls, single)
        sensitivities = find_parameter_sensitivities(
            serving.medium, balls, single, find, names, finite_overlap or None
        )
        columns = [parameters.index(name) for name in names]
        derivatives[index][:, columns] = sensitivities.slopes.T
    return np.where(np.abs(derivatives) <= _ROUNDING, 0.0, derivatives)


class _Quantities:
    """The quantities of :func:`list_axes`, of states that differ little from each other.

    A cut-off frequency is an extremum, and does not change to first order as its wave vector moves:
    the wave vectors that are found for the first state serve for all states after it.
    """

    def __init__(self, quantities: list[str], direction: Any, has_cutoffs: bool) -> None:
        self._quantities = quantities
        self._direction = direction
        self._has_cutoffs = has_cutoffs
        #: (n_branches, 2, p) wave vectors of the cut-off frequencies, once they are known
        self._points: Array | None = None

    def find(self, state: Any) -> Array:
        """Return the values (quantities,) of a state; zero for quantities that the state does not
        have.
        """
        numbers = find_all(Analysis(state, self._direction), ("velocities",), swept=True)
        values = [float(np.ravel(numbers.get(name, 0.0))[0]) for name in self._quantities]
        if self._has_cutoffs:
            cutoffs = self._find_cutoffs(state)
            # the names end with the lower cut-offs of all branches and then the upper ones
            values[-cutoffs.size :] = cutoffs.T.ravel().tolist()
        return np.array(values)

    def _find_cutoffs(self, state: Any) -> Array:
        """Return the lower and the upper cut-off frequency of each branch, (n_branches, 2), Hz; at
        the first call their wave vectors are sought in the zone, and kept.
        """
        from granphon.phonons.phonons import find_phonons  # other runs do not need phonons

        phonons = find_phonons(state)
        if self._points is None:
            self._points = phonons.find_cutoff_points()
        n_branches, n_ends, periods = self._points.shape
        frequencies = phonons.frequencies(self._points.reshape(-1, periods))
        by_point = frequencies.reshape(n_branches, n_ends, -1)  # all branches at every point
        # of the points of each branch the frequency of this branch
        branches = np.arange(n_branches)
        return by_point[branches, :, branches]


def estimate_derivatives(serving: ServingMedium, *, has_cutoffs: bool) -> costs.Cost:
    """Return the estimated memory and time of the derivatives of the states of a medium that
    simulates no arrays, at all its loads; memory and time of the states are not included.

    Derivatives are differences between states of changed parameters. Each such state takes the
    velocities and moduli of one network, and with ``has_cutoffs`` the frequencies at the wave
    vectors of both ends of all branches.
    """
    balls = serving.packing
    structure = balls.structure
    n_parameters = len(list_parameters(balls, serving.load.flat[0]))
    n_networks = serving.load.size * (1 + N_VALUES * n_parameters)
    measure = partial(_measure_long_waves, structure.dimension, structure.n_balls, balls.friction)
    description = f"derivatives by {counted(n_parameters, 'parameter')}"
    memory = costs.relaxation_memory(
        structure.n_balls, balls.ball_motions.count, structure.dimension
    )
    cost = costs.Cost(
        memory,
        units=(costs.Units(n_networks, measure),),
        parts=(description,),
        libraries=costs.NUMBA_BYTES,
    )
    if has_cutoffs:
        n_branches = balls.ball_motions.count * structure.n_balls
        frequencies = costs.bands(2 * n_branches, n_branches, eigenvectors=False)
        cost += replace(frequencies.times(n_networks), kept=0.0)
    return replace(cost, parts=(description,))


@cache
def _measure_long_waves(dimension: int, n_balls: int, friction: bool) -> float:
    """Return the time, s, of the state, the velocities and the moduli of a crystal of ``n_balls``
    balls in its cell.

    The time of a crystal of at most :data:`_TIMED_BALLS` balls is measured, and multiplied by the
    power of the number of balls in :data:`_TIMED`.
    """
    lattice, growth = _TIMED[dimension]
    n_cells = max(round(min(n_balls, _TIMED_BALLS) ** (1.0 / dimension)), 1)  # along each period
    ball = Ball(Material(1e9, 0.3, 1e3), 1e-2)
    crystal = Crystal.on(lattice, [ball], friction=friction).repeat((n_cells,) * dimension)
    direction = np.eye(dimension)[0]

    def find() -> None:
        """Find the state of the small crystal and its velocities and moduli."""
        state: Any = as_state(crystal.at_force(1.0))
        find_all(Analysis(state, direction), ("velocities",), swept=True)

    return costs.time_once(find) * math.pow(n_balls / crystal.n_balls, growth)
