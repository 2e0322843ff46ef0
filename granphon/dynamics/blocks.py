"""Motions that contacts do not join to others, and their modes.

Rows of C(q) and motions fall into blocks that have nothing in common: in the plane and out of it,
or each direction of a chain. The modes of each block are found apart from those of the others. So
motions of two blocks never mix, and the motions that cost nothing are known from the rank of each
block.

A wave of displacements across the periods turns the balls along with it: on a membrane or a chain,
phi = i q x u. The contacts feel only what differs from that rotation, (sin h - h cos h) instead of
sin h, at the half angle h = q.(r_j - r_i)/2 of a contact. In terms of the rotations themselves the
columns of u and of phi are then nearly dependent, and C(q) loses the digits of the flexural branch,
which goes as q^2 or q^3. Here the displacement is taken together with its local rotation, whose
columns are summed in closed form: all digits are kept, down to |q|d = 1e-30.
"""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from functools import cached_property, partial
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from granphon.base.arrays import Array
from granphon.base.errors import InstabilityError
from granphon.dynamics.deformation_rows import WaveRows, bend
from granphon.dynamics.linalg import (
    cholesky_factor,
    find_dependent,
    find_rank,
    graded_eigh,
    graded_svd,
    lapack_svd,
)

#: number of motions from which those that cost nothing at any wave vector are split off by LAPACK
_MANY_FREE = 48
#: relative difference of frequencies, or of their slopes, below which branches are treated as one
#: degenerate set
DEGENERATE = 1e-9
#: difference of slopes of omega^2, d k/M, below which branches that touch have one slope
_EQUAL_SLOPES = 1e-9
#: |dq|d at which branches that touch with one slope are told apart
_STEP_BESIDE = 1e-3
#: a frequency is zero if it is no larger than this multiple of the rounding of its own columns
_ROUNDING = 32.0 * float(np.finfo(np.float64).eps)
#: relative error up to which the rotation of two balls about their middle leaves their contact
#: undeformed
_RIGID = 1e-12
#: wave vectors, 1/d, without symmetry, at which the rank of C(q) is found
GENERIC = np.array(
    [
        [0.7390851, -1.2020569, 0.4669201],
        [1.9021605, 0.5772157, -0.9159656],
        [-0.2614972, 1.3247180, 2.5029079],
    ]
)


class _Point(NamedTuple):
    """C(q) of a block at a stack of wave vectors.

    ``q`` (n_q, p), 1/d, are the wave vectors. ``rows`` (n_q, m, n) are those of the motions in a
    unitary basis ``basis`` (n_q, n, n), or of the motions themselves if ``basis`` is None.
    ``across`` (n_q, m', n) are the rows on which static forces act, None without prestress. The
    inverse of ``triangle`` (n_q, n, n) turns amplitudes in the basis into those of the tilted
    motions; it is None as the basis is.
    """

    q: Array
    rows: NDArray[Any]
    across: NDArray[Any] | None = None
    basis: NDArray[Any] | None = None
    triangle: NDArray[Any] | None = None


def _find_lengths(waves: WaveRows) -> Array:
    """Return the length (kinds, n_c, 1) of each row, if nothing cancelled between the two ends of a
    contact.
    """
    sizes = np.abs(waves.odd) + np.abs(waves.even)
    return np.asarray(np.linalg.norm(sizes, axis=2, keepdims=True))


def _clear_rounding(rows: NDArray[Any], lengths: Array) -> NDArray[Any]:
    """Return rows (kinds, n_c, n) with zero for entries that are rounding errors of rows of these
    ``lengths`` (kinds, n_c, 1).
    """
    return np.where(np.abs(rows) <= _ROUNDING * lengths, 0.0, rows)


def _turn_pushing(pushing: WaveRows, turn: NDArray[Any]) -> WaveRows:
    """Return rows on which static forces act in terms of the motions that are the columns of
    ``turn`` (n, n).
    """
    # static normal forces act on displacements, and not on balls that turn like gears, of which
    # rounding would be left
    lengths = _find_lengths(pushing)
    return pushing._replace(
        odd=_clear_rounding(pushing.odd @ turn, lengths),
        even=_clear_rounding(pushing.even @ turn, lengths),
    )


