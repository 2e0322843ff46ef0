"""Phonons through phonopy against C(q), a phonopy of finite differences, and closed forms; cells, masses, defects."""

from __future__ import annotations

import numpy as np
import pytest
from ase.build import make_supercell
from hypothesis import given, settings
from hypothesis import strategies as st
from phonopy import Phonopy
from phonopy.structure.atoms import PhonopyAtoms

import granphon as gp
from granphon.base.errors import InputError, InstabilityError, MechanismError

DIAMETER = 8e-3
STEEL = gp.Material(young_modulus=211.65e9, poisson_ratio=0.276, density=7840.0)
ETA = 2.0 * (1.0 - 0.276) / (2.0 - 0.276)


def at_overlap(relative=0.01, friction=True, lattice="triangular", poisson=0.276, finite_overlap=None):
    material = gp.Material(young_modulus=211.65e9, poisson_ratio=poisson, density=7840.0)
    packing = gp.Packing(material, DIAMETER, lattice=lattice, friction=friction)
    return gp.AveragedLattice(packing).at_overlap(relative * DIAMETER, finite_overlap=finite_overlap)


fractions = st.floats(-1.0, 1.0, allow_nan=False)
both_overlaps = pytest.mark.parametrize("finite_overlap", [False, True], ids=["limit", "finite"])
# the frictionless square and kagome lattices are mechanisms
LATTICES = [("triangular", True), ("triangular", False), ("square", True), ("kagome", True)]
every_lattice = pytest.mark.parametrize(("lattice", "friction"), LATTICES)


# -- against C(q) and other engines -------------------------------------------------------------------------------------


@pytest.mark.parametrize("relative", [1e-20, 1e-12, 1e-6])
@both_overlaps
def test_bands_are_exact_at_any_load(relative, finite_overlap):
    # in units of (k/M)^1/2 nothing depends on the load but the terms of order delta/d
    q = [[0.123, 0.271], [1 / 3, 1 / 3], [0.5, 0.0], [1e-7, 2e-7]]
    state, plain = at_overlap(relative, finite_overlap=finite_overlap), at_overlap()
    found = gp.Phonons(state).frequencies(q) / state.scales.frequency
    expected = gp.Phonons(plain).frequencies(q) / plain.scales.frequency
    np.testing.assert_allclose(found, expected, rtol=1e-13 + (3.0 * relative if finite_overlap else 0.0))


@pytest.mark.parametrize("length", [1e-3, 1e-6, 1e-9, 1e-12])
@pytest.mark.parametrize("friction", [True, False])
def test_sound_is_followed_down_to_gamma(length, friction):
    # phonopy's D(q) has lost the frequency below |q| d = 1e-8; ours keeps omega = v |q|
    state = at_overlap(friction=friction)
    ph = gp.Phonons(state)
    q = length * np.array([[1.0, 0.4]])
    wavenumber = np.linalg.norm(ph.lattice.wavevectors(q)) / DIAMETER
    sound = gp.sound_velocities(state)
    slow, fast = ph.frequencies(q)[0, :2] * 2.0 * np.pi / wavenumber
    assert slow == pytest.approx(sound.transverse, rel=1e-12 + 20.0 * length**2)
    assert fast == pytest.approx(sound.longitudinal, rel=1e-12 + 20.0 * length**2)
    np.testing.assert_array_equal(ph.frequencies([[0.0, 0.0]])[0, :2], 0.0)


@pytest.mark.parametrize("friction", [True, False])
@both_overlaps
def test_a_frequency_does_not_depend_on_its_company(friction, finite_overlap):
    ph = gp.Phonons(at_overlap(friction=friction, finite_overlap=finite_overlap))
    q = np.array([[0.0, 0.0], [1e-12, 0.0], [1e-6, 2e-6], [0.2, 0.1], [0.5, 0.0]])
    np.testing.assert_allclose([ph.frequencies([one])[0] for one in q], ph.frequencies(q), rtol=1e-14)


@pytest.mark.claim("bands-and-group-velocities")
@every_lattice
@both_overlaps
def test_a_phonopy_of_finite_differences_agrees(lattice, friction, finite_overlap):
    # nothing of ours but forces and torques: cell, masses, differences and dynamical matrix are phonopy's
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


