"""The linear response of lists of contacts: closed forms, dense twins, and what does not change
it.
"""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

import granphon as gp
from granphon.array.options import ReducedLoad
from granphon.array.rest import bring_to_rest
from granphon.array.stencils import Stencils
from granphon.balls.lattices import CHAIN, FCC, HCP, TRIANGULAR
from granphon.base.errors import ConvergenceError
from granphon.contacts.contact_list import ContactList
from granphon.contacts.tangent import find_tangent, unit_strains
from granphon.dynamics.elasticity import take_voigt
from granphon.statics.options import GridOptions, ResponseOptions
from granphon.statics.response import GridResponse, ListResponse, find_elastic_tensor
from tests.contacts.test_tangent import random_list

#: factors in place of iterations
FACTORISED = ResponseOptions(grid=GridOptions(rigidity=np.inf))
STEEL = gp.Material(211.65e9, 0.276, 7840.0)


def rest(lattice, side, overlap=0.2, seed=0):
    cells = (side,) * lattice.periods
    shape = cells if lattice.n_balls == 1 else (lattice.n_balls, *cells)
    x = np.random.default_rng(seed).uniform(-0.5, 0.5, shape)
    stencils = Stencils(cells, lattice=lattice)
    return bring_to_rest(x - np.mean(x), ReducedLoad(overlap=overlap), stencils)


def solve_densely(contacts):
    """Second derivatives of the energy by strains, by least squares."""
    tangent = find_tangent(contacts, unit_strains(contacts.dimension))
    size = contacts.n_balls * contacts.motions.count
    ahead = tangent.blocks.ahead.reshape(size, -1)
    motions = np.linalg.lstsq(tangent.matrix.toarray(), -ahead, rcond=1e-11)[0]
    found = tangent.blocks.corner + tangent.blocks.back.reshape(size, -1).T @ motions
    return 0.5 * (found + found.T)


def test_equal_balls_follow_a_uniform_strain():
    """Triangular lattice, springs k along bonds and eta k across, area sqrt(3)/2 of a ball."""
    eta = 0.7
    state = bring_to_rest(np.zeros((6, 5)), ReducedLoad(overlap=0.3))
    k = state.stiffness
    c = 0.75 / math.sqrt(3.0) * k
    expected = [
        [c * (3.0 + eta), c * (1.0 - eta), 0.0],
        [c * (1.0 - eta), c * (3.0 + eta), 0.0],
        [0.0, 0.0, c * (1.0 + eta)],
    ]
    contacts = state._list_contacts(eta)
    np.testing.assert_allclose(find_elastic_tensor(contacts), expected, rtol=0.0, atol=1e-13 * k)
    np.testing.assert_allclose(ListResponse(contacts).motions, 0.0, rtol=0.0, atol=1e-7)


def test_springs_of_a_chain_are_in_series():
    state = rest(CHAIN, 20)
    expected = 1.0 / np.mean(1.0 / state.stiffnesses)
    found = find_elastic_tensor(state._list_contacts())
    np.testing.assert_allclose(found, [[expected]], rtol=1e-13)


@pytest.mark.parametrize("tangential", [False, True])
@pytest.mark.parametrize("dimension", [1, 2, 3])
def test_factors_find_what_least_squares_find(dimension, tangential):
    contacts = random_list(dimension, 5, tangential=tangential, spins=tangential, n_balls=12)
    found = ListResponse(contacts).stiffness
    expected = solve_densely(contacts)
    np.testing.assert_allclose(found, expected, rtol=0.0, atol=1e-11 * np.max(expected))


@pytest.mark.parametrize("lattice", [TRIANGULAR, FCC, HCP])
def test_iterations_find_what_factors_find(lattice):
    side = 8 if lattice is TRIANGULAR else 3
    contacts = rest(lattice, side)._list_contacts(0.8, 0.1, 0.05)
    iterated = ListResponse(contacts)
    factorised = ListResponse(contacts, options=FACTORISED)
    expected = factorised.stiffness
    np.testing.assert_allclose(
        iterated.stiffness, expected, rtol=0.0, atol=1e-11 * np.max(expected)
    )
    motions = factorised.motions
    gone = iterated.motions - motions
    still = gone - np.mean(gone, axis=0) * (contacts.axes < 3)[:, None]
    np.testing.assert_allclose(still, 0.0, rtol=0.0, atol=1e-7 * np.max(np.abs(motions)))


