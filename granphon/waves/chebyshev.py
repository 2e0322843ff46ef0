"""Chebyshev polynomials of the dynamical matrix, which functions of the angular frequency are expanded in.

The polynomials T_n(2 D / top^2 - 1) are the even polynomials T_2n(omega / top) of omega = D^1/2. An expansion in them, with
a kernel made for omega, resolves frequencies evenly down to zero.
"""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
from numpy.typing import NDArray

from granphon.waves.operator import WaveOperator

Array = NDArray[np.float64]


def polynomials(operator: WaveOperator, start: Array) -> Iterator[Array]:
    """Yield T_n(2 D / top^2 - 1) x for n = 0, 1, 2, ... without end; x is the vector, or the vectors (size, m), ``start``.

    An array that was yielded is overwritten after the next one has been.
    """
    previous = np.array(start, float)
    yield previous
    current = 2.0 / operator.top**2 * (operator @ previous) - previous
    while True:
        yield current
        previous, current = current, operator.advance(current, previous)
