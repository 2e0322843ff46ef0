"""Static torques of rolling and twist, which turn with their contacts."""

from __future__ import annotations

import math
import warnings
from dataclasses import replace

import numpy as np
import pytest

import granphon as gp
from granphon.base.errors import InconsistencyWarning, InputError
from granphon.dynamics.contact_lattice import ContactLattice
from tests import packings
from tests.dynamics.test_network_lattice import random_network
from tests.networks.test_lammps import respond


def twisted(seed=0, **more):
    """A network in space with random static torques of its contacts."""
    network = packings.balance(random_network("fcc", (2, 2, 3), prestress=True, **more))
    network = replace(network, tangential_force=np.zeros((network.n_contacts, 3)))
    rng = np.random.default_rng(seed)
    size = 0.1 * network.mean_force * np.mean(network.radii)
    return replace(network, contact_torque=size * rng.standard_normal((network.n_contacts, 3)))


def turn_torques(network, displacements):
    """(n, 3) Sums of the torques on balls that were displaced by (n, 3): by the smallest rotation
    that takes each contact along, written as an exponential.
    """
    from scipy.spatial.transform import Rotation

    apart = displacements[network.j] - displacements[network.i]
    start = network.distance[:, None] * network.normal
    end = start + apart
    axis = np.cross(start, end)
    sine = np.linalg.norm(axis, axis=1) / network.distance / np.linalg.norm(end, axis=1)
    angle = np.arcsin(sine)
    length = np.linalg.norm(axis, axis=1, keepdims=True)
    units = np.divide(axis, length, out=np.zeros_like(axis), where=length > 0.0)
    torque = Rotation.from_rotvec(angle[:, None] * units).apply(network.contact_torque.copy())
    total = np.zeros((network.n_balls, 3))
    np.add.at(total, network.j, torque)
    np.add.at(total, network.i, -torque)
    return total


def test_torques_turn_with_their_contacts():
    """Against differences of the torques of displaced balls; nothing else of the matrix changes."""
    network = twisted()
    change = respond(network) - respond(replace(network, contact_torque=None))
    n = network.n_balls
    rng = np.random.default_rng(1)
    shape = rng.standard_normal((n, 3))
    step = 1e-6 * np.mean(network.radii)
    ahead, behind = (turn_torques(network, sign * step * shape) for sign in (1.0, -1.0))
    expected = -(ahead - behind) / (2.0 * step) / np.sqrt(network.inertias)[:, None]
    moved = np.zeros((n, 6))
    moved[:, :3] = shape * np.sqrt(network.masses)[:, None]
    found = (change @ moved.ravel()).reshape(n, 6)
    np.testing.assert_allclose(found[:, 3:], expected, atol=1e-8 * np.max(np.abs(expected)))
    np.testing.assert_allclose(found[:, :3], 0.0, atol=1e-9 * np.max(np.abs(expected)))
    turned = np.zeros((n, 6))
    turned[:, 3:] = rng.standard_normal((n, 3))
    np.testing.assert_allclose(change @ turned.ravel(), 0.0, atol=1e-9 * np.max(np.abs(change)))


def test_bands_have_the_symmetric_part():
    network = twisted()
    waves = gp.Waves(network)
    matrix = waves.operator.matrix.toarray()
    whole = respond(network)
    np.testing.assert_allclose(matrix, 0.5 * (whole + whole.T), atol=1e-12 * np.max(matrix))
    lattice = ContactLattice.from_network(network)
    found = lattice.frequencies(np.zeros((1, 3)))[0] * network.scales.frequency
    expected = np.sqrt(np.maximum(np.linalg.eigvalsh(matrix), 0.0)) / (2.0 * math.pi)
    np.testing.assert_allclose(found, expected, rtol=1e-9, atol=1e-6 * expected[-1])
    still = gp.Waves(replace(network, contact_torque=None)).operator.matrix.toarray()
    assert np.max(np.abs(still - matrix)) > 1e-7 * np.max(matrix)


@pytest.mark.parametrize("has_springs", [True, False])
def test_small_motions_are_those_of_the_whole_matrix(has_springs):
    """What torques add to the spins after a short time is what they add to the acceleration, also
    where nothing resists rolling or twist.
    """
    network = twisted()
    if not has_springs:
        free = np.zeros(network.n_contacts)
        network = replace(network, torsion_stiffness=free, bending_stiffness=free)
    n = network.n_balls
    both = network, replace(network, contact_torque=None)
    rng = np.random.default_rng(2)
    shape = 1e-11 * rng.standard_normal((n, 3))
    duration = 1e-3 / gp.Waves(network).operator.top
    spins = []
    for one in both:
        waves = gp.NonlinearWaves(one, geometry="exact")
        motion = waves.run(duration, displacements=shape, frames=2, step=duration / 2.0)
        spins.append(motion.spins[-1])
    moved = np.zeros((n, 6))
    moved[:, :3] = shape * np.sqrt(network.masses)[:, None]
    change = respond(both[0]) - respond(both[1])
    expected = -duration * (change @ moved.ravel()).reshape(n, 6)[:, 3:]
    found = (spins[0] - spins[1]) * np.sqrt(network.inertias)[:, None]
    np.testing.assert_allclose(found, expected, atol=1e-3 * np.max(np.abs(expected)))


