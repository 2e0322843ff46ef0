"""An array in motion in LAMMPS: normal forces, slip with Coulomb's limit, spins; contacts open and
close.
"""

import ctypes
import warnings
from dataclasses import replace

import numpy as np
import pytest
from numpy.testing import assert_allclose

import granphon as gp
from granphon.base.errors import LimitWarning
from tests import packings

STEEL = gp.Material(young_modulus=193e9, poisson_ratio=0.30, density=8000.0)
D = 8e-3
SHAPE = (6, 6)
MU = 0.3
#: overlap over the diameter: directions and lever arms change by as much, which is what granphon
#: leaves out
OVERLAP = 1e-7


def move_in_lammps(network, motions, step, steps, slip, overlap=OVERLAP, mu=MU, tau=0.0):
    """Velocities, spins and forces (n, 3) after some steps from those at the start, ``motions`` (n,
    6).

    The viscosity of contacts over their stiffness is ``tau``, s. That of LAMMPS goes with the
    radius of contacts too.
    """
    lmp = packings.start_or_skip()
    cell = (1.0 - overlap) * network.cell
    m = STEEL
    (a, _, _), (tilt, b, _), _ = cell.tolist()
    modulus = 0.5 * m.young_modulus / (1.0 - m.poisson_ratio**2)
    shear = m.young_modulus / (2.0 * (1.0 + m.poisson_ratio))
    viscosity = float(2.0 * modulus * tau / (0.5 * network.masses[0]))
    across = float(network.shear_stiffness[0] / network.normal_stiffness[0]) if tau else 0.0
    stiffness = 4.0 * shear / (2.0 - m.poisson_ratio)
    tangential = (
        f"mindlin_rescale/force {stiffness!r} {across!r} {mu!r}" if slip else "linear_nohistory 0 0"
    )
    n = network.n_balls
    inverse = np.linalg.inv(cell[:2, :2])
    places = np.zeros((n, 3))
    places[:, :2] = (
        np.mod((1.0 - overlap) * network.positions[:, :2] @ inverse + 0.01, 1.0) @ cell[:2, :2]
    )
    packings.fill(lmp, f"prism 0 {a!r} 0 {b!r} {-D!r} {D!r} {tilt!r} 0 0", places)
    lmp.commands_string(f"""
        set group all diameter {D!r} mass {float(network.masses[0])!r}
        pair_style granular
        pair_coeff * * hertz {4.0 / 3.0 * modulus!r} {viscosity!r} tangential {tangential} damping viscoelastic
        neighbor 1e-3 bin
        fix move all nve/sphere
        timestep {float(step)!r}""")
    for name, values in (("v", motions[:, :3]), ("omega", motions[:, 3:])):
        lmp.scatter_atoms(name, 1, 3, (ctypes.c_double * values.size)(*values.ravel()))
    lmp.command(f"run {steps} post no")
    found = [np.array(lmp.gather_atoms(name, 1, 3)).reshape(-1, 3) for name in ("v", "omega", "f")]
    lmp.close()
    return found


def differences(slip, finer, geometry="lattice", overlap=OVERLAP, count=500, levers="arms"):
    """Rms differences of velocities, spins and forces over their rms, after the time of
    ``count`` coarse steps.

    The forces on our balls are their masses times the change of their velocities from one coarse
    step before to one after.
    """
    packing = gp.Packing(STEEL, D, friction=slip)
    exact = geometry == "exact"
    network = (
        gp.AveragedLattice(packing)
        .at_overlap(overlap * D, finite_overlap=exact)
        .network.repeat(SHAPE)
    )
    if levers == "radii":
        network = replace(network, slip_levers=levers, lattice=None, shape=None)
    # balls without friction have no limit of slip
    limit = {"friction_coefficient": MU} if slip else {}
    waves = gp.NonlinearWaves(network, geometry=geometry, **limit)
    random = np.random.default_rng(2)
    speed = overlap * D * np.sqrt(network.normal_stiffness[0] / network.masses[0])
    motions = np.zeros((network.n_balls, 6))
    motions[:, :2] = speed * random.standard_normal((network.n_balls, 2))
    step = 2e-3 / speed * overlap * D
    motion = waves.run(
        (count + 1) * step,
        velocities=motions[:, :3],
        spins=motions[:, 3:],
        frames=count + 2,
        step=step / finer,
    )
    assert np.any(motion.forces[-1] == 0.0)
    # the network of a finite overlap has the true cell
    theirs = move_in_lammps(
        network, motions, step / finer, count * finer, slip, 0.0 if exact else overlap
    )
    forces = (
        network.masses[:, None] * (motion.velocities[-1] - motion.velocities[-3]) / (2.0 * step)
    )
    ours = motion.velocities[-2], motion.spins[-2], forces
    return [
        np.sqrt(np.mean((a - b) ** 2) / max(np.mean(a**2), 1e-300))
        for a, b in zip(ours, theirs, strict=True)
    ]


