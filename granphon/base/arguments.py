"""Checks of the arguments of Python calls: the rules of :mod:`granphon.base.validation`, with the name of the argument.

Each check takes the name of an argument, its value and the options of its rule. It returns the value as a plain number,
array or tuple, or raises :class:`~granphon.base.errors.InputError`.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, Concatenate, ParamSpec, TypeVar

from granphon.base import validation
from granphon.base.validation import require

Value = TypeVar("Value")
Options = ParamSpec("Options")


def _named(rule: Callable[Concatenate[Any, Options], Value]) -> Callable[Concatenate[str, Any, Options], Value]:
    """A rule as a check that takes the name of the argument before its value."""

    def check(name: str, value: Any, /, *options: Options.args, **more: Options.kwargs) -> Value:
        found: Value = require(name, lambda given: rule(given, *options, **more), value)
        return found

    return check


#: an array of floats of any shape, finite or not; an array of floats is returned without a copy
real_array = _named(validation.real_numbers)
#: an array of one or more finite numbers in an SI unit
finite_array = _named(validation.finite_numbers)
#: one number or a list of them, as plain floats
real_list = _named(validation.number_list)
#: one finite number or a list of them, as plain floats
finite_list = _named(validation.finite_number_list)
#: a finite real number above zero
positive = _named(validation.above_zero)
#: a finite real number, zero or above
not_negative = _named(validation.zero_or_above)
#: a whole number in a range
whole_number = _named(validation.whole)
#: a whole number for each period
grid_numbers = _named(validation.grid)
#: one text, or a list or array of texts, as a tuple
texts = _named(validation.text_list)
