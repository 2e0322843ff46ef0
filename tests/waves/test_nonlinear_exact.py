"""Balls that move by true directions, meet others, fall and stick; balances of energy, momentum and
angular momentum.
"""

from __future__ import annotations

import math
import warnings
from dataclasses import replace

import numpy as np
import pytest
from numpy.testing import assert_allclose
from scipy.optimize import least_squares

import granphon as gp
from granphon.balls.ball import ContactConstants
from granphon.base.errors import (
    InconsistencyWarning,
    InputError,
    LimitWarning,
    StoppedEarlyWarning,
)
from tests import packings
from tests.networks.test_cuts import D, bulk

STEEL = gp.Material(211.65e9, 0.276, 7840.0)
BALL = gp.Ball(STEEL, D)
C = 2.0 / 3.0 * STEEL.contact_modulus * math.sqrt(D)  # of f = C overlap^(3/2)
MASS = STEEL.density * math.pi / 6.0 * D**3


def flower(**options):
    """A ball and its six neighbours, which touch each other and nothing else."""
    angles = np.arange(6) * math.pi / 3.0
    places = np.concatenate([[[0.0, 0.0]], D * np.stack([np.cos(angles), np.sin(angles)], axis=1)])
    return gp.Crystal([BALL] * 7, [], places, **options)


def angular_momentum(waves, motion):
    """(n_f, 3) of balls and spins about the origin, kg m2/s."""
    masses = waves.network.masses
    inertias = waves.network.inertias
    orbits = np.einsum("n,fna->fa", masses, np.cross(motion.positions, motion.velocities))
    return orbits + np.einsum("n,fna->fa", inertias, motion.spins)


@pytest.mark.claim("nonlinear-balance")
@pytest.mark.parametrize(
    ("geometry", "mu", "damping"),
    [
        ("lattice", math.inf, 0.0),
        pytest.param("exact", math.inf, 0.0, marks=pytest.mark.slow),
        pytest.param("lattice", 0.2, 1e-7, marks=pytest.mark.slow),
        ("exact", 0.2, 1e-7),
    ],
)
def test_the_balance_of_energies_closes(geometry, mu, damping):
    """Of an array that is hit so that contacts open and slide, the midpoint scheme keeps the sum to
    1e-9, with losses.
    """
    network = bulk("triangular").repeat((3, 3)).cut(1, 1)
    velocities = 0.5 * np.random.default_rng(0).standard_normal((network.n_balls, 2))
    waves = gp.NonlinearWaves(network, friction_coefficient=mu, damping=damping, geometry=geometry)
    motion = waves.run(5e-5, velocities=velocities, frames=6, scheme="midpoint")
    assert motion.lost[-1] > 0.01 * motion.energy[0]
    assert_allclose((motion.energy + motion.lost) / motion.energy[0], 1.0, atol=1e-11)
    other = waves.run(5e-5, velocities=velocities, frames=6)
    assert_allclose((other.energy + other.lost) / other.energy[0], 1.0, atol=1e-3)
    assert_allclose(other.velocities, motion.velocities, atol=1e-2)


@pytest.mark.claim("nonlinear-balance")
def test_the_work_of_drives_is_in_the_balance():
    """A moved ball and a pushed one, with dashpots."""
    packing = gp.Packing(STEEL, D, lattice="chain", motions="in_plane")
    network = gp.AveragedLattice(packing).at_force(10.0).network.repeat((12,)).cut(0, 1)
    drives = [
        gp.Drive(0, (1, 0, 0), displacement=lambda time: 2e-7 * math.sin(3e5 * time) ** 2),
        gp.Drive(11, (1, 1, 0), force=lambda time: 2.0 * math.sin(2e5 * time)),
    ]
    motion = gp.NonlinearWaves(network, damping=3e-7).run(
        1e-4, drive=drives, frames=5, scheme="midpoint"
    )
    assert motion.work[-1] > 1e-9
    assert_allclose(motion.energy + motion.lost, motion.work, atol=1e-10 * motion.work[-1])


@pytest.mark.claim("nonlinear-exact")
@pytest.mark.parametrize(
    ("scheme", "duration"),
    [
        ("verlet", 1e-4),
        ("midpoint", 5e-5),
        pytest.param("verlet", 2e-4, marks=pytest.mark.slow),
        pytest.param("midpoint", 2e-4, marks=pytest.mark.slow),
    ],
)
def test_momentum_and_angular_momentum_are_exact(scheme, duration):
    """A cluster that flies apart with friction, dashpots and spins."""
    waves = gp.NonlinearWaves(flower(), friction_coefficient=0.3, damping=1e-7, geometry="exact")
    velocities = np.random.default_rng(0).standard_normal((7, 2)) - [0.4, 0.1]
    spins = np.zeros((7, 3))
    spins[2, 2] = 100.0
    motion = waves.run(duration, velocities=velocities, spins=spins, frames=5, scheme=scheme)
    momentum = np.einsum("n,fna->fa", waves.network.masses, motion.velocities)
    turning = angular_momentum(waves, motion)
    assert_allclose(momentum - momentum[0], 0.0, atol=1e-13 * 7 * MASS)
    assert_allclose(turning - turning[0], 0.0, atol=1e-13 * 7 * MASS * D)
    assert np.max(np.abs(np.diff(motion.spins[:, 0, 2]))) > 1.0


