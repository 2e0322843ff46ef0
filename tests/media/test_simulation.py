"""Samples as a medium: the contract of its states, statistics over samples, other spreads, other
engines, wrong input.
"""

from __future__ import annotations

import copy
import dataclasses
import json
import math
import os
import pickle
import re
import signal
from concurrent.futures import ProcessPoolExecutor, ThreadPoolExecutor, wait
from contextlib import nullcontext
from functools import partial

import ase.io
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

import granphon as gp
from granphon.array.options import ReducedLoad
from granphon.array.rest import bring_to_rest
from granphon.array.sample import STEP
from granphon.balls.loads import Load
from granphon.base.errors import InputError
from granphon.dynamics.elasticity import bulk_and_shear
from granphon.media.simulation import SampleLaw, SimulatedState

WIDTH = 2.04e-6
D = 8e-3
#: in the directions of the lattice, the limit of small width
simulate = partial(gp.DirectSimulation, geometry="lattice")
#: of steel with this spread, by f*: the exponent and its standard error, from 24 samples of 96 x
#: 96, seeds from 9000 on
EXPONENTS = {
    0.03: (0.2822, 0.0013),
    0.1: (0.2502, 0.0006),
    0.3: (0.2111, 0.0002),
    1.0: (0.17192, 0.00001),
}
SHAPE = (5, 4)
FORCES = np.array([[2.0, 5.0, 18.0], [0.5, 5.0, 50.0]])


@pytest.fixture(scope="module")
def spread(steel):
    return gp.Packing(steel, D, gp.Uniform(WIDTH))


@pytest.fixture(scope="module")
def medium(spread):
    return simulate(spread, SHAPE, seed=5, samples=2)


@pytest.fixture(scope="module")
def states(medium):
    """Six loads, unsorted, one of them twice, of two samples."""
    return medium.at_force(FORCES)


def unit_of_force(packing):
    return packing.law.coefficient * WIDTH**1.5


# -- equal balls -----------------------------------------------------------------------------------


@pytest.mark.parametrize("shape", [(1, 1), (3, 1), (4, 5)], ids=str)
@pytest.mark.parametrize("force", [1e-12, 5.0, 1e6])
def test_equal_balls_are_the_averaged_lattice(packing, shape, force):
    state = simulate(packing, shape, samples=2).at_force(force)
    hertz = gp.AveragedLattice(packing).at_force(force)
    for name in ("force", "overlap", "normal_stiffness", "shear_stiffness", "pressure"):
        assert getattr(state, name) == pytest.approx(getattr(hertz, name), rel=1e-13)
    assert state.reduced_force == state.reduced_spacing == math.inf
    assert (state.force_fluctuation, state.contact_force_fluctuation, state.contact_fraction) == (
        0.0,
        0.0,
        1.0,
    )
    one, other = gp.sound_velocities(state), gp.sound_velocities(hertz)
    assert (one.longitudinal, one.transverse) == pytest.approx(
        (other.longitudinal, other.transverse), rel=1e-13
    )
    assert gp.moduli(state).shear == pytest.approx(gp.moduli(hertz).shear, rel=1e-13)
    assert gp.local_exponent(state) == pytest.approx(1.0 / 6.0, rel=1e-12)
    pulses = [gp.pulse_velocities(of, 100.0).group for of in (state, hertz)]
    np.testing.assert_allclose(pulses[0], pulses[1], rtol=1e-12)


@pytest.mark.parametrize("none", [None, gp.Uniform(0.0), gp.Discrete((D,), (1.0,))], ids=str)
def test_a_spread_without_width_is_none(steel, none):
    packing = gp.Packing(steel, D, none)
    state = simulate(packing, (3, 3)).at_overlap([1e-9, 1e-6])
    np.testing.assert_allclose(state.force, packing.law.force(np.array([1e-9, 1e-6])), rtol=1e-13)
    with pytest.raises(InputError, match="tensile"):
        simulate(packing, (3, 3)).at_overlap(-1e-9)


# -- units -----------------------------------------------------------------------------------------


def test_an_overlap_of_a_diameter_is_refused_however_wide_the_spread(steel):
    packing = gp.Packing(steel, D, spread=gp.Uniform(1.25 * D))
    simulation = gp.DirectSimulation(packing, (4, 4), seed=0)
    with pytest.raises(InputError, match="diameters"):
        simulation.at_overlap(1.1 * D)


def test_a_sample_is_its_equilibrium_in_si(spread):
    sample = simulate(spread, (7, 6), seed=3).at_overlap(0.1 * WIDTH).sample
    x = (sample.diameters - D) / WIDTH
    assert np.mean(x) == pytest.approx(0.0, abs=1e-12)
    reduced = bring_to_rest(x - np.mean(x), ReducedLoad(overlap=0.1))
    force = unit_of_force(spread)
    assert sample.force == pytest.approx(force * reduced.force, rel=1e-9)
    assert sample.normal_stiffness == pytest.approx(force / WIDTH * reduced.stiffness, rel=1e-9)
    assert sample.stiffness_slope == pytest.approx(
        force / WIDTH**2 * reduced.stiffness_slope, rel=1e-6
    )
    assert sample.energy == pytest.approx(force * WIDTH * reduced.energy, rel=1e-9)
    np.testing.assert_allclose(
        sample.contact_forces, force * np.moveaxis(reduced.forces, 0, -1), atol=1e-8 * sample.force
    )
    # contact by contact in SI, from diameters and displacements: the direction of the last axis
    u = sample.displacements
    d = sample.diameters
    steps = {
        0: ((0, 1), (-0.5, math.sqrt(0.75))),
        1: ((1, 0), (1.0, 0.0)),
        2: ((1, 1), (0.5, math.sqrt(0.75))),
    }
    for kind, (step, normal) in steps.items():
        other_d, other_u = (np.roll(a, (-step[0], -step[1]), (0, 1)) for a in (d, u))
        h = sample.overlap + 0.5 * (d + other_d) - D - (other_u - u) @ np.array(normal)
        np.testing.assert_allclose(
            sample.contact_overlaps[..., kind], h, rtol=0.0, atol=1e-12 * WIDTH + 1e-17
        )
        np.testing.assert_allclose(
            sample.contact_forces[..., kind],
            spread.law.coefficient * np.maximum(h, 0.0) ** 1.5,
            atol=1e-6 * sample.force,
        )
    assert sample.force == pytest.approx(float(np.mean(sample.contact_forces)), rel=1e-13)
    around = np.zeros((7, 6))
    for kind, (step, _) in steps.items():
        around += sample.contact_forces[..., kind] + np.roll(
            sample.contact_forces[..., kind], step, (0, 1)
        )
    assert sample.force_fluctuation == pytest.approx(
        float(np.std(around / 6.0)) / sample.force, rel=1e-12
    )
    rms = float(np.std(sample.contact_forces)) / sample.force
    assert sample.contact_force_fluctuation == pytest.approx(rms, rel=1e-12)


