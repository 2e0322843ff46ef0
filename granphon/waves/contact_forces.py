"""The forces of contacts in motion: normal laws of any overlap, and tangential forces with
Coulomb's limit.

A contact at rest has the overlap h_0 and the force f_0; it is stretched by e, so that its overlap
is h = h_0 - e. It pushes by its law and is open where that is zero. Slip, twist and rolling s are
resisted by forces T whose stiffness is in proportion to that of a flat punch as wide as the
contact, k_t = eta 2 E* a(h), which without adhesion is the normal stiffness k: dT = k_t ds while a
rises, and the elastic part T/k_t is kept while a falls. Slip ends at Coulomb's limit |T| <= mu f,
of the force f of the law, without that of dashpots. It is the law of
:mod:`granphon.array.friction`. Dashpots add tau k(h) times the rate of an elongation (G. Kuwabara
and K. Kono, Jpn. J. Appl. Phys. 26, 1230, 1987), and tau' k_t(h) times those of other deformations.

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
#: what stands for zero where it divides zero
_NONE = hertz.LEAST_NORMAL
#: change of an overlap, over the overlap, up to which forces are averaged: a difference of energies
#: would lose more digits
_CLOSE = 2e-3
#: distance of Gauss's two points from the middle of an interval, over its length
_GAUSS = 0.5 / math.sqrt(3.0)


def share(values: Array) -> Array:
    """Return values (..., n) of contacts, held once where all are the same: one number is read
    faster.
    """
    if np.all(values == values[..., :1]):
        return np.broadcast_to(values[..., :1], values.shape)
    return values


class Powers:
    """Normal forces c h_+^a of contacts (n,), as functions of their elongation e from rest."""

    def __init__(self, exponent: float, coefficient: Array, overlap: Array) -> None:
        self.exponent = exponent
        self.coefficient = share(coefficient)
        self.overlap = share(overlap)
        self.root = share(np.maximum(np.sqrt(overlap), _NONE))
        self.rest = share(coefficient * overlap**exponent)
        self._fall = share(-coefficient)
        self._rise = share(hertz.stiffness_of(coefficient))

    #: contacts whose force jumps, and whether the law knows the radius of its contacts
    jumps = np.zeros(0, np.intp)
    know_radii = False

    def press(self, e: Array, out: Any = None, joined: Any = None) -> tuple[Array, Array]:
        """Return f - f_0, without a difference of near-equal forces, and the stiffness of contacts;
        in ``out``.

        ``joined`` (n,) says which of the contacts whose force jumps are joined; by default all are.
        """
        change, k = (np.empty_like(e), np.empty_like(e)) if out is None else out
        a = self.exponent
        c = self.coefficient
        overlap = self.overlap
        if a == hertz.EXPONENT:
            hertz.release(overlap, self.root, e, (change, k))
            change *= self._fall
            k *= self._rise
            return change, k
        h = np.maximum(overlap - e, 0.0)
        is_loaded = overlap > 0.0
        strain = np.divide(-e, overlap, out=np.zeros_like(e), where=is_loaded)
        with np.errstate(divide="ignore"):
            change_from_rest = self.rest * np.expm1(a * np.log1p(np.maximum(strain, -1.0)))
            change[:] = np.where(is_loaded, change_from_rest, c * h**a)
            k[:] = np.where(h > 0.0, a * c * h ** (a - 1.0), 0.0)
        return change, k

    def begin(self, e: Array) -> Any:
        """Return which contacts are joined, as for :meth:`press`."""
        return None

    def mean(self, e: Array, end: Array, joined: Any = None) -> Array:
        """Return the mean of f - f_0 between the elongations ``e`` and ``end``."""
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
        far = self.coefficient * powers / (a + 1.0) + self.rest * e
        return _store_near(self, e, far)

    def is_closed(self, e: Array, joined: Any = None) -> NDArray[np.bool_]:
        """Whether contacts are closed."""
        return np.asarray(e < self.overlap)


class PairLaws:
    """Normal forces by the laws of pairs (:class:`~granphon.balls.contact_laws.PairLaw`), each of
    some of the contacts.

    The last ``apart`` contacts are those of balls that may meet, which no load holds.

    Attributes
    ----------
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
        self._first = np.nextafter(springs.least, np.inf)
        start = np.maximum(overlap, self._first)
        if apart:
            self.rest[-apart:] = 0.0
            start[-apart:] = self._first[-apart:]
        self._energy = springs.energy(start)
        # a contact that never opens has no end; a law that begins with zero jumps by rounding alone
        opens = springs.least > -np.inf
        ends = (self._first, np.nextafter(springs.touch, np.inf))
        forces = [np.abs(springs.force(np.where(opens, end, 0.0))) for end in ends]
        self.jumps: Index = np.flatnonzero(opens & (np.maximum(*forces) >= _NONE))
        self._last = springs.force(np.where(opens, self._first, 0.0))[self.jumps]

    def begin(self, e: Array) -> Any:
        """Return which contacts are joined, as for :meth:`press`: contacts of the network, and
        those balls that may meet and touch.
        """
        h = self.overlap - e
        least = np.copy(self.springs.least)
        if self.apart:
            least[-self.apart :] = self.springs.touch[-self.apart :]
        return h >= least if len(self.jumps) else None

    def pass_ends(self, e: Array, joined: Array) -> Array:
        """Return how far :attr:`jumps` have passed the overlap at which they join or part, m; below
        zero before it.
        """
        jumps = self.jumps
        springs = self.springs
        h = self.overlap[jumps] - e[jumps]
        return np.where(joined[jumps], springs.least[jumps] - h, h - springs.touch[jumps])

    def _reach(self, e: Array) -> Array:
        """Return the overlaps at which laws are evaluated: contacts that jump stay within their
        law.
        """
        h = self.overlap - e
        jumps = self.jumps
        h[jumps] = np.maximum(h[jumps], self._first[jumps])
        return h

    def _parted(self, joined: Any) -> Index:
        """Return numbers of the jumps that are not joined."""
        return self.jumps[:0] if joined is None else self.jumps[~joined[self.jumps]]

    def press(self, e: Array, out: Any = None, joined: Any = None) -> tuple[Array, Array]:
        """As for :class:`Powers`."""
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
        h = np.maximum(self.overlap - e, self._first)
        parted = self._parted(joined)
        jumps = self.jumps
        h[parted] = self._first[parted]
        far = self.springs.energy(h) - self._energy + self.rest * e
        # the work of the force that joined contacts keep until a step ends
        beyond = np.minimum(self.overlap[jumps] - e[jumps] - self._first[jumps], 0.0) * self._last
        far[jumps] += beyond if joined is None else np.where(joined[jumps], beyond, 0.0)
        return _store_near(self, e, far, joined)

    def is_closed(self, e: Array, joined: Any = None) -> NDArray[np.bool_]:
        """Whether contacts are closed."""
        closed = np.asarray(self.overlap - e > self.springs.least)
        if joined is not None:
            closed[self.jumps] = joined[self.jumps]
        return closed