@pytest.mark.parametrize("overlap", [0.2, -0.03])
@pytest.mark.parametrize("lattice", [CHAIN, TRIANGULAR, FCC, HCP], ids=lambda one: one.name)
def test_a_grid_that_is_not_spelled_out_responds_as_its_list(lattice, overlap):
    """At the less overlap few contacts are stiff, and factors of these precondition."""
    side = {1: 60, 2: 9, 3: 3}[lattice.periods]
    state = rest(lattice, side, max(overlap, 0.1) if lattice is CHAIN else overlap)
    normal = state.stiffnesses
    draw = np.random.default_rng(3)
    uneven = draw.uniform(0.5, 0.9, normal.shape)
    for springs in [(0.0,)] if lattice is CHAIN else [(0.0,), (0.8, 0.1, 0.05), (uneven, 0.1)]:
        given = (*springs, *(0.0,) * (3 - len(springs)))
        contacts = state._list_contacts(*given)
        expected = ListResponse(contacts, options=FACTORISED).stiffness / contacts.measure
        found = state._find_tensor_on_grid(*given, ResponseOptions())
        np.testing.assert_allclose(found, expected, rtol=0.0, atol=1e-11 * np.max(expected))
    contacts = state._list_contacts()
    iteration = state._iterate(normal)
    tension = normal * draw.normal(size=normal.shape)
    forces = iteration.collect(tension.reshape(len(normal), -1))
    both = [
        one.find_motions(forces[..., None])[..., 0]
        for one in (GridResponse(iteration), ListResponse(contacts, options=FACTORISED))
    ]
    # motions that cost nothing are not unique
    found, expected = (
        np.sqrt(normal) * iteration.measure(one).reshape(normal.shape) for one in both
    )
    np.testing.assert_allclose(found, expected, rtol=0.0, atol=1e-7 * np.max(np.abs(expected)))


@pytest.mark.parametrize(
    "options",
    [None, FACTORISED, ResponseOptions(stalled_part=0.0)],
    ids=["grid", "factors", "gmres"],
)
@pytest.mark.parametrize("lattice", [TRIANGULAR, FCC])
def test_all_ways_find_the_response_under_static_forces_across_normals(lattice, options):
    contacts = rest(lattice, 8 if lattice is TRIANGULAR else 3)._list_contacts(0.8)
    force = np.random.default_rng(1).normal(scale=1e-4, size=contacts.normal.shape)
    force[:, lattice.periods :] = 0.0
    along = np.einsum("ca,ca->c", force, contacts.normal)[:, None] * contacts.normal
    held = replace(contacts, tangential_force=force - along, origin=contacts.normal)
    expected = solve_densely(held)
    size = np.max(expected)
    assert np.max(np.abs(solve_densely(contacts) - expected)) > 1e-9 * size
    found = ListResponse(held, options=options).stiffness
    np.testing.assert_allclose(found, expected, rtol=0.0, atol=1e-11 * size)


@given(st.sampled_from([2, 3]), st.integers(0, 2**16))
def test_nothing_depends_on_the_frame_or_on_the_numbers_of_balls(dimension, seed):
    generator = np.random.default_rng(seed)
    contacts = random_list(dimension, seed, n_balls=7)
    by = Rotation.random(random_state=seed) if dimension == 3 else Rotation.from_euler("z", seed)
    turned = replace(contacts, vector=by.apply(contacts.vector), normal=by.apply(contacts.normal))
    plain = expand(find_elastic_tensor(contacts), dimension)
    R = by.as_matrix()[:dimension, :dimension]
    expected = take_voigt(np.einsum("ia,jb,kc,ld,abcd->ijkl", R, R, R, R, plain))
    size = np.max(np.abs(expected))
    np.testing.assert_allclose(find_elastic_tensor(turned), expected, rtol=0.0, atol=1e-10 * size)
    order = generator.permutation(contacts.n_balls)
    numbered = replace(contacts, i=order[contacts.i], j=order[contacts.j])
    np.testing.assert_allclose(
        find_elastic_tensor(numbered),
        find_elastic_tensor(contacts),
        rtol=0.0,
        atol=1e-10 * size,
    )


