"""Singular values to high relative accuracy."""

from __future__ import annotations

import math

import mpmath
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from numpy.testing import assert_allclose

import granphon as gp
from granphon.dynamics import linalg
from granphon.dynamics.blocks import factorise
from granphon.dynamics.linalg import (
    cholesky_factor,
    graded_svd,
    invert_hermitian,
    jacobi_svd,
    lapack_svd,
)


def exact_values(matrix):
    """Singular values at 80 digits, ascending, from the eigenvalues of the Gram matrix."""
    with mpmath.workdps(80):
        a = mpmath.matrix([[mpmath.mpc(complex(x)) for x in row] for row in matrix])
        squares = mpmath.eighe(a.H * a, eigvals_only=True)
        return sorted(mpmath.sqrt(abs(x)) for x in squares)


def draw(seed, shape, complex_entries):
    rng = np.random.default_rng(seed)
    a = rng.normal(size=shape)
    return a + 1j * rng.normal(size=shape) if complex_entries else a


@given(
    seed=st.integers(0, 2**31),
    rows=st.integers(3, 7),
    complex_entries=st.booleans(),
    grades=st.lists(st.floats(-25.0, 5.0), min_size=2, max_size=3),
)
def test_graded_columns_keep_every_digit(seed, rows, complex_entries, grades):
    a = draw(seed, (rows, len(grades)), complex_entries)
    condition = np.linalg.cond(a / np.linalg.norm(a, axis=0))
    graded = a * 10.0 ** np.array(grades)
    values, _ = jacobi_svd(graded[None])
    for value, exact in zip(values[0], exact_values(graded), strict=True):
        # Demmel and Veselic: the relative error is rounding times the condition of the unit
        # columns, however graded
        assert abs(value / exact - 1) < 4e-15 * condition


@given(
    seed=st.integers(0, 2**31),
    n=st.integers(1, 6),
    complex_entries=st.booleans(),
    scale=st.floats(-140, 140),
)
def test_right_vectors_are_unitary_and_make_orthogonal_columns(seed, n, complex_entries, scale):
    a = draw(seed, (5, 8, n), complex_entries) * 10.0**scale
    values, right = jacobi_svd(a)
    size = np.abs(a).max()
    turned = a @ right
    assert_allclose(np.linalg.norm(turned, axis=1) / size, values / size, atol=2e-14)
    left = turned / values[:, None, :]
    one = np.broadcast_to(np.eye(n), (5, n, n))
    assert_allclose(right.conj().swapaxes(1, 2) @ right, one, atol=5e-15)
    assert_allclose(left.conj().swapaxes(1, 2) @ left, one, atol=5e-15 * np.linalg.cond(a).max())
    assert np.all(np.diff(values, axis=1) >= 0.0)
    assert_allclose(
        values[:, ::-1], np.linalg.svd(a, compute_uv=False), rtol=0, atol=1e-14 * values.max()
    )


def test_lapack_loses_what_jacobi_keeps():
    # the reason for the module: two columns 1e-12 of the third, as near Gamma
    a = draw(3, (20, 6, 3), False) * [1e-12, 1e-12, 1.0]
    exact = np.array([[float(x) for x in exact_values(matrix)] for matrix in a])
    assert np.max(np.abs(jacobi_svd(a)[0] / exact - 1)) < 2e-15
    assert np.max(np.abs(np.linalg.svd(a, compute_uv=False)[:, ::-1] / exact - 1)) > 1e-7


def test_dependent_and_empty_columns_give_zero():
    a = np.array([[[1.0, 0.0, 2.0], [1.0, 0.0, 2.0]], [[0.0, 0.0, 0.0], [0.0, 0.0, 0.0]]])
    values, right = jacobi_svd(a)
    assert_allclose(values, [[0, 0, np.sqrt(10.0)], [0, 0, 0]], atol=1e-15)
    assert_allclose(right.swapaxes(1, 2) @ right, np.broadcast_to(np.eye(3), (2, 3, 3)), atol=1e-15)


# -- LAPACK where it loses nothing -----------------------------------------------------------------


@pytest.fixture
def counts(monkeypatch):
    """How many matrices were taken for graded ones that LAPACK does not serve."""
    found = []
    precondition = linalg._precondition

    def counting(matrices):
        found.append(len(matrices))
        return precondition(matrices)

    monkeypatch.setattr(linalg, "_precondition", counting)
    return found


def factors(lattice, q):
    """K^1/2 C M^-1/2, or its stand-in under prestress."""
    return (
        factorise(lattice._compute_frame_matrix(q))
        if lattice.is_prestressed
        else lattice._deforming.compute_rows(q)
    )


