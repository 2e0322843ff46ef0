"""Phonons through phonopy against C(q), a phonopy of finite differences, and closed forms; cells,
masses, defects.
"""

from __future__ import annotations

import itertools

import numpy as np
import pytest
from ase.build import make_supercell
from hypothesis import strategies as st
from numpy.testing import assert_allclose
from phonopy import Phonopy
from phonopy.structure.atoms import PhonopyAtoms

import granphon as gp
from granphon.balls.lattices import find_lattice
from granphon.base.errors import InputError, InstabilityError, MechanismError
from tests.phonons.conftest import (
    RESISTED,
    at_overlap,
    every_case,
    padded,
    phonons_of,
    random_points,
)

fractions = st.floats(-1.0, 1.0, allow_nan=False)
both_overlaps = pytest.mark.parametrize("finite_overlap", [False, True], ids=["limit", "finite"])
# the frictionless square and kagome lattices are mechanisms
LATTICES = [("triangular", True), ("triangular", False), ("square", True), ("kagome", True)]
every_lattice = pytest.mark.parametrize(("lattice", "friction"), LATTICES)


# -- against C(q) and other engines ----------------------------------------------------------------


@pytest.mark.parametrize("relative", [1e-20, 1e-12, 1e-6])
@both_overlaps
def test_bands_are_exact_at_any_load(relative, finite_overlap):
    # in units of (k/M)^1/2 nothing depends on the load but the terms of order delta/d
    q = [[0.123, 0.271], [1 / 3, 1 / 3], [0.5, 0.0], [1e-7, 2e-7]]
    state = at_overlap(relative, finite_overlap=finite_overlap)
    plain = at_overlap()
    found = gp.Phonons(state).frequencies(q) / state.scales.frequency
    expected = gp.Phonons(plain).frequencies(q) / plain.scales.frequency
    np.testing.assert_allclose(
        found, expected, rtol=1e-13 + (3.0 * relative if finite_overlap else 0.0)
    )


@pytest.mark.claim("bands-and-group-velocities")
@every_lattice
@both_overlaps
def test_a_phonopy_of_finite_differences_agrees(lattice, friction, finite_overlap):
    # nothing of ours but forces and torques: cell, masses, differences and dynamical matrix are
    # phonopy's
    state = at_overlap(0.02, lattice=lattice, friction=friction, finite_overlap=finite_overlap)
    one = gp.atoms(state)
    calc = gp.HertzMindlin(state)
    cell = PhonopyAtoms(
        symbols=["Fe"] * len(one),
        cell=np.asarray(one.cell),
        scaled_positions=one.get_scaled_positions(),
        masses=one.get_masses(),
    )
    bare = Phonopy(cell, np.diag([3, 3, 1]), primitive_matrix="P", is_symmetry=False)
    bare.unit_conversion_factor = 1.0
    big = gp.atoms(state)[[0] * len(bare.supercell)]
    big.set_cell(bare.supercell.cell)
    big.positions = bare.supercell.positions
    radius = 1.0 / np.sqrt(10.0)

    def differences(step):
        out = np.zeros((len(one), len(big), 3, 3))
        for row, ball in enumerate(bare.primitive.p2s_map):
            for axis in range(3):
                for sign in (1.0, -1.0):
                    other = big.copy()
                    if axis < 2:
                        other.positions[ball, axis] += sign * step
                    else:
                        other.arrays["rotations"][ball] += sign * step / radius
                    pull = calc.get_property("forces", other).copy()
                    pull[:, 2] = calc.get_torques(other) / radius
                    out[row, :, axis] -= sign * pull / (2.0 * step)
        return out

    bare.force_constants = (4.0 * differences(5e-4) - differences(1e-3)) / 3.0
    q = np.array([[0.11, 0.23, 0.0], [1 / 3, 1 / 3, 0.0], [0.5, 0.0, 0.0], [-0.41, 0.37, 0.0]])
    found = np.sort(bare.run_qpoints(q).frequencies, axis=1)
    expected = gp.Phonons(state).frequencies(q) / state.scales.frequency
    if not friction:
        np.testing.assert_allclose(found[:, : len(one)], 0.0, atol=1e-6)
        found = found[:, len(one) :]
    np.testing.assert_allclose(found, expected, rtol=1e-7)