def expand(tensor, dimension):
    """c_ijkl of a tensor in Voigt order."""
    pairs = unit_strains(dimension)[:, :dimension, :dimension] > 0.0
    number = np.argmax(pairs, axis=0)
    return tensor[number[:, :, None, None], number[None, None]]


@given(st.sampled_from([1, 2, 3]), st.integers(0, 2**16))
def test_the_tensor_is_symmetric_and_positive_and_below_that_of_an_affine_strain(dimension, seed):
    contacts = random_list(dimension, seed)
    found = ListResponse(contacts).stiffness
    affine = find_tangent(contacts, unit_strains(dimension)).blocks.corner
    np.testing.assert_array_equal(found, found.T)
    assert np.linalg.eigvalsh(found)[0] > -1e-12 * np.max(affine)
    assert np.linalg.eigvalsh(affine - found)[0] > -1e-12 * np.max(affine)


def test_a_response_that_stays_far_from_balance_is_an_error():
    """One round with springs to the ground that are as stiff as a tenth of the contacts."""
    rough = ResponseOptions(springs=(0.1,), rounds=1)
    with pytest.raises(ConvergenceError, match="not found"):
        _ = ListResponse(random_list(2, 1), options=rough).stiffness


def test_a_ball_that_nothing_holds_changes_nothing():
    contacts = random_list(3, 1)
    more = replace(contacts, n_balls=contacts.n_balls + 1)
    found = ListResponse(more)
    np.testing.assert_allclose(
        found.stiffness, ListResponse(contacts).stiffness, rtol=0.0, atol=1e-12
    )
    np.testing.assert_array_equal(found.motions[-1], 0.0)


def test_balls_that_are_pushed_aside_are_no_solid():
    contacts = replace(random_list(2, 1), shear_stiffness=np.zeros(18))
    pressed = replace(contacts, normal_force=np.full(18, 10.0))
    with pytest.raises(ConvergenceError, match="not stable"):
        _ = ListResponse(pressed).stiffness


def list_contacts(network):
    """The contacts of a network that repeats along all axes, in SI units, as a list."""
    count = network.n_contacts
    periods = np.flatnonzero(network.pbc)
    across = network.tangential_force if network.prestress else None
    return ContactList(
        n_balls=network.n_balls,
        motions=network.ball_motions,
        i=network.i,
        j=network.j,
        vector=network.positions[network.j]
        - network.positions[network.i]
        + network.shift @ network.cell,
        normal=network.normal,
        arm_i=network.arm_i,
        arm_j=network.arm_j,
        normal_stiffness=network.normal_stiffness,
        shear_stiffness=network.shear_stiffness,
        torsion_stiffness=np.broadcast_to(network.torsion_stiffness, count),
        bending_stiffness=np.broadcast_to(network.bending_stiffness, count),
        normal_force=network.normal_force if network.prestress else np.zeros(count),
        tangential_force=np.zeros((0, 3)) if across is None else across,
        measure=float(abs(np.linalg.det(network.cell[np.ix_(periods, periods)]))),
        dimension=len(periods),
    )


@pytest.mark.parametrize("geometry", ["lattice", "exact"])
@pytest.mark.parametrize("friction_history", [False, True])
def test_a_network_has_the_moduli_of_long_waves(geometry, friction_history):
    packing = gp.Packing(STEEL, 8e-3, spread=gp.Uniform(2e-5))
    options = {"friction_history": True, "friction_coefficient": 0.3} if friction_history else {}
    sample = (
        gp.DirectSimulation(packing, (5, 6), geometry=geometry, **options).at_force(20.0).sample
    )
    network = sample.network
    expected = gp.moduli(network).tensor  # of a layer one diameter thick
    expected = 0.5 * (expected + expected.T)
    found = find_elastic_tensor(list_contacts(network)) / 8e-3
    np.testing.assert_allclose(found, expected, rtol=0.0, atol=1e-10 * np.max(expected))
