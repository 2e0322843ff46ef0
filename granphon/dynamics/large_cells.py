"""Vibrations of cells of hundreds of balls and more: C(q) and D(q) as sparse matrices, of which D
alone is made dense.

The motions are those of each ball. A contact joins two balls, so that D costs next to nothing, and
LAPACK's eigenvalues take nearly all of the time. If an inversion leaves the cell the same, even
motions and odd ones times i make D real.

An eigenvalue of D has the error of rounding of the largest. The few that are far below the largest
are found again, by Lanczos with sparse factors, as squares of singular values of C. Wave vectors
where singular values have no digits either, as those of sound very near Gamma, and modes that
touch, are left to the blocks of :mod:`granphon.dynamics.blocks`, whose matrices are dense and keep
all digits.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from granphon.base.arrays import Array
from granphon.dynamics.blocks import GENERIC
from granphon.dynamics.compatibility import Compatibility
from granphon.dynamics.factors import factorise
from granphon.dynamics.linalg import WELL_ABOVE, find_nearest
from granphon.dynamics.rows import Row
from granphon.dynamics.sparse_relaxation import compose_ends

#: singular value of C, over the largest, from which it has eleven digits in the motions of balls
_LEAST = 1e-5
#: the same where modes are requested, whose error is of first order
_LEAST_OF_MODES = 1e-3
#: singular value of C, over the largest, up to which it is rounding of zero
_ZERO = 1e-13
#: distance of a wave vector from Gamma, 1/d, from which sound is well above rounding of zero
_FAR = 1e-2
#: eigenvalue under prestress, over the largest, from which it has digits: the eigenvalue itself is
#: rounded
_LEAST_SQUARE = 1e-7
#: eigenvalue under prestress, over the largest, up to which it is rounding of zero
_ZERO_SQUARE = 1e-12
#: distance of the shift of Lanczos from zero, over the largest eigenvalue
_SHIFT = 1e-8
#: error of eigenvalues, over the largest, from which Lanczos has missed an eigenvalue
_MISSED = 1e-11
#: memory of one wave vector over the square of the number of branches, bytes: D, LAPACK's copy and
#: its work
BYTES = 38.0
#: most eigenvalues that are found again
_MOST = 100
#: relative distance of frequencies up to which they are degenerate
_DEGENERATE = 1e-9


class _Ends(NamedTuple):
    """Sparse effects (kinds x n_c, n) of the motions of the two balls of each contact, and the
    signs of their squares.
    """

    head: Any
    tail: Any
    half: Array
    signs: Array


class _LowModes(NamedTuple):
    """The lowest frequencies of a part of a cell, ascending, and which of them are zero."""

    frequencies: Array
    are_zero: NDArray[np.bool_]


class LargeCell:
    """The vibrations of a lattice with many balls in its cell, in reduced units.

    ``rows`` are those of C with the roots (kinds, n_c) of their stiffness, and then those on which
    static forces act; ``images`` an inversion that leaves the cell the same: the image of each ball
    first.
    """

    def __init__(
        self,
        lattice: Compatibility,
        rows: list[tuple[list[Row], Array]],
        images: tuple[Any, ...] | None,
    ) -> None:
        from scipy.sparse import eye_array, hstack, kron

        table = lattice.contacts
        n = lattice.n_balls
        self.size = lattice.n_branches
        self.pressed = lattice.is_prestressed
        self.is_real = images is not None
        #: (n, n) to the motions of balls from those in which D is real
        self.frame: Any = eye_array(self.size, dtype=complex, format="csr")
        if images is not None:
            image = images[0]
            root = np.sqrt(0.5)
            unit = eye_array(n, format="csc")
            pair = np.flatnonzero(image > np.arange(n))
            fixed = np.flatnonzero(image == np.arange(n))
            ball = unit[:, pair]
            partner = unit[:, image[pair]]
            even = root * (ball + partner)
            odd = 1j * root * (ball - partner)
            of_balls = hstack([unit[:, fixed], even, odd])
            self.frame = kron(of_balls, np.diag(lattice.motions.phases)).tocsr()
        #: fewest frequencies of zero at any wave vector so far
        self._zeros = self.size
        self.kinds: list[_Ends] = []
        for prestress, (deformations, roots) in enumerate(rows):
            head, tail = compose_ends(lattice, deformations, roots)
            count = len(deformations)
            signs = -lattice.static_signs if prestress else np.ones((count, len(table)))
            half = np.tile(0.5 * table.vector[:, : lattice.periods], (count, 1))
            ends = _Ends(head @ self.frame, tail @ self.frame, half, signs.ravel())
            self.kinds.append(ends)

    def find_frequencies(self, q: Array) -> Array | None:
        """Find frequencies (n,), ascending, at one wave vector (p,); None if digits would be
        lost.
        """
        modes = self._solve(q, with_vectors=False)
        return None if modes is None else np.sort(modes[0])

    def solve_with_velocities(self, q: Array) -> tuple[Array, NDArray[Any], Array] | None:
        """Find frequencies (n,), motions of balls (n, n), as columns, and group velocities (n, p)
        at one wave vector (p,).

        Return None if digits would be lost, or branches touch.
        """
        modes = self._solve(q, with_vectors=True)
        if modes is None:
            return None
        order = np.argsort(modes[0], kind="stable")
        values = modes[0][order]
        vectors = modes[1][:, order]
        touch = np.any(np.diff(values) <= _DEGENERATE * values[1:])
        if touch or values[0] < _LEAST_OF_MODES * values[-1]:
            return None
        gradients = np.zeros((self.size, len(q)))
        for ends in self.kinds:
            ahead = ends.head @ vectors
            behind = ends.tail @ vectors
            phase = np.exp(1j * (ends.half @ q))[:, None]
            ahead = phase * ahead
            behind = phase.conj() * behind
            # 2 Re <C v| S dC/dq |v>, dC/dq = i half (head + tail)
            products = ((ahead - behind).conj() * (ahead + behind)).imag * ends.signs[:, None]
            gradients -= 2.0 * products.T @ ends.half
        return values, self.frame @ vectors, gradients / (2.0 * values[:, None])

    @property
    def free_branches(self) -> int | None:
        """Number of branches that vanish at every wave vector; None if digits would be lost."""
        if self._zeros and self.find_frequencies(GENERIC[0, : self.kinds[0].half.shape[1]]) is None:
            return None
        return self._zeros

    def _compute(self, q: Array) -> tuple[Any, Any, float]:
        """Return C(q) without static forces, D(q), and a bound of its eigenvalues."""
        rows = []
        for kind in self.kinds:
            phase = np.exp(1j * (kind.half @ q))[:, None]
            rows.append((kind.head.multiply(phase) - kind.tail.multiply(phase.conj())).tocsr())
        matrix = sum(
            rows_of_kind.conj().T @ rows_of_kind.multiply(ends.signs[:, None])
            for rows_of_kind, ends in zip(rows, self.kinds, strict=True)
        )
        matrix = (matrix.real if self.is_real else matrix).tocsr()
        return rows[0], matrix, float(abs(matrix).sum(axis=1).max())

    def _solve(self, q: Array, with_vectors: bool) -> tuple[Array, NDArray[Any]] | None:
        """Find frequencies (n,), in any order, and on request eigenvectors (n, n); None if digits
        would be lost.
        """
        rows, matrix, top = self._compute(q)
        is_near_gamma = 0.0 < float(np.linalg.norm(q)) < _FAR
        frequencies = np.zeros(self.size)
        vectors = np.zeros((self.size, self.size) if with_vectors else (0, 0), matrix.dtype)
        for motions in _split(matrix):
            block = matrix[motions][:, motions]
            if with_vectors:
                squares, vectors[np.ix_(motions, motions)] = np.linalg.eigh(block.toarray())
            else:
                squares = np.linalg.eigvalsh(block.toarray())
            low = self._resolve_low_modes(block, rows[:, motions], squares, top)
            if low is None or (np.any(low.are_zero) and is_near_gamma):
                return None
            sizes = np.sqrt(np.maximum(squares, 0.0))
            sizes[: low.are_zero.size] = np.where(low.are_zero, 0.0, low.frequencies)
            frequencies[motions] = sizes
        self._zeros = min(self._zeros, int(np.count_nonzero(frequencies == 0.0)))
        return frequencies, vectors

    def _resolve_low_modes(
        self, block: Any, rows: Any, squares: Array, top: float
    ) -> _LowModes | None:
        """Find the frequencies that are too low to have digits as roots of ``squares`` (n,),
        ascending; None if digits would be lost.

        ``block`` (n, n) is the sparse D of some motions, ``rows`` those of C, and ``top`` a bound
        of all squares. There are three ways. Under static forces the squares themselves are
        rounded, and must be zero. A few frequencies are found again as singular values of C. If
        there are many, they must all be those of motions without contacts.
        """
        limit = _LEAST_SQUARE if self.pressed else WELL_ABOVE
        count = int(np.count_nonzero(squares <= limit * top))
        lowest = squares[:count]
        if self.pressed:
            are_zero = np.abs(lowest) <= _ZERO_SQUARE * top
            return _LowModes(np.zeros(count), are_zero) if np.all(are_zero) else None
        if count > min(_MOST, len(squares) // 3):
            are_zero = lowest <= 0.0
            is_loose = np.all(are_zero) and block.count_nonzero() == 0
            return _LowModes(np.zeros(count), are_zero) if is_loose else None
        sizes = _sharpen(block, rows, count, top) if count else np.zeros(0)
        are_zero = sizes <= _ZERO * np.sqrt(top)
        have_digits = np.all(are_zero | (sizes >= _LEAST * np.sqrt(top)))
        are_all = np.all(np.abs(sizes**2 - lowest) <= _MISSED * top)
        return _LowModes(sizes, are_zero) if have_digits and are_all else None


def _split(matrix: Any) -> list[NDArray[np.intp]]:
    """Return the sets of motions that no contact joins to others, such as those of a loose ball."""
    from scipy.sparse.csgraph import connected_components

    labels = connected_components(abs(matrix), directed=False)[1]
    order = np.argsort(labels, kind="stable")
    return np.split(order, np.flatnonzero(np.diff(labels[order])) + 1)


def _sharpen(matrix: Any, rows: Any, count: int, top: float) -> Array:
    """Find the lowest singular values (count,) of sparse rows A, ascending; ``matrix`` is A^H A,
    ``top`` bounds it.
    """
    from scipy.sparse import eye_array

    shift = _SHIFT * top
    shifted = matrix + shift * eye_array(matrix.shape[0])
    factors = factorise(shifted, symmetric=np.isrealobj(matrix.data))
    _, vectors = find_nearest(matrix, count, -shift, factors.solve)
    return np.asarray(np.linalg.svd(rows @ np.linalg.qr(vectors)[0], compute_uv=False)[::-1])
