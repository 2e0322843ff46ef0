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
    """Solve a symmetric system by conjugate gradients until the error in its norm has fallen by
    ``reduction``; return the solution and the number of iterations.

    Vectors have the precision of ``right``. Where a curvature is not above zero the solution is
    that before.
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
    """Multiply a vector by the ``scale``, and add ``factor`` times the ``addend`` to it."""
    flat = vector.reshape(-1)
    flat_addend = addend.reshape(-1)
    for low in range(0, flat.size, CACHED):
        block = flat[low : low + CACHED]
        added = flat_addend[low : low + CACHED]
        if scale != 1.0:
            np.multiply(block, scale, out=block)
        np.add(block, added if factor == 1.0 else factor * added, out=block)
