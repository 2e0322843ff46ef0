"""Means over the Brillouin zone in one, two and three dimensions: sum rules, symmetries, order."""

from __future__ import annotations

import itertools

import numpy as np
import pytest

from granphon.balls.lattices import LATTICES, find_lattice
from granphon.dynamics.contact_lattice import ContactLattice
from granphon.dynamics.zone_means import divide_zone, find_symmetries, shortest_vectors

NAMES = sorted(LATTICES)


@pytest.mark.parametrize("name", NAMES)
def test_means_of_waves_over_the_zone(name):
    medium = ContactLattice.of(name, 0.84)
    p = medium.periods
    steps = np.array([(0, 0, 0), (1, 0, 0), (0, 1, 0), (2, -1, 0), (1, 1, 1), (0, -1, 2)])[:, :p]
    places = np.unique(steps, axis=0) @ medium.cell[:, :p]
    means = sum(weights @ np.cos(q @ places.T) for q, weights in divide_zone(medium.reciprocal, 10))
    np.testing.assert_allclose(means, ~np.any(places, axis=1), atol=1e-10)


@pytest.mark.parametrize("name", ["chain", "square", "kagome", "sc", "fcc", "hcp"])
def test_maxwell(name):
    # the projector on the range of K^1/2 C has as many directions as the balls have motions,
    # wherever q is
    medium = ContactLattice.of(name, 0.84)
    trace = 0.0
    for q, weights in divide_zone(medium.reciprocal, 2):
        factor = np.linalg.qr(medium.compatibility(q))[0]
        trace += weights @ np.sum(np.abs(factor) ** 2, axis=(1, 2))
    assert trace == pytest.approx(medium.n_branches, rel=1e-12)


def shells(name):
    """A function of q with the symmetry of the Bravais lattice: a sum of cosines over its shortest
    vectors.
    """
    cell = find_lattice(name).vectors
    p = len(cell)
    vectors = np.array(list(itertools.product(range(-2, 3), repeat=p))) @ cell[:, :p]
    near = vectors[np.linalg.norm(vectors, axis=1) < 1.9 * np.linalg.norm(cell, axis=1).min()]
    return lambda q: np.cos(q @ near.T).sum(axis=1)


# turns and mirrors of the shortest reciprocal vectors among themselves, with -1: all of those of
# the cube in sc, two mirrors in the hexagonal plane, times those of its axis in hcp, those about
# the cube's diagonal in fcc and bcc
@pytest.mark.parametrize(
    ("name", "count"),
    [
        ("chain", 2),
        ("square", 8),
        ("triangular", 4),
        ("sc", 48),
        ("fcc", 12),
        ("bcc", 12),
        ("hcp", 8),
    ],
)
def test_symmetries_leave_means_the_same(name, count):
    function = shells(name)
    reciprocal = ContactLattice.of(name, 0.0).reciprocal
    found = find_symmetries(function, reciprocal)
    assert len(found) == count
    assert all(one.after(other) in found for one in found for other in found)
    parts = list(divide_zone(reciprocal, 6, found))
    assert sum(weights.sum() for _, weights in parts) == pytest.approx(1.0, rel=1e-13)
    whole = list(divide_zone(reciprocal, 6))
    assert len(parts) <= 2 * len(whole) / count + 1
    means = [
        sum(weights @ np.exp(function(q) / 7.0) for q, weights in some) for some in (parts, whole)
    ]
    assert means[0] == pytest.approx(means[1], rel=1e-12)


def test_a_function_of_less_symmetry_is_not_folded():
    reciprocal = ContactLattice.of("sc", 0.0).reciprocal
    along = find_symmetries(lambda q: np.cos(q) @ [1.0, 1.0, 2.0], reciprocal)
    assert len(along) == 16
    # equal but for rounded numbers in x and y: what is found is a group
    nearly = find_symmetries(lambda q: np.cos(q) @ [1.0, 1.0 + 3e-10, 1.0 - 3e-10], reciprocal)
    assert all(one.after(other) in nearly for one in nearly for other in nearly)
    assert len(nearly) in (8, 16)


def test_shortest_vectors_of_skewed_cells():
    skewed = np.array([[1, 0, 0], [3, 1, 0], [-2, 5, 1]]) @ ContactLattice.of("fcc", 0.0).reciprocal
    shortest = shortest_vectors(skewed)
    np.testing.assert_allclose(
        np.linalg.norm(shortest, axis=1),
        np.linalg.norm(ContactLattice.of("fcc", 0.0).reciprocal[0]),
    )
    assert abs(np.linalg.det(shortest)) == pytest.approx(abs(np.linalg.det(skewed)))


def test_a_function_of_the_direction_at_the_points_that_are_their_own_opposites():
    # (a.q)^2/|q|^2 with lattice waves: bounded, without a limit at Gamma, of mean 1/3 in a cube and
    # 1/2 in a square
    def ratio(q):
        waves = np.sin(0.5 * q) ** 2
        return waves[:, 0] / waves.sum(axis=1)

    for name, exact in (("square", 1.0 / 2.0), ("sc", 1.0 / 3.0)):
        errors = []
        for order in (4, 8, 12):
            parts = divide_zone(ContactLattice.of(name, 0.0).reciprocal, order)
            errors.append(abs(sum(weights @ ratio(q) for q, weights in parts) - exact))
        assert errors[-1] < 1e-9
