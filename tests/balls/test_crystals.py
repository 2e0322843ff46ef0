"""Lattices in one, two and three dimensions as data, the motions of their balls, and packings of them.

Bands are in test_crystal_bands.py.
"""

from __future__ import annotations

import itertools
import math
import re

import ase.build
import mpmath
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from numpy.testing import assert_allclose

import granphon as gp
from granphon.balls.lattices import LATTICES
from granphon.balls.motions import ALL, IN_PLANE, LONGITUDINAL, OUT_OF_PLANE, allowed_motions, select_motions
from granphon.base.errors import InputError

ROOT2, ROOT3 = math.sqrt(2.0), math.sqrt(3.0)

#: contacts of a ball; length, area or volume of a ball; pressure over force, z f/(2 p measure): each of the z contacts of a
#: ball gives half of f da of energy where the measure gives p measure da
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


# -- lattices by name ---------------------------------------------------------------------------------------------------


def test_every_named_lattice_is_here():
    assert set(LATTICES) == set(NAMED)


@pytest.mark.parametrize("name", NAMED)
def test_named_lattices(name):
    lattice, (contacts, measure, pressure) = LATTICES[name], NAMED[name]
    assert lattice.coordination == contacts
    assert_allclose(lattice.measure_per_ball, measure, rtol=1e-15)
    assert_allclose(lattice.pressure_factor, pressure, rtol=1e-14)
    assert lattice.pressure_factor == pytest.approx(contacts / (2 * lattice.periods * measure), rel=1e-14)
    assert lattice.periods == lattice.dimension == (1 if name == "chain" else 3 if name in SOLID else 2)
    # each ball by itself has so many contacts, in directions that add up to zero
    table = lattice.contacts
    assert np.bincount(np.concatenate([table.i, table.j])).tolist() == [contacts] * lattice.n_balls
    # and the next balls are well apart
    apart = lattice.positions[:, None] - lattice.positions
    steps = np.array(list(itertools.product(range(-2, 3), repeat=lattice.periods))) @ lattice.vectors
    distances = np.linalg.norm(apart[:, :, None] + steps, axis=-1).ravel()
    assert not np.any((distances > 1e-9) & (np.abs(distances - 1) > 1e-9) & (distances < 1.15))


@pytest.mark.parametrize("name", SOLID)
def test_cells_are_those_of_ase(name):
    edge = {"sc": 1.0, "bcc": 2 / ROOT3, "fcc": ROOT2, "hcp": 1.0, "diamond": 4 / ROOT3}[name]
    lattice, atoms = LATTICES[name], ase.build.bulk("Fe", name, a=edge, c=math.sqrt(8 / 3) if name == "hcp" else None)
    assert_allclose(lattice.vectors, atoms.cell.array, atol=1e-15)
    assert lattice.n_balls == len(atoms)
    if lattice.n_balls == 2:
        between = np.diff(lattice.positions, axis=0)[0] - np.diff(atoms.positions, axis=0)[0]
        parts = np.linalg.solve(lattice.vectors.T, between)
        # the same, or the same seen from the other ball
        other = np.linalg.solve(lattice.vectors.T, between + 2 * np.diff(atoms.positions, axis=0)[0])
        assert min(np.max(np.abs(one - np.rint(one))) for one in (parts, other)) < 1e-14


@pytest.mark.parametrize("name", NAMED)
def test_pressure_is_minus_energy_over_measure(steel, name):
    # of a state with finite overlap: E = n_c U(delta), measure (d - delta)^p; in the unit that its dimension has
    packing = gp.Packing(steel, 8e-3, lattice=name)
    lattice, p = packing.structure, packing.structure.periods
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
    weight = state.effective_density * lattice.measure_per_ball * (8e-3 - 8e-5) ** p * (8e-3 if p == 2 else 1.0)
    assert weight == pytest.approx(packing.mass, rel=1e-13)


