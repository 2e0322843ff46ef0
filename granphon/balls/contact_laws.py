"""Laws of the normal force of a contact: Hertz's law, powers, adhesive laws, tables, and laws of
users.

A law is an object whose method ``between(ball, ball)`` returns the law of these two bodies, a
:class:`PairLaw`: force, stiffness, the slope of the stiffness and energy as functions of the
overlap, and the overlap as a function of the force. A user's own object with these five methods is
the law of all pairs. Overlaps are in m and positive where balls are pressed; forces are in N, and
positive where they push.

JKR is the law of K. L. Johnson, K. Kendall and A. D. Roberts (Proc. R. Soc. A 324, 301, 1971), and
DMT that of B. V. Derjaguin, V. M. Muller and Yu. P. Toporov (J. Colloid Interface Sci. 53, 314,
1975); here ``adhesion`` is the work of adhesion w of the two surfaces, J/m^2.
"""

from __future__ import annotations

import inspect
import math
from collections.abc import Mapping
from dataclasses import dataclass, replace
from functools import cached_property, partial
from itertools import pairwise
from typing import Any, Protocol

import numpy as np
from numpy.typing import ArrayLike

from granphon.balls.ball import Body, ContactConstants
from granphon.balls.hertz import (
    ENERGY,
    FORCE,
    LEAST_NORMAL,
    STIFFNESS,
    EnergyLaw,
    HertzLaw,
    require_finite,
    require_pushing,
)
from granphon.base.arrays import ROUNDING, Array, Flags
from granphon.base.errors import InputError, brief
from granphon.base.quantities import ADHESION, LOADS, Quantity, is_si
from granphon.base.registry import Registry
from granphon.base.text import counted
from granphon.base.validation import (
    Rule,
    above_zero,
    label,
    not_negative,
    number,
    one_of,
    positive,
    real_array,
    real_number,
    require,
)

#: overlaps, over the radius R of two bodies, at which a user's law is compared with its derivatives
_PROBES = np.array([1e-6, 1e-5, 1e-4, 1e-3])
#: step of these comparisons, over the overlap
_STEP = 1e-4
#: relative error up to which two numbers of a user's law agree
_TOLERANCE = 1e-5
#: the five methods of the law of a pair
_METHODS = ("force", "stiffness", "stiffness_slope", "energy", "overlap")
#: four of these, each the derivative of the one before
_DERIVATIVES = ("energy", "force", "stiffness", "stiffness_slope")
#: nodes of the quadrature of a tabulated force between two points of the table
_NODES = 24
#: places between two points of a table at which the largest stiffness is sought
_PLACES = 16
#: most steps of Newton's method, where a law is inverted
_STEPS = 60
#: an overlap, m, at which balls are apart
_OPEN_OVERLAP = np.array([-1e-9])
#: root u of u^4 - u = D at which the contact of a JKR law is pulled apart, and D there
_JKR_ROOT = 0.75 ** (1.0 / 3.0)
_JKR_LEAST = -0.25 * _JKR_ROOT


class PairLaw(Protocol):
    """The contact law of two bodies; scalars or arrays of any shape, floats in, floats out.

    A law may also have ``least_overlap``, the overlap in m below which the bodies are apart (0 if
    it has none; below 0 where they adhere; -inf of a bond), and ``most_overlap``, the overlap in m
    up to which the law is known. Below ``least_overlap`` the energy, the force, the stiffness and
    its slope are zero. A law without a ``least_overlap`` whose force at overlaps below zero is not
    zero is a bond: it pulls, and the bodies are never apart.

    Bodies that adhere down to a ``least_overlap`` below 0 pull only once they have touched. They
    touch when their overlap rises to ``touch_overlap``, m, or to 0 if the law has no such
    attribute. Of a force that acts from afar, ``touch_overlap`` equals ``least_overlap``.

    A law may have a method ``contact_radius(overlap)``, m, zero where bodies are apart. The
    stiffness against slip is then 8 G* a of this radius a, and that against twist follows from it
    too; without the method a is k/2E* of the stiffness k.
    """

    def force(self, overlap: ArrayLike) -> Any:
        """Return the force f, N, at each ``overlap`` delta, m."""
        ...

    def stiffness(self, overlap: ArrayLike) -> Any:
        """Return the stiffness df/d(delta), N/m, at each ``overlap`` delta, m."""
        ...

    def stiffness_slope(self, overlap: ArrayLike) -> Any:
        """Return the slope of the stiffness, d^2f/d(delta)^2, N/m^2, at each ``overlap`` delta,
        m.
        """
        ...

    def energy(self, overlap: ArrayLike) -> Any:
        """Return the energy, J, at each ``overlap`` delta, m; its derivative is the force."""
        ...

    def overlap(self, force: ArrayLike) -> Any:
        """Return the overlap delta, m, at each ``force``, N."""
        ...


@dataclass(frozen=True)
class Hertz:
    """Hertz's law f = (4/3) E* R^(1/2) delta^(3/2) of two elastic balls, also of unlike ones.

    1/E* is the sum of (1 - sigma^2)/E of both balls, 1/R the sum of 1/R_i.
    """

    def between(self, ball: Body, other: Body) -> HertzLaw:
        """Return the law of the contact of two bodies, ``ball`` and ``other``. Raises
        :class:`InputError` as :meth:`~granphon.balls.ball.ContactConstants.of` does, and for a
        contact beyond double precision.
        """
        constants = ContactConstants.of(ball, other)
        return HertzLaw(4.0 / 3.0 * constants.modulus * math.sqrt(constants.radius))


