"""Crystals of several kinds of balls: how they are made, their statics against closed forms and
twins, and their errors.
"""

from __future__ import annotations

import itertools
import json
import math
import pickle
from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from ase import Atoms
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.testing import assert_allclose
from scipy.integrate import quad
from scipy.optimize import brentq, minimize
from scipy.special import jv

import granphon as gp
from granphon.balls.lattices import LATTICES
from granphon.base.errors import InputError
from granphon.media import crystal as crystal_module
from granphon.media.mean_force import MeanGoal, PressureSearch
from granphon.media.state import as_state

G = 9.81
#: Al 6061 and steel 316, balls of 19.05 mm
STEEL = gp.Material(193e9, 0.30, 8000.0)
ALUMINIUM = gp.Material(73.5e9, 0.33, 2700.0)
S = gp.Ball(STEEL, 19.05e-3, mass=28.84e-3)
A = gp.Ball(ALUMINIUM, 19.05e-3, mass=9.75e-3)
PLAIN = gp.Ball(gp.Material(211.65e9, 0.276, 7840.0), 8e-3)
SOFT = gp.Ball(gp.Material(70e9, 0.2, 2500.0), 8e-3)


def pull_on_balls(state):
    """(n, d) sum of the contact forces on each ball of a crystal, N, and the virial, from its own
    table and normals.
    """
    crystal = state.crystal
    table = state.crystal.contacts
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
    for i, j, shift in zip(
        table.i.tolist(), table.j.tolist(), map(tuple, table.shift.tolist()), strict=True
    ):
        back = tuple(-one for one in shift)
        rows.append(min((i, j, shift), (j, i, back)))
    return sorted(rows)


# -- how they are made -----------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("name", "kind"),
    [
        *((name, "force") for name in LATTICES),
        *((name, kind) for name in ("triangular", "hcp") for kind in ("pressure", "overlap")),
        *(
            pytest.param(name, kind, marks=pytest.mark.slow)
            for name in LATTICES
            for kind in ("pressure", "overlap")
            if name not in ("triangular", "hcp")
        ),
    ],
)
def test_equal_balls_are_a_packing(name, kind):
    packing = gp.Packing(PLAIN.material, 8e-3, lattice=name)
    crystal = gp.Crystal.on(name, [PLAIN])
    values = {"force": [1e-6, 20.0], "pressure": [1e-3, 2e3], "overlap": [1e-12, 1e-6]}[kind]
    for follows in (False, True):
        state = getattr(gp.AveragedLattice(packing), f"at_{kind}")(values, finite_overlap=follows)
        mine = getattr(crystal, f"at_{kind}")(values, finite_overlap=follows)
        count = np.ones(mine.normal_force.shape[1])
        pairs = {"normal_force": "force"} | {
            n: n for n in ("overlap", "normal_stiffness", "shear_stiffness")
        }
        for name_of, other in pairs.items():
            assert_allclose(
                getattr(mine, name_of), np.multiply.outer(getattr(state, other), count), rtol=1e-13
            )
        pressure = -np.trace(mine.stress, axis1=1, axis2=2) / crystal.periods
        assert_allclose(pressure, state.pressure, rtol=1e-13)
        one = mine[1].scales
        assert_allclose(
            [one.length, one.stiffness, one.mass],
            [8e-3, state.normal_stiffness[1], packing.mass],
            rtol=1e-13,
        )


@pytest.mark.parametrize("follows", [False, True])
@pytest.mark.parametrize("name", ["triangular", "fcc", "hcp"])
def test_the_network_of_equal_balls_is_that_of_the_packing(name, follows):
    packing = gp.Packing(PLAIN.material, 8e-3, lattice=name)
    crystal = gp.Crystal.on(name, [PLAIN])
    wanted = gp.AveragedLattice(packing).at_force(9.0, finite_overlap=follows).network
    found = crystal.at_force(9.0, finite_overlap=follows).network
    for field in (
        "cell",
        "positions",
        "radii",
        "masses",
        "inertias",
        "normal",
        *wanted.contact_fields,
    ):
        assert_allclose(
            getattr(found, field),
            getattr(wanted, field),
            rtol=1e-12,
            atol=1e-14 * 8e-3,
            err_msg=field,
        )
    assert (found.pbc, found.motions, found.dimension, found.prestress) == (
        wanted.pbc,
        wanted.motions,
        wanted.dimension,
        wanted.prestress,
    )


@pytest.mark.parametrize(
    ("name", "contacts", "distance"),
    [("NaCl", 6, 2.0), ("CsCl", 8, 2 / 3**0.5), ("zincblende", 4, None)],
)
def test_structures_of_two_kinds(name, contacts, distance):
    large = gp.Ball(STEEL, 10e-3)
    small = gp.Ball(ALUMINIUM, 8e-3)
    crystal = gp.Crystal.on(name, [large, small])
    table = crystal.contacts
    assert (len(table), crystal.n_balls, crystal.names) == (contacts, 2, ("A", "B"))
    assert set(zip(table.i.tolist(), table.j.tolist(), strict=True)) <= {(0, 1), (1, 0)}
    assert_allclose(np.linalg.norm(table.vector, axis=1), 9e-3, rtol=1e-14)
    if distance:  # the edge of the cube: 2 r or 2 r/sqrt 3
        assert_allclose(
            abs(np.linalg.det(crystal.cell)),
            (distance * 9e-3) ** 3 / {6: 4, 8: 1}[contacts],
            rtol=1e-12,
        )
    state = crystal.at_pressure(1e4)
    assert_allclose(state.normal_force, state.normal_force[0], rtol=1e-12)
    law = gp.Hertz().between(large, small)
    assert_allclose(
        state.normal_stiffness, law.stiffness(law.overlap(state.normal_force)), rtol=1e-13
    )


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
        for at, pair in enumerate(
            zip(crystal.contacts.i.tolist(), crystal.contacts.j.tolist(), strict=True)
        )
    }
    for one, other in pairs:
        law = gp.Hertz().between(balls[one], balls[other])
        assert_allclose(
            state.overlap[ends[tuple(sorted((one, other)))]], law.overlap(2.0), rtol=1e-13
        )
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
    assert_allclose(
        large.at_pressure(10.0).normal_force, crystal.at_pressure(10.0).normal_force[0], rtol=1e-12
    )


# -- closed forms ----------------------------------------------------------------------------------


def test_a_chain_of_steel_and_aluminium():
    """Its band edges at 20 N, their gap, and its sound."""
    state = gp.Crystal.on("chain", [S, A]).at_force(20.0)
    k = state.normal_stiffness[0]
    edges = np.sqrt(2 * k * np.array([1 / S.mass, 1 / A.mass, 1 / S.mass + 1 / A.mass])) / (
        2 * math.pi
    )
    assert_allclose(edges, [4710.53, 8101.49, 9371.40], atol=0.01)
    assert_allclose(
        state.crystal.cell[0, 0] * math.sqrt(k / 2 / (S.mass + A.mass)), 487.42, atol=0.01
    )
    phonons = gp.Phonons(state)
    assert_allclose(
        phonons.frequencies([[0.5], [0.0]]), [edges[:2], [0.0, edges[2]]], rtol=1e-13, atol=1e-9
    )
    assert_allclose(phonons.gaps(), [edges[:2]], rtol=1e-12)
    assert_allclose(gp.sound_velocities(state).longitudinal, 487.42, atol=0.01)
    found = gp.Waves(state.network.repeat((20,))).modes(39).frequencies
    assert_allclose([found[18], found[19], found[-1]], edges, rtol=1e-12)


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
    assert_allclose(
        crystal.at_strain([0, 0, -1e-4, 0, 0, 0]).normal_force, state.normal_force, rtol=1e-15
    )
    # sound along the axis; kappa/6 is the rotation of balls under unequal contacts
    k = state.normal_stiffness[closed]
    kappa = state.shear_stiffness[closed]
    v = gp.sound_velocities(state, (0, 0, 1))
    unit = 8e-3**2 / PLAIN.mass
    assert_allclose(v.longitudinal**2, (k[0] + kappa[0]) * unit, rtol=1e-12)
    assert_allclose(np.square(v.transverse), (k[0] / 2 + kappa[0] / 6) * unit, rtol=1e-12)
    # the same as a stress, whose sides are those of contacts at 45 degrees
    again = crystal.at_stress(state.stress)
    assert_allclose(
        again.normal_force, state.normal_force, rtol=1e-9, atol=1e-9 * state.normal_force.max()
    )
    with pytest.raises(
        InputError,
        match=r"stress .* 1e.05 Pa",
    ):
        crystal.at_stress([0, 0, -1e5, 0, 0, 0])


@pytest.mark.parametrize("exponent", [1.0, 1.5, 2.0, 3.0])
def test_the_local_exponent_of_a_power_law(exponent):
    """v ~ k^(1/2) ~ P^((a - 1)/2a)."""
    crystal = gp.Crystal.on("fcc", [PLAIN], law=gp.PowerLaw(exponent, 1e9))
    low, high = crystal.at_pressure([1.0, 1.001])
    slope = np.log(high.normal_stiffness / low.normal_stiffness) / (2 * np.log(1.001))
    assert_allclose(slope, (exponent - 1) / (2 * exponent), atol=1e-12)
    assert_allclose(
        gp.local_exponent(crystal.at_pressure([1.0, 5.0])),
        2 * [(exponent - 1) / (2 * exponent)],
        atol=1e-12,
    )


def test_contacts_of_several_powers_have_no_single_exponent():
    one, other = gp.Ball(STEEL, 8e-3, name="one"), gp.Ball(STEEL, 8e-3, name="other")
    laws = {("one", "one"): gp.Hertz(), ("one", "other"): gp.PowerLaw(2.0, 1e12)}
    state = gp.Crystal.on("chain", [one, one, other], law=laws).at_force(10.0)
    with pytest.raises(InputError, match=r"exponents .*0\.166667 to 0\.25"):
        gp.local_exponent(state)