# -- lattices as data ---------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("cell", "sites", "like"),
    [
        (((1, 0),), ((),), "chain"),
        (((1, 0, 0),), ((),), "chain"),
        (((2, 0, 0),), ((0, 0, 0), (0.5, 0, 0)), "chain"),
        (((1, 0, 0), (0, 1, 0)), ((),), "square"),
        (((1, 0, 0), (-0.5, ROOT3 / 2, 0)), ((0.3, 0.1, 7.0),), "triangular"),
        (((ROOT3, 0, 0), (-ROOT3 / 2, 1.5, 0)), ((1 / 3, 2 / 3, -2.0), (2 / 3, 1 / 3, -2.0)), "honeycomb"),
    ],
)
def test_a_lattice_with_fewer_periods_than_dimensions(cell, sites, like):
    # the last coordinates of a site are lengths across the periods; rows and layers may lie anywhere
    lattice, named = gp.Lattice("mine", cell, sites), LATTICES[like]
    assert (lattice.periods, lattice.dimension) == (named.periods, len(cell[0]))
    for name in ("coordination", "measure_per_ball", "pressure_factor"):
        assert getattr(lattice, name) == pytest.approx(getattr(named, name), rel=1e-15)
    one, other = (gp.ContactLattice.of(at, 0.8, torsion=0.1, bending=0.2, motions=ALL) for at in (lattice, named))
    q = np.array([[0.3, -0.7]])[:, : lattice.periods]
    found, expected = one.frequencies(q)[0], other.frequencies(q)[0]
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
        (np.diag([1.0, 2.0, 4.0]), ((0, 0, 0), (0, 0.5, 0), (0, 0, 0.5)), "pieces, 2 in each cell"),
    ],
)  # fmt: skip
def test_balls_that_contacts_do_not_join_are_no_lattice(cell, sites, said):
    with pytest.raises(InputError, match=f"'apart' falls into pieces that do not touch: {said}") as caught:
        gp.Lattice("apart", cell, sites)
    assert "apart, where" not in str(caught.value)  # no two balls nearly touch


#: the edges of a cube of three spacings: its corner, and two balls on each edge
FRAME = np.array([(0, 0, 0), (1, 0, 0), (2, 0, 0), (0, 1, 0), (0, 2, 0), (0, 0, 1), (0, 0, 2)], float)


def test_frames_inside_each_other_are_counted():
    assert gp.Lattice("frame", 3.0 * np.eye(3), FRAME / 3.0).coordination == 18 / 7
    with pytest.raises(InputError, match="do not touch: 2 networks"):
        gp.Lattice("frames", 3.0 * np.eye(3), np.concatenate([FRAME, FRAME + 1.5]) / 3.0)
    # the same two frames in a primitive cell, whose steps lead from one to the other
    cell = 1.5 * np.array([(-1, 1, 1), (1, -1, 1), (1, 1, -1)])
    with pytest.raises(InputError, match="do not touch: 2 networks"):
        gp.Lattice("frames", cell, FRAME @ np.linalg.inv(cell))


@given(st.sampled_from(["honeycomb", "hcp", "diamond"]), st.lists(st.integers(-1, 1), min_size=9, max_size=9))
def test_a_cell_of_any_vectors_holds_what_hangs_together(name, numbers):
    # a cell of other vectors of the same lattice, and sites moved by whole cells, have the same contacts
    named = LATTICES[name]
    p = named.periods
    moves = np.reshape(numbers[: p * p], (p, p))
    lower, upper = np.tril(moves, -1) + np.eye(p), np.triu(moves, 1) + np.eye(p)
    steps = lower @ upper
    sites = np.array(named.sites) @ np.linalg.inv(steps) + np.arange(named.n_balls)[:, None] * np.diag(moves)
    assert len(gp.Lattice("mine", steps @ named.vectors, sites).contacts) == len(named.contacts)


HEXAGON = ((1.0, 0.0), (-0.5, ROOT3 / 2))


