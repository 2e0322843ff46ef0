"""Sparse matrices of networks of contacts: C from the coefficients of its rows, and factors of
C^T K C.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import ArrayLike

from granphon.array.stencils import Stencils, number_cells
from granphon.base.arrays import Array
from granphon.dynamics.factors import factorise

if TYPE_CHECKING:
    from scipy.sparse import csr_array

#: stiffness, over the mean, from which a contact is stiff; softer ones enter the matrix by their
#: part of the diagonal only
STIFF = 1e-3
#: most motions of a matrix that is factorised, for balls on a line, in a plane, in space: they take
#: 5 GB at most
LARGEST_FACTORS = {1: 1_000_000, 2: 300_000, 3: 12_000}
#: time of these factors, complex ones, s for each of n motions: c n^p
_FACTORS_TIME = {1: (3.6e-7, 0.0), 2: (1.8e-7, 0.5), 3: (6e-8, 1.0)}
#: their bytes for each of n motions while they are made, c n^p; of lattices that are not the
#: densest from half of that
_FACTORS_BYTES = {1: (5e3, 0.0), 2: (15e3, 0.0), 3: (1.1e3, 0.5)}
#: stiffness, over the mean, that holds balls which nothing else holds
_LEAST_DIAGONAL = 1e-5
#: added to the matrix, whose diagonal is scaled to one: without it rounding could make motions that
#: cost nothing unstable
_HOLDING = 1e-5


def compose(
    parts: Iterable[tuple[ArrayLike, ArrayLike, ArrayLike]], shape: tuple[int, int]
) -> csr_array[Any]:
    """Return a sparse matrix from parts (lines, columns, entries), arrays of one shape or that
    broadcast to one.

    Entries at the same place add up, as those of a ball that touches itself across the boundary do.
    """
    from scipy.sparse import coo_array  # imported here: most simulations do not need it

    flat = [[np.ravel(one) for one in np.broadcast_arrays(*part)] for part in parts]
    lines, columns, entries = (np.concatenate(one) for one in zip(*flat, strict=True))
    where = lines.astype(np.int32), columns.astype(np.int32)
    matrix: csr_array[Any] = coo_array((entries, where), shape=shape).tocsr()
    matrix.eliminate_zeros()
    return matrix


def share_places(matrices: Iterable[Any]) -> list[Any]:
    """Return a matrix (CSC) with a place for each entry that any square sparse matrix has, and the
    entries of each there.

    Sums of the matrices are then sums of arrays.
    """
    from scipy.sparse import csc_array

    given = [one.tocoo() for one in matrices]
    size = given[0].shape[0]
    keys = [one.col.astype(np.int64) * size + one.row for one in given]
    places = np.unique(np.concatenate(keys))
    starts = np.searchsorted(places, np.arange(size + 1) * size)
    every: Any = csc_array((np.zeros(places.size), places % size, starts), shape=(size, size))
    at = [np.searchsorted(places, key) for key in keys]
    return [
        every,
        *(np.bincount(place, one.data, places.size) for place, one in zip(at, given, strict=True)),
    ]


def estimate_factors(motions: int, dimension: int) -> tuple[float, float]:
    """Return the time, s, and bytes of the factors of a complex matrix; infinite if it is too large
    to be factorised.
    """
    if motions > LARGEST_FACTORS[dimension]:
        return math.inf, math.inf
    (time, later), (size, larger) = _FACTORS_TIME[dimension], _FACTORS_BYTES[dimension]
    return time * motions * float(motions) ** later, size * motions * float(motions) ** larger


def factorise_contacts(stencils: Stencils, stiffness: Array) -> Callable[[Array], Array]:
    """Return an approximate inverse of C^T K C for a ``stiffness`` (rows, L1, ..., Lp) of all
    deformations, not negative.

    It takes forces (fields, L1, ..., Lp) and returns motions. It is symmetric but for rounding, and
    positive definite.
    """
    # imported here: most simulations do not need them
    from scipy.sparse import (
        diags_array,
        eye_array,
    )

    fields = stencils.n_fields
    cells = math.prod(stencils.shape)
    mean = float(np.mean(stiffness))
    stiffness = stiffness.reshape(len(stiffness), -1)
    j = np.tile(
        number_cells(stencils.shape, stencils.shifts), (len(stiffness) // stencils.n_contacts, 1)
    )
    i = np.broadcast_to(np.arange(cells), j.shape)
    head, tail = stencils.coefficients
    stiff = stiffness > STIFF * mean
    kind, contact = np.nonzero(stiff)
    soft = np.where(stiff, 0.0, stiffness)
    diagonal = np.full((fields, cells), _LEAST_DIAGONAL * mean)
    parts = []
    for ends, row in ((j, head), (i, -tail)):
        for field in range(fields):
            diagonal[field] += np.bincount(
                ends.ravel(), (row[:, field, None] ** 2 * soft).ravel(), cells
            )
            here = np.flatnonzero(row[kind, field])
            parts.append(
                (here, cells * field + ends[kind[here], contact[here]], row[kind[here], field])
            )
    c = compose(parts, (kind.size, fields * cells))
    matrix = c.T @ (diags_array(stiffness[kind, contact]) @ c) + diags_array(diagonal.ravel())
    scale = 1.0 / np.sqrt(matrix.diagonal())
    matrix = diags_array(scale) @ matrix @ diags_array(scale) + _HOLDING * eye_array(scale.size)
    factors = factorise(matrix, approximate=True)

    def apply(force: Array) -> Array:
        scaled = scale * force.ravel()
        # single precision has no numbers below 1e-38
        largest = float(np.max(np.abs(scaled))) or 1.0
        found = scale * factors.solve((scaled / largest).astype(np.float32)) * largest
        return np.asarray(found.reshape(force.shape))

    return apply
