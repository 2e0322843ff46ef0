"""The length of a step of Newton's method down a convex energy."""

from __future__ import annotations

import math
from collections.abc import Callable

#: part of the slope at first that may be left at the end
_SLOPE = 0.1
#: lengths that are tried, at most
_TRIALS = 30


def find_length(
    measure: Callable[[float], tuple[float, Callable[[], float]]], first: float
) -> float:
    """Return the length of a step at which the slope of the energy has at most a tenth of its
    ``first`` size.

    ``measure`` returns the slope at a length, below zero at first, and what finds its derivative.
    Lengths are tried by Newton's method in one dimension, within brackets.
    """
    low = 0.0
    high = math.inf
    length = 1.0
    for _ in range(_TRIALS):
        slope, find_rise = measure(length)
        if abs(slope) <= _SLOPE * abs(first):
            break
        low, high = (length, high) if slope < 0.0 else (low, length)
        rise = find_rise()
        length = length - slope / rise if rise > 0.0 else math.inf
        if not low < length < high:
            length = 0.5 * (low + high) if high < math.inf else 2.0 * low
        length = min(length, 4.0 * low) if high == math.inf else length
    return length