class WidePower(gp.PowerLaw):
    """A power law of contacts whose radius goes as the root of the overlap."""

    def contact_radius(self, overlap):
        return 0.01 * np.sqrt(np.maximum(overlap, 0.0))


@pytest.mark.parametrize(
    ("lattice", "law", "friction"),
    [
        ("triangular", gp.DMT(0.01), True),
        ("triangular", gp.JKR(0.01), False),
        ("chain", gp.JKR(0.01), True),
        ("triangular", WidePower(1.5, 1e9), True),
    ],
)
def test_all_velocities_have_the_local_exponent(lattice, law, friction):
    crystal = gp.Crystal.on(lattice, [PLAIN], law=law, friction=friction)
    step = 1e-4
    states = crystal.at_pressure(0.3 * np.exp(step * np.array([-1.0, 0.0, 1.0])))
    exponent = gp.local_exponent(states)[1]
    velocities = gp.sound_velocities(states, [1.0, 0.5][: crystal.dimension])
    for name in ("longitudinal", "transverse")[: crystal.dimension]:
        below, _, above = getattr(velocities, name)
        assert_allclose(np.log(above / below) / (2.0 * step), exponent, rtol=1e-6)


@pytest.mark.parametrize("law", [gp.JKR(0.01), WidePower(1.0, 1e9), WidePower(2.0, 1e9)])
def test_no_exponent_is_given_where_shear_and_normal_stiffness_grow_differently(law):
    states = gp.Crystal.on("triangular", [PLAIN], law=law).at_pressure([0.1, 0.3, 1.0])
    with pytest.raises(InputError, match=r"of the normal stiffness, and .* of the shear"):
        gp.local_exponent(states)


@pytest.mark.parametrize("law", [pytest.param(gp.JKR(0.05), marks=pytest.mark.slow), gp.DMT(0.05)])
def test_balls_that_adhere_need_no_load(law):
    gel = gp.Ball(gp.Material(1e6, 0.49, 1100.0), 2e-3)
    crystal, pair = gp.Crystal.on("fcc", [gel], law=law), law.between(gel, gel)
    state = crystal.at_pressure(0.0)
    assert_allclose(state.overlap, pair.overlap(0.0), rtol=1e-12)
    assert_allclose(state.normal_stiffness, pair.stiffness(pair.overlap(0.0)), rtol=1e-12)
    most = -pair.force(pair.least_overlap)
    pulled = crystal.at_pressure(-0.9 * 2 * 2**0.5 * most / gel.diameter**2)
    assert_allclose(pulled.normal_force, -0.9 * most, rtol=1e-11)
    # pressed along one axis, contacts across it pull, and stay in the network
    strained = crystal.at_strain([0.0, 0.0, -1e-3, 0.0, 0.0, 0.0])
    assert np.any(strained.normal_force < 0.0)
    assert strained.network.n_contacts == np.count_nonzero(strained.normal_stiffness)
    stiff = strained.normal_stiffness > 0.0  # those of DMT have no stiffness where balls only touch
    assert_allclose(strained.network.normal_force, strained.normal_force[stiff], rtol=1e-15)
    with pytest.raises(InputError, match=r"pressure of .* tension"):
        crystal.at_pressure(-1.1 * 2 * 2**0.5 * most / gel.diameter**2)


def test_laws_by_pairs_of_kinds():
    laws = {
        ("A", "B"): gp.PowerLaw(2.0, 1e12),
        ("C", "B"): gp.Hertz(),
        ("A", "C"): gp.PowerLaw(1.0, 1e6),
    }
    third = gp.Ball(STEEL, 10e-3)
    crystal = gp.Crystal.on("chain", [S, A, third], law=laws)
    state = crystal.at_force(3.0)
    pairs = {
        tuple(sorted((i, j))): at
        for at, (i, j) in enumerate(
            zip(crystal.contacts.i.tolist(), crystal.contacts.j.tolist(), strict=True)
        )
    }
    assert_allclose(state.overlap[pairs[0, 1]], (3.0 / 1e12) ** 0.5, rtol=1e-12)
    assert_allclose(state.overlap[pairs[0, 2]], 3e-6, rtol=1e-12)
    assert_allclose(
        state.overlap[pairs[1, 2]], gp.Hertz().between(A, third).overlap(3.0), rtol=1e-12
    )
    with pytest.raises(InputError, match=r"law .*\('B', 'C'\)"):
        gp.Crystal.on("chain", [S, A, third], law={("A", "B"): gp.Hertz(), ("A", "C"): gp.Hertz()})
    with pytest.raises(InputError, match=r"law .*\('A', 'B'\)"):
        gp.Crystal.on("chain", [S, A], law={("A", "D"): gp.Hertz()})


@pytest.mark.claim("jkr-shear")
def test_shear_and_torsion_of_balls_that_adhere_by_jkr():
    """They are those of the contact radius of Johnson, Kendall and Roberts: without a load 0.6 is
    that of the stiffness.
    """
    rubber = gp.Ball(gp.Material(5e6, 0.49, 1100.0), 2e-3)
    w = 0.1
    shear = rubber.material.shear_modulus
    r = 0.5e-3
    nu = 0.49
    star = shear / (1 - nu)
    for pressure in (0.0, 200.0, 5e3):
        state = gp.Crystal.on("fcc", [rubber], law=gp.JKR(w), torsion="mindlin").at_pressure(
            pressure
        )
        reach = 3 * np.pi * w * r
        force = state.normal_force
        radius = np.cbrt(0.75 * r / star * (force + reach + np.sqrt(2 * reach * force + reach**2)))
        assert_allclose(state.contact_radius, radius, rtol=1e-10)
        assert_allclose(state.shear_stiffness, 4 * shear / (2 - nu) * radius, rtol=1e-10)
        assert_allclose(state.torsion_stiffness, 8 / 3 * shear * radius**3, rtol=1e-10)
        assert_allclose(state.network.shear_stiffness, state.shear_stiffness, rtol=1e-15)
        part = state.normal_stiffness / (2 * star * radius)
        assert np.all(part < 1.0)
        if not pressure:
            assert_allclose(part, 0.6, rtol=1e-12)
    # balls of ASE have the same contacts
    state = gp.Crystal.on("fcc", [rubber], law=gp.JKR(w)).at_pressure(200.0, finite_overlap=True)
    pair = gp.JKR(w).between(rubber, rubber)
    atoms = Atoms("XX", positions=[[0.0] * 3, [2e-3 - float(state.overlap[0]), 0.0, 0.0]])
    network = gp.HertzMindlin({"X": rubber}, law=gp.JKR(w)).contact_network(
        atoms, keep_rattlers=True
    )
    kappa = 4 * shear / (2 - nu) * pair.contact_radius(state.overlap[0])
    assert_allclose(network.shear_stiffness, kappa, rtol=1e-9)


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
    assert_allclose(
        state.torsion_stiffness, 16 / 3 * radius**3 / sum(1 / g for g in shear), rtol=1e-12
    )
    assert_allclose(state.bending_stiffness, 0.01 * k * 19.05e-3**2, rtol=1e-12)
    packing = gp.Packing(PLAIN.material, 8e-3, lattice="fcc", torsion="mindlin")
    wanted = gp.AveragedLattice(packing).at_force(5.0)
    found = gp.Crystal.on("fcc", [PLAIN], torsion="mindlin").at_force(5.0)
    assert_allclose(found.torsion_stiffness, wanted.torsion_stiffness, rtol=1e-12)


def test_optic_modes_of_two_kinds():
    for name, factors in (("NaCl", (2, 4)), ("CsCl", (8 / 3, 16 / 3))):
        state = gp.Crystal.on(name, [S, A]).at_pressure(1e5)
        stiff = factors[0] * state.normal_stiffness[0] + factors[1] * state.shear_stiffness[0]
        wanted = math.sqrt(stiff * (1 / S.mass + 1 / A.mass)) / (2 * math.pi)
        found = gp.Phonons(state).frequencies([[0.0, 0.0, 0.0]])[0]
        assert np.count_nonzero(np.abs(found / wanted - 1) < 1e-12) == 3


def test_a_light_impurity_in_a_chain():
    """omega^2 = omega_max^2/(1 - e^2) for m' = (1 - e) m."""
    e = 0.6
    light = gp.Ball(PLAIN.material, 8e-3, mass=(1 - e) * PLAIN.mass)
    chain = gp.Crystal.on("chain", [PLAIN]).repeat((60,)).replace(30, light)
    assert chain.names == ("A", "B")
    state = chain.at_force(5.0)
    top = gp.Waves(state.network).modes(59).frequencies[-1] * 2 * math.pi
    assert_allclose(top**2, 4 * state.normal_stiffness[0] / PLAIN.mass / (1 - e**2), rtol=1e-12)


# -- twins -----------------------------------------------------------------------------------------


@settings(max_examples=15)
@given(
    st.lists(st.sampled_from([0, 1, 2]), min_size=6, max_size=6),
    st.floats(-0.12, 0.12),
    st.floats(-0.25, 0.25),
    st.floats(-6.0, 4.0),
    st.booleans(),
)
def test_balls_and_cell_are_in_balance_under_any_stress(kinds, shear, side, size, follows):
    three = [PLAIN, SOFT, gp.Ball(gp.Material(5e9, 0.45, 1200.0), 8e-3)]
    crystal = gp.Crystal.on("triangular", [PLAIN]).repeat((2, 3))
    for at, kind in enumerate(kinds):
        crystal = crystal.replace(at, three[kind])
    stress = -(10.0**size) * np.array([[1.0 + side, shear], [shear, 1.0 - side]])
    state = crystal.at_stress(stress, finite_overlap=follows)
    mean = float(np.mean(state.normal_force))
    pull, virial = pull_on_balls(state)
    assert np.max(np.linalg.norm(pull, axis=1)) <= 1e-12 * mean
    deformed = np.eye(2) + (state.strain if follows else 0.0)
    cauchy = -virial @ deformed.T / abs(np.linalg.det(crystal.cell @ deformed.T))
    assert_allclose(cauchy, stress, atol=1e-11 * abs(stress[0, 0]))
    assert_allclose(state.stress, cauchy, atol=1e-12 * abs(stress[0, 0]))
    assert np.all(state.normal_force >= 0.0)
    # overlaps are those that displacements and strain make
    table = crystal.contacts
    moved = (
        state.displacements[table.j] - state.displacements[table.i] + table.vector @ state.strain
    )
    overlap = -np.einsum("ca,ca->c", table.normal, moved)
    if follows:
        # |v + w| - |v| = (2 v.w + w.w)/(|v + w| + |v|)
        far = np.linalg.norm(table.vector + moved, axis=1) + np.linalg.norm(table.vector, axis=1)
        overlap = -np.einsum("ca,ca->c", 2 * table.vector + moved, moved) / far
    assert_allclose(overlap, state.overlap, atol=1e-11 * float(np.max(state.overlap)))


