"""The contact law of the effective medium: equation (36) of Velicky and Caroli, solved once for
each shape and Xi.

In reduced units the mean displacement of the corona vanishes, <(F^Q - f)/(K^Q + Xi k)> = 0, when f
= G(y, k), the mean of F^Q with weights 1/(K^Q + Xi k); and k = df/dy. As a differential equation
for k, k = dG(y, k(y))/dy, this is stiff: errors in k decay towards low pressure, at a rate
1/(dG/dk), and grow without bound towards high pressure. So it is solved downwards, from the
high-pressure series that condition (40) selects, by collocation at Radau points (an implicit
Runge-Kutta method, L-stable, of order 2s - 1 at the ends of its steps). The unknown is k alone, G
needs no derivative of K^Q, and on each step the solution is a polynomial. Steps end at the
openings, the overlaps at which the contacts of some pair of balls open and k has a kink. Between
two openings the variable is the square root of the distance to the lower one, in which k is smooth.

On a step y = origin + u^2, and k is a polynomial in u. Force and energy are integrals of this
polynomial and the slope of k is its derivative, so that all four agree exactly. There are tens of
steps or, for long lists of diameters, tens of thousands, so a curve is stored as arrays over steps:
an element of an (n, steps) table is the coefficient of a Chebyshev polynomial of t = (u -
middle)/half, -1 <= t <= 1.

A step needs one number from the step above it: k at their common end. So Newton's method solves
many steps at once. To first order the change of k at the lower end of a step is linear in the
change at its upper end, and these relations are applied one after the other, downwards.

With n listed diameters the curve has n(n + 1)/2 openings, and each of the steps between them needs
n sums of n powers. The forces of contacts whose opening lies far below a block of steps are smooth
functions of y there: their sum is one polynomial for each ball. The other, near contacts are summed
one by one, each for its two balls. So the work grows as n^3, times the small number of near
contacts of a ball.

Overlaps are counted from the opening o below the step: an overlap is o - o_ij + u^2, with exact
differences, so that it has all its digits however small it is compared with the diameters. Forces
are counted from those at the upper end of a step, as sums of their changes. Differentiation then
cancels nothing, neither on short steps, where the changes are small, nor for balls of a rare kind,
whose share in the mean is small.

Products are formed by einsum: they are too small for the threads of a linear algebra library. Where
processors are shared, these threads wait for each other ten times as long as the product takes.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property, lru_cache
from itertools import pairwise
from typing import Any, NamedTuple

import numpy as np
from numpy.polynomial import chebyshev
from numpy.typing import NDArray

from granphon.balls.diameters import NormalShape, PointShape, Shape, UniformShape
from granphon.balls.hertz import ENERGY, FORCE, SLOPE, STIFFNESS
from granphon.base.arrays import Array, Flags
from granphon.base.errors import PrecisionError
from granphon.base.results import read_only
from granphon.base.scales import WidthUnits
from granphon.laws.spread import Series, SpreadLaw, high_pressure_series

#: the number of one step, or an array of the step of each value
Index = int | NDArray[np.intp]
#: a step that is not solved yet: origin, lower and upper end in the root
Step = tuple[float, float, float]
#: f* down to which the curve is solved, far below the paper's limit of validity
LEAST_SOLVED_FORCE = 1e-6
#: f* from which Section IV states that the medium is valid, by comparison with simulations of the
#: triangular lattice
VALID_FORCE = 0.08
#: value of k (y - y_1)/f* below which the stiffness counts as zero, y_1 being the overlap of the
#: first contact: wherever the law stiffens the ratio is one or more
_VANISHED = 1e-7
#: number of values worked on at once where the coefficients of its step are copied for each value
_VALUES_AT_ONCE = 2**13
#: number of values per step from which values are sorted by step
_MANY_VALUES = 64
#: number of collocation (Radau) points on a step; its upper end is not counted
_STAGES = 16
#: tolerance of the last Chebyshev coefficients of k, relative to the least value of k on the step
_LAST_COEFFICIENTS = 1e-12
#: number of openings from which all steps are short, so that fewer points and a larger tolerance
#: suffice
_MANY_OPENINGS = 100
#: number of collocation points on short steps
_STAGES_OF_SHORT = 12
#: tolerance of the last coefficients of k on short steps, relative to the least value of k
_LAST_OF_SHORT = 1e-10
#: nodes of the average over balls (see Shape.nodes)
_ORDER = 32
#: the lowest step of an interval is halved until the next opening below is at least this fraction
#: of the step's extent in y away: the nearer that opening, the less smooth is k
_NEAR = 0.15
#: largest change of k, relative to k, in the last iteration of Newton's method: convergence is
#: quadratic, so the remaining error is far smaller
_SETTLED = 1e-8
#: half length of the shortest step in the root, relative to its middle
_SHORTEST = 1e-12
#: upper bound on the rounding error of k that is allowed for, relative to k
_WORST_NOISE = 1e-8
#: a contact is far if its overlap is at least this many times half the range of the block
_FAR_OVERLAP = 6.0
#: degree of the polynomials for far contacts; their errors are then 1e-15
_DEGREE = 14
#: number of steps that a block may always have: a third of the number of diameters balances the
#: work on near and far contacts, and more steps cost little
_LEAST_STEPS = 32
#: largest number of elements in an array of near contacts
_MOST_NEAR = 2**21


@dataclass(frozen=True)
class EffectiveLaw(SpreadLaw):
    """Contact law of the effective medium: balls displace their neighbours, and equation (36)
    holds.

    ``coefficient`` c (N/m^(3/2)) of equal balls, ``width`` W (m), ``shape`` of the distribution,
    ``xi`` the local-field factor. Energy is counted from the start of the curve. Methods raise
    :class:`~granphon.base.errors.PrecisionError` between the first contact and the start of the
    curve.
    """

    coefficient: float
    width: float
    shape: UniformShape | NormalShape | PointShape
    xi: float

    @property
    def curve(self) -> EffectiveCurve:
        """Reduced law, in units of W and c W^(3/2)."""
        return effective_curve(self.shape, self.xi)

    def least_valid_force(self, width: float) -> float:
        """Return the force, N, from which the medium is valid, for the ``width`` W, m."""
        return VALID_FORCE * WidthUnits(self.coefficient, width).force

    @cached_property
    def _energy_offset(self) -> float:
        # energies of the curve are counted from its start, and those of the series from zero
        series = self.curve.series
        energy_of_curve = self.curve.value(np.array(series.start), ENERGY)
        return float(energy_of_curve - series.value(series.start, ENERGY))

    def _evaluate_near(self, y: Array, order: int) -> Array:
        curve = self.curve
        closed = y > -self.shape.bounds[1]
        if np.any(closed & (y < curve.start)):
            raise self._refuse(
                f"an overlap of {float(np.min(y[closed])):.6g} widths is below that of f* ="
                f" {curve.least_force:.6g}"
            )
        values = np.zeros(y.shape)
        values[closed] = curve.value(y[closed], order)
        return values

    def _find_near_overlap(self, force: Array) -> Array:
        curve = self.curve
        if np.any(force < curve.least_force):
            raise self._refuse(
                f"a mean contact force of f* = {float(np.min(force)):.3g} is below"
                f" {curve.least_force:.6g}"
            )
        return curve.overlap(force)

    def _refuse(self, what: str) -> PrecisionError:
        """Return the error that ``what`` is below the start of the curve."""
        why = f"There the effective medium is not solved (it is valid from f* = {VALID_FORCE:g})"
        if self.curve.stiffness_vanishes:
            why = "The stiffness is zero there, and equation (36) has no solution at smaller forces"
        return PrecisionError(what, why, "Raise the load")


# -- the curve -------------------------------------------------------------------------------------


@dataclass(frozen=True, eq=False)
class EffectiveCurve:
    """Solution of equation (36) for one shape and Xi: steps in ascending order, and the ``series``
    beyond them.

    ``steps`` (3, steps) holds origin, middle and half length of each step; ``tables`` holds energy,
    force and stiffness, (n, steps) each. The curve begins at f* = 1e-6, or, if higher, at the force
    below which steps do not settle in double precision (always below the limit of validity).
    """

    shape: Shape
    xi: float
    series: Series
    steps: Array
    tables: tuple[Array, Array, Array]

    @cached_property
    def least_force(self) -> float:
        """Reduced force f* at the start of the curve."""
        return max(LEAST_SOLVED_FORCE, float(self.ends(FORCE)[0, 0]))

    @cached_property
    def start(self) -> float:
        """Reduced overlap y at the start of the curve."""
        return float(self.overlap(np.array([self.least_force]))[0])

    @cached_property
    def stiffness_vanishes(self) -> bool:
        """Whether the stiffness is zero at the start of the curve, although contacts still carry
        force there.

        Where contacts of rare kinds open, the force that equation (36) gives at k = 0 may fall as
        the overlap grows; below that point there is no solution with k > 0.
        """
        origin, middle, half = self.steps[:, 0].tolist()
        depth = origin + (middle - half) ** 2 - float(self.shape.openings[0])
        return bool(self.ends(STIFFNESS)[0, 0] * depth < _VANISHED * self.ends(FORCE)[0, 0])

    def ends(self, order: int) -> Array:
        """Return (2, steps) energy, force or stiffness at the lower and the upper end of each
        step.
        """
        table = self.tables[order]
        # Chebyshev polynomials are 1 at the upper end, and 1, -1, 1, ... at the lower one
        lower = np.sum(table[::2], axis=0) - np.sum(table[1::2], axis=0)
        return np.stack([lower, np.sum(table, axis=0)])

    def value(self, y: Array, order: int) -> Array:
        """Return a derivative of the energy at y between the start of the curve, from which
        energies are counted, and the start of the series.
        """

        def evaluate(index: Index, overlap: Array) -> Array:
            return self._evaluate(index, np.sqrt(overlap - self.steps[0, index]), order)

        # a kink belongs to the step below it, where the slope is finite
        return self._evaluate_by_step(np.searchsorted(self._edges[0], y), y, evaluate)

    def overlap(self, force: Array) -> Array:
        """Return y at forces between those at the ends of the curve, by Newton's method."""

        rounding = 4.0 * np.finfo(float).eps
        below, above = self._edges[1]
        # a step has at least the rounding of the force
        span = np.maximum(above - below, rounding * below)

        def invert(index: Index, target: Array) -> Array:
            origin, middle, half = self.steps[:, index]
            # u is smooth in a variable from 0 to 1. Where contacts open, f rises as u^2, and the
            # variable is the root of f; elsewhere f may span decades, and the variable is log f
            rise = np.clip(target - below[index], 0.0, span[index])
            touching = self.steps[1, index] == self.steps[2, index]
            logarithm = np.log1p(rise / below[index]) / np.log1p(span[index] / below[index])
            fraction = np.where(touching, np.sqrt(rise / span[index]), logarithm)
            root = middle + half * (2.0 * fraction - 1.0)
            for _ in range(30):
                residual = target - self._evaluate(index, root, FORCE)
                slope = 2.0 * root * self._evaluate(index, root, STIFFNESS)
                change = np.divide(residual, slope, out=np.zeros_like(root), where=slope > 0.0)
                root = np.clip(root + change, middle - half, middle + half)
                # convergence is quadratic: after so small a change only rounding remains
                settled = np.abs(change) <= 1e-9 * (middle + half)
                if np.all(settled | (np.abs(residual) <= rounding * target)):
                    break
            return np.asarray(origin + root**2)

        return self._evaluate_by_step(np.searchsorted(above[:-1], force), force, invert)

    @cached_property
    def _edges(self) -> tuple[Array, Array]:
        """Reduced overlap y where steps meet, and force f* (2, steps) at both ends of each step."""
        origin, middle, half = self.steps
        return (origin + (middle - half) ** 2)[1:], self.ends(FORCE)

    @cached_property
    def _slopes(self) -> tuple[Array, Array]:
        """Two tables of the slope of k: a series, and a series that must be divided by dy/dt.

        dy/dt is zero where contacts open. There, for listed diameters, k rises as the square root
        of the distance in y, and its slope is unbounded. For a density, k rises as the fifth power
        of that root, and the series can be divided without a remainder other than rounding.
        """
        numerator = np.asarray(chebyshev.chebder(self.tables[STIFFNESS]), float)
        quotient = np.zeros((max(1, len(numerator) - 1), numerator.shape[1]))
        if not isinstance(self.shape, PointShape):
            for i in np.flatnonzero(self.steps[1] == self.steps[2]):
                rise = 2.0 * self.steps[2, i] * self.steps[1:, i]  # dy/dt
                slopes = chebyshev.chebdiv(numerator[:, i], rise)[0]
                quotient[: slopes.size, i] = slopes
                numerator[:, i] = 0.0
        return quotient, numerator

    def _evaluate(self, index: Index, root: Array, order: int) -> Array:
        """Return a derivative of the energy at u = ``root`` on the steps ``index``."""
        _, middle, half = self.steps[:, index]
        t = (root - middle) / half
        if order < SLOPE:
            return np.asarray(chebyshev.chebval(t, self.tables[order][:, index], tensor=False))
        quotients, numerators = self._slopes
        whole = chebyshev.chebval(t, quotients[:, index], tensor=False)
        numerator = chebyshev.chebval(t, numerators[:, index], tensor=False)
        rise = 2.0 * half * root  # dy/dt
        divided = np.divide(numerator, rise, out=np.zeros_like(rise), where=numerator != 0.0)
        return np.asarray(whole + divided)

    def _evaluate_by_step(
        self, index: NDArray[np.intp], values: Array, function: Callable[[Index, Array], Array]
    ) -> Array:
        """Return a function of the step and the value, at values on the steps ``index``."""
        count = self.steps.shape[1]
        flat = values.ravel()
        numbers = index.ravel()
        results = np.empty(flat.size)
        if flat.size < _MANY_VALUES * count:
            for begin in range(0, flat.size, _VALUES_AT_ONCE):
                chunk = slice(begin, begin + _VALUES_AT_ONCE)
                results[chunk] = function(numbers[chunk], flat[chunk])
            return results.reshape(values.shape)
        # sorted by step, each step is evaluated once; small integers sort in linear time
        order = np.argsort(numbers.astype(np.min_scalar_type(count)), kind="stable")
        ascending = flat[order]
        numbers = numbers[order]
        changes = np.append(numbers.size > 0, numbers[1:] != numbers[:-1])
        begins = np.flatnonzero(changes).tolist()
        for begin, end in pairwise([*begins, order.size]):
            results[order[begin:end]] = function(int(numbers[begin]), ascending[begin:end])
        return results.reshape(values.shape)


