"""Singular values to high relative accuracy."""

from __future__ import annotations

import mpmath
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from numpy.testing import assert_allclose

import granphon as gp
from granphon.dynamics import linalg as jacobi
from granphon.dynamics.linalg import cholesky_factor, graded_svd, jacobi_svd, lapack_svd


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
    seed=st.integers(0, 2**31), rows=st.integers(3, 7), complex_entries=st.booleans(),
    grades=st.lists(st.floats(-25.0, 5.0), min_size=2, max_size=3),
)  # fmt: skip
def test_graded_columns_keep_every_digit(seed, rows, complex_entries, grades):
    a = draw(seed, (rows, len(grades)), complex_entries)
    condition = np.linalg.cond(a / np.linalg.norm(a, axis=0))
    graded = a * 10.0 ** np.array(grades)
    values, _ = jacobi_svd(graded[None])
    for value, exact in zip(values[0], exact_values(graded), strict=True):
        # Demmel and Veselic: the relative error is rounding times the condition of the unit columns, however graded
        assert abs(value / exact - 1) < 4e-15 * condition


@given(seed=st.integers(0, 2**31), n=st.integers(1, 6), complex_entries=st.booleans(), scale=st.floats(-140, 140))
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
    assert_allclose(values[:, ::-1], np.linalg.svd(a, compute_uv=False), rtol=0, atol=1e-14 * values.max())


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


def test_a_stack_of_any_shape_and_a_single_matrix():
    a = draw(1, (2, 3, 6, 3), False)
    values, right = jacobi_svd(a)
    assert values.shape == (2, 3, 3)
    assert right.shape == (2, 3, 3, 3)
    alone, _ = jacobi_svd(a[1, 2])
    assert_allclose(alone, values[1, 2], rtol=1e-15)


def test_input_is_left_alone():
    a = draw(2, (4, 5, 3), True)
    kept = a.copy()
    jacobi_svd(a)
    assert np.array_equal(a, kept)
    square = a.conj().swapaxes(1, 2) @ a
    kept = square.copy()
    cholesky_factor(square)
    assert np.array_equal(square, kept)


@pytest.mark.parametrize("n", range(1, 14))
def test_a_tournament_meets_every_pair_once_and_no_column_twice_in_a_round(n):
    pairs = []
    for first, second in jacobi._rounds(n):
        one, other = (np.arange(n)[columns].tolist() for columns in (first, second))
        assert len({*one, *other}) == 2 * len(one)
        pairs += list(zip(one, other, strict=True))
    assert sorted(pairs) == [(p, r) for p in range(n) for r in range(p + 1, n)]


# -- LAPACK where it loses nothing ------------------------------------------------------------------------------------


@pytest.fixture
def iterated(monkeypatch):
    """How many matrices the iteration was given."""
    counts = []

    def counting(matrices):
        counts.append(len(matrices))
        return jacobi_svd(matrices)

    monkeypatch.setattr(jacobi, "jacobi_svd", counting)
    return counts


def kagome(scales, **terms):
    """K^1/2 C M^-1/2, or its stand-in under prestress, of kagome at wave vectors of many sizes."""
    rng = np.random.default_rng(5)
    lattice = gp.ContactLattice.of("kagome", 0.84, **terms)
    return lattice._factor(rng.normal(size=(len(scales), 2)) * scales[:, None])


@pytest.mark.claim("lapack-or-jacobi")
@pytest.mark.parametrize("terms", [{}, {"spacing": 0.98, "prestress": 0.0136}])
def test_both_ways_agree_where_they_overlap(terms, iterated):
    a = kagome(10.0 ** np.linspace(-4, 0.3, 400), **terms)
    values, right = graded_svd(a)
    expected, vectors = jacobi_svd(a)
    count = sum(iterated)
    assert 50 < count < 350
    assert_allclose(values, expected, rtol=1e-13)
    # every value at which LAPACK is far enough from the next keeps its vector, but for a phase
    apart = np.diff(expected, axis=1, prepend=-1.0, append=100.0)
    alone = np.minimum(apart[:, :-1], apart[:, 1:]) > 0.05
    overlap = np.abs(np.einsum("qmb,qmb->qb", vectors.conj(), right))
    assert np.count_nonzero(alone) > 1000
    assert_allclose(overlap[alone], 1.0, atol=1e-14)
    # where it was asked alone, LAPACK would have been beyond the tolerance somewhere
    assert np.max(np.abs(lapack_svd(a)[0] / expected - 1)) > 1e-13


