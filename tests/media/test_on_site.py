"""Springs to the ground of crystals: statics against closed forms, motion against modes and LAMMPS,
and what keeps them.
"""

from __future__ import annotations

import ctypes
import json
from dataclasses import replace

import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal
from scipy.optimize import brentq

import granphon as gp
from granphon.balls.loads import Load
from granphon.base.errors import InputError
from granphon.media.arrangement import Arrangement, CrystalMedium
from tests import packings

STEEL = gp.Material(193e9, 0.30, 8000.0)
BALL = gp.Ball(STEEL, 8e-3)
GROUND = 1e7


def make_chain(**options):
    """A chain of balls with springs to the ground."""
    return gp.Crystal.on("chain", [BALL], on_site=GROUND, **options)


@pytest.mark.claim("on-site-statics")
@pytest.mark.parametrize("finite_overlap", [False, True])
def test_two_balls_between_magnets_share_the_push_with_their_springs(finite_overlap):
    pair = make_chain().cut(0, 2)
    state = pair.at_pressure(20.0, finite_overlap=finite_overlap)
    law = pair.law_of(0, 1)[0]
    # P = f(2 u) + k_g u
    shift = brentq(lambda u: law.force(2.0 * u) + GROUND * u - 20.0, 0.0, 1e-5, xtol=1e-22)
    assert_allclose(state.displacements[:, 0], [shift, -shift], rtol=1e-12)
    assert_allclose(state.normal_force, 20.0 - GROUND * shift, rtol=1e-12)


@pytest.mark.claim("on-site-statics")
def test_the_force_of_a_pressed_row_falls_off_into_it():
    row = make_chain().cut(0, 7)
    state = row.at_force(20.0)
    assert_allclose(state.normal_force.mean(), 20.0, rtol=1e-13)
    inner = np.diff(state.normal_force)  # what springs take from ball to ball
    assert_allclose(-inner, GROUND * state.displacements[1:-1, 0], atol=1e-12)
    assert np.all(np.diff(state.normal_force[:3]) < 0.0)


def test_springs_move_along_with_the_strain_of_the_cell():
    free = gp.Crystal.on("triangular", [BALL]).at_pressure(1e3, finite_overlap=True)
    held = gp.Crystal.on("triangular", [BALL], on_site=1e6).at_pressure(1e3, finite_overlap=True)
    assert_allclose(held.strain, free.strain, rtol=0.0, atol=1e-15)
    assert_allclose(held.stress, free.stress, rtol=1e-10, atol=1e-6)


@pytest.mark.claim("on-site-statics")
def test_springs_bear_weights_where_nothing_else_does():
    chain = make_chain()
    state = chain.at_pressure(0.0, gravity=[9.81])
    assert_allclose(state.displacements, chain.masses[:, None] * 9.81 / GROUND, rtol=1e-12)
    row = chain.cut(0, 4)
    state = row.at_pressure(20.0, gravity=[9.81])
    assert_allclose(GROUND * np.sum(state.displacements), 9.81 * np.sum(row.masses), rtol=1e-9)
    assert_allclose(row.downward, [-1.0])
    with pytest.raises(InputError, match="gravity"):
        gp.Crystal.on("chain", [BALL]).at_pressure(20.0, gravity=[9.81])


@pytest.mark.parametrize("finite_overlap", [False, True])
def test_a_sample_with_springs_is_in_balance(finite_overlap):
    ball = gp.Ball(STEEL, 8e-3, spread=gp.Uniform(2e-6))
    crystal = gp.Crystal.on("triangular", [ball], on_site={"x": 1e5, "y": 2e5, "rotation": 1.0})
    state = crystal.sample((4, 4), seed=1).at_pressure(2e3, finite_overlap=finite_overlap)
    network = state.network
    forces = np.zeros((16, 3))
    pushes = network.normal_force[:, None] * network.normal
    np.add.at(forces, network.j, pushes)
    np.add.at(forces, network.i, -pushes)
    springs = network.on_site[:, :2] * state.displacements
    assert_allclose(forces[:, :2], springs, rtol=0.0, atol=1e-11 * state.normal_force.mean())
    assert network.is_balanced
    assert np.all(gp.Phonons(state).frequencies([[0.0, 0.0]]) > 0.0)


def test_a_crystal_keeps_its_springs():
    crystal = gp.Crystal.on("square", [BALL], on_site={"x": 1.0, "y": 2.0, "rotation_z": 3.0})
    assert crystal.on_site.tolist() == [[1.0, 2.0, 3.0]]
    large = crystal.repeat((3, 2)).remove(1).replace(0, gp.Ball(STEEL, 8e-3, mass=1e-3))
    assert large.on_site.shape == (5, 3)
    strip = crystal.cut(0, 4, ("floor", "free"))  # turned: x comes to lie across the strip
    assert strip.on_site[0].tolist() == [2.0, 1.0, 3.0]
    state = strip.at_pressure(1e3)
    assert_allclose(state.network.on_site[[0, -1]], [[2.0, 1.0, 3.0], [0.0, 0.0, 0.0]])
    assert gp.Crystal.from_dict(json.loads(json.dumps(strip.to_dict()))) == strip
    each = gp.Crystal.on("chain", [BALL, BALL], on_site=[1.0, {"x": 2.0}])
    assert each.on_site.tolist() == [[1.0], [2.0]]
    assert gp.Crystal.on("chain", [BALL], on_site=0.0).on_site is None


