"""Compiled loops that multiply the tangent of the contacts of a grid by motions.

A cell has b balls, and each ball has m motions; n = b cells is the number of all balls, and n_c =
kinds cells that of all contacts. Motions and forces are arrays (f, k, cells) with f = b m, for k
right sides at once: loops go through cells that follow each other in memory. The blocks of the
tangent are multiplied as they are; no sparse matrix is made.

Blocks of contacts are laid out with ghost cells around the array (:class:`Halo`), one place for
each cell or ghost, and motions are copied to such places first. From ball i to ball j of all
contacts of a kind it is then the same number of places, also across the boundary: loops read and
add slices, and no index.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from functools import lru_cache
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from granphon.base.compiled import compiled
from granphon.contacts.shift_product import Halo

Values = NDArray[Any]
#: number of places that are multiplied at a time, so that they stay in the processor's cache
_PLACES_AT_ONCE = 1024
#: number of balls whose blocks are inverted together
_BALLS_AT_ONCE = 64


class GridProduct(NamedTuple):
    """What loops read to multiply the tangent of a grid; blocks are in double or single precision.

    Attributes
    ----------
    diagonal : (m, m, n) forces on each ball against its own motions.
    forward : (m, m, kinds, places) forces on ball i of each contact against motions of ball j, at
        the places of balls i.
    backward : (m, m, kinds, places) forces on ball j of each contact (second axis) against motions
        of ball i (first axis), at the places of balls i; ``forward`` itself where the tangent is
        symmetric.
    joins : (kinds, 3) numbers, within the cell, of the balls i and j of each kind of contact, and
        number of places from ball i to ball j.
    cells : (places,) number of the cell that each place repeats.
    places : (cells,) place of each cell, ascending; all other places are ghosts.
    """

    diagonal: Values
    forward: Values
    backward: Values
    joins: NDArray[np.int64]
    cells: NDArray[np.uint32]
    places: NDArray[np.uint32]

    @classmethod
    def of(cls, i: NDArray[np.int64], j: NDArray[np.int64], shape: Sequence[int]) -> GridProduct:
        """Return the product of the contacts, kind by kind, of a grid of the ``shape`` (L1, ...,
        Lp); ``i`` and ``j`` (n_c,) are the numbers of their balls. Its blocks are empty (0, 0, 0):
        :meth:`fill` replaces them.
        """
        n_cells = math.prod(shape)
        # the first contact of each kind tells where all others lead
        first_i = tuple(i[::n_cells].tolist())
        first_j = tuple(j[::n_cells].tolist())
        no_blocks = np.empty((0, 0, 0))
        return cls(no_blocks, no_blocks, no_blocks, *_find_layout(tuple(shape), first_i, first_j))

    def fill(self, diagonal: Values, forward: Values, backward: Values) -> GridProduct:
        """Return the product with the blocks of a tangent: ``diagonal`` (m, m, n) those of balls,
        ``forward`` and ``backward`` (m, m, n_c) those of contacts, which may be the same array.
        """
        laid_forward = self._lay(forward)
        laid_backward = laid_forward if backward is forward else self._lay(backward)
        return self._replace(diagonal=diagonal, forward=laid_forward, backward=laid_backward)

    def _lay(self, blocks: Values) -> Values:
        """Return the ``blocks`` (m, m, n_c) of contacts at their places, (m, m, kinds, places)."""
        by_kind = blocks.reshape(*blocks.shape[:2], len(self.joins), -1)
        return np.take(by_kind, self.cells, axis=-1)

    def list_blocks(self, contacts: NDArray[np.intp]) -> tuple[Values, Values]:
        """Return the blocks ``forward`` and ``backward`` (m, m, count) of the ``contacts`` (count,)
        with these numbers.
        """
        kinds, cells = np.divmod(contacts, len(self.places))
        index = (..., kinds, self.places[cells])
        return self.forward[index], self.backward[index]

    def round(self) -> GridProduct:
        """Return the product with blocks in single precision."""
        forward = self.forward.astype(np.float32)
        is_symmetric = self.backward is self.forward
        return self._replace(
            diagonal=self.diagonal.astype(np.float32),
            forward=forward,
            backward=forward if is_symmetric else self.backward.astype(np.float32),
        )


@lru_cache(maxsize=2)
def _find_layout(
    shape: tuple[int, ...], first_i: tuple[int, ...], first_j: tuple[int, ...]
) -> tuple[NDArray[np.int64], NDArray[np.uint32], NDArray[np.uint32]]:
    """Return the ``joins``, ``cells`` and ``places`` of the :class:`GridProduct` of a grid of the
    ``shape``; ``first_i`` and ``first_j`` (kinds,) are the numbers of the balls of the first
    contact of each kind. The layouts of the last two grids are kept for further calls, and shared:
    their arrays must not be changed.
    """
    n_cells = math.prod(shape)
    i = np.array(first_i)
    j = np.array(first_j)
    ends = np.array([np.unravel_index(balls % n_cells, shape) for balls in (i, j)])
    half = np.floor_divide(shape, 2)
    # a contact leads where it does up to periods of the array: the nearest image needs the fewest
    # ghosts
    shifts = (np.subtract(*ends[::-1]).T + half) % shape - half
    halo = Halo(shape, [*shifts.tolist(), *(-shifts).tolist()])
    steps = [halo.offset(shift) for shift in shifts.tolist()]
    cells = np.empty(halo.outer, np.uint32)
    cells[halo.inner] = np.arange(n_cells).reshape(shape)
    for ghosts, layers in halo.images(cells, 0):
        ghosts[...] = layers
    places = np.arange(cells.size).reshape(halo.outer)[halo.inner]
    # unsigned numbers: a loop need not test whether an index is below zero
    return (
        np.stack([i // n_cells, j // n_cells, steps], axis=1),
        cells.ravel(),
        places.ravel().astype(np.uint32),
    )


@compiled
def find_residual(product: GridProduct, forces: Values, motions: Values, residual: Values) -> None:
    """Set ``residual`` to the ``forces`` less the tangent of the ``product`` times the ``motions``;
    all are (f, k, cells).
    """
    multiply(product, motions, residual)
    for field in range(len(forces)):
        for side in range(forces.shape[1]):
            pull = forces[field, side]
            remainder = residual[field, side]
            for cell in range(len(pull)):
                remainder[cell] = pull[cell] - remainder[cell]


@compiled
def multiply(product: GridProduct, motions: Values, forces: Values) -> None:
    """Set ``forces`` to the tangent of the ``product`` times the ``motions``; both are (f, k,
    cells).
    """
    forces[:] = 0.0
    add_block_products(product.diagonal, motions, forces)
    add_neighbour_products(product, motions, forces)


@compiled
def relax_balls(
    product: GridProduct, inverses: Values, forces: Values, motions: Values, residual: Values
) -> None:
    """Set ``motions`` to those of each ball under the ``forces`` while its neighbours are held, by
    the ``inverses`` (m, m, n) of blocks, and ``residual`` to the forces that all these motions
    leave; forces and motions are (f, k, cells).
    """
    motions[:] = 0.0
    add_block_products(inverses, forces, motions)
    find_residual(product, forces, motions, residual)


@compiled
def relax_balls_after(
    product: GridProduct,
    inverses: Values,
    forces: Values,
    motions: Values,
    residual: Values,
) -> None:
    """Add to ``motions`` those of each ball under the forces that are left of ``forces`` while its
    neighbours are held; see :func:`relax_balls`. The forces left before these motions become the
    ``residual``.
    """
    find_residual(product, forces, motions, residual)
    add_block_products(inverses, residual, motions)


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

    For each right side, motions are copied to all places, and forces are added up at all places
    from the first cell to the last, ``_PLACES_AT_ONCE`` at a time; those at ghosts are not used.
    """
    cells = product.cells
    places = product.places
    fields = len(motions)
    motions_at = np.empty((fields, len(cells)), motions.dtype)
    forces_at = np.empty((fields, len(cells)), motions.dtype)
    end = places[-1] + 1
    for side in range(motions.shape[1]):
        for field in range(fields):
            motion = motions[field, side]
            motion_at = motions_at[field]
            for place in range(len(cells)):
                motion_at[place] = motion[cells[place]]
        for start in range(places[0], end, _PLACES_AT_ONCE):
            _add_up_forces(product, motions_at, forces_at, start, min(start + _PLACES_AT_ONCE, end))
        for field in range(fields):
            force = forces[field, side]
            force_at = forces_at[field]
            for cell in range(len(places)):
                force[cell] += force_at[places[cell]]


