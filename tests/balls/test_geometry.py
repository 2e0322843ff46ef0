"""The table of contacts, lattices given as data, and packings."""

from __future__ import annotations

import dataclasses
import math
import re

import mpmath
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from numpy.testing import assert_allclose

import granphon as gp
from granphon.balls.contact_table import contact_frames, find_contacts, steps_within, touch_once_at_most
from granphon.balls.lattices import KAGOME, LATTICES, SQUARE, TRIANGULAR, as_direction, find_lattice
from granphon.base.errors import InputError

HONEYCOMB = gp.Lattice("honeycomb", ((math.sqrt(3.0), 0.0), (-math.sqrt(3.0) / 2, 1.5)), ((1 / 3, 2 / 3), (2 / 3, 1 / 3)))


@pytest.mark.parametrize(
    ("lattice", "coordination", "area"),
    [
        (TRIANGULAR, 6, math.sqrt(3) / 2),
        (SQUARE, 4, 1.0),
        (KAGOME, 4, 2 / math.sqrt(3)),
        (HONEYCOMB, 3, 3 * math.sqrt(3) / 4),
    ],
)
def test_named_lattices(twin, lattice, coordination, area):
    assert lattice.coordination == coordination
    assert_allclose(lattice.measure_per_ball, area, rtol=1e-15)
    table = lattice.contacts
    assert len(table) == coordination * lattice.n_balls // 2
    # the twin sees every contact from both ends
    expected = sorted(
        (i, j, round(x, 9) + 0.0, round(y, 9) + 0.0) for i, j, (x, y) in twin.neighbours(lattice.cell, lattice.sites)
    )
    rows = list(zip(table.i.tolist(), table.j.tolist(), table.normal.tolist(), strict=True))
    found = [(i, j, round(x, 9) + 0.0, round(y, 9) + 0.0) for i, j, (x, y) in rows]
    found += [(j, i, round(-x, 9) + 0.0, round(-y, 9) + 0.0) for i, j, (x, y) in rows]
    assert sorted(found) == expected


def test_rows_of_the_table_agree_with_the_positions():
    for lattice in (TRIANGULAR, SQUARE, KAGOME, HONEYCOMB):
        table = lattice.contacts
        vector = lattice.positions[table.j] + table.shift @ lattice.vectors - lattice.positions[table.i]
        assert_allclose(table.vector, vector, atol=1e-15)
        assert_allclose(np.linalg.norm(table.normal, axis=1), 1.0, rtol=1e-15)
        assert_allclose(table.arm_i + table.arm_j, np.linalg.norm(table.vector, axis=1), rtol=1e-15)


def test_table_is_read_only_and_scales():
    table = TRIANGULAR.contacts
    for field in dataclasses.fields(table):
        with pytest.raises(ValueError, match="read-only"):
            getattr(table, field.name)[:] = 0
    small = table.scale(0.9)
    assert_allclose(small.vector, 0.9 * table.vector, rtol=1e-15)
    assert_allclose(small.arm_i, 0.45, rtol=1e-15)
    assert_allclose(small.normal, table.normal, rtol=0)


def test_hexagonal_cell_has_k_at_one_third_one_third():
    # the corner of the zone is at 4 pi/3 along a1, the middle of an edge at 2 pi/sqrt(3) along y
    lattice = gp.ContactLattice.of("triangular", 0.0)
    assert_allclose(lattice.wavevectors([1 / 3, 1 / 3, 0]), [2 * math.pi / 3, 2 * math.pi / math.sqrt(3)], rtol=1e-14)
    assert_allclose(np.linalg.norm(lattice.wavevectors([1 / 3, 1 / 3])), 4 * math.pi / 3, rtol=1e-14)
    assert_allclose(np.linalg.norm(lattice.wavevectors([1 / 2, 0])), 2 * math.pi / math.sqrt(3), rtol=1e-14)


@pytest.mark.parametrize("lattice", [TRIANGULAR, SQUARE, KAGOME, HONEYCOMB])
def test_pressure_is_minus_energy_over_area(lattice):
    # E(a) = n_c V(a), V' = -f, area = A a^2: P = -dE/dA
    contacts, area = len(lattice.contacts), mpmath.mpf(lattice.measure)
    with mpmath.workdps(30):

        def energy(a):
            return contacts * (mpmath.mpf("1.1") - a) ** mpmath.mpf("2.5")

        force = -mpmath.diff(energy, 1) / contacts
        pressure = -mpmath.diff(energy, 1) / (2 * area)
        assert abs(lattice.pressure_factor / (pressure / force) - 1) < 1e-15


