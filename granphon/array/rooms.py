"""Arrays of balls with a margin of periodic images around them, so that every neighbour of a ball is in the same array.

An array (..., L1, ..., Lp) of balls sits inside a *room* (..., P1, ..., Pp). The margins are as wide as the longest shift
of a contact, to either side. In the flattened room a shift along the lattice is one number, so that what all contacts of a
kind need are two slices of one long array, whatever the number of dimensions.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from functools import cached_property
from itertools import pairwise
from types import EllipsisType

import numpy as np
from numpy.typing import DTypeLike, NDArray

Array = NDArray[np.float64]
Layer = tuple[EllipsisType | slice, ...]


class Rooms:
    """Geometry of the rooms of periodic arrays of ``shape`` (L1, ..., Lp) with contacts of these ``shifts``."""

    def __init__(self, shape: Sequence[int], shifts: Sequence[Sequence[int]]) -> None:
        self.shape = tuple(shape)
        along = list(zip(*shifts, strict=True))
        #: widths of the margins below and above, along each axis
        self.below = tuple(max(0, -min(steps)) for steps in along)
        self.above = tuple(max(0, *steps) for steps in along)
        self.outer = tuple(sum(widths) for widths in zip(self.below, self.shape, self.above, strict=True))
        self._strides = [math.prod(self.outer[axis + 1 :]) for axis in range(len(self.outer))]
        inner = tuple(slice(low, low + size) for low, size in zip(self.below, self.shape, strict=True))
        #: index of the array inside its room
        self.inner: tuple[EllipsisType | slice, ...] = (..., *inner)
        self._first = self.offset(self.below)
        self._end = self.offset([part.stop - 1 for part in inner]) + 1

    def offset(self, shift: Sequence[int]) -> int:
        """Return the distance of a shift along the lattice in the flattened room."""
        return sum(step * stride for step, stride in zip(shift, self._strides, strict=True))

    def zeros(self, count: int, dtype: DTypeLike = float) -> Array:
        """Return ``count`` empty rooms, (count, P1, ..., Pp)."""
        return np.zeros((count, *self.outer), dtype)

    def fill(self, values: Array) -> Array:
        """Return rooms that hold ``values`` (count, L1, ..., Lp), with margins of zeros."""
        rooms = self.zeros(len(values), values.dtype)
        rooms[self.inner] = values
        return rooms

    def surround(self, parts: Sequence[Array], precision: DTypeLike) -> Array:
        """Return rooms that hold parts (n, L1, ..., Lp), one after the other, and their images in the margins."""
        rooms, at = np.empty((sum(map(len, parts)), *self.outer), precision), 0
        for part in parts:
            rooms[at : at + len(part)][self.inner] = part
            at += len(part)
        self.wrap(rooms)
        return rooms

    @cached_property
    def inside(self) -> Array:
        """(P1, ..., Pp) one where balls are, and zero in the margins."""
        ones: Array = self.fill(np.ones((1, *self.shape)))[0]
        return ones

    def wrap(self, rooms: Array, first: int = 0) -> None:
        """Copy the balls to their images in the margins, along the axes from ``first`` on."""
        for image, ball in self.images(rooms, first):
            image[...] = ball

    def fold(self, rooms: Array) -> Array:
        """Add what is in the margins to the balls whose images are there; return a view without the margins."""
        for image, ball in reversed(list(self.images(rooms))):
            ball += image
        return rooms[self.inner]

    def images(self, rooms: Array, first: int = 0) -> Iterator[tuple[Array, Array]]:
        """Yield views of layers of the margins and of those that they repeat, axis after axis from ``first`` on."""
        for image, ball in (pair for axis in self._layers[first:] for pair in axis):
            yield rooms[image], rooms[ball]

    @cached_property
    def _layers(self) -> list[list[tuple[Layer, Layer]]]:
        """Indices of layers of the margins, and of those that they repeat, for each axis."""
        found = []
        for axis, (below, size, above) in enumerate(zip(self.below, self.shape, self.above, strict=True)):
            pairs = []
            for done in range(0, above, size):  # a margin wider than the array repeats it more than once
                count = min(size, above - done)
                pairs.append((self._layer(axis, below + size + done, count), self._layer(axis, below, count)))
            for done in range(0, below, size):
                count = min(size, below - done)
                images = self._layer(axis, below - done - count, count)
                pairs.append((images, self._layer(axis, below + size - count, count)))
            found.append(pairs)
        return found

    def _layer(self, axis: int, first: int, count: int) -> Layer:
        return (..., slice(first, first + count), *(slice(None),) * (len(self.shape) - 1 - axis))

    def spans(self, size: int) -> Iterator[tuple[int, int]]:
        """Yield (first, end) of parts of the flattened room that together hold all balls, each of at most ``size``."""
        yield from pairwise([*range(self._first, self._end, size), self._end])
