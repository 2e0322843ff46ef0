"""Ribbons, slabs and flakes that are cut out of a network: closed forms, and a twin that finds the
contacts anew.
"""

from __future__ import annotations

import itertools
from dataclasses import replace

import numpy as np
import pytest
from numpy.testing import assert_allclose

import granphon as gp
from granphon.balls.ball import RIGID_PLANE
from granphon.base.errors import InputError

STEEL = gp.Material(211.65e9, 0.276, 7840.0)
BALL = gp.Ball(STEEL, 8e-3)
D = 8e-3


def bulk(lattice, motions=None, **options):
    packing = gp.Packing(STEEL, D, lattice=lattice, friction=True, motions=motions, **options)
    return gp.AveragedLattice(packing).at_force(10.0).network


def chain(masses, springs):
    """A chain of two balls in the cell: the first spring within the cell, the second to the next
    one, and to a floor.
    """
    network = (
        gp.Crystal.on("chain", [BALL, BALL], law=gp.PowerLaw(1.0, springs[1]))
        .at_force(10.0)
        .network
    )
    crossing = np.any(network.shift != 0, axis=1).astype(int)
    return replace(network, masses=masses, normal_stiffness=np.array(springs)[crossing])


def squares(network, q=(), still=0):
    """Squared angular frequencies of a cut, (n_q, b) at wave vectors; of a flake without the
    ``still`` modes at zero.
    """
    if any(network.pbc):
        return (2.0 * np.pi * gp.Phonons(network).frequencies(q)) ** 2
    return (
        2.0
        * np.pi
        * gp.Waves(network)
        .modes(network.ball_motions.count * int(np.sum(network.moving)) - still)
        .frequencies
    ) ** 2


def twin(network, q):
    """Squared frequencies of equal balls with one shear stiffness, from the energy of each pair
    that touches.
    """
    p = int(np.sum(network.pbc))
    cell = network.cell[:p]
    n = network.n_balls
    half = 0.5 * D
    k = network.normal_stiffness[0]
    kappa = network.shear_stiffness[0]
    mass = network.masses[0]
    inertia = network.inertias[0]
    matrix = np.zeros((6 * n, 6 * n), complex)
    for i, j in itertools.product(range(n), repeat=2):
        for step in itertools.product((-2, -1, 0, 1, 2), repeat=p):
            apart = network.positions[j] + np.array(step) @ cell - network.positions[i]
            if abs(np.linalg.norm(apart) - D) > 1e-6 * D:
                continue
            normal = apart / np.linalg.norm(apart)
            cross = np.array([np.cross(axis, normal) for axis in np.eye(3)]).T  # phi -> phi x n
            across = np.eye(3) - np.outer(normal, normal)
            rows = np.zeros((6, 6 * n), complex)
            phase = np.exp(1j * np.array(q) @ apart[:p])
            rows[:3, 6 * i : 6 * i + 3] -= np.eye(3)
            rows[:3, 6 * j : 6 * j + 3] += np.eye(3) * phase
            rows[3:, 6 * i + 3 : 6 * i + 6] -= half * cross
            rows[3:, 6 * j + 3 : 6 * j + 6] -= half * cross * phase
            slip = across @ rows[:3] + rows[3:]
            matrix += 0.5 * (
                k * np.outer((normal @ rows[:3]).conj(), normal @ rows[:3])
                + kappa * slip.conj().T @ slip
            )
    weight = np.tile(np.repeat([mass, inertia], 3), n) ** -0.5
    return np.linalg.eigvalsh(weight[:, None] * matrix * weight)


# -- closed forms ----------------------------------------------------------------------------------


