"""Crystals whose balls differ in diameter, ball by ball, against simulated packings, closed forms
and brute force.
"""

from __future__ import annotations

import itertools
from contextlib import nullcontext

import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal

import granphon as gp
from granphon.base.errors import ConvergenceError, InputError, MechanismError
from granphon.media.arrangement import Arrangement
from granphon.media.state import as_state
from tests.conftest import only

STEEL = gp.Material(young_modulus=211.65e9, poisson_ratio=0.276, density=7840.0)
GLASS = gp.Material(young_modulus=70e9, poisson_ratio=0.22, density=2500.0)
D = 8e-3
WIDTH = 2.04e-6
BALL = gp.Ball(STEEL, D, spread=gp.Uniform(WIDTH))


def square(width):
    """Two kinds, large ones on a square lattice and small ones between."""
    large = gp.Ball(STEEL, D, spread=gp.Uniform(width))
    small = gp.Ball(GLASS, (np.sqrt(2.0) - 1.0) * D, spread=gp.Normal(0.2 * width))
    return gp.Crystal([large, small], np.diag([D, D]), [[0, 0], [0.5 * D, 0.5 * D]])


def by_contact(network):
    """Force of each contact, by its balls and shift."""
    out = {}
    for i, j, shift, force in zip(
        network.i, network.j, network.shift, network.normal_force, strict=True
    ):
        one, other = (int(i), int(j), *map(int, shift)), (int(j), int(i), *map(int, -shift))
        out[min(one, other)] = force
    return out


def test_a_chain_carries_one_force():
    chain = gp.Crystal.on("chain", [BALL]).sample((40,), seed=5)
    state = chain.at_pressure(12.0)
    overlap = gp.Packing(STEEL, D, lattice="chain").law.overlap(12.0)
    assert_allclose(state.overlap, overlap, rtol=1e-12)
    assert_allclose(state.strain[0, 0], -overlap / D, rtol=1e-12)
    assert_allclose(
        gp.sound_velocities(state).longitudinal,
        gp.sound_velocities(
            gp.Crystal.on("chain", [gp.Ball(STEEL, D)]).at_pressure(12.0)
        ).longitudinal,
        rtol=1e-12,
    )


def test_a_sweep_of_a_sample_that_does_not_come_to_rest_says_so(tmp_path):
    wide = gp.Crystal.on("triangular", [gp.Ball(STEEL, D, spread=gp.Uniform(0.1 * D))])
    sample = wide.sample((4, 4), seed=0)
    # the search ends at a state near rest, which is no data set of loads before
    with pytest.raises(ConvergenceError, match="have not come to rest"):
        gp.sweep(sample, force=[1e6], finite_overlap=True, path=tmp_path / "sweep.nc")
    assert not list(tmp_path.iterdir())


def test_a_stress_under_which_contacts_come_to_carry_nothing_is_told():
    diamond = gp.Crystal.on("diamond", [gp.Ball(STEEL, D, spread=gp.Uniform(1e-5))] * 2)
    sample = diamond.sample((3, 3, 3), seed=0)
    stress = -1e5 * np.eye(3)
    stress[0, 1] = stress[1, 0] = 2e4  # a shear, which diamond does not bear without friction
    with pytest.raises(InputError, match="cannot bear the stress"):
        sample.at_stress(stress)


def test_a_stress_under_which_the_cell_deforms_without_end_is_told():
    bcc = gp.Crystal.on("bcc", [gp.Ball(STEEL, D, spread=gp.Uniform(6e-6))])
    # bcc bears no stress whose diagonal is uneven
    for seed in (2, 3):
        with pytest.raises(InputError, match="cannot bear the stress"):
            bcc.sample((2, 1, 1), seed=seed).at_stress(np.diag([-77e3, -57e3, -56e3]))


def test_two_balls_that_differ_come_to_rest_under_a_strain_of_their_own():
    """The two balls of a cell differ, and the sums of their diameters do not."""
    strain = np.array([[-0.014, -0.004], [-0.004, -0.0004]])
    ball = gp.Ball(STEEL, D, spread=gp.Uniform(1e-7))
    two = gp.Crystal.on("honeycomb", [ball] * 2).sample((1, 1), seed=0)
    equal = gp.Crystal.on("honeycomb", [gp.Ball(STEEL, D)] * 2)
    assert_allclose(two.at_strain(strain).overlap, equal.at_strain(strain).overlap, rtol=1e-9)


