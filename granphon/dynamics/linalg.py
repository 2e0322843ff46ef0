"""Singular values of stacks of small matrices, to high relative accuracy.

LAPACK's SVD is accurate relative to the largest singular value. Near Gamma the acoustic singular
values are smaller than the optical one by a factor |q|d, and the norms of the columns of C(q) are
graded by the same factor. Orthogonalising the columns by plane rotations keeps every digit of a
graded matrix (J. Demmel and K. Veselic, SIAM J. Matrix Anal. Appl. 13, 1204, 1992). LAPACK is many
times faster: LAPACK does whatever loses no digit, and the rotations do all other work.
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
_COLUMN_ROUNDING = 1e-100
#: fraction of the trace of a singular matrix by which rounding may make an eigenvalue negative
_NEGATIVE_ROUNDING = 16.0 * _EPSILON
#: eigenvalue of an energy, over the largest, up to which it is the rounding of zero
NO_ENERGY = 1e-13
#: singular value, over the largest, of rows and columns of comparable length, below which they are
#: dependent
DEPENDENCE = 1e-9
#: number of columns up to which the Jacobi iteration is as fast as LAPACK
_MOST_JACOBI_COLUMNS = 3
#: number of columns above which matrices are decomposed one by one
MANY_COLUMNS = 300
#: eigenvalue of A^H A, over the largest, from which the error of its square root is below 1e-11
LEAST_EXACT_SQUARE = 1e-4
#: eigenvalue of A^H A, over the norm of A^H A, from which the columns of A are independent by far
_LEAST_INDEPENDENCE = 1e-9
#: error of LAPACK, as a multiple of the rounding of the largest singular value or eigenvalue (at
#: most 2.1 on lattices)
_LAPACK_ERROR = 4.0
#: relative error up to which a singular value of LAPACK is accepted
_ACCEPTED_ERROR = 1e-13
#: ratio of the norms of columns from which the Jacobi iteration can gain a digit
_GRADED_RATIO = 10.0
#: largest cosine between columns, and angle by which they are turned, for a first-order rotation:
#: its square is rounding
_LARGEST_ROTATION = 1e-8
#: cosine between columns up to which they are orthogonal except for rounding
_COSINE_ROUNDING = 1e-14
#: ratio of the norms of two columns below which LAPACK would lose digits of the smaller column,
#: while two QR decompositions leave no coupling of the two
_COMPARABLE_RATIO = 1e-8
#: eigenvalue, over the largest of the same matrix, up to which it may be rounding of zero
_SINGULARITY = 1e-14


def graded_svd(matrices: NDArray[Any]) -> tuple[NDArray[np.float64], NDArray[Any]]:
    """Return singular values and right singular vectors of a stack of matrices A, accurate for
    graded columns too: columns of very different lengths.

    Matrices of up to three columns are left to :func:`jacobi_svd`. For others there are three
    steps, each for the matrices that the step before has not solved.

    1. If there are more rows than columns, LAPACK finds the eigenvectors V of A^H A. V is accepted
       if the columns of A V are so nearly orthogonal that a rotation of first order makes them
       orthogonal to rounding.
    2. LAPACK's SVD follows, whose errors are eps sigma_max. The SVD is accepted if the errors are
       below 1e-13 of sigma_min, or if the columns of A are not graded.
    3. The columns are brought into an order in which LAPACK keeps the digits of each, and a
       rotation of first order, or :func:`jacobi_svd`, makes them orthogonal. The errors are eps
       kappa, where kappa is the condition number of the columns scaled to length 1.

    The result for a matrix does not depend on the others in the stack.

    Parameters
    ----------
    matrices : (n_matrices, m, n), real or complex; m and n are above zero.

    Returns
    -------
    values : (n_matrices, n), ascending, never negative; zero for each column of zeros.
    right : (n_matrices, n, n), unitary; its columns are the right singular vectors.
    """
    m, n = matrices.shape[1:]
    if n <= _MOST_JACOBI_COLUMNS:
        return jacobi_svd(matrices)
    if m <= n:
        # as many contacts as motions, or fewer, leave soft motions at most wave vectors, for which
        # the eigenvectors of A^H A are hardly ever accepted
        return _decompose(matrices)
    _, vectors = np.linalg.eigh(matrices.conj().swapaxes(1, 2) @ matrices)
    values, right, is_exact = _straighten(matrices @ vectors, vectors)
    inexact_numbers = np.flatnonzero(~is_exact)
    if inexact_numbers.size:
        values[inexact_numbers], right[inexact_numbers] = _decompose(matrices[inexact_numbers])
    return values, right


def graded_eigh(
    matrices: NDArray[Any], factor: Callable[[NDArray[Any]], NDArray[Any]]
) -> tuple[NDArray[np.float64], NDArray[Any]]:
    """Return the square roots (n_matrices, n) of the eigenvalues, ascending, and the eigenvectors
    (n_matrices, n, n), as columns, of a stack of matrices A^H A, as accurate as :func:`graded_svd`
    finds them from A.

    ``matrices`` (n_matrices, n, n) are Hermitian. ``factor`` returns A (k, m, n) of k of them. Up
    to n = 3 ``factor`` is called for all matrices, otherwise only for those where LAPACK's error
    may exceed 1e-13 of the smallest root; these contain all matrices with a negative eigenvalue.
    """
    if matrices.shape[2] <= _MOST_JACOBI_COLUMNS:
        return jacobi_svd(factor(matrices))
    squares, right = np.linalg.eigh(matrices)
    # a root has half the relative error of its square
    limit = 0.5 * _LAPACK_ERROR * _EPSILON / _ACCEPTED_ERROR
    inexact_numbers = np.flatnonzero(squares[:, 0] <= limit * squares[:, -1])
    values = np.sqrt(np.maximum(squares, 0.0))
    if inexact_numbers.size:
        values[inexact_numbers], right[inexact_numbers] = graded_svd(
            factor(matrices[inexact_numbers])
        )
    return values, right


def _straighten(
    turned_matrices: NDArray[Any], right: NDArray[Any]
) -> tuple[NDArray[np.float64], NDArray[Any], NDArray[np.bool_]]:
    """Return singular values and right singular vectors of matrices A, by a rotation of first order
    that makes the nearly orthogonal columns of A V orthogonal.

    Parameters
    ----------
    turned_matrices : (n_matrices, m, n), A V.
    right : (n_matrices, n, n), V, unitary.

    Returns
    -------
    values : (n_matrices, n), singular values of A, ascending: the lengths of the columns of A V.
    right : (n_matrices, n, n), right singular vectors, in the order of the values.
    is_exact : (n_matrices,), whether the remaining error, of second order, is only rounding.
    """
    products = turned_matrices.conj().swapaxes(1, 2) @ turned_matrices
    diagonal = np.einsum("qii->qi", products)  # a view
    squares = diagonal.real.copy()
    values = np.sqrt(squares)
    diagonal[...] = 0.0
    overlaps = np.abs(products)
    length_products = values[:, :, None] * values[:, None]
    gap = squares[:, None] - squares[:, :, None]
    is_small = overlaps <= _LARGEST_ROTATION * np.abs(gap)
    is_straight = overlaps <= _COSINE_ROUNDING * length_products
    is_nearly_straight = is_small & (overlaps <= _LARGEST_ROTATION * length_products)
    is_exact = np.all(is_straight | is_nearly_straight, axis=(1, 2))
    has_angle = is_small & (gap != 0.0)
    angles = np.where(has_angle, products, 0.0)
    # real and imaginary parts are divided separately, because NumPy's quotient of tiny complex
    # numbers would overflow or underflow on the way
    components = (angles.real, angles.imag) if np.iscomplexobj(angles) else (angles,)
    for component in components:
        np.divide(component, gap, out=component, where=has_angle)
    order = np.argsort(values, axis=1, kind="stable")
    # skew-Hermitian without rounding errors, as a rotation of first order must be
    turn = 0.5 * (angles - angles.conj().swapaxes(1, 2))
    sorted_right = np.take_along_axis(right + right @ turn, order[:, None], 2)
    return np.take_along_axis(values, order, 1), sorted_right, is_exact


def _decompose(matrices: NDArray[Any]) -> tuple[NDArray[np.float64], NDArray[Any]]:
    """Return singular values (n_matrices, n), ascending, and right singular vectors
    (n_matrices, n, n), as columns, with all digits for graded columns too. Each column of zeros
    gives a singular value of exactly zero.

    LAPACK's SVD is kept if its error is small against the smallest singular value, or if the
    columns are of comparable length. Other matrices are first turned by :func:`_precondition`, so
    that their columns are nearly orthogonal.
    """
    values, right = lapack_svd(matrices)
    # ratio of the smallest value to the largest at which LAPACK's error is the accepted one
    limit = _LAPACK_ERROR * _EPSILON / _ACCEPTED_ERROR
    candidates = np.flatnonzero(values[:, 0] <= limit * values[:, -1])
    # the largest element stands for the length of a column, whose square might underflow
    sizes = np.max(np.abs(matrices[candidates]), axis=1)
    is_graded = np.zeros(len(matrices), bool)
    for number, lengths in zip(candidates.tolist(), sizes, strict=True):
        # a column of zeros has a singular value of exactly zero; only the others are judged
        n_zeros = np.count_nonzero(lengths == 0.0)
        values[number, :n_zeros] = 0.0
        lengths_above_zero = lengths[lengths > 0.0]
        if not lengths_above_zero.size or values[number, n_zeros] > limit * values[number, -1]:
            continue
        is_graded[number] = _GRADED_RATIO * lengths_above_zero.min() < lengths_above_zero.max()
    graded_numbers = np.flatnonzero(is_graded)
    if graded_numbers.size:
        # columns that are nearly orthogonal become orthogonal by a rotation of first order, or
        # where that does not suffice by plane rotations
        turned_matrices, near_vectors = _precondition(matrices[graded_numbers])
        values[graded_numbers], right[graded_numbers], is_exact = _straighten(
            turned_matrices, near_vectors
        )
        if not np.all(is_exact):
            inexact_numbers = graded_numbers[~is_exact]
            values[inexact_numbers], rotation = jacobi_svd(turned_matrices[~is_exact])
            right[inexact_numbers] = near_vectors[~is_exact] @ rotation
    return values, right


def lapack_svd(matrices: NDArray[Any]) -> tuple[NDArray[np.float64], NDArray[Any]]:
    """Return singular values (n_matrices, n), ascending, and right singular vectors
    (n_matrices, n, n), as columns, of ``matrices`` (n_matrices, m, n); the error of each value is
    the rounding of the largest.
    """
    _, values, adjoint = np.linalg.svd(_pad_rows(matrices), full_matrices=False)
    return values[:, ::-1].copy(), adjoint[:, ::-1].swapaxes(1, 2).conj()


def _precondition(matrices: NDArray[Any]) -> tuple[NDArray[Any], NDArray[Any]]:
    """Return unitary V that make the columns of graded ``matrices`` A (n_matrices, m, n) nearly
    orthogonal, so that :func:`jacobi_svd` of A V has little left to do.

    The columns of A are sorted in descending order. Two factorisations, A = Q R and R^H = Q' R',
    leave R Q' = R'^H, whose columns are coupled only to second order in the ratio of their norms.
    Columns of comparable norm are a block, and LAPACK's singular vectors of the diagonal blocks
    make the columns of a block orthogonal. So each column keeps its digits (compare Z. Drmac and K.
    Veselic, SIAM J. Matrix Anal. Appl. 29, 1322, 2008).

    Returns
    -------
    turned_matrices : (n_matrices, n, n), Q^H A V, with the singular values and right singular
        vectors of A V.
    right : (n_matrices, n, n), V, unitary.
    """
    size = np.max(np.abs(matrices), axis=1)
    order = np.argsort(-size, axis=1, kind="stable")
    sorted_matrices = np.take_along_axis(matrices, order[:, None], 2)
    triangles = np.asarray(np.linalg.qr(_pad_rows(sorted_matrices), mode="r"))
    unitary_factor, upper_factor = np.linalg.qr(triangles.swapaxes(1, 2).conj())
    lower_factor = upper_factor.swapaxes(1, 2).conj()
    block_vectors = np.zeros_like(unitary_factor)
    blocks = _number_blocks(np.take_along_axis(size, order, 1))
    # matrices whose columns fall into the same blocks are decomposed together
    for numbers in np.unique(blocks, axis=0):
        equal_blocks = np.flatnonzero(np.all(blocks == numbers, axis=1))
        for block in range(numbers[-1] + 1):
            columns = np.flatnonzero(numbers == block)
            diagonal = np.ix_(equal_blocks, columns, columns)
            _, block_vectors[diagonal] = lapack_svd(lower_factor[diagonal])
    right = unitary_factor @ block_vectors
    # rows of V go back to the order that the columns of A had
    original_order = np.argsort(order, axis=1)[:, :, None]
    return triangles @ right, np.take_along_axis(right, original_order, 1)


def _number_blocks(sizes: NDArray[np.float64]) -> NDArray[np.intp]:
    """Return the number (n_matrices, n) of the block of each column, from the ``sizes``
    (n_matrices, n) of columns in descending order.

    A new block begins with each column that is far smaller than the first of the block before.
    """
    blocks = np.zeros(sizes.shape, np.intp)
    first = sizes[:, 0].copy()
    for column in range(1, sizes.shape[1]):
        is_smaller = sizes[:, column] < _COMPARABLE_RATIO * first
        first[is_smaller] = sizes[is_smaller, column]
        blocks[:, column] = blocks[:, column - 1] + is_smaller
    return blocks


def _pad_rows(matrices: NDArray[Any]) -> NDArray[Any]:
    """Return ``matrices`` (n_matrices, m, n) with rows of zeros added, if m is less than n, until
    there are n rows: a decomposition then has n singular values.
    """
    n_lacking = max(0, matrices.shape[2] - matrices.shape[1])
    return np.pad(matrices, ((0, 0), (0, n_lacking), (0, 0))) if n_lacking else matrices


def jacobi_svd(matrices: NDArray[Any]) -> tuple[NDArray[np.float64], NDArray[Any]]:
    """Return singular values and right singular vectors of a stack of m x n matrices with few
    columns, by plane rotations of their columns (Jacobi iteration).

    Parameters
    ----------
    matrices : (..., m, n), real or complex; m and n are above zero.

    Returns
    -------
    values : (..., n), ascending, never negative, each accurate to rounding for graded columns.
    right : (..., n, n), unitary; its columns are the right singular vectors.

    Raises
    ------
    RuntimeError : the iteration does not converge; for finite matrices it always converges.
    """
    shape = matrices.shape[:-2]
    m, n = matrices.shape[-2:]
    a = np.moveaxis(matrices.reshape(-1, m, n), 0, -1).swapaxes(0, 1)  # (n, m, n_matrices)
    # a common scale keeps the squared norms in range
    scale = np.max(np.abs(a), axis=(0, 1))
    scale[scale == 0.0] = 1.0
    if n == 1:  # the only singular value is the length of the column
        scaled_column = np.divide(a, scale, order="C")
        length = np.sqrt(np.einsum("nmb,nmb->nb", scaled_column, scaled_column.conj()).real) * scale
        ones = np.ones((*shape, 1, 1), np.result_type(matrices.dtype, np.float64))
        return length.reshape(*shape, 1), ones
    # axes: column first, batch last, so that each rotation works on contiguous rows. Below each
    # column of A is the matching column of the right singular vectors
    columns = np.zeros((n, m + n, a.shape[-1]), np.result_type(matrices.dtype, np.float64))
    columns[:, :m] = a / scale
    columns[np.arange(n), m + np.arange(n)] = 1.0
    for _ in range(_MOST_SWEEPS):
        were_turned = False
        for p, r in itertools.combinations(range(n), 2):
            were_turned |= _rotate(columns[p], columns[r], m)
        if not were_turned:
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
    """Turn the columns ``first`` and ``second`` (rows, n_matrices) of each matrix, in place, such
    that the two columns are orthogonal over their first m rows; the rows below turn with them.
    Return whether any pair was not orthogonal before.
    """
    # the squares of the lengths of both columns, and their product
    adjoint = first[:m].conj()
    alpha = np.einsum("mb,mb->b", adjoint, first[:m]).real
    beta = np.einsum("mb,mb->b", second[:m].conj(), second[:m]).real
    gamma = np.einsum("mb,mb->b", adjoint, second[:m])
    size = np.abs(gamma)
    # the rounding of the product of orthogonal columns is a few epsilon. A column shorter than
    # _COLUMN_ROUNDING is the rounding error of a dependent column, and is not turned
    is_oblique = size > 4.0 * _EPSILON * np.sqrt(alpha) * np.sqrt(beta)
    is_oblique &= np.minimum(alpha, beta) > _COLUMN_ROUNDING**2
    if not np.any(is_oblique):
        return False
    # the tangent t of the angle is the smaller root of t^2 + 2 zeta t = 1
    divisor = np.where(is_oblique, size, 1.0)
    zeta = np.where(is_oblique, 0.5 * (beta - alpha) / divisor, 0.0)
    smaller_root = np.where(zeta >= 0.0, 1.0, -1.0) / (np.abs(zeta) + np.hypot(1.0, zeta))
    tangent = np.where(is_oblique, smaller_root, 0.0)
    cosine = 1.0 / np.hypot(1.0, tangent)
    sine = cosine * tangent
    # the second column in phase with the first, so that their product is real
    in_phase = second * np.where(is_oblique, gamma / divisor, 1.0).conj()
    new_first = cosine * first - sine * in_phase
    second[...] = sine * first + cosine * in_phase
    first[...] = new_first
    return True


def cholesky_factor(matrices: NDArray[Any]) -> NDArray[Any]:
    """Return L^H (..., n, n) of Hermitian positive semidefinite matrices D = L L^H (..., n, n), for
    :func:`jacobi_svd`.

    Each matrix is first scaled to a unit diagonal, so that small eigenvalues of a graded matrix
    keep their digits. Where an entry of the diagonal is zero, its row and column are taken for
    zero, and stay so. Raises :class:`numpy.linalg.LinAlgError` if a matrix
    has a diagonal entry below zero, or after scaling an eigenvalue below zero by more than
    rounding.
    """
    diagonal = np.einsum("...ii->...i", matrices).real
    if np.any(diagonal < 0.0):
        raise np.linalg.LinAlgError("negative diagonal")
    root = np.sqrt(diagonal)
    has_row = root > 0.0
    inverse = np.where(has_row, 1.0 / np.where(has_row, root, 1.0), 0.0)
    scaled_matrices = matrices * inverse[..., :, None] * inverse[..., None, :]
    index = np.arange(matrices.shape[-1])
    scaled_matrices[..., index, index] = 1.0
    lower_factor = _find_lower(scaled_matrices)
    return np.asarray((root[..., :, None] * lower_factor).swapaxes(-1, -2).conj())


def _find_lower(matrices: NDArray[Any]) -> NDArray[Any]:
    """Return L (..., n, n) of ``matrices`` L L^H (..., n, n) with unit diagonals. L is triangular
    unless its matrix is singular, and is then made of eigenvectors.

    Raises :class:`numpy.linalg.LinAlgError` for a negative eigenvalue that is more than rounding.
    """
    try:
        return np.asarray(np.linalg.cholesky(matrices))
    except np.linalg.LinAlgError:
        if matrices.ndim > 2:
            # one by one, so that a singular matrix does not change the results of the others
            return np.stack([_find_lower(matrix) for matrix in matrices])
        eigenvalues, vectors = np.linalg.eigh(matrices)
        if eigenvalues[0] < -_NEGATIVE_ROUNDING * len(eigenvalues):
            raise
        return np.asarray(vectors * np.sqrt(np.maximum(eigenvalues, 0.0)))


def find_rank(rows: NDArray[Any]) -> int:
    """Return the rank of ``rows`` (m, n), after each column and then each row has been scaled to
    length one, so that small ones count as much as large ones.
    """
    scaled_rows = rows
    for axis in (0, 1):
        length = np.linalg.norm(scaled_rows, axis=axis, keepdims=True)
        scaled_rows = scaled_rows / np.where(length > 0.0, length, 1.0)
    if not scaled_rows.size:
        return 0
    if is_independent(scaled_rows):
        return int(scaled_rows.shape[1])
    # rows of length one have a singular value of one or more; rows of zeros alone have rank zero
    singular_values = np.linalg.svd(scaled_rows, compute_uv=False)
    return int(np.count_nonzero(singular_values > DEPENDENCE * max(singular_values[0], 1.0)))


def is_independent(rows: NDArray[Any]) -> bool:
    """Return whether the columns of A = ``rows`` (m, n) are many and independent by far, such that
    a singular value decomposition is not needed.

    The columns are independent by far if A^H A, less a small part of its norm on the diagonal, is
    positive definite, that is, if a Cholesky decomposition succeeds.
    """
    n_rows, n_columns = rows.shape
    if not n_rows >= n_columns > MANY_COLUMNS:
        return False
    product = rows.conj().T @ rows
    product[np.diag_indices(n_columns)] -= _LEAST_INDEPENDENCE * np.linalg.norm(product)
    try:
        np.linalg.cholesky(product)
    except np.linalg.LinAlgError:
        return False
    return True


def find_dependent(
    rows: NDArray[Any], sizes: NDArray[np.float64]
) -> tuple[NDArray[Any], NDArray[Any]]:
    """Return orthonormal vectors (n, k) that a matrix ``rows`` (m, n), n above zero, takes to zero,
    and orthonormal vectors (n, n - k) that complete them to a basis.

    ``sizes`` (m, n) are the sizes that the entries of the matrix would have if nothing cancelled in
    them. Each column and then each row of the matrix is divided by its length in ``sizes``, so that
    small columns count as much as large ones, and entries that are rounding errors stay small.
    """
    lengths = np.linalg.norm(sizes, axis=0)
    lengths[lengths == 0.0] = 1.0
    row_lengths = np.linalg.norm(sizes / lengths, axis=1, keepdims=True)
    scaled_rows = rows / lengths / np.where(row_lengths > 0.0, row_lengths, 1.0)
    n = len(lengths)
    if is_independent(scaled_rows):
        return np.zeros((n, 0), rows.dtype), np.eye(n, dtype=rows.dtype)
    padded_rows = _pad_rows(scaled_rows[None])[0]
    range_basis, singular_values, adjoint = np.linalg.svd(padded_rows, full_matrices=False)
    rank = int(np.count_nonzero(singular_values > DEPENDENCE * max(singular_values[0], 1.0)))
    n_null = len(singular_values) - rank
    null_vectors, _ = np.linalg.qr(adjoint[rank:].conj().T / lengths[:, None])
    # division by the lengths amplifies the error of some vectors, which are then not quite taken to
    # zero: the least change of the scaled vectors that removes their residuals is subtracted
    residuals = scaled_rows @ (lengths[:, None] * null_vectors)
    amplitudes = range_basis[: len(rows), :rank].conj().T @ residuals / singular_values[:rank, None]
    correction = adjoint[:rank].conj().T @ amplitudes / lengths[:, None]
    basis, _ = np.linalg.qr(null_vectors - correction, mode="complete")
    return basis[:, :n_null], basis[:, n_null:]


def bound_lowest(matrices: NDArray[Any]) -> NDArray[np.float64]:
    """Return bounds (n,) of the lowest eigenvalues of symmetric ``matrices`` (m, m, n), which are
    not below the bounds: the least difference, over the rows of a matrix, of the entry on the
    diagonal and the sizes of the other entries of its row (Gershgorin's circles).
    """
    on_diagonal = np.einsum("aan->an", matrices)
    in_rows = np.sum(np.abs(matrices), axis=1)
    return np.asarray(np.min(on_diagonal - (in_rows - np.abs(on_diagonal)), axis=0))


def invert_hermitian(matrices: NDArray[Any]) -> NDArray[Any]:
    """Return the inverses of Hermitian ``matrices`` (..., n, n), n above zero, in their own
    precision; where one is singular, its pseudoinverse, which is zero on the null space.

    A matrix is singular if its largest element times that of its inverse is above 1/1e-14, and the
    null space has the eigenvalues of up to 1e-14 of the largest. The tolerance is that of double
    precision.
    """
    try:
        inverse = np.linalg.inv(matrices)
    except np.linalg.LinAlgError:  # some matrix is exactly singular, and so all are tested below
        inverse = np.full_like(matrices, np.inf)
    size = np.max(np.abs(matrices), axis=(-2, -1))
    size_of_inverse = np.max(np.abs(inverse), axis=(-2, -1))
    with np.errstate(invalid="ignore"):  # a matrix of zeros, whose inverse is infinite, gives nan
        is_singular = ~(size * size_of_inverse * _SINGULARITY <= 1.0)
    if np.any(is_singular):
        inverse[is_singular] = np.linalg.pinv(
            matrices[is_singular], rcond=_SINGULARITY, hermitian=True
        )
    return np.asarray(inverse)


@contextmanager
def lanczos_converges() -> Iterator[None]:
    """Raise :class:`~granphon.base.errors.ConvergenceError` in place of an error of ARPACK within
    the with-block: the iteration has then ended without the modes.
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
    """Return the eigenvalues (count,), ascending, of a sparse Hermitian ``matrix`` (n, n) that are
    nearest to ``shift``, and their eigenvectors (n, count), by Lanczos's method, or by Arnoldi's if
    the matrix is complex.

    ``solve`` multiplies a vector by the inverse of the matrix less the shift. ``start`` (n,) is the
    first vector of the iteration, which must have a part along each eigenvector; by default its
    entries are random. Raises :class:`~granphon.base.errors.ConvergenceError` if the iteration does
    not end.
    """
    from scipy.sparse.linalg import LinearOperator, eigsh

    if start is None:
        # the same random vector each time, so that results can be repeated
        start = np.random.default_rng(0).normal(size=matrix.shape[0]).astype(matrix.dtype)
    inverse = LinearOperator(matrix.shape, matvec=solve, dtype=matrix.dtype)
    values, vectors = eigsh(matrix, k=count, sigma=shift, OPinv=inverse, v0=start)
    order = np.argsort(values)  # Arnoldi's method returns the eigenvalues in no order
    return values[order], vectors[:, order]