def test_degenerate_sets_have_one_projector():
    # at K kagome has sets of two; at Gamma the limit of all optical ones
    lattice = gp.ContactLattice.of("kagome", 0.84)
    q = np.concatenate([lattice.wavevectors([[1 / 3, 1 / 3], [2 / 3, -1 / 3]]), [[1e-30, 2e-30]]])
    a = lattice._factor(q)
    (values, right), (expected, vectors) = graded_svd(a), jacobi_svd(a)
    assert_allclose(values, expected, rtol=1e-13)
    sets = 0
    for point, found in enumerate(expected):
        for chosen in np.split(np.arange(9), np.flatnonzero(np.diff(found) > 1e-6 * found[1:]) + 1):
            sets += len(chosen) > 1
            one, other = (v[point][:, chosen] @ v[point][:, chosen].conj().T for v in (right, vectors))
            assert_allclose(one, other, atol=2e-13)
    assert sets >= 4


@pytest.mark.claim("lapack-or-jacobi")
def test_only_graded_columns_that_lose_digits_are_done_again(iterated):
    # well conditioned; graded; singular though its columns are alike, where the iteration gains nothing
    plain = draw(7, (3, 12, 6), True)
    graded = plain * [1.0, 1.0, 1e-9, 1.0, 1.0, 1e-5]
    singular = plain.copy()
    singular[..., 5] = singular[..., 0] + singular[..., 1]
    graded_svd(np.concatenate([plain, singular]))
    assert iterated == []
    values, right = graded_svd(np.concatenate([plain, graded, singular]))
    assert iterated == [3]
    assert_allclose(values[3:6], jacobi_svd(graded)[0], rtol=1e-14)
    assert_allclose(right.conj().swapaxes(1, 2) @ right, np.broadcast_to(np.eye(6), (9, 6, 6)), atol=5e-15)
    # what a matrix gets does not depend on its company
    assert np.array_equal(values[4], graded_svd(graded[1:2])[0][0])


def test_columns_of_zeros_and_few_rows_leave_free_motions(iterated):
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
    assert iterated == []
    assert np.all(graded_svd(np.zeros((2, 6, 5)))[0] == 0.0)


@given(
    seed=st.integers(0, 2**31), complex_entries=st.booleans(), grades=st.lists(st.floats(-20.0, 5.0), min_size=3, max_size=3)
)
def test_cholesky_factor_of_a_graded_matrix(seed, complex_entries, grades):
    a = draw(seed, (6, 3), complex_entries)
    condition = np.linalg.cond(a / np.linalg.norm(a, axis=0))
    graded = a * 10.0 ** np.array(grades)
    square = graded.conj().T @ graded
    factor = cholesky_factor(square[None])[0]
    assert_allclose(factor.conj().T @ factor / square.real.max(), square / square.real.max(), atol=1e-14)
    values, _ = jacobi_svd(factor[None])
    for value, exact in zip(values[0], exact_values(graded), strict=True):
        assert abs(value / exact - 1) < 1e-14 * condition**2


def test_cholesky_factor_keeps_zero_rows_and_refuses_negative_matrices():
    square = np.array([[[2.0, 0.0], [0.0, 0.0]]])
    assert_allclose(cholesky_factor(square), [[[np.sqrt(2.0), 0.0], [0.0, 0.0]]], rtol=1e-15)
    for bad in ([[1.0, 2.0], [2.0, 1.0]], [[-1.0, 0.0], [0.0, 1.0]]):
        with pytest.raises(np.linalg.LinAlgError):
            cholesky_factor(np.array([bad]))
