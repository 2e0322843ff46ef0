"""Derivatives of frequencies: closed forms, central differences, sums over all parameters."""

from __future__ import annotations

import json
from dataclasses import replace
from functools import partial

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from numpy.testing import assert_allclose

import granphon as gp
from granphon.base.errors import InputError
from granphon.dynamics.linalg import MANY_COLUMNS
from tests.dynamics.test_network_lattice import CASES, hold, random_network

STEEL = gp.Material(young_modulus=211.65e9, poisson_ratio=0.276, density=7840.0)
ALUMINIUM = gp.Material(young_modulus=73.5e9, poisson_ratio=0.33, density=2700.0)
#: fields of a network, by the names of their derivatives
FIELDS = {
    "normal_stiffness": "normal_stiffness",
    "shear_stiffness": "shear_stiffness",
    "torsion": "torsion_stiffness",
    "bending": "bending_stiffness",
    "mass": "masses",
    "inertia": "inertias",
    "normal_force": "normal_force",
    "on_site": "on_site",
}


def shifted(network, name, change):
    """The network with a field changed, but for bodies that do not move."""
    values = getattr(network, FIELDS[name])
    finite = np.isfinite(values)
    return replace(network, **{FIELDS[name]: np.where(finite, values + change, values)})


def difference(find, network, name, change, step=1e-5):
    """The central difference, to the fourth order, of ``find`` along a change of a field."""
    near = find(shifted(network, name, step * change)) - find(
        shifted(network, name, -step * change)
    )
    far = find(shifted(network, name, 2 * step * change)) - find(
        shifted(network, name, -2 * step * change)
    )
    return (8.0 * near - far) / (12.0 * step)


def changes(network, name, seed=3):
    values = getattr(network, FIELDS[name])
    sizes = np.where(np.isfinite(values), values, 0.0)
    return sizes * np.random.default_rng(seed).uniform(-1.0, 1.0, values.shape)


def contract(derivatives, change):
    """The derivatives (..., *shape) along a change (*shape)."""
    return np.tensordot(derivatives, change, np.ndim(change))


def on_springs(network, against=("displacements", "rotations"), seed=5):
    """The network with springs to the ground, equal along the axes of each ball where the network
    is turned.
    """
    motions = network.ball_motions
    rng = np.random.default_rng(seed)
    size = rng.uniform(0.02, 0.3, (network.n_balls, motions.count)) * np.mean(
        network.normal_stiffness
    )
    springs = np.zeros_like(size)
    if "displacements" in against:
        springs[:, motions.translating] = size[:, motions.translating]
    if "rotations" in against:
        springs[:, motions.turning] = 16e-6 * size[:, motions.turning]  # (4 mm)^2
    return replace(network, on_site=springs)


def compare(network, find, derivatives, scale):
    """Compare derivatives by all fields with central differences, to 1e-8 of the scale."""
    for name in FIELDS:
        values = getattr(derivatives, name)
        if values is None or not np.any(getattr(network, FIELDS[name])):
            continue
        change = changes(network, name)
        finite = np.where(np.isfinite(values), values, 0.0)
        wanted = difference(find, network, name, change)
        found = contract(finite, change)
        assert_allclose(found, wanted, rtol=0.0, atol=1e-8 * scale, err_msg=name)


def grow(case):
    """A network whose static tangential forces grow with the overlap, as those of Mindlin."""
    return replace(CASES[case](), tangential_law="mindlin")


#: networks whose static tangential forces grow with the overlap as well
CASES_HERE = CASES | {
    f"growing {case}": partial(grow, case)
    for case in ("tangential forces, one ball", "tangential forces in a ribbon")
}
QUICK = (
    "plane",
    "one ball",
    "tangential forces",
    "tangential forces, one ball in space",
    "held",
    "turned ribbon",
    "ribbon on a wall",
    "growing tangential forces, one ball",
    "slip by the radii in a plane",
    "slip of YADE in a plane",
)


@pytest.mark.claim("sensitivities-differences")
@pytest.mark.parametrize(
    "case",
    [case if case in QUICK else pytest.param(case, marks=pytest.mark.slow) for case in CASES_HERE],
)
def test_derivatives_are_those_of_central_differences(case):
    network = CASES_HERE[case]()
    q = np.random.default_rng(7).uniform(-0.5, 0.5, (2, sum(network.pbc)))
    found = gp.Phonons(network).sensitivities(q)
    assert np.all((found.normal_force is None) == (not network.prestress))
    # branches that vanish everywhere are degenerate too
    moves = ~found.degenerate

    def find(changed):
        return np.where(moves, gp.Phonons(changed).frequencies(q), 0.0)

    kept = {
        name: np.moveaxis(
            np.where(moves, np.moveaxis(values, (0, 1), (-2, -1)), 0.0), (-2, -1), (0, 1)
        )
        for name in FIELDS
        if (values := getattr(found, name)) is not None
    }
    compare(network, find, replace(found, **kept), np.max(found.frequencies))


