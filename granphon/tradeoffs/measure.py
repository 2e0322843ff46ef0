"""Measure speed against accuracy: time and error of each medium, of simulations of several sizes
among them.

Each point of the study is a method with a knob, such as a simulation of so many balls. A point is
timed several times after a run to warm up. Its errors are the relative differences of the observed
quantities from those of the reference. The reference is an ensemble of samples, checked by another
algorithm. The study is a task (:mod:`granphon.runs.execution`) with a budget of time, and is kept
once it is finished.

Means over the ensemble have less scatter than the number of samples alone would leave. To second
order in the differences of diameters, the difference between one sample and the infinite array is
linear in the sample's own means of x^2 and of x x' over near pairs of balls. For the infinite array
these means are known exactly: the variance, and zero. A linear regression on them removes that part
of the scatter (control variates). At f* = 1 it leaves less than a fifth of the standard error,
above f* = 3 a tenth or less, and near the rigidity threshold almost all of it.
"""

from __future__ import annotations

import itertools
import json
import math
import statistics
import time
import tracemalloc
from collections.abc import Callable, Iterator, Mapping, Sequence
from concurrent.futures import Executor
from contextlib import suppress
from dataclasses import asdict, dataclass, replace
from functools import cached_property, lru_cache, partial
from typing import Any, ClassVar, Literal, NamedTuple, cast

import numpy as np
from numpy.typing import ArrayLike

from granphon.balls.diameters import PointShape, Spread
from granphon.balls.hertz import EXPONENT, FREQUENCY_EXPONENT
from granphon.balls.lattices import TRIANGULAR, Lattice
from granphon.balls.loads import Load
from granphon.balls.neighbours import TOUCH, select_once, steps_within
from granphon.balls.packing import Packing, given_packing
from granphon.base.arrays import Array
from granphon.base.errors import GranphonError, InputError, MechanismError
from granphon.base.progress import Progress, Step, require_progress, silent
from granphon.base.results import Result, held, result_class
from granphon.base.scales import write_quantity
from granphon.base.tables import table_text
from granphon.base.text import counted, digest
from granphon.base.threads import require_executor
from granphon.base.validation import (
    choice,
    each,
    number,
    require,
    require_instance,
    truth,
    whole,
)
from granphon.dynamics.elasticity import bulk_and_shear, longitudinal_modulus
from granphon.laws.effective import (
    STAGES_OF_SHORT,
    TOLERANCE_OF_SHORT,
    EffectiveLaw,
    effective_curve,
    solve_curve,
)
from granphon.media.array_options import REFERENCE_OPTIONS, REST, FrictionHistory
from granphon.media.choice import choose_shape
from granphon.media.cost import Cost, estimate, write_duration
from granphon.media.left_out import LATTICE
from granphon.media.medium import AveragedForce, AveragedLattice, EffectiveMedium
from granphon.media.simulation import DirectSimulation
from granphon.media.state import ContactState, ideal_lattice
from granphon.observables.velocities import local_exponent, sound_velocities
from granphon.runs.execution import Task, solve_all
from granphon.runs.finished_tasks import Store, TaskResult, require_store
from granphon.runs.tasks import to_json
from granphon.runs.workers import packages

#: quantities that are averaged, and whose errors are measured: velocities of long waves, and the
#: scale of frequencies
QUANTITIES = ("longitudinal", "transverse", "frequency")
#: distance, in diameters, up to which pairs of balls count as near
_REACH = 3.0
#: number of shells of near pairs that are controls: so many are within that distance on every
#: lattice
_N_SHELLS = 3
#: least number of samples for each coefficient of a regression: with fewer samples the regression
#: adds more scatter than it removes
_SAMPLES_PER_COEFFICIENT = 6
#: first seed of the reference's samples, far from the seeds of the points
_REFERENCE_SEED = 1_000_000
#: least number of samples of the reference
_LEAST_SAMPLES = 3
#: sides, in diameters, of the samples of points, with two and with three periods
_SIDES = {2: (8, 16, 32, 64, 128), 3: (4, 6, 10, 16, 24)}
#: sides, in diameters, of the samples of the reference
_REFERENCE_SIDES = {2: 64, 3: 14}
#: sides, in diameters, of the reference's samples if they are loaded with friction, which takes
#: many times longer
_LOADED_SIDES = {2: 32, 3: 8}
#: sides, in diameters, of the sample that factors of a list solve as well, as a check
_CHECKED_SIDES = {2: 24, 3: 6}
#: number of samples between two checks whether the reference is good enough; not less than
#: ``_LEAST_SAMPLES``
_SAMPLES_BETWEEN_LOOKS = 8
#: largest number of runs that the error of a random point is found from
_MOST_DRAWS = 100
#: a reference can judge a point if the error of the point is at least this many times that of the
#: reference
JUDGING_RATIO = 100.0
#: largest number of openings of a distribution with which solving the effective medium takes no
#: noticeable time
_MOST_QUICK_OPENINGS = 40
#: largest number of diameters in the list whose medium is solved to predict the time of a longer
#: list
_LENGTH_OF_SHORT = 20
#: power of the number of openings with which the time of solving the effective medium grows
_OPENINGS_POWER = 1.1
#: share of the time of a study in which points are measured; the rest is left to the reference
_POINTS_SHARE = 0.4
#: the next run is expected to take at most this many times as long as the runs before
_TIME_MARGIN = 1.5
#: time of the two runs of a point that are not timed, in units of a timed run: one run warms up,
#: and one is slower because its memory is watched
_UNTIMED_RUNS = 4.0
#: least number of timed runs of a point
LEAST_RUNS = 5
#: local fields of the effective medium
_Field = Literal["computed", "paper"]


def observe(state: ContactState) -> Array:
    """Return the :data:`QUANTITIES` of a state, (..., 3): two velocities in m/s, and (k/M)^(1/2) in
    1/s, with the stiffness k of a contact and the mass M of a ball.

    On a lattice with two periods the velocities are those along x. With three periods the
    velocities v are those of the moduli K and G averaged over all directions (W. Voigt, 1889), and
    of the density rho: rho v^2 is K + 4G/3 of longitudinal waves, and G of transverse waves.
    """
    frequency_scale = np.sqrt(state.normal_stiffness) / math.sqrt(state.packing.mass)
    if state.packing.structure.periods == 3:
        tensor = state.elastic_tensor
        density = np.asarray(state.effective_density)
        shear_modulus = bulk_and_shear(tensor)[..., 1]
        longitudinal = np.sqrt(longitudinal_modulus(tensor) / density)
        transverse = np.sqrt(shear_modulus / density)
    else:
        velocities = sound_velocities(state, (1.0, 0.0))
        longitudinal = velocities.longitudinal
        transverse = velocities.transverse
    return np.stack([longitudinal, transverse, frequency_scale], axis=-1)


