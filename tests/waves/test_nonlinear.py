"""Balls that move by the whole contact law: solitary waves, harmonics, impacts, friction, energy,
and the linear limit.
"""

from __future__ import annotations

import inspect
import math
import os
import re
import signal
import subprocess
import sys
import warnings
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from numpy.polynomial import Polynomial
from numpy.testing import assert_allclose
from scipy.integrate import solve_ivp

import granphon as gp
from granphon.base.errors import InputError, LimitWarning, OutputError, StoppedEarlyWarning
from granphon.base.records import RecordFile, lock_file
from granphon.waves import nonlinear
from tests.networks.test_cuts import D, bulk

ROOT = Path(__file__).parents[2]
STEEL = gp.Material(211.65e9, 0.276, 7840.0)


def line(force, balls, periodic=False):
    """A chain of so many balls under a force, whose motions are along it."""
    packing = gp.Packing(STEEL, D, lattice="chain", motions="longitudinal")
    network = gp.AveragedLattice(packing).at_force(force).network.repeat((balls,))
    return network if periodic else network.cut(0, 1)


def push(network, speed, ball=0):
    velocities = np.zeros((network.n_balls, 3))
    velocities[ball, 0] = speed
    return velocities


def passages(motion, contacts):
    """Times and heights of the greatest force of contacts, by polynomials through seven frames."""
    around = np.arange(-3, 4)
    peaks = []
    for contact in contacts:
        frame = int(np.argmax(motion.forces[:, contact]))
        force = Polynomial.fit(around, motion.forces[frame + around, contact], 6)
        roots = force.deriv().roots()
        top = float(roots[np.argmin(np.abs(roots))].real)
        peaks.append((motion.times[frame] + top * motion.times[1], force(top)))
    return np.array(peaks).T


def test_a_ball_that_touches_its_own_images_alone_goes_on_with_a_step_that_is_given():
    network = line(10.0, 1, periodic=True)
    waves = gp.NonlinearWaves(network)
    with pytest.raises(InputError, match="step"):
        waves.run(1e-5, velocities=[[0.1]], frames=3)
    with pytest.raises(InputError, match="step"):
        waves.find_step(0.1)
    motion = waves.run(1e-5, velocities=[[0.1]], frames=3, step=1e-6)
    assert_allclose(motion.displacements[:, 0, 0], 0.1 * motion.times, rtol=1e-12)


# -- waves in chains -------------------------------------------------------------------------------


@pytest.mark.claim("solitary-wave")
def test_a_solitary_wave_of_a_chain_that_is_hardly_pressed():
    """V = 0.90553 d c^(1/3) m^(-1/2) F_m^(1/6); the continuum has 0.89438."""
    network = line(1e-9, 60)
    waves = gp.NonlinearWaves(network)
    motion = waves.run(1.1e-3, velocities=push(network, 0.1), frames=221, step=5e-7)
    times, heights = passages(motion, (30, 50))
    coefficient = network.normal_force[0] / waves.overlap[0] ** 1.5
    speed = 20 * D / (times[1] - times[0])
    assert_allclose(
        speed / (D * coefficient ** (1 / 3) * network.masses[0] ** -0.5 * heights[0] ** (1 / 6)),
        0.90553,
        rtol=5e-5,
    )
    assert_allclose(heights[1], heights[0], rtol=1e-6)


@pytest.mark.claim("solitary-wave")
@pytest.mark.parametrize("speed", [pytest.param(0.1, marks=pytest.mark.slow), 0.3])
def test_pulses_of_a_pressed_chain(speed):
    """V/c of the long-wave theory at r = F_m/F_0, within 0.5 %."""
    network = line(10.0, 260)
    sound = D * np.sqrt(network.normal_stiffness[0] / network.masses[0])
    motion = gp.NonlinearWaves(network).run(
        170 * D / sound, velocities=push(network, speed), frames=341
    )
    times, heights = passages(motion, (120, 160))
    r = heights[0] / 10.0
    wanted = np.sqrt(4.0 / 15.0 * (3.0 + 2.0 * r ** (5.0 / 3.0) - 5.0 * r ** (2.0 / 3.0))) / (
        r ** (2.0 / 3.0) - 1.0
    )
    assert 1.3 < r < 4.0
    assert_allclose(40 * D / (times[1] - times[0]) / sound, wanted, rtol=5e-3)


@pytest.mark.claim("second-harmonic")
@pytest.mark.parametrize(
    ("count", "ramp", "balls", "frames"),
    [(120, 10, (5, 10), 16), pytest.param(400, 30, (5, 10, 20), 32, marks=pytest.mark.slow)],
)
def test_the_second_harmonic_of_a_shaker(count, ramp, balls, frames):
    """A^2/(4 delta) cot(qd/2) |sin((q(2w) - 2q) n d/2)| at the ball n, before the far end answers.

    The amplitude rises for as many periods as ``ramp``, and is heard after as many more, with so
    many ``frames`` in each.
    """
    network = line(10.0, count)
    qd = 0.6
    waves = gp.NonlinearWaves(network)
    delta = waves.overlap[0]
    rate = np.sqrt(network.normal_stiffness[0] / network.masses[0])
    omega = 2.0 * rate * math.sin(0.5 * qd)
    period = 2.0 * math.pi / omega
    size = 3e-3 * delta

    def shake(time):
        share = 0.5 * (1.0 - math.cos(math.pi * min(time / (ramp * period), 1.0)))
        return size * share * math.sin(omega * time)

    drive = gp.Drive(0, (1, 0, 0), displacement=shake)
    motion = waves.run(2 * ramp * period, drive=drive, frames=2 * ramp * frames + 1)
    balls = np.array(balls)
    last = slice(-5 * frames - 1, -1)
    tone = np.exp(-2j * omega * motion.times[last])[:, None]
    twice = 2.0 * np.abs(np.mean(motion.displacements[last, balls, 0] * tone, axis=0))
    beat = 2.0 * math.asin(omega / rate) - 2.0 * qd
    growth = np.abs(np.sin(0.5 * beat * balls))
    expected = size**2 / (4.0 * delta) / math.tan(0.5 * qd) * growth
    assert_allclose(twice, expected, rtol=3e-4)
    # the work of the shaker is the energy of the chain
    assert_allclose(motion.work[-1], motion.energy[-1], rtol=2e-4)
    shaken = [shake(time) for time in motion.times]
    assert_allclose(motion.displacements[:, 0, 0], shaken, rtol=1e-12)