# -- the contract of a state -----------------------------------------------------------------------


@pytest.mark.slow
def test_shapes_are_those_of_the_load(medium, states):
    assert isinstance(states, gp.ContactState)
    for name in (
        "force",
        "pressure",
        "overlap",
        "normal_stiffness",
        "shear_stiffness",
        "reduced_force",
        "reduced_spacing",
        "valid",
        "force_fluctuation",
        "contact_force_fluctuation",
        "contact_fraction",
        "exponent",
        "exponent_error",
        "sample",
        "regime",
    ):
        assert np.shape(getattr(states, name)) == FORCES.shape, name
    assert np.array_equal(states.force, FORCES)
    assert states.over_samples(lambda sample: sample.force).shape == (2, 3, 2)
    assert states.elastic_tensor.shape == (2, 3, 3, 3)
    assert states.standard_error("overlap").shape == (2, 3)
    assert states.standard_error(lambda sample: sample.elastic_tensor).shape == (2, 3, 3, 3)
    for wrong, words in (("overlp", "overlap"), (3, "of is 3"), ("atoms", "Numbers")):
        with pytest.raises(InputError, match=words):
            states.standard_error(wrong)
    with pytest.raises(InputError, match="function"):
        states.over_samples("force")
    with pytest.raises(InputError, match="one shape"):
        states.over_samples(lambda _: [[1.0], [2.0, 3.0]])
    with pytest.raises(InputError, match="longitudinal, transverse"):
        states.branch_scales((1.0, 0.0), ["shear"])
    assert gp.sound_velocities(states).longitudinal_error.shape == (2, 3)
    assert gp.moduli(states).shears.shape == (2, 3, 2)
    assert gp.local_exponent(states).shape == (2, 3)
    assert gp.pulse_velocities(states, 100.0).group.shape == (2, 2, 3)
    one = medium.at_force(5.0)
    for name in (
        "force",
        "overlap",
        "normal_stiffness",
        "force_fluctuation",
        "exponent",
        "exponent_error",
    ):
        assert isinstance(getattr(one, name), float), name
    assert isinstance(gp.sound_velocities(one).longitudinal_error, float)
    assert one.sample is one.samples[0]
    assert one.elastic_tensor.shape == (3, 3)


def test_order_and_repetition_of_loads_do_not_matter(medium, states):
    for index in np.ndindex(FORCES.shape):
        alone = medium.at_force(FORCES[index])
        assert states.overlap[index] == pytest.approx(alone.overlap, rel=1e-9)
        assert states.normal_stiffness[index] == pytest.approx(alone.normal_stiffness, rel=1e-8)
        assert states[index].force == FORCES[index]
        np.testing.assert_allclose(
            states[index].sample.contact_forces,
            alone.sample.contact_forces,
            rtol=0.0,
            atol=1e-8 * FORCES[index],
        )
    assert states.overlap[0, 1] == pytest.approx(states.overlap[1, 1], rel=1e-12)


def test_indexing(states):
    part = states[:, 0]
    assert part.shape == (2,)
    assert part.n_samples == states.n_samples == 2
    assert [sample.seed for sample in states[0, 1].samples] == [5, 6]
    assert states[0, 1].sample is states.sample[0, 1]
    assert np.array_equal(states[states.force > 3.0].force, FORCES[FORCES > 3.0])
    for some in ((..., 1), (slice(None), 0), (np.newaxis, 1), (slice(None, None, -1), slice(None))):
        part = states[some]
        assert part.n_samples == 2
        for name in ("force_fluctuation", "contact_fraction", "exponent", "exponent_error"):
            np.testing.assert_array_equal(
                getattr(part, name), np.asarray(getattr(states, name))[some]
            )
    np.testing.assert_array_equal(states.elastic_tensor[1, 2], states[1, 2].elastic_tensor)
    np.testing.assert_array_equal(states.elastic_tensor[:, 1], states[..., 1].elastic_tensor)


def test_state_is_plain_data_that_pickles(states):
    for again in (
        pickle.loads(pickle.dumps(states)),
        copy.deepcopy(states),
        SimulatedState.from_dict(json.loads(json.dumps(states.to_dict()))),
    ):
        assert again == states
        assert again.samples == states.samples
        assert not again.samples[0].equilibrium.balls.flags.writeable
        np.testing.assert_array_equal(again.elastic_tensor, states.elastic_tensor)
        assert again.law.simulation == states.law.simulation
    assert states != states[::-1]
    assert states[0, 0] != gp.AveragedLattice(states.packing).at_force(2.0)
    assert "samples=" not in repr(states)
    with pytest.raises(dataclasses.FrozenInstanceError):
        states.force = 1.0


