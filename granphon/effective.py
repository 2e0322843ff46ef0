"""The effective medium's law: equation (36) of Velicky and Caroli solved as a curve, once for a shape and a Xi.

In reduced units the mean displacement of the corona vanishes, <(F^Q - f)/(K^Q + Xi k)> = 0, when f = G(y, k), the mean of
F^Q with weights 1/(K^Q + Xi k); and k = df/dy. As a differential equation for k, k = dG(y, k(y))/dy, this is stiff: errors
in k decay towards low pressure, at a rate 1/(dG/dk), and blow up the other way. So it is solved downwards, from the
high-pressure series that condition (40) selects, by collocation at Radau points (an implicit Runge-Kutta method, L-stable,
of order 2s - 1 at the ends of its steps). The unknown is k alone, G needs no derivative of K^Q, and on each step the
solution is a polynomial. Steps end where contacts of some pair of balls open and k has a kink; on each interval the
variable is the square root of the distance to the opening below, in which k is smooth.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property, lru_cache
from itertools import pairwise
from typing import NamedTuple

import numpy as np
from numpy.polynomial import chebyshev
from numpy.typing import NDArray

from granphon.errors import PrecisionError, message
from granphon.laws import ENERGY, FORCE, SLOPE, STIFFNESS, Series, SpreadLaw, high_pressure_series
from granphon.shapes import NormalShape, PointShape, Shape, UniformShape

__all__ = ["EffectiveCurve", "EffectiveLaw", "effective_curve"]

Array = NDArray[np.float64]
#: the curve ends where f* has fallen to this, far below the paper's limit of validity
LEAST_FORCE = 1e-6
#: the limit of validity that Section IV states
VALID_FORCE = 0.08
#: points of collocation on a step, without its upper end; fewer where openings leave short steps only
_STAGES, _FEWER, _MANY = 16, 12, 100
#: nodes of the average over balls (see Shape.nodes)
_ORDER = 32
#: what the last coefficients of k may be, relative to its least value on the step
_TOLERANCE = 1e-12
#: what rounding may make of that, where a few balls differ very much from the rest
_WORST = 1e-8


class _Rule(NamedTuple):
    """Collocation on [-1, 1]: ``points`` (s + 1,), the Radau points, which include -1, and then +1.

    ``derivative`` (s, s + 1) of the polynomial through values at the points, at the Radau points; ``coefficients``
    (s + 1, s + 1) of its Chebyshev series.
    """

    points: Array
    derivative: Array
    coefficients: Array


@lru_cache(maxsize=16)
def _radau(stages: int) -> _Rule:
    from scipy.special import roots_jacobi

    inner = roots_jacobi(stages - 1, 0.0, 1.0)[0] if stages > 1 else np.empty(0)
    points = np.concatenate([[-1.0], inner, [1.0]])
    inverse = np.linalg.inv(chebyshev.chebvander(points, stages))
    slopes = np.stack([chebyshev.chebval(points[:-1], chebyshev.chebder(column)) for column in inverse.T], axis=1)
    return _Rule(points, slopes, inverse)


@dataclass(frozen=True)
class _Step:
    """y = ``origin`` + u^2, u = ``middle`` + ``half`` t: Chebyshev series in t, -1 <= t <= 1, of energy and derivatives.

    The slope of the stiffness is the fourth series, plus the fifth over dy/dt, which vanishes where contacts open.
    """

    origin: float
    middle: float
    half: float
    series: tuple[Array, ...]

    @classmethod
    def of(cls, place: tuple[float, float, float], stiffness: Array, force: float, energy: float, kink: bool) -> _Step:
        """From the series of k, with force and energy at the lower end: both are integrals, and k their exact derivative.

        ``kink``: where contacts open k rises as a square root, and not as its fifth power.
        """
        _, middle, half = place
        rise = np.array([2.0 * half * middle, 2.0 * half * half])  # dy/dt
        forces = chebyshev.chebint(chebyshev.chebmul(stiffness, rise), lbnd=-1.0, k=[force])
        energies = chebyshev.chebint(chebyshev.chebmul(forces, rise), lbnd=-1.0, k=[energy])
        quotient, numerator = np.zeros(1), chebyshev.chebder(stiffness)
        if middle == half:
            quotient, numerator = chebyshev.chebdiv(numerator, rise)
        series = (energies, forces, stiffness, quotient, numerator * (kink or middle > half))
        return cls(*place, tuple(np.asarray(one, float) for one in series))

    @property
    def start(self) -> float:
        """The least y."""
        return self.origin + (self.middle - self.half) ** 2

    def value(self, root: Array, order: int) -> Array:
        """A derivative of the energy at u = ``root``."""
        t = (root - self.middle) / self.half
        values = np.asarray(chebyshev.chebval(t, self.series[order]), float)
        if order == SLOPE and np.any(self.series[-1]):
            values += chebyshev.chebval(t, self.series[-1]) / (2.0 * self.half * root)
        return values

    def top(self, order: int) -> float:
        """A derivative of the energy at the upper end."""
        return float(np.sum(self.series[order]))

    def overlap(self, force: Array) -> Array:
        """y at forces between those at the ends: a series for u, mended by Newton's method."""
        series, ends = self._inverse
        w = self._smooth(force)
        root = np.asarray(chebyshev.chebval((2.0 * w - ends[0] - ends[1]) / (ends[1] - ends[0]), series), float)
        return np.asarray(self.origin + self._descended(root, force) ** 2)

    @cached_property
    def _inverse(self) -> tuple[Array, tuple[float, float]]:
        """Chebyshev series of u in the variable of :meth:`_smooth`, and the ends of the latter."""
        low, high = self._smooth(np.array([self.bottom, self.top(FORCE)]))
        w = 0.5 * (low + high) + 0.5 * (high - low) * chebyshev.chebpts1(_STAGES)
        force = np.square(w) + self.bottom if self.middle == self.half else np.exp(w)
        u = self.middle + self.half * np.linspace(-1.0, 1.0, 33)
        exact = self._descended(np.interp(force, self.value(u, FORCE), u), force)
        series = chebyshev.chebfit(chebyshev.chebpts1(_STAGES), exact, _STAGES - 1)
        return np.asarray(series, float), (float(low), float(high))

    @cached_property
    def bottom(self) -> float:
        """The force at the lower end."""
        return float(self.value(np.array(self.middle - self.half), FORCE))

    def _smooth(self, force: Array) -> Array:
        """A variable in which u is smooth: where contacts open the force rises as u^2, elsewhere it may span decades."""
        return np.sqrt(np.maximum(force - self.bottom, 0.0)) if self.middle == self.half else np.log(force)

    def _descended(self, root: Array, force: Array) -> Array:
        """u at these forces, by Newton's method from ``root``."""
        low, high = self.middle - self.half, self.middle + self.half
        for _ in range(12):
            slope = 2.0 * root * self.value(root, STIFFNESS)
            change = np.divide(force - self.value(root, FORCE), slope, out=np.zeros_like(root), where=slope > 0.0)
            root = np.clip(root + change, low, high)
            if np.all(np.abs(change) <= 1e-9 * high):  # convergence is quadratic: this was the last one needed
                break
        return root


