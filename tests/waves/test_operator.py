"""The dynamical matrix of a network: its polynomials, and arrays without a matrix against the
sparse one.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

import granphon as gp
from granphon.base.errors import InputError
from granphon.waves.chebyshev import polynomials
from granphon.waves.operator import ArrayOperator, WaveOperator, find_kinds, make_operator
from tests.networks.test_network import LATTICES, STEEL, UNITS


def test_polynomials_are_even_in_the_frequency():
    network = gp.ContactLattice.of("triangular", 0.8).contact_network(UNITS).repeat((3, 4))
    operator = WaveOperator(network)
    squares, vectors = np.linalg.eigh(operator.matrix.toarray())
    omega = np.sqrt(np.maximum(squares, 0.0)) / operator.top
    start = np.random.default_rng(0).normal(size=(operator.size, 2))
    for order, found in zip(range(40), polynomials(operator, start), strict=False):
        expected = vectors @ (np.cos(2 * order * np.arccos(omega))[:, None] * (vectors.T @ start))
        np.testing.assert_allclose(found, expected, atol=1e-11)


@pytest.mark.parametrize(("name", "motions", "shape"), LATTICES)
def test_stencils_of_an_array_are_the_sparse_matrix(name, motions, shape):
    from granphon.balls.lattices import find_lattice
    from granphon.balls.motions import allowed_motions

    shape = tuple(max(3, one) for one in shape)
    among = allowed_motions(find_lattice(name).dimension)[motions]
    torsion, bending = (0.02, 0.03) if among.twist else (0.0, 0.0)
    eta = 0.0 if motions == "longitudinal" else 0.8
    lattice = gp.ContactLattice.of(name, eta, torsion=torsion, bending=bending, motions=among)
    network = lattice.contact_network(UNITS, lattice=find_lattice(name)).repeat(shape)
    rng = np.random.default_rng(5)
    open_ones = rng.random(network.n_contacts) < 0.2  # the rest of the springs differ
    kept = {
        field: getattr(network, field)[~open_ones]
        for field in ("i", "j", "shift", "normal", "normal_force", "arm_i", "arm_j")
    }
    springs = {
        field: (getattr(network, field) * rng.uniform(0.1, 1.0, network.n_contacts))[~open_ones]
        for field in (
            "normal_stiffness",
            "shear_stiffness",
            "torsion_stiffness",
            "bending_stiffness",
        )
    }
    springs["shear_stiffness"][::7] = springs["torsion_stiffness"][::7] = (
        0.0  # no multiples of the other springs
    )
    network = replace(network, **kept, **springs)
    kinds = find_kinds(network)
    assert kinds is not None
    stencils = ArrayOperator(network, kinds)
    sparse = WaveOperator(network)
    x = rng.normal(size=(network.n_balls, network.ball_motions.count))
    expected = sparse.matrix @ sparse.vector(x)
    np.testing.assert_allclose(
        stencils.values(stencils @ stencils.vector(x)).ravel(), expected, atol=1e-13 * sparse.top**2
    )
    np.testing.assert_allclose(
        stencils.matrix @ stencils.vector(x),
        stencils @ stencils.vector(x),
        atol=1e-13 * sparse.top**2,
    )
    assert stencils.top == pytest.approx(sparse.top, rel=1e-12)
    two = rng.normal(size=(stencils.size, 2))
    before = rng.normal(size=(stencils.size, 2))
    expected = 4.0 / stencils.top**2 * (stencils.matrix @ two) - 2.0 * two - before
    np.testing.assert_allclose(stencils.advance(two, before), expected, atol=1e-12)


def test_array_of_a_sample_is_one_and_a_changed_one_is_not():
    packing = gp.Packing(STEEL, 8e-3, gp.Uniform(2.04e-6))
    network = (
        gp.DirectSimulation(packing, shape=(6, 8), seed=3, geometry="lattice")
        .at_force(2.0)
        .sample.network
    )
    assert find_kinds(network) is not None
    uneven = np.linspace(1.0, 1.1, network.n_contacts)
    turned = {"i": network.j, "j": network.i, "shift": -network.shift, "normal": -network.normal}
    masses = network.masses * np.linspace(1.0, 1.1, 48)
    for change in (
        {"masses": masses},
        {"prestress": True},
        {"lattice": None},
        {"arm_i": network.arm_i * uneven},
        turned,
    ):
        assert find_kinds(replace(network, **change)) is None


def test_only_large_arrays_go_without_a_matrix():
    from granphon.balls.lattices import TRIANGULAR

    one = gp.ContactLattice.of("triangular", 0.8).contact_network(UNITS, lattice=TRIANGULAR)
    assert type(make_operator(one.repeat((9, 10)))) is WaveOperator
    assert isinstance(make_operator(one.repeat((60, 50))), ArrayOperator)


def test_torques_of_a_plane_act_on_motions_out_of_it_as_in_space():
    one = gp.ContactLattice.of("square", 0.8, torsion=0.02, bending=0.03).contact_network(UNITS)
    plane = one.repeat((3, 4))
    torque = np.zeros((plane.n_contacts, 3))
    torque[:, 2] = np.random.default_rng(1).normal(size=plane.n_contacts)
    torque *= 0.1 * np.mean(plane.normal_stiffness * plane.arm_i**2)
    changes = {"prestress": True, "contact_torque": torque, "lattice": None, "shape": None}
    in_space = WaveOperator(replace(plane, motions="all", dimension=3, **changes))
    out_of_plane = WaveOperator(replace(plane, motions="out_of_plane", **changes))
    leaving = in_space.indices[:, [2, 3, 4]].ravel()  # u_z, phi_x, phi_y
    expected = in_space.whole[leaving][:, leaving].toarray()
    found = out_of_plane.whole.toarray()
    np.testing.assert_allclose(found, expected, atol=1e-12 * out_of_plane.top**2)
    without = WaveOperator(replace(out_of_plane.network, contact_torque=None))
    assert np.max(np.abs(found - without.matrix.toarray())) > 1e-3 * out_of_plane.top**2


def test_a_large_array_without_contacts_is_refused():
    from granphon.balls.lattices import TRIANGULAR

    one = gp.ContactLattice.of("triangular", 0.8).contact_network(UNITS, lattice=TRIANGULAR)
    array = one.repeat((60, 50))
    no_contacts = {name: getattr(array, name)[:0] for name in array.contact_fields}
    with pytest.raises(InputError, match="no waves run"):
        make_operator(replace(array, **no_contacts))