@dataclass(frozen=True)
class PowerLaw(EnergyLaw):
    """The law f = c delta^a of all contacts, whatever the balls. With a = 1 a contact is a spring
    that only pushes, with a = 2 it is that of a cone.

    Parameters
    ----------
    exponent : a, 1 or above.
    coefficient : c, N/m^a.

    Its methods take scalars or arrays, and return floats for floats. The energy is c
    delta^(a+1)/(a+1), the stiffness a c delta^(a-1), and its slope a (a-1) c delta^(a-2). All are
    zero where delta is zero or below.

    Raises
    ------
    InputError : an exponent below 1, or a number that is not finite or not above zero.
    """

    exponent: float
    coefficient: float

    def __post_init__(self) -> None:
        """Check both numbers, and keep them as plain floats."""
        object.__setattr__(self, "exponent", positive("exponent", self.exponent))
        object.__setattr__(
            self, "coefficient", positive("coefficient", self.coefficient, "N/m^exponent")
        )
        if self.exponent < 1.0:
            why = "Below 1 a contact is infinitely stiff where balls begin to touch"
            raise InputError(f"exponent is {self.exponent:g}", why, "Give 1 or more")

    def between(self, ball: Body, other: Body) -> PowerLaw:
        """Return the law itself, which is the same for all pairs ``ball`` and ``other``."""
        return self

    def _evaluate(self, overlap: ArrayLike, order: int) -> Any:
        """Return the energy, J, or its derivative of an ``order`` of 1 to 3, J/m^order, at each
        ``overlap``, m, unchecked: a power of the overlap, and zero where the overlap is not above
        zero.
        """
        delta = np.asarray(real_array("overlap", overlap))
        a = self.exponent
        factors = (1.0 / (a + 1.0), 1.0, a, a * (a - 1.0))  # of the energy and its derivatives
        factor = factors[order] * self.coefficient
        powers = np.zeros(delta.shape)
        # the slope for a = 1 has the factor zero: delta^-1, which may overflow, is left out
        is_computed = (delta > 0.0) & (factor > 0.0)
        np.power(delta, a + 1.0 - order, out=powers, where=is_computed)
        return (factor * powers)[()]

    def overlap(self, force: ArrayLike) -> Any:
        """Return the overlap (f/c)^(1/a), m, under a ``force`` f, N; :class:`InputError` if a force
        is negative or nan, or if an overlap is not finite, as that of an infinite force.
        """
        forces = np.asarray(real_array("force", force))
        require_pushing(forces)
        with np.errstate(over="ignore"):
            overlaps = (forces / self.coefficient) ** (1.0 / self.exponent)
        require_finite("overlap", overlaps, "a force", forces, "N")
        return overlaps[()]


@dataclass(frozen=True)
class _Adhesive:
    """A law with a work of adhesion."""

    adhesion: float

    def __post_init__(self) -> None:
        """Check the work of adhesion, and keep it as a plain float."""
        object.__setattr__(self, "adhesion", not_negative("adhesion", self.adhesion, "J/m^2"))

    def _find_tension(self, radius: float) -> float:
        """Return 2 pi w R, N, of two bodies; ``radius`` is R, m, of which 1/R is the sum of both
        curvatures. Raises InputError if the product is not finite.
        """
        tension = 2.0 * math.pi * self.adhesion * radius
        if not tension < math.inf:
            raise self._make_precision_error()
        return tension

    def _make_precision_error(self) -> InputError:
        """Return the error of an adhesion that is beyond double precision."""
        problem = (
            f"an adhesion of {self.adhesion:g} J/m^2 is beyond double precision for these balls"
        )
        return InputError(problem, mend="Give 0, or compare the units")


@dataclass(frozen=True)
class DMT(_Adhesive):
    """The law of Derjaguin, Muller and Toporov: Hertz's force less 2 pi w R, for stiff balls of
    small adhesion. 1/R is the sum of 1/R_i of both balls.

    Parameters
    ----------
    adhesion : the work of adhesion w of the two surfaces, J/m^2; 0 is Hertz's law.

    A contact bears a tension of up to 2 pi w R, at which the balls only touch; farther apart it is
    broken, and the attraction of balls that do not touch is left out.

    Raises
    ------
    InputError : an adhesion that is not a finite number, zero or above; or, for two bodies, one
        beyond double precision.
    """

    def between(self, ball: Body, other: Body) -> PairLaw:
        """Return the law of the contact of two bodies, ``ball`` and ``other``. Raises
        :class:`InputError` as :meth:`~granphon.balls.ball.ContactConstants.of` does, and for a
        contact or an adhesion beyond double precision.
        """
        radius = ContactConstants.of(ball, other).radius
        return DMTLaw(Hertz().between(ball, other), self._find_tension(radius))


@dataclass(frozen=True)
class DMTLaw(EnergyLaw):
    """The law of a pair that :class:`~granphon.DMT` returns: Hertz's law less a ``tension``, N,
    where the balls touch.

    The energy is that over balls that only touch, at which the contact breaks.
    """

    hertz: HertzLaw
    tension: float

    def _evaluate(self, overlap: ArrayLike, order: int) -> Any:
        """Return the energy, J, or its derivative of an ``order`` of 1 to 3, J/m^order, at each
        ``overlap``, m, unchecked: those of Hertz's law less those of the tension.
        """
        elastic = self.hertz._evaluate(overlap, order)
        if order > FORCE:
            return elastic  # the tension is constant
        delta = np.asarray(real_array("overlap", overlap))
        pull = np.where(delta >= 0.0, self.tension, 0.0)
        if order == FORCE:
            return (elastic - pull)[()]
        return (elastic - pull * np.maximum(delta, 0.0))[()]

    def overlap(self, force: ArrayLike) -> Any:
        """Return the overlap, m, at a ``force``, N; :class:`InputError` for a tension that the
        contact does not bear, for nan, and for an overlap that is not finite.
        """
        forces = np.asarray(real_array("force", force))
        require_pushing(forces, -self.tension)
        return self.hertz.overlap(forces + self.tension)


