"""What velocities, moduli, cut-off frequencies and waves of an edge depend on, by the parameters of
the balls and their load: the variable ``sensitivity`` of a data set.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace
from functools import cache, partial
from typing import Any

import numpy as np

from granphon.balls.ball import Ball
from granphon.balls.loads import Load
from granphon.balls.material import Material
from granphon.base.arrays import Array, Index, pad_columns
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
from granphon.runs.finished_tasks import TaskResult
from granphon.waves.settings import SurfaceSettings

#: name of the variable
NAME = "sensitivity"
#: names of the derivatives (loads, parameters, corners, waves) of the waves of an edge, and of the
#: letters (loads, corners) of these corners, in the result of a task: the number of waves is known
#: only there, and a data set has them as further quantities of the variable
_OF_EDGE = "edge_sensitivity"
_CORNERS = "edge_corners"
#: name of the quantity that a wave of an edge is
EDGE_WAVE = "surface_frequency"
#: magnitude of a logarithmic derivative that is rounding
_ROUNDING = 1e-8
#: for each dimension the lattice of a crystal whose velocities and moduli are timed, and the power
#: of the number of balls with which their time grows, as measured from 200 to 2300 balls
_TIMED = {1: ("chain", 1.0), 2: ("triangular", 1.0), 3: ("fcc", 1.75)}
#: most balls of that crystal
_TIMED_BALLS = 200
#: most balls of a layer of the crystal whose waves of an edge are timed, and the power of their
#: number with which this time grows, as measured from 4 to 16 balls
_TIMED_LAYER = 4
_GROWTH_OF_EDGES = 3.0
#: corners of the path along an edge, by the number of periods along it, about
_CORNERS_OF_EDGES = (1, 2, 4)


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
    surface: SurfaceSettings | None,
) -> TaskResult:
    """Return the logarithmic derivatives (loads, quantities, parameters) of the quantities by the
    parameters of :func:`list_axes`, in the medium that serves a ``load``.

    A derivative is nan if the state does not have the quantity, if the quantity is zero, or if the
    parameter cannot change; it is zero where it is rounding. Of many directions of sound the first
    counts. With a ``surface`` the result has also the derivatives of the waves of its edge, at the
    corners of the path along the edge, for :func:`join_edge_waves`. The derivatives are nan of a
    wave that meets a band as the parameter changes; simulated arrays have no edge waves.
    """
    balls = serving.packing
    quantities, parameters = list_axes(balls, load, has_cutoffs=has_cutoffs)
    edge = None if serving.arrays else surface

    derivatives = np.full((load.size, len(quantities), len(parameters)), np.nan)
    of_edges = list[Array]()
    corners = np.zeros(0, "S")
    for index in range(load.size):
        single = load.flat[index]
        finder = _Quantities(quantities, direction, has_cutoffs, edge)
        names = list_parameters(balls, single)
        sensitivities = find_parameter_sensitivities(
            serving.medium, balls, single, finder.find, names, finite_overlap or None
        )
        slopes = sensitivities.slopes
        slopes = np.where(np.abs(slopes) <= _ROUNDING, 0.0, slopes)
        columns = [parameters.index(name) for name in names]
        derivatives[index][:, columns] = slopes[:, : len(quantities)].T
        if finder.edge_waves is not None:
            corners = np.array(finder.edge_waves.letters, "S")
            of_edge = np.full((len(parameters), *finder.edge_waves.shape), np.nan)
            of_edge[columns] = finder.edge_waves.tabulate(slopes[:, len(quantities) :])
            of_edges.append(of_edge)
    found = {NAME: derivatives}
    if of_edges:
        found[_OF_EDGE] = np.array(pad_columns(of_edges))
        found[_CORNERS] = np.tile(corners, (load.size, 1))
    return found


def join_edge_waves(results: Sequence[TaskResult]) -> list[str]:
    """Join, in place, the derivatives of the waves of an edge to those of the other quantities of
    each result, and return the names of these waves: the letter of the corner of the path, which
    the end of a chain does not have, and the number of the wave there, from the lowest on.
    """
    rows_of_results = list[dict[str, Array]]()
    for result in results:
        rows = dict[str, Array]()
        corners = result.pop(_CORNERS, None)
        tables = result.pop(_OF_EDGE, None)
        if corners is not None and tables is not None:
            letters = [letter.decode() for letter in corners[0].tolist()]
            for wave in range(tables.shape[-1]):
                for place, letter in enumerate(letters):
                    rows[" ".join(filter(None, [EDGE_WAVE, letter, str(wave)]))] = tables[
                        :, :, place, wave
                    ]
        rows_of_results.append(rows)
    names = list(dict.fromkeys(name for rows in rows_of_results for name in rows))
    for result, rows in zip(results, rows_of_results, strict=True):
        derivatives = result[NAME]
        unknown = np.full(derivatives[:, 0].shape, np.nan)
        added = [rows.get(name, unknown)[:, None] for name in names]
        result[NAME] = np.concatenate([derivatives, *added], axis=1)
    return names


class _Quantities:
    """The quantities of :func:`list_axes`, of states that differ little from each other.

    A cut-off frequency does not change to first order as its wave vector moves: the wave vectors of
    the first state serve for all.

    Attributes
    ----------
    edge_waves : what finds the waves of an edge, which come after the quantities; None without.
    """

    def __init__(
        self,
        quantities: list[str],
        direction: Any,
        has_cutoffs: bool,
        surface: SurfaceSettings | None,
    ) -> None:
        self._quantities = quantities
        self._direction = direction
        self._has_cutoffs = has_cutoffs
        self.edge_waves = None if surface is None else _EdgeWaves(surface)
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
        if self.edge_waves is not None:
            values += self.edge_waves.find(state)
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


class _EdgeWaves:
    """What finds the waves of an edge, at the corners of the path along it, of states that differ
    little from the first one.

    Attributes
    ----------
    letters : of the corners, each once; empty texts at the end of a chain.
    """

    def __init__(self, settings: SurfaceSettings) -> None:
        self._settings = settings
        self.letters: list[str] = []
        #: (corners, periods along the edge) wave vectors
        self._corners: Array = np.zeros((0, 0))
        #: (corners,) number of waves of the first state at each corner
        self._counts: Index = np.zeros(0, np.intp)

    def find(self, state: Any) -> list[float]:
        """Return the frequencies, Hz, of all waves of a state, corner by corner, ascending at each;
        nan at a corner where the first state has more waves, or fewer.
        """
        from granphon.phonons.surfaces import Surface  # other runs do not need surfaces

        surface = Surface(state, self._settings.axis, self._settings.edge)
        is_first = not self.letters
        if is_first:
            corners = surface.corners()
            self.letters = list(corners)
            self._corners = np.array(list(corners.values()))[:, : len(surface.cell)]
        waves = surface.branches(self._corners)
        if is_first:
            self._counts = np.bincount(waves.place, minlength=len(self._corners))
        values = list[float]()
        for corner, count in enumerate(self._counts.tolist()):
            frequencies = waves[corner].tolist()
            values += frequencies if len(frequencies) == count else [math.nan] * count
        return values

    @property
    def shape(self) -> tuple[int, int]:
        """The number of corners, and the greatest number of waves at one of them."""
        return len(self._counts), int(np.max(self._counts, initial=0))

    def tabulate(self, values: Array) -> Array:
        """Return ``values`` (..., n) of all waves as a table (..., corners, waves), nan where a
        corner has fewer waves than another.
        """
        table = np.full((*values.shape[:-1], *self.shape), np.nan)
        table[..., np.arange(self.shape[1]) < self._counts[:, None]] = values
        return table


def estimate_derivatives(
    serving: ServingMedium, *, has_cutoffs: bool, has_edge_waves: bool
) -> costs.Cost:
    """Return the estimated memory and time of the derivatives of the states of a medium that
    simulates no arrays, at all its loads; memory and time of the states are not included.

    Each value of a difference takes the velocities and moduli of one network, with ``has_cutoffs``
    the frequencies at the wave vectors of both ends of all branches, and with ``has_edge_waves``
    the waves of an edge at the corners of its path.
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
    if has_edge_waves:
        from granphon.phonons.surfaces import estimate_waves_memory  # others do not need surfaces

        measure_edge = partial(
            _measure_edge_waves, structure.dimension, structure.n_balls, balls.friction
        )
        n_motions = balls.ball_motions.count * structure.n_balls
        cost += costs.Cost(
            estimate_waves_memory(n_motions, _CORNERS_OF_EDGES[structure.dimension - 1]),
            units=(costs.Units(n_networks, measure_edge),),
        )
    return replace(cost, parts=(description,))


