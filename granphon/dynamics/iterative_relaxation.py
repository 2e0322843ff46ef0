"""The inner motions of cells of some ten thousand balls and more, relaxed by iteration: factors of
such cells in space would not fit into memory.

Conjugate gradients find the motions for all strains at once. All strains share each product with
the sparse matrix, and every strain has a step length of its own. The preconditioner is the inverse
of the stiffness of each ball with its neighbours at rest.

Motions that cost nothing take no part in the iteration, as no strain pushes them. But such motions
are part of the answer: what is loose stays behind in sound, and a mechanism has no sound. They are
found in two ways. Motions of a single ball, such as the rotation about the line through two
contacts, and those of a small cluster that no contact joins to other balls, are the null vectors of
small dense matrices. All others are found by random motions: what deforms contacts as a random
motion does differs from it by a motion that costs nothing. Random motions, more than there are
loose ones, leave a basis of all loose motions.

The energy of a strain is the minimum over the inner motions. So the error of the energy is of
second order in that of the motions, and never negative.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from copy import copy
from functools import cached_property
from typing import Any, Self

import numpy as np
from numpy.typing import ArrayLike

from granphon.base.arrays import Array, Index
from granphon.base.errors import ConvergenceError, InputError, InstabilityError
from granphon.base.progress import Progress, silent
from granphon.dynamics.compatibility import Compatibility
from granphon.dynamics.linalg import NO_ENERGY
from granphon.dynamics.two_levels import invert_blocks

#: size of the residual, over that at the start, at which the iteration ends: nine digits are needed
#: to tell waves of motions that cost nothing from sound
_REDUCTION = 1e-11
#: size of the residual, over that of a motion whose deformations are taken off, at which it is only
#: rounding: what costs nothing has no other residual
_ROUNDING = 1e-13
#: largest number of iterations; random packings of 1e5 balls take some hundred
_MOST_ITERATIONS = 20_000
#: random motions in which loose ones are looked for first. One would hide a loose motion once in
#: a hundred times
PROBES = 2
#: random motions, at a time, by which further loose ones are looked for
_MORE_PROBES = 12
#: random motions beyond the loose ones that they leave, from which on none is left to be found
_SPARE_PROBES = 2
#: size of what is left of random motions from which on a motion is loose: a standard normal number
#: is above it 99 times in 100, and the iteration leaves less than a thousandth of it
_LEAST_REMAINDER = 1e-2
#: part that a second iteration leaves, at least, of a motion that costs nothing at all; of a motion
#: that costs a little it leaves less
_LEAST_PART = 0.5
#: largest number of loose motions of several balls that are found: as many solutions, in all, take
#: some seven times as long as the moduli
_MOST_LOOSE = 60
#: largest number of balls of a cluster whose motions are those of a dense matrix
_MOST_IN_CLUSTER = 20
#: largest error of the vectors of the contacts of a cluster, as differences of positions of balls,
#: over the longest vector, up to which the cluster does not go on from cell to cell
_CLOSURE_ERROR = 1e-6


class IterativeRelaxation:
    """Inner motions of the balls of the cell of a ``lattice``, which relax as the cell is strained,
    by conjugate gradients; in reduced units. Its methods are those of
    :class:`~granphon.dynamics.sparse_relaxation.SparseRelaxation`.

    ``difference`` (n_rows, n_branches), sparse by rows, takes the mass-weighted motions of all
    balls to the deformations of contacts. The attribute ``staying`` (n_branches, k) holds
    orthonormal motions that do not relax (:meth:`keep_back`); there are none at first.

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
        self.lattice = lattice
        self.rows = difference
        self._columns = difference.T.tocsr()
        self._progress = progress
        self.staying = np.zeros((lattice.n_branches, 0))
        #: length of the longest column, the deformations by one motion of one ball
        self.highest = math.sqrt(float(np.max(difference.power(2).sum(axis=0), initial=0.0)))
        matrix = (self._columns @ difference).tocsr()
        self._ball_inverses, ball_motions = invert_blocks(matrix, lattice.motions.count)
        #: (n_branches, k), sparse: what single balls and small clusters can do alone at no cost
        self.local_motions = _join_clusters(lattice, matrix, ball_motions)
        self._search = _LooseSearch(self)

    def keep_back(self, staying: Array) -> Self:
        """Return the same relaxation, but for orthonormal motions ``staying`` (n_branches, k),
        which do not relax although they deform contacts; they take the place of those that have
        stayed behind so far. Combinations of these motions that deform no contact are left out, as
        no strain pushes them. The free motions and the loose ones remain those of this relaxation.
        """
        # a shallow copy: both share one search for loose motions, which knows nothing of `staying`
        relaxation = copy(self)
        relaxation.staying = staying
        if staying.size:
            _, sizes, combinations = np.linalg.svd(self.rows @ staying, full_matrices=False)
            relaxation.staying = staying @ combinations[sizes > _ROUNDING * self.highest].T
        return relaxation

    @cached_property
    def free(self) -> Array:
        """(n_branches, n_free) orthonormal motions that cost nothing and would mix with sound: the
        parts of the shifts of all balls that single balls and small clusters can make
        (:attr:`_local_shifts`), and the :attr:`loose` motions.

        Raises what :attr:`loose` raises.
        """
        return np.concatenate([self._local_shifts, self.loose], axis=1)

    @property
    def n_free(self) -> int:
        """Number n_free of the motions of :attr:`free`; where that raises an error, the number of
        those that were found.
        """
        loose, _ = self._search.result
        return int(self._local_shifts.shape[1] + loose.shape[1])

    @property
    def finds_gears(self) -> bool:
        """Whether motions that cost nothing may be those of several balls that turn as gears.
        Raises what :attr:`loose` raises.
        """
        return bool(self.loose.size)

    @cached_property
    def _local_shifts(self) -> Array:
        """(n_branches, k) orthonormal parts of the shifts of all balls, perpendicular to the shifts
        themselves. They are the parts that single balls can make without deforming a contact, and
        small clusters that no contact joins to other balls.
        """
        shifts = self.lattice.shifts
        parts = self.local_motions @ (self.local_motions.T @ shifts)
        parts -= shifts @ (shifts.T @ parts)
        basis, sizes, _ = np.linalg.svd(parts, full_matrices=False)
        return np.asarray(basis[:, sizes > math.sqrt(NO_ENERGY)])

    @property
    def keeps_back(self) -> bool:
        """Whether motions stay behind that deform contacts."""
        return bool(self.staying.size)

    @property
    def leaves_loose(self) -> bool:
        """Whether several balls can move together at no cost, or at so little that one iteration
        does not tell it from none. Left out are shifts of all balls, the motions of single balls
        and those of small clusters.
        """
        return bool(self._search.first_loose.size)

    @property
    def loose(self) -> Array:
        """(n_branches, k) orthonormal basis of all motions of several balls that cost nothing. Left
        out are shifts of all balls, the motions of single balls and those of small clusters.

        Raises :class:`~granphon.base.errors.InputError` if more than :data:`_MOST_LOOSE` are found,
        or if their estimated number is above twice that, and not all are looked for; also if the
        iteration cannot tell a motion that costs little from one that costs nothing.
        """
        search = self._search
        loose, has_soft = search.result
        method = f"A cell of {self.lattice.n_balls} balls is relaxed by iteration"
        mend = "Leave out balls that carry no load: network.without_rattlers()"
        if has_soft:
            raise InputError(
                "balls of the cell can move together at almost no cost",
                f"{method}, which does not tell such motions from those that cost nothing and"
                " therefore stay behind in sound",
                mend,
            )
        n_found = loose.shape[1]
        if n_found > _MOST_LOOSE or not search.are_few:
            # the search may have stopped before it had found all
            n_loose = max(n_found, search.estimate)
            raise InputError(
                f"balls of the cell can move together at no cost in some {n_loose:.0f} ways",
                f"{method}, which finds {_MOST_LOOSE} at most: what stays behind in sound is not"
                " known",
                mend,
            )
        return loose

    def relax(self, deformations: Array) -> Array:
        """Return the part of the ``deformations`` (n_rows, ...) that remains once the inner motions
        have relaxed.
        """
        columns = deformations.reshape(len(deformations), -1)
        relaxed_columns = columns - self.rows @ self.find_motions(columns)
        return np.asarray(relaxed_columns).reshape(deformations.shape)

    def find_motions(self, deformations: Array, floor: ArrayLike = 0.0) -> Array:
        """Return the mass-weighted motions (n_branches, m) whose deformations are the part of the
        ``deformations`` (n_rows, m) that does not remain. ``floor``, a number or (m,), is a size of
        the residual at which the iteration may end, see :meth:`_solve`.
        """
        return self._solve(
            lambda x: np.asarray(self._columns @ (self.rows @ x)),
            self._columns @ deformations,
            floor,
        )

    def eliminate(self, form: Array, mixed: Array, block: Any) -> Array:
        """Return the energy ``form`` (m, m) of displacement gradients under static forces, less
        what inner motions save as they relax. The arguments are those of
        :meth:`~granphon.dynamics.sparse_relaxation.SparseRelaxation.eliminate`.
        """
        forces, response = self._respond(mixed, block)
        return np.asarray(form - forces.T @ response)

    def respond(self, _form: Array, mixed: Array, block: Any) -> Array:
        """Return the mass-weighted inner motions (n_branches, m) that leave the least energy when
        they are subtracted; the arguments are those of :meth:`eliminate`, of which the first is not
        needed here.
        """
        _, motions = self._respond(mixed, block)
        return motions

    def _respond(self, mixed: Array, block: Any) -> tuple[Array, Array]:
        """Return two arrays (n_branches, m): ``mixed`` without the part of motions that stay
        behind, and of what single balls and small clusters can do alone at no cost; and the inner
        motions that respond to this. The first array is free of the latter motions only if those
        that stay behind are perpendicular to them. The arguments are those of :meth:`eliminate`.
        """
        local_part = self.local_motions @ (self.local_motions.T @ mixed)
        forces = self._hold_back(np.asarray(mixed - local_part))
        return forces, self._solve(lambda x: np.asarray(block @ x), forces)

    def _hold_back(self, motions: Array) -> Array:
        """Return ``motions``, or forces, (n_branches, m) without their components along the motions
        ``staying`` that stay behind.
        """
        return np.asarray(motions - self.staying @ (self.staying.T @ motions))

    def _precondition(self, residual: Array) -> Array:
        """Return the motions (n_branches, m) of each ball by itself under forces ``residual``."""
        return self._hold_back(np.asarray(self._ball_inverses @ residual))

    def _solve(
        self, apply: Callable[[Array], Array], right: Array, floor: ArrayLike = 0.0
    ) -> Array:
        """Return the motions (n_branches, m) that ``apply`` takes to ``right`` (n_branches, m), by
        conjugate gradients for all columns at once.

        ``apply`` multiplies by a symmetric matrix. The size of a residual r is (r^T P r)^1/2, with
        the preconditioner P. The iteration ends when the size in each column has fallen to
        ``floor``, a number or (m,), or to :data:`_REDUCTION` times the size at the start if this is
        larger. Motions that stay behind are left out of ``right`` and of the result. Raises
        :class:`~granphon.base.errors.InstabilityError` for a direction in which the energy falls,
        and :class:`~granphon.base.errors.ConvergenceError` after :data:`_MOST_ITERATIONS`.
        """
        motions = np.zeros_like(right)
        residual = self._hold_back(right)
        preconditioned = self._precondition(residual)
        direction = preconditioned.copy()
        squares = np.einsum("nm,nm->m", residual, preconditioned)  # of the sizes, by columns
        square_limits = np.maximum(_REDUCTION**2 * squares, np.square(floor))
        digits = -math.log10(_REDUCTION)
        digits_done = 0.0
        with self._progress.step("relax the balls", digits) as step:
            for _ in range(_MOST_ITERATIONS):
                is_open = squares > square_limits
                if not np.any(is_open):
                    return motions
                forces = self._hold_back(apply(direction))
                curvature = np.einsum("nm,nm->m", direction, forces)
                if np.any(curvature[is_open] <= 0.0):
                    raise InstabilityError(
                        "the network is not stable: it gives way to a uniform strain",
                        "Its static forces exceed what its springs hold",
                        "Lower the load, or leave static forces out (prestress=False)",
                    )
                lengths = np.divide(squares, curvature, out=np.zeros_like(squares), where=is_open)
                motions += lengths * direction
                residual -= lengths * forces
                preconditioned = self._precondition(residual)
                last_squares = squares
                squares = np.einsum("nm,nm->m", residual, preconditioned)
                growth = np.divide(squares, last_squares, out=np.zeros_like(squares), where=is_open)
                direction = preconditioned + growth * direction
                digits_left = _count_digits(squares, square_limits)
                further_digits = max(digits - digits_left - digits_done, 0.0)
                step.advance(further_digits)
                digits_done += further_digits
        raise ConvergenceError(
            f"the balls of the network do not relax within {_MOST_ITERATIONS} iterations",
            "Parts of it may cost almost no energy to move",
            "Take a smaller network, which is relaxed by factors, or one with more contacts",
        )


