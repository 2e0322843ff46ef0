"""Losses as drag, dashpots and restitutions: closed forms, and the same number at every door."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest
from numpy.testing import assert_allclose

import granphon as gp
from granphon.base.errors import InputError
from granphon.dynamics.damping import GivenLosses, Losses
from granphon.waves.propagation import ToneBurst

STEEL = gp.Material(211.65e9, 0.276, 7840.0)
D = 8e-3
BALL = gp.Ball(STEEL, D)
#: losses of a few percent of a chain under 20 N, each by itself and two at once
LOSSES = [
    {"damping": 5e-7},
    {"drag": 1e4},
    {"dashpot": 5.0},
    {"restitution": 0.8},
    {"drag": 5e3, "restitution": 0.9},
]
#: springs to the ground, which lose no energy, N/m
GROUND = 2e6
#: losses, and springs to the ground
CASES = [(losses, 0.0) for losses in LOSSES]
CASES += [
    pytest.param({"drag": 1e4}, GROUND, marks=pytest.mark.slow),
    pytest.param({"drag": 5e3, "dashpot": 5.0}, GROUND, marks=pytest.mark.slow),
    ({"restitution": 0.8}, GROUND),
]
names = pytest.mark.parametrize(
    ("losses", "ground"),
    CASES,
    ids=lambda case: "-".join(case) if isinstance(case, dict) else f"ground {case:g}",
)


def infinite_chain(ground=0.0):
    """A chain under 20 N, with springs to the ground, N/m."""
    packing = gp.Packing(STEEL, D, lattice="chain", motions="longitudinal")
    network = gp.AveragedLattice(packing).at_force(20.0).network
    return replace(network, on_site=np.full((1, 1), ground)) if ground else network


def chain(layers, ground=0.0):
    """A chain of so many balls under 20 N, between two that are held."""
    return infinite_chain(ground).cut(0, layers, "clamped")


def find_viscosity(losses, stiffness, reduced):
    """Return c of a contact of a ``stiffness`` and a ``reduced`` mass."""
    logarithm = -math.log(losses.get("restitution", 1.0))
    alpha = math.sqrt(10.0 / 3.0) * logarithm / math.hypot(math.pi, logarithm)
    viscosity = losses.get("damping", 0.0) * stiffness + losses.get("dashpot", 0.0)
    return viscosity + alpha * np.sqrt(reduced * stiffness)


# -- one ball --------------------------------------------------------------------------------------


@names
@pytest.mark.claim("losses-oscillator")
@pytest.mark.claim("losses-on-site")
def test_a_ball_between_two_that_are_held_is_a_damped_oscillator(losses, ground):
    """Its response, its mode and its motion are known; the reduced mass is that of the ball."""
    network = chain(3, ground)
    waves = gp.Waves(network)
    mass, stiffness = network.masses[1], network.normal_stiffness[0]
    rate = losses.get("drag", 0.0) + 2.0 * find_viscosity(losses, stiffness, mass) / mass
    omega = math.sqrt((2.0 * stiffness + ground) / mass)
    hertz = omega / (2.0 * math.pi) * np.array([0.3, 1.0, 1.7])
    w = 2.0 * math.pi * hertz
    found = waves.response(hertz, (1, "x"), (1, "x"), **losses)
    exact = 1.0 / (mass * (omega**2 - w**2 + 1j * w * rate))
    assert_allclose(found.values[:, 0], exact, rtol=1e-12)
    mode = waves.damped_modes(1, **losses).frequencies[0]
    swing = math.sqrt(omega**2 - 0.25 * rate**2)
    assert_allclose(2.0 * math.pi * mode, swing + 0.5j * rate, rtol=1e-12)
    assert 0.01 < 0.5 * rate / omega < 0.2
    speed = 1e-7 * omega * 2e-6
    nonlinear = gp.NonlinearWaves(network, **losses)
    step = nonlinear.find_step() / 4.0
    motion = nonlinear.run(
        80 * step * 4, velocities=[[0.0], [speed], [0.0]], frames=9, step=step, scheme="midpoint"
    )
    t = motion.times
    free = speed / swing * np.exp(-0.5 * rate * t) * np.sin(swing * t)
    assert_allclose(motion.displacements[:, 1, 0], free, atol=1e-3 * speed / omega)
    assert_allclose(motion.energy + motion.lost, motion.energy[0], rtol=1e-8)


# -- all doors -------------------------------------------------------------------------------------


@names
@pytest.mark.claim("losses-doors")
def test_a_pulse_and_a_motion_lose_what_modes_and_the_response_lose(losses, ground):
    """The same chain, pushed by the same burst: by the modes of the matrices at each frequency, by
    polynomials, and by steps of the whole law at an amplitude of a millionth of the overlap.
    """
    network = chain(8, ground)
    waves = gp.Waves(network)
    top = math.sqrt(4.0 * network.normal_stiffness[0] / network.masses[1]) / (2.0 * math.pi)
    burst = ToneBurst(0.4 * top, 2.0)
    duration = 8.0 / top
    pulse = waves.transmit(0.4 * top, (1,), 4.0 * D, 2, source=1, duration=duration, **losses)
    receiver = int(pulse.receivers[0])
    force = 1e-6 * network.normal_force[0]
    nonlinear = gp.NonlinearWaves(network, **losses)
    drive = gp.Drive(1, (1,), force=lambda time: force * float(burst(np.array(time))))
    frames = pulse.times.size
    motion = nonlinear.run(
        pulse.times[-1], drive=drive, frames=frames, step=nonlinear.find_step() / 2.0
    )
    heard = motion.velocities[:, receiver, 0] / force
    assert_allclose(heard, pulse.signals[0], atol=2e-3 * np.max(np.abs(heard)))
    lossless = waves.transmit(0.4 * top, (1,), 4.0 * D, 2, source=1, duration=duration)
    assert np.max(np.abs(lossless.signals[0] - pulse.signals[0])) > 0.05 * np.max(np.abs(heard))
    # the velocity is the sum over frequencies of the response, of which modes are the poles
    spectrum = np.fft.rfftfreq(4096, pulse.times[1])[1:400]
    modes = waves.damped_modes(6, **losses)
    poles = np.concatenate([modes.frequencies, -modes.frequencies.conj()])
    hertz = spectrum[::40]
    response = waves.response(hertz, (1, "x"), (1, "x"), **losses).values[:, 0]
    w = 2.0 * math.pi * hertz
    viscous = waves.operator.resist(Losses.of(network, GivenLosses(**losses))).toarray()
    stiff = waves.operator.matrix.toarray()
    inverse = [np.linalg.inv(stiff + 1j * x * viscous - x * x * np.eye(6))[0, 0] for x in w]
    assert_allclose(response, np.array(inverse) / network.masses[1], rtol=1e-9)
    for pole in poles:
        z = 2.0 * math.pi * pole
        determinant = np.linalg.svd(stiff + 1j * z * viscous - z * z * np.eye(6))[1]
        assert determinant[-1] < 1e-9 * determinant[0]


def resist_by_contacts(network, losses):
    """Return the matrix of forces on balls over velocities (n, m, n, m), N s/m, contact by contact:
    an independent twin.
    """
    translations = list(network.ball_motions.translations)
    rotations = list(network.ball_motions.rotations)
    m = len(translations) + len(rotations)
    resisted = Losses.of(network, GivenLosses(**losses))
    matrix = np.zeros((network.n_balls, m, network.n_balls, m))
    for c in range(network.n_contacts):
        ends = (network.i[c], network.j[c])
        normal = network.normal[c]
        rows = []
        for end, sign, arm in zip(
            ends, (-1.0, 1.0), (network.arm_i[c], network.arm_j[c]), strict=True
        ):
            of_end = np.zeros((3, m))
            for column, axis in enumerate(translations):
                of_end[axis, column] = sign
            for column, axis in enumerate(rotations, len(translations)):
                of_end[:, column] = -arm * np.cross(np.eye(3)[axis], normal)
            rows.append((end, of_end))
        mass = 1.0 / np.sum(1.0 / network.masses[list(ends)])
        root = resisted.tsuji[c] * math.sqrt(mass * network.normal_stiffness[c])
        stiffness = network.normal_stiffness[c], network.shear_stiffness[c]
        normal_c, shear_c = (
            resisted.damping[row, c] * stiffness[row] + resisted.dashpot[row, c] + root
            for row in range(2)
        )
        across = np.eye(3) - np.outer(normal, normal)
        viscous = normal_c * np.outer(normal, normal) + shear_c * across
        for end, row in rows:
            for other, column in rows:
                matrix[end, :, other, :] += row.T @ viscous @ column
    for ball in range(network.n_balls):
        inertia = [network.masses[ball]] * len(translations)
        inertia += [network.inertias[ball]] * len(rotations)
        drag = np.where(np.arange(m) < len(translations), *resisted.drag)
        matrix[ball, :, ball, :] += np.diag(drag * inertia)
    return matrix


PLANE = [
    {"drag": (2e4, 6e3)},
    {"drag": (0.0, 2e4)},
    {"dashpot": (8.0, 3.0), "drag": 4e3},
    {"restitution": 0.7},
    {"restitution": 0.9, "damping": (3e-7, 1e-7), "drag": (4e3, 1e3)},
]


@pytest.mark.parametrize(
    ("losses", "ground"), [*((each, 0.0) for each in PLANE), (PLANE[4], GROUND)], ids=str
)
def test_balls_that_turn_lose_what_their_contacts_do_one_by_one(losses, ground):
    """A flake of two kinds of balls: the response and all modes of the twin, of which the motions
    of the flake as a whole are none unless springs hold it.
    """
    heavy = gp.Ball(gp.Material(193e9, 0.30, 8000.0), D)
    light = gp.Ball(gp.Material(73.5e9, 0.33, 2700.0), D)
    places = D * np.array([[0.0, 0.0], [1.0, 0.0], [0.5, math.sqrt(0.75)], [1.5, math.sqrt(0.75)]])
    crystal = gp.Crystal([heavy, light, light, heavy], [], places, friction=True)
    touching = crystal.touch().network
    stiffness = np.linspace(1.0, 1.4, touching.n_contacts) * 1e7
    network = replace(
        touching,
        normal_stiffness=stiffness,
        shear_stiffness=0.8 * stiffness,
        normal_force=np.full(touching.n_contacts, 10.0),
        on_site=np.full((4, 3), [ground, 0.5 * ground, 10.0]) if ground else None,
    )
    weights = np.column_stack([network.masses, network.masses, network.inertias])
    root = np.sqrt(weights).ravel()
    viscous = resist_by_contacts(network, losses).reshape(12, 12) / np.outer(root, root)
    elastic = resist_by_contacts(network, {"damping": 1.0}).reshape(12, 12)
    stiff = elastic / np.outer(root, root)
    if ground:
        stiff += np.diag(network.on_site.ravel() / root**2)
    waves = gp.Waves(network)
    hertz = np.linspace(2e3, 4e4, 5)
    found = waves.response(hertz, (0, "x"), (3, "y"), **losses).values[:, 0]
    exact = [
        np.linalg.inv(stiff + 1j * w * viscous - w * w * np.eye(12))[0, 10]
        for w in 2.0 * math.pi * hertz
    ]
    assert_allclose(found, np.array(exact) / (root[0] * root[10]), rtol=1e-8)
    first_order = np.block([[np.zeros((12, 12)), np.eye(12)], [-stiff, -viscous]])
    omega = -1j * np.linalg.eigvals(first_order)
    swinging = np.sort_complex(omega[omega.real > 1e-3 * np.max(omega.real)])
    modes = waves.damped_modes(12 if ground else 9, **losses)
    assert_allclose(np.sort_complex(2.0 * math.pi * modes.frequencies), swinging, rtol=1e-7)


@pytest.mark.parametrize(
    ("losses", "ground"),
    [({"drag": 4e3}, 0.0), *((PLANE[row], 0.0) for row in (0, 2, 4)), (PLANE[4], GROUND)],
    ids=str,
)
def test_a_krylov_space_has_drag_and_dashpots_too(losses, ground):
    packing = gp.Packing(STEEL, D)
    network = gp.AveragedLattice(packing).at_force(20.0).network.repeat((5, 5)).cut(1, 5, "clamped")
    if ground:
        network = replace(network, on_site=np.full((network.n_balls, 3), [ground, ground, 10.0]))
    waves = gp.Waves(network)
    source, receiver = np.flatnonzero(network.moving)[[2, 9]].tolist()
    hertz = np.linspace(2e3, 3e4, 4)
    losses = {**losses, "loss_factor": (0.02, 0.01)} if "restitution" in losses else losses
    direct, krylov = (
        waves.response(hertz, (source, "x"), (receiver, "x"), method=method, **losses)
        for method in ("direct", "krylov")
    )
    assert krylov.steps
    scale = np.max(np.abs(direct.values))
    assert_allclose(krylov.values, direct.values, atol=1e-7 * scale)


def test_modes_of_a_larger_flake_with_other_drag_of_rotations_are_modes():
    """By factors: the motions of the flake as a whole are coupled to the others, and are left out."""
    packing = gp.Packing(STEEL, D)
    flake = gp.AveragedLattice(packing).at_force(20.0).network.cut(0, 11).cut(0, 11)
    losses = {"drag": (3e3, 8e3), "dashpot": 2.0}
    waves = gp.Waves(flake)
    modes = waves.damped_modes(4, **losses)
    operator = waves.operator
    viscous = operator.resist(Losses.of(flake, GivenLosses(**losses)))
    for frequency, shape in zip(modes.frequencies, modes.vectors, strict=True):
        omega = 2.0 * math.pi * frequency
        x = shape.ravel()
        forces = operator.matrix @ x + 1j * omega * (viscous @ x)
        assert_allclose(forces, omega**2 * x, atol=1e-8 * abs(omega**2))
    assert_allclose(modes.frequencies.real, waves.modes(4).frequencies, rtol=1e-2)


# -- waves -----------------------------------------------------------------------------------------


@names
@pytest.mark.claim("losses-bands")
@pytest.mark.claim("losses-on-site")
def test_waves_of_a_chain_have_complex_frequencies_and_wave_numbers(losses, ground):
    """omega^2 - i omega gamma = (k_g + 4 (k + i omega c) sin^2(q d/2))/m."""
    network = infinite_chain(ground)
    mass, stiffness = network.masses[0], network.normal_stiffness[0]
    viscosity = find_viscosity(losses, stiffness, 0.5 * mass)
    drag = losses.get("drag", 0.0)
    q = np.array([0.05, 0.2, 0.5])
    phonons = gp.Phonons(network)
    omega = 2.0 * math.pi * phonons.damped(q[:, None], **losses).frequencies[:, 0]
    square = 4.0 / mass * np.sin(math.pi * q) ** 2
    elastic = ground / mass + square * (stiffness + 1j * omega * viscosity)
    assert_allclose(omega**2 - 1j * omega * drag, elastic, rtol=1e-12)
    top = math.sqrt((4.0 * stiffness + ground) / mass)
    w = top * np.array([0.2, 0.7, 1.1])
    waves = phonons.complex_bands(w / (2.0 * math.pi), **losses)
    sine = np.sin(0.5 * D * waves.wavenumbers) ** 2
    inertia = mass * (w**2 + 1j * w * drag) - ground
    exact = inertia / (4.0 * (stiffness - 1j * w * viscosity))
    assert_allclose(sine, np.broadcast_to(exact[:, None], sine.shape), rtol=1e-9)


@names
@pytest.mark.claim("losses-transmission")
def test_two_balls_with_losses_let_waves_pass_as_two_equations_say(losses, ground):
    """Between leads without losses, whose waves exp(i q n) are known."""
    lead = infinite_chain(ground)
    mass, k = lead.masses[0], lead.normal_stiffness[0]
    q = np.array([0.3, 1.2, 2.5])
    w = np.sqrt((ground + 4.0 * k * np.sin(0.5 * q) ** 2) / mass)
    passed = gp.transmission(lead, lead.cut(0, 2), lead, w / (2.0 * math.pi), **losses)
    between = k - 1j * w * find_viscosity(losses, k, 0.5 * mass)
    inertia = mass * (w**2 + 1j * w * losses.get("drag", 0.0)) - ground
    alone = inertia - k - between + k * np.exp(1j * q)
    through = 2j * k * np.sin(q) * between / (between**2 - alone**2)
    assert_allclose(passed.transmitted, np.abs(through) ** 2, rtol=1e-9)
    assert np.all(passed.transmitted + passed.reflected < 1.0)


# -- collisions ------------------------------------------------------------------------------------


def collide(speed, scheme="verlet", finer=1, frames=41, **losses):
    """Return the restitution of two balls that meet at a ``speed``, m/s: by their velocities in the
    first frame after they part.
    """
    pair = gp.Crystal([BALL] * 2, [], [[0.0], [D]], friction=False)
    waves = gp.NonlinearWaves(pair, **losses)
    duration = 200.0 * gp.NonlinearWaves(pair).find_step(0.5 * speed)
    motion = waves.run(
        duration,
        velocities=[[0.5 * speed], [-0.5 * speed]],
        frames=frames,
        step=waves.find_step(0.5 * speed) / finer,
        scheme=scheme,
    )
    parted = int(np.flatnonzero(motion.forces[:, 0] > 0.0)[-1]) + 1
    lost = motion.energy[0] - motion.energy[-1]
    assert_allclose(motion.lost[-1], lost, rtol=1e-8 if scheme == "midpoint" else 2e-2)
    end = motion.velocities[parted, :, 0]
    return (end[1] - end[0]) / speed


@pytest.mark.claim("losses-restitution")
@pytest.mark.parametrize(
    "restitution",
    [
        pytest.param(0.1, marks=pytest.mark.slow),
        0.5,
        0.9,
        pytest.param(0.99, marks=pytest.mark.slow),
    ],
)
def test_a_collision_has_its_restitution_at_any_velocity(restitution):
    found = [collide(speed, restitution=restitution) for speed in (1e-3, 1e-1, 1.0)]
    assert_allclose(found, restitution, rtol=1e-2)
    assert np.ptp(found) < 1e-2 * restitution


@pytest.mark.claim("losses-restitution")
def test_steps_come_to_the_restitution():
    """By the steps of the midpoint, in second order."""
    coarse, fine = (collide(0.1, "midpoint", finer, restitution=0.5) for finer in (1, 4))
    assert abs(coarse - 0.5) < 2e-3
    assert abs(fine - 0.5) < 0.2 * abs(coarse - 0.5)


def limited(restitution):
    """Return the restitution of the same dashpot where it does not pull: the oscillator is left when
    its force is zero.
    """
    logarithm = -math.log(restitution)
    ratio = logarithm / math.hypot(math.pi, logarithm)
    root = math.sqrt(1.0 - ratio**2)
    return math.exp(-ratio / root * math.atan2(2.0 * ratio * root, 2.0 * ratio**2 - 1.0))


@pytest.mark.claim("losses-pull")
@pytest.mark.parametrize("restitution", [0.1, 0.5, 0.9])
def test_a_dashpot_that_does_not_pull_takes_less(restitution):
    found = collide(0.1, finer=4, restitution=restitution, viscous_pull="limited")
    assert_allclose(found, limited(restitution), rtol=5e-3)
    assert found > restitution


#: restitutions at 1 mm/s, 0.1 m/s and 1 m/s of losses that have 0.9 at 0.1 m/s
TABLE = [
    ("damping", 7.3e-7, (0.959, 0.900, 0.847)),
    ("dashpot", 5.15, (0.764, 0.900, 0.936)),
    pytest.param("drag", 4.88e3, (0.764, 0.900, 0.936), marks=pytest.mark.slow),
]


@pytest.mark.claim("losses-velocity")
@pytest.mark.parametrize(("name", "loss", "table"), TABLE)
def test_other_losses_have_a_restitution_that_goes_with_the_velocity(name, loss, table):
    """ln(1/e) of weak losses goes as v^(1/5) for tau, and as v^(-1/5) for c_0 and drag: as the time
    of a collision, times the stiffness or alone.
    """
    frames = 801 if name == "drag" else 41  # drag goes on when they have parted
    found = [collide(speed, frames=frames, **{name: loss}) for speed in (1e-3, 0.1, 1.0)]
    assert_allclose(found, table, atol=2e-3)
    weak = [
        -math.log(collide(speed, frames=frames, **{name: 0.05 * loss})) for speed in (1e-2, 1.0)
    ]
    power = 0.2 if name == "damping" else -0.2
    assert_allclose(math.log(weak[1] / weak[0]) / math.log(100.0), power, atol=0.01)


def test_losses_that_are_none_are_refused():
    network = chain(3)
    waves = gp.Waves(network)
    for name, wrong in (
        ("restitution", 0.0),
        ("restitution", 1.1),
        ("restitution", -0.5),
        ("drag", -1.0),
        ("drag", [1.0, 2.0]),
        ("dashpot", (1.0, 2.0, 3.0)),
        ("dashpot", math.nan),
        ("dashpot", 1e31),
    ):
        with pytest.raises(InputError, match=name):
            waves.response([1e3], (1, "x"), (1, "x"), **{name: wrong})
        with pytest.raises(InputError, match=name):
            gp.NonlinearWaves(network, **{name: wrong})
    for name in ("viscous_pull", "coulomb"):
        with pytest.raises(InputError, match=name):
            gp.NonlinearWaves(network, **{name: "half"})


def test_the_drag_of_balls_without_contacts_is_even():
    state = gp.AveragedLattice(
        gp.Packing(gp.Material(2e11, 0.3, 7800.0), 8e-3, friction=True)
    ).at_force(10.0)
    network = state.network.repeat((2, 2))
    fields = {name: getattr(network, name)[:0] for name in network.contact_fields}
    losses = Losses.of(replace(network, **fields, lattice=None, shape=None), GivenLosses(drag=3.0))
    assert losses.find_even() == (0.0, 0.0, 3.0)
