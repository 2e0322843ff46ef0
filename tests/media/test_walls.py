"""Walls of a material: Hertz's and Mindlin's laws of a ball and a flat body at rest, in cuts of
networks, in response and in motion, against closed forms and LAMMPS.
"""

from __future__ import annotations

import ctypes
import json
import math

import numpy as np
import pytest
from numpy.testing import assert_allclose

import granphon as gp
from granphon.balls.loads import Load
from granphon.base.errors import InputError
from granphon.media.arrangement import Arrangement, CrystalMedium
from tests import packings
from tests.waves.test_losses import find_viscosity

STEEL = gp.Material(193e9, 0.30, 8000.0)
BRASS = gp.Material(103e9, 0.34, 8500.0)
BALL = gp.Ball(STEEL, 8e-3)
CHAIN = gp.Crystal.on("chain", [BALL])


def find_contact(force, wall, radius=4e-3):
    """Overlap, normal and shear stiffness of a steel ball on a wall, from the textbook."""
    compliances = [(1.0 - m.poisson_ratio**2) / m.young_modulus for m in (STEEL, wall)]
    modulus = 1.0 / sum(compliances)
    overlap = (0.75 * force / (modulus * math.sqrt(radius))) ** (2.0 / 3.0)
    contact_radius = math.sqrt(radius * overlap)
    shears = [
        2.0 * (1.0 + m.poisson_ratio) * (2.0 - m.poisson_ratio) / m.young_modulus
        for m in (STEEL, wall)
    ]
    return overlap, 2.0 * modulus * contact_radius, 8.0 * contact_radius / sum(shears)


@pytest.mark.claim("wall-hertz")
@pytest.mark.parametrize("finite_overlap", [False, True])
def test_a_ball_on_a_wall_has_the_contact_of_the_textbook(finite_overlap):
    state = CHAIN.cut(0, 3, (gp.Wall(BRASS), "free")).at_pressure(
        20.0, finite_overlap=finite_overlap
    )
    found = state.overlap[-1], state.normal_stiffness[-1], state.shear_stiffness[-1]
    assert_allclose(found, find_contact(20.0, BRASS), rtol=1e-12)
    assert state.network.kinds == ("A", "A", "A", "wall")
    smooth = gp.Crystal.on("chain", [BALL], friction=False).cut(0, 3, (gp.Wall(BRASS), "free"))
    assert not np.any(smooth.at_pressure(20.0).shear_stiffness)


@pytest.mark.claim("wall-rigid")
def test_the_floor_is_the_limit_of_stiff_walls():
    """The overlap differs from that on a floor as 1/E: of order one."""
    floor = CHAIN.cut(0, 2, ("floor", "free")).at_pressure(20.0).overlap[-1]
    moduli = 10.0 ** np.arange(14.0, 17.0)
    walls = [gp.Wall(gp.Material(modulus, 0.3, 8000.0)) for modulus in moduli]
    overlaps = [CHAIN.cut(0, 2, (wall, "free")).at_pressure(20.0).overlap[-1] for wall in walls]
    errors = np.array(overlaps) / floor - 1.0
    assert np.all(errors > 0.0)
    assert_allclose(np.log10(errors[:-1] / errors[1:]), 1.0, atol=1e-3)


@pytest.mark.claim("wall-hertz")
def test_a_network_that_is_cut_has_the_wall_of_a_crystal():
    wall = gp.Wall(BRASS)
    network = CHAIN.at_force(20.0).network.cut(0, 3, (wall, "floor"))
    state = CHAIN.cut(0, 3, (wall, "floor")).at_pressure(20.0)
    assert_allclose(network.normal_stiffness, state.network.normal_stiffness, rtol=1e-12)
    assert network.kinds == state.network.kinds == ("A", "A", "A", "wall", "floor")
    assert network.contact_model.walls == (gp.Wall(BRASS, "wall"),)
    assert gp.ContactNetwork.from_dict(json.loads(json.dumps(network.to_dict()))) == network


