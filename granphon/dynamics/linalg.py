"""Singular values to high relative accuracy, of stacks of small matrices.

LAPACK's SVD is accurate relative to the largest singular value. Near Gamma the acoustic singular values are |q|d times
smaller than the optical one, and the columns of C(q) are graded in just that way. Orthogonalising the columns by plane
rotations keeps every digit of a graded matrix (J. Demmel and K. Veselic, SIAM J. Matrix Anal. Appl. 13, 1204, 1992).
LAPACK is several times faster, and serves every matrix of which it loses no digits.
"""

from __future__ import annotations

from functools import cache
from typing import Any

import numpy as np
from numpy.typing import NDArray

__all__ = ["MOST_COLUMNS", "cholesky_factor", "graded_svd", "jacobi_svd", "lapack_svd"]

_EPS = float(np.finfo(np.float64).eps)
_SWEEPS = 40
_NOTHING = 1e-100
#: part of the trace of a singular matrix by which rounding may take an eigenvalue below zero
_ROUNDING = 16.0 * _EPS
#: columns up to which the iteration is as fast as LAPACK, and beyond which it, whose cost grows with their cube, is left out
_FEW_COLUMNS, MOST_COLUMNS = 3, 36
#: elements of matrices that are turned at a time
_TOGETHER = 4096
#: LAPACK's errors over rounding of the largest singular value (2.1 at most on lattices), and the relative error it may make
_LAPACK, _TOLERANCE = 4.0, 1e-13
#: ratio of the norms of columns from which on the iteration can gain a digit
_GRADED = 10.0


