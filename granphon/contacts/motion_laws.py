"""The laws of contacts that move, as functions of the elongations of contacts since rest.

A contact at rest has the overlap h_0 and the force f_0. An elongation e leaves it the overlap h =
h_0 - e. Arrays over the contacts of a law are (n,).

Some laws jump: if balls adhere, their force is not zero where they touch or part. Such a contact is
joined or not. It joins where the balls come to touch, and parts where the law ends, which may be
farther apart: the energy that lies between is lost. Within a step a contact stays joined or not as
it was before; it joins or parts at the end of a step.
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from numpy.typing import NDArray

from granphon.balls import hertz
from granphon.base.arrays import Array, Index
from granphon.contacts.laws import ContactLaws

#: the least normal number: divisor in place of zero, where the numerator is zero too, and least
#: force, N, that counts as a jump
_LEAST_NORMAL = hertz.LEAST_NORMAL
#: ratio of a change of an overlap to the overlap up to which a mean force is that of Gauss's two
#: points: a difference of energies would lose more digits
_GAUSS_RANGE = 2e-3
#: distance of Gauss's two points from the middle of an interval, over its length
_GAUSS_POINT = 0.5 / math.sqrt(3.0)


def share(values: Array) -> Array:
    """Return the array ``values`` (..., n) of contacts. If all n contacts have the same values, the
    result is a read-only view of those of the first contact, which the processor reads faster.
    """
    first = values[..., :1]
    if np.all(values == first):
        return np.broadcast_to(first, values.shape)
    return values


class Powers:
    """Normal forces c h_+^a of contacts (n,), as functions of their elongation e from rest.

    Attributes
    ----------
    exponent, coefficient : a, and c (n,), N/m^a.
    overlap : (n,) at rest, m.
    root : (n,) square root of the overlap at rest, m^1/2; the least normal number in place of zero.
    rest : (n,) force at rest, N.
    end : (n,) elongation at which a contact opens, m.
    jumps : numbers of the contacts whose force jumps: none.
    has_radii : whether the law knows the radius of its contacts: it does not.
    """

    def __init__(self, exponent: float, coefficient: Array, overlap: Array) -> None:
        """Find the forces at rest, and the factors that all calls share."""
        self.exponent = exponent
        self.coefficient = share(coefficient)
        self.overlap = share(overlap)
        self.end = self.overlap
        self.root = share(np.maximum(np.sqrt(overlap), _LEAST_NORMAL))
        self.rest = share(coefficient * overlap**exponent)
        # coefficients of the change of a force, which falls with e, and of the stiffness
        self._change_factor = share(-coefficient)
        self._stiffness_factor = share(hertz.stiffness_of(coefficient))

    jumps = np.zeros(0, np.intp)
    has_radii = False

    def press(self, e: Array, out: Any = None, is_joined: Any = None) -> tuple[Array, Array]:
        """Return f - f_0 (n,), N, without a difference of near-equal forces, and the stiffnesses
        k (n,), N/m, at elongations e (n,), m; both are written into the two arrays ``out``, if
        given.

        ``is_joined`` (n,) says which of the contacts whose force jumps are joined; if it is None,
        all are. No force of this law jumps, and ``is_joined`` is not read.
        """
        change, k = (np.empty_like(e), np.empty_like(e)) if out is None else out
        a = self.exponent
        c = self.coefficient
        overlap = self.overlap
        if a == hertz.EXPONENT:
            hertz.release(overlap, self.root, e, (change, k))
            change *= self._change_factor
            k *= self._stiffness_factor
            return change, k
        h = np.maximum(overlap - e, 0.0)
        is_loaded = overlap > 0.0
        strain = np.divide(-e, overlap, out=np.zeros_like(e), where=is_loaded)
        open_strain = -1.0  # the overlap is zero
        with np.errstate(divide="ignore"):  # log of zero overlap, and zero to a power below zero
            log_overlap_ratio = np.log1p(np.maximum(strain, open_strain))
            change_from_rest = self.rest * np.expm1(a * log_overlap_ratio)
            change[:] = np.where(is_loaded, change_from_rest, c * h**a)
            k[:] = np.where(h > 0.0, a * c * h ** (a - 1.0), 0.0)
        return change, k

    def begin(self, e: Array) -> Any:
        """Return None at any elongations e (n,): no force jumps, so that no contact joins or
        parts.
        """
        return None

    def mean(self, e: Array, end: Array, is_joined: Any = None) -> Array:
        """Return the mean of f - f_0 (n,), N, between the elongations ``e`` and ``end`` (n,), m;
        ``is_joined`` is not read.
        """
        if self.exponent == hertz.EXPONENT:
            mean = hertz.mean_force(self.overlap - e, self.overlap - end)
            return self.coefficient * mean - self.rest
        return _mean_of(self, e, end)

    def store(self, e: Array, is_joined: Any = None) -> Array:
        """Return the energy (n,), J, of each contact at elongations e (n,), m, less that at rest,
        and with the energy f_0 e of a load f_0 that holds the contact at rest. It is zero at e = 0,
        and never below zero. ``is_joined`` is not read.
        """
        if self.exponent == hertz.EXPONENT:
            return np.asarray(self.coefficient * hertz.stretch(self.overlap, self.root, e))
        a = self.exponent
        h = np.maximum(self.overlap - e, 0.0)
        powers = h ** (a + 1.0) - self.overlap ** (a + 1.0)
        energy = self.coefficient * powers / (a + 1.0) + self.rest * e
        return _refine_near_rest(self, e, energy)

    def is_closed(self, e: Array, is_joined: Any = None) -> NDArray[np.bool_]:
        """Return whether contacts are closed (n,) at elongations e (n,), m; ``is_joined`` is not
        read.
        """
        return np.asarray(e < self.overlap)


class PairLaws:
    """Normal forces by the laws of pairs (:class:`~granphon.balls.contact_laws.PairLaw`), each of
    some of the contacts.

    Attributes
    ----------
    springs : the laws of the pairs.
    overlap : (n,) at rest, m.
    rest : (n,) force at rest, N.
    end : (n,) elongation at which a contact opens, m; infinite of a bond.
    apart : number of contacts of balls that are apart at rest and may meet, which no load holds;
        they are the last ones.
    jumps : numbers of the contacts whose force jumps where they join or part.
    has_radii : whether some law knows the radius of its contacts.
    """

    def __init__(self, springs: ContactLaws, overlap: Array, apart: int = 0) -> None:
        """Ask the laws for forces and energies at rest, and for the forces that jump."""
        self.springs = springs
        self.overlap = overlap
        self.end = overlap - springs.least
        self.rest = springs.force(overlap)
        self.apart = apart
        self.has_radii = springs.has_radii
        # the first overlap above that at which the law ends
        self._first_overlap = np.nextafter(springs.least, np.inf)
        rest_overlap = np.maximum(overlap, self._first_overlap)
        if apart:
            self.rest[-apart:] = 0.0
            rest_overlap[-apart:] = self._first_overlap[-apart:]
        self._rest_energy = springs.energy(rest_overlap)
        # a contact that never opens neither joins nor parts: its law is asked at overlap zero
        can_open = springs.least > -np.inf
        parting = np.where(can_open, self._first_overlap, 0.0)
        joining = np.where(can_open, np.nextafter(springs.touch, np.inf), 0.0)
        parting_force = springs.force(parting)
        joining_force = springs.force(joining)
        # the force at the first overlap of a law without a jump is not zero, but below this number
        end_force = np.maximum(np.abs(parting_force), np.abs(joining_force))
        self.jumps: Index = np.flatnonzero(can_open & (end_force >= _LEAST_NORMAL))
        self._parting_force = parting_force[self.jumps]

    def begin(self, e: Array) -> Any:
        """Return which contacts (n,) are joined at elongations e (n,), m, for :meth:`press`; None
        if no force jumps.

        A contact that is closed at rest is joined from the least overlap of its law on; a contact
        of balls that are apart at rest is joined from the overlap at which they touch.
        """
        if not len(self.jumps):
            return None
        h = self.overlap - e
        least_joined = np.copy(self.springs.least)
        if self.apart:
            least_joined[-self.apart :] = self.springs.touch[-self.apart :]
        return h >= least_joined

    def pass_ends(self, e: Array, is_joined: Array) -> Array:
        """Return how far (n_jumps,), m, each of the contacts :attr:`jumps` has passed its end at
        elongations e (n,), m; below zero before the end. The end of a contact where ``is_joined``
        (n,) is true is the overlap at which it parts, and that of any other the overlap at which it
        joins.
        """
        jumps = self.jumps
        h = self.overlap[jumps] - e[jumps]
        beyond_parting = self.springs.least[jumps] - h
        beyond_joining = h - self.springs.touch[jumps]
        return np.where(is_joined[jumps], beyond_parting, beyond_joining)

    def _find_law_overlaps(self, e: Array) -> Array:
        """Return the overlaps (n,), m, at which laws are evaluated at elongations e (n,), m: those
        of contacts whose force jumps are at least the first overlap of their law.
        """
        h = self.overlap - e
        jumps = self.jumps
        h[jumps] = np.maximum(h[jumps], self._first_overlap[jumps])
        return h

    def _find_parted(self, is_joined: Any) -> Index:
        """Return the numbers of the contacts :attr:`jumps` where ``is_joined`` (n,) is false; none
        if that is None.
        """
        return self.jumps[:0] if is_joined is None else self.jumps[~is_joined[self.jumps]]

    def press(self, e: Array, out: Any = None, is_joined: Any = None) -> tuple[Array, Array]:
        """Return f - f_0 (n,), N, and the stiffnesses k (n,), N/m, at elongations e (n,), m; see
        :meth:`Powers.press`. A stiffness below zero, as of balls that adhere before they part,
        counts as zero.
        """
        change, k = (np.empty_like(e), np.empty_like(e)) if out is None else out
        h = self._find_law_overlaps(e)
        parted_contacts = self._find_parted(is_joined)
        change[:] = self.springs.force(h)
        k[:] = np.maximum(self.springs.stiffness(h), 0.0)
        change[parted_contacts] = 0.0
        k[parted_contacts] = 0.0
        change -= self.rest
        return change, k

    def punch(self, e: Array, out: Array, is_joined: Any = None) -> Array:
        """Write into ``out`` (n,), and return, the stiffnesses 2 E* a, N/m, of flat punches with
        the radius a of the contacts at elongations e (n,), m; zero of contacts that have parted.
        ``is_joined`` (n,) is that of :meth:`press`. A contact whose law does not know a has its
        normal stiffness.
        """
        out[:] = self.springs.punch(self._find_law_overlaps(e))
        out[self._find_parted(is_joined)] = 0.0
        return out

    def mean(self, e: Array, end: Array, is_joined: Any = None) -> Array:
        """Return the mean of f - f_0 (n,), N, between the elongations ``e`` and ``end`` (n,), m;
        ``is_joined`` (n,) is that of :meth:`press`.
        """
        return _mean_of(self, e, end, is_joined)

    def store(self, e: Array, is_joined: Any = None) -> Array:
        """Return the energies (n,), J, of :meth:`Powers.store` at elongations ``e`` (n,), m; if
        contacts adhere, they may be below zero. A contact whose force jumps has the energy with
        which its law ends where ``is_joined`` (n,) is false.
        """
        first = self._first_overlap
        h = np.maximum(self.overlap - e, first)
        parted_contacts = self._find_parted(is_joined)
        h[parted_contacts] = first[parted_contacts]
        energy = self.springs.energy(h) - self._rest_energy + self.rest * e
        # joined contacts that are stretched beyond their law keep its last force until a step ends
        jumps = self.jumps
        distance_beyond = np.minimum(self.overlap[jumps] - e[jumps] - first[jumps], 0.0)
        work_beyond = distance_beyond * self._parting_force
        if is_joined is not None:
            work_beyond = np.where(is_joined[jumps], work_beyond, 0.0)
        energy[jumps] += work_beyond
        return _refine_near_rest(self, e, energy, is_joined)

    def is_closed(self, e: Array, is_joined: Any = None) -> NDArray[np.bool_]:
        """Return whether contacts are closed (n,) at elongations e (n,), m. If ``is_joined`` (n,)
        is given, contacts whose force jumps are closed where they are joined.
        """
        is_closed = np.asarray(self.overlap - e > self.springs.least)
        if is_joined is not None:
            is_closed[self.jumps] = is_joined[self.jumps]
        return is_closed


def _mean_near(law: Powers | PairLaws, e: Array, end: Array, is_joined: Any) -> Array:
    """Return the mean of f - f_0 (n,), N, between the elongations ``e`` and ``end`` (n,), m, by
    Gauss's two points, which is accurate if they are close; ``is_joined`` is as for
    :meth:`Powers.press`.
    """
    middle = 0.5 * (e + end)
    point_distance = _GAUSS_POINT * (end - e)  # of Gauss's points from the middle
    first_force, _ = law.press(middle - point_distance, is_joined=is_joined)
    second_force, _ = law.press(middle + point_distance, is_joined=is_joined)
    return np.asarray(0.5 * (first_force + second_force))


def _refine_near_rest(
    law: Powers | PairLaws, e: Array, energy: Array, is_joined: Any = None
) -> Array:
    """Return the ``energy`` (n,), J, of contacts at elongations e (n,), m, with contacts near rest
    replaced by the work of their mean force: their ``energy`` is a difference of near-equal
    numbers.

    ``is_joined`` is as for :meth:`Powers.press`.
    """
    is_small = (np.abs(e) <= _GAUSS_RANGE * np.abs(law.overlap)) & (law.overlap != 0.0)
    is_near = is_small & law.is_closed(e, is_joined)
    work = -e * _mean_near(law, np.zeros_like(e), e, is_joined)
    return np.where(is_near, work, energy)


def _mean_of(law: Powers | PairLaws, e: Array, end: Array, is_joined: Any = None) -> Array:
    """Return the mean of f - f_0 (n,), N, between the elongations ``e`` and ``end`` (n,), m.

    If the elongations are not close, or if the contact opens or closes between them, the mean is
    minus the change of the energy over the change of e; otherwise it is that of Gauss's two points.
    ``is_joined`` is as for :meth:`Powers.press`.
    """
    distance = end - e
    is_far = np.abs(distance) > _GAUSS_RANGE * np.abs(law.overlap - e)
    switches = law.is_closed(e, is_joined) != law.is_closed(end, is_joined)
    energy_lost = law.store(e, is_joined) - law.store(end, is_joined)
    mean = _mean_near(law, e, end, is_joined)
    return np.divide(energy_lost, distance, out=mean, where=is_far | switches)