def test_closed_forms_at_symmetry_points():
    # steel's branches at K, M and Gamma, k/M = 1
    state = at_overlap()
    ph = gp.Phonons(state)
    found = (ph.frequencies([[0, 0], [0.5, 0], [1 / 3, 1 / 3]]) / state.scales.frequency) ** 2
    np.testing.assert_allclose(found[0], [0.0, 0.0, 30.0 * ETA], atol=1e-13)
    # M: motion along and across the row, 6 + 2 eta and 2 + 6 eta, and pure rotation 10 eta
    np.testing.assert_allclose(found[1], np.sort([6 + 2 * ETA, 2 + 6 * ETA, 10 * ETA]), rtol=1e-13)
    # K: two degenerate mixed motions 9/2 (1 + eta) coupled to none, and pure rotation 15 eta / 2
    np.testing.assert_allclose(found[2, 0], 7.5 * ETA, rtol=1e-13)
    np.testing.assert_allclose(found[2, 1:], 4.5 * (1.0 + ETA), rtol=1e-13)


def test_dynamical_matrix_is_phonopys():
    state = at_overlap(lattice="kagome")
    ph = gp.Phonons(state)
    q = np.array([[0.1, 0.2, 0.0], [0.4, -0.3, 0.0]])
    theirs = ph.phonopy.run_qpoints(q, with_dynamical_matrices=True).dynamical_matrices
    np.testing.assert_allclose(theirs, ph.lattice.dynamical_matrix(ph.lattice.wavevectors(q)), atol=1e-13)


# -- other cells of the same balls --------------------------------------------------------------------------------------


def folded(matrix):
    """The points of the primitive zone that fold on a point q of the supercell ``matrix`` (rows in cells): a function."""
    matrix = np.asarray(matrix)
    count = round(abs(np.linalg.det(matrix)))
    inverse = np.linalg.inv(matrix.astype(float))
    seen = {}
    for n in np.ndindex(2 * count + 1, 2 * count + 1):
        shift = inverse @ np.array(n, float)
        seen.setdefault(tuple(np.round(shift % 1.0, 9) % 1.0), shift)
    assert len(seen) == count
    return lambda q: np.array([inverse @ np.asarray(q) + shift for shift in seen.values()])


@pytest.mark.parametrize(
    "matrix", [[[2, 0], [0, 2]], [[1, 0], [0, 4]], [[3, 0], [0, 5]], [[2, 1], [-1, 1]], [[2, 1], [-1, 3]]], ids=str
)
@pytest.mark.parametrize("friction", [True, False])
@both_overlaps
def test_a_supercell_has_the_folded_bands(matrix, friction, finite_overlap):
    state = at_overlap(friction=friction, finite_overlap=finite_overlap)
    one = gp.atoms(state)
    full = np.eye(3, dtype=int)
    full[:2, :2] = matrix
    big = gp.Phonons(state, make_supercell(one, full))
    small = gp.Phonons(state)
    for q in ([0.137, -0.291], [0.0, 0.0], [0.5, 0.5]):
        expected = np.sort(small.frequencies(folded(matrix)(q)).ravel())
        np.testing.assert_allclose(big.frequencies([q])[0], expected, rtol=0.0, atol=1e-12 * expected.max())


@given(
    masses=st.lists(st.floats(0.1, 10.0), min_size=4, max_size=4),
    q=st.tuples(fractions, fractions),
    finite_overlap=st.booleans(),
    friction=st.booleans(),
)
@settings(max_examples=15, deadline=None)
def test_unequal_masses(masses, q, finite_overlap, friction):
    state = at_overlap(friction=friction, finite_overlap=finite_overlap)
    balls = gp.atoms(state).repeat((2, 2, 1))
    balls.set_masses(masses)
    ph = gp.Phonons(state, balls)
    # trace of D is the sum of each ball's own stiffness over its mass
    stiffness = 3.0 * (1.0 + ETA * friction) * 2.0 + (15.0 * ETA if friction else 0.0)
    if not finite_overlap:
        total = np.sum((ph.frequencies([q]) / state.scales.frequency) ** 2)
        assert total == pytest.approx(stiffness * np.sum(1.0 / np.array(masses)), rel=1e-10)


def test_all_masses_doubled_slow_every_mode_by_sqrt_two():
    state = at_overlap()
    balls = gp.atoms(state)
    balls.set_masses([2.0])
    q = [[0.1, 0.2], [0.4, 0.3]]
    np.testing.assert_allclose(
        gp.Phonons(state, balls).frequencies(q) * np.sqrt(2.0), gp.Phonons(state).frequencies(q), rtol=1e-13
    )