def test_stiffness_is_the_derivative_of_the_means(medium):
    step = 1e-4
    at_force = medium.at_force(5.0)
    ends = medium.at_force(5.0 * np.array([1.0 - step, 1.0 + step]))
    assert at_force.normal_stiffness == pytest.approx(
        10.0 * step / np.diff(ends.overlap)[0], rel=1e-6
    )
    at_overlap = medium.at_overlap(0.3 * WIDTH)
    ends = medium.at_overlap(WIDTH * np.array([0.3 - step, 0.3 + step]))
    assert at_overlap.normal_stiffness == pytest.approx(
        np.diff(ends.force)[0] / (2.0 * step * WIDTH), rel=1e-6
    )


def test_law_is_that_of_the_samples(medium):
    state = medium.at_overlap(WIDTH * np.array([0.5, 0.0, 2.0]))
    law = state.law
    assert isinstance(law, SampleLaw)
    np.testing.assert_allclose(law.force(state.overlap), state.force, rtol=1e-9)
    np.testing.assert_allclose(law.stiffness(state.overlap), state.normal_stiffness, rtol=1e-8)
    slopes = np.mean(state.over_samples(lambda sample: sample.stiffness_slope), axis=-1)
    np.testing.assert_allclose(law.stiffness_slope(state.overlap), slopes, rtol=1e-6)
    np.testing.assert_allclose(
        law.force_fluctuation(state.overlap), state.force_fluctuation, rtol=1e-7
    )
    np.testing.assert_array_equal(law.contact_fraction(state.overlap), state.contact_fraction)
    assert isinstance(law.energy(0.5 * WIDTH), float)
    assert law.overlap(5.0) == medium.at_force(5.0).overlap
    assert law.coefficient == medium.packing.law.coefficient
    step = 1e-5 * WIDTH
    slope = (law.energy(0.5 * WIDTH + step) - law.energy(0.5 * WIDTH - step)) / (2.0 * step)
    assert slope == pytest.approx(law.force(0.5 * WIDTH), rel=1e-7)
    largest = max(float(np.max(sample.diameters)) for sample in medium.at_force(5.0).samples)
    assert law.least_overlap == pytest.approx(-(largest - D), rel=1e-9)


def test_balls_that_are_drawn_alike_are_apart_up_to_an_overlap_of_zero(steel):
    nearly_all = gp.Discrete((D, D + 1e-6), (1.0 - 1e-9, 1e-9))
    alike = simulate(gp.Packing(steel, D, nearly_all), (4, 4))
    assert f"{SampleLaw(alike).least_overlap:g}" == "0"


# -- statistics ------------------------------------------------------------------------------------


def test_a_law_is_sent_elsewhere_without_the_samples_that_it_has_found(spread):
    law = simulate(spread, (16, 16)).law
    before = len(pickle.dumps(law))
    law.force(np.linspace(1e-6, 2e-6, 5))
    assert len(pickle.dumps(law)) < before + 16 * 16 * 8  # a number for each ball would be more


def test_seeds_end_where_64_bits_do(spread):
    last = 2**64 - 1
    assert simulate(spread, (2, 2), seed=last).at_force(5.0).sample.seed == last
    with pytest.raises(InputError, match=f"seed: .*{last}.* {last - 1}"):
        simulate(spread, (2, 2), seed=last, samples=2)


def test_the_array_as_a_whole_does_not_move(medium):
    balls = medium.at_force(2.0).sample.displacements
    np.testing.assert_allclose(np.mean(balls, axis=(0, 1)), 0.0, atol=1e-14 * np.max(np.abs(balls)))


def test_means_and_standard_errors(states):
    every = states.over_samples(lambda sample: sample.overlap)
    np.testing.assert_allclose(states.overlap, every.mean(axis=-1), rtol=1e-15)
    np.testing.assert_allclose(
        states.standard_error("overlap"), every.std(axis=-1, ddof=1) / math.sqrt(2.0), rtol=1e-14
    )
    k = states.over_samples(lambda sample: sample.normal_stiffness)
    np.testing.assert_allclose(states.normal_stiffness, 2.0 / np.sum(1.0 / k, axis=-1), rtol=1e-14)
    tensor = states.over_samples(lambda sample: sample.elastic_tensor)
    np.testing.assert_allclose(
        states.elastic_tensor, tensor.mean(axis=2), rtol=0.0, atol=1e-15 * tensor.max()
    )
    bulk = (tensor[..., 0, 0] + tensor[..., 1, 1] + 2.0 * tensor[..., 0, 1]) / 4.0
    shear = (
        (tensor[..., 0, 0] + tensor[..., 1, 1] - 2.0 * tensor[..., 0, 1]) / 4.0 + tensor[..., 2, 2]
    ) / 2.0
    moduli = gp.moduli(states)
    velocities = gp.sound_velocities(states)
    density = np.asarray(states.effective_density)
    for name, values in (("bulk", bulk), ("shear", shear)):
        np.testing.assert_allclose(getattr(moduli, name), values.mean(axis=-1), rtol=1e-13)
        error = values.std(axis=-1, ddof=1) / math.sqrt(2.0)
        np.testing.assert_allclose(getattr(moduli, f"{name}_error"), error, rtol=1e-11)
    for name, values in (("longitudinal", bulk + shear), ("transverse", shear)):
        np.testing.assert_allclose(
            getattr(velocities, name), np.sqrt(values.mean(axis=-1) / density), rtol=1e-13
        )
        error = np.sqrt(values / density[..., None]).std(axis=-1, ddof=1) / math.sqrt(2.0)
        np.testing.assert_allclose(getattr(velocities, f"{name}_error"), error, rtol=1e-11)


