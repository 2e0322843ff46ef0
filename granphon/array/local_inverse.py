"""Inverses of each ball's own block of C^T K C: how a ball moves under a force while its neighbours are held."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import combinations_with_replacement

import numpy as np
from numpy.typing import NDArray

from granphon.array.array_rows import ArrayRow
from granphon.array.rooms import Rooms

__all__ = ["invert_blocks"]

Array = NDArray[np.float64]
#: number of elements of a kind of contact that are worked on at a time
_CACHED = 2**13


def invert_blocks(rows: Sequence[ArrayRow], rooms: Rooms, fields: slice, springs: Array, least: float) -> Array:
    """Return (n, n, L1, ..., Lp) inverses of the blocks of n fields, one to three that follow each other.

    ``springs`` are the stiffnesses of all rows in rooms with margins of zeros. To each, ``least`` times that of its kind is
    added, so that there is an inverse.
    """
    own = range(fields.start, fields.stop)
    pairs = list(combinations_with_replacement(own, 2))
    ends = [[dict(row.head) for row in rows], [dict(row.tail) for row in rows]]
    squares = np.array([[end.get(a, 0.0) * end.get(b, 0.0) for a, b in pairs] for kinds in ends for end in kinds])
    squares = squares.reshape(2, len(rows), len(pairs))
    extra = least * np.einsum("r,erp->p", [row.ratio for row in rows], squares)
    flat, steps = springs.reshape(len(rows), -1), [rooms.offset(row.shift) for row in rows]
    # in double precision: where few contacts hold a ball, its block is nearly singular
    room = rooms.zeros(len(pairs))
    sums = room.reshape(len(pairs), -1)
    head, tail = squares.astype(springs.dtype)
    for first, end in rooms.spans(_CACHED):
        part = flat[:, first:end]
        sums[:, first:end] += np.einsum("rp,rx->px", tail, part)
        for kind, step in enumerate(steps):
            sums[:, first + step : end + step] += head[kind][:, None] * part[kind]
    held = rooms.fold(room) + extra.reshape(-1, *(1,) * len(rooms.shape))
    _invert_symmetric(held, len(own))
    held = held.astype(springs.dtype, copy=False)
    where = {pair: slot for slot, pair in enumerate(pairs)}
    return np.stack([np.stack([held[where[min(a, b), max(a, b)]] for b in own]) for a in own])


def _invert_symmetric(entries: Array, size: int) -> None:
    """Invert symmetric matrices of one to three rows in place; ``entries`` are the upper triangle, row after row."""
    if size == 1:
        entries[0] = 1.0 / entries[0]
    elif size == 2:
        xx, xy, yy = entries
        one_over = 1.0 / (xx * yy - xy * xy)
        entries[:] = yy * one_over, -xy * one_over, xx * one_over
    else:
        xx, xy, xz, yy, yz, zz = entries
        first, second, third = yy * zz - yz * yz, xz * yz - xy * zz, xy * yz - xz * yy
        one_over = 1.0 / (xx * first + xy * second + xz * third)
        inverse = first, second, third, xx * zz - xz * xz, xy * xz - xx * yz, xx * yy - xy * xy
        for entry, value in zip(entries, inverse, strict=True):
            entry[...] = value * one_over
