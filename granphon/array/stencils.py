"""The compatibility matrix of a large periodic array of balls, as stencils on lattice arrays.

Ball (p, q) of an array of L1 x L2 sits at p a1 + q a2 of the triangular lattice. Motions are arrays (n, L1, L2): first the
projections of the displacement on the first two directions of the contact table, so that elongations are plain differences;
then, if contacts resist slip, the rotation. Deformations of contacts are arrays (rows, L1, L2): the elongation of each kind
of contact, then its slip, stored at the ball i from which the contact starts. No matrix is stored: C and its transpose are
shifts of whole arrays. The inverse of C^T C for equal contacts, the lattice Green's function, is a product in Fourier space.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from functools import cached_property
from itertools import pairwise
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from granphon.balls.lattices import TRIANGULAR
from granphon.balls.motions import select_motions
from granphon.dynamics.rows import contact_rows

__all__ = ["Motion", "Stencils", "dot"]

Array = NDArray[np.float64]
#: number of elements of one array that are worked on at a time, so that they stay in the processor's cache
_CACHED = 2**15
#: stiffness, as a fraction of the mean, that the preconditioner adds to each contact, so that each ball's block has an
#: inverse
_LEAST_LOCAL = 1e-5


class _Row(NamedTuple):
    """A kind of deformation: ``head`` times the motion of ball j, which is ``shift`` away, less ``tail`` times that of i."""

    shift: tuple[int, int]
    head: tuple[float, ...]
    tail: tuple[float, ...]


class Motion(NamedTuple):
    """Periodic motion ``balls`` (n, L1, L2), and the uniform ``compression``, an addition to the overlap of all contacts."""

    balls: Array
    compression: float


class Stencils:
    """Compatibility matrix C of an array of ``shape`` (L1, L2); the unit of length is the diameter.

    With a ``mindlin_ratio`` eta above zero, C has slips and rotations too; the stiffness of slip is eta times the normal
    one. ``workers`` threads share each Fourier transform.
    """

    def __init__(self, shape: tuple[int, ...], mindlin_ratio: float = 0.0, workers: int = 1) -> None:
        self.shape: tuple[int, int] = (shape[0], shape[1])
        self.mindlin_ratio = mindlin_ratio
        self.workers = workers
        table = TRIANGULAR.contacts
        self.motions = select_motions(mindlin_ratio)
        self.n_fields, self.n_contacts = self.motions.count, len(table)
        #: (2, 2) unit vectors, as rows, on which displacements are projected
        self.basis: Array = table.normal[:2]
        #: number of cells, along each lattice vector, from ball i to ball j of each kind of contact
        self.shifts = [(int(a), int(b)) for a, b in table.shift]
        project = np.eye(self.n_fields)
        project[:2, :2] = np.linalg.inv(self.basis)
        rows = contact_rows(table.normal, table.arm_i, table.arm_j, self.motions, slip=mindlin_ratio)
        #: stiffness of elongation and of slip over that of elongation, each for three kinds of contact
        self._ratios = [float(row.stiffness) for row in rows]
        self._rows = [
            _Row(shift, tuple(head), tuple(tail))
            for row in rows
            for shift, head, tail in zip(
                self.shifts,
                _round_coefficients(row.head @ project).tolist(),
                _round_coefficients(row.tail @ project).tolist(),
                strict=True,
            )
        ]

    def __reduce__(self) -> tuple[Any, ...]:
        # Green's function is not pickled: it is large, and quickly computed again
        return Stencils, (self.shape, self.mindlin_ratio, self.workers)

    def forget(self) -> None:
        """Drop Green's function from memory: it is several times as large as the array, and quickly computed again."""
        vars(self).pop("_green", None)

    @property
    def rows(self) -> list[_Row]:
        """Kinds of deformation, each with its row of C for the two balls of a contact."""
        return self._rows

    @property
    def n_rows(self) -> int:
        """Number of kinds of deformation: elongations and slips."""
        return len(self._rows)

    def weights(self, stiffness: Array) -> Array:
        """Return (rows, L1, L2) stiffnesses of all deformations, from those of elongations (3, L1, L2)."""
        return stiffness if len(self._ratios) == 1 else np.concatenate([ratio * stiffness for ratio in self._ratios])

    # -- C and its transpose ----------------------------------------------------------------------------------------

    def padded(self) -> Array:
        """Return zeros for a motion, with one more row and column, to which :meth:`wrap` copies the first ones."""
        return np.zeros((self.n_fields, self.shape[0] + 1, self.shape[1] + 1))

    @staticmethod
    def wrap(room: Array) -> None:
        """Copy the first row and column of a padded array to its last row and column."""
        room[:, -1, :-1] = room[:, 0, :-1]
        room[:, :, -1] = room[:, :, 0]

    @staticmethod
    def _fold(room: Array) -> Array:
        """Add the last row and column of a padded array to its first ones; return a view without the last ones."""
        room[:, 0] += room[:, -1]
        room[:, :-1, 0] += room[:, :-1, -1]
        return room[:, :-1, :-1]

    def blocks(self) -> Iterator[slice]:
        """Yield slices of rows of balls, each small enough to stay in the processor's cache."""
        step = max(1, _CACHED // self.shape[1])
        for low, high in pairwise([*range(0, self.shape[0], step), self.shape[0]]):
            yield slice(low, high)

    def _deform(self, row: _Row, room: Array, rows: slice) -> Array:
        """Return the deformation of one kind, in the contacts that start in these rows of balls."""
        (s1, s2), columns = row.shift, self.shape[1]
        if row.head == row.tail:
            part = _combine(row.head, room[:, rows.start : rows.stop + 1])
            return part[s1 : s1 + rows.stop - rows.start, s2 : s2 + columns] - part[: rows.stop - rows.start, :columns]
        ahead = _combine(row.head, room[:, rows.start + s1 : rows.stop + s1, s2 : s2 + columns])
        return ahead - _combine(row.tail, room[:, rows, :columns])

    def _pull(self, row: _Row, force: Array, room: Array, rows: slice) -> None:
        """Add to ``room`` the forces on balls due to a tension in the contacts that start in these rows of balls."""
        (s1, s2), columns = row.shift, self.shape[1]
        for field, (head, tail) in enumerate(zip(row.head, row.tail, strict=True)):
            if head:
                room[field, rows.start + s1 : rows.stop + s1, s2 : s2 + columns] += _multiply(head, force)
            if tail:
                room[field, rows, :columns] -= _multiply(tail, force)

    def deformations(self, motion: Motion) -> Array:
        """Return (rows, L1, L2) C u, minus the compression in the elongations: the losses of overlap, then the slips."""
        room = self.padded()
        room[:, :-1, :-1] = motion.balls
        self.wrap(room)
        out = np.empty((self.n_rows, *self.shape))
        for rows in self.blocks():
            for kind, row in enumerate(self._rows):
                out[kind, rows] = self._deform(row, room, rows)
        out[: self.n_contacts] -= motion.compression
        return out

    def forces(self, contacts: Array) -> Array:
        """Return (n, L1, L2) C^T f, the forces on balls in the coordinates of their motion, for contacts under tension f."""
        room = self.padded()
        for rows in self.blocks():
            for kind, row in enumerate(self._rows):
                self._pull(row, contacts[kind, rows], room, rows)
        return self._fold(room)

    def around(self, contacts: Array) -> Array:
        """Return (L1, L2) sums of the values (3, L1, L2) over the six contacts of each ball."""
        out: Array = np.zeros_like(contacts[0])
        for one, shift in zip(contacts, self.shifts, strict=True):
            out += one + np.roll(one, shift, (0, 1))
        return out

    def cartesian(self, forces: Array) -> Array:
        """Return (2, L1, L2) forces along x and y, from those in the coordinates of motions."""
        out: Array = np.einsum("ak,a...->k...", self.basis, forces[:2])
        return out

    def displacements(self, balls: Array) -> Array:
        """Return (2, L1, L2) displacements along x and y, from their projections."""
        out: Array = np.einsum("ka,a...->k...", np.linalg.inv(self.basis), balls[:2])
        return out

    def product(self, stiffness: Array, room: Array, compression: float, out: Array) -> tuple[Array, float, float]:
        """Apply C^T K C to a motion in a wrapped ``room``.

        Returns the forces on balls, as a view of ``out``; the sum of K e over elongations; and that of K e^2 over all rows.
        """
        out[...] = 0.0
        pull = energy = 0.0
        for rows in self.blocks():
            for kind, row in enumerate(self._rows):
                change = self._deform(row, room, rows)
                if kind < self.n_contacts and compression:
                    change -= compression
                force = stiffness[kind, rows] * change
                energy += dot(force, change)
                if kind < self.n_contacts:
                    pull += float(np.sum(force))
                self._pull(row, force, out, rows)
        return self._fold(out), pull, energy

    # -- solving ----------------------------------------------------------------------------------------------------

    @cached_property
    def _green(self) -> tuple[tuple[Any, ...], ...]:
        """Inverse of C^T K C of equal contacts of stiffness one, in Fourier space; zero for motions that cost nothing.

        It is real, because rotations are multiplied by i. Entries (a, b) are arrays (L1, L2/2 + 1).
        """
        n, (first, second) = self.n_fields, self.shape
        half = np.pi / first * np.arange(first)[:, None], np.pi / second * np.arange(second // 2 + 1)
        matrix = np.zeros((n, n, first, second // 2 + 1))
        for kind, row in enumerate(self._rows):
            angle = row.shift[0] * half[0] + row.shift[1] * half[1]
            sine, cosine = 2.0 * np.sin(angle), 2.0 * np.cos(angle)
            # a motion z exp(i q r) deforms by i (2 sin z_u) + 2 cos z_phi about the middle of the contact
            turns = self.motions.is_rotation.tolist()
            factor = [head * (cosine if turn else sine) for head, turn in zip(row.head, turns, strict=True)]
            weight = self._ratios[kind // self.n_contacts]
            for a in range(n):
                for b in range(n):
                    if row.head[a] and row.head[b]:
                        matrix[a, b] += weight * factor[a] * factor[b]
        matrix[:2, :2, 0, 0] = np.eye(2)  # translations of the whole array
        inverse = np.moveaxis(np.linalg.inv(np.moveaxis(matrix, (0, 1), (2, 3))), (2, 3), (0, 1))
        inverse[:2, :2, 0, 0] = 0.0
        entries = {(a, b): np.ascontiguousarray(inverse[a, b]) for a in range(n) for b in range(a, n)}
        return tuple(tuple(entries[min(a, b), max(a, b)] for b in range(n)) for a in range(n))

    def preconditioner(self, stiffness: Array) -> Callable[[Array], Array]:
        """Return an approximate inverse of C^T K C: Green's function of the mean stiffness, plus each ball's own inverse.

        The first carries stress across the array; the second accounts for balls that are held weakly.
        """
        from scipy import fft  # imported here: media that are not simulated do not need it

        mean = float(np.mean(stiffness[: self.n_contacts]))
        local, turning = self._invert_blocks(stiffness, _LEAST_LOCAL * mean), self.motions.turning

        def apply(force: Array) -> Array:
            waves = fft.rfft2(force, workers=self.workers)
            for rows in self.blocks():
                parts = waves[:, rows]
                parts[turning] *= -1j
                new = [_sum_products([entry[rows] for entry in line], parts) for line in self._green]
                for field, part in enumerate(new):
                    parts[field] = part
                parts[turning] *= 1j
            # transform one axis after the other: both at once would allocate another array of waves
            waves = fft.ifft(waves, axis=1, workers=self.workers, overwrite_x=True)
            out: Array = fft.irfft(waves, self.shape[1], axis=2, workers=self.workers)
            for rows in self.blocks():
                part = out[:, rows]
                part *= 1.0 / mean
                part[:2] += [_sum_products([entry[rows] for entry in line], force[:2, rows]) for line in local[:2]]
                for turn, field in zip(local[2], part[turning], strict=True):
                    field += turn[rows] * force[2, rows]
            return out

        return apply

    def _invert_blocks(self, stiffness: Array, least: float) -> list[list[Array]]:
        """Return the inverse of each ball's own block of C^T K C, with displacements and rotation treated separately."""
        blocks = [(0, 0), (0, 1), (1, 1), *((turn, turn) for turn in range(self.n_fields)[self.motions.turning])]
        room = np.zeros((len(blocks), self.shape[0] + 1, self.shape[1] + 1))
        for rows in self.blocks():
            for kind, row in enumerate(self._rows):
                (s1, s2), part = row.shift, stiffness[kind, rows]
                extra = least * self._ratios[kind // self.n_contacts]
                for slot, (a, b) in enumerate(blocks):
                    ahead, behind = row.head[a] * row.head[b], row.tail[a] * row.tail[b]
                    if ahead:
                        room[slot, rows.start + s1 : rows.stop + s1, s2 : s2 + self.shape[1]] += _multiply(ahead, part)
                        room[slot, rows, :-1] += _multiply(behind, part) + extra * (ahead + behind)
        xx, xy, yy, *turns = out = self._fold(room)
        for rows in self.blocks():
            first, across, second = out[:3, rows]
            one_over = 1.0 / (first * second - across * across)
            xx[rows], xy[rows], yy[rows] = second * one_over, -across * one_over, first * one_over
            for turn in turns:
                turn[rows] = 1.0 / turn[rows]
        return [[xx, xy], [xy, yy], turns]


def _round_coefficients(coefficients: Array) -> Array:
    """Round coefficients that differ from whole numbers by rounding only, so that a product with one can be skipped."""
    near = np.rint(coefficients)
    return np.where(np.abs(coefficients - near) < 1e-12, near, coefficients)


def dot(first: Array, second: Array) -> float:
    """Return the sum of products, without BLAS: its threads wait for each other, and their number changes the last digit."""
    axes = "abc"[: first.ndim]
    return float(np.einsum(f"{axes},{axes}->", first, second))


def _combine(coefficients: tuple[float, ...], fields: Array) -> Array:
    """Return the sum of fields times their coefficients; a single field with coefficient one is returned without a copy."""
    parts = [_multiply(c, field) for c, field in zip(coefficients, fields, strict=True) if c]
    total = parts[0]
    for part in parts[1:]:
        total = total + part
    return total


def _sum_products(factors: Sequence[Array], fields: Any) -> Any:
    total = factors[0] * fields[0]
    for factor, field in zip(factors[1:], fields[1:], strict=True):
        total += factor * field
    return total


def _multiply(factor: float, array: Array) -> Array:
    return array if factor == 1.0 else factor * array