@pytest.mark.claim("error-root-n")
@pytest.mark.exhaustive
def test_standard_error_of_the_mean_falls_as_the_root_of_samples(spread):
    errors = []
    for samples in (16, 256):
        state = simulate(spread, (6, 6), samples=samples).at_overlap(0.5 * WIDTH)
        errors.append(state.standard_error("force"))
    # known to 1/sqrt(2 n), n = 15
    assert errors[0] / errors[1] == pytest.approx(4.0, rel=3.0 / math.sqrt(30.0))


def test_one_sample_has_no_error(spread):
    state = simulate(spread, (6, 6)).at_force(5.0)
    assert gp.sound_velocities(state).longitudinal_error is gp.moduli(state).bulk_error is None
    with pytest.raises(InputError, match="no standard error"):
        state.standard_error("force")


@pytest.mark.claim("api-simulation")
def test_contacts_above_a_threshold(spread):
    sample = simulate(spread, (20, 20)).at_overlap(-0.05 * WIDTH).sample
    parts = sample.contact_forces / sample.force
    for threshold in (0.0, 1e-9, 1e-6, 0.5, 1.0):
        assert sample.contact_fraction(threshold) == np.count_nonzero(parts > threshold) / 1200.0
    assert (
        sample.contact_fraction()
        == sample.contact_fraction(1e-6)
        == sample.contact_fraction(1e-8)
        < 0.7
    )
    assert sample.contact_fraction(10.0 * float(parts.max())) == 0.0


def test_distribution_of_forces_integrates_to_one(spread):
    sample = simulate(spread, (20, 20)).at_overlap(-0.05 * WIDTH).sample
    edges, density = sample.force_distribution(bins=40, largest=50.0)
    assert edges.shape == (41,)
    assert (edges[0], edges[-1]) == (0.0, 50.0)
    assert np.sum(density * np.diff(edges)) == pytest.approx(1.0, rel=1e-14)
    # forces beyond the last edge are counted in the norm
    edges, density = sample.force_distribution(bins=10, largest=1.0)
    live = sample.contact_forces[sample.contact_forces > 1e-6 * sample.force]
    assert np.sum(density * np.diff(edges)) == pytest.approx(
        np.mean(live <= sample.force), abs=1e-12
    )
    for wrong in (
        {"bins": -3},
        {"bins": 2.5},
        {"largest": 0.0},
        {"largest": math.nan},
        {"least": 7.0},
        {"least": 1.0, "largest": 1.0 + 3e-16},  # the edges of bins are one number
        {"least": -1e308, "largest": 1e308},  # the width of the range is no number
        {"largest": 1e-320},  # densities are no numbers
    ):
        with pytest.raises(InputError, match="bins"):
            sample.force_distribution(**wrong)


# -- the same numbers, however they are found ------------------------------------------------------


@pytest.mark.parametrize(
    ("make_executor", "workers"),
    [
        (lambda: ThreadPoolExecutor(2), 1),
        (nullcontext, 2),
        pytest.param(lambda: ProcessPoolExecutor(1), 1, marks=pytest.mark.slow),
    ],
    ids=["threads", "workers", "processes"],
)
def test_executors_and_threads_change_no_digit(spread, medium, states, make_executor, workers):
    with make_executor() as executor:
        simulation = simulate(spread, SHAPE, seed=5, samples=2, executor=executor, workers=workers)
        assert simulation == medium
        assert hash(simulation) == hash(medium)
        again = simulation.at_force(FORCES)
        assert again == states
        np.testing.assert_array_equal(again.elastic_tensor, states.elastic_tensor)


@pytest.mark.skipif(os.name != "posix", reason="signals of POSIX")
@pytest.mark.parametrize("history", [{}, {"friction_history": True, "friction_coefficient": 0.3}])
@pytest.mark.parametrize("before", [False, True])
def test_an_executor_that_loses_a_worker_is_one_error(spread, history, before):
    class Deadly(ProcessPoolExecutor):
        def submit(self, job, *given):
            return super().submit(signal.raise_signal, signal.SIGKILL)

    with Deadly(1) as executor:
        if before:
            wait([executor.submit(None)])
        with pytest.raises(gp.GranphonError, match="executor"):
            simulate(spread, (4, 4), seed=5, executor=executor, **history).at_force(5.0)


def test_numbers_of_a_seed_stay_the_same(spread):
    # diameters to the last digit on any machine; forces to their tolerance
    state = simulate(spread, (4, 3), seed=7).at_overlap(0.5 * WIDTH)
    sample = state.sample
    given = gp.Uniform(WIDTH).sample((4, 3), 7)
    np.testing.assert_allclose(sample.diameters, D + given - np.mean(given), rtol=1e-15)
    assert sample.seed == 7
    golden = [0.11500786944440058, 0.04320402530788605, -0.057125986241245624]
    assert sample.equilibrium.deviations[0].tolist() == pytest.approx(golden, rel=0.0, abs=1e-15)
    assert state.reduced_force == pytest.approx(0.3606033467262, rel=1e-11)
    # the next samples are those of the next seeds
    three = simulate(spread, (4, 3), seed=5, samples=3).at_overlap(0.5 * WIDTH)
    assert three.samples[2] == sample


