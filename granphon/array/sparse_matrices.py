"""Sparse matrices of networks of contacts: C from the coefficients of its rows, and LU factors of C^T K C."""

from __future__ import annotations

from collections.abc import Iterable
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import ArrayLike

if TYPE_CHECKING:
    from scipy.sparse import csr_array


def compose(parts: Iterable[tuple[ArrayLike, ArrayLike, ArrayLike]], shape: tuple[int, int]) -> csr_array[Any]:
    """Return a sparse matrix from parts (lines, columns, entries), arrays of one shape or that broadcast to one.

    Entries at the same place add up, as those of a ball that touches itself across the boundary do.
    """
    from scipy.sparse import coo_array  # imported here: most simulations do not need it

    flat = [[np.ravel(one) for one in np.broadcast_arrays(*part)] for part in parts]
    lines, columns, entries = (np.concatenate(one) for one in zip(*flat, strict=True))
    where = lines.astype(np.int32), columns.astype(np.int32)
    matrix: csr_array[Any] = coo_array((entries, where), shape=shape).tocsr()
    matrix.eliminate_zeros()
    return matrix


def factorise(matrix: Any, approximate: bool = False, pivot: float = 0.0) -> Any:
    """Return the LU factors of a symmetric matrix, positive definite if ``pivot`` is zero.

    ``approximate`` ones are in single precision, half as large, for preconditioners. ``pivot`` is the part of the largest
    entry of a column from which that on the diagonal is taken. Raises RuntimeError if the matrix is singular.
    """
    from scipy.sparse.linalg import splu

    options: dict[str, Any] = {"SymmetricMode": True}
    if not approximate:
        return splu(matrix.tocsc(), permc_spec="MMD_AT_PLUS_A", diag_pivot_thresh=pivot, options=options)
    # larger supernodes would fill a matrix of so few entries with zeros
    options["Equil"] = False
    single = matrix.tocsc().astype(np.float32)
    return splu(single, permc_spec="MMD_AT_PLUS_A", diag_pivot_thresh=pivot, relax=1, options=options)
