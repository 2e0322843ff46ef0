"""Factors of large sparse matrices of balls that touch their neighbours: a multifrontal Cholesky
decomposition.

The balls are cut in two halves by a layer of balls, each half likewise, and so on (nested
dissection, A. George, SIAM J. Numer. Anal. 10, 345, 1973). A front is such a layer with the balls
outside that its halves touch. Its matrix is dense, so that LAPACK does all of the work, and what is
left of it once the layer has been eliminated goes to the layer that cuts off both (I. S. Duff and
J. K. Reid, ACM Trans. Math. Softw. 9, 302, 1983).

Motions that cost nothing, or hardly anything, have no pivot. They are set aside, with all of their
couplings, until all others have been eliminated: they are the only ones that are left.
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
#: pivot, over the diagonal, below which a motion is set aside: pivots lose half of their digits to
#: it at most
_SOFT_PIVOT = 1e-8
#: and below which it is rounding, with all of its couplings
_NO_PIVOT = 1e-13


#: memory of an entry of the factors, with those of fronts that are under way, bytes
_FRONTS_BYTES = 24.0


class Layer(NamedTuple):
    """Balls that are eliminated together, those that are left and touch them or what they cut off,
    and what they cut.
    """

    balls: Index
    beyond: Index
    halves: tuple[int, ...]


class _Front(NamedTuple):
    """Motions that have been eliminated, those with which they were coupled, and both parts of the
    factor L.
    """

    own: Index
    rest: Index
    lower: Array
    below: Array


def dissect(places: Array, i: Index, j: Index) -> list[Layer]:
    """Cut balls at ``places`` (n, d), which contacts join, into layers; halves come before the
    layer that cuts them.

    Along a period a place counts within the cell. The last layer cuts all that contacts join.
    """
    from scipy.sparse import csr_array

    n = len(places)
    ends = np.concatenate([i, j]), np.concatenate([j, i])
    touches = csr_array((np.ones(ends[0].size, np.int8), ends), shape=(n, n))
    layers: list[Layer] = []
    gone, mark = np.zeros(n, bool), np.zeros(n, bool)

    def find_neighbours(balls: Index) -> Index:
        return np.unique(touches[balls].indices).astype(np.intp)

    def cut(balls: Index) -> int:
        halves: tuple[int, ...] = ()
        layer = balls
        if balls.size > _FEW_BALLS:
            axis = int(np.argmax(np.ptp(places[balls], axis=0)))
            order = balls[np.argsort(places[balls, axis], kind="stable")]
            low = order[: order.size // 2]
            high = order[order.size // 2 :]
            layers_between = []
            for one, other in ((low, high), (high, low)):
                mark[other] = True
                between = touches[one] @ mark > 0
                mark[other] = False
                layers_between.append(between)
            if np.count_nonzero(layers_between[0]) <= np.count_nonzero(layers_between[1]):
                layer = low[layers_between[0]]
                low = low[~layers_between[0]]
            else:
                layer = high[layers_between[1]]
                high = high[~layers_between[1]]
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
    other. ``left`` are the motions that have been set aside. If nothing but these can make the
    matrix indefinite, it is so where what is left of it is. Then :meth:`solve` is for the others
    alone.
    """

    def __init__(
        self, matrix: Any, layers: list[Layer], count: int, progress: Progress = silent
    ) -> None:
        needed = max(1.0, _FRONTS_BYTES * count**2 * sum(map(_count_entries, layers)))
        balls = f"{matrix.shape[0] // count:,} balls"
        require_memory(
            f"factors of the contacts of {balls}",
            needed,
            "Take fewer balls, or a part of the network",
        )
        self._fronts: list[_Front] = []
        places = np.full(matrix.shape[0], -1)
        left: list[Index] = []
        passed: list[tuple[Index, Array] | None] = []  # what each layer leaves of its front
        aside: list[Index] = []  # motions without a pivot that it hands on
        with progress.step("factors of the contacts", len(layers)) as step:
            for layer in layers:
                waiting = [aside[half] for half in layer.halves]
                first = (layer.balls[:, None] * count + np.arange(count)).ravel()
                own = np.concatenate([first, *waiting])
                rest = (layer.beyond[:, None] * count + np.arange(count)).ravel()
                every = np.concatenate([own, rest])
                places[every] = np.arange(every.size)
                front = np.zeros((every.size, every.size))
                lines = matrix[first]
                at_line = np.repeat(np.arange(first.size), np.diff(lines.indptr))
                at = places[lines.indices]
                inside = at >= 0  # others have been eliminated, and have handed on what they leave
                front[at_line[inside], at[inside]] = lines.data[inside]
                front[at[inside], at_line[inside]] = lines.data[inside]
                for half in layer.halves:
                    handed = passed[half]
                    if handed is not None:
                        at = places[handed[0]]
                        front[at[:, None], at] += handed[1]
                        passed[half] = None
                places[every] = -1
                lower, order, rank = _factorise(front[: own.size, : own.size])
                kept = order[:rank]
                soft = order[rank:]
                after = np.concatenate([soft, np.arange(own.size, every.size)])
                below = np.ascontiguousarray(_divide(lower, front[np.ix_(after, kept)]))
                remains = (
                    front[np.ix_(after, after)] - below @ below.T
                    if after.size
                    else np.zeros((0, 0))
                )
                # a motion that is coupled with nothing any more needs no place in the fronts above
                nothing = np.max(np.abs(remains[: soft.size]), axis=1, initial=0.0) <= _NO_PIVOT
                handed_on = np.concatenate([~nothing, np.ones(rest.size, bool)])
                if rest.size == 0:
                    handed_on[:] = False  # nothing is above
                names = every[after]
                left.append(names[~handed_on])
                aside.append(every[soft[handed_on[: soft.size]]])
                passed.append((names[handed_on], remains[np.ix_(handed_on, handed_on)]))
                self._fronts.append(_Front(own[kept], names, lower, below))
                step.advance()
        self.left = np.concatenate(left)
        self._is_left = np.zeros(matrix.shape[0], bool)
        self._is_left[self.left] = True

    def solve(self, forces: Array) -> Array:
        """Return the motions (n, k) of balls under forces (n, k), those in ``left`` being held."""
        from scipy.linalg import solve_triangular

        found = np.where(self._is_left[:, None], 0.0, forces)
        fronts = [front for front in self._fronts if front.own.size]
        for front in fronts:
            own = solve_triangular(front.lower, found[front.own], lower=True, check_finite=False)
            found[front.own] = own
            found[front.rest] -= front.below @ own
        found[self.left] = 0.0
        for front in reversed(fronts):
            own = found[front.own] - front.below.T @ found[front.rest]
            found[front.own] = solve_triangular(
                front.lower, own, lower=True, trans="T", check_finite=False
            )
        return found

    def follow(self) -> Array:
        """Return the motions (n, k) of all balls, without forces on them, as each of ``left`` (k,)
        alone moves by one.
        """
        from scipy.linalg import solve_triangular

        found = np.zeros((self._is_left.size, self.left.size))
        found[self.left, np.arange(self.left.size)] = 1.0
        for front in reversed(self._fronts):
            if not front.own.size:
                continue
            moved = found[front.rest]
            # most of those that are left move a few balls alone
            some = np.flatnonzero(np.any(moved != 0.0, axis=0))
            if not some.size:
                continue
            own = -(front.below.T @ moved[:, some])
            found[front.own[:, None], some] = solve_triangular(
                front.lower, own, lower=True, trans="T", check_finite=False
            )
        return found


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