def test_given_diameters(spread, packing):
    drawn = simulate(spread, (5, 6), seed=2).at_force(5.0)
    # with another mean, which is shifted: the same sample
    medium = simulate(spread, diameters=drawn.sample.diameters + 1e-5)
    assert medium.shape == (5, 6)
    assert not medium.diameters.flags.writeable
    state = medium.at_force(5.0)
    assert state.sample.seed is None
    assert state.overlap == pytest.approx(drawn.overlap, rel=1e-9)
    np.testing.assert_allclose(state.sample.diameters, drawn.sample.diameters, rtol=1e-14)
    # a packing without a spread takes theirs
    own = simulate(packing, diameters=drawn.sample.diameters + 1e-5)
    assert own.packing.diameter == pytest.approx(D, rel=1e-15)
    assert own.packing.width == pytest.approx(
        math.sqrt(12.0) * float(np.std(drawn.sample.diameters)), rel=1e-9
    )
    again = own.at_force(5.0)
    assert again.overlap == pytest.approx(drawn.overlap, rel=1e-9)
    # its W is the sample's own
    assert again.reduced_spacing != pytest.approx(drawn.reduced_spacing, rel=1e-3)
    assert SimulatedState.from_dict(json.loads(json.dumps(again.to_dict()))) == again
    assert own == simulate(packing, diameters=drawn.sample.diameters + 1e-5)
    assert own != simulate(packing, diameters=drawn.sample.diameters[::-1])
    assert own != simulate(packing, diameters=drawn.sample.diameters[:-1])
    assert own != simulate(packing, (5, 6))


# -- other spreads and shapes ----------------------------------------------------------------------

SPREADS = {
    "normal": gp.Normal(0.6e-6),
    "two kinds": gp.Discrete((D - 1e-6, D + 1e-6), (0.5, 0.5)),
    "skewed": gp.Discrete((D - 1e-6, D + 9e-6), (0.9, 0.1)),
    "measured": gp.Measured(tuple(D + 1e-6 * np.sin(np.arange(40.0) ** 2))),
}


@pytest.mark.parametrize("name", SPREADS)
def test_any_spread(steel, name):
    chosen = SPREADS[name]
    packing = gp.Packing(steel, chosen.mean or D, chosen)
    state = simulate(packing, (6, 6), samples=4).at_force([0.2, 5.0, 5000.0])
    assert all(sample.residual <= 1e-10 for sample in state.samples)
    for sample in state.samples:
        assert np.mean(sample.diameters) == pytest.approx(packing.diameter, rel=1e-15)
    # the higher the load, the less the balls differ
    assert np.all(np.diff(state.contact_fraction) >= 0.0)
    assert np.all(np.diff(state.force_fluctuation) < 0.0)
    assert state.contact_fraction[-1] == 1.0
    medium = gp.EffectiveMedium(dataclasses.replace(packing, friction=False)).at_force(5000.0)
    finite = state.standard_error("normal_stiffness")[-1]
    assert state.normal_stiffness[-1] == pytest.approx(
        medium.normal_stiffness, abs=4.0 * finite, rel=2e-5
    )


@pytest.mark.claim("readme-sizes")
@settings(max_examples=12)
@given(
    st.tuples(st.integers(1, 11), st.integers(1, 11)),
    st.integers(0, 2**64 - 1),
    st.floats(-1.0, 20.0),
    st.booleans(),
)
def test_any_shape_seed_and_load(shape, seed, decade, friction):
    packing = gp.Packing(
        gp.Material(211.65e9, 0.276, 7840.0), D, gp.Uniform(1e-16), friction=friction
    )
    force = 10.0**decade * packing.law.coefficient * 1e-24
    state = simulate(packing, shape, seed).at_force(force)
    assert state.force == force
    assert state.sample.residual <= 1e-10
    assert 0.0 < state.normal_stiffness < math.inf
    assert 0.0 < state.contact_fraction <= 1.0
    moduli = gp.moduli(state)
    assert moduli.bulk > 0.0
    if not friction:
        assert moduli.bulk == pytest.approx(math.sqrt(0.75) * state.normal_stiffness / D, rel=1e-9)


def test_very_high_loads_are_hertzs(steel):
    # so little spread that a* = 1e12 is a small part of the diameter
    width = 1e-16
    medium = simulate(gp.Packing(steel, D, gp.Uniform(width)), (8, 8))
    spacings = np.array([1e4, 1e7, 1e12])
    states = medium.at_overlap((spacings - 0.5) * width)
    hertz = gp.AveragedLattice(dataclasses.replace(medium.packing, spread=None)).at_overlap(
        states.overlap
    )
    np.testing.assert_allclose(states.reduced_spacing, spacings, rtol=1e-14)
    # what disorder does to means falls as 1/x^2, to single contacts as 1/x; no digit of it is lost
    for one, other in (
        (states.force, hertz.force),
        (gp.moduli(states).shear, gp.moduli(hertz).shear),
    ):
        assert np.all(np.abs(one / other - 1.0) < 0.2 / spacings**2 + 1e-14)
    scaled = states.contact_force_fluctuation * (spacings - 0.5)
    np.testing.assert_allclose(scaled, scaled[-1], rtol=1e-4)
    np.testing.assert_allclose(gp.local_exponent(states), 1.0 / 6.0, rtol=1e-7)
    np.testing.assert_allclose(gp.local_exponent(states)[1:], 1.0 / 6.0, rtol=1e-12)


def test_friction_does_not_touch_statics(spread, medium, states):
    smooth = simulate(
        dataclasses.replace(spread, friction=False), SHAPE, seed=5, samples=2
    ).at_force(FORCES)
    np.testing.assert_array_equal(smooth.overlap, states.overlap)
    assert np.all(gp.moduli(states).shear > gp.moduli(smooth).shear)
    np.testing.assert_allclose(
        gp.moduli(smooth).bulk,
        math.sqrt(0.75)
        / D
        * smooth.over_samples(lambda sample: sample.normal_stiffness).mean(axis=-1),
        rtol=1e-9,
    )


# -- the local exponent ----------------------------------------------------------------------------


