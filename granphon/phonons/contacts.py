"""Pairs of balls that are near each other, in a tree of the balls and of their periodic images.

The list of them is kept from call to call while the balls move little. Places are (N, m), where m is the number of
coordinates of a ball that count; all lengths are in mean diameters.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from granphon.balls.contact_table import find_pairs
from granphon.base.errors import InputError

Array = NDArray[np.float64]
#: distance, in diameters, by which a list reaches beyond the cutoff. A list serves until a ball has moved by half of it. It
#: is small enough that a list does not reach the second neighbours of the lattices.
_SKIN = 0.3
#: length, area or volume, in diameters, below which a cell counts as one of none
_FLAT = 1e-12


class Pairs(NamedTuple):
    """Pairs of balls, each once: indices ``i`` and ``j`` (n,), vectors (n, m) from i to j, in diameters.

    ``shift`` (n, m) is the number of whole cells by which the image of ball j is shifted. m is 1, 2 or 3, the number of
    coordinates of a ball.
    """

    i: NDArray[np.intp]
    j: NDArray[np.intp]
    shift: NDArray[np.intp]
    vector: Array


def keep_rows(kept: NDArray[np.bool_], *arrays: NDArray[Any]) -> tuple[NDArray[Any], ...]:
    """Return the rows of each array that are ``kept``; the arrays themselves if that is all of them, as it mostly is."""
    return arrays if kept.all() else tuple(values[kept] for values in arrays)


class PairList:
    """A search for pairs that keeps its list. The list reaches beyond the cutoff, and serves until it might miss a pair."""

    def __init__(self) -> None:
        self._kept: tuple[Pairs, Array, Array, tuple[bool, ...], float] | None = None

    def near(self, positions: Array, cell: Array, periodic: tuple[bool, ...], cutoff: float) -> Pairs:
        """Find the pairs nearer than ``cutoff``, in the order of (i, j, shift); all lengths are in diameters.

        ``positions`` are (N, m), ``cell`` is (m, m), with a row for each axis, periodic or not. A kept list gives the same
        numbers to the last digit as a new one. Raises :class:`~granphon.base.errors.InputError` for a periodic axis whose
        cell vector has no length, and for periods that are not independent of each other.
        """
        serves = False
        if self._kept is not None and positions.shape == self._kept[1].shape and periodic == self._kept[3]:
            _, old, last, _, reach = self._kept
            # a change of the cell maps every vector to vector F. A pair that was beyond the reach is then at least s times
            # the reach apart, where s is the smallest singular value of F, less what its two balls have moved besides
            stretch = 1.0
            if not np.array_equal(cell, last):
                change = np.linalg.solve(last, cell) if abs(np.linalg.det(last)) >= _FLAT else np.zeros_like(cell)
                stretch, old = float(np.linalg.svd(change, compute_uv=False)[-1]), old @ change
            moved = positions - old
            farthest = float(np.sqrt(np.max(np.einsum("na,na->n", moved, moved), initial=0.0)))
            serves = stretch * reach - 2.0 * farthest >= cutoff
        if self._kept is None or not serves:
            reach, axes = cutoff + _SKIN, np.flatnonzero(periodic)
            periods = cell[axes]
            if not np.all(np.any(periods, axis=1)):
                raise InputError("the balls are periodic along a cell vector of zero length", "The period is not known")
            if len(axes) and np.prod(np.linalg.svd(periods, compute_uv=False)) < _FLAT:
                what = f"the balls are periodic in a cell without {('a length', 'an area', 'a volume')[len(axes) - 1]}"
                raise InputError(what, f"Its vectors are {'parallel' if len(axes) == 2 else 'not independent'}")
            i, j, steps, vector = find_pairs(positions, periods, reach)
            shift = np.zeros((len(i), len(cell)), np.intp)
            shift[:, axes] = steps
            self._kept = Pairs(i, j, shift, vector), positions.copy(), cell.copy(), periodic, reach
        i, j, shift, _ = self._kept[0]
        vector = positions[j] - positions[i] + shift @ cell
        near = np.einsum("ca,ca->c", vector, vector) < cutoff**2
        return Pairs(*keep_rows(near, i, j, shift, vector))
