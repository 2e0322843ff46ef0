"""The motions of balls: which displacements and rotations each ball has.

In space a ball has six motions, three displacements u and three rotations phi. A :class:`Motions`
says which of them are free; other modules ask it how many there are, which of them are rotations,
and what they are called.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from numpy.typing import ArrayLike, NDArray

from granphon.base.results import read_only


@dataclass(frozen=True)
class Motions:
    """The motions of each ball: displacements first, then rotations. Lattice dynamics hold a
    rotation phi as the length w = R_g phi, with the radius of gyration R_g of the ball; networks
    and motions in time hold phi, rad.

    Attributes
    ----------
    name : "longitudinal", "in_plane", "out_of_plane" or "all".
    translations : the axes of u: 0, 1, 2 for x, y, z.
    rotations : the axes of phi: 0, 1, 2 for x, y, z.
    """

    name: str
    translations: tuple[int, ...]
    rotations: tuple[int, ...] = ()

    @cached_property
    def count(self) -> int:
        """Number of motions of a ball."""
        return len(self.translations) + len(self.rotations)

    @property
    def rotate(self) -> bool:
        """Whether balls rotate."""
        return bool(self.rotations)

    @property
    def twist(self) -> bool:
        """Whether contacts twist: whether some rotation has a part about their normals. On a line
        and in the plane no normal has a component along z, so that a rotation about z has none.
        """
        return any(axis in self.rotations for axis in (0, 1))

    @property
    def translating(self) -> slice:
        """Slice of the motions that are displacements."""
        return slice(0, len(self.translations))

    @property
    def turning(self) -> slice:
        """Slice of the motions that are rotations."""
        return slice(len(self.translations), self.count)

    @cached_property
    def is_rotation(self) -> NDArray[np.bool_]:
        """(count,) whether each motion is a rotation."""
        return read_only(np.arange(self.count) >= len(self.translations))

    @cached_property
    def phases(self) -> NDArray[np.complex128]:
        """(count,) factor of each motion, 1 of displacements and i of rotations, with which the
        amplitudes of waves of a lattice of one ball are real.
        """
        return read_only(np.where(self.is_rotation, 1.0j, 1.0))

    @property
    def letters(self) -> tuple[str, ...]:
        """Name of each motion: "x", "y", "z" for displacements; for rotations "w" in the plane,
        else "w_x", "w_y", "w_z".
        """
        displacements = tuple("xyz"[axis] for axis in self.translations)
        if self.rotations == (2,):
            return (*displacements, "w")
        return displacements + tuple(f"w_{'xyz'[axis]}" for axis in self.rotations)

    @cached_property
    def atoms_per_ball(self) -> int:
        """Number of atoms, of three coordinates each, that hold the motions of a ball.

        Two if some axis has both a displacement and a rotation, else one.
        """
        return 2 if set(self.translations) & set(self.rotations) else 1

    @property
    def slots(self) -> tuple[int, ...]:
        """Index of the coordinate that holds each motion, among the 3 x :attr:`atoms_per_ball`
        coordinates of a ball.

        With one atom each motion takes the coordinate of its axis: (u_x, u_y, w) in the plane,
        (w_x, w_y, u_z) out of it. With two atoms, the first holds u and the second w.
        """
        first_rotation_slot = 3 * (self.atoms_per_ball - 1)
        return (*self.translations, *(first_rotation_slot + axis for axis in self.rotations))

    @property
    def still_slots(self) -> tuple[int, ...]:
        """Indices of the coordinates of a ball that hold no motion, see :attr:`slots`."""
        return tuple(sorted(set(range(3 * self.atoms_per_ball)) - set(self.slots)))


#: motions in the plane: u_x, u_y, phi_z
IN_PLANE = Motions("in_plane", (0, 1), (2,))
#: motions out of the plane: u_z, phi_x, phi_y
OUT_OF_PLANE = Motions("out_of_plane", (2,), (0, 1))
#: motions along a chain: u_x
LONGITUDINAL = Motions("longitudinal", (0,))
#: all six motions
ALL = Motions("all", (0, 1, 2), (0, 1, 2))


def allowed_motions(dimension: int) -> dict[str, Motions]:
    """Return the motions that balls on a line, in a plane or in space (``dimension`` 1, 2, 3) may
    have, by name, the default first.

    Contacts couple none of these sets of motions to motions outside of the set.
    """
    motions_of_dimension = {
        1: (LONGITUDINAL, IN_PLANE, OUT_OF_PLANE, ALL),
        2: (IN_PLANE, OUT_OF_PLANE, ALL),
        3: (ALL,),
    }
    return {motions.name: motions for motions in motions_of_dimension[dimension]}


def default_motions(dimension: int) -> Motions:
    """Return the motions that balls of a ``dimension`` of 1, 2 or 3 have if none are named: those
    along the line, in the plane, or all in space.
    """
    return next(iter(allowed_motions(dimension).values()))


def find_motions(dimension: int, name: str | None) -> Motions:
    """Return the motions with a ``name`` that balls of a ``dimension`` of 1, 2 or 3 may have; those
    of :func:`default_motions` if the name is None. Raises KeyError for another name.
    """
    return default_motions(dimension) if name is None else allowed_motions(dimension)[name]


def select_motions(
    mindlin_ratio: ArrayLike,
    torsion: ArrayLike = 0.0,
    bending: ArrayLike = 0.0,
    among: Motions = IN_PLANE,
    on_site: ArrayLike | None = None,
) -> Motions:
    """Return the motions of balls selected from those of ``among``: all displacements, and all
    rotations if contacts, or springs to the ground, resist one of them.

    Shear and bending resist rotations across the normal of a contact, torsion those along it. So
    torsion alone resists nothing where balls of a plane turn about z only.

    Parameters
    ----------
    mindlin_ratio : eta, the shear over the normal stiffness of a contact.
    torsion, bending : stiffness of a contact against twist and against rolling, in units of k d^2.
    among : the motions to select from.
    on_site : (..., motions) stiffnesses of springs to the ground against the motions ``among``;
        None without springs.
    """
    resists_slip = np.any(mindlin_ratio)
    resists_rolling = np.any(bending)
    resists_twist = np.any(torsion) and among.twist
    resists_turning = on_site is not None and np.any(np.asarray(on_site)[..., among.turning])
    if resists_slip or resists_rolling or resists_twist or resists_turning:
        return among
    return replace(among, rotations=())
