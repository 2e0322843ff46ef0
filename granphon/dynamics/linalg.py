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
#: eigenvalue of an energy, over the largest, up to which it is the rounding of zero
NO_ENERGY = 1e-13
#: singular value, over the largest, of rows and columns of comparable length, below which they are
#: dependent
DEPENDENT = 1e-9
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
#: eigenvalue, over the largest of the same matrix, that rounding explains
_SINGULAR = 1e-14


def graded_svd(matrices: NDArray[Any]) -> tuple[NDArray[np.float64], NDArray[Any]]:
    """Return singular values and right singular vectors of a stack of matrices A, accurate for
    graded columns too.

    Up to three columns are left to :func:`jacobi_svd`. Of more rows than columns, LAPACK's
    eigenvectors V of A^H A come first. They are accepted where the columns of A V are so nearly
    orthogonal that a rotation of first order makes them so to rounding. Elsewhere LAPACK's SVD
    follows, whose errors are eps sigma_max. Where these may be above 1e-13 of sigma_min, and
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
    _, vectors = np.linalg.eigh(matrices.conj().swapaxes(1, 2) @ matrices)
    values, right, is_exact = _straighten(matrices @ vectors, vectors)
    inexact = np.flatnonzero(~is_exact)
    if inexact.size:
        values[inexact], right[inexact] = _decompose(matrices[inexact])
    return values, right


def graded_eigh(
    matrices: NDArray[Any], factor: Callable[[NDArray[Any]], NDArray[Any]]
) -> tuple[NDArray[np.float64], NDArray[Any]]:
    """Return square roots (n_matrices, n) of the eigenvalues, ascending, and eigenvectors
    (n_matrices, n, n), as columns, of a stack of matrices A^H A, as :func:`graded_svd` of A does.

    ``matrices`` (n_matrices, n, n) are Hermitian; ``factor`` finds A (k, m, n) of k of them. Up to
    n = 3 it is called for all. Above, it is called only for those where LAPACK's error may exceed
    1e-13 of the smallest root, including those with a negative eigenvalue.
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
    """Return singular values and vectors of A by a rotation of first order, which makes the nearly
    orthogonal columns of A V orthogonal.

    Parameters
    ----------
    turned : (n_matrices, m, n), A V.
    right : (n_matrices, n, n), V, unitary.

    Returns
    -------
    values : (n_matrices, n), singular values of A, ascending: the lengths of the columns of A V.
    right : (n_matrices, n, n), right singular vectors, in the order of the values.
    is_exact : (n_matrices,), whether the remaining error, of second order, is only rounding.
    """
    products = turned.conj().swapaxes(1, 2) @ turned
    diagonal = np.einsum("qii->qi", products)  # a view
    squares = diagonal.real.copy()
    values = np.sqrt(squares)
    diagonal[...] = 0.0
    overlaps = np.abs(products)
    length_products = values[:, :, None] * values[:, None]
    gap = squares[:, None] - squares[:, :, None]
    is_small = overlaps <= _FIRST_ORDER * np.abs(gap)
    is_straight = overlaps <= _STRAIGHT * length_products
    is_nearly_straight = is_small & (overlaps <= _FIRST_ORDER * length_products)
    is_exact = np.all(is_straight | is_nearly_straight, axis=(1, 2))
    has_angle = is_small & (gap != 0.0)
    angles = np.where(has_angle, products, 0.0)
    # real and imaginary parts are divided apart: a quotient of complex numbers leaves the floating
    # range near subnormal ones
    components = (angles.real, angles.imag) if np.iscomplexobj(angles) else (angles,)
    for component in components:
        np.divide(component, gap, out=component, where=has_angle)
    order = np.argsort(values, axis=1, kind="stable")
    # skew to rounding, as a rotation of first order must be
    turn = 0.5 * (angles - angles.conj().swapaxes(1, 2))
    sorted_right = np.take_along_axis(right + right @ turn, order[:, None], 2)
    return np.take_along_axis(values, order, 1), sorted_right, is_exact