@dataclass(frozen=True)
class JKR(_Adhesive):
    """The law of Johnson, Kendall and Roberts, for soft balls of large adhesion.

    Parameters
    ----------
    adhesion : the work of adhesion w of the two surfaces, J/m^2; 0 is Hertz's law.

    1/E* is the sum of (1 - sigma^2)/E of both balls, 1/R the sum of 1/R_i, and s is the length
    (2 pi w R^2/E*)^(1/3). A contact bears a tension of up to (3/2) pi w R, at which its stiffness
    is zero and the balls are apart by 0.23 s^2/R. Farther apart the contact is broken: the branch
    that is stable only where the distance is held is left out. Balls that come near each other pull
    once they touch, so that a contact that is made and broken takes energy: 0.33 pi w s^2.

    The stiffness against slip is 8 G* a of the radius a of the contact under its load (A. R.
    Savkoor and G. A. D. Briggs, Proc. R. Soc. A 356, 103, 1977), which adhesion makes larger than
    that of the normal stiffness.

    Raises
    ------
    InputError : an adhesion that is not a finite number, zero or above; or, for two bodies, one
        beyond double precision.
    """

    def between(self, ball: Body, other: Body) -> PairLaw:
        """Return the law of the contact of two bodies, ``ball`` and ``other``: Hertz's if there is
        no adhesion. Raises :class:`InputError` as
        :meth:`~granphon.balls.ball.ContactConstants.of` does, and for a contact or an adhesion
        beyond double precision.
        """
        if not self.adhesion:
            return Hertz().between(ball, other)
        constants = ContactConstants.of(ball, other)
        force_scale = self._find_tension(constants.radius)
        # the scales of JKRLaw: the contact radius (2 pi w R^2/E*)^(1/3), and the overlap spot^2/R
        spot = math.cbrt(force_scale) * math.cbrt(constants.radius / constants.modulus)
        length = spot / constants.radius * spot
        has_all_digits = force_scale >= LEAST_NORMAL and LEAST_NORMAL <= length < math.inf
        if not has_all_digits:
            raise self._make_precision_error()
        return JKRLaw(force_scale, length, spot)


@dataclass(frozen=True)
class JKRLaw(EnergyLaw):
    """The law of a pair that :class:`~granphon.JKR` returns.

    All follows from one number u. The contact radius is ``spot`` times u^2, the force is
    ``force_scale`` times (4/3) u^6 - 2 u^3, and the overlap is ``length`` times u^4 - u. The
    contact breaks where u^3 is 3/4, and bears no load where u^3 is 3/2. The energy is that over
    balls far apart.

    Attributes
    ----------
    force_scale : 2 pi w R, N, with the letters of :class:`~granphon.JKR`.
    length : spot^2/R, m.
    spot : (2 pi w R^2/E*)^(1/3), m.
    """

    force_scale: float
    length: float
    spot: float

    @property
    def least_overlap(self) -> float:
        """Overlap at which the contact breaks, m."""
        return _JKR_LEAST * self.length

    @property
    def least_force(self) -> float:
        """Force at which the contact breaks, -(3/4) :attr:`force_scale`, N."""
        return -0.75 * self.force_scale

    @property
    def touch_overlap(self) -> float:
        """Overlap at which bodies that come together touch, m."""
        return 0.0

    def contact_radius(self, overlap: ArrayLike) -> Any:
        """Return the radius of the contact at an ``overlap``, m; zero where the bodies are apart.
        Raises :class:`InputError` for nan, and for a radius that is not finite.
        """
        delta = real_array("overlap", overlap)
        u, is_unbroken = self._solve(delta)
        radius = np.where(is_unbroken, self.spot * u * u, 0.0)
        require_finite("radius", radius, "an overlap", delta, "m")
        return radius[()]

    def _solve(self, delta: Array) -> tuple[Array, Flags]:
        """Return the larger root u of u^4 - u = delta/length at overlaps ``delta``, m, and whether
        the contact is unbroken; both of the shape of ``delta``. A broken contact has the u of the
        least overlap.
        """
        with np.errstate(all="ignore"):
            reduced_overlap = delta / self.length
            # an overlap that is no number counts as unbroken, so that the result is no number
            is_broken = reduced_overlap < _JKR_LEAST * (1.0 + ROUNDING)
            target = np.maximum(reduced_overlap, _JKR_LEAST)
            # u^4 - u is convex, and the first guess is not below the root: Newton's steps descend
            # to the root
            positive_target = np.maximum(target, 0.0)
            fourth_root = np.sqrt(np.sqrt(positive_target))
            u = np.sqrt(np.sqrt(positive_target + 1.0 + fourth_root))
            for _ in range(_STEPS):
                step = (u**4 - u - target) / (4.0 * u**3 - 1.0)
                u = u - step
                if not np.any(np.abs(step) > 0.5 * ROUNDING * u):
                    break
        return np.maximum(u, _JKR_ROOT), ~is_broken

    def _evaluate(self, overlap: ArrayLike, order: int) -> Any:
        """Return the energy, J, or its derivative of an ``order`` of 1 to 3, J/m^order, at each
        ``overlap``, m, unchecked: functions of u and u^3, and zero where the contact is broken.
        """
        u, is_unbroken = self._solve(np.asarray(real_array("overlap", overlap)))
        cube = u**3
        force = self.force_scale
        length = self.length
        rise = 4.0 * cube - 1.0  # d(u^4 - u)/du
        # factors are in such an order that products stay in the floating range
        if order == ENERGY:
            # the integral of the force over the overlap, from a contact of no radius, u = 0, on
            polynomial = 8.0 / 15.0 * cube - 4.0 / 3.0 + 0.5 / cube
            derivative = (force * cube) * (length * u**4) * polynomial
        elif order == FORCE:
            derivative = 2.0 * (force * cube) * (2.0 / 3.0 * cube - 1.0)
        elif order == STIFFNESS:
            derivative = force / length * 2.0 * u**2 * ((4.0 * cube - 3.0) / rise)
        else:
            terms = 4.0 * u * (4.0 * cube - 3.0) / rise + 48.0 * (u**2 / rise) ** 2
            derivative = force / length / length * terms / rise
        return np.where(is_unbroken, derivative, 0.0)[()]

    def overlap(self, force: ArrayLike) -> Any:
        """Return the overlap, m, at a ``force``, N; :class:`InputError` for a tension that the
        contact does not bear, for nan, and for an overlap that is not finite.
        """
        forces = np.asarray(real_array("force", force))
        require_pushing(forces, self.least_force)
        with np.errstate(over="ignore"):
            reduced_force = forces / self.force_scale
            # u^3, the larger root of 2/3 u^6 - u^3 = reduced_force/2
            cube = 0.75 * (1.0 + np.sqrt(np.maximum(1.0 + 4.0 / 3.0 * reduced_force, 0.0)))
        overlaps = self.length * np.cbrt(cube) * (cube - 1.0)
        require_finite("overlap", overlaps, "a force", forces, "N")
        return overlaps[()]