@dataclass(frozen=True, eq=False)
class EffectiveCurve:
    """The solution for one shape and Xi: steps, ascending, and the series beyond them.

    It begins at f* = 1e-6, or higher, below the limit of validity, where steps no longer settle in double precision.
    """

    shape: Shape
    xi: float
    steps: tuple[_Step, ...]
    far: Series

    @cached_property
    def least_force(self) -> float:
        """f* at the start of the curve."""
        return max(LEAST_FORCE, self.steps[0].bottom)

    @cached_property
    def start(self) -> float:
        """y at the start of the curve."""
        return float(self.steps[0].overlap(np.array([self.least_force]))[0])

    @cached_property
    def energy_offset(self) -> float:
        """Energy of the curve over that of the series, where they meet."""
        return self.steps[-1].top(ENERGY) - self.far.value(self.far.start, ENERGY)

    @cached_property
    def _edges(self) -> tuple[Array, Array]:
        """y and f* where steps meet."""
        return np.array([step.start for step in self.steps[1:]]), np.array([s.top(FORCE) for s in self.steps[:-1]])

    def value(self, y: Array, order: int) -> Array:
        """A derivative of the energy, counted from the start of the curve, at y between that and ``far.start``."""
        # a kink belongs to the step below it, where the slope is finite
        index = np.searchsorted(self._edges[0], y)
        return self._by_step(index, y, lambda step, part: step.value(np.sqrt(part - step.origin), order))

    def overlap(self, force: Array) -> Array:
        """y at forces between those at the two ends."""
        return self._by_step(np.searchsorted(self._edges[1], force), force, _Step.overlap)

    def _by_step(self, index: NDArray[np.intp], values: Array, of: Callable[[_Step, Array], Array]) -> Array:
        # sorted by step, so that each works on one piece; small integers sort in linear time
        order = np.argsort(index.ravel().astype(np.min_scalar_type(len(self.steps))), kind="stable")
        ascending, numbers = values.ravel()[order], index.ravel()[order]
        out = np.empty(order.size)
        first = np.flatnonzero(np.append(True, numbers[1:] != numbers[:-1])) if numbers.size else np.empty(0, int)
        for begin, end in pairwise([*first.tolist(), order.size]):
            out[order[begin:end]] = of(self.steps[numbers[begin]], ascending[begin:end])
        return out.reshape(values.shape)


