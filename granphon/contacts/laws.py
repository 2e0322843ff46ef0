"""The laws of the contacts of a list: forces, stiffnesses and energies of all contacts at once.

Laws are objects with methods of arrays, between two loops over the contacts: a user's own law needs
no compiled code.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from functools import cached_property
from typing import NamedTuple

import numpy as np

from granphon.balls.contact_laws import PairLaw, opening_overlap, punch_stiffness, touching_overlap
from granphon.balls.hertz import ENERGY, FORCE, SLOPE, STIFFNESS, EnergyLaw
from granphon.base.arrays import Array, Index


class _Limits(NamedTuple):
    """The limits of a law, as the attributes of :class:`ContactLaws` have them for each contact."""

    least: float
    touch: float
    most: float
    tension: float

    @classmethod
    def of(cls, law: PairLaw) -> _Limits:
        """Return the limits of a ``law``."""
        least = opening_overlap(law)
        tension = math.inf
        if least != -math.inf:
            # the pull where the law ends: a law may be zero at the end itself, and pull just after
            opening = np.array([least, math.nextafter(least, math.inf)])
            tension = abs(min(float(np.min(law.force(opening))), 0.0))
        most = float(getattr(law, "most_overlap", math.inf))
        return cls(least, touching_overlap(law), most, tension)


class ContactLaws:
    """The laws of contacts: a law for each group of them, as functions of the overlaps (n_c,).

    Contacts of no group never push. Their limits are those of a law that opens at overlap zero,
    bears no tension and is known at every overlap.

    Parameters
    ----------
    groups : each law, with the indices of its contacts; no contact is in two groups.
    count : the number of contacts, n_c.
    modulus : (n_c,) E* of the two bodies, Pa; only :meth:`punch` reads it. Ones by default.
    limits : the limits of the law of each group, if they are known.
    """

    def __init__(
        self,
        groups: Sequence[tuple[PairLaw, Index]],
        count: int,
        modulus: Array | None = None,
        limits: Sequence[_Limits] | None = None,
    ) -> None:
        """Keep the laws, and ask them for their limits unless these are given."""
        self.groups = groups
        self.count = count
        #: the law of all contacts, if they have a single one, and it is one of granphon's
        self._law: EnergyLaw | None = None
        if len(groups) == 1:
            law, contacts = groups[0]
            if isinstance(law, EnergyLaw) and np.array_equal(contacts, np.arange(count)):
                self._law = law
        self.modulus = np.ones(count) if modulus is None else modulus
        #: the limits of the law of each group
        self._limits = [_Limits.of(law) for law, _ in groups] if limits is None else limits

    @cached_property
    def least(self) -> Array:
        """(n_c,) overlap below which contacts are open, m; -inf of a bond."""
        return self._spread(0.0, [limit.least for limit in self._limits])

    @cached_property
    def touch(self) -> Array:
        """(n_c,) overlap at which bodies that come together touch, m; -inf of a bond."""
        return self._spread(0.0, [limit.touch for limit in self._limits])

    @cached_property
    def most(self) -> Array:
        """(n_c,) overlap up to which the law is known, m."""
        return self._spread(math.inf, [limit.most for limit in self._limits])

    @cached_property
    def tension(self) -> Array:
        """(n_c,) pull that a contact bears before it opens, N; inf of a bond."""
        return self._spread(0.0, [limit.tension for limit in self._limits])

    def _spread(self, of_others: float, of_groups: list[float]) -> Array:
        """Return the value (n_c,) of each contact: that of its group, among ``of_groups``, or the
        value ``of_others`` of contacts of no group.
        """
        values = np.full(self.count, of_others)
        for (_, contacts), value in zip(self.groups, of_groups, strict=True):
            values[contacts] = value
        return values

    @property
    def adhesion(self) -> Array:
        """(n_c,) tension that contacts bear before they open, N; zero of a bond, which never
        opens.
        """
        return np.where(np.isinf(self.tension), 0.0, self.tension)

    @property
    def can_adhere(self) -> bool:
        """Whether some contact bears tension before it opens, as balls that adhere and bonds do."""
        return bool(np.any(self.tension > 0.0))

    def size(self, force: Array) -> float:
        """Return the size of forces by which residuals are measured, N. It is the larger of two
        means: that of the magnitudes of the forces ``force`` (n_c,), N, that are not zero, and that
        of the :attr:`adhesion` of all contacts.

        The size is zero if no force acts and no contact adheres.
        """
        count = int(np.count_nonzero(force))
        mean_magnitude = float(np.sum(np.abs(force))) / count if count else 0.0
        return max(mean_magnitude, self._mean_adhesion)

    @cached_property
    def _mean_adhesion(self) -> float:
        """Mean :attr:`adhesion` of all contacts, N; zero without contacts."""
        return float(np.sum(self.adhesion)) / max(self.count, 1)

    def among(self, contacts: Index) -> ContactLaws:
        """Return the laws of the chosen ``contacts``, numbers that differ from each other; contacts
        are numbered anew from zero in the order of ``contacts``. A law without a chosen contact
        keeps a group, which is empty.
        """
        groups: list[tuple[PairLaw, Index]] = []
        if self._law is not None:
            only_law, _ = self.groups[0]
            groups.append((only_law, np.arange(len(contacts))))
        else:
            new_number = np.full(self.count, -1)
            new_number[contacts] = np.arange(len(contacts))
            for law, members in self.groups:
                numbers = new_number[members]
                groups.append((law, numbers[numbers >= 0]))
        return ContactLaws(groups, len(contacts), self.modulus[contacts], self._limits)

    def append(self, groups: Sequence[tuple[PairLaw, Index]], count: int) -> ContactLaws:
        """Return the laws of these contacts and of ``count`` further ones, which are numbered after
        these.

        ``groups`` are the laws of the further contacts, with their indices from zero; their
        ``modulus`` is 1 Pa.
        """
        if not count:
            return self
        later = [(law, self.count + contacts) for law, contacts in groups]
        modulus = np.append(self.modulus, np.ones(count))
        return ContactLaws([*self.groups, *later], self.count + count, modulus)

    def force(self, overlap: Array) -> Array:
        """Return the force of each contact, N, at overlaps (n_c,), m."""
        return self._evaluate(overlap, FORCE)

    def stiffness(self, overlap: Array) -> Array:
        """Return the stiffness of each contact, N/m, at overlaps (n_c,), m."""
        return self._evaluate(overlap, STIFFNESS)

    def press(self, overlap: Array) -> tuple[Array, Array]:
        """Return the force, N, and the stiffness, N/m, of each contact at overlaps (n_c,), m."""
        if self._law is not None:
            return self._law._press(overlap)
        return self.force(overlap), self.stiffness(overlap)

    def stiffness_slope(self, overlap: Array) -> Array:
        """Return the slope of the stiffness of each contact, N/m^2, at overlaps (n_c,), m.
        By Hertz's law it is zero at an overlap of zero, where the slope is infinite.
        """
        return self._evaluate(overlap, SLOPE)

    def energy(self, overlap: Array) -> Array:
        """Return the energy of each contact, J, at overlaps (n_c,), m."""
        return self._evaluate(overlap, ENERGY)

    def _evaluate(self, overlap: Array, order: int) -> Array:
        """Return the derivative of ``order`` 0 to 3 of the energy of each contact (n_c,), by its
        law: energy, force, stiffness or slope of the stiffness, J/m^order.

        Laws of granphon are evaluated without checks of the overlaps: trials of a solver may leave
        the range of floating numbers, and the solver notices that itself.
        """
        if self._law is not None:
            return np.asarray(self._law._evaluate(overlap, order))
        values = np.zeros(self.count)
        for law, contacts in self.groups:
            if isinstance(law, EnergyLaw):
                values[contacts] = law._evaluate(overlap[contacts], order)
            else:
                functions = {
                    ENERGY: law.energy,
                    FORCE: law.force,
                    STIFFNESS: law.stiffness,
                    SLOPE: law.stiffness_slope,
                }
                values[contacts] = functions[order](overlap[contacts])
        return values

    def overlap(self, forces: Array) -> Array:
        """Return the overlaps (n_c,), m, at which contacts have the ``forces`` (n_c,), N, which the
        contacts must be able to bear; zero for contacts without a law.
        """
        overlaps = np.zeros(self.count)
        for law, contacts in self.groups:
            overlaps[contacts] = law.overlap(forces[contacts])
        return overlaps

    @property
    def has_radii(self) -> bool:
        """Whether some law knows the radius of its contacts."""
        return any(callable(getattr(law, "contact_radius", None)) for law, _ in self.groups)

    def punch(self, overlap: Array) -> Array:
        """Return the stiffnesses 2 E* a (n_c,), N/m, of flat punches with the radius a of the
        contacts at overlaps (n_c,), m: the normal stiffness where a law does not know a, and zero
        for contacts without a law.
        """
        stiffness = np.zeros(self.count)
        for law, contacts in self.groups:
            stiffness[contacts] = punch_stiffness(law, overlap[contacts], self.modulus[contacts])
        return stiffness
