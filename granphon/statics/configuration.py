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
    first order, each at a right angle to the others; there are s = p (p + 1)/2 - 1.
    """
    units = []
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
    return np.array(units).reshape(-1, periods, periods)


@dataclass(frozen=True, eq=False, repr=False)
class AppliedLoad:
    """What acts on an assembly; SI units.

    Attributes
    ----------
    force : (n d + k,) forces on the balls, then on the walls, N.
    words : what messages call the load.
    stress : (p, p) stress of the cell, tension above zero; None of a cell whose strain, or whose
        mean force of contacts, is given.
    strain : (p, p) the given strain; zeros if the strain is free.
    shears : whether a cell whose strain is given shears beside, until its stress is hydrostatic; in
        the directions of the lattice alone, where shears keep the size of the cell.
    pressure_force : (n d + k,) the part of ``force`` that grows with the area of the cell.
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
        """Whether there is a force on anything."""
        is_stressed = self.stress is not None and bool(np.any(self.stress))
        return bool(np.any(self.force)) or is_stressed or bool(self.mean_force)

    @property
    def is_given(self) -> bool:
        """Whether a strain is given that moves contacts."""
        return bool(np.any(self.strain))

    def scale(self, factor: float) -> AppliedLoad | None:
        """Return the load with its stress or mean force times a ``factor``; None of a load of
        forces on balls, or of a given strain.
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
    all, or the one that changes the size of the cell and not its shape. Where a strain is given,
    they are the shears of a load that ``shears``, and otherwise there are none.

    Attributes
    ----------
    assembly, load, boundary : those that are given.
    turns : whether contacts turn with their balls.
    n_ball_unknowns : number n d of the displacements of balls, which come first.
    n_displacements : number n d + k of all displacements.
    size : number n d + k + s of all unknowns.
    length : unknown of a strain over this strain, m.
    """

    def __init__(
        self, assembly: Assembly, load: AppliedLoad, geometry: Geometry, boundary: Boundary
    ) -> None:
        self.assembly = assembly
        self.load = load
        self.boundary = boundary
        self.turns = geometry == "exact"
        p = assembly.periods
        self.n_ball_unknowns = assembly.n_balls * assembly.dimension
        self.n_displacements = self.n_ball_unknowns + assembly.n_walls
        pairs = list(itertools.combinations_with_replacement(range(p), 2))
        shapes = np.zeros((0, p, p))
        if load.mean_force is not None or (load.stress is not None and boundary == "isotropic"):
            shapes = np.eye(p)[None] if p else shapes
        elif load.stress is not None:
            shapes = np.zeros((len(pairs), p, p))
            for shape, (a, b) in zip(shapes, pairs, strict=True):
                shape[a, b] = shape[b, a] = 1.0
        elif load.shears:
            assert not self.turns  # shears keep the size of a cell to first order only
            shapes = list_shears(p)
        # strains are scaled so that the forces on them, sums over all contacts, are comparable
        # with those on balls
        self.length = assembly.mean_distance * math.sqrt(assembly.n_contacts)
        #: (s, 3, 3) strains of the cell by the unknowns
        self.unit_strains = np.zeros((len(shapes), 3, 3))
        self.unit_strains[:, :p, :p] = shapes / self.length
        #: (3, 3) the given strain
        self.given_strain = np.zeros((3, 3))
        self.given_strain[:p, :p] = load.strain
        self.size = self.n_displacements + len(shapes)

    @cached_property
    def weights(self) -> Array:
        """(size,) factors by which the force left on an unknown becomes one as on a ball: 1 for
        balls, one over the number of balls at a wall, and for strains one over the root of the
        number of contacts and over the tolerance of the cell.
        """
        weights = np.ones(self.size)
        weights[self.n_ball_unknowns : self.n_displacements] = 1.0 / self.assembly.wall_balls
        of_cell = self.load.cell_tolerance * math.sqrt(self.assembly.n_contacts)
        weights[self.n_displacements :] = 1.0 / of_cell
        return weights

    @cached_property
    def force(self) -> Array:
        """(size,) forces of the load on the unknowns, on the cell as it is at touch."""
        stress = self.load.stress
        work = np.zeros(len(self.unit_strains)) if stress is None else self.find_work(stress)
        return np.concatenate([self.load.force, work])

    def find_work(self, stress: Array) -> Array:
        """Return the forces (s,), N, of a ``stress`` (p, p) on the s unknown strains: its work on
        the cell as it is at touch, for each unknown.
        """
        p = len(stress)
        unit_strains = self.unit_strains[:, :p, :p]
        return np.asarray(np.einsum("sab,ab->s", unit_strains, stress) * self.assembly.measure)

    def find_displacement(self, x: Array) -> Array:
        """Return the displacements (bodies, 3), m, of all bodies at unknowns x: of balls, of walls,
        and zeros of what is held.
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
        """(k d, k) matrix from the unknowns of the walls to their displacements along the axes."""
        k = self.assembly.n_walls
        lines = np.zeros((k, self.assembly.dimension, k))
        lines[np.arange(k), :, np.arange(k)] = self.assembly.directions
        return lines.reshape(k * self.assembly.dimension, k)

    @cached_property
    def free_axes(self) -> list[int]:
        """The axes along which all balls may move together with nothing that hinders or pushes
        them; none if contacts turn and some join a ball to a body that is held or to a wall, as
        such contacts push aside.
        """
        assembly = self.assembly
        if self.turns and not np.all(assembly.is_between_balls | assembly.is_flat):
            return []
        return assembly.free_axes

    def remove_drift(self, motion: Array) -> Array:
        """Return a ``motion`` (size,) less the mean motion of the balls along the
        :attr:`free_axes`.
        """
        if not self.free_axes:
            return motion
        still = motion.copy()
        for axis in self.free_axes:
            balls = slice(axis, self.n_ball_unknowns, self.assembly.dimension)
            still[balls] -= np.mean(still[balls])
        return still

    def find_unit_losses(self, normal: Array) -> Array:
        """Return what contacts along ``normal`` (n_c, 3) lose of their overlaps by the unit
        strains, (n_c, s).
        """
        assembly = self.assembly
        losses = np.empty((len(self.unit_strains), assembly.n_contacts))
        still = np.zeros((assembly.n_bodies, 3))
        ends = (assembly.i, assembly.j, assembly.vector)
        for unit_strain, loss in zip(self.unit_strains, losses, strict=True):
            measure_losses(*ends, normal, still, unit_strain, loss)
        return losses.T

    def measure_losses(
        self, x: Array, normal: Array | None = None, strain: Array | None = None
    ) -> Array:
        """Return what contacts lose of their overlaps, (n_c,), m, at unknowns x (size,), to first
        order along ``normal`` (n_c, 3), by default that at touch; ``strain`` (3, 3) is added to
        that of the unknowns.
        """
        assembly = self.assembly
        along = assembly.normal if normal is None else normal
        whole = self.find_strain(x)
        if strain is not None:
            whole = whole + strain
        loss = np.empty(assembly.n_contacts)
        displacement = self.find_displacement(x)
        ends = (assembly.i, assembly.j, assembly.vector)
        measure_losses(*ends, along, displacement, whole, loss)
        return loss

    def make_losses(self) -> Any:
        """Return the sparse matrix (n_c, size) that takes unknowns to what contacts lose of their
        overlaps along their normals at touch.
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
        """Return the forces (size,) on the unknowns by forces of contacts, ``force`` (n_c,), N,
        along ``normal`` (n_c, 3).
        """
        assembly = self.assembly
        n = assembly.n_balls
        d = assembly.dimension
        on_bodies = np.zeros((assembly.n_bodies, 3))
        virial = np.zeros((3, 3))
        asked = virial if len(self.unit_strains) else virial[:0]
        ends = (assembly.i, assembly.j, assembly.vector)
        add_forces(*ends, normal, force, on_bodies, asked)
        on_walls = on_bodies[n : n + assembly.n_walls, :d]
        forces = np.empty(self.size)
        forces[: n * d].reshape(n, d)[:] = on_bodies[:n, :d]
        forces[n * d : self.n_displacements] = np.einsum("wa,wa->w", on_walls, assembly.directions)
        forces[self.n_displacements :] = np.einsum("sab,ab->s", self.unit_strains, virial)
        return forces

    def start_at(self, x: Array, overlap: Array | None = None) -> Configuration:
        """Return the configuration at unknowns x; ``overlap`` (n_c,) are the overlaps, by default
        those that follow from x.
        """
        if overlap is None and not self.turns:
            overlap = self.assembly.offset - self.measure_losses(x, strain=self.given_strain)
        return Configuration(self, x, overlap)


