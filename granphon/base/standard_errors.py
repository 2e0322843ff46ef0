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
    """Return the standard error of a function of means (..., m) over two or more independent rows
    of ``values`` (..., n, m).

    It is estimated from the values of the function with each row left out in turn.
    """
    count = values.shape[-2]
    without = of((np.sum(values, axis=-2, keepdims=True) - values) / (count - 1))
    return np.asarray(math.sqrt(count - 1) * np.std(without, axis=-1))
