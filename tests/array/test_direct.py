"""The array by sparse matrices against the simulation's own method, dense matrices, and closed forms."""

from __future__ import annotations

import math

import numpy as np
import pytest

import granphon as gp
from granphon.array import sparse as direct
from granphon.array.equilibrium import equilibrate
from granphon.array.geometry import ReducedLoad
from granphon.array.sparse import SparseArray
from granphon.balls.lattices import TRIANGULAR
from granphon.base.errors import ConvergenceError
from tests.array.test_equilibrium import at_rest, balls, close_forces
from tests.array.test_response import dense_tensor
from tests.array.test_stencils import ETA, every_eta

every_shape = pytest.mark.parametrize("shape", [(16, 16), (24, 17), (1, 9), (2, 3)], ids=str)


@every_shape
@pytest.mark.parametrize("spacing", [3.0, 1.0, 0.7, 0.5, 0.42])
def test_forces_are_those_of_the_simulation(shape, spacing):
    state = at_rest(shape, 1, spacing)
    found = SparseArray(balls(shape, 1)).forces(spacing - 0.5)
    assert found.shape == (3, *shape)
    close_forces(found, state.forces, 1e-9)


@pytest.mark.claim("moduli-linear-response")
@every_eta
@every_shape
@pytest.mark.parametrize("spacing", [1.0, 0.7, 0.5])
def test_tensor_is_that_of_the_simulation(shape, spacing, eta):
    array = SparseArray(balls(shape, 1))
    expected = at_rest(shape, 1, spacing).find_elasticity(eta)
    found = array.elastic_tensor(array.forces(spacing - 0.5), eta)
    np.testing.assert_allclose(found, expected, rtol=0.0, atol=1e-9 * expected.max())


@every_eta
@pytest.mark.parametrize("spacing", [0.6, 0.45, 0.38])
def test_balls_that_nothing_holds_are_no_obstacle(spacing, eta):
    x = balls((6, 6), 1) if spacing > 0.4 else balls((14, 13), 3)
    array = SparseArray(x)
    forces = array.forces(spacing - 0.5)
    held = np.zeros(x.shape, bool)
    for one, (a, b) in zip(forces > 1e-6 * np.mean(forces), TRIANGULAR.contacts.shift.tolist(), strict=True):
        held |= one | np.roll(one, (a, b), (0, 1))
    assert spacing > 0.5 or not np.all(held)
    expected = dense_tensor(x, equilibrate(x, ReducedLoad(overlap=spacing - 0.5)).stiffnesses, eta)
    np.testing.assert_allclose(array.elastic_tensor(forces, eta), expected, rtol=0.0, atol=1e-9 * expected.max())


@every_eta
@pytest.mark.parametrize("shape", [(1, 1), (1, 4), (5, 3)], ids=str)
def test_equal_balls_have_the_moduli_of_equation_17(shape, eta):
    array = SparseArray(np.zeros(shape))
    forces = array.forces(0.4)
    np.testing.assert_allclose(forces, 0.4**1.5, rtol=1e-15)
    k = 1.5 * 0.4**0.5
    lattice = gp.ContactLattice.of("triangular", eta).elastic_tensor()
    np.testing.assert_allclose(array.elastic_tensor(forces, eta), k * lattice, rtol=0.0, atol=1e-14)


def test_the_net_force_on_every_ball_is_below_the_tolerance():
    x = balls((20, 20), 5)
    for tolerance in (1e-4, 1e-8, 1e-11):
        forces, net = SparseArray(x).forces(0.2, tolerance), np.zeros((2, *x.shape))
        for force, normal, shift in zip(forces, TRIANGULAR.contacts.normal, TRIANGULAR.contacts.shift, strict=True):
            net += normal[:, None, None] * (np.roll(force, shift, (0, 1)) - force)
        left = math.sqrt(float(np.max(np.sum(net**2, axis=0)))) / min(np.mean(forces), np.std(forces))
        assert left < 1.1 * tolerance


@pytest.mark.parametrize("overlap", [-0.25, -0.6])
def test_an_array_that_carries_no_load_is_refused(overlap):
    with pytest.raises(ConvergenceError, match="not come to rest"):
        SparseArray(balls((12, 12), 3)).forces(overlap)


def test_newtons_method_ends(monkeypatch):
    array = SparseArray(balls((12, 12), 3))
    monkeypatch.setattr(direct, "_FACTORISATIONS", 2)
    with pytest.raises(ConvergenceError, match="not come to rest"):
        array.forces(0.0)


def test_friction_stiffens_the_shear():
    array = SparseArray(balls((12, 12), 0))
    forces = array.forces(0.3)
    smooth, rough = (array.elastic_tensor(forces, eta) for eta in (0.0, ETA))
    assert np.linalg.eigvalsh(rough - smooth)[0] > -1e-9 * rough.max()
    assert rough[2, 2] > 1.3 * smooth[2, 2]
