"""The lattice of contacts and its vibrations, among them the motions that cost nothing.

The frequencies are the singular values of K^1/2 C(q) M^-1/2. Motions fall into blocks that no
contact joins to others, and each block is solved by itself (:mod:`granphon.dynamics.blocks`). A
block has as many branches that vanish at every wave vector as it has motions more than the generic
rank of its rows. Everything is in reduced units: length d, stiffness k, mass M.
"""

from __future__ import annotations

import itertools
from collections.abc import Callable
from dataclasses import replace
from functools import cached_property, lru_cache
from typing import TYPE_CHECKING, Any, NamedTuple, Self, TypeVar

import numpy as np
from numpy.typing import ArrayLike, NDArray

from granphon.balls.lattices import Lattice, as_direction, find_lattice, one_direction
from granphon.balls.layers import find_axes
from granphon.balls.motions import Motions, allowed_motions, default_motions
from granphon.balls.neighbours import ContactTable, freeze_contacts
from granphon.balls.on_site import turn_on_site
from granphon.base.arrays import Array, Complex, Index
from granphon.base.errors import InputError, InstabilityError, brief
from granphon.base.memory import require_memory
from granphon.base.results import Result, held, result_class
from granphon.base.scales import Units, write_quantity
from granphon.base.text import counted
from granphon.base.threads import share_out, single_products
from granphon.base.validation import not_negative, positive, real_array, require_instance
from granphon.dynamics.blocks import Block, find_blocks
from granphon.dynamics.compatibility import as_wavevectors
from granphon.dynamics.deformation_rows import find_anchors, find_gyration
from granphon.dynamics.large_cells import BYTES, LargeCell
from granphon.dynamics.linalg import MANY_COLUMNS
from granphon.dynamics.long_waves import LongWaves
from granphon.dynamics.sparse_relaxation import compose_ends
from granphon.networks.network import ContactNetwork

if TYPE_CHECKING:
    from granphon.dynamics.sensitivities import ModeEnergies

_Result = TypeVar("_Result")
#: number of entries of C(q) that are computed together: 64 MB of complex numbers
_ENTRIES = 4e6
#: |q|d at which modes are computed for their limits at Gamma; at smaller |q| each branch is a power
#: of |q|
_LIMIT_DISTANCE = 1e-30
#: |q|d at which the branches that are zero at Gamma are told apart
_STEP_FROM_GAMMA = 1e-4
#: |q| times the length of the longest vector of the cell at the first of four points that tell the
#: curvature of a branch at Gamma: errors of fourth order, and those of rounding, are both about
#: 1e-12 there
_STEP_FROM_CUTOFF = 5e-4
#: singular value from which unit vectors are independent: well above the error of vectors found at
#: :data:`_STEP_FROM_GAMMA`
_LEAST_INDEPENDENCE = 1e-2
#: amplitude of a ball in a motion of length one up to which the ball is at rest but for rounding
_REST_AMPLITUDE = 1e-12
#: number of balls in a cell up to which the top frequency is sought on a fine mesh
_MOST_ON_FINE_MESH = 8
#: number of balls in a cell above which its top frequency hardly depends on the wave vector
_MOST_ON_MESH = 200
#: number of modes whose deformations are found at once: 32 to 128 at once take a sixth of the time
#: that all modes at once take
_MODES_AT_ONCE = 64


@result_class
class Modes(Result):
    """Vibrations at a list of wave vectors, branches in ascending frequency; reduced units.

    Attributes
    ----------
    wavevectors : (n_q, p), 1/d.
    frequencies : (n_q, n_branches), angular, (k/M)^1/2.
    eigenvectors : (n_q, n_dof, n_branches), complex, mass-weighted, orthonormal. Degrees of freedom
        are the motions of the first ball, then those of the second, and so on: (x, y, w) in the
        plane, or (x, y) without friction; (x, y, z, w_x, w_y, w_z) in space. The displacement of a
        ball at r is its eigenvector times exp(i q.r).
    group_velocities : (n_q, n_branches, p), d (k/M)^1/2.
    rotational_fraction : (n_q, n_branches), the part of the kinetic energy that is rotation.
    longitudinal_fraction : (n_q, n_branches), the part of the kinetic energy that moves along q (at
        Gamma, along the given direction).
    out_of_plane_fraction : (n_q, n_branches), the part of the kinetic energy that moves across a
        plane of balls; 0 on a line and in space.
    """

    wavevectors: Array = held(float, "q p", "1/d", "finite")
    frequencies: Array = held(float, "q b", "(k/M)^1/2", "zero or above")
    eigenvectors: Complex = held(complex, "q m b", within="finite")
    group_velocities: Array = held(float, "q b p", "d (k/M)^1/2")
    rotational_fraction: Array = held(float, "q b")
    longitudinal_fraction: Array = held(float, "q b")
    out_of_plane_fraction: Array = held(float, "q b")

    @property
    def transverse_fraction(self) -> Array:
        """(n_q, n_branches), the part of the kinetic energy that moves perpendicular to q; of balls
        in a plane, perpendicular to q within the plane.
        """
        other_fractions = (
            self.rotational_fraction + self.longitudinal_fraction + self.out_of_plane_fraction
        )
        return np.clip(1.0 - other_fractions, 0.0, 1.0)  # rounding may leave this range