@cache
def _measure_long_waves(dimension: int, n_balls: int, friction: bool) -> float:
    """Return the time, s, of the state, the velocities and the moduli of a crystal of ``n_balls``
    balls in its cell.

    The time of a crystal of at most :data:`_TIMED_BALLS` balls is measured, and multiplied by the
    power of the number of balls in :data:`_TIMED`.
    """
    _, growth = _TIMED[dimension]
    n_cells = max(round(min(n_balls, _TIMED_BALLS) ** (1.0 / dimension)), 1)  # along each period
    crystal = _make_crystal(dimension, (n_cells,) * dimension, friction)
    direction = np.eye(dimension)[0]

    def find() -> None:
        """Find the state of the small crystal and its velocities and moduli."""
        state: Any = as_state(crystal.at_force(1.0))
        find_all(Analysis(state, direction), ("velocities",), swept=True)

    return costs.time_once(find) * math.pow(n_balls / crystal.n_balls, growth)


@cache
def _measure_edge_waves(dimension: int, n_balls: int, friction: bool) -> float:
    """Return the time of the waves of an edge, at the corners of its path, of a crystal with so
    many balls in a layer, s: that of a crystal with few balls is measured.
    """
    from granphon.phonons.surfaces import Surface  # other runs do not need surfaces

    n_cells = min(n_balls, _TIMED_LAYER)  # along the first period
    crystal = _make_crystal(dimension, (n_cells, *(1,) * (dimension - 1)), friction)
    state = crystal.at_force(1.0)

    def find() -> None:
        surface = Surface(state, dimension - 1)
        corners = np.array(list(surface.corners().values()))
        surface.branches(corners[:, : dimension - 1])

    return costs.time_once(find) * math.pow(n_balls / n_cells, _GROWTH_OF_EDGES)


def _make_crystal(dimension: int, cells: tuple[int, ...], friction: bool) -> Crystal:
    """Return a crystal of equal balls, of so many cells, that is timed."""
    lattice, _ = _TIMED[dimension]
    ball = Ball(Material(1e9, 0.3, 1e3), 1e-2)
    return Crystal.on(lattice, [ball], friction=friction).repeat(cells)