def _integrate_over_steps(table: Array, rise: Array, start: float) -> Array:
    """Return the table (n + 2, steps) of the integral over y, equal to ``start`` where the first
    step begins.

    ``rise`` (2, steps) are the coefficients of dy/dt.
    """
    product = np.zeros((len(table) + 1, table.shape[1]))
    product[:-1] += rise[0] * table
    product[1:] += 0.5 * rise[1] * table
    product[1] += 0.5 * rise[1] * table[0]
    product[:-2] += 0.5 * rise[1] * table[1:]
    integral = np.asarray(chebyshev.chebint(product, lbnd=-1.0), float)
    integral[0] += start + np.append(0.0, np.cumsum(np.sum(integral, axis=0))[:-1])
    return integral


class Block(NamedTuple):
    """B adjoining steps in descending order, with s + 1 points on each: y = ``origin`` (B, 1) +
    ``root``^2 (B, s + 1).

    ``middle`` and ``half`` (B, 1) are the middle and the half length of each step in the root.
    ``drop`` (B, s + 1) is the root minus its value at the upper end of the step, without loss of
    digits.
    """

    origin: Array
    middle: Array
    half: Array
    root: Array
    drop: Array

    @classmethod
    def of(cls, steps: list[Step], points: Array) -> Block:
        """Make a block from its steps, and ``points`` (s + 1,) from -1 to 1."""
        origin, low, high = np.array(steps).T[:, :, None]
        middle = 0.5 * (low + high)
        half = 0.5 * (high - low)
        # middle - half may round, and at an opening the root must be exactly zero: the ends are
        # copied
        root = np.concatenate([low, (middle + half * points)[:, 1:-1], high], axis=1)
        return cls(origin, middle, half, root, half * (points - 1.0))

    @property
    def y(self) -> Array:
        """(B, s + 1) reduced overlap at the points."""
        return self.origin + self.root**2


