"""Quasi-static loading of an array of balls with friction: a path of loads, each equilibrium found from the one before.

Directions of contacts are those of the lattice, or those in which balls are (:mod:`granphon.array.geometry`). Units are
those of :mod:`granphon.array.equilibrium`, W and c W^(3/2). Contacts follow :mod:`granphon.array.friction`. With friction
the forces depend on the way to the load, which is taken in steps. At the end of each step the forces and torques on every
ball are in balance,

    C_n^T f = C_s^T T

where C_n and C_s are the rows of C for elongations and slips. Newton's method solves this, from the linear extrapolation of
the two states before. Its linear equations have the tangent of the law, C^T D C, which is not symmetric where contacts
slide, or where the shear stiffness changes with the overlap; GMRES solves them, preconditioned by Green's function of the
lattice or by the factors of :mod:`granphon.array.preconditioners`. A step that fails is taken in two halves.

The work of the load is the integral of f* dy for each contact; in the limit of short steps it is what the contacts store and
lose.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from granphon.array.equilibrium import Equilibrium, Prescribed, equilibrate
from granphon.array.friction import Contacts, FrictionLaw, Tangent
from granphon.array.geometry import Geometry, LatticeGeometry, Place
from granphon.array.preconditioners import Preconditioners
from granphon.array.stencils import Motion, Stencils, dot
from granphon.array.true_equilibrium import TrueEquilibrium, equilibrate_in_truth
from granphon.base.errors import ConvergenceError, InputError, message

__all__ = ["BALANCE_TOLERANCE", "START_SPACING", "LoadingHistory", "PressedArray"]

Array = NDArray[np.float64]
#: largest force, or torque over the diameter, left on a ball, over the mean normal force
BALANCE_TOLERANCE = 1e-9
#: reduced spacing a* = y + 1/2 at which a history begins, at rest without friction
START_SPACING = 0.5
#: tolerance of f* for the refinement of steps
REFINEMENT_TOLERANCE = 1e-4
#: relative change of f*, over the tolerance of balance, that short steps may show from what is left of balance alone
_NOISE = 10.0
#: fraction by which a given mean force may be missed
_LOAD_TOLERANCE = 1e-12
#: largest number of steps of Newton's method before a step of the load is halved; and the number in which the residual must
#: fall by half for it to go on
_NEWTON_STEPS, _PATIENCE = 120, 15
#: rounding of Coulomb's limit at the beginning of the second attempt, and that below which there is none, over the mean
#: force; factors by which it falls in steps that leave much of the residual, and in steps that leave little
_ROUNDING, _LEAST_ROUNDING = 0.1, 1e-10
_SLOW, _FAST = 0.5, 0.1
#: number of times that a step of the load is halved where Newton's method fails, and where f* is not yet accurate
_MOST_HALVINGS = 12
#: vectors that GMRES keeps, and how often it starts again
_KEPT, _RESTARTS = 60, 5
#: number of times that a step of Newton's method is halved
_LENGTHS = 6
#: stiffness added to each contact, as a fraction of the mean times the distance from balance; see the same in equilibrium
_ADDED_STIFFNESS = 1e-2
#: share of their secant stiffness that contacts which slide have in a step of Newton's method, over the root of the distance
#: from balance: without it nothing would hold a ball all of whose contacts slide
_SECANT_SHARE = 3.0


@dataclass(frozen=True, eq=False)
class PressedArray:
    """Array of balls at rest, with the forces that its history has left; in units of W and c W^(3/2).

    Attributes
    ----------
    overlap : y, common to all contacts.
    balls : (fields, L1, ..., Lp) displacements and rotations, in the coordinates of the stencils.
    contacts : state of the contacts.
    law : of the contacts.
    residual : largest force or torque (over the diameter) left on a ball, over the mean normal force.
    work : of the load since the start, a mean over contacts, in units of c W^(5/2).
    slid, loosened : energies lost since the start by sliding, and by the law of the tangential force; as ``work``.
    steps, newton, krylov : numbers of steps of the load, of Newton's method and of GMRES since the start.
    """

    overlap: float
    balls: Array
    contacts: Contacts
    law: FrictionLaw
    residual: float = 0.0
    work: float = 0.0
    slid: float = 0.0
    loosened: float = 0.0
    steps: int = 0
    newton: int = 0
    krylov: int = 0

    @cached_property
    def force(self) -> float:
        """Mean normal force f*, over all contacts, open ones included."""
        return float(np.mean(self.contacts.forces))

    @property
    def stored(self) -> float:
        """Mean energy that a contact stores, in units of c W^(5/2)."""
        return self.law.stored(self.contacts)

    @property
    def dissipated(self) -> float:
        """Energy lost since the start, a mean over contacts, in units of c W^(5/2)."""
        return self.slid + self.loosened

    @property
    def sliding_fraction(self) -> float:
        """Part of the closed contacts whose tangential force is at Coulomb's limit; zero without friction."""
        mu, forces = self.law.friction_coefficient, self.contacts.forces
        closed = forces > BALANCE_TOLERANCE * self.force
        if mu == 0.0 or mu == math.inf or not np.any(closed):
            return 0.0
        return float(np.mean(self.contacts.tangential[closed] >= mu * forces[closed] * (1.0 - 1e-12)))


