"""An assembly of balls, walls and a cell under a load, at displacements and a strain: the overlaps,
the normals, and the forces left.

The unknowns x are the displacements of the balls, those of the walls along their lines, and the
strains of the cell that are free, as lengths: forces on strains, sums over all contacts, are then
as large as forces on balls are in sum. The forces left are minus the derivatives of the energy,

    E(x) = sum of the energies of contacts - work of the load,

and vanish at rest. In the directions of the lattice overlaps are linear in x. They are not computed
anew from x but carried along, step by step: their digits then do not depend on how large the
displacements of a tall column are. In exact directions the stress of the load is Cauchy's, on the
deformed cell, and pressures act on its deformed sides.
"""

from __future__ import annotations

import itertools
import math
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any, Literal, get_args

import numpy as np

from granphon.base.arrays import Array
from granphon.contacts.assembly import ROUNDING, Assembly
from granphon.contacts.columns import Columns
from granphon.contacts.deformation import (
    TurnedContacts,
    add_forces,
    find_overlaps,
    measure_losses,
    measure_turned,
)

#: whether contacts keep the directions of the sites, or turn with their balls
Geometry = Literal["lattice", "exact"]
#: whether the cell keeps its shape and changes its size alone, or has the stress of the load
Boundary = Literal["isotropic", "stress"]
BOUNDARIES: tuple[Boundary, ...] = get_args(Boundary)


def list_shears(periods: int) -> Array:
    """Return (s, p, p) symmetric strains that keep the size of a cell with p = ``periods`` to
    first order, each at a right angle to the others: none of a cell without a period, and
    s = p (p + 1)/2 - 1 of any other. Their norms differ.
    """
    units = []
    # in space diag(1, -1, 0) and diag(1, 1, -2)
    for axis in range(1, periods):
        diagonal = np.zeros(periods)
        diagonal[:axis] = 1.0
        diagonal[axis] = -axis
        units.append(np.diag(diagonal))
    for a, b in itertools.combinations(range(periods), 2):
        unit = np.zeros((periods, periods))
        unit[a, b] = 1.0
        unit[b, a] = 1.0
        units.append(unit)
    return np.array(units).reshape(len(units), periods, periods)


@dataclass(frozen=True, eq=False, repr=False)
class AppliedLoad:
    """What acts on an assembly of n balls with d motions each, k walls and a cell with p periods;
    SI units.

    Attributes
    ----------
    force : (n d + k,) forces on the balls, then on the walls, N.
    words : what messages call the load.
    stress : (p, p) stress of the cell, tension above zero; None of a cell whose strain, or whose
        mean force of contacts, is given.
    strain : (p, p) the given strain; zeros if the strain is free.
    shears : whether a cell whose strain is given shears in addition, until its stress is
        hydrostatic. Only contacts that keep the directions of the lattice may have such a load:
        the shears keep the size of the cell to first order alone.
    pressure_force : (n d + k,) the part of ``force``, N, that is proportional to the length or area
        of the cell.
    lift : why gravity lifts balls off what they stand on, and what mends that; None if it does not.
    mean_force : mean force of all contacts, N, to which a cell that keeps its shape is pressed;
        None if a stress or a strain is given instead.
    cell_tolerance : force that may be left on a strain of the cell, over that on a ball.
    """

    force: Array
    words: str
    stress: Array | None
    strain: Array
    pressure_force: Array
    lift: tuple[str, str] | None = None
    mean_force: float | None = None
    cell_tolerance: float = 1.0
    shears: bool = False

    @property
    def acts(self) -> bool:
        """Whether a force acts on a ball or a wall, a stress on the cell, or contacts are given a
        mean force that is not zero.
        """
        is_stressed = self.stress is not None and bool(np.any(self.stress))
        return bool(np.any(self.force)) or is_stressed or bool(self.mean_force)

    @property
    def has_strain(self) -> bool:
        """Whether a strain is given that is not zero."""
        return bool(np.any(self.strain))

    def scale(self, factor: float) -> AppliedLoad | None:
        """Return the load with its stress or mean force times a ``factor``; None if forces act on
        balls or walls, or if a strain is given.
        """
        if np.any(self.force):
            return None
        if self.mean_force is not None:
            return replace(self, mean_force=factor * self.mean_force)
        return None if self.stress is None else replace(self, stress=factor * self.stress)


