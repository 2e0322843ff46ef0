"""A list of the contacts of balls at rest: who touches whom, where, how stiff each contact is, and
what static forces it bears.

The list is all that loops over contacts, and what stands on them, know of balls: of an array in the
directions of its lattice or in its true ones, of a network. It holds no law; stiffnesses are
derivatives at rest. Units are those of whoever makes the list: a length, a stiffness, and force =
stiffness x length; rotations are in rad where displacements are in the unit of length.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from granphon.balls.motions import Motions
from granphon.base.arrays import Array
from granphon.contacts.columns import Columns


@dataclass(frozen=True, eq=False, repr=False)
class ContactList:
    """The contacts of balls at rest.

    Attributes
    ----------
    n_balls : number of balls n.
    motions : what each ball can do, m motions.
    i, j : (n_c,) numbers of the two balls of each contact.
    vector : (n_c, 3) from the centre of ball i to that of ball j, which may be an image.
    normal : (n_c, 3) unit vector across the contact, from ball i to ball j.
    arm_i, arm_j : (n_c,) distances from the centres to the contact.
    normal_stiffness : (n_c,) force over elongation; zero where balls are apart.
    shear_stiffness : (n_c,) force over slip.
    torsion_stiffness, bending_stiffness : (n_c,) torque over twist and over roll.
    normal_force : (n_c,) static force along the normal, above zero where balls are pressed
        together; zeros where static forces do not act on small motions.
    tangential_force : (n_c, 3) static force of ball i on ball j across the normal; (0, 3) if there
        is none.
    origin : (n_c, 3) normals from which tangents, and the tangential force with them, are carried
        with the balls; (0, 3) if the force does not turn about the normal.
    leaning : (n_c,) whether the static force f along the normal resists displacements across the
        normal, with the stiffness f/r; at all other contacts f supports these displacements, with
        the stiffness -f/r. r is the distance of the centres. (0,) if no contact leans.
    grid : numbers of cells (L1, ..., Lp) of a list that is a grid; empty for other lists. In a grid
        of C cells ball b of cell c has the number b C + c, and the contact of kind k that starts in
        cell c has the number k C + c.
    measure : length, area or volume of the cell.
    dimension : 1, 2 or 3, the number p of axes that strains of the cell have.
    """

    n_balls: int
    motions: Motions
    i: NDArray[np.int64]
    j: NDArray[np.int64]
    vector: Array
    normal: Array
    arm_i: Array
    arm_j: Array
    normal_stiffness: Array
    shear_stiffness: Array
    torsion_stiffness: Array
    bending_stiffness: Array
    normal_force: Array
    measure: float
    dimension: int
    tangential_force: Array = field(default_factory=lambda: np.zeros((0, 3)))
    origin: Array = field(default_factory=lambda: np.zeros((0, 3)))
    leaning: NDArray[np.bool_] = field(default_factory=lambda: np.zeros(0, bool))
    grid: tuple[int, ...] = ()

    @property
    def n_contacts(self) -> int:
        """Number n_c of contacts."""
        return len(self.i)

    @cached_property
    def distance(self) -> Array:
        """(n_c,) distances of the centres."""
        return np.asarray(np.sqrt(np.einsum("ca,ca->c", self.vector, self.vector)))

    @cached_property
    def side_stiffness(self) -> Array:
        """(n_c,) stiffness against displacements across the normal that the static force f along
        the normal makes: -f/r with the distance r of the centres, and f/r where contacts lean.
        """
        side_stiffness = -self.normal_force / self.distance
        if self.leaning.size:
            side_stiffness = np.where(self.leaning, -side_stiffness, side_stiffness)
        return np.asarray(side_stiffness)

    @property
    def has_tangential_force(self) -> bool:
        """Whether some static force across a normal is not zero: the tangent is then not
        symmetric.
        """
        return bool(np.any(self.tangential_force))

    @cached_property
    def axes(self) -> NDArray[np.int64]:
        """(m,) axes of the motions of a ball: 0 to 2 of displacements, 3 to 5 of rotations."""
        turning = [3 + axis for axis in self.motions.rotations]
        return np.array([*self.motions.translations, *turning], np.int64)

    @property
    def columns(self) -> Columns:
        """The arrays that compiled loops read; without tangential forces, ``tangential_force`` and
        ``origin`` are (0, 3).
        """
        has_force = self.has_tangential_force
        no_vectors = np.zeros((0, 3))
        return Columns(
            i=self.i,
            j=self.j,
            vector=self.vector,
            normal=self.normal,
            arm_i=self.arm_i,
            arm_j=self.arm_j,
            distance=self.distance,
            normal_stiffness=self.normal_stiffness,
            shear_stiffness=self.shear_stiffness,
            torsion_stiffness=self.torsion_stiffness,
            bending_stiffness=self.bending_stiffness,
            side_stiffness=self.side_stiffness,
            tangential_force=self.tangential_force if has_force else no_vectors,
            origin=self.origin if has_force else no_vectors,
        )

    def find_stress(self) -> Array:
        """Return the Cauchy stress (p, p) of the static forces, force over length^(p - 1); it is
        below zero where balls are pressed together. It is not symmetric if torques on balls are not
        balanced.
        """
        force = -self.normal_force[:, None] * self.normal
        if len(self.tangential_force):
            force = force - self.tangential_force
        p = self.dimension
        return np.asarray(np.einsum("ca,cb->ab", force[:, :p], self.vector[:, :p]) / self.measure)
