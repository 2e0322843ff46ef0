"""Derivatives of explicit functions by differences of the fourth order."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, Generic, NamedTuple, TypeVar

#: what follows a parameter
T = TypeVar("T")

#: steps, and weights of the values there: the error goes as the fourth power of the step
_WEIGHTS = ((1.0, 8.0 / 12.0), (-1.0, -8.0 / 12.0), (2.0, -1.0 / 12.0), (-2.0, 1.0 / 12.0))
#: number of values of which a derivative is made
N_VALUES = len(_WEIGHTS)


def differentiate(find: Callable[[float], Any], step: float) -> Any:
    """Return the derivative of ``find`` at 0, from its values at two steps to either side.

    ``find`` returns a number or an array; the derivative has its shape.
    """
    total: Any = 0.0
    for count, weight in _WEIGHTS:
        total = total + weight * find(count * step)
    return total / step


class Course(NamedTuple, Generic[T]):
    """What follows a parameter, to first order.

    Attributes
    ----------
    at : function of a relative step of the parameter, which returns what is there.
    step : the step of differences along the course.
    """

    at: Callable[[float], T]
    step: float

    def differentiate(self, find: Callable[[T], Any]) -> Any:
        """Return the derivative, by the step, of what ``find`` returns along the course."""
        return differentiate(lambda step: find(self.at(step)), self.step)