def test_exact_directions_of_small_motions_are_those_of_the_lattice():
    """In space, with friction, twist and rolling: both geometries agree to the ratio of
    displacement and diameter.
    """
    packing = gp.Packing(STEEL, D, lattice="fcc", friction=True, torsion=0.02, bending=0.01)
    network = gp.AveragedLattice(packing).at_overlap(1e-8 * D).network.repeat((2, 2, 2)).cut(2, 2)
    random = np.random.default_rng(3)
    speed = 0.3e-8 * D * math.sqrt(network.normal_stiffness[0] / network.masses[0])
    start = {"velocities": speed * random.standard_normal((network.n_balls, 3))}
    start["spins"] = 2.0 * speed / D * random.standard_normal((network.n_balls, 3))
    found = []
    for geometry in ("lattice", "exact"):
        waves = gp.NonlinearWaves(network, friction_coefficient=0.3, geometry=geometry)
        found.append(waves.run(5.0 * 1e-8 * D / speed, **start, frames=3))
    for name in ("velocities", "spins"):
        a, b = (getattr(one, name) for one in found)
        assert_allclose(b, a, atol=1e-6 * np.abs(a).max())


@pytest.mark.parametrize(
    ("scheme", "duration"),
    [
        ("verlet", 1e-5),
        ("midpoint", 1e-5),
        pytest.param("midpoint", 2e-5, marks=pytest.mark.slow),
    ],
)
def test_numbers_in_the_plane_are_vectors_in_space(scheme, duration):
    """Balls of a plane that slide, roll, meet and part move the same as where all motions are
    allowed.
    """
    found = []
    for motions in ("in_plane", "all"):
        packing = gp.Packing(
            STEEL, D, lattice="triangular", friction=True, motions=motions, bending=0.02
        )
        network = (
            gp.AveragedLattice(packing)
            .at_overlap(1e-5 * D)
            .network.repeat((3, 3))
            .cut(1, 2, ("floor", "free"))
        )
        velocities = np.random.default_rng(0).standard_normal((network.n_balls, 3)) * [
            0.5,
            0.5,
            0.0,
        ]
        velocities[~network.moving] = 0.0
        waves = gp.NonlinearWaves(network, friction_coefficient=0.3, damping=1e-7, geometry="exact")
        drive = gp.Drive(
            np.flatnonzero(~network.moving),
            (0, 1),
            displacement=lambda t: 1e-6 * math.sin(1e5 * t) ** 2,
        )
        found.append(
            waves.run(
                duration, velocities=velocities, drive=drive, frames=5, step=1e-7, scheme=scheme
            )
        )
    plane, space = found
    for name in (
        "displacements",
        "velocities",
        "spins",
        "forces",
        "shears",
        "lost",
        "stored",
        "work",
    ):
        a = getattr(plane, name)
        b = getattr(space, name)
        assert_allclose(a, b, atol=1e-9 * np.abs(b).max())
    assert np.max(plane.spins) > 10.0
    assert np.max(plane.lost) > 0.0


def test_a_contact_turns_with_its_balls():
    """Two balls that roll about each other as one body keep their forces, in their own frame."""
    pair = gp.Crystal([BALL] * 2, [], [[0.0, 0.0], [D, 0.0]])
    rate = 20.0
    waves = gp.NonlinearWaves(pair, geometry="exact", law=None)
    # what holds them together on the circle is a spring that pushes from outside: the force of a
    # drive would turn too
    velocities = np.zeros((2, 3))
    spins = np.zeros((2, 3))
    velocities[:, 1], spins[:, 2] = [-0.5 * rate * D, 0.5 * rate * D], rate
    motion = waves.run(1e-5, velocities=velocities, spins=spins, frames=3, step=1e-7)
    assert_allclose(motion.shears, 0.0, atol=1e-9)
    assert_allclose(motion.spins[:, :, 2], rate, rtol=1e-12)


def meeting():
    """Balls of a chain that are put elsewhere: the last flies at the first, which it did not touch
    in the chain.
    """
    chain = gp.Crystal([BALL] * 3, [], D * np.array([[0.0, 0.0], [1.0, 0.0], [2.0, 0.0]]))
    places = D * np.array([[0.0, 0.0], [0.0, 3.0], [-1.01, 0.0]])
    return gp.NonlinearWaves(chain, geometry="exact"), {
        "positions": places,
        "velocities": [[0, 0], [0, 0], [2.0, 0]],
    }