def test_a_heavy_impurity_hardly_moves():
    # as its mass grows its own three modes fall as M^-1/2, and the others tend to those of a ball held fast
    state = at_overlap()
    lows, highs = [], []
    for mass in (1e4, 1e6):
        balls = gp.atoms(state).repeat((4, 4, 1))
        masses = np.ones(16)
        masses[5] = mass
        balls.set_masses(masses)
        values = gp.Phonons(state, balls).frequencies([[0.31, 0.17]])[0] / state.scales.frequency
        lows.append(values[:3])
        highs.append(values[3:])
    np.testing.assert_allclose(lows[0] / lows[1], 10.0, rtol=2e-3)
    held = np.delete(np.arange(48), [15, 16, 17])
    matrix = gp.Phonons(state, gp.atoms(state).repeat((4, 4, 1)))
    d = matrix.lattice.dynamical_matrix(matrix.lattice.wavevectors([[0.31, 0.17]]))[0][np.ix_(held, held)]
    np.testing.assert_allclose(highs[1], np.sqrt(np.linalg.eigvalsh(d)), rtol=1e-5)


@pytest.mark.parametrize("friction", [True, False])
def test_a_vacancy(friction):
    state = at_overlap(friction=friction)
    balls = gp.atoms(state).repeat((4, 4, 1))
    del balls[5]
    ph = gp.Phonons(state, balls)
    assert ph.frequencies([[0.1, 0.2]]).shape == (1, (3 if friction else 2) * 15)
    assert len(ph.lattice.contacts) == 3 * 16 - 6
    # springs are taken away and none added: every mode is at or below that of the same rank with the ball held
    whole = gp.Phonons(state, gp.atoms(state).repeat((4, 4, 1))).frequencies([[0.1, 0.2]])[0]
    assert np.all(ph.frequencies([[0.1, 0.2]])[0] <= whole[-ph.lattice.n_branches :] * (1.0 + 1e-12))


def test_atoms_are_taken_as_a_copy():
    state = at_overlap()
    balls = gp.atoms(state).repeat((2, 1, 1))
    ph = gp.Phonons(state, balls)
    before = ph.frequencies([[0.1, 0.2]])
    balls.set_masses([5.0, 5.0])
    balls.positions += 1.0
    np.testing.assert_array_equal(ph.frequencies([[0.1, 0.2]]), before)


def test_a_free_cluster_has_flat_bands():
    state = at_overlap()
    balls = gp.atoms(state).repeat((3, 3, 1))
    balls.pbc = False
    ph = gp.Phonons(state, balls)
    matrix = ph.calculator.get_force_constants(balls).transpose(0, 2, 1, 3).reshape(27, 27)
    expected = np.sqrt(np.maximum(np.linalg.eigvalsh(matrix), 0.0)) * state.scales.frequency
    np.testing.assert_allclose(ph.frequencies([[0.0, 0.0], [0.1, 0.2]]), [expected] * 2, atol=1e-7 * expected.max())


# -- what is refused ----------------------------------------------------------------------------------------------------


def test_dim():
    state = at_overlap()
    assert gp.Phonons(state).dim == (3, 3)
    assert gp.Phonons(state, gp.atoms(state).repeat((3, 3, 1))).dim == (1, 1)
    assert gp.Phonons(state, gp.atoms(state).repeat((1, 5, 1))).dim == (3, 1)
    assert gp.Phonons(at_overlap(lattice="kagome")).dim == (2, 2)
    q = [[0.123, 0.271]]
    np.testing.assert_allclose(
        gp.Phonons(state, dim=(5, 4)).frequencies(q), gp.Phonons(state, dim=(3, 3, 1)).frequencies(q), rtol=1e-13
    )
    for small in ((2, 2), (1, 1), (2, 3), (3, 2, 1)):
        with pytest.raises(InputError, match=r"too small.*told apart.*Use at least 3 x 3"):
            gp.Phonons(state, dim=small)
    for wrong in ((3, 3, 2), (3.5, 3), (0, 3), (3,), "33"):
        with pytest.raises(InputError, match="allowed: two whole numbers from 1 to"):
            gp.Phonons(state, dim=wrong)