def _decompose(matrices: NDArray[Any]) -> tuple[NDArray[np.float64], NDArray[Any]]:
    """Return singular values (n_matrices, n), ascending, and right singular vectors
    (n_matrices, n, n), by LAPACK, or by the Jacobi iteration where LAPACK loses digits of graded
    columns. Each column of zeros gives a value of exactly zero.
    """
    values, right = lapack_svd(matrices)
    limit = _LAPACK_ERROR * _EPSILON / _ACCEPTED_ERROR
    doubtful = np.flatnonzero(values[:, 0] <= limit * values[:, -1])
    # the largest element stands for the length of a column: its square might underflow
    sizes = np.max(np.abs(matrices[doubtful]), axis=1)
    is_graded = np.zeros(len(matrices), bool)
    for number, lengths in zip(doubtful.tolist(), sizes, strict=True):
        # a column of zeros gives a singular value of zero, which is no reason to doubt the others
        zeros = np.count_nonzero(lengths == 0.0)
        values[number, :zeros] = 0.0
        lengths_above_zero = lengths[lengths > 0.0]
        if not lengths_above_zero.size or values[number, zeros] > limit * values[number, -1]:
            continue
        is_graded[number] = _GRADED_RATIO * lengths_above_zero.min() < lengths_above_zero.max()
    graded = np.flatnonzero(is_graded)
    if graded.size:
        turned, nearly = _precondition(matrices[graded])
        values[graded], right[graded], is_exact = _straighten(turned, nearly)
        if not np.all(is_exact):
            inexact = graded[~is_exact]
            values[inexact], rotation = jacobi_svd(turned[~is_exact])
            right[inexact] = nearly[~is_exact] @ rotation
    return values, right


def lapack_svd(matrices: NDArray[Any]) -> tuple[NDArray[np.float64], NDArray[Any]]:
    """Return singular values (n_matrices, n), ascending, and right singular vectors
    (n_matrices, n, n), to rounding of the largest singular value only.
    """
    _, values, adjoint = np.linalg.svd(_pad_rows(matrices), full_matrices=False)
    return values[:, ::-1].copy(), adjoint[:, ::-1].swapaxes(1, 2).conj()


def _precondition(matrices: NDArray[Any]) -> tuple[NDArray[Any], NDArray[Any]]:
    """Return a stack of graded matrices A with nearly orthogonal columns, A V, so that
    :func:`jacobi_svd` has little left to do.

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
    orthogonal, upper = np.linalg.qr(triangles.swapaxes(1, 2).conj())
    lower = upper.swapaxes(1, 2).conj()
    within = np.zeros_like(orthogonal)
    blocks = _number_blocks(np.take_along_axis(size, order, 1))
    # matrices whose columns fall into the same blocks are taken together
    for numbers in np.unique(blocks, axis=0):
        alike = np.flatnonzero(np.all(blocks == numbers, axis=1))
        for block in range(numbers[-1] + 1):
            columns = np.flatnonzero(numbers == block)
            diagonal = np.ix_(alike, columns, columns)
            within[diagonal] = lapack_svd(lower[diagonal])[1]
    right = orthogonal @ within
    in_first_order = np.argsort(order, axis=1)[:, :, None]
    return triangles @ right, np.take_along_axis(right, in_first_order, 1)


def _number_blocks(sizes: NDArray[np.float64]) -> NDArray[np.intp]:
    """Return the number (n_matrices, n) of the block of each column, from sizes (n_matrices, n) of
    columns in descending order: a block begins with a column far smaller than the first of the
    block before.
    """
    blocks = np.zeros(sizes.shape, np.intp)
    first = sizes[:, 0].copy()
    for column in range(1, sizes.shape[1]):
        is_smaller = sizes[:, column] < _COMPARABLE_RATIO * first
        first[is_smaller] = sizes[is_smaller, column]
        blocks[:, column] = blocks[:, column - 1] + is_smaller
    return blocks


def _pad_rows(matrices: NDArray[Any]) -> NDArray[Any]:
    """Add rows of zeros until there are as many rows as columns: one for each free motion."""
    lacking = max(0, matrices.shape[2] - matrices.shape[1])
    return np.pad(matrices, ((0, 0), (0, lacking), (0, 0))) if lacking else matrices


def jacobi_svd(matrices: NDArray[Any]) -> tuple[NDArray[np.float64], NDArray[Any]]:
    """Return singular values and right singular vectors of a stack of m x n matrices with few
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
    m, n = matrices.shape[-2:]
    a = np.moveaxis(matrices.reshape(-1, m, n), 0, -1).swapaxes(0, 1)  # (n, m, n_matrices)
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
        # all pairs of columns, also after the first that has been turned
        were_turned = [
            _rotate(columns[p], columns[r], m) for p, r in itertools.combinations(range(n), 2)
        ]
        if not any(were_turned):
            break
    else:
        # for finite input the iteration always converges, quadratically
        raise RuntimeError("the Jacobi iteration did not converge")
    norms = np.sqrt(np.einsum("nmb,nmb->nb", columns[:, :m], columns[:, :m].conj()).real)
    order = np.argsort(norms, axis=0, kind="stable")
    values = np.take_along_axis(norms, order, 0) * scale
    right = np.take_along_axis(columns[:, m:], order[:, None], 0)
    values = np.moveaxis(values, -1, 0).reshape(*shape, n)
    return values, right.transpose(2, 1, 0).reshape(*shape, n, n)