@pytest.mark.claim("nonlinear-exact")
def test_balls_that_meet():
    """They exchange their velocities, with the greatest force of Hertz, in a column of its own."""
    waves, start = meeting()
    duration = 0.03 * D / 2.0
    motion = waves.run(duration, **start, frames=151, step=duration / 1200)
    assert motion.forces.shape[1] == 3
    assert motion.met.tolist() == [[0, 2]]
    assert_allclose(motion.peaks()[1][2], C * (1.25 * 0.5 * MASS / C * 2.0**2) ** 0.6, rtol=1e-4)
    assert_allclose(motion.velocities[-1, :, 0], [2.0, 0.0, 0.0], atol=1e-5)
    assert_allclose(motion.arrivals(1e-3)[2], 0.01 * D / 2.0, rtol=0.02)


def test_a_motion_goes_on_from_a_frame_in_which_balls_that_have_met_touch():
    """Their force is there from the start."""
    waves, start = meeting()
    whole = waves.run(0.018 * D / 2.0, **start, frames=61)
    frame = int(np.argmax(whole.forces[:, 2]))
    later = waves.run(
        whole.times[-1] - whole.times[frame],
        whole.positions[frame],
        whole.velocities[frame],
        frames=61 - frame,
        step=whole.step,
    )
    assert_allclose(later.forces[0], whole.forces[frame], rtol=1e-9, atol=1e-9)
    assert_allclose(later.energy, whole.energy[frame:], rtol=1e-9)
    assert_allclose(later.velocities[-1], whole.velocities[-1], atol=1e-9)


def test_a_network_that_names_no_kinds_has_the_law_of_a_crystal_of_one():
    crystal = gp.Crystal.on("sc", [gp.Ball(STEEL, D, name="A")], law=gp.JKR(1.0))
    network = crystal.at_overlap(1e-6).network.repeat((2, 2, 2))
    named, plain = (
        gp.NonlinearWaves(replace(network, kinds=kinds), crystal) for kinds in (network.kinds, None)
    )
    assert_allclose(plain.overlap, named.overlap, rtol=0.0)
    with pytest.raises(InputError, match="not of the kinds"):
        gp.NonlinearWaves(replace(network, kinds=None), unlike([("A", "B"), ("B", "C")]))


TABLE = gp.TabulatedLaw([1e-8, 1e-4], [1e-4, 1e4])


@pytest.mark.parametrize(
    ("law", "given"),
    [
        (gp.PowerLaw(2.0, 1e12), False),
        pytest.param(gp.DMT(1e-6), False, marks=pytest.mark.slow),
        pytest.param(TABLE, False, marks=pytest.mark.slow),
        pytest.param(TABLE, True, marks=pytest.mark.slow),
    ],
)
def test_balls_that_meet_have_their_own_law(law, given):
    """Not that of the contacts of the crystal, nor that of the crystal where another is given: its
    energy is (m/4) v^2.
    """
    kinds = [gp.Ball(STEEL, D, name=name) for name in "ABC"]
    laws = {("A", "B"): gp.Hertz(), ("B", "C"): gp.Hertz(), ("A", "C"): law}
    chain = gp.Crystal(
        kinds,
        [],
        D * np.array([[0.0, 0.0], [1.0, 0.0], [2.0, 0.0]]),
        law=gp.Hertz() if given else laws,
    )
    waves = gp.NonlinearWaves(
        chain.touch() if given else chain, law if given else None, geometry="exact"
    )
    highest = waves.run(0.015 * D / 2.0, **meeting()[1], frames=76).peaks()[1][2]
    pair = law.between(kinds[0], kinds[2])
    assert_allclose(pair.energy(pair.overlap(highest)), 0.25 * MASS * 2.0**2, rtol=1e-3)


def unlike(laws):
    """A chain of three materials, whose ends do not touch; the laws of their pairs."""
    materials = STEEL, gp.Material(100e9, 0.34, 8500.0), gp.Material(3e9, 0.42, 1150.0)
    kinds = [gp.Ball(one, D, name=name) for one, name in zip(materials, "ABC", strict=True)]
    return gp.Crystal(
        kinds,
        [],
        D * np.array([[0.0, 0.0], [1.0, 0.0], [2.0, 0.0]]),
        law=dict.fromkeys(laws, gp.Hertz()),
    )


@pytest.mark.slow
def test_kinds_without_a_law_end_a_run_where_they_meet():
    """What was before is kept, and the kinds are told; balls that come near and do not meet go
    on.
    """
    waves = gp.NonlinearWaves(unlike([("A", "B"), ("B", "C")]), geometry="exact")
    (_, start) = meeting()
    with pytest.warns(StoppedEarlyWarning, match=r"law .*\('A', 'C'\)"):
        motion = waves.run(0.012 * D / 2.0, **start, frames=121)
    assert_allclose(motion.times[-1], 0.01 * D / 2.0, rtol=0.01)
    assert_allclose(motion.velocities[-1, 2, 0], 2.0)
    past = D * np.array([[0.0, 0.0], [0.0, 3.0], [-1.01, -0.1]])
    duration = 0.15 * D / 2.0
    assert len(waves.run(duration, past, [[0, 0], [0, 0], [0, 2.0]], frames=9).times) == 9


