"""One step of a loading history: Newton's method for the balance of forces and torques under the law of the contacts.

The linear equations (:mod:`granphon.array.linear_step`) are solved no more accurately than the step needs.

A ball whose contacts all slide can be turned without resistance, and a step of Newton's method would turn it without limit.
Such balls are turned by themselves after the step, to where their torques vanish while all others are held: the torque is a
piecewise linear function of the angle.
"""

from __future__ import annotations

import math
from dataclasses import replace
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from granphon.array.friction import Contacts, FrictionLaw
from granphon.array.geometry import Geometry, Place, find_lack
from granphon.array.linear_step import LinearSteps
from granphon.array.patches import Patches
from granphon.array.pressing import BALANCE_TOLERANCE, PressedArray, Trial
from granphon.array.stencils import Motion, Stencils, dot
from granphon.array.steps import ReducedLoad

Array = NDArray[np.float64]
#: fraction by which a given mean force may be missed
_LOAD_TOLERANCE = 1e-12
#: largest number of steps of Newton's method before a step of the load is halved; and the number in which the residual must
#: fall by half for it to go on
_NEWTON_STEPS, _PATIENCE = 120, 15
#: the latter where the limits of sliding have just been found anew
_SHORT_PATIENCE = 5
#: friction coefficient below which contacts are made soft against slip at first; by how much they then become stiffer at a
#: time; the part of it that may be left of balance then; and the largest number of steps of Newton's method for each
SMALL_FRICTION, _STIFFER, _NEARLY, _SOFT_STEPS = 0.02, 10.0, 0.03, 60
#: largest number of times that they become stiffer: smaller numbers lose digits
_MOST_STAGES = 300
#: largest part of the residual that the linear equations of a step may leave, and what they leave over the root of the
#: distance from balance
_LOOSEST, _FORCING = 0.1, 0.3
#: residual under the law as it is, over that from which Newton's method was tried last, below which it is tried again
_NEARER = 0.5
#: part of the residual that a whole step leaves, from which a longer one is tried, and its length: Newton's method comes to
#: the zero of h^(3/2), where a ball that nothing else holds leaves its last contact, by two thirds of the way at a time
_LEFT_BY_LOOSE, _LONGER = 0.12, 1.5
#: number of times that a step of Newton's method is halved
_LENGTHS = 6
#: stiffness added to each contact, as a fraction of the mean times the distance from balance; see the same in equilibrium
_ADDED_STIFFNESS = 1e-2
#: factor by which that is raised after a step that had to be made short, where a ball has lost what held it, and lowered
#: after a whole one; and the most, where a step is given up
_EASE, _MOST_HOLD = 10.0, 1e6
#: share of their secant stiffness that contacts which slide have in a step of Newton's method, over the distance from
#: balance: without it nothing would hold balls whose contacts all slide. In space; and in a plane, where these are turned by
#: themselves, over the distance in units of the friction coefficient
_SECANT_SHARE_IN_SPACE, _SECANT_SHARE = 30.0, 0.3
#: mean force, over that before the step, below which the array has fallen apart
_FALLEN = 1e-6
#: largest motion of a ball in a step of Newton's method, half of its rotation included, over the rms overlap
_FARTHEST = 0.2
#: stiffness of a ball against turning, over that without sliding, below which it is turned by itself
_LOOSE = 1e-2


class FixedLimitSettings(NamedTuple):
    """How the limits of sliding are found anew.

    Attributes
    ----------
    most : largest number of times.
    steps : number of steps of Newton's method after which they no longer are.
    left : part of the residual that is left with given limits before they are found anew.
    often : number of times after which Newton's method is tried with the law as it is, even where the residual under it is
        more than half of that from which it was tried last.
    """

    most: int
    steps: int
    left: float
    often: int


#: without patience, and with it: a ball that is squeezed out from between others has a long way to go, on which the limits
#: change little at a time
FAST_LIMITS, SLOW_LIMITS = FixedLimitSettings(30, 600, 1e-2, 1), FixedLimitSettings(80, 900, 1e-4, 8)


