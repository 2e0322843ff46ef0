"""Springs to the ground of networks: bands, modes, half spaces, responses and files against closed
forms, dense matrices and phonopy.
"""

from __future__ import annotations

import json
from dataclasses import replace

import numpy as np
import pytest
from numpy.testing import assert_allclose

import granphon as gp
from granphon.balls.motions import allowed_motions
from granphon.balls.on_site import SpringLaw
from granphon.base.errors import InputError

STEEL = gp.Material(211.65e9, 0.276, 7840.0)
BALL = gp.Ball(STEEL, 8e-3)
#: springs of the chain, N/m
GROUND = 1e6


def make_chain(**options):
    """The network of a chain of equal balls under 20 N."""
    return gp.Crystal.on("chain", [BALL], **options).at_force(20.0).network


def find_chain_frequencies(network, q):
    """omega/2 pi of the chain with springs to the ground, at q in fractions."""
    k = network.normal_stiffness[0]
    square = (GROUND + 4.0 * k * np.sin(np.pi * np.asarray(q)) ** 2) / network.masses[0]
    return np.sqrt(square) / (2.0 * np.pi)


def make_random(lattice, motions, rng, shape=None):
    """A supercell of a lattice whose balls have random springs, but the first."""
    crystal = gp.Crystal.on(lattice, [BALL], motions=motions)
    network = crystal.at_force(20.0).network.repeat(shape or (2,) * crystal.periods)
    kinds = allowed_motions(network.dimension)[motions]
    scale = np.where(kinds.is_rotation, 1.0, 1e6)
    springs = rng.uniform(0.0, 1.0, (network.n_balls, kinds.count)) * scale
    springs[0] = 0.0
    return replace(network, on_site=springs)


def add_springs(network, q):
    """Frequencies, Hz, by LAPACK from D without springs and their diagonal."""
    lattice = gp.Phonons(replace(network, on_site=None)).lattice
    turns = lattice.motions.is_rotation
    inertia = np.where(turns, network.inertias[:, None], network.masses[:, None])
    squares = (network.on_site / inertia).ravel() / network.scales.angular_frequency**2
    matrices = lattice.dynamical_matrix(lattice.wavevectors(q)) + np.diag(squares)
    return np.linalg.eigvalsh(matrices) * network.scales.frequency**2


@pytest.mark.claim("on-site-chain")
def test_the_band_of_a_chain_begins_at_the_cut_off_frequency():
    network = make_chain(on_site=GROUND)
    phonons = gp.Phonons(network)
    q = np.linspace(0.0, 0.5, 41)
    expected = find_chain_frequencies(network, q)
    assert_allclose(phonons.frequencies(q[:, None])[:, 0], expected, rtol=1e-14)
    onset = phonons.onset()
    assert_allclose(onset.frequencies, expected[0], rtol=1e-14)
    assert_allclose(onset.gap, expected[0], rtol=1e-14)
    # omega'' = k d^2/(m omega_0)
    bend = network.normal_stiffness[0] * 8e-3**2 / network.masses[0] / (2 * np.pi * expected[0])
    assert_allclose(onset.curvatures, bend, rtol=1e-11)


def test_modes_of_a_finite_chain_are_those_of_the_band():
    network = make_chain(on_site=GROUND)
    q = np.array([0, 1, 1, 2, 2]) / 40
    modes = gp.Waves(network.repeat((40,))).modes(5)
    assert_allclose(modes.frequencies, find_chain_frequencies(network, q), rtol=1e-12)


@pytest.mark.parametrize(
    ("lattice", "motions"),
    [("chain", "all"), ("square", "out_of_plane"), ("triangular", "in_plane"), ("fcc", "all")],
)
def test_bands_with_springs_are_those_of_a_dense_matrix(lattice, motions):
    rng = np.random.default_rng(3)
    network = make_random(lattice, motions, rng)
    phonons = gp.Phonons(network)
    q = rng.uniform(-0.5, 0.5, (3, sum(network.pbc)))
    frequencies = phonons.frequencies(q)
    squares = add_springs(network, q)
    assert_allclose(frequencies**2, squares, rtol=0.0, atol=1e-13 * squares.max())
    # group velocities by finite differences of the frequencies
    step = 1e-6 * np.eye(sum(network.pbc))[0]
    slopes = (phonons.frequencies(q + step) - phonons.frequencies(q - step)) / 2e-6
    along = phonons.lattice.reciprocal[0] / network.scales.length / (2.0 * np.pi)
    velocities = phonons.modes(q).group_velocities @ along
    assert_allclose(velocities, slopes, rtol=0.0, atol=1e-5 * np.abs(slopes).max())


