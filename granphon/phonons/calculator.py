"""The ASE calculator for balls in contact, and the ``ase.Atoms`` of one cell of a lattice.

Atoms are in reduced units and carry the arrays of :mod:`granphon.array.atoms`. The reference direction of a contact is the
nearest contact vector of the lattice, so that reference positions need not be stored: slip does not change when the lattice
is moved as a whole.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, Literal, NamedTuple, overload

import numpy as np
from ase import Atoms
from ase.calculators.calculator import Calculator, all_changes
from numpy.typing import NDArray

from granphon.array.atoms import ARRAYS, FINITE, LATTICE, SAMPLE, adopt, find_kind, has_masses, has_sampled, take_arrays
from granphon.balls.contact_table import ContactTable
from granphon.balls.lattices import BALL
from granphon.balls.motions import select_motions
from granphon.base.errors import InputError, PrecisionError, message
from granphon.base.results import read_only
from granphon.base.scales import Units
from granphon.dynamics.compatibility import GYRATION
from granphon.dynamics.modes import ContactLattice
from granphon.dynamics.rows import contact_rows
from granphon.media.state import ContactState, Law, with_keyword
from granphon.phonons.force_constants import assemble
from granphon.phonons.neighbours import PairList, Pairs

if TYPE_CHECKING:
    from scipy.sparse import csr_array

__all__ = ["HertzMindlin", "atoms"]

Array = NDArray[np.float64]
#: least delta/d at which double-precision positions still hold six digits of the overlap
_LEAST_OVERLAP = 1e-10
#: greatest distance, in diameters, between the vector of a pair and a contact vector of the lattice for the pair to count as
#: that contact
_CATCH = 0.25
#: greatest rotation of the whole lattice that is accepted when energies are found. The measure is the overlap that the
#: rotation would add to contacts of fixed direction, over the overlap that they have
_TURN_PER_OVERLAP = 1e-2
#: the same when force constants are found, as added overlap over the spacing. It is larger, because positions then only tell
#: which balls touch
_TURN_PER_SPACING = 1e-4


def atoms(state: ContactState, finite_overlap: bool | None = None) -> Atoms:
    """Return one cell of the lattice in ``state`` as an ``ase.Atoms`` with :class:`HertzMindlin` attached.

    Lengths and masses are in reduced units. The cell is one diameter thick and periodic in the plane; for the triangular
    lattice it is ASE's HEX2D cell (120 degrees). With finite overlap the cell has the spacing a = d - delta. Raises
    :class:`~granphon.base.errors.InputError` if the state holds several loads. The keyword ``finite_overlap`` is deprecated:
    the state says whether overlap is finite.
    """
    state = with_keyword(state, finite_overlap)
    scales = state.scales
    lattice = state.packing.structure
    spacing = 1.0 - state.relative_overlap if state.finite_overlap else 1.0
    cell = np.eye(3)
    cell[:2, :2] = lattice.vectors * spacing
    positions = np.zeros((lattice.n_balls, 3))
    positions[:, :2] = lattice.positions * spacing
    balls = Atoms(
        [BALL] * lattice.n_balls,
        positions=positions,
        cell=cell,
        pbc=(True, True, False),
    )
    take_arrays(balls, scales, FINITE if state.finite_overlap else LATTICE)
    balls.calc = HertzMindlin(state)
    return balls


class HertzMindlin(Calculator):  # type: ignore[misc]
    """ASE calculator of one-sided Hertz-Mindlin contacts, in the reduced units of its state.

    Energy, forces and stress follow from positions and rotations. The energy of a contact is that of the state's contact law
    at the overlap of the contact, plus kappa s^2/2, where s is the slip since the reference configuration and kappa the
    shear stiffness there. Balls that are apart exert no force on each other. Stress is that of a layer one diameter thick,
    in Voigt order; multiplied by ``Units.modulus`` it is in Pa.

    In the paper's limit (the default of a state) the overlap is delta - (r - d n).n with n fixed; if the state has finite
    overlap it is ``d - |r|``. Slip is counted from the array ``slip_origin``.

    Force constants come from the state and from the arrays ``displacements`` and ``diameter_deviations``. Positions only
    tell which balls touch.

    The state of one simulated sample serves two kinds of Atoms: the sample's own ``sample.atoms()``, whose contacts have the
    law of two balls, and ``gp.atoms(state)``, whose contacts have the mean law.

    Parameters
    ----------
    state : the state of the contacts, at one load.
    finite_overlap : deprecated; the state says whether overlap is finite.

    Raises
    ------
    InputError : unknown keywords, or a state with several loads. When used: Atoms that lack masses or an array of
        :mod:`granphon.array.atoms` (:meth:`adopt` adds what is missing), or that belong to another state; balls that are
        periodic across the plane; balls that touch in directions other than those of the lattice, as when it is turned
        (allowed with ``finite_overlap`` and no friction).
    PrecisionError : when used, if delta/d < 1e-10: positions hold too few digits of the overlap.
    """

    implemented_properties = ["energy", "free_energy", "forces", "stress"]
    discard_results_on_any_change = True

    def __init__(self, state: ContactState, finite_overlap: bool | None = None, **unknown: Any) -> None:
        super().__init__(**unknown)
        self.state = state = with_keyword(state, finite_overlap)
        self.finite_overlap = state.finite_overlap
        self.scales: Units = state.scales
        self._overlap = float(state.relative_overlap)
        # delta/d up to which all balls are apart; below zero where diameters differ, as the largest balls touch first
        self._apart = state.law.least_overlap / self.scales.length
        self._eta = float(state.packing.mindlin_ratio)
        self._motions = select_motions(self._eta)
        self._spacing = 1.0 - self._overlap if self.finite_overlap else 1.0
        table = state.packing.structure.contacts
        self._directions = np.concatenate([table.normal, -table.normal])
        # with finite overlap and no friction a contact acts along the line between the balls, whatever the lattice
        self._is_free = self.finite_overlap and not self._motions.rotate
        self._near = PairList()

    def set(self, **unknown: Any) -> dict[str, Any]:
        """Raise InputError for any parameter: all that this calculator needs is in its state."""
        if unknown:
            raise InputError(message(f"HertzMindlin has no keyword {', '.join(map(repr, unknown))}"))
        return {}

    # -- ASE's protocol ---------------------------------------------------------------------------------------------

    def check_state(self, atoms: Atoms, tol: float = 1e-15) -> list[str]:
        """Return the names of what has changed since the last calculation: ASE's six properties and granphon's arrays."""
        changes: list[str] = super().check_state(atoms, tol=tol)
        if self.atoms is not None:
            old = self.atoms
            changes += [name for name in ARRAYS if not np.array_equal(old.arrays.get(name), atoms.arrays.get(name))]
            changes += ["masses"] * (has_masses(old) != has_masses(atoms))
        return changes

    def adopt(self, atoms: Atoms, like: Atoms | None = None) -> Atoms:
        """Return a copy of Atoms from elsewhere that has all that balls of this state need, and this calculator.

        The copy keeps what the Atoms have, including what was set by hand. Masses, scales and arrays of
        :mod:`granphon.array.atoms` that are missing are taken from ``like``, ball by ball. Without ``like`` they are those
        of balls of the state on the sites of its lattice, with masses (1 + deviation)^3. Positions and cell must be in units
        of the mean diameter.

        Raises :class:`~granphon.base.errors.InputError` if ``like`` has another number of balls, or if the Atoms belong to
        another state.
        """
        balls = adopt(atoms, self.scales, FINITE if self.finite_overlap else LATTICE, like)
        find_kind(balls, self.scales, self.finite_overlap)
        balls.calc = self
        return balls

    def calculate(
        self, atoms: Atoms | None = None, properties: Any = ("energy",), system_changes: Any = all_changes
    ) -> None:
        """Find the energy (units of k d^2), forces (k d) and stress (k/d) of the atoms."""
        super().calculate(atoms, properties, system_changes)
        balls: Atoms = self.atoms
        if self._overlap - self._apart < _LEAST_OVERLAP:
            raise PrecisionError(
                message(
                    f"energy, forces and stress need positions, and balls overlap by {self._overlap - self._apart:.3g} d",
                    f"Below {_LEAST_OVERLAP:g} positions hold too few digits of that",
                    "Use force constants, bands and velocities, which come from the state and stay exact",
                )
            )
        contacts = self._find_deformations(balls)
        i, j, pull = contacts.i, contacts.j, contacts.force_on_j
        n, forces = len(balls), np.zeros((len(balls), 3))
        for axis in (0, 1):
            forces[:, axis] = np.bincount(j, pull[:, axis], n) - np.bincount(i, pull[:, axis], n)
        at_i, at_j = np.bincount(i, contacts.torque_on_i, n), np.bincount(j, contacts.torque_on_j, n)
        self._torques: Array = np.asarray(at_i + at_j, float)
        energy = float(contacts.energy.sum())
        self.results = {"energy": energy, "free_energy": energy, "forces": forces}
        area = float(abs(np.linalg.det(np.asarray(balls.cell)[:2, :2])))
        if area > 0.0:
            # stress is dE/d(strain of positions and cell) over the volume, which is the area times one diameter
            virial = -np.einsum("ca,cb->ab", pull, contacts.vector) / area
            virial = 0.5 * (virial + virial.T)
            self.results["stress"] = np.array([virial[0, 0], virial[1, 1], 0.0, 0.0, 0.0, virial[0, 1]])
        elif "stress" in properties:
            raise InputError(
                message(
                    "the cell has no area in the plane",
                    "Stress is force over area",
                    "Give the cell two vectors in the plane",
                )
            )

    def get_torques(self, atoms: Atoms) -> Array:
        """Return the torque about z on each ball, -dE/dphi, (N,), in units of k d^2."""
        self.get_property("energy", atoms)
        return self._torques.copy()

    # -- contacts ---------------------------------------------------------------------------------------------------

    def _choose_law(self, balls: Atoms) -> Law:
        """Return the contact law of these balls; raises :class:`InputError` if the balls cannot belong to the state."""
        if len(self.state.samples) > 1 and has_sampled(balls):
            raise InputError(
                message(
                    f"the Atoms are of one sample, and the state is the mean over {len(self.state.samples)}",
                    "Each sample has an overlap and a stiffness of its own",
                    "Simulate that one alone: DirectSimulation(packing, shape, seed=sample.seed)",
                )
            )
        kind = find_kind(balls, self.scales, self.finite_overlap)
        own = (balls.arrays[name] for name in ARRAYS)
        if not all(np.all(np.isfinite(values)) for values in (balls.positions, np.asarray(balls.cell), *own)):
            raise InputError(
                message("the Atoms hold a number that is not finite, in positions, cell or an array that granphon added")
            )
        if np.any(np.abs(np.asarray(balls.cell)[:2, 2]) > 1e-3):
            raise InputError(message("the cell is tilted out of the plane", "The array is one layer in x and y"))
        if balls.pbc[2]:
            raise InputError(
                message("the balls are periodic across the plane", "The array is one layer", "Set pbc = (True, True, False)")
            )
        if kind == SAMPLE:
            return self.state.packing.law
        if self._apart < 0.0 and np.any(balls.arrays["diameter_deviations"]):
            raise InputError(
                message(
                    f"the Atoms have diameters of their own, and the law of {self.state.medium!r} is the mean over all",
                    "Their spread would count twice",
                    "Use a state of AveragedLattice, whose law is that of two balls, or the Atoms of a sample",
                )
            )
        return self.state.law

    def _find_pairs(self, balls: Atoms, positions: Array) -> Pairs:
        """Find the pairs of balls that are near enough to touch, each pair once."""
        largest = 1.0 + float(np.max(balls.arrays["diameter_deviations"], initial=0.0)) + _CATCH
        periodic = bool(balls.pbc[0]), bool(balls.pbc[1])
        return self._near.near(positions, np.asarray(balls.cell)[:2, :2], periodic, largest)

    def _find_normals(self, vector: Array, extra: Array, turned: float) -> tuple[Array, NDArray[np.bool_]]:
        """Find the direction of the lattice contact nearest to each pair, and whether the pair is near enough to be it.

        Raises :class:`InputError` if balls touch in another direction, or if the lattice is turned so far that contacts of
        fixed direction would overlap by ``turned`` (in diameters) more than they do.
        """
        distance = np.linalg.norm(vector, axis=1)
        if self._is_free:
            return vector / distance[:, None], np.abs(distance - self._spacing) < _CATCH
        nearest = np.argmax(vector @ self._directions.T, axis=1)
        normal = self._directions[nearest]
        near = np.linalg.norm(vector - self._spacing * normal, axis=1) < _CATCH
        reach = self._spacing + self._overlap + extra - self._apart
        astray = ~near & (distance < reach)
        touching = near & (np.einsum("ca,ca->c", vector, normal) < reach)
        across = (normal[:, 0] * vector[:, 1] - normal[:, 1] * vector[:, 0])[touching] / distance[touching]
        turn = float(np.mean(across)) if len(across) else 0.0
        if np.any(astray) or 0.5 * turn**2 > turned:
            what = f"contacts are turned against the lattice of the state, by {np.degrees(turn):.3g} degrees on average"
            if np.any(astray):
                what = "balls touch in directions that are not those of the lattice"
            raise InputError(
                message(
                    what,
                    "With friction, and in the paper's limit, contacts have the fixed directions of the lattice;"
                    " these balls are turned against the lattice, or were moved among each other",
                    "Leave them in the orientation of gp.atoms(state), or use a state of finite overlap without friction",
                )
            )
        return normal, near

    def _find_deformations(self, balls: Atoms) -> _Deformations:
        """Find the contacts that are closed at the positions of the balls, with their energies, forces and torques."""
        law = self._choose_law(balls)
        apart = law.least_overlap / self.scales.length
        i, j, _, vector = self._find_pairs(balls, balls.positions[:, :2])
        deviations, angles = balls.arrays["diameter_deviations"], balls.arrays["rotations"]
        extra = 0.5 * (deviations[i] + deviations[j])
        normal, near = self._find_normals(vector, extra, _TURN_PER_OVERLAP * (self._overlap - self._apart))
        if self.finite_overlap:
            distance = np.linalg.norm(vector, axis=1)
            axis = vector / distance[:, None]
            overlap = 1.0 + extra - distance
        else:
            axis = normal
            overlap = self._overlap + extra - (np.einsum("ca,ca->c", vector, normal) - 1.0)
        closed = near & (overlap > apart)
        i, j, vector, normal, axis = i[closed], j[closed], vector[closed], normal[closed], axis[closed]
        # reduced energy, force and stiffness are in units of k d^2, k d and k
        d, k = self.scales.length, self.scales.stiffness
        depth = overlap[closed] * d
        compression = law.force(depth) / (k * d)
        energy = law.energy(depth) / (k * d * d)
        arm_i, arm_j = (self._spacing * 0.5 * (1.0 + deviations[ball]) for ball in (i, j))
        pull = compression[:, None] * axis
        torque_i, torque_j = np.zeros(len(i)), np.zeros(len(i))
        if self._motions.rotate:
            rest = self._find_rest(balls, i, j, normal)
            origin = balls.arrays["slip_origin"][:, :2]
            moved = vector - self._spacing * normal - (origin[j] - origin[i])
            # kappa is that of the reference state: slip adds to the energy of that state
            stiffness = self._find_stiffness(law, rest.overlap)
            for row in contact_rows(rest.axis, arm_i, arm_j, self._motions, elongation=0.0, slip=self._eta):
                (x, y, turn_j), (_, _, turn_i) = row.head.T, row.tail.T
                change = x * moved[:, 0]
                change += y * moved[:, 1]
                change += turn_j * angles[j]
                change -= turn_i * angles[i]
                tension = row.stiffness * stiffness * change
                energy += 0.5 * tension * change
                pull[:, 0] -= tension * x
                pull[:, 1] -= tension * y
                torque_i += tension * turn_i
                torque_j -= tension * turn_j
        return _Deformations(i, j, vector, energy, pull, torque_i, torque_j)

    def _find_rest(self, balls: Atoms, i: Any, j: Any, normal: Array) -> _Rest:
        """Find direction, overlap and distance of each contact in the reference state.

        There balls are displaced from their sites, which are one spacing apart in the direction ``normal``. In the paper's
        limit the contact keeps the direction of the sites. The overlap is found without adding displacements to the spacing,
        where it would lose its digits.
        """
        deviations, displacements = balls.arrays["diameter_deviations"], balls.arrays["displacements"][:, :2]
        moved = displacements[j] - displacements[i]
        overlap = self._overlap + 0.5 * (deviations[i] + deviations[j])
        along = np.einsum("ca,ca->c", normal, moved)
        if not self.finite_overlap:
            return _Rest(normal, overlap - along, np.full(len(normal), self._spacing))
        vector = self._spacing * normal + moved
        distance = np.linalg.norm(vector, axis=1)
        # |r| - a for r = a n + u, without the difference of two nearly equal numbers
        farther = (2.0 * self._spacing * along + np.einsum("ca,ca->c", moved, moved)) / (distance + self._spacing)
        return _Rest(vector / distance[:, None], overlap - farther, distance)

    def _find_stiffness(self, law: Law, overlap: Array) -> Array:
        """Find the normal stiffness of contacts over that of the state; exactly 1 for its law at its overlap."""
        stiffness, other = np.ones(overlap.shape), (overlap != self._overlap) | (law is not self.state.law)
        if np.any(other):  # only where needed: the law of a simulation solves an equilibrium for each overlap
            stiffness[other] = law.stiffness(overlap[other] * self.scales.length) / self.scales.stiffness
        return stiffness

    def contact_lattice(self, atoms: Atoms) -> ContactLattice:
        """Return the harmonic :class:`~granphon.dynamics.modes.ContactLattice` of any cell of these balls, about the state.

        Its contacts are the closed contacts of the lattice between the balls of the cell. The overlap of a contact is that
        of the state, plus the mean of the two ``diameter_deviations``, less what the ``displacements`` add to the distance.
        With ``finite_overlap`` displacements also turn the contacts. Masses are those of the Atoms.
        """
        law = self._choose_law(atoms)
        deviations = atoms.arrays["diameter_deviations"]
        sites = atoms.positions[:, :2] - atoms.arrays["displacements"][:, :2]
        i, j, shift, vector = self._find_pairs(atoms, sites)
        normal, near = self._find_normals(vector, 0.5 * (deviations[i] + deviations[j]), _TURN_PER_SPACING)
        rest = self._find_rest(atoms, i, j, normal)
        closed = near & (rest.overlap > law.least_overlap / self.scales.length)
        i, j, shift, vector = i[closed], j[closed], shift[closed], vector[closed]
        axis, overlap, distance = (values[closed] for values in rest)
        d, k = self.scales.length, self.scales.stiffness
        prestress = np.zeros(len(i))
        if self.finite_overlap:
            prestress = law.force(overlap * d) / (k * d) / distance
        diameters = 1.0 + deviations
        arms = 0.5 * self._spacing * diameters
        table = ContactTable(
            read_only(i), read_only(j), read_only(shift), read_only(axis), read_only(vector),
            read_only(arms[i]), read_only(arms[j]),
        )  # fmt: skip
        return ContactLattice(
            np.asarray(atoms.cell)[:2, :2], sites, table, self._eta, stiffness=self._find_stiffness(law, overlap),
            prestress=prestress, masses=atoms.get_masses(), gyration=GYRATION * diameters,
        )  # fmt: skip

    @overload
    def get_force_constants(self, atoms: Atoms, format: Literal["dense"] = "dense") -> NDArray[np.float64]: ...

    @overload
    def get_force_constants(self, atoms: Atoms, format: Literal["csr"]) -> csr_array[Any]: ...

    def get_force_constants(
        self, atoms: Atoms, format: Literal["dense", "csr"] = "dense"
    ) -> NDArray[np.float64] | csr_array[Any]:
        """Return the analytic force constants of the cell, summed over its images, in (x, y, w) of each ball; units of k.

        Parameters
        ----------
        atoms : any cell of these balls.
        format : "dense" for an array (N, N, 3, 3), "csr" for a (3N, 3N) ``scipy.sparse.csr_array``. Another word raises
            :class:`~granphon.base.errors.InputError`.

        Notes
        -----
        w = R_g phi is a length, so that the mass of the ball serves all three coordinates. Without friction the rows and
        columns of w are zero. In a cell so small that two balls touch more than once (2 x 2 and less), contacts add up.
        """
        if format not in ("dense", "csr"):
            raise InputError(message(f"format is {format!r}", mend="Use dense or csr"))
        return assemble(self.contact_lattice(atoms), sparse=format == "csr")


class _Deformations(NamedTuple):
    """Closed contacts in reduced units: vectors (n, 2) from ball i to j, energies (n,), forces (n, 2) and torques (n,)."""

    i: NDArray[np.intp]
    j: NDArray[np.intp]
    vector: Array
    energy: Array
    force_on_j: Array
    torque_on_i: Array
    torque_on_j: Array


class _Rest(NamedTuple):
    """Contacts in the reference state: directions (n, 2), and overlaps and distances of the centres (n,), in diameters."""

    axis: Array
    overlap: Array
    distance: Array
