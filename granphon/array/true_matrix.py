"""The matrix of small motions of a small array in its true geometry, and its factors.

Balls whose contacts all slide, or carry nothing, are held by no springs. What is left are the forces that act and turn with
their contacts, W/d of the others. The preconditioners of the lattice know nothing of these, and iterations with them hardly
come to an end. So the whole matrix of a small array is factorised (sparse LU).
"""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any

import numpy as np
from numpy.typing import NDArray

from granphon.array.array_rows import number_cells
from granphon.array.preconditioners import compose_rows
from granphon.array.stencils import Stencils

__all__ = ["Assembly", "is_small"]

Array = NDArray[np.float64]
#: largest number of balls whose matrix is factorised, for lattices with 1, 2, 3 periods: the time and the memory that factors take
#: grow faster than it
_MOST_BALLS = (2**12, 2**10, 2**9)
#: stiffness that holds motions which nothing resists, over the mean stiffness
_HOLDING = 1e-10


def is_small(stencils: Stencils) -> bool:
    """Return whether an array is small enough for factors of its matrix."""
    return math.prod(stencils.shape) * stencils.n_balls <= _MOST_BALLS[len(stencils.shape) - 1]


class Assembly:
    """Maker of matrices of one array, from those of its contacts in the deformations of the ``frame``.

    ``blocks`` are those of :meth:`~granphon.array.true_geometry.ExactPlace.tabulate`.
    """

    def __init__(self, frame: Stencils) -> None:
        self._frame = frame
        j = number_cells(frame.shape, [row.shift for row in frame.rows])
        cells = j.shape[1]
        i, rows = np.broadcast_to(np.arange(cells), j.shape), np.arange(j.size)
        self._c = compose_rows(i, j, *frame.coefficients, *np.divmod(rows, cells))
        of_contact = rows.reshape(-1, 1, frame.n_contacts * cells)
        self._pairs = [one.ravel() for one in np.broadcast_arrays(of_contact, of_contact.swapaxes(0, 1))]

    def assemble(self, blocks: Array) -> Any:
        """Return the sparse matrix that takes motions to forces on balls, times -1, both flattened."""
        from scipy.sparse import coo_array  # imported here: most simulations do not need it

        size = self._c.shape[0]
        d: Any = coo_array((blocks.ravel(), (self._pairs[0], self._pairs[1])), shape=(size, size)).tocsr()
        return self._c.T.tocsr() @ (d @ self._c)

    def invert(self, blocks: Array, stiffness: float) -> Callable[[Array], Array]:
        """Return what finds motions (fields, L1, ..., Lp) from forces; ``stiffness`` is the mean one of contacts."""
        from scipy.sparse import eye_array
        from scipy.sparse.linalg import splu

        matrix = self.assemble(blocks)
        held = matrix + _HOLDING * stiffness * eye_array(matrix.shape[0])
        factors = splu(held.tocsc(), permc_spec="MMD_AT_PLUS_A", diag_pivot_thresh=0.1, options={"SymmetricMode": True})

        def apply(force: Array) -> Array:
            return self._hold(np.asarray(factors.solve(self._hold(force).ravel())).reshape(force.shape))

        return apply

    def _hold(self, fields: Array) -> Array:
        """Return motions without that of the whole array, or forces without that on it: nothing resists it."""
        held = fields.reshape(self._frame.n_balls, self._frame.motions.count, *self._frame.shape).copy()
        moved = held[:, self._frame.motions.translating]
        moved -= np.mean(moved, axis=(0, *range(2, moved.ndim)), keepdims=True)
        return held.reshape(fields.shape)
