"""Networks of contacts, and the dynamical matrix of a network: against the bands of lattices and
the matrices of arrays.
"""

import json
from dataclasses import fields, replace

import numpy as np
import pytest

import granphon as gp
from granphon.base.errors import InputError
from granphon.networks import rattlers
from granphon.networks.network import ContactNetwork, number_pieces
from granphon.networks.rattlers import find_rattlers
from granphon.waves.operator import WaveOperator

STEEL = gp.Material(211.65e9, 0.276, 7840.0)
UNITS = gp.Units(8e-3, 3e6, 2e-3)
LATTICES = [
    ("triangular", "in_plane", (4, 3)),
    ("square", "all", (3, 4)),
    ("kagome", "in_plane", (2, 3)),
    ("fcc", "all", (3, 2, 3)),
    ("hcp", "all", (2, 2, 2)),
    ("chain", "longitudinal", (7,)),
    ("triangular", "out_of_plane", (3, 3)),
]


def dense_frequencies(network: ContactNetwork) -> np.ndarray:
    """Angular frequencies, rad/s, by the dense singular values of A, padded with the zeros of fewer
    rows.
    """
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
        name,
        0.0 if motions == "longitudinal" else 0.8,
        torsion=torsion,
        bending=bending,
        motions=among,
    )
    network = lattice.contact_network(UNITS).repeat(shape)
    mesh = np.stack(
        np.meshgrid(*(np.arange(n) / n for n in shape), indexing="ij"), axis=-1
    ).reshape(-1, len(shape))
    bands = (
        np.sort(lattice.frequencies(lattice.wavevectors(mesh)).ravel()) * UNITS.angular_frequency
    )
    np.testing.assert_allclose(dense_frequencies(network), bands, atol=2e-8 * bands[-1])
    operator = WaveOperator(network)
    assert bands[-1] <= operator.top * (1 + 1e-12)
    np.testing.assert_allclose(
        np.sqrt(np.abs(np.linalg.eigvalsh(operator.matrix.toarray()))), bands, atol=1e-7 * bands[-1]
    )


def test_network_of_a_sample_has_its_elastic_energy():
    packing = gp.Packing(STEEL, 8e-3, gp.Uniform(2.04e-6))
    sample = (
        gp.DirectSimulation(packing, shape=(6, 8), seed=3, geometry="lattice").at_force(2.0).sample
    )
    network = sample.network
    assert network.n_contacts == round(3 * 48 * sample.contact_fraction(0.0))
    pull = np.zeros((48, 3))
    np.add.at(pull, network.j, network.normal * network.normal_force[:, None])
    np.add.at(pull, network.i, -network.normal * network.normal_force[:, None])
    assert np.max(np.abs(pull)) <= 1e-9 * sample.force
    # balls move by an arbitrary u, w: the energy of the springs, contact by contact
    rng = np.random.default_rng(1)
    u = rng.normal(size=(48, 2))
    phi = rng.normal(size=48) / packing.diameter
    normal = network.normal[:, :2]
    d = packing.diameter
    tangent = np.stack([-normal[:, 1], normal[:, 0]], axis=1)
    apart = u[network.j] - u[network.i]
    slip = np.sum(apart * tangent, axis=1) - 0.5 * d * (phi[network.i] + phi[network.j])
    energy = 0.5 * np.sum(
        network.normal_stiffness * np.sum(apart * normal, axis=1) ** 2
        + network.shear_stiffness * slip**2
    )
    weighted = np.sqrt(packing.mass) * np.column_stack([u, phi * d / np.sqrt(10.0)])
    operator = gp.Waves(sample).operator
    x = operator.vector(weighted)
    assert 0.5 * x @ (operator @ x) == pytest.approx(energy, rel=1e-12)


# -- from states and Atoms -------------------------------------------------------------------------


@pytest.mark.parametrize("finite_overlap", [False, True])
@pytest.mark.parametrize(
    ("name", "motions", "shape"),
    [
        ("chain", "longitudinal", (5,)),
        ("triangular", "in_plane", (4, 3)),
        ("square", "all", (3, 3)),
        ("hcp", "all", (3, 2, 3)),
    ],
)
def test_network_of_a_state_is_that_of_its_atoms(name, motions, shape, finite_overlap):
    packing = gp.Packing(STEEL, 8e-3, lattice=name, motions=motions, friction=name != "chain")
    state = gp.AveragedLattice(packing).at_force(18.446, finite_overlap=finite_overlap)
    network = state.network.repeat(shape)
    assert network.shape == shape
    assert network.lattice == packing.structure
    assert network.prestress == finite_overlap
    np.testing.assert_allclose(network.normal_force, 18.446, rtol=1e-14)
    np.testing.assert_allclose(network.radii, 4e-3)
    distance = 8e-3 - state.overlap * finite_overlap
    np.testing.assert_allclose(np.linalg.norm(network.vector, axis=1), distance, rtol=1e-12)
    balls = gp.atoms(state).repeat((*shape, 1, 1)[:3])
    balls.calc = gp.HertzMindlin(state)
    operator = gp.Waves(balls).operator
    squares = np.linalg.eigvalsh(operator.matrix.toarray())
    atol = 1e-12 * squares[-1]
    np.testing.assert_allclose(
        np.linalg.eigvalsh(WaveOperator(network).matrix.toarray()), squares, atol=atol
    )
    # the calculator's own force constants, in units of k, and masses of one
    constants = (
        balls.calc.get_force_constants(balls, format="csr").toarray()
        * state.scales.angular_frequency**2
    )
    np.testing.assert_allclose(np.linalg.eigvalsh(constants)[-squares.size :], squares, atol=atol)


