"""Loops over the contacts of the law of friction, compiled; the law, and the formulas of a step,
are those of :mod:`granphon.contacts.friction`.

Arguments that all loops have are the law's numbers ``eta`` and ``mu``; the state before the step,
``old_overlaps`` (n_c,), ``old_slips`` and tangential forces ``old_shears`` (n_s, n_c); and the
``overlaps`` (n_c,) and ``slips`` (n_s, n_c) at its end; n_s is 1 in a plane, 2 in space. The root
of an overlap h is r = h_+^(1/2); the stiffness is k = (3/2) r, and the normal force r^3.
"""

from __future__ import annotations

import math

import numpy as np

from granphon.balls.hertz import EXPONENT
from granphon.base.arrays import Array
from granphon.base.compiled import compiled

#: divisor in place of a root, or a product of two, that is zero: its square is above zero too
_TINY = 1e-150


@compiled
def _find_spring(eta: float, old: float, new: float, change: float) -> float:
    """Return the stiffness against slip in a step in which the root r of the overlap h goes from
    ``old`` to ``new``, and h changes by ``change``.

    Where h rises, the stiffness is eta df/dh between the ends, eta (new^3 - old^3)/(new^2 - old^2);
    where h falls, eta k at the end. Where a contact closes in the step, ``change`` is that of the
    whole step, below touch included, so that only the slip of the closed part makes a force.
    """
    if old == 0.0 and new > 0.0:
        return eta * new * new * new / change
    # the quotient of powers, divided out; with both roots equal to the end it is (3/2) r
    least = min(old, new)
    total = least + new
    return eta * (total - least * new / max(total, _TINY))


@compiled
def set_springs(eta: float, old_overlaps: Array, overlaps: Array, springs: Array) -> None:
    """Set ``springs`` (n_c,) to the stiffnesses of contacts against slip in a step from
    ``old_overlaps`` to ``overlaps`` (n_c,).
    """
    for c in range(len(overlaps)):
        old = math.sqrt(max(old_overlaps[c], 0.0))
        new = math.sqrt(max(overlaps[c], 0.0))
        springs[c] = _find_spring(eta, old, new, overlaps[c] - old_overlaps[c])


@compiled
def set_shears(
    eta: float,
    mu: float,
    old_overlaps: Array,
    old_slips: Array,
    old_shears: Array,
    overlaps: Array,
    slips: Array,
    shears: Array,
) -> None:
    """Set ``shears`` (n_s, n_c) to the tangential forces at the end of a step.

    A force beyond Coulomb's limit is shortened to the limit, in its own direction. The ``overlaps``
    (n_c,) are those from which the stiffness against slip and the limit are found.
    """
    for c in range(len(overlaps)):
        old = math.sqrt(max(old_overlaps[c], 0.0))
        new = math.sqrt(max(overlaps[c], 0.0))
        least = min(old, new)  # where h falls, T is first rescaled by new/old
        spring = _find_spring(eta, old, new, overlaps[c] - old_overlaps[c])
        size = 0.0
        for s in range(len(slips)):
            shear = spring * (slips[s, c] - old_slips[s, c])
            if old > 0.0:
                shear += least * (old_shears[s, c] / old)
            shears[s, c] = shear
            size = math.hypot(size, shear) if s else abs(shear)
        limit = mu * (new * new * new)
        if size > limit:
            for s in range(len(slips)):
                shears[s, c] *= limit / size


