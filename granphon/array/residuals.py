"""The method of minimal residuals (GMRES) for the linear equations of an array of balls that are not symmetric.

Y. Saad and M. H. Schultz, SIAM J. Sci. Stat. Comput. 7, 856 (1986), preconditioned from the right. Steps of Newton's method
need few digits and few iterations: vectors are in single precision, and an iteration costs little beside its product.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any

import numpy as np
from numpy.typing import NDArray

from granphon.array.stencils import dot

__all__ = ["Single", "solve_by_minimal_residuals"]

Array = NDArray[np.float64]
Single = NDArray[Any]
Operator = Callable[[Single], Single]
#: vectors kept, after which the method starts again
_KEPT = 60
#: number of elements of a vector that are worked on at a time, so that they stay in the processor's cache
_CACHED = 2**14
#: part of a vector's length that is left by the projection on those before it, below which it is projected once more
_CANCELLED = 0.1
#: part of it that is nothing but rounding: the vector then lies among those before it
_ROUNDING = float(np.finfo(np.float32).eps)


def solve_by_minimal_residuals(
    apply: Operator, precondition: Operator, right: Array, reduction: float, most: int
) -> tuple[Array, int]:
    """Return x with |A x - right| <= ``reduction`` |right|, and the number of iterations, ``most`` of them at most.

    A and the preconditioner take and return flat arrays in single precision. Of a part of ``right`` that A cannot reach
    nothing is found.
    """
    size, taken = math.sqrt(dot(right, right)), 0
    found = np.zeros_like(right)
    if not size:
        return found, 0
    rest, left = (right / size).astype(np.float32), 1.0
    while left > reduction and taken < most:
        count, left, change = _cycle(apply, precondition, rest, reduction, min(_KEPT, most - taken))
        if not count:  # what is left is out of reach of A
            break
        found += change
        taken += count
        if left > reduction:
            rest = rest - apply(change)
    return size * found, taken


def _cycle(apply: Operator, precondition: Operator, rest: Single, reduction: float, kept: int) -> tuple[int, float, Single]:
    """Return the number of iterations of one cycle, the norm of the residual and the change of the solution."""
    first = math.sqrt(dot(rest, rest))
    basis, ways = np.empty((2, kept + 1, rest.size), np.float32)
    triangle, turned = np.zeros((kept + 1, kept)), np.zeros(kept + 1)
    turns: list[tuple[float, float]] = []
    blocks = [slice(low, low + _CACHED) for low in range(0, rest.size, _CACHED)]
    basis[0], turned[0] = rest / np.float32(first), first
    count = 0
    for column in range(kept):
        ways[column] = precondition(basis[column])
        new, old = apply(ways[column]), basis[: column + 1]
        whole = height = math.sqrt(dot(new, new))
        before = math.inf
        while _ROUNDING * whole < height < _CANCELLED * before:  # once more, for what rounding has left, where much has gone
            before = height
            parts = np.sum([np.einsum("ij,j->i", old[:, some], new[some]) for some in blocks], axis=0)
            for some in blocks:
                new[some] -= np.einsum("i,ij->j", parts, old[:, some])
            triangle[: column + 1, column] += parts
            height = math.sqrt(dot(new, new))
        height = height if height > _ROUNDING * whole else 0.0
        line, count = triangle[:, column], column + 1
        for row, (c, s) in enumerate(turns):
            line[row], line[row + 1] = c * line[row] + s * line[row + 1], c * line[row + 1] - s * line[row]
        length = math.hypot(line[column], height)
        if not length:
            count = column
            break
        c, s = line[column] / length, height / length
        turns.append((c, s))
        line[column] = length
        turned[column + 1], turned[column] = -s * turned[column], c * turned[column]
        if abs(turned[column + 1]) <= reduction or not height:
            break
        basis[column + 1] = new / np.float32(height)
    weights = np.zeros(count)
    for row in reversed(range(count)):
        weights[row] = (turned[row] - triangle[row, row + 1 : count] @ weights[row + 1 :]) / triangle[row, row]
    change = np.einsum("i,ij->j", weights.astype(np.float32), ways[:count])
    return count, abs(float(turned[count])), change
