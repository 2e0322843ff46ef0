"""The law of contacts with friction that are pressed together and slip by small increments: Hertz, Mindlin and Coulomb.

Units are those of :mod:`granphon.array.equilibrium`, W and c W^(3/2). A contact of overlap h carries the normal force
f = h_+^(3/2), with the stiffness k = (3/2) h_+^(1/2), and the tangential force T, a vector with one component for each slip.

T follows the slip s by Mindlin's incremental law at the current overlap, dT = eta k(h) ds. Where the normal force falls, T
is rescaled in proportion to k, dT = T dk/k + eta k ds, the rule of Thornton, Cummins and Cleary (Powder Technology 233, 30
(2013)) and of ``mindlin_rescale`` in LAMMPS: without it a cycle could give energy away. Coulomb's limit |T| <= mu f is met
by return mapping: what is too much is lost by sliding along T. A contact that opens forgets T.

In a step h and s change together along a straight line. While h rises, the law has the mean of k over the part of the
line where the contact is closed, which is df/dh between its ends; while h falls it integrates exactly with k at the end.
Steps of sliding and of sticking contacts are then of second order, and a contact that opens or closes within the step needs
no case of its own.

Energy: a contact stores (2/5) h_+^(5/2) + T^2/(2 eta k). It loses mu f |ds| by sliding, and T^2 |dk|/(2 eta k^2) by the
law: where k rises under a given T, and where T is rescaled, slip is not given back. Neither loss is ever below zero.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from functools import cache, cached_property

import numpy as np
from numpy.typing import NDArray

from granphon.array.losses import lose_falling, lose_rising

Array = NDArray[np.float64]
#: root of an overlap that stands for none where it divides
_TINY = 1e-150
#: fraction of the mean normal force below which a contact does not count as one that carries load: the place of a ball that
#: is held so weakly is not unique
LEAST_CONTACT = 1e-6
#: |T| over mu f, below one by no more than rounding, from which a contact slides
SLIDES = 1.0 - 1e-9


@dataclass(frozen=True, eq=False)
class Contacts:
    """State of the contacts, as far as their future depends on it.

    Attributes
    ----------
    overlaps : (n_c, L1, ..., Lp) h, below zero where balls are apart.
    slips : (n_s, n_c, L1, ..., Lp) slips of the motion from the sites of the lattice; n_s is 1 in a plane, 2 in space.
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
        """(n_s, n_c, L1, ..., Lp) tangential forces over the roots of the overlaps, zero where balls are apart.

        They are the elastic slips times (3/2) eta.
        """
        return np.divide(self.shears, self.roots, out=np.zeros_like(self.shears), where=self.roots > 0.0)

    @property
    def tangential(self) -> Array:
        """(n_c, L1, ..., Lp) magnitudes |T| of the tangential forces."""
        return _norm(self.shears)

    @property
    def carried(self) -> NDArray[np.bool_]:
        """(n_c, L1, ..., Lp) whether each contact counts as one that carries load."""
        forces = self.forces
        return np.asarray(forces > LEAST_CONTACT * np.mean(forces))