def test_balls_that_meet_resist_shear_as_their_own_pair():
    """T = kappa s, with kappa = 8 G* a of the two materials, and not the mean of contacts."""
    crystal = unlike([("A", "B"), ("B", "C"), ("A", "C")])
    deep = 1e-6 * D
    step = 1e-9
    speed = 1e-3
    places = D * np.array([[0.0, 0.0], [0.0, 3.0], [-1.0 + deep / D, 0.0]])
    waves = gp.NonlinearWaves(crystal, geometry="exact")
    motion = waves.run(step, places, [[0.0, 0.0], [0.0, 0.0], [0.0, speed]], frames=2, step=step)
    one = crystal.kinds[0].material
    other = crystal.kinds[2].material
    compliance = sum((2.0 - each.poisson_ratio) / each.shear_modulus for each in (one, other))
    assert_allclose(
        motion.shears[-1, 2],
        8.0 / compliance * math.sqrt(0.25 * D * deep) * speed * step,
        rtol=1e-6,
    )


@pytest.mark.parametrize(
    "law", [None, pytest.param(gp.PowerLaw(2.0, 1e11), marks=pytest.mark.slow)]
)
def test_balls_over_a_floor_meet_others(law):
    """Their law is that of contacts of balls, also where those with the floor have another, or the
    same.
    """
    column = (
        gp.Crystal.on("square", [BALL], law=law).cut(1, 2, edges=("floor", "free")).repeat((4,))
    )
    waves = gp.NonlinearWaves(column.at_pressure(1.0).network, law, geometry="exact")
    balls = np.flatnonzero(waves.network.moving)
    upper = balls[waves.network.positions[balls, 1] > 0.5 * D]
    places = waves.network.positions.copy()
    speeds = np.zeros((waves.network.n_balls, 3))
    places[upper] = D * np.array(
        [[0.0, 9.0, 0.0], [0.0, 20.0, 0.0], [1.001, 9.0, 0.0], [0.0, 30.0, 0.0]]
    )
    speeds[upper[2], 0] = -2.0
    motion = waves.run(0.012 * D / 2.0, places, speeds, frames=151)
    assert motion.met.tolist() == [[upper[0], upper[2]]]
    highest = motion.peaks()[1][-1]
    one = (law or gp.Hertz()).between(BALL, BALL)
    assert_allclose(one.energy(one.overlap(highest)), 0.25 * MASS * 2.0**2, rtol=1e-3)


def test_contacts_that_carry_nothing_at_rest_do_not_push_there():
    """Balls on each other under their weight touch those beside them, which no force holds
    apart.
    """
    block = gp.Crystal.on("square", [BALL]).cut(1, 3, edges=("floor", "free")).repeat((2,))
    waves = gp.NonlinearWaves(block.at_pressure(0.0, gravity=(0.0, -9.81)), geometry="exact")
    motion = waves.run(1e-4, frames=3)
    assert_allclose(
        motion.forces, np.broadcast_to(waves.network.normal_force, motion.forces.shape), rtol=1e-12
    )


@pytest.mark.parametrize("geometry", [pytest.param("lattice", marks=pytest.mark.slow), "exact"])
def test_a_ball_settles_into_a_floor_by_its_weight(geometry):
    """From touch it sinks to (5 m g/2c)^(2/3), and comes back."""
    column = gp.Crystal.on("chain", [BALL]).cut(0, 1, edges=("floor", "free"))
    c = 4.0 / 3.0 * STEEL.young_modulus / (1.0 - STEEL.poisson_ratio**2) * math.sqrt(0.5 * D)
    deep = (2.5 * MASS * 9.81 / c) ** (2.0 / 3.0)
    waves = gp.NonlinearWaves(column, geometry=geometry, gravity=(-9.81,))
    motion = waves.run(8e-4, frames=401)
    assert_allclose(-motion.displacements[:, 0, 0].min(), deep, rtol=1e-4)
    assert_allclose(motion.energy, 0.0, atol=1e-3 * MASS * 9.81 * deep)


def test_a_ball_that_falls_on_a_floor_bounces():
    """Gravity beside contacts: thrown up with 0.3 v from where it comes down with v, it is at the
    floor after 1.3 v/g, and leaves it after Hertz's 2.94326 delta_m/v.

    There the weight is small against forces, by 1e-4 of the velocity.
    """
    column = gp.Crystal.on("chain", [BALL]).cut(0, 1, edges=("floor", "free"))
    waves = gp.NonlinearWaves(column, geometry="exact", gravity=(-9.81,))
    v = 0.02
    c = 4.0 / 3.0 * STEEL.young_modulus / (1.0 - STEEL.poisson_ratio**2) * math.sqrt(0.5 * D)
    lasting = 2.94326 * (1.25 * MASS * v**2 / c) ** 0.4 / v
    top = v**2 / (2.0 * 9.81)
    start = {"displacements": [[0.91 * top], [0.0]], "velocities": [[0.3 * v], [0.0]]}
    motion = waves.run(1.5 * v / 9.81, **start, frames=401, step=1e-6)
    highest = int(np.argmax(motion.displacements[:, 0, 0]))
    assert_allclose(motion.displacements[highest, 0, 0], top, rtol=1e-5)
    assert_allclose(motion.arrivals(0.01)[0], 1.3 * v / 9.81, rtol=3e-3)  # a frame
    assert_allclose(motion.velocities[-1, 0, 0], 0.8 * v + 9.81 * lasting, atol=1e-4 * v)


