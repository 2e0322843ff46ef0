"""Singular values to high relative accuracy: a one-sided Jacobi iteration over stacks of small matrices.

LAPACK's SVD is accurate relative to the largest singular value. Near Gamma the acoustic singular values are |q|d times
smaller than the optical one, and the columns of C(q) are graded in just that way. Orthogonalising the columns by plane
rotations keeps every digit of a graded matrix (J. Demmel and K. Veselic, SIAM J. Matrix Anal. Appl. 13, 1204, 1992).
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

__all__ = ["cholesky_factor", "jacobi_svd"]

_SWEEPS = 40
_NOTHING = 1e-100
#: part of the trace of a singular matrix by which rounding may take an eigenvalue below zero
_ROUNDING = 16.0 * np.finfo(np.float64).eps


def jacobi_svd(matrices: NDArray[Any]) -> tuple[NDArray[np.float64], NDArray[Any], NDArray[Any]]:
    """Singular values and vectors of a stack of m x n matrices with few columns.

    Parameters
    ----------
    matrices : (..., m, n), real or complex.

    Returns
    -------
    values : (..., n), ascending, never negative, each accurate to rounding for graded columns.
    right : (..., n, n), unitary; its columns are the right singular vectors.
    left : (..., m, n), orthonormal columns; a column is zero where the singular value is.
    """
    shape, (m, n) = matrices.shape[:-2], matrices.shape[-2:]
    dtype = np.result_type(matrices.dtype, np.float64)
    # column first, batch last: each rotation then works on contiguous rows
    a = np.moveaxis(matrices.reshape(-1, m, n), 0, -1).swapaxes(0, 1).astype(dtype)  # (n, m, batch)
    v = np.zeros((n, n, a.shape[-1]), dtype)  # (column, row, batch)
    v[np.arange(n), np.arange(n)] = 1.0
    # a common scale keeps the squared norms in range
    scale = np.max(np.abs(a), axis=(0, 1))
    scale[scale == 0.0] = 1.0
    a = a / scale
    tolerance = 4.0 * np.finfo(np.float64).eps
    for _ in range(_SWEEPS):
        converged = True
        for p in range(n - 1):
            for r in range(p + 1, n):
                converged &= _rotate(a, v, p, r, tolerance)
        if converged:
            break
    else:
        raise RuntimeError("the Jacobi iteration did not converge")  # it does, quadratically, for finite input
    norms = np.sqrt(np.einsum("nmb,nmb->nb", a, a.conj()).real)
    order = np.argsort(norms, axis=0, kind="stable")
    values = np.take_along_axis(norms, order, 0)
    left = np.take_along_axis(a, order[:, None], 0) / np.where(values > 0.0, values, 1.0)[:, None]
    right = np.take_along_axis(v, order[:, None], 0)
    return (
        np.moveaxis(values * scale, -1, 0).reshape(*shape, n),
        right.transpose(2, 1, 0).reshape(*shape, n, n),
        left.transpose(2, 1, 0).reshape(*shape, m, n),
    )


def _rotate(a: NDArray[Any], v: NDArray[Any], p: int, r: int, tolerance: float) -> bool:
    """Make columns p and r orthogonal, in place; whether they were."""
    alpha = np.einsum("mb,mb->b", a[p].conj(), a[p]).real
    beta = np.einsum("mb,mb->b", a[r].conj(), a[r]).real
    gamma = np.einsum("mb,mb->b", a[p].conj(), a[r])
    size = np.abs(gamma)
    # a column below _NOTHING is what rounding left of a dependent one: zero, and never to be orthogonal
    active = (size > tolerance * np.sqrt(alpha) * np.sqrt(beta)) & (np.minimum(alpha, beta) > _NOTHING**2)
    if not np.any(active):
        return True
    safe = np.where(active, size, 1.0)
    zeta = np.where(active, 0.5 * (beta - alpha) / safe, 0.0)
    tangent = np.where(zeta >= 0.0, 1.0, -1.0) / (np.abs(zeta) + np.hypot(1.0, zeta))
    tangent = np.where(active, tangent, 0.0)
    cosine = 1.0 / np.hypot(1.0, tangent)
    sine = cosine * tangent
    phase = np.where(active, gamma / safe, 1.0)
    for columns in (a, v):
        first, second = columns[p].copy(), columns[r] * phase.conj()
        columns[p] = cosine * first - sine * second
        columns[r] = sine * first + cosine * second
    return False


def cholesky_factor(matrices: NDArray[Any]) -> NDArray[Any]:
    """L^H of a stack of Hermitian positive semidefinite matrices D = L L^H, for :func:`jacobi_svd`.

    The matrix is brought to a unit diagonal first, so that a graded one keeps its small eigenvalues; rows that are zero
    stay zero. Raises :class:`numpy.linalg.LinAlgError` if a matrix has an eigenvalue below zero by more than rounding.
    """
    diagonal = np.einsum("...ii->...i", matrices).real
    if np.any(diagonal < 0.0):
        raise np.linalg.LinAlgError("negative diagonal")
    root = np.sqrt(diagonal)
    inverse = np.where(root > 0.0, 1.0 / np.where(root > 0.0, root, 1.0), 0.0)
    unit = matrices * inverse[..., :, None] * inverse[..., None, :]
    index = np.arange(matrices.shape[-1])
    unit[..., index, index] = 1.0
    lower = _lower(unit)
    return np.asarray((root[..., :, None] * lower).swapaxes(-1, -2).conj())


def _lower(matrices: NDArray[Any]) -> NDArray[Any]:
    """L of a stack of matrices L L^H of unit diagonal; not a triangle where one is singular."""
    try:
        return np.asarray(np.linalg.cholesky(matrices))
    except np.linalg.LinAlgError:
        if matrices.ndim > 2:  # what the others get does not depend on the singular one
            return np.stack([_lower(matrix) for matrix in matrices])
        values, vectors = np.linalg.eigh(matrices)
        if values[0] < -_ROUNDING * len(values):
            raise
        return np.asarray(vectors * np.sqrt(np.maximum(values, 0.0)))
