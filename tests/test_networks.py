"""Networks of contacts, and the dynamical matrix of a network: against the bands of lattices and the matrices of arrays."""

from dataclasses import replace

import numpy as np
import pytest

import granphon as gp
from granphon.networks.network import ContactNetwork
from granphon.waves.array_operator import ArrayOperator, find_kinds, make_operator
from granphon.waves.chebyshev import polynomials
from granphon.waves.operator import WaveOperator

STEEL = gp.Material(211.65e9, 0.276, 7840.0)
UNITS = gp.Units(8e-3, 3e6, 2e-3)
LATTICES = [
    ("triangular", "in_plane", (4, 3)), ("square", "all", (3, 4)), ("kagome", "in_plane", (2, 3)), ("fcc", "all", (3, 2, 3)),
    ("hcp", "all", (2, 2, 2)), ("chain", "longitudinal", (7,)), ("triangular", "out_of_plane", (3, 3)),
]  # fmt: skip


def dense_frequencies(network: ContactNetwork) -> np.ndarray:
    """Angular frequencies, rad/s, by the dense singular values of A, padded with the zeros of fewer rows."""
    root = WaveOperator(network).root.toarray()
    values = np.zeros(root.shape[1])
    found = np.linalg.svd(root, compute_uv=False)
    values[: found.size] = found
    return np.sort(values)


@pytest.mark.parametrize(("name", "motions", "shape"), LATTICES)
def test_network_of_cells_has_the_bands_of_the_lattice(name, motions, shape):
    from granphon.balls.motions import allowed_motions

    structure = gp.Packing(STEEL, 8e-3, lattice=name).structure
    among = allowed_motions(structure.dimension)[motions]
    torsion, bending = (0.02, 0.03) if among.twist else (0.0, 0.0)
    lattice = gp.ContactLattice.of(
        name, 0.0 if motions == "longitudinal" else 0.8, torsion=torsion, bending=bending, motions=among
    )
    network = ContactNetwork.of(lattice, UNITS).repeat(shape)
    mesh = np.stack(np.meshgrid(*(np.arange(n) / n for n in shape), indexing="ij"), axis=-1).reshape(-1, len(shape))
    bands = np.sort(lattice.frequencies(lattice.wavevectors(mesh)).ravel()) * UNITS.angular_frequency
    np.testing.assert_allclose(dense_frequencies(network), bands, atol=2e-8 * bands[-1])
    operator = WaveOperator(network)
    assert bands[-1] <= operator.top * (1 + 1e-12)
    np.testing.assert_allclose(np.sqrt(np.abs(np.linalg.eigvalsh(operator.matrix.toarray()))), bands, atol=1e-7 * bands[-1])


def test_network_of_a_sample_has_its_elastic_energy():
    packing = gp.Packing(STEEL, 8e-3, gp.Uniform(2.04e-6))
    sample = gp.DirectSimulation(packing, shape=(6, 8), seed=3).at_force(2.0).sample
    network = sample.network
    assert network.n_contacts == round(3 * 48 * sample.contact_fraction(0.0))
    pull = np.zeros((48, 3))
    np.add.at(pull, network.j, network.normal * network.normal_force[:, None])
    np.add.at(pull, network.i, -network.normal * network.normal_force[:, None])
    assert np.max(np.abs(pull)) <= 1e-9 * sample.force
    # balls move by an arbitrary u, w: the energy of the springs, contact by contact
    rng = np.random.default_rng(1)
    u, phi = rng.normal(size=(48, 2)), rng.normal(size=48) / packing.diameter
    normal, d = network.normal[:, :2], packing.diameter
    tangent = np.stack([-normal[:, 1], normal[:, 0]], axis=1)
    apart = u[network.j] - u[network.i]
    slip = np.sum(apart * tangent, axis=1) - 0.5 * d * (phi[network.i] + phi[network.j])
    energy = 0.5 * np.sum(network.normal_stiffness * np.sum(apart * normal, axis=1) ** 2 + network.shear_stiffness * slip**2)
    weighted = np.sqrt(packing.mass) * np.column_stack([u, phi * d / np.sqrt(10.0)])
    operator = gp.Waves(sample).operator
    x = operator.vector(weighted)
    assert 0.5 * x @ (operator @ x) == pytest.approx(energy, rel=1e-12)


