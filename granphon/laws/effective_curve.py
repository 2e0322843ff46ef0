"""The effective medium's law as a curve: polynomials on steps, and the series beyond them.

On a step y = origin + u^2, and k is a polynomial in u. Force and energy are its integrals, and k their exact derivative; the
slope of k is its own. Steps may be tens or, for long lists of diameters, tens of thousands, so that a curve is arrays over
steps: an element of a (n, steps) table is the coefficient of a Chebyshev polynomial of t = (u - middle)/half, -1 <= t <= 1.
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

__all__ = ["LEAST_SOLVED_FORCE", "VALID_FORCE", "VANISHED", "EffectiveCurve"]

Array = NDArray[np.float64]
#: a step, or that of each of the values
Index = int | NDArray[np.intp]
#: f* to which the curve is solved, far below the paper's limit of validity
LEAST_SOLVED_FORCE = 1e-6
#: the limit of validity that Section IV states
VALID_FORCE = 0.08
#: stiffness of a contact that is none, relative to the mean one since the first contact: a law that stiffens has one or more
VANISHED = 1e-7
#: coefficients of the overlap as a function of the force
_INVERSE_TERMS = 16
#: values that are worked on at once, where each brings the coefficients of its own step
_VALUES_AT_ONCE = 2**13
#: values for each step, from which on they are sorted by step
_MANY_VALUES = 64


@dataclass(frozen=True, eq=False)
class EffectiveCurve:
    """The solution for one shape and Xi: steps, ascending, and the series beyond them.

    ``places`` (3, steps): origin, middle and half of each. ``tables``: energy, force and stiffness, (n, steps) each. The
    curve begins at f* = 1e-6, or higher, below the limit of validity, where steps no longer settle in double precision.
    """

    shape: Shape
    xi: float
    far: Series
    places: Array
    tables: tuple[Array, Array, Array]

    @classmethod
    def of(cls, shape: Shape, xi: float, far: Series, places: Array, stiffness: Array, force: float) -> EffectiveCurve:
        """From the (s + 1, steps) table of k, and the force at the lower end of the first step."""
        rise = 2.0 * places[2] * places[1:]  # dy/dt, as a series
        forces = _integrate_over_steps(stiffness, rise, force)
        tables = _integrate_over_steps(forces, rise, 0.0), forces, stiffness
        # rounding alone separates the two here; without it there is no seam
        scale = far.value(far.start, FORCE) / float(np.sum(forces[:, -1]))
        energy, force_table, stiffness = (read_only(scale * table) for table in tables)
        return cls(shape, xi, far, read_only(places), (energy, force_table, stiffness))

    @cached_property
    def least_force(self) -> float:
        """f* at the start of the curve."""
        return max(LEAST_SOLVED_FORCE, float(self.ends(FORCE)[0, 0]))

    @cached_property
    def start(self) -> float:
        """y at the start of the curve."""
        return float(self.overlap(np.array([self.least_force]))[0])

    @cached_property
    def vanishes(self) -> bool:
        """Whether the stiffness has fallen to zero at the start of the curve, while contacts still carry force.

        Where contacts of rare kinds open, more overlap may be less force at k = 0; below there is no solution with k > 0.
        """
        depth = float(self.places[0, 0] + (self.places[1, 0] - self.places[2, 0]) ** 2) - float(self.shape.openings[0])
        return bool(self.ends(STIFFNESS)[0, 0] * depth < VANISHED * self.ends(FORCE)[0, 0])

    @cached_property
    def energy_offset(self) -> float:
        """Energy of the curve over that of the series, where they meet."""
        return float(self.ends(ENERGY)[1, -1]) - self.far.value(self.far.start, ENERGY)

    def ends(self, order: int) -> Array:
        """(2, steps): energy, force or stiffness at the lower and the upper end of each step."""
        table = self.tables[order]
        return np.stack([np.sum(table[::2], axis=0) - np.sum(table[1::2], axis=0), np.sum(table, axis=0)])

    def value(self, y: Array, order: int) -> Array:
        """A derivative of the energy, counted from the start of the curve, at y between that and ``far.start``."""

        def of(index: Index, part: Array) -> Array:
            return self._at(index, np.sqrt(part - self.places[0, index]), order)

        # a kink belongs to the step below it, where the slope is finite
        return self._by_step(np.searchsorted(self._edges[0], y), y, of)

    def overlap(self, force: Array) -> Array:
        """y at forces between those at the two ends: a series for u, mended by Newton's method."""

        def of(index: Index, part: Array) -> Array:
            origin, middle, half = self.places[:, index]
            t = chebyshev.chebval(2.0 * self._smooth(index, part) - 1.0, self._inverse[:, index], tensor=False)
            return np.asarray(origin + self._descended(index, middle + half * t, part) ** 2)

        return self._by_step(np.searchsorted(self._edges[1], force), force, of)

    @cached_property
    def _edges(self) -> tuple[Array, Array]:
        """y and f* where steps meet."""
        origin, middle, half = self.places
        return (origin + (middle - half) ** 2)[1:], self.ends(FORCE)[1, :-1]

    @cached_property
    def _touching(self) -> NDArray[np.bool_]:
        """Which steps begin where contacts open."""
        return np.asarray(self.places[1] == self.places[2])

    @cached_property
    def _slopes(self) -> tuple[Array, Array]:
        """Tables of the slope of k: a series, and one to be divided by dy/dt, which vanishes where contacts open.

        There k of listed diameters rises as a square root, and its slope has no bound. That of a density rises as the fifth
        power of one, and the division leaves no remainder but rounding.
        """
        numerator = np.asarray(chebyshev.chebder(self.tables[STIFFNESS]), float)
        quotient = np.zeros((max(1, len(numerator) - 1), numerator.shape[1]))
        if not isinstance(self.shape, PointShape):
            for i in np.flatnonzero(self._touching):
                series = chebyshev.chebdiv(numerator[:, i], 2.0 * self.places[2, i] * self.places[1:, i])[0]
                quotient[: series.size, i] = series
                numerator[:, i] = 0.0
        return quotient, numerator

    def _at(self, index: Index, root: Array, order: int) -> Array:
        """A derivative of the energy at u = ``root`` on these steps."""
        _, middle, half = self.places[:, index]
        t = (root - middle) / half
        if order < SLOPE:
            return np.asarray(chebyshev.chebval(t, self.tables[order][:, index], tensor=False))
        whole, divided = (chebyshev.chebval(t, table[:, index], tensor=False) for table in self._slopes)
        rise = 2.0 * half * root
        return np.asarray(whole + np.divide(divided, rise, out=np.zeros_like(rise), where=divided != 0.0))

    @cached_property
    def _inverse(self) -> Array:
        """(n, steps): t as a series in 2 w - 1, w the variable of :meth:`_smooth`."""
        nodes, steps = chebyshev.chebpts1(_INVERSE_TERMS), self.places.shape[1]
        w = np.broadcast_to(0.5 + 0.5 * nodes[:, None], (_INVERSE_TERMS, steps))
        low, span = self._forces
        force = low + np.where(self._touching, span * w * w, low * np.expm1(w * np.log1p(span / low)))

        def of(index: Index, part: Array) -> Array:
            _, middle, half = self.places[:, index]
            start = middle + half * (2.0 * self._smooth(index, part) - 1.0)
            return np.asarray((self._descended(index, start, part) - middle) / half)

        t = self._by_step(np.broadcast_to(np.arange(steps), w.shape), force, of)
        return np.asarray(np.linalg.solve(chebyshev.chebvander(nodes, _INVERSE_TERMS - 1), t), float)

    @cached_property
    def _forces(self) -> tuple[Array, Array]:
        """The force at the lower ends, and what it rises by; on the shortest steps, by no less than rounding."""
        low, high = self.ends(FORCE)
        return low, np.maximum(high - low, 4.0 * np.finfo(float).eps * low)

    def _smooth(self, index: Index, force: Array) -> Array:
        """A variable from 0 to 1 in which u is smooth: where contacts open f rises as u^2, elsewhere it may span decades."""
        low, span = (values[index] for values in self._forces)
        part = np.clip(force - low, 0.0, span)
        return np.where(self._touching[index], np.sqrt(part / span), np.log1p(part / low) / np.log1p(span / low))

    def _descended(self, index: Index, root: Array, force: Array) -> Array:
        """u at these forces, by Newton's method from ``root``."""
        _, middle, half = self.places[:, index]
        low, high = middle - half, middle + half
        for _ in range(30):
            miss = force - self._at(index, root, FORCE)
            slope = 2.0 * root * self._at(index, root, STIFFNESS)
            change = np.divide(miss, slope, out=np.zeros_like(root), where=slope > 0.0)
            root = np.clip(root + change, low, high)
            # convergence is quadratic: this was the last one needed; or nothing but rounding is left
            if np.all((np.abs(change) <= 1e-9 * high) | (np.abs(miss) <= 4.0 * np.finfo(float).eps * force)):
                break
        return root

    def _by_step(self, index: NDArray[np.intp], values: Array, of: Callable[[Index, Array], Array]) -> Array:
        flat, numbers = values.ravel(), index.ravel()
        out = np.empty(flat.size)
        if flat.size < _MANY_VALUES * self.places.shape[1]:
            for begin in range(0, flat.size, _VALUES_AT_ONCE):
                part = slice(begin, begin + _VALUES_AT_ONCE)
                out[part] = of(numbers[part], flat[part])
            return out.reshape(values.shape)
        # sorted by step, so that each works on one piece; small integers sort in linear time
        order = np.argsort(numbers.astype(np.min_scalar_type(self.places.shape[1])), kind="stable")
        ascending, numbers = flat[order], numbers[order]
        first = np.flatnonzero(np.append(True, numbers[1:] != numbers[:-1])) if numbers.size else np.empty(0, int)
        for begin, end in pairwise([*first.tolist(), order.size]):
            out[order[begin:end]] = of(int(numbers[begin]), ascending[begin:end])
        return out.reshape(values.shape)


def _integrate_over_steps(table: Array, rise: Array, start: float) -> Array:
    """Table of the integral over y, (n + 2, steps), from ``start`` at the lower end of the first step; ``rise`` is dy/dt."""
    product = np.zeros((len(table) + 1, table.shape[1]))
    product[:-1] += rise[0] * table
    product[1:] += 0.5 * rise[1] * table
    product[1] += 0.5 * rise[1] * table[0]
    product[:-2] += 0.5 * rise[1] * table[1:]
    integral = np.asarray(chebyshev.chebint(product, lbnd=-1.0), float)
    integral[0] += start + np.append(0.0, np.cumsum(np.sum(integral, axis=0))[:-1])
    return integral
