"""The array by sparse matrices against the simulation's own method, dense matrices, and closed
forms; the same array as a list of contacts, by factors.
"""

from __future__ import annotations

import math

import numpy as np
import pytest

from granphon.array.options import ReducedLoad
from granphon.array.rest import bring_to_rest, equilibrate_by_factors, find_tensor_by_factors
from granphon.balls.lattices import TRIANGULAR
from granphon.base.errors import ConvergenceError
from tests.array.test_equilibrium import at_rest, balls, close_forces
from tests.array.test_response import dense_tensor
from tests.array.test_stencils import every_eta
from tests.sparse_array import SparseArray

SLOW = [(16, 16), (24, 17)]
every_shape = pytest.mark.parametrize(
    "shape",
    [(12, 9), (1, 9), (2, 3), *(pytest.param(s, marks=pytest.mark.slow) for s in SLOW)],
    ids=str,
)


@every_shape
@pytest.mark.parametrize("spacing", [3.0, 1.0, 0.7, 0.5, 0.42])
def test_forces_are_those_of_the_simulation(shape, spacing):
    state = at_rest(shape, 1, spacing)
    found = SparseArray(balls(shape, 1)).forces(spacing - 0.5)
    assert found.shape == (3, *shape)
    close_forces(found, state.forces, 1e-9)
    listed = equilibrate_by_factors(state)
    assert listed.conjugate == 0
    close_forces(listed.forces, state.forces, 1e-9)


@pytest.mark.claim("moduli-linear-response")
@every_eta
@every_shape
@pytest.mark.parametrize("spacing", [1.0, 0.5])
def test_tensor_is_that_of_the_simulation(shape, spacing, eta):
    array = SparseArray(balls(shape, 1))
    state = at_rest(shape, 1, spacing)
    expected = state.find_elasticity(eta)
    found = array.elastic_tensor(array.forces(spacing - 0.5), eta)
    np.testing.assert_allclose(found, expected, rtol=0.0, atol=1e-9 * expected.max())
    listed = find_tensor_by_factors(state, eta)
    np.testing.assert_allclose(listed, expected, rtol=0.0, atol=1e-9 * expected.max())


@every_eta
@pytest.mark.parametrize("spacing", [0.6, 0.45, 0.38])
def test_balls_that_nothing_holds_are_no_obstacle(spacing, eta):
    x = balls((6, 6), 1) if spacing > 0.4 else balls((14, 13), 3)
    array = SparseArray(x)
    forces = array.forces(spacing - 0.5)
    held = np.zeros(x.shape, bool)
    for one, (a, b) in zip(
        forces > 1e-6 * np.mean(forces), TRIANGULAR.contacts.shift.tolist(), strict=True
    ):
        held |= one | np.roll(one, (a, b), (0, 1))
    assert spacing > 0.5 or not np.all(held)
    expected = dense_tensor(
        x, bring_to_rest(x, ReducedLoad(overlap=spacing - 0.5)).stiffnesses, eta
    )
    np.testing.assert_allclose(
        array.elastic_tensor(forces, eta), expected, rtol=0.0, atol=1e-9 * expected.max()
    )


def test_the_net_force_on_every_ball_is_below_the_tolerance():
    x = balls((20, 20), 5)
    for tolerance in (1e-4, 1e-8, 1e-11):
        forces, net = SparseArray(x).forces(0.2, tolerance), np.zeros((2, *x.shape))
        for force, normal, shift in zip(
            forces, TRIANGULAR.contacts.normal, TRIANGULAR.contacts.shift, strict=True
        ):
            net += normal[:, None, None] * (np.roll(force, shift, (0, 1)) - force)
        left = math.sqrt(float(np.max(np.sum(net**2, axis=0)))) / min(
            np.mean(forces), np.std(forces)
        )
        assert left < 1.1 * tolerance


@pytest.mark.parametrize("overlap", [-0.25, -0.6])
def test_an_array_that_carries_no_load_is_refused(overlap):
    with pytest.raises(ConvergenceError, match="not come to rest"):
        SparseArray(balls((12, 12), 3)).forces(overlap)