def test_two_by_two_would_alias():
    # why 2 x 2 is refused: M and Gamma come out right all the same, generic points do not
    state = at_overlap()
    one = gp.atoms(state)
    bare = Phonopy(
        PhonopyAtoms(symbols=["Fe"], cell=np.asarray(one.cell), scaled_positions=[[0, 0, 0]], masses=[1.0]),
        np.diag([2, 2, 1]),
        primitive_matrix="P",
        is_symmetry=False,
    )
    bare.unit_conversion_factor = 1.0
    bare.force_constants = one.calc.get_force_constants(one.repeat((2, 2, 1)))
    right = gp.Phonons(state)
    for q, exact in (([0.0, 0.0, 0.0], True), ([0.5, 0.0, 0.0], True), ([0.21, 0.13, 0.0], False)):
        found = bare.run_qpoints([q]).frequencies[0]
        expected = right.frequencies([q])[0] / state.scales.frequency
        assert bool(np.abs(found - expected).max() < 1e-6) is exact


def test_atoms_of_another_state_are_refused():
    state, other = at_overlap(), at_overlap(1e-3)
    with pytest.raises(InputError, match=r"granphon_stiffness_N_per_m.*reduced units of another state"):
        gp.Phonons(state, gp.atoms(other))
    balls = gp.atoms(state)
    balls.info["granphon_length_m"] *= 1.0 + 1e-6
    with pytest.raises(InputError, match="granphon_length_m"):
        gp.Phonons(state, balls)


@pytest.mark.parametrize("lattice", ["square", "kagome", "honeycomb"])
def test_mechanisms_have_bands_and_no_sound(lattice):
    state = at_overlap(friction=False, lattice=lattice)
    ph = gp.Phonons(state)
    q = np.random.default_rng(3).uniform(-0.5, 0.5, (8, 3)) * [1.0, 1.0, 0.0]
    found = ph.frequencies(q) / ph.scales.frequency
    np.testing.assert_allclose(
        found, np.sort(np.abs(ph.phonopy.run_qpoints(q).frequencies[:, -found.shape[1] :]), axis=1), atol=1e-7
    )
    for find in (gp.sound_velocities, gp.moduli):
        with pytest.raises(MechanismError, match=f"the lattice {lattice} is a mechanism"):
            find(state, *[(1.0, 0.0)] * (find is gp.sound_velocities))


def test_a_buckled_state_is_an_error():
    # compressed so far that the prestress of finite overlap wins
    state = at_overlap(0.9, friction=False, finite_overlap=True)
    ph = gp.Phonons(state)
    with pytest.raises(
        InstabilityError, match=r"lattice triangular buckles: a squared frequency at q = \(0\.5, 0\) is"
    ) as told:
        ph.frequencies([[0.1, 0.0], [0.5, 0.0], [0.2, 0.0]])
    assert "push the balls sideways" in str(told.value)
    with pytest.raises(InstabilityError, match=r"at q = \(0\.5, 0\) is negative"):
        ph.bands([[0.4, 0.0, 0.0], [0.5, 0.0, 0.0]], npoints=2)


@pytest.mark.parametrize(
    "q", [[0.1, 0.2], [[0.1]], [[0.1, 0.2, 0.3, 0.4]], [[np.nan, 0.0]], [[0.0, np.inf]], [[0.1, 0.2, 0.3]], None]
)
def test_q_points_that_cannot_be(q):
    with pytest.raises(InputError, match=r"\(n, 2\) or \(n, 3\) finite fractions|leaves the plane|a real number"):
        gp.Phonons(at_overlap()).frequencies(q)


def test_modes_in_si_units():
    state = at_overlap()
    ph = gp.Phonons(state)
    q = [[0.1, 0.2], [0.3, -0.1]]
    modes = ph.modes(q)
    assert modes.units["frequencies"] == "Hz"
    np.testing.assert_allclose(modes.frequencies, ph.frequencies(q), rtol=1e-12)
    step = 1e-5
    ahead = (ph.frequencies(np.add(q, [step, 0])) - ph.frequencies(np.subtract(q, [step, 0]))) * 2.0 * np.pi
    length = ph.lattice.wavevectors([[2.0 * step, 0.0]])[0] / DIAMETER
    np.testing.assert_allclose(modes.group_velocities @ length, ahead, rtol=1e-7)
    np.testing.assert_allclose(
        modes.rotational_fraction + modes.longitudinal_fraction + modes.transverse_fraction, 1.0, rtol=1e-12
    )
    with pytest.raises(InputError, match="modes at Gamma need a direction"):
        ph.modes([[0.0, 0.0]])