@compiled
def _add_up_forces(
    product: GridProduct, motions: Values, forces: Values, start: int, stop: int
) -> None:
    """Set the ``forces`` (f, places) of contacts on balls from place ``start`` to before ``stop``,
    against the ``motions`` (f, places) of the balls at the other ends.
    """
    m = len(product.forward)
    forces[:, start:stop] = 0.0
    for kind in range(len(product.joins)):
        first_i = m * product.joins[kind, 0]
        first_j = m * product.joins[kind, 1]
        step = product.joins[kind, 2]
        for line in range(m):
            for motion in range(m):
                # on balls i in the range, whose balls j are a step ahead
                block = product.forward[line, motion, kind, start:stop]
                motion_j = motions[first_j + motion, start + step : stop + step]
                force_i = forces[first_i + line, start:stop]
                for place in range(len(force_i)):
                    force_i[place] += block[place] * motion_j[place]
                # on balls j in the range, whose balls i are a step behind
                block = product.backward[line, motion, kind, start - step : stop - step]
                motion_i = motions[first_i + line, start - step : stop - step]
                force_j = forces[first_j + motion, start:stop]
                for place in range(len(force_j)):
                    force_j[place] += block[place] * motion_i[place]


@compiled
def _eliminate(matrices: Values) -> None:
    """Replace the ``matrices`` (m, m, _BALLS_AT_ONCE) by their inverses, by the elimination of
    Gauss and Jordan. Its pivots are those on the diagonal, which suffices where the symmetric part
    of a matrix is positive definite.
    """
    m = len(matrices)
    factor = np.empty(_BALLS_AT_ONCE)
    for pivot in range(m):
        for place in range(_BALLS_AT_ONCE):
            factor[place] = 1.0 / matrices[pivot, pivot, place]
        matrices[pivot, pivot] = 1.0
        for column in range(m):
            entries = matrices[pivot, column]
            for place in range(_BALLS_AT_ONCE):
                entries[place] *= factor[place]
        for line in range(m):
            if line == pivot:
                continue
            for place in range(_BALLS_AT_ONCE):
                factor[place] = matrices[line, pivot, place]
            matrices[line, pivot] = 0.0
            for column in range(m):
                entries = matrices[line, column]
                pivots = matrices[pivot, column]
                for place in range(_BALLS_AT_ONCE):
                    entries[place] -= factor[place] * pivots[place]


