"""Vibrations of cells of hundreds of balls and more: C(q) and D(q) are sparse matrices, of which
only D is made dense.

Columns are the motions of each ball. A contact joins two balls, so that D costs next to nothing,
and LAPACK's eigenvalues take nearly all of the time. If an inversion maps the cell onto itself, D
is real in terms of even motions and of odd motions times i.

The error of every eigenvalue of D is the rounding of the largest. The few that are far below the
largest are therefore found again, as squares of singular values of C, by Lanczos's method with
sparse factors. At some wave vectors singular values have no digits either, such as those of sound
very near Gamma. There, and where modes have one frequency, the methods return None, and the caller
turns to :mod:`granphon.dynamics.blocks`, whose matrices are dense and keep all digits.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from granphon.base.arrays import Array
from granphon.dynamics.blocks import DEGENERACY, GENERIC_WAVEVECTORS
from granphon.dynamics.compatibility import Compatibility
from granphon.dynamics.deformation_rows import Row
from granphon.dynamics.factors import factorise
from granphon.dynamics.linalg import LEAST_EXACT_SQUARE, find_nearest
from granphon.dynamics.sparse_relaxation import NO_SQUARE, compose_ends

#: singular value of C, over the largest, from which it has eleven digits
_LEAST_SINGULAR_VALUE = 1e-5
#: frequency, over the largest, from which modes have their digits: the error of a mode is of first
#: order, and that of its frequency of second
_LEAST_OF_MODES = 1e-3
#: singular value of C, over the largest, up to which it is rounding of zero
_ZERO_ROUNDING = 1e-13
#: distance of a wave vector from Gamma, 1/d, from which sound is well above rounding of zero
_SOUND_DISTANCE = 1e-2
#: eigenvalue of D under static forces, over the largest, below which it is found again from the
#: rows: above, its relative error by rounding is 1e-9 at most
_LEAST_SQUARE = 1e-7
#: distance of the shift of Lanczos from zero, over the largest eigenvalue
_SHIFT = 1e-8
#: difference of eigenvalues of D and of squares from C, over the largest, above which Lanczos has
#: missed an eigenvalue
_LARGEST_CHANGE = 1e-11
#: memory of one wave vector, bytes, over the square of the number of branches: D, LAPACK's copy of
#: it and LAPACK's work space
BYTES = 38.0
#: largest number of eigenvalues that are found again
_MOST_SHARPENED = 100


class _Ends(NamedTuple):
    """Rows of C as sparse matrices of the motions of both ends of each contact.

    Attributes
    ----------
    head : (kinds * n_c, n) effects of the motions of ball j.
    tail : (kinds * n_c, n) effects of the motions of ball i, which are subtracted.
    half : (kinds * n_c, p) half vectors of the contacts.
    signs : (kinds * n_c,) signs with which the squares of the rows enter D.
    """

    head: Any
    tail: Any
    half: Array
    signs: Array


class _LowModes(NamedTuple):
    """The lowest frequencies (m,), (k/M)^1/2, of a part of a cell, ascending, and (m,) which of
    them are zero.
    """

    frequencies: Array
    are_zero: NDArray[np.bool_]


class LargeCell:
    """The vibrations of a lattice with many balls in its cell, in reduced units.

    ``weighted_rows`` are one or two pairs of rows and the square roots (kinds, n_c) of their
    stiffnesses: those of C, and under static forces the rows on which the forces act. ``images`` is
    an inversion that maps the cell onto itself, whose first item is the image (n,) of each ball;
    None if there is no inversion.

    Its methods raise :class:`~granphon.base.errors.ConvergenceError` if Lanczos's method does not
    find the low modes.
    """

    def __init__(
        self,
        lattice: Compatibility,
        weighted_rows: list[tuple[list[Row], Array]],
        images: tuple[Any, ...] | None,
    ) -> None:
        """Make the rows sparse, in terms of the motions in which D is real."""
        table = lattice.contacts
        self.size = lattice.n_branches
        self.is_prestressed = lattice.is_prestressed
        self.is_real = images is not None
        #: (n, n) sparse unitary matrix from the motions in which D is real to those of balls
        self.frame: Any = _make_frame(lattice, None if images is None else images[0])
        #: smallest number of zero frequencies at the wave vectors so far
        self._fewest_zeros = self.size
        #: the rows of C, and under static forces those on which these act
        self.row_sets: list[_Ends] = []
        for number, (rows, roots) in enumerate(weighted_rows):
            head, tail = compose_ends(lattice, rows, roots)
            are_static = number == 1  # rows on which static forces act
            signs = -lattice.static_signs if are_static else np.ones(roots.shape)
            half = np.tile(0.5 * table.vector[:, : lattice.periods], (len(rows), 1))
            ends = _Ends(head @ self.frame, tail @ self.frame, half, signs.ravel())
            self.row_sets.append(ends)

    def find_frequencies(self, q: Array) -> Array | None:
        """Return frequencies (n,), (k/M)^1/2, ascending, at one wave vector q (p,), 1/d; None if
        digits would be lost.
        """
        modes = self._solve(q, wants_vectors=False)
        if modes is None:
            return None
        frequencies, _ = modes
        return np.sort(frequencies)

    def solve_modes(self, q: Array) -> tuple[Array, NDArray[Any]] | None:
        """Return frequencies (n,), (k/M)^1/2, ascending, and motions of balls (n, n), as columns,
        at one wave vector q (p,), 1/d; None if digits would be lost, or if branches have one
        frequency.
        """
        modes = self._solve_nondegenerate(q)
        if modes is None:
            return None
        frequencies, vectors = modes
        return frequencies, self.frame @ vectors

    def solve_with_velocities(self, q: Array) -> tuple[Array, NDArray[Any], Array] | None:
        """Return frequencies (n,) and motions (n, n) as :meth:`solve_modes` does, and group
        velocities (n, p), d (k/M)^1/2; None if :meth:`solve_modes` returns None.
        """
        modes = self._solve_nondegenerate(q)
        if modes is None:
            return None
        frequencies, vectors = modes
        gradients = np.zeros((self.size, len(q)))
        for ends in self.row_sets:
            phase = np.exp(1j * (ends.half @ q))[:, None]
            head = phase * (ends.head @ vectors)
            tail = phase.conj() * (ends.tail @ vectors)
            # d omega^2/dq = 2 Re <C v| S dC/dq |v>, with dC/dq = i half (head + tail) and signs S
            products = ((head - tail).conj() * (head + tail)).imag * ends.signs[:, None]
            gradients -= 2.0 * products.T @ ends.half
        velocities = gradients / (2.0 * frequencies[:, None])
        return frequencies, self.frame @ vectors, velocities

    def _solve_nondegenerate(self, q: Array) -> tuple[Array, NDArray[Any]] | None:
        """Return frequencies (n,), ascending, and motions in the frame (n, n), as columns, at one
        wave vector q (p,); None if digits would be lost, or if branches have one frequency.
        """
        modes = self._solve(q, wants_vectors=True)
        if modes is None:
            return None
        unordered_frequencies, unordered_vectors = modes
        order = np.argsort(unordered_frequencies, kind="stable")
        frequencies = unordered_frequencies[order]
        vectors = unordered_vectors[:, order]
        is_degenerate = np.any(np.diff(frequencies) <= DEGENERACY * frequencies[1:])
        if is_degenerate or frequencies[0] < _LEAST_OF_MODES * frequencies[-1]:
            return None
        return frequencies, vectors

    @property
    def free_branches(self) -> int | None:
        """Number of branches that vanish at every wave vector; None if digits would be lost.

        Unless some wave vector so far had no zero frequency, one without symmetry is solved first.
        """
        if self._fewest_zeros:
            periods = self.row_sets[0].half.shape[1]
            if self.find_frequencies(GENERIC_WAVEVECTORS[0, :periods]) is None:
                return None
        return self._fewest_zeros

    def _compute_matrices(self, q: Array) -> tuple[list[Any], Any, float]:
        """Return three results at one wave vector q (p,): the sparse rows (kinds * n_c, n) of each
        of the :attr:`row_sets`, the first of which are C(q); the sparse matrix D(q) (n, n), with
        static forces; and an upper bound of the eigenvalues of D.
        """
        rows = []
        for ends in self.row_sets:
            phase = np.exp(1j * (ends.half @ q))[:, None]
            rows.append((ends.head.multiply(phase) - ends.tail.multiply(phase.conj())).tocsr())
        total: Any = sum(
            rows_of_set.conj().T @ rows_of_set.multiply(ends.signs[:, None])
            for rows_of_set, ends in zip(rows, self.row_sets, strict=True)
        )
        matrix = (total.real if self.is_real else total).tocsr()
        bound = float(abs(matrix).sum(axis=1).max())
        return rows, matrix, bound

    def _solve(self, q: Array, wants_vectors: bool) -> tuple[Array, NDArray[Any]] | None:
        """Return frequencies (n,), in any order, and eigenvectors (n, n), as columns in the frame,
        or (0, 0) unless ``wants_vectors``. Return None instead of both if digits would be lost.

        Near Gamma digits are lost if some frequency is zero, as sound cannot be told there from
        motions that cost nothing. The smallest number of zero frequencies so far is kept for
        :attr:`free_branches`.
        """
        from scipy.linalg import eigh

        rows, matrix, bound = self._compute_matrices(q)
        is_near_gamma = 0.0 < float(np.linalg.norm(q)) < _SOUND_DISTANCE
        frequencies = np.zeros(self.size)
        vectors = np.zeros((self.size, self.size) if wants_vectors else (0, 0), matrix.dtype)
        for motions in _split_motions(matrix):
            block = matrix[motions][:, motions]
            if wants_vectors:
                # LAPACK's driver "evr" takes a third of the time of the default
                squares, of_block = eigh(
                    block.toarray(), driver="evr", overwrite_a=True, check_finite=False
                )
                vectors[np.ix_(motions, motions)] = of_block
            else:
                squares = np.linalg.eigvalsh(block.toarray())
            rows_of_block = [rows_of_set[:, motions] for rows_of_set in rows]
            low_modes = self._resolve_low_modes(block, rows_of_block, squares, bound)
            if low_modes is None:
                return None
            if is_near_gamma and np.any(low_modes.are_zero):
                return None  # sound and motions that cost nothing cannot be told apart
            block_frequencies = np.sqrt(np.maximum(squares, 0.0))
            n_low = low_modes.are_zero.size
            block_frequencies[:n_low] = np.where(low_modes.are_zero, 0.0, low_modes.frequencies)
            frequencies[motions] = block_frequencies
        self._fewest_zeros = min(self._fewest_zeros, int(np.count_nonzero(frequencies == 0.0)))
        return frequencies, vectors

    def _resolve_low_modes(
        self, block: Any, rows: list[Any], squares: Array, bound: float
    ) -> _LowModes | None:
        """Return the low frequencies of a part of the cell, and which of them are zero; None if
        they cannot be found with all digits. Low frequencies are those whose squares, the lowest of
        the eigenvalues ``squares`` (n,), ascending, are so small beside the largest that rounding
        leaves no digits.

        ``block`` (n, n) is the sparse D of the part, ``rows`` are those of each of the
        :attr:`row_sets`, and ``bound`` is an upper bound of all squares. There are three cases.

        1. Under static forces D is not C^T C, so that singular values of C are no frequencies: the
           low squares must all be zero within rounding, or so few that they can be found again, and
           then all have their digits.
        2. Without static forces, if the low frequencies are few, they are found again as singular
           values of C.
        3. Without static forces, if they are many, they must all be those of motions without
           contacts.
        """
        limit = _LEAST_SQUARE if self.is_prestressed else LEAST_EXACT_SQUARE
        count = int(np.count_nonzero(squares <= limit * bound))
        lowest = squares[:count]
        if self.is_prestressed:
            are_zero = np.abs(lowest) <= NO_SQUARE * bound
            if np.all(are_zero):
                return _LowModes(np.zeros(count), are_zero)
        # Lanczos's method is for a small part of the eigenvalues
        are_many = count > min(_MOST_SHARPENED, len(squares) // 3)
        if self.is_prestressed:
            return None if are_many else self._sharpen_pressed(block, rows, lowest, bound)
        if are_many:
            are_zero = lowest <= 0.0
            is_loose = np.all(are_zero) and block.count_nonzero() == 0
            return _LowModes(np.zeros(count), are_zero) if is_loose else None
        frequencies = _sharpen(block, rows[0], count, bound) if count else np.zeros(0)
        are_zero = frequencies <= _ZERO_ROUNDING * np.sqrt(bound)
        have_digits = np.all(are_zero | (frequencies >= _LEAST_SINGULAR_VALUE * np.sqrt(bound)))
        # if Lanczos has missed an eigenvalue, the next one is in its place, far from LAPACK's value
        are_complete = np.all(np.abs(frequencies**2 - lowest) <= _LARGEST_CHANGE * bound)
        return _LowModes(frequencies, are_zero) if have_digits and are_complete else None

    def _sharpen_pressed(
        self, block: Any, rows: list[Any], lowest: Array, bound: float
    ) -> _LowModes | None:
        """Return the low frequencies of a part of a cell under static forces, whose eigenvalues
        ``lowest`` (m,) have no digits; None if some of them have none in another way either. The
        other arguments are those of :meth:`_resolve_low_modes`.

        Within the space of these modes D is a small matrix of products of rows. The rows are small
        there, and so is their rounding, which is far below that of the entries of D.
        """
        basis = _find_low_space(block, len(lowest), bound)
        products = [rows_of_set @ basis for rows_of_set in rows]
        projection = sum(
            product.conj().T @ (ends.signs[:, None] * product)
            for product, ends in zip(products, self.row_sets, strict=True)
        )
        squares = np.linalg.eigvalsh(projection)
        have_digits = squares[0] >= _LEAST_SINGULAR_VALUE**2 * bound
        are_complete = np.all(np.abs(squares - lowest) <= _LARGEST_CHANGE * bound)
        if not (have_digits and are_complete):
            return None
        return _LowModes(np.sqrt(squares), np.zeros(len(squares), bool))


def _make_frame(lattice: Compatibility, image: NDArray[np.intp] | None) -> Any:
    """Return a sparse unitary matrix (n_branches, n_branches) whose columns are the motions in
    terms of which D is found, as combinations of the motions of the balls of a ``lattice``.

    An inversion takes each ball to its ``image`` (n,). The columns are then even motions, and odd
    motions times i. Without an inversion, ``image`` is None, and the unit matrix is returned.
    """
    from scipy.sparse import eye_array, hstack, kron

    if image is None:
        return eye_array(lattice.n_branches, dtype=complex, format="csr")
    n = lattice.n_balls
    root = np.sqrt(0.5)
    unit = eye_array(n, format="csc")
    self_images = np.flatnonzero(image == np.arange(n))
    first_balls = np.flatnonzero(image > np.arange(n))  # one of each pair of images
    first_units = unit[:, first_balls]
    second_units = unit[:, image[first_balls]]
    even = root * (first_units + second_units)
    odd = 1j * root * (first_units - second_units)
    frame_of_balls = hstack([unit[:, self_images], even, odd])
    return kron(frame_of_balls, np.diag(lattice.motions.phases)).tocsr()


def _split_motions(matrix: Any) -> list[NDArray[np.intp]]:
    """Return the sets of motions, as numbers, that no entry of a sparse ``matrix`` (n, n) joins to
    motions of other sets; those of a loose ball are an example.
    """
    from scipy.sparse.csgraph import connected_components

    labels = connected_components(abs(matrix), directed=False)[1]
    order = np.argsort(labels, kind="stable")
    return np.split(order, np.flatnonzero(np.diff(labels[order])) + 1)


def _sharpen(matrix: Any, rows: Any, count: int, bound: float) -> Array:
    """Return the lowest singular values (count,) of a sparse A = ``rows`` (m, n), ascending.

    ``matrix`` (n, n) is A^H A, and ``bound`` an upper bound of its eigenvalues.
    """
    # the space that the eigenvectors span is accurate to second order, and the singular values of A
    # within this space keep their digits
    basis = _find_low_space(matrix, count, bound)
    return np.asarray(np.linalg.svd(rows @ basis, compute_uv=False)[::-1])


def _find_low_space(matrix: Any, count: int, bound: float) -> NDArray[Any]:
    """Return an orthonormal basis (n, count) of the space of those eigenvectors of a sparse
    ``matrix`` (n, n) whose eigenvalues are lowest; ``bound`` is an upper bound of all of them.
    Raises what :func:`~granphon.dynamics.linalg.find_nearest` raises.
    """
    from scipy.sparse import eye_array

    shift = _SHIFT * bound
    shifted_matrix = matrix + shift * eye_array(matrix.shape[0])
    factors = factorise(shifted_matrix, symmetric=np.isrealobj(matrix.data))
    _, vectors = find_nearest(matrix, count, -shift, factors.solve)
    basis: NDArray[Any] = np.linalg.qr(vectors)[0]
    return basis
