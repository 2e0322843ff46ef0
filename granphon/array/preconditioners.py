"""Approximate inverses of a tangent for GMRES, where few balls hold each other but nothing else
holds them.

With friction, GMRES takes long where few balls hold each other and nothing else holds them. The
lattice's Green's function does not know of such balls, and the inverse of the block of a single
ball takes its neighbours to be fixed. But the forces that GMRES leaves after some iterations act on
these balls, and so tell where they are. They and their neighbours make a patch: the matrix of the
patch, while all other balls are held, is inverted, and this inverse takes the place of those of
single balls. Parts of a patch that do not touch are blocks of this matrix, and need no case of
their own.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from functools import cached_property

import numpy as np

from granphon.array.pressed_place import PressedTangent
from granphon.array.sparse_matrices import compose
from granphon.array.stencils import OPTIONS, Stencils, number_cells
from granphon.base.arrays import Array, Index
from granphon.dynamics.factors import factorise
from granphon.statics.options import LoadingOptions

#: function of a force and an array of motions that writes the motions under the force of some balls
#: into the array
Put = Callable[[Array, Array], None]


class Patches:
    """Table of the contacts of each ball, from which patches are cut; ``options`` are the numbers
    of the loading.
    """

    def __init__(self, stencils: Stencils, options: LoadingOptions | None = None) -> None:
        self.stencils = stencils
        self._options = options or LoadingOptions()
        self._fields = stencils.motions.count
        self._cells = math.prod(stencils.shape)
        self._balls = stencils.n_balls * self._cells
        most = self._options.most_in_patch[len(stencils.shape)]  # contacts
        self._largest = most * stencils.n_balls // stencils.n_contacts

    @cached_property
    def _ends(self) -> Index:
        """(2, contacts) numbers of ball j and of ball i of each contact."""
        i, j = (self._cells * ball[:, None] for ball in np.transpose(self.stencils.ends))
        far = number_cells(self.stencils.shape, self.stencils.shifts)
        return np.array([j + far, i + np.arange(self._cells)]).reshape(2, -1)

    @cached_property
    def _by_ball(self) -> tuple[Index, Index]:
        """``contacts``, the contacts of one ball after the other, and ``starts`` (balls + 1,):
        those of ball b are ``contacts[starts[b] : starts[b + 1]]``.
        """
        order = np.argsort(self._ends, axis=None, kind="stable")
        contacts = order % self._ends.shape[1]
        balls = self._ends.ravel()[order]
        return contacts, np.searchsorted(balls, np.arange(self._balls + 1))

    def find_worst(self, forces: Array) -> Index:
        """Return the numbers of the balls on which the largest ``forces`` (fields, L1, ..., Lp)
        act, and of their neighbours.

        The balls are as few as bear all but the part ``options.forcing`` of the sum of the squares
        of all forces, and no more than a patch may hold.
        """
        by_ball = forces.reshape(self.stencils.n_balls, self._fields, self._cells)
        squares = np.einsum("bfc,bfc->bc", by_ball, by_ball).ravel()
        near = 1 + self._ends.size // self._balls  # a ball and its neighbours
        most = min(max(1, self._largest // near), self._balls)
        worst = np.argsort(-squares, kind="stable")[:most]
        sums = np.cumsum(squares[worst])
        held = min((1.0 - self._options.forcing) * float(np.sum(squares)), sums[-1])
        worst = worst[: int(np.searchsorted(sums, held)) + 1]
        return np.unique(self._ends[:, self._find_contacts(worst)])

    def join(self, balls: Index, added: Index) -> Index:
        """Return the numbers of the ``balls`` of a patch and of the balls ``added`` to it, sorted.

        A patch of half of the balls becomes that of all balls, if the array is small enough. If the
        patch would be too large, nothing is added.
        """
        joined = np.union1d(balls, added)
        if 2 * joined.size > self._balls and self._balls <= self._largest:
            return np.arange(self._balls)
        return joined if joined.size <= self._largest else balls

    def _find_contacts(self, balls: Index) -> Index:
        """Return the numbers of all contacts of the ``balls``, sorted, each once."""
        contacts, starts = self._by_ball
        counts = starts[balls + 1] - starts[balls]
        # the ranges starts[ball] to starts[ball + 1] of all balls, one after the other: entry n of
        # the whole is entry n - (counts of the balls before) of its range
        offsets = np.repeat(starts[balls] - (np.cumsum(counts) - counts), counts)
        return np.unique(contacts[offsets + np.arange(offsets.size)])

    def invert(self, balls: Index, tangent: PressedTangent) -> Put | None:
        """Return a function ``put(force, motion)`` that writes the motions of the ``balls`` of a
        patch under a force, while all other balls are held, into ``motion``; None if the matrix of
        the patch has no inverse.

        The matrix is the part of the ``tangent``, whose mean stiffness is one, between the balls of
        the patch. Forces and motions are (fields, L1, ..., Lp).
        """
        from scipy.sparse import eye_array  # imported here: most simulations do not need it

        contacts = self._find_contacts(balls)
        place = np.full(self._balls, -1)
        place[balls] = np.arange(balls.size)
        end, start = place[self._ends[:, contacts]]
        inside = (start >= 0) & (end >= 0)
        i = start[inside]
        j = end[inside]
        alone = np.arange(balls.size)
        blocks = tangent.product
        across = contacts[inside]
        # the places of the blocks, (line, column), and the blocks (m, m, number)
        parts = (
            (alone, alone, tangent.diagonal[..., balls]),
            (i, j, blocks.forward[..., across]),
            (j, i, blocks.backward[..., across].swapaxes(0, 1)),
        )
        m = self._fields
        motions = np.arange(m)[:, None]
        entries = (
            (m * line + motions[:, None], m * column + motions, values.astype(float))
            for line, column, values in parts
        )
        size = m * balls.size
        spring = OPTIONS.grid.holding
        matrix = compose(entries, (size, size)) + spring * eye_array(size, format="csr")
        try:
            factors = factorise(matrix, symmetric=False, approximate=True)
        except RuntimeError:  # the matrix is singular to the last digit
            return None
        index = balls // self._cells, slice(None), balls % self._cells
        shape = self.stencils.n_balls, m, self._cells

        def put(force: Array, motion: Array) -> None:
            """Set the motions of the balls of the patch, in place, to those under a ``force``."""
            solution = factors.solve(force.reshape(shape)[index].ravel())
            motion.reshape(shape)[index] = solution.reshape(balls.size, m)

        return put
