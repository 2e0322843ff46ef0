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
from granphon.dynamics.blocks import DEGENERATE, GENERIC
from granphon.dynamics.compatibility import Compatibility
from granphon.dynamics.deformation_rows import Row
from granphon.dynamics.factors import factorise
from granphon.dynamics.linalg import WELL_ABOVE, find_nearest
from granphon.dynamics.sparse_relaxation import NO_SQUARE, compose_ends

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
#: distance of the shift of Lanczos from zero, over the largest eigenvalue
_SHIFT = 1e-8
#: error of eigenvalues, over the largest, from which Lanczos has missed an eigenvalue
_MISSED = 1e-11
#: memory of one wave vector over the square of the number of branches, bytes: D, LAPACK's copy and
#: its work
BYTES = 38.0
#: most eigenvalues that are found again
_MOST = 100


class _Ends(NamedTuple):
    """Sparse effects (kinds x n_c, n) of the motions of the two balls of each contact, ``head`` of
    ball j and ``tail`` of ball i, with the ``half`` vectors (kinds x n_c, p) of the contacts and
    the ``signs`` (kinds x n_c,) with which squares of the effects enter D.
    """

    head: Any
    tail: Any
    half: Array
    signs: Array


class _LowModes(NamedTuple):
    """The lowest frequencies (m,) of a part of a cell, ascending, and which of them are zero."""

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
        table = lattice.contacts
        self.size = lattice.n_branches
        self.pressed = lattice.is_prestressed
        self.is_real = images is not None
        #: (n, n) to the motions of balls from those in which D is real
        self.frame: Any = _make_frame(lattice, None if images is None else images[0])
        #: fewest frequencies of zero at any wave vector so far
        self._zeros = self.size
        self.kinds: list[_Ends] = []
        for number, (deformations, roots) in enumerate(rows):
            head, tail = compose_ends(lattice, deformations, roots)
            count = len(deformations)
            signs = np.ones((count, len(table)))
            if number == 1:  # rows on which static forces act
                signs = -lattice.static_signs
            half = np.tile(0.5 * table.vector[:, : lattice.periods], (count, 1))
            ends = _Ends(head @ self.frame, tail @ self.frame, half, signs.ravel())
            self.kinds.append(ends)

    def find_frequencies(self, q: Array) -> Array | None:
        """Return frequencies (n,), (k/M)^1/2, ascending, at one wave vector (p,), 1/d; None if
        digits would be lost.
        """
        modes = self._solve(q, with_vectors=False)
        return None if modes is None else np.sort(modes[0])

    def solve_modes(self, q: Array) -> tuple[Array, NDArray[Any]] | None:
        """Return frequencies (n,), (k/M)^1/2, ascending, and motions of balls (n, n), as columns,
        at one wave vector (p,), 1/d; None if digits would be lost, or branches touch.
        """
        modes = self._solve_apart(q)
        return None if modes is None else (modes[0], self.frame @ modes[1])

    def solve_with_velocities(self, q: Array) -> tuple[Array, NDArray[Any], Array] | None:
        """Return frequencies and eigenvectors as :meth:`solve_modes` does, and group velocities (n,
        p), d (k/M)^1/2; None where it returns None.
        """
        modes = self._solve_apart(q)
        if modes is None:
            return None
        frequencies, vectors = modes
        gradients = np.zeros((self.size, len(q)))
        for ends in self.kinds:
            phase = np.exp(1j * (ends.half @ q))[:, None]
            head = phase * (ends.head @ vectors)
            tail = phase.conj() * (ends.tail @ vectors)
            # 2 Re <C v| S dC/dq |v>, dC/dq = i half (head + tail)
            products = ((head - tail).conj() * (head + tail)).imag * ends.signs[:, None]
            gradients -= 2.0 * products.T @ ends.half
        velocities = gradients / (2.0 * frequencies[:, None])
        return frequencies, self.frame @ vectors, velocities

    def _solve_apart(self, q: Array) -> tuple[Array, NDArray[Any]] | None:
        """Return frequencies (n,), ascending, and motions in the frame (n, n), as columns; None if
        digits would be lost, or branches touch.
        """
        modes = self._solve(q, with_vectors=True)
        if modes is None:
            return None
        order = np.argsort(modes[0], kind="stable")
        frequencies = modes[0][order]
        vectors = modes[1][:, order]
        touch = np.any(np.diff(frequencies) <= DEGENERATE * frequencies[1:])
        if touch or frequencies[0] < _LEAST_OF_MODES * frequencies[-1]:
            return None
        return frequencies, vectors

    @property
    def free_branches(self) -> int | None:
        """Number of branches that vanish at every wave vector; None if digits would be lost."""
        if self._zeros and self.find_frequencies(GENERIC[0, : self.kinds[0].half.shape[1]]) is None:
            return None
        return self._zeros

    def _compute(self, q: Array) -> tuple[Any, Any, float]:
        """Return sparse C(q) (kinds x n_c, n) without static forces, sparse D(q) (n, n), and a
        bound of the eigenvalues of D.
        """
        rows = []
        for ends in self.kinds:
            phase = np.exp(1j * (ends.half @ q))[:, None]
            rows.append((ends.head.multiply(phase) - ends.tail.multiply(phase.conj())).tocsr())
        total: Any = sum(
            rows_of_kind.conj().T @ rows_of_kind.multiply(ends.signs[:, None])
            for rows_of_kind, ends in zip(rows, self.kinds, strict=True)
        )
        matrix = (total.real if self.is_real else total).tocsr()
        bound = float(abs(matrix).sum(axis=1).max())
        return rows[0], matrix, bound

    def _solve(self, q: Array, with_vectors: bool) -> tuple[Array, NDArray[Any]] | None:
        """Return frequencies (n,), in any order, and eigenvectors (n, n), none unless
        ``with_vectors``; None instead of both if digits would be lost, as near Gamma, where sound
        is not told from motions that cost nothing.
        """
        from scipy.linalg import eigh

        rows, matrix, bound = self._compute(q)
        is_near_gamma = 0.0 < float(np.linalg.norm(q)) < _FAR
        frequencies = np.zeros(self.size)
        vectors = np.zeros((self.size, self.size) if with_vectors else (0, 0), matrix.dtype)
        for motions in _split(matrix):
            block = matrix[motions][:, motions]
            if with_vectors:
                # relatively robust representations take a third of the time of LAPACK's default
                squares, of_block = eigh(
                    block.toarray(), driver="evr", overwrite_a=True, check_finite=False
                )
                vectors[np.ix_(motions, motions)] = of_block
            else:
                squares = np.linalg.eigvalsh(block.toarray())
            low = self._resolve_low_modes(block, rows[:, motions], squares, bound)
            if low is None:
                return None
            if is_near_gamma and np.any(low.are_zero):
                return None  # sound and motions that cost nothing cannot be told apart
            block_frequencies = np.sqrt(np.maximum(squares, 0.0))
            block_frequencies[: low.are_zero.size] = np.where(low.are_zero, 0.0, low.frequencies)
            frequencies[motions] = block_frequencies
        self._zeros = min(self._zeros, int(np.count_nonzero(frequencies == 0.0)))
        return frequencies, vectors

    def _resolve_low_modes(
        self, block: Any, rows: Any, squares: Array, bound: float
    ) -> _LowModes | None:
        """Return the frequencies that are too low to have digits as roots of ``squares`` (n,),
        ascending; None if digits would be lost.

        ``block`` (n, n) is the sparse D of some motions, ``rows`` those of C, and ``bound`` one of
        all squares. There are three ways. Under static forces the squares themselves are rounded,
        and must be zero. A few frequencies are found again as singular values of C. If there are
        many, they must all be those of motions without contacts.
        """
        limit = _LEAST_SQUARE if self.pressed else WELL_ABOVE
        count = int(np.count_nonzero(squares <= limit * bound))
        lowest = squares[:count]
        if self.pressed:
            are_zero = np.abs(lowest) <= NO_SQUARE * bound
            return _LowModes(np.zeros(count), are_zero) if np.all(are_zero) else None
        # Lanczos serves a few
        are_many = count > min(_MOST, len(squares) // 3)
        if are_many:
            are_zero = lowest <= 0.0
            is_loose = np.all(are_zero) and block.count_nonzero() == 0
            return _LowModes(np.zeros(count), are_zero) if is_loose else None
        frequencies = _sharpen(block, rows, count, bound) if count else np.zeros(0)
        are_zero = frequencies <= _ZERO * np.sqrt(bound)
        have_digits = np.all(are_zero | (frequencies >= _LEAST * np.sqrt(bound)))
        # where Lanczos has missed an eigenvalue, the next one has taken its place
        are_complete = np.all(np.abs(frequencies**2 - lowest) <= _MISSED * bound)
        return _LowModes(frequencies, are_zero) if have_digits and are_complete else None


def _make_frame(lattice: Compatibility, image: NDArray[np.intp] | None) -> Any:
    """Return a sparse unitary matrix (n_branches, n_branches) to the motions of balls, from even
    motions and odd ones times i under an inversion that takes each ball to its ``image`` (n,);
    without an inversion, from the motions of balls themselves.
    """
    from scipy.sparse import eye_array, hstack, kron

    if image is None:
        return eye_array(lattice.n_branches, dtype=complex, format="csr")
    n = lattice.n_balls
    root = np.sqrt(0.5)
    unit = eye_array(n, format="csc")
    fixed = np.flatnonzero(image == np.arange(n))  # balls that are their own images
    first = np.flatnonzero(image > np.arange(n))  # one ball of each pair
    ball = unit[:, first]
    partner = unit[:, image[first]]
    even = root * (ball + partner)
    odd = 1j * root * (ball - partner)
    frame_of_balls = hstack([unit[:, fixed], even, odd])
    return kron(frame_of_balls, np.diag(lattice.motions.phases)).tocsr()


def _split(matrix: Any) -> list[NDArray[np.intp]]:
    """Return the sets of motions that no contact joins to others, such as those of a loose ball."""
    from scipy.sparse.csgraph import connected_components

    labels = connected_components(abs(matrix), directed=False)[1]
    order = np.argsort(labels, kind="stable")
    return np.split(order, np.flatnonzero(np.diff(labels[order])) + 1)


def _sharpen(matrix: Any, rows: Any, count: int, bound: float) -> Array:
    """Return the lowest singular values (count,) of sparse rows A, ascending; ``matrix`` is A^H A,
    and ``bound`` one of its eigenvalues.
    """
    from scipy.sparse import eye_array

    shift = _SHIFT * bound
    shifted = matrix + shift * eye_array(matrix.shape[0])
    factors = factorise(shifted, symmetric=np.isrealobj(matrix.data))
    _, vectors = find_nearest(matrix, count, -shift, factors.solve)
    # the space of the eigenvectors is well known; within it singular values of A have all digits
    basis = np.linalg.qr(vectors)[0]
    return np.asarray(np.linalg.svd(rows @ basis, compute_uv=False)[::-1])