@pytest.mark.claim("sensitivities-differences")
@pytest.mark.parametrize(
    "case",
    [
        pytest.param("plane", marks=pytest.mark.slow),
        pytest.param("one ball", marks=pytest.mark.slow),
        "held",
        "ribbon on a wall",
    ],
)
def test_springs_to_the_ground_have_derivatives_as_contacts_have(case):
    network = on_springs(CASES[case]())
    q = np.random.default_rng(7).uniform(-0.5, 0.5, (1, sum(network.pbc)))
    found = gp.Phonons(network).sensitivities(q)
    assert found.on_site.shape[2:] == network.on_site.shape
    compare(
        network,
        lambda changed: gp.Phonons(changed).frequencies(q),
        found,
        np.max(found.frequencies),
    )


def test_a_chain_on_springs_has_closed_derivatives():
    """omega^2 = g/m + (4 k/m) sin^2(q/2): df/dg = 1/(8 pi^2 m f)."""
    ball = gp.Ball(STEEL, 8e-3)
    crystal = gp.Crystal.on("chain", [ball], on_site=1e5, friction=False)
    network = crystal.at_force(10.0).network
    found = gp.Phonons(network).sensitivities([[0.2]])
    expected = 1.0 / (8.0 * np.pi**2 * network.masses[0] * found.frequencies[0, 0])
    assert_allclose(found.on_site[0, 0], [[expected]], rtol=1e-12)
    # without springs as well: what the first spring would do
    free = gp.Phonons(replace(network, on_site=None)).sensitivities([[0.2]])
    wanted = found.frequencies / free.frequencies
    assert_allclose(free.on_site[0, 0] / found.on_site[0, 0], wanted, rtol=1e-12)


@given(
    lattice=st.sampled_from(["chain", "square", "triangular", "kagome", "sc", "bcc", "fcc"]),
    seed=st.integers(0, 1000),
)
def test_sums_over_all_parameters_are_a_half_of_each_frequency(lattice, seed):
    """f goes as the root of all stiffnesses, and as one over that of all masses (Euler)."""
    network = random_network(
        lattice, (1,) * {"chain": 1, "sc": 3, "bcc": 3, "fcc": 3}.get(lattice, 2), seed=seed
    )
    q = np.random.default_rng(seed).uniform(0.1, 0.5, (1, sum(network.pbc)))
    found = gp.Phonons(network).sensitivities(q)
    springs = sum(
        getattr(found, name) @ getattr(network, FIELDS[name])
        for name in ("normal_stiffness", "shear_stiffness", "torsion", "bending")
    )
    masses = found.mass @ network.masses + found.inertia @ network.inertias
    half = np.where(found.frequencies > 0.0, 0.5 * found.frequencies, np.nan)
    top = np.max(found.frequencies)
    assert_allclose(springs, half, rtol=0.0, atol=1e-12 * top)
    assert_allclose(masses, -half, rtol=0.0, atol=1e-12 * top)


# -- closed forms ----------------------------------------------------------------------------------


@pytest.fixture(scope="module")
def two_masses():
    balls = [gp.Ball(STEEL, 19.05e-3), gp.Ball(ALUMINIUM, 19.05e-3)]
    return gp.Crystal.on("chain", balls).at_force(20.0).network


@pytest.mark.claim("sensitivities-chain")
def test_band_edges_of_a_chain_of_two_masses(two_masses):
    """At the zone edge one mass stands still: omega^2 = 2 k/m, of one or of the other mass, with k
    the mean of both contacts.
    """
    masses = two_masses.masses
    k = two_masses.normal_stiffness
    found = gp.Phonons(two_masses).sensitivities([[0.5]], branches=[0, 1])
    heavy = int(np.argmax(masses))
    for branch, ball in enumerate((heavy, 1 - heavy)):
        frequency = np.sqrt(2.0 * np.mean(k) / masses[ball]) / (2.0 * np.pi)
        assert_allclose(found.frequencies[0, branch], frequency, rtol=1e-12)
        expected = np.zeros(2)
        expected[ball] = -0.5 * frequency / masses[ball]
        assert_allclose(found.mass[0, branch], expected, rtol=1e-11, atol=1e-11 * -expected.min())
        assert_allclose(found.normal_stiffness[0, branch], 0.25 * frequency / k, rtol=1e-11)
    edges = gp.Phonons(two_masses).gap_sensitivities()
    assert_allclose(edges.frequencies, gp.Phonons(two_masses).gaps(), rtol=1e-12)
    assert_allclose(edges.qpoints, [[[0.5, 0, 0]] * 2], atol=1e-6)
    assert_allclose(edges.mass[0], found.mass[0], rtol=1e-9, atol=1e-9 * np.max(-found.mass))


