"""The length of a step of Newton's method down an energy: where the slope along the step is small.

Slopes are works of forces. They tell near rest too, where differences of energies are rounding.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Protocol, TypeVar

P = TypeVar("P")


class Way(Protocol[P]):
    """The places along a step, from its start at a length of 0 to its end at 1, and beyond."""

    @property
    def fall(self) -> float:
        """How fast the energy falls at the start, per length."""

    @property
    def longest(self) -> float:
        """The greatest length that may be."""

    def go(self, length: float) -> P:
        """Return the place at a length."""

    def find_slope(self, place: P) -> float:
        """Return the derivative of the energy by the length at a ``place`` of the way; infinite at
        a place that no step may lead to.
        """

    def find_rise(self, place: P) -> float:
        """Return the derivative of the slope by the length at a ``place`` of the way; zero where it
        is not known.
        """


def follow(way: Way[P], part: float, most: int) -> tuple[P, float]:
    """Return the place along a ``way`` at which the energy hardly falls any more, and the length to
    that place; ``part`` and ``most`` are those of :func:`find_length`.
    """
    last: list[P] = []  # the place that has been tried last, alone

    def measure(length: float) -> tuple[float, Callable[[], float]]:
        """Return the slope at a ``length`` and a function that finds the derivative of the slope,
        and keep the place as the last one.
        """
        last.clear()  # so that a large place is freed before the next one is made
        place = way.go(length)
        last.append(place)
        return way.find_slope(place), lambda: way.find_rise(place)

    length = find_length(measure, way.fall, part, most, way.longest)
    return last[0], length


def find_length(
    measure: Callable[[float], tuple[float, Callable[[], float]]],
    first: float,
    part: float,
    most: int,
    longest: float = math.inf,
) -> float:
    """Return the length of a step at which the slope of the energy has at most a ``part`` of its
    ``first`` size, or else the last length that is tried: the ``longest``, if the energy still
    falls there, or that of the trial number ``most`` >= 1.

    ``measure`` returns the slope at a length, below zero at first, and a function that finds the
    derivative of the slope, zero where that is not known. Lengths are tried from 1, or from the
    ``longest`` if that is less, by Newton's method in one dimension, within brackets. As long as
    the energy falls at each trial, a length is at most four times the one before.
    """
    # the slope is below zero at low; it is above zero at high, which is infinite until there is
    # such a length
    low = 0.0
    high = math.inf
    length = min(1.0, longest)
    last_length = length
    for _ in range(most):
        last_length = length
        slope, find_rise = measure(length)
        if abs(slope) <= part * abs(first) or (slope < 0.0 and length >= longest):
            break
        low, high = (length, high) if slope < 0.0 else (low, length)
        rise = find_rise() if math.isfinite(slope) else 0.0
        del find_rise  # it holds the place, and a large place is not kept beside the next one
        length = length - slope / rise if rise > 0.0 else math.inf
        # outside the bracket: halve it, or, while it has no upper end, double the length
        if not low < length < high:
            length = 0.5 * (low + high) if high < math.inf else 2.0 * low
        # where the slope hardly rises, as where few contacts are closed, Newton's method would go
        # much too far: it may go as far as two doublings
        if high == math.inf:
            length = min(length, 4.0 * low, longest)
    return last_length