@pytest.mark.claim("zigzag-edge")
def test_edge_modes_of_a_zigzag_ribbon_at_the_end_of_the_zone():
    ribbon = bulk("honeycomb", "out_of_plane").cut(1, 10)
    # one ball of each rim has two contacts
    assert np.sum(np.bincount(np.concatenate([ribbon.i, ribbon.j])) == 2) == 2
    found = squares(ribbon, [[0.5]])[0] * ribbon.masses[0] / ribbon.shear_stiffness[0]
    # a slip for each contact; the two of each rim that join no other row are at 7, too
    expected = np.concatenate(
        [np.zeros(60 - 29), *([level] * times for level, times in ((6.5, 9), (7.0, 11), (7.5, 9)))]
    )
    assert_allclose(found, expected, atol=1e-12 * 7.5)


@pytest.mark.claim("chain-edge")
@pytest.mark.parametrize("edges", ["floor", "clamped"])
@pytest.mark.parametrize("weak_first", [True, False])
def test_edge_states_of_an_alternating_chain_between_walls(edges, weak_first):
    (weak, strong), mass = (1e6, 3e6), BALL.mass
    held = chain([mass, mass], (weak, strong) if weak_first else (strong, weak)).cut(0, 42, edges)
    middle = np.abs(squares(held) * mass / (weak + strong) - 1.0)
    # each end has a state in the middle of the gap; it decays as 1/3 from cell to cell
    assert np.sum(middle < 1e-12) == (2 if weak_first else 0)
    assert np.sum(middle < 0.4) == (2 if weak_first else 0)


@pytest.mark.claim("chain-edge")
def test_edge_state_of_a_chain_with_a_light_end_ball():
    light = 9.75e-3
    heavy = 28.84e-3
    k = 2e7
    free = chain([light, heavy], (k, k)).cut(0, 41)
    found = squares(free, still=1)
    assert np.min(np.abs(found / (k * (1.0 / light + 1.0 / heavy)) - 1.0)) < 1e-12
    # the other end
    assert (
        np.min(np.abs(squares(chain([heavy, light], (k, k)).cut(0, 41), still=1) / found - 1.0))
        < 1e-9
    )


# -- a twin that shares no code --------------------------------------------------------------------


@pytest.mark.claim("cut-twin")
@pytest.mark.parametrize(
    ("lattice", "axis", "layers"),
    [
        pytest.param("honeycomb", 1, 4, marks=pytest.mark.slow),
        pytest.param("honeycomb", (1, 1), 3, marks=pytest.mark.slow),
        ("square", 0, 5),
        ("square", (1, 1), 4),
        ("triangular", 1, 5),
        ("triangular", (1, 1), 4),
        ("fcc", (1, 1, 0), 4),
        ("fcc", (1, 1, 1), 4),
        ("fcc", (1, 1, 2), 5),
        ("hcp", 2, 3),
        ("sc", 2, 4),
        ("bcc", (1, 2, 0), 4),
    ],
)
def test_bands_of_a_cut_against_the_energy_of_its_pairs(lattice, axis, layers):
    network = bulk(lattice, "all")
    cut = network.cut(axis, layers)
    p = sum(cut.pbc)
    assert p == sum(network.pbc) - 1
    assert_allclose(cut.cell[:p, p:], 0.0, atol=1e-17)
    q = np.array([0.31, 0.17])[:p]
    expected = twin(cut, 2.0 * np.pi * np.linalg.inv(cut.cell[:p, :p]) @ q)
    assert_allclose(squares(cut, [q])[0], expected, atol=1e-12 * expected[-1])