@pytest.mark.claim("nonlinear-lammps")
def test_balls_without_friction_move_as_in_lammps():
    """The same steps; what is left is the part of directions that the overlap changes."""
    velocities, _, forces = differences(False, 1)
    assert velocities < 1e-6
    assert forces < 1e-5  # of which the step of the difference takes half


@pytest.mark.claim("nonlinear-lammps")
def test_balls_with_friction_move_as_in_lammps():
    """Slip up to Coulomb's limit, in 1e-4; LAMMPS takes the stiffness at the end of a step, which
    is of first order.
    """
    coarse, fine = (np.array(differences(True, finer, count=1000)) for finer in (1, 2))
    assert np.all(fine < 1e-4)
    assert np.all(np.abs(np.log2(coarse / fine) - 1.0) < 0.1)


@pytest.mark.claim("nonlinear-exact")
def test_balls_in_true_directions_move_as_in_lammps():
    """At an overlap of 1e-3 of the diameter the lattice's directions are wrong by as much; the true
    ones are LAMMPS's.
    """
    assert differences(False, 1, "exact", 1e-3)[0] < 1e-10
    assert differences(False, 1, "lattice", 1e-3)[0] > 1e-3


@pytest.mark.slow
@pytest.mark.claim("nonlinear-exact")
def test_balls_in_true_directions_with_friction_move_as_in_lammps():
    """Lever arms of LAMMPS are of first order in the overlap, and so is what is left beside its
    step.
    """
    assert np.all(np.array(differences(True, 2, "exact", 1e-5, count=1000)) < 1e-4)


@pytest.mark.claim("nonlinear-exact")
def test_slip_by_the_radii_moves_as_in_lammps():
    """At an overlap of 1e-2 of the diameter slip by the arms is wrong by as much; by the radii,
    what is left is of first order in LAMMPS' step.
    """
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", LimitWarning)  # contacts are wide
        by_arms = np.array(differences(True, 1, "exact", 1e-2))
        by_radii = [np.array(differences(True, n, "exact", 1e-2, levers="radii")) for n in (1, 2)]
    assert np.all(by_radii[0] < 4e-4)
    assert np.all(np.abs(by_radii[0] / by_radii[1] - 2.0) < 0.1)
    assert np.all(by_arms[:2] > 2e-3)


def differences_of_steps(slip, mu=MU, share=0.0, finer=1):
    """Rms differences, over the rms, of velocities and spins after a thousand default steps.

    They are those from LAMMPS in the same steps, or in ``finer`` ones; and of default steps those
    from steps of a quarter. The viscosity of contacts is ``share``, as tau times their frequency.
    """
    network = (
        gp.AveragedLattice(gp.Packing(STEEL, D, friction=slip))
        .at_overlap(OVERLAP * D)
        .network.repeat(SHAPE)
    )
    rate = np.sqrt(network.normal_stiffness[0] / network.masses[0])
    tau = share / rate
    limit = {"friction_coefficient": mu} if slip else {}
    waves = gp.NonlinearWaves(network, damping=tau, **limit)
    motions = np.zeros((network.n_balls, 6))
    motions[:, :2] = (
        OVERLAP * D * rate * np.random.default_rng(2).standard_normal((network.n_balls, 2))
    )
    step = waves.find_step(float(np.max(np.linalg.norm(motions[:, :3], axis=1))))
    start = {"velocities": motions[:, :3], "spins": motions[:, 3:], "frames": 2}
    ours = waves.run(1000 * step, step=step / finer, **start)
    fine = waves.run(1000 * step, step=step / 4, **start) if finer == 1 and not share else ours
    theirs = move_in_lammps(network, motions, ours.step, 1000 * finer, slip, mu=mu, tau=tau)

    def compare(others):
        found = ours.velocities[-1], ours.spins[-1]
        return [
            np.sqrt(np.mean((a - b) ** 2) / max(np.mean(a**2), 1e-300))
            for a, b in zip(found, others, strict=True)
        ]

    return compare(theirs[:2]), compare((fine.velocities[-1], fine.spins[-1]))