class Problem:
    """An assembly under a load, and the unknowns of its rest.

    The unknowns x (size,) are lengths, m: the displacements of n balls along d axes, those of k
    walls along their lines, and s strains of the cell times :attr:`length`. ``geometry`` says
    whether contacts turn, and ``boundary`` which strains are unknowns where the load has a stress:
    all, or the one that changes the size of the cell and not its shape. Where contacts are given a
    mean force, that one is the only unknown strain. Where a strain is given, the unknown strains
    are the shears of a load that ``shears``, and otherwise there are none.

    Attributes
    ----------
    assembly, load, boundary : those that are given.
    turns : whether contacts turn with their balls.
    n_ball_unknowns : number n d of the displacements of balls, which come first.
    n_displacements : number n d + k of all displacements.
    size : number n d + k + s of all unknowns.
    length : unknown of a strain over this strain, m.
    unit_strains : (s, 3, 3) strain of the cell over each unknown of a strain, 1/m.
    given_strain : (3, 3) the given strain of the load.
    """

    def __init__(
        self, assembly: Assembly, load: AppliedLoad, geometry: Geometry, boundary: Boundary
    ) -> None:
        self.assembly = assembly
        self.load = load
        self.boundary = boundary
        self.turns = geometry == "exact"
        self.n_ball_unknowns = assembly.n_balls * assembly.dimension
        self.n_displacements = self.n_ball_unknowns + assembly.n_walls
        # strains are scaled so that the stiffnesses against them, sums over all contacts, are
        # comparable with those of balls; forces on them still grow as the root of the number of
        # contacts, which `weights` takes out of the forces left
        self.length = assembly.mean_distance * math.sqrt(assembly.n_contacts)
        self.unit_strains = _embed(self._list_free_strains() / self.length)
        self.given_strain = _embed(load.strain)
        self.size = self.n_displacements + len(self.unit_strains)

    def _list_free_strains(self) -> Array:
        """Return the symmetric strains (s, p, p) of the cell that are unknowns, of which the
        entries are numbers near one; none of a cell without a period.
        """
        load = self.load
        p = self.assembly.periods
        if load.mean_force is not None or (
            load.stress is not None and self.boundary == "isotropic"
        ):
            return np.eye(p)[None] if p else np.zeros((0, p, p))
        if load.stress is not None:
            pairs = list(itertools.combinations_with_replacement(range(p), 2))
            strains = np.zeros((len(pairs), p, p))
            for strain, (a, b) in zip(strains, pairs, strict=True):
                strain[a, b] = strain[b, a] = 1.0
            return strains
        if load.shears:
            assert not self.turns  # shears keep the size of a cell to first order only
            return list_shears(p)
        return np.zeros((0, p, p))

    @cached_property
    def weights(self) -> Array:
        """(size,) factors that make the force left on an unknown comparable with that on a ball: 1
        for balls, one over the number of balls at a wall, and for strains one over the product of
        the root of the number of contacts and ``cell_tolerance`` of the load.
        """
        weights = np.ones(self.size)
        weights[self.n_ball_unknowns : self.n_displacements] = 1.0 / self.assembly.wall_balls
        of_cell = self.load.cell_tolerance * math.sqrt(self.assembly.n_contacts)
        weights[self.n_displacements :] = 1.0 / of_cell
        return weights

    @cached_property
    def force(self) -> Array:
        """(size,) forces of the load on the unknowns, N, on the cell as it is at touch."""
        stress = self.load.stress
        work = np.zeros(len(self.unit_strains)) if stress is None else self.find_work(stress)
        return np.concatenate([self.load.force, work])

    @cached_property
    def load_changes(self) -> bool:
        """Whether forces of the load change as the cell deforms: in exact directions, those of a
        stress and of a pressure.
        """
        load = self.load
        is_pressed = load.stress is not None or bool(np.any(load.pressure_force))
        return self.turns and self.assembly.periods > 0 and is_pressed

    def find_work(self, stress: Array) -> Array:
        """Return the forces (s,), N, of a ``stress`` (p, p), in N, N/m or Pa with one, two or three
        periods, on the s unknown strains: its work on the cell as it is at touch, over each
        unknown.
        """
        p = len(stress)
        unit_strains = self.unit_strains[:, :p, :p]
        return np.asarray(np.einsum("sab,ab->s", unit_strains, stress) * self.assembly.measure)

    def find_displacement(self, x: Array) -> Array:
        """Return the displacements (bodies, 3), m, of all bodies at unknowns x (size,): of balls,
        of walls, and zeros of what is held.
        """
        assembly = self.assembly
        displacement = np.zeros((assembly.n_bodies, 3))
        n = assembly.n_balls
        d = assembly.dimension
        displacement[:n, :d] = x[: self.n_ball_unknowns].reshape(n, d)
        shifts = x[self.n_ball_unknowns : self.n_displacements]
        displacement[n : n + assembly.n_walls, :d] = shifts[:, None] * assembly.directions
        return displacement

    def find_strain(self, x: Array) -> Array:
        """Return the strain (3, 3) that unknowns x (size,) make; a given strain is not part of
        it.
        """
        return np.asarray(np.einsum("s,sab->ab", x[self.n_displacements :], self.unit_strains))

    @cached_property
    def wall_lines(self) -> Array:
        """(k d, k) matrix from the unknowns of the walls to the displacements of the walls along
        the axes: in each column the direction of a wall.
        """
        k = self.assembly.n_walls
        lines = np.zeros((k, self.assembly.dimension, k))
        lines[np.arange(k), :, np.arange(k)] = self.assembly.directions
        return lines.reshape(k * self.assembly.dimension, k)

    @cached_property
    def free_axes(self) -> list[int]:
        """The axes along which all balls may move together with no contact that hinders or pushes
        them. There are none if contacts turn and some join a ball to a held body or a wall that is
        not flat, as such contacts push balls aside.
        """
        assembly = self.assembly
        if self.turns and not np.all(assembly.is_between_balls | assembly.is_flat):
            return []
        return assembly.free_axes

    def remove_drift(self, motion: Array) -> Array:
        """Return a ``motion`` (size,) less the mean motion of the balls along the
        :attr:`free_axes`: a new array, or the same one where there are no such axes.
        """
        if not self.free_axes:
            return motion
        without_drift = motion.copy()
        assembly = self.assembly
        for axis in self.free_axes:
            along_axis = without_drift[axis : self.n_ball_unknowns : assembly.dimension]
            along_axis -= float(np.sum(along_axis)) / assembly.n_balls
        return without_drift

    def find_unit_losses(self, normal: Array) -> Array:
        """Return the numbers (n_c, s): what contacts along ``normal`` (n_c, 3) lose of their
        overlaps, m, over each unknown of a strain, m.
        """
        assembly = self.assembly
        losses = np.empty((len(self.unit_strains), assembly.n_contacts))
        no_displacement = np.zeros((assembly.n_bodies, 3))
        ends = (assembly.i, assembly.j, assembly.vector)
        for unit_strain, loss in zip(self.unit_strains, losses, strict=True):
            measure_losses(*ends, normal, no_displacement, unit_strain, loss)
        return losses.T

    def measure_losses(
        self, x: Array, normal: Array | None = None, strain: Array | None = None
    ) -> Array:
        """Return what contacts lose of their overlaps, (n_c,), m, at unknowns x (size,), to first
        order along ``normal`` (n_c, 3), by default that at touch; ``strain`` (3, 3) is added to
        that of the unknowns.
        """
        assembly = self.assembly
        direction = assembly.normal if normal is None else normal
        whole_strain = self.find_strain(x)
        if strain is not None:
            whole_strain = whole_strain + strain
        loss = np.empty(assembly.n_contacts)
        displacement = self.find_displacement(x)
        ends = (assembly.i, assembly.j, assembly.vector)
        measure_losses(*ends, direction, displacement, whole_strain, loss)
        return loss

    def make_losses(self) -> Any:
        """Return the sparse matrix (n_c, size), by rows, that takes unknowns, m, to what contacts
        lose of their overlaps, m, along their normals at touch.
        """
        from scipy.sparse import coo_array, hstack  # averages do not need it

        assembly = self.assembly
        of_bodies = assembly.make_losses().tocsc()
        n = self.n_ball_unknowns
        lines = self.wall_lines
        of_walls = coo_array(of_bodies[:, n : n + len(lines)] @ lines)
        of_strains = coo_array(self.find_unit_losses(assembly.normal))
        return hstack([of_bodies[:, :n], of_walls, of_strains], format="csr")

    def collect_forces(self, normal: Array, force: Array) -> Array:
        """Return the forces (size,), N, on the unknowns by forces of contacts, ``force`` (n_c,), N,
        along ``normal`` (n_c, 3); a force above zero pushes its balls apart.
        """
        assembly = self.assembly
        n = assembly.n_balls
        d = assembly.dimension
        on_bodies = np.zeros((assembly.n_bodies, 3))
        # without unknown strains the virial is not needed, and the loop leaves out one without rows
        virial = np.zeros((3 if len(self.unit_strains) else 0, 3))
        ends = (assembly.i, assembly.j, assembly.vector)
        add_forces(*ends, normal, force, on_bodies, virial)
        on_walls = on_bodies[n : n + assembly.n_walls, :d]
        forces = np.empty(self.size)
        forces[: n * d].reshape(n, d)[:] = on_bodies[:n, :d]
        if len(on_walls):
            on_lines = np.einsum("wa,wa->w", on_walls, assembly.directions)
            forces[n * d : self.n_displacements] = on_lines
        if len(self.unit_strains):
            forces[self.n_displacements :] = np.einsum("sab,ab->s", self.unit_strains, virial)
        return forces

    def start_at(self, x: Array, overlap: Array | None = None) -> Configuration:
        """Return the configuration at unknowns x (size,); ``overlap`` (n_c,) are the overlaps, m,
        by default those that follow from x.
        """
        if overlap is None and not self.turns:
            overlap = self.assembly.offset - self.measure_losses(x, strain=self.given_strain)
        return Configuration(self, x, overlap)


