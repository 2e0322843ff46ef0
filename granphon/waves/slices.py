"""The equations of a strip that is driven at one of its ends, slice by slice.

The motions of a strip are divided into slices, from the driven end on: the motions at the end are
slice 0, all others that are coupled to these are slice 1, all others that are coupled to slice 1
are slice 2, and so on. So a slice is coupled only to the slices beside it, and the equations are

    A_k x_k + B_k x_(k+1) + C_k x_(k-1) = 0    (k > 0),    A_0 x_0 + B_0 x_1 = drive

From the far end on, each slice is eliminated: x_k = P_k x_(k-1), with P_k = -(A_k + B_k P_(k+1))^-1
C_k. The motions that are sought at the far end are linear in those of the slice at hand, and this
linear map is updated with each slice. So no more than two slices are held in memory, as dense
matrices (block elimination; recursive Green's functions, A. MacKinnon, Z. Phys. B 59, 385, 1985).
"""

from __future__ import annotations

from typing import Any

import numpy as np

from granphon.base.arrays import Complex, Index
from granphon.base.memory import require_memory

#: complex matrices, as large as that of the widest slice, that are held at a time
_N_MATRICES = 8.0
#: bytes of a complex number
_COMPLEX_BYTES = 16.0


def solve_by_slices(matrix: Any, drive: Any, lower: Any, upper: Any) -> tuple[Complex, Complex]:
    """Return the motions at both ends of a strip, ``lower`` x (n_lower, m) and ``upper`` x
    (n_upper, m), for the solution x (n, m) of ``matrix`` x = ``drive``.

    ``matrix`` (n, n) is sparse, with an entry (j, i) wherever it has an entry (i, j). The sparse
    matrices ``lower`` (n_lower, n) and ``upper`` (n_upper, n) pick the motions of the ends.
    ``drive`` (n, m), of m sources, is zero except at the motions of the lower end. Raises
    :class:`~granphon.base.errors.InputError` for slices that do not fit into memory, and
    numpy.linalg.LinAlgError if the strip, or its part beyond a slice, has a mode exactly at the
    frequency.
    """
    driven_motions = np.unique(lower.tocoo().col)
    slices = find_slices(matrix, driven_motions)
    require_slices(max(len(rows) for rows in slices))
    upper_columns = upper.tocsc()
    # of slice k + 1: its motions, its equations with all later slices eliminated, and the map from
    # its motions to those at the upper end
    next_rows = None
    next_equations = np.zeros((0, 0), complex)
    next_to_upper = np.zeros((upper.shape[0], 0), complex)
    for rows in reversed(slices):
        coupling = matrix[rows]
        equations = coupling[:, rows].toarray().astype(complex)  # A_k
        to_upper = upper_columns[:, rows].toarray().astype(complex)
        if next_rows is not None:
            coupling_back = matrix[next_rows][:, rows].toarray()  # C_(k+1)
            to_next = -np.linalg.solve(next_equations, coupling_back)  # P_(k+1)
            equations += coupling[:, next_rows] @ to_next  # A_k + B_k P_(k+1)
            to_upper += next_to_upper @ to_next
        next_rows = rows
        next_equations = equations
        next_to_upper = to_upper
    # slice 0 is left, the only one that is driven
    first_rows = slices[0]
    drive_of_first = np.asarray(drive[first_rows], complex)
    motions = np.asarray(np.linalg.solve(next_equations, drive_of_first), complex)
    at_lower: Complex = np.asarray(lower.tocsc()[:, first_rows] @ motions)
    return at_lower, np.asarray(next_to_upper @ motions, complex)


def find_slices(matrix: Any, first_slice: Index) -> list[Index]:
    """Return the indices of the motions (n_k,) of each slice, in order from the ``first_slice``
    (n_0,), at the driven end.

    Motions are coupled where a sparse ``matrix`` (n, n) has entries. Motions that are coupled to
    the first slice neither directly nor through others are in no slice.
    """
    is_in_no_slice = np.ones(matrix.shape[0], bool)
    pattern = matrix.tocsr()
    slices = [first_slice]
    is_in_no_slice[first_slice] = False
    while True:
        coupled_motions = np.unique(pattern[slices[-1]].indices)
        next_slice = coupled_motions[is_in_no_slice[coupled_motions]]
        if not next_slice.size:
            return slices
        is_in_no_slice[next_slice] = False
        slices.append(next_slice)


def count_slice_bytes(width: int) -> float:
    """Return the bytes that the elimination of slices takes if the widest slice has ``width``
    motions.
    """
    return _N_MATRICES * _COMPLEX_BYTES * float(width) ** 2


def require_slices(width: int) -> None:
    """Raise :class:`~granphon.base.errors.InputError` unless the elimination of slices with up to
    ``width`` motions fits into memory.
    """
    require_memory(
        f"slices of {width:,} motions across the strip",
        count_slice_bytes(width),
        "Take a narrower strip: the memory goes as the square of the motions across, and not with"
        " the length",
    )
