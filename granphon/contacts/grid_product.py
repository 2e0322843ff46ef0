"""Compiled loops that multiply the tangent of the contacts of a grid by motions.

A cell has b balls, and each ball has m motions; n = b cells is the number of all balls, and n_c =
kinds cells that of all contacts. Motions and forces are arrays (f, k, cells) with f = b m, for k
right sides at once: loops go through cells that follow each other in memory. The blocks of the
tangent are multiplied as they are; no sparse matrix is made.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from granphon.base.compiled import compiled

Values = NDArray[Any]
#: number of contacts of a kind that are multiplied at a time, so that they stay in the processor's
#: cache
_CACHED = 256
#: number of balls whose blocks are inverted together
_INVERTED = 64


class GridProduct(NamedTuple):
    """What loops read to multiply the tangent of a grid; blocks are in double or single precision.

    Attributes
    ----------
    diagonal : (m, m, n) forces on each ball against its own motions.
    forward : (m, m, n_c) forces on ball i of each contact against motions of ball j.
    backward : (m, m, n_c) forces on ball j of each contact (second axis) against motions of ball i
        (first axis); ``forward`` itself where the tangent is symmetric.
    ends : (kinds, 2) numbers, within the cell, of the balls i and j of each kind of contact.
    end_cells : (kinds, cells) number of the cell where the contact ends that starts in each cell.
    """

    diagonal: Values
    forward: Values
    backward: Values
    ends: NDArray[np.int64]
    end_cells: NDArray[np.uint32]

    @classmethod
    def of(cls, i: NDArray[np.int64], j: NDArray[np.int64], cells: int) -> GridProduct:
        """Return the product of the contacts, kind by kind, of a grid of ``cells`` cells; ``i`` and
        ``j`` (n_c,) are the numbers of their balls. Its blocks are empty (0, 0, 0): the caller
        replaces them.
        """
        # unsigned numbers: a loop need not test whether an index is below zero
        end_cells = (j % cells).reshape(-1, cells).astype(np.uint32)
        ends = np.stack([i[::cells], j[::cells]], axis=1) // cells
        no_blocks = np.empty((0, 0, 0))
        return cls(no_blocks, no_blocks, no_blocks, ends, end_cells)

    def round(self) -> GridProduct:
        """Return the product with blocks in single precision."""
        forward = self.forward.astype(np.float32)
        is_symmetric = self.backward is self.forward
        return self._replace(
            diagonal=self.diagonal.astype(np.float32),
            forward=forward,
            backward=forward if is_symmetric else self.backward.astype(np.float32),
        )


@compiled
def find_residual(product: GridProduct, forces: Values, motions: Values, residual: Values) -> None:
    """Set ``residual`` to the ``forces`` less the tangent of the ``product`` times the ``motions``;
    all are (f, k, cells).
    """
    residual[:] = 0.0
    add_block_products(product.diagonal, motions, residual)
    add_neighbour_products(product, motions, residual)
    for field in range(len(forces)):
        for side in range(forces.shape[1]):
            pull = forces[field, side]
            remainder = residual[field, side]
            for cell in range(len(pull)):
                remainder[cell] = pull[cell] - remainder[cell]


@compiled
def add_block_products(blocks: Values, vectors: Values, products: Values) -> None:
    """Add to ``products`` (f, k, cells) the product of the block of each ball with the ``vectors``
    (f, k, cells) of the same ball; ``blocks`` are (m, m, n).
    """
    m = len(blocks)
    cells = vectors.shape[2]
    for ball in range(len(vectors) // m):
        for line in range(m):
            for motion in range(m):
                entries = blocks[line, motion, ball * cells : (ball + 1) * cells]
                for side in range(vectors.shape[1]):
                    components = vectors[ball * m + motion, side]
                    sums = products[ball * m + line, side]
                    for cell in range(cells):
                        sums[cell] += entries[cell] * components[cell]


@compiled
def add_neighbour_products(product: GridProduct, motions: Values, forces: Values) -> None:
    """Add to ``forces`` (f, k, cells) the forces of contacts on each of their two balls against the
    ``motions`` (f, k, cells) of the other ball.

    The motions of balls j of at most ``_CACHED`` contacts of a kind are gathered first, and the
    forces on balls j are scattered last: the multiplications in between go through memory in order.
    """
    ends = product.ends
    end_cells = product.end_cells
    m = len(product.forward)
    cells = motions.shape[2]
    motions_j = np.empty((m, _CACHED), motions.dtype)
    forces_j = np.empty((m, _CACHED), motions.dtype)
    for kind in range(len(ends)):
        first_contact = kind * cells
        first_i = m * ends[kind, 0]
        first_j = m * ends[kind, 1]
        for start in range(0, cells, _CACHED):
            stop = min(start + _CACHED, cells)
            count = stop - start
            cells_j = end_cells[kind, start:stop]
            for side in range(motions.shape[1]):
                for motion in range(m):
                    motion_j = motions_j[motion]
                    field = motions[first_j + motion, side]
                    for cell in range(count):
                        motion_j[cell] = field[cells_j[cell]]
                    forces_j[motion] = 0.0
                for line in range(m):
                    motion_i = motions[first_i + line, side, start:stop]
                    force_i = forces[first_i + line, side, start:stop]
                    for motion in range(m):
                        contact_start = first_contact + start
                        contact_stop = first_contact + stop
                        forward = product.forward[line, motion, contact_start:contact_stop]
                        backward = product.backward[line, motion, contact_start:contact_stop]
                        motion_j = motions_j[motion]
                        force_j = forces_j[motion]
                        for cell in range(count):
                            force_i[cell] += forward[cell] * motion_j[cell]
                        for cell in range(count):
                            force_j[cell] += backward[cell] * motion_i[cell]
                for motion in range(m):
                    force_j = forces_j[motion]
                    field = forces[first_j + motion, side]
                    for cell in range(count):
                        field[cells_j[cell]] += force_j[cell]


@compiled
def _eliminate(matrices: Values) -> None:
    """Replace the ``matrices`` (m, m, _INVERTED) by their inverses, by the elimination of Gauss and
    Jordan. Its pivots are those on the diagonal, which suffices where the symmetric part of a
    matrix is positive definite.
    """
    m = len(matrices)
    factor = np.empty(_INVERTED)
    for pivot in range(m):
        for place in range(_INVERTED):
            factor[place] = 1.0 / matrices[pivot, pivot, place]
        matrices[pivot, pivot] = 1.0
        for column in range(m):
            entries = matrices[pivot, column]
            for place in range(_INVERTED):
                entries[place] *= factor[place]
        for line in range(m):
            if line == pivot:
                continue
            for place in range(_INVERTED):
                factor[place] = matrices[line, pivot, place]
            matrices[line, pivot] = 0.0
            for column in range(m):
                entries = matrices[line, column]
                pivots = matrices[pivot, column]
                for place in range(_INVERTED):
                    entries[place] -= factor[place] * pivots[place]


@compiled
def invert_blocks(blocks: Values, added: float, part: float, inverses: Values) -> None:
    """Set ``inverses`` (m, m, n) to ``part`` times the inverses of the ``blocks`` (m, m, n); the
    stiffness ``added`` is first added to the diagonal of each block.

    After that the symmetric part of each block must be positive definite, which is not tested.
    """
    m = len(blocks)
    n = blocks.shape[2]
    matrices = np.zeros((m, m, _INVERTED))
    for line in range(m):
        # if there are fewer balls, the places left over are inverted too, and must not be singular
        matrices[line, line] = 1.0
    for start in range(0, n, _INVERTED):
        stop = min(start + _INVERTED, n)
        for ball in range(start, stop):
            for line in range(m):
                for column in range(m):
                    matrices[line, column, ball - start] = blocks[line, column, ball]
                matrices[line, line, ball - start] += added
        _eliminate(matrices)
        for line in range(m):
            for column in range(m):
                entries = matrices[line, column]
                inverse = inverses[line, column, start:stop]
                for place in range(stop - start):
                    inverse[place] = part * entries[place]


@compiled
def multiply_pressed(
    product: GridProduct,
    ahead: Values,
    back: Values,
    corner: float,
    motions: Values,
    press: float,
    forces: Values,
) -> float:
    """Set ``forces`` (f, 1, cells) to the forces against the ``motions`` (f, 1, cells) and against
    a change ``press`` of the overlap y by which the cell is compressed. Return minus the change of
    the sum of the normal forces; zero if the overlap is held.

    ``ahead`` (m, n) are the forces on balls against a unit of y. Minus the changes of the sum are
    ``back`` (m, n) by unit motions, and ``corner`` by a unit of y. If the overlap is held,
    ``ahead`` and ``back`` are empty, and ``corner`` and ``press`` are not read.
    """
    forces[:] = 0.0
    add_block_products(product.diagonal, motions, forces)
    add_neighbour_products(product, motions, forces)
    if not ahead.size:
        return 0.0
    total = corner * press
    m = len(ahead)
    cells = motions.shape[2]
    for field in range(len(motions)):
        first = field // m * cells  # number of the first of the balls that move along the field
        force_per_y = ahead[field % m, first : first + cells]
        loss_per_motion = back[field % m, first : first + cells]
        force = forces[field, 0]
        motion = motions[field, 0]
        for cell in range(cells):
            force[cell] += press * force_per_y[cell]
        for cell in range(cells):
            total += loss_per_motion[cell] * motion[cell]
    return total
