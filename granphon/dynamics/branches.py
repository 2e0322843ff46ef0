"""Branches followed along a path by the overlap of their eigenvectors, and the pulses that travel
on them.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from granphon.balls.lattices import as_direction, one_direction
from granphon.balls.neighbours import steps_within
from granphon.base.arrays import ROUNDING, Array
from granphon.base.errors import GranphonError, InputError, UnreachableFrequencyError, brief
from granphon.base.validation import finite_array
from granphon.dynamics.blocks import DEGENERACY
from granphon.dynamics.contact_lattice import ContactLattice

#: number of points, from Gamma to the edge of the zone, at which branches are followed
_PATH_POINTS = 128
#: number of these points that are solved together; after each such group, directions that have
#: reached their frequency are dropped
_POINTS_TOGETHER = 16
#: projection of a vector on a direction, over the length of the vector, up to which the vector is
#: perpendicular to the direction
_PERPENDICULARITY = 1e-9
#: wavenumber, over that of the first point, at which branches are told apart beside Gamma
_STEP_FROM_GAMMA = 1e-6
#: steps towards a wavenumber, at most: more than bisection needs
_MOST_STEPS = 200
#: relative change of a wavenumber at which Newton's steps end
_STEP_TOLERANCE = 1e-13
#: relative error of the frequency above which a branch has been lost
_FREQUENCY_TOLERANCE = 1e-11
#: number of pieces into which an interval that contains a maximum is divided
_PIECES = 33


def connect_branches(eigenvectors: ArrayLike) -> NDArray[np.intp]:
    """Return the order of branches that are followed along a path, through crossings, by the
    overlap of their eigenvectors.

    Parameters
    ----------
    eigenvectors : (n_q, n_dof, n_branches), columns in any order at each point. Points where
        branches touch must carry the eigenvectors of the limit along the path, as
        :meth:`ContactLattice.modes` gives them.

    Returns
    -------
    order : (n_q, n_branches), the column of each branch at each point, such that
        ``np.take_along_axis(frequencies, order, 1)`` is smooth; the first row counts up.

    Raises
    ------
    InputError : another shape, no point or no branch, or what is no number or not finite.
    """
    mend = "Give an array (n_q, n_dof, n_branches) of one or more points"
    try:
        vectors = np.asarray(eigenvectors)
    except ValueError:  # lists of different lengths
        raise InputError(f"eigenvectors is {brief(eigenvectors)}", mend=mend) from None
    if vectors.ndim != 3 or not vectors.size:
        raise InputError(f"eigenvectors has the shape {vectors.shape}", mend=mend)
    if not np.issubdtype(vectors.dtype, np.number) or not np.all(np.isfinite(vectors)):
        raise InputError(f"eigenvectors is {brief(eigenvectors)}", mend="Give finite numbers")
    overlap = np.abs(vectors[:-1].conj().swapaxes(1, 2) @ vectors[1:]) ** 2
    order = np.empty(vectors.shape[::2], np.intp)
    order[0] = np.arange(vectors.shape[2])
    for point, columns in enumerate(_assign_columns(overlap)):
        order[point + 1] = columns[order[point]]
    return order


def find_zone_boundary(lattice: ContactLattice, direction: ArrayLike) -> Any:
    """Return the distance from Gamma to the edge of the Brillouin zone of a ``lattice``, 1/d: a
    number for one ``direction`` (p,) of any length, or an array (n,) for n directions (n, p).

    Raises :class:`~granphon.base.errors.InputError` for a direction of another shape, not finite or
    of length zero.
    """
    along = as_direction(direction, lattice.periods)
    # no point of the zone is farther from Gamma than half the sum of the reciprocal cell's edges.
    # So the vectors whose bisecting planes bound the zone are no longer than the sum
    longest_length = float(np.linalg.norm(lattice.reciprocal, axis=1).sum())
    vectors = steps_within(lattice.reciprocal, longest_length) @ lattice.reciprocal
    squares = np.sum(vectors**2, axis=1)  # of their lengths
    projection = along @ vectors.T
    is_ahead = projection > _PERPENDICULARITY * np.sqrt(squares)
    # the plane that bisects a reciprocal vector G is met at the distance |G|^2/(2 G.u)
    distances = np.where(is_ahead, squares / np.where(is_ahead, 2.0 * projection, 1.0), np.inf)
    return np.min(distances, axis=-1)[()]  # of one direction a number


@dataclass(frozen=True)
class AcousticBranch:
    """One acoustic branch along a direction, from Gamma up to its first maximum or the zone edge.

    Attributes
    ----------
    lattice : the lattice whose branch it is.
    direction : (p,) unit vector.
    name : one of the lattice's ``wave_names``, after the polarisation at long waves.
    wavenumbers : (n,) ascending, 1/d, from the first point after Gamma on; of a branch that falls
        from Gamma on, or stays at zero, that of Gamma alone.
    frequencies : (n,) ascending, (k/M)^1/2; the last is the top of the branch.
    vectors : (n, n_dof) eigenvectors, by which the branch is recognised between the points.
    """

    lattice: ContactLattice
    direction: Array
    name: str
    wavenumbers: Array
    frequencies: Array
    vectors: NDArray[np.complex128]

    @property
    def top(self) -> float:
        """Highest angular frequency that a pulse on this branch can have, (k/M)^1/2."""
        return float(self.frequencies[-1])

    def find_pulse(self, frequency: ArrayLike) -> tuple[Array, Array]:
        """Return the wavenumbers (n,), 1/d, and the group velocities (n, p), d (k/M)^1/2, that
        pulses of angular ``frequency``, (k/M)^1/2, a number or (n,), have on this branch.

        Raises :class:`~granphon.base.errors.InputError` for another shape, for no frequency, and
        for what is no number, below zero or not finite,
        :class:`~granphon.base.errors.UnreachableFrequencyError` for one above the top of the
        branch, and :class:`~granphon.base.errors.GranphonError` where the branch cannot be followed
        through an avoided crossing.
        """
        target = np.atleast_1d(finite_array("frequency", frequency, low="zero or above"))
        if target.ndim > 1:
            raise InputError(f"frequency has the shape {target.shape}", mend="Give an array (n,)")
        if np.any(target > self.top):
            raise UnreachableFrequencyError(
                f"the {self.name} branch ends at {self.top:.10g} (k/M)^1/2, below"
                f" {float(target.max()):.10g}",
                mend="Choose lower frequencies",
            )
        shape = (target.size, len(self.wavenumbers))
        wavenumbers = np.broadcast_to(self.wavenumbers, shape)
        frequencies = np.broadcast_to(self.frequencies, shape)
        point_above, q, omega = _find_brackets(wavenumbers, frequencies, target)
        lattice = self.lattice
        along = np.broadcast_to(self.direction, (target.size, lattice.periods))
        references = self.vectors[point_above]
        return _solve_wavenumbers(lattice, along, target, q, omega, references, self.name)


def _find_brackets(
    wavenumbers: Array, frequencies: Array, target: Array
) -> tuple[NDArray[np.intp], Array, Array]:
    """Return the number (m,) of the first point of each of m branches whose frequency is at least
    the ``target`` (m,), and the wavenumbers (2, m) and the frequencies (2, m) of the branch at the
    point before and at this point. The point before the first one is Gamma, where both are zero.

    ``wavenumbers`` and ``frequencies`` (m, n_points), ascending, are those of the points of the
    branches. No target may be above all frequencies of its branch.
    """
    point_above = np.sum(frequencies < target[:, None], axis=1)
    row = np.arange(len(target))
    is_first = point_above == 0
    low_q = np.where(is_first, 0.0, wavenumbers[row, point_above - 1])
    low_omega = np.where(is_first, 0.0, frequencies[row, point_above - 1])
    q = np.stack([low_q, wavenumbers[row, point_above]])
    omega = np.stack([low_omega, frequencies[row, point_above]])
    return point_above, q, omega


def _find_nearest_modes(
    lattice: ContactLattice, wavenumbers: Array, along: Array, references: NDArray[np.complex128]
) -> tuple[Array, Array]:
    """Return the frequency (n,), (k/M)^1/2, and the group velocity (n, p), d (k/M)^1/2, of the mode
    of a ``lattice`` whose eigenvector overlaps most with the reference, at each of ``wavenumbers``
    (n,), 1/d.

    ``along`` are unit vectors, one (p,) or one for each wavenumber (n, p), and ``references``
    (n, n_dof) are eigenvectors.

    Several branches coincide along a whole direction, as both transverse ones do on an axis of
    symmetry, if they have one frequency and one slope. Their velocities depend on the side from
    which the axis is approached; then the mean of these velocities is returned.
    """
    modes = lattice.modes(wavenumbers[:, None] * along, along)
    # of each branch b with the reference, the sum over the motions m
    overlap = np.abs(np.einsum("qm,qmb->qb", references.conj(), modes.eigenvectors))
    points = np.arange(len(wavenumbers))
    nearest_branch = np.argmax(overlap, axis=1)
    frequencies = modes.frequencies[points, nearest_branch]
    velocities = modes.group_velocities[points, nearest_branch]
    if lattice.periods == 3:
        # only with three periods do acoustic branches that coincide along an axis of symmetry have
        # velocities that differ
        directions = np.broadcast_to(along, (len(wavenumbers), 3))
        slopes = np.einsum("qbp,qp->qb", modes.group_velocities, directions)
        difference = np.abs(modes.frequencies - frequencies[:, None])
        slope_difference = np.abs(slopes - slopes[points, nearest_branch][:, None])
        steepest_slope = np.max(np.abs(slopes), axis=1, keepdims=True)
        is_coincident = difference <= DEGENERACY * frequencies[:, None]
        is_coincident &= slope_difference <= DEGENERACY * steepest_slope
        counts = np.count_nonzero(is_coincident, axis=1)
        crossings = np.flatnonzero(counts > 1)  # points at which several branches coincide
        coincident_velocities = is_coincident[..., None] * modes.group_velocities
        sums = np.sum(coincident_velocities[crossings], axis=1)
        velocities[crossings] = sums / counts[crossings, None]
    return frequencies, velocities


def _solve_wavenumbers(
    lattice: ContactLattice,
    along: Array,
    target: Array,
    wavenumbers: Array,
    frequencies: Array,
    references: NDArray[np.complex128],
    name: str,
) -> tuple[Array, Array]:
    """Return wavenumbers (n,), 1/d, and group velocities (n, p), d (k/M)^1/2, at which a branch of
    a ``lattice`` has the angular frequencies ``target`` (n,), (k/M)^1/2, in directions ``along``
    (n, p): by Newton's method, with bisection where a step leaves the bracket.

    ``wavenumbers`` (2, n) are the brackets: their first row is below the solution, and their second
    above. ``frequencies`` (2, n) are those of the branch there. The branch has eigenvectors near
    ``references`` (n, n_dof), and messages call it ``name``. Raises
    :class:`~granphon.base.errors.GranphonError` where the mode nearest to the references does not
    reach the target.
    """
    low, high = wavenumbers.copy()
    low_omega, high_omega = frequencies
    # below the first point the branch is nearly straight, so linear interpolation starts close to
    # the root at any scale
    rise = high_omega - low_omega
    part = np.divide(target - low_omega, rise, out=np.zeros_like(rise), where=rise > 0.0)
    q = low + (high - low) * part
    omega, velocity = _find_nearest_modes(lattice, q, along, references)
    unsettled_targets = np.arange(q.size)  # numbers of the targets whose wavenumbers still change
    for _ in range(_MOST_STEPS):
        goal = target[unsettled_targets]
        guess = q[unsettled_targets]
        value = omega[unsettled_targets]
        high[unsettled_targets] = np.where(value >= goal, guess, high[unsettled_targets])
        low[unsettled_targets] = np.where(value <= goal, guess, low[unsettled_targets])
        slope = np.sum(velocity[unsettled_targets] * along[unsettled_targets], axis=1)
        step = np.divide(value - goal, slope, out=np.full_like(guess, np.inf), where=slope > 0.0)
        newton_q = guess - step
        middle = 0.5 * (low[unsettled_targets] + high[unsettled_targets])
        # a step of Newton's method that leaves the bracket is replaced by bisection
        is_inside = (newton_q >= low[unsettled_targets]) & (newton_q <= high[unsettled_targets])
        q[unsettled_targets] = np.where(is_inside, newton_q, middle)
        omega[unsettled_targets], velocity[unsettled_targets] = _find_nearest_modes(
            lattice, q[unsettled_targets], along[unsettled_targets], references[unsettled_targets]
        )
        # Newton's method converges quadratically: after a step as small as this only rounding is
        # left
        unsettled_targets = unsettled_targets[
            np.abs(q[unsettled_targets] - guess) > _STEP_TOLERANCE * guess
        ]
        if not unsettled_targets.size:
            break
    is_lost = np.abs(omega - target) > _FREQUENCY_TOLERANCE * target
    if np.any(is_lost):
        raise GranphonError(
            f"the {name} branch could not be followed along {along[np.argmax(is_lost)]}",
            "It changes its character too fast, at an avoided crossing",
            "Choose another direction",
        )
    return q, velocity


@dataclass(frozen=True, eq=False)
class AcousticBranches:
    """All acoustic branches along n directions, from Gamma up to requested frequencies.

    There are n_u branches in each direction, in the order of the lattice's ``wave_names``: in the
    plane the longitudinal branch, then the transverse.

    Attributes
    ----------
    lattice : the lattice whose branches they are.
    directions : (n, p) unit vectors.
    wavenumbers : (n, n_points), 1/d, from the first point after Gamma to the edge of the zone.
    frequencies : (n_u, n, n_points), (k/M)^1/2, ascending up to the last point before the first
        maximum; +inf at the points after it, and at those to which the branch was not followed.
    n_rising : (n_u, n), number of points before the first maximum, among those at which the branch
        was followed.
    has_fallen : (n_u, n), whether the branch was followed to a point behind a maximum.
    vectors : (n_u, n, n_points, n_dof), eigenvectors; zero at the points to which the branch was
        not followed.
    """

    lattice: ContactLattice
    directions: Array
    wavenumbers: Array
    frequencies: Array
    n_rising: NDArray[np.intp]
    has_fallen: NDArray[np.bool_]
    vectors: NDArray[np.complex128]

    @classmethod
    def follow(
        cls, lattice: ContactLattice, directions: Array, targets: ArrayLike = np.inf
    ) -> AcousticBranches:
        """Return the branches of a ``lattice`` along unit vectors ``directions`` (n, p), followed
        through crossings by the overlap of their eigenvectors.

        Each branch is followed at least until its frequency reaches its target, or falls, or until
        the edge of the zone. ``targets``, (k/M)^1/2, are (n_u, n), or one number for all branches.
        Raises what :meth:`ContactLattice.sound_velocities` and :meth:`ContactLattice.modes` raise.
        """
        n_directions = len(directions)
        n_waves = len(lattice.wave_names)
        goals = np.broadcast_to(np.asarray(targets, float), (n_waves, n_directions))
        edges = find_zone_boundary(lattice, directions)
        grid = edges[:, None] * np.arange(1, _PATH_POINTS + 1) / _PATH_POINTS
        shape = (n_waves, n_directions, _PATH_POINTS)
        branches = cls(
            lattice=lattice,
            directions=directions,
            wavenumbers=grid,
            frequencies=np.full(shape, np.inf),
            n_rising=np.zeros((n_waves, n_directions), np.intp),
            has_fallen=np.zeros((n_waves, n_directions), bool),
            vectors=np.zeros((*shape, lattice.n_branches), complex),
        )
        # eigenvectors at the last point, and the column of each wave among them
        last_vectors, column = _find_sound(lattice, _STEP_FROM_GAMMA * grid[:, :1], directions)
        numbers = np.arange(n_directions)  # of the directions in which some branch goes on
        for first_point in range(0, _PATH_POINTS, _POINTS_TOGETHER):
            q = grid[numbers, first_point : first_point + _POINTS_TOGETHER]
            modes = _find_path_modes(lattice, q, directions[numbers], last_vectors)
            row = np.arange(len(numbers))
            for point in range(q.shape[1]):
                # the column, at this point, of the mode that continues each of the last point
                next_column = _assign_columns(modes.overlap[:, point])
                column = np.stack([next_column[row, last_column] for last_column in column])
                branches._add_point(modes, point, column, numbers, first_point + point)
            is_below = branches._find_top()[:, numbers] < goals[:, numbers]
            is_unfinished = np.any(is_below & ~branches.has_fallen[:, numbers], axis=0)
            numbers = numbers[is_unfinished]
            column = column[:, is_unfinished]
            last_vectors = modes.vectors[is_unfinished, -1]
            if not numbers.size:
                break
        return branches

    def _add_point(
        self,
        modes: _PathModes,
        point: int,
        column: NDArray[np.intp],
        directions: NDArray[np.intp],
        number: int,
    ) -> None:
        """Write into the arrays, in place, what the branches have at the point of this ``number``
        in k of the directions, whose numbers are ``directions`` (k,).

        ``modes`` are those of a group of points in these directions, and ``point`` is the number of
        this point in the group; ``column`` (n_u, k) are the columns of the branches among the
        modes.
        """
        row = np.arange(len(directions))
        # a branch that has fallen once is not followed up again
        is_rising = ~self.has_fallen[:, directions] & (modes.slopes[row, point, column] > 0.0)
        rising_frequencies = np.where(is_rising, modes.frequencies[row, point, column], np.inf)
        self.has_fallen[:, directions] |= ~is_rising
        self.n_rising[:, directions] += is_rising
        self.frequencies[:, directions, number] = rising_frequencies
        self.vectors[:, directions, number] = modes.vectors[row, point, :, column]

    def _find_top(self) -> Array:
        """Return the frequency (n_u, n), (k/M)^1/2, of each branch at the last point at which it
        rose; +inf if it rose at none.
        """
        last_rise = np.maximum(self.n_rising - 1, 0)
        return np.take_along_axis(self.frequencies, last_rise[..., None], 2)[..., 0]

    def take_branch(self, wave: int, direction: int) -> AcousticBranch:
        """Return the branch of index ``wave`` in the lattice's ``wave_names``, in the direction of
        index ``direction``, up to the last point before its first maximum and the maximum itself.
        """
        count = int(self.n_rising[wave, direction])
        has_maximum = bool(self.has_fallen[wave, direction])
        points = slice(0, count + has_maximum)
        along = self.directions[direction]
        q = self.wavenumbers[direction, points].copy()
        omega = self.frequencies[wave, direction, points].copy()
        vectors = self.vectors[wave, direction, points]
        if has_maximum:
            # the last point is behind the maximum, and is replaced by the maximum
            low = q[count - 1] if count else 0.0
            reference = vectors[count][None]
            q[count] = _find_maximum(self.lattice, along, low, q[count], reference)
            frequency, _ = _find_nearest_modes(self.lattice, q[count : count + 1], along, reference)
            omega[count] = frequency[0]
        name = self.lattice.wave_names[wave]
        return AcousticBranch(self.lattice, along, name, q, omega, vectors)

    def find_wavenumber(
        self, wave: int, direction: NDArray[np.intp], target: Array
    ) -> tuple[Array, Array]:
        """Return wavenumbers (m,), 1/d, and group velocities (m, p), d (k/M)^1/2, of the branch of
        index ``wave`` in the lattice's ``wave_names``, at frequencies ``target`` (m,), (k/M)^1/2,
        in the directions of indices ``direction`` (m,).

        No target may be above the frequency at the last point before the maximum. Raises
        :class:`~granphon.base.errors.GranphonError` where the branch cannot be followed through an
        avoided crossing.
        """
        point_above, q, omega = _find_brackets(
            self.wavenumbers[direction], self.frequencies[wave, direction], target
        )
        references = self.vectors[wave, direction, point_above]
        name = self.lattice.wave_names[wave]
        return _solve_wavenumbers(
            self.lattice, self.directions[direction], target, q, omega, references, name
        )


class _PathModes(NamedTuple):
    """All modes at k points along each of n directions.

    Attributes
    ----------
    frequencies : (n, k, n_branches), (k/M)^1/2.
    slopes : (n, k, n_branches), group velocities along the direction, d (k/M)^1/2.
    vectors : (n, k, n_dof, n_branches), eigenvectors as columns.
    overlap : (n, k, n_branches, n_branches), |<v|w>|^2 of each mode v at the point before, and each
        mode w at the point.
    """

    frequencies: Array
    slopes: Array
    vectors: NDArray[np.complex128]
    overlap: Array


def _find_path_modes(
    lattice: ContactLattice, q: Array, along: Array, last_vectors: NDArray[np.complex128]
) -> _PathModes:
    """Return the modes of a ``lattice`` at wavenumbers q (n, k), 1/d, in directions ``along``
    (n, p), unit vectors.

    ``last_vectors`` (n, n_dof, n_branches) are the eigenvectors at the point before the first of
    these points, for the overlap with the eigenvectors at the first. Raises what
    :meth:`ContactLattice.modes` raises.
    """
    size = lattice.n_branches
    wavevectors = (q[..., None] * along[:, None]).reshape(-1, lattice.periods)
    modes = lattice.modes(wavevectors, np.repeat(along, q.shape[1], axis=0))
    vectors = modes.eigenvectors.reshape(*q.shape, size, size)
    velocities = modes.group_velocities.reshape(*q.shape, size, -1)
    slopes = np.einsum("nkbp,np->nkb", velocities, along)
    vectors_before = np.concatenate([last_vectors[:, None], vectors[:, :-1]], axis=1)
    # products of modes a at the point before and b at the point, summed over the motions m
    overlap = np.abs(np.einsum("nkma,nkmb->nkab", vectors_before.conj(), vectors)) ** 2
    return _PathModes(modes.frequencies.reshape(*q.shape, size), slopes, vectors, overlap)


def _find_sound(
    lattice: ContactLattice, q: Array, directions: Array
) -> tuple[NDArray[np.complex128], NDArray[np.intp]]:
    """Return the eigenvectors (n, n_dof, n_branches) at wavenumbers q (n, 1) near Gamma, and the
    column (n_u, n) of each sound wave among them, in the order of the lattice's ``wave_names``.

    ``directions`` (n, p) are unit vectors. Sound is recognised by the motion of the centre of mass:
    other motions of zero frequency at Gamma, such as balls turning like gears, leave it at rest.
    Raises what :meth:`ContactLattice.sound_velocities` raises.
    """
    _, polarisations = lattice.sound_velocities(directions)
    size = lattice.n_branches
    vectors = lattice.modes(q * directions, directions).eigenvectors
    motion = vectors.reshape(len(directions), lattice.n_balls, lattice.motions.count, size)
    # displacement (n, n_u, n_branches) of the centre of mass along each polarisation k, in each
    # branch b: sums over the balls i and the axes a
    drift = np.einsum(
        "i,niab,nak->nkb",
        np.sqrt(lattice.masses),
        motion[:, :, lattice.motions.translating],
        polarisations,
    )
    return vectors, _assign_columns(np.abs(drift) ** 2).T


def _find_maximum(
    lattice: ContactLattice,
    along: Array,
    low: float,
    high: float,
    reference: NDArray[np.complex128],
) -> float:
    """Return the last wavenumber, 1/d, before the frequency of a branch of a ``lattice`` falls, in
    the direction ``along`` (p,), between ``low``, where the frequency rises, and ``high``, where it
    falls.

    The branch has eigenvectors near ``reference`` (1, n_dof). At each turn the interval shrinks to
    one of :data:`_PIECES` pieces, until its ends are neighbours among floats.
    """
    references = np.broadcast_to(reference, (_PIECES - 1, reference.shape[1]))
    while high - low > ROUNDING * high:
        points = np.linspace(low, high, _PIECES + 1)[1:-1]
        _, velocities = _find_nearest_modes(lattice, points, along, references)
        is_rising = np.append(velocities @ along > 0.0, False)  # the branch falls at `high`
        first_fall = int(np.argmin(is_rising))
        edges = np.concatenate([[low], points, [high]])
        is_unchanged = (edges[first_fall], edges[first_fall + 1]) == (low, high)
        if is_unchanged:
            break
        low = float(edges[first_fall])
        high = float(edges[first_fall + 1])
    return low


def _assign_columns(overlap: Array) -> NDArray[np.intp]:
    """Return the columns (n, m) assigned to m branches at each of n points, none twice, such that
    the sum of their overlaps is the greatest. ``overlap`` (n, m, n_branches) is that of each branch
    with all columns.
    """
    # where the largest overlaps of all branches are in different columns, these columns are the
    # best assignment
    columns: NDArray[np.intp] = np.argmax(overlap, axis=2)
    all_differ = np.all(np.diff(np.sort(columns, axis=1), axis=1) > 0, axis=1)
    for row in np.flatnonzero(~all_differ).tolist():
        from scipy.optimize import linear_sum_assignment

        _, columns[row] = linear_sum_assignment(overlap[row], maximize=True)
    return columns


def follow_acoustic_branches(
    lattice: ContactLattice, direction: ArrayLike
) -> dict[str, AcousticBranch]:
    """Return the acoustic branches along ``direction`` (p,), followed through crossings to their
    maxima, as a dictionary by the lattice's ``wave_names``.

    Raises :class:`~granphon.base.errors.InputError` for another number of directions than one and
    for a direction that is not finite or of length zero, and what
    :meth:`ContactLattice.sound_velocities` and :meth:`ContactLattice.modes` raise.
    """
    along = one_direction(direction, lattice.periods)
    branches = AcousticBranches.follow(lattice, along[None])
    return {name: branches.take_branch(wave, 0) for wave, name in enumerate(lattice.wave_names)}
