"""Non-affine motions against the moduli, whose energy they leave, and forces that they balance."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

import granphon as gp
from granphon.base.errors import InputError
from tests import packings


def read(name, **options):
    files = (packings.FOLDER / f"{name}_{part}.dump" for part in ("atoms", "pairs"))
    return gp.ContactNetwork.from_lammps(*files, packings.MATERIAL, **options)


def deform(network, strain, motion):
    """Elongation (n_c,) and slip (n_c, 3) of the contacts of a cell under a strain (3, 3)."""
    i, j = network.i, network.j
    between = motion.displacements[j] - motion.displacements[i] + network.vector @ strain
    elongation = np.einsum("ca,ca->c", between, network.normal)
    arms = (
        network.arm_i[:, None] * motion.rotations[i] + network.arm_j[:, None] * motion.rotations[j]
    )
    slip = between - elongation[:, None] * network.normal - np.cross(arms, network.normal)
    return elongation, slip


@pytest.mark.claim("nonaffine")
@pytest.mark.parametrize("friction", [True, False])
@pytest.mark.parametrize("name", ["disks", "balls"])
def test_energy_of_a_strain_is_that_of_the_moduli(name, friction):
    network = read(name, friction=friction)
    voigt = np.array([0.3, -0.2, 0.7] if name == "disks" else [0.3, -0.2, 0.1, 0.5, -0.4, 0.7])
    motion = gp.find_nonaffine(network, voigt)
    p = network.dimension
    strain = np.diag([*voigt[:p], *[0.0] * (3 - p)])
    pairs = [(0, 1)] if p == 2 else [(1, 2), (0, 2), (0, 1)]
    for (a, b), angle in zip(pairs, voigt[p:], strict=True):
        strain[a, b] = strain[b, a] = 0.5 * angle
    elongation, slip = deform(network, strain, motion)
    energy = 0.5 * np.sum(network.normal_stiffness * elongation**2)
    energy += 0.5 * np.sum(network.shear_stiffness * np.sum(slip**2, axis=1))
    tensor = gp.moduli(network).tensor
    size = np.abs(np.linalg.det(network.cell[:p, :p]))
    thickness = network.scales.length if p == 2 else 1.0
    assert energy == pytest.approx(0.5 * voigt @ tensor @ voigt * size * thickness, rel=1e-9)
    # no force is left on any ball
    tension = network.normal_stiffness * elongation
    forces = tension[:, None] * network.normal + network.shear_stiffness[:, None] * slip
    left = np.zeros((network.n_balls, 3))
    np.add.at(left, network.j, forces)
    np.add.at(left, network.i, -forces)
    assert np.max(np.abs(left)) < 1e-9 * np.max(np.abs(forces))
    np.testing.assert_allclose(motion.displacements.mean(axis=0), 0.0, atol=1e-12)
    assert motion.sizes.shape == (network.n_balls,)
    assert np.any(motion.rotations) == friction


@pytest.mark.filterwarnings("ignore::granphon.base.errors.InconsistencyWarning")  # modes of zero
@pytest.mark.parametrize("color", [None, "nonaffine", "spin"])
def test_balls_that_leave_the_plane_have_no_motions_under_a_strain_in_it(color):
    network = read("disks", motions="out_of_plane")
    with pytest.raises(InputError, match="out_of_plane"):
        gp.find_nonaffine(network) if color is None else gp.plot(network, color=color)


def test_a_lattice_moves_as_the_strain_says():
    state = gp.AveragedLattice(gp.Packing(packings.MATERIAL, 2e-3)).at_force(1.0)
    motion = gp.find_nonaffine(state.network.repeat((3, 3)))
    np.testing.assert_array_equal(motion.strain, [0.0, 0.0, 1.0])
    assert np.max(motion.sizes) < 1e-14
    with pytest.raises(InputError, match="xy"):
        gp.find_nonaffine(state.network, [1.0, 0.0])
    loads = gp.AveragedLattice(gp.Packing(packings.MATERIAL, 2e-3)).at_force([1.0, 2.0])
    with pytest.raises(InputError, match="2 loads"):
        gp.find_nonaffine(loads)


def test_a_turned_network_has_turned_motions():
    network = read("disks")
    angle = 0.4
    turn = np.array(
        [[np.cos(angle), np.sin(angle), 0], [-np.sin(angle), np.cos(angle), 0], [0, 0, 1]]
    )
    turned = replace(
        network,
        cell=network.cell @ turn,
        positions=network.positions @ turn,
        normal=network.normal @ turn,
    )
    motion = gp.find_nonaffine(network)
    shear = turn.T @ np.array([[0, 0.5, 0], [0.5, 0, 0], [0, 0, 0]]) @ turn
    np.testing.assert_allclose(
        gp.find_nonaffine(turned, [shear[0, 0], shear[1, 1], 2 * shear[0, 1]]).displacements,
        motion.displacements @ turn,
        atol=1e-9 * np.max(motion.sizes),
    )


def test_the_figure_colours_balls_by_their_motion():
    network = read("disks")
    figure = gp.plot(network, color="nonaffine")
    assert any("affine" in ax.get_ylabel() + ax.get_xlabel() for ax in figure.axes)
