"""Contact lattices of networks: closed forms, a twin that shares no code, and the packings' own
numbers.
"""

from __future__ import annotations

import gc
import weakref
from dataclasses import replace

import numpy as np
import pytest
from numpy.testing import assert_allclose

import granphon as gp
from granphon.base.errors import InputError
from granphon.dynamics.contact_lattice import ContactLattice
from tests.networks.twin import dynamical_matrix
from tests.packings import balance

STEEL = gp.Material(young_modulus=211.65e9, poisson_ratio=0.276, density=7840.0)
#: axes of the motions, among (u_x, u_y, u_z, phi_x, phi_y, phi_z)
AXES = {
    "longitudinal": [0],
    "in_plane": [0, 1, 5],
    "out_of_plane": [2, 3, 4],
    "all": [0, 1, 2, 3, 4, 5],
}


def random_network(name, shape, motions=None, seed=0, **more):
    """An array of cells of a lattice with random masses, radii, inertias, arms and stiffnesses."""
    state = gp.AveragedLattice(gp.Packing(STEEL, 8e-3, lattice=name, motions=motions)).at_force(
        10.0
    )
    network = state.network.repeat(shape)
    rng = np.random.default_rng(seed)
    n = network.n_balls
    c = network.n_contacts
    d = 8e-3
    masses = network.masses * rng.uniform(0.3, 3.0, n)
    spring = network.normal_stiffness * rng.uniform(0.2, 5.0, c)
    return replace(
        network,
        masses=masses,
        inertias=masses * d**2 * rng.uniform(0.05, 0.2, n),
        radii=0.5 * d * rng.uniform(0.9, 1.1, n),
        normal_stiffness=spring,
        shear_stiffness=spring * rng.uniform(0.0, 1.3, c),
        torsion_stiffness=spring * d**2 * rng.uniform(0.0, 0.1, c),
        bending_stiffness=spring * d**2 * rng.uniform(0.0, 0.1, c),
        arm_i=network.arm_i * rng.uniform(0.95, 1.05, c),
        arm_j=network.arm_j * rng.uniform(0.95, 1.05, c),
        normal_force=network.normal_force * rng.uniform(0.1, 2.0, c),
        lattice=None,
        shape=None,
        **more,
    )


def ribbon(network, axis=3):
    """The network without the contacts across the sides of all periods but one; of all for 3."""
    open_axes = [one for one in range(3) if one != axis]
    kept = ~np.any(network.shift[:, open_axes], axis=1)
    fields = {name: getattr(network, name)[kept] for name in network.contact_fields}
    return replace(
        network, pbc=tuple(one == axis for one in range(3)), lattice=None, shape=None, **fields
    )


def hold(network, balls):
    masses = network.masses.copy()
    inertias = network.inertias.copy()
    masses[balls] = inertias[balls] = np.inf
    return replace(network, masses=masses, inertias=inertias)


def turned(network, seed=1):
    """The network turned in space, or in its plane."""
    angle = np.random.default_rng(seed).uniform(0.0, 6.0, 3)
    turn = np.eye(3)
    for axis in range(3) if network.dimension == 3 else (2,):
        a, b = (one for one in range(3) if one != axis)
        one = np.eye(3)
        one[[a, a, b, b], [a, b, a, b]] = (
            np.cos(angle[axis]),
            -np.sin(angle[axis]),
            np.sin(angle[axis]),
            np.cos(angle[axis]),
        )
        turn = one @ turn
    names = ("cell", "positions", "normal")
    return replace(network, **{name: getattr(network, name) @ turn.T for name in names})


def adhering(network):
    """Two copies of a cell of one ball, whose contacts are pressed and pulled by turns: contacts of
    two sides of a ball bear the same force, so that the balls are at rest.
    """
    sizes = 0.02 * network.normal_stiffness * network.distance
    signs = (-1.0) ** np.arange(network.n_contacts)
    forces = sizes * signs
    pair = replace(network, prestress=True, adhesive=True, normal_force=forces)
    return pair.repeat((2, 1))


