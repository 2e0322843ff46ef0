"""Standard errors of means over independent values, such as those of samples."""

from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np

from granphon.base.arrays import Array


def standard_error(values: Array, axis: int) -> Array:
    """Return the standard error of the mean along an axis of two or more independent values."""
    return np.asarray(np.std(values, axis=axis, ddof=1) / math.sqrt(values.shape[axis]))


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
