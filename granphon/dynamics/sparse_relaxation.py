"""The inner motions of cells of many balls, relaxed by sparse factors.

Under a strain, balls turn and shift until no force is left on them. That is a problem of least
squares: the sum of the squares of the deformations of all contacts becomes least. The normal
equations are sparse, and factorised by :mod:`granphon.dynamics.fronts`. The equations lose half of
the digits, and a correction with the deformations themselves gives the digits back (the corrected
seminormal equations, A. Bjorck, Linear Algebra Appl. 88/89, 31, 1987).

The factors set aside motions that cost nothing, or so little that the factors cannot tell. Such
motions are few. Singular values of the deformations that they make, once all others have relaxed,
tell the free motions from the soft ones, with the digits of a dense decomposition.
"""

from __future__ import annotations

from functools import cached_property
from typing import Any

import numpy as np

from granphon.base.arrays import Array, Flags
from granphon.base.errors import InstabilityError
from granphon.base.progress import Progress, silent
from granphon.base.threads import single_products
from granphon.dynamics.compatibility import Compatibility
from granphon.dynamics.deformation_rows import Row
from granphon.dynamics.fronts import Fronts, Layer, dissect
from granphon.dynamics.linalg import DEPENDENCE

#: eigenvalue of a matrix with prestress, over the largest, up to which it is the rounding of zero
NO_SQUARE = 1e-12
#: coupling of an inner motion with strains, over its largest possible value, up to which it is
#: rounding
_COUPLING_ROUNDING = 1e-12
#: number of corrections of a solution of the normal equations
_CORRECTIONS = 1


