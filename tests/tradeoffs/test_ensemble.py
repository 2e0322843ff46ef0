"""Ensembles: regression on what is known exactly, the same means as the simulation's own, and
errors that are true.
"""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from numpy.testing import assert_allclose, assert_array_equal

import granphon as gp
from granphon.balls.lattices import find_lattice
from granphon.balls.loads import Load
from granphon.base.errors import InputError
from granphon.tradeoffs.measure import (
    QUANTITIES,
    Ensemble,
    find_near_pairs,
    measure_excess,
    observe,
    regress,
)
from tests.conftest import only

KINDS = ("force", "pressure", "overlap")


@pytest.fixture(scope="module")
def many(rough, unit):
    """Enough samples for a regression, at f* = 1, 3 and 30."""
    return collect(rough, "force", (unit, 3.0 * unit, 30.0 * unit), (12, 12), 48)


def collect(packing, kind, loads, shape, count, seed=0):
    """An ensemble of so many samples."""
    found = Ensemble(packing, Load(kind, loads), shape, seed)
    found.add(count)
    return found


def noise(found):
    """Relative standard deviation of the quantities of a sample (n_loads, 3): half of that of the
    moduli.
    """
    return 0.5 * np.std(found.moduli, axis=0, ddof=1) / np.mean(found.moduli, axis=0)


# -- the regression --------------------------------------------------------------------------------


def test_what_is_linear_in_the_excess_is_taken_out_exactly():
    rng = np.random.default_rng(0)
    excess = rng.normal(size=(40, 4)) * [1e-3, 1e-2, 1e-4, 1.0]
    slopes = rng.normal(size=(4, 3)) * 100.0
    mean = np.array([3.0, -2.0, 1e6])
    found, error = regress(mean + excess @ slopes, excess)
    assert_allclose(found, mean, rtol=1e-12)
    assert np.all(error < 1e-12 * np.abs(mean))
    # without it the chance is there
    plain, chance = regress((mean + excess @ slopes)[:20], excess[:20])
    assert_allclose(plain, np.mean((mean + excess @ slopes)[:20], axis=0))
    assert np.all(chance[:2] > 1.0)


@pytest.mark.parametrize("count", [10, pytest.param(60, marks=pytest.mark.slow)])
def test_errors_are_those_of_a_fake_linear_model(count):
    """Many ensembles of a model with a known mean: deviations over standard errors have Student's
    variance.
    """
    rng = np.random.default_rng(count)
    pulls = []
    for _ in range(2000):
        excess = rng.normal(size=(count, 4))
        values = 5.0 + excess @ [1.0, -2.0, 0.5, 0.0] + 0.1 * rng.normal(size=count)
        found, error = regress(values[:, None], excess)
        pulls.append((found[0] - 5.0) / error[0])
    freedom = count - (5 if count >= 30 else 1)
    variance = freedom / (freedom - 2.0)
    assert_allclose(np.mean(pulls), 0.0, atol=4.0 * math.sqrt(variance / len(pulls)))
    assert_allclose(np.var(pulls), variance, rtol=0.12)


@given(st.integers(0, 10**6), st.floats(-1e3, 1e3), st.floats(1e-3, 1e3))
def test_a_mean_moves_and_scales_with_what_is_averaged(seed, shift, factor):
    rng = np.random.default_rng(seed)
    excess = rng.normal(size=(32, 4))
    values = rng.normal(size=(32, 2))
    mean, error = regress(values, excess)
    moved, scaled = regress(shift + factor * values, excess)
    assert_allclose(moved, shift + factor * mean, rtol=1e-9, atol=1e-9 * (abs(shift) + factor))
    assert_allclose(scaled, factor * error, rtol=1e-9)
    # whatever the scale of the known ones
    assert_allclose(regress(values, 1e-7 * excess)[0], mean, rtol=1e-9, atol=1e-9)


def test_a_known_part_that_never_varies_is_no_reason_to_regress():
    rng = np.random.default_rng(1)
    excess = rng.normal(size=(40, 4))
    values = rng.normal(size=(40, 1))
    excess[:, 2] = 0.0
    mean, error = regress(values, excess)
    assert_allclose(mean, np.mean(values, axis=0))
    assert_allclose(error, np.std(values, axis=0, ddof=1) / math.sqrt(40))


@pytest.mark.parametrize(
    ("lattice", "shape", "pairs"),
    [
        ("triangular", (16, 16), [3, 3, 3]),
        ("fcc", (6, 6, 6), [6, 3, 12]),
        ("hcp", (6, 6, 4), [6, 3, 1]),
    ],
)
def test_the_excess_of_samples_is_zero_in_the_mean(rough, lattice, shape, pairs):
    """The variance is 1/12 and near pairs are not correlated, but for the mean that each sample is
    shifted by.
    """
    count = 200
    simulation = gp.DirectSimulation(replace(rough, lattice=lattice), shape, 5, count)
    excess = np.array(list(measure_excess(simulation)))
    balls = simulation.balls
    # of x^2, and of each pair, with the sample's own mean taken away
    expected = -1.0 / (12.0 * balls)
    assert_allclose(
        np.mean(excess, axis=0),
        expected,
        atol=4.0 * np.max(np.std(excess, axis=0)) / math.sqrt(count),
    )
    # var of x^2 is (1/80 - 1/144)/N; of a mean over p pairs x x' for each ball it is (1/12)^2/(p N)
    spread = np.array([math.sqrt(1 / 80 - 1 / 144), *(1 / 12 / np.sqrt(pairs))]) / math.sqrt(balls)
    assert_allclose(np.std(excess, axis=0), spread, rtol=0.15)


