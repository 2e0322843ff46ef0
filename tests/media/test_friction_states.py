"""Samples that are loaded with friction: their states, moduli, networks, energies, scenes, and what
is refused.
"""

from __future__ import annotations

import functools
import itertools
import json
import math
from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace
from unittest.mock import MagicMock

import ase.io
import numpy as np
import pytest
import yaml

import granphon as gp
from granphon.array.history import LoadingHistory
from granphon.array.options import ReducedLoad
from granphon.array.stencils import Stencils
from granphon.array.stepper import Stepper
from granphon.balls.loads import Load
from granphon.base.errors import ConvergenceError, InputError, MechanismError, SceneError
from granphon.dynamics.elasticity import symmetrise
from granphon.figures.bands import bands_figure
from granphon.figures.curves import describe_lines, sweep_figure
from granphon.media.choice import MediumChoice
from granphon.runs.dataset import list_finite_overlap
from granphon.runs.finished_tasks import Store
from granphon.runs.tasks import MediumTask, SampleRecord
from granphon.scene.redraw import read_run, redraw

STEEL = gp.Material(young_modulus=211.65e9, poisson_ratio=0.276, density=7840.0)
PACKING = gp.Packing(STEEL, diameter=8e-3, spread=gp.Uniform(2.04e-6))
SPACE = gp.Packing(STEEL, diameter=8e-3, spread=gp.Uniform(2.04e-6), lattice="fcc")
W = PACKING.width
ETA = PACKING.mindlin_ratio
UNITS = PACKING.width_units


def simulation(mu=0.2, shape=(6, 6), packing=PACKING, **more):
    given = {
        "friction_history": True,
        "friction_coefficient": mu,
        "step_tolerance": 1e-2,
        "geometry": "lattice",
    } | more
    return gp.DirectSimulation(packing, shape, given.pop("seed", 0), **given)


@functools.cache
def cycle(mu=0.2):
    """The states of a cycle of loads: y = 0.15, 0.3, 0.15, 0.02."""
    return simulation(mu).path(overlap=np.array([0.15, 0.3, 0.15, 0.02]) * W)


@functools.cache
def cube():
    return simulation(shape=(3, 3, 3), packing=SPACE, step_tolerance=1.0).at_overlap(0.2 * W)


# -- the path --------------------------------------------------------------------------------------


def test_states_are_those_of_the_history():
    paths = simulation()
    history = LoadingHistory(paths.deviations(0), Stencils((6, 6), ETA), 0.2, 1e-2)
    for state, known in zip(
        cycle(), history.path(ReducedLoad(overlap=y) for y in (0.15, 0.3, 0.15, 0.02)), strict=True
    ):
        forces = np.moveaxis(known.contacts.forces, 0, -1)
        np.testing.assert_allclose(
            state.sample.contact_forces, UNITS.force * forces, rtol=1e-12, atol=1e-20
        )
        assert state.force == pytest.approx(UNITS.force * known.force, rel=1e-14)
        assert state.work == pytest.approx(UNITS.energy * known.work, rel=1e-14)
        assert state.dissipated_energy == pytest.approx(UNITS.energy * known.dissipated, rel=1e-14)
        assert state.sample.energy == pytest.approx(UNITS.energy * known.stored, rel=1e-12)
        assert state.sliding_fraction == known.sliding_fraction


def test_a_path_keeps_its_order_and_monotonic_loading_sorts():
    overlaps = np.array([0.3, 0.15]) * W
    sorted_ = simulation().at_overlap(overlaps)
    path = simulation().path(overlap=overlaps[::-1])
    assert sorted_.overlap.tolist() == overlaps.tolist()
    assert sorted_.force.tolist() == path.force[::-1].tolist() == cycle().force[1::-1].tolist()
    down = simulation(ordered=True).at_overlap(overlaps)
    assert down.force[1] < sorted_.force[1]  # unloaded from 0.3: sliding back has to be overcome
    assert cycle().force[2] < cycle().force[0]
    assert np.all(np.diff(cycle().dissipated_energy) > 0.0)


def test_forces_and_pressures_are_loads_too():
    force = cycle().force[:2]
    given = simulation(step_tolerance=1e-3).path(force=force)
    np.testing.assert_allclose(given.force, force, rtol=1e-12)
    np.testing.assert_allclose(given.overlap, cycle().overlap[:2], rtol=1e-2)
    pressed = simulation(step_tolerance=1e-3).path(pressure=given.pressure)
    np.testing.assert_allclose(pressed.overlap, given.overlap, rtol=1e-9)


@pytest.mark.parametrize("start", [None, "gas", {"overlap": 0.1e-6}])
def test_equal_balls_give_back_the_work_of_the_load(start):
    equal = gp.DirectSimulation(
        gp.Packing(STEEL, 8e-3),
        (4, 4),
        friction_history=True,
        friction_coefficient=0.2,
        start=start,
    ).path(overlap=[0.3e-6, 0.5e-6, 0.3e-6])
    stored = 0.4 * equal.force * equal.overlap
    assert np.ptp(equal.work[[0, 2]]) == 0.0
    np.testing.assert_allclose(equal.work - equal.work[0], stored - stored[0], rtol=1e-12)
    if not isinstance(start, dict):
        np.testing.assert_allclose(equal.work, stored, rtol=1e-12)
    assert equal.dissipated_energy.tolist() == equal.tangential_ratio.tolist() == [0.0] * 3
    ideal = gp.AveragedLattice(gp.Packing(STEEL, 8e-3)).at_overlap(equal.overlap)
    np.testing.assert_allclose(equal.force, ideal.force, rtol=1e-12)
    np.testing.assert_allclose(gp.moduli(equal).shear, gp.moduli(ideal).shear, rtol=1e-9)


def test_the_start_may_be_a_load():
    rest = gp.DirectSimulation(PACKING, (6, 6), geometry="lattice").at_overlap(0.1 * W)
    for start in (0.6, {"overlap": 0.1 * W}, Load("force", rest.force)):
        begun = simulation(start=start).at_force(rest.force)
        assert begun.overlap == pytest.approx(0.1 * W, rel=1e-9)
        assert (begun.work, begun.tangential_ratio) == pytest.approx((0.0, 0.0), abs=1e-9)
    there, usual = (
        simulation(start=start, step_tolerance=1.0).at_overlap(0.15 * W) for start in (0.6, None)
    )
    assert there.tangential_ratio < usual.tangential_ratio


def test_samples_run_side_by_side_with_the_same_numbers():
    alone = simulation(samples=2).at_overlap(0.1 * W)
    with ThreadPoolExecutor(2) as executor:
        beside = simulation(samples=2, executor=executor).at_overlap(0.1 * W)
    assert beside.force == alone.force
    assert [one.seed for one in beside.samples] == [0, 1]
    assert beside.standard_error("sliding_fraction") > 0.0
    assert alone.standard_error("tangential_ratio") > 0.0
    assert simulation(samples=2).at_overlap(0.1 * W) == alone
    assert simulation(0.3) != simulation(0.2)
    assert hash(simulation()) == hash(simulation())