@dataclass
class LoadingHistory:
    """Loading of one array along a path.

    Parameters
    ----------
    deviations : x = Delta/W, of mean zero; (L1, ..., Lp), or (n, L1, ..., Lp) of n > 1 balls in the cell.
    stencils : of the array, with the shear stiffness ratio eta above zero.
    friction_coefficient : mu of the contacts, from zero to infinity.
    tolerance : steps are halved until this changes f* along the path by less than this fraction; if it is infinite, each
        load is reached in one step.
    start : state without friction at which the history begins; by default that of a* = 1/2. In the true geometry the balls
        come to rest there anew, unless it is a state in it.
    geometry : of the contacts; by default that of the lattice, the limit of small spread.

    Raises :class:`~granphon.base.errors.InputError` if a parameter has no meaning.
    """

    deviations: Array
    stencils: Stencils
    friction_coefficient: float = math.inf
    tolerance: float = REFINEMENT_TOLERANCE
    start: Equilibrium | None = None
    geometry: Geometry | None = None

    def __post_init__(self) -> None:
        if not self.friction_coefficient >= 0.0:
            raise InputError(message(f"a friction coefficient of {self.friction_coefficient:g} is not zero or above"))
        if not self.tolerance > 0.0:
            raise InputError(message(f"a tolerance of {self.tolerance:g} for the steps of the load is not above zero"))
        if not self.stencils.mindlin_ratio > 0.0:
            raise InputError(
                message("a loading history with friction has no shear stiffness", mend="Give the stencils a mindlin_ratio")
            )
        self._law = FrictionLaw(self.stencils.mindlin_ratio, self.friction_coefficient)
        self._geometry = self.geometry or LatticeGeometry(self.stencils, self.deviations)
        self._means = self.stencils.average_pairs(self.deviations)
        self._located: tuple[Array, Place] | None = None
        self._inverses = Preconditioners(self.stencils)

    # -- the path ---------------------------------------------------------------------------------------------------

    def begin(self) -> PressedArray:
        """Return the state at the start: at rest without friction, rotations and tangential forces zero."""
        smooth = Stencils(self.stencils.shape, workers=self.stencils.workers, lattice=self.stencils.lattice)
        state = self.start or equilibrate(self.deviations, Prescribed(overlap=START_SPACING - 0.5), smooth)
        ratio = self._geometry.ratio
        if ratio and not (isinstance(state, TrueEquilibrium) and state.ratio == ratio):
            state = equilibrate_in_truth(self.deviations, Prescribed(overlap=state.overlap), ratio, smooth, state)
        cells, shape = self.stencils.n_balls, self.stencils.shape
        balls = np.zeros((cells, self.stencils.motions.count, *shape))
        balls[:, self.stencils.motions.translating] = state.balls.reshape(cells, -1, *shape)
        motion = balls.reshape(self.stencils.n_fields, *shape)
        overlaps, slips = self._geometry.begin(motion, state.overlap)
        contacts = Contacts(overlaps, slips, np.zeros_like(slips))
        return PressedArray(state.overlap, motion, contacts, self._law, state.residual)

    def path(self, loads: Iterable[Prescribed]) -> Iterator[PressedArray]:
        """Yield the state at each of the ordered ``loads``, which may go up and down.

        Raises :class:`~granphon.base.errors.ConvergenceError` where no equilibrium is found; the message states the load.
        """
        here, before = self.begin(), None
        for load in loads:
            for state in self._refine(here, before, load):
                here, before = state, here
            yield here

    def _refine(self, here: PressedArray, before: PressedArray | None, load: Prescribed) -> Iterator[PressedArray]:
        """Yield states on the way to a load, in steps so short that halving them changes little."""
        end = self.step(here, before, load)
        if self.tolerance == math.inf:
            yield end
            return
        ahead = [(load, end, self.tolerance, 0)]
        while ahead:
            load, whole, allowed, halvings = ahead.pop()
            middle = self._between(here, load)
            half = self.step(here, before, middle)
            last = self.step(half, here, load)
            # at a given force the overlap differs, which the mean stiffness makes a force
            change = abs(last.force - whole.force)
            change += abs(last.overlap - whole.overlap) * 1.5 * float(np.mean(np.sqrt(last.contacts.closed)))
            # balance to a finite residual leaves f* uncertain
            if change <= max(allowed, _NOISE * BALANCE_TOLERANCE) * last.force:
                yield half
                yield last
                here, before = last, half
            elif halvings == _MOST_HALVINGS:
                raise self._explain(load, f"halving the step still changes f* by {change / last.force:.2g}")
            else:
                ahead.append((load, last, 0.5 * allowed, halvings + 1))
                ahead.append((middle, half, 0.5 * allowed, halvings + 1))

    @staticmethod
    def _between(here: PressedArray, load: Prescribed) -> Prescribed:
        """Return the load half-way from a state to another load."""
        if load.overlap is None:
            return Prescribed(force=0.5 * (here.force + load.force))
        return Prescribed(overlap=0.5 * (here.overlap + load.overlap))

    def step(self, here: PressedArray, before: PressedArray | None, load: Prescribed) -> PressedArray:
        """Return the equilibrium under a load, from the state ``here``; ``before`` is the state before it, if there is one.

        Where Newton's method fails, the load is reached in two steps or more.
        """
        if load.overlap is None and not load.force > 0.0:
            raise InputError(message(f"a mean contact force of f* = {load.force:.3g} is not above zero"))
        ahead, halvings = [load], 0
        while ahead:
            state = self._solve(here, before, ahead[-1])
            if state is not None:
                here, before = state, here
                ahead.pop()
            elif halvings == _MOST_HALVINGS:
                raise self._explain(load, "its forces are not in balance, however short the steps")
            else:
                halvings += 1
                ahead.append(self._between(here, ahead[-1]))
        return here

    @staticmethod
    def _explain(load: Prescribed, why: str) -> ConvergenceError:
        name = f"an overlap of {load.overlap:.6g} widths" if load.overlap is not None else f"f* = {load.force:.6g}"
        what = f"the loading with friction has not reached {name}"
        return ConvergenceError(message(what, why[0].upper() + why[1:], "End the path before this load"))

    # -- one step ---------------------------------------------------------------------------------------------------

    def _locate(self, here: PressedArray) -> Place:
        """Return the configuration of a state; that asked for last is kept."""
        if self._located is None or self._located[0] is not here.balls:
            self._located = here.balls, self._geometry.place(here.balls, here.overlap)
        return self._located[1]

    def _stack(self, normal: Array, slips: Array) -> Array:
        return np.concatenate([normal, slips.reshape(-1, *self.stencils.shape)])

    def _extrapolate(self, here: PressedArray, before: PressedArray | None, load: Prescribed) -> tuple[Array, float]:
        """Return the motion and overlap to begin with, on the line through the last two states."""
        free, y = load.overlap is None, here.overlap if load.overlap is None else load.overlap
        if before is None:
            return here.balls, y
        last = here.force - before.force if free else here.overlap - before.overlap
        ahead = (load.force - here.force) if free else y - here.overlap
        if not last or abs(ahead) > 4.0 * abs(last):
            return here.balls, y
        part = ahead / last
        return here.balls + part * (here.balls - before.balls), y + part * (here.overlap - before.overlap) * free

    def _solve(self, here: PressedArray, before: PressedArray | None, load: Prescribed) -> PressedArray | None:
        """Return the equilibrium at the end of one step, or None if Newton's method does not find it.

        It is tried at first with the law as it is. Where many contacts begin or cease to slide, steps then go to and fro
        between the two sides of Coulomb's limit. So in a second attempt its corner is round, and less so after each step.
        """
        balls, y = self._extrapolate(here, before, load)
        free, newton, krylov = load.overlap is None, 0, 0
        mu = self.friction_coefficient
        for rounding in (0.0,) if mu in (0.0, math.inf) else (0.0, _ROUNDING):
            smoothing = rounding * max(here.force, load.force)
            trial = self._try(here, balls, y, load, smoothing)
            before_that = math.inf
            for count in range(_NEWTON_STEPS + 1):
                if not smoothing and trial.left <= BALANCE_TOLERANCE and trial.missed <= _LOAD_TOLERANCE:
                    return self._arrive(here, trial, newton, krylov)
                if count % _PATIENCE == 0:
                    if not smoothing and trial.size > 0.5 * before_that:
                        break
                    before_that = trial.size
                distance = max(trial.left, trial.missed)
                way, taken = self._direct(trial, distance, free)
                newton, krylov, size = newton + 1, krylov + taken, trial.size
                trial, length = self._search(here, trial, way, load, smoothing)
                if not math.isfinite(trial.size):
                    break
                if smoothing:
                    if length == 1.0:
                        smoothing *= _FAST if trial.size < _FAST * size else _SLOW
                    if smoothing < _LEAST_ROUNDING * here.force:
                        smoothing = 0.0
                    trial = self._try(here, trial.balls, trial.overlap, load, smoothing)
        return None

    def _search(
        self, here: PressedArray, trial: _Trial, way: Motion, load: Prescribed, smoothing: float
    ) -> tuple[_Trial, float]:
        """Return the state after a step of Newton's method, and the length of the step: halved until less is left."""
        length, best = 1.0, None
        for _ in range(_LENGTHS):
            motion, overlap = trial.balls + length * way.balls, trial.overlap + length * way.compression
            new = self._try(here, motion, overlap, load, smoothing)
            if best is None or new.size < best[0].size:
                best = new, length
            if new.size < (1.0 - 0.1 * length) * trial.size:
                break
            length *= 0.5
        assert best is not None
        return best

    def _try(self, here: PressedArray, balls: Array, overlap: float, load: Prescribed, smoothing: float) -> _Trial:
        place = self._geometry.place(balls, overlap)
        slips = place.slips(self._locate(here), here.contacts.slips)
        contacts, tangent = self._law.advance(here.contacts, place.overlaps, slips, smoothing)
        forces = contacts.forces
        force = float(np.mean(forces))
        pull = place.pull(forces, contacts.shears)
        push = forces.size * (load.force - force) if load.overlap is None else 0.0
        fields = pull.reshape(self.stencils.n_balls, self.stencils.motions.count, *self.stencils.shape)
        turning = fields[:, self.stencils.motions.turning]
        square = max(
            float(np.max(np.sum(self.stencils.cartesian(pull) ** 2, axis=0))),
            float(np.max(np.sum(turning**2, axis=1))) if turning.size else 0.0,
        )
        scale = force if force > 0.0 else math.inf
        size = math.sqrt(dot(pull, pull) + push * push / forces.size)
        missed = abs(push) / (forces.size * scale)
        left = math.sqrt(square) / scale if force > 0.0 else math.inf
        return _Trial(place, balls, overlap, contacts, tangent, pull, push, left, missed, size)

    def _direct(self, trial: _Trial, distance: float, free: bool) -> tuple[Motion, int]:
        """Return the step of Newton's method, and the number of iterations that it took."""
        from scipy.sparse.linalg import LinearOperator, gmres  # imported here: media that are not simulated do not need it

        stencils, tangent, contacts = self.stencils, trial.tangent, trial.contacts
        mean = float(np.mean(tangent.stiffness))
        added = _ADDED_STIFFNESS * min(1.0, distance) * mean
        tangent = tangent.stiffen(added, stencils.mindlin_ratio * added, min(1.0, _SECANT_SHARE * math.sqrt(distance)))
        springs = self._stack(tangent.stiffness, tangent.springs)
        inverse = self._inverses.choose(springs)
        held = 1.0 / (tangent.stiffness.size * mean)
        size = trial.balls.size

        def split(vector: Array) -> tuple[Array, float]:
            return vector[:size].reshape(trial.balls.shape), float(vector[size]) if free else 0.0

        def join(balls: Array, press: float) -> Array:
            return np.append(balls, press) if free else np.ravel(balls)

        def apply(vector: Array) -> Array:
            return join(*trial.place.respond(Motion(*split(vector)), tangent.apply, contacts.forces, contacts.shears))

        def precondition(vector: Array) -> Array:
            balls, press = split(vector)
            return join(inverse(balls), held * press)

        count = size + free
        right = join(trial.pull, trial.push)
        taken = [0]
        found, _ = gmres(
            LinearOperator((count, count), matvec=apply, dtype=np.float64), right,
            rtol=min(0.1, max(math.sqrt(distance), 0.1 * BALANCE_TOLERANCE / distance)), restart=_KEPT, maxiter=_RESTARTS,
            M=LinearOperator((count, count), matvec=precondition, dtype=np.float64),
            callback=lambda _: taken.__setitem__(0, taken[0] + 1), callback_type="pr_norm",
        )  # fmt: skip
        self._inverses.count(taken[0])
        return Motion(*split(found)), taken[0]

    def _arrive(self, here: PressedArray, trial: _Trial, newton: int, krylov: int) -> PressedArray:
        """Return the state at the end of a step, with energies."""
        slid, loosened = self._law.lost(here.contacts, trial.contacts)
        state = PressedArray(
            trial.overlap, trial.balls, trial.contacts, self._law, trial.left, 0.0, here.slid + slid,
            here.loosened + loosened, here.steps + 1, here.newton + newton, here.krylov + krylov,
        )  # fmt: skip
        before, after = self._locate(here), trial.place
        press = before.press(here.contacts.forces, here.contacts.shears)
        press += after.press(state.contacts.forces, state.contacts.shears)
        work = 0.5 * press * (state.overlap - here.overlap)
        return replace(state, work=here.work + work)


@dataclass(frozen=True, eq=False)
class _Trial:
    """Motion tried in a step, and what it leaves: the ``pull`` on balls, ``push`` of the load, and their norms."""

    place: Place
    balls: Array
    overlap: float
    contacts: Contacts
    tangent: Tangent
    pull: Array
    push: float
    left: float
    missed: float
    size: float