class LoadStep:
    """A step of the load, from the state ``here``, at its ``place``, to the balance of forces and torques under ``load``.

    ``drag`` is the stiffness of dashpots between neighbours, see :mod:`granphon.array.dashpots`.
    """

    def __init__(
        self,
        geometry: Geometry,
        law: FrictionLaw,
        here: PressedArray,
        place: Place,
        load: ReducedLoad,
        patches: Patches,
        drag: float = 0.0,
    ) -> None:
        self._geometry, self._stencils, self._law = geometry, geometry.stencils, law
        self._here, self._place, self._load, self._drag = here, place, load, drag
        self._patches, self._linear = patches, LinearSteps(patches, bool(drag))
        self._slides = 0.0 < law.friction_coefficient < math.inf
        # dashpots hold balls whose contacts all slide
        self._spins = self._slides and len(self._stencils.motions.rotations) == 1 and not drag

    def solve(self, balls: Array, overlap: float, lags: FixedLimitSettings | None) -> Trial:
        """Return the state to which Newton's method leads from these motions and overlap, in balance or not.

        Newton's method is tried at first with the law as it is. Where many contacts begin or cease to slide, steps then go
        to and fro between the two sides of Coulomb's limit. So in a second attempt, if ``lags`` are given, the limit is that
        of given overlaps, at which there is always an equilibrium; the overlaps found give a new limit, and from there
        Newton's method is tried.
        """
        near = self._stiffen(self._try(balls, overlap))
        trial = self._iterate(near, _NEWTON_STEPS, _PATIENCE)
        if lags is not None and not is_balanced(trial) and self._slides:
            lagged, tried = trial.follow(near), math.inf
            for lag in range(1, lags.most + 1):
                if lagged.left == math.inf or lagged.newton > near.newton + lags.steps:
                    break
                guess = lagged.contacts.overlaps
                lagged = lagged.follow(self._try(lagged.balls, lagged.overlap, guess))
                lagged = self._iterate(lagged, _PATIENCE, _PATIENCE, guess, part=lags.left)
                trial = lagged.follow(self._try(lagged.balls, lagged.overlap))
                if trial.size > _NEARER * tried and lag % lags.often:
                    continue
                tried = trial.size
                trial = self._iterate(trial, _NEWTON_STEPS, _SHORT_PATIENCE)
                if is_balanced(trial):
                    break
                lagged = trial.follow(lagged)
        return trial

    def _stiffen(self, trial: Trial) -> Trial:
        """Return a state near balance if friction is small; otherwise the state as it is.

        With small friction all contacts slide but for as few as hold the balls from turning, and Newton's method does not
        find out which. If contacts are soft against slip, fewer slide. They become stiffer and stiffer, and each equilibrium
        is near the one before. The limits of sliding are those of the overlaps before, which friction hardly changes.
        """
        mu, guess, first = self._law.friction_coefficient, None, trial
        if not self._slides or self._drag or mu >= SMALL_FRICTION:
            return trial
        # a difference of logarithms: the ratio of the smallest numbers overflows
        stages = math.ceil((math.log(SMALL_FRICTION) - math.log(mu)) / math.log(_STIFFER))
        for stage in range(min(stages, _MOST_STAGES), -1, -1):
            law = replace(self._law, mindlin_ratio=self._law.mindlin_ratio * _STIFFER**-stage)
            step = LoadStep(self._geometry, law, self._here, self._place, self._load, self._patches, self._drag)
            trial = trial.follow(step._try(trial.balls, trial.overlap, guess))
            trial = step._iterate(trial, _SOFT_STEPS, _PATIENCE, guess, _NEARLY * mu)
            if trial.left == math.inf:
                return trial.follow(first)
            guess = trial.contacts.overlaps
        return trial.follow(self._try(trial.balls, trial.overlap))

    def _iterate(
        self, trial: Trial, most: int, patience: int, guess: Array | None = None, enough: float = 0.0, part: float = 0.0
    ) -> Trial:
        """Return the state after Newton's method: ``most`` steps, of which each ``patience`` have to halve the residual.

        It ends where no more than ``enough`` is left of balance, or a ``part`` of what was left.
        """
        before, hold, slow, aim = math.inf, 1.0, False, part * trial.size
        for count in range(most):
            if is_balanced(trial) or trial.size < aim or trial.left == math.inf:  # nothing is in contact
                break
            if max(trial.left, trial.missed) <= enough:
                break
            if count % patience == 0:
                if trial.size > 0.5 * before:
                    break
                before = trial.size
            way, taken = self._direct(trial, hold)
            new, length = self._search(trial, way, guess, slow)
            slow = length == 1.0 and new.size > _LEFT_BY_LOOSE * trial.size
            turned = self._turn_loose(new, guess)
            # where contacts of turned balls change, this may undo the step, and again after the next one
            new = turned if turned.size <= trial.size else new
            trial = replace(new, newton=trial.newton + 1, krylov=trial.krylov + taken)
            if not math.isfinite(trial.size) or hold > _MOST_HOLD:
                break
            hold = max(1.0, hold / _EASE) if length == 1.0 else hold * _EASE if length < 0.5 else hold
        return trial

    def _search(self, trial: Trial, way: Motion, guess: Array | None, slow: bool) -> tuple[Trial, float]:
        """Return the state after a step of Newton's method, and the length of the step: halved until less is left.

        With a ``guess`` the slope of the energy decides. If the step before was ``slow``, a longer one is tried too.
        """

        def go(length: float) -> Trial:
            return self._try(trial.balls + length * way.balls, trial.overlap + length * way.compression, guess)

        def slope(state: Trial) -> float:
            return dot(state.pull, way.balls) + state.push * way.compression

        first, length, best = slope(trial), 1.0, (go(1.0), 1.0)
        new = best[0]
        for _ in range(_LENGTHS - 1):
            if new.size < (1.0 - 0.1 * length) * trial.size or (guess is not None and slope(new) > -0.5 * first):
                best = (new, length) if guess is not None else best
                break
            length *= 0.5
            new = go(length)
            if new.size < best[0].size:
                best = new, length
        if slow and best[1] == 1.0 and best[0].size > _LEFT_BY_LOOSE * trial.size:
            new = go(_LONGER)
            best = (new, 1.0) if new.size < best[0].size else best
        return best

    def _resist(self, contacts: Contacts, overlap: float) -> tuple[Array, Array]:
        """Return the normal forces and the tangential ones, with those of dashpots if there are any."""
        if not self._drag:
            return contacts.forces, contacts.shears
        before = self._here
        normal = contacts.overlaps - before.contacts.overlaps - (overlap - before.overlap)
        slips = contacts.slips - before.contacts.slips
        return contacts.forces + self._drag * normal, contacts.shears + self._stencils.mindlin_ratio * self._drag * slips

    def _try(self, balls: Array, overlap: float, guess: Array | None = None) -> Trial:
        place = self._geometry.place(balls, overlap)
        slips = place.slips(self._place, self._here.contacts.slips)
        contacts, linearise = self._law.advance(self._here.contacts, place.overlaps, slips, guess)
        forces, load, stencils = contacts.forces, self._load, self._stencils
        force = float(np.mean(forces))
        pull = place.pull(*self._resist(contacts, overlap))
        push = forces.size * find_lack(load, place, forces, contacts.shears)
        fields = pull.reshape(stencils.n_balls, stencils.motions.count, *stencils.shape)
        turning = fields[:, stencils.motions.turning]
        square = max(
            float(np.max(_square(stencils.cartesian(pull), 0))),
            float(np.max(_square(turning, 1))) if turning.size else 0.0,
        )
        scale = max(force, self._drag)
        scale = scale if scale > _FALLEN * self._here.force else math.inf
        size = math.sqrt(dot(pull, pull) + push * push / forces.size)
        missed = abs(push) / (forces.size * scale)
        left = math.sqrt(square) / scale if scale < math.inf else math.inf
        return Trial(place, balls, overlap, contacts, linearise, pull, push, left, missed, size)

    def _direct(self, trial: Trial, hold: float) -> tuple[Motion, int]:
        """Return the step of Newton's method, and the number of iterations that it took."""
        stencils, distance, free = self._stencils, max(trial.left, trial.missed), self._load.overlap is None
        mean, eta = float(np.mean(trial.tangent.stiffness)) + self._drag, stencils.mindlin_ratio
        added = _ADDED_STIFFNESS * min(1.0, distance * hold) * mean
        secant = _SECANT_SHARE / self._law.friction_coefficient if self._spins else _SECANT_SHARE_IN_SPACE
        share = min(1.0, secant * distance * hold)
        tangent = trial.tangent.stiffen(added, eta * added, share).damp(self._drag, eta * self._drag).scale(1.0 / mean)
        product = trial.place.linearise(tangent, trial.contacts.forces / mean, trial.contacts.shears / mean)
        reduction = min(_LOOSEST, max(_FORCING * math.sqrt(distance), 0.1 * BALANCE_TOLERANCE / distance))
        push = trial.push / mean if free else None
        way, taken = self._linear.solve(product, tangent, trial.pull / mean, push, reduction)
        return Motion(self._shorten(way.balls, trial), way.compression), taken

    def _shorten(self, found: Array, trial: Trial) -> Array:
        """Return the motions of a step, those of balls that are about to lose their hold and fall made shorter."""
        motions, n = self._stencils.motions, self._stencils.n_balls
        fields = found.reshape(n, motions.count, *self._stencils.shape)
        limit = _FARTHEST * math.sqrt(float(np.mean(trial.contacts.overlaps**2)))
        sizes = np.max(np.abs(fields[:, motions.translating]), axis=1, initial=0.0)
        np.maximum(sizes, 0.5 * np.max(np.abs(fields[:, motions.turning]), axis=1, initial=0.0), out=sizes)
        if float(np.max(sizes)) > limit:
            fields = fields * np.minimum(1.0, limit / np.maximum(sizes, limit))[:, None]
        return fields.reshape(trial.balls.shape)

    def _turn_loose(self, trial: Trial, guess: Array | None) -> Trial:
        """Return the state with balls whose contacts all slide turned by themselves until their torques vanish."""
        if not self._spins or trial.left == math.inf or is_balanced(trial):
            return trial
        stencils, tangent, least = self._stencils, trial.tangent, _LOOSE * self._law.mindlin_ratio
        loose: NDArray[np.bool_] = stencils.around(tangent.springs[0] - least * tangent.stiffness) < 0.0
        if not np.any(loose):
            return trial
        at, arms = _find_contacts(stencils, loose)
        before, after = self._here.contacts, trial.contacts
        ends = Contacts(before.overlaps[at], before.slips[0][at][None], before.shears[0][at][None])
        held = after.overlaps if guess is None else guess
        bent, springs, limits = self._law.bend(ends, held[at], after.slips[0][at][None])
        turn = _unwind(bent[0], springs * arms, limits, arms)
        turn = np.where(_find_first(stencils, at, arms, np.clip(bent[0], -limits, limits)), turn, 0.0)
        balls = trial.balls.copy()
        fields = balls.reshape(stencils.n_balls, stencils.motions.count, *stencils.shape)[:, stencils.motions.turning]
        fields[:, 0][loose.reshape(stencils.n_balls, *stencils.shape)] += turn
        return self._try(balls, trial.overlap, guess)