def test_progress_is_told():
    progress = MagicMock()
    simulation().path(overlap=[0.05 * W, 0.1 * W], progress=progress)
    progress.step.assert_called_once_with("loading with friction", 2)
    assert progress.step.return_value.__enter__.return_value.advance.call_count == 2


# -- forces ----------------------------------------------------------------------------------------


def find_imbalance(network):
    """The largest force on a ball, or torque over the diameter, that the contacts of a network
    leave; N.
    """
    force = network.normal_force[:, None] * network.normal + network.tangential_force
    torque = np.cross(network.normal, network.tangential_force)
    pulls, turns = np.zeros((2, network.n_balls, 3))
    for end, sign, arm in ((network.j, 1.0, network.arm_j), (network.i, -1.0, network.arm_i)):
        np.add.at(pulls, end, sign * force)
        np.add.at(turns, end, -arm[:, None] * torque)
    return max(np.max(np.linalg.norm(part, axis=1)) for part in (pulls, turns / PACKING.diameter))


@pytest.mark.parametrize("find", [lambda: cycle()[1], cube], ids=["triangular", "fcc"])
def test_forces_and_torques_of_the_network_are_in_balance(find):
    state = find()
    network = state.sample.network
    assert np.max(np.abs(network.tangential_force)) > 0.01 * state.force
    assert find_imbalance(network) < 1e-9 * state.force
    assert (
        np.max(np.abs(np.einsum("ca,ca->c", network.normal, network.tangential_force)))
        < 1e-12 * state.force
    )


@pytest.mark.claim("files-balance")
@pytest.mark.parametrize(
    ("find", "mu"),
    [(lambda: cycle()[2], 0.2), (lambda: cycle(math.inf)[1], math.inf), (cube, 0.2)],
    ids=["unloaded", "without a limit", "fcc"],
)
def test_the_forces_in_files_are_those_of_the_state(find, mu, tmp_path):
    sample = find().sample
    paths = (tmp_path / "balls.csv", tmp_path / "contacts.csv")
    sample.network.write_tables(*paths)
    read = gp.ContactNetwork.from_table(*paths, keep_rattlers=True)
    assert find_imbalance(read) < 1e-9 * sample.force
    known = sample.contact_forces > 0.0
    np.testing.assert_array_equal(read.normal_force, sample.contact_forces[known])
    periods = PACKING.structure.periods if find is not cube else 3
    np.testing.assert_array_equal(
        read.tangential_force[:, :periods], sample.tangential_forces[known]
    )
    names = {name for name in type(read)._shapes if getattr(read, name) is not None} - {"labels"}
    assert all(np.array_equal(getattr(read, name), getattr(sample.network, name)) for name in names)
    gp.write_extxyz(tmp_path / "sample.extxyz", sample.atoms())
    balls = ase.io.read(tmp_path / "sample.extxyz")
    assert balls.info["friction_coefficient"] == mu
    np.testing.assert_array_equal(
        balls.arrays["rotations"], sample.rotations.reshape(balls.arrays["rotations"].shape)
    )
    ends = np.concatenate([read.i, read.j])
    sizes = np.linalg.norm(read.tangential_force, axis=1)
    around = (
        np.bincount(ends, np.tile(sizes, 2))
        / len(sample.packing.structure.contacts)
        / 2.0
        / sample.force
    )
    np.testing.assert_allclose(balls.arrays["tangential_force"], around, rtol=1e-9)
    slides = (read.normal_force > 1e-6 * sample.force) & (
        sizes >= mu * read.normal_force * (1.0 - 1e-9)
    )
    assert (
        balls.arrays["sliding_contacts"].tolist() == np.bincount(ends, np.tile(slides, 2)).tolist()
    )
    assert np.any(slides) == (mu < math.inf)


def test_tangential_forces_of_a_table_are_across_the_normal():
    network = cycle()[1].sample.network
    for wrong, why in (
        (network.normal_force[:, None] * network.normal, "not across"),
        (math.nan, "not finite"),
    ):
        with pytest.raises(InputError, match=f"contact 0 .*tangential_force .*{why}"):
            replace(network, tangential_force=network.tangential_force + wrong)


def test_coulombs_limit_holds_and_is_counted():
    sample = cycle()[1].sample
    size = np.linalg.norm(sample.tangential_forces, axis=-1)
    limit = 0.2 * sample.contact_forces
    assert np.all(size <= limit * (1.0 + 1e-12))
    part = np.moveaxis(sample.equilibrium.law.mobilise(sample.equilibrium.contacts), 0, -1)
    np.testing.assert_allclose(part * limit, size, rtol=1e-9, atol=1e-12 * sample.force)
    carried = sample.contact_forces > 1e-6 * sample.force
    assert sample.sliding_fraction == np.mean(size[carried] >= limit[carried] * (1.0 - 1e-9))
    assert 0.0 < sample.sliding_fraction < 0.5
    assert sample.tangential_ratio == pytest.approx(
        np.mean(size) / np.mean(sample.contact_forces), rel=1e-12
    )
    edges, density = sample.mobilisation_distribution(5)
    assert np.sum(density * np.diff(edges)) == pytest.approx(1.0)
    assert sample.rotations.shape == (6, 6)
    assert cube().sample.rotations.shape == (3, 3, 3, 3)


@pytest.mark.parametrize(
    "given", [{}, {"shape": (3, 3, 3), "packing": SPACE}, {"geometry": "exact"}]
)
def test_tangential_over_normal_forces_are_distributed_whatever_the_friction(given):
    states = simulation(math.inf, samples=2, step_tolerance=1.0, start=0.6, **given).at_overlap(
        np.array([0.2, 0.4]) * W
    )
    edges, density, error = states.tangential_ratio_distribution(20, 0.6)
    each = []
    for sample in states.samples:
        normal = sample.contact_forces
        carried = normal > 1e-6 * sample.force
        ratios = (np.linalg.norm(sample.tangential_forces, axis=-1)[carried]) / normal[carried]
        assert np.max(ratios) > 0.05
        each.append(
            [
                np.mean((ratios >= low) & (ratios < high)) / (high - low)
                for low, high in itertools.pairwise(edges)
            ]
        )
    np.testing.assert_allclose(edges, np.linspace(0.0, 0.6, 21), rtol=1e-14)
    np.testing.assert_allclose(
        [one.tangential_ratio_distribution(20, 0.6)[1] for one in states.samples], each, rtol=1e-9
    )
    pairs = np.reshape(each, (2, 2, 20))
    np.testing.assert_allclose(density, pairs.mean(axis=1), rtol=1e-9)
    np.testing.assert_allclose(error, np.abs(pairs[:, 0] - pairs[:, 1]) / 2.0, atol=1e-12)
    with pytest.raises(InputError, match=r"mu is inf.*tangential_ratio"):
        states.mobilisation_distribution()


