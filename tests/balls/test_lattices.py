"""The table of contacts, and lattices in one, two and three dimensions as data.

Bands are in tests/dynamics/test_crystal_bands.py.
"""

from __future__ import annotations

import dataclasses
import itertools
import math
import re

import ase.build
import mpmath
import numpy as np
import pytest
from hypothesis import assume, given
from hypothesis import strategies as st
from numpy.testing import assert_allclose

import granphon as gp
from granphon.balls.lattices import KAGOME, LATTICES, SQUARE, TRIANGULAR, as_direction, find_lattice
from granphon.balls.layers import read_axis
from granphon.balls.motions import ALL
from granphon.balls.neighbours import contact_frames, steps_within, touch_once_at_most
from granphon.base.errors import InputError

ROOT2 = math.sqrt(2.0)
ROOT3 = math.sqrt(3.0)

#: contacts of a ball; length, area or volume of a ball; pressure over force, z f/(2 p measure):
#: each of the z contacts of a ball gives half of f da of energy where the measure gives p measure
#: da
NAMED = {
    "chain": (2, 1.0, 1.0),
    "square": (4, 1.0, 1.0),
    "triangular": (6, ROOT3 / 2, ROOT3),
    "honeycomb": (3, 3 * ROOT3 / 4, 1 / ROOT3),
    "kagome": (4, 2 / ROOT3, ROOT3 / 2),
    "sc": (6, 1.0, 1.0),
    "bcc": (8, 4 / (3 * ROOT3), ROOT3),
    "fcc": (12, 1 / ROOT2, 2 * ROOT2),
    "hcp": (12, 1 / ROOT2, 2 * ROOT2),
    "diamond": (4, 8 / (3 * ROOT3), ROOT3 / 4),
}
SOLID = ["sc", "bcc", "fcc", "hcp", "diamond"]


# -- lattices by name ------------------------------------------------------------------------------


def test_every_named_lattice_is_here():
    assert set(LATTICES) == set(NAMED)


@pytest.mark.parametrize("name", NAMED)
def test_named_lattices(name):
    lattice = LATTICES[name]
    (contacts, measure, pressure) = NAMED[name]
    assert lattice.coordination == contacts
    assert_allclose(lattice.measure_per_ball, measure, rtol=1e-15)
    assert_allclose(lattice.pressure_factor, pressure, rtol=1e-14)
    assert lattice.pressure_factor == pytest.approx(
        contacts / (2 * lattice.periods * measure), rel=1e-14
    )
    assert (
        lattice.periods
        == lattice.dimension
        == (1 if name == "chain" else 3 if name in SOLID else 2)
    )
    # each ball by itself has so many contacts, in directions that add up to zero
    table = lattice.contacts
    assert np.bincount(np.concatenate([table.i, table.j])).tolist() == [contacts] * lattice.n_balls
    # and the next balls are well apart
    apart = lattice.positions[:, None] - lattice.positions
    steps = (
        np.array(list(itertools.product(range(-2, 3), repeat=lattice.periods))) @ lattice.vectors
    )
    distances = np.linalg.norm(apart[:, :, None] + steps, axis=-1).ravel()
    assert not np.any((distances > 1e-9) & (np.abs(distances - 1) > 1e-9) & (distances < 1.15))


@pytest.mark.parametrize("name", SOLID)
def test_cells_are_those_of_ase(name):
    edge = {"sc": 1.0, "bcc": 2 / ROOT3, "fcc": ROOT2, "hcp": 1.0, "diamond": 4 / ROOT3}[name]
    lattice, atoms = (
        LATTICES[name],
        ase.build.bulk("Fe", name, a=edge, c=math.sqrt(8 / 3) if name == "hcp" else None),
    )
    assert_allclose(lattice.vectors, atoms.cell.array, atol=1e-15)
    assert lattice.n_balls == len(atoms)
    if lattice.n_balls == 2:
        between = np.diff(lattice.positions, axis=0)[0] - np.diff(atoms.positions, axis=0)[0]
        parts = np.linalg.solve(lattice.vectors.T, between)
        # the same, or the same seen from the other ball
        other = np.linalg.solve(
            lattice.vectors.T, between + 2 * np.diff(atoms.positions, axis=0)[0]
        )
        assert min(np.max(np.abs(one - np.rint(one))) for one in (parts, other)) < 1e-14


