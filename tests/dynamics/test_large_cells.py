"""Cells of hundreds of branches, whose matrices are sparse: against sums over contacts, and against
the small cell.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from numpy.testing import assert_allclose

import granphon as gp
from granphon.base.errors import InputError
from granphon.dynamics.contact_lattice import ContactLattice
from tests.networks.twin import dynamical_matrix

STEEL = gp.Material(young_modulus=211.65e9, poisson_ratio=0.276, density=7840.0)
POINTS = [[0.0, 0.0], [0.31, 0.17], [0.5, 0.0], [0.02, 0.01]]


@pytest.fixture(scope="module")
def sample():
    """Eleven by eleven balls that differ: 363 branches."""
    packing = gp.Packing(STEEL, 8e-3, spread=gp.Uniform(2e-6))
    return gp.DirectSimulation(packing, shape=(11, 11), seed=0).at_force(18.446).sample


@pytest.mark.claim("large-cells")
def test_frequencies_of_a_sample_are_those_of_the_sums_over_its_contacts(sample):
    network = sample.network
    found = gp.Phonons(network).frequencies(POINTS)
    for q, own in zip(POINTS, found, strict=True):
        matrix = dynamical_matrix(network, 2.0 * np.pi * np.linalg.pinv(network.cell[:2]) @ q)
        kept = (6 * np.arange(network.n_balls)[:, None] + [0, 1, 5]).ravel()
        squares = np.linalg.eigvalsh(matrix[np.ix_(kept, kept)])
        assert_allclose(own**2 * 4.0 * np.pi**2, squares, rtol=1e-11, atol=1e-13 * squares[-1])
    assert np.count_nonzero(found == 0.0) == np.count_nonzero(found[0] == 0.0) == 2


def test_no_wave_vectors_have_no_frequencies(sample):
    lattice = ContactLattice.from_network(sample.network)
    assert lattice.frequencies(np.zeros((0, 2))).shape == (0, lattice.n_branches)


def test_sound_of_a_sample_keeps_its_digits_down_to_gamma(sample):
    ph = gp.Phonons(sample.network)
    v = gp.sound_velocities(sample.network, [1.0, 0.0]).velocities
    lattice = ph.lattice
    for size in (1e-3, 1e-8):
        q = size * np.array([[1.0, 0.0]])
        slopes = lattice.frequencies(q)[0, :2] / size * ph.scales.velocity
        assert_allclose(slopes, v, rtol=1e-11 + 10.0 * size**2)


def test_modes_of_a_sample_are_modes_and_velocities_are_slopes(sample):
    ph = gp.Phonons(sample.network)
    lattice = ph.lattice
    q = lattice.wavevectors([[0.31, 0.17]])
    modes = lattice.modes(q)
    matrix = lattice.dynamical_matrix(q)[0]
    vectors = modes.eigenvectors[0]
    assert_allclose(vectors.conj().T @ vectors, np.eye(len(vectors)), atol=1e-12)
    assert_allclose(
        matrix @ vectors,
        vectors * modes.frequencies[0] ** 2,
        atol=1e-12 * modes.frequencies.max() ** 2,
    )
    step = 1e-7 * np.eye(2)
    slopes = (lattice.frequencies(q + step) - lattice.frequencies(q - step)).T / 2e-7
    assert_allclose(modes.group_velocities[0], slopes, atol=1e-6)


@pytest.mark.parametrize("lattice", ["triangular", "chain"])
def test_a_large_cell_of_equal_balls_has_the_branches_of_the_small_one(lattice):
    """It has an inversion, by which D is real, and branches that touch."""
    state = gp.AveragedLattice(
        gp.Packing(STEEL, 8e-3, lattice=lattice, motions="all", torsion=0.1)
    ).at_force(10.0)
    periods = state.packing.structure.periods
    dim = {1: (61,), 2: (9, 7)}[periods]
    large, small = (
        gp.Phonons(state, gp.atoms(state).repeat((*dim, *(1,) * (3 - periods)))),
        gp.Phonons(state),
    )
    assert large.lattice.n_branches > 300
    for q in ([0.3, 0.2][:periods], [0.0, 0.0][:periods]):
        cells = np.stack(np.meshgrid(*map(np.arange, dim), indexing="ij"), axis=-1).reshape(
            -1, periods
        )
        each = small.frequencies((cells + q) / dim)
        found = large.frequencies([q])[0]
        assert_allclose(found, np.sort(each.ravel()), rtol=1e-10, atol=1e-12 * each.max())
        assert np.count_nonzero(found == 0.0) == np.count_nonzero(each == 0.0)
    speeds = large.modes([[0.3, 0.2][:periods]]).group_velocities[0]
    folded = small.modes((cells + [0.3, 0.2][:periods]) / dim).group_velocities.reshape(-1, periods)
    assert_allclose(np.sort(speeds[:, 0]), np.sort(folded[:, 0]), atol=1e-7 * np.abs(folded).max())
    assert large.lattice.free_branches == small.lattice.free_branches * len(cells)


def press(force, geometry):
    """The network of a sample of 121 balls, with more motions than small cells have."""
    packing = gp.Packing(STEEL, 8e-3, spread=gp.Uniform(2e-6))
    array = gp.DirectSimulation(packing, shape=(11, 11), seed=0, geometry=geometry)
    return array.at_force(force).sample.network


def test_loose_balls_cost_nothing_at_any_wave_vector():
    lattice = ContactLattice.from_network(press(0.05, "lattice"))
    for q in POINTS[:2]:
        squares = np.linalg.eigvalsh(lattice.dynamical_matrix(lattice.wavevectors([q]))[0])
        frequencies = lattice.frequencies(lattice.wavevectors([q]))[0]
        assert_allclose(frequencies**2, squares, atol=1e-12 * squares[-1])
        count = np.count_nonzero(squares < 1e-12 * squares[-1])
        assert np.count_nonzero(frequencies == 0.0) == count > 2


def test_frequencies_under_static_forces_are_those_of_the_matrix():
    """And real at Gamma too."""
    lattice = ContactLattice.from_network(press(18.446, "exact"))
    assert lattice.is_prestressed
    for q in POINTS[:2]:
        squares = np.linalg.eigvalsh(lattice.dynamical_matrix(lattice.wavevectors([q]))[0])
        frequencies = lattice.frequencies(lattice.wavevectors([q]))[0]
        assert_allclose(frequencies**2, squares, atol=1e-12 * squares[-1])


def test_a_pressed_supercell_has_an_inversion_although_its_forces_are_rounded():
    """Its branches are those of the primitive cell at all wave vectors that fold onto one."""
    ball = gp.Ball(gp.Material(211.65e9, 0.276, 7840.0), 8e-3)
    primitive = gp.Crystal.on("fcc", [ball], friction=False)
    large = primitive.repeat((5, 5, 5)).at_pressure(1e5, finite_overlap=True)
    forces = large.network.normal_force
    assert 0.0 < np.ptp(forces) < 1e-13 * np.max(forces)
    phonons = gp.Phonons(large)
    assert phonons.lattice._images is not None
    steps = np.stack(np.meshgrid(*[np.arange(5)] * 3), axis=-1).reshape(-1, 3)
    q = np.array([0.1, 0.2, 0.3])
    small = gp.Phonons(primitive.at_pressure(1e5, finite_overlap=True))
    expected = np.sort(small.frequencies((q + steps) / 5.0).ravel())
    assert_allclose(phonons.frequencies([q])[0], expected, rtol=1e-12)


@pytest.mark.parametrize("force", [20.0, 2e4])
def test_sound_of_a_pressed_supercell_keeps_its_digits_near_gamma(force):
    """Its squares are far below the rounding of the matrix of 648 motions."""
    ball = gp.Ball(STEEL, 8e-3)
    cells = (6, 6, 6)
    small, large = (
        gp.Crystal.on("fcc", [ball], friction=False)
        .repeat(dim)
        .at_force(force, finite_overlap=True)
        for dim in ((1, 1, 1), cells)
    )
    lattice = gp.Phonons(large).lattice
    for q in ([1e-4, 2e-4, 0.0], [3e-4, 0.0, -1e-4]):
        expected = gp.Phonons(small).frequencies([np.array(q) / cells])[0]
        found = lattice._large.find_frequencies(lattice.wavevectors([q])[0])
        hertz = np.sort(found)[:3] * gp.Phonons(large).scales.frequency
        assert_allclose(hertz, expected, rtol=1e-12)
    assert lattice._large.find_frequencies(lattice.wavevectors([[1e-7, 0.0, 0.0]])[0]) is None


def test_contacts_that_differ_leave_no_inversion_and_are_told_by_their_balls(monkeypatch):
    """No table of contacts is searched, of which each ball would need one."""
    equal = gp.AveragedLattice(gp.Packing(gp.Material(2e11, 0.3, 8e3), 8e-3)).at_force(5.0).network
    network = equal.repeat((6, 6))
    factors = np.random.default_rng(1).uniform(0.9, 1.1, network.n_contacts)
    uneven = replace(network, normal_stiffness=factors * network.normal_stiffness)
    searches = []
    monkeypatch.setattr(
        ContactLattice, "_invert_contacts", lambda *arguments: searches.append(arguments)
    )
    assert gp.Phonons(uneven).lattice._images is None
    assert len(searches) <= 1


def test_a_cell_beyond_the_memory_is_refused_before_anything_is_made(sample):
    with pytest.raises(InputError, match=r"GiB .*gp\.Waves"):
        gp.Phonons(sample.network.repeat((7, 7))).frequencies(POINTS)