@pytest.mark.parametrize(
    "exponent", [1.5, *(pytest.param(one, marks=pytest.mark.slow) for one in (2.0, 3.0))]
)
def test_frequency_of_a_travelling_wave_over_its_amplitude(exponent):
    """d omega/omega = (A/delta)^2 (a-1)/4 [(a-1) cos^2(qd/2) + (a-2) sin^2(qd/2)]; cos(qd)/16 for
    Hertz.
    """
    count = 6
    network = line(10.0, count, periodic=True)
    waves = gp.NonlinearWaves(network, gp.PowerLaw(exponent, 1.0))
    qd = 2.0 * math.pi / count
    delta = waves.overlap[0]
    omega = 2.0 * np.sqrt(network.normal_stiffness[0] / network.masses[0]) * math.sin(0.5 * qd)
    place = np.arange(count)
    out = []
    periods = 20
    for share in (1e-4, 0.04):
        start = np.zeros((count, 3))
        speed = np.zeros((count, 3))
        start[:, 0], speed[:, 0] = (
            share * delta * np.cos(qd * place),
            share * delta * omega * np.sin(qd * place),
        )
        motion = waves.run(
            periods * 2.0 * math.pi / omega,
            displacements=start,
            velocities=speed,
            frames=periods * 6 + 1,
        )
        phase = np.unwrap(np.angle(motion.displacements[:, :, 0] @ np.exp(-1j * qd * place)))
        out.append(np.polyfit(motion.times, phase, 1)[0] / -omega)
    wanted = (
        0.25
        * (exponent - 1.0)
        * ((exponent - 1.0) * math.cos(0.5 * qd) ** 2 + (exponent - 2.0) * math.sin(0.5 * qd) ** 2)
    )
    assert_allclose((out[1] - out[0]) / 0.04**2, wanted, rtol=0.03)


@pytest.mark.claim("amplitude-shift")
@pytest.mark.parametrize("exponent", [1.5, 2.0, 3.0])
@pytest.mark.parametrize("cell", [1, 2])
def test_amplitude_shift_of_a_chain_in_closed_form(exponent, cell):
    for angle in (0.3, 1.1, 2.0):
        network = line(10.0, cell, periodic=True)
        found = gp.amplitude_shift(
            network, [cell * angle / (2.0 * math.pi)], 0, gp.PowerLaw(exponent, 1.0)
        )
        cosine = math.cos(0.5 * angle) ** 2
        rest = exponent - 1.0
        wanted = 0.25 * rest * (rest * cosine + (exponent - 2.0) * (1.0 - cosine))
        if cell * angle < math.pi:  # the lowest branch, as long as it is not folded
            assert_allclose(found, wanted, rtol=1e-11)


def test_balls_that_only_touch_have_no_amplitude_shift():
    ball = gp.Ball(gp.Material(211.65e9, 0.276, 7840.0), 8e-3)
    with pytest.raises(InputError, match="overlap"):
        gp.amplitude_shift(gp.Crystal.on("chain", [ball]), [0.2])


@pytest.mark.claim("amplitude-shift")
def test_amplitude_shift_of_a_plane_in_time():
    """The upper branch of a triangular array without friction: the run has the shift of
    perturbation.
    """
    network = bulk("triangular")
    count = 6
    network = replace(network, shear_stiffness=np.zeros(network.n_contacts))
    wanted = gp.amplitude_shift(network, [1.0 / count, 0.0], 1)
    modes = gp.Phonons(network).modes([[1.0 / count, 0.0]])
    omega = 2.0 * math.pi * modes.frequencies[0, 1]
    shape = modes.eigenvectors[0, :, 1]
    array = network.repeat((count, 2))
    waves, phases = (
        gp.NonlinearWaves(array),
        np.exp(1j * array.positions[:, :2] @ modes.wavevectors[0]),
    )
    shape = shape / np.linalg.norm(shape)
    out = []
    for share in (1e-4, 0.04):
        wave = share * waves.overlap[0] * phases[:, None] * shape
        start, speed = np.zeros((2, array.n_balls, 3))
        start[:, :2], speed[:, :2] = wave.real, (-1j * omega * wave).real
        motion = waves.run(
            20.0 * 2.0 * math.pi / omega, displacements=start, velocities=speed, frames=20 * 6 + 1
        )
        phase = np.unwrap(
            np.angle(np.einsum("fna,na->f", motion.displacements[:, :, :2], wave.conj()))
        )
        out.append(-np.polyfit(motion.times, phase, 1)[0] / omega)
    assert_allclose((out[1] - out[0]) / 0.04**2, wanted, rtol=0.05)


@pytest.mark.claim("amplitude-shift")
def test_amplitude_shift_of_balls_that_go_in_circles():
    """At K of a honeycomb of unlike balls one kind alone moves, in circles of radius A: -1/64, and
    1/192 by 2 omega.
    """
    kinds = [gp.Ball(STEEL, D, name="A"), gp.Ball(STEEL, D, name="B", mass=1e-3)]
    state = gp.Crystal.on("honeycomb", kinds, friction=False).at_force(10.0)
    for branch in (1, 2):
        assert_allclose(gp.amplitude_shift(state, [1 / 3, 1 / 3], branch), -1.0 / 96.0, rtol=1e-10)


def test_no_contact_is_stretched_out_of_the_plane():
    assert gp.amplitude_shift(bulk("triangular", "out_of_plane"), [0.2, 0.1], 2) == 0.0


def test_waves_without_an_amplitude_shift_are_refused():
    network = line(10.0, 1, periodic=True)
    for q, words in (
        ([0.0], "costs nothing"),
        ([0.1, 0.2], "shape"),
        ([0.1, 0.2, 0.0], "beyond the first 1"),
        ([np.nan], "not finite"),
    ):
        with pytest.raises(InputError, match=words):
            gp.amplitude_shift(network, q)
    with pytest.raises(InputError, match="branch"):
        gp.amplitude_shift(network, [0.1], 5)
    with pytest.raises(InputError, match="does not repeat"):
        gp.amplitude_shift(line(10.0, 5), [0.1])
    twist = gp.AveragedLattice(
        gp.Packing(STEEL, D, lattice="chain", motions="all", torsion=0.02)
    ).at_force(10.0)
    with pytest.raises(InputError, match="only turn"):
        gp.amplitude_shift(twist, [0.2], 2)


