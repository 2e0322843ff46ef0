"""The dynamical matrix of an array of balls without a matrix: shifts of whole arrays, and small products of matrices.

The deformations of all contacts of a kind are the difference of two combinations of motions, one of ball j and one of ball
i, and ball j is one step along the flattened array away (:mod:`granphon.array.rooms`). The array is worked on in parts that
stay in the processor's cache: combinations of motions by one product of matrices, differences and stiffnesses contact by
contact, and forces on balls by another product. Several vectors at once are left to the sparse matrix, which is read once
for all of them, and is then faster.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from functools import cached_property
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from granphon.array.rooms import Rooms
from granphon.networks.network import ContactNetwork
from granphon.waves.operator import WaveOperator

Array = NDArray[np.float64]
#: number of balls, of each kind in the cell, that are worked on at a time
_PART = 2**13
#: parts are at least this many times as long as the longest step of a contact, beyond which work is done twice
_LONG = 4
#: relative difference of numbers that are equal but for rounding
_ALIKE = 1e-12
#: number of balls below which a sparse matrix is faster
_LEAST_BALLS = 2500
#: relative difference of multiples of a number that rounding explains
_ROUNDING = 8.0 * float(np.finfo(np.float64).eps)


def make_operator(network: ContactNetwork) -> WaveOperator:
    """Return D of a network: by stencils if it is a large enough array of equal masses, else by a sparse matrix."""
    kinds = find_kinds(network) if network.n_balls >= _LEAST_BALLS else None
    return WaveOperator(network) if kinds is None else ArrayOperator(network, kinds)


def find_kinds(network: ContactNetwork) -> NDArray[np.intp] | None:
    """Return (n_c,) the row of each contact in the table of the lattice; None if the network is not such an array.

    Contacts must have the directions and arms of the lattice, each from ball i to ball j of the table; masses must be equal,
    and there must be no prestress. An array so short that a ball touches another twice is not treated as one.
    """
    lattice, shape = network.lattice, network.shape
    if lattice is None or shape is None or network.prestress or min(shape) < 3:
        return None
    table, n, p = lattice.contacts, lattice.n_balls, lattice.periods
    if network.n_balls != n * math.prod(shape) or not (_is_one(network.masses) and _is_one(network.inertias)):
        return None
    cells = [np.stack(np.unravel_index(ball // n, shape), axis=-1) for ball in (network.i, network.j)]
    step = cells[1] + network.shift[:, :p] * np.array(shape) - cells[0]
    kinds = np.full(network.n_contacts, -1)
    for kind, (i, j, shift) in enumerate(zip(table.i.tolist(), table.j.tolist(), table.shift, strict=True)):
        kinds[(network.i % n == i) & (network.j % n == j) & np.all(step == shift, axis=1)] = kind
    if np.any(kinds < 0) or len(set((kinds * network.n_balls + network.i).tolist())) < kinds.size:
        return None
    normal = np.zeros((len(table), 3))
    normal[:, : table.normal.shape[1]] = table.normal
    fine = np.max(np.abs(network.normal - normal[kinds]), initial=0.0) <= _ALIKE
    for own, arm in ((network.arm_i, table.arm_i), (network.arm_j, table.arm_j)):
        fine = fine and _is_one(own / arm[kinds])
    return kinds if fine else None


def _is_one(values: Array) -> bool:
    """Whether all values are the same, but for rounding, and finite."""
    return bool(np.all(np.isfinite(values)) and np.ptp(values) <= _ALIKE * np.max(np.abs(values), initial=0.0))


class _Kind(NamedTuple):
    """A kind of deformation of one kind of contact.

    ``head`` and ``tail`` are rows of the first product, of which ball j and ball i have one each; ``step`` leads from i to j
    in the flat array; ``springs`` is the index of the stiffnesses, and ``ratio`` the factor before them.
    """

    head: int
    tail: int
    step: int
    springs: int
    ratio: float


class ArrayOperator(WaveOperator):
    """D of an array of equal masses; vectors run over the motions of the balls of a cell, and for each over all cells."""

    def __init__(self, network: ContactNetwork, kinds: NDArray[np.intp]) -> None:
        super().__init__(network)
        assert network.lattice is not None  # find_kinds has seen that
        assert network.shape is not None
        self.lattice, self.cells = network.lattice, network.shape
        self._fields = self.lattice.n_balls * self.motions.count
        shifts = [tuple(steps) for steps in self.lattice.contacts.shift.tolist()]
        self._rooms = Rooms(self.cells, [*shifts, *(tuple(-step for step in shift) for shift in shifts)])
        self._buffers: dict[int, tuple[Array, Array, Array, Array, Array]] = {}
        self._make_products(kinds, [self._rooms.offset(shift) for shift in shifts])

    def vector(self, values: ArrayLike) -> NDArray[Any]:
        """Return the vector (size, ...) of values (n, motions, ...) of balls."""
        values = np.asarray(values)
        by_cell = values.reshape(-1, self._fields, *values.shape[2:])
        return np.ascontiguousarray(by_cell.swapaxes(0, 1)).reshape(self.size, *values.shape[2:])

    def values(self, vector: ArrayLike) -> NDArray[Any]:
        """Return the values (n, motions, ...) of balls in a vector (size, ...)."""
        vector = np.asarray(vector)
        by_cell = vector.reshape(self._fields, -1, *vector.shape[1:]).swapaxes(0, 1)
        return by_cell.reshape(-1, self.motions.count, *vector.shape[1:])

    # -- making it ----------------------------------------------------------------------------------------------------

    def _make_products(self, kinds: NDArray[np.intp], steps: list[int]) -> None:
        """Make the two products of matrices, the list of kinds, and the springs of all contacts in rooms."""
        table, n, m, network = self.lattice.contacts, self.lattice.n_balls, self.motions.count, self.network
        lines: list[Array] = []  # combinations of motions: one where the two ends are alike, as in elongations, else two
        found: list[_Kind] = []
        springs: list[tuple[int, Array]] = []
        rooms: list[Array] = []
        for kind, (i, j, step) in enumerate(zip(table.i.tolist(), table.j.tolist(), steps, strict=True)):
            own = np.flatnonzero(kinds == kind)
            starts = (network.i if step >= 0 else network.j)[own] // n
            for row in self.rows if own.size else ():
                ends = np.zeros((2, self._fields))
                ends[0, m * j : m * (j + 1)], ends[1, m * i : m * (i + 1)] = row.head[own[0]], row.tail[own[0]]
                if not np.any(ends):
                    continue
                if step < 0:  # taken from its other end, so that it leads forward in the flat array
                    ends = ends[::-1]
                stiffness = np.broadcast_to(row.stiffness, kinds.shape)[own]
                place, ratio = _find_multiple(springs, kind, stiffness)
                same = bool(np.all(ends[0] == ends[1]))
                found.append(_Kind(len(lines), len(lines) + (not same), abs(step), place, ratio))
                lines += [ends[0]] if same else [ends[0], ends[1]]
                if place == len(springs):
                    springs.append((kind, stiffness))
                    of_cell = np.zeros(math.prod(self.cells))
                    of_cell[starts] = stiffness / float(network.masses[0])
                    rooms.append(self._pad(of_cell))
        self._springs = np.array(rooms)
        self._combine = np.array(lines)
        # kinds with one combination for both ends come first; columns of forces: those of heads, then those of tails, then x
        self._kinds = sorted(found, key=lambda one: one.head != one.tail)
        self._alike = sum(one.head == one.tail for one in found)
        columns = [one.ratio * self._combine[one.head] for one in self._kinds]
        columns += [-one.ratio * self._combine[one.tail] for one in self._kinds[self._alike :]]
        self._return = np.hstack([np.array(columns).T, np.zeros((self._fields, self._fields))])
        self._reach = max(one.step for one in found)

    def _pad(self, values: Array) -> Array:
        """Return values of cells with their images, as a flat room."""
        room = self._rooms.fill(values.reshape(1, *self.cells))
        self._rooms.wrap(room)
        return room.ravel()

    # -- the product --------------------------------------------------------------------------------------------------

    @cached_property
    def _stride(self) -> int:
        """Length of a layer of the first axis in the flat room."""
        return math.prod(self._rooms.outer[1:])

    @cached_property
    def _layers(self) -> int:
        """Number of layers of the first axis that are worked on at a time."""
        return min(self.cells[0], max(1, max(_PART, _LONG * self._reach) // self._stride))

    def _make_buffers(self, layers: int) -> tuple[Array, Array, Array, Array, Array]:
        """Return space for a part: room and forces (fields, flat), combinations of motions, tensions, forces by contact."""
        if layers not in self._buffers:
            size = self._stride * (layers + self._rooms.below[0] + self._rooms.above[0])
            counts = (self._fields, self._fields, len(self._combine), 1, self._return.shape[1])
            room, out, combined, tension, pull = (np.zeros((count, size)) for count in counts)
            self._buffers[layers] = room, out, combined, tension[0], pull
        return self._buffers[layers]

    def _multiply(self, x: Array, scale: float, less: float) -> Iterator[tuple[slice, Array]]:
        """Yield ``scale`` D x - ``less`` x for some layers of cells after the other, (fields, layers, L2, ...).

        ``x`` is (fields, L1, ..., Lp). What was yielded is overwritten by the next.
        """
        rooms, count = self._rooms, len(self._kinds)
        back = scale * self._return
        back[:, -self._fields :] = -less * np.eye(self._fields)
        across = rooms.inner[2:]
        for start in range(0, self.cells[0], self._layers):
            stop = min(start + self._layers, self.cells[0])
            flat, out, combined, tension, pull = self._make_buffers(stop - start)
            shape = (self._fields, -1, *rooms.outer[1:])
            room, inside = flat.reshape(shape), slice(rooms.below[0], rooms.below[0] + stop - start)
            for low, high, there in self._find_layers(start, stop):
                room[(slice(None), there, *across)] = x[:, low:high]
            rooms.wrap(room, first=1)
            # the product of all cells from the first to the last one of these layers
            np.matmul(self._combine, flat, out=combined)
            first = rooms.offset(rooms.below)
            end = flat.shape[1] - rooms.offset(rooms.above)
            size, tail = end - first, count - self._alike
            for place, kind in enumerate(self._kinds):
                # tensions of contacts that start on [first - step, end)
                low, one = first - kind.step, tension[: size + kind.step]
                np.subtract(combined[kind.head, first : end + kind.step], combined[kind.tail, low:end], out=one)
                one *= self._springs[kind.springs, start * self._stride + low : start * self._stride + end]
                behind, ahead = one[:size], one[kind.step :]
                if place < self._alike:
                    np.subtract(behind, ahead, out=pull[place, :size])
                else:
                    pull[place, :size], pull[tail + place, :size] = behind, ahead
            pull[-self._fields :, :size] = flat[:, first:end]
            np.matmul(back, pull[:, :size], out=out[:, first:end])
            yield slice(start, stop), out.reshape(shape)[(slice(None), inside, *across)]

    def _find_layers(self, start: int, stop: int) -> Iterator[tuple[int, int, slice]]:
        """Yield (low, high, there): layers of cells, and the part of the room of [start, stop) where they are wanted."""
        length, below = self.cells[0], self._rooms.below[0]
        at = start - below
        while at < stop + self._rooms.above[0]:
            low = at % length
            high = min(length, low + stop + self._rooms.above[0] - at)
            yield low, high, slice(at - start + below, at - start + below + high - low)
            at += high - low

    def advance(self, current: Array, previous: Array) -> Array:
        """Return the next Chebyshev polynomial, see :meth:`WaveOperator.advance`."""
        if current.ndim > 1:
            return super().advance(current, previous)
        shape = (self._fields, *self.cells)
        target = previous.reshape(shape)
        for layers, found in self._multiply(current.reshape(shape), 4.0 / self.top**2, 2.0):
            np.subtract(found, target[:, layers], out=target[:, layers])
        return previous

    def _matvec(self, x: NDArray[Any]) -> NDArray[Any]:
        x = np.ravel(x)
        if np.iscomplexobj(x):
            return np.asarray(self._matvec(x.real) + 1j * self._matvec(x.imag))
        out = np.empty((self._fields, *self.cells))
        for layers, found in self._multiply(x.reshape(out.shape), 1.0, 0.0):
            out[:, layers] = found
        return out.ravel()


def _find_multiple(springs: list[tuple[int, Array]], kind: int, stiffness: Array) -> tuple[int, float]:
    """Return the place among ``springs`` of those that ``stiffness`` is a multiple of, and the factor; else a new place."""
    for place, (other, known) in enumerate(springs):
        if other == kind and np.all(known > 0.0):
            ratio = stiffness / known
            if np.ptp(ratio) <= _ROUNDING * ratio[0]:
                return place, float(ratio[0])
    return len(springs), 1.0