@pytest.mark.parametrize(
    ("lattice", "shape", "squares"),
    [
        ("triangular", (5, 6), (1, 3, 4)),
        ("fcc", (6, 5, 7), (1, 2, 3)),
        ("hcp", (5, 6, 4), (1, 2, 8 / 3)),
        ("kagome", (4, 5), (1, 3, 4)),
    ],
)
def test_near_pairs_are_those_of_all_balls_at_these_distances(lattice, shape, squares):
    """One by one, over every ball and its images in a periodic sample."""
    structure = find_lattice(lattice)
    rng = np.random.default_rng(3)
    n = structure.n_balls
    cells = np.array(list(np.ndindex(shape)))
    x = rng.normal(size=(n, *shape))
    places = (cells @ structure.vectors)[None] + structure.positions[:, None]  # (n, cells, d)
    places = places.reshape(-1, places.shape[-1])
    values = x.reshape(-1)
    box = np.array(shape)[:, None] * structure.vectors
    images = np.array(list(np.ndindex(*(3,) * len(shape)))) - 1
    apart = places[None, :, None] + (images @ box)[None, None] - places[:, None, None]
    found = np.sum(apart**2, axis=-1)
    for square, shell in zip(squares, find_near_pairs(structure), strict=True):
        one, other, _ = np.nonzero(np.abs(found - square) < 1e-6)
        axes = tuple(range(len(shape)))
        products = [x[j] * np.roll(x[i], shift, axes) for i, j, shift in shell]
        assert 2 * len(shell) * len(cells) == len(one)
        assert_allclose(2.0 * np.sum(products), np.sum(values[one] * values[other]), rtol=1e-10)


# -- against the simulation's own means ------------------------------------------------------------


@pytest.mark.parametrize(
    ("kind", "friction"),
    [
        ("force", False),
        *((kind, True) for kind in KINDS),
        *(pytest.param(kind, False, marks=pytest.mark.slow) for kind in KINDS[1:]),
    ],
)
def test_of_few_samples_it_is_the_mean_of_the_simulation(steel, kind, friction):
    packing = gp.Packing(steel, 8e-3, spread=gp.Normal(6e-7), friction=friction)
    loads = {"force": (2.0, 20.0), "pressure": (500.0, 4e3), "overlap": (5e-7, 2e-6)}[kind]
    found = collect(packing, kind, loads, (8, 10), 3, 7)
    values, errors = found.means()
    state = getattr(gp.DirectSimulation(packing, (8, 10), 7, 3), f"at_{kind}")(np.array(loads))
    assert_allclose(values, observe(state), rtol=1e-12)
    assert found.samples == 3
    velocities = gp.sound_velocities(state)
    # a velocity is the root of a modulus, whose error is twice its own, to first order in the
    # chance
    assert_allclose(
        errors[:, 0], velocities.longitudinal_error / velocities.longitudinal, rtol=0.01
    )
    assert_allclose(errors[:, 1], velocities.transverse_error / velocities.transverse, rtol=0.01)
    assert_allclose(errors, noise(found) / math.sqrt(3), rtol=1e-9)


def test_what_is_observed_is_velocities_and_the_scale_of_frequencies(packing):
    state = gp.AveragedLattice(packing).at_force([1.0, 10.0])
    values = observe(state)
    velocities = gp.sound_velocities(state)
    assert values.shape == (2, len(QUANTITIES))
    assert_array_equal(values[:, 0], velocities.longitudinal)
    assert_array_equal(values[:, 1], velocities.transverse)
    assert_allclose(
        values[:, 2], [state[i].scales.frequency * (2.0 * math.pi) for i in (0, 1)], rtol=1e-12
    )