def test_an_amplitude_shift_that_memory_does_not_hold_is_refused(memory, monkeypatch):
    four_balls = line(10.0, 4, periodic=True)
    five_balls = line(10.0, 5, periodic=True)
    monkeypatch.setattr("granphon.base.memory._ASSUMED_MEMORY", 0.0)
    memory(4 * 4**2 * 16.0)  # four complex matrices of four motions
    gp.amplitude_shift(four_balls, [0.1])
    with pytest.raises(InputError, match="dense matrices of 5 motions"):
        gp.amplitude_shift(five_balls, [0.1])


# -- contacts --------------------------------------------------------------------------------------


def test_two_balls_that_meet():
    """They are in touch for 2.94326 (5 m*/(4 c))^(2/5) v^(-1/5), and exchange their velocities."""
    network = line(1e-12, 2)
    speed = 0.2
    waves = gp.NonlinearWaves(network)
    coefficient = network.normal_force[0] / waves.overlap[0] ** 1.5
    reduced = 0.5 * network.masses[0]
    touch = 2.94326 * (1.25 * reduced / coefficient) ** 0.4 * speed**-0.2
    motion = waves.run(
        1.5 * touch, velocities=push(network, speed), frames=301, step=1.5 * touch / 3000
    )
    # the overlap falls in a straight line to its end
    last = np.flatnonzero(motion.forces[:, 0] > 1e-9)[-2:]
    overlaps = motion.forces[last, 0] ** (2.0 / 3.0)
    end = motion.times[last] @ [-overlaps[1], overlaps[0]] / (overlaps[0] - overlaps[1])
    assert_allclose(end, touch, rtol=1e-3)
    most = coefficient * (1.25 * reduced / coefficient * speed**2) ** 0.6
    assert_allclose(passages(motion, [0])[1], most, rtol=1e-4)
    assert_allclose(motion.velocities[-1, :, 0], [0.0, speed], atol=1e-6)
    assert motion.forces[-1, 0] == 0.0


def test_a_damped_ball_between_two_that_are_held():
    network = line(10.0, 3)
    network = replace(network, masses=np.where([True, False, True], np.inf, network.masses))
    k = network.normal_stiffness[0]
    mass = network.masses[1]
    tau = 2e-6
    motion = gp.NonlinearWaves(network, damping=tau).run(
        2e-3, velocities=push(network, 1e-6, 1), frames=201
    )
    own = math.sqrt(2.0 * k / mass)
    rate = tau * k / mass
    shaken = math.sqrt(own**2 - rate**2)
    wanted = 1e-6 / shaken * np.exp(-rate * motion.times) * np.sin(shaken * motion.times)
    assert_allclose(motion.displacements[:, 1, 0], wanted, atol=2e-3 * np.max(wanted))
    assert_allclose(motion.energy + motion.lost, motion.energy[0], rtol=2e-3)
    assert motion.lost[-1] > 0.9 * motion.energy[0]


def test_slip_follows_mindlin_and_ends_at_coulombs_limit():
    """A held ball is moved slowly across a contact with one that is held too: T = k_t s up to mu
    f.
    """
    packing = gp.Packing(STEEL, D, lattice="chain", motions="in_plane")
    network = gp.AveragedLattice(packing).at_force(10.0).network.repeat((3,)).cut(0, 1)
    network = replace(network, masses=np.where([True, True, False], np.inf, network.masses))
    waves = gp.NonlinearWaves(network, friction_coefficient=0.1)
    mu = 0.1
    way = 2.0 * mu * 10.0 / network.shear_stiffness[0]

    def move(time):
        return way * time / 1e-4

    motion = waves.run(1e-4, drive=gp.Drive(1, (0, 1, 0), displacement=move), frames=21)
    slip = np.array([move(time) for time in motion.times])
    assert_allclose(
        motion.shears[:, 0],
        np.minimum(network.shear_stiffness[0] * slip, mu * 10.0),
        rtol=1e-9,
        atol=1e-12,
    )


@pytest.mark.parametrize("mu", [pytest.param(math.inf, marks=pytest.mark.slow), 0.2])
def test_energy_and_momentum_of_an_array_that_is_hit(mu):
    """Contacts open and slide; what is left of the energy is what was lost, and more with
    friction.
    """
    network = bulk("triangular").repeat((4, 4)).cut(1, 1)
    random = np.random.default_rng(0)
    velocities = 0.5 * random.standard_normal((network.n_balls, 2))
    velocities -= velocities.mean(axis=0)
    motion = gp.NonlinearWaves(network, friction_coefficient=mu).run(
        5e-4, velocities=velocities, frames=11
    )
    assert np.any(motion.forces == 0.0)
    assert_allclose((motion.energy + motion.lost) / motion.energy[0], 1.0, atol=1e-4)
    momentum = np.einsum("n,fnc->fc", network.masses, motion.velocities)
    assert np.max(np.abs(momentum)) < 1e-12 * network.masses.sum() * 0.5
    assert np.all(np.diff(motion.lost) > -1e-9 * motion.energy[0])


def smooth():
    """A small periodic array without friction, and random velocities."""
    network = bulk("triangular", "in_plane").repeat((3, 3))
    network = replace(network, shear_stiffness=np.zeros(network.n_contacts))
    return gp.NonlinearWaves(network), 0.02 * np.random.default_rng(1).standard_normal(
        (network.n_balls, 2)
    )


def test_time_runs_backwards():
    waves, velocities = smooth()
    there = waves.run(5e-4, velocities=velocities, frames=2)
    end = {"displacements": there.displacements[-1], "velocities": -there.velocities[-1]}
    back = waves.run(5e-4, **end, frames=2, step=there.step)
    assert_allclose(back.velocities[-1, :, :2], -velocities, atol=1e-9 * np.abs(velocities).max())


@pytest.mark.exhaustive
@pytest.mark.claim("nonlinear-drift")
def test_the_energy_does_not_drift():
    """Over more than 1e5 steps; the least squares line rises by less than 1e-6."""
    waves, velocities = smooth()
    there = waves.run(5e-2, velocities=velocities, frames=2001)
    assert there.times[-1] / there.step > 1e5
    level = there.energy / there.energy[0] - 1.0
    assert abs(np.polyfit(there.times / there.times[-1], level, 1)[0]) < 1e-6


