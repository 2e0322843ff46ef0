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

In a step h and s change together along a straight line. While h rises, the stiffness is eta times
the mean of k over the part of the line where the contact is closed, which is the difference of f
over that of h between the ends of the part; while h falls, eta times k at the end integrates the
law exactly. Steps of sliding and of sticking contacts are then of second order, and a contact that
opens or closes within the step needs no case of its own.

A contact stores the energy (2/5) h_+^(5/2) + T^2/(2 eta k). It loses mu f |ds| by sliding, and T^2
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
from granphon.contacts import sliding
from granphon.contacts.sliding import SlipTangent, Step

#: |T| over mu f from which a contact counts as sliding: one, but for rounding
SLIDING_RATIO = 1.0 - 1e-9


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
    overlap : y, by which the load compresses the cell, in units of W.
    displacement, rotation : (n, 3) displacements of the balls, in units of W, and rotations, in
        units of W over the diameter.
    normal, tangent : (n_c, 3) unit vectors of the contacts.
    distance : (n_c,) distances of the centres, over the diameter.
    """

    overlap: float
    displacement: Array
    rotation: Array
    normal: Array
    tangent: Array
    distance: Array


@dataclass(frozen=True, eq=False)
class Contacts:
    """State of n_c contacts of each of L1 x ... x Lp cells, as far as the law needs it.

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
    def closed_overlaps(self) -> Array:
        """(n_c, L1, ..., Lp) overlaps, zero where balls are apart."""
        return np.maximum(self.overlaps, 0.0)

    @cached_property
    def roots(self) -> Array:
        """(n_c, L1, ..., Lp) square roots of the overlaps, zero where balls are apart."""
        return np.sqrt(self.closed_overlaps)

    @cached_property
    def forces(self) -> Array:
        """(n_c, L1, ..., Lp) normal forces."""
        return np.asarray(self.closed_overlaps * self.roots)

    def flatten(self) -> tuple[Array, Array, Array]:
        """Return the overlaps (contacts,), the slips and the tangential forces, (n_s, contacts)
        each, as compiled loops read them: the contacts of all cells are along one axis.
        """
        count = len(self.slips)
        return (
            by_contact(self.overlaps),
            by_contact(self.slips, count),
            by_contact(self.shears, count),
        )

    def damp(
        self, start: Contacts, overlap_change: float, drag: float, eta: float
    ) -> tuple[Array, Array]:
        """Return the normal forces (n_c, L1, ..., Lp) and the tangential forces (n_s, n_c, L1, ...,
        Lp), to each of which that of a dashpot is added. Dashpots resist the motions of neighbours
        against each other since the ``start`` of a step.

        The force of a dashpot is ``drag`` times the change of the overlap, and eta times ``drag``
        times the change of the slip. The change ``overlap_change`` of y, by which the load presses
        all centres together, is not resisted.
        """
        gain = self.overlaps - start.overlaps - overlap_change
        return self.forces + drag * gain, self.shears + eta * drag * (self.slips - start.slips)

    @property
    def shear_sizes(self) -> Array:
        """(n_c, L1, ..., Lp) magnitudes |T| of the tangential forces."""
        if len(self.shears) == 1:
            return np.asarray(np.abs(self.shears[0]))
        return np.asarray(np.sqrt(np.sum(self.shears**2, axis=0)))

    @property
    def is_carrying(self) -> NDArray[np.bool_]:
        """(n_c, L1, ..., Lp) whether each contact counts as one that carries load: its normal force
        is more than :data:`~granphon.balls.hertz.COUNTED_FORCE` times the mean over all contacts.
        """
        forces = self.forces
        return np.asarray(forces > hertz.COUNTED_FORCE * np.mean(forces))


