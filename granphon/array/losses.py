"""Energies that contacts lose in a step of :mod:`granphon.array.friction`, whose units they have.

In a step the overlap h and the slip s change together along a straight line. While h rises, T is linear in f until it comes
to Coulomb's limit mu f; while h falls, the elastic slip T/(eta k) is linear in h until it comes to 2 mu h/(3 eta). So both
losses are integrals of powers of r = h^(1/2) over the parts of the line before and after that:

    by sliding  int mu f |ds|        by the law  int T^2 |dk|/(2 eta k^2)

They are exact where slips have one component. Where T turns as it slides, its direction at the end stands for those before.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
#: number that stands for none where it divides
_TINY = 1e-150


def lose_rising(old: Array, new: Array, bent: Array, slip: Array, eta: float, mu: float) -> tuple[Array, Array]:
    """Return (n,) energies lost by sliding and by the law while h rises from ``old``^2 to ``new``^2.

    ``bent`` (n_s, n) is T/r at first, and ``slip`` (n_s, n) the slip since then.
    """
    first, part = old * bent, (old * old + old * new + new * new) / np.maximum(old + new, _TINY)
    more = eta * part * slip
    cube = old**3
    share, over, mu = _meet(first, more, mu, cube, new**3 - cube)
    turn = np.clip(np.cbrt(cube + share * (new**3 - cube)), old, new)  # where it begins to slide
    more *= share
    three = np.maximum(old * old + old * turn + turn * turn, _TINY)
    stuck = old * _dot(bent, bent) + (turn + 2.0 * old) * _dot(first, more) / three
    stuck += (((turn + 3.0 * old) * turn + 6.0 * old * old) * turn + 5.0 * cube) * _dot(more, more) / (5.0 * three * three)
    stuck *= (turn - old) / (3.0 * eta * np.maximum(turn, _TINY))
    five, three = _sum_powers(turn, new), turn * turn + turn * new + new * new
    slid = 0.4 * (mu / eta) * over * five / np.maximum(three, _TINY)
    return slid, stuck + (mu * mu / (15.0 * eta)) * (new - turn) * five


def lose_falling(old: Array, new: Array, bent: Array, slip: Array, eta: float, mu: float) -> tuple[Array, Array]:
    """Return (n,) energies lost by sliding and by the law while h falls; see :func:`lose_rising`."""
    first, to_slip = bent / (1.5 * eta), 1.5 * eta
    share, over, most = _meet(first, slip, mu / to_slip, old * old, new * new - old * old)
    mu = to_slip * most
    turn = np.clip(np.sqrt(np.maximum(old * old + share * (new * new - old * old), 0.0)), new, old)
    more, both = share * slip, np.maximum(old + turn, _TINY)
    stuck = _dot(first, first) + 2.0 * (2.0 * old + turn) * _dot(first, more) / (3.0 * both)
    stuck += (8.0 * old * old + 9.0 * old * turn + 3.0 * turn * turn) * _dot(more, more) / (15.0 * both * both)
    five = _sum_powers(turn, new)
    slid = 0.4 * mu * over * five / np.maximum(turn + new, _TINY)
    return slid, 0.75 * eta * (old - turn) * stuck + (mu * mu / (15.0 * eta)) * (turn - new) * five


def _meet(first: Array, more: Array, mu: float, size: Array, rise: Array) -> tuple[Array, Array, float]:
    """Return the part of the way at which ``|first + more|`` comes to mu (size + rise), and what is then above it.

    The third is mu, or zero if that is infinite: then nothing is above it.
    """
    if mu == math.inf:
        return np.ones_like(size), np.zeros_like(size), 0.0
    limit, rise = mu * size, mu * rise
    over = np.maximum(np.sqrt(_dot(first + more, first + more)) - (limit + rise), 0.0)
    square, half = _dot(more, more) - rise * rise, _dot(first, more) - limit * rise
    left = np.minimum(_dot(first, first) - limit * limit, 0.0)
    root = np.sqrt(np.maximum(half * half - square * left, 0.0))
    late = half <= 0.0  # T leaves the limit at first
    share = np.where(late, root - half, -left) / np.maximum(np.where(late, square, half + root), _TINY)
    return np.where(over > 0.0, np.minimum(share, 1.0), 1.0), over, mu


def _sum_powers(a: Array, b: Array) -> Array:
    """Return (a^5 - b^5)/(a - b)."""
    return np.asarray((((a + b) * a + b * b) * a + b * b * b) * a + b * b * b * b)


def _dot(a: Array, b: Array) -> Array:
    return np.asarray(np.einsum("ic,ic->c", a, b))