@pytest.mark.parametrize("depth", [pytest.param(1e-4, marks=pytest.mark.slow), 1e-2])
def test_exact_rest_is_the_minimum_of_the_exact_energy(depth):
    """In a strained cell, whose balls scipy moves; contacts are found anew from the places of the
    balls.
    """
    crystal = gp.Crystal.on("triangular", [PLAIN]).repeat((3, 2)).replace([0, 4], SOFT)
    strain = -depth * np.array([[1.0, 0.15], [0.15, 0.8]])
    state = crystal.at_strain(strain, finite_overlap=True)
    deformed = np.eye(2) + strain
    cell = crystal.cell @ deformed
    places = crystal.positions @ deformed
    steps = np.array(list(itertools.product((-1, 0, 1), repeat=2)))
    law = {(a, b): gp.Hertz().between(a, b) for a in (PLAIN, SOFT) for b in (PLAIN, SOFT)}
    size, mean = float(np.mean(state.overlap)), float(np.mean(state.normal_force))

    def find(moved):
        for i, j in itertools.product(range(6), repeat=2):
            for step in steps:
                if (i, *step) < (j, *(-step)):
                    vector = places[j] + moved[j] - places[i] - moved[i] + step @ cell
                    distance = float(np.linalg.norm(vector))
                    if distance < 8e-3:
                        yield (
                            i,
                            j,
                            tuple(step.tolist()),
                            vector / distance,
                            law[crystal.balls[i], crystal.balls[j]],
                            8e-3 - distance,
                        )

    def energy(x):
        moved, total, slope = x.reshape(6, 2) * size, 0.0, np.zeros((6, 2))
        for i, j, _, normal, pair, overlap in find(moved):
            total += pair.energy(overlap)
            slope[j] -= pair.force(overlap) * normal
            slope[i] += pair.force(overlap) * normal
        return total / (mean * size), slope.ravel() / mean

    found = minimize(energy, np.zeros(12), jac=True, method="BFGS", options={"gtol": 1e-9})
    forces = {
        (i, j, step): pair.force(overlap)
        for i, j, step, _, pair, overlap in find(found.x.reshape(6, 2) * size)
    }
    table = crystal.contacts
    mine = {}
    for i, j, step, force in zip(
        table.i.tolist(),
        table.j.tolist(),
        map(tuple, table.shift.tolist()),
        state.normal_force,
        strict=True,
    ):
        back = tuple(-one for one in step)
        mine[(i, j, step) if (i, *step) < (j, *back) else (j, i, back)] = force
    assert forces.keys() == {key for key, force in mine.items() if force > 0.0}
    assert_allclose([mine[key] for key in forces], list(forces.values()), atol=1e-6 * mean)
    assert state.network.prestress
    assert_allclose(state.network.distance, state.network.arm_i + state.network.arm_j, rtol=1e-12)


class Spring:
    """A user's law: a spring that holds two balls together, and pulls too."""

    def __init__(self, stiffness):
        self.k = stiffness

    def energy(self, overlap):
        return 0.5 * self.k * np.asarray(overlap) ** 2

    def force(self, overlap):
        return self.k * np.asarray(overlap)

    def stiffness(self, overlap):
        return np.full(np.shape(overlap), self.k)

    def stiffness_slope(self, overlap):
        return np.zeros(np.shape(overlap))

    def overlap(self, force):
        return np.asarray(force) / self.k


class Saturating:
    """A user's law whose force is at most F."""

    F = 10.0
    s = 1e-4

    def energy(self, overlap):
        h = np.maximum(overlap, 0.0)
        return self.F * (h + self.s * np.expm1(-h / self.s))

    def force(self, overlap):
        return -self.F * np.expm1(-np.maximum(overlap, 0.0) / self.s)

    def stiffness(self, overlap):
        return (
            self.F
            / self.s
            * np.exp(-np.maximum(overlap, 0.0) / self.s)
            * (np.asarray(overlap) > 0.0)
        )

    def stiffness_slope(self, overlap):
        return -self.stiffness(overlap) / self.s

    def overlap(self, force):
        return -self.s * np.log1p(-np.asarray(force) / self.F)


def test_a_law_with_a_largest_force_is_one_up_to_it():
    state = gp.Crystal.on("square", [PLAIN], law=Saturating()).at_force(9.99)
    assert_allclose(state.overlap, 1e-4 * math.log(1000.0), rtol=1e-12)


@pytest.mark.parametrize("finite", [False, True])
def test_bonds_bear_tension_and_are_stiff_without_a_load(finite):
    """A triangular lattice of springs: f = P d/3^(1/2), v_L^2 = 9/8 k d^2/m, v_T^2 = 3/8 k d^2/m,
    under any pressure.
    """
    crystal = gp.Crystal.on("triangular", [PLAIN], law=Spring(1e6), friction=False)
    assert not np.any(crystal.at_pressure(0.0, finite_overlap=finite).normal_force)
    for pressure in (-10.0, 10.0):
        force = crystal.at_pressure(pressure, finite_overlap=finite).normal_force
        assert_allclose(
            force, pressure * PLAIN.diameter / math.sqrt(3.0), rtol=1e-3 if finite else 1e-12
        )
    sheared = crystal.at_stress([-10.0, 10.0, 0.0], finite_overlap=finite)
    assert_allclose(sheared.stress, np.diag([-10.0, 10.0]), atol=1e-9)
    if not finite:
        unit = PLAIN.diameter * math.sqrt(1e6 / PLAIN.mass)
        for pressure in (-10.0, 0.0, 10.0):
            found = gp.sound_velocities(crystal.at_pressure(pressure)).velocities
            assert_allclose(found, np.sqrt([3.0 / 8.0, 9.0 / 8.0]) * unit, rtol=1e-12)


@pytest.mark.parametrize("force", [1e-12, 1e-9, 1e-3])
def test_contacts_that_adhere_have_small_means_of_either_sign_of_their_parts(force):
    """The mean is small against the attraction, so that it has fewer digits."""
    crystal = gp.Crystal.on("triangular", [PLAIN], law=gp.JKR(0.1))
    assert_allclose(crystal.at_force(force).normal_force, force, rtol=1e-13, atol=1e-15)
    assert_allclose(crystal.at_overlap(1e-10).overlap, 1e-10, rtol=1e-11)


@pytest.mark.parametrize(
    ("name", "edge", "own", "parts"),
    [
        (
            "fcc",
            math.sqrt(2.0),
            [(1, 1, 0), (1, 1, 2), (1, 1, 1)],
            [1.0 / 2.0, math.sqrt(0.5), math.sqrt(3.0) / 4.0],
        ),
        (
            "bcc",
            math.sqrt(4.0 / 3.0),
            [(1, 1, -1), (0, 0, 1), (1, 1, 1)],
            [1.0, math.sqrt(0.5), math.sqrt(3.0)],
        ),
    ],
)
def test_the_planes_of_the_cube_have_other_indices_in_a_primitive_cell(name, edge, own, parts):
    """Area of the cell of a layer, over that of a face of the cube; and indices that the docstring
    of cut makes.
    """
    crystal = gp.Crystal.on(name, [PLAIN])
    face = (edge * PLAIN.diameter) ** 2
    for plane, indices, part in zip([(0, 0, 1), (1, 1, 0), (1, 1, 1)], own, parts, strict=True):
        made = crystal.cell @ plane
        assert_allclose(np.cross(made, indices), 0.0, atol=1e-9 * np.max(np.abs(made)))
        assert_allclose(crystal.cut(indices, 3).measure / face, part, rtol=1e-12)


def test_a_crystal_all_of_whose_balls_are_held_is_pressed_by_its_wall():
    """One contact in line between two clamped layers carries the force on the wall."""
    slab = gp.Crystal.on("square", [PLAIN]).cut(1, 2, "clamped")
    force = slab.at_pressure(1e3).normal_force
    assert_allclose(np.max(force), 1e3 * PLAIN.diameter, rtol=1e-12)


def test_one_layer_that_is_clamped_is_pressed_along_its_period():
    """No ball moves by itself: the period alone takes the load, P times the height of the layer."""
    layer = gp.Crystal.on("triangular", [PLAIN]).cut(1, 1, ("clamped", "free"))
    height = 0.5 * math.sqrt(3.0) * PLAIN.diameter
    assert_allclose(layer.at_pressure(1e3).normal_force, [1e3 * height], rtol=1e-12)
    assert_allclose(layer.at_force(2.0).stress, [[-2.0]], rtol=1e-12)


@pytest.mark.parametrize("number", [-1, 0.5])
def test_a_law_is_that_of_two_numbered_bodies(number):
    with pytest.raises(InputError, match="j: found"):
        gp.Crystal.on("triangular", [PLAIN]).law_of(0, number)


