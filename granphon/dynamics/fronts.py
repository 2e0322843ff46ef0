"""Factors of large sparse matrices of balls that touch their neighbours: a multifrontal Cholesky
decomposition.

The balls are cut in two halves by a layer of balls, each half likewise, and so on (nested
dissection, A. George, SIAM J. Numer. Anal. 10, 345, 1973). A front is such a layer with the balls
outside that its halves touch. The matrix of a front is dense, so that LAPACK does all of the work.
Once the layer has been eliminated, the remainder of the matrix goes to the layer that cuts off both
(I. S. Duff and J. K. Reid, ACM Trans. Math. Softw. 9, 302, 1983).

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

#: most balls that are not cut any more
_FEW_BALLS = 24
#: pivot, over the diagonal, below which a motion is set aside: so other pivots keep half of their
#: digits
_SOFT_PIVOT = 1e-8
#: coupling of a motion that is set aside, over the diagonal, up to which it is rounding
_NO_PIVOT = 1e-13
#: memory of an entry of the factors, with those of fronts that are under way, bytes
_FRONTS_BYTES = 24.0


class Layer(NamedTuple):
    """A layer of balls.

    ``balls`` are eliminated together; ``beyond`` are balls that are eliminated later and touch the
    layer or its halves; ``halves`` are the numbers of the layers that cut its two halves.
    """

    balls: Index
    beyond: Index
    halves: tuple[int, ...]


class _Front(NamedTuple):
    """Motions that have been ``eliminated``, the ``coupled`` motions that remained, and both parts
    of the factor L: ``lower`` of the first, and ``below``, which joins both.
    """

    eliminated: Index
    coupled: Index
    lower: Array
    below: Array


def dissect(positions: Array, i: Index, j: Index) -> list[Layer]:
    """Cut balls at ``positions`` (n, d), which contacts join, into layers; halves come before the
    layer that cuts them.

    Along a period a position counts within the cell. The last layer cuts all that contacts join.
    """
    from scipy.sparse import csr_array

    n = len(positions)
    ends = np.concatenate([i, j]), np.concatenate([j, i])
    touches = csr_array((np.ones(ends[0].size, np.int8), ends), shape=(n, n))
    layers: list[Layer] = []
    gone = np.zeros(n, bool)
    mark = np.zeros(n, bool)

    def find_neighbours(balls: Index) -> Index:
        return np.unique(touches[balls].indices).astype(np.intp)

    def find_touching(balls: Index, neighbours: Index) -> NDArray[np.bool_]:
        mark[neighbours] = True
        is_touching = touches[balls] @ mark > 0
        mark[neighbours] = False
        return np.asarray(is_touching)

    def cut(balls: Index) -> int:
        halves: tuple[int, ...] = ()
        layer = balls
        if balls.size > _FEW_BALLS:
            axis = int(np.argmax(np.ptp(positions[balls], axis=0)))
            order = balls[np.argsort(positions[balls, axis], kind="stable")]
            low = order[: order.size // 2]
            high = order[order.size // 2 :]
            low_touches = find_touching(low, high)
            high_touches = find_touching(high, low)
            if np.count_nonzero(low_touches) <= np.count_nonzero(high_touches):
                layer = low[low_touches]
                low = low[~low_touches]
            else:
                layer = high[high_touches]
                high = high[~high_touches]
            halves = tuple(cut(half) for half in (low, high) if half.size)
        gone[layer] = True
        parts = [find_neighbours(layer), *(layers[half].beyond for half in halves)]
        beyond = np.unique(np.concatenate(parts))
        layers.append(Layer(layer, beyond[~gone[beyond]], halves))
        return len(layers) - 1

    cut(np.arange(n))
    return layers


class Fronts:
    """The factors of a symmetric matrix (n, n), sparse by rows, whose diagonal is one or zero.

    ``layers`` are those of :func:`dissect`; each ball has ``count`` motions, one ball after the
    other. ``aside`` are the motions that have been set aside, and :meth:`solve` is for all other
    motions. If only the motions set aside can make the matrix indefinite, it is indefinite where
    the part that remains for them is.
    """

    def __init__(
        self, matrix: Any, layers: list[Layer], count: int, progress: Progress = silent
    ) -> None:
        balls = f"{matrix.shape[0] // count:,} balls"
        require_memory(
            f"factors of the contacts of {balls}",
            max(1.0, _FRONTS_BYTES * count**2 * sum(map(_count_entries, layers))),
            "Take fewer balls, or a part of the network",
        )
        self._fronts: list[_Front] = []
        rows = np.full(matrix.shape[0], -1)  # of motions in the front that is under way
        uncoupled: list[Index] = []
        remainders: list[tuple[Index, Array] | None] = []  # of the front of each layer
        soft_motions: list[Index] = []  # motions without a pivot, of each layer
        with progress.step("factors of the contacts", len(layers)) as step:
            for layer in layers:
                first = (layer.balls[:, None] * count + np.arange(count)).ravel()
                inner = np.concatenate([first, *(soft_motions[half] for half in layer.halves)])
                outer = (layer.beyond[:, None] * count + np.arange(count)).ravel()
                motions = np.concatenate([inner, outer])
                rows[motions] = np.arange(motions.size)
                front = _compose_front(matrix[first], rows, motions.size)
                for half in layer.halves:
                    remainder = remainders[half]
                    if remainder is not None:
                        numbers = rows[remainder[0]]
                        front[numbers[:, None], numbers] += remainder[1]
                        remainders[half] = None
                rows[motions] = -1
                lower, order, rank = _factorise(front[: inner.size, : inner.size])
                hard = order[:rank]
                soft = order[rank:]
                later = np.concatenate([soft, np.arange(inner.size, motions.size)])
                below = np.ascontiguousarray(_divide(lower, front[np.ix_(later, hard)]))
                matrix_later = np.zeros((0, 0))
                if later.size:
                    matrix_later = front[np.ix_(later, later)] - below @ below.T
                # a soft motion without couplings stays out of the fronts above; the last layer has
                # no front above
                coupling = np.max(np.abs(matrix_later[: soft.size]), axis=1, initial=0.0)
                is_passed = np.concatenate([coupling > _NO_PIVOT, np.ones(outer.size, bool)])
                if outer.size == 0:
                    is_passed[:] = False
                coupled = motions[later]
                uncoupled.append(coupled[~is_passed])
                soft_motions.append(motions[soft[is_passed[: soft.size]]])
                remainders.append((coupled[is_passed], matrix_later[np.ix_(is_passed, is_passed)]))
                self._fronts.append(_Front(inner[hard], coupled, lower, below))
                step.advance()
        self.aside = np.concatenate(uncoupled)
        self._is_aside = np.zeros(matrix.shape[0], bool)
        self._is_aside[self.aside] = True

    def solve(self, forces: Array) -> Array:
        """Return the motions (n, k) of balls under forces (n, k), those in ``aside`` being held."""
        from scipy.linalg import solve_triangular

        motions = np.where(self._is_aside[:, None], 0.0, forces)
        fronts = [front for front in self._fronts if front.eliminated.size]
        for front in fronts:
            forward = solve_triangular(
                front.lower, motions[front.eliminated], lower=True, check_finite=False
            )
            motions[front.eliminated] = forward
            motions[front.coupled] -= front.below @ forward
        motions[self.aside] = 0.0
        for front in reversed(fronts):
            residual = motions[front.eliminated] - front.below.T @ motions[front.coupled]
            motions[front.eliminated] = solve_triangular(
                front.lower, residual, lower=True, trans="T", check_finite=False
            )
        return motions

    def follow(self) -> Array:
        """Return the motions (n, k) of all balls, without forces on them, as each of ``aside`` (k,)
        alone moves by one.
        """
        from scipy.linalg import solve_triangular

        motions = np.zeros((self._is_aside.size, self.aside.size))
        motions[self.aside, np.arange(self.aside.size)] = 1.0
        for front in reversed(self._fronts):
            if not front.eliminated.size:
                continue
            moved = motions[front.coupled]
            # most motions that are set aside move a few balls alone
            columns = np.flatnonzero(np.any(moved != 0.0, axis=0))
            if not columns.size:
                continue
            motions[front.eliminated[:, None], columns] = solve_triangular(
                front.lower,
                -(front.below.T @ moved[:, columns]),
                lower=True,
                trans="T",
                check_finite=False,
            )
        return motions


def _compose_front(lines: Any, rows: Index, size: int) -> Array:
    """Return the matrix (size, size) of a front from ``lines``, the sparse rows of the motions of
    its layer, which come first.

    ``rows`` (n,) are the rows of motions in the front, and -1 of motions that have been eliminated:
    the remainders of the halves hold what these leave.
    """
    front = np.zeros((size, size))
    i = np.repeat(np.arange(lines.shape[0]), np.diff(lines.indptr))
    j = rows[lines.indices]
    inside = j >= 0
    front[i[inside], j[inside]] = lines.data[inside]
    front[j[inside], i[inside]] = lines.data[inside]
    return front


def _count_entries(layer: Layer) -> int:
    """Return the number of pairs of balls in the factors of a layer."""
    return layer.balls.size * (layer.balls.size + layer.beyond.size)


def _factorise(matrix: Array) -> tuple[Array, Index, int]:
    """Return L (r, r), the order of motions, and the number r of those that have a pivot; they come
    first.
    """
    from scipy.linalg.lapack import dpotrf, dpstrf

    n = len(matrix)
    if not n:
        return matrix, np.arange(0), 0
    lower, failed = dpotrf(matrix, lower=1)
    if not failed and np.min(lower.diagonal()) ** 2 > _SOFT_PIVOT:
        return lower, np.arange(n), n
    lower, order, rank, _ = dpstrf(matrix, tol=_SOFT_PIVOT, lower=1)
    return np.tril(lower[:rank, :rank]), np.asarray(order - 1, np.intp), int(rank)


def _divide(lower: Array, right: Array) -> NDArray[np.float64]:
    """Return B L^-T."""
    from scipy.linalg.blas import dtrsm

    if not right.size:
        return right
    return np.asarray(dtrsm(1.0, lower, right, side=1, lower=1, trans_a=1))