def _embed(strain: Array) -> Array:
    """Return a strain (p, p), or strains (s, p, p), of a cell as (3, 3) or (s, 3, 3), with zeros
    along the axes that have no period.
    """
    p = strain.shape[-1]
    embedded = np.zeros((*strain.shape[:-2], 3, 3))
    embedded[..., :p, :p] = strain
    return embedded


def turn_contacts(assembly: Assembly, displacement: Array, strain: Array) -> TurnedContacts:
    """Return the contacts of an ``assembly`` at the ``displacement`` (bodies, 3), m, of all bodies
    and the ``strain`` (3, 3) of the cell. Contacts with flat walls do not turn.
    """
    contacts = (assembly.i, assembly.j, assembly.vector, assembly.is_flat)
    return measure_turned(*contacts, displacement, strain)


class Configuration:
    """The contacts of a ``problem``, and the forces left, at unknowns x (size,).

    ``carried`` are the overlaps (n_c,), m, that a search on the lattice carries along, and must be
    given there; in exact directions the overlaps follow from x unless they are given, and those
    that are rounding are zero.

    Attributes
    ----------
    problem, x : those that are given.
    strain : (p, p) strain of the cell, the given strain of the load included.
    normal, current : (n_c, 3) unit vectors of the contacts, and the vectors from ball to ball, m.
    distance : (n_c,) lengths of the vectors ``current``, m.
    overlap, force : (n_c,) overlaps, m, and forces of the contacts, N.
    force_size : size of the forces of contacts, N, see
        :meth:`~granphon.contacts.laws.ContactLaws.size`, by which the forces left are measured.
    """

    def __init__(self, problem: Problem, x: Array, carried: Array | None = None) -> None:
        assembly = problem.assembly
        self.problem = problem
        self.x = x
        p = assembly.periods
        strain = problem.find_strain(x) + problem.given_strain
        self.strain = strain[:p, :p]
        if problem.turns:
            turned = turn_contacts(assembly, problem.find_displacement(x), strain)
            self.normal = turned.normal
            self.current = turned.current
            self.distance = turned.distance
            self.overlap = _round_overlaps(assembly, turned) if carried is None else carried
        else:
            assert carried is not None  # start_at has measured them
            self.overlap = carried
            self.normal = assembly.normal
            self.current = assembly.vector
            self.distance = assembly.distance
        self.force = assembly.laws.force(self.overlap)
        self.force_size = assembly.laws.size(self.force)

    @cached_property
    def deformation_gradient(self) -> Array:
        """(p, p) the unit matrix plus the strain, with which a vector of the cell at touch becomes
        that of the deformed cell.
        """
        return np.eye(len(self.strain)) + self.strain

    @cached_property
    def growth(self) -> float:
        """Determinant of :attr:`deformation_gradient`: the length, area or volume of the deformed
        cell over that at touch; 1 without a period. It is zero of a cell that is squeezed to
        nothing, and below zero of one that is turned inside out along one axis or three.
        """
        return float(np.linalg.det(self.deformation_gradient)) if len(self.strain) else 1.0

    @cached_property
    def load_force(self) -> Array:
        """(size,) forces of the load on the unknowns, N; in exact directions those on the cell as
        it is deformed. A stress does not act where the :attr:`growth` is not above zero, which no
        search accepts (:attr:`is_sound`).
        """
        problem = self.problem
        load = problem.load
        if not problem.load_changes:
            return problem.force
        force = load.force + (self.growth - 1.0) * load.pressure_force
        work = np.zeros(len(problem.unit_strains))
        if load.stress is not None and self.growth > 0.0:
            stress = load.stress @ np.linalg.inv(self.deformation_gradient) * self.growth
            work = problem.find_work(stress)
        return np.concatenate([force, work])

    @cached_property
    def load_slope(self) -> Array | None:
        """(size, k + s) derivatives of the forces of the load by the unknowns of walls and strains,
        N/m; None where these forces do not change. In exact directions they change with the
        strains: a stress acts on the deformed cell, and the forces of a pressure on faces grow with
        the cell. The columns of the walls are zero.
        """
        problem = self.problem
        load = problem.load
        p = len(self.strain)
        units = problem.unit_strains[:, :p, :p]
        if not (problem.turns and len(units)) or load.stress is None:
            # without a stress no strain is unknown, or a mean force is given, which presses on no
            # face
            return None
        n = problem.n_displacements
        k = problem.assembly.n_walls
        inverse = np.linalg.inv(self.deformation_gradient)
        slope = np.zeros((problem.size, k + len(units)))
        for column, unit in enumerate(units, start=k):
            # the derivatives of the growth g, 1/m, and of g F^-1 with the deformation gradient F
            growth_slope = self.growth * float(np.trace(inverse @ unit))
            inverse_slope = growth_slope * inverse - self.growth * inverse @ unit @ inverse
            slope[:n, column] = growth_slope * load.pressure_force
            slope[n:, column] = problem.find_work(load.stress @ inverse_slope)
        return slope

    @cached_property
    def pull(self) -> Array:
        """(size,) the forces left on the unknowns, N. Where contacts are given a mean force, the
        last entry, of the only strain of the cell, is instead the mean force of contacts less the
        given one, times the root of the number of contacts.
        """
        pull = self.load_force + self.problem.collect_forces(self.normal, self.force)
        given_force = self.problem.load.mean_force
        if given_force is not None:
            count = self.problem.assembly.n_contacts
            pull[-1] = math.sqrt(count) * (float(np.mean(self.force)) - given_force)
        return pull

    @cached_property
    def residual(self) -> float:
        """The largest force left, as on a ball (:attr:`Problem.weights`), over the size of the
        forces of contacts; infinite if that size is zero.
        """
        if not self.force_size:
            return math.inf
        left = np.abs(self.pull) * self.problem.weights
        return float(np.max(left, initial=0.0)) / self.force_size

    @cached_property
    def stiffness(self) -> Array:
        """(n_c,) stiffnesses of the contacts along their normals, N/m."""
        return self.problem.assembly.laws.stiffness(self.overlap)

    @cached_property
    def force_on_balls(self) -> Array:
        """(n,) size of the force left on each ball, N."""
        assembly = self.problem.assembly
        left = self.pull[: self.problem.n_ball_unknowns]
        by_ball = left.reshape(assembly.n_balls, assembly.dimension)
        return np.asarray(np.sqrt(np.einsum("na,na->n", by_ball, by_ball)))

    def list_columns(self, stiffness: Array, side_stiffness: Array) -> Columns:
        """Return the contacts as compiled loops read them, with ``stiffness`` (n_c,) along normals
        and ``side_stiffness`` (n_c,) across them, N/m; bodies do not rotate.
        """
        assembly = self.problem.assembly
        zeros = np.zeros(assembly.n_contacts)
        no_vectors = np.zeros((0, 3))
        return Columns(
            i=assembly.i,
            j=assembly.j,
            vector=assembly.vector,
            normal=self.normal,
            arm_i=zeros,
            arm_j=zeros,
            distance=self.distance,
            normal_stiffness=stiffness,
            shear_stiffness=zeros,
            torsion_stiffness=zeros,
            bending_stiffness=zeros,
            side_stiffness=side_stiffness,
            tangential_force=no_vectors,
            origin=no_vectors,
        )

    @cached_property
    def is_sound(self) -> bool:
        """Whether the configuration is possible: the unknowns are finite, contacts have a length
        and their forces a size (:attr:`force_size`) that is finite, and the cell is not turned
        inside out.
        """
        has_size = 0.0 < self.force_size < math.inf
        if not (has_size and np.all(np.isfinite(self.x)) and np.all(self.distance > 0.0)):
            return False
        # no eigenvalue of the strain is larger than the sum of the sizes of its entries
        if float(np.sum(np.abs(self.strain))) < 1.0:
            return True
        return float(np.min(np.linalg.eigvalsh(self.deformation_gradient))) > 0.0

    def move(self, x: Array, overlap: Array | None = None) -> Configuration:
        """Return the configuration at other unknowns x (size,), with the ``overlap`` (n_c,), m, of
        contacts there, which must be given unless contacts turn.
        """
        return Configuration(self.problem, x, overlap)


def _round_overlaps(assembly: Assembly, turned: TurnedContacts) -> Array:
    """Return the overlaps (n_c,), m, of the contacts ``turned`` of an ``assembly``; those that are
    rounding are zero.
    """
    overlap = np.empty(assembly.n_contacts)
    find_overlaps(assembly.offset, turned.loss, ROUNDING, overlap)
    return overlap
