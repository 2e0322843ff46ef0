"""Force constants of balls in contact: those of each contact alone, and those between all balls of a cell."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from granphon.dynamics.contact_lattice import ContactLattice
from granphon.dynamics.rows import push_rows

if TYPE_CHECKING:
    from scipy.sparse import csr_array


Array = NDArray[np.float64]


def contact_blocks(lattice: ContactLattice) -> Array:
    """Return the force constants of each contact alone, (n_c, 6, 6), in (x, y, w) of ball i, then of ball j; units of k.

    If balls have all six motions the shape is (n_c, 12, 12), in (x, y, z, w_x, w_y, w_z) of each ball.
    """
    slots, count = list(lattice.motions.slots), 3 * lattice.motions.atoms_per_ball
    springs = [(row, row.stiffness * lattice.stiffness) for row in lattice.rows]
    if lattice.is_prestressed:
        springs += [(row, -lattice.prestress) for row in push_rows(lattice.contacts.normal, lattice.motions)]
    entries = np.zeros((len(springs), 2 * count, len(lattice.contacts)))
    for entry, (row, _) in zip(entries, springs, strict=True):
        entry[:count][slots], entry[count:][slots] = -row.tail.T, row.head.T
    return np.asarray(np.einsum("rc,rac,rbc->cab", [stiffness for _, stiffness in springs], entries, entries))


def assemble(lattice: ContactLattice, sparse: bool) -> Array | csr_array[Any]:
    """Return the force constants of a cell, summed over its images, (N, N, 3, 3) in (x, y, w) of each ball; units of k.

    With ``sparse`` they are a (3N, 3N) ``scipy.sparse.csr_array``.
    """
    table, n, blocks = lattice.contacts, lattice.n_balls, contact_blocks(lattice)
    size = blocks.shape[1] // 2
    ends = np.stack([table.i, table.j], axis=1)
    index = (size * ends[:, :, None] + np.arange(size)).reshape(len(table), 2 * size)
    first = np.broadcast_to(index[:, :, None], blocks.shape).ravel()
    second = np.broadcast_to(index[:, None, :], blocks.shape).ravel()
    if sparse:
        from scipy.sparse import coo_array

        matrix = coo_array((blocks.ravel(), (first, second)), shape=(size * n, size * n)).tocsr()
        matrix.sum_duplicates()
        return matrix
    dense = np.zeros((size * n, size * n))
    np.add.at(dense, (first, second), blocks.ravel())
    return dense.reshape(n, size, n, size).transpose(0, 2, 1, 3)
