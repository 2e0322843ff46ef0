"""Polarisations of long waves: their decomposition, names and order."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from granphon.dynamics.linalg import jacobi_svd

Array = NDArray[np.float64]
#: relative difference of velocities, and of the parts of polarisations along q, below which they are equal but for rounding
_TIED = 1e-12
_TIED_ALONG = 1e-9


def name_waves(axes: tuple[int, ...], periods: int) -> tuple[str, ...]:
    """Return the names of the long waves of balls that move along these ``axes``, on a lattice with ``periods``.

    They are "longitudinal", then "transverse", or "transverse_slow" and "transverse_fast"; on a plane of balls that also
    move across it, "out_of_plane" is the last.
    """
    ahead = ("longitudinal",) * (set(range(periods)) <= set(axes))
    across = ("out_of_plane",) * (periods == 2 and 2 in axes)
    rest = len(axes) - len(ahead) - len(across)
    return (*ahead, *(("transverse",) if rest == 1 else ("transverse_slow", "transverse_fast")[:rest]), *across)


def decompose_waves(along: Array, factor: Array, axes: tuple[int, ...]) -> tuple[Array, Array]:
    """Return velocities (..., n_u) and polarisations (..., n_u, n_u), columns, in the order of :func:`name_waves`.

    ``along`` (..., p) are the directions, unit vectors; ``factor`` (..., n, n_u) are factors of the acoustic tensors, whose
    eigenvalues are the squares of velocities.
    """
    values, right = jacobi_svd(factor)
    periods = along.shape[-1]
    if len(axes) == 3:
        right = _settle_vectors(np.pad(along, [(0, 0)] * (along.ndim - 1) + [(0, 3 - periods)]), values, right)
    order = _order_waves(along, right, axes)
    return np.take_along_axis(values, order, -1), np.take_along_axis(right, order[..., None, :], -1)


def _order_waves(along: Array, polarisations: Array, axes: tuple[int, ...]) -> NDArray[np.intp]:
    """Return the columns (..., n_u) of ``polarisations``, ascending in velocity, in the order of :func:`name_waves`."""
    periods = along.shape[-1]
    names = name_waves(axes, periods)
    toward = np.zeros((*along.shape[:-1], len(axes)))
    for axis in set(range(periods)) & set(axes):
        toward[..., axes.index(axis)] = along[..., axis]
    rank = np.zeros(polarisations.shape[:-2] + polarisations.shape[-1:])
    if names[0] == "longitudinal":
        part = np.abs(np.einsum("...i,...ib->...b", toward, polarisations))
        # of two that are equally longitudinal, the fast one
        tied = part >= (1.0 - _TIED_ALONG) * np.max(part, axis=-1, keepdims=True)
        ahead = len(axes) - 1 - np.argmax(tied[..., ::-1], axis=-1)
        np.put_along_axis(rank, ahead[..., None], -1.0, -1)
    if names[-1] == "out_of_plane":
        across = np.argmax(np.where(rank < 0.0, -1.0, np.abs(polarisations[..., axes.index(2), :])), axis=-1)
        np.put_along_axis(rank, across[..., None], 1.0, -1)
    return np.argsort(rank, axis=-1, kind="stable")


def _settle_vectors(along: Array, values: Array, vectors: Array) -> Array:
    """Return polarisations (..., 3, 3), columns, that rounding does not decide: those of equal velocities, and their signs.

    ``along`` (..., 3) is the direction; ``values`` (..., 3) are the velocities, ascending.
    """
    vectors = vectors.copy()
    along = np.broadcast_to(along, vectors.shape[:-1])
    tied = np.diff(values, axis=-1) <= _TIED * values[..., 1:]
    triple = np.all(tied, axis=-1)
    vectors[triple, :, 2] = along[triple]
    for pair, third in ((0, 2), (1, 0)):
        here = tied[..., pair] & (~triple if pair else True)
        apart = vectors[here][..., third]
        # the first vector, without its part along the third: the direction, or an axis far from the third vector
        ahead = along[here] - np.sum(along[here] * apart, axis=-1, keepdims=True) * apart
        axis = np.eye(3)[np.argmin(np.round(np.abs(apart), 9), axis=-1)]
        aside = axis - np.sum(axis * apart, axis=-1, keepdims=True) * apart
        first = np.where(np.linalg.norm(ahead, axis=-1, keepdims=True) > _TIED_ALONG, ahead, aside)
        first /= np.linalg.norm(first, axis=-1, keepdims=True)
        vectors[here, :, pair], vectors[here, :, pair + 1] = first, np.cross(apart, first)
    # longitudinal parts point ahead; of a vector without one, the largest component is above zero
    part = np.einsum("...i,...ib->...b", along, vectors)
    largest = np.argmax(np.round(np.abs(vectors), 9), axis=-2)
    own = np.take_along_axis(vectors, largest[..., None, :], -2)[..., 0, :]
    return vectors * np.where(np.where(np.abs(part) > _TIED_ALONG, part, own) < 0.0, -1.0, 1.0)[..., None, :]