@every_case
def test_phonopys_object_has_the_same_frequencies(lattice, motions, options):
    ph = phonons_of(lattice, motions, **options)
    q = random_points(ph)
    ours = (ph.frequencies(q) / ph.scales.frequency) ** 2
    theirs = ph.phonopy.run_qpoints(padded(q)).frequencies
    theirs = np.sort(theirs * np.abs(theirs), axis=1)
    # coordinates that hold no motion are flat bands at zero
    still = len(ph.atoms) * len(ph.lattice.motions.still_slots)
    assert len(ph.phonopy.unitcell) == len(ph.atoms) * ph.lattice.motions.atoms_per_ball
    np.testing.assert_allclose(
        theirs, np.sort(np.pad(ours, ((0, 0), (still, 0))), axis=1), atol=1e-13 * ours.max()
    )


# -- other cells of the same balls -----------------------------------------------------------------


def test_atoms_are_taken_as_a_copy():
    state = at_overlap()
    balls = gp.atoms(state).repeat((2, 1, 1))
    ph = gp.Phonons(state, balls)
    before = ph.frequencies([[0.1, 0.2]])
    balls.set_masses([5.0, 5.0])
    balls.positions += 1.0
    np.testing.assert_array_equal(ph.frequencies([[0.1, 0.2]]), before)


# -- what is refused -------------------------------------------------------------------------------


def test_dim():
    state = at_overlap()
    assert gp.Phonons(state).dim == (3, 3)
    assert gp.Phonons(state, gp.atoms(state).repeat((3, 3, 1))).dim == (1, 1)
    assert gp.Phonons(state, gp.atoms(state).repeat((1, 5, 1))).dim == (3, 1)
    assert gp.Phonons(at_overlap(lattice="kagome")).dim == (2, 2)
    q = [[0.123, 0.271]]
    np.testing.assert_allclose(
        gp.Phonons(state, dim=(5, 4)).frequencies(q),
        gp.Phonons(state, dim=(3, 3, 1)).frequencies(q),
        rtol=1e-13,
    )
    for small in ((2, 2), (1, 1), (2, 3), (3, 2, 1)):
        with pytest.raises(InputError, match=r"too small.* 3 x 3"):
            gp.Phonons(state, dim=small)
    for wrong in ((3, 3, 2), (3.5, 3), (0, 3), (3,), "33"):
        with pytest.raises(InputError, match="two whole numbers"):
            gp.Phonons(state, dim=wrong)


@pytest.mark.parametrize("lattice", ["square", "kagome", "honeycomb"])
def test_mechanisms_have_bands_and_no_sound(lattice):
    state = at_overlap(friction=False, lattice=lattice)
    ph = gp.Phonons(state)
    q = np.random.default_rng(3).uniform(-0.5, 0.5, (8, 3)) * [1.0, 1.0, 0.0]
    found = ph.frequencies(q) / ph.scales.frequency
    np.testing.assert_allclose(
        found,
        np.sort(np.abs(ph.phonopy.run_qpoints(q).frequencies[:, -found.shape[1] :]), axis=1),
        atol=1e-7,
    )
    for find in (gp.sound_velocities, gp.moduli):
        with pytest.raises(MechanismError, match=f"the lattice {lattice} is a mechanism"):
            find(state, *[(1.0, 0.0)] * (find is gp.sound_velocities))


def test_a_buckled_state_is_an_error():
    # compressed so far that the prestress of finite overlap wins
    state = at_overlap(0.9, friction=False, finite_overlap=True)
    ph = gp.Phonons(state)
    with pytest.raises(
        InstabilityError,
        match=r"buckles.* q = \(0\.5, 0\)",
    ) as told:
        ph.frequencies([[0.1, 0.0], [0.5, 0.0], [0.2, 0.0]])
    assert "push the balls sideways" in str(told.value)
    with pytest.raises(InstabilityError, match=r"q = \(0\.5, 0\) .*negative"):
        ph.bands([[0.4, 0.0, 0.0], [0.5, 0.0, 0.0]], npoints=2)


@pytest.mark.parametrize(
    "q",
    [
        [0.1, 0.2],
        [[0.1]],
        [[0.1, 0.2, 0.3, 0.4]],
        [[np.nan, 0.0]],
        [[0.0, np.inf]],
        [[0.1, 0.2, 0.3]],
        None,
    ],
)
def test_q_points_that_cannot_be(q):
    with pytest.raises(
        InputError,
        match=r"\(n, 2\) or \(n, 3\)|not finite|leaves the plane|a real number",
    ):
        gp.Phonons(at_overlap()).frequencies(q)


