"""A sample of a crystal as an assembly on a grid, on which arrays come to rest faster."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Self

import numpy as np

from granphon.balls.hertz import HertzLaw
from granphon.base.arrays import Array, Index
from granphon.contacts.assembly import Assembly, GridAssembly
from granphon.contacts.grid import Grid
from granphon.statics.rest import Rest


@dataclass(frozen=True, eq=False, repr=False)
class SampleOnGrid:
    """A sample in two orders: as the crystal has it, cell by cell, and as a grid has it.

    On the grid the first ball of all cells comes first, then the second ball of all cells, and so
    on; so do the contacts.

    Attributes
    ----------
    by_cell : the balls and contacts of the sample in the order of the crystal.
    assembly : the same balls and contacts in the order of the grid.
    balls : (n,) the number in ``by_cell`` of each ball of the grid.
    contacts : (n_c,) the number in ``by_cell`` of each contact of the grid.
    """

    by_cell: Assembly
    assembly: GridAssembly
    balls: Index
    contacts: Index

    @classmethod
    def of(cls, assembly: Assembly, grid: Grid, law: HertzLaw) -> Self:
        """Make the sample in both orders from its ``assembly`` in the order of the crystal, whose
        contacts all have one ``law``, and the ``grid`` of its cells.
        """
        balls = np.arange(grid.n_cells * grid.n_balls).reshape(grid.n_cells, -1).T.ravel()
        contacts = np.arange(assembly.n_contacts).reshape(grid.n_cells, -1).T.ravel()
        offset = assembly.offset[contacts]
        return cls(assembly, GridAssembly(grid, offset, law, assembly.cell), balls, contacts)

    def sort(self, rest: Rest) -> Rest:
        """Return a state at rest in the order of the crystal, sorted into that of the grid."""
        turned_normal = rest.turned_normal
        return replace(
            rest,
            displacement=rest.displacement[self.balls],
            overlap=rest.overlap[self.contacts],
            assembly=self.assembly,
            turned_normal=None if turned_normal is None else turned_normal[self.contacts],
        )

    def restore(self, rest: Rest) -> Rest:
        """Return a state at rest in the order of the grid, sorted into that of the crystal."""
        turned_normal = rest.turned_normal
        return replace(
            rest,
            displacement=_scatter(rest.displacement, self.balls),
            overlap=_scatter(rest.overlap, self.contacts),
            assembly=self.by_cell,
            turned_normal=(
                None if turned_normal is None else _scatter(turned_normal, self.contacts)
            ),
        )


def _scatter(values: Array, numbers: Index) -> Array:
    """Return the ``values`` (n, ...) sorted so that value i is at the index ``numbers[i]``; the
    numbers (n,) are a permutation.
    """
    sorted_values = np.empty_like(values)
    sorted_values[numbers] = values
    return sorted_values
