"""The law of contacts with friction that are pressed together and slip by small increments: Hertz,
Mindlin and Coulomb.

Units are those of :mod:`granphon.array.equilibrium`, W and c W^(3/2). A contact of overlap h
carries the normal force f = h_+^(3/2), with the stiffness k = (3/2) h_+^(1/2), and the tangential
force T, a vector with one component for each slip.

T follows the slip s by Mindlin's incremental law at the current overlap, dT = eta k(h) ds. Where
the normal force falls, T is rescaled in proportion to k, dT = T dk/k + eta k ds, the rule of
Thornton, Cummins and Cleary (Powder Technology 233, 30 (2013)) and of ``mindlin_rescale`` in
LAMMPS: without it a cycle could give energy away. Coulomb's limit |T| <= mu f is met by return
mapping: what is too much is lost by sliding along T. A contact that opens forgets T.

In a step h and s change together along a straight line. While h rises, the law has the mean of k
over the part of the line where the contact is closed, which is df/dh between its ends; while h
falls it integrates exactly with k at the end. Steps of sliding and of sticking contacts are then of
second order, and a contact that opens or closes within the step needs no case of its own.

Energy: a contact stores (2/5) h_+^(5/2) + T^2/(2 eta k). It loses mu f |ds| by sliding, and T^2
|dk|/(2 eta k^2) by the law: where k rises under a given T, and where T is rescaled, slip is not
given back. Neither loss is ever below zero.

While h rises, T is linear in f until it comes to Coulomb's limit mu f; while h falls, the elastic
slip T/(eta k) is linear in h until it comes to 2 mu h/(3 eta). So in a step both losses are
integrals of powers of r = h^(1/2) over the parts of the line before and after that:

    by sliding  int mu f |ds|        by the law  int T^2 |dk|/(2 eta k^2)

They are exact where slips have one component. Where T turns as it slides, its direction at the end
stands for those before.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from functools import cache, cached_property

import numpy as np
from numpy.typing import NDArray

from granphon.balls import hertz
from granphon.base.arrays import Array

#: root of an overlap that stands for none where it divides
_TINY = 1e-150
#: |T| over mu f, below one by no more than rounding, from which a contact slides
SLIDES = 1.0 - 1e-9


@dataclass(frozen=True, eq=False)
class Contacts:
    """State of the contacts, as far as their future depends on it.

    Attributes
    ----------
    overlaps : (n_c, L1, ..., Lp) h, below zero where balls are apart.
    slips : (n_s, n_c, L1, ..., Lp) slips of the motion from the sites of the lattice; n_s is 1 in a
        plane, 2 in space.
    shears : (n_s, n_c, L1, ..., Lp) tangential forces T.
    """

    overlaps: Array
    slips: Array
    shears: Array

    @cached_property
    def closed(self) -> Array:
        """(n_c, L1, ..., Lp) overlaps, zero where balls are apart."""
        return np.maximum(self.overlaps, 0.0)

    @cached_property
    def roots(self) -> Array:
        """(n_c, L1, ..., Lp) square roots of the overlaps, zero where balls are apart."""
        return np.sqrt(self.closed)

    @cached_property
    def forces(self) -> Array:
        """(n_c, L1, ..., Lp) normal forces."""
        return np.asarray(self.closed * self.roots)

    @cached_property
    def bent(self) -> Array:
        """(n_s, n_c, L1, ..., Lp) tangential forces over the roots of the overlaps, zero where
        balls are apart.

        They are the elastic slips times (3/2) eta.
        """
        return np.divide(
            self.shears, self.roots, out=np.zeros_like(self.shears), where=self.roots > 0.0
        )

    @property
    def tangential(self) -> Array:
        """(n_c, L1, ..., Lp) magnitudes |T| of the tangential forces."""
        if len(self.shears) == 1:
            return np.asarray(np.abs(self.shears[0]))
        return np.asarray(np.sqrt(np.sum(self.shears**2, axis=0)))

    @property
    def carried(self) -> NDArray[np.bool_]:
        """(n_c, L1, ..., Lp) whether each contact counts as one that carries load."""
        forces = self.forces
        return np.asarray(forces > hertz.COUNTED_FORCE * np.mean(forces))


@dataclass(frozen=True, eq=False)
class Tangent:
    """Derivatives of a contact's forces in a step with respect to the overlap h and the slip s at
    its end.

    df = ``stiffness`` dh and dT = ``shear`` (ds - q q.ds) + ``coupling`` dh; q, ``sliding``, is the
    unit vector of T where the contact slides, and zero elsewhere. Along every slip there is the
    stiffness ``drag`` besides.
    """

    stiffness: Array
    shear: Array
    coupling: Array
    sliding: Array
    drag: float = 0.0

    def regularise(
        self, added: float, eta: float, share: float, drag: float, unit: float
    ) -> Tangent:
        """Return the tangent of contacts that are stiffer by ``added``, and eta times as much
        against slip, in units.

        Against sliding they are stiffer by a ``share``: if that is one, a contact that slides has
        the secant stiffness, that of a spring which would carry T. Beside the contacts there are
        dashpots of stiffness ``drag``, and eta times as much, which neither slide nor open.
        """
        stiffness, sliding, factor = (
            self.stiffness + added + drag,
            math.sqrt(1.0 - share) * self.sliding,
            1.0 / unit,
        )
        shear = factor * (self.shear + eta * added)
        drag = factor * (self.drag + eta * drag)
        return Tangent(factor * stiffness, shear, factor * self.coupling, sliding, drag)

    @cached_property
    def springs(self) -> Array:
        """(n_s, n_c, L1, ..., Lp) shear stiffnesses along each slip."""
        return np.asarray(self.shear * (1.0 - self.sliding**2) + self.drag)

    @property
    def cross(self) -> Array:
        """(1, n_c, L1, ..., Lp) stiffness between the two slips in space, with the sign turned; (0,
        ...) in a plane.
        """
        if len(self.sliding) == 1:
            return np.empty((0, *self.stiffness.shape))
        return np.asarray((self.shear * self.sliding[0] * self.sliding[1])[None])

    def apply(self, loss: Array, slip: Array) -> tuple[Array, Array]:
        """Return (-df, dT) for a ``loss`` of overlap -dh and a ``slip`` ds."""
        change = self.springs * slip - self.coupling * loss
        if len(slip) == 2:
            change -= self.cross * slip[::-1]
        return self.stiffness * loss, change


@dataclass(frozen=True)
class FrictionLaw:
    """Law of the contacts with shear stiffness ``mindlin_ratio`` eta times the normal one, and
    friction coefficient mu.

    ``friction_coefficient`` may be zero, and infinite: then no contact slides.
    """

    mindlin_ratio: float
    friction_coefficient: float = math.inf

    def advance(
        self, before: Contacts, overlaps: Array, slips: Array, guess: Array | None = None
    ) -> tuple[Contacts, Callable[[], Tangent]]:
        """Return the contacts at the end of a step to ``overlaps`` and ``slips``, and what finds
        the tangent there.

        With a ``guess`` of the overlaps the stiffness against slip and Coulomb's limit are those
        that the guess gives. The forces are then derivatives of a convex energy, and the tangent is
        symmetric.
        """
        mu, contacts = self.friction_coefficient, Contacts(overlaps, slips, np.empty(slips.shape))
        held, new = (
            (overlaps, contacts.roots)
            if guess is None
            else (guess, np.sqrt(np.maximum(guess, 0.0)))
        )
        springs = self._bend(before, held, new, slips, contacts.shears)
        slide = np.empty(0, np.intp)
        if mu < math.inf:
            limit = mu * (contacts.forces if guess is None else hertz.force_from(new))
            size = contacts.tangential
            flat = contacts.shears.reshape(len(slips), -1)
            slide = np.flatnonzero(size > limit)
            sliding, share = flat[:, slide] / size.take(slide), limit.take(slide) / size.take(slide)
            flat[:, slide] *= share  # they slide along themselves

        def linearise() -> Tangent:
            stiffness = hertz.stiffness_of(contacts.roots)
            shear = springs
            directions = np.zeros_like(contacts.shears)
            coupling = self._couple(before, contacts) if guess is None else np.zeros(slips.shape)
            if len(slide):
                shear = springs.copy()
                shear.reshape(-1)[slide] *= share
                directions.reshape(len(slips), -1)[:, slide] = sliding
            if len(slide) and guess is None:
                flat = coupling.reshape(len(slips), -1)
                part = flat[:, slide] - np.sum(sliding * flat[:, slide], axis=0) * sliding
                flat[:, slide] = share * part + mu * stiffness.take(slide) * sliding
            return Tangent(stiffness, shear, coupling, directions)

        return contacts, cache(linearise)

    def bend(self, before: Contacts, overlaps: Array, slips: Array) -> tuple[Array, Array, Array]:
        """Return the tangential forces if nothing slid in a step, the stiffness against slip, and
        Coulomb's limit.
        """
        new = np.sqrt(np.maximum(overlaps, 0.0))
        shears = np.empty(slips.shape)
        springs = self._bend(before, overlaps, new, slips, shears)
        return shears, springs, self.friction_coefficient * hertz.force_from(new)

    def _bend(
        self, before: Contacts, overlaps: Array, new: Array, slips: Array, shears: Array
    ) -> Array:
        """Write the tangential forces if nothing slid in a step, and return the stiffness that slip
        meets.

        That is eta times the mean of k while h rises, and k at the end where it falls. ``new`` are
        roots of the overlaps.
        """
        old = before.roots
        less = np.minimum(old, new)  # where h falls, as if it had been at its end before
        total = less + new
        springs: Array = less * new
        springs /= np.maximum(total, _TINY)
        np.subtract(total, springs, out=springs)
        springs *= self.mindlin_ratio
        # a contact that closes in the step: only the part of the step after it has closed counts
        opens = np.flatnonzero((old == 0.0) & (new > 0.0))
        force = self.mindlin_ratio * hertz.force_from(new.take(opens))
        np.put(springs, opens, force / (overlaps.take(opens) - before.overlaps.take(opens)))
        np.subtract(slips, before.slips, out=shears)
        shears *= springs
        shears += less * before.bent
        return springs

    def _couple(self, before: Contacts, after: Contacts) -> Array:
        """Return the derivatives of the tangential forces with respect to h if nothing slid in a
        step.
        """
        old = before.roots
        new = after.roots
        eta = self.mindlin_ratio
        less = np.minimum(old, new)
        over = (new > 0.0) / np.maximum(less + new, _TINY)
        slope: Array = less * over
        slope += 1.0
        slope *= over
        slope *= 0.5 * eta
        opens = np.flatnonzero((old == 0.0) & (new > 0.0))
        width = after.overlaps.take(opens) - before.overlaps.take(opens)
        root = new.take(opens)
        np.put(
            slope, opens, eta * (hertz.stiffness_of(root) - hertz.force_from(root) / width) / width
        )
        # in the order of its indices, whatever that of the slips
        coupling = np.empty(after.slips.shape)
        np.subtract(after.slips, before.slips, out=coupling)
        coupling *= slope
        # where h falls, the stiffness does as k does at the end, twice as fast, and what T was
        # before in proportion
        coupling += (new < old) * (coupling + over * before.bent)
        return coupling

    def mobilise(self, contacts: Contacts) -> Array:
        """Return (n_c, L1, ..., Lp) |T| over Coulomb's limit mu f: one where a contact slides, zero
        where balls are apart.

        It is zero if mu is infinite, and one at all contacts that carry load if it is zero.
        """
        forces = contacts.forces
        mu = self.friction_coefficient
        if mu == math.inf:
            return np.zeros_like(forces)
        if mu == 0.0:
            return (forces > 0.0).astype(float)
        return self.ratios(contacts) / mu

    def ratios(self, contacts: Contacts) -> Array:
        """Return (n_c, L1, ..., Lp) |T| over the normal force f, at most mu; zero where balls are
        apart.
        """
        forces = contacts.forces
        found = np.divide(
            contacts.tangential, forces, out=np.zeros_like(forces), where=forces > 0.0
        )
        return np.minimum(found, self.friction_coefficient)

    def sliding_fraction(self, contacts: Contacts) -> float:
        """Return the part of the contacts that carry load whose tangential force is at Coulomb's
        limit.
        """
        return float(np.mean(self.mobilise(contacts)[contacts.carried] >= SLIDES))

    def stored(self, contacts: Contacts) -> float:
        """Return the mean energy that a contact stores, in units of c W^(5/2)."""
        stiffness = self.mindlin_ratio * hertz.stiffness_of(contacts.roots)
        slips = np.divide(
            contacts.tangential, stiffness, out=np.zeros_like(stiffness), where=stiffness > 0.0
        )
        return float(
            np.mean(hertz.energy_of(contacts.forces, contacts.closed) + 0.5 * stiffness * slips**2)
        )

    def lost(self, before: Contacts, after: Contacts) -> tuple[float, float]:
        """Return the mean energies that a contact loses in a step, by sliding and by the law, along
        its straight line.
        """
        slid = loosened = 0.0
        change = after.overlaps - before.overlaps
        rises = after.roots > before.roots
        for lose, chosen in ((_lose_rising, rises), (_lose_falling, ~rises & (before.roots > 0.0))):
            at = np.flatnonzero(chosen)
            old = before.roots.take(at)
            new = after.roots.take(at)
            bent, then, now = (
                one.reshape(len(one), -1)[:, at] for one in (before.bent, before.slips, after.slips)
            )
            # a contact that closes or opens in the step: only the part of the step in which it is
            # closed counts
            turns = (old == 0.0) | (new == 0.0)
            part = np.divide(new**2 - old**2, change.take(at), out=np.ones_like(old), where=turns)
            one, other = lose(
                old, new, bent, part * (now - then), self.mindlin_ratio, self.friction_coefficient
            )
            slid = slid + float(np.sum(one))
            loosened = loosened + float(np.sum(other))
        return slid / change.size, loosened / change.size


@dataclass(frozen=True, eq=False)
class PressedArray:
    """Array of balls at rest, with the forces that its history has left; in units of W and c
    W^(3/2).

    Attributes
    ----------
    overlap : y, common to all contacts.
    balls : (fields, L1, ..., Lp) displacements and rotations, in the coordinates of the stencils.
    contacts : state of the contacts.
    law : of the contacts.
    residual : largest force or torque (over the diameter) left on a ball, over the mean normal
        force.
    work : of the load since the start, a mean over contacts, in units of c W^(5/2).
    slid, loosened, damped : energies lost since the start by sliding, by the law of the tangential
        force, and to dashpots, between the gas and rest and where balls fall; as ``work``.
    steps, newton, krylov : numbers of steps of the load, of Newton's method and of GMRES since the
        start.
    """

    overlap: float
    balls: Array
    contacts: Contacts
    law: FrictionLaw
    residual: float = 0.0
    work: float = 0.0
    slid: float = 0.0
    loosened: float = 0.0
    damped: float = 0.0
    steps: int = 0
    newton: int = 0
    krylov: int = 0

    @cached_property
    def force(self) -> float:
        """Mean normal force f*, over all contacts, open ones included."""
        return float(np.mean(self.contacts.forces))

    @cached_property
    def stored(self) -> float:
        """Mean energy that a contact stores, in units of c W^(5/2)."""
        return self.law.stored(self.contacts)

    @property
    def dissipated(self) -> float:
        """Energy lost since the start, a mean over contacts, in units of c W^(5/2)."""
        return self.slid + self.loosened + self.damped

    def measure_motion(self, before: PressedArray) -> float:
        """Return the largest change of an overlap or a slip since another state, in W."""
        now = self.contacts
        then = before.contacts
        return max(
            float(np.max(np.abs(a - b)))
            for a, b in ((now.overlaps, then.overlaps), (now.slips, then.slips))
        )

    @property
    def sliding_fraction(self) -> float:
        """Part of the contacts that carry load whose tangential force is at Coulomb's limit."""
        return self.law.sliding_fraction(self.contacts)


