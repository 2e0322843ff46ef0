"""Crystals of several kinds of balls: how they are made, their statics against closed forms and twins, and their errors."""

from __future__ import annotations

import math

import numpy as np
import pytest
from numpy.testing import assert_allclose

import granphon as gp
from granphon.balls.lattices import LATTICES
from granphon.base.errors import InputError

G = 9.81
#: Al 6061 and steel 316, balls of 19.05 mm
STEEL, ALUMINIUM = gp.Material(193e9, 0.30, 8000.0), gp.Material(73.5e9, 0.33, 2700.0)
S, A = gp.Ball(STEEL, 19.05e-3, mass=28.84e-3), gp.Ball(ALUMINIUM, 19.05e-3, mass=9.75e-3)
PLAIN = gp.Ball(gp.Material(211.65e9, 0.276, 7840.0), 8e-3)
SOFT = gp.Ball(gp.Material(70e9, 0.2, 2500.0), 8e-3)


def pull_on_balls(state):
    """(n, d) sum of the contact forces on each ball of a crystal, N, and the virial, from its own table and normals."""
    crystal, table = state.crystal, state.crystal.contacts
    count = len(table)
    force = state.normal_force[:count, None] * state.normal[:count]
    pull = np.zeros((crystal.n_balls, crystal.dimension))
    np.add.at(pull, table.j, force)
    np.add.at(pull, table.i, -force)
    return pull, force.T @ table.vector


def list_contacts(crystal):
    """The contacts of a crystal as a sorted list, each from its first end."""
    table = crystal.contacts
    rows = []
    for i, j, shift in zip(table.i.tolist(), table.j.tolist(), map(tuple, table.shift.tolist()), strict=True):
        back = tuple(-one for one in shift)
        rows.append(min((i, j, shift), (j, i, back)))
    return sorted(rows)


# -- how they are made ------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("name", LATTICES)
@pytest.mark.parametrize("kind", ["force", "pressure", "overlap"])
def test_equal_balls_are_a_packing(name, kind):
    packing, crystal = gp.Packing(PLAIN.material, 8e-3, lattice=name), gp.Crystal.on(name, [PLAIN])
    values = {"force": [1e-6, 20.0], "pressure": [1e-3, 2e3], "overlap": [1e-12, 1e-6]}[kind]
    for follows in (False, True):
        state = getattr(gp.AveragedLattice(packing), f"at_{kind}")(values, finite_overlap=follows)
        mine = getattr(crystal, f"at_{kind}")(values, finite_overlap=follows)
        count = np.ones(mine.normal_force.shape[1])
        pairs = {"normal_force": "force"} | {n: n for n in ("overlap", "normal_stiffness", "shear_stiffness")}
        for name_of, other in pairs.items():
            assert_allclose(getattr(mine, name_of), np.multiply.outer(getattr(state, other), count), rtol=1e-13)
        pressure = -np.trace(mine.stress, axis1=1, axis2=2) / crystal.periods
        assert_allclose(pressure, state.pressure, rtol=1e-13)
        one = mine[1].scales
        assert_allclose([one.length, one.stiffness, one.mass], [8e-3, state.normal_stiffness[1], packing.mass], rtol=1e-13)


@pytest.mark.parametrize("follows", [False, True])
@pytest.mark.parametrize("name", ["triangular", "fcc", "hcp"])
def test_the_network_of_equal_balls_is_that_of_the_packing(name, follows):
    packing, crystal = gp.Packing(PLAIN.material, 8e-3, lattice=name), gp.Crystal.on(name, [PLAIN])
    wanted = gp.ContactNetwork.from_state(
        gp.AveragedLattice(packing).at_force(9.0, finite_overlap=follows), (1,) * crystal.periods
    )
    found = crystal.at_force(9.0, finite_overlap=follows).network
    for field in ("cell", "positions", "radii", "masses", "inertias", "normal", *wanted.contact_fields):
        assert_allclose(getattr(found, field), getattr(wanted, field), rtol=1e-12, atol=1e-14 * 8e-3, err_msg=field)
    assert (found.pbc, found.motions, found.dimension, found.prestress) == (
        wanted.pbc, wanted.motions, wanted.dimension, wanted.prestress
    )  # fmt: skip