class _LooseSearch:
    """The search for loose motions, those of several balls that cost nothing, by a ``relaxation``
    that keeps no motions back. What is found is kept.
    """

    def __init__(self, relaxation: IterativeRelaxation) -> None:
        """Keep the ``relaxation``; nothing is searched for yet."""
        self._relaxation = relaxation

    @cached_property
    def result(self) -> tuple[Array, bool]:
        """The loose motions (n_branches, k), and whether other motions cost so little that one
        iteration does not tell them from loose ones.

        If there are more loose motions than :data:`_MOST_LOOSE`, the search ends with some of them,
        or with what the first random motions leave.
        """
        if not self.are_few:
            return self.first_loose, False
        loose, has_soft = self._purify(self.first_loose, self._nothing)
        n_found = self.first_loose.shape[1]
        n_probes = PROBES
        while n_found > n_probes - _SPARE_PROBES and loose.shape[1] <= _MOST_LOOSE:
            n_probes = _MORE_PROBES
            candidates = _find_span(self._probe(n_probes, loose))
            n_found = candidates.shape[1]
            further_loose, has_further_soft = self._purify(candidates, loose)
            loose = np.concatenate([loose, further_loose], axis=1)
            has_soft |= has_further_soft
            if not further_loose.size:
                break
        return loose, has_soft

    @cached_property
    def first_loose(self) -> Array:
        """(n_branches, k) orthonormal motions that the first random motions leave, :data:`PROBES`
        at most; none if no motion of several balls costs nothing, or hardly anything.
        """
        return _find_span(self._first_remainders)

    @property
    def estimate(self) -> float:
        """Number of loose motions, estimated from the first random motions; it may be below zero.

        The matrix that takes motions to their remainders is a projection onto the loose motions,
        and its trace is their number. The mean of m.Rm over normal random motions m is the trace of
        R. The squared length of Rm would be larger in the mean: the projection is oblique, as the
        preconditioner decides which of the motions with given deformations the iteration finds.
        """
        random_motions = self._draw(PROBES, self._nothing)
        return float(np.mean(np.sum(random_motions * self._first_remainders, axis=0)))

    @property
    def are_few(self) -> bool:
        """Whether the estimated number of loose motions is so low that all are looked for."""
        return self.estimate <= 2.0 * _MOST_LOOSE

    @cached_property
    def _first_remainders(self) -> Array:
        """(n_branches, PROBES) what the first random motions leave, see :meth:`_probe`."""
        return self._probe(PROBES, self._nothing)

    @property
    def _nothing(self) -> Array:
        """(n_branches, 0) loose motions before any have been found."""
        return np.zeros((self._relaxation.lattice.n_branches, 0))

    def _probe(self, count: int, loose: Array) -> Array:
        """Return the remainders (n_branches, count) of ``count`` random motions, as
        :meth:`_find_remainders` does; ``loose`` (n_branches, k) are the orthonormal loose motions
        found so far.

        A further loose motion leaves a normal random number in each random motion.
        """
        return self._find_remainders(self._draw(count, loose), loose)

    def _draw(self, count: int, loose: Array) -> Array:
        """Return the ``count`` random motions (n_branches, count) of :meth:`_probe`, with the same
        ``loose`` motions.
        """
        # the seed differs from search to search, and results can be repeated
        rng = np.random.default_rng(loose.shape[1])
        return rng.standard_normal((self._relaxation.lattice.n_branches, count))

    def _purify(self, candidates: Array, loose: Array) -> tuple[Array, bool]:
        """Return orthonormal motions (n_branches, n) that cost nothing among orthonormal
        ``candidates`` (n_branches, m), by a second iteration; and whether some candidates cost
        something. The candidates span what :meth:`_probe` has returned for the same ``loose``
        motions.
        """
        if not candidates.size:
            return candidates, False
        relaxation = self._relaxation
        remainders = self._find_remainders(candidates, loose)
        basis, sizes, _ = np.linalg.svd(remainders, full_matrices=False)
        likely_motions = basis[:, sizes > _LEAST_PART]
        _, costs, combinations = np.linalg.svd(
            relaxation.rows @ likely_motions, full_matrices=False
        )
        is_free = costs <= relaxation.accuracy * relaxation.highest
        free_motions = likely_motions @ combinations[is_free].T
        return np.asarray(free_motions), free_motions.shape[1] < candidates.shape[1]

    def _find_remainders(self, motions: Array, loose: Array) -> Array:
        """Return the remainders (n_branches, m) of ``motions`` (n_branches, m) without four parts:
        what deforms contacts, shifts of all balls, what single balls and small clusters can do
        alone, and the orthonormal ``loose`` motions (n_branches, k).
        """
        relaxation = self._relaxation
        local_motions = relaxation.local_motions
        shifts = relaxation.lattice.shifts
        # shifts of all balls, without the part that single balls and small clusters can make
        joint_shifts, sizes, _ = np.linalg.svd(
            shifts - local_motions @ (local_motions.T @ shifts), full_matrices=False
        )
        joint_shifts = joint_shifts[:, sizes > math.sqrt(NO_ENERGY)]
        excluded_basis = np.concatenate([joint_shifts, loose], axis=1)
        floor = _ROUNDING * relaxation.highest * np.linalg.norm(motions, axis=0)
        deformations = np.asarray(relaxation.rows @ motions)
        remainders = motions - relaxation.find_motions(deformations, floor)
        remainders -= local_motions @ (local_motions.T @ remainders)
        return np.asarray(remainders - excluded_basis @ (excluded_basis.T @ remainders))