@pytest.mark.claim("nonlinear-steps")
def test_a_thousand_default_steps():
    """Our own step counts for less than 1 %; LAMMPS is of first order in friction, and alike
    without.
    """
    theirs, step = differences_of_steps(False)
    assert theirs[0] < 1e-5
    assert step[0] < 1e-2
    theirs, step = differences_of_steps(True)
    assert np.all(np.array(theirs) < 1e-2)
    assert np.all(np.array(step) < 1e-2)


@pytest.mark.claim("nonlinear-coulomb")
def test_coulombs_limit_is_that_of_the_law_without_dashpots():
    """LAMMPS takes the force of the dashpot too: without the limit the difference falls with the
    step, with it not.
    """
    sticks, slides = (
        [max(differences_of_steps(True, mu, 0.05, finer)[0]) for finer in (1, 4)]
        for mu in (1e9, MU)
    )
    assert sticks[0] < 2e-2
    assert sticks[1] < 0.4 * sticks[0]
    assert min(slides) > 0.05


RUBBER = gp.Ball(gp.Material(5e6, 0.49, 1100.0), 2e-3)


def collide_in_lammps(speed, steps, step=5e-8, gap=1e-6, spin=0.0, friction=None):
    """Velocities and spins (n, 3) of two balls of rubber that adhere by JKR's law with 0.1 J/m^2,
    after some steps.

    LAMMPS takes the energy of one surface, which is half of the work of adhesion.
    """
    lmp = packings.start_or_skip()
    side = 20.0 * RUBBER.diameter
    middle = 10.0 * RUBBER.diameter
    m = RUBBER.material
    places = np.full((2, 3), middle)
    places[1, 0] += RUBBER.diameter + gap
    packings.fill(lmp, f"block 0 {side!r} 0 {side!r} 0 {side!r}", places, dimension=3)
    tangential = (
        "linear_nohistory 0 0" if friction is None else f"mindlin/force NULL 0 {friction!r}"
    )
    lmp.commands_string(f"""
        set group all diameter {RUBBER.diameter!r} density {m.density!r}
        pair_style granular
        pair_coeff * * jkr {m.young_modulus!r} 0 {m.poisson_ratio!r} 0.05 tangential {tangential} damping velocity
        neighbor 1e-3 bin
        fix move all nve/sphere
        timestep {step!r}""")
    motions = np.zeros((2, 6))
    motions[:, 0] = 0.5 * speed, -0.5 * speed
    motions[:, 5] = spin
    for name, values in (("v", motions[:, :3]), ("omega", motions[:, 3:])):
        lmp.scatter_atoms(name, 1, 3, (ctypes.c_double * values.size)(*values.ravel()))
    lmp.command(f"run {steps} post no")
    found = [np.array(lmp.gather_atoms(name, 1, 3)).reshape(-1, 3) for name in ("v", "omega")]
    lmp.close()
    return found


@pytest.mark.claim("nonlinear-adhesion")
def test_balls_that_adhere_by_jkr_bounce_as_in_lammps():
    """Contacts are made where balls touch, and break where the force of tension is largest."""
    pair = gp.Crystal([RUBBER] * 2, [], [[0.0], [RUBBER.diameter]], law=gp.JKR(0.1), friction=False)
    waves = gp.NonlinearWaves(pair, geometry="exact")
    apart = 0.5 * (waves.overlap[0] + 1e-6)
    for speed in (0.02, 0.05):
        start = {
            "displacements": [[-apart], [apart]],
            "velocities": [[0.5 * speed], [-0.5 * speed]],
        }
        ours = waves.run(2e-3, frames=2, **start).velocities[-1]
        theirs = collide_in_lammps(speed, 40_000)[0]
        assert_allclose(ours[:, 0], theirs[:, 0], rtol=1e-3)


@pytest.mark.claim("jkr-shear")
def test_contacts_of_jkr_are_as_stiff_in_shear_as_in_lammps():
    """Two balls at rest spin against each other, for a small part of the period of their slip."""
    pair = gp.Crystal([RUBBER] * 2, [], [[0.0, 0.0], [RUBBER.diameter, 0.0]], law=gp.JKR(0.1))
    waves = gp.NonlinearWaves(pair, geometry="exact")
    spins = np.zeros((2, 3))
    spins[:, 2] = 0.01
    ours = waves.run(1e-4, spins=spins, frames=2, step=1e-7).spins[-1, :, 2]
    theirs = collide_in_lammps(0.0, 1000, 1e-7, -float(waves.overlap[0]), 0.01, 1e3)[1][:, 2]
    assert np.all(np.abs(ours - 0.01) > 1e-4)
    assert_allclose(ours - 0.01, theirs - 0.01, rtol=3e-3)