def kagome(scales, **terms):
    """Factors of kagome at wave vectors of many sizes."""
    rng = np.random.default_rng(5)
    return factors(
        gp.ContactLattice.of("kagome", 0.84, **terms),
        rng.normal(size=(len(scales), 2)) * scales[:, None],
    )


@pytest.mark.claim("lapack-or-jacobi")
@pytest.mark.parametrize(
    ("terms", "tolerance"), [({}, 1e-14), ({"spacing": 0.98, "prestress": 0.0136}, 2e-14)]
)
def test_all_ways_agree_where_they_overlap(terms, tolerance, counts):
    a = kagome(10.0 ** np.linspace(-8, 0.3, 400), **terms)
    values, right = graded_svd(a)
    expected, vectors = jacobi_svd(a)
    assert 50 < sum(counts) < 350
    assert_allclose(values, expected, rtol=tolerance)
    # every value at which LAPACK is far enough from the next keeps its vector, but for a phase
    apart = np.diff(expected, axis=1, prepend=-1.0, append=100.0)
    alone = np.minimum(apart[:, :-1], apart[:, 1:]) > 0.05
    overlap = np.abs(np.einsum("qmb,qmb->qb", vectors.conj(), right))
    assert np.count_nonzero(alone) > 1000
    assert_allclose(overlap[alone], 1.0, atol=1e-14)
    # alone, LAPACK would have been beyond the tolerance somewhere
    assert np.max(np.abs(lapack_svd(a)[0] / expected - 1)) > 1e-13


def test_degenerate_sets_have_one_projector():
    # at K kagome has sets of two; at Gamma the limit of all optical ones
    lattice = gp.ContactLattice.of("kagome", 0.84)
    q = np.concatenate([lattice.wavevectors([[1 / 3, 1 / 3], [2 / 3, -1 / 3]]), [[1e-30, 2e-30]]])
    a = factors(lattice, q)
    (values, right), (expected, vectors) = graded_svd(a), jacobi_svd(a)
    assert_allclose(values, expected, rtol=1e-13)
    sets = 0
    for point, found in enumerate(expected):
        for chosen in np.split(np.arange(9), np.flatnonzero(np.diff(found) > 1e-6 * found[1:]) + 1):
            sets += len(chosen) > 1
            one, other = (
                v[point][:, chosen] @ v[point][:, chosen].conj().T for v in (right, vectors)
            )
            assert_allclose(one, other, atol=2e-13)
    assert sets >= 4


@pytest.mark.claim("lapack-or-jacobi")
def test_only_graded_columns_that_lose_digits_are_done_again(counts):
    # well conditioned; graded; singular though its columns are alike, where the iteration gains
    # nothing
    plain = draw(7, (3, 12, 6), True)
    graded = plain * [1.0, 1.0, 1e-9, 1.0, 1.0, 1e-5]
    singular = plain.copy()
    singular[..., 5] = singular[..., 0] + singular[..., 1]
    graded_svd(np.concatenate([plain, singular]))
    assert counts == []
    values, right = graded_svd(np.concatenate([plain, graded, singular]))
    assert counts == [3]
    assert_allclose(values[3:6], jacobi_svd(graded)[0], rtol=1e-14)
    assert_allclose(
        right.conj().swapaxes(1, 2) @ right, np.broadcast_to(np.eye(6), (9, 6, 6)), atol=5e-15
    )
    # what a matrix gets does not depend on its company
    assert np.array_equal(values[4], graded_svd(graded[1:2])[0][0])


@given(
    seed=st.integers(0, 2**31),
    rows=st.integers(3, 16),
    complex_entries=st.booleans(),
    grades=st.lists(st.floats(-25.0, 5.0) | st.sampled_from([-20.0, 0.0]), min_size=4, max_size=8),
)
def test_many_graded_columns_keep_every_digit(seed, rows, complex_entries, grades):
    n = len(grades)
    a = draw(seed, (1, rows, n), complex_entries)
    graded = a * 10.0 ** np.array(grades)
    values, right = graded_svd(graded)
    assert_allclose(right.conj().swapaxes(1, 2) @ right, np.eye(n)[None], atol=1e-14)
    assert np.all(np.diff(values) >= 0.0)
    assert np.all(values >= 0.0)
    if rows < n:  # free motions: what they get is rounding
        return
    condition = np.linalg.cond(a[0] / np.linalg.norm(a[0], axis=0))
    for value, exact in zip(values[0], exact_values(graded[0]), strict=True):
        assert abs(value / exact - 1) < 1e-14 * condition
    # columns keep the directions too: A V is orthogonal, however small
    turned = graded @ right / values[:, None]
    assert_allclose(turned.conj().swapaxes(1, 2) @ turned, np.eye(n)[None], atol=3e-14 * condition)