def test_network_of_atoms_that_are_open_and_lack_balls():
    """A slab with a vacancy repeats along x alone; balls that are missing, and contacts across an
    end, are not there.
    """
    state = gp.AveragedLattice(gp.Packing(STEEL, 8e-3)).at_force(18.446)
    slab = gp.atoms(state).repeat((5, 4, 1))
    slab.pbc = (True, False, False)
    slab.calc = gp.HertzMindlin(state)
    whole = slab.calc.contact_network(slab)
    assert whole.pbc == (True, False, False)
    assert whole.n_contacts == 3 * 20 - 2 * 5
    assert not whole.shift[:, 1:].any()
    assert not whole.cell[1:].any()
    del slab[6]
    network = slab.calc.contact_network(slab, motions="in_plane")
    assert (network.n_balls, network.n_contacts) == (19, whole.n_contacts - 6)


def test_what_has_no_network_is_one_error():
    state = gp.AveragedLattice(gp.Packing(STEEL, 8e-3)).at_force(18.446)
    with pytest.raises(gp.GranphonError, match="2 loads"):
        _ = gp.AveragedLattice(gp.Packing(STEEL, 8e-3)).at_force([1.0, 2.0]).network
    simulated = gp.DirectSimulation(
        gp.Packing(STEEL, 8e-3, gp.Uniform(2.04e-6)), shape=(6, 8), seed=3, geometry="lattice"
    ).at_force(2.0)
    with pytest.raises(gp.GranphonError, match=r"state.samples\[0\].network"):
        gp.Waves(simulated)
    with pytest.raises(gp.GranphonError, match="shape: found"):
        state.network.repeat((3, 3, 3))
    with pytest.raises(gp.GranphonError, match="no network of contacts"):
        gp.Waves(3.0)


def test_waves_of_a_state_are_those_of_one_cell():
    """Of the triangular lattice: the rotation at Gamma, 30 eta k/M."""
    state = gp.AveragedLattice(gp.Packing(STEEL, 8e-3)).at_force(18.446)
    waves = gp.Waves(state)
    assert waves.network.n_balls == 1
    eta = state.packing.mindlin_ratio
    np.testing.assert_allclose(
        waves.modes(1).frequencies, np.sqrt(30.0 * eta) * state.scales.frequency, rtol=1e-13
    )


def test_a_network_knows_its_reduced_units():
    """The mean diameter and mass of what moves, and the mean stiffness of what carries load."""
    state = gp.AveragedLattice(gp.Packing(STEEL, 8e-3, lattice="kagome")).at_force(
        18.446, finite_overlap=True
    )
    assert state.network.scales == state.scales
    assert state.network.repeat((5, 7)).scales == state.scales
    network = make([[0, 0], [2, 0], [4, 0]], [(0, 1), (1, 2)], force=[2.0, 0.0])
    springs = np.array([3.0, 7.0])
    masses = np.array([1.0, 2.0, np.inf])
    units = replace(network, normal_stiffness=springs, masses=masses).scales
    assert (units.length, units.stiffness, units.mass) == (2.0, 3.0, 1.5)
    assert (
        replace(network, normal_stiffness=springs, normal_force=np.zeros(2)).scales.stiffness == 5.0
    )
    with pytest.raises(gp.GranphonError, match="no reduced units"):
        _ = network.select([0]).scales


# -- plain data ------------------------------------------------------------------------------------


def test_networks_go_through_json():
    """Also with walls, whose masses are infinite, and with labels."""
    network = gp.ContactLattice.of("triangular", 0.8).contact_network(UNITS).repeat((3, 2))
    masses = network.masses.copy()
    masses[2] = np.inf
    for one in (
        network,
        replace(network, masses=masses),
        network.select([5, 1, 0]),
        with_lattice((3, 2)),
    ):
        again = ContactNetwork.from_dict(json.loads(json.dumps(one.to_dict())))
        assert again == one
        assert again.lattice == one.lattice
    damaged = network.to_dict()
    damaged["masses"][3] *= 1.0 + 1e-9
    with pytest.raises(gp.GranphonError, match="digest"):
        ContactNetwork.from_dict(damaged)


def with_lattice(shape):
    state = gp.AveragedLattice(gp.Packing(STEEL, 8e-3)).at_force(18.446)
    return state.network.repeat(shape)


# -- rattlers and pieces ---------------------------------------------------------------------------