@pytest.mark.parametrize("of_packing", [False, True])
def test_another_wall_at_a_network_is_that_of_a_cut_with_it(of_packing):
    medium = gp.AveragedLattice(gp.Packing(STEEL, 8e-3, lattice="chain")) if of_packing else CHAIN
    network = medium.at_force(20.0).network
    found = network.cut(0, 3, edges=(gp.Wall(BRASS), "free")).with_wall(STEEL)
    expected = network.cut(0, 3, edges=(gp.Wall(STEEL), "free"))
    for name in ("normal_stiffness", "shear_stiffness", "torsion_stiffness"):
        assert_allclose(getattr(found, name), getattr(expected, name), rtol=1e-14)
    assert found.wall.material == STEEL


@pytest.mark.parametrize("edges", ["floor", (gp.Wall(BRASS), gp.Wall(STEEL))])
def test_there_must_be_one_wall_to_change(edges):
    network = CHAIN.at_force(20.0).network.cut(0, 3, edges=edges)
    with pytest.raises(InputError, match="wall"):
        network.with_wall(STEEL)


@pytest.mark.parametrize("wall", [gp.Wall(BRASS), gp.Wall(BRASS, name="A")])
def test_another_wall_of_a_crystal_keeps_the_name(wall):
    changed = CHAIN.cut(0, 2, gp.Wall(STEEL)).with_walls({"wall": wall})
    assert changed.contact_model == CHAIN.cut(0, 2, gp.Wall(BRASS)).contact_model
    assert changed.at_pressure(10.0).network.kinds == ("A", "A", "wall", "wall")
    # of the material of a kind
    assert changed.with_walls({"wall": gp.Wall("A")}).faces[0].edges[0] == gp.Wall(STEEL, "wall")
    with pytest.raises(InputError, match="no such kind"):
        changed.with_walls({"wall": gp.Wall("B")})


def test_two_walls_have_two_names_and_alike_ones_have_one():
    plane = gp.Crystal.on("triangular", [BALL])
    strip = plane.cut(1, 3, (gp.Wall(BRASS), gp.Wall("A")))
    state = strip.at_pressure(1e3)
    assert state.network.kinds[-2:] == ("wall", "wall_2")
    assert strip.faces[0].edges[1] == gp.Wall(STEEL, "wall_2")
    # the contacts with walls come last, one of each in the cell of the strip
    expected = [
        find_contact(float(force), material)[0]
        for force, material in zip(state.normal_force[-2:], (BRASS, STEEL), strict=True)
    ]
    assert_allclose(state.overlap[-2:], expected, rtol=1e-12)
    assert gp.Crystal.from_dict(json.loads(json.dumps(strip.to_dict()))) == strip
    both = CHAIN.cut(0, 3, gp.Wall(BRASS)).at_pressure(20.0)
    assert both.network.kinds[-2:] == ("wall", "wall")


def test_a_wall_has_a_law_of_its_own_pair():
    law = {("A", "A"): gp.Hertz(), ("A", "piston"): gp.PowerLaw(1.0, 1e7)}
    chain = gp.Crystal.on("chain", [BALL], law=law).cut(0, 3, (gp.Wall(BRASS, "piston"), "free"))
    assert_allclose(chain.at_pressure(20.0).overlap[-1], 2e-6, rtol=1e-12)