@dataclass(frozen=True, eq=False)
class Tangent:
    """Derivatives of the forces of contacts at the end of a step with respect to the overlap h and
    the slip s there.

    The normal force changes by df = k dh, and the tangential force by dT = k_s (ds - q q.ds) + c dh
    + drag ds. If the contact slides, q is the unit vector of T, or of the force that there would be
    without sliding if mu is zero; otherwise q is zero.

    Attributes
    ----------
    stiffness, shear : (n_c, L1, ..., Lp) k and k_s.
    coupling, sliding : (n_s, n_c, L1, ..., Lp) c and q.
    drag : stiffness along every slip of dashpots over the step.
    """

    stiffness: Array
    shear: Array
    coupling: Array
    sliding: Array
    drag: float = 0.0

    def regularise(
        self, added: float, eta: float, share: float, drag: float, unit: float
    ) -> Tangent:
        """Return a stiffer tangent, with which the equations of a step have a solution. All of its
        derivatives are divided by the stiffness ``unit``.

        The stiffness ``added`` is added to k, and eta times ``added`` to k_s. Along q a contact
        that slides gets the ``share``, from 0 to 1, of its stiffness against slip: with a share of
        one it resists as if it did not slide. Beside the contacts there are dashpots, which neither
        slide nor open: their stiffness over the step is ``drag`` against elongation, and eta times
        ``drag`` against slip.
        """
        stiffness = self.stiffness + added + drag
        # the tangent has the square of q: the factor takes the part 1 - share of k_s away along q
        sliding = math.sqrt(1.0 - share) * self.sliding
        factor = 1.0 / unit
        shear = factor * (self.shear + eta * added)
        slip_drag = factor * (self.drag + eta * drag)
        return Tangent(factor * stiffness, shear, factor * self.coupling, sliding, slip_drag)

    @cached_property
    def springs(self) -> Array:
        """(n_s, n_c, L1, ..., Lp) derivative of each component of T with respect to the slip in the
        same direction.
        """
        return np.asarray(self.shear * (1.0 - self.sliding**2) + self.drag)

    def flatten(self) -> SlipTangent:
        """Return the tangent as compiled loops read it: its arrays are views, if they are in C
        order.
        """
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
        """(1, n_c, L1, ..., Lp) minus the derivative of one component of T with respect to the
        other slip, in space; (0, n_c, L1, ..., Lp) in a plane, where there is one slip.
        """
        if len(self.sliding) == 1:
            return np.empty((0, *self.stiffness.shape))
        return np.asarray((self.shear * self.sliding[0] * self.sliding[1])[None])

    def apply(self, loss: Array, slip: Array) -> tuple[Array, Array]:
        """Return (-df, dT) for a ``loss`` of overlap -dh (n_c, L1, ..., Lp) and a ``slip`` ds (n_s,
        n_c, L1, ..., Lp).
        """
        change = self.springs * slip - self.coupling * loss
        if len(slip) == 2:
            change -= self.cross * slip[::-1]
        return self.stiffness * loss, change


