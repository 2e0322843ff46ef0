"""Factors of sparse matrices: against dense ones, by rslab and by SuperLU, which stands in for it."""

from __future__ import annotations

import sys
from itertools import pairwise

import numpy as np
import pytest
from numpy.testing import assert_allclose
from scipy.sparse import csc_array, eye_array

import granphon as gp
from granphon.dynamics.factors import Elimination, _LDLFactors, _LUFactors, factorise

UNITS = gp.Units(8e-3, 3e6, 2e-3)
HERTZ = UNITS.angular_frequency / (2.0 * np.pi)


@pytest.fixture(params=["rslab", "SuperLU"], autouse=True)
def library(request, monkeypatch):
    """The library by which symmetric matrices are factorised: SuperLU if rslab is not installed."""
    if request.param == "SuperLU":
        monkeypatch.setitem(sys.modules, "rslab", None)
    return request.param


def make(size=60, seed=0):
    """A symmetric matrix with eigenvalues on both sides of zero."""
    rng = np.random.default_rng(seed)
    is_entry = rng.random((size, size)) < 0.08
    entries = np.where(is_entry, rng.normal(size=(size, size)), 0.0)
    return csc_array(entries + entries.T + np.diag(rng.normal(size=size)))


def test_the_library_is_the_one_that_is_meant(library):
    kind = _LDLFactors if library == "rslab" else _LUFactors
    assert isinstance(factorise(make()), kind)
    assert isinstance(factorise(make(), symmetric=False), _LUFactors)


@pytest.mark.parametrize("right", ["real", "complex", "several", "several complex"])
@pytest.mark.parametrize("damped", [False, True])
def test_solutions_are_those_of_dense_matrices(right, damped):
    matrix = make()
    if damped:
        matrix = (matrix + 0.3j * make(seed=1)).tocsc()
    rng = np.random.default_rng(2)
    b = rng.normal(size=(60, 3) if "several" in right else 60)
    if "complex" in right:
        b = b + 1j * rng.normal(size=b.shape)
    wanted = np.linalg.solve(matrix.toarray(), b)
    condition = np.linalg.cond(matrix.toarray())
    for symmetric in (True, False):
        found = factorise(matrix, symmetric).solve(b)
        assert found.dtype == wanted.dtype
        assert_allclose(found, wanted, rtol=0.0, atol=1e-14 * condition * np.max(np.abs(wanted)))


def test_a_matrix_that_is_not_symmetric_is_solved():
    matrix = csc_array(make().toarray() * np.random.default_rng(3).uniform(0.5, 1.5, (60, 60)))
    b = np.arange(60.0)
    wanted = np.linalg.solve(matrix.toarray(), b)
    assert_allclose(factorise(matrix, symmetric=False).solve(b), wanted, rtol=1e-9)


@pytest.mark.parametrize("seed", range(5))
def test_eigenvalues_below_zero_are_counted(seed):
    matrix = make(seed=seed)
    values = np.linalg.eigvalsh(matrix.toarray())
    elimination = Elimination(matrix)
    for shift in (values[0] - 0.1, *(0.5 * (values[:-1] + values[1:]))[::7], values[-1] + 0.1):
        factors = elimination.factorise(matrix - shift * eye_array(60))
        assert factors.n_below == np.count_nonzero(values < shift)


def test_one_order_of_elimination_is_for_all_matrices_with_entries_at_its_places():
    matrix = make()
    elimination = Elimination(matrix)
    for factor in (1.0, -2.0, 3.0 + 1.0j):
        other = (factor * matrix).tocsc()
        found = elimination.factorise(other).solve(np.ones(60, other.dtype))
        assert_allclose(other @ found, np.ones(60), rtol=1e-9)


@pytest.mark.parametrize("is_approximate", [False, True])
def test_entries_may_be_stored_in_any_order(is_approximate):
    matrix = (make() + 20.0 * eye_array(60)).tocsc()
    matrix.sort_indices()
    starts = matrix.indptr
    columns = [np.arange(start, end)[::-1] for start, end in pairwise(starts)]
    order = np.concatenate(columns)
    turned = csc_array((matrix.data[order], matrix.indices[order], starts), shape=matrix.shape)
    found = Elimination(matrix, is_approximate).factorise(turned).solve(np.ones(60))
    digits = 1e-5 if is_approximate else 1e-12
    assert_allclose(matrix @ found, np.ones(60), rtol=digits)