@pytest.mark.claim("crystal-samples")
@pytest.mark.parametrize("geometry", ["lattice", "exact"])
@pytest.mark.parametrize(
    ("lattice", "shape", "force"),
    [
        ("triangular", (6, 6), 1e3),
        pytest.param("triangular", (8, 8), 10.0, marks=pytest.mark.slow),
        ("triangular", (6, 6), 1.0),
        ("fcc", (3, 3, 3), 2.0),
        ("hcp", (2, 2, 2), 50.0),
    ],
)
def test_one_kind_is_a_simulated_packing(lattice, shape, force, geometry):
    simulation = gp.DirectSimulation(
        gp.Packing(STEEL, D, spread=gp.Uniform(WIDTH), lattice=lattice), shape, 3, geometry=geometry
    ).at_force(force)
    sample = simulation.sample
    exact = geometry == "exact"
    crystal = gp.Crystal.on(lattice, [gp.Ball(STEEL, D, spread=gp.Uniform(WIDTH))]).sample(shape, 3)
    assert_allclose(2.0 * crystal.radii, sample.diameters.ravel(), rtol=1e-15)
    state = crystal.at_strain(-np.eye(len(shape)) * simulation.overlap / D, finite_overlap=exact)
    found = by_contact(state.network)
    wanted = by_contact(sample.network)
    assert found.keys() == wanted.keys()
    # the array is at rest to 1e-10 of the mean force
    assert_allclose(
        [found[key] for key in wanted], list(wanted.values()), rtol=0.0, atol=1e-10 * force
    )
    assert_allclose(np.mean(state.normal_force), force, rtol=1e-12)
    assert_allclose(state.network.arm_i.mean(), sample.network.arm_i.mean(), rtol=1e-14)
    # in the exact geometry the array finds its response by iteration, to 1e-8 and more where loose
    # balls lean on others
    limit = (2e-6 if exact else 1e-11) * np.max(sample.elastic_tensor)
    assert_allclose(as_state(state).elastic_tensor, sample.elastic_tensor, rtol=0.0, atol=limit)
    if exact:
        assert_allclose(
            as_state(state).elastic_tensor,
            as_state(sample.network).elastic_tensor,
            rtol=0.0,
            atol=1e-6 * limit,
        )


@pytest.mark.parametrize("follows", [False, True])
@pytest.mark.parametrize("kind", ["pressure", "force", "overlap"])
def test_kinds_without_spread_are_a_crystal(kind, follows):
    value = {"pressure": 2e4, "force": 20.0, "overlap": 2e-6}[kind]
    plain = gp.Crystal.on("fcc", [gp.Ball(STEEL, D)])
    drawn = gp.Crystal.on("fcc", [gp.Ball(STEEL, D, spread=gp.Uniform(0.0))]).sample((2, 2, 2))
    one, two = (
        getattr(crystal, f"at_{kind}")(value, finite_overlap=follows) for crystal in (plain, drawn)
    )
    assert_allclose(two.normal_force, np.tile(one.normal_force, 8), rtol=1e-12)
    tensor = as_state(one).elastic_tensor
    assert_allclose(as_state(two).elastic_tensor, tensor, rtol=0.0, atol=1e-12 * np.max(tensor))


@pytest.mark.parametrize("follows", [False, True])
def test_a_sample_of_the_mean_diameters_is_a_crystal(follows):
    kinds = square(WIDTH)
    means = np.broadcast_to([ball.diameter for ball in kinds.balls], (3, 3, 2))
    equal = kinds.sample(diameters=means).at_pressure(1e4, finite_overlap=follows)
    bare = gp.Crystal(
        [gp.Ball(STEEL, D), gp.Ball(GLASS, kinds.kinds[1].diameter)], kinds.cell, kinds.positions
    ).at_pressure(1e4, finite_overlap=follows)
    assert_allclose(
        equal.normal_force.reshape(9, -1), np.tile(bare.normal_force, (9, 1)), rtol=1e-12
    )