@dataclass(frozen=True, eq=False)
class Block:
    """Motions of the frame, and the rows of C(q) in which they take part, that nothing joins to
    others.

    Attributes
    ----------
    columns : (n,) numbers of the motions in the frame.
    deforming : rows of K^1/2 C M^-1/2.
    pushing, signs : rows on which static forces act, such as displacements across contacts times
        |f/a|^1/2, and the signs (rows, 1) with which their squares lower D; None without prestress.
    bent : numbers in the block of the displacements across the periods that tilt the balls, at most
        two.
    tilt : (bent, n, p) gradients, with respect to q, of the motions that go with each of them.
    slack : part of the largest squared frequency by which others may be below zero, and are then
        zero.
    turn : (n, n) unitary, to the motions of the frame from those of the rows, see
        :meth:`split_free_motions`; None if they are the same.
    """

    columns: NDArray[np.intp]
    deforming: WaveRows
    pushing: WaveRows | None = None
    signs: Array | None = None
    bent: tuple[int, ...] = ()
    tilt: NDArray[Any] = field(default_factory=lambda: np.zeros((0, 0, 0)))
    turn: NDArray[Any] | None = None
    slack: float = 0.0

    def split_free_motions(self) -> Block:
        """Return the block in terms of motions of which some deform nothing at q = 0, if the block
        has such motions besides sound.

        Balls that turn like gears are an example. Near Gamma the columns of their single rotations
        would cancel.
        """
        turn, free = self._find_free_motions()
        if not free.size:
            return self
        odd = self.deforming.odd @ turn
        even = self.deforming.even @ turn
        # the two ends of a contact cancel to rounding. Each end alone is rounding where a motion
        # deforms nothing at any q, such as the spin of a ball between two others. Gears whose arms
        # differ a little leave more than rounding, and keep it
        lengths = _find_lengths(self.deforming)
        odd[..., free] = _clear_rounding(odd[..., free], lengths)
        even[..., free] = _clear_rounding(even[..., free], lengths)
        # `bent` keeps its numbers: displacements of all balls have no column at q = 0, so that
        # `turn` leaves them as they are
        tilt = np.einsum("mn,kma->kna", turn.conj(), self.tilt) if self.bent else self.tilt
        return replace(
            self,
            deforming=self.deforming._replace(odd=odd, even=even),
            pushing=None if self.pushing is None else _turn_pushing(self.pushing, turn),
            tilt=tilt,
            turn=turn,
        )

    def _find_free_motions(self) -> tuple[NDArray[Any], NDArray[np.intp]]:
        """Return a unitary matrix (n, n), whose columns are new motions in terms of the motions of
        the rows, and the numbers (k,) of the new motions that deform nothing at q = 0.

        Motions whose own columns vanish at q = 0, such as sound, stay as they are, and are not
        among the k.
        """
        odd = self.deforming.odd.reshape(self.n_rows, self.size)
        even = self.deforming.even.reshape(self.n_rows, self.size)
        turn = np.eye(self.size, dtype=even.dtype)
        deforming = np.flatnonzero(np.any(even != 0.0, axis=0))
        if deforming.size < 2:  # a single column that is not zero depends on no other
            return turn, np.zeros(0, np.intp)
        sizes = np.abs(odd) + np.abs(even)
        free, complement = find_dependent(even[:, deforming], sizes[:, deforming])
        turn[np.ix_(deforming, deforming)] = np.concatenate([free, complement], axis=1)
        return turn, deforming[: free.shape[1]]

    @property
    def size(self) -> int:
        """Number of motions."""
        return len(self.columns)

    @property
    def n_rows(self) -> int:
        """Number of rows of C(q)."""
        return len(self.deforming.odd) * len(self.deforming.half)

    @property
    def _kinds(self) -> tuple[WaveRows, ...]:
        """Rows of C(q), then those on which prestress acts, if there is any."""
        return (self.deforming,) if self.pushing is None else (self.deforming, self.pushing)

    @cached_property
    def rank(self) -> int:
        """Generic rank of C(q): the number of its branches that do not vanish at every wave
        vector.
        """
        largest = 0
        periods = self.deforming.half.shape[1]
        # the rank is lower at special wave vectors, and never higher than the generic one
        for q in GENERIC[:, None, :periods]:
            rows = np.concatenate([waves.compute_rows(q)[0] for waves in self._kinds])
            if largest < min(rows.shape):
                largest = max(largest, find_rank(rows))
        return largest

    @property
    def free(self) -> int:
        """Number of branches that vanish at every wave vector."""
        return self.size - self.rank

    @property
    def keeps_digits(self) -> bool:
        """Whether tilted motions help, and leave the contacts undeformed at q = 0.

        Tilted motions do not help where branches of this block vanish for want of rows. A rotation
        of two balls about their middle deforms their contact if the line between the balls is not
        along the normal of the contact.
        """
        if not self.bent or self.n_rows < self.size:
            return False
        bends, _, half = self._tilted
        even = self.deforming.even.reshape(self.n_rows, self.size)
        # deformations (m, bent, p), per step of q at q = 0, of tilted motions
        by_displacement = bends[:, :, None] * half[:, None]
        by_rotation = np.einsum("mn,kna->mka", even, self.tilt)
        largest = np.max(np.abs(by_displacement + by_rotation))
        return bool(largest <= _RIGID * np.max(np.abs(bends)))

    def solve(self, q: Array) -> tuple[Array, NDArray[Any]]:
        """Return frequencies (n_q, n), (k/M)^1/2, ascending, and eigenvectors (n_q, n, n), as
        columns, at wave vectors q (n_q, p), 1/d.
        """
        point = self._compute(q)
        frequencies, modes = self._decompose(point)
        return frequencies, self._turn_back(point, modes)

    def _turn_back(self, point: _Point, modes: NDArray[Any]) -> NDArray[Any]:
        """Return vectors in terms of the motions of the frame."""
        in_motions = modes if point.basis is None else point.basis @ modes
        return in_motions if self.turn is None else self.turn @ in_motions

    def solve_with_velocities(self, q: Array, along: Array) -> tuple[Array, NDArray[Any], Array]:
        """Return frequencies (n_q, n), (k/M)^1/2, ascending, eigenvectors (n_q, n, n), as columns,
        and group velocities (n_q, n, p), d (k/M)^1/2, at wave vectors q (n_q, p), 1/d; degenerate
        sets are resolved along the unit vectors ``along`` (n_q, p).
        """
        point = self._compute(q)
        frequencies, modes = self._decompose(point)
        slopes = _Slopes(self, point, frequencies)
        joined = frequencies[:, 1:] - frequencies[:, :-1] <= DEGENERATE * frequencies[:, 1:]
        if np.any(joined):
            if np.any(frequencies[:, 0] == 0.0):
                # branches that vanish everywhere have no order among themselves
                joined[:, : self.free] = False
            self._split_degenerate(point, modes, slopes, joined, along)
        # d(omega^2)/dq over 2 omega; a branch that vanishes everywhere does not travel
        doubled = np.where(frequencies > 0.0, 2.0 * frequencies, np.inf)
        velocities = slopes.compute_gradients(modes) / doubled[..., None]
        if not frequencies.all():
            n_zeros = np.count_nonzero(frequencies == 0.0, axis=1)
            for number in np.flatnonzero(n_zeros > self.free).tolist():
                at_number = (frequencies[number], modes[number], velocities[number], along[number])
                self._leave_zero(point, number, *at_number)
        return frequencies, self._turn_back(point, modes), velocities

    def _leave_zero(
        self,
        point: _Point,
        number: int,
        frequencies: Array,
        modes: NDArray[Any],
        velocities: Array,
        along: Array,
    ) -> None:
        """Turn the modes of zero frequency at the wave vector of this ``number``, in place, into
        those that a path along a unit vector ``along`` (p,) follows as it leaves the wave vector.

        ``modes`` (n, n) holds all n modes there, as columns, with their ``frequencies`` (n,). The
        ``velocities`` (n, p) of the modes of zero frequency become the limits along the path.
        Beside the wave vector frequencies that are zero rise as cones, as those of sound do beside
        Gamma: the slopes are the singular values of the change of C, less what the modes of higher
        frequencies can take up.
        """
        count = int(np.count_nonzero(frequencies == 0.0))
        motions = modes if point.basis is None else point.basis[number] @ modes
        q = point.q[number : number + 1]
        rows = np.concatenate([waves.compute_rows(q)[0] for waves in self._kinds])
        # the derivative of a row is by its half angle, whose gradient with respect to q is the half
        # vector
        slope = np.concatenate([waves.compute_rows(q, derivative=True)[0] for waves in self._kinds])
        half = np.concatenate([waves.repeat_half_vectors() for waves in self._kinds])
        stiff = rows @ motions[:, count:] / frequencies[count:]
        change = half.T[:, :, None] * (slope @ motions[:, :count])  # (p, rows, count)
        if self.signs is None:
            speeds, turn, forms = self._find_cones(stiff, change, along)
        else:
            speeds, turn, forms = self._find_pressed_cones(stiff, change, along)
        speeds = np.where(speeds <= self._limit * self._largest, 0.0, speeds)
        is_equal = np.diff(speeds) <= DEGENERATE * speeds[1:]
        for _, run in _find_runs(is_equal[None]):
            # modes of one speed stay as they are, as far as they can: u vh is the nearest rotation
            u, _, vh = np.linalg.svd(turn[run, run])
            turn[:, run] = turn[:, run] @ (u @ vh).conj().T
        modes[:, :count] = modes[:, :count] @ turn
        # half the gradients of the squares a step of length one away, where the frequencies are the
        # speeds; a mode without speed does not travel
        gradients = np.einsum("yz,ayx,xz->za", turn.conj(), forms, turn).real
        inverse = np.divide(1.0, speeds, out=np.zeros_like(speeds), where=speeds > 0.0)
        velocities[:count] = gradients * inverse[:, None] + 0.0  # no minus zero

    def _find_cones(
        self, stiff: NDArray[Any], change: NDArray[Any], along: Array
    ) -> tuple[Array, NDArray[Any], NDArray[Any]]:
        """Return speeds (m,), ascending, of the m modes that leave zero along a unit vector
        ``along`` (p,), their vectors (m, m) as columns, and forms (p, m, m).

        A step of length s along the path takes a mode of vector v and speed c to the frequency
        s c, whose square has the gradient 2 s v^H forms v with respect to q. ``stiff`` (rows, k)
        are the deformations of the modes of higher frequencies, each over its frequency, and
        ``change`` (p, rows, m) those of the m modes, per step of q.
        """
        count = change.shape[2]
        change_along = np.tensordot(along, change, 1)
        # the modes of higher frequencies take up the deformations in their span
        basis = np.linalg.qr(stiff)[0]
        rigid = change - basis @ (basis.conj().T @ change)
        rigid_along = change_along - basis @ (basis.conj().T @ change_along)
        forms = rigid.conj().swapaxes(1, 2) @ rigid_along
        # rows of zeros give m singular values also to fewer rows
        padded = np.pad(rigid_along, ((0, max(0, count - len(rigid_along))), (0, 0)))
        _, speeds, turn = np.linalg.svd(padded, full_matrices=False)
        return speeds[::-1], turn[::-1].conj().T, forms

    def _find_pressed_cones(
        self, stiff: NDArray[Any], change: NDArray[Any], along: Array
    ) -> tuple[Array, NDArray[Any], NDArray[Any]]:
        """Return speeds (m,), vectors (m, m) and forms (p, m, m) as :meth:`_find_cones`, with the
        same arguments, under static forces: squares are then those of deformations less those,
        with signs, of the rows on which static forces act.
        """
        weight = np.concatenate([np.ones((self.n_rows, 1)), -np.asarray(self.signs)])
        change_along = np.tensordot(along, change, 1)
        pull = stiff.conj().T @ (weight * change)
        pull_along = stiff.conj().T @ (weight * change_along)
        whole_forms = change.conj().swapaxes(1, 2) @ (weight * change_along)
        # less what the modes of higher frequencies take up
        forms = whole_forms - pull.conj().swapaxes(1, 2) @ pull_along
        squares, turn = np.linalg.eigh(np.tensordot(along, forms, 1))
        return np.sqrt(np.maximum(squares, 0.0)), turn, forms

    def _split_degenerate(
        self,
        point: _Point,
        modes: NDArray[Any],
        slopes: _Slopes,
        joined: NDArray[np.bool_],
        along: Array,
    ) -> None:
        """Turn the vectors ``modes`` (n_q, n, n) of each degenerate set, in place, into those of
        the branches along a direction ``along`` (n_q, p).

        Branches are told apart by the slopes of omega^2 along the direction, and those of equal
        slope by the modes a small step further.

        ``joined`` (n_q, n - 1) says whether a branch has the frequency of the next; ``point`` is C
        at the wave vectors, and ``slopes`` finds the slopes of omega^2 there.
        """
        equal_slopes: list[tuple[NDArray[np.intp], slice]] = []
        for points, branches in _find_runs(joined):
            vectors = modes[points, :, branches]
            matrices = slopes.compute_along(points, vectors, branches.start, along[points])
            slope, turn = np.linalg.eigh(matrices)
            modes[points, :, branches] = vectors @ turn
            for sets, equal in _find_runs(np.diff(slope, axis=1) <= _EQUAL_SLOPES):
                run = slice(branches.start + equal.start, branches.start + equal.stop)
                equal_slopes.append((points[sets], run))
        if equal_slopes:
            self._split_equal_slopes(point, modes, equal_slopes, along)

    def _split_equal_slopes(
        self,
        point: _Point,
        modes: NDArray[Any],
        equal_slopes: list[tuple[NDArray[np.intp], slice]],
        along: Array,
    ) -> None:
        """Turn the vectors of branches of equal slope, in place, into those that are nearest to the
        modes one step further along the path.

        Branches of equal slope separate at second order only. The length of the step, not LAPACK's
        error, limits the accuracy. Branches that are still one after the step have no vectors of
        their own. ``modes`` (n_q, n, n) are the vectors, ``along`` (n_q, p) the path, and
        ``equal_slopes`` pairs of the numbers of wave vectors (k,) and the branches that have one
        slope there.
        """
        solved = np.unique(np.concatenate([points for points, _ in equal_slopes]))
        beside = point.q[solved] + _STEP_BESIDE * along[solved]
        factors = self.deforming.compute_rows(beside)
        across = None if self.pushing is None else self.pushing.compute_rows(beside)
        matrices = self._make_matrix(factors, across)
        squares = np.linalg.eigvalsh(matrices)
        for points, branches in equal_slopes:
            steps = np.searchsorted(solved, points)
            highest = squares[steps, branches.stop - 1]
            lowest = squares[steps, branches.start]
            is_split = highest - lowest > DEGENERATE * highest
            if not np.any(is_split):
                continue
            split_points = points[is_split]
            split_steps = steps[is_split]
            amplitudes = modes[split_points, :, branches]
            vectors = amplitudes
            if point.basis is not None:
                vectors = point.basis[split_points] @ amplitudes
            rows = factors[split_steps]
            if self.pushing is not None:
                rows = factorise(matrices[split_steps], self.slack)
            modes_beside = lapack_svd(rows)[1][:, :, branches]
            # u vh is the rotation that takes the vectors nearest to the modes beside
            u, _, vh = np.linalg.svd(vectors.conj().swapaxes(1, 2) @ modes_beside)
            modes[split_points, :, branches] = amplitudes @ (u @ vh)

    def _make_matrix(self, rows: NDArray[Any], across: NDArray[Any] | None) -> NDArray[Any]:
        """Return D(q) (n_q, n, n) from rows (n_q, m, n) of C(q), and under prestress from those on
        which static forces act, ``across`` (n_q, m', n).
        """
        matrices = rows.conj().swapaxes(1, 2) @ rows
        if across is not None:
            matrices = matrices - across.conj().swapaxes(1, 2) @ (self.signs * across)
        return np.asarray(matrices)

    # -- C(q) --------------------------------------------------------------------------------------

    def _compute(self, q: Array) -> _Point:
        """Return C at wave vectors q (n_q, p), 1/d; without static forces in the basis of tilted
        motions, if the block has displacements across the periods that tilt the balls.
        """
        rows = self.deforming.compute_rows(q)
        if self.pushing is not None:
            return _Point(q, rows, self.pushing.compute_rows(q))
        if not self.bent:
            return _Point(q, rows)
        # tilted motions: first the bent displacements, each with its rotation, then all others
        count = len(self.bent)
        untilted = np.eye(self.size)[:, self._order]
        motions = untilted + np.zeros((len(q), 1, 1), self.tilt.dtype)  # (n_q, n, n)
        motions[:, :, :count] += np.einsum("kna,qa->qnk", self.tilt, q)
        basis, triangle = np.linalg.qr(motions)
        # A rigid rotation of two balls about the middle of their centres deforms no contact. So the
        # columns of tilted motions are sums in which sine and cosine do not cancel
        bends, turns, half = self._tilted
        angle = q @ half.T
        by_bending = bend(angle)[..., None] * bends
        by_turning = np.sin(angle)[..., None] * np.einsum("mka,qa->qmk", turns, q)
        # from tilted motions to the first vectors of the basis
        columns = (by_bending + by_turning) @ np.linalg.inv(triangle[:, :count, :count])
        rows_in_basis = np.concatenate([columns, rows @ basis[:, :, count:]], axis=2)
        return _Point(q, rows_in_basis, basis=basis, triangle=triangle)

    @cached_property
    def _order(self) -> list[int]:
        """Motions of the block, the bent ones first."""
        return [*self.bent, *(motion for motion in range(self.size) if motion not in self.bent)]

    @cached_property
    def _tilted(self) -> tuple[NDArray[Any], NDArray[Any], Array]:
        """Factors of the tilted columns: (m, bent) of sin h - h cos h, (m, bent, p) of q sin h; and
        half vectors (m, p).
        """
        odd = self.deforming.odd.reshape(self.n_rows, self.size)
        return (
            odd[:, self.bent],
            np.einsum("mn,kna->mka", odd, self.tilt),
            self.deforming.repeat_half_vectors(),
        )

    # -- frequencies -------------------------------------------------------------------------------

    def _decompose(self, point: _Point) -> tuple[Array, NDArray[Any]]:
        """Return frequencies (n_q, n), ascending, and eigenvectors (n_q, n, n), as columns, in the
        basis of the point.
        """
        matrices = None if point.across is None else self._make_matrix(point.rows, point.across)
        if matrices is not None:
            self._drop_rounding(point.q, matrices)
        if self.free and self.size > _MANY_FREE:
            frequencies, modes = self._split_free(point.rows, matrices)
        else:
            frequencies, modes = self._decompose_all(point.rows, matrices)
        small = (frequencies <= self._limit * self._largest) & (frequencies > 0.0)
        doubtful = np.flatnonzero(np.any(small, axis=1))
        if doubtful.size:
            frequencies[doubtful], modes[doubtful] = self._drop_small(
                point.q[doubtful], frequencies[doubtful], modes[doubtful]
            )
        return frequencies, modes

    def _decompose_all(
        self, rows: NDArray[Any], matrices: NDArray[Any] | None
    ) -> tuple[Array, NDArray[Any]]:
        """Return frequencies (n_q, n) and eigenvectors (n_q, n, n) from rows of C, or, under
        prestress, from the ``matrices`` D.
        """
        if matrices is None:
            return graded_svd(rows)
        return graded_eigh(matrices, partial(factorise, slack=self.slack))

    def _split_free(
        self, rows: NDArray[Any], matrices: NDArray[Any] | None
    ) -> tuple[Array, NDArray[Any]]:
        """Return frequencies (n_q, n), ascending, and eigenvectors (n_q, n, n), as columns, with
        the motions that cost nothing split off by LAPACK.

        Plane rotations would take minutes to tell these motions from the softest. The arguments are
        those of :meth:`_decompose_all`.
        """
        if matrices is None:
            basis = lapack_svd(rows)[1]
            stiff = basis[:, :, self.free :]
            frequencies, modes = self._decompose_all(rows @ stiff, None)
        else:
            squares, vectors = np.linalg.eigh(matrices)
            # a negative square, of a lattice that buckles, is not among the smallest
            order = np.argsort(np.abs(squares), axis=1)
            basis = np.take_along_axis(vectors, order[:, None], 2)
            stiff = basis[:, :, self.free :]
            stiff_matrices = stiff.conj().swapaxes(1, 2) @ matrices @ stiff
            frequencies, modes = self._decompose_all(rows, stiff_matrices)
        all_vectors = np.concatenate([basis[:, :, : self.free], stiff @ modes], axis=2)
        return np.pad(frequencies, ((0, 0), (self.free, 0))), all_vectors

    def _drop_small(
        self, q: Array, frequencies: Array, modes: NDArray[Any]
    ) -> tuple[Array, NDArray[Any]]:
        """Return frequencies (n_q, n), ascending, and eigenvectors (n_q, n, n), with frequencies
        set to zero that are no more than the rounding of sine and cosine in their own columns, or
        belong to branches that vanish everywhere.

        ``frequencies`` and ``modes``, in the basis of the point, are those at the wave vectors q
        (n_q, p).
        """
        squares = self._measure_columns(q)
        if self.bent:
            bends, turns, half = self._tilted
            angle = np.abs(q @ half.T)[..., None]
            drift = np.abs(np.einsum("mka,qa->qmk", turns, q))
            # sin h - h cos h is of third order in h
            tilted_sizes = np.minimum(angle, angle**3) * np.abs(bends) + angle * drift
            tilted_squares = np.sum(tilted_sizes**2, axis=1)
            plain_squares = squares[:, self._order[len(self.bent) :]]
            squares = np.concatenate([tilted_squares, plain_squares], axis=1)
        lengths = np.sqrt(np.einsum("qn,qnb->qb", squares, np.abs(modes) ** 2))
        rounding = self._limit * lengths
        frequencies = np.where(frequencies <= rounding, 0.0, frequencies)
        frequencies[:, : self.free] = 0.0
        if np.any(frequencies[:, 1:] < frequencies[:, :-1]):
            order = np.argsort(frequencies, axis=1, kind="stable")
            frequencies = np.take_along_axis(frequencies, order, 1)
            modes = np.take_along_axis(modes, order[:, None], 2)
        return frequencies, modes

    def _drop_rounding(self, q: Array, matrices: NDArray[Any]) -> None:
        """Set diagonal entries of D(q) (n_q, n, n) that are rounding of zero, and may be below it,
        to zero, in place.
        """
        diagonal = np.einsum("qii->qi", matrices)  # a view: what is set in it is set in D
        squares = self._measure_columns(q)
        is_doubtful = (diagonal != 0.0) & (np.abs(diagonal) <= _ROUNDING * squares)
        points, columns = np.nonzero(is_doubtful)
        # |D_ij|^2 <= D_ii D_jj, unless the lattice buckles: larger entries of such a row say that
        # it does, and the diagonal stays
        bounds = _ROUNDING * squares[points, columns][:, None] * squares[points]
        is_zero = np.all(np.abs(matrices[points, columns]) ** 2 <= bounds, axis=1)
        diagonal[points[is_zero], columns[is_zero]] = 0.0

    def _measure_columns(self, q: Array) -> Array:
        """Return squares (n_q, n) of the lengths of columns of C(q), as if nothing cancelled;
        rounding is in proportion.
        """
        squares: Any = 0.0
        for waves in self._kinds:
            odd = np.abs(waves.odd)
            even = np.abs(waves.even)
            # where two ends cancel, their difference is rounding of both
            even = np.where(even > 0.0, even + odd, 0.0)
            half_angle = np.abs(q @ waves.half.T)
            size = half_angle[:, None, :, None] * odd + even  # (n_q, kinds, n_c, n)
            squares = squares + np.sum(size**2, axis=(1, 2))
        return np.asarray(squares)

    @property
    def _limit(self) -> float:
        """Least relative rounding of a frequency; under prestress squares are rounded."""
        return _ROUNDING if self.pushing is None else float(np.sqrt(_ROUNDING))

    @cached_property
    def _largest(self) -> float:
        """An upper bound of the lengths of :meth:`_measure_columns` at half angles up to 3."""
        return 4.0 * float(
            sum(np.linalg.norm(rows) for waves in self._kinds for rows in (waves.odd, waves.even))
        )


