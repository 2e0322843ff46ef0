"""Pairs of balls that are near each other, kept from call to call while the balls move little."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from granphon.balls.contact_table import seen_first
from granphon.base.errors import InputError, message

__all__ = ["PairList", "Pairs"]

Array = NDArray[np.float64]
#: how much farther than asked, in spacings, a list reaches. It serves until a ball has moved by half of this. It does not
#: reach the second neighbours of the lattices.
_SKIN = 0.3
#: area, in spacings squared, below which a cell is taken to have none
_FLAT = 1e-12


class Pairs(NamedTuple):
    """Pairs of balls, each once: indices ``i``, ``j`` (n,), ``shift`` (n, 2) whole cells, ``vector`` (n, 2) from i to j."""

    i: NDArray[np.intp]
    j: NDArray[np.intp]
    shift: NDArray[np.intp]
    vector: Array


class PairList:
    """A search for pairs that keeps its list: it reaches farther than asked, and serves until it might miss a pair."""

    def __init__(self) -> None:
        self._kept: tuple[Pairs, Array, Array, tuple[bool, bool], float] | None = None

    def near(self, positions: Array, cell: Array, periodic: tuple[bool, bool], cutoff: float) -> Pairs:
        """The pairs nearer than ``cutoff``, in the order of (i, j, shift), the same to the last digit from a kept list.

        ``positions`` (N, 2), ``cell`` (2, 2). :class:`~granphon.base.errors.InputError` for a period of no length.
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
        """Whether no pair can have come within the cutoff that is not in the list.

        With the cell every vector turns into vector F; a pair beyond the reach is then at least the least stretch of F
        times the reach apart, less what two balls have moved besides.
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
    # brings much of scipy along, and the cells of the lattice itself do not need it
    from ase.geometry import complete_cell
    from ase.neighborlist import primitive_neighbor_list

    if any(axis and not np.any(vector) for axis, vector in zip(periodic, cell, strict=True)):
        raise InputError(message("the balls are periodic along a cell vector of no length", "Nothing says the period"))
    if all(periodic) and abs(np.linalg.det(cell)) < _FLAT:
        raise InputError(message("the balls are periodic in a cell without an area", "Its vectors are parallel"))
    flat, box = np.zeros((len(positions), 3)), np.zeros((3, 3))
    flat[:, :2], box[:2, :2] = positions, cell
    i, j, shift = primitive_neighbor_list("ijS", (*periodic, False), complete_cell(box), flat, cutoff)
    once = seen_first(i, j, shift)
    i, j, shift = i[once], j[once], shift[once][:, :2]
    order = np.lexsort((shift[:, 1], shift[:, 0], j, i))
    i, j, shift = i[order], j[order], shift[order]
    return Pairs(i, j, shift, positions[j] - positions[i] + shift @ cell)
