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
    """Return the names of the quantities of which derivatives are found, and of the parameters:
    velocities and moduli, and with ``has_cutoffs`` the ends of the branches in the zone.
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
    """Return the logarithmic derivatives (loads, quantities, parameters) of :func:`list_axes`, in
    the medium that serves a ``load``; nan of what a state does not have, what is zero, and
    parameters that cannot change. Of many directions of sound the first counts.
    """
    balls = serving.packing
    quantities, parameters = list_axes(balls, load, has_cutoffs=has_cutoffs)

    derivatives = np.full((load.size, len(quantities), len(parameters)), np.nan)
    for index in range(load.size):
        single = load.flat[index]
        find = _Finder(quantities, direction, has_cutoffs).find
        names = list_parameters(balls, single)
        sensitivities = find_parameter_sensitivities(
            serving.medium, balls, single, find, names, finite_overlap or None
        )
        columns = [parameters.index(name) for name in names]
        derivatives[index][:, columns] = sensitivities.slopes.T
    return np.where(np.abs(derivatives) <= _ROUNDING, 0.0, derivatives)


class _Finder:
    """What finds the quantities of states that differ little.

    A cut-off frequency does not change to first order as its wave vector moves: the wave vectors of
    the first state serve for all.
    """

    def __init__(self, quantities: list[str], direction: Any, has_cutoffs: bool) -> None:
        self._quantities = quantities
        self._direction = direction
        self._has_cutoffs = has_cutoffs
        #: (n_branches, 2, p) wave vectors of the cut-off frequencies, once they are known
        self._points: Array | None = None

    def find(self, state: Any) -> Array:
        """Return the quantities of a state; zero of those that it does not have."""
        numbers = find_all(Analysis(state, self._direction), ("velocities",), swept=True)
        values = [float(np.ravel(numbers.get(name, 0.0))[0]) for name in self._quantities]
        if self._has_cutoffs:
            cutoffs = self._find_cutoffs(state)
            values[-cutoffs.size :] = cutoffs.T.ravel().tolist()
        return np.array(values)

    def _find_cutoffs(self, state: Any) -> Array:
        """Return the cut-off frequencies (n_branches, 2), Hz."""
        from granphon.phonons.phonons import find_phonons  # other runs do not need phonons

        phonons = find_phonons(state)
        if self._points is None:
            self._points = phonons.find_cutoff_points()
        count, ends, periods = self._points.shape
        frequencies = phonons.frequencies(self._points.reshape(-1, periods))
        by_point = frequencies.reshape(count, ends, -1)
        return by_point[np.arange(count), :, np.arange(count)]


def estimate_derivatives(serving: ServingMedium, *, has_cutoffs: bool) -> costs.Cost:
    """Return the estimated memory and time of the derivatives of the states of a medium that
    simulates no arrays, at all its loads, beside those of the states.

    Each value of a difference takes the velocities and moduli of one network, and with
    ``has_cutoffs`` the frequencies at the wave vectors of both ends of all branches.
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
    """Return the time of the velocities and moduli of a crystal of so many balls, s: that of a
    crystal of few balls, and of its state, is measured.
    """
    lattice, growth = _TIMED[dimension]
    n_cells = max(round(min(n_balls, _TIMED_BALLS) ** (1.0 / dimension)), 1)  # along each period
    ball = Ball(Material(1e9, 0.3, 1e3), 1e-2)
    crystal = Crystal.on(lattice, [ball], friction=friction).repeat((n_cells,) * dimension)
    direction = np.eye(dimension)[0]

    def find() -> None:
        state: Any = as_state(crystal.at_force(1.0))
        find_all(Analysis(state, direction), ("velocities",), swept=True)

    return costs.time_once(find) * math.pow(n_balls / crystal.n_balls, growth)
