"""Motions as data, and the rows of deformations that everything linear is made of, against vectors
in space.
"""

from __future__ import annotations

import dataclasses
import itertools
import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from numpy.testing import assert_allclose

from granphon.balls.lattices import KAGOME, TRIANGULAR
from granphon.balls.motions import ALL, IN_PLANE, LONGITUDINAL, OUT_OF_PLANE, select_motions
from granphon.balls.neighbours import find_contacts
from granphon.dynamics.compatibility import Compatibility
from granphon.dynamics.contact_lattice import ContactLattice
from granphon.dynamics.deformation_rows import bend, contact_rows, push_rows
from granphon.phonons.calculator import contact_blocks

#: motions in the plane where nothing resists rotation: u_x, u_y
STILL = dataclasses.replace(IN_PLANE, rotations=())
FCC = np.array([[0.0, 1.0, 1.0], [1.0, 0.0, 1.0], [1.0, 1.0, 0.0]]) / math.sqrt(2.0)
#: stiffness over that of elongation
SLIP = 0.8
TWIST = 0.07
ROLL = 0.03
RATIOS = {"elongation": 1.0, "slip": SLIP, "twist": TWIST, "roll": ROLL}


# -- the twin: vectors in space, no tangents, no rows ----------------------------------------------


def deform(n, arm_i, arm_j, u_i, phi_i, u_j, phi_j):
    """Elongation, slip, twist and roll of one contact, the second and the last as vectors."""
    across = np.eye(3) - np.outer(n, n)
    slip = across @ (u_j - u_i) - np.cross(arm_i * phi_i + arm_j * phi_j, n)
    return {
        "elongation": (u_j - u_i) @ n,
        "slip": slip,
        "twist": (phi_j - phi_i) @ n,
        "roll": across @ (phi_j - phi_i),
    }


def lattice_of(name, motions=ALL, rough=False):
    """A lattice with all kinds of stiffness; ``rough``: balls, contacts and static forces that
    differ.
    """
    if name == "fcc":
        cell = FCC
        positions = np.zeros((1, 3))
        table = find_contacts(cell, positions, name)
    elif name == "fcc, cubic":
        cell = math.sqrt(2.0) * np.eye(3)
        positions = np.array([[0, 0, 0], [0, 1, 1], [1, 0, 1], [1, 1, 0]]) / math.sqrt(2.0)
        table = find_contacts(cell, positions, name)
    else:
        structure = {"triangular": TRIANGULAR, "kagome": KAGOME}[name]
        cell = structure.vectors
        positions = structure.positions
        table = structure.contacts
    given = {}
    if rough:
        rng = np.random.default_rng(5)
        given = {
            "stiffness": rng.uniform(0.5, 1.5, len(table)),
            "prestress": rng.uniform(-0.05, 0.05, len(table)),
            "masses": rng.uniform(0.5, 1.5, len(positions)),
            "gyration": rng.uniform(0.2, 0.4, len(positions)),
        }
    return ContactLattice(
        cell, positions, table, SLIP, **given, torsion=TWIST, bending=ROLL, motions=motions
    )


# -- motions ---------------------------------------------------------------------------------------


def test_motions_know_their_names_and_places():
    assert IN_PLANE.letters == ("x", "y", "w")
    assert OUT_OF_PLANE.letters == ("z", "w_x", "w_y")
    assert [motions.count for motions in (LONGITUDINAL, STILL, IN_PLANE, OUT_OF_PLANE, ALL)] == [
        1,
        2,
        3,
        3,
        6,
    ]
    # one phonopy atom holds three motions, two hold six
    assert [motions.slots for motions in (LONGITUDINAL, IN_PLANE, OUT_OF_PLANE)] == [
        (0,),
        (0, 1, 2),
        (2, 0, 1),
    ]
    assert (ALL.slots, ALL.atoms_per_ball, OUT_OF_PLANE.atoms_per_ball) == (
        (0, 1, 2, 3, 4, 5),
        2,
        1,
    )
    assert_allclose(OUT_OF_PLANE.phases, [1.0, 1.0j, 1.0j], rtol=0)
    assert np.arange(6)[ALL.turning].tolist() == [3, 4, 5]


@pytest.mark.parametrize("motions", [IN_PLANE, OUT_OF_PLANE, ALL])
def test_balls_turn_only_if_something_resists(motions):
    still = select_motions(0.0, among=motions)
    assert still.translations == motions.translations
    assert not still.rotate
    assert still.count == len(motions.translations)
    for resisted in ((0.8,), (0.0, 0.0, 0.1), (np.array([0.0, 0.8]),)):
        assert select_motions(*resisted, among=motions) is motions
    assert select_motions(0.0) == STILL


