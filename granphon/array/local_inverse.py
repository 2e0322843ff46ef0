"""Inverses of each ball's own block of C^T K C: how a ball moves under a force while its neighbours are held."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import combinations_with_replacement

import numpy as np
from numpy.typing import DTypeLike, NDArray

from granphon.array.array_rows import ArrayRow, stack_coefficients
from granphon.array.coupling import multiply_columns
from granphon.array.rooms import Rooms

Array = NDArray[np.float64]
#: number of elements of a kind of contact that are worked on at a time
_CACHED = 2**13


def invert_blocks(
    rows: Sequence[ArrayRow], rooms: Rooms, groups: Sequence[slice], springs: Array, least: float
) -> list[Array]:
    """Return, for each group of one to three fields that follow each other, the inverses (n, n, L1, ..., Lp) of its blocks.

    ``springs`` are the stiffnesses of all rows in rooms with margins of zeros. To each, ``least`` times that of its kind is
    added, so that there is an inverse.
    """
    own = [list(combinations_with_replacement(range(group.start, group.stop), 2)) for group in groups]
    first_of, second_of = np.array([pair for pairs in own for pair in pairs]).T
    ends = stack_coefficients(rows, max(group.stop for group in groups))
    squares = ends[..., first_of] * ends[..., second_of]
    extra = least * np.einsum("r,erp->p", [row.ratio for row in rows], squares)
    flat, steps = springs.reshape(len(rows), -1), [rooms.offset(row.shift) for row in rows]
    low, high = min(0, *steps), max(0, *steps)
    # in double precision: where few contacts hold a ball, its block is nearly singular
    room, combine = rooms.zeros(len(first_of)), np.concatenate(squares).T.astype(springs.dtype)
    sums = room.reshape(len(room), -1)
    for first, end in rooms.spans(_CACHED):
        size = end - first
        held = np.zeros((2 * len(rows), size + high - low), springs.dtype)  # as seen from ball j of each kind, then ball i
        for kind, step in enumerate(steps):
            held[kind, step - low : step - low + size] = flat[kind, first:end]
        held[len(rows) :, -low : size - low] = flat[:, first:end]
        found = np.empty((len(sums), held.shape[1]), springs.dtype)
        multiply_columns(combine, held, found)
        near = sums[:, first + low : end + high]
        np.add(near, found, out=near)
    blocks = rooms.fold(room)
    blocks += extra.reshape(-1, *(1,) * len(rooms.shape))
    parts = np.split(blocks, np.cumsum([len(pairs) for pairs in own])[:-1])
    return [_spread(part, group.stop - group.start, springs.dtype) for part, group in zip(parts, groups, strict=True)]


def _spread(entries: Array, size: int, precision: DTypeLike) -> Array:
    """Return the (size, size, ...) inverses of symmetric matrices, whose upper triangles are ``entries``, row after row."""
    _invert_symmetric(entries, size)
    out = np.empty((size, size, *entries.shape[1:]), precision)
    for entry, (a, b) in zip(entries, combinations_with_replacement(range(size), 2), strict=True):
        out[a, b] = out[b, a] = entry
    return out


def _invert_symmetric(entries: Array, size: int) -> None:
    """Invert symmetric matrices of one to three rows in place; ``entries`` are the upper triangle, row after row."""
    if size == 1:
        entries[0] = 1.0 / entries[0]
    elif size == 2:
        xx, xy, yy = entries
        one_over = 1.0 / (xx * yy - xy * xy)
        entries[0], entries[2] = yy * one_over, xx * one_over
        xy *= -one_over
    else:
        xx, xy, xz, yy, yz, zz = entries
        first, second, third = yy * zz - yz * yz, xz * yz - xy * zz, xy * yz - xz * yy
        one_over = 1.0 / (xx * first + xy * second + xz * third)
        inverse = first, second, third, xx * zz - xz * xz, xy * xz - xx * yz, xx * yy - xy * xy
        for entry, value in zip(entries, inverse, strict=True):
            entry[...] = value * one_over