# -- averages over the balls of a density ----------------------------------------------------------


class DensityBalls:
    """Averages over the balls of a shape, by quadrature of the ``order`` at the points of a block.

    ``mean`` (B, s + 1) is the mean stiffness <K^Q>. Forces are counted from the mean force
    ``base_force``, whose derivative is ``base_stiffness`` (B, s + 1). ``noise`` (B,) is the
    rounding error to expect in the last coefficients of k, relative to k.
    """

    def __init__(self, shape: Shape, xi: float, order: int, block: Block) -> None:
        y = block.y
        nodes = shape.nodes(y, order)
        self.xi = xi
        self.weights = nodes.weights
        self.base_force = shape.force(y)
        self.base_stiffness = shape.stiffness(y)
        self.stiffness = shape.stiffness(y[..., None], nodes.positions)
        self.force = shape.force(y[..., None], nodes.positions) - self.base_force[..., None]
        self.mean = np.sum(nodes.weights * self.stiffness, axis=-1)
        # on a short step differentiation amplifies the rounding of y and of the forces, which are
        # counted from their mean
        lengths = (self.base_force / self.base_stiffness + np.abs(y))[:, -1:]
        amplified = block.root.shape[1] ** 2 * lengths
        amplified /= 4.0 * block.middle * block.half
        self.noise = np.minimum(16.0 * np.finfo(float).eps * amplified[:, 0], _WORST_NOISE)

    def balance(self, k: Array) -> tuple[Array, Array, Array]:
        """Return G(y, k) less ``base_force``, and dG/dk, (B, s + 1); and G at the lower ends
        (B,).
        """
        compliance = 1.0 / (self.stiffness + self.xi * k[..., None])
        weights = self.weights * compliance
        total = np.sum(weights, axis=-1)
        force = np.sum(weights * self.force, axis=-1) / total
        excess = self.force - force[..., None]
        by_k = -self.xi * np.sum(weights * compliance * excess, axis=-1) / total
        return force, by_k, (self.base_force + force)[:, 0]


