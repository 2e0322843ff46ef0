"""One step of the load of an array with friction: from the states before it to the equilibrium
under a new load.

Newton's method (:mod:`granphon.array.load_step`) solves the balance of forces and torques; it
begins on the polynomial in the load through the last states, at most three. If it fails, balls are
slowed by dashpots; if that fails too, the step is taken in two halves.

The work of the load is the energy that contacts store and lose. If dashpots act, the work is found
as the integral of f* dy for each contact, and dashpots take the rest. Between two states f* is then
that of the parabola through these two states and the state before them.

Where a ball loses what held it, there is no equilibrium near the one before, and Newton's method
does not find the next one. A real ball falls, and damping brings it to rest. Here dashpots do: in a
step they resist the motion of balls against each other, with a force ``drag`` (in units of c
W^(1/2)) times the displacement over the step, and eta times as much for slips. So a step with
weaker dashpots is one of a longer time. Dashpots are weakened from step to step under the same
load, until the array is in balance without them. While balls fall, and too long a step finds no
balance, they are made stronger again.

Dashpots take what the load gives and contacts neither store nor lose. They take at least what they
would if balls moved evenly through the step: where balls hardly move, this least energy is smaller
than the error of the work of the load.

A loading history may begin at the gas: balls apart on their sites, pressed with friction until they
stand. Where too few balls touch, nothing holds them, and no equilibrium is unique. A real array
then comes to rest by what damps it, and so does this one: in each step of the load, dashpots resist
what neighbours move against each other. Balls that nothing pushes stay where they are. The overlap
grows by ``options.step`` at a time from the first contact on. When the mean force has come to
``options.standing_force``, about that at a* = 1/2, the overlap is held, and the balls come to rest
or give way, in steps of time that grow: dashpots are weakened from step to step. When they bear
next to nothing they are taken away. If the array then bears at least half of this force, in
balance, it stands, and its history begins there; if it gives way before, or is not at rest after
many steps, it is pressed on.

In the true geometry contacts push balls aside, with the stiffness W/d times their force. In space,
if too few contacts resist, as in sc with half of its contacts open, an array gives way however
slowly it is let go. There, dashpots are not weakened below that stiffness times the number of
contacts of a ball: if balls then move faster from one step to the next, the array gives way.

The drag, the step of the overlap and the standing force are conventions. In small arrays f* at
higher loads depends on them by some percents; the tests state how much.
"""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from granphon.array.equilibrium import THRESHOLD_FORCE
from granphon.array.geometry import find_boundary_force
from granphon.array.load_step import LoadStep, Trial
from granphon.array.options import ReducedLoad
from granphon.array.preconditioners import Patches
from granphon.array.pressed_array import PressedArray
from granphon.array.pressed_place import PressedGeometry, PressedPlace
from granphon.array.stencils import dot
from granphon.base.arrays import Array
from granphon.base.errors import ConvergenceError
from granphon.contacts.friction import Contacts, FrictionLaw
from granphon.statics.options import LoadingOptions


def find_aim(load: ReducedLoad) -> float:
    """Return the number that a ``load`` prescribes: the overlap y, or the force f*."""
    return load.force if load.overlap is None else load.overlap


