"""Balls as an ``ase.Atoms``, and the calculator of their contacts.

Atoms are in reduced units (d = k = M = 1); the scales are in ``atoms.info`` (see :class:`granphon.units.Units`). Arrays on
the Atoms, all optional and zero (radius: 1/2) when absent:

``diameter_deviations``  (N,) d_i - <d>.
``displacements``        (N, 3) from the reference site; the part of the state that force constants use.
``rotations``            (N,) angle phi about z, rad.
``radius``               (N,) d_i/2, for programs that draw balls.

A contact's reference direction is the nearest contact vector of the lattice, so nothing else needs to be stored: slip,
which is measured from the reference sites, does not depend on where the lattice as a whole is.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, Literal, overload

import numpy as np
from ase import Atoms
from ase.calculators.calculator import Calculator, all_changes
from numpy.typing import NDArray

from granphon.compatibility import GYRATION
from granphon.errors import InputError, PrecisionError, message
from granphon.geometry import BALL, ContactTable
from granphon.lattice import ContactLattice
from granphon.results import read_only
from granphon.state import ContactState, with_keyword
from granphon.units import Units

if TYPE_CHECKING:
    from scipy.sparse import csr_array

__all__ = ["HertzMindlin", "atoms"]

Array = NDArray[np.float64]
#: least delta/d at which positions still hold six digits of the overlap
_LEAST_OVERLAP = 1e-10
#: how far, in spacings, a pair may be from the lattice's contact vector
_CATCH = 0.25
#: entry of ``Atoms.info``: whether the cell is that of finite overlap
_FINITE = "granphon_finite_overlap"
#: arrays of its own that the energy depends on; what is absent is zero
_WATCHED = ("diameter_deviations", "rotations", "displacements")


def atoms(state: ContactState, finite_overlap: bool | None = None) -> Atoms:
    """One cell of the lattice in ``state``, as an ``ase.Atoms`` with :class:`HertzMindlin` attached.

    In reduced units, in ASE's HEX2D cell (120 degrees) for the triangular lattice, one diameter thick, periodic in the
    plane; with finite overlap the cell is that of the spacing a = d - delta. The state must be at one load
    (:class:`~granphon.errors.InputError`). The keyword ``finite_overlap`` is deprecated: the state has it.
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
        masses=np.ones(lattice.n_balls),
    )
    balls.info.update(scales.to_info(), **{_FINITE: state.finite_overlap})
    balls.set_array("diameter_deviations", np.zeros(lattice.n_balls))
    balls.set_array("displacements", np.zeros((lattice.n_balls, 3)))
    balls.set_array("rotations", np.zeros(lattice.n_balls))
    balls.set_array("radius", np.full(lattice.n_balls, 0.5))
    balls.calc = HertzMindlin(state)
    return balls