@dataclass(frozen=True)
class TabulatedLaw(EnergyLaw):
    """A law that is given by a table of overlaps and forces, for all pairs.

    The logarithm of the force is a monotone cubic function of the logarithm of the overlap (scipy's
    ``PchipInterpolator``). So a table of a power law with an exponent of 1 or above gives this law
    at all overlaps. Below the first point and above the last it goes on as a power; below, of an
    exponent of 1 or above, so that contacts are not infinitely stiff where balls begin to touch.

    Parameters
    ----------
    overlap : (n,) overlaps, m, ascending, two or more of them above zero.
    force : (n,) forces, N, ascending. A first point (0, 0) may be there, and changes nothing.

    Its methods take scalars or arrays, and return floats for floats. The slope of the stiffness
    jumps at the points of the table.

    Raises
    ------
    InputError : columns that are not of one length, fewer than two points above zero, numbers that
        are not finite, do not ascend or are not above zero, or ascend by less than their logarithms
        can tell.
    """

    overlaps: tuple[float, ...]
    forces: tuple[float, ...]

    def __init__(self, overlap: ArrayLike, force: ArrayLike) -> None:
        """Check the table, and keep it without a first point at zero."""
        delta = real_array("overlap", overlap)
        f = real_array("force", force)
        if delta.ndim != 1 or delta.shape != f.shape:
            problem = f"the table of a contact law has {delta.shape} overlaps and {f.shape} forces"
            raise InputError(problem, mend="Give two lists of one length")
        begins_at_zero = delta[:1].tolist() == [0.0] and f[:1].tolist() == [0.0]
        if begins_at_zero:  # zero has no logarithm
            delta = delta[1:]
            f = f[1:]
        _require_rising(delta, f, first_row=int(begins_at_zero))
        object.__setattr__(self, "overlaps", tuple(delta.tolist()))
        object.__setattr__(self, "forces", tuple(f.tolist()))

    @property
    def most_overlap(self) -> float:
        """Overlap up to which the table reaches, m."""
        return self.overlaps[-1]

    def between(self, ball: Body, other: Body) -> TabulatedLaw:
        """Return the law itself, which is the same for all pairs ``ball`` and ``other``."""
        return self

    def find_stiffest(self, overlap: Array) -> Array:
        """Return the largest stiffness, N/m, (m,) up to each ``overlap`` (m,), m: tables may rise
        steeply between two of their points. The stiffness is compared at 16 places between two
        points.
        """
        fractions = np.linspace(0.0, 1.0, _PLACES, endpoint=False)
        knots, _ = self._knots
        # (n - 1, places) logarithms of overlaps between the points of the table
        log_places = knots[:-1, None] + np.diff(knots)[:, None] * fractions
        places = np.exp(np.append(log_places.ravel(), knots[-1]))
        # the largest stiffness at any place up to each one, with zero in front of the first
        stiffest_at_places = np.append(0.0, np.maximum.accumulate(self.stiffness(places)))
        stiffest_below = stiffest_at_places[np.searchsorted(places, overlap, side="right")]
        return np.asarray(np.maximum(stiffest_below, self.stiffness(overlap)))

    @cached_property
    def _knots(self) -> tuple[Array, Array]:
        """Logarithms of the overlaps and of the forces of the table, (n,) each."""
        return np.log(self.overlaps), np.log(self.forces)

    @cached_property
    def _curve(self) -> Any:
        """The logarithm of the force as a function of that of the overlap: a cubic spline without
        bumps.
        """
        from scipy.interpolate import CubicHermiteSpline, PchipInterpolator

        x, y = self._knots
        curve = PchipInterpolator(x, y)
        slopes = curve(x, 1)
        rise = np.diff(y) / np.diff(x)
        # the interpolator may be flat, or too flat, at the ends; with slopes of up to three times
        # the rise the curve stays monotone
        first_slope = max(slopes[0], min(1.0, 3.0 * rise[0]))
        last_slope = slopes[-1] or rise[-1]
        if first_slope == slopes[0] and last_slope == slopes[-1]:
            return curve
        slopes[0] = first_slope
        slopes[-1] = last_slope
        return CubicHermiteSpline(x, y, slopes)

    @cached_property
    def _exponent_below(self) -> float:
        """Exponent of the power below the first point."""
        return max(float(self._curve(self._knots[0][0], 1)), 1.0)

    def _find_log_force(self, x: Array, order: int = 0) -> Array:
        """Return log f (``order`` 0), or its derivative of order 1 or 2, at x = log delta; of the
        shape of ``x``.
        """
        knots, _ = self._knots
        curve = self._curve
        nearest_x = np.clip(x, knots[0], knots[-1])  # within the table
        if order == 2:
            # beyond the table, where the law is a power, the slope is constant
            return np.where(x == nearest_x, curve(nearest_x, 2), 0.0)
        slope = np.where(x < knots[0], self._exponent_below, curve(nearest_x, 1))
        if order == 1:
            return slope
        return np.asarray(curve(nearest_x)) + (x - nearest_x) * slope

    @cached_property
    def _energies(self) -> Array:
        """Energies (n,) at the points of the table, J."""
        knots, _ = self._knots
        # below the first point the force is a power of the overlap
        energy_at_first_point = self.forces[0] * self.overlaps[0] / (1.0 + self._exponent_below)
        differences = self._integrate(knots[:-1], knots[1:])
        return energy_at_first_point + np.concatenate([[0.0], np.cumsum(differences)])

    def _integrate(self, low: Array, high: Array) -> Array:
        """Return the integral of the force over the overlap, J, (m,) from ``low`` (m,) to ``high``
        (m,), the logarithms of two overlaps between the same points of the table.
        """
        nodes, weights = np.polynomial.legendre.leggauss(_NODES)
        half_length = 0.5 * (high - low)
        x = low[..., None] + half_length[..., None] * (1.0 + nodes)
        # with x = log delta the integrand is f delta
        return half_length * (np.exp(self._find_log_force(x) + x) @ weights)

    def _evaluate(self, overlap: ArrayLike, order: int) -> Any:
        """Return the energy, J, or its derivative of an ``order`` of 1 to 3, J/m^order, at each
        ``overlap`` delta, m, from log f as a function of log delta.
        """
        delta = np.asarray(real_array("overlap", overlap))
        is_touching = delta > 0.0
        x = np.log(np.where(is_touching, delta, self.overlaps[0]))
        if order == ENERGY:
            derivative = self._find_energy(x)
        else:
            force_over_power = np.exp(self._find_log_force(x) - (order - 1) * x)
            derivative = force_over_power * self._find_factor(x, order)
        return np.where(is_touching, derivative, 0.0)[()]

    def _find_factor(self, x: Array, order: int) -> Array | float:
        """Return the derivative of the energy, of an ``order`` of 1 to 3, times delta^(order - 1)/f
        at x = log delta.

        With n = d log f / d log delta, f' = f n / delta and f'' = f (n (n - 1) + n') / delta^2.
        """
        if order == FORCE:
            return 1.0
        exponent = self._find_log_force(x, 1)
        if order == STIFFNESS:
            return exponent
        return exponent * (exponent - 1.0) + self._find_log_force(x, 2)

    def _find_energy(self, x: Array) -> Array:
        """Return the energy, J, at logarithms ``x`` of overlaps: an integral between two points of
        the table, and that of a power law below the first point and above the last.
        """
        knots, _ = self._knots
        knot = np.clip(np.searchsorted(knots, x, side="right") - 1, 0, len(knots) - 1)
        energy_since_knot = self._integrate(knots[knot], np.clip(x, knots[0], knots[-1]))
        energy_inside = self._energies[knot] + energy_since_knot
        # the energy of a power law is counted from zero overlap: above the last point only what
        # the power law adds to its energy at the last point counts
        energy_of_power = np.exp(self._find_log_force(x) + x) / (1.0 + self._find_log_force(x, 1))
        last_exponent = float(self._find_log_force(knots[-1:], 1)[0])
        energy_of_power_at_last = self.forces[-1] * self.overlaps[-1] / (1.0 + last_exponent)
        energy_above = self._energies[-1] - energy_of_power_at_last + energy_of_power
        energy = np.where(x > knots[-1], energy_above, energy_inside)
        return np.where(x < knots[0], energy_of_power, energy)

    def overlap(self, force: ArrayLike) -> Any:
        """Return the overlap, m, under a ``force``, N; :class:`InputError` if a force is negative
        or nan, or if an overlap is not finite.
        """
        forces = np.asarray(real_array("force", force))
        require_pushing(forces)
        require_finite("overlap", forces, "a force", forces, "N")
        log_force = np.log(np.where(forces > 0.0, forces, self.forces[0]))
        log_overlap = self._find_log_overlap(log_force)
        with np.errstate(over="ignore"):
            overlaps = np.where(forces > 0.0, np.exp(log_overlap), 0.0)
        require_finite("overlap", overlaps, "a force", forces, "N")
        return overlaps[()]

    def _find_log_overlap(self, log_force: Array) -> Array:
        """Return log delta at each log f, of the same shape.

        log f rises with log delta: Newton's method, kept between the two points of the table that
        log f lies between, if it does.
        """
        knots, log_forces = self._knots
        count = len(knots)
        next_knot = np.clip(np.searchsorted(log_forces, log_force, side="right"), 0, count)
        low = np.where(next_knot > 0, knots[np.maximum(next_knot - 1, 0)], -np.inf)
        high = np.where(next_knot < count, knots[np.minimum(next_knot, count - 1)], np.inf)
        x = np.interp(log_force, log_forces, knots)
        for _ in range(_STEPS):
            residual = self._find_log_force(x) - log_force
            slope = self._find_log_force(x, 1)
            low = np.where(residual < 0.0, x, low)
            high = np.where(residual > 0.0, x, high)
            with np.errstate(divide="ignore", invalid="ignore"):
                newton_x = x - residual / slope
                middle = 0.5 * (low + high)
            # beyond the outer points the middle is infinite, and x stays
            fallback = np.where(np.isfinite(middle), middle, x)
            is_between = (newton_x >= low) & (newton_x <= high)
            next_x = np.where(is_between, newton_x, fallback)
            is_settled = np.abs(next_x - x) <= ROUNDING * np.maximum(1.0, np.abs(x))
            x = next_x
            if np.all(is_settled):
                break
        return np.asarray(x)