@given(m=st.integers(-4, 4), n=st.integers(-4, 4), angle=st.floats(0, 7))
def test_skewed_and_turned_cell_has_the_same_contacts(m, n, angle):
    skew = np.array([[1, m], [0, 1]]) @ np.array([[1, 0], [n, 1]])
    turn = np.array([[math.cos(angle), -math.sin(angle)], [math.sin(angle), math.cos(angle)]])
    cell = skew @ TRIANGULAR.vectors @ turn.T
    table = gp.Lattice("skewed", cell).contacts
    both = np.concatenate([table.normal, -table.normal]) @ turn
    angles = np.sort(np.degrees(np.arctan2(both[:, 1], both[:, 0])) % 60.0 % 60.0)
    assert len(both) == 6
    assert_allclose(np.minimum(angles, 60.0 - angles), 0.0, atol=1e-11)
    sectors = np.sort(np.round(np.degrees(np.arctan2(both[:, 1], both[:, 0])) / 60.0).astype(int) % 6)
    assert sectors.tolist() == [0, 1, 2, 3, 4, 5]


def test_sites_may_lie_outside_the_cell():
    moved = gp.Lattice("kagome, scattered", KAGOME.cell, ((2.5, -1.0), (0.0, 3.5), (-0.5, 0.5)))
    assert len(moved.contacts) == 6
    assert moved.coordination == 4


def test_lattice_keeps_no_hold_of_what_it_was_given():
    cell = np.array([[1.0, 0.0], [0.0, 1.0]])
    lattice = gp.Lattice("mine", cell)
    cell[:] = 0.0
    assert lattice.measure == 1.0
    assert hash(lattice) == hash(gp.Lattice("mine", [[1, 0], [0, 1]]))
    assert lattice == gp.Lattice("mine", [[1, 0], [0, 1]])
    with pytest.raises(dataclasses.FrozenInstanceError):
        lattice.name = "yours"


@pytest.mark.parametrize(
    ("cell", "sites", "text"),
    [
        (((1, 0), (1, 0)), ((0, 0),), "too small"),
        (((1, 0), (0, 1)), ((0, 0), (0.5, 0.5)), "overlap"),
        (((2, 0), (0, 2)), ((0, 0),), "touches no other"),
        (((1, 0), (0, 3)), ((0, 0), (0, 0.5)), "pieces that do not touch: rows, 2 in each cell"),
        (((3, 0), (0, 3)), ((0, 0), (1 / 3, 0), (0.5, 0.5)), "touches no other"),
        (((1, 0), (0, math.nan)), ((0, 0),), "not finite"),
        (((1, 0), (0, 1)), ((0, math.inf),), "not finite"),
        (((1, 0), (0, 1)), (), "sites"),
        (np.eye(2), np.zeros((0, 2)), "sites"),
        (((1, 0, 0), (0, 1, 1)), ((0, 0),), "does not lie in the xy plane"),
        (((0, 1),), ((0,),), "does not lie along x"),
        (((1, 0), (0, 1), (1, 1)), ((0, 0),), "one to three vectors"),
        (((1, 0), (0, 1)), ((0, 0, 0),), "as many fractions"),
        ("hexagon", ((0, 0),), "one to three vectors"),
    ],
)
def test_impossible_lattices(cell, sites, text):
    with pytest.raises(InputError, match=text):
        gp.Lattice("odd", cell, sites)


def test_unknown_lattice_names_those_known():
    with pytest.raises(InputError, match="chain, triangular, square, honeycomb, kagome, sc, bcc, fcc, hcp, diamond"):
        find_lattice("hexagonl")
    assert find_lattice("kagome") is KAGOME
    assert find_lattice(HONEYCOMB) is HONEYCOMB


@given(x=st.floats(-1, 1), y=st.floats(0.1, 1), scale=st.floats(-300, 300))
def test_direction_is_a_unit_vector_at_any_scale(x, y, scale):
    factor = 10.0**scale
    unit = as_direction((x * factor, y * factor))
    assert_allclose(np.hypot(*unit), 1.0, rtol=1e-15)
    assert_allclose(unit, np.array([x, y]) / math.hypot(x, y), rtol=1e-14, atol=1e-15)


@pytest.mark.parametrize("bad", [(0, 0), (1, math.nan), (1, 2, 3), 1.0, (math.inf, 0)])
def test_no_direction(bad):
    with pytest.raises(InputError, match="direction"):
        as_direction(bad)