class Configuration:
    """The contacts of a problem, and the forces left, at unknowns x (size,).

    ``carried`` are the overlaps (n_c,), m, that a search on the lattice carries along, and must be
    given there; in exact directions the overlaps follow from x unless they are given.

    Attributes
    ----------
    normal, current : (n_c, 3) unit vectors of the contacts, and the vectors from ball to ball, m.
    distance : (n_c,) lengths of these vectors, m.
    overlap, force : (n_c,) overlaps, m, and forces of the contacts, N.
    force_size : size of these forces, N, see :meth:`~granphon.contacts.laws.ContactLaws.size`, by
        which the forces left are measured.
    """

    def __init__(self, problem: Problem, x: Array, carried: Array | None = None) -> None:
        assembly = problem.assembly
        self.problem = problem
        self.x = x
        p = assembly.periods
        strain = problem.find_strain(x) + problem.given_strain
        #: (p, p) strain of the cell
        self.strain = strain[:p, :p]
        if problem.turns:
            measured = self._measure(strain)
            self.overlap = measured if carried is None else carried
        else:
            assert carried is not None  # start_at has measured them
            self.overlap = carried
            self.normal = assembly.normal
            self.current = assembly.vector
            self.distance = assembly.distance
        self.force = assembly.laws.force(self.overlap)
        self.force_size = assembly.laws.size(self.force)

    def _measure(self, strain: Array) -> Array:
        """Set vectors, distances and normals of contacts that turn, at the displacements of x and a
        ``strain`` (3, 3) of the cell, and return their overlaps (n_c,). Overlaps that are rounding
        are zero.
        """
        assembly = self.problem.assembly
        loss = np.empty(assembly.n_contacts)
        self.current = np.empty((assembly.n_contacts, 3))
        self.distance = np.empty(assembly.n_contacts)
        self.normal = np.empty((assembly.n_contacts, 3))
        displacement = self.problem.find_displacement(self.x)
        ends = (assembly.i, assembly.j, assembly.vector, assembly.is_flat)
        places = (self.current, self.distance, self.normal)
        measure_turned(*ends, displacement, strain, loss, *places)
        overlap = np.empty(assembly.n_contacts)
        find_overlaps(assembly.offset, loss, ROUNDING, overlap)
        return overlap

    @cached_property
    def deformed(self) -> Array:
        """(p, p) deformation gradient of the cell, one plus the strain."""
        return np.eye(len(self.strain)) + self.strain

    @cached_property
    def growth(self) -> float:
        """Measure of the deformed cell over that at touch, as of its volume in space."""
        return float(np.linalg.det(self.deformed)) if len(self.strain) else 1.0

    @cached_property
    def load_force(self) -> Array:
        """(size,) forces of the load on the unknowns, N; in exact directions those on the cell as
        it is deformed.
        """
        problem = self.problem
        load = problem.load
        if not problem.turns or not len(self.strain):
            return problem.force
        force = load.force + (self.growth - 1.0) * load.pressure_force
        work = np.zeros(len(problem.unit_strains))
        if load.stress is not None and self.growth > 0.0:
            stress = load.stress @ np.linalg.inv(self.deformed) * self.growth
            work = problem.find_work(stress)
        return np.concatenate([force, work])

    @cached_property
    def load_slope(self) -> Array | None:
        """(size, k + s) derivatives of the load's forces by the unknowns of walls and strains, N/m;
        None of a load whose forces do not change. In exact directions a stress acts on the deformed
        cell, and its forces change with the strains; the columns of the walls are zero.
        """
        problem = self.problem
        load = problem.load
        p = len(self.strain)
        units = problem.unit_strains[:, :p, :p]
        if not (problem.turns and len(units)) or load.stress is None:
            return None
        n = problem.n_displacements
        k = problem.assembly.n_walls
        inverse = np.linalg.inv(self.deformed)
        slope = np.zeros((problem.size, k + len(units)))
        for column, unit in enumerate(units, start=k):
            grown = self.growth * float(np.trace(inverse @ unit))
            slope[:n, column] = grown * load.pressure_force
            turned = grown * inverse - self.growth * inverse @ unit @ inverse
            slope[n:, column] = problem.find_work(load.stress @ turned)
        return slope

    @cached_property
    def pull(self) -> Array:
        """(size,) the forces left on the unknowns, N. Where contacts are given a mean force, the
        entry of the cell's strain is instead what their mean force has beyond the given one, times
        the root of the number of contacts.
        """
        pull = self.load_force + self.problem.collect_forces(self.normal, self.force)
        wanted = self.problem.load.mean_force
        if wanted is not None:
            count = self.problem.assembly.n_contacts
            pull[-1] = math.sqrt(count) * (float(np.mean(self.force)) - wanted)
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
        """(n_c,) stiffnesses, N/m."""
        return self.problem.assembly.laws.stiffness(self.overlap)

    @cached_property
    def force_on_balls(self) -> Array:
        """(n,) the force left on each ball, N."""
        assembly = self.problem.assembly
        left = self.pull[: self.problem.n_ball_unknowns]
        return np.asarray(
            np.linalg.norm(left.reshape(assembly.n_balls, assembly.dimension), axis=1)
        )

    def list_columns(self, stiffness: Array, side_stiffness: Array) -> Columns:
        """Return the contacts as compiled loops read them, with ``stiffness`` (n_c,) along normals
        and ``side_stiffness`` (n_c,) across them, N/m; bodies do not rotate.
        """
        assembly = self.problem.assembly
        nothing = np.zeros(assembly.n_contacts)
        none = np.zeros((0, 3))
        return Columns(
            i=assembly.i,
            j=assembly.j,
            vector=assembly.vector,
            normal=self.normal,
            arm_i=nothing,
            arm_j=nothing,
            distance=self.distance,
            normal_stiffness=stiffness,
            shear_stiffness=nothing,
            torsion_stiffness=nothing,
            bending_stiffness=nothing,
            side_stiffness=side_stiffness,
            tangential_force=none,
            origin=none,
        )

    @cached_property
    def is_sound(self) -> bool:
        """Whether the configuration is possible: the unknowns are finite, contacts have a length,
        some carry a force, and the cell is not turned inside out.
        """
        if not (self.force_size and np.all(np.isfinite(self.x)) and np.all(self.distance > 0.0)):
            return False
        return not len(self.strain) or float(np.min(np.linalg.eigvalsh(self.deformed))) > 0.0

    def move(self, x: Array, overlap: Array | None = None) -> Configuration:
        """Return the configuration at other unknowns x (size,), with the overlaps (n_c,) there,
        which must be given unless contacts turn.
        """
        return Configuration(self.problem, x, overlap)
