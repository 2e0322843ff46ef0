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
    """A sample whose balls and contacts come cell by cell, and the same on a grid.

    Attributes
    ----------
    by_cell : the contacts of the sample, cell by cell.
    assembly : the same on a grid, ball by ball of the cell and kind by kind of contacts.
    balls, contacts : (n,) and (n_c,) numbers in the sample of those on the grid.
    """

    by_cell: Assembly
    assembly: GridAssembly
    balls: Index
    contacts: Index

    @classmethod
    def of(cls, assembly: Assembly, grid: Grid, law: HertzLaw) -> Self:
        """Sort the contacts of a sample, all of which have one law."""
        balls = np.arange(grid.n_cells * grid.n_balls).reshape(grid.n_cells, -1).T.ravel()
        contacts = np.arange(assembly.n_contacts).reshape(grid.n_cells, -1).T.ravel()
        offset = assembly.offset[contacts]
        return cls(assembly, GridAssembly(grid, offset, law, assembly.cell), balls, contacts)

    def sort(self, rest: Rest) -> Rest:
        """Return a state of the sample as one on the grid."""
        turned = rest.turned_normal
        return replace(
            rest,
            displacement=rest.displacement[self.balls],
            overlap=rest.overlap[self.contacts],
            assembly=self.assembly,
            turned_normal=None if turned is None else turned[self.contacts],
        )

    def restore(self, rest: Rest) -> Rest:
        """Return a state on the grid as one of the sample."""
        turned = rest.turned_normal
        return replace(
            rest,
            displacement=_put(rest.displacement, self.balls),
            overlap=_put(rest.overlap, self.contacts),
            assembly=self.by_cell,
            turned_normal=None if turned is None else _put(turned, self.contacts),
        )


def _put(values: Array, numbers: Index) -> Array:
    """Return values with the first of them at the first of the ``numbers``, and so on."""
    sorted_values = np.empty_like(values)
    sorted_values[numbers] = values
    return sorted_values
