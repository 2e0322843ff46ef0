"""The forces of contacts in motion: normal laws of any overlap, and tangential forces with Coulomb's limit.

A contact at rest has the overlap h_0 and the force f_0; it is stretched by e, so that its overlap is h = h_0 - e. It pushes
by its law and is open where that is zero. Slip, twist and rolling s are resisted by forces T whose stiffness is in
proportion to the normal stiffness, k_t = eta k(h): dT = k_t ds while k rises, and the elastic part T/k_t is kept while k
falls. Slip ends at Coulomb's limit |T| <= mu f. It is the law of :mod:`granphon.array.friction`. Dashpots add tau k(h) times
the rate of an elongation (G. Kuwabara and K. Kono, Jpn. J. Appl. Phys. 26, 1230, 1987), and tau' k_t(h) times those of other
deformations.
"""

from __future__ import annotations

import math
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from granphon.balls import hertz
from granphon.base.arrays import Array
from granphon.media.crystal_statics import Springs

#: numbers that are worked on at a time, which stay in the processor's cache
_ROOM = 2**17
#: what stands for zero where it divides zero
_NONE = hertz.LEAST_NORMAL
#: change of an overlap, over the overlap, up to which forces are averaged: a difference of energies would lose more digits
_CLOSE = 2e-3
#: Gauss's two points, over the way between, from its middle
_GAUSS = 0.5 / math.sqrt(3.0)


class Part(NamedTuple):
    """A part of the contacts, and room to work with, (rows, contacts)."""

    at: slice
    room: Array


def divide(n: int, rows: int, divides: bool) -> list[Part]:
    """Return parts of n contacts with so many rows of room, or all as one."""
    size = _ROOM // rows if divides else max(n, 1)
    room = np.empty((rows, min(n, size)))
    return [Part(slice(low, min(low + size, n)), room[:, : n - low]) for low in range(0, n, size)]


def share(values: Array) -> Array:
    """Return values (..., n) of contacts, held once where all are the same: they are read faster."""
    return np.broadcast_to(values[..., :1], values.shape) if np.all(values == values[..., :1]) else values


class Powers:
    """Normal forces c h_+^a of contacts (n,), as functions of their elongation e from rest."""

    #: whether parts of the contacts can be asked for
    divides = True

    def __init__(self, exponent: float, coefficient: Array, overlap: Array) -> None:
        self.exponent, self.coefficient, self.overlap = exponent, share(coefficient), share(overlap)
        self.root, self.rest = share(np.maximum(np.sqrt(overlap), _NONE)), share(coefficient * overlap**exponent)
        self._fall, self._rise = share(-coefficient), share(hertz.stiffness_of(coefficient))

    def press(self, e: Array, at: slice = slice(None), out: Any = None) -> tuple[Array, Array]:
        """Return f - f_0, without a difference of near-equal forces, and the stiffness, of contacts ``at``; in ``out``."""
        change, k = (np.empty_like(e), np.empty_like(e)) if out is None else out
        a, c, rest = self.exponent, self.coefficient[at], self.overlap[at]
        if a == hertz.EXPONENT:
            hertz.release(rest, self.root[at], e, (change, k))
            change *= self._fall[at]
            k *= self._rise[at]
            return change, k
        h = np.maximum(rest - e, 0.0)
        part = np.divide(-e, rest, out=np.zeros_like(e), where=rest > 0.0)
        with np.errstate(divide="ignore"):
            part = self.rest[at] * np.expm1(a * np.log1p(np.maximum(part, -1.0)))
            change[:], k[:] = np.where(rest > 0.0, part, c * h**a), np.where(h > 0.0, a * c * h ** (a - 1.0), 0.0)
        return change, k

    def mean(self, e: Array, other: Array) -> Array:
        """Return the mean of f - f_0 on the straight way from one elongation to another."""
        if self.exponent == hertz.EXPONENT:
            return self.coefficient * hertz.mean_force(self.overlap - e, self.overlap - other) - self.rest
        return _mean_of(self, e, other)

    def store(self, e: Array) -> Array:
        """Return the energy of each contact and of its share of the load, J, since rest: zero at e = 0, and never below."""
        if self.exponent == hertz.EXPONENT:
            return np.asarray(self.coefficient * hertz.stretch(self.overlap, self.root, e))
        a, h = self.exponent, np.maximum(self.overlap - e, 0.0)
        far = self.coefficient * (h ** (a + 1.0) - self.overlap ** (a + 1.0)) / (a + 1.0) + self.rest * e
        return _store_near(self, e, far)

    def is_closed(self, e: Array) -> NDArray[np.bool_]:
        """Whether contacts are closed."""
        return np.asarray(e < self.overlap)


class PairLaws:
    """Normal forces by the laws of pairs (:class:`~granphon.balls.contact_laws.PairLaw`), each of some of the contacts.

    The last ``apart`` contacts are those of balls that may meet, which no load holds.
    """

    divides = False

    def __init__(self, springs: Springs, overlap: Array, apart: int = 0) -> None:
        self.springs, self.overlap, self.rest = springs, overlap, springs.force(overlap)
        start = np.maximum(overlap, springs.least)
        if apart:
            self.rest[-apart:], start[-apart:] = 0.0, np.maximum(springs.least[-apart:], -np.finfo(float).max)
        self._energy = springs.energy(start)

    def press(self, e: Array, at: slice = slice(None), out: Any = None) -> tuple[Array, Array]:
        """As for :class:`Powers`, of all contacts."""
        change, k = (np.empty_like(e), np.empty_like(e)) if out is None else out
        h = self.overlap - e
        change[:], k[:] = self.springs.force(h) - self.rest, np.maximum(self.springs.stiffness(h), 0.0)
        return change, k

    def mean(self, e: Array, other: Array) -> Array:
        """As for :class:`Powers`."""
        return _mean_of(self, e, other)

    def store(self, e: Array) -> Array:
        """As for :class:`Powers`; below zero where contacts adhere. Where they have broken it is that at the break."""
        far = self.springs.energy(np.maximum(self.overlap - e, self.springs.least)) - self._energy + self.rest * e
        return _store_near(self, e, far)

    def is_closed(self, e: Array) -> NDArray[np.bool_]:
        """Whether contacts are closed."""
        return np.asarray(self.overlap - e > self.springs.least)


