"""One step of the load of an array with friction: from the states before it to the equilibrium under a new load.

Newton's method (:mod:`granphon.array.load_step`) solves the balance of forces and torques, from the polynomial in the load
through the last states, three at most. Where it fails, another method may be given; where that fails too, the step is taken
in two halves.

The work of the load is what the contacts store and lose. Where dashpots act, it is found as the integral of f* dy for each
contact, and they take the rest. Between two states f* is then taken from the parabola through them and the one before.
"""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from granphon.array.equilibrium import THRESHOLD_FORCE
from granphon.array.friction import Contacts, FrictionLaw
from granphon.array.geometry import Geometry, Place, find_boundary_force
from granphon.array.load_step import FAST_LIMITS, SLOW_LIMITS, FixedLimitSettings, LoadStep, is_balanced
from granphon.array.patches import Patches
from granphon.array.pressing import PressedArray, Trial, continue_polynomial, integrate_last
from granphon.array.steps import ReducedLoad
from granphon.base.errors import ConvergenceError, InputError, message

Array = NDArray[np.float64]
#: number of times that a step of the load is halved where Newton's method fails, and where f* is not yet accurate
MOST_HALVINGS = 12
#: number of halvings below which limits of sliding are not looked for again, as they were in the whole step: it takes long
_LAG_HALVINGS = 6
#: number of steps without a balance after which a load is given up
_MOST_FAILED = 40


def find_aim(load: ReducedLoad) -> float:
    """Return what a load prescribes: the overlap, or the force."""
    return load.force if load.overlap is None else load.overlap