@pytest.mark.parametrize("axis", [(1, 1, 1), pytest.param((1, 1, 2), marks=pytest.mark.slow)])
def test_sites_of_a_cell_that_lie_several_layers_apart(axis):
    # of NaCl's primitive cell, whose second site lies 1.5 and 2 layers above the first
    crystal = gp.Crystal.on("NaCl", [BALL, BALL], friction=True)
    network = crystal.at_force(10.0).network
    cut = network.cut(axis, 5)
    q = np.array([0.31, 0.17])
    expected = twin(cut, 2.0 * np.pi * np.linalg.inv(cut.cell[:2, :2]) @ q)
    assert_allclose(squares(cut, [q])[0], expected, atol=1e-12 * expected[-1])
    heights = cut.positions[:, 2].reshape(5, 2)
    assert np.all(np.ptp(heights, axis=1) < heights[1, 0] - heights[0, 0])
    assert_allclose(
        np.sort(crystal.cut(axis, 5).positions[:, 2]), np.sort(heights.ravel()), atol=1e-12 * D
    )
    # a thick slab has the waves of the half space, twice
    waves = gp.Surface(network, axis).branches([q])
    slab = gp.Phonons(network.cut(axis, 24)).frequencies([q])[0]
    for one in waves.frequencies[waves.weight > 0.5]:
        assert_allclose(slab[np.argsort(np.abs(slab - one))[:2]].mean(), one, rtol=1e-8)


@pytest.mark.parametrize("layers", [3, 9])
def test_balls_that_stick_out_of_a_turned_slab(layers):
    # some motions have coefficients that are nothing but rounding, and some that cost nothing
    aluminium = gp.Ball(gp.Material(73.5e9, 0.33, 2700.0), D)
    slab = (
        gp.Crystal.on("zincblende", [BALL, aluminium], friction=True)
        .at_pressure(1e5)
        .network.cut((1, 1, 0), layers)
    )
    lattice = gp.ContactLattice.from_network(slab)
    q = lattice.wavevectors([[0.3, 0.1]])
    # a zero for each row that is lacking
    rows = np.pad(lattice.compatibility(q)[0], ((0, lattice.n_branches), (0, 0)))
    expected = np.linalg.svd(rows, compute_uv=False)[::-1]
    assert_allclose(lattice.frequencies(q)[0], expected, atol=1e-12 * expected[-1])
    assert_allclose(lattice.modes(q).frequencies[0], expected, atol=1e-12 * expected[-1])
    # one more is small as a wave of one edge that hardly feels the other
    assert 0 < lattice.free_branches <= np.sum(expected < 1e-12)


def test_a_flake_is_cut_along_one_axis_after_the_other():
    slab = bulk("fcc", "all").cut((1, 1, 0), 3)
    bar = slab.cut(0, 4, ("free", "clamped"))
    flake = bar.cut(0, 4)
    assert slab.pbc == (True, True, False)
    assert bar.pbc == (True, False, False)
    assert flake.pbc == (False,) * 3
    assert flake.n_balls == 48
    assert np.count_nonzero(~flake.moving) == 12
    free = bulk("triangular", "all").cut(0, 3).cut(0, 3)
    expected = twin(free, [])
    still = int(np.sum(expected < 1e-10 * expected[-1]))
    assert_allclose(squares(free, still=still), expected[still:], atol=1e-12 * expected[-1])


# -- how edges are held ----------------------------------------------------------------------------


def test_a_clamped_edge_is_that_of_heavy_balls_and_a_floor_bears_what_was_cut():
    network = bulk("triangular")
    free = network.cut(1, 8)
    held = network.cut(1, 8, ("free", "clamped"))
    heavy = replace(
        free,
        masses=np.where(held.moving, free.masses, 1e12 * free.masses[0]),
        inertias=np.where(held.moving, free.inertias, 1e12 * free.inertias[0]),
    )
    top = squares(heavy, [[0.2]])[0][3:]
    assert_allclose(squares(held, [[0.2]])[0], top, rtol=1e-9)
    floor = network.cut(1, 8, "floor")
    walls = np.flatnonzero(np.isinf(floor.radii))
    assert len(walls) == 2
    assert floor.n_contacts == free.n_contacts + 2
    against = floor.normal[np.isin(floor.j, walls)]
    assert_allclose(np.sort(against[:, 1]), [-1.0, 1.0])
    # in balance: the force of the wall is that of the two contacts across the edge
    assert_allclose(floor.normal_force[-1], np.sqrt(3.0) * 10.0, rtol=1e-12)
    # a ball on a rigid plane is half of a contact of two: twice as stiff under the same force, and
    # this has 3^(1/2) of it
    assert_allclose(
        floor.normal_stiffness[-1],
        2.0 * 3.0 ** (1.0 / 6.0) * network.normal_stiffness[0],
        rtol=1e-12,
    )


