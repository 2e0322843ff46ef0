"""Types of arrays, by the short names that signatures have, and the rounding of their entries."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
Index = NDArray[np.intp]
Flags = NDArray[np.bool_]
Complex = NDArray[np.complex128]

#: relative change of a number in double precision that is no larger than rounding: two neighbouring
#: numbers are up to 2.2e-16 apart
ROUNDED = 4e-16