@pytest.mark.parametrize("name", NAMED)
def test_pressure_is_minus_energy_over_measure(steel, name):
    # of a state with finite overlap: E = n_c U(delta), measure (d - delta)^p; in the unit that its
    # dimension has
    packing = gp.Packing(steel, 8e-3, lattice=name)
    lattice = packing.structure
    p = packing.structure.periods
    state = gp.AveragedLattice(packing).at_overlap(8e-5, finite_overlap=True)
    with mpmath.workdps(40):
        c, d = mpmath.mpf(packing.law.coefficient), mpmath.mpf(8e-3)

        def energy(delta):
            return len(lattice.contacts) * mpmath.mpf(2) / 5 * c * delta ** (mpmath.mpf(5) / 2)

        def measure(delta):
            return lattice.measure * (d - delta) ** p

        at = mpmath.mpf(8e-5)
        expected = -mpmath.diff(energy, at) / mpmath.diff(measure, at)
    assert state.pressure == pytest.approx(float(expected), rel=1e-13)
    assert state._field_units()["pressure"] == ("N", "N/m", "Pa")[p - 1]
    # density times measure is the mass, with the thickness of the layer in the plane
    weight = (
        state.effective_density
        * lattice.measure_per_ball
        * (8e-3 - 8e-5) ** p
        * (8e-3 if p == 2 else 1.0)
    )
    assert weight == pytest.approx(packing.mass, rel=1e-13)


# -- lattices as data ------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("cell", "sites", "like"),
    [
        (((1, 0),), ((),), "chain"),
        (((1, 0, 0),), ((),), "chain"),
        (((2, 0, 0),), ((0, 0, 0), (0.5, 0, 0)), "chain"),
        (((1, 0, 0), (0, 1, 0)), ((),), "square"),
        (((1, 0, 0), (-0.5, ROOT3 / 2, 0)), ((0.3, 0.1, 7.0),), "triangular"),
        (
            ((ROOT3, 0, 0), (-ROOT3 / 2, 1.5, 0)),
            ((1 / 3, 2 / 3, -2.0), (2 / 3, 1 / 3, -2.0)),
            "honeycomb",
        ),
    ],
)
def test_a_lattice_with_fewer_periods_than_dimensions(cell, sites, like):
    # the last coordinates of a site are lengths across the periods; rows and layers may lie
    # anywhere
    lattice = gp.Lattice("mine", cell, sites)
    named = LATTICES[like]
    assert (lattice.periods, lattice.dimension) == (named.periods, len(cell[0]))
    for name in ("coordination", "measure_per_ball", "pressure_factor"):
        assert getattr(lattice, name) == pytest.approx(getattr(named, name), rel=1e-15)
    one, other = (
        gp.ContactLattice.of(at, 0.8, torsion=0.1, bending=0.2, motions=ALL)
        for at in (lattice, named)
    )
    q = np.array([[0.3, -0.7]])[:, : lattice.periods]
    found = one.frequencies(q)[0]
    expected = other.frequencies(q)[0]
    assert found.size == expected.size * lattice.n_balls // named.n_balls
    assert np.max(np.min(np.abs(found - expected[:, None]), axis=1)) < 1e-13


