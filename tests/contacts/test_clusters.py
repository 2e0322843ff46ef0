"""Steps of clusters of balls against equations with all entries of the matrix, and greatest
lengths.
"""

from __future__ import annotations

import numpy as np
import pytest
from numpy.testing import assert_allclose

from granphon.contacts.clusters import Springs, find_cluster_steps, find_largest
from granphon.contacts.slips import find_greatest_length


def solve_whole(ends, normal, stiffnesses, springs, moving, forces):
    """The steps of the ``moving`` balls under ``forces``, by one matrix of all balls; other balls
    stay. A contact of a ball with its own image does not resist.
    """
    along, across = stiffnesses
    n, d = forces.shape
    matrix = np.zeros((n + 1, d, n + 1, d))
    for ball in range(n):
        matrix[ball, :, ball] = springs[ball] * np.eye(d)
    for c, (i, j) in enumerate(zip(*ends, strict=True)):
        if along[c] > 0.0:
            outer = np.outer(normal[c, :d], normal[c, :d])
            block = along[c] * outer + across[c] * (np.eye(d) - outer)
            for one, other in ((i, j), (j, i)):
                matrix[one, :, one] += block
                matrix[one, :, other] -= block
    index = np.ix_(moving, range(d), moving, range(d))
    size = d * len(moving)
    steps = np.zeros((n, d))
    steps[moving] = np.linalg.solve(
        matrix[index].reshape(size, size), forces[moving].ravel()
    ).reshape(-1, d)
    return steps


@pytest.mark.parametrize("d", [1, 2, 3])
def test_steps_are_those_of_one_matrix(d):
    # balls 0 to 3 touch in a chain, 3 touches what is held, 1 and 2 touch twice, 2 touches its own
    # image, and so does 4, which is alone; 5 touches 6 by an open contact
    i = np.array([0, 1, 2, 3, 2, 4, 5, 1])
    j = np.array([1, 2, 3, 7, 2, 4, 6, 2])
    rng = np.random.default_rng(d)
    normal = np.zeros((len(i), 3))
    normal[:, :d] = rng.normal(size=(len(i), d))
    normal /= np.linalg.norm(normal, axis=1)[:, None]
    along, across = rng.uniform(0.5, 1.5, (2, len(i)))
    along[6] = across[6] = 0.0
    springs = rng.uniform(0.1, 0.2, 7)
    forces = rng.normal(size=(7, d))
    moves = np.array([False, True, False, False, True, True, False])
    steps = np.empty((7, d))
    contacts = Springs(i, j, normal, along, across)
    find_cluster_steps(contacts, springs, moves, forces, steps)
    whole = solve_whole((i, j), normal, (along, across), springs, [0, 1, 2, 3, 4, 5], forces)
    assert_allclose(steps, whole, rtol=1e-12, atol=1e-13)
    assert np.all(steps[6] == 0.0)


def test_greatest_lengths_do_not_pass_over_nan():
    vectors = np.array([[3.0, 4.0, 0.0], [np.nan, 0.0, 0.0], [0.5, 0.0, 0.0], [0.0, 2.0, 0.0]])
    assert np.isnan(find_greatest_length(vectors))
    assert find_greatest_length(vectors[[0, 2]]) == 5.0
    assert find_greatest_length(vectors[:0]) == 0.0
    largest = np.zeros(3)
    find_largest(vectors, np.array([0, 0, 0, 1]), largest)
    np.testing.assert_array_equal(largest, [np.nan, 2.0, 0.0])