@dataclass
class Stepper:
    """Steps of the load of one array.

    Parameters
    ----------
    geometry : of the contacts.
    law : of the contacts.
    from_gas : whether balls were pressed from the gas, so that friction alone may hold them.
    drag : stiffness of dashpots between neighbours within one step; the state reached is no equilibrium of the contacts
        unless it is zero.
    """

    geometry: Geometry
    law: FrictionLaw
    from_gas: bool = False
    drag: float = 0.0

    def __post_init__(self) -> None:
        self._patches = Patches(self.geometry.stencils)
        self._located: deque[tuple[Array, Place]] = deque(maxlen=3)

    def place(self, displacements: Array, overlap: float, residual: float = 0.0) -> PressedArray:
        """Return balls with displacements (n p, L1, ..., Lp), without rotations and tangential forces."""
        motion = self.geometry.stencils.spread(displacements)
        overlaps, slips = self.geometry.begin(motion, overlap)
        contacts = Contacts(overlaps, slips, np.zeros_like(slips))
        return PressedArray(overlap, motion, contacts, self.law, residual)

    def halve(self, here: PressedArray, load: ReducedLoad) -> ReducedLoad:
        """Return the load half-way from a state to another load."""
        if load.overlap is None:
            return load._replace(force=0.5 * (self.measure(here, load) + load.force))
        return load._replace(overlap=0.5 * (here.overlap + load.overlap))

    def step(
        self, trail: Sequence[PressedArray], load: ReducedLoad,
        relax_overdamped: Callable[[Sequence[PressedArray], ReducedLoad], PressedArray | None] | None = None,
    ) -> PressedArray:  # fmt: skip
        """Return the equilibrium under a load; ``trail`` holds the last states before it, one to three.

        Where Newton's method fails, the state that ``relax_overdamped`` finds is taken. If there is none, the load is
        reached in two steps or more.
        """
        if load.overlap is None and not load.force > 0.0:
            raise InputError(message(f"a mean contact force of f* = {load.force:.3g} is not above zero"))
        ahead, halvings, failed = [load], 0, 0
        while ahead:
            here = trail[-1]
            # where friction alone holds balls, shorter steps of the load help sooner
            patience = FAST_LIMITS if self.from_gas else SLOW_LIMITS
            lags = None if relax_overdamped and 0 < halvings < _LAG_HALVINGS else patience
            trial = self._make_step(here, ahead[-1], self.drag).solve(*self._extrapolate(trail, ahead[-1]), lags)
            if is_balanced(trial):
                trail = [*trail[-2:], self._damp(trail, trial) if self.drag else self._arrive(here, trial)]
            elif relax_overdamped and trial.left < math.inf and (at_rest := relax_overdamped(trail, ahead[-1])) is not None:
                trail = [at_rest]
            elif trial.left == math.inf and here.force < THRESHOLD_FORCE:
                last = f"at f* = {here.force:.3g} and an overlap of {here.overlap:.6g} widths they have nearly come apart"
                raise self.explain(load, f"no load is left on the balls; {last}", "End the path before this load")
            elif halvings == MOST_HALVINGS or failed == _MOST_FAILED or self.measure(here, ahead[-1]) == find_aim(ahead[-1]):
                last = f"it was last at an overlap of {here.overlap:.6g} widths, f* = {here.force:.3g}"
                raise self.explain(load, f"its forces are not in balance, however short the steps; {last}")
            else:
                halvings, failed = halvings + 1, failed + 1
                ahead.append(self.halve(here, ahead[-1]))
                continue
            halvings = max(0, halvings - 1)
            ahead.pop()
        return trail[-1]

    def settle(
        self, trail: Sequence[PressedArray], load: ReducedLoad, drag: float, lags: FixedLimitSettings | None = None
    ) -> PressedArray | None:
        """Return the state to which balls come from the last of the ``trail`` in one step, slowed by dashpots.

        It is None if it is not found. Unlike :meth:`step`, it is not sought in shorter steps.
        """
        trial = self._make_step(trail[-1], load, drag).solve(*self._extrapolate(trail[-1:], load), lags)
        return self._damp(trail, trial) if is_balanced(trial) else None

    def _make_step(self, here: PressedArray, load: ReducedLoad, drag: float) -> LoadStep:
        return LoadStep(self.geometry, self.law, here, self.locate(here), load, self._patches, drag)

    @staticmethod
    def name_load(load: ReducedLoad) -> str:
        """Return a load in words."""
        if load.overlap is None:
            return f"f* = {load.force:.6g}"
        return f"an overlap of {load.overlap:.6g} widths (a* = {load.overlap + 0.5:.6g})"

    def explain(self, load: ReducedLoad, why: str, mend: str = "") -> ConvergenceError:
        """Return the error of a load that is not reached."""
        what = f"the loading with friction has not reached {self.name_load(load)}"
        other = "take another seed" if self.from_gas else "start at a higher load"
        mend = mend or f"End the path before this load, or {other}"
        return ConvergenceError(message(what, why[0].upper() + why[1:], mend))

    def locate(self, here: PressedArray) -> Place:
        """Return the configuration of a state; those of the last three are kept."""
        for balls, place in self._located:
            if balls is here.balls:
                return place
        place = self.geometry.place(here.balls, here.overlap)
        self._located.append((here.balls, place))
        return place

    def measure(self, state: PressedArray, load: ReducedLoad) -> float:
        """Return of a state what the load prescribes: its overlap, its force, or its force under the same pressure."""
        if load.overlap is not None:
            return state.overlap
        if load.on_boundary:
            return find_boundary_force(self.locate(state), state.contacts.forces, state.contacts.shears)
        return state.force

    def _extrapolate(self, trail: Sequence[PressedArray], load: ReducedLoad) -> tuple[Array, float]:
        """Return the motion and overlap to begin with, on the parabola through the last three states, or on a line."""
        weights = continue_polynomial([self.measure(one, load) for one in trail], find_aim(load))
        states = trail[-len(weights) :]
        balls = np.sum([w * one.balls for w, one in zip(weights, states, strict=True)], axis=0)
        y = sum(w * one.overlap for w, one in zip(weights, states, strict=True)) if load.overlap is None else load.overlap
        return balls, float(y)

    def _arrive(self, here: PressedArray, trial: Trial) -> PressedArray:
        """Return the state at the end of a step, with energies."""
        slid, loosened = self.law.lost(here.contacts, trial.contacts)
        state = PressedArray(
            trial.overlap, trial.balls, trial.contacts, self.law, trial.left, here.work + slid + loosened, here.slid + slid,
            here.loosened + loosened, here.damped, here.steps + 1, here.newton + trial.newton, here.krylov + trial.krylov,
        )  # fmt: skip
        self._located.append((trial.balls, trial.place))
        return replace(state, work=state.work + state.stored - here.stored)

    def _damp(self, trail: Sequence[PressedArray], trial: Trial) -> PressedArray:
        """Return the state after a step in which dashpots take what the load gives and contacts neither store nor lose."""
        state = self._arrive(trail[-1], trial)
        states = [*trail[-2:], state]
        presses = [self.locate(one).press(one.contacts.forces, one.contacts.shears) for one in states]
        rest = integrate_last([one.overlap for one in states], presses) - (state.work - trail[-1].work)
        return replace(state, work=state.work + rest, damped=state.damped + rest)