class Ensemble:
    """Samples, and estimates of the infinite array from them: :meth:`add` samples, a few at a time,
    then ask for the :meth:`means`.

    All samples have the same ``packing``, whose lattice has two or three periods, and the same
    applied ``load`` (n_loads,). Their ``shape`` (L1, ..., Lp) is the numbers of cells along the p
    periods. Their seeds count from ``seed``, and their options are those of ``truth``. Bad values
    are refused by :meth:`add`, which raises what
    :class:`~granphon.media.simulation.DirectSimulation` raises.
    """

    def __init__(
        self,
        packing: Packing,
        load: Load,
        shape: tuple[int, ...],
        seed: int = 0,
        truth: FrictionHistory = REST,
    ) -> None:
        """Set up an ensemble without samples."""
        self.packing = packing
        self.load = load
        self.shape = shape
        self.seed = seed
        self.truth = truth
        #: for each sample an array (n_loads, 3) of the numbers that are averaged: rho v^2 of both
        #: velocities, Pa, and k, N/m, if samples share the overlap, or else 1/k, m/N
        self.moduli: list[Array] = []
        #: effective densities (n_loads,), kg/m^3, which all samples share; zero without samples
        self._densities = np.zeros(load.size)
        #: for each sample the controls (1 + n_shells,) of :func:`measure_excess`
        self._excess: list[Array] = []

    @property
    def samples(self) -> int:
        """Number of samples."""
        return len(self.moduli)

    @property
    def _shares_overlap(self) -> bool:
        """Whether all samples have the same overlap; otherwise all have the same force.

        As in a state of samples, k is averaged where samples share the overlap, and the compliance
        1/k where samples share the force.
        """
        return self.load.kind == "overlap"

    def add(self, count: int = 1) -> None:
        """Simulate ``count`` more samples, one or more, and keep their moduli and controls for the
        means.
        """
        first_seed = self.seed + self.samples
        simulation = DirectSimulation(
            self.packing, self.shape, first_seed, count, **self.truth.options
        )
        state = simulation.at(self.load)
        # Voigt tensors, Pa, and stiffnesses, N/m: both (n_loads, count, ...)
        tensors = state.over_samples(lambda sample: sample.elastic_tensor)
        k = state.over_samples(lambda sample: sample.normal_stiffness)
        longitudinal = longitudinal_modulus(tensors)
        shear = bulk_and_shear(tensors)[..., 1]
        k_or_compliance = k if self._shares_overlap else 1.0 / k
        moduli = np.stack([longitudinal, shear, k_or_compliance], axis=-1)
        self.moduli.extend(np.moveaxis(moduli, 1, 0))
        self._densities = np.asarray(state.effective_density)
        self._excess.extend(np.array(list(measure_excess(simulation))))

    def means(self) -> tuple[Array, Array]:
        """Return the :data:`QUANTITIES` (n_loads, 3), SI, of the infinite array, and their relative
        standard errors (n_loads, 3). There must be two samples or more: one has no scatter.
        """
        moduli = np.array(self.moduli)  # (n_samples, n_loads, 3)
        flat_moduli = moduli.reshape(self.samples, -1)
        flat_means, flat_errors = regress(flat_moduli, np.array(self._excess))
        means = flat_means.reshape(moduli.shape[1:])
        errors = flat_errors.reshape(moduli.shape[1:])
        # quantities are roots of moduli over densities, and of k over the mass of a ball
        masses = np.full(len(means), self.packing.mass)
        inertias = np.stack([self._densities, self._densities, masses], axis=1)
        # a modulus that vanishes may have a mean below zero, within its error
        squares = np.abs(means) / inertias
        if not self._shares_overlap:
            mean_compliances = means[:, 2]
            squares[:, 2] = 1.0 / mean_compliances / self.packing.mass
        return np.sqrt(squares), 0.5 * errors / np.abs(means)


def measure_excess(simulation: DirectSimulation) -> Iterator[Array]:
    """Yield for each sample an array (1 + n_shells,): the mean of x^2, and the means of x x' over
    each shell of near pairs, minus those of the infinite array. Here x are the deviations of
    diameters over the width of their distribution.
    """
    structure = simulation.packing.structure
    shells = find_near_pairs(structure)
    cell_axes = tuple(range(structure.periods))
    for index in range(simulation.samples):
        deviations = simulation.deviations(index)
        # (n_balls, L1, ..., Lp): the axis of the balls of the cell is there also for one ball
        x = deviations if structure.n_balls > 1 else deviations[None]
        # the width is sqrt 12 times the standard deviation: x has the variance 1/12
        excess = [np.mean(x * x) - 1.0 / 12.0]
        for shell in shells:
            products = []
            for i, j, shift in shell:
                products.append(np.mean(x[j] * np.roll(x[i], shift, cell_axes)))
            excess.append(np.mean(products))
        yield np.array(excess)


@lru_cache(maxsize=64)
def find_near_pairs(structure: Lattice) -> list[list[tuple[int, int, tuple[int, ...]]]]:
    """Return the pairs of near balls, a list for each of the first three shells. A pair is the
    number of ball i in its cell, the number of ball j in its cell, and the shift (p,), in cells,
    from the cell of ball i to that of ball j.

    Each pair counts once. Pairs at the same distance are one shell, and the shells are those of the
    smallest distances. The lists are kept for the next call, and must not be changed.
    """
    vectors = structure.positions[None] - structure.positions[:, None]
    reach = _REACH + float(np.max(np.linalg.norm(vectors, axis=-1)))
    steps = steps_within(structure.vectors, reach)  # (n_steps, p) cells
    distances = np.linalg.norm(vectors[:, :, None] + steps @ structure.vectors, axis=-1)
    is_other_ball = distances > 0.5  # a ball is not near itself
    # (n_pairs, 3): ball i, ball j, number of the step; each pair is there from both ends
    near_pairs = np.argwhere(is_other_ball & (distances < _REACH + TOUCH))
    once = select_once(near_pairs[:, 0], near_pairs[:, 1], steps[near_pairs[:, 2]])
    i, j, step_numbers = near_pairs[once].T
    radii = np.round(distances[i, j, step_numbers], 5)  # equal but for rounding is one shell
    shells = []
    for radius in np.unique(radii)[:_N_SHELLS]:
        pairs = np.flatnonzero(radii == radius)
        shifts = [tuple(shift) for shift in steps[step_numbers[pairs]].tolist()]
        shells.append(list(zip(i[pairs].tolist(), j[pairs].tolist(), shifts, strict=True)))
    return shells


