"""The stencils against an array written out ball by ball, and against the lattice's own waves."""

from __future__ import annotations

import itertools
import math
import pickle

import numpy as np
import pytest

import granphon as gp
from granphon.array import contact_operator
from granphon.array import stencils as module
from granphon.array.stencils import Motion, Stencils

#: steel's
ETA = 0.84
SHAPES = [(1, 1), (1, 2), (2, 1), (2, 2), (1, 7), (5, 1), (3, 4), (7, 5), (6, 11)]
every_shape = pytest.mark.parametrize("shape", SHAPES, ids=str)
every_eta = pytest.mark.parametrize("eta", [0.0, ETA], ids=["smooth", "rough"])


class Explicit:
    """A periodic triangular array, one contact after the other; owes nothing to the package.

    The rows a1 = (1, 0) and a2 = (-1/2, sqrt(3)/2) of the 120-degree cell; motions are flat: x, y (and phi) of ball after
    ball. Contacts lead to the balls at a2, a1 and a1 + a2, as in the lattice's table, each kind for ball after ball.
    """

    steps = ((0, 1), (1, 0), (1, 1))
    normals = tuple((math.cos(math.radians(angle)), math.sin(math.radians(angle))) for angle in (120, 0, 60))

    def __init__(self, shape, eta=0.0):
        self.shape, self.eta, self.dofs = shape, eta, 3 if eta else 2
        self.balls = list(itertools.product(range(shape[0]), range(shape[1])))
        self.ends = [
            (shape[1] * p + q, shape[1] * ((p + a) % shape[0]) + (q + b) % shape[1], n)
            for (a, b), n in zip(self.steps, self.normals, strict=True)
            for p, q in self.balls
        ]

    def entries(self):
        """(row, column, value) of C: all elongations, then all slips."""
        for row, (i, j, (nx, ny)) in enumerate(self.ends):
            for ball, sign in ((i, -1.0), (j, 1.0)):
                yield row, self.dofs * ball, sign * nx
                yield row, self.dofs * ball + 1, sign * ny
        for row, (i, j, (nx, ny)) in enumerate(self.ends if self.eta else (), len(self.ends)):
            for ball, sign in ((i, -1.0), (j, 1.0)):
                yield row, self.dofs * ball, -sign * ny
                yield row, self.dofs * ball + 1, sign * nx
                yield row, self.dofs * ball + 2, -0.5

    def dense(self):
        """C, (rows, dofs)."""
        out = np.zeros((len(self.ends) * (2 if self.eta else 1), self.dofs * len(self.balls)))
        for row, column, value in self.entries():
            out[row, column] += value
        return out

    def means(self, deviations):
        """(x_i + x_j)/2 of contact after contact."""
        flat = deviations.ravel()
        return np.array([0.5 * (flat[i] + flat[j]) for i, j, _ in self.ends])


def cartesian(stencils, balls):
    """The motion of stencils as a flat one."""
    return np.concatenate([stencils.displacements(balls), balls[2:]]).reshape(stencils.n_fields, -1).T.ravel()


def rng_of(shape, *more):
    return np.random.default_rng([*shape, *more])


# -- C ------------------------------------------------------------------------------------------------------------------


@every_eta
@every_shape
def test_against_the_array_ball_by_ball(shape, eta):
    stencils, rng = Stencils(shape, eta), rng_of(shape)
    dense = Explicit(shape, eta).dense()
    balls = rng.normal(size=(stencils.n_fields, *shape))
    tension = rng.normal(size=(stencils.n_rows, *shape))
    strain = stencils.deformations(Motion(balls, 0.0))
    np.testing.assert_allclose(strain.ravel(), dense @ cartesian(stencils, balls), rtol=0.0, atol=4e-15)
    forces = stencils.forces(tension)
    found = np.concatenate([stencils.cartesian(forces), forces[2:]]).reshape(stencils.n_fields, -1).T.ravel()
    np.testing.assert_allclose(found, dense.T @ tension.ravel(), rtol=0.0, atol=8e-15)
    # compression takes from the elongation of every contact, and slips none
    pressed = stencils.deformations(Motion(balls, 0.25)) - strain
    np.testing.assert_allclose(pressed[:3], -0.25, rtol=1e-14)
    assert not np.any(pressed[3:])
    assert stencils.n_rows == len(dense) // math.prod(shape)


