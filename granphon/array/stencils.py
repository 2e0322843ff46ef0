"""The compatibility matrix of a large periodic array of balls, as stencils on lattice arrays.

The array is L1 x ... x Lp cells of a lattice with p periods. Motions are arrays (fields, L1, ..., Lp): for each ball of the
cell first the projections of its displacement on p normals of the contact table, so that many elongations are plain
differences; then, if contacts resist them, its rotations. Deformations of contacts are arrays (rows, L1, ..., Lp): the
elongation of each kind of contact, then its slips, twist and rolls, stored at the cell of ball i, from which the contact
starts. No matrix is stored: C and its transpose are shifts of whole arrays. The inverse of C^T C for equal contacts, the
lattice Green's function, is a product in Fourier space.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Sequence
from copy import copy
from functools import cached_property
from itertools import pairwise
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import DTypeLike, NDArray

from granphon.array.array_rows import ArrayRow, find_basis, make_rows, stack_coefficients
from granphon.array.coupling import Coupling
from granphon.array.green import green_function, green_inverse
from granphon.array.local_inverse import invert_blocks
from granphon.array.rooms import Rooms
from granphon.balls.lattices import TRIANGULAR, Lattice
from granphon.balls.motions import allowed_motions, select_motions
from granphon.dynamics.rows import Row, contact_rows, strain_rows

Array = NDArray[np.float64]
#: number of elements of one array that are worked on at a time, so that they stay in the processor's cache
_CACHED = 2**15
#: stiffness, as a fraction of the mean, that the preconditioner adds to each contact, so that each ball's block has an
#: inverse
_LEAST_LOCAL = 1e-5
#: standard deviation of stiffnesses, over their mean, from which the preconditioner has a part for each ball
_UNEVEN = 0.25


class Motion(NamedTuple):
    """Periodic motion ``balls`` (fields, L1, ..., Lp), and ``compression``, which adds to the overlap of every contact."""

    balls: Array
    compression: float


class Stencils:
    """Compatibility matrix C of an array of ``shape`` (L1, ..., Lp) cells of a lattice; the unit of length is the diameter.

    With a ``mindlin_ratio`` eta, a ``torsion`` or a ``bending`` (over k d^2) above zero, C has slips, twists and rolls too,
    and rotations. Their stiffness is that multiple of the normal one. ``workers`` threads share each Fourier transform.
    """

    def __init__(
        self,
        shape: tuple[int, ...],
        mindlin_ratio: float = 0.0,
        workers: int = 1,
        lattice: Lattice = TRIANGULAR,
        torsion: float = 0.0,
        bending: float = 0.0,
    ) -> None:
        self.shape = tuple(shape)
        self.mindlin_ratio, self.torsion, self.bending = mindlin_ratio, torsion, bending
        self.workers, self.lattice = workers, lattice
        table, p = lattice.contacts, lattice.periods
        normal = table.normal[:, :p]
        self.motions = select_motions(mindlin_ratio, torsion, bending, next(iter(allowed_motions(p).values())))
        self.n_contacts, self.n_balls = len(table), lattice.n_balls
        self.n_fields = self.n_balls * self.motions.count
        #: indices (i, j) of the balls of the cell that each kind of contact joins
        self.ends = list(zip(table.i.tolist(), table.j.tolist(), strict=True))
        #: number of cells, along each lattice vector, from ball i to ball j of each kind of contact
        self.shifts: list[tuple[int, ...]] = [tuple(steps) for steps in table.shift.tolist()]
        #: (p, p) unit vectors, as rows, on which displacements are projected
        self.basis = find_basis(normal)
        self._kinds = contact_rows(
            normal, table.arm_i, table.arm_j, self.motions, slip=mindlin_ratio, twist=torsion, roll=bending
        )
        self._vector = table.vector[:, :p]
        self._rows = self._make_rows(self._kinds)
        self.rooms = Rooms(self.shape, self.shifts)
        #: Green's function in the precisions that it was needed in
        self._found: dict[Any, Array] = {}

    def _make_rows(self, kinds: Sequence[Row]) -> list[ArrayRow]:
        return [row for kind in kinds for row in make_rows(kind, self.shifts, self.ends, self.basis)]

    def observe(self, kinds: Sequence[Row]) -> Stencils:
        """Return stencils of the same motions that have these kinds of deformation instead of their own."""
        other = copy(self)
        other._found = {}
        other.forget()
        vars(other).pop("coefficients", None)
        other._kinds = list(kinds)
        other._rows = self._make_rows(kinds)
        return other

    def __reduce__(self) -> tuple[Any, ...]:
        # Green's function is not pickled: it is large, and quickly computed again
        return Stencils, (self.shape, self.mindlin_ratio, self.workers, self.lattice, self.torsion, self.bending)

    def forget(self) -> None:
        """Drop what is larger than the array and quickly computed again from memory: Green's function, and the coupling."""
        self._found.clear()
        for name in ("_green", "coupling"):
            vars(self).pop(name, None)

    @cached_property
    def coefficients(self) -> Array:
        """(2, rows, fields) coefficients of the motions of ball j in each kind of deformation, and then those of ball i."""
        return stack_coefficients(self._rows, self.n_fields)

    @cached_property
    def coupling(self) -> Coupling:
        """C and its transpose by products of matrices."""
        return Coupling(self._rows, self.shape, self.n_contacts, self.n_fields)

    @property
    def rows(self) -> list[ArrayRow]:
        """Kinds of deformation, each with its row of C for the two balls of a contact."""
        return self._rows

    @property
    def n_rows(self) -> int:
        """Number of kinds of deformation."""
        return len(self._rows)

    @property
    def ball_shape(self) -> tuple[int, ...]:
        """Shape of an array with one number for each ball: (L1, ..., Lp), or (balls, L1, ..., Lp) of several in the cell."""
        return self.shape if self.n_balls == 1 else (self.n_balls, *self.shape)

    def by_ball(self, values: Array) -> Array:
        """Return an array of :attr:`ball_shape` with the ball of the cell as its first axis, (balls, L1, ..., Lp)."""
        return values.reshape(self.n_balls, *self.shape)

    def weights(self, stiffness: Array) -> Array:
        """Return (rows, L1, ..., Lp) stiffnesses of all deformations, from those of elongations (contacts, L1, ..., Lp)."""
        if self.n_rows == self.n_contacts:
            return stiffness
        return np.concatenate([float(kind.stiffness) * stiffness for kind in self._kinds])

    def strains(self) -> Array:
        """Return (rows, p, p) deformations of all contacts under unit displacement gradients u_a,b, without rotation."""
        return np.concatenate([strain_rows(kind, self._vector, self.motions) for kind in self._kinds])

    # -- C and its transpose ----------------------------------------------------------------------------------------

    def padded(self, dtype: DTypeLike = float) -> Array:
        """Return rooms for a motion, to be filled by :meth:`Rooms.wrap`."""
        return self.rooms.zeros(self.n_fields, dtype)

    def blocks(self, arrays: int = 1) -> Iterator[slice]:
        """Yield slices of rows of balls, each small enough to stay in the processor's cache.

        In space, where contacts are many, this many ``arrays`` stay there together; in a plane larger blocks are as fast.
        """
        many = arrays if len(self.shape) == 3 else 1
        step = max(1, _CACHED // (many * math.prod(self.shape[1:])))
        for low, high in pairwise([*range(0, self.shape[0], step), self.shape[0]]):
            yield slice(low, high)

    def _deform(self, row: ArrayRow, flat: Array, first: int, end: int) -> Array:
        """Return the deformation of one kind in the contacts that start in a part of the flattened room."""
        step = self.rooms.offset(row.shift)
        if row.head == row.tail:
            low = first + min(step, 0)
            part = _combine(row.head, flat, low, end + max(step, 0))
            return part[first + step - low : end + step - low] - part[first - low : end - low]
        return _combine(row.head, flat, first + step, end + step) - _combine(row.tail, flat, first, end)

    def _pull(self, row: ArrayRow, force: Array, flat: Array, first: int, end: int) -> None:
        """Add to ``flat`` the forces on balls due to a tension in the contacts that start in this part of the room."""
        step = self.rooms.offset(row.shift)
        for (ahead, head), (behind, tail) in zip(row.head, row.tail, strict=True):
            part = force if abs(head) == 1.0 else abs(head) * force
            add = np.add if head > 0.0 else np.subtract
            there = flat[ahead, first + step : end + step]
            add(there, part, out=there)
            part = part if abs(tail) == abs(head) else abs(tail) * force
            add = np.subtract if tail > 0.0 else np.add
            there = flat[behind, first:end]
            add(there, part, out=there)

    def deformations(self, motion: Motion) -> Array:
        """Return (rows, L1, ..., Lp) C u, with the compression taken from elongations, which are then losses of overlap."""
        room = self.rooms.fill(motion.balls)
        self.rooms.wrap(room)
        out = np.empty((self.n_rows, *self.rooms.outer))
        flat, found = room.reshape(len(room), -1), out.reshape(len(out), -1)
        for first, end in self.rooms.spans(_CACHED):
            for kind, row in enumerate(self._rows):
                found[kind, first:end] = self._deform(row, flat, first, end)
        inside: Array = out[self.rooms.inner]
        inside[: self.n_contacts] -= motion.compression
        return inside

    def each_row(self, motions: Sequence[Array]) -> Iterator[Array]:
        """Yield (n, L1, ..., Lp) deformations of one kind after the other, under each of n motions (fields, L1, ..., Lp)."""
        rooms = [self.rooms.fill(balls) for balls in motions]
        for room in rooms:
            self.rooms.wrap(room)
        flats = [room.reshape(len(room), -1) for room in rooms]
        out = self.rooms.zeros(len(rooms))
        found = out.reshape(len(out), -1)
        for row in self._rows:
            for first, end in self.rooms.spans(_CACHED):
                for place, flat in enumerate(flats):
                    found[place, first:end] = self._deform(row, flat, first, end)
            yield out[self.rooms.inner]

    def forces(self, contacts: Array) -> Array:
        """Return (fields, L1, ..., Lp) C^T f, the forces on balls in the coordinates of their motion, for a tension f."""
        room = self.padded()
        flat = room.reshape(len(room), -1)
        for kind, row in enumerate(self._rows):
            tension = self.rooms.fill(contacts[kind : kind + 1]).ravel()
            for first, end in self.rooms.spans(_CACHED):
                self._pull(row, tension[first:end], flat, first, end)
        return self.rooms.fold(room)

    def around(self, contacts: Array) -> Array:
        """Return sums of the values (contacts, L1, ..., Lp) over the contacts of each ball, of :attr:`ball_shape`."""
        out = np.zeros((self.n_balls, *self.shape), contacts.dtype)
        axes = tuple(range(len(self.shape)))
        for one, shift, (i, j) in zip(contacts, self.shifts, self.ends, strict=True):
            out[i] += one
            out[j] += np.roll(one, shift, axes)
        return out.reshape(self.ball_shape)

    def average_around(self, contacts: Array) -> Array:
        """Return means of the values (contacts, L1, ..., Lp) over the contacts of each ball, of :attr:`ball_shape`."""
        counts = np.bincount(np.ravel(self.ends), minlength=self.n_balls).astype(float)
        means = self.by_ball(self.around(contacts)) / counts.reshape(-1, *(1,) * len(self.shape))
        return np.asarray(means.reshape(self.ball_shape))

    def average_pairs(self, values: Array) -> Array:
        """Return (contacts, L1, ..., Lp) means over the two balls of each contact, of values of :attr:`ball_shape`."""
        balls, axes = self.by_ball(values), tuple(range(len(self.shape)))
        pairs = zip(self.shifts, self.ends, strict=True)
        return np.stack([0.5 * (balls[i] + np.roll(balls[j], [-step for step in shift], axes)) for shift, (i, j) in pairs])

    def displacements(self, balls: Array) -> Array:
        """Return (p, *ball_shape) displacements along the axes of space, from their projections."""
        return self._turn(np.asarray(np.linalg.inv(self.basis), float), balls)

    def cartesian(self, forces: Array) -> Array:
        """Return (p, *ball_shape) forces along the axes of space, from those in the coordinates of motions."""
        return self._turn(self.basis.T, forces)

    def _turn(self, matrix: Array, fields: Array) -> Array:
        """Apply a (p, p) matrix to the displacements, or to the forces against them, of each ball."""
        balls = fields.reshape(self.n_balls, self.motions.count, *self.shape)[:, self.motions.translating]
        return np.asarray(np.einsum("ka,ba...->kb...", matrix, balls).reshape(len(matrix), *self.ball_shape))

    def balance(self, balls: Array, tension: Callable[[int, slice, Array], Array]) -> Array:
        """Return (fields, L1, ..., Lp) C^T f, for a tension f that depends on the deformations C u.

        ``tension(kind, part, deformations)`` gives that of one kind in a part of the flattened room; in the margins it has
        to be zero. The deformations are its own, to write on.
        """
        room = self.rooms.fill(balls)
        self.rooms.wrap(room)
        return self._balance(room, tension, np.zeros_like(room))

    def _balance(self, room: Array, tension: Callable[[int, slice, Array], Array], out: Array) -> Array:
        flat, forces = room.reshape(len(room), -1), out.reshape(len(out), -1)
        for first, end in self.rooms.spans(_CACHED):
            part = slice(first, end)
            for kind, row in enumerate(self._rows):
                self._pull(row, tension(kind, part, self._deform(row, flat, first, end)), forces, first, end)
        return self.rooms.fold(out)

    def product(self, stiffness: Array, room: Array, compression: float | None, out: Array) -> tuple[Array, float, float]:
        """Apply C^T K C to a motion in a wrapped ``room``; ``stiffness`` is in rooms with margins of zeros.

        Returns the forces on balls, as a view of ``out``; the sum of K e over elongations, unless the compression is None;
        and that of K e^2 over all rows.
        """
        out[...] = 0.0
        springs = stiffness.reshape(len(stiffness), -1)
        pull = energy = 0.0

        def tension(kind: int, part: slice, change: Array) -> Array:
            nonlocal pull, energy
            pressed = compression is not None and kind < self.n_contacts
            if pressed and compression:
                change -= compression
            force = springs[kind, part] * change
            energy += dot(force, change)
            if pressed:
                pull += float(np.sum(force))
            return force

        return self._balance(room, tension, out), pull, energy

    # -- solving ----------------------------------------------------------------------------------------------------

    @cached_property
    def _green(self) -> tuple[tuple[Any, ...], ...]:
        """Inverse of C^T K C of equal contacts of stiffness one, in Fourier space; see :func:`green_function`."""
        return green_function(self._rows, self.shape, self.motions.is_rotation.tolist() * self.n_balls, self.n_balls)

    def preconditioner(self, stiffness: Array, springs: Array | None = None) -> Callable[[Array], Array]:
        """Return an approximate inverse of C^T K C: Green's function of the mean stiffness, plus each ball's own inverse.

        The first carries stress across the array; the second accounts for balls that are held weakly. ``stiffness`` is
        (rows, L1, ..., Lp); ``springs`` is the same in rooms, if that is at hand. Where contacts are nearly alike, Green's
        function alone is as good. The inverse is as precise as the stiffness, single or double.
        """
        normal = stiffness[: self.n_contacts]
        mean = float(np.mean(normal))
        carry = self.carry(stiffness.dtype, mean)
        if float(np.std(normal)) <= _UNEVEN * mean:
            return carry
        relax = self.relax(stiffness, springs)

        def apply(force: Array) -> Array:
            out = carry(force)
            relax(force, out)
            return out

        return apply

    def carry(self, precision: DTypeLike, stiffness: float) -> Callable[[Array], Array]:
        """Return the inverse of C^T K C for contacts of equal ``stiffness``: Green's function."""
        # with one ball in the cell Green's function is real, that of rotations times i: it takes the real and the imaginary
        # parts of waves, which follow each other in memory
        real = self.n_balls == 1
        kind = np.result_type(precision, 1.0 if real else 1j)
        if kind not in self._found:
            green = np.array(self._green).astype(kind)
            self._found[kind] = np.repeat(green, 2, axis=-1) if real else green
        turning = self.motions.turning if real else slice(0, 0)
        blocks = list(self.blocks(self.n_fields)) if len(self.shape) > 1 else [slice(None)]
        return green_inverse(self._found[kind], kind.type(1.0 / stiffness), turning, self.shape, blocks, self.workers)

    def relax(self, stiffness: Array, springs: Array | None = None) -> Callable[[Array, Array], None]:
        """Return what adds to ``out`` the motion of each ball under a ``force`` while its neighbours are held.

        Displacements and rotations are taken apart; see :meth:`preconditioner` for the arguments.
        """
        least = _LEAST_LOCAL * float(np.mean(stiffness[: self.n_contacts]))
        rooms = self.rooms.fill(stiffness) if springs is None else springs
        local = list(zip(self._groups, invert_blocks(self._rows, self.rooms, self._groups, rooms, least), strict=True))
        blocks = list(self.blocks(self.n_fields))

        def add(force: Array, out: Array) -> None:
            for rows in blocks:
                for fields, block in local:
                    there = out[fields, rows]
                    np.add(there, np.einsum("ab...,b...->a...", block[:, :, rows], force[fields, rows]), out=there)

        return add

    @cached_property
    def _groups(self) -> list[slice]:
        """Fields of the displacements, and those of the rotations, of each ball of the cell."""
        count, parts = self.motions.count, (self.motions.translating, self.motions.turning)
        groups = [range(count)[part] for part in parts if range(count)[part]]
        return [
            slice(ball * count + group.start, ball * count + group.stop) for ball in range(self.n_balls) for group in groups
        ]


def dot(first: Array, second: Array) -> float:
    """Return the sum of products, without BLAS: its threads wait for each other, and their number changes the last digit."""
    axes = "abcde"[: first.ndim]
    return float(np.einsum(f"{axes},{axes}->", first, second))


def _combine(coefficients: Sequence[tuple[int, float]], flat: Array, first: int, end: int) -> Array:
    """Return the sum of fields times their coefficients in a part of the flattened room.

    A single field with coefficient one is returned without a copy.
    """
    field, factor = coefficients[0]
    total = flat[field, first:end] if factor == 1.0 else factor * flat[field, first:end]
    for at, (field, factor) in enumerate(coefficients[1:]):
        part = flat[field, first:end] if abs(factor) == 1.0 else abs(factor) * flat[field, first:end]
        combine = np.add if factor > 0.0 else np.subtract
        total = combine(total, part, out=total if at or coefficients[0][1] != 1.0 else None)
    return total
