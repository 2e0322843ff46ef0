"""Phonons of balls in contact: bands and densities of states from C(q), and force constants in a phonopy object."""

from __future__ import annotations

import os
from collections.abc import Sequence
from functools import cached_property
from types import SimpleNamespace
from typing import Any, Literal

import numpy as np
from ase import Atoms
from numpy.typing import ArrayLike, NDArray
from phonopy import Phonopy
from phonopy.phonon.mesh import Mesh
from phonopy.phonon.spectrum import SmearingDOSAccumulator, TetrahedronDOSAccumulator
from phonopy.structure.atoms import PhonopyAtoms

from granphon.balls.contact_table import touch_once_at_most
from granphon.balls.lattices import BALL
from granphon.base.arguments import grid_numbers, positive, real_array, whole_number
from granphon.base.errors import InputError, brief, message
from granphon.base.scales import Units
from granphon.dynamics.modes import ContactLattice
from granphon.media.acoustics import contact_lattice
from granphon.media.state import ContactState, with_keyword
from granphon.observables.validity import validity
from granphon.phonons.bands import Bands, PhononModes
from granphon.phonons.calculator import HertzMindlin
from granphon.phonons.calculator import atoms as lattice_atoms
from granphon.phonons.dos import DensityOfStates
from granphon.phonons.force_constants import contact_blocks
from granphon.phonons.paths import LARGEST_COUNT, default_letters, interpolate_path, special_points
from granphon.phonons.phonopy_bridge import ContactPhonopy, load_phonopy, write_phonopy

__all__ = ["Bands", "ContactPhonopy", "DensityOfStates", "Phonons", "load_phonopy"]

Array = NDArray[np.float64]

#: number of mesh points whose eigenvectors are held in memory at a time
_MESH_POINTS = 4096
#: memory for the tetrahedron weights that are held at a time, bytes
_WEIGHTS = 2**26


