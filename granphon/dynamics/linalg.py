"""Singular values of stacks of small matrices, to high relative accuracy.

LAPACK's SVD is accurate relative to the largest singular value. Near Gamma the acoustic singular
values are smaller than the optical one by a factor |q|d, and the norms of the columns of C(q) are
graded by the same factor. Orthogonalising the columns by plane rotations keeps every digit of a
graded matrix (J. Demmel and K. Veselic, SIAM J. Matrix Anal. Appl. 13, 1204, 1992). LAPACK is many
times faster: it does whatever it can do without losing a digit, and the rotations do the rest.
"""

from __future__ import annotations

import itertools
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import Any

import numpy as np
from numpy.typing import NDArray

from granphon.base.errors import ConvergenceError, message

#: relative rounding of double precision
_EPSILON = float(np.finfo(np.float64).eps)
#: largest number of sweeps of the Jacobi iteration, which needs 6 or fewer
_MOST_SWEEPS = 40
#: norm of a column, relative to the largest element, below which it is the rounding error of a
#: dependent column
_NO_COLUMN = 1e-100
#: fraction of the trace of a singular matrix by which rounding may make an eigenvalue negative
_BELOW_ZERO = 16.0 * _EPSILON
#: singular value, over the largest, of rows and columns of comparable length, below which they are
#: dependent
_DEPENDENT = 1e-9
#: number of columns up to which the Jacobi iteration is as fast as LAPACK
_FEW_COLUMNS = 3
#: number of columns above which matrices are taken one by one
MANY_COLUMNS = 300
#: eigenvalue of A^H A, over the largest, from which its root has an error below 1e-11, and far
#: above that of dependent columns
WELL_ABOVE = 1e-4
#: the same of columns that are not dependent
_FAR_ABOVE = 1e-9
#: error of LAPACK, as a multiple of the rounding of the largest singular value or eigenvalue (at
#: most 2.1 on lattices)
_LAPACK_ERROR = 4.0
#: relative error up to which a singular value of LAPACK is accepted
_ACCEPTED_ERROR = 1e-13
#: ratio of the norms of columns from which the Jacobi iteration can gain a digit
_GRADED_RATIO = 10.0
#: largest cosine between columns, and angle by which they are turned, for a first-order rotation:
#: its square is rounding
_FIRST_ORDER = 1e-8
#: cosine between columns up to which they are orthogonal except for rounding
_STRAIGHT = 1e-14
#: ratio of the norms of columns below which LAPACK would lose digits of the smaller one, and QR
#: leaves no coupling
_COMPARABLE_RATIO = 1e-8


def graded_svd(matrices: NDArray[Any]) -> tuple[NDArray[np.float64], NDArray[Any]]:
    """Find singular values and right singular vectors of a stack of matrices A, accurate for graded
    columns too.

    LAPACK's eigenvectors V of A^H A come first. They are accepted where the columns of A V are so
    nearly orthogonal that a rotation of first order makes them so to rounding. Elsewhere LAPACK's
    SVD follows, whose errors are eps sigma_max. Where these may be above 1e-13 of sigma_min, and
    the columns of A are graded, they are brought into an order in which LAPACK keeps the digits of
    each; :func:`jacobi_svd` finishes what a rotation of first order does not. The errors are then
    eps kappa, kappa the condition of the columns scaled to length 1: sigma_max / sigma_min is at
    most kappa times the ratio of the lengths. The result for a matrix does not depend on the others
    in the stack.

    Parameters
    ----------
    matrices : (n_matrices, m, n), real or complex.

    Returns
    -------
    values : (n_matrices, n), ascending, never negative; zero for each column of zeros.
    right : (n_matrices, n, n), unitary; its columns are the right singular vectors.
    """
    m, n = matrices.shape[1:]
    if n <= _FEW_COLUMNS:
        return jacobi_svd(matrices)
    if m <= n:
        # contacts that are just enough to hold the balls leave soft motions at most wave vectors
        return _decompose(matrices)
    _, right = np.linalg.eigh(matrices.conj().swapaxes(1, 2) @ matrices)
    values, right, good = _straighten(matrices @ right, right)
    bad = np.flatnonzero(~good)
    if bad.size:
        values[bad], right[bad] = _decompose(matrices[bad])
    return values, right


