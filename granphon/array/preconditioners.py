"""Approximate inverses of a tangent for GMRES, for groups of balls that only hold each other.

With friction, GMRES takes long if some balls hold each other and hardly anything else holds them.
The Green's function of the lattice does not know of such balls, and the inverse of the block of a
single ball takes its neighbours to be fixed. But the forces that are left after some iterations of
GMRES act on these balls, and so tell which balls they are. These balls and their neighbours make a
patch. The matrix of the patch, while all other balls are held, is inverted, and this inverse takes
the place of those of single balls. Parts of a patch that do not touch are separate blocks of the
matrix, and need no case of their own.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from functools import cached_property
from typing import TYPE_CHECKING, Any

import numpy as np

from granphon.array.pressed_place import PressedTangent
from granphon.array.sparse_matrices import compose
from granphon.array.stencils import OPTIONS, Stencils, number_cells
from granphon.base.arrays import Array, Index
from granphon.dynamics.factors import factorise
from granphon.statics.options import LoadingOptions

if TYPE_CHECKING:
    from scipy.sparse import csr_array

#: function of a force and an array of motions that sets motions of some balls, or of all, in the
#: array to those under the force
MotionSetter = Callable[[Array, Array], None]


class Patches:
    """Patches of weakly held balls of an array, found by the forces that are left on balls, and
    their inverses.

    The array is that of the ``stencils``; ``options`` are the numbers of the loading.
    """

    def __init__(self, stencils: Stencils, options: LoadingOptions | None = None) -> None:
        self.stencils = stencils
        self._options = options or LoadingOptions()
        self._n_motions = stencils.motions.count  # of a ball
        self._n_cells = math.prod(stencils.shape)
        self._n_balls = stencils.n_balls * self._n_cells
        most_contacts = self._options.most_in_patch[len(stencils.shape)]
        #: greatest number of balls in a patch
        self._most_balls = most_contacts * stencils.n_balls // stencils.n_contacts

    @cached_property
    def _ends(self) -> Index:
        """(2, contacts) numbers of ball j and of ball i of each contact; ball b of cell c has the
        number b cells + c.
        """
        i, j = np.transpose(self.stencils.ends)[..., None]  # (contacts of a cell, 1)
        cells_of_i = np.arange(self._n_cells)
        cells_of_j = number_cells(self.stencils.shape, self.stencils.shifts)
        balls_j = self._n_cells * j + cells_of_j
        balls_i = self._n_cells * i + cells_of_i
        return np.array([balls_j, balls_i]).reshape(2, -1)

    @cached_property
    def _by_ball(self) -> tuple[Index, Index]:
        """``contacts``, the numbers of the contacts of one ball after the other, and ``starts``
        (balls + 1,): the contacts of ball b are ``contacts[starts[b] : starts[b + 1]]``.
        """
        # places in the flat table of ends, sorted by the number of the ball
        order = np.argsort(self._ends, axis=None, kind="stable")
        contacts = order % self._ends.shape[1]
        balls = self._ends.ravel()[order]
        return contacts, np.searchsorted(balls, np.arange(self._n_balls + 1))

    def find_worst_balls(self, forces: Array) -> Index:
        """Return the numbers of the balls on which the largest ``forces`` (fields, L1, ..., Lp)
        act, and of their neighbours, sorted.

        The balls with the largest forces are as few as have at least half of the sum of the squares
        of all forces. If they and their neighbours would be more than about as many as a patch may
        hold, fewer are taken.
        """
        by_ball = forces.reshape(self.stencils.n_balls, self._n_motions, self._n_cells)
        squares = np.einsum("bfc,bfc->bc", by_ball, by_ball).ravel()  # of each ball, over motions
        n_near = 1 + self._ends.size // self._n_balls  # number of a ball and its neighbours
        most_worst = min(max(1, self._most_balls // n_near), self._n_balls)
        worst_balls = np.argsort(-squares, kind="stable")[:most_worst]
        sums = np.cumsum(squares[worst_balls])
        goal = min(0.5 * float(np.sum(squares)), sums[-1])
        worst_balls = worst_balls[: int(np.searchsorted(sums, goal)) + 1]
        return np.unique(self._ends[:, self._find_contacts(worst_balls)])

    def join(self, balls: Index, more_balls: Index) -> Index:
        """Return the numbers of the ``balls`` of a patch and of ``more_balls``, sorted.

        A patch of more than half of all balls becomes that of all balls, if a patch may hold as
        many. If the patch would be too large, it stays that of the ``balls``.
        """
        union = np.union1d(balls, more_balls)
        if 2 * union.size > self._n_balls and self._n_balls <= self._most_balls:
            return np.arange(self._n_balls)
        return union if union.size <= self._most_balls else balls

    def _find_contacts(self, balls: Index) -> Index:
        """Return the numbers of all contacts of the ``balls``, sorted, each once."""
        contacts, starts = self._by_ball
        counts = starts[balls + 1] - starts[balls]
        # the ranges starts[ball] to starts[ball + 1] of all balls, one after the other: entry n of
        # the whole is entry n - (counts of the balls before) of its range
        offsets = np.repeat(starts[balls] - (np.cumsum(counts) - counts), counts)
        return np.unique(contacts[offsets + np.arange(offsets.size)])

    def invert(self, balls: Index, tangent: PressedTangent) -> MotionSetter | None:
        """Return a function ``put(force, motion)`` that sets the motions of the ``balls`` of a
        patch, in ``motion``, to those under a force while all other balls are held; None if the
        matrix of the patch has no inverse. Motions of other balls stay as they are.

        The matrix is the part of the ``tangent`` between the balls of the patch, with weak springs;
        the mean stiffness of the tangent must be one. Forces and motions are (fields, L1, ..., Lp).
        """
        matrix = self._cut_matrix(balls, tangent)
        try:
            factors = factorise(matrix, symmetric=False, approximate=True)
        except RuntimeError:  # the matrix is singular to the last digit
            return None
        m = self._n_motions
        # an array (balls of a cell, motions, cells) has the motions of the balls at this index
        shape = self.stencils.n_balls, m, self._n_cells
        index = balls // self._n_cells, slice(None), balls % self._n_cells

        def put(force: Array, motion: Array) -> None:
            """Set the motions of the balls of the patch, in place, to those under a ``force``."""
            solution = factors.solve(force.reshape(shape)[index].ravel())
            motion.reshape(shape)[index] = solution.reshape(balls.size, m)

        return put

    def _cut_matrix(self, balls: Index, tangent: PressedTangent) -> csr_array[Any]:
        """Return the part of the ``tangent`` between the ``balls`` of a patch, a sparse matrix of
        the motions of one ball after the other, with weak springs to the ground.
        """
        from scipy.sparse import eye_array  # imported here: most simulations do not need it

        contacts = self._find_contacts(balls)
        # the number of each ball among those of the patch; -1 outside
        patch_number = np.full(self._n_balls, -1)
        patch_number[balls] = np.arange(balls.size)
        ends_j, ends_i = patch_number[self._ends[:, contacts]]
        is_inside = (ends_i >= 0) & (ends_j >= 0)
        i = ends_i[is_inside]
        j = ends_j[is_inside]
        contacts_inside = contacts[is_inside]
        numbers = np.arange(balls.size)
        forward, backward = tangent.product.list_blocks(contacts_inside)
        # the lines and the columns of blocks, and the blocks (m, m, n_blocks)
        blocks = (
            (numbers, numbers, tangent.diagonal[..., balls]),
            (i, j, forward),
            (j, i, backward.swapaxes(0, 1)),
        )
        m = self._n_motions
        motions = np.arange(m)[:, None]
        entries = (
            (m * line + motions[:, None], m * column + motions, values.astype(float))
            for line, column, values in blocks
        )
        size = m * balls.size
        springs = OPTIONS.grid.spring * eye_array(size, format="csr")
        return compose(entries, (size, size)) + springs