def regress(values: Array, excess: Array) -> tuple[Array, Array]:
    """Return the means (n_columns,) of ``values`` (n_samples, n_columns) over two samples or more,
    and their standard errors (n_columns,).

    A linear regression on the ``excess`` (n_samples, n_controls) gives the means at zero excess. It
    has a coefficient for each control, and one for the mean. The means are plain ones if there are
    fewer than six samples for each coefficient, or if a control is zero in all samples.
    """
    n_samples, n_controls = excess.shape
    design = np.ones((n_samples, 1))
    scale = np.sqrt(np.mean(excess**2, axis=0))
    has_enough_samples = n_samples >= _SAMPLES_PER_COEFFICIENT * (n_controls + 1)
    if has_enough_samples and np.all(scale > 0.0):
        design = np.concatenate([design, excess / scale], axis=1)
    inverse = np.linalg.pinv(design)
    coefficients = inverse @ values  # the first row is the mean at zero excess
    residuals = values - design @ coefficients
    degrees_of_freedom = n_samples - design.shape[1]
    variances = np.sum(residuals**2, axis=0) / degrees_of_freedom
    return coefficients[0], np.sqrt(variances * np.sum(inverse[0] ** 2))


class Stopwatch:
    """Measures time and predicts what work will take, both in seconds.

    Everything in a trade-off that depends on time asks a stopwatch. A subclass that counts work
    instead of seconds makes budgets, and therefore results, independent of how busy the machine is.
    """

    def now(self) -> float:
        """Return the time since some fixed moment, s. The time must go on while a point runs."""
        return time.perf_counter()

    def predict(self, cost: Cost) -> float:
        """Return how long work of this estimated ``cost`` takes, s."""
        return cost.seconds


#: the stopwatch used unless another is given
WALL_CLOCK = Stopwatch()


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
        """Raise :class:`~granphon.base.errors.GranphonError` if the deadline has passed."""
        if self.left < 0.0:
            raise GranphonError("it does not fit into the budget.")