@pytest.mark.claim("exponent-two-loads", "exponent-in-files", "api-exponent")
@pytest.mark.parametrize(
    ("reduced", "friction"),
    [
        (1.0, True),
        pytest.param(0.1, False, marks=pytest.mark.slow),
        pytest.param(0.03, False, marks=pytest.mark.slow),
    ],
)
def test_the_exponent_of_a_sample_is_the_difference_of_log_v_over_log_p(spread, reduced, friction):
    packing = dataclasses.replace(spread, friction=friction)
    medium = simulate(packing, (6, 5), seed=3)
    force = reduced * unit_of_force(spread)
    state, ends = medium.at_force(force), medium.at_force(force * np.exp([-STEP, STEP]))
    np.testing.assert_allclose(ends.force / force, [0.95, 1.05], atol=0.002)  # as the pages say
    expected = (
        np.diff(np.log(gp.sound_velocities(ends).longitudinal))[0]
        / np.diff(np.log(ends.pressure))[0]
    )
    alike = [
        state,
        medium.at_pressure(state.pressure),
        medium.at_overlap(state.overlap),
        medium.at_force([force, 2.0 * force])[0],
        simulate(packing, diameters=state.sample.diameters).at_force(force),
    ]
    for one in alike:
        assert gp.local_exponent(one) == one.exponent == pytest.approx(expected, rel=1e-6)
        assert math.isnan(one.exponent_error)


def part(state, which):
    """The state of some of the samples under one load."""
    samples = [state.samples[index] for index in which]
    load = Load("overlap", state.overlap) if state.fixed_overlap else Load("force", state.force)
    return SimulatedState.of(state.law.simulation, samples, load)


@pytest.mark.claim("exponent-step")
@pytest.mark.parametrize(
    ("kind", "reduced"),
    [("force", 3.0), pytest.param("overlap", 2.0, marks=pytest.mark.slow), ("force", 1.0)],
)
def test_the_bias_of_the_step_is_of_second_order(spread, kind, reduced):
    load = reduced * (unit_of_force(spread) if kind == "force" else WIDTH)
    alone = [simulate(spread, (8, 8), seed) for seed in (0, 1)]
    forces = [getattr(one, f"at_{kind}")(load).force for one in alone]

    def exponent(step):
        ends = [
            one.at_force(force * np.exp([-step, step]))
            for one, force in zip(alone, forces, strict=True)
        ]
        return np.mean(
            [
                np.diff(np.log(gp.sound_velocities(both).longitudinal)) / (2.0 * step)
                for both in ends
            ]
        )

    middle, narrow = (exponent(step) for step in (0.2, 0.1))
    curvature = (middle - narrow) / (0.2**2 - 0.1**2)
    if reduced > 1.0:
        # of the step that is taken it is less than the standard error of a million balls
        assert abs(curvature) * STEP**2 < 5e-6
        assert (exponent(0.4) - middle) / (middle - narrow) == pytest.approx(4.0, rel=0.05)
    else:  # where chance is least
        assert curvature == pytest.approx(2e-3, rel=0.2)
        assert curvature * STEP**2 == pytest.approx(5e-6, rel=0.2)


@pytest.mark.claim("exponent-exact-law")
def test_neither_bars_nor_bias_where_balls_are_equal(packing):
    for samples in (1, 3):
        state = simulate(packing, (4, 3), samples=samples).at_force([1.0, 50.0])
        np.testing.assert_allclose(state.exponent, 1.0 / 6.0, rtol=1e-14)
        assert np.array_equal(state.exponent_error, [0.0, 0.0])
        assert state[0].exponent_error == 0.0
        assert "elastic_tensors_beside" not in vars(state.samples[0])


@pytest.mark.claim("exponent-exact-law")
def test_at_high_loads_the_exponent_is_that_of_the_exact_law(steel):
    # f* = x^(3/2) (1 + r/(64 x^2)), x = a* - 1/2, without friction: the bulk modulus goes as df/dx
    packing = gp.Packing(steel, D, gp.Uniform(WIDTH), friction=False)
    x = np.array([8.0, 16.0, 32.0])
    states = simulate(packing, (32, 32), samples=3).at_overlap(x * WIDTH)
    xi = gp.EffectiveMedium(packing).local_field.xi
    r = xi / (1.0 + xi)
    np.testing.assert_allclose(64.0 * x**2 * (states.reduced_force / x**1.5 - 1.0), r, rtol=0.05)
    beside = bulk_and_shear(states.over_samples(lambda sample: sample.elastic_tensors_beside))
    low, high = np.moveaxis(beside[..., 0].mean(axis=1), -1, 0)
    above = 6.0 * (0.5 * np.log(high / low) / (2.0 * STEP)) - 1.0
    np.testing.assert_allclose(above * x**2, r / 24.0, rtol=0.05)
    # but for the chance of the samples, which is in their forces too
    np.testing.assert_allclose(
        24.0 * above, 64.0 * (states.reduced_force / x**1.5 - 1.0), rtol=0.005
    )
    # that of v_L has another coefficient, as G is not in proportion to K, and the same power
    scaled = (6.0 * states.exponent - 1.0) * x**2
    np.testing.assert_allclose(scaled, scaled[-1], rtol=0.01)
    np.testing.assert_allclose(
        states.exponent_error * x**2, states.exponent_error[-1] * x[-1] ** 2, rtol=0.05
    )


@pytest.fixture(scope="module")
def small(spread):
    """Two dozen samples at the loads of EXPONENTS."""
    return simulate(spread, (8, 8), seed=400, samples=24).at_force(
        np.array(list(EXPONENTS)) * unit_of_force(spread)
    )


