"""The inner motions of cells of some ten thousand balls and more, relaxed by iteration: factors of
such cells in space would not fit into memory.

Conjugate gradients find the motions for all strains at once. All strains share each product with
the sparse matrix, and every strain has a step length of its own. The preconditioner is the inverse
of the stiffness of each ball with its neighbours at rest. It leaves out motions of single balls
that deform no contact, such as the rotation about the line through two contacts. Other motions that
cost nothing take no part, as no strain pushes them.

The energy of a strain is the minimum over the inner motions. So the error of the energy is of
second order in that of the motions, and never negative.
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

#: size of the residual, over that at the start, at which the iteration ends: nine digits are needed
#: to tell waves of motions that cost nothing from sound
_REDUCTION = 1e-11
#: largest number of iterations; random packings of 1e5 balls take some hundred
_MOST_ITERATIONS = 20_000
#: random motions in which loose ones are looked for. One would hide a loose motion once in 100
_PROBES = 2
#: size of what is left of them from which on a motion is loose: a standard normal number is above
#: it 99 times in 100, and the iteration leaves less than a thousandth of it
_LOOSE = 1e-2


class IterativeRelaxation:
    """Inner motions of the balls of the cell of a ``lattice``, which relax as the cell is strained,
    by conjugate gradients; in reduced units. Its methods are those of
    :class:`~granphon.dynamics.sparse_relaxation.SparseRelaxation`.

    ``difference`` (n_rows, n_branches), sparse by rows, takes the mass-weighted motions of all
    balls to the deformations of contacts.

    Its methods raise :class:`~granphon.base.errors.ConvergenceError` after too many iterations, and
    under static forces :class:`~granphon.base.errors.InstabilityError` for a direction in which the
    energy falls.
    """

    #: error of deformations that have relaxed, over the largest
    accuracy = 1e-9

    def __init__(
        self, lattice: Compatibility, difference: Any, progress: Progress = silent
    ) -> None:
        """Find the preconditioner; ``progress`` is told how far each later solution has come."""
        self._lattice = lattice
        self._rows = difference
        self._columns = difference.T.tocsr()
        self._progress = progress
        self._held, self._free = invert_blocks(
            (self._columns @ difference).tocsr(), lattice.motions.count
        )

    @property
    def free(self) -> Array:
        """(n_branches, n_free) orthonormal motions that cost nothing and would mix with sound: the
        part of the shifts of all balls that single balls can make without deforming a contact, less
        the shifts themselves.
        """
        shifts = self._lattice.shifts
        parts = self._free @ (self._free.T @ shifts)
        parts -= shifts @ (shifts.T @ parts)
        basis, sizes, _ = np.linalg.svd(parts, full_matrices=False)
        return np.asarray(basis[:, sizes > math.sqrt(NO_ENERGY)])

    @property
    def leaves_loose(self) -> bool:
        """Whether several balls can move together at no cost, but for shifts of all balls and what
        each ball can do alone: such motions are missing from :attr:`free`.

        What deforms contacts as random motions do, found by iteration, differs from these motions
        by what costs nothing. One loose motion of many leaves a normal random number there.
        """
        shifts = self._lattice.shifts
        given = np.random.default_rng(0).standard_normal((len(shifts), _PROBES))
        rest = given - self.find_motions(np.asarray(self._rows @ given))
        alone, _sizes, _ = np.linalg.svd(
            shifts - self._free @ (self._free.T @ shifts), full_matrices=False
        )
        rest -= self._free @ (self._free.T @ rest)
        rest -= alone @ (alone.T @ rest)
        return bool(np.max(np.linalg.norm(rest, axis=0)) > _LOOSE)

    def relax(self, deformations: Array) -> Array:
        """Return the part of the ``deformations`` (n_rows, ...) that remains once the inner motions
        have relaxed.
        """
        flat = deformations.reshape(len(deformations), -1)
        remaining = flat - self._rows @ self.find_motions(flat)
        return np.asarray(remaining).reshape(deformations.shape)

    def find_motions(self, deformations: Array) -> Array:
        """Return the mass-weighted motions (n_branches, m) whose deformations are the part of the
        ``deformations`` (n_rows, m) that does not remain.
        """
        return self._solve(
            lambda x: np.asarray(self._columns @ (self._rows @ x)), self._columns @ deformations
        )

    def eliminate(self, form: Array, mixed: Array, block: Any) -> Array:
        """Return the energy ``form`` (m, m) of displacement gradients under static forces, less
        what inner motions save as they relax. The arguments are those of
        :meth:`~granphon.dynamics.sparse_relaxation.SparseRelaxation.eliminate`.
        """
        held, response = self._respond(mixed, block)
        return np.asarray(form - held.T @ response)

    def respond(self, _form: Array, mixed: Array, block: Any) -> Array:
        """Return the mass-weighted inner motions (n_branches, m) that leave the least energy when
        they are subtracted; the arguments are those of :meth:`eliminate`.
        """
        _, motions = self._respond(mixed, block)
        return motions

    def _respond(self, mixed: Array, block: Any) -> tuple[Array, Array]:
        """Return the part of ``mixed`` without motions of single balls that deform no contact, and
        the inner motions that respond to it, both (n_branches, m). The arguments are those of
        :meth:`eliminate`.
        """
        held = np.asarray(mixed - self._free @ (self._free.T @ mixed))
        return held, self._solve(lambda x: np.asarray(block @ x), held)

    def _solve(self, apply: Callable[[Array], Array], right: Array) -> Array:
        """Return the motions (n_branches, m) that ``apply`` takes to ``right`` (n_branches, m), by
        conjugate gradients for all columns at once.

        ``apply`` multiplies by a symmetric matrix. Raises
        :class:`~granphon.base.errors.InstabilityError` for a direction in which the energy falls,
        and :class:`~granphon.base.errors.ConvergenceError` after :data:`_MOST_ITERATIONS`.
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
            for _ in range(_MOST_ITERATIONS):
                is_open = sizes > limits
                if not np.any(is_open):
                    return motions
                forces = apply(direction)
                curvature = np.einsum("nm,nm->m", direction, forces)
                if np.any(curvature[is_open] <= 0.0):
                    raise InstabilityError(
                        "the network is not stable: it gives way to a uniform strain",
                        "Its static forces exceed what its springs hold",
                        "Lower the load, or leave static forces out (prestress=False)",
                    )
                lengths = np.divide(sizes, curvature, out=np.zeros_like(sizes), where=is_open)
                motions += lengths * direction
                residual -= lengths * forces
                preconditioned = np.asarray(self._held @ residual)
                previous = sizes
                sizes = np.einsum("nm,nm->m", residual, preconditioned)
                growth = np.divide(sizes, previous, out=np.zeros_like(sizes), where=is_open)
                direction = preconditioned + growth * direction
                # a column of zeros has no residual, and none to reach
                ratios = np.divide(sizes, limits, out=np.ones_like(sizes), where=limits > 0.0)
                worst = math.sqrt(float(np.max(ratios, initial=1.0)))
                gained = digits - math.log10(worst) - reached
                step.advance(max(gained, 0.0))
                reached += max(gained, 0.0)
        raise ConvergenceError(
            f"the balls of the network do not relax within {_MOST_ITERATIONS} iterations",
            "Parts of it may cost almost no energy to move",
            "Take a smaller network, which is relaxed by factors, or one with more contacts",
        )