def graded_eigh(
    matrices: NDArray[Any], factor: Callable[[NDArray[Any]], NDArray[Any]]
) -> tuple[NDArray[np.float64], NDArray[Any]]:
    """Find square roots of the eigenvalues, and eigenvectors, of a stack of matrices A^H A, as
    :func:`graded_svd` of A does.

    ``matrices`` (n_matrices, n, n) are Hermitian; ``factor`` finds A (k, m, n) of k of them. It is
    called only for those where LAPACK's error may exceed 1e-13 of the smallest root, including
    those with a negative eigenvalue.
    """
    if matrices.shape[2] <= _FEW_COLUMNS:
        return jacobi_svd(factor(matrices))
    squares, right = np.linalg.eigh(matrices)
    # a root has half the relative error of its square
    limit = 0.5 * _LAPACK_ERROR * _EPSILON / _ACCEPTED_ERROR
    doubtful = np.flatnonzero(squares[:, 0] <= limit * squares[:, -1])
    values = np.sqrt(np.maximum(squares, 0.0))
    if doubtful.size:
        values[doubtful], right[doubtful] = graded_svd(factor(matrices[doubtful]))
    return values, right


def _straighten(
    turned: NDArray[Any], right: NDArray[Any]
) -> tuple[NDArray[np.float64], NDArray[Any], NDArray[np.bool_]]:
    """Make nearly orthogonal columns orthogonal by a rotation of first order.

    Parameters
    ----------
    turned : (n_matrices, m, n), A V.
    right : (n_matrices, n, n), V, unitary.

    Returns
    -------
    values : (n_matrices, n), singular values of A, ascending.
    right : (n_matrices, n, n), right singular vectors.
    is_exact : (n_matrices,), whether the remaining error, of second order, is only rounding.
    """
    products = turned.conj().swapaxes(1, 2) @ turned
    squares = np.einsum("qii->qi", products).real.copy()
    values = np.sqrt(squares)
    np.einsum("qii->qi", products)[...] = 0.0
    overlaps = np.abs(products)
    length_products = values[:, :, None] * values[:, None]
    gap = squares[:, None] - squares[:, :, None]
    is_small = overlaps <= _FIRST_ORDER * np.abs(gap)
    is_straight = overlaps <= _STRAIGHT * length_products
    is_nearly_straight = is_small & (overlaps <= _FIRST_ORDER * length_products)
    is_exact = np.all(is_straight | is_nearly_straight, axis=(1, 2))
    apart = is_small & (gap != 0.0)
    turn = np.where(apart, products, 0.0)
    # real and imaginary parts are divided apart: a quotient of complex numbers leaves the floating
    # range near subnormal ones
    for component in (turn.real, turn.imag) if np.iscomplexobj(turn) else (turn,):
        np.divide(component, gap, out=component, where=apart)
    order = np.argsort(values, axis=1, kind="stable")
    # skew to rounding, as a rotation of first order must be
    turn = 0.5 * (turn - turn.conj().swapaxes(1, 2))
    right = np.take_along_axis(right + right @ turn, order[:, None], 2)
    return np.take_along_axis(values, order, 1), right, is_exact


def _decompose(matrices: NDArray[Any]) -> tuple[NDArray[np.float64], NDArray[Any]]:
    """Find the SVD by LAPACK, or by the Jacobi iteration where LAPACK loses digits of graded
    columns; zeros are exact.
    """
    values, right = lapack_svd(matrices)
    limit = _LAPACK_ERROR * _EPSILON / _ACCEPTED_ERROR
    doubtful = np.flatnonzero(values[:, 0] <= limit * values[:, -1])
    # the largest element stands for the length of a column: its square might underflow
    size = np.max(np.abs(matrices[doubtful]), axis=1)
    graded = []
    for n, lengths in zip(doubtful.tolist(), size, strict=True):
        # a column of zeros gives a singular value of zero, which is no reason to doubt the others
        zeros = np.count_nonzero(lengths == 0.0)
        values[n, :zeros] = 0.0
        lengths = lengths[lengths > 0.0]
        if not lengths.size or values[n, zeros] > limit * values[n, -1]:
            continue
        if _GRADED_RATIO * lengths.min() < lengths.max():
            graded.append(n)
    again = np.array(graded, np.intp)
    if again.size:
        turned, nearly = _precondition(matrices[again])
        values[again], right[again], good = _straighten(turned, nearly)
        if not np.all(good):
            bad = again[~good]
            values[bad], rotation = jacobi_svd(turned[~good])
            right[bad] = nearly[~good] @ rotation
    return values, right