def test_equal_branches_have_the_derivative_of_their_mean():
    """At Gamma the two optical modes of a square of masses on springs are equal, and stay so
    together.
    """
    network = gp.AveragedLattice(gp.Packing(STEEL, 8e-3, lattice="honeycomb")).at_force(5.0).network
    q = [[0.0, 0.0]]
    found = gp.Phonons(network).sensitivities(q)
    pairs = found.degenerate & (found.frequencies > 0.0)
    assert np.count_nonzero(pairs) >= 2

    def find(changed):
        values = gp.Phonons(changed).frequencies(q)
        return np.array([np.mean(values[pairs])])

    for name in ("normal_stiffness", "shear_stiffness", "mass", "inertia"):
        change = changes(network, name)
        wanted = difference(find, network, name, change)
        by_pair = getattr(found, name)[pairs] @ change
        atol = 1e-8 * np.max(found.frequencies)
        assert_allclose(np.mean(by_pair), wanted[0], rtol=1e-8, atol=atol, err_msg=name)
    first, second = found.normal_stiffness[pairs][:2]
    assert_allclose(first, second, rtol=1e-12)


def test_frequencies_of_zero_have_no_derivative_and_say_so():
    network = random_network("triangular", (2, 1))
    found = gp.Phonons(network).sensitivities([[0.0, 0.0], [0.2, 0.1]])
    zeros = found.frequencies == 0.0
    assert np.count_nonzero(zeros) == 2
    assert np.all(np.isnan(found.normal_stiffness[zeros]))
    assert np.all(np.isfinite(found.normal_stiffness[~zeros]))
    (warning,) = found.warnings
    assert warning.startswith("2 of 12")


def test_branches_alone_are_those_among_all():
    network = CASES["plane, all motions"]()
    q = [[0.0, 0.0], [0.3, 0.2]]
    whole = gp.Phonons(network).sensitivities(q)
    few = gp.Phonons(network).sensitivities(q, branches=[30, 7])
    assert_allclose(few.mass, whole.mass[:, [30, 7]], rtol=1e-12, atol=0.0)
    with pytest.raises(InputError, match="branches"):
        gp.Phonons(network).sensitivities(q, branches=[36])


@pytest.mark.parametrize(
    "case",
    [
        "plane",
        "held",
        "tangential forces in a plane",
        pytest.param("turned ribbon", marks=pytest.mark.slow),
        "turned wire",
    ],
)
def test_modes_of_a_network_are_those_at_gamma(case):
    network = CASES[case]()
    modes = gp.Waves(network).modes(5)
    at_gamma = gp.Phonons(network).sensitivities(np.zeros((1, sum(network.pbc))))
    nearest = np.argmin(np.abs(at_gamma.frequencies[0][:, None] - modes.frequencies), axis=0)
    for name in FIELDS:
        found = getattr(modes.sensitivities, name)
        if found is not None:
            wanted = getattr(at_gamma, name)[0][nearest]
            atol = 1e-10 * max(float(np.max(np.abs(wanted))), 1e-300)
            assert_allclose(found, wanted, rtol=0.0, atol=atol, err_msg=name)


def test_edges_of_a_random_crystal_move_as_their_derivatives_say():
    network = random_network("chain", (3,))
    edges = gp.Phonons(network).gap_sensitivities()
    assert len(edges.frequencies)
    compare(network, lambda changed: gp.Phonons(changed).gaps(), edges, np.max(edges.frequencies))


@pytest.mark.slow
def test_edges_of_a_gap_in_the_plane_move_as_their_derivatives_say():
    """A random crystal whose masses differ by a factor of 40: edges lie inside of the zone."""
    network = random_network("square", (2, 1), "out_of_plane", seed=2)
    network = replace(network, masses=network.masses * np.array([1.0, 40.0]))
    edges = gp.Phonons(network).gap_sensitivities((8, 8))
    assert len(edges.frequencies)
    change = changes(network, "mass")
    wanted = difference(lambda one: gp.Phonons(one).gaps((8, 8)), network, "mass", change)
    atol = 1e-8 * np.max(edges.frequencies)
    assert_allclose(contract(edges.mass, change), wanted, rtol=0.0, atol=atol)