def _square(vectors: Array, axis: int) -> Array:
    vectors = np.moveaxis(vectors, axis, 0)
    return np.asarray(np.einsum("a...,a...->...", vectors, vectors))


def is_balanced(trial: Trial) -> bool:
    """Return whether all balls are in balance, and the load is met."""
    return trial.left <= BALANCE_TOLERANCE and trial.missed <= _LOAD_TOLERANCE


def _find_contacts(stencils: Stencils, chosen: NDArray[np.bool_]) -> tuple[tuple[Any, ...], Array]:
    """Return the indices (contacts, balls) of the contacts around chosen balls of a plane, and their slips as these turn.

    ``chosen`` has :attr:`Stencils.ball_shape`.
    """
    count, (turning,) = stencils.motions.count, range(stencils.motions.count)[stencils.motions.turning]
    ball, *cell = np.nonzero(chosen.reshape(stencils.n_balls, *stencils.shape))
    places: list[Any] = []
    arms: list[Array] = []
    slips = stencils.coefficients[:, stencils.n_contacts :].swapaxes(0, 1)
    for kind, ((head, tail), shift, (i, j)) in enumerate(zip(slips, stencils.shifts, stencils.ends, strict=True)):
        for one, steps, ends in ((j, shift, head), (i, (0,) * len(shift), -tail)):
            start = [(at - step) % size for at, step, size in zip(cell, steps, stencils.shape, strict=True)]
            places.append([np.full_like(ball, kind), *start])
            arms.append(np.where(ball == one, ends[count * one + turning], 0.0))
    return tuple(np.moveaxis(np.array(places), 1, 0)), np.array(arms)