# -- packings ---------------------------------------------------------------------------------------------------------


def test_packing_of_equal_balls(packing, smooth):
    assert_allclose(packing.mass, math.pi / 6 * 7840 * 8e-3**3, rtol=1e-15)
    assert_allclose(packing.effective_density, math.pi * 7840 / (3 * math.sqrt(3)), rtol=1e-15)
    assert_allclose(packing.mindlin_ratio, 2 * 0.724 / 1.724, rtol=1e-15)
    assert smooth.mindlin_ratio == 0.0
    assert packing.structure is TRIANGULAR
    with pytest.raises(dataclasses.FrozenInstanceError):
        packing.diameter = 1.0


@pytest.mark.parametrize(
    ("change", "text"),
    [
        ({"diameter": 0.0}, "diameter"),
        ({"diameter": -1.0}, "diameter"),
        ({"diameter": math.nan}, "diameter"),
        ({"diameter": "8 mm"}, "diameter"),
        ({"lattice": "cubic"}, "unknown lattice"),
        ({"friction": 1}, "friction"),
        ({"friction": "yes"}, "friction"),
        ({"material": "steel"}, "material"),
    ],
)
def test_impossible_packings(steel, change, text):
    with pytest.raises(InputError, match=text):
        gp.Packing(**({"material": steel, "diameter": 8e-3} | change))


@given(d=st.floats(-9.0, 2.0))
def test_mass_at_every_size(steel, d):
    with mpmath.workdps(40):
        diameter = 10.0**d
        mass = mpmath.pi / 6 * mpmath.mpf(steel.density) * mpmath.mpf(diameter) ** 3
        assert abs(gp.Packing(steel, diameter).mass / mass - 1) < 2e-15


def test_a_lattice_must_be_in_equilibrium():
    height = 1.0 + math.sqrt(3.0) / 2.0
    with pytest.raises(InputError, match="not in equilibrium"):
        gp.Lattice("elongated", ((1, 0), (0.5, height)), ((0, 0), (-0.5 / height, 1 / height)))


def test_an_anisotropic_stress_is_no_pressure():
    rhombic = gp.Lattice("rhombic", ((1, 0), (math.cos(1.3), math.sin(1.3))))
    medium = gp.AveragedLattice(gp.Packing(gp.Material(211.65e9, 0.276, 7840.0), 8e-3, lattice=rhombic))
    with pytest.raises(InputError, match="is not a pressure"):
        medium.at_pressure(400.0)
    with pytest.raises(InputError, match="is not a pressure"):
        _ = medium.at_force(1.0).pressure
    assert gp.sound_velocities(medium.at_force(1.0), (1, 0)).longitudinal > 0


# -- contacts in any dimension ------------------------------------------------------------------------------------------

FCC = np.array([[0.0, 1.0, 1.0], [1.0, 0.0, 1.0], [1.0, 1.0, 0.0]]) / math.sqrt(2.0)


@given(m=st.integers(-5, 5), n=st.integers(-5, 5), radius=st.floats(0.5, 4.0))
def test_lattice_vectors_within_a_sphere_whatever_the_cell(m, n, radius):
    skew = np.array([[1, m, 0], [0, 1, n], [0, 0, 1]])
    few, many = steps_within(FCC, radius), steps_within(skew @ FCC, radius)
    assert sorted(map(tuple, many @ skew)) == sorted(map(tuple, few))
    # in the cube of half the edge sqrt(2), fcc holds the points whose coordinates add up to an even number
    cubes = np.stack(np.meshgrid(*[np.arange(-6, 7)] * 3), axis=-1).reshape(-1, 3)
    cubes = cubes[cubes.sum(axis=1) % 2 == 0] / math.sqrt(2.0)
    lengths = np.sort(np.linalg.norm(cubes, axis=1))
    assert_allclose(np.sort(np.linalg.norm(few @ FCC, axis=1)), lengths[lengths <= radius], atol=1e-12)


def test_contacts_of_fcc_and_of_a_chain():
    table = find_contacts(FCC, np.zeros((1, 3)), "fcc")
    expected = [[1, 1, 0], [1, -1, 0], [1, 0, 1], [1, 0, -1], [0, 1, 1], [0, 1, -1]]
    both = np.concatenate([table.normal, -table.normal]) * math.sqrt(2.0)
    assert sorted(np.round(both, 12).tolist()) == sorted([*expected, *(-np.array(expected)).tolist()])
    assert_allclose(table.shift @ FCC, table.vector, atol=1e-15)
    chain = find_contacts(np.array([[2.0, 0.0]]), np.array([[0.0, 0.0], [1.0, 0.0]]), "chain")
    assert_allclose(sorted(chain.vector.tolist()), [[-1.0, 0.0], [1.0, 0.0]])