@lru_cache(maxsize=64)
def effective_curve(shape: Shape, xi: float) -> EffectiveCurve:
    """Solve equation (36) for a shape and Xi, to 1e-8 or better in force and stiffness from f* = 1e-4 on; kept.

    Raises :class:`~granphon.errors.PrecisionError` if the steps do not settle where the medium is valid.
    """
    return _solved(shape, xi, _STAGES if shape.openings.size < _MANY else _FEWER, _ORDER, _TOLERANCE)


def _solved(shape: Shape, xi: float, stages: int, order: int, tolerance: float, most: float = np.inf) -> EffectiveCurve:
    """The solution with a given rule; steps in the square root are no longer than ``most``."""
    far = high_pressure_series(shape, xi)
    ends: list[float] = []
    for opening in [*shape.openings.tolist(), far.start]:  # those that doubles can tell apart
        if not ends or opening - ends[-1] > 1e-10 * max(1.0, abs(opening)):
            ends.append(opening)
    stiffness = far.value(far.start, STIFFNESS)
    found: list[tuple[float, float, float, Array]] = []  # origin, middle, half, series of k, descending
    force, least = far.value(far.start, FORCE), LEAST_FORCE
    for origin, end in reversed(list(pairwise(ends))):
        high, length = np.sqrt(end - origin), np.inf
        while high > 0.0 and force > least:
            # where the first contact opens there is neither force nor stiffness: that end is approached only
            length = min(length, most, 0.5 * high if origin == ends[0] else high)
            roots = high - length, high
            solved = _collocated(shape, xi, (origin, end), roots, stiffness, stages, order, tolerance)
            if solved is None:
                length *= 0.5
                # neither the root nor y holds the points of a shorter one
                if length < 1e-14 * np.sqrt(end - origin) or length * high < 1e-13 * max(abs(origin), abs(end)):
                    if force < VALID_FORCE:
                        least = force
                        break
                    where = f"an overlap of {origin + high**2:.6g} widths"
                    raise PrecisionError(message(f"the effective medium has no settled solution below {where}"))
                continue
            series, stiffness, force = solved
            found.append((origin, high - 0.5 * length, 0.5 * length, series))
            high, length = high - length, 2.0 * length
    steps: list[_Step] = []
    energy = 0.0
    for origin, middle, half, series in reversed(found):
        steps.append(_Step.of((origin, middle, half), series, force, energy, isinstance(shape, PointShape)))
        force, energy = steps[-1].top(FORCE), steps[-1].top(ENERGY)
    # rounding alone separates the two here; without it there is no seam
    scale = far.value(far.start, FORCE) / force
    return EffectiveCurve(shape, xi, tuple(_scaled(step, scale) for step in steps), far)


def _scaled(step: _Step, factor: float) -> _Step:
    return _Step(step.origin, step.middle, step.half, tuple(factor * series for series in step.series))


