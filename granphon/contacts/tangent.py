"""The tangent of a list of contacts: forces on balls, and on the strains of the cell, against small
motions and unit strains.

    | A  B | | u |     forces against motions
    | B' S | | E |     forces against strains

A (n m, n m) is sparse. Where its entries stand depends on the ends of the contacts alone, and with
it the order in which they are eliminated: both are found once for all lists with the same ends.
"""

from __future__ import annotations

from collections import OrderedDict
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray

from granphon.base.arrays import Array
from granphon.contacts.contact_list import ContactList
from granphon.dynamics.elasticity import voigt_pairs
from granphon.dynamics.factors import Elimination

#: patterns that are kept, and the balls of a list, at most, whose pattern is: it takes 2 kB a ball,
#: and to find it about as long as to factorise
_KEPT_PATTERNS = 8
_KEPT_BALLS = 2**13


class Pattern:
    """Where the entries of A stand among those of a sparse matrix in columns.

    Parameters
    ----------
    i, j : (n_c,) numbers of the two balls of each contact.
    n_balls, n_motions : numbers n of balls, and m of motions of each.
    """

    def __init__(
        self, i: NDArray[np.int64], j: NDArray[np.int64], n_balls: int, n_motions: int
    ) -> None:
        self._n_motions = n_motions
        balls = np.arange(n_balls)
        # the blocks (i, i), (i, j), (j, i), (j, j) of each contact, and those of the diagonal
        lines = np.concatenate([i, i, j, j, balls])
        columns = np.concatenate([i, j, i, j, balls])
        blocks, numbers = np.unique(columns * n_balls + lines, return_inverse=True)
        line = blocks % n_balls
        column = blocks // n_balls
        starts = np.searchsorted(blocks, np.arange(n_balls + 1) * n_balls)
        heights = np.diff(starts)
        first = (
            starts[column] * n_motions**2 + (np.arange(blocks.size) - starts[column]) * n_motions
        )
        apart = heights[column] * n_motions
        motions = np.arange(n_motions)
        entries = first[:, None, None] + apart[:, None, None] * motions[:, None] + motions
        #: (n m,) places of the diagonal
        self.diagonal = np.ravel(
            first[numbers[4 * i.size :], None] + (apart[numbers[4 * i.size :], None] + 1) * motions
        )
        #: (n, m, m) places of the block of each ball, columns first
        self.by_ball = entries[numbers[4 * i.size :]]
        #: (n_c, 4, 2) where the blocks of each contact begin, and how far apart their columns are
        self.places = np.ascontiguousarray(
            np.stack([first, apart], axis=1)[numbers[: 4 * i.size].reshape(4, -1).T]
        )
        self._indices = np.empty(entries.size, np.int32)
        self._indices[entries] = (n_motions * line[:, None, None] + motions).astype(np.int32)
        widths = np.repeat(heights * n_motions, n_motions)
        self._starts = np.concatenate([[0], np.cumsum(widths)]).astype(np.int32)

    @property
    def n_entries(self) -> int:
        """Number of entries."""
        return self._indices.size

    def make_matrix(self, data: Array) -> Any:
        """Return the sparse matrix (n m, n m), in columns, with these entries."""
        from scipy.sparse import csc_array  # imported here: media that are averaged do not need it

        size = self._starts.size - 1
        matrix: Any = csc_array((data, self._indices, self._starts), shape=(size, size))
        matrix.has_canonical_format = True
        return matrix

    @cached_property
    def elimination(self) -> Elimination:
        """The order of elimination of symmetric matrices with these places."""
        return Elimination(self.make_matrix(np.ones(self.n_entries)))


_patterns: OrderedDict[tuple[bytes, bytes, int, int], Pattern] = OrderedDict()


def find_pattern(contacts: ContactList) -> Pattern:
    """Return the pattern of a list; those of small lists are kept."""
    ends = (contacts.i, contacts.j, contacts.n_balls, len(contacts.axes))
    if contacts.n_balls > _KEPT_BALLS:
        return Pattern(*ends)
    key = (contacts.i.tobytes(), contacts.j.tobytes(), *ends[2:])
    pattern = _patterns.pop(key, None) or Pattern(*ends)
    _patterns[key] = pattern
    while len(_patterns) > _KEPT_PATTERNS:
        _patterns.popitem(last=False)
    return pattern


@dataclass(frozen=True, eq=False, repr=False)
class Tangent:
    """The tangent of a list of contacts.

    Attributes
    ----------
    pattern : where the entries of A stand.
    data : entries of A.
    ahead : (n, m, s) B, forces on balls against unit strains.
    back : (n, m, s) B' transposed, forces on strains against unit motions.
    corner : (s, s) S, forces on strains against unit strains.
    """

    pattern: Pattern
    data: Array
    ahead: Array
    back: Array
    corner: Array

    @cached_property
    def matrix(self) -> Any:
        """A, a sparse matrix (n m, n m) in columns; motions of a ball follow each other."""
        return self.pattern.make_matrix(self.data)


def unit_strains(dimension: int) -> Array:
    """Return (s, 3, 3) unit strains of a cell with 1, 2 or 3 axes, in Voigt order."""
    pairs = voigt_pairs(dimension)
    strains = np.zeros((len(pairs), 3, 3))
    for strain, (a, b) in zip(strains, pairs, strict=True):
        strain[a, b] += 0.5
        strain[b, a] += 0.5
    return strains


def find_tangent(contacts: ContactList, strains: Array) -> Tangent:
    """Return the tangent of a list under unit ``strains`` (s, 3, 3), symmetric."""
    from granphon.contacts.loops import fill_tangent  # imported here: averages need no Numba

    pattern = find_pattern(contacts)
    s = len(strains)
    n_motions = len(contacts.axes)
    data = np.zeros(pattern.n_entries)
    ahead = np.zeros((contacts.n_balls, n_motions, s))
    back = np.zeros_like(ahead)
    corner = np.zeros((s, s))
    columns = contacts.columns
    fill_tangent(columns, contacts.axes, strains, pattern.places, data, ahead, back, corner)
    return Tangent(pattern, data, ahead, back, corner)