def test_the_distributions_belong_together_where_friction_is_finite():
    state = cycle()[1]
    edges, density, error = state.tangential_ratio_distribution(10)
    parts = state.mobilisation_distribution(10)
    np.testing.assert_allclose(edges, 0.2 * parts[0], rtol=1e-14)
    np.testing.assert_allclose(0.2 * density, parts[1], rtol=1e-12)
    # those that slide are in the last bin
    assert density[-1] * edges[1] >= state.sliding_fraction > 0.0
    assert np.all(np.isnan(error))  # of one sample
    none = simulation(0.0).at_overlap(0.2 * W)
    edges, density, _ = none.tangential_ratio_distribution(10)
    assert density.tolist() == [pytest.approx(10.0)] + [0.0] * 9
    with pytest.raises(InputError, match="where mu is 0"):
        none.sample.mobilisation_distribution()
    rest = gp.DirectSimulation(PACKING, (6, 6), geometry="lattice").at_overlap(0.2 * W)
    with pytest.raises(InputError, match="friction_history"):
        rest.tangential_ratio_distribution()


# -- the linear response ---------------------------------------------------------------------------


def dense_tensor(network, packing):
    """The elastic tensor of a network in the plane, from a dense matrix of all its springs; Pa."""
    n = network.n_balls
    c = network.n_contacts
    rows = np.zeros((2 * c, 3 * n))
    strained = np.zeros((2 * c, 3))
    for at in range(c):
        (x, y), i, j = network.normal[at, :2], network.i[at], network.j[at]
        length = network.arm_i[at] + network.arm_j[at]
        for row, (e, kappa) in enumerate(
            [((x, y), network.normal_stiffness[at]), ((-y, x), network.shear_stiffness[at])]
        ):
            line = np.zeros(3 * n)
            root = math.sqrt(kappa)
            line[3 * j : 3 * j + 2] += e
            line[3 * i : 3 * i + 2] -= e
            if row:  # lengths of rotations: one arm for each
                line[3 * j + 2] -= network.arm_j[at]
                line[3 * i + 2] -= network.arm_i[at]
            rows[2 * at + row] = root * line
            shear = 0.5 * (e[0] * y + e[1] * x)
            strained[2 * at + row] = root * length * np.array([e[0] * x, e[1] * y, shear])
    left = strained - rows @ np.linalg.lstsq(rows, strained, rcond=1e-12)[0]
    area = np.linalg.det(network.cell[:2, :2])
    return left.T @ left / (area * packing.diameter)


@pytest.mark.parametrize("response", ["slide", "stick", "partial_slip"])
def test_moduli_are_those_of_the_springs_that_each_contact_has(response):
    sample = cycle()[1].sample.respond(response)
    network = sample.network
    np.testing.assert_allclose(
        sample.elastic_tensor, dense_tensor(network, PACKING), rtol=1e-6, atol=1e-7 * 1e9
    )
    ratio = network.shear_stiffness / network.normal_stiffness / ETA
    rest = sample.equilibrium
    part = np.moveaxis(rest.law.mobilise(rest.contacts), 0, -1)[
        rest.stiffnesses.transpose(1, 2, 0) > 0.0
    ]
    held = (part < 1.0 - 1e-9).astype(float)
    wanted = {
        "slide": held,
        "stick": np.ones_like(part),
        "partial_slip": held * np.cbrt(1.0 - part),
    }
    np.testing.assert_allclose(ratio, wanted[response], atol=1e-9)


def test_a_sample_refuses_an_unknown_response():
    sample = cycle()[1].sample
    with pytest.raises(InputError, match="shear_response"):
        sample.respond("stuck")
    with pytest.raises(InputError, match="shear_response"):
        type(sample).from_dict({**sample.to_dict(), "shear_response": "stuck"})


def test_without_friction_the_states_are_those_of_today():
    smooth = gp.DirectSimulation(PACKING, (6, 6), geometry="lattice").at_overlap(0.2 * W)
    none = simulation(0.0, shear_response="slide").at_overlap(0.2 * W)
    # without a limit, all contacts
    assert none.sliding_fraction == none.sample.equilibrium.resume().sliding_fraction == 1.0
    np.testing.assert_allclose(
        none.sample.contact_forces, smooth.sample.contact_forces, atol=1e-7 * smooth.force
    )
    bare = gp.DirectSimulation(replace(PACKING, friction=False), (6, 6)).at_overlap(0.2 * W)
    scale = smooth.elastic_tensor[0, 0]
    np.testing.assert_allclose(none.elastic_tensor, bare.elastic_tensor, atol=1e-6 * scale)
    stuck = none.sample.respond("stick")
    np.testing.assert_allclose(stuck.elastic_tensor, smooth.elastic_tensor, atol=1e-6 * scale)
    assert none.normal_stiffness == pytest.approx(bare.normal_stiffness, rel=1e-6)
    assert (
        smooth.sliding_fraction,
        smooth.work,
        smooth.dissipated_energy,
        smooth.tangential_ratio,
    ) == (None,) * 4


def test_on_a_way_down_the_slope_of_the_path_is_not_the_stiffness():
    """T falls with k where a contact is unloaded, in first order of the step."""
    slopes = {}
    for way in (1.0, -1.0):
        for size in (2e-3, 1e-3):
            states = simulation(math.inf).path(overlap=np.array([0.4, 0.4 + way * size]) * W)
            slopes[way, size] = (
                np.diff(states.force)[0] / (way * size * W) / states.normal_stiffness[0] - 1.0
            )
    up, down = (2.0 * slopes[way, 1e-3] - slopes[way, 2e-3] for way in (1.0, -1.0))
    assert abs(up) < 1e-5
    assert 1e-3 < down < 1e-2


def test_bulk_modulus_is_the_stiffness():
    state = cycle()
    np.testing.assert_allclose(
        gp.moduli(state).bulk, math.sqrt(3.0) / 2.0 * state.normal_stiffness / PACKING.diameter
    )
    assert gp.sound_velocities(state).transverse.shape == (4,)
    assert gp.sound_velocities(cube(), [1, 0, 0]).velocities.shape == (3,)


def test_exponent_is_the_slope_of_the_velocity_along_the_path():
    paths = simulation(math.inf, (8, 8), start=1.1)
    force = paths.at_overlap(0.8 * W).force
    beside = gp.sound_velocities(paths.at_force(force * np.exp([-0.1, 0.0, 0.1]))).longitudinal
    slope = np.log(beside[2] / beside[0]) / 0.2
    assert gp.local_exponent(paths.at_force(force)) == pytest.approx(slope, abs=5e-3)


def test_the_network_keeps_tangential_forces():
    network = cycle()[1].sample.network
    assert type(network).from_dict(json.loads(json.dumps(network.to_dict()))) == network
    twice = network.repeat((2, 1))
    np.testing.assert_array_equal(twice.tangential_force, np.tile(network.tangential_force, (2, 1)))
    assert (twice.lattice, twice.shape) == (None, None)
    some = network.select(np.arange(20))
    assert some.tangential_force.shape == (some.n_contacts, 3)
    assert gp.Waves(cycle()[1].sample).network.tangential_force is not None