def _rotate(first: NDArray[Any], second: NDArray[Any], m: int) -> bool:
    """Turn two columns (rows, n_matrices), in place, so that their upper m rows are orthogonal;
    return whether any were not.
    """
    adjoint = first[:m].conj()
    alpha = np.einsum("mb,mb->b", adjoint, first[:m]).real
    beta = np.einsum("mb,mb->b", second[:m].conj(), second[:m]).real
    gamma = np.einsum("mb,mb->b", adjoint, second[:m])
    size = np.abs(gamma)
    # the product of orthogonal columns has the rounding of a few epsilon. A column below _NO_COLUMN
    # is the rounding error of a dependent column: it counts as zero and cannot be made orthogonal
    is_oblique = size > 4.0 * _EPSILON * np.sqrt(alpha) * np.sqrt(beta)
    is_oblique &= np.minimum(alpha, beta) > _NO_COLUMN**2
    if not np.any(is_oblique):
        return False
    # the tangent t of the angle is the smaller root of t^2 + 2 zeta t = 1
    divisor = np.where(is_oblique, size, 1.0)
    zeta = np.where(is_oblique, 0.5 * (beta - alpha) / divisor, 0.0)
    smaller_root = np.where(zeta >= 0.0, 1.0, -1.0) / (np.abs(zeta) + np.hypot(1.0, zeta))
    tangent = np.where(is_oblique, smaller_root, 0.0)
    cosine = 1.0 / np.hypot(1.0, tangent)
    sine = cosine * tangent
    # with the phase of the first column, so that the product of both is real
    in_phase = second * np.where(is_oblique, gamma / divisor, 1.0).conj()
    new_first = cosine * first - sine * in_phase
    second[...] = sine * first + cosine * in_phase
    first[...] = new_first
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
    has_row = root > 0.0
    inverse = np.where(has_row, 1.0 / np.where(has_row, root, 1.0), 0.0)
    unit = matrices * inverse[..., :, None] * inverse[..., None, :]
    index = np.arange(matrices.shape[-1])
    unit[..., index, index] = 1.0
    lower = _find_lower(unit)
    return np.asarray((root[..., :, None] * lower).swapaxes(-1, -2).conj())


def _find_lower(matrices: NDArray[Any]) -> NDArray[Any]:
    """Return L (..., n, n) of a stack of matrices L L^H of unit diagonal; L is not triangular where
    the matrix is singular.
    """
    try:
        return np.asarray(np.linalg.cholesky(matrices))
    except np.linalg.LinAlgError:
        if matrices.ndim > 2:
            # one by one, so that a singular matrix does not change the results of the others
            return np.stack([_find_lower(matrix) for matrix in matrices])
        eigenvalues, vectors = np.linalg.eigh(matrices)
        if eigenvalues[0] < -_BELOW_ZERO * len(eigenvalues):
            raise
        return np.asarray(vectors * np.sqrt(np.maximum(eigenvalues, 0.0)))


def find_rank(rows: NDArray[Any]) -> int:
    """Return the rank of rows (m, n), each column and then each row scaled to length one."""
    scaled = rows
    for axis in (0, 1):
        length = np.linalg.norm(scaled, axis=axis, keepdims=True)
        scaled = scaled / np.where(length > 0.0, length, 1.0)
    if not scaled.size:
        return 0
    if is_independent(scaled):
        return int(scaled.shape[1])
    # rows of length one have a singular value of one or more; rows of zeros alone have rank zero
    singular_values = np.linalg.svd(scaled, compute_uv=False)
    return int(np.count_nonzero(singular_values > DEPENDENT * max(singular_values[0], 1.0)))


def is_independent(rows: NDArray[Any]) -> bool:
    """Return whether the columns of A, ``rows`` (m, n), are many and independent by far: A^H A less
    a small part of its norm then has factors of Cholesky.
    """
    n_rows, n_columns = rows.shape
    if not n_rows >= n_columns > MANY_COLUMNS:
        return False
    product = rows.conj().T @ rows
    product[np.diag_indices(n_columns)] -= _FAR_ABOVE * np.linalg.norm(product)
    try:
        np.linalg.cholesky(product)
    except np.linalg.LinAlgError:
        return False
    return True


