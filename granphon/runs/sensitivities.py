"""How velocities, moduli, cut-off frequencies and waves of an edge depend on the parameters of the
balls and on their load: the variable ``sensitivity`` of a data set.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace
from functools import cache, cached_property, partial
from itertools import product
from typing import Any, NamedTuple

import numpy as np

from granphon.balls.ball import Wall
from granphon.balls.loads import Load
from granphon.balls.packing import WALL_PARAMETERS
from granphon.base.arrays import Array, Index, pad_columns
from granphon.base.differences import N_VALUES
from granphon.base.errors import MechanismError
from granphon.base.text import counted
from granphon.media import cost as costs
from granphon.media.arrangement import Balls, find_kinds
from granphon.media.choice import ServingMedium
from granphon.media.state import State, as_state
from granphon.observables.catalogue import CATALOGUE, Analysis, find_all
from granphon.observables.parameters import (
    MINDLIN_RATIO,
    StateChange,
    change_ratio,
    find_parameter_sensitivities,
    has_ratio,
    list_parameters,
    name_parameters,
)
from granphon.runs.edge_costs import estimate_corners_memory, make_crystal, measure_corners
from granphon.runs.finished_tasks import TaskResult
from granphon.waves.settings import SurfaceSettings

#: name of the variable
NAME = "sensitivity"
#: names of the derivatives (loads, parameters, corners, waves) of the waves of an edge, and of the
#: letters (loads, corners) of these corners, in the result of a task: the number of waves is known
#: only there, and a data set has them as further quantities of the variable
_EDGE_DERIVATIVES = "edge_sensitivity"
_CORNERS = "edge_corners"
#: name of the quantity that a wave of an edge is
EDGE_WAVE = "surface_frequency"
#: magnitude up to which a logarithmic derivative counts as rounding of zero
_ROUNDING = 1e-8
#: cut-off frequency, over the highest, that counts as rounding of zero: about the root of the
#: precision with which its square is known
_ZERO = 1e-7
#: note on balls that are held
_NOTE_ON_HELD_BALLS = (
    "derivatives of velocities and moduli are left out: balls that are held have none"
)
#: for each dimension the power of the number of balls with which the time of the velocities and
#: moduli of a crystal grows, as measured from 200 to 2300 balls
_GROWTH = {1: 1.0, 2: 1.0, 3: 1.75}
#: greatest number of balls of a crystal that is timed, about
_TIMED_BALLS = 200


def spell_quantity(name: str) -> str:
    """Return the words for the quantity ``name`` of the variable: for an entry of the catalogue its
    own words, for "cutoff_lower 3" and "cutoff_upper 3" the words "bottom of branch 3" and "top of
    branch 3", for "surface_frequency X 0" the words "edge wave 0 at X", and for "surface_frequency
    0", at the end of a chain, "edge wave 0".
    """
    if " " not in name:
        return CATALOGUE[name].words
    entry, *letters, number = name.split(" ")
    if entry == EDGE_WAVE:
        # the end of a chain has no corner
        at_corner = f" at {letters[0]}" if letters else ""
        return f"edge wave {number}{at_corner}"
    end = "bottom" if entry == "cutoff_lower" else "top"
    return f"{end} of branch {number}"


class Parameters:
    """The parameters by which derivatives of the states of ``balls`` under a ``load`` are found.

    Attributes
    ----------
    names : the names of all parameters. First come those of the balls, which
        :func:`granphon.observables.parameters.name_parameters` lists; then the kind of the load;
        then the ratio of shear to normal stiffness; then the parameters of a wall at the edge of
        the ``surface``, such as "surface.wall.young_modulus". A wall of the material of a kind of
        ball changes with the kind, and its parameters have no names of their own.
    """

    def __init__(self, balls: Any, load: Load, surface: SurfaceSettings | None) -> None:
        self._balls = balls
        self._surface = surface
        kinds_of_walls = set[str]() if surface is None else surface.kinds_of_walls
        self._walls = dict[str, Wall]()
        if surface is not None and not kinds_of_walls:
            self._walls = surface.list_walls({})
        names_of_walls = [".".join(pair) for pair in product(self._walls, WALL_PARAMETERS)]
        self._names_of_balls = name_parameters(balls, kinds_of_walls)
        self.names = [*self._names_of_balls, load.kind, MINDLIN_RATIO, *names_of_walls]

    def list_known(self, load: Load, *, has_samples: bool) -> list[str]:
        """Return those of the ``names`` that can change at a ``load`` while all others stay.

        With ``has_samples``, which is for simulated arrays, these are parameters of the balls and
        the load alone: each sample has a network of its own, in which nothing can be changed.
        """
        names = [*list_parameters(self._balls, load, self._names_of_balls)]
        if has_samples:
            return names
        if has_ratio(self._balls):
            names.append(MINDLIN_RATIO)
        return names + [name for name in self.changes_of_states if name != MINDLIN_RATIO]

    @cached_property
    def changes_of_states(self) -> dict[str, StateChange]:
        """The functions that change the parameters on which the balls at rest do not depend, by the
        names of the parameters. Parameters of walls that are zero are left out.
        """
        changes: dict[str, StateChange] = {MINDLIN_RATIO: change_ratio}
        for wall, parameter in product(self._walls, WALL_PARAMETERS):
            name = f"{wall}.{parameter}"
            value = getattr(self._walls[wall].solid, parameter)
            if value:
                changes[name] = partial(self._change_wall, name, value)
        return changes

    def _change_wall(self, name: str, value: float, state: Any, step: float) -> _AtWall:
        """Return a ``state`` at whose edge stands a wall with the ``value``, SI, of the parameter
        called ``name`` larger by a relative ``step``.
        """
        assert self._surface is not None
        changed = {name: (1.0 + step) * value}
        return _AtWall(state, self._surface.with_walls(changed, find_kinds(self._balls)))


class _AtWall(NamedTuple):
    """A ``state``, and the settings of its edge at another wall, ``surface``, in place of those of
    the scene.
    """

    state: Any
    surface: SurfaceSettings


def list_quantities(balls: Balls, *, has_cutoffs: bool) -> list[str]:
    """Return the names of the quantities of which derivatives are found: velocities and moduli, and
    with ``has_cutoffs`` the lower cut-off frequencies of all branches of the lattice of ``balls``
    and then the upper ones.
    """
    quantities = [
        name
        for name, entry in CATALOGUE.items()
        if entry.cost == "velocities"
        # numbers of a state without axes of their own; users' observables have no derivatives here
        and not (entry.dims or entry.sampled or CATALOGUE.is_added(name))
        and (entry.unit == "m/s" or entry.per_dimension == "modulus")
    ]
    if has_cutoffs:
        n_branches = balls.ball_motions.count * balls.structure.n_balls
        quantities += [
            f"cutoff_{end} {number}" for end in ("lower", "upper") for number in range(n_branches)
        ]
    return quantities


def observe_sensitivities(
    serving: ServingMedium,
    load: Load,
    direction: Any,
    *,
    finite_overlap: bool,
    has_cutoffs: bool,
    surface: SurfaceSettings | None,
) -> tuple[TaskResult, list[str]]:
    """Return the logarithmic derivatives (loads, quantities, parameters) of the quantities of
    :func:`list_quantities`, with ``has_cutoffs``, by the names of :class:`Parameters`, in the
    medium that serves a ``load``, ``serving``, with or without ``finite_overlap``; and notes on
    derivatives that are left out.

    A derivative is nan if the state does not have the quantity, if the quantity is zero, or if the
    parameter cannot change. A derivative up to :data:`_ROUNDING` is zero. Velocities are those of
    sound along ``direction``, the first if there are many, and x for None.

    With a ``surface`` the result also has the derivatives of the waves of its edge, at the corners
    of the path along the edge, for :func:`join_edge_waves`. The derivatives of a wave that meets a
    band as the parameter changes are nan. Simulated arrays have no edge waves.
    """
    balls = serving.packing
    quantities = list_quantities(balls, has_cutoffs=has_cutoffs)
    parameters = Parameters(balls, load, surface)
    edge = None if serving.arrays else surface

    derivatives = np.full((load.size, len(quantities), len(parameters.names)), np.nan)
    edge_tables = list[Array]()  # (parameters, corners, waves) at each load
    corners = np.zeros(0, "S")
    for index in range(load.size):
        single = load.flat[index]
        finder = _Quantities(balls, quantities, direction, has_cutoffs, edge)
        names = parameters.list_known(single, has_samples=bool(serving.arrays))
        slopes = _find_slopes(serving, single, finder, names, parameters, finite_overlap)
        columns = [parameters.names.index(name) for name in names]
        derivatives[index][:, columns] = slopes[:, : len(quantities)].T
        if finder.edge_waves is not None:
            corners = np.array(finder.edge_waves.letters, "S")
            edge_table = np.full((len(parameters.names), *finder.edge_waves.shape), np.nan)
            edge_table[columns] = finder.edge_waves.tabulate(slopes[:, len(quantities) :])
            edge_tables.append(edge_table)
    result = {NAME: derivatives}
    if edge_tables:
        result[_EDGE_DERIVATIVES] = np.array(pad_columns(edge_tables))
        result[_CORNERS] = np.tile(corners, (load.size, 1))
    notes = [_NOTE_ON_HELD_BALLS] if balls.is_held else []
    return result, notes


def _find_slopes(
    serving: ServingMedium,
    load: Load,
    finder: _Quantities,
    names: Sequence[str],
    parameters: Parameters,
    finite_overlap: bool,
) -> Array:
    """Return the logarithmic derivatives (names, values) of the values that ``finder`` finds of the
    state at a single ``load`` in the medium ``serving``, with or without ``finite_overlap``, by
    those of the ``parameters`` that are called ``names``. A derivative up to :data:`_ROUNDING` is
    zero.
    """
    sensitivities = find_parameter_sensitivities(
        serving.medium,
        serving.packing,
        load,
        finder.find,
        names,
        finite_overlap or None,
        parameters.changes_of_states,
    )
    slopes = sensitivities.slopes
    return np.where(np.abs(slopes) <= _ROUNDING, 0.0, slopes)


def join_edge_waves(results: Sequence[TaskResult]) -> list[str]:
    """Add the derivatives of the waves of an edge to those of the other quantities in each of the
    ``results``, which are changed in place, and return the names of these waves.

    A name holds :data:`EDGE_WAVE`, the letter of the corner of the path, and the number of the wave
    at this corner, from the lowest on; the end of a chain has no letter. A wave that a result does
    not have has derivatives of nan in this result.
    """
    rows_of_results = list[dict[str, Array]]()
    for result in results:
        rows = dict[str, Array]()
        corners = result.pop(_CORNERS, None)
        tables = result.pop(_EDGE_DERIVATIVES, None)
        if corners is not None and tables is not None:
            letters = [letter.decode() for letter in corners[0].tolist()]
            for wave in range(tables.shape[-1]):
                for place, letter in enumerate(letters):
                    name = " ".join(filter(None, [EDGE_WAVE, letter, str(wave)]))
                    rows[name] = tables[:, :, place, wave]  # (loads, parameters)
        rows_of_results.append(rows)
    names = list(dict.fromkeys(name for rows in rows_of_results for name in rows))
    for result, rows in zip(results, rows_of_results, strict=True):
        derivatives = result[NAME]
        unknown = np.full(derivatives[:, 0].shape, np.nan)
        rows_of_waves = [rows.get(name, unknown)[:, None] for name in names]
        result[NAME] = np.concatenate([derivatives, *rows_of_waves], axis=1)
    return names


class _Quantities:
    """The search for the ``quantities``, names of :func:`list_quantities`, of states of ``balls``
    that differ little from each other.

    Velocities are those of sound along ``direction``, the first if there are many, and x for None.
    With ``has_cutoffs`` the names end with those of cut-off frequencies. A cut-off frequency does
    not change to first order as its wave vector moves: the wave vectors of the first state serve
    for all. The edge is that of the ``surface``.

    Attributes
    ----------
    edge_waves : the search for the waves of an edge, whose frequencies come after the quantities;
        None without an edge.
    """

    def __init__(
        self,
        balls: Balls,
        quantities: list[str],
        direction: Any,
        has_cutoffs: bool,
        surface: SurfaceSettings | None,
    ) -> None:
        self._quantities = quantities
        self._direction = np.eye(balls.structure.periods)[0] if direction is None else direction
        self._has_cutoffs = has_cutoffs
        self.edge_waves = None if surface is None else _EdgeWaves(balls, surface)
        #: whether long waves run in the balls
        self._has_long_waves = not balls.is_held
        #: (quantities,) those of the first state, once it is known
        self._first: list[float] | None = None
        #: (n_branches, 2, p) wave vectors of the cut-off frequencies, once they are known
        self._points: Array | None = None

    def find(self, state: Any) -> Array:
        """Return the values (n,) of a state, a network, or a state at another wall: the quantities,
        and then the frequencies, Hz, of the waves of the edge, if there is one; nan for what the
        state does not have. The first call, with the unchanged state, fixes wave vectors and
        numbers of waves for all others.
        """
        if isinstance(state, _AtWall):  # the wall of an edge has no effect on the bulk
            assert self._first is not None
            assert self.edge_waves is not None
            return np.array([*self._first, *self.edge_waves.find(state.state, state.surface)])
        values = self._find_in_bulk(state)
        if self._first is None:
            self._first = values
        if self.edge_waves is not None:
            values = [*values, *self.edge_waves.find(state)]
        return np.array(values)

    def _find_in_bulk(self, state: Any) -> list[float]:
        """Return the values of the quantities of a state or network."""
        if not isinstance(state, State):  # a network, some of whose numbers were changed
            state = as_state(state)
        numbers = self._find_long_waves(state)
        values = [float(np.ravel(numbers.get(name, np.nan))[0]) for name in self._quantities]
        if self._has_cutoffs:
            cutoffs = self._find_cutoffs(state)
            # what is zero but for rounding is zero
            cutoffs = np.where(cutoffs <= _ZERO * np.max(cutoffs), 0.0, cutoffs)
            # the names end with the lower cut-offs of all branches and then the upper ones
            values[-cutoffs.size :] = cutoffs.T.ravel().tolist()
        return values

    def _find_long_waves(self, state: Any) -> dict[str, Any]:
        """Return the velocities and moduli of a state by name; an empty mapping for balls that are
        held, and for a mechanism. If the first state is a mechanism, later calls return an empty
        mapping at once; if only a later state is one, MechanismError is raised.
        """
        if not self._has_long_waves:
            return {}
        try:
            return find_all(Analysis(state, self._direction), ("velocities",), swept=True)
        except MechanismError:
            if self._first is not None:
                raise
            # the notes on the state say that it has no velocities
            self._has_long_waves = False
            return {}

    def _find_cutoffs(self, state: Any) -> Array:
        """Return the lower and the upper cut-off frequency of each branch of a ``state``,
        (n_branches, 2), Hz; at the first call their wave vectors are sought in the zone, and kept.
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
    """The search for the waves of an edge, at the corners of the path along the edge, of states of
    ``balls`` that differ little from the first one. The edge is that of the ``settings``.

    Attributes
    ----------
    letters : the letters that name the corners, each once; at the end of a chain, which is the one
        corner, an empty text. An empty list before the first state.
    """

    def __init__(self, balls: Balls, settings: SurfaceSettings) -> None:
        self._balls = balls
        self._settings = settings
        self.letters: list[str] = []
        #: (corners, periods along the edge) wave vectors
        self._corners: Array = np.zeros((0, 0))
        #: (corners,) number of waves of the first state at each corner
        self._counts: Index = np.zeros(0, np.intp)

    def find(self, state: Any, settings: SurfaceSettings | None = None) -> list[float]:
        """Return the frequencies, Hz, of all waves of a state, corner by corner, ascending at each;
        nan at a corner where the first state has more waves, or fewer. ``settings``, if given,
        stand in place of those of the search.
        """
        from granphon.phonons.surfaces import Surface  # other runs do not need surfaces

        # a wall of the material of a kind changes with that kind, also where no ball is of it
        kinds = find_kinds(getattr(state, "packing", self._balls))
        at_edge = (settings or self._settings).with_materials(kinds)
        surface = Surface(state, at_edge.axis, at_edge.edge)
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
    serving: ServingMedium, *, has_cutoffs: bool, surface: SurfaceSettings | None
) -> costs.Cost:
    """Return the estimated memory and time of the derivatives of the states of a medium,
    ``serving``, that simulates no arrays, at all its loads; memory and time of the states are not
    included.

    Each value of a difference takes the velocities and moduli of one network, with ``has_cutoffs``
    the frequencies at the wave vectors of both ends of all branches, and with a ``surface`` the
    waves of its edge at the corners of the path along the edge.
    """
    balls = serving.packing
    structure = balls.structure
    parameters = Parameters(balls, serving.load, surface)
    n_parameters = len(parameters.list_known(serving.load.flat[0], has_samples=False))
    n_networks = serving.load.size * (1 + N_VALUES * n_parameters)
    measure = partial(_measure_long_waves, structure.dimension, structure.n_balls, balls.friction)
    description = f"derivatives by {counted(n_parameters, 'parameter')}"
    n_motions = balls.ball_motions.count
    n_branches = n_motions * structure.n_balls  # also the number of motions in a layer at an edge
    memory = costs.relaxation_memory(structure.n_balls, n_motions, structure.dimension)
    cost = costs.Cost(
        memory,
        units=(costs.Units(n_networks, measure),),
        parts=(description,),
        libraries=costs.NUMBA_BYTES,
    )
    if has_cutoffs:
        frequencies = costs.bands(2 * n_branches, n_branches, eigenvectors=False)
        cost += replace(frequencies.times(n_networks), kept=0.0)  # no frequency is kept
    if surface is not None:
        measure_edge = partial(
            measure_corners, structure.dimension, structure.n_balls, balls.friction
        )
        cost += costs.Cost(
            estimate_corners_memory(structure.dimension, n_branches),
            units=(costs.Units(n_networks, measure_edge),),
        )
    return replace(cost, parts=(description,))


@cache
def _measure_long_waves(dimension: int, n_balls: int, friction: bool) -> float:
    """Return the time, s, that the state, the velocities and the moduli take of a crystal in
    ``dimension`` dimensions, with ``n_balls`` balls in its cell, with or without ``friction``.

    The time of a crystal of about as many balls as the smaller of ``n_balls`` and
    :data:`_TIMED_BALLS` is measured, and multiplied by the power of the number of balls in
    :data:`_GROWTH`.
    """
    n_cells = max(round(min(n_balls, _TIMED_BALLS) ** (1.0 / dimension)), 1)  # along each period
    crystal = make_crystal(dimension, (n_cells,) * dimension, friction)
    direction = np.eye(dimension)[0]

    def find() -> None:
        """Find the state of the small crystal and its velocities and moduli."""
        state: Any = as_state(crystal.at_force(1.0))
        find_all(Analysis(state, direction), ("velocities",), swept=True)

    return costs.time_once(find) * math.pow(n_balls / crystal.n_balls, _GROWTH[dimension])