def test_a_floor_may_be_either_end_of_a_contact():
    network = bulk("square").repeat((3, 1)).cut(1, 2, ("floor", "free"))
    ends = {"i": "j", "j": "i", "arm_i": "arm_j", "arm_j": "arm_i"}
    turned = {name: getattr(network, end) for name, end in ends.items()}
    turned |= {name: -getattr(network, name) for name in ("shift", "normal")}
    spins = np.where(network.moving[:, None], [0.0, 0.0, 3.0], 0.0)
    one, other = (
        gp.NonlinearWaves(each, geometry="exact").run(1e-4, spins=spins, frames=3)
        for each in (network, replace(network, lattice=None, **turned))
    )
    assert_allclose(
        other.displacements, one.displacements, atol=1e-9 * np.abs(one.displacements).max()
    )
    assert_allclose(other.middles[-3:], one.middles[-3:], atol=1e-12 * D)


def test_a_floor_may_be_listed_before_the_balls():
    """Its contacts are those of the network, and are not met anew; a ball meets it where it stands
    over the floor.
    """
    network = bulk("triangular").repeat((3, 1)).cut(1, 2, ("floor", "free"))
    order = np.roll(np.arange(network.n_balls), 1)
    place = np.argsort(order)
    moved = {
        name: getattr(network, name)[order] for name in ("positions", "radii", "masses", "inertias")
    }
    first = replace(
        network, lattice=None, shape=None, i=place[network.i], j=place[network.j], **moved
    )
    speeds = np.where(network.moving[:, None], [0.02, -0.03, 0.0], 0.0)
    one, other = (
        gp.NonlinearWaves(each, geometry="exact").run(1e-4, velocities=start, frames=3)
        for each, start in ((network, speeds), (first, speeds[order]))
    )
    assert other.met.size == 0
    assert_allclose(
        other.displacements[:, place],
        one.displacements,
        atol=1e-12 * np.abs(one.displacements).max(),
    )
    upper = int(np.argmax(np.where(network.moving, network.positions[:, 1], -np.inf)))
    wider = {name: np.pad(getattr(one, name), ((0, 0), (0, 1))) for name in ("forces", "shears")}
    met = replace(one, met=np.array([[upper, network.n_balls - 1]]), **wider)
    height = one.middles[np.isinf(network.distance)][0, 1]
    assert_allclose(met.middles[-1], [network.positions[upper, 0], height, 0.0], atol=1e-12 * D)


@pytest.mark.parametrize(
    ("law", "share", "scheme", "step", "error"),
    [
        (gp.JKR(0.1), 0.9, "verlet", 4e-7, 0.0),
        pytest.param(gp.JKR(0.1), 1.5, "verlet", 4e-8, 5e-4, marks=pytest.mark.slow),
        pytest.param(gp.JKR(0.1), 1.5, "midpoint", 2e-6, 1e-10, marks=pytest.mark.slow),
        (gp.DMT(0.1), 0.9, "verlet", 4e-7, 0.0),
        pytest.param(gp.DMT(0.1), 1.5, "verlet", 4e-8, 5e-4, marks=pytest.mark.slow),
        (gp.DMT(0.1), 1.5, "midpoint", 2e-6, 1e-10),
    ],
)
def test_balls_stick_or_part(law, share, scheme, step, error):
    """A slow ball does not come off; a fast one has lost what it takes to break the contact.

    The force ends with a jump, where the explicit scheme has an error of the step, and the other
    has none. The share is that of the energy that the balls have of what breaks the contact.
    """
    pair = gp.Crystal([BALL] * 2, [], [[0.0], [D]], law=law, friction=False)
    contact = law.between(BALL, BALL)
    overlap = float(contact.overlap(0.0))
    depth = float(contact.energy(contact.least_overlap)) - float(contact.energy(overlap))
    speed = math.sqrt(2.0 * share * depth / (0.5 * MASS))
    waves = gp.NonlinearWaves(pair)
    assert_allclose(waves.overlap, overlap)
    velocities = [[-0.5 * speed], [0.5 * speed]]
    motion = waves.run(1.2e-4, velocities=velocities, frames=13, step=step, scheme=scheme)
    apart = motion.displacements[-1, 1, 0] - motion.displacements[-1, 0, 0]
    assert (apart - overlap > -contact.least_overlap) == (share > 1.0)
    if share > 1.0:
        parting = motion.velocities[-1, 1, 0] - motion.velocities[-1, 0, 0]
        assert_allclose(parting, speed * math.sqrt(1.0 - 1.0 / share), rtol=error)


RUBBER = gp.Ball(gp.Material(5e6, 0.49, 1100.0), 2e-3)