@pytest.mark.parametrize(
    ("name", "contacts", "distance"), [("NaCl", 6, 2.0), ("CsCl", 8, 2 / 3**0.5), ("zincblende", 4, None)]
)
def test_structures_of_two_kinds(name, contacts, distance):
    large, small = gp.Ball(STEEL, 10e-3), gp.Ball(ALUMINIUM, 8e-3)
    crystal = gp.Crystal.on(name, [large, small])
    table = crystal.contacts
    assert (len(table), crystal.n_balls, crystal.names) == (contacts, 2, ("A", "B"))
    assert set(zip(table.i.tolist(), table.j.tolist(), strict=True)) <= {(0, 1), (1, 0)}
    assert_allclose(np.linalg.norm(table.vector, axis=1), 9e-3, rtol=1e-14)
    if distance:  # the edge of the cube: 2 r or 2 r/sqrt 3
        assert_allclose(abs(np.linalg.det(crystal.cell)), (distance * 9e-3) ** 3 / {6: 4, 8: 1}[contacts], rtol=1e-12)
    state = crystal.at_pressure(1e4)
    assert_allclose(state.normal_force, state.normal_force[0], rtol=1e-12)
    law = gp.Hertz().between(large, small)
    assert_allclose(state.normal_stiffness, law.stiffness(law.overlap(state.normal_force)), rtol=1e-13)


def test_a_chain_takes_any_number_of_kinds():
    sizes = [3e-3, 8e-3, 5e-3, 1e-3]
    balls = [gp.Ball(STEEL, size) for size in sizes]
    crystal = gp.Crystal.on("chain", balls)
    assert_allclose(crystal.cell, [[sum(sizes)]], rtol=1e-15)
    state = crystal.at_force(2.0)
    assert_allclose(state.normal_force, 2.0, rtol=1e-14)
    pairs = [(0, 1), (1, 2), (2, 3), (3, 0)]
    ends = {
        tuple(sorted(pair)): at
        for at, pair in enumerate(zip(crystal.contacts.i.tolist(), crystal.contacts.j.tolist(), strict=True))
    }
    for one, other in pairs:
        law = gp.Hertz().between(balls[one], balls[other])
        assert_allclose(state.overlap[ends[tuple(sorted((one, other)))]], law.overlap(2.0), rtol=1e-13)
    # the cell shortens by all overlaps
    assert_allclose(state.strain[0, 0] * crystal.cell[0, 0], -np.sum(state.overlap), rtol=1e-13)
    assert_allclose(crystal.at_overlap(1e-7).overlap.mean(), 1e-7, rtol=1e-13)


def test_a_crystal_from_atoms():
    from ase.build import bulk

    atoms = bulk("NaCl", "rocksalt", a=2 * 9e-3)
    balls = {"Na": gp.Ball(STEEL, 10e-3), "Cl": gp.Ball(ALUMINIUM, 8e-3)}
    crystal = gp.Crystal.from_atoms(atoms, balls)
    assert crystal.names == ("Na", "Cl")
    assert_allclose(crystal.at_force(3.0).normal_force, 3.0, rtol=1e-13)
    flat = bulk("NaCl", "rocksalt", a=2 * 9e-3, cubic=True)
    flat.pbc = (True, True, False)
    layer = flat[np.abs(flat.positions[:, 2]) < 1e-6]
    plane = gp.Crystal.from_atoms(layer, balls)
    assert (plane.dimension, plane.periods, plane.n_balls, plane.n_contacts) == (2, 2, 4, 8)
    with pytest.raises(InputError, match="no ball for Cl"):
        gp.Crystal.from_atoms(atoms, {"Na": S})


@pytest.mark.parametrize("name", ["chain", "kagome", "fcc"])
def test_a_supercell_is_the_same_crystal(name):
    crystal = gp.Crystal.on(name, [PLAIN])
    shape = {1: (5,), 2: (2, 3), 3: (2, 1, 3)}[crystal.periods]
    large = crystal.repeat(shape)
    again = gp.Crystal(large.balls, large.cell, large.positions)
    assert list_contacts(large) == list_contacts(again)
    assert_allclose(large.at_pressure(10.0).normal_force, crystal.at_pressure(10.0).normal_force[0], rtol=1e-12)


