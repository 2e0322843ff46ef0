"""How the diameters of the balls differ: distributions, averages of the contact force over them,
and samples.

Section III.A of Velicky and Caroli, Phys. Rev. E 65, 021307 (2002). Deviations Delta are from the
mean diameter; the width is W = sqrt(12) Delta_rms, the full width of the uniform distribution (the
paper, below equation 19, has the root on the wrong side). A :class:`Spread` is a distribution in
metres; its :class:`Shape` is the distribution of x = Delta/W.

All averages are functions of the shape and of y = (d - a)/W, the overlap of balls of the mean
diameter. What is averaged is (y + (x + x')/2)_+^p, a power of the overlap of two balls, in W: p =
3/2 gives the force in units of (2/3) E* d^(1/2) W^(3/2), 1/2 and -1/2 give its derivatives by y, 0
counts contacts.

Integrals are taken over the square root of the overlap: in it the powers are polynomials, smooth
where a contact opens, and all terms of the sums are positive. For the uniform distribution, Gauss
rules of 3 or 4 nodes replace the printed closed forms, and keep the digits that those lose at some
y.
"""

from __future__ import annotations

import math
from abc import ABC, abstractmethod
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property, lru_cache
from itertools import pairwise
from pathlib import Path
from typing import Any, NamedTuple, Self

import numpy as np
from numpy.typing import ArrayLike, NDArray

from granphon.balls.hertz import EXPONENT
from granphon.base.arrays import Array, Index
from granphon.base.errors import InputError, brief
from granphon.base.memory import require_memory
from granphon.base.quantities import LENGTH
from granphon.base.tables import Table
from granphon.base.text import counted
from granphon.base.validation import finite_list, not_negative, positive, whole_number

#: an analytic piece of a distribution of t: its start and its end, and the density as a function of
#: the arrays t, rise = t - start and fall = end - t, whose digits are kept at the two ends
Piece = tuple[float, float, Callable[[Array, Array, Array], Array]]
#: x of listed diameters is rounded to a multiple of this, so that diameters of the same shape and
#: another W compare equal
GRAIN = 2.0**-40
#: most points of a shape; more different diameters are condensed to this many or fewer
MOST_POINTS = 192
#: the part of the fraction of the balls in the coordinate along which cells of condensed diameters
#: are evenly spaced; the rest is that of the fraction of the range
_SHARE_OF_BALLS = 0.3
#: most numbers in an array while averages are computed; larger arrays are worked through in blocks
_NUMBERS_AT_ONCE = 2**20
#: powers of the overlap that are averaged
_POWERS = tuple((0.5 * np.arange(-1, 7)).tolist())
#: number of Gauss nodes on a piece of a normal density, at most 3 standard deviations long
_PIECE_NODES = 24


# -- distributions of deviations over the width ----------------------------------------------------


class Nodes(NamedTuple):
    """A quadrature over the central ball: positions x_Q, and weights of the same shape, which sum
    to one but for the error of the quadrature.
    """

    positions: Array
    weights: Array


@dataclass(frozen=True)
class Shape(ABC):
    """The distribution of x = Delta/W, with mean 0 and rms 1/sqrt(12); compared and hashed by
    value.

    Methods take scalars or arrays that broadcast, and return floats for floats. Given the position
    ``x`` of the central ball, they average over the other ball (F^Q of equation 28); without it,
    over both (F_ave of equation 25).
    """

    @property
    @abstractmethod
    def bounds(self) -> tuple[float, float]:
        """Smallest and largest x; all contacts are open at y <= -largest, and all are closed at y >
        -smallest.
        """

    @property
    @abstractmethod
    def openings(self) -> Array:
        """(n,) values of y, ascending; between each and the next, averages over both balls are
        smooth functions of y.
        """

    @abstractmethod
    def quantile(self, probability: ArrayLike) -> Any:
        """Return the x below which the part ``probability``, from 0 to 1, of the balls lies."""

    @abstractmethod
    def nodes(self, y: ArrayLike, order: int = 32, whole: bool = False) -> Nodes:
        """Return a quadrature over the central ball for smooth functions of F^Q(y) and K^Q(y);
        arrays of shape (*y.shape, n).

        For densities n = 1 + 2 ``order``, or 3 ``order`` with ``whole`` (more beyond a cutoff of
        3). The range of x_Q is split into three at y + x_Q/2 = -+max(x)/2. The part below the first
        of these, where F^Q = 0, gets one node; each of the other two gets ``order`` Gauss nodes in
        the square root of the distance to the singularity at or below its lower end. Convergence is
        exponential. With ``whole`` the part where F^Q = 0 gets ``order`` nodes as well, for
        functions of x_Q itself.

        For listed diameters every point is a node, and the result is exact; ``order`` and ``whole``
        change nothing.
        """

    @abstractmethod
    def _average(self, overlap: Array, power: float, pairs: bool) -> Array:
        """Return the average over both balls, <(y + (x + x')/2)_+^p>, where ``overlap`` is y and
        ``power`` p.

        Without ``pairs`` the average is over the other ball alone, <(s + x'/2)_+^p>, where
        ``overlap`` is s = y + x/2. The result has the shape of ``overlap``.
        """

    def average(self, y: ArrayLike, power: float, x: ArrayLike | None = None) -> Any:
        """Return the average <(y + (x + x')/2)_+^p> of a ``power`` p of the overlap, with 0^p = 0.

        If the deviation ``x`` of the central ball is given, the average is over the deviation x' of
        the other ball; if not, it is over both. ``y`` and ``x``, over W, are finite and broadcast.
        Where one of them is nan, so is the average.

        Raises :class:`InputError` unless p is one of -1/2, 0, 1/2 ... 3, and ValueError for shapes
        of ``y`` and ``x`` that do not broadcast.
        """
        if power not in _POWERS:
            raise InputError(f"power is {power!r}", mend="Give a multiple of 1/2 from -1/2 to 3")
        overlap = np.asarray(y, float)
        if x is None:
            return self._average(overlap, power, pairs=True)[()]
        return self._average(overlap + 0.5 * np.asarray(x, float), power, pairs=False)[()]

    def force(self, y: ArrayLike, x: ArrayLike | None = None) -> Any:
        """Return the average force F_ave (equation 25) or, with ``x``, F^Q (equation 28), in units
        of (2/3) E* d^(1/2) W^(3/2); ``y`` and ``x`` are as in :meth:`average`.
        """
        return self.average(y, EXPONENT, x)

    def stiffness(self, y: ArrayLike, x: ArrayLike | None = None) -> Any:
        """Return the average stiffness dF_ave/dy or, with ``x``, K^Q = dF^Q/dy (equation 30); ``y``
        and ``x`` are as in :meth:`average`.
        """
        return EXPONENT * self.average(y, EXPONENT - 1.0, x)

    def stiffness_slope(self, y: ArrayLike, x: ArrayLike | None = None) -> Any:
        """Return the second derivative d^2F/dy^2 of F_ave or, with ``x``, of F^Q; for listed
        diameters the derivative is unbounded just above an opening. ``y`` and ``x`` are as in
        :meth:`average`.
        """
        return EXPONENT * (EXPONENT - 1.0) * self.average(y, EXPONENT - 2.0, x)


