"""GMRES, the method of minimal residuals (Y. Saad and M. H. Schultz, SIAM J. Sci. Stat. Comput. 7,
856 (1986)), for the linear equations of an array of balls that are not symmetric, preconditioned
from the right.

Steps of Newton's method need few digits and few iterations: vectors are in single precision, and an
iteration takes little time beside the product with the matrix. Vectors are projected on each other
in compiled loops: threads of BLAS would wait for each other, and their number changes the last
digit.
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
from granphon.statics.options import ResponseOptions

Single = NDArray[Any]
#: function that sets its second array to a linear function of the first
Map = Callable[[Single, Single], None]
#: number of elements of vectors that are multiplied at a time: a power of two
_LENGTH = 1024
#: a vector is projected once more if the subtraction of its parts along the vectors before leaves
#: less than this part of its length: one of the seven digits is then lost
_CANCELLATION = 0.1
#: part of the length of a vector that is nothing but rounding: if no more is left, the vector lies
#: in the space of those before it
_ROUNDING = float(np.finfo(np.float32).eps)


def solve_by_minimal_residuals(
    apply: Map, precondition: Map, right: Array, reduction: float, most_iterations: int
) -> tuple[Array, int]:
    """Return x (size,) with |A x - right| <= ``reduction`` |right|, and the number of iterations,
    at most ``most_iterations``. The norm is that of GMRES, which may miss the last of the seven
    digits.

    ``apply`` and ``precondition`` set their second array to the product of A, or of the
    preconditioner, with the first; both arrays are (size,), in single precision. If ``right``
    (size,) is zero, x is zero, and the number of iterations too. The tolerance is not reached if
    ``most_iterations`` are not enough; or if ``right`` has a part that no product with A contains,
    or a product is not finite: then the iteration ends early, and a change of x that would leave
    more than before is not made.
    """
    right_norm = math.sqrt(dot(right, right))
    iterations = 0
    solution = np.zeros_like(right)
    if not right_norm:
        return solution, 0
    residual: Single = (right / right_norm).astype(np.float32)
    norm = 1.0
    while norm > reduction and iterations < most_iterations:
        length = min(ResponseOptions().vectors, most_iterations - iterations)
        count, norm, change = _cycle(apply, precondition, residual, reduction, length)
        iterations += count
        if norm > reduction:
            product = np.empty_like(residual)
            apply(change, product)
            last_residual = residual
            residual = last_residual - product
            # if no product with A contains what is left, the change is nothing, or only rounding
            if not dot(residual, residual) < dot(last_residual, last_residual):
                break
        solution += change
    return right_norm * solution, iterations


def _cycle(
    apply: Map, precondition: Map, residual: Single, reduction: float, length: int
) -> tuple[int, float, Single]:
    """Return the number of iterations of one cycle, at most ``length``, the norm of the residual
    after the cycle, and the change of the solution (size,).

    The cycle ends early once the norm is ``reduction`` or less, or if a further product lies in the
    space of those before it, or is not finite. The ``residual`` (size,) at the start must not be
    zero.

    Arnoldi's relation is A W = V H, with the preconditioned vectors W, the orthonormal basis V of
    Krylov space, and H, whose entries below the first subdiagonal are zero. Givens rotations make H
    triangular, column by column, and turn the right side along with it: the magnitude of the last
    number of the turned right side is the norm of the residual.
    """
    norm = math.sqrt(dot(residual, residual))
    size = residual.size
    padded = -(-size // _LENGTH) * _LENGTH  # a whole number of pieces for the compiled loops
    basis, directions = np.empty((2, length + 1, padded), np.float32)
    basis[0, :size] = residual / np.float32(norm)
    basis[0, size:] = 0.0
    directions[:, size:] = 0.0
    triangle: list[list[float]] = []
    rotations: list[tuple[float, float]] = []
    turned_right = [norm]
    for column in range(length):
        precondition(basis[column, :size], directions[column, :size])
        vector = basis[column + 1]
        apply(directions[column, :size], vector[:size])
        vector[size:] = 0.0
        entries, height = _make_orthogonal(basis[: column + 1], vector)
        product_length = math.hypot(*entries, height)
        _rotate(entries, rotations)
        diagonal = math.hypot(entries[column], height)
        # the product adds nothing but rounding to the products before, or is not finite
        if not _ROUNDING * product_length < diagonal < math.inf:
            break
        c = entries[column] / diagonal
        s = height / diagonal
        entries[column] = diagonal
        triangle.append(entries)
        rotations.append((c, s))
        turned_right[column:] = c * turned_right[column], -s * turned_right[column]
        if abs(turned_right[-1]) <= reduction or not height:
            break
        np.divide(vector, np.float32(height), out=vector)
    count = len(triangle)
    weights = np.array(_solve_triangle(triangle, turned_right), np.float32)
    return count, abs(turned_right[count]), _combine(weights, directions[:count])[:size]


def _rotate(entries: list[float], rotations: list[tuple[float, float]]) -> None:
    """Turn the ``entries`` of a column, in place, by Givens rotations: each turns two entries, the
    first rotation the first two, and is given by the cosine and the sine of its angle.
    """
    for row, (c, s) in enumerate(rotations):
        upper = entries[row]
        lower = entries[row + 1]
        entries[row] = c * upper + s * lower
        entries[row + 1] = c * lower - s * upper


def _make_orthogonal(basis: Single, vector: Single) -> tuple[list[float], float]:
    """Subtract from a ``vector`` (size,), in place, its parts along the orthonormal ``basis`` (n,
    size). Return the list of the n parts, and the length of what remains: zero if only rounding
    remains. The size is a multiple of :data:`_LENGTH`.
    """
    parts, length = _project(basis, vector)
    whole_length = math.hypot(*parts, length)
    last_length = whole_length
    # if little remains, rounding has left parts along the basis, which are subtracted once more
    while _ROUNDING * whole_length < length < _CANCELLATION * last_length:
        last_length = length
        more_parts, length = _project(basis, vector)
        parts = [part + more_part for part, more_part in zip(parts, more_parts, strict=True)]
    return parts, length if length > _ROUNDING * whole_length else 0.0


def _solve_triangle(columns: list[list[float]], right: list[float]) -> list[float]:
    """Return the solution (n,) of n equations whose matrix is an upper triangle, given by its
    ``columns``, for the first n numbers of a ``right`` side.
    """
    count = len(columns)
    solution = [0.0] * count
    for row in reversed(range(count)):
        later = range(row + 1, count)
        later_sum = sum(columns[column][row] * solution[column] for column in later)
        solution[row] = (right[row] - later_sum) / columns[row][row]
    return solution


def _project(basis: Single, vector: Single) -> tuple[list[float], float]:
    """Subtract once from a ``vector`` (size,), in place, its parts along the orthonormal ``basis``
    (n, size). Return the list of the n parts, and the length of what remains.
    """
    parts = np.empty(len(basis), np.float32)
    square = _subtract_parts(basis, vector, parts)
    return parts.tolist(), math.sqrt(square)


@compiled
def _subtract_parts(basis: Single, vector: Single, parts: Single) -> float:
    """Subtract from a ``vector`` (size,), in place, its parts along the orthonormal ``basis`` (n,
    size). Set ``parts`` (n,) to them, and return the square of the length of what remains.
    """
    products = np.empty(_LENGTH, np.float32)
    for row in range(len(basis)):
        total = 0.0
        for start in range(0, len(vector), _LENGTH):
            total += _multiply(
                basis[row, start : start + _LENGTH], vector[start : start + _LENGTH], products
            )
        parts[row] = total
    square = 0.0
    for start in range(0, len(vector), _LENGTH):
        piece = vector[start : start + _LENGTH]
        for row in range(len(basis)):
            part = parts[row]
            along = basis[row, start : start + _LENGTH]
            for place in range(_LENGTH):
                piece[place] -= part * along[place]
        square += _multiply(piece, piece, products)
    return square


@compiled
def _multiply(first: Single, second: Single, products: Single) -> float:
    """Return the scalar product of two vectors of :data:`_LENGTH` elements; ``products``, as long,
    are overwritten.
    """
    for place in range(_LENGTH):
        products[place] = first[place] * second[place]
    # the upper half is added to the lower one until one element is left: the compiler adds several
    # elements at a time, and rounding stays small
    half = _LENGTH // 2
    while half:
        for place in range(half):
            products[place] += products[half + place]
        half //= 2
    return float(products[0])


@compiled
def _combine(weights: Single, vectors: Single) -> Single:
    """Return the sum (size,) of ``vectors`` (n, size) times their ``weights`` (n,)."""
    total = np.zeros(vectors.shape[1], np.float32)
    for row in range(len(vectors)):
        weight = weights[row]
        vector = vectors[row]
        for place in range(len(total)):
            total[place] += weight * vector[place]
    return total