ALUMINIUM = gp.Ball(gp.Material(73.5e9, 0.33, 2694.0), D)
#: a floor as networks have it: of a crystal with two kinds, in space, of a law that adheres, of a
#: table
FLOORS = {
    "chain": ("chain", 0, [BALL, ALUMINIUM], {}),
    "triangular": ("triangular", 1, [BALL], {"bending": 1e-3}),
    "NaCl": ("NaCl", (1, 1, 0), [BALL, ALUMINIUM], {"torsion": "mindlin"}),
    "fcc": ("fcc", (1, 1, 1), [BALL], {"torsion": 1e-3, "law": gp.DMT(20.0)}),
    "JKR": ("triangular", 1, [BALL], {"law": gp.JKR(20.0)}),
    "pairs": (
        "chain",
        0,
        [BALL],
        {"law": {("A", "A"): gp.Hertz(), ("A", "floor"): gp.PowerLaw(2.0, 1e12)}},
    ),
}
_OF_FLOOR = (
    "normal_force",
    *(f"{name}_stiffness" for name in ("normal", "shear", "torsion", "bending")),
    "arm_i",
    "arm_j",
)


class LinearLaw:
    """A spring that only pushes, as a user would write it."""

    def __init__(self, k):
        self.k = k

    def energy(self, overlap):
        return 0.5 * self.k * np.maximum(overlap, 0.0) ** 2

    def force(self, overlap):
        return self.k * np.maximum(overlap, 0.0)

    def stiffness(self, overlap):
        return self.k * (np.asarray(overlap) > 0.0)

    def stiffness_slope(self, overlap):
        return 0.0 * np.asarray(overlap)

    def overlap(self, force):
        return np.asarray(force) / self.k


def on_floor(network):
    """The fields of the contacts with floors, by ball."""
    of_floor = np.flatnonzero(np.isinf(network.radii[network.j]))
    of_floor = of_floor[np.argsort(network.i[of_floor], kind="stable")]
    return {name: getattr(network, name)[of_floor] for name in _OF_FLOOR}


@pytest.mark.claim("floor")
@pytest.mark.parametrize("name", FLOORS)
def test_a_network_stands_on_the_floor_of_its_crystal(name):
    lattice, axis, kinds, options = FLOORS[name]
    crystal = gp.Crystal.on(lattice, kinds, **options)
    load = {"chain": 20.0, "triangular": 1e3}.get(lattice, 1e5)
    found = on_floor(crystal.at_pressure(load).network.cut(axis, 4, "floor"))
    expected = on_floor(crystal.cut(axis, 4, "floor").at_pressure(load).network)
    for field in _OF_FLOOR:
        assert_allclose(found[field], expected[field], rtol=1e-12, err_msg=field)


def test_another_material_of_a_wall_leaves_other_flat_walls_as_they_are():
    """A rigid floor keeps its stiffness. Without names of kinds it is not told from the wall."""
    network = gp.Crystal.on("square", [BALL]).at_force(10.0).network
    nameless = replace(network, kinds=None)
    soft = gp.Material(1e9, 0.3, 1000.0)
    edges = (gp.Wall(STEEL), "floor")
    cut = network.cut(1, 3, edges)
    is_floor = np.array(cut.kinds)[cut.j] == "floor"
    changed = cut.with_wall(soft).normal_stiffness / cut.normal_stiffness != 1.0
    is_wall = np.isinf(cut.radii[cut.j]) & ~is_floor
    np.testing.assert_array_equal(changed, is_wall)
    with pytest.raises(InputError, match="no kinds"):
        nameless.cut(1, 3, edges).with_wall(soft)
    walls = on_floor(nameless.cut(1, 3, gp.Wall(STEEL)).with_wall(soft))
    assert_allclose(walls["normal_stiffness"], cut.with_wall(soft).normal_stiffness[is_wall][0])


