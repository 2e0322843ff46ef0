"""Error and time of the media, mean fields and simulations of several sizes, against a large ensemble of samples."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from granphon.base.errors import GranphonError
from granphon.base.progress import Step
from granphon.laws.effective import EffectiveLaw, effective_curve
from granphon.media.cost import estimate
from granphon.media.mean_field import AveragedForce, AveragedLattice, EffectiveMedium
from granphon.media.simulation import DirectSimulation
from granphon.tradeoffs.disorder import DisorderStudy
from granphon.tradeoffs.ensemble import Moments, observe
from granphon.tradeoffs.study import EPSILON, Deadline, Point, Reference

__all__ = ["MediaStudy"]

Array = NDArray[np.float64]
#: first seed of the reference's samples, far from the seeds of the points
_REFERENCE_SEED = 1_000_000
#: least number of samples of the reference
_LEAST_SAMPLES = 3
#: balls along a side of the sample that a sparse LU solves as well, as a check
_CHECKED_SIDE = 24
#: number of samples between two checks whether the reference is good enough
_SAMPLES_BETWEEN_LOOKS = 8


@dataclass(frozen=True)
class MediaStudy(DisorderStudy):
    """The media against the simulated array.

    ``sides`` and ``counts``: balls along a side of the samples of a simulation, and how many samples it has;
    ``reference_side``: balls along a side of the reference's samples.
    """

    name = "media"

    sides: tuple[int, ...] = (8, 16, 32, 64, 128)
    counts: tuple[int, ...] = (1, 4)
    reference_side: int = 64

    def make_points(self) -> list[Point]:
        """Return the points, in the order of their predicted times."""
        disorder, packing, solving = self.disorder, self.disorder.packing, self.disorder.solving

        def solve(medium: Any) -> Array:
            return observe(disorder.state(medium))[:, disorder.columns]

        def prepare_effective(make: Callable[[], EffectiveMedium]) -> Callable[[int], EffectiveMedium]:
            def prepare(run: int) -> EffectiveMedium:
                effective_curve.cache_clear()
                made = make()
                _ = made.law.curve if isinstance(made.law, EffectiveLaw) else None
                return made

            return prepare

        def prepare_simulation(side: int, samples: int) -> Callable[[int], DirectSimulation]:
            return lambda run: DirectSimulation(packing, (side, side), run * samples, samples)

        computed = prepare_effective(lambda: EffectiveMedium(packing))
        printed = prepare_effective(lambda: EffectiveMedium(packing, "paper"))
        found = [
            Point("averaged lattice", "ala", lambda run: AveragedLattice(packing), solve),
            Point("averaged force", "afa", lambda run: AveragedForce(packing), solve),
            Point("effective medium", "computed field", computed, solve, solving),
            Point("effective medium, paper's field", "printed field", printed, solve, solving),
        ]
        for samples in self.counts:
            for side in self.sides:
                prepare = prepare_simulation(side, samples)
                seconds = disorder.stopwatch.predict(estimate(prepare(0), disorder.load))
                method = f"simulation, {samples} sample{'s' if samples > 1 else ''}"
                found.append(Point(method, f"{side} x {side}", prepare, solve, seconds, random=True))
        return sorted(found, key=lambda point: point.seconds)

    def find_reference(self, deadline: Deadline, better: Callable[[Reference], bool], step: Step) -> Reference:
        """Simulate samples until the reference is good enough or the time is up.

        Equilibrium and response of one smaller sample are solved by a sparse LU too, as a check.
        """
        disorder = self.disorder
        sides = self.reference_side, self.reference_side
        moments = Moments(disorder.packing, disorder.load, sides, _REFERENCE_SEED)
        begun = deadline.stopwatch.now()
        apart = self.compare_solvers(deadline)
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
            raise GranphonError(f"the budget allows only {count} of its samples ({taken:.2g} s), which are too few.")
        return self._summarize(moments, apart)

    def _summarize(self, moments: Moments, apart: Array) -> Reference:
        """Return the reference from the samples so far; ``apart`` (n_loads,) is added to its errors in quadrature."""
        columns, ensemble = self.disorder.columns, moments.ensemble()
        errors = np.hypot(ensemble.errors, apart[:, None])
        balls = f"{ensemble.samples} samples of {self.reference_side} x {self.reference_side} balls"
        checked = (
            f"of one of {_CHECKED_SIDE} x {_CHECKED_SIDE}, equilibrium and response by sparse LU differ by"
            f" {np.max(apart):.0e}"
        )
        made = f"{balls} with control variates; {checked}"
        return Reference(ensemble.values[:, columns], errors[:, columns], made)

    def compare_solvers(self, deadline: Deadline) -> Array:
        """Return the relative difference (n_loads,) between a sample and its solution by another algorithm, a sparse LU.

        Raises :class:`~granphon.base.errors.GranphonError` if the deadline leaves no time for the samples of the reference.
        """
        from granphon.array.sparse import SparseArray

        disorder = self.disorder
        simulation = DirectSimulation(disorder.packing, (self.reference_side, self.reference_side), _REFERENCE_SEED)
        least = _LEAST_SAMPLES * deadline.stopwatch.predict(estimate(simulation, disorder.load))
        if least > deadline.left:
            raise GranphonError(f"its samples do not fit into the budget: {_LEAST_SAMPLES} take about {least:.2g} s.")
        state = disorder.state(DirectSimulation(disorder.packing, (_CHECKED_SIDE, _CHECKED_SIDE), _REFERENCE_SEED))
        apart = []
        for sample in state.samples:
            other = SparseArray(sample.equilibrium.deviations)
            forces = other.forces(sample.equilibrium.overlap, check=deadline.check)
            tensor = other.elastic_tensor(forces, disorder.packing.mindlin_ratio)
            ours = sample.elastic_tensor
            scale = sample.normal_stiffness / sample.equilibrium.stiffness / disorder.packing.diameter
            off = np.max(np.abs(scale * tensor - ours)) / np.max(ours)
            apart.append(max(abs(np.mean(forces) / sample.equilibrium.force - 1.0), 0.5 * off))
        return np.array(apart)

    def compute_errors(self, outcomes: Sequence[Any], reference: Reference) -> Array:
        """Return the rms over runs of the relative errors of a point, (n_loads, n_observed)."""
        return np.asarray(np.sqrt(np.mean([(outcome / reference.values - 1.0) ** 2 for outcome in outcomes], axis=0)))

    def find_floor(self, point: Point, outcomes: Sequence[Any]) -> float:
        """Return the least relative error that the point can have."""
        if not point.random:
            return EPSILON * self.disorder.condition
        return float(np.max(np.std(outcomes, axis=0, ddof=1) / np.mean(outcomes, axis=0)))
