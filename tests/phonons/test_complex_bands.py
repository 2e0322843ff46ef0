"""Wave numbers at given frequencies: closed forms of chains, the bands at real wave numbers,
losses, refusals.
"""

from __future__ import annotations

import re
from dataclasses import replace

import numpy as np
import pytest
from numpy.testing import assert_allclose

import granphon as gp
from granphon.base.errors import InputError, PrecisionError
from granphon.dynamics.bloch_waves import find_bloch_waves
from granphon.dynamics.half_space import HalfSpace
from tests.networks.test_cuts import D, bulk, chain

K = 2e7
LIGHT = 9.75e-3
HEAVY = 28.84e-3


def complex_angles(f, losses=0.0):
    """k h of a chain of two kinds of balls, from cos(kh) = 1 - w/K (m + M) + w^2 m M/(2 K^2), with
    complex springs.
    """
    w = (2.0 * np.pi * f) ** 2
    spring = K * (1.0 - 1j * np.asarray(losses))
    return np.arccos(
        1.0 - w / spring * (LIGHT + HEAVY) + 0.5 * w**2 * LIGHT * HEAVY / spring**2 + 0j
    )


@pytest.mark.claim("complex-bands")
@pytest.mark.parametrize("losses", [{}, {"loss_factor": 0.05}, {"damping": 2e-6}])
def test_a_chain_of_two_masses(losses):
    network = chain([LIGHT, HEAVY], (K, K))
    f = np.linspace(0.02, 1.3, 80) * np.sqrt(2.0 * K * (1.0 / LIGHT + 1.0 / HEAVY)) / (2.0 * np.pi)
    found = gp.Phonons(network).complex_bands(f, **losses)
    lost = losses.get("loss_factor", 2.0 * np.pi * f * losses.get("damping", 0.0))
    angle = complex_angles(f, lost)
    # cosines are even, so that the sense does not matter
    assert_allclose(
        np.cos(found.forward[:, 0] * found.height), np.cos(angle), rtol=1e-10, atol=1e-10
    )
    assert np.all(found.forward.imag >= 0.0)
    assert_allclose(found.wavenumbers[:, 1].imag, -found.wavenumbers[:, 0].imag, atol=1e-7)
    assert_allclose(found.attenuation, 20.0 * np.log10(np.e) * np.abs(angle.imag), atol=1e-6)
    if not losses:
        gap = (f > np.sqrt(2.0 * K / HEAVY) / (2.0 * np.pi)) & (
            f < np.sqrt(2.0 * K / LIGHT) / (2.0 * np.pi)
        )
        assert np.any(gap)
        assert np.all(found.attenuation[gap] > 0.0)
        assert not np.any(found.running[gap])


@pytest.mark.claim("complex-bands")
@pytest.mark.parametrize(
    ("lattice", "axis"),
    [
        ("triangular", 1),
        ("square", 0),
        ("honeycomb", 1),
        ("kagome", 1),
        ("sc", 2),
        ("fcc", 2),
        ("hcp", 2),
    ],
)
def test_waves_that_run_are_those_of_the_bands(lattice, axis):
    """Across a vector of the cell, k h is 2 pi times the fraction of its reciprocal vector, that
    along the layers apart.
    """
    network = bulk(lattice)
    random = np.random.default_rng(1)
    phonons = gp.Phonons(network)
    p = network.dimension
    q = random.uniform(-0.4, 0.4, p - 1)
    f = np.linspace(0.05, 0.98, 25) * phonons.lattice.top_frequency * network.scales.frequency
    found = phonons.complex_bands(f, axis, q)
    assert found.running.sum() > 20
    cell = network.cell[:p, :p]
    normal = np.linalg.inv(cell)[:, axis]
    normal = normal / np.linalg.norm(normal)
    inside = np.delete(np.arange(p), axis)
    for place, running in enumerate(found.running):
        for k in found.forward[place, :running].real:
            # q.a along the vectors of a layer is given, and k is the part across it
            along = np.linalg.lstsq(cell[inside], 2.0 * np.pi * q, rcond=None)[0]
            fraction = cell @ (along + k * normal) / (2.0 * np.pi)
            assert np.min(np.abs(phonons.frequencies([fraction])[0] / f[place] - 1.0)) < 1e-10