@dataclass(frozen=True)
class Point:
    """A method with one setting of its knob.

    Attributes
    ----------
    method, knob : the method, and the setting, in words.
    prepare : function that takes the number of a run and returns the argument of ``solve``; its
        time is not part of that of a run.
    solve : function that takes what ``prepare`` returned and returns the observed quantities
        (n_loads, n_observed), SI, which are compared with those of the reference.
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
    """The quantities by which points are judged: their ``values`` (n_loads, n_observed), SI, the
    relative ``errors`` of these, of the same shape, and ``made``, a text that says how they were
    found.
    """

    values: Any
    errors: Array
    made: str


@dataclass(frozen=True)
class MediaStudy:
    """The media against the simulated array, at rest without friction or loaded with friction.

    Attributes
    ----------
    packing, load : balls of different diameters, and the loads at which errors are measured.
    quantities : those of :data:`~granphon.tradeoffs.measure.QUANTITIES` whose errors are measured.
    stopwatch : measures all times.
    truth : how the simulated arrays come to their load by which media are judged.
    sides : sides, in diameters, of the samples of simulations; empty for those that belong to the
        dimension of the lattice.
    counts : numbers of samples of simulations; each is combined with each side.
    reference_side : side, in diameters, of the reference's samples; 0 for the one that belongs to
        the dimension of the lattice and to the ``truth``.
    """

    packing: Packing
    load: Load
    quantities: tuple[str, ...]
    stopwatch: Stopwatch = WALL_CLOCK
    truth: FrictionHistory = REST
    sides: tuple[int, ...] = ()
    counts: tuple[int, ...] = (1, 4)
    reference_side: int = 0

    @cached_property
    def _exact_load_numbers(self) -> list[int]:
        """Numbers, from 0, of the loads at which the arrays of the truth have their exact
        geometry.
        """
        simulation = DirectSimulation(self.packing, **self.truth.options)
        numbers = list[int]()
        for simulated, load_numbers in simulation.by_geometry(self.load):
            if simulated.is_exact:
                numbers.extend(load_numbers)
        return numbers

    @property
    def _columns(self) -> list[int]:
        """The observed ``quantities`` as indices of :data:`QUANTITIES`."""
        return [QUANTITIES.index(name) for name in self.quantities]

    def observe(self, medium: Any) -> Array:
        """Return the observed quantities of a medium, (n_loads, n_observed), SI, with finite
        overlap at the loads where the truth has finite overlap.
        """
        quantities = np.empty((self.load.size, len(QUANTITIES)))
        exact_numbers = self._exact_load_numbers
        other_numbers = [n for n in range(self.load.size) if n not in exact_numbers]
        # None is the default of a medium
        for load_numbers, finite_overlap in ((exact_numbers, True), (other_numbers, None)):
            if load_numbers:
                state = medium.at(self.load[load_numbers], finite_overlap=finite_overlap)
                quantities[load_numbers] = observe(state)
        return quantities[:, self._columns]

    @property
    def has_few_openings(self) -> bool:
        """Whether the distribution has so few openings, between which averages are smooth, that
        solving the effective medium takes no noticeable time.
        """
        shape = cast("Spread", self.packing.spread).shape
        return shape.openings.size <= _MOST_QUICK_OPENINGS

    @cached_property
    def solving_time(self) -> float:
        """Predicted time of solving the effective medium, s; zero for few openings. To predict it,
        the medium of a short list of diameters is solved and timed.
        """
        if self.has_few_openings:
            return 0.0
        # only listed diameters have many openings
        shape: Any = cast("Spread", self.packing.spread).shape
        even_steps = np.linspace(0, len(shape.positions) - 1, _LENGTH_OF_SHORT)
        x = np.array(shape.positions)[np.unique(even_steps.astype(int))]
        short_list = PointShape(tuple(x.tolist()), (1.0 / x.size,) * x.size)
        # solved as the curve of many openings is, at Xi = 1: the time hardly depends on Xi
        solve = partial(solve_curve, short_list, 1.0, STAGES_OF_SHORT, TOLERANCE_OF_SHORT)
        solve()  # warms up: the first solution of a process takes ten times longer
        start = self.stopwatch.now()
        solve()
        seconds = self.stopwatch.now() - start
        growth = shape.openings.size / short_list.openings.size
        return float(seconds * growth**_OPENINGS_POWER)

    @cached_property
    def condition(self) -> float:
        """Condition number of the velocities: one, for their own rounding, plus the largest factor,
        among the loads, by which relative errors of load and width act on them.
        """
        state: ContactState = AveragedForce(self.packing).at(self.load)
        if self.has_few_openings:
            with suppress(GranphonError):  # the loads may be below those of the effective medium
                state = EffectiveMedium(self.packing).at(self.load)
        by_force = np.asarray(local_exponent(state))  # d log v / d log f
        overlap = np.asarray(state.overlap)
        # with the force f, the overlap delta and the width W, the velocity v is f^(1/6) times a
        # function of f/W^(3/2), or W^(1/4) times a function of delta/W
        if self.load.kind == "overlap":
            by_load = by_force * overlap * state.normal_stiffness / state.force
            by_width = (EXPONENT - 1.0) / 2.0 - by_load
        else:
            by_load = by_force
            by_width = EXPONENT * (FREQUENCY_EXPONENT - by_force)
        factor_of_velocity = 1.0  # of the rounding of the velocity itself
        return float(factor_of_velocity + np.max(np.abs(by_load) + np.abs(by_width)))

    def make_points(self) -> list[Point]:
        """Return the points, in the order of their predicted times: those of both averages, of the
        effective medium, and of simulations.
        """

        def make_averaged_lattice(run: int) -> AveragedLattice:
            """Return the averaged lattice, the same for each run."""
            return AveragedLattice(self.packing)

        def make_averaged_force(run: int) -> AveragedForce:
            """Return the averaged force, the same for each run."""
            return AveragedForce(self.packing)

        points = [
            Point("averaged lattice", "ala", make_averaged_lattice, self.observe),
            Point("averaged force", "afa", make_averaged_force, self.observe),
            *self._make_effective_points(),
        ]
        structure = self.packing.structure
        sides = self.sides or _SIDES[structure.periods]
        histories = dict.fromkeys((REST, self.truth))  # each once: the truth may be at rest
        for history, samples, side in itertools.product(histories, self.counts, sides):
            shape = choose_shape(structure, side)
            points.append(self._make_simulated_point(history, samples, shape))
        return sorted(points, key=lambda point: point.seconds)

    def _make_effective_points(self) -> list[Point]:
        """Return the points of the effective medium: with its computed local field and, on the
        triangular lattice, with the local field that the paper prints.
        """
        packing = self.packing
        with suppress(GranphonError):
            # found once for all runs; a lattice that has none says so in its point
            _ = EffectiveMedium(packing).local_field

        def prepare(field_of_medium: _Field, run: int) -> EffectiveMedium:
            """Return the medium with its curve solved anew, for which the curves that are kept in
            this process are dropped.
            """
            effective_curve.cache_clear()
            medium = EffectiveMedium(packing, field_of_medium)
            _ = cast("EffectiveLaw", medium.law).curve  # solved when asked for
            return medium

        def make_point(method: str, knob: str, field_of_medium: _Field) -> Point:
            """Return the point of a local field, called by ``method`` and ``knob``."""
            prepared = partial(prepare, field_of_medium)
            return Point(method, knob, prepared, self.observe, self.solving_time)

        points = [make_point("effective medium", "computed field", "computed")]
        if packing.structure == TRIANGULAR:  # the paper prints no field of another lattice
            points.append(make_point("effective medium, paper's field", "printed field", "paper"))
        return points

    def _make_simulated_point(
        self, history: FrictionHistory, samples: int, shape: tuple[int, ...]
    ) -> Point:
        """Return the point of a simulation of so many ``samples`` of a ``shape`` (p,), in cells,
        that are loaded as ``history`` says.
        """

        def prepare(run: int) -> DirectSimulation:
            """Return the simulation of a run, whose samples no other run has."""
            first_seed = run * samples
            return DirectSimulation(self.packing, shape, first_seed, samples, **history.options)

        seconds = self.stopwatch.predict(estimate(prepare(0), self.load))
        simulation = "simulation with friction" if history.is_loaded else "simulation"
        method = f"{simulation}, {counted(samples, 'sample')}"
        return Point(method, _write_shape(shape), prepare, self.observe, seconds, random=True)

    def find_reference(
        self, deadline: Deadline, accepts: Callable[[Reference], bool], step: Step
    ) -> Reference:
        """Return the reference of samples that are simulated one after another; ``step`` is told of
        each sample.

        The samples end when ``accepts`` is true of the reference so far, which is asked after every
        eighth sample, or when a further sample may not end before the ``deadline``. One smaller
        sample is solved in another way too, as a check: see :meth:`compare`. Raises
        :class:`~granphon.base.errors.GranphonError` if there is no time for three samples and the
        check, and where a sample or the check fails.
        """
        now = deadline.stopwatch.now
        search_start = now()
        shape = self._reference_shape
        self._require_time_for_samples(shape, deadline)
        check, differences = self.compare(deadline)
        ensemble = Ensemble(self.packing, self.load, shape, _REFERENCE_SEED, self.truth)
        longest_time = 0.0
        while deadline.left > _TIME_MARGIN * longest_time:
            start = now()
            ensemble.add()
            step.advance()
            longest_time = max(longest_time, now() - start)
            if ensemble.samples % _SAMPLES_BETWEEN_LOOKS == 0:
                reference = self._summarise(ensemble, check, differences)
                if accepts(reference):
                    return reference
        if ensemble.samples < _LEAST_SAMPLES:
            spent = write_duration(now() - search_start)
            raise GranphonError(
                f"the budget allows only {ensemble.samples} of its samples ({spent}), which"
                f" are too few."
            )
        return self._summarise(ensemble, check, differences)

    def _require_time_for_samples(self, shape: tuple[int, ...], deadline: Deadline) -> None:
        """Raise :class:`~granphon.base.errors.GranphonError` if three samples of the reference, of
        a ``shape`` (p,) in cells, are predicted to take longer than the time left.
        """
        simulation = DirectSimulation(self.packing, shape, _REFERENCE_SEED, **self.truth.options)
        sample_time = deadline.stopwatch.predict(estimate(simulation, self.load))
        least_time = _LEAST_SAMPLES * sample_time
        if least_time > deadline.left:
            raise GranphonError(
                f"its samples do not fit into the budget: {_LEAST_SAMPLES} take about"
                f" {write_duration(least_time)}."
            )

    @property
    def _reference_shape(self) -> tuple[int, ...]:
        """Numbers of cells (p,) of the reference's samples."""
        structure = self.packing.structure
        sides = _LOADED_SIDES if self.truth.is_loaded else _REFERENCE_SIDES
        return choose_shape(structure, self.reference_side or sides[structure.periods])

    def _summarise(self, ensemble: Ensemble, check: str, differences: Array) -> Reference:
        """Return the reference from the samples of the ``ensemble`` so far.

        ``check`` and ``differences`` (n_loads,) are those of :meth:`compare`; the differences add
        to the errors in quadrature.
        """
        means, mean_errors = ensemble.means()
        observed_means = means[:, self._columns]
        errors = np.hypot(mean_errors[:, self._columns], differences[:, None])
        unit = "balls" if self.packing.structure.n_balls == 1 else "cells"
        words = (
            f"{ensemble.samples} samples of {_write_shape(ensemble.shape)} {unit}"
            f" {self.truth.words}, with control variates"
        )
        made = f"{words}; {check} by {np.max(differences):.0e}"
        return Reference(observed_means, errors, made)

    def compare(self, deadline: Deadline) -> tuple[str, Array]:
        """Return a text that says what differs where a small sample of the truth is solved by
        another method too, and the largest relative differences (n_loads,).

        A sample that is loaded with friction is loaded once more, in shorter steps. For a sample at
        rest, equilibrium and response are found by another algorithm, factors of a list of
        contacts; both have the directions of the lattice. Raises
        :class:`~granphon.base.errors.GranphonError` if the ``deadline`` has passed before the
        second solution of a load, and where a solution fails.
        """
        structure = self.packing.structure
        shape = choose_shape(structure, _CHECKED_SIDES[structure.periods])
        if self.truth.is_loaded:
            words = "velocities in steps of a tenth of the tolerance"
            differences = self._compare_steps(shape, deadline)
        else:
            words = "equilibrium and response by factors"
            differences = self._compare_factors(shape, deadline)
        return f"of one of {_write_shape(shape)}, {words} differ", differences

    def _compare_steps(self, shape: tuple[int, ...], deadline: Deadline) -> Array:
        """Return the largest relative differences (n_loads,) of the observed quantities between two
        ways of loading a sample: in steps of the tolerance, and in steps of a tenth of it. Raises
        :class:`~granphon.base.errors.GranphonError` if the ``deadline`` has passed before the
        shorter steps.
        """
        simulation = DirectSimulation(self.packing, shape, _REFERENCE_SEED, **self.truth.options)
        finer_simulation = replace(simulation, step_tolerance=0.1 * simulation.step_tolerance)
        quantities = self.observe(simulation)
        deadline.check()
        ratio = quantities / self.observe(finer_simulation)
        return np.asarray(np.max(np.abs(ratio - 1.0), axis=-1))

    def _compare_factors(self, shape: tuple[int, ...], deadline: Deadline) -> Array:
        """Return the relative differences (n_loads,) of a sample at rest that is solved by factors
        of a list of its contacts as well: the larger of those of the mean force and of velocities.
        Raises :class:`~granphon.base.errors.GranphonError` if the ``deadline`` has passed before
        the factors of a load.
        """
        from granphon.array.rest import equilibrate_by_factors, find_tensor_by_factors

        eta = self.packing.mindlin_ratio
        simulation = DirectSimulation(self.packing, shape, _REFERENCE_SEED, geometry=LATTICE)
        state = simulation.at(self.load)
        differences = np.empty(self.load.size)
        for load_number, sample in enumerate(state.samples):
            equilibrium = sample.equilibrium
            deadline.check()
            by_factors = equilibrate_by_factors(equilibrium)
            tensor = find_tensor_by_factors(by_factors, eta)
            expected_tensor = equilibrium.find_elasticity(eta)
            force_difference = abs(by_factors.force / equilibrium.force - 1.0)
            largest_modulus = np.max(expected_tensor)
            tensor_difference = np.max(np.abs(tensor - expected_tensor)) / largest_modulus
            velocity_difference = 0.5 * tensor_difference  # velocities are roots of moduli
            differences[load_number] = max(force_difference, velocity_difference)
        return differences


