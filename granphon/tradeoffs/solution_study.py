"""How exactly the effective medium must be solved, measured against a general integrator of differential equations."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray

from granphon.balls.distributions import Shape
from granphon.base.errors import GranphonError
from granphon.base.progress import Step
from granphon.laws.effective import EffectiveLaw, solve_curve
from granphon.laws.effective_curve import EffectiveCurve
from granphon.media.mean_field import EffectiveMedium
from granphon.tradeoffs.disorder import MOST_OPENINGS, DisorderStudy
from granphon.tradeoffs.study import EPSILON, Deadline, Point, Reference

Array = NDArray[np.float64]
#: tolerances of the collocation for each number of stages; with few stages, small ones take ever more steps
_TOLERANCES: Mapping[int, tuple[float, ...]] = {
    3: (1e-1, 1e-2, 1e-3, 1e-4), 6: (1e-1, 1e-2, 1e-4, 1e-6), 16: (1e-2, 1e-4, 1e-6, 1e-8, 1e-10),
}  # fmt: skip
#: relative tolerance of the integrator that makes the reference
_REFERENCE_TOLERANCE = 1e-13
#: a solution with a tolerance this many times larger gives the error of the reference
_COARSER = 100.0


@dataclass(frozen=True)
class SolutionStudy(DisorderStudy):
    """Stages and tolerance of the collocation of equation (36); errors are those of velocities at the same forces.

    ``tolerances``: the tolerances that are tried for each number of stages.
    """

    name = "effective medium"

    tolerances: Mapping[int, tuple[float, ...]] = field(default_factory=lambda: _TOLERANCES)

    @cached_property
    def _xi(self) -> float:
        """Local-field factor Xi of the lattice."""
        return EffectiveMedium(self.disorder.packing).local_field.xi

    def make_points(self) -> list[Point]:
        """Return the points: for each method, the cheapest setting of its knob first."""
        shape = self.disorder.shape

        def make_point(stages: int, tolerance: float) -> Point:
            def solve(_: Any) -> Array:
                law = _LawOfCurve(1.0, 1.0, shape, self._xi, solve_curve(shape, self._xi, stages, tolerance))
                return np.asarray(law.stiffness(law.overlap(self.disorder.forces)))

            return Point(f"{stages} stages", f"{tolerance:.0e}", lambda run: None, solve, self.disorder.solving)

        return [make_point(stages, tolerance) for stages, several in self.tolerances.items() for tolerance in several]

    def find_reference(self, deadline: Deadline, better: Callable[[Reference], bool], step: Step) -> Reference:
        """Follow the curve by scipy's integrator, at two tolerances."""
        from granphon.tradeoffs.references import integrate_curve

        shape: Shape = self.disorder.shape
        if shape.openings.size > MOST_OPENINGS:
            raise GranphonError(
                f"the diameters have {shape.openings.size} openings, at each of which the integration would start again."
            )
        coarse, fine = (
            integrate_curve(shape, self._xi, self.disorder.forces, tolerance, check=deadline.check)[1]
            for tolerance in (_COARSER * _REFERENCE_TOLERANCE, _REFERENCE_TOLERANCE)
        )
        errors = self.disorder.repeat(0.5 * (coarse / fine - 1.0))
        made = (
            f"a general integrator of differential equations; with a tolerance {_COARSER:g} times larger"
            f" it differs by {np.max(errors):.0e}"
        )
        return Reference(fine, np.maximum(errors, EPSILON), made)

    def compute_errors(self, outcomes: Sequence[Any], reference: Reference) -> Array:
        """Return the relative errors of a point, (n_loads, n_observed), from the outcomes of its runs."""
        return self.disorder.repeat(0.5 * (outcomes[0] / reference.values - 1.0))

    def find_floor(self, point: Point, outcomes: Sequence[Any]) -> float:
        """Return the least relative error that the point can have."""
        return EPSILON * self.disorder.condition


@dataclass(frozen=True)
class _LawOfCurve(EffectiveLaw):
    """The law of a curve that was solved in another way than :func:`~granphon.laws.effective.effective_curve` does."""

    own: EffectiveCurve

    @property
    def curve(self) -> EffectiveCurve:
        """The curve that was given."""
        return self.own