@pytest.mark.parametrize(
    ("cell", "sites", "said"),
    [
        (((1, 0),), ((0, 0), (0.5, 3.0)), "2 rows"),
        (((1, 0), (0, 1.5)), ((),), "rows, 1 in each cell"),
        (((1, 0), (0, 4)), ((0, 0), (0.5, 0.5)), "rows, 2 in each cell"),
        (((1, 0), (0.3, 5)), ((0, 0), (0, 0.4)), "rows, 2 in each cell"),
        (((2, 1), (-1, 2)), ((0, 0), (0.4, -0.2)), "clusters, 1 in each cell"),
        (np.diag([1.0, 1.0, 1.5]), ((),), "layers, 1 in each cell"),
        (((2, 0, 0), (0, 1, 0), (1, 0, 1.5)), ((0, 0, 0), (0.5, 0, 0)), "layers, 1 in each cell"),
        (np.diag([1.0, 1.0, 4.0]), ((0, 0, 0), (0.5, 0.5, 0.5)), "layers, 2 in each cell"),
        (np.diag([1.0, 1.5, 1.5]), ((),), "rows, 1 in each cell"),
        (
            np.diag([1.0, 2.0, 4.0]),
            ((0, 0, 0), (0, 0.5, 0), (0, 0, 0.5)),
            "2 in each cell",
        ),
    ],
)
def test_balls_that_contacts_do_not_join_are_no_lattice(cell, sites, said):
    with pytest.raises(InputError, match=f"'apart' .*pieces.*{said}") as caught:
        gp.Lattice("apart", cell, sites)
    assert "apart, where" not in str(caught.value)  # no two balls nearly touch


#: the edges of a cube of three spacings: its corner, and two balls on each edge
FRAME = np.array(
    [(0, 0, 0), (1, 0, 0), (2, 0, 0), (0, 1, 0), (0, 2, 0), (0, 0, 1), (0, 0, 2)], float
)


def test_frames_inside_each_other_are_counted():
    assert gp.Lattice("frame", 3.0 * np.eye(3), FRAME / 3.0).coordination == 18 / 7
    with pytest.raises(InputError, match="do not touch: 2 networks"):
        gp.Lattice("frames", 3.0 * np.eye(3), np.concatenate([FRAME, FRAME + 1.5]) / 3.0)
    # the same two frames in a primitive cell, whose steps lead from one to the other
    cell = 1.5 * np.array([(-1, 1, 1), (1, -1, 1), (1, 1, -1)])
    with pytest.raises(InputError, match="do not touch: 2 networks"):
        gp.Lattice("frames", cell, FRAME @ np.linalg.inv(cell))


@given(
    st.sampled_from(["honeycomb", "hcp", "diamond"]),
    st.lists(st.integers(-1, 1), min_size=9, max_size=9),
)
def test_a_cell_of_any_vectors_holds_what_hangs_together(name, numbers):
    # a cell of other vectors of the same lattice, and sites moved by whole cells, have the same
    # contacts
    named = LATTICES[name]
    p = named.periods
    moves = np.reshape(numbers[: p * p], (p, p))
    lower = np.tril(moves, -1) + np.eye(p)
    upper = np.triu(moves, 1) + np.eye(p)
    steps = lower @ upper
    sites = np.array(named.sites) @ np.linalg.inv(steps) + np.arange(named.n_balls)[
        :, None
    ] * np.diag(moves)
    assert len(gp.Lattice("mine", steps @ named.vectors, sites).contacts) == len(named.contacts)


HEXAGON = ((1.0, 0.0), (-0.5, ROOT3 / 2))