def test_four_indices_of_a_hexagonal_cell():
    crystal = gp.Crystal.on("hcp", [PLAIN])
    for four, three in (
        ((0, 0, 0, 1), (0, 0, 1)),
        ((1, 0, -1, 0), (1, 0, 0)),
        ((1, 1, -2, 2), (1, 1, 2)),
    ):
        assert_allclose(crystal.cut(four, 3).positions, crystal.cut(three, 3).positions)


@pytest.mark.parametrize("law", [gp.Hertz(), gp.JKR(0.1)])
def test_a_mean_that_is_little_more_than_the_weight_makes_is_found(law):
    """With gravity the mean is no power of the pressure, and contacts that adhere may be pulled."""
    layers = gp.Crystal.on("triangular", [PLAIN], law=law).cut(1, 3, ("floor", "free"))
    weight = layers.at_pressure(0.0, gravity=(0.0, -9.81))
    mean = np.mean(weight.normal_force[weight.normal_stiffness > 0.0])
    for factor in (1.0001, 1.2):
        state = layers.at_force(factor * mean, gravity=(0.0, -9.81))
        closed_forces = state.normal_force[state.normal_stiffness > 0.0]
        assert_allclose(np.mean(closed_forces), factor * mean, rtol=1e-10)


@pytest.mark.parametrize("law", [gp.DMT(0.1), gp.JKR(0.1)])
def test_contacts_that_adhere_have_a_small_mean_overlap_under_tension(law):
    """All contacts of the chain bear one force below zero; their overlaps differ by their kinds."""
    state = gp.Crystal.on("chain", [PLAIN, PLAIN, SOFT], law=law).at_overlap(1e-9)
    assert_allclose(np.mean(state.overlap), 1e-9, rtol=1e-9)
    assert np.ptp(state.overlap) > 1e-11
    assert_allclose(state.normal_force, -state.stress[0, 0], rtol=1e-9)
    assert state.stress[0, 0] > 0.0


@pytest.mark.parametrize("law", [gp.DMT(0.05), gp.JKR(0.05), Spring(1e6)])
def test_means_of_contacts_that_pull_count_those_that_touch(law):
    """Beside a vacancy some contacts carry next to nothing, of either sign by rounding."""
    crystal = gp.Crystal.on("NaCl", [PLAIN, PLAIN], law=law).repeat((2, 2, 2)).remove(0)
    state = crystal.at_force(1e-6)
    assert_allclose(np.mean(state.normal_force[state.normal_stiffness > 0.0]), 1e-6, rtol=1e-9)


@pytest.mark.parametrize(
    ("name", "ratio"), [("NaCl", math.sqrt(2.0) - 1.0), ("CsCl", math.sqrt(3.0) - 1.0)]
)
def test_the_smallest_ball_of_a_structure_touches_like_balls_too(name, ratio):
    """The ratios of radii of Pauling's rules."""
    crystal = gp.Crystal.on(name, [PLAIN, gp.Ball(STEEL, ratio * PLAIN.diameter)])
    assert crystal.n_contacts > {"NaCl": 6, "CsCl": 8}[name]
    with pytest.raises(InputError, match=f"{ratio:.4g} or more"):
        gp.Crystal.on(name, [gp.Ball(STEEL, 0.99 * ratio * PLAIN.diameter), PLAIN])


@pytest.mark.parametrize(
    "law", [(1,), (1, 2), ((["A"], gp.Hertz()),), (({}, 1),), {("A",): gp.Hertz()}]
)
def test_what_is_no_law_is_one_error(law):
    with pytest.raises(InputError, match="law"):
        gp.Crystal([PLAIN], [[8e-3]], [[0.0]], law=law)


@pytest.mark.parametrize("balls", [PLAIN, [PLAIN], {"A": 1}, None])
def test_other_balls_are_given_by_their_names(balls):
    with pytest.raises(InputError, match="balls"):
        gp.Crystal.on("chain", [PLAIN]).with_balls(balls)


def test_balls_in_a_wrong_unit_are_doubted():
    state = gp.Crystal.on("fcc", [gp.Ball(STEEL, 8.0)]).at_force(10.0)
    assert not state.valid
    assert "diameter is 8 m" in state.warnings[0]


def test_a_resonator_on_each_ball_opens_a_gap():
    """Along its spring, the gap at q = 0 reaches from k_r/m_r to k_r (1/m + 1/m_r); here its upper
    end.
    """
    small = gp.Ball(STEEL, 4e-3, name="resonator")
    ball = gp.Ball(PLAIN.material, 8e-3, name="ball")
    laws = {("ball", "ball"): gp.Hertz(), ("ball", "resonator"): Spring(1e5)}
    chain = gp.Crystal(
        [ball, small], [[8e-3, 0.0]], [[0.0, 0.0], [0.0, 6e-3]], law=laws, friction=False
    )
    state = chain.at_stress(-10.0)
    assert_allclose(np.sort(state.normal_force), [0.0, 10.0], atol=1e-12)
    assert state.network.n_contacts == 2
    wanted = math.sqrt(1e5 * (1 / ball.mass + 1 / small.mass)) / (2 * math.pi)
    found = gp.Phonons(state).frequencies([[0.0]])[0]
    assert_allclose(found[-1], wanted, rtol=1e-12)


def test_exact_statics_tend_to_those_of_small_overlap():
    crystal = gp.Crystal.on("fcc", [PLAIN]).repeat((2, 1, 2)).replace(1, SOFT)
    stress = np.diag([-1.0, -1.1, -1.2])
    off = []
    for size in (1e3, 1e6):
        small = crystal.at_stress(size * stress)
        exact = crystal.at_stress(size * stress, finite_overlap=True)
        off.append(np.max(np.abs(exact.normal_force / small.normal_force - 1)))
        strain = float(np.max(np.abs(small.strain)))
        assert 0.01 * strain < off[-1] < 100 * strain
    assert off[1] / off[0] == pytest.approx(100.0, rel=0.1)  # overlaps go with the power 2/3


# -- edges, gravity --------------------------------------------------------------------------------


def test_a_search_that_steps_over_its_goal_is_not_stuck():
    goal = MeanGoal("force", 1.0)
    search = PressureSearch(goal, balls_differ=False, contacts_adhere=False, has_gravity=True)
    search.choose(1.0, 0.9, 2.0)
    assert not search.is_stuck(1.1, 1e-9)
    search.choose(2.0, 1.1, 1.5)
    assert search.is_stuck(1.1, 1e-9)
    assert search.last_error == pytest.approx(0.1)


@pytest.mark.parametrize("follows", [False, True])
def test_a_column_carries_its_weight(follows):
    column = gp.Crystal.on("chain", [S, A]).cut(0, 4, ("floor", "free"))
    masses = np.array([ball.mass for ball in column.balls])
    state = column.at_pressure([0.0, 5.0], gravity=(-G,), finite_overlap=follows)
    above = np.array([masses[at:].sum() for at in (*range(1, 8), 0)]) * G
    order = np.append(np.maximum(column.contacts.i, column.contacts.j) - 1, 7)
    assert_allclose(state.normal_force, np.add.outer([0.0, 5.0], above[order]), rtol=1e-12)
    floor = gp.Hertz().between(S, gp.balls.ball.RIGID_PLANE)
    assert_allclose(state.overlap[:, -1], floor.overlap(state.normal_force[:, -1]), rtol=1e-12)
    network = state[0].network
    assert (network.n_balls, network.pbc, network.dimension) == (9, (False, False, False), 1)
    assert np.isinf(network.masses[8])
    assert np.isinf(network.radii[8])
    mean = column.at_force(3.0, gravity=-G)
    assert_allclose(mean.normal_force.mean(), 3.0, rtol=1e-12)
    with pytest.raises(InputError, match="force of 1e-06"):
        column.at_force(1e-6, gravity=-G)


def test_gravity_may_be_an_array_that_is_broadcast_with_the_loads():
    column = gp.Crystal.on("chain", [PLAIN]).cut(0, 20, ("floor", "free"))
    weight = 20 * PLAIN.mass * np.array([G, 1.62])
    assert_allclose(
        column.at_pressure(0.0, gravity=[-G, -1.62]).normal_force[:, -1], weight, rtol=1e-12
    )
    both = column.at_pressure([[1.0], [2.0]], gravity=[-G, -1.62])
    assert_allclose(both.normal_force[..., -1], np.add.outer([1.0, 2.0], weight), rtol=1e-12)
    assert_allclose(
        column.at_force([3.0, 4.0], gravity=-G).normal_force.mean(axis=1), [3.0, 4.0], rtol=1e-12
    )
    wall = gp.Crystal.on("triangular", [PLAIN]).cut(1, 5, ("floor", "free"))
    fields = np.array([[0.0, -G], [0.0, -1.62]])
    stressed = wall.at_stress([-1.0], gravity=fields)
    strained = wall.at_strain([[-1e-5], [-2e-5]], gravity=fields)
    for number, field in enumerate(fields):
        assert_allclose(
            stressed[number].normal_force,
            wall.at_stress([-1.0], gravity=field).normal_force,
            rtol=1e-12,
        )
        one = wall.at_strain([(-1e-5, -2e-5)[number]], gravity=field)
        assert_allclose(strained[number].normal_force, one.normal_force, rtol=1e-12)
    for make, told in (
        (
            lambda: wall.at_pressure([1.0, 2.0, 3.0], gravity=fields),
            r"shape \(2, 2\), and the loads \(3,\)",
        ),
        (
            lambda: wall.at_pressure([0.0, 1.0], gravity=[[0.0, 0.0], [0.0, -1.0]]),
            "pressure is zero",
        ),
        (lambda: wall.at_pressure(0.0, gravity=[[0.0, -G], [1.0, 0.0]]), "acts along x.*repeats"),
    ):
        with pytest.raises(InputError, match=told):
            make()


