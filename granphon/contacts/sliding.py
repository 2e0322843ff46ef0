"""Compiled loops over the contacts of the law of friction; the law, and the formulas of a step, are
those of :mod:`granphon.contacts.friction`.

Loops take the law's numbers ``eta`` and ``mu``, and a :class:`Step` of n_c contacts with n_s slips
each; n_s is 1 in a plane, 2 in space. The root of an overlap h is r = h_+^(1/2), ``old_root``
before the step and ``new_root`` at its end; the normal stiffness is k = (3/2) r, and the normal
force r^3.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from granphon.balls.hertz import EXPONENT
from granphon.base.arrays import Array
from granphon.base.compiled import compiled

#: divisor in place of a root, or a product of two, that is zero: its square is above zero too
_LEAST_DIVISOR = 1e-150


class Step(NamedTuple):
    """What loops read of a step of all contacts.

    Attributes
    ----------
    old_overlaps : (n_c,) overlaps before the step.
    old_slips : (n_s, n_c) slips before the step.
    old_shears : (n_s, n_c) tangential forces before the step.
    overlaps : (n_c,) overlaps at the end of the step, or a guess of these.
    slips : (n_s, n_c) slips at the end of the step.
    """

    old_overlaps: Array
    old_slips: Array
    old_shears: Array
    overlaps: Array
    slips: Array


class SlipTangent(NamedTuple):
    """A :class:`~granphon.contacts.friction.Tangent` as loops read it: ``stiffness`` and ``shear``
    are (n_c,), ``coupling`` and ``sliding`` (n_s, n_c).
    """

    stiffness: Array
    shear: Array
    coupling: Array
    sliding: Array
    drag: float


@compiled
def _find_spring(eta: float, old_root: float, new_root: float, change: float) -> float:
    """Return the stiffness against slip in a step in which the root r of the overlap h goes from
    ``old_root`` to ``new_root``.

    If h rises, the stiffness is eta times the difference of r^3 over that of r^2 between the ends
    of the step; if h falls, eta k at the end. ``change`` is that of h in the whole step; it is read
    only where a contact closes, and is then the divisor. It includes the part below touch: so only
    the slip of the closed part makes a force.
    """
    if old_root == 0.0 and new_root > 0.0:
        return eta * new_root * new_root * new_root / change
    # the quotient of powers, divided out; where h falls, both of its roots are that at the end, and
    # the quotient is (3/2) r
    least_root = min(old_root, new_root)
    total = least_root + new_root
    return eta * (total - least_root * new_root / max(total, _LEAST_DIVISOR))


@compiled
def _find_spring_slope(eta: float, old_root: float, new_root: float, change: float) -> float:
    """Return the derivative of the stiffness of :func:`_find_spring`, with the same arguments, with
    respect to the overlap at the end of the step. It is zero if the contact is open there. If h
    stays, the derivative is that for a rise.
    """
    if new_root == 0.0:
        return 0.0
    if old_root == 0.0:
        mean_stiffness = new_root * new_root * new_root / change
        return eta * (EXPONENT * new_root - mean_stiffness) / change
    if new_root < old_root:
        return eta * EXPONENT * 0.5 / new_root
    inverse_sum = 1.0 / (old_root + new_root)
    return 0.5 * eta * (old_root * inverse_sum + 1.0) * inverse_sum


@compiled
def set_springs(eta: float, old_overlaps: Array, overlaps: Array, springs: Array) -> None:
    """Set ``springs`` (n_c,) to the stiffnesses of contacts against slip in a step from
    ``old_overlaps`` to ``overlaps``, (n_c,) each.
    """
    for c in range(len(overlaps)):
        old_root = math.sqrt(max(old_overlaps[c], 0.0))
        new_root = math.sqrt(max(overlaps[c], 0.0))
        springs[c] = _find_spring(eta, old_root, new_root, overlaps[c] - old_overlaps[c])


@compiled
def set_shears(eta: float, mu: float, step: Step, shears: Array) -> None:
    """Set ``shears`` (n_s, n_c) to the tangential forces at the end of a ``step``.

    A force beyond Coulomb's limit is shortened to the limit, and keeps its direction. The stiffness
    against slip and the limit are found from the overlaps of the step, which may be a guess.
    """
    old_overlaps, old_slips, old_shears, overlaps, slips = step
    for c in range(len(overlaps)):
        old_root = math.sqrt(max(old_overlaps[c], 0.0))
        new_root = math.sqrt(max(overlaps[c], 0.0))
        # T before the step is rescaled by least_root/old_root: by one where h does not fall
        least_root = min(old_root, new_root)
        spring = _find_spring(eta, old_root, new_root, overlaps[c] - old_overlaps[c])
        size = 0.0
        for s in range(len(slips)):
            shear = spring * (slips[s, c] - old_slips[s, c])
            if old_root > 0.0:
                shear += least_root * (old_shears[s, c] / old_root)
            shears[s, c] = shear
            size = math.hypot(size, shear) if s else abs(shear)
        limit = mu * (new_root * new_root * new_root)
        if size > limit:  # never where mu is infinite: the limit is infinite, or nan at a zero root
            for s in range(len(slips)):
                shears[s, c] *= limit / size


@compiled
def set_tangent(
    eta: float, mu: float, step: Step, overlaps: Array, is_coupled: bool, tangent: SlipTangent
) -> None:
    """Set the arrays of the ``tangent`` to the derivatives of the forces of contacts at the end of
    a ``step``, where overlaps are ``overlaps`` (n_c,). The drag of the tangent is not read.

    The stiffness against slip and Coulomb's limit are found from the overlaps of the step. If these
    are ``overlaps`` too, ``is_coupled`` is to be true. If they are a guess that does not change,
    tangential forces do not depend on ``overlaps``: then ``is_coupled`` must be false, and
    ``coupling`` is set to zero.
    """
    old_overlaps, old_slips, old_shears, tangential_overlaps, slips = step
    stiffness, shear, coupling, sliding, _ = tangent
    n_s = len(slips)
    trial = np.zeros(n_s)
    for c in range(len(overlaps)):
        old_root = math.sqrt(max(old_overlaps[c], 0.0))
        new_root = math.sqrt(max(tangential_overlaps[c], 0.0))
        least_root = min(old_root, new_root)
        overlap_change = tangential_overlaps[c] - old_overlaps[c]
        spring = _find_spring(eta, old_root, new_root, overlap_change)
        # derivatives with respect to the overlap at the end: of `spring`, and of `least_root`
        spring_slope = 0.0
        root_slope = 0.0
        if is_coupled:
            spring_slope = _find_spring_slope(eta, old_root, new_root, overlap_change)
            root_slope = 0.5 / new_root if 0.0 < new_root < old_root else 0.0
        size = 0.0
        for s in range(n_s):
            slip = slips[s, c] - old_slips[s, c]
            # T/r before the step
            reduced_shear = old_shears[s, c] / old_root if old_root > 0.0 else 0.0
            trial[s] = spring * slip + least_root * reduced_shear
            size = math.hypot(size, trial[s]) if s else abs(trial[s])
            coupling[s, c] = spring_slope * slip + root_slope * reduced_shear
            sliding[s, c] = 0.0
        k = EXPONENT * math.sqrt(max(overlaps[c], 0.0))
        stiffness[c] = k
        shear[c] = spring
        limit = mu * (new_root * new_root * new_root)
        if size > limit:  # never where mu is infinite, as in set_shears
            limit_slope = mu * k if is_coupled else 0.0
            _set_sliding(c, trial, size, limit, limit_slope, shear, coupling, sliding)


@compiled
def _set_sliding(
    c: int,
    trial: Array,
    size: float,
    limit: float,
    limit_slope: float,
    shear: Array,
    coupling: Array,
    sliding: Array,
) -> None:
    """Replace the derivatives of contact ``c`` in ``shear``, ``coupling`` and ``sliding`` of
    :class:`SlipTangent`, those of a contact that sticks, by those of a contact that slides.

    Its force without sliding is ``trial`` (n_s,), whose length ``size`` is above the ``limit``.
    ``limit_slope`` is the derivative of the limit with respect to the overlap.
    """
    kept_share = limit / size
    shear[c] *= kept_share
    along = 0.0
    for s in range(len(trial)):
        sliding[s, c] = trial[s] / size
        along += sliding[s, c] * coupling[s, c]
    for s in range(len(trial)):
        across = coupling[s, c] - along * sliding[s, c]
        coupling[s, c] = kept_share * across + limit_slope * sliding[s, c]


@compiled
def sum_losses(eta: float, mu: float, step: Step) -> tuple[float, float]:
    """Return two energies that all contacts together lose in a ``step``, along which overlaps and
    slips change in proportion: by sliding, and by the law of the tangential force.
    """
    old_overlaps, old_slips, old_shears, overlaps, slips = step
    lost_by_sliding = 0.0
    lost_by_law = 0.0
    for c in range(len(overlaps)):
        old_root = math.sqrt(max(old_overlaps[c], 0.0))
        new_root = math.sqrt(max(overlaps[c], 0.0))
        if old_root == 0.0 and new_root == 0.0:  # open before the step and at its end
            continue
        # a contact that closes or opens in the step: only the part of the step in which it is
        # closed counts
        closed_share = 1.0
        if old_root == 0.0 or new_root == 0.0:
            closed_share = (new_root * new_root - old_root * old_root) / (
                overlaps[c] - old_overlaps[c]
            )
        reduced_square = 0.0
        product = 0.0
        slip_square = 0.0
        for s in range(len(slips)):
            # T/r before the step
            reduced_shear = old_shears[s, c] / old_root if old_root > 0.0 else 0.0
            slip = closed_share * (slips[s, c] - old_slips[s, c])
            reduced_square += reduced_shear * reduced_shear
            product += reduced_shear * slip
            slip_square += slip * slip
        if new_root > old_root:
            losses = _find_rising_losses(
                old_root, new_root, reduced_square, product, slip_square, eta, mu
            )
        else:
            losses = _find_falling_losses(
                old_root, new_root, reduced_square, product, slip_square, eta, mu
            )
        lost_by_sliding += losses[0]
        lost_by_law += losses[1]
    return lost_by_sliding, lost_by_law


@compiled
def _find_rising_losses(
    old_root: float,
    new_root: float,
    reduced_square: float,
    product: float,
    slip_square: float,
    eta: float,
    mu: float,
) -> tuple[float, float]:
    """Return the energies that one contact loses by sliding and by the law while the root of its
    overlap rises from ``old_root`` to ``new_root``: the integrals of
    :mod:`granphon.contacts.friction`.

    ``reduced_square`` is the square of T/r before the step, ``slip_square`` that of the slip in the
    step, and ``product`` is the scalar product of T/r and the slip. While the contact sticks, T is
    a + s b, where s is the share of the change of f; it slides from where |T| comes to mu f. The
    polynomials in roots are the integrals of powers of r after division by common factors, so that
    steps with hardly any change of h lose no digits.
    """
    mean = (
        eta
        * (old_root * old_root + old_root * new_root + new_root * new_root)
        / max(old_root + new_root, _LEAST_DIVISOR)
    )
    cube = old_root * old_root * old_root
    rise = new_root * new_root * new_root - cube
    a_square = old_root * old_root * reduced_square
    a_dot_b = old_root * mean * product
    b_square = mean * mean * slip_square
    share, excess = _find_slide_start(a_square, a_dot_b, b_square, mu, cube, rise)
    # the root of h where the contact begins to slide; at the end if it only sticks
    slide_root = new_root
    if share != 1.0:
        slide_root = min(max(float(np.cbrt(cube + share * rise)), old_root), new_root)
    square_sum = max(
        old_root * old_root + old_root * slide_root + slide_root * slide_root, _LEAST_DIVISOR
    )
    # the loss by the law while the contact sticks
    by_law = old_root * reduced_square
    by_law += (slide_root + 2.0 * old_root) * share * a_dot_b / square_sum
    powers = (slide_root + 3.0 * old_root) * slide_root + 6.0 * old_root * old_root
    powers = powers * slide_root + 5.0 * cube
    by_law += powers * share * share * b_square / (5.0 * square_sum * square_sum)
    by_law *= (slide_root - old_root) / (3.0 * eta * max(slide_root, _LEAST_DIVISOR))
    if mu == math.inf:
        return 0.0, by_law
    fourth_sum = _sum_powers(slide_root, new_root)
    square_sum = max(
        slide_root * slide_root + slide_root * new_root + new_root * new_root, _LEAST_DIVISOR
    )
    by_sliding = 0.4 * (mu / eta) * excess * fourth_sum / square_sum
    by_law += mu * mu / (15.0 * eta) * (new_root - slide_root) * fourth_sum
    return by_sliding, by_law


@compiled
def _find_falling_losses(
    old_root: float,
    new_root: float,
    reduced_square: float,
    product: float,
    slip_square: float,
    eta: float,
    mu: float,
) -> tuple[float, float]:
    """Return the energies that one contact loses by sliding and by the law while the root of its
    overlap falls from ``old_root`` to ``new_root``, or stays; arguments are those of
    :func:`_find_rising_losses`.

    The elastic slip T/(eta k) is a + s b, where s is the share of the change of h: the contact
    sticks until the magnitude of the elastic slip comes to mu f/(eta k) = 2 mu h/(3 eta), and
    slides from there.
    """
    stiffness_ratio = EXPONENT * eta  # eta k over r
    old_overlap = old_root * old_root
    overlap_change = new_root * new_root - old_overlap
    a_square = reduced_square / stiffness_ratio / stiffness_ratio
    a_dot_b = product / stiffness_ratio
    share, excess = _find_slide_start(
        a_square, a_dot_b, slip_square, mu / stiffness_ratio, old_overlap, overlap_change
    )
    # the root of h where the contact begins to slide; at the end if it only sticks
    slide_root = new_root
    if share != 1.0:
        slide_overlap = max(old_overlap + share * overlap_change, 0.0)
        slide_root = min(max(math.sqrt(slide_overlap), new_root), old_root)
    root_sum = max(old_root + slide_root, _LEAST_DIVISOR)
    # the loss by the law while the contact sticks
    by_law = a_square + 2.0 * (2.0 * old_root + slide_root) * share * a_dot_b / (3.0 * root_sum)
    powers = 8.0 * old_overlap + 9.0 * old_root * slide_root + 3.0 * slide_root * slide_root
    by_law += powers * share * share * slip_square / (15.0 * root_sum * root_sum)
    by_law *= 0.75 * eta * (old_root - slide_root)
    if mu == math.inf:
        return 0.0, by_law
    fourth_sum = _sum_powers(slide_root, new_root)
    by_sliding = 0.4 * mu * excess * fourth_sum / max(slide_root + new_root, _LEAST_DIVISOR)
    by_law += mu * mu / (15.0 * eta) * (slide_root - new_root) * fourth_sum
    return by_sliding, by_law


@compiled
def _find_slide_start(
    a_square: float, a_dot_b: float, b_square: float, mu: float, size: float, rise: float
) -> tuple[float, float]:
    """Return the share s of a step at which ``|a + s b|`` comes to the limit mu (size + s rise),
    and by how much ``|a + b|`` exceeds the limit at the end of the step.

    The two numbers are 1 and 0 if the limit is not exceeded at the end, or if mu is infinite.
    ``a_square``, ``a_dot_b`` and ``b_square`` are the scalar products of the vectors a and b.
    """
    if mu == math.inf:
        return 1.0, 0.0
    limit = mu * size
    limit_rise = mu * rise
    excess = math.sqrt(max(a_square + 2.0 * a_dot_b + b_square, 0.0)) - (limit + limit_rise)
    if not excess > 0.0:
        return 1.0, 0.0
    # the root, not below zero, of quadratic s^2 + 2 half_linear s + constant = 0; of its two forms
    # the one that subtracts no two numbers that are nearly equal
    quadratic = b_square - limit_rise * limit_rise
    half_linear = a_dot_b - limit * limit_rise
    # a vector a that is longer than the limit, as by rounding, counts as one at the limit
    constant = min(a_square - limit * limit, 0.0)
    root = math.sqrt(max(half_linear * half_linear - quadratic * constant, 0.0))
    if half_linear <= 0.0:
        share = (root - half_linear) / max(quadratic, _LEAST_DIVISOR)
    else:
        share = -constant / max(half_linear + root, _LEAST_DIVISOR)
    return min(share, 1.0), excess


@compiled
def _sum_powers(a: float, b: float) -> float:
    """Return (a^5 - b^5)/(a - b), which is 5 a^4 where b is a."""
    return (((a + b) * a + b * b) * a + b * b * b) * a + b * b * b * b
