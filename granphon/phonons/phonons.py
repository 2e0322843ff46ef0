"""Phonons of balls in contact: bands and densities of states from C(q), and force constants in a
phonopy object.
"""

from __future__ import annotations

import itertools
import os
from collections.abc import Sequence
from functools import cached_property
from typing import TYPE_CHECKING, Any, Literal

import numpy as np
from ase import Atoms
from numpy.typing import ArrayLike, NDArray

from granphon.balls.contact_table import touch_once_at_most
from granphon.base.arrays import Array, Index
from granphon.base.errors import InputError, PrecisionError, brief, needing
from granphon.base.memory import require_memory
from granphon.base.scales import Units
from granphon.base.text import counted
from granphon.base.validation import (
    frequency_array,
    grid_numbers,
    one_of,
    positive,
    real_array,
    whole_number,
)
from granphon.dynamics.bloch_waves import (
    LEAST_PART,
    BlochWaves,
    find_bloch_waves,
    require_bloch_memory,
)
from granphon.dynamics.compatibility import MOST_BYTES
from granphon.dynamics.contact_lattice import ContactLattice
from granphon.dynamics.damping import ContactDamping, DampedModes, damp_evenly, damp_unevenly
from granphon.dynamics.half_space import HalfSpace
from granphon.media import cost as costs
from granphon.media.cost import Cost
from granphon.media.state import State, as_state, given_state
from granphon.networks.network import given_network
from granphon.observables.validity import find_warnings
from granphon.phonons.bands import Bands, ComplexBands, PhononModes
from granphon.phonons.calculator import HertzMindlin, contact_blocks
from granphon.phonons.calculator import atoms as lattice_atoms
from granphon.phonons.dos import DensityOfStates
from granphon.phonons.mesh import ZoneMesh, find_point_group
from granphon.phonons.paths import (
    LARGEST_COUNT,
    MESHES,
    check_inside,
    default_letters,
    interpolate_path,
    special_points,
)
from granphon.phonons.phonopy_atoms import OFFSET, name_atoms, place_atoms

if TYPE_CHECKING:
    from granphon.phonons.phonopy_bridge import ContactPhonopy


#: balls of a cell up to which gaps are sought on the full mesh
_FEW_BALLS = 16
#: greatest number of points of a mesh: phonopy's tables of more do not fit into memory
_MOST_MESH_POINTS = 1e9
#: memory of a frequency of a density of states, bytes
_DENSITY_BYTES = 100.0
#: number of mesh points whose eigenvectors are held in memory at a time
_MESH_POINTS = 4096
#: and the number of their components
_MESH_NUMBERS = 2**26
#: largest standard deviation of a smeared density of states, over the top frequency
_WIDEST = 1e6
#: mesh on which gaps are sought, for one, two and three periods
_GAP_MESHES = ((256,), (48, 48), (16, 16, 16))
#: width of a gap, over the top frequency, up to which branches touch
_NO_GAP = 1e-6
#: gaps narrower than this part of the top frequency may be branches that cross: their edges are
#: looked at closely
_NARROW = 1e-2
#: number of points of the mesh from which an edge of a band is sought, and of steps at most
_STARTS = 6
_TURNS = 30
#: starts of these more, where the branches on both sides of a narrow gap are closest
_CLOSEST = 4
#: number of branches beyond which it is sought from fewer points, as many edges are near
_FEW_BRANCHES = 120
#: relative difference of a cell of Atoms from that of the state that is rounding
_SAME = 1e-9
#: step, 1/d, after which the frequency is that of the extremum to rounding
_LEVEL = 1e-8