def test_modes_of_a_column_are_those_of_a_bessel_function():
    """The lowest modes of N balls are (5/6) j_n N^(-5/6) (3 g/2 delta_1)^(1/2), with the overlap
    delta_1 under one weight.

    The stiffness under depth z goes as z^(1/3): the modes of long waves are u = s^(2/5)
    J_(-2/5)(s), s = j_n (z/N)^(5/6), with the zeros j_n of J_(-2/5). By the Euler-Maclaurin formula
    in Rayleigh's quotient they are off by A/N^2 with

        A = 5/216 - <u'^2>/24 = 5/216 - (25/432) j^(2/5) int_0^j s^(3/5) J_(3/5)(s)^2 ds /
        J_(3/5)(j)^2,

    as a rigid floor is a mirror, whose contact is twice as stiff. The free end, where k goes as the
    root, adds N^(-8/3).
    """
    zeros = np.array(
        [brentq(lambda x: jv(-0.4, x), at - 0.3, at + 0.3, xtol=1e-15) for at in (1.75, 4.88, 8.02)]
    )
    integral = np.array([quad(lambda x: x**0.6 * jv(0.6, x) ** 2, 0.0, zero)[0] for zero in zeros])
    wanted = 5 / 216 - 25 / 432 * zeros**0.4 * integral / jv(0.6, zeros) ** 2
    law = gp.Hertz().between(PLAIN, PLAIN)
    unit = math.sqrt(G / law.overlap(PLAIN.mass * G))
    counts = np.array([80, 160, 320, 640, 1280])[:, None]
    off = []
    for n in counts[:, 0]:
        state = (
            gp.Crystal.on("chain", [PLAIN])
            .cut(0, n, ("floor", "free"))
            .at_pressure(0.0, gravity=(-G,))
        )
        found = gp.Waves(state.network).modes(3).frequencies * 2 * math.pi
        off.append(found / (5 / 6 * math.sqrt(1.5) * zeros * float(n) ** (-5 / 6) * unit) - 1)
    scaled = np.array(off) * counts**2
    order = np.log2(np.abs(off[:-1]) / np.abs(off[1:]))
    assert_allclose(order, 2.0, atol=0.02)
    assert_allclose(order[-1], 2.0, atol=0.004)
    # what is left of A falls as N^(-2/3)
    left = scaled / wanted - 1.0
    assert_allclose(left[:-1] / left[1:], np.full((4, 3), 2 ** (2 / 3)), rtol=0.05)
    assert_allclose(
        (2 ** (2 / 3) * scaled[1:] - scaled[:-1])[-1] / (2 ** (2 / 3) - 1), wanted, rtol=1e-5
    )


def test_a_layer_on_a_floor_and_faces_that_are_pressed():
    plane = gp.Crystal.on("triangular", [PLAIN])
    weight = PLAIN.mass * G
    d = 8e-3
    layer = plane.cut(1, 5, ("floor", "free"))
    assert (layer.periods, layer.n_balls, layer.n_contacts) == (1, 5, 5 + 8 + 1)
    state = layer.at_pressure(0.0, gravity=(0.0, -G))
    assert_allclose(state.normal_force[-1], 5 * weight, rtol=1e-12)
    assert np.max(np.abs(pull_on_balls(state)[0][1:] - [0.0, weight])) < 1e-12 * weight
    # between walls, contacts along the layer carry nothing
    along = np.abs(layer.contacts.normal[:, 0]) > 0.9
    assert np.all(state.normal_force[: len(along)][along] == 0.0)
    assert state.network.n_contacts == 9
    pressed = layer.at_pressure(100.0, gravity=(0.0, -G))
    assert_allclose(pressed.normal_force[-1], 5 * weight + 100.0 * d, rtol=1e-12)
    # without gravity the periods are pressed too: contacts across layers carry P d/sqrt 3, as in
    # the bulk
    for edges in ("free", "floor", "clamped", ("floor", "free"), ("clamped", "floor")):
        strip = plane.cut(1, 5, edges).at_pressure(100.0)
        table = strip.crystal.contacts
        across = np.abs(table.normal[:, 1]) > 0.1
        assert_allclose(strip.normal_force[: len(table)][across], 100.0 * d / 3**0.5, rtol=1e-12)
        floors = strip.normal_force[len(table) :]
        assert_allclose(floors, 100.0 * d, rtol=1e-12)
        assert_allclose(strip.stress[0, 0], -100.0 * 5 * d * 0.75**0.5, rtol=1e-12)


@pytest.mark.parametrize("axis", [0, 1, (1, 0), (1, 1), (1, -1), (2, 1)])
def test_a_cut_keeps_the_balls_and_the_contacts_of_its_layers(axis):
    plane = gp.Crystal.on("kagome", [PLAIN, SOFT, PLAIN])
    strip = plane.cut(axis, 6)
    assert strip.n_balls == 18
    # the area of the bulk's layers, the turn is rigid, and it lies along x
    (face,) = strip.faces
    assert_allclose(strip.measure * face.thickness, 6 * plane.measure, rtol=1e-12)
    assert_allclose(np.linalg.norm(strip.contacts.vector, axis=1), 8e-3, rtol=1e-12)
    assert_allclose(strip.cell[0, 1:], 0.0, atol=1e-15)
    # every contact that is found anew is in the table
    again = gp.Crystal(strip.balls, strip.cell, strip.positions)
    assert list_contacts(again) == list_contacts(strip)
    assert 6 * plane.n_contacts - strip.n_contacts > 0


@pytest.mark.parametrize("indices", [(1, 1, 1), (0, 0, 1), (1, -1, 0), (2, 1, -1)])
def test_a_slab_of_fcc_across_any_plane(indices):
    crystal = gp.Crystal.on("fcc", [PLAIN])
    slab = crystal.cut(indices, 5, ("floor", "free"))
    assert_allclose(slab.measure * slab.faces[0].thickness, 5 * crystal.measure, rtol=1e-12)
    again = gp.Crystal(slab.balls, slab.cell, slab.positions)
    assert list_contacts(again) == list_contacts(slab)
    state = slab.at_pressure(1e4, gravity=(0.0, 0.0, -G))
    count = len(slab.contacts)
    weight = 5 * PLAIN.mass * G + 1e4 * slab.measure
    assert_allclose(state.normal_force[count:].sum(), weight, rtol=1e-11)


def test_a_vacancy_and_a_defect():
    crystal = gp.Crystal.on("triangular", [PLAIN]).repeat((4, 4))
    hole = crystal.remove(5)
    assert hole.n_balls == 15
    assert hole.n_contacts == 48 - 6
    state = hole.at_pressure(1e3)
    mean = state.normal_force.mean()
    assert np.max(np.abs(pull_on_balls(state)[0])) < 1e-12 * mean
    assert np.ptp(state.normal_force) > 0.1 * mean
    assert crystal.remove([0, 3]).n_balls == 14
    again = gp.Crystal(hole.balls, hole.cell, hole.positions)
    assert list_contacts(again) == list_contacts(hole)


# -- extremes, errors ------------------------------------------------------------------------------


@pytest.mark.parametrize("overlap", [1e-14, 1e-9, 1e-2])
@pytest.mark.parametrize("ratio", [1e-6, 1.0, 1e6])
def test_extremes_of_overlap_mass_and_stiffness(overlap, ratio):
    other = gp.Ball(gp.Material(211.65e9 * ratio, 0.276, 7840.0), 8e-3, mass=PLAIN.mass * ratio)
    for name in ("chain", "CsCl"):
        crystal = gp.Crystal.on(name, [PLAIN, other])
        state = crystal.at_overlap(overlap * 8e-3)
        law = gp.Hertz().between(PLAIN, other)
        assert_allclose(state.overlap, overlap * 8e-3, rtol=1e-13)
        assert_allclose(state.normal_force, law.force(overlap * 8e-3), rtol=1e-12)
        assert state.valid or overlap == 1e-2  # the limit itself, but for rounding
        deep = crystal.at_overlap(2e-2 * 8e-3)
        assert not deep.valid
        assert "contact is 14.14 %" in deep.warnings[0]
    mixed = (
        gp.Crystal.on("triangular", [PLAIN])
        .repeat((2, 2))
        .replace(0, other)
        .at_overlap(overlap * 8e-3)
    )
    assert_allclose(mixed.overlap[mixed.normal_force > 0].mean(), overlap * 8e-3, rtol=1e-12)
    assert np.max(np.abs(pull_on_balls(mixed)[0])) < 1e-12 * mixed.normal_force.mean()


def test_loads_may_be_arrays_and_a_state_is_indexed_like_one():
    crystal = gp.Crystal.on("fcc", [PLAIN])
    state = crystal.at_pressure([[1e3, 1e4, 1e5]])
    assert state.shape == (1, 3)
    assert state.normal_force.shape == (1, 3, 6)
    assert state.stress.shape == state.strain.shape == (1, 3, 3, 3)
    assert state.valid.shape == (1, 3)
    one = state[0, 1]
    assert one.is_single
    assert one.valid is True
    assert_allclose(one.normal_force, crystal.at_pressure(1e4).normal_force, rtol=1e-13)
    assert state[0].shape == (3,)
    assert not one.normal_force.flags.writeable
    with pytest.raises(InputError, match="the state holds 3 loads"):
        _ = state.network
    many = crystal.at_stress([[-1e4, -1e4, -1.1e4, 0, 0, 0], [-1e3, -1e3, -1e3, 0, 0, 1e2]])
    assert many.normal_force.shape == (2, 6)


def test_doubts_are_said():
    weak = gp.Ball(gp.Material(211.65e9, 0.276, 7840.0, yield_strength=300e6), 8e-3)
    state = gp.Crystal.on("fcc", [weak]).at_force([0.01, 100.0])
    assert state.valid.tolist() == [True, False]
    assert "At 1 of 2 loads" in state.warnings[0]
    table = gp.TabulatedLaw([1e-8, 1e-7], [1e-4, 1e-2])
    assert "beyond its table" in gp.Crystal.on("fcc", [PLAIN], law=table).at_force(1.0).warnings[0]


