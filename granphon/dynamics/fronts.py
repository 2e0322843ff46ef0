"""Factors of large sparse matrices of balls that touch their neighbours: a multifrontal Cholesky
decomposition.

A layer of balls cuts the balls in two halves that do not touch, another layer cuts each half, and
so on (nested dissection, A. George, SIAM J. Numer. Anal. 10, 345, 1973). A front is such a layer
together with the balls outside of it that the layer or its halves touch. The matrix of a front is
dense, so that LAPACK does all of the work. Once the layer has been eliminated, the remainder of the
matrix is added to the front of the layer above, one of whose halves the layer cuts (I. S. Duff and
J. K. Reid, ACM Trans. Math. Softw. 9, 302, 1983).

Motions that cost nothing, or hardly anything, have no pivot. They are set aside, with all of their
couplings, until all other motions have been eliminated.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from granphon.base.arrays import Array, Index
from granphon.base.memory import require_memory
from granphon.base.progress import Progress, silent

#: number of balls up to which a set of balls is not cut any further
_MOST_UNCUT_BALLS = 24
#: pivot, over the diagonal, below which a motion is set aside, so that other pivots keep half of
#: their digits
_LEAST_PIVOT = 1e-8
#: coupling of a motion that is set aside, over the diagonal, up to which it is rounding
_COUPLING_ROUNDING = 1e-13
#: memory, bytes, over the number of entries of the factors: fronts that are not finished yet, and
#: their remainders, are contained
_FRONTS_BYTES = 24.0


class Layer(NamedTuple):
    """A layer of balls that cuts others in two halves.

    Attributes
    ----------
    balls : (m,) balls of the layer, which are eliminated together.
    beyond : (l,) balls that touch the layer or its halves, and are eliminated later.
    halves : numbers of the layers that cut its two halves; fewer if a half is empty.
    """

    balls: Index
    beyond: Index
    halves: tuple[int, ...]


class _Front(NamedTuple):
    """What one front contributes to the factor L.

    Attributes
    ----------
    eliminated_motions : (r,) motions that have been eliminated.
    coupled_motions : (l,) motions of the front that remained.
    lower : (r, r) L among the eliminated motions.
    below : (l, r) L from the eliminated motions to the coupled ones.
    """

    eliminated_motions: Index
    coupled_motions: Index
    lower: Array
    below: Array


class _Remainder(NamedTuple):
    """What a front passes on to the front above.

    Attributes
    ----------
    motions : (m,) motions that are not yet eliminated.
    matrix : (m, m) the matrix that remains for these motions.
    soft_motions : (s,) those of the motions that belong to the layer or its halves, but had no
        pivot.
    """

    motions: Index
    matrix: Array
    soft_motions: Index


def dissect(positions: Array, i: Index, j: Index) -> list[Layer]:
    """Return the layers into which balls at ``positions`` (n, d) are cut, each layer after those of
    its halves; the last layer cuts all balls.

    Contacts join the balls ``i`` and ``j`` (n_c,). Positions are taken as they are, within the
    cell, also along a period.
    """
    dissection = _Dissection(positions, i, j)
    dissection.cut(np.arange(len(positions)))
    return dissection.layers


class _Dissection:
    """The layers, so far, into which balls at ``positions`` (n, d) with contacts of ``i`` and ``j``
    (n_c,) are cut.
    """

    def __init__(self, positions: Array, i: Index, j: Index) -> None:
        """Tabulate which balls touch; there are no layers yet."""
        from scipy.sparse import csr_array

        n = len(positions)
        rows = np.concatenate([i, j])
        columns = np.concatenate([j, i])
        entries = np.ones(rows.size, bool)
        self.positions = positions
        self.layers: list[Layer] = []
        #: (n, n) true where two balls touch
        self._touches = csr_array((entries, (rows, columns)), shape=(n, n))
        self._is_in_layer = np.zeros(n, bool)  # balls of the layers so far
        self._is_neighbour = np.zeros(n, bool)  # work space of `_find_touching`, else all false

    def cut(self, balls: Index) -> int:
        """Cut ``balls`` (m,) into layers by nested dissection, and append the layers to ``layers``:
        first those of the two halves, and last the layer that separates the halves. Return the
        index of this last layer. Few balls are one layer.
        """
        layer = balls
        halves: tuple[int, ...] = ()
        if balls.size > _MOST_UNCUT_BALLS:
            layer, low, high = self._halve(balls)
            halves = tuple(self.cut(half) for half in (low, high) if half.size)
        self._is_in_layer[layer] = True
        neighbours = np.unique(self._touches[layer].indices).astype(np.intp)
        beyond_halves = [self.layers[half].beyond for half in halves]
        beyond = np.unique(np.concatenate([neighbours, *beyond_halves]))
        self.layers.append(Layer(layer, beyond[~self._is_in_layer[beyond]], halves))
        return len(self.layers) - 1

    def _halve(self, balls: Index) -> tuple[Index, Index, Index]:
        """Return a layer across the longest axis of ``balls`` (m,), and the balls on its low and on
        its high side, which do not touch each other.

        The balls are divided into two halves of equal number along the axis. The layer is made of
        those balls of one half that touch the other half: of the half where these are fewer.
        """
        axis = int(np.argmax(np.ptp(self.positions[balls], axis=0)))
        order = balls[np.argsort(self.positions[balls, axis], kind="stable")]
        low = order[: order.size // 2]
        high = order[order.size // 2 :]
        low_touches = self._find_touching(low, high)
        high_touches = self._find_touching(high, low)
        if np.count_nonzero(low_touches) <= np.count_nonzero(high_touches):
            return low[low_touches], low[~low_touches], high
        return high[high_touches], low, high[~high_touches]

    def _find_touching(self, balls: Index, neighbours: Index) -> NDArray[np.bool_]:
        """Return (m,) whether each of the ``balls`` (m,) touches any of the ``neighbours`` (l,)."""
        self._is_neighbour[neighbours] = True
        # a product of booleans: whether there is any neighbour, and not how many
        is_touching = self._touches[balls] @ self._is_neighbour
        self._is_neighbour[neighbours] = False
        return np.asarray(is_touching)


class Fronts:
    """The factors of a symmetric ``matrix`` (n, n), sparse by rows, whose diagonal is one or zero.

    ``layers`` are those of :func:`dissect`. Each ball has ``count`` motions, which follow those of
    the ball before. The attribute ``aside`` (k,) holds the numbers of the motions without a pivot,
    which have been set aside; :meth:`solve` is for all other motions.
    """

    def __init__(
        self, matrix: Any, layers: list[Layer], count: int, progress: Progress = silent
    ) -> None:
        """Eliminate the motions of all layers, front by front, and tell the ``progress``.

        Raises :class:`~granphon.base.errors.InputError` if the factors do not fit into memory.
        """
        n_balls = matrix.shape[0] // count
        entries = count**2 * sum(_count_entries(layer) for layer in layers)
        require_memory(
            f"factors of the contacts of {n_balls:,} balls",
            max(1.0, _FRONTS_BYTES * entries),
            "Take fewer balls, or a part of the network",
        )
        self._fronts: list[_Front] = []
        rows = np.full(matrix.shape[0], -1)  # row of each motion in the present front; -1 outside
        without_pivot: list[Index] = []
        remainders = dict[int, _Remainder]()  # by the layer, until the front above has taken them
        with progress.step("factors of the contacts", len(layers)) as step:
            for number, layer in enumerate(layers):
                halves = [remainders.pop(half) for half in layer.halves]
                layer_motions = _list_motions(layer.balls, count)
                # the front eliminates the motions of its layer, and those that had no pivot in the
                # fronts of the halves; motions of the balls beyond come after these
                inner_motions = np.concatenate(
                    [layer_motions, *(half.soft_motions for half in halves)]
                )
                motions = np.concatenate([inner_motions, _list_motions(layer.beyond, count)])
                rows[motions] = np.arange(motions.size)
                matrix_of_front = _compose_front(matrix[layer_motions], rows, motions.size)
                for half in halves:
                    rows_of_half = rows[half.motions]
                    matrix_of_front[rows_of_half[:, None], rows_of_half] += half.matrix
                rows[motions] = -1
                front, remainder, aside = _eliminate(matrix_of_front, motions, inner_motions.size)
                self._fronts.append(front)
                remainders[number] = remainder
                without_pivot.append(aside)
                step.advance()
        self.aside = np.concatenate(without_pivot)
        self._is_aside = np.zeros(matrix.shape[0], bool)
        self._is_aside[self.aside] = True

    def solve(self, forces: Array) -> Array:
        """Return the motions (n, m) of the balls under ``forces`` (n, m), with the motions
        ``aside`` held at zero. A force is the matrix times a motion.
        """
        from scipy.linalg import solve_triangular

        # forces at first: those on a front become its motions once the front has been solved
        motions = np.where(self._is_aside[:, None], 0.0, forces)
        fronts = [front for front in self._fronts if front.eliminated_motions.size]
        for front in fronts:
            forward_solution = solve_triangular(
                front.lower, motions[front.eliminated_motions], lower=True, check_finite=False
            )
            motions[front.eliminated_motions] = forward_solution
            motions[front.coupled_motions] -= front.below @ forward_solution
        motions[self.aside] = 0.0
        for front in reversed(fronts):
            residual = (
                motions[front.eliminated_motions] - front.below.T @ motions[front.coupled_motions]
            )
            motions[front.eliminated_motions] = solve_triangular(
                front.lower, residual, lower=True, trans="T", check_finite=False
            )
        return motions

    def follow(self) -> Array:
        """Return the motions (n, k) of all balls, one column for each of the motions ``aside``
        (k,): that motion is one, the others aside are zero, and no forces act on all other motions.
        """
        from scipy.linalg import solve_triangular

        motions = np.zeros((self._is_aside.size, self.aside.size))
        motions[self.aside, np.arange(self.aside.size)] = 1.0
        for front in reversed(self._fronts):
            if not front.eliminated_motions.size:
                continue
            coupled_amplitudes = motions[front.coupled_motions]
            # most motions that are set aside move only a few balls
            columns = np.flatnonzero(np.any(coupled_amplitudes != 0.0, axis=0))
            if not columns.size:
                continue
            motions[front.eliminated_motions[:, None], columns] = solve_triangular(
                front.lower,
                -(front.below.T @ coupled_amplitudes[:, columns]),
                lower=True,
                trans="T",
                check_finite=False,
            )
        return motions


def _list_motions(balls: Index, count: int) -> Index:
    """Return the numbers (m * count,) of the ``count`` motions of each of the ``balls`` (m,)."""
    return np.asarray((balls[:, None] * count + np.arange(count)).ravel())


def _eliminate(matrix: Array, motions: Index, n_inner: int) -> tuple[_Front, _Remainder, Index]:
    """Eliminate those of the first ``n_inner`` of the ``motions`` (m,) of a front that have pivots;
    ``matrix`` (m, m) is that of the front.

    Return the front, its remainder, and the motions without a pivot that are not passed on to the
    front above: those without couplings, and all in the last layer, which has no front above.
    """
    lower_factor, order, rank = _factorise(matrix[:n_inner, :n_inner])
    pivot_numbers = order[:rank]
    soft_numbers = order[rank:]
    later_motions = np.concatenate([soft_numbers, np.arange(n_inner, motions.size)])
    below = np.ascontiguousarray(
        _divide(lower_factor, matrix[np.ix_(later_motions, pivot_numbers)])
    )
    complement = np.zeros((0, 0))
    if later_motions.size:
        # Schur's complement of the eliminated motions
        complement = matrix[np.ix_(later_motions, later_motions)] - below @ below.T
    n_outer = motions.size - n_inner
    coupling = np.max(np.abs(complement[: soft_numbers.size]), axis=1, initial=0.0)
    is_passed = np.concatenate([coupling > _COUPLING_ROUNDING, np.ones(n_outer, bool)])
    has_front_above = n_outer > 0
    if not has_front_above:
        is_passed[:] = False
    coupled_motions = motions[later_motions]
    remainder = _Remainder(
        motions=coupled_motions[is_passed],
        matrix=complement[np.ix_(is_passed, is_passed)],
        soft_motions=motions[soft_numbers[is_passed[: soft_numbers.size]]],
    )
    front = _Front(motions[pivot_numbers], coupled_motions, lower_factor, below)
    return front, remainder, coupled_motions[~is_passed]


def _compose_front(lines: Any, rows: Index, size: int) -> Array:
    """Return the matrix (size, size) of a front, without the remainders of its halves.

    ``lines`` (k, n) are the sparse rows of the motions of its layer, which are the first k of the
    front. ``rows`` (n,) are the rows of all motions in the front; -1 for motions outside of it,
    which have been eliminated before.
    """
    front = np.zeros((size, size))
    i = np.repeat(np.arange(lines.shape[0]), np.diff(lines.indptr))
    j = rows[lines.indices]
    is_in_front = j >= 0
    front[i[is_in_front], j[is_in_front]] = lines.data[is_in_front]
    front[j[is_in_front], i[is_in_front]] = lines.data[is_in_front]
    return front


def _count_entries(layer: Layer) -> int:
    """Return the number of pairs of balls in the factor L of a ``layer``."""
    return layer.balls.size * (layer.balls.size + layer.beyond.size)


def _factorise(matrix: Array) -> tuple[Array, Index, int]:
    """Return the factor L (r, r) of the part of a ``matrix`` (n, n) that has pivots, an order (n,)
    of the motions, and the number r of motions with a pivot, which come first in this order.
    """
    from scipy.linalg.lapack import dpotrf, dpstrf

    n = len(matrix)
    if not n:
        return matrix, np.arange(0), 0
    lower, failure = dpotrf(matrix, lower=1)
    if not failure and np.min(lower.diagonal()) ** 2 > _LEAST_PIVOT:
        return lower, np.arange(n), n
    # a slower routine, which chooses pivots in descending order, so that small ones come last
    lower, order, rank, _ = dpstrf(matrix, tol=_LEAST_PIVOT, lower=1)
    # LAPACK counts from one
    return np.tril(lower[:rank, :rank]), np.asarray(order - 1, np.intp), int(rank)


def _divide(lower: Array, block: Array) -> NDArray[np.float64]:
    """Return B L^-T (m, r) for B = ``block`` (m, r) and L = ``lower`` (r, r)."""
    from scipy.linalg.blas import dtrsm

    if not block.size:
        return block
    return np.asarray(dtrsm(1.0, lower, block, side=1, lower=1, trans_a=1))