@given(st.floats(0, math.pi), st.floats(0, 7))
def test_frames_are_right_handed_and_turn_with_the_normal(polar, azimuth):
    n = np.array([math.sin(polar) * math.cos(azimuth), math.sin(polar) * math.sin(azimuth), math.cos(polar)])
    normal, first, second = np.array(contact_frames(n[None]))[..., 0]
    assert_allclose(np.array([normal, first, second]) @ np.array([normal, first, second]).T, np.eye(3), atol=1e-14)
    assert_allclose(np.cross(normal, first), second, atol=1e-14)
    back = np.array(contact_frames(-n[None]))[..., 0]
    assert_allclose(back, [-normal, -first, second], atol=1e-14)
    if abs(n[2]) < 0.8:
        assert_allclose(np.cross([0.0, 0.0, 1.0], n) @ first, np.hypot(n[0], n[1]), atol=1e-14)
    flat = np.array([[math.cos(azimuth), math.sin(azimuth)]])
    assert_allclose(contact_frames(flat), contact_frames(np.pad(flat, ((0, 0), (0, 1)))), atol=1e-15)


def test_images_are_apart_in_a_skewed_cell_too():
    # its shortest period is five of the first vector less the second, one diameter
    cell = np.array([[1.0, 0.0], [5.0, 1.0]])
    assert not touch_once_at_most(cell, (3, 1), 1.0)
    assert touch_once_at_most(cell, (3, 3), 1.0)
    long = np.array([[3.0, 0.0], [28.0, 1.5]])
    # 28 - 9 x 3 = 1: one period is the vector (1, 1.5)
    assert not touch_once_at_most(long, (1, 1), 1.0)


@pytest.mark.parametrize(
    ("name", "allowed"),
    [
        *((n, "a name") for n in ("", " ", 3, None)),
        *((n, "a name that does not begin with =, +, - or @") for n in ("=1+1", "+1", "-1+1", "@SUM(A1)", " =1", "\uff1d1")),
        *((n, "a name of letters that can be seen") for n in ("ab\u202edc", "square\u200b", "a\tb", "a\nb", "\x1b[31mred")),
    ],
)  # fmt: skip
def test_a_lattice_has_a_name(name, allowed):
    with pytest.raises(InputError, match=rf"^the name of a lattice: found .*; allowed: {re.escape(allowed)}\.") as caught:
        gp.Lattice(name, ((1.0, 0.0), (0.0, 1.0)))
    assert str(caught.value).isprintable()


@pytest.mark.parametrize("name", ["a-b = c+d", "carré", "正方", "2 x 2", "mine@home"])
def test_other_names_are_taken(name):
    assert gp.Lattice(name, ((1.0, 0.0), (0.0, 1.0))).name == name


@pytest.mark.parametrize(
    ("name", "cell", "sites"),
    [
        ("fcc", np.sqrt(2.0) * np.eye(3), ((0, 0, 0), (0.5, 0.5, 0), (0.5, 0, 0.5), (0, 0.5, 0.5))),
        ("fcc", np.eye(3), ((),)), ("triangular", ((1.0, 0.0), (0.5, math.sqrt(0.75))), ((),)),
        ("chain", ((1.0, 0.0, 0.0),), ((),)), ("square", ((1.0, 0.0), (0.0, 1.0)), ((0.5, 0.5),)),
    ],
)  # fmt: skip
def test_a_known_name_belongs_to_its_cell(name, cell, sites):
    with pytest.raises(InputError, match=f"the lattice '{name}' has a cell or sites of its own.*Give yours another name"):
        gp.Lattice(name, cell, sites)
    assert gp.Lattice(f"my {name}", cell, sites).name == f"my {name}"


@pytest.mark.parametrize("name", LATTICES)
def test_the_cell_of_a_known_lattice_may_bear_its_name(name):
    known = LATTICES[name]
    assert gp.Lattice(name, known.cell, known.sites) == known
    rounded = gp.Lattice(name, known.vectors.round(7), known.sites)
    assert len(rounded.contacts) == len(known.contacts)
