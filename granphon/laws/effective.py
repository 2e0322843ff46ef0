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
from granphon.base.arrays import Array
from granphon.base.errors import PrecisionError
from granphon.base.results import read_only
from granphon.base.scales import WidthUnits
from granphon.laws.spread import Series, SpreadLaw, high_pressure_series

#: the number of one step, or an array of the step of each value
Index = int | NDArray[np.intp]
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
        curve = self.curve
        series = curve.far
        return float(
            curve.value(np.array(series.start), ENERGY) - series.value(series.start, ENERGY)
        )

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
    """Solution of equation (36) for one shape and Xi: steps in ascending order, and the series
    ``far`` beyond them.

    ``places`` (3, steps) holds origin, middle and half length of each step; ``tables`` holds
    energy, force and stiffness, (n, steps) each. The curve begins at f* = 1e-6, or where steps no
    longer settle in double precision if that is higher (but below the limit of validity).
    """

    shape: Shape
    xi: float
    far: Series
    places: Array
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
        depth = float(self.places[0, 0] + (self.places[1, 0] - self.places[2, 0]) ** 2) - float(
            self.shape.openings[0]
        )
        return bool(self.ends(STIFFNESS)[0, 0] * depth < _VANISHED * self.ends(FORCE)[0, 0])

    def ends(self, order: int) -> Array:
        """Return (2, steps) energy, force or stiffness at the lower and the upper end of each
        step.
        """
        table = self.tables[order]
        return np.stack(
            [np.sum(table[::2], axis=0) - np.sum(table[1::2], axis=0), np.sum(table, axis=0)]
        )

    def value(self, y: Array, order: int) -> Array:
        """Return a derivative of the energy, counted from the start of the curve, at y between
        there and ``far.start``.
        """

        def of(index: Index, part: Array) -> Array:
            return self._evaluate(index, np.sqrt(part - self.places[0, index]), order)

        # a kink belongs to the step below it, where the slope is finite
        return self._evaluate_by_step(np.searchsorted(self._edges[0], y), y, of)

    def overlap(self, force: Array) -> Array:
        """Return y at forces between those at the ends of the curve, by Newton's method."""

        below, above = self._edges[1]
        # at least the rounding of the force
        span = np.maximum(above - below, 4.0 * np.finfo(float).eps * below)

        def of(index: Index, wanted: Array) -> Array:
            origin, middle, half = self.places[:, index]
            # u is smooth in a variable from 0 to 1: where contacts open, f rises as u^2; elsewhere
            # it may span decades
            part = np.clip(wanted - below[index], 0.0, span[index])
            touching = self.places[1, index] == self.places[2, index]
            spread = np.log1p(part / below[index]) / np.log1p(span[index] / below[index])
            root = middle + half * (
                2.0 * np.where(touching, np.sqrt(part / span[index]), spread) - 1.0
            )
            for _ in range(30):
                miss = wanted - self._evaluate(index, root, FORCE)
                slope = 2.0 * root * self._evaluate(index, root, STIFFNESS)
                change = np.divide(miss, slope, out=np.zeros_like(root), where=slope > 0.0)
                root = np.clip(root + change, middle - half, middle + half)
                # either convergence, which is quadratic, needs no further iteration, or only
                # rounding is left
                settled = np.abs(change) <= 1e-9 * (middle + half)
                if np.all(settled | (np.abs(miss) <= 4.0 * np.finfo(float).eps * wanted)):
                    break
            return np.asarray(origin + root**2)

        return self._evaluate_by_step(np.searchsorted(above[:-1], force), force, of)

    @cached_property
    def _edges(self) -> tuple[Array, Array]:
        """Reduced overlap y where steps meet, and force f* (2, steps) at both ends of each step."""
        origin, middle, half = self.places
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
            for i in np.flatnonzero(self.places[1] == self.places[2]):
                series = chebyshev.chebdiv(
                    numerator[:, i], 2.0 * self.places[2, i] * self.places[1:, i]
                )[0]
                quotient[: series.size, i] = series
                numerator[:, i] = 0.0
        return quotient, numerator

    def _evaluate(self, index: Index, root: Array, order: int) -> Array:
        """Return a derivative of the energy at u = ``root`` on the steps ``index``."""
        _, middle, half = self.places[:, index]
        t = (root - middle) / half
        if order < SLOPE:
            return np.asarray(chebyshev.chebval(t, self.tables[order][:, index], tensor=False))
        whole, divided = (
            chebyshev.chebval(t, table[:, index], tensor=False) for table in self._slopes
        )
        rise = 2.0 * half * root
        return np.asarray(
            whole + np.divide(divided, rise, out=np.zeros_like(rise), where=divided != 0.0)
        )

    def _evaluate_by_step(
        self, index: NDArray[np.intp], values: Array, of: Callable[[Index, Array], Array]
    ) -> Array:
        flat = values.ravel()
        numbers = index.ravel()
        out = np.empty(flat.size)
        if flat.size < _MANY_VALUES * self.places.shape[1]:
            for begin in range(0, flat.size, _VALUES_AT_ONCE):
                part = slice(begin, begin + _VALUES_AT_ONCE)
                out[part] = of(numbers[part], flat[part])
            return out.reshape(values.shape)
        # sort by step, so that each step is evaluated once; small integers sort in linear time
        order = np.argsort(numbers.astype(np.min_scalar_type(self.places.shape[1])), kind="stable")
        ascending = flat[order]
        numbers = numbers[order]
        first = (
            np.flatnonzero(np.append(True, numbers[1:] != numbers[:-1]))
            if numbers.size
            else np.empty(0, int)
        )
        for begin, end in pairwise([*first.tolist(), order.size]):
            out[order[begin:end]] = of(int(numbers[begin]), ascending[begin:end])
        return out.reshape(values.shape)


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
    def of(cls, steps: list[tuple[float, float, float]], points: Array) -> Block:
        """Make a block from (origin, lower root, upper root) of each step, and ``points`` (s + 1,)
        from -1 to 1.
        """
        origin, low, high = np.array(steps).T[:, :, None]
        middle = 0.5 * (low + high)
        half = 0.5 * (high - low)
        # the ends are taken as given, because middle - half may round: at an opening the root must
        # be exactly zero
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
    ``common``, whose derivative is ``known`` (B, s + 1). ``noise`` (B,) is the rounding error to
    expect in the last coefficients of k, relative to k.
    """

    def __init__(self, shape: Shape, xi: float, order: int, block: Block) -> None:
        y = block.y
        nodes = shape.nodes(y, order)
        self.xi = xi
        self.weights = nodes.weights
        force, self.stiffness = (
            of(y[..., None], nodes.positions) for of in (shape.force, shape.stiffness)
        )
        self.common = shape.force(y)
        self.known = shape.stiffness(y)
        self.force = force - self.common[..., None]
        self.mean = np.sum(nodes.weights * self.stiffness, axis=-1)
        # on a short step differentiation amplifies the rounding of y and of the forces, which are
        # counted from their mean
        amplified = block.root.shape[1] ** 2 * (self.common / self.known + np.abs(y))[:, -1:]
        amplified /= 4.0 * block.middle * block.half
        self.noise = np.minimum(16.0 * np.finfo(float).eps * amplified[:, 0], _WORST_NOISE)

    def balance(self, k: Array) -> tuple[Array, Array, Array]:
        """Return G(y, k) less the force ``common``, and dG/dk, (B, s + 1); and G at the lower ends
        (B,).
        """
        part = 1.0 / (self.stiffness + self.xi * k[..., None])
        share = self.weights * part
        total = np.sum(share, axis=-1)
        force = np.sum(share * self.force, axis=-1) / total
        by_k = -self.xi * np.sum(share * part * (self.force - force[..., None]), axis=-1) / total
        return force, by_k, (self.common + force)[:, 0]


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
        self._matrix = -0.5 * (x[:, None] + x)
        # (m,) openings of pairs, ascending; and sparse (n, m) weights of each pair in the sums of
        # its two balls
        w = self._weights
        i, j = np.triu_indices(w.size)
        order = np.argsort(self._matrix[i, j], kind="stable")
        i = i[order]
        j = j[order]
        pair = np.arange(i.size)
        other = np.flatnonzero(i != j)
        rows = np.concatenate([i, j[other]])
        columns = np.concatenate([pair, other])
        self._openings = self._matrix[i, j]
        self._entries: Any = csc_array(
            (np.concatenate([w[j], w[i[other]]]), (rows, columns)), shape=(w.size, i.size)
        )

    def _find_range(self, block: Block) -> tuple[float, float, float, slice]:
        """Return the middle and the half extent in y of a block, above its least origin, and which
        contacts are near.

        Contacts with openings up to the third number are far; the slice is that of the openings of
        near contacts.
        """
        least = block.origin[-1, 0]
        low = block.root[-1, 0] ** 2
        high = block.origin[0, 0] - least + block.root[0, -1] ** 2
        middle = 0.5 * (low + high)
        half = 0.5 * (high - low)
        last = least - max(0.0, _FAR_OVERLAP * half - middle)
        begin, end = np.searchsorted(
            self._openings, [last, block.origin[0, 0]], side="right"
        ).tolist()
        return middle, half, last, slice(begin, end)

    def count(self, block: Block) -> int:
        """Return how many steps of the block should be solved at once, so that arrays of near
        contacts fit in memory.
        """
        steps = min(len(block.root), max(_LEAST_STEPS, len(self._weights) // 3))
        *_, near = self._find_range(block)
        return (
            steps // 2
            if steps > 1 and (near.stop - near.start) * steps * block.root.shape[1] > _MOST_NEAR
            else steps
        )

    def balls(self, block: Block) -> PointBalls:
        """Return the averages at the points of the block: the sums over near contacts plus those
        over far ones.

        Four quantities are summed for each ball: the stiffness, its change and the change of the
        force since the upper end of the step, (n, B, s + 1); and the force at the upper end, (n,
        B).
        """
        w = self._weights
        middle, half, last, near = self._find_range(block)
        openings = self._openings[near]
        entries = self._entries[..., near]
        closed = openings[:, None] <= block.origin[:, 0]
        rise = np.where(closed, block.origin[:, 0] - openings[:, None], 0.0)
        root = np.sqrt(rise[..., None] + block.root**2) * closed[..., None]
        top = root[..., -1:]
        change = (
            block.drop
            * (block.root + block.root[:, -1:])
            / np.where(closed[..., None], root + top, np.inf)
        )

        def summed(values: Array) -> Array:
            shape = values.shape[1:]
            return np.asarray(entries @ values.reshape(len(values), int(np.prod(shape)))).reshape(
                -1, *shape
            )

        forces = change * (root * (root + top) + top * top)
        near_sums = [
            1.5 * summed(root),
            1.5 * summed(change),
            summed(forces),
            summed(top[..., 0] ** 3),
        ]
        if not near.start:
            return PointBalls(w, self.xi, *near_sums)
        # the slope of the stiffness of far contacts is interpolated, and integrated twice
        least = block.origin[-1, 0]
        far = self._matrix <= last
        gap = np.where(far, least - self._matrix + middle, np.inf)
        nodes = chebyshev.chebpts1(_DEGREE + 1)
        slope = np.stack([0.75 / np.sqrt(gap + half * node) @ w for node in nodes])
        gap = np.where(far, gap, 0.0)
        root = np.sqrt(gap)
        series = np.asarray(np.linalg.solve(chebyshev.chebvander(nodes, _DEGREE), slope), float)
        stiffness = _integrate_series(series, half, 1.5 * root @ w)
        force = _integrate_series(stiffness, half, gap * root @ w)
        # T_m at the points, and its difference from T_m at the upper end of the step, both by
        # recurrence: no digits are lost
        t = (block.origin - least + block.root**2 - middle) / half
        drop = block.drop * (block.root + block.root[:, -1:]) / half
        values, changes = [np.ones_like(t), t], [np.zeros_like(t), drop]
        for _ in range(len(force) - 2):
            values.append(2.0 * t * values[-1] - values[-2])
            changes.append(2.0 * (drop * values[-2] + t[:, -1:] * changes[-1]) - changes[-2])
        basis = np.stack(values)
        change = np.stack(changes)

        far_sums = [
            np.einsum("mn,m...->n...", table, terms[: len(table)])
            for table, terms in (
                (stiffness, basis),
                (stiffness, change),
                (force, change),
                (force, basis[..., -1]),
            )
        ]
        return PointBalls(
            w, self.xi, *(one + other for one, other in zip(near_sums, far_sums, strict=True))
        )


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

    known = 0.0
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
        part = 1.0 / (self.stiffness + self.xi * k)
        last = part[..., -1]
        start = self._average(last * self.top) / self._average(last)
        excess = self.top - start
        # <(F^Q - f) part> is zero at the upper end: elsewhere it is the sum of the changes of F^Q
        # and of part
        moved = self.work - (self.change + self.xi * (k - k[:, -1:])) * (excess * last)[..., None]
        total = self._average(part)
        force = self._average(part * moved) / total
        by_k = (
            -self.xi * self._average(part * part * (self.work + excess[..., None] - force)) / total
        )
        return force, by_k, start + force[:, 0]

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
    (points, derivative, coefficients), far = radau(stages), high_pressure_series(shape, xi)
    # the initial steps in ascending order, each as (origin, lower root, upper root)
    pending: list[tuple[float, float, float]] = []
    ends = [*shape.openings.tolist(), far.start]
    for below, origin, end in zip([-np.inf, *ends], ends[:-1], ends[1:], strict=False):
        cuts = [math.sqrt(end - origin)]
        while origin - below < _NEAR * cuts[-1] ** 2:
            cuts.append(0.5 * cuts[-1])
        for low, high in pairwise([0.0, *reversed(cuts)]):
            parts = 2 ** math.ceil(math.log2(max(1.0, (high - low) / most)))
            pending += [
                (origin, *part) for part in pairwise(np.linspace(low, high, parts + 1).tolist())
            ]
    first = pending[0][0]
    top = far.value(far.start, STIFFNESS)
    force = far.value(far.start, FORCE)
    places = []
    series = []
    count = 1
    guess = None
    while (
        force > LEAST_SOLVED_FORCE
        and top * (pending[-1][0] - first + pending[-1][2] ** 2) > _VANISHED * force
    ):
        # where the first contact opens, force and stiffness are both zero: steps approach that end
        # but do not include it
        if pending[-1][:2] == (first, 0.0):
            pending[-1:] = _halve(pending[-1])
            continue
        steps = [step for step in pending[: -count - 1 : -1] if step[:2] != (first, 0.0)]
        block = Block.of(steps, points)
        # of a density one at a time: steps are long and few, and to halve one would make the work
        # on those below useless
        if (fewer := averages.count(block) if averages else 1) < len(steps):
            count = fewer
            continue
        balls = averages.balls(block) if averages else DensityBalls(shape, xi, order, block)
        # k/<K^Q> is smooth: start from that of the last attempt, or from a constant
        ratio = np.ones(block.y.shape) if guess is None else np.interp(block.y, *guess)
        found = _relax(
            balls,
            derivative,
            block,
            balls.mean * ratio * (top / (balls.mean[0, -1] * ratio[0, -1])),
            top,
        )
        if found is None:
            rough = np.ones(len(steps), bool)
        else:
            k, forces = found
            table = k @ coefficients.T
            rough = np.max(np.abs(table[:, -2:]), axis=1) > np.maximum(
                tolerance, balls.noise
            ) * np.min(k, axis=1)
        hopeless = np.any((block.half < _SHORTEST * block.middle)[rough])
        if len(steps) > 1 and (found is None or hopeless):
            count = len(steps) // 2
            continue
        if hopeless:  # doubles cannot tell apart the points of a shorter step
            if force < VALID_FORCE:
                break
            place = f"an overlap of {float(block.y[0, -1]):.6g} widths"
            raise PrecisionError(
                f"the effective medium does not converge below {place}", mend="Raise the load"
            )
        if np.any(rough):
            finer = [
                _halve(step) if bad else [step]
                for step, bad in zip(steps, rough.tolist(), strict=True)
            ]
            pending[-len(steps) :] = [step for piece in reversed(finer) for step in piece]
            count = sum(map(len, finer))
            if found is not None:
                ascending = np.argsort(block.y, axis=None)
                guess = block.y.ravel()[ascending], (k / balls.mean).ravel()[ascending]
            continue
        kept = min(len(steps), 1 + int(np.count_nonzero(forces > LEAST_SOLVED_FORCE)))
        places.append(np.concatenate([block.origin, block.middle, block.half], axis=1)[:kept])
        series.append(table[:kept])
        top = float(k[kept - 1, 0])
        force = float(forces[kept - 1])
        del pending[-len(steps) :]
        count = 2 * count
        guess = None
    where, stiffness = (
        np.ascontiguousarray(np.concatenate(parts)[::-1].T) for parts in (places, series)
    )
    # force and energy are integrals
    rise = 2.0 * where[2] * where[1:]  # dy/dt, as a series
    forces = _integrate_over_steps(stiffness, rise, force)
    # the curve and the series differ here by rounding alone; scaling the curve removes the jump
    scale = far.value(far.start, FORCE) / float(np.sum(forces[:, -1]))
    energies = _integrate_over_steps(forces, rise, 0.0)
    energies, forces, stiffness = (
        read_only(scale * table) for table in (energies, forces, stiffness)
    )
    return EffectiveCurve(shape, xi, far, read_only(where), (energies, forces, stiffness))


def _halve(step: tuple[float, float, float]) -> list[tuple[float, float, float]]:
    origin, low, high = step
    return [(origin, low, 0.5 * (low + high)), (origin, 0.5 * (low + high), high)]


def _relax(
    balls: DensityBalls | PointBalls, derivative: Array, block: Block, k: Array, top: float
) -> tuple[Array, Array] | None:
    """Find k at the points of a block and the force at the lower ends, by Newton's method from
    ``k``; None if it fails.
    """
    rise = 2.0 * block.half * block.root[:, :-1]  # dy/dt
    inner = derivative[:, :-1]
    last = derivative[:, -1]
    k[:, -1] = np.append(top, k[:-1, 0])
    for _ in range(30):
        force, by_k, _ = balls.balance(k)
        matrix = inner * by_k[:, None, :-1] - rise[:, :, None] * np.eye(len(inner))
        miss = (k - balls.known)[:, :-1] * rise - force @ derivative.T
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
        if np.all(np.abs(change) <= _SETTLED * k[:, :-1]):
            # convergence is quadratic: no further iteration is needed
            return k, balls.balance(k)[2]
    return None