@pytest.mark.parametrize(
    "springs", [-1.0, np.inf, 1e300, {"x": -1.0}, {"z": 1.0}, {0: 1.0}, "1 N/m", [1.0, 2.0]]
)
def test_springs_that_are_refused(springs):
    with pytest.raises(InputError, match="on_site"):
        gp.Crystal.on("chain", [BALL], on_site=springs)


@pytest.mark.parametrize(("springs", "pressure"), [(1e6, 1e-20), (1e12, 20.0)])
def test_a_load_that_springs_bear_alone_is_refused(springs, pressure):
    row = gp.Crystal.on("chain", [BALL], on_site=springs).repeat(6).cut(0, 1, ("floor", "free"))
    with pytest.raises(InputError, match=r"no force .* ground .* stiffest contact"):
        row.at_pressure(pressure)


def test_springs_do_not_keep_contacts_of_balls_that_differ_closed():
    """Springs that are next to nothing leave the forces as they are, where contacts are open."""
    ball = replace(BALL, spread=gp.Uniform(4e-6))
    forces = []
    for springs in (None, 1e-3):
        crystal = gp.Crystal.on("triangular", [ball], on_site=springs, friction=False)
        forces.append(crystal.sample((4, 4), seed=3).at_pressure(100.0).normal_force)
    without, with_springs = forces
    assert np.any(without == 0.0)
    assert_allclose(with_springs, without, atol=1e-5 * np.max(without))


@pytest.mark.claim("on-site-motion")
@pytest.mark.parametrize("scheme", ["verlet", "midpoint"])
def test_a_mode_moves_at_its_frequency_and_keeps_its_energy(scheme):
    crystal = make_chain(motions="in_plane").cut(0, 4)
    network = crystal.at_pressure(20.0).network
    modes = gp.Waves(network).modes(3)
    motion = modes.vectors[1].reshape(4, 3)
    shifts = np.zeros((4, 3))
    shifts[:, :2] = motion[:, :2] / np.sqrt(network.masses[:, None])
    turns = np.zeros((4, 3))
    turns[:, 2] = motion[:, 2] / np.sqrt(network.inertias)
    scale = 1e-12 / np.abs(shifts).max()
    run = gp.NonlinearWaves(network).run(
        2.0 / modes.frequencies[1],
        displacements=scale * shifts,
        rotations=scale * turns,
        frames=9,
        scheme=scheme,
    )
    phase = np.cos(2.0 * np.pi * modes.frequencies[1] * run.times)[:, None, None]
    assert_allclose(run.displacements, scale * shifts * phase, atol=1e-3 * 1e-12)
    assert np.ptp(run.energy) <= (1e-12 if scheme == "midpoint" else 1e-3) * run.energy[0]


@pytest.mark.claim("on-site-motion")
def test_a_driven_ball_pulls_its_spring():
    network = make_chain().cut(0, 4).at_pressure(20.0).network
    drive = gp.Drive([0], [1.0], displacement=lambda t: 1e-8 * (1.0 - np.cos(2e4 * t)))
    run = gp.NonlinearWaves(network).run(2e-4, drive=drive, frames=11, scheme="midpoint")
    assert_allclose(run.energy, run.work, atol=1e-11 * np.abs(run.work).max())


@pytest.mark.claim("on-site-lammps")
def test_balls_on_springs_move_as_in_lammps():
    lmp = packings.start_or_skip()
    places = np.array([[0.0, 0.0, 0.0], [8e-3, 0.0, 0.0], [4e-3, 8e-3 * np.sqrt(0.75), 0.0]])
    speeds = np.array([[0.05, 0.02, 0.0], [0.0, 0.0, 0.0], [0.0, 0.0, 0.0]])
    step, steps = 2e-8, 1000
    crystal = gp.Crystal([BALL] * 3, [], places[:, :2], friction=False, on_site=GROUND)
    waves = gp.NonlinearWaves(crystal, geometry="exact")
    ours = waves.run(step * steps, velocities=speeds, frames=2, step=step).velocities[-1]
    packings.fill(lmp, "block -0.1 0.1 -0.1 0.1 -0.01 0.01", places)
    lmp.commands_string(f"""
        set group all diameter 8e-3 mass {BALL.mass!r}
        pair_style granular
        pair_coeff * * hertz/material 193e9 0 0.30 tangential linear_nohistory 0 0 damping velocity
        neighbor 1e-3 bin
        fix hold all spring/self {GROUND!r}
        fix move all nve/sphere
        timestep {step!r}""")
    lmp.scatter_atoms("v", 1, 3, (ctypes.c_double * 9)(*speeds.ravel()))
    lmp.command(f"run {steps} post no")
    theirs = np.array(lmp.gather_atoms("v", 1, 3)).reshape(-1, 3)
    lmp.close()
    assert_allclose(ours, theirs, rtol=0.0, atol=1e-9 * np.abs(theirs).max())


def test_balls_that_springs_alone_hold_have_means_of_zero():
    """Both balls of a pair sink by the same way, so that they only touch."""
    pair = gp.Crystal([BALL, BALL], [], [[0.0, 0.0], [BALL.diameter, 0.0]], on_site=1e3)
    load = Load("pressure", [0.0, 0.0], gravity=9.81)
    state = CrystalMedium(Arrangement.of(pair)).at(load)
    assert_array_equal(state.force, [0.0, 0.0])
    assert_array_equal(state.overlap, [0.0, 0.0])
    assert_array_equal(state.contact_fraction, [0.0, 0.0])
    with pytest.raises(InputError, match="without periods"):
        _ = state.pressure
