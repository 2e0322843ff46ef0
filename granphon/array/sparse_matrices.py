"""Sparse matrices of networks of contacts, from parts, and the time and memory of their factors."""

from __future__ import annotations

import math
from collections.abc import Iterable
from importlib.util import find_spec
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import ArrayLike

if TYPE_CHECKING:
    from scipy.sparse import csr_array

#: largest number of motions of a matrix that is factorised if it is not symmetric, by dimension:
#: its factors take 5 GB at most. SuperLU factorises such matrices, and all matrices if rslab is not
#: installed; in space its factors have ten times as many entries as those of rslab
LARGEST_UNSYMMETRIC = {1: 1_000_000, 2: 300_000, 3: 12_000}
#: largest number of motions of a matrix that is factorised if it is symmetric, by dimension
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
#: bytes that the library of factors takes as it is loaded and makes its first factors
_LIBRARY_BYTES = 8e7


def compose(
    parts: Iterable[tuple[ArrayLike, ArrayLike, ArrayLike]], shape: tuple[int, int]
) -> csr_array[Any]:
    """Return a sparse matrix (CSR) of a ``shape`` from at least one of ``parts``. A part is (lines,
    columns, entries): three arrays that broadcast to one shape.

    Entries at the same line and column add up, as those of a ball that touches itself across the
    boundary. Entries whose sum is zero are not stored.
    """
    from scipy.sparse import coo_array  # imported here: most simulations do not need it

    triplets = [[np.ravel(values) for values in np.broadcast_arrays(*part)] for part in parts]
    lines, columns, entries = (np.concatenate(values) for values in zip(*triplets, strict=True))
    places = lines.astype(np.int32), columns.astype(np.int32)
    matrix: csr_array[Any] = coo_array((entries, places), shape=shape).tocsr()
    matrix.eliminate_zeros()
    return matrix


def share_places(matrices: Iterable[Any]) -> list[Any]:
    """Return a list that begins with a sparse matrix (CSC) of zeros, the shared one, and goes on
    with an array for each of the real sparse ``matrices``, (n, n) each, of which there must be at
    least one.

    The shared matrix stores an entry wherever one of the ``matrices`` does. An array has the
    entries of its matrix in the order of the shared one, and zeros where its matrix stores none. So
    sums of the matrices are sums of these arrays.
    """
    from scipy.sparse import csc_array

    triplets = [matrix.tocoo() for matrix in matrices]
    size = triplets[0].shape[0]
    # the place of an entry in a matrix that is read column by column
    places = [matrix.col.astype(np.int64) * size + matrix.row for matrix in triplets]
    stored_places = np.unique(np.concatenate(places))
    starts = np.searchsorted(stored_places, np.arange(size + 1) * size)
    pattern: Any = csc_array(
        (np.zeros(stored_places.size), stored_places % size, starts), shape=(size, size)
    )
    entries = []
    for matrix, places_of_matrix in zip(triplets, places, strict=True):
        numbers = np.searchsorted(stored_places, places_of_matrix)
        entries.append(np.bincount(numbers, matrix.data, stored_places.size))
    return [pattern, *entries]


def estimate_factors(motions: int, dimension: int, contacts: float) -> tuple[float, float]:
    """Return the time, s, and the memory, bytes, of the factors of a complex symmetric matrix of so
    many ``motions`` of balls. Both are infinite if the matrix is too large to be factorised.

    ``dimension`` is 1, 2 or 3: balls lie on a line, in a plane or in space. ``contacts`` is the
    mean number of contacts of a ball.
    """
    if motions > LARGEST_FACTORS[dimension]:
        return math.inf, math.inf
    time_per_motion, time_power = _FACTORS_TIME[dimension]
    time = time_per_motion * motions * float(motions) ** time_power
    bytes_per_contact, bytes_power = _FACTORS_BYTES[dimension]
    memory = bytes_per_contact * contacts * motions * float(motions) ** bytes_power
    return time, _LIBRARY_BYTES + memory