@pytest.mark.parametrize(
    ("cell", "sites", "what", "mend"),
    [
        (
            ((1, 0), (-0.5, 0.8661)),
            ((),),
            "nearly touch",
            "y .*0.9999.* 0.8660254",
        ),
        (((1, 0), (-0.5, 0.866)), ((),), "overlap", "becomes 0.866025403784"),
        (
            (*[(*v, 0) for v in HEXAGON], (0, 0, 1.633)),
            LATTICES["hcp"].sites,
            "nearly touch",
            "1.633 becomes 1.63299316186",
        ),
        (
            (*[(*v, 0) for v in HEXAGON], (0, 0, 1.64)),
            LATTICES["hcp"].sites,
            "layers, 2 in",
            "1.64 becomes 1.63299316186",
        ),
        (
            (*[(*v, 0) for v in HEXAGON], (0, 0, 1.63)),
            LATTICES["hcp"].sites,
            "overlap",
            "1.63 becomes 1.63299316186",
        ),
        (
            0.7072 * np.array(LATTICES["fcc"].cell) * math.sqrt(2),
            ((),),
            "touches no other",
            "the cell by 0.99986818",
        ),
        (
            0.7071 * np.array(LATTICES["fcc"].cell) * math.sqrt(2),
            ((),),
            "overlap",
            "cell by 1.00000959",
        ),
        (((1.0001,),), ((),), "touches no other", "cell by 0.9999000"),
        (
            ((1.732, 0), (-0.866, 1.5)),
            LATTICES["honeycomb"].sites,
            "overlap",
            "1.732 becomes 1.73205080757",
        ),
        (
            ((1.732, 0), (-0.866, 1.5)),
            ((0.3333, 0.6667), (0.6667, 0.3333)),
            "overlap",
            "with eight digits",
        ),
        (
            ((1.7322, 0), (-0.8661, 1.5001)),
            LATTICES["honeycomb"].sites,
            "touches no other",
            "with eight digits",
        ),
    ],
)
def test_few_digits_are_told(cell, sites, what, mend):
    with pytest.raises(InputError, match=f"(?s){what}.*{mend}") as caught:
        gp.Lattice("rounded", cell, sites)
    assert re.search(r"apart.* touching balls are 1 apart", str(caught.value))


@pytest.mark.parametrize("name", NAMED)
def test_the_number_that_is_told_makes_the_lattice(name):
    named = LATTICES[name]
    for axis in range(named.periods):
        cell = np.array(named.cell)
        cell[:, axis] *= 1.00003
        with pytest.raises(InputError) as caught:
            gp.Lattice("rounded", cell, named.sites)
        told = re.search(r"Multiply (every ([xyz]) )?.*?([0-9.]+)[,.;]", str(caught.value))
        assert told[2] in (None, "xyz"[axis])
        cell[:, slice(None) if told[2] is None else axis] *= float(told[3])
        assert len(gp.Lattice("mended", cell, named.sites).contacts) == len(named.contacts)


@pytest.mark.parametrize("gap", [0.0012, 0.004, 0.5])
def test_a_gap_that_no_load_closes_is_allowed(gap):
    # a rhomb of contacts, a little less pointed than that of the triangular lattice: balls across
    # it do not touch
    angle = 2.0 * math.asin(0.5 * (1.0 + gap))
    assert gp.Lattice("rhombic", ((1, 0), (math.cos(angle), math.sin(angle)))).coordination == 4


@pytest.mark.parametrize("far", [1.1e6, 1e154, 1e300, -1e308])
def test_huge_cells_and_sites_are_one_clear_error(far):
    for cell, sites in (
        (((far,),), ((),)),
        (((1, 0), (0, far)), ((),)),
        (((1, 0), (far, 1)), ((),)),
        (np.eye(3), ((far, 0, 0),)),
        (((1, 0),), ((0, far),)),
    ):
        with pytest.raises(InputError, match=r"'huge' .*1e\+06"):
            gp.Lattice("huge", cell, sites)


def test_cells_that_are_too_oblique_are_not_searched():
    for cell, sites in ((((1, 0), (1e6, 1)), ((),)), (np.eye(3), ((0, 0, 0), (1e4, 0, 0.5)))):
        with pytest.raises(InputError, match="oblique"):
            gp.Lattice("odd", cell, sites)
    assert gp.Lattice("oblique", ((1, 0), (30, 1))).coordination == 4


