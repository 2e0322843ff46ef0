"""What is given in Python where real numbers are needed, as arrays of them; nothing of it is dropped in silence."""

from __future__ import annotations

from decimal import Decimal
from numbers import Real
from typing import Any

import numpy as np
from numpy.typing import NDArray

from granphon.errors import InputError, message

__all__ = ["real_array"]

_REAL = "It must be a real number or an array of them"


def real_array(name: str, values: Any) -> NDArray[np.float64]:
    """``values`` as an array of floats, of any shape, perhaps not finite; an array of floats is returned as it is.

    :class:`~granphon.errors.InputError`, which calls it ``name``, for what NumPy would turn into other numbers than were
    meant: complex numbers, whose imaginary part would be dropped; masked entries, which would become numbers again; texts
    and truth values; numbers too large for a float; lists of different lengths.
    """
    if type(values) is np.ndarray and values.dtype == np.float64:
        return values
    if _is_masked(values):
        raise _refused(
            name, values, "has masked entries, which are no real numbers", "Leave them out, as .compressed() does"
        )
    try:
        given = np.asarray(values)
    except (TypeError, ValueError):  # lists of different lengths
        raise _refused(name, values, mend=_REAL) from None
    if given.dtype.kind == "O":  # Python's integers of more than 64 bits, fractions, decimals
        if not all(isinstance(one, Real | Decimal) and not isinstance(one, bool) for one in given.ravel().tolist()):
            raise _refused(name, values, "is complex" if any(map(_is_complex, given.ravel())) else "", _REAL)
        try:
            return given.astype(np.float64)
        except OverflowError:
            raise _refused(name, values, "is too large for double precision") from None
    if given.dtype.kind not in "iuf":
        raise _refused(name, values, "is complex" if given.dtype.kind == "c" else "", _REAL)
    with np.errstate(over="ignore"):
        array = np.asarray(given, np.float64)
    if given.dtype.itemsize > array.dtype.itemsize and np.any(np.isinf(array) & np.isfinite(given)):
        raise _refused(name, values, "is too large for double precision")
    return array


def _is_masked(values: Any) -> bool:
    """Whether an entry is masked, of an array or of a list of numbers and arrays."""
    if isinstance(values, list | tuple):
        return any(map(_is_masked, values))
    return isinstance(values, np.ma.MaskedArray) and bool(np.ma.is_masked(values))


def _is_complex(value: Any) -> bool:
    return isinstance(value, complex | np.complexfloating)


def _refused(name: str, values: Any, what: str = "", mend: str = "") -> InputError:
    try:
        text = " ".join(repr(values).split())
    except ValueError:  # more digits than Python writes
        text = "an integer of very many digits"
    found = text if len(text) <= 80 else text[:77] + "..."
    return InputError(message(f"{name} {what}: {found}" if what else f"{name} is {found}", mend=mend))