def make(positions, contacts, force=1.0, *, slip=0.0, dimension=2, **more):
    """A network of balls of 1 m radius at some places, which touch along the lines between them."""
    places = np.zeros((len(positions), 3))
    places[:, : np.shape(positions)[1]] = positions
    i, j = np.array(list(contacts), int).reshape(-1, 2).T
    vector = places[j] - places[i]
    distance = np.linalg.norm(vector, axis=1)
    n, count = len(places), len(i)
    fields = dict(  # noqa: C408
        cell=np.zeros((3, 3)),
        pbc=(False,) * 3,
        positions=places,
        radii=np.ones(n),
        masses=np.ones(n),
        inertias=0.4 * np.ones(n),
        i=i,
        j=j,
        shift=np.zeros((count, 3), int),
        normal=vector / distance[:, None],
        normal_force=np.broadcast_to(force, count),
        normal_stiffness=np.ones(count),
        shear_stiffness=np.full(count, slip),
        torsion_stiffness=np.zeros(count),
        bending_stiffness=np.zeros(count),
        arm_i=0.5 * distance,
        arm_j=0.5 * distance,
        motions="in_plane" if dimension == 2 else "all",
        dimension=dimension,
    )
    return ContactNetwork(**(fields | more))


HEXAGON = 2.0 * np.array([[np.cos(a), np.sin(a)] for a in np.arange(6) * np.pi / 3.0])


def test_balls_that_weak_contacts_hold_are_kept():
    """Two balls between walls, one of them under 1e-7 of the force of the other: by Hertz's law its
    contacts are 1e-7^(1/3) as stiff, and it has the lowest mode.
    """
    contacts = [(0, 1), (1, 2), (2, 3), (3, 4)]
    walls = np.where(np.arange(5) % 2, 1.0, np.inf)
    for weak, modes in ((1e-7, 2), (1e-12, 1)):
        force = np.array([1.0, 1.0, weak, weak])
        row = make(
            2.0 * np.arange(5)[:, None],
            contacts,
            force,
            dimension=1,
            motions="longitudinal",
            normal_stiffness=np.cbrt(force),
            masses=walls,
        ).without_rattlers()
        assert row.left_out == 2 - modes
        wanted = np.sqrt(2.0 * np.cbrt([weak, 1.0][2 - modes :])) / (2.0 * np.pi)
        np.testing.assert_allclose(gp.Waves(row).modes(modes).frequencies, wanted, rtol=1e-12)


def test_contacts_that_adhere_hold_balls_without_a_force():
    """Of a lattice in which one contact presses, some pull and the others have no force."""
    packing = gp.Packing(gp.Material(70e9, 0.2, 2500.0), 2e-3)
    network = gp.AveragedLattice(packing).at_force(10.0).network.repeat((4, 4))
    force = np.where(network.normal[:, 0] > 0.9, -1.0, 0.0)
    force[np.argmin(network.normal[:, 0])] = 1.0
    network = replace(network, adhesive=True, normal_force=force)
    assert not network.rattlers.size
    pressed = replace(network, adhesive=False, normal_force=np.maximum(force, 0.0))
    assert pressed.rattlers.size == network.n_balls


def test_rattlers_are_found_one_after_the_other():
    """A tail of two balls on a hexagon of seven; the ball at its end is loose first, and so the
    next.
    """
    balls = [(0.0, 0.0), *HEXAGON, (4.0, 0.0), (6.0, 0.0), (0.0, 9.0)]
    contacts = [
        *((0, k) for k in range(1, 7)),
        *((k, k % 6 + 1) for k in range(1, 7)),
        (1, 7),
        (7, 8),
    ]
    network = make(balls, contacts, slip=0.5)
    np.testing.assert_array_equal(network.rattlers, [7, 8, 9])
    kept = network.without_rattlers()
    assert (kept.n_balls, kept.n_contacts, kept.left_out) == (7, 12, 3)
    np.testing.assert_array_equal(kept.labels, np.arange(7))
    assert kept.without_rattlers() is kept
    assert network.without_rattlers(held_by=1).n_balls == 9
    # without slip three contacts hold a ball, and those of the rim have three; but all is lost
    # where it takes four
    slippery = make(balls, contacts)
    np.testing.assert_array_equal(slippery.rattlers, [7, 8, 9])
    with pytest.raises(gp.GranphonError, match="rattlers"):
        slippery.without_rattlers(held_by=4)
    # contacts of almost no force carry none; the tail is held by a wall at its end
    np.testing.assert_array_equal(
        make(balls, contacts, [*[1.0] * 12, 1.0, 1e-9], slip=0.5).rattlers, [7, 8, 9]
    )
    walls = [*np.ones(8), np.inf, 1.0]
    np.testing.assert_array_equal(make(balls, contacts, slip=0.5, masses=walls).rattlers, [9])