def _write_shape(shape: Sequence[int]) -> str:
    """Return the numbers of cells ``shape`` as text, such as "64 x 64"."""
    return " x ".join(map(str, shape))


def _is_judged(error: float, reference_error: float) -> bool:
    """Return whether a reference with the relative ``reference_error`` can judge an ``error``: is
    at least :data:`JUDGING_RATIO` times better. It cannot if a number is nan.
    """
    return error >= JUDGING_RATIO * reference_error


@result_class
class MeasuredPoint(Result):
    """Errors, times and memory of one point of the study.

    Attributes
    ----------
    method, knob : the method, and the setting of its knob.
    errors : relative errors against the reference, (n_loads, n_observed); empty if there is a
        ``failure``.
    reference_errors : relative errors of that reference itself, of the shape of ``errors``.
    seconds, spread : median time of the timed runs, and half the range of their middle half, s; 0
        if the point was not run.
    setup : median time of what is prepared before a run, s; 0 if the point was not run.
    memory : largest amount of memory that was allocated at one moment of a run, bytes; 0 if the
        point was not run.
    floor : least relative error possible: condition number times rounding, or, if runs are
        ``random``, the largest scatter of a quantity over runs, relative to its mean; 0 without
        errors.
    random : whether every run draws other random numbers; False if the point was not run.
    failure : why the point was not run, or has no errors for want of a reference; otherwise empty.
    stderrs : standard errors of ``errors``, of the same shape: if runs are ``random``, the errors
        are rms over runs; otherwise 0.
    draws : number of runs from which the errors are found, or would be found with a reference; 0
        if the point was not run.
    """

    units: ClassVar[dict[str, str]] = {
        "errors": "1",
        "reference_errors": "1",
        "stderrs": "1",
        "floor": "1",
        "seconds": "s",
        "spread": "s",
        "setup": "s",
        "memory": "B",
    }

    method: str = held(str)
    knob: str = held(str)
    errors: Array = held(float, "*")
    reference_errors: Array = held(float, "*")
    seconds: float = held(float, default=0.0)
    spread: float = held(float, default=0.0)
    setup: float = held(float, default=0.0)
    memory: int = held(int, default=0)
    floor: float = held(float, default=0.0)
    random: bool = held(bool, default=False)
    failure: str = held(str, default="")
    stderrs: Array = held(float, "*", default_factory=lambda: np.zeros(0))
    draws: int = held(int, default=0)

    @property
    def ran(self) -> bool:
        """Whether the point was run, with or without a reference to judge it by."""
        return self.draws > 0

    @property
    def error(self) -> float:
        """The largest of the relative errors; 0 without errors."""
        return float(np.max(self.errors, initial=0.0))

    @property
    def stderr(self) -> float:
        """Standard error of :attr:`error`, which is an rms if runs are random; 0 if the runs are
        not random, and without errors.
        """
        if not self.stderrs.size:
            return 0.0
        return float(self.stderrs.flat[int(np.argmax(self.errors))])

    @property
    def reference_error(self) -> float:
        """Relative error of the reference where the point's error is largest; 0 without errors."""
        if not self.errors.size:
            return 0.0
        return float(self.reference_errors.flat[int(np.argmax(self.errors))])

    @property
    def resolved(self) -> bool:
        """Whether the point has errors, and the reference is at least a hundred times better where
        they are largest.
        """
        return not self.failure and _is_judged(self.error, self.reference_error)

    @property
    def note(self) -> str:
        """Why the point failed, or how much better the reference is if it is not :attr:`resolved`;
        otherwise empty.
        """
        if self.failure:
            return self.failure
        if self.resolved:
            return ""
        if not self.error > self.reference_error:  # an error may be nan
            return "the error is not above that of the reference"
        return f"the reference is {self.error / self.reference_error:.2g} times better"