@pytest.mark.parametrize(
    "law",
    [
        None,
        {
            tuple(pair.split()): gp.PowerLaw(1.5, 1e9 * len(pair))
            for pair in ("A A", "B A", "B B", "A floor", "floor B")
        },
    ],
)
def test_a_state_is_plain_data_and_back(law):
    other = gp.Ball(PLAIN.material, 8e-3, mass=1e-2, spread=gp.Uniform(1e-6))
    sample = gp.Crystal.on("hcp", [PLAIN, other], law=law).sample((2, 2, 2))
    slab = sample.cut(0, 2, ("floor", "free")).remove(3)
    for state, unit in (
        (slab.at_pressure(1e5), "N/m"),
        (sample.at_pressure([1e5, 2e5], finite_overlap=True), "Pa"),
    ):
        back = type(state).from_dict(json.loads(json.dumps(state.to_dict())))
        assert back == state
        assert pickle.loads(pickle.dumps(state)) == state
        assert back.to_dict()["units"]["stress"] == unit
        assert_allclose(
            *(one.at_pressure(1e5).normal_force for one in (back.crystal, state.crystal)),
            rtol=1e-12,
        )
    with pytest.raises(InputError, match="Saturating"):
        gp.CrystalState.from_dict(
            gp.Crystal.on("square", [PLAIN], law=Saturating()).at_force(1e-3).to_dict()
        )


STRIP = gp.Crystal.on("triangular", [PLAIN], on_site=1.0).cut(1, 2, ("floor", "free"))


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"kind": [1, 1]}, "a ball has no kind"),
        ({"names": []}, "not as many names as kinds"),
        ({"faces": {"balls": [[9], [1]]}}, "names a ball that is not there"),
        ({"faces": {"axis": 2}}, "across an axis that is not there"),
        ({"faces": {"edges": ["glued", "free"]}}, "held as no face is"),
        ({"on_site": [[1.0], [1.0]]}, "not those of the motions"),
        ({"deviations": [-1.0, 0.0]}, "a ball has no diameter"),
    ],
)
@pytest.mark.filterwarnings("ignore::granphon.base.errors.UnverifiedFileWarning")
def test_data_that_make_no_crystal_are_told_in_words(changes, message):
    data = STRIP.to_dict()
    del data["digest"]
    faces = [face | changes.get("faces", {}) for face in data["faces"]]
    with pytest.raises(InputError, match=message):
        gp.Crystal.from_dict(data | changes | {"faces": faces})


@pytest.mark.parametrize(
    ("name", "array"),
    [
        ("displacements", [[0.0, 0.0]]),
        ("strain", [[0.0, 0.0], [0.0, 0.0]]),
        ("ways", [0.0]),
    ],
)
@pytest.mark.filterwarnings("ignore::granphon.base.errors.UnverifiedFileWarning")
def test_a_state_of_another_crystal_is_refused(name, array):
    data = STRIP.touch().to_dict()
    del data["digest"]
    if name == "strain":
        data["stress"] = array
    with pytest.raises(InputError, match=f"{name} of the CrystalState has the shape"):
        gp.CrystalState.from_dict(data | {name: array})


@pytest.mark.parametrize(
    ("attributes", "message"),
    [
        ({"kinds": {"A": PLAIN}}, "Give pairs of a name and a granphon.Ball"),
        ({"kinds": (("A", 8e-3),)}, "the kinds are"),
        ({"kinds": (("A", PLAIN), ("A", PLAIN))}, "Give each another name"),
        ({"kinds": (("A", PLAIN),), "given": PLAIN}, "given is Ball"),
    ],
)
def test_arrangements_that_are_none_are_refused(attributes, message):
    with pytest.raises(InputError, match=message):
        gp.Arrangement(lattice="triangular", **attributes)


@pytest.mark.parametrize("find", [lambda x: x.mindlin_ratios, lambda x: x.faces[0].balls[1]])
def test_a_crystal_hands_out_no_array_that_can_be_changed(find):
    with pytest.raises(ValueError, match="read-only"):
        find(STRIP)[0] = 0