@pytest.mark.claim("on-site-phonopy")
def test_phonopy_has_the_force_constants_of_the_springs():
    rng = np.random.default_rng(4)
    network = make_random("triangular", "in_plane", rng, (2, 1))
    phonons = gp.Phonons(network)
    q = np.pad(rng.uniform(-0.5, 0.5, (3, 2)), ((0, 0), (0, 1)))
    phonopy = phonons.phonopy
    phonopy.run_qpoints(q)
    theirs = phonopy.qpoints.frequencies / np.max(phonopy.qpoints.frequencies)
    ours = phonons.frequencies(q)
    assert_allclose(theirs, ours / ours.max(), atol=1e-12)


def test_the_whole_of_a_large_array_is_its_cell():
    rng = np.random.default_rng(5)
    network = make_random("triangular", "in_plane", rng)
    corners = np.array([[0.0, 0.0], [0.5, 0.0], [0.0, 0.5], [0.5, 0.5]])
    expected = np.sort(gp.Phonons(network).frequencies(corners).ravel())[:4]
    found = gp.Waves(network.repeat((2, 2))).modes(4).frequencies
    assert_allclose(found, expected, rtol=1e-11)


@pytest.mark.claim("on-site-sound")
def test_sound_has_no_velocity_and_the_error_tells_the_cut_off():
    network = make_chain(on_site=GROUND)
    for find in (gp.sound_velocities, gp.moduli, lambda x: gp.pulse_velocities(x, 4e3)):
        with pytest.raises(InputError, match=r"3\.4716 kHz .* 20\.462 m\^2/s"):
            find(network)


@pytest.mark.claim("on-site-sound")
def test_springs_of_rotations_leave_sound():
    network = make_chain(motions="in_plane")
    plane = gp.Crystal.on("triangular", [BALL]).at_force(20.0).network
    held = replace(plane, on_site=np.array([[0.0, 0.0, 1.0]]))
    sound = gp.sound_velocities(held, (1, 0))
    near = gp.Phonons(held).modes([[1e-6, 2e-6]], (1, 0)).group_velocities[0, :2]
    assert_allclose(np.linalg.norm(near, axis=1), sound.velocities, rtol=1e-9)
    free = gp.sound_velocities(plane)
    assert_allclose(sound.longitudinal, free.longitudinal, rtol=1e-12)
    assert sound.transverse > free.transverse
    with pytest.raises(InputError, match="resist rotations"):
        gp.moduli(held)
    # out of the plane the balls resist each other's slip, as they cannot turn with the wave
    packing = gp.Packing(STEEL, 8e-3, motions="all", torsion=0.01, bending=0.01)
    sheet = gp.AveragedLattice(packing).at_force(20.0).network
    assert gp.sound_velocities(sheet, (1, 0)).velocities[0] == 0.0
    held_sheet = replace(sheet, on_site=np.array([[0.0, 0.0, 0.0, 1.0, 1.0, 1.0]]))
    across = gp.sound_velocities(held_sheet, (1, 0)).velocities[0]
    beside = gp.Phonons(held_sheet).frequencies([[1e-5, 0.0]])[0, 0]
    length = 1e-5 * np.linalg.norm(np.linalg.inv(sheet.cell[:2, :2])[:, 0])
    assert_allclose(across, beside / length, rtol=1e-7)
    # without friction a ball turns alone, at (k/I)^1/2
    smooth = make_chain(motions="in_plane", friction=False, on_site={"rotation": 2.0})
    assert smooth.ball_motions.rotate
    frequency = np.sqrt(2.0 / network.inertias[0]) / (2.0 * np.pi)
    assert_allclose(gp.Phonons(smooth).frequencies([[0.2]])[0, 1], frequency, rtol=1e-13)


@pytest.mark.claim("on-site-waves")
def test_waves_decay_below_the_cut_off_and_pass_above_it():
    network = make_chain(on_site=GROUND)
    frequencies = np.array([2e3, 4e3, 9e3])
    stiffness = network.normal_stiffness[0]
    square = (2.0 * np.pi * frequencies) ** 2 * network.masses[0] - GROUND
    theta = 2.0 * np.arcsin(np.sqrt(square / (4.0 * stiffness) + 0j))
    waves = gp.Phonons(network).complex_bands(frequencies, 0)
    assert_allclose(np.abs(waves.forward[:, 0] * 8e-3), np.abs(theta), rtol=1e-9)
    through = gp.transmission(network, None, network, frequencies)
    assert_allclose(through.transmitted, [0.0, 1.0, 1.0], atol=1e-12)
    free = make_chain()
    # the reflection at a step of the springs is that of two impedances k sin theta
    step = gp.transmission(free, None, network, frequencies[1:])
    first, second = (
        2.0 * np.arcsin(np.sqrt((square[1:] + extra) / (4.0 * stiffness)))
        for extra in (GROUND, 0.0)
    )
    amplitude = (np.exp(1j * first) - np.exp(1j * second)) / (
        np.exp(-1j * first) - np.exp(1j * second)
    )
    assert_allclose(step.reflected, np.abs(amplitude) ** 2, atol=1e-9)