@dataclass(frozen=True, eq=False)
class Tangent:
    """Derivatives of a contact's forces in a step with respect to the overlap h and the slip s at its end.

    df = ``stiffness`` dh and dT = ``shear`` (ds - q q.ds) + ``coupling`` dh; q, ``sliding``, is the unit vector of T where
    the contact slides, and zero elsewhere. Along every slip there is the stiffness ``drag`` besides.
    """

    stiffness: Array
    shear: Array
    coupling: Array
    sliding: Array
    drag: float = 0.0

    def stiffen(self, normal: float, shear: float, share: float) -> Tangent:
        """Return a tangent of contacts that are stiffer by ``normal`` and ``shear``, and against sliding by a ``share``.

        If that is one, a contact that slides has the secant stiffness, that of a spring which would carry T.
        """
        sliding = math.sqrt(1.0 - share) * self.sliding
        return Tangent(self.stiffness + normal, self.shear + shear, self.coupling, sliding, self.drag)

    def damp(self, normal: float, drag: float) -> Tangent:
        """Return a tangent with other springs beside the contacts, which neither slide nor open."""
        return Tangent(self.stiffness + normal, self.shear, self.coupling, self.sliding, self.drag + drag)

    @cached_property
    def springs(self) -> Array:
        """(n_s, n_c, L1, ..., Lp) shear stiffnesses along each slip."""
        return np.asarray(self.shear * (1.0 - self.sliding**2) + self.drag)

    @property
    def cross(self) -> Array:
        """(1, n_c, L1, ..., Lp) stiffness between the two slips in space, with the sign turned; (0, ...) in a plane."""
        if len(self.sliding) == 1:
            return np.empty((0, *self.stiffness.shape))
        return np.asarray((self.shear * self.sliding[0] * self.sliding[1])[None])

    def scale(self, factor: float) -> Tangent:
        """Return a tangent that is stiffer by a factor."""
        stiffness, shear, coupling = factor * self.stiffness, factor * self.shear, factor * self.coupling
        return Tangent(stiffness, shear, coupling, self.sliding, factor * self.drag)

    def apply(self, loss: Array, slip: Array) -> tuple[Array, Array]:
        """Return (-df, dT) for a ``loss`` of overlap -dh and a ``slip`` ds."""
        change = self.springs * slip - self.coupling * loss
        if len(slip) == 2:
            change -= self.cross * slip[::-1]
        return self.stiffness * loss, change