def find_dependent(
    rows: NDArray[Any], sizes: NDArray[np.float64]
) -> tuple[NDArray[Any], NDArray[Any]]:
    """Return orthonormal vectors (n, k) that a matrix (m, n) takes to zero, and vectors (n, n - k)
    that complete them to a basis.

    ``sizes`` (m, n) are the sizes that the entries of the matrix would have if nothing cancelled in
    them. As in :func:`find_rank`, each column and then each row is divided by its length in the
    matrix of sizes, so that small columns count as much as large ones, and no entry is above one.
    """
    lengths = np.linalg.norm(sizes, axis=0)
    lengths[lengths == 0.0] = 1.0
    row_lengths = np.linalg.norm(sizes / lengths, axis=1, keepdims=True)
    scaled = rows / lengths / np.where(row_lengths > 0.0, row_lengths, 1.0)
    n = len(lengths)
    if is_independent(scaled):
        return np.zeros((n, 0), rows.dtype), np.eye(n, dtype=rows.dtype)
    padded = _pad_rows(scaled[None])[0]
    range_basis, singular_values, adjoint = np.linalg.svd(padded, full_matrices=False)
    rank = int(np.count_nonzero(singular_values > DEPENDENT * max(singular_values[0], 1.0)))
    count = len(singular_values) - rank
    free, _ = np.linalg.qr(adjoint[rank:].conj().T / lengths[:, None])
    # vectors that are longest in long columns come out as small differences of others, which are
    # not quite taken to zero: the residuals correct the vectors
    residuals = scaled @ (lengths[:, None] * free)
    amplitudes = range_basis[: len(rows), :rank].conj().T @ residuals / singular_values[:rank, None]
    correction = adjoint[:rank].conj().T @ amplitudes / lengths[:, None]
    basis, _ = np.linalg.qr(free - correction, mode="complete")
    return basis[:, :count], basis[:, count:]


def invert_hermitian(matrices: NDArray[Any]) -> NDArray[Any]:
    """Return the inverses of Hermitian matrices (..., n, n); zero for what is singular in them."""
    try:
        inverse = np.linalg.inv(matrices)
    except np.linalg.LinAlgError:  # not even rounding keeps some from being singular
        inverse = np.full_like(matrices, np.inf)
    sizes = [np.max(np.abs(values), axis=(-2, -1)) for values in (matrices, inverse)]
    is_singular = sizes[0] * sizes[1] * _SINGULAR > 1.0
    if np.any(is_singular):
        inverse[is_singular] = np.linalg.pinv(
            matrices[is_singular], rcond=_SINGULAR, hermitian=True
        )
    return np.asarray(inverse)


@contextmanager
def lanczos_converges() -> Iterator[None]:
    """Raise :class:`~granphon.base.errors.ConvergenceError` where an iteration of ARPACK in the
    block ends without its modes.
    """
    from scipy.sparse.linalg import ArpackError

    try:
        yield
    except ArpackError as error:
        text = message(
            "modes are not found by Lanczos's method",
            "Their frequencies may lie too close together",
            "Ask for fewer modes",
        )
        raise ConvergenceError(text) from error


@lanczos_converges()
def find_nearest(
    matrix: Any, count: int, shift: float, solve: Callable[[Any], Any], start: Any = None
) -> Any:
    """Return the eigenvalues (count,) of a sparse Hermitian matrix (n, n) that are nearest to
    ``shift``, ascending, and their vectors (n, count), by Lanczos's method, or by Arnoldi's if the
    matrix is complex.

    ``solve`` applies the inverse of the matrix less the shift; ``start`` (n,) is a vector that has
    a part of each eigenvector, by default a random one.
    """
    from scipy.sparse.linalg import LinearOperator, eigsh

    if start is None:
        # the same one each time, so that results repeat
        start = np.random.default_rng(0).normal(size=matrix.shape[0]).astype(matrix.dtype)
    inverse = LinearOperator(matrix.shape, matvec=solve, dtype=matrix.dtype)
    values, vectors = eigsh(matrix, k=count, sigma=shift, OPinv=inverse, v0=start)
    order = np.argsort(values)  # Arnoldi's method returns them in no order
    return values[order], vectors[:, order]