def test_all_balls_of_an_uneven_face_stand_on_the_floor():
    """A row whose outermost points differ by six times the spread of the radii; the row behind it
    has lost no contact.
    """
    network = replace(bulk("triangular").repeat((8, 4)), lattice=None, shape=None)
    column = np.arange(network.n_balls) // 4
    spread = 1e-3 * network.radii[0]
    radii = network.radii + spread * (column % 2)
    heights = 3.0 * spread * np.sin(2.0 * np.pi * column / 8)
    positions = network.positions + heights[:, None] * [0.0, 1.0, 0.0]
    uneven = replace(network, radii=radii, positions=positions)
    for edges in (("floor", "free"), ("free", "floor")):
        even = on_floor(network.cut(1, 1, edges))
        assert len(even["normal_force"]) == 8
        np.testing.assert_array_equal(
            on_floor(uneven.cut(1, 1, edges))["normal_force"], even["normal_force"]
        )


@pytest.mark.parametrize("has_kinds", [True, False])
def test_a_selection_without_a_wall_has_no_wall(has_kinds):
    network = gp.Crystal.on("square", [BALL]).at_force(10.0).network
    network = network if has_kinds else replace(network, kinds=None)
    cut = network.cut(1, 3, (gp.Wall(STEEL), "free"))
    assert cut.select(np.arange(cut.n_balls)).wall == cut.wall
    with pytest.raises(InputError, match="0 walls"):
        _ = cut.select(np.isfinite(cut.radii)).wall


@pytest.mark.claim("floor")
def test_a_ball_on_a_floor_is_that_of_hertz_and_mindlin():
    crystal = gp.Crystal.on("chain", [BALL, ALUMINIUM], motions="all")
    found = on_floor(crystal.at_force(20.0).network.cut(0, 20, "floor"))
    for place, ball in enumerate((BALL, ALUMINIUM)):
        # 1/E* is (1 - nu^2)/E of the ball, and 1/G* (2 - nu)/G
        young = ball.material.young_modulus
        nu = ball.material.poisson_ratio
        k = (6.0 * (young / (1.0 - nu**2)) ** 2 * ball.radius * 20.0) ** (1.0 / 3.0)
        ratio = 4.0 * (1.0 - nu**2) / young * (0.5 * young / (1.0 + nu)) / (2.0 - nu)
        assert_allclose(found["normal_stiffness"][place], k, rtol=1e-13)
        assert_allclose(found["shear_stiffness"][place], ratio * k, rtol=1e-13)


