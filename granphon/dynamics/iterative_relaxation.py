"""The inner motions of cells of some ten thousand balls and more, relaxed by iteration: factors of
such cells in space would not fit into memory.

Conjugate gradients for all strains at once, which share each product with the sparse matrix; every
strain has its own step. The inverse of what holds each ball alone is the preconditioner. Motions of
single balls that deform no contact, as the rotation about the line through two contacts, are left
out by it; other motions that cost nothing take no part, as no strain pushes them.

The energy of a strain is the least that inner motions leave. So it has twice the digits of the
motions, and comes from above.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any

import numpy as np

from granphon.base.arrays import Array
from granphon.base.errors import ConvergenceError, InstabilityError
from granphon.base.progress import Progress, silent
from granphon.dynamics.compatibility import Compatibility
from granphon.dynamics.linalg import NO_ENERGY
from granphon.dynamics.two_levels import invert_blocks

#: size of the residual, over that at the start, with which the iteration is content: waves of
#: motions that cost nothing are told from sound by nine digits
_REDUCTION = 1e-11
#: most iterations; random packings of 1e5 balls take some hundred
_MOST = 20_000


class IterativeRelaxation:
    """Inner motions of the balls of a cell, which relax under the deformations of its contacts;
    reduced units. See :class:`~granphon.dynamics.sparse_relaxation.SparseRelaxation`.

    ``difference`` (n_rows, n_branches), sparse by rows, is the effect that the mass-weighted
    motions of all balls have on the deformations of contacts.
    """

    def __init__(
        self, lattice: Compatibility, difference: Any, progress: Progress = silent
    ) -> None:
        self._lattice = lattice
        self._rows = difference
        self._columns = difference.T.tocsr()
        self._progress = progress
        self._held, self._free = invert_blocks(
            (self._columns @ difference).tocsr(), lattice.motions.count
        )

    @property
    def free(self) -> Array:
        """(n_branches, n_free) the part that motions of single balls that deform no contact have of
        the shift of all balls; see :class:`~granphon.dynamics.sparse_relaxation.SparseRelaxation`.
        """
        shifts = self._lattice.shifts
        parts = self._free @ (self._free.T @ shifts)
        parts -= shifts @ (shifts.T @ parts)
        basis, sizes, _ = np.linalg.svd(parts, full_matrices=False)
        return np.asarray(basis[:, sizes > math.sqrt(NO_ENERGY)])

    def relax(self, deformations: Array) -> Array:
        """Return the part of deformations (n_rows, ...) that remains once the inner motions have
        relaxed.
        """
        flat = deformations.reshape(len(deformations), -1)
        remaining = flat - self._rows @ self.find_motions(flat)
        return np.asarray(remaining).reshape(deformations.shape)

    def find_motions(self, deformations: Array) -> Array:
        """Return the mass-weighted motions (n_branches, m) that make the part of deformations
        (n_rows, m) which does not remain.
        """
        return self._solve(
            lambda x: np.asarray(self._columns @ (self._rows @ x)), self._columns @ deformations
        )

    def eliminate(self, form: Array, mixed: Array, block: Any) -> Array:
        """Return an energy ``form`` (m, m) of gradients, with prestress, less the energy that inner
        motions save as they relax; for the arguments see
        :meth:`~granphon.dynamics.sparse_relaxation.SparseRelaxation.eliminate`.
        """
        held, response = self._respond(mixed, block)
        return np.asarray(form - held.T @ response)

    def respond(self, _form: Array, mixed: Array, block: Any) -> Array:
        """Return the mass-weighted inner motions (n_branches, m) that, taken away, leave the least
        energy; see :meth:`eliminate`.
        """
        return self._respond(mixed, block)[1]

    def _respond(self, mixed: Array, block: Any) -> tuple[Array, Array]:
        """Return the part of ``mixed`` that pulls at motions that something holds, and the motions,
        both (n_branches, m); the arguments are those of :meth:`eliminate`.
        """
        held = np.asarray(mixed - self._free @ (self._free.T @ mixed))
        return held, self._solve(lambda x: np.asarray(block @ x), held)

    def _solve(self, apply: Callable[[Array], Array], right: Array) -> Array:
        """Return the motions (n_branches, m) at which ``apply`` leaves the forces ``right``
        (n_branches, m), by conjugate gradients, all columns at once.

        Raises :class:`~granphon.base.errors.InstabilityError` for a direction in which the energy
        falls, and :class:`~granphon.base.errors.ConvergenceError` after 20,000 iterations.
        """
        motions = np.zeros_like(right)
        residual = right.copy()
        preconditioned = np.asarray(self._held @ residual)
        direction = preconditioned.copy()
        sizes = np.einsum("nm,nm->m", residual, preconditioned)
        limits = _REDUCTION**2 * sizes
        digits = -math.log10(_REDUCTION)
        reached = 0.0
        with self._progress.step("relax the balls", digits) as step:
            for _ in range(_MOST):
                is_open = sizes > limits
                if not np.any(is_open):
                    return motions
                forces = apply(direction)
                curvature = np.einsum("nm,nm->m", direction, forces)
                if np.any(curvature[is_open] <= 0.0):
                    raise InstabilityError(
                        "the network is not stable: it gives way to a uniform strain",
                        "Its static forces exceed what its springs hold",
                    )
                lengths = np.divide(sizes, curvature, out=np.zeros_like(sizes), where=is_open)
                motions += lengths * direction
                residual -= lengths * forces
                preconditioned = np.asarray(self._held @ residual)
                previous = sizes
                sizes = np.einsum("nm,nm->m", residual, preconditioned)
                growth = np.divide(sizes, previous, out=np.zeros_like(sizes), where=is_open)
                direction = preconditioned + growth * direction
                worst = float(np.max(np.sqrt(sizes / limits), where=limits > 0.0, initial=1.0))
                gained = digits - math.log10(max(worst, 1.0)) - reached
                step.advance(max(gained, 0.0))
                reached += max(gained, 0.0)
        raise ConvergenceError(f"the balls of the network do not relax within {_MOST} iterations")
