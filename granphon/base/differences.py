"""Derivatives of explicit functions by differences of the fourth order."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, Generic, NamedTuple, TypeVar

#: the kind of object that changes with a parameter
T = TypeVar("T")

#: pairs of a number of steps and the weight of the value there: with these four the error of a
#: derivative goes as the fourth power of the step
_WEIGHTS = ((1.0, 8.0 / 12.0), (-1.0, -8.0 / 12.0), (2.0, -1.0 / 12.0), (-2.0, 1.0 / 12.0))
#: number of values of which a derivative is made
N_VALUES = len(_WEIGHTS)


def differentiate(find: Callable[[float], Any], step: float) -> Any:
    """Return the derivative at 0 of the function ``find``, estimated from its values at -2, -1, 1
    and 2 times the ``step``, which is not zero.

    ``find`` returns a number or an array, and the derivative has the same shape.
    """
    total: Any = 0.0
    for count, weight in _WEIGHTS:
        total = total + weight * find(count * step)
    return total / step


class Course(NamedTuple, Generic[T]):
    """An object, such as a state, as a function of a relative change of one parameter.

    Attributes
    ----------
    at : function that takes the relative change of the parameter (0.01 is one per cent) and returns
        the changed object.
    step : the relative change by which differences are taken.
    """

    at: Callable[[float], T]
    step: float

    def differentiate(self, find: Callable[[T], Any]) -> Any:
        """Return the derivative, by the relative change of the parameter and at no change, of the
        number or array that ``find`` returns for an object.
        """
        return differentiate(lambda change: find(self.at(change)), self.step)