@pytest.mark.filterwarnings("ignore:.* the network falls into")
@pytest.mark.parametrize(
    ("weak", "left_out"), [(5e-7, 0), (1e-7, 0), (1.1e-8, 0), (1e-9, 18), (1e-12, 18)]
)
def test_contacts_hold_as_their_stiffness_says(weak, left_out):
    """Every other row of a crystal carries load, and holds the balls between by weak contacts of
    Hertz's law.

    Lines of contacts, each under a force of its own, are at rest. A contact under 1e-6 of the mean
    force has 1 % of its stiffness, without which rows move sideways at no cost.
    """
    n = 6
    d = 8e-3
    whole = (
        gp.ContactLattice.of("triangular", 0.0)
        .contact_network(gp.Units(d, 3e6, 2e-3))
        .repeat((n, n))
    )
    along = np.abs(whole.normal[:, 0]) > 0.9
    force = np.where(along & (whole.i % n % 2 == 0), 1.0, weak)
    tables = (
        {
            "x": whole.positions[:, 0],
            "y": whole.positions[:, 1],
            "radius": whole.radii,
            "mass": whole.masses,
        },
        {
            "i": whole.i,
            "j": whole.j,
            "normal_force": force,
            "normal_stiffness": 3e6 * np.cbrt(force),
            **{f"shift_{axis + 1}": whole.shift[:, axis] for axis in range(2)},
        },
    )
    options = {"cell": whole.cell[:2, :2], "friction": False}
    read, every = (
        gp.ContactNetwork.from_table(*tables, keep_rattlers=keep, **options)
        for keep in (False, True)
    )
    assert (read.left_out, read.n_balls) == (left_out, n * n - left_out)
    exact = np.linalg.eigvalsh(gp.Waves(every).operator.matrix.toarray())
    mean = np.mean(every.normal_stiffness[force == 1.0])
    mass = whole.masses[0]
    if left_out:  # what is neglected is less than this of the squared frequencies of the rows
        assert np.max(every.normal_stiffness[force < 1.0]) < 2e-3 * mean
        return
    assert np.count_nonzero(exact < 1e-3 * (3.0 * weak) ** (1.0 / 3.0) * mean / mass) == 2
    np.testing.assert_allclose(
        gp.Waves(read).modes(1).frequencies, np.sqrt(exact[2]) / (2.0 * np.pi), rtol=1e-6
    )


@pytest.mark.parametrize(("friction", "balls"), [(True, 9), (False, 9), (True, 2)])
def test_error_of_a_free_chain_says_what_mends_it(friction, balls):
    tables = (
        {"x": np.arange(balls) * 7.9e-3, "radius": [4e-3] * balls},
        {"i": range(balls - 1), "j": range(1, balls)},
    )
    with pytest.raises(gp.GranphonError, match="held_by=1"):
        ContactNetwork.from_table(*tables, material=STEEL, friction=friction)
    assert (
        ContactNetwork.from_table(*tables, material=STEEL, friction=friction, held_by=1).n_balls
        == balls
    )


@pytest.mark.parametrize("force", [1.0, 1e4, 1e6])
def test_waves_in_a_network_have_the_warnings_of_the_state(force):
    """Those of the contacts' radius, in the same words; of other limits the network lacks the
    material.
    """
    state = gp.AveragedLattice(gp.Packing(STEEL, 8e-3)).at_force(force)
    warning = gp.validity(state)["contact_radius"].warning
    assert (warning is None) == (force == 1.0)
    network = state.network.repeat((4, 3))
    waves = gp.Waves(network)
    wanted = () if warning is None else (warning,)
    assert waves.warnings == wanted
    q = waves.nearest_wavevectors([[200.0, 0.0]])
    results = waves.dos(), waves.dos().with_moments(300), waves.modes(2), waves.spectral_function(q)
    assert all(one.warnings == wanted for one in results)
    assert waves.transmit(3e4, (0, 1), 7e-3, 1).warnings[: len(wanted)] == wanted
    assert all(str(wanted[0])[:60] in repr(one) for one in results if wanted)
    # springs of one stiffness under forces that differ are no contacts of Hertz
    forces = force * np.linspace(0.5, 1.5, network.n_contacts)
    assert not gp.Waves(replace(network, normal_force=forces, prestress=False)).warnings


def test_balls_in_a_straight_row_are_held():
    """Two contacts hold a ball without friction if their forces are in balance, and not at an
    angle.
    """
    rows = with_lattice((4, 4)).select(np.arange(16))
    assert not rows.rattlers.size
    square = gp.ContactLattice.of("square", 0.0)
    network = square.contact_network(UNITS).repeat((3, 3))
    one_row = replace(
        network,
        **{
            name: getattr(network, name)[np.abs(network.normal[:, 0]) > 0.5]
            for name, layout in network._shapes.items()
            if layout.split()[0] == "c" and "?" not in layout
        },
    )
    assert not one_row.rattlers.size
    bent = make(
        [(0.0, 0.0), (2.0, 0.0), (3.0, 3.0**0.5)], [(0, 1), (1, 2)], masses=[np.inf, 1.0, np.inf]
    )
    np.testing.assert_array_equal(bent.rattlers, [1])


def test_rattlers_by_brute_force():
    """Removal one ball at a time, in any order, leaves the same balls."""
    rng = np.random.default_rng(8)
    places = rng.uniform(0.0, 13.0, (60, 2))
    apart = np.linalg.norm(places[:, None] - places, axis=-1)
    contacts = np.argwhere(np.triu(np.abs(apart - 2.0) < 0.45, 1))
    for slip, least in ((0.5, 2), (0.0, 3)):
        # forces of one contact's own size, so that no two of them are in balance
        network = make(places, contacts, rng.uniform(0.5, 1.5, len(contacts)), slip=slip)
        kept = set(range(60))
        while True:
            counts = {
                ball: sum(ball in pair and set(pair) <= kept for pair in contacts.tolist())
                for ball in kept
            }
            loose = [ball for ball, count in counts.items() if count < least]
            if not loose:
                break
            kept.remove(loose[rng.integers(len(loose))])
        assert set(network.rattlers.tolist()) == set(range(60)) - kept
        assert 0 < len(kept) < 60