@pytest.mark.claim("wall-response")
def test_a_ball_between_two_walls_rings_at_the_root_of_both_stiffnesses():
    row = CHAIN.cut(0, 2, gp.Wall(BRASS))
    network = row.at_pressure(20.0).network
    wall = find_contact(20.0, BRASS)[1]
    inner = network.normal_stiffness[0]
    omega = np.sqrt(np.array([wall, wall + 2.0 * inner]) / BALL.mass)
    assert_allclose(gp.Waves(network).modes(2).frequencies, omega / (2.0 * np.pi), rtol=1e-11)
    hertz = np.array([1e3])
    response = np.asarray(gp.Waves(network).response(hertz, (0, "x"), (0, "x")))[0, 0]
    matrix = np.array([[wall + inner, -inner], [-inner, wall + inner]])
    matrix -= np.eye(2) * BALL.mass * (2.0 * np.pi * 1e3) ** 2
    assert_allclose(response, np.linalg.inv(matrix)[0, 0], rtol=1e-10)


@pytest.mark.claim("losses-wall")
@pytest.mark.parametrize("losses", [{"dashpot": 5.0}, {"restitution": 0.8}], ids=str)
def test_a_dashpot_at_a_wall_is_that_of_the_mass_of_the_ball(losses):
    """A ball between a wall and another ball that is held, pushed: m x'' + (c + c') x' + (k + k') x
    with a dashpot of the reduced mass m at the wall and at the ball that does not move.
    """
    network = CHAIN.cut(0, 2, (gp.Wall(BRASS), "clamped")).at_pressure(20.0).network
    stiffness = network.normal_stiffness
    viscosity = find_viscosity(losses, stiffness, BALL.mass)
    ball = int(np.flatnonzero(network.moving)[0])
    hertz = np.array([2e3, 8e3])
    found = gp.Waves(network).response(hertz, (ball, "x"), (ball, "x"), **losses)
    omega = 2.0 * np.pi * hertz
    resistance = np.sum(stiffness) + 1j * omega * np.sum(viscosity) - BALL.mass * omega**2
    assert_allclose(found.values[:, 0], 1.0 / resistance, rtol=1e-10)


@pytest.mark.claim("losses-wall")
def test_a_ball_bounces_off_a_wall_with_its_restitution():
    """And then off the ball behind it, which stood still."""
    restitution, speed = 0.6, 0.1
    row = CHAIN.cut(0, 2, (gp.Wall(BRASS), "free"))
    waves = gp.NonlinearWaves(row, restitution=restitution)
    run = waves.run(200.0 * waves.find_step(speed), velocities=[[-speed], [0.0], [0.0]], frames=2)
    back = restitution * speed
    shared = 0.5 * back * np.array([1.0 - restitution, 1.0 + restitution])
    assert_allclose(run.velocities[-1, :2, 0], shared, rtol=1e-2)


@pytest.mark.claim("wall-glued")
def test_a_clamped_ball_is_a_bead_that_is_glued_to_a_wall():
    """A bead between two glued ones has two contacts of two balls: omega^2 = 2 k/m."""
    state = CHAIN.cut(0, 3, "clamped").at_pressure(20.0)
    modulus = 0.5 * STEEL.young_modulus / (1.0 - STEEL.poisson_ratio**2)
    overlap = (0.75 * 20.0 / (modulus * math.sqrt(2e-3))) ** (2.0 / 3.0)
    stiffness = 2.0 * modulus * math.sqrt(2e-3 * overlap)
    assert_allclose(state.overlap, overlap, rtol=1e-12)
    omega = math.sqrt(2.0 * stiffness / BALL.mass)
    frequencies = gp.Waves(state.network).modes(1).frequencies
    assert_allclose(frequencies, omega / (2.0 * np.pi), rtol=1e-12)