@dataclass(frozen=True)
class FrictionLaw:
    """Law of contacts whose stiffness against slip is eta, ``mindlin_ratio``, times the normal one,
    and whose friction coefficient is mu, ``friction_coefficient``.

    Eta is above zero. If mu is zero, there are no tangential forces; if mu is infinite, as by
    default, no contact slides.
    """

    mindlin_ratio: float
    friction_coefficient: float = math.inf

    def advance(
        self, before: Contacts, overlaps: Array, slips: Array, guess: Array | None = None
    ) -> tuple[Contacts, Callable[[], Tangent]]:
        """Return the contacts at the end of a step from the state ``before`` to ``overlaps`` (n_c,
        L1, ..., Lp) and ``slips`` (n_s, n_c, L1, ..., Lp), arrays which they hold without a copy,
        and a function that returns the tangent there. The function computes the tangent once, at
        its first call.

        With a ``guess`` of the overlaps at the end, (n_c, L1, ..., Lp), the stiffness against slip
        and Coulomb's limit are those at the guess. The forces are then derivatives of a convex
        energy, and the tangent is symmetric.
        """
        contacts = Contacts(overlaps, slips, np.empty(slips.shape))
        tangential_overlaps = by_contact(overlaps if guess is None else guess)
        end_slips = by_contact(slips, len(slips))
        step = Step(*before.flatten(), tangential_overlaps, end_slips)
        shears = contacts.shears.reshape(len(slips), -1)
        numbers = (float(self.mindlin_ratio), float(self.friction_coefficient))
        sliding.set_shears(*numbers, step, shears)

        def linearise() -> Tangent:
            """Return the derivatives of the forces at the end of the step."""
            tangent = Tangent(
                stiffness=np.empty(overlaps.shape),
                shear=np.empty(overlaps.shape),
                coupling=np.empty(slips.shape),
                sliding=np.empty(slips.shape),
            )
            sliding.set_tangent(
                *numbers, step, by_contact(overlaps), guess is None, tangent.flatten()
            )
            return tangent

        return contacts, cache(linearise)

    def stick(self, before: Contacts, overlaps: Array, slips: Array) -> tuple[Array, Array, Array]:
        """Return three arrays of a step from the state ``before`` to ``overlaps`` (n_c, L1, ...,
        Lp) and ``slips`` (n_s, n_c, L1, ..., Lp).

        The first (n_s, n_c, L1, ..., Lp) are the tangential forces at the end if no contact slid in
        the step. The second (n_c, L1, ..., Lp) are the stiffnesses against slip in the step. The
        third (n_c, L1, ..., Lp) are Coulomb's limits mu f at the end; mu has to be finite.
        """
        sticking_law = FrictionLaw(self.mindlin_ratio)
        springs = np.empty(overlaps.shape)
        eta = float(self.mindlin_ratio)
        sliding.set_springs(
            eta, by_contact(before.overlaps), by_contact(overlaps), springs.reshape(-1)
        )
        limit = self.friction_coefficient * hertz.force_of(overlaps)
        contacts, _ = sticking_law.advance(before, overlaps, slips)
        return contacts.shears, springs, limit

    def mobilise(self, contacts: Contacts) -> Array:
        """Return |T| over Coulomb's limit mu f (n_c, L1, ..., Lp): one where a contact slides, zero
        where balls are apart.

        If mu is infinite, the ratio is zero; if mu is zero, it is one at all closed contacts.
        """
        forces = contacts.forces
        mu = self.friction_coefficient
        if mu == math.inf:
            return np.zeros_like(forces)
        if mu == 0.0:
            return (forces > 0.0).astype(float)
        return self.find_ratios(contacts) / mu

    def find_ratios(self, contacts: Contacts) -> Array:
        """Return |T| over the normal force f (n_c, L1, ..., Lp); zero where balls are apart. A
        ratio above mu counts as mu.
        """
        forces = contacts.forces
        ratios = np.divide(
            contacts.shear_sizes, forces, out=np.zeros_like(forces), where=forces > 0.0
        )
        return np.minimum(ratios, self.friction_coefficient)

    def sliding_fraction(self, contacts: Contacts) -> float:
        """Return the fraction of contacts that slide, with tangential forces at Coulomb's limit,
        among those that carry load (:attr:`Contacts.is_carrying`). At least one contact must carry
        load.
        """
        return float(np.mean(self.mobilise(contacts)[contacts.is_carrying] >= SLIDING_RATIO))

    def find_stored_energy(self, contacts: Contacts) -> float:
        """Return the mean energy that a contact stores, in units of c W^(5/2)."""
        stiffness = self.mindlin_ratio * hertz.stiffness_of(contacts.roots)
        elastic_slips = np.divide(
            contacts.shear_sizes,
            stiffness,
            out=np.zeros_like(stiffness),
            where=stiffness > 0.0,
        )
        return float(
            np.mean(
                hertz.energy_of(contacts.forces, contacts.closed_overlaps)
                + 0.5 * stiffness * elastic_slips**2
            )
        )

    def find_losses(self, before: Contacts, after: Contacts) -> tuple[float, float]:
        """Return two energies that a contact loses in a step from the state ``before`` to the state
        ``after``, means over contacts in units of c W^(5/2): by sliding, and by the law of the
        tangential force. In the step overlaps and slips change along a straight line.
        """
        end_slips = by_contact(after.slips, len(after.slips))
        step = Step(*before.flatten(), by_contact(after.overlaps), end_slips)
        by_sliding, by_law = sliding.sum_losses(
            float(self.mindlin_ratio), float(self.friction_coefficient), step
        )
        return by_sliding / after.overlaps.size, by_law / after.overlaps.size


def by_contact(values: Array, *rows: int) -> Array:
    """Return ``values`` of contacts as compiled loops read them: flat, (contacts,), or (rows,
    contacts) if the number of ``rows`` is given. The result is a view of ``values`` if they are
    floats, writable and in C order, and a copy otherwise.
    """
    # all arrays have one layout and are writable: loops are compiled anew for any other
    return np.require(values, float, ["C", "W"]).reshape(*rows, -1)