# -- closed forms -----------------------------------------------------------------------------------------------------


def test_a_chain_of_steel_and_aluminium():
    """Its band edges at 20 N, their gap, and its sound."""
    state = gp.Crystal.on("chain", [S, A]).at_force(20.0)
    k = state.normal_stiffness[0]
    edges = np.sqrt(2 * k * np.array([1 / S.mass, 1 / A.mass, 1 / S.mass + 1 / A.mass])) / (2 * math.pi)
    assert_allclose(edges, [4710.53, 8101.49, 9371.40], atol=0.01)
    assert_allclose(state.crystal.cell[0, 0] * math.sqrt(k / 2 / (S.mass + A.mass)), 487.42, atol=0.01)
    found = gp.Waves(state.network.repeat((20,))).modes(39).frequencies
    assert_allclose([found[18], found[19], found[-1]], edges, atol=0.01)


def test_fcc_pressed_along_an_axis_carries_with_eight_of_twelve_contacts():
    crystal = gp.Crystal.on("fcc", [PLAIN])
    state = crystal.at_strain([[0, 0, 0], [0, 0, 0], [0, 0, -1e-4]])
    closed = state.normal_force > 0.0
    across = np.abs(crystal.contacts.normal[:, 2]) < 0.5
    assert closed.sum() == 4
    assert not np.any(closed & across)
    assert state.network.n_contacts == 4
    assert_allclose(state.overlap[closed], 8e-3 * 0.5e-4, rtol=1e-12)
    assert_allclose(np.diag(state.stress)[2] / np.diag(state.stress)[:2], 2.0, rtol=1e-12)
    assert_allclose(crystal.at_strain([0, 0, -1e-4, 0, 0, 0]).normal_force, state.normal_force, rtol=1e-15)
    # the same as a stress, whose sides are those of contacts at 45 degrees
    again = crystal.at_stress(state.stress)
    assert_allclose(again.normal_force, state.normal_force, rtol=1e-9, atol=1e-9 * state.normal_force.max())
    with pytest.raises(InputError, match=r"cannot bear the stress .* no such forces add up to it. A pressure of 1e.05 Pa"):
        crystal.at_stress([0, 0, -1e5, 0, 0, 0])


@pytest.mark.parametrize("exponent", [1.0, 1.5, 2.0, 3.0])
def test_the_local_exponent_of_a_power_law(exponent):
    """v ~ k^(1/2) ~ P^((a - 1)/2a)."""
    crystal = gp.Crystal.on("fcc", [PLAIN], law=gp.PowerLaw(exponent, 1e9))
    low, high = crystal.at_pressure([1.0, 1.001])
    slope = np.log(high.normal_stiffness / low.normal_stiffness) / (2 * np.log(1.001))
    assert_allclose(slope, (exponent - 1) / (2 * exponent), atol=1e-12)


@pytest.mark.parametrize("law", [gp.JKR(0.05), gp.DMT(0.05)])
def test_balls_that_adhere_need_no_load(law):
    gel = gp.Ball(gp.Material(1e6, 0.49, 1100.0), 2e-3)
    crystal, pair = gp.Crystal.on("fcc", [gel], law=law), law.between(gel, gel)
    state = crystal.at_pressure(0.0)
    assert_allclose(state.overlap, pair.overlap(0.0), rtol=1e-12)
    assert_allclose(state.normal_stiffness, pair.stiffness(pair.overlap(0.0)), rtol=1e-12)
    most = -pair.force(pair.least_overlap)
    pulled = crystal.at_pressure(-0.9 * 2 * 2**0.5 * most / gel.diameter**2)
    assert_allclose(pulled.normal_force, -0.9 * most, rtol=1e-11)
    with pytest.raises(InputError, match=r"cannot bear a pressure of .* up to the tension that contacts bear"):
        crystal.at_pressure(-1.1 * 2 * 2**0.5 * most / gel.diameter**2)