def _mean_near(law: Powers | PairLaws, e: Array, end: Array, joined: Any) -> Array:
    """Return the mean of f - f_0 between elongations that are close, by Gauss's two points."""
    middle = 0.5 * (e + end)
    half_distance = _GAUSS * (end - e)
    low = law.press(middle - half_distance, None, joined)[0]
    high = law.press(middle + half_distance, None, joined)[0]
    return np.asarray(0.5 * (low + high))


def _store_near(law: Powers | PairLaws, e: Array, far: Array, joined: Any = None) -> Array:
    """Return the energies ``far``; near rest, where these are differences of near-equal numbers,
    the work of the mean force.
    """
    is_small = (np.abs(e) <= _CLOSE * np.abs(law.overlap)) & (law.overlap != 0.0)
    is_near = is_small & law.is_closed(e, joined)
    return np.where(is_near, -e * _mean_near(law, np.zeros_like(e), e, joined), far)


def _mean_of(law: Powers | PairLaws, e: Array, end: Array, joined: Any = None) -> Array:
    """Return the mean force: the change of the energy over the change of e, where the two
    elongations are not close or a contact opens.
    """
    distance = end - e
    is_far = np.abs(distance) > _CLOSE * np.abs(law.overlap - e)
    opens = law.is_closed(e, joined) != law.is_closed(end, joined)
    change = law.store(e, joined) - law.store(end, joined)
    return np.divide(change, distance, out=_mean_near(law, e, end, joined), where=is_far | opens)