@pytest.mark.parametrize(
    ("cell", "sites"),
    [
        (((1.2, 0),), ((0, 0.4), (0.5, -0.4))),  # zigzag
        (((1.0, 0),), ((0, ROOT3 / 4), (0.5, -ROOT3 / 4))),  # strip of triangles
        (((1.0, 0),), ((0, 0), (0, 1))),  # ladder
        (((1, 0, 0), (0, 1, 0)), ((0, 0, 0), (0.5, 0.5, 1 / ROOT2))),  # two square layers
        # two triangular layers
        (
            ((1, 0, 0), (-0.5, ROOT3 / 2, 0)),
            ((0, 0, 0), (1 / 3, 2 / 3, math.sqrt(2 / 3))),
        ),
        # and squares
        (
            ((1, 0), (0.5, 1 + ROOT3 / 2)),
            ((0, 0), (-0.5 / (1 + ROOT3 / 2), 1 / (1 + ROOT3 / 2))),
        ),
    ],
)
def test_nothing_presses_on_balls_across_the_periods(cell, sites):
    # the outermost ball has contacts to one side only, so that equal forces leave a layer flat and
    # a row straight
    with pytest.raises(InputError, match="not in equilibrium") as caught:
        gp.Lattice("bent", cell, sites)
    assert "'bent'" in str(caught.value)


@given(height=st.floats(0.05, 0.85), steps=st.integers(1, 3), turn=st.floats(0, 6.3))
def test_no_bent_lattice_is_in_equilibrium(height, steps, turn):
    # rows that wind about x: contacts with a part across it pull every ball towards the axis
    radius = 0.5 * height / math.sin(math.pi / (steps + 1))
    along = math.sqrt(1 - height**2)
    n = steps + 1
    angles = turn + 2 * math.pi / n * np.arange(n)
    sites = np.column_stack([np.arange(n) / n, radius * np.cos(angles), radius * np.sin(angles)])
    with pytest.raises(InputError, match="not in equilibrium"):
        gp.Lattice("helix", ((n * along, 0, 0),), sites)


@pytest.mark.parametrize(
    ("cell", "sites", "text"),
    [
        (((1, 0), (1, 0)), ((0, 0),), "too small"),
        (((1, 0), (0, 1)), ((0, 0), (0.5, 0.5)), "overlap"),
        (((2, 0), (0, 2)), ((0, 0),), "touches no other"),
        (((1, 0), (0, 3)), ((0, 0), (0, 0.5)), "pieces .*rows, 2"),
        (((3, 0), (0, 3)), ((0, 0), (1 / 3, 0), (0.5, 0.5)), "touches no other"),
        (((1, 0), (0, math.nan)), ((0, 0),), "not finite"),
        (((1, 0), (0, 1)), (), "sites"),
        (((1, 0), (0, 1), (1, 1)), ((0, 0),), "one to three vectors"),
        (((1, 0), (0, 1)), ((0, 0, 0),), "as many fractions"),
        (np.eye(3)[:, :2], ((),), "one to three vectors"),
        (np.eye(3), ((0.0, 0.0, 0.0), (0.5, 0.5)), "as many fractions"),
        (((1, 0, 0), (0, 1, 0.1)), ((),), "xy plane"),
        (((0.8, 0.6),), ((),), "along x"),
        (((0, 0, 1),), ((),), "along x"),
        (np.diag([1, 1, 0.05]), ((),), "too small"),
        (((1, 0, 0), (0, 1, 0), (1, 1, 0)), ((),), "too small"),
        (((0.9,),), ((),), "overlap"),
        (np.eye(3), ((0, 0, 0), (0, 0, 0)), "overlap"),
        (((1, 0, 0),), ((0, math.nan, 0),), "not finite"),
        (np.diag([1.0, 1.0, 2.0]), ((0, 0, 0), (0, 0, 0.5), (0.5, 0.5, 0.25)), "overlap"),
        ("fcc", ((),), "one to three vectors"),
        (None, ((),), "one to three vectors"),
    ],
)
def test_lattices_that_cannot_be(cell, sites, text):
    with pytest.raises(InputError, match=text) as caught:
        gp.Lattice("odd", cell, sites)
    assert "odd" in str(caught.value)
    assert "\n" not in str(caught.value)