@compiled
def set_tangent(
    eta: float,
    mu: float,
    old_overlaps: Array,
    old_slips: Array,
    old_shears: Array,
    overlaps: Array,
    held: Array,
    couples: bool,
    slips: Array,
    stiffness: Array,
    shear: Array,
    coupling: Array,
    sliding: Array,
) -> None:
    """Set ``stiffness``, ``shear`` (n_c,), ``coupling`` and ``sliding`` (n_s, n_c) to the
    derivatives of the forces of contacts at the end of a step: those of
    :class:`~granphon.contacts.friction.Tangent`.

    ``held`` (n_c,) are the overlaps from which the stiffness against slip and Coulomb's limit are
    found. If they are not ``overlaps`` but a guess that does not change, tangential forces do not
    depend on ``overlaps``: then ``couples`` must be false, and ``coupling`` is zero.
    """
    n_s = len(slips)
    trial = np.zeros(n_s)
    for c in range(len(overlaps)):
        old = math.sqrt(max(old_overlaps[c], 0.0))
        new = math.sqrt(max(held[c], 0.0))
        least = min(old, new)
        width = held[c] - old_overlaps[c]
        spring = _find_spring(eta, old, new, width)
        k = EXPONENT * math.sqrt(max(overlaps[c], 0.0))
        stiffness[c] = k
        over = 1.0 / max(least + new, _TINY) if new > 0.0 else 0.0
        # slope: derivative of `spring` by the overlap at the end, where h rises
        if old == 0.0 and new > 0.0:
            slope = eta * (EXPONENT * new - new * new * new / width) / width
        else:
            slope = 0.5 * eta * (least * over + 1.0) * over
        size = 0.0
        for s in range(n_s):
            change = slips[s, c] - old_slips[s, c]
            bent = old_shears[s, c] / old if old > 0.0 else 0.0  # T/r before the step
            trial[s] = spring * change + least * bent
            size = math.hypot(size, trial[s]) if s else abs(trial[s])
            coupled = 0.0
            if couples:
                coupled = slope * change
                # where h falls, both roots in `spring` are that at the end: its slope is twice as
                # large; and the old T falls in proportion to the root
                if new < old:
                    coupled += coupled + over * bent
            coupling[s, c] = coupled
            sliding[s, c] = 0.0
        limit = mu * (new * new * new)
        if not size > limit:
            shear[c] = spring
            continue
        share = limit / size
        shear[c] = share * spring
        along = 0.0
        for s in range(n_s):
            sliding[s, c] = trial[s] / size
            along += sliding[s, c] * coupling[s, c]
        if couples:
            for s in range(n_s):
                across = coupling[s, c] - along * sliding[s, c]
                coupling[s, c] = share * across + mu * k * sliding[s, c]


@compiled
def sum_losses(
    eta: float,
    mu: float,
    old_overlaps: Array,
    old_slips: Array,
    old_shears: Array,
    overlaps: Array,
    slips: Array,
) -> tuple[float, float]:
    """Return the two energies that all contacts together lose along the straight line of a step:
    by sliding, and by the law of the tangential force.
    """
    lost_by_sliding = 0.0
    lost_by_law = 0.0
    for c in range(len(overlaps)):
        old = math.sqrt(max(old_overlaps[c], 0.0))
        new = math.sqrt(max(overlaps[c], 0.0))
        if new <= old and old == 0.0:
            continue
        # a contact that closes or opens in the step: only the part of the step in which it is
        # closed counts
        closed_share = 1.0
        if old == 0.0 or new == 0.0:
            closed_share = (new * new - old * old) / (overlaps[c] - old_overlaps[c])
        bent_square = 0.0
        product = 0.0
        slip_square = 0.0
        for s in range(len(slips)):
            # T/r before the step
            bent = old_shears[s, c] / old if old > 0.0 else 0.0
            slip = closed_share * (slips[s, c] - old_slips[s, c])
            bent_square += bent * bent
            product += bent * slip
            slip_square += slip * slip
        if new > old:
            losses = _lose_rising(old, new, bent_square, product, slip_square, eta, mu)
        else:
            losses = _lose_falling(old, new, bent_square, product, slip_square, eta, mu)
        lost_by_sliding += losses[0]
        lost_by_law += losses[1]
    return lost_by_sliding, lost_by_law


