"""One step of a loading history: Newton's method for the balance of forces and torques under the
law of the contacts.

The linear equations of a step of Newton's method are solved no more accurately than it needs. The
tangent C^T D C is not symmetric where contacts slide, or where the shear stiffness changes with the
overlap: GMRES solves for it, in single precision. The preconditioner moves each ball as if its
neighbours were held, and then all by Green's function of the lattice under what that leaves. Balls
that hold each other while nothing else holds them are found by what GMRES leaves on them, and are
then moved together (:class:`~granphon.array.preconditioners.Patches`).

A ball whose contacts all slide can be turned without resistance, and a step of Newton's method
would turn it without limit. Such balls are turned by themselves after the step, to where their
torques vanish while all others are held: the torque is a piecewise linear function of the angle.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Any, NamedTuple

import numpy as np

from granphon.array.geometry import ADDED_STIFFNESS, LOAD_TOLERANCE, find_lack
from granphon.array.krylov import Single
from granphon.array.options import ReducedLoad
from granphon.array.preconditioners import Patches, Put
from granphon.array.pressed_array import PressedArray
from granphon.array.pressed_place import PressedGeometry, PressedPlace, PressedTangent
from granphon.array.stencils import HOLDING, Motion, dot
from granphon.base.arrays import Array, Flags, Index
from granphon.contacts.friction import Contacts, FrictionLaw, Tangent

#: largest force, or torque over the diameter, left on a ball, over the mean normal force
BALANCE_TOLERANCE = 1e-9
#: Newton steps before a step of the load is halved, at most
_NEWTON_STEPS = 120
#: Newton steps in which the residual must fall by half
_PATIENCE = 15
#: the same where the limits of sliding have just been found anew
_SHORT_PATIENCE = 5
#: friction coefficient below which Newton's method is continued in the shear stiffness of contacts,
#: from soft ones on
SMALL_FRICTION = 0.02
#: factor of the shear stiffness between two stages of this continuation
_STIFFER = 10.0
#: residual at which a stage ends, over the friction coefficient
_NEARLY = 0.03
#: Newton steps of a stage, at most
_SOFT_STEPS = 60
#: stages, at most: smaller stiffnesses lose digits
_MOST_STAGES = 300
#: tolerance of the linear equations of a step, over the residual, at most
_LOOSEST = 0.1
#: tolerance of the linear equations of a step, over the root of the distance from balance
_FORCING = 0.1
#: residual under the law as it is, over that from which Newton's method was tried last, below which
#: it is tried again
_NEARER = 0.5
#: part of the residual that a whole step leaves, from which a longer one is tried
_LEFT_BY_LOOSE = 0.12
#: length of that longer step: Newton's method comes to the zero of h^(3/2), where a ball that
#: nothing else holds leaves its last contact, by two thirds of the way at a time
_LONGER = 1.5
#: number of times that a step of Newton's method is halved
_LENGTHS = 6
#: factor by which the added stiffness is raised after a step that had to be made short, where a
#: ball has lost what held it, and lowered after a whole one
_EASE = 10.0
#: raised added stiffness, over the usual one, from which the iteration is given up
_MOST_HOLD = 1e6
#: share of their secant stiffness that sliding contacts have in a step of Newton's method, over the
#: distance from balance, in space: without it nothing would hold balls whose contacts all slide
_SECANT_SHARE_IN_SPACE = 30.0
#: the same in a plane, where such balls are turned by themselves, over the distance in units of the
#: friction coefficient
_SECANT_SHARE = 0.3
#: mean force, over that before the step, below which the array has fallen apart
_FALLEN = 1e-6
#: largest motion of a ball in a step of Newton's method, half of its rotation included, over the
#: rms overlap
_FARTHEST = 0.2
#: stiffness of a ball against turning, over that without sliding, below which it is turned by
#: itself
_LOOSE = 1e-2
#: torques on balls that turn without resistance, over all that is left of balance, from which they
#: are turned by themselves
_TURNING = 0.01
#: GMRES iterations, at most
_MOST_ITERATIONS = 300
#: GMRES iterations after which weakly held balls are looked for
_FEW = 15


class FixedLimitSettings(NamedTuple):
    """How the limits of sliding are found anew.

    Attributes
    ----------
    most : largest number of times.
    steps : number of steps of Newton's method after which the limits stay as they are.
    left : part of the residual that may remain with given limits before they are found anew.
    often : number of times after which Newton's method is tried with the law as it is, even where
        the residual under it is more than half of that from which it was tried last.
    """

    most: int
    steps: int
    left: float
    often: int


#: without patience, and with it: a ball that is squeezed out from between others has a long way to
#: go, on which the limits change little at a time
FAST_LIMITS = FixedLimitSettings(most=30, steps=600, left=1e-2, often=1)
SLOW_LIMITS = FixedLimitSettings(most=80, steps=900, left=1e-4, often=8)


@dataclass(frozen=True, eq=False)
class Trial:
    """Motion tried in a step, and what it leaves: the ``pull`` on balls, ``push`` of the load, and
    their norms.

    ``linearise`` finds the tangent of the law, which few trials need.
    """

    place: PressedPlace
    balls: Array
    overlap: float
    contacts: Contacts
    linearise: Callable[[], Tangent]
    pull: Array
    push: float
    left: float
    missed: float
    size: float
    newton: int = 0
    krylov: int = 0

    @property
    def tangent(self) -> Tangent:
        """Derivatives of the contacts' forces; the law keeps them once they are found."""
        return self.linearise()

    @property
    def is_balanced(self) -> bool:
        """Whether all balls are in balance, and the load is met."""
        return self.left <= BALANCE_TOLERANCE and self.missed <= LOAD_TOLERANCE

    def follow(self, other: Trial) -> Trial:
        """Return another trial that has taken the steps of this one."""
        return replace(other, newton=self.newton, krylov=self.krylov)