@pytest.mark.claim("on-site-waves")
def test_a_response_is_that_of_the_inverse_matrix_with_losses_in_contacts_alone():
    network = make_chain(on_site=GROUND).cut(0, 6, "clamped")
    frequencies = np.array([2e3, 5e3])
    moving = np.flatnonzero(network.moving)
    tau = 1e-6
    response = gp.Waves(network).response(frequencies, (1, "x"), (3, "x"), damping=tau)
    springs = np.zeros((6, 6))
    for i, j, k in zip(network.i, network.j, network.normal_stiffness, strict=True):
        springs[np.ix_([i, j], [i, j])] += k * np.array([[1, -1], [-1, 1]])
    springs = springs[np.ix_(moving, moving)]
    for omega, found in zip(2 * np.pi * frequencies, np.asarray(response), strict=True):
        matrix = springs * (1.0 + 1j * omega * tau)
        matrix += np.eye(4) * (GROUND - network.masses[1] * omega**2)
        assert_allclose(found, np.linalg.inv(matrix)[2, 0], rtol=1e-9)
    # damped bands: m w^2 = k_g + 4 k sin^2 (1 + i eta + i w tau)
    chain = make_chain(on_site=GROUND)
    damped = gp.Phonons(chain).damped([[0.2]], damping=tau, loss_factor=0.01).frequencies[0, 0]
    k = 4.0 * chain.normal_stiffness[0] * np.sin(0.2 * np.pi) ** 2
    roots = np.roots([chain.masses[0], -1j * k * tau, -(GROUND + k * (1.0 + 0.01j))])
    assert_allclose(damped, roots[roots.real > 0.0][0] / (2.0 * np.pi), rtol=1e-12)


def test_waves_of_an_edge_are_those_of_a_thick_strip():
    plane = gp.Crystal.on("triangular", [BALL]).at_force(20.0).network
    network = replace(plane, on_site=np.array([[1e6, 2e6, 0.5]]))
    branches = gp.Surface(network, 1).branches(np.array([[0.3]]))
    strip = gp.Phonons(network.cut(1, 30)).frequencies([[0.3]])[0]
    assert_allclose(branches.frequencies[0], strip[0], rtol=1e-9)


def test_springs_are_kept():
    rng = np.random.default_rng(6)
    network = make_random("triangular", "in_plane", rng)
    assert_allclose(network.repeat((1, 2)).on_site, np.tile(network.on_site, (2, 1)))
    assert_allclose(network.select([2, 1]).on_site, network.on_site[[2, 1]])
    restored = gp.ContactNetwork.from_dict(json.loads(json.dumps(network.to_dict())))
    assert restored == network
    alike = replace(network, on_site=np.tile([3.0, 3.0, 1.0], (4, 1)))
    assert_allclose(alike.cut([1, 1], 3).on_site, np.tile([3.0, 3.0, 1.0], (12, 1)))
    wall = alike.cut(1, 3, ("floor", "free"))
    assert not np.any(wall.on_site[-1])
    with pytest.raises(InputError, match="turned"):
        network.cut([1, 1], 3)


def test_tables_hold_springs(tmp_path):
    network = make_random("triangular", "in_plane", np.random.default_rng(7))
    files = tmp_path / "balls.csv", tmp_path / "contacts.csv"
    network.write_tables(*files)
    assert gp.ContactNetwork.from_table(*files) == network
    balls = {"x": [0.0, 1.0, 2.0], "radius": [0.5] * 3, "mass": [1.0] * 3, "on_site_x": [5.0] * 3}
    contacts = {"i": [0, 1], "j": [1, 2], "normal_force": [1.0] * 2, "normal_stiffness": [2.0] * 2}
    read = gp.ContactNetwork.from_table(balls, contacts, friction=False)
    assert_allclose(read.on_site, [[5.0]] * 3)
    assert not read.rattlers.size  # springs hold the ends
    with pytest.raises(InputError, match="on_site_z"):
        gp.ContactNetwork.from_table(balls | {"on_site_z": [1.0] * 3}, contacts, friction=False)


@pytest.mark.parametrize("springs", [[[-1.0]], [[np.nan]], [[1.0, 1.0]], [[1.0], [1.0]]])
def test_springs_that_are_refused(springs):
    with pytest.raises(InputError, match="on_site"):
        replace(make_chain(), on_site=np.array(springs))


def test_the_law_of_a_spring_returns_floats_for_floats():
    law = SpringLaw(2.0)
    found = [law.energy(3.0), law.force(3.0), law.stiffness(3.0), law.stiffness_slope(3.0)]
    assert found == [9.0, 6.0, 2.0, 0.0]
    assert all(isinstance(number, float) for number in found)
