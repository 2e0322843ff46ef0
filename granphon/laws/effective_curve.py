"""The law of the effective medium as a curve: polynomials on steps, and the high-pressure series beyond them.

On a step y = origin + u^2, and k is a polynomial in u. Force and energy are integrals of this polynomial and the slope of k
is its derivative, so that all four agree exactly. There are tens of steps or, for long lists of diameters, tens of
thousands, so a curve is stored as arrays over steps: an element of an (n, steps) table is the coefficient of a Chebyshev
polynomial of t = (u - middle)/half, -1 <= t <= 1.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property
from itertools import pairwise

import numpy as np
from numpy.polynomial import chebyshev
from numpy.typing import NDArray

from granphon.balls.distributions import PointShape, Shape
from granphon.base.results import read_only
from granphon.laws.spread import ENERGY, FORCE, SLOPE, STIFFNESS, Series

Array = NDArray[np.float64]
#: the number of one step, or an array of the step of each value
Index = int | NDArray[np.intp]
#: f* down to which the curve is solved, far below the paper's limit of validity
LEAST_SOLVED_FORCE = 1e-6
#: f* from which Section IV states that the medium is valid, by comparison with simulations of the triangular lattice
VALID_FORCE = 0.08
#: value of k (y - y_1)/f* below which the stiffness counts as zero, y_1 being the overlap of the first contact: wherever the
#: law stiffens the ratio is one or more
VANISHED = 1e-7
#: number of values worked on at once where the coefficients of its step are copied for each value
_VALUES_AT_ONCE = 2**13
#: number of values per step from which values are sorted by step
_MANY_VALUES = 64


@dataclass(frozen=True, eq=False)
class EffectiveCurve:
    """Solution of equation (36) for one shape and Xi: steps in ascending order, and the series ``far`` beyond them.

    ``places`` (3, steps) holds origin, middle and half length of each step; ``tables`` holds energy, force and stiffness,
    (n, steps) each. The curve begins at f* = 1e-6, or where steps no longer settle in double precision if that is higher
    (but below the limit of validity).
    """

    shape: Shape
    xi: float
    far: Series
    places: Array
    tables: tuple[Array, Array, Array]

    @classmethod
    def of(cls, shape: Shape, xi: float, far: Series, places: Array, stiffness: Array, force: float) -> EffectiveCurve:
        """Make a curve from the (s + 1, steps) table of k and the force at the lower end of the first step."""
        rise = 2.0 * places[2] * places[1:]  # dy/dt, as a series
        forces = _integrate_over_steps(stiffness, rise, force)
        tables = _integrate_over_steps(forces, rise, 0.0), forces, stiffness
        # the curve and the series differ here by rounding alone; scaling the curve removes the jump
        scale = far.value(far.start, FORCE) / float(np.sum(forces[:, -1]))
        energy, force_table, stiffness = (read_only(scale * table) for table in tables)
        return cls(shape, xi, far, read_only(places), (energy, force_table, stiffness))

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
        """Whether the stiffness is zero at the start of the curve, although contacts still carry force there.

        Where contacts of rare kinds open, the force that equation (36) gives at k = 0 may fall as the overlap grows; below
        that point there is no solution with k > 0.
        """
        depth = float(self.places[0, 0] + (self.places[1, 0] - self.places[2, 0]) ** 2) - float(self.shape.openings[0])
        return bool(self.ends(STIFFNESS)[0, 0] * depth < VANISHED * self.ends(FORCE)[0, 0])

    @cached_property
    def energy_offset(self) -> float:
        """Reduced energy of the curve minus that of the series, at the overlap where they meet."""
        return float(self.ends(ENERGY)[1, -1]) - self.far.value(self.far.start, ENERGY)

    def ends(self, order: int) -> Array:
        """Return (2, steps) energy, force or stiffness at the lower and the upper end of each step."""
        table = self.tables[order]
        return np.stack([np.sum(table[::2], axis=0) - np.sum(table[1::2], axis=0), np.sum(table, axis=0)])

    def value(self, y: Array, order: int) -> Array:
        """Return a derivative of the energy, counted from the start of the curve, at y between there and ``far.start``."""

        def of(index: Index, part: Array) -> Array:
            return self._evaluate(index, np.sqrt(part - self.places[0, index]), order)

        # a kink belongs to the step below it, where the slope is finite
        return self._evaluate_by_step(np.searchsorted(self._edges[0], y), y, of)

    def overlap(self, force: Array) -> Array:
        """Return y at forces between those at the ends of the curve, by Newton's method."""

        def of(index: Index, part: Array) -> Array:
            origin, middle, half = self.places[:, index]
            start = middle + half * (2.0 * self._find_smooth_variable(index, part) - 1.0)
            return np.asarray(origin + self._descend(index, start, part) ** 2)

        return self._evaluate_by_step(np.searchsorted(self._edges[1], force), force, of)

    @cached_property
    def _edges(self) -> tuple[Array, Array]:
        """Reduced overlap y and force f* where steps meet."""
        origin, middle, half = self.places
        return (origin + (middle - half) ** 2)[1:], self.ends(FORCE)[1, :-1]

    @cached_property
    def _touching(self) -> NDArray[np.bool_]:
        """(steps,) whether the step begins where contacts open."""
        return np.asarray(self.places[1] == self.places[2])

    @cached_property
    def _slopes(self) -> tuple[Array, Array]:
        """Two tables of the slope of k: a series, and a series that must be divided by dy/dt.

        dy/dt is zero where contacts open. There, for listed diameters, k rises as the square root of the distance in y, and
        its slope is unbounded. For a density, k rises as the fifth power of that root, and the series can be divided without
        a remainder other than rounding.
        """
        numerator = np.asarray(chebyshev.chebder(self.tables[STIFFNESS]), float)
        quotient = np.zeros((max(1, len(numerator) - 1), numerator.shape[1]))
        if not isinstance(self.shape, PointShape):
            for i in np.flatnonzero(self._touching):
                series = chebyshev.chebdiv(numerator[:, i], 2.0 * self.places[2, i] * self.places[1:, i])[0]
                quotient[: series.size, i] = series
                numerator[:, i] = 0.0
        return quotient, numerator

    def _evaluate(self, index: Index, root: Array, order: int) -> Array:
        """Return a derivative of the energy at u = ``root`` on the steps ``index``."""
        _, middle, half = self.places[:, index]
        t = (root - middle) / half
        if order < SLOPE:
            return np.asarray(chebyshev.chebval(t, self.tables[order][:, index], tensor=False))
        whole, divided = (chebyshev.chebval(t, table[:, index], tensor=False) for table in self._slopes)
        rise = 2.0 * half * root
        return np.asarray(whole + np.divide(divided, rise, out=np.zeros_like(rise), where=divided != 0.0))

    @cached_property
    def _forces(self) -> tuple[Array, Array]:
        """Force at the lower end of each step, and its rise over the step, which is at least the rounding of the force."""
        low, high = self.ends(FORCE)
        return low, np.maximum(high - low, 4.0 * np.finfo(float).eps * low)

    def _find_smooth_variable(self, index: Index, force: Array) -> Array:
        """Return a variable from 0 to 1 in which u is smooth.

        Where contacts open, f rises as u^2; elsewhere it may span decades.
        """
        low, span = (values[index] for values in self._forces)
        part = np.clip(force - low, 0.0, span)
        return np.where(self._touching[index], np.sqrt(part / span), np.log1p(part / low) / np.log1p(span / low))

    def _descend(self, index: Index, root: Array, force: Array) -> Array:
        """Return u at these forces, by Newton's method from ``root``."""
        _, middle, half = self.places[:, index]
        low, high = middle - half, middle + half
        for _ in range(30):
            miss = force - self._evaluate(index, root, FORCE)
            slope = 2.0 * root * self._evaluate(index, root, STIFFNESS)
            change = np.divide(miss, slope, out=np.zeros_like(root), where=slope > 0.0)
            root = np.clip(root + change, low, high)
            # either convergence, which is quadratic, needs no further iteration, or only rounding is left
            if np.all((np.abs(change) <= 1e-9 * high) | (np.abs(miss) <= 4.0 * np.finfo(float).eps * force)):
                break
        return root

    def _evaluate_by_step(self, index: NDArray[np.intp], values: Array, of: Callable[[Index, Array], Array]) -> Array:
        flat, numbers = values.ravel(), index.ravel()
        out = np.empty(flat.size)
        if flat.size < _MANY_VALUES * self.places.shape[1]:
            for begin in range(0, flat.size, _VALUES_AT_ONCE):
                part = slice(begin, begin + _VALUES_AT_ONCE)
                out[part] = of(numbers[part], flat[part])
            return out.reshape(values.shape)
        # sort by step, so that each step is evaluated once; small integers sort in linear time
        order = np.argsort(numbers.astype(np.min_scalar_type(self.places.shape[1])), kind="stable")
        ascending, numbers = flat[order], numbers[order]
        first = np.flatnonzero(np.append(True, numbers[1:] != numbers[:-1])) if numbers.size else np.empty(0, int)
        for begin, end in pairwise([*first.tolist(), order.size]):
            out[order[begin:end]] = of(int(numbers[begin]), ascending[begin:end])
        return out.reshape(values.shape)


def _integrate_over_steps(table: Array, rise: Array, start: float) -> Array:
    """Return the table (n + 2, steps) of the integral over y, equal to ``start`` where the first step begins.

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
