"""Pairs of balls that are near each other, in a list that is kept from call to call while the balls move little."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from granphon.balls.contact_table import select_once
from granphon.base.errors import InputError, message

__all__ = ["PairList", "Pairs"]

Array = NDArray[np.float64]
#: distance, in diameters, by which a list reaches beyond the cutoff. A list serves until a ball has moved by half of it. It
#: is small enough that a list does not reach the second neighbours of the lattices.
_SKIN = 0.3
#: area, in diameters squared, below which a cell counts as one of no area
_FLAT = 1e-12


class Pairs(NamedTuple):
    """Pairs of balls, each once: indices ``i`` and ``j`` (n,), vectors (n, 2) from i to j, in diameters.

    ``shift`` (n, 2) is the number of whole cells by which the image of ball j is shifted.
    """

    i: NDArray[np.intp]
    j: NDArray[np.intp]
    shift: NDArray[np.intp]
    vector: Array


class PairList:
    """A search for pairs that keeps its list. The list reaches beyond the cutoff, and serves until it might miss a pair."""

    def __init__(self) -> None:
        self._kept: tuple[Pairs, Array, Array, tuple[bool, bool], float] | None = None

    def near(self, positions: Array, cell: Array, periodic: tuple[bool, bool], cutoff: float) -> Pairs:
        """Find the pairs nearer than ``cutoff``, in the order of (i, j, shift); all lengths are in diameters.

        ``positions`` are (N, 2), ``cell`` is (2, 2). A kept list gives the same numbers to the last digit as a new one.
        Raises :class:`~granphon.base.errors.InputError` for a periodic axis whose cell vector has no length, and for a
        periodic cell of no area.
        """
        if self._kept is None or not self._serves(positions, cell, periodic, cutoff):
            reach = cutoff + _SKIN
            found = _search(positions, cell, periodic, reach)
            self._kept = found, positions.copy(), cell.copy(), periodic, reach
        i, j, shift, _ = self._kept[0]
        vector = positions[j] - positions[i] + shift @ cell
        near = np.einsum("ca,ca->c", vector, vector) < cutoff**2
        return Pairs(i[near], j[near], shift[near], vector[near])

    def _serves(self, positions: Array, cell: Array, periodic: tuple[bool, bool], cutoff: float) -> bool:
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


def _search(positions: Array, cell: Array, periodic: tuple[bool, bool], cutoff: float) -> Pairs:
    # imported here because it loads much of scipy, which one cell of a lattice does not need
    from ase.geometry import complete_cell
    from ase.neighborlist import primitive_neighbor_list

    if any(axis and not np.any(vector) for axis, vector in zip(periodic, cell, strict=True)):
        raise InputError(message("the balls are periodic along a cell vector of zero length", "The period is not known"))
    if all(periodic) and abs(np.linalg.det(cell)) < _FLAT:
        raise InputError(message("the balls are periodic in a cell without an area", "Its vectors are parallel"))
    flat, box = np.zeros((len(positions), 3)), np.zeros((3, 3))
    flat[:, :2], box[:2, :2] = positions, cell
    i, j, shift = primitive_neighbor_list("ijS", (*periodic, False), complete_cell(box), flat, cutoff)
    once = select_once(i, j, shift)
    i, j, shift = i[once], j[once], shift[once][:, :2]
    order = np.lexsort((shift[:, 1], shift[:, 0], j, i))
    i, j, shift = i[order], j[order], shift[order]
    return Pairs(i, j, shift, positions[j] - positions[i] + shift @ cell)