def test_sites_may_be_an_array():
    sites = [[0.0, 0.0], [0.5, 0.5]]
    cell = ((1, 0), (0, ROOT3))
    assert gp.Lattice("centred", np.array(cell), np.array(sites)) == gp.Lattice(
        "centred", cell, sites
    )
    assert gp.Lattice("square", np.eye(2), np.zeros((1, 2))) == gp.Lattice("square", np.eye(2))


# -- the table of contacts -------------------------------------------------------------------------

HONEYCOMB = LATTICES["honeycomb"]


def test_rows_of_the_table_agree_with_the_positions():
    for lattice in (TRIANGULAR, SQUARE, KAGOME, HONEYCOMB):
        table = lattice.contacts
        vector = (
            lattice.positions[table.j] + table.shift @ lattice.vectors - lattice.positions[table.i]
        )
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


def test_lattice_keeps_no_hold_of_what_it_was_given():
    cell = np.array([[1.0, 0.0], [0.0, 1.0]])
    lattice = gp.Lattice("mine", cell)
    cell[:] = 0.0
    assert lattice.measure == 1.0
    assert hash(lattice) == hash(gp.Lattice("mine", [[1, 0], [0, 1]]))
    assert lattice == gp.Lattice("mine", [[1, 0], [0, 1]])
    with pytest.raises(dataclasses.FrozenInstanceError):
        lattice.name = "yours"


def test_unknown_lattice_names_those_known():
    with pytest.raises(InputError, match=r"chain, triangular, .*diamond"):
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


# -- packings --------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("cell", "unit"),
    [
        (((1, 0), (math.cos(1.3), math.sin(1.3))), "f/d"),
        # its pairs of contacts are not perpendicular
        (
            ((1, 0, 0), (0.3, math.sqrt(0.91), 0), (0, 0, 1)),
            "f/d^2",
        ),
    ],
)
def test_an_anisotropic_stress_is_no_pressure(steel, cell, unit):
    medium = gp.AveragedLattice(gp.Packing(steel, 8e-3, lattice=gp.Lattice("leaning", cell)))
    with pytest.raises(InputError, match=rf"pressure.*{re.escape(unit)}"):
        medium.at_pressure(400.0)
    with pytest.raises(InputError, match="is not a pressure"):
        _ = medium.at_force(1.0).pressure
    assert gp.sound_velocities(medium.at_force(1.0), np.eye(len(cell))[0]).longitudinal > 0


# -- contacts in any dimension ---------------------------------------------------------------------

FCC = np.array([[0.0, 1.0, 1.0], [1.0, 0.0, 1.0], [1.0, 1.0, 0.0]]) / math.sqrt(2.0)


@given(m=st.integers(-5, 5), n=st.integers(-5, 5), radius=st.floats(0.5, 4.0))
def test_lattice_vectors_within_a_sphere_whatever_the_cell(m, n, radius):
    # of points on the sphere itself rounding decides
    assume(abs(2.0 * radius**2 - round(2.0 * radius**2)) > 1e-9)
    skew = np.array([[1, m, 0], [0, 1, n], [0, 0, 1]])
    few = steps_within(FCC, radius)
    many = steps_within(skew @ FCC, radius)
    assert sorted(map(tuple, many @ skew)) == sorted(map(tuple, few))
    # in the cube of half the edge sqrt(2), fcc holds the points whose coordinates add up to an even
    # number
    cubes = np.stack(np.meshgrid(*[np.arange(-6, 7)] * 3), axis=-1).reshape(-1, 3)
    cubes = cubes[cubes.sum(axis=1) % 2 == 0] / math.sqrt(2.0)
    lengths = np.sort(np.linalg.norm(cubes, axis=1))
    assert_allclose(
        np.sort(np.linalg.norm(few @ FCC, axis=1)), lengths[lengths <= radius], atol=1e-12
    )