class _Density(Shape):
    """A density on [-b, b]: symmetric, analytic inside, cut at the ends."""

    #: b
    _edge: float
    #: factor from the order to the number of Gauss nodes
    _nodes_per_order: int = 1

    @abstractmethod
    def _compute_density(self, x: Array) -> Array:
        """Return the density of balls, their fraction per unit of x, at each ``x``."""

    @abstractmethod
    def _compute_fraction_below(self, x: Array) -> Array:
        """Return the fraction of the balls below each ``x``."""

    @abstractmethod
    def _divide(self, power: float, pairs: bool) -> tuple[list[Piece], int]:
        """Return the pieces of the distribution of (x + x')/2, or without ``pairs`` of x'/2, and
        the number of Gauss nodes on each, for an average of a ``power`` p.
        """

    def _average(self, overlap: Array, power: float, pairs: bool) -> Array:
        """Return the averages of :meth:`Shape._average`: the integral of density(t) (y + t)_+^p
        over the pieces, where ``overlap`` is y, by Gauss nodes in u = (y + t)^(1/2).
        """
        pieces, order = self._divide(power, pairs)

        def evaluate(flat: Array) -> Array:
            """Return the integrals (n,) at y (n,); arrays within are (n, 1) or (n, nodes)."""
            y = flat[:, None]
            total = np.zeros(len(y))
            for start, end, density in pieces:
                # the part of the piece in which y + t is above zero, and y + t where that begins
                closed_start = np.maximum(start, -y)
                is_cut = closed_start > start
                length = np.maximum(np.where(is_cut, end + y, end - start), 0.0)
                least_overlap = np.maximum(start + y, 0.0)
                root, rise, fall, weight = _make_root_nodes(least_overlap, length, order)
                t = closed_start + rise
                density_at_nodes = density(t, (closed_start - start) + rise, fall)
                # (y + t)^p dt = 2 u^(2 p + 1) du
                powers = _raise_to_power(root, round(2.0 * power + 1.0))
                total += np.sum(2.0 * powers * density_at_nodes * weight, axis=-1)
            return total

        return evaluate_in_blocks(evaluate, overlap, _NUMBERS_AT_ONCE // order)

    @property
    def bounds(self) -> tuple[float, float]:
        """Smallest and largest x: -b, b."""
        return -self._edge, self._edge

    @property
    def openings(self) -> Array:
        """(3,) values of y, -b, 0, b: at each an average over both balls has a term that begins
        there, as a power of the distance.
        """
        return np.array([-self._edge, 0.0, self._edge])

    def nodes(self, y: ArrayLike, order: int = 32, whole: bool = False) -> Nodes:
        """Return the nodes of :meth:`Shape.nodes`, of three parts of the range of x."""
        overlap = np.asarray(y, float)[..., np.newaxis]
        edge = self._edge
        node_count = order * self._nodes_per_order
        # the x from which on a ball touches some others, and that from which on it touches all
        first_x_touching = np.clip(-2.0 * overlap - edge, -edge, edge)
        first_x_touching_all = np.clip(edge - 2.0 * overlap, -edge, edge)
        # each of the two upper parts begins at an s = y + x/2 that is as far above the singularity
        # as the first number, and is as long in s as the second
        some_start = np.maximum(overlap, 0.0)
        some_length = np.maximum(edge - np.abs(overlap), 0.0)
        all_start = np.maximum(overlap - edge, 0.0)
        all_length = np.clip(overlap, 0.0, edge)
        parts = [
            self._make_nodes_below(first_x_touching, node_count if whole else 1),
            self._make_nodes_above(first_x_touching, some_start, some_length, node_count),
            self._make_nodes_above(first_x_touching_all, all_start, all_length, node_count),
        ]
        positions, weights = zip(*parts, strict=True)
        return Nodes(np.concatenate(positions, axis=-1), np.concatenate(weights, axis=-1))

    def _make_nodes_below(self, end: Array, node_count: int) -> Nodes:
        """Return the nodes from x = -b to each ``end`` (..., 1), (..., ``node_count``): Gauss's or,
        if there is but one, the middle.
        """
        if node_count == 1:
            return Nodes(0.5 * (end - self._edge), self._compute_fraction_below(end))
        fractions, shares = _make_gauss_rule(node_count)
        positions = (end + self._edge) * fractions - self._edge
        return Nodes(positions, (end + self._edge) * shares * self._compute_density(positions))

    def _make_nodes_above(
        self, first_x: Array, start: Array, length: Array, node_count: int
    ) -> Nodes:
        """Return the Gauss nodes (..., ``node_count``) of the part of the range that begins at
        ``first_x`` (..., 1), in the square root of the distance of s = y + x/2 to the singularity.
        In s the part begins ``start`` above the singularity and is ``length`` long.
        """
        root, rise, _, weight = _make_root_nodes(start, length, node_count)
        positions = first_x + 2.0 * rise
        return Nodes(positions, 4.0 * root * weight * self._compute_density(positions))


@dataclass(frozen=True)
class UniformShape(_Density):
    """The uniform distribution, even on [-1/2, 1/2]. Averages are exact to rounding."""

    _edge = 0.5

    def _compute_density(self, x: Array) -> Array:
        """Return the density of balls, 1 at each ``x``."""
        return np.ones_like(x)

    def _compute_fraction_below(self, x: Array) -> Array:
        """Return the fraction of the balls below each ``x``."""
        return x + 0.5

    def quantile(self, probability: ArrayLike) -> Any:
        """Return the x below which the part u = ``probability`` of the balls lies: u - 1/2."""
        return (np.asarray(probability, float) - 0.5)[()]

    def _divide(self, power: float, pairs: bool) -> tuple[list[Piece], int]:
        """Return the pieces of the distribution of (x + x')/2, or without ``pairs`` of x'/2, and
        the number of Gauss nodes on each with which an average of a ``power`` p is exact.
        """
        if not pairs:
            # the average equals 2/(p+1) times the first difference of s_+^(p+1) over -+1/4; the
            # integrand is of degree 2p + 1 in the root
            constant: Piece = (-0.25, 0.25, lambda t, rise, fall: np.full_like(t, 2.0))
            return [constant], math.ceil(power) + 1
        # the average equals 4/((p+1)(p+2)) times the second difference of y_+^(p+2) over -+1/2; the
        # integrand is of degree 2p + 3 in the root
        rising_piece: Piece = (-0.5, 0.0, lambda t, rise, fall: 4.0 * rise)
        falling_piece: Piece = (0.0, 0.5, lambda t, rise, fall: 4.0 * fall)
        return [rising_piece, falling_piece], math.ceil(power) + 2


@dataclass(frozen=True)
class NormalShape(_Density):
    """A normal density, cut at ``cutoff`` times the standard deviation that it has before the
    cut.
    """

    cutoff: float

    @cached_property
    def _std(self) -> float:
        """Standard deviation of x before the cut."""
        return 1.0 / (math.sqrt(12.0) * cut_rms(self.cutoff))

    @cached_property
    def _edge(self) -> float:  # type: ignore[override]
        """Largest x, at which the distribution is cut."""
        return self.cutoff * self._std

    @cached_property
    def _nodes_per_order(self) -> int:  # type: ignore[override]
        """Factor from the order to the number of Gauss nodes: one per 3 standard deviations."""
        return math.ceil(self.cutoff / 3.0)

    @cached_property
    def _fraction_within(self) -> float:
        """Fraction of a normal distribution that lies within the cut."""
        return math.erf(self.cutoff / math.sqrt(2.0))

    def _compute_density(self, x: Array) -> Array:
        """Return the density of balls at each ``x`` within the cut."""
        norm = self._std * math.sqrt(2.0 * math.pi) * self._fraction_within
        return np.asarray(np.exp(-0.5 * (x / self._std) ** 2) / norm)

    def _compute_fraction_below(self, x: Array) -> Array:
        """Return the fraction of the balls below each ``x`` within the cut."""
        from scipy.special import erf

        return np.asarray(0.5 + 0.5 * erf(x / (self._std * math.sqrt(2.0))) / self._fraction_within)

    def quantile(self, probability: ArrayLike) -> Any:
        """Return the x below which the part ``probability`` of the balls lies, computed from the
        nearer end for its digits.
        """
        from scipy.special import ndtri

        part_above_median = np.asarray(probability, float) - 0.5
        cut_tail = 0.5 * math.erfc(self.cutoff / math.sqrt(2.0))
        # the part of the density before the cut that lies beyond |x|
        tail = cut_tail + self._fraction_within * (0.5 - np.abs(part_above_median))
        deviation = np.clip(-ndtri(tail), 0.0, self.cutoff)  # |x| in standard deviations
        return (np.sign(part_above_median) * self._std * deviation)[()]

    def _divide(self, power: float, pairs: bool) -> tuple[list[Piece], int]:
        """Return the pieces of the distribution of (x + x')/2, or without ``pairs`` of x'/2, and
        the number of Gauss nodes on each; pieces are at most 3 standard deviations long.
        """
        from scipy.special import erf

        # pieces of [-b, b], at most 3 std long, that meet at 0
        ends = np.linspace(-self._edge, self._edge, 2 * self._nodes_per_order + 1).tolist()

        def density_of_ball(t: Array, rise: Array, fall: Array) -> Array:
            """Return the density of t = x/2."""
            return 2.0 * self._compute_density(2.0 * t)

        def make_pair_piece(start: float, end: float) -> Piece:
            """Return the piece from ``start`` to ``end`` of the distribution of pairs."""

            def density_of_pair(t: Array, rise: Array, fall: Array) -> Array:
                """Return the density of t = (x + x')/2."""
                # with x = t + v and x' = t - v the density is the integral over |v| < b - |t|
                if end <= 0.0:  # b - |t|, which keeps its digits at the ends
                    half_range = rise + (start + self._edge)
                else:
                    half_range = fall + (self._edge - end)
                peak = self._compute_density(np.zeros(()))
                scale = math.sqrt(math.pi) * self._std * peak**2
                gaussian = np.exp(-((t / self._std) ** 2))
                return np.asarray(2.0 * scale * gaussian * erf(half_range / self._std))

            return start, end, density_of_pair

        pieces: list[Piece]
        if pairs:
            pieces = [make_pair_piece(start, end) for start, end in pairwise(ends)]
        else:
            pieces = [(0.5 * start, 0.5 * end, density_of_ball) for start, end in pairwise(ends)]
        return pieces, _PIECE_NODES


@dataclass(frozen=True)
class PointShape(Shape):
    """Points at ascending ``positions`` x with ``weights`` that sum to one: averages are finite
    sums.

    Equal balls are one point at x = 0.
    """

    positions: tuple[float, ...]
    weights: tuple[float, ...]

    @property
    def bounds(self) -> tuple[float, float]:
        """Smallest and largest x: the first and the last position."""
        return self.positions[0], self.positions[-1]

    @cached_property
    def _points(self) -> tuple[Array, Array]:
        """Positions x and weights of the points, (n,) each."""
        return np.array(self.positions), np.array(self.weights)

    @cached_property
    def _pairs(self) -> tuple[Array, Array]:
        """The different values of (x_i + x_j)/2, ascending, and their weights, (m,) each."""
        x, w = self._points
        i, j = np.triu_indices(x.size)
        return merge(0.5 * (x[i] + x[j]), w[i] * w[j] * np.where(i == j, 1.0, 2.0))

    @property
    def openings(self) -> Array:
        """(n,) the different values of y = -(x_i + x_j)/2 over all pairs, ascending."""
        return -self._pairs[0][::-1]

    def quantile(self, probability: ArrayLike) -> Any:
        """Return the x below which the part ``probability`` of the balls lies: a step function."""
        x, w = self._points
        return x[find_quantiles(w, np.asarray(probability, float))][()]

    def nodes(self, y: ArrayLike, order: int = 32, whole: bool = False) -> Nodes:
        """Return the nodes of :meth:`Shape.nodes`: the points, at each y."""
        x, w = self._points
        shape = (*np.shape(y), x.size)
        return Nodes(np.broadcast_to(x, shape), np.broadcast_to(w, shape))

    def _average(self, overlap: Array, power: float, pairs: bool) -> Array:
        """Return the sum of w (y + t)_+^p over the values t of (x + x')/2 of all pairs, or of x'/2
        of single balls, with their weights w.
        """
        x, w = self._points
        t, weights = self._pairs if pairs else (0.5 * x, w)

        def evaluate(y: Array) -> Array:
            """Return the sums (n,) at y (n,)."""
            overlaps = y[:, None] + t
            if power:
                # an overlap of an open contact is replaced by a number whose power is zero
                open_overlap = np.inf if power < 0.0 else 0.0
                root = np.sqrt(np.where(overlaps <= 0.0, open_overlap, overlaps))
                terms = _raise_to_power(root, round(2.0 * power))
            else:
                terms = np.heaviside(overlaps, 0.0)  # an overlap of zero does not count
            # a product by @ would round each row differently beside other rows
            return np.asarray(np.sum(terms * weights, axis=-1))

        return evaluate_in_blocks(evaluate, overlap, _NUMBERS_AT_ONCE // t.size)


@lru_cache(maxsize=64)
def _make_gauss_rule(order: int) -> tuple[Array, Array]:
    """Return the Gauss-Legendre nodes and weights on [0, 1], (order,) each."""
    nodes, weights = np.polynomial.legendre.leggauss(order)
    return 0.5 * (nodes + 1.0), 0.5 * weights


def _make_root_nodes(start: Array, length: Array, order: int) -> tuple[Array, Array, Array, Array]:
    """Make Gauss nodes u = v^(1/2) for v in [start, start + length], along the last axis, which has
    length 1 in the arguments and length ``order`` in the results.

    Returns u, v - start, start + length - v and the weights of du. No two nearly equal numbers are
    subtracted.
    """
    nodes, weights = _make_gauss_rule(order)
    low = np.sqrt(start)
    high = np.sqrt(start + length)
    step = np.divide(length, low + high, out=np.zeros_like(length), where=length > 0.0)
    root = low + nodes * step
    rise = nodes * step * (root + low)
    fall = (1.0 - nodes) * step * (root + high)
    return root, rise, fall, weights * step


def evaluate_in_blocks(evaluate: Callable[[Array], Array], arguments: Array, size: int) -> Array:
    """Return the results of ``evaluate``, which maps (n,) to (n,), for an array of any shape;
    ``size`` arguments are evaluated at a time, to bound the memory.
    """
    flat = arguments.reshape(-1)
    size = max(1, size)
    starts = range(0, max(1, flat.size), size)
    blocks = [evaluate(flat[start : start + size]) for start in starts]
    return np.concatenate(blocks).reshape(arguments.shape)


def _raise_to_power(root: Array, exponent: int) -> Array:
    """Return root^n for an ``exponent`` n from -1 to 7, by products: for most n numpy computes a
    general power, at ten times the cost.
    """
    if exponent < 0:
        return np.asarray(1.0 / root)
    square = root * root
    product = root if exponent % 2 else np.ones_like(root)
    for _ in range(exponent // 2):
        product = product * square
    return product


def find_quantiles(weights: Array, probability: Array) -> NDArray[np.intp]:
    """Return the index at which the running sum of the ``weights`` (n,) first exceeds each
    probability, or n - 1 if it never does; of the shape of ``probability``.
    """
    indices = np.searchsorted(np.cumsum(weights), probability, side="right")
    return np.minimum(indices, weights.size - 1)


def subtract_mean(values: Array) -> Array:
    """Return the ``values``, one or more in an array of any shape, less their mean.

    The mean is subtracted twice, so that what remains of it is zero to the rounding of the
    differences, not of the values, which may be far larger.
    """
    differences = values - np.mean(values)
    return np.asarray(differences - np.mean(differences))


def merge(places: Array, weights: Array) -> tuple[Array, Array]:
    """Return the places (m,) that have a weight above zero, each once and ascending, and the sums
    (m,) of the weights at each of them, from ``places`` (n,) and their ``weights`` (n,).
    """
    has_weight = weights > 0.0
    different_places, index = np.unique(places[has_weight], return_inverse=True)
    return different_places, np.bincount(index, weights[has_weight]).astype(float)


def condense(places: Array, weights: Array) -> tuple[Array, Array]:
    """Return at most :data:`MOST_POINTS` places, and their weights, that stand for ``places`` (n,),
    different and ascending, with ``weights`` (n,) above zero.

    If there are no more places than that, they are returned as they are. If there are more, the
    first and the last remain, and those between are divided into cells. A cell of more than two
    places is replaced by the two nodes of a Gauss quadrature: the cell keeps its weight and its
    first three moments, so that only pairs near the kink are in error. Cells are narrower where
    there are many balls: the edges are evenly spaced in 0.3 times the fraction of the balls below
    plus 0.7 times the fraction of the range below. As the widths of cells differ, their pairs open
    at different places, and the errors do not add up.

    Errors were measured against all pairs of 2500 to 1e4 balls (uniform, normal, log-normal, of two
    kinds). The relative errors of F_ave and K_ave are 4e-6 and 4e-4 from f* = 1e-3 on, 2e-7 and
    5e-5 from f* = 0.08 on, and 1e-12 with all contacts closed. Sampling noise is 1e-3 or more.
    """
    if places.size <= MOST_POINTS:
        return places, weights
    # two places for each cell, and two for the first and the last place
    cell, count = _number_cells(places, weights, MOST_POINTS // 2 - 1)
    is_in_large_cell = count[cell] > 2
    _, large_cell = np.unique(cell[is_in_large_cell], return_inverse=True)
    nodes, weights_of_nodes = _replace_by_nodes(
        large_cell, places[is_in_large_cell], weights[is_in_large_cell]
    )
    return merge(
        np.concatenate([places[~is_in_large_cell], nodes]),
        np.concatenate([weights[~is_in_large_cell], weights_of_nodes]),
    )


def _replace_by_nodes(cell: Index, places: Array, weights: Array) -> tuple[Array, Array]:
    """Return the two nodes of a Gauss quadrature for each of m cells, and their weights, (2 m,)
    each: the lower nodes of all cells, then the upper ones. They have the sum of the weights of a
    cell and its first three moments.

    ``cell`` (n,) is the number, from 0 to m - 1, of the cell of each of the ``places`` (n,), whose
    ``weights`` (n,) are above zero; each cell has two different places or more.
    """
    weight = np.bincount(cell, weights)
    mean = np.bincount(cell, weights * places) / weight
    deviation = places - mean[cell]
    std = np.sqrt(np.bincount(cell, weights * deviation**2) / weight)
    third_moment = np.bincount(cell, weights * deviation**3)  # times the weight
    # the nodes are where z^2 - 2 h z - 1 = 0, with z = (node - mean)/std and half the skewness h
    half_skewness = 0.5 * third_moment / (weight * std**3)
    half_distance = np.hypot(1.0, half_skewness)  # in standard deviations
    nodes = [
        mean + std * (half_skewness - half_distance),
        mean + std * (half_skewness + half_distance),
    ]
    weights_of_nodes = [
        0.5 * weight * (1.0 + half_skewness / half_distance),
        0.5 * weight * (1.0 - half_skewness / half_distance),
    ]
    return np.concatenate(nodes), np.concatenate(weights_of_nodes)


def _number_cells(places: Array, weights: Array, n_cells: int) -> tuple[Any, Any]:
    """Return the number (n,) of the cell of each of the ``places`` (n,), ascending, and the number
    of places in each cell that has any.

    The first and the last place have cells of their own. The other places are in ``n_cells`` cells,
    whose edges :func:`condense` describes; cells are numbered from 0, and a cell without places
    gets no number. ``weights`` (n,) are those of the places.
    """
    fraction_below = (np.cumsum(weights) - 0.5 * weights) / np.sum(weights)
    range_below = (places - places[0]) / (places[-1] - places[0])
    coordinate = _SHARE_OF_BALLS * fraction_below + (1.0 - _SHARE_OF_BALLS) * range_below
    cell = np.minimum(np.floor(coordinate * n_cells), n_cells - 1.0)
    cell[0] = -1.0
    cell[-1] = n_cells
    _, number, count = np.unique(cell, return_inverse=True, return_counts=True)
    return number, count


@lru_cache(maxsize=64)
def cut_rms(cutoff: float) -> float:
    """Return the root mean square of a normal distribution of standard deviation 1 that is cut at
    -``cutoff`` and ``cutoff``.
    """
    from scipy.special import gammainc

    half_square = 0.5 * cutoff * cutoff
    return math.sqrt(gammainc(1.5, half_square) / gammainc(0.5, half_square))


# -- distributions of diameters, and samples -------------------------------------------------------


#: smallest fraction of a kind of balls: with a rarer kind, W is so small against the kind's
#: deviation that the laws lose their digits
_LEAST_FRACTION = 1e-12
#: largest number of balls in one sample, far beyond what a machine holds
_MOST_NUMBERS = 2**48
#: memory that a number of a sample takes while it is drawn, bytes: three integers, and a float
_NUMBER_BYTES = 32.0
#: tolerance for rounding, relative: of the mean against the packing's diameter, and of the sum of
#: fractions against 1
_RELATIVE_TOLERANCE = 1e-9


def uniform_numbers(shape: int | Sequence[int], seed: int) -> Array:
    """Return uniform random numbers in (0, 1), of the ``shape``, for the sites of an array:
    SplitMix64 of the seed, then of each index in turn.

    Integer arithmetic makes them the same on every machine. A site keeps its number when the array
    grows along any axis, so that a longer sample begins with a shorter one. Raises
    :class:`InputError` for lengths that are not whole numbers >= 0, for an empty list of lengths,
    for more than 2^48 sites or more than memory holds, or for a seed that is not a whole number
    from 0 to 2^64 - 1.
    """
    given_shape: Any = shape
    if isinstance(given_shape, np.ndarray):
        given_shape = given_shape.tolist()
    is_list = isinstance(given_shape, Sequence) and not isinstance(given_shape, str | bytes)
    given_lengths = tuple(given_shape) if is_list else (given_shape,)
    lengths = tuple(whole_number("shape", length, 0) for length in given_lengths)
    if not lengths or math.prod(lengths) > _MOST_NUMBERS:
        raise InputError(
            f"shape is {brief(shape)}",
            mend="Give one or more lengths, whose product is 2^48 balls or fewer",
        )
    count = math.prod(lengths)
    require_memory(f"diameters of {count:,} balls", _NUMBER_BYTES * count, "Give smaller lengths")
    seed = whole_number("seed", seed, 0, 2**64 - 1)
    state: NDArray[np.uint64] = np.array(int(seed), np.uint64)
    # SplitMix64 along each axis: the constants are those of the generator
    for length in lengths:
        index: NDArray[np.uint64] = np.arange(1, int(length) + 1, dtype=np.uint64)
        state = state[..., np.newaxis] + index * np.uint64(0x9E3779B97F4A7C15)
        state = (state ^ (state >> np.uint64(30))) * np.uint64(0xBF58476D1CE4E5B9)
        state = (state ^ (state >> np.uint64(27))) * np.uint64(0x94D049BB133111EB)
        state = state ^ (state >> np.uint64(31))
    return ((state >> np.uint64(12)).astype(float) + 0.5) * 2.0**-52


@dataclass(frozen=True)
class Spread(ABC):
    """A distribution of ball diameters: :class:`Uniform`, :class:`Normal`, :class:`Discrete` or
    :class:`Measured`.
    """

    @property
    @abstractmethod
    def rms(self) -> float:
        """Root mean square deviation Delta_rms, m (equation 19)."""

    @property
    @abstractmethod
    def shape(self) -> Shape:
        """The distribution of x = Delta/W."""

    @cached_property
    def width(self) -> float:
        """Width W = sqrt(12) Delta_rms, m; 0 for equal balls."""
        return math.sqrt(12.0) * self.rms

    @property
    def mean(self) -> float | None:
        """Mean diameter, m; None for a distribution of deviations only."""
        return None

    @property
    def smallest(self) -> float:
        """Smallest deviation, m."""
        return self.width * self.shape.bounds[0]

    @property
    def largest(self) -> float:
        """Largest deviation, m."""
        return self.width * self.shape.bounds[1]

    @property
    def kind(self) -> str:
        """Name of the distribution in scenes, that of its class in small letters: "uniform",
        "normal", "discrete" or "measured".
        """
        return type(self).__name__.lower()

    def with_width(self, width: float) -> Self:
        """Return the distribution of the same shape and mean whose width is W = ``width``, m.

        Raises :class:`InputError` if the width is negative or not finite, if listed diameters are
        all the same or would be zero or below, or if the distribution is not one of granphon's own.
        """
        raise InputError(
            f"a {type(self).__name__} cannot be given another width",
            "The parameters of this class are not known",
            "Give the spreads themselves",
        )

    def with_mean(self, diameter: float) -> Self:
        """Return the distribution of the same deviations about a mean ``diameter``, m: itself, if
        it is one of deviations only.
        """
        return self

    def check_diameter(self, diameter: float) -> None:
        """Raise :class:`InputError` if the mean diameter of the balls cannot be ``diameter``, m.

        That is so if the ``diameter`` is not a finite number above zero, if the distribution has a
        mean of its own that differs by more than 1e-9 of the ``diameter``, or if the smallest ball
        would have a size at or below zero. A smaller difference of the means has no effect, as
        deviations are taken from the distribution's own mean.
        """
        diameter = positive("diameter", diameter, "m")
        least_diameter = diameter + self.smallest
        if self.mean is not None and abs(self.mean - diameter) > _RELATIVE_TOLERANCE * diameter:
            problem = (
                f"the mean of the diameters is {self.mean:.12g} m, the given diameter is"
                f" {diameter:.12g} m"
            )
            mend = f"Give the mean, {self.mean!r} m, as the diameter"
            raise InputError(problem, "Deviations of diameters are counted from their mean", mend)
        if not least_diameter > 0.0:
            raise InputError(
                f"the smallest ball has a diameter of {least_diameter:g} m",
                f"The smallest deviation from the mean is {self.smallest:g} m",
                "Give a smaller spread",
            )

    def sample(self, shape: int | Sequence[int], seed: int) -> Array:
        """Return the deviations Delta, m, of an array of balls of this ``shape``: the quantiles of
        the :func:`uniform_numbers` of the ``seed``.

        A larger sample keeps the balls of a smaller one. The mean of a sample is near zero, and is
        not shifted to zero here. Raises :class:`InputError` where these numbers do.
        """
        return self._compute_deviations(uniform_numbers(shape, seed))

    def _compute_deviations(self, probability: Array) -> Array:
        """Return the deviations, m, below which the parts ``probability`` of the balls lie."""
        return self.width * np.asarray(self.shape.quantile(probability), float)


@dataclass(frozen=True)
class Uniform(Spread):
    """Deviations spread evenly over a width.

    Parameters
    ----------
    width : the full width W, m; zero for equal balls.

    Raises
    ------
    InputError : the width is negative or not finite.
    """

    width: float = field()

    def __post_init__(self) -> None:
        """Check the width, and keep it as a plain float."""
        object.__setattr__(self, "width", not_negative("width", self.width, "m"))

    def with_width(self, width: float) -> Self:
        """Return the distribution with another ``width``, m; InputError if it is negative or not
        finite.
        """
        return type(self)(width)

    @property
    def rms(self) -> float:
        """Root mean square deviation W / sqrt(12), m."""
        return self.width / math.sqrt(12.0)

    @property
    def shape(self) -> UniformShape:
        """The distribution of x = Delta/W, the same for every width."""
        return UniformShape()


#: least and greatest cutoff of a normal distribution, over its standard deviation: below, the
#: density is even to 1e-6; above, nothing is cut
CUTOFFS = {"low": 1e-3, "high": 10.0}


@dataclass(frozen=True)
class Normal(Spread):
    """Normal deviations without those larger than ``cutoff`` times ``std``.

    Parameters
    ----------
    std : standard deviation before the cut, m; ``rms`` is that after it.
    cutoff : largest deviation over ``std``.

    Raises
    ------
    InputError : a ``std`` that is negative or not finite, or a cutoff outside 0.001 ... 10.
    """

    std: float
    cutoff: float = 3.0

    def __post_init__(self) -> None:
        """Check both numbers, and keep them as plain floats."""
        object.__setattr__(self, "std", not_negative("std", self.std, "m"))
        object.__setattr__(self, "cutoff", positive("cutoff", self.cutoff))
        if not CUTOFFS["low"] <= self.cutoff <= CUTOFFS["high"]:
            allowed = f"{CUTOFFS['low']:g} to {CUTOFFS['high']:g} standard deviations, such as 3"
            raise InputError(f"cutoff is {self.cutoff:g}", mend=f"Give {allowed}")

    def with_width(self, width: float) -> Self:
        """Return the distribution of the same cutoff whose width is W = ``width``, m; InputError if
        it is negative or not finite.
        """
        width_over_std = type(self)(1.0, self.cutoff).width
        return type(self)(not_negative("width", width, "m") / width_over_std, self.cutoff)

    @property
    def rms(self) -> float:
        """Root mean square deviation Delta_rms of the cut distribution, m."""
        return self.std * cut_rms(self.cutoff)

    @property
    def shape(self) -> NormalShape:
        """The distribution of x = Delta/W, which depends on the cutoff alone."""
        return NormalShape(self.cutoff)


@dataclass(frozen=True)
class _Listed(Spread):
    """Diameters given one by one."""

    diameters: tuple[float, ...]

    def with_width(self, width: float) -> Self:
        """Return the diameters whose deviations from their mean are scaled, so that their width is
        ``width``, m; InputError if that is negative or not finite, if the diameters do not deviate,
        or if one would be zero or below.
        """
        new_width = not_negative("width", width, "m")
        if not self.width:
            raise InputError(
                "diameters that are all the same cannot be spread", mend="Give another spread"
            )
        mean = self.mean
        scale = new_width / self.width
        diameters = tuple(mean + (diameter - mean) * scale for diameter in self.diameters)
        if min(diameters) <= 0.0:
            raise InputError(
                f"a spread of the width {new_width:g} m about {mean:g} m has a ball of the"
                f" diameter {min(diameters):g} m",
                "Deviations are scaled, and the mean stays",
                "Give a smaller width",
            )
        scaled_spread = replace(self, diameters=diameters)
        if new_width:
            # the old shape is kept: a shape that differs by rounding would have its law solved
            # again
            scaled_spread.__dict__["shape"] = self.shape
        return scaled_spread

    def with_mean(self, diameter: float) -> Self:
        """Return the diameters shifted so that their mean is ``diameter``, m; InputError if that is
        not a finite number above zero, or if one of them would be zero or below.
        """
        shift = positive("diameter", diameter, "m") - self.mean
        shifted_diameters = tuple(old_diameter + shift for old_diameter in self.diameters)
        return replace(self, diameters=shifted_diameters)

    def _compute_shares(self) -> Array:
        """Return the fraction (n,) of the balls that each of the ``diameters`` stands for."""
        return np.full(len(self.diameters), 1.0 / len(self.diameters))

    @cached_property
    def _table(self) -> tuple[float, Array, Array]:
        """Mean diameter, m; the deviations (n,), m, of the n different diameters, ascending; and
        their probabilities (n,).
        """
        diameters, weights = merge(np.array(self.diameters), self._compute_shares())
        # differences are exact if diameters differ by less than a factor of 2, so that equal balls
        # have width 0
        excesses = diameters - diameters[0]  # over the least diameter
        mean_excess = math.fsum(weights * excesses)
        mean = float(diameters[0]) + mean_excess
        return mean, excesses - mean_excess, weights

    def _compute_deviations(self, probability: Array) -> Array:
        """Return the deviation, m, of a listed diameter for each ``probability``, from 0 to 1; the
        diameters are not condensed as in :attr:`shape`.
        """
        _, deviations, weights = self._table
        return deviations[find_quantiles(weights, probability)]

    @property
    def mean(self) -> float:
        """Mean diameter, m."""
        return self._table[0]

    @cached_property
    def rms(self) -> float:
        """Root mean square deviation Delta_rms, m."""
        _, deviations, weights = self._table
        scale = float(np.max(np.abs(deviations))) or 1.0
        return scale * math.sqrt(math.fsum(weights * (deviations / scale) ** 2))

    @cached_property
    def shape(self) -> PointShape:
        """The distribution of x = Delta/W: each different diameter, rounded to 2^-40 W, condensed
        to at most 192 points.
        """
        _, deviations, shares = self._table
        x = np.round(deviations / (self.width or 1.0) / GRAIN) * GRAIN
        different_x, x_weights = merge(x, shares)
        positions, weights = condense(different_x, x_weights)
        return PointShape(tuple(positions.tolist()), tuple(weights.tolist()))


@dataclass(frozen=True)
class Discrete(_Listed):
    """Kinds of balls, each with its diameter and its fraction of all balls (equation 18).

    Parameters
    ----------
    diameters : (n,) diameters d^Q of the kinds, m.
    fractions : (n,) fractions c^Q of the kinds, 0 to 1, which sum to 1 within 1e-9.

    Raises
    ------
    InputError : no diameters, a diameter that is not a finite number above zero, a fraction that is
        no number, negative or between zero and 1e-12, fractions with another sum, or unequal
        numbers of diameters and fractions.
    """

    fractions: tuple[float, ...]

    def __post_init__(self) -> None:
        """Check diameters and fractions, and keep both as tuples of plain floats."""
        diameters = finite_list("diameters", self.diameters, "m", "above zero")
        fractions = finite_list("fractions", self.fractions, low="zero or above")
        object.__setattr__(self, "diameters", diameters)
        object.__setattr__(self, "fractions", fractions)
        if len(self.fractions) != len(self.diameters):
            diameters_in_words = counted(len(self.diameters), "diameter")
            fractions_in_words = counted(len(self.fractions), "fraction")
            problem = f"{diameters_in_words} and {fractions_in_words} are given"
            raise InputError(problem, mend="Give one fraction for each diameter")
        least_fraction = min((fraction for fraction in self.fractions if fraction), default=1.0)
        if least_fraction < _LEAST_FRACTION:
            mend = "Leave it out, or give the fraction 0"
            raise InputError(
                f"a fraction is {least_fraction:g}",
                f"A kind rarer than {_LEAST_FRACTION:g} is not resolved",
                mend,
            )
        excess = math.fsum(self.fractions) - 1.0
        if abs(excess) > _RELATIVE_TOLERANCE:
            side = "above" if excess > 0.0 else "below"
            problem = f"the fractions sum to {1.0 + excess:.12g}, {abs(excess):.3g} {side} 1"
            raise InputError(problem, "They are parts of a whole", "Divide them by their sum")

    def _compute_shares(self) -> Array:
        """Return the fractions (n,), divided by their sum, which is 1 but for rounding."""
        return np.array(self.fractions) / math.fsum(self.fractions)


@dataclass(frozen=True)
class Measured(_Listed):
    """The measured diameters of a lot of balls, all equally likely.

    Parameters
    ----------
    diameters : (n,) diameters, m; their order does not matter.

    Raises
    ------
    InputError : there are none, or one is not a finite number above zero.
    """

    def __post_init__(self) -> None:
        """Check the diameters, and keep them as a tuple of plain floats."""
        object.__setattr__(
            self, "diameters", finite_list("diameters", self.diameters, "m", "above zero")
        )

    @classmethod
    def from_csv(cls, path: str | Path, column: str | None = None, quoted: bool = True) -> Self:
        """Read diameters from a column of the table (CSV) at ``path``, headed as in
        ``ball,diameter (mm)``.

        ``column`` is the name of the column, by default "diameter" or the only column of the table.
        The first line gives its unit, unless ``column`` does, as in "d (mm)". ``quoted`` says
        whether errors may quote the table, as in :meth:`~granphon.base.tables.Table.read`.

        Raises :class:`InputError` for a file that cannot be read as a table, for a table without
        the column or without rows, for a column without a unit of length, and, with the number of
        the line, for what is not a finite number above zero.
        """
        table = Table.read(path, quoted)
        name = "diameter" if column is None else column
        if column is None and len(table.headings) == 1:
            heading = table.headings[0]
            # an error about another unit would quote the heading
            if quoted or LENGTH.measures(heading.unit):
                name = heading.name
        diameters = table.column(name, LENGTH)
        return cls(tuple(diameters.tolist()))


def given_spread(spread: Any) -> Spread:
    """Return ``spread``, the argument of a public call; raises :class:`InputError` if it is not a
    :class:`Spread`.
    """
    if not isinstance(spread, Spread):
        raise InputError(
            f"spread is {brief(spread)}",
            mend="Give a granphon.Uniform, Normal, Discrete or Measured",
        )
    return spread