class Phonons:
    """Phonons of balls in a given state of contact.

    Parameters
    ----------
    state : the state of the contacts, at one load.
    atoms : another cell of the same balls (a supercell, other masses, a defect), in the reduced units of the state; by
        default one cell of the lattice.
    finite_overlap : deprecated; the state says whether overlap is finite.
    dim : numbers of cells (n1, n2), or (n1, n2, 1), of the supercell for force constants; by default the fewest with which
        no two balls touch through two images.

    Attributes
    ----------
    state, atoms : the state, and the cell of balls.
    scales : the length, stiffness and mass that convert reduced units to SI.
    lattice : the :class:`~granphon.dynamics.modes.ContactLattice` of the cell, whose C(q) gives frequencies and velocities.
    phonopy : the :class:`ContactPhonopy` object.

    Raises
    ------
    InputError : a state with several loads; atoms without masses, of other scales, or otherwise refused by
        :class:`HertzMindlin`; a ``dim`` so small that two balls would touch through two images.
    MechanismError : the lattice of the state is a mechanism (``atoms`` that are given may be one).
    """

    def __init__(
        self,
        state: ContactState,
        atoms: Atoms | None = None,
        finite_overlap: bool | None = None,
        dim: Sequence[int] | None = None,
    ) -> None:
        self.state = state = with_keyword(state, finite_overlap)
        self.scales: Units = state.scales
        self.calculator = HertzMindlin(state)
        if not isinstance(atoms, Atoms | None):
            raise InputError(message(f"atoms is {atoms!r}", mend="Give an ase.Atoms"))
        self.atoms: Atoms = lattice_atoms(state) if atoms is None else atoms.copy()
        if not self.atoms.cell[2].any():
            self.atoms.cell[2, 2] = 1.0  # phonopy needs a cell in three dimensions; the layer is one diameter thick
        # one cell of the lattice has the contacts of the state, so no search is needed
        self.lattice: ContactLattice = (
            contact_lattice(state) if atoms is None else self.calculator.contact_lattice(self.atoms)
        )
        if not self.lattice.measure > 0.0:
            raise InputError(
                message(
                    "the Atoms have no cell",
                    "Wave vectors are fractions of its reciprocal vectors",
                    "Give the Atoms a cell of any size",
                )
            )
        if not len(self.lattice.contacts):
            raise InputError(
                message("no two of these balls touch", "They are apart, or are turned against the lattice of the state")
            )
        self.dim = self._choose_dim(dim)

    def _choose_dim(self, given: Sequence[int] | None) -> tuple[int, int]:
        contact = float(np.linalg.norm(self.lattice.contacts.vector, axis=1).max())
        # an axis that is not periodic has no images: a very long cell vector keeps them away
        periodic = np.asarray(self.atoms.pbc)[:2]
        cell = np.where(periodic[:, None], self.lattice.cell, 1e6 * self.lattice.cell)
        if given is not None:
            dim = grid_numbers("dim", given, LARGEST_COUNT, "3 3 1")
            if np.any((np.array(dim) > 1) & ~periodic):
                raise InputError(message(f"dim is {given!r}", "An axis that is not periodic has one cell", "Give 1 for it"))
            if not touch_once_at_most(cell, dim, contact):
                raise InputError(
                    message(
                        f"a supercell of {dim[0]} x {dim[1]} cells is too small",
                        "Two balls would touch through more than one image, and their contacts could not be told apart",
                        "Use at least {} x {}".format(*self._choose_dim(None)),
                    )
                )
            return dim
        n1 = n2 = 1
        while not touch_once_at_most(cell, (n1, n2), contact):
            # lengthen the shorter side, so that the two sides stay about equal
            if n1 * np.linalg.norm(cell[0]) <= n2 * np.linalg.norm(cell[1]):
                n1 += 1
            else:
                n2 += 1
        return (max(n1, n2),) * 2 if len(self.atoms) == 1 and np.all(periodic) else (n1, n2)

    # -- phonopy ----------------------------------------------------------------------------------------------------

    @cached_property
    def phonopy(self) -> ContactPhonopy:
        """Phonopy object in reduced units (frequencies in (k/M)^1/2), with symmetry off.

        Its force constants are those of the calculator. The documentation lists what may be done with it; methods that would
        give a wrong answer raise :class:`~granphon.base.errors.UnsupportedError`.
        """
        bridge = ContactPhonopy(
            self._make_phonopy_cell(), np.diag([*self.dim, 1]), primitive_matrix="P", is_symmetry=False, log_level=0
        )
        bridge.unit_conversion_factor = 1.0
        bridge.give_force_constants(self._compute_force_constants(bridge))
        return bridge

    def _make_phonopy_cell(self) -> PhonopyAtoms:
        cell, extent = np.array(self.atoms.cell), float(np.ptp(self.atoms.positions[:, :2], axis=0).sum())
        for axis in np.flatnonzero(~np.asarray(self.atoms.pbc)[:2]):
            # phonopy has no open boundaries and divides a pair among its nearest images: move all images far away
            cell[axis] *= 1.0 + np.ceil(2.0 * (extent + 2.0) / np.linalg.norm(cell[axis]))
        return PhonopyAtoms(
            symbols=[BALL] * len(self.atoms), cell=cell, masses=self.atoms.get_masses(), positions=self.atoms.positions
        )

    def _compute_force_constants(self, bridge: Phonopy) -> Array:
        """Force constants between balls of the cell and of phonopy's supercell, (n, n_supercell, 3, 3), units of k."""
        table, blocks = self.lattice.contacts, contact_blocks(self.lattice)
        dim = np.array(self.dim)
        # where[ball, n1, n2]: index in phonopy's supercell of the image of a ball in cell (n1, n2)
        cells, unit = bridge.supercell, bridge.unitcell
        ball = np.array([cells.u2u_map[s] for s in cells.s2u_map])
        place = np.rint((cells.positions - unit.positions[ball]) @ np.linalg.inv(unit.cell)).astype(int)[:, :2] % dim
        where = np.empty((len(self.atoms), *dim), int)
        where[ball, place[:, 0], place[:, 1]] = np.arange(len(ball))
        constants = np.zeros((len(self.atoms), len(ball), 3, 3))
        home, away, back = np.zeros_like(table.shift), table.shift % dim, -table.shift % dim
        i, j = (table.i, slice(0, 3)), (table.j, slice(3, 6))
        for (one, row), (other, column), cell in ((i, i, home), (j, j, home), (i, j, away), (j, i, back)):
            np.add.at(constants, (one, where[other, cell[:, 0], cell[:, 1]]), blocks[:, row, column])
        return constants

    @cached_property
    def _warnings(self) -> tuple[str, ...]:
        return validity(self.state).warnings

    # -- spectra ----------------------------------------------------------------------------------------------------

    def frequencies(self, qpoints: ArrayLike) -> Array:
        """Return frequencies (n_q, n_branches), Hz, ascending, at ``qpoints`` (n_q, 2 or 3).

        ``qpoints`` are fractions of the reciprocal cell.

        Raises :class:`~granphon.base.errors.InstabilityError` if a squared frequency is negative.
        """
        return self.lattice.frequencies(self.lattice.wavevectors(_check_qpoints(qpoints))) * self.scales.frequency

    def modes(self, qpoints: ArrayLike, direction: ArrayLike | None = None) -> PhononModes:
        """Return frequencies (Hz), eigenvectors, group velocities (m/s) and polarisations at ``qpoints`` (n_q, 2 or 3).

        ``qpoints`` are fractions of the reciprocal cell. Where branches touch, and at Gamma, the result is the limit along
        ``direction`` (Cartesian), which is required at Gamma.
        """
        q = self.lattice.wavevectors(_check_qpoints(qpoints))
        return PhononModes.of(self.lattice.modes(q, direction), self.scales)

    @property
    def special_points(self) -> dict[str, Array]:
        """Special points of the Brillouin zone of the cell, keyed by ASE's letters, in fractions of the reciprocal cell."""
        return special_points(self.atoms.cell[:2, :2])

    def bands(
        self,
        path: str | ArrayLike | Sequence[ArrayLike] | None = None,
        npoints: int = 101,
        labels: Sequence[str] | None = None,
    ) -> Bands:
        """Return the band structure along a path.

        Parameters
        ----------
        path : letters of :attr:`special_points` ("GKMG"; a comma where the path jumps) or corners in fractions of the
            reciprocal cell; by default around the irreducible zone (GKMG on a hexagonal cell, GXMG on a square one).
        npoints : points in each segment, both ends counted.
        labels : names of the corners; by default the letters, or the coordinates.
        """
        letters = self.special_points if path is None or isinstance(path, str) else {}
        segments, ticks = interpolate_path(default_letters(letters) if path is None else path, npoints, letters, labels)
        s, p, _ = segments.shape
        q = self.lattice.wavevectors(segments)  # (s, p, 2)
        steps = np.linalg.norm(np.diff(q, axis=1), axis=2) / (2.0 * np.pi)
        distances = np.concatenate([np.zeros((s, 1)), np.cumsum(steps, axis=1)], axis=1)
        distances[1:] += np.cumsum(distances[:-1, -1])[:, None]
        along = np.repeat(q[:, -1] - q[:, 0], p, axis=0)
        along[p - 1 :: p] *= -1.0  # at the last point of a segment the limit is taken from inside the segment
        modes = self.lattice.modes(q.reshape(-1, 2), along)
        b = self.lattice.n_branches
        return Bands(
            segments, distances, modes.frequencies.reshape(s, p, b) * self.scales.frequency,
            modes.group_velocities.reshape(s, p, b, 2) * self.scales.velocity, modes.eigenvectors.reshape(s, p, b, b),
            ticks, np.asarray(self.atoms.cell), self.atoms.get_scaled_positions(wrap=False), self.atoms.get_masses(),
            self.scales, self._warnings,
        )  # fmt: skip

    def dos(
        self,
        mesh: Sequence[int] = (64, 64),
        method: Literal["tetrahedron", "smearing"] = "tetrahedron",
        sigma: float | None = None,
        points: int = 501,
    ) -> DensityOfStates:
        """Return the density of states per ball, 1/Hz, split into translation and rotation.

        Parameters
        ----------
        mesh : (n1, n2), or (n1, n2, 1), wave vectors of a Gamma-centred mesh, which the symmetry of the layer reduces.
        method : "tetrahedron" (linear interpolation), or "smearing" with a Gaussian.
        sigma : standard deviation of the Gaussian, Hz, not below the spacing of the frequencies; by default a hundredth of
            the top frequency, or more if there are few ``points``.
        points : number of frequencies, 12 or more, from zero to just above the top frequency.
        """
        numbers = grid_numbers("mesh", mesh, LARGEST_COUNT, "64 64 1")
        if not isinstance(method, str) or method not in ("tetrahedron", "smearing"):
            raise InputError(message(f"method is {brief(method)}", mend="Use tetrahedron or smearing"))
        count = whole_number("points", points, 12, LARGEST_COUNT)
        grid = self._make_mesh(numbers)
        q = self.lattice.wavevectors(grid.qpoints)
        # any direction will do: the rotational fractions of degenerate modes have the same sum
        modes = (self.lattice.modes(some, (1.0, 0.0)) for some in np.array_split(q, -(-len(q) // _MESH_POINTS)))
        values, rotation = map(np.concatenate, zip(*((m.frequencies, m.rotational_fraction) for m in modes), strict=True))
        parts = np.stack([1.0 - rotation, rotation])  # (2, n_q, n_branches)
        top = self.lattice.top_frequency
        at = np.linspace(0.0, 1.02 * top, count)
        if method == "tetrahedron":
            if sigma is not None:
                raise InputError(message("sigma is for the smearing method only", mend="Give method='smearing'"))
            # each value is the mean over its own interval, a difference of the integrated density: van Hove singularities
            # stay finite, and the trapezoidal sum over the points is exactly the number of modes
            edges = np.concatenate([at[:1], 0.5 * (at[1:] + at[:-1]), at[-1:]])
            # phonopy holds a weight for each mode and frequency: to save memory, take some frequencies at a time
            several = np.array_split(edges, -(-8 * values.size * edges.size // _WEIGHTS))
            integrated = np.concatenate([
                TetrahedronDOSAccumulator(
                    values, grid.bz_grid, mode_property=np.moveaxis(parts, 0, -1)[None], ir_grid_points=grid.ir_grid_points,
                    ir_grid_weights=grid.weights, ir_grid_map=grid.grid_mapping_table, sampling_points=some,
                ).result.cumulative[0].T for some in several
            ], axis=1)  # fmt: skip
            integrated[:, 0] = 0.0  # modes at zero belong to the first interval
            density = np.diff(integrated, axis=1) / np.diff(edges)
        else:
            width = max(0.01, 1.0 / (count - 7)) * top
            if sigma is not None:
                width = positive("sigma", sigma, "Hz") / self.scales.frequency
            at = np.linspace(0.0, top + 5.0 * width, count)
            if width < at[1]:
                raise InputError(
                    message(
                        f"sigma = {sigma!r} Hz is below the spacing of {count} points",
                        mend="Raise sigma, or take more points",
                    )
                )
            # the part of a Gaussian below zero frequency is reflected, so that no mode is lost
            density = sum(
                SmearingDOSAccumulator(
                    side, grid.weights, mode_property=parts, sigma=width, sampling_points=at
                ).result.density
                for side in (values, -values)
            )
        density = density / (len(self.atoms) * self.scales.frequency)
        return DensityOfStates(
            at * self.scales.frequency, density[0], density[1], method, (numbers[0], numbers[1]), self._warnings
        )

    def _make_mesh(self, numbers: tuple[int, int], reduce: bool = True) -> Mesh:
        """Return a Gamma-centred mesh, reduced by the layer group if the frequencies have its symmetry."""
        dataset = self._find_layer_dataset() if reduce else None
        if dataset is not None and numbers[0] != numbers[1] and np.any(dataset.rotations[:, [0, 1], [1, 0]] != 0):
            dataset = None  # a rotation that mixes the axes does not map this mesh on itself
        symmetry = None if dataset is None else SimpleNamespace(dataset=dataset)
        return Mesh(
            self.phonopy.dynamical_matrix, [*numbers, 1], is_gamma_center=True,
            is_mesh_symmetry=dataset is not None, primitive_symmetry=symmetry,
        )  # fmt: skip

    def _find_layer_dataset(self) -> Any:
        """Return spglib's dataset of the layer group, or None if the frequencies do not have that symmetry."""
        import spglib

        scalars = [self.atoms.get_masses(), self.atoms.arrays.get("diameter_deviations", np.zeros(len(self.atoms)))]
        _, kinds = np.unique(np.stack(scalars), axis=1, return_inverse=True)
        cell = (np.asarray(self.atoms.cell), self.atoms.get_scaled_positions(wrap=True), kinds.ravel() + 1)
        try:
            dataset = spglib.get_symmetry_layerdataset(cell, aperiodic_dir=2, symprec=1e-5)
        except spglib.SpglibError:
            return None
        if dataset is None:
            return None
        # spglib knows the places of the balls, not the stiffness of contacts: compare frequencies at equivalent q points
        generic = np.array([0.1234, 0.2871, 0.0])
        images = np.einsum("rji,j->ri", dataset.rotations, generic)
        values = self.lattice.frequencies(self.lattice.wavevectors(images))
        return dataset if np.ptp(values, axis=0).max() <= 1e-10 * values.max() else None

    # -- files ------------------------------------------------------------------------------------------------------

    def save(self, path: str | os.PathLike[str] = "phonopy_params.yaml") -> None:
        """Write the force constants in a file for phonopy, whose command reads it without options, and for Euphonic.

        On loading, phonopy symmetrises force constants and takes frequencies for THz. Two measures keep the numbers right.
        One very heavy auxiliary atom at a general position takes up what the force constants lack in the sum rule, and
        lowers the symmetry to P1; it adds three flat bands at zero. Masses are scaled so that phonopy's "THz" stand for Hz,
        kHz, MHz or another such unit, in which the top frequency lies between 1 and 1000. The file names this unit under
        ``granphon``, with the scales.

        :func:`load_phonopy` reads the file back without the auxiliary atom. The folder is made if need be.
        """
        flat = 3 + len(self.atoms) * len(self.lattice.motions.still_slots)
        write_phonopy(self.phonopy, path, self.scales, self.lattice.top_frequency * self.scales.frequency, flat)


def _check_qpoints(qpoints: ArrayLike) -> Array:
    """Check that ``qpoints`` lie in the plane, and return them as (n, 3); raises :class:`InputError` if they do not."""
    q = real_array("q points", qpoints)
    if q.ndim != 2 or not len(q) or q.shape[1] not in (2, 3) or not np.all(np.isfinite(q)):
        raise InputError(message(f"the q points have the shape {q.shape}", mend="Give (n, 2) or (n, 3) finite fractions"))
    q = np.pad(q, ((0, 0), (0, 3 - q.shape[1])))
    if np.any(q[:, 2] != 0.0):
        raise InputError(message("a q point lies out of the plane", "The array is one layer", "Set the third number to 0"))
    return q