def graded_svd(matrices: NDArray[Any]) -> tuple[NDArray[np.float64], NDArray[Any]]:
    """Singular values and right singular vectors of a stack of matrices, accurate for graded columns as well.

    LAPACK is asked first. Its errors are eps sigma_max, of the smallest value eps sigma_max / sigma_min of itself. Where
    that may be above 1e-13, :func:`jacobi_svd` does the matrix again, if its columns are graded: its errors are
    eps kappa, kappa the condition of the columns scaled to length 1, and sigma_max / sigma_min is at most kappa times
    the ratio of the lengths. What a matrix gets does not depend on the others in the stack.

    Parameters
    ----------
    matrices : (n_matrices, m, n), real or complex.

    Returns
    -------
    values : (n_matrices, n), ascending, never negative; zero for each column of zeros.
    right : (n_matrices, n, n), unitary; its columns are the right singular vectors. With more than ``MOST_COLUMNS``
        columns all are LAPACK's.
    """
    n = matrices.shape[2]
    if n <= _FEW_COLUMNS:
        return jacobi_svd(matrices)
    values, right = lapack_svd(matrices)
    if n <= MOST_COLUMNS:
        again = _loses_digits(matrices, values)
        if again.size:
            # Householder's triangle has errors relative to each column alone, and fewer rows to turn
            triangles = np.linalg.qr(matrices[again], mode="r")
            # as many at a time as stay in the cache
            for some in np.array_split(np.arange(again.size), max(1, again.size * n * n // _TOGETHER)):
                values[again[some]], right[again[some]] = jacobi_svd(triangles[some])
    return values, right


def lapack_svd(matrices: NDArray[Any]) -> tuple[NDArray[np.float64], NDArray[Any]]:
    """The same by LAPACK alone, accurate to rounding of the largest singular value."""
    # fewer rows than columns leave free motions: a row of zeros for each
    lacking = max(0, matrices.shape[2] - matrices.shape[1])
    padded = np.pad(matrices, ((0, 0), (0, lacking), (0, 0))) if lacking else matrices
    _, values, adjoint = np.linalg.svd(padded, full_matrices=False)
    return values[:, ::-1].copy(), adjoint[:, ::-1].swapaxes(1, 2).conj()


def _loses_digits(matrices: NDArray[Any], values: NDArray[np.float64]) -> NDArray[np.intp]:
    """Which of LAPACK's ``values`` (n_matrices, n) lack digits that :func:`jacobi_svd` has; zeros are made exact.

    A column of zeros is a singular value of zero, and no reason to doubt the others.
    """
    limit = _LAPACK * _EPS / _TOLERANCE
    doubtful = np.flatnonzero(values[:, 0] <= limit * values[:, -1])
    # the largest element stands for the length of a column: its square might underflow
    size = np.max(np.abs(matrices[doubtful]), axis=1)
    found = []
    for place, lengths in zip(doubtful.tolist(), size, strict=True):
        zeros = np.count_nonzero(lengths == 0.0)
        values[place, :zeros] = 0.0
        rest = lengths[lengths > 0.0]
        if rest.size and values[place, zeros] <= limit * values[place, -1] and _GRADED * rest.min() < rest.max():
            found.append(place)
    return np.array(found, np.intp)


def jacobi_svd(matrices: NDArray[Any]) -> tuple[NDArray[np.float64], NDArray[Any]]:
    """Singular values and right singular vectors of a stack of m x n matrices with few columns, by plane rotations.

    Parameters
    ----------
    matrices : (..., m, n), real or complex.

    Returns
    -------
    values : (..., n), ascending, never negative, each accurate to rounding for graded columns.
    right : (..., n, n), unitary; its columns are the right singular vectors.
    """
    shape, (m, n) = matrices.shape[:-2], matrices.shape[-2:]
    a = np.moveaxis(matrices.reshape(-1, m, n), 0, -1).swapaxes(0, 1)
    # a common scale keeps the squared norms in range
    scale = np.max(np.abs(a), axis=(0, 1))
    scale[scale == 0.0] = 1.0
    # column first, batch last: each rotation then works on contiguous rows. Below each column, that of the right vectors
    columns = np.zeros((n, m + n, a.shape[-1]), np.result_type(matrices.dtype, np.float64))
    columns[:, :m] = a / scale
    columns[np.arange(n), m + np.arange(n)] = 1.0
    for _ in range(_SWEEPS):
        converged = True
        for p, r in _rounds(n):
            converged &= _rotate(columns, m, p, r)
        if converged:
            break
    else:
        raise RuntimeError("the Jacobi iteration did not converge")  # it does, quadratically, for finite input
    norms = np.sqrt(np.einsum("nmb,nmb->nb", columns[:, :m], columns[:, :m].conj()).real)
    order = np.argsort(norms, axis=0, kind="stable")
    values = np.take_along_axis(norms, order, 0) * scale
    right = np.take_along_axis(columns[:, m:], order[:, None], 0)
    return np.moveaxis(values, -1, 0).reshape(*shape, n), right.transpose(2, 1, 0).reshape(*shape, n, n)


@cache
def _rounds(n: int) -> list[tuple[Any, Any]]:
    """All pairs of ``n`` columns, as the rounds of a tournament: those of one round have no column in common."""
    seats = list(range(n + n % 2))
    found: list[tuple[Any, Any]] = []
    for _ in seats[1:]:
        half = len(seats) // 2
        pairs = [sorted(pair) for pair in zip(seats[:half], reversed(seats[half:]), strict=True)]
        first, second = np.array([pair for pair in pairs if pair[1] < n], np.intp).reshape(-1, 2).T
        # a single pair is taken as views
        one = len(first) == 1
        found.append((slice(first[0], first[0] + 1), slice(second[0], second[0] + 1)) if one else (first, second))
        seats = [seats[0], seats[-1], *seats[1:-1]]
    return found[::-1]


def _rotate(columns: NDArray[Any], m: int, p: Any, r: Any) -> bool:
    """Make the upper m rows of each pair of columns orthogonal, in place; whether they were."""
    first, second = columns[p], columns[r]
    adjoint = first[:, :m].conj()
    alpha = np.einsum("pmb,pmb->pb", adjoint, first[:, :m]).real
    beta = np.einsum("pmb,pmb->pb", second[:, :m].conj(), second[:, :m]).real
    gamma = np.einsum("pmb,pmb->pb", adjoint, second[:, :m])
    size = np.abs(gamma)
    # a column below _NOTHING is what rounding left of a dependent one: zero, and never to be orthogonal
    active = (size > 4.0 * _EPS * np.sqrt(alpha) * np.sqrt(beta)) & (np.minimum(alpha, beta) > _NOTHING**2)
    if not np.any(active):
        return True
    safe = np.where(active, size, 1.0)
    zeta = np.where(active, 0.5 * (beta - alpha) / safe, 0.0)
    tangent = np.where(zeta >= 0.0, 1.0, -1.0) / (np.abs(zeta) + np.hypot(1.0, zeta))
    tangent = np.where(active, tangent, 0.0)
    cosine = 1.0 / np.hypot(1.0, tangent)
    cosine, sine = cosine[:, None], (cosine * tangent)[:, None]
    second = second * np.where(active, gamma / safe, 1.0).conj()[:, None]
    columns[p], columns[r] = cosine * first - sine * second, sine * first + cosine * second
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
