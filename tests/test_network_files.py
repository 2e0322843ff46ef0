"""Networks from files: dumps of LAMMPS, against LAMMPS' own forces; tables of balls and contacts, read and written."""

import ctypes
import json
import re
from dataclasses import replace

import numpy as np
import packings
import pytest

import granphon as gp
from granphon.balls.hertz import HertzLaw
from granphon.waves.operator import WaveOperator

GLASS = packings.MATERIAL
NAMES = list(packings.KEPT)


def dumps(name):
    return packings.FOLDER / f"{name}_atoms.dump", packings.FOLDER / f"{name}_pairs.dump"


@pytest.fixture(scope="module", params=NAMES)
def packing(request):
    """A packing that LAMMPS has relaxed, with its rattlers."""
    return gp.ContactNetwork.from_lammps(*dumps(request.param), GLASS, keep_rattlers=True)


@pytest.fixture(scope="module", params=[(2, 30, 0.86, 0), (3, 36, 0.65, 1)], ids=NAMES)
def lmp(request):
    """LAMMPS with a relaxed packing, in which no contact is so weak that a small step opens it."""
    try:
        running = packings.start()
    except (ImportError, OSError) as error:
        pytest.skip(f"LAMMPS cannot be loaded: {error}")
    packings.relax(running, *request.param)
    yield running
    running.close()


# -- LAMMPS ---------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("name", "dimension", "balls", "contacts", "loose"), [("disks", 2, 30, 64, 1), ("balls", 3, 36, 125, 1)]
)
def test_dumps_of_lammps(name, dimension, balls, contacts, loose):
    network = gp.ContactNetwork.from_lammps(*dumps(name), GLASS)
    whole = gp.ContactNetwork.from_lammps(*dumps(name), GLASS, keep_rattlers=True)
    assert (whole.n_balls, whole.n_contacts, whole.left_out) == (balls, contacts, 0)
    assert (network.n_balls, network.left_out, whole.rattlers.size) == (balls - loose, loose, loose)
    assert network.dimension == dimension
    assert network.pbc == (True, True, dimension == 3)
    np.testing.assert_array_equal(whole.labels, np.arange(1, balls + 1))
    np.testing.assert_array_equal(network.labels, np.delete(whole.labels, whole.rattlers))
    assert not network.rattlers.size
    assert len(network.pieces()) == 1
    # the box that holds these balls, their masses as solid spheres, and forces that hold each ball in balance
    filled = packings.KEPT[name][2]
    volumes = np.pi * whole.radii**2 if dimension == 2 else 4.0 / 3.0 * np.pi * whole.radii**3
    side = (volumes.sum() / filled) ** (1.0 / dimension)
    np.testing.assert_allclose(whole.cell[:dimension, :dimension], side * np.eye(dimension), rtol=1e-8)
    np.testing.assert_allclose(whole.masses, GLASS.density * 4.0 / 3.0 * np.pi * whole.radii**3, rtol=1e-8)
    np.testing.assert_allclose(whole.inertias, 0.4 * whole.masses * whole.radii**2)
    pull = np.zeros((balls, 3))
    np.add.at(pull, whole.j, whole.normal * whole.normal_force[:, None])
    np.add.at(pull, whole.i, -whole.normal * whole.normal_force[:, None])
    assert np.max(np.abs(pull)) < 1e-7 * whole.normal_force.mean()  # nine digits are in the files


def test_forces_of_lammps_are_those_of_hertz(packing):
    radius = packing.radii[packing.i] * packing.radii[packing.j] / (packing.radii[packing.i] + packing.radii[packing.j])
    overlap = packing.radii[packing.i] + packing.radii[packing.j] - np.linalg.norm(packing.vector, axis=1)
    modulus = GLASS.young_modulus / (2.0 * (1.0 - GLASS.poisson_ratio**2))
    np.testing.assert_allclose(
        packing.normal_force, 4.0 / 3.0 * modulus * np.sqrt(radius) * np.maximum(overlap, 0.0) ** 1.5,
        rtol=1e-5, atol=1e-6 * packing.normal_force.mean(),
    )  # fmt: skip
    deep = packing.normal_force > 1e-3 * packing.normal_force.mean()
    spring = 2.0 * modulus * np.sqrt(radius * np.maximum(overlap, 0.0))
    np.testing.assert_allclose(packing.normal_stiffness[deep], spring[deep], rtol=1e-4)
    np.testing.assert_allclose(packing.shear_stiffness, GLASS.mindlin_ratio * packing.normal_stiffness)
    np.testing.assert_allclose(packing.arm_i + packing.arm_j, np.linalg.norm(packing.vector, axis=1))
    np.testing.assert_allclose(packing.radii[packing.i] - packing.arm_i, 0.5 * overlap, rtol=1e-9, atol=1e-12)


