"""Phonons of balls in contact: bands and densities of states from C(q), and force constants in a
phonopy object.
"""

from __future__ import annotations

import itertools
import math
import os
from collections.abc import Sequence
from functools import cached_property
from typing import TYPE_CHECKING, Any, Literal, NamedTuple, Self

import numpy as np
from ase import Atoms
from numpy.typing import ArrayLike

from granphon.balls.lattices import one_direction
from granphon.balls.layers import find_axes
from granphon.balls.neighbours import touch_once_at_most
from granphon.base.arrays import Array, Complex, Flags, Index
from granphon.base.errors import InputError, PrecisionError, brief, needing
from granphon.base.memory import require_memory
from granphon.base.scales import Units
from granphon.base.text import counted
from granphon.base.validation import (
    frequency_array,
    grid_numbers,
    index_array,
    one_of,
    positive,
    real_array,
    require,
    require_instance,
    truth,
    whole_number,
)
from granphon.dynamics.bloch_waves import (
    LEAST_FACTOR,
    BlochWaves,
    Couplings,
    find_bloch_waves,
    require_bloch_memory,
)
from granphon.dynamics.compatibility import MOST_BYTES, require_digits
from granphon.dynamics.contact_lattice import ContactLattice
from granphon.dynamics.damping import DampedModes, GivenLosses, Losses, damp_evenly, damp_unevenly
from granphon.dynamics.half_space import HalfSpace
from granphon.media import cost as costs
from granphon.media.cost import Cost
from granphon.media.state import State, as_state, given_state
from granphon.networks.network import given_network
from granphon.observables.validity import find_warnings
from granphon.phonons.band_edges import BandEdges, EdgeSearch, ZoneSample
from granphon.phonons.bands import Bands, ComplexBands, Onset, PhononModes
from granphon.phonons.calculator import HertzMindlin, contact_blocks
from granphon.phonons.calculator import atoms as lattice_atoms
from granphon.phonons.dos import METHODS, DensityOfStates
from granphon.phonons.paths import (
    BAND_POINTS,
    LARGEST_COUNT,
    MESHES,
    BandPath,
    check_inside,
    choose_gap_mesh,
    default_letters,
    interpolate_path,
    special_points,
)
from granphon.phonons.phonopy_atoms import OFFSET, name_atoms, place_atoms, place_in_space
from granphon.phonons.zone_mesh import ZoneMesh, find_point_group, list_half_mesh

if TYPE_CHECKING:
    from granphon.dynamics.sensitivities import FrequencySensitivities, ModeEnergies
    from granphon.phonons.phonopy_bridge import ContactPhonopy


#: greatest number of points of a mesh: phonopy's tables of more points do not fit into memory
_MOST_MESH_POINTS = 1e9
#: memory of a frequency of a density of states, bytes
_DENSITY_BYTES = 100.0
#: largest number of mesh points whose eigenvectors are held in memory at a time
_MESH_POINTS = 4096
#: largest number of components of eigenvectors that are held in memory at a time
_MESH_NUMBERS = 2**26
#: largest standard deviation of a smeared density of states, over the top frequency
_LARGEST_WIDTH = 1e6
#: number of standard deviations above the top frequency at which a smeared density of states ends
_TAIL = 5.0
#: highest frequency of an interpolated density of states, over the top frequency
_END = 1.02
#: least standard deviation of a smeared density of states by default, over the top frequency
_LEAST_WIDTH = 0.01
#: width of a gap, over the top frequency, up to which branches touch
_NO_GAP = 1e-6
#: number of points of the mesh from which an edge of a gap is sought
_STARTS = 6
#: number of points of the mesh from which the edges of every branch are sought, which may have
#: several extremes
_MORE_STARTS = 24
#: length of a vector along an axis without period, over its own, for which images do not matter
_FAR_IMAGES = 1e6
#: margin, in diameters, by which a pair of balls may be farther apart than the balls of one cell:
#: contacts across a period are about as long as a diameter
_MARGIN = 2.0
#: relative difference of a cell of Atoms from that of the state up to which it is rounding
_ROUNDING = 1e-9
#: volume of a cell, over that of a cuboid of its edges or of diameters where edges are shorter, up
#: to which the vectors do not span space
_LEAST_VOLUME = 1e-6


class _Cell(NamedTuple):
    """A cell of balls in three dimensions, for phonopy: ``vectors`` (3, 3) and ``positions``
    (n, 3), in diameters, ``masses`` (n,), and whether the balls repeat along each vector, ``pbc``
    (3,).
    """

    vectors: Array
    positions: Array
    masses: Array
    pbc: Flags

    @classmethod
    def of_lattice(cls, lattice: ContactLattice) -> Self:
        """Return the cell of a ``lattice``, which repeats along all of its periods."""
        vectors, positions = place_in_space(lattice.cell, lattice.positions)
        return cls(vectors, positions, lattice.masses, np.arange(3) < lattice.periods)

    @classmethod
    def of_atoms(cls, atoms: Atoms, periods: int) -> Self:
        """Return the cell of ``atoms``, of which the first ``periods`` vectors may be periods.

        The other vectors become perpendicular to these, and are one diameter long where the Atoms
        have none. Of the first, those along which the balls do not repeat become perpendicular to
        those along which they do.
        """
        vectors = np.array(atoms.cell)
        repeats = np.asarray(atoms.pbc[:periods], bool)
        for axis in range(periods, 3):
            # phonopy needs three vectors; across its periods the cell is one diameter thick
            if not vectors[axis].any():
                vectors[axis, axis] = 1.0
        # a vector along which nothing repeats only spans the cell. If it is perpendicular to the
        # periods, wave vectors have no component along it
        open_axes = np.flatnonzero(~repeats)
        vectors[open_axes] = _make_perpendicular(vectors[open_axes], vectors[:periods][repeats])
        vectors[periods:] = _make_perpendicular(vectors[periods:], vectors[:periods])
        return cls(vectors, atoms.positions.copy(), atoms.get_masses(), np.asarray(atoms.pbc, bool))

    @property
    def spans_space(self) -> bool:
        """Whether the vectors are as phonopy needs them, neither in one plane nor far shorter than
        a diameter.
        """
        lengths = np.maximum(np.linalg.norm(self.vectors, axis=1), 1.0)
        volume = abs(float(np.linalg.det(self.vectors)))
        return volume > _LEAST_VOLUME * float(np.prod(lengths))

    @property
    def scaled_positions(self) -> Array:
        """(n, 3) positions in fractions of the vectors."""
        return np.asarray(np.linalg.solve(self.vectors.T, self.positions.T).T)

    def put_on(self, atoms: Atoms) -> Atoms:
        """Give ``atoms`` the vectors of the cell, in place, and return them; balls keep their
        positions.
        """
        atoms.set_cell(self.vectors)
        return atoms


