"""The estimate of a simulation's memory and time."""

from __future__ import annotations

import tracemalloc

import numpy as np
import pytest

import granphon as gp
from granphon import cost
from granphon.cost import estimate

STEEL = gp.Material(young_modulus=211.65e9, poisson_ratio=0.276, density=7840.0)
WIDTH = 2.04e-6


def simulation(shape=(64, 64), friction=True, samples=1):
    return gp.DirectSimulation(gp.Packing(STEEL, 8e-3, gp.Uniform(WIDTH), friction=friction), shape, samples=samples)


@pytest.mark.parametrize("friction", [False, True])
@pytest.mark.parametrize(("samples", "loads"), [(1, 1), (1, 24), (12, 1)])
def test_memory_is_what_the_arrays_take(friction, samples, loads):
    medium = simulation((128, 128), friction, samples)
    force = np.linspace(5.0, 6.0, loads)
    guess = estimate(medium, "force", force)
    medium.at_force(5.0)  # what is loaded once is not counted
    tracemalloc.start()
    gp.sound_velocities(medium.at_force(force))
    peak = tracemalloc.get_traced_memory()[1]
    tracemalloc.stop()
    # less than what is announced, and not less than half of it
    assert 0.5 < peak / (guess.memory - cost._BASE) < 1.0


def test_every_equilibrium_takes_time():
    one, many = estimate(simulation(), "force", 5.0), estimate(simulation(samples=3), "force", np.linspace(2.0, 5.0, 10))
    assert many.equilibria == 30
    assert many.seconds > 25 * one.seconds


def test_the_kinds_of_load_agree():
    medium = simulation()
    for spacing in (0.5, 1.0, 3.0):
        overlap = (spacing - 0.5) * WIDTH
        state = medium.at_overlap(overlap)
        loads = {"overlap": overlap, "force": state.force, "pressure": state.pressure}
        force, *rest = [cost._reduced_force(medium, kind, np.atleast_1d(load)) for kind, load in loads.items()]
        for other in rest:
            assert force == pytest.approx(other, rel=0.02)
            assert other == pytest.approx(state.reduced_force, rel=1e-12)


def test_time_grows_towards_the_threshold_with_size_and_with_friction():
    times = estimate_seconds([3.0, 1.0, 0.7, 0.5, 0.42, 0.363, 0.3])
    assert np.all(np.diff(times[:-1]) > 0.0)
    assert times[-1] > times[-2]  # below the threshold: taken to be at it
    at = (0.5 - 0.5) * WIDTH
    small, large = (estimate(simulation(shape), "overlap", at) for shape in ((64, 64), (1024, 1024)))
    assert large.seconds == pytest.approx(256 * small.seconds)
    bare = estimate(simulation(friction=False), "overlap", at)
    assert bare.seconds < small.seconds
    assert estimate(simulation(), "overlap", at, moduli=False).seconds < bare.seconds


def estimate_seconds(spacings):
    return [estimate(simulation(), "overlap", (spacing - 0.5) * WIDTH).seconds for spacing in spacings]


def test_the_steps_that_it_counts_are_those_of_the_solver():
    spacings = np.array([0.42, 0.5, 0.7, 1.0])
    counts = [simulation().at_overlap((a - 0.5) * WIDTH).sample.equilibrium for a in spacings]
    # a step of Newton's method costs about as much as four of conjugate gradients
    done = np.array([state.conjugate + 4 * state.newton for state in counts], float)
    claimed = cost._steps(np.array([state.force for state in counts]))
    ratio = done / claimed
    assert np.max(ratio) / np.min(ratio) < 3.0


def test_equal_balls_cost_next_to_nothing():
    medium = gp.DirectSimulation(gp.Packing(STEEL, 8e-3), (64, 64))
    assert estimate(medium, "force", 5.0).seconds < 0.2 * estimate(simulation(), "force", 5.0).seconds


@pytest.mark.parametrize(
    ("seconds", "text"), [(0.123, "0.12 s"), (100.0, "100 s"), (200.0, "3.3 min"), (1e4, "2.8 h"), (1e6, "12 days")]
)
def test_durations_are_read_at_a_glance(seconds, text, monkeypatch):
    monkeypatch.setattr(cost, "_second_per_ball", lambda: 1.0)
    assert cost.Cost(2.5e9, seconds, 10_000_000, 1).text == f"simulation of 10,000,000 balls: about 2.5 GB and {text}"


def test_nothing_is_tried_until_time_is_asked_for(monkeypatch):
    monkeypatch.setattr(cost, "_second_per_ball", None)
    guess = estimate(simulation(), "force", 5.0)
    assert guess.memory > 0.0
    with pytest.raises(TypeError):
        _ = guess.seconds


def test_the_text_counts_equilibria():
    assert ", 4 equilibria: about" in estimate(simulation(samples=2), "force", [1.0, 2.0]).text


def test_the_memory_of_this_machine():
    assert cost.machine_memory() > 1e8  # infinite where the system does not say