def _count_digits(squares: Array, square_limits: Array) -> float:
    """Return by how many decimal digits the largest of some sizes has yet to fall to its limit; 0
    if all have. ``squares`` (m,) and ``square_limits`` (m,) are those of the sizes.
    """
    # a column of zeros has no residual, and none to reach
    ratios = np.ones_like(squares)
    np.divide(squares, square_limits, out=ratios, where=square_limits > 0.0)
    return 0.5 * math.log10(float(np.max(ratios, initial=1.0)))


def _find_span(remainders: Array) -> Array:
    """Return an orthonormal basis (n, k) of the ``remainders`` (n, m) of random motions, without
    what is smaller than :data:`_LEAST_REMAINDER`.
    """
    basis, sizes, _ = np.linalg.svd(remainders, full_matrices=False)
    return np.asarray(basis[:, sizes > _LEAST_REMAINDER])


def _join_clusters(lattice: Compatibility, matrix: Any, ball_motions: Any) -> Any:
    """Return orthonormal motions (n_branches, k), sparse by rows, that cost nothing: those of
    single balls, and those of small clusters of balls that no contact joins to others.

    ``ball_motions`` (n_branches, m), sparse, are the motions of single balls that cost nothing.
    Those of the balls of a cluster are replaced by the null vectors of the cluster in the stiffness
    ``matrix`` (n_branches, n_branches) of the cell of the ``lattice``.
    """
    from scipy.sparse import csc_array, hstack

    clusters = _find_clusters(lattice)
    if not clusters:
        return ball_motions
    count = lattice.motions.count
    highest_diagonal = float(np.max(matrix.diagonal()))
    # entries of the motions of clusters, with their lines and columns
    entries = []
    lines = []
    columns = []
    n_motions = 0
    for balls in clusters:
        lines_of_cluster = (balls[:, None] * count + np.arange(count)).ravel()
        stiffness = matrix[lines_of_cluster][:, lines_of_cluster].toarray()
        energies, vectors = np.linalg.eigh(stiffness)
        free_motions = vectors[:, energies <= NO_ENERGY * highest_diagonal]
        n_free = free_motions.shape[1]
        numbers = n_motions + np.arange(n_free)
        n_motions += n_free
        entries.append(free_motions.ravel())
        lines.append(np.repeat(lines_of_cluster, n_free))
        columns.append(np.tile(numbers, lines_of_cluster.size))
    of_clusters = csc_array(
        (np.concatenate(entries), (np.concatenate(lines), np.concatenate(columns))),
        shape=(lattice.n_branches, n_motions),
    )
    of_balls = ball_motions.tocsc()
    ball_of_motion = of_balls.indices[of_balls.indptr[:-1]] // count
    is_single = ~np.isin(ball_of_motion, np.concatenate(clusters))
    return hstack([of_balls[:, is_single], of_clusters], format="csr")