@pytest.mark.parametrize(
    ("cell", "sites", "what", "mend"),
    [
        (((1, 0), (-0.5, 0.8661)), ((),), "nearly touch", "every y .* by 0.9999.*, so that 0.8661 becomes 0.8660254"),
        (((1, 0), (-0.5, 0.866)), ((),), "overlap", "so that 0.866 becomes 0.866025403784"),
        ((*[(*v, 0) for v in HEXAGON], (0, 0, 1.633)), LATTICES["hcp"].sites, "nearly touch", "1.633 becomes 1.63299316186"),
        ((*[(*v, 0) for v in HEXAGON], (0, 0, 1.64)), LATTICES["hcp"].sites, "layers, 2 in", "1.64 becomes 1.63299316186"),
        ((*[(*v, 0) for v in HEXAGON], (0, 0, 1.63)), LATTICES["hcp"].sites, "overlap", "1.63 becomes 1.63299316186"),
        (0.7072 * np.array(LATTICES["fcc"].cell) * math.sqrt(2), ((),), "touches no other", "the cell by 0.99986818"),
        (0.7071 * np.array(LATTICES["fcc"].cell) * math.sqrt(2), ((),), "overlap", "Multiply the cell by 1.00000959"),
        (((1.0001,),), ((),), "touches no other", "Multiply the cell by 0.9999000"),
        (((1.732, 0), (-0.866, 1.5)), LATTICES["honeycomb"].sites, "overlap", "1.732 becomes 1.73205080757"),
        (((1.732, 0), (-0.866, 1.5)), ((0.3333, 0.6667), (0.6667, 0.3333)), "overlap", "with eight digits"),
        (((1.7322, 0), (-0.8661, 1.5001)), LATTICES["honeycomb"].sites, "touches no other", "with eight digits"),
    ],
)  # fmt: skip
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
        told = re.search(r"Multiply (every ([xyz]) of )?the cell by ([0-9.]+)[,.;]", str(caught.value))
        assert told[2] in (None, "xyz"[axis])
        cell[:, slice(None) if told[2] is None else axis] *= float(told[3])
        assert len(gp.Lattice("mended", cell, named.sites).contacts) == len(named.contacts)


@pytest.mark.parametrize("gap", [0.0012, 0.004, 0.5])
def test_a_gap_that_no_load_closes_is_allowed(gap):
    # a rhomb of contacts, a little less pointed than that of the triangular lattice: balls across it do not touch
    angle = 2.0 * math.asin(0.5 * (1.0 + gap))
    assert gp.Lattice("rhombic", ((1, 0), (math.cos(angle), math.sin(angle)))).coordination == 4


@pytest.mark.parametrize("far", [1.1e6, 1e154, 1e300, -1e308])
def test_huge_cells_and_sites_are_one_clear_error(far):
    for cell, sites in (
        (((far,),), ((),)), (((1, 0), (0, far)), ((),)), (((1, 0), (far, 1)), ((),)), (np.eye(3), ((far, 0, 0),)),
        (((1, 0),), ((0, far),)),
    ):  # fmt: skip
        with pytest.raises(InputError, match=r"'huge' has a number of size .*Give numbers up to 1e\+06"):
            gp.Lattice("huge", cell, sites)


def test_cells_that_are_too_oblique_are_not_searched():
    for cell, sites in ((((1, 0), (1e6, 1)), ((),)), (np.eye(3), ((0, 0, 0), (1e4, 0, 0.5)))):
        with pytest.raises(InputError, match="too oblique, or its sites are too far from each other"):
            gp.Lattice("odd", cell, sites)
    assert gp.Lattice("oblique", ((1, 0), (30, 1))).coordination == 4