def compose_ends(lattice: Compatibility, rows: list[Row], root: Array) -> tuple[Any, Any]:
    """Return the effects on ``rows`` of a ``lattice`` of the mass-weighted motions of balls j, and
    those of balls i, as two sparse matrices (kinds * n_c, n_branches).

    The rows are multiplied by ``root`` (kinds, n_c). The difference of both matrices takes motions
    at q = 0 to the deformations of contacts.
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
        contacts = np.flatnonzero(balls < n)  # those with a ball at this end that can move
        # entries (kinds, contacts, motions of a ball), with their rows and columns
        effects = root[:, contacts, None] * np.asarray(coefficients)[:, contacts]
        effects = effects / np.sqrt(lattice.masses[balls[contacts]])[:, None]
        line = (np.arange(len(rows))[:, None] * len(table) + contacts)[..., None]
        column = (balls[contacts] * count)[:, None] + np.arange(count)
        lines = np.broadcast_to(line, effects.shape).ravel()
        columns = np.broadcast_to(column, effects.shape).ravel()
        shape = (len(rows) * len(table), lattice.n_branches)
        ends.append(coo_array((effects.ravel(), (lines, columns)), shape=shape).tocsr())
    return ends[0], ends[1]


def find_rounded_columns(size: Array, is_turn: Flags, limit: float) -> Flags:
    """Return (n,) whether each column of the deformations by inner motions is only rounding, so
    that its motion deforms nothing. That is so if the ``size`` (n,) of the column, over the largest
    size of its kind, is up to the ``limit``; kinds are rotations, for which ``is_turn`` (n,) is
    true, and displacements.
    """
    largest_turn = np.max(size, where=is_turn, initial=0.0)
    largest_shift = np.max(size, where=~is_turn, initial=0.0)
    return np.asarray(size <= limit * np.where(is_turn, largest_turn, largest_shift))


class SparseRelaxation:
    """Inner motions of the balls of the cell of a ``lattice``, which relax as the cell is strained,
    by sparse factors; in reduced units.

    ``difference`` and ``total`` (n_rows, n_branches), sparse by rows, are the difference and the
    sum of the effects that the mass-weighted motions of all balls have at both ends of contacts.
    Each column of the difference is divided by its length; a motion then costs nothing if its
    singular value, over a bound of the largest, is up to the ``limit``.

    The attribute ``free`` (n_branches, n_free) holds orthonormal motions that cost nothing. Most of
    these move a few balls and deform nothing in a wave either; of them only their part in the
    shifts of all balls is held. No motion of ``free`` contains a shift of all balls itself.

    Raises :class:`~granphon.base.errors.InputError` if the factors do not fit into memory.
    """

    #: error of deformations that have relaxed, over the largest
    accuracy = 1e-12
    #: whether motions that deform contacts stay behind: only iteration can leave them
    keeps_back = False

    def __init__(
        self,
        lattice: Compatibility,
        difference: Any,
        total: Any,
        limit: float,
        progress: Progress = silent,
    ) -> None:
        """Factorise the normal equations, tell the ``progress``, and find the free motions."""
        self.lattice = lattice
        self._limit = limit
        with single_products():
            self._factorise(difference, progress)
            self._set_free_motions(total)

    @property
    def n_free(self) -> int:
        """Number n_free of the motions of ``free``."""
        return int(self.free.shape[1])

    @property
    def finds_gears(self) -> bool:
        """Whether motions that cost nothing may be those of several balls that turn as gears."""
        return bool(self.n_free)

    @cached_property
    def layers(self) -> list[Layer]:
        """Layers of balls that cut the cell into halves, halves of halves, and so on."""
        lattice = self.lattice
        p = lattice.periods
        table = lattice.contacts
        positions = lattice.positions.copy()
        fractions = positions[:, :p] @ np.linalg.inv(lattice.cell[:, :p])
        lengths = np.linalg.norm(lattice.cell, axis=1)
        positions[:, :p] = (fractions - np.floor(fractions)) * lengths
        joins_balls = table.j < lattice.n_balls
        return dissect(positions, table.i[joins_balls], table.j[joins_balls])

    def _factorise(self, difference: Any, progress: Progress) -> None:
        """Factorise the normal equations of the columns of ``difference`` (n_rows, n_branches),
        each divided by its length; set the scale of the columns, the scaled matrix, a bound of its
        eigenvalues and its factors. ``progress`` is told how far the factors have come.
        """
        from scipy.sparse import diags_array

        lattice = self.lattice
        motions = self.lattice.motions
        size = np.sqrt(np.asarray(difference.power(2).sum(axis=0)))
        is_turn = np.tile(motions.is_rotation, lattice.n_balls)
        is_rounding = find_rounded_columns(size, is_turn, self._limit)
        self._scale = np.where(is_rounding, 1.0, size)
        inverse_scale = np.where(is_rounding, 0.0, 1.0 / self._scale)
        self._rows: Any = (difference @ diags_array(inverse_scale)).tocsr()
        self._columns: Any = self._rows.T.tocsr()
        matrix = (self._columns @ self._rows).tocsr()
        self._top = _bound(matrix)
        self._fronts = Fronts(matrix, self.layers, motions.count, progress)

    def _set_free_motions(self, total: Any) -> None:
        """Set ``free``, as the class describes it, from the motions that the factors have set
        aside. Set ``_soft_deformations`` (n_rows, k) and ``_soft_motions`` (n_branches, k) of the k
        soft ones among these, which cost a little: the components of these motions are times the
        scales of their columns, by unit deformations. ``total`` is that of the class.
        """
        from scipy.sparse import csc_array, diags_array

        # the motions set aside, each component times the scale of its column
        scaled_motions = csc_array(self._fronts.follow())
        motions = (diags_array(1.0 / self._scale) @ scaled_motions).tocsc()
        # idle motions cost nothing, and deform nothing in a wave either; all others are active
        is_idle = self._are_free(scaled_motions) & self._are_free_in_wave(motions, total)
        active_motions = scaled_motions[:, ~is_idle].toarray()
        for _ in range(_CORRECTIONS):
            active_motions -= self._fronts.solve(self._columns @ (self._rows @ active_motions))
        basis = np.linalg.qr(_leave_out(scaled_motions[:, is_idle], active_motions))[0]
        deformations, singular_values, right_vectors = np.linalg.svd(
            self._rows @ basis, full_matrices=False
        )
        is_free = singular_values <= self._limit * np.sqrt(self._top)
        self._soft_deformations = deformations[:, ~is_free]
        self._soft_motions = basis @ (right_vectors[~is_free] / singular_values[~is_free, None]).T
        idle_motions = motions[:, is_idle]
        free_active = _leave_out(
            idle_motions, basis @ right_vectors[is_free].T / self._scale[:, None]
        )
        shifts = self.lattice.shifts
        idle_shifts = _orthonormalise(shifts - _leave_out(idle_motions, shifts))
        with_shifts = np.concatenate([idle_shifts, free_active], axis=1)
        self.free: Array = _orthonormalise(with_shifts - shifts @ (shifts.T @ with_shifts))

    def _are_free(self, scaled_motions: Any) -> Flags:
        """Return (k,) whether each of the sparse ``scaled_motions`` (n_branches, k), whose
        components are times the scales of their columns, costs nothing.
        """
        lengths = np.sqrt(scaled_motions.power(2).sum(axis=0))
        sizes = np.sqrt((self._rows @ scaled_motions).power(2).sum(axis=0))  # of deformations
        return np.asarray(sizes <= self._limit * np.sqrt(self._top) * lengths)

    def _are_free_in_wave(self, motions: Any, total: Any) -> Flags:
        """Return (k,) whether each of the sparse ``motions`` (n_branches, k) deforms nothing to
        first order in q; ``total`` is that of the class.
        """
        change = (total @ motions).tocoo()
        row_lengths = np.sqrt(total.power(2).sum(axis=1))
        column_lengths = np.sqrt(motions.power(2).sum(axis=0))
        rounding = self._limit * row_lengths[change.row] * column_lengths[change.col]
        are_free = np.ones(motions.shape[1], bool)
        are_free[change.col[np.abs(change.data) > rounding]] = False
        return are_free

    def relax(self, deformations: Array) -> Array:
        """Return the part of the ``deformations`` (n_rows, ...) that remains once the inner motions
        have relaxed.
        """
        remainder, _ = self._relax(deformations)
        return remainder

    def find_motions(self, deformations: Array) -> Array:
        """Return the mass-weighted motions (n_branches, m) whose deformations are the part of the
        ``deformations`` (n_rows, m) that does not remain.
        """
        _, motions = self._relax(deformations)
        return np.asarray(motions / self._scale[:, None])

    def _relax(self, deformations: Array) -> tuple[Array, Array]:
        """Return the part of the ``deformations`` (n_rows, ...) that remains, and the motions
        (n_branches, m) that make the part that does not, with components times the scales of their
        columns; m is the number of columns of deformations.
        """
        remainder = deformations.reshape(len(deformations), -1)
        motions = np.zeros((len(self._scale), remainder.shape[1]))
        with single_products():
            for _ in range(1 + _CORRECTIONS):
                motion = self._fronts.solve(self._columns @ remainder)
                remainder = remainder - self._rows @ motion
                motions += motion
        # motions that the factors have set aside, and that deform contacts, relax last
        amplitudes = self._soft_deformations.T @ remainder
        remainder = remainder - self._soft_deformations @ amplitudes
        motions += self._soft_motions @ amplitudes
        return remainder.reshape(deformations.shape), motions

    def eliminate(self, form: Array, mixed: Array, block: Any) -> Array:
        """Return the energy ``form`` (m, m) of m displacement gradients under static forces, less
        what inner motions save as they relax.

        ``mixed`` (n_branches, m) is the energy form of an inner motion and a gradient, and the
        sparse ``block`` (n_branches, n_branches) that of two inner motions. Raises
        :class:`~granphon.base.errors.InstabilityError` if an inner motion that a gradient moves has
        a negative energy.
        """
        saved_energy, _ = self._respond(form, mixed, block)
        return np.asarray(form - saved_energy)

    def respond(self, form: Array, mixed: Array, block: Any) -> Array:
        """Return the mass-weighted inner motions (n_branches, m) that leave the least energy when
        they are subtracted; the arguments are those of :meth:`eliminate`.
        """
        _, motions = self._respond(form, mixed, block)
        return motions

    def _respond(self, form: Array, mixed: Array, block: Any) -> tuple[Array, Array]:
        """Return the energy (m, m) that inner motions save, and these motions (n_branches, m), with
        the sign of :meth:`respond`. The arguments and the error are those of :meth:`eliminate`.

        Sparse factors relax most inner motions. The few that the factors have set aside, as they
        cost little or nothing, are relaxed one by one, each by its own energy.
        """
        from scipy.sparse import diags_array

        lattice = self.lattice
        scale = diags_array(1.0 / self._scale)
        matrix = (scale @ block @ scale).tocsr()
        with single_products():
            fronts = Fronts(matrix, self.layers, lattice.motions.count)
            energies, motions = self._find_set_aside(fronts, matrix, block)
            highest = _bound(block)
            is_negative = energies < -max(NO_SQUARE, lattice.slack) * highest
            # no coupling is larger than the root of the product of both energies
            largest_pull = np.sqrt(np.linalg.norm(form) * highest)
            self._require_unmoved(
                motions[:, is_negative], mixed, _COUPLING_ROUNDING * largest_pull, block
            )
            # motions that cost nothing are left out. Static forces do not act on them; that
            # `mixed` has a part of them is due to the part without a potential, which D lacks
            is_stiff = energies > NO_SQUARE * highest
            free_motions = motions[:, ~is_stiff]
            forces = mixed - free_motions @ (free_motions.T @ mixed)
            pull = np.asarray(scale @ forces)
            response = np.zeros_like(pull)
            for _ in range(1 + _CORRECTIONS):
                response += fronts.solve(pull - matrix @ response)
        saved_by_factors = pull.T @ response
        stiff_motions = motions[:, is_stiff]
        forces_on_stiff = stiff_motions.T @ forces
        amplitudes = forces_on_stiff / energies[is_stiff, None]
        saved_by_stiff = forces_on_stiff.T @ amplitudes
        response_of_all = scale @ response + stiff_motions @ amplitudes
        return saved_by_factors + saved_by_stiff, np.asarray(response_of_all)

    def _find_set_aside(self, fronts: Fronts, matrix: Any, block: Any) -> tuple[Array, Array]:
        """Return the energies (k,), ascending, of the motions that factors have set aside, and
        these motions (n_branches, k), orthonormal, in combinations that are not coupled.

        ``fronts`` are the factors of the sparse ``matrix``, which is the energy form ``block``
        (n_branches, n_branches) in units of the scale of the columns.
        """
        # each motion that the factors set aside, with all other motions as they follow it; each
        # correction takes away the forces that rounding has left on the others
        motions = fronts.follow()
        for _ in range(_CORRECTIONS):
            motions -= fronts.solve(matrix @ motions)
        basis = np.linalg.qr(motions / self._scale[:, None])[0]
        energy_form = basis.T @ (block @ basis)
        energies, vectors = np.linalg.eigh(0.5 * (energy_form + energy_form.T))
        return energies, basis @ vectors

    def _require_unmoved(
        self, negative_motions: Array, mixed: Array, rounding: float, block: Any
    ) -> None:
        """Raise :class:`~granphon.base.errors.InstabilityError` if a gradient moves one of the
        ``negative_motions`` (n_branches, k) of negative energy: if it pulls on the motion by more
        than ``rounding``. A motion that no gradient moves belongs to another wave vector of a
        smaller cell.

        ``mixed`` and ``block`` are those of :meth:`eliminate`.
        """
        pulls = np.max(np.abs(negative_motions.T @ mixed), axis=1, initial=0.0)
        moved_numbers = np.flatnonzero(pulls > rounding)
        if moved_numbers.size:
            raise self._explain_buckling(block, negative_motions[:, moved_numbers[0]])

    def _explain_buckling(self, block: Any, motion: Array) -> InstabilityError:
        """Return the error of a lattice whose inner ``motion`` (n_branches,) has a negative energy
        under the form ``block`` (n_branches, n_branches).
        """
        lattice = self.lattice
        squared = float(motion @ (block @ motion) / (motion @ motion))
        where = (
            f"a squared frequency at {lattice.name_wavevector(np.zeros(lattice.periods))} is"
            f" {squared:.3g} k/M or below"
        )
        displacements = motion.reshape(lattice.n_balls, -1)[:, lattice.motions.translating]
        return lattice.explain_buckling(where, displacements.T)


def _bound(matrix: Any) -> float:
    """Return an upper bound of the magnitudes of the eigenvalues of a sparse symmetric ``matrix``:
    the largest sum of magnitudes of a row, by Gershgorin's theorem.
    """
    return float(np.max(abs(matrix).sum(axis=1), initial=0.0))


def _leave_out(basis: Any, vectors: Array) -> Array:
    """Return the parts of ``vectors`` (n, m) that are perpendicular to the columns of a sparse
    ``basis`` (n, k), which are independent.
    """
    products = (basis.T @ basis).toarray()
    return np.asarray(vectors - basis @ np.linalg.solve(products, basis.T @ vectors))


def _orthonormalise(vectors: Array) -> Array:
    """Return an orthonormal basis (n, r) of the space that ``vectors`` (n, m) span, without the
    directions whose singular values are :data:`~granphon.dynamics.linalg.DEPENDENCE` or less.
    """
    basis, singular_values, _ = np.linalg.svd(vectors, full_matrices=False)
    return np.asarray(basis[:, singular_values > DEPENDENCE])