def lapack_svd(matrices: NDArray[Any]) -> tuple[NDArray[np.float64], NDArray[Any]]:
    """Find what :func:`graded_svd` finds, but only to rounding of the largest singular value."""
    _, values, adjoint = np.linalg.svd(_pad_rows(matrices), full_matrices=False)
    return values[:, ::-1].copy(), adjoint[:, ::-1].swapaxes(1, 2).conj()


def _precondition(matrices: NDArray[Any]) -> tuple[NDArray[Any], NDArray[Any]]:
    """Make the columns of a stack of graded matrices nearly orthogonal, so that :func:`jacobi_svd`
    has little left to do.

    Two factorisations, A = Q R with columns in descending order and R^H = Q' R', leave R Q' = R'^H,
    whose columns are coupled to second order in the ratio of their norms only. LAPACK's singular
    vectors of its diagonal blocks, columns of much smaller norm apart, do the rest. So each column
    keeps its digits (compare Z. Drmac and K. Veselic, SIAM J. Matrix Anal. Appl. 29, 1322, 2008).

    Returns
    -------
    turned : (n_matrices, n, n), with the singular values and right singular vectors of A V.
    right : (n_matrices, n, n), V, unitary.
    """
    size = np.max(np.abs(matrices), axis=1)
    order = np.argsort(-size, axis=1, kind="stable")
    descending = np.take_along_axis(matrices, order[:, None], 2)
    triangles = np.asarray(np.linalg.qr(_pad_rows(descending), mode="r"))
    right, upper = np.linalg.qr(triangles.swapaxes(1, 2).conj())
    within = np.zeros_like(right)
    # blocks (n_matrices, n) of columns of comparable norms, in descending order
    ordered = np.take_along_axis(size, order, 1)
    blocks = np.zeros(ordered.shape, np.intp)
    first = ordered[:, 0].copy()
    for column in range(1, ordered.shape[1]):
        smaller = ordered[:, column] < _COMPARABLE_RATIO * first
        first[smaller] = ordered[smaller, column]
        blocks[:, column] = blocks[:, column - 1] + smaller
    for kind in np.unique(blocks, axis=0):
        same = np.flatnonzero(np.all(blocks == kind, axis=1))
        for block in range(kind[-1] + 1):
            columns = np.flatnonzero(kind == block)
            diagonal = np.ix_(same, columns, columns)
            within[diagonal] = lapack_svd(upper.swapaxes(1, 2).conj()[diagonal])[1]
    right = right @ within
    return triangles @ right, np.take_along_axis(right, np.argsort(order, axis=1)[:, :, None], 1)


def _pad_rows(matrices: NDArray[Any]) -> NDArray[Any]:
    """Add rows of zeros until there are as many rows as columns: one for each free motion."""
    lacking = max(0, matrices.shape[2] - matrices.shape[1])
    return np.pad(matrices, ((0, 0), (0, lacking), (0, 0))) if lacking else matrices


