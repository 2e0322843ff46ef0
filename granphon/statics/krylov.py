"""Conjugate gradients for one right side."""

from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np

from granphon.base.arrays import Array

Map = Callable[[Array], Array]


def conjugate_gradients(
    apply: Map, precondition: Map, right: Array, reduction: float, floor: float, most: int
) -> tuple[Array, bool]:
    """Return x with |A x - right| <= ``reduction`` |right|, and whether ``most`` iterations reach
    it; otherwise x is that of the last iteration.

    ``apply`` multiplies by A, and ``precondition`` by an approximate inverse of A; both are
    symmetric and positive definite. The residual A x - right is not lowered below a norm of
    ``floor``, which is rounding. Where A has no curvature above zero along a direction of the
    search, what is left is rounding or costs nothing, and counts as reached.
    """
    solution = np.zeros_like(right)
    residual = right.copy()
    aim = max(reduction * float(np.linalg.norm(right)), floor)
    search = np.zeros_like(right)
    product = math.inf
    for count in range(most + 1):
        if float(np.linalg.norm(residual)) <= aim:
            return solution, True
        if count == most:
            break
        better = precondition(residual)
        last = product
        product = float(residual @ better)
        search *= product / last
        search += better
        change = apply(search)
        curvature = float(search @ change)
        if curvature <= 0.0:  # rounding, or a motion that costs nothing
            return solution, True
        length = product / curvature
        solution += length * search
        residual -= length * change
    return solution, False