def test_records_average_what_states_do():
    simulated = simulation(samples=2).at_overlap(0.1 * W)
    records = [SampleRecord.of(sample) for sample in simulated.samples]
    recorded = gp.SimulatedState.of(simulated.law.simulation, records, Load("overlap", 0.1 * W))
    for name in (
        "sliding_fraction",
        "tangential_ratio",
        "work",
        "dissipated_energy",
        "normal_stiffness",
    ):
        assert getattr(recorded, name) == getattr(simulated, name)


def test_the_limit_of_small_spread_matters_where_contacts_resist_slip():
    """Without springs against slip the shear modulus has no deficit."""
    names = {}
    for mu, response in ((0.0, "slide"), (0.0, "partial_slip"), (0.0, "stick"), (0.2, "slide")):
        balls = simulation(mu, (4, 4), shear_response=response, step_tolerance=1.0)
        state = balls.at_overlap(0.05 * W)
        names[mu, response] = {check.name for check in gp.validity(state).checks}
        springs = state.sample.equilibrium.shear_ratios(response)[
            state.sample.equilibrium.contacts.is_carrying
        ]
        assert balls.resists_slip == bool(np.any(springs)) == ("shear" in names[mu, response])
        record = gp.SimulatedState.of(
            balls, [SampleRecord.of(state.samples[0])], Load("overlap", 0.05 * W)
        )
        assert gp.validity(record).warnings == gp.validity(state).warnings
    assert [found for found in names if "shear" in names[found]] == [(0.0, "stick"), (0.2, "slide")]


def test_without_springs_against_slip_the_shear_modulus_is_that_without_friction():
    smooth = replace(PACKING, friction=False)
    exact = gp.DirectSimulation(smooth, (6, 6), geometry="exact").at_overlap(0.05 * W)
    slid = simulation(0.0, step_tolerance=1e-3, shear_response="slide").at_overlap(0.05 * W)
    assert gp.moduli(slid).shear == pytest.approx(gp.moduli(exact).shear, rel=1e-2)


# -- the exact geometry, and other starts ----------------------------------------------------------


@functools.cache
def exact(width=2.04e-6, reduced=0.2, **more):
    packing = gp.Packing(STEEL, diameter=8e-3, spread=gp.Uniform(width))
    return gp.DirectSimulation(packing, (6, 6), geometry="exact", **more).at_overlap(
        reduced * width
    )


@pytest.mark.parametrize(
    "given", [{}, {"friction_history": True, "friction_coefficient": 0.2, "step_tolerance": 1e-2}]
)
def test_the_exact_geometry_is_in_balance_with_its_own_directions(given):
    state = exact(8e-5, 0.2, **given)
    network = state.sample.network
    whole = network if given else replace(network, tangential_force=np.zeros_like(network.normal))
    assert find_imbalance(whole) < 1e-9 * state.force
    np.testing.assert_allclose(network.distance, network.arm_i + network.arm_j, rtol=1e-12)
    np.testing.assert_allclose(
        network.normal, network.vector / network.distance[:, None], atol=1e-12
    )
    overlap = network.radii[network.i] + network.radii[network.j] - network.distance
    np.testing.assert_allclose(PACKING.law.force(overlap), network.normal_force, rtol=1e-6)
    assert network.prestress
    assert (state.finite_overlap, gp.moduli(state).bulk > 0.0) == (True, True)
    assert type(state).from_dict(json.loads(json.dumps(state.to_dict()))) == state


def test_slow_pulses_have_the_speed_of_long_waves_in_the_exact_geometry():
    state = exact.__wrapped__(1.6e-4, np.array([0.5, 2.0]))
    long = state.long_waves((0.0, 1.0))[:, :1].T
    pulses = gp.pulse_velocities(state, 1.0, (0.0, 1.0), branches="longitudinal")
    np.testing.assert_allclose(pulses.group, long, rtol=1e-9)
    # frequencies in front of the loads: each frequency of each load is that of one state
    many = gp.pulse_velocities(state, [[1e3], [3e4]], (0.0, 1.0), branches="longitudinal").group
    for place in (0, 1):
        one = gp.pulse_velocities(
            state[place], [1e3, 3e4], (0.0, 1.0), branches="longitudinal"
        ).group
        np.testing.assert_allclose(many[0, :, place], one[0], rtol=1e-12)


def test_the_exact_geometry_tends_to_the_lattice():
    forces = [exact(width).reduced_force for width in (2.04e-5, 2.04e-6, 2.04e-7)]
    limit = gp.DirectSimulation(PACKING, (6, 6), geometry="lattice").at_overlap(0.2 * W)
    errors = np.abs(np.array(forces) - limit.reduced_force)
    assert errors[0] > errors[1] > errors[2]
    assert errors[2] < 1e-5 * limit.reduced_force
    # from a start at which all contacts are closed: places of loose balls differ, however small the
    # width
    given = {
        "friction_coefficient": math.inf,
        "start": 1.1,
        "friction_history": True,
        "step_tolerance": 1e-2,
    }
    near = exact(2.04e-7, 0.8, **given)
    known = simulation(math.inf, start=1.1).at_overlap(0.8 * W)
    assert near.reduced_force == pytest.approx(known.reduced_force, rel=1e-5)
    scale = 0.1**0.5  # moduli go as the root of the width
    tensor = scale * known.elastic_tensor
    np.testing.assert_allclose(near.elastic_tensor, tensor, atol=1e-3 * tensor[0, 0])


def test_lattices_that_only_friction_holds_start_from_the_gas():
    square = gp.Packing(STEEL, 8e-3, gp.Uniform(2.04e-6), lattice="square")
    state = simulation(0.5, (3, 3), square, start="gas").at_overlap(0.4 * W)
    assert state.contact_fraction > 0.5
    assert state.tangential_ratio > 0.0
    assert gp.moduli(state).tensor[2, 2] > 0.0


@pytest.mark.exhaustive
@pytest.mark.parametrize(
    ("lattice", "shape"), [("kagome", (5, 5)), ("sc", (3, 3, 3)), ("bcc", (3, 3, 3))]
)
def test_at_high_load_such_lattices_respond_as_that_of_equal_balls(lattice, shape):
    """What the differences of the balls change goes with their square, over that of the overlap."""
    packing, loads = (
        gp.Packing(STEEL, 8e-3, gp.Uniform(2.04e-6), lattice=lattice),
        np.array([3.0, 6.0]) * W,
    )
    state = simulation(0.5, shape, packing, start="gas", shear_response="stick").path(overlap=loads)
    equal = gp.moduli(gp.AveragedLattice(packing).at_overlap(loads)).tensor
    apart = (
        np.max(np.abs(symmetrise(state.elastic_tensor, packing.structure) - equal), axis=(-2, -1))
        / equal[:, 0, 0]
    )
    assert apart[1] < 2e-4
    assert apart[0] / apart[1] == pytest.approx(4.0, rel=0.1)