def test_modes_in_si_units():
    state = at_overlap()
    ph = gp.Phonons(state)
    q = [[0.1, 0.2], [0.3, -0.1]]
    modes = ph.modes(q)
    assert modes.units["frequencies"] == "Hz"
    np.testing.assert_allclose(modes.frequencies, ph.frequencies(q), rtol=1e-12)
    np.testing.assert_allclose(
        modes.rotational_fraction + modes.longitudinal_fraction + modes.transverse_fraction,
        1.0,
        rtol=1e-12,
    )
    with pytest.raises(InputError, match="need a direction"):
        ph.modes([[0.0, 0.0]])


@every_lattice
def test_group_velocities_are_phonopys(lattice, friction):
    # phonopy takes frequencies for ordinary ones and multiplies by 2 pi: ours are angular in
    # reduced units
    state = at_overlap(lattice=lattice, friction=friction)
    ph = gp.Phonons(state)
    q = np.array([[0.123, 0.271, 0.0], [0.31, -0.12, 0.0], [-0.44, 0.05, 0.0]])
    theirs = ph.phonopy.run_qpoints(q, with_group_velocities=True).group_velocities / (2.0 * np.pi)
    ours = ph.modes(q).group_velocities / state.scales.velocity
    n = 0 if friction else len(ph.atoms)
    np.testing.assert_allclose(ours, theirs[:, n:, :2], atol=1e-6)
    np.testing.assert_allclose(theirs[..., 2], 0.0, atol=1e-12)


@pytest.mark.parametrize("friction", [True, False])
def test_where_the_balls_sit_changes_phases_and_nothing_else(friction):
    """Force constants come from the state: rattled balls and a strained cell have the frequencies
    of the lattice.
    """
    state = at_overlap(friction=friction)
    balls = gp.atoms(state).repeat((3, 4, 1))
    expected = gp.Phonons(state, balls).frequencies(QS := np.random.default_rng(4).random((6, 2)))
    rattled = balls.copy()
    strained = balls.copy()
    rattled.positions[:, :2] += 0.02 * np.random.default_rng(5).normal(size=(12, 2))
    strained.set_cell(np.asarray(balls.cell) * [[1.01], [0.985], [1.0]], scale_atoms=True)
    for cell in (rattled, strained):
        ph = gp.Phonons(state, cell)
        np.testing.assert_allclose(ph.frequencies(QS), expected, rtol=1e-12)
        direct = ph.lattice.frequencies(ph.lattice.wavevectors(QS)) * ph.scales.frequency
        np.testing.assert_allclose(direct, expected, rtol=1e-12)


@pytest.mark.parametrize(
    ("repeat", "pbc"),
    [((1, 2, 1), (True, False, False)), ((1, 1, 1), (True, False, False)), ((2, 2, 1), False)],
)
def test_open_edges_have_no_images(repeat, pbc):
    """A strip or a cluster: q across an open edge changes nothing, and phonopy agrees with C(q)."""
    state = at_overlap()
    balls = gp.atoms(state).repeat(repeat)
    balls.pbc = pbc
    ph = gp.Phonons(state, balls)
    q = np.array([[0.2, 0.5], [0.2, 0.0], [0.2, 0.37]])
    values = ph.frequencies(q)
    np.testing.assert_allclose(values, ph.modes(q, (1, 0)).frequencies, atol=1e-10 * values.max())
    np.testing.assert_allclose(values[1:], values[[0, 0]], atol=1e-10 * values.max())
    with pytest.raises(InputError, match="one cell"):
        gp.Phonons(state, balls, dim=(5, 5))


def test_a_vector_across_the_plane_may_be_tilted():
    state = at_overlap()
    sheared = gp.atoms(state)
    sheared.cell[2] = [1.0, 0.5, 5.0]
    bands = gp.Phonons(state, sheared).bands("GM", 3)
    assert_allclose(bands.cell[2], [0.0, 0.0, 5.0], atol=1e-15)
    assert_allclose(bands.frequencies, gp.Phonons(state).bands("GM", 3).frequencies, rtol=1e-12)