def _require_rising(overlaps: Array, forces: Array, first_row: int) -> None:
    """Raise :class:`InputError` unless the overlaps (n,), m, and forces (n,), N, of a table are two
    or more, finite, above zero, and rise, their logarithms too. ``first_row`` is the number of the
    first of them in the table as it was given.
    """
    is_allowed = np.isfinite(overlaps) & np.isfinite(forces) & (overlaps > 0.0) & (forces > 0.0)
    is_allowed &= (np.diff(overlaps, prepend=0.0) > 0.0) & (np.diff(forces, prepend=0.0) > 0.0)
    if not np.all(is_allowed):
        row = int(np.argmin(is_allowed))
        problem = (
            f"the table of a contact law has the overlap {overlaps[row]:g} m and the force"
            f" {forces[row]:g} N in its row {first_row + row}, counted from 0"
        )
        raise InputError(
            problem,
            "Both must be finite, above zero, and above those of the row before",
            "Sort the table, and leave out what is no number",
        )
    if overlaps.size < 2:
        rows = counted(overlaps.size, "row")
        raise InputError(
            f"the table of a contact law has {rows} with a force", mend="Give two or more"
        )
    is_apart = (np.diff(np.log(overlaps)) > 0.0) & (np.diff(np.log(forces)) > 0.0)
    if not np.all(is_apart):
        row = first_row + int(np.argmin(is_apart))
        problem = (
            f"rows {row} and {row + 1} of the table of a contact law, counted from 0, differ by"
            f" less than their logarithms can tell"
        )
        raise InputError(problem, "Its curve goes through logarithms", "Leave one out")