# -- what cannot be done ---------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("given", "why"),
    [
        (
            {"friction_coefficient": -0.1},
            "friction_coefficient: .*-0.1.* inf",
        ),
        ({"friction_coefficient": None}, "friction_coefficient: found no"),
        ({"friction_history": False}, "without friction_history"),
        (
            {"friction_history": False, "friction_coefficient": None, "start": 0.6},
            "start: .*0.6.* friction_history",
        ),
        ({"start": "half"}, "start: .*'half'.* spacing"),
        ({"start": {"force": -1.0}}, "start.force: .*-1.0.* SI"),
        (
            {"shear_response": "glue"},
            "shear_response: .*'glue'.* partial_slip",
        ),
        ({"geometry": "curved"}, "geometry: .*'curved'.* lattice, exact"),
        (
            {"geometry": "exact", "packing": gp.Packing(STEEL, 8e-3)},
            "exact .*equal",
        ),
        ({"start": "liquid"}, "start: .*'liquid'.* gas"),
    ],
)
def test_bad_options(given, why):
    with pytest.raises(InputError, match=why):
        simulation(**{"mu": given.pop("friction_coefficient", 0.2), **given})


@pytest.mark.parametrize(
    ("start", "why"),
    [
        (
            {"force": [1.0, 2.0]},
            r"start.force: .*\[1.0, 2.0\].* one load",
        ),
        ({"force": []}, r"start.force: .*\[\].* one"),
        ({}, "start: .*empty.* {force"),
        ({"force": 1.0, "overlap": 1e-7}, "start: .*force and overlap.* one"),
        (
            {"overlap": 1e-2},
            "start .*0.01 m .*1.25 diameters",
        ),
        ({"overlap": -1e-2}, "start .*-0.01 m.* touch"),
        (1e6, "start .*together"),
        ({"force": 1e-9}, r"start .*f\* = .* 1e-08"),
    ],
)
def test_a_start_that_no_sample_bears_is_refused_at_once(start, why):
    with pytest.raises(InputError, match=why):
        simulation(start=start)


def test_a_start_of_a_sweep_is_in_si_or_has_its_unit():
    forces = []
    for start in ({"force": 0.5}, {"force": "0.5 N"}, Load("force", 0.5)):
        given = {
            "friction_history": True,
            "friction_coefficient": 0.2,
            "step_tolerance": 1.0,
            "start": start,
        }
        found = gp.sweep(
            PACKING, overlap=[0.2 * W], media=[{"simulation": {"shape": (4, 4), **given}}]
        )
        forces.append(float(found["force"].squeeze()))
    alone = simulation(shape=(4, 4), step_tolerance=1.0, start={"force": 0.5}, geometry=None)
    assert forces == [alone.at_overlap(0.2 * W).force] * 3


@pytest.mark.parametrize(
    ("packing", "shape", "why"),
    [
        (
            gp.Packing(STEEL, 8e-3, gp.Uniform(2e-6), friction=False),
            (4, 4),
            "with friction",
        ),
        (
            gp.Packing(STEEL, 8e-3, gp.Uniform(2e-6), lattice="chain"),
            (8,),
            "chain .*friction_history",
        ),
        (
            gp.Packing(STEEL, 8e-3, gp.Uniform(2e-6), lattice="square"),
            (4, 4),
            "without friction",
        ),
    ],
)
def test_packings_without_a_history(packing, shape, why):
    with pytest.raises(InputError, match=why):
        simulation(shape=shape, packing=packing)


def test_lattices_that_do_not_stand_are_told_what_simulates_them():
    def refuse(lattice, friction=True, **more):
        packing = gp.Packing(STEEL, 8e-3, gp.Uniform(2e-6), lattice=lattice, friction=friction)
        with pytest.raises(MechanismError, match=f"{lattice} lattice") as error:
            gp.DirectSimulation(packing, (4,) * packing.structure.periods, **more)
        return str(error.value)

    for lattice in ("square", "kagome", "sc"):
        remedy = refuse(lattice)
        assert "friction_history: true" in remedy
        assert "start: gas" in remedy
    assert "friction: true" in refuse("square", friction=False)
    history = {"friction_history": True, "friction_coefficient": 0.2}
    assert "start: gas" in refuse("square", **history)
    without = refuse("square", friction_history=True, friction_coefficient=0.0, start="gas")
    assert "friction_coefficient above zero" in without
    assert "either" in refuse("honeycomb")
    assert "gas" not in refuse("honeycomb", **history)


def test_a_start_below_the_threshold_is_named():
    with pytest.raises(InputError, match=r"threshold.* -0\.2 widths"):
        simulation(start=0.3).at_overlap(0.1 * W)


@pytest.mark.parametrize("kind", ["overlap", "force"])
def test_a_load_below_the_start_is_named(kind):
    loads = {"overlap": [0.1 * W, -0.02 * W], "force": [0.5, 0.01]}[kind]
    for start in (None, 0.5, {kind: {"overlap": 0.0, "force": 0.2}[kind]}):
        with pytest.raises(InputError, match=r"start .*(a\* = |N)") as error:
            getattr(simulation(start=start), f"at_{kind}")(loads)
        assert error.value.load_index == 1


def test_a_load_below_a_start_of_its_kind_is_refused_when_a_scene_is_read():
    for load, start in (
        ("overlap: -0.3 um", ""),
        ("force: 1 N", "start: {force: 1.5 N}"),
        ("overlap: 0.1 um", "start: 0.7"),
    ):
        with pytest.raises(SceneError, match=r":5: load.* start"):
            scene(load=f"{{{load}}}", medium=options(*HISTORY, *[start] * bool(start)))
    with pytest.raises(SceneError, match=r":5: load.force.1: .*'1 N'.* start"):
        scene(load="{force: [2 N, 1 N]}", medium=options(*HISTORY, "start: {force: 1.5 N}"))
    swept = scene(
        load="{force: [2 N, 1 N]}",
        medium=options(*HISTORY, "ordered: true", "start: {force: 1.5 N}"),
    ).swept
    assert swept


@pytest.mark.parametrize(
    ("load", "start", "where"),
    [
        (
            "{overlap: [0.4 um, 0.1 um]}",
            "geometry: lattice, start: {force: 1.5 N}",
            r":5: load.overlap.1: .* start .* 1\.5 N",
        ),
        (
            "{force: 0.4 N}",
            "",
            r":5: load.force: .*'0.4 N'.* start .*a\* = 0.5\.",
        ),
        (
            "{force: 0.4 N}",
            "geometry: exact",
            ":5: load.force: .*'0.4 N'.* start",
        ),
        (
            "{force: 0.4 N}",
            "start: 0.345",
            ":6: medium.simulation.start: .*0.345.* threshold",
        ),
    ],
)
def test_a_load_below_a_start_of_another_kind_is_refused_when_a_scene_is_read(load, start, where):
    given = options(*HISTORY, "samples: 2", *[start] * bool(start))
    with pytest.raises(SceneError, match=where):
        scene(load=load, medium=given)
    scene(load=load, medium=given.replace("{simulation: {", "{simulation: {ordered: true, "))
    scene(load=load, medium=given.replace("shape: 4 4", "shape: 200 200"))  # that would take long