@result_class
class TradeOff(Result):
    """Results of a trade-off.

    Attributes
    ----------
    points : all points, including those that were not run.
    kind, loads : kind of the loads at which errors were measured ("force", "pressure", "overlap"),
        and their values, SI.
    observed : names of the quantities whose errors were measured, in the order of the errors.
    reference : how the reference was made; empty if there is none.
    runs : number of timed runs of each point.
    seconds : time that measuring took, s.
    budget : time that it could take, s.
    """

    units: ClassVar[dict[str, str]] = {"seconds": "s", "budget": "s"}

    points: tuple[MeasuredPoint, ...] = held((MeasuredPoint, ...))
    kind: str = held(str)
    loads: tuple[float, ...] = held((float, ...))
    observed: tuple[str, ...] = held((str, ...))
    reference: str = held(str)
    runs: int = held(int)
    seconds: float = held(float)
    budget: float = held(float)

    def csv(self) -> str:
        """Return a table (CSV) with one row for each point, load and observed quantity.

        A point without errors has one row, with the reason.
        """
        headings = (
            "method",
            "knob",
            self.kind,
            "observed",
            "error (1)",
            "error_stderr (1)",
            "draws",
            "reference_error (1)",
            "resolved",
            "seconds (s)",
            "spread (s)",
            "setup (s)",
            "memory (B)",
            "floor (1)",
            "failure",
        )
        rows: list[list[Any]] = []
        for point in self.points:
            rows.extend(self._list_rows(point))
        return table_text(headings, rows)

    def _list_rows(self, point: MeasuredPoint) -> Iterator[list[Any]]:
        """Yield the rows of a point in the table of :meth:`csv`."""
        name_entries = [point.method, point.knob]
        cost_entries = [point.seconds, point.spread, point.setup, point.memory, point.floor]
        if point.failure:
            # of load, quantity, error, its error, draws, error of the reference, resolved
            blanks = ["", "", "", "", "", "", ""]
            costs_or_blanks = cost_entries if point.ran else ["" for _ in cost_entries]
            yield [*name_entries, *blanks, *costs_or_blanks, point.failure]
            return
        pairs = itertools.product(enumerate(self.loads), enumerate(self.observed))
        for (row, load), (column, quantity) in pairs:
            error = float(point.errors[row, column])
            stderr = float(point.stderrs[row, column])
            reference_error = float(point.reference_errors[row, column])
            is_judged = _is_judged(error, reference_error)
            error_entries = [error, stderr, point.draws, reference_error, is_judged]
            yield [*name_entries, load, quantity, *error_entries, *cost_entries, ""]


def tradeoff(
    packing: Packing,
    *,
    force: ArrayLike | None = None,
    pressure: ArrayLike | None = None,
    overlap: ArrayLike | None = None,
    observe: Sequence[str] = ("velocities",),
    finite_overlap: bool = False,
    friction_history: bool = False,
    friction_coefficient: float | None = REST.friction_coefficient,
    shear_response: str = REST.shear_response,
    budget: float = 180.0,
    most_loads: int = 3,
    runs: int = LEAST_RUNS,
    progress: Progress = silent,
    stopwatch: Stopwatch = WALL_CLOCK,
    executor: Executor | None = None,
    store: Store | None = None,
) -> TradeOff:
    """Measure time and error of the media, of simulations of several sizes among them.

    Parameters
    ----------
    packing : the balls.
    force, pressure, overlap : the loads, N, N/m (Pa in space) or m; one of the three.
    observe : "velocities", "bands", "dos": the quantities whose errors are measured. For bands and
        densities of states, media are judged by the scale of frequencies.
    finite_overlap : only False: the arrays that media are judged by decide at which loads results
        have finite overlap, those at which they have their exact geometry.
    friction_history, friction_coefficient, shear_response : whether media are judged by arrays
        loaded with friction, and how, as of a :class:`~granphon.DirectSimulation`; by default by
        arrays at rest without friction.
    budget : time that measuring may take, 1e-3 to 1e9 s. What does not fit is listed as not run.
    most_loads : largest number of loads, 1 to 1000; of more loads the smallest, the largest and
        some between are taken. One means the smallest load, where media differ most.
    runs : how often each point is timed, 5 to 1000.
    progress : is told what is under way.
    stopwatch : a :class:`~granphon.tradeoffs.measure.Stopwatch`, which measures all times; a
        subclass may count work instead of seconds.
    executor : does the study, a task that measures time where it runs. Times are meaningful on a
        machine that does nothing else.
    store : where the finished study is kept; a finished study of the same trade-off found there
        is returned. The caller clears the store.

    Returns
    -------
    :class:`TradeOff`.

    Raises
    ------
    InputError : something else than a :class:`~granphon.Packing`; no load, two loads, or one that
        is not valid; equal balls, as all media are exact then; balls on a line, on a lattice or
        with motions that are not simulated, in a plane whose sound is not isotropic, or with finite
        overlap, where media have no reference; a history without a friction coefficient, an option
        of a history without a history, or one that is not valid; a budget, a number of loads or a
        number of runs out of range; no list of words, or an unknown word in ``observe``; a flag
        that is no truth value; an executor without ``submit``; a ``progress``, ``stopwatch`` or
        ``store`` of another kind.
    FileExistsInRunError : ``store`` holds finished studies of another trade-off, or tasks of a
        sweep.
    """
    applied = Load.only(force=force, pressure=pressure, overlap=overlap)
    given_packing(packing)
    _require_tools(progress, stopwatch, executor, store)
    require("runs", partial(whole, low=LEAST_RUNS, high=1000), runs)
    require("most_loads", partial(whole, low=1, high=1000), most_loads)
    budget = require("budget", partial(number, low=1e-3, high=1e9), budget)
    word = partial(choice, options=("velocities", "bands", "dos"))
    observe = require("observe", partial(each, rule=word, what="words"), observe)
    require("finite_overlap", truth, finite_overlap)
    history_values = (friction_history, friction_coefficient, shear_response)
    options = dict(zip(REFERENCE_OPTIONS, history_values, strict=True))
    against = require("tradeoff", FrictionHistory.read, options)
    _require_comparable(packing, finite_overlap, against)
    loads = _thin_out(np.unique(applied.array), most_loads)
    quantities = _list_quantities(observe)
    study = MediaStudy(packing, Load(applied.kind, loads), quantities, stopwatch, against)
    identity = {
        "trade-off of": packing,
        applied.kind: loads,
        "observe": observe,
        "finite_overlap": finite_overlap,
        "against": asdict(against),
        "budget": budget,
        "runs": runs,
        "versions": packages(),
    }
    return carry_out(study, budget, runs, progress, executor, store, json.loads(to_json(identity)))


