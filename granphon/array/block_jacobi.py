"""Inverses of each ball's own block of C^T K C: how a ball moves under a force while its neighbours are held."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import combinations_with_replacement

import numpy as np
from numpy.typing import DTypeLike, NDArray

from granphon.array.contact_operator import ContactOperator

Array = NDArray[np.float64]


def invert_blocks(operator: ContactOperator, groups: Sequence[slice], stiffness: Array, least: Array) -> list[Array]:
    """Return, for each group of one to three fields that follow each other, the inverses (n, n, L1, ..., Lp) of its blocks.

    ``least`` (rows,) is added to the ``stiffness`` (rows, L1, ..., Lp), so that there is an inverse.
    """
    own = [list(combinations_with_replacement(range(group.start, group.stop), 2)) for group in groups]
    first_of, second_of = np.array([pair for pairs in own for pair in pairs]).T
    ends = np.array([operator.head, operator.tail])
    squares = ends[..., first_of] * ends[..., second_of]
    # inverted in double precision: where few contacts hold a ball, its block is nearly singular
    blocks = operator.collect(np.concatenate(squares).T, [stiffness]).astype(float)
    blocks += np.einsum("r,erp->p", least, squares).reshape(-1, *(1,) * len(operator.shape))
    parts = np.split(blocks, np.cumsum([len(pairs) for pairs in own])[:-1])
    return [_spread(part, group.stop - group.start, stiffness.dtype) for part, group in zip(parts, groups, strict=True)]


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