def test_a_path_that_cannot_go_on_keeps_what_there_is(monkeypatch):
    end_at(monkeypatch, 0.0)
    loads = np.array([0.05, 0.1, -0.3]) * W
    with pytest.raises(ConvergenceError, match="falls apart") as error:
        simulation(step_tolerance=1.0).path(overlap=loads)
    assert error.value.load_index == 2
    assert error.value.reached.overlap.tolist() == loads[:2].tolist()
    assert gp.moduli(error.value.reached).bulk.shape == (2,)
    with pytest.raises(ConvergenceError) as error:
        simulation(step_tolerance=1.0).path(overlap=loads[2:])
    assert error.value.reached is None


@pytest.mark.parametrize(
    ("given", "why"),
    [
        ({}, "there is no load"),
        ({"force": [1.0], "overlap": [1e-7]}, "force and overlap"),
        ({"force": [1.0, -1.0]}, "tensile"),
    ],
)
def test_bad_paths(given, why):
    with pytest.raises(InputError, match=why):
        simulation().path(**given)


def test_a_path_is_given_by_keyword_or_as_a_load():
    forces = [2.0, 1.0]
    balls = simulation(shape=(4, 4), step_tolerance=1.0)
    known = balls.path(force=forces)
    assert balls.path(Load("force", forces)) == known
    frame = Load("side_force", np.array(forces) * 31 * math.sqrt(3.0), 31)
    np.testing.assert_allclose(balls.path(frame).overlap, known.overlap, rtol=1e-10)
    for given in (forces, np.array(forces), 2.0, "up"):
        with pytest.raises(InputError, match=r"path .*force=.*overlap="):
            balls.path(given)
    with pytest.raises(InputError, match="Load and as overlap"):
        balls.path(Load("force", forces), overlap=[0.1 * W])


def test_what_a_history_does_not_have():
    with pytest.raises(InputError, match="friction_history"):
        gp.DirectSimulation(PACKING, (4, 4)).path(force=[1.0])
    with pytest.raises(InputError, match="finite overlap"):
        simulation().at_overlap(0.1 * W, finite_overlap=True)
    with pytest.raises(InputError, match=r"exact .*overlap"):
        simulation(geometry="exact").at_overlap(0.1 * W, finite_overlap=False)
    state = cycle()[1]
    with pytest.raises(InputError, match="loaded with friction"):
        gp.HertzMindlin(state).calculate(state.sample.atoms())


# -- scenes, sweeps, fits --------------------------------------------------------------------------

SCENE = """
schema: 1
material: {young_modulus: 211.65 GPa, poisson_ratio: 0.276, density: 7840 kg/m^3}
packing: {diameter: 8 mm, spread: {uniform: 2.04 um}}
load: {force: 2 N}
medium: {simulation: {shape: 4 4, friction_history: true, friction_coefficient: 0.2, step_tolerance: 1.0}}
"""


def scene(**more):
    text = SCENE
    for old, new in more.items():
        text = text.replace(
            {"load": "{force: 2 N}", "medium": text.split("medium: ")[1].strip()}[old], new
        )
    return gp.Scene.from_text(text)


def options(*more):
    return "{simulation: {" + ", ".join(["shape: 4 4", "step_tolerance: 1.0", *more]) + "}}"


HISTORY = ("friction_history: true", "friction_coefficient: 0.2")


def test_a_scene_and_its_resolved_form_are_the_simulation(tmp_path):
    given = scene(medium=options(*HISTORY, "start: {force: 0.4 N}", "shear_response: stick"))
    given.run(tmp_path / "out", figures=False)
    again = gp.Scene.from_yaml(tmp_path / "out" / "scene.yaml")
    assert again == given
    medium = gp.DirectSimulation(
        PACKING,
        (4, 4),
        friction_history=True,
        friction_coefficient=0.2,
        step_tolerance=1.0,
        start={"force": 0.4},
        shear_response="stick",
    )
    state = medium.at_force(2.0)
    tables = [tmp_path / "out" / name for name in ("sample_balls.csv", "sample_contacts.csv")]
    read = gp.ContactNetwork.from_table(*tables, keep_rattlers=True)
    np.testing.assert_array_equal(read.tangential_force, state.sample.network.tangential_force)
    summary = yaml.safe_load((tmp_path / "out" / "summary.yaml").read_text())
    for name in (
        "sliding_fraction",
        "tangential_ratio",
        "work",
        "dissipated_energy",
        "overlap",
        "normal_stiffness",
    ):
        assert summary[name] == getattr(state, name)
    assert {name: summary["units"][name] for name in ("work", "tangential_ratio")} == {
        "work": "J",
        "tangential_ratio": "1",
    }
    assert summary["longitudinal"] == gp.sound_velocities(state).longitudinal


def test_the_default_start_is_written_out():
    given = scene(medium=options(*HISTORY))
    assert yaml.safe_load(given.to_yaml())["medium"]["simulation"]["start"] == 0.5
    assert gp.Scene.from_text(given.to_yaml()) == given


def test_a_scene_has_finite_overlap_in_the_exact_geometry_alone():
    text = SCENE.replace("2.04 um}", "2.04 um}, finite_overlap: true")
    for geometry in ("", "geometry: exact, "):
        given = gp.Scene.from_text(
            text.replace("friction_history: true", f"{geometry}friction_history: true")
        )
        assert given.state().finite_overlap
    with pytest.raises(InputError, match="finite overlap"):
        gp.Scene.from_text(
            text.replace("friction_history: true", "geometry: lattice, friction_history: true")
        )


WIDE = (
    SCENE.replace("2.04 um", "100 um")
    .replace("2 N", "300 N")
    .replace("{shape: 4 4", "{geometry: exact, shape: 4 4")
)


def test_a_run_in_the_exact_geometry_says_that_overlap_is_finite(tmp_path):
    given = gp.Scene.from_text(WIDE)
    result = given.run(tmp_path / "out", figures=False)
    assert result.state.finite_overlap
    assert yaml.safe_load((tmp_path / "out" / "summary.yaml").read_text())["finite_overlap"] is True
    resolved = gp.Scene.from_yaml(tmp_path / "out" / "scene.yaml")
    assert resolved == replace(given, source=resolved.source)
    assert not resolved.finite_overlap  # which nobody asked for
    (facts, _), *_ = describe_lines(read_run(tmp_path / "out").dataset, "force")
    assert facts["overlap"].startswith("with terms")


@pytest.mark.slow
def test_bands_in_the_exact_geometry_are_drawn_with_their_own_sound(tmp_path, monkeypatch):
    given = gp.Scene.from_text(WIDE + "observe: [velocities, bands]\nphonopy: {band_points: 3}\n")
    result = given.run(tmp_path / "out", figures=False)
    known = result.state.contact_lattice()
    drawn = []

    def draw(*found, asymptotes, **given):
        drawn.append(asymptotes)
        return bands_figure(*found, asymptotes=asymptotes, **given)

    monkeypatch.setattr("granphon.figures.bands.bands_figure", draw)
    redraw(tmp_path / "out", tmp_path / "x.png", asymptotes=True)
    assert drawn[0].sound_velocities((1.0, 0.0))[0] == pytest.approx(
        known.sound_velocities((1.0, 0.0))[0], rel=1e-12
    )


