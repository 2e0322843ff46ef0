"""How fine a grid of wave vectors the lattice's Green's function needs, measured against adaptive quadrature."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray

from granphon.balls.lattices import TRIANGULAR
from granphon.base.errors import GranphonError, InputError
from granphon.base.progress import Step
from granphon.dynamics.local_field import local_field_on
from granphon.laws.effective import EffectiveLaw
from granphon.media.cost import write_duration
from granphon.media.mean_field import EffectiveMedium
from granphon.tradeoffs.disorder import DisorderStudy
from granphon.tradeoffs.study import EPSILON, Deadline, Point, Reference, leave_out

Array = NDArray[np.float64]
#: kinds of grids
_METHODS = ("graded triangles", "uniform grid")
#: number of effective media that are solved to find how an error of Xi changes a velocity
_SOLUTIONS = 3
#: relative change of Xi in the finite difference
_XI_STEP = 1e-3


@dataclass(frozen=True)
class GridStudy(DisorderStudy):
    """Grids that give the local-field factor Xi; errors are those of velocities that errors of Xi cause, to first order.

    ``graded`` and ``uniform``: points along a side of grids refined towards the singularity at Gamma, and of uniform grids.
    """

    name = "Green's function"

    graded: tuple[int, ...] = (2, 3, 4, 6, 8, 12)
    uniform: tuple[int, ...] = (4, 8, 16, 32, 64, 128, 256)

    @cached_property
    def _sensitivity(self) -> Array:
        """Sensitivity d log v / d log Xi at each load, (n_loads,)."""
        disorder, law = self.disorder, EffectiveMedium(self.disorder.packing).law
        if not isinstance(law, EffectiveLaw):
            raise InputError("the balls are equal.")
        k = []
        for factor in (1.0 - _XI_STEP, 1.0 + _XI_STEP):
            other = EffectiveLaw(law.coefficient, law.width, law.shape, factor * law.xi)
            given = disorder.effective
            overlap = given.overlap if disorder.load.kind == "overlap" else other.overlap(given.force)
            k.append(np.asarray(other.stiffness(overlap)))
        return np.asarray(0.5 * (k[1] - k[0]) / (k[1] + k[0]) / _XI_STEP)

    def make_points(self) -> list[Point]:
        """Return the points: for each method, the cheapest setting of its knob first; on the triangular lattice only."""
        if self.disorder.packing.structure != TRIANGULAR:
            why = "fixed grids, and the quadrature that judges them, are those of the triangular lattice"
            return [leave_out(method, why) for method in _METHODS]
        eta = self.disorder.packing.mindlin_ratio

        def prepare(run: int) -> None:
            return None

        def make_point(method: str, number: int, graded: bool) -> Point:
            return Point(method, f"{number}", prepare, lambda ready: local_field_on(number, eta, graded))

        graded = [make_point(_METHODS[0], number, True) for number in self.graded]
        return graded + [make_point(_METHODS[1], number, False) for number in self.uniform]

    def find_reference(self, deadline: Deadline, better: Callable[[Reference], bool], step: Step) -> Reference:
        """Integrate the Green's function by adaptive quadrature."""
        from granphon.tradeoffs.references import integrate_local_field

        if (least := _SOLUTIONS * self.disorder.solving) > deadline.left:
            raise GranphonError(
                f"its {_SOLUTIONS} effective media do not fit into the budget: they take about {write_duration(least)}."
            )
        xi, error = integrate_local_field(self.disorder.packing.mindlin_ratio)
        errors = self.disorder.repeat(self._sensitivity * error / xi)
        return Reference(xi, errors, f"adaptive quadrature of the Green's function, Xi = {xi:.12g} to {error:.0e}")

    def compute_errors(self, outcomes: Sequence[Any], reference: Reference) -> Array:
        """Return the relative errors of a point, (n_loads, n_observed), from the outcomes of its runs."""
        return self.disorder.repeat(self._sensitivity * (outcomes[0] / reference.values - 1.0))

    def find_floor(self, point: Point, outcomes: Sequence[Any]) -> float:
        """Return the least relative error that the point can have."""
        # Xi = 1/u_1 - 1 loses digits where it is small; the last term is the rounding of the velocity itself
        return float(np.max(np.abs(self._sensitivity)) * EPSILON * (1.0 + 1.0 / outcomes[0])) + EPSILON
