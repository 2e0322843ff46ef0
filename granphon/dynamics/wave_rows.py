"""Rows of C(q) as functions of the half angle that a wave turns through along a contact."""

from __future__ import annotations

import math
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
#: half angle below which sin h - h cos h is summed as a series
_SERIES = 1.0
#: coefficients of (sin h - h cos h)/h^3 in powers of h^2; the next one is below rounding
_BEND = [(-1.0) ** k * (2 * k + 2) / math.factorial(2 * k + 3) for k in range(9)]


class WaveRows(NamedTuple):
    """Rows of C(q): ``odd`` times the sine plus ``even`` times the cosine of the half angle q.(r_j - r_i)/2 of a contact.

    ``odd`` and ``even`` are (kinds, n_c, n); ``half`` (n_c, p) holds (r_j - r_i)/2 along the periods.
    """

    odd: NDArray[Any]
    even: NDArray[Any]
    half: Array

    def compute_rows(self, wavevectors: Array, derivative: bool = False) -> NDArray[Any]:
        """Return (n_q, kinds * n_c, n) rows, or their derivatives with respect to the half angle."""
        angle = wavevectors @ self.half.T
        sine, cosine = np.sin(angle), np.cos(angle)
        if derivative:
            sine, cosine = cosine, -sine
        # view complex numbers as pairs of reals: the factors are real, and a real product is cheaper
        rows = sine[:, None, :, None] * self.odd.view(np.float64)
        rows += cosine[:, None, :, None] * self.even.view(np.float64)
        kinds, contacts, columns = self.odd.shape
        return rows.view(self.odd.dtype).reshape(len(angle), kinds * contacts, columns)

    def repeat_half_vectors(self) -> Array:
        """Return (kinds * n_c, p) gradients of each row's half angle with respect to q."""
        return np.tile(self.half, (len(self.odd), 1))

    def find_effects(self) -> NDArray[np.bool_]:
        """Return (kinds, n_c, n), whether each motion takes part in each row at any wave vector."""
        return np.asarray((self.odd != 0.0) | (self.even != 0.0))

    def select(self, rows: NDArray[np.bool_], columns: NDArray[np.intp]) -> WaveRows:
        """Return the ``rows`` (kinds, n_c) that are marked, of the motions ``columns``."""
        if np.all(rows) and len(columns) == self.odd.shape[2]:
            return self
        kinds, contacts = np.any(rows, axis=1), np.any(rows, axis=0)
        if np.all(rows[np.ix_(kinds, contacts)]):
            place: Any = np.ix_(kinds, contacts, columns)
            return WaveRows(self.odd[place], self.even[place], self.half[contacts])
        odd, even = (part[rows][None, :, columns] for part in (self.odd, self.even))
        return WaveRows(odd, even, self.half[np.nonzero(rows)[1]])


def bend(angle: Array) -> Array:
    """Return sin h - h cos h, to rounding of itself: h^3/3 at small angles."""
    square = np.square(angle)
    series = np.zeros_like(angle)
    for coefficient in reversed(_BEND):
        series = series * square + coefficient
    return np.asarray(np.where(np.abs(angle) < _SERIES, angle * square * series, np.sin(angle) - angle * np.cos(angle)))


def bend_slope(angle: Array) -> Array:
    """Return h sin h, the derivative of :func:`bend`."""
    return np.asarray(angle * np.sin(angle))