@pytest.mark.parametrize("held_by", [5, 7, 300_000, 10**39])
def test_the_number_that_holds_balls_is_found_in_few_steps(held_by, monkeypatch):
    """The error names the largest number of contacts at which a ball is held; senseless numbers
    cost no more than others.
    """
    rng = np.random.default_rng(8)
    places = rng.uniform(0.0, 13.0, (80, 2))
    apart = np.linalg.norm(places[:, None] - places, axis=-1)
    network = make(places, np.argwhere(np.triu(np.abs(apart - 2.0) < 0.45, 1)), slip=0.5)
    largest = max(n for n in range(12) if find_rattlers(network, n).size < network.n_balls)
    assert 1 < largest < 5
    passes = []
    monkeypatch.setattr(
        rattlers, "find_rattlers", lambda one, n: passes.append(n) or find_rattlers(one, n)
    )
    with pytest.raises(gp.GranphonError, match=f"held_by={largest}"):
        network.without_rattlers(held_by)
    assert len(passes) <= 5


def test_pieces():
    """Two triangles and a ball alone; a wall between the triangles does not join them, and belongs
    to both.
    """
    triangle = np.array([[0.0, 0.0], [2.0, 0.0], [1.0, 3.0**0.5]])
    balls = [*triangle, *(triangle + np.array([10.0, 0.0])), (4.0, 0.0), (30.0, 0.0)]
    contacts = [(0, 1), (1, 2), (0, 2), (3, 4), (4, 5), (3, 5), (1, 6)]
    masses = [*np.ones(6), np.inf, 1.0]
    network = make(balls, contacts, slip=0.5, masses=masses)
    pieces = network.pieces()
    assert [piece.labels.tolist() for piece in pieces] == [[0, 1, 2, 6], [3, 4, 5], [7]]
    assert [piece.n_contacts for piece in pieces] == [4, 3, 0]
    assert pieces[1].pieces() == (pieces[1],)
    frequencies = np.concatenate([dense_frequencies(piece) for piece in pieces[:2]])
    both = dense_frequencies(network.select([0, 1, 2, 3, 4, 5, 6]))
    np.testing.assert_allclose(both, np.sort(frequencies), atol=1e-12)
    number = number_pieces(network.i, network.j, network.moving)
    np.testing.assert_array_equal(np.unique(number[:6]), number[[0, 3]])
    with pytest.raises(gp.GranphonError, match=r"4 parts\..*pieces\(\)"):
        gp.Waves(network).transmit(0.1, (1.0, 0.0), 10.0, source=0)
    with pytest.raises(gp.GranphonError, match="no waves run"):
        gp.Waves(pieces[2]).operator  # noqa: B018


@pytest.mark.parametrize("size", [1e-200, 1e-61, 1e61, np.nan, 0.0])
def test_periods_out_of_range_are_told(size):
    packing = gp.Packing(gp.Material(7e10, 0.2, 2500.0), 8e-3, lattice="square")
    network = gp.AveragedLattice(packing).at_force(1.0).network
    with pytest.raises(InputError, match="vector 0 of the cell"):
        replace(network, cell=np.diag([size, size, 0.0]))


def test_walls_and_prestress():
    """A ball that is held from both sides is pushed sideways by fixed balls, with -f/r each, and
    not by flat walls.
    """
    for radius, sideways in ((1.0, -2.0 * 0.3 / 2.0), (np.inf, 0.0)):
        network = make(
            [(0.0, 0.0), (2.0, 0.0), (-2.0, 0.0)],
            [(0, 1), (2, 0)],
            0.3,
            masses=[1.0, np.inf, np.inf],
            prestress=True,
            radii=[1.0, radius, radius],
        )
        np.testing.assert_allclose(
            WaveOperator(network).matrix.toarray(), np.diag([2.0, sideways]), atol=1e-15
        )


def test_turning_a_cluster_as_a_whole_costs_nothing():
    """Balls of any sizes, in any contacts: displacements and rotations of a rigid body deform no
    contact.
    """
    rng = np.random.default_rng(4)
    places = rng.uniform(0.0, 6.0, (30, 3))
    pairs = np.argwhere(np.triu(np.linalg.norm(places[:, None] - places, axis=-1) < 2.4, 1))
    distance = np.linalg.norm(places[pairs[:, 1]] - places[pairs[:, 0]], axis=1)
    part = rng.uniform(0.3, 0.7, len(pairs))
    network = make(
        places,
        pairs,
        slip=0.7,
        dimension=3,
        masses=rng.uniform(0.5, 2.0, 30),
        inertias=rng.uniform(0.1, 0.5, 30),
        arm_i=part * distance,
        arm_j=(1.0 - part) * distance,
        torsion_stiffness=np.full(len(pairs), 0.1),
        bending_stiffness=np.full(len(pairs), 0.2),
    )
    operator = WaveOperator(network)
    for omega, drift in zip(np.eye(3), rng.normal(size=(3, 3)), strict=True):
        motion = np.column_stack([drift + np.cross(omega, places), np.tile(omega, (30, 1))])
        motion *= np.sqrt(np.column_stack([network.masses] * 3 + [network.inertias] * 3))
        np.testing.assert_allclose(operator @ operator.vector(motion), 0.0, atol=1e-12)


