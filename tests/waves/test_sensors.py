"""Sensors of force: at contacts, in floors and in balls, in response and in motion, against closed
forms of chains; and accelerance.
"""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest
from numpy.testing import assert_allclose

import granphon as gp
from granphon.base.errors import InputError
from granphon.waves.sensors import SensorPlaces, is_contact, list_open_axes
from tests.waves.test_losses import find_viscosity
from tests.waves.test_nonlinear import STEEL, line, push
from tests.waves.test_response import HERTZ, OMEGA, UNITS, D, chain, ideal, springs

K = UNITS.stiffness
#: of a motion exp(i omega t), in units of (k/M)^1/2
FREQUENCIES = np.array([0.05, 0.7, 1.3, 1.9, 2.6])
TIME = 0.1
LOSS = 0.05


def held_chain(balls=6):
    """Balls 0 to n - 1, the last on a floor, body n."""
    return chain(balls, ("free", "floor"))


def respond(network, receiver, omega=FREQUENCIES, source=(0, "x"), **options):
    losses = {"damping": TIME / OMEGA, "loss_factor": LOSS} | options
    return gp.Waves(network).response(omega * HERTZ, source, receiver, **losses)


@pytest.mark.claim("sensors-response")
@pytest.mark.parametrize("losses", [{"dashpot": 20.0}, {"restitution": 0.7, "drag": 1e3}], ids=str)
def test_force_of_a_contact_has_that_of_all_its_dashpots(losses):
    """F = -(k (1 + i eta + i omega tau) + i omega c) (u_j - u_i): drag acts on balls alone. The
    reduced mass at the floor is that of a ball.
    """
    network = held_chain()
    found = respond(network, [(2, 3), (3, "x"), "floor"], quantity="force", **losses)
    displacements = respond(network, (np.arange(6), "x"), **losses).values

    def find_force(elongation, mass):
        """The force of a contact of balls with a reduced ``mass``."""
        viscous = 1j * FREQUENCIES * OMEGA * find_viscosity(losses, K, mass)
        return -(K * (1.0 + 1j * (LOSS + FREQUENCIES * TIME)) + viscous) * elongation

    before, after = (
        find_force(displacements[:, ball + 1] - displacements[:, ball], 0.5 * UNITS.mass)
        for ball in (2, 3)
    )
    assert_allclose(found.values[:, 0], before, rtol=1e-9)
    assert_allclose(found.values[:, 1], 0.5 * (before + after), rtol=1e-9)
    assert_allclose(found.values[:, 2], find_force(-displacements[:, 5], UNITS.mass), rtol=1e-9)


@pytest.mark.claim("sensors-response")
@pytest.mark.parametrize("method", ["direct", "krylov"])
def test_force_of_a_contact_is_that_of_its_spring_and_dashpot(method):
    """F = -k (1 + i eta + i omega tau) (u_j - u_i), whichever ball is named first."""
    network = held_chain()
    found = respond(network, [(2, 3), (3, 2)], quantity="force", method=method)
    places = respond(network, [(2, "x"), (3, "x")]).values
    factor = K * (1.0 + 1j * (LOSS + FREQUENCIES * TIME))
    expected = factor * (places[:, 0] - places[:, 1])
    assert_allclose(found.values, np.stack([expected, expected], axis=1), rtol=1e-8)
    assert found.names == ("contact 2-3", "contact 3-2")
    assert_allclose(found.directions[:, 0], [1.0, -1.0])
    assert found.quantity == "force"
    assert found.to_dict()["units"]["values"] == "1"
    assert gp.Response.from_dict(found.to_dict()) == found
    assert np.max(found.error) < 1e-8


@pytest.mark.claim("sensors-response")
def test_a_sensor_in_a_ball_reads_the_mean_of_its_contacts():
    network = held_chain()
    receivers = [(3, "x"), (3, (-1.0,)), (2, 3), (3, 4)]
    found = respond(network, receivers, quantity="force").values
    mean = 0.5 * (found[:, 2] + found[:, 3])
    assert_allclose(found[:, 0], mean, rtol=1e-12)
    assert_allclose(found[:, 1], mean, rtol=1e-12)


