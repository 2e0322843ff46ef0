"""Sparse matrices of networks of contacts, from parts, and what their factors take."""

from __future__ import annotations

import math
from collections.abc import Iterable
from importlib.util import find_spec
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import ArrayLike

if TYPE_CHECKING:
    from scipy.sparse import csr_array

#: largest number of motions of a matrix that is factorised, for balls on a line, in a plane, in
#: space: its factors take 5 GB at most. SuperLU, which stands in for rslab and factorises matrices
#: that are not symmetric, makes factors with ten times as many entries in space
LARGEST_UNSYMMETRIC = {1: 1_000_000, 2: 300_000, 3: 12_000}
LARGEST_FACTORS = LARGEST_UNSYMMETRIC | ({3: 120_000} if find_spec("rslab") else {})
#: c and p, by dimension: to make complex factors of n motions takes c n^p seconds for each motion
_FACTORS_TIME = {1: (3.6e-7, 0.0), 2: (1.8e-7, 0.5), 3: (2.1e-8, 1.0)}
#: c and p, by dimension: to make complex factors of n motions takes c n^p bytes for each motion; of
#: lattices that are not the densest, and of packings, they take down to a quarter of that
_FACTORS_BYTES = {1: (5e3, 0.0), 2: (15e3, 0.0), 3: (1.6e3, 0.33)}


def compose(
    parts: Iterable[tuple[ArrayLike, ArrayLike, ArrayLike]], shape: tuple[int, int]
) -> csr_array[Any]:
    """Return a sparse matrix (CSR) of a ``shape`` from parts (lines, columns, entries); the three
    arrays of a part broadcast to one shape.

    Entries at the same line and column add up: a ball that touches itself across the boundary has
    several. Entries whose sum is zero are not stored.
    """
    from scipy.sparse import coo_array  # imported here: most simulations do not need it

    flat = [[np.ravel(values) for values in np.broadcast_arrays(*triplet)] for triplet in parts]
    lines, columns, entries = (np.concatenate(values) for values in zip(*flat, strict=True))
    where = lines.astype(np.int32), columns.astype(np.int32)
    matrix: csr_array[Any] = coo_array((entries, where), shape=shape).tocsr()
    matrix.eliminate_zeros()
    return matrix


def share_places(matrices: Iterable[Any]) -> list[Any]:
    """Return a list: first a sparse matrix (CSC) of zeros that stores an entry wherever one of the
    square sparse ``matrices`` does; then, for each matrix, the array of its entries in this order.

    Sums of the matrices are then sums of these arrays.
    """
    from scipy.sparse import csc_array

    triplets = [matrix.tocoo() for matrix in matrices]
    size = triplets[0].shape[0]
    keys = [matrix.col.astype(np.int64) * size + matrix.row for matrix in triplets]
    places = np.unique(np.concatenate(keys))
    starts = np.searchsorted(places, np.arange(size + 1) * size)
    every: Any = csc_array((np.zeros(places.size), places % size, starts), shape=(size, size))
    positions = [np.searchsorted(places, key) for key in keys]
    parts = zip(positions, triplets, strict=True)
    entries = [np.bincount(position, matrix.data, places.size) for position, matrix in parts]
    return [every, *entries]


def estimate_factors(motions: int, dimension: int) -> tuple[float, float]:
    """Return the time, s, and bytes of the factors of a complex matrix; infinite if it is too large
    to be factorised.
    """
    if motions > LARGEST_FACTORS[dimension]:
        return math.inf, math.inf
    time_per_motion, time_power = _FACTORS_TIME[dimension]
    bytes_per_motion, bytes_power = _FACTORS_BYTES[dimension]
    time = time_per_motion * motions * float(motions) ** time_power
    return time, bytes_per_motion * motions * float(motions) ** bytes_power
