"""The contact law of the effective medium: equation (36) of Velicky and Caroli, solved once for each shape and Xi.

In reduced units the mean displacement of the corona vanishes, <(F^Q - f)/(K^Q + Xi k)> = 0, when f = G(y, k), the mean of
F^Q with weights 1/(K^Q + Xi k); and k = df/dy. As a differential equation for k, k = dG(y, k(y))/dy, this is stiff: errors
in k decay towards low pressure, at a rate 1/(dG/dk), and grow without bound towards high pressure. So it is solved
downwards, from the high-pressure series that condition (40) selects, by collocation at Radau points (an implicit Runge-Kutta
method, L-stable, of order 2s - 1 at the ends of its steps). The unknown is k alone, G needs no derivative of K^Q, and on
each step the solution is a polynomial. Steps end at the openings, the overlaps at which the contacts of some pair of balls
open and k has a kink. Between two openings the variable is the square root of the distance to the lower one, in which k is
smooth.

A step needs one number from the step above it: k at their common end. So Newton's method solves many steps at once. To first
order the change of k at the lower end of a step is linear in the change at its upper end, and these relations are applied
one after the other, downwards.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import lru_cache
from itertools import pairwise
from typing import NamedTuple

import numpy as np
from numpy.polynomial import chebyshev
from numpy.typing import NDArray

from granphon.balls.distributions import NormalShape, PointShape, Shape, UniformShape
from granphon.base.errors import PrecisionError, message
from granphon.laws.averages import Block, DensityAverages, DensityBalls, PointAverages, PointBalls
from granphon.laws.effective_curve import LEAST_SOLVED_FORCE, VALID_FORCE, VANISHED, EffectiveCurve
from granphon.laws.spread import FORCE, STIFFNESS, CurveLaw, high_pressure_series

Array = NDArray[np.float64]
#: number of collocation (Radau) points on a step; its upper end is not counted
_STAGES = 16
#: tolerance of the last Chebyshev coefficients of k, relative to the least value of k on the step
_LAST_COEFFICIENTS = 1e-12
#: number of openings from which all steps are short, so that fewer points and a larger tolerance suffice
_MANY_OPENINGS = 100
#: number of collocation points on short steps
_STAGES_OF_SHORT = 12
#: tolerance of the last coefficients of k on short steps, relative to the least value of k
_LAST_OF_SHORT = 1e-10
#: nodes of the average over balls (see Shape.nodes)
_ORDER = 32
#: the lowest step of an interval is halved until the next opening below is at least this fraction of the step's extent in
#: y away: the nearer that opening, the less smooth is k
_NEAR = 0.15
#: largest change of k, relative to k, in the last iteration of Newton's method: convergence is quadratic, so the remaining
#: error is far smaller
_SETTLED = 1e-8
#: half length of the shortest step in the root, relative to its middle
_SHORTEST = 1e-12


@dataclass(frozen=True)
class EffectiveLaw(CurveLaw):
    """Contact law of the effective medium: balls displace their neighbours, and equation (36) holds.

    ``coefficient`` c (N/m^(3/2)) of equal balls, ``width`` W (m), ``shape`` of the distribution, ``xi`` the local-field
    factor. Energy is counted from the start of the curve. Methods raise :class:`~granphon.base.errors.PrecisionError`
    between the first contact and the start of the curve.
    """

    coefficient: float
    width: float
    shape: UniformShape | NormalShape | PointShape
    xi: float

    _valid_force, _medium = VALID_FORCE, "effective medium"

    @property
    def curve(self) -> EffectiveCurve:
        """Reduced law, in units of W and c W^(3/2)."""
        return effective_curve(self.shape, self.xi)

    def _refuse(self, what: str) -> PrecisionError:
        if not self.curve.stiffness_vanishes:
            return super()._refuse(what)
        why = "The stiffness is zero there, and equation (36) has no solution at smaller forces"
        return PrecisionError(message(what, why, "Raise the load"))


# -- the curve --------------------------------------------------------------------------------------------------------


@lru_cache(maxsize=64)
def effective_curve(shape: Shape, xi: float) -> EffectiveCurve:
    """Solve equation (36) for a shape and Xi; force and stiffness are right to 1e-8 or better from f* = 1e-4 on.

    Results are cached.

    Raises :class:`~granphon.base.errors.PrecisionError` if the steps do not settle where the medium is valid.
    """
    stages, tolerance = _STAGES, _LAST_COEFFICIENTS
    if shape.openings.size >= _MANY_OPENINGS:
        stages, tolerance = _STAGES_OF_SHORT, _LAST_OF_SHORT
    return solve_curve(shape, xi, stages, tolerance)


class RadauRule(NamedTuple):
    """Collocation rule on [-1, 1]: ``points`` (s + 1,) are the s Radau points, which include -1, followed by +1.

    Both matrices act on values at the points: ``derivative`` (s, s + 1) gives the derivative of the interpolating polynomial
    at the Radau points, ``coefficients`` (s + 1, s + 1) its Chebyshev series.
    """

    points: Array
    derivative: Array
    coefficients: Array


@lru_cache(maxsize=16)
def radau(stages: int) -> RadauRule:
    """Return the collocation rule with s = ``stages`` Radau points."""
    from scipy.special import roots_jacobi

    inner = roots_jacobi(stages - 1, 0.0, 1.0)[0] if stages > 1 else np.empty(0)
    points = np.concatenate([[-1.0], inner, [1.0]])
    inverse = np.linalg.inv(chebyshev.chebvander(points, stages))
    slopes = np.stack([chebyshev.chebval(points[:-1], chebyshev.chebder(column)) for column in inverse.T], axis=1)
    return RadauRule(points, slopes, inverse)


def solve_curve(
    shape: Shape, xi: float, stages: int, tolerance: float, most: float = np.inf, order: int = _ORDER
) -> EffectiveCurve:
    """Solve equation (36) for a shape and Xi with s = ``stages``; no step is longer than ``most`` in the square root.

    ``tolerance`` is the largest value of the last two Chebyshev coefficients of k, relative to the least k on the step;
    ``order`` is that of the quadrature over the balls of a density.
    Raises :class:`~granphon.base.errors.PrecisionError` if steps do not settle where the medium is valid.
    """
    averages = PointAverages(shape, xi) if isinstance(shape, PointShape) else DensityAverages(shape, xi, order)
    rule, far = radau(stages), high_pressure_series(shape, xi)
    pending = _divide_into_steps([*shape.openings.tolist(), far.start], most)
    first = pending[0][0]
    top, force = far.value(far.start, STIFFNESS), far.value(far.start, FORCE)
    places, series = [], []
    count, guess = 1, None
    while force > LEAST_SOLVED_FORCE and top * (pending[-1][0] - first + pending[-1][2] ** 2) > VANISHED * force:
        # where the first contact opens, force and stiffness are both zero: steps approach that end but do not include it
        if pending[-1][:2] == (first, 0.0):
            pending[-1:] = _halve(pending[-1])
            continue
        steps = [step for step in pending[: -count - 1 : -1] if step[:2] != (first, 0.0)]
        block = Block.of(steps, rule.points)
        if (fewer := averages.count(block)) < len(steps):
            count = fewer
            continue
        balls = averages.balls(block)
        # k/<K^Q> is smooth: start from that of the last attempt, or from a constant
        ratio = np.ones(block.y.shape) if guess is None else np.interp(block.y, *guess)
        found = _relax(balls, rule, block, balls.mean * ratio * (top / (balls.mean[0, -1] * ratio[0, -1])), top)
        if found is None:
            rough = np.ones(len(steps), bool)
        else:
            k, forces = found
            table = k @ rule.coefficients.T
            rough = np.max(np.abs(table[:, -2:]), axis=1) > np.maximum(tolerance, balls.noise) * np.min(k, axis=1)
        hopeless = np.any((block.half < _SHORTEST * block.middle)[rough])
        if len(steps) > 1 and (found is None or hopeless):
            count = len(steps) // 2
            continue
        if hopeless:  # doubles cannot tell apart the points of a shorter step
            if force < VALID_FORCE:
                break
            place = f"an overlap of {float(block.y[0, -1]):.6g} widths"
            raise PrecisionError(message(f"the effective medium does not converge below {place}", mend="Raise the load"))
        if np.any(rough):
            finer = [_halve(step) if bad else [step] for step, bad in zip(steps, rough.tolist(), strict=True)]
            pending[-len(steps) :] = [step for piece in reversed(finer) for step in piece]
            count = sum(map(len, finer))
            if found is not None:
                ascending = np.argsort(block.y, axis=None)
                guess = block.y.ravel()[ascending], (k / balls.mean).ravel()[ascending]
            continue
        kept = min(len(steps), 1 + int(np.count_nonzero(forces > LEAST_SOLVED_FORCE)))
        places.append(np.concatenate([block.origin, block.middle, block.half], axis=1)[:kept])
        series.append(table[:kept])
        top, force = float(k[kept - 1, 0]), float(forces[kept - 1])
        del pending[-len(steps) :]
        count, guess = 2 * count, None
    where, stiffness = (np.ascontiguousarray(np.concatenate(parts)[::-1].T) for parts in (places, series))
    return EffectiveCurve.of(shape, xi, far, where, stiffness, force)


def _divide_into_steps(ends: list[float], most: float) -> list[tuple[float, float, float]]:
    """Return the initial steps in ascending order, each as (origin, lower root, upper root)."""
    steps = []
    for below, origin, end in zip([-np.inf, *ends], ends[:-1], ends[1:], strict=False):
        high = math.sqrt(end - origin)
        cuts = [high]
        while origin - below < _NEAR * cuts[-1] ** 2:
            cuts.append(0.5 * cuts[-1])
        for low, high in pairwise([0.0, *reversed(cuts)]):
            parts = 2 ** math.ceil(math.log2(max(1.0, (high - low) / most)))
            steps += [(origin, *part) for part in pairwise(np.linspace(low, high, parts + 1).tolist())]
    return steps


def _halve(step: tuple[float, float, float]) -> list[tuple[float, float, float]]:
    origin, low, high = step
    return [(origin, low, 0.5 * (low + high)), (origin, 0.5 * (low + high), high)]


def _relax(
    balls: DensityBalls | PointBalls, rule: RadauRule, block: Block, k: Array, top: float
) -> tuple[Array, Array] | None:
    """Find k at the points of a block and the force at the lower ends, by Newton's method from ``k``; None if it fails."""
    rise = 2.0 * block.half * block.root[:, :-1]  # dy/dt
    inner, last = rule.derivative[:, :-1], rule.derivative[:, -1]
    k[:, -1] = np.append(top, k[:-1, 0])
    for _ in range(30):
        force, by_k, _ = balls.balance(k)
        matrix = inner * by_k[:, None, :-1] - rise[:, :, None] * np.eye(len(inner))
        miss = (k - balls.known)[:, :-1] * rise - force @ rule.derivative.T
        try:
            both = np.linalg.solve(matrix, np.stack([miss, -last * by_k[:, -1:]], axis=-1))
        except np.linalg.LinAlgError:
            return None
        changes = [0.0]  # of k at the ends of the steps
        for own, passed_on in both[:, 0].tolist():
            changes.append(own + passed_on * changes[-1])
        change = both[..., 0] + both[..., 1] * np.array(changes[:-1])[:, None]
        if not np.all(np.isfinite(change)):
            return None
        k[:, :-1] = np.maximum(k[:, :-1] + change, 0.1 * k[:, :-1])
        k[1:, -1] = k[:-1, 0]
        if np.all(np.abs(change) <= _SETTLED * k[:, :-1]):  # convergence is quadratic: no further iteration is needed
            return k, balls.balance(k)[2]
    return None