@pytest.mark.claim("sensors-response")
def test_a_steady_force_passes_a_chain_to_its_floor():
    """All contacts and the floor bear the force that is applied; the sensor in the first ball has
    one contact, and the force on its other side is no contact's.
    """
    network = held_chain()
    receivers = ["floor", (6, "x"), (0, 1), (4, 5), (3, "x"), (0, "x")]
    found = respond(network, receivers, np.array([0.0]), quantity="force")
    assert_allclose(found.values[0], [1.0, 1.0, 1.0, 1.0, 1.0, 0.5], rtol=1e-12)


@pytest.mark.claim("sensors-response")
@pytest.mark.parametrize("method", ["direct", "krylov"])
@pytest.mark.parametrize("omega", [FREQUENCIES, np.array([1e-3])], ids=["waves", "nearly steady"])
def test_a_floor_that_is_moved_bears_the_inertia_of_a_free_chain(method, omega):
    """The wall moves N free balls: its force is what accelerates them, -omega^2 M sum u_n, which is
    small against k u at low frequencies.
    """
    network = held_chain()
    for source, quantity in (("floor", "force"), ((6, "x"), "force"), ("floor", "stiffness")):
        found = respond(network, ["floor", (4, 5)], omega, source, quantity=quantity, method=method)
        assert found.quantity == "stiffness"
        assert found.to_dict()["units"]["values"] == "N/m"
        towards = -1.0 if source == "floor" else 1.0  # the floor is moved towards the balls
        balls = respond(
            network, (np.arange(6), "x"), omega, (6, "x"), quantity="transmissibility"
        ).values
        inertia = (omega * OMEGA) ** 2 * UNITS.mass * towards
        assert_allclose(found.values[:, 0], inertia * np.sum(balls, axis=1), rtol=1e-7)
        assert_allclose(found.values[:, 1], inertia * np.sum(balls[:, :5], axis=1), rtol=1e-7)


def test_dashpots_that_differ_are_those_of_the_contact():
    """By the process of first order, and by factors."""
    network = held_chain()
    times = np.linspace(0.02, 0.1, network.n_contacts) / OMEGA
    for source in ((0, "x"), "floor"):
        one, two = (
            respond(
                network,
                ["floor", (1, 2), (2, "x")],
                source=source,
                quantity="force",
                damping=times,
                method=method,
            )
            for method in ("direct", "krylov")
        )
        assert_allclose(two.values, one.values, rtol=1e-7)


@pytest.mark.claim("sensors-response")
def test_accelerance_is_receptance_times_the_square_of_the_frequency():
    network = held_chain()
    found = respond(network, (3, "x"), quantity="acceleration")
    receptance = respond(network, (3, "x")).values
    square = (2.0 * math.pi * found.frequencies[:, None]) ** 2
    assert_allclose(found.values, -square * receptance, rtol=1e-13)
    assert found.to_dict()["units"]["values"] == "1/kg"
    # a ball that is free resists by its mass alone at high frequencies
    high = respond(network, (0, "x"), np.array([300.0]), quantity="acceleration", damping=0.0)
    assert_allclose(high.values[0, 0] * UNITS.mass, 1.0, rtol=1e-4)


def test_forces_in_a_plane_are_components_along_the_sensor():
    """A steady push across a slab: two contacts at 60 degrees share it, k sin^2 by their normal
    forces and kappa cos^2 by slip; the floor bears all of it.
    """
    network = springs(ideal("triangular", 0.8)).repeat((3, 1)).cut(1, 4, ("free", "floor"))
    wall = int(np.flatnonzero(~network.moving)[0])
    receivers = ["plane", (wall, "y"), (wall, (math.sqrt(3.0), 1.0))]
    across = gp.Waves(network).response(
        [0.0], "plane", receivers, quantity="force", direction=(0, 1)
    )
    above = 0.75 / (0.75 + 0.8 * 0.25)
    assert_allclose(across.values[0, :3], 0.5 * (1.0 + above), rtol=1e-9)
    assert_allclose(across.values[0, 3:], [3.0, 1.5], rtol=1e-9)