class LoadStep:
    """A step of the load, from the state ``here``, at its ``place``, to the balance of forces and
    torques under ``load``.

    ``drag`` is the stiffness of dashpots between neighbours, see :mod:`granphon.array.stepper`.
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
    ) -> None:
        self._geometry = geometry
        self._stencils = geometry.stencils
        self._law = law
        self._here = here
        self._place = place
        self._load = load
        self._drag = drag
        self._patches = patches
        self._linear = LinearSteps(patches, bool(drag))
        self._slides = 0.0 < law.friction_coefficient < math.inf
        # dashpots hold balls whose contacts all slide
        self._spins = self._slides and len(self._stencils.motions.rotations) == 1 and not drag

    def solve(self, balls: Array, overlap: float, lags: FixedLimitSettings | None) -> Trial:
        """Return the state to which Newton's method leads from these motions and overlap, in
        balance or not.

        Newton's method is tried at first with the law as it is. Where many contacts begin or cease
        to slide, steps then go to and fro between the two sides of Coulomb's limit. So in a second
        attempt, if ``lags`` are given, the limit is that of given overlaps, at which there is
        always an equilibrium; the overlaps found give a new limit, and from there Newton's method
        is tried.
        """
        near = self._stiffen(self._try(balls, overlap))
        trial = self._iterate(near, _NEWTON_STEPS, _PATIENCE)
        if lags is not None and not trial.is_balanced and self._slides:
            lagged = trial.follow(near)
            tried = math.inf
            for lag in range(1, lags.most + 1):
                if lagged.left == math.inf or lagged.newton > near.newton + lags.steps:
                    break
                guess = lagged.contacts.overlaps
                lagged = lagged.follow(self._try(lagged.balls, lagged.overlap, guess))
                lagged = self._iterate(lagged, _PATIENCE, _PATIENCE, guess, share=lags.left)
                trial = lagged.follow(self._try(lagged.balls, lagged.overlap))
                if trial.size > _NEARER * tried and lag % lags.often:
                    continue
                tried = trial.size
                trial = self._iterate(trial, _NEWTON_STEPS, _SHORT_PATIENCE)
                if trial.is_balanced:
                    break
                lagged = trial.follow(lagged)
        return trial

    def _stiffen(self, trial: Trial) -> Trial:
        """Return a state near balance if friction is small; otherwise the state as it is.

        With small friction all contacts slide but for as few as hold the balls from turning, and
        Newton's method does not find out which. If contacts are soft against slip, fewer slide.
        They become stiffer and stiffer, and each equilibrium is near the one before. The limits of
        sliding are those of the overlaps before, which friction hardly changes.
        """
        mu = self._law.friction_coefficient
        guess = None
        first = trial
        if not self._slides or self._drag or mu >= SMALL_FRICTION:
            return trial
        # a difference of logarithms: the ratio of the smallest numbers overflows
        stages = math.ceil((math.log(SMALL_FRICTION) - math.log(mu)) / math.log(_STIFFER))
        for stage in range(min(stages, _MOST_STAGES), -1, -1):
            law = replace(self._law, mindlin_ratio=self._law.mindlin_ratio * _STIFFER**-stage)
            step = LoadStep(
                geometry=self._geometry,
                law=law,
                here=self._here,
                place=self._place,
                load=self._load,
                patches=self._patches,
                drag=self._drag,
            )
            trial = trial.follow(step._try(trial.balls, trial.overlap, guess))
            trial = step._iterate(trial, _SOFT_STEPS, _PATIENCE, guess, _NEARLY * mu)
            if trial.left == math.inf:
                return trial.follow(first)
            guess = trial.contacts.overlaps
        return trial.follow(self._try(trial.balls, trial.overlap))

    def _iterate(
        self,
        trial: Trial,
        most: int,
        patience: int,
        guess: Array | None = None,
        enough: float = 0.0,
        share: float = 0.0,
    ) -> Trial:
        """Return the state after Newton's method: ``most`` steps, of which each ``patience`` have
        to halve the residual.

        It ends where no more than ``enough`` is left of balance, or a ``share`` of what was left.
        """
        last_size = math.inf
        hold = 1.0
        slow = False
        aim = share * trial.size
        for count in range(most):
            if trial.is_balanced or trial.size < aim or trial.left == math.inf:
                # nothing is in contact
                break
            if max(trial.left, trial.missed) <= enough:
                break
            if count % patience == 0:
                if trial.size > 0.5 * last_size:
                    break
                last_size = trial.size
            motion, iterations = self._direct(trial, hold)
            new, length = self._search(trial, motion, guess, slow)
            slow = length == 1.0 and new.size > _LEFT_BY_LOOSE * trial.size
            turned = self._turn_loose(new, guess)
            # where contacts of turned balls change, this may undo the step, and again after the
            # next one
            new = turned if turned.size <= trial.size else new
            trial = replace(new, newton=trial.newton + 1, krylov=trial.krylov + iterations)
            if not math.isfinite(trial.size) or hold > _MOST_HOLD:
                break
            if length == 1.0:
                hold = max(1.0, hold / _EASE)
            elif length < 0.5:
                hold *= _EASE
        return trial

    def _search(
        self, trial: Trial, motion: Motion, guess: Array | None, slow: bool
    ) -> tuple[Trial, float]:
        """Return the state after a step of Newton's method, and the length of the step: halved
        until less is left.

        With a ``guess`` the slope of the energy decides. If the step before was ``slow``, a longer
        one is tried too.
        """

        def go(length: float) -> Trial:
            """Return the trial after a part ``length`` of the motion."""
            return self._try(
                trial.balls + length * motion.balls,
                trial.overlap + length * motion.compression,
                guess,
            )

        def slope(state: Trial) -> float:
            """Return the power, along the motion, of the forces that a state leaves."""
            return dot(state.pull, motion.balls) + state.push * motion.compression

        slope_at_start = slope(trial)
        length = 1.0
        new = go(length)
        best = new
        best_length = length
        for _ in range(_LENGTHS - 1):
            leaves_less = new.size < (1.0 - 0.1 * length) * trial.size
            is_past_half = guess is not None and slope(new) > -0.5 * slope_at_start
            if leaves_less or is_past_half:
                if guess is not None:
                    best = new
                    best_length = length
                break
            length *= 0.5
            new = go(length)
            if new.size < best.size:
                best = new
                best_length = length
        if slow and best_length == 1.0 and best.size > _LEFT_BY_LOOSE * trial.size:
            new = go(_LONGER)
            best = new if new.size < best.size else best
        return best, best_length

    def _try(self, balls: Array, overlap: float, guess: Array | None = None) -> Trial:
        """Return the trial with the ``balls`` displaced, (fields, L1, ..., Lp), at an ``overlap``;
        ``guess`` are overlaps that say how stiff contacts are against slip.
        """
        from granphon.contacts.slips import find_largest  # averages need no Numba

        place = self._geometry.place(balls, overlap)
        start = self._here.contacts
        slips = place.find_slips(self._place, start.slips)
        contacts, linearise = self._law.advance(start, place.overlaps, slips, guess)
        forces = contacts.forces
        load = self._load
        stencils = self._stencils
        force = float(np.mean(forces))
        normal = forces
        shears = contacts.shears
        if self._drag:  # dashpots resist what neighbours have moved against each other
            loss = contacts.overlaps - start.overlaps - (overlap - self._here.overlap)
            normal = forces + self._drag * loss
            shears = shears + stencils.mindlin_ratio * self._drag * (contacts.slips - start.slips)
        on_balls = place.push(normal, shears)
        pull = self._geometry.collect_forces(*on_balls)
        push = forces.size * find_lack(load, place, forces, contacts.shears)
        largest = max(map(find_largest, on_balls))
        size = math.sqrt(dot(pull, pull) + push * push / forces.size)
        scale = max(force, self._drag)
        missed = 0.0
        left = math.inf  # balls that have come apart are far from balance
        if _FALLEN * self._here.force < scale < math.inf:
            missed = abs(push) / (forces.size * scale)
            left = largest / scale
        return Trial(
            place=place,
            balls=balls,
            overlap=overlap,
            contacts=contacts,
            linearise=linearise,
            pull=pull,
            push=push,
            left=left,
            missed=missed,
            size=size,
        )

    def _direct(self, trial: Trial, hold: float) -> tuple[Motion, int]:
        """Return the step of Newton's method, and the number of iterations that it took."""
        stencils = self._stencils
        distance = max(trial.left, trial.missed)
        free = self._load.overlap is None
        mean = float(np.mean(trial.tangent.stiffness)) + self._drag
        eta = stencils.mindlin_ratio
        added = ADDED_STIFFNESS * min(1.0, distance * hold) * mean
        secant = (
            _SECANT_SHARE / self._law.friction_coefficient
            if self._spins
            else _SECANT_SHARE_IN_SPACE
        )
        share = min(1.0, secant * distance * hold)
        tangent = trial.tangent.regularise(added, eta, share, self._drag, mean)
        product = trial.place.linearise(
            tangent, trial.contacts.forces / mean, trial.contacts.shears / mean, free=free
        )
        reduction = min(
            _LOOSEST, max(_FORCING * math.sqrt(distance), 0.1 * BALANCE_TOLERANCE / distance)
        )
        push = trial.push / mean if free else None
        motion, iterations = self._linear.solve(
            product, tangent, trial.pull / mean, push, reduction
        )
        # the motions of balls that are about to lose their hold and fall are made shorter
        fields = motion.balls.reshape(stencils.n_balls, stencils.motions.count, *stencils.shape)
        limit = _FARTHEST * math.sqrt(float(np.mean(trial.contacts.overlaps**2)))
        sizes = np.max(np.abs(fields[:, stencils.motions.translating]), axis=1, initial=0.0)
        np.maximum(
            sizes,
            0.5 * np.max(np.abs(fields[:, stencils.motions.turning]), axis=1, initial=0.0),
            out=sizes,
        )
        if float(np.max(sizes)) > limit:
            fields = fields * np.minimum(1.0, limit / np.maximum(sizes, limit))[:, None]
        return Motion(fields.reshape(trial.balls.shape), motion.compression), iterations

    def _turn_loose(self, trial: Trial, guess: Array | None) -> Trial:
        """Return the state with balls whose contacts all slide turned by themselves until their
        torques vanish.
        """
        if not self._spins or trial.left == math.inf or trial.is_balanced:
            return trial
        stencils = self._stencils
        loose = self._find_loose(trial)
        count = stencils.motions.count
        (turning,) = range(count)[stencils.motions.turning]
        torque = trial.pull.reshape(-1, count, *stencils.shape)[:, turning][loose]
        if not dot(torque, torque) > (_TURNING * trial.size) ** 2:
            return trial
        index, arms = self._list_around(loose, turning)
        start = self._here.contacts
        end = trial.contacts
        ends_before = Contacts(
            start.overlaps[index], start.slips[0][index][None], start.shears[0][index][None]
        )
        held = end.overlaps if guess is None else guess
        bent, springs, limits = self._law.bend(ends_before, held[index], end.slips[0][index][None])
        turns = _find_turns(bent[0], springs * arms, limits, arms)
        # balls that touch would each undo what the other's turn has brought: of those the one with
        # the greatest torque turns
        torques = np.abs(np.sum(arms * np.clip(bent[0], -limits, limits), axis=0))
        numbers = np.ravel_multi_index(index, (stencils.n_contacts, *stencils.shape))
        torques_at_contacts = np.where(arms != 0.0, torques, 0.0)
        greatest = np.zeros(end.overlaps.size)
        np.maximum.at(greatest, numbers, torques_at_contacts)
        greatest_around = np.where(arms != 0.0, greatest[numbers], 0.0)
        has_greatest = np.all(torques_at_contacts >= greatest_around, axis=0)
        balls = trial.balls.copy()
        fields = balls.reshape(stencils.n_balls, count, *stencils.shape)
        rotations = fields[:, turning]
        rotations[loose] += np.where(has_greatest, turns, 0.0)
        return self._try(balls, trial.overlap, guess)

    def _find_loose(self, trial: Trial) -> Flags:
        """Return (balls, L1, ..., Lp) which balls have contacts that all slide."""
        stencils = self._stencils
        tangent = trial.tangent
        least = _LOOSE * self._law.mindlin_ratio
        resisting = np.ravel(tangent.springs[0] - least * tangent.stiffness)
        contacts = self._geometry.contacts
        n_balls = stencils.n_balls * math.prod(stencils.shape)
        around = np.bincount(contacts.i, resisting, n_balls)
        around += np.bincount(contacts.j, resisting, n_balls)
        return np.asarray(around.reshape(stencils.n_balls, *stencils.shape) < 0.0)

    def _list_around(self, loose: Flags, turning: int) -> tuple[tuple[Index, ...], Array]:
        """Return the index (contacts, balls) of the contacts around each of the ``loose`` balls,
        and their slips as the ball turns, which is the ``turning`` motion of it; zero for contacts
        of other balls of the cell.
        """
        stencils = self._stencils
        count = stencils.motions.count
        ball, *cell = np.nonzero(loose)
        places: list[Any] = []
        arms: list[Array] = []
        slips = stencils.coefficients[:, stencils.n_contacts :].swapaxes(0, 1)
        for kind, ((head, tail), shift, (i, j)) in enumerate(
            zip(slips, stencils.shifts, stencils.ends, strict=True)
        ):
            for end, steps, slip in ((j, shift, head), (i, (0,) * len(shift), -tail)):
                first_cell = [
                    (coordinate - step) % size
                    for coordinate, step, size in zip(cell, steps, stencils.shape, strict=True)
                ]
                places.append([np.full_like(ball, kind), *first_cell])
                arms.append(np.where(ball == end, slip[count * end + turning], 0.0))
        return tuple(np.moveaxis(np.array(places), 1, 0)), np.array(arms)


