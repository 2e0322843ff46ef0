"""Approximate inverses of C^T D C for GMRES, where few balls hold each other but nothing else holds
them.

With friction there are patches: few balls that move while all others are held. Newton's method
takes long where few balls hold each other but nothing else holds them. The lattice's Green's
function does not know of them, and the inverse of a single ball takes its neighbours to be fixed.
What GMRES leaves after some iterations sits on such balls and tells where they are. An inverse of
their own matrix, neighbours included, then takes the place of those of single balls. Patches that
do not touch are inverted together: one is a block of the matrix.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from functools import cached_property

import numpy as np

from granphon.array.sparse_matrices import compose
from granphon.array.stencils import HOLDING, Stencils, number_cells
from granphon.base.arrays import Array, Index
from granphon.contacts.friction import Tangent
from granphon.dynamics.factors import factorise

#: puts the motions of some balls under a force into an array of motions
Put = Callable[[Array, Array], None]
#: part of the square of a residual that the balls hold which are added to a patch
_HELD = 0.9
#: balls that are added to a patch at a time, at most, as a part of the array
_MOST_PART = 1.0 / 32.0
#: the same as a number, where that is more
_MOST = 48
#: part of the array from which a patch is the whole array, if that is not too large
_WHOLE = 0.4
#: largest number of contacts between the balls of a patch, for lattices with 1, 2, 3 periods:
#: factors of more cost more than the iterations that they save
_LARGEST = (2**16, 12_288, 768)


class Patches:
    """Table of the contacts of each ball, with the rows of C, from which patches are cut."""

    def __init__(self, stencils: Stencils) -> None:
        self.stencils = stencils
        self._fields = stencils.motions.count
        self._cells = math.prod(stencils.shape)
        self._balls = stencils.n_balls * self._cells
        self._largest = _LARGEST[len(stencils.shape) - 1] * stencils.n_balls // stencils.n_contacts

    @cached_property
    def _ends(self) -> Index:
        """(2, contacts) balls j and i of each contact."""
        i, j = (self._cells * ball[:, None] for ball in np.transpose(self.stencils.ends))
        far = number_cells(self.stencils.shape, self.stencils.shifts)
        return np.array([j + far, i + np.arange(self._cells)]).reshape(2, -1)

    @cached_property
    def _by_ball(self) -> tuple[Index, Index]:
        """Contacts of one ball after the other, and the places where those of each begin."""
        order = np.argsort(self._ends, axis=None, kind="stable")
        contacts = order % self._ends.shape[1]
        balls = self._ends.ravel()[order]
        return contacts, np.searchsorted(balls, np.arange(self._balls + 1))

    @cached_property
    def _rows(self) -> Array:
        """(2, kinds, rows, fields) coefficients of the motions of balls j, and less those of balls
        i.
        """
        kinds = self.stencils.n_contacts
        head, tail = self.stencils.coefficients
        rows = np.array([head, -tail]).reshape(2, -1, kinds, self.stencils.n_balls, self._fields)
        kind = np.arange(kinds)
        i, j = np.transpose(self.stencils.ends)
        return np.array([rows[0][:, kind, j], rows[1][:, kind, i]]).swapaxes(1, 2)

    def find_worst(self, forces: Array) -> Index:
        """Return the balls, with their neighbours, on which most of the ``forces`` (fields, L1,
        ..., Lp) are left.
        """
        by_ball = forces.reshape(self.stencils.n_balls, self._fields, self._cells)
        squares = np.einsum("bfc,bfc->bc", by_ball, by_ball).ravel()
        near = 1 + self._ends.size // self._balls  # a ball and its neighbours
        most = min(
            max(_MOST, int(_MOST_PART * self._balls)), max(1, self._largest // near), self._balls
        )
        worst = np.argsort(-squares, kind="stable")[:most]
        sums = np.cumsum(squares[worst])
        worst = worst[
            : int(np.searchsorted(sums, min(_HELD * float(np.sum(squares)), sums[-1]))) + 1
        ]
        return np.unique(self._ends[:, self._find_contacts(worst)])

    def join(self, balls: Index, added: Index) -> Index:
        """Return the balls of a patch and those ``added``, or all balls if these are many; the
        ``balls`` alone if the patch would be too large.
        """
        joined = np.union1d(balls, added)
        if joined.size > _WHOLE * self._balls and self._balls <= self._largest:
            return np.arange(self._balls)
        return joined if joined.size <= self._largest else balls

    def _find_contacts(self, balls: Index) -> Index:
        contacts, first = self._by_ball
        counts = first[balls + 1] - first[balls]
        starts = np.repeat(first[balls] - np.cumsum(counts) + counts, counts)
        return np.unique(contacts[starts + np.arange(starts.size)])

    def invert(self, balls: Index, tangent: Tangent) -> Put | None:
        """Return a function that sets the motions of the ``balls`` of a patch to those under a
        force, while all other balls are held; None if there is no inverse.

        The ``tangent`` has a mean stiffness of one. Forces and motions are (fields, L1, ..., Lp).
        """
        from scipy.sparse import eye_array  # imported here: most simulations do not need it

        contacts = self._find_contacts(balls)
        place = np.full(self._balls, -1)
        n = contacts.size
        place[balls] = np.arange(balls.size)
        # C of these contacts and of the balls of the patch, field after field of each
        parts = []
        rows = np.arange(self._rows.shape[2])
        for ends, coefficients in zip(place[self._ends[:, contacts]], self._rows, strict=True):
            inside = np.flatnonzero(ends >= 0)
            row = (inside[:, None] + n * rows)[..., None]
            column = (self._fields * ends[inside, None] + np.arange(self._fields))[:, None]
            parts.append((row, column, coefficients[contacts[inside] // self._cells]))
        c = compose(parts, (len(rows) * n, self._fields * balls.size))
        d = compose(_list_tangent_entries(tangent, contacts), (c.shape[0], c.shape[0]))
        matrix = c.T.tocsr() @ (d @ c) + HOLDING * eye_array(c.shape[1], format="csr")
        try:
            factors = factorise(matrix, symmetric=False, approximate=True)
        except RuntimeError:  # singular to the last digit
            return None
        index = balls // self._cells, slice(None), balls % self._cells
        shape = self.stencils.n_balls, self._fields, self._cells

        def put(force: Array, motion: Array) -> None:
            """Set the motions of the balls of the patch, in place, to those under a ``force``."""
            solution = factors.solve(force.reshape(shape)[index].ravel())
            motion.reshape(shape)[index] = solution.reshape(balls.size, self._fields)

        return put


def _list_tangent_entries(tangent: Tangent, contacts: Index) -> list[tuple[Index, Index, Array]]:
    """Return the entries of D of some ``contacts`` (n,): rows, columns and values. Elongations come
    first, slips along each tangent after them; D is not symmetric, as a force against slip depends
    on the elongation.
    """
    stiffness, springs, coupling, cross = (
        values.reshape(-1, tangent.stiffness.size)[:, contacts]
        for values in (tangent.stiffness, tangent.springs, tangent.coupling, tangent.cross)
    )
    n = contacts.size
    elongation = np.arange(n)
    slips = n * (1 + np.arange(len(springs)))[:, None] + elongation
    entries = [(elongation, elongation, stiffness[0])]
    entries += zip(slips, slips, springs, strict=True)
    entries += [(slip, elongation, -values) for values, slip in zip(coupling, slips, strict=True)]
    # in space two tangents, along which sliding couples slips both ways
    for values in cross:
        entries += [(slips[0], slips[1], -values), (slips[1], slips[0], -values)]
    return entries