@pytest.mark.exhaustive
@pytest.mark.claim("nonlinear-drift")
def test_the_energy_does_not_drift_where_contacts_open():
    """With a sixth of the step, over 1e5 of them."""
    network = bulk("triangular", "in_plane").repeat((6, 6))
    waves = gp.NonlinearWaves(replace(network, shear_stiffness=np.zeros(network.n_contacts)))
    rises = []
    for seed in range(4):
        velocities = 0.5 * np.random.default_rng(seed).standard_normal((network.n_balls, 2))
        step = waves.find_step(0.5) / 6.0
        motion = waves.run(
            1e5 * step, velocities=velocities - velocities.mean(axis=0), frames=2001, step=step
        )
        assert np.mean(motion.forces == 0.0) > 0.1
        rises.append(
            np.polyfit(motion.times / motion.times[-1], motion.energy / motion.energy[0], 1)[0]
        )
    assert np.max(np.abs(rises)) < 1e-6


@pytest.mark.exhaustive
def test_the_sum_of_energies_wanders_where_contacts_open():
    """Its mean changes by some 3e-5 in these 8,000."""
    waves, velocities = smooth()
    changes = []
    for scale in (20.0, 25.0, 30.0):
        step = waves.find_step(2.0 * scale * 0.02)
        motion = waves.run(2e-3, velocities=scale * velocities, frames=401, step=step)
        assert motion.times[-1] / motion.step < 8_500
        assert np.mean(motion.forces == 0.0) > 0.05
        level = motion.energy / motion.energy[0] - 1.0
        changes.append(np.mean(level[-100:]) - np.mean(level[:100]))
    assert 1e-6 < np.sqrt(np.mean(np.square(changes))) < 1e-4


@pytest.mark.claim("nonlinear-linear")
@pytest.mark.parametrize(
    ("lattice", "motions"), [("triangular", None), ("triangular", "out_of_plane"), ("fcc", None)]
)
def test_small_motions_are_modes(lattice, motions):
    """Out of the plane no contact is stretched: all of its stiffness is that against slip."""
    cell = bulk(lattice, motions)
    network = cell.repeat((4,) * cell.dimension).cut(1, 1)
    modes = gp.Waves(network).modes(5)
    number = 3
    waves, axes = gp.NonlinearWaves(network), list(network.ball_motions.translations)
    shape = modes.vectors[number]
    start, turn = np.zeros((2, network.n_balls, 3))
    start[:, axes] = shape[:, : len(axes)] / np.sqrt(network.masses)[:, None]
    turn[:, list(network.ball_motions.rotations)] = (
        shape[:, len(axes) :] / np.sqrt(network.inertias)[:, None]
    )
    size = 1e-6 * waves.overlap[0] / np.abs(start).max()
    period = 1.0 / modes.frequencies[number]
    motion = waves.run(period, displacements=size * start, rotations=size * turn, frames=9)
    cosine = np.cos(2.0 * math.pi * motion.times / period)
    for found, one, unit in ((motion.displacements, start, 1.0), (motion.rotations, turn, 2.0 / D)):
        assert_allclose(
            found, size * cosine[:, None, None] * one, atol=1e-4 * unit * size * np.abs(start).max()
        )


@pytest.mark.claim("nonlinear-linear")
def test_a_small_pulse_is_the_one_that_is_transmitted():
    """The difference falls with the square of the step, and is below 1e-4 at a sixth of the default
    one.
    """
    network = bulk("triangular", "in_plane").repeat((2, 6)).cut(1, 1)
    hertz = 12e3
    cycles = 1.0
    size = 1e-6
    pulse = gp.Waves(network).transmit(
        hertz, (0, 1), 2.0 * D, cycles, source="ball", duration=7e-5, ends="periodic"
    )
    burst = 2.0 * math.pi * cycles  # its phase, in all

    def force(time):
        phase = 2.0 * math.pi * hertz * time
        return (
            size * math.sin(phase - 0.5 * burst) * 0.5 * (1.0 - math.cos(phase / cycles))
            if phase < burst
            else 0.0
        )

    waves, drive, differ = (
        gp.NonlinearWaves(network),
        gp.Drive(list(pulse.sources), (0, 1), force=force),
        [],
    )
    for part in (3, 6):
        motion = waves.run(
            pulse.times[-1], drive=drive, frames=len(pulse.times), step=waves.find_step() / part
        )
        heard = motion.velocities[:, pulse.receivers, 1].T / size
        differ.append(np.abs(heard - pulse.signals).max() / np.abs(pulse.signals).max())
    assert differ[1] < 1e-4
    assert differ[0] / differ[1] == pytest.approx(4.0, rel=0.1)


TABLE = np.geomspace(1e-9, 1e-5, 9)


def make_laws():
    """Laws in closed form, of a table and of contacts that adhere, by name."""
    return {
        "Hertz": gp.Hertz(),
        "power": gp.PowerLaw(2.0, 1e13),
        "table": gp.TabulatedLaw(TABLE, 1e10 * TABLE**1.5),
        "DMT": gp.DMT(0.5),
        "JKR": gp.JKR(0.5),
    }


@pytest.mark.parametrize("swings", [1.0, pytest.param(20.0, marks=pytest.mark.slow)])
@pytest.mark.parametrize(
    ("name", "share"),
    [
        ("Hertz", 1e-6),
        ("Hertz", 0.1),
        ("power", 0.1),
        pytest.param("table", 0.1, marks=pytest.mark.slow),
        ("DMT", 0.1),
        ("JKR", 1e-3),
        pytest.param("JKR", 0.1, marks=pytest.mark.slow),
    ],
)
def test_energies_of_motions_much_smaller_than_overlaps(name, share, swings):
    """They are no differences of large ones; and steps of the midpoint scheme, as long as those of
    the other, find them.
    """
    law = make_laws()[name]
    chain = gp.Crystal.on("chain", [gp.Ball(STEEL, D)], law=law, motions="longitudinal")
    waves = gp.NonlinearWaves(chain.cut(0, 5, edges=("clamped", "free")).at_overlap(1e-7))
    rate = math.sqrt(waves.network.normal_stiffness[0] / waves.network.masses[-1])
    velocities = push(waves.network, share * 1e-7 * rate, 2)
    duration = swings / rate
    motion = waves.run(duration, velocities=velocities, frames=11, scheme="midpoint")
    assert_allclose(motion.energy, motion.energy[0], rtol=1e-9 / share**0.5)
    explicit = waves.run(duration, velocities=velocities, frames=11)
    assert 0.5 * motion.step < explicit.step


