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
    """Return the standard error of the mean of ``values`` along an ``axis``, on which two or more
    independent values stand.
    """
    return np.asarray(np.std(values, axis=axis, ddof=1) / math.sqrt(values.shape[axis]))


def read_errors(name: str, errors: ArrayLike, shape: tuple[int, ...]) -> Array:
    """Return standard ``errors`` as an array of the ``shape`` of their values; nan stands for an
    error that is not known. An array of floats is returned as it is, without a copy.

    Raises :class:`~granphon.base.errors.InputError`, with the argument's ``name``, for another
    shape, for an error below zero, and for what are no numbers.
    """
    numbers = real_array(name, errors)
    if numbers.shape != shape:
        raise InputError(
            f"{name} has the shape {numbers.shape}",
            f"The values have the shape {shape}",
            "Give a standard error for each",
        )
    if np.any(numbers < 0.0):
        raise InputError(
            f"{name} has {np.nanmin(numbers):g}",
            "A standard error is zero or above",
            "Give nan for an error that is not known",
        )
    return numbers


def jackknife(function: Callable[[Array], Array], values: Array) -> Array:
    """Return the standard error (...) of the value that a ``function`` has at the mean (..., m) of
    n independent rows of ``values`` (..., n, m), two or more; the ``function`` takes an array
    (..., m) and returns an array (...).

    The error is estimated from the n values of the function at means from which each row is left
    out in turn (the jackknife, J. W. Tukey, 1958).
    """
    n_rows = values.shape[-2]
    means = (np.sum(values, axis=-2, keepdims=True) - values) / (n_rows - 1)  # each without a row
    return np.asarray(math.sqrt(n_rows - 1) * np.std(function(means), axis=-1))