@pytest.mark.parametrize("size", [1e-2, 1e-6, 1e-12, 1e-30])
@pytest.mark.parametrize(("m", "n"), [(3, 2), (4, 4)])
def test_cells_of_many_balls_keep_every_digit_near_gamma(m, n, size, counts):
    # 18 and 48 branches: those of one ball, folded
    one = gp.ContactLattice.of("triangular", 0.84)
    sites = [(i / m, j / n) for i in range(m) for j in range(n)]
    many = gp.ContactLattice.of(
        gp.Lattice("many", (np.diag([m, n]) @ one.cell).tolist(), sites), 0.84
    )
    q = size * np.array([[0.6, 0.8], [-0.3, 0.1], [1.0, 0.0]])
    assert many.n_branches == 3 * m * n
    folds = np.array([(i, j) for i in range(m) for j in range(n)]) @ many.reciprocal
    expected = np.sort(
        np.concatenate([one.frequencies(q + fold) for fold in folds], axis=1), axis=1
    )
    found, modes, alone = many.frequencies(q), many.modes(q), one.modes(q)
    assert_allclose(found, expected, rtol=2e-14)
    for sound in (found, modes.frequencies):
        assert_allclose(sound[:, :2], alone.frequencies[:, :2], rtol=1e-14)
    assert_allclose(modes.group_velocities[:, :2], alone.group_velocities[:, :2], atol=1e-13)
    assert (sum(counts) > 0) == (size < 1e-5)


@pytest.mark.parametrize("part", [0.02, 0.064, 0.085, 0.1])
def test_vectors_near_an_avoided_crossing_lose_what_the_gap_takes(part):
    # kagome on K-M, where two branches come within 0.1 % of the highest frequency of each other
    lattice = gp.ContactLattice.of("kagome", 2 * (1 - 0.276) / (2 - 0.276))
    a = lattice._deforming.compute_rows(lattice.wavevectors([[1 / 3 + part / 2, 1 / 3 - part]]))
    values, right = graded_svd(a)
    with mpmath.workdps(50):
        rows = mpmath.matrix(a[0].tolist())
        squares, vectors = mpmath.eigsy(rows.T * rows)
        order = sorted(range(9), key=lambda i: squares[i])
        exact = np.array([[float(vectors[r, i]) for i in order] for r in range(9)])
    exact *= np.sign(np.sum(exact * right[0], axis=0))
    gap = np.min(np.diff(values[0])) / values.max()
    assert 5e-4 < gap < 2e-2
    assert np.max(np.abs(right[0] - exact)) < 4 * np.finfo(float).eps / gap


def test_a_graded_matrix_that_is_singular_too(counts):
    # frictionless kagome has motions without cost at every wave vector; near Gamma sound is graded
    # besides
    chosen = gp.ContactLattice.of("kagome", 0.84)
    loose = gp.ContactLattice(chosen.cell, chosen.positions, chosen.contacts, 0.0)
    a = loose._deforming.compute_rows(np.array([[0.6, 0.8], [0.3, -0.1]]) * 1e-12)
    values, right = graded_svd(a)
    expected, _ = jacobi_svd(a)
    assert counts == [2]
    # a turn of the triangles, whose columns are not small, makes the condition 1e12
    assert np.all(expected[:, 2] < 1e-11)
    assert_allclose(values, expected, rtol=1e-14, atol=3e-16)
    assert_allclose(right.swapaxes(1, 2) @ right, np.broadcast_to(np.eye(6), (2, 6, 6)), atol=1e-14)


def test_columns_of_zeros_and_few_rows_leave_free_motions(counts):
    a = draw(8, (2, 3, 5), True)
    values, right = graded_svd(a)
    assert values.shape == (2, 5)
    assert_allclose(values[:, :2], 0.0, atol=1e-15)
    assert_allclose(np.linalg.norm(a @ right, axis=1), values, atol=1e-14)
    empty = draw(9, (2, 8, 5), True)
    empty[..., [1, 3]] = 0.0
    values, right = graded_svd(empty)
    assert np.all(values[:, :2] == 0.0)
    assert np.all(values[:, 2:] > 0.1)
    assert_allclose(np.abs(right[:, [1, 3], :2]).sum(axis=1) > 0.5, True)
    assert counts == []
    assert np.all(graded_svd(np.zeros((2, 6, 5)))[0] == 0.0)


