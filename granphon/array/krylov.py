"""Conjugate gradients for the symmetric linear equations of an array of balls, C^T K C u = f.

Those that are not symmetric are solved by :mod:`granphon.array.minimal_residuals`.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any

import numpy as np
from numpy.typing import NDArray

from granphon.array.contact_operator import ContactHessian
from granphon.array.stencils import Motion, dot

Values = NDArray[Any]
Single = NDArray[Any]
Map = Callable[[Values], Values]
#: largest number of iterations in one step of Newton's method
MOST_ITERATIONS = 3000
#: number of elements of vectors that are worked on at a time, so that they stay in the processor's
#: cache
_CACHED = 2**15


def conjugate_gradients(
    apply: Map,
    precondition: Map,
    right: Values,
    reduction: float,
    most: int,
    floor: float = 0.0,
    of_residual: bool = False,
) -> tuple[Values, int, bool]:
    """Solve a symmetric system by conjugate gradients until the error in its norm has fallen by
    ``reduction``.

    If ``of_residual`` is true, it is the norm of the residual that has to fall, which saves the
    last use of the preconditioner. Vectors have the precision of ``right``. Returns the solution,
    the number of iterations, and whether all curvatures met were above zero: if not, the solution
    is that before the first that was not. ``floor`` is the square of the norm below which the rest
    is rounding.
    """
    found = np.zeros_like(right)
    left = right.copy()
    aim = reduction**2 * dot(right, right) if of_residual else math.inf
    product = 0.0
    way = np.zeros_like(right)
    for count in range(most + 1):
        if of_residual and dot(left, left) <= max(aim, floor):
            return found, count, True
        better = precondition(left)
        last = product
        product = dot(left, better)
        if not of_residual:
            aim = reduction**2 * product if aim == math.inf else aim
            if product <= max(aim, floor):
                return found, count, True
        if count == most:
            break
        _add(way, 1.0, better, product / last if count else 0.0)
        change = apply(way)
        curvature = dot(way, change)
        if curvature <= 0.0:
            return found, count, False
        length = product / curvature
        _add(found, length, way)
        _add(left, -length, change)
    return found, most, True


def solve_for_motion(
    product: ContactHessian,
    force: Motion,
    precondition: Map,
    reduction: float,
    stiffness: float | None,
) -> tuple[Motion, int]:
    """Solve C^T K C u = ``force`` until the residual has fallen by ``reduction``; return the motion
    and the number of iterations.

    Where the iteration ends at its largest number, Newton's method goes on from there.
    With a ``stiffness``, the mean of those of all contacts, the compression is an unknown too.
    """
    shape = force.balls.shape
    size = force.balls.size
    if stiffness is None:
        balls, count, _ = conjugate_gradients(
            lambda balls: product(balls)[0],
            precondition,
            force.balls,
            reduction,
            MOST_ITERATIONS,
            of_residual=True,
        )
        return Motion(balls, 0.0), count

    # over which what the contacts lack in sum is as large as forces on balls
    root = math.sqrt(product.n_contacts)

    def join(balls: Values, press: float) -> Values:
        out = np.empty(size + 1, balls.dtype)
        out[:size], out[size] = balls.ravel(), press
        return out

    def apply(vector: Values) -> Values:
        change, push = product(vector[:size].reshape(shape), float(vector[size]) / root)
        return join(change, push / root)

    def invert(vector: Values) -> Values:
        return join(precondition(vector[:size].reshape(shape)), float(vector[size]) / stiffness)

    right = join(force.balls, force.compression / root)
    found, count, _ = conjugate_gradients(
        apply, invert, right, reduction, MOST_ITERATIONS, of_residual=True
    )
    return Motion(found[:size].reshape(shape), float(found[size]) / root), count


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