def test_a_matrix_with_entries_at_other_places_is_refused_by_rslab(library):
    elimination = Elimination(make())
    other = make(seed=1)
    if library == "SuperLU":  # finds an order for each matrix
        assert_allclose(other @ elimination.factorise(other).solve(np.ones(60)), 1.0, rtol=1e-9)
        return
    with pytest.raises(ValueError, match="places"):
        elimination.factorise(other)


def test_approximate_factors_are_in_single_precision():
    matrix = make()
    positive = (matrix @ matrix.T + eye_array(60)).tocsc()
    b = np.arange(60.0)
    error = np.abs(
        factorise(positive, approximate=True).solve(b) / factorise(positive).solve(b) - 1.0
    )
    assert 1e-9 < np.max(error) < 1e-2


@pytest.mark.parametrize("symmetric", [True, False])
def test_approximate_factors_of_a_complex_matrix_are_complex(symmetric):
    matrix = csc_array(np.array([[2.0, 1.0j], [1.0j, 3.0]]))
    solution = factorise(matrix, symmetric, approximate=True).solve(np.array([1.0, 1.0]))
    assert solution.dtype == np.complex64
    assert_allclose(matrix @ solution, 1.0, rtol=1e-6)


def test_factors_solve_for_no_vectors():
    factors = factorise(eye_array(3, format="csc"))
    assert factors.solve(np.zeros((3, 0))).shape == (3, 0)


@pytest.mark.parametrize("symmetric", [True, False])
def test_a_singular_matrix_is_an_error(symmetric):
    matrix = csc_array(np.array([[1.0, -1.0], [-1.0, 1.0]]))
    with pytest.raises(RuntimeError):
        factorise(matrix, symmetric)


@pytest.mark.parametrize(
    ("name", "size"), [("square", (20, 20)), ("triangular", (20, 20)), ("chain", (1000,))]
)
def test_within_bands_factors_have_no_more_entries_than_below_them(name, size):
    """Pivots off the diagonal would fill the factors of damped matrices."""
    lattice = gp.ContactLattice.of(name, 0.5)
    operator = gp.Waves(lattice.contact_network(UNITS).repeat(size)).operator
    stiffness = operator.matrix / operator.top**2
    entries = []
    for w in np.linspace(0.05, 0.97, 12):
        unit = eye_array(operator.size)
        factors = factorise((stiffness * (1.0 + 0.01j) - w**2 * unit).tocsc())._factors
        entries.append(factors.factor_nnz if hasattr(factors, "factor_nnz") else factors.nnz)
    assert max(entries) < 1.5 * entries[0]


def test_waves_of_a_network_are_the_same_by_both(library):
    """Modes, damped modes and responses, which the bands of the lattice and dense matrices fix
    elsewhere.
    """
    network = gp.ContactLattice.of("triangular", 0.8).contact_network(UNITS).repeat((8, 7))
    waves = gp.Waves(network)
    dense = np.sqrt(np.abs(np.linalg.eigvalsh(waves.operator.matrix.toarray()))) / (2.0 * np.pi)
    modes = waves.modes(4, nearest=0.4 * HERTZ)
    nearest = np.sort(dense[np.argsort(np.abs(dense - 0.4 * HERTZ))[:4]])
    assert_allclose(modes.frequencies, nearest, rtol=1e-9)
    matrix = waves.operator.matrix.toarray()
    omega = 2.0 * np.pi * 0.3 * HERTZ
    drive = np.zeros(len(matrix))
    drive[0] = 1.0
    moved = np.linalg.solve(matrix * (1.0 + 0.02j) - omega**2 * np.eye(len(matrix)), drive)
    heard = waves.response([0.3 * HERTZ], (0, "x"), (9, "x"), loss_factor=0.02, method="direct")
    per_row = len(matrix) // network.n_balls
    assert_allclose(heard.values[0, 0], moved[9 * per_row] / network.masses[0], rtol=1e-9)