class Phonons:
    """Phonons of balls in a given state of contact.

    Parameters
    ----------
    state : the state of the contacts, at one load; the state of a crystal, a sample, or a
        :class:`~granphon.ContactNetwork`, that repeats along one axis or more. The cell is the
        network: a ribbon has bands along its one period. Bodies that do not move, such as walls,
        hold the balls and have no motions.
    atoms : another cell of the same balls (a supercell, other masses, a defect) of a packing, in
        the reduced units of the state; by default one cell of the lattice.
    dim : numbers of cells of the supercell for force constants, one for each period, such as (n1,
        n2), or (n1, n2, 1); by default the fewest with which no two balls touch through two images.

    Attributes
    ----------
    state, atoms : the state (of the network, if a network is given), and the cell of balls.
    scales : the length, stiffness and mass that convert reduced units to SI.
    lattice : the :class:`~granphon.ContactLattice` of the cell, whose C(q) gives frequencies and
        velocities.
    phonopy : the :class:`ContactPhonopy` object.

    Raises
    ------
    InputError : a state with several loads; a network that repeats nowhere, has static tangential
        forces that act, or is too large for the memory; atoms without masses, of other scales, or
        otherwise refused by
        :class:`HertzMindlin`; a ``dim`` so small that two balls would touch through two images.
    """

    def __init__(
        self, state: Any, atoms: Atoms | None = None, dim: Sequence[int] | None = None
    ) -> None:
        state = as_state(state)
        self.state: State = state
        self.scales: Units = state.scales
        if not isinstance(atoms, Atoms | None):
            raise InputError(f"atoms is {atoms!r}", mend="Give an ase.Atoms")
        self.atoms: Atoms = lattice_atoms(state) if atoms is None else atoms.copy()
        for axis in range(state.reference_lattice.periods, 3):
            # phonopy needs three dimensions; the layer is one diameter thick
            if not self.atoms.cell[axis].any():
                self.atoms.cell[axis, axis] = 1.0
        if np.any(self._repeats):
            # a vector along which nothing repeats only spans the cell: if it is upright, wave
            # vectors have no component along it
            cell = self.atoms.cell.array
            open_axes = np.flatnonzero(~self._repeats)
            along = cell[np.flatnonzero(self._repeats)]
            cell[open_axes] -= cell[open_axes] @ np.linalg.pinv(along) @ along
        # one cell of the lattice has the contacts of the state, so no search is needed
        self.lattice: ContactLattice = (
            state.contact_lattice()
            if atoms is None
            else self.calculator.contact_lattice(self.atoms)
        )
        if not self.lattice.measure > 0.0:
            raise InputError(
                "the Atoms have no cell",
                "Wave vectors are fractions of its reciprocal vectors",
                "Give the Atoms a cell of any size",
            )
        if not len(self.lattice.contacts):
            raise InputError(
                "no two of these balls touch",
                "They are apart, or are turned against the lattice of the state",
            )
        self.dim = self._choose_dim(dim)

    def __repr__(self) -> str:
        lattice = self.lattice
        return (
            f"Phonons({self.state.name.removesuffix(' lattice')},"
            f" {counted(lattice.n_balls, 'ball')} in the cell,"
            f" {', '.join(lattice.motions.letters)} of each ball,"
            f" {counted(lattice.n_branches, 'branch', 'branches')}; frequencies in Hz)"
        )

    @cached_property
    def calculator(self) -> HertzMindlin:
        """The calculator of the state; a network has none
        (:class:`~granphon.base.errors.InputError`).
        """
        return HertzMindlin(given_state(self.state))

    @property
    def _periods(self) -> int:
        return self.lattice.periods

    @property
    def _repeats(self) -> NDArray[np.bool_]:
        """Along which of the periods of the lattice the cell repeats, (p,)."""
        return np.asarray(self.atoms.pbc[: self.state.reference_lattice.periods], bool)

    def _choose_dim(self, requested: Sequence[int] | None) -> tuple[int, ...]:
        """Return the numbers of cells in the supercell of phonopy, as ``requested``, or the
        smallest in which two balls touch once at most.
        """
        p = self._periods
        contact = float(np.linalg.norm(self.lattice.contacts.vector, axis=1).max())
        if self.lattice.motions.atoms_per_ball > 1:  # atoms a little aside of their balls
            contact += 2.0 * float(np.linalg.norm(OFFSET))
        # an axis that is not periodic has no images: a very long cell vector keeps them away
        periodic = np.asarray(self.atoms.pbc)[:p]
        cell = np.where(periodic[:, None], self.lattice.cell, 1e6 * self.lattice.cell)
        if requested is not None:
            example = " ".join(map(str, _pad((3,) * p)))
            dim = grid_numbers("dim", requested, 1, LARGEST_COUNT, example, p)
            if np.any((np.array(dim) > 1) & ~periodic):
                raise InputError(
                    f"dim is {requested!r}",
                    "An axis that is not periodic has one cell",
                    "Give 1 for it",
                )
            shown = " x ".join(map(str, dim))
            if not touch_once_at_most(cell, dim, contact):
                raise InputError(
                    f"a supercell of {shown} cells is too small",
                    "Two balls would touch through more than one image, and their contacts could"
                    " not be told apart",
                    f"Use at least {' x '.join(map(str, self._choose_dim(None)))}",
                )
            memory = costs.force_constants(dim, len(self.atoms)).working
            require_memory(
                f"force constants of a supercell of {shown} cells", memory, "Take a smaller dim"
            )
            return dim
        numbers = [1] * p
        lengths = np.linalg.norm(cell, axis=1)
        while not touch_once_at_most(cell, tuple(numbers), contact):
            # lengthen the shortest side, so that the sides stay about equal
            numbers[int(np.argmin(numbers * lengths))] += 1
        return (max(numbers),) * p if len(self.atoms) == 1 and np.all(periodic) else tuple(numbers)

    def _require_mesh(self, numbers: tuple[int, ...]) -> None:
        """Raise :class:`~granphon.base.errors.InputError` if modes on a mesh do not fit into the
        memory of this machine.
        """
        cost = costs.density_of_states(numbers, self.lattice.n_branches)
        shown = " x ".join(map(str, numbers))
        memory = cost.working + cost.kept
        require_memory(
            f"modes on a mesh of {shown} wave vectors", memory, "Take fewer wave vectors (mesh)"
        )

    def _require_state_cell(self, with_stiffness: bool = False) -> None:
        """Raise InputError unless the lattice has the contacts of the state, in their order; on
        request also the masses and stiffnesses of the state.
        """

        def list_arrays(lattice: ContactLattice) -> list[Array]:
            contacts = lattice.contacts
            arrays: list[Any] = [contacts.i, contacts.j, contacts.vector]
            if with_stiffness:
                arrays += [lattice.masses, lattice.gyration, lattice.stiffness, lattice.prestress]
            return arrays

        expected = list_arrays(self.state.contact_lattice())
        if not all(
            mine.shape == theirs.shape and np.allclose(theirs, mine, rtol=_SAME, atol=_SAME)
            for mine, theirs in zip(list_arrays(self.lattice), expected, strict=True)
        ):
            raise InputError(
                "the Atoms are another cell than that of the state",
                mend="Leave atoms out, or give a network",
            )

    # -- phonopy -----------------------------------------------------------------------------------

    @cached_property
    def phonopy(self) -> ContactPhonopy:
        """Phonopy object in reduced units (frequencies in (k/M)^1/2), with symmetry off.

        The calculator makes its force constants. The documentation lists what may be done with it;
        methods that would give a wrong answer raise
        :class:`~granphon.base.errors.UnsupportedError`.

        Up to three motions of a ball are the coordinates of one atom, (u_x, u_y, w) in the plane
        and (w_x, w_y, u_z) out of it. Coordinates without a motion give flat branches at zero. Six
        motions take two atoms: "Fe" holds u, and "Sn", a little aside, w. The eigenvector of the
        second has the phase of its own place, exp(i q.offset) less than the ball.
        """
        with needing("A phonopy object"):
            from phonopy.structure.atoms import PhonopyAtoms

            from granphon.phonons.phonopy_bridge import ContactPhonopy

        cell = np.array(self.atoms.cell)
        spread = np.ptp(self.atoms.positions, axis=0)
        motions = self.lattice.motions
        periods = np.arange(3) < self._periods
        open_ends = np.where(periods, ~np.asarray(self.atoms.pbc), spread > 0.5)
        for axis in np.flatnonzero(open_ends):
            # phonopy has no open boundaries and divides a pair among its nearest images: move all
            # images far away
            cell[axis] *= 1.0 + np.ceil(
                2.0 * (float(spread[periods | open_ends].sum()) + 2.0) / np.linalg.norm(cell[axis])
            )
        unit = PhonopyAtoms(
            symbols=name_atoms(self.atoms.get_masses(), motions, self.state.kinds),
            cell=cell,
            masses=np.repeat(self.atoms.get_masses(), motions.atoms_per_ball),
            positions=place_atoms(self.atoms.positions, motions),
        )
        bridge = ContactPhonopy(
            unit, np.diag(_pad(self.dim)), primitive_matrix="P", is_symmetry=False, log_level=0
        )
        bridge.unit_conversion_factor = 1.0
        table = self.lattice.contacts
        blocks = contact_blocks(self.lattice)
        dim = self.dim
        per_ball = motions.atoms_per_ball
        cells = bridge.supercell
        atom = np.array([cells.u2u_map[s] for s in cells.s2u_map])
        offsets = cells.positions - bridge.unitcell.positions[atom]
        steps = np.rint(offsets @ np.linalg.inv(unit.cell)).astype(int)
        # number[atom, n1, ...]: index in phonopy's supercell of the image of an atom in cell (n1,
        # ...)
        number = np.empty((len(unit), *dim), int)
        number[(atom, *(steps[:, : len(dim)] % dim).T)] = np.arange(len(atom))
        # force constants between atoms of the cell and of the supercell, contact by contact; a body
        # that does not move is none of these atoms
        free = table.j < self.lattice.n_balls
        constants = np.zeros((len(unit), len(atom), 3, 3))
        home = np.zeros_like(table.shift)
        away = table.shift % dim
        back = -table.shift % dim
        for a, b in itertools.product(range(per_ball), repeat=2):  # the atoms of a ball
            i_a = per_ball * table.i + a
            j_a = per_ball * table.j + a
            i_b = per_ball * table.i + b
            j_b = per_ball * table.j + b
            # rows of the atoms of balls i and j in the blocks of contacts
            at_i_a, at_i_b, at_j_a, at_j_b = (
                slice(3 * atom_of_pair, 3 * atom_of_pair + 3)
                for atom_of_pair in (a, b, per_ball + a, per_ball + b)
            )
            everywhere = np.ones(len(table), bool)
            for first, row, second, column, shift, kept in (
                (i_a, at_i_a, i_b, at_i_b, home, everywhere),
                (j_a, at_j_a, j_b, at_j_b, home, free),
                (i_a, at_i_a, j_b, at_j_b, away, free),
                (j_a, at_j_a, i_b, at_i_b, back, free),
            ):
                columns = number[(second[kept], *shift[kept].T)]
                np.add.at(constants, (first[kept], columns), blocks[kept, row, column])
        bridge.give_force_constants(constants)
        return bridge

    def _find_warnings(self, wavevectors: Array, frequencies: Array) -> tuple[str, ...]:
        """Return the warnings on the state, and on branches and single modes among ``frequencies``
        that cost nothing.
        """
        soft = self.lattice.soft_mode_warnings(wavevectors, frequencies)
        return (*find_warnings(self.state), *self.lattice.free_branch_warnings, *soft)

    # -- spectra -----------------------------------------------------------------------------------

    def frequencies(self, qpoints: ArrayLike) -> Array:
        """Return frequencies (n_q, n_branches), Hz, ascending, at ``qpoints`` (n_q, p) or (n_q, 3).

        ``qpoints`` are fractions of the reciprocal cell. There is a branch for each motion of each
        ball of the cell.

        Raises :class:`~granphon.base.errors.InstabilityError` if a squared frequency is negative.
        """
        q = self.lattice.wavevectors(_check_qpoints(qpoints, self._periods))
        return self.lattice.frequencies(q) * self.scales.frequency

    def damped(self, qpoints: ArrayLike, damping: Any = 0.0, loss_factor: Any = 0.0) -> DampedModes:
        """Return complex frequencies (n_q, n_branches), Hz, at ``qpoints``, with contacts that lose
        energy; and Q factors.

        Parameters
        ----------
        qpoints : (n_q, p) or (n_q, 3) fractions of the reciprocal cell.
        damping : s, viscosity over stiffness, a number or one for each contact of the network; or a
            tuple of two, for normal motion and for all other, as in :meth:`gp.Waves.response`.
        loss_factor : eta of the complex stiffness k (1 + i eta), a number or one for each contact,
            or a tuple of two.

        Raises :class:`~granphon.base.errors.InputError` for a damping below zero, and for Atoms
        whose contacts are not the state's, in their order;
        :class:`~granphon.base.errors.InstabilityError` if a squared frequency is negative.
        """
        points = _check_qpoints(qpoints, self._periods)
        network = given_network(self.state)
        top = self.scales.angular_frequency
        kept = network.moving[network.i] | network.moving[network.j]
        self._require_state_cell()
        q = self.lattice.wavevectors(points)
        damped = ContactDamping.of(network, damping, loss_factor)
        undamped = self.lattice.frequencies(q)
        even = damped.find_even(network)
        if even is not None:
            omega = np.sort(damp_evenly(undamped, even[0], even[1] * top))
        else:
            times = damped.times[:, kept] * top
            matrices = self.lattice.damped_matrices(q, times, damped.losses[:, kept])
            omega, _ = damp_unevenly(*matrices)
        unit = self.scales.frequency
        warnings = damped.find_warnings(float(np.max(undamped, initial=0.0)) * unit)
        return DampedModes(omega * unit, None, points, warnings)

    def modes(self, qpoints: ArrayLike, direction: ArrayLike | None = None) -> PhononModes:
        """Return frequencies (Hz), eigenvectors, group velocities (m/s) and polarisations at
        ``qpoints``.

        ``qpoints`` (n_q, p) or (n_q, 3) are fractions of the reciprocal cell. Where branches touch,
        at Gamma and wherever a mode vanishes, the result is the limit along ``direction``
        (Cartesian), which is required at Gamma.
        """
        q = self.lattice.wavevectors(_check_qpoints(qpoints, self._periods))
        modes = self.lattice.modes(q, direction)
        scales = self.scales
        return PhononModes(
            modes.wavevectors / scales.length,
            modes.frequencies * scales.frequency,
            modes.eigenvectors,
            modes.group_velocities * scales.velocity,
            modes.rotational_fraction,
            modes.longitudinal_fraction,
            modes.out_of_plane_fraction,
        )

    @property
    def special_points(self) -> dict[str, Array]:
        """Special points of the Brillouin zone of the cell, keyed by ASE's letters, in fractions of
        the reciprocal cell.
        """
        return special_points(self._lattice_vectors, self._repeats.tolist())

    @property
    def _lattice_vectors(self) -> Array:
        return np.asarray(self.atoms.cell)[: self._periods, : self._periods]

    def bands(
        self,
        path: str | ArrayLike | Sequence[ArrayLike] | None = None,
        npoints: int = 101,
        labels: Sequence[str] | None = None,
        eigenvectors: bool = True,
    ) -> Bands:
        """Return the band structure along a path.

        Parameters
        ----------
        path : letters of :attr:`special_points` ("GKMG"; a comma where the path jumps) or corners
            in fractions of the reciprocal cell; by default the lattice's own
            (:func:`~granphon.phonons.paths.default_letters`): GKMG on a hexagonal cell, GXMG on a
            square one, GXWKGL in fcc; GX of atoms that repeat along one axis.
        npoints : points in each segment, both ends counted.
        labels : names of the corners; by default the letters, or the coordinates.
        eigenvectors : whether to find eigenvectors and group velocities, from which colours and
            characters follow. In a large cell frequencies alone take a fifth of the time and next
            to no memory, see :meth:`estimate`.
        """
        letters = self.special_points if path is None or isinstance(path, str) else {}
        if path is None:
            path = default_letters(self._lattice_vectors, self._repeats.tolist())
        segments, ticks = interpolate_path(path, npoints, letters, labels, self._periods)
        s, p, _ = segments.shape
        q = self.lattice.wavevectors(segments)  # (s, p, periods)
        steps = np.linalg.norm(np.diff(q, axis=1), axis=2) / (2.0 * np.pi)
        distances = np.concatenate([np.zeros((s, 1)), np.cumsum(steps, axis=1)], axis=1)
        distances[1:] += np.cumsum(distances[:-1, -1])[:, None]
        along = np.repeat(q[:, -1] - q[:, 0], p, axis=0)
        # at the last point of a segment the limit is taken from inside the segment
        along[p - 1 :: p] *= -1.0
        b = self.lattice.n_branches
        d = self._periods
        cost = costs.bands(q.size // d, b, eigenvectors, file=False)
        mend = "Give fewer npoints or segments, or eigenvectors=False"
        size = 16 * q.size // d * b * b
        if eigenvectors and size > MOST_BYTES:
            raise InputError(
                f"{b} eigenvectors at {q.size // d} wave vectors take {size / 2**30:.3g} GiB of"
                " memory",
                f"Bands of more than {MOST_BYTES >> 30} GiB are not made",
                mend,
            )
        require_memory(
            f"bands of {b:,} branches at {q.size // d:,} wave vectors",
            cost.working + cost.kept,
            mend,
        )
        velocities = None
        vectors = None
        if eigenvectors:
            modes = self.lattice.modes(q.reshape(-1, d), along)
            values = modes.frequencies
            vectors = modes.eigenvectors.reshape(s, p, b, b)
            velocities = modes.group_velocities.reshape(s, p, b, d) * self.scales.velocity
        else:
            values = self.lattice.frequencies(q.reshape(-1, d))
        return Bands(
            segments,
            distances,
            values.reshape(s, p, b) * self.scales.frequency,
            velocities,
            vectors,
            ticks,
            np.asarray(self.atoms.cell),
            self.atoms.get_scaled_positions(wrap=False),
            self.atoms.get_masses(),
            self.scales,
            self._find_warnings(q.reshape(-1, d), values),
            self.lattice.motions,
            tuple(self._repeats.tolist()),
            self.state.kinds,
            self.lattice.gyration,
        )

    def estimate(self, points: int, eigenvectors: bool = True) -> Cost:
        """Return what bands, or frequencies, at so many wave vectors cost on one processor of this
        machine, before they do.

        :attr:`~granphon.media.cost.Cost.text` says it in words; ``memory`` is in bytes, and
        ``seconds`` is the processor's time. Of cells with hundreds of branches the time follows
        from that of a small matrix.
        """
        count = whole_number("points", points, 1, LARGEST_COUNT)
        return costs.bands(count, self.lattice.n_branches, eigenvectors, file=False)

    def complex_bands(
        self,
        frequencies: ArrayLike,
        axis: Any = 0,
        q: ArrayLike = (),
        *,
        damping: Any = 0.0,
        loss_factor: Any = 0.0,
    ) -> ComplexBands:
        """Return all wave numbers across the layers at given frequencies, also of waves that decay.

        Parameters
        ----------
        frequencies : (n_f,) Hz, above zero.
        axis : across the layers, as for :meth:`ContactNetwork.cut`; of a packing or network, not of
            other ``atoms``.
        q : (p - 1,) wave vector along the layers, in fractions of their reciprocal cell; zero by
            default.
        damping, loss_factor : viscosity of contacts over their stiffness, s, and part of the
            stiffness that loses energy at any frequency, as in :meth:`Waves.response`: numbers, or
            tuples of two, for normal and for all other motion.

        Raises :class:`~granphon.base.errors.PrecisionError` for a frequency at the very edge of a
        band, for one so high that a wave decays by more than 1e12 from layer to layer, and for an
        axis across which some motions are passed on to the next layers and no further.
        """
        network = given_network(self.state)
        self._require_state_cell(with_stiffness=True)
        hertz = frequency_array("frequencies", frequencies, "above zero", in_order=False)
        space = HalfSpace(network, axis)
        damped = ContactDamping.of(space.cut, damping, loss_factor)
        require_bloch_memory(hertz.size, space.size, 0 if damped.is_none else space.cut.n_contacts)
        along = space.read_wavevector(q)
        omega = hertz / space.units.frequency
        factors = () if damped.is_none else damped.soften(2.0 * np.pi * hertz)
        blocks = space.couplings(along, *factors)
        far = omega**2 * LEAST_PART > np.max(np.abs(blocks.inner))
        senses = list[tuple[BlochWaves, BlochWaves]]()
        if not np.any(far):
            senses = find_bloch_waves(blocks, omega**2, space.size // space.reach)
        for n, (upward, downward) in enumerate(senses):
            decays = [np.abs(upward.factors), 1.0 / np.abs(downward.factors)]
            far[n] = any(np.any(decay < LEAST_PART) for decay in decays)
        if np.any(far):
            raise PrecisionError(
                f"at {float(hertz[far][0]):g} Hz a wave decays by more than {1.0 / LEAST_PART:g}"
                " from layer to layer",
                "Its wave number would have no digits",
                "Take lower frequencies",
            )
        wavenumbers = np.empty((len(hertz), 2, space.size), complex)
        for row, pair in zip(wavenumbers, senses, strict=True):
            for half, waves, sign in zip(row, pair, (1.0, -1.0), strict=True):
                numbers = space.wavenumbers(waves.factors, along)
                numbers[: waves.running].imag = 0.0
                half[:] = complex(0.0, sign * np.inf)
                half[: len(numbers)] = numbers
        # motions that reach no other layer at any frequency are no waves
        are_waves = np.any(np.isfinite(wavenumbers), axis=(0, 1))
        flat = wavenumbers[:, :, are_waves].reshape(len(hertz), -1)
        running = np.array([upward.running for upward, _ in senses])
        warnings = damped.find_warnings(float(np.max(hertz)))
        return ComplexBands(hertz, flat, running, space.height, warnings)

    def dos(
        self,
        mesh: Sequence[int] | None = None,
        method: Literal["tetrahedron", "smearing"] = "tetrahedron",
        sigma: float | None = None,
        points: int = 501,
    ) -> DensityOfStates:
        """Return the density of states per ball, 1/Hz, split into translation and rotation.

        Parameters
        ----------
        mesh : wave vectors of a Gamma-centred mesh along each period, such as (n1, n2), or (n1, n2,
            1), which the symmetry of the lattice reduces; by default 1024, 64 x 64, or 32 x 32 x
            32.
        method : "tetrahedron" (linear interpolation), or "smearing" with a Gaussian.
        sigma : standard deviation of the Gaussian, Hz, not below the spacing of the frequencies,
            and up to a million times the top one; by default a hundredth of that, or more if there
            are few ``points``.
        points : number of frequencies, 12 or more, from zero to just above the top frequency.
        """
        p = self._periods
        example = " ".join(map(str, _pad((64,) * p)))
        requested = MESHES[p - 1] if mesh is None else mesh
        numbers = grid_numbers("mesh", requested, 1, LARGEST_COUNT, example, p)
        chosen_method = one_of("method", method, ("tetrahedron", "smearing"))
        count = whole_number("points", points, 12, LARGEST_COUNT)
        if np.prod(numbers, dtype=float) > _MOST_MESH_POINTS:
            raise InputError(
                f"a mesh of {' x '.join(map(str, numbers))} wave vectors is too large",
                mend=f"Take {_MOST_MESH_POINTS:.0e} at most in all",
            )
        self._require_mesh(numbers)
        require_memory(
            f"densities of states at {count:,} points", _DENSITY_BYTES * count, "Give fewer points"
        )
        grid = self._make_mesh(numbers)
        q = self.lattice.wavevectors(grid.qpoints)
        # any direction will do: the rotational fractions of degenerate modes have the same sum
        together = min(_MESH_POINTS, max(1, _MESH_NUMBERS // self.lattice.n_branches**2))
        values = np.empty((len(q), self.lattice.n_branches))
        rotation = np.empty_like(values)
        for rows in np.array_split(np.arange(len(q)), -(-len(q) // together)):
            modes = self.lattice.modes(q[rows], np.eye(p)[0])
            values[rows] = modes.frequencies
            rotation[rows] = modes.rotational_fraction
        parts = np.stack([1.0 - rotation, rotation])  # (2, n_q, n_branches)
        top = self.lattice.top_frequency
        if top == 0.0:
            raise InputError(
                "every branch vanishes", "The motions deform no contact", "Use friction or bending"
            )
        if chosen_method == "tetrahedron":
            if sigma is not None:
                raise InputError(
                    "sigma is for the smearing method only", mend="Give method='smearing'"
                )
            omega = np.linspace(0.0, 1.02 * top, count)
            # each value is the mean over its own interval, a difference of the integrated density:
            # van Hove singularities stay finite, and the trapezoidal sum over the points is exactly
            # the number of modes
            edges = np.concatenate([omega[:1], 0.5 * (omega[1:] + omega[:-1]), omega[-1:]])
            integrated = grid.count_modes(self.lattice.reciprocal, values, parts, edges)
            integrated[:, 0] = 0.0  # modes at zero belong to the first interval
            density = np.diff(integrated, axis=1) / np.diff(edges)
        else:
            width = self._read_width(sigma, top, count)
            omega = np.linspace(0.0, top + 5.0 * width, count)
            if width < omega[1]:
                raise InputError(
                    f"sigma = {sigma!r} Hz is below the spacing of {count} points",
                    mend="Raise sigma, or take more points",
                )
            norm = np.prod(numbers) * np.sqrt(2.0 * np.pi) * width
            density = _smear(omega, values, parts * grid.weights[:, None] / norm, width)
        density = density / (len(self.atoms) * self.scales.frequency)
        warnings = self._find_warnings(q, values)
        hertz = omega * self.scales.frequency
        translational, rotational = density
        return DensityOfStates(hertz, translational, rotational, chosen_method, numbers, warnings)

    def _read_width(self, sigma: float | None, top: float, count: int) -> float:
        """Return the standard deviation of the Gaussians of a density of states, (k/M)^1/2, from
        ``sigma``, Hz; by default the width that ``count`` frequencies up to the ``top`` resolve.
        """
        if sigma is None:
            return max(0.01, 1.0 / (count - 7)) * top
        width = positive("sigma", sigma, "Hz") / self.scales.frequency
        if width > _WIDEST * top:
            raise InputError(
                f"sigma = {brief(sigma)} Hz is more than {_WIDEST:.0e} times the top frequency",
                "Nothing would be left of the density of states",
                "Lower sigma",
            )
        return width

    def gaps(self, mesh: Sequence[int] | None = None) -> Array:
        """Return the gaps, (n, 2) Hz, ascending: intervals from zero to the top frequency in which
        no branch lies.

        The edges of bands are sought on a mesh of the whole zone and at its special points, and
        from the best of these along group velocities. If something holds the balls, the interval
        below the lowest branch counts. Intervals below a millionth of the top frequency are
        branches that touch.

        Parameters
        ----------
        mesh : numbers of wave vectors along each period, from Gamma; by default 256, 48 x 48, or 16
            x 16 x 16. The zone of a cell of more than 16 balls is small: its mesh has 4 over the
            number of balls of these points, at least two a row.
        """
        p = self._periods
        n = self.lattice.n_balls
        finer = (n / 4.0) ** (1.0 / p) if n > _FEW_BALLS else 1.0
        if mesh is None:
            mesh = [max(2, round(number / finer)) for number in _GAP_MESHES[p - 1]]
        example = " ".join(map(str, _pad((48,) * p)))
        numbers = grid_numbers("mesh", mesh, 1, LARGEST_COUNT, example, p)
        self._require_mesh(numbers)
        axes = [np.arange(number) / number for number in numbers]
        axes[0] = axes[0][: numbers[0] // 2 + 1]  # q and -q have the same frequencies
        grid = np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1).reshape(-1, p)
        q = np.concatenate([grid, *(point[None, :p] for point in self.special_points.values())])
        values = self.lattice.frequencies(self.lattice.wavevectors(q))
        low = values.min(axis=0)
        high = values.max(axis=0)
        least = _NO_GAP * float(high[-1])
        below = np.concatenate([[0.0], np.maximum.accumulate(high)[:-1]])
        gaps = np.flatnonzero(low - below > least)
        if not gaps.size:
            return np.zeros((0, 2))
        # lower and upper edges: the tops of the branches below, of which the last reaches as high
        # as any, and the bottoms
        branch = np.concatenate([gaps[gaps > 0] - 1, gaps])
        sign = np.concatenate([np.ones(np.count_nonzero(gaps > 0)), -np.ones(len(gaps))])
        several = max(1, min(_STARTS, _FEW_BRANCHES // len(low)))
        order = np.argsort(-sign * values[:, branch], axis=0, kind="stable")[:several].T
        starts = self.lattice.wavevectors(q[order]).reshape(-1, p)
        edges, several = order.shape
        reach = float(np.max(np.linalg.norm(self.lattice.reciprocal, axis=1) / numbers))
        best = self._climb(starts, np.repeat(branch, several), np.repeat(sign, several), reach)
        best = best.reshape(edges, several).max(axis=1)
        # branches that cross at a point of their own make a cone, whose tip no path along group
        # velocities reaches: both edges of a narrow gap are sought on finer meshes too
        n_lower = edges - len(gaps)
        lower_edges = np.arange(n_lower)
        upper_edges = n_lower + np.flatnonzero(gaps > 0)
        is_narrow = -best[upper_edges] - best[lower_edges] < _NARROW * float(high[-1])
        for edge in (*lower_edges[is_narrow], *upper_edges[is_narrow]):
            near = starts[edge * several : (edge + 1) * several]
            # where the branches of both edges come close, peaks may be narrower than the mesh
            below_gap = branch[edge] - (sign[edge] < 0.0)
            distance = values[:, below_gap + 1] - values[:, below_gap]
            closest = np.argsort(distance, kind="stable")[: _CLOSEST * several]
            near = np.concatenate([near, self.lattice.wavevectors(q[closest])])
            best[edge] = max(best[edge], self._zoom(near, branch[edge], sign[edge], reach))
        frequencies = sign * best
        upper = frequencies[n_lower:]
        lower = np.concatenate([np.zeros(len(gaps) - n_lower), frequencies[:n_lower]])
        intervals = np.stack([np.maximum(lower, below[gaps]), upper], axis=1)
        return np.reshape(intervals[upper - lower > least], (-1, 2)) * self.scales.frequency

    def _climb(self, starts: Array, branch: Index, sign: Array, reach: float) -> Array:
        """Return the highest frequency times ``sign`` (n,) of a ``branch`` (n,) along its group
        velocity from each of the wave vectors ``starts`` (n, p), 1/d.

        Steps are those of J. Barzilai and J. M. Borwein (IMA J. Numer. Anal. 8, 141, 1988), none
        longer than ``reach``.
        """
        q = starts.copy()
        best = np.full(len(q), -np.inf)
        last_q = q.copy()
        last_slope = np.zeros_like(q)
        going = np.arange(len(q))
        for turn in range(_TURNS):
            modes = self.lattice.modes(q[going], np.eye(q.shape[1])[0])
            row = np.arange(going.size)
            values = sign[going] * modes.frequencies[row, branch[going]]
            best[going] = np.maximum(best[going], values)
            slope = sign[going, None] * modes.group_velocities[row, branch[going]]
            size = np.linalg.norm(slope, axis=1)
            zeros = np.zeros(going.size)
            step = np.full(going.size, 0.5 * reach)
            if turn:
                moved = q[going] - last_q[going]
                bend = np.abs(np.sum(moved * (slope - last_slope[going]), axis=1))
                squared = np.sum(moved**2, axis=1)
                step = np.divide(squared * size, bend, out=zeros.copy(), where=bend > 0.0)
            step = np.minimum(step, np.where(size > 0.0, reach, 0.0))
            last_q[going] = q[going]
            last_slope[going] = slope
            q[going] += np.divide(step, size, out=zeros, where=size > 0.0)[:, None] * slope
            going = going[step > _LEVEL]
            if not going.size:
                break
        return best

    def _zoom(self, wavevectors: Array, branch: int, sign: float, reach: float) -> float:
        """Return the highest frequency times ``sign`` of a branch about wave vectors (n, p), 1/d,
        on ever finer meshes.
        """
        p = self._periods
        offsets = np.stack(np.meshgrid(*[np.linspace(-1.0, 1.0, 7)] * p), axis=-1).reshape(-1, p)
        q = wavevectors
        size = np.full(len(wavevectors), reach)
        best = -np.inf
        while size.size:
            near = q[:, None] + size[:, None, None] * offsets
            frequencies = self.lattice.frequencies(near.reshape(-1, p))[:, branch]
            values = sign * frequencies.reshape(len(q), -1)
            highest = np.argmax(values, axis=1)
            best = max(best, float(values.max()))
            q = near[np.arange(len(q)), highest]
            is_inside = np.max(np.abs(offsets[highest]), axis=1) < 1.0
            size = size * np.where(is_inside, 0.7, 0.95)
            q = q[size > _LEVEL]
            size = size[size > _LEVEL]
        return best

    def _make_mesh(self, numbers: tuple[int, ...], reduce: bool = True) -> ZoneMesh:
        """Return a Gamma-centred mesh, reduced by the point group of the frequencies."""
        lattice = self.lattice
        group = None
        if reduce:
            group = find_point_group(
                self.atoms, self._periods, lambda q: lattice.frequencies(lattice.wavevectors(q))
            )
        return ZoneMesh.of(numbers, group)

    # -- files -------------------------------------------------------------------------------------

    def save(self, path: str | os.PathLike[str] = "phonopy_params.yaml") -> None:
        """Write the force constants in a file for phonopy, whose command reads it without options,
        and for Euphonic.

        On loading, phonopy symmetrises force constants and takes frequencies for THz. Two measures
        keep the numbers right. One very heavy auxiliary atom at a general position takes up what
        the force constants lack in the sum rule, and lowers the symmetry to P1; it adds three flat
        bands at zero. A ball of six motions is two atoms, as in :attr:`phonopy`. Masses are scaled
        so that phonopy's "THz" stand for Hz, kHz, MHz or another such unit, in which the top
        frequency lies between 1 and 1000. The file names this unit under ``granphon``, with the
        scales.

        Balls of several kinds have the symbols of :func:`~granphon.atoms`; the file names the kind
        of each.

        :func:`load_phonopy` reads the file back without the auxiliary atom. The folder is made if
        need be.

        A file of granphon is replaced; if another is there, as one of phonopy's own,
        :class:`~granphon.base.errors.FileExistsInRunError` is raised.
        """
        bridge = self.phonopy
        top = self.lattice.top_frequency * self.scales.frequency
        from granphon.phonons.phonopy_bridge import write_phonopy  # by now it can be imported

        lattice = self.lattice
        kinds = self.state.kinds
        write_phonopy(bridge, path, self.scales, top, lattice.motions, self._periods, kinds)


def _smear(omega: Array, values: Array, weights: Array, width: float) -> Array:
    """Return the sums (m, n) of Gaussians of standard deviation ``width`` about frequencies
    ``values`` (n_q, n_branches), with ``weights`` (m, n_q, n_branches) as their heights, at
    ``omega`` (n,).

    The part of a Gaussian below zero frequency is reflected, so that no mode is lost.
    """
    sums = np.empty((len(weights), len(omega)))
    for n, frequency in enumerate(omega):
        bell = np.exp(-0.5 * ((frequency - values) / width) ** 2)
        reflected = np.exp(-0.5 * ((frequency + values) / width) ** 2)
        sums[:, n] = np.sum(weights * (bell + reflected), axis=(1, 2))
    return sums


def _pad(numbers: tuple[int, ...]) -> list[int]:
    """Return the numbers of cells or wave vectors along three axes."""
    return [*numbers, *(1,) * (3 - len(numbers))]


def _check_qpoints(qpoints: ArrayLike, periods: int) -> Array:
    """Check that ``qpoints`` lie in the lattice, and return them as (n, 3); raises
    :class:`InputError` if they do not.
    """
    q = real_array("q points", qpoints)
    if q.ndim != 2 or not len(q) or q.shape[1] not in (periods, 3) or not np.all(np.isfinite(q)):
        mend = "Give " + "(n, 3)" if periods == 3 else f"Give (n, {periods}) or (n, 3)"
        raise InputError(f"the q points have the shape {q.shape}", mend=f"{mend} finite fractions")
    q = np.pad(q, ((0, 0), (0, 3 - q.shape[1])))
    check_inside(q, periods, "a q point")
    return q
