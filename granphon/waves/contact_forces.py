"""The forces of contacts in motion: normal laws of any overlap, and tangential forces with
Coulomb's limit.

A contact at rest has the overlap h_0 and the force f_0; it is stretched by e, so that its overlap
is h = h_0 - e. It pushes by its law and is open where that is zero. Slip, twist and rolling s are
resisted by forces T whose stiffness is in proportion to that of a flat punch as wide as the
contact, k_t = eta 2 E* a(h), which without adhesion is the normal stiffness k: dT = k_t ds while a
rises, and the elastic part T/k_t is kept while a falls. Slip ends at Coulomb's limit |T| <= mu f,
of the force f of the law, without that of dashpots. It is the law of
:mod:`granphon.contacts.friction`. Dashpots add tau k(h) times the rate of an elongation (G.
Kuwabara and K. Kono, Jpn. J. Appl. Phys. 26, 1230, 1987), and tau' k_t(h) times those of other
deformations.

Some laws jump: of balls that adhere, the force is not zero where they touch or part. Such a contact
is joined or not. It joins where the balls come to touch, and parts where the law ends, which may be
farther apart: what that takes of the energy is lost. Forces are those of contacts as they are
joined, until a step ends at which they join or part.
"""

from __future__ import annotations

import math
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from granphon.balls import hertz
from granphon.base.arrays import Array, Index
from granphon.base.compiled import compiled
from granphon.contacts.laws import ContactLaws

#: contacts that a loop works on at a time, which stay in the processor's first cache
_CHUNK = 256
#: divisor in place of zero, of quotients whose numerator is zero too
_NONE = hertz.LEAST_NORMAL
#: change of an overlap, over the overlap, up to which forces are averaged: a difference of energies
#: would lose more digits
_CLOSE = 2e-3
#: distance of Gauss's two points from the middle of an interval, over its length
_GAUSS = 0.5 / math.sqrt(3.0)


