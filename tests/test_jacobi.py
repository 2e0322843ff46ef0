"""Singular values to high relative accuracy."""

from __future__ import annotations

import mpmath
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from numpy.testing import assert_allclose

from granphon.jacobi import cholesky_factor, jacobi_svd


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
    values, _, _ = jacobi_svd(graded[None])
    for value, exact in zip(values[0], exact_values(graded), strict=True):
        # Demmel and Veselic: the relative error is rounding times the condition of the unit columns, however graded
        assert abs(value / exact - 1) < 4e-15 * condition


@given(seed=st.integers(0, 2**31), n=st.integers(1, 6), complex_entries=st.booleans(), scale=st.floats(-140, 140))
def test_factors_are_unitary_and_reassemble_the_matrix(seed, n, complex_entries, scale):
    a = draw(seed, (5, 8, n), complex_entries) * 10.0**scale
    values, right, left = jacobi_svd(a)
    size = np.abs(a).max()
    assert_allclose((left * values[:, None, :]) @ right.conj().swapaxes(1, 2) / size, a / size, atol=2e-14)
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
    values, right, left = jacobi_svd(a)
    assert_allclose(values, [[0, 0, np.sqrt(10.0)], [0, 0, 0]], atol=1e-15)
    assert_allclose(right.swapaxes(1, 2) @ right, np.broadcast_to(np.eye(3), (2, 3, 3)), atol=1e-15)
    assert np.all(left[1] == 0.0)


def test_a_stack_of_any_shape_and_a_single_matrix():
    a = draw(1, (2, 3, 6, 3), False)
    values, right, left = jacobi_svd(a)
    assert values.shape == (2, 3, 3)
    assert right.shape == (2, 3, 3, 3)
    assert left.shape == (2, 3, 6, 3)
    alone, _, _ = jacobi_svd(a[1, 2])
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
    values, _, _ = jacobi_svd(factor[None])
    for value, exact in zip(values[0], exact_values(graded), strict=True):
        assert abs(value / exact - 1) < 1e-14 * condition**2


def test_cholesky_factor_keeps_zero_rows_and_refuses_negative_matrices():
    square = np.array([[[2.0, 0.0], [0.0, 0.0]]])
    assert_allclose(cholesky_factor(square), [[[np.sqrt(2.0), 0.0], [0.0, 0.0]]], rtol=1e-15)
    for bad in ([[1.0, 2.0], [2.0, 1.0]], [[-1.0, 0.0], [0.0, 1.0]]):
        with pytest.raises(np.linalg.LinAlgError):
            cholesky_factor(np.array([bad]))