def test_a_step_that_divides_a_frame_is_taken_as_it_is():
    glass = gp.Ball(gp.Material(70e9, 0.22, 2500.0), 8e-3)
    waves = gp.NonlinearWaves(gp.Crystal.on("chain", [glass]).at_force(10.0).network.cut(0, 3))
    for frames in (6, 10, 19):  # 50 steps in a frame, by a quotient that rounds to more than 50
        step = 1e-3 / (frames - 1) / 50
        motion = waves.run(1e-3, velocities=push(waves.network, 1e-3), frames=frames, step=step)
        assert_allclose(motion.step, step, rtol=1e-11)


@pytest.mark.parametrize(
    ("share", "duration"),
    [(1.0005, 1e-7), *(pytest.param(x, 4e-7, marks=pytest.mark.slow) for x in (0.55, 1.0001))],
)
def test_implicit_steps_go_on_where_a_contact_that_adheres_just_parts(share, duration):
    """Steps end where its force falls to zero, and the sum of energies and losses stays to
    rounding. The share is that of the speed at which the balls part.
    """
    glass = gp.Ball(gp.Material(70e9, 0.22, 2500.0), 1e-5)
    law = gp.JKR(0.05)
    waves = gp.NonlinearWaves(gp.Crystal.on("chain", [glass], law=law).cut(0, 2))
    contact = law.between(glass, glass)
    depth = contact.energy(contact.least_overlap) - contact.energy(waves.overlap[0])
    speed = share * math.sqrt(depth / glass.mass)
    velocities = push(waves.network, speed, 1) - push(waves.network, speed, 0)
    frames = round(duration / 1e-8) + 1
    start = {"velocities": velocities, "frames": frames, "step": 2e-9}
    motion = waves.run(duration, **start, scheme="midpoint")
    assert_allclose(motion.energy + motion.lost, motion.energy[0], rtol=1e-11)
    assert np.all(np.abs(motion.lost) < 1e-6 * motion.energy[0])
    assert (motion.forces[-1, 0] == 0.0) == (share > 1.0)
    explicit = waves.run(duration, **start)
    assert_allclose(motion.displacements[1], explicit.displacements[1], rtol=0.02)


def test_an_implicit_step_without_a_solution_ends_the_motion():
    """Balls that move against each other, in steps of a quarter of their period."""
    waves = gp.NonlinearWaves(line(10.0, 6, periodic=True))
    velocities = 1e-3 * np.outer((-1.0) ** np.arange(6), [1.0])
    step = 0.999 * 15.0 * waves.find_step()
    with pytest.warns(StoppedEarlyWarning, match="no solution"):
        waves.run(100.0 * step, velocities=velocities, frames=101, step=step, scheme="midpoint")


# -- refusals --------------------------------------------------------------------------------------


def test_a_ball_that_flies_off_and_a_step_too_long():
    """What there is until then is returned, with one warning."""
    waves = gp.NonlinearWaves(line(1e-9, 4))
    with pytest.warns(StoppedEarlyWarning, match="left its place") as told:
        motion = waves.run(2e-3, velocities=push(waves.network, -5.0), frames=201)
    assert len(told) == 1
    assert 50 < len(motion.times) < 100
    with pytest.raises(InputError, match=r"1e-05 s .*too long"):
        waves.run(1e-3, velocities=push(waves.network, 1.0), step=1e-5, frames=11)
    with pytest.raises(InputError, match="too short"):
        waves.run(5e-324, velocities=push(waves.network, 1.0), frames=101)


@pytest.mark.parametrize("speed", [0.0, 1.0])
def test_the_step_of_a_run_is_known_before(speed):
    waves = gp.NonlinearWaves(line(10.0, 4))
    motion = waves.run(1e-4, velocities=push(waves.network, speed), frames=2)
    assert_allclose(motion.step, 1e-4 / math.ceil(1e-4 / waves.find_step(speed)), rtol=1e-12)
    assert waves.find_step(1.0) < waves.find_step()


@pytest.mark.claim("nonlinear-drive")
@pytest.mark.parametrize(
    ("frames", "ground", "losses"),
    [(2, 0.0, {}), (41, 0.0, {}), (2, 1e7, {"drag": 2e3, "dashpot": 20.0})],
    ids=str,
)
@pytest.mark.parametrize("scheme", ["verlet", pytest.param("midpoint", marks=pytest.mark.slow)])
def test_the_step_follows_what_a_drive_presses(frames, scheme, ground, losses):
    """Three balls that only touch, pushed by a force: as SciPy integrates them, however few the
    frames; alone, or held by springs to the ground and with losses.
    """
    ball = gp.Ball(STEEL, D)
    chain = gp.Crystal.on("chain", [ball], on_site=ground).cut(0, 3)
    waves = gp.NonlinearWaves(chain, **losses)
    duration = 3e-4

    def push_first(time):
        return 100.0 * math.sin(1e4 * time) ** 2

    motion = waves.run(
        duration, drive=gp.Drive(0, (1, 0, 0), force=push_first), frames=frames, scheme=scheme
    )
    modulus = STEEL.young_modulus / (1.0 - STEEL.poisson_ratio**2)
    coefficient = modulus * math.sqrt(D) / 3.0  # (4/3) E* (d/4)^(1/2), with E* half the modulus

    def accelerate(time, state):
        overlaps = -np.diff(state[:3])
        forces = coefficient * np.maximum(overlaps, 0.0) ** 1.5
        forces -= np.where(overlaps > 0.0, losses.get("dashpot", 0.0), 0.0) * np.diff(state[3:])
        pushes = np.array([push_first(time) - forces[0], forces[0] - forces[1], forces[1]])
        resistance = ground * state[:3] + ball.mass * losses.get("drag", 0.0) * state[3:]
        return np.concatenate([state[3:], (pushes - resistance) / ball.mass])

    exact = solve_ivp(accelerate, (0.0, duration), np.zeros(6), rtol=1e-8, atol=1e-14)
    speeds = exact.y[3:, -1]
    assert_allclose(motion.velocities[-1, :, 0], speeds, atol=1e-3 * np.max(np.abs(speeds)))
    if frames > 2:
        heights = coefficient * np.max(np.maximum(-np.diff(exact.y[:3], axis=0), 0.0) ** 1.5)
        assert_allclose(motion.forces.max(), heights, rtol=2e-2)
    # the force known beforehand gives the step of that order at once
    assert 0.5 < waves.find_step(force=100.0) / motion.step < 3.0


