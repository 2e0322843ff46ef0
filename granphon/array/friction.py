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
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

__all__ = ["LEAST_CONTACT", "SLIDES", "Contacts", "FrictionLaw", "Tangent"]

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
    ) -> tuple[Contacts, Tangent]:
        """Return the contacts at the end of a step to ``overlaps`` and ``slips``, with the tangent there.

        With a ``guess`` of the overlaps the stiffness against slip and Coulomb's limit are those that the guess gives. The
        forces are then derivatives of a convex energy, and the tangent is symmetric.
        """
        eta, mu = self.mindlin_ratio, self.friction_coefficient
        old, root = before.roots, np.sqrt(np.maximum(overlaps, 0.0))
        held = overlaps if guess is None else guess
        new = root if guess is None else np.sqrt(np.maximum(guess, 0.0))
        mean, slope = _mean_stiffness(before.overlaps, held, old, new)
        moved, inverse = slips - before.slips, 1.0 / np.maximum(old, _TINY)
        stiffness, shear = 1.5 * root, eta * mean
        shears = np.where(new < old, new * inverse, 1.0) * before.shears + shear * moved
        coupling = np.zeros_like(shears)
        if guess is None:
            falls = (new < old) & (new > 0.0)
            coupling = eta * slope * moved
            coupling += 0.5 * falls * inverse / np.maximum(new, _TINY) * before.shears
        sliding = np.zeros_like(shears)
        if mu < math.inf:
            size, limit = _norm(shears), mu * new**3
            slides = size > limit
            share = np.divide(limit, size, out=np.ones_like(size), where=slides)
            sliding = np.divide(shears, size, out=sliding, where=slides)
            shears, shear = share * shears, share * shear
            if guess is None:
                coupling = share * (coupling - sliding * np.sum(sliding * coupling, axis=0))
                coupling += mu * stiffness * sliding
        return Contacts(overlaps, slips, shears), Tangent(stiffness, shear, coupling, sliding)

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

    def sliding_fraction(self, contacts: Contacts) -> float:
        """Return the part of the contacts that carry load whose tangential force is at Coulomb's limit."""
        return float(np.mean(self.mobilise(contacts)[contacts.carried] >= SLIDES))

    def bend(self, before: Contacts, overlaps: Array, slips: Array) -> tuple[Array, Array, Array]:
        """Return the tangential forces if nothing slid in a step, the stiffness against slip, and Coulomb's limit."""
        old, new = before.roots, np.sqrt(np.maximum(overlaps, 0.0))
        part = np.divide(new, old, out=np.ones_like(new), where=new < old)
        springs = self.mindlin_ratio * _mean_stiffness(before.overlaps, overlaps, old, new)[0]
        return part * before.shears + springs * (slips - before.slips), springs, self.friction_coefficient * new**3

    def stored(self, contacts: Contacts) -> float:
        """Return the mean energy that a contact stores, in units of c W^(5/2)."""
        shear = 0.5 * self.mindlin_ratio * 1.5 * np.sqrt(contacts.closed) * self._bent(contacts) ** 2
        return float(np.mean(0.4 * contacts.forces * contacts.closed + shear))

    def lost(self, before: Contacts, after: Contacts) -> tuple[float, float]:
        """Return the mean energies that a contact loses in a step, by sliding and by the law, to second order."""
        eta, mu = self.mindlin_ratio, self.friction_coefficient
        old, new = np.sqrt(before.closed), np.sqrt(after.closed)
        slid = 0.0
        if mu < math.inf:
            mean = _mean_stiffness(before.overlaps, after.overlaps, old, new)[0]
            part = np.divide(new, old, out=np.ones_like(new), where=new < old)
            excess = _norm(part * before.shears + eta * mean * (after.slips - before.slips) - after.shears)
            slip = np.divide(excess, eta * mean, out=np.zeros_like(new), where=mean > 0.0)
            slid = float(np.mean(0.5 * mu * (before.forces + after.forces) * slip))
        first, last = self._bent(before), self._bent(after)
        if mu == math.inf:  # T falls as k until the contact opens
            last = np.where(new > 0.0, last, first)
        return slid, float(np.mean(0.375 * eta * (first**2 + last**2) * np.abs(new - old)))

    def _bent(self, contacts: Contacts) -> Array:
        """Return the elastic slips |T|/(eta k), zero where balls are apart."""
        stiffness = 1.5 * self.mindlin_ratio * np.sqrt(contacts.closed)
        return np.divide(contacts.tangential, stiffness, out=np.zeros_like(stiffness), where=stiffness > 0.0)


def _mean_stiffness(h0: Array, h1: Array, a0: Array, a1: Array) -> tuple[Array, Array]:
    """Return the normal stiffness that slip meets in a step from h0 to h1, and its derivative with respect to h1.

    ``a0`` and ``a1`` are the roots of h0_+ and h1_+. Where h falls it is k at the end.
    """
    rises, total = a1 > a0, np.maximum(a0 + a1, _TINY)
    part = a0 / total
    mean = np.where(rises, total - part * a1, 1.5 * a1)
    slope = np.where(rises, 0.5 * (1.0 + part) / total, 0.75 / np.maximum(a1, _TINY) * (a1 > 0.0))
    # a contact that closes in the step: only the part of the step after it has closed counts
    opens = np.nonzero((a0 == 0.0) & rises)
    if len(opens[0]):
        width, root = h1[opens] - h0[opens], a1[opens]
        closed = root**3 / width
        mean[opens], slope[opens] = closed, (1.5 * root - closed) / width
    return mean, slope


def _norm(vectors: Array) -> Array:
    if len(vectors) == 1:
        return np.asarray(np.abs(vectors[0]))
    return np.asarray(np.sqrt(np.sum(vectors**2, axis=0)))