def _require_tools(
    progress: Progress, stopwatch: Stopwatch, executor: Executor | None, store: Store | None
) -> None:
    """Raise :class:`~granphon.base.errors.InputError` for what is of another kind than what a
    trade-off is carried out with; ``executor`` and ``store`` may be None.
    """
    require_executor(executor)
    require_progress(progress)
    require_instance("stopwatch", stopwatch, Stopwatch, "Give a Stopwatch")
    if store is not None:
        require_store(store)


def _list_quantities(observe: Sequence[str]) -> tuple[str, ...]:
    """Return those of the :data:`QUANTITIES` that the words ``observe`` ask for, each once."""
    quantities: tuple[str, ...] = ()
    if "velocities" in observe:
        quantities += ("longitudinal", "transverse")
    if "bands" in observe or "dos" in observe:
        quantities += ("frequency",)
    return quantities


def _thin_out(loads: Array, most: int) -> Array:
    """Return at most ``most`` of the ascending ``loads`` (n,): the smallest, the largest and some
    between, whose indices have even steps; for one, the smallest.
    """
    if loads.size <= most:
        return loads
    even_steps = np.linspace(0, loads.size - 1, most)
    indices = np.unique(np.rint(even_steps).astype(int))
    return np.asarray(loads[indices])


def _require_comparable(packing: Packing, finite_overlap: bool, against: FrictionHistory) -> None:
    """Raise :class:`~granphon.base.errors.InputError` for equal balls, for ``finite_overlap``, for
    balls on a line, where no array can be simulated that is loaded as ``against`` says, and for a
    plane in which sound is not isotropic.
    """
    if not packing.width:
        why = "All media are exact for them, and equally fast"
        raise InputError("equal balls leave nothing to compare", why, "Give the packing a spread")
    structure = packing.structure
    if finite_overlap:
        why = (
            "The simulated arrays that media are judged by have it at the loads where their"
            " geometry is exact, and only there"
        )
        raise InputError("media are not compared with finite overlap", why, "Leave it out")
    problem = f"media are not compared on the {structure.name} lattice"
    mend = "Use another lattice"
    if structure.periods == 1:
        why = "On a line all contacts carry the same force, and every medium is exact"
        raise InputError(problem, why, mend)
    try:
        DirectSimulation(packing, (1,) * structure.periods, **against.options)
    except MechanismError as error:
        raise InputError(problem, f"Their reference is the simulated array: {error}") from None
    except GranphonError as error:
        refused = "media are not compared for these balls"
        raise InputError(refused, f"Their reference is the simulated array: {error}") from None
    if structure.periods == 2 and not ideal_lattice(packing).is_isotropic:
        why = "In the plane velocities are compared where sound is isotropic"
        raise InputError(problem, why, mend)


def carry_out(
    study: MediaStudy,
    budget: float,
    runs: int = LEAST_RUNS,
    progress: Progress = silent,
    executor: Executor | None = None,
    store: Store | None = None,
    identity: Mapping[str, Any] | None = None,
) -> TradeOff:
    """Return the results of a study that is carried out within a ``budget``, s on the study's
    stopwatch, by an ``executor``; each point is timed ``runs`` times, two or more.

    ``progress`` is told of the steps of the study, or, with an executor, of its end alone. A
    finished study is kept in a ``store``, which is claimed for the ``identity`` of the trade-off,
    plain data; a study that is found there is returned. Raises
    :class:`~granphon.base.errors.FileExistsInRunError` if the store holds other tasks.
    """
    # a study in another process cannot tell its steps
    is_in_process = executor is None
    progress_of_study = progress if is_in_process else silent
    progress_of_tasks = silent if is_in_process else progress
    task = _StudyTask(study, f"study-{digest(identity)}", budget, runs, progress_of_study)
    if store is not None:
        store.claim(identity or {}, lambda: [task.name])
    (result,) = solve_all("trade-off", [task], executor, progress_of_tasks, store)
    points = [MeasuredPoint.from_dict(json.loads(text)) for text in result["points"].tolist()]
    reference = result["made"].item() if result["made"].size else ""
    return TradeOff(
        points=tuple(points),
        kind=study.load.kind,
        loads=study.load.values,
        observed=study.quantities,
        reference=reference,
        runs=runs,
        seconds=float(result["seconds"].item()),
        budget=float(budget),
    )


class _Runs(NamedTuple):
    """The runs of a point: their outcomes, times of solving and preparing (s), and memory
    (bytes).
    """

    outcomes: list[Any]
    seconds: list[float]
    setups: list[float]
    memory: int = 0


class _BudgetError(Exception):
    """Says in its text that the time left is too short to run a point."""


