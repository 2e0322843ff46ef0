"""Standard errors: those of means over independent values, such as those of samples, and those that
a call gives.
"""

from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np
from numpy.typing import ArrayLike

from granphon.base.arrays import Array
from granphon.base.errors import InputError
from granphon.base.validation import real_array


def standard_error(values: Array, axis: int) -> Array:
    """Return the standard error of the mean along an axis of two or more independent values."""
    return np.asarray(np.std(values, axis=axis, ddof=1) / math.sqrt(values.shape[axis]))


def read_errors(name: str, errors: ArrayLike, shape: tuple[int, ...]) -> Array:
    """Return standard ``errors`` as an array of the ``shape`` of their values; nan stands for an
    error that is not known.

    Raises :class:`~granphon.base.errors.InputError`, with the argument's ``name``, for another
    shape.
    """
    numbers = real_array(name, errors)
    if numbers.shape != shape:
        raise InputError(
            f"{name} has the shape {numbers.shape}",
            f"The values have the shape {shape}",
            "Give a standard error for each",
        )
    return numbers


def jackknife(of: Callable[[Array], Array], values: Array) -> Array:
    """Return the standard error (...) of the value that a function ``of`` has at the mean (..., m)
    of two or more independent rows of ``values`` (..., n, m); ``of`` takes an array (..., m) and
    returns an array (...).

    The error is estimated from the values of ``of`` at means from which each row is left out in
    turn (the jackknife, J. W. Tukey, 1958).
    """
    count = values.shape[-2]
    without = of((np.sum(values, axis=-2, keepdims=True) - values) / (count - 1))
    return np.asarray(math.sqrt(count - 1) * np.std(without, axis=-1))
