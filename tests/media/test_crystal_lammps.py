"""A crystal of two kinds of balls, in LAMMPS with the coefficients of each pair of types: forces
and frequencies.
"""

import ctypes
from dataclasses import replace

import numpy as np
import pytest
from numpy.testing import assert_allclose

import granphon as gp
from granphon.waves.operator import WaveOperator
from tests import packings

STEEL = gp.Material(young_modulus=193e9, poisson_ratio=0.30, density=8000.0)
GLASS = gp.Material(young_modulus=70e9, poisson_ratio=0.22, density=2500.0)
D = 8e-3
#: materials of the two types
KINDS = (STEEL, GLASS)


def coefficients(slip):
    """The lines that set Hertz's law of each pair, and one of slip: E* and G* of both materials, by
    hand.
    """
    lines = []
    for a, one in enumerate(KINDS, 1):
        for b, other in enumerate(KINDS[a - 1 :], a):
            modulus = 1.0 / sum((1.0 - m.poisson_ratio**2) / m.young_modulus for m in (one, other))
            shear = 1.0 / sum(
                2.0 * (2.0 - m.poisson_ratio) * (1.0 + m.poisson_ratio) / m.young_modulus
                for m in (one, other)
            )
            tangential = f"mindlin {8.0 * shear!r} 0 1e9" if slip else "linear_nohistory 0 0"
            lines.append(
                f"pair_coeff {a} {b} hertz {4.0 / 3.0 * modulus!r} 0 tangential {tangential}"
                f" damping velocity"
            )
    return "\n".join(lines)


@pytest.fixture(scope="module")
def pressed():
    """Small balls in the gaps of a square lattice of large ones, of two materials, 3 x 3 cells,
    loaded unevenly.
    """
    balls = [
        gp.Ball(STEEL, D, spread=gp.Uniform(4e-6)),
        gp.Ball(GLASS, (np.sqrt(2.0) - 1.0) * D, spread=gp.Uniform(2e-6)),
    ]
    crystal = gp.Crystal(balls, np.diag([D, D]), [[0, 0], [0.5 * D, 0.5 * D]]).sample(
        (3, 3), seed=1
    )
    return crystal.at_strain([-2e-3, -1.5e-3, 0.0], finite_overlap=True)


@pytest.fixture(scope="module")
def lmp(pressed):
    running = packings.start_or_skip()
    network = pressed.network
    crystal = pressed.crystal
    side = np.diag(network.cell)[:2].tolist()
    places = np.mod(network.positions, [*side, 1.0])
    packings.fill(
        running,
        f"block 0 {side[0]!r} 0 {side[1]!r} {-D!r} {D!r}",
        places,
        (crystal.kind + 1).tolist(),
    )
    for ball, (radius, mass) in enumerate(
        zip(network.radii.tolist(), network.masses.tolist(), strict=True), 1
    ):
        running.command(f"set atom {ball} diameter {2.0 * radius!r} mass {mass!r}")
    running.commands_string(
        f"pair_style granular\n{coefficients(False)}\nneighbor 1e-4 bin\ntimestep 1e-12\nrun 0"
    )
    yield running
    running.close()


def gather(lmp, *names):
    return [np.array(lmp.gather_atoms(name, 1, 3)).reshape(-1, 3) for name in names]


def with_own_radii(pressed):
    """The network with the R of the balls in Hertz's law, where granphon has that of the mean
    balls.
    """
    network = pressed.network
    means = np.array([ball.radius for ball in pressed.crystal.balls])
    curvature = [
        1.0 / radii[network.i] + 1.0 / radii[network.j] for radii in (means, network.radii)
    ]
    factor = np.sqrt(curvature[0] / curvature[1])
    names = ("normal_force", "normal_stiffness", "shear_stiffness")
    return replace(network, **{name: factor * getattr(network, name) for name in names})


@pytest.mark.claim("crystal-lammps")
def test_balls_at_rest_are_at_rest_in_lammps(pressed, lmp, tmp_path):
    """LAMMPS takes R in Hertz's law from the radii of the balls themselves, not of the mean ones:
    3e-4 of a force.
    """
    atoms = tmp_path / "atoms.dump"
    pairs = tmp_path / "pairs.dump"
    packings.write_dumps(lmp, atoms, pairs)
    rows = np.array(
        [line.split() for line in pairs.read_text().split("dz tx ty tz")[-1].split("\n")[1:-1]],
        float,
    )
    network = pressed.network
    theirs = np.sort(np.abs(rows[:, 2]))
    assert len(rows) == network.n_contacts <= pressed.crystal.n_contacts
    assert_allclose(theirs, np.sort(with_own_radii(pressed).normal_force), rtol=1e-8)
    assert_allclose(theirs, np.sort(network.normal_force), rtol=3e-4)
    # what is left on a ball is that difference
    (left,) = gather(lmp, "f")
    assert np.max(np.abs(left)) < 1e-3 * np.mean(network.normal_force)


@pytest.mark.claim("crystal-lammps")
def test_frequencies_are_those_of_finite_differences_in_lammps(pressed, lmp):
    """One step of time at a velocity and spin. LAMMPS counts slip with radii, granphon with arms:
    parts of overlap/R.
    """
    network = pressed.network
    time = 1e-12
    size = 1e-10
    lmp.commands_string(f"{coefficients(True)}\nfix move all nve/sphere\ntimestep {time!r}")

    def go(motion):
        for name, values in (("v", motion[:, :3]), ("omega", motion[:, 3:])):
            lmp.scatter_atoms(name, 1, 3, (ctypes.c_double * values.size)(*(values / time).ravel()))
        lmp.command("run 1 post no")
        return np.hstack(gather(lmp, "f", "torque"))[:, [0, 1, 5]].ravel()

    columns = []
    for place in range(3 * network.n_balls):
        ball, axis = divmod(place, 3)
        motion = np.zeros((network.n_balls, 6))
        step = size / (1.0 if axis < 2 else 1e-3)
        motion[ball, (0, 1, 5)[axis]] = step
        ahead = go(motion)
        go(-motion)
        behind = go(-motion)
        go(motion)
        columns.append((behind - ahead) / (2.0 * step))
    root = np.sqrt(np.column_stack([network.masses] * 2 + [network.inertias]).ravel())
    theirs = np.array(columns).T / root / root[:, None]
    ours = WaveOperator(network).matrix.toarray()
    depth = np.max(pressed.overlap) / np.min(network.radii)
    assert_allclose(theirs, ours, rtol=0.0, atol=0.5 * depth * np.max(ours))
    squares = [np.linalg.eigvalsh(0.5 * (one + one.T)) for one in (theirs, ours)]
    assert_allclose(*squares, rtol=0.0, atol=0.5 * depth * np.max(ours))
    # with slip counted as there, and R of the balls themselves, nothing is left but the curvature
    # of Hertz's law over a step
    same = with_own_radii(pressed)
    by_arms = WaveOperator(same)
    by_radii = WaveOperator(
        replace(same, arm_i=network.radii[network.i], arm_j=network.radii[network.j])
    )
    expected = (
        by_arms.root.T @ by_radii.root + by_arms.matrix - by_arms.root.T @ by_arms.root
    ).toarray()
    assert_allclose(theirs, expected, rtol=0.0, atol=2e-5 * np.max(ours))
