"""GMRES, the method of minimal residuals (Y. Saad and M. H. Schultz, SIAM J. Sci. Stat. Comput. 7,
856 (1986)), for the linear equations of an array of balls that are not symmetric, preconditioned
from the right.

Steps of Newton's method need few digits and few iterations: vectors are in single precision, and an
iteration costs little beside its product. They are projected on each other in compiled loops:
threads of BLAS would wait for each other, and their number changes the last digit.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any

import numpy as np
from numpy.typing import NDArray

from granphon.array.stencils import dot
from granphon.base.arrays import Array
from granphon.base.compiled import compiled

Single = NDArray[Any]
#: sets the second array to what it makes of the first
Map = Callable[[Single, Single], None]
#: vectors that are kept, after which the method starts again
_KEPT = 60
#: elements of vectors that are multiplied at a time: a power of two
_LENGTH = 1024
#: part of a vector's length that is left by the projection on those before it, below which it is
#: projected once more
_CANCELLED = 0.1
#: part of it that is nothing but rounding: the vector then lies among those before it
_ROUNDING = float(np.finfo(np.float32).eps)


def solve_by_minimal_residuals(
    apply: Map, precondition: Map, right: Array, reduction: float, most: int
) -> tuple[Array, int]:
    """Return x with |A x - right| <= ``reduction`` |right|, and the number of iterations, ``most``
    of them at most.

    A and the preconditioner set flat arrays in single precision to what they make of others. Of a
    part of ``right`` that A cannot reach nothing is found.
    """
    size = math.sqrt(dot(right, right))
    taken = 0
    found = np.zeros_like(right)
    if not size:
        return found, 0
    rest = (right / size).astype(np.float32)
    left = 1.0
    while left > reduction and taken < most:
        count, left, change = _cycle(apply, precondition, rest, reduction, min(_KEPT, most - taken))
        if not count:  # what is left is out of reach of A
            break
        found += change
        taken += count
        if left > reduction:
            reached = np.empty_like(rest)
            apply(change, reached)
            rest -= reached
    return size * found, taken


def _cycle(
    apply: Map, precondition: Map, rest: Single, reduction: float, kept: int
) -> tuple[int, float, Single]:
    """Return the number of iterations of one cycle, the norm of the residual and the change of the
    solution.
    """
    first = math.sqrt(dot(rest, rest))
    size = rest.size
    basis, ways = np.empty((2, kept + 1, -(-size // _LENGTH) * _LENGTH), np.float32)
    basis[0, :size] = rest / np.float32(first)
    basis[0, size:] = 0.0
    ways[:, size:] = 0.0
    triangle: list[list[float]] = []
    turns: list[tuple[float, float]] = []
    turned = [first]
    for column in range(kept):
        precondition(basis[column, :size], ways[column, :size])
        new = basis[column + 1]
        old = basis[: column + 1]
        apply(ways[column, :size], new[:size])
        new[size:] = 0.0
        line, height = _project(old, new)
        whole = before = math.hypot(*line, height)
        while _ROUNDING * whole < height < _CANCELLED * before:
            # once more, for what rounding has left, where much has gone
            before = height
            parts, height = _project(old, new)
            line = [one + part for one, part in zip(line, parts, strict=True)]
        height = height if height > _ROUNDING * whole else 0.0
        for row, (c, s) in enumerate(turns):
            line[row], line[row + 1] = (
                c * line[row] + s * line[row + 1],
                c * line[row + 1] - s * line[row],
            )
        length = math.hypot(line[column], height)
        if not 0.0 < length < math.inf:
            break
        c = line[column] / length
        s = height / length
        line[column] = length
        triangle.append(line)
        turns.append((c, s))
        turned[column:] = c * turned[column], -s * turned[column]
        if abs(turned[-1]) <= reduction or not height:
            break
        np.divide(new, np.float32(height), out=new)
    count = len(triangle)
    weights = [0.0] * count
    for row in reversed(range(count)):
        known = sum(triangle[column][row] * weights[column] for column in range(row + 1, count))
        weights[row] = (turned[row] - known) / triangle[row][row]
    return count, abs(turned[count]), _combine(np.array(weights, np.float32), ways[:count])[:size]


def _project(old: Single, new: Single) -> tuple[list[float], float]:
    """Take its parts along ``old`` (n, size) off a vector; return these n numbers, and the length
    of what is left.
    """
    parts = np.empty(len(old), np.float32)
    square = _take_off(old, new, parts)
    return parts.tolist(), math.sqrt(square)


@compiled
def _take_off(old: Single, new: Single, parts: Single) -> float:
    """Take its ``parts`` (n,) along ``old`` (n, size) off a vector, and return the square of the
    length of what is left.
    """
    products = np.empty(_LENGTH, np.float32)
    for row in range(len(old)):
        total = 0.0
        for start in range(0, len(new), _LENGTH):
            total += _multiply(
                old[row, start : start + _LENGTH], new[start : start + _LENGTH], products
            )
        parts[row] = total
    square = 0.0
    for start in range(0, len(new), _LENGTH):
        left = new[start : start + _LENGTH]
        for row in range(len(old)):
            part = parts[row]
            along = old[row, start : start + _LENGTH]
            for place in range(_LENGTH):
                left[place] -= part * along[place]
        square += _multiply(left, left, products)
    return square


@compiled
def _multiply(one: Single, another: Single, products: Single) -> float:
    """Return the sum of the products of two vectors; ``products`` are overwritten."""
    for place in range(_LENGTH):
        products[place] = one[place] * another[place]
    # sums of pairs, of pairs of pairs, ...: several at a time, and with little rounding
    half = _LENGTH // 2
    while half:
        for place in range(half):
            products[place] += products[half + place]
        half //= 2
    return float(products[0])


@compiled
def _combine(weights: Single, vectors: Single) -> Single:
    """Return the sum of vectors (n, size) times their weights."""
    total = np.zeros(vectors.shape[1], np.float32)
    for row in range(len(vectors)):
        weight = weights[row]
        vector = vectors[row]
        for place in range(len(total)):
            total[place] += weight * vector[place]
    return total