def jacobi_svd(matrices: NDArray[Any]) -> tuple[NDArray[np.float64], NDArray[Any]]:
    """Find singular values and right singular vectors of a stack of m x n matrices with few
    columns, by plane rotations.

    Parameters
    ----------
    matrices : (..., m, n), real or complex.

    Returns
    -------
    values : (..., n), ascending, never negative, each accurate to rounding for graded columns.
    right : (..., n, n), unitary; its columns are the right singular vectors.
    """
    shape = matrices.shape[:-2]
    (m, n) = matrices.shape[-2:]
    a = np.moveaxis(matrices.reshape(-1, m, n), 0, -1).swapaxes(0, 1)
    # a common scale keeps the squared norms in range
    scale = np.max(np.abs(a), axis=(0, 1))
    scale[scale == 0.0] = 1.0
    if n == 1:  # the only singular value is the length of the column
        unit = np.divide(a, scale, order="C")
        length = np.sqrt(np.einsum("nmb,nmb->nb", unit, unit.conj()).real) * scale
        ones = np.ones((*shape, 1, 1), np.result_type(matrices.dtype, np.float64))
        return length.reshape(*shape, 1), ones
    # axes: column first, batch last, so that each rotation works on contiguous rows. Below each
    # column of A is the matching column of the right singular vectors
    columns = np.zeros((n, m + n, a.shape[-1]), np.result_type(matrices.dtype, np.float64))
    columns[:, :m] = a / scale
    columns[np.arange(n), m + np.arange(n)] = 1.0
    for _ in range(_MOST_SWEEPS):
        turned = [
            _rotate(columns[p], columns[r], m) for p, r in itertools.combinations(range(n), 2)
        ]
        if not any(turned):
            break
    else:
        # for finite input it always does, quadratically
        raise RuntimeError("the Jacobi iteration did not converge")
    norms = np.sqrt(np.einsum("nmb,nmb->nb", columns[:, :m], columns[:, :m].conj()).real)
    order = np.argsort(norms, axis=0, kind="stable")
    values = np.take_along_axis(norms, order, 0) * scale
    right = np.take_along_axis(columns[:, m:], order[:, None], 0)
    values = np.moveaxis(values, -1, 0).reshape(*shape, n)
    return values, right.transpose(2, 1, 0).reshape(*shape, n, n)


def _rotate(first: NDArray[Any], second: NDArray[Any], m: int) -> bool:
    """Make the upper m rows of two columns (rows, n_matrices) orthogonal, in place. Returns whether
    they were not.
    """
    adjoint = first[:m].conj()
    alpha = np.einsum("mb,mb->b", adjoint, first[:m]).real
    beta = np.einsum("mb,mb->b", second[:m].conj(), second[:m]).real
    gamma = np.einsum("mb,mb->b", adjoint, second[:m])
    size = np.abs(gamma)
    # a column below _NO_COLUMN is the rounding error of a dependent column: it counts as zero and
    # cannot be made orthogonal
    active = size > 4.0 * _EPSILON * np.sqrt(alpha) * np.sqrt(beta)
    active &= np.minimum(alpha, beta) > _NO_COLUMN**2
    if not np.any(active):
        return False
    # the tangent t of the angle is the smaller root of t^2 + 2 zeta t = 1
    safe = np.where(active, size, 1.0)
    zeta = np.where(active, 0.5 * (beta - alpha) / safe, 0.0)
    tangent = np.where(zeta >= 0.0, 1.0, -1.0) / (np.abs(zeta) + np.hypot(1.0, zeta))
    tangent = np.where(active, tangent, 0.0)
    cosine = 1.0 / np.hypot(1.0, tangent)
    sine = cosine * tangent
    turned = second * np.where(active, gamma / safe, 1.0).conj()
    first[...], second[...] = cosine * first - sine * turned, sine * first + cosine * turned
    return True


def cholesky_factor(matrices: NDArray[Any]) -> NDArray[Any]:
    """Return L^H of a stack of Hermitian positive semidefinite matrices D = L L^H, for
    :func:`jacobi_svd`.

    Each matrix is first scaled to a unit diagonal, so that a graded one keeps its small
    eigenvalues; rows that are zero stay zero. Raises :class:`numpy.linalg.LinAlgError` if a matrix
    has an eigenvalue below zero by more than rounding.
    """
    diagonal = np.einsum("...ii->...i", matrices).real
    if np.any(diagonal < 0.0):
        raise np.linalg.LinAlgError("negative diagonal")
    root = np.sqrt(diagonal)
    inverse = np.where(root > 0.0, 1.0 / np.where(root > 0.0, root, 1.0), 0.0)
    unit = matrices * inverse[..., :, None] * inverse[..., None, :]
    index = np.arange(matrices.shape[-1])
    unit[..., index, index] = 1.0
    lower = _find_lower(unit)
    return np.asarray((root[..., :, None] * lower).swapaxes(-1, -2).conj())


def _find_lower(matrices: NDArray[Any]) -> NDArray[Any]:
    """Find L of a stack of matrices L L^H of unit diagonal; L is not triangular where the matrix is
    singular.
    """
    try:
        return np.asarray(np.linalg.cholesky(matrices))
    except np.linalg.LinAlgError:
        if matrices.ndim > 2:
            # one by one, so that a singular matrix does not change the results of the others
            return np.stack([_find_lower(matrix) for matrix in matrices])
        values, vectors = np.linalg.eigh(matrices)
        if values[0] < -_BELOW_ZERO * len(values):
            raise
        return np.asarray(vectors * np.sqrt(np.maximum(values, 0.0)))


