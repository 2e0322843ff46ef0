"""The lowest eigenvalues of large matrices by a block of vectors, and its preconditioner, against
dense matrices.
"""

from __future__ import annotations

import numpy as np
import pytest
from numpy.testing import assert_allclose
from scipy.sparse import csr_array

import granphon as gp
from granphon.base.errors import ConvergenceError
from granphon.dynamics import lowest_modes, two_levels
from granphon.dynamics.lowest_modes import LowestSearch
from granphon.dynamics.two_levels import TwoLevels, compose_boxes
from granphon.waves import lowest
from tests import packings


@pytest.fixture(scope="module")
def operator():
    """D of 116 disks of LAMMPS, 348 motions."""
    files = (packings.FOLDER / f"disks_{part}.dump" for part in ("atoms", "pairs"))
    network = gp.ContactNetwork.from_lammps(*files, packings.MATERIAL).repeat((2, 2))
    return gp.Waves(network).operator


def search(operator, q=None):
    """The search for the lowest eigenvalues of D, its matrix, and its preconditioner."""
    matrix = operator.matrix if q is None else operator.at_wavevector(q)
    boxes = compose_boxes(lowest._describe_balls(operator), q)
    precondition = TwoLevels(matrix, operator.motions.count, boxes)
    return LowestSearch(matrix, precondition, 1e-9 * operator.top**2), matrix, precondition


@pytest.mark.parametrize("q", [None, np.array([0.3, -0.2])])
def test_boxes_are_rigid_bodies_and_the_preconditioner_is_symmetric(operator, q, monkeypatch):
    monkeypatch.setattr(two_levels, "_BALLS_PER_BOX", 8.0)
    boxes = compose_boxes(lowest._describe_balls(operator), q)
    products = (boxes.conj().T @ boxes).toarray()
    assert_allclose(products, np.eye(len(products)), rtol=0.0, atol=1e-12)
    _, matrix, precondition = search(operator, q)
    dense = matrix.toarray()
    inverse = precondition(np.eye(len(dense), dtype=dense.dtype))
    assert_allclose(inverse, inverse.conj().T, rtol=0.0, atol=1e-9 * np.max(np.abs(inverse)))
    assert np.linalg.eigvalsh(inverse)[0] > 0.0
    # a shift of all balls is a motion of all boxes, so that it is left to the factors
    count = operator.motions.count
    shift = np.tile(np.eye(count)[0], operator.size // count) * np.sqrt(
        np.repeat(operator.network.masses, count)
    )
    if q is None:
        assert_allclose(boxes @ (boxes.T @ shift), shift, rtol=0.0, atol=1e-12 * np.max(shift))
    # eigenvalues of D over the preconditioner lie closer together than over single balls
    squares = np.linalg.eigvals(inverse @ dense).real
    of_balls = np.linalg.eigvals(precondition.ball_inverses.toarray() @ dense).real
    n_zeros = 2 if q is None else 0
    spread, spread_of_balls = (
        np.max(values) / np.sort(values)[n_zeros] for values in (squares, of_balls)
    )
    assert spread < 0.2 * spread_of_balls


@pytest.mark.parametrize("q", [None, np.array([0.3, -0.2])])
def test_lowest_eigenvalues_are_those_of_the_dense_matrix(operator, q):
    found = search(operator, q)[0].find(9)
    expected = np.linalg.eigvalsh(
        (operator.matrix if q is None else operator.at_wavevector(q)).toarray()
    )
    assert_allclose(found.values, expected[:9], rtol=0.0, atol=1e-14 * operator.top**2)
    assert np.max(found.residuals) <= 1e-9 * operator.top**2


def test_an_eigenvector_that_random_vectors_lack_is_found_by_fresh_ones(operator, monkeypatch):
    finder, matrix, _ = search(operator)
    values, vectors = np.linalg.eigh(matrix.toarray())
    missing = vectors[:, 5:6]
    converge, blocks = finder._converge, []

    def keep_away(block, count):
        """The first block stays without an eigenvector."""
        if not blocks:
            finder._known_vectors = missing
            basis = lowest_modes._orthonormalise(finder._make_perpendicular(block.vectors, None))
            block = finder._make_block(basis, basis.shape[1])
        blocks.append(converge(block, count))
        finder._known_vectors = None
        return blocks[-1]

    monkeypatch.setattr(finder, "_converge", keep_away)
    found = finder.find(9)
    assert len(blocks) == 2
    assert abs(blocks[0].values[5] / values[5] - 1.0) > 1e-3
    assert_allclose(found.values, values[:9], rtol=0.0, atol=1e-14 * operator.top**2)


def test_a_search_that_does_not_end_says_so(operator, monkeypatch):
    monkeypatch.setattr(lowest_modes, "_MOST_ITERATIONS", 2)
    with pytest.raises(ConvergenceError, match="fewer"):
        search(operator)[0].find(9)


@pytest.mark.parametrize("n_known", [0, 2])
@pytest.mark.parametrize("count", [1, 5, 8])
def test_as_many_modes_are_found_of_a_small_matrix_as_it_has(count, n_known):
    """The block and the fresh vectors would fill the space, and leave none to be found."""
    squares = np.arange(1.0, 11.0)
    basis = np.linalg.qr(np.random.default_rng(3).normal(size=(10, 10)))[0]
    matrix = csr_array((basis * squares) @ basis.T)
    known_vectors = csr_array(basis[:, :n_known])
    modes = LowestSearch(matrix, lambda x: x, 1e-9, known_vectors).find(count)
    assert_allclose(modes.values, squares[n_known : n_known + count], rtol=1e-12)
    assert np.all(modes.residuals < 1e-12)