def test_long_waves_where_static_forces_soften_the_layers():
    """Square lattice without friction: M w^2 = 4 k sin^2(q_x a/2) - 4 (f/a) sin^2(q_y a/2), below
    zero at small q_x.
    """
    packing = gp.Packing(gp.Material(70e9, 0.3, 2500.0), D, lattice="square", friction=False)
    network = gp.AveragedLattice(packing).at_force(10.0, finite_overlap=True).network
    k = network.normal_stiffness[0]
    spacing = network.cell[0, 0]
    fraction = 0.3
    network = replace(network, normal_force=5e-4 * k * network.distance)
    soft = 5e-4 * np.sin(np.pi * fraction) ** 2
    angles = np.array([0.05, 0.08, 0.15, 0.6])
    f = np.sqrt(4.0 * k / network.masses[0] * (np.sin(0.5 * angles) ** 2 - soft)) / (2.0 * np.pi)
    found = gp.Phonons(network).complex_bands(f, 0, [fraction])
    running = np.abs(found.forward[:, 0].real) * spacing
    assert_allclose(running, angles, rtol=1e-9)


def test_as_many_waves_run_up_as_down_and_decay_mirrors_growth():
    found = gp.Phonons(bulk("fcc")).complex_bands(
        np.linspace(1e3, 60e3, 40), (1, 1, 0), [0.1, 0.23]
    )
    up, down = np.split(found.wavenumbers, 2, axis=1)
    assert up.shape == (40, 6)
    for place, running in enumerate(found.running):
        assert_allclose(
            np.sort(up[place, running:].imag), np.sort(-down[place, running:].imag), rtol=1e-6
        )
    assert np.all(np.diff(up.imag, axis=1) >= 0.0)


def test_small_losses_are_those_of_the_group_velocity():
    """Im k = loss omega/(2 v): what is left is of third order."""
    phonons = gp.Phonons(bulk("chain", "longitudinal"))
    f = np.array([0.3, 0.6]) * phonons.frequencies([[0.5]])[0, 0]
    k = phonons.complex_bands(f).forward[:, 0].real
    velocity = phonons.modes(k[:, None] * D / (2.0 * np.pi)).group_velocities[:, 0, 0]
    left = [
        np.abs(
            phonons.complex_bands(f, loss_factor=loss).forward[:, 0].imag
            - loss * np.pi * f / velocity
        )
        for loss in (2e-2, 1e-2)
    ]
    assert_allclose(np.log2(left[0] / left[1]), 3.0, atol=0.05)


def test_motions_that_reach_no_other_layer_are_no_waves():
    """Layers of a square lattice without friction: motions along them are not passed on."""
    smooth = gp.AveragedLattice(
        gp.Packing(gp.Material(2e11, 0.3, 7800.0), D, lattice="square", friction=False)
    )
    assert gp.Phonons(smooth.at_force(10.0)).complex_bands([5e3, 20e3], 1).forward.shape == (2, 1)


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (([0.0], 0), "frequencies"),
        (([[1e3]], 0), "frequencies of the shape"),
        (([1e3], 7), "axis"),
        (([1e3], 1, [0.1, 0.2]), "q has the shape"),
        (([np.nan], 0), "frequencies"),
        (([1e300], 0), "up to"),
    ],
)
def test_bad_input_is_one_error(arguments, words):
    with pytest.raises(InputError, match=words):
        gp.Phonons(bulk("triangular")).complex_bands(*arguments)


def test_atoms_of_other_masses_or_in_another_order_are_refused():
    state = gp.AveragedLattice(
        gp.Packing(gp.Material(2.1e11, 0.28, 7800.0), D, lattice="kagome")
    ).at_force(10.0)
    heavy = gp.atoms(state)
    turned = gp.HertzMindlin(state).adopt(gp.atoms(state)[::-1])
    heavy.set_masses(4.0 * heavy.get_masses())
    for cell in (heavy, turned):
        with pytest.raises(InputError, match="another cell"):
            gp.Phonons(state, cell).complex_bands([100.0])
    with pytest.raises(InputError, match="another cell"):  # the numbers of its contacts are others
        gp.Phonons(state, turned).damped([[0.1, 0.2]], damping=np.linspace(0.0, 1e-6, 6))
    found = [
        gp.Phonons(state, cell).damped([[0.1, 0.2]], loss_factor=(0.01, 0.02)).frequencies
        for cell in (heavy, None)
    ]
    assert_allclose(2.0 * found[0], found[1], rtol=1e-6, atol=1e-3)
    # c/k of these dashpots follows from the masses and stiffnesses of the state
    for losses in ({"restitution": 0.9}, {"dashpot": 0.1}):
        with pytest.raises(InputError, match="another cell"):
            gp.Phonons(state, heavy).damped([[0.1, 0.2]], **losses)
        assert np.all(gp.Phonons(state).damped([[0.1, 0.2]], **losses).decay > 0.0)


