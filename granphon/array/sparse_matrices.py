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
#: c and p, by dimension: to make complex factors of n motions takes c n^p bytes for each motion and
#: each contact of a ball, and :data:`_LIBRARY_BYTES`. In a plane and in space this is a bound of
#: what processes took for triangular, square, simple and body-centred cubic, and close-packed
#: lattices and packings with 4.6 to 7.8 contacts a ball, of 3000 to 120,000 motions. Beyond 10,000
#: motions triangular and close-packed lattices took 80 to 95 percent of it, packings 50 to 85
_FACTORS_BYTES = (
    {1: (2.5e3, 0.0), 2: (500.0, 0.05), 3: (145.0, 0.33)}
    if find_spec("rslab")
    else {1: (2.5e3, 0.0), 2: (700.0, 0.05), 3: (8.5, 0.67)}  # of SuperLU
)
#: bytes that the library of factors takes when it is loaded, and at its first factors
_LIBRARY_BYTES = 8e7


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


def estimate_factors(motions: int, dimension: int, contacts: float) -> tuple[float, float]:
    """Return the time, s, and bytes of the factors of a complex matrix of balls with a mean number
    of ``contacts``; infinite if it is too large to be factorised.
    """
    if motions > LARGEST_FACTORS[dimension]:
        return math.inf, math.inf
    time_per_motion, time_power = _FACTORS_TIME[dimension]
    time = time_per_motion * motions * float(motions) ** time_power
    bytes_per_contact, bytes_power = _FACTORS_BYTES[dimension]
    memory = bytes_per_contact * contacts * motions * float(motions) ** bytes_power
    return time, _LIBRARY_BYTES + memory