@pytest.mark.parametrize("balls", [[0, 0], [-1], [9], [0.5], "01", [[0, 1]], [], [True, False]])
def test_balls_that_cannot_be_selected(balls):
    with pytest.raises(gp.GranphonError):
        with_lattice((3, 3)).select(balls)


# -- what a network cannot be ----------------------------------------------------------------------

NAN = float("nan")
INF = float("inf")


def change(name, place, value):
    """A change of one number of a field."""

    def changed(network):
        values = np.array(getattr(network, name), None if name in ("i", "j", "shift") else float)
        values = values.astype(float) if isinstance(value, float) else values
        values[place] = value
        return {name: values}

    return changed


def listed_twice(network, turned):
    found = {
        name: np.concatenate([getattr(network, name)] * 2)[: network.n_contacts + 1]
        for name in CONTACT_FIELDS
    }
    if turned:
        for name, value in (
            ("i", network.j),
            ("j", network.i),
            ("shift", -network.shift),
            ("normal", -network.normal),
        ):
            found[name][-1] = value[0]
    return found


CONTACT_FIELDS = [
    name
    for name, layout in ContactNetwork._shapes.items()
    if layout.split()[0] == "c" and "?" not in layout
]
BAD = {
    "place": (change("positions", (1, 0), NAN), "ball 1 .* not finite"),
    "radius": (change("radii", 0, -1.0), "ball 0 .* radii .* above zero"),
    "endless radius": (change("radii", 0, INF), "ball 0 .* not finite, but moves"),
    "mass": (change("masses", 3, 0.0), "ball 3 .* masses"),
    "mass nan": (change("masses", 3, NAN), "ball 3 .* masses"),
    "inertia": (change("inertias", 3, INF), "ball 3 .* not finite, but moves"),
    "ball": (change("j", 2, 99), "contact 2 .* not there; balls are 0 to 11"),
    "negative ball": (change("i", 2, -1), "contact 2 .* not there"),
    "part of a ball": (change("i", 2, 1.5), "1.5 .*whole number"),
    "no number of a ball": (change("i", 2, NAN), "nan .*whole number"),
    "huge ball": (lambda _: {"i": [10**30] * 36}, "1e\\+30 where a whole number"),
    "texts": (lambda n: {"i": ["a"] * n.n_contacts}, "i: found"),
    "complex": (lambda n: {"masses": n.masses * 1j}, "complex"),
    "masked": (lambda n: {"masses": np.ma.masked_less(n.masses, 1.0)}, "masked"),
    "masked balls": (lambda n: {"i": np.ma.masked_equal(n.i, 0)}, "masked"),
    "truth values": (lambda n: {"masses": n.masses > 0.0}, "masses: found"),
    "itself": (lambda n: {"j": n.i, "shift": 0 * n.shift}, "joins a ball with itself"),
    "tension": (change("normal_force", 5, -1e-9), "contact 5 .* pull .* between balls"),
    "endless force": (change("normal_force", 5, INF), "contact 5 .* normal_force"),
    "stiffness": (
        change("normal_stiffness", 5, 0.0),
        "contact 5 .* normal_stiffness .*above zero",
    ),
    "shear": (
        change("shear_stiffness", 5, -1.0),
        "contact 5 .* shear_stiffness .*zero or above",
    ),
    "twist": (change("torsion_stiffness", 5, NAN), "contact 5 .* torsion_stiffness"),
    "arm": (change("arm_i", 5, NAN), "contact 5 .* arm_i .*finite"),
    "long arm": (change("arm_i", 5, 1.0), "contact 5 .* sum of the two arms"),
    "normal": (change("normal", 5, [0.6, 0.6, 0.0]), "contact 5 .* length"),
    "normal upwards": (change("normal", 5, [0.0, 0.0, 1.0]), "contact 5 .* leaves the plane"),
    "normal backwards": (
        lambda n: {"normal": -n.normal},
        "contact 0 .* from ball i",
    ),
    "ball above": (change("positions", (4, 2), 1e-4), "not both in the plane"),
    "shift": (change("shift", (5, 2), 1), "contact 5 .* crosses a side"),
    "wrong shift": (change("shift", (5, 0), 7), "contact 5 .* (from ball i|sum of the two arms)"),
    "part of a shift": (change("shift", (5, 0), 0.5), "0.5 where a whole number"),
    "twice": (lambda n: listed_twice(n, False), "contacts 0 and 36 .*same"),
    "from both ends": (lambda n: listed_twice(n, True), "contacts 0 and 36 .*same"),
    "no cell": (lambda n: {"cell": np.zeros((3, 3))}, "vector 0 of the cell .* periodic"),
    "endless cell": (change("cell", (0, 0), INF), "vector 0 of the cell"),
    "flat cell": (lambda n: {"cell": n.cell[[0, 0, 2]]}, "not independent"),
    "tilted cell": (change("cell", (0, 2), 0.01), "leaves the plane"),
    "period across": (
        lambda n: {"cell": np.diag([1.0, 1.0, 1.0]), "pbc": (True,) * 3},
        "leaves the plane",
    ),
    "cell of two": (lambda n: {"cell": n.cell[:2, :2]}, "cell .* shape"),
    "periods": (lambda _: {"pbc": (True, True)}, "three truth values"),
    "period": (lambda _: {"pbc": True}, "three truth values"),
    "words": (lambda _: {"pbc": ("yes", "yes", "no")}, "Did you mean true"),
    "length": (lambda n: {"masses": n.masses[1:]}, "masses .* shape"),
    "one number": (lambda _: {"masses": np.array(1.0)}, "masses .* shape"),
    "length of contacts": (lambda n: {"shift": n.shift[1:]}, "shift .* shape"),
    "flat places": (lambda n: {"positions": n.positions[:, :2]}, "positions .* shape"),
    "motions": (lambda _: {"motions": "sideways"}, "no motions 'sideways'. Use in_plane"),
    "list of motions": (lambda _: {"motions": ["in_plane"]}, "no motions .'in_plane'"),
    "lattice": (lambda _: {"lattice": "triangular"}, "lattice .* is 'triangular'"),
    "shape of no length": (
        lambda _: {"shape": np.array(1.0)},
        "shape: found .*one to three",
    ),
    "shape of a part": (
        lambda _: {"shape": np.array([4.0, 3.5])},
        "shape: found .*two whole numbers",
    ),
    "dimension": (lambda _: {"dimension": 4}, "dimension: found 4"),
    "whole dimension": (lambda _: {"dimension": 2.0}, "dimension: found 2.0"),
    "prestress": (lambda _: {"prestress": "no"}, "prestress"),
    "labels": (lambda _: {"labels": [1] * 12}, "same label"),
    "count": (lambda _: {"left_out": -1}, "left_out"),
    "cells": (lambda _: {"shape": (4, 4)}, "have 16 balls, and the network has 12"),
    "numbers of cells": (lambda _: {"shape": (12,)}, "triangular lattice"),
    "stiff ground": (
        lambda _: {"on_site": np.full((12, 3), 1e61)},
        "ball 0 .* ground .* 1e-60 to 1e.60 in SI",
    ),
    "strong pull": (
        lambda n: {"adhesive": True, "normal_force": np.full(n.n_contacts, -1e61)},
        "contact 0 .* 1e-60 to 1e.60 in SI",
    ),
    "range": (lambda n: {"masses": 1e-300 * n.masses}, "ball 0 .* 1e-60 to 1e.60 in SI"),
}