STEEL_PAIR = [gp.Ball(STEEL, D)] * 2


def bounce_in_lammps(motions, step, steps, damping, tangential="linear_nohistory 0 0"):
    """Velocities and spins (n, 3) of two balls of steel that touch, after some steps from
    ``motions`` (n, 6) at the start; ``damping`` is a restitution and the words of a damping.
    """
    lmp = packings.start_or_skip()
    side = 20.0 * D
    places = np.full((2, 3), 10.0 * D)
    places[1, 0] += D
    packings.fill(lmp, f"block 0 {side!r} 0 {side!r} 0 {side!r}", places, dimension=3)
    restitution, words = damping
    law = f"{STEEL.young_modulus!r} {restitution!r} {STEEL.poisson_ratio!r}"
    lmp.commands_string(f"""
        set group all diameter {D!r} density {STEEL.density!r}
        pair_style granular
        pair_coeff * * hertz/material {law} tangential {tangential} damping {words}
        neighbor 1e-3 bin
        fix move all nve/sphere
        timestep {step!r}""")
    for name, values in (("v", motions[:, :3]), ("omega", motions[:, 3:])):
        lmp.scatter_atoms(name, 1, 3, (ctypes.c_double * values.size)(*values.ravel()))
    lmp.command(f"run {steps} post no")
    found = [np.array(lmp.gather_atoms(name, 1, 3)).reshape(-1, 3) for name in ("v", "omega")]
    lmp.close()
    return found


@pytest.mark.claim("losses-lammps")
@pytest.mark.parametrize(
    ("words", "restitution"),
    [("tsuji", 0.3), ("tsuji", 0.9), ("coeff_restitution", 0.5), ("tsuji limit_damping", 0.5)],
)
def test_a_collision_loses_as_much_as_in_lammps(words, restitution):
    """LAMMPS has Tsuji's polynomial in e for the dashpot, made for the mass of a ball, with the
    reduced mass: collisions have another restitution, which follows from our law of the dashpot.
    """
    own = restitution
    if "tsuji" in words:
        powers = [4.8218, -18.022, 27.467, -22.348, 11.087, -4.2783, 1.2728]
        ratio = np.polyval(powers, restitution) / np.sqrt(5.0)
        own = float(np.exp(-np.pi * ratio / np.sqrt(1.0 - ratio**2)))
        assert own > restitution + 0.02
    pair = gp.Crystal(STEEL_PAIR, [], [[0.0], [D]], friction=False)
    pull = "limited" if "limit" in words else "whole"
    waves = gp.NonlinearWaves(pair, restitution=own, viscous_pull=pull)
    step = waves.find_step(0.05) / 16.0
    ours = waves.run(4800 * step, velocities=[[0.05], [-0.05]], frames=2, step=step)
    motions = np.zeros((2, 6))
    motions[:, 0] = 0.05, -0.05
    theirs, _ = bounce_in_lammps(motions, step, 4800, (restitution, words))
    assert_allclose(ours.velocities[-1, :, 0], theirs[:, 0], rtol=1e-3)


@pytest.mark.claim("losses-lammps")
@pytest.mark.parametrize("speed", [0.05, 0.2])
def test_coulombs_limit_of_all_forces_is_that_of_lammps(speed):
    """An oblique collision with slip: that of the law alone lets other spins remain."""
    pair = gp.Crystal(STEEL_PAIR, [], [[0.0, 0.0], [D, 0.0]])
    motions = np.zeros((2, 6))
    motions[:, 0] = 0.05, -0.05
    motions[:, 1] = 0.5 * speed, -0.5 * speed
    found = {}
    for coulomb in ("total", "elastic"):
        waves = gp.NonlinearWaves(
            pair, restitution=0.5, friction_coefficient=MU, coulomb=coulomb, geometry="exact"
        )
        step = gp.NonlinearWaves(pair, restitution=0.5).find_step(0.05) / 4.0
        run = waves.run(1200 * step, velocities=motions[:, :3], frames=2, step=step)
        found[coulomb] = run.velocities[-1], run.spins[-1]
    tangential = f"mindlin_rescale/force NULL 1.0 {MU!r}"
    velocities, spins = bounce_in_lammps(
        motions, step, 1200, (0.5, "coeff_restitution"), tangential
    )
    scale = np.max(np.abs(spins))
    assert_allclose(found["total"][0], velocities, atol=1e-3 * 0.05)
    assert_allclose(found["total"][1], spins, atol=1e-3 * scale)
    assert np.max(np.abs(found["elastic"][1] - spins)) > 0.02 * scale
