"""The study of the media: error and time of mean fields and of simulations of several sizes, against many samples.

Each of its points is a method with a knob, such as a simulation of so many balls. The reference is an ensemble of samples,
checked by another algorithm, and the error of a point is its distance from it.

Means over the ensemble have less scatter than the number of samples alone would leave. To second order in the differences of
diameters, the difference between one sample and the infinite array is linear in the sample's own means of x^2 and of x x'
over near pairs of balls. For the infinite array these means are known exactly: the variance, and zero. A linear regression
on them removes that part of the scatter (control variates). At f* = 1 it leaves less than a fifth of the standard error,
above f* = 3 a tenth or less, and near the rigidity threshold almost all of it.
"""

from __future__ import annotations

import itertools
import math
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from functools import cached_property, lru_cache, partial
from typing import TYPE_CHECKING, Any, ClassVar, NamedTuple, cast

import numpy as np
from numpy.typing import NDArray

from granphon.balls.contact_table import TOUCH, select_once, steps_within
from granphon.balls.distributions import PointShape
from granphon.balls.hertz import EXPONENT, FREQUENCY_EXPONENT
from granphon.balls.lattices import TRIANGULAR, Lattice
from granphon.balls.loads import Load
from granphon.balls.packing import Packing
from granphon.base.errors import GranphonError
from granphon.base.progress import Step
from granphon.dynamics.tensors import bulk_and_shear, longitudinal_modulus
from granphon.laws.effective import EffectiveLaw, effective_curve, solve_curve
from granphon.media.choice import even_shape
from granphon.media.cost import Cost, estimate, write_duration
from granphon.media.friction_history import REST, FrictionHistory
from granphon.media.left_out import LATTICE
from granphon.media.mean_field import AveragedForce, AveragedLattice, EffectiveMedium
from granphon.media.simulation import DirectSimulation
from granphon.media.state import ContactState
from granphon.observables.velocities import local_exponent, sound_velocities

if TYPE_CHECKING:
    from granphon.balls.diameters import Spread


Array = NDArray[np.float64]
#: quantities that are averaged, and whose errors are measured: velocities of long waves, and the scale of frequencies
QUANTITIES = ("longitudinal", "transverse", "frequency")
#: variance of x = Delta/W, the same for every distribution
_VARIANCE = 1.0 / 12.0
#: number of shells of neighbours whose pairs count as near; on every lattice they are within :data:`_REACH` spacings
_SHELLS = 3
_REACH = 3.0
#: least number of samples for each coefficient of the regression; with fewer it adds more scatter than it removes
_LEAST_SAMPLES_EACH = 6
#: first seed of the reference's samples, far from the seeds of the points
_REFERENCE_SEED = 1_000_000
#: least number of samples of the reference
_LEAST_SAMPLES = 3
#: sides, in diameters, of the samples of points, with two and with three periods
_SIDES = {2: (8, 16, 32, 64, 128), 3: (4, 6, 10, 16, 24)}
#: sides, in diameters, of the samples of the reference
_REFERENCE_SIDES = {2: 64, 3: 14}
#: the same if they are loaded with friction, which takes many times longer
_LOADED_SIDES = {2: 32, 3: 8}
#: sides, in diameters, of the sample that a sparse LU solves as well, as a check
_CHECKED_SIDES = {2: 24, 3: 6}
#: part of the tolerance of steps with which that sample is loaded once more, if samples are loaded with friction
_SHORTER = 0.1
#: number of samples between two checks whether the reference is good enough
_SAMPLES_BETWEEN_LOOKS = 8
#: number of openings of listed diameters above which solving the effective medium takes noticeable time
_MOST_OPENINGS = 40
#: diameters in the short list whose solution is timed to predict that of a long one
_TRIAL_DIAMETERS = 20
#: the time of a solution is proportional to this power of the number of openings
_TIME_POWER = 1.1