@dataclass(frozen=True)
class FrictionLaw:
    """Law of the contacts with shear stiffness ``mindlin_ratio`` eta times the normal one, and friction coefficient mu.

    ``friction_coefficient`` may be zero, and infinite: then no contact slides.
    """

    mindlin_ratio: float
    friction_coefficient: float = math.inf

    def advance(
        self, before: Contacts, overlaps: Array, slips: Array, guess: Array | None = None
    ) -> tuple[Contacts, Callable[[], Tangent]]:
        """Return the contacts at the end of a step to ``overlaps`` and ``slips``, and what finds the tangent there.

        With a ``guess`` of the overlaps the stiffness against slip and Coulomb's limit are those that the guess gives. The
        forces are then derivatives of a convex energy, and the tangent is symmetric.
        """
        mu, contacts = self.friction_coefficient, Contacts(overlaps, slips, np.empty(slips.shape))
        held, new = (overlaps, contacts.roots) if guess is None else (guess, np.sqrt(np.maximum(guess, 0.0)))
        springs = self._bend(before, held, new, slips, contacts.shears)
        slide = np.empty(0, np.intp)
        if mu < math.inf:
            size, limit = _norm(contacts.shears), mu * (contacts.forces if guess is None else new * new * new)
            slide = np.flatnonzero(size > limit)
            shears = contacts.shears.reshape(len(slips), -1)
            sliding, share = shears[:, slide] / size.take(slide), limit.take(slide) / size.take(slide)
            shears[:, slide] *= share

        def linearise() -> Tangent:
            stiffness, shear = 1.5 * contacts.roots, springs
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
        """Return the tangential forces if nothing slid in a step, the stiffness against slip, and Coulomb's limit."""
        new, shears = np.sqrt(np.maximum(overlaps, 0.0)), np.empty(slips.shape)
        springs = self._bend(before, overlaps, new, slips, shears)
        return shears, springs, self.friction_coefficient * new * new * new

    def _bend(self, before: Contacts, overlaps: Array, new: Array, slips: Array, shears: Array) -> Array:
        """Write the tangential forces if nothing slid in a step, and return the stiffness that slip meets.

        That is eta times the mean of k while h rises, and k at the end where it falls. ``new`` are roots of the overlaps.
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
        force = self.mindlin_ratio * new.take(opens) ** 3
        np.put(springs, opens, force / (overlaps.take(opens) - before.overlaps.take(opens)))
        np.subtract(slips, before.slips, out=shears)
        shears *= springs
        shears += less * before.bent
        return springs

    def _couple(self, before: Contacts, after: Contacts) -> Array:
        """Return the derivatives of the tangential forces with respect to h if nothing slid in a step."""
        old, new, eta = before.roots, after.roots, self.mindlin_ratio
        less = np.minimum(old, new)
        over = (new > 0.0) / np.maximum(less + new, _TINY)
        slope: Array = less * over
        slope += 1.0
        slope *= over
        slope *= 0.5 * eta
        opens = np.flatnonzero((old == 0.0) & (new > 0.0))
        width, root = after.overlaps.take(opens) - before.overlaps.take(opens), new.take(opens)
        np.put(slope, opens, eta * (1.5 * root - root**3 / width) / width)
        coupling = np.empty(after.slips.shape)  # in the order of its indices, whatever that of the slips
        np.subtract(after.slips, before.slips, out=coupling)
        coupling *= slope
        # where h falls, the stiffness does as k does at the end, twice as fast, and what T was before in proportion
        coupling += (new < old) * (coupling + over * before.bent)
        return coupling

    def mobilise(self, contacts: Contacts) -> Array:
        """Return (n_c, L1, ..., Lp) |T| over Coulomb's limit mu f: one where a contact slides, zero where balls are apart.

        It is zero if mu is infinite, and one at all contacts that carry load if it is zero.
        """
        forces, mu = contacts.forces, self.friction_coefficient
        if mu == math.inf:
            return np.zeros_like(forces)
        if mu == 0.0:
            return (forces > 0.0).astype(float)
        limit = mu * forces
        return np.minimum(np.divide(contacts.tangential, limit, out=np.zeros_like(limit), where=limit > 0.0), 1.0)

    def ratios(self, contacts: Contacts) -> Array:
        """Return (n_c, L1, ..., Lp) |T| over the normal force f, at most mu; zero where balls are apart."""
        forces = contacts.forces
        found = np.divide(contacts.tangential, forces, out=np.zeros_like(forces), where=forces > 0.0)
        return np.minimum(found, self.friction_coefficient)

    def sliding_fraction(self, contacts: Contacts) -> float:
        """Return the part of the contacts that carry load whose tangential force is at Coulomb's limit."""
        return float(np.mean(self.mobilise(contacts)[contacts.carried] >= SLIDES))

    def stored(self, contacts: Contacts) -> float:
        """Return the mean energy that a contact stores, in units of c W^(5/2)."""
        shear = 0.5 * self.mindlin_ratio * 1.5 * np.sqrt(contacts.closed) * self._bent(contacts) ** 2
        return float(np.mean(0.4 * contacts.forces * contacts.closed + shear))

    def lost(self, before: Contacts, after: Contacts) -> tuple[float, float]:
        """Return the mean energies that a contact loses in a step, by sliding and by the law, along its straight line."""
        slid = loosened = 0.0
        change, rises = after.overlaps - before.overlaps, after.roots > before.roots
        for lose, chosen in ((lose_rising, rises), (lose_falling, ~rises & (before.roots > 0.0))):
            at = np.flatnonzero(chosen)
            old, new = before.roots.take(at), after.roots.take(at)
            bent, then, now = (one.reshape(len(one), -1)[:, at] for one in (before.bent, before.slips, after.slips))
            # a contact that closes or opens in the step: only the part of the step in which it is closed counts
            turns = (old == 0.0) | (new == 0.0)
            part = np.divide(new**2 - old**2, change.take(at), out=np.ones_like(old), where=turns)
            one, other = lose(old, new, bent, part * (now - then), self.mindlin_ratio, self.friction_coefficient)
            slid, loosened = slid + float(np.sum(one)), loosened + float(np.sum(other))
        return slid / change.size, loosened / change.size

    def _bent(self, contacts: Contacts) -> Array:
        """Return the elastic slips |T|/(eta k), zero where balls are apart."""
        stiffness = 1.5 * self.mindlin_ratio * np.sqrt(contacts.closed)
        return np.divide(contacts.tangential, stiffness, out=np.zeros_like(stiffness), where=stiffness > 0.0)


def _norm(vectors: Array) -> Array:
    if len(vectors) == 1:
        return np.asarray(np.abs(vectors[0]))
    return np.asarray(np.sqrt(np.sum(vectors**2, axis=0)))
