"""Steps in which dashpots slow balls down: the same states as Newton's method, falls, and the energy of both."""

from __future__ import annotations

import itertools
import math

import numpy as np
import pytest

from granphon.array.friction import Contacts, FrictionLaw, PressedArray
from granphon.array.geometry import ReducedLoad
from granphon.array.stepper import DRAG, Stepper
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
        direct, slow = paths.step(trail, load), paths.stepper.relax_overdamped(trail, load)
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


class Falling:
    """A history in which a ball falls through ``way`` W: it moves by what dashpots leave it, and not too far in a step."""

    def __init__(self, way, limit=math.inf):
        self.way, self.limit, self.drags = way, limit, []

    def settle(self, trail, load, drag):
        here = trail[-1].overlap
        self.drags.append(drag)
        left = self.way - here
        far = left if drag == 0.0 else min(left, 1e-4 * (here + 1e-2) / drag)
        return None if far > self.limit else place_at(here + far)


def place_at(overlap):
    contacts = Contacts(np.array([[0.0]]), np.array([[[overlap]]]), np.zeros((1, 1, 1)))
    return PressedArray(overlap, np.zeros((1, 1)), contacts, FrictionLaw(0.8))


def test_dashpots_are_made_stronger_while_a_ball_falls():
    falling = Falling(1.0, 0.05)
    after = Stepper.relax_overdamped(falling, [place_at(0.0)], ReducedLoad(overlap=0.0))
    assert after.overlap == pytest.approx(1.0, abs=0.05)
    assert any(later > drag > 0.0 for drag, later in itertools.pairwise(falling.drags))
    assert falling.drags[-1] == 0.0


def test_dashpots_give_up_where_nothing_falls_or_a_fall_has_no_end():
    stuck = Falling(1.0, 1e-6)
    assert Stepper.relax_overdamped(stuck, [place_at(0.0)], ReducedLoad(overlap=0.0)) is None
    assert stuck.drags == [DRAG]
    endless = Falling(math.inf, 0.05)
    assert Stepper.relax_overdamped(endless, [place_at(0.0)], ReducedLoad(overlap=0.0)) is None
    assert len(endless.drags) < 100
