"""The law of contacts with friction that are pressed together and slip by small increments: Hertz,
Mindlin and Coulomb.

Units are W, the width of the diameters, and c W^(3/2) with c of Hertz's law. A contact of overlap h
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
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from granphon.balls import hertz
from granphon.base.arrays import Array

#: |T| over mu f, below one by no more than rounding, from which a contact slides
SLIDES = 1.0 - 1e-9


class RollingContacts(NamedTuple):
    """Contacts of balls that slip and roll, as compiled loops read them.

    Attributes
    ----------
    i, j : (n_c,) numbers of the two balls.
    normal : (n_c, 3) unit vectors from ball i to ball j at touch.
    tangent : (n_c, 3) the first of two tangents at touch; the second is normal x tangent.
    offset : (n_c,) overlaps of the balls on their sites.
    uneven : (n_c,) half of the difference of the radii of ball j and ball i, over the diameter.
    ratio : eps, the unit of displacements and overlaps over the diameter; zero where contacts keep
        their directions.
    """

    i: NDArray[np.int64]
    j: NDArray[np.int64]
    normal: Array
    tangent: Array
    offset: Array
    uneven: Array
    ratio: float


class Configuration(NamedTuple):
    """Where balls are, and where that leaves their contacts, as compiled loops read it.

    Attributes
    ----------
    overlap : y.
    displacement, rotation : (n, 3) of the balls.
    normal, tangent : (n_c, 3) unit vectors of the contacts.
    distance : (n_c,) of the centres, over the diameter.
    """

    overlap: float
    displacement: Array
    rotation: Array
    normal: Array
    tangent: Array
    distance: Array


class SlipTangent(NamedTuple):
    """A :class:`Tangent` as compiled loops read it, (n_c,) and (n_s, n_c)."""

    stiffness: Array
    shear: Array
    coupling: Array
    sliding: Array
    drag: float


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

    def flatten(self) -> tuple[Array, Array, Array]:
        """Return overlaps (n_c,), slips and tangential forces (n_s, n_c) as compiled loops read
        them.
        """
        count = len(self.slips)
        return (
            by_contact(self.overlaps),
            by_contact(self.slips, count),
            by_contact(self.shears, count),
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
        stiffness = self.stiffness + added + drag
        sliding = math.sqrt(1.0 - share) * self.sliding
        factor = 1.0 / unit
        shear = factor * (self.shear + eta * added)
        drag = factor * (self.drag + eta * drag)
        return Tangent(factor * stiffness, shear, factor * self.coupling, sliding, drag)

    @cached_property
    def springs(self) -> Array:
        """(n_s, n_c, L1, ..., Lp) shear stiffnesses along each slip."""
        return np.asarray(self.shear * (1.0 - self.sliding**2) + self.drag)

    def flatten(self) -> SlipTangent:
        """Return the tangent as compiled loops read it."""
        count = len(self.sliding)
        return SlipTangent(
            self.stiffness.reshape(-1),
            self.shear.reshape(-1),
            self.coupling.reshape(count, -1),
            self.sliding.reshape(count, -1),
            float(self.drag),
        )

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
        from granphon.contacts import sliding  # imported here: averages need no Numba

        contacts = Contacts(overlaps, slips, np.empty(slips.shape))
        held = overlaps if guess is None else guess
        start = before.flatten()
        motion = by_contact(slips, len(slips))
        shears = contacts.shears.reshape(len(slips), -1)
        numbers = (float(self.mindlin_ratio), float(self.friction_coefficient))
        sliding.set_shears(*numbers, *start, by_contact(held), motion, shears)

        def linearise() -> Tangent:
            """Return the derivatives of the forces at the end of the step."""
            tangent = Tangent(
                stiffness=np.empty(overlaps.shape),
                shear=np.empty(overlaps.shape),
                coupling=np.empty(slips.shape),
                sliding=np.empty(slips.shape),
            )
            sliding.set_tangent(
                *numbers,
                *start,
                by_contact(overlaps),
                by_contact(held),
                guess is None,
                motion,
                *tangent.flatten()[:4],
            )
            return tangent

        return contacts, cache(linearise)

    def bend(self, before: Contacts, overlaps: Array, slips: Array) -> tuple[Array, Array, Array]:
        """Return the tangential forces if nothing slid in a step, the stiffness against slip, and
        Coulomb's limit.
        """
        from granphon.contacts import sliding  # imported here: averages need no Numba

        sticking = FrictionLaw(self.mindlin_ratio)
        springs = np.empty(overlaps.shape)
        eta = float(self.mindlin_ratio)
        sliding.set_springs(
            eta, by_contact(before.overlaps), by_contact(overlaps), springs.reshape(-1)
        )
        limit = self.friction_coefficient * hertz.force_of(overlaps)
        return sticking.advance(before, overlaps, slips)[0].shears, springs, limit

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
        ratios = np.divide(
            contacts.tangential, forces, out=np.zeros_like(forces), where=forces > 0.0
        )
        return np.minimum(ratios, self.friction_coefficient)

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
        from granphon.contacts import sliding  # imported here: averages need no Numba

        slips = by_contact(after.slips, len(after.slips))
        slid, loosened = sliding.sum_losses(
            float(self.mindlin_ratio),
            float(self.friction_coefficient),
            *before.flatten(),
            by_contact(after.overlaps),
            slips,
        )
        return slid / after.overlaps.size, loosened / after.overlaps.size


def by_contact(values: Array, *rows: int) -> Array:
    """Return numbers (n_c,) of contacts one after the other, or ``rows`` of such numbers, as loops
    read them.
    """
    # of one layout, and writable: loops are compiled anew for each
    return np.require(values, float, ["C", "W"]).reshape(*rows, -1)