@pytest.mark.parametrize(
    ("follows", "pressure"),
    only([(False, 300.0), (True, 300.0)], [(False, 300.0), (True, 300.0), (True, 10.0)]),
)
def test_balls_of_two_kinds_are_at_rest_where_all_pairs_of_spheres_push(follows, pressure):
    crystal = square(4e-6).sample((4, 4), seed=2)
    state = crystal.at_pressure(pressure, finite_overlap=follows)
    some_open = np.count_nonzero(state.normal_force == 0.0)
    assert some_open
    n = crystal.n_balls
    diameters = 2.0 * crystal.radii
    for own in (crystal.kind == 0, crystal.kind == 1):
        assert_allclose(
            np.mean(diameters[own]), crystal.balls[np.flatnonzero(own)[0]].diameter, rtol=1e-15
        )
        assert np.ptp(diameters[own]) > 0.0
    cell = crystal.cell @ (np.eye(2) + state.strain)
    places = crystal.positions @ (np.eye(2) + state.strain) + state.displacements
    means = np.array([ball.diameter for ball in crystal.balls])
    modulus = np.array([ball.material.contact_modulus for ball in crystal.balls])
    pull = np.zeros((n, 2))
    virial = np.zeros((2, 2))
    sizes = []
    for i, j in itertools.product(range(n), range(n)):
        for shift in itertools.product((-1, 0, 1), repeat=2):
            rest = crystal.positions[j] + shift @ crystal.cell - crystal.positions[i]
            touch = 0.5 * (means[i] + means[j])
            if not 0.0 < np.linalg.norm(rest) < 1.001 * touch:
                continue
            now = places[j] + shift @ cell - places[i]
            normal = now / np.linalg.norm(now) if follows else rest / touch
            gap = np.linalg.norm(now) if follows else touch + normal @ (now - rest)
            overlap = 0.5 * (diameters[i] + diameters[j]) - gap
            compliance = 0.5 / modulus[i] + 0.5 / modulus[j]
            radius = 0.5 / (1.0 / means[i] + 1.0 / means[j])
            size = 4.0 / 3.0 / compliance * np.sqrt(radius) * max(overlap, 0.0) ** 1.5
            sizes.append(size)
            pull[i] -= size * normal
            virial -= 0.5 * size * np.outer(normal, now if follows else rest)
    mean = np.mean(state.normal_force)
    assert_allclose(np.sort(sizes)[::2], np.sort(state.normal_force), rtol=0.0, atol=1e-9 * mean)
    assert np.max(np.abs(pull)) < 3e-9 * mean  # the rounding of places
    area = np.linalg.det(cell if follows else crystal.cell)
    assert_allclose(virial / area, -pressure * np.eye(2), rtol=0.0, atol=1e-7)


@pytest.mark.claim("crystal-samples")
def test_what_samples_differ_by_goes_as_the_square_of_the_width_at_high_load():
    salt = [gp.Ball(STEEL, D), gp.Ball(GLASS, D)]
    bare = np.mean(gp.Crystal.on("NaCl", salt).at_strain(-1e-3 * np.eye(3)).normal_force)
    means = []
    for width in (0.5e-6, 1e-6, 2e-6):
        kinds = [gp.Ball(ball.material, D, spread=gp.Uniform(width)) for ball in salt]
        each = [
            gp.Crystal.on("NaCl", kinds).sample((2, 2, 2), seed).at_strain(-1e-3 * np.eye(3))
            for seed in range(4)
        ]
        means.append(np.mean([one.normal_force for one in each]) / bare - 1.0)
    assert_allclose(np.log2(np.divide(means[1:], means[:-1])), 2.0, atol=1e-2)


@pytest.mark.parametrize("follows", [False, True])
def test_means_are_over_all_contacts_and_are_met(follows):
    crystal = gp.Crystal.on("triangular", [BALL]).sample((6, 6), seed=1)
    state = crystal.at_force(1.0, finite_overlap=follows)
    assert np.any(state.normal_force == 0.0)
    assert_allclose(np.mean(state.normal_force), 1.0, rtol=1e-11)
    state = crystal.at_overlap(1e-6, finite_overlap=follows)
    assert_allclose(np.mean(state.overlap), 1e-6, rtol=2e-11)


def test_a_mean_overlap_of_balls_that_adhere_is_met_where_contacts_are_open():
    crystal = gp.Crystal.on("triangular", [BALL], law=gp.DMT(0.05)).sample((4, 4), seed=3)
    state = crystal.at_overlap(1e-7)
    assert np.any(state.normal_stiffness == 0.0)
    assert_allclose(np.mean(state.overlap), 1e-7, rtol=2e-11)