def pulled(network, seed=3):
    """The network with prestress, and tangential forces in the directions that its balls can move;
    at rest where it repeats along all of its axes.
    """
    rng = np.random.default_rng(seed)
    d = network.dimension
    count = network.n_contacts
    force = np.zeros((count, 3))
    force[:, :d] = 0.2 * rng.normal(size=(count, d)) * network.normal_force[:, None]
    force -= np.einsum("ca,ca->c", force, network.normal)[:, None] * network.normal
    force += network.normal_force[:, None] * network.normal
    if all(network.pbc[:d]):  # the forces nearest to these that are in balance
        ends = np.zeros((network.n_balls, count))
        np.add.at(ends, (network.j, np.arange(count)), 1.0)
        np.add.at(ends, (network.i, np.arange(count)), -1.0)
        free = ends[network.moving]
        force -= np.linalg.pinv(free) @ (free @ force)
    normal_force = np.einsum("ca,ca->c", force, network.normal)
    return replace(
        network,
        prestress=True,
        normal_force=normal_force,
        tangential_force=force - normal_force[:, None] * network.normal,
    )


def by_radii(network):
    """The network as LAMMPS has it: :func:`pulled`, with slip that has the radii as levers."""
    return replace(
        pulled(network),
        slip_levers="radii",
        radii=network.radii * np.linspace(0.9, 1.1, network.n_balls),
    )


def by_yade(network):
    """The network as YADE has it: :func:`pulled`, with its law and its slip."""
    return replace(by_radii(network), slip_levers="yade", tangential_law="yade")


CASES = {
    "chain": lambda: random_network("chain", (3,)),
    "chain, all motions": lambda: random_network("chain", (3,), "all"),
    "plane": lambda: random_network("triangular", (3, 2)),
    "one ball": lambda: random_network("triangular", (1, 1), "all"),
    "out of the plane": lambda: random_network("honeycomb", (2, 1), "out_of_plane"),
    "plane, all motions": lambda: random_network("kagome", (1, 2), "all"),
    "fcc": lambda: random_network("fcc", (2, 2, 1)),
    "diamond": lambda: random_network("diamond", (1, 1, 1)),
    "prestress": lambda: balance(random_network("fcc", (2, 1, 1), prestress=True)),
    "prestress of contacts that pull": lambda: adhering(random_network("triangular", (1, 1))),
    "tangential forces": lambda: pulled(random_network("fcc", (2, 1, 1))),
    "tangential forces in a plane": lambda: pulled(random_network("triangular", (3, 2), "all")),
    "tangential forces, one ball": lambda: pulled(random_network("triangular", (1, 1))),
    "tangential forces, one ball in space": lambda: pulled(random_network("fcc", (1, 1, 1))),
    "tangential forces in a ribbon": lambda: pulled(
        turned(ribbon(random_network("square", (3, 3)), 1))
    ),
    "tangential forces of balls that are held": lambda: pulled(
        hold(random_network("hcp", (2, 2, 1)), [3])
    ),
    "slip by the radii": lambda: by_radii(random_network("fcc", (2, 1, 1))),
    "slip by the radii in a plane": lambda: by_radii(random_network("triangular", (2, 1), "all")),
    "slip by the radii, one ball": lambda: by_radii(random_network("fcc", (1, 1, 1))),
    "slip by the radii in a ribbon": lambda: by_radii(
        turned(ribbon(random_network("triangular", (2, 3)), 0))
    ),
    "slip by the radii of balls that are held": lambda: by_radii(
        hold(random_network("hcp", (2, 2, 1)), [3])
    ),
    "slip of YADE": lambda: by_yade(random_network("fcc", (2, 1, 1))),
    "slip of YADE in a plane": lambda: by_yade(random_network("triangular", (2, 1), "all")),
    "slip of YADE of balls that are held": lambda: by_yade(
        hold(random_network("hcp", (2, 2, 1)), [3])
    ),
    "ribbon along x": lambda: ribbon(random_network("triangular", (2, 3)), 0),
    "ribbon along the second period": lambda: ribbon(random_network("honeycomb", (2, 3), "all"), 1),
    "wire in space": lambda: ribbon(random_network("bcc", (2, 3, 2)), 2),
    "turned ribbon": lambda: turned(ribbon(random_network("square", (3, 3)), 1)),
    "turned wire": lambda: turned(ribbon(random_network("sc", (2, 2, 2)), 0)),
    "one ball of two that is held": lambda: hold(random_network("honeycomb", (1, 1)), [1]),
    "held": lambda: hold(random_network("triangular", (3, 3)), [0, 4]),
    "held in space": lambda: balance(hold(random_network("hcp", (2, 2, 1), prestress=True), [3])),
    "ribbon on a wall": lambda: hold(ribbon(random_network("square", (1, 4), "all"), 0), [0]),
}