class _Slopes:
    """<v_b| dD/dq |v_c>, D = C^H C, as 2 Re <C v_b| dC/dq |v_c>, which is exact near Gamma too.

    ``frequencies`` (n_q, n) are those of a block at the wave vectors of a ``point``.
    """

    def __init__(self, block: Block, point: _Point, frequencies: Array) -> None:
        self.block = block
        self.point = point
        self.frequencies = frequencies
        #: rows, their derivatives with respect to the half angle, and the half vectors, with the
        #: sign of the term
        self.kinds = [
            (
                point.rows,
                block.deforming.compute_rows(point.q, derivative=True),
                block.deforming.repeat_half_vectors(),
            )
        ]
        if block.pushing is not None and point.across is not None:
            half = -np.asarray(block.signs) * block.pushing.repeat_half_vectors()
            slopes = block.pushing.compute_rows(point.q, derivative=True)
            self.kinds.append((point.across, slopes, half))
        if point.basis is not None:
            # gradients (n_q, p, m, bent), with respect to q, of the tilted columns of C(q)
            bends, turns, half = block._tilted
            angle = (point.q @ half.T)[..., None]
            inner = angle * np.sin(angle) * bends
            inner = inner + np.cos(angle) * np.einsum("mka,qa->qmk", turns, point.q)
            outer = np.sin(angle)[:, None] * np.moveaxis(turns, 2, 0)
            self.tilted = half.T[:, :, None] * inner[:, None] + outer

    def compute_along(
        self, points: NDArray[np.intp], vectors: NDArray[Any], first: int, along: Array
    ) -> NDArray[Any]:
        """Return the matrices (k, b, b) of the slopes of omega^2 along directions ``along`` (k, p),
        between degenerate ``vectors`` (k, n, b) at k of the wave vectors, of numbers ``points``.

        The frequencies of the vectors are those of the branch number ``first``.
        """
        if self.point.basis is not None:
            deformations, changes = self._tilt(points, vectors, self.frequencies[points, first])
            products = np.einsum("qxb,qaxc,qa->qbc", deformations.conj(), changes, along)
        else:
            products = np.zeros((len(points), vectors.shape[2], vectors.shape[2]))
            for rows, slope, half in self.kinds:
                if len(points) < len(rows):
                    rows = rows[points]
                    slope = slope[points]
                deformations = (rows @ vectors).conj().swapaxes(1, 2)
                weighted = deformations * (along @ half.T)[:, None]
                products = products + weighted @ (slope @ vectors)
        return np.asarray(products + products.conj().swapaxes(-1, -2))

    def compute_gradients(self, vectors: NDArray[Any]) -> Array:
        """Return the gradients (n_q, n, p) of omega^2 of each of the ``vectors`` (n_q, n, n)."""
        # omega^2 is the square of the deformations: its gradient is twice the real part of their
        # product with their own gradients
        if self.point.basis is not None:
            deformations, changes = self._tilt(slice(None), vectors, self.frequencies[:, None, :])
            return np.asarray(2.0 * np.einsum("qxb,qaxb->qba", deformations.conj(), changes).real)
        total: Any = 0.0
        for rows, slope, half in self.kinds:
            products = ((rows @ vectors).conj() * (slope @ vectors)).real
            total = total + 2.0 * half.T @ products
        return np.asarray(total.swapaxes(1, 2))

    def _tilt(
        self, points: Any, vectors: NDArray[Any], frequencies: Array
    ) -> tuple[NDArray[Any], NDArray[Any]]:
        """Return C v (k, m + n, b), and dC/dq v (k, p, m + n, b), of amplitudes v, ``vectors``
        (k, n, b), in the basis; the last n rows are the change of the tilted motions' lengths.

        The squares of ``frequencies`` are the eigenvalues of (C T)^H C T in the metric
        T^H T of the tilted motions T. ``points`` select k of the wave vectors.
        """
        block = self.block
        point = self.point
        count = len(block.bent)
        tilted = np.linalg.solve(point.triangle[points], vectors)  # type: ignore[index]
        rows, slope, half = self.kinds[0]
        motion = np.zeros_like(tilted)
        motion[:, block._order[count:]] = tilted[:, count:]
        plain = half.T[:, :, None] * (slope[points] @ motion)[:, None]
        bent = self.tilted[points] @ tilted[:, None, :count]
        lengths = np.einsum("kna,qkb->qanb", block.tilt, tilted[:, :count])
        motions = point.basis[points] @ vectors  # type: ignore[index]
        squares = frequencies.reshape(len(frequencies), 1, 1, -1) ** 2
        deformations = np.concatenate([rows[points] @ vectors, motions], axis=1)
        changes = np.concatenate([plain + bent, -squares * lengths], axis=2)
        return deformations, changes