@given(st.floats(0, math.pi), st.floats(0, 7))
def test_frames_are_right_handed_and_turn_with_the_normal(polar, azimuth):
    n = np.array(
        [math.sin(polar) * math.cos(azimuth), math.sin(polar) * math.sin(azimuth), math.cos(polar)]
    )
    normal, first, second = np.array(contact_frames(n[None]))[..., 0]
    assert_allclose(
        np.array([normal, first, second]) @ np.array([normal, first, second]).T,
        np.eye(3),
        atol=1e-14,
    )
    assert_allclose(np.cross(normal, first), second, atol=1e-14)
    back = np.array(contact_frames(-n[None]))[..., 0]
    assert_allclose(back, [-normal, -first, second], atol=1e-14)
    if abs(n[2]) < 0.8:
        assert_allclose(np.cross([0.0, 0.0, 1.0], n) @ first, np.hypot(n[0], n[1]), atol=1e-14)
    flat = np.array([[math.cos(azimuth), math.sin(azimuth)]])
    assert_allclose(
        contact_frames(flat), contact_frames(np.pad(flat, ((0, 0), (0, 1)))), atol=1e-15
    )


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
        *((n, "=, +, - or @") for n in ("=1+1", "+1", "-1+1", "@SUM(A1)", " =1", "\uff1d1")),
        *((n, "letters") for n in ("ab\u202edc", "square\u200b", "a\tb", "a\nb", "\x1b[31mred")),
    ],
)
def test_a_lattice_has_a_name(name, allowed):
    with pytest.raises(
        InputError, match=rf"^the name of a lattice: .*{re.escape(allowed)}"
    ) as caught:
        gp.Lattice(name, ((1.0, 0.0), (0.0, 1.0)))
    assert str(caught.value).isprintable()


@pytest.mark.parametrize("name", ["a-b = c+d", "carré", "正方", "2 x 2", "mine@home"])
def test_other_names_are_taken(name):
    assert gp.Lattice(name, ((1.0, 0.0), (0.0, 1.0))).name == name


@pytest.mark.parametrize(
    ("name", "cell", "sites"),
    [
        ("fcc", np.sqrt(2.0) * np.eye(3), ((0, 0, 0), (0.5, 0.5, 0), (0.5, 0, 0.5), (0, 0.5, 0.5))),
        ("fcc", np.eye(3), ((),)),
        ("triangular", ((1.0, 0.0), (0.5, math.sqrt(0.75))), ((),)),
        ("chain", ((1.0, 0.0, 0.0),), ((),)),
        ("square", ((1.0, 0.0), (0.0, 1.0)), ((0.5, 0.5),)),
    ],
)
def test_a_known_name_belongs_to_its_cell(name, cell, sites):
    with pytest.raises(
        InputError,
        match=f"lattice '{name}' .*name",
    ):
        gp.Lattice(name, cell, sites)
    assert gp.Lattice(f"my {name}", cell, sites).name == f"my {name}"


@pytest.mark.parametrize("name", LATTICES)
def test_the_cell_of_a_known_lattice_may_bear_its_name(name):
    known = LATTICES[name]
    assert gp.Lattice(name, known.cell, known.sites) == known
    rounded = gp.Lattice(name, known.vectors.round(7), known.sites)
    assert len(rounded.contacts) == len(known.contacts)


def test_miller_indices_of_a_scene_are_whole_numbers_of_a_few_digits():
    assert read_axis("1 -1 0") == (1, -1, 0)
    for text in ("1 x 0", "1 101 0", "1 0 " + 5000 * "9"):
        with pytest.raises(InputError, match="a whole number from -100 to 100"):
            read_axis(text)