@dataclass
class Stepper:
    """Steps of the load of one array.

    Parameters
    ----------
    geometry : geometry of the contacts.
    law : law of the contacts.
    from_gas : whether balls were pressed from the gas: errors then advise another seed, and
        Newton's method is less patient (``is_patient`` of
        :meth:`~granphon.array.load_step.LoadStep.solve`).
    options : numbers of the loading.

    A *trail* is a sequence of at least one of the last states, the newest last; its last three
    count.
    """

    geometry: PressedGeometry
    law: FrictionLaw
    from_gas: bool = False
    options: LoadingOptions = field(default_factory=LoadingOptions)

    def __post_init__(self) -> None:
        self._patches = Patches(self.geometry.stencils, self.options)
        #: motions and configurations of the last states, see :meth:`locate`
        self._located: deque[tuple[Array, PressedPlace]] = deque(maxlen=3)

    def place(self, displacements: Array, overlap: float, residual: float = 0.0) -> PressedArray:
        """Return the state with the ``displacements`` (n p, L1, ..., Lp) at the ``overlap`` y,
        without rotations and tangential forces; ``residual`` is that of the state.
        """
        motion = self.geometry.stencils.spread(displacements)
        overlaps, slips = self.geometry.begin(motion, overlap)
        contacts = Contacts(overlaps, slips, np.zeros_like(slips))
        return PressedArray(overlap, motion, contacts, self.law, residual)

    def halve(self, here: PressedArray, load: ReducedLoad) -> ReducedLoad:
        """Return the load half-way between what the state ``here`` bears and a ``load``; it is an
        overlap, a mean force or a pressure as the ``load`` is.
        """
        if load.overlap is None:
            return load._replace(force=0.5 * (self.measure(here, load) + load.force))
        return load._replace(overlap=0.5 * (here.overlap + load.overlap))

    def step(
        self, trail: Sequence[PressedArray], load: ReducedLoad, drag: float = 0.0
    ) -> PressedArray:
        """Return the equilibrium under a ``load`` to which the last state of the ``trail`` leads.

        If Newton's method fails, balls are slowed by dashpots, or the load is reached in two or
        more steps. With a ``drag`` above zero dashpots of this stiffness act in each step, and the
        state is not an equilibrium of the contacts alone.

        Raises :class:`~granphon.base.errors.ConvergenceError` if no load is left on the balls, or
        if no balance is found: in steps that ``options.halvings`` halvings make the shortest, or
        after ``options.tries`` failures in steps of any length.
        """
        options = self.options
        loads_ahead = [load]  # loads still to be reached, the nearest last
        # number of times that the step to the nearest load has been halved; the second half of a
        # step counts as the whole step, whose end it reaches
        halvings = 0
        n_failed = 0  # number of steps without a balance
        while loads_ahead:
            next_load = loads_ahead[-1]
            trial = self._try_step(trail, next_load, drag, halvings)
            next_trail = self._extend(trail, trial, next_load, drag)
            if next_trail is not None:
                trail = next_trail
                halvings = max(0, halvings - 1)
                loads_ahead.pop()
                continue
            state = trail[-1]
            if trial.imbalance == math.inf and state.force < THRESHOLD_FORCE:
                raise self._explain_loss(load, state)
            has_no_length = self.measure(state, next_load) == find_aim(next_load)
            is_shortest = has_no_length or halvings == options.halvings
            if is_shortest or n_failed == options.tries:
                raise self._explain_failure(load, state)
            halvings += 1
            n_failed += 1
            loads_ahead.append(self.halve(state, next_load))
        return trail[-1]

    def _can_relax(self, drag: float) -> bool:
        """Return whether balls may be slowed by dashpots if Newton's method fails in a step with
        the ``drag``.

        With small friction Newton's method finds a balance only in stages of softer contacts, which
        steps with dashpots do not have.
        """
        return not drag and self.law.friction_coefficient >= self.options.small_friction

    def _try_step(
        self, trail: Sequence[PressedArray], load: ReducedLoad, drag: float, halvings: int
    ) -> Trial:
        """Return the trial to which Newton's method leads from the last state of the ``trail``
        under a ``load`` with a ``drag``, in balance or not; ``halvings`` are those of the step.
        """
        # halves of a step are first tried without finding limits of sliding anew, which takes long
        # and has failed in the whole step
        has_few_halvings = 0 < halvings < self.options.halvings // 2
        wants_limits = not self._can_relax(drag) or not has_few_halvings
        balls, overlap = self._extrapolate(trail, load)
        step = self._make_step(trail[-1], load, drag)
        # where friction alone holds balls, shorter steps of the load help sooner
        return step.solve(balls, overlap, wants_limits, is_patient=not self.from_gas)

    def _extend(
        self, trail: Sequence[PressedArray], trial: Trial, load: ReducedLoad, drag: float
    ) -> Sequence[PressedArray] | None:
        """Return the trail that goes on from the last state of the ``trail`` under a ``load``; None
        if there is no balance.

        If the ``trial`` with the ``drag`` is in balance, its state follows the last two of the
        trail. Otherwise balls are slowed by dashpots, where they may be and have not come apart;
        the state in which they come to rest begins a trail, as they fell to it.
        """
        if trial.is_balanced:
            end = self._damp(trail, trial) if drag else self._arrive(trail[-1], trial)
            return [*trail[-2:], end]
        if not self._can_relax(drag) or trial.imbalance == math.inf:
            return None
        at_rest = self.relax_overdamped(trail, load)
        return None if at_rest is None else [at_rest]

    def settle(
        self,
        trail: Sequence[PressedArray],
        load: ReducedLoad,
        drag: float,
        wants_limits: bool = False,
    ) -> PressedArray | None:
        """Return the state to which balls come from the last state of the ``trail`` in one step to
        a ``load``, slowed by dashpots of stiffness ``drag``, of which zero stands for none; None if
        no balance is found.

        Unlike :meth:`step`, this method takes no shorter steps. If ``wants_limits`` is true, limits
        of sliding are found anew where Newton's method does not come to a balance.
        """
        balls, overlap = self._extrapolate(trail[-1:], load)
        trial = self._make_step(trail[-1], load, drag).solve(balls, overlap, wants_limits)
        return self._damp(trail, trial) if trial.is_balanced else None

    def relax_overdamped(
        self, trail: Sequence[PressedArray], load: ReducedLoad
    ) -> PressedArray | None:
        """Return the state in which balls come to rest under a ``load``, from the last state of the
        ``trail``; None if it is not found.

        Balls are slowed by dashpots in each step. Dashpots are weakened from step to step as long
        as a balance is found, and made stronger if none is found. Once the forces of dashpots have
        not grown in ``options.calm_steps`` steps in a row, the balance without dashpots is tried.
        No state is found if there is no balance with dashpots of stiffness ``options.drag`` or
        stronger, if there is none directly after a step in which their forces have not grown, or
        after ``options.tries`` steps.
        """
        options = self.options
        drag = options.drag
        weak_drag = 0.0  # the drag with which no balance was last found
        dashpot_force = math.inf  # largest force of a dashpot in the last step
        n_calm = 0  # number of steps in a row in which the force of dashpots has not grown
        for _ in range(options.tries):
            start = trail[-1]
            end = self.settle(trail, load, drag)
            if end is None:
                # balls do not fall, or dashpots do not hold them: shorter steps of the load help
                if n_calm or drag >= options.drag:
                    return None
                weak_drag = drag
                drag = drag / options.weakening
                continue
            damped = start.damped + _find_even_loss(start, end, drag)
            trail = [replace(end, damped=max(end.damped, damped))]
            last_force = dashpot_force
            dashpot_force = drag * end.measure_motion(start)
            n_calm = n_calm + 1 if dashpot_force <= last_force else 0
            if n_calm:
                weak_drag = 0.0
                is_calm = n_calm % options.calm_steps == 0
                at_rest = self.settle(trail, load, 0.0) if is_calm else None
                if at_rest is not None:
                    return replace(at_rest, damped=max(at_rest.damped, trail[-1].damped))
            if options.weakening * drag > weak_drag:
                drag *= options.weakening
        return None

    def _make_step(self, here: PressedArray, load: ReducedLoad, drag: float) -> LoadStep:
        """Return the step from the state ``here`` to a ``load``, with dashpots of stiffness
        ``drag``.
        """
        return LoadStep(
            geometry=self.geometry,
            law=self.law,
            here=here,
            place=self.locate(here),
            load=load,
            patches=self._patches,
            drag=drag,
            options=self.options,
        )

    @staticmethod
    def name_load(load: ReducedLoad) -> str:
        """Return the ``load`` in words, for messages."""
        if load.overlap is None:
            return f"f* = {load.force:.6g}"
        return f"an overlap of {load.overlap:.6g} widths (a* = {load.overlap + 0.5:.6g})"

    def _explain_loss(self, load: ReducedLoad, last: PressedArray) -> ConvergenceError:
        """Return the error of balls on which no load is left after the ``last`` state."""
        where = f"at f* = {last.force:.3g} and an overlap of {last.overlap:.6g} widths"
        why = f"no load is left on the balls; {where} they have nearly come apart"
        return self.explain(load, why, "End the path before this load")

    def _explain_failure(self, load: ReducedLoad, last: PressedArray) -> ConvergenceError:
        """Return the error of balls that find no balance after the ``last`` state."""
        where = f"it was last at an overlap of {last.overlap:.6g} widths, f* = {last.force:.3g}"
        why = f"its forces are not in balance, however short the steps; {where}"
        return self.explain(load, why)

    def explain(self, load: ReducedLoad, why: str, mend: str = "") -> ConvergenceError:
        """Return the error of a ``load`` that is not reached because of ``why``; an empty ``mend``
        becomes the advice to end the path before this load, or to begin otherwise.
        """
        problem = f"the loading with friction has not reached {self.name_load(load)}"
        remedy = "take another seed" if self.from_gas else "start at a higher load"
        mend = mend or f"End the path before this load, or {remedy}"
        return ConvergenceError(problem, why[0].upper() + why[1:], mend)

    def locate(self, here: PressedArray) -> PressedPlace:
        """Return the configuration of the state ``here``; the last three configurations that were
        made are kept.
        """
        for balls, place in self._located:
            # each step makes new arrays, which nothing changes in place, so that an array is that
            # of one state and of one overlap
            if balls is here.balls:
                return place
        place = self.geometry.place(here.balls, here.overlap)
        self._located.append((here.balls, place))
        return place

    def measure(self, state: PressedArray, load: ReducedLoad) -> float:
        """Return the number of the ``state`` that the ``load`` prescribes: the overlap y, the mean
        force f*, or the mean force that has the pressure of the state in a cell that keeps its
        size.
        """
        if load.overlap is not None:
            return state.overlap
        if load.on_boundary:
            return find_boundary_force(
                self.locate(state), state.contacts.forces, state.contacts.shears
            )
        return state.force

    def _extrapolate(self, trail: Sequence[PressedArray], load: ReducedLoad) -> tuple[Array, float]:
        """Return the motions (fields, L1, ..., Lp) and the overlap y from which the search for a
        balance under a ``load`` begins.

        They are on the polynomial in the load through the last states of the ``trail`` that count:
        a parabola through three, a line through two, or the last state itself. An overlap that the
        ``load`` prescribes is taken as it is. The last state always counts. An earlier one counts
        if all steps from it on have the direction of the step to the load, and the step to the load
        is at most ``options.similar`` times as long as each of them; it may be much shorter.
        """
        loads = [self.measure(state, load) for state in trail[-3:]]
        aim = find_aim(load)
        n_states = 1
        *steps_before, next_step = np.diff([*loads, aim])
        for step in reversed(steps_before):
            has_turned = step * next_step <= 0.0
            if has_turned or abs(next_step) > self.options.similar * abs(step):
                break
            n_states += 1
        weights = weigh_states(loads[-n_states:], aim)
        pairs = list(zip(weights, trail[-n_states:], strict=True))
        balls = np.sum([weight * state.balls for weight, state in pairs], axis=0)
        overlap = load.overlap
        if overlap is None:
            overlap = sum(weight * state.overlap for weight, state in pairs)
        return balls, float(overlap)

    def _arrive(self, here: PressedArray, trial: Trial) -> PressedArray:
        """Return the state that a ``trial`` in balance has reached from the state ``here``, with
        the energies lost on the way and the work of the load: the energy that contacts store and
        lose.

        The configuration of the trial is kept for :meth:`locate`.
        """
        slid, loosened = self.law.find_losses(here.contacts, trial.contacts)
        state = PressedArray(
            overlap=trial.overlap,
            balls=trial.balls,
            contacts=trial.contacts,
            law=self.law,
            residual=trial.imbalance,
            work=here.work + slid + loosened,
            slid=here.slid + slid,
            loosened=here.loosened + loosened,
            damped=here.damped,
            steps=here.steps + 1,
            newton=here.newton + trial.newton,
            krylov=here.krylov + trial.krylov,
        )
        self._located.append((trial.balls, trial.place))
        return replace(state, work=state.work + state.stored - here.stored)

    def _damp(self, trail: Sequence[PressedArray], trial: Trial) -> PressedArray:
        """Return the state that a ``trial`` in balance has reached from the last state of the
        ``trail`` with dashpots, which take what the load gives and contacts neither store nor lose.

        The configuration of the trial is kept for :meth:`locate`.
        """
        state = self._arrive(trail[-1], trial)
        states = [*trail[-2:], state]
        presses = [
            self.locate(state_on_way).press(
                state_on_way.contacts.forces, state_on_way.contacts.shears
            )
            for state_on_way in states
        ]
        overlaps = [state_on_way.overlap for state_on_way in states]
        work_of_step = integrate_last(overlaps, presses, self.options.similar)
        dashpot_energy = work_of_step - (state.work - trail[-1].work)
        return replace(
            state, work=state.work + dashpot_energy, damped=state.damped + dashpot_energy
        )

    # -- from the gas ------------------------------------------------------------------------------

    def press_gas(self, contact: float) -> PressedArray:
        """Return the first state that stands with friction, from balls on their sites at the
        overlap ``contact`` y, at which the first two balls touch.

        Raises :class:`~granphon.base.errors.ConvergenceError` if balls stand at no overlap up to
        ``options.most_overlap``, or if balls that dashpots slow down do not come into balance.
        """
        stencils = self.geometry.stencils
        sites = np.zeros((stencils.n_balls * len(stencils.shape), *stencils.shape))
        state = self.place(sites, contact)
        options = self.options
        while state.overlap < options.most_overlap:
            load = ReducedLoad(overlap=state.overlap + options.step)
            try:
                state = self.step([state], load, options.drag)
            except ConvergenceError as error:
                problem = (
                    f"the balls, pressed from the gas, are not in balance beyond an overlap of"
                    f" {state.overlap:.3g} widths"
                )
                why = "Too few contacts hold them"
                mend = "Take another seed, or another friction coefficient"
                if self.geometry.ratio:
                    why = (
                        "In the true geometry forces turn with their contacts, and turn balls"
                        " that too few contacts hold"
                    )
                    mend = 'Take the geometry "lattice"'
                raise ConvergenceError(problem, why, mend) from error
            if state.force >= options.standing_force:
                at_rest = self._come_to_rest(state)
                if at_rest is not None:
                    return at_rest
        raise ConvergenceError(
            f"the balls still do not stand at an overlap of {state.overlap:.3g} widths",
            "Friction does not hold what the lattice leaves loose",
            "Raise the friction coefficient",
        )

    def _come_to_rest(self, state: PressedArray) -> PressedArray | None:
        """Return the state in which balls stand without dashpots at the overlap of a ``state``,
        bearing at least half of ``options.standing_force``; None if they give way, or are not at
        rest after ``options.tries`` steps.

        Dashpots are weakened from step to step, and taken away when balls hardly move. In the true
        geometry of space they are weakened no further than to the stiffness with which contacts
        push balls aside; balls give way if they then move more in one step than in the step before.
        """
        load = ReducedLoad(overlap=state.overlap)
        options = self.options
        drag = options.drag
        motion = math.inf  # before the first step there is none to compare with
        least_drag = min(drag, self._find_push_aside(state))
        for _ in range(options.tries):
            last_drag = drag
            last_motion = motion
            drag = max(options.weakening * drag, least_drag)
            settled = self.settle([state], load, drag, wants_limits=True)
            if settled is None or settled.force < 0.5 * options.standing_force:
                return None
            motion = settled.measure_motion(state)
            state = settled
            is_faster = motion > last_motion
            if drag == last_drag and is_faster:
                return None
            if least_drag:
                is_still = drag == last_drag and motion < options.still_motion
            else:
                is_still = drag * motion < options.still_force * state.force
            if is_still:
                at_rest = self.settle([state], load, 0.0, wants_limits=True)
                is_standing = at_rest is not None and at_rest.force >= 0.5 * options.standing_force
                return at_rest if is_standing else None
        return None

    def _find_push_aside(self, state: PressedArray) -> float:
        """Return the stiffness, c W^(1/2), with which the contacts of a ball push it aside in sum
        if they all bear the mean force of a ``state``. Zero in a plane, where balls that stand do
        not give way by such pushes, and where contacts keep their directions.
        """
        stencils = self.geometry.stencils
        if len(stencils.shape) < 3:
            return 0.0
        n_around = 2 * stencils.n_contacts // stencils.n_balls
        return n_around * self.geometry.ratio * state.force


