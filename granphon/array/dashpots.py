"""Steps of the load in which balls give way: dashpots between neighbours slow them down until they are at rest again.

Where a ball loses what held it, there is no equilibrium near the one before, and Newton's method does not find the next one.
A real ball falls, and what damps it brings it to rest. Here dashpots do: in a step they resist what balls move against each
other, with ``drag`` times the displacement over the step (in units of c W^(1/2)); slips meet eta times as much. So a step
with weaker dashpots is one of a longer time. They are weakened from step to step under the same load, until the array is in
balance without them. While balls fall, and too long a step finds no balance, they are made stronger again.

Dashpots take what the load gives and contacts neither store nor lose, and no less than they would if balls moved evenly
through the step: where balls hardly move, the error of the work of the load is larger.

A loading history may begin at the gas: balls apart on their sites, pressed with friction until they stand. Where too few
balls touch, nothing holds them, and no equilibrium is unique. A real array then comes to rest by what damps it, and so does
this one: in each step of the load, dashpots resist what neighbours move against each other. Balls that nothing pushes stay
where they are. The overlap grows by :data:`STEP` at a time from the first contact on. When the mean force has come to
:data:`STANDING_FORCE`, about that at a* = 1/2, the overlap is held, and the balls come to rest or give way, in steps of time
that grow: dashpots are weakened from step to step. When they bear next to nothing they are taken away. If the array then
bears at least half of this force, in balance, it stands, and its history begins there; if it gives way before, or is not at
rest after many steps, it is pressed on.

In the true geometry contacts push balls aside, with W/d of their force. In space, where too few contacts resist, as in sc of
which half are open, an array gives way however slowly it is let go. Dashpots are there not weakened below several times that
stiffness: if balls move faster from one step to the next, the array gives way.

What the load gives and contacts neither store nor lose, dashpots take; it counts as lost.

The drag, the step and this force are conventions. What f* at higher loads owes to them is a matter of percents in small
arrays; the tests state it.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from granphon.array.load_step import FAST_LIMITS
from granphon.array.pressing import PressedArray
from granphon.array.stencils import dot
from granphon.array.stepper import Stepper
from granphon.array.steps import ReducedLoad
from granphon.base.errors import ConvergenceError, message

#: stiffness of dashpots within a step, at first
DRAG = 1e-2
#: factor by which dashpots are weakened from one step to the next
WEAKER = 0.3
#: largest number of steps with dashpots, those that find no balance included
_MOST_STEPS = 60
#: number of steps, after each of which forces on dashpots have become smaller, after which it is tried to do without
_CALM = 3
#: name of this start
GAS = "gas"
#: change of the overlap in a step
STEP = 0.0125
#: mean force at which an array that has been a gas has to stand
STANDING_FORCE = 2e-2
#: largest number of steps at held overlap
_MOST_SETTLINGS = 30
#: largest force of a dashpot, over the mean force, with which they are taken away
_NEXT_TO_NOTHING = 1e-3
#: largest motion in a step with the weakest dashpots with which they are taken away there, in W
_STILL = 1e-3
#: weakest dashpots in the true geometry of space, over W/d times the mean force: contacts push balls aside with about that
#: stiffness
_ABOVE_PUSH = 10.0
#: largest overlap at which an array of different balls is still a gas
_MOST_OVERLAP = 2.0


def relax_overdamped(stepper: Stepper, trail: Sequence[PressedArray], load: ReducedLoad) -> PressedArray | None:
    """Return the state in which balls come to rest under a load, from the last of the ``trail``; None if it is not found."""
    drag, too_weak, push, calm = DRAG, 0.0, math.inf, 0
    for _ in range(_MOST_STEPS):
        after = _settle(stepper, trail, load, drag)
        if after is None:
            if calm or drag >= DRAG:  # balls do not fall: shorter steps of the load help
                return None
            too_weak, drag = drag, drag / WEAKER
            continue
        before, push = push, drag * after.measure_motion(trail[-1])
        trail, calm = [after], calm + 1 if push <= before else 0
        if calm:
            too_weak = 0.0
            if calm % _CALM == 0 and (at_rest := _settle(stepper, trail, load, 0.0)) is not None:
                return at_rest
        if WEAKER * drag > too_weak:
            drag *= WEAKER
    return None


def _settle(stepper: Stepper, trail: Sequence[PressedArray], load: ReducedLoad, drag: float) -> PressedArray | None:
    """Return the state after one step, with at least the energy that dashpots take if balls move evenly."""
    after = stepper.settle(trail, load, drag)
    if after is None:
        return None
    return replace(after, damped=max(after.damped, trail[-1].damped + _measure_work(trail[-1], after, drag)))


def _measure_work(before: PressedArray, after: PressedArray, drag: float) -> float:
    """Return the work done on dashpots if balls move evenly through a step, a mean over contacts."""
    loss = before.contacts.overlaps - after.contacts.overlaps + after.overlap - before.overlap
    slips = after.contacts.slips - before.contacts.slips
    return drag * (dot(loss, loss) + after.law.mindlin_ratio * dot(slips, slips)) / loss.size


def press_gas(stepper: Stepper, contact: float) -> PressedArray:
    """Return the first state at which an array stands with friction, from balls on their sites, at the overlap ``contact``.

    Raises :class:`~granphon.base.errors.ConvergenceError` if it stands at no overlap below two widths, or if balls that
    dashpots slow down do not come into balance.
    """
    stencils = stepper.geometry.stencils
    here = stepper.place(np.zeros((stencils.n_balls * len(stencils.shape), *stencils.shape)), contact)
    damped = replace(stepper, drag=DRAG)
    while here.overlap < _MOST_OVERLAP:
        try:
            here = damped.step([here], ReducedLoad(overlap=here.overlap + STEP))
        except ConvergenceError as error:
            what = f"the balls, pressed from the gas, are not in balance beyond an overlap of {here.overlap:.3g} widths"
            why, mend = "Too few contacts hold them", "Take another seed, or another friction coefficient"
            if stepper.geometry.ratio:
                why = "In the true geometry forces turn with their contacts, and turn balls that too few contacts hold"
                mend = 'Take the geometry "lattice"'
            raise ConvergenceError(message(what, why, mend)) from error
        if here.force >= STANDING_FORCE:
            at_rest = _come_to_rest(damped, here)
            if at_rest is not None:
                return at_rest
    raise ConvergenceError(
        message(
            f"the balls still do not stand at an overlap of {here.overlap:.3g} widths",
            "Friction does not hold what the lattice leaves loose",
            "Raise the friction coefficient",
        )
    )


def _come_to_rest(damped: Stepper, here: PressedArray) -> PressedArray | None:
    """Return the state to which balls come without dashpots at the same overlap, None if they give way."""
    load, drag, ratio, moved = ReducedLoad(overlap=here.overlap), damped.drag, damped.geometry.ratio, 0.0
    pushed = ratio > 0.0 and len(damped.geometry.stencils.shape) == 3
    weakest = min(drag, _ABOVE_PUSH * ratio * here.force) if pushed else 0.0
    for _ in range(_MOST_SETTLINGS):
        stronger, slower, drag = drag, moved, max(WEAKER * drag, weakest)
        after = damped.settle([here], load, drag, FAST_LIMITS)
        if after is None or after.force < 0.5 * STANDING_FORCE:
            return None
        here, moved = after, after.measure_motion(here)
        if drag == stronger and moved > slower:
            return None
        if drag == stronger and moved < _STILL if pushed else drag * moved < _NEXT_TO_NOTHING * here.force:
            at_rest = damped.settle([here], load, 0.0, FAST_LIMITS)
            return at_rest if at_rest is not None and at_rest.force >= 0.5 * STANDING_FORCE else None
    return None