@pytest.mark.parametrize("name", NAMES)
def test_vectors_and_forces_of_a_dump_may_be_missing(name, tmp_path):
    atoms, pairs = dumps(name)
    whole = gp.ContactNetwork.from_lammps(atoms, pairs, GLASS, keep_rattlers=True)
    # three columns, without names: the vectors are those to the nearest images
    head, below = re.split(r"(?<=\n)ITEM: ENTRIES.*\n", pairs.read_text())
    rows = [line.split()[:3] for line in below.splitlines()]
    bare = tmp_path / "pairs.dump"
    bare.write_text(head + "ITEM: ENTRIES c_ids[1] c_ids[2] c_pair[1]\n" + "\n".join(map(" ".join, rows)))
    again = gp.ContactNetwork.from_lammps(atoms, bare, GLASS, columns=["i", "j", "force"], keep_rattlers=True)
    assert again == whole
    # two columns: the forces are Hertz's at the overlap of the positions, of which the file has nine digits
    bare.write_text(head + "ITEM: ENTRIES i j\n" + "\n".join(" ".join(row[:2]) for row in rows))
    again = gp.ContactNetwork.from_lammps(atoms, bare, GLASS, keep_rattlers=True)
    strong = whole.normal_force > 1e-3 * whole.normal_force.mean()
    kept = np.isin(np.stack([whole.i, whole.j]).T @ [1000, 1], np.stack([again.i, again.j]).T @ [1000, 1])
    assert np.all(kept[strong])
    np.testing.assert_allclose(again.normal_force[strong[kept]], whole.normal_force[strong], rtol=1e-4)


def test_lammps_responds_as_the_network_without_friction(lmp, tmp_path):
    network = read(lmp, tmp_path, friction=False, prestress=True)
    count, dimension = network.n_balls, network.dimension
    rest, step = np.array(lmp.gather_atoms("x", 1, 3)).reshape(-1, 3), 5e-11

    def forces(places):
        lmp.scatter_atoms("x", 1, 3, (ctypes.c_double * places.size)(*places.ravel()))
        lmp.command("run 0 post no")
        return np.array(lmp.gather_atoms("f", 1, 3)).reshape(-1, 3)[:, :dimension].ravel()

    constants = np.empty((count * dimension,) * 2)
    for column in range(count * dimension):
        moved = np.zeros((count, 3))
        moved[divmod(column, dimension)] = step
        constants[:, column] = (forces(rest - moved) - forces(rest + moved)) / (2.0 * step)
    forces(rest)
    root = np.repeat(np.sqrt(network.masses), dimension)
    theirs, ours = constants / root / root[:, None], WaveOperator(network).matrix.toarray()
    # the curvature of Hertz's law over a step: k''' step^2 of the contact that is pressed least, and rounding
    np.testing.assert_allclose(theirs, ours, atol=1e-6 * np.max(ours))
    np.testing.assert_allclose(
        np.linalg.eigvalsh(0.5 * (theirs + theirs.T)), np.linalg.eigvalsh(ours), atol=1e-6 * np.max(ours)
    )


def test_lammps_responds_as_the_network_with_friction(lmp, tmp_path):
    """LAMMPS adds up slip along the way: one step of time at a velocity is a displacement.

    It counts slip with the radii and torques with the arms. Each is one of two networks.
    """
    network = read(lmp, tmp_path, prestress=True)
    by_radii = replace(network, arm_i=network.radii[network.i], arm_j=network.radii[network.j])
    ours, slips = WaveOperator(network), WaveOperator(by_radii)
    pushed = ours.matrix - ours.root.T @ ours.root
    expected = (ours.root.T @ slips.root + pushed).toarray()
    # the arms differ from the radii by half an overlap
    overlap = np.max(1.0 - np.minimum(network.arm_i / by_radii.arm_i, network.arm_j / by_radii.arm_j))
    np.testing.assert_allclose(ours.matrix.toarray(), expected, atol=2.0 * overlap * ours.matrix.max())

    rest, time, size = np.array(lmp.gather_atoms("x", 1, 3)).reshape(-1, 3), 1e-12, 5e-11
    lmp.command(packings.coefficients("mindlin NULL 0 1e9"))
    lmp.commands_string(f"fix move all nve/sphere\ntimestep {time!r}")
    motions, dimension, rng = ours.motions, network.dimension, np.random.default_rng(5)
    count, turns = len(motions.translations), list(motions.rotations)

    def go(motion):
        for name, values in (("v", motion[:, :3]), ("omega", motion[:, 3:])):
            lmp.scatter_atoms(name, 1, 3, (ctypes.c_double * values.size)(*(values / time).ravel()))
        lmp.command("run 1 post no")
        return [np.array(lmp.gather_atoms(name, 1, 3)).reshape(-1, 3) for name in ("f", "torque")]

    for _ in range(3):
        motion = np.zeros((network.n_balls, 6))
        motion[:, :dimension] = rng.normal(size=(network.n_balls, dimension))
        motion[:, [3 + axis for axis in turns]] = rng.normal(size=(network.n_balls, len(turns))) / 1e-3
        motion *= size
        ahead = go(motion)
        go(-motion)
        behind = go(-motion)
        go(motion)
        force, torque = ((one - other) / 2.0 for one, other in zip(ahead, behind, strict=True))
        root = np.sqrt(np.column_stack([network.masses] * count + [network.inertias] * len(turns)))
        own = np.column_stack([motion[:, :count], motion[:, [3 + axis for axis in turns]]])
        found = -np.column_stack([force[:, :count], torque[:, turns]]) / root
        wanted = ours.values(expected @ ours.vector(own * root))
        np.testing.assert_allclose(found, wanted, atol=1e-5 * np.max(np.abs(wanted)))
    lmp.scatter_atoms("x", 1, 3, (ctypes.c_double * rest.size)(*rest.ravel()))
    lmp.commands_string("unfix move\nset group all omega 0 0 0\nvelocity all set 0 0 0")
    lmp.command(packings.coefficients("linear_nohistory 0 0"))


def read(lmp, folder, **more):
    """The network of what LAMMPS holds, through its files."""
    atoms, pairs = folder / "atoms.dump", folder / "pairs.dump"
    packings.write_dumps(lmp, atoms, pairs)
    return gp.ContactNetwork.from_lammps(atoms, pairs, GLASS, keep_rattlers=True, **more)
