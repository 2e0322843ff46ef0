"""The inner motions of cells of many balls, relaxed by sparse factors.

Under a strain balls turn and shift until no force is left on them: the least squares of what
remains of the deformations of all contacts. The normal equations are sparse, and factorised by
:mod:`granphon.dynamics.fronts`. That takes half of the digits, and two corrections with the
deformations themselves give them back (the corrected seminormal equations, A. Bjorck, Linear
Algebra Appl. 88/89, 31, 1987).

Motions that cost nothing, or so little that the factors cannot tell, are set aside by these. They
are few, and are told apart by the singular values of the deformations that they make once all
others have relaxed: so they have the digits that a dense decomposition gives them.
"""

from __future__ import annotations

from functools import cached_property
from typing import Any

import numpy as np

from granphon.base.arrays import Array
from granphon.base.errors import InstabilityError
from granphon.base.progress import Progress, silent
from granphon.base.threads import single_products
from granphon.dynamics.compatibility import Compatibility
from granphon.dynamics.fronts import Fronts, Layer, dissect
from granphon.dynamics.rows import Row

#: ratio of the lowest to the highest eigenvalue of a matrix with prestress below which it is
#: rounding
_NO_SQUARE = 1e-12
#: coupling of an inner motion with strains, over its largest possible value, up to which it is
#: rounding
_UNCOUPLED = 1e-12
#: length that vectors of length one have left, if they depend on others, but for rounding
_DEPENDENT = 1e-9
#: corrections of a solution of the normal equations
_CORRECTIONS = 1


def compose_ends(lattice: Compatibility, rows: list[Row], root: Array) -> tuple[Any, Any]:
    """Return the effects of the mass-weighted motions of balls j, and of balls i, on contacts:
    (kinds x n_c, n_branches).

    The rows are multiplied by ``root`` (kinds, n_c). At q = 0 the deformations are the difference
    of both, in sparse rows.
    """
    from scipy.sparse import coo_array

    table = lattice.contacts
    n = lattice.n_balls
    count = lattice.motions.count
    ends: list[Any] = []
    for balls, coefficients in (
        (table.j, [row.head for row in rows]),
        (table.i, [row.tail for row in rows]),
    ):
        moving = np.flatnonzero(balls < n)  # contacts whose end is not a body that does not move
        weight = root[:, moving, None] * np.asarray(coefficients)[:, moving]
        weight = weight / np.sqrt(lattice.masses[balls[moving]])[:, None]
        line = (np.arange(len(rows))[:, None] * len(table) + moving)[..., None]
        column = (balls[moving] * count)[:, None] + np.arange(count)
        entries = tuple(np.broadcast_to(each, weight.shape).ravel() for each in (line, column))
        shape = (len(rows) * len(table), lattice.n_branches)
        ends.append(coo_array((weight.ravel(), entries), shape=shape).tocsr())
    return ends[0], ends[1]


