"""Types of arrays, by the short names that signatures have, and the rounding of their entries.

Type checkers see NumPy's own types. At run time a type is an array and the kind of its entries as a
value, by which :func:`~granphon.base.results.restore` reads a field: what NumPy's types look like
then changes from version to version, and nothing depends on it.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Annotated

import numpy as np

if TYPE_CHECKING:
    from numpy.typing import NDArray

    Array = NDArray[np.float64]
    Index = NDArray[np.intp]
    Flags = NDArray[np.bool_]
    Complex = NDArray[np.complex128]
else:
    Array = Annotated[np.ndarray, np.dtype(np.float64)]
    Index = Annotated[np.ndarray, np.dtype(np.intp)]
    Flags = Annotated[np.ndarray, np.dtype(np.bool_)]
    Complex = Annotated[np.ndarray, np.dtype(np.complex128)]

#: relative change of a number in double precision that is no larger than rounding: two neighbouring
#: numbers are up to 2.2e-16 apart
ROUNDED = 4e-16