@dataclass(frozen=True, eq=False)
class _StudyTask(Task):
    """A study as a task; its result holds the points as JSON texts, and its time.

    Attributes
    ----------
    study : what is measured.
    name : the name under which a store keeps the result.
    seconds : the time that the study may take, s on its stopwatch.
    runs : number of timed runs of each point.
    progress : is told of the steps of the study.
    where, kind : the name of the task in messages, and the kind of tasks that take similar times.
    """

    study: MediaStudy
    name: str
    seconds: float
    runs: int
    progress: Progress = silent
    where: str = "study of media"
    kind: str = where

    def solve(self, begun: TaskResult | None = None) -> TaskResult:
        """Return the result of the study: "points", the measured points as JSON texts; "made", how
        the reference was made, empty without a reference; and "seconds", the time of the study, s.

        Points are measured in the first part of the time, and the reference is found in the rest.
        The reference is not sought if no point was run. A study is one step, so that nothing is
        ``begun`` before it.
        """
        study = self.study
        now = study.stopwatch.now
        start = now()
        deadline = Deadline(study.stopwatch, start + self.seconds)
        points_deadline = Deadline(study.stopwatch, start + _POINTS_SHARE * self.seconds)
        points = study.make_points()
        runs_of_point, failures = self._run_points(points, points_deadline)
        reference = None
        problem = ""  # why there is no reference
        if runs_of_point:
            with self.progress.step("media: reference") as step:
                judges_all = partial(_judges_all, list(runs_of_point.values()))
                try:
                    reference = study.find_reference(deadline, judges_all, step)
                except GranphonError as error:
                    problem = f"there is no reference: {error}"
        texts = []
        for point in points:
            if point in runs_of_point:
                measured = self._measure(point, runs_of_point[point], reference, problem)
            else:
                measured = MeasuredPoint(
                    point.method, point.knob, np.zeros(0), np.zeros(0), failure=failures[point]
                )
            texts.append(json.dumps(measured.to_dict()))
        made = [reference.made] if reference else []
        return {
            "points": np.array(texts, str),
            "made": np.array(made, str),
            "seconds": np.array(now() - start),
        }

    def _run_points(
        self, points: Sequence[Point], deadline: Deadline
    ) -> tuple[dict[Point, _Runs], dict[Point, str]]:
        """Return the runs of those of the ``points`` that fit before the ``deadline``, by point,
        and why the others were not run or failed, by point.

        Half of the time that is left then is used for further runs of random points, as few runs do
        not tell their rms error.
        """
        runs_of_point = dict[Point, _Runs]()
        failures = dict[Point, str]()
        times_of_method = dict[str, float]()
        with self.progress.step("media", len(points)) as step:
            for point in points:
                # a knob that is turned further takes longer
                least_time = max(point.seconds, times_of_method.get(point.method, 0.0))
                try:
                    runs = self._run(point, least_time, deadline)
                    runs_of_point[point] = runs
                    times_of_method[point.method] = statistics.median(runs.seconds)
                except _BudgetError as error:
                    failures[point] = str(error)
                    # the further settings of the method would take even longer
                    times_of_method[point.method] = math.inf
                except GranphonError as error:
                    failures[point] = str(error)
                step.advance()
            random_points = {point: runs for point, runs in runs_of_point.items() if point.random}
            _run_random_points(random_points, deadline)
        return runs_of_point, failures

    def _run(self, point: Point, least_time: float, deadline: Deadline) -> _Runs:
        """Return the runs of a point whose run takes ``least_time``, s, or more: it is run once to
        warm up, then timed, then once with its memory watched.

        Raises :class:`_BudgetError` if there is no time for these runs until the ``deadline``, as
        ``least_time`` or the first run tells, and :class:`~granphon.base.errors.GranphonError`
        where the method fails.
        """
        now = self.study.stopwatch.now
        self._require_time(least_time, deadline)
        start = now()
        point.solve(point.prepare(0))
        self._require_time(now() - start, deadline)
        runs = _Runs([], [], [])
        for run in range(1, self.runs + 1):
            start = now()
            prepared = point.prepare(run)
            solve_start = now()
            runs.outcomes.append(point.solve(prepared))
            runs.seconds.append(now() - solve_start)
            runs.setups.append(solve_start - start)
        return runs._replace(memory=_watch_memory(point))

    def _require_time(self, seconds: float, deadline: Deadline) -> None:
        """Raise :class:`_BudgetError` if the runs of a point, of so many ``seconds`` each, would
        not end by the ``deadline``.
        """
        if (self.runs + _UNTIMED_RUNS) * seconds <= deadline.left:
            return
        problem = "not run, beyond the budget"
        # infinite after a run of the method that did not fit; a time below 1 ms explains nothing
        if 1e-3 < seconds < math.inf:
            problem += f": {self.runs} runs of about {write_quantity(seconds, 's', 2)}"
        raise _BudgetError(problem)

    def _measure(
        self, point: Point, runs: _Runs, reference: Reference | None, problem: str
    ) -> MeasuredPoint:
        """Return the errors and times of a ``point`` with its ``runs``; without a ``reference``
        there are no errors, and the ``problem`` says why there is none.
        """
        lower_quartile, median, upper_quartile = statistics.quantiles(runs.seconds, n=4)
        measured = MeasuredPoint(
            point.method,
            point.knob,
            errors=np.zeros(0),
            reference_errors=np.zeros(0),
            seconds=median,
            spread=0.5 * (upper_quartile - lower_quartile),
            setup=statistics.median(runs.setups),
            memory=runs.memory,
            random=point.random,
            failure=problem,
            draws=len(runs.outcomes),
        )
        if reference is None:
            return measured
        squares = _square_errors(runs, reference)
        errors = np.sqrt(np.mean(squares, axis=0))
        stderrs = np.zeros_like(errors)
        floor = float(np.finfo(float).eps) * self.study.condition
        if point.random:
            stderrs = _find_standard_errors(squares, errors)
            scatter = np.std(runs.outcomes, axis=0, ddof=1) / np.mean(runs.outcomes, axis=0)
            floor = float(np.max(scatter))
        return replace(
            measured,
            errors=errors,
            reference_errors=reference.errors,
            stderrs=stderrs,
            floor=floor,
            failure="",
        )


def _watch_memory(point: Point) -> int:
    """Run a ``point`` once more, and return the largest memory at one moment that Python's
    allocators have given since the run began, bytes. A trace of memory that is under way goes on,
    but its peak is that of this run.
    """
    is_traced = tracemalloc.is_tracing()
    if not is_traced:
        tracemalloc.start()
    try:
        tracemalloc.reset_peak()
        memory_before, _ = tracemalloc.get_traced_memory()
        point.solve(point.prepare(0))
        _, peak = tracemalloc.get_traced_memory()
        return peak - memory_before
    finally:
        if not is_traced:
            tracemalloc.stop()


def _run_random_points(runs_of_point: Mapping[Point, _Runs], deadline: Deadline) -> None:
    """Run random points again, without timing, in half of the time left until the ``deadline``, and
    append the outcomes to their :class:`_Runs`, until a point has ``_MOST_DRAWS`` outcomes, those
    of its timed runs included. A point of which a run fails keeps the outcomes before that run.
    """
    now = deadline.stopwatch.now
    last_end = now() + 0.5 * deadline.left
    for index, (point, runs) in enumerate(runs_of_point.items()):
        time_of_run = statistics.median(runs.seconds) + statistics.median(runs.setups)
        n_points_left = len(runs_of_point) - index
        end = now() + (last_end - now()) / n_points_left  # points share the time that is left
        # a run may take longer than the median
        while len(runs.outcomes) < _MOST_DRAWS and now() + _TIME_MARGIN * time_of_run < end:
            run = len(runs.outcomes) + 1
            try:
                outcome = point.solve(point.prepare(run))
            except GranphonError:  # the same run would fail again
                break
            runs.outcomes.append(outcome)


def _square_errors(runs: _Runs, reference: Reference) -> Array:
    """Return the squares of the relative errors of all runs of a point, (n, n_loads,
    n_observed).
    """
    return np.asarray(np.square(np.array(runs.outcomes) / reference.values - 1.0))


def _find_standard_errors(squares: Array, errors: Array) -> Array:
    """Return the standard errors of ``errors``, which are the roots of the means of ``squares``
    (n, ...) over n runs, two at least; zero of an error of zero, of which all squares are zero.
    """
    errors_of_means = np.std(squares, axis=0, ddof=1) / math.sqrt(len(squares))
    stderrs = np.zeros_like(errors)
    np.divide(errors_of_means, 2.0 * errors, out=stderrs, where=errors > 0.0)
    return stderrs


def _judges_all(runs_of_points: Sequence[_Runs], reference: Reference) -> bool:
    """Return whether the ``reference`` can judge every point, each given by its runs, where the
    error of the point is largest.
    """
    for runs in runs_of_points:
        errors = np.sqrt(np.mean(_square_errors(runs, reference), axis=0))
        largest = int(np.argmax(errors))
        if not _is_judged(float(errors.flat[largest]), float(reference.errors.flat[largest])):
            return False
    return True
