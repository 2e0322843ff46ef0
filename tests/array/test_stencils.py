"""The stencils against an array written out ball by ball, and against the lattice's own waves."""

from __future__ import annotations

import itertools
import math

import numpy as np
import pytest

from granphon.array.stencils import Motion, Stencils

#: steel's
ETA = 0.84
SHAPES = [(1, 1), (1, 2), (2, 1), (2, 2), (1, 7), (5, 1), (3, 4), (7, 5), (6, 11)]
every_shape = pytest.mark.parametrize("shape", SHAPES, ids=str)
every_eta = pytest.mark.parametrize("eta", [0.0, ETA], ids=["smooth", "rough"])


class Explicit:
    """A periodic triangular array, one contact after the other; owes nothing to the package.

    The rows a1 = (1, 0) and a2 = (-1/2, sqrt(3)/2) of the 120-degree cell; motions are flat: x, y
    (and phi) of ball after ball. Contacts lead to the balls at a2, a1 and a1 + a2, as in the
    lattice's table, each kind for ball after ball.
    """

    steps = ((0, 1), (1, 0), (1, 1))
    normals = tuple(
        (math.cos(math.radians(angle)), math.sin(math.radians(angle))) for angle in (120, 0, 60)
    )

    def __init__(self, shape, eta=0.0):
        self.shape = shape
        self.eta = eta
        self.dofs = 3 if eta else 2
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
    return (
        np.concatenate([stencils.displacements(balls), balls[2:]])
        .reshape(stencils.n_fields, -1)
        .T.ravel()
    )


def rng_of(shape, *more):
    return np.random.default_rng([*shape, *more])


# -- C ---------------------------------------------------------------------------------------------


@every_eta
@every_shape
def test_against_the_array_ball_by_ball(shape, eta):
    stencils = Stencils(shape, eta)
    rng = rng_of(shape)
    dense = Explicit(shape, eta).dense()
    balls = rng.normal(size=(stencils.n_fields, *shape))
    tension = rng.normal(size=(stencils.n_rows, *shape))
    strain = stencils.deformations(Motion(balls, 0.0))
    np.testing.assert_allclose(
        strain.ravel(), dense @ cartesian(stencils, balls), rtol=0.0, atol=4e-15
    )
    forces = stencils.forces(tension)
    found = (
        np.concatenate([np.tensordot(stencils.basis.T, forces[:2], 1), forces[2:]])
        .reshape(stencils.n_fields, -1)
        .T.ravel()
    )
    np.testing.assert_allclose(found, dense.T @ tension.ravel(), rtol=0.0, atol=8e-15)
    # compression takes from the elongation of every contact, and slips none
    pressed = stencils.deformations(Motion(balls, 0.25)) - strain
    np.testing.assert_allclose(pressed[:3], -0.25, rtol=1e-14)
    assert not np.any(pressed[3:])
    assert stencils.n_rows == len(dense) // math.prod(shape)


@every_eta
def test_parts_of_an_array_change_nothing(eta):
    """Moved by cells, all that is found moves with the balls, wherever the parts end that are
    worked on at a time.
    """
    shape = (450, 100)
    shift = (137, 61)
    whole, rng = Stencils(shape, eta), rng_of(shape)
    assert len(whole.operator.slabs(float)) > 1
    balls, weights = (
        rng.normal(size=(whole.n_fields, *shape)),
        whole.weights(rng.uniform(0.0, 1.0, size=(3, *shape))),
    )

    def find(balls, weights):
        strain = whole.deformations(Motion(balls, 0.5))
        force, push = whole.hessian(weights)(balls, 0.5)
        np.testing.assert_allclose(force, whole.forces(weights * strain), rtol=0.0, atol=1e-12)
        return strain, force, whole.preconditioner(weights)(force), push

    *fields, push = find(balls, weights)
    *moved, same = find(*(np.roll(one, shift, (1, 2)) for one in (balls, weights)))
    assert same == pytest.approx(push, rel=1e-11)
    for one, other in zip(fields, moved, strict=True):
        np.testing.assert_allclose(
            other, np.roll(one, shift, (1, 2)), rtol=0.0, atol=1e-12 * np.max(np.abs(one))
        )
