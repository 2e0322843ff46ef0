"""The tangent of a list of contacts: forces on balls, and on the strains of the cell, against small
motions and unit strains.

    | A  B | | u |     forces against motions
    | B' S | | E |     forces against strains

u are the m motions of n balls, and E are s strains. A (n m, n m) is sparse. Where its entries
stand, and in which order they are eliminated, depends only on the numbers of the balls of the
contacts: both are found once for all lists with the same numbers.
"""

from __future__ import annotations

from collections import OrderedDict
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray

from granphon.base.arrays import Array, Index
from granphon.contacts import loops
from granphon.contacts.columns import Columns
from granphon.contacts.contact_list import ContactList
from granphon.contacts.loops import Blocks
from granphon.dynamics.elasticity import voigt_pairs
from granphon.dynamics.factors import Elimination

#: number of patterns that are kept: a pattern takes about as long to find as a matrix to factorise
_KEPT_PATTERNS = 8
#: number of balls up to which the pattern of a list is kept: a pattern takes some kB a ball
_KEPT_BALLS = 2**13


class Pattern:
    """Where the entries of A stand among those of a sparse matrix in columns. The indices of the
    matrix have 32 bits, which suffice for 2^31 - 1 entries.

    Parameters
    ----------
    i, j : (n_c,) numbers of the two balls of each contact.
    n_balls, n_motions : numbers n of balls, and m of motions of each.
    """

    def __init__(
        self, i: NDArray[np.int64], j: NDArray[np.int64], n_balls: int, n_motions: int
    ) -> None:
        """Find the place of each block, and the line of the matrix of each entry."""
        lines, columns, numbers = _list_blocks(i, j, n_balls)
        first, apart = _lay_blocks(columns, n_balls, n_motions)
        places = np.stack([first, apart], axis=1)[numbers]
        motions = np.arange(n_motions)
        #: (n, 2) where the block of each ball begins, and how far apart its columns are
        self.by_ball = places[:n_balls]
        #: (n_c, 2, 2) the same of the blocks (i, j) and (j, i) of each contact
        self.by_contact = np.ascontiguousarray(places[n_balls:].reshape(2, -1, 2).swapaxes(0, 1))
        #: (n m,) places of the diagonal
        self.diagonal = np.ravel(self.by_ball[:, :1] + (self.by_ball[:, 1:] + 1) * motions)
        # (blocks, columns, lines) the place of each entry of each block, and the line of the matrix
        entries = first[:, None, None] + apart[:, None, None] * motions[:, None] + motions
        self._indices = np.empty(entries.size, np.int32)
        self._indices[entries] = (n_motions * lines[:, None, None] + motions).astype(np.int32)
        heights = np.bincount(columns, minlength=n_balls)
        n_in_column = np.repeat(heights * n_motions, n_motions)
        self._starts = np.concatenate([[0], np.cumsum(n_in_column)]).astype(np.int32)

    @property
    def n_entries(self) -> int:
        """Number of entries."""
        return self._indices.size

    def make_matrix(self, data: Array) -> Any:
        """Return the sparse matrix (n m, n m), in columns, with the entries ``data`` (n_entries,)
        in the order of the pattern. The matrix shares ``data``, and its indices with the pattern:
        these must not be changed.
        """
        from scipy.sparse import csc_array  # imported here: media that are averaged do not need it

        size = self._starts.size - 1
        matrix: Any = csc_array((data, self._indices, self._starts), shape=(size, size))
        matrix.has_canonical_format = True
        return matrix

    def list_entries(self, blocks: Blocks) -> Array:
        """Return the entries (n_entries,) of A with these ``blocks``, in the order of the
        pattern.
        """
        data = np.zeros(self.n_entries)
        of_balls_and_contacts = (blocks.diagonal, blocks.forward, blocks.backward)
        loops.fill_entries(*of_balls_and_contacts, self.by_ball, self.by_contact, data)
        return data

    @cached_property
    def elimination(self) -> Elimination:
        """The order of elimination of symmetric matrices with these places."""
        return Elimination(self.make_matrix(np.ones(self.n_entries)))

    @cached_property
    def _leading(self) -> dict[int, LeadingPart]:
        """The leading parts that :meth:`lead` has found, by their sizes."""
        return {}

    def lead(self, size: int) -> LeadingPart:
        """Return where the entries of the leading part stand: the first ``size`` lines and columns
        of the matrix. The part is kept for further calls.
        """
        if size not in self._leading:
            self._leading[size] = LeadingPart(self, size)
        return self._leading[size]


