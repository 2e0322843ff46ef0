"""Memory of simulated samples, estimated before they are made; that of a run is in ``media.cost``.

The memory follows from the arrays; bytes for each ball were measured as Python's tracemalloc counts
them.
"""

from __future__ import annotations

import math
from typing import Protocol

import numpy as np

from granphon.balls.loads import Load
from granphon.balls.packing import Packing
from granphon.media.array_options import FrictionHistory
from granphon.media.left_out import estimate_reduced_force
from granphon.statics.options import ResponseOptions, RestOptions

#: bytes for each ball while a sample without rotations is solved, with one, two and three periods,
#: besides those of the lattice's Green's function; on a line most is that of factors
_BALL_BYTES = {1: 650.0, 2: 380.0, 3: 450.0}
#: bytes for each ball while a linear response with rotations is solved, besides those of the
#: Green's function
_ROTATING_BALL_BYTES = {2: 500.0, 3: 1400.0}
#: bytes for each contact of a list while the list responds to strains, and for each entry of its
#: block of the tangent, (m, m) with m motions of a ball; and for each entry of the copies with
#: ghost cells, in double and in single precision, from which products are made
_LISTED_CONTACT_BYTES = 250.0
_BLOCK_ENTRY_BYTES = 8.0
_LAID_ENTRY_BYTES = 12.0
#: bytes for each motion of a ball under each strain while the list responds: the force that is
#: left, the direction of the search and the like
_STRAINED_MOTION_BYTES = 110.0
#: bytes for each ball while the Green's function is made, over n m^2, with n balls in the cell and
#: m motions of a ball
_GREEN_BYTES = 35.0
#: f* below which contacts are factorised
_FACTOR_FORCE = 0.015
#: further bytes for each ball of a factorisation, without rotations and with them
_FACTOR_BYTES = 2100.0
_ROTATING_FACTOR_BYTES = 4900.0
#: bytes for each ball of a further sample that is kept
_SAMPLE_BYTES = 8.0
#: bytes for each ball of a further equilibrium that is kept: a displacement along each period
_EQUILIBRIUM_BYTES = {1: 9.0, 2: 17.0, 3: 25.0}
#: least f* of an estimate
LEAST_FORCE = 5e-5
#: bytes for each ball while a path is followed, with two and three periods, in the directions of
#: the lattice and in exact directions
_HISTORY_BYTES = {2: 2000.0, 3: 5000.0}
_EXACT_HISTORY_BYTES = {2: 7000.0, 3: 20_000.0}
#: bytes for each ball of each state of a path that is kept
_HISTORY_STATE_BYTES = {2: 60.0, 3: 150.0}


class Samples(Protocol):
    """The samples of a simulation, all of one size."""

    @property
    def packing(self) -> Packing:
        """The packing of the samples."""

    @property
    def balls(self) -> int:
        """Number of balls of a sample."""

    @property
    def cells(self) -> tuple[int, ...]:
        """Number of cells of a sample along each axis with a period."""

    @property
    def samples(self) -> int:
        """Number of samples."""

    @property
    def ratio(self) -> float:
        """W/d in exact directions, zero in the directions of the lattice."""

    @property
    def history(self) -> FrictionHistory:
        """Whether and how the samples are loaded with friction."""


def estimate_memory(simulation: Samples, load: Load) -> float:
    """Return the memory, bytes, that the samples of a ``simulation`` need for their states and
    moduli at all values of a ``load``.

    In exact directions contacts are a list. In the directions of the lattice contacts are a grid,
    of which no contact is spelled out, whether the cell shears or not. The moduli of a grid take a
    list up to the number of balls whose matrix is factorised. Equal balls need no factors to come
    to rest, and keep nothing of a path.
    """
    packing = simulation.packing
    balls = simulation.balls
    samples = simulation.samples
    structure = packing.structure
    rotate = packing.ball_motions.rotate
    n_states = load.size * samples
    periods = structure.periods
    motions = packing.ball_motions.count if rotate else periods
    # the following are bytes for each ball
    green_bytes = _GREEN_BYTES * structure.n_balls * motions**2
    kept_bytes = _SAMPLE_BYTES * (samples - 1) + _EQUILIBRIUM_BYTES[periods] * (n_states - 1)
    solved_bytes = _ROTATING_BALL_BYTES[periods] if rotate else _BALL_BYTES[periods]
    response_bytes = solved_bytes + green_bytes
    if simulation.ratio or balls <= ResponseOptions().most_balls[periods]:
        response_bytes = max(response_bytes, _estimate_list(packing, motions, simulation.cells))
    memory = balls * (response_bytes + kept_bytes)
    if not packing.width:
        return memory
    reduced_force = np.maximum(estimate_reduced_force(packing, load.applied), LEAST_FORCE)
    can_be_factorised = periods > 1 and balls <= RestOptions().most_balls[periods]
    if can_be_factorised and np.any(reduced_force < _FACTOR_FORCE):
        memory += balls * (_ROTATING_FACTOR_BYTES if rotate else _FACTOR_BYTES)
    if simulation.history.is_loaded:
        followed_bytes = _EXACT_HISTORY_BYTES if simulation.ratio else _HISTORY_BYTES
        memory += balls * (followed_bytes[periods] + n_states * _HISTORY_STATE_BYTES[periods])
    return memory


def _estimate_list(packing: Packing, motions: int, cells: tuple[int, ...]) -> float:
    """Return the memory, bytes for each ball, of a list of contacts while its response to all
    strains of the cell is solved. Each ball has so many ``motions``; the array has so many
    ``cells`` along its axes.
    """
    structure = packing.structure
    n_contacts = len(structure.contacts) / structure.n_balls  # of one ball
    n_strains = structure.periods * (structure.periods + 1) // 2
    # contacts reach from a cell to the next one: there is one ghost on each side
    ghosts = math.prod((cells_along + 2) / cells_along for cells_along in cells)
    entry_bytes = _BLOCK_ENTRY_BYTES + _LAID_ENTRY_BYTES * ghosts
    contact_bytes = _LISTED_CONTACT_BYTES + entry_bytes * motions**2
    return n_contacts * contact_bytes + _STRAINED_MOTION_BYTES * motions * n_strains