@pytest.mark.parametrize("ending", ["csv", "extxyz"])
def test_tables_hold_torques(ending, tmp_path):
    network = twisted()
    files = tmp_path / f"balls.{ending}", tmp_path / f"contacts.{ending}"
    network.write_tables(*files)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", InconsistencyWarning)  # these forces are not in balance
        read = gp.ContactNetwork.from_table(*files, keep_rattlers=True)
    np.testing.assert_array_equal(read.contact_torque, network.contact_torque)
    assert gp.ContactNetwork.from_dict(network.to_dict()) == network


def test_dumps_hold_torques(tmp_path):
    network = twisted()
    cell = np.linalg.qr(network.cell.T)[1].T
    signs = np.sign(np.diag(cell))
    turn = np.linalg.solve(network.cell, cell * signs)
    spun = np.linalg.det(turn) * turn  # of axial vectors
    turned = replace(
        network,
        cell=np.tril(cell * signs),
        positions=network.positions @ turn,
        normal=network.normal @ turn,
        contact_torque=network.contact_torque @ spun,
        tangential_force=network.tangential_force @ turn,
    )
    files = tmp_path / "atoms.dump", tmp_path / "pairs.dump"
    with pytest.warns(InconsistencyWarning, match="one material"):  # stiffnesses are random here
        turned.write_dumps(*files)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", InconsistencyWarning)  # radii are random here
        options = {"normal_stiffness": 1e6, "shear_stiffness": 1e6, "keep_rattlers": True}
        read, free = (
            gp.ContactNetwork.from_lammps(*files, **options, **laws)
            for laws in ({"rolling_stiffness": 1e5, "twisting_stiffness": 0.0}, {})
        )
    # where no law of rolling acts LAMMPS writes any numbers
    assert free.contact_torque is None
    assert sum("not read without" in note for note in free.notes) == 2
    scale = np.max(np.abs(network.contact_torque))
    np.testing.assert_allclose(read.contact_torque, turned.contact_torque, atol=1e-12 * scale)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", InconsistencyWarning)
        twist = gp.ContactNetwork.from_lammps(*files, twisting_stiffness=0.0, **options)
    along = np.einsum("ca,ca->c", turned.contact_torque, turned.normal)[:, None] * turned.normal
    np.testing.assert_allclose(twist.contact_torque, along, atol=1e-12 * scale)


def test_torques_of_reversed_contacts_and_of_repeated_cells():
    """A contact may be listed from either end; a cell may be repeated, and cut."""
    network = twisted()
    swapped = replace(
        network,
        i=network.j,
        j=network.i,
        shift=-network.shift,
        normal=-network.normal,
        arm_i=network.arm_j,
        arm_j=network.arm_i,
        contact_torque=-network.contact_torque,
    )
    change = respond(swapped) - respond(network)
    assert np.max(np.abs(change)) < 1e-12 * np.max(respond(network))
    twice = network.repeat((2, 1, 1))
    np.testing.assert_array_equal(twice.contact_torque[: network.n_contacts].shape[1], 3)
    force, torque = network.unbalanced
    many = twice.unbalanced[1].reshape(2, -1, 3)
    np.testing.assert_allclose(np.sort(many, axis=None)[::2], np.sort(torque, axis=None))
    assert np.all(np.isfinite(force))
    assert network.repeat((1, 1, 3)).cut(2, 2).contact_torque is not None


def test_a_torque_out_of_range_is_refused():
    network = twisted()
    torque = network.contact_torque.copy()
    torque[3, 1] = np.nan
    with pytest.raises(InputError, match="contact_torque"):
        replace(network, contact_torque=torque)


def test_rolling_forces_of_dumps(tmp_path):
    """Torques are the reduced radius times the cross product, as LAMMPS makes them of its rolling
    forces, and the torque of twist along the normal.
    """
    atoms, pairs = (packings.FOLDER / f"balls_{part}.dump" for part in ("atoms", "pairs"))
    head, rows = pairs.read_text().split("ITEM: ENTRIES")
    names, *lines = rows.splitlines()
    rng = np.random.default_rng(0)
    added = rng.uniform(-1.0, 1.0, (len(lines), 4))
    text = [
        f"{line} {' '.join(map(repr, row))}"
        for line, row in zip(lines, added.tolist(), strict=True)
    ]
    changed = tmp_path / "pairs.dump"
    changed.write_text(f"{head}ITEM: ENTRIES{names} rx ry rz twist\n" + "\n".join(text) + "\n")
    options = {"rolling_stiffness": 1e5, "twisting_stiffness": 0.01, "keep_rattlers": True}
    network = gp.ContactNetwork.from_lammps(atoms, changed, packings.MATERIAL, **options)
    plain = gp.ContactNetwork.from_lammps(atoms, pairs, packings.MATERIAL, **options)
    assert plain.contact_torque is None
    assert replace(network, contact_torque=None) == plain
    sizes = 1.0 / network.radii[network.i] + 1.0 / network.radii[network.j]
    ends = {
        (int(line.split()[0]), int(line.split()[1])): row
        for line, row in zip(lines, added, strict=True)
    }
    for c in range(network.n_contacts):
        first = int(network.labels[network.i[c]]), int(network.labels[network.j[c]])
        sign = 1.0 if first in ends else -1.0
        row = ends[first if first in ends else first[::-1]]
        toward_first = -sign * network.normal[c]  # from the second ball of the row to the first
        on_first = np.cross(toward_first, row[:3]) / sizes[c] + row[3] * toward_first
        np.testing.assert_allclose(network.contact_torque[c], -sign * on_first, rtol=1e-12)