def test_atoms_that_cannot_be():
    state = at_overlap()
    lost = gp.atoms(state)
    turned = gp.atoms(state)
    tilted = gp.atoms(state)
    lost.pbc = False
    lost.set_cell(np.zeros((3, 3)))
    with pytest.raises(InputError, match="no cell"):
        gp.Phonons(state, lost)
    for vector in ([1.0, 0.0, 0.0], [0.0, 0.0, 1e-9]):
        flat = gp.atoms(state)
        flat.cell[2] = vector
        with pytest.raises(InputError, match="flat"):
            gp.Phonons(state, flat)
    turned.rotate(30, "z", rotate_cell=True)
    with pytest.raises(InputError, match="turned"):
        gp.Phonons(state, turned)
    tilted.rotate(30, "x", rotate_cell=True)
    with pytest.raises(InputError, match="tilted"):
        tilted.get_potential_energy()
    for name in ("positions", "rotations", "diameter_deviations", "displacements"):
        sick = gp.atoms(state)
        sick.arrays[name][:] = np.nan
        with pytest.raises(InputError, match="not finite"):
            sick.get_potential_energy()
    with pytest.raises(InputError, match=r"ase\.Atoms"):
        gp.Phonons(state, "atoms")
    with pytest.raises(InputError, match="at_force"):
        gp.HertzMindlin(3.0)


def test_branches_that_touch_at_gamma_are_those_of_the_path():
    bands = gp.Phonons(at_overlap(lattice="kagome")).bands("GKMG", npoints=201)
    overlap = (
        np.abs(
            np.einsum(
                "spma,spmb->spab", bands.eigenvectors[:, :-1].conj(), bands.eigenvectors[:, 1:]
            )
        )
        ** 2
    )
    assert overlap.max(axis=3).min() > 0.99


@pytest.mark.parametrize("length", [5, 40])
def test_fewer_contacts_than_motions_leave_free_ones(length):
    """A frictionless row of balls: longitudinal waves along it, and nothing resists the motion
    across it.
    """
    state = at_overlap(friction=False)
    row = gp.atoms(state).repeat((length, 1, 1))
    row.pbc = (True, False, False)
    ph = gp.Phonons(state, row)
    folded = (0.1 + np.arange(length)) / length
    chain = (
        np.sort(np.concatenate([np.zeros(length), 2.0 * np.abs(np.sin(np.pi * folded))]))
        * ph.scales.frequency
    )
    np.testing.assert_allclose(ph.frequencies([[0.1, 0.0]])[0], chain, atol=1e-9 * chain.max())
    np.testing.assert_allclose(
        ph.modes([[0.1, 0.0]]).frequencies[0], chain, atol=1e-9 * chain.max()
    )


def test_branches_without_energy_leave_no_gap_below_all_branches():
    # without bending two branches of a chain vanish everywhere, and the third is far above them
    phonons = phonons_of("chain", "out_of_plane")
    onset = phonons.onset()
    assert_allclose(onset.frequencies[:2], 0.0, atol=0.0)
    assert phonons.cutoffs()[2, 0] > 0.0
    assert onset.gap == 0.0


@pytest.mark.parametrize(
    ("lattice", "repeat"),
    [("chain", (3, 1, 1)), ("triangular", (2, 3, 1)), ("fcc", (2, 1, 3)), ("hcp", (1, 2, 1))],
    ids=str,
)
def test_a_supercell_has_the_folded_bands(lattice, repeat):
    one = phonons_of(lattice, "all", **RESISTED)
    big = gp.Phonons(one.state, gp.atoms(one.state).repeat(repeat))
    q = random_points(one, 1)[0]
    cells = itertools.product(*map(range, repeat[: len(q)]))
    expected = np.sort(
        one.frequencies([(q + n) / repeat[: len(q)] for n in np.array(list(cells))]).ravel()
    )
    np.testing.assert_allclose(big.frequencies([q])[0], expected, atol=1e-12 * expected.max())
    theirs = big.phonopy.run_qpoints(padded(q[None])).frequencies[0]
    ours = (expected / one.scales.frequency) ** 2
    np.testing.assert_allclose(np.sort(theirs * np.abs(theirs)), ours, atol=1e-12 * ours.max())


