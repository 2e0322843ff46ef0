"""Memory and time that a run will need, estimated before the work is done.

Memory of samples is estimated in :mod:`granphon.media.sample_memory`. Memory follows from the
arrays: it was measured as Python's tracemalloc counts them, and is right within a factor of about
two. Time follows from a small piece of the same work, which is done and timed on this machine when
the time is first asked for: one equilibrium, or one path of loads, of at most a thousand balls; one
product of a dynamical matrix with a vector; the eigenvalues of one matrix; or the writing of
numbers. The rest is counting: how many balls, products, matrices and numbers the whole work has. So
the time is right within a factor of about three, and its text says no more than "seconds",
"minutes", "hours" or "days".
"""

from __future__ import annotations

import math
from collections.abc import Callable
from contextlib import suppress
from dataclasses import dataclass, replace
from functools import cache, lru_cache, partial
from time import process_time
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from granphon.balls.diameters import Uniform
from granphon.balls.loads import Load
from granphon.balls.material import Material
from granphon.balls.packing import Packing
from granphon.base.arrays import Array
from granphon.base.differences import N_VALUES
from granphon.base.errors import GranphonError
from granphon.base.text import counted
from granphon.dynamics.large_cells import BYTES
from granphon.dynamics.linalg import MANY_COLUMNS
from granphon.media.left_out import estimate_reduced_force
from granphon.media.medium import AveragedLattice
from granphon.media.sample_memory import LEAST_FORCE

if TYPE_CHECKING:
    from granphon.media.simulation import DirectSimulation

#: longest time that a run may be estimated to take on one processor, s: a hundred processors would
#: need a hundred days
MOST_SECONDS = 10_000 * 86400.0
#: most time of a unit of any work, s, on any machine: a unit takes microseconds, or a millisecond
_MOST_UNIT_SECONDS = 0.1
#: most time of a ball of an array that comes to rest without friction, s, on any machine, beside
#: the factors by which few and many balls are slower: 1 to 24 microseconds were seen, of 4 to 4096
#: balls under f* = 1 to 5e-4
_MOST_BALL_SECONDS = 2e-4
#: most time in which a number is written as text, s, on any machine: 0.2 microseconds were seen
_MOST_NUMBER_SECONDS = 1e-5
#: words for a time, each up to and with so many s
_WORDS = ((60.0, "seconds"), (3600.0, "minutes"), (2 * 86400.0, "hours"), (math.inf, "days"))
#: time for which a small piece of work is repeated, s; the shortest repetition counts
_REPEATED_SECONDS = 0.05
#: most time, s, that the first call of a piece of work may spend on imports and on loading compiled
#: loops: 0.4 s were seen
_LOADING_SECONDS = 1.0
#: most balls of the small array, most balls of one with a history of friction, most loads of its
#: path (few loads lie so far apart that each takes several steps), and size of the small matrix
_SMALL_BALLS = 1000
_SMALL_LOADED_BALLS = 300
_SMALL_LOADS = 12
_SMALL_MATRIX = 500
#: number of balls of an array that takes twice as long as its balls alone, since arrays of few
#: balls are slow: counted between 16^2 and 1024^2
_OVERHEAD_BALLS = 2000.0
#: least exponent by which the time per ball of a loading with friction grows with the balls
_LOADED_GROWTH = 0.25
#: that exponent for a load that the small array does not bear
_UNKNOWN_GROWTH = 0.5
#: least number of cells along a side of the small array
_LEAST_SIDE = 4
#: products with a vector that take as long as a step of a motion, and as a frame of it; factors of
#: dashpots and of implicit steps
_STEP_PRODUCTS = 2.0
_FRAME_PRODUCTS = 50.0
_DAMPED_STEP = 1.6
_IMPLICIT_STEP = 8.0
#: time of a response over that of its products: sums of a Krylov space take as long as half of
#: them, and narrow lines, if there are any, are solved again up to six times
_RESPONSE_PRODUCTS = 6.0
#: rows of a contact whose product takes as long as a reading of a ball of a pulse
_READING_ROWS = 2.0
#: memory of Python and the libraries that the run of a scene loads, and one with a motion or with
#: balls at rest, which loads Numba, bytes
_PYTHON_BYTES = 145e6
NUMBA_BYTES = 270e6
#: bytes for each contact of a motion, and copies of what is kept
_MOTION_CONTACT_BYTES = 1300.0
_MOTION_COPIES = 3.0
#: bytes over the square of the number of branches while vectors of one wave vector are found
_VECTORS_BYTES = 200.0
#: bytes for each motion of a crystal whose moduli are found, by its dimension, at a thousand balls;
#: and the power of the number of balls with which these bytes grow, as measured from 200 to 10,000
#: balls: a state with its factors, and those at rest
_RELAXED_BYTES = {1: 1e4, 2: 2.2e4, 3: 8e4}
_RELAXED_POWER = {1: 0.0, 2: 0.0, 3: 0.25}
_RELAXED_BALLS = 1000
#: bytes for each contact while its network is made, and then its operator
_CONTACT_BYTES = 600.0
#: bytes for each ball that hears a pulse, and each product
_HEARD_BYTES = 60.0
#: time and memory below which an estimate is not worth showing, s and bytes
_TOLD_SECONDS = 1.0
_TOLD_BYTES = 1e8


