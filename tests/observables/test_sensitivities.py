"""Derivatives of moduli and sound velocities: closed forms, central differences, many balls."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from numpy.testing import assert_allclose

import granphon as gp
from granphon.base.errors import InputError
from tests.dynamics.test_network_lattice import CASES, random_network
from tests.dynamics.test_sensitivities import CASES_HERE, changes, compare, difference, on_springs

STEEL = gp.Material(young_modulus=211.65e9, poisson_ratio=0.276, density=7840.0)
#: networks without bodies that do not move
MOVING = [case for case in CASES_HERE if "held" not in case and "wall" not in case]
QUICK = (
    "chain, all motions",
    "plane",
    "diamond",
    "prestress",
    "tangential forces, one ball",
    "growing tangential forces, one ball",
)


def cases(names):
    return [case if case in QUICK else pytest.param(case, marks=pytest.mark.slow) for case in names]


@pytest.mark.claim("sensitivities-long-waves")
@pytest.mark.parametrize("case", cases(one for one in MOVING if one != "out of the plane"))
def test_derivatives_of_moduli_are_those_of_central_differences(case):
    network = CASES_HERE[case]()
    moduli = gp.moduli(network)
    assert moduli.sensitivities.mass is None
    scale = float(np.max(np.abs(moduli.tensor)))
    compare(network, lambda changed: gp.moduli(changed).tensor, moduli.sensitivities, scale)


#: networks that buckle, so that no velocity is real
BUCKLED = (
    "tangential forces in a ribbon",
    "growing tangential forces in a ribbon",
    "slip by the radii in a plane",
    "slip by the radii in a ribbon",
)


@pytest.mark.claim("sensitivities-long-waves")
@pytest.mark.parametrize("case", cases(case for case in MOVING if case not in BUCKLED))
def test_derivatives_of_velocities_are_those_of_central_differences(case):
    network = CASES_HERE[case]()
    direction = np.array([0.3, 0.5, 0.8])[: sum(network.pbc)]

    def find(changed):
        return gp.sound_velocities(changed, direction).velocities

    sound = gp.sound_velocities(network, direction)
    found = sound.sensitivities
    zero = sound.velocities == 0.0
    assert np.all(np.isnan(found.normal_stiffness[zero]))
    assert np.all(np.isfinite(found.normal_stiffness[~zero]))
    compare(network, find, found, max(float(np.max(sound.velocities)), 1.0))


@pytest.mark.claim("sensitivities-long-waves")
@pytest.mark.parametrize("case", ["plane", "one ball", pytest.param("fcc", marks=pytest.mark.slow)])
def test_springs_against_rotations_change_sound(case):
    network = on_springs(CASES[case](), "rotations")
    direction = np.array([0.3, 0.5, 0.8])[: sum(network.pbc)]
    sound = gp.sound_velocities(network, direction)
    found = sound.sensitivities.on_site
    motions = network.ball_motions
    assert np.all(np.isnan(found[..., motions.translating]))
    assert np.all(found[..., motions.turning] >= 0.0)
    compare(
        network,
        lambda changed: gp.sound_velocities(changed, direction).velocities,
        sound.sensitivities,
        float(np.max(sound.velocities)),
    )


def test_a_chain_of_springs_in_a_row():
    """The modulus of a chain is its length over the sum of compliances, and rho v^2 of it."""
    network = random_network("chain", (4,))
    k = network.normal_stiffness
    length = network.cell[0, 0]
    modulus = length / np.sum(1.0 / k)
    found = gp.moduli(network)
    assert_allclose(found.bulk, modulus, rtol=1e-12)
    assert_allclose(found.sensitivities.normal_stiffness[0, 0], modulus**2 / length / k**2)
    sound = gp.sound_velocities(network)
    v = np.sqrt(modulus * length / network.masses.sum())
    assert_allclose(sound.sensitivities.velocities, [v], rtol=1e-12)
    assert_allclose(sound.sensitivities.mass[0], -0.5 * v / network.masses.sum(), rtol=1e-12)
    assert_allclose(
        sound.sensitivities.normal_stiffness[0], 0.5 * v * modulus / length / k**2, rtol=1e-11
    )


def test_derivatives_of_the_modulus_of_a_chain_are_in_newtons():
    moduli = gp.moduli(random_network("chain", (4,)))
    data = moduli.sensitivities.to_dict()
    assert data["units"]["normal_stiffness"] == "N/(N/m)"
    assert moduli.to_dict()["units"]["tensor"] == "N"
    assert type(moduli.sensitivities).from_dict(data) == moduli.sensitivities


@pytest.mark.parametrize("prestress", [False, True])
def test_a_cell_of_many_balls_has_the_derivatives_of_few(prestress):
    """Sparse factors: a supercell has, in all copies together, what the cell has."""
    cell = gp.AveragedLattice(gp.Packing(STEEL, 8e-3, lattice="triangular")).at_force(
        10.0, finite_overlap=prestress
    )
    network = cell.network.repeat((4, 3))
    count = 12
    few = gp.moduli(network).sensitivities
    large = cell.network.repeat((12, 9))
    many = gp.moduli(large).sensitivities
    for name in ("normal_stiffness", "shear_stiffness", "normal_force"):
        if getattr(few, name) is not None:
            wanted = np.sum(getattr(few, name), axis=-1)
            found = np.sum(getattr(many, name), axis=-1)
            atol = 1e-10 * np.max(np.abs(wanted))
            assert_allclose(found, wanted, rtol=0.0, atol=atol)
    one = gp.sound_velocities(network, (1.0, 0.0)).sensitivities
    all_balls = gp.sound_velocities(large, (1.0, 0.0)).sensitivities
    assert_allclose(all_balls.mass[:, 0] * 108, one.mass[:, 0] * count, rtol=1e-10)


def test_masses_of_balls_that_stay_behind_do_not_matter():
    network = random_network("triangular", (2, 2))
    ball = 1
    keep = (network.i != ball) & (network.j != ball)
    fields = {name: getattr(network, name)[keep] for name in network.contact_fields}
    loose = replace(network, **fields)

    def find(changed):
        return gp.sound_velocities(changed, (0.6, 0.8)).velocities

    found = gp.sound_velocities(loose, (0.6, 0.8)).sensitivities
    assert_allclose(found.mass[:, ball], 0.0, atol=1e-12 * np.max(np.abs(found.mass)))
    change = changes(loose, "mass")
    assert_allclose(found.mass @ change, difference(find, loose, "mass", change), rtol=1e-8)


def test_loads_and_directions_are_axes_of_the_derivatives():
    medium = gp.AveragedLattice(gp.Packing(STEEL, 8e-3, lattice="triangular"))
    states = medium.at_force([1.0, 8.0])
    sound = gp.sound_velocities(states, [[1.0, 0.0], [0.6, 0.8]])
    found = sound.sensitivities
    assert found.normal_stiffness.shape == (2, 2, 2, 3)
    assert_allclose(found.velocities, sound.velocities, rtol=1e-12)
    # v goes as the root of all stiffnesses
    springs = found.normal_stiffness.sum(axis=-1) * states.normal_stiffness[:, None, None]
    springs += found.shear_stiffness.sum(axis=-1) * states.shear_stiffness[:, None, None]
    assert_allclose(springs, 0.5 * sound.velocities, rtol=1e-11)
    moduli = gp.moduli(states).sensitivities
    assert moduli.normal_stiffness.shape == (2, 3, 3, 3)


def test_waves_of_one_velocity_have_the_derivative_of_their_mean():
    network = gp.AveragedLattice(gp.Packing(STEEL, 8e-3, lattice="fcc")).at_force(2.0).network
    sound = gp.sound_velocities(network, (1.0, 0.0, 0.0))
    assert sound.sensitivities.degenerate.tolist() == [True, True, False]
    change = changes(network, "shear_stiffness")

    def find(changed):
        return np.mean(gp.sound_velocities(changed, (1.0, 0.0, 0.0)).velocities[:2])

    wanted = difference(find, network, "shear_stiffness", change)
    assert_allclose(sound.sensitivities.shear_stiffness[:2] @ change, wanted, rtol=1e-8)


def test_without_friction_a_spring_against_slip_has_no_derivative():
    packing = gp.Packing(STEEL, 8e-3, lattice="triangular", friction=False)
    state = gp.AveragedLattice(packing).at_force(2.0)
    assert gp.moduli(state).sensitivities.shear_stiffness is None
    assert gp.sound_velocities(state).sensitivities.shear_stiffness is None


def test_results_that_were_read_or_are_means_say_where_to_go():
    state = gp.AveragedLattice(gp.Packing(STEEL, 8e-3)).at_force(2.0)
    for result in (gp.moduli(state), gp.sound_velocities(state)):
        found = result.sensitivities
        assert type(found).from_dict(found.to_dict()) == found
        with pytest.raises(InputError, match="read"):
            _ = type(result).from_dict(result.to_dict()).sensitivities
    packing = gp.Packing(STEEL, 8e-3, spread=gp.Uniform(2e-6))
    samples = gp.DirectSimulation(packing, shape=(6, 6)).at_force(10.0)
    with pytest.raises(InputError, match="samples"):
        _ = gp.moduli(samples).sensitivities
    assert gp.moduli(samples.samples[0]).sensitivities.normal_stiffness.shape[:2] == (3, 3)