def test_a_sweep_says_which_media_have_finite_overlap(tmp_path):
    swept = gp.Scene.from_text(WIDE.replace("300 N", "[200 N, 300 N]")).run(
        tmp_path / "out", figures=False
    )
    assert (swept.dataset.attrs["finite_overlap"], "exponent" in swept.dataset.attrs) == (1, False)
    assert yaml.safe_load((tmp_path / "out" / "summary.yaml").read_text())["finite_overlap"] is True


def test_a_sweep_of_several_media_says_which_have_finite_overlap(tmp_path):
    mixed = gp.Scene.from_text(
        WIDE.replace("medium: {", "medium: [ema, {").replace("1.0}}", "1.0}}]")
    )
    assert not mixed.finite_overlap
    found = replace(mixed, load=Load("force", [300.0])).run(tmp_path / "mixed", figures=False)
    assert found.dataset.attrs["finite_overlap"] == 0
    summary = yaml.safe_load((tmp_path / "mixed" / "summary.yaml").read_text())
    assert summary["finite_overlap"] == [False, True]
    lines = [facts["overlap"] for facts, _ in describe_lines(found.dataset, "longitudinal")]
    assert [line.split()[0] for line in lines] == ["without", "with"]
    every = replace(mixed, load=Load("force", [300.0]), finite_overlap=True).sweep()
    assert (every.attrs["finite_overlap"], "exponent" in every.attrs) == (1, True)


@pytest.mark.parametrize("width", ["0 um", "2 mm"])  # equal balls, and W/d above a fifth
def test_balls_that_cannot_be_exact_have_no_finite_overlap_in_a_history(width):
    text = SCENE.replace("2.04 um", width).replace("2 N", "[20 kN, 30 kN]")
    given = gp.Scene.from_text(text.replace("shape: 3 3", "shape: 4 4"))
    swept = given.sweep()
    assert not given.media[0].of(given.packing).at(given.load[0]).finite_overlap
    assert swept.attrs["finite_overlap"] == 0
    assert list_finite_overlap(swept) == [False]


def test_a_sweep_says_of_a_geometry_that_the_load_decides_what_its_states_say():
    forces = [0.02, 2000.0]
    media = [{"simulation": {"shape": (4, 4)}}, "ala"]
    swept = gp.sweep(PACKING, force=forces, media=media)
    alone = gp.DirectSimulation(PACKING, shape=(4, 4))
    assert [alone.at_force(force).finite_overlap for force in forces] == [True, False]
    assert swept.attrs["finite_overlap"] == 0
    assert list_finite_overlap(swept) == [None, False]
    assert list_finite_overlap(gp.sweep(PACKING, force=forces[0], media=media)) == [True, False]
    assert list_finite_overlap(swept.isel(medium=[1])) == [False]
    asked = gp.sweep(PACKING, force=forces, media=media, finite_overlap=True)
    assert (asked.attrs["finite_overlap"], list_finite_overlap(asked)) == (1, [True, True])


def test_a_sweep_is_loaded_as_its_scene_says():
    loads = "{force: [3 N, 1.5 N]}"
    path = scene(load=loads, medium=options(*HISTORY, "ordered: true")).sweep()
    loaded, state = (
        find(simulation(shape=(4, 4), step_tolerance=1.0, geometry=None))
        for find in (lambda one: one.at_force([3.0, 1.5]), lambda one: one.path(force=[3.0, 1.5]))
    )
    np.testing.assert_array_equal(path["overlap"].values.ravel(), state.overlap)
    np.testing.assert_array_equal(path["sliding_fraction"].values.ravel(), state.sliding_fraction)
    np.testing.assert_array_equal(path["bulk"].values.ravel(), gp.moduli(state).bulk)
    assert path["dissipated_energy"].attrs["units"] == "J"
    # balls that are unloaded stay nearer
    assert path["overlap"].values.ravel()[1] > loaded.overlap[1]


def end_at(monkeypatch, overlap):
    """Let each step of a loading to less than this overlap (W) fail."""
    step = Stepper.step

    def fail(self, trail, load, *more):
        if load.overlap is not None and load.overlap < overlap:
            raise self.explain(load, "it falls apart")
        return step(self, trail, load, *more)

    monkeypatch.setattr(Stepper, "step", fail)


@pytest.mark.parametrize(
    ("geometry", "mend"),
    [
        ("lattice", "seed"),
        pytest.param("exact", 'geometry "lattice"', marks=pytest.mark.slow),
    ],
)
def test_errors_of_arrays_from_the_gas_advise_no_other_start(monkeypatch, geometry, mend):
    square = replace(PACKING, lattice="square")
    pressed = simulation(0.5, (3, 3), square, start="gas", geometry=geometry)
    with pytest.raises(InputError, match=r"gas.* path"):
        pressed.at_overlap(-0.3 * W)
    end_at(monkeypatch, 0.01)
    with pytest.raises(ConvergenceError, match=f"gas.* balance .*{mend}"):
        pressed.at_overlap(0.4 * W)


@pytest.mark.slow
@pytest.mark.parametrize("samples", [1, pytest.param(2, marks=pytest.mark.slow)])
def test_a_path_that_ends_early_keeps_the_loads_before(tmp_path, monkeypatch, samples):
    out = tmp_path / "out"
    loads = "{overlap: [0.05 um, 0.1 um, 0.01 um, 0.08 um]}"
    medium = options(*HISTORY, "ordered: true", f"samples: {samples}")
    end_at(monkeypatch, 0.01)
    with pytest.raises(
        ConvergenceError, match=r":5: load.overlap.2: .*'0.01 um'.* 2 loads"
    ) as caught:
        scene(load=loads, medium=medium).run(out, figures=False)
    assert sorted(one.name for one in out.iterdir()) == [
        ".granphon-files",
        "sweep_incomplete.csv",
        "sweep_incomplete.nc",
    ]
    before = scene(load="{overlap: [0.05 um, 0.1 um]}", medium=medium)
    kept = gp.load_sweep(out / "sweep_incomplete.nc")
    assert kept.identical(caught.value.reached)
    assert "falls apart" in kept.attrs.pop("incomplete")
    # without force, as no result is lost
    assert kept.identical(before.run(out, figures=False).dataset)
    assert not list(out.glob("*incomplete*"))


def loaded_in_steps(ordered):
    """A medium of a small array that is loaded with friction."""
    history = {
        "friction_history": True,
        "friction_coefficient": 0.2,
        "step_tolerance": 1.0,
        "shape": (3, 3),
    }
    return {"simulation": history | {"ordered": ordered}}


def test_a_sweep_of_media_of_which_one_does_not_reach_its_first_load_has_none(
    tmp_path, monkeypatch
):
    end_at(monkeypatch, 0.01)
    media = ["ema", *(loaded_in_steps(ordered) for ordered in (True, False))]
    overlaps = np.array([0.005, 0.1, 0.2]) * W
    with pytest.raises(ConvergenceError, match=r"ordered=true.*apart") as caught:
        gp.sweep(PACKING, media=media, overlap=overlaps, path=tmp_path / "x.nc")
    assert caught.value.reached is None