class Units(NamedTuple):
    """Equal units of work, such as balls brought to rest.

    ``number`` says how many there are. The function ``measure`` times one unit and returns its
    time, s. ``most_seconds`` is the time, s, that a unit takes at most on any machine; it is
    infinite if no such time is known.
    """

    number: float
    measure: Callable[[], float]
    most_seconds: float = _MOST_UNIT_SECONDS


@dataclass(frozen=True)
class Cost:
    """Memory and time of pieces of work. The sum of two costs is the cost of one piece after the
    other.

    Attributes
    ----------
    working : memory that a piece needs while it is done and then gives back, bytes.
    kept : memory that is kept to the end, bytes.
    units : the work, in units whose time is measured.
    work : number of balls that simulations bring to rest, each counted once in each equilibrium.
    balls, equilibria : number of balls in one sample, and number of equilibria.
    parts : descriptions of the work that is not a simulation.
    libraries : memory of Python and its libraries, bytes.
    """

    working: float = 0.0
    kept: float = 0.0
    units: tuple[Units, ...] = ()
    work: float = 0.0
    balls: int = 0
    equilibria: int = 0
    parts: tuple[str, ...] = ()
    libraries: float = _PYTHON_BYTES

    def __add__(self, other: Cost) -> Cost:
        """Return the cost of two pieces of work, one after the other. Of the memory that each gives
        back, the larger counts.
        """
        return Cost(
            working=max(self.working, other.working),
            kept=self.kept + other.kept,
            units=self.units + other.units,
            work=self.work + other.work,
            balls=max(self.balls, other.balls),
            equilibria=self.equilibria + other.equilibria,
            parts=self.parts + other.parts,
            libraries=max(self.libraries, other.libraries),
        )

    def times(self, count: float) -> Cost:
        """Return the cost of ``count`` such pieces, one after the other. The memory that each gives
        back counts once.
        """
        return replace(
            self,
            kept=self.kept * count,
            units=tuple(unit._replace(number=unit.number * count) for unit in self.units),
            work=self.work * count,
            equilibria=round(self.equilibria * count),
        )

    @property
    def memory(self) -> float:
        """Greatest memory, with Python and its libraries, bytes."""
        return self.libraries + self.working + self.kept

    @property
    def seconds(self) -> float:
        """Time on one processor of this machine, s, within a factor of about three; the first call
        times a small piece of each kind of work.
        """
        return sum(unit.number * unit.measure() for unit in self.units)

    def takes_longer(self, seconds: float) -> bool:
        """Return whether the time on one processor is above ``seconds``, s. Nothing is timed if the
        units are so few that even on the slowest machine it is not.
        """
        longest = sum(unit.number * unit.most_seconds for unit in self.units)
        return longest > seconds and self.seconds > seconds

    @property
    def tells(self) -> bool:
        """Whether the estimate is worth showing to the user: always for a simulation, for other
        work above 1 s or 100 MB.
        """
        if self.equilibria or self.working + self.kept > _TOLD_BYTES:
            return True
        return self.takes_longer(_TOLD_SECONDS)

    @property
    def text(self) -> str:
        """The estimate as one line of text: what is done, memory, and the time in one word."""
        descriptions = list(self.parts)
        if self.equilibria:
            simulation = f"simulation of {_count(self.balls, 'ball')}"
            if self.equilibria > 1:
                simulation += f", {self.equilibria} equilibria"
            descriptions.insert(0, simulation)
        memory = f"{self.memory / 1e6:.0f} MB"
        if self.memory >= 1e9:
            memory = f"{_write_digits(self.memory / 1e9)} GB"
        seconds = self.seconds
        duration = next(word for most, word in _WORDS if seconds <= most)
        return f"{'; '.join(descriptions)}: about {memory} and {duration}"


