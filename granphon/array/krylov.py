"""Krylov methods for the linear equations of an array of balls, C^T K C u = f: conjugate gradients,
and GMRES.

Conjugate gradients solve symmetric systems. GMRES, the method of minimal residuals (Y. Saad and M.
H. Schultz, SIAM J. Sci. Stat. Comput. 7, 856 (1986)), solves those that are not, preconditioned
from the right. Steps of Newton's method need few digits and few iterations: vectors of GMRES are in
single precision, and an iteration costs little beside its product.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any

import numpy as np
from numpy.typing import NDArray

from granphon.array.stencils import dot
from granphon.base.arrays import Array

Values = NDArray[Any]
Single = NDArray[Any]
Map = Callable[[Values], Values]
#: number of elements of vectors that are worked on at a time, so that they stay in the processor's
#: cache
_CACHED = 2**15
#: vectors that GMRES keeps, after which it starts again
KEPT = 60
#: elements of a matrix below which OpenBLAS multiplies it by a vector in one thread: threads wait
#: for each other, and their number changes the last digit
_ONE_THREAD = 9216
#: length of the parts of vectors in such products, at most
_LONGEST = 1024
#: part of a vector's length that is left by the projection on those before it, below which it is
#: projected once more
_CANCELLED = 0.1
#: part of it that is nothing but rounding: the vector then lies among those before it
_ROUNDING = float(np.finfo(np.float32).eps)


def conjugate_gradients(
    apply: Map, precondition: Map, right: Values, reduction: float, most: int
) -> tuple[Values, int]:
    """Solve a symmetric system by conjugate gradients until the error in its norm has fallen by
    ``reduction``; return the solution and the number of iterations.

    Vectors have the precision of ``right``. Where a curvature is not above zero the solution is
    that before.
    """
    solution = np.zeros_like(right)
    remaining = right.copy()
    aim = math.inf
    product = 0.0
    way = np.zeros_like(right)
    for count in range(most + 1):
        better = precondition(remaining)
        last = product
        product = dot(remaining, better)
        if not count:
            aim = reduction**2 * product
        if product <= aim:
            return solution, count
        if count == most:
            break
        _add(way, 1.0, better, product / last if count else 0.0)
        change = apply(way)
        curvature = dot(way, change)
        if curvature <= 0.0:
            return solution, count
        length = product / curvature
        _add(solution, length, way)
        _add(remaining, -length, change)
    return solution, most


def _add(vector: Values, factor: float, other: Values, own: float = 1.0) -> None:
    """Multiply a vector by its ``own`` factor, and add another times a ``factor`` to it."""
    one = vector.reshape(-1)
    two = other.reshape(-1)
    for low in range(0, one.size, _CACHED):
        part = one[low : low + _CACHED]
        more = two[low : low + _CACHED]
        if own != 1.0:
            np.multiply(part, own, out=part)
        np.add(part, more if factor == 1.0 else factor * more, out=part)


def solve_by_minimal_residuals(
    apply: Map, precondition: Map, right: Array, reduction: float, most: int
) -> tuple[Array, int]:
    """Return x with |A x - right| <= ``reduction`` |right|, and the number of iterations, ``most``
    of them at most.

    A and the preconditioner take and return flat arrays in single precision. Of a part of ``right``
    that A cannot reach nothing is found.
    """
    size = math.sqrt(dot(right, right))
    taken = 0
    found = np.zeros_like(right)
    if not size:
        return found, 0
    rest = (right / size).astype(np.float32)
    left = 1.0
    while left > reduction and taken < most:
        count, left, change = _cycle(apply, precondition, rest, reduction, min(KEPT, most - taken))
        if not count:  # what is left is out of reach of A
            break
        found += change
        taken += count
        if left > reduction:
            rest = rest - apply(change)
    return size * found, taken


def _cycle(
    apply: Map, precondition: Map, rest: Single, reduction: float, kept: int
) -> tuple[int, float, Single]:
    """Return the number of iterations of one cycle, the norm of the residual and the change of the
    solution.
    """
    first = math.sqrt(dot(rest, rest))
    size = rest.size
    basis, ways = np.empty((2, kept + 1, -(-size // _LONGEST) * _LONGEST), np.float32)
    basis[0, :size] = rest / np.float32(first)
    basis[0, size:] = 0.0
    ways[:, size:] = 0.0
    triangle: list[list[float]] = []
    turns: list[tuple[float, float]] = []
    turned = [first]
    for column in range(kept):
        ways[column, :size] = precondition(basis[column, :size])
        new = basis[column + 1]
        old = basis[: column + 1]
        new[:size] = apply(ways[column, :size])
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
    blocks = _divide(old)
    parts = np.sum(blocks @ new.reshape(len(blocks), -1, 1), axis=0)[:, 0]
    new -= _combine(parts, old)
    return parts.tolist(), math.sqrt(dot(new, new))


def _combine(weights: Single, vectors: Single) -> Single:
    """Return the sum of vectors (n, size) times their weights."""
    if len(vectors) == 1:  # BLAS is slow with a single one
        return np.asarray(weights[0] * vectors[0])
    return np.ravel(weights @ _divide(vectors))


def _divide(vectors: Single) -> Single:
    """Return a view (parts, n, length) of vectors (n, size), in which each part is small enough for
    one thread.
    """
    length = _LONGEST
    while len(vectors) * length >= _ONE_THREAD:
        length //= 2
    return vectors.reshape(len(vectors), vectors.shape[1] // length, length).swapaxes(0, 1)