@pytest.mark.parametrize("overlaps", [[0.2, 0.1], [0.2, 0.1, 0.005]])
def test_a_sample_of_a_path_that_is_not_recorded_is_located_without_pressing_again(
    monkeypatch, overlaps
):
    end_at(monkeypatch, 0.01)
    record = SampleRecord.of
    recorded = []

    def fail_at_second(sample, *arguments):
        """Record a sample, but for that of the second overlap."""
        recorded.append(sample.overlap)
        if sample.overlap < 0.15 * W:
            raise MechanismError("nothing resists it at f* = 0.5")
        return record(sample, *arguments)

    monkeypatch.setattr(SampleRecord, "of", fail_at_second)
    with pytest.raises(MechanismError, match=r"overlap = 2\.04e-07 m") as caught:
        gp.sweep(PACKING, media=[loaded_in_steps(True)], overlap=np.array(overlaps) * W)
    assert caught.value.load_index == 1
    assert len(recorded) == 2
    assert "f* =" not in str(caught.value)


def test_the_error_of_a_load_that_is_solved_alone_is_in_newtons(monkeypatch):
    def fail(task, state):
        raise MechanismError(f"nothing resists it at f* = {state.reduced_force.max():g}")

    monkeypatch.setattr(MediumTask, "observe", fail)
    with pytest.raises(MechanismError, match=" N") as caught:
        gp.sweep(PACKING, media=["ema"], force=[2.0, 3.0])
    assert caught.value.load_index == 0
    assert "f* =" not in str(caught.value)


@pytest.fixture(scope="module")
def reached_loads():
    """A sweep of two media at two loads."""
    return gp.sweep(PACKING, media=["ema", loaded_in_steps(True)], overlap=np.array([0.2, 0.1]) * W)


def test_media_of_a_sweep_that_ends_early_have_the_same_loads(reached_loads, tmp_path, monkeypatch):
    end_at(monkeypatch, 0.01)
    media = ["ema", loaded_in_steps(True)]
    overlaps = np.array([0.2, 0.1, 0.005]) * W
    store = Store(None)
    with pytest.raises(ConvergenceError, match=r"ordered=true.*x_incomplete.nc") as caught:
        gp.sweep(PACKING, media=media, overlap=overlaps, path=tmp_path / "x.nc", store=store)
    assert len(store.names) == 2  # the caller clears it
    store.close()
    reached = caught.value.reached.drop_attrs(deep=False)
    assert reached.identical(reached_loads.drop_attrs(deep=False))
    assert caught.value.load_index == 2
    assert not (tmp_path / "x.nc").exists()


@pytest.mark.exhaustive
def test_a_width_is_fitted_with_friction():
    # springs at all contacts: without those at sliding contacts, of so few balls, the velocity
    # would jump with the width
    history = {
        "friction_history": True,
        "friction_coefficient": 0.2,
        "shear_response": "stick",
        "step_tolerance": 1e-2,
    }
    medium = {"simulation": {"shape": (8, 8), **history}}
    # well above the start, also where a width that is tried is too large
    forces = np.array([2.0, 8.0])
    state = MediumChoice.parse(medium).of(PACKING).at_force(forces)
    fit = gp.fit_width(PACKING, forces, gp.sound_velocities(state).longitudinal, 1.0, medium=medium)
    assert fit.width == pytest.approx(W, rel=0.02)
    assert "friction_history=true" in fit.medium


def test_a_fit_below_the_start_says_which_datum():
    medium = {
        "simulation": {
            "shape": (4, 4),
            "friction_history": True,
            "friction_coefficient": 0.2,
            "step_tolerance": 0.1,
        }
    }
    with pytest.raises(
        InputError,
        match=r"datum 2, .* 200 mN .* width of .* start",
    ):
        gp.fit_width(PACKING, [8.0, 0.2, 2.0], [650.0, 250.0, 460.0], 1.0, medium=medium)


@pytest.mark.parametrize(
    ("given", "why"),
    [
        (
            options("friction_history: true"),
            "medium.simulation.friction_coefficient: found no",
        ),
        (
            options(*HISTORY, "start: {overlap: 20 mm}"),
            "{overlap: 20 mm}.* start",
        ),
        (options(*HISTORY, "start: {force: 1}"), "start.force: found 1"),
        (options("friction_histroy: true"), "'friction_history'"),
        (
            "{auto: {friction_history: true}}",
            "medium.auto.friction_coefficient: found no",
        ),
        (
            "{auto: {friction_history: true, friction_coefficient: 0.05}}",
            "0.1 .*0.05",
        ),
    ],
)
def test_mistakes_in_a_scene(given, why):
    with pytest.raises(InputError, match=why):
        scene(medium=given).require()


#: a medium on lines of its own, the last of which is the start
LINES = """
  - ema
  - simulation:
      shape: 4 4
      friction_history: true
      friction_coefficient: 0.2
      start: """


@pytest.mark.parametrize(
    ("load", "start", "where"),
    [
        (
            "{force: 2 N}",
            "0.3",
            ":12: medium.1.simulation.start: .*0.3.* threshold",
        ),
        (
            "{force: [2 N, 9 N]}",
            "0.3",
            ":12: medium.1.simulation.start: .*0.3.* threshold",
        ),
        (
            "{force: 2 N}",
            "{force: 1 GN}",
            ":12: medium.1.simulation.start: .*{force: 1 GN}.* together",
        ),
        (
            "{force: 2 N}",
            "{force: 5 N}",
            ":5: load.force: .*'2 N'.* start",
        ),
    ],
)
def test_mistakes_of_the_start_are_placed_at_the_start(load, start, where, tmp_path):
    with pytest.raises(SceneError, match=where):
        scene(load=load, medium=LINES + start).run(tmp_path / "out", figures=False)
    assert not list(tmp_path.glob("out/[!.]*"))


def test_a_start_by_default_that_fails_is_placed_at_the_medium(tmp_path, monkeypatch):
    def fail(self):
        raise InputError("it starts below the threshold")

    monkeypatch.setattr(LoadingHistory, "begin", fail)
    with pytest.raises(SceneError, match=r":6: medium: .*threshold"):
        scene().run(tmp_path / "out", figures=False)


def test_a_path_is_drawn_in_its_order():
    given = {
        "friction_history": True,
        "friction_coefficient": 0.1,
        "step_tolerance": 1.0,
        "ordered": True,
    }
    loads = np.array([0.1, 0.3, 0.2, 0.1]) * W
    media = ["ema", {"simulation": {"shape": (4, 4), **given}}]
    figure = sweep_figure(gp.sweep(PACKING, overlap=loads, media=media))
    lines = [line for line in figure.axes[0].lines if line.get_gid() == "longitudinal-all"]
    (one,) = [line for line in lines if line.get_linestyle() == "-" and line.get_marker() == "o"]
    np.testing.assert_array_equal(one.get_xdata(), loads)
    (fallen,) = [line for line in figure.axes[0].lines if line.get_gid() == "longitudinal-falling"]
    np.testing.assert_array_equal(fallen.get_xdata(), loads[2:])
    np.testing.assert_array_equal(fallen.get_ydata(), one.get_ydata()[2:])
