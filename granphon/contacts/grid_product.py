"""Loops that multiply the tangent of the contacts of a grid by motions, compiled.

Motions and forces are arrays (f, k, cells), of k right sides and of the f = b m motions of the b
balls of a cell, each of which has m motions: loops go through cells that follow each other in
memory. The blocks of the tangent are multiplied as they are; no sparse matrix is made.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from granphon.base.compiled import compiled

Values = NDArray[Any]
#: contacts of a kind that are multiplied at a time, so that they stay in the processor's cache
_CACHED = 256
#: balls whose blocks are inverted together
_INVERTED = 64


class GridProduct(NamedTuple):
    """What loops read to multiply the tangent of a grid, in double or single precision.

    Attributes
    ----------
    diagonal : (m, m, n) forces on each ball against its own motions.
    forward : (m, m, n_c) forces on ball i of each contact against motions of ball j.
    backward : (m, m, n_c) of each motion of ball i the forces on ball j; ``forward`` itself where
        the tangent is symmetric.
    ends : (kinds, 2) balls of the cell that each kind of contact joins.
    steps : (kinds, cells) cell where a contact ends that starts in each cell.
    """

    diagonal: Values
    forward: Values
    backward: Values
    ends: NDArray[np.int64]
    steps: NDArray[np.uint32]

    @classmethod
    def of(cls, i: NDArray[np.int64], j: NDArray[np.int64], cells: int) -> GridProduct:
        """Return a product whose blocks are empty (0, 0, 0), which the caller replaces, for the
        contacts between the balls ``i`` and ``j`` (n_c,) of a grid of ``cells`` cells, kind by
        kind.
        """
        # unsigned numbers: a loop need not test whether an index is below zero
        steps = (j % cells).reshape(-1, cells).astype(np.uint32)
        ends = np.stack([i[::cells], j[::cells]], axis=1) // cells
        none = np.empty((0, 0, 0))
        return cls(none, none, none, ends, steps)

    def round(self) -> GridProduct:
        """Return the product in single precision."""
        forward = self.forward.astype(np.float32)
        is_symmetric = self.backward is self.forward
        return self._replace(
            diagonal=self.diagonal.astype(np.float32),
            forward=forward,
            backward=forward if is_symmetric else self.backward.astype(np.float32),
        )


@compiled
def leave(product: GridProduct, forces: Values, motions: Values, remaining: Values) -> None:
    """Set ``remaining`` to the ``forces`` less the tangent of the ``product`` times the
    ``motions``, (f, k, cells) each.
    """
    remaining[:] = 0.0
    add_alone(product.diagonal, motions, remaining)
    add_across(product, motions, remaining)
    for field in range(len(forces)):
        for k in range(forces.shape[1]):
            pull = forces[field, k]
            remainder = remaining[field, k]
            for cell in range(len(pull)):
                remainder[cell] = pull[cell] - remainder[cell]


@compiled
def add_alone(blocks: Values, columns: Values, out: Values) -> None:
    """Add to ``out`` (f, k, cells) the product of the block (m, m) of each ball with the m
    ``columns`` of that ball alone.

    ``blocks`` are (m, m, n), ``columns`` (f, k, cells).
    """
    m = len(blocks)
    cells = columns.shape[2]
    for ball in range(len(columns) // m):
        for line in range(m):
            for motion in range(m):
                block = blocks[line, motion, ball * cells : (ball + 1) * cells]
                for k in range(columns.shape[1]):
                    column = columns[ball * m + motion, k]
                    sums = out[ball * m + line, k]
                    for cell in range(cells):
                        sums[cell] += block[cell] * column[cell]


@compiled
def add_across(product: GridProduct, motions: Values, forces: Values) -> None:
    """Add to ``forces`` (f, k, cells) the forces of contacts on each of their two balls against the
    ``motions`` (f, k, cells) of the other ball.

    The motions of balls j of ``_CACHED`` contacts of a kind are gathered first, and the forces on
    balls j are scattered last: the multiplications between go through memory in order.
    """
    ends = product.ends
    steps = product.steps
    m = len(product.forward)
    cells = motions.shape[2]
    far = np.empty((m, _CACHED), motions.dtype)
    pulls = np.empty((m, _CACHED), motions.dtype)  # forces on balls j
    for kind in range(len(ends)):
        at_i = m * ends[kind, 0]
        at_j = m * ends[kind, 1]
        for start in range(0, cells, _CACHED):
            stop = min(start + _CACHED, cells)
            count = stop - start
            step = steps[kind, start:stop]
            for k in range(motions.shape[1]):
                for motion in range(m):
                    gathered = far[motion]
                    moved = motions[at_j + motion, k]
                    for cell in range(count):
                        gathered[cell] = moved[step[cell]]
                    pulls[motion] = 0.0
                for line in range(m):
                    near = motions[at_i + line, k, start:stop]
                    push = forces[at_i + line, k, start:stop]
                    for motion in range(m):
                        first = kind * cells
                        ahead = product.forward[line, motion, first + start : first + stop]
                        behind = product.backward[line, motion, first + start : first + stop]
                        gathered = far[motion]
                        pull = pulls[motion]
                        for cell in range(count):
                            push[cell] += ahead[cell] * gathered[cell]
                        for cell in range(count):
                            pull[cell] += behind[cell] * near[cell]
                for motion in range(m):
                    pull = pulls[motion]
                    push = forces[at_j + motion, k]
                    for cell in range(count):
                        push[step[cell]] += pull[cell]


@compiled
def invert_blocks(blocks: Values, added: float, part: float, inverses: Values) -> None:
    """Set ``inverses`` (m, m, n) to ``part`` times the inverses of the ``blocks`` (m, m, n); the
    stiffness ``added`` is first added to the diagonal of each block.

    The symmetric parts of the blocks with ``added`` must be positive definite: the elimination
    looks for no other pivots than the diagonal.
    """
    m = len(blocks)
    balls = blocks.shape[2]
    work = np.zeros((m, m, _INVERTED))
    for line in range(m):
        work[line, line] = 1.0  # places without a ball are inverted too, and must not be singular
    factor = np.empty(_INVERTED)
    for start in range(0, balls, _INVERTED):
        stop = min(start + _INVERTED, balls)
        for ball in range(start, stop):
            for line in range(m):
                for column in range(m):
                    work[line, column, ball - start] = blocks[line, column, ball]
                work[line, line, ball - start] += added
        # the elimination of Gauss and Jordan in place; pivots of a positive matrix are on its
        # diagonal
        for pivot in range(m):
            for place in range(_INVERTED):
                factor[place] = 1.0 / work[pivot, pivot, place]
            work[pivot, pivot] = 1.0
            for column in range(m):
                entries = work[pivot, column]
                for place in range(_INVERTED):
                    entries[place] *= factor[place]
            for line in range(m):
                if line == pivot:
                    continue
                for place in range(_INVERTED):
                    factor[place] = work[line, pivot, place]
                work[line, pivot] = 0.0
                for column in range(m):
                    entries = work[line, column]
                    pivots = work[pivot, column]
                    for place in range(_INVERTED):
                        entries[place] -= factor[place] * pivots[place]
        for line in range(m):
            for column in range(m):
                entries = work[line, column]
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
    """Set ``forces`` (f, 1, cells) to the forces against ``motions`` (f, 1, cells) and against a
    change ``press`` of the overlap y by which the cell is compressed. Return minus the change of
    the sum of the normal forces, or zero if the overlap is held.

    ``ahead`` (m, n) are the forces against a unit of y; ``back`` (m, n) and ``corner`` are minus
    the changes of the sum by unit motions and by a unit of y. ``ahead`` and ``back`` are empty if
    the overlap is held.
    """
    forces[:] = 0.0
    add_alone(product.diagonal, motions, forces)
    add_across(product, motions, forces)
    if not ahead.size:
        return 0.0
    total = corner * press
    m = len(ahead)
    cells = motions.shape[2]
    for field in range(len(motions)):
        begin = field // m * cells
        pushed = ahead[field % m, begin : begin + cells]
        pressed = back[field % m, begin : begin + cells]
        force = forces[field, 0]
        moved = motions[field, 0]
        for cell in range(cells):
            force[cell] += press * pushed[cell]
        for cell in range(cells):
            total += pressed[cell] * moved[cell]
    return total