SQUARE = gp.Crystal.on("square", [PLAIN])
ERRORS = {
    "text of bytes": (lambda: gp.Crystal(b"x", [[8e-3]], [[0.0]]), "the balls are b.x"),
    "ball": (lambda: gp.Crystal(["x"], [[8e-3]], [[0.0]]), "'x' is not a ball"),
    "count": (lambda: gp.Crystal([S, A], [[8e-3]], [[0.0]]), "there are 2 balls and 1 position"),
    "cell": (lambda: gp.Crystal([S], [[8e-3, 0.0]], [[0.0]]), "the cell has the shape"),
    "turned": (lambda: gp.Crystal([PLAIN], [[0.0, 8e-3]], [[0.0, 0.0]]), "does not lie along x"),
    "flat": (lambda: gp.Crystal([PLAIN], np.zeros((2, 2)), [[0.0, 0.0]]), "has no room for a ball"),
    "nan": (lambda: gp.Crystal([PLAIN], [[math.nan]], [[0.0]]), "is not finite"),
    "apart": (
        lambda: gp.Crystal([S, A], [[0.04]], [[0.0], [0.0195]]),
        "ball 0 of crystal .* touches no other",
    ),
    "rounded": (
        lambda: gp.Crystal([S, A], [[0.03811]], [[0.0], [0.01905]]),
        "nearly touch.* Multiply|with eight digits",
    ),
    "overlapping": (
        lambda: gp.Crystal([S, A], [[0.0381]], [[0.0], [0.015]]),
        "overlap. Balls 0 and 1 are 0.015 m",
    ),
    "scaled": (
        lambda: gp.Crystal([PLAIN], 8.001e-3 * np.eye(2), [[0, 0]]),
        "Multiply .* by 0",
    ),
    "pieces": (
        lambda: gp.Crystal([PLAIN] * 2, [[8e-3, 0], [0, 0.05]], [[0.0, 0.0], [0.0, 0.02]]),
        "falls into pieces",
    ),
    "lattice": (
        lambda: gp.Crystal.on("cubic", [S]),
        "unknown lattice 'cubic'. Use chain, .*zincblende",
    ),
    "kinds": (lambda: gp.Crystal.on("fcc", [S, A]), "2 kinds .* 1 site"),
    "sizes": (lambda: gp.Crystal.on("hcp", [S, PLAIN]), "cannot all touch .* hcp"),
    "cage": (
        lambda: gp.Crystal.on("NaCl", [S, gp.Ball(STEEL, 3e-3)]),
        "ball B of 0.003 m is too small .* of 0.00789077 m",
    ),
    "names": (
        lambda: gp.Crystal.on(
            "chain", [gp.Ball(STEEL, 1e-3, name="A"), gp.Ball(STEEL, 2e-3, name="A")]
        ),
        "two kinds are called 'A'",
    ),
    "law": (lambda: gp.Crystal.on("chain", [S], law=3.0), "contact law 3.0 has no method force"),
    "law of pairs": (
        lambda: gp.Crystal.on("chain", [S], law=SimpleNamespace(between=lambda ball, other: None)),
        "^None, which between of .* has no method force",
    ),
    "motions": (
        lambda: gp.Crystal.on("chain", [S], motions="up"),
        "no motions 'up'.* line",
    ),
    "tension": (lambda: SQUARE.at_pressure(-1.0), "tensile"),
    "zero": (lambda: SQUARE.at_pressure(0.0), "pressure is zero"),
    "no force": (lambda: SQUARE.at_force(0.0), "force is zero"),
    "open": (lambda: SQUARE.at_strain([1e-4, 1e-4, 0.0]), "contacts are open .*strain"),
    "deep": (
        lambda: SQUARE.at_pressure(1e12),
        "balls together by .* diameters.*overlap",
    ),
    "pulled": (lambda: SQUARE.at_stress([1e3, 0.0, 0.0]), "cannot bear the stress"),
    "sheared": (
        lambda: SQUARE.at_stress([-1e3, -1e3, 1.0]),
        "cannot bear .* stress .* sides",
    ),
    "skew of the smaller": (
        lambda: SQUARE.at_stress([-1e9 * np.eye(2), [[-1e-4, 5e-5], [0.0, -1e-4]]]),
        "stress is not symmetric",
    ),
    "skew": (lambda: SQUARE.at_stress([[-1.0, 0.5], [0.0, -1.0]]), "stress is not symmetric"),
    "shape": (lambda: SQUARE.at_stress([-1.0, -1.0]), "stress has the shape"),
    "falls": (
        lambda: SQUARE.at_pressure(1.0, gravity=(0.0, -G)),
        "gravity .* along y, .*'square' repeats",
    ),
    "no floor": (lambda: SQUARE.cut(1, 3).at_pressure(1.0, gravity=(0.0, -G)), "stands on nothing"),
    "slides": (
        lambda: SQUARE.cut(1, 3, "floor").at_pressure(1.0, gravity=(1.0, -G)),
        "gravity acts along x",
    ),
    "lifted": (
        lambda: SQUARE.cut(1, 3, ("floor", "free")).at_pressure(0.0, gravity=(0.0, G)),
        r"pressure of 0 N/m .* along y, .*floor .*weight, 7.732 N/m",
    ),
    "not lifted": (  # by its weight: nothing holds the balls of an oblique cut from the sides
        lambda: SQUARE.cut((-2, -1), 3, ("free", "floor")).at_pressure(1e6, gravity=(0.0, -G)),
        "cannot bear .* only push",
    ),
    "lifted down": (
        lambda: SQUARE.cut(1, 3, ("free", "clamped")).at_pressure(1.0, gravity=(0.0, -G)),
        "along -y, .*clamp ",
    ),
    "lifted off nothing": (  # the free faces of a column that a clamp holds below
        lambda: SQUARE.cut(1, 3, ("clamped", "free")).cut(0, 3).at_pressure(0.0, gravity=(-G, 0.0)),
        "cannot bear .* only push",
    ),
    "pulled as hard": (
        lambda: gp.Crystal.on("chain", [PLAIN]).at_stress([5.0]),
        "pressure above 5 N .*sides",
    ),
    "no load": (
        lambda: gp.Phonons(SQUARE),
        r"has no load\. .* crystal.at_force\(...\), in N",
    ),
    "no load of velocities": (lambda: gp.sound_velocities(SQUARE), "has no load"),
    "no load of an exponent": (lambda: gp.local_exponent(SQUARE), "has no load"),
    "exponent of open contacts": (  # springs alone hold the balls, which fall alike
        lambda: (
            gp.Crystal.on("square", [S], on_site=1e3).at_pressure(0.0, gravity=(0.0, -G)).exponent
        ),
        "no contact .* closed",
    ),
    "no load of a picture": (lambda: gp.plot(SQUARE), "has no load"),
    "millimetres": (
        lambda: gp.Crystal([gp.Ball(STEEL, 1e-2)], [[10.0]], [[0.0]]),
        "is 10 m away.* they look like mm",
    ),
    "micrometres": (
        lambda: gp.Crystal([gp.Ball(STEEL, 1e-5)] * 2, 20.0 * np.eye(2), [[0, 0], [10.0, 0]]),
        "is 10 m .*look like um",
    ),
    "kilometres": (
        lambda: gp.Crystal([gp.Ball(STEEL, 8.0)] * 2, [], [[0.0], [8e-3]]),
        "Compare the units: diameters, cell",
    ),
    "no balls": (
        lambda: gp.Crystal(None, [[8e-3]], [[0.0]]),
        "balls are None.* granphon.Ball",
    ),
    "set": (lambda: gp.Crystal.on("chain", {S, A}), "list of granphon.Ball"),
    "called": (lambda: gp.Crystal.on("chain", [S], name=5), "name: found 5; allowed: a name"),
    "twice": (
        lambda: gp.Crystal([S, S], [[0.0381]], [[0.0], [0.0381]]),
        "0 m apart, .* once",
    ),
    "balls of atoms": (lambda: gp.Crystal.from_atoms(Atoms("Na"), S), "Give balls by symbols"),
    "ball of atoms": (lambda: gp.Crystal.from_atoms(Atoms("Na"), {"Na": 5}), "5 is not a ball"),
    "no atoms": (lambda: gp.Crystal.from_atoms(Atoms(), {"Na": S}), "there are no atoms"),
    "no contact": (lambda: SQUARE.repeat((3, 3)).remove(range(8)), "no balls of crystal .* touch"),
    "walls": (lambda: SQUARE.cut(0, 3).with_walls({"wall": S}), "the walls are"),
    "no load chosen": (lambda: SQUARE.at_force([1.0, 2.0])[[]], "selects none of the loads"),
    "cluster": (
        lambda: gp.Crystal([S, S], [], [[0.0], [19.05e-3]]).at_pressure(1.0),
        "neither periods nor faces",
    ),
    "inside out": (
        lambda: SQUARE.at_strain(-1.5 * np.eye(2), finite_overlap=True),
        "shortens .*'square' by 1.5",
    ),
    "moves aside": (
        lambda: (
            gp.Crystal.on("diamond", [PLAIN], law=gp.PowerLaw(1.0, 1e6))
            .repeat((2, 2, 2))
            .remove(0)
            .at_strain(-1e-5 * np.array([1.0, 1.6, 0.2, -0.2, 0.0, 0.5]))
        ),
        "contacts are open .*strain",
    ),
    "no face": (
        lambda: gp.Crystal.on("square", [PLAIN]).repeat((2, 1)).cut(1, 3, "floor").remove([0, 1]),
        "no ball is left",
    ),
    "no ball beside it": (
        lambda: gp.Crystal.on("kagome", [PLAIN]).cut((2, 1), 1),
        "ball 1 .* touches no other. Give more layers",
    ),
    "no ball left beside it": (
        lambda: gp.Crystal.on("chain", [PLAIN]).cut(0, 4).remove(1),
        "ball 0 .* touches no other. Remove it too",
    ),
    "mean of nothing": (  # springs alone hold the balls, which fall alike
        lambda: gp.Crystal.on("square", [S], on_site=1e3).at_force(1.0, gravity=(0.0, -G)),
        "contacts are open .*faces of a cut alone. Cut the crystal, or leave gravity out",
    ),
    "held alone": (lambda: SQUARE.cut(0, 1, "clamped").repeat((3,)).remove([0, 1]), "touch"),
    "four indices": (
        lambda: gp.Crystal.on("fcc", [PLAIN]).cut((1, 0, -1, 0), 3),
        "belong to a hexagonal cell.* Give three",
    ),
    "wrong third": (
        lambda: gp.Crystal.on("hcp", [PLAIN]).cut((1, 0, 1, 0), 3),
        "minus the sum",
    ),
    "largest force": (
        lambda: gp.Crystal.on("square", [PLAIN], law=Saturating()).at_force(20.0),
        "law does not reach .* about 20 N",
    ),
    "moduli apart": (
        lambda: gp.Crystal.on(
            "chain", [PLAIN, PLAIN, gp.Ball(gp.Material(2e-9, 0.3, 8000.0), 8e-3)]
        ).at_pressure(1e-6),
        "stiffnesses .* up to 1e.10",
    ),
    "weights apart": (
        lambda: (
            gp.Crystal.on("fcc", [PLAIN])
            .repeat((3, 3, 1))
            .cut((1, 1, 1), 4, ("floor", "free"))
            .at_pressure(3e4, gravity=(0.0, 0.0, -1e-9))
        ),
        "forces of the load .* up to 1e.06",
    ),
    "vector": (
        lambda: SQUARE.cut(1, 3, "floor").at_pressure(1.0, gravity=-G),
        "gravity has the shape",
    ),
    "axis": (
        lambda: SQUARE.cut(2, 3),
        "axis is 2.* 0 to 1",
    ),
    "edges": (
        lambda: SQUARE.cut(0, 3, "glued"),
        "edges: found 'glued'; .* free, clamped, floor",
    ),
    "index": (lambda: SQUARE.replace(1, S), "indices of balls, 0 to 0, each once"),
    "size": (lambda: SQUARE.replace(0, S), "neighbours would overlap"),
    "last": (lambda: SQUARE.remove(0), "no ball is left"),
    "hanging": (
        lambda: gp.Crystal.on("chain", [PLAIN]).repeat((4,)).remove(1),
        "falls into pieces",
    ),
}


@pytest.mark.parametrize("name", ERRORS)
def test_what_cannot_be_is_one_clear_error(name):
    make, said = ERRORS[name]
    with pytest.raises(InputError, match=said) as error:
        make()
    assert "\n" not in str(error.value)