def opening_overlap(law: PairLaw) -> float:
    """Return the overlap below which bodies with a ``law`` are apart, m; -inf of a bond, which
    never opens.
    """
    least_overlap = getattr(law, "least_overlap", None)
    if least_overlap is not None:
        return float(least_overlap)
    # only a bond has a force between balls that are apart
    is_bond = bool(np.any(law.force(_OPEN_OVERLAP)))
    return -math.inf if is_bond else 0.0


def touching_overlap(law: PairLaw) -> float:
    """Return the overlap at which bodies with a ``law`` that come together touch, m; -inf of a
    bond.
    """
    least_overlap = opening_overlap(law)
    if least_overlap == -math.inf:
        return least_overlap
    return max(least_overlap, float(getattr(law, "touch_overlap", 0.0)))


def punch_stiffness(law: PairLaw, overlap: Array, modulus: Array | float) -> Array:
    """Return 2 E* a, N/m, at each ``overlap``, m: the stiffness of a flat punch of the contact
    radius a. ``modulus`` is E*, Pa.

    If the law has no method for a, the result is the normal stiffness, which equals 2 E* a of
    elastic bodies of revolution without adhesion, whatever their profile (I. N. Sneddon, Int. J.
    Eng. Sci. 3, 47, 1965).
    """
    find_radius = getattr(law, "contact_radius", None)
    if callable(find_radius):
        return np.asarray(2.0 * modulus * np.asarray(find_radius(overlap)))
    return np.asarray(law.stiffness(overlap))


def law_between(law: Any, ball: Body, other: Body) -> PairLaw:
    """Return the law of the contact of two bodies: ``law.between(ball, other)`` or, if ``law`` has
    no method ``between``, ``law`` itself, which is then the law of all pairs.

    Raises :class:`~granphon.base.errors.InputError` if the law of the pair lacks one of the five
    methods of :class:`PairLaw`, or if ``law`` is a class of laws.
    """
    if isinstance(law, type):
        raise InputError(
            f"the contact law is the class {law.__name__}",
            mend=f"Give a law, as {law.__name__}(...)",
        )
    has_pairs = callable(getattr(law, "between", None))
    pair_law = law.between(ball, other) if has_pairs else law
    missing_methods = [name for name in _METHODS if not callable(getattr(pair_law, name, None))]
    if missing_methods:
        subject = f"the contact law {brief(law)}"
        if pair_law is not law:
            subject = f"{brief(pair_law)}, which between of {subject} returns,"
        problem = f"{subject} has no method {', '.join(missing_methods)}"
        why = "All are functions of the overlap, but overlap is a function of the force"
        mend = "Give one of granphon's laws, or an object with the methods " + ", ".join(_METHODS)
        raise InputError(problem, why, mend)
    return pair_law  # type: ignore[no-any-return]


def _check_radius(name: str, law: PairLaw, overlaps: Array) -> None:
    """Raise InputError for a user's law, called ``name``, whose ``contact_radius`` does not return
    radii, finite floats above zero, for an array of ``overlaps`` (n,), m, above zero.
    """
    find_radius = getattr(law, "contact_radius", None)
    if not callable(find_radius):
        return
    radii = _call_method(law, name, "contact_radius", overlaps)
    is_array = radii.shape == overlaps.shape and radii.dtype.kind == "f"
    if not is_array or not np.all((radii > 0.0) & np.isfinite(radii)):
        problem = (
            f"contact_radius of the contact law {name} returns {brief(radii)} for an array of"
            f" overlaps"
        )
        mend = "Return an array of floats of the same shape: radii, m, above zero"
        raise InputError(problem, mend=mend)


def check_law(law: PairLaw, radius: float) -> None:
    """Raise :class:`~granphon.base.errors.InputError` if the methods of a user's law do not agree
    with each other at overlaps from 1e-6 to 1e-3 of the ``radius`` R of two bodies, m, that of
    :class:`~granphon.balls.ball.ContactConstants`; of a bond also at minus these overlaps. Laws of
    granphon are not compared.

    They do not agree if a method is not the derivative of the method before it (in the order
    energy, force, stiffness, stiffness_slope), or if the overlap of a force is not the overlap that
    has this force. Refused too are methods that do not take arrays or do not return arrays of
    finite floats, a force that does not rise with the overlap, a ``least_overlap`` that is no
    number, a force below it, and a ``contact_radius`` that does not return finite radii above zero.
    """
    if isinstance(law, HertzLaw | PowerLaw | DMTLaw | JKRLaw | TabulatedLaw):
        return
    name = type(law).__name__
    overlaps = _PROBES * radius
    is_bond = _check_opening(law, name, overlaps)
    _check_radius(name, law, overlaps)
    if is_bond:
        overlaps = np.concatenate([overlaps, -overlaps])
    # (n, 3): each overlap, and the two beside it
    steps = overlaps[:, None] * (1.0 + _STEP * np.array([0.0, 1.0, -1.0]))
    numbers = {method: _call_for_numbers(law, name, method, steps) for method in _DERIVATIVES}
    for method, derivative in pairwise(_DERIVATIVES):
        subject = f"{derivative} of the contact law {name}"
        derivatives = numbers[derivative][:, 0]
        _compare_derivative(subject, method, overlaps, numbers[method], derivatives)
    is_flat = numbers["stiffness"][:, 0] <= 0.0
    if np.any(is_flat):
        problem = f"the force of the contact law {name} does not rise"
        raise _make_error_at(overlaps[int(np.argmax(is_flat))], problem)
    overlaps_of_forces = _call_for_numbers(law, name, "overlap", numbers["force"][:, 0])
    is_off = np.abs(overlaps_of_forces - overlaps) > _TOLERANCE * np.abs(overlaps)
    if np.any(is_off):
        index = int(np.argmax(is_off))
        found_overlap = f"{overlaps_of_forces[index]:.6g} m"
        problem = f"overlap(force(overlap)) of the contact law {name} is {found_overlap}"
        raise _make_error_at(overlaps[index], problem)