def test_a_slab_and_a_cluster_have_no_images_across():
    whole = phonons_of("fcc")
    slab, cluster = (gp.atoms(whole.state).repeat(repeat) for repeat in ((1, 1, 3), (2, 2, 2)))
    slab.pbc = (True, True, False)
    cluster.pbc = False
    for balls, dim, q in (
        (slab, (3, 3, 1), [[0.1, 0.2, 0.0], [0.1, 0.2, 0.4]]),
        (cluster, (1, 1, 1), [[0.1, 0.2, 0.3]]),
    ):
        ph = gp.Phonons(whole.state, balls)
        assert ph.dim == dim
        ours = (ph.frequencies(q) / ph.scales.frequency) ** 2
        np.testing.assert_allclose(ours, ours[[0] * len(q)], atol=1e-12 * ours.max())
        theirs = ph.phonopy.run_qpoints(q).frequencies
        np.testing.assert_allclose(np.sort(theirs * np.abs(theirs)), ours, atol=1e-12 * ours.max())


BAD = {
    "path in space for a plane": (
        "square",
        lambda ph: ph.bands([[0, 0, 0], [0, 0, 0.5]]),
        r"leaves the plane.*one layer",
    ),
    "path in the plane for a chain": (
        "chain",
        lambda ph: ph.bands([[0, 0, 0], [0.5, 0.5, 0]]),
        r"leaves the line.*one row",
    ),
    "corners of two numbers in space": (
        "fcc",
        lambda ph: ph.bands([[0, 0], [0.5, 0]]),
        "corners of three finite numbers",
    ),
    "letter of another zone": ("chain", lambda ph: ph.bands("GM"), r"no special point M.*Use G, X"),
    "q points of two numbers in space": (
        "fcc",
        lambda ph: ph.frequencies([[0.1, 0.2]]),
        r"Give \(n, 3\) fractions",
    ),
    "q points out of a line": (
        "chain",
        lambda ph: ph.frequencies([[0.1, 0.2, 0.0]]),
        "leaves the line",
    ),
    "mesh of two numbers in space": (
        "fcc",
        lambda ph: ph.dos((8, 8)),
        r"three whole numbers from 1.*such as 64 64 64",
    ),
    "mesh in space for a plane": (
        "square",
        lambda ph: ph.dos((8, 8, 8)),
        r"third number is 8.*one layer",
    ),
    "mesh of a plane for a chain": (
        "chain",
        lambda ph: ph.dos((8, 8)),
        r"second number is 8.*one row",
    ),
    "dim of two numbers in space": (
        "fcc",
        lambda ph: gp.Phonons(ph.state, dim=(3, 3)),
        "three whole numbers",
    ),
    "dim too small": (
        "fcc",
        lambda ph: gp.Phonons(ph.state, dim=(3, 2, 3)),
        r"3 x 2 x 3 cells is too small.*3 x 3 x 3",
    ),
}


@pytest.mark.parametrize("case", BAD)
def test_what_the_dimension_does_not_allow(case):
    lattice, call, words = BAD[case]
    with pytest.raises(InputError, match=words):
        call(phonons_of(lattice))


def test_numbers_padded_with_ones():
    chain = phonons_of("chain")
    plane = phonons_of("triangular", "all")
    assert chain.dos((8, 1, 1)) == chain.dos((8,)) == chain.dos("8 1 1")
    assert plane.dos((8, 8, 1)) == plane.dos((8, 8))
    assert gp.Phonons(chain.state, dim=(4, 1, 1)).dim == (4,)
    assert gp.Phonons(plane.state, dim="4 5 1").dim == (4, 5)
    assert phonons_of("fcc").dim == (3, 3, 3)
    assert phonons_of("hcp").dim == (3, 3, 2)


def test_a_mesh_beyond_all_memory_is_refused():
    with pytest.raises(InputError, match=r"1000000 x 1000000 .*large"):
        phonons_of("fcc").dos((10**6,) * 3)