@compiled
def invert_blocks(blocks: Values, added: float, part: float, inverses: Values) -> None:
    """Set ``inverses`` (m, m, n) to ``part`` times the inverses of the ``blocks`` (m, m, n); the
    stiffness ``added`` is first added to the diagonal of each block.

    After that the symmetric part of each block must be positive definite, which is not tested.
    """
    m = len(blocks)
    n = blocks.shape[2]
    matrices = np.zeros((m, m, _BALLS_AT_ONCE))
    for line in range(m):
        # if there are fewer balls, the places left over are inverted too, and must not be singular
        matrices[line, line] = 1.0
    for start in range(0, n, _BALLS_AT_ONCE):
        stop = min(start + _BALLS_AT_ONCE, n)
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
    a change ``press`` of the overlap y by which the cell is compressed. Return the change of the
    sum of the normal forces; zero if the overlap is held.

    ``ahead`` (m, n) are the forces on balls against a unit of y. The changes of the sum are
    ``back`` (m, n) by unit motions, and ``corner`` by a unit of y. If the overlap is held,
    ``ahead`` and ``back`` are empty, and ``corner`` and ``press`` are not read.
    """
    multiply(product, motions, forces)
    if not ahead.size:
        return 0.0
    total = corner * press
    m = len(ahead)
    cells = motions.shape[2]
    for field in range(len(motions)):
        first = field // m * cells  # number of the first of the balls that move along the field
        force_per_y = ahead[field % m, first : first + cells]
        change_per_motion = back[field % m, first : first + cells]
        force = forces[field, 0]
        motion = motions[field, 0]
        for cell in range(cells):
            force[cell] += press * force_per_y[cell]
        for cell in range(cells):
            total += change_per_motion[cell] * motion[cell]
    return total