def _list_blocks(
    i: NDArray[np.int64], j: NDArray[np.int64], n_balls: int
) -> tuple[Index, Index, Index]:
    """Return the line and the column (blocks,) of each block of A, in the order of columns and, in
    a column, of lines; and the numbers (n + 2 n_c,) of the blocks of balls, then of the blocks (i,
    j) and then of the blocks (j, i) of contacts. What stands at the same place is one block.
    """
    balls = np.arange(n_balls)
    lines = np.concatenate([balls, i, j])
    columns = np.concatenate([balls, j, i])
    blocks, numbers = np.unique(columns * n_balls + lines, return_inverse=True)
    return blocks % n_balls, blocks // n_balls, numbers


def _lay_blocks(columns: Index, n_balls: int, n_motions: int) -> tuple[Index, Index]:
    """Return, of each block of A with its ``columns`` (blocks,), the place of its first entry among
    all entries (blocks,), and how far apart its columns of entries are (blocks,).
    """
    heights = np.bincount(columns, minlength=n_balls)  # numbers of blocks
    starts = np.cumsum(heights) - heights
    blocks_above = np.arange(columns.size) - starts[columns]
    first = starts[columns] * n_motions**2 + blocks_above * n_motions
    return first, heights[columns] * n_motions


class LeadingPart:
    """Where the entries of the leading part (size, size) of a matrix with a ``pattern`` stand.

    Parameters
    ----------
    pattern : where the entries of the whole matrix stand.
    size : number of lines and of columns of the part.

    Attributes
    ----------
    places : (entries,) places of the entries of the part among those of the whole.
    diagonal : (size,) places of the diagonal among the entries of the whole.
    band : number of diagonals below the main one.
    """

    def __init__(self, pattern: Pattern, size: int) -> None:
        """Pick the entries of the part from those of the whole matrix."""
        whole = pattern.make_matrix(np.ones(pattern.n_entries))
        # entries of the first columns, of which those in the first lines are kept
        lines = whole.indices[: whole.indptr[size]]
        columns = np.repeat(np.arange(size), np.diff(whole.indptr[: size + 1]))
        is_leading = lines < size
        lines = lines[is_leading]
        columns = columns[is_leading]
        self.places = np.flatnonzero(is_leading)
        self.diagonal = pattern.diagonal[:size]
        self.band = int(np.max(lines - columns, initial=0))
        self._lines = lines
        self._starts = np.searchsorted(columns, np.arange(size + 1)).astype(np.int32)

    def make_band(self, entries: Array) -> Array:
        """Return the main diagonal and the diagonals below it, (band + 1, size), of a symmetric
        matrix whose ``entries`` are in the order of :attr:`places`. The last k numbers of the k-th
        diagonal below the main one are zero.
        """
        columns = np.repeat(np.arange(len(self._starts) - 1), np.diff(self._starts))
        is_lower = self._lines >= columns
        band = np.zeros((self.band + 1, len(self._starts) - 1))
        band[(self._lines - columns)[is_lower], columns[is_lower]] = entries[is_lower]
        return band

    def make_matrix(self, entries: Array) -> Any:
        """Return the sparse matrix (size, size), in columns, whose ``entries`` are in the order of
        :attr:`places`. The matrix shares ``entries``, and its indices with this part: these must
        not be changed.
        """
        from scipy.sparse import csc_array  # imported here: media that are averaged do not need it

        size = len(self._starts) - 1
        matrix: Any = csc_array((entries, self._lines, self._starts), shape=(size, size))
        matrix.has_canonical_format = True
        return matrix

    @cached_property
    def elimination(self) -> Elimination:
        """The order of elimination of symmetric matrices with these places."""
        return Elimination(self.make_matrix(np.ones(len(self.places))))