def test_a_tabulated_hertz_law_gives_the_numbers_of_hertz():
    table = np.geomspace(1e-9, 1e-4, 31)
    law = gp.TabulatedLaw(table, gp.Hertz().between(S, A).force(table))
    wanted = gp.Crystal.on("NaCl", [S, A]).at_pressure(1e5)
    found = gp.Crystal.on("NaCl", [S, A], law=law).at_pressure(1e5)
    for name in ("normal_force", "overlap", "normal_stiffness", "shear_stiffness"):
        assert_allclose(getattr(found, name), getattr(wanted, name), rtol=1e-12)


def test_laws_by_pairs_of_kinds():
    laws = {("A", "B"): gp.PowerLaw(2.0, 1e12), ("C", "B"): gp.Hertz(), ("A", "C"): gp.PowerLaw(1.0, 1e6)}
    third = gp.Ball(STEEL, 10e-3)
    crystal = gp.Crystal.on("chain", [S, A, third], law=laws)
    state = crystal.at_force(3.0)
    pairs = {
        tuple(sorted((i, j))): at
        for at, (i, j) in enumerate(zip(crystal.contacts.i.tolist(), crystal.contacts.j.tolist(), strict=True))
    }
    assert_allclose(state.overlap[pairs[0, 1]], (3.0 / 1e12) ** 0.5, rtol=1e-12)
    assert_allclose(state.overlap[pairs[0, 2]], 3e-6, rtol=1e-12)
    assert_allclose(state.overlap[pairs[1, 2]], gp.Hertz().between(A, third).overlap(3.0), rtol=1e-12)
    with pytest.raises(InputError, match=r"law has none for contacts of \('B', 'C'\)"):
        gp.Crystal.on("chain", [S, A, third], law={("A", "B"): gp.Hertz(), ("A", "C"): gp.Hertz()})
    with pytest.raises(InputError, match="law names the kind 'D'"):
        gp.Crystal.on("chain", [S, A], law={("A", "D"): gp.Hertz()})


def test_shear_and_torsion_of_unlike_balls():
    crystal = gp.Crystal.on("CsCl", [S, A], torsion="mindlin", bending=0.01)
    state = crystal.at_pressure(1e5)
    k = state.normal_stiffness
    nu = [ball.material.poisson_ratio for ball in (S, A)]
    shear = [ball.material.shear_modulus for ball in (S, A)]
    star = 1 / sum((1 - n) / (2 * g) for n, g in zip(nu, shear, strict=True))
    radius = np.sqrt(S.radius / 2 * state.overlap)
    assert_allclose(state.contact_radius, radius, rtol=1e-12)
    assert_allclose(k, 2 * star * radius, rtol=1e-12)
    kappa = 8 * radius / sum((2 - n) / g for n, g in zip(nu, shear, strict=True))
    assert_allclose(state.shear_stiffness, kappa, rtol=1e-12)
    assert_allclose(state.torsion_stiffness, 16 / 3 * radius**3 / sum(1 / g for g in shear), rtol=1e-12)
    assert_allclose(state.bending_stiffness, 0.01 * k * 19.05e-3**2, rtol=1e-12)
    packing = gp.Packing(PLAIN.material, 8e-3, lattice="fcc", torsion="mindlin")
    wanted, found = gp.AveragedLattice(packing).at_force(5.0), gp.Crystal.on("fcc", [PLAIN], torsion="mindlin").at_force(5.0)
    assert_allclose(found.torsion_stiffness, wanted.torsion_stiffness, rtol=1e-12)


def test_a_light_impurity_in_a_chain():
    """omega^2 = omega_max^2/(1 - e^2) for m' = (1 - e) m."""
    e = 0.6
    light = gp.Ball(PLAIN.material, 8e-3, mass=(1 - e) * PLAIN.mass)
    chain = gp.Crystal.on("chain", [PLAIN]).repeat((60,)).replace(30, light)
    assert chain.names == ("A", "B")
    state = chain.at_force(5.0)
    top = gp.Waves(state.network).modes(59).frequencies[-1] * 2 * math.pi
    assert_allclose(top**2, 4 * state.normal_stiffness[0] / PLAIN.mass / (1 - e**2), rtol=1e-12)