def _level(law: Powers | PairLaws, e: Array, other: Array) -> Array:
    """Return the mean of f - f_0 between elongations that are close."""
    middle, part = 0.5 * (e + other), _GAUSS * (other - e)
    return np.asarray(0.5 * (law.press(middle - part)[0] + law.press(middle + part)[0]))


def _store_near(law: Powers | PairLaws, e: Array, far: Array) -> Array:
    """Return the energies ``far``, but near rest, where they are differences of near-equal ones, that of the mean force."""
    return np.where(np.abs(e) > _CLOSE * np.abs(law.overlap), far, -e * _level(law, np.zeros_like(e), e))


def _mean_of(law: Powers | PairLaws, e: Array, other: Array) -> Array:
    """Return the mean force: the change of the energy over that of e, where these are not close or a contact opens."""
    way = other - e
    far = (np.abs(way) > _CLOSE * np.abs(law.overlap - e)) | (law.is_closed(e) != law.is_closed(other))
    return np.divide(law.store(e) - law.store(other), way, out=_level(law, e, other), where=far)


class Touch(NamedTuple):
    """Contacts at a moment: elongations e (n,), ``pull`` (rows, n) of f - f_0 and forces T of slips, then of the others, and
    normal stiffnesses k (n,)."""

    e: Array
    pull: Array
    k: Array


class ContactForces:
    """The law of all contacts of a motion.

    Attributes
    ----------
    normal : the law of the normal forces.
    ratio : (rows - 1, n) stiffnesses against slip, twist and rolling over the normal one; slips come first.
    slips : number of slips.
    mu : of Coulomb's limit.
    times : (2,) tau of dashpots, or (2, n), s.
    is_damped : whether there are dashpots.
    """

    def __init__(self, normal: Powers | PairLaws, ratio: Array, slips: int, mu: float, times: Array) -> None:
        self.normal, self.ratio, self.slips, self.mu, self.times = normal, ratio, slips, mu, times
        self.is_damped, self._half = bool(np.any(times)), share(0.5 * ratio)

    def begin(self, e: Array, moved: Array, held: Array) -> Touch:
        """Return contacts that have come to e and deformations ``moved`` (rows - 1, n) without sliding, but for the limit.

        ``held`` are the tangential forces at rest.
        """
        change, k = self.normal.press(e)
        touch = Touch(e, np.concatenate([change[None], held + self.ratio * k * moved]), k)
        self._slide(touch.pull, slice(None), np.empty_like(e))
        return touch

    def follow(self, before: Touch, after: Touch, moved: Array, held: Array, part: Part) -> float:
        """Set forces and stiffnesses of a part of the contacts ``after`` deformations (rows - 1, n) on the way to their
        elongations, and return the work of slip, twist and roll.

        ``held`` are the tangential forces before, as they have turned.
        """
        at, (least, mean, product, *_) = part
        now, then, work = after.k[at], before.k[at], 0.0
        self.normal.press(after.e[at], at, (after.pull[0, at], now))
        if not len(moved):
            return work
        np.add(np.minimum(now, then, out=least), now, out=mean)
        least /= np.maximum(then, _NONE, out=product)  # what the law leaves of a force: nothing where contacts were open
        rows = [(t[at], way[at], old[at]) for t, way, old in zip(after.pull[1:], moved, held, strict=True)]
        for (t, way, old), half in zip(rows, self._half, strict=True):
            np.multiply(half[at], mean, out=t)
            t *= way
            t += np.multiply(old, least, out=product)
        self._slide(after.pull, at, mean)
        for t, way, old in rows:
            work += 0.5 * float(np.dot(t, way) + np.dot(old, way))
        return work

    def _slide(self, pull: Array, at: slice, limit: Array) -> None:
        """Bring forces of slip to Coulomb's limit, which is written to ``limit``."""
        if self.mu < math.inf and self.slips:
            np.maximum(np.add(pull[0, at], self.normal.rest[at], out=limit), 0.0, out=limit)
            limit *= self.mu
            shears = pull[1 : 1 + self.slips, at]
            if self.slips == 1:
                np.minimum(shears[0], limit, out=shears[0])
                np.maximum(shears[0], np.negative(limit, out=limit), out=shears[0])
                return
            size = np.maximum(np.sqrt(np.einsum("ij,ij->j", shears, shears)), limit)
            shears *= np.divide(limit, np.maximum(size, _NONE, out=size), out=size)

    def damp(self, k: Array, rates: Array) -> Array:
        """Return what dashpots add to a ``pull`` (rows, n) at the ``rates`` (rows, n) of deformations."""
        out = rates * k
        out[0] *= -self.times[0]
        out[1:] *= self.times[1] * self.ratio
        return out

    def springs(self, pull: Array, k: Array) -> float:
        """Return the energy of slip, twist and rolling, J."""
        t, stiffness = pull[1:], 2.0 * self.ratio * k
        return float(np.sum(np.divide(t * t, stiffness, out=np.zeros_like(t), where=stiffness > 0.0)))