def write_duration(seconds: float) -> str:
    """Return a time, ``seconds``, as a text of two significant digits. The unit is the largest of
    days, hours and minutes in which the time is two or more, or else the second.

    A time from 100 to 120 s has three digits. A time below 0.1 s is "less than 0.1 s".
    """
    for unit_seconds, unit in ((86400.0, "days"), (3600.0, "h"), (60.0, "min")):
        if seconds >= 2.0 * unit_seconds:
            return f"{_write_digits(seconds / unit_seconds)} {unit}"
    if seconds < 0.1:
        return "less than 0.1 s"
    return f"{seconds:.0f} s" if seconds >= 10.0 else f"{seconds:.2g} s"


def _write_digits(value: float) -> str:
    """Return a ``value`` above zero as a text of two significant digits. It has no exponent if the
    value is 1e-4 or more.
    """
    rounded_value = float(f"{value:.2g}")
    return f"{rounded_value:.2g}" if rounded_value < 100.0 else f"{rounded_value:,.0f}"


def _count(number: int, one: str, many: str = "") -> str:
    """Return the ``number`` of things as a text with commas between thousands, "1,200 balls"; the
    words are those of :func:`~granphon.base.text.counted`.
    """
    _, noun = counted(number, one, many).split(" ", 1)
    return f"{number:,} {noun}"


# -- what is timed ---------------------------------------------------------------------------------


def time_once(do_piece: Callable[[], object]) -> float:
    """Return the processor time, s, of a call ``do_piece()``: the shortest of the first call and of
    those that are made within :data:`_REPEATED_SECONDS` after it.

    The first call may import modules and load compiled loops. After one that takes longer than
    :data:`_LOADING_SECONDS` there is no other.
    """
    start = process_time()
    do_piece()
    after_first = process_time()
    shortest = after_first - start
    if shortest > _LOADING_SECONDS:
        return shortest
    start = after_first
    while start - after_first < _REPEATED_SECONDS:
        do_piece()
        shortest = min(shortest, process_time() - start)
        start = process_time()
    return shortest


def _measure_ball(simulation: DirectSimulation, load: Load) -> float:
    """Return the time per ball, s, of one equilibrium of an array at the middle value of a load;
    with a history of friction, the mean over some of the values.

    A small array of the same kind is timed, and its time per ball is multiplied by two factors.
    First, where contacts are open, an equilibrium takes more steps in a larger array: the time per
    ball grows as the number of balls to the power of the fraction of open contacts. This was
    counted on the triangular lattice from 32^2 to 256^2 balls and in fcc from 10^3 to 24^3, from f*
    = 0.005 to 1. For a history of friction the power is 1/4 or more. Second, a part of the time
    does not depend on the balls, which is more per ball in a small array.
    """
    balls = simulation.balls
    most_balls = _SMALL_LOADED_BALLS if simulation.history.is_loaded else _SMALL_BALLS
    scale = min(1.0, most_balls / balls) ** (1.0 / len(simulation.cells))
    shape = tuple(min(cells, max(round(cells * scale), _LEAST_SIDE)) for cells in simulation.cells)
    small_simulation = simulation
    if shape != simulation.cells or simulation.samples > 1:
        small_simulation = replace(
            simulation, shape=shape, diameters=None, samples=1, executor=None
        )
    small_seconds, growth = _time_array(small_simulation, load)
    size_ratio = balls / small_simulation.balls
    overhead_ratio = _find_overhead(balls) / _find_overhead(small_simulation.balls)
    return small_seconds / small_simulation.balls * overhead_ratio * math.pow(size_ratio, growth)