def collide(law, speed, duration=3e-3, gap=1e-6, **options):
    """The motion of two balls of rubber that come from a little apart with this relative speed."""
    pair = gp.Crystal([RUBBER] * 2, [], [[0.0], [2e-3]], law=law, friction=False)
    waves = gp.NonlinearWaves(pair, geometry="exact")
    apart = 0.5 * (waves.overlap[0] + gap)
    start = {"displacements": [[-apart], [apart]], "velocities": [[0.5 * speed], [-0.5 * speed]]}
    return waves.run(duration, **start, **{"frames": 3} | options)


def restitution(motion):
    """The relative velocity after a collision over that before."""
    moves = motion.velocities[:, 1, 0] - motion.velocities[:, 0, 0]
    return -moves[-1] / moves[0]


#: of the midpoint scheme the default selection has the shortest collision alone
COLLISIONS = [
    ("verlet", 0.1, 1e-3),
    pytest.param("verlet", 0.02, 2e-3, marks=pytest.mark.slow),
    ("verlet", 0.01, 3e-3),
    ("midpoint", 0.1, 3.2e-4),
    pytest.param("midpoint", 0.02, 2e-3, marks=pytest.mark.slow),
    pytest.param("midpoint", 0.01, 3e-3, marks=pytest.mark.slow),
]


@pytest.mark.claim("nonlinear-adhesion")
@pytest.mark.parametrize(("scheme", "speed", "duration"), COLLISIONS)
def test_balls_of_jkr_lose_energy_as_contacts_are_made_and_broken(scheme, speed, duration):
    """They touch at the overlap zero and part where the law ends; what is lost is in the balance of
    energies. At 0.01 m/s they stick.
    """
    law = gp.JKR(0.1).between(RUBBER, RUBBER)
    loss = law.energy(law.least_overlap) - law.energy(0.0)
    # 2 pi w a^2 times 3/10 less the fifth part of (3/4)^(4/3)
    expected = 2.0 * math.pi * 0.1 * law.spot**2 * (0.3 - 0.2 * 0.75 ** (4.0 / 3.0))
    assert_allclose(loss, expected, rtol=1e-12)
    step = {"verlet": None, "midpoint": 1e-5}[scheme]
    motion = collide(gp.JKR(0.1), speed, duration, scheme=scheme, step=step)
    assert_allclose(motion.lost[-1], loss, rtol=1e-6)
    if speed == 0.01:
        assert motion.forces[-1, 0] != 0.0
        return
    is_explicit = scheme == "verlet"
    share = loss / (0.25 * RUBBER.mass * speed**2)
    expected = math.sqrt(1.0 - share)
    assert_allclose(restitution(motion), expected, rtol=1e-3 if is_explicit else 1e-6)
    total = motion.energy + motion.lost
    assert_allclose(total, motion.energy[0], rtol=5e-4 if is_explicit else 1e-11)


@pytest.mark.claim("nonlinear-adhesion")
@pytest.mark.parametrize("law", [gp.DMT(0.1), pytest.param(gp.JKR(0.1), marks=pytest.mark.slow)])
def test_steps_where_forces_jump_are_of_second_order(law):
    contact = law.between(RUBBER, RUBBER)
    loss = contact.energy(contact.least_overlap) - contact.energy(0.0)
    share = loss / (0.25 * RUBBER.mass * 0.02**2)
    off = [
        restitution(collide(law, 0.02, 1e-3, step=step)) - math.sqrt(1.0 - share)
        for step in (1e-5, 5e-6, 2.5e-6)
    ]
    assert abs(off[0]) < 5e-4
    assert np.all(np.abs(off[:-1]) > 3.0 * np.abs(off[1:]))


@pytest.mark.claim("nonlinear-adhesion")
@pytest.mark.parametrize(
    ("frames", "speed"),
    [
        (11, 0.01),
        (101, 0.02),
        pytest.param(11, 0.02, marks=pytest.mark.slow),
        pytest.param(101, 0.01, marks=pytest.mark.slow),
    ],
)
def test_the_default_step_keeps_the_energy_where_forces_jump(frames, speed):
    """Whatever the frames, which change the step a little."""
    motion = collide(gp.DMT(0.1), speed, frames=frames)
    assert_allclose(motion.energy[-1], motion.energy[0], rtol=2e-4)
    assert_allclose(restitution(motion), 1.0, rtol=2e-4)


class Sudden:
    """A law that pushes with its whole force once balls touch, f = f_0 + k delta."""

    def energy(self, overlap):
        delta = np.maximum(overlap, 0.0)
        return 1e-4 * delta + 0.5 * 10.0 * delta**2

    def force(self, overlap):
        return np.where(np.asarray(overlap) > 0.0, 1e-4 + 10.0 * np.asarray(overlap), 0.0)

    def stiffness(self, overlap):
        return 10.0 * (np.asarray(overlap) > 0.0)

    def stiffness_slope(self, overlap):
        return np.zeros(np.shape(overlap))

    def overlap(self, force):
        return np.maximum(np.asarray(force) - 1e-4, 0.0) / 10.0