@pytest.mark.parametrize("ground", [0.0, 2e6])
@pytest.mark.parametrize(
    "losses",
    [
        {},
        {"damping": (2e-7, 5e-7)},
        {"restitution": 0.4},
        {"damping": 1e-7, "dashpot": (15.0, 4.0), "restitution": 0.6, "drag": (3e2, 1e2)},
    ],
    ids=lambda losses: ",".join(losses) or "none",
)
def test_the_stiffness_that_a_step_allows_is_the_greatest(losses, ground):
    """The bounds of all rates are met with it, and one of them not with a little more."""
    network = bulk("triangular").repeat((3, 3))
    masses = network.masses * np.linspace(0.5, 2.0, network.n_balls)
    springs = np.full((network.n_balls, 3), ground)
    network = replace(network, masses=masses, on_site=springs if ground else None)
    waves = gp.NonlinearWaves(network, **losses)
    bound = nonlinear._System(waves, []).bound
    ones = np.ones(network.n_contacts)
    top = bound.find(network.normal_stiffness)
    allowed = [
        bound.find_allowed(frequency * top, viscous * top, waves.losses)
        for frequency, viscous in ((2.0, 1e9), (1e9, 0.5), (2.0, 0.5))
    ]
    for stiffness, frequency, viscous in zip(
        allowed, (2.0, 1e9, 2.0), (1e9, 0.5, 0.5), strict=True
    ):
        if math.isinf(stiffness):  # nothing slows motions down
            assert not losses
            continue

        def is_within(factor, stiffness=stiffness, frequency=frequency, viscous=viscous):
            springs = factor * stiffness * ones
            slowed = bound.find_viscous(springs, waves.losses)
            return bound.find(springs) <= frequency * top and slowed <= viscous * top

        assert is_within(1.0 - 1e-12)
        assert not is_within(1.0 + 1e-12)
    assert allowed[2] == min(allowed[:2])
    if ground or "drag" in losses:
        assert bound.find_allowed(1e-3, 1e-3, waves.losses) == 0.0


def test_a_drive_known_beforehand_gives_the_step():
    """A stiffness of Hertz's law goes with the force to the third root, a rate with its root."""
    waves = gp.NonlinearWaves(gp.Crystal.on("chain", [gp.Ball(STEEL, D)]).cut(0, 3))
    soft, hard = (waves.find_step(force=force) for force in (1.0, 64.0))
    assert_allclose(soft / hard, 2.0, rtol=1.25**0.25 - 1.0)  # depths are 1.25 times as deep
    shallow, deep = (waves.find_step(displacement=depth) for depth in (1e-8, 1.6e-7))
    assert_allclose(shallow / deep, 2.0, rtol=1e-12)
    for name in ("force", "displacement"):
        with pytest.raises(InputError, match=name):
            waves.find_step(**{name: -1.0})


def interrupt(time):
    """A force that the user stops."""
    if time > 5e-5:
        raise KeyboardInterrupt
    return 1.0


def test_a_drive_that_is_no_number_ends_the_run():
    waves = gp.NonlinearWaves(line(10.0, 4))
    for kind in ("force", "displacement"):
        drive = gp.Drive(0, (1, 0, 0), **{kind: lambda time: math.nan if time > 5e-5 else 0.0})
        with pytest.warns(StoppedEarlyWarning, match="finite"):
            motion = waves.run(1e-4, drive=drive, frames=101)
        assert 45 < len(motion.times) < 55
        assert np.all(np.isfinite(motion.velocities))
    for nothing in (math.nan, None):
        with pytest.raises(InputError, match=r"finite .*\b0 s"):
            waves.run(1e-4, drive=gp.Drive(0, (1, 0, 0), force=lambda _, it=nothing: it))
    still = gp.Drive((0, 1), (1, 0, 0), displacement=lambda _: 0.0)
    for other in (still, gp.Drive(1, (1, 0, 0), force=lambda _: 0.0)):
        with pytest.raises(InputError, match="two drives"):
            waves.run(1e-4, drive=[still, other])


def test_a_displacement_need_not_be_known_after_the_end():
    waves = gp.NonlinearWaves(line(10.0, 4))

    def shake(time):
        return 1e-9 * math.sin(1e5 * time)

    def shake_to_the_end(time):
        return shake(time) if time < 1.0000001e-4 else math.nan

    drive = gp.Drive(0, (1, 0, 0), displacement=shake_to_the_end)
    motion = waves.run(1e-4, drive=drive, frames=11)
    whole = waves.run(1e-4, drive=replace(drive, displacement=shake), frames=11)
    assert_allclose(motion.displacements, whole.displacements, rtol=1e-14)
    speeds = motion.velocities[:, 0, 0]
    assert_allclose(speeds, 1e-4 * np.cos(1e5 * motion.times), atol=1e5 * 1e-4 * motion.step)
    assert_allclose(speeds[:-1], whole.velocities[:-1, 0, 0], rtol=1e-14)


def run_into(path, force):
    """The motion of a chain whose first ball is pushed, 101 frames of 1 us, in a file."""
    waves = gp.NonlinearWaves(line(10.0, 4))
    return waves.run(1e-4, drive=gp.Drive(0, (1, 0, 0), force=force), frames=101, file=path)


def test_ctrl_c_keeps_what_there_is(tmp_path):
    with pytest.warns(StoppedEarlyWarning, match="Ctrl-C"):
        motion = run_into(tmp_path / "motion.nc", interrupt)
    assert 45 < len(motion.times) < 55
    assert gp.Motion.read(tmp_path / "motion.nc") == motion


def test_ctrl_c_before_the_first_frame_ends_the_program(tmp_path, monkeypatch):
    def press(*_):
        raise KeyboardInterrupt

    waves, drive = gp.NonlinearWaves(line(10.0, 4)), gp.Drive(0, (1, 0, 0), force=press)
    with pytest.raises(KeyboardInterrupt):
        waves.run(1e-4, drive=drive, file=tmp_path / "motion.nc")
    monkeypatch.setattr("granphon.waves.motion._begin_file", press)
    with pytest.raises(KeyboardInterrupt):
        waves.run(1e-4, file=tmp_path / "motion.nc")
    assert not list(tmp_path.iterdir())


def test_only_a_motion_is_replaced(tmp_path):
    waves = gp.NonlinearWaves(line(10.0, 4))
    path = tmp_path / "motion.nc"
    other = tmp_path / "data.csv"
    for duration in (1e-5, 2e-5):
        waves.run(duration, frames=3, file=path)
        assert gp.Motion.read(path).times[-1] == pytest.approx(duration)
    other.write_text("1, 2")
    with pytest.raises(OutputError, match="no motion"):
        waves.run(1e-5, file=other)
    assert other.read_text() == "1, 2"
    with pytest.raises(OutputError, match="no motion"):
        waves.run(1e-5, file=tmp_path)