def test_polynomials_are_even_in_the_frequency():
    network = ContactNetwork.of(gp.ContactLattice.of("triangular", 0.8), UNITS).repeat((3, 4))
    operator = WaveOperator(network)
    squares, vectors = np.linalg.eigh(operator.matrix.toarray())
    omega = np.sqrt(np.maximum(squares, 0.0)) / operator.top
    start = np.random.default_rng(0).normal(size=(operator.size, 2))
    for order, found in zip(range(40), polynomials(operator, start), strict=False):
        expected = vectors @ (np.cos(2 * order * np.arccos(omega))[:, None] * (vectors.T @ start))
        np.testing.assert_allclose(found, expected, atol=1e-11)


@pytest.mark.parametrize(("name", "motions", "shape"), LATTICES)
def test_stencils_of_an_array_are_the_sparse_matrix(name, motions, shape):
    from granphon.balls.lattices import find_lattice
    from granphon.balls.motions import allowed_motions

    shape = tuple(max(3, one) for one in shape)
    among = allowed_motions(find_lattice(name).dimension)[motions]
    torsion, bending = (0.02, 0.03) if among.twist else (0.0, 0.0)
    eta = 0.0 if motions == "longitudinal" else 0.8
    lattice = gp.ContactLattice.of(name, eta, torsion=torsion, bending=bending, motions=among)
    network = ContactNetwork.of(lattice, UNITS, lattice=find_lattice(name)).repeat(shape)
    rng = np.random.default_rng(5)
    open_ones = rng.random(network.n_contacts) < 0.2  # the rest of the springs differ
    kept = {
        field: getattr(network, field)[~open_ones]
        for field in ("i", "j", "shift", "normal", "normal_force", "arm_i", "arm_j")
    }
    springs = {
        field: (getattr(network, field) * rng.uniform(0.1, 1.0, network.n_contacts))[~open_ones]
        for field in ("normal_stiffness", "shear_stiffness", "torsion_stiffness", "bending_stiffness")
    }
    network = replace(network, **kept, **springs)
    kinds = find_kinds(network)
    assert kinds is not None
    stencils, sparse = ArrayOperator(network, kinds), WaveOperator(network)
    x = rng.normal(size=(network.n_balls, network.ball_motions.count))
    expected = sparse.matrix @ sparse.vector(x)
    np.testing.assert_allclose(stencils.values(stencils @ stencils.vector(x)).ravel(), expected, atol=1e-13 * sparse.top**2)
    np.testing.assert_allclose(
        stencils.matrix @ stencils.vector(x), stencils @ stencils.vector(x), atol=1e-13 * sparse.top**2
    )
    assert stencils.top == pytest.approx(sparse.top, rel=1e-12)
    two = rng.normal(size=(stencils.size, 2))
    before = rng.normal(size=(stencils.size, 2))
    expected = 4.0 / stencils.top**2 * (stencils.matrix @ two) - 2.0 * two - before
    np.testing.assert_allclose(stencils.advance(two, before), expected, atol=1e-12)


def test_array_of_a_sample_is_one_and_a_changed_one_is_not():
    packing = gp.Packing(STEEL, 8e-3, gp.Uniform(2.04e-6))
    network = gp.DirectSimulation(packing, shape=(6, 8), seed=3).at_force(2.0).sample.network
    assert find_kinds(network) is not None
    uneven = np.linspace(1.0, 1.1, network.n_contacts)
    turned = {"i": network.j, "j": network.i, "shift": -network.shift}
    masses = network.masses * np.linspace(1.0, 1.1, 48)
    for change in ({"masses": masses}, {"prestress": True}, {"lattice": None}, {"arm_i": network.arm_i * uneven}, turned):
        assert find_kinds(replace(network, **change)) is None


def test_only_large_arrays_go_without_a_matrix():
    from granphon.balls.lattices import TRIANGULAR

    one = ContactNetwork.of(gp.ContactLattice.of("triangular", 0.8), UNITS, lattice=TRIANGULAR)
    assert type(make_operator(one.repeat((9, 10)))) is WaveOperator
    assert isinstance(make_operator(one.repeat((60, 50))), ArrayOperator)
