"""The lowest eigenvalues of a large sparse Hermitian matrix, by a block of vectors.

In each turn the block X is joined by its preconditioned residuals W and by the last change P of the
block; of the space of all three the lowest Ritz vectors are the next block (A. V. Knyazev, SIAM J.
Sci. Comput. 23, 517, 2001). The basis is orthonormal in each turn, so that no digit is lost where
vectors have converged. The block has more vectors than are requested: the last ones converge late.

Each eigenvector has a share in a random vector. So in the end fresh random vectors, kept free of
those that were found, are followed down until they settle: above the last eigenvalue, or below,
where one was missing.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from granphon.base.arrays import Array
from granphon.base.errors import ConvergenceError
from granphon.base.progress import Progress, silent

#: vectors of the block beyond those that are requested: at least, and over the requested ones
SPARE = 8
_SPARE_SHARE = 0.4
#: most turns; packings of 1e5 balls take some fifty
_MOST = 500
#: fresh random vectors
_FRESH = 4
#: residual of the lowest fresh vector, over its distance from the last eigenvalue, at which it has
#: settled
_SETTLED = 0.1
#: most times that missing eigenvectors are taken up
_ROUNDS = 4
#: eigenvalue of the products of vectors, over the largest, up to which they depend on each other
_DEPENDENT = 1e-14


class LowestModes(NamedTuple):
    """Eigenvalues (m,), ascending, orthonormal vectors (size, m), and the norms of their residuals
    (m,).
    """

    values: Array
    vectors: NDArray[Any]
    residuals: Array


@dataclass
class _Block:
    """Orthonormal ``vectors`` X (size, m), their ``images`` A X, Ritz ``values`` (m,), ascending,
    and the last ``change`` (size, k) of the vectors.
    """

    vectors: NDArray[Any]
    images: NDArray[Any]
    values: Array
    change: NDArray[Any]

    def find_residuals(self) -> NDArray[Any]:
        """Return A X - X values, (size, m)."""
        return np.asarray(self.images - self.vectors * self.values)


def size_block(count: int) -> int:
    """Return the number of vectors of the block with which ``count`` eigenvectors are found."""
    return count + max(SPARE, math.ceil(_SPARE_SHARE * count))


class LowestSearch:
    """The search for the lowest eigenvalues of a Hermitian ``matrix``.

    ``precondition`` returns about the inverse of the matrix times vectors (size, m); ``known``
    (size, k) are orthonormal eigenvectors that do not count, sparse or not. An eigenvector is found
    when its residual is below the ``tolerance``.
    """

    def __init__(
        self,
        matrix: Any,
        precondition: Callable[[NDArray[Any]], NDArray[Any]],
        tolerance: float,
        known: Any = None,
        progress: Progress = silent,
    ) -> None:
        self._matrix = matrix
        self._precondition = precondition
        self._tolerance = tolerance
        self._known = known
        self._progress = progress
        self._random = np.random.default_rng(0)

    def find(self, count: int) -> LowestModes:
        """Return the ``count`` lowest eigenvalues and their vectors.

        Raises :class:`~granphon.base.errors.ConvergenceError` where they are not found in 500
        turns.
        """
        block = self._begin(size_block(count), None)
        for _ in range(_ROUNDS):
            block = self._converge(block, count)
            missing = self._find_missing(block, count)
            if missing is None:
                residuals = np.linalg.norm(block.find_residuals()[:, :count], axis=0)
                return LowestModes(block.values[:count], block.vectors[:, :count], residuals)
            joined = np.hstack([block.vectors, missing.vectors])
            block = self._make_block(joined, size_block(count))
        raise self._explain(count)

    def _draw(self, count: int) -> NDArray[Any]:
        """Return random vectors (size, count)."""
        vectors = self._random.normal(size=(self._matrix.shape[0], count))
        if np.iscomplexobj(self._matrix.data):
            return vectors + 1.0j * self._random.normal(size=vectors.shape)
        return vectors

    def _begin(self, size: int, others: NDArray[Any] | None) -> _Block:
        """Return a block of ``size`` random vectors, preconditioned, without ``others``."""
        vectors = self._free(self._precondition(self._draw(size)), others)
        return self._make_block(_orthonormalise(vectors), size)

    def _make_block(self, basis: NDArray[Any], size: int) -> _Block:
        """Return the block of the ``size`` lowest Ritz vectors of an orthonormal ``basis``."""
        images = self._matrix @ basis
        values, turn = np.linalg.eigh(_symmetrise(basis.conj().T @ images))
        turn = turn[:, :size]
        return _Block(basis @ turn, images @ turn, values[:size], basis[:, :0])

    def _free(self, vectors: NDArray[Any], others: NDArray[Any] | None) -> NDArray[Any]:
        """Return vectors (size, m) without what they have of the known eigenvectors and of
        orthonormal ``others`` (size, k).
        """
        for basis in (self._known, others):
            if basis is not None and basis.shape[1]:
                vectors = vectors - basis @ (basis.conj().T @ vectors)
        return np.asarray(vectors)

    def _turn(self, block: _Block, residuals: NDArray[Any], others: NDArray[Any] | None) -> _Block:
        """Return the next block, of the space of the block, of the ``residuals`` (size, k) of some
        of its vectors, preconditioned, and of its last change.
        """
        x = block.vectors
        m = x.shape[1]
        space = np.hstack([self._free(self._precondition(residuals), others), block.change])
        # the lengths of residuals differ by orders: each counts alike
        space /= np.maximum(np.linalg.norm(space, axis=0), np.finfo(float).tiny)
        for _ in range(2):  # twice is enough
            space -= x @ (x.conj().T @ space)
            space = _orthonormalise(space)
        images = self._matrix @ space
        mixed = x.conj().T @ images
        energies = np.block(
            [[np.diag(block.values), mixed], [mixed.conj().T, space.conj().T @ images]]
        )
        values, turn = np.linalg.eigh(_symmetrise(energies))
        old, new = turn[:m, :m], turn[m:, :m]
        change = space @ new
        return _Block(x @ old + change, block.images @ old + images @ new, values[:m], change)

    def _converge(self, block: _Block, count: int) -> _Block:
        """Return the block when the residuals of its first ``count`` vectors are below the
        tolerance.
        """
        first = None
        reached = 0.0
        with self._progress.step("lowest modes", 1.0) as step:
            for _ in range(_MOST):
                residuals = block.find_residuals()
                sizes = np.linalg.norm(residuals, axis=0)
                worst = float(np.max(sizes[:count]))
                if worst <= self._tolerance:
                    step.advance(1.0 - reached)
                    return block
                first = first or worst
                gained = math.log(first / worst) / math.log(first / self._tolerance) - reached
                if gained > 0.0:
                    step.advance(gained)
                    reached += gained
                # vectors that have converged need no more
                is_open = sizes > 0.1 * self._tolerance
                block = self._turn(block, residuals[:, is_open], None)
        raise self._explain(count)

    def _find_missing(self, block: _Block, count: int) -> _Block | None:
        """Return fresh vectors, kept free of those of the ``block``, the lowest of which is below
        the last of its ``count`` eigenvalues; None if none is.
        """
        highest = float(block.values[count - 1])
        fresh = self._begin(_FRESH, block.vectors)
        for _ in range(_MOST):
            distance = float(fresh.values[0]) - highest
            if distance < 0.0:
                return fresh
            residuals = fresh.find_residuals()
            if np.linalg.norm(residuals[:, 0]) <= _SETTLED * distance + self._tolerance:
                return None
            fresh = self._turn(fresh, residuals, block.vectors)
        raise self._explain(count)

    def _explain(self, count: int) -> ConvergenceError:
        """Return the error of a search without an end."""
        return ConvergenceError(
            f"the {count} lowest modes are not found in {_MOST} turns",
            "Many modes beside them may have nearly their frequency",
            "Ask for fewer modes, or for the density of states",
        )


def _symmetrise(matrix: NDArray[Any]) -> NDArray[Any]:
    """Return the Hermitian part of a matrix."""
    return np.asarray(0.5 * (matrix + matrix.conj().T))


def _orthonormalise(vectors: NDArray[Any]) -> NDArray[Any]:
    """Return an orthonormal basis (size, r) of the space of vectors (size, m), by their products,
    which take a fraction of the time of reflections; done twice it is as good.
    """
    for _ in range(2):
        squares, turn = np.linalg.eigh(vectors.conj().T @ vectors)
        is_kept = squares > _DEPENDENT * squares[-1]
        vectors = vectors @ (turn[:, is_kept] / np.sqrt(squares[is_kept]))
    return vectors
