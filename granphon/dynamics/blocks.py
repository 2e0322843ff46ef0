"""Blocks: sets of motions that no contact joins to other motions, and their modes.

Rows of C(q) and motions fall into blocks that have nothing in common: in the plane and out of it,
or each direction of a chain. The modes of each block are found apart from those of the others. So
motions of two blocks never mix, and the motions that cost nothing are known from the rank of each
block.

A wave of displacements u across the periods, on a membrane or a chain, turns the balls along with
it by phi = i q x u. The contacts resist only what differs from that rotation. Their deformation is
therefore proportional to sin h - h cos h instead of sin h, where h = q.(r_j - r_i)/2 is the half
angle of a contact. If u and phi are columns of their own, these are nearly dependent, and C(q)
loses the digits of the flexural branch, whose frequency goes as q^2 or q^3. Here each such
displacement and its rotation are one *tilted motion*, whose column is summed in closed form. So all
digits are kept, down to |q|d = 1e-30.
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

#: number of motions of a block above which LAPACK splits off those that cost nothing at any wave
#: vector
_MOST_UNSPLIT = 48
#: relative difference of frequencies, or of their slopes, below which branches are treated as one
#: degenerate set
DEGENERACY = 1e-9
#: difference of slopes of omega^2, d k/M, below which branches of one frequency have one slope
_EQUAL_SLOPES = 1e-9
#: length of the step in q, 1/d, after which branches of one frequency and one slope are told apart
_STEP_BESIDE = 1e-3
#: size of a number, over that of the terms that cancel in it, up to which the number is rounding
_ROUNDING = 32.0 * float(np.finfo(np.float64).eps)
#: relative error up to which the rotation of two balls about their middle leaves their contact
#: undeformed
_RIGIDITY_ERROR = 1e-12
#: wave vectors, 1/d, without symmetry, at which the rank of C(q) is found
GENERIC_WAVEVECTORS = np.array(
    [
        [0.7390851, -1.2020569, 0.4669201],
        [1.9021605, 0.5772157, -0.9159656],
        [-0.2614972, 1.3247180, 2.5029079],
    ]
)


class _Point(NamedTuple):
    """C(q) of a block at a stack of wave vectors.

    Attributes
    ----------
    q : (n_q, p) wave vectors, 1/d.
    rows : (n_q, m, n) rows of C(q), as coefficients of the columns of ``basis``, or of the motions
        of the block if ``basis`` is None.
    across : (n_q, m', n) rows on which static forces act; None without prestress.
    basis : (n_q, n, n) unitary; its columns are combinations of the motions of the block, of which
        the first ones span the tilted motions. None if no motion is tilted.
    triangle : (n_q, n, n), whose inverse turns amplitudes in the basis into amplitudes of the
        tilted and other motions: the R of their QR decomposition. None if no motion is tilted.
    """

    q: Array
    rows: NDArray[Any]
    across: NDArray[Any] | None = None
    basis: NDArray[Any] | None = None
    triangle: NDArray[Any] | None = None


def _find_lengths(waves: WaveRows) -> Array:
    """Return the length (kinds, n_c, 1) that each row of ``waves`` could have if its two ends did
    not cancel each other.
    """
    sizes = np.abs(waves.odd) + np.abs(waves.even)
    return np.asarray(np.linalg.norm(sizes, axis=2, keepdims=True))


def _clear_rounding(rows: NDArray[Any], lengths: Array) -> NDArray[Any]:
    """Return ``rows`` (kinds, n_c, n) with zero for entries that are rounding errors. Each entry is
    compared with the length of its row before the two ends of the contact cancelled, ``lengths``
    (kinds, n_c, 1).
    """
    return np.where(np.abs(rows) <= _ROUNDING * lengths, 0.0, rows)


def _turn_pushing(pushing: WaveRows, turn: NDArray[Any]) -> WaveRows:
    """Return the rows ``pushing``, on which static forces act, as coefficients of the motions that
    are the columns of ``turn`` (n, n).
    """
    # static normal forces act on displacements. For balls that turn like gears their rows are zero,
    # but rounding is left
    lengths = _find_lengths(pushing)
    return pushing._replace(
        odd=_clear_rounding(pushing.odd @ turn, lengths),
        even=_clear_rounding(pushing.even @ turn, lengths),
    )


@dataclass(frozen=True, eq=False)
class Block:
    """A set of n motions of the frame that no row of C(q) joins to other motions, and the rows in
    which they take part. The frame is that of
    :class:`~granphon.dynamics.contact_lattice.ContactLattice`.

    Attributes
    ----------
    columns : (n,) numbers of the motions in the frame.
    deforming : rows of K^1/2 C M^-1/2.
    pushing : rows on which static forces act, such as displacements across contacts times
        |f/a|^1/2; None without prestress.
    signs : (rows, 1) signs with which the squares of the rows ``pushing`` are subtracted from D;
        None without prestress.
    bent : numbers, in the block, of the n_bent displacements across the periods that tilt the
        balls, at most two.
    tilt : (n_bent, n, p) gradients, with respect to q, of the motion that goes with each of these
        displacements.
    slack : part of the largest squared frequency by which other squares may be below zero; these
        are then taken for zero.
    turn : (n, n) unitary, which turns the motions of the rows into those of the frame, see
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
        """Return the block with rows and ``turn`` of new motions, some of which deform nothing at
        q = 0. A block without such motions besides sound is returned as it is.

        Balls that turn like gears are an example. Near Gamma the columns of the single rotations
        would cancel each other, and lose digits.
        """
        turn, free_columns = self._find_free_motions()
        if not free_columns.size:
            return self
        odd = self.deforming.odd @ turn
        even = self.deforming.even @ turn
        # at q = 0 (`even`) the two ends of a contact cancel, up to rounding. `odd` is rounding too
        # if a motion deforms nothing at any q, such as the spin of a ball between two others. Gears
        # whose arms differ a little leave more than rounding, which is kept
        lengths = _find_lengths(self.deforming)
        odd[..., free_columns] = _clear_rounding(odd[..., free_columns], lengths)
        even[..., free_columns] = _clear_rounding(even[..., free_columns], lengths)
        # `bent` keeps its numbers: a displacement of all balls has a column of zeros at q = 0, and
        # `turn` leaves such motions as they are
        tilt = np.einsum("mn,kma->kna", turn.conj(), self.tilt) if self.bent else self.tilt
        return replace(
            self,
            deforming=self.deforming._replace(odd=odd, even=even),
            pushing=None if self.pushing is None else _turn_pushing(self.pushing, turn),
            tilt=tilt,
            turn=turn,
        )

    def _find_free_motions(self) -> tuple[NDArray[Any], NDArray[np.intp]]:
        """Return a unitary matrix (n, n), whose columns are new motions as combinations of the
        motions of the rows, and the numbers (k,) of the new motions that deform nothing at q = 0.

        A motion whose own column is zero at q = 0, such as sound, stays as it is, and is not among
        the k.
        """
        odd = self.deforming.odd.reshape(self.n_rows, self.size)
        even = self.deforming.even.reshape(self.n_rows, self.size)
        turn = np.eye(self.size, dtype=even.dtype)
        columns = np.flatnonzero(np.any(even != 0.0, axis=0))
        if columns.size < 2:  # a single column that is not zero depends on no other
            return turn, np.zeros(0, np.intp)
        sizes = np.abs(odd) + np.abs(even)
        free_motions, complement = find_dependent(even[:, columns], sizes[:, columns])
        turn[np.ix_(columns, columns)] = np.concatenate([free_motions, complement], axis=1)
        return turn, columns[: free_motions.shape[1]]

    @property
    def size(self) -> int:
        """Number of motions."""
        return len(self.columns)

    @property
    def n_rows(self) -> int:
        """Number of rows of C(q)."""
        return len(self.deforming.odd) * len(self.deforming.half)

    @property
    def _wave_rows(self) -> tuple[WaveRows, ...]:
        """The rows of C(q), followed by those on which static forces act, if there are any."""
        return (self.deforming,) if self.pushing is None else (self.deforming, self.pushing)

    @cached_property
    def rank(self) -> int:
        """Generic rank of C(q), together with the rows on which static forces act: the number of
        branches that do not vanish at every wave vector.
        """
        highest_rank = 0
        periods = self.deforming.half.shape[1]
        # the rank is lower at special wave vectors, and never higher than the generic one
        for q in GENERIC_WAVEVECTORS[:, None, :periods]:
            rows = np.concatenate([waves.compute_rows(q)[0] for waves in self._wave_rows])
            highest_rank = max(highest_rank, find_rank(rows))
            if highest_rank == min(rows.shape):  # no wave vector can give a higher rank
                break
        return highest_rank

    @property
    def n_free(self) -> int:
        """Number of branches that vanish at every wave vector."""
        return self.size - self.rank

    @property
    def keeps_digits(self) -> bool:
        """Whether C(q) keeps the digits of the flexural branch in terms of tilted motions.

        Two conditions must hold. There are at least as many rows as motions: with fewer rows some
        branches vanish everywhere, and tilted motions do not help. And a tilted motion deforms no
        contact to first order in q. A tilted motion does deform a contact whose normal is not along
        the line between the two balls.
        """
        if not self.bent or self.n_rows < self.size:
            return False
        bend_part, _, half = self._tilted_factors
        even = self.deforming.even.reshape(self.n_rows, self.size)
        # gradients (m, n_bent, p), with respect to q at q = 0, of deformations by tilted motions
        by_displacement = bend_part[:, :, None] * half[:, None]
        by_rotation = np.einsum("mn,kna->mka", even, self.tilt)
        largest_gradient = np.max(np.abs(by_displacement + by_rotation))
        return bool(largest_gradient <= _RIGIDITY_ERROR * np.max(np.abs(bend_part)))

    def solve(self, q: Array) -> tuple[Array, NDArray[Any]]:
        """Return frequencies (n_q, n), (k/M)^1/2, ascending, and eigenvectors (n_q, n, n), as
        columns, at wave vectors q (n_q, p), 1/d.

        Raises :class:`~granphon.base.errors.InstabilityError` as :func:`factorise` does, if static
        forces make a squared frequency negative.
        """
        point = self._compute(q)
        frequencies, modes = self._decompose(point)
        return frequencies, self._turn_back(point, modes)

    def _turn_back(self, point: _Point, modes: NDArray[Any]) -> NDArray[Any]:
        """Return the amplitudes (n_q, n, n) of the motions of the frame in ``modes`` (n_q, n, n),
        columns that are given in the basis of the ``point``.
        """
        in_motions = modes if point.basis is None else point.basis @ modes
        return in_motions if self.turn is None else self.turn @ in_motions

    def solve_with_velocities(self, q: Array, along: Array) -> tuple[Array, NDArray[Any], Array]:
        """Return frequencies (n_q, n), (k/M)^1/2, ascending, eigenvectors (n_q, n, n), as columns,
        and group velocities (n_q, n, p), d (k/M)^1/2, at wave vectors q (n_q, p), 1/d.

        Modes of one frequency are those that a path along the unit vectors ``along`` (n_q, p)
        follows. Raises what :meth:`solve` raises.
        """
        point = self._compute(q)
        frequencies, modes = self._decompose(point)
        slopes = _Slopes(self, point, frequencies)
        # (n_q, n - 1) whether a branch has the frequency of the next
        is_joined = frequencies[:, 1:] - frequencies[:, :-1] <= DEGENERACY * frequencies[:, 1:]
        if np.any(is_joined):
            if np.any(frequencies[:, 0] == 0.0):
                # nothing tells branches that vanish everywhere from each other
                is_joined[:, : self.n_free] = False
            self._split_degenerate(point, modes, slopes, is_joined, along)
        # d(omega^2)/dq over 2 omega; a branch that vanishes everywhere does not travel
        twice_omega = np.where(frequencies > 0.0, 2.0 * frequencies, np.inf)
        velocities = slopes.compute_gradients(modes) / twice_omega[..., None]
        if not frequencies.all():
            n_zeros = np.count_nonzero(frequencies == 0.0, axis=1)
            for number in np.flatnonzero(n_zeros > self.n_free).tolist():
                # modes and velocities of one wave vector are views, which `_leave_zero` changes
                self._leave_zero(
                    point,
                    number,
                    frequencies[number],
                    modes[number],
                    velocities[number],
                    along[number],
                )
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
        """Turn the modes of zero frequency at one wave vector, in place, into those that a path
        along a unit vector ``along`` (p,) follows as it leaves the wave vector; write the limits of
        their group velocities along the path into ``velocities`` (n, p).

        ``number`` is that of the wave vector among those of the ``point``. ``modes`` (n, n) holds
        all n modes there, as columns in the basis of the point, with their ``frequencies`` (n,).

        Beside the wave vector the frequencies that are zero there rise linearly, as those of sound
        do beside Gamma: see :meth:`_find_cones`.
        """
        count = int(np.count_nonzero(frequencies == 0.0))
        motions = modes if point.basis is None else point.basis[number] @ modes
        q = point.q[number : number + 1]
        rows = np.concatenate([waves.compute_rows(q)[0] for waves in self._wave_rows])
        # the derivative of a row is by its half angle, whose gradient with respect to q is the half
        # vector
        slope = np.concatenate(
            [waves.compute_rows(q, wants_derivative=True)[0] for waves in self._wave_rows]
        )
        half = np.concatenate([waves.repeat_half_vectors() for waves in self._wave_rows])
        stiff_deformations = rows @ motions[:, count:] / frequencies[count:]
        changes = half.T[:, :, None] * (slope @ motions[:, :count])  # (p, rows, count)
        if self.signs is None:
            speeds, turn, forms = self._find_cones(stiff_deformations, changes, along)
        else:
            speeds, turn, forms = self._find_pressed_cones(stiff_deformations, changes, along)
        speeds = np.where(speeds <= self._rounding * self._longest_column, 0.0, speeds)
        _align_equal(turn, speeds)
        modes[:, :count] = modes[:, :count] @ turn
        # of each mode v, a column of `turn`: the gradient of omega after a step s is that of
        # omega^2, 2 s v^H F v, over 2 omega = 2 s c. A mode without speed c does not travel
        gradients = np.einsum("yz,ayx,xz->za", turn.conj(), forms, turn).real
        inverse = np.divide(1.0, speeds, out=np.zeros_like(speeds), where=speeds > 0.0)
        velocities[:count] = gradients * inverse[:, None] + 0.0  # no minus zero

    def _find_cones(
        self, stiff_deformations: NDArray[Any], changes: NDArray[Any], along: Array
    ) -> tuple[Array, NDArray[Any], NDArray[Any]]:
        """Return speeds (m,), ascending, of the m modes whose frequencies rise from zero along a
        unit vector ``along`` (p,); the modes (m, m), as columns in terms of the m modes of zero
        frequency in which ``changes`` are given; and forms (p, m, m).

        After a step s along the unit vector t, the modes v (m,) of zero frequency deform contacts
        by s G v, with G = sum_a t_a G_a; the matrices G_a (rows, m) are the derivatives of their
        deformations with respect to the component q_a, and make up ``changes`` (p, rows, m). Modes
        of higher frequencies follow along, and compensate the part of G v in the span of their own
        deformations, the columns of ``stiff_deformations`` (rows, k). What remains is s P G v,
        where P projects on the vectors perpendicular to this span.

        So omega = s c, where the speeds c are the singular values of P G, and the modes v its right
        singular vectors. Its square has the gradient 2 s Re(v^H F_a v) with respect to q_a, with
        the forms F_a = (P G_a)^H P G.
        """
        n_modes = changes.shape[2]
        changes_along = np.tensordot(along, changes, 1)
        basis = np.linalg.qr(stiff_deformations)[0]
        resisted_changes = changes - basis @ (basis.conj().T @ changes)
        resisted_along = changes_along - basis @ (basis.conj().T @ changes_along)
        forms = resisted_changes.conj().swapaxes(1, 2) @ resisted_along
        # rows of zeros are added so that there are m singular values even if there are fewer rows
        n_lacking = max(0, n_modes - len(resisted_along))
        padded_along = np.pad(resisted_along, ((0, n_lacking), (0, 0)))
        _, speeds, turn = np.linalg.svd(padded_along, full_matrices=False)
        return speeds[::-1], turn[::-1].conj().T, forms

    def _find_pressed_cones(
        self, stiff_deformations: NDArray[Any], changes: NDArray[Any], along: Array
    ) -> tuple[Array, NDArray[Any], NDArray[Any]]:
        """Return speeds (m,), modes (m, m) and forms (p, m, m) as :meth:`_find_cones` does, with
        the same arguments, under static forces.

        The rows of ``stiff_deformations`` and ``changes`` are then those of C(q), followed by those
        on which static forces act, and omega^2 is the sum of their squares times the weights W: 1
        for the former, minus :attr:`signs` for the latter. The columns of ``stiff_deformations``,
        E, are those of modes of higher frequencies, each over its frequency, so that E^H W E = 1.
        As these modes follow along, F_a = G_a^H W G - (E^H W G_a)^H E^H W G. The squares of the
        speeds are the eigenvalues of sum_a t_a F_a; negative ones are taken for zero.
        """
        weight = np.concatenate([np.ones((self.n_rows, 1)), -np.asarray(self.signs)])
        changes_along = np.tensordot(along, changes, 1)
        pull = stiff_deformations.conj().T @ (weight * changes)
        pull_along = stiff_deformations.conj().T @ (weight * changes_along)
        whole_forms = changes.conj().swapaxes(1, 2) @ (weight * changes_along)
        forms = whole_forms - pull.conj().swapaxes(1, 2) @ pull_along
        squares, turn = np.linalg.eigh(np.tensordot(along, forms, 1))
        return np.sqrt(np.maximum(squares, 0.0)), turn, forms

    def _split_degenerate(
        self,
        point: _Point,
        modes: NDArray[Any],
        slopes: _Slopes,
        is_joined: NDArray[np.bool_],
        along: Array,
    ) -> None:
        """Turn the vectors of each degenerate set, columns of ``modes`` (n_q, n, n), in place, into
        those of the branches along the directions ``along`` (n_q, p).

        Branches are told apart by the slopes of omega^2 along the direction, and those of equal
        slope by the modes a small step further.

        ``is_joined`` (n_q, n - 1) says whether a branch has the frequency of the next one.
        ``point`` is C at the wave vectors, and ``slopes`` finds the slopes of omega^2 there.
        """
        equal_slopes: list[tuple[NDArray[np.intp], slice]] = []
        for points, branches in _find_runs(is_joined):
            vectors = modes[points, :, branches]
            matrices = slopes.compute_along(points, vectors, branches.start, along[points])
            slope, turn = np.linalg.eigh(matrices)
            modes[points, :, branches] = vectors @ turn
            # runs of branches within this set that have one slope, each with the numbers of the
            # points, among `points`, at which they do
            for numbers, run in _find_runs(np.diff(slope, axis=1) <= _EQUAL_SLOPES):
                equal_branches = slice(branches.start + run.start, branches.start + run.stop)
                equal_slopes.append((points[numbers], equal_branches))
        if equal_slopes:
            self._split_equal_slopes(point, modes, equal_slopes, along)

    def _split_equal_slopes(
        self,
        point: _Point,
        modes: NDArray[Any],
        equal_slopes: list[tuple[NDArray[np.intp], slice]],
        along: Array,
    ) -> None:
        """Turn the vectors of branches of equal slope, columns of ``modes`` (n_q, n, n), in place,
        into combinations that are nearest to the modes one step further along ``along`` (n_q, p).

        ``equal_slopes`` are pairs: the numbers (k,) of wave vectors among those of the ``point``,
        and a slice of branches that have one frequency and one slope there.

        Such branches separate at second order in the step only. The length of the step,
        :data:`_STEP_BESIDE`, limits the accuracy of their vectors, and not the error of LAPACK.
        Branches that still have one frequency after the step have no vectors of their own, and
        theirs are left as they are.
        """
        solved_points = np.unique(np.concatenate([points for points, _ in equal_slopes]))
        q_beside = point.q[solved_points] + _STEP_BESIDE * along[solved_points]
        rows_beside = self.deforming.compute_rows(q_beside)
        across = None if self.pushing is None else self.pushing.compute_rows(q_beside)
        matrices = self._make_matrix(rows_beside, across)
        squares = np.linalg.eigvalsh(matrices)
        for points, branches in equal_slopes:
            numbers = np.searchsorted(solved_points, points)  # among the solved points
            highest_square = squares[numbers, branches.stop - 1]
            lowest_square = squares[numbers, branches.start]
            is_split = highest_square - lowest_square > DEGENERACY * highest_square
            if not np.any(is_split):
                continue
            split_points = points[is_split]
            split_numbers = numbers[is_split]
            amplitudes = modes[split_points, :, branches]
            vectors = amplitudes
            if point.basis is not None:
                vectors = point.basis[split_points] @ amplitudes
            rows = rows_beside[split_numbers]
            if self.pushing is not None:
                rows = factorise(matrices[split_numbers], self.slack)
            modes_beside = lapack_svd(rows)[1][:, :, branches]
            # u vh is the unitary matrix that takes the vectors nearest to the modes beside
            u, _, vh = np.linalg.svd(vectors.conj().swapaxes(1, 2) @ modes_beside)
            modes[split_points, :, branches] = amplitudes @ (u @ vh)

    def _make_matrix(self, rows: NDArray[Any], across: NDArray[Any] | None) -> NDArray[Any]:
        """Return D(q) (n_q, n, n) from ``rows`` (n_q, m, n) of C(q) and, under prestress, from the
        rows ``across`` (n_q, m', n) on which static forces act.
        """
        matrices = rows.conj().swapaxes(1, 2) @ rows
        if across is not None:
            matrices = matrices - across.conj().swapaxes(1, 2) @ (self.signs * across)
        return np.asarray(matrices)

    # -- C(q) --------------------------------------------------------------------------------------

    def _compute(self, q: Array) -> _Point:
        """Return C at wave vectors q (n_q, p), 1/d: in a basis of tilted motions if the block has
        displacements that tilt the balls and no static forces, else in the motions of the block.
        """
        rows = self.deforming.compute_rows(q)
        if self.pushing is not None:
            return _Point(q, rows, self.pushing.compute_rows(q))
        if not self.bent:
            return _Point(q, rows)
        # tilted motions: first the bent displacements, each with its rotation, then all others
        count = len(self.bent)
        unit_motions = np.eye(self.size)[:, self._order]
        motions = unit_motions + np.zeros((len(q), 1, 1), self.tilt.dtype)  # (n_q, n, n)
        # the motions n that go with each bent displacement k at each q, summed over its components
        motions[:, :, :count] += np.einsum("kna,qa->qnk", self.tilt, q)
        basis, triangle = np.linalg.qr(motions)
        # a rigid rotation of two balls about the middle of their centres deforms no contact, so
        # sine and cosine do not cancel each other in the columns of tilted motions
        bend_part, turn_part, half = self._tilted_factors
        angle = q @ half.T
        by_bending = bend(angle)[..., None] * bend_part
        by_turning = np.sin(angle)[..., None] * np.einsum("mka,qa->qmk", turn_part, q)
        # the triangle turns the columns of the tilted motions into those of the first vectors of
        # the basis
        columns = (by_bending + by_turning) @ np.linalg.inv(triangle[:, :count, :count])
        rows_in_basis = np.concatenate([columns, rows @ basis[:, :, count:]], axis=2)
        return _Point(q, rows_in_basis, basis=basis, triangle=triangle)

    @cached_property
    def _order(self) -> list[int]:
        """Numbers (n,) of the motions in the block, those that tilt the balls first."""
        return [*self.bent, *(motion for motion in range(self.size) if motion not in self.bent)]

    @cached_property
    def _tilted_factors(self) -> tuple[NDArray[Any], NDArray[Any], Array]:
        """What the columns of the tilted motions in C(q) are made of, at half angles h = q.half.

        A column is bend_part (sin h - h cos h) + (turn_part.q) sin h, where ``bend_part``
        (m, n_bent) and ``turn_part`` (m, n_bent, p) are the first two of the arrays. The third is
        ``half``, the half vectors (m, p) of the rows.
        """
        odd = self.deforming.odd.reshape(self.n_rows, self.size)
        return (
            odd[:, self.bent],
            np.einsum("mn,kna->mka", odd, self.tilt),  # the sum over the motions n
            self.deforming.repeat_half_vectors(),
        )

    # -- frequencies -------------------------------------------------------------------------------

    def _decompose(self, point: _Point) -> tuple[Array, NDArray[Any]]:
        """Return frequencies (n_q, n), ascending, and eigenvectors (n_q, n, n), as columns, in the
        basis of the ``point``. Frequencies that are rounding of zero are zero.
        """
        matrices = None if point.across is None else self._make_matrix(point.rows, point.across)
        if matrices is not None:
            self._drop_rounding(point.q, matrices)
        if self.n_free and self.size > _MOST_UNSPLIT:
            frequencies, modes = self._split_free(point.rows, matrices)
        else:
            frequencies, modes = self._decompose_all(point.rows, matrices)
        may_be_rounding = frequencies <= self._rounding * self._longest_column
        points = np.flatnonzero(np.any(may_be_rounding & (frequencies > 0.0), axis=1))
        if points.size:
            frequencies[points], modes[points] = self._drop_small(
                point.q[points], frequencies[points], modes[points]
            )
        return frequencies, modes

    def _decompose_all(
        self, rows: NDArray[Any], matrices: NDArray[Any] | None
    ) -> tuple[Array, NDArray[Any]]:
        """Return frequencies (n_q, n) and eigenvectors (n_q, n, n), as columns, from the ``rows``
        (n_q, m, n) of C, or under prestress from the ``matrices`` D (n_q, n, n).
        """
        if matrices is None:
            return graded_svd(rows)
        return graded_eigh(matrices, partial(factorise, slack=self.slack))

    def _split_free(
        self, rows: NDArray[Any], matrices: NDArray[Any] | None
    ) -> tuple[Array, NDArray[Any]]:
        """Return frequencies (n_q, n), ascending, and eigenvectors (n_q, n, n), as columns. LAPACK
        finds the :attr:`n_free` modes that cost nothing, which have the frequency zero, and
        :meth:`_decompose_all`, with the same arguments, finds the others.

        The plane rotations by which that method finds all modes would take minutes to tell the
        free modes of a large block from the softest others.
        """
        if matrices is None:
            basis = lapack_svd(rows)[1]
            stiff_basis = basis[:, :, self.n_free :]
            frequencies, modes = self._decompose_all(rows @ stiff_basis, None)
        else:
            squares, vectors = np.linalg.eigh(matrices)
            # a negative square, of a lattice that buckles, is not among the smallest
            order = np.argsort(np.abs(squares), axis=1)
            basis = np.take_along_axis(vectors, order[:, None], 2)
            stiff_basis = basis[:, :, self.n_free :]
            stiff_matrices = stiff_basis.conj().swapaxes(1, 2) @ matrices @ stiff_basis
            frequencies, modes = self._decompose_all(rows, stiff_matrices)
        all_vectors = np.concatenate([basis[:, :, : self.n_free], stiff_basis @ modes], axis=2)
        return np.pad(frequencies, ((0, 0), (self.n_free, 0))), all_vectors

    def _drop_small(
        self, q: Array, frequencies: Array, modes: NDArray[Any]
    ) -> tuple[Array, NDArray[Any]]:
        """Return ``frequencies`` (n_q, n), ascending, with those of rounding alone set to zero, and
        ``modes`` (n_q, n, n), columns in the basis of the point, in the same order.

        A frequency is set to zero if it is no larger than the rounding of the entries of C(q) in
        its own mode, or if its branch vanishes everywhere. The wave vectors are q (n_q, p).
        """
        squares = self._measure_columns(q)
        if self.bent:
            bend_part, turn_part, half = self._tilted_factors
            angle = np.abs(q @ half.T)[..., None]
            turns = np.abs(np.einsum("mka,qa->qmk", turn_part, q))  # |turn_part.q| of each row m
            # bounds of |sin h - h cos h|, which is of third order in h, and of |sin h|
            tilted_sizes = np.minimum(angle, angle**3) * np.abs(bend_part) + angle * turns
            tilted_squares = np.sum(tilted_sizes**2, axis=1)
            plain_squares = squares[:, self._order[len(self.bent) :]]
            squares = np.concatenate([tilted_squares, plain_squares], axis=1)
        # of each mode b, the sum over the columns n
        lengths = np.sqrt(np.einsum("qn,qnb->qb", squares, np.abs(modes) ** 2))
        rounding = self._rounding * lengths
        frequencies = np.where(frequencies <= rounding, 0.0, frequencies)
        frequencies[:, : self.n_free] = 0.0
        if np.any(frequencies[:, 1:] < frequencies[:, :-1]):
            order = np.argsort(frequencies, axis=1, kind="stable")
            frequencies = np.take_along_axis(frequencies, order, 1)
            modes = np.take_along_axis(modes, order[:, None], 2)
        return frequencies, modes

    def _drop_rounding(self, q: Array, matrices: NDArray[Any]) -> None:
        """Set diagonal entries of the ``matrices`` D(q) (n_q, n, n) to zero, in place, where they
        are rounding errors of zero, which may be negative.
        """
        diagonal = np.einsum("qii->qi", matrices)  # a view: what is set in it is set in D
        squares = self._measure_columns(q)
        is_doubtful = (diagonal != 0.0) & (np.abs(diagonal) <= _ROUNDING * squares)
        points, columns = np.nonzero(is_doubtful)
        # without buckling |D_ij|^2 <= D_ii D_jj. Larger entries in the row of a doubtful D_ii say
        # that the lattice buckles, and D_ii is kept
        bounds = _ROUNDING * squares[points, columns][:, None] * squares[points]
        is_zero = np.all(np.abs(matrices[points, columns]) ** 2 <= bounds, axis=1)
        diagonal[points[is_zero], columns[is_zero]] = 0.0

    def _measure_columns(self, q: Array) -> Array:
        """Return the squares (n_q, n) of the lengths that the columns of C(q), and of the rows on
        which static forces act, would have if no terms cancelled. Rounding errors are in proportion
        to these lengths.
        """
        squares: Any = 0.0
        for waves in self._wave_rows:
            odd = np.abs(waves.odd)
            even = np.abs(waves.even)
            # `even` is the difference of the two ends of a contact. Unless it is exactly zero it
            # has the rounding of both ends, whose size `odd` tells
            even = np.where(even > 0.0, even + odd, 0.0)
            half_angle = np.abs(q @ waves.half.T)
            size = half_angle[:, None, :, None] * odd + even  # (n_q, kinds, n_c, n)
            squares = squares + np.sum(size**2, axis=(1, 2))
        return np.asarray(squares)

    @property
    def _rounding(self) -> float:
        """Rounding error of a frequency, over the length of its column: under prestress the root of
        that of a square, as D is rounded then, and not C.
        """
        return _ROUNDING if self.pushing is None else float(np.sqrt(_ROUNDING))

    @cached_property
    def _longest_column(self) -> float:
        """An upper bound of the lengths that :meth:`_measure_columns` finds, at half angles up to
        3 rad.
        """
        return 4.0 * float(
            sum(
                np.linalg.norm(rows)
                for waves in self._wave_rows
                for rows in (waves.odd, waves.even)
            )
        )


class _Slopes:
    """Derivatives of omega^2 with respect to q at the wave vectors of a ``point``, where a block
    has the ``frequencies`` (n_q, n).

    With D = C^H C they are <v_b| dD/dq |v_c> = <C v_b| dC/dq v_c> + <dC/dq v_b| C v_c>, a form
    that keeps its digits near Gamma too.
    """

    def __init__(self, block: Block, point: _Point, frequencies: Array) -> None:
        """Compute the derivatives of the rows at the wave vectors of the ``point``."""
        self.block = block
        self.point = point
        self.frequencies = frequencies
        #: for the rows of C(q), and for those on which static forces act: the rows (n_q, m, n),
        #: their derivatives with respect to the half angle, and the half vectors (m, p), multiplied
        #: by the sign with which the squares of the rows enter omega^2
        self.row_sets = [
            (
                point.rows,
                block.deforming.compute_rows(point.q, wants_derivative=True),
                block.deforming.repeat_half_vectors(),
            )
        ]
        if block.pushing is not None and point.across is not None:
            half = -np.asarray(block.signs) * block.pushing.repeat_half_vectors()
            slopes = block.pushing.compute_rows(point.q, wants_derivative=True)
            self.row_sets.append((point.across, slopes, half))
        if point.basis is not None:
            bend_part, turn_part, half = block._tilted_factors
            angle = (point.q @ half.T)[..., None]
            # derivative with respect to the half angle h, and that by q in (turn_part.q)
            by_angle = angle * np.sin(angle) * bend_part
            by_angle = by_angle + np.cos(angle) * np.einsum("mka,qa->qmk", turn_part, point.q)
            by_rotation = np.sin(angle)[:, None] * np.moveaxis(turn_part, 2, 0)
            #: gradients (n_q, p, m, n_bent), with respect to q, of the tilted columns of C(q)
            self.tilted = half.T[:, :, None] * by_angle[:, None] + by_rotation

    def compute_along(
        self, points: NDArray[np.intp], vectors: NDArray[Any], branch: int, along: Array
    ) -> NDArray[Any]:
        """Return the matrices (k, n_v, n_v) of <v| dD/dq.along |w> between degenerate vectors v and
        w, the columns of ``vectors`` (k, n, n_v), along unit vectors ``along`` (k, p), at k of the
        wave vectors, whose numbers are ``points`` (k,). The eigenvalues of these matrices are the
        slopes of omega^2.

        ``branch`` is the number of a branch whose frequency all ``vectors`` have at each wave
        vector.
        """
        if self.point.basis is not None:
            frequencies = self.frequencies[points, branch]
            deformations, changes = self._deform_tilted(points, vectors, frequencies)
            # at each wave vector q, sums over the deformations x and the components a of `along`
            products = np.einsum("qxb,qaxc,qa->qbc", deformations.conj(), changes, along)
        else:
            products = np.zeros((len(points), vectors.shape[2], vectors.shape[2]))
            for rows, slope, half in self.row_sets:
                if len(points) < len(rows):  # if they are all wave vectors, nothing is copied
                    rows = rows[points]
                    slope = slope[points]
                deformations = (rows @ vectors).conj().swapaxes(1, 2)
                weighted_deformations = deformations * (along @ half.T)[:, None]
                products = products + weighted_deformations @ (slope @ vectors)
        return np.asarray(products + products.conj().swapaxes(-1, -2))

    def compute_gradients(self, vectors: NDArray[Any]) -> Array:
        """Return the gradients (n_q, n, p) of omega^2 of each of the ``vectors`` (n_q, n, n)."""
        # omega^2 is the square of the deformations: its gradient is twice the real part of their
        # product with their own gradients
        if self.point.basis is not None:
            frequencies = self.frequencies[:, None, :]
            deformations, changes = self._deform_tilted(slice(None), vectors, frequencies)
            # of each mode b and component a of q, the sum over the deformations x
            return np.asarray(2.0 * np.einsum("qxb,qaxb->qba", deformations.conj(), changes).real)
        total: Any = 0.0
        for rows, slope, half in self.row_sets:
            products = ((rows @ vectors).conj() * (slope @ vectors)).real
            total = total + 2.0 * half.T @ products
        return np.asarray(total.swapaxes(1, 2))

    def _deform_tilted(
        self, points: Any, vectors: NDArray[Any], frequencies: Array
    ) -> tuple[NDArray[Any], NDArray[Any]]:
        """Return two arrays, (k, m + n, n_v) and (k, p, m + n, n_v), from which the gradients of
        omega^2 of n_v vectors v follow: they are twice the real part of the products of the first
        array, conjugated, with the second, summed over m + n.

        The tilted motions T depend on q. The eigenvalues omega^2 are those of (C T)^H C T in the
        metric T^H T, so that their gradients are 2 Re (<C T v| d(C T) v> - omega^2 <T v| dT v>).
        The arrays hold C T v and d(C T) v in their first m rows, and T v and -omega^2 dT v in the
        last n.

        ``points`` select k of the wave vectors. ``vectors`` (k, n, n_v) are in the basis of the
        point, and ``frequencies``, (k,) or (k, 1, n_v), are those of the vectors.
        """
        block = self.block
        point = self.point
        count = len(block.bent)
        # v: amplitudes of the tilted motions, and then of the others
        amplitudes = np.linalg.solve(point.triangle[points], vectors)  # type: ignore[index]
        rows, slope, half = self.row_sets[0]
        other_motions = np.zeros_like(amplitudes)
        other_motions[:, block._order[count:]] = amplitudes[:, count:]
        # d(C T) v, by the tilted motions and by all others
        by_others = half.T[:, :, None] * (slope[points] @ other_motions)[:, None]
        by_tilted = self.tilted[points] @ amplitudes[:, None, :count]
        # dT v: gradients of the motions n that go with the amplitudes of bent displacements k
        tilt_changes = np.einsum("kna,qkb->qanb", block.tilt, amplitudes[:, :count])
        motions = point.basis[points] @ vectors  # type: ignore[index]
        squares = frequencies.reshape(len(frequencies), 1, 1, -1) ** 2
        deformations = np.concatenate([rows[points] @ vectors, motions], axis=1)
        changes = np.concatenate([by_others + by_tilted, -squares * tilt_changes], axis=2)
        return deformations, changes


def factorise(matrices: NDArray[Any], slack: float = 0.0) -> NDArray[Any]:
    """Return F (n_q, n, n) with F^H F = D for the ``matrices`` D (n_q, n, n). F are the factors of
    :func:`cholesky_factor`; if it refuses some D, the rows of all F are omega v^H of the modes v.

    Raises :class:`~granphon.base.errors.InstabilityError` if a squared frequency is negative, by
    more than ``slack`` times the largest of the same matrix. Other negative squares are taken for
    zero.
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
    """Return the sets of columns that no row joins to columns of other sets, each as ascending
    numbers, where ``effects`` (rows, n) says whether a row has an entry in a column. A column
    without entries is a set of its own.
    """
    n_columns = effects.shape[1]
    if n_columns and effects.all(axis=1).any():  # a single row joins all columns
        return [np.arange(n_columns)]
    is_unassigned = np.ones(n_columns, bool)
    blocks = []
    while np.any(is_unassigned):
        # a block begins with the first unassigned column, and grows by the columns that its rows
        # join to it
        is_in_block = np.arange(n_columns) == np.argmax(is_unassigned)
        size = 0
        while size < int(np.count_nonzero(is_in_block)):
            size = int(np.count_nonzero(is_in_block))
            rows_of_block = np.any(effects[:, is_in_block], axis=1)
            is_in_block = is_in_block | np.any(effects[rows_of_block], axis=0)
        is_unassigned &= ~is_in_block
        blocks.append(np.flatnonzero(is_in_block))
    return blocks


def _align_equal(turn: NDArray[Any], speeds: Array) -> None:
    """Mix the columns of a unitary ``turn`` (m, m) that have equal ``speeds`` (m,), ascending, in
    place, so that they are as near as possible to the same columns of the unit matrix.

    Modes of one speed may be mixed at will, and so stay as near as possible to what they were.
    """
    is_equal = np.diff(speeds) <= DEGENERACY * speeds[1:]
    for _, run in _find_runs(is_equal[None]):
        # u vh is the unitary matrix nearest to the block of the run
        u, _, vh = np.linalg.svd(turn[run, run])
        turn[:, run] = turn[:, run] @ (u @ vh).conj().T


def _find_runs(is_joined: NDArray[np.bool_]) -> list[tuple[NDArray[np.intp], slice]]:
    """Return the runs of two or more neighbouring items that belong together in n rows of m items:
    pairs of the numbers (k,) of all rows that have a run, and the run as a slice of items.

    ``is_joined`` (n, m - 1) says whether item j + 1 of a row belongs with item j.
    """
    count, width = is_joined.shape
    padded_joins = np.zeros((count, width + 2), np.int8)
    padded_joins[:, 1:-1] = is_joined
    # 1 where a run begins, and -1 at its last item
    edges = padded_joins[:, 1:] - padded_joins[:, :-1]
    rows, start = np.nonzero(edges == 1)
    stop = np.nonzero(edges == -1)[1] + 1
    if not rows.size:
        return []
    # start * base + stop is one number for both ends of a run, so that equal runs are found at once
    base = width + 2
    codes, run_of_row = np.unique(start * base + stop, return_inverse=True)
    runs = [slice(*divmod(int(code), base)) for code in codes]
    return [(rows[run_of_row == k], run) for k, run in enumerate(runs)]
