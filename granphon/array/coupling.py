"""C, its transpose, and C^T D C for a D that couples the deformations of each contact, by products of small matrices.

One product of a matrix with all balls gives what the two ends of all contacts contribute to all deformations, another one
the forces on balls; between them stand shifts of whole arrays. It takes fewer passes than to go row by row, as
:mod:`granphon.array.stencils` does, and more memory.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from functools import cached_property
from typing import Any, ClassVar, NamedTuple

import numpy as np
from numpy.typing import DTypeLike, NDArray

from granphon.array.array_rows import ArrayRow, stack_coefficients
from granphon.array.rooms import Rooms

Array = NDArray[np.float64]
Single = NDArray[Any]
#: bytes of what the ends of contacts contribute that are worked on at a time, so that they stay in the processor's cache
_CACHED = 2**20
#: number of products in a product of matrices up to which OpenBLAS takes one thread
_ONE_THREAD = 2**18


class Coupling:
    """C and its transpose, of ``rows`` of deformations that each come for all ``contacts`` of a cell.

    The margins of its rooms hold images of the balls, and images of the contacts between them: so each ball finds all its
    contacts, and nothing has to be added up across the margins.
    """

    def __init__(self, rows: Sequence[ArrayRow], shape: Sequence[int], contacts: int, fields: int) -> None:
        shifts = [row.shift for row in rows[:contacts]]
        both_ways = [tuple(sign * n for n in shift) for shift in shifts for sign in (1, -1)]
        rooms = Rooms(shape, both_ways)
        steps = [rooms.offset(shift) for shift in shifts]
        # the parts of all kinds of contacts are alike: one that begins in the margin and leads away has a far end too
        reach = max(0, *steps) - min(0, *steps) - rooms.offset((0, *rooms.below[1:]))
        layers = -(-reach // rooms.offset((1, *(0,) * (len(shape) - 1))))
        both_ways += [(sign * layers, *(0,) * (len(shape) - 1)) for sign in (1, -1)]
        self.rooms = Rooms(shape, both_ways)
        self.steps = [self.rooms.offset(shift) for shift in shifts]
        head, tail = stack_coefficients(rows, fields)
        self.split, self.join = np.concatenate([head, tail]), np.concatenate([head, -tail]).T.copy()

    def matrices(self, precision: DTypeLike) -> tuple[Single, Single, Single]:
        """Return the two matrices, and a flattened room with ones inside."""
        split, join, inside = (one.astype(precision) for one in (self.split, self.join, self.rooms.inside))
        return split, join, inside.ravel()

    @cached_property
    def is_small(self) -> bool:
        """Whether the array is one part: larger ones gain little by :meth:`stretch` and :meth:`pull`, which take memory."""
        return len(list(self.spans(float))) == 1

    def stretch(self, balls: Array) -> Array:
        """Return (rows, L1, ..., Lp) deformations C u."""
        flat = self._surround([balls])
        half, n, least = len(self.split) // 2, len(self.steps), min(0, *self.steps)
        out = np.empty((half, *self.rooms.outer))
        found = out.reshape(half // n, n, -1)
        for first, end in self.spans(float):
            size, near = end - first, flat[:, first + least : end + max(0, *self.steps)]
            ends = np.empty((2 * half, near.shape[1]))
            multiply_columns(self.split, near, ends)
            heads, tails = ends.reshape(2, -1, n, near.shape[1])
            for at, step in enumerate(self.steps):
                far = slice(step - least, step - least + size)
                np.subtract(heads[:, at, far], tails[:, at, -least : size - least], out=found[:, at, first:end])
        return out[self.rooms.inner].copy()  # what follows is faster with it

    def pull(self, *tensions: Array) -> Array:
        """Return (fields, L1, ..., Lp) C^T f, for tensions that are given in parts (n, L1, ..., Lp), one after the other."""
        flat = self._surround(tensions)
        half, n = len(flat), len(self.steps)
        out = np.empty((len(self.join), *self.rooms.outer))
        forces, by_contact = out.reshape(len(out), -1), flat.reshape(half // n, n, -1)
        for first, end in self.spans(float):
            ends = np.empty((2 * half, end - first))
            heads = ends[:half].reshape(half // n, n, -1)
            for at, step in enumerate(self.steps):
                heads[:, at] = by_contact[:, at, first - step : end - step]
            ends[half:] = flat[:, first:end]
            multiply_columns(self.join, ends, forces[:, first:end])
        return out[self.rooms.inner].copy()

    def spans(self, precision: DTypeLike) -> Iterator[tuple[int, int]]:
        """Yield (first, end) of parts of the flattened room to work on, one after the other."""
        return self.rooms.spans(max(1, _CACHED // (len(self.split) * np.dtype(precision).itemsize)))

    def _surround(self, parts: Sequence[Array]) -> Array:
        """Return values with their images in the margins, as flattened rooms."""
        rooms = self.rooms.surround(parts, float)
        return rooms.reshape(len(rooms), -1)


class _Part(NamedTuple):
    """Views of one part of the flattened room, in which forces on balls are found.

    ``near`` are motions, and ``ends`` (2 rows, ...) is room for what the ends of contacts contribute; ``pairs`` are the
    heads and tails of each contact that has an end in the part. Deformations take the place of tails. ``stiffness`` is the
    diagonal of D for them, ``coupled`` (n, contacts, ...) the rest.
    """

    near: Single
    ends: Single
    pairs: list[tuple[Single, Single]]
    rows: Single
    loss: Single
    slips: Single
    stiffness: Single
    coupled: Single
    gathered: list[tuple[Single, Single]]
    joined: Single
    forces: Single
    own: Single
    inside: Single


class CoupledProduct:
    """Product of C^T D C with motions of balls in single precision.

    D has the ``stiffness`` (contacts, L1, ..., Lp) of contacts, that of their slips ``springs``, and ``turning``, the
    tangential forces, with the sign turned, that follow from a loss of overlap, both (slips, contacts, L1, ..., Lp).
    ``cross`` (1, contacts, L1, ..., Lp) couples two slips, with the sign turned too; it is empty in a plane. Where springs
    do not couple, ``turning`` is empty too, and there may be springs of more deformations than slips.
    """

    _precision: ClassVar[type[np.floating[Any]]] = np.float32

    def __init__(self, coupling: Coupling, stiffness: Array, springs: Array, turning: Array, cross: Array) -> None:
        self._prepare(coupling, len(stiffness), [stiffness, *springs, *turning, *cross])

    def _prepare(self, coupling: Coupling, n: int, law: Sequence[Array]) -> None:
        rooms, precision = coupling.rooms, self._precision
        self._rooms, self._steps = rooms, coupling.steps
        self._split, self._join, self._inside = coupling.matrices(precision)
        given = rooms.surround(law, precision)
        fields, doubled = self._join.shape
        self._room, self._out = np.empty((2, fields, *rooms.outer), precision)
        self._images = list(rooms.images(self._room))
        self._parts = list(self._divide(given.reshape(len(given), -1), n, doubled, coupling.spans(precision)))

    def _divide(self, law: Single, n: int, doubled: int, spans: Iterator[tuple[int, int]]) -> Iterator[_Part]:
        """Yield the parts, which share the room for what the ends of contacts contribute."""
        flat, forces = (one.reshape(len(one), -1) for one in (self._room, self._out))
        steps, half = self._steps, doubled // 2
        least, most = min(0, *steps), max(0, *steps)
        reach, shared = most - least, np.empty(0, law.dtype)
        for first, end in spans:
            # contacts that begin at a place from low to high have an end in this part
            low, high, size = first - most, end - least, end - first
            count = high - low
            shared = shared if shared.size else np.empty(doubled * (count + reach), law.dtype)
            ends = shared[: doubled * (count + reach)].reshape(doubled, -1)
            heads, tails = ends.reshape(2, -1, n, count + reach)
            tails, joined = tails[..., -least : count - least], ends[:, reach : reach + size]
            to = heads[..., reach : reach + size]
            rows, here = ends[half:, -least : count - least], law[:, low:high]
            yield _Part(
                near=flat[:, low + least : high + most],
                ends=ends,
                pairs=[(heads[:, at, step - least : step - least + count], tails[:, at]) for at, step in enumerate(steps)],
                rows=rows,
                loss=rows[:n],
                slips=rows[n:].reshape(-1, n, count),
                stiffness=here[:half],
                coupled=here[half:].reshape(-1, n, count),
                gathered=[(to[:, at], tails[:, at, most - step : most - step + size]) for at, step in enumerate(steps)],
                joined=joined,
                forces=forces[:, first:end],
                own=rows[:n, most : most + size],
                inside=self._inside[first:end],
            )

    def __call__(self, balls: Single, press: float | None) -> tuple[Single, float]:
        """Return the forces (fields, L1, ..., Lp), and the sum of the tensions along normals with the sign turned.

        ``press`` adds to the overlaps of all contacts; without it the sum is not found.
        """
        rooms, total = self._rooms, 0.0
        self._room[rooms.inner] = balls
        for image, ball in self._images:
            image[...] = ball
        for part in self._parts:
            multiply_columns(self._split, part.near, part.ends)
            for head, tail in part.pairs:
                np.subtract(head, tail, out=tail)
            if press:
                np.subtract(part.loss, self._precision(press), out=part.loss)
            self._resist(part)
            for to, tail in part.gathered:
                to[...] = tail
            multiply_columns(self._join, part.joined, part.forces)
            if press is not None:
                total -= float(np.sum(part.own * part.inside))
        return self._out[rooms.inner].copy(), total

    def _resist(self, part: _Part) -> None:
        """Write the tensions, with the sign turned, in the place of deformations."""
        if not len(part.coupled):
            np.multiply(part.rows, part.stiffness, out=part.rows)
            return
        slips = len(part.slips)
        change: Single = part.coupled[:slips] * part.loss  # tangential forces that do not follow from a slip along them
        if len(part.coupled) > slips:
            change += part.coupled[slips:] * part.slips[::-1]
        np.multiply(part.rows, part.stiffness, out=part.rows)
        np.subtract(part.slips, change, out=part.slips)


class SymmetricProduct(CoupledProduct):
    """Product of C^T D C with motions of balls in double precision, for a symmetric D that couples any two deformations.

    ``table`` (m, m, contacts, L1, ..., Lp) is D of each contact.
    """

    _precision = np.float64

    def __init__(self, coupling: Coupling, table: Array) -> None:
        m = range(len(table))
        self._pairs = [(a, b) for a in m for b in m[:a] if np.any(table[a, b])]
        law = [*(table[a, a] for a in m), *(table[pair] for pair in self._pairs)]
        self._prepare(coupling, table.shape[2], law)

    def _resist(self, part: _Part) -> None:
        rows = part.rows.reshape(-1, *part.loss.shape)
        bent = [(a, b, both * rows[b], both * rows[a]) for (a, b), both in zip(self._pairs, part.coupled, strict=True)]
        np.multiply(part.rows, part.stiffness, out=part.rows)
        for a, b, on_a, on_b in bent:
            rows[a] += on_a
            rows[b] += on_b


def multiply_columns(matrix: Single, columns: Single, out: Single) -> None:
    """Write the product of a small matrix with many columns, in parts for which BLAS takes one thread.

    Its threads wait for each other, and their number changes the last digit.
    """
    step = max(1, _ONE_THREAD // matrix.size)
    if columns.shape[1] <= step:
        np.matmul(matrix, columns, out=out)
        return
    for low in range(0, columns.shape[1], step):
        np.matmul(matrix, columns[:, low : low + step], out=out[:, low : low + step])