def test_torsion_alone_resists_no_rotation_about_the_normal_of_a_plane():
    assert select_motions(0.0, 0.1) == STILL
    for among in (OUT_OF_PLANE, ALL):
        assert select_motions(0.0, 0.1, among=among) is among
    given = {
        "cell": TRIANGULAR.vectors,
        "positions": TRIANGULAR.positions,
        "contacts": TRIANGULAR.contacts,
    }
    lattice = ContactLattice(**given, mindlin_ratio=0.0, torsion=0.1)
    plain = ContactLattice(**given, mindlin_ratio=0.0)
    assert (lattice.motions.rotate, lattice.n_branches) == (False, 2)
    q = [[0.3, 0.1], [1.0, -2.0]]
    assert_allclose(lattice.frequencies(q), plain.frequencies(q), rtol=1e-15)


@pytest.mark.parametrize("kinds", list(itertools.product([0.0, 0.5], repeat=3)))
@pytest.mark.parametrize(
    "normal", [TRIANGULAR.contacts.normal, [[1.0, 0.0]], FCC], ids=["plane", "chain", "space"]
)
def test_rotations_are_kept_where_one_deforms_a_contact_that_resists(normal, kinds):
    normal = np.array(normal)
    arm = np.full(len(normal), 0.5)
    for among in (ALL, IN_PLANE, OUT_OF_PLANE)[: 1 if normal.shape[1] == 3 else 3]:
        rows = contact_rows(normal, arm, arm, among, slip=kinds[0], twist=kinds[1], roll=kinds[2])
        deforms = any(np.any(row.head[:, among.turning]) for row in rows)
        assert select_motions(*kinds, among=among) == (
            among if deforms else dataclasses.replace(among, rotations=())
        )


# -- one contact -----------------------------------------------------------------------------------

numbers = st.lists(st.floats(-1, 1), min_size=12, max_size=12)


@given(st.floats(0, math.pi), st.floats(0, 7), st.floats(0.1, 1), st.floats(0.1, 1), numbers)
def test_rows_are_the_deformations_of_vectors_in_space(polar, azimuth, arm_i, arm_j, x):
    n = np.array(
        [math.sin(polar) * math.cos(azimuth), math.sin(polar) * math.sin(azimuth), math.cos(polar)]
    )
    x_i, x_j = np.reshape(x, (2, 6))
    expected = deform(n, arm_i, arm_j, x_i[:3], x_i[3:], x_j[:3], x_j[3:])
    found = {kind: [] for kind in expected}
    rows = contact_rows(
        n[None], np.array([arm_i]), np.array([arm_j]), ALL, slip=SLIP, twist=TWIST, roll=ROLL
    )
    for row in rows:
        assert row.stiffness == RATIOS[row.kind]
        found[row.kind].append((row.head @ x_j - row.tail @ x_i)[0])
    assert [len(values) for values in found.values()] == [1, 2, 1, 2]
    for kind, value in expected.items():
        # the components along two orthogonal tangents have the length of the vector
        assert_allclose(np.linalg.norm(found[kind]), np.linalg.norm(value), atol=1e-13)
    assert_allclose(found["elongation"], expected["elongation"], atol=1e-13)
    assert_allclose(found["twist"], expected["twist"], atol=1e-13)
    push = [(row.head @ x_j - row.tail @ x_i)[0] for row in push_rows(n[None], ALL)]
    across = (np.eye(3) - np.outer(n, n)) @ (x_j - x_i)[:3]
    assert_allclose(np.linalg.norm(push), np.linalg.norm(across), atol=1e-13)


@given(st.lists(st.floats(-1, 1), min_size=9, max_size=9), st.floats(0.1, 1), st.floats(0.1, 1))
def test_a_rigid_motion_deforms_nothing(values, arm_i, arm_j):
    shift, omega, n = np.reshape(values, (3, 3))
    n = n / np.linalg.norm(n) if np.linalg.norm(n) > 1e-3 else np.array([0.0, 0.0, 1.0])
    # two balls turn about a point as one body: u = omega x r, phi = omega
    r_i = shift
    r_j = shift + (arm_i + arm_j) * n
    x_i, x_j = (np.concatenate([shift + np.cross(omega, r), omega]) for r in (r_i, r_j))
    for row in contact_rows(
        n[None], np.array([arm_i]), np.array([arm_j]), ALL, slip=SLIP, twist=TWIST, roll=ROLL
    ):
        assert_allclose(row.head @ x_j - row.tail @ x_i, 0.0, atol=1e-14)


