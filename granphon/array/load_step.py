"""One step of the load in a loading history: Newton's method for the balance of forces and torques
under the law of the contacts.

The linear equations of a step of Newton's method are solved no more accurately than the step needs.
C is the compatibility matrix of the array (:mod:`granphon.array.stencils`), and D is the tangent of
the law of contacts. The tangent C^T D C of the array is not symmetric if contacts slide, or if the
shear stiffness changes with the overlap: GMRES solves the equations, in single precision. The
preconditioner moves each ball as if its neighbours were held, and then all balls by Green's
function of the lattice under the forces that are left. Balls that only hold each other are found by
the forces that GMRES leaves on them, and are then moved together
(:class:`~granphon.array.preconditioners.Patches`).

A ball whose contacts all slide can be turned without resistance, and a step of Newton's method
would turn it without limit. In a plane such a ball is turned by itself after the step, to where its
torque vanishes while all other balls are held: the torque is a piecewise linear function of the
angle. Where dashpots act, they resist the turn, and no ball is turned by itself.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np

from granphon.array.geometry import LOAD_TOLERANCE, find_lack
from granphon.array.minimal_residuals import Single, solve_by_minimal_residuals
from granphon.array.options import ReducedLoad
from granphon.array.preconditioners import MotionSetter, Patches
from granphon.array.pressed_array import PressedArray
from granphon.array.pressed_place import PressedGeometry, PressedPlace, PressedTangent
from granphon.array.stencils import OPTIONS, Motion, dot
from granphon.balls import hertz
from granphon.base.arrays import Array, Flags, Index
from granphon.contacts import grid_product
from granphon.contacts.friction import Contacts, FrictionLaw, Tangent
from granphon.contacts.slips import find_greatest_length
from granphon.statics.options import LoadingOptions

#: part of the residual that a whole step of Newton's method leaves if a ball loses its last
#: contact. The step goes two thirds of the way to the zero of the force h^(3/2) of the overlap h; a
#: step that is longer by the factor 3/2, the exponent, goes all of the way
_LOOSE_RESIDUAL = (1.0 - 1.0 / hertz.EXPONENT) ** hertz.EXPONENT


@dataclass(frozen=True, eq=False)
class Trial:
    """Motions of the balls tried in a step of the load, and the forces that are left there.

    Attributes
    ----------
    place : configuration of the balls.
    balls : (fields, L1, ..., Lp) motions of the balls.
    overlap : y.
    contacts : state of the contacts.
    linearise : function that returns the tangent of the law; few trials need it.
    pull : (fields, L1, ..., Lp) forces left on balls, dashpots included.
    push : by how much a force per contact is less than the load prescribes, times the number of
        contacts, see :func:`~granphon.array.geometry.find_lack`; zero at a given overlap.
    imbalance : largest force, or torque over the diameter, left on a ball. It is divided by a unit
        of force: the mean normal force or the stiffness of dashpots times W, whichever is greater.
        Infinite if the balls have come apart: the unit of force is next to nothing beside the mean
        force at the start of the step, or is not finite.
    load_error : magnitude of ``push`` per contact, divided by the same unit of force; zero if the
        balls have come apart.
    size : norm of the residual: the root of the sum of the squares of ``pull``, and of ``push``
        squared over the number of contacts.
    is_balanced : whether all balls are in balance, and the load is met.
    newton, krylov : numbers of steps of Newton's method and of iterations of GMRES so far.
    """

    place: PressedPlace
    balls: Array
    overlap: float
    contacts: Contacts
    linearise: Callable[[], Tangent]
    pull: Array
    push: float
    imbalance: float
    load_error: float
    size: float
    is_balanced: bool
    newton: int = 0
    krylov: int = 0

    @property
    def tangent(self) -> Tangent:
        """Derivatives of the forces of contacts, found at the first call and kept."""
        return self.linearise()

    def follow(self, other: Trial) -> Trial:
        """Return the ``other`` trial with the numbers of steps and iterations of this one."""
        return replace(other, newton=self.newton, krylov=self.krylov)


class LoadStep:
    """A step of the load, to the balance of forces and torques.

    Parameters
    ----------
    geometry, law : geometry and law of the contacts.
    here : state at the start of the step.
    place : configuration at the start, from which slips are counted.
    load : load at the end.
    patches : what finds and inverts patches of weakly held balls.
    drag : stiffness of dashpots between neighbours over the step, in c W^(1/2); see
        :mod:`granphon.array.stepper`.
    options : numbers of the loading.
    """

    def __init__(
        self,
        geometry: PressedGeometry,
        law: FrictionLaw,
        here: PressedArray,
        place: PressedPlace,
        load: ReducedLoad,
        patches: Patches,
        drag: float = 0.0,
        options: LoadingOptions | None = None,
    ) -> None:
        self._options = options or LoadingOptions()
        self._geometry = geometry
        self._stencils = geometry.stencils
        self._law = law
        self._here = here
        self._place = place
        self._load = load
        self._drag = drag
        self._patches = patches
        self._linear = LinearSteps(patches, bool(drag), self._options)
        # without friction contacts bear no tangential force, and none comes to its limit
        self._can_slide = 0.0 < law.friction_coefficient < math.inf
        is_plane = len(self._stencils.motions.rotations) == 1
        # balls whose contacts all slide turn freely in a plane, unless dashpots hold them
        self._can_spin = self._can_slide and is_plane and not drag

    def solve(
        self, balls: Array, overlap: float, wants_limits: bool, is_patient: bool = False
    ) -> Trial:
        """Return the trial to which Newton's method leads from the motions ``balls`` (fields, L1,
        ..., Lp) and the ``overlap`` y; the trial may be in balance or not.

        With small friction, stages of softer contacts come first (:meth:`_stiffen`). Then Newton's
        method is tried with the law itself. If it does not find a balance, contacts can slide, and
        ``wants_limits`` is true, it is tried again with limits of sliding that are found anew;
        ``is_patient`` says how (:meth:`_renew_limits`).
        """
        start = self._stiffen(self._make_trial(balls, overlap))
        trial = self._iterate(start, self._options.steps)
        if not wants_limits or trial.is_balanced or not self._can_slide:
            return trial
        return self._renew_limits(trial.follow(start), is_patient)

    def _renew_limits(self, start: Trial, is_patient: bool) -> Trial:
        """Return the trial to which Newton's method leads from the trial ``start`` with limits of
        sliding that are found anew; the trial may be in balance or not.

        If many contacts begin or cease to slide, steps of Newton's method go to and fro between the
        two sides of Coulomb's limit. So Newton's method is tried with the limit fixed at the
        overlaps of a trial, first of the ``start``: with a fixed limit there is always an
        equilibrium. From near this equilibrium the law itself is tried. The two attempts are
        repeated, each time with the limit fixed at the overlaps near the equilibrium before, at
        most ``options.tries`` times. They end if the balls come apart.

        A ball that is squeezed out from between others has a long way to go, on which the limits
        change little at a time. If ``is_patient`` is true, the attempts with fixed limits end at a
        smaller residual. The law itself is then tried only in one of ``options.limit_rounds``
        rounds, and whenever its residual is at most half of that from which it was last tried.
        """
        options = self._options
        part = options.limit_part ** (2 if is_patient else 1)
        rounds = options.limit_rounds if is_patient else 1
        anchor = start  # the last trial with a fixed limit
        trial = start  # the last trial with the law itself
        last_size = math.inf  # residual from which the law itself was tried last
        for count in range(1, options.tries + 1):
            if anchor.imbalance == math.inf:
                break
            guess = anchor.contacts.overlaps
            anchor = anchor.follow(self._make_trial(anchor.balls, anchor.overlap, guess))
            anchor = self._iterate(anchor, options.patience, guess, part=part)
            trial = anchor.follow(self._make_trial(anchor.balls, anchor.overlap))
            if trial.size > 0.5 * last_size and count % rounds:
                continue
            last_size = trial.size
            trial = self._iterate(trial, options.steps, patience=options.patience // 3)
            if trial.is_balanced:
                break
            anchor = trial.follow(anchor)
        return trial

    def _stiffen(self, trial: Trial) -> Trial:
        """Return the trial to which stages of softer contacts lead from a ``trial``, if friction is
        small and there are no dashpots; otherwise the ``trial`` as it is.

        With small friction only as few contacts stick as keep the balls from turning, and Newton's
        method does not find out which contacts these are. If contacts are soft against slip, fewer
        slide. So contacts are soft against slip in a first stage and stiffer in each following one,
        and the equilibrium of each stage is near that of the stage before. From the second stage on
        Coulomb's limit is fixed at the overlaps of the stage before, which friction hardly changes.
        If the balls come apart, the ``trial`` is returned, with the numbers of all steps taken.
        """
        mu = self._law.friction_coefficient
        options = self._options
        is_small = self._can_slide and mu < options.small_friction
        if not is_small or self._drag:
            return trial
        first = trial
        guess = None
        # torques of less friction than the tolerance need no balance
        ratio = options.small_friction / max(mu, options.tolerance)
        stages = math.ceil(math.log(ratio) / math.log(options.stiffening))
        for stage in range(stages, -1, -1):
            factor = options.stiffening**-stage
            law = replace(self._law, mindlin_ratio=self._law.mindlin_ratio * factor)
            step = LoadStep(
                geometry=self._geometry,
                law=law,
                here=self._here,
                place=self._place,
                load=self._load,
                patches=self._patches,
                options=options,
            )
            trial = trial.follow(step._make_trial(trial.balls, trial.overlap, guess))
            most_imbalance = options.limit_part * mu
            trial = step._iterate(trial, options.steps, guess, most_imbalance)
            if trial.imbalance == math.inf:
                return trial.follow(first)
            guess = trial.contacts.overlaps
        return trial.follow(self._make_trial(trial.balls, trial.overlap))

    def _iterate(
        self,
        trial: Trial,
        most_steps: int,
        guess: Array | None = None,
        most_imbalance: float = 0.0,
        part: float = 0.0,
        patience: int | None = None,
    ) -> Trial:
        """Return the trial after at most ``most_steps`` steps of Newton's method from a ``trial``.

        The iteration ends if the trial is in balance; if its ``imbalance`` and ``load_error`` are
        at most ``most_imbalance``; if the residual is less than a ``part`` of that of the first
        ``trial``; if ``patience`` steps, by default ``options.patience``, have not halved the
        residual; and if the balls have come apart or the residual is not finite. With a ``guess``
        of the overlaps the stiffness against slip and Coulomb's limit are fixed there.
        """
        options = self._options
        patience = patience or options.patience
        last_size = math.inf
        hold = 1.0  # added stiffness, over the usual one
        is_slow = False  # whether the last step was a whole one, and slow
        aim = part * trial.size
        for count in range(most_steps):
            has_come_apart = trial.imbalance == math.inf
            if trial.is_balanced or trial.size < aim or has_come_apart:
                break
            if max(trial.imbalance, trial.load_error) <= most_imbalance:
                break
            if count % patience == 0:
                if trial.size > 0.5 * last_size:
                    break
                last_size = trial.size
            motion, iterations = self._find_newton_step(trial, hold)
            after, length = self._search_line(trial, motion, guess, is_slow)
            is_slow = length == 1.0 and self._is_slow(after, trial)
            after_turns = self._turn_loose(after, guess)
            # if contacts of turned balls change, the turns may undo the step, and would do so after
            # each step: then balls are not turned
            after = after_turns if after_turns.size <= trial.size else after
            trial = replace(after, newton=trial.newton + 1, krylov=trial.krylov + iterations)
            if not math.isfinite(trial.size):
                break
            if length == 1.0:
                hold = max(1.0, hold / options.stiffening)
            elif length < 0.5:
                hold *= options.stiffening
        return trial

    @staticmethod
    def _is_slow(after: Trial, before: Trial) -> bool:
        """Return whether a whole step is slow: it leaves more than half of the part of the residual
        that it leaves if a ball loses its last contact (:data:`_LOOSE_RESIDUAL`). The trials are
        those ``before`` and ``after`` the step.
        """
        return bool(after.size > 0.5 * _LOOSE_RESIDUAL * before.size)

    def _search_line(
        self, trial: Trial, motion: Motion, guess: Array | None, was_slow: bool
    ) -> tuple[Trial, float]:
        """Return the best trial along the ``motion`` of a step of Newton's method from a ``trial``,
        and the length of the step over the whole one.

        The whole step is halved until a step of the length l leaves less than 1 - l/10 of the
        residual, or until ``options.lengths`` lengths have been tried; the best trial is the one
        with the least residual. With a ``guess`` of the overlaps, at which Coulomb's limit is
        fixed, forces are derivatives of an energy: halving then also ends at a trial where the
        energy rises less than half as steeply as it falls at the start, and the trial at which
        halving ends is the best. If the step before was slow, as ``was_slow`` says, and the whole
        step is slow again, a longer step is tried too; its length is returned as one.
        """

        def try_length(length: float) -> Trial:
            """Return the trial after a part ``length`` of the motion."""
            return self._make_trial(
                trial.balls + length * motion.balls,
                trial.overlap + length * motion.compression,
                guess,
            )

        def find_power(state: Trial) -> float:
            """Return the power, along the motion, of the forces left in a trial."""
            return dot(state.pull, motion.balls) + state.push * motion.compression

        power_at_start = find_power(trial)
        length = 1.0
        after = try_length(length)
        best = after
        best_length = length
        for _ in range(self._options.lengths - 1):
            leaves_less = after.size < (1.0 - 0.1 * length) * trial.size
            is_not_too_far = guess is not None and find_power(after) > -0.5 * power_at_start
            if leaves_less or is_not_too_far:
                if guess is not None:
                    best = after
                    best_length = length
                break
            length *= 0.5
            after = try_length(length)
            if after.size < best.size:
                best = after
                best_length = length
        if was_slow and best_length == 1.0 and self._is_slow(best, trial):
            longer = try_length(hertz.EXPONENT)
            best = longer if longer.size < best.size else best
        return best, best_length

    def _make_trial(self, balls: Array, overlap: float, guess: Array | None = None) -> Trial:
        """Return the trial with the motions ``balls`` (fields, L1, ..., Lp) at an ``overlap`` y.

        With a ``guess`` of the overlaps, (n_c, L1, ..., Lp), the stiffness against slip and
        Coulomb's limit are fixed there.
        """
        place = self._geometry.place(balls, overlap)
        start = self._here.contacts
        slips = place.find_slips(self._place, start.slips)
        contacts, linearise = self._law.advance(start, place.overlaps, slips, guess)
        on_balls = place.push(*self._add_dashpots(contacts, overlap))
        pull = self._geometry.collect_forces(*on_balls)
        push = place.overlaps.size * find_lack(self._load, place, contacts.forces, contacts.shears)
        largest_force = float(np.max([find_greatest_length(vectors) for vectors in on_balls]))
        imbalance, load_error = self._measure_imbalance(contacts, largest_force, push)
        return Trial(
            place=place,
            balls=balls,
            overlap=overlap,
            contacts=contacts,
            linearise=linearise,
            pull=pull,
            push=push,
            imbalance=imbalance,
            load_error=load_error,
            size=math.sqrt(dot(pull, pull) + push * push / place.overlaps.size),
            is_balanced=imbalance <= self._options.tolerance and load_error <= LOAD_TOLERANCE,
        )

    def _add_dashpots(self, contacts: Contacts, overlap: float) -> tuple[Array, Array]:
        """Return the normal and the tangential forces of ``contacts`` at an ``overlap`` y, with
        those of dashpots if there are any.
        """
        if not self._drag:
            return contacts.forces, contacts.shears
        overlap_change = overlap - self._here.overlap
        eta = self._stencils.mindlin_ratio
        return contacts.damp(self._here.contacts, overlap_change, self._drag, eta)

    def _measure_imbalance(
        self, contacts: Contacts, largest_force: float, push: float
    ) -> tuple[float, float]:
        """Return ``imbalance`` and ``load_error`` of a :class:`Trial` with these ``contacts``.
        ``largest_force`` is the largest force or torque on a ball, and ``push`` that of the trial.
        """
        force = float(np.mean(contacts.forces))
        unit = max(force, self._drag)
        # without a force there is no balance to be found; dashpots are a unit of force themselves
        has_come_apart = not self._options.tolerance * self._here.force < unit < math.inf
        if has_come_apart:
            return math.inf, 0.0
        return largest_force / unit, abs(push) / (contacts.forces.size * unit)

    def _find_newton_step(self, trial: Trial, hold: float) -> tuple[Motion, int]:
        """Return the motion of a step of Newton's method from a ``trial``, and the number of
        iterations of GMRES that it took.

        Stiffness is added to contacts, and sliding contacts get a part of their secant stiffness.
        Both are in proportion to the distance from balance times ``hold``, which is usually one, up
        to a limit far from balance. Motions of balls that go far are made shorter, each ball by
        itself.
        """
        options = self._options
        distance = max(trial.imbalance, trial.load_error)
        is_free = self._load.overlap is None
        unit = float(np.mean(trial.tangent.stiffness)) + self._drag  # of stiffness
        eta = self._stencils.mindlin_ratio
        added = OPTIONS.added_stiffness * min(1.0, distance * hold) * unit
        # distance from which on sliding contacts have all of their secant stiffness: in a plane,
        # where balls whose contacts all slide are turned by themselves, it is in proportion to the
        # friction coefficient
        limit = self._law.friction_coefficient / options.secant_share if self._can_spin else 1.0
        share = min(1.0, distance * hold / limit)
        tangent = trial.tangent.regularise(added, eta, share, self._drag, unit)
        product = trial.place.linearise(
            tangent, trial.contacts.forces / unit, trial.contacts.shears / unit, is_free=is_free
        )
        push = trial.push / unit if is_free else None
        motion, iterations = self._linear.solve(
            product, tangent, trial.pull / unit, push, self._choose_reduction(distance)
        )
        rms_overlap = math.sqrt(float(np.mean(trial.contacts.overlaps**2)))
        balls = self._shorten(motion.balls, options.farthest * rms_overlap)
        return Motion(balls, motion.compression), iterations

    def _choose_reduction(self, distance: float) -> float:
        """Return the part of the right side that the linear equations of a step may leave at a
        ``distance`` above zero from balance: the less the smaller the distance, but no less than
        balance needs.
        """
        options = self._options
        return options.forcing * min(1.0, max(math.sqrt(distance), options.tolerance / distance))

    def _shorten(self, balls: Array, farthest: float) -> Array:
        """Return the motions ``balls`` (fields, L1, ..., Lp); the motion of a ball that goes too
        far is made shorter by a factor, so that no coordinate of its displacement is above
        ``farthest`` in magnitude, and no component of its rotation above twice as much.

        Balls that are about to lose their hold and fall would otherwise be moved far.
        """
        stencils = self._stencils
        fields = balls.reshape(stencils.n_balls, stencils.motions.count, *stencils.shape)
        displacements = np.abs(fields[:, stencils.motions.translating])
        rotations = np.abs(fields[:, stencils.motions.turning])
        sizes = np.maximum(
            np.max(displacements, axis=1, initial=0.0), 0.5 * np.max(rotations, axis=1, initial=0.0)
        )
        if float(np.max(sizes)) <= farthest:
            return balls
        shorter = fields * (farthest / np.maximum(sizes, farthest))[:, None]
        return np.asarray(shorter.reshape(balls.shape))

    def _turn_loose(self, trial: Trial, guess: Array | None) -> Trial:
        """Return the trial after balls whose contacts all slide, the loose ones, have turned by
        themselves to where their torques vanish.

        The ``trial`` itself is returned with dashpots, in space, or if mu is zero or infinite; if
        the trial is in balance or its balls have come apart; and if the torques on loose balls are
        no more than what the linear equations of the next step leave.

        With a ``guess`` of the overlaps the stiffness against slip and Coulomb's limit are fixed
        there.
        """
        if not self._can_spin or trial.imbalance == math.inf or trial.is_balanced:
            return trial
        stencils = self._stencils
        loose = self._find_loose(trial)
        count = stencils.motions.count
        (turning,) = range(count)[stencils.motions.turning]
        torque = trial.pull.reshape(-1, count, *stencils.shape)[:, turning][loose]
        part = self._choose_reduction(max(trial.imbalance, trial.load_error))
        if not dot(torque, torque) > (part * trial.size) ** 2:
            return trial
        balls = trial.balls.copy()
        rotations = balls.reshape(stencils.n_balls, count, *stencils.shape)[:, turning]
        rotations[loose] += self._find_loose_turns(trial, guess, *self._list_around(loose, turning))
        return self._make_trial(balls, trial.overlap, guess)

    def _find_loose_turns(
        self, trial: Trial, guess: Array | None, around: tuple[Index, ...], arms: Array
    ) -> Array:
        """Return the angles (balls,) by which the loose balls of a ``trial`` turn, each to where
        its torque vanishes while all other balls are held; zero for a ball that shares a contact,
        closed or open, with a loose ball with a greater torque.

        ``around`` and ``arms`` are those of :meth:`_list_around` of the loose balls, and ``guess``
        is that of :meth:`_turn_loose`.
        """
        start = self._here.contacts
        end = trial.contacts
        # the contacts around each loose ball, (contacts, balls), as the start of the step has them
        around_at_start = Contacts(
            start.overlaps[around], start.slips[0][around][None], start.shears[0][around][None]
        )
        overlaps_around = (end.overlaps if guess is None else guess)[around]
        shears, springs, limits = self._law.stick(
            around_at_start, overlaps_around, end.slips[0][around][None]
        )
        turns = _find_turns(shears[0], springs * arms, limits, arms)
        torques = np.abs(np.sum(arms * np.clip(shears[0], -limits, limits), axis=0))
        return np.where(self._have_greatest_torque(around, arms, torques), turns, 0.0)

    def _have_greatest_torque(
        self, around: tuple[Index, ...], arms: Array, torques: Array
    ) -> Flags:
        """Return (balls,) whether the torque on each loose ball is at least that on every loose
        ball at the other ends of its contacts, open contacts included; ``torques`` (balls,) are the
        magnitudes.

        Only such balls turn, as each turn changes the torques on the balls that it touches; where a
        contact is open a ball may wait for one that it does not touch. ``around`` and ``arms`` are
        those of :meth:`_list_around`; an arm of zero is that of a contact that has no end at the
        ball.
        """
        shape = (self._stencils.n_contacts, *self._stencils.shape)
        contacts = np.ravel_multi_index(around, shape)
        torques_at_contacts = np.where(arms != 0.0, torques, 0.0)
        greatest = np.zeros(math.prod(shape))
        np.maximum.at(greatest, contacts, torques_at_contacts)
        greatest_around = np.where(arms != 0.0, greatest[contacts], 0.0)
        return np.asarray(np.all(torques_at_contacts >= greatest_around, axis=0))

    def _find_loose(self, trial: Trial) -> Flags:
        """Return (n_balls, L1, ..., Lp) whether each ball is loose: the stiffnesses of its contacts
        against slip sum to less than the part ``options.loose_stiffness`` of the sum that they
        would have if no contact slid. Balls whose contacts all slide are loose.
        """
        stencils = self._stencils
        tangent = trial.tangent
        least_ratio = self._options.loose_stiffness * self._law.mindlin_ratio
        # below zero for a contact that slides, zero for an open one, and else far above zero
        surplus = tangent.springs[0] - least_ratio * tangent.stiffness
        return stencils.by_ball(stencils.sum_around(surplus)) < 0.0

    def _list_around(self, loose: Flags, turning: int) -> tuple[tuple[Index, ...], Array]:
        """Return the contacts around each ball where ``loose`` (n_balls, L1, ..., Lp) is true, and
        their arms: the slips by a unit turn of the ball, its motion number ``turning``.

        The contacts are a tuple of indices (contacts, balls) into arrays (n_c, L1, ..., Lp), and
        the arms are (contacts, balls). Both ends of all kinds of contacts are listed for each ball,
        open ones too: arms are zero for ends at other balls of the cell.
        """
        stencils = self._stencils
        count = stencils.motions.count
        ball, *cell = np.nonzero(loose)
        indices: list[list[Index]] = []
        arms: list[Array] = []
        heads, tails = stencils.coefficients[:, stencils.n_contacts :]
        for kind, (shift, (i, j)) in enumerate(zip(stencils.shifts, stencils.ends, strict=True)):
            # a contact that ends at the ball starts ``shift`` cells before it
            from_ball = (i, (0,) * len(shift), -tails[kind])
            to_ball = (j, shift, heads[kind])
            for end, steps, slip in (to_ball, from_ball):
                first_cell = [
                    (coordinate - step) % size
                    for coordinate, step, size in zip(cell, steps, stencils.shape, strict=True)
                ]
                indices.append([np.full_like(ball, kind), *first_cell])
                arms.append(np.where(ball == end, slip[count * end + turning], 0.0))
        return tuple(np.moveaxis(np.array(indices), 1, 0)), np.array(arms)


class LinearSteps:
    """Solver of the linear equations of the steps of Newton's method in one step of the load; it
    keeps the patch of weakly held balls from step to step.

    ``is_damped`` says whether there are dashpots, which act above all where few balls touch;
    ``options`` are the numbers of the loading.
    """

    def __init__(self, patches: Patches, is_damped: bool, options: LoadingOptions) -> None:
        self._options = options
        self._stencils = patches.stencils
        self._patches = patches
        self._is_damped = is_damped
        #: numbers of the balls of the patch
        self._weak_balls: Index = np.empty(0, np.intp)
        #: approximate inverse of the patch; None where there is no patch, or it has no inverse
        self._invert_patch: MotionSetter | None = None

    def solve(
        self,
        product: PressedTangent,
        tangent: Tangent,
        pull: Array,
        push: float | None,
        reduction: float,
    ) -> tuple[Motion, int]:
        """Return the motion under the forces ``pull`` (fields, L1, ..., Lp) on balls and ``push``
        on the overlap, and the number of iterations of GMRES.

        ``push`` is that of a :class:`Trial`; if it is None, the overlap stays as it is. The norm of
        the residual is at most ``reduction`` times that of the forces, unless that takes more than
        ``options.most_iterations`` or no motion has such forces. ``tangent`` is that of the
        contacts, with a mean stiffness of one, and ``product`` multiplies motions by the tangent of
        the array. Side effect: weakly held balls that the iteration finds are added to the patch,
        which further calls use.
        """
        options = self._options
        size = pull.size
        inverse = self.invert(tangent, product)
        # of the overlap against the sum of the forces of contacts, whose mean stiffness is one
        softness = np.float32(1.0 / tangent.stiffness.size)

        # the last entry of a vector is the change of the overlap, or the force on it
        def apply(vector: Single, image: Single) -> None:
            """Set ``image`` to the forces against the motions ``vector``."""
            image[size] = product.resist(vector[:size], vector[size], image[:size])

        def precondition(vector: Single, image: Single) -> None:
            """Set ``image`` to approximate motions under the forces ``vector``."""
            inverse(vector[:size].reshape(pull.shape), image[:size].reshape(pull.shape))
            image[size] = softness * vector[size]

        right = np.append(pull, push or 0.0)
        solution = np.zeros_like(right)
        residual = right
        iterations = 0
        most = options.patience_of_balls  # iterations until weakly held balls are looked for
        is_renewed = False  # whether the patch has been inverted with this tangent
        goal = reduction * math.sqrt(dot(right, right))
        while iterations < options.most_iterations:
            norm = math.sqrt(dot(residual, residual))
            if not norm > goal:  # also where motions have left the range of numbers
                break
            change, count = solve_by_minimal_residuals(
                apply, precondition, residual, goal / norm, most
            )
            solution += change
            iterations += count
            if count < most:  # the goal is reached, or no motion has the forces that are left
                break
            product_of_solution = np.empty(right.size, np.float32)
            apply(solution.astype(np.float32), product_of_solution)
            residual = right - product_of_solution
            if self._renew_patch(residual[:size].reshape(pull.shape), product, is_renewed):
                is_renewed = True
            else:
                # a new inverse would be that of the same patch: only iterations are left
                most = options.most_iterations - iterations
        return Motion(solution[:size].reshape(pull.shape), float(solution[size])), iterations

    def _renew_patch(self, residual: Array, product: PressedTangent, is_renewed: bool) -> bool:
        """Add the balls on which the largest forces of a ``residual`` (fields, L1, ..., Lp) act to
        the patch, and invert its matrix. Return whether the inverse is a new one.

        It is not if the patch has no balls, or if it has not grown and its matrix has been inverted
        with this ``product`` before, as ``is_renewed`` says.
        """
        worst_balls = self._patches.find_worst_balls(residual)
        balls = self._patches.join(self._weak_balls, worst_balls)
        has_grown = balls.size > self._weak_balls.size
        if not has_grown and (is_renewed or not balls.size):
            return False
        self._weak_balls = balls
        self._invert_patch = self._patches.invert(balls, product)
        return True

    def invert(self, tangent: Tangent, product: PressedTangent) -> MotionSetter:
        """Return an approximate inverse of C^T D C: a function of a force and a motion, both
        (fields, L1, ..., Lp), that sets the motion.

        D is the ``tangent`` of the contacts, and ``product`` multiplies motions by C^T D C. The
        inverse of the patch may be that of an earlier tangent: :meth:`solve` finds it anew when
        many iterations are needed.
        """
        mean = float(np.mean(tangent.stiffness))
        inverses = product.invert_blocks_of_balls(OPTIONS.grid.spring * mean)
        green = self._stencils.green_preconditioner(np.float32, mean)
        fields = (self._stencils.n_fields, 1, math.prod(self._stencils.shape))
        residual = np.empty(fields, np.float32)

        def apply(force: Single, motion: Single) -> None:
            """Set ``motion`` to the approximate motion under a ``force``."""
            pull = force.reshape(fields)
            motions = motion.reshape(fields)
            grid_product.relax_balls(product.product, inverses, pull, motions, residual)
            if self._invert_patch is not None:
                self._invert_patch(force, motion)
                grid_product.find_residual(product.product, pull, motions, residual)
            # Green's function adds the motion under the forces that the motion of single balls
            # leaves. Where few balls touch it would carry these too far: there it adds that under
            # the whole force
            motion += green(force if self._is_damped else residual.reshape(force.shape))

        return apply


def _find_turns(forces: Array, slopes: Array, limits: Array, arms: Array) -> Array:
    """Return the angles (balls,) by which balls turn to where their torques vanish; zero if the
    torque vanishes at no angle, or at every one.

    All arguments are (contacts, balls), for the contacts around each ball. The tangential force of
    a contact is that of ``forces`` plus ``slopes`` times the angle, but at least minus and at most
    plus that of ``limits``. A slope has the sign of its arm, or is zero. The torque is the sum of
    these forces times ``arms``: a piecewise linear function of the angle that never falls, with
    corners where a contact begins or ceases to slide. It vanishes between two corners.
    """
    is_constant = slopes == 0.0  # whether the force of a contact does not depend on the angle
    divisors = np.where(is_constant, 1.0, slopes)
    corners = [
        np.where(is_constant, 0.0, (side * limits - forces) / divisors) for side in (-1.0, 1.0)
    ]
    angles = np.sort(np.concatenate(corners), axis=0)
    shears = np.clip(forces + slopes * angles[:, None], -limits, limits)
    torques = np.sum(arms * shears, axis=1)
    # the first angle whose torque is above zero, and the angle before it
    upper = np.clip(np.sum(torques <= 0.0, axis=0), 1, len(angles) - 1)
    bracket = np.stack([upper - 1, upper])
    low_angle, high_angle = np.take_along_axis(angles, bracket, 0)
    low_torque, high_torque = np.take_along_axis(torques, bracket, 0)
    crosses = (low_torque <= 0.0) & (high_torque >= 0.0) & (high_torque > low_torque)
    fraction = np.zeros_like(low_torque)
    np.divide(-low_torque, high_torque - low_torque, out=fraction, where=crosses)
    return np.where(crosses, low_angle + fraction * (high_angle - low_angle), 0.0)