def _collocated(
    shape: Shape,
    xi: float,
    interval: tuple[float, float],
    ends: tuple[float, float],
    top: float,
    stages: int,
    order: int,
    tolerance: float,
) -> tuple[Array, float, float] | None:
    """One step, from its upper end, where the stiffness is ``top``: Chebyshev series of k, and k and f at the lower end.

    ``interval`` of y between openings, ``ends`` of the step in the root. None if Newton's method does not converge, or the
    series has not.
    """
    rule, middle, half = _radau(stages), 0.5 * (ends[0] + ends[1]), 0.5 * (ends[1] - ends[0])
    root = middle + half * rule.points
    rise = 2.0 * half * root[:-1]  # dy/dt
    # at an opening its contacts are open: one closed by a rounding error has a stiffness of the root of that error
    slack = 4.0 * np.finfo(float).eps * max(map(abs, shape.bounds))
    y = np.minimum(interval[0] + root * root, interval[1] - slack)
    y[0] -= slack * (root[0] == 0.0)
    nodes = shape.nodes(y, order)
    force, stiffness = (of(y[:, None], nodes.positions) for of in (shape.force, shape.stiffness))
    # forces are counted from one whose derivative is known: the mean; or, of listed diameters, that of the median ball, so
    # that where most balls are alike only the few others are left to differentiate, with their small weights
    median = shape.quantile(0.5) if isinstance(shape, PointShape) else None
    common, slope_of_common = shape.force(y, median), shape.stiffness(y, median)
    force = force - common[:, None]
    mean = np.sum(nodes.weights * stiffness, axis=-1)
    k = top * mean / mean[-1]
    for _ in range(30):
        part = 1.0 / (stiffness + xi * k[:, None])
        share = nodes.weights * part
        total = np.sum(share, axis=-1)
        f = np.sum(share * force, axis=-1) / total
        slope = -xi * np.sum(share * part * (force - f[:, None]), axis=-1) / total
        matrix = rule.derivative[:, :-1] * slope[:-1] - np.diag(rise)
        try:
            change = np.linalg.solve(matrix, (k - slope_of_common)[:-1] * rise - rule.derivative @ f)
        except np.linalg.LinAlgError:
            return None
        k[:-1] = np.maximum(k[:-1] + change, 0.1 * k[:-1])
        if np.all(np.abs(change) <= 1e-8 * k[:-1]):  # convergence is quadratic: this was the last one needed
            break
    else:
        return None
    series = rule.coefficients @ k
    # on a short step at a large force (or far from y = 0) differentiation amplifies the rounding of f (of y)
    short = (np.max(np.abs(f)) / np.min(k) + np.max(np.abs([*interval, *y]))) / (4.0 * middle * half)
    noise = 16.0 * np.finfo(float).eps * stages**2 * short
    if np.max(np.abs(series[-2:])) > max(tolerance, min(noise, _WORST)) * np.min(k):
        return None
    return series, float(k[0]), float(common[0] + f[0])


@dataclass(frozen=True)
class EffectiveLaw(SpreadLaw):
    """The effective medium: balls displace their neighbours, and equation (36) holds.

    ``coefficient`` c (N/m^(3/2)) of equal balls, ``width`` W (m), ``shape`` of the distribution, ``xi`` the local-field
    factor. Energy is counted from the start of the curve. Methods raise :class:`~granphon.errors.PrecisionError` between the
    first contact and the start of the curve.
    """

    coefficient: float
    width: float
    shape: UniformShape | NormalShape | PointShape
    xi: float

    @property
    def curve(self) -> EffectiveCurve:
        """The reduced law."""
        return effective_curve(self.shape, self.xi)

    @property
    def _energy_offset(self) -> float:
        return self.curve.energy_offset

    def _near(self, y: Array, order: int) -> Array:
        closed, curve = y > -self.shape.bounds[1], self.curve
        if np.any(closed & (y < curve.start)):
            raise PrecisionError(
                message(
                    f"an overlap of {float(np.min(y[closed])):.6g} widths is below that of f* = {curve.least_force:g}",
                    f"There the effective medium is not solved (it is valid from f* = {VALID_FORCE:g})",
                    "Raise the load",
                )
            )
        out = np.zeros(y.shape)
        out[closed] = curve.value(y[closed], order)
        return out

    def _near_overlap(self, force: Array) -> Array:
        least = self.curve.least_force
        if np.any(force < least):
            raise PrecisionError(
                message(
                    f"a mean contact force of f* = {float(np.min(force)):.3g} is below {least:g}",
                    f"There the effective medium is not solved (it is valid from f* = {VALID_FORCE:g})",
                    "Raise the load",
                )
            )
        return self.curve.overlap(force)