@pytest.mark.claim("exponent-errors")
@pytest.mark.exhaustive
def test_errors_of_exponents_are_what_repeated_experiments_differ_by(small):
    """Six experiments of four samples at each of four loads: differences from the truth over errors
    are Student's t.
    """
    from scipy.stats import t as student

    truth = np.array([value for value, _ in EXPONENTS.values()])
    groups = [
        [part(state, range(n, n + 4)) for n in range(0, 24, 4)]
        for state in (small[place] for place in range(4))
    ]
    found, errors = (
        np.array([[getattr(one, name) for one in row] for row in groups])
        for name in ("exponent", "exponent_error")
    )
    t = np.abs(found - truth[:, None]) / errors
    students = student(3).ppf(0.5 + 0.5 * (np.arange(1000) + 0.5) / 1000)
    # their logarithms, which a wrong factor of the error shifts; and how many are within the
    # quantile of 90 %
    logs = np.log(students)
    assert np.mean(np.log(t)) == pytest.approx(
        np.mean(logs), abs=2.5 * np.std(logs) / math.sqrt(t.size)
    )
    assert np.mean(t < student(3).ppf(0.95)) == pytest.approx(
        0.9, abs=2.5 * math.sqrt(0.9 * 0.1 / t.size)
    )
    # and all samples together
    off = (small.exponent - truth) / np.hypot(
        small.exponent_error, [error for _, error in EXPONENTS.values()]
    )
    assert np.max(np.abs(off)) < 3.0


@pytest.mark.claim("exponent-errors")
@pytest.mark.exhaustive
def test_the_error_falls_as_the_root_of_the_number_of_samples(small):
    # which that of a variance without bound would not
    for state in (small[place] for place in range(4)):
        few = [part(state, range(first, first + 4)).exponent_error for first in range(0, 24, 4)]
        assert math.sqrt(np.mean(np.square(few))) / state.exponent_error == pytest.approx(
            math.sqrt(6.0), rel=0.3
        )


@pytest.mark.slow
@pytest.mark.claim("exponent-neighbours")
@pytest.mark.parametrize(
    ("samples", "forces"),
    [(3, [1.0, 1.02]), pytest.param(4, [1.0, 1.01, 1.02], marks=pytest.mark.slow)],
)
def test_neighbouring_loads_have_neighbouring_exponents(spread, samples, forces):
    # derivatives at these very loads are 0.394, 0.284, 0.271: at the first a contact is about to
    # open
    force = 0.06 * np.array(forces) * unit_of_force(spread)
    states = simulate(spread, (8, 8), seed=400, samples=samples).at_force(force)
    assert np.ptp(states.exponent) < 0.01
    assert np.ptp(states.exponent_error) < 0.1 * np.min(states.exponent_error)


def test_next_to_the_least_force_the_exponent_is_there(spread):
    # where one contact more or less decides, nothing changes over the step but all overlaps in
    # proportion
    state = simulate(spread, (5, 5), samples=2).at_force(1.01e-8 * unit_of_force(spread))
    assert state.exponent == pytest.approx(1.0 / 6.0, rel=1e-6)


# -- files -----------------------------------------------------------------------------------------


def test_atoms_of_a_sample(spread):
    state = simulate(spread, (5, 4)).at_overlap(0.05 * WIDTH)
    atoms = state.sample.atoms()
    sample = state.sample
    np.testing.assert_allclose(
        2.0 * D * atoms.arrays["radius"], sample.diameters.ravel(), rtol=1e-14
    )
    np.testing.assert_allclose(atoms.get_masses(), (sample.diameters.ravel() / D) ** 3, rtol=1e-14)
    np.testing.assert_allclose(
        D * atoms.arrays["displacements"][:, :2], sample.displacements.reshape(-1, 2), atol=1e-20
    )
    assert np.mean(atoms.arrays["contact_force"]) == pytest.approx(1.0, rel=1e-12)
    assert np.std(atoms.arrays["contact_force"]) == pytest.approx(
        sample.force_fluctuation, rel=1e-9
    )
    assert np.sum(atoms.arrays["contacts"]) == 2 * np.count_nonzero(
        sample.contact_forces > 1e-6 * sample.force
    )
    # neighbours sit a diameter apart, but for displacements
    sites = atoms.positions - atoms.arrays["displacements"]
    distances = ase.Atoms("Fe20", sites, cell=atoms.cell, pbc=atoms.pbc).get_all_distances(mic=True)
    assert np.sort(distances, axis=1)[:, 1] == pytest.approx(1.0, rel=1e-12)


# -- wrong input -----------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("keywords", "words"),
    [
        ({"shape": (0, 3)}, r"shape: found \[0, 3\]"),
        ({"shape": (2.0, 3)}, r"shape: found \[2.0, 3\]"),
        ({"shape": (1, 2, 3)}, "two whole"),
        ({"shape": "ab"}, "shape: found 'ab'"),
        ({"seed": -1}, "seed: found -1"),
        ({"seed": 0.5}, "seed: found 0.5"),
        ({"samples": 0}, "samples: found 0"),
        ({"samples": True}, "samples: found true"),
        ({"workers": 0}, "workers: found 0"),
        ({"executor": 5}, "executor is 5"),
        ({"diameters": [1.0, 2.0]}, "array \\(L1, L2\\)"),
        ({"diameters": np.zeros((2, 2))}, "above zero"),
        ({"diameters": [[1.0, math.nan]]}, "finite"),
        ({"diameters": np.zeros((0, 2))}, "array"),
        ({"diameters": [["a"]]}, "array"),
        ({"diameters": np.full((2, 2), D), "samples": 2}, "Leave samples out"),
        ({"diameters": np.full((2, 2), D), "shape": (3, 3)}, "Leave shape out"),
    ],
    ids=str,
)
def test_what_a_simulation_cannot_be(spread, keywords, words):
    with pytest.raises(InputError, match=words):
        simulate(spread, **keywords)