def _lose_rising(
    old: Array, new: Array, bent: Array, slip: Array, eta: float, mu: float
) -> tuple[Array, Array]:
    """Return (n,) energies lost by sliding and by the law while h rises from ``old``^2 to
    ``new``^2.

    ``bent`` (n_s, n) is T/r at first, and ``slip`` (n_s, n) the slip since then.
    """
    first = old * bent
    part = (old * old + old * new + new * new) / np.maximum(old + new, _TINY)
    more = eta * part * slip
    cube = old**3
    share, over, mu = _meet(first, more, mu, cube, new**3 - cube)
    turn = np.clip(np.cbrt(cube + share * (new**3 - cube)), old, new)  # where it begins to slide
    more *= share
    three = np.maximum(old * old + old * turn + turn * turn, _TINY)
    stuck = old * _dot(bent, bent) + (turn + 2.0 * old) * _dot(first, more) / three
    stuck += (
        (((turn + 3.0 * old) * turn + 6.0 * old * old) * turn + 5.0 * cube)
        * _dot(more, more)
        / (5.0 * three * three)
    )
    stuck *= (turn - old) / (3.0 * eta * np.maximum(turn, _TINY))
    five = _sum_powers(turn, new)
    three = turn * turn + turn * new + new * new
    slid = 0.4 * (mu / eta) * over * five / np.maximum(three, _TINY)
    return slid, stuck + (mu * mu / (15.0 * eta)) * (new - turn) * five