class ContactLattice(LongWaves):
    """Balls in contact on a periodic lattice, in reduced units: bands, velocities, moduli.

    :meth:`of` makes the lattice of equal balls, and :meth:`from_network` the lattice of any network
    with periods. The constructor takes any table of contacts.
    """

    @classmethod
    def of(
        cls,
        lattice: str | Lattice,
        mindlin_ratio: float,
        spacing: float = 1.0,
        prestress: float = 0.0,
        *,
        torsion: float = 0.0,
        bending: float = 0.0,
        motions: Motions | None = None,
    ) -> ContactLattice:
        """Return the contact lattice of equal balls on ``lattice``, whose contacts have the
        ``mindlin_ratio`` eta.

        ``spacing`` a/d and ``prestress`` f/(k a) keep the terms of relative order delta/d that
        Velicky and Caroli (2002) drop: the spacing itself, the lever arm a/2 and the sideways push
        of the static force. With the default values these terms are dropped. ``torsion`` and
        ``bending`` are the stiffness of a contact against twist and rolling over k d^2. ``motions``
        are the motions of each ball, by default the first choice of the lattice's dimension.

        Raises :class:`~granphon.base.errors.InputError` for an unknown lattice, for a number that
        is not finite or out of range, and for ``motions`` that are no :class:`Motions`. The lattice
        is cached: equal arguments may give the same object, which nothing changes.
        """
        distance = positive("spacing", spacing)
        if distance >= 2.0:
            raise InputError(
                f"spacing is {distance:g}",
                "The distance of touching balls, in diameters, must be below 2",
            )
        structure = find_lattice(lattice)
        if motions is None:
            motions = default_motions(structure.dimension)
        require_instance("motions", motions, Motions, "Give gp.Motions, or leave them out")
        return cls._make_of_equal_balls(
            structure,
            motions,
            mindlin_ratio=not_negative("mindlin_ratio", mindlin_ratio),
            spacing=distance,
            prestress=not_negative("prestress", prestress),
            torsion=not_negative("torsion", torsion),
            bending=not_negative("bending", bending),
        )

    @classmethod
    @lru_cache(maxsize=128)
    def _make_of_equal_balls(
        cls,
        structure: Lattice,
        motions: Motions,
        *,
        mindlin_ratio: float,
        spacing: float,
        prestress: float,
        torsion: float,
        bending: float,
    ) -> ContactLattice:
        """Return the lattice of :meth:`of` from arguments that have been checked.

        The lattice is cached, because velocities, moduli and validity of one state all start from
        it. No lattice is changed after it has been made.
        """
        return cls(
            structure.vectors * spacing,
            structure.positions * spacing,
            structure.contacts.scale(spacing),
            mindlin_ratio,
            prestress=prestress,
            torsion=torsion,
            bending=bending,
            motions=motions,
            name=structure.name,
        )

    @classmethod
    def from_network(cls, network: ContactNetwork) -> Self:
        """Return the contact lattice of a network that repeats along one, two or three axes, in the
        reduced units of the network.

        The units are :attr:`ContactNetwork.scales`. Each ball has its own mass and radius of
        gyration, each contact its own stiffnesses, arms and, with ``prestress``, normal force.
        Bodies that do not move hold the balls that touch them. Such bodies have no motions: the
        balls of the lattice are the moving ones, in the order of the network. The network is turned
        such that its first period is along x, and the second in the xy plane. The network keeps the
        lattice, and with it the results that the lattice keeps, for the next call.

        With ``prestress`` the tangential forces of the network act as well, without the part that
        has no potential: D is that of :class:`granphon.Waves`.

        Raises :class:`~granphon.base.errors.InputError` for anything but a network, for a network
        without a period, without contacts or balls that move, and for one whose balls are not at
        rest (:meth:`ContactNetwork.require_rest`).
        """
        mend = "Give a ContactNetwork, such as the network of a state"
        require_instance("the network", network, ContactNetwork, mend)
        return network.cached(cls._make_of_network)

    @classmethod
    def _make_of_network(cls, network: ContactNetwork) -> Self:
        """Return a new lattice of a ``network``, as :meth:`from_network` describes it, with the
        same errors.
        """
        network.require_rest()
        if not any(network.pbc):
            raise InputError(
                "the network repeats along no axis",
                "Bands and sound are those of balls that repeat without end",
                "Use gp.Waves, or give pbc and a cell",
            )
        contacts = _LatticeContacts.of(network)
        cell = contacts.turn(network.cell[contacts.periodic_axes])
        cell[:, len(cell) :] = 0.0  # rounding alone, as the periods lie along the first axes
        is_moving = network.moving
        units = network.scales
        motions = allowed_motions(network.dimension)[network.motions]
        anchored_balls, springs = _find_springs(network, contacts.axes, motions)
        return cls(
            cell / units.length,
            contacts.turn(network.positions[is_moving]) / units.length,
            _add_springs(contacts.tabulate(), anchored_balls, int(np.count_nonzero(is_moving))),
            masses=network.masses[is_moving] / units.mass,
            gyration=find_gyration(network)[is_moving] / units.length,
            turns_with_balls=network.turns_with_balls,
            motions=motions,
            on_site=springs if len(anchored_balls) else None,
            name="of this network",
            **contacts.list_arguments(len(anchored_balls)),
        )

    # -- vibrations --------------------------------------------------------------------------------

    def frequencies(self, wavevectors: ArrayLike) -> Array:
        """Return angular frequencies (n_q, n_branches), (k/M)^1/2, ascending, which keep all digits
        near Gamma.

        ``wavevectors`` are (n_q, p), 1/d. Frequencies of branches that vanish at every q, and of
        modes that vanish at one q, are exactly zero.

        Raises :class:`~granphon.base.errors.InputError` for wave vectors that are no real numbers,
        of another shape or not finite, where results do not fit into memory, and for a lattice
        without contacts;
        :class:`~granphon.base.errors.PrecisionError` for a wave vector too far from Gamma;
        :class:`~granphon.base.errors.InstabilityError` if prestress makes a squared frequency
        negative; and :class:`~granphon.base.errors.ConvergenceError` if, in a cell of many balls,
        Lanczos's method does not find the low modes.
        """
        q, _ = self._fold(wavevectors)
        self._require_memory_of_results(len(q), has_vectors=False)
        omega = np.concatenate(self._share_out(lambda points: self._solve(q[points]), len(q)))
        # almost at Gamma the deformations of contacts would underflow. There each frequency follows
        # from that at a longer wave vector, by its power of |q|
        is_almost_gamma = _is_almost_gamma(q)
        if np.any(is_almost_gamma):
            directions = as_direction(q[is_almost_gamma], self.periods)
            solved_q = _LIMIT_DISTANCE * directions
            modes = self._solve_with_velocities(solved_q, directions)
            omega[is_almost_gamma] = _follow_powers(q[is_almost_gamma], solved_q, *modes)[0]
        return omega

    @cached_property
    def top_frequency(self) -> float:
        """Highest frequency of all branches, (k/M)^1/2, on a coarse mesh of wave vectors.

        The mesh of a cell of up to 200 balls contains all q with halves of the reciprocal vectors,
        such as Gamma, M and X, and K of a hexagonal zone. It is coarser for more than 8 balls,
        because each point of the zone then stands for many points of the zone of a small cell. For
        more than 200 balls the mesh is Gamma alone. Raises what :meth:`frequencies` raises.
        """
        if self.n_balls <= _MOST_ON_FINE_MESH:
            fractions = np.arange(12) / 12.0
        elif self.n_balls <= _MOST_ON_MESH:
            fractions = np.array([0.0, 1.0 / 3.0, 0.5, 2.0 / 3.0])
        else:
            fractions = np.zeros(1)
        grid = np.stack(np.meshgrid(*[fractions] * self.periods), axis=-1).reshape(-1, self.periods)
        return float(self.frequencies(self.wavevectors(grid)).max())

    def modes(self, wavevectors: ArrayLike, direction: ArrayLike | None = None) -> Modes:
        """Return frequencies, eigenvectors and group velocities at each wave vector.

        Parameters
        ----------
        wavevectors : (n_q, p), 1/d.
        direction : (p,) or (n_q, p). Where branches have one frequency, the modes are those that a
            path in this direction follows. At Gamma, and wherever a frequency is zero, velocities
            are the limits along the path. By default, the direction of q.

        Raises
        ------
        InputError : a wave vector is Gamma and no direction is given, as sound has no velocity
            without one; there is no wave vector; wave vectors that are no real numbers, of a wrong
            shape or not finite; a direction of another shape, not finite or of length zero; the
            results do not fit into memory; or the lattice has no contacts.
        PrecisionError : a wave vector is too far from Gamma.
        InstabilityError : prestress makes a squared frequency negative.
        ConvergenceError : in a cell of many balls Lanczos's method does not find the low modes.
        """
        q = as_wavevectors(wavevectors, self.periods)
        if not len(q):
            raise InputError("there is no wave vector", mend="Give at least one")
        self._require_memory_of_results(len(q), has_vectors=True)
        if direction is not None:
            along = as_direction(direction, self.periods)
            if along.ndim == 2 and len(along) not in (1, len(q)):
                raise InputError(
                    f"direction has the shape {along.shape}",
                    f"There are {len(q)} wave vectors",
                    "Give one direction, or one for each wave vector",
                )
            along = np.broadcast_to(along, q.shape)
        elif np.all(np.any(q != 0.0, axis=1)):
            along = as_direction(q, self.periods)
        else:
            raise InputError(
                "modes at Gamma need a direction",
                "Group velocities there depend on it",
                "Give direction",
            )
        parts = self._share_out(lambda points: self._find_modes(q[points], along[points]), len(q))
        return Modes(*(np.concatenate(arrays) for arrays in zip(*parts, strict=True)))

    def find_onset(self, direction: ArrayLike) -> tuple[Array, Array]:
        """Return the frequencies omega (n_branches,) at Gamma, (k/M)^1/2, ascending, and the second
        derivatives (n_branches,) of omega with respect to q, in units of the square of d times
        (k/M)^1/2, of the branches beside Gamma, along a ``direction`` (p,).

        The curvature of a branch that begins above zero follows from the first two derivatives of
        omega^2; that of a branch that begins at zero is the derivative of its group velocity v. A
        cubic polynomial through four points beside Gamma gives the derivatives, of d(omega^2)/dq =
        2 omega v and of v.

        Raises :class:`~granphon.base.errors.InputError` for more than one direction, and for one of
        another shape, not finite or of length zero; and what :meth:`modes` raises.
        """
        along = one_direction(direction, self.periods)
        longest_vector = float(np.max(np.linalg.norm(self.cell, axis=1)))
        lengths = np.arange(1, 5) * _STEP_FROM_CUTOFF / longest_vector
        modes = self.modes(lengths[:, None] * along)
        velocities = modes.group_velocities @ along
        at_gamma = self.frequencies(np.zeros((1, self.periods)))[0]
        begins_above_zero = at_gamma > 0.0
        slopes = np.where(begins_above_zero, 2.0 * modes.frequencies * velocities, velocities)
        # the first two coefficients of the cubic: the slope at Gamma, and its derivative
        slope, slope_change, *_ = np.linalg.solve(np.vander(lengths, increasing=True), slopes)
        # omega'' = (omega^2)''/(2 omega) - omega'^2/omega, with omega' = (omega^2)'/(2 omega); of a
        # branch that begins at zero, omega'' = v'
        twice_omega = np.where(begins_above_zero, 2.0 * at_gamma, 1.0)
        first_derivative = np.where(begins_above_zero, slope / twice_omega, 0.0)
        curvatures = slope_change / twice_omega - 2.0 * first_derivative**2 / twice_omega
        return at_gamma, curvatures

    def require_rigid(self, units: Units | None = None) -> None:
        """Raise :class:`~granphon.base.errors.InputError` if springs to the ground hold the balls,
        or if :meth:`LongWaves.require_rigid` raises.

        With ``units`` the error about springs tells the lowest cut-off frequency, Hz, and the
        curvature of its branch there along x; what :meth:`find_onset` raises is then raised too.
        """
        if self.is_anchored:
            why = "Long waves begin at a cut-off frequency, and have no velocity"
            if units is not None:
                frequencies, curvatures = self.find_onset(np.eye(self.periods)[0])
                hertz = write_quantity(float(frequencies[0]) * units.frequency, "Hz")
                curvature = float(curvatures[0]) * units.velocity * units.length
                why = (
                    f"Long waves begin at a cut-off frequency, {hertz} of the lowest branch, whose"
                    f" curvature d^2 omega/dq^2 is {curvature:.5g} m^2/s along x there"
                )
            mend = "Use gp.Phonons(...).onset() and bands, or leave on_site out"
            raise InputError("springs to the ground hold the balls", why, mend)
        super().require_rigid()

    def mode_energies(
        self, wavevectors: ArrayLike, branches: Index | None = None, axes: Array | None = None
    ) -> ModeEnergies:
        """Return the energies of modes, from which derivatives of their frequencies follow.

        Parameters
        ----------
        wavevectors : (n_q, p), 1/d.
        branches : (n_q, b) numbers of the branches at each wave vector, one or more; all of them by
            default.
        axes : (d, d) unit vectors, rows: the axes of the motions of balls; by default those of the
            lattice.

        Raises
        ------
        InputError : wave vectors that are no real numbers, of another shape or not finite; no wave
            vector; branches of another shape, or that the lattice does not have; the energies do
            not fit into memory; or the lattice has no contacts.
        PrecisionError : a wave vector is too far from Gamma.
        InstabilityError : a squared frequency is negative.
        ConvergenceError : in a cell of many balls Lanczos's method does not find the low modes.
        """
        # frequencies alone do not need the derivatives
        from granphon.dynamics.sensitivities import ModeEnergies, turn_motions

        q = as_wavevectors(wavevectors, self.periods)
        if not len(q):
            raise InputError("there is no wave vector", mend="Give at least one")
        if branches is None:
            branches = np.broadcast_to(np.arange(self.n_branches), (len(q), self.n_branches))
        branches = self._read_branches(branches, len(q))
        kinds = {row.kind for row in self.unit_rows}
        numbers_per_mode = (len(kinds) + 3) * len(self.contacts) + 2 * self.n_branches
        require_memory(
            f"derivatives of {branches.size:,} frequencies",
            8.0 * branches.size * numbers_per_mode,
            "Take fewer wave vectors or branches",
        )
        frame = np.eye(self.dimension) if axes is None else axes
        turn = turn_motions(self.motions, frame)
        parts = self._share_out(
            lambda points: self._measure_modes(q[points], branches[points], turn), len(q)
        )
        frequencies, degenerate, squares, motions = zip(*parts, strict=True)
        return ModeEnergies(
            np.concatenate(frequencies),
            np.concatenate(degenerate),
            {
                name: np.concatenate([of_points[name] for of_points in squares])
                for name in squares[0]
            },
            np.concatenate(motions),
        )

    def _read_branches(self, given_branches: ArrayLike, n_points: int) -> Index:
        """Return numbers of branches as an array (n_points, b), one or more at each of ``n_points``
        wave vectors, from ``given_branches``.

        Raises :class:`~granphon.base.errors.InputError` for another shape, and for what is no
        number of a branch.
        """
        try:
            branches = np.asarray(given_branches)
        except ValueError:  # lists of different lengths
            branches = np.zeros(0)
        has_shape = branches.ndim == 2 and len(branches) == n_points and branches.size > 0
        are_branches = np.issubdtype(branches.dtype, np.integer) and np.all(
            (branches >= 0) & (branches < self.n_branches)
        )
        if not has_shape or not are_branches:
            raise InputError(
                f"branches is {brief(given_branches)}",
                f"There are {counted(n_points, 'wave vector')} and"
                f" {counted(self.n_branches, 'branch', 'branches')}",
                f"Give an array ({n_points}, b) of numbers from 0 to {self.n_branches - 1}",
            )
        return branches

    def _measure_modes(self, q: Array, branches: Index, turn: Array) -> ModeEnergies:
        """Return the energies of the modes of ``branches`` (n_q, b) at a few wave vectors q
        (n_q, p), 1/d; those of modes with one frequency are their means.

        ``turn`` (motions, motions) takes the motions of each ball to motions along the axes of
        :meth:`mode_energies`.
        """
        from granphon.dynamics.sensitivities import ModeEnergies, average_equal, number_equal

        frequencies, vectors = self._find_vectors(q)
        # modes of one frequency are a group; all modes of the groups of the branches are needed
        groups = number_equal(frequencies)
        group_of_branch = np.take_along_axis(groups, branches, axis=1)
        columns = _find_members(groups, group_of_branch)
        groups_of_columns = groups[:, columns]
        needed_vectors = vectors[:, :, columns]
        squares = self._square_deformations(q, needed_vectors)
        by_ball = needed_vectors.reshape(len(q), self.n_balls, self.motions.count, -1)
        motions = np.abs(turn @ by_ball) ** 2
        is_degenerate = _count_members(groups, group_of_branch) > 1
        # without degenerate branches, and with the branches in the order of the columns, the values
        # of the columns are those of the branches
        are_columns = branches.shape[1] == len(columns) and np.all(branches == columns)
        is_plain = are_columns and not np.any(is_degenerate)

        def average(values: Array) -> Array:
            """Return (n_q, b, ...), for each branch the mean over its group of ``values``
            (n_q, ..., m), where m counts the columns.
            """
            if is_plain:
                return np.moveaxis(values, -1, 1)
            means = [
                average_equal(*at_q)
                for at_q in zip(values, groups_of_columns, group_of_branch, strict=True)
            ]
            return np.moveaxis(np.reshape(means, (*values.shape[:-1], branches.shape[1])), -1, 1)

        return ModeEnergies(
            np.take_along_axis(frequencies, branches, axis=1),
            is_degenerate,
            {name: average(values) for name, values in squares.items()},
            average(motions),
        )

    def _find_vectors(self, q: Array) -> tuple[Array, Complex]:
        """Return frequencies (n_q, n_branches) and eigenvectors (n_q, n_branches, n_branches), as
        columns, at a few wave vectors q (n_q, p), 1/d; n_q is one for large cells. Raises what
        :meth:`_find_modes` raises.
        """
        is_limit = np.all(q == 0.0, axis=1) | _is_almost_gamma(q)
        if self._large is not None and not np.any(is_limit):
            # large cells are solved at one wave vector at a time, the equivalent one near Gamma
            folded_q, copies = self._fold(q)
            modes = self._large.solve_modes(folded_q[0])
            if modes is not None:
                frequencies, vectors = modes
                phase = self._find_copy_phases(copies)[0]
                in_phase = np.repeat(phase, self.motions.count)[:, None] * vectors
                return frequencies[None], in_phase[None]
        # any basis of the modes of one frequency will do, and so any path
        along = np.broadcast_to(np.eye(self.periods)[0], q.shape)
        _, frequencies, vectors, *_ = self._find_modes(q, along)
        return frequencies, vectors

    def _find_copy_phases(self, copies: Array) -> Complex:
        """Return the factors (n_q, n_balls) that take displacements of balls at a folded wave
        vector to those at the wave vector that was folded, by the sums ``copies`` (n_q, p) of
        reciprocal vectors, 1/d, that :meth:`_fold` subtracted.
        """
        return np.asarray(np.exp(-1j * (copies @ self.positions[:, : self.periods].T)))

    def _square_deformations(self, q: Array, vectors: Complex) -> dict[str, Array]:
        """Return a dictionary of the squares (n_q, n_c, m) of the deformations of contacts, by the
        kind of stiffness that resists them, without springs to the ground.

        ``vectors`` (n_q, n_branches, m) are those of the modes, and q (n_q, p) the wave vectors.
        """
        from granphon.dynamics.sensitivities import sum_kinds

        rows = self.unit_rows
        count = len(self.contacts)
        head, tail = compose_ends(self, rows, np.ones((len(rows), count)))
        if len(q) == 1:
            flat_squares = self._square_at_wavevector(q[0], head, tail, vectors[0])
            sums_by_kind = sum_kinds(rows, flat_squares)
            return {name: sums[None, : self.n_between] for name, sums in sums_by_kind.items()}
        # one product for all wave vectors: the columns of `all_motions` are the modes at all of
        # them. The deformation of a contact is head.x_j - exp(-2i h) tail.x_i, but for a phase
        half_angle = 0.5 * q @ self.contacts.vector[:, : self.periods].T
        phase = np.exp(1j * half_angle).T[None, :, :, None]  # kinds, n_c, n_q, m
        motions = np.moveaxis(vectors, 1, 0)
        all_motions = motions.reshape(self.n_branches, -1)
        shape = (len(rows), count, *motions.shape[1:])
        deformations = (head @ all_motions).reshape(shape)
        deformations -= phase.conj() ** 2 * (tail @ all_motions).reshape(shape)
        squares = (deformations.real**2 + deformations.imag**2).reshape(-1, *motions.shape[1:])
        by_kind = sum_kinds(rows, squares)
        return {name: sums[: self.n_between].swapaxes(0, 1) for name, sums in by_kind.items()}

    def _square_at_wavevector(self, q: Array, head: Any, tail: Any, vectors: Complex) -> Array:
        """Return the squares (kinds * n_c, m) of the deformations in modes with the ``vectors``
        (n_branches, m) at one wave vector q (p,).

        ``head`` and ``tail``, sparse matrices (kinds * n_c, n_branches), are the effects of the two
        ends of each contact. :data:`_MODES_AT_ONCE` modes are multiplied at a time, so that they
        stay in the cache of the processor.
        """
        phase = np.exp(-1j * (self.contacts.vector[:, : self.periods] @ q))
        by_row = np.tile(phase, head.shape[0] // len(phase))
        matrix = (head - tail.multiply(by_row[:, None])).tocsr()
        squares = np.empty((head.shape[0], vectors.shape[1]))
        for first in range(0, vectors.shape[1], _MODES_AT_ONCE):
            columns = slice(first, first + _MODES_AT_ONCE)
            deformations = matrix @ np.ascontiguousarray(vectors[:, columns])
            squares[:, columns] = deformations.real**2 + deformations.imag**2
        return squares

    def _require_memory_of_results(self, n_points: int, has_vectors: bool) -> None:
        """Raise :class:`~granphon.base.errors.InputError` if the frequencies at ``n_points`` wave
        vectors do not fit into memory, with eigenvectors if the result ``has_vectors``.
        """
        # a frequency and the array in which it is found; three copies of complex eigenvectors
        bytes_per_branch = 48.0 * self.n_branches if has_vectors else 16.0
        alternative = ", or frequencies alone" if has_vectors else ""
        require_memory(
            f"{self.n_branches:,} branches at {n_points:,} wave vectors",
            bytes_per_branch * n_points * self.n_branches,
            f"Take fewer wave vectors{alternative}",
        )

    def _find_modes(self, wavevectors: Array, along: Array) -> tuple[NDArray[Any], ...]:
        """Return the arrays of :class:`Modes`, in the order of its attributes, at a few
        ``wavevectors`` (n_q, p), 1/d, through which paths run in the directions ``along`` (n_q, p),
        unit vectors. Raises what :meth:`_fold` and :meth:`_solve_with_velocities` raise.
        """
        q, copies = self._fold(wavevectors)
        # modes at Gamma are limits along the direction, and modes very near Gamma limits along q
        is_gamma = np.all(q == 0.0, axis=1)
        is_almost_gamma = _is_almost_gamma(q)
        solved_q = np.where(is_gamma[:, None], _LIMIT_DISTANCE * along, q)
        if np.any(is_almost_gamma):
            directions = as_direction(q[is_almost_gamma], self.periods)
            solved_q[is_almost_gamma] = _LIMIT_DISTANCE * directions
        frequencies, vectors, velocities = self._solve_with_velocities(solved_q, along)
        is_limit = is_gamma | is_almost_gamma
        if np.any(is_limit):
            frequencies[is_limit], vectors[is_limit], velocities[is_limit] = _follow_powers(
                q[is_limit],
                solved_q[is_limit],
                frequencies[is_limit],
                vectors[is_limit],
                velocities[is_limit],
            )
        by_ball = vectors.reshape(len(q), self.n_balls, self.motions.count, self.n_branches)
        motion = by_ball * self._find_copy_phases(copies)[:, :, None, None]
        # that of the wave vector itself, and not of the equivalent one near Gamma
        wave_direction = np.where(is_gamma[:, None], along, wavevectors)
        energy_parts = self._split_energy(motion, as_direction(wave_direction, self.periods))
        eigenvectors = motion.reshape(len(q), self.n_branches, self.n_branches)
        return wavevectors, frequencies, eigenvectors, velocities, *energy_parts

    def _split_energy(self, motion: Complex, direction: Array) -> tuple[Array, Array, Array]:
        """Return three parts (n_q, n_branches) of the kinetic energy: that of rotation, that of
        displacements along a ``direction`` (n_q, p), unit vectors, and that of displacements out of
        a plane of balls, which is zero on a line and in space.

        ``motion`` (n_q, n_balls, motions, n_branches) are eigenvectors of norm one.
        """
        kinetic = np.abs(motion) ** 2
        rotational_part = kinetic[:, :, self.motions.turning].sum(axis=(1, 2))
        direction_in_space = np.zeros((len(motion), 3))
        direction_in_space[:, : self.periods] = direction
        displacement = motion[:, :, self.motions.translating]
        axes = list(self.motions.translations)
        # component along the direction of each ball i in each branch b: the sum over the axes a
        parallel_parts = np.einsum("qiab,qa->qib", displacement, direction_in_space[:, axes])
        longitudinal_part = (np.abs(parallel_parts) ** 2).sum(axis=1)
        out_of_plane_part = np.zeros_like(rotational_part)
        if self.periods == 2 and 2 in axes:
            out_of_plane_part = kinetic[:, :, axes.index(2)].sum(axis=1)
        return rotational_part, longitudinal_part, out_of_plane_part

    def _solve(self, q: Array) -> Array:
        """Return frequencies (n_q, n_branches), (k/M)^1/2, ascending, at wave vectors q (n_q, p),
        1/d; n_q is one at most for large cells.

        Raises :class:`~granphon.base.errors.InstabilityError` if a squared frequency is negative,
        and what :class:`~granphon.dynamics.large_cells.LargeCell` raises.
        """
        if self._large is not None and len(q) == 1:
            frequencies = self._large.find_frequencies(q[0])
            if frequencies is not None:
                return frequencies[None]
        try:
            by_block = [block.solve(q)[0] for block in self._blocks]
        except InstabilityError:
            raise self._find_buckling(q) from None
        if len(by_block) == 1:
            return by_block[0]
        return np.sort(np.concatenate(by_block, axis=1), axis=1)

    def _solve_with_velocities(self, q: Array, along: Array) -> tuple[Array, NDArray[Any], Array]:
        """Return frequencies (n_q, n_branches), (k/M)^1/2, ascending, eigenvectors
        (n_q, n_dof, n_branches) and group velocities (n_q, n_branches, p), d (k/M)^1/2, at wave
        vectors q (n_q, p), 1/d.

        Modes of one frequency are those that paths along the unit vectors ``along`` (n_q, p)
        follow. Raises what :meth:`_solve` raises.
        """
        if self._large is not None and len(q) == 1:
            modes = self._large.solve_with_velocities(q[0])
            if modes is not None:
                omega, motions, slopes = modes
                return omega[None], motions[None], slopes[None]
        try:
            by_block = [block.solve_with_velocities(q, along) for block in self._blocks]
        except InstabilityError:
            raise self._find_buckling(q) from None
        if len(by_block) == 1:
            frequencies, vectors, velocities = by_block[0]
            return frequencies, self._to_balls @ vectors, velocities
        frequencies = np.concatenate([omega for omega, _, _ in by_block], axis=1)
        velocities = np.concatenate([slopes for _, _, slopes in by_block], axis=1)
        dtype = np.result_type(*(block_vectors for _, block_vectors, _ in by_block))
        vectors = np.zeros((len(frequencies), self.n_branches, self.n_branches), dtype)
        first = 0
        for block, (_, block_vectors, _) in zip(self._blocks, by_block, strict=True):
            vectors[:, block.columns, first : first + block.size] = block_vectors
            first += block.size
        frequencies, vectors, velocities = _sort_branches(frequencies, vectors, velocities)
        # modes of zero frequency get the order of their frequencies beside the point
        n_zeros = np.count_nonzero(frequencies == 0.0, axis=1)
        for n in np.flatnonzero(n_zeros > self.free_branches).tolist():
            order = np.argsort(velocities[n, : n_zeros[n]] @ along[n], kind="stable")
            vectors[n, :, : n_zeros[n]] = vectors[n][:, order]
            velocities[n, : n_zeros[n]] = velocities[n, order]
        return frequencies, self._to_balls @ vectors, velocities

    def _find_buckling(self, q: Array) -> InstabilityError:
        """Return the error of a lattice that buckles, which names the wave vector, among q
        (n_q, p), of the lowest squared frequency.
        """
        squares, vectors = np.linalg.eigh(self._compute_frame_matrix(q))
        lowest_point = int(np.argmin(squares[:, 0]))
        where = (
            f"a squared frequency at {self.name_wavevector(q[lowest_point])} is negative,"
            f" {squares[lowest_point, 0]:.3g} k/M"
        )
        motion = (self._to_balls @ vectors[lowest_point, :, 0]).reshape(self.n_balls, -1)
        return self.explain_buckling(where, motion[:, self.motions.translating].T)

    def _share_out(self, find: Callable[[slice], _Result], count: int) -> list[_Result]:
        """Return the results of ``find`` for slices of the numbers of ``count`` wave vectors: of a
        single one, or of so few that C(q) has some :data:`_ENTRIES` entries at most.

        Wave vectors of large cells are shared out to all processors, one by one. Without wave
        vectors ``find`` is called once, with an empty slice, so that its result has a shape. Raises
        what :meth:`_require_contacts` raises.
        """
        self._require_contacts()
        length = 1
        if self._large is None:
            entries_per_point = 2 * len(self.contacts) * self.n_branches
            length = max(1, int(_ENTRIES / entries_per_point))
        slices = [slice(start, start + length) for start in range(0, max(count, 1), length)]
        if self._large is None:
            return [find(points) for points in slices]
        with single_products():
            return share_out(find, slices)

    @cached_property
    def _large(self) -> LargeCell | None:
        """Solver of cells of many branches, one wave vector at a time; None if the cell is small,
        as the matrices of many wave vectors are then best solved together. Raises InputError if one
        wave vector takes too much memory.
        """
        if self.n_branches <= MANY_COLUMNS:
            return None
        self._require_memory(BYTES * self.n_branches**2)
        weighted_rows = [self._weight_rows()]
        if self.is_prestressed:
            weighted_rows.append(self._weight_rows(are_static=True))
        return LargeCell(self, weighted_rows, self._images)

    # -- motions that nothing joins to others ------------------------------------------------------

    @cached_property
    def _blocks(self) -> list[Block]:
        """Sets of motions of the frame that no contact joins to other motions, with their rows of
        C(q). Raises what :meth:`_require_contacts` raises.
        """
        kinds = [self._deforming, self._pushing] if self.is_prestressed else [self._deforming]
        # (kinds, n_c, n_branches), whether a motion takes part in a row at some wave vector
        effects = [waves.find_effects() for waves in kinds]
        all_effects = np.concatenate([effect.reshape(-1, self.n_branches) for effect in effects])
        blocks = []
        for columns in find_blocks(all_effects):
            rows = [np.asarray(effect[..., columns].any(axis=2)) for effect in effects]
            if not rows[0].any():
                rows[0][0, 0] = True  # a block without rows has one row of zeros
            block = Block(columns, self._deforming.select(rows[0], columns))
            if self.is_prestressed:
                pushing = self._pushing.select(rows[1], columns)
                signs = np.broadcast_to(self._push_signs, rows[1].shape)[rows[1]]
                block = replace(block, pushing=pushing, signs=signs[:, None], slack=self.slack)
            elif not self.is_held:
                tilted_block = self._tilt_block(block)
                if tilted_block.keeps_digits:
                    block = tilted_block
            blocks.append(block.split_free_motions())
        return blocks

    def _tilt_block(self, block: Block) -> Block:
        """Return a ``block`` with its ``bent`` and ``tilt``: the displacements across the periods
        that tilt the balls, and the motions that go with them.

        A wave of displacements u of all balls turns them by phi = i q x u. A ball at the distance z
        along u from the middle of the layer then moves by -i q z |u|.
        """
        motions = self.motions
        p = self.periods
        columns = block.columns
        weights = self._wave_frame.conj() * np.sqrt(self.masses / self.masses.sum())[:, None]
        # displacements of the centre of mass are the first motions of the frame
        bent_motions = [
            motion
            for motion in np.flatnonzero(columns < len(motions.translations)).tolist()
            if motions.translations[columns[motion]] >= p
        ]
        tilt = np.zeros((len(bent_motions), len(columns), p), complex)
        for number, motion in enumerate(bent_motions):
            axis = motions.translations[columns[motion]]
            for along in range(p):
                motions_of_balls = self._tilt_balls(axis, along)
                tilt[number, :, along] = (weights.T @ motions_of_balls).ravel()[columns]
        is_real = np.issubdtype(block.deforming.odd.dtype, np.floating)
        gradients = tilt.real.copy() if is_real else tilt
        tilting_numbers = np.flatnonzero(np.any(gradients != 0.0, axis=(1, 2)))
        return replace(
            block,
            bent=tuple(bent_motions[number] for number in tilting_numbers),
            tilt=gradients[tilting_numbers],
        )

    def _tilt_balls(self, axis: int, along: int) -> Complex:
        """Return the motions (n_balls, motions) that go with a unit displacement of all balls along
        the ``axis`` across the periods, per component of q along the axis ``along``.
        """
        motions = self.motions
        height = self.positions[:, axis] if axis < self.dimension else np.zeros(self.n_balls)
        height = height - self.masses @ height / self.masses.sum()
        turn = np.cross(np.eye(3)[along], np.eye(3)[axis])
        motions_of_balls = np.zeros((self.n_balls, motions.count), complex)
        turns = self.gyration[:, None] * turn[list(motions.rotations)]
        motions_of_balls[:, motions.turning] = turns
        if along in motions.translations:
            motions_of_balls[:, motions.translations.index(along)] = -1.0j * height
        return motions_of_balls

    @cached_property
    def elongating_blocks(self) -> list[Block]:
        """The blocks with motions that lengthen or shorten contacts. The motions of other blocks
        leave the static normal forces as they are.
        """
        is_elongation = [row.kind == "elongation" for row in self.rows]
        lengthens = np.any(self._deforming.find_effects()[is_elongation], axis=(0, 1))
        return [block for block in self._blocks if np.any(lengthens[block.columns])]

    # -- branches that vanish at every wave vector -------------------------------------------------

    @cached_property
    def free_branches(self) -> int:
        """Number of branches that vanish at every wave vector: the number of branches less the
        generic rank of C(q), or under static forces of C(q) and :attr:`static_rows` together.
        """
        n_free = None if self._large is None else self._large.free_branches
        if n_free is not None:
            return n_free
        # of a small cell, and of a large one whose matrix D would lose the digits
        return sum(block.n_free for block in self._blocks)

    @cached_property
    def free_branch_warnings(self) -> tuple[str, ...]:
        """One sentence that counts the branches that vanish at every wave vector, and says what
        would stop them; empty if there are no such branches.
        """
        count = self.free_branches
        if not count:
            return ()
        vanish, them = ("vanishes", "it") if count == 1 else ("vanish", "them")
        remedy = self.find_remedy(lambda lattice: lattice.free_branches == 0)
        return (
            f"{count} of {self.n_branches} branches {vanish} at every wave vector, as these"
            f" motions deform no contact; to stop {them}, {remedy}",
        )

    def find_remedy(self, stops: Callable[[Self], bool]) -> str:
        """Return words for what would stop a motion that costs nothing: the fewest kinds of
        stiffness that stop the motion, such as "add torsion"; or more contacts, if no kind of
        stiffness does.

        ``stops`` is called with this lattice plus further kinds of stiffness, without static forces
        (:meth:`_stiffen`), and returns whether the motion costs energy on that lattice.
        """
        stiffness = {
            "friction": self.mindlin_ratio,
            "torsion": self.torsion,
            "bending": self.bending,
        }
        missing_names = [name for name, ratio in stiffness.items() if not np.any(ratio)]
        for count in range(1, len(missing_names) + 1):
            remedies = [
                names
                for names in itertools.combinations(missing_names, count)
                if stops(self._stiffen(names))
            ]
            if remedies:
                # of several names the last two are joined by "and"
                choices = [", ".join((*names[:-2], " and ".join(names[-2:]))) for names in remedies]
                return f"add {', or '.join(choices)}"
        return "use a lattice with more contacts"

    def _stiffen(self, names: tuple[str, ...]) -> Self:
        """Return this lattice without static forces, with a normal stiffness of one, and with
        further kinds of stiffness, ``names``, also of size one: "friction", "torsion" or "bending".
        """
        return type(self)(
            self.cell,
            self.positions,
            self.contacts,
            1.0 if "friction" in names else self.mindlin_ratio,
            masses=self.masses,
            gyration=self.gyration,
            torsion=1.0 if "torsion" in names else self.torsion,
            bending=1.0 if "bending" in names else self.bending,
            motions=self.named_motions,
            on_site=self.on_site,
        )

    # -- modes that vanish at some wave vectors ----------------------------------------------------

    def soft_mode_warnings(self, wavevectors: ArrayLike, frequencies: ArrayLike) -> tuple[str, ...]:
        """Return one sentence that counts the modes that vanish at some of the wave vectors and
        names the first of these; an empty tuple if there are none.

        Neither sound at Gamma nor the branches that vanish everywhere count.

        Parameters
        ----------
        wavevectors : (n_q, p), 1/d.
        frequencies : (n_q, n_branches), of :meth:`frequencies`, in any unit.

        Raises
        ------
        InputError : wave vectors or frequencies that are no real numbers; wave vectors of another
            shape or not finite; or another number of frequencies.
        PrecisionError : a wave vector is too far from Gamma.
        """
        q, _ = self._fold(wavevectors)
        numbers = real_array("frequencies", frequencies)
        if numbers.size != len(q) * self.n_branches:
            raise InputError(
                f"frequencies has the shape {numbers.shape}",
                mend=f"Give an array ({len(q)}, {self.n_branches})",
            )
        by_point = numbers.reshape(len(q), self.n_branches)
        counts = np.count_nonzero(by_point == 0.0, axis=1)
        if not np.any(counts):
            return ()
        is_gamma = np.all(q == 0.0, axis=1)
        n_expected = np.where(is_gamma, self._zeros_at_gamma, self.free_branches)
        n_soft = np.maximum(counts - n_expected, 0)
        if not np.any(n_soft):
            return ()
        first_point = int(np.argmax(n_soft > 0))
        unfolded_q = np.reshape(real_array("wavevectors", wavevectors), (-1, self.periods))
        count = int(n_soft.sum())
        modes_vanish = "mode vanishes" if count == 1 else "modes vanish"
        return (
            f"{count} {modes_vanish} at {np.count_nonzero(n_soft)} of {len(q)} wave vectors, the"
            f" first at {self.name_wavevector(unfolded_q[first_point])}: these motions deform no"
            " contact there",
        )

    @cached_property
    def _zeros_at_gamma(self) -> int:
        """Number of branches that are zero at Gamma because they are sound, or zero everywhere.

        On a line, the rotation of all balls about the line is sound too: the torsional wave.
        """
        direction = np.array([[0.5497, 0.6843, 0.4793]])[:, : self.periods]  # without symmetry
        # motions of the frame, as columns: displacements of all balls come first
        sound_motions = np.eye(self.n_branches, len(self.motions.translations), dtype=complex)
        if np.any(self.contacts.j[: self.n_between] == self.n_balls):
            sound_motions[:] = 0.0
        elif self.periods == 1:
            sound_motions = np.column_stack([sound_motions, self._turn_about_line()])
        sound_motions[:, self._are_anchored(sound_motions)] = 0.0
        if self._large is not None and not self.free_branches:
            return int(np.linalg.matrix_rank(sound_motions, tol=_LEAST_INDEPENDENCE))
        total = 0
        for block in self._blocks:
            zero_motions = sound_motions[block.columns]
            if block.n_free:
                _, modes = block.solve(_STEP_FROM_GAMMA * direction)
                free_motions = modes[0][:, : block.n_free]
                zero_motions = np.concatenate([zero_motions, free_motions], axis=1)
            # a motion of sound may also be free: only independent motions count
            total += int(np.linalg.matrix_rank(zero_motions, tol=_LEAST_INDEPENDENCE))
        return total

    def _are_anchored(self, motions: Complex) -> NDArray[np.bool_]:
        """Return (m,) whether springs to the ground resist each of m motions, the columns of
        ``motions`` (n_branches, m) in the coordinates of the frame of waves.
        """
        if self.on_site is None:
            return np.zeros(motions.shape[1], bool)
        of_balls = (self._to_balls @ motions).reshape(self.n_balls, -1, motions.shape[1])
        at_springs = of_balls[self.contacts.i[self.n_between :]]
        # there are springs for all named motions; rotations, which come last, are left out of the
        # motions of balls if nothing resists them
        springs = self.on_site[:, : self.motions.count]
        is_resisted = (springs[..., None] > 0.0) & (np.abs(at_springs) > _REST_AMPLITUDE)
        return np.asarray(np.any(is_resisted, axis=(0, 1)))

    def _turn_about_line(self) -> Complex:
        """Return the amplitudes (n_branches,) of the motions of the frame, of norm one, in the
        rotation of all balls as one body about the only period; zeros if no motion of the balls
        takes part.
        """
        positions = np.zeros((self.n_balls, 3))
        positions[:, : self.dimension] = self.positions
        arms = positions - self.masses @ positions / self.masses.sum()
        # an amplitude of one in the frame is a rotation phi = i, as rotations are divided by i
        shifts = 1.0j * np.cross([1.0, 0.0, 0.0], arms)
        turns = self.gyration[:, None] * np.eye(3)[:1]
        # of the six motions of a ball in space those that balls have
        columns = [*self.motions.translations, *(3 + axis for axis in self.motions.rotations)]
        motions = np.concatenate([shifts, turns], axis=1)[:, columns]
        amplitudes = (self._wave_frame.conj() * np.sqrt(self.masses)[:, None]).T @ motions
        length = max(float(np.linalg.norm(amplitudes)), np.finfo(float).tiny)
        return np.asarray(amplitudes.ravel() / length)


class _LatticeContacts(NamedTuple):
    """The contacts of a ``network`` that are contacts of its lattice, in reduced units and along
    the axes of the lattice.

    In a contact with a body that does not move, ball i is the ball that moves: where that is ball j
    of the network, the contact is swapped.

    Attributes
    ----------
    numbers : (n_c,) numbers of the contacts in the network.
    is_swapped : (n_c,) whether ball i of the network is a body that does not move.
    is_held : (n_c,) whether one of the balls is a body that does not move.
    periodic_axes : (p,) axes of the network's cell along which the network repeats.
    axes : (d, d) unit vectors, rows: the axes of the lattice.
    """

    network: ContactNetwork
    numbers: Index
    is_swapped: NDArray[np.bool_]
    is_held: NDArray[np.bool_]
    periodic_axes: Index
    axes: Array

    @classmethod
    def of(cls, network: ContactNetwork) -> _LatticeContacts:
        """Return the contacts of a ``network`` with periods."""
        numbers = np.flatnonzero(network.in_lattice)
        is_swapped = ~network.moving[network.i[numbers]]
        is_held = is_swapped | ~network.moving[network.j[numbers]]
        periodic_axes = np.flatnonzero(network.pbc)
        axes = find_axes(network.cell[periodic_axes, : network.dimension])
        return cls(network, numbers, is_swapped, is_held, periodic_axes, axes)

    def turn(self, vectors: Array) -> Array:
        """Return the components (n, d) along the axes of the lattice of ``vectors`` (n, 3)."""
        return np.asarray(vectors[:, : self.network.dimension] @ self.axes.T)

    def _orient(self, vectors: Array) -> Array:
        """Return ``vectors`` of all contacts of the network, from ball i to ball j, as vectors
        (n_c, d) from ball i to ball j of the lattice, along its axes.
        """
        oriented_vectors = self.turn(vectors[self.numbers])
        oriented_vectors[self.is_swapped] *= -1.0
        return oriented_vectors

    def _order_ends(self, at_i: Array, at_j: Array) -> tuple[Array, Array]:
        """Return the values at balls i and at balls j of the lattice, (n_c,) each, from the values
        ``at_i`` and ``at_j`` of all contacts of the network.
        """
        at_i = at_i[self.numbers]
        at_j = at_j[self.numbers]
        return np.where(self.is_swapped, at_j, at_i), np.where(self.is_swapped, at_i, at_j)

    def tabulate(self) -> ContactTable:
        """Return the table of the contacts, in diameters. Balls are numbered among those that move,
        and the next number stands for all bodies that do not move.
        """
        network = self.network
        length = network.scales.length
        count = int(np.count_nonzero(network.moving))
        number = np.full(network.n_balls, count)
        number[network.moving] = np.arange(count)
        ball_i = number[network.i[self.numbers]]
        ball_j = number[network.j[self.numbers]]
        i = np.where(self.is_swapped, ball_j, ball_i)
        j = np.where(self.is_swapped, ball_i, ball_j)
        arm_i, arm_j = self._order_ends(network.arm_i, network.arm_j)
        # a body that does not move has no phase
        shift = network.shift[self.numbers][:, self.periodic_axes]
        shift[self.is_held] = 0
        vector = self._orient(network.vector) / length
        vector[self.is_held] = 0.0
        normal = self._orient(network.normal)
        return freeze_contacts(i, j, shift, normal, vector, arm_i / length, arm_j / length)

    def list_arguments(self, n_springs: int) -> dict[str, Any]:
        """Return the arguments of :class:`ContactLattice`, by name, that have a value for each
        contact, and behind these one for each of ``n_springs`` springs to the ground.
        """
        network = self.network
        units = network.scales
        numbers = self.numbers
        normal_stiffness = network.normal_stiffness[numbers]
        rotational_unit = normal_stiffness * units.length**2  # of torques over angles

        def extend(values: Array, spring_value: float = 0.0) -> Array:
            """Return ``values`` (n_c, ...) of contacts, followed by ``spring_value`` for each of
            the n_g springs to the ground, (n_c + n_g, ...).
            """
            shape = (n_springs, *values.shape[1:])
            return np.concatenate([values, np.full(shape, spring_value)])

        arguments: dict[str, Any] = {
            "mindlin_ratio": extend(network.shear_stiffness[numbers] / normal_stiffness),
            # the stiffness one of a spring multiplies that of on_site
            "stiffness": extend(normal_stiffness / units.stiffness, 1.0),
            "torsion": extend(network.torsion_stiffness[numbers] / rotational_unit),
            "bending": extend(network.bending_stiffness[numbers] / rotational_unit),
            "tangential_growth": extend(network.tangential_growth[numbers] * units.length),
            "lever_excesses": np.array([extend(at_end) for at_end in self.find_excesses()]),
            "slip_stretch": extend(network.slip_stretch[numbers]),
            "arm_rates": extend(network.arm_rates[numbers]),
            "distance": extend(network.distance[numbers] / units.length, 1.0),
        }
        if network.prestress:
            arguments["prestress"] = extend(self.find_prestress())
            arguments["tangential_force"] = extend(self.find_tangential_forces())
            arguments["contact_torque"] = extend(self.find_torques())
        return arguments

    def find_prestress(self) -> Array:
        """Return the compressive forces over the distances of the centres (n_c,), in units of k."""
        pushes = self.network.static_forces[0][self.numbers]
        distance = self.network.distance[self.numbers]
        return np.asarray(pushes / distance / self.network.scales.stiffness)

    def find_tangential_forces(self) -> Array:
        """Return the static tangential forces (n_c, d) of balls i on balls j, in units of k d."""
        return self._orient(self.network.static_forces[1]) / self.network.scales.force

    def find_torques(self) -> Array:
        """Return the static torques (n_c, 3) of balls i on balls j, in units of k d^2; zeros in a
        plane, where torques act on no motion.
        """
        units = self.network.scales
        torque = self.network.contact_torque
        if torque is None or self.network.dimension < 3:
            return np.zeros((len(self.numbers), 3))
        return self._orient(torque) / (units.force * units.length)

    def find_excesses(self) -> Array:
        """Return by how much the levers of slip exceed the arms, d, at balls i and at balls j,
        (2, n_c).
        """
        excesses = self.network.lever_excesses
        if excesses is None:
            return np.zeros((2, len(self.numbers)))
        return np.array(self._order_ends(*excesses)) / self.network.scales.length


def _find_springs(network: ContactNetwork, axes: Array, motions: Motions) -> tuple[Index, Array]:
    """Return the numbers (n_g,), among the balls that move, of those that springs to the ground
    hold, and the stiffnesses (n_g, motions) of these springs, in the network's unit of stiffness.

    The rows of ``axes`` (d, d) are the axes of the lattice, along which the ``motions`` are.
    """
    springs = turn_on_site(find_anchors(network), axes, motions)
    if springs is None:
        return np.zeros(0, np.intp), np.zeros((0, motions.count))
    of_moving = springs[network.moving] / network.scales.stiffness
    anchored_balls = np.flatnonzero(np.any(of_moving, axis=1))
    return anchored_balls, of_moving[anchored_balls]


def _add_springs(table: ContactTable, balls: Index, ground: int) -> ContactTable:
    """Return a ``table`` of contacts, followed by one contact for each of the ``balls`` (n_g,) that
    springs hold: with ball number ``ground``, a body that does not move. Without such balls the
    table itself is returned.
    """
    count = len(balls)
    if not count:
        return table
    d = table.normal.shape[1]
    normal = np.zeros((count, d))
    normal[:, 0] = 1.0  # any unit vector, as no row of a spring to the ground contains its normal
    return freeze_contacts(
        np.append(table.i, balls),
        np.append(table.j, np.full(count, ground)),
        np.pad(table.shift, ((0, count), (0, 0))),
        np.concatenate([table.normal, normal]),
        np.pad(table.vector, ((0, count), (0, 0))),
        np.pad(table.arm_i, (0, count)),
        np.pad(table.arm_j, (0, count)),
    )


def _find_members(groups: Index, group_of_branch: Index) -> Index:
    """Return the numbers (m,), ascending, of the modes that at some wave vector belong to the group
    of one of b branches there. ``groups`` (n_q, n_branches) has the group of each mode, and
    ``group_of_branch`` is (n_q, b).
    """
    is_member = [np.isin(*pair) for pair in zip(groups, group_of_branch, strict=True)]
    return np.flatnonzero(np.any(is_member, axis=0))


def _count_members(groups: Index, group_of_branch: Index) -> Index:
    """Return the number (n_q, b) of modes in the group of each branch; the arguments are those of
    :func:`_find_members`.
    """
    counts = [
        np.bincount(groups_at_q)[of_branches]
        for groups_at_q, of_branches in zip(groups, group_of_branch, strict=True)
    ]
    return np.reshape(counts, group_of_branch.shape)


def _is_almost_gamma(q: Array) -> NDArray[np.bool_]:
    """Return (n_q,) whether each wave vector q (n_q, p), 1/d, is so near to Gamma that all of its
    components are below :data:`_LIMIT_DISTANCE`, but not Gamma.
    """
    size = np.max(np.abs(q), axis=1)
    return np.asarray((size > 0.0) & (size < _LIMIT_DISTANCE))


def _sort_branches(
    frequencies: Array, vectors: NDArray[Any], velocities: Array
) -> tuple[Array, NDArray[Any], Array]:
    """Return ``frequencies`` (n_q, b), eigenvectors ``vectors`` (n_q, n, b) and ``velocities``
    (n_q, b, p), sorted by ascending frequency.
    """
    order = np.argsort(frequencies, axis=1, kind="stable")
    return (
        np.take_along_axis(frequencies, order, 1),
        np.take_along_axis(vectors, order[:, None], 2),
        np.take_along_axis(velocities, order[..., None], 1),
    )


def _follow_powers(
    q: Array, solved_q: Array, frequencies: Array, vectors: NDArray[Any], velocities: Array
) -> tuple[Array, NDArray[Any], Array]:
    """Return frequencies (n_q, b), eigenvectors (n_q, n, b) and group velocities (n_q, b, p) at
    wave vectors ``q`` (n_q, p), from those at ``solved_q`` (n_q, p), longer wave vectors of the
    same directions.

    Near Gamma the frequency of each branch is in proportion to a power of |q|: the first for sound,
    the second or third for a flexural branch, and the zeroth for others.
    """
    slope = np.einsum("qa,qba->qb", solved_q, velocities)
    # d ln(omega)/d ln|q| = q.v/omega is the power, up to rounding
    ratio = np.zeros_like(frequencies)
    np.divide(slope, frequencies, out=ratio, where=frequencies > 0.0)
    power = np.maximum(np.rint(ratio), 0.0)
    scale = (np.max(np.abs(q), axis=1) / np.max(np.abs(solved_q), axis=1))[:, None]
    frequency_scale = scale**power
    velocity_scale = scale ** np.maximum(power - 1.0, 0.0)
    return _sort_branches(
        frequencies * frequency_scale, vectors, velocities * velocity_scale[..., None]
    )