class Afar(Sudden):
    """A law whose balls attract each other from a distance on, with a constant force."""

    least_overlap = -1e-5

    def __init__(self, touch):
        self.touch_overlap = touch

    def energy(self, overlap):
        delta = np.asarray(overlap)
        return np.where(delta > -1e-5, 0.5 * 10.0 * np.maximum(delta, 0.0) ** 2 - 1e-5 * delta, 0.0)

    def force(self, overlap):
        return np.where(np.asarray(overlap) > -1e-5, 10.0 * np.maximum(overlap, 0.0) - 1e-5, 0.0)

    def overlap(self, force):
        return (np.asarray(force) + 1e-5) / 10.0


def test_laws_of_users_that_jump():
    """A force that comes at once; and one that acts from afar, which says so, or only once balls
    have touched.
    """
    motion = collide(Sudden(), 0.02)
    assert_allclose(restitution(motion), 1.0, rtol=1e-3)
    assert_allclose(collide(Afar(-1e-5), 0.02, gap=1.2e-5).lost, 0.0, atol=1e-16)
    assert_allclose(collide(Afar(0.0), 0.02, gap=1.2e-5).lost[-1], 1e-10, rtol=1e-5)


def test_a_table_that_rises_at_once_is_followed():
    """The default step is that of the steepest part on the way, and not of the end of the table."""
    table = gp.TabulatedLaw([1e-8, 1e-6, 1.1e-6, 1e-5], [1e-9, 1e-7, 1e-5, 1.1e-5])
    motion = collide(table, 0.01, 6e-3)
    assert motion.forces[-1, 0] == 0.0
    assert_allclose(restitution(motion), 1.0, rtol=2e-3)


def test_contacts_that_adhere_slip_against_the_stiffness_of_their_radius():
    """At no load 8 G* a of JKR's own radius, in motion too: the other ball hardly moves in so short
    a time.
    """
    pair = gp.Crystal([RUBBER] * 2, [], [[0.0, 0.0], [2e-3, 0.0]], law=gp.JKR(0.1))
    law = gp.JKR(0.1).between(RUBBER, RUBBER)
    constants = ContactConstants.of(RUBBER, RUBBER)
    kappa = constants.mindlin_ratio * 2.0 * constants.modulus * law.contact_radius(law.overlap(0.0))
    waves = gp.NonlinearWaves(pair, geometry="exact")
    way = gp.Drive(1, (0, 1, 0), lambda time: 1e-9 * time / 1e-6)
    motion = waves.run(1e-6, drive=way, frames=3, step=1e-8)
    assert_allclose(motion.shears[-1, 0], kappa * 1e-9, rtol=1e-3)


def test_a_table_of_hertz_law_moves_as_hertz_law():
    packing = gp.Packing(STEEL, D, lattice="chain", motions="longitudinal")
    network = gp.AveragedLattice(packing).at_force(10.0).network.repeat((8,)).cut(0, 1)
    overlap = np.geomspace(1e-12, 1e-3, 60)
    velocities = np.zeros((8, 1))
    velocities[0] = 0.3
    found = [
        gp.NonlinearWaves(network, law=law).run(5e-5, velocities=velocities, frames=5, step=1e-7)
        for law in (None, gp.TabulatedLaw(overlap, C * overlap**1.5))
    ]
    assert_allclose(found[1].forces, found[0].forces, rtol=1e-6, atol=1e-6)


def test_a_file_of_a_motion_grows_with_contacts_and_frames(tmp_path):
    """The frames in the file are those in memory, contacts that came later too, and a part of them
    can be read.
    """
    waves, start = meeting()
    path = tmp_path / "motion.nc"
    kept, streamed = (
        waves.run(0.014 * D / 2.0, **start, frames=43, file=where) for where in (None, path)
    )
    assert streamed == kept
    # it stays in the file, which may be larger than the memory
    assert isinstance(streamed.forces, np.memmap)
    assert not isinstance(kept.forces, np.memmap)
    assert kept.forces.shape[1] == 3
    for motion in (kept, streamed):
        motion.write(tmp_path / "again.nc")
        assert gp.Motion.read(tmp_path / "again.nc") == kept
    part = gp.Motion.read(path, frames=slice(10, 40, 3))
    assert_allclose(part.velocities, kept.velocities[10:40:3])
    for none in (slice(43, None), slice(None, None, -1)):
        with pytest.raises(InputError, match="frames is slice"):
            gp.Motion.read(path, frames=none)
    # a record that is not whole does not count
    raw = path.read_bytes()
    path.write_bytes(raw + b"\0" * 100)
    assert gp.Motion.read(path) == kept
    path.write_bytes(raw.replace(b'"pbc"', b'"pb?"'))
    with pytest.raises(InputError, match="damaged"):
        gp.Motion.read(path)
    path.write_bytes(b"not a motion")
    with pytest.raises(gp.GranphonError, match="records"):
        gp.Motion.read(path)


