"""Conjugate gradients for one right side."""

from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np

from granphon.base.arrays import Array

#: a linear function of vectors, such as a product with a matrix or its inverse
Map = Callable[[Array], Array]


def conjugate_gradients(
    apply: Map, precondition: Map, right: Array, reduction: float, floor: float, most: int
) -> tuple[Array, bool]:
    """Return x (size,) with |right - A x| <= ``reduction`` |right|, and whether ``most`` iterations
    find such an x; otherwise x is that of the last iteration.

    ``apply`` multiplies by A, and ``precondition`` by an approximate inverse of A; both are
    symmetric and positive definite, but for motions that cost nothing. The residual right - A x is
    not lowered below a norm of ``floor``, which is rounding. Where A has no curvature above zero
    along a direction of the search, the residual that is left is rounding, or along a motion that
    costs nothing, and x counts as found.
    """
    solution = np.zeros_like(right)
    residual = right.copy()
    aim = max(reduction * float(np.linalg.norm(right)), floor)
    search = np.zeros_like(right)
    product = math.inf  # so that the first direction is the preconditioned residual
    for count in range(most + 1):
        if float(np.linalg.norm(residual)) <= aim:
            return solution, True
        if count == most:
            break
        preconditioned = precondition(residual)
        last_product = product
        product = float(residual @ preconditioned)
        search *= product / last_product
        search += preconditioned
        change = apply(search)
        curvature = float(search @ change)
        if curvature <= 0.0:  # rounding, or a motion that costs nothing
            return solution, True
        length = product / curvature
        solution += length * search
        residual -= length * change
    return solution, False