def test_a_layer_that_is_held_as_a_whole_comes_to_rest_in_the_true_geometry():
    """No ball moves by itself: the clamp alone moves, and the cell strains."""
    layer = gp.Crystal.on("triangular", [BALL]).sample((4, 4), seed=3)
    layer = layer.cut(1, 1, edges=("floor", "clamped"))
    force = layer.at_force(2.0, finite_overlap=True).normal_force
    assert_allclose(force, layer.at_force(2.0, finite_overlap=False).normal_force, atol=1e-2)


@pytest.mark.parametrize(("lattice", "shape"), [("fcc", (4, 4, 4)), ("hcp", (4, 4, 2))])
def test_a_mean_overlap_is_found_from_far_away(lattice, shape):
    state = gp.Crystal.on(lattice, [BALL]).sample(shape, seed=1).at_overlap(2e-7)
    assert_allclose(np.mean(state.overlap), 2e-7, rtol=2e-11)


@pytest.mark.parametrize(
    ("lattice", "shape", "seed", "kind", "value"),
    [
        ("triangular", (8, 8), 1, "pressure", 3162.28),
        pytest.param("triangular", (8, 8), 1, "overlap", 1e-4 * D, marks=pytest.mark.slow),
        pytest.param("fcc", (4, 4, 4), 2, "pressure", 562e3, marks=pytest.mark.slow),
        pytest.param("triangular", (8, 8), 2, "pressure", 72.0, marks=pytest.mark.exhaustive),
        pytest.param("fcc", (4, 4, 4), 0, "overlap", 1e-4 * D, marks=pytest.mark.exhaustive),
        pytest.param("hcp", (4, 4, 3), 0, "pressure", 1.77828e6, marks=pytest.mark.exhaustive),
        pytest.param("hcp", (4, 4, 3), 1, "overlap", 1e-4 * D, marks=pytest.mark.exhaustive),
    ],
)
def test_wide_spreads_come_to_rest_in_the_true_geometry(lattice, shape, seed, kind, value):
    """Newton's method alone goes round in circles here, or back to a saddle: most contacts of some
    balls are open.
    """
    ball = gp.Ball(gp.Material(193e9, 0.3, 8000.0), D, spread=gp.Uniform(2.5e-3 * D))
    crystal = gp.Crystal.on(lattice, [ball]).sample(shape, seed=seed)
    state = getattr(crystal, f"at_{kind}")(value, finite_overlap=True)
    d = crystal.dimension
    table = crystal.contacts
    mean = np.mean(state.normal_force)
    force = state.normal_force[:, None] * state.normal
    pull = np.zeros((crystal.n_balls, d))
    np.add.at(pull, table.j, force)
    np.add.at(pull, table.i, -force)
    assert np.max(np.abs(pull)) < 1e-12 * mean
    assert np.mean(state.normal_force == 0.0) > 0.1
    pressure = -np.trace(state.stress) / d
    assert_allclose(state.stress, -pressure * np.eye(d), rtol=0.0, atol=1e-12 * pressure)
    found = pressure if kind == "pressure" else np.mean(state.overlap)
    assert_allclose(found, value, rtol=1e-9)


def test_a_sample_of_many_balls_does_not_drift():
    crystal = gp.Crystal.on("triangular", [BALL]).sample((34, 34))
    state = crystal.at_overlap(1e-6)
    i = crystal.contacts.i
    j = crystal.contacts.j
    n = state.normal
    apart = state.displacements[j] - state.displacements[i] + crystal.contacts.vector @ state.strain
    size = crystal.radii[i] + crystal.radii[j] - D - np.sum(n * apart, axis=1)
    assert_allclose(size, state.overlap, rtol=0.0, atol=1e-16)
    assert np.max(np.abs(state.displacements)) < 1e-4


def test_samples_are_those_of_a_seed_and_derive():
    crystal = square(WIDTH)
    one = crystal.sample((5, 4), 7)
    two = crystal.sample((5, 4), 7)
    assert_array_equal(one.radii, two.radii)
    assert np.any(one.radii != crystal.sample((5, 4), 8).radii)
    assert_allclose(
        crystal.sample(diameters=2.0 * one.radii.reshape(5, 4, 2)).radii, one.radii, rtol=1e-15
    )
    assert_array_equal(one.repeat((2, 1)).radii, np.tile(one.radii, 2))
    assert_array_equal(one.remove(1).radii, np.delete(one.radii, 1))
    assert one.replace(0, gp.Ball(GLASS, D)).radii[0] == 0.5 * D
    wall = one.cut(1, 2, edges=("floor", "free"))
    state = wall.at_pressure(100.0)
    assert wall.n_balls == 80
    assert_allclose(-state.stress[0, 0], 100.0 * wall.faces[0].thickness, rtol=1e-10)