@pytest.mark.claim("sensors-motion")
def test_a_sensor_in_motion_reads_the_mean_of_its_contacts():
    network = line(1e-9, 12)
    motion = gp.NonlinearWaves(network).run(2e-4, velocities=push(network, 0.1), frames=101)
    forces = motion.forces
    assert_allclose(motion.sensor(6), 0.5 * (forces[:, 5] + forces[:, 6]), rtol=1e-14)
    assert_allclose(motion.sensor(6, direction=(-2, 0, 0)), motion.sensor(6), rtol=1e-14)
    assert np.array_equal(motion.sensor((7, 8)), forces[:, 7])
    assert np.array_equal(motion.sensor((8, 7)), forces[:, 7])
    assert 0.5 < motion.sensor(6).max() / forces.max() < 1.0


@pytest.mark.claim("sensors-motion")
def test_the_floor_of_a_motion_bears_what_changes_the_momentum():
    """A column falls on its floor: the impulse of the floor is the change of the momentum."""
    column = gp.Crystal.on("chain", [gp.Ball(STEEL, D)]).cut(0, 3, edges=("floor", "free"))
    waves = gp.NonlinearWaves(column, geometry="exact")
    network = waves.network
    wall = int(np.flatnonzero(~network.moving)[0])
    velocities = np.where(network.moving, -0.1, 0.0)[:, None] * [[1.0, 0.0, 0.0]]
    motion = waves.run(3e-4, velocities=velocities, frames=1501)
    floor = motion.sensor("floor")
    assert np.array_equal(floor, motion.sensor(wall))
    momentum = np.sum(
        network.masses[network.moving, None] * motion.velocities[:, network.moving, 0].T, axis=0
    )
    assert_allclose(np.trapezoid(floor, motion.times), momentum[-1] - momentum[0], rtol=1e-3)


# -- what is refused -------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("receiver", "text"),
    [
        ((1, 3), "have no contact"),
        ((1, 99), "have no contact"),
        ("ceiling", "the receiver is"),
        ((3, "y"), "no contact along"),
        ([], "no receiver"),
        ((99, "x"), "0 to 6"),
    ],
)
def test_a_sensor_that_cannot_be(receiver, text):
    with pytest.raises(InputError, match=text):
        respond(held_chain(), receiver, quantity="force")


def test_what_is_no_sensor():
    with pytest.raises(InputError, match="is the contact"):
        respond(held_chain(), (2, 3))
    with pytest.raises(InputError, match="no floor"):
        respond(chain(6, ("clamped", "free")), "floor", source=(5, "x"), quantity="force")
    with pytest.raises(InputError, match="2 contacts"):
        respond(ideal("chain", 0.0).repeat((2,)), (0, 1), quantity="force")
    with pytest.raises(InputError, match="2 floors"):
        respond(chain(6, ("floor", "floor")), "floor", quantity="force")
    with pytest.raises(InputError, match="moves"):
        respond(held_chain(), (0, 1), source=[(0, "x"), "floor"], quantity="stiffness")
    for pair in ((np.timedelta64(0, "s"), 1), (True, 1), (0.0, 1), [0, 1]):
        assert not is_contact(pair)
    assert is_contact((np.int64(0), 1))
    motion = gp.NonlinearWaves(line(10.0, 4)).run(1e-6, frames=2)
    for receiver, text in (((0, 2), "no contact"), (9, "0 to 3"), ("floor", "no floor")):
        with pytest.raises(InputError, match=text):
            motion.sensor(receiver)


def test_contact_of_a_ball_with_its_own_image_is_heard_from_both_sides():
    one = ideal("square")
    axis = np.array([1.0, 0.0, 0.0])
    for network in (one, one.repeat((2, 1)), one.repeat((3, 3))):
        sensor = SensorPlaces.of(network).in_body(0, axis)
        force = sensor.weights @ network.normal_force[sensor.contacts]
        assert force == pytest.approx(one.normal_force[0], rel=1e-12)


def test_an_axis_is_open_if_periods_leave_it_but_for_rounding():
    strip = ideal("square").repeat((4, 1)).cut(1, 3)
    cell = strip.cell.copy()
    cell[0, 1] = 1e-17 * cell[0, 0]  # as by a rotation of the network
    rounded = replace(strip, cell=cell)
    assert list_open_axes(rounded) == list_open_axes(strip) == [1]
    found = gp.Waves(rounded).response([0.3 * HERTZ], "plane", "plane", 1e-6)
    assert found.receivers.size == 4