class Touch(NamedTuple):
    """Contacts at a moment.

    ``e`` (n,) are elongations. ``pull`` (rows, n) has f - f_0, then the forces T of slips, then
    those of the other deformations. ``k`` (n,) are normal stiffnesses, ``punch`` (n,) those of flat
    punches as wide. ``joined`` (n,) says which contacts are, or is None where no force jumps.
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
    mu : of Coulomb's limit.
    times : (2,) tau of dashpots, or (2, n), s.
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
        self._half = 0.5 * ratio
        self._rest = np.array(normal.rest)

    def begin(self, e: Array, moved: Array, held: Array) -> Touch:
        """Return contacts that have come to e and deformations ``moved`` (rows - 1, n) without
        sliding, but for the limit.

        ``held`` are the tangential forces at rest.
        """
        touch = self.take(e, self.normal.begin(e))
        self.follow(touch, touch, moved, held)  # contacts are as stiff before as after
        return touch

    def take(self, e: Array, joined: Any, spare: Touch | None = None) -> Touch:
        """Return contacts at e that are ``joined``, to be set; ``spare`` is written over."""
        if spare is not None:
            return Touch(e, spare.pull, spare.k, spare.punch, joined)
        k = np.empty_like(e)
        punch = np.empty_like(e) if self.normal.know_radii else k
        return Touch(e, np.empty((1 + len(self.ratio), len(e))), k, punch, joined)

    def press(self, touch: Touch) -> None:
        """Set normal forces and stiffnesses."""
        self.normal.press(touch.e, (touch.pull[0], touch.k), touch.joined)
        if isinstance(self.normal, PairLaws) and self.normal.know_radii:
            self.normal.punch(touch.e, touch.punch, touch.joined)

    def follow(self, before: Touch, after: Touch, moved: Array, held: Array) -> float:
        """Set forces and stiffnesses of contacts ``after`` deformations (rows - 1, n) on the way to
        their elongations, and return the work of slip, twist and roll.

        ``held`` are the tangential forces before, as they have turned.
        """
        self.press(after)
        slides = self.slips if self.mu < math.inf else 0
        return _resist(
            after.pull,
            after.punch,
            before.punch,
            moved,
            held,
            self._half,
            self._rest,
            slides,
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
        """Return what dashpots add to a ``pull`` (rows, n) at the ``rates`` (rows, n) of
        deformations.
        """
        out = np.empty_like(rates)
        out[0] = -self.times[0] * touch.k * rates[0]
        out[1:] = self.times[1] * self.ratio * touch.punch * rates[1:]
        return out

    def springs(self, touch: Touch) -> float:
        """Return the energy of slip, twist and rolling, J."""
        t = touch.pull[1:]
        stiffness = 2.0 * self.ratio * touch.punch
        energies = np.divide(t * t, stiffness, out=np.zeros_like(t), where=stiffness > 0.0)
        return float(np.sum(energies))


@compiled
def _resist(
    pull: Array,
    k: Array,
    before: Array,
    moved: Array,
    held: Array,
    half: Array,
    rest: Array,
    slides: int,
    mu: float,
) -> float:
    """Set the tangential forces in a ``pull`` (1 + rows, n) as :meth:`ContactForces.follow`, and
    return the work of slip, twist and roll, J.

    ``k`` and ``before`` (n,) are the stiffnesses of punches now and before, ``moved`` and ``held``
    (rows, n) the deformations and the forces before, ``half`` (rows, n) half of the ratios of
    stiffnesses, ``rest`` (n,) the normal forces at rest. Coulomb's limit is that of the first
    ``slides`` rows. Contacts are taken in chunks, on whose rows the processor works several numbers
    at a time: a loop over the contacts of a chunk does one step for all of these.
    """
    work = 0.0
    buffers = np.empty((5, _CHUNK))
    for first in range(0, len(k), _CHUNK):
        chunk = slice(first, min(first + _CHUNK, len(k)))
        k_after = k[chunk]
        k_before = before[chunk]
        change = pull[0, chunk]
        force_at_rest = rest[chunk]
        stiffness_sum = buffers[0]
        kept_share = buffers[1]
        square = buffers[2]
        scale = buffers[3]
        dissipated = buffers[4]
        for c in range(len(k_after)):
            least = min(k_after[c], k_before[c])
            stiffness_sum[c] = least + k_after[c]
            # the share of a force that the law keeps: nothing where contacts were open
            kept_share[c] = least / max(k_before[c], _NONE)
            square[c] = 0.0
        for row in range(len(held)):
            t = pull[1 + row, chunk]
            slip = moved[row, chunk]
            force_before = held[row, chunk]
            half_ratio = half[row, chunk]
            for c in range(len(k_after)):
                elastic = half_ratio[c] * stiffness_sum[c] * slip[c]
                t[c] = elastic + kept_share[c] * force_before[c]
            if row < slides:
                for c in range(len(k_after)):
                    square[c] += t[c] * t[c]
        if slides:
            for c in range(len(k_after)):
                limit = mu * max(change[c] + force_at_rest[c], 0.0)
                size = math.sqrt(square[c])
                scale[c] = limit / size if size > limit else 1.0
        dissipated[:] = 0.0
        for row in range(len(held)):
            t = pull[1 + row, chunk]
            slip = moved[row, chunk]
            force_before = held[row, chunk]
            if row < slides:
                for c in range(len(k_after)):
                    t[c] *= scale[c]
            for c in range(len(k_after)):
                dissipated[c] += (t[c] + force_before[c]) * slip[c]
        work += 0.5 * np.sum(dissipated)
    return work
