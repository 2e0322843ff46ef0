"""What is given in Python where numbers or names are needed, as plain ones; nothing of it is dropped in silence."""

from __future__ import annotations

import math
from collections.abc import Sequence
from decimal import Decimal
from numbers import Real
from typing import Any

import numpy as np
from numpy.typing import NDArray

from granphon.base.errors import InputError, brief, message

__all__ = ["is_whole", "not_negative", "positive", "real_array", "real_number", "texts"]

#: the deepest nesting of lists: NumPy's arrays have no more dimensions
_DEEPEST = 64
_REAL = "It must be a real number or an array of them"


def real_array(name: str, values: Any) -> NDArray[np.float64]:
    """``values`` as an array of floats, of any shape, perhaps not finite; an array of floats is returned as it is.

    :class:`~granphon.base.errors.InputError`, which calls it ``name``, for what NumPy would turn into other numbers than
    were meant: complex numbers, whose imaginary part would be dropped; masked entries, which would become numbers again;
    texts and truth values; numbers too large for a float; lists of different lengths, or that contain themselves.
    """
    if type(values) is np.ndarray and values.dtype == np.float64:
        return values
    if _is_masked(name, values):
        raise _refused(
            name, values, "has masked entries, which are no real numbers", "Leave them out, as .compressed() does"
        )
    try:
        given = np.asarray(values)
    except (TypeError, ValueError):  # lists of different lengths
        raise _refused(name, values, mend=_REAL) from None
    if given.dtype.kind == "O":  # Python's integers of more than 64 bits, fractions, decimals
        if not all(map(_is_real, given.ravel().tolist())):
            raise _refused(name, values, "is complex" if any(map(_is_complex, given.ravel())) else "", _REAL)
        try:
            return given.astype(np.float64)
        except OverflowError:
            raise _refused(name, values, "is too large for double precision") from None
        except ValueError:  # a signalling nan among decimals
            raise _refused(name, values, mend=_REAL) from None
    if given.dtype.kind not in "iuf":
        raise _refused(name, values, "is complex" if given.dtype.kind == "c" else "", _REAL)
    with np.errstate(over="ignore"):
        array = np.asarray(given, np.float64)
    if given.dtype.itemsize > array.dtype.itemsize and np.any(np.isinf(array) & np.isfinite(given)):
        raise _refused(name, values, "is too large for double precision")
    return array


def real_number(value: Any) -> float:
    """``value`` as a float; nan for what is no real number, or too large for a float.

    Real numbers are those of Python and NumPy, fractions and decimals, and arrays of no dimension that hold one. Texts and
    truth values are none, though ``float`` takes them.
    """
    if isinstance(value, np.ndarray) and value.ndim == 0:
        value = value[()]
    if not _is_real(value):
        return math.nan
    try:
        return float(value)
    except (OverflowError, ValueError):  # ValueError: a signalling nan among decimals
        return math.nan


def positive(name: str, value: float, unit: str = "") -> float:
    """``value`` as a float, or :class:`InputError` if it is not a finite real number above zero."""
    number = value if type(value) is float else real_number(value)
    if not 0.0 < number < math.inf:
        where = f" (in {unit})" if unit else ""
        raise InputError(message(f"{name} is {brief(value)}", f"It must be a finite number above zero{where}"))
    return number


def not_negative(name: str, value: float, unit: str = "") -> float:
    """``value`` as a float, or :class:`InputError` if it is not a finite real number, zero or above."""
    number = real_number(value)
    if not 0.0 <= number < math.inf:
        where = f" (in {unit})" if unit else ""
        raise InputError(message(f"{name} is {brief(value)}", f"It must be a finite number, zero or above{where}"))
    return number


def is_whole(value: Any) -> bool:
    """Whether ``value`` is a whole number of Python or NumPy; truth values and spans of time are none."""
    return isinstance(value, int | np.integer) and not isinstance(value, bool | np.timedelta64)


def texts(name: str, given: str | Sequence[str] | NDArray[Any]) -> tuple[str, ...]:
    """One text, or a list or array of texts, as a tuple; :class:`InputError`, which calls it ``name``, for anything else."""
    if isinstance(given, str):
        return (given,)
    plain: Any = given.tolist() if isinstance(given, np.ndarray) else given  # masked entries become None
    if not isinstance(plain, Sequence) or not all(isinstance(one, str) for one in plain):
        raise InputError(message(f"{name} is {brief(given)}", mend="Give a text, or a list of texts"))
    return tuple(plain)


def _is_real(value: Any) -> bool:
    return isinstance(value, Real | Decimal) and not isinstance(value, bool | np.timedelta64)


def _is_masked(name: str, values: Any, depth: int = 0) -> bool:
    """Whether an entry is masked, of an array or of a list of numbers and arrays; InputError for lists without end."""
    if isinstance(values, list | tuple):
        if depth == _DEEPEST:
            raise InputError(message(f"{name} is a list nested more than {_DEEPEST} levels deep", "Does it contain itself?"))
        return any(_is_masked(name, one, depth + 1) for one in values)
    return isinstance(values, np.ma.MaskedArray) and bool(np.ma.is_masked(values))


def _is_complex(value: Any) -> bool:
    return isinstance(value, complex | np.complexfloating)


def _refused(name: str, values: Any, what: str = "", mend: str = "") -> InputError:
    found = brief(values)
    said = what and not found.endswith("too large")
    return InputError(message(f"{name} {what}: {found}" if said else f"{name} is {found}", mend=mend))
