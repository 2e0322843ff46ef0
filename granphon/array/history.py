"""Quasi-static loading of an array of balls with friction: a path of loads, each equilibrium found
from the one before.

Directions of contacts are those of the lattice, or the true ones (:mod:`granphon.array.geometry`).
Units are those of :mod:`granphon.array.equilibrium`, W and c W^(3/2). Contacts follow
:mod:`granphon.contacts.friction`. With friction the forces depend on the way to the load, which is
taken in steps. At the end of each step the forces and torques on every ball are in balance,

    C_n^T f = C_s^T T

where C_n and C_s are the rows of C for elongations and slips. Newton's method solves this balance
(:mod:`granphon.array.load_step`). If it fails, dashpots slow the balls down
(:mod:`granphon.array.stepper`); if no balance is found with dashpots either, the step is taken in
two halves. Steps are also halved until a further halving changes f* and the lost energies by
little. The work of the load is then the integral of f* dy for each contact.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from granphon.array.equilibrium import Equilibrium
from granphon.array.geometry import LOAD_TOLERANCE
from granphon.array.options import GAS, REFINEMENT_TOLERANCE, START_SPACING, ReducedLoad
from granphon.array.pressed_array import PressedArray
from granphon.array.pressed_place import PressedGeometry
from granphon.array.rest import bring_to_rest
from granphon.array.stencils import Stencils, dot
from granphon.array.stepper import Stepper, find_aim, goes_on, weigh_states
from granphon.array.true_equilibrium import TrueEquilibrium
from granphon.base.arrays import Array
from granphon.base.errors import ConvergenceError, InputError
from granphon.contacts.friction import Contacts, FrictionLaw
from granphon.statics.options import LoadingOptions


@dataclass(frozen=True)
class _Part:
    """Part of the way to a load, which is taken in one step if the step changes little when it is
    halved.

    Attributes
    ----------
    load : load at the end of the part.
    allowed_change : relative change of f* that halving the step may make.
    halvings : number of halvings of the way that have led to the part.
    """

    load: ReducedLoad
    allowed_change: float
    halvings: int = 0

    def halve(self, middle: ReducedLoad, can_keep_change: bool) -> list[_Part]:
        """Return the two halves of the part, which meet at the load ``middle``; the nearest is the
        last.

        Each half may have half of the change. Where a ball loses its hold and falls, one of the
        halves has all of it: so each half may have as much as the part if ``can_keep_change`` is
        true, as for short steps.
        """
        change = self.allowed_change if can_keep_change else 0.5 * self.allowed_change
        return [_Part(load, change, self.halvings + 1) for load in (self.load, middle)]


@dataclass
class LoadingHistory:
    """Loading of one array along a path.

    Parameters
    ----------
    deviations : x = Delta/W, of mean zero; (L1, ..., Lp), or (n, L1, ..., Lp) if a cell has n > 1
        balls.
    stencils : stencils of the array, with the shear stiffness ratio eta above zero.
    friction_coefficient : mu of the contacts, from zero to infinity; both ends are allowed.
    tolerance : greatest relative change of f* that halving all steps from one load of the path to
        the next may make; if it is infinite, steps are not halved for accuracy.
    start : where the history begins, with rotations and tangential forces zero. It is a state at
        rest without friction; or the load under which balls come to rest without friction, by
        default that of a* = 1/2; or "gas". In the true geometry a state at rest in the directions
        of the lattice is only the start of a search for rest in the true geometry. In a gas the
        balls lie apart on their sites, and are pressed with friction until they stand
        (:mod:`granphon.array.stepper`): this is the start for lattices that only friction holds.
    geometry : geometry of the contacts; by default that of the lattice, the limit of small spread.
    options : numbers of the loading.

    Attributes
    ----------
    stepper : what takes the single steps.
    """

    deviations: Array
    stencils: Stencils
    friction_coefficient: float = math.inf
    tolerance: float = REFINEMENT_TOLERANCE
    start: Equilibrium | ReducedLoad | str | None = None
    geometry: PressedGeometry | None = None
    options: LoadingOptions = field(default_factory=LoadingOptions)

    def __post_init__(self) -> None:
        self._law = FrictionLaw(self.stencils.mindlin_ratio, self.friction_coefficient)
        geometry = self.geometry or PressedGeometry(self.stencils, self.deviations)
        self.stepper = Stepper(geometry, self._law, self.start == GAS, self.options)

    @property
    def ratio(self) -> float:
        """W/d; zero where contacts keep the directions of the lattice."""
        return self.stepper.geometry.ratio

    # -- the path ----------------------------------------------------------------------------------

    def begin(self) -> PressedArray:
        """Return the state at the start; see ``start``.

        Raises :class:`~granphon.base.errors.InputError` if the start is below the threshold, where
        no load is carried, and :class:`~granphon.base.errors.ConvergenceError` if no rest is found
        there, or balls pressed from the gas do not stand; in the true geometry also the other
        errors of :func:`~granphon.array.rest.bring_to_rest`.
        """
        if self.start == GAS:
            largest_mean = float(np.max(self.stencils.average_pairs(self.deviations)))
            return self.stepper.press_gas(-largest_mean)  # from where the first two balls touch
        smooth = Stencils(
            self.stencils.shape, workers=self.stencils.workers, lattice=self.stencils.lattice
        )
        start = self.start
        if start is None:
            start = ReducedLoad(overlap=START_SPACING - 0.5)  # the overlap y = a* - 1/2
        if isinstance(start, Equilibrium):
            state = start
            load = ReducedLoad(overlap=state.overlap)
        else:
            assert isinstance(start, ReducedLoad)
            load = start
            state = self._find_rest_without_friction(load, smooth)
        ratio = self.ratio
        if ratio and not (isinstance(state, TrueEquilibrium) and state.ratio == ratio):
            state = bring_to_rest(self.deviations, load, smooth, state, ratio=ratio)
        return self.stepper.place(state.balls, state.overlap, state.residual)

    def _find_rest_without_friction(self, load: ReducedLoad, smooth: Stencils) -> Equilibrium:
        """Return the balls at rest under a ``load`` without friction, in the directions of the
        lattice; the stencils ``smooth`` have no slips. Raises InputError if the balls carry no
        load.
        """
        try:
            return bring_to_rest(self.deviations, load, smooth)
        except InputError as error:
            where = self.stepper.name_load(load)
            problem = f"the history starts below the threshold, at {where}"
            why = "Without friction the balls carry no load there"
            mend = 'Start at a higher load, or at "gas" for an array that only friction holds'
            raise InputError(problem, why, mend) from error

    def path(
        self, loads: Iterable[ReducedLoad], first: PressedArray | None = None
    ) -> Iterator[PressedArray]:
        """Yield the state at each of the ``loads``, one after the other, from the ``first`` state
        or the start; loads may go up and down. At a load that the last state bears already, this
        state is yielded.

        Raises the errors of :meth:`begin`, and
        :class:`~granphon.base.errors.ConvergenceError` where no equilibrium is found; the message
        states the load, or one on the way to it, and ``reached`` of the error is the last state
        before it.
        """
        trail = [self.begin() if first is None else first]
        for load in loads:
            current = self.stepper.measure(trail[-1], load)
            # the tolerance of a force is relative, that of an overlap is in W
            unit = current if load.overlap is None else 1.0
            is_at_load = abs(find_aim(load) - current) <= LOAD_TOLERANCE * unit
            if is_at_load:
                yield trail[-1]
                continue
            try:
                for state in self._refine(trail, load):
                    trail = [*trail[-2:], state]
            except ConvergenceError as error:
                error.reached = trail[-1]
                raise
            yield trail[-1]

    def _refine(self, trail: Sequence[PressedArray], load: ReducedLoad) -> Iterator[PressedArray]:
        """Yield the states on the way from the last of the ``trail`` to a ``load``, in steps so
        short that halving them changes little, or in one step if the tolerance is infinite. The
        changes of the lost energies that halving the steps would make are added to those of the
        states, but not for an infinite tolerance.

        Raises ConvergenceError if a step finds no balance, or if steps would be too short or too
        many.
        """
        if self.tolerance == math.inf:
            yield self.stepper.step(trail, load)
            return
        options = self.options
        parts_ahead = [_Part(load, self.tolerance)]  # parts of the way, the nearest last
        n_steps = 0
        # sum of the changes of f* that halving the shortest steps would still make
        change_of_falls = 0.0
        while parts_ahead:
            part = parts_ahead.pop()
            middle = self.stepper.halve(trail[-1], part.load)
            states = self._take_step(trail, part.load, middle)
            change, changes_of_losses = self._compare([*trail, *states], len(states), part.load)
            change /= states[-1].force
            is_loss_settled = self._is_loss_settled(trail[-1], states[-1], changes_of_losses)
            # balance to a finite residual leaves f* uncertain by about that residual
            is_force_settled = change <= max(part.allowed_change, options.tolerance)
            # errors of lost energies are no reason to halve a step without end
            is_short = 2 * part.halvings >= options.halvings
            is_settled = is_force_settled and (is_short or is_loss_settled)
            # where a ball falls, f* changes by the same however short the step is: the change is
            # accepted in a shortest step while the sum of such changes is within the tolerance
            is_shortest = part.halvings == options.halvings
            is_fall = is_shortest and change_of_falls + change <= self.tolerance
            if is_fall or is_settled:
                states = _add_losses(states, np.cumsum(changes_of_losses, axis=0).tolist())
                yield from states
                trail = [*trail, *states][-3:]
                n_steps += len(states)
                if is_fall:
                    change_of_falls += change
                continue
            if is_shortest:
                why = f"halving the step still changes the contact force by {100.0 * change:.2g} %"
                raise self.stepper.explain(part.load, why)
            if n_steps + len(parts_ahead) > options.most_steps:
                why = f"it takes more than {options.most_steps} steps"
                raise self.stepper.explain(part.load, why)
            parts_ahead += part.halve(middle, can_keep_change=is_short)

    def _take_step(
        self, trail: Sequence[PressedArray], load: ReducedLoad, middle: ReducedLoad
    ) -> list[PressedArray]:
        """Return the states of a step from the last state of the ``trail`` to a ``load``: that at
        the load, and before it that at the load ``middle``, half-way, if the trail does not tell
        how the path bends.
        """
        states = []
        loads = [self.stepper.measure(state, load) for state in trail[-2:]]
        if not goes_on([*loads, find_aim(load)], self.options.similar):
            states = [self.stepper.step(trail, middle)]
        states.append(self.stepper.step([*trail, *states], load))
        return states

    def _is_loss_settled(
        self, start: PressedArray, end: PressedArray, changes_of_losses: Sequence[Array]
    ) -> bool:
        """Return whether the ``changes_of_losses`` (2,) that halving the steps from the state
        ``start`` to the state ``end`` would make are small beside the energy lost, or beside the
        work of the load.
        """
        loss = end.slid + end.loosened - start.slid - start.loosened
        work = abs(end.work - start.work)
        change = sum(abs(float(np.sum(changes))) for changes in changes_of_losses)
        return change <= self.tolerance * (
            self.options.loss_error * loss + self.options.work_error * work
        )

    def _compare(
        self, trail: Sequence[PressedArray], steps: int, load: ReducedLoad
    ) -> tuple[float, list[Array]]:
        """Return estimates of the changes that halving the last steps of the ``trail`` would make
        on the way to the ``load``: a high one of the magnitude of that of f*, and for each step
        those (2,) of the energies lost by sliding and by the law. ``steps`` is the number of these
        steps, one or two.

        The middle of a step is interpolated between the last three states, and contacts follow
        their law to the middle and on to the end. By the theorem of reciprocity, tangential forces
        that differ by dT raise f* by the mean over contacts of dT times the slip of the contact,
        ds/dy.
        """
        states = trail[-3:]
        loads = [self.stepper.measure(state, load) for state in states]
        change = 0.0
        changes_of_losses = []
        for last in range(-steps, 0):
            before = states[last - 1]
            after = states[last]
            start = before.contacts
            end = after.contacts
            weights = weigh_states(loads, 0.5 * (loads[last] + loads[last - 1]))
            middle = self._interpolate(weights, states, start)
            end_by_halves, _ = self._law.advance(middle, end.overlaps, end.slips)
            rises = (end.slips - start.slips) * (end_by_halves.shears - end.shears)
            # single contacts that begin to slide or open are not foreseen well: their number is
            # uncertain by its root
            rise = abs(float(np.sum(rises))) + math.sqrt(dot(rises, rises))
            compression = abs(after.overlap - before.overlap)
            # halving again and again changes twice as much as halving once
            change += 2.0 * rise / end.overlaps.size / compression
            losses_of_halves = np.add(
                self._law.find_losses(start, middle), self._law.find_losses(middle, end_by_halves)
            )
            slid = after.slid - before.slid
            loosened = after.loosened - before.loosened
            changes_of_losses.append(losses_of_halves - np.array([slid, loosened]))
        return change, changes_of_losses

    def _interpolate(
        self, weights: Sequence[float], states: Sequence[PressedArray], start: Contacts
    ) -> Contacts:
        """Return the contacts after a step from ``start`` to the overlaps and slips that those of
        the ``states``, times their ``weights``, add up to.
        """
        pairs = list(zip(weights, states, strict=True))
        overlaps = np.sum([weight * state.contacts.overlaps for weight, state in pairs], axis=0)
        slips = np.sum([weight * state.contacts.slips for weight, state in pairs], axis=0)
        contacts, _ = self._law.advance(start, overlaps, slips)
        return contacts


def _add_losses(
    states: Sequence[PressedArray], losses: Sequence[Sequence[float]]
) -> list[PressedArray]:
    """Return the ``states`` with further energies lost since the start of the first step. For each
    state, ``losses`` has the energy by sliding and that by the law, which are added to its own; the
    work of the load is larger by as much.
    """
    states_with_losses = []
    for state, (slid, loosened) in zip(states, losses, strict=True):
        work = state.work + (slid + loosened)
        states_with_losses.append(
            replace(state, slid=state.slid + slid, loosened=state.loosened + loosened, work=work)
        )
    return states_with_losses
