"""Pairs of balls that are near each other, in a list that is kept from call to call while the balls move little."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from granphon.balls.contact_table import select_once
from granphon.base.errors import InputError, message

Array = NDArray[np.float64]
#: distance, in diameters, by which a list reaches beyond the cutoff. A list serves until a ball has moved by half of it. It
#: is small enough that a list does not reach the second neighbours of the lattices.
_SKIN = 0.3
#: length, area or volume, in diameters, below which a cell counts as one of none
_FLAT = 1e-12
#: what a periodic cell of one, two or three periods lacks whose vectors are not independent
_EXTENTS = ("length", "area", "volume")


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
        if self._kept is None or not self._serves(positions, cell, periodic, cutoff):
            reach = cutoff + _SKIN
            found = _search(positions, cell, periodic, reach)
            self._kept = found, positions.copy(), cell.copy(), periodic, reach
        i, j, shift, _ = self._kept[0]
        vector = positions[j] - positions[i] + shift @ cell
        near = np.einsum("ca,ca->c", vector, vector) < cutoff**2
        return Pairs(*keep_rows(near, i, j, shift, vector))

    def _serves(self, positions: Array, cell: Array, periodic: tuple[bool, ...], cutoff: float) -> bool:
        """Whether the kept list still holds every pair nearer than the cutoff.

        A change of the cell maps every vector to vector F. A pair that was beyond the reach is then at least s times the
        reach apart, where s is the smallest singular value of F, less what its two balls have moved besides.
        """
        assert self._kept is not None
        _, old, last, axes, reach = self._kept
        if positions.shape != old.shape or periodic != axes:
            return False
        stretch = 1.0
        if not np.array_equal(cell, last):
            if abs(np.linalg.det(last)) < _FLAT:
                return False
            change = np.linalg.solve(last, cell)
            stretch, old = float(np.linalg.svd(change, compute_uv=False)[-1]), old @ change
        moved = positions - old
        farthest = float(np.sqrt(np.max(np.einsum("na,na->n", moved, moved), initial=0.0)))
        return stretch * reach - 2.0 * farthest >= cutoff


def _search(positions: Array, cell: Array, periodic: tuple[bool, ...], cutoff: float) -> Pairs:
    """Find the pairs not farther apart than ``cutoff``, in a tree of the balls and of their images near the cell's faces."""
    # imported here because it loads much of scipy, which one cell of a lattice does not need
    from scipy.spatial import cKDTree

    axes, (n, _) = np.flatnonzero(periodic), positions.shape
    periods = cell[axes]
    if not np.all(np.any(periods, axis=1)):
        raise InputError(message("the balls are periodic along a cell vector of zero length", "The period is not known"))
    if len(axes) and np.prod(np.linalg.svd(periods, compute_uv=False)) < _FLAT:
        raise InputError(
            message(
                f"the balls are periodic in a cell without {'an' if len(axes) == 2 else 'a'} {_EXTENTS[len(axes) - 1]}",
                "Its vectors are parallel" if len(axes) == 2 else "Its vectors are not independent",
            )
        )
    # fractions of the periods: balls are moved into the cell, then repeated as far as a pair can reach beyond its faces
    across = np.linalg.pinv(periods)
    place = positions @ across
    home = np.floor(place).astype(np.intp)
    ball, step = np.arange(n), np.zeros((n, len(axes)), np.intp)
    place -= home
    for axis, margin in enumerate(cutoff * np.linalg.norm(across, axis=0) * (1.0 + 1e-9)):
        reach = int(margin) + 1
        kept = [(ball, step)]  # the balls themselves come first
        for steps in (*range(-reach, 0), *range(1, reach + 1)):
            away = place[ball, axis] + steps
            near = (away >= -margin) & (away <= 1.0 + margin)
            there = step[near]
            there[:, axis] = steps
            kept.append((ball[near], there))
        ball, step = (np.concatenate(parts) for parts in zip(*kept, strict=True))
    points = positions[ball] + (step - home[ball]) @ periods
    one, other = cKDTree(points).query_pairs(cutoff, output_type="ndarray").T
    own = one < n  # the first of a pair is the lower one, and a ball of the cell comes before all images
    one, other = one[own], other[own]
    i, j, shift = ball[one], ball[other], np.zeros((len(one), len(cell)), np.intp)
    shift[:, axes] = step[other] - home[ball[other]] + home[ball[one]]
    once = (other < n) | select_once(i, j, shift)
    i, j, shift = i[once], j[once], shift[once]
    order = np.lexsort((*shift.T[::-1], j, i))
    i, j, shift = i[order], j[order], shift[order]
    return Pairs(i, j, shift, positions[j] - positions[i] + shift @ cell)