@pytest.mark.claim("network-bands")
@pytest.mark.parametrize("case", CASES)
def test_frequencies_are_those_of_forces_summed_one_by_one(case):
    network = CASES[case]()
    lattice = gp.ContactLattice.from_network(network)
    rng = np.random.default_rng(5)
    fractions = rng.uniform(-0.5, 0.5, (3, lattice.periods))
    periods = network.cell[list(network.pbc)]
    scale = network.scales.angular_frequency
    found = lattice.frequencies(lattice.wavevectors(fractions)) * scale
    axes = AXES[network.motions]
    for values, one in zip(found, fractions, strict=True):
        q = 2.0 * np.pi * np.linalg.pinv(periods) @ one
        matrix = dynamical_matrix(network, q)
        kept = (6 * np.arange(len(matrix) // 6)[:, None] + axes).ravel()
        wanted = np.linalg.eigvalsh(matrix[np.ix_(kept, kept)])
        assert len(values) == len(wanted)
        assert_allclose(values**2, wanted, rtol=0.0, atol=1e-12 * wanted[-1])


# -- closed forms ----------------------------------------------------------------------------------


def table_network(
    positions, cell, masses, contacts, normals, k, kappa=0.0, radius=0.5, force=1.0, **more
):
    """A network of balls of radius 1/2 in SI, from contacts (i, j, shift)."""
    positions = np.atleast_2d(np.asarray(positions, float))
    cell = np.asarray(cell, float)
    n, i, j = len(positions), *(np.array([c[end] for c in contacts]) for end in (0, 1))
    full = np.zeros((n, 3))
    shift = np.array([c[2] for c in contacts])
    full[:, : positions.shape[1]] = positions
    whole = np.zeros((3, 3))
    steps = np.zeros((len(i), 3), int)
    whole[: len(cell), : cell.shape[1]] = cell
    steps[:, : shift.shape[1]] = shift
    normal = np.zeros((len(i), 3))
    normal[:, : np.shape(normals)[1]] = normals
    masses = np.broadcast_to(np.asarray(masses, float), n)
    spring = np.broadcast_to(np.asarray(k, float), len(i))
    half = np.full(len(i), 0.5)
    none = np.zeros(len(i))
    return gp.ContactNetwork(
        whole,
        tuple(axis < len(cell) for axis in range(3)),
        full,
        np.full(n, radius),
        masses,
        0.1 * masses,
        i,
        j,
        steps,
        normal,
        np.full(len(i), force),
        spring,
        np.broadcast_to(kappa, len(i)),
        none,
        none,
        half,
        half,
        **more,
    )


def rock_salt(k, kappa, masses):
    """NaCl: each ball touches six of the other kind."""
    cell = np.array([[0, 1, 1], [1, 0, 1], [1, 1, 0]]) * 1.0
    steps = [
        np.linalg.solve(cell.T, s * np.eye(3)[a] - np.eye(3)[0]) for a in range(3) for s in (1, -1)
    ]
    contacts = [(0, 1, np.rint(step).astype(int)) for step in steps]
    normals = [s * np.eye(3)[a] for a in range(3) for s in (1, -1)]
    return table_network([[0, 0, 0], [1, 0, 0]], cell, masses, contacts, normals, k, kappa)


def test_a_mass_on_a_spring_in_each_ball_opens_a_gap():
    """(4 k sin^2(q/2)/m + k_r/m - w^2)(k_r/m_r - w^2) = k_r^2/(m m_r): a gap from about k_r/m_r to
    k_r (1/m + 1/m_r).
    """
    k = 1e7
    spring = 2e4
    m = 2e-3
    mass = 1e-3
    none = np.zeros(2)
    network = gp.ContactNetwork(
        cell=np.diag([8e-3, 0, 0]), pbc=(True, False, False), dimension=1, motions="longitudinal",
        positions=[[0, 0, 0], [1e-3, 0, 0]], radii=[4e-3, 1e-3], masses=[m, mass], inertias=[1e-8, 1e-10],
        i=[0, 0], j=[0, 1], shift=[[1, 0, 0], [0, 0, 0]], normal=[[1, 0, 0], [1, 0, 0]], normal_force=[10.0, 0.0],
        normal_stiffness=[k, spring], shear_stiffness=none, torsion_stiffness=none, bending_stiffness=none,
        arm_i=[4e-3, 5e-4], arm_j=[4e-3, 5e-4],
    )  # fmt: skip
    phonons = gp.Phonons(network)
    at = np.linspace(0.0, 0.5, 11)
    total = 4 * k * np.sin(np.pi * at) ** 2 / m + spring / m
    inner = spring / mass
    half = 0.5 * (total + inner)
    upper = half + np.sqrt((0.5 * (total - inner)) ** 2 + inner * spring / m)
    wanted = np.sqrt(np.stack([(total - spring / m) * inner / upper, upper], axis=1)) / (2 * np.pi)
    assert_allclose(phonons.frequencies(at[:, None]), wanted, rtol=1e-11, atol=1e-9)
    ends = np.sqrt([inner, inner + spring / m]) / (2 * np.pi)
    gaps = phonons.gaps()
    assert_allclose(gaps, [ends], rtol=1e-3)
    assert_allclose(gaps[0, 1], ends[1], rtol=1e-12)


@pytest.mark.parametrize(
    ("force", "shape", "seed"),
    [
        (0.5, (6, 6), 2),
        pytest.param(0.5, (8, 8), 0, marks=pytest.mark.slow),
        pytest.param(0.05, (8, 8), 0, marks=pytest.mark.exhaustive),
    ],
)
def test_loose_balls_are_set_aside(force, shape, seed):
    """Balls without a load, and rows of two that roll between others, are in no modulus, and stay
    behind in sound.
    """
    steel = gp.Material(211.65e9, 0.276, 7840.0)
    packing = gp.Packing(steel, 8e-3, spread=gp.Uniform(2.04e-6))
    array = gp.DirectSimulation(packing, shape, seed, geometry="lattice")
    sample = array.at_force(force).sample
    network = sample.network
    lattice = ContactLattice.from_network(sample.network)
    moduli = gp.moduli(network)
    sound = gp.sound_velocities(network, direction=(1, 0))
    # the sample's tensor is found by iteration, to ten digits
    assert_allclose(
        moduli.tensor, sample.elastic_tensor, rtol=0.0, atol=1e-10 * np.max(moduli.tensor)
    )
    count = lattice.free_branches
    assert count >= 3 * len(network.rattlers) > 0
    slopes = (
        lattice.frequencies([[1e-6, 0.0]])[0, count : count + 2] / 1e-6 * network.scales.velocity
    )
    assert_allclose(sound.velocities, slopes, rtol=1e-9)
    for found in (moduli, sound):
        assert any("not held" in one for one in found.warnings)
    if force == 0.5:  # two rattlers
        bare = gp.sound_velocities(network.without_rattlers(), direction=(1, 0))
        assert_allclose(bare.velocities, sound.velocities, rtol=1e-5)
    found = lattice.frequencies([[0.1, 0.2]])
    matrix = lattice.dynamical_matrix([[0.1, 0.2]])
    assert np.all(found[0, :count] == 0.0)
    assert_allclose(found[0, count:] ** 2, np.linalg.eigvalsh(matrix)[0, count:], rtol=1e-9)
    pulse = gp.pulse_velocities(network, 300.0, (1, 0))
    assert np.all(pulse.group < [sound.longitudinal, sound.transverse])
    assert np.all(pulse.group > 0.9 * np.array([sound.longitudinal, sound.transverse]))


@pytest.mark.parametrize("layers", [2, 3, 5, 6])
def test_a_displacement_that_costs_nothing_leaves_the_other_wave_alone(layers):
    # rows of a frictionless kagome ribbon part freely; along them contacts stretch, and a fifth of
    # the mass stays behind
    network = (
        gp.AveragedLattice(gp.Packing(STEEL, 8e-3, lattice="kagome", friction=False))
        .at_force(10.0)
        .network
    )
    waves = gp.sound_velocities(network.cut(0, layers))
    assert_allclose(waves.longitudinal, np.sqrt(5.0 / 6.0) * network.scales.velocity, rtol=1e-12)
    assert waves.transverse == 0.0


def test_networks_that_have_no_lattice_are_refused():
    network = random_network("triangular", (3, 3))
    with pytest.raises(InputError, match=r"no axis.*gp\.Waves"):
        gp.ContactLattice.from_network(ribbon(network))
    with pytest.raises(InputError, match="do not move"):
        gp.ContactLattice.from_network(hold(network, [0])).sound_velocities((1.0, 0.0))
    with pytest.raises(InputError, match="no ball that moves"):
        gp.ContactLattice.from_network(hold(network, np.arange(9)))


PACKINGS = [
    ("chain", {}),
    ("chain", {"motions": "all", "torsion": 0.1}),
    ("triangular", {}),
    ("triangular", {"friction": False}),
    ("triangular", {"motions": "all", "torsion": 0.07, "bending": 0.03}),
    ("square", {}),
    ("honeycomb", {}),
    ("kagome", {"motions": "out_of_plane"}),
    ("sc", {}),
    ("bcc", {}),
    ("fcc", {}),
    ("hcp", {"torsion": "mindlin"}),
    ("diamond", {}),
]


@pytest.mark.parametrize(
    ("name", "options", "finite_overlap"),
    # these buckle
    [
        (*one, finite)
        for one in PACKINGS
        for finite in (False, True)
        if not (finite and "motions" in one[1])
    ],
    ids=str,
)
def test_the_network_of_a_state_has_the_numbers_of_its_lattice(name, options, finite_overlap):
    state = gp.AveragedLattice(gp.Packing(STEEL, 8e-3, lattice=name, **options)).at_force(
        10.0, finite_overlap=finite_overlap
    )
    own = state.contact_lattice()
    found = gp.ContactLattice.from_network(state.network)
    assert state.network.scales == state.scales
    assert found.motions == own.motions
    assert found.free_branches == own.free_branches
    q = np.random.default_rng(1).uniform(-4.0, 4.0, (10, own.periods))
    q[0] = 1e-9 * q[0]
    q[1] = 0.0
    one = own.frequencies(q)
    two = found.frequencies(q)
    assert_allclose(two, one, rtol=1e-12, atol=1e-14 * np.max(one))
    assert bool(found.mechanism) == bool(own.mechanism)
    if not own.mechanism and not (finite_overlap and name in ("square", "chain")):
        assert_allclose(
            found.sound_velocities(q[2:])[0], own.sound_velocities(q[2:])[0], rtol=1e-12, atol=1e-14
        )
        if "longitudinal" in own.wave_names:
            tensor = own.elastic_tensor()
            assert_allclose(found.elastic_tensor(), tensor, rtol=0.0, atol=1e-13 * np.max(tensor))


def test_a_network_that_is_gone_leaves_no_lattice_behind():
    network = CASES["fcc"]()
    gp.sound_velocities(network, (1.0, 0.0, 0.0))
    lattice = weakref.ref(gp.ContactLattice.from_network(network))
    assert lattice() is not None
    del network
    gc.collect()
    assert lattice() is None