@pytest.mark.parametrize(
    ("cell", "sites"),
    [
        (((1.2, 0),), ((0, 0.4), (0.5, -0.4))),  # zigzag
        (((1.0, 0),), ((0, ROOT3 / 4), (0.5, -ROOT3 / 4))),  # strip of triangles
        (((1.0, 0),), ((0, 0), (0, 1))),  # ladder
        (((1, 0, 0), (0, 1, 0)), ((0, 0, 0), (0.5, 0.5, 1 / ROOT2))),  # two square layers
        (((1, 0, 0), (-0.5, ROOT3 / 2, 0)), ((0, 0, 0), (1 / 3, 2 / 3, math.sqrt(2 / 3)))),  # two triangular layers
    ],
)
def test_nothing_presses_on_balls_across_the_periods(cell, sites):
    # the outermost ball has contacts to one side only, so that equal forces leave a layer flat and a row straight
    with pytest.raises(InputError, match="not in equilibrium") as caught:
        gp.Lattice("bent", cell, sites)
    assert "'bent'" in str(caught.value)


@given(height=st.floats(0.05, 0.85), steps=st.integers(1, 3), turn=st.floats(0, 6.3))
def test_no_bent_lattice_is_in_equilibrium(height, steps, turn):
    # rows that wind about x: contacts with a part across it pull every ball towards the axis
    radius, along = 0.5 * height / math.sin(math.pi / (steps + 1)), math.sqrt(1 - height**2)
    n = steps + 1
    angles = turn + 2 * math.pi / n * np.arange(n)
    sites = np.column_stack([np.arange(n) / n, radius * np.cos(angles), radius * np.sin(angles)])
    with pytest.raises(InputError, match="not in equilibrium"):
        gp.Lattice("helix", ((n * along, 0, 0),), sites)


@pytest.mark.parametrize(
    ("cell", "sites", "text"),
    [
        (np.eye(4), ((0,) * 4,), "one to three vectors"),
        (np.eye(3)[:, :2], ((),), "one to three vectors"),
        ((1.0, 0.0, 0.0), ((),), "one to three vectors"),
        ((), ((),), "one to three vectors"),
        (np.eye(3), ((0.5, 0.5),), "as many fractions"),
        (np.eye(3), ((0.0, 0.0, 0.0), (0.5, 0.5)), "as many fractions"),
        (np.eye(3), (0.0, 0.0, 0.0), "as many fractions"),
        (((1, 0, 0),), ((0.0, 0.0),), "as many fractions"),
        (((1, 0, 0), (0, 1, 0.1)), ((),), "xy plane"),
        (((0.8, 0.6),), ((),), "along x"),
        (((0, 0, 1),), ((),), "along x"),
        (np.diag([1, 1, 0.05]), ((),), "too small"),
        (((1, 0, 0), (0, 1, 0), (1, 1, 0)), ((),), "too small"),
        (((0.0,),), ((),), "too small"),
        (((0.9,),), ((),), "overlap"),
        (np.eye(3), ((0, 0, 0), (0.5, 0.5, 0.5)), "overlap"),
        (np.eye(3), ((0, 0, 0), (0, 0, 0)), "overlap"),
        (1.01 * np.eye(3), ((),), "touches no other"),
        (np.diag([1, 1, math.inf]), ((),), "not finite"),
        (((1, 0, 0),), ((0, math.nan, 0),), "not finite"),
        (np.diag([1.0, 1.0, 2.0]), ((0, 0, 0), (0, 0, 0.5), (0.5, 0.5, 0.25)), "overlap"),
        ("fcc", ((),), "one to three vectors"),
        (np.eye(3) * 1j, ((),), "one to three vectors"),
        (None, ((),), "one to three vectors"),
    ],
)  # fmt: skip
def test_lattices_that_cannot_be(cell, sites, text):
    with pytest.raises(InputError, match=text) as caught:
        gp.Lattice("odd", cell, sites)
    assert "odd" in str(caught.value)
    assert "\n" not in str(caught.value)


def test_sites_may_be_an_array():
    sites = [[0.0, 0.0], [0.5, 0.5]]
    cell = ((1, 0), (0, ROOT3))
    assert gp.Lattice("centred", np.array(cell), np.array(sites)) == gp.Lattice("centred", cell, sites)
    assert gp.Lattice("square", np.eye(2), np.zeros((1, 2))) == gp.Lattice("square", np.eye(2))