def test_rows_of_the_plane_are_those_of_the_paper():
    table = TRIANGULAR.contacts.scale(0.9)
    arm_i = table.arm_i
    arm_j = 1.1 * table.arm_j
    elongation, slip = contact_rows(table.normal, arm_i, arm_j, IN_PLANE, slip=SLIP)
    none = np.zeros(len(table))
    assert_allclose(elongation.head, np.column_stack([table.normal, none]), rtol=0)
    assert_allclose(elongation.tail, elongation.head, rtol=0)
    tangent = np.column_stack([-table.normal[:, 1], table.normal[:, 0]])
    assert_allclose(slip.head, np.column_stack([tangent, -arm_j]), rtol=0)
    assert_allclose(slip.tail, np.column_stack([tangent, arm_i]), rtol=0)


@pytest.mark.parametrize(
    ("motions", "ratios", "kinds"),
    [
        (STILL, {}, ["elongation"]),
        (IN_PLANE, {"slip": SLIP, "twist": TWIST}, ["elongation", "slip"]),
        (IN_PLANE, {"slip": SLIP, "roll": ROLL}, ["elongation", "slip", "roll"]),
        (OUT_OF_PLANE, {"slip": SLIP}, ["slip"]),
        (OUT_OF_PLANE, {"slip": SLIP, "twist": TWIST, "roll": ROLL}, ["slip", "twist", "roll"]),
        (
            ALL,
            {"slip": SLIP, "twist": TWIST, "roll": ROLL},
            ["elongation", "slip", "slip", "twist", "roll", "roll"],
        ),
    ],
)
def test_what_no_motion_does_has_no_row(motions, ratios, kinds):
    table = TRIANGULAR.contacts
    assert [
        row.kind for row in contact_rows(table.normal, table.arm_i, table.arm_j, motions, **ratios)
    ] == kinds


# -- D(q) of six motions ---------------------------------------------------------------------------


def test_force_constants_of_six_motions_stand_in_two_atoms_a_ball():
    lattice = lattice_of("kagome", rough=True)
    table = lattice.contacts
    blocks = contact_blocks(lattice)
    q = np.array([0.7, -0.4])
    total = np.zeros((18, 18), complex)
    for i, j, vector, block in zip(table.i, table.j, table.vector, blocks, strict=True):
        where = np.concatenate([6 * i + np.arange(6), 6 * j + np.arange(6)])
        phase = np.repeat([1.0, np.exp(1j * (vector @ q))], 6)
        np.add.at(total, (where[:, None], where[None, :]), phase.conj()[:, None] * block * phase)
    root = np.repeat(np.sqrt(lattice.masses), 6)
    assert_allclose(total / root / root[:, None], lattice.dynamical_matrix(q[None])[0], atol=1e-13)


# -- fcc -------------------------------------------------------------------------------------------


def test_bending_keeps_its_digits_at_every_angle():
    assert_allclose(
        bend(np.array([1e-5, 1e20])), [1e-15 / 3.0, math.sin(1e20) - 1e20 * math.cos(1e20)]
    )
    angle = np.array([1.0 - 1e-12, 1.0 + 1e-12, -1.0])
    assert_allclose(bend(angle), np.sign(angle) * (math.sin(1.0) - math.cos(1.0)), rtol=1e-11)


def test_the_rows_of_a_cell_are_its_compatibility():
    # Compatibility alone, without the rest of a ContactLattice, in space
    table = find_contacts(FCC, np.zeros((1, 3)), "fcc")
    alone = Compatibility(
        FCC, np.zeros((1, 3)), table, SLIP, torsion=TWIST, bending=ROLL, motions=ALL
    )
    q = np.array([[0.3, 0.2, -0.7]])
    rows = alone.compatibility(q)
    assert rows.shape == (1, 6 * len(table), 6)
    assert np.isrealobj(rows)
    turn = np.diag(ALL.phases)
    assert_allclose(
        turn @ (rows[0].T @ rows[0]) @ turn.conj(), alone.dynamical_matrix(q)[0], atol=1e-14
    )
    h = 1e-5
    steps = [
        (alone.compatibility(q + h * e) - alone.compatibility(q - h * e))[0] / (2.0 * h)
        for e in np.eye(3)
    ]
    assert_allclose(alone.compatibility(q, derivative=True)[0], steps, atol=1e-9)