def _check_opening(law: PairLaw, name: str, overlaps: Array) -> bool:
    """Return whether a law, called ``name``, is that of a bond, which pulls at any distance.

    The forces are compared at ``overlaps`` (n,), m, above zero, subtracted from the least overlap.
    Raises InputError for a ``least_overlap`` of the law that is no number, for forces that are not
    finite, and for forces below the ``least_overlap``.
    """
    given_least = getattr(law, "least_overlap", None)
    if given_least is not None and math.isnan(real_number(given_least)):
        raise InputError(
            f"least_overlap of the contact law {name} is {brief(given_least)}",
            mend="Give a number, m; -inf for a bond",
        )
    if given_least == -math.inf:  # the law itself says that it is a bond
        given_least = None
    least_overlap = 0.0 if given_least is None else given_least
    forces = _call_method(law, name, "force", least_overlap - overlaps)
    if forces.dtype.kind not in "fiu" or not np.all(np.isfinite(forces)):
        raise InputError(
            f"force of the contact law {name} is no finite number below an overlap of"
            f" {least_overlap:g} m",
            "Balls may be apart",
            "Return zero there" + ("" if least_overlap else ", with np.maximum(overlap, 0.0)"),
        )
    has_force = bool(np.any(forces))
    if given_least is not None and has_force:
        raise InputError(
            f"the contact law {name} has forces that its least_overlap denies",
            f"least_overlap is {least_overlap:g} m, below which balls are apart",
            "Return zero there",
        )
    return has_force


def _call_method(law: PairLaw, name: str, method: str, overlaps: Array) -> Array:
    """Return what the ``method`` of a law called ``name`` returns for an array of ``overlaps``, m,
    of any shape; InputError if the method does not take an array.

    For the method "overlap" the array holds forces, N.
    """
    try:
        with np.errstate(all="ignore"):  # the caller refuses numbers that are not finite
            return np.asarray(getattr(law, method)(overlaps))
    except (TypeError, ValueError) as error:
        problem = (
            f"{method} of the contact law {name} does not take an array: {str(error).rstrip('.')}"
        )
        mend = (
            "Use numpy's functions, such as np.maximum for max, np.sqrt for math.sqrt,"
            " np.where for if"
        )
        raise InputError(problem, "All contacts are asked at once", mend) from error


def _call_for_numbers(law: PairLaw, name: str, method: str, overlaps: Array) -> Array:
    """Return the numbers that the ``method`` of a law called ``name`` returns for an array of
    ``overlaps``, m (for the method "overlap" of forces, N); InputError unless the result is an
    array of finite floats of the same shape.
    """
    numbers = _call_method(law, name, method, overlaps)
    is_array = numbers.shape == overlaps.shape and numbers.dtype.kind == "f"
    if not is_array or not np.all(np.isfinite(numbers)):
        problem = (
            f"{method} of the contact law {name} returns {brief(numbers)} for an array of"
            f" {'forces' if method == 'overlap' else 'overlaps'}"
        )
        raise InputError(problem, mend="Return an array of finite floats of the same shape")
    return numbers


def _compare_derivative(
    subject: str, method: str, overlaps: Array, numbers: Array, derivatives: Array
) -> None:
    """Raise InputError unless ``derivatives`` (n,), which the message calls ``subject``, are those
    of the ``numbers`` (n, 3) that a ``method`` returns at the ``overlaps`` (n,), m, a step above
    them and a step below.
    """
    slopes = (numbers[:, 1] - numbers[:, 2]) / (2.0 * _STEP * overlaps)
    # beside a slope that is nearly zero, the number over the overlap is the measure of an error
    size = np.maximum(np.abs(derivatives), np.abs(numbers[:, 0] / overlaps))
    is_off = np.abs(slopes - derivatives) > _TOLERANCE * size
    if np.any(is_off):
        index = int(np.argmax(is_off))
        problem = (
            f"{subject} is {derivatives[index]:.6g}, and the derivative of its {method}"
            f" {slopes[index]:.6g}"
        )
        raise _make_error_at(overlaps[index], problem)


def _make_error_at(overlap: float, problem: str) -> InputError:
    """Return the error of a law that has a ``problem`` at an ``overlap``, m."""
    return InputError(f"{problem} at an overlap of {overlap:.4g} m", mend="Mend the law")


# -- laws that have a name -------------------------------------------------------------------------


@dataclass(frozen=True)
class NamedLaw:
    """A contact law that has a name.

    Attributes
    ----------
    law : the law, or a class of laws.
    numbers : how a scene gives each argument of the class, by the name of the argument: a quantity,
        a tuple of one quantity for a list of such values, or a rule for a number without a unit;
        empty for a law that is no class, and for a class that takes none.
    """

    law: Any
    numbers: Mapping[str, Quantity | tuple[Quantity] | Rule]


#: the laws by their names in scenes
LAWS: Registry[NamedLaw] = Registry("contact law")
LAWS.own("hertz", NamedLaw(Hertz, {}))
LAWS.own("power", NamedLaw(PowerLaw, {"exponent": above_zero, "coefficient": above_zero}))
LAWS.own("dmt", NamedLaw(DMT, {"adhesion": ADHESION}))
LAWS.own("jkr", NamedLaw(JKR, {"adhesion": ADHESION}))
_FORCE = replace(LOADS["force"], example="2 N", common="mN, N, kN", least="any")
LAWS.own("tabulated", NamedLaw(TabulatedLaw, {"overlap": (LOADS["overlap"],), "force": (_FORCE,)}))


