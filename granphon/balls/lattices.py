"""Lattices of equal balls in the plane, and directions in the plane.

A lattice is data: a cell, in units of the distance between touching balls, and the sites in it. Its
:class:`~granphon.balls.contact_table.ContactTable` says which of its balls touch, and in what direction.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from granphon.balls.contact_table import TOUCH, ContactTable, find_contacts
from granphon.base.arguments import real_array
from granphon.base.errors import InputError, brief, message
from granphon.base.results import read_only

__all__ = [
    "BALL", "KAGOME", "LATTICES", "SQUARE", "TRIANGULAR", "Lattice", "as_direction", "find_lattice", "one_direction",
]  # fmt: skip

Array = NDArray[np.float64]
#: chemical symbol that stands for a ball in Atoms and files; its mass is always given
BALL = "Fe"


@dataclass(frozen=True)
class Lattice:
    """A lattice of equal balls in the plane.

    Parameters
    ----------
    name : the name of the lattice in messages and files.
    cell : the two lattice vectors as rows, in units of the distance between the centres of touching balls (the spacing).
    sites : the positions of the balls, in fractions of the lattice vectors.

    Raises
    ------
    InputError : the name is not a text, the cell has almost no area, balls overlap, a ball touches no other, or equal
        contact forces leave a ball out of balance.
    """

    name: str
    cell: tuple[tuple[float, float], tuple[float, float]]
    sites: tuple[tuple[float, float], ...] = ((0.0, 0.0),)

    def __post_init__(self) -> None:
        if not isinstance(self.name, str):
            raise InputError(message(f"the name of a lattice is {brief(self.name)}", mend="Give a text"))
        # lists and arrays become tuples, so that a Lattice is hashable and cannot change
        try:
            cell = real_array("cell", self.cell).reshape(2, 2)
            sites = real_array("sites", self.sites).reshape(-1, 2)
        except ValueError as error:
            why = str(error) if isinstance(error, InputError) else ""
            what = f"lattice {self.name!r}: the cell must be two vectors and each site two fractions"
            raise InputError(message(what, why)) from None
        if not (np.all(np.isfinite(cell)) and np.all(np.isfinite(sites)) and len(sites)):
            raise InputError(message(f"lattice {self.name!r} has a number that is not finite, or no site"))
        (ax, ay), (bx, by) = cell.tolist()
        object.__setattr__(self, "cell", ((ax, ay), (bx, by)))
        object.__setattr__(self, "sites", tuple((float(x), float(y)) for x, y in sites))
        if abs(np.linalg.det(cell)) < 0.1:
            raise InputError(message(f"the cell of lattice {self.name!r} is too small for a ball of diameter one"))
        table, pull = self.contacts, np.zeros((self.n_balls, 2))
        np.add.at(pull, table.j, table.normal)
        np.add.at(pull, table.i, -table.normal)
        if np.max(np.abs(pull)) > TOUCH:
            raise InputError(
                message(
                    f"lattice {self.name!r} is not in equilibrium: equal contact forces push ball"
                    f" {int(np.argmax(np.abs(pull).max(axis=1)))} aside",
                    "All contacts of equal balls under load carry the same force here",
                    "Use a lattice in which the directions of each ball's contacts add up to zero",
                )
            )

    @property
    def n_balls(self) -> int:
        """Number of balls in the cell."""
        return len(self.sites)

    @cached_property
    def vectors(self) -> Array:
        """(2, 2) lattice vectors as rows, in units of the spacing."""
        return read_only(self.cell)

    @cached_property
    def positions(self) -> Array:
        """(n, 2) centres of the balls, in units of the spacing."""
        return read_only(np.asarray(self.sites) @ self.vectors)

    @cached_property
    def area(self) -> float:
        """Area of the cell, in units of the spacing squared."""
        return float(abs(np.linalg.det(self.vectors)))

    @cached_property
    def contacts(self) -> ContactTable:
        """The contacts of one cell at spacing one, each once."""
        return find_contacts(self.vectors, self.positions, self.name)

    @property
    def coordination(self) -> float:
        """Mean number of contacts of a ball."""
        return 2.0 * len(self.contacts) / self.n_balls

    @property
    def pressure_factor(self) -> float:
        """Reduced pressure P d / f: sqrt(3) for the triangular lattice (equation 20), 1 for the square one.

        Raises :class:`InputError` if equal contact forces make a stress that is not an isotropic pressure.
        """
        stress = self.contacts.normal.T @ self.contacts.normal / self.area
        if abs(stress[0, 0] - stress[1, 1]) + 2.0 * abs(stress[0, 1]) > TOUCH:
            raise InputError(
                message(
                    f"the stress of lattice {self.name!r} is not a pressure",
                    f"Equal contact forces stress it by {np.round(stress, 6).tolist()} f/d",
                    "Load it by force or overlap",
                )
            )
        return float(np.trace(stress)) / 2.0

    @property
    def area_per_ball(self) -> float:
        """Area of the cell per ball, in units of the spacing squared."""
        return self.area / self.n_balls


_HALF_SQRT3 = float(np.sqrt(3.0) / 2.0)
#: ASE's HEX2D cell, 120 degrees: K = (1/3, 1/3, 0), M = (1/2, 0, 0)
TRIANGULAR = Lattice("triangular", ((1.0, 0.0), (-0.5, _HALF_SQRT3)))
SQUARE = Lattice("square", ((1.0, 0.0), (0.0, 1.0)))
KAGOME = Lattice("kagome", ((2.0, 0.0), (-1.0, 2.0 * _HALF_SQRT3)), ((0.5, 0.0), (0.0, 0.5), (0.5, 0.5)))
LATTICES: dict[str, Lattice] = {lattice.name: lattice for lattice in (TRIANGULAR, SQUARE, KAGOME)}


def find_lattice(lattice: str | Lattice) -> Lattice:
    """Find the lattice of a name; a :class:`Lattice` is returned itself. Raises :class:`InputError` for an unknown name."""
    if isinstance(lattice, Lattice):
        return lattice
    if isinstance(lattice, str) and lattice in LATTICES:
        return LATTICES[lattice]
    raise InputError(
        message(f"unknown lattice {brief(lattice)}", mend="Use " + ", ".join(LATTICES) + ", or a granphon.Lattice")
    )


def as_direction(direction: ArrayLike) -> Array:
    """``direction`` as a Cartesian unit vector (2,), or as (n, 2) unit vectors for (n, 2) directions.

    Raises :class:`InputError` for another shape, a number that is not finite, or a direction (0, 0).
    """
    vector: Any = real_array("direction", direction)
    largest = np.max(np.abs(vector), axis=-1, keepdims=True) if vector.ndim in (1, 2) and vector.size else np.zeros(1)
    if vector.shape[-1:] != (2,) or not (np.all(np.isfinite(vector)) and np.all(largest > 0.0)):
        raise InputError(
            message(
                f"direction is {brief(direction)}",
                "A direction is two finite numbers, x and y, not both zero",
                "Give (x, y), or an array (n, 2) of directions",
            )
        )
    vector = vector / largest
    return np.asarray(vector / np.linalg.norm(vector, axis=-1, keepdims=True))


def one_direction(direction: ArrayLike) -> Array:
    """``direction`` as one Cartesian unit vector (2,).

    Raises :class:`InputError` for what :func:`as_direction` refuses, and for more than one direction.
    """
    along = as_direction(direction)
    if along.ndim > 1:
        raise InputError(
            message(
                f"direction is {brief(direction)}", "This quantity is found along one direction at a time", "Give (x, y)"
            )
        )
    return along