@pytest.mark.parametrize("name", BAD)
def test_what_a_network_cannot_be(name):
    """Each has one error, which names the ball or contact."""
    network = with_lattice((4, 3))
    wrong, said = BAD[name]
    with pytest.raises(gp.GranphonError, match=said) as error:
        replace(network, **wrong(network))
    assert "\n" not in str(error.value)


ANYTHING = (
    None,
    "",
    "a",
    b"x",
    0,
    -1,
    1.5,
    NAN,
    INF,
    -INF,
    1e308,
    5e-324,
    10**400,
    2**63,
    True,
    1j,
    [],
    (),
    {},
    {1},
    object(),
    int,
    np.array(1.0),
    np.array("x"),
    np.array(None),
    np.zeros(0),
    np.zeros((0, 3)),
    np.zeros((3, 3, 3)),
    np.full((3, 3), INF),
    np.full(12, NAN),
    np.full((36, 3), 1e308),
    np.full((36, 3), -(2**63)),
    np.array([10**400] * 12, object),
    [[1], [1, 2]],
    [None] * 12,
    [[]] * 12,
    [1j] * 36,
    range(3),
    np.ma.masked_array(np.ones(12), np.arange(12) < 3),
    (10**6,) * 3,
    ["all"],
    np.datetime64("2020"),
    np.str_("all"),
    ...,
)


@pytest.mark.parametrize("name", [field.name for field in fields(ContactNetwork)])
def test_anything_in_place_of_a_field_is_taken_or_one_error(name):
    network = with_lattice((4, 3))
    said = list[str]()
    for value in ANYTHING:
        try:
            replace(network, **{name: value})
        except gp.GranphonError as error:
            said.append(str(error))
    assert len(said) > len(ANYTHING) // 2
    assert max(map(len, said)) < 1000