class SparseRelaxation:
    """Inner motions of the balls of a cell, which relax under the deformations of its contacts;
    reduced units.

    ``gap`` and ``total`` (n_rows, n_branches) are the difference and the sum of the effects that
    the mass-weighted motions of all balls have at both ends of contacts, sparse by rows. A motion
    costs nothing if its singular value, over the largest, is up to ``soft``.
    """

    def __init__(
        self, lattice: Compatibility, gap: Any, total: Any, soft: float, progress: Progress = silent
    ) -> None:
        self.lattice = lattice
        with single_products():
            self._factorise(gap, soft, progress)
            self._find_free(total, soft)

    @cached_property
    def layers(self) -> list[Layer]:
        """Layers of balls that cut the cell into halves."""
        lattice = self.lattice
        p = lattice.periods
        table = lattice.contacts
        positions = lattice.positions.copy()
        along = positions[:, :p] @ np.linalg.inv(lattice.cell[:, :p])
        positions[:, :p] = (along - np.floor(along)) * np.linalg.norm(lattice.cell, axis=1)
        among = table.j < lattice.n_balls
        return dissect(positions, table.i[among], table.j[among])

    def _factorise(self, gap: Any, soft: float, progress: Progress) -> None:
        from scipy.sparse import diags_array

        lattice = self.lattice
        motions = self.lattice.motions
        size = np.sqrt(np.asarray(gap.power(2).sum(axis=0)))
        # a column that is only rounding, compared with others of its kind, belongs to a motion that
        # deforms nothing
        turns = np.tile(motions.is_rotation, lattice.n_balls)
        of_kind = np.where(
            turns, np.max(size, where=turns, initial=0.0), np.max(size, where=~turns, initial=0.0)
        )
        still = size <= soft * of_kind
        self._scale = np.where(still, 1.0, size)
        self._rows: Any = (gap @ diags_array(np.where(still, 0.0, 1.0 / self._scale))).tocsr()
        self._columns: Any = self._rows.T.tocsr()
        matrix = (self._columns @ self._rows).tocsr()
        self._top = _bound(matrix)
        self._fronts = Fronts(matrix, self.layers, motions.count, progress)

    def _find_free(self, total: Any, soft: float) -> None:
        """Tell motions that cost nothing from soft ones among those that the factors have set
        aside.

        Most motions that cost nothing move a few balls, and change nothing in a wave either. Only
        the part that these have of the shift of all balls is of interest: ``free`` holds this part,
        and all other motions that cost nothing.
        """
        from scipy.sparse import csc_array, diags_array

        aside = csc_array(self._fronts.follow())
        lengths = np.sqrt(aside.power(2).sum(axis=0))
        limit = soft * np.sqrt(self._top)
        costless = np.sqrt((self._rows @ aside).power(2).sum(axis=0)) <= limit * lengths
        moved = (diags_array(1.0 / self._scale) @ aside).tocsc()
        change = (total @ moved).tocoo()
        row_lengths = np.sqrt(total.power(2).sum(axis=1))
        column_lengths = np.sqrt(moved.power(2).sum(axis=0))
        rounding = soft * row_lengths[change.row] * column_lengths[change.col]
        idle = costless
        idle[change.col[np.abs(change.data) > rounding]] = False
        active = aside[:, ~idle].toarray()
        for _ in range(_CORRECTIONS):
            active -= self._fronts.solve(self._columns @ (self._rows @ active))
        basis = np.linalg.qr(_leave_out(aside[:, idle], active))[0]
        deformations, values, right = np.linalg.svd(self._rows @ basis, full_matrices=False)
        free = values <= limit
        self._soft_deformations = deformations[:, ~free]
        apart = _leave_out(moved[:, idle], basis @ right[free].T / self._scale[:, None])
        shifts = self._shifts
        idle_shifts = _orthonormalise(shifts - _leave_out(moved[:, idle], shifts))
        motions = np.concatenate([idle_shifts, apart], axis=1)
        self.free: Array = _orthonormalise(motions - shifts @ (shifts.T @ motions))

    @property
    def _shifts(self) -> Array:
        """(n_branches, n_u) the shifts of all balls, orthonormal; none if bodies that do not move
        hold them.
        """
        lattice = self.lattice
        count = len(self.lattice.motions.translations)
        shifts = np.zeros((lattice.n_balls, lattice.motions.count, count))
        shifts[:, np.arange(count), np.arange(count)] = np.sqrt(
            lattice.masses / lattice.masses.sum()
        )[:, None]
        return shifts.reshape(lattice.n_branches, count)[:, : 0 if lattice.is_held else count]

    def relax(self, deformations: Array) -> Array:
        """Return the part of deformations (n_rows, ...) that remains once the inner motions have
        relaxed.
        """
        relaxed = deformations.reshape(len(deformations), -1)
        with single_products():
            for _ in range(1 + _CORRECTIONS):
                motion = self._fronts.solve(self._columns @ relaxed)
                relaxed = relaxed - self._rows @ motion
        soft = self._soft_deformations
        relaxed = relaxed - soft @ (soft.T @ relaxed)
        return relaxed.reshape(deformations.shape)

    def eliminate(self, form: Array, mixed: Array, block: Any) -> Array:
        """Return an energy ``form`` (m, m) of gradients, with prestress, less the energy that inner
        motions save as they relax.

        ``mixed`` (n_branches, m) is the form of an inner motion and a gradient, and the sparse
        ``block`` (n_branches, n_branches) that of two inner motions. Raises
        :class:`~granphon.base.errors.InstabilityError` if an inner motion has a negative energy.
        """
        from scipy.sparse import diags_array

        lattice = self.lattice
        scale = diags_array(1.0 / self._scale)
        matrix = (scale @ block @ scale).tocsr()
        with single_products():
            fronts = Fronts(matrix, self.layers, lattice.motions.count)
            loose = fronts.follow()
            for _ in range(_CORRECTIONS):
                loose -= fronts.solve(matrix @ loose)
            basis = np.linalg.qr(loose / self._scale[:, None])[0]
            costs = basis.T @ (block @ basis)
            values, vectors = np.linalg.eigh(0.5 * (costs + costs.T))
            top = _bound(block)
            motions = basis @ vectors
            largest = np.sqrt(np.linalg.norm(form) * top)
            coupling = np.max(np.abs(motions.T @ mixed), axis=1, initial=0.0) / largest
            # a motion that no strain moves belongs to another wave vector of a smaller cell
            is_negative = values < -max(_NO_SQUARE, lattice.slack) * top
            unstable = np.flatnonzero(is_negative & (coupling > _UNCOUPLED))
            if unstable.size:
                raise self._explain_buckling(block, motions[:, unstable[0]])
            # D lacks the part of static forces without a potential; the whole forces do not act on
            # motions that cost nothing
            stiff = values > _NO_SQUARE * top
            free = motions[:, ~stiff]
            mixed = mixed - free @ (free.T @ mixed)
            pull = np.asarray(scale @ mixed)
            motion = np.zeros_like(pull)
            for _ in range(1 + _CORRECTIONS):
                motion += fronts.solve(pull - matrix @ motion)
        forces = motions[:, stiff].T @ mixed
        return np.asarray(form - pull.T @ motion - forces.T @ (forces / values[stiff, None]))

    def _explain_buckling(self, block: Any, motion: Array) -> InstabilityError:
        lattice = self.lattice
        squared = float(motion @ (block @ motion) / (motion @ motion))
        where = (
            f"a squared frequency at {lattice.name_wavevector(np.zeros(lattice.periods))} is"
            f" {squared:.3g} k/M or below"
        )
        moved = motion.reshape(lattice.n_balls, -1)[:, lattice.motions.translating]
        return lattice.explain_buckling(where, moved.T)


def _bound(matrix: Any) -> float:
    """Return a bound of the eigenvalues of a sparse symmetric matrix."""
    return float(np.max(abs(matrix).sum(axis=1), initial=0.0))


def _leave_out(basis: Any, vectors: Array) -> Array:
    """Return vectors (n, m) without what they have of the sparse, independent columns of a
    ``basis`` (n, k).
    """
    products = (basis.T @ basis).toarray()
    return np.asarray(vectors - basis @ np.linalg.solve(products, basis.T @ vectors))


def _orthonormalise(vectors: Array) -> Array:
    """Return an orthonormal basis (n, r) of what vectors (n, m) span."""
    basis, values, _ = np.linalg.svd(vectors, full_matrices=False)
    return np.asarray(basis[:, values > _DEPENDENT])
