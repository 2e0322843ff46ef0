"""The lowest eigenvalues of a large sparse Hermitian matrix, by a block of vectors (LOBPCG).

In each iteration the space of the block X is extended by its preconditioned residuals W and by the
last change P of the block. The lowest Ritz vectors of this space are the next block (A. V. Knyazev,
SIAM J. Sci. Comput. 23, 517, 2001). The basis of the space is orthonormal in each iteration, so
that no digit is lost when vectors have converged. The block has more vectors than are requested,
because its last vectors converge late.

The block may have missed an eigenvector. A random vector contains each eigenvector. So in the end
fresh random vectors, perpendicular to those that were found, are iterated until the lowest Ritz
value settles: above the last eigenvalue, or below, if an eigenvector was missing.
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

#: least number of vectors of the block beyond those that are requested
SPARE = 8
#: number of vectors of the block beyond those that are requested, over the requested ones
_SPARE_SHARE = 0.4
#: largest number of iterations; packings of 1e5 balls take some fifty
_MOST_ITERATIONS = 500
#: number of fresh random vectors by which missing eigenvectors are sought
_FRESH_VECTORS = 4
#: residual of the lowest fresh vector, over the distance of its Ritz value from the last
#: eigenvalue, at which the value has settled
_LARGEST_RATIO = 0.1
#: largest number of times that missing eigenvectors are sought
_ROUNDS = 4
#: residual of a vector of the block, over the tolerance, up to which the iteration leaves the
#: residual out
_LEAST_RESIDUAL = 0.1
#: eigenvalue of the products of vectors, over the largest, up to which they depend on each other
_DEPENDENCE = 1e-14


class LowestModes(NamedTuple):
    """The lowest modes of a matrix (size, size).

    Attributes
    ----------
    values : (m,) eigenvalues, ascending.
    vectors : (size, m) orthonormal eigenvectors, as columns.
    residuals : (m,) norms of the residuals of the vectors.
    """

    values: Array
    vectors: NDArray[Any]
    residuals: Array


@dataclass
class _Block:
    """Ritz vectors of a matrix A (size, size).

    Attributes
    ----------
    vectors : (size, m) orthonormal Ritz vectors X, as columns.
    images : (size, m) A X.
    values : (m,) Ritz values, ascending.
    change : (size, k) last change of the vectors, P.
    """

    vectors: NDArray[Any]
    images: NDArray[Any]
    values: Array
    change: NDArray[Any]

    def find_residuals(self) -> NDArray[Any]:
        """Return the residuals A X - X values, (size, m)."""
        return np.asarray(self.images - self.vectors * self.values)


def size_block(count: int) -> int:
    """Return the number of vectors of the block that finds ``count`` eigenvectors."""
    return count + max(SPARE, math.ceil(_SPARE_SHARE * count))


class LowestSearch:
    """The search for the lowest eigenvalues of a sparse Hermitian ``matrix`` (size, size).

    ``precondition`` multiplies vectors (size, m) by an approximate inverse of the matrix.
    ``known_vectors`` (size, k), sparse or not, are orthonormal eigenvectors that the search leaves
    out; None if there are none. An eigenvector is found when the norm of its residual is no larger
    than the ``tolerance``, which is above zero, in the unit of the matrix. ``progress`` is told how
    far the residuals have fallen towards the tolerance.
    """

    def __init__(
        self,
        matrix: Any,
        precondition: Callable[[NDArray[Any]], NDArray[Any]],
        tolerance: float,
        known_vectors: Any = None,
        progress: Progress = silent,
    ) -> None:
        """Keep the arguments, and seed the random vectors, so that results can be repeated."""
        self._matrix = matrix
        self._precondition = precondition
        self._tolerance = tolerance
        self._known_vectors = known_vectors
        self._progress = progress
        self._random = np.random.default_rng(0)

    def find(self, count: int) -> LowestModes:
        """Return the ``count`` lowest eigenvalues beside those of the known vectors, and their
        vectors; the matrix has at least as many.

        Raises :class:`~granphon.base.errors.ConvergenceError` if they are not found in
        :data:`_MOST_ITERATIONS` iterations, or if eigenvectors are still missing after
        :data:`_ROUNDS` searches.
        """
        n_known = 0 if self._known_vectors is None else self._known_vectors.shape[1]
        if size_block(count) + _FRESH_VECTORS > self._matrix.shape[0] - n_known:
            return self._find_densely(count, n_known)
        block = self._draw_block(size_block(count), None)
        for _ in range(_ROUNDS):
            block = self._converge(block, count)
            lower_block = self._find_missing(block, count)
            if lower_block is None:
                residuals = np.linalg.norm(block.find_residuals()[:, :count], axis=0)
                return LowestModes(block.values[:count], block.vectors[:, :count], residuals)
            basis = np.hstack([block.vectors, lower_block.vectors])
            block = self._make_block(basis, size_block(count))
        raise self._make_error(count)

    def _find_densely(self, count: int, n_known: int) -> LowestModes:
        """Return what :meth:`find` returns, of a matrix so small that the block and the fresh
        vectors would fill the space beside the ``n_known`` known eigenvectors.
        """
        basis = np.eye(self._matrix.shape[0])
        if n_known:
            known_vectors = self._known_vectors @ np.eye(n_known)  # as an array, sparse or not
            # the other columns of Q are perpendicular to the known eigenvectors
            basis = np.linalg.qr(known_vectors, mode="complete")[0][:, n_known:]
        block = self._make_block(basis, count)
        residuals = np.linalg.norm(block.find_residuals(), axis=0)
        return LowestModes(block.values, block.vectors, residuals)

    def _draw(self, count: int) -> NDArray[Any]:
        """Return ``count`` random vectors (size, count), complex if the matrix is."""
        vectors = self._random.normal(size=(self._matrix.shape[0], count))
        if np.iscomplexobj(self._matrix.data):
            return vectors + 1.0j * self._random.normal(size=vectors.shape)
        return vectors

    def _draw_block(self, n_vectors: int, excluded_basis: NDArray[Any] | None) -> _Block:
        """Return a block of ``n_vectors`` vectors, or of fewer if they depend on each other:
        preconditioned random vectors, made perpendicular to the known eigenvectors and to the
        orthonormal ``excluded_basis`` (size, k), if there is one.
        """
        random_vectors = self._precondition(self._draw(n_vectors))
        vectors = self._make_perpendicular(random_vectors, excluded_basis)
        return self._make_block(_orthonormalise(vectors), n_vectors)

    def _make_block(self, basis: NDArray[Any], n_vectors: int) -> _Block:
        """Return the block of the ``n_vectors`` lowest Ritz vectors of the space of an orthonormal
        ``basis`` (size, m), or of all m if there are fewer; the block has no last change.
        """
        images = self._matrix @ basis
        values, turn = np.linalg.eigh(_symmetrise(basis.conj().T @ images))
        turn = turn[:, :n_vectors]
        no_change = basis[:, :0]
        return _Block(basis @ turn, images @ turn, values[:n_vectors], no_change)

    def _make_perpendicular(
        self, vectors: NDArray[Any], excluded_basis: NDArray[Any] | None
    ) -> NDArray[Any]:
        """Return the parts of ``vectors`` (size, m) that are perpendicular to the known
        eigenvectors and to the orthonormal ``excluded_basis`` (size, k), if there is one.
        """
        for basis in (self._known_vectors, excluded_basis):
            if basis is not None and basis.shape[1]:
                vectors = vectors - basis @ (basis.conj().T @ vectors)
        return np.asarray(vectors)

    def _iterate(
        self, block: _Block, residuals: NDArray[Any], excluded_basis: NDArray[Any] | None
    ) -> _Block:
        """Return the next block, of as many vectors: the lowest Ritz vectors of the space of the
        vectors X of the ``block``, of its last change P, and of the preconditioned ``residuals``
        (size, k) of some of its vectors. These are made perpendicular to the known eigenvectors and
        to the orthonormal ``excluded_basis`` (size, l), if there is one.
        """
        x = block.vectors
        m = x.shape[1]
        preconditioned = self._precondition(residuals)
        space = np.hstack([self._make_perpendicular(preconditioned, excluded_basis), block.change])
        # the lengths of residuals differ by orders of magnitude; each vector counts as much
        space /= np.maximum(np.linalg.norm(space, axis=0), np.finfo(float).tiny)
        for _ in range(2):  # the second time removes the rounding of the first
            space -= x @ (x.conj().T @ space)
            space = _orthonormalise(space)
        images = self._matrix @ space
        mixed = x.conj().T @ images
        projection = np.block(
            [[np.diag(block.values), mixed], [mixed.conj().T, space.conj().T @ images]]
        )
        values, turn = np.linalg.eigh(_symmetrise(projection))
        from_block = turn[:m, :m]
        from_space = turn[m:, :m]
        change = space @ from_space
        next_images = block.images @ from_block + images @ from_space
        return _Block(x @ from_block + change, next_images, values[:m], change)

    def _converge(self, block: _Block, count: int) -> _Block:
        """Return the ``block`` after as many iterations as the residuals of its first ``count``
        vectors take to fall to the tolerance; tell the progress. Raises
        :class:`~granphon.base.errors.ConvergenceError` after :data:`_MOST_ITERATIONS`.
        """
        worst_at_start: float | None = None
        part_done = 0.0  # of the digits by which the worst residual has to fall
        with self._progress.step("lowest modes", 1.0) as step:
            for _ in range(_MOST_ITERATIONS):
                residuals = block.find_residuals()
                sizes = np.linalg.norm(residuals, axis=0)
                worst_residual = float(np.max(sizes[:count]))
                if worst_residual <= self._tolerance:
                    step.advance(1.0 - part_done)
                    return block
                if worst_at_start is None:
                    worst_at_start = worst_residual
                all_digits = math.log(worst_at_start / self._tolerance)
                further_part = math.log(worst_at_start / worst_residual) / all_digits - part_done
                if further_part > 0.0:
                    step.advance(further_part)
                    part_done += further_part
                # residuals of vectors that have converged by far are left out
                is_open = sizes > _LEAST_RESIDUAL * self._tolerance
                block = self._iterate(block, residuals[:, is_open], None)
        raise self._make_error(count)

    def _find_missing(self, block: _Block, count: int) -> _Block | None:
        """Return None if none of the ``count`` lowest eigenvectors is missing in the ``block``.
        Otherwise return a block of fresh vectors, perpendicular to those of the ``block``, whose
        lowest Ritz value is below value number ``count`` of the ``block``.

        Raises :class:`~granphon.base.errors.ConvergenceError` if this does not settle within
        :data:`_MOST_ITERATIONS`.
        """
        highest = float(block.values[count - 1])
        fresh_block = self._draw_block(_FRESH_VECTORS, block.vectors)
        for _ in range(_MOST_ITERATIONS):
            distance = float(fresh_block.values[0]) - highest
            if distance < 0.0:
                return fresh_block
            residuals = fresh_block.find_residuals()
            if np.linalg.norm(residuals[:, 0]) <= _LARGEST_RATIO * distance + self._tolerance:
                return None
            fresh_block = self._iterate(fresh_block, residuals, block.vectors)
        raise self._make_error(count)

    def _make_error(self, count: int) -> ConvergenceError:
        """Return the error of a search that has not found ``count`` modes."""
        return ConvergenceError(
            f"the search for the {count} lowest modes does not settle",
            "Many modes beside them may have nearly their frequency",
            "Take fewer modes, or the density of states",
        )


def _symmetrise(matrix: NDArray[Any]) -> NDArray[Any]:
    """Return the Hermitian part of a ``matrix`` (n, n)."""
    return np.asarray(0.5 * (matrix + matrix.conj().T))


def _orthonormalise(vectors: NDArray[Any]) -> NDArray[Any]:
    """Return an orthonormal basis (size, r) of the space of ``vectors`` (size, m), from the
    eigenvectors of their products; r is below m if vectors depend on each other, and zero if none
    is above zero. QR by reflections would take several times as long.
    """
    # the second time removes the rounding of the first
    for _ in range(2):
        squares, turn = np.linalg.eigh(vectors.conj().T @ vectors)
        is_kept = squares > _DEPENDENCE * np.max(squares, initial=0.0)
        vectors = vectors @ (turn[:, is_kept] / np.sqrt(squares[is_kept]))
    return vectors