@every_lattice
def test_group_velocities_are_phonopys(lattice, friction):
    # phonopy takes frequencies for ordinary ones and multiplies by 2 pi: ours are angular in reduced units
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
    """Force constants come from the state: rattled balls and a strained cell have the frequencies of the lattice."""
    state = at_overlap(friction=friction)
    balls = gp.atoms(state).repeat((3, 4, 1))
    expected = gp.Phonons(state, balls).frequencies(QS := np.random.default_rng(4).random((6, 2)))
    rattled, strained = balls.copy(), balls.copy()
    rattled.positions[:, :2] += 0.02 * np.random.default_rng(5).normal(size=(12, 2))
    strained.set_cell(np.asarray(balls.cell) * [[1.01], [0.985], [1.0]], scale_atoms=True)
    for cell in (rattled, strained):
        ph = gp.Phonons(state, cell)
        np.testing.assert_allclose(ph.frequencies(QS), expected, rtol=1e-12)
        direct = ph.lattice.frequencies(ph.lattice.wavevectors(QS)) * ph.scales.frequency
        np.testing.assert_allclose(direct, expected, rtol=1e-12)


@pytest.mark.parametrize(
    ("repeat", "pbc"), [((1, 2, 1), (True, False, False)), ((1, 1, 1), (True, False, False)), ((2, 2, 1), False)]
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


def test_atoms_that_cannot_be():
    state = at_overlap()
    lost, turned, tilted = gp.atoms(state), gp.atoms(state), gp.atoms(state)
    lost.pbc = False
    lost.set_cell(np.zeros((3, 3)))
    with pytest.raises(InputError, match="no cell"):
        gp.Phonons(state, lost)
    turned.rotate(30, "z", rotate_cell=True)
    with pytest.raises(InputError, match="turned against the lattice"):
        gp.Phonons(state, turned)
    tilted.rotate(30, "x", rotate_cell=True)
    with pytest.raises(InputError, match="tilted out of the plane"):
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


def test_atoms_of_the_other_overlap_are_refused():
    state, following = at_overlap(), at_overlap(finite_overlap=True)
    finite = gp.atoms(following)
    with pytest.raises(InputError, match="made with finite overlap"):
        gp.Phonons(state, finite)
    finite.calc = gp.HertzMindlin(state)
    with pytest.raises(InputError, match="Make the state with finite_overlap=True"):
        finite.get_potential_energy()
    assert gp.Phonons(following, finite).frequencies([[0.1, 0.2]]).shape == (1, 3)


@pytest.mark.parametrize("friction", [True, False])
@pytest.mark.parametrize("method", ["tetrahedron", "smearing"])
def test_the_coarsest_mesh_still_counts_every_mode(friction, method):
    dos = gp.Phonons(at_overlap(friction=friction)).dos((1, 1), method=method)
    assert np.trapezoid(dos.total, dos.frequencies) == pytest.approx(3 if friction else 2, abs=1e-6)


def test_branches_that_touch_at_gamma_are_those_of_the_path():
    bands = gp.Phonons(at_overlap(lattice="kagome")).bands("GKMG", npoints=201)
    overlap = np.abs(np.einsum("spma,spmb->spab", bands.eigenvectors[:, :-1].conj(), bands.eigenvectors[:, 1:])) ** 2
    assert overlap.max(axis=3).min() > 0.99


def test_prestressed_modes_of_a_large_cell_are_those_of_a_small_one():
    state = at_overlap(finite_overlap=True)
    large = gp.Phonons(state, gp.atoms(state).repeat((4, 4, 1)))
    small = gp.Phonons(state)
    assert large.lattice.n_branches == 48
    folded = [(0.1 + i) / 4 for i in range(4)]
    expected = np.sort(small.frequencies([[a, b] for a in folded for b in folded]).ravel())
    np.testing.assert_allclose(large.modes([[0.1, 0.1]]).frequencies[0], expected, rtol=1e-10)


@pytest.mark.parametrize("length", [5, 40])
def test_fewer_contacts_than_motions_leave_free_ones(length):
    """A frictionless row of balls: longitudinal waves along it, and nothing resists the motion across it."""
    state = at_overlap(friction=False)
    row = gp.atoms(state).repeat((length, 1, 1))
    row.pbc = (True, False, False)
    ph = gp.Phonons(state, row)
    folded = (0.1 + np.arange(length)) / length
    chain = np.sort(np.concatenate([np.zeros(length), 2.0 * np.abs(np.sin(np.pi * folded))])) * ph.scales.frequency
    np.testing.assert_allclose(ph.frequencies([[0.1, 0.0]])[0], chain, atol=1e-9 * chain.max())
    np.testing.assert_allclose(ph.modes([[0.1, 0.0]]).frequencies[0], chain, atol=1e-9 * chain.max())