def _find_clusters(lattice: Compatibility) -> list[Index]:
    """Return the balls of each cluster of two and up to :data:`_MOST_IN_CLUSTER` balls of the cell
    of a ``lattice`` that no contact joins to other balls, and that does not go on from cell to
    cell. Contacts with bodies that do not move do not count.
    """
    from scipy.sparse import coo_array
    from scipy.sparse.csgraph import connected_components

    table = lattice.contacts
    n = lattice.n_balls
    # contacts of two balls, and not with the ground or with a body that does not move
    joints = np.flatnonzero((table.j < n) & (np.arange(len(table)) < lattice.n_between))
    i = table.i[joints]
    j = table.j[joints]
    graph = coo_array((np.ones(i.size), (i, j)), shape=(n, n))
    _, cluster = connected_components(graph, directed=False)
    sizes = np.bincount(cluster)
    is_small = (sizes > 1) & (sizes <= _MOST_IN_CLUSTER)
    clusters = []
    cluster_of_joint = cluster[i]
    for number in np.flatnonzero(is_small):
        balls = np.flatnonzero(cluster == number)
        contacts = np.flatnonzero(cluster_of_joint == number)
        # positions of the balls from which all vectors of contacts follow, if the cluster closes
        ends = np.zeros((contacts.size, balls.size))
        np.add.at(ends, (np.arange(contacts.size), np.searchsorted(balls, j[contacts])), 1.0)
        np.add.at(ends, (np.arange(contacts.size), np.searchsorted(balls, i[contacts])), -1.0)
        vectors = table.vector[joints[contacts]]
        positions = np.linalg.lstsq(ends, vectors, rcond=None)[0]
        mismatch = np.max(np.abs(ends @ positions - vectors), initial=0.0)
        if mismatch <= _CLOSURE_ERROR * np.max(np.abs(vectors)):
            clusters.append(balls)
    return clusters