def observe(state: ContactState) -> Array:
    """Return the :data:`QUANTITIES` of a state, (..., 3): m/s, m/s, and (k/M)^(1/2) in 1/s.

    In the plane the velocities are those along x. In space they are those of the moduli averaged over all directions
    (W. Voigt, 1889), rho v^2 = K + 4G/3 and G.
    """
    scale = np.sqrt(state.normal_stiffness) / math.sqrt(state.packing.mass)
    if state.packing.structure.periods == 3:
        tensor, density = state.elastic_tensor, np.asarray(state.effective_density)
        moduli = longitudinal_modulus(tensor), bulk_and_shear(tensor)[..., 1]
        return np.stack([*(np.sqrt(one / density) for one in moduli), scale], axis=-1)
    velocities = sound_velocities(state, (1.0, 0.0))
    return np.stack([velocities.longitudinal, velocities.transverse, scale], axis=-1)


class Ensemble:
    """Samples, and what they say of the infinite array: :meth:`add` some, a few at a time, then ask for the :meth:`means`.

    All samples have the same ``packing``, in the plane or in space, applied ``load`` (n_loads,) and ``shape`` (L1, ..., Lp);
    their seeds count from ``seed``. They are samples of ``truth``. Raises what
    :class:`~granphon.media.simulation.DirectSimulation` raises.
    """

    def __init__(
        self, packing: Packing, load: Load, shape: tuple[int, ...], seed: int = 0, truth: FrictionHistory = REST
    ) -> None:
        self.packing, self.load, self.shape, self.seed, self.truth = packing, load, shape, seed, truth
        #: of each sample (n_loads, 3) what means are taken of: rho v^2 of both velocities, Pa, and k, N/m, or 1/k
        self.moduli: list[Array] = []
        self._excess: list[Array] = []

    @property
    def samples(self) -> int:
        """Number of samples."""
        return len(self.moduli)

    def add(self, count: int = 1) -> None:
        """Simulate ``count`` more samples."""
        simulation = DirectSimulation(self.packing, self.shape, self.seed + self.samples, count, **self.truth.options)
        state = simulation.at(self.load)
        tensors = state.over_samples(lambda sample: sample.elastic_tensor)
        k = state.over_samples(lambda sample: sample.normal_stiffness)
        # moduli are averaged, and k or, where samples share the force, the compliance 1/k, as in the state
        rows = longitudinal_modulus(tensors), bulk_and_shear(tensors)[..., 1], k if state.fixed_overlap else 1.0 / k
        self.moduli.extend(np.moveaxis(np.stack(rows, axis=-1), 1, 0))
        self._densities = np.asarray(state.effective_density)
        self._excess.extend(np.array(list(measure_excess(simulation))))

    def means(self) -> tuple[Array, Array]:
        """Return the :data:`QUANTITIES`, SI, and their relative standard errors, (n_loads, 3); of two samples or more."""
        moduli = np.array(self.moduli)
        means, errors = (
            one.reshape(moduli.shape[1:]) for one in regress(moduli.reshape(self.samples, -1), np.array(self._excess))
        )
        squares = np.abs(means) / np.stack([*[self._densities] * 2, np.full(len(means), self.packing.mass)], axis=1)
        if self.load.kind != "overlap":
            squares[:, 2] = 1.0 / means[:, 2] / self.packing.mass
        return np.sqrt(squares), 0.5 * errors / np.abs(means)


def measure_excess(simulation: DirectSimulation) -> Iterator[Array]:
    """Yield the means of x^2 and of x x' over each shell of near pairs of each sample, minus those of the infinite array."""
    structure = simulation.packing.structure
    shells, axes = find_near_pairs(structure), tuple(range(structure.periods))
    for index in range(simulation.samples):
        given = simulation.deviations(index)
        x = given if structure.n_balls > 1 else given[None]
        pairs = [np.mean([np.mean(x[j] * np.roll(x[i], shift, axes)) for i, j, shift in shell]) for shell in shells]
        yield np.array([np.mean(x * x) - _VARIANCE, *pairs])