def _lose_falling(
    old: Array, new: Array, bent: Array, slip: Array, eta: float, mu: float
) -> tuple[Array, Array]:
    """Return (n,) energies lost by sliding and by the law while h falls; see
    :func:`_lose_rising`.
    """
    first = bent / (hertz.EXPONENT * eta)
    to_slip = hertz.EXPONENT * eta
    share, over, most = _meet(first, slip, mu / to_slip, old * old, new * new - old * old)
    mu = to_slip * most
    turn = np.clip(np.sqrt(np.maximum(old * old + share * (new * new - old * old), 0.0)), new, old)
    more = share * slip
    both = np.maximum(old + turn, _TINY)
    stuck = _dot(first, first) + 2.0 * (2.0 * old + turn) * _dot(first, more) / (3.0 * both)
    stuck += (
        (8.0 * old * old + 9.0 * old * turn + 3.0 * turn * turn)
        * _dot(more, more)
        / (15.0 * both * both)
    )
    five = _sum_powers(turn, new)
    slid = 0.4 * mu * over * five / np.maximum(turn + new, _TINY)
    return slid, 0.75 * eta * (old - turn) * stuck + (mu * mu / (15.0 * eta)) * (turn - new) * five


def _meet(
    first: Array, more: Array, mu: float, size: Array, rise: Array
) -> tuple[Array, Array, float]:
    """Return the part of the way at which ``|first + more|`` comes to mu (size + rise), and what is
    then above it.

    The third is mu, or zero if that is infinite: then nothing is above it.
    """
    if mu == math.inf:
        return np.ones_like(size), np.zeros_like(size), 0.0
    limit = mu * size
    rise = mu * rise
    over = np.maximum(np.sqrt(_dot(first + more, first + more)) - (limit + rise), 0.0)
    square = _dot(more, more) - rise * rise
    half = _dot(first, more) - limit * rise
    left = np.minimum(_dot(first, first) - limit * limit, 0.0)
    root = np.sqrt(np.maximum(half * half - square * left, 0.0))
    late = half <= 0.0  # T leaves the limit at first
    share = np.where(late, root - half, -left) / np.maximum(
        np.where(late, square, half + root), _TINY
    )
    return np.where(over > 0.0, np.minimum(share, 1.0), 1.0), over, mu


def _sum_powers(a: Array, b: Array) -> Array:
    """Return (a^5 - b^5)/(a - b)."""
    return np.asarray((((a + b) * a + b * b) * a + b * b * b) * a + b * b * b * b)


def _dot(a: Array, b: Array) -> Array:
    return np.asarray(np.einsum("ic,ic->c", a, b))
