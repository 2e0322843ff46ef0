"""The search for the pressure under which the contacts of a crystal have a mean force or overlap.

The mean grows with the pressure. The next pressure follows from the power with which overlaps grow
with it, and where balls differ from a secant.
"""

from __future__ import annotations

import math
from typing import NamedTuple, Self

import numpy as np

from granphon.base.arrays import Array, Flags
from granphon.contacts.laws import ContactLaws
from granphon.statics.rest import Rest

#: relative error at which a mean force or overlap is reached, and most states in the search for it
MEAN_TOLERANCE = 4e-15
MOST_MEANS = 60
#: relative error at which the mean of a sample is reached: samples are at rest to 1e-12 of the mean
#: force
SAMPLE_TOLERANCE = 1e-11
#: relative error of a mean that is put down to rounding where no better one is found
_ROUNDED_MEAN = 1e-13


class PressureSearch:
    """The search for the pressure at which the mean force (N) or overlap (m) is the ``goal``, to a
    relative error of ``tolerance``.

    ``low`` and ``high`` are the largest pressure that was found too low, and the smallest that was
    found too high. ``last_pressure`` and ``last_mean`` belong to the last trial of
    :meth:`extrapolate`, and ``last_excess``, the excess of its mean (:meth:`find_excess`), to that
    of :meth:`choose`; it is infinite before the first.
    """

    def __init__(self, goal: float, tolerance: float) -> None:
        self.goal = goal
        self.tolerance = tolerance
        self.low = 0.0
        self.high = math.inf
        self.last_pressure = 0.0
        self.last_mean = math.nan
        self.last_excess = math.inf

    @property
    def last_error(self) -> float:
        """The size of the relative error of the last trial; infinite before the first."""
        return abs(self.last_excess)

    def find_excess(self, mean: float) -> float:
        """Return how far a ``mean`` is above the goal, relative to the goal."""
        return mean / self.goal - 1.0

    def is_reached(self, mean: float, rounding: float) -> bool:
        """Return whether a ``mean`` is the goal: to the tolerance, or to the relative error
        ``rounding`` if the mean is no nearer to the goal than that of the trial before.
        """
        error = abs(self.find_excess(mean))
        is_rounded = error <= rounding and error >= self.last_error
        return error <= self.tolerance or is_rounded

    def is_stuck(self, mean: float, rounding: float) -> bool:
        """Return whether a ``mean`` is above the goal, by as much as the mean of the trial before,
        to the part ``rounding`` of the excess: less pressure changes nothing.
        """
        excess = self.find_excess(mean)
        return excess > 0.0 and abs(excess - self.last_excess) <= rounding * excess

    def extrapolate(self, pressure: float, mean: float, guess: float) -> float:
        """Return the pressure at which the secant through the last two trials, of which the second
        has this ``pressure`` and ``mean``, reaches the goal. Without a secant return the ``guess``.
        This trial becomes the last one.
        """
        if math.isfinite(self.last_mean) and mean != self.last_mean:
            pressure_step = pressure - self.last_pressure
            mean_step = mean - self.last_mean
            guess = pressure + (self.goal - mean) * pressure_step / mean_step
        self.last_pressure = pressure
        self.last_mean = mean
        return guess

    def choose(self, pressure: float, mean: float, guess: float) -> float | None:
        """Narrow the interval by the trial at ``pressure``, which has this ``mean``, and return the
        next pressure: the ``guess`` if it is inside the interval, else the middle of the interval.
        Return None if the interval has no pressure left inside. This trial becomes the last one.

        As long as no mean was too large, the interval is taken to end at twice the ``pressure``.
        """
        excess = self.find_excess(mean)
        self.last_excess = excess
        if excess < 0.0:
            self.low = pressure
        else:
            self.high = pressure
        middle = 0.5 * (self.low + min(self.high, 2.0 * pressure))
        next_pressure = guess if self.low < guess < self.high else middle
        return None if next_pressure in (self.low, self.high) else next_pressure


class MeanContacts(NamedTuple):
    """The contacts of a state at rest, and over which of them means are taken.

    ``overlap`` (n_c,), m, ``force`` (n_c,), N, and ``stiffness`` (n_c,), N/m, are those of all
    contacts; ``is_counted`` (n_c,) says of each contact whether means are over it too.
    """

    overlap: Array
    force: Array
    stiffness: Array
    is_counted: Flags

    @classmethod
    def of(cls, state: Rest, laws: ContactLaws, balls_differ: bool) -> Self:
        """Return the contacts, with their ``laws``, of a state at rest. If balls differ in diameter
        (``balls_differ``), means are over all contacts; if not, over those that carry a load, or
        touch if they adhere.
        """
        overlap = state.overlap[: laws.count]  # springs to the ground come behind the contacts
        force = laws.force(overlap)
        stiffness = laws.stiffness(overlap)
        is_counted = stiffness > 0.0 if laws.adhere else force != 0.0
        if balls_differ:
            is_counted = np.ones(force.size, bool)
        return cls(overlap, force, stiffness, is_counted)

    def find_mean(self, kind: str) -> float:
        """Return the mean of the ``kind`` "force", N, or "overlap", m; at least one contact must be
        counted.
        """
        values = self.force if kind == "force" else self.overlap
        return float(np.mean(values[self.is_counted]))

    @property
    def power(self) -> float:
        """Exponent with which overlaps grow with the pressure: the mean force over the mean of
        stiffness times overlap. It is 1/a for a force that goes as the power a of the overlap.
        """
        work = np.mean((self.stiffness * self.overlap)[self.is_counted])
        return float(np.mean(self.force[self.is_counted]) / work)

    def find_growth(self, kind: str, goal: float, mean: float) -> tuple[float, float]:
        """Return the factor by which the pressure, and the factor by which the overlaps, are to
        grow so that the ``mean`` becomes the ``goal``. Mean and goal are forces (N) or overlaps
        (m), as the ``kind`` says.
        """
        # a mean of the wrong sign says nothing about the size of the step
        growth = goal / mean if mean / goal > 0.0 else 2.0
        if kind == "force":
            return growth, growth**self.power
        return growth ** (1.0 / self.power), growth

    def bound_rounding(
        self, kind: str, goal: float, balls_differ: bool, contacts_adhere: bool
    ) -> float:
        """Return the error of the mean of a ``kind``, "force" or "overlap", relative to the
        ``goal``, that is put down to rounding. ``balls_differ`` says whether balls differ in
        diameter, ``contacts_adhere`` whether contacts adhere.
        """
        rounding = _ROUNDED_MEAN
        if balls_differ:
            # ten times the error at which the mean of a sample is reached; more where loose balls
            # make the mean small against the overlaps of single contacts
            ratio = float(np.mean(np.abs(self.overlap)) / np.abs(np.mean(self.overlap)))
            rounding = 10.0 * SAMPLE_TOLERANCE * max(1.0, ratio)
        if not contacts_adhere:
            return rounding
        # where contacts adhere, the mean may be small against its parts, attraction and repulsion,
        # which are as large as the change of a force with its overlap, or of an overlap with its
        # force
        if kind == "force":
            terms = np.abs(self.stiffness * self.overlap)
        else:
            # open contacts, which have neither force nor stiffness, have no such part
            terms = np.abs(self.force / np.where(self.stiffness != 0.0, self.stiffness, np.inf))
        return rounding * max(1.0, float(np.mean(terms[self.is_counted])) / goal)