class HertzMindlin(Calculator):  # type: ignore[misc]
    """ASE calculator of one-sided Hertz-Mindlin contacts, in the reduced units of its state.

    Energy, forces and stress follow from positions and rotations: each contact has the energy of the state's own law at its
    overlap, plus kappa s^2/2 of its slip s since the reference configuration, at the kappa it has there. Balls that
    are apart exert nothing. Stress is that of a layer one diameter thick (Voigt; times ``Units.modulus`` it is in Pa).

    By default, in the paper's limit, the overlap is delta - (r - d n).n with n fixed;
    with finite overlap, which the state has or has not, it is ``d - |r|``.

    Force constants come from the state (and the arrays ``displacements`` and ``diameter_deviations``), never from positions:
    these only tell which balls touch.

    Parameters
    ----------
    state : at one load.
    finite_overlap : deprecated; the state has it.

    Raises
    ------
    InputError : unknown keywords, several loads; on use, balls that are periodic across the plane or not on a lattice.
    PrecisionError : on use, delta/d < 1e-10: positions hold too few digits of the overlap.
    """

    implemented_properties = ["energy", "free_energy", "forces", "stress"]
    discard_results_on_any_change = True

    def __init__(self, state: ContactState, finite_overlap: bool | None = None, **unknown: Any) -> None:
        super().__init__(**unknown)
        if not isinstance(state, ContactState):
            raise InputError(message(f"state is {state!r}", mend="Give what medium.at_force(...) returns"))
        self.state = state = with_keyword(state, finite_overlap)
        self.finite_overlap = state.finite_overlap
        self.scales: Units = state.scales
        self._overlap = float(state.relative_overlap)
        # the overlap up to which balls are apart: below zero where they differ
        self._apart = state.law.least_overlap / self.scales.length
        self._eta = float(state.packing.mindlin_ratio)
        self._spacing = 1.0 - self._overlap if self.finite_overlap else 1.0
        table = state.packing.structure.contacts
        self._directions = np.concatenate([table.normal, -table.normal])

    def set(self, **unknown: Any) -> dict[str, Any]:
        """Refuse parameters: what this calculator needs is its state."""
        if unknown:
            raise InputError(message(f"HertzMindlin has no keyword {', '.join(map(repr, unknown))}"))
        return {}

    # -- ASE's protocol ---------------------------------------------------------------------------------------------

    def check_state(self, atoms: Atoms, tol: float = 1e-15) -> list[str]:
        """What has changed since the last calculation: ASE's six, and the arrays that are ours."""
        changes: list[str] = super().check_state(atoms, tol=tol)
        if self.atoms is not None:
            old = self.atoms
            changes += [
                name
                for name in _WATCHED
                if len(old) != len(atoms) or np.any(old.arrays.get(name, 0.0) != atoms.arrays.get(name, 0.0))
            ]
        return changes

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
        i, j, pull, arm_i, arm_j = contacts.i, contacts.j, contacts.force_on_j, contacts.arm_i, contacts.arm_j
        forces = np.zeros((len(balls), 3))
        np.add.at(forces[:, :2], j, pull)
        np.add.at(forces[:, :2], i, -pull)
        torques = np.zeros(len(balls))
        np.add.at(torques, i, arm_i * contacts.shear)
        np.add.at(torques, j, arm_j * contacts.shear)
        self._torques = torques
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

    def _check_scales(self, balls: Atoms) -> None:
        for key, value in self.scales.to_info().items():
            given = balls.info.get(key, value)
            if not np.isclose(float(given), value, rtol=1e-9, atol=0.0):
                raise InputError(
                    message(
                        f"the Atoms have {key} = {given}, the state {value}",
                        "They are in the reduced units of another state",
                        "Use the state they were made from, or gp.atoms of this one",
                    )
                )

    def _check_overlap_mode(self, balls: Atoms) -> None:
        if bool(balls.info.get(_FINITE, self.finite_overlap)) != self.finite_overlap:
            ours, theirs = ("with", "without") if self.finite_overlap else ("without", "with")
            raise InputError(
                message(
                    f"the Atoms were made {theirs} finite overlap, and this is a calculation {ours} it",
                    "Their cells differ by the overlap",
                    f"Make the state with finite_overlap={not self.finite_overlap}, or make the Atoms anew",
                )
            )

    def _pairs(self, balls: Atoms) -> tuple[Any, Any, Any, Array]:
        """Each neighbouring pair once: i, j, shift (n, 2), vector (n, 2)."""
        self._check_scales(balls)
        self._check_overlap_mode(balls)
        cell = np.asarray(balls.cell)
        own = (balls.arrays[name] for name in _WATCHED if name in balls.arrays)
        if self._apart < 0.0 and np.any(_scalar(balls, "diameter_deviations")):
            raise InputError(
                message(
                    f"the Atoms have diameters of their own, and the law of {self.state.medium!r} is the mean over all",
                    "Their spread would count twice",
                    "Use a state of AveragedLattice, whose law is that of two balls",
                )
            )
        if not all(np.all(np.isfinite(values)) for values in (balls.positions, cell, *own)):
            raise InputError(message("the Atoms hold a number that is not finite, in positions, cell or an array of ours"))
        if np.any(np.abs(cell[:2, 2]) > 1e-3):
            raise InputError(message("the cell is tilted out of the plane", "The array is one layer in x and y"))
        if balls.pbc[2]:
            raise InputError(
                message("the balls are periodic across the plane", "The array is one layer", "Set pbc = (True, True, False)")
            )
        deviations = _scalar(balls, "diameter_deviations")
        largest = 1.0 + float(np.max(deviations, initial=0.0)) + _CATCH
        flat = balls.copy()
        flat.positions[:, 2] = 0.0
        # brings much of scipy along, and the cells of the lattice itself do not need it
        from ase.neighborlist import neighbor_list

        i, j, vector, shift = neighbor_list("ijDS", flat, largest)
        once = (i < j) | ((i == j) & ((shift[:, 0] > 0) | ((shift[:, 0] == 0) & (shift[:, 1] > 0))))
        return i[once], j[once], shift[once][:, :2], vector[once][:, :2]

    def _reference(self, vector: Array) -> tuple[Array, NDArray[np.bool_]]:
        """Normal of the lattice nearest to each pair's vector, and whether it is near enough to be that contact."""
        nearest = np.argmax(vector @ self._directions.T, axis=1)
        normal = self._directions[nearest]
        return normal, np.linalg.norm(vector - self._spacing * normal, axis=1) < _CATCH

    def _deformations(self, balls: Atoms) -> _Deformations:
        """The contacts that are closed at the balls' positions."""
        i, j, _, vector = self._pairs(balls)
        deviations, angles = _scalar(balls, "diameter_deviations"), _scalar(balls, "rotations")
        extra = 0.5 * (deviations[i] + deviations[j])
        if self.finite_overlap and not self._eta:
            near = np.ones(len(i), bool)
            normal = vector / np.linalg.norm(vector, axis=1)[:, None]
        else:
            normal, near = self._reference(vector)
        if self.finite_overlap:
            distance = np.linalg.norm(vector, axis=1)
            axis = vector / distance[:, None]
            overlap = 1.0 + extra - distance
        else:
            axis = normal
            overlap = self._overlap + extra - (np.einsum("ca,ca->c", vector, normal) - 1.0)
        closed = near & (overlap > self._apart)
        i, j, vector, normal, axis = i[closed], j[closed], vector[closed], normal[closed], axis[closed]
        # the law is that of the medium; reduced energy, force and stiffness are in units of k d^2, k d and k
        d, k, law = self.scales.length, self.scales.stiffness, self.state.law
        depth = overlap[closed] * d
        compression = law.force(depth) / (k * d)
        energy = law.energy(depth) / (k * d * d)
        arm_i, arm_j = (self._spacing * 0.5 * (1.0 + deviations[ball]) for ball in (i, j))
        pull = compression[:, None] * axis
        shear = np.zeros(len(i))
        if self._eta:
            tangent = np.stack([-normal[:, 1], normal[:, 0]], axis=1)
            slip = np.einsum("ca,ca->c", vector, tangent) - arm_i * angles[i] - arm_j * angles[j]
            # kappa is that of the reference: the energy is incremental
            shear = self._eta * self._stiffness(self._state_overlap(balls, i, j, normal)) * slip
            energy = energy + 0.5 * shear * slip
            pull = pull - shear[:, None] * tangent
        return _Deformations(i, j, vector, energy, pull, shear, arm_i, arm_j)

    def _state_overlap(self, balls: Atoms, i: Any, j: Any, normal: Array) -> Array:
        """Reduced overlap of pairs in the reference state: the state's, plus deviations, less displacements."""
        deviations, displacements = _scalar(balls, "diameter_deviations"), _displacements(balls)
        approach = np.einsum("ca,ca->c", normal, displacements[j] - displacements[i])
        return np.asarray(self._overlap + 0.5 * (deviations[i] + deviations[j]) - approach)

    def _stiffness(self, overlap: Array) -> Array:
        """Reduced normal stiffness: exactly one at the state's own overlap."""
        stiffness, other = np.ones(overlap.shape), overlap != self._overlap
        if np.any(other):  # where the law is that of a simulation, each overlap is an equilibrium
            stiffness[other] = self.state.law.stiffness(overlap[other] * self.scales.length) / self.scales.stiffness
        return stiffness

    def contact_lattice(self, atoms: Atoms) -> ContactLattice:
        """The :class:`~granphon.lattice.ContactLattice` of any cell of these balls: harmonic about the state.

        Contacts are those of the lattice between balls that are there; their overlap is the state's, plus the deviations of
        the diameters, less the ``displacements``. Masses are those of the Atoms.
        """
        sites = atoms.copy()
        sites.positions[:, :2] -= _displacements(atoms)
        i, j, shift, vector = self._pairs(sites)
        normal, near = self._reference(vector)
        overlap = self._state_overlap(atoms, i, j, normal)
        closed = near & (overlap > self._apart)
        i, j, shift, normal, overlap = i[closed], j[closed], shift[closed], normal[closed], overlap[closed]
        d, k, law = self.scales.length, self.scales.stiffness, self.state.law
        stiffness = self._stiffness(overlap)
        prestress = np.zeros(len(i))
        if self.finite_overlap:
            prestress = law.force(overlap * d) / (k * d) / self._spacing
        diameters = 1.0 + _scalar(atoms, "diameter_deviations")
        arms = 0.5 * self._spacing * diameters
        table = ContactTable(
            read_only(i), read_only(j), read_only(shift), read_only(normal), read_only(vector[closed]),
            read_only(arms[i]), read_only(arms[j]),
        )  # fmt: skip
        return ContactLattice(
            np.asarray(atoms.cell)[:2, :2], sites.positions[:, :2], table, self._eta,
            stiffness=stiffness, prestress=prestress, masses=atoms.get_masses(), gyration=GYRATION * diameters,
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
        lattice = self.contact_lattice(atoms)
        table, n, blocks = lattice.contacts, len(atoms), contact_blocks(lattice)
        ends = np.stack([table.i, table.j], axis=1)
        index = (3 * ends[:, :, None] + np.arange(3)).reshape(len(table), 6)
        first = np.broadcast_to(index[:, :, None], blocks.shape).ravel()
        second = np.broadcast_to(index[:, None, :], blocks.shape).ravel()
        if format == "csr":
            from scipy.sparse import coo_array

            matrix = coo_array((blocks.ravel(), (first, second)), shape=(3 * n, 3 * n)).tocsr()
            matrix.sum_duplicates()
            return matrix
        dense = np.zeros((3 * n, 3 * n))
        np.add.at(dense, (first, second), blocks.ravel())
        return dense.reshape(n, 3, n, 3).transpose(0, 2, 1, 3)


def contact_blocks(lattice: ContactLattice) -> Array:
    """(n_c, 6, 6) force constants of each contact alone, in (x, y, w) of ball i and then of ball j; units of k."""
    table = lattice.contacts
    rows, weights = [table.normal], [lattice.stiffness]
    turn_i, turn_j = [np.zeros(len(table))], [np.zeros(len(table))]
    if lattice.rotates:
        rows, weights = [*rows, table.tangent], [*weights, lattice.mindlin_ratio * lattice.stiffness]
        turn_i.append(-table.arm_i / lattice.gyration[table.i])
        turn_j.append(-table.arm_j / lattice.gyration[table.j])
    if lattice.is_prestressed:
        rows, weights = [*rows, table.tangent], [*weights, -lattice.prestress]
        turn_i.append(np.zeros(len(table)))
        turn_j.append(np.zeros(len(table)))
    # each row of C has six entries
    entries = np.stack(
        [np.column_stack([-axis, left, axis, right]) for axis, left, right in zip(rows, turn_i, turn_j, strict=True)]
    )
    return np.asarray(np.einsum("rc,rca,rcb->cab", np.stack(weights), entries, entries))


class _Deformations:
    """Closed contacts at given positions: energies, forces on ball j, slip forces, lever arms."""

    def __init__(
        self, i: Any, j: Any, vector: Array, energy: Array, force_on_j: Array, shear: Array, arm_i: Array, arm_j: Array
    ) -> None:
        self.i, self.j, self.vector, self.energy = i, j, vector, energy
        self.force_on_j, self.shear, self.arm_i, self.arm_j = force_on_j, shear, arm_i, arm_j


def _scalar(balls: Atoms, name: str) -> Array:
    """An array of one number per ball; zero where the Atoms have none."""
    return np.asarray(balls.arrays.get(name, np.zeros(len(balls))), float)


def _displacements(balls: Atoms) -> Array:
    """(N, 2) displacements from the reference sites; zero where the Atoms have none."""
    return np.asarray(balls.arrays.get("displacements", np.zeros((len(balls), 3))), float)[:, :2]
