"""The motions of balls: which displacements and rotations each of them has.

A ball has six, three displacements u and three rotations phi. Which of them move is data, held here; what is made of the
motions asks a :class:`Motions` how many there are, which of them turn, and what they are called.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from numpy.typing import ArrayLike, NDArray

from granphon.base.results import read_only

__all__ = ["ALL", "IN_PLANE", "LONGITUDINAL", "OUT_OF_PLANE", "TRANSLATIONS_IN_PLANE", "Motions", "select_motions"]


@dataclass(frozen=True)
class Motions:
    """The motions of each ball: displacements first, then rotations. A rotation is carried by w = R_g phi, a length.

    Attributes
    ----------
    name : "longitudinal", "in_plane", "out_of_plane" or "all".
    translations : the axes of u, as numbers of x, y, z.
    rotations : the axes of phi, as numbers of x, y, z.
    """

    name: str
    translations: tuple[int, ...]
    rotations: tuple[int, ...] = ()

    @property
    def count(self) -> int:
        """How many motions a ball has."""
        return len(self.translations) + len(self.rotations)

    @property
    def rotate(self) -> bool:
        """Whether balls rotate."""
        return bool(self.rotations)

    @property
    def translating(self) -> slice:
        """Which motions are displacements."""
        return slice(0, len(self.translations))

    @property
    def turning(self) -> slice:
        """Which motions are rotations."""
        return slice(len(self.translations), self.count)

    @cached_property
    def is_rotation(self) -> NDArray[np.bool_]:
        """(count,) whether each motion is a rotation."""
        return np.arange(self.count) >= len(self.translations)

    @cached_property
    def phases(self) -> NDArray[np.complex128]:
        """(count,) factor of each motion that makes the waves of one ball real: 1 of displacements, i of rotations."""
        return read_only(np.where(self.is_rotation, 1.0j, 1.0))

    @property
    def letters(self) -> tuple[str, ...]:
        """Name of each motion: "x", "y", "z" of displacements; of rotations "w" in the plane, else "w_x", "w_y", "w_z"."""
        turns = ("w",) if self.rotations == (2,) else tuple(f"w_{'xyz'[axis]}" for axis in self.rotations)
        return (*("xyz"[axis] for axis in self.translations), *turns)

    @property
    def atoms_per_ball(self) -> int:
        """How many atoms with three coordinates hold the motions of a ball: two if it moves and turns along one axis."""
        return 2 if set(self.translations) & set(self.rotations) else 1

    @property
    def slots(self) -> tuple[int, ...]:
        """The coordinate, among the 3 x :attr:`atoms_per_ball` of a ball, in which each motion stands.

        With one atom each motion stands at its axis: (u_x, u_y, w) in the plane, (w_x, w_y, u_z) out of it. With two, the
        first atom holds u and the second w.
        """
        first_turn = 3 * (self.atoms_per_ball - 1)
        return (*self.translations, *(first_turn + axis for axis in self.rotations))

    @property
    def still_slots(self) -> tuple[int, ...]:
        """The coordinates of :attr:`slots` in which no motion stands."""
        return tuple(sorted(set(range(3 * self.atoms_per_ball)) - set(self.slots)))


#: motions in the plane: u_x, u_y, phi_z
IN_PLANE = Motions("in_plane", (0, 1), (2,))
#: motions in the plane where nothing resists rotation: u_x, u_y
TRANSLATIONS_IN_PLANE = replace(IN_PLANE, rotations=())
#: motions out of the plane: u_z, phi_x, phi_y
OUT_OF_PLANE = Motions("out_of_plane", (2,), (0, 1))
#: motions along a chain: u_x
LONGITUDINAL = Motions("longitudinal", (0,))
#: all six motions
ALL = Motions("all", (0, 1, 2), (0, 1, 2))


def select_motions(
    mindlin_ratio: ArrayLike, torsion: ArrayLike = 0.0, bending: ArrayLike = 0.0, among: Motions = IN_PLANE
) -> Motions:
    """Select the motions of balls from those of ``among``: all displacements, and rotations if a contact resists them.

    Parameters
    ----------
    mindlin_ratio : stiffness of slip over that of elongation, eta.
    torsion, bending : stiffness of twist and of rolling, over k d^2.
    among : the motions that are asked for.
    """
    return among if np.any(mindlin_ratio) or np.any(torsion) or np.any(bending) else replace(among, rotations=())