def test_a_floor_of_networks_from_elsewhere(tmp_path):
    """Tables with a material have the floor of their own balls; those without know none, and say
    so.
    """
    radii = np.array([4e-3, 3e-3])
    pressed = gp.Hertz().between(gp.Ball(STEEL, 8e-3), gp.Ball(STEEL, 6e-3)).overlap(10.0)
    balls = {"x": [4e-3, 11e-3 - pressed], "radius": radii}
    contacts = {"i": [0, 1], "j": [1, 0], "shift_1": [0, 1], "normal_force": [10.0, 10.0]}
    network = gp.ContactNetwork.from_table(
        balls, contacts, material=STEEL, cell=[14e-3 - 2.0 * pressed]
    )
    found = on_floor(network.cut(0, 3, "floor"))
    law = [gp.Hertz().between(gp.Ball(STEEL, 2.0 * radius), RIGID_PLANE) for radius in radii]
    overlap = np.array([one.overlap(10.0) for one in law])
    assert_allclose(found["normal_stiffness"], 1.5 * 10.0 / overlap, rtol=1e-12)
    assert_allclose(found["arm_i"] + found["arm_j"], radii - overlap, rtol=1e-12)
    # tables and plain data keep what a network knows of its balls
    crystal = gp.Crystal.on("chain", [BALL, ALUMINIUM], law=gp.JKR(10.0)).at_force(10.0).network
    files = tmp_path / "balls.csv", tmp_path / "contacts.csv"
    for source in (network, crystal):
        source.write_tables(*files)
        for read in (
            gp.ContactNetwork.from_table(*files),
            gp.ContactNetwork.from_dict(source.to_dict()),
        ):
            assert read.contact_model == source.contact_model
            assert on_floor(read.cut(0, 3, "floor"))["normal_stiffness"].tolist() == (
                on_floor(source.cut(0, 3, "floor"))["normal_stiffness"].tolist()
            )
    # Atoms with a calculator, a simulated sample, and the medium of a packing stand on one floor
    packing = gp.Packing(STEEL, D, gp.Uniform(1e-9))
    state = gp.AveragedLattice(packing).at_force(10.0)
    sample = gp.DirectSimulation(packing, shape=(4, 4)).at_force(10.0).sample
    atoms = gp.atoms(state)
    stiffness = [
        on_floor(gp.Waves(one).network.cut(1, 3, "floor"))["normal_stiffness"]
        for one in (state, atoms)
    ]
    assert_allclose(stiffness[0], stiffness[1], rtol=1e-12)
    assert_allclose(
        on_floor(sample.network.cut(1, 2, "floor"))["normal_stiffness"], stiffness[0][0], rtol=1e-2
    )
    # a user's own law gives a floor, which plain data cannot hold
    law = LinearLaw(1e6)
    network_of_law = gp.Crystal.on("chain", [BALL], law=law).at_force(10.0).network
    assert_allclose(
        on_floor(network_of_law.cut(0, 3, "floor"))["normal_stiffness"], 1e6, rtol=1e-12
    )
    assert gp.ContactNetwork.from_dict(network_of_law.to_dict()).contact_model is None
    assert network_of_law.contact_model.law is law
    for lost in ({"contact_model": None}, {"contact_model": crystal.contact_model, "kinds": None}):
        with pytest.raises(InputError, match="material"):
            replace(network, **lost).cut(0, 3, "floor")
    with pytest.raises(InputError, match="load"):
        replace(network, normal_force=np.zeros(2)).cut(0, 3, "floor")


@pytest.mark.parametrize("geometry", ["lattice", "exact"])
def test_a_floor_bears_a_whole_layer_of_balls_that_differ(geometry):
    """Both floors carry the force that crosses the edge of the array; a sample of a crystal has a
    floor as its crystal.
    """
    packing = gp.Packing(STEEL, D, gp.Uniform(2e-6))
    network = (
        gp.DirectSimulation(packing, shape=(12, 12), geometry=geometry)
        .at_force(20.0)
        .sample.network
    )
    crossing = network.shift[:, 1] != 0
    force = np.sum(network.normal_force[crossing] * np.abs(network.normal[crossing, 1]))
    floor = network.cut(1, 1, "floor")
    for wall in np.flatnonzero(np.isinf(floor.radii)):
        assert np.count_nonzero(floor.j == wall) == 12
        assert_allclose(np.sum(floor.normal_force[floor.j == wall]), force, rtol=1e-3)
    sample = gp.Crystal.on("triangular", [replace(BALL, spread=gp.Uniform(2e-6))]).sample((3, 3))
    own = sample.at_force(40.0).network.cut(1, 2, ("floor", "free"))
    cut = sample.cut(1, 2, ("floor", "free")).at_force(40.0).network
    assert set(zip(own.i, own.j, strict=True)) == set(zip(cut.i, cut.j, strict=True))