def test_a_name_is_a_text():
    with pytest.raises(InputError, match="name of a lattice"):
        gp.Lattice(7, np.eye(3))


def test_a_stress_that_is_no_pressure_in_space():
    # a leaning cube: its three pairs of contacts are not perpendicular to each other
    leaning = gp.Lattice("leaning", ((1, 0, 0), (0.3, math.sqrt(0.91), 0), (0, 0, 1)))
    medium = gp.AveragedLattice(gp.Packing(gp.Material(211.65e9, 0.276, 7840.0), 8e-3, lattice=leaning))
    with pytest.raises(InputError, match=r"not a pressure.*f/d\^2.*force or overlap"):
        medium.at_pressure(1e4)
    assert medium.at_force(1.0).normal_stiffness > 0


# -- motions and packings -----------------------------------------------------------------------------------------------

WORDS = {1: ["longitudinal", "in_plane", "out_of_plane", "all"], 2: ["in_plane", "out_of_plane", "all"], 3: ["all"]}
#: translations and rotations of a ball
COUNTS = {"longitudinal": (1, 0), "in_plane": (2, 1), "out_of_plane": (1, 2), "all": (3, 3)}


@pytest.mark.parametrize("name", NAMED)
def test_motions_that_a_lattice_has(steel, name):
    words = WORDS[LATTICES[name].dimension]
    assert list(allowed_motions(LATTICES[name].dimension)) == words
    assert (
        gp.Packing(steel, 8e-3, lattice=name).ball_motions
        == gp.Packing(steel, 8e-3, lattice=name, motions=words[0]).ball_motions
    )
    for word in words:
        moving = gp.Packing(steel, 8e-3, lattice=name, motions=word).ball_motions
        translations, rotations = COUNTS[word]
        assert (moving.name, len(moving.translations), len(moving.rotations)) == (word, translations, rotations)
        smooth = gp.Packing(steel, 8e-3, lattice=name, motions=word, friction=False).ball_motions
        assert (len(smooth.translations), smooth.rotations) == (translations, ())
    for word in set(COUNTS) - set(words):
        with pytest.raises(InputError, match=f"{name} lattice has no motions '{word}'.*Use {', '.join(words)}"):
            gp.Packing(steel, 8e-3, lattice=name, motions=word)


@pytest.mark.parametrize(
    ("motions", "torsion", "bending", "rotations"),
    [
        ("all", 0.1, 0.0, (0, 1, 2)), ("all", 0.0, 0.1, (0, 1, 2)), ("all", "mindlin", 0.0, (0, 1, 2)),
        ("in_plane", 0.0, 0.1, (2,)), ("out_of_plane", 0.1, 0.0, (0, 1)), ("all", 0.0, 0.0, ()),
    ],
)  # fmt: skip
def test_what_resists_rotations_without_friction(steel, motions, torsion, bending, rotations):
    packing = gp.Packing(steel, 8e-3, lattice="chain", friction=False, motions=motions, torsion=torsion, bending=bending)
    assert packing.ball_motions.rotations == rotations