@compiled
def _lose_rising(
    old: float,
    new: float,
    bent_square: float,
    product: float,
    slip_square: float,
    eta: float,
    mu: float,
) -> tuple[float, float]:
    """Return the energies that one contact loses by sliding and by the law while h rises from
    ``old``^2 to ``new``^2: the integrals over the step of :mod:`granphon.contacts.friction`.

    ``bent_square`` is the square of T/r before the step, ``slip_square`` that of the slip in the
    step, and ``product`` their scalar product. With f as the variable T is a + s b, linear in the
    share s of the change of f: it sticks until its magnitude comes to mu f, and slides from there.
    The polynomials in roots are what the integrals of powers of r become once common factors are
    divided out, so that steps without a change of h lose no digits.
    """
    mean = eta * (old * old + old * new + new * new) / max(old + new, _TINY)
    cube = old * old * old
    rise = new * new * new - cube
    a_square = old * old * bent_square
    a_dot_b = old * mean * product
    b_square = mean * mean * slip_square
    share, excess = _meet(a_square, a_dot_b, b_square, mu, cube, rise)
    # the root of h where the contact begins to slide
    turn = new if share == 1.0 else min(max(float(np.cbrt(cube + share * rise)), old), new)
    square_sum = max(old * old + old * turn + turn * turn, _TINY)
    stuck = old * bent_square + (turn + 2.0 * old) * share * a_dot_b / square_sum
    powers = ((turn + 3.0 * old) * turn + 6.0 * old * old) * turn + 5.0 * cube
    stuck += powers * share * share * b_square / (5.0 * square_sum * square_sum)
    stuck *= (turn - old) / (3.0 * eta * max(turn, _TINY))
    if mu == math.inf:
        return 0.0, stuck
    fourth_sum = _sum_powers(turn, new)
    square_sum = max(turn * turn + turn * new + new * new, _TINY)
    slid = 0.4 * (mu / eta) * excess * fourth_sum / square_sum
    return slid, stuck + mu * mu / (15.0 * eta) * (new - turn) * fourth_sum


@compiled
def _lose_falling(
    old: float,
    new: float,
    bent_square: float,
    product: float,
    slip_square: float,
    eta: float,
    mu: float,
) -> tuple[float, float]:
    """Return the energies that one contact loses by sliding and by the law while h falls from
    ``old``^2 to ``new``^2; arguments are those of :func:`_lose_rising`.

    With h as the variable the elastic slip T/(eta k) is a + s b, linear in the share s of the
    change of h, until its magnitude comes to mu f/(eta k) = 2 mu h/(3 eta).
    """
    to_slip = EXPONENT * eta
    fall = new * new - old * old
    a_square = bent_square / to_slip / to_slip
    a_dot_b = product / to_slip
    share, excess = _meet(a_square, a_dot_b, slip_square, mu / to_slip, old * old, fall)
    turn = new
    if share != 1.0:
        turn = min(max(math.sqrt(max(old * old + share * fall, 0.0)), new), old)
    width = max(old + turn, _TINY)
    stuck = a_square + 2.0 * (2.0 * old + turn) * share * a_dot_b / (3.0 * width)
    powers = 8.0 * old * old + 9.0 * old * turn + 3.0 * turn * turn
    stuck += powers * share * share * slip_square / (15.0 * width * width)
    stuck *= 0.75 * eta * (old - turn)
    if mu == math.inf:
        return 0.0, stuck
    fourth_sum = _sum_powers(turn, new)
    slid = 0.4 * mu * excess * fourth_sum / max(turn + new, _TINY)
    return slid, stuck + mu * mu / (15.0 * eta) * (turn - new) * fourth_sum


@compiled
def _meet(
    a_square: float, a_dot_b: float, b_square: float, mu: float, size: float, rise: float
) -> tuple[float, float]:
    """Return the share s of a step at which ``|a + s b|`` comes to the limit mu (size + s rise),
    and the excess of ``|a + b|`` over the limit at the end of the step.

    Where the limit is not passed at the end, or mu is infinite, they are 1 and 0. ``a_square``,
    ``a_dot_b`` and ``b_square`` are the scalar products of the vectors a and b.
    """
    if mu == math.inf:
        return 1.0, 0.0
    limit = mu * size
    rise = mu * rise
    excess = math.sqrt(max(a_square + 2.0 * a_dot_b + b_square, 0.0)) - (limit + rise)
    if not excess > 0.0:
        return 1.0, 0.0
    # the root of square s^2 + 2 half s + constant = 0, without a difference of near numbers
    square = b_square - rise * rise
    half = a_dot_b - limit * rise
    constant = min(a_square - limit * limit, 0.0)
    root = math.sqrt(max(half * half - square * constant, 0.0))
    if half <= 0.0:  # a + s b first moves away from the limit
        share = (root - half) / max(square, _TINY)
    else:
        share = -constant / max(half + root, _TINY)
    return min(share, 1.0), excess


@compiled
def _sum_powers(a: float, b: float) -> float:
    """Return (a^5 - b^5)/(a - b)."""
    return (((a + b) * a + b * b) * a + b * b * b) * a + b * b * b * b