def test_only_a_motion_is_written_over(tmp_path):
    """One check for both ways to write; what cannot be written leaves no part of a file."""
    waves = gp.NonlinearWaves(line(10.0, 4))
    path = tmp_path / "motion.nc"
    other = tmp_path / "mine.nc"
    other.write_text("mine")
    waves.run(1e-5, frames=3, file=path)
    motion = gp.Motion.read(path)
    motion.write(path)  # whose arrays lie in this very file
    assert gp.Motion.read(path) == waves.run(1e-5, frames=3)
    with pytest.raises(OutputError, match="no motion"):
        motion.write(other)
    assert other.read_text() == "mine"
    for write in (motion.write, lambda file: waves.run(1e-5, file=file)):
        for nothing in ("", 5, "a\0b"):
            with pytest.raises(InputError, match="file of a motion"):
                write(nothing)
        with pytest.raises(OutputError, match="cannot be written"):
            write(other / "motion.nc")
        with open(path, "rb") as file:
            lock_file(file)
            with pytest.raises(OutputError, match=r"writing .*motion.nc"):
                write(path)
        write(tmp_path / "made" / "motion.nc")
        (tmp_path / "made" / "motion.nc").unlink()
    assert {one.name for one in tmp_path.iterdir()} == {"motion.nc", "mine.nc", "made"}


@pytest.mark.skipif(not os.path.exists("/dev/full"), reason="no device that is always full")
def test_a_disk_that_is_full_is_one_error(tmp_path, monkeypatch):
    """The first frame goes into a file, and what comes after it to a device that takes nothing."""
    waves = gp.NonlinearWaves(line(10.0, 4))
    path = tmp_path / "motion.nc"
    append = RecordFile.append

    def fill(self, values):
        if self._count == 3:
            self._file.flush()
            with open("/dev/full", "wb") as full:
                os.dup2(full.fileno(), self._file.fileno())
        append(self, values)

    monkeypatch.setattr(RecordFile, "append", fill)
    with pytest.raises(OutputError, match=r"motion.nc cannot .*before"):
        waves.run(1e-5, frames=9, file=path)
    assert len(gp.Motion.read(path).times) == 3


def test_whole_frames_of_a_file_that_was_cut(tmp_path):
    waves = gp.NonlinearWaves(line(10.0, 4))
    path = tmp_path / "motion.nc"
    whole = waves.run(1e-5, velocities=push(waves.network, 0.1), frames=41)
    whole.write(path)
    data = path.read_bytes()
    path.write_bytes(data[: len(data) * 3 // 4])
    with pytest.warns(StoppedEarlyWarning, match=r"motion.nc .*cut.* of .*41"):
        part = gp.Motion.read(path)
    assert 20 < len(part.times) < 35
    for name in ("times", "displacements", "forces"):
        assert np.array_equal(getattr(part, name), getattr(whole, name)[: len(part.times)])
    path.write_bytes(data[:500])
    with pytest.raises(InputError, match="records"):
        gp.Motion.read(path)
    with pytest.raises(InputError, match="frames is 3"):
        gp.Motion.read(path, frames=3)


def test_contacts_that_become_wider_than_their_law_allows():
    """Two balls that meet at the speed v: overlap^(5/2) = 5 m v^2/8 c (K. L. Johnson, 1985), at the
    centre of mass.
    """
    network = replace(line(1e-6, 2), motions="longitudinal")
    waves = gp.NonlinearWaves(network)
    c = network.normal_force[0] / waves.overlap[0] ** 1.5
    for speed, wide in ((0.5, False), (30.0, True)):
        depth = (0.625 * network.masses[0] * speed**2 / c) ** 0.4
        with warnings.catch_warnings(record=True) as told:
            warnings.simplefilter("always")
            waves.run(8.0 * depth / speed, velocities=push(network, speed), frames=301)
        assert len(told) == wide
        if wide:
            assert told[0].category is LimitWarning
            share = float(str(told[0].message).split(" is ")[1].split(" %")[0]) / 100.0
            assert_allclose(share, math.sqrt(depth / D), rtol=1e-3)


def test_a_dashpot_that_is_stronger_than_its_spring():
    """Steps resolve the rate of dashpots: v falls as exp(-2 tau k t/m) where springs are weak
    against them.
    """
    network = line(10.0, 2)
    k = network.normal_stiffness[0]
    m = network.masses[0]
    tau = 100.0 * math.sqrt(m / k)
    rate = 2.0 * tau * k / m
    # the time is nearly a period of a swing at 2^1/2 (k/m)^1/2 or less, at which it is 141 times as
    # viscous as stiff
    with pytest.warns(LimitWarning, match="141 times"):
        motion = gp.NonlinearWaves(network, damping=tau).run(
            5.0 / rate, velocities=push(network, 1e-4), frames=11
        )
    apart = motion.velocities[:, 0, 0] - motion.velocities[:, 1, 0]
    assert_allclose(apart, 1e-4 * np.exp(-rate * motion.times), atol=1e-7)
    with pytest.raises(InputError, match="less damping"):
        gp.NonlinearWaves(network, damping=1.0).run(1e-3, velocities=push(network, 1.0))


def test_a_damping_that_was_meant_as_a_loss_factor():
    """Where dashpots are above springs at all frequencies of a run it is said before it begins;
    above some, it is not.
    """
    network = line(10.0, 5)
    top = math.sqrt(network.normal_stiffness[0] / network.masses[0]) / math.pi  # of a chain
    start = push(network, 1e-6)
    period = 1.0 / top
    with pytest.warns(LimitWarning, match="in the motion") as told:
        gp.NonlinearWaves(network, damping=period).run(2.0 * period, velocities=start, frames=3)
    frequency, ratio = re.findall(r"(\S+) (?:Hz|times)", str(told[0].message))
    assert_allclose(float(frequency), 0.5 * top, rtol=1e-3)
    assert_allclose(float(ratio), math.pi, rtol=0.01)
    # at the top it is 2 pi 0.25 times as viscous as stiff, and pi/4 at the lowest frequency of the
    # run
    gp.NonlinearWaves(network, damping=0.25 * period).run(2.0 * period, velocities=start, frames=3)
    # a run shorter than any period has no higher frequency than contacts have
    gp.NonlinearWaves(network, damping=0.1 * period).run(0.1 * period, velocities=start, frames=3)


def test_a_start_that_cannot_be():
    """What is held, displaced by a drive, or has no such motion is not moved in silence."""
    waves = gp.NonlinearWaves(line(10.0, 4))
    still = gp.Drive(0, (1, 0, 0), displacement=lambda _: 0.0)
    with pytest.raises(InputError, match=r"velocities of ball 0 .*displaced"):
        waves.run(1e-5, velocities=push(waves.network, 1.0), drive=still)
    waves.run(1e-5, velocities=push(waves.network, 1.0, 1), drive=still, frames=2)
    for kind in ("force", "displacement"):
        with pytest.raises(InputError, match=r"drive .* x only"):
            waves.run(1e-5, drive=gp.Drive(0, (0, 1, 0), **{kind: lambda _: 0.0}))
    with pytest.raises(InputError, match=r"ball 1 .*\(1, 2, 0\).* x only"):
        waves.run(
            1e-5,
            velocities=push(waves.network, 1.0, 1)
            + np.array([[0.0], [1.0], [0.0], [0.0]]) * [0.0, 2.0, 0.0],
        )
    with pytest.raises(InputError, match=r"spins of ball 0 .*turn"):
        waves.run(1e-5, spins=push(waves.network, 1.0))
    with pytest.raises(InputError, match=r"gravity .* x only"):
        gp.NonlinearWaves(waves.network, gravity=(0.0, 0.0, -9.81))
    with pytest.raises(InputError, match="leaves the line"):
        gp.Waves(waves.network).transmit(1e3, (1, 1, 0), 8e-3, polarisation=(1, 0, 0))


def test_a_file_of_a_motion_whose_program_was_killed_can_be_read(tmp_path):
    """The frames that had come are those of a run that ends by itself."""
    # without this module, whose imports would cost more than the motion
    script = f"""
import os, signal, sys
import granphon as gp
D, STEEL = {D!r}, gp.{STEEL!r}
{inspect.getsource(line)}
{inspect.getsource(run_into)}

def force(time):
    if time > 5e-5:
        os.kill(os.getpid(), signal.SIGKILL)
    return 1.0

run_into(sys.argv[1], force)
"""
    command = [sys.executable, "-c", script, tmp_path / "killed.nc"]
    assert subprocess.run(command, cwd=ROOT, check=False).returncode == -signal.SIGKILL
    part = gp.Motion.read(tmp_path / "killed.nc")
    count = len(part.times)
    assert 45 < count < 55
    whole = run_into(tmp_path / "whole.nc", lambda _: 1.0)
    assert len(whole.times) == 101
    for name in ("times", "velocities", "forces", "lost"):
        assert np.array_equal(getattr(part, name), getattr(whole, name)[:count])


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ({"duration": 0.0}, "duration"),
        ({"velocities": np.ones((3, 3))}, "velocities has the shape"),
        ({"displacements": np.full((4, 3), np.nan)}, "displacements"),
        ({"frames": 1}, "frames"),
        ({"drive": gp.Drive(0, (1, 0, 0))}, "drive is"),
        ({"drive": 3}, "drive"),
        (
            {"drive": gp.Drive(9, (1, 0, 0), force=lambda time: 1.0)},
            "balls, 0 to 3",
        ),
        ({"drive": gp.Drive(0, (1, 0, 0), displacement=lambda time: 1e-6)}, "begin at zero"),
        ({"drive": gp.Drive(0, (0, 0, 0), force=lambda time: 1.0)}, "direction"),
        ({"step": -1.0}, "step"),
        ({"positions": np.zeros((3, 3))}, "positions has the shape"),
        ({"scheme": "euler"}, "verlet, midpoint"),
        (
            {"positions": np.zeros((4, 3)), "displacements": np.zeros((4, 3))},
            "and displacements",
        ),
    ],
)
def test_bad_input_is_one_error(change, words):
    waves = gp.NonlinearWaves(line(10.0, 4))
    with pytest.raises(InputError, match=words):
        waves.run(**{"duration": 1e-4, **change})


