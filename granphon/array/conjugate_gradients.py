"""The method of conjugate gradients for the linear equations of an array of balls, C^T K C u = f."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
from numpy.typing import NDArray

from granphon.array.stencils import Motion, Stencils, dot

Array = NDArray[np.float64]
#: largest number of steps in one step of Newton's method
_CONJUGATE_STEPS = 3000


def solve_by_conjugate_gradients(
    stencils: Stencils,
    stiffness: Array,
    force: Motion,
    precondition: Callable[[Array], Array],
    reduction: float,
    free: bool = False,
    springs: Array | None = None,
) -> tuple[Motion, int]:
    """Solve C^T K C u = ``force``, and return u with the number of steps taken.

    The iteration ends when the error in the energy norm has fallen by about ``reduction``, or at its largest number of
    steps, from where Newton's method goes on. If ``free`` is true, the compression is an unknown too. ``springs`` is the
    stiffness in rooms with margins of zeros, if that is at hand.
    """
    contacts = stencils.n_contacts * stiffness[0].size
    held = 1.0 / (contacts * float(np.mean(stiffness[: stencils.n_contacts]))) if free else 0.0
    left, press = force.balls.astype(stiffness.dtype), force.compression
    balls, compression = np.zeros_like(left), 0.0
    way, out = stencils.padded(left.dtype), stencils.padded(left.dtype)
    inner, springs = way[stencils.rooms.inner], stencils.rooms.fill(stiffness) if springs is None else springs
    better = precondition(left)
    product = first = dot(left, better) + held * press * press
    inner[...] = better
    squeeze, count = held * press, 0
    while product > reduction**2 * first and count < _CONJUGATE_STEPS:
        stencils.rooms.wrap(way)
        change, pull, energy = stencils.product(springs, way, squeeze if free else None, out)
        if energy <= 0.0:  # nothing but rounding is left
            break
        length = product / energy
        for rows in stencils.blocks(stencils.n_fields):
            balls[:, rows] += length * inner[:, rows]
            left[:, rows] -= length * change[:, rows]
        if free:
            compression += length * squeeze
            press += length * pull
        better = precondition(left)
        last, product = product, dot(left, better) + held * press * press
        turn = product / last
        for rows in stencils.blocks(stencils.n_fields):
            inner[:, rows] = turn * inner[:, rows] + better[:, rows]
        squeeze = turn * squeeze + held * press
        count += 1
    return Motion(balls, compression), count


def solve_by_descent(
    apply: Callable[[NDArray[Any]], NDArray[Any]],
    precondition: Callable[[NDArray[Any]], NDArray[Any]],
    right: NDArray[Any],
    reduction: float,
    most: int,
    floor: float = 0.0,
) -> tuple[NDArray[Any], int, bool]:
    """Solve a symmetric system by conjugate gradients until the error in its norm has fallen by ``reduction``.

    Vectors have the precision of ``right``. Returns the solution, the number of steps, and whether all curvatures met were
    above zero: if not, the solution is that before the first that was not. ``floor`` is the square of the norm below which
    the rest is rounding.
    """
    found, left = np.zeros_like(right), right.copy()
    better = precondition(left)
    way, product = better, dot(left, better)
    first = product
    for count in range(most):
        if product <= max(reduction**2 * first, floor):
            return found, count, True
        change = apply(way)
        curvature = dot(way, change)
        if curvature <= 0.0:
            return found, count, False
        length = product / curvature
        found += length * way
        left -= length * change
        better = precondition(left)
        last, product = product, dot(left, better)
        way = better + (product / last) * way
    return found, most, True