@given(
    seed=st.integers(0, 2**31),
    complex_entries=st.booleans(),
    grades=st.lists(st.floats(-20.0, 5.0), min_size=3, max_size=3),
)
def test_cholesky_factor_of_a_graded_matrix(seed, complex_entries, grades):
    a = draw(seed, (6, 3), complex_entries)
    condition = np.linalg.cond(a / np.linalg.norm(a, axis=0))
    graded = a * 10.0 ** np.array(grades)
    square = graded.conj().T @ graded
    factor = cholesky_factor(square[None])[0]
    assert_allclose(
        factor.conj().T @ factor / square.real.max(), square / square.real.max(), atol=1e-14
    )
    values, _ = jacobi_svd(factor[None])
    for value, exact in zip(values[0], exact_values(graded), strict=True):
        assert abs(value / exact - 1) < 1e-14 * condition**2


def test_cholesky_factor_keeps_zero_rows_and_refuses_negative_matrices():
    square = np.array([[[2.0, 0.0], [0.0, 0.0]]])
    assert_allclose(cholesky_factor(square), [[[np.sqrt(2.0), 0.0], [0.0, 0.0]]], rtol=1e-15)
    for bad in ([[1.0, 2.0], [2.0, 1.0]], [[-1.0, 0.0], [0.0, 1.0]]):
        with pytest.raises(np.linalg.LinAlgError):
            cholesky_factor(np.array([bad]))


@pytest.mark.parametrize("complex_entries", [False, True])
def test_one_column_is_its_length(complex_entries):
    columns = draw(5, (2, 3, 4, 1), complex_entries) * np.array([1.0, 1e-200, 1e200])[:, None, None]
    columns[0, 0] = 0.0
    values, right = jacobi_svd(columns)
    exact = [[math.hypot(*np.abs(one).ravel().tolist()) for one in several] for several in columns]
    assert_allclose(values[..., 0], exact, rtol=1e-15)
    assert right.shape == (2, 3, 1, 1)
    assert np.all(right == 1.0)
    assert right.dtype == columns.dtype


@pytest.mark.parametrize("complex_entries", [False, True])
def test_nearest_eigenvalues_ascend_with_their_vectors(complex_entries):
    """Arnoldi's method, which serves complex matrices, returns eigenvalues in no order."""
    from scipy.sparse import csc_array, eye_array
    from scipy.sparse.linalg import splu

    rng = np.random.default_rng(1)
    matrix = rng.normal(size=(60, 60)) + 1j * complex_entries * rng.normal(size=(60, 60))
    matrix = matrix + matrix.conj().T if complex_entries else (matrix + matrix.T).real
    shift = 0.3
    factors = splu((csc_array(matrix) - shift * eye_array(60)).tocsc())
    values, vectors = linalg.find_nearest(csc_array(matrix), 6, shift, factors.solve)
    all_values = np.linalg.eigvalsh(matrix)
    nearest = all_values[np.argsort(np.abs(all_values - shift))[:6]]
    assert_allclose(values, np.sort(nearest), rtol=1e-10, atol=1e-12)
    assert_allclose(matrix @ vectors, values * vectors, atol=1e-10)


def test_the_inverse_of_a_singular_matrix_is_zero_where_the_matrix_is():
    one = np.array([[2.0, 1.0j], [-1.0j, 2.0]])
    flat = np.diag([0.0, 4.0]).astype(complex)
    inverses = invert_hermitian(np.stack([one, flat, np.zeros((2, 2))]))
    assert_allclose(inverses[0] @ one, np.eye(2), atol=1e-15)
    assert_allclose(inverses[1], np.diag([0.0, 0.25]), atol=1e-15)
    assert not np.any(inverses[2])


@pytest.mark.parametrize("m", [1, 2, 3, 6])
def test_eigenvalues_are_above_their_bounds(m):
    matrices = np.random.default_rng(m).normal(size=(m, m, 50))
    matrices += matrices.swapaxes(0, 1)
    matrices[..., 0] = 0.0
    matrices[..., 1] = np.diag(np.arange(m))  # bounds of diagonal matrices are eigenvalues
    lowest = np.linalg.eigvalsh(np.moveaxis(matrices, -1, 0))[:, 0]
    bounds = linalg.bound_lowest(matrices)
    assert np.all(bounds <= lowest + 1e-14 * m)
    np.testing.assert_array_equal(bounds[:2], 0.0)
