"""Periodic arrays with ghost cells around them, so that every neighbour of a ball is in the same array.

The ghost cells are as many as the longest shift of a contact is long, on either side. In the flattened array a shift along
the lattice is one number, so that what all contacts of a kind need are two slices of one long array, whatever the number of
dimensions.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from typing import Any

import numpy as np
from numpy.typing import DTypeLike, NDArray

Array = NDArray[np.float64]


class Halo:
    """Ghost cells of periodic arrays of ``shape`` (L1, ..., Lp) with contacts of these ``shifts``.

    Attributes
    ----------
    below, above : numbers of ghost layers on the two sides of each axis.
    outer : shape (P1, ..., Pp) with ghost cells.
    inner : index of the array inside it.
    """

    def __init__(self, shape: Sequence[int], shifts: Sequence[Sequence[int]]) -> None:
        self.shape = tuple(shape)
        along = list(zip(*shifts, strict=True))
        self.below = tuple(max(0, -min(steps)) for steps in along)
        self.above = tuple(max(0, *steps) for steps in along)
        self.outer = tuple(sum(widths) for widths in zip(self.below, self.shape, self.above, strict=True))
        self._strides = [math.prod(self.outer[axis + 1 :]) for axis in range(len(self.outer))]
        inside = (slice(low, low + size) for low, size in zip(self.below, self.shape, strict=True))
        self.inner: tuple[Any, ...] = (..., *inside)

    def offset(self, shift: Sequence[int]) -> int:
        """Return the distance of a shift along the lattice in the flattened array."""
        return sum(step * stride for step, stride in zip(shift, self._strides, strict=True))

    def surround(self, parts: Sequence[NDArray[np.floating]], precision: DTypeLike) -> Array:
        """Return parts (n, L1, ..., Lp), one after the other, in one array with their images in the ghost cells."""
        out, at = np.empty((sum(map(len, parts)), *self.outer), precision), 0
        for part in parts:
            out[at : at + len(part)][self.inner] = part
            at += len(part)
        for image, cell in self.images(out, 0):
            image[...] = cell
        return out

    def images(self, array: Array, first: int) -> Iterator[tuple[Array, Array]]:
        """Yield views of ghost layers and of the layers that they repeat, axis after axis from ``first`` on."""
        for axis in range(first, len(self.shape)):
            below, size, above = self.below[axis], self.shape[axis], self.above[axis]
            rest: tuple[Any, ...] = (slice(None),) * (len(self.shape) - 1 - axis)
            for done in range(0, above, size):  # more ghost layers than the array has repeat it more than once
                count, end = min(size, above - done), below + size + done
                yield array[(..., slice(end, end + count), *rest)], array[(..., slice(below, below + count), *rest)]
            for done in range(0, below, size):
                count, start = min(size, below - done), below - done
                last = below + size
                yield array[(..., slice(start - count, start), *rest)], array[(..., slice(last - count, last), *rest)]