@pytest.mark.parametrize(
    ("change", "text"),
    [
        ({"motions": "sideways"}, "no motions 'sideways'"),
        ({"motions": "All"}, "no motions 'All'"),
        ({"motions": ""}, "no motions ''"),
        ({"motions": 6}, "no motions 6"),
        ({"motions": ["all"]}, "no motions"),
        ({"torsion": -1e-9}, "torsion"),
        ({"torsion": math.nan}, "torsion"),
        ({"torsion": math.inf}, "torsion"),
        ({"torsion": "Mindlin"}, "torsion is 'Mindlin'.*mindlin"),
        ({"torsion": None}, "torsion"),
        ({"torsion": [0.1, 0.2]}, "torsion"),
        ({"bending": -1.0}, "bending"),
        ({"bending": math.nan}, "bending"),
        ({"bending": "mindlin"}, "bending"),
        ({"lattice": "chain", "torsion": 0.1}, "torsion without rotations.*'longitudinal'.*motions out_of_plane, all, or"),
        (
            {"lattice": "chain", "bending": 0.1},
            "bending without rotations.*motions in_plane, out_of_plane, all, or leave it",
        ),
        ({"lattice": "chain", "motions": "in_plane", "torsion": 0.1}, "torsion without rotations about the normals"),
        (
            {"lattice": "kagome", "torsion": "mindlin"},
            "torsion without rotations about .*'in_plane'.* out_of_plane, all, or",
        ),
        ({"lattice": "square", "torsion": 0.1, "bending": 0.1}, "^torsion without.* motions out_of_plane, all, or leave it"),
        ({"lattice": "chain", "torsion": "mindlin"}, "torsion without rotations"),
        (
            {"lattice": "chain", "motions": "longitudinal", "torsion": 0.1, "bending": 0.2},
            "torsion and bending without .*leave both",
        ),
    ],
)
def test_packings_that_cannot_be(steel, change, text):
    with pytest.raises(InputError, match=text) as caught:
        gp.Packing(**({"material": steel, "diameter": 8e-3, "lattice": "fcc"} | change))
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize("motions", [LONGITUDINAL, IN_PLANE, OUT_OF_PLANE, ALL])
def test_rotations_are_those_that_something_resists(motions):
    # shear and bending resist all, torsion those that turn about some normal: none in the plane
    assert select_motions(0.0, among=motions).rotations == ()
    assert select_motions(0.1, among=motions) == motions
    assert select_motions(0.0, 0.0, 0.1, motions) == motions
    assert select_motions(0.0, 0.1, 0.0, motions).rotate is (motions.rotate and motions is not IN_PLANE)


# -- torsion of a Hertz contact -----------------------------------------------------------------------------------------


def turned_surface(x, y, poisson_ratio, nodes=64):
    """Displacement at (x, y) of a half-space, G = 1, under tractions (-y, x) (4/pi)/sqrt(1 - x^2 - y^2) on the unit circle.

    Cerruti: a force Q at distance s along e moves the surface by [(1 - nu) Q + nu e (e.Q)]/(2 pi G s) (K. L. Johnson,
    Contact Mechanics, 1985, section 3.6). Along a line through the point, which leaves the circle at s1 and s2, the root is
    that of (s2 - s)(s - s1), and s cancels: Gauss and Chebyshev's rule is exact.
    """
    total = np.zeros(2)
    for angle in (np.arange(nodes) + 0.5) * math.pi / nodes:
        e = np.array([math.cos(angle), math.sin(angle)])
        middle, root = -(x * e[0] + y * e[1]), math.sqrt(1 - (x * e[1] - y * e[0]) ** 2)
        for s in middle + root * np.cos(np.array([1, 3, 5]) * math.pi / 6):
            force = 4 / math.pi * np.array([-(y + s * e[1]), x + s * e[0]])
            total += math.pi / 3 * ((1 - poisson_ratio) * force + poisson_ratio * e * (e @ force))
    return total * (math.pi / nodes) / (2 * math.pi)


@pytest.mark.claim("mindlin-torsion")
def test_torsion_of_a_bonded_circle():
    # Mindlin's traction turns the circle as one piece by the angle 1, whatever Poisson's ratio; its torque is 16/3 G r^3.
    # Two balls turn by half the relative angle each: k_t = 8/3 G r^3
    for poisson_ratio in (0.0, 0.276, 0.5):
        for x, y in ((0.0, 0.0), (0.3, 0.4), (0.1, -0.8), (0.95, 0.0)):
            assert_allclose(turned_surface(x, y, poisson_ratio), [-y, x], atol=1e-14)
    with mpmath.workdps(30):
        torque = mpmath.quad(lambda r: 2 * mpmath.pi * r**3 * 4 / mpmath.pi / mpmath.sqrt(1 - r**2), [0, 1])
    assert float(torque) == pytest.approx(16 / 3, rel=1e-9)