#: the patterns that are kept, by the bytes of i and of j, and the numbers of balls and of motions;
#: the one used last is at the end
_patterns: OrderedDict[tuple[bytes, bytes, int, int], Pattern] = OrderedDict()


def find_pattern(
    i: NDArray[np.int64], j: NDArray[np.int64], n_balls: int, n_motions: int
) -> Pattern:
    """Return the pattern of a list whose contacts have the balls ``i`` and ``j`` (n_c,), of
    ``n_balls`` balls with ``n_motions`` motions each.

    The last ``_KEPT_PATTERNS`` patterns of lists of at most ``_KEPT_BALLS`` balls are kept for
    further calls.
    """
    if n_balls > _KEPT_BALLS:
        return Pattern(i, j, n_balls, n_motions)
    key = (i.tobytes(), j.tobytes(), n_balls, n_motions)
    pattern = _patterns.pop(key, None) or Pattern(i, j, n_balls, n_motions)
    _patterns[key] = pattern
    while len(_patterns) > _KEPT_PATTERNS:
        _patterns.popitem(last=False)
    return pattern


def fill_blocks(columns: Columns, axes: NDArray[np.int64], strains: Array, n_balls: int) -> Blocks:
    """Return the tangent of the contacts ``columns`` of ``n_balls`` balls.

    ``axes`` (m,) are those of the motions of a ball, 0 to 2 of displacements, 3 to 5 of rotations;
    ``strains`` (s, 3, 3) are unit strains, symmetric. Without tangential forces the tangent is
    symmetric: then ``backward`` is the array ``forward``, and ``back`` the array ``ahead``.
    """
    s = len(strains)
    m = len(axes)
    diagonal = np.zeros((m, m, n_balls))
    forward = np.zeros((m, m, len(columns.i)))
    ahead = np.zeros((n_balls, m, s))
    corner = np.zeros((s, s))
    frozen = columns.freeze()
    blocks = Blocks(diagonal, forward, forward, ahead, ahead, corner)
    loops.fill_tangent(frozen, axes, strains, blocks)
    if not len(columns.tangential_force):
        return blocks
    blocks = blocks._replace(backward=forward.copy(), back=ahead.copy())
    loops.add_static_turn(frozen, axes, strains, blocks)
    return blocks


@dataclass(frozen=True, eq=False, repr=False)
class Tangent:
    """The tangent of a list of contacts.

    Attributes
    ----------
    contacts : the list.
    blocks : its tangent, block by block.
    """

    contacts: ContactList
    blocks: Blocks

    @cached_property
    def pattern(self) -> Pattern:
        """Where the entries of A stand."""
        contacts = self.contacts
        return find_pattern(contacts.i, contacts.j, contacts.n_balls, len(contacts.axes))

    @cached_property
    def data(self) -> Array:
        """(n_entries,) entries of A, in the order of :attr:`pattern`."""
        return self.pattern.list_entries(self.blocks)

    @cached_property
    def matrix(self) -> Any:
        """A, a sparse matrix (n m, n m) in columns; motions of a ball follow each other. The matrix
        shares its entries with :attr:`data` and its indices with :attr:`pattern`: these must not be
        changed.
        """
        return self.pattern.make_matrix(self.data)

    def symmetrise(self) -> Tangent:
        """Return the tangent with A replaced by its symmetric part."""
        symmetric = Tangent(self.contacts, self.blocks.symmetrise())
        vars(symmetric)["pattern"] = self.pattern  # entries stand at the same places
        return symmetric


def unit_strains(dimension: int) -> Array:
    """Return the unit strains (s, 3, 3) of a cell of ``dimension`` 1, 2 or 3, in Voigt order. They
    are symmetric matrices; both entries of a shear are 1/2.
    """
    pairs = voigt_pairs(dimension)
    strains = np.zeros((len(pairs), 3, 3))
    for strain, (a, b) in zip(strains, pairs, strict=True):
        strain[a, b] += 0.5
        strain[b, a] += 0.5
    return strains


def find_tangent(contacts: ContactList, strains: Array) -> Tangent:
    """Return the tangent of a list; ``strains`` (s, 3, 3) are unit strains, symmetric."""
    return Tangent(
        contacts, fill_blocks(contacts.columns, contacts.axes, strains, contacts.n_balls)
    )
