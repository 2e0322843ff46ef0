"""Derivatives of waves at an edge: a chain on a spring, central differences, ribbons, sums."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from numpy.testing import assert_allclose

import granphon as gp
from granphon.base.errors import PrecisionError
from granphon.dynamics.edge_energies import _find_decay
from tests.dynamics.test_network_lattice import CASES, random_network, turned
from tests.dynamics.test_sensitivities import FIELDS, changes, compare, contract, difference
from tests.dynamics.test_sensitivities import on_springs as hang
from tests.networks.test_cuts import BALL
from tests.phonons.test_surfaces import balls

#: names of the derivatives by stiffnesses, and of the fields of a network
STIFFNESSES = ("normal_stiffness", "shear_stiffness", "torsion", "bending", "on_site")


def end_chain(k, wall, **options):
    """A chain of equal balls with springs ``k`` whose end stands on a spring ``wall``, N/m."""
    crystal = gp.Crystal.on("chain", [BALL], law=gp.PowerLaw(1.0, wall), **options)
    network = crystal.at_force(10.0).network
    ratio = k / network.normal_stiffness
    return replace(
        network,
        normal_stiffness=ratio * network.normal_stiffness,
        shear_stiffness=ratio * network.shear_stiffness,
    )


@pytest.mark.claim("sensitivities-edges")
def test_a_chain_on_a_stiff_spring_has_closed_derivatives():
    """u_n = (k/(k - K))^n at m omega^2 = K^2/(K - k), of a chain k on a spring K > 2 k."""
    k = 1e6
    wall = 3.5e6
    mass = BALL.mass
    found = gp.Surface(end_chain(k, wall, friction=False), 0, "floor").sensitivities()
    f = found.waves.frequencies
    assert_allclose((2.0 * np.pi * f) ** 2, [wall**2 / ((wall - k) * mass)], rtol=1e-12)
    slope = 1.0 / (8.0 * np.pi**2 * f[0] * mass)
    decay = (k / (wall - k)) ** 2
    assert_allclose(
        found.crystal.normal_stiffness, [[slope * (wall / (wall - k)) ** 2]], rtol=1e-11
    )
    assert_allclose(found.crystal.mass, [[-0.5 * f[0] / mass]], rtol=1e-12)
    # one contact after another from the edge; the wall comes last
    by_wall = slope * wall * (wall - 2.0 * k) / (wall - k) ** 2
    contacts = slope * (1.0 - decay) * (wall / (wall - k)) ** 2 * decay ** np.arange(4)
    assert_allclose(found.outer.normal_stiffness, [[*contacts, by_wall]], rtol=1e-11)
    part = (1.0 - decay) * decay ** np.arange(5)
    assert_allclose(found.outer.mass, [[*(-0.5 * f[0] / mass * part), 0.0]], rtol=1e-11)
    assert_allclose(found.outer.on_site[0, :, 0], [*(slope * part), 0.0], rtol=1e-11)


def pressed():
    """A crystal whose contacts feel the forces that press them."""
    crystal = gp.Crystal.on("triangular", [BALL])
    return crystal.at_overlap(1e-3 * BALL.diameter, finite_overlap=True).network


#: networks, axes, edges and wave vectors, with waves that stay as parameters change
EDGES = {
    "chain on springs": (
        lambda: hang(random_network("chain", (2,), "longitudinal", seed=1)),
        0,
        "free",
        None,
    ),
    "triangular": (lambda: balls("triangular"), 1, "free", [[0.4]]),
    "triangular, clamped": (lambda: balls("triangular"), 1, "clamped", [[0.4]]),
    "square, a corner": (lambda: balls("square"), (1, 1), "free", [[0.2]]),
    "plane": (lambda: random_network("triangular", (2, 1), seed=3), 1, "free", [[0.3]]),
    "plane, turned": (
        lambda: turned(random_network("triangular", (2, 1), "all", seed=3)),
        0,
        "free",
        [[0.3]],
    ),
    "plane on springs": (
        lambda: hang(random_network("square", (1, 1), seed=3)),
        0,
        "clamped",
        [[0.3]],
    ),
    "space": (lambda: random_network("fcc", (1, 1, 1), seed=3), 2, "free", [[0.3, 0.2]]),
    "prestress": (pressed, 1, "free", [[0.4]]),
}
QUICK = ("chain on springs", "prestress")


@pytest.mark.claim("sensitivities-edges")
@pytest.mark.parametrize(
    "case",
    [case if case in QUICK else pytest.param(case, marks=pytest.mark.slow) for case in EDGES],
)
def test_derivatives_are_those_of_central_differences(case):
    make, axis, edge, q = EDGES[case]
    network = make()
    surface = gp.Surface(network, axis, edge)
    found = surface.sensitivities(q)
    assert len(found.waves.frequencies)
    assert not np.any(found.crystal.degenerate)
    assert (found.crystal.normal_force is None) == (case != "prestress")

    def find(changed):
        return gp.Surface(changed, axis, edge).branches(q).frequencies

    compare(network, find, found.crystal, surface.continuum(q).max())


@pytest.mark.claim("sensitivities-edges")
@pytest.mark.parametrize(
    ("lattice", "axis", "q"), [("triangular", 1, [[0.45]]), ("fcc", 2, [[0.5, 0.5]])]
)
def test_contacts_of_one_layer_are_those_of_a_thick_ribbon(lattice, axis, q):
    # on a wall of another material, which the upper face does not have
    network = gp.AveragedLattice(gp.Packing(BALL.material, 8e-3, lattice=lattice)).at_force(10.0)
    wall = gp.Wall(gp.Material(7e9, 0.2, 1000.0))
    surface = gp.Surface(network, axis, wall)
    found = surface.sensitivities(q)
    # others reach the upper face of the ribbon
    shallow = np.flatnonzero(found.waves.weight > 0.85)
    assert shallow.size
    count = 14
    ribbon = surface.network.cut(axis, count, (wall, "free"))
    phonons = gp.Phonons(ribbon)
    frequencies = phonons.frequencies(q)[0]
    for number in shallow:
        frequency = found.waves.frequencies[number]
        branch = int(np.argmin(np.abs(frequencies - frequency)))
        assert_allclose(frequencies[branch], frequency, rtol=1e-9)
        of_ribbon = phonons.sensitivities(q, [branch])
        outer = surface.outer
        # balls and contacts of layers that have their next layer in both are numbered alike
        n_balls = 4 * surface.half_space.per_layer
        n_contacts = int(np.count_nonzero((outer.i < n_balls) & (outer.j < outer.n_balls - 1)))
        for name in ("normal_stiffness", "shear_stiffness"):
            wanted = getattr(of_ribbon, name)[0, 0]
            own = getattr(found.outer, name)[number]
            largest = np.max(np.abs(wanted))
            chosen = slice(0, n_contacts)
            assert_allclose(own[chosen], wanted[chosen], rtol=0.0, atol=1e-8 * largest)
            assert_allclose(own[-1], wanted[-1], rtol=1e-6, atol=1e-8 * largest)  # the wall
            assert own[-1] > 0.0
            between = np.sum(wanted[ribbon.j < ribbon.n_balls - 1])
            assert_allclose(getattr(found.crystal, name)[number].sum(), between, rtol=1e-8)
        for name in ("mass", "inertia"):
            wanted = getattr(of_ribbon, name)[0, 0]
            own = getattr(found.outer, name)[number]
            largest = np.max(np.abs(wanted))
            assert_allclose(own[:n_balls], wanted[:n_balls], rtol=0.0, atol=1e-8 * largest)
            assert_allclose(getattr(found.crystal, name)[number].sum(), wanted.sum(), rtol=1e-8)


def test_sums_over_all_parameters_are_a_half_of_each_frequency():
    """f goes as the root of all stiffnesses, with those of the wall, and one over all masses."""
    network = hang(balls("triangular"))
    surface = gp.Surface(network, 1, gp.Wall(gp.Material(70e9, 0.3, 2700.0)))
    found = surface.sensitivities([[0.2], [0.45]])
    f = found.waves.frequencies
    assert len(f)
    outer = surface.outer
    at_wall = outer.j == outer.n_balls - 1
    springs = np.zeros(len(f))
    for name in STIFFNESSES:
        springs += contract(getattr(found.crystal, name), getattr(network, FIELDS[name]))
        if name != "on_site":
            of_outer = getattr(found.outer, name)
            springs += of_outer[:, at_wall] @ getattr(outer, FIELDS[name])[at_wall]
    masses = found.crystal.mass @ network.masses + found.crystal.inertia @ network.inertias
    assert_allclose(springs, 0.5 * f, rtol=1e-11)
    assert_allclose(masses, -0.5 * f, rtol=1e-11)


def alternating():
    """A chain of stiff and soft contacts by turns, whose balls move in space."""
    pair = gp.Crystal.on("chain", [BALL, BALL], motions="all").at_force(10.0).network
    stiff = np.where(np.any(pair.shift != 0, axis=1), 3.0, 1.0)
    return replace(
        pair,
        normal_stiffness=stiff * pair.normal_stiffness,
        shear_stiffness=stiff * pair.shear_stiffness,
    )


def test_equal_waves_of_a_chain_are_told():
    found = gp.Surface(alternating(), 0, "clamped").sensitivities()
    degenerate = found.crystal.degenerate
    assert np.any(degenerate)
    assert not np.all(degenerate)
    assert np.array_equal(degenerate, found.outer.degenerate)

    # springs across the chain in one direction part the pair; springs in both do not
    across = found.crystal.on_site[degenerate][:, :, 1:3]
    assert_allclose(across[..., 0], across[..., 1], rtol=1e-9)


@pytest.mark.slow
@pytest.mark.parametrize("name", ["shear_stiffness", "mass"])
def test_equal_waves_have_the_derivative_of_their_mean(name):
    network = alternating()
    found = gp.Surface(network, 0, "clamped").sensitivities()

    def find(changed):
        return gp.Surface(changed, 0, "clamped").branches().frequencies

    change = changes(network, name)
    own = contract(getattr(found.crystal, name), change)
    wanted = difference(find, network, name, change)
    assert_allclose(own, wanted, rtol=0.0, atol=1e-8 * np.max(found.waves.frequencies))


@pytest.mark.claim("sensitivities-edges")
def test_named_parameters_go_through_the_statics():
    packing = gp.Packing(BALL.material, 8e-3)

    def find(state):
        surface = gp.Surface(state, 1)
        return np.append(surface.branches([[0.4]]).frequencies, surface.velocity())

    found = gp.parameter_sensitivities(
        packing, find, ("young_modulus", "density", "force", "poisson_ratio"), force=10.0
    )
    assert_allclose(found["young_modulus"], 1.0 / 3.0, rtol=1e-9)
    assert_allclose(found["density"], -0.5, rtol=1e-9)
    assert_allclose(found["force"], 1.0 / 6.0, rtol=1e-9)
    # the derivatives by contacts, times those of their stiffnesses
    state = gp.AveragedLattice(packing).at_force(10.0)
    edge = gp.Surface(state, 1).sensitivities([[0.4]])

    def stiffnesses(poisson_ratio):
        material = replace(packing.material, poisson_ratio=poisson_ratio)
        changed = gp.AveragedLattice(replace(packing, material=material)).at_force(10.0).network
        return np.array([changed.normal_stiffness, changed.shear_stiffness])

    ratio = packing.material.poisson_ratio
    step = 1e-4
    slopes = (stiffnesses(ratio + step) - stiffnesses(ratio - step)) / (2.0 * step)
    by_contact = np.array([edge.crystal.normal_stiffness, edge.crystal.shear_stiffness])
    expected = ratio / edge.waves.frequencies * np.einsum("kwc,kc->w", by_contact, slopes)
    assert_allclose(found["poisson_ratio"][:-1], expected, rtol=1e-6)


def test_a_wave_vector_without_a_wave_has_no_derivatives():
    network = end_chain(1e6, 1.5e6, friction=False)
    found = gp.Surface(network, 0, "floor").sensitivities()
    assert found.crystal.normal_stiffness.shape == (0, 1)
    assert found.outer.on_site.shape == (0, 6, 1)
    assert gp.SurfaceSensitivities.from_dict(found.to_dict()) == found


def test_waves_of_the_bulk_have_no_decay():
    half = gp.Surface(CASES["chain"](), 0).half_space
    _, inner, hop = half.blocks(np.zeros((1, 0)))
    low, high = half.bands(np.zeros((1, 0)))[0, 0]
    with pytest.raises(PrecisionError):
        _find_decay(inner[0], hop[0], 0.5 * (low + high))
