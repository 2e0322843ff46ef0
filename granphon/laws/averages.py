"""The averages of Hertz's law in equation (36), at the points of steps: quadratures of densities, sums of listed diameters.

With n diameters the curve has n(n + 1)/2 openings, and each of the steps between them needs n sums of n powers. The forces
of contacts whose opening lies far below a block of steps are smooth functions of y there: their sum is one polynomial for
each ball. The other, near contacts are summed one by one, each for its two balls. So the work grows as n^3, times the small
number of near contacts of a ball.

Overlaps are counted from the opening o below the step: an overlap is o - o_ij + u^2, with exact differences, so that it has
all its digits however small it is compared with the diameters. Forces are counted from those at the upper end of a step, as
sums of their changes. Differentiation then cancels nothing, neither on short steps, where the changes are small, nor for
balls of a rare kind, whose share in the mean is small.

Products are formed by einsum: they are too small for the threads of a linear algebra library. Where processors are shared,
these threads wait for each other ten times as long as the product takes.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import Any, NamedTuple

import numpy as np
from numpy.polynomial import chebyshev
from numpy.typing import NDArray

from granphon.balls.distributions import PointShape, Shape

Array = NDArray[np.float64]
#: upper bound on the rounding error of k that is allowed for, relative to k
_WORST_NOISE = 1e-8
#: a contact is far if its overlap is at least this many times half the range of the block
_FAR_OVERLAP = 6.0
#: degree of the polynomials for far contacts; their errors are then 1e-15
_DEGREE = 14
#: number of steps that a block may always have: a third of the number of diameters balances the work on near and far
#: contacts, and more steps cost little
_LEAST_STEPS = 32
#: largest number of elements in an array of near contacts
_MOST_NEAR = 2**21


class Block(NamedTuple):
    """B adjoining steps in descending order, with s + 1 points on each: y = ``origin`` (B, 1) + ``root``^2 (B, s + 1).

    ``middle`` and ``half`` (B, 1) are the middle and the half length of each step in the root. ``drop`` (B, s + 1) is the
    root minus its value at the upper end of the step, without loss of digits.
    """

    origin: Array
    middle: Array
    half: Array
    root: Array
    drop: Array

    @classmethod
    def of(cls, steps: list[tuple[float, float, float]], points: Array) -> Block:
        """Make a block from (origin, lower root, upper root) of each step, and ``points`` (s + 1,) from -1 to 1."""
        origin, low, high = np.array(steps).T[:, :, None]
        middle, half = 0.5 * (low + high), 0.5 * (high - low)
        # the ends are taken as given, because middle - half may round: at an opening the root must be exactly zero
        root = np.concatenate([low, (middle + half * points)[:, 1:-1], high], axis=1)
        return cls(origin, middle, half, root, half * (points - 1.0))

    @property
    def y(self) -> Array:
        """(B, s + 1) reduced overlap at the points."""
        return self.origin + self.root**2


# -- densities --------------------------------------------------------------------------------------------------------


class DensityBalls:
    """Averages over the balls of a shape, by quadrature of the ``order`` at the points of a block.

    ``mean`` (B, s + 1) is the mean stiffness <K^Q>. Forces are counted from the mean force ``common``, whose derivative is
    ``known`` (B, s + 1). ``noise`` (B,) is the rounding error to expect in the last coefficients of k, relative to k.
    """

    def __init__(self, shape: Shape, xi: float, order: int, block: Block) -> None:
        y = block.y
        nodes = shape.nodes(y, order)
        self.xi, self.weights = xi, nodes.weights
        force, self.stiffness = (of(y[..., None], nodes.positions) for of in (shape.force, shape.stiffness))
        self.common, self.known = shape.force(y), shape.stiffness(y)
        self.force = force - self.common[..., None]
        self.mean = np.sum(nodes.weights * self.stiffness, axis=-1)
        # on a short step differentiation amplifies the rounding of y and of the forces, which are counted from their mean
        amplified = block.root.shape[1] ** 2 * (self.common / self.known + np.abs(y))[:, -1:]
        amplified /= 4.0 * block.middle * block.half
        self.noise = np.minimum(16.0 * np.finfo(float).eps * amplified[:, 0], _WORST_NOISE)

    def balance(self, k: Array) -> tuple[Array, Array, Array]:
        """Return G(y, k) less the force ``common``, and dG/dk, (B, s + 1); and G at the lower ends (B,)."""
        part = 1.0 / (self.stiffness + self.xi * k[..., None])
        share = self.weights * part
        total = np.sum(share, axis=-1)
        force = np.sum(share * self.force, axis=-1) / total
        by_k = -self.xi * np.sum(share * part * (self.force - force[..., None]), axis=-1) / total
        return force, by_k, (self.common + force)[:, 0]


# -- listed diameters -------------------------------------------------------------------------------------------------


class PointAverages:
    """Averages over the balls of a shape of listed diameters by sums, for the local-field factor ``xi``."""

    def __init__(self, shape: PointShape, xi: float) -> None:
        from scipy.sparse import csc_array

        self.xi, x, self._weights = xi, np.array(shape.positions), np.array(shape.weights)
        #: (n, n) openings of all pairs, in units of W
        self._matrix = -0.5 * (x[:, None] + x)
        # (m,) openings of pairs, ascending; and sparse (n, m) weights of each pair in the sums of its two balls
        w = self._weights
        i, j = np.triu_indices(w.size)
        order = np.argsort(self._matrix[i, j], kind="stable")
        i, j = i[order], j[order]
        pair, other = np.arange(i.size), np.flatnonzero(i != j)
        rows, columns = np.concatenate([i, j[other]]), np.concatenate([pair, other])
        self._openings = self._matrix[i, j]
        self._entries: Any = csc_array((np.concatenate([w[j], w[i[other]]]), (rows, columns)), shape=(w.size, i.size))

    def _find_range(self, block: Block) -> tuple[float, float, float, slice]:
        """Return the middle and the half extent in y of a block, above its least origin, and which contacts are near.

        Contacts with openings up to the third number are far; the slice is that of the openings of near contacts.
        """
        least = block.origin[-1, 0]
        low, high = block.root[-1, 0] ** 2, block.origin[0, 0] - least + block.root[0, -1] ** 2
        middle, half = 0.5 * (low + high), 0.5 * (high - low)
        last = least - max(0.0, _FAR_OVERLAP * half - middle)
        begin, end = np.searchsorted(self._openings, [last, block.origin[0, 0]], side="right").tolist()
        return middle, half, last, slice(begin, end)

    def count(self, block: Block) -> int:
        """Return how many steps of the block should be solved at once, so that arrays of near contacts fit in memory."""
        steps = min(len(block.root), max(_LEAST_STEPS, len(self._weights) // 3))
        *_, near = self._find_range(block)
        return steps // 2 if steps > 1 and (near.stop - near.start) * steps * block.root.shape[1] > _MOST_NEAR else steps

    def balls(self, block: Block) -> PointBalls:
        """Return the averages at the points of the block: the sums over near contacts plus those over far ones.

        Four quantities are summed for each ball: the stiffness, its change and the change of the force since the upper end
        of the step, (n, B, s + 1); and the force at the upper end, (n, B).
        """
        w = self._weights
        middle, half, last, near = self._find_range(block)
        openings, entries = self._openings[near], self._entries[..., near]
        closed = openings[:, None] <= block.origin[:, 0]
        rise = np.where(closed, block.origin[:, 0] - openings[:, None], 0.0)
        root = np.sqrt(rise[..., None] + block.root**2) * closed[..., None]
        top = root[..., -1:]
        change = block.drop * (block.root + block.root[:, -1:]) / np.where(closed[..., None], root + top, np.inf)

        def summed(values: Array) -> Array:
            shape = values.shape[1:]
            return np.asarray(entries @ values.reshape(len(values), int(np.prod(shape)))).reshape(-1, *shape)

        forces = change * (root * (root + top) + top * top)
        near_sums = [1.5 * summed(root), 1.5 * summed(change), summed(forces), summed(top[..., 0] ** 3)]
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
        # T_m at the points, and its difference from T_m at the upper end of the step, both by recurrence: no digits are lost
        t = (block.origin - least + block.root**2 - middle) / half
        drop = block.drop * (block.root + block.root[:, -1:]) / half
        values, changes = [np.ones_like(t), t], [np.zeros_like(t), drop]
        for _ in range(len(force) - 2):
            values.append(2.0 * t * values[-1] - values[-2])
            changes.append(2.0 * (drop * values[-2] + t[:, -1:] * changes[-1]) - changes[-2])
        basis, change = np.stack(values), np.stack(changes)

        far_sums = [
            np.einsum("mn,m...->n...", table, terms[: len(table)])
            for table, terms in ((stiffness, basis), (stiffness, change), (force, change), (force, basis[..., -1]))
        ]
        return PointBalls(w, self.xi, *(one + other for one, other in zip(near_sums, far_sums, strict=True)))


def _integrate_series(table: Array, scale: float, middle: Array) -> Array:
    """Return the Chebyshev series of the integral that equals ``middle`` at 0."""
    out = np.asarray(chebyshev.chebint(table, scl=scale), float)
    out[0] += middle - chebyshev.chebval(0.0, out)
    return out


@dataclass(frozen=True, eq=False)
class PointBalls:
    """Averages by sums, as :class:`DensityBalls`: ``stiffness`` (n, B, s + 1) is K^Q at the points.

    ``change`` and ``work`` (n, B, s + 1) are the changes of K^Q and F^Q since the upper end of the step, where F^Q is
    ``top`` (n, B).
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
        """Return what :meth:`DensityBalls.balance` returns, as the whole of G; forces are counted from the upper end."""
        part = 1.0 / (self.stiffness + self.xi * k)
        last = part[..., -1]
        start = self._average(last * self.top) / self._average(last)
        excess = self.top - start
        # <(F^Q - f) part> is zero at the upper end: elsewhere it is the sum of the changes of F^Q and of part
        moved = self.work - (self.change + self.xi * (k - k[:, -1:])) * (excess * last)[..., None]
        total = self._average(part)
        force = self._average(part * moved) / total
        by_k = -self.xi * self._average(part * part * (self.work + excess[..., None] - force)) / total
        return force, by_k, start + force[:, 0]

    def _average(self, values: Array) -> Array:
        return np.asarray(np.einsum("n,n...->...", self.weights, values))