@pytest.mark.parametrize("speed", ["verlet", -1.0, math.nan, 1e200, 10**400])
def test_no_step_of_such_a_speed(speed):
    with pytest.raises(InputError, match=r"speed|too fast"):
        gp.NonlinearWaves(line(10.0, 4)).find_step(speed)


def test_numbers_beyond_double_precision_leave_as_one_error_or_a_short_motion():
    size = 1e308
    waves = gp.NonlinearWaves(line(10.0, 4))
    for name in ("velocities", "displacements"):
        with pytest.raises(InputError, match=r"step|fast|stiff"):
            waves.run(1e-6, frames=2, **{name: push(waves.network, size)})
    with pytest.raises(InputError, match="function of the time"):
        waves.run(1e-6, drive=gp.Drive(0, (1, 0, 0), size), frames=2)
    with pytest.warns(StoppedEarlyWarning):
        motion = waves.run(
            1e-6, drive=gp.Drive(0, (1, 0, 0), lambda time: size * (time > 0.0)), frames=2
        )
    assert np.all(np.isfinite(motion.energy))


def test_what_has_no_overlap_is_refused():
    network = line(10.0, 4)
    with pytest.raises(InputError, match="not pressed"):
        gp.NonlinearWaves(replace(network, normal_force=np.zeros(3)))
    with pytest.raises(InputError, match="sideways"):
        gp.NonlinearWaves(replace(network, prestress=True))
    with pytest.raises(InputError, match="law is"):
        gp.NonlinearWaves(network, law=gp.JKR(0.1))
    with pytest.raises(InputError, match="lattice, exact"):
        gp.NonlinearWaves(network, geometry="true")
    with pytest.raises(InputError, match="gravity is"):
        gp.NonlinearWaves(network, gravity=(0, 1))
    with pytest.raises(InputError, match="friction_coefficient is"):
        gp.NonlinearWaves(network, friction_coefficient=0.3)
    assert gp.NonlinearWaves(network, friction_coefficient=0.0).mu == 0.0
    with pytest.raises(InputError, match="coulomb is"):
        gp.NonlinearWaves(network, coulomb="total", damping=1e-6)
    held = replace(network, masses=np.where([True, False, False, False], np.inf, network.masses))
    with pytest.raises(InputError, match="held"):
        gp.NonlinearWaves(held).run(1e-4, drive=gp.Drive(0, (1, 0, 0), force=lambda time: 1.0))
