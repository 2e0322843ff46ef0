"""Vibrations of cells of hundreds of balls and more: C(q) and D(q) as sparse matrices, of which D
alone is made dense.

The motions are those of each ball. A contact joins two balls, so that D costs next to nothing, and
LAPACK's eigenvalues take nearly all of the time. If an inversion leaves the cell the same, even
motions and odd ones times i make D real.

An eigenvalue of D has the error of rounding of the largest. The few that are far below it are found
again, by Lanczos with sparse factors, as squares of singular values of C. What has no digits so
either, as sound very near Gamma, and modes that touch, are left to the blocks of
:mod:`granphon.dynamics.blocks`, whose matrices are dense and keep all digits.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from granphon.base.arrays import Array
from granphon.dynamics.blocks import GENERIC
from granphon.dynamics.compatibility import Compatibility
from granphon.dynamics.linalg import WELL_ABOVE, find_nearest
from granphon.dynamics.rows import Row
from granphon.dynamics.sparse_relaxation import compose_ends

#: singular value of C, over the largest, from which it has eleven digits in the motions of balls
_LEAST = 1e-5
#: the same of a mode, whose error is of first order
_LEAST_OF_MODES = 1e-3
#: singular value of C, over the largest, up to which it is rounding of zero
_NOTHING = 1e-13
#: distance of a wave vector from Gamma, 1/d, from which sound is well above that
_FAR = 1e-2
#: eigenvalue under prestress, over the largest, from which it has digits: it is rounded itself
_LEAST_SQUARE = 1e-7
#: and up to which it is rounding of zero
_NO_SQUARE = 1e-12
#: distance of the shift of Lanczos from zero, over the largest eigenvalue
_SHIFT = 1e-8
#: error of eigenvalues, over the largest, that tells that one is missing
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
            one = unit[:, pair]
            other = unit[:, image[pair]]
            of_balls = hstack([unit[:, fixed], root * (one + other), 1j * root * (one - other)])
            self.frame = kron(of_balls, np.diag(lattice.motions.phases)).tocsr()
        #: fewest frequencies of zero at any wave vector so far
        self._zeros = self.size
        self.kinds: list[_Ends] = []
        for prestress, (own, roots) in enumerate(rows):
            ends = [one @ self.frame for one in compose_ends(lattice, own, roots)]
            signs = -lattice.static_signs if prestress else np.ones((len(own), len(table)))
            half = np.tile(0.5 * table.vector[:, : lattice.periods], (len(own), 1))
            self.kinds.append(_Ends(ends[0], ends[1], half, signs.ravel()))

    def find_frequencies(self, q: Array) -> Array | None:
        """Find frequencies (n,), ascending, at one wave vector (p,); None if digits would be
        lost.
        """
        found = self._solve(q, False)
        return None if found is None else np.sort(found[0])

    def solve_with_velocities(self, q: Array) -> tuple[Array, NDArray[Any], Array] | None:
        """Find frequencies (n,), motions of balls (n, n), as columns, and group velocities (n, p)
        at one wave vector (p,).

        Return None if digits would be lost, or branches touch.
        """
        found = self._solve(q, True)
        if found is None:
            return None
        order = np.argsort(found[0], kind="stable")
        values = found[0][order]
        vectors = found[1][:, order]
        if values[0] < _LEAST_OF_MODES * values[-1] or np.any(
            np.diff(values) <= _DEGENERATE * values[1:]
        ):
            return None
        gradients = np.zeros((self.size, len(q)))
        for ends in self.kinds:
            ahead = ends.head @ vectors
            behind = ends.tail @ vectors
            phase = np.exp(1j * (ends.half @ q))[:, None]
            ahead = phase * ahead
            behind = phase.conj() * behind
            # 2 Re <C v| S dC/dq |v>, dC/dq = i half (head + tail)
            gradients -= (
                2.0
                * (((ahead - behind).conj() * (ahead + behind)).imag * ends.signs[:, None]).T
                @ ends.half
            )
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
        for ends in self.kinds:
            phase = np.exp(1j * (ends.half @ q))[:, None]
            rows.append((ends.head.multiply(phase) - ends.tail.multiply(phase.conj())).tocsr())
        matrix = sum(
            one.conj().T @ one.multiply(ends.signs[:, None])
            for one, ends in zip(rows, self.kinds, strict=True)
        )
        matrix = (matrix.real if self.is_real else matrix).tocsr()
        return rows[0], matrix, float(abs(matrix).sum(axis=1).max())

    def _solve(self, q: Array, wanted: bool) -> tuple[Array, NDArray[Any]] | None:
        """Find frequencies, in any order, and eigenvectors if they are wanted."""
        rows, matrix, top = self._compute(q)
        values = np.zeros(self.size)
        vectors = np.zeros((self.size,) * 2 if wanted else (0, 0), matrix.dtype)
        for part in _split(matrix):
            own = matrix[part][:, part]
            if wanted:
                squares, vectors[np.ix_(part, part)] = np.linalg.eigh(own.toarray())
            else:
                squares = np.linalg.eigvalsh(own.toarray())
            sizes = np.sqrt(np.maximum(squares, 0.0))
            low = int(
                np.count_nonzero(squares <= (_LEAST_SQUARE if self.pressed else WELL_ABOVE) * top)
            )
            if self.pressed:  # squares are rounded, and nothing helps
                nothing = np.abs(squares[:low]) <= _NO_SQUARE * top
                lost = not np.all(nothing)
            elif low <= min(_MOST, len(part) // 3):
                sizes[:low] = _sharpen(own, rows[:, part], low, top) if low else 0.0
                nothing = sizes[:low] <= _NOTHING * np.sqrt(top)
                lost = not np.all(nothing | (sizes[:low] >= _LEAST * np.sqrt(top)))
                lost = lost or bool(
                    np.any(np.abs(sizes[:low] ** 2 - squares[:low]) > _MISSED * top)
                )
            else:
                nothing = sizes[:low] <= 0.0
                lost = not np.all(nothing & (own.count_nonzero() == 0))
            if lost or (np.any(nothing) and 0.0 < float(np.linalg.norm(q)) < _FAR):
                return None
            sizes[:low][nothing] = 0.0
            values[part] = sizes
        self._zeros = min(self._zeros, int(np.count_nonzero(values == 0.0)))
        return values, vectors


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
    from scipy.sparse.linalg import splu

    shift = _SHIFT * top
    factors = splu(
        (matrix + shift * eye_array(matrix.shape[0])).tocsc(), permc_spec="MMD_AT_PLUS_A"
    )
    _, vectors = find_nearest(matrix, count, -shift, factors.solve)
    return np.asarray(np.linalg.svd(rows @ np.linalg.qr(vectors)[0], compute_uv=False)[::-1])
