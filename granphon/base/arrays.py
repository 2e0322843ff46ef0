"""Types of arrays, by the short names that signatures have, the rounding of their entries, and
arrays of one shape.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
Index = NDArray[np.intp]
Flags = NDArray[np.bool_]
Complex = NDArray[np.complex128]

#: relative change of a number in double precision that is no larger than rounding: two neighbouring
#: numbers are up to 2.2e-16 apart
ROUNDING = 4e-16


def pad_columns(arrays: Sequence[Array]) -> list[Array]:
    """Return one or more ``arrays`` (..., c), each with as many columns c as the widest of them
    has; the columns that are added are nan. An array that is as wide already stays as it is, and is
    not copied; so does one of one axis, or of none, which has no columns.
    """
    n_columns = max(array.shape[-1] if array.ndim > 1 else 0 for array in arrays)
    padded_arrays = list[Array]()
    for array in arrays:
        if array.ndim > 1 and array.shape[-1] < n_columns:
            # numbers of values that are added before and after, for each axis
            widths = [(0, 0)] * (array.ndim - 1) + [(0, n_columns - array.shape[-1])]
            padded_arrays.append(np.pad(array, widths, constant_values=np.nan))
        else:
            padded_arrays.append(array)
    return padded_arrays