def find_rank(rows: NDArray[Any]) -> int:
    """Find the rank of rows (m, n), each column and then each row scaled to length one."""
    for axis in (0, 1):
        length = np.linalg.norm(rows, axis=axis, keepdims=True)
        rows = rows / np.where(length > 0.0, length, 1.0)
    if is_independent(rows):
        return int(rows.shape[1])
    values = np.linalg.svd(rows, compute_uv=False) if rows.size else np.zeros(1)
    return int(np.count_nonzero(values > _DEPENDENT * max(values[0], 1.0)))


def is_independent(rows: NDArray[Any]) -> bool:
    """Return whether many columns are so by far, as Cholesky's factors of A^H A less a little tell
    at once.
    """
    if not rows.shape[0] >= rows.shape[1] > MANY_COLUMNS:
        return False
    product = rows.conj().T @ rows
    product[np.diag_indices(len(product))] -= _FAR_ABOVE * np.linalg.norm(product)
    try:
        np.linalg.cholesky(product)
    except np.linalg.LinAlgError:
        return False
    return True


def find_dependent(
    rows: NDArray[Any], sizes: NDArray[np.float64]
) -> tuple[NDArray[Any], NDArray[Any]]:
    """Find orthonormal vectors (n, k) that a matrix (m, n) takes to zero, and vectors (n, n - k)
    that complete them.

    ``sizes`` (m, n) are the sizes that the entries of the matrix would have if nothing cancelled in
    them. As in :func:`find_rank`, each column and then each row is divided by its length in the
    matrix of sizes, so that small columns count as much as large ones, and no entry is above one.
    """
    lengths = np.linalg.norm(sizes, axis=0)
    lengths[lengths == 0.0] = 1.0
    row_lengths = np.linalg.norm(sizes / lengths, axis=1, keepdims=True)
    scaled = rows / lengths / np.where(row_lengths > 0.0, row_lengths, 1.0)
    if is_independent(scaled):
        return np.zeros((len(lengths), 0), rows.dtype), np.eye(len(lengths), dtype=rows.dtype)
    range_basis, values, adjoint = np.linalg.svd(_pad_rows(scaled[None])[0], full_matrices=False)
    rank = int(np.count_nonzero(values > _DEPENDENT * max(values[0], 1.0)))
    count = len(values) - rank
    free, _ = np.linalg.qr(adjoint[rank:].conj().T / lengths[:, None])
    # vectors that are longest in long columns come out as small differences of others, which are
    # not quite taken to zero: the residuals correct the vectors
    residuals = scaled @ (lengths[:, None] * free)
    amplitudes = range_basis[: len(rows), :rank].conj().T @ residuals / values[:rank, None]
    correction = adjoint[:rank].conj().T @ amplitudes / lengths[:, None]
    basis, _ = np.linalg.qr(free - correction, mode="complete")
    return basis[:, :count], basis[:, count:]


@contextmanager
def lanczos_converges() -> Iterator[None]:
    """Raise :class:`~granphon.base.errors.ConvergenceError` where an iteration of ARPACK within
    ends without its modes.
    """
    from scipy.sparse.linalg import ArpackError

    try:
        yield
    except ArpackError as error:
        why = "Their frequencies may lie too close together"
        raise ConvergenceError(
            message("modes are not found by Lanczos's method", why, "Ask for fewer modes")
        ) from error


@lanczos_converges()
def find_nearest(
    matrix: Any, count: int, shift: float, solve: Callable[[Any], Any], start: Any = None
) -> Any:
    """Find eigenvalues (count,) of a sparse Hermitian matrix, those nearest to ``shift``, and their
    vectors, by Lanczos.

    ``solve`` applies the inverse of the matrix less the shift; ``start`` is a vector that has a
    part of each.
    """
    from scipy.sparse.linalg import LinearOperator, eigsh

    if start is None:
        start = np.random.default_rng(0).normal(size=matrix.shape[0]).astype(matrix.dtype)
    inverse = LinearOperator(matrix.shape, matvec=solve, dtype=matrix.dtype)
    return eigsh(matrix, k=count, sigma=shift, OPinv=inverse, v0=start)
