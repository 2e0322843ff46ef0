"""Checks of the arguments of Python calls: the rules of :mod:`granphon.base.validation`, with the name of the argument.

Each check returns the value as a plain number, array or tuple, or raises :class:`~granphon.base.errors.InputError`.
"""

from __future__ import annotations

from collections.abc import Sequence
from functools import partial
from typing import Any

import numpy as np
from numpy.typing import NDArray

from granphon.base import validation
from granphon.base.validation import require


def real_array(name: str, values: Any) -> NDArray[np.float64]:
    """``values`` as an array of floats of any shape, finite or not; an array of floats is returned without a copy."""
    if type(values) is np.ndarray and values.dtype == np.float64:
        return values
    if type(values) is float or type(values) is np.float64:
        return np.asarray(values)
    found: NDArray[np.float64] = require(name, validation.real_numbers, values)
    return found


def finite_array(name: str, values: Any, unit: str = "", low: str = "") -> NDArray[np.float64]:
    """``values`` as an array of floats: one or more finite numbers in the SI ``unit``.

    ``low`` is "above zero", "zero or above", or empty for numbers of any sign.
    """
    found: NDArray[np.float64] = require(name, partial(validation.finite_numbers, unit=unit, low=low), values)
    return found


def finite_list(name: str, values: Any, unit: str = "", low: str = "") -> tuple[float, ...]:
    """One finite number or a list of them, as plain floats; see :func:`finite_array`."""
    return real_list(name, finite_array(name, values, unit, low))


def real_list(name: str, given: Any) -> tuple[float, ...]:
    """One number or a list of them, as plain floats."""
    found: tuple[float, ...] = require(name, validation.number_list, given)
    return found


def positive(name: str, value: float, unit: str = "") -> float:
    """``value`` as a float: a finite real number above zero."""
    if type(value) is float and 0.0 < value < np.inf:
        return value
    return float(require(name, partial(validation.above_zero, unit=unit), value))


def not_negative(name: str, value: float, unit: str = "") -> float:
    """``value`` as a float: a finite real number, zero or above."""
    if type(value) is float and 0.0 <= value < np.inf:
        return value
    return float(require(name, partial(validation.zero_or_above, unit=unit), value))


def whole_number(name: str, value: Any, low: int, high: int | None = None) -> int:
    """``value`` as an int: a whole number from ``low`` to ``high``, without an upper limit if ``high`` is None."""
    return int(require(name, partial(validation.whole, low=low, high=high), value))


def grid_numbers(name: str, values: Any, high: int, example: str, periods: int = 2) -> tuple[int, ...]:
    """A whole number from 1 to ``high`` for each period; ones may follow them up to the length of the ``example``."""
    rule = partial(validation.grid, low=1, high=high, example=example, periods=periods)
    found: tuple[int, ...] = require(name, rule, values)
    return found


def texts(name: str, given: str | Sequence[str] | NDArray[Any]) -> tuple[str, ...]:
    """One text, or a list or array of texts, as a tuple."""
    found: tuple[str, ...] = require(name, validation.text_list, given)
    return found