def _find_first(stencils: Stencils, at: tuple[Any, ...], arms: Array, bent: Array) -> NDArray[np.bool_]:
    """Return which of the balls have a torque that none of the others among them that they touch exceeds.

    Balls that touch would each undo what the other's turn has brought.
    """
    torques = np.abs(np.sum(arms * bent, axis=0))
    places = np.ravel_multi_index(at, (stencils.n_contacts, *stencils.shape))
    greatest = np.zeros(stencils.n_contacts * math.prod(stencils.shape))
    felt = np.where(arms != 0.0, torques, 0.0)
    np.maximum.at(greatest, places, felt)
    return np.asarray(np.all(felt >= np.where(arms != 0.0, greatest[places], 0.0), axis=0))


def _unwind(bent: Array, springs: Array, limits: Array, arms: Array) -> Array:
    """Return the angles at which sums over the first axis of ``arms`` times clipped ``bent + springs angle`` vanish."""
    safe = np.where(springs == 0.0, 1.0, springs)
    corners = [np.where(springs == 0.0, 0.0, (side * limits - bent) / safe) for side in (-1.0, 1.0)]
    angles = np.sort(np.concatenate(corners), axis=0)
    forces = np.clip(bent + springs * angles[:, None], -limits, limits)
    torques = np.sum(arms * forces, axis=1)  # rising with the angle
    last = np.clip(np.sum(torques <= 0.0, axis=0), 1, len(angles) - 1)
    (low, high), (less, more) = (np.take_along_axis(one, np.stack([last - 1, last]), 0) for one in (angles, torques))
    crosses = (less <= 0.0) & (more >= 0.0) & (more > less)
    part = np.divide(-less, more - less, out=np.zeros_like(less), where=crosses)
    return np.where(crosses, low + part * (high - low), 0.0)