def _find_overhead(balls: int) -> float:
    """Return the time per ball of an array of so many ``balls``, over that of a ball alone: a part
    of the time of an array does not depend on the balls.
    """
    return 1.0 + _OVERHEAD_BALLS / balls


def _limit_ball(simulation: DirectSimulation) -> float:
    """Return the time per ball, s, that an equilibrium of an array takes at most on any machine.

    As in :func:`_measure_ball` it has a part that does not depend on the balls, and grows with
    their number: at most as the root, as if half of the contacts were open.
    """
    if simulation.history.is_loaded:
        return _MOST_UNIT_SECONDS
    balls = simulation.balls
    growth = math.pow(max(balls / _SMALL_BALLS, 1.0), _UNKNOWN_GROWTH)
    return _MOST_BALL_SECONDS * _find_overhead(balls) * growth


@lru_cache(maxsize=32)
def _time_array(simulation: DirectSimulation, load: Load) -> tuple[float, float]:
    """Solve a small array at some values of a load, and return the processor time, s, of one
    equilibrium with its moduli, and the exponent with which the time per ball grows with the number
    of balls.

    The values are the middle one, or with a history of friction up to :data:`_SMALL_LOADS` of its
    path. The exponent is the mean fraction of open contacts, or 1/2 if the array does not bear a
    load; with a history of friction it is at least :data:`_LOADED_GROWTH`.
    """
    is_loaded = simulation.history.is_loaded
    indices = [(load.size - 1) // 2]
    if is_loaded:
        # the path from one of these loads to the next is solved in steps: few loads stand for all
        indices = np.unique(np.linspace(0, load.size - 1, _SMALL_LOADS).astype(int)).tolist()
    if not simulation.ordered:  # indices count the loads by their size, not in their order
        indices = np.argsort(load.array, axis=None)[indices].tolist()
    _pay_for_imports()
    start = process_time()
    growth = _UNKNOWN_GROWTH
    with suppress(GranphonError):  # a load that the array does not bear takes as long as its search
        state = simulation.at(load.flat[indices])
        _ = state.elastic_tensor
        growth = 1.0 - float(np.mean(state.contact_fraction))
    seconds = (process_time() - start) / len(indices)
    if is_loaded:
        growth = max(growth, _LOADED_GROWTH)
    return seconds, growth


@cache
def _pay_for_imports() -> None:
    """Solve an array of four balls, once in a process: the first array that a process solves
    imports modules, whose time must not be counted.
    """
    from granphon.media.simulation import DirectSimulation

    packing = Packing(Material(1e9, 0.3, 1e3), 1e-2, Uniform(1e-5))
    state = DirectSimulation(packing, (2, 2)).at_force(1.0)
    _ = state.elastic_tensor


@cache
def _measure_number() -> float:
    """Return the time in which a number is written as text, s, a mean of many numbers."""
    numbers = np.linspace(0.0, 1.0, 10_000).tolist()
    return time_once(lambda: [f"{number:.12f}" for number in numbers]) / len(numbers)


#: units of work for a number of numbers that are written as text
_written_numbers = partial(Units, measure=_measure_number, most_seconds=_MOST_NUMBER_SECONDS)


@cache
def _measure_matrix(eigenvectors: bool) -> float:
    """Return the time, s, in which a Hermitian matrix is solved, over the cube of its number of
    rows. Its eigenvalues are found, and with ``eigenvectors`` its eigenvectors too.
    """
    real, imaginary = np.random.default_rng(0).normal(size=(2, _SMALL_MATRIX, _SMALL_MATRIX))
    matrix = real + real.T + 1j * (imaginary - imaginary.T)  # Hermitian

    def solve() -> Any:
        """Find the eigenvalues, and eigenvectors if wanted, of the matrix once."""
        return np.linalg.eigh(matrix) if eigenvectors else np.linalg.eigvalsh(matrix)

    return time_once(solve) / _SMALL_MATRIX**3


# -- simulations -----------------------------------------------------------------------------------


def estimate(simulation: DirectSimulation, load: Load, exponents: bool = False) -> Cost:
    """Return the estimated memory and time of the states at a load, with their moduli, on one
    processor of this machine.

    With ``exponents``, where contact forces differ, the estimate includes the two neighbouring
    equilibria of each state, and their moduli, from which the local exponent is found. The time
    follows from that of a small array, see :func:`_measure_ball`.
    """
    packing = simulation.packing
    balls = simulation.balls
    equilibria_of_state = 3 if exponents and packing.spread_matters else 1
    equilibria = load.size * simulation.samples * equilibria_of_state
    relaxed_balls = float(balls) * equilibria
    measure = partial(_measure_ball, simulation, load.applied.flat)
    units = Units(relaxed_balls, measure, _limit_ball(simulation))
    return Cost(
        simulation.find_memory(load),
        units=(units,),
        work=relaxed_balls,
        balls=balls,
        equilibria=equilibria,
    )


def estimate_sensitivities(simulation: DirectSimulation, load: Load, n_parameters: int) -> Cost:
    """Return the estimated cost of the derivatives of the moduli of the states at a load by each of
    ``n_parameters`` parameters. The cost of the states themselves is not included.

    Each derivative is a difference of :data:`~granphon.base.differences.N_VALUES` values. The
    linear response at each takes about as long as an equilibrium.
    """
    states = estimate(simulation, load)
    return replace(
        states.times(N_VALUES * n_parameters),
        # no ball is brought to rest again: both numbers count what the states themselves take
        work=0.0,
        equilibria=0,
        parts=(f"derivatives by {_count(n_parameters, 'parameter')}",),
    )


def relaxation_memory(n_balls: int, n_motions: int, dimension: int) -> float:
    """Return the memory, bytes, that the moduli and sound velocities of a crystal take, and their
    derivatives: that of the factors of its matrices.

    The crystal has ``n_balls`` balls with ``n_motions`` motions each. ``dimension`` is 1, 2 or 3
    for balls on a line, in a plane or in space.
    """
    growth = math.pow(max(n_balls / _RELAXED_BALLS, 1.0), _RELAXED_POWER[dimension])
    return _RELAXED_BYTES[dimension] * n_balls * n_motions * growth


def estimate_contact_force(packing: Packing, load: Load) -> Array:
    """Return the approximate mean contact force (n,), N, at each value of an applied load; no array
    is simulated.
    """
    if packing.width:
        reduced_force = np.maximum(estimate_reduced_force(packing, load.applied), LEAST_FORCE)
        return np.asarray(reduced_force * packing.width_units.force)
    return np.ravel(AveragedLattice(packing).at(load.applied).force)


# -- spectra, and sweeps ---------------------------------------------------------------------------

#: bytes that are kept of frequencies alone, for each wave vector and branch
_FREQUENCY_BYTES = 50.0
#: bytes that are kept of bands with eigenvectors, for each wave vector; and over the square of the
#: number of branches, with and without the lines of a file
_BAND_BYTES = 2000.0
_WRITTEN_VECTOR_BYTES = 205.0
_KEPT_VECTOR_BYTES = 32.0
#: numbers of text that take as long as a wave vector of bands; and those over the square of the
#: number of branches: frequencies alone, with eigenvectors, and with the lines of a file
_BAND_NUMBERS = 275.0
_FREQUENCY_NUMBERS = 0.2
_VECTOR_NUMBERS = 1.2
_WRITTEN_VECTOR_NUMBERS = 30.0
#: part of the points of a mesh with equal sides that symmetry is taken to leave, the largest that
#: was measured
_PART_BY_SYMMETRY = 0.125
#: wave vectors of a mesh whose matrices are held at a time
_MESH_POINTS_AT_ONCE = 4096.0
#: bytes of a density of states: of any; for each point of the mesh; for each point that is solved
#: and branch; and of each matrix over the square of the number of branches
_DENSITY_BYTES = 1e6
_MESH_POINT_BYTES = 70.0
_MODE_BYTES = 20.0
_MATRIX_BYTES = 200.0
#: numbers of text that take as long as a point of a density of states; and those over the square of
#: the number of branches
_MESH_POINT_NUMBERS = 50.0
_MODE_NUMBERS = 4.0
#: part of the branches of disordered cells below which there is a gap, of equal balls on a lattice
#: and of packings in files; number of wave vectors at which modes are found for each gap, and
#: branches from which their matrices take the most time
_PART_BELOW_GAPS = 0.1
_PART_BELOW_GAPS_OF_NETWORKS = 0.5
_EDGE_SOLVES = 60.0
_MATRIX_BRANCHES = 24
#: bytes for each pair of atoms while force constants are made; and their time in numbers of text:
#: the number of atoms times a factor, to a power
_PAIR_BYTES = 20.0
_ATOM_FACTOR = 0.76
_ATOM_POWER = 2.2
#: bytes for each ball and each contact in a frame of a motion: 15 numbers, and 2 numbers
_FRAME_BALL_BYTES = 8.0 * 15.0
_FRAME_CONTACT_BYTES = 8.0 * 2.0
#: bytes of a sweep: for each case, for each state, for each frequency of a state, and for each
#: frequency of the bands
_CASE_BYTES = 8000.0
_STATE_BYTES = 2400.0
_STATE_FREQUENCY_BYTES = 30.0
_SWEEP_FREQUENCY_BYTES = 120.0
#: numbers of text that take as long as a case of a sweep, and as a state without its frequencies
_CASE_NUMBERS = 10_000.0
_STATE_NUMBERS = 125.0


def bands(points: int, branches: int, eigenvectors: bool = True, file: bool = True) -> Cost:
    """Return the estimated cost of bands at ``points`` wave vectors: of frequencies alone, or with
    ``eigenvectors``, and then with the lines of a ``file`` if one is written.

    The time of a wave vector grows as the square of the number of ``branches``, as measured with 2,
    3 and 9 branches, and so does its memory with eigenvectors; without them the memory is in
    proportion to the branches. The unit of time is that in which a number is written as text. With
    more than :data:`~granphon.dynamics.linalg.MANY_COLUMNS` branches the time of the eigenvalues is
    added, which grows as the cube of the number of branches: a small matrix is timed.
    """
    square = branches * branches
    kept = points * _FREQUENCY_BYTES * branches
    numbers = _BAND_NUMBERS + _FREQUENCY_NUMBERS * square
    if eigenvectors:
        vector_bytes = _WRITTEN_VECTOR_BYTES if file else _KEPT_VECTOR_BYTES
        vector_numbers = _WRITTEN_VECTOR_NUMBERS if file else _VECTOR_NUMBERS
        kept = points * (_BAND_BYTES + vector_bytes * square)
        numbers = _BAND_NUMBERS + vector_numbers * square
    units = [_written_numbers(points * numbers)]
    result = "bands" if eigenvectors else "frequencies"
    description = f"{result} at {_count(points, 'wave vector')}"
    working = 0.0
    if branches > MANY_COLUMNS:
        description += f" with {_count(branches, 'branch', 'branches')}"
        cubes = points * float(branches) ** 3
        units.append(Units(cubes, partial(_measure_matrix, eigenvectors)))
        working = (_VECTORS_BYTES if eigenvectors else BYTES) * square
    return Cost(working, kept, tuple(units), parts=(description,))


def density_of_states(mesh: tuple[int, ...], branches: int) -> Cost:
    """Return the estimated cost of a density of states of so many ``branches`` on a ``mesh`` of
    wave vectors, given by the numbers of points along its sides.

    Each point of the mesh needs phonopy's tables of the grid. Each point that symmetry leaves needs
    its modes, whose matrices are held for 4096 points at a time. Symmetry is taken to leave an
    eighth of the points if two sides of the mesh are equal, and all of another mesh. Bytes, and
    the numbers of text that take as long to write as a point, were measured on the triangular,
    kagome, fcc and hcp lattice, with 60 x 61 to 400^2 and 24^3 to 48^3 wave vectors.
    """
    points = math.prod(mesh)
    has_equal_sides = len(set(mesh)) < len(mesh)
    solved_points = points * (_PART_BY_SYMMETRY if has_equal_sides else 1.0)
    matrix_bytes = min(solved_points, _MESH_POINTS_AT_ONCE) * _MATRIX_BYTES * branches**2
    table_bytes = _MESH_POINT_BYTES * points
    mode_bytes = solved_points * _MODE_BYTES * branches
    memory = _DENSITY_BYTES + table_bytes + mode_bytes + matrix_bytes
    numbers_of_point = _MESH_POINT_NUMBERS + _MODE_NUMBERS * branches**2
    units = _written_numbers(solved_points * numbers_of_point)
    description = f"density of states on {' x '.join(map(str, mesh))} wave vectors"
    return Cost(memory, units=(units,), parts=(description,))


def band_edges(
    states: int, points: int, branches: int, of_all: bool, *, of_network: bool = False
) -> Cost:
    """Return the estimated cost of the edges of bands in so many ``states``, on a mesh of so many
    ``points``: of the edges of all ``branches`` with ``of_all``, else of the edges beside gaps.

    The memory is that of the frequencies on the mesh; those of one state are held at a time, and
    given back. The frequencies are found at half of the points, as those of q and -q are equal.
    Then the edges beside each gap are followed from the best points, which takes
    :data:`_EDGE_SOLVES` wave vectors for a gap. One in ten branches is taken to be below a gap, as
    measured on lattices and on samples of 4 to 36 balls. With ``of_network``, for the packing of a
    file and for the network of a design, it is every second branch, as measured on 29 balls of
    three sizes. A wave vector takes as long as one of a density of states. In large cells a matrix
    is timed, too.
    """
    fraction_below = _PART_BELOW_GAPS_OF_NETWORKS if of_network else _PART_BELOW_GAPS
    n_gaps = branches if of_all else math.ceil(fraction_below * branches)
    n_solves = states * (0.5 * points + _EDGE_SOLVES * n_gaps)
    numbers_of_point = _MESH_POINT_NUMBERS + _MODE_NUMBERS * branches**2
    units = [_written_numbers(n_solves * numbers_of_point)]
    if branches > _MATRIX_BRANCHES:
        units.append(Units(n_solves * float(branches) ** 3, partial(_measure_matrix, True)))
    working = _FREQUENCY_BYTES * points * branches
    description = f"edges of {_count(branches, 'band')}"
    return Cost(working, units=tuple(units), parts=(description,))


def force_constants(dim: tuple[int, ...], balls: int) -> Cost:
    """Return the estimated cost of force constants on phonopy's supercell of ``dim`` cells with
    ``balls`` each, and of the file.

    phonopy compares the atoms of the supercell with each other, once for every cell: this takes 20
    bytes for each pair, and a time that goes as the number of atoms to the power 2.2. The file has
    one more atom in each cell.
    """
    atoms = math.prod(dim) * (balls + 1)
    numbers = (_ATOM_FACTOR * atoms) ** _ATOM_POWER
    units = _written_numbers(numbers)
    description = f"force constants of {' x '.join(map(str, dim))} cells"
    return Cost(_PAIR_BYTES * atoms * atoms, units=(units,), parts=(description,))


def array_waves(
    measure: Callable[[], float],
    products: float,
    balls: int,
    contacts: float,
    rows: float,
    heard: float = 0.0,
    readings: float = 0.0,
) -> Cost:
    """Return the estimated cost of waves in an array of so many ``balls``.

    Each ball has on average so many ``contacts``, and these have in all so many ``rows``,
    components of their deformations. ``products`` is the number of products of the dynamical matrix
    with a vector, whose time per ball, s, is ``measure()``. Of a pulse, ``heard`` is the number of
    products in one sample times the number of balls at which the pulse is read; ``readings`` is the
    number of these balls times the number of times at which they are read, in all samples.
    """
    memory = _CONTACT_BYTES * balls * contacts + _HEARD_BYTES * heard
    ball_products = products * balls + readings * _READING_ROWS / rows
    units = Units(ball_products, measure)
    return Cost(memory, units=(units,), parts=(f"waves in {_count(balls, 'ball')}",))


def motion_memory(balls: int, contacts: int, frames: int) -> float:
    """Return the memory, bytes, of a motion of so many ``balls`` and ``contacts``, kept in so many
    ``frames``.
    """
    frame_bytes = _FRAME_BALL_BYTES * balls + _FRAME_CONTACT_BYTES * contacts
    return frames * frame_bytes * _MOTION_COPIES + _MOTION_CONTACT_BYTES * contacts


def motion(
    measure: Callable[[], float],
    steps: int,
    balls: int,
    contacts: int,
    frames: int,
    has_dashpots: bool,
    is_implicit: bool,
) -> Cost:
    """Return the estimated cost of a motion of so many ``balls`` and ``contacts``, kept in so many
    ``frames``.

    A step takes as long as some products of the dynamical matrix with a vector, whose time per
    ball, s, is ``measure()``. Steps take longer if they have dashpots, ``has_dashpots``, or are
    iterated, ``is_implicit``. The time in which loops are compiled once is not counted.
    """
    products_of_step = _STEP_PRODUCTS
    if has_dashpots:
        products_of_step *= _DAMPED_STEP
    if is_implicit:
        products_of_step *= _IMPLICIT_STEP
    products = steps * products_of_step + frames * _FRAME_PRODUCTS
    units = Units(products * balls, measure)
    memory = motion_memory(balls, contacts, frames)
    description = f"motion of {_count(balls, 'ball')} in {_count(steps, 'step')}"
    return Cost(memory, units=(units,), parts=(description,), libraries=NUMBA_BYTES)


def response(
    measure: Callable[[], float],
    products: float,
    balls: int,
    contacts: int,
    frequencies: int,
    factors: float,
) -> Cost:
    """Return the estimated cost of a response of so many ``balls`` and ``contacts`` at so many
    ``frequencies``.

    ``products`` is the number of products of the dynamical matrix with a vector at all frequencies,
    whose time per ball, s, is ``measure()``. The whole response takes :data:`_RESPONSE_PRODUCTS`
    times as long. ``factors`` is the memory of the factors of the matrix, bytes.
    """
    count_of_frequencies = _count(frequencies, "frequency", "frequencies")
    description = f"response of {_count(balls, 'ball')} at {count_of_frequencies}"
    memory = _CONTACT_BYTES * contacts + factors
    units = Units(_RESPONSE_PRODUCTS * products * balls, measure)
    return Cost(memory, units=(units,), parts=(description,))


def sweep_states(cases: int, loads: int, frequencies: int) -> Cost:
    """Return the estimated cost of a sweep of ``cases`` (a medium with a packing), each at
    ``loads`` loads.

    Each state has ``frequencies`` frequencies of bands, and some thirty other numbers; all are held
    as results, stacked in one data set, and written. Each case has tables of its own. Bytes, and
    the numbers of text that take as long to write, were measured with 40 to 40 000 states, and up
    to 1e7 frequencies.
    """
    states = cases * loads
    description = _count(states, "state")
    if frequencies:
        description += f" with {_count(frequencies, 'frequency', 'frequencies')} each"
    bytes_of_state = _STATE_BYTES + _STATE_FREQUENCY_BYTES * frequencies
    memory = _CASE_BYTES * cases + states * bytes_of_state + _SWEEP_FREQUENCY_BYTES * frequencies
    numbers = _CASE_NUMBERS * cases + states * (_STATE_NUMBERS + frequencies)
    units = _written_numbers(numbers)
    return Cost(kept=memory, units=(units,), parts=(description,))
