"""Contacts of an array of equal cells, kind by kind: a list that need not be spelled out.

In an array of C cells ball b of cell c has the number b C + c, and the contact of kind k that
starts in cell c has the number k C + c. Along the last period the balls i of the contacts of a kind
follow each other in memory, and so do their balls j up to the boundary, where they begin again.
Such a run of contacts is worked on as one: loops go through memory in order, and no index is read
for a contact.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from functools import cached_property, lru_cache
from typing import NamedTuple, Self

import numpy as np
from numpy.typing import NDArray

from granphon.balls.lattices import Lattice
from granphon.balls.neighbours import ContactTable
from granphon.base.arrays import Array

#: number of balls up to which a grid of a lattice is kept
_KEPT_BALLS = 2**14
#: number of cells up to which a grid finds the numbers of the balls of its contacts, 16 bytes a
#: contact, to share them with its copies in other units
_SHARED_CELLS = 2**14
#: component of a unit normal up to which it is rounding
_ROUNDING = 1e-15


class Runs(NamedTuple):
    """What loops read of a grid.

    A run is a number of contacts of one kind: the next contact of the run starts, and ends, in the
    next cell.

    Attributes
    ----------
    table : (runs, 4) the kind of each run, the cell where its first contact starts, the cell where
        its first contact ends, and the number of its contacts.
    ends : (kinds, 2) numbers, within the cell, of the balls that each kind of contact joins.
    normal : (kinds, d) unit vectors, from ball i to ball j.
    """

    table: NDArray[np.int64]
    ends: NDArray[np.int64]
    normal: Array

    def round(self) -> Runs:
        """Return the runs with normals in single precision."""
        return self._replace(normal=self.normal.astype(np.float32))


@dataclass(frozen=True, eq=False, repr=False)
class Grid:
    """Contacts between the balls of equal cells.

    Attributes
    ----------
    shape : (L1, ..., Lp) numbers of cells.
    n_balls : number of balls in a cell.
    i, j : (kinds,) balls of the cell that each kind of contact joins.
    shift : (kinds, p) number of cells, along each period, from ball i to ball j.
    vector : (kinds, 3) from ball i to ball j, at touch.
    """

    shape: tuple[int, ...]
    n_balls: int
    i: NDArray[np.int64]
    j: NDArray[np.int64]
    shift: NDArray[np.int64]
    vector: Array

    @classmethod
    def of(cls, table: ContactTable, shape: tuple[int, ...], n_balls: int) -> Self:
        """Return the contacts of an array of cells of this ``shape`` (L1, ..., Lp); each cell has
        the ``n_balls`` balls and the contacts of the ``table``, whose vectors lie along the first p
        axes.
        """
        p = len(shape)
        vector = np.zeros((len(table), 3))
        vector[:, :p] = table.vector[:, :p]
        return cls(
            shape=shape,
            n_balls=n_balls,
            i=np.asarray(table.i, np.int64),
            j=np.asarray(table.j, np.int64),
            shift=np.asarray(table.shift, np.int64),
            vector=vector,
        )

    @property
    def n_kinds(self) -> int:
        """Number of kinds of contacts."""
        return len(self.i)

    @cached_property
    def n_cells(self) -> int:
        """Number of cells."""
        return math.prod(self.shape)

    @cached_property
    def distance(self) -> Array:
        """(kinds,) distances of the balls at touch."""
        return np.asarray(np.sqrt(np.einsum("ka,ka->k", self.vector, self.vector)))

    @cached_property
    def normal(self) -> Array:
        """(kinds, 3) unit vectors from ball i to ball j at touch."""
        return np.asarray(self.vector / self.distance[:, None])

    def scale(self, factor: float) -> Grid:
        """Return the contacts in another unit of length: each length is ``factor`` times as many
        units; ``factor`` is above zero.
        """
        scaled = replace(self, vector=factor * self.vector)
        # runs, normals and ends do not depend on the unit: both grids share them. The ends of a
        # large grid take memory, and are shared only if they have been found before
        vars(scaled).update(runs=self.runs, normal=self.normal)
        if "ends" in vars(self) or self.n_cells <= _SHARED_CELLS:
            vars(scaled).update(ends=self.ends)
        return scaled

    @cached_property
    def runs(self) -> Runs:
        """The runs of all contacts, in the order of their kinds and of their first cells."""
        tables = [self._find_runs(kind) for kind in range(self.n_kinds)]
        components = self.normal[:, : len(self.shape)]
        return Runs(
            np.ascontiguousarray(np.concatenate(tables), np.int64),
            np.stack([self.i, self.j], axis=1),
            # loops skip components of zero
            np.where(np.abs(components) > _ROUNDING, components, 0.0),
        )

    def _find_runs(self, kind: int) -> NDArray[np.int64]:
        """Return the runs (runs, 4) of one ``kind`` of contacts; see :class:`Runs`."""
        *outer, inner = self.shape
        shift = self.shift[kind].tolist()
        # cells follow each other in rows along the last period; a contact that starts in a row ends
        # in one of `end_rows`
        rows = np.arange(math.prod(outer))
        end_rows = rows
        if outer:
            indices = np.unravel_index(rows, outer)
            end_indices = [
                (index + step) % length
                for index, step, length in zip(indices, shift[:-1], outer, strict=True)
            ]
            end_rows = np.ravel_multi_index(tuple(end_indices), outer)
        # each row has two runs: the last `n_beyond` contacts of the row pass the boundary and end
        # at the beginning of a row
        n_beyond = shift[-1] % inner
        start_cells = np.stack([inner * rows, inner * rows + inner - n_beyond])
        end_cells = np.stack([inner * end_rows + n_beyond, inner * end_rows])
        counts = np.repeat([[inner - n_beyond], [n_beyond]], len(rows), axis=1)
        columns = [np.full(2 * len(rows), kind)]
        columns += [values.T.ravel() for values in (start_cells, end_cells, counts)]
        runs = np.stack(columns, axis=1)
        return _join_runs(runs[runs[:, 3] > 0])  # one of the two runs may be empty

    @cached_property
    def ends(self) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
        """Numbers (n_c,) of the balls i, and (n_c,) of the balls j, of all contacts; read-only."""
        cells = np.arange(self.n_cells).reshape(self.shape)
        axes = range(cells.ndim)
        # of each kind, the cell where the contact ends that starts in each cell
        end_cells = [
            np.roll(cells, [-step for step in shift], axes) for shift in self.shift.tolist()
        ]
        i = self.n_cells * self.i[:, None] + cells.ravel()
        j = self.n_cells * self.j[:, None] + np.reshape(end_cells, (self.n_kinds, -1))
        ends = (i.ravel().astype(np.int64), j.ravel().astype(np.int64))
        for numbers in ends:
            numbers.flags.writeable = False
        return ends


def _join_runs(runs: NDArray[np.int64]) -> NDArray[np.int64]:
    """Return the ``runs`` (n, 4) of one kind, in the order of their first cells, with runs joined
    that follow each other: a run becomes part of the run before it if both of its ends go on where
    those of the run before it have stopped. There is at least one run.
    """
    goes_on = np.ones(len(runs), bool)
    for end in (1, 2):  # the columns of the cells where contacts start, and where they end
        goes_on[1:] &= runs[1:, end] == runs[:-1, end] + runs[:-1, 3]
    goes_on[0] = False
    first = np.flatnonzero(~goes_on)
    joined_runs = runs[first]
    joined_runs[:, 3] = np.add.reduceat(runs[:, 3], first)
    return joined_runs


def find_lattice_grid(shape: tuple[int, ...], lattice: Lattice) -> Grid:
    """Return the contacts of an array of ``shape`` (L1, ..., Lp) cells of a ``lattice``, kind by
    kind; lengths are over the diameter. The last 8 grids of at most ``_KEPT_BALLS`` balls are kept
    for further calls, and shared: their arrays must not be changed.
    """
    if math.prod(shape) * lattice.n_balls > _KEPT_BALLS:
        return Grid.of(lattice.contacts, shape, lattice.n_balls)
    return _keep_lattice_grid(shape, lattice)


@lru_cache(maxsize=8)
def _keep_lattice_grid(shape: tuple[int, ...], lattice: Lattice) -> Grid:
    """Return the grid of :func:`find_lattice_grid`, which is kept."""
    return Grid.of(lattice.contacts, shape, lattice.n_balls)
