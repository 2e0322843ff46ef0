"""Types of arrays, by the short names that signatures have, and the rounding of their entries.

Each type carries the kind of its entries as a value, which :func:`~granphon.base.results.restore`
reads: what NumPy's own types look like at run time changes from version to version.
"""

from __future__ import annotations

from typing import Annotated

import numpy as np
from numpy.typing import NDArray

Array = Annotated[NDArray[np.float64], np.dtype(np.float64)]
Index = Annotated[NDArray[np.intp], np.dtype(np.intp)]
Flags = Annotated[NDArray[np.bool_], np.dtype(np.bool_)]
Complex = Annotated[NDArray[np.complex128], np.dtype(np.complex128)]

#: relative change of a number in double precision that is no larger than rounding: two neighbouring
#: numbers are up to 2.2e-16 apart
ROUNDED = 4e-16