@pytest.mark.claim("mindlin-torsion")
@given(
    load=st.floats(-12, 3),
    diameter=st.floats(-6, 1),
    poisson_ratio=st.floats(-0.9, 0.5),
    name=st.sampled_from(["chain", "triangular", "fcc"]),
)
def test_torsion_of_a_hertz_contact_at_any_load(load, diameter, poisson_ratio, name):
    young, d = 70e9, 10.0**diameter
    packing = gp.Packing(gp.Material(young, poisson_ratio, 2500.0), d, lattice=name, motions="all", torsion="mindlin")
    force = 10.0**load * young * d**2 * 1e-8
    state = gp.AveragedLattice(packing).at_force(force)
    # Hertz: r^3 = 3 f R/(4 E*), R = d/4, E* = E/2(1 - nu^2), delta = r^2/R, k = 2 E* r
    modulus, shear = young / (2 * (1 - poisson_ratio**2)), young / (2 * (1 + poisson_ratio))
    radius = (3 * force * d / (16 * modulus)) ** (1 / 3)
    assert state.torsion_stiffness == pytest.approx(8 / 3 * shear * radius**3, rel=1e-12)
    assert state.normal_stiffness == pytest.approx(2 * modulus * radius, rel=1e-12)
    assert state.torsion == pytest.approx((1 - poisson_ratio) / 3 * 4 * radius**2 / d**2, rel=1e-12)
    assert state.torsion == pytest.approx((1 - poisson_ratio) / 3 * state.overlap / d, rel=1e-12)


def test_torsion_has_the_shape_of_the_load(steel):
    packing = gp.Packing(steel, 8e-3, lattice="fcc", torsion="mindlin")
    states = gp.AveragedLattice(packing).at_force(np.array([[1.0, 8.0], [27.0, 64.0]]))
    assert states.torsion.shape == (2, 2)
    # overlap goes as f^(2/3)
    assert_allclose(states.torsion / states.torsion[0, 0], [[1, 4], [9, 16]], rtol=1e-13)
    fixed = gp.AveragedLattice(gp.Packing(steel, 8e-3, lattice="fcc", torsion=0.1, bending=0.2)).at_force(
        np.array([1.0, 8.0])
    )
    assert_allclose(fixed.torsion, 0.1, rtol=0)
    assert_allclose(fixed.torsion_stiffness, 0.1 * fixed.normal_stiffness * 8e-3**2, rtol=1e-15)
    assert_allclose(fixed.bending_stiffness, 0.2 * fixed.normal_stiffness * 8e-3**2, rtol=1e-15)


@pytest.mark.parametrize("more", [{"motions": "all"}, {"motions": "out_of_plane"}])
def test_what_a_simulation_does_not_know_is_refused(steel, more):
    with pytest.raises(InputError, match="are not simulated"):
        gp.DirectSimulation(gp.Packing(steel, 8e-3, **more))


@pytest.mark.parametrize("lattice", ["chain", "triangular"])
def test_motions_that_deform_no_contact_have_bands_at_zero(steel, lattice):
    packing = gp.Packing(steel, 8e-3, lattice=lattice, motions="out_of_plane", friction=False)
    ph = gp.Phonons(gp.AveragedLattice(packing).at_force(18.0))
    bands = ph.bands(npoints=3)
    assert not np.any(bands.frequencies)
    assert any("branches vanishes at every wave vector" in one for one in bands.warnings)
    assert not np.any(ph.calculator.get_force_constants(ph.atoms))
    with pytest.raises(InputError, match="every branch vanishes"):
        ph.dos()


@pytest.mark.parametrize("name", ["torsion", "bending"])
def test_a_stiffness_beyond_all_contacts_is_refused(steel, name):
    with pytest.raises(InputError, match=f"{name} is 1e.*300"):
        gp.Packing(steel, 8e-3, lattice="fcc", **{name: 1e300})