def share(values: Array) -> Array:
    """Return the array ``values`` (..., n) of contacts; where all n contacts have the same value,
    as a view of that one number, which the processor reads faster.
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
    root : (n,) root of the overlap, above zero, m^1/2.
    rest : (n,) force at rest, N.
    jumps : numbers of the contacts whose force jumps: none.
    know_radii : whether the law knows the radius of its contacts: it does not.
    """

    def __init__(self, exponent: float, coefficient: Array, overlap: Array) -> None:
        self.exponent = exponent
        self.coefficient = share(coefficient)
        self.overlap = share(overlap)
        self.root = share(np.maximum(np.sqrt(overlap), _NONE))
        self.rest = share(coefficient * overlap**exponent)
        # coefficients of the change of a force, which falls with e, and of the stiffness
        self._change_factor = share(-coefficient)
        self._stiffness_factor = share(hertz.stiffness_of(coefficient))

    jumps = np.zeros(0, np.intp)
    know_radii = False

    def press(self, e: Array, out: Any = None, joined: Any = None) -> tuple[Array, Array]:
        """Return f - f_0 (n,), N, without a difference of near-equal forces, and the stiffnesses
        k (n,), N/m, at elongations e (n,), m; both are written into ``out`` if that is given.

        ``joined`` (n,) says which of the contacts whose force jumps are joined; by default all are.
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
        """Return which contacts are joined, as for :meth:`press`."""
        return None

    def mean(self, e: Array, end: Array, joined: Any = None) -> Array:
        """Return the mean of f - f_0 (n,), N, between the elongations ``e`` and ``end`` (n,), m."""
        if self.exponent == hertz.EXPONENT:
            mean = hertz.mean_force(self.overlap - e, self.overlap - end)
            return self.coefficient * mean - self.rest
        return _mean_of(self, e, end)

    def store(self, e: Array, joined: Any = None) -> Array:
        """Return the energy of each contact and of its share of the load, J, since rest: zero at e
        = 0, and never below.
        """
        if self.exponent == hertz.EXPONENT:
            return np.asarray(self.coefficient * hertz.stretch(self.overlap, self.root, e))
        a = self.exponent
        h = np.maximum(self.overlap - e, 0.0)
        powers = h ** (a + 1.0) - self.overlap ** (a + 1.0)
        energy = self.coefficient * powers / (a + 1.0) + self.rest * e
        return _refine_near_rest(self, e, energy)

    def is_closed(self, e: Array, joined: Any = None) -> NDArray[np.bool_]:
        """Return whether contacts are closed, (n,)."""
        return np.asarray(e < self.overlap)


class PairLaws:
    """Normal forces by the laws of pairs (:class:`~granphon.balls.contact_laws.PairLaw`), each of
    some of the contacts.

    Attributes
    ----------
    springs : the laws.
    overlap : (n,) at rest, m.
    rest : (n,) force at rest, N.
    apart : number of the last contacts that are those of balls that may meet, which no load holds.
    jumps : numbers of the contacts whose force jumps where they join or part.
    know_radii : whether some law knows the radius of its contacts.
    """

    def __init__(self, springs: ContactLaws, overlap: Array, apart: int = 0) -> None:
        self.springs = springs
        self.overlap = overlap
        self.rest = springs.force(overlap)
        self.apart = apart
        self.know_radii = springs.know_radii
        # the first overlap at which the law holds
        self._first_overlap = np.nextafter(springs.least, np.inf)
        rest_overlap = np.maximum(overlap, self._first_overlap)
        if apart:
            self.rest[-apart:] = 0.0
            rest_overlap[-apart:] = self._first_overlap[-apart:]
        self._rest_energy = springs.energy(rest_overlap)
        # a contact that never opens neither joins nor parts: its law is asked at overlap zero
        opens = springs.least > -np.inf
        parting = np.where(opens, self._first_overlap, 0.0)
        joining = np.where(opens, np.nextafter(springs.touch, np.inf), 0.0)
        parting_force = springs.force(parting)
        joining_force = springs.force(joining)
        # a law that begins with zero is not zero at its first overlap, by rounding alone
        end_force = np.maximum(np.abs(parting_force), np.abs(joining_force))
        self.jumps: Index = np.flatnonzero(opens & (end_force >= _NONE))
        self._parting_force = parting_force[self.jumps]

    def begin(self, e: Array) -> Any:
        """Return which contacts are joined (n,), as for :meth:`press`; None where no force jumps.

        A contact of the network is joined from the least overlap of its law on, balls that may meet
        from where they touch.
        """
        if not len(self.jumps):
            return None
        h = self.overlap - e
        least_joined = np.copy(self.springs.least)
        if self.apart:
            least_joined[-self.apart :] = self.springs.touch[-self.apart :]
        return h >= least_joined

    def pass_ends(self, e: Array, joined: Array) -> Array:
        """Return how far (n_jumps,), m, the contacts :attr:`jumps` have passed the overlap at which
        they part, if they are ``joined`` (n,), or else join; below zero before that overlap.
        """
        jumps = self.jumps
        h = self.overlap[jumps] - e[jumps]
        beyond_parting = self.springs.least[jumps] - h
        beyond_joining = h - self.springs.touch[jumps]
        return np.where(joined[jumps], beyond_parting, beyond_joining)

    def _reach(self, e: Array) -> Array:
        """Return the overlaps (n,), m, at which laws are evaluated: contacts that jump stay within
        their law.
        """
        h = self.overlap - e
        jumps = self.jumps
        h[jumps] = np.maximum(h[jumps], self._first_overlap[jumps])
        return h

    def _parted(self, joined: Any) -> Index:
        """Return numbers of the jumps that are not joined."""
        return self.jumps[:0] if joined is None else self.jumps[~joined[self.jumps]]

    def press(self, e: Array, out: Any = None, joined: Any = None) -> tuple[Array, Array]:
        """Return f - f_0 (n,), N, and the stiffnesses k (n,), N/m, at elongations e (n,), m; see
        :meth:`Powers.press`.
        """
        change, k = (np.empty_like(e), np.empty_like(e)) if out is None else out
        h = self._reach(e)
        parted = self._parted(joined)
        change[:] = self.springs.force(h)
        k[:] = np.maximum(self.springs.stiffness(h), 0.0)
        change[parted] = 0.0
        k[parted] = 0.0
        change -= self.rest
        return change, k

    def punch(self, e: Array, out: Array, joined: Any = None) -> Array:
        """Return stiffnesses 2 E* a of flat punches as wide as the contacts, N/m, in ``out``."""
        out[:] = self.springs.punch(self._reach(e))
        out[self._parted(joined)] = 0.0
        return out

    def mean(self, e: Array, end: Array, joined: Any = None) -> Array:
        """As for :class:`Powers`."""
        return _mean_of(self, e, end, joined)

    def store(self, e: Array, joined: Any = None) -> Array:
        """As for :class:`Powers`; below zero where contacts adhere. Contacts that have parted keep
        the energy at which they part.
        """
        first = self._first_overlap
        h = np.maximum(self.overlap - e, first)
        parted = self._parted(joined)
        h[parted] = first[parted]
        energy = self.springs.energy(h) - self._rest_energy + self.rest * e
        # joined contacts that are stretched beyond their law keep its last force until a step ends
        jumps = self.jumps
        distance_beyond = np.minimum(self.overlap[jumps] - e[jumps] - first[jumps], 0.0)
        work_beyond = distance_beyond * self._parting_force
        if joined is not None:
            work_beyond = np.where(joined[jumps], work_beyond, 0.0)
        energy[jumps] += work_beyond
        return _refine_near_rest(self, e, energy, joined)

    def is_closed(self, e: Array, joined: Any = None) -> NDArray[np.bool_]:
        """Return whether contacts are closed, (n,); those whose force jumps are, if ``joined``."""
        closed = np.asarray(self.overlap - e > self.springs.least)
        if joined is not None:
            closed[self.jumps] = joined[self.jumps]
        return closed


def _mean_near(law: Powers | PairLaws, e: Array, end: Array, joined: Any) -> Array:
    """Return the mean of f - f_0 (n,), N, between the elongations ``e`` and ``end`` (n,), m, that
    are close, by Gauss's two points.
    """
    middle = 0.5 * (e + end)
    point_distance = _GAUSS * (end - e)  # of Gauss's points from the middle
    first_force, _ = law.press(middle - point_distance, joined=joined)
    second_force, _ = law.press(middle + point_distance, joined=joined)
    return np.asarray(0.5 * (first_force + second_force))


def _refine_near_rest(law: Powers | PairLaws, e: Array, energy: Array, joined: Any = None) -> Array:
    """Return the ``energy`` (n,), J, of contacts at elongations e; near rest, where ``energy`` is a
    difference of near-equal numbers, the work of the mean force instead.
    """
    is_small = (np.abs(e) <= _CLOSE * np.abs(law.overlap)) & (law.overlap != 0.0)
    is_near = is_small & law.is_closed(e, joined)
    work = -e * _mean_near(law, np.zeros_like(e), e, joined)
    return np.where(is_near, work, energy)


def _mean_of(law: Powers | PairLaws, e: Array, end: Array, joined: Any = None) -> Array:
    """Return the mean of f - f_0 (n,), N, between the elongations ``e`` and ``end`` (n,), m.

    Where the two are not close, or a contact opens, the mean is the change of the energy over the
    change of e; otherwise the mean of Gauss's two points.
    """
    distance = end - e
    is_far = np.abs(distance) > _CLOSE * np.abs(law.overlap - e)
    opens = law.is_closed(e, joined) != law.is_closed(end, joined)
    energy_lost = law.store(e, joined) - law.store(end, joined)
    mean = _mean_near(law, e, end, joined)
    return np.divide(energy_lost, distance, out=mean, where=is_far | opens)


class Touch(NamedTuple):
    """Contacts at a moment.

    ``e`` (n,) are elongations, m. ``pull`` (rows, n) has f - f_0, then the forces T of slips, then
    those of the other deformations, N. ``k`` (n,) are normal stiffnesses, ``punch`` (n,) those of
    flat punches as wide as the contacts, N/m. ``joined`` (n,) says which contacts are joined; it is
    None where no force jumps.
    """

    e: Array
    pull: Array
    k: Array
    punch: Array
    joined: Any


class ContactForces:
    """The law of all contacts of a motion.

    Attributes
    ----------
    normal : the law of the normal forces.
    ratio : (rows - 1, n) stiffnesses against slip, twist and rolling over those of flat punches;
        slips come first.
    slips : number of slips.
    mu : friction coefficient of Coulomb's limit.
    times : (2,) or (2, n) times of dashpots, s: tau of normal motion, and tau' of all other.
    is_damped : whether there are dashpots.
    """

    def __init__(
        self, normal: Powers | PairLaws, ratio: Array, slips: int, mu: float, times: Array
    ) -> None:
        self.normal = normal
        self.ratio = ratio
        self.slips = slips
        self.mu = mu
        self.times = times
        self.is_damped = bool(np.any(times))
        self._half_ratio = 0.5 * ratio
        self._rest_force = np.array(normal.rest)

    def begin(self, e: Array, moved: Array, held: Array) -> Touch:
        """Return contacts that have come from rest to the elongations e (n,) and the deformations
        ``moved`` (rows - 1, n), m, in one step, at the end of which they slide to Coulomb's limit.

        ``held`` (rows - 1, n) are the tangential forces at rest, N.
        """
        touch = self.take(e, self.normal.begin(e))
        self.follow(touch, touch, moved, held)  # contacts are as stiff before as after
        return touch

    def take(self, e: Array, joined: Any, spare: Touch | None = None) -> Touch:
        """Return contacts at elongations e (n,) that are ``joined`` (n,), whose forces and
        stiffnesses are still to be set; they use the arrays of ``spare`` if that is given.
        """
        if spare is not None:
            return Touch(e, spare.pull, spare.k, spare.punch, joined)
        pull = np.empty((1 + len(self.ratio), len(e)))
        k = np.empty_like(e)
        # laws that do not know radii have k for punches
        punch = np.empty_like(e) if self.normal.know_radii else k
        return Touch(e, pull, k, punch, joined)

    def press(self, touch: Touch) -> None:
        """Set normal forces and stiffnesses."""
        self.normal.press(touch.e, (touch.pull[0], touch.k), touch.joined)
        if isinstance(self.normal, PairLaws) and self.normal.know_radii:
            self.normal.punch(touch.e, touch.punch, touch.joined)

    def follow(self, before: Touch, after: Touch, moved: Array, held: Array) -> float:
        """Set forces and stiffnesses of the contacts ``after`` a step from those ``before``, and
        return the work of slip, twist and roll in the step, J.

        ``moved`` (rows - 1, n) are the deformations of the step, m. ``held`` (rows - 1, n) are the
        tangential forces before it, N, turned with the contacts.
        """
        self.press(after)
        n_limited = self.slips if self.mu < math.inf else 0
        return _resist(
            after.pull,
            after.punch,
            before.punch,
            moved,
            held,
            self._half_ratio,
            self._rest_force,
            n_limited,
            self.mu,
        )

    def pass_ends(self, e: Array, joined: Any) -> Array:
        """Return how far contacts whose force jumps have passed where they join or part, m; below
        zero before it.
        """
        if isinstance(self.normal, PairLaws):
            return self.normal.pass_ends(e, joined)
        return np.zeros(0)

    def switch(self, touch: Touch) -> tuple[Touch, Index, float]:
        """Join or part the contacts that have passed their ends.

        Returns the contacts after that, the numbers of those that have joined or parted, and the
        energy lost, J. Contacts that part have no force of slip, twist and roll any more.
        """
        normal = self.normal
        have_passed = self.pass_ends(touch.e, touch.joined) > 0.0
        switched = normal.jumps[have_passed]
        joined = touch.joined.copy()
        joined[switched] = ~joined[switched]
        renewed = self.take(touch.e, joined)
        renewed.pull[1:] = touch.pull[1:]
        renewed.pull[1:, switched] = 0.0
        self.press(renewed)
        energy_before = normal.store(touch.e, touch.joined)[switched]
        energy_after = normal.store(touch.e, joined)[switched]
        return renewed, switched, float(np.sum(energy_before - energy_after))

    def damp(self, touch: Touch, rates: Array) -> Array:
        """Return the forces (rows, n), N, that dashpots add to a ``pull`` at the ``rates``
        (rows, n) of deformations, m/s.
        """
        forces = np.empty_like(rates)
        forces[0] = -self.times[0] * touch.k * rates[0]  # a rising elongation lessens the push
        forces[1:] = self.times[1] * self.ratio * touch.punch * rates[1:]
        return forces

    def springs(self, touch: Touch) -> float:
        """Return the energy T^2/2k_t of slip, twist and rolling, J, of all contacts."""
        t = touch.pull[1:]
        double_stiffness = 2.0 * self.ratio * touch.punch
        is_closed = double_stiffness > 0.0
        energies = np.divide(t * t, double_stiffness, out=np.zeros_like(t), where=is_closed)
        return float(np.sum(energies))


@compiled
def _resist(
    pull: Array,
    punch_after: Array,
    punch_before: Array,
    moved: Array,
    held: Array,
    half_ratios: Array,
    rest_forces: Array,
    n_limited: int,
    mu: float,
) -> float:
    """Set the tangential forces in a ``pull`` (1 + rows, n) as :meth:`ContactForces.follow`, and
    return the work of slip, twist and roll, J.

    ``punch_after`` and ``punch_before`` (n,) are the stiffnesses of punches after and before the
    step, N/m, ``moved`` (rows, n) the deformations in the step, m, ``held`` (rows, n) the forces
    before it, N, ``half_ratios`` (rows, n) half of the ratios of stiffnesses, ``rest_forces`` (n,)
    the normal forces at rest, N. Coulomb's limit holds for the size of the force in the first
    ``n_limited`` rows. Contacts are taken in chunks, on whose rows the processor works several
    numbers at a time: a loop over the contacts of a chunk does one step for all of these.
    """
    work = 0.0
    buffers = np.empty((5, _CHUNK))
    for first in range(0, len(punch_after), _CHUNK):
        chunk = slice(first, min(first + _CHUNK, len(punch_after)))
        k_after = punch_after[chunk]
        k_before = punch_before[chunk]
        change = pull[0, chunk]
        force_at_rest = rest_forces[chunk]
        stiffness_sum = buffers[0]
        kept_share = buffers[1]
        square = buffers[2]
        scale = buffers[3]
        double_work = buffers[4]
        for c in range(len(k_after)):
            least = min(k_after[c], k_before[c])
            stiffness_sum[c] = least + k_after[c]
            # the share of a force that the law keeps: nothing where contacts were open
            kept_share[c] = least / max(k_before[c], _NONE)
            square[c] = 0.0
        # forces without a limit: springs with the mean of two stiffnesses add to what is kept
        for row in range(len(held)):
            t = pull[1 + row, chunk]
            slip = moved[row, chunk]
            force_before = held[row, chunk]
            half_ratio = half_ratios[row, chunk]
            for c in range(len(k_after)):
                elastic = half_ratio[c] * stiffness_sum[c] * slip[c]
                t[c] = elastic + kept_share[c] * force_before[c]
            if row < n_limited:
                for c in range(len(k_after)):
                    square[c] += t[c] * t[c]
        # the factor that brings a force down to Coulomb's limit
        if n_limited:
            for c in range(len(k_after)):
                limit = mu * max(change[c] + force_at_rest[c], 0.0)
                size = math.sqrt(square[c])
                scale[c] = limit / size if size > limit else 1.0
        # the work of the mean of the forces before and after
        double_work[:] = 0.0
        for row in range(len(held)):
            t = pull[1 + row, chunk]
            slip = moved[row, chunk]
            force_before = held[row, chunk]
            if row < n_limited:
                for c in range(len(k_after)):
                    t[c] *= scale[c]
            for c in range(len(k_after)):
                double_work[c] += (t[c] + force_before[c]) * slip[c]
        work += 0.5 * np.sum(double_work)
    return work
