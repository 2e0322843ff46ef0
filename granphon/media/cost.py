"""Estimates of the memory and time that work will need, made before it is done.

Memory follows from the arrays. The time of a simulation is the processor's time of a small sample,
measured on this machine when it is needed, times factors for the size, the lattice and the load:
the nearer the rigidity threshold, the more steps an equilibrium takes, and a step of few balls
takes hardly less than one of thousands. The factors were fitted to runs of 16^2 to 192^2 balls on
the triangular lattice between f* = 0.002 and 2, and of 4^3 to 24^3 cells in fcc between 0.03 and 2,
on the lattice and in the exact geometry. The estimate is within a factor of three of them; below f*
= 0.02 large arrays may take up to five times as long. That of loading with friction is the number
of steps of the load times that of iterations of GMRES in each, which were counted in arrays of 16^2
to 128^2 balls, and of 8^3 and 14^3 in fcc, with mu from 0.02 to infinity and zero, from a* = 1/2 to
0.52 to 1.5 in one load and in ten, with tolerances of the steps from 1e-2 to 1e-5: it is within a
factor of four of these counts. Bands, densities of states, force constants and sweeps were measured
on one processor at 2 to 3 GHz: memory (arrays, as Python's tracemalloc counts them) is right within
a factor of about two, time within a factor of five.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from functools import cache
from time import process_time

import numpy as np

from granphon.array.equilibrium import equilibrate
from granphon.array.geometry import ReducedLoad
from granphon.array.history import START_SPACING
from granphon.balls.diameters import uniform_numbers
from granphon.balls.loads import Load
from granphon.balls.packing import Packing
from granphon.base.arrays import Array
from granphon.dynamics.large_cells import BYTES
from granphon.dynamics.linalg import MANY_COLUMNS
from granphon.media.left_out import estimate_reduced_force, find_spacing
from granphon.media.loading import reduce_load
from granphon.media.medium import AveragedLattice
from granphon.media.sample_memory import LEAST_FORCE, estimate_memory
from granphon.media.simulation import DirectSimulation

#: longest time that a run may be estimated to take on one processor, s: a hundred processors would
#: need a hundred days
MOST_SECONDS = 10_000 * 86400.0
#: time of an equilibrium of the small sample per ball, s, on any machine: it takes some
#: microseconds
_SLOWEST = 1e-3
#: memory of Python and the libraries that the run of a scene loads, and one with a motion, which
#: loads Numba, bytes
_PYTHON_BYTES = 145e6
_NUMBA_BYTES = 270e6
#: times of a step of a motion and of each deformation of a contact in it, s; of a frame, and of
#: each contact in it
_MOTION_TIMES = (3e-5, 1.2e-8)
_FRAME_TIMES = (4e-4, 1e-6)
#: times of a step with contacts that turn, and of each contact in it
_TURNING_TIMES = 6e-5, 8e-8
#: times by which steps are longer with dashpots, and implicit ones
_MOTION_DAMPED = 1.6
_IMPLICIT = 8.0
#: bytes for each contact of a motion, and copies of what is kept
_MOTION_CONTACT_BYTES = 1300.0
_MOTION_COPIES = 3.0
#: time of a state per ball, its equilibrium and its linear response, over that of the equilibrium
#: of the small sample: with one, two and three periods, without rotations and with them
_STATE_TIME = {1: (0.5, 0.5), 2: (1.9, 2.25), 3: (4.5, 8.0)}
#: number of balls of an array whose steps take twice as long as for the balls alone
_FEW_BALLS = 2000.0
#: part by which each further ball of the cell makes the time per ball longer
_FURTHER_BALL_TIME = 0.4
#: part of it that the linear response takes
_RESPONSE_PART = 0.45
#: time of a state with its exponent, for which two neighbouring states are found, over that of the
#: state
_EXPONENT_TIME = 2.6
#: time of a state in the exact geometry over that on the lattice
_EXACT_TIME = 2.5
#: steps of the load for each unit of a*, at the tolerance 1e-4; they grow as its inverse root
_STEPS = 30.0
#: steps to each load, at least: the error of one is known from two of half its length
_LEAST_STEPS = 2.0
#: steps from the gas to where an array stands, and to the neighbouring loads for an exponent
_GAS_STEPS = 200.0
_BESIDE_STEPS = 3.0
#: longest way in a* from one load to the next that counts
_MOST_WAY = 0.5
#: iterations of GMRES in a step are these, times N^0.2 of N balls, without a limit on T ...
_ITERATIONS = 8.0
#: ... and with Coulomb's limit more by this part of (N/1024)^0.35/mu^(3/2)
_SLIDING = 0.035
#: time of an iteration per ball with two and three periods in a large array, over that of the
#: equilibrium of the small sample; and the number of balls of an array in which it is twice as long
_ITERATION_TIME = {2: 0.07, 3: 0.18}
_FEW_LOADED_BALLS = 2300.0
#: time of an iteration in the exact geometry, over that on the lattice
_EXACT_ITERATION_TIME = 3.0
#: least mu above zero, and least tolerance of steps, that were counted: below them an estimate is a
#: lower bound
_LEAST_FRICTION = 0.02
_LEAST_TOLERANCE = 1e-5
#: balls along the sides of the small sample
_SMALL_SHAPE = (96, 96)
#: a* of the small sample, and its f*
_SMALL_SPACING = 1.0
_SMALL_FORCE = 0.3678
#: size of the small matrix
_SMALL_MATRIX = 500
#: time of eigenvectors and velocities over that of eigenvalues
_VECTORS_TIME = 5.0
#: bytes over the square of the number of branches while vectors of one wave vector are found
_VECTORS_BYTES = 200.0
#: bytes for each contact while its network is made, and then its operator
_CONTACT_BYTES = 600.0
#: bytes for each ball that hears a pulse, and each product
_HEARD_BYTES = 60.0
#: time of one reading of one ball for each product of a pulse, s
_READING_TIME = 12e-9
#: time below which an estimate is not worth showing, s
_TOLD_SECONDS = 1.0
#: time below which an estimate gives no number, s
_LEAST_SECONDS = 0.1
#: memory below which an estimate is not worth showing, bytes
_TOLD_BYTES = 1e8


@dataclass(frozen=True)
class Cost:
    """Memory and time of pieces of work. The sum of two costs is the cost of one piece after the
    other.

    Attributes
    ----------
    working : memory that a piece needs while it is done and then gives back, bytes.
    kept : memory that is kept to the end, bytes.
    work : time of simulations, in units of the time for one ball of the small sample.
    known : time of work that is not a simulation, s.
    balls, equilibria : number of balls in one sample, and number of equilibria.
    parts : descriptions of the work that is not a simulation.
    bounds : whether the time is a lower bound, as for arrays that start from the gas.
    libraries : memory of Python and its libraries, bytes.
    """

    working: float = 0.0
    kept: float = 0.0
    work: float = 0.0
    known: float = 0.0
    balls: int = 0
    equilibria: int = 0
    parts: tuple[str, ...] = ()
    bounds: bool = False
    libraries: float = _PYTHON_BYTES

    def __add__(self, other: Cost) -> Cost:
        return Cost(
            max(self.working, other.working),
            self.kept + other.kept,
            self.work + other.work,
            self.known + other.known,
            max(self.balls, other.balls),
            self.equilibria + other.equilibria,
            self.parts + other.parts,
            self.bounds or other.bounds,
            max(self.libraries, other.libraries),
        )

    def times(self, count: float) -> Cost:
        """Return the cost of ``count`` pieces of this kind, one after the other."""
        return replace(
            self,
            kept=self.kept * count,
            work=self.work * count,
            known=self.known * count,
            equilibria=round(self.equilibria * count),
        )

    @property
    def memory(self) -> float:
        """Greatest memory, with Python and its libraries, bytes."""
        return self.libraries + self.working + self.kept

    @property
    def seconds(self) -> float:
        """Time on one processor of this machine, s; with simulations, the first call measures the
        small sample.
        """
        return self.known + (self.work * _measure_time_per_ball() if self.work else 0.0)

    def takes_longer(self, seconds: float) -> bool:
        """Return whether the time is above ``seconds``, s. The small sample is measured only if it
        may be.
        """
        return self.known + self.work * _SLOWEST > seconds and self.seconds > seconds

    @property
    def tells(self) -> bool:
        """Whether the estimate is worth showing to the user; for a simulation it always is."""
        return (
            bool(self.equilibria)
            or self.known > _TOLD_SECONDS
            or self.working + self.kept > _TOLD_BYTES
        )

    @property
    def text(self) -> str:
        """The estimate as one line of text."""
        many = f", {self.equilibria} equilibria" if self.equilibria > 1 else ""
        simulated = (f"simulation of {self.balls:,} balls{many}",) if self.equilibria else ()
        what = "; ".join(simulated + self.parts)
        size = (
            f"{_write_digits(self.memory / 1e9)} GB"
            if self.memory >= 1e9
            else f"{self.memory / 1e6:.0f} MB"
        )
        bound = "at least " if self.bounds and self.seconds >= _LEAST_SECONDS else ""
        time = f"{bound}{write_duration(self.seconds)}"
        return f"{what}: about {size} and {time}"


def write_duration(seconds: float) -> str:
    """Text of a time, s, with two digits, in the unit in which people say it."""
    for size, unit in ((86400.0, "days"), (3600.0, "h"), (60.0, "min")):
        if seconds >= 2.0 * size:
            return f"{_write_digits(seconds / size)} {unit}"
    if seconds < _LEAST_SECONDS:
        return f"less than {_LEAST_SECONDS:g} s"
    return f"{seconds:.0f} s" if seconds >= 10.0 else f"{seconds:.2g} s"


def _write_digits(value: float) -> str:
    """Write a number with two significant digits."""
    return f"{value:.2g}" if value < 100.0 else f"{float(f'{value:.2g}'):,.0f}"


# -- simulations -----------------------------------------------------------------------------------


def estimate(simulation: DirectSimulation, load: Load, exponents: bool = False) -> Cost:
    """Estimate memory and time of the states at a load, with their moduli, on one processor of this
    machine.

    With ``exponents`` the estimate includes the two neighbouring equilibria of each state, and
    their moduli, from which the local exponent is found. A load below the rigidity threshold is
    taken to be at the threshold. With a history of friction the time follows from the steps of the
    load and from what each takes at the friction coefficient.
    """
    if simulation.geometry is None:
        parts = simulation.by_geometry(load)
        return sum((estimate(one, load.flat[places], exponents) for one, places in parts), Cost())
    balls = simulation.balls
    count = load.size * simulation.samples
    history = simulation.history
    packing = simulation.packing
    structure = simulation.packing.structure
    turning = packing.ball_motions.rotate
    periods = structure.periods
    memory = estimate_memory(packing, balls, simulation.samples, load, history.is_loaded)
    if not packing.width:
        return Cost(memory, work=0.1 * balls * count, balls=balls, equilibria=count)
    force = np.maximum(estimate_reduced_force(packing, load.applied), LEAST_FORCE)
    exponents = exponents and packing.spread_matters
    mu = history.friction_coefficient or 0.0
    state = (
        _STATE_TIME[periods][turning]
        * (1.0 + _FEW_BALLS / balls)
        / (1.0 + _FEW_BALLS / math.prod(_SMALL_SHAPE))
    )
    if history.is_loaded:
        reduced = np.ravel(reduce_load(packing, load.applied))
        start = history.reduce_start(packing, simulation.is_exact)
        path = reduced if load.kind == "overlap" else find_spacing(packing, reduced)
        path = path if history.ordered else np.sort(path)
        begin = START_SPACING  # also for the gas, whose own is not known
        if isinstance(start, ReducedLoad):
            known = (
                find_spacing(packing, np.array([start.force]))[0]
                if start.overlap is None
                else start.overlap + 0.5
            )
            begin = float(known)
        ways = np.minimum(np.abs(np.diff(path, prepend=begin)), _MOST_WAY)
        steps_of = np.maximum(
            _STEPS * ways * math.sqrt(1e-4 / history.step_tolerance), _LEAST_STEPS
        )
        # a load at which the array stands already takes none
        steps = float(np.sum(steps_of, where=ways > 1e-9))
        steps += _BESIDE_STEPS * len(path) * exponents + _GAS_STEPS * history.from_gas
        held = max(mu, _LEAST_FRICTION)
        sliding = (
            _SLIDING * (balls / 1024.0) ** 0.35 / held / math.sqrt(held)
            if 0.0 < mu < math.inf
            else 0.0
        )
        work = steps * _ITERATIONS * balls**0.2 * (1.0 + sliding) * _ITERATION_TIME[periods]
        work *= (1.0 + _FEW_LOADED_BALLS / balls) * (
            _EXACT_ITERATION_TIME if simulation.is_exact else 1.0
        )
        work += _RESPONSE_PART * state * load.size * (1 + 2 * exponents)
    else:
        # on a line no contact opens, and no load is near a threshold
        near = force if periods > 1 else np.full_like(force, _SMALL_FORCE)
        each, small = (0.45 + np.minimum(0.28 * f**-0.8, f**-0.42) for f in (near, _SMALL_FORCE))
        each = each / small * (_EXACT_TIME if simulation.is_exact else 1.0)
        work = float(np.sum(each)) * state * (_EXPONENT_TIME if exponents else 1.0)
    work *= (1.0 + _FURTHER_BALL_TIME * (structure.n_balls - 1)) * balls * simulation.samples
    bounds = (
        history.from_gas or 0.0 < mu < _LEAST_FRICTION or history.step_tolerance < _LEAST_TOLERANCE
    )
    return Cost(
        memory, work=work, balls=balls, equilibria=count * (1 + 2 * exponents), bounds=bounds
    )


def find_typical_force(packing: Packing, load: Load) -> Array:
    """Return the mean contact force (n,), N, at each value of an applied load, about: no array is
    simulated.
    """
    if packing.width:
        reduced = np.maximum(estimate_reduced_force(packing, load.applied), LEAST_FORCE)
        return np.asarray(reduced * packing.width_units.force)
    return np.ravel(AveragedLattice(packing).at(load.applied).force)


@cache
def _measure_time_per_ball() -> float:
    """Measure the time per ball of an equilibrium of the small sample at a* = 1, with its
    stiffness, on this machine, s.
    """
    deviations = uniform_numbers(_SMALL_SHAPE, 0) - 0.5
    deviations -= np.mean(deviations)
    times = []
    for _ in range(3):
        start = process_time()
        _ = equilibrate(deviations, ReducedLoad(overlap=_SMALL_SPACING - 0.5)).stiffness
        times.append(process_time() - start)
    return min(times) / deviations.size


@cache
def _measure_eigenvalues() -> float:
    """Measure the time of the eigenvalues of a complex matrix over the cube of its size, on this
    machine, s.
    """
    n = _SMALL_MATRIX
    times = []
    real, imaginary = np.random.default_rng(0).normal(size=(2, n, n))
    matrix = real + real.T + 1j * (imaginary - imaginary.T)
    for _ in range(3):
        start = process_time()
        np.linalg.eigvalsh(matrix)
        times.append(process_time() - start)
    return min(times) / n**3


# -- spectra, and sweeps ---------------------------------------------------------------------------


def bands(points: int, branches: int, eigenvectors: bool = True, file: bool = True) -> Cost:
    """Estimate the cost of a band structure at ``points`` wave vectors, and of its ``file``.

    The numbers are bytes and microseconds for each wave vector: eigenvectors, phonopy's dynamical
    matrices and the lines of the file, as measured with 2, 3 and 9 branches. Matrices go as the
    square of the number of branches. In large cells eigenvalues take the most, which go as its
    cube; their time is that of a small matrix on this machine.
    """
    square = branches * branches
    cube = float(branches) ** 3
    what = (
        f"{'bands' if eigenvectors else 'frequencies'} at {points:,} wave"
        f" vector{'s' * (points != 1)}"
    )
    what += f" with {branches:,} branches" * (branches > MANY_COLUMNS)
    kept = points * (
        2000.0 + (295.0 if file else 32.0) * square if eigenvectors else 50.0 * branches
    )
    known = (
        1e-6
        * points
        * (110.0 + (12.0 if file else 0.5) * square if eigenvectors else 110.0 + 0.07 * square)
    )
    working = 0.0
    if branches > MANY_COLUMNS:
        known += points * cube * _measure_eigenvalues() * (_VECTORS_TIME if eigenvectors else 1.0)
        working = (_VECTORS_BYTES if eigenvectors else BYTES) * square
    return Cost(working, kept, known=known, parts=(what,))


def density_of_states(mesh: tuple[int, ...], branches: int) -> Cost:
    """Estimate the cost of a density of states on a mesh.

    The numbers are bytes and microseconds. Each point of the mesh needs phonopy's tables of the
    grid. Each point that symmetry leaves (at most an eighth of a mesh with equal sides; of others
    it may be all) needs its modes, whose matrices are held for 4096 points at a time. Measured on
    the triangular, kagome, fcc and hcp lattice, with 60 x 61 to 400^2 and 24^3 to 48^3 wave
    vectors. In space two equal sides suffice.
    """
    points = math.prod(mesh)
    left = points * (0.125 if len(set(mesh)) < len(mesh) else 1.0)
    memory = 1e6 + 70.0 * points + left * 20.0 * branches + min(left, 4096.0) * 200.0 * branches**2
    seconds = 1e-6 * left * (20.0 + 1.6 * branches**2)
    return Cost(
        memory,
        known=seconds,
        parts=(f"density of states on {' x '.join(map(str, mesh))} wave vectors",),
    )


def force_constants(dim: tuple[int, ...], balls: int) -> Cost:
    """Estimate the cost of force constants on phonopy's supercell of ``dim`` cells with ``balls``
    each, and of the file.

    phonopy compares the atoms of the supercell with each other, once for every cell: this takes 20
    bytes for each pair, and a time that goes as the number of atoms to the power 2.2. The file has
    one more atom in each cell.
    """
    atoms = math.prod(dim) * (balls + 1)
    what = f"force constants of {' x '.join(map(str, dim))} cells"
    return Cost(20.0 * atoms * atoms, known=1e-6 * (0.5 * atoms) ** 2.2, parts=(what,))


def array_waves(
    products: float,
    balls: int,
    contacts: float,
    rows: float,
    heard: float = 0.0,
    readings: float = 0.0,
) -> Cost:
    """Estimate the cost of waves in an array with ``contacts`` and ``rows`` of their deformations
    for each of the ``balls``.

    ``products`` is the number of products of the dynamical matrix with a vector, ``heard`` the
    number of products of a pulse times that of the balls that hear it, and ``readings`` that number
    times the times at which they hear it, in all samples. Seconds and bytes were measured on the
    triangular lattice and on fcc, with 2,500 to 1e6 balls.
    """
    what = f"waves in {balls:,} balls"
    memory = _CONTACT_BYTES * balls * contacts + _HEARD_BYTES * heard
    return Cost(
        working=memory,
        known=7e-9 * products * balls * rows + _READING_TIME * readings,
        parts=(what,),
    )


def motion_memory(balls: int, contacts: int, frames: int) -> float:
    """Return the memory, bytes, of a motion of so many ``balls`` and ``contacts``, kept at so many
    times.
    """
    return (
        8.0 * frames * (15.0 * balls + 2.0 * contacts) * _MOTION_COPIES
        + _MOTION_CONTACT_BYTES * contacts
    )


def motion(
    steps: float,
    rows: int,
    balls: int,
    contacts: int,
    frames: int,
    damped: bool,
    turning: bool,
    implicit: bool,
) -> Cost:
    """Estimate the cost of a motion of so many ``balls`` and ``contacts``, kept at so many times.

    Each contact has so many ``rows``, kinds of deformation, or turns and has all kinds.
    ``implicit`` steps are iterated. Seconds were measured with 30 to 11 000 contacts of a chain,
    the plane and fcc, and do not count that loops are compiled once.
    """
    alone, each = _TURNING_TIMES if turning else (_MOTION_TIMES[0], _MOTION_TIMES[1] * rows)
    step = (
        (alone + each * contacts)
        * (_MOTION_DAMPED if damped else 1.0)
        * (_IMPLICIT if implicit else 1.0)
    )
    memory = motion_memory(balls, contacts, frames)
    known = steps * step + frames * (_FRAME_TIMES[0] + _FRAME_TIMES[1] * contacts)
    return Cost(
        memory,
        known=known,
        parts=(f"motion of {balls:,} balls in {steps:,.0f} steps",),
        libraries=_NUMBA_BYTES,
    )


def response(balls: int, contacts: int, frequencies: int, seconds: float, factors: float) -> Cost:
    """Estimate the cost of a response of so many ``balls`` and ``contacts``, of its ``seconds`` and
    bytes of ``factors``.
    """
    what = (
        f"response of {balls:,} balls at {frequencies:,}"
        f" {'frequency' if frequencies == 1 else 'frequencies'}"
    )
    return Cost(_CONTACT_BYTES * contacts + factors, known=seconds, parts=(what,))


def sweep_states(cases: int, loads: int, frequencies: int) -> Cost:
    """Estimate the cost of a sweep of ``cases`` (a medium with a packing), each at ``loads`` loads.

    Each state has ``frequencies`` frequencies of bands, and some thirty numbers that are held as
    results, stacked, and written; each case has tables. Bytes and seconds were measured with 40 to
    40 000 states, and up to 1e7 frequencies.
    """
    states = cases * loads
    what = f"{states:,} states" + (f" with {frequencies:,} frequencies each" if frequencies else "")
    memory = 8000.0 * cases + states * (2400.0 + 30.0 * frequencies) + 120.0 * frequencies
    return Cost(
        kept=memory, known=4e-3 * cases + states * (5e-5 + 4e-7 * frequencies), parts=(what,)
    )
