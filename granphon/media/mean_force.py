"""The search for the pressure under which the contacts of a crystal have a mean force or overlap.

The mean grows with the pressure. The next pressure follows from the power with which overlaps grow
with it, and from a secant where balls differ in diameter, contacts adhere, or gravity acts.
"""

from __future__ import annotations

import math
from typing import NamedTuple, Self

import numpy as np

from granphon.base.arrays import Array, Flags
from granphon.base.errors import InputError
from granphon.contacts.laws import ContactLaws
from granphon.statics.rest import Rest

#: most states in the search for a mean force or overlap
MOST_MEANS = 60
#: relative error at which the mean is reached where balls do not differ in diameter
_MEAN_TOLERANCE = 4e-15
#: relative error at which the mean of a sample is reached: samples are at rest to 1e-12 of the mean
#: force
_SAMPLE_TOLERANCE = 1e-11
#: relative error of a mean that is put down to rounding where no better one is found
_MEAN_ROUNDING = 1e-13


class MeanGoal(NamedTuple):
    """A mean over contacts that is to be reached: ``kind`` is "force", of a ``value`` in N, or
    "overlap", of a ``value`` in m. The value is above zero.
    """

    kind: str
    value: float

    @property
    def unit(self) -> str:
        """SI unit of the value."""
        return "N" if self.kind == "force" else "m"

    def __str__(self) -> str:
        return f"mean {self.kind} of {self.value:g} {self.unit}"