@lru_cache(maxsize=64)
def find_near_pairs(structure: Lattice) -> list[list[tuple[int, int, tuple[int, ...]]]]:
    """Find the pairs of near balls, shell after shell: ball i of a cell, and ball j of the cell that is shifted from it.

    Each pair counts once. Balls at the same distance are one shell.
    """
    apart = structure.positions[None] - structure.positions[:, None]
    steps = steps_within(structure.vectors, _REACH + float(np.max(np.linalg.norm(apart, axis=-1))))
    distance = np.linalg.norm(apart[:, :, None] + steps @ structure.vectors, axis=-1)
    i, j, which = (one.astype(np.intp) for one in np.nonzero((distance > 0.5) & (distance < _REACH + TOUCH)))
    once = select_once(i, j, steps[which])
    i, j, which = i[once], j[once], which[once]
    shells = np.round(distance[i, j, which], 5)
    return [
        [(int(a), int(b), tuple(steps[c].tolist())) for a, b, c in zip(i[at], j[at], which[at], strict=True)]
        for at in (shells == radius for radius in np.unique(shells)[:_SHELLS])
    ]


def regress(values: Array, excess: Array) -> tuple[Array, Array]:
    """Return means of the columns of ``values`` (n, m) at zero ``excess`` (n, p), and their standard errors, each (m,)."""
    count, known = excess.shape
    design = np.ones((count, 1))
    scale = np.sqrt(np.mean(excess**2, axis=0))
    if count >= _LEAST_SAMPLES_EACH * (known + 1) and np.all(scale > 0.0):
        design = np.concatenate([design, excess / scale], axis=1)
    inverse = np.linalg.pinv(design)
    found = inverse @ values
    left = values - design @ found
    variance = np.sum(left**2, axis=0) / (count - design.shape[1])
    return found[0], np.sqrt(variance * np.sum(inverse[0] ** 2))


class Stopwatch:
    """Measures time and predicts what work will take, both in seconds.

    Everything in a trade-off that depends on time asks one of these. A subclass that counts work instead of seconds makes
    budgets, and therefore results, independent of how busy the machine is.
    """

    def now(self) -> float:
        """Time since some fixed moment, s."""
        return time.perf_counter()

    def predict(self, cost: Cost) -> float:
        """Return how long work of this estimated cost takes, s."""
        return cost.seconds


#: the stopwatch used unless another is given
SECONDS = Stopwatch()


@dataclass(frozen=True)
class Deadline:
    """The moment ``until`` (s, as ``stopwatch`` tells it) at which some work must be over."""

    stopwatch: Stopwatch
    until: float

    @property
    def left(self) -> float:
        """Time left, s; negative once the deadline has passed."""
        return self.until - self.stopwatch.now()

    def check(self) -> None:
        """Raise :class:`~granphon.base.errors.GranphonError` if no time is left."""
        if self.left < 0.0:
            raise GranphonError("it does not fit into the budget.")


@dataclass(frozen=True)
class Point:
    """A method with one setting of its knob.

    Attributes
    ----------
    method, knob : the method, and the setting, in words.
    prepare : takes the number of a run and returns what ``solve`` needs; not part of the time of a run.
    solve : finds what is compared with the reference.
    seconds : predicted time of a run, s; zero if nothing is known of it.
    random : whether every run draws other random numbers.
    """

    method: str
    knob: str
    prepare: Callable[[int], Any]
    solve: Callable[[Any], Any]
    seconds: float = 0.0
    random: bool = False


class Reference(NamedTuple):
    """A reference: its ``values``, their relative ``errors``, and a description of how they were ``made``."""

    values: Any
    errors: Array
    made: str


