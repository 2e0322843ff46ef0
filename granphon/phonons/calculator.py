"""The calculator of the contacts of balls that are an ``ase.Atoms``, and the Atoms of one cell of a lattice.

Atoms are in reduced units, with the arrays of :mod:`granphon.array.atoms`. A contact's reference direction is the nearest
contact vector of the lattice, so nothing else needs to be stored: slip does not depend on where the lattice as a whole is.
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
#: least delta/d at which positions still hold six digits of the overlap
_LEAST_OVERLAP = 1e-10
#: how far, in spacings, a pair may be from the lattice's contact vector
_CATCH = 0.25
#: how far the lattice may be turned as a whole: the overlap that this adds to contacts of fixed direction, over their own
_TURN_PER_OVERLAP = 1e-2
#: the same over the spacing, where positions only tell which balls touch
_TURN_PER_SPACING = 1e-4


def atoms(state: ContactState, finite_overlap: bool | None = None) -> Atoms:
    """One cell of the lattice in ``state``, as an ``ase.Atoms`` with :class:`HertzMindlin` attached.

    In reduced units, in ASE's HEX2D cell (120 degrees) for the triangular lattice, one diameter thick, periodic in the
    plane; with finite overlap the cell is that of the spacing a = d - delta. The state must be at one load
    (:class:`~granphon.base.errors.InputError`). The keyword ``finite_overlap`` is deprecated: the state has it.
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

    Energy, forces and stress follow from positions and rotations: each contact has the energy of the state's own law at its
    overlap, plus kappa s^2/2 of its slip s since the reference configuration, at the kappa it has there. Balls that
    are apart exert nothing. Stress is that of a layer one diameter thick (Voigt; times ``Units.modulus`` it is in Pa).

    By default, in the paper's limit, the overlap is delta - (r - d n).n with n fixed;
    with finite overlap, which the state has or has not, it is ``d - |r|``. Slip is counted from the array ``slip_origin``.

    Force constants come from the state (and the arrays ``displacements`` and ``diameter_deviations``), never from positions:
    these only tell which balls touch.

    The state of one simulated sample serves that sample's own ``sample.atoms()``, whose contacts have the law of two balls,
    and ``gp.atoms(state)``, whose contacts have the mean law.

    Parameters
    ----------
    state : at one load.
    finite_overlap : deprecated; the state has it.

    Raises
    ------
    InputError : unknown keywords, several loads; on use, Atoms without masses or an array of :mod:`granphon.array.atoms`, or
        of another state (:meth:`adopt` gives what is missing); balls that are periodic across the plane, or that touch in
        other directions than the lattice's, as when it is turned (with ``finite_overlap`` and no friction they may).
    PrecisionError : on use, delta/d < 1e-10: positions hold too few digits of the overlap.
    """

    implemented_properties = ["energy", "free_energy", "forces", "stress"]
    discard_results_on_any_change = True

    def __init__(self, state: ContactState, finite_overlap: bool | None = None, **unknown: Any) -> None:
        super().__init__(**unknown)
        self.state = state = with_keyword(state, finite_overlap)
        self.finite_overlap = state.finite_overlap
        self.scales: Units = state.scales
        self._overlap = float(state.relative_overlap)
        # the overlap up to which balls are apart: below zero where they differ
        self._apart = state.law.least_overlap / self.scales.length
        self._eta = float(state.packing.mindlin_ratio)
        self._motions = select_motions(self._eta)
        self._spacing = 1.0 - self._overlap if self.finite_overlap else 1.0
        table = state.packing.structure.contacts
        self._directions = np.concatenate([table.normal, -table.normal])
        # without friction contacts of finite overlap have no direction but that in which the balls are
        self._is_free = self.finite_overlap and not self._motions.rotate
        self._near = PairList()

    def set(self, **unknown: Any) -> dict[str, Any]:
        """Refuse parameters: what this calculator needs is its state."""
        if unknown:
            raise InputError(message(f"HertzMindlin has no keyword {', '.join(map(repr, unknown))}"))
        return {}

    # -- ASE's protocol ---------------------------------------------------------------------------------------------

    def check_state(self, atoms: Atoms, tol: float = 1e-15) -> list[str]:
        """Names of what has changed since the last calculation, of ASE's six properties and of granphon's arrays."""
        changes: list[str] = super().check_state(atoms, tol=tol)
        if self.atoms is not None:
            old = self.atoms
            changes += [name for name in ARRAYS if not np.array_equal(old.arrays.get(name), atoms.arrays.get(name))]
            changes += ["masses"] * (has_masses(old) != has_masses(atoms))
        return changes

    def adopt(self, atoms: Atoms, like: Atoms | None = None) -> Atoms:
        """Copy Atoms from elsewhere, and make the copy balls of this state with this calculator.

        The copy keeps what the Atoms have, also where that was set by hand. Masses, scales and the arrays of
        :mod:`granphon.array.atoms` that are missing are those of ``like``, ball by ball; without it, those of balls of the
        state on the sites of its lattice, with masses (1 + deviation)^3. Positions and cell must be in mean diameters.

        Raises :class:`~granphon.base.errors.InputError` if ``like`` has another number of balls, or the Atoms are of another
        state.
        """
        balls = adopt(atoms, self.scales, FINITE if self.finite_overlap else LATTICE, like)
        find_kind(balls, self.scales, self.finite_overlap)
        balls.calc = self
        return balls

    def calculate(
        self, atoms: Atoms | None = None, properties: Any = ("energy",), system_changes: Any = all_changes
    ) -> None:
        """Energy (k d^2), forces (k d) and stress (k/d) of the atoms."""
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
        contacts = self._deformations(balls)
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
            # the energy's derivative with respect to a strain of positions and cell, over area times one diameter
            virial = -np.einsum("ca,cb->ab", pull, contacts.vector) / area
            virial = 0.5 * (virial + virial.T)
            self.results["stress"] = np.array([virial[0, 0], virial[1, 1], 0.0, 0.0, 0.0, virial[0, 1]])
        elif "stress" in properties:
            raise InputError(
                message("the cell has no area in the plane", "Stress is force over area", "Give it two vectors")
            )

    def get_torques(self, atoms: Atoms) -> Array:
        """Torque about z on each ball, -dE/dphi, (N,), in units of k d^2."""
        self.get_property("energy", atoms)
        return self._torques.copy()

    # -- contacts ---------------------------------------------------------------------------------------------------

    def _law(self, balls: Atoms) -> Law:
        """The contact law of these balls; raises :class:`InputError` where the state cannot have such balls."""
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
            raise InputError(message("the Atoms hold a number that is not finite, in positions, cell or an array of ours"))
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

    def _pairs(self, balls: Atoms, positions: Array) -> Pairs:
        """Find the pairs of balls that might touch, each pair once."""
        largest = 1.0 + float(np.max(balls.arrays["diameter_deviations"], initial=0.0)) + _CATCH
        periodic = bool(balls.pbc[0]), bool(balls.pbc[1])
        return self._near.near(positions, np.asarray(balls.cell)[:2, :2], periodic, largest)

    def _normals(self, vector: Array, extra: Array, turned: float) -> tuple[Array, NDArray[np.bool_]]:
        """Direction of each pair's contact in the lattice, and whether the pair is near enough to be that contact.

        :class:`InputError` if balls touch in another direction, or the lattice is turned so that contacts of fixed direction
        would overlap by ``turned`` more.
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

    def _deformations(self, balls: Atoms) -> _Deformations:
        """Find the contacts that are closed at the balls' positions, with their energies, forces and torques."""
        law = self._law(balls)
        apart = law.least_overlap / self.scales.length
        i, j, _, vector = self._pairs(balls, balls.positions[:, :2])
        deviations, angles = balls.arrays["diameter_deviations"], balls.arrays["rotations"]
        extra = 0.5 * (deviations[i] + deviations[j])
        normal, near = self._normals(vector, extra, _TURN_PER_OVERLAP * (self._overlap - self._apart))
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
            rest = self._at_rest(balls, i, j, normal)
            origin = balls.arrays["slip_origin"][:, :2]
            moved = vector - self._spacing * normal - (origin[j] - origin[i])
            # stiffnesses are those of the reference: the energy is incremental
            stiffness = self._stiffness(law, rest.overlap)
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

    def _at_rest(self, balls: Atoms, i: Any, j: Any, normal: Array) -> _Rest:
        """Contacts in the reference state, where balls are displaced from sites in the direction ``normal``.

        In the paper's limit their direction is that of the sites. Differences of displacements are not added to the spacing,
        which would take the digits of the overlap.
        """
        deviations, displacements = balls.arrays["diameter_deviations"], balls.arrays["displacements"][:, :2]
        moved = displacements[j] - displacements[i]
        overlap = self._overlap + 0.5 * (deviations[i] + deviations[j])
        along = np.einsum("ca,ca->c", normal, moved)
        if not self.finite_overlap:
            return _Rest(normal, overlap - along, np.full(len(normal), self._spacing))
        vector = self._spacing * normal + moved
        distance = np.linalg.norm(vector, axis=1)
        # |r| - a of r = a n + u
        farther = (2.0 * self._spacing * along + np.einsum("ca,ca->c", moved, moved)) / (distance + self._spacing)
        return _Rest(vector / distance[:, None], overlap - farther, distance)

    def _stiffness(self, law: Law, overlap: Array) -> Array:
        """Normal stiffness of contacts over that of the state: of the state's law it is exactly one at its own overlap."""
        stiffness, other = np.ones(overlap.shape), (overlap != self._overlap) | (law is not self.state.law)
        if np.any(other):  # where the law is that of a simulation, each overlap is an equilibrium
            stiffness[other] = law.stiffness(overlap[other] * self.scales.length) / self.scales.stiffness
        return stiffness

    def contact_lattice(self, atoms: Atoms) -> ContactLattice:
        """The :class:`~granphon.dynamics.modes.ContactLattice` of any cell of these balls: harmonic about the state.

        Contacts are those of the lattice between balls that are there; their overlap is the state's, plus the deviations of
        the diameters, less the ``displacements``. With ``finite_overlap`` these turn the contacts too. Masses are those of
        the Atoms.
        """
        law = self._law(atoms)
        deviations = atoms.arrays["diameter_deviations"]
        sites = atoms.positions[:, :2] - atoms.arrays["displacements"][:, :2]
        i, j, shift, vector = self._pairs(atoms, sites)
        normal, near = self._normals(vector, 0.5 * (deviations[i] + deviations[j]), _TURN_PER_SPACING)
        rest = self._at_rest(atoms, i, j, normal)
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
            np.asarray(atoms.cell)[:2, :2], sites, table, self._eta, stiffness=self._stiffness(law, overlap),
            prestress=prestress, masses=atoms.get_masses(), gyration=GYRATION * diameters,
        )  # fmt: skip

    @overload
    def get_force_constants(self, atoms: Atoms, format: Literal["dense"] = "dense") -> NDArray[np.float64]: ...

    @overload
    def get_force_constants(self, atoms: Atoms, format: Literal["csr"]) -> csr_array[Any]: ...

    def get_force_constants(
        self, atoms: Atoms, format: Literal["dense", "csr"] = "dense"
    ) -> NDArray[np.float64] | csr_array[Any]:
        """Analytic force constants of the cell, summed over its images, in (x, y, w) of each ball; units of k.

        Parameters
        ----------
        atoms : any cell of these balls.
        format : "dense", (N, N, 3, 3); "csr", a (3N, 3N) ``scipy.sparse.csr_array``.

        Notes
        -----
        w = R_g phi, so that the ball's mass serves all three. Without friction the rows and columns of w are zero. In a
        cell so small that two balls touch more than once (2 x 2 and less), contacts add up.
        """
        if format not in ("dense", "csr"):
            raise InputError(message(f"format is {format!r}", mend="Use dense or csr"))
        return assemble(self.contact_lattice(atoms), sparse=format == "csr")


class _Deformations(NamedTuple):
    """Closed contacts at given positions: vectors (n, 2) from i to j, energies, forces (n, 2) and torques on the balls."""

    i: NDArray[np.intp]
    j: NDArray[np.intp]
    vector: Array
    energy: Array
    force_on_j: Array
    torque_on_i: Array
    torque_on_j: Array


class _Rest(NamedTuple):
    """Contacts in the reference state: directions (n, 2), overlaps, and distances of the centres."""

    axis: Array
    overlap: Array
    distance: Array
