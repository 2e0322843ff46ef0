"""The matrix of small motions of an array in its true geometry, and its factors.

Balls whose contacts all slide, or carry nothing, are held by no springs. What is left are the forces that act and turn with
their contacts, W/d of the others: iterations with the preconditioners of the lattice, which know nothing of these, hardly
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
from granphon.array.true_geometry import ExactGeometry

__all__ = ["MOST_FACTORISED", "factorise", "may_factorise"]

Array = NDArray[np.float64]
#: largest number of balls whose matrix is factorised, for lattices with 1, 2, 3 periods: the time and the memory that factors
#: take grow faster than it
MOST_FACTORISED = (2**14, 2**12, 2**9)
#: stiffness that holds motions which nothing resists, over the mean stiffness
_HOLDING = 1e-10


def may_factorise(stencils: Stencils) -> bool:
    """Return whether the array is small enough."""
    return math.prod(stencils.shape) * stencils.n_balls <= MOST_FACTORISED[len(stencils.shape) - 1]


def factorise(geometry: ExactGeometry, blocks: Array, stiffness: float) -> Callable[[Array], Array]:
    """Return what finds motions (fields, L1, ..., Lp) from forces, by factors of the matrix.

    ``blocks`` are those of :meth:`~granphon.array.true_geometry.ExactPlace.tabulate`, ``stiffness`` the mean one of contacts.
    """
    from scipy.sparse import coo_array, eye_array  # imported here: most simulations do not need them
    from scipy.sparse.linalg import splu

    frame = geometry.frame
    j = number_cells(frame.shape, [row.shift for row in frame.rows])
    kinds, cells = j.shape
    i = np.broadcast_to(np.arange(cells), j.shape)
    number = np.arange(kinds * cells)
    c = compose_rows(i, j, *frame.coefficients, *np.divmod(number, cells))
    of_row = number.reshape(len(blocks), 1, -1)
    rows, columns = np.broadcast_arrays(of_row, of_row.swapaxes(0, 1))
    d: Any = coo_array((blocks.ravel(), (rows.ravel(), columns.ravel())), shape=(number.size, number.size)).tocsr()
    matrix = c.T.tocsr() @ (d @ c)
    factors = splu((matrix + _HOLDING * stiffness * eye_array(matrix.shape[0])).tocsc())

    def apply(force: Array) -> Array:
        motion = np.asarray(factors.solve(_hold(geometry.stencils, force).ravel())).reshape(force.shape)
        return _hold(geometry.stencils, motion)

    return apply


def _hold(stencils: Stencils, fields: Array) -> Array:
    """Return motions without that of the whole array, or forces without that on it: nothing resists it."""
    held = fields.reshape(stencils.n_balls, stencils.motions.count, *stencils.shape).copy()
    moved = held[:, stencils.motions.translating]
    moved -= np.mean(moved, axis=(0, *range(2, moved.ndim)), keepdims=True)
    return held.reshape(fields.shape)