@dataclass(frozen=True)
class MediaStudy:
    """The media against the simulated array, at rest without friction or loaded with friction.

    Attributes
    ----------
    packing, load : balls of different diameters, and the loads at which errors are measured.
    quantities : those of :data:`~granphon.tradeoffs.study.QUANTITIES` whose errors are measured.
    stopwatch : measures all times.
    truth : which simulated arrays media are judged by.
    sides, counts : sides, in diameters, of the samples of a simulation, and how many samples it has.
    reference_side : side of the reference's samples. By default sides are those for the dimension of the lattice.
    """

    name: ClassVar[str] = "media"

    packing: Packing
    load: Load
    quantities: tuple[str, ...]
    stopwatch: Stopwatch = SECONDS
    truth: FrictionHistory = REST
    sides: tuple[int, ...] = ()
    counts: tuple[int, ...] = (1, 4)
    reference_side: int = 0

    @cached_property
    def _exact(self) -> list[int]:
        """Indices of the loads at which the arrays of the truth have their exact geometry."""
        simulation = DirectSimulation(self.packing, **self.truth.options)
        return [place for one, places in simulation.by_geometry(self.load) if one.is_exact for place in places]

    @property
    def _columns(self) -> list[int]:
        """Indices of the observed quantities."""
        return [QUANTITIES.index(name) for name in self.quantities]

    def observe(self, medium: Any) -> Array:
        """Return the observed quantities of a medium, (n_loads, n_observed), with finite overlap where the truth has it."""
        out = np.empty((self.load.size, len(QUANTITIES)))
        others = [place for place in range(self.load.size) if place not in self._exact]
        for places, finite in ((self._exact, True), (others, None)):
            if places:
                out[places] = observe(medium.at(self.load[places], finite_overlap=finite))
        return out[:, self._columns]

    @cached_property
    def solving(self) -> float:
        """Predicted time of solving the effective medium, s; zero up to 40 openings."""
        shape: Any = cast("Spread", self.packing.spread).shape
        if shape.openings.size <= _MOST_OPENINGS:
            return 0.0
        x = np.array(shape.positions)[np.unique(np.linspace(0, len(shape.positions) - 1, _TRIAL_DIAMETERS).astype(int))]
        few = PointShape(tuple(x.tolist()), (1.0 / x.size,) * x.size)
        begun = self.stopwatch.now()
        solve_curve(few, 1.0, 12, 1e-10)
        return float((self.stopwatch.now() - begun) * (shape.openings.size / few.openings.size) ** _TIME_POWER)

    @cached_property
    def condition(self) -> float:
        """Condition number of the velocities: the largest factor by which relative errors of load and width act on them."""
        state: ContactState = AveragedForce(self.packing).at(self.load)
        if not self.solving:
            with suppress(GranphonError):  # the loads may be below those of the effective medium
                state = EffectiveMedium(self.packing).at(self.load)
        by_force = np.asarray(local_exponent(state))
        overlap = np.asarray(state.overlap)
        # v = f^(1/6) times a function of f/W^(3/2), or W^(1/4) times one of delta/W
        by_load = by_force if self.load.kind != "overlap" else by_force * overlap * state.normal_stiffness / state.force
        by_width = EXPONENT * (by_force - FREQUENCY_EXPONENT)
        if self.load.kind == "overlap":
            by_width = (EXPONENT - 1.0) / 2.0 - by_load
        return float(1.0 + np.max(np.abs(by_load) + np.abs(by_width)))

    def make_points(self) -> list[Point]:
        """Return the points, in the order of their predicted times."""
        packing, structure = self.packing, self.packing.structure
        with suppress(GranphonError):  # found once for all runs; a lattice that has none says so in its point
            _ = EffectiveMedium(packing).local_field

        def prepare_effective(make: Callable[[], EffectiveMedium], run: int) -> EffectiveMedium:
            effective_curve.cache_clear()
            made = make()
            _ = cast("EffectiveLaw", made.law).curve
            return made

        def prepare_simulation(shape: tuple[int, ...], samples: int, of: FrictionHistory, run: int) -> DirectSimulation:
            return DirectSimulation(packing, shape, run * samples, samples, **of.options)

        fields = {"effective medium": ("computed field", lambda: EffectiveMedium(packing))}
        if structure == TRIANGULAR:  # the paper prints no field of another lattice
            fields["effective medium, paper's field"] = "printed field", lambda: EffectiveMedium(packing, "paper")
        found = [
            Point("averaged lattice", "ala", lambda run: AveragedLattice(packing), self.observe),
            Point("averaged force", "afa", lambda run: AveragedForce(packing), self.observe),
            *(Point(method, knob, partial(prepare_effective, make), self.observe, self.solving)
              for method, (knob, make) in fields.items()),
        ]  # fmt: skip
        shapes = [even_shape(structure, side) for side in self.sides or _SIDES[structure.periods]]
        for of, samples, shape in itertools.product(dict.fromkeys((REST, self.truth)), self.counts, shapes):
            prepare = partial(prepare_simulation, shape, samples, of)
            seconds = self.stopwatch.predict(estimate(prepare(0), self.load))
            method = f"simulation{' with friction' * of.is_loaded}, {samples} sample{'s' if samples > 1 else ''}"
            found.append(Point(method, _write_shape(shape), prepare, self.observe, seconds, random=True))
        return sorted(found, key=lambda point: point.seconds)

    def find_reference(self, deadline: Deadline, better: Callable[[Reference], bool], step: Step) -> Reference:
        """Simulate samples until ``better`` accepts the reference or the time is up.

        One smaller sample is solved in another way too, as a check: see :meth:`compare`. Raises
        :class:`~granphon.base.errors.GranphonError` if there is no time for it.
        """
        structure, loaded, now = self.packing.structure, self.truth.is_loaded, deadline.stopwatch.now
        sides = _LOADED_SIDES if loaded else _REFERENCE_SIDES
        shape = even_shape(structure, self.reference_side or sides[structure.periods])
        samples = Ensemble(self.packing, self.load, shape, _REFERENCE_SEED, self.truth)
        begun = now()
        simulation = DirectSimulation(self.packing, shape, _REFERENCE_SEED, **self.truth.options)
        least = _LEAST_SAMPLES * deadline.stopwatch.predict(estimate(simulation, self.load))
        if least > deadline.left:
            raise GranphonError(
                f"its samples do not fit into the budget: {_LEAST_SAMPLES} take about {write_duration(least)}."
            )
        checked, apart = self.compare(deadline)

        def summarize() -> Reference:
            """Return the reference from the samples so far; what the check differs by adds to its errors in quadrature."""
            values, errors = (table[:, self._columns] for table in samples.means())
            each = "balls" if structure.n_balls == 1 else "cells"
            made = f"{samples.samples} samples of {_write_shape(shape)} {each} {self.truth.words}, with control variates"
            return Reference(values, np.hypot(errors, apart[:, None]), f"{made}; {checked} by {np.max(apart):.0e}")

        longest = 0.0
        while deadline.left > 1.5 * longest:
            start = now()
            samples.add()
            step.advance()
            longest, count = max(longest, now() - start), samples.samples
            if count >= _LEAST_SAMPLES and count % _SAMPLES_BETWEEN_LOOKS == 0 and better(summarize()):
                break
        if samples.samples < _LEAST_SAMPLES:
            taken = write_duration(now() - begun)
            raise GranphonError(f"the budget allows only {samples.samples} of its samples ({taken}), which are too few.")
        return summarize()

    def compare(self, deadline: Deadline) -> tuple[str, Array]:
        """Solve a small sample of the truth in another way: return what differs, in words, and the differences (n_loads,).

        One that is loaded with friction is loaded once more, in shorter steps. Of one at rest, equilibrium and response are
        found by another algorithm, a sparse LU; both have the directions of the lattice, which that algorithm knows alone.
        """
        from granphon.array.sparse import SparseArray

        shape = even_shape(self.packing.structure, _CHECKED_SIDES[self.packing.structure.periods])
        if self.truth.is_loaded:
            own = DirectSimulation(self.packing, shape, _REFERENCE_SEED, **self.truth.options)
            ratio = self.observe(own) / self.observe(replace(own, step_tolerance=_SHORTER * own.step_tolerance))
            words = "velocities in steps of a tenth of the tolerance"
            apart = np.max(np.abs(ratio - 1.0), axis=-1)
        else:
            words, eta = "equilibrium and response by sparse LU", self.packing.mindlin_ratio
            state = DirectSimulation(self.packing, shape, _REFERENCE_SEED, geometry=LATTICE).at(self.load)
            apart = np.empty(self.load.size)
            for place, rest in enumerate(sample.equilibrium for sample in state.samples):
                other = SparseArray(rest.deviations, rest.lattice)
                forces = other.forces(rest.overlap, check=deadline.check)
                tensor, ours = other.elastic_tensor(forces, eta), rest.find_elasticity(eta)
                off = np.max(np.abs(tensor - ours)) / np.max(ours)
                apart[place] = max(abs(np.mean(forces) / rest.force - 1.0), 0.5 * off)
        return f"of one of {_write_shape(shape)}, {words} differ", apart


def _write_shape(shape: Sequence[int]) -> str:
    return " x ".join(map(str, shape))
