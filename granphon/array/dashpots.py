"""Steps of the load in which balls give way: dashpots between neighbours slow them down until they are at rest again.

Where a ball loses what held it, there is no equilibrium near the one before, and Newton's method does not find the next one.
A real ball falls, and what damps it brings it to rest. Here dashpots do: in a step they resist what balls move against each
other, with ``drag`` times the displacement over the step (in units of c W^(1/2)); slips meet eta times as much. So a step
with weaker dashpots is one of a longer time. They are weakened from step to step under the same load, until the array is in
balance without them. While balls fall, and too long a step finds no balance, they are made stronger again.

Dashpots take what the load gives and contacts neither store nor lose, and no less than they would if balls moved evenly
through the step: where balls hardly move, the error of the work of the load is larger.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace

from granphon.array.pressing import PressedArray
from granphon.array.stencils import dot
from granphon.array.stepper import Stepper
from granphon.array.steps import ReducedLoad

#: stiffness of dashpots within a step, at first
DRAG = 1e-2
#: factor by which dashpots are weakened from one step to the next
WEAKER = 0.3
#: largest number of steps with dashpots, those that find no balance included
_MOST_STEPS = 60
#: number of steps, after each of which forces on dashpots have become smaller, after which it is tried to do without
_CALM = 3


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
