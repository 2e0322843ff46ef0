"""Steps in which dashpots slow balls down: the same states as Newton's method, falls, and the energy of both."""

from __future__ import annotations

import math

import numpy as np
import pytest

from granphon.array.geometry import ReducedLoad
from granphon.balls.lattices import FCC, TRIANGULAR
from tests.array.test_friction_history import history, ramp, run


def kick(paths, state, far):
    """A state of the same overlap whose balls are away from rest, by ``far`` W in some directions, and do not turn."""
    moved = state.balls.reshape(paths.stencils.n_balls, -1, *paths.stencils.shape)[:, paths.stencils.motions.translating]
    rng = np.random.default_rng(0)
    return paths.stepper.place(moved + far * rng.uniform(-1.0, 1.0, moved.shape), state.overlap)


@pytest.mark.parametrize(
    ("lattice", "shape", "mu"), [(TRIANGULAR, (6, 6), math.inf), (TRIANGULAR, (6, 6), 0.2), (FCC, (3, 3, 2), 0.2)]
)
@pytest.mark.parametrize("by_force", [False, True])
def test_dashpots_lead_to_the_forces_of_newtons_method_in_short_steps(lattice, shape, mu, by_force):
    # an array in which no contact begins to slide within the steps from here on: it would change forces to first order. In
    # the arrays of the seeds 1 to 4 the distance falls by 2.5 to 30 with a quarter of the step, in most by more than 8
    paths = history(shape, mu, lattice=lattice, seed=3)
    trail, off, taken = run(paths, ramp(0.5, 0.7, steps=6))[-2:], [], []
    for step in (0.1, 0.05, 0.025):
        here = trail[-1]
        load = ReducedLoad(force=here.force * (1.0 + 2.0 * step)) if by_force else ReducedLoad(overlap=here.overlap + step)
        direct, slow = paths.stepper.step(trail, load), paths.stepper.relax_overdamped(trail, load)
        assert slow is not None
        assert slow.residual <= 1e-9
        assert paths.stepper.measure(slow, load) == pytest.approx(paths.stepper.measure(direct, load), rel=1e-12)
        off.append(np.max(np.abs(slow.contacts.forces - direct.contacts.forces)) / here.force)
        taken.append((slow.damped - here.damped) / (slow.work - here.work))
        assert taken[-1] > 0.0
    assert off[0] < 2e-2
    assert off[2] < 0.3 * off[0]
    assert taken[0] < 5e-3
    assert taken[2] < 0.6 * taken[0]


@pytest.mark.claim("friction-falls")
@pytest.mark.parametrize("lattice", [TRIANGULAR, FCC])
@pytest.mark.parametrize("mu", [0.2, math.inf])
def test_balls_that_fall_come_to_rest_and_lose_what_they_do_not_store(lattice, mu):
    paths = history((6, 6) if lattice is TRIANGULAR else (3, 3, 2), mu, lattice=lattice, seed=1)
    here = kick(paths, run(paths, ramp(0.5, 0.7, steps=3))[-1], 0.2)
    load = ReducedLoad(overlap=here.overlap)
    after = paths.stepper.relax_overdamped([here], load)
    assert after is not None
    assert after.residual <= 1e-9
    assert after.work == 0.0
    assert after.damped > 0.3 * (here.stored - after.stored)
    assert after.dissipated == pytest.approx(here.stored - after.stored, rel=1e-9)


@pytest.mark.claim("friction-falls")
def test_a_fall_ends_where_strong_dashpots_would_end_it_after_a_long_time():
    paths = history((4, 4), 0.2, seed=1)
    here = kick(paths, run(paths, ramp(0.5, 0.7, steps=3))[-1], 0.1)
    load = ReducedLoad(overlap=here.overlap)
    after, slow = paths.stepper.relax_overdamped([here], load), here
    for drag in (*[1.0] * 40, *[0.3] * 40, *[0.1] * 200):
        slow = paths.stepper.settle([slow], load, drag)
    slow = paths.stepper.settle([slow], load, 0.0)
    assert after.force == pytest.approx(slow.force, rel=1e-3)
    assert here.force > 1.05 * slow.force
    assert after.damped == pytest.approx(slow.damped, rel=3e-2)
