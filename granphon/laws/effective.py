"""The contact law of the effective medium: equation (36) of Velicky and Caroli (2002), solved once
for each shape of the distribution of diameters and each local-field factor Xi.

F^Q and K^Q are the mean force and stiffness of the contacts of a ball Q, f and k those of all
contacts, and y is the mean overlap; all are in reduced units. The neighbours of a ball are its
corona. Their mean displacement vanishes, <(F^Q - f)/(K^Q + Xi k)> = 0. That is so if f = G(y,
k), the mean of F^Q with the weights 1/(K^Q + Xi k). As k = df/dy, it is a differential equation for
k, k = dG(y, k(y))/dy. The equation is stiff: errors in k decay towards low pressure, at the rate
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
from dataclasses import dataclass, field, replace
from functools import cached_property, lru_cache
from itertools import pairwise
from typing import Any, NamedTuple

import numpy as np
from numpy.polynomial import chebyshev
from numpy.typing import NDArray

from granphon.balls.diameters import NormalShape, PointShape, Shape, UniformShape
from granphon.balls.hertz import ENERGY, FORCE, SLOPE, STIFFNESS
from granphon.base.arrays import Array, Flags
from granphon.base.differences import differentiate
from granphon.base.errors import PrecisionError
from granphon.base.results import read_only
from granphon.base.scales import WidthUnits
from granphon.laws.spread import Series, SpreadLaw, high_pressure_series

#: the number of one step, or an array of the step of each value
Index = int | NDArray[np.intp]
#: a step that is not solved yet: y at its origin, and the square root u at its lower and upper end
Step = tuple[float, float, float]
#: f* down to which the curve is solved, far below the limit of validity of Velicky and Caroli
LEAST_SOLVED_FORCE = 1e-6
#: f* from which Section IV states that the medium is valid, by comparison with simulations of the
#: triangular lattice
VALID_FORCE = 0.08
#: value of k (y - y_1)/f* below which the stiffness counts as zero, y_1 being the overlap at which
#: the first contact closes: wherever the law stiffens the ratio is one or more
_ZERO_RATIO = 1e-7
#: number of values that are evaluated at once if the coefficients of its step are copied for each
_VALUES_AT_ONCE = 2**13
#: number of values per step from which values are sorted by step before they are evaluated
_MANY_VALUES = 64
#: number of collocation (Radau) points on a step; its upper end is not counted
_STAGES = 16
#: tolerance of the last Chebyshev coefficients of k, relative to the least value of k on the step
_COEFFICIENT_TOLERANCE = 1e-12
#: number of openings from which all steps are short, so that fewer points and a larger tolerance
#: suffice
_MANY_OPENINGS = 100
#: number of collocation points on short steps
STAGES_OF_SHORT = 12
#: tolerance of the last coefficients of k on short steps, relative to the least value of k
TOLERANCE_OF_SHORT = 1e-10
#: number of nodes of the average over balls (see Shape.nodes)
_N_NODES = 32
#: the lowest step of an interval is halved until the next opening below is at least this fraction
#: of the step's extent in y away: the nearer that opening, the less smooth is k
_OPENING_DISTANCE = 0.15
#: change of k, relative to k, at which Newton's method ends: convergence is quadratic, so that the
#: remaining error is far smaller
_K_TOLERANCE = 1e-8
#: change of the root u, relative to u at the upper end of the step, after which only rounding
#: remains: Newton's method for an overlap converges quadratically too
_ROOT_TOLERANCE = 1e-9
#: largest number of iterations of Newton's method, which converges quadratically
_MOST_ITERATIONS = 30
#: half length of the shortest step in the root, relative to its middle
_SHORTEST_STEP = 1e-12
#: upper bound on the rounding error of k that is allowed for, relative to k
_WORST_NOISE = 1e-8
#: estimate of the relative rounding error of y and of the forces at the points of a step
_ROUNDING = 16.0 * np.finfo(float).eps
#: a contact is far if its overlap is at least this many times half the range of the block
_FAR_OVERLAP = 6.0
#: degree of the polynomials for far contacts; their errors are then 1e-15
_DEGREE = 14
#: number of steps that a block may always have. Otherwise a block has a third as many steps as
#: there are diameters, which balances the work on near and far contacts
_LEAST_STEPS = 32
#: largest number of steps whose derivative with respect to Xi is found at once
_MANY_STEPS = 256
#: relative step of Xi for the derivative of the series
_STEP_OF_XI = 1e-3
#: largest number of elements in an array of near contacts
_MOST_NEAR_ELEMENTS = 2**21


@dataclass(frozen=True)
class EffectiveLaw(SpreadLaw):
    """Contact law of the effective medium: balls displace their neighbours, and equation (36)
    holds.

    Methods raise :class:`~granphon.base.errors.PrecisionError` for overlaps between that of the
    first contact and the start of the curve, for forces below that at its start, and if the
    equation has no solution where the medium is valid (:func:`effective_curve`).

    Attributes
    ----------
    coefficient : c of Hertz's law of equal balls, N/m^(3/2).
    width : W, the width of the distribution of diameters, m.
    shape : the shape of the distribution.
    xi : the local-field factor Xi, above zero and finite.
    """

    coefficient: float
    width: float
    shape: UniformShape | NormalShape | PointShape = field(
        metadata={"kind": UniformShape | NormalShape | PointShape}
    )
    xi: float

    @property
    def curve(self) -> EffectiveCurve:
        """Reduced law, in units of W and c W^(3/2)."""
        return effective_curve(self.shape, self.xi)

    def near(self, origin: EffectiveLaw) -> EffectiveLaw:
        """Return this law to first order in the difference of its Xi from that of the law
        ``origin``, whose curve then gives the curve of this law by one linear solution.

        The law itself is returned if both Xi are equal or the shapes differ.
        """
        if self.xi == origin.xi or self.shape != origin.shape:
            return self
        return _NearLaw(self.coefficient, self.width, self.shape, self.xi, origin.xi)

    def least_valid_force(self, width: float) -> float:
        """Return the force, N, from which the medium is valid, for the ``width`` W, m."""
        return VALID_FORCE * WidthUnits(self.coefficient, width).force

    @cached_property
    def _energy_offset(self) -> float:
        """Reduced energy to be added to that of the series, so that it joins that of the curve."""
        # energies of the curve are counted from its start, and those of the series from zero
        series = self.curve.series
        energy_of_curve = self.curve.value(np.array(series.start), ENERGY)
        return float(energy_of_curve - series.value(series.start, ENERGY))

    def _evaluate_near(self, y: Array, order: int) -> Array:
        """Return the derivative of ``order`` 0 to 3 of the reduced energy with respect to
        y, at each y (any shape) below the start of the series; zero if all contacts are open.

        Raises :class:`~granphon.base.errors.PrecisionError` below the start of the curve.
        """
        curve = self.curve
        is_touching = y > -self.shape.bounds[1]
        if np.any(is_touching & (y < curve.start)):
            least_overlap = float(np.min(y[is_touching]))
            raise self._refuse(
                f"an overlap of {least_overlap:.6g} widths is below that of f* ="
                f" {curve.least_force:.6g}"
            )
        derivatives = np.zeros(y.shape)
        derivatives[is_touching] = curve.value(y[is_touching], order)
        return derivatives

    def _find_near_overlap(self, force: Array) -> Array:
        """Return the reduced overlap y at each reduced force f*, ``force`` (any shape), below that
        at the start of the series.

        Raises :class:`~granphon.base.errors.PrecisionError` below the start of the curve.
        """
        curve = self.curve
        if np.any(force < curve.least_force):
            least_force = float(np.min(force))
            raise self._refuse(
                f"a mean contact force of f* = {least_force:.3g} is below f* ="
                f" {curve.least_force:.6g}"
            )
        return curve.overlap(force)

    def _refuse(self, problem: str) -> PrecisionError:
        """Return the error whose ``problem`` is an overlap or a force below the start of the
        curve.
        """
        why = f"There the effective medium is not solved (it is valid from f* = {VALID_FORCE:g})"
        if self.curve.has_zero_stiffness:
            why = "The stiffness is zero there, and equation (36) has no solution at smaller forces"
        return PrecisionError(problem, why, "Raise the load")


@dataclass(frozen=True)
class _NearLaw(EffectiveLaw):
    """A law to first order in the difference of its Xi from ``origin``, the Xi at which equation
    (36) is solved.
    """

    origin: float

    @property
    def curve(self) -> EffectiveCurve:
        """Reduced law, in units of W and c W^(3/2)."""
        return effective_curve(self.shape, self.origin).follow(self.xi)


# -- the curve -------------------------------------------------------------------------------------


@dataclass(frozen=True, eq=False)
class EffectiveCurve:
    """Solution of equation (36) for one shape and Xi, on steps in ascending order.

    The curve begins at f* = :data:`LEAST_SOLVED_FORCE`. It begins at a higher force if steps below
    it do not settle in double precision (which is always below the limit of validity), or if the
    stiffness vanishes there (:attr:`has_zero_stiffness`).

    Attributes
    ----------
    shape : the shape of the distribution of diameters.
    xi : the local-field factor.
    series : the high-pressure series, beyond the last step.
    steps : (3, steps), the origin y of each step, and the middle and the half length of the step in
        the square root u, y = origin + u^2.
    tables : three arrays (n, steps), Chebyshev coefficients of the reduced energy, force and
        stiffness on each step; the force has two coefficients more than the stiffness, and the
        energy two more than the force.
    """

    shape: Shape
    xi: float
    series: Series
    steps: Array
    tables: tuple[Array, Array, Array]

    def follow(self, xi: float) -> EffectiveCurve:
        """Return the curve at another Xi, ``xi``, to first order in the difference of the two."""
        step = xi - self.xi
        energies, forces, stiffness = (
            read_only(table + step * slope)
            for table, slope in zip(self.tables, self._slopes_by_xi, strict=True)
        )
        series = high_pressure_series(self.shape, xi)
        return replace(self, xi=xi, series=series, tables=(energies, forces, stiffness))

    @cached_property
    def _slopes_by_xi(self) -> tuple[Array, Array, Array]:
        """Derivatives of the three :attr:`tables` with respect to Xi."""
        return _differentiate_curve(self)

    @cached_property
    def least_force(self) -> float:
        """Reduced force f* at the start of the curve."""
        return max(LEAST_SOLVED_FORCE, float(self.ends(FORCE)[0, 0]))

    @cached_property
    def start(self) -> float:
        """Reduced overlap y at the start of the curve."""
        return float(self.overlap(np.array([self.least_force]))[0])

    @cached_property
    def has_zero_stiffness(self) -> bool:
        """Whether the stiffness counts as zero (:data:`_ZERO_RATIO`) at the start of the curve,
        although contacts still carry force there.

        Where contacts of rare kinds open, the force that equation (36) gives at k = 0 may fall as
        the overlap grows; below that point there is no solution with k > 0.
        """
        origin, middle, half = self.steps[:, 0].tolist()
        depth = origin + (middle - half) ** 2 - float(self.shape.openings[0])  # y - y_1
        stiffness = self.ends(STIFFNESS)[0, 0]
        force = self.ends(FORCE)[0, 0]
        return _is_zero_stiffness(stiffness, depth, force)

    def ends(self, order: int) -> Array:
        """Return the reduced energy, force or stiffness (2, steps) at the lower and the upper end
        of each step, for an ``order`` of 0, 1 or 2 of the derivative of the energy.
        """
        table = self.tables[order]
        # Chebyshev polynomials are 1 at the upper end, and 1, -1, 1, ... at the lower one
        at_lower_end = np.sum(table[::2], axis=0) - np.sum(table[1::2], axis=0)
        at_upper_end = np.sum(table, axis=0)
        return np.stack([at_lower_end, at_upper_end])

    def value(self, y: Array, order: int) -> Array:
        """Return the derivative of ``order`` 0 to 3 of the reduced energy at each overlap
        ``y`` (any shape), between the start of the curve and the start of the series.

        The energy is counted from the start of the curve.
        """

        def evaluate(index: Index, overlap: Array) -> Array:
            """Return the derivatives (m,) at ``overlap`` (m,) on the steps ``index``."""
            return self._evaluate(index, np.sqrt(overlap - self.steps[0, index]), order)

        inner_edges, _ = self._edges
        # a kink belongs to the step below it, where the slope is finite
        step_of_overlap = np.searchsorted(inner_edges, y)
        return self._evaluate_by_step(step_of_overlap, y, evaluate)

    def overlap(self, force: Array) -> Array:
        """Return the reduced overlap y at each reduced ``force`` (any shape), between the forces
        at the ends of the curve, by Newton's method.
        """
        rounding = 4.0 * np.finfo(float).eps
        _, (lower_force, upper_force) = self._edges
        # the force rises by at least its rounding on a step, so that no division is by zero
        span = np.maximum(upper_force - lower_force, rounding * lower_force)

        def invert(index: Index, target: Array) -> Array:
            """Return y (m,) at the forces ``target`` (m,) on the steps ``index``."""
            origin, middle, half = self.steps[:, index]
            # the first guess is linear between u and a variable from 0 to 1. On a step that begins
            # at an opening f rises as u^2, and the variable is the square root of f; on other steps
            # f may span decades, and the variable is log f
            force_rise = np.clip(target - lower_force[index], 0.0, span[index])
            is_at_opening = middle == half
            root_variable = np.sqrt(force_rise / span[index])
            log_rise = np.log1p(force_rise / lower_force[index])
            log_variable = log_rise / np.log1p(span[index] / lower_force[index])
            variable = np.where(is_at_opening, root_variable, log_variable)
            root = middle + half * (2.0 * variable - 1.0)
            for _ in range(_MOST_ITERATIONS):
                residual = target - self._evaluate(index, root, FORCE)
                slope = 2.0 * root * self._evaluate(index, root, STIFFNESS)
                change = np.divide(residual, slope, out=np.zeros_like(root), where=slope > 0.0)
                root = np.clip(root + change, middle - half, middle + half)
                is_settled = np.abs(change) <= _ROOT_TOLERANCE * (middle + half)
                if np.all(is_settled | (np.abs(residual) <= rounding * target)):
                    break
            return np.asarray(origin + root**2)

        step_of_force = np.searchsorted(upper_force[:-1], force)
        return self._evaluate_by_step(step_of_force, force, invert)

    @cached_property
    def _edges(self) -> tuple[Array, Array]:
        """Reduced overlap y (steps - 1,) where steps meet, and force f* (2, steps) at the lower
        and the upper end of each step.
        """
        origin, middle, half = self.steps
        lower_overlaps = origin + (middle - half) ** 2
        return lower_overlaps[1:], self.ends(FORCE)

    @cached_property
    def _slopes(self) -> tuple[Array, Array]:
        """Two tables (m, steps) of series: the slope of k is the first, plus the second divided by
        dy/dt.

        dy/dt is zero where contacts open. There, for listed diameters, k rises as the square root
        of the distance in y, and its slope is unbounded. For a density, k rises as the fifth power
        of that root, and the series can be divided without a remainder other than rounding.
        """
        numerator = np.asarray(chebyshev.chebder(self.tables[STIFFNESS]), float)
        quotient = np.zeros((max(1, len(numerator) - 1), numerator.shape[1]))
        if not isinstance(self.shape, PointShape):
            _, middle, half = self.steps
            is_at_opening = middle == half
            for step in np.flatnonzero(is_at_opening):
                rise = 2.0 * half[step] * self.steps[1:, step]  # dy/dt, a series of two terms
                slopes = chebyshev.chebdiv(numerator[:, step], rise)[0]
                quotient[: slopes.size, step] = slopes
                numerator[:, step] = 0.0
        return quotient, numerator

    def _evaluate(self, index: Index, root: Array, order: int) -> Array:
        """Return the derivative (m,), of an ``order`` of 0 to 3, of the reduced energy with respect
        to y, at each u = ``root`` (m,) on the steps ``index`` (m,), or all on one step ``index``.
        """
        _, middle, half = self.steps[:, index]
        t = (root - middle) / half
        if order < SLOPE:
            return np.asarray(chebyshev.chebval(t, self.tables[order][:, index], tensor=False))
        quotients, numerators = self._slopes
        quotient = chebyshev.chebval(t, quotients[:, index], tensor=False)
        numerator = chebyshev.chebval(t, numerators[:, index], tensor=False)
        rise = 2.0 * half * root  # dy/dt
        # a numerator of zero gives no slope, also where dy/dt is zero
        ratio = np.divide(numerator, rise, out=np.zeros_like(rise), where=numerator != 0.0)
        return np.asarray(quotient + ratio)

    def _evaluate_by_step(
        self, index: NDArray[np.intp], arguments: Array, function: Callable[[Index, Array], Array]
    ) -> Array:
        """Return the values of ``function`` at the ``arguments``, in their shape; ``index``, of the
        same shape, is the step of each argument.

        ``function`` is called with the steps (m,) of m arguments (m,), or with one step that is the
        same for all of them. If there are many arguments per step, they are sorted by step, so that
        coefficients are not copied for each.
        """
        step_count = self.steps.shape[1]
        flat = arguments.ravel()
        steps = index.ravel()
        results = np.empty(flat.size)
        if flat.size < _MANY_VALUES * step_count:
            for begin in range(0, flat.size, _VALUES_AT_ONCE):
                chunk = slice(begin, begin + _VALUES_AT_ONCE)
                results[chunk] = function(steps[chunk], flat[chunk])
            return results.reshape(arguments.shape)
        # sorted by step, each step is evaluated once; small integers sort in linear time
        order = np.argsort(steps.astype(np.min_scalar_type(step_count)), kind="stable")
        ascending = flat[order]
        steps = steps[order]
        is_first_of_step = np.append(steps.size > 0, steps[1:] != steps[:-1])
        begins = np.flatnonzero(is_first_of_step).tolist()
        for begin, end in pairwise([*begins, order.size]):
            results[order[begin:end]] = function(int(steps[begin]), ascending[begin:end])
        return results.reshape(arguments.shape)


def _is_zero_stiffness(stiffness: float, depth: float, force: float) -> bool:
    """Return whether a reduced ``stiffness`` counts as zero at the reduced ``force`` and the
    ``depth`` y - y_1 (:data:`_ZERO_RATIO`).
    """
    return bool(stiffness * depth < _ZERO_RATIO * force)


def _integrate_over_steps(table: Array, rise: Array, start: float) -> Array:
    """Return the Chebyshev coefficients (n + 2, steps) of the integral over y of a function with
    the Chebyshev coefficients ``table`` (n, steps).

    The variable is t, which runs from -1 to 1 on each step, and ``rise`` (2, steps) are the
    coefficients of dy/dt, which is linear in t. Steps are in ascending order. The integral is
    ``start`` at the lower end of the first step, and continuous from step to step.
    """
    # the product of the function and dy/dt, as 2 T_1 T_m = T_(m + 1) + T_|m - 1|
    product = np.zeros((len(table) + 1, table.shape[1]))
    product[:-1] += rise[0] * table
    product[1:] += 0.5 * rise[1] * table
    product[1] += 0.5 * rise[1] * table[0]
    product[:-2] += 0.5 * rise[1] * table[1:]
    # zero at the lower end of each step, to which the integral up to there is then added
    integral = np.asarray(chebyshev.chebint(product, lbnd=-1.0), float)
    at_upper_ends = np.cumsum(np.sum(integral, axis=0))
    integral[0] += start + np.append(0.0, at_upper_ends[:-1])
    return integral


class Block(NamedTuple):
    """B adjoining steps in descending order, with s + 1 points on each, at which y = origin +
    root^2.

    Attributes
    ----------
    origin : (B, 1) y at the origin of each step.
    middle, half : (B, 1) middle and half length of each step in the root.
    root : (B, s + 1) square root u at the points.
    drop : (B, s + 1) root minus its value at the upper end of the step, with all digits.
    """

    origin: Array
    middle: Array
    half: Array
    root: Array
    drop: Array

    @classmethod
    def of(cls, steps: list[Step], points: Array) -> Block:
        """Return the block of ``steps``, in descending order, with ``points`` (s + 1,) from -1 to 1
        on each.
        """
        origin, low, high = np.array(steps).T[:, :, None]
        middle = 0.5 * (low + high)
        half = 0.5 * (high - low)
        inner_roots = (middle + half * points)[:, 1:-1]
        # the ends are copied, because middle - half is rounded, and the root at an opening must be
        # exactly zero
        root = np.concatenate([low, inner_roots, high], axis=1)
        drop = half * (points - 1.0)
        return cls(origin, middle, half, root, drop)

    @property
    def y(self) -> Array:
        """(B, s + 1) reduced overlap at the points."""
        return self.origin + self.root**2


# -- averages over the balls of a density ----------------------------------------------------------


class DensityBalls:
    """Averages over the balls of a ``shape`` whose diameters have a density, at the points of a
    ``block``; all in reduced units.

    ``xi`` is the local-field factor, and ``n_nodes`` the number of nodes of the quadrature over
    balls.

    Attributes
    ----------
    base_force : (B, s + 1) mean force <F^Q>, from which forces are counted.
    base_stiffness : (B, s + 1) derivative of this force.
    weights, stiffness, force : (B, s + 1, nodes) weight of each node of the quadrature, and K^Q and
        F^Q less the mean force there.
    mean : (B, s + 1) mean stiffness <K^Q>.
    noise : (B,) rounding error to expect in the last coefficients of k, relative to k.
    """

    def __init__(self, shape: Shape, xi: float, n_nodes: int, block: Block) -> None:
        """Evaluate forces and stiffnesses at the nodes of the quadrature."""
        y = block.y
        nodes = shape.nodes(y, n_nodes)
        self.xi = xi
        self.weights = nodes.weights
        self.base_force = shape.force(y)
        self.base_stiffness = shape.stiffness(y)
        self.stiffness = shape.stiffness(y[..., None], nodes.positions)
        self.force = shape.force(y[..., None], nodes.positions) - self.base_force[..., None]
        self.mean = np.sum(nodes.weights * self.stiffness, axis=-1)
        # k is the derivative of a polynomial through the points of a step. Differentiation
        # amplifies the rounding of y and of the forces by the square of the number of points, over
        # the extent of the step in y, which is 4 middle half
        lengths = (self.base_force / self.base_stiffness + np.abs(y))[:, -1:]
        n_points = block.root.shape[1]
        amplification = n_points**2 * lengths / (4.0 * block.middle * block.half)
        self.noise = np.minimum(_ROUNDING * amplification[:, 0], _WORST_NOISE)

    def balance(self, k: Array) -> tuple[Array, Array, Array]:
        """Return three arrays for the stiffness ``k`` (B, s + 1) at the points: the force G(y, k)
        less ``base_force``, (B, s + 1); dG/dk, (B, s + 1); and G at the lower ends of the steps,
        (B,).

        G is the mean of F^Q over balls with the weights 1/(K^Q + Xi k), their compliances.
        """
        compliance = 1.0 / (self.stiffness + self.xi * k[..., None])
        weights = self.weights * compliance
        total_weight = np.sum(weights, axis=-1)
        force = np.sum(weights * self.force, axis=-1) / total_weight
        excess = self.force - force[..., None]
        by_k = -self.xi * np.sum(weights * compliance * excess, axis=-1) / total_weight
        return force, by_k, (self.base_force + force)[:, 0]


# -- averages over listed diameters ----------------------------------------------------------------


class PointAverages:
    """Averages over the balls of a ``shape`` of n listed diameters, by sums over the contacts of
    all pairs, for the local-field factor ``xi``.
    """

    def __init__(self, shape: PointShape, xi: float) -> None:
        """Sort the openings of all pairs, and tabulate the weight of each pair in the sums of its
        balls.
        """
        from scipy.sparse import csc_array

        self.xi = xi
        x = np.array(shape.positions)
        w = np.array(shape.weights)
        # (n,) weights of the listed diameters
        self._weights = w
        # (n, n) openings of all pairs, in units of W
        self._opening_matrix = -0.5 * (x[:, None] + x)
        i, j = np.triu_indices(w.size)
        order = np.argsort(self._opening_matrix[i, j], kind="stable")
        i = i[order]
        j = j[order]
        # (m,) openings of pairs, ascending
        self._openings = self._opening_matrix[i, j]
        # a pair of unlike balls counts for both balls
        unlike_pairs = np.flatnonzero(i != j)
        rows = np.concatenate([i, j[unlike_pairs]])
        columns = np.concatenate([np.arange(i.size), unlike_pairs])
        weights = np.concatenate([w[j], w[i[unlike_pairs]]])
        # (n, m) weights of each pair in the sums of its two balls, sparse
        self._pair_weights: Any = csc_array((weights, (rows, columns)), shape=(w.size, i.size))

    def _find_range(self, block: Block) -> tuple[float, float, float, slice]:
        """Return the middle and the half extent of a ``block`` in y, counted from its least origin;
        the greatest opening of far contacts; and the slice of the openings of near contacts.
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

    def limit_steps(self, block: Block) -> int:
        """Return the number of steps of a ``block`` that may be solved at once, such that the work
        on near and far contacts is balanced and arrays of near contacts stay small.

        If the number is less than that of the block, the work on a block of so many steps may still
        be too much, and the method is to be called again for that block.
        """
        point_count: int = block.root.shape[1]
        n_steps = min(len(block.root), max(_LEAST_STEPS, len(self._weights) // 3))
        *_, near_contacts = self._find_range(block)
        near_count: int = near_contacts.stop - near_contacts.start
        n_elements = near_count * n_steps * point_count
        if n_steps > 1 and n_elements > _MOST_NEAR_ELEMENTS:
            return n_steps // 2
        return n_steps

    def balls(self, block: Block) -> PointBalls:
        """Return the averages at the points of a ``block``, from sums over near contacts plus sums
        over far contacts.

        For each ball four sums are formed: the stiffness (n, B, s + 1), the changes of stiffness
        and of force from the upper end of the step (n, B, s + 1), and the force at the upper end
        (n, B).
        """
        middle, half, last_far, near = self._find_range(block)
        sums = self._sum_near(block, near)
        if near.start:
            far_sums = self._sum_far(block, middle, half, last_far)
            sums = [near_sum + far_sum for near_sum, far_sum in zip(sums, far_sums, strict=True)]
        return PointBalls(self._weights, self.xi, *sums)

    def _sum_near(self, block: Block, near_contacts: slice) -> list[Array]:
        """Return the four sums of :meth:`balls` at the points of a ``block`` over the
        ``near_contacts``, contact by contact; arrays of contacts are (near contacts, B) or (near
        contacts, B, s + 1).
        """
        openings = self._openings[near_contacts]
        pair_weights = self._pair_weights[..., near_contacts]
        origin = block.origin[:, 0]
        is_closed = openings[:, None] <= origin
        # h^(1/2) of the overlaps h = (origin - opening) + u^2, and its change from the upper end
        overlap_at_origin = np.where(is_closed, origin - openings[:, None], 0.0)
        root = np.sqrt(overlap_at_origin[..., None] + block.root**2) * is_closed[..., None]
        top_root = root[..., -1:]  # at the upper end
        sum_of_roots = np.where(is_closed[..., None], root + top_root, np.inf)
        change = block.drop * (block.root + block.root[:, -1:]) / sum_of_roots

        def sum_pairs(terms: Array) -> Array:
            """Return the sums (n, ...), over the pairs of each ball, of the ``terms`` (m, ...) of
            the m pairs.
            """
            shape = terms.shape[1:]
            columns = terms.reshape(len(terms), int(np.prod(shape)))
            return np.asarray(pair_weights @ columns).reshape(-1, *shape)

        # root^3 - top_root^3
        force_changes = change * (root * (root + top_root) + top_root * top_root)
        top_forces = top_root[..., 0] ** 3
        return [
            1.5 * sum_pairs(root),
            1.5 * sum_pairs(change),
            sum_pairs(force_changes),
            sum_pairs(top_forces),
        ]

    def _sum_far(self, block: Block, middle: float, half: float, last_far: float) -> list[Array]:
        """Return the four sums of :meth:`balls` over far contacts, as polynomials on the range of
        the ``block``: the slope of the stiffness is interpolated, and integrated twice.

        ``middle``, ``half`` and ``last_far`` are the first three numbers of :meth:`_find_range`.
        """
        w = self._weights
        least_origin = block.origin[-1, 0]
        is_far = self._opening_matrix <= last_far
        # (n, n) overlaps at the middle of the range. Near contacts are left out of the sums: an
        # infinite overlap has no slope of the stiffness, and an overlap of zero no force
        overlap = least_origin - self._opening_matrix + middle
        nodes = chebyshev.chebpts1(_DEGREE + 1)
        far_overlap = np.where(is_far, overlap, np.inf)
        slope = np.stack([0.75 / np.sqrt(far_overlap + half * node) @ w for node in nodes])
        slope_series = np.linalg.solve(chebyshev.chebvander(nodes, _DEGREE), slope)
        far_overlap = np.where(is_far, overlap, 0.0)
        root = np.sqrt(far_overlap)
        stiffness_series = _integrate_series(slope_series, half, 1.5 * root @ w)
        force_series = _integrate_series(stiffness_series, half, far_overlap * root @ w)
        t = (block.origin - least_origin + block.root**2 - middle) / half
        drop = block.drop * (block.root + block.root[:, -1:]) / half
        basis, basis_change = _find_polynomials(t, drop, len(force_series))
        return [
            _sum_series(stiffness_series, basis),
            _sum_series(stiffness_series, basis_change),
            _sum_series(force_series, basis_change),
            _sum_series(force_series, basis[..., -1]),
        ]


def _find_polynomials(t: Array, drop: Array, count: int) -> tuple[Array, Array]:
    """Return the Chebyshev polynomials T_m, (count, B, s + 1), at the variable ``t`` (B, s + 1),
    and their differences from T_m at the last point of each row, (count, B, s + 1).

    ``drop`` (B, s + 1) is t less its value at the last point. Both results are found by recurrence,
    so that the differences lose no digits; ``count`` is two or more.
    """
    polynomials = [np.ones_like(t), t]
    changes = [np.zeros_like(t), drop]
    for _ in range(count - 2):
        change = 2.0 * (drop * polynomials[-1] + t[:, -1:] * changes[-1]) - changes[-2]
        polynomials.append(2.0 * t * polynomials[-1] - polynomials[-2])
        changes.append(change)
    return np.stack(polynomials), np.stack(changes)


def _sum_series(table: Array, terms: Array) -> Array:
    """Return the values (n, ...) of n Chebyshev series with the coefficients ``table`` (m, n);
    ``terms`` (m or more, ...) are the values of the Chebyshev polynomials.
    """
    return np.asarray(np.einsum("mn,m...->n...", table, terms[: len(table)]))


def _integrate_series(table: Array, scale: float, middle: Array) -> Array:
    """Return the Chebyshev coefficients (m + 1, n) of the integrals of n series with the
    coefficients ``table`` (m, n), over ``scale`` times the variable; their values at 0 are
    ``middle`` (n,).
    """
    integral = np.asarray(chebyshev.chebint(table, scl=scale), float)
    integral[0] += middle - chebyshev.chebval(0.0, integral)
    return integral


@dataclass(frozen=True, eq=False)
class PointBalls:
    """Averages over n listed diameters at the points of a block, with the same interface as
    :class:`DensityBalls`; all in reduced units.

    Attributes
    ----------
    weights : (n,) weights of the listed diameters.
    xi : local-field factor.
    stiffness : (n, B, s + 1) K^Q at the points.
    change, force_change : (n, B, s + 1) changes of K^Q and of F^Q from the upper end of the step.
    top_force : (n, B) F^Q at the upper end of the step.
    """

    weights: Array
    xi: float
    stiffness: Array
    change: Array
    force_change: Array
    top_force: Array

    #: derivative of the force from which forces are counted, a constant on each step
    base_stiffness = 0.0
    #: zero, because no differences of large numbers are taken
    noise = 0.0

    @cached_property
    def mean(self) -> Array:
        """(B, s + 1) mean stiffness <K^Q>, reduced."""
        return self._average(self.stiffness)

    def balance(self, k: Array) -> tuple[Array, Array, Array]:
        """Return three arrays for the stiffness ``k`` (B, s + 1) at the points: the force G(y, k)
        less its value at the upper end of the step, (B, s + 1); dG/dk, (B, s + 1); and G at the
        lower ends of the steps, (B,).

        G is the mean of F^Q over balls with the weights 1/(K^Q + Xi k), their compliances.
        """
        compliance = 1.0 / (self.stiffness + self.xi * k)
        top_compliance = compliance[..., -1]
        weighted_force = self._average(top_compliance * self.top_force)
        mean_top_force = weighted_force / self._average(top_compliance)
        top_excess = self.top_force - mean_top_force
        # <(F^Q - f) compliance> is zero at the upper end. So at the other points it is a sum of
        # the changes of F^Q and of the compliance from the upper end, which keeps all digits
        stiffness_change = self.change + self.xi * (k - k[:, -1:])  # of K^Q + Xi k
        changes = self.force_change - stiffness_change * (top_excess * top_compliance)[..., None]
        total_weight = self._average(compliance)
        force = self._average(compliance * changes) / total_weight
        excess = self.force_change + top_excess[..., None] - force
        by_k = -self.xi * self._average(compliance * compliance * excess) / total_weight
        return force, by_k, mean_top_force + force[:, 0]

    def _average(self, values: Array) -> Array:
        """Return the mean (...) over the listed diameters of ``values`` (n, ...)."""
        return np.asarray(np.einsum("n,n...->...", self.weights, values))


# -- its solution ----------------------------------------------------------------------------------


@lru_cache(maxsize=64)
def effective_curve(shape: Shape, xi: float) -> EffectiveCurve:
    """Return the curve of a ``shape`` and Xi = ``xi``, above zero and finite: the solution of
    equation (36). The relative errors of force and stiffness are 1e-8 or less from f* = 1e-4 on.
    Results are cached.

    Raises :class:`~granphon.base.errors.PrecisionError` if the steps do not settle where the medium
    is valid.
    """
    if shape.openings.size >= _MANY_OPENINGS:
        return solve_curve(shape, xi, STAGES_OF_SHORT, TOLERANCE_OF_SHORT)
    return solve_curve(shape, xi, _STAGES, _COEFFICIENT_TOLERANCE)


def _differentiate_curve(curve: EffectiveCurve) -> tuple[Array, Array, Array]:
    """Return the derivatives, with respect to Xi, of the tables of energy, force and stiffness of a
    ``curve``.

    The curve solves k = dG/dy, where k is the stiffness and G(y, k) the force, at the overlap y. At
    a given y, G is a function of Xi k alone, so that dG/dXi = (dG/dk) (dk/dXi + k/Xi). With this
    expression, the derivative of the equation is linear in dk/dXi. It is solved downwards from the
    series, on the steps of the curve, several steps at a time.
    """
    shape = curve.shape
    xi = curve.xi
    points, derivative, coefficients = radau(len(curve.tables[STIFFNESS]) - 1)
    averages = PointAverages(shape, xi) if isinstance(shape, PointShape) else None
    slope = _differentiate_series(curve)  # dk/dXi at the upper end
    force_slope = 0.0  # that of the force, at the lower end of the steps that are done
    tables = []
    first_solved = curve.steps.shape[1]  # steps from this number on are solved
    while first_solved:
        block = _take_solved(curve, first_solved, points, averages)
        step_count = len(block.origin)
        balls = averages.balls(block) if averages else DensityBalls(shape, xi, _N_NODES, block)
        steps_of_block = slice(first_solved - step_count, first_solved)
        values = chebyshev.chebval(points, curve.tables[STIFFNESS][:, steps_of_block])
        k = np.asarray(values[::-1], float)  # a block has its steps in descending order
        _, by_k, _ = balls.balance(k)
        by_xi = by_k * k / xi  # dG/dXi at fixed k
        slopes = _solve_slopes(by_k, by_xi, derivative, block, slope)
        slope = float(slopes[-1, 0])
        force_slope = float(by_k[-1, 0] * slope + by_xi[-1, 0])
        tables.append(slopes @ coefficients.T)
        first_solved -= step_count
    stiffness = np.concatenate(tables)[::-1].T
    rise = 2.0 * curve.steps[2] * curve.steps[1:]
    forces = _integrate_over_steps(stiffness, rise, force_slope)
    return _integrate_over_steps(forces, rise, 0.0), forces, stiffness


def _take_solved(
    curve: EffectiveCurve, end: int, points: Array, averages: PointAverages | None
) -> Block:
    """Return the block of the steps of a ``curve`` below number ``end``, with ``points`` (s + 1,)
    from -1 to 1 on each: as many steps as are worked on at once, which for listed diameters their
    ``averages`` limit.
    """
    steps = _list_steps(curve, slice(max(0, end - _MANY_STEPS), end))
    block = Block.of(steps, points)
    if averages is None:
        return block
    return Block.of(steps[: averages.limit_steps(block)], points)


def _differentiate_series(curve: EffectiveCurve) -> float:
    """Return dk/dXi where the series of a ``curve`` begins."""
    shape = curve.shape
    xi = curve.xi
    start = curve.series.start

    def find_stiffness(step: float) -> float:
        """Return k at Xi (1 + ``step``)."""
        return high_pressure_series(shape, xi * (1.0 + step)).value(start, STIFFNESS)

    return float(differentiate(find_stiffness, _STEP_OF_XI) / xi)


def _solve_slopes(
    by_k: Array, by_xi: Array, derivative: Array, block: Block, top_slope: float
) -> Array:
    """Return dk/dXi (B, s + 1) at the points of a ``block`` of B steps that are solved; it is
    ``top_slope`` at the upper end of the block.

    ``by_k`` is dG/dk and ``by_xi`` is dG/dXi at fixed k, (B, s + 1) each; ``derivative`` (s, s + 1)
    is ``to_slopes`` of :func:`radau`.
    """
    slopes = np.empty_like(by_k)
    change = _solve_steps(by_k, derivative, block, -by_xi @ derivative.T, top_slope)
    assert change is not None  # the same matrix has solved for k
    slopes[:, :-1] = change
    slopes[:, -1] = np.append(top_slope, slopes[:-1, 0])
    return slopes


def _list_steps(curve: EffectiveCurve, numbers: slice) -> list[Step]:
    """Return the steps of a ``curve`` with the ``numbers`` in a slice, in descending order."""
    steps = []
    for origin, middle, half in curve.steps[:, numbers].T[::-1].tolist():
        # a step that begins at an opening begins at the root 0, without rounding
        low = 0.0 if middle == half else middle - half
        steps.append((origin, low, middle + half))
    return steps


def radau(stages: int) -> tuple[Array, Array, Array]:
    """Return the collocation rule on [-1, 1] with s = ``stages`` Radau points.

    Returns
    -------
    points : (s + 1,) the Radau points, of which the first is -1, followed by +1.
    to_slopes : (s, s + 1) matrix from values at the points to the derivative, at the Radau points,
        of the polynomial through these values.
    to_series : (s + 1, s + 1) matrix from values at the points to the Chebyshev coefficients of
        this polynomial.
    """
    from scipy.special import roots_jacobi

    inner_points = np.empty(0)
    if stages > 1:
        inner_points, _ = roots_jacobi(stages - 1, 0.0, 1.0)
    points = np.concatenate([[-1.0], inner_points, [1.0]])
    to_series = np.linalg.inv(chebyshev.chebvander(points, stages))
    # a column of to_series is the polynomial that is 1 at one of the points, 0 at the others
    derivatives = [chebyshev.chebder(polynomial) for polynomial in to_series.T]
    to_slopes = np.stack([chebyshev.chebval(points[:-1], series) for series in derivatives], axis=1)
    return points, to_slopes, to_series


def solve_curve(
    shape: Shape,
    xi: float,
    stages: int,
    tolerance: float,
    longest: float = np.inf,
    n_nodes: int = _N_NODES,
) -> EffectiveCurve:
    """Return the curve of a ``shape`` and Xi = ``xi``, the solution of equation (36) with s =
    ``stages`` collocation points on each step.

    A step is halved until the last two Chebyshev coefficients of k are no larger than
    ``tolerance`` times the least k on the step. No step is longer than ``longest`` in the square
    root u. ``n_nodes`` is the number of nodes of the quadrature over the balls of a density. The
    curve ends at low forces as :class:`EffectiveCurve` describes it. Raises
    :class:`~granphon.base.errors.PrecisionError` if steps do not settle where the medium is valid.
    """
    return _CurveSolver(shape, xi, stages, tolerance, longest, n_nodes).run()


class _CurveSolver:
    """The solution of equation (36), downwards from the high-pressure series, several steps at a
    time. The arguments are those of :func:`solve_curve`.

    Attributes
    ----------
    averages : sums over the pairs of listed diameters; None for a density.
    points, derivative, coefficients : the collocation rule, as :func:`radau` returns it.
    series : the high-pressure series, which gives ``stiffness`` and ``force`` at first.
    first_opening : y at which the first contact closes.
    pending_steps : steps to be solved, in ascending order; the last of them is solved next.
    stiffness, force : k and f* at the upper end of the step that is solved next.
    count : number of steps to be solved at once.
    guess : overlaps and k/<K^Q> of the last attempt, if it has to be repeated; else None.
    steps, tables : of each solved block, in descending order: the origin, the middle and the half
        length of its steps, (B, 3), and the Chebyshev coefficients of k on them, (B, s + 1).
    """

    def __init__(
        self, shape: Shape, xi: float, stages: int, tolerance: float, longest: float, n_nodes: int
    ) -> None:
        """Divide the range below the series into steps; none of them is solved yet."""
        self.shape = shape
        self.xi = xi
        self.tolerance = tolerance
        self.n_nodes = n_nodes
        self.averages = PointAverages(shape, xi) if isinstance(shape, PointShape) else None
        self.points, self.derivative, self.coefficients = radau(stages)
        self.series = high_pressure_series(shape, xi)
        start = self.series.start
        self.pending_steps = _divide_range([*shape.openings.tolist(), start], longest)
        self.first_opening = self.pending_steps[0][0]
        self.stiffness = self.series.value(start, STIFFNESS)
        self.force = self.series.value(start, FORCE)
        self.count = 1
        self.guess: tuple[Array, Array] | None = None
        self.steps: list[Array] = []
        self.tables: list[Array] = []

    def run(self) -> EffectiveCurve:
        """Solve steps until the curve ends, and return the curve.

        Raises :class:`~granphon.base.errors.PrecisionError` as :func:`solve_curve` does.
        """
        can_go_on = True
        while can_go_on and self.force > LEAST_SOLVED_FORCE and not self._has_zero_stiffness():
            can_go_on = self._advance()
        return _make_curve(self.shape, self.xi, self.series, self.steps, self.tables, self.force)

    def _has_zero_stiffness(self) -> bool:
        """Return whether the stiffness counts as zero (:data:`_ZERO_RATIO`) at the upper end of the
        next step.
        """
        origin, _, high = self.pending_steps[-1]
        depth = origin - self.first_opening + high**2
        return _is_zero_stiffness(self.stiffness, depth, self.force)

    def _is_at_first_contact(self, step: Step) -> bool:
        """Return whether the lower end of a ``step`` is the overlap at which the first contact
        closes, where force and stiffness are both zero.
        """
        return step[:2] == (self.first_opening, 0.0)

    def _advance(self) -> bool:
        """Solve the next steps, or divide them if they are not resolved; return False if the curve
        ends at their upper end, as they are not resolved however short they are.

        Raises :class:`~granphon.base.errors.PrecisionError` if that is where the medium is valid.
        """
        # steps are halved towards the first contact, and never contain it
        if self._is_at_first_contact(self.pending_steps[-1]):
            self.pending_steps[-1:] = _halve(self.pending_steps[-1])
            return True
        steps, block = self._take_steps()
        balls = self._average(block)
        start = _estimate(balls, block, self.guess, self.stiffness)
        solution = _relax(balls, self.derivative, block, start, self.stiffness)
        # steps on which the solution fails, or is not resolved, must be halved
        is_rough = np.ones(len(steps), bool)
        if solution is not None:
            k, _ = solution
            table = k @ self.coefficients.T
            is_rough = _find_rough(table, k, np.maximum(self.tolerance, balls.noise))
        # doubles cannot tell apart the points of a step that is shorter than the shortest
        is_shortest = block.half < _SHORTEST_STEP * block.middle
        is_hopeless = bool(np.any(is_shortest[is_rough]))
        if len(steps) > 1 and (solution is None or is_hopeless):
            self.count = len(steps) // 2
            return True
        if is_hopeless and self.force >= VALID_FORCE:
            raise _explain_divergence(block)
        if is_hopeless:
            return False
        if solution is None:
            self._refine(steps, is_rough)
        elif np.any(is_rough):
            self._refine(steps, is_rough)
            self.guess = _sort_by_overlap(block.y, k / balls.mean)
        else:
            self._keep(block, solution)
        return True

    def _take_steps(self) -> tuple[list[Step], Block]:
        """Return the next steps, in descending order, and their block: the last :attr:`count` of
        the pending steps, or all if these are fewer, but never the step that begins at the first
        contact, which is halved first. :attr:`count` becomes less if the work on so many would be
        too much.
        """
        next_steps = reversed(self.pending_steps[-self.count :])
        steps = [step for step in next_steps if not self._is_at_first_contact(step)]
        while True:
            block = Block.of(steps, self.points)
            # steps of a density are long and few: one is solved at a time, because a step that must
            # be halved makes the work on the steps below it useless
            most_steps = self.averages.limit_steps(block) if self.averages is not None else 1
            if most_steps >= len(steps):
                return steps, block
            self.count = most_steps
            steps = steps[:most_steps]

    def _average(self, block: Block) -> DensityBalls | PointBalls:
        """Return the averages over balls at the points of a ``block``."""
        if self.averages is not None:
            return self.averages.balls(block)
        return DensityBalls(self.shape, self.xi, self.n_nodes, block)

    def _refine(self, steps: list[Step], is_rough: Flags) -> None:
        """Put the halves of those ``steps`` for which ``is_rough`` (steps,) is true in their place;
        all of them are to be solved next, at once.
        """
        finer_steps = _halve_rough(steps, is_rough)
        self.pending_steps[-len(steps) :] = finer_steps
        self.count = len(finer_steps)

    def _keep(self, block: Block, solution: tuple[Array, Array]) -> None:
        """Keep a ``solution`` of :func:`_relax` on the steps of a ``block``, which are then no
        longer pending. Steps below the first one that reaches the least force are dropped.
        """
        k, forces = solution
        block_size = len(block.origin)
        solved_count = min(block_size, 1 + int(np.count_nonzero(forces > LEAST_SOLVED_FORCE)))
        geometry = np.concatenate([block.origin, block.middle, block.half], axis=1)
        self.steps.append(geometry[:solved_count])
        self.tables.append((k @ self.coefficients.T)[:solved_count])
        self.stiffness = float(k[solved_count - 1, 0])
        self.force = float(forces[solved_count - 1])
        del self.pending_steps[-block_size:]
        self.count *= 2  # more steps are tried at once as long as they succeed
        self.guess = None


def _explain_divergence(block: Block) -> PrecisionError:
    """Return the error of a ``block`` whose first step is not resolved however short it is."""
    overlap = float(block.y[0, -1])
    return PrecisionError(
        f"the effective medium does not converge below an overlap of {overlap:.6g} widths",
        mend="Raise the load",
    )


def _sort_by_overlap(y: Array, ratio: Array) -> tuple[Array, Array]:
    """Return overlaps ``y`` (B, s + 1) and the ``ratio`` (B, s + 1) at them, both flat, (m,), in
    ascending order of the overlap.
    """
    order = np.argsort(y, axis=None)
    return y.ravel()[order], ratio.ravel()[order]


def _divide_range(ends: list[float], longest: float) -> list[Step]:
    """Return the initial steps, in ascending order, between the reduced overlaps ``ends``, which
    are the openings and the start of the series.

    The lowest step above an opening is halved while the next opening below is near
    (:data:`_OPENING_DISTANCE`). No step is longer than ``longest`` in the square root u.
    """
    steps: list[Step] = []
    next_below = -np.inf
    for origin, end in pairwise(ends):
        cuts = [math.sqrt(end - origin)]  # values of u, descending
        while origin - next_below < _OPENING_DISTANCE * cuts[-1] ** 2:
            cuts.append(0.5 * cuts[-1])
        for low, high in pairwise([0.0, *reversed(cuts)]):
            n_pieces = 2 ** math.ceil(math.log2(max(1.0, (high - low) / longest)))
            roots = np.linspace(low, high, n_pieces + 1).tolist()
            steps += [(origin, *step_roots) for step_roots in pairwise(roots)]
        next_below = origin
    return steps


def _make_curve(
    shape: Shape,
    xi: float,
    series: Series,
    steps: list[Array],
    tables: list[Array],
    lowest_force: float,
) -> EffectiveCurve:
    """Return the curve of a ``shape`` and Xi from the solved blocks, which are in descending order.

    ``steps`` holds an array (B, 3) for each block: the origin, the middle and the half length of
    each step. ``tables`` holds an array (B, s + 1) for each: the Chebyshev coefficients of k.
    ``series`` is that beyond the steps, and ``lowest_force`` the reduced force at the lower end of
    the curve.
    """
    geometry = np.ascontiguousarray(np.concatenate(steps)[::-1].T)
    stiffness = np.ascontiguousarray(np.concatenate(tables)[::-1].T)
    # force and energy are integrals of the stiffness, so that all three agree exactly
    rise = 2.0 * geometry[2] * geometry[1:]  # dy/dt, as a series
    forces = _integrate_over_steps(stiffness, rise, lowest_force)
    # the curve and the series differ here by rounding alone; scaling the curve removes the jump
    scale = series.value(series.start, FORCE) / float(np.sum(forces[:, -1]))
    energies = _integrate_over_steps(forces, rise, 0.0)
    energies, forces, stiffness = (
        read_only(scale * table) for table in (energies, forces, stiffness)
    )
    return EffectiveCurve(shape, xi, series, read_only(geometry), (energies, forces, stiffness))


def _estimate(
    balls: DensityBalls | PointBalls,
    block: Block,
    guess: tuple[Array, Array] | None,
    top_stiffness: float,
) -> Array:
    """Return an estimate of the stiffness k (B, s + 1) at the points of a ``block``, with the value
    ``top_stiffness`` at its upper end.

    The ratio k/<K^Q>, <K^Q> being the mean stiffness of the ``balls``, is a smooth function of the
    overlap. The ratio is interpolated from the overlaps and ratios ``guess`` of the last attempt,
    or without one is a constant.
    """
    ratio = np.ones(block.y.shape) if guess is None else np.interp(block.y, *guess)
    scale = top_stiffness / (balls.mean[0, -1] * ratio[0, -1])
    return np.asarray(balls.mean * ratio * scale)


def _find_rough(table: Array, k: Array, tolerance: Array) -> Flags:
    """Return (B,) for each step whether the stiffness ``k`` (B, s + 1) is not resolved: one of the
    last two of its Chebyshev coefficients is above the tolerance times the least k.

    ``table`` (B, s + 1) are the coefficients, and ``tolerance`` is (B,) or (1,).
    """
    last_coefficients = np.max(np.abs(table[:, -2:]), axis=1)
    return np.asarray(last_coefficients > tolerance * np.min(k, axis=1))


def _halve_rough(steps: list[Step], is_rough: Flags) -> list[Step]:
    """Return the ``steps``, which are given in descending order, in ascending order; the two halves
    of a step stand in its place where ``is_rough`` (steps,) is true.
    """
    finer_steps = []
    for step, is_rough_step in zip(reversed(steps), reversed(is_rough.tolist()), strict=True):
        finer_steps += _halve(step) if is_rough_step else [step]
    return finer_steps


def _halve(step: Step) -> list[Step]:
    """Return the two halves of a ``step``, equal in the root, in ascending order."""
    origin, low, high = step
    middle = 0.5 * (low + high)
    return [(origin, low, middle), (origin, middle, high)]


def _relax(
    balls: DensityBalls | PointBalls,
    derivative: Array,
    block: Block,
    k: Array,
    top_stiffness: float,
) -> tuple[Array, Array] | None:
    """Return the stiffness k (B, s + 1) at the points of a ``block`` of B steps, which solves k =
    dG(y, k)/dy for the averages G over ``balls``, and the force (B,) at the lower ends of the
    steps; None if Newton's method fails.

    The estimate ``k`` (B, s + 1), from which the method starts, is overwritten. ``derivative``
    (s, s + 1) is ``to_slopes`` of :func:`radau`, and ``top_stiffness`` is k at the upper end of the
    block.
    """
    rise = 2.0 * block.half * block.root[:, :-1]  # dy/dt
    # k at the upper end of a step is k at the lower end of the step before
    k[:, -1] = np.append(top_stiffness, k[:-1, 0])
    for _ in range(_MOST_ITERATIONS):
        force, by_k, _ = balls.balance(k)
        # k dy/dt - dG/dt; `force` is G less a base force, whose derivative is the base stiffness
        residual = (k - balls.base_stiffness)[:, :-1] * rise - force @ derivative.T
        change = _solve_steps(by_k, derivative, block, residual, 0.0)
        if change is None:
            return None
        # a large change may overshoot; the stiffness is kept above zero
        k[:, :-1] = np.maximum(k[:, :-1] + change, 0.1 * k[:, :-1])
        k[1:, -1] = k[:-1, 0]
        if np.all(np.abs(change) <= _K_TOLERANCE * k[:, :-1]):
            # convergence is quadratic: no further iteration is needed
            _, _, lower_force = balls.balance(k)
            return k, lower_force
    return None


def _solve_steps(
    by_k: Array, derivative: Array, block: Block, residual: Array, top_change: float
) -> Array | None:
    """Return the changes (B, s) of the stiffness k, at the Radau points of a ``block`` of B steps,
    that remove a ``residual`` (B, s) of the equation k dy/dt = dG(y, k)/dt to first order; None if
    the linear equations have no finite solution.

    ``by_k`` (B, s + 1) is dG/dk. ``derivative`` (s, s + 1) takes values at the points to their
    derivatives at the Radau points, and ``top_change`` is the change of k at the upper end of the
    block.
    """
    rise = 2.0 * block.half * block.root[:, :-1]  # dy/dt
    inner_columns = derivative[:, :-1]
    last_column = derivative[:, -1]
    # k dy/dt = dG/dt at the Radau points, to first order in the change of k there. The first right
    # side is the residual, and the second the effect of a change of k at the upper end of the step
    matrix = inner_columns * by_k[:, None, :-1] - rise[:, :, None] * np.eye(len(inner_columns))
    sides = np.stack([residual, -last_column * by_k[:, -1:]], axis=-1)
    try:
        responses = np.linalg.solve(matrix, sides)
    except np.linalg.LinAlgError:
        return None
    # the change of k at the lower end of a step is linear in the change at its upper end
    end_changes = [top_change]
    for offset, gain in responses[:, 0].tolist():
        end_changes.append(offset + gain * end_changes[-1])
    upper_changes = np.array(end_changes[:-1])[:, None]
    change = responses[..., 0] + responses[..., 1] * upper_changes
    return change if np.all(np.isfinite(change)) else None