class Phonons:
    """Phonons of balls in a given state of contact.

    Parameters
    ----------
    state : the state of the contacts, at one load: of a packing, a crystal or a sample; or a
        :class:`~granphon.ContactNetwork` that repeats along one axis or more, which is then the
        cell. A ribbon has bands along its one period. Bodies that do not move, such as walls, hold
        the balls and have no motions.
    atoms : another cell of the same balls (a supercell, other masses, a defect) of a packing, in
        the reduced units of the state; by default one cell of the lattice.
    dim : numbers of cells of the supercell for force constants, one for each period, such as (n1,
        n2), or (n1, n2, 1); by default such that no two balls touch through two images.

    Attributes
    ----------
    state, atoms : the state (that of the network, if a network is given), and the cell of balls.
    scales : the length, stiffness and mass that convert reduced units to SI.
    lattice : the :class:`~granphon.ContactLattice` of the cell, whose compatibility matrix C(q)
        gives frequencies and velocities.
    phonopy : the :class:`ContactPhonopy` object.
    dim : numbers of cells (p,) of its supercell.

    Wave vectors are (n_q, p) or (n_q, 3), in fractions of the reciprocal cell, where p is the
    number of periods of the lattice. Methods raise InputError for no wave vector, another shape,
    numbers that are not finite, and wave vectors with a component across the periods; and
    PrecisionError for wave vectors of more than 1e15 reciprocal vectors.

    Raises
    ------
    InputError : what is no state, or a state with several loads; a network that repeats nowhere, or
        is too large for the memory; balls that do not touch; what are no Atoms; Atoms without
        masses, with a cell that is none or flat, of other scales, or otherwise refused by
        :class:`HertzMindlin`; a ``dim`` that is not whole numbers from 1 on, does not fit into
        memory, has several cells along an axis without period, or is so small that two balls would
        touch through two images.
    """

    def __init__(
        self, state: Any, atoms: Atoms | None = None, dim: Sequence[int] | None = None
    ) -> None:
        """Find the lattice of the cell, and check the arguments; frequencies are found later."""
        self.state: State = as_state(state)
        self.scales: Units = self.state.scales
        if atoms is None:
            # one cell of the lattice has the contacts of the state, so no search is needed
            self.lattice: ContactLattice = self.state.contact_lattice()
            self._cell = _Cell.of_lattice(self.lattice)
        else:
            require_instance("atoms", atoms, Atoms, "Give an ase.Atoms")
            if not np.any(atoms.cell):
                raise InputError(
                    "the Atoms have no cell",
                    "Wave vectors are fractions of its reciprocal vectors",
                    "Give the Atoms a cell of any size",
                )
            self._cell = _Cell.of_atoms(atoms, self.state.reference_lattice.periods)
            self.atoms = self._cell.put_on(atoms.copy())
            self.lattice = self.calculator.contact_lattice(self.atoms)
        if not self._cell.spans_space:
            raise InputError(
                "the cell of the Atoms is flat",
                "A vector across the periods lies along them, or is next to zero",
                "Set this vector to zero",
            )
        if not len(self.lattice.contacts):
            raise InputError(
                "no two of these balls touch",
                "They are apart, or are turned against the lattice of the state",
            )
        self.dim = self._read_dim(dim)

    @cached_property
    def atoms(self) -> Atoms:
        """The cell of balls as an ``ase.Atoms``, with a vector along each axis: the Atoms that were
        given, or those that :func:`~granphon.atoms` makes of the state.
        """
        return self._cell.put_on(lattice_atoms(self.state))

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
        """The calculator of the state. Raises :class:`~granphon.base.errors.InputError` for the
        state of a network, which has no contact law.
        """
        return HertzMindlin(given_state(self.state))

    @property
    def _periods(self) -> int:
        """Number p of periods of the lattice: 1, 2 or 3."""
        return self.lattice.periods

    @property
    def _repeats(self) -> Flags:
        """(p,) whether the cell repeats along each of the periods of the lattice."""
        return self._cell.pbc[: self._periods]

    def _read_dim(self, requested: Sequence[int] | None) -> tuple[int, ...]:
        """Return the numbers of cells (p,) in the supercell of phonopy: those ``requested``, or if
        None is given those of :meth:`_choose_dim`.

        Raises :class:`~granphon.base.errors.InputError` for what is not a whole number from 1 on
        for each period, and for a supercell that is too small, that does not fit into memory, or
        that has several cells along an axis without period.
        """
        if requested is None:
            return self._choose_dim()
        p = self._periods
        example = " ".join(map(str, _pad((3,) * p)))
        dim = grid_numbers("dim", requested, 1, LARGEST_COUNT, example, p)
        has_several_cells = np.array(dim) > 1
        if np.any(has_several_cells & ~self._repeats):
            raise InputError(
                f"dim is {requested!r}",
                "An axis that is not periodic has one cell",
                "Give 1 for it",
            )
        dim_text = " x ".join(map(str, dim))
        cells = counted(dim[0], "cell") if p == 1 else f"{dim_text} cells"
        if not touch_once_at_most(self._image_cell, dim, self._longest_contact):
            raise InputError(
                f"a supercell of {cells} is too small",
                "Two balls would touch through more than one image, and their contacts could not be"
                " told apart",
                f"Use more cells: {' x '.join(map(str, self._choose_dim()))} would do",
            )
        memory = costs.force_constants(dim, self.lattice.n_balls).working
        require_memory(f"force constants of a supercell of {cells}", memory, "Take a smaller dim")
        return dim

    def _choose_dim(self) -> tuple[int, ...]:
        """Return numbers of cells (p,) of a supercell in which two balls touch at most once.

        From one cell on, the shortest side is lengthened by a cell until that is so. These are the
        fewest cells if the vectors are perpendicular; of a skewed cell there may be fewer. If the
        cell has one ball and repeats along all periods, all numbers are the largest of these, so
        that the supercell keeps the symmetry of the lattice.
        """
        p = self._periods
        cell = self._image_cell
        numbers = [1] * p
        lengths = np.linalg.norm(cell, axis=1)
        while not touch_once_at_most(cell, tuple(numbers), self._longest_contact):
            # lengthen the shortest side, so that the sides stay about equal
            shortest = int(np.argmin(numbers * lengths))
            numbers[shortest] += 1
        if self.lattice.n_balls == 1 and np.all(self._repeats):
            return (max(numbers),) * p
        return tuple(numbers)

    @property
    def _longest_contact(self) -> float:
        """The greatest distance of two atoms of phonopy whose balls touch, in diameters."""
        longest = float(np.linalg.norm(self.lattice.contacts.vector, axis=1).max())
        if self.lattice.motions.atoms_per_ball > 1:  # second atoms are a little beside their balls
            longest += 2.0 * float(np.linalg.norm(OFFSET))
        return longest

    @property
    def _image_cell(self) -> Array:
        """(p, d) vectors between images of a ball, in diameters.

        Along an axis without period there are no images; its vector is made very long, so that
        images are too far away to matter.
        """
        return np.where(self._repeats[:, None], self.lattice.cell, _FAR_IMAGES * self.lattice.cell)

    def _require_mesh(self, numbers: tuple[int, ...]) -> None:
        """Raise :class:`~granphon.base.errors.InputError` if modes on a mesh of ``numbers`` (p,) of
        wave vectors do not fit into the memory of this machine.
        """
        cost = costs.density_of_states(numbers, self.lattice.n_branches)
        mesh_text = " x ".join(map(str, numbers))
        memory = cost.working + cost.kept
        require_memory(
            f"modes on a mesh of {mesh_text} wave vectors", memory, "Take fewer wave vectors (mesh)"
        )

    def _require_state_cell(self, with_stiffness: bool = False) -> None:
        """Raise :class:`~granphon.base.errors.InputError` unless the lattice has the contacts of
        the state, in their order, and with ``with_stiffness`` also its masses and stiffnesses.
        """
        arrays_of_state = _list_arrays(self.state.contact_lattice(), with_stiffness)
        arrays = _list_arrays(self.lattice, with_stiffness)
        for array, expected in zip(arrays, arrays_of_state, strict=True):
            has_shape = array.shape == expected.shape
            if not has_shape or not np.allclose(expected, array, rtol=_ROUNDING, atol=_ROUNDING):
                raise InputError(
                    "the Atoms are another cell than that of the state",
                    mend="Leave atoms out, or give a network",
                )

    # -- phonopy -----------------------------------------------------------------------------------

    @cached_property
    def phonopy(self) -> ContactPhonopy:
        """Phonopy object in reduced units (frequencies in (k/M)^1/2), with symmetry off.

        Its force constants are those of the contacts. The documentation lists which of its methods
        may be used; methods that would give a wrong answer raise
        :class:`~granphon.base.errors.UnsupportedError`. Raises
        :class:`~granphon.base.errors.MissingPackageError` if phonopy is not installed.

        Up to three motions of a ball are the coordinates of one atom, (u_x, u_y, w) in the plane
        and (w_x, w_y, u_z) out of it. Coordinates without a motion give flat branches at zero. A
        ball of six motions is two atoms: "Fe" holds u, and "Sn", a little beside the ball, holds w.
        The eigenvector of the second atom has the phase of its own position: it lacks the factor
        exp(i q.offset) that it would have at the ball.
        """
        with needing("A phonopy object"):
            from phonopy.structure.atoms import PhonopyAtoms

            from granphon.phonons.phonopy_bridge import ContactPhonopy

        motions = self.lattice.motions
        unit_cell = PhonopyAtoms(
            symbols=name_atoms(self._cell.masses, motions, self.state.kinds),
            cell=self._lengthen_open_axes(),
            masses=np.repeat(self._cell.masses, motions.atoms_per_ball),
            positions=place_atoms(self._cell.positions, motions),
        )
        bridge = ContactPhonopy(
            unit_cell,
            np.diag(_pad(self.dim)),
            primitive_matrix="P",
            is_symmetry=False,
            log_level=0,
        )
        bridge.unit_conversion_factor = 1.0
        numbers = _number_images(bridge, self.dim)
        bridge.give_force_constants(self._sum_force_constants(numbers))
        return bridge

    def _lengthen_open_axes(self) -> Array:
        """Return the vectors (3, 3) of the cell, in diameters, so long along axes without period
        that images are farther than the balls of the cell.

        Phonopy has no open boundaries, and divides the force constants of a pair among its nearest
        images, which must not include images that do not exist.
        """
        cell = self._cell.vectors.copy()
        extents = np.ptp(self._cell.positions, axis=0)
        is_period = np.arange(3) < self._periods
        lengths = np.linalg.norm(cell, axis=1)
        # balls that are apart by no more than half of a vector across the periods are no farther
        # from each other than from each other's images
        is_open = np.where(is_period, ~self._cell.pbc, extents > 0.5 * lengths)
        extent = float(extents[is_period | is_open].sum())
        for axis in np.flatnonzero(is_open):
            # beyond twice the greatest distance of a pair, images are farther than the pair
            cell[axis] *= 1.0 + np.ceil(2.0 * (extent + _MARGIN) / lengths[axis])
        return cell

    def _sum_force_constants(self, numbers: Index) -> Array:
        """Return the force constants (n_a, N_a, 3, 3), k, between the n_a atoms of the cell and the
        N_a of the supercell, summed over contacts.

        ``numbers`` (n_a, n1, ...) are the numbers of the images of each atom, as
        :func:`_number_images` returns them.
        """
        table = self.lattice.contacts
        blocks = contact_blocks(self.lattice)
        per_ball = self.lattice.motions.atoms_per_ball
        # number n stands for bodies that do not move, which are no atoms
        is_free = table.j < self.lattice.n_balls
        is_contact = np.ones(len(table), bool)
        # cells (n_c, p) of the supercell: the first, that of ball j as seen from ball i, and that
        # of ball i as seen from ball j
        home = np.zeros_like(table.shift)
        away = table.shift % self.dim
        back = -table.shift % self.dim
        constants = np.zeros((len(numbers), numbers.size, 3, 3))

        def add(
            chosen: Flags, rows: tuple[Index, int], columns: tuple[Index, int], cell: Index
        ) -> None:
            """Add to ``constants`` the blocks, between two atoms of each contact, of the contacts
            for which ``chosen`` (n_c,) is true.

            ``rows`` and ``columns`` are the two atoms: their numbers (n_c,) in the cell, and the
            number of the atom among the atoms of a contact. The image of the second atom is in the
            ``cell`` (n_c, p) of the supercell.
            """
            first, first_in_contact = rows
            second, second_in_contact = columns
            images = numbers[(second[chosen], *cell[chosen].T)]
            row = slice(3 * first_in_contact, 3 * first_in_contact + 3)
            column = slice(3 * second_in_contact, 3 * second_in_contact + 3)
            np.add.at(constants, (first[chosen], images), blocks[chosen, row, column])

        for a, b in itertools.product(range(per_ball), repeat=2):  # the atoms of a ball
            # atoms a and b of both balls, each with its number in the cell and in the contact
            i_a = (per_ball * table.i + a, a)
            i_b = (per_ball * table.i + b, b)
            j_a = (per_ball * table.j + a, per_ball + a)
            j_b = (per_ball * table.j + b, per_ball + b)
            add(is_contact, i_a, i_b, home)
            add(is_free, j_a, j_b, home)
            add(is_free, i_a, j_b, away)
            add(is_free, j_a, i_b, back)
        return constants

    def _find_warnings(self, wavevectors: Array, frequencies: Array) -> tuple[str, ...]:
        """Return the warnings on the state, and on branches and single modes that cost nothing,
        among ``frequencies`` (n_q, n_branches) at ``wavevectors`` (n_q, p).
        """
        soft = self.lattice.soft_mode_warnings(wavevectors, frequencies)
        return (*find_warnings(self.state), *self.lattice.free_branch_warnings, *soft)

    # -- spectra -----------------------------------------------------------------------------------

    def frequencies(self, qpoints: ArrayLike) -> Array:
        """Return frequencies (n_q, n_branches), Hz, ascending, at ``qpoints`` (n_q, p) or (n_q, 3).

        ``qpoints`` are fractions of the reciprocal cell. There is a branch for each motion of each
        ball of the cell.

        Raises :class:`~granphon.base.errors.InputError` for results that do not fit into memory,
        and :class:`~granphon.base.errors.InstabilityError` if a squared frequency is negative.
        :class:`Phonons` says which wave vectors are refused.
        """
        q = self.lattice.wavevectors(_read_qpoints(qpoints, self._periods))
        return self.lattice.frequencies(q) * self.scales.frequency

    def damped(
        self,
        qpoints: ArrayLike,
        damping: Any = 0.0,
        loss_factor: Any = 0.0,
        *,
        drag: Any = 0.0,
        dashpot: Any = 0.0,
        restitution: Any = 1.0,
    ) -> DampedModes:
        """Return the complex frequencies (n_q, n_branches), Hz, of modes at ``qpoints`` with
        contacts that lose energy, from which Q factors follow.

        Parameters
        ----------
        qpoints : (n_q, p) or (n_q, 3) fractions of the reciprocal cell.
        damping, loss_factor, drag, dashpot, restitution : losses of the contacts and balls of the
            network, as in :meth:`gp.Waves.response`.

        Raises
        ------
        InputError : a loss is out of range, no number, or of another shape; the contacts of the
            Atoms are not those of the state, in their order; their masses or stiffnesses are not,
            and a ``dashpot`` or ``restitution`` is given, whose times c/k follow from those of the
            state; the state is that of simulated samples, which have networks of their own; or the
            frequencies do not fit into memory. :class:`Phonons` says which wave vectors are
            refused.
        InstabilityError : a squared frequency is negative.
        PrecisionError : losses are not the same everywhere, and dashpots or drag resist far more
            than springs; an InputError too.
        """
        points = _read_qpoints(qpoints, self._periods)
        network = given_network(self.state)
        given = GivenLosses(damping, loss_factor, drag, dashpot, restitution)
        losses = Losses.of(network, given)
        has_viscosity = bool(np.any(losses.dashpot) or np.any(losses.tsuji))
        self._require_state_cell(with_stiffness=has_viscosity)
        q = self.lattice.wavevectors(points)
        undamped = self.lattice.frequencies(q)
        angular_unit = self.scales.angular_frequency
        even_losses = losses.find_even()
        if even_losses is not None:
            eta, time, rate = even_losses
            damped = damp_evenly(undamped, eta, time * angular_unit, rate / angular_unit)
            omega = np.sort(damped)
        else:
            in_lattice = network.in_lattice
            times = losses.times[:, in_lattice] * angular_unit
            drags = losses.drag_of(self.lattice.motions) / angular_unit
            stiffness, viscous = self.lattice.damped_matrices(
                q, times, losses.factors[:, in_lattice], drags
            )
            omega, _ = damp_unevenly(stiffness, viscous)
        unit = self.scales.frequency
        highest = float(np.max(undamped, initial=0.0)) * unit
        warnings = losses.find_warnings(highest)
        return DampedModes(omega * unit, qpoints=points, warnings=warnings)

    def modes(self, qpoints: ArrayLike, direction: ArrayLike | None = None) -> PhononModes:
        """Return frequencies (Hz), eigenvectors, group velocities (m/s) and polarisations at
        ``qpoints``.

        ``qpoints`` (n_q, p) or (n_q, 3) are fractions of the reciprocal cell. Where branches touch,
        at Gamma, and where a frequency is zero, the result is the limit along ``direction``, (p,)
        or (n_q, p), Cartesian and of any length. The direction is by default that of q, and is
        required at Gamma.

        Raises :class:`~granphon.base.errors.InputError` for Gamma without a direction, for a
        direction that is zero, not finite or of another shape, and for results that do not fit into
        memory; and :class:`~granphon.base.errors.InstabilityError` if a squared frequency is
        negative. :class:`Phonons` says which wave vectors are refused.
        """
        q = self.lattice.wavevectors(_read_qpoints(qpoints, self._periods))
        modes = self.lattice.modes(q, direction)
        scales = self.scales
        return PhononModes(
            wavevectors=modes.wavevectors / scales.length,
            frequencies=modes.frequencies * scales.frequency,
            eigenvectors=modes.eigenvectors,
            group_velocities=modes.group_velocities * scales.velocity,
            rotational_fraction=modes.rotational_fraction,
            longitudinal_fraction=modes.longitudinal_fraction,
            out_of_plane_fraction=modes.out_of_plane_fraction,
        )

    def sensitivities(
        self, qpoints: ArrayLike, branches: ArrayLike | None = None
    ) -> FrequencySensitivities:
        """Return the derivatives of frequencies (n_q, b) with respect to the stiffnesses and static
        forces of all contacts, and the masses and moments of inertia of all balls.

        Parameters
        ----------
        qpoints : (n_q, p) or (n_q, 3) fractions of the reciprocal cell.
        branches : (b,) numbers of branches, from 0; all of them by default.

        If branches have one frequency, to 1e-8 of it, the derivatives are those of their mean. The
        relative error of the derivatives of a frequency f is about 1e-16 times the top frequency
        over f.

        Raises
        ------
        InputError : a branch does not exist or is named twice, ``branches`` are empty, the arrays
            are larger than the memory, the Atoms are another cell than that of the state, or the
            state is that of simulated samples. :class:`Phonons` says which wave vectors are
            refused.
        InstabilityError : a squared frequency is negative.
        """
        q = self.lattice.wavevectors(_read_qpoints(qpoints, self._periods))
        chosen = np.arange(self.lattice.n_branches)
        if branches is not None:
            chosen = index_array("branches", branches, chosen.size, "branches")
        energies = self._find_mode_energies(q, np.broadcast_to(chosen, (len(q), chosen.size)))
        return self._make_sensitivities(energies)

    def _find_mode_energies(self, q: Array, branches: Index) -> ModeEnergies:
        """Return the energies of the modes of ``branches`` (n_q, b) at wave vectors q (n_q, p),
        1/d, along the axes of the network.

        Raises :class:`~granphon.base.errors.InputError` if the Atoms are another cell than that of
        the state.
        """
        self._require_state_cell(with_stiffness=True)
        network = given_network(self.state)
        frame = find_axes(network.cell[network.pbc, : network.dimension])
        return self.lattice.mode_energies(q, branches, frame.T)

    def _make_sensitivities(
        self, energies: ModeEnergies, qpoints: Array | None = None
    ) -> FrequencySensitivities:
        """Return the derivatives of frequencies, in SI, from the ``energies`` of their modes.

        ``qpoints`` (n_q, b, 3) are the wave vectors, if these differ from frequency to frequency.
        """
        # frequencies alone do not need the derivatives
        from granphon.dynamics.sensitivities import Place, find_frequency_sensitivities

        network = given_network(self.state)
        balls = np.flatnonzero(network.moving)
        place = Place(network, self.scales, balls, np.flatnonzero(network.in_lattice))
        warnings = find_warnings(self.state)
        return find_frequency_sensitivities(energies, place, warnings, qpoints)

    @property
    def special_points(self) -> dict[str, Array]:
        """Special points of the Brillouin zone of the cell, keyed by ASE's letters, in fractions of
        the reciprocal cell.
        """
        return special_points(self._lattice_vectors, self._repeats.tolist())

    @property
    def _lattice_vectors(self) -> Array:
        """(p, p) vectors of the cell along the periods, as rows, in diameters."""
        return self._cell.vectors[: self._periods, : self._periods]

    def bands(
        self,
        path: str | ArrayLike | Sequence[ArrayLike] | None = None,
        npoints: int = BAND_POINTS,
        labels: Sequence[str] | None = None,
        eigenvectors: bool = True,
    ) -> Bands:
        """Return the band structure along a path.

        Parameters
        ----------
        path : letters of :attr:`special_points` ("GKMG"; a comma where the path jumps) or corners
            in fractions of the reciprocal cell; by default that of the lattice
            (:func:`~granphon.phonons.paths.default_letters`): GKMG for a hexagonal cell, GXMG for a
            square cell, GXWKGL in fcc, and GX for a cell that repeats along one axis.
        npoints : number of points in each segment, with both ends.
        labels : names of the corners; by default the letters, or the coordinates.
        eigenvectors : whether to find eigenvectors and group velocities, from which the fractions
            of energy, and thus colours in figures, follow. In a large cell frequencies alone take a
            fifth of the time and next to no memory, see :meth:`estimate`.

        Raises
        ------
        InputError : :func:`~granphon.phonons.paths.interpolate_path` refuses the path,
            ``npoints`` or the labels, ``eigenvectors`` is not true or false, or the bands are too
            large for the memory.
        PrecisionError : a corner is more than 1e15 reciprocal vectors from Gamma.
        InstabilityError : a squared frequency is negative.
        """
        has_eigenvectors = require("eigenvectors", truth, eigenvectors)
        chosen_path: Any = path
        if path is None:
            chosen_path = default_letters(self._lattice_vectors, self._repeats.tolist())
        letters = self.special_points if isinstance(chosen_path, str) else {}
        segments, names = interpolate_path(chosen_path, npoints, letters, labels, self._periods)
        shape = segments.shape[:2]  # numbers of segments and of points of each
        b = self.lattice.n_branches
        # (segments, points, periods), 1/d
        wavevectors = self.lattice.wavevectors(segments)
        q = wavevectors.reshape(-1, self._periods)
        self._require_memory_of_bands(len(q), has_eigenvectors)
        velocities = None
        vectors = None
        if has_eigenvectors:
            modes = self.lattice.modes(q, _directions_along(wavevectors))
            frequencies = modes.frequencies
            vectors = modes.eigenvectors.reshape(*shape, b, b)
            velocities = modes.group_velocities.reshape(*shape, b, -1) * self.scales.velocity
        else:
            frequencies = self.lattice.frequencies(q)
        return Bands(
            qpoints=segments,
            distances=_distances_along(wavevectors),
            frequencies=frequencies.reshape(*shape, b) * self.scales.frequency,
            group_velocities=velocities,
            eigenvectors=vectors,
            labels=names,
            cell=self._cell.vectors,
            positions=self._cell.scaled_positions,
            masses=self._cell.masses,
            scales=self.scales,
            warnings=self._find_warnings(q, frequencies),
            motions=self.lattice.motions,
            pbc=tuple(self._repeats.tolist()),
            kinds=self.state.kinds,
            gyration=self.lattice.gyration,
        )

    def _require_memory_of_bands(self, points: int, eigenvectors: bool) -> None:
        """Raise :class:`~granphon.base.errors.InputError` if bands at ``points`` wave vectors do
        not fit into memory, or, where ``eigenvectors`` is true, if eigenvectors take more than
        :data:`MOST_BYTES`.
        """
        b = self.lattice.n_branches
        without = ", or eigenvectors=False" if eigenvectors else ""
        mend = f"Give fewer npoints or segments{without}"
        size = 16 * points * b * b  # bytes of complex numbers
        if eigenvectors and size > MOST_BYTES:
            raise InputError(
                f"{b} eigenvectors at {points} wave vectors take {size / 2**30:.3g} GiB of memory",
                f"Bands of more than {MOST_BYTES >> 30} GiB are not made",
                mend,
            )
        cost = costs.bands(points, b, eigenvectors, file=False)
        # what one wave vector takes does not depend on their number
        require_memory(
            f"bands of {b:,} branches at one wave vector",
            cost.working,
            f"Take a cell of fewer balls{without}",
        )
        memory = cost.working + cost.kept
        require_memory(f"bands of {b:,} branches at {points:,} wave vectors", memory, mend)

    def estimate(self, points: int, eigenvectors: bool = True) -> Cost:
        """Return the expected cost, on one processor of this machine, of bands at ``points`` wave
        vectors, with or without ``eigenvectors``.

        The attribute :attr:`~granphon.media.cost.Cost.text` of the result says the cost in words;
        ``memory`` is in bytes, and ``seconds`` is the time of the processor. For cells with
        hundreds of branches the time is extrapolated from that of a small matrix. Raises
        :class:`~granphon.base.errors.InputError` for ``points`` that is no whole number from 1 to
        1e9, and for ``eigenvectors`` that is not true or false.
        """
        count = whole_number("points", points, 1, LARGEST_COUNT)
        has_eigenvectors = require("eigenvectors", truth, eigenvectors)
        return costs.bands(count, self.lattice.n_branches, has_eigenvectors, file=False)

    def complex_bands(
        self,
        frequencies: ArrayLike,
        axis: Any = 0,
        q: ArrayLike = (),
        *,
        damping: Any = 0.0,
        loss_factor: Any = 0.0,
        drag: Any = 0.0,
        dashpot: Any = 0.0,
        restitution: Any = 1.0,
    ) -> ComplexBands:
        """Return the wavenumbers, across the layers of the crystal, of all waves at given
        frequencies, with those of waves that decay.

        Parameters
        ----------
        frequencies : (n_f,) Hz, above zero.
        axis : the axis across the layers, as for :meth:`ContactNetwork.cut`.
        q : (p - 1,) wave vector along the layers, in fractions of their reciprocal cell; zero by
            default.
        damping, loss_factor, drag, dashpot, restitution : losses of the contacts and balls, as in
            :meth:`Waves.response`; numbers, or, but for the restitution, tuples of two.

        Raises
        ------
        PrecisionError : a frequency is at the very edge of a band, or so high that a wave decays by
            more than 1e12 from layer to layer; some motions are passed on to the next layers across
            the axis and no further; or ``q`` is more than 1e15 reciprocal vectors.
        InputError : the Atoms are another cell than that of the state; the state is that of
            simulated samples; the ``axis`` has no period or no contacts across it; the motions
            deform no contact; a number is not allowed, or of another shape; the waves do not fit
            into memory; or under prestress there are static tangential forces or torques, or slip
            by levers that exceed the arms.
        """
        network = given_network(self.state)
        self._require_state_cell(with_stiffness=True)
        hertz = frequency_array("frequencies", frequencies, "above zero", in_order=False)
        half_space = HalfSpace(network, axis)
        given = GivenLosses(damping, loss_factor, drag, dashpot, restitution)
        losses = Losses.of(half_space.cut, given)
        wavevector = half_space.read_wavevector(q)
        require_digits(wavevector)
        blocks = _couple_layers(half_space, wavevector, hertz, losses)
        squares = (hertz / half_space.units.frequency) ** 2
        # far above all bands the factor by which a wave decays from layer to layer is about the
        # couplings over omega^2
        is_far = squares * LEAST_FACTOR > np.max(np.abs(blocks.inner))
        _require_slow_decay(hertz, is_far)
        motions_of_layer = half_space.size // half_space.reach
        waves = find_bloch_waves(blocks, squares, motions_of_layer)
        _require_slow_decay(
            hertz, [_decays_too_fast(upward, downward) for upward, downward in waves]
        )
        return ComplexBands(
            frequencies=hertz,
            wavenumbers=_list_wavenumbers(half_space, waves, wavevector),
            running=np.array([upward.n_running for upward, _ in waves]),
            height=half_space.height,
            warnings=losses.find_warnings(float(np.max(hertz))),
        )

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
        mesh : numbers of wave vectors of a Gamma-centred mesh along each period, such as (n1, n2),
            or (n1, n2, 1); by default 1024, 64 x 64, or 32 x 32 x 32. The symmetry of the lattice
            reduces the mesh.
        method : "tetrahedron" (linear interpolation), or "smearing" with a Gaussian.
        sigma : standard deviation of the Gaussian, Hz, not below the spacing of the frequencies,
            and up to a million times the top frequency; by default a hundredth of the top
            frequency, or more if there are few ``points``.
        points : number of frequencies, 12 or more, from zero to just above the top frequency; with
            smearing, to five standard deviations above it.

        Raises :class:`~granphon.base.errors.InputError` for numbers out of range or too large for
        the memory, for another ``method``, for a ``sigma`` with the tetrahedron method, and if
        every branch vanishes; and :class:`~granphon.base.errors.InstabilityError` if a squared
        frequency is negative.
        """
        numbers = self._read_mesh(mesh)
        chosen_method = one_of("method", method, METHODS)
        if chosen_method == "tetrahedron" and sigma is not None:
            raise InputError("sigma is for the smearing method only", mend="Give method='smearing'")
        count = whole_number("points", points, 12, LARGEST_COUNT)
        self._require_memory_of_dos(numbers, count)
        top = self.lattice.top_frequency
        if top == 0.0:
            raise InputError(
                "every branch vanishes", "The motions deform no contact", "Use friction or bending"
            )
        width = None
        if chosen_method == "smearing":
            width = self._read_smearing(sigma, top, count)
        grid = self._make_mesh(numbers)
        q = self.lattice.wavevectors(grid.qpoints)
        frequencies, rotation = self._find_modes_on(q)
        shares = np.stack([1.0 - rotation, rotation])  # (2, n_q, n_branches)
        if width is None:
            omega = np.linspace(0.0, _END * top, count)
            densities = self._interpolate_density(grid, omega, frequencies, shares)
        else:
            omega = np.linspace(0.0, top + _TAIL * width, count)
            # the integral of a Gaussian, times the number of points of the mesh
            norm = np.prod(numbers) * np.sqrt(2.0 * np.pi) * width
            densities = _smear(omega, frequencies, shares * grid.weights[:, None] / norm, width)
        # densities of modes of a cell per reduced frequency become those of a ball per Hz
        translational, rotational = densities / (self.lattice.n_balls * self.scales.frequency)
        return DensityOfStates(
            frequencies=omega * self.scales.frequency,
            translational=translational,
            rotational=rotational,
            method=chosen_method,
            mesh=numbers,
            warnings=self._find_warnings(q, frequencies),
        )

    def _read_mesh(self, mesh: Sequence[int] | None) -> tuple[int, ...]:
        """Return the numbers of wave vectors (p,) of the ``mesh`` of a density of states, or those
        of :data:`MESHES` if it is None.

        Raises :class:`~granphon.base.errors.InputError` for anything but whole numbers from 1 to
        1e9.
        """
        p = self._periods
        example = " ".join(map(str, _pad((64,) * p)))
        requested = MESHES[p - 1] if mesh is None else mesh
        return grid_numbers("mesh", requested, 1, LARGEST_COUNT, example, p)

    def _require_memory_of_dos(self, numbers: tuple[int, ...], count: int) -> None:
        """Raise :class:`~granphon.base.errors.InputError` if a density of states on a mesh of
        ``numbers`` (p,) wave vectors, at ``count`` frequencies, does not fit into memory.
        """
        if np.prod(numbers, dtype=float) > _MOST_MESH_POINTS:
            raise InputError(
                f"a mesh of {' x '.join(map(str, numbers))} wave vectors is too large",
                mend=f"Take {_MOST_MESH_POINTS:.0e} at most in all",
            )
        self._require_mesh(numbers)
        require_memory(
            f"densities of states at {count:,} points", _DENSITY_BYTES * count, "Give fewer points"
        )

    def _find_modes_on(self, q: Array) -> tuple[Array, Array]:
        """Return the frequencies, (k/M)^1/2, and the rotational fractions of the kinetic energy of
        all modes, both (n_q, n_branches), at wave vectors q (n_q, p), 1/d, a part of them at a
        time.
        """
        b = self.lattice.n_branches
        batch_size = min(_MESH_POINTS, max(1, _MESH_NUMBERS // b**2))
        n_batches = math.ceil(len(q) / batch_size)
        # any direction will do: the rotational fractions of degenerate modes have the same sum
        direction = np.eye(self._periods)[0]
        frequencies = np.empty((len(q), b))
        rotation = np.empty((len(q), b))
        for batch in np.array_split(np.arange(len(q)), n_batches):
            modes = self.lattice.modes(q[batch], direction)
            frequencies[batch] = modes.frequencies
            rotation[batch] = modes.rotational_fraction
        return frequencies, rotation

    def _interpolate_density(
        self, grid: ZoneMesh, omega: Array, frequencies: Array, shares: Array
    ) -> Array:
        """Return densities of states (2, n) at ``omega`` (n,) by linear interpolation of the
        ``frequencies`` (n_q, n_branches) at the points of ``grid``, weighted with ``shares``
        (2, n_q, n_branches).

        Each density is the mean over the interval around its frequency, that is, a difference of
        the integrated density over the width of the interval. So van Hove singularities stay
        finite, and the trapezoidal sum over all frequencies is exactly the number of modes.
        """
        edges = np.concatenate([omega[:1], 0.5 * (omega[1:] + omega[:-1]), omega[-1:]])
        integrated = grid.count_modes(self.lattice.reciprocal, frequencies, shares, edges)
        integrated[:, 0] = 0.0  # modes at zero belong to the first interval
        return np.diff(integrated, axis=1) / np.diff(edges)

    def _read_smearing(self, sigma: float | None, top: float, count: int) -> float:
        """Return the standard deviation, (k/M)^1/2, of the Gaussians of a density of states.

        ``sigma``, Hz, is the requested standard deviation. If it is None, the width is a hundredth
        of the ``top`` frequency, (k/M)^1/2, or more if ``count`` frequencies do not resolve that.
        Raises :class:`~granphon.base.errors.InputError` for a ``sigma`` that is no number above
        zero, is below the spacing of the frequencies, or far above the top frequency.
        """
        if sigma is None:
            # with few frequencies the width is a little above their spacing, w = (top + 5 w)/(count
            # - 1), which is top/(count - 6)
            return max(_LEAST_WIDTH, 1.0 / (count - 7)) * top
        width = positive("sigma", sigma, "Hz") / self.scales.frequency
        if width > _LARGEST_WIDTH * top:
            raise InputError(
                f"sigma = {brief(sigma)} Hz is more than {_LARGEST_WIDTH:.0e} times the top"
                " frequency",
                "Nothing would be left of the density of states",
                "Lower sigma",
            )
        spacing = (top + _TAIL * width) / (count - 1)
        if width < spacing:
            raise InputError(
                f"sigma = {sigma!r} Hz is below the spacing of {count} points",
                mend="Raise sigma, or take more points",
            )
        return width

    def gaps(self, mesh: Sequence[int] | None = None) -> Array:
        """Return the gaps, (n, 2) Hz, ascending: intervals between zero and the top frequency in
        which no branch lies.

        The edges of bands are sought on a mesh of the whole zone and at its special points, and
        from the best of these points along group velocities. If something holds the balls, the
        interval below the lowest branch is a gap too. Intervals narrower than a millionth of the
        top frequency are no gaps: there branches touch.

        Parameters
        ----------
        mesh : numbers of wave vectors along each period, from Gamma; by default 256, 48 x 48, or 16
            x 16 x 16. As the zone of a cell of more than 16 balls is small, its mesh has fewer
            points by a factor of 4 over the number of balls, but at least two along each period.

        Raises
        ------
        InputError : the mesh is not whole numbers from 1 on, or does not fit into memory.
        InstabilityError : a squared frequency is negative.
        """
        _, gaps = self.find_gaps(mesh)
        return gaps

    def onset(self, direction: ArrayLike | None = None) -> Onset:
        """Return the frequency and the curvature of each branch at Gamma, and the gap below all
        branches.

        If springs to the ground hold the balls, there is no sound: bands begin at a cut-off
        frequency, from which omega rises in proportion to the square of q.

        Parameters
        ----------
        direction : (p,) Cartesian, of any length, along which the curvatures are; by default x.

        Raises :class:`~granphon.base.errors.InputError` for a direction that is zero, not finite or
        of another shape, and for a cell of so many balls that the search for the gap does not fit
        into memory; and :class:`~granphon.base.errors.InstabilityError` if a squared frequency is
        negative.
        """
        axis = np.eye(self._periods)[0] if direction is None else direction
        along = one_direction(axis, self._periods)
        frequencies, curvatures = self.lattice.find_onset(along)
        scales = self.scales
        # branches that vanish everywhere have a gap above them that begins at zero too
        lowest_gaps = self._find_gap_edges(None, only_from_zero=True)
        has_gap = len(lowest_gaps.branches_below) > 0 and lowest_gaps.branches_below[0] == 0
        return Onset(
            frequencies * scales.frequency,
            curvatures * scales.velocity * scales.length,
            along,
            float(lowest_gaps.frequencies[0, 1]) * scales.frequency if has_gap else 0.0,
        )

    def find_gaps(self, mesh: Sequence[int] | None = None) -> tuple[Index, Array]:
        """Return the number of branches below each gap, (n,), and the gaps (n, 2), Hz, of
        :meth:`gaps`, with the same ``mesh`` and errors. By the number of branches a gap is found
        again when the load changes.
        """
        gaps = self._find_gap_edges(mesh)
        return gaps.branches_below, gaps.frequencies * self.scales.frequency

    def gap_sensitivities(self, mesh: Sequence[int] | None = None) -> FrequencySensitivities:
        """Return the derivatives of the edges (n, 2) of :meth:`gaps`, with the same ``mesh``, as
        :meth:`sensitivities` returns those of frequencies, and the wave vectors of the edges. The
        errors are those of both.

        An edge is the greatest or the least frequency of a branch, so that a change of its wave
        vector does not matter to first order. If several wave vectors have the frequency of the
        edge, such as those that the symmetry of the lattice makes equivalent, the derivative is
        that at one of them. This is the derivative of the edge if the change of the parameters
        keeps the symmetry. The lower edge of a gap below all branches is zero, and has no
        derivative.
        """
        from granphon.dynamics.sensitivities import ModeEnergies

        gaps = self._find_gap_edges(mesh)
        count = len(gaps.branches_below)
        branches = gaps.branches_below[:, None] + np.array([-1, 0])  # below and above each gap
        if not count:
            no_edges = np.zeros((0, 2))
            motions = np.zeros((0, 2, self.lattice.n_balls, self.lattice.motions.count))
            energies = ModeEnergies(no_edges, no_edges > 0.0, {}, motions)
            return self._make_sensitivities(energies, np.zeros((0, 2, 3)))
        has_edge = branches >= 0
        points = gaps.points.reshape(-1, self._periods)
        energies = self._find_mode_energies(points, np.maximum(branches, 0).reshape(-1, 1))
        by_edge = energies.reshape((count, 2))
        energies_of_edges = by_edge._replace(
            frequencies=np.where(has_edge, by_edge.frequencies, 0.0)
        )
        qpoints = np.zeros((count, 2, 3))
        qpoints[..., : self._periods] = gaps.points @ np.linalg.inv(self.lattice.reciprocal)
        return self._make_sensitivities(energies_of_edges, qpoints)

    def _find_gap_edges(self, mesh: Sequence[int] | None, *, only_from_zero: bool = False) -> _Gaps:
        """Return the gaps and their edges in reduced units; ``mesh`` is that of :meth:`gaps`.

        With ``only_from_zero`` only the gap that begins at zero is sought.
        """
        zone = self._sample_zone(mesh)
        frequencies = zone.frequencies
        bottoms = frequencies.min(axis=0)
        tops = frequencies.max(axis=0)
        floors = _find_floors(tops)
        narrowest = _NO_GAP * float(tops[-1])
        is_open = bottoms - floors > narrowest
        if only_from_zero:
            is_open &= floors == 0.0
        above_gaps = np.flatnonzero(is_open)
        if not above_gaps.size:
            return _Gaps(above_gaps, np.zeros((0, 2)), np.zeros((0, 2, self._periods)))
        edges = BandEdges.of(above_gaps)
        extremes = EdgeSearch(self.lattice, zone).find(edges, _STARTS)
        lower, upper = edges.pair(edges.sign * extremes.heights)
        intervals = np.stack([np.maximum(lower, floors[above_gaps]), upper], axis=1)
        is_gap = upper - lower > narrowest
        points_of_edges = np.stack(edges.pair(extremes.points), axis=1)
        return _Gaps(above_gaps[is_gap], intervals[is_gap], points_of_edges[is_gap])

    def cutoffs(self, mesh: Sequence[int] | None = None) -> Array:
        """Return the cut-off frequencies, (n_branches, 2) Hz: the lowest and the highest frequency
        of each branch in the whole zone. At each wave vector branches are ordered by frequency.

        Cut-offs are sought as the edges of :meth:`gaps`, with the same ``mesh`` and errors, but
        from more points of the mesh. The cut-off of a branch inside other bands may lie where the
        branch crosses its neighbour along a line, or in a hollow narrower than the mesh. Cut-offs
        of crystals in space were found short by up to 5e-3 of the top frequency.
        """
        cutoffs, _ = self._find_cutoffs(mesh)
        return cutoffs

    def find_cutoff_points(self, mesh: Sequence[int] | None = None) -> Array:
        """Return the wave vectors (n_branches, 2, p), fractions of the reciprocal cell, at which
        the cut-off frequencies of :meth:`cutoffs` are, with the same ``mesh`` and errors.
        """
        _, points = self._find_cutoffs(mesh)
        return points @ np.linalg.inv(self.lattice.reciprocal)

    def _find_cutoffs(self, mesh: Sequence[int] | None) -> tuple[Array, Array]:
        """Return the cut-off frequencies (n_branches, 2), Hz, and their wave vectors
        (n_branches, 2, p), 1/d; ``mesh`` is that of :meth:`gaps`.
        """
        zone = self._sample_zone(mesh)
        b = self.lattice.n_branches
        search = EdgeSearch(self.lattice, zone)
        # the edges of the gaps below all branches, open or not, are the bottoms of all branches and
        # the tops of all but the last; the top of the last is sought alone
        edges = BandEdges.of(np.arange(b))
        extremes = search.find(edges, _MORE_STARTS)
        top = search.find(BandEdges(np.array([b - 1]), np.ones(1), 0), _MORE_STARTS)
        # gap n has the top of branch n - 1 below, and the bottom of branch n above
        tops, bottoms = edges.pair(edges.sign * extremes.heights)
        points_of_tops, points_of_bottoms = edges.pair(extremes.points)
        cutoffs = np.stack([bottoms, np.concatenate([tops[1:], top.heights])], axis=1)
        points = np.stack(
            [points_of_bottoms, np.concatenate([points_of_tops[1:], top.points])], axis=1
        )
        return np.maximum(cutoffs, 0.0) * self.scales.frequency, points

    def _sample_zone(self, mesh: Sequence[int] | None) -> ZoneSample:
        """Return the wave vectors from which edges of bands are sought, with their frequencies;
        ``mesh`` is that of :meth:`gaps`.
        """
        numbers = self._read_gap_mesh(mesh)
        points = self._list_gap_points(numbers)
        frequencies = self.lattice.frequencies(self.lattice.wavevectors(points))
        spacing = float(np.max(np.linalg.norm(self.lattice.reciprocal, axis=1) / numbers))
        return ZoneSample(points, frequencies, spacing)

    def _read_gap_mesh(self, mesh: Sequence[int] | None) -> tuple[int, ...]:
        """Return the numbers of wave vectors (p,) of the ``mesh`` on which gaps are sought, by
        default those of :func:`choose_gap_mesh`.

        Raises :class:`~granphon.base.errors.InputError` for anything but whole numbers from 1 on,
        and for a mesh that does not fit into memory.
        """
        p = self._periods
        requested = choose_gap_mesh(self.lattice.n_balls, p) if mesh is None else mesh
        example = " ".join(map(str, _pad((48,) * p)))
        numbers = grid_numbers("mesh", requested, 1, LARGEST_COUNT, example, p)
        self._require_mesh(numbers)
        return numbers

    def _list_gap_points(self, numbers: tuple[int, ...]) -> Array:
        """Return the wave vectors (n_q, p), fractions of the reciprocal cell, at which gaps are
        sought: those of a mesh of ``numbers`` (p,) in half of the zone, and the special points.
        """
        p = self._periods
        points = [point[None, :p] for point in self.special_points.values()]
        return np.concatenate([list_half_mesh(numbers), *points])

    def _make_mesh(self, numbers: tuple[int, ...]) -> ZoneMesh:
        """Return a Gamma-centred mesh of ``numbers`` (p,) of points, reduced by the point group of
        the frequencies.
        """

        def find_frequencies(fractions: Array) -> Array:
            """Return frequencies (n, n_branches) at wave vectors (n, p), fractions."""
            return self.lattice.frequencies(self.lattice.wavevectors(fractions))

        return ZoneMesh.of(numbers, find_point_group(self.atoms, self._periods, find_frequencies))

    # -- files -------------------------------------------------------------------------------------

    def save(self, path: str | os.PathLike[str] = "phonopy_params.yaml") -> None:
        """Write the force constants to the file ``path``, for Euphonic and for phonopy, whose
        command reads it without options.

        On loading, phonopy symmetrises force constants and takes frequencies for THz. Two measures
        keep the numbers right. First, a very heavy auxiliary atom at a general position completes
        the sum rule of the force constants, and lowers the symmetry to P1; it adds three flat bands
        at zero. Second, masses are scaled such that phonopy's "THz" stand for Hz, kHz, MHz or
        another such unit, in which the top frequency lies between 1 and 1000. The file names this
        unit under ``granphon``, with the scales. A ball of six motions is two atoms, as in
        :attr:`phonopy`.

        Balls of several kinds have the symbols of :func:`~granphon.atoms`; the file names the kind
        of each symbol.

        :func:`load_phonopy` reads the file back without the auxiliary atom. The folder is made if
        it does not exist.

        A file that granphon wrote is replaced; if another file is there, such as one that phonopy
        wrote, :class:`~granphon.base.errors.FileExistsInRunError` is raised. Raises
        :class:`~granphon.base.errors.InputError` for what is no path,
        :class:`~granphon.base.errors.OutputError` if the file system refuses the file,
        :class:`~granphon.base.errors.InstabilityError` if a squared frequency is negative, and
        :class:`~granphon.base.errors.MissingPackageError` if phonopy is not installed.
        """
        bridge = self.phonopy  # raises first if phonopy is not installed: the import below is safe
        from granphon.phonons.phonopy_bridge import write_phonopy

        lattice = self.lattice
        top = lattice.top_frequency * self.scales.frequency
        kinds = self.state.kinds
        write_phonopy(bridge, path, self.scales, top, lattice.motions, self._periods, kinds)


def _make_perpendicular(vectors: Array, others: Array) -> Array:
    """Return ``vectors`` (m, 3) without their components along the ``others`` (n, 3)."""
    if not len(others):
        return vectors
    return np.asarray(vectors - vectors @ np.linalg.pinv(others) @ others)


class _Gaps(NamedTuple):
    """Gaps between branches.

    Attributes
    ----------
    branches_below : (n,) number of branches below each gap.
    frequencies : (n, 2) lower and upper edge, (k/M)^1/2.
    points : (n, 2, p) wave vectors of the edges, 1/d.
    """

    branches_below: Index
    frequencies: Array
    points: Array


def _find_floors(tops: Array) -> Array:
    """Return the highest frequency (n_branches,) of all branches below each branch, zero below the
    lowest, from the highest frequency ``tops`` (n_branches,) of each.
    """
    return np.concatenate([[0.0], np.maximum.accumulate(tops)[:-1]])


def find_gaps_between(cutoffs: Array) -> tuple[Index, Array]:
    """Return the number of branches below each gap, (n,), and the gaps, (n, 2) Hz, as
    :meth:`Phonons.find_gaps` does, from the ``cutoffs`` (n_branches, 2), Hz, of all branches; no
    zone is searched.
    """
    bottoms, tops = cutoffs.T
    floors = _find_floors(tops)
    is_gap = bottoms - floors > _NO_GAP * tops[-1]
    return np.flatnonzero(is_gap), np.stack([floors, bottoms], axis=1)[is_gap]


def find_phonons(state: State, dim: tuple[int, ...] | None = None) -> Phonons:
    """Return the phonons of a ``state`` at one load, with ``dim`` of :class:`Phonons`.

    The state keeps the object, so that all spectra of the state are found from one object.
    """
    return state.cached(Phonons, None, dim)


def find_bands(state: State, path: BandPath, npoints: int) -> Bands:
    """Return the bands of a ``state`` at one load along a ``path``, with ``npoints`` points in each
    segment, as :meth:`Phonons.bands` finds them.
    """
    return find_phonons(state).bands(path.arrays, npoints, path.labels)


def _directions_along(paths: Array) -> Array:
    """Return a vector (n_s n, p) along the path at each wave vector of ``paths`` (n_s, n, p), n
    points in each of n_s segments, both in 1/d: that from the first to the last point of a segment,
    and its opposite at the last point.
    """
    n_points = paths.shape[1]
    along = np.repeat(paths[:, -1] - paths[:, 0], n_points, axis=0)
    # limits at the last point of a segment are taken from inside the segment
    along[n_points - 1 :: n_points] *= -1.0
    return along


def _distances_along(paths: Array) -> Array:
    """Return the distances (n_s, n) along the ``paths`` (n_s, n, p) of wave vectors, 1/d, n points
    in each of n_s segments, over 2 pi. The distance at the beginning of a segment is that at the
    end of the segment before.
    """
    steps = np.linalg.norm(np.diff(paths, axis=1), axis=2) / (2.0 * np.pi)
    starts = np.zeros((len(paths), 1))
    distances = np.concatenate([starts, np.cumsum(steps, axis=1)], axis=1)
    distances[1:] += np.cumsum(distances[:-1, -1])[:, None]
    return distances


def _couple_layers(space: HalfSpace, q: Array, hertz: Array, losses: Losses) -> Couplings:
    """Return the blocks of the layers of ``space`` at one wave vector q (p - 1,) along them, in
    k/M; with ``losses``, those at each of the frequencies ``hertz`` (n_f,), Hz.

    Raises :class:`~granphon.base.errors.InputError` if waves at these frequencies do not fit into
    memory.
    """
    if losses.is_none:
        require_bloch_memory(hertz.size, space.size)
        return space.couplings(q)
    require_bloch_memory(hertz.size, space.size, space.cut.n_contacts)
    blocks = space.couplings(q, losses.find_stiffness_factors(2.0 * np.pi * hertz))
    # drag acts on the motions of a block as an imaginary stiffness, -i omega gamma M
    drags = losses.drag_of(space.motions) / (2.0 * np.pi * space.units.frequency)
    of_block = np.diag(np.tile(drags, space.size // drags.size))
    reduced = hertz / space.units.frequency
    return blocks._replace(inner=blocks.inner - 1j * reduced[:, None, None] * of_block)


def _decays_too_fast(upward: BlochWaves, downward: BlochWaves) -> bool:
    """Return whether some wave at a frequency, among those towards higher layers, ``upward``, and
    those towards lower layers, ``downward``, decays by more than 1/:data:`LEAST_FACTOR` from layer
    to layer, so that its wavenumber has no digits.
    """
    decays = np.concatenate([np.abs(upward.factors), 1.0 / np.abs(downward.factors)])
    return bool(np.any(decays < LEAST_FACTOR))


def _require_slow_decay(hertz: Array, is_far: ArrayLike) -> None:
    """Raise :class:`~granphon.base.errors.PrecisionError` if at some of the frequencies ``hertz``
    (n_f,), Hz, a wave decays too much to have digits, which ``is_far`` (n_f,) says of each.
    """
    refused = hertz[np.asarray(is_far, bool)]
    if refused.size:
        raise PrecisionError(
            f"at {float(refused[0]):g} Hz a wave decays by more than {1.0 / LEAST_FACTOR:g} from"
            " layer to layer",
            "Its wavenumber would have no digits",
            "Take lower frequencies",
        )


def _list_wavenumbers(
    space: HalfSpace, waves: list[tuple[BlochWaves, BlochWaves]], along: Array
) -> Complex:
    """Return the wavenumbers (n_f, 2 m), 1/m, of ``waves`` across the layers of ``space``. The
    waves are a pair at each frequency, those towards higher and those towards lower layers;
    ``along`` (p - 1,) is their wave vector along the layers.

    The imaginary part is infinite for a motion that reaches no other layer at a frequency.
    """
    wavenumbers = np.empty((len(waves), 2, space.size), complex)
    wavenumbers[:, 0] = complex(0.0, np.inf)
    wavenumbers[:, 1] = complex(0.0, -np.inf)
    for n, upward_and_downward in enumerate(waves):
        for sense, bloch_waves in enumerate(upward_and_downward):
            of_waves = space.wavenumbers(bloch_waves.factors, along)
            of_waves[: bloch_waves.n_running].imag = 0.0  # exactly, for waves that run
            wavenumbers[n, sense, : len(of_waves)] = of_waves
    # motions that reach no other layer at any frequency are no waves
    are_waves = np.any(np.isfinite(wavenumbers), axis=(0, 1))
    return wavenumbers[:, :, are_waves].reshape(len(waves), -1)


def _number_images(bridge: ContactPhonopy, dim: tuple[int, ...]) -> Index:
    """Return the numbers (n_a, n1, ...), in the supercell of ``bridge`` of ``dim`` (n1, ...) cells,
    of the images of the n_a atoms of the cell in each of these cells.
    """
    supercell = bridge.supercell
    unit_cell = bridge.unitcell
    # number, in the cell, of the atom of which each atom of the supercell is an image
    atom = np.array([supercell.u2u_map[number] for number in supercell.s2u_map])
    offsets = supercell.positions - unit_cell.positions[atom]
    steps = np.rint(offsets @ np.linalg.inv(unit_cell.cell)).astype(int)
    cell = steps[:, : len(dim)] % dim
    numbers = np.empty((len(unit_cell), *dim), int)
    numbers[(atom, *cell.T)] = np.arange(len(atom))
    return numbers


def _list_arrays(lattice: ContactLattice, with_stiffness: bool) -> list[Array]:
    """Return a list of the arrays by which two lattices are compared: the balls i and j (n_c,) and
    the vectors (n_c, d) of the contacts of a ``lattice``, with ``with_stiffness`` also masses and
    radii of gyration (n,), stiffnesses and prestress (n_c,).
    """
    contacts = lattice.contacts
    arrays: list[Any] = [contacts.i, contacts.j, contacts.vector]
    if with_stiffness:
        arrays += [lattice.masses, lattice.gyration, lattice.stiffness, lattice.prestress]
    return arrays


def _smear(omega: Array, frequencies: Array, weights: Array, width: float) -> Array:
    """Return m sums (m, n), at the frequencies ``omega`` (n,), of Gaussians of standard deviation
    ``width`` about ``frequencies`` (n_q, n_branches), with the heights ``weights``
    (m, n_q, n_branches).

    The part of a Gaussian below zero frequency is reflected, so that no mode is lost.
    """
    sums = np.empty((len(weights), len(omega)))
    for number, frequency in enumerate(omega):
        bell = np.exp(-0.5 * ((frequency - frequencies) / width) ** 2)
        mirror_image = np.exp(-0.5 * ((frequency + frequencies) / width) ** 2)
        sums[:, number] = np.sum(weights * (bell + mirror_image), axis=(1, 2))
    return sums


def _pad(numbers: tuple[int, ...]) -> list[int]:
    """Return ``numbers`` (p,) of cells or wave vectors, followed by 1 for each other axis of
    three.
    """
    return [*numbers, *(1,) * (3 - len(numbers))]


def _read_qpoints(qpoints: ArrayLike, periods: int) -> Array:
    """Return ``qpoints`` (n, periods) or (n, 3) as (n, 3), fractions of the reciprocal cell.

    Raises :class:`~granphon.base.errors.InputError` for another shape, numbers that are not finite,
    and wave vectors with a component across the ``periods``.
    """
    q = real_array("q points", qpoints)
    has_shape = q.ndim == 2 and len(q) > 0 and q.shape[1] in (periods, 3)
    if not has_shape:
        shapes = "(n, 3)" if periods == 3 else f"(n, {periods}) or (n, 3)"
        raise InputError(f"the q points have the shape {q.shape}", mend=f"Give {shapes} fractions")
    if not np.all(np.isfinite(q)):
        raise InputError("a q point is not finite")
    padded = np.pad(q, ((0, 0), (0, 3 - q.shape[1])))
    check_inside(padded, periods, "a q point")
    return padded
