"""Mechanical equilibrium without friction of an array in its true geometry.

The energy is the sum of (2/5) h_+^(5/2) over all contacts, with the overlaps of
:mod:`granphon.array.geometry`. Away from the limit of small spread it is no longer convex: a
contact that carries a force f pushes the balls aside, with the stiffness -f W/d. On the lattice a
ball between two others in line may stay there. In truth it moves out until it touches a third,
which then carries a force of the order f W/d. From the equilibrium on the lattice loose balls are
led there apart from the others (:mod:`granphon.array.cages`), and Newton's method brings all nearer
to rest, in turn; if that does not end, the interior-point method (:mod:`granphon.array.interior`)
leads all together. With the sign of -f W/d turned, a step is about as long as the ball is far from
the line. Where the way ends so near the line that hardly any force is left on the ball, that is a
saddle of the energy, and no minimum: so at rest the curvature is probed, and where it is below zero
the balls go downhill along that direction, and on from there.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from granphon.array.cages import Cages
from granphon.array.contact_lists import Springs, list_in_true_directions, select_resisted
from granphon.array.equilibrium import CARRIED_FORCE, REST_TOLERANCE, Equilibrium, equilibrate
from granphon.array.geometry import (
    ADDED_STIFFNESS,
    LOAD_TOLERANCE,
    ActingForces,
    ExactGeometry,
    ExactPlace,
    Inverse,
    ReducedLoad,
    find_lack,
)
from granphon.array.interior import CLOSE, approach
from granphon.array.krylov import conjugate_gradients
from granphon.array.preconditioners import MOST_BALLS, Preconditioners
from granphon.array.sparse_matrices import compose_hessian
from granphon.array.stencils import Motion, Stencils, dot
from granphon.balls import hertz
from granphon.base.arrays import Array
from granphon.base.errors import ConvergenceError, InputError
from granphon.contacts.contact_list import ContactList
from granphon.dynamics.factors import factorise
from granphon.statics.response import LinearResponse

#: force left on a ball over W/d times the mean force, at most: loose balls carry forces of about
#: that
_OF_RATIO = 1e-4
#: least tolerance that rounding allows
_LEAST_TOLERANCE = 1e-12
#: Newton steps, at most
_NEWTON_STEPS = 400
#: trials of a line search, at most
_LENGTHS = 12
#: part of a step that is tried next if no balls touch at its end
_CLOSER = 0.03
#: fraction of contacts that are stiff, above which Green's function is kept: of many contacts with
#: light forces it knows nothing, so that factors pay earlier than on the lattice
_MOST_STIFF = 0.8
#: force of a contact, over the mean, up to which it is light: balls with fewer heavy contacts than
#: hold one are loose
_LIGHT = 1e-3
#: largest number of times that loose balls, and then all together, are brought nearer to rest; from
#: a saddle, where rounding alone decides which way to go, the way down takes some ten of them
_ROUNDS = 60
#: force that may be left on a loose ball, over the mean, in units of W/d or of what is left on
#: others, if that is less
_OF_LOOSE = 1e-3
#: force left on a ball after a step, over the most before it, from which the ball counts as loose
#: too
_FAILED = 0.3
#: force left on a ball after a whole step of Newton's method, over the mean, from which the step is
#: not taken. Loose balls that it pushes into others are left with up to some forty, and come to
#: rest sooner than by shorter steps
_TOO_FAR = 1e2
#: relative residual of the equations of a step, at most: with more of it soft motions are hardly
#: solved for, and come to rest over many steps more (128 x 128 balls at a* = 0.4: 43 steps with
#: 0.1, 29 with 0.01, 36 with 0.001)
_INEXACT = 1e-2
#: length of a step away from a saddle, in steps of Newton's method with the other sign, at most
_LONGEST = 2.0**10
#: force that holds a ball which moves aside, over W/d times the force that pushes it there, at
#: least: the distance in W
_ASIDE = 1e-2
#: largest number of times that balls go down from a saddle
_MOST_SADDLES = 50
#: part of the error of a response to random forces that is left when the curvature has been probed
_PROBED = 1e-6
#: iterations of conjugate gradients that probe the curvature, after which factors are tried
_PROBE_PATIENCE = 200
#: the same, at most
_PROBE_STEPS = 20_000
#: curvature below zero, over that of the same contacts if they moved along their directions, that
#: may be rounding
_ROUNDING = 1e-13
#: tighter tolerance, as a fraction of the usual residual, for balls held only by contacts whose
#: force is comparable with the residual
_FINER = 1e-2
#: displacement of a ball, in W, with which the way down from a saddle begins
_FIRST_MOVE = 1e-2
#: times that this displacement is doubled, at most
_DOUBLINGS = 6


@dataclass(frozen=True, eq=False, repr=False)
class TrueEquilibrium(Equilibrium):
    """Sample at rest without friction in its true geometry, in units of W and c W^(3/2).

    ``overlap`` is y = (d - a)/W, with the spacing a of the compressed cell. Other attributes are
    those of :class:`~granphon.array.equilibrium.Equilibrium`. ``stiffness`` is df*/dy of the mean
    normal force.
    """

    def _act(self, residual: float | None = None) -> ActingForces:
        """Return the contacts that carry load, without friction.

        Balls that light contacts push aside lean on others with about W/d of their force. Where
        that cannot be told from a ``residual``, by default the own one, the light contacts hold
        instead, with W/d of their force.
        """
        stiffness = self.stiffnesses
        least = CARRIED_FORCE * (self.residual if residual is None else residual) * self.force
        carried = np.where(_ASIDE * self.ratio * self.forces > least, self.forces, -self.forces) * (
            stiffness > 0.0
        )
        return ActingForces(lambda loss, slip: (stiffness * loss, slip), carried)

    def _act_at_rest(self, shear: Array | None = None) -> ActingForces:
        """Return what :meth:`_act` does where the energy is known to be least.

        A ball nearly in line with two others may lean on a third with less than can be told from
        the residual. It is at rest all the same: what pushes it aside then holds it. Contacts that
        resist slip with ``shear`` times their stiffness hold balls themselves, and light ones need
        not.
        """
        acting = self._act()
        stencils = self.stencils
        stiffness = self.stiffnesses
        if shear is not None:
            acting = acting._replace(forces=np.abs(acting.forces))
            pushing = self.ratio * acting.forces / self.place.size
            if np.all(shear * stiffness >= pushing):
                return acting
        axes = self.place.geometry.axes()
        table = self.place.tabulate_stiffness(stiffness, acting.forces)
        if shear is not None:
            normal = np.array(self.place.normal[: len(table)])
            table -= shear * stiffness * normal[:, None] * normal
            for axis in range(len(table)):
                table[axis, axis] += shear * stiffness
        blocks = [
            [stencils.around(one) for one in row]
            for row in np.einsum("nka,kln...,nlb->abn...", axes, table, axes)
        ]
        aside = np.linalg.eigvalsh(np.moveaxis(np.array(blocks), (0, 1), (-2, -1)))[..., 0] < 0.0
        leans = stencils.average_pairs(aside.astype(float)) > 0.0
        return acting._replace(forces=np.where(leans, -np.abs(acting.forces), acting.forces))

    def _follow(self) -> tuple[Callable[[Array], Array], Any]:
        """Return what finds small motions of the balls, and the relative displacements of contacts
        with y.
        """
        acting = self._act_at_rest()
        still = np.zeros_like(self.balls)
        pull, _ = self.place.respond(Motion(still, 1.0), acting)
        stencils = self.stencils
        response = LinearResponse(self._list_contacts())

        def find(forces: Array) -> Array:
            motions = response.find_motions(stencils.list_forces(forces)[..., None])
            return stencils.gather_motions(motions[..., 0])

        return find, self.place.geometry.split(Motion(find(-pull), 1.0))[0]

    def response(self) -> Array:
        """Return (n_c, L1, ..., Lp) derivatives of the contacts' overlaps with respect to y;
        computed anew at each call.
        """
        return -self.place.lose(self._follow()[1])

    @cached_property
    def _derivatives(self) -> tuple[float, float]:
        place = self.place
        find, moved = self._follow()
        loss = place.lose(moved)
        stiffness = self.stiffnesses
        # the second derivatives: of the overlaps along the motion itself, and by the motion that
        # balances those of forces
        bend, push = place.curve(moved, self.forces, stiffness, self.stiffness_slopes)
        more = bend - place.lose(
            place.geometry.split(Motion(find(place.geometry.join(push, *_STILL)), 0.0))[0]
        )
        return float(np.mean(-stiffness * loss)), float(
            np.mean(self.stiffness_slopes * loss**2 + stiffness * more)
        )

    def find_negative_curvature(
        self, choose: Callable[[], Inverse], patience: int = _PROBE_PATIENCE
    ) -> tuple[Array | None, int]:
        """Return a motion of the balls along which the curvature of the energy is below zero, None
        if there is none.

        The overlap y is kept. Conjugate gradients look for the response to random forces, of which
        each contact bears as much energy along its direction as across; while they do, they meet
        such a motion. The number is that of iterations; ``choose`` returns a preconditioner. After
        ``patience`` iterations factors are tried, where they are small. They do not come first:
        their pivots allow for rounding, within which the response may meet a curvature below zero.
        """
        forces = self._act(min(self.residual, _LEAST_TOLERANCE)).forces
        stiffness = self.stiffnesses
        may_factorise = len(self.stencils.shape) == 2 and self.deviations.size <= MOST_BALLS[1]
        down, generator, taken = list[Array](), np.random.default_rng(0), 0
        along = np.sqrt(stiffness)
        across = np.sqrt(self.ratio * np.abs(forces))
        push: list[Any] = [
            one * generator.standard_normal(along.shape) for one in (along, across, across)
        ]
        push[len(self.stencils.shape) :] = [0.0] * (3 - len(self.stencils.shape))
        product, inverse = self.place.multiply(stiffness, forces), choose()

        def apply(vector: Array) -> Array:
            motion = Motion(vector.reshape(self.balls.shape), 0.0)
            change = np.ravel(product(motion.balls, None)[0])
            curvature = dot(vector, change)
            if curvature < 0.0:
                moved = self.place.geometry.split(motion)[0]
                if curvature < -_ROUNDING * sum(float(np.sum(stiffness * one**2)) for one in moved):
                    down.append(motion.balls)
            return change

        right = np.ravel(self.place.geometry.join((push[0], push[1], push[2]), *_STILL))
        for limit in (patience, _PROBE_STEPS) if may_factorise else (_PROBE_STEPS,):
            _, more, _ = conjugate_gradients(
                apply,
                lambda vector: np.ravel(inverse(vector.reshape(self.balls.shape))),
                right,
                _PROBED,
                limit,
            )
            taken += more
            if (
                down
                or more < limit
                or (limit < _PROBE_STEPS and self._has_no_curvature_below_zero(stiffness, forces))
            ):
                break
        return (down[0] if down else None), taken

    def _has_no_curvature_below_zero(self, stiffness: Array, forces: Array) -> bool:
        """Return whether factors show that no curvature is below zero."""
        from scipy.sparse import diags_array  # imported here: most simulations do not need it

        p = len(self.stencils.shape)
        table = self.place.tabulate_stiffness(stiffness, forces)
        for axis in range(p):
            table[axis, axis] += _ROUNDING * stiffness
        matrix = compose_hessian(self.place.geometry.frame, table)
        # balls that touch no other cost no energy, nor does a motion of all balls: they are held,
        # and one of all
        diagonal = matrix.diagonal().reshape(p, -1)
        held = np.where(diagonal > 0.0, 0.0, 1.0)
        held[:, np.argmax(diagonal[0])] = 1.0
        factors = factorise(matrix + diags_array(float(np.mean(stiffness)) * held.ravel()))
        return factors.n_below == 0

    def _list_contacts(
        self, shear: ArrayLike = 0.0, torsion: ArrayLike = 0.0, bending: float = 0.0
    ) -> ContactList:
        """Return the contacts with their springs and the forces that act, so that elastic constants
        include prestress; those that carry no load have none.
        """
        ratio = np.asarray(shear, float)
        turns = bool(np.any(ratio))
        if not turns:
            # only shear turns balls that are strained: without it twist and roll store nothing
            torsion = bending = 0.0
        forces = self._act_at_rest(ratio if turns else None).forces
        return list_exact_contacts(self, forces, ratio, torsion, bending, turns)


def list_exact_contacts(
    state: Equilibrium,
    forces: Array,
    shear: Array,
    torsion: ArrayLike,
    bending: float,
    turns: bool = True,
    shears: Array | None = None,
) -> ContactList:
    """Return the contacts of a state at rest in the true geometry, with the forces that act.

    ``forces`` (n_c, L1, ..., Lp) are normal, below zero where they hold balls that go aside, and
    ``shears`` (contacts, 3) tangential, if there are any. ``shear``, ``torsion`` and ``bending``
    are those of :meth:`~granphon.array.equilibrium.Equilibrium.find_elasticity`; ``turns`` says
    whether balls rotate.
    """
    normal = state.stiffnesses
    springs = Springs.of(normal, shear * normal, np.asarray(torsion) * normal, bending * normal)
    return list_in_true_directions(
        state.place,
        select_resisted(state.lattice, float(turns), torsion, bending),
        springs,
        np.abs(forces),
        forces < 0.0,
        shears,
    )


_STILL = ((0.0, 0.0, 0.0), (0.0, 0.0, 0.0))


def equilibrate_exactly(
    deviations: Array,
    load: ReducedLoad,
    ratio: float,
    stencils: Stencils | None = None,
    start: Equilibrium | None = None,
    tolerance: float | None = None,
) -> TrueEquilibrium:
    """Find the equilibrium without friction of an array of balls under a load, in its true
    geometry.

    Parameters
    ----------
    deviations, load, stencils : as in :func:`~granphon.array.equilibrium.equilibrate`. The overlap
        is that of the spacing of the cell; the force is the mean normal force over all contacts.
    ratio : W/d.
    start : equilibrium from which to begin; by default that on the lattice under the same load.
    tolerance : largest force left on a ball, over the mean contact force; by default 1e-10, and
        less if W/d is below 1e-6.

    Raises errors as :func:`~granphon.array.equilibrium.equilibrate` does.
    """
    stencils = stencils or Stencils(deviations.shape)
    start = start or equilibrate(deviations, load, stencils)
    if tolerance is None:
        tolerance = (
            min(REST_TOLERANCE, max(_LEAST_TOLERANCE, _OF_RATIO * ratio))
            if ratio
            else REST_TOLERANCE
        )
    geometry = ExactGeometry(stencils, deviations, ratio)
    path = _Path(geometry, load, start, tolerance)
    state = path.part() or path.lead()
    found = replace(
        state, newton=start.newton + path.newton, conjugate=start.conjugate + path.conjugate
    )
    vars(found)["place"] = state.place
    geometry.held.forget()  # many samples may be kept, each with a large Green's function
    return found.share(deviations, stencils)


class _Path:
    """Way of an array to rest from an equilibrium ``start``, and the numbers of steps and
    iterations on it.
    """

    def __init__(
        self, geometry: ExactGeometry, load: ReducedLoad, start: Equilibrium, tolerance: float
    ) -> None:
        self._geometry = geometry
        self._load = load
        self._start = start
        self._tolerance = tolerance
        self._inverses = Preconditioners(geometry.held, _MOST_STIFF)
        self._overlap = start.overlap if load.overlap is None else load.overlap
        self._saddles = self.newton = self.conjugate = 0

    def part(self) -> TrueEquilibrium | None:
        """Return the state at rest, None if it is not found so: loose balls are led to rest apart
        from the others.
        """
        geometry = self._geometry
        stencils = self._geometry.stencils
        cages = Cages(geometry)
        heavy = self._start.forces > _LIGHT * self._start.force
        loose = (stencils.around(heavy.astype(float)) <= len(stencils.shape)).ravel()
        trial = self._try(self._start.balls, self._overlap)
        for _ in range(_ROUNDS):
            outside = float(np.max(trial.on_balls, where=~loose, initial=0.0))
            if np.any(trial.on_balls[loose]):
                least = max(
                    _FINER * self._tolerance,
                    0.5 * _LEAST_TOLERANCE,
                    _OF_LOOSE * min(geometry.ratio, outside),
                )
                settled = cages.settle(trial.balls, trial.overlap, loose, trial.force, least)
                trial = self._try(settled, trial.overlap, far=True)
                if not trial.force > 0.0:
                    # the balls that bore the load are among them: all are led to rest together
                    return None
            if trial.left <= self._tolerance and trial.missed <= LOAD_TOLERANCE:
                trial, state = self._probe(trial)
                if state or self._saddles > _MOST_SADDLES:
                    return state
            before = max(trial.left, trial.missed)
            step = self._find_step(trial, truly=True)
            ahead = self._try(trial.balls + step.balls, trial.overlap + step.compression, far=True)
            slope = trial.slope(step)
            length = 1.0
            # away from a saddle a step with the other sign is as long as the way so far: go on
            # while the energy falls faster
            while ahead.slope(step) < slope and length < _LONGEST:
                slope = ahead.slope(step)
                length = 2.0 * length
                balls = trial.balls + length * step.balls
                overlap = trial.overlap + length * step.compression
                farther = self._try(balls, overlap, far=True)
                if farther.left > _TOO_FAR or farther.slope(step) > slope:
                    break
                ahead = farther
            # with the true sign, a step along which there is hardly any curvature has no end
            trial = ahead if ahead.left <= _TOO_FAR else self._search(trial)
            loose |= trial.on_balls > _FAILED * before
        return None

    def lead(self) -> TrueEquilibrium:
        """Return the state at rest, to which the interior-point method leads all balls together."""
        force = self._load.force if self._load.overlap is None else None
        close = min(CLOSE, _OF_RATIO * self._geometry.ratio)
        overlap = self._overlap
        balls = self._start.balls
        found = approach(self._geometry, overlap, balls, force, self._inverses, False, close)
        if found:
            overlap, balls, newton, conjugate = found
            self.newton = self.newton + newton
            self.conjugate = self.conjugate + conjugate
        trial = self._try(balls, overlap)
        for _ in range(_NEWTON_STEPS):
            if trial.left <= self._tolerance and trial.missed <= LOAD_TOLERANCE:
                trial, state = self._probe(trial)
                if state:
                    return state
                if self._saddles > _MOST_SADDLES:
                    break
            trial = self._search(trial)
        raise ConvergenceError(
            f"the sample has not come to rest in its true geometry after {_NEWTON_STEPS} steps",
            f"At an overlap of {trial.overlap:.6g} widths a force of {trial.left:.2g} of the"
            f" mean contact force is left",
            "Raise the load, take fewer balls, or take geometry: lattice",
        )

    def _search(self, trial: _Trial) -> _Trial:
        """Return the state after a step of Newton's method, as far along it as the energy falls
        fast.
        """
        step = self._find_step(trial)
        first = trial.slope(step)
        low = 0.0
        high = math.inf
        at_low = first
        length = 1.0
        kept = trial
        for _ in range(_LENGTHS):
            there = self._try(
                trial.balls + length * step.balls,
                trial.overlap + length * step.compression,
                far=True,
            )
            slope = there.slope(step)
            if not there.force > 0.0:
                # so far along a step with hardly any curvature that no balls touch
                high = length
                length = low + _CLOSER * (high - low)
                continue
            kept = there
            if abs(slope) <= 0.3 * abs(first) or (slope < 0.0 and high == math.inf):
                break
            if slope > 0.0:
                high = length
                length = min(
                    max(low + (high - low) * at_low / (at_low - slope), low + 0.1 * (high - low)),
                    high,
                )
            else:
                low = length
                at_low = slope
                length = 0.5 * (low + high)
        return kept

    def _try(self, balls: Array, overlap: float, far: bool = False) -> _Trial:
        """Return the state with these displacements; one that is ``far``, along a step, may be
        without load.
        """
        found = _Trial(self._geometry.place(balls, overlap), self._load)
        if not (far or found.force > 0.0):
            raise InputError(f"at an overlap of {overlap:.6g} widths this sample carries no load")
        return found

    def _find_step(self, trial: _Trial, truly: bool = False) -> Motion:
        """Return the step of Newton's method; see
        :meth:`~granphon.array.geometry.ExactGeometry.solve`.
        """
        distance = max(trial.left, trial.missed)
        stiffness = hertz.stiffness_of(trial.root)
        stiffness += ADDED_STIFFNESS * min(1.0, distance) * float(np.mean(stiffness))
        weights = self._geometry.weigh(stiffness, trial.forces)
        inverse, most = self._inverses.choose(weights), self._inverses.find_patience(weights)
        for limit in (most, None) if most else (None,):
            step, conjugate = self._geometry.solve(
                trial.place,
                stiffness,
                trial.forces,
                Motion(trial.pull, trial.push),
                inverse,
                min(_INEXACT, max(math.sqrt(distance), 0.3 * self._tolerance / distance)),
                self._load.overlap is None,
                truly,
                limit,
            )
            self._inverses.count(conjugate)
            self.conjugate += conjugate
            if limit is None or conjugate < limit:
                break
            # factors of stiffnesses that were others do not serve
            inverse = self._inverses.choose(weights, hard=True)
        self.newton += 1
        return step

    def _probe(self, trial: _Trial) -> tuple[_Trial, TrueEquilibrium | None]:
        """Return the state at rest if its energy is least; if not, a trial from where to go on,
        downhill from a saddle.
        """
        geometry = self._geometry
        stencils = self._geometry.stencils
        state = TrueEquilibrium(
            deviations=self._start.deviations,
            overlap=trial.overlap,
            balls=stencils.centre(trial.balls),
            residual=trial.left,
            lattice=stencils.lattice,
            ratio=geometry.ratio,
        )
        vars(state).update(stencils=stencils, place=geometry.place(state.balls, state.overlap))
        down, conjugate = state.find_negative_curvature(
            lambda: self._inverses.choose(geometry.weigh(state.stiffnesses, state.forces))
        )
        self.conjugate = self.conjugate + conjugate
        self._saddles = self._saddles + 1
        stable = True
        if down is not None:  # with all contacts that touch
            stiffness = hertz.stiffness_of(trial.root)
            acting = ActingForces(lambda loss, slip: (stiffness * loss, slip), trial.forces)
            change, _ = trial.place.respond(Motion(down, 0.0), acting)
            stable = dot(change, down) >= 0.0
        if down is None or (stable and self._tolerance == _LEAST_TOLERANCE):
            return trial, state
        if not stable:
            # go down from the saddle, on the way along which the curvature is below zero
            size = math.sqrt(float(np.max(np.sum(stencils.cartesian(down) ** 2, axis=0))))
            way = math.copysign(_FIRST_MOVE / size, dot(trial.pull, down)) * down
            there = trial
            for doubling in range(_DOUBLINGS):
                ahead = self._try(trial.balls + 2.0**doubling * way, trial.overlap)
                if doubling and dot(ahead.pull, way) < 0.0:
                    break
                there = ahead
            return there, None
        self._tolerance = max(_FINER * trial.left, _LEAST_TOLERANCE)
        return trial, None


class _Trial:
    """Motion tried, and what it leaves: the ``pull`` on balls and the ``push`` of the load."""

    def __init__(self, place: ExactPlace, load: ReducedLoad) -> None:
        stencils = place.geometry.stencils
        self.place = place
        self.balls = place.balls
        self.overlap = place.overlap
        self.forces, self.root = hertz.press(place.overlaps)
        self.force = float(np.mean(self.forces))
        self.pull = place.pull(self.forces)
        self.push = self.root.size * find_lack(load, place, self.forces)
        squares = np.sum(stencils.cartesian(self.pull) ** 2, axis=0).ravel()
        #: forces left on the balls, one after the other, over the mean force, and the most;
        #: infinite without any contact
        self.on_balls = np.full(squares.shape, np.inf)
        self.left = math.inf
        self.missed = math.inf
        if self.force > 0.0:
            self.on_balls = np.sqrt(squares) / self.force
            self.left, self.missed = (
                float(np.max(self.on_balls)),
                abs(self.push) / (self.root.size * self.force),
            )

    def slope(self, step: Motion) -> float:
        """Return the slope of the energy along a step."""
        return float(-np.sum(self.pull * step.balls) - self.push * step.compression)