def twin(ph, q):
    """Squared frequencies from forces and torques of each neighbour, one by one, with the motions
    that the balls have.
    """
    state = ph.state
    motions = ph.lattice.motions
    packing = state.packing
    structure = find_lattice(state.packing.lattice)
    follows = state.finite_overlap
    spacing = 1.0 - state.relative_overlap if follows else 1.0
    push = state.force / state.normal_stiffness / packing.diameter / spacing if follows else 0.0
    eta = packing.mindlin_ratio
    twist = packing.torsion
    roll = packing.bending
    centres = np.zeros((structure.n_balls, 3))
    centres[:, : structure.dimension] = structure.positions
    cell = np.zeros((structure.periods, 3))
    cell[:, : structure.dimension] = structure.vectors
    wave = np.linalg.pinv(cell) @ q * 2.0 * np.pi
    matrix = np.zeros((6 * len(centres), 6 * len(centres)), complex)
    for i, j in itertools.product(range(len(centres)), repeat=2):
        for steps in itertools.product(range(-2, 3), repeat=len(cell)):
            n = centres[j] + np.array(steps) @ cell - centres[i]
            if abs(np.linalg.norm(n) - 1.0) > 1e-9:
                continue
            phase = np.exp(1j * wave @ n)
            across = np.eye(3) - np.outer(n, n)
            for ball, factor, sign in ((i, 1.0, -1.0), (j, phase, 1.0)):
                for dof in range(6):
                    u, phi = np.zeros((2, 3), complex)
                    (u if dof < 3 else phi)[dof % 3] = factor if dof < 3 else factor * np.sqrt(10.0)
                    slip = across @ (sign * u) - 0.5 * spacing * np.cross(phi, n)
                    pull = n * (n @ (sign * u)) + eta * slip - push * across @ (sign * u)
                    torque = 0.5 * spacing * eta * np.cross(n, slip) + sign * (
                        twist * n * (n @ phi) + roll * across @ phi
                    )
                    matrix[6 * i : 6 * i + 3, 6 * ball + dof] -= pull
                    matrix[6 * i + 3 : 6 * i + 6, 6 * ball + dof] -= np.sqrt(10.0) * torque
    moving = [*motions.translations, *(3 + axis for axis in motions.rotations)]
    keep = [6 * ball + one for ball in range(len(centres)) for one in moving]
    return np.linalg.eigvalsh(matrix[np.ix_(keep, keep)])


@every_case
def test_frequencies_are_those_of_forces_and_torques(lattice, motions, options):
    ph = phonons_of(lattice, motions, **options)
    q = random_points(ph, 2)
    found = ph.frequencies(q) / ph.scales.frequency
    expected = np.array([twin(ph, one) for one in q])
    assert found.shape == (len(q), ph.lattice.motions.count * len(ph.atoms))
    np.testing.assert_allclose(found**2, expected, atol=1e-12 * expected.max())
    np.testing.assert_array_equal(ph.frequencies(padded(q)), ph.frequencies(q))


@pytest.mark.parametrize("friction", [True, False])
@both_overlaps
def test_a_frequency_does_not_depend_on_its_company(friction, finite_overlap):
    ph = gp.Phonons(at_overlap(friction=friction, finite_overlap=finite_overlap))
    q = np.array([[0.0, 0.0], [1e-12, 0.0], [1e-6, 2e-6], [0.2, 0.1], [0.5, 0.0]])
    np.testing.assert_allclose(
        [ph.frequencies([one])[0] for one in q], ph.frequencies(q), rtol=1e-14
    )


def folded(matrix):
    """The points of the primitive zone that fold on a point q of the supercell ``matrix`` (rows in
    cells): a function.
    """
    matrix = np.asarray(matrix)
    count = round(abs(np.linalg.det(matrix)))
    inverse = np.linalg.inv(matrix.astype(float))
    seen = {}
    for n in np.ndindex(2 * count + 1, 2 * count + 1):
        shift = inverse @ np.array(n, float)
        seen.setdefault(tuple(np.round(shift % 1.0, 9) % 1.0), shift)
    assert len(seen) == count
    return lambda q: np.array([inverse @ np.asarray(q) + shift for shift in seen.values()])


@pytest.mark.parametrize("matrix", [[[1, 0], [0, 4]], [[3, 0], [0, 5]], [[2, 1], [-1, 3]]], ids=str)
@pytest.mark.parametrize("friction", [True, False])
@both_overlaps
def test_a_skewed_supercell_has_the_folded_bands(matrix, friction, finite_overlap):
    state = at_overlap(friction=friction, finite_overlap=finite_overlap)
    one = gp.atoms(state)
    full = np.eye(3, dtype=int)
    full[:2, :2] = matrix
    big = gp.Phonons(state, make_supercell(one, full))
    small = gp.Phonons(state)
    for q in ([0.137, -0.291], [0.0, 0.0], [0.5, 0.5]):
        expected = np.sort(small.frequencies(folded(matrix)(q)).ravel())
        np.testing.assert_allclose(
            big.frequencies([q])[0], expected, rtol=0.0, atol=1e-12 * expected.max()
        )