def test_what_takes_a_state_takes_that_of_a_sample():
    state = square(WIDTH).sample((3, 3)).at_pressure(1e4)
    assert gp.Phonons(state).frequencies([[0.1, 0.2]]).shape == (1, 54)
    assert gp.sound_velocities(state, direction=(0, 1)).velocities.shape[-1] == 2
    assert gp.moduli(state).tensor.shape == (3, 3)
    assert gp.Waves(state).modes(3).frequencies.shape == (3,)
    assert gp.plot(state)


def cluster():
    """A ball between two others, without a period."""
    return gp.Crystal([BALL] * 3, [], [[0.0], [D], [2.0 * D]])


@pytest.mark.parametrize(
    ("make", "told"),
    [
        (lambda: gp.Ball(STEEL, D, spread=1e-6), "spread is 1e-06"),
        (
            lambda: gp.Ball(STEEL, D, spread=gp.Uniform(3 * D)),
            "diameter of -0.004 m",
        ),
        (lambda: square(WIDTH).at_pressure(1e4), r"drawn.*crystal\.sample"),
        (lambda: square(WIDTH).at_force(1.0), "none are drawn"),
        (
            lambda: gp.Crystal.on("fcc", [gp.Ball(STEEL, D)]).sample((2, 2, 2)),
            "'fcc' .*spread",
        ),
        (lambda: square(WIDTH).sample((2,)), "shape"),
        (lambda: square(WIDTH).sample([[1], [2, 3]]), "shape: found"),
        (
            lambda: gp.DirectSimulation(square(WIDTH), (4, 4)),
            r"drawn by crystal\.sample",
        ),
        (lambda: square(WIDTH).sample((2, 2), -1), "seed"),
        (
            lambda: (
                gp.Crystal.on("honeycomb", [BALL])
                .sample((4, 4), seed=3)
                .at_stress(np.diag([-1e3, -1.2e3]))
            ),
            "cannot bear",
        ),
        (lambda: cluster().sample((2,)), "has no period"),
        (lambda: square(WIDTH).sample((2, 2), diameters=np.full((2, 2, 2), D)), "and no shape"),
        (
            lambda: square(WIDTH).sample(diameters=np.full((2, 2), D)),
            r"Give an array \(L1, L2, 2\)",
        ),
        (lambda: square(WIDTH).sample(diameters=np.full((2, 2, 2), np.nan)), "diameters"),
        (
            lambda: (
                gp.Crystal.on("NaCl", [BALL, gp.Ball(GLASS, D)])
                .sample((2, 2, 2))
                .at_pressure(1e5, finite_overlap=True)
            ),
            "friction.*finite_overlap",
        ),
        (
            lambda: (
                gp.Crystal.on("CsCl", [BALL, gp.Ball(GLASS, D)])
                .sample((3, 3, 3))
                .at_force(0.1, finite_overlap=True)
            ),
            "friction.*finite_overlap",
        ),
    ],
)
def test_what_cannot_be_is_said(make, told):
    with pytest.raises(MechanismError if "friction" in told else InputError, match=told):
        make()


@pytest.mark.claim("crystal-samples")
@pytest.mark.parametrize(
    ("lattice", "stands"), [("sc", False), ("bcc", False), ("fcc", True), ("hcp", True)]
)
def test_samples_stand_in_the_true_geometry_where_a_simulation_does(lattice, stands):
    sample = gp.Crystal.on(lattice, [BALL]).sample((2, 2, 2))
    packing = gp.Packing(STEEL, D, spread=BALL.spread, lattice=lattice)
    for make in (
        lambda: gp.DirectSimulation(packing, (2, 2, 2)),
        lambda: sample.at_pressure(1e6, finite_overlap=True),
    ):
        with (
            nullcontext()
            if stands
            else pytest.raises(MechanismError, match="stand without friction")
        ):
            make()


def test_a_cluster_has_a_sample():
    assert np.ptp(cluster().sample(seed=4).radii) > 0.0


def test_arrangements_of_samples_are_told_apart_by_their_diameters():
    crystal = gp.Crystal.on("triangular", [BALL])
    first, same, other = (Arrangement.of(crystal.sample((2, 2), seed)) for seed in (0, 0, 1))
    assert first == same
    assert hash(first) == hash(same)
    assert first != other