def test_drag_too_strong_for_digits_is_not_called_a_dashpot():
    with pytest.raises(PrecisionError, match="drag"):
        gp.Phonons(bulk("triangular")).damped([[0.1, 0.2]], drag=(1e13, 0.0))


@pytest.mark.parametrize("lattice", ["chain", "triangular", "honeycomb", "fcc"])
def test_a_decay_that_has_no_digits_is_refused(lattice):
    phonons = gp.Phonons(bulk(lattice) if lattice != "chain" else chain([LIGHT, HEAVY], (K, K)))
    for f in (1e12, 1e18, 1e25):
        told = f"{re.escape(f'{f:g}')} Hz .*decays .*{re.escape('1e+12')}"
        with pytest.raises(PrecisionError, match=told):
            phonons.complex_bands([1e3, f], 0)


def test_motions_that_reach_the_next_layer_alone_are_refused():
    """Across (1 1 1) of diamond every other plane is passed by one bond: three motions of six are
    not passed on there.
    """
    phonons = gp.Phonons(bulk("diamond"))
    for axis in ((1, 1, 1), (1, 1, -1)):
        for f in (5e3, 31e3, 1e9):
            with pytest.raises(
                PrecisionError,
                match=r"infinitely .*axis",
            ):
                phonons.complex_bands([f], axis)
    assert phonons.complex_bands([5e3, 31e3], 0).forward.shape == (2, 3)


@pytest.mark.parametrize("axis", [1, (2, 1)])
def test_a_frequency_that_is_too_high_is_said_to_be(axis):
    for f in (2e8, 3e8, 1e9, 4504341245.538483):
        with pytest.raises(PrecisionError, match=r"decays .*frequencies"):
            gp.Phonons(bulk("honeycomb")).complex_bands([f], axis)


def test_the_fastest_decay_of_a_chain_has_the_digits_that_are_said():
    f = np.array([1e5, 1e6, 3e6])
    found = gp.Phonons(chain([LIGHT, HEAVY], (K, K))).complex_bands(f)
    assert_allclose(
        np.exp(1j * found.forward[:, 0] * found.height),
        np.exp(-np.abs(complex_angles(f).imag)),
        rtol=0,
        atol=3e-15,
    )


def test_a_damping_that_was_meant_as_a_loss_factor():
    """Contacts that are more viscous than stiff at the highest frequency, or in the highest branch,
    are told.
    """
    phonons = gp.Phonons(chain([LIGHT, HEAVY], (K, K)))
    at = [1e3, 2e3]
    waves = phonons.complex_bands(at, damping=0.02)
    assert "at 2000 Hz" in waves.warnings[0]
    assert "251 times" in waves.warnings[0]
    top = np.sqrt(2.0 * K * (1.0 / LIGHT + 1.0 / HEAVY))  # rad/s, at Gamma
    for damping in (0.02, (0.02, 0.01)):
        bands = phonons.damped([[0.0], [0.5]], damping=damping)
        assert f"{0.02 * top:.3g} times" in bands.warnings[0]
    for losses in ({"damping": 0.9 / top}, {"loss_factor": 0.02}, {}):
        assert not phonons.damped([[0.0], [0.5]], **losses).warnings
        assert not phonons.complex_bands(at, **losses).warnings


def test_at_no_frequency_there_are_no_waves():
    half_space = HalfSpace(
        gp.ContactLattice.of("triangular", 0.8).contact_network(gp.Units(1.0, 1.0, 1.0)), 1
    )
    couplings = half_space.couplings(np.array([0.1]))
    assert find_bloch_waves(couplings, np.zeros(0), half_space.size) == []
