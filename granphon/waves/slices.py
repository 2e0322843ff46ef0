"""The equations of a strip that is driven at one of its ends, slice by slice.

The motions of a strip are numbered from the driven end: those at the end are slice 0, those that
they are coupled to and that are not in it slice 1, and so on. So a slice is coupled to the slices
beside it alone, and the equations are

    A_k x_k + B_k x_(k+1) + C_k x_(k-1) = 0    (k > 0),    A_0 x_0 + B_0 x_1 = drive

From the far end on, each slice is eliminated: x_k = P_k x_(k-1), with P_k = -(A_k + B_k P_(k+1))^-1
C_k. What is sought at either end is a sum over slices, which is carried along. So no more than two
slices are held, as dense matrices (block elimination; recursive Green's functions, A. MacKinnon, Z.
Phys. B 59, 385, 1985).
"""

from __future__ import annotations

from typing import Any

import numpy as np

from granphon.base.arrays import Complex, Index
from granphon.base.memory import require_memory

#: complex matrices of the widest slice, and of one beside it, that are held together
_HELD = 8.0
#: bytes of a complex number
_ENTRY = 16.0


def solve_by_slices(matrix: Any, drive: Any, lower: Any, upper: Any) -> tuple[Complex, Complex]:
    """Return S x, (rows, m), of the matrices S = ``lower`` and ``upper`` (rows, n), sparse, at the
    solution x (n, m) of ``matrix`` x = ``drive``.

    ``matrix`` (n, n) is sparse, and the places of its entries are symmetric; ``drive`` (n, m) is
    zero but at the motions that ``lower`` takes. Raises
    :class:`~granphon.base.errors.InputError` for slices that do not fit into memory, and
    numpy.linalg.LinAlgError where what is beyond a slice resonates exactly.
    """
    slices = find_slices(matrix, np.unique(lower.tocoo().col))
    require_slices(max(len(rows) for rows in slices))
    beyond = None  # the slice after the one at hand, and its equations
    at_upper = np.zeros((upper.shape[0], 0), complex)
    inner = np.zeros((0, 0), complex)
    upper_columns = upper.tocsc()
    for rows in reversed(slices):
        of_slice = matrix[rows]
        own = of_slice[:, rows].toarray().astype(complex)
        taken = upper_columns[:, rows].toarray().astype(complex)
        if beyond is not None:
            passed_on = -np.linalg.solve(inner, matrix[beyond][:, rows].toarray())
            own += of_slice[:, beyond] @ passed_on
            taken += at_upper @ passed_on
        inner = own
        at_upper = taken
        beyond = rows
    first = slices[0]
    motions = np.linalg.solve(inner, np.asarray(drive[first], complex))
    return np.asarray(lower.tocsc()[:, first] @ motions), at_upper @ motions


def find_slices(matrix: Any, first: Index) -> list[Index]:
    """Return the motions (n_k,) of each slice, of which ``first`` is the one at the driven end, by
    the entries of a sparse ``matrix`` (n, n); motions that nothing joins to the first are in none.
    """
    is_new = np.ones(matrix.shape[0], bool)
    pattern = matrix.tocsr()
    slices = [first]
    is_new[first] = False
    while True:
        reached = np.unique(pattern[slices[-1]].indices)
        following = reached[is_new[reached]]
        if not following.size:
            return slices
        is_new[following] = False
        slices.append(following)


def count_slice_bytes(width: int) -> float:
    """Return the bytes that slices of so many motions take."""
    return _HELD * _ENTRY * float(width) ** 2


def require_slices(width: int) -> None:
    """Raise :class:`~granphon.base.errors.InputError` unless slices of so many motions fit into
    memory.
    """
    require_memory(
        f"slices of {width:,} motions across the strip",
        count_slice_bytes(width),
        "Take a narrower strip: the memory goes as the square of the motions across, and not with"
        " the length",
    )