def factorise(matrices: NDArray[Any], slack: float = 0.0) -> NDArray[Any]:
    """Return L^H (n_q, n, n) of D = L L^H, the ``matrices`` (n_q, n, n).

    Raises :class:`~granphon.base.errors.InstabilityError` if a squared frequency is negative, by
    more than ``slack`` of the largest; by less it is taken for zero.
    """
    try:
        return cholesky_factor(matrices)
    except np.linalg.LinAlgError:
        squares, vectors = np.linalg.eigh(matrices)
        is_unstable = np.any(squares[:, 0] < -slack * squares[:, -1])
        if not slack or is_unstable:
            raise InstabilityError("a squared frequency is negative") from None
        frequencies = np.sqrt(np.maximum(squares, 0.0))
        return np.asarray(frequencies[..., None] * vectors.conj().swapaxes(1, 2))


def find_blocks(effects: NDArray[np.bool_]) -> list[NDArray[np.intp]]:
    """Return the sets of columns that no row joins to others, from whether each row feels each
    column, ``effects`` (rows, n).
    """
    n_columns = effects.shape[1]
    if effects.all(axis=1).any():  # one row joins all
        return [np.arange(n_columns)]
    unassigned = np.ones(n_columns, bool)
    blocks = []
    while np.any(unassigned):
        # a block begins with the first column, and grows by what its rows join to it
        block = np.arange(n_columns) == np.argmax(unassigned)
        count = 0
        while count < int(np.count_nonzero(block)):
            count = int(np.count_nonzero(block))
            rows_of_block = np.any(effects[:, block], axis=1)
            block = block | np.any(effects[rows_of_block], axis=0)
        unassigned &= ~block
        blocks.append(np.flatnonzero(block))
    return blocks


def _find_runs(joined: NDArray[np.bool_]) -> list[tuple[NDArray[np.intp], slice]]:
    """Return the runs of items that belong together in n rows: each run, as a slice of items, after
    the rows (k,) that have it.

    ``joined`` (n, m - 1) says whether item j + 1 belongs with item j.
    """
    count, width = joined.shape
    padded = np.zeros((count, width + 2), np.int8)
    padded[:, 1:-1] = joined
    edges = padded[:, 1:] - padded[:, :-1]
    rows, start = np.nonzero(edges == 1)
    stop = np.nonzero(edges == -1)[1] + 1
    if not rows.size:
        return []
    # one number stands for both ends of a run
    base = width + 2
    codes, run_of_row = np.unique(start * base + stop, return_inverse=True)
    runs = [slice(*divmod(int(code), base)) for code in codes]
    return [(rows[run_of_row == k], run) for k, run in enumerate(runs)]
