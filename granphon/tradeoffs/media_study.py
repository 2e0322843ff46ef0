"""Error and time of the media, mean fields and simulations of several sizes, against a large ensemble of samples."""

from __future__ import annotations

import itertools
from collections.abc import Callable, Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from typing import Any, ClassVar

import numpy as np
from numpy.typing import NDArray

from granphon.balls.lattices import TRIANGULAR
from granphon.balls.loads import Load
from granphon.balls.packing import Packing
from granphon.base.errors import GranphonError, InputError, message
from granphon.base.progress import Step
from granphon.laws.effective import EffectiveLaw, effective_curve
from granphon.media.choice import even_shape
from granphon.media.cost import estimate, write_duration
from granphon.media.friction_history import REST, FrictionHistory
from granphon.media.left_out import LATTICE
from granphon.media.loaded_lattice import ideal_lattice
from granphon.media.mean_field import AveragedForce, AveragedLattice, EffectiveMedium
from granphon.media.simulation import DirectSimulation
from granphon.tradeoffs.disorder import Disorder
from granphon.tradeoffs.ensemble import QUANTITIES, Moments
from granphon.tradeoffs.study import EPSILON, SECONDS, Deadline, Point, Reference, Stopwatch

Array = NDArray[np.float64]
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


@dataclass(frozen=True)
class MediaStudy:
    """The media against the simulated array, at rest without friction or loaded with friction.

    ``sides`` and ``counts``: sides, in diameters, of the samples of a simulation, and how many samples it has;
    ``reference_side``: side of the reference's samples. By default sides are those for the dimension of the lattice.
    """

    name: ClassVar[str] = "media"

    disorder: Disorder
    sides: tuple[int, ...] = ()
    counts: tuple[int, ...] = (1, 4)
    reference_side: int = 0

    @property
    def observed(self) -> tuple[str, ...]:
        """Names of the quantities whose errors are measured."""
        return self.disorder.quantities

    @property
    def loads(self) -> tuple[float, ...]:
        """Loads at which errors are measured, SI."""
        return self.disorder.load.values

    def shape(self, side: float) -> tuple[int, ...]:
        """Return the numbers of cells of a sample whose sides are about ``side`` diameters."""
        return even_shape(self.disorder.packing.structure, side)

    @property
    def reference_shape(self) -> tuple[int, ...]:
        """Numbers of cells of the reference's samples."""
        sides = _LOADED_SIDES if self.disorder.truth.is_loaded else _REFERENCE_SIDES
        return self.shape(self.reference_side or sides[self._periods])

    @property
    def checked_shape(self) -> tuple[int, ...]:
        """Numbers of cells of the sample that a sparse LU solves as well."""
        return self.shape(_CHECKED_SIDES[self._periods])

    @property
    def _periods(self) -> int:
        return self.disorder.packing.structure.periods

    def make_points(self) -> list[Point]:
        """Return the points, in the order of their predicted times."""
        disorder, packing, solving = self.disorder, self.disorder.packing, self.disorder.solving
        with suppress(GranphonError):  # found once for all runs; a lattice that has none says so in its point
            _ = EffectiveMedium(packing).local_field

        def prepare_effective(make: Callable[[], EffectiveMedium]) -> Callable[[int], EffectiveMedium]:
            def prepare(run: int) -> EffectiveMedium:
                effective_curve.cache_clear()
                made = make()
                _ = made.law.curve if isinstance(made.law, EffectiveLaw) else None
                return made

            return prepare

        def prepare_simulation(
            shape: tuple[int, ...], samples: int, of: FrictionHistory
        ) -> Callable[[int], DirectSimulation]:
            return lambda run: DirectSimulation(packing, shape, run * samples, samples, **of.options)

        computed = prepare_effective(lambda: EffectiveMedium(packing))
        printed = prepare_effective(lambda: EffectiveMedium(packing, "paper"))
        found = [
            Point("averaged lattice", "ala", lambda run: AveragedLattice(packing), disorder.observe),
            Point("averaged force", "afa", lambda run: AveragedForce(packing), disorder.observe),
            Point("effective medium", "computed field", computed, disorder.observe, solving),
        ]
        if packing.structure == TRIANGULAR:  # the paper prints no field of another lattice
            found.append(Point("effective medium, paper's field", "printed field", printed, disorder.observe, solving))
        shapes = [self.shape(side) for side in self.sides or _SIDES[self._periods]]
        for of, samples, shape in itertools.product(dict.fromkeys((REST, disorder.truth)), self.counts, shapes):
            prepare = prepare_simulation(shape, samples, of)
            seconds = disorder.stopwatch.predict(estimate(prepare(0), disorder.load))
            method = f"simulation{' with friction' * of.is_loaded}, {samples} sample{'s' if samples > 1 else ''}"
            found.append(Point(method, _write_shape(shape), prepare, disorder.observe, seconds, random=True))
        return sorted(found, key=lambda point: point.seconds)

    def find_reference(self, deadline: Deadline, better: Callable[[Reference], bool], step: Step) -> Reference:
        """Simulate samples until ``better`` accepts the reference or the time is up.

        Equilibrium and response of one smaller sample are solved by a sparse LU too, as a check; or, if samples are loaded
        with friction, in shorter steps. Raises :class:`~granphon.base.errors.GranphonError` if there is no time for it.
        """
        disorder = self.disorder
        moments = Moments(disorder.packing, disorder.load, self.reference_shape, _REFERENCE_SEED, disorder.truth)
        begun = deadline.stopwatch.now()
        simulation = DirectSimulation(disorder.packing, self.reference_shape, _REFERENCE_SEED, **disorder.truth.options)
        least = _LEAST_SAMPLES * deadline.stopwatch.predict(estimate(simulation, disorder.load))
        if least > deadline.left:
            raise GranphonError(
                f"its samples do not fit into the budget: {_LEAST_SAMPLES} take about {write_duration(least)}."
            )
        apart = self.compare_steps() if disorder.truth.is_loaded else self.compare_solvers(deadline)
        longest, count = 0.0, 0
        while deadline.left > 1.5 * longest:
            start = deadline.stopwatch.now()
            moments.add()
            step.advance()
            longest, count = max(longest, deadline.stopwatch.now() - start), count + 1
            enough = count >= _LEAST_SAMPLES and count % _SAMPLES_BETWEEN_LOOKS == 0
            if enough and better(self._summarize(moments, apart)):
                break
        if count < _LEAST_SAMPLES:
            taken = deadline.stopwatch.now() - begun
            raise GranphonError(
                f"the budget allows only {count} of its samples ({write_duration(taken)}), which are too few."
            )
        return self._summarize(moments, apart)

    def _summarize(self, moments: Moments, apart: Array) -> Reference:
        """Return the reference from the samples so far; ``apart`` (n_loads,) is added to its errors in quadrature."""
        columns, ensemble = self.disorder.columns, moments.ensemble()
        errors = np.hypot(ensemble.errors, apart[:, None])
        each = "balls" if self.disorder.packing.structure.n_balls == 1 else "cells"
        balls = f"{ensemble.samples} samples of {_write_shape(self.reference_shape)} {each}"
        loaded = self.disorder.truth.is_loaded
        other = "velocities in steps of a tenth of the tolerance" if loaded else "equilibrium and response by sparse LU"
        checked = f"of one of {_write_shape(self.checked_shape)}, {other} differ by {np.max(apart):.0e}"
        made = f"{balls} {self.disorder.truth.words}, with control variates; {checked}"
        return Reference(ensemble.values[:, columns], errors[:, columns], made)

    def compare_steps(self) -> Array:
        """Return the relative difference (n_loads,) between a sample loaded with friction and the same in shorter steps."""
        disorder, options = self.disorder, self.disorder.truth.options
        own = DirectSimulation(disorder.packing, self.checked_shape, _REFERENCE_SEED, **options)
        fine = replace(own, step_tolerance=_SHORTER * own.step_tolerance)
        ratio = disorder.observe(own) / disorder.observe(fine)
        return np.asarray(np.max(np.abs(ratio - 1.0), axis=-1))

    def compare_solvers(self, deadline: Deadline) -> Array:
        """Return the relative difference (n_loads,) between a sample and its solution by another algorithm, a sparse LU.

        Both have the directions of the lattice, which the other algorithm knows alone.
        """
        from granphon.array.sparse import SparseArray

        disorder = self.disorder
        state = disorder.state(DirectSimulation(disorder.packing, self.checked_shape, _REFERENCE_SEED, geometry=LATTICE))
        apart, eta = [], disorder.packing.mindlin_ratio
        for rest in (sample.equilibrium for sample in state.samples):
            other = SparseArray(rest.deviations, rest.lattice)
            forces = other.forces(rest.overlap, check=deadline.check)
            tensor, ours = other.elastic_tensor(forces, eta), rest.find_elasticity(eta)
            off = np.max(np.abs(tensor - ours)) / np.max(ours)
            apart.append(max(abs(np.mean(forces) / rest.force - 1.0), 0.5 * off))
        return np.array(apart)

    def compute_errors(self, outcomes: Sequence[Any], reference: Reference) -> Array:
        """Return the rms over runs of the relative errors of a point, (n_loads, n_observed)."""
        return np.asarray(np.sqrt(np.mean([(outcome / reference.values - 1.0) ** 2 for outcome in outcomes], axis=0)))

    def find_floor(self, point: Point, outcomes: Sequence[Any]) -> float:
        """Return the least error that the point can have: condition number times rounding, or the scatter of random runs."""
        if not point.random:
            return EPSILON * self.disorder.condition
        return float(np.max(np.std(outcomes, axis=0, ddof=1) / np.mean(outcomes, axis=0)))