def register_law(name: str, law: Any, **units: str) -> Any:
    """Make a contact law known by a name: to ``Crystal(..., law=name)`` and to scenes.

    Parameters
    ----------
    name : the name.
    law : a law, with ``between(ball, ball)`` or the methods of a :class:`PairLaw`; or a class of
        laws that takes numbers.
    units : the SI unit of each number that the class takes, which a scene gives as ``law: {name:
        {number: "5 N/m"}}``; "" or "1" for a number without a unit. The law keeps each number in an
        attribute of the same name.

    Returns ``law``. A crystal that takes the law compares it with its derivatives. Raises
    :class:`InputError` for an object that is no law, for units of a law that is no class, for units
    that are not those of the numbers of a class (numbers with a default may be left out) or that
    are no text of SI, and for a name that is no printable text, begins with =, +, - or @, is taken
    or has a space.
    """
    has_methods = all(callable(getattr(law, method, None)) for method in _METHODS)
    if not has_methods and not callable(getattr(law, "between", None)):
        mend = f"Give it the method between(ball, ball), or {', '.join(_METHODS)}"
        raise InputError(f"{brief(law)} is no contact law", mend=mend)
    if units and not isinstance(law, type):
        raise InputError(
            f"the contact law {name!r} is made already", mend="Give its class, or no units"
        )
    require("the name of a contact law", label, name)
    given_units: list[Any] = list(units.values())  # of any kind, as callers may err
    wrong_texts = [
        unit for unit in given_units if not isinstance(unit, str) or (unit and not is_si(unit))
    ]
    if " " in name:
        wrong_texts.insert(0, name)
    if wrong_texts:
        mend = "Give a name without spaces, and units of SI"
        raise InputError(f"a contact law cannot have {brief(wrong_texts[0])}", mend=mend)
    if isinstance(law, type):
        _require_units(law, name, units)
    rules: dict[str, Any] = {}
    for key, unit in units.items():
        if unit in ("", "1"):
            rules[key] = partial(number, low=-1e300, high=1e300)  # any finite number
        else:
            rules[key] = Quantity(key, unit, f"1 {unit}", unit, "any")
    LAWS.add(name, NamedLaw(law, rules), law)
    return law


def _require_units(law: type, name: str, units: Mapping[str, str]) -> None:
    """Raise :class:`InputError`, which calls a class of laws ``name``, unless ``units`` have one
    entry for each number that the class must be given, and none for a number that it does not take.
    """
    try:
        inspect.signature(law).bind(**units)
    except TypeError as error:
        numbers = ", ".join(units) or "nothing"
        raise InputError(
            f"the contact law {name!r} is not made of {numbers}: {error}",
            mend="Name the unit of each number that the class takes",
        ) from None


def find_law(law: Any) -> Any:
    """Return the law that ``law`` names, or ``law`` itself if it is not a text. Raises
    :class:`InputError` for a name without a law, and for the name of a class that takes numbers.
    """
    if not isinstance(law, str):
        return law
    named_law = LAWS[one_of("law", law, LAWS)]
    if named_law.numbers:
        numbers = ", ".join(named_law.numbers)
        raise InputError(
            f"the contact law {law!r} has numbers: {numbers}",
            mend=f"Give it as {named_law.law.__name__}({numbers})",
        )
    # a class without numbers, such as Hertz, has the name of the only law that it makes
    return named_law.law() if isinstance(named_law.law, type) else named_law.law


#: how laws are given
_MEND_LAWS = 'Give a law itself, or one for each pair of names, as {("A", "B"): law}'


def read_laws(law: Any) -> Any:
    """Return the law of all contacts, by default Hertz's, or a tuple of pairs of names of kinds,
    each with its law.

    ``law`` is a law, the name of a law, None, or a mapping from pairs of names of kinds to laws or
    names of laws. A tuple that this function has returned is read as the mapping of which it was
    made. Raises :class:`InputError` for a key that is no pair of names, for two different laws of
    one pair, and for what :func:`find_law` refuses.
    """
    if not isinstance(law, Mapping | tuple):
        return Hertz() if law is None else find_law(law)
    entries = tuple(law.items()) if isinstance(law, Mapping) else law
    if not all(isinstance(entry, tuple) and len(entry) == 2 for entry in entries):
        raise InputError(f"law is {brief(law)}", mend=_MEND_LAWS)
    laws = dict[tuple[str, str], Any]()
    for pair, given_law in entries:
        is_pair = isinstance(pair, tuple) and len(pair) == 2
        if not is_pair or not all(isinstance(name, str) for name in pair):
            raise InputError(f"law has the key {brief(pair)}", mend=_MEND_LAWS)
        law_of_kinds = find_law(given_law)
        for same_pair in (pair, pair[::-1]):
            if laws.get(same_pair, law_of_kinds) != law_of_kinds:
                raise InputError(
                    f"law has two laws for contacts of {pair}", mend="Give one, in either order"
                )
        laws[pair] = law_of_kinds
    return tuple(laws.items())


def law_of_pair(law: Any, ball: Body, other: Body, name: str, other_name: str) -> PairLaw:
    """Return the law of a contact of two bodies, ``ball`` of the kind ``name`` and ``other`` of the
    kind ``other_name``; ``law`` is what :func:`read_laws` returns, and may name other kinds too.

    Raises :class:`InputError` if ``law`` has no entry for the two kinds, and where
    :func:`law_between` does.
    """
    if isinstance(law, tuple):
        law_of_kinds = {frozenset(names): pair_law for names, pair_law in law}
        kinds = frozenset((name, other_name))
        if kinds not in law_of_kinds:
            raise InputError(
                f"law has none for contacts of {(name, other_name)}",
                f"It has {brief([tuple(names) for names, _ in law])}",
                "Give one for each pair of kinds that touch",
            )
        law = law_of_kinds[kinds]
    return law_between(law, ball, other)
