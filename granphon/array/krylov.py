"""Conjugate gradients for the symmetric linear equations of an array of balls, C^T K C u = f.

Those that are not symmetric are solved by :mod:`granphon.array.minimal_residuals`.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any

import numpy as np
from numpy.typing import NDArray

from granphon.array.stencils import CACHED, dot

Values = NDArray[Any]
Single = NDArray[Any]
Map = Callable[[Values], Values]


def conjugate_gradients(
    apply: Map, precondition: Map, right: Values, reduction: float, most_iterations: int
) -> tuple[Values, int]:
    """Solve a symmetric positive system A x = ``right`` by conjugate gradients; return the solution
    and the number of iterations.

    ``apply`` multiplies a vector by A, and ``precondition`` by an approximate inverse of A. The
    iteration ends when the error in the norm of the energy, which the preconditioner estimates, is
    ``reduction`` times that of zero, or after ``most_iterations``. It also ends at a direction with
    no curvature above zero, with the solution found until then. Vectors have the precision of
    ``right``.
    """
    solution = np.zeros_like(right)
    remaining = right.copy()
    aim = math.inf
    product = 0.0
    direction = np.zeros_like(right)
    for count in range(most_iterations + 1):
        preconditioned = precondition(remaining)
        last = product
        product = dot(remaining, preconditioned)
        if not count:
            aim = reduction**2 * product
        if product <= aim:
            return solution, count
        if count == most_iterations:
            break
        _add(direction, 1.0, preconditioned, product / last if count else 0.0)
        change = apply(direction)
        curvature = dot(direction, change)
        if curvature <= 0.0:
            return solution, count
        length = product / curvature
        _add(solution, length, direction)
        _add(remaining, -length, change)
    return solution, most_iterations


def _add(vector: Values, factor: float, addend: Values, scale: float = 1.0) -> None:
    """Multiply a ``vector`` by the ``scale`` and add ``factor`` times the ``addend`` to it, in
    place, in pieces that stay in the processor's cache.
    """
    flat = vector.reshape(-1)
    flat_addend = addend.reshape(-1)
    for low in range(0, flat.size, CACHED):
        block = flat[low : low + CACHED]
        added = flat_addend[low : low + CACHED]
        if scale != 1.0:
            np.multiply(block, scale, out=block)
        np.add(block, added if factor == 1.0 else factor * added, out=block)