# -- averages over listed diameters ----------------------------------------------------------------


class PointAverages:
    """Averages over the balls of a shape of listed diameters by sums, for the local-field factor
    ``xi``.
    """

    def __init__(self, shape: PointShape, xi: float) -> None:
        from scipy.sparse import csc_array

        self.xi = xi
        x = np.array(shape.positions)
        self._weights = np.array(shape.weights)
        #: (n, n) openings of all pairs, in units of W
        self._opening_matrix = -0.5 * (x[:, None] + x)
        w = self._weights
        i, j = np.triu_indices(w.size)
        order = np.argsort(self._opening_matrix[i, j], kind="stable")
        i = i[order]
        j = j[order]
        #: (m,) openings of pairs, ascending
        self._openings = self._opening_matrix[i, j]
        # a pair of unlike balls counts for both balls
        unlike = np.flatnonzero(i != j)
        rows = np.concatenate([i, j[unlike]])
        columns = np.concatenate([np.arange(i.size), unlike])
        weights = np.concatenate([w[j], w[i[unlike]]])
        #: (n, m) weights of each pair in the sums of its two balls, sparse
        self._pair_weights: Any = csc_array((weights, (rows, columns)), shape=(w.size, i.size))

    def _find_range(self, block: Block) -> tuple[float, float, float, slice]:
        """Return the middle and the half extent in y of a block, above its least origin, and which
        contacts are near.

        Contacts with openings up to the third number are far; the slice is that of the openings of
        near contacts.
        """
        least_origin = block.origin[-1, 0]
        low = block.root[-1, 0] ** 2
        high = block.origin[0, 0] - least_origin + block.root[0, -1] ** 2
        middle = 0.5 * (low + high)
        half = 0.5 * (high - low)
        last_far = least_origin - max(0.0, _FAR_OVERLAP * half - middle)
        bounds = [last_far, block.origin[0, 0]]
        begin, end = np.searchsorted(self._openings, bounds, side="right").tolist()
        return middle, half, last_far, slice(begin, end)

    def count(self, block: Block) -> int:
        """Return how many steps of the block should be solved at once, so that arrays of near
        contacts fit in memory.
        """
        steps = min(len(block.root), max(_LEAST_STEPS, len(self._weights) // 3))
        *_, near = self._find_range(block)
        elements = (near.stop - near.start) * steps * block.root.shape[1]
        if steps > 1 and elements > _MOST_NEAR:
            return steps // 2
        return steps

    def balls(self, block: Block) -> PointBalls:
        """Return the averages at the points of the block: the sums over near contacts plus the sums
        over far contacts.

        Four quantities are summed for each ball: the stiffness, its change and the change of the
        force since the upper end of the step, (n, B, s + 1); and the force at the upper end, (n,
        B).
        """
        middle, half, last_far, near = self._find_range(block)
        sums = self._sum_near(block, near)
        if near.start:
            far_sums = self._sum_far(block, middle, half, last_far)
            sums = [near_sum + far_sum for near_sum, far_sum in zip(sums, far_sums, strict=True)]
        return PointBalls(self._weights, self.xi, *sums)

    def _sum_near(self, block: Block, near: slice) -> list[Array]:
        """Return the four sums over near contacts, contact by contact."""
        openings = self._openings[near]
        pair_weights = self._pair_weights[..., near]
        closed = openings[:, None] <= block.origin[:, 0]
        rise = np.where(closed, block.origin[:, 0] - openings[:, None], 0.0)
        root = np.sqrt(rise[..., None] + block.root**2) * closed[..., None]
        top = root[..., -1:]
        sum_of_roots = np.where(closed[..., None], root + top, np.inf)
        change = block.drop * (block.root + block.root[:, -1:]) / sum_of_roots

        def sum_pairs(values: Array) -> Array:
            """Return the sums over the pairs of each ball, (n, ...), of values (m, ...)."""
            shape = values.shape[1:]
            columns = values.reshape(len(values), int(np.prod(shape)))
            return np.asarray(pair_weights @ columns).reshape(-1, *shape)

        forces = change * (root * (root + top) + top * top)
        return [
            1.5 * sum_pairs(root),
            1.5 * sum_pairs(change),
            sum_pairs(forces),
            sum_pairs(top[..., 0] ** 3),
        ]

    def _sum_far(self, block: Block, middle: float, half: float, last_far: float) -> list[Array]:
        """Return the four sums over far contacts, by polynomials on the range of the block.

        The slope of the stiffness is interpolated, and integrated twice.
        """
        w = self._weights
        least_origin = block.origin[-1, 0]
        far = self._opening_matrix <= last_far
        gap = np.where(far, least_origin - self._opening_matrix + middle, np.inf)
        nodes = chebyshev.chebpts1(_DEGREE + 1)
        slope = np.stack([0.75 / np.sqrt(gap + half * node) @ w for node in nodes])
        gap = np.where(far, gap, 0.0)
        root = np.sqrt(gap)
        series = np.asarray(np.linalg.solve(chebyshev.chebvander(nodes, _DEGREE), slope), float)
        stiffness = _integrate_series(series, half, 1.5 * root @ w)
        force = _integrate_series(stiffness, half, gap * root @ w)
        # T_m at the points, and its difference from T_m at the upper end of the step, both by
        # recurrence: no digits are lost
        t = (block.origin - least_origin + block.root**2 - middle) / half
        drop = block.drop * (block.root + block.root[:, -1:]) / half
        values = [np.ones_like(t), t]
        changes = [np.zeros_like(t), drop]
        for _ in range(len(force) - 2):
            values.append(2.0 * t * values[-1] - values[-2])
            changes.append(2.0 * (drop * values[-2] + t[:, -1:] * changes[-1]) - changes[-2])
        basis = np.stack(values)
        change = np.stack(changes)
        return [
            _sum_series(stiffness, basis),
            _sum_series(stiffness, change),
            _sum_series(force, change),
            _sum_series(force, basis[..., -1]),
        ]


def _sum_series(table: Array, terms: Array) -> Array:
    """Return the sums (n, ...) of the Chebyshev series (m, n) of n balls, from terms (m or more,
    ...).
    """
    return np.asarray(np.einsum("mn,m...->n...", table, terms[: len(table)]))


def _integrate_series(table: Array, scale: float, middle: Array) -> Array:
    """Return the Chebyshev series of the integral that equals ``middle`` at 0."""
    out = np.asarray(chebyshev.chebint(table, scl=scale), float)
    out[0] += middle - chebyshev.chebval(0.0, out)
    return out


@dataclass(frozen=True, eq=False)
class PointBalls:
    """Averages by sums, as :class:`DensityBalls`: ``stiffness`` (n, B, s + 1) is K^Q at the points.

    ``change`` and ``work`` (n, B, s + 1) are the changes of K^Q and F^Q since the upper end of the
    step, where F^Q is ``top`` (n, B).
    """

    weights: Array
    xi: float
    stiffness: Array
    change: Array
    work: Array
    top: Array

    base_stiffness = 0.0
    #: zero, because no differences of large numbers are taken
    noise = 0.0

    @cached_property
    def mean(self) -> Array:
        """(B, s + 1) mean stiffness <K^Q>, reduced."""
        return self._average(self.stiffness)

    def balance(self, k: Array) -> tuple[Array, Array, Array]:
        """Return what :meth:`DensityBalls.balance` returns, as the whole of G; forces are counted
        from the upper end.
        """
        compliance = 1.0 / (self.stiffness + self.xi * k)
        top_compliance = compliance[..., -1]
        top_force = self._average(top_compliance * self.top) / self._average(top_compliance)
        top_excess = self.top - top_force
        # <(F^Q - f) compliance> is zero at the upper end: elsewhere the mean is the sum of the
        # changes of F^Q and of the compliance
        stiffening = self.change + self.xi * (k - k[:, -1:])
        moved = self.work - stiffening * (top_excess * top_compliance)[..., None]
        total = self._average(compliance)
        force = self._average(compliance * moved) / total
        excess = self.work + top_excess[..., None] - force
        by_k = -self.xi * self._average(compliance * compliance * excess) / total
        return force, by_k, top_force + force[:, 0]

    def _average(self, values: Array) -> Array:
        return np.asarray(np.einsum("n,n...->...", self.weights, values))


# -- its solution ----------------------------------------------------------------------------------


@lru_cache(maxsize=64)
def effective_curve(shape: Shape, xi: float) -> EffectiveCurve:
    """Solve equation (36) for a shape and Xi; force and stiffness are right to 1e-8 or better from
    f* = 1e-4 on.

    Results are cached.

    Raises :class:`~granphon.base.errors.PrecisionError` if the steps do not settle where the medium
    is valid.
    """
    if shape.openings.size >= _MANY_OPENINGS:
        return solve_curve(shape, xi, _STAGES_OF_SHORT, _LAST_OF_SHORT)
    return solve_curve(shape, xi, _STAGES, _LAST_COEFFICIENTS)


def radau(stages: int) -> tuple[Array, Array, Array]:
    """Return the collocation rule on [-1, 1] with s = ``stages`` Radau points.

    First are the ``points`` (s + 1,): those s, which include -1, followed by +1. Two matrices act
    on values at the points: the first (s, s + 1) gives the derivative of the interpolating
    polynomial at the Radau points, the second (s + 1, s + 1) its Chebyshev series.
    """
    from scipy.special import roots_jacobi

    inner = roots_jacobi(stages - 1, 0.0, 1.0)[0] if stages > 1 else np.empty(0)
    points = np.concatenate([[-1.0], inner, [1.0]])
    inverse = np.linalg.inv(chebyshev.chebvander(points, stages))
    slopes = np.stack(
        [chebyshev.chebval(points[:-1], chebyshev.chebder(column)) for column in inverse.T], axis=1
    )
    return points, slopes, inverse


def solve_curve(
    shape: Shape,
    xi: float,
    stages: int,
    tolerance: float,
    most: float = np.inf,
    order: int = _ORDER,
) -> EffectiveCurve:
    """Solve equation (36) for a shape and Xi with s = ``stages``; no step is longer than ``most``
    in the square root.

    ``tolerance`` is the largest value of the last two Chebyshev coefficients of k, relative to the
    least k on the step; ``order`` is that of the quadrature over the balls of a density. Raises
    :class:`~granphon.base.errors.PrecisionError` if steps do not settle where the medium is valid.
    """
    averages = PointAverages(shape, xi) if isinstance(shape, PointShape) else None
    points, derivative, coefficients = radau(stages)
    far = high_pressure_series(shape, xi)
    # steps to be solved, in ascending order; the solution goes on from the last of them
    pending = _divide_range([*shape.openings.tolist(), far.start], most)
    first_opening = pending[0][0]
    stiffness = far.value(far.start, STIFFNESS)
    force = far.value(far.start, FORCE)
    solved_steps = []
    solved_tables = []
    count = 1  # of steps that are solved at once
    guess = None  # overlaps and k/<K^Q> of the last attempt
    while force > LEAST_SOLVED_FORCE:
        origin, low, high = pending[-1]
        if stiffness * (origin - first_opening + high**2) <= _VANISHED * force:
            break
        # where the first contact opens, force and stiffness are both zero: steps approach that end
        # but do not include it
        if (origin, low) == (first_opening, 0.0):
            pending[-1:] = _halve(pending[-1])
            continue
        attempted = reversed(pending[-count:])
        steps = [step for step in attempted if step[:2] != (first_opening, 0.0)]
        block = Block.of(steps, points)
        # steps of a density are long and few: one is solved at a time, because a step that must be
        # halved makes the work on the steps below it useless
        allowed = averages.count(block) if averages else 1
        if allowed < len(steps):
            count = allowed
            continue
        balls = averages.balls(block) if averages else DensityBalls(shape, xi, order, block)
        start = _estimate(balls, block, guess, stiffness)
        solution = _relax(balls, derivative, block, start, stiffness)
        is_rough = np.ones(len(steps), bool)
        if solution is not None:
            k, forces = solution
            table = k @ coefficients.T
            last = np.max(np.abs(table[:, -2:]), axis=1)
            is_rough = last > np.maximum(tolerance, balls.noise) * np.min(k, axis=1)
        is_hopeless = bool(np.any((block.half < _SHORTEST * block.middle)[is_rough]))
        if len(steps) > 1 and (solution is None or is_hopeless):
            count = len(steps) // 2
            continue
        if is_hopeless:  # doubles cannot tell apart the points of a shorter step
            if force < VALID_FORCE:
                break
            overlap = float(block.y[0, -1])
            raise PrecisionError(
                f"the effective medium does not converge below an overlap of {overlap:.6g} widths",
                mend="Raise the load",
            )
        if np.any(is_rough):
            finer = _halve_rough(steps, is_rough)
            pending[-len(steps) :] = finer
            count = len(finer)
            if solution is not None:
                ascending = np.argsort(block.y, axis=None)
                guess = block.y.ravel()[ascending], (k / balls.mean).ravel()[ascending]
            continue
        kept = min(len(steps), 1 + int(np.count_nonzero(forces > LEAST_SOLVED_FORCE)))
        geometry = np.concatenate([block.origin, block.middle, block.half], axis=1)
        solved_steps.append(geometry[:kept])
        solved_tables.append(table[:kept])
        stiffness = float(k[kept - 1, 0])
        force = float(forces[kept - 1])
        del pending[-len(steps) :]
        count = 2 * count
        guess = None
    return _make_curve(shape, xi, far, solved_steps, solved_tables, force)


def _divide_range(ends: list[float], most: float) -> list[Step]:
    """Return the initial steps between the openings and the start of the series, in ascending
    order; no step is longer than ``most`` in the square root.
    """
    steps: list[Step] = []
    for below, origin, end in zip([-np.inf, *ends], ends[:-1], ends[1:], strict=False):
        cuts = [math.sqrt(end - origin)]
        while origin - below < _NEAR * cuts[-1] ** 2:
            cuts.append(0.5 * cuts[-1])
        for low, high in pairwise([0.0, *reversed(cuts)]):
            pieces = 2 ** math.ceil(math.log2(max(1.0, (high - low) / most)))
            roots = np.linspace(low, high, pieces + 1).tolist()
            steps += [(origin, *step_roots) for step_roots in pairwise(roots)]
    return steps


def _make_curve(
    shape: Shape,
    xi: float,
    far: Series,
    steps: list[Array],
    tables: list[Array],
    lowest_force: float,
) -> EffectiveCurve:
    """Return the curve from its steps (n, 3) and the series of k on each step (n, s + 1), in
    descending order; ``lowest_force`` is the force at its lower end.
    """
    geometry = np.ascontiguousarray(np.concatenate(steps)[::-1].T)
    stiffness = np.ascontiguousarray(np.concatenate(tables)[::-1].T)
    # force and energy are integrals
    rise = 2.0 * geometry[2] * geometry[1:]  # dy/dt, as a series
    forces = _integrate_over_steps(stiffness, rise, lowest_force)
    # the curve and the series differ here by rounding alone; scaling the curve removes the jump
    scale = far.value(far.start, FORCE) / float(np.sum(forces[:, -1]))
    energies = _integrate_over_steps(forces, rise, 0.0)
    energies, forces, stiffness = (
        read_only(scale * table) for table in (energies, forces, stiffness)
    )
    return EffectiveCurve(shape, xi, far, read_only(geometry), (energies, forces, stiffness))


def _estimate(
    balls: DensityBalls | PointBalls, block: Block, guess: tuple[Array, Array] | None, top: float
) -> Array:
    """Return an estimate of k, (B, s + 1), at the points of a block, which is ``top`` at the upper
    end.

    k/<K^Q> is smooth: the ratio is that of the last attempt, whose overlaps and ratios are the
    ``guess``, or else a constant.
    """
    ratio = np.ones(block.y.shape) if guess is None else np.interp(block.y, *guess)
    return np.asarray(balls.mean * ratio * (top / (balls.mean[0, -1] * ratio[0, -1])))


def _halve_rough(steps: list[Step], is_rough: Flags) -> list[Step]:
    """Return the steps, which are in descending order, in ascending order, with the rough ones
    halved.
    """
    finer = []
    for step, must_halve in zip(reversed(steps), reversed(is_rough.tolist()), strict=True):
        finer += _halve(step) if must_halve else [step]
    return finer


def _halve(step: Step) -> list[Step]:
    """Return the two halves of a step, in ascending order."""
    origin, low, high = step
    middle = 0.5 * (low + high)
    return [(origin, low, middle), (origin, middle, high)]


def _relax(
    balls: DensityBalls | PointBalls, derivative: Array, block: Block, k: Array, top: float
) -> tuple[Array, Array] | None:
    """Return k at the points of a block and the force at the lower ends, by Newton's method from
    an estimate ``k``; None if the method fails. ``top`` is k at the upper end of the block.
    """
    rise = 2.0 * block.half * block.root[:, :-1]  # dy/dt
    inner = derivative[:, :-1]
    last = derivative[:, -1]
    k[:, -1] = np.append(top, k[:-1, 0])
    for _ in range(30):
        force, by_k, _ = balls.balance(k)
        matrix = inner * by_k[:, None, :-1] - rise[:, :, None] * np.eye(len(inner))
        residual = (k - balls.base_stiffness)[:, :-1] * rise - force @ derivative.T
        sides = np.stack([residual, -last * by_k[:, -1:]], axis=-1)
        try:
            responses = np.linalg.solve(matrix, sides)
        except np.linalg.LinAlgError:
            return None
        # the change of k at the lower end of a step is linear in the change at its upper end
        changes = [0.0]
        for offset, gain in responses[:, 0].tolist():
            changes.append(offset + gain * changes[-1])
        change = responses[..., 0] + responses[..., 1] * np.array(changes[:-1])[:, None]
        if not np.all(np.isfinite(change)):
            return None
        k[:, :-1] = np.maximum(k[:, :-1] + change, 0.1 * k[:, :-1])
        k[1:, -1] = k[:-1, 0]
        if np.all(np.abs(change) <= _SETTLED * k[:, :-1]):
            # convergence is quadratic: no further iteration is needed
            return k, balls.balance(k)[2]
    return None