def test_a_motion_starts_from_the_history_of_friction():
    """An array that slid when it was pressed stays at rest; small motions let contacts at Coulomb's
    limit slide at once.
    """
    packing = gp.Packing(STEEL, D, spread=gp.Uniform(4e-6))
    array = gp.DirectSimulation(
        packing, shape=(6, 6), seed=1, friction_coefficient=0.2, friction_history=True
    )
    sample = array.at_force(2.0).samples[0]
    network = sample.network
    tangential = np.linalg.norm(network.tangential_force, axis=1)
    at_limit = np.isclose(tangential, 0.2 * network.normal_force, rtol=1e-9)
    assert 0 < np.count_nonzero(at_limit) < network.n_contacts
    most = {}
    for mu in (0.2, 0.4):
        waves = gp.NonlinearWaves(sample, friction_coefficient=mu, geometry="exact")
        rest = waves.run(1e-4, frames=5)
        assert_allclose(rest.shears, np.broadcast_to(tangential, rest.shears.shape), atol=1e-9)
        assert_allclose(rest.velocities, 0.0, atol=1e-12)
        velocities = 1e-6 * np.random.default_rng(0).standard_normal((network.n_balls, 2))
        moved = waves.run(1e-5, velocities=velocities, frames=2)
        most[mu] = np.max(moved.shears[-1] / (0.2 * moved.forces[-1]))
    assert most[0.2] == pytest.approx(1.0, abs=1e-12)
    assert most[0.4] > 1.0 + 1e-7


@pytest.mark.claim("nonlinear-linear")
@pytest.mark.parametrize("levers", ["radii", "arms"])
def test_small_motions_of_a_network_of_lammps_are_its_modes(levers):
    """Slip by the radii has no potential: a motion follows the whole matrix, and the modes its
    symmetric part, which differ by the second order of the excess of the radii over the arms.
    """
    files = [packings.FOLDER / f"disks_{part}.dump" for part in ("atoms", "pairs")]
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", InconsistencyWarning)  # no tangential forces are there
        network = gp.ContactNetwork.from_lammps(
            *files, packings.MATERIAL, prestress=True, slip_levers=levers
        )
    linear = gp.Waves(network)
    modes = linear.modes(5)
    number = 4
    shape = modes.vectors[number]
    scales = np.sqrt(np.stack([network.masses, network.masses, network.inertias], axis=1))
    waves = gp.NonlinearWaves(network, geometry="exact")
    size = 1e-6 * np.min(waves.overlap) / np.max(np.abs(shape[:, :2] / scales[:, :2]))
    moved = size * shape / scales
    zero = np.zeros(network.n_balls)
    start = {
        "displacements": np.stack([*moved[:, :2].T, zero], axis=1),
        "rotations": np.stack([zero, zero, moved[:, 2]], axis=1),
    }
    frequency = modes.frequencies[number]
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", LimitWarning)  # contacts are wide from the start
        motion = waves.run(2.0 / frequency, **start, frames=41)
    motions = np.concatenate([motion.displacements[..., :2], motion.rotations[..., -1:]], axis=2)
    amplitudes = np.einsum("tbm,bm->t", motions * scales, shape) / (size * np.sum(shape**2))

    def miss(parameters):
        height, ratio, sine = parameters
        phase = 2.0 * math.pi * ratio * frequency * motion.times
        return height * np.cos(phase) + sine * np.sin(phase) - amplitudes

    found = frequency * least_squares(miss, [1.0, 1.0, 0.0]).x[1]
    whole = linear.whole_modes(5).frequencies[number].real
    assert found == pytest.approx(whole, rel=2e-5)  # of the default step
    excess = np.max((network.radii[network.i] - network.arm_i) / network.arm_i)
    assert found == pytest.approx(frequency, rel=2e-5 + excess**2)
    by_arms = gp.Waves(replace(network, slip_levers="arms")).modes(5).frequencies[number]
    assert (abs(found / by_arms - 1.0) > 5e-4) == (levers == "radii")


def test_slip_of_yade_is_refused():
    state = gp.AveragedLattice(gp.Packing(STEEL, 8e-3)).at_force(2.0)
    network = replace(state.network.repeat((2, 2)), prestress=True, slip_levers="yade")
    with pytest.raises(InputError, match="yade"):
        gp.NonlinearWaves(network, geometry="exact")


def test_a_history_in_the_directions_of_the_lattice_stays_at_rest():
    """Loads hold the balls against tangential forces too: nothing moves, and the energies stay
    zero.
    """
    packing = gp.Packing(STEEL, 8e-3, spread=gp.Uniform(4e-6))
    array = gp.DirectSimulation(
        packing,
        shape=(6, 6),
        seed=1,
        friction_coefficient=0.2,
        friction_history=True,
        geometry="lattice",
    )
    sample = array.at_force(2.0).samples[0]
    assert np.any(sample.network.tangential_force)
    rest = gp.NonlinearWaves(sample, friction_coefficient=0.2).run(1e-4, frames=5)
    assert_allclose(rest.velocities, 0.0, atol=1e-12)
    assert_allclose(rest.energy, 0.0, atol=1e-20)