def test_other_packings(steel):
    with pytest.raises(InputError, match=r"granphon\.Packing"):
        simulate(5)
    with pytest.raises(InputError, match="square lattice"):
        simulate(gp.Packing(steel, D, gp.Uniform(WIDTH), lattice="square"))


@pytest.mark.parametrize("load", [1e300, [5.0, 1e300], 1e13], ids=str)
def test_loads_beyond_a_diameter(packing, spread, load):
    for medium in (simulate(spread, (3, 3)), simulate(packing, (3, 3))):
        for at in (medium.at_force, medium.at_pressure, medium.at_overlap):
            with pytest.raises(InputError, match=r"presses|double precision"):
                at(load)
        with pytest.raises(InputError, match="by 1 diameters"):
            medium.at_overlap(D)
        assert medium.at_overlap(0.999 * D).force > 0.0


@pytest.mark.parametrize("load", [1e-300, [5.0, 1e-300]], ids=str)
def test_loads_below_double_precision(packing, load):
    medium = simulate(packing, (3, 3))
    with pytest.raises(InputError, match="too small"):
        medium.at_overlap(load)
    np.testing.assert_array_equal(medium.at_force(load).force, load)


@pytest.mark.claim("least-loads")
def test_too_little_load(spread):
    medium = simulate(spread, (8, 8))
    with pytest.raises(InputError, match="carries no load"):
        medium.at_overlap(-0.2 * WIDTH)
    with pytest.raises(InputError, match="no balls touch"):
        medium.at_overlap([0.5 * WIDTH, -1.0])
    with pytest.raises(InputError, match="carries no load") as caught:
        medium.at_overlap(WIDTH * np.array([0.5, -0.2, 1.0]))
    assert caught.value.load_index == 1
    for force in (1e-9, [1.0, 1e-9], 1e-300):
        with pytest.raises(InputError, match="rigidity threshold"):
            medium.at_force(np.array(force) * unit_of_force(spread))


def test_given_balls_may_differ_by_more_than_their_spread(spread):
    diameters = D + WIDTH * np.where(np.arange(36).reshape(6, 6) % 2, 2.0, -2.0)
    medium = simulate(spread, diameters=diameters)
    with pytest.raises(InputError, match=r"touch.* 4.08e-06 m"):
        medium.at_overlap(-2.1 * WIDTH)
    assert medium.at_overlap(-0.6 * WIDTH).force > 0.0


def test_terms_of_finite_overlap_are_not_known(steel):
    """Moduli of the paper's limit over the density of the shrunk array gave 1692.7 m/s for 1701.5
    m/s at one force.
    """
    medium = simulate(gp.Packing(steel, D, gp.Uniform(20e-6)), (8, 8))
    state = medium.at_overlap(0.005 * D)
    for kind in ("force", "pressure", "overlap"):
        with pytest.raises(InputError, match=r"'simulation' .*finite overlap"):
            getattr(medium, f"at_{kind}")(getattr(state, kind), finite_overlap=True)
    with pytest.raises(InputError, match="finite overlap"):
        dataclasses.replace(state, finite_overlap=True)
    again = medium.at_pressure(state.pressure, finite_overlap=False)
    assert gp.sound_velocities(again).longitudinal == pytest.approx(
        gp.sound_velocities(state).longitudinal, rel=1e-9
    )
    assert again.effective_density == medium.packing.effective_density


@pytest.mark.exhaustive
@pytest.mark.claim("shear-deficit", "ratio-small-width")
def test_a_shear_modulus_that_is_too_small_is_warned_of(steel):
    """By the part that open contacts and W/d let expect; what is measured is in
    test_true_geometry.
    """
    overlaps = np.array([[0.38, 0.4, 0.45], [0.5, 0.7, 2.0]]) - 0.5

    def expected(width, friction=True):
        packing = gp.Packing(steel, D, gp.Uniform(width), friction=friction)
        state = simulate(packing, (12, 12), seed=1).at_overlap(overlaps * width)
        return state, gp.validity(state)

    state, report = expected(2.04e-6)
    value = report["shear"].value
    np.testing.assert_allclose(
        value, 36.0 * (1.0 - state.contact_fraction) ** 3.5 * (2.04e-6 / D) ** 0.3, rtol=1e-12
    )
    assert report["shear"].ok.tolist() == [[False, False, False], [False, True, True]]
    (text,) = report.warnings
    worst = value.max()
    percent = 100.0 * worst
    percent_of_velocity = 100.0 * (1.0 - math.sqrt(1.0 - worst))
    numbers = rf"4 of 6 loads .* {percent:.2g} % \(v_T by {percent_of_velocity:.2g} %\)"
    assert re.search(f"{numbers}.* geometry: exact", text)
    # the limit of no width is reached as (W/d)^0.3
    np.testing.assert_allclose(
        expected(2.04e-9)[1]["shear"].value[0], 1e-3**0.3 * value[0], rtol=1e-12
    )
    packing = gp.Packing(steel, D, gp.Uniform(2.04e-6))
    for without in (
        expected(2.04e-6, friction=False)[1],
        gp.validity(simulate(gp.Packing(steel, D), (3, 3)).at_force(1.0)),
        gp.validity(gp.EffectiveMedium(packing).at_force(0.1)),
    ):
        assert "shear" not in [check.name for check in without.checks]


def test_the_largest_of_given_diameters_is_one_of_them(rough):
    """The packing has a spread, but the given balls are equal: none touch at overlap zero."""
    equal_balls = gp.DirectSimulation(rough, diameters=np.full((3, 3), rough.diameter))
    with pytest.raises(InputError, match="no balls touch"):
        equal_balls.at_overlap(0.0)