class PressureSearch:
    """The search for the pressure at which contacts have the mean ``goal``.

    ``balls_differ`` says whether balls differ in diameter, where the goal is reached to a larger
    relative error, the ``tolerance``; ``contacts_adhere`` says whether contacts adhere, so that the
    pressure may be below zero; ``has_gravity`` says whether gravity presses contacts too.
    ``follows_power`` is true if none of the three holds: overlaps then grow as a power of the
    pressure.

    ``low`` and ``high`` are the largest pressure that was found too low, and the smallest that was
    found too high. ``last_pressure`` and ``last_mean`` belong to the last trial of
    :meth:`extrapolate`, and ``last_excess``, the excess of its mean (:meth:`find_excess`), to that
    of :meth:`choose`; it is infinite before the first.
    """

    def __init__(
        self, goal: MeanGoal, *, balls_differ: bool, contacts_adhere: bool, has_gravity: bool
    ) -> None:
        self.goal = goal
        self.follows_power = not (balls_differ or contacts_adhere or has_gravity)
        self.tolerance = _SAMPLE_TOLERANCE if balls_differ else _MEAN_TOLERANCE
        self.low = -math.inf if contacts_adhere else 0.0
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
        return mean / self.goal.value - 1.0

    def is_reached(self, mean: float, rounding: float) -> bool:
        """Return whether a ``mean`` is the goal: to the tolerance, or to the relative error
        ``rounding`` if the mean is no nearer to the goal than that of the trial before.
        """
        error = abs(self.find_excess(mean))
        is_rounded = error <= rounding and error >= self.last_error
        return error <= self.tolerance or is_rounded

    def is_stuck(self, mean: float, rounding: float) -> bool:
        """Return whether a ``mean`` is above the goal, by as much as the mean of the trial before,
        to the part ``rounding`` of the excess: less pressure changes nothing. Always False if the
        pressure may be below zero, where contacts pull.
        """
        excess = self.find_excess(mean)
        is_equal = abs(excess - self.last_excess) <= rounding * excess
        return self.low >= 0.0 and excess > 0.0 and is_equal

    def extrapolate(self, pressure: float, mean: float, guess: float) -> float:
        """Return the pressure at which the secant through the last two trials, of which the second
        has this ``pressure`` and ``mean``, reaches the goal. Without a secant return the ``guess``.
        This trial becomes the last one.
        """
        if math.isfinite(self.last_mean) and mean != self.last_mean:
            pressure_step = pressure - self.last_pressure
            mean_step = mean - self.last_mean
            guess = pressure + (self.goal.value - mean) * pressure_step / mean_step
        self.last_pressure = pressure
        self.last_mean = mean
        return guess

    def choose(self, pressure: float, mean: float, guess: float) -> float | None:
        """Narrow the interval by the trial at ``pressure``, which has this ``mean``, and return the
        next pressure: the ``guess`` if it is inside the interval, else the middle of the interval.
        Return None if the interval has no pressure left inside. This trial becomes the last one.

        As long as no mean was too large, or none too small, the interval is taken to end where the
        ``pressure`` has changed by its own size.
        """
        excess = self.find_excess(mean)
        self.last_excess = excess
        if excess < 0.0:
            self.low = pressure
        else:
            self.high = pressure
        size = abs(pressure)
        middle = 0.5 * (max(self.low, pressure - size) + min(self.high, pressure + size))
        next_pressure = guess if self.low < guess < self.high else middle
        return None if next_pressure in (self.low, self.high) else next_pressure

    def find_next(
        self, contacts: MeanContacts, pressure: float, mean: float
    ) -> tuple[float | None, float]:
        """Return the pressure of the next trial, None if no pressure is left, and the factor by
        which overlaps are expected to grow on the way there. The last trial at ``pressure`` had
        these ``contacts`` with this ``mean``.

        The pressure follows from the power with which overlaps grow with it, or from a secant.
        """
        pressure_growth, overlap_growth = contacts.find_growth(self.goal, mean)
        guess = pressure * pressure_growth
        if not self.follows_power:
            # overlaps that balls of different diameters have on their sites do not depend on the
            # pressure, nor do the pull of contacts that adhere and the weight of balls: the mean
            # follows no power, and the last state is not scaled
            overlap_growth = 1.0
            guess = self.extrapolate(pressure, mean, guess)
        return self.choose(pressure, mean, guess), overlap_growth


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
        is_counted = stiffness > 0.0 if laws.can_adhere else force != 0.0
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
        Where contacts adhere it may be below zero, and of any size where one of the means is nearly
        zero.
        """
        work = np.mean((self.stiffness * self.overlap)[self.is_counted])
        return float(np.mean(self.force[self.is_counted]) / work)

    def require_any(self, goal: MeanGoal, words: str, contacts_adhere: bool) -> None:
        """Raise :class:`~granphon.base.errors.InputError` if no contact is counted, so that there
        is no mean. Messages call the load on the contacts by ``words``. ``contacts_adhere`` says
        whether contacts adhere; others carry nothing only where no pressure presses them.
        """
        if np.any(self.is_counted):
            return
        why = "With gravity a pressure acts on the faces of a cut alone"
        mend = "Cut the crystal, or leave gravity out"
        if contacts_adhere:
            why = "Those that adhere have come apart"
            mend = f"Give a larger {goal.kind}"
        raise InputError(f"all contacts are open under {words}", why, mend)

    def find_growth(self, goal: MeanGoal, mean: float) -> tuple[float, float]:
        """Return the factor by which the pressure, and the factor by which the overlaps, are to
        grow so that the ``mean`` becomes the ``goal``.
        """
        # a mean that is of the wrong sign, or zero, says nothing about the size of the step
        growth = goal.value / mean if mean / goal.value > 0.0 else 2.0
        if goal.kind == "force":
            return growth, growth**self.power
        return growth ** (1.0 / self.power), growth

    def bound_rounding(self, goal: MeanGoal, balls_differ: bool, contacts_adhere: bool) -> float:
        """Return the error of the mean, relative to the ``goal``, that is put down to rounding.
        ``balls_differ`` says whether balls differ in diameter, ``contacts_adhere`` whether contacts
        adhere.
        """
        rounding = _MEAN_ROUNDING
        if balls_differ:
            # ten times the error at which the mean of a sample is reached; more where loose balls
            # make the mean small against the overlaps of single contacts
            ratio = float(np.mean(np.abs(self.overlap)) / np.abs(np.mean(self.overlap)))
            rounding = 10.0 * _SAMPLE_TOLERANCE * max(1.0, ratio)
        if not contacts_adhere:
            return rounding
        # where contacts adhere, the mean may be small against its parts, attraction and repulsion,
        # which are as large as the change of a force with its overlap, or of an overlap with its
        # force
        if goal.kind == "force":
            terms = np.abs(self.stiffness * self.overlap)
        else:
            # open contacts, which have neither force nor stiffness, have no such part
            terms = np.abs(self.force / np.where(self.stiffness != 0.0, self.stiffness, np.inf))
        return rounding * max(1.0, float(np.mean(terms[self.is_counted])) / goal.value)