@pytest.mark.claim("sensitivities-differences")
@pytest.mark.slow
def test_a_sample_and_a_finite_network_have_the_derivatives_of_differences():
    """Branches of a simulated sample, and the lowest modes of a network with a clamp."""
    packing = gp.Packing(STEEL, 8e-3, spread=gp.Uniform(2e-6))
    sample = gp.DirectSimulation(packing, shape=(3, 3)).at_force(18.0).sample.network
    q = [[0.21, 0.13]]
    found = gp.Phonons(sample).sensitivities(q)
    assert not np.any(found.degenerate)
    compare(
        sample,
        lambda changed: gp.Phonons(changed).frequencies(q),
        found,
        np.max(found.frequencies),
    )
    network = hold(random_network("sc", (2, 2, 1)), [0]).cut(2, 2)
    modes = gp.Waves(network).modes(6)
    compare(
        network,
        lambda changed: gp.Waves(changed).modes(6).frequencies,
        modes.sensitivities,
        np.max(modes.frequencies),
    )


def test_the_gap_below_held_balls_has_one_edge():
    network = CASES["one ball of two that is held"]()
    edges = gp.Phonons(network).gap_sensitivities((8, 8))
    assert edges.frequencies[0, 0] == 0.0
    assert np.all(np.isnan(edges.mass[0, 0]))
    assert np.all(np.isfinite(edges.mass[0, 1]))


def test_bands_without_a_gap_have_no_edge():
    network = gp.AveragedLattice(gp.Packing(STEEL, 8e-3, lattice="chain")).at_force(5.0).network
    edges = gp.Phonons(network).gap_sensitivities()
    assert edges.frequencies.shape == edges.degenerate.shape == (0, 2)
    assert edges.normal_stiffness.shape == (0, 2, 1)
    assert edges.qpoints.shape == (0, 2, 3)


def test_derivatives_go_to_plain_data_and_back(two_masses):
    for found in (
        gp.Phonons(two_masses).sensitivities([[0.2]]),
        gp.Phonons(two_masses).gap_sensitivities(),
    ):
        assert type(found).from_dict(found.to_dict()) == found


@pytest.mark.claim("sensitivities-shares")
def test_the_share_of_a_contact_is_its_part_of_the_energy():
    network = CASES["plane"]()
    modes = gp.Waves(network).modes(4)
    shares = modes.contact_shares
    assert_allclose(shares.sum(axis=1), 1.0, rtol=1e-11)
    stiffer = np.where(np.arange(network.n_contacts) == 2, 1.0 + 1e-6, 1.0)
    names = ("normal_stiffness", "shear_stiffness", "torsion_stiffness", "bending_stiffness")
    changed = replace(network, **{name: stiffer * getattr(network, name) for name in names})
    raised = gp.Waves(changed).modes(4).frequencies / modes.frequencies - 1.0
    assert_allclose(raised, 0.5e-6 * shares[:, 2], rtol=1e-4, atol=1e-13)


def test_no_gap_goes_to_plain_data_and_back():
    network = gp.Crystal.on("chain", [gp.Ball(STEEL, 8e-3)]).at_force(20.0).network
    none = gp.Phonons(network).gap_sensitivities()
    assert none.normal_stiffness.shape == (0, 2, 1)
    again = type(none).from_dict(json.loads(json.dumps(none.to_dict())))
    assert again == none
    assert again.on_site.shape == none.on_site.shape
    data = none.to_dict()
    for shape in ([0, -1], [1, 2], "0", [0.0, 2]):
        data["frequencies"] = {"shape": shape}
        with pytest.raises(InputError):
            type(none).from_dict(data)


def test_a_cell_of_many_balls_has_the_sums_of_all_its_parameters():
    """Frequencies go as the root of all stiffnesses together, and as one over that of all
    masses.
    """
    packing = gp.Packing(STEEL, 8e-3, spread=gp.Uniform(2e-6))
    network = gp.DirectSimulation(packing, shape=(11, 10)).at_force(18.0).sample.network
    found = gp.Phonons(network).sensitivities([[0.2, 0.3]])
    frequencies = found.frequencies
    assert frequencies.size > MANY_COLUMNS
    by_stiffness = found.normal_stiffness @ network.normal_stiffness
    by_stiffness += found.shear_stiffness @ network.shear_stiffness
    assert_allclose(by_stiffness, 0.5 * frequencies, rtol=1e-10)
    by_mass = found.mass @ network.masses + found.inertia @ network.inertias
    assert_allclose(by_mass, -0.5 * frequencies, rtol=1e-10)