class LinearSteps:
    """Solver of the equations of steps that follow each other; it keeps the patch of weakly held
    balls.

    ``damped`` arrays have dashpots: few of their balls touch.
    """

    def __init__(self, patches: Patches, damped: bool) -> None:
        self._stencils = patches.stencils
        self._patches = patches
        self._damped = damped
        self._weak: Index = np.empty(0, np.intp)
        self._put: Put | None = None

    def solve(
        self,
        product: PressedTangent,
        tangent: Tangent,
        pull: Array,
        push: float | None,
        reduction: float,
    ) -> tuple[Motion, int]:
        """Return the motion that takes all but the part ``reduction`` of a ``pull`` away, and the
        number of iterations.

        The mean stiffness of the ``tangent`` is one; its ``product`` is that of the geometry.
        Without a ``push``, the force that the contacts lack in sum, the overlap stays as it is.
        """
        from granphon.array.minimal_residuals import solve_by_minimal_residuals  # compiled

        size = pull.size
        inverse = self.invert(tangent, product)
        held = np.float32(1.0 / tangent.stiffness.size)

        # the last entry of a vector is the change of the overlap, or what lacks of the load
        def apply(vector: Single, image: Single) -> None:
            image[size] = product.resist(vector[:size], vector[size], image[:size])

        def precondition(vector: Single, image: Single) -> None:
            inverse(vector[:size].reshape(pull.shape), image[:size].reshape(pull.shape))
            image[size] = held * vector[size]

        right = np.append(pull, push or 0.0)
        solution = np.zeros_like(right)
        residual = right
        taken = 0
        most = _FEW
        renewed = False
        goal = reduction * math.sqrt(dot(right, right))
        while taken < _MOST_ITERATIONS:
            norm = math.sqrt(dot(residual, residual))
            if not norm > goal:
                break
            change, count = solve_by_minimal_residuals(
                apply, precondition, residual, goal / norm, most
            )
            solution += change
            taken += count
            if count < most:
                break
            product_of_solution = np.empty(right.size, np.float32)
            apply(solution.astype(np.float32), product_of_solution)
            residual = right - product_of_solution
            weak = self._patches.join(
                self._weak, self._patches.find_worst(residual[:size].reshape(pull.shape))
            )
            if weak.size == self._weak.size and (renewed or not weak.size):
                # the patch has no more to give
                most = _MOST_ITERATIONS - taken
            else:
                self._weak = weak
                self._put = self._patches.invert(weak, tangent)
                renewed = True
        return Motion(solution[:size].reshape(pull.shape), float(solution[size])), taken

    def invert(self, tangent: Tangent, product: PressedTangent) -> Put:
        """Return a preconditioner of C^T D C, whose products with motions are those of ``product``:
        a function that sets motions to about those under given forces.

        The patch may be that of an earlier tangent: it is made anew only when it does not serve any
        more.
        """
        from granphon.contacts import grid_product  # imported here: averages need no Numba

        level = float(np.mean(tangent.stiffness))
        alone = product.invert_alone(HOLDING * level)
        green = self._stencils.green_preconditioner(np.float32, level)

        fields = (self._stencils.n_fields, 1, math.prod(self._stencils.shape))
        remaining = np.empty(fields, np.float32)

        def apply(force: Single, motion: Single) -> None:
            """Add to ``motion`` what the preconditioner makes of a ``force``, both flat."""
            pull = force.reshape(fields)
            moved = motion.reshape(fields)
            moved[:] = 0.0
            grid_product.add_alone(alone, pull, moved)
            grid_product.leave(product.product, pull, moved, remaining)
            if self._put is not None:
                self._put(force, motion)
                grid_product.leave(product.product, pull, moved, remaining)
            # where few balls touch, Green's function would pass on what each ball's own motion
            # leaves too far
            motion += green(force if self._damped else remaining.reshape(force.shape))

        return apply


def _find_turns(bent: Array, pull: Array, limits: Array, arms: Array) -> Array:
    """Return the angles (balls,) by which balls turn until their torques vanish; zero where no
    angle does it.

    Of the contacts (contacts, balls) around each ball ``bent`` are the shears without a turn, which
    grow by ``pull`` times the angle up to the ``limits``; the torque is the sum of the shears times
    ``arms``. It rises with the angle, and vanishes between two of the angles at which a contact
    begins to slide.
    """
    safe = np.where(pull == 0.0, 1.0, pull)
    corners = [np.where(pull == 0.0, 0.0, (side * limits - bent) / safe) for side in (-1.0, 1.0)]
    angles = np.sort(np.concatenate(corners), axis=0)
    shears = np.clip(bent + pull * angles[:, None], -limits, limits)
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