def choose_study(
    packing: Packing,
    load: Load,
    observe: tuple[str, ...],
    finite_overlap: bool = False,
    stopwatch: Stopwatch = SECONDS,
    truth: FrictionHistory = REST,
) -> MediaStudy:
    """Return the study of a packing; see :func:`granphon.tradeoffs.measure.tradeoff`, which says what it raises."""
    if not packing.width:
        why = "All media are exact for them, and equally fast"
        raise InputError(message("equal balls leave nothing to compare", why, "Give the packing a spread"))
    # balls that differ need a simulated array by which media are judged
    structure = packing.structure
    where, mend, why = f"on the {structure.name} lattice", "Use another lattice, or leave the spread out", ""
    if finite_overlap:
        where, mend = "with finite overlap", "Leave finite_overlap out, or the spread"
        why = "Their reference is the simulated array, which has the paper's limit only"
    elif structure.periods == 1:
        why = "On a line all contacts carry the same force, and every medium is exact"
    else:
        try:
            DirectSimulation(packing, (1,) * structure.periods, **truth.options)
        except GranphonError as error:
            told = f"Their reference is the simulated array: {error}"
            raise InputError(message(f"media are not compared {where}", told)) from None
        if structure.periods == 2 and not ideal_lattice(packing).is_isotropic:
            why = "In the plane velocities are compared where sound is isotropic"
    if why:
        raise InputError(message(f"media are not compared {where}", why, mend))
    spectra = bool({"bands", "dos"} & set(observe))
    asked = {"frequency": spectra, "longitudinal": "velocities" in observe, "transverse": "velocities" in observe}
    quantities = tuple(name for name in QUANTITIES if asked[name])
    return MediaStudy(Disorder(packing, load, quantities, stopwatch, truth))


def _write_shape(shape: Sequence[int]) -> str:
    return " x ".join(map(str, shape))