@every_eta
@pytest.mark.parametrize("shape", [(1, 1), (2, 3), (4, 5), (6, 6)], ids=str)
def test_spectrum_is_that_of_the_lattices_waves(shape, eta):
    # the supercell folds the waves that fit into it: dense D of the stencils, C(q) of the lattice
    stencils = Stencils(shape, eta)
    size = stencils.n_fields * math.prod(shape)
    units = np.eye(size).reshape(size, stencils.n_fields, *shape)
    columns = np.stack([stencils.deformations(Motion(unit, 0.0)).ravel() for unit in units], axis=1)
    to_stencils = np.linalg.inv(np.stack([cartesian(stencils, unit) for unit in units], axis=1))
    masses = np.tile([1.0, 1.0, 0.1][: stencils.n_fields], math.prod(shape))  # I/M d^2 = 1/10 of a solid ball
    weights = np.repeat([1.0, eta][: 1 + (eta > 0.0)], 3 * math.prod(shape))
    matrix = (columns @ to_stencils) / np.sqrt(masses)
    squares = np.linalg.eigvalsh(matrix.T @ (weights[:, None] * matrix))
    lattice = gp.ContactLattice.of("triangular", eta)
    fractions = [(p / shape[0], q / shape[1]) for p, q in np.ndindex(shape)]
    frequencies = lattice.frequencies(lattice.wavevectors(fractions))
    np.testing.assert_allclose(squares, np.sort(frequencies.ravel() ** 2), rtol=0.0, atol=1e-13)


@every_eta
def test_parts_of_an_array_change_nothing(eta, monkeypatch):
    shape = (13, 7)
    rng, results = rng_of(shape), []
    for numbers, parts in ((2**15, 1), (30, 4), (1, 4)):
        monkeypatch.setattr(module, "_CACHED", numbers)
        monkeypatch.setattr(contact_operator, "_CACHED", 48 * numbers)
        whole = Stencils(shape, eta)
        if not results:
            balls = rng.normal(size=(whole.n_fields, *shape))
            weights = whole.weights(rng.uniform(0.0, 1.0, size=(3, *shape)))
        assert len(whole.operator.parts(float)) == parts
        strain = whole.deformations(Motion(balls, 0.5))
        force, push = whole.hessian(weights)(balls, 0.5)
        results.append((strain, whole.forces(strain), force, push, whole.preconditioner(weights)(force)))
    for other in results[1:]:
        for one, two in zip(results[0], other, strict=True):
            np.testing.assert_allclose(one, two, rtol=1e-14, atol=1e-12)


def test_around_adds_up_the_six_contacts_of_a_ball():
    shape = (4, 3)
    values, explicit = rng_of(shape).normal(size=(3, *shape)), Explicit(shape)
    sums = np.zeros(12)
    for value, (i, j, _) in zip(values.ravel(), explicit.ends, strict=True):
        sums[i] += value
        sums[j] += value
    np.testing.assert_allclose(Stencils(shape).around(values).ravel(), sums, rtol=0.0, atol=1e-14)


def test_pickles_without_the_lattices_inverse():
    stencils = Stencils((5, 6), ETA, workers=2)
    _ = stencils._green
    again = pickle.loads(pickle.dumps(stencils))
    assert (again.shape, again.mindlin_ratio, again.workers) == ((5, 6), ETA, 2)
    assert "_green" not in vars(again)


# -- the preconditioner -------------------------------------------------------------------------------------------------


def matrix_of(apply, stencils):
    """The dense matrix of a linear map on motions."""
    size = stencils.n_fields * math.prod(stencils.shape)
    units = np.eye(size).reshape(size, stencils.n_fields, *stencils.shape)
    return np.stack([apply(unit).ravel() for unit in units], axis=1)


@every_eta
@pytest.mark.parametrize("shape", [(1, 1), (4, 5), (6, 6)], ids=str)
@pytest.mark.parametrize("opened", [0.0, 0.5, 0.9])
def test_preconditioner_is_symmetric_and_positive(shape, eta, opened):
    stencils, rng = Stencils(shape, eta), rng_of(shape, int(10 * opened))
    stiffness = rng.uniform(0.1, 2.0, size=(3, *shape)) * (rng.uniform(size=(3, *shape)) >= opened)
    stiffness[0, 0, 0], stiffness[2, -1, -1] = 1.0, 0.1  # contacts that differ
    found = matrix_of(stencils.preconditioner(stencils.weights(stiffness)), stencils)
    assert np.max(np.abs(found - found.T)) <= 1e-14 * np.max(np.abs(found))
    assert np.linalg.eigvalsh(found)[0] > 1e-3