def goes_on(loads: Sequence[float], similar: float) -> bool:
    """Return whether there are three ``loads`` with two steps in the same direction and of similar
    length: at most the factor ``similar`` apart.
    """
    if len(loads) != 3:
        return False
    first_step, last_step = np.diff(loads)
    has_turned = first_step * last_step <= 0.0
    return bool(not has_turned and 1.0 / similar <= last_step / first_step <= similar)


def weigh_states(loads: Sequence[float], load: float) -> list[float]:
    """Return the weights with which values at ``loads``, no two of which are equal, add up to the
    value at a ``load``, on the polynomial of Lagrange through all of them.
    """
    weights = []
    for node in loads:
        factors = [(load - root) / (node - root) for root in loads if root != node]
        weights.append(float(np.prod(factors)))
    return weights


def integrate_last(loads: Sequence[float], values: Sequence[float], similar: float) -> float:
    """Return the integral between the last two of two or three ``loads`` of a function whose
    ``values`` at the loads are known.

    The function is taken for the parabola through three values if :func:`goes_on`, with the factor
    ``similar``, is true of the loads, and otherwise for the straight line through the last two.
    """
    start, end = loads[-2:]
    value_at_start, value_at_end = values[-2:]
    straight = 0.5 * (value_at_start + value_at_end) * (end - start)
    if not goes_on(loads, similar):
        return straight
    # Newton's divided differences
    slope = (value_at_end - value_at_start) / (end - start)
    slope_before = (value_at_start - values[0]) / (start - loads[0])
    bend = (slope - slope_before) / (end - loads[0])
    return straight - bend * (end - start) ** 3 / 6.0


def _find_even_loss(start: PressedArray, end: PressedArray, drag: float) -> float:
    """Return the mean energy of a contact, in c W^(5/2), that dashpots of stiffness ``drag`` take
    if balls move evenly from the state ``start`` to the state ``end``: the least that they take.
    """
    # losses of overlap by the motions of balls alone: dashpots do not resist the even strain of the
    # cell
    loss = start.contacts.overlaps - end.contacts.overlaps + end.overlap - start.overlap
    slips = end.contacts.slips - start.contacts.slips
    squares = dot(loss, loss) + end.law.mindlin_ratio * dot(slips, slips)
    return drag * squares / loss.size