def test_a_cut_of_a_network_is_turned_as_that_of_its_crystal():
    crystal = gp.Crystal.on("fcc", [BALL])
    for axis in (0, (1, 1, 0), (1, -1, 2)):
        cut = crystal.at_force(10.0).network.cut(axis, 5)
        twin_cut = crystal.cut(axis, 5)
        assert_allclose(cut.positions, twin_cut.positions, atol=1e-15)
        assert_allclose(cut.cell[:2], twin_cut.cell, atol=1e-15)


def test_a_network_whose_periods_lie_anywhere_is_turned():
    network = bulk("square").cut(0, 3)
    upright = replace(
        network,
        cell=network.cell[[1, 0, 2]][:, [1, 0, 2]],
        positions=network.positions[:, [1, 0, 2]],
        pbc=(False, True, False),
        shift=network.shift[:, [1, 0, 2]],
        normal=network.normal[:, [1, 0, 2]],
    )
    a = network.cut(0, 4)
    b = upright.cut(0, 4)
    assert_allclose(squares(a, still=5)[1:], squares(b, still=5)[1:], rtol=1e-9)


# -- bad input -------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("make", "said"),
    [
        (lambda: bulk("square").cut(2, 3), "axis is 2"),
        (lambda: bulk("square").cut(0, 3).cut(1, 3), "axis is 1"),
        (lambda: bulk("square").cut(0, 3).cut(0, 3).cut(0, 3), "no period"),
        (lambda: bulk("fcc").cut((1, 1, 2), 2), "Give 3 layers or more"),
        (lambda: bulk("square").cut(0, 1), "reach across 1 layer"),
        (lambda: bulk("square").cut(0, 2, "clamped"), "no ball moves"),
        (
            lambda: bulk("square").cut(0, 3, "glued"),
            "free, clamped, floor",
        ),
        (lambda: bulk("square").cut(0, 0), "layers"),
        (lambda: bulk("square").cut((0, 0), 3), "2 Miller indices"),
        (lambda: bulk("square").cut((101, 1), 3), "-100 to 100"),
    ],
)
def test_cuts_that_are_not_possible(make, said):
    with pytest.raises(InputError) as caught:
        make()
    assert said in str(caught.value)


def test_a_clamp_that_holds_nothing():
    # a layer of three rows of which contacts reach out of the outer two only: with the lower row of
    # contacts gone, nothing of the clamped layer touches the rest
    network = bulk("square").repeat((1, 3))
    parted = replace(
        network,
        **{
            name: getattr(network, name)[network.shift[:, 1] == 0]
            for name in network.contact_fields
        },
    )
    with pytest.raises(InputError, match="clamped"):
        parted.cut(1, 3, ("clamped", "free"))
    with pytest.raises(InputError, match="falls into pieces"):
        parted.cut(1, 3)


def sum_forces(network):
    """(n, 3) Sums of the static forces on balls, N."""
    force = network.normal_force[:, None] * network.normal + network.tangential_force
    total = np.zeros((network.n_balls, 3))
    np.add.at(total, network.j, force)
    np.add.at(total, network.i, -force)
    return total


def test_floors_bear_the_tangential_forces_of_the_contacts_that_balls_have_lost():
    """So balls that were in balance are in balance on floors."""
    packing = gp.Packing(STEEL, D, spread=gp.Uniform(2e-5))
    simulation = gp.DirectSimulation(
        packing, (6, 5), friction_coefficient=0.3, friction_history=True, geometry="exact"
    )
    network = simulation.at_force(200.0).sample.network
    size = np.max(np.abs(network.tangential_force))
    assert np.max(np.abs(sum_forces(network))) < 1e-6 * size
    cut = network.cut(axis=1, layers=2, edges=("floor", "floor"))
    at_floor = ~cut.moving[cut.j]
    assert np.max(np.abs(cut.tangential_force[at_floor])) > 0.1 * size
    assert np.max(np.abs(sum_forces(cut)[cut.moving])) < 1e-6 * size
    across = np.einsum("ca,ca->c", cut.tangential_force, cut.normal)
    assert np.max(np.abs(across)) < 1e-12 * size