@pytest.mark.parametrize(
    ("lattice", "shape"),
    [("fcc", (4, 4, 4)), pytest.param("hcp", (4, 4, 3), marks=pytest.mark.exhaustive)],
)
@pytest.mark.parametrize("kind", only(KINDS[:1], KINDS))
def test_in_space_it_is_the_mean_of_the_simulation_over_all_directions(steel, lattice, shape, kind):
    packing = gp.Packing(steel, 8e-3, spread=gp.Normal(6e-7), lattice=lattice)
    loads = {"force": (5.0, 20.0), "pressure": (3e5, 1e6), "overlap": (1e-6, 2e-6)}[kind]
    values, errors = collect(packing, kind, loads, shape, 3, 7).means()
    state = getattr(gp.DirectSimulation(packing, shape, 7, 3), f"at_{kind}")(np.array(loads))
    assert_allclose(values, observe(state), rtol=1e-12)
    moduli = gp.moduli(state)
    density = packing.effective_density
    averages = moduli.voigt
    assert_allclose(
        values[:, 0], np.sqrt((averages.bulk + 4.0 / 3.0 * averages.shear) / density), rtol=1e-12
    )
    assert_allclose(values[:, 1], np.sqrt(averages.shear / density), rtol=1e-12)
    assert_allclose(values[:, 2], np.sqrt(state.normal_stiffness / packing.mass), rtol=1e-12)
    assert_allclose(errors[:, 1], 0.5 * moduli.shear_error / averages.shear, rtol=1e-9)


def test_samples_may_be_added_one_by_one(rough):
    apart = collect(rough, "force", (18.446,), (8, 8), 1, 3)
    for count in (2, 1):
        apart.add(count)
    assert_array_equal(apart.means(), collect(rough, "force", (18.446,), (8, 8), 4, 3).means())


# -- what the regression is worth ------------------------------------------------------------------


@pytest.mark.exhaustive
def test_control_variates_leave_the_part_of_the_chance_that_is_promised(many):
    left = many.means()[1] / (noise(many) / math.sqrt(many.samples))
    assert np.all(left < [[0.25], [0.12], [0.12]])


@pytest.mark.exhaustive
def test_two_ensembles_of_other_samples_agree_within_their_errors(rough, unit, many):
    (one, error), (other, chance) = (
        found.means()
        for found in (many, collect(rough, "force", many.load.values, (12, 12), 32, 10_000))
    )
    pulls = (other / one - 1.0) / np.hypot(error, chance)
    assert np.max(np.abs(pulls)) < 4.0
    assert np.sqrt(np.mean(pulls**2)) < 2.0


@pytest.mark.exhaustive
def test_small_samples_with_control_variates_agree_with_one_large_one(rough, unit, many):
    """That the size of a sample does not matter, to the chance in 96 x 96 balls."""
    state = gp.DirectSimulation(rough, (96, 96), 77).at_force(3.0 * unit)
    values, errors = many.means()
    chance = np.hypot(12.0 * noise(many)[1] / 96.0, errors[1])
    assert np.all(np.abs(observe(state) / values[1] - 1.0) < 3.5 * chance)


@pytest.mark.parametrize(
    ("lattice", "shape"),
    [
        ("triangular", (12, 12)),
        pytest.param("fcc", (6, 6, 6), marks=pytest.mark.slow),
        pytest.param("hcp", (6, 6, 4), marks=pytest.mark.exhaustive),
    ],
)
def test_without_friction_the_second_order_is_that_of_the_effective_medium(steel, lattice, shape):
    """f* = x^(3/2) (1 + r/(64 x^2)): the medium is exact to that order, the averaged lattice has r
    = 0.
    """
    packing = gp.Packing(steel, 8e-3, spread=gp.Uniform(2.04e-6), friction=False, lattice=lattice)
    force = 100.0 * packing.law.coefficient * packing.width**1.5
    values, errors = collect(packing, "force", (force,), shape, 32).means()
    medium, lattice = (
        observe(one(packing).at_force(force))[2] for one in (gp.EffectiveMedium, gp.AveragedLattice)
    )
    correction = lattice / values[0, 2] - 1.0
    assert errors[0, 2] < 0.02 * abs(correction)
    assert abs(medium / values[0, 2] - 1.0) < 0.02 * abs(correction)


@pytest.mark.exhaustive
@pytest.mark.parametrize("kind", KINDS)
def test_kinds_of_load_that_are_one_state_give_one_answer(rough, many, unit, kind):
    """At f* = 3; the mean overlap as a load gives the same velocities, to the second order of the
    chance.
    """
    force = 3.0 * unit
    overlap = float(gp.DirectSimulation(rough, (12, 12), 0, 48).at_force(force).overlap)
    load = {"force": force, "pressure": math.sqrt(3.0) * force / 8e-3, "overlap": overlap}[kind]
    (values, errors), (expected, known) = (
        collect(rough, kind, (load,), (12, 12), 32, 500).means(),
        many.means(),
    )
    chance = noise(many)[1]
    # the mean overlap of plain samples is uncertain too, about v ~ delta^(1/4)
    tolerance = (
        4.0 * np.hypot(errors[0], known[1]) + chance**2 + 0.5 * chance[2] / math.sqrt(many.samples)
    )
    assert np.all(np.abs(values[0] / expected[1] - 1.0) < tolerance)


def test_a_lattice_that_is_not_simulated_has_no_ensemble(steel):
    with pytest.raises(InputError, match="not simulated"):
        collect(
            gp.Packing(steel, 8e-3, spread=gp.Uniform(2e-6), lattice="square"),
            "force",
            (1.0,),
            (8, 8),
            1,
        )