@settings(max_examples=8)
@given(st.integers(0, 10**6))
def test_a_tree_finds_the_contacts_that_all_pairs_have(seed):
    rng = np.random.default_rng(seed)
    name = str(rng.choice(["chain", "triangular", "honeycomb", "fcc", "hcp"]))
    crystal = gp.Crystal.on(name, [PLAIN])
    large = crystal.repeat({1: (45,), 2: (5, 9), 3: (3, 4, 4)}[crystal.periods])
    order = rng.permutation(large.n_balls)
    places = (large.positions + rng.integers(-1, 2, (large.n_balls, large.periods)) @ large.cell)[
        order
    ]
    found = gp.Crystal([PLAIN] * large.n_balls, large.cell, places)
    # every ball has its neighbours, at the right distance, and no contact is there twice
    assert len(set(list_contacts(found))) == found.n_contacts == large.n_contacts
    table = found.contacts
    vector = places[table.j] + table.shift @ large.cell - places[table.i]
    assert_allclose(vector, table.vector, atol=1e-12)
    ends = np.bincount(np.concatenate([table.i, table.j]), minlength=large.n_balls)
    assert set(ends.tolist()) == {2 * crystal.n_contacts // crystal.n_balls}


@pytest.mark.parametrize("finite", [False, True])
def test_loads_beyond_double_precision_are_refused(finite):
    crystal = gp.Crystal.on("fcc", [PLAIN])
    for find, value in (
        (crystal.at_pressure, 1e250),
        (crystal.at_force, 1e300),
        (crystal.at_overlap, 1e200),
        (crystal.at_stress, -1e300 * np.eye(3)),
        (crystal.at_strain, -1e200 * np.eye(3)),
    ):
        with pytest.raises(InputError, match=r"precision|diameter|strain"):
            find(value, finite_overlap=finite)


def test_loads_whose_pressure_is_beyond_floats_are_refused_at_once(monkeypatch):
    """Of what is cut the pressure of a force is greater than the force; where gravity presses more,
    none is found.
    """
    tried = []
    find_rest = crystal_module.find_rest
    monkeypatch.setattr(
        crystal_module,
        "find_rest",
        lambda *given, **named: tried.append(1) or find_rest(*given, **named),
    )
    whole = gp.Crystal.on("triangular", [gp.Ball(STEEL, 8e-3)])
    for edges in ("free", ("floor", "free")):
        with pytest.raises(InputError, match="beyond double precision"):
            whole.cut(1, 6, edges=edges).at_force(1e308)
    assert not tried
    for field in (1e30, 1e100):
        with pytest.raises(InputError, match="gravity presses more"):
            whole.cut(1, 6, edges=("floor", "free")).at_force(10.0, gravity=(0.0, -field))
    assert len(tried) < 10


def test_crystals_that_do_not_fit_into_memory_are_refused():
    crystal = gp.Crystal.on("fcc", [PLAIN])
    with pytest.raises(InputError, match="1,000,000,000 balls"):
        crystal.repeat((1000, 1000, 1000))
    with pytest.raises(InputError, match="27,000,000 balls"):
        crystal.repeat((3, 3, 3)).cut(0, 1_000_000)


def test_velocities_and_moduli_take_several_loads():
    """Those of each load, with the axes of the load in front."""
    states = gp.Crystal.on("NaCl", [PLAIN, gp.Ball(ALUMINIUM, PLAIN.diameter)]).at_force(
        [[1.0, 5.0, 20.0]]
    )
    ways = [[1.0, 0.0, 0.0], [1.0, 1.0, 0.0]]
    sound = gp.sound_velocities(states, ways)
    elastic = gp.moduli(states)
    assert sound.velocities.shape == (1, 3, 2, 3)
    assert sound.longitudinal.shape == (1, 3, 2)
    assert elastic.tensor.shape == (1, 3, 6, 6)
    assert elastic.cubic
    for at in range(3):
        alone = states[0, at]
        assert_allclose(
            sound.velocities[0, at], gp.sound_velocities(alone, ways).velocities, rtol=1e-15
        )
        assert_allclose(elastic.bulk[0, at], gp.moduli(alone).bulk, rtol=1e-15)
    assert_allclose(
        sound.longitudinal[0, 1:] / sound.longitudinal[0, :1],
        [[5 ** (1 / 6)] * 2, [20 ** (1 / 6)] * 2],
        rtol=1e-12,
    )


def test_balls_without_periods_are_a_cluster():
    side = PLAIN.diameter
    cluster = gp.Crystal(
        [PLAIN] * 3, [], [[0.0, 0.0], [side, 0.0], [side / 2.0, side * 3.0**0.5 / 2.0]]
    )
    assert (cluster.periods, cluster.n_contacts) == (0, 3)
    with pytest.raises(InputError, match="neither periods nor faces"):
        cluster.at_force(1.0)


@pytest.mark.parametrize("value", [0.0, -1e-6])
def test_contacts_that_adhere_have_no_mean_force_or_overlap_at_or_below_zero(value):
    crystal = gp.Crystal.on("chain", [PLAIN], law=gp.JKR(0.1))
    for find in (crystal.at_force, crystal.at_overlap):
        with pytest.raises(InputError, match="Use at_pressure"):
            find(value)
    assert_allclose(crystal.at_pressure(value).normal_force, value, atol=1e-12)


def test_laws_of_pairs_may_name_a_defect_and_name_each_pair_once():
    one, heavy = gp.Ball(STEEL, 8e-3, name="steel"), gp.Ball(STEEL, 8e-3, mass=0.05, name="heavy")
    laws = {("steel", "steel"): gp.Hertz(), ("heavy", "steel"): gp.PowerLaw(1.0, 1e7)}
    state = (
        gp.Crystal.on("triangular", [one], law=laws).repeat((3, 3)).replace(4, heavy).at_force(1.0)
    )
    assert np.count_nonzero(np.isclose(state.normal_stiffness, 1e7)) == 6
    with pytest.raises(InputError, match="two laws"):
        gp.Crystal.on("triangular", [one], law=laws | {("steel", "heavy"): gp.Hertz()})
    with pytest.raises(InputError, match="class Hertz"):
        gp.Crystal.on("triangular", [one], law=gp.Hertz)


@pytest.mark.parametrize(
    ("name", "finite"), [("NaCl", True), ("NaCl", False), ("square", True), ("fcc", True)]
)
def test_bands_of_a_supercell_without_friction_are_folded(name, finite):
    """Under finite overlap static forces act across contacts, and only some of the rows of C are
    there.
    """
    crystal = gp.Crystal.on(name, [PLAIN, SOFT] if name == "NaCl" else [PLAIN], friction=False)
    p = crystal.periods
    q = np.random.default_rng(3).random((2, crystal.periods))
    one, many = (
        gp.Phonons(c.at_force(10.0, finite_overlap=finite))
        for c in (crystal, crystal.repeat((2,) * p))
    )
    folded = [one.frequencies((q + step) / 2.0) for step in itertools.product((0, 1), repeat=p)]
    assert_allclose(many.frequencies(q), np.sort(np.concatenate(folded, axis=1), axis=1), rtol=1e-9)


def twin_energy(crystal, laws, cell_rate):
    """The energy of small overlaps, contact by contact, as a function of (u of all balls, strain in
    Voigt order).
    """
    n = crystal.n_balls
    d = crystal.dimension
    p = crystal.periods
    found = []
    radii = [ball.diameter / 2 for ball in crystal.balls]
    for i, j in itertools.product(range(n), repeat=2):
        for step in itertools.product((-1, 0, 1), repeat=p):
            vector = crystal.positions[j] + np.array(step) @ crystal.cell - crystal.positions[i]
            if (i, *step) < (j, *(-one for one in step)) and abs(
                np.linalg.norm(vector) - radii[i] - radii[j]
            ) < 1e-8:
                found.append((i, j, vector, vector / np.linalg.norm(vector), laws(i, j)))
    pairs = [(a, b) for a in range(p) for b in range(a, p)]

    def energy(x):
        u, strain = x[: n * d].reshape(n, d), np.zeros((d, d))
        for (a, b), value in zip(pairs, x[n * d :], strict=True):
            strain[a, b] = strain[b, a] = value
        total, slope_u, slope_e = 0.0, np.zeros((n, d)), np.zeros(len(pairs))
        for i, j, vector, normal, law in found:
            overlap = -float(normal @ (u[j] - u[i] + strain @ vector))
            force = law.force(overlap)
            total += law.energy(overlap)
            slope_u[j] -= force * normal
            slope_u[i] += force * normal
            for at, (a, b) in enumerate(pairs):
                along = normal[a] * vector[b] + (normal[b] * vector[a] if a != b else 0.0)
                slope_e[at] -= force * along
        for at, (a, b) in enumerate(pairs):
            work = cell_rate[a, b] * (1.0 if a == b else 2.0)
            total -= work * x[n * d + at]
            slope_e[at] -= work
        return total, np.concatenate([slope_u.ravel(), slope_e])

    return energy, len(found)


CELLS = {
    "triangular": ("triangular", (2, 2), [0, 3]),
    "fcc": ("fcc", (1, 2, 1), [1]),
    "bcc": ("bcc", (1, 1, 2), [1]),
    "kagome": ("kagome", (1, 1), [2]),
}


@pytest.mark.parametrize("name", CELLS)
@pytest.mark.parametrize("seed", [0, pytest.param(1, marks=pytest.mark.slow)])
def test_rest_is_the_minimum_of_the_energy_that_scipy_finds(name, seed):
    lattice, shape, soft = CELLS[name]
    crystal = gp.Crystal.on(lattice, [PLAIN]).repeat(shape).replace(soft, SOFT)
    p = crystal.periods
    rng = np.random.default_rng(seed)
    noise = rng.uniform(-1.0, 1.0, (p, p))
    # the last two have mechanisms
    ring = {"triangular": 0.2, "fcc": 0.2, "bcc": 0.0, "kagome": 0.0}[name]
    stress = -(np.eye(p) + ring * (noise + noise.T) / 2) * {2: 2e3, 3: 3e5}[p]
    state = crystal.at_stress(stress)
    kinds = [PLAIN if ball == PLAIN else SOFT for ball in crystal.balls]
    size = float(np.mean(state.overlap))

    def laws(i, j):
        pair = gp.Hertz().between(kinds[i], kinds[j])
        # of overlaps in units of this size, so that numbers are near one
        return gp.HertzLaw(pair.coefficient * size**1.5)

    volume = abs(np.linalg.det(crystal.cell))
    # units: overlaps of ``size``, lengths of cells in m; strain times m is a length
    energy, count = twin_energy(crystal, laws, stress * volume)
    assert count == len(crystal.contacts)
    start = np.zeros(crystal.n_balls * crystal.dimension + p * (p + 1) // 2)
    pairs = [(a, b) for a in range(p) for b in range(a, p)]
    for at, (a, b) in enumerate(pairs):
        start[crystal.n_balls * crystal.dimension + at] = -1.0 / 8e-3 if a == b else 0.0
    scale = float(np.mean(state.normal_force))
    found = minimize(
        lambda x: tuple(np.asarray(one) / scale for one in energy(x)),
        start,
        jac=True,
        method="BFGS",
        options={"gtol": 1e-11},
    )
    u = found.x[: crystal.n_balls * crystal.dimension].reshape(crystal.n_balls, -1)
    strain = np.zeros((p, p))
    for at, (a, b) in enumerate(pairs):
        strain[a, b] = strain[b, a] = found.x[u.size + at]
    table = crystal.contacts
    overlap = (
        -np.einsum("ca,ca->c", table.normal, u[table.j] - u[table.i] + table.vector @ strain) * size
    )
    assert_allclose(np.maximum(overlap, 0.0), np.maximum(state.overlap, 0.0), atol=2e-6 * size)
    assert_allclose(np.linalg.norm(pull_on_balls(state)[0], axis=1), 0.0, atol=1e-12 * scale)
    assert_allclose(state.stress, stress, atol=1e-12 * np.abs(stress).max())


@pytest.mark.parametrize("name", ["at_force", "at_overlap"])
def test_a_mean_of_zero_has_no_stiffness_and_one_below_zero_is_a_tension(name):
    find = getattr(gp.Crystal.on("triangular", [PLAIN]), name)
    with pytest.raises(InputError, match=r"is zero.*no stiffness"):
        find([1e-6, 0.0])
    with pytest.raises(InputError, match=r"tensile.*no tension"):
        find([1e-6, -1e-6])


def test_no_kind_is_called_as_the_floor():
    with pytest.raises(InputError, match="rigid plane") as refused:
        gp.Crystal.on("triangular", [replace(PLAIN, name="floor")])
    assert "two kinds" not in str(refused.value)


def test_a_chain_may_be_given_as_a_lattice():
    heavy = replace(PLAIN, mass=0.05)
    chain = gp.Crystal.on(gp.Lattice("chain", ((1.0,),)), [PLAIN, heavy, PLAIN])
    assert chain == gp.Crystal.on("chain", [PLAIN, heavy, PLAIN])


def test_a_state_of_a_single_load_has_no_index():
    state = as_state(gp.Crystal.on("triangular", [PLAIN]).at_pressure([1e3, 2e3]))
    with pytest.raises(InputError, match="no index"):
        _ = state[0][0]