def test_what_a_network_may_be():
    """Left-handed cells, whole numbers as floats, lists, one ball, a wall that touches a ball
    twice.
    """
    network = with_lattice((4, 3))
    mirror = np.array([-1.0, 1.0, 1.0])
    turned = replace(
        network,
        cell=network.cell * mirror,
        positions=network.positions * mirror,
        normal=network.normal * mirror,
    )
    np.testing.assert_allclose(
        dense_frequencies(turned),
        dense_frequencies(network),
        atol=1e-8 * dense_frequencies(network)[-1],
    )
    listed = replace(
        network,
        i=network.i.astype(float),
        masses=network.masses.tolist(),
        pbc=np.array(network.pbc),
    )
    assert listed == network
    alone = network.select([3])
    assert (alone.n_balls, alone.n_contacts, alone.coordination) == (1, 0, 0.0)
    # a file may list walls alone, which have no size to draw or to write
    with pytest.raises(InputError, match="no ball"):
        replace(alone, radii=[np.inf], masses=[np.inf], inertias=[np.inf])
    with pytest.raises(gp.GranphonError, match="no ball"):
        replace(
            alone,
            **{
                name: getattr(alone, name)[:0]
                for name in ("positions", "radii", "masses", "inertias", "labels")
            },
        )
    # a wall, which is one body, has two sides; its place and its arms do not matter
    corner = make(
        [(0.0, 0.0), (50.0, -3.0)], [(0, 1), (0, 1)], masses=[1.0, INF], normal=[[-1.0, 0.0, 0.0], [0.0, -1.0, 0.0]],
        radii=[1.0, INF],
    )  # fmt: skip
    np.testing.assert_allclose(dense_frequencies(corner), [1.0, 1.0])
    with pytest.raises(gp.GranphonError, match="the same"):
        make([(0.0, 0.0), (50.0, -3.0)], [(0, 1), (0, 1)], masses=[1.0, INF])
    # also if a contact with another normal stands between
    turned = replace(corner, normal=np.array([[0.0, -1.0, 0.0], [1.0, 0.0, 0.0]]))
    fields = {
        name: np.concatenate([getattr(corner, name), getattr(turned, name)[:1]])
        for name in corner.contact_fields
    }
    fields["normal"] = np.concatenate([turned.normal, turned.normal[:1]])
    with pytest.raises(gp.GranphonError, match=r"contacts 0 and 2 .* same"):
        replace(turned, **fields)


def test_a_row_of_a_lattice_is_no_array_of_the_lattice():
    """A shape has a length along each period of the lattice; a row repeats along one alone."""
    cell = gp.AveragedLattice(gp.Packing(STEEL, 8e-3)).at_force(1.0).network
    is_in_row = ~np.any(cell.shift[:, 1:], axis=1)
    contacts = {name: getattr(cell, name)[is_in_row] for name in cell.contact_fields}
    row = replace(cell, pbc=(True, False, False), **contacts).repeat((3,))
    assert (row.n_balls, row.lattice, row.shape) == (3, None, None)
    array = cell.repeat((3, 2))
    assert (array.lattice, array.shape) == (cell.lattice, (3, 2))


def test_a_force_that_underflows_makes_no_tangential_force_grow():
    """p/delta of such an overlap would be beyond the range of floats."""
    cell = gp.ContactLattice.of("triangular", 0.8).contact_network(UNITS, 1e-3)
    growths = []
    for force in (0.0, 5e-324, 1e-300, 1e-12):
        forces = np.full(cell.n_contacts, force)
        growths.append(
            replace(cell, normal_force=forces, tangential_law="mindlin").tangential_growth
        )
    assert not np.any(growths[:3])
    np.testing.assert_allclose(growths[3], cell.normal_stiffness / 3.0 / 1e-12)


def test_the_fabric_of_lattices_and_rows():
    """Closed forms: isotropic of a triangle, and of the cubes; n n of a row; a share of each of two
    rows by its force.
    """
    for name, dimension in (("triangular", 2), ("fcc", 3), ("sc", 3)):
        network = gp.ContactLattice.of(name, 0.8).contact_network(UNITS, 1e-3)
        np.testing.assert_allclose(network.fabric, np.eye(dimension) / dimension, atol=1e-15)
        np.testing.assert_allclose(network.force_fabric, network.fabric, atol=1e-15)
    square = gp.ContactLattice.of("square", 0.8).contact_network(UNITS, 1e-3)
    is_along = np.abs(square.normal[:, 0]) > 0.5
    pulled = replace(square, normal_force=np.where(is_along, 3.0, 1.0))
    np.testing.assert_allclose(pulled.fabric, np.eye(2) / 2.0, atol=1e-15)
    np.testing.assert_allclose(pulled.force_fabric, np.diag([0.75, 0.25]), atol=1e-15)
    angle = 0.4
    normal = np.array([[np.cos(angle), np.sin(angle), 0.0]])
    pair = replace(make([(0.0, 0.0), 2.0 * normal[0, :2]], [(0, 1)]), normal_force=np.zeros(1))
    np.testing.assert_allclose(pair.fabric, np.outer(normal[0, :2], normal[0, :2]), atol=1e-15)
    with pytest.raises(InputError, match="force"):
        _ = pair.force_fabric


def test_the_anisotropy_of_an_angular_density_is_that_of_the_fabric():
    """Contacts drawn with the density (1 + a cos 2(theta - theta_0))/2 pi."""
    a, theta_0, n = 0.3, 0.7, 4000
    theta = 2.0 * np.pi * (np.arange(n) + 0.5) / n
    for _ in range(50):  # the inverse of the distribution function
        theta = 2.0 * np.pi * (np.arange(n) + 0.5) / n - 0.5 * a * (
            np.sin(2.0 * (theta - theta_0)) + np.sin(2.0 * theta_0)
        )
    ends = np.column_stack([np.cos(theta), np.sin(theta)]) * 2.0
    star = make([(0.0, 0.0), *map(tuple, ends)], [(0, ball) for ball in range(1, n + 1)])
    sizes, axes = np.linalg.eigh(star.fabric)
    assert 2.0 * (sizes[1] - sizes[0]) == pytest.approx(a, abs=1e-3)
    assert np.arctan2(axes[1, 1], axes[0, 1]) % np.pi == pytest.approx(theta_0, abs=1e-3)