@pytest.mark.claim("wall-lammps")
@pytest.mark.parametrize("material", [STEEL, BRASS])
def test_balls_bounce_off_a_wall_as_in_lammps(material):
    lmp = packings.start_or_skip()
    column = gp.Crystal.on("square", [BALL], friction=False).cut(1, 2, (gp.Wall(material), "free"))
    waves = gp.NonlinearWaves(column, geometry="exact")
    speeds = np.zeros((3, 3))
    speeds[1, 1] = -0.1
    step, steps = 2e-8, 1500
    ours = waves.run(step * steps, velocities=speeds, frames=2, step=step).velocities[-1]
    places = np.array([[0.0, 4e-3, 0.0], [0.0, 12e-3, 0.0]])
    packings.fill(lmp, "block -0.1 0.1 -0.1 0.1 -0.01 0.01", places)
    modulus = 1.0 / sum((1.0 - m.poisson_ratio**2) / m.young_modulus for m in (STEEL, material))
    law = f"hertz {4.0 / 3.0 * modulus!r} 0"
    if material is STEEL:  # LAMMPS knows walls of the material of the balls
        law = "hertz/material 193e9 0 0.30"
    lmp.commands_string(f"""
        set group all diameter 8e-3 mass {BALL.mass!r}
        pair_style granular
        pair_coeff * * hertz/material 193e9 0 0.30 tangential linear_nohistory 0 0 damping velocity
        neighbor 1e-3 bin
        change_box all boundary p f p
        fix wall all wall/gran granular {law} &
            tangential linear_nohistory 0 0 damping velocity yplane 0.0 NULL
        fix move all nve/sphere
        timestep {step!r}""")
    lmp.scatter_atoms("v", 1, 3, (ctypes.c_double * 6)(*speeds[:2].ravel()))
    lmp.command(f"run {steps} post no")
    theirs = np.array(lmp.gather_atoms("v", 1, 3)).reshape(-1, 3)
    lmp.close()
    assert_allclose(ours[:2], theirs, rtol=0.0, atol=1e-9 * np.abs(theirs).max())


def test_a_run_of_a_cut_network_knows_its_wall():
    network = CHAIN.at_force(20.0).network.cut(0, 3, (gp.Wall(BRASS), "free"))
    speeds = np.zeros((4, 1))
    speeds[2] = 0.1
    run = gp.NonlinearWaves(network, law=CHAIN).run(
        1e-4, velocities=speeds, frames=5, scheme="midpoint"
    )
    assert np.ptp(run.energy) <= 1e-12 * run.energy[0]


def test_a_wall_that_yields_is_told():
    soft = gp.Material(103e9, 0.34, 8500.0, yield_strength=1e8)
    assert "yield" in " ".join(CHAIN.cut(0, 2, (gp.Wall(soft), "free")).at_pressure(20.0).warnings)


@pytest.mark.parametrize(
    ("make", "word"),
    [
        (lambda: gp.Wall(None), "material"),
        (lambda: gp.Wall(3.0), "material"),
        (lambda: gp.Wall(STEEL, name=3), "name"),
        (lambda: CHAIN.cut(0, 2, (gp.Wall("B"), "free")), "'B'"),
        (lambda: CHAIN.cut(0, 2, gp.Wall(BRASS, "A")), "'A'"),
        (lambda: CHAIN.cut(0, 2, ("wall", "free")), "gp.Wall"),
        (lambda: CHAIN.cut(0, 2, (BRASS, "free")), "gp.Wall"),
        (lambda: CHAIN.cut(0, 2, ("glued", "free")), "clamped, floor"),
    ],
)
def test_walls_that_are_refused(make, word):
    with pytest.raises(InputError, match=word):
        make()


def test_the_cut_of_a_given_crystal_is_told_by_its_faces_alone():
    """How many layers such a crystal has is not known."""
    rows = Arrangement.of(CHAIN.cut(0, 3, ("floor", "free"))).describe()
    assert ("cut", "floor and free", "") in rows


def test_a_crystal_is_loaded_by_a_load():
    with pytest.raises(InputError, match="load is 3"):
        CrystalMedium(Arrangement.of(CHAIN)).at(3)


def test_a_gravity_of_zero_needs_nothing_that_holds_balls():
    state = CrystalMedium(Arrangement.of(CHAIN)).at(Load("force", 2.0, gravity=0.0))
    assert_allclose(state.force, 2.0)
