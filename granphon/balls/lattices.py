"""Lattices of equal balls in one, two and three dimensions, and directions in them.

A lattice is data: a cell, in units of the distance between touching balls, and the sites in it. Its
:class:`~granphon.balls.neighbours.ContactTable` says which of its balls touch, and in what
direction.
"""

from __future__ import annotations

import math
from collections.abc import Iterable
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from granphon.balls.neighbours import TOUCH, ContactTable, find_contacts
from granphon.base.arrays import Array
from granphon.base.errors import InputError, brief
from granphon.base.registry import Registry
from granphon.base.results import read_only, write_html
from granphon.base.text import counted
from granphon.base.validation import is_one_of, label, real_array, require

#: chemical symbol that stands for a ball in Atoms and files; its mass is always given
BALL = "Fe"
#: least length, area or volume of a cell, in spacings; smaller ones hold no ball, and their inverse
#: has no digits
_LEAST_MEASURE = 0.1
#: greatest number of a cell or a site
_MOST_NUMBER = 1e6
#: what a direction is on a line, in the plane and in space, and how it is given
_DIRECTIONS = (
    ("one finite number, x, not zero", "(1,) or (-1,)"),
    ("two finite numbers, x and y, not both zero", "(x, y)"),
    ("three finite numbers, x, y and z, not all zero", "(x, y, z)"),
)
#: SI units on a line, in the plane and in space; moduli and density of a plane are those of a layer
#: one diameter thick
_UNITS = {
    "pressure": ("N", "N/m", "Pa"),
    "effective_density": ("kg/m", "kg/m^3", "kg/m^3"),
    "modulus": ("N", "Pa", "Pa"),
}
#: the lattices that have a name, by name; filled below
LATTICES: Registry[Lattice] = Registry("lattice")


@dataclass(frozen=True)
class Lattice:
    """A lattice of equal balls with p periods in d dimensions, p <= d <= 3.

    Parameters
    ----------
    name : the name of the lattice in messages and files.
    cell : (p, d) the lattice vectors as rows, in units of the distance between the centres of
        touching balls (the spacing). With fewer periods than dimensions, a single period lies along
        x, and two lie in the xy plane.
    sites : (n, p) the positions of the balls, in fractions of the lattice vectors; or (n, d), where
        the last d - p numbers are coordinates across the periods, in spacings. One ball at the
        origin if left out.

    Raises
    ------
    InputError : the name is not a text, is empty, has letters that cannot be seen, begins with a
        sign that makes it a formula to a spreadsheet (=, +, -, @), or is that of a known lattice
        with another cell or other sites; the cell is not one of p <= d <= 3 vectors, does not lie
        along x or in the xy plane, has almost no extent or is too oblique; the sites have another
        shape; a number is not finite or above 1e6; balls overlap, a ball touches no other, balls
        miss each other by less than a thousandth of the spacing, contacts do not join all balls, or
        equal contact forces leave a ball out of balance.
    """

    name: str
    cell: tuple[tuple[float, ...], ...]
    sites: tuple[tuple[float, ...], ...] = ((),)

    def __post_init__(self) -> None:
        """Check the name, the cell and the sites, find the contacts, and check that equal contact
        forces balance. Cell and sites are kept as tuples.
        """
        require("the name of a lattice", label, self.name)
        cell, sites = self._read_cell()
        if not (np.all(np.isfinite(cell)) and np.all(np.isfinite(sites))):
            raise InputError(
                f"lattice {self.name!r} has a number that is not finite", mend="Give finite numbers"
            )
        largest_number = max(np.max(np.abs(cell)), np.max(np.abs(sites)))
        if largest_number > _MOST_NUMBER:
            why = "Lengths are in spacings of touching balls, sites in fractions of the cell"
            raise InputError(
                f"lattice {self.name!r} has a number of size {largest_number:g}",
                why,
                f"Give numbers up to {_MOST_NUMBER:g}",
            )
        periods = len(cell)
        if np.any(cell[:, periods:]):
            where = "along x" if periods == 1 else "in the xy plane"
            raise InputError(
                f"the cell of lattice {self.name!r} does not lie {where}", mend="Turn the lattice"
            )
        # lists and arrays become tuples, so that a Lattice is hashable and cannot change
        object.__setattr__(self, "cell", tuple(map(tuple, cell.tolist())))
        object.__setattr__(self, "sites", tuple(map(tuple, sites.tolist())))
        if self.measure < _LEAST_MEASURE:
            raise InputError(
                f"the cell of lattice {self.name!r} is too small for a ball of diameter one",
                mend="Give lengths in diameters",
            )
        self._require_balance()
        self._require_own_name()

    def _read_cell(self) -> tuple[Array, Array]:
        """Return the cell (p, d) and the sites (n, p) or (n, d) as arrays; InputError for other
        shapes.
        """
        problem = (
            f"lattice {self.name!r}: the cell must be one to three vectors, and each site as many"
            f" fractions"
        )
        mend = (
            "Give a cell (p, d) of p vectors in d dimensions, p <= d <= 3, and sites (n, p) or"
            " (n, d)"
        )
        try:
            cell = real_array("cell", self.cell)
            sites = real_array("sites", self.sites)
        except InputError as error:
            raise InputError(problem, str(error), mend) from None
        is_cell = cell.ndim == 2 and 1 <= cell.shape[0] <= cell.shape[1] <= 3
        if is_cell and sites.shape == (1, 0):  # one ball at the origin
            sites = np.zeros((1, len(cell)))
        are_sites = sites.ndim == 2 and len(sites) > 0 and sites.shape[1] in cell.shape
        if not (is_cell and are_sites):
            raise InputError(problem, mend=mend)
        return cell, sites

    def _require_balance(self) -> None:
        """Raise InputError if equal contact forces leave a ball out of balance: if they add up to
        more than :data:`TOUCH` of the force of a contact along an axis.
        """
        table = self.contacts
        # (n, d) the sum of the forces on each ball, over the force of a contact
        force = np.zeros((self.n_balls, self.dimension))
        np.add.at(force, table.j, table.normal)
        np.add.at(force, table.i, -table.normal)
        # directions are as exact as the sites, of which the same number is the tolerance
        if np.max(np.abs(force)) > TOUCH:
            ball = int(np.argmax(np.abs(force).max(axis=1)))
            raise InputError(
                f"lattice {self.name!r} is not in equilibrium: equal contact forces push ball"
                f" {ball} aside",
                mend="Use a lattice in which the directions of each ball's contacts add up to zero",
            )

    def _require_own_name(self) -> None:
        """Raise InputError if a known lattice of the same name has another cell or other sites, by
        more than the rounding at which balls still touch.
        """
        known_lattice = LATTICES.peek(self.name)
        if known_lattice is None:
            return
        has_same_cell = _are_close(self.vectors, known_lattice.vectors)
        has_same_sites = _are_close(self.positions, known_lattice.positions)
        if has_same_cell and has_same_sites:
            return
        cell = brief(known_lattice.vectors.round(6).tolist())
        balls = counted(known_lattice.n_balls, "ball")
        raise InputError(
            f"the lattice {self.name!r} has a cell or sites of its own",
            f"There is a lattice of that name, with the cell {cell} and {balls}",
            f"Give yours another name, or lattice={self.name!r} to the packing",
        )

    @property
    def n_balls(self) -> int:
        """Number of balls in the cell."""
        return len(self.sites)

    @cached_property
    def periods(self) -> int:
        """Number p of lattice vectors."""
        return len(self.cell)

    @property
    def reach(self) -> float:
        """Length of the longest contact, in units of the spacing of touching balls."""
        return 1.0

    @property
    def pressed_axes(self) -> int:
        """Number of axes along which a pressure acts: the periods."""
        return self.periods

    @property
    def dimension(self) -> int:
        """Dimension d of the space that holds the balls."""
        return len(self.cell[0])

    @cached_property
    def vectors(self) -> Array:
        """(p, d) lattice vectors as rows, in units of the spacing."""
        return read_only(self.cell)

    @cached_property
    def positions(self) -> Array:
        """(n, d) centres of the balls, in units of the spacing."""
        sites = np.asarray(self.sites)
        p = self.periods
        positions = sites[:, :p] @ self.vectors
        if sites.shape[1] > p:
            positions[:, p:] = sites[:, p:]
        return read_only(positions)

    @cached_property
    def measure(self) -> float:
        """Length, area or volume of the cell, in units of the spacing to the power p."""
        return float(abs(np.linalg.det(self.vectors[:, : self.periods])))

    @cached_property
    def contacts(self) -> ContactTable:
        """The contacts of one cell at spacing one, each once."""
        return find_contacts(self.vectors, self.positions, self.name)

    @property
    def coordination(self) -> float:
        """Mean number of contacts of a ball."""
        return 2.0 * len(self.contacts) / self.n_balls

    @cached_property
    def pressure_factor(self) -> float:
        """Reduced pressure P d^(p-1) / f: sqrt(3) for the triangular lattice (equation 20), 2
        sqrt(2) for fcc.

        Raises :class:`InputError` if equal contact forces make a stress that is not an isotropic
        pressure.
        """
        p = self.periods
        normal = self.contacts.normal
        stress = normal[:, :p].T @ normal[:, :p] / self.measure  # (p, p), in f/d^(p - 1)
        pressure = float(np.trace(stress)) / p
        # but for rounding: sites, and so directions, are exact to no more than TOUCH
        if np.max(np.abs(stress - pressure * np.eye(p))) > 0.5 * TOUCH:
            unit = "f/d" if p == 2 else "f/d^2"
            raise InputError(
                f"the stress of lattice {self.name!r} is not a pressure",
                f"Equal contact forces stress it by {np.round(stress, 6).tolist()} {unit}",
                "Load it by force or overlap",
            )
        return pressure

    def pressure_per_force(self, spacing: Any) -> Any:
        """Return the pressure over the contact force at a ``spacing``, m: 1/m in the plane, 1/m^2
        in space, a pure number on a line.

        Raises :class:`InputError` where :attr:`pressure_factor` does.
        """
        return self.pressure_factor / spacing ** (self.periods - 1)

    def _repr_html_(self) -> str:
        """Return the table that a notebook shows."""
        vectors = [
            (f"lattice vector {number}", vector, "spacing")
            for number, vector in enumerate(self.cell, 1)
        ]
        rows = [  # names, numbers and units
            ("name", self.name, ""),
            ("dimension", self.dimension, ""),
            ("periods", self.periods, ""),
            *vectors,
            ("balls in the cell", self.n_balls, ""),
            ("contacts of a ball", self.coordination, ""),
        ]
        return write_html("Lattice", rows)

    def units_of(self, names: Iterable[str]) -> dict[str, str]:
        """Return the SI unit of each of the ``names`` of quantities of an array of balls:
        "pressure", "effective_density", "modulus". Raises KeyError for another name.
        """
        return {name: _UNITS[name][self.periods - 1] for name in names}

    @property
    def measure_per_ball(self) -> float:
        """Length, area or volume of the cell per ball, in units of the spacing to the power p."""
        return self.measure / self.n_balls


_HALF_SQRT3 = float(np.sqrt(3.0) / 2.0)
#: balls in a row along x
CHAIN = Lattice("chain", ((1.0,),))
#: ASE's HEX2D cell, 120 degrees: K = (1/3, 1/3, 0), M = (1/2, 0, 0)
TRIANGULAR = Lattice("triangular", ((1.0, 0.0), (-0.5, _HALF_SQRT3)))
SQUARE = Lattice("square", ((1.0, 0.0), (0.0, 1.0)))
#: two balls; the origin is the centre of a hexagon
HONEYCOMB = Lattice(
    "honeycomb",
    ((2.0 * _HALF_SQRT3, 0.0), (-_HALF_SQRT3, 1.5)),
    ((1.0 / 3.0, 2.0 / 3.0), (2.0 / 3.0, 1.0 / 3.0)),
)
KAGOME = Lattice(
    "kagome", ((2.0, 0.0), (-1.0, 2.0 * _HALF_SQRT3)), ((0.5, 0.0), (0.0, 0.5), (0.5, 0.5))
)


def _make_cubic(
    name: str, edge: float, steps: ArrayLike, sites: tuple[tuple[float, ...], ...] = ((),)
) -> Lattice:
    """Make a lattice with cubic symmetry. The rows of ``steps`` (3, 3) are its primitive vectors,
    in halves of the edge of the cube; ``edge`` is the length of this edge, in spacings.
    """
    return Lattice(name, tuple(map(tuple, (0.5 * edge * np.asarray(steps)).tolist())), sites)


# primitive cells with ASE's vectors
_FACES = ((0, 1, 1), (1, 0, 1), (1, 1, 0))
SC = _make_cubic("sc", 1.0, ((2, 0, 0), (0, 2, 0), (0, 0, 2)))
BCC = _make_cubic("bcc", 2.0 / math.sqrt(3.0), ((-1, 1, 1), (1, -1, 1), (1, 1, -1)))
FCC = _make_cubic("fcc", math.sqrt(2.0), _FACES)
#: close-packed layers across z, the ideal c = sqrt(8/3)
HCP = Lattice(
    "hcp", ((1.0, 0.0, 0.0), (-0.5, _HALF_SQRT3, 0.0), (0.0, 0.0, math.sqrt(8.0 / 3.0))),
    ((1.0 / 3.0, 2.0 / 3.0, 0.25), (2.0 / 3.0, 1.0 / 3.0, 0.75)),
)  # fmt: skip
DIAMOND = _make_cubic(
    "diamond", 4.0 / math.sqrt(3.0), _FACES, ((0.0, 0.0, 0.0), (0.25, 0.25, 0.25))
)
for _lattice in (CHAIN, TRIANGULAR, SQUARE, HONEYCOMB, KAGOME, SC, BCC, FCC, HCP, DIAMOND):
    LATTICES.own(_lattice.name, _lattice)
#: edge of a cube with balls at its corners and its centre, in spacings
_CUBE_EDGE = 2.0 / math.sqrt(3.0)
#: sites of two balls, one in the middle between others of the other kind
_SITES_OF_PAIR = ((0.0, 0.0, 0.0), (0.5, 0.5, 0.5))
#: structures of two kinds of balls by name, beside the lattices that have a name
STRUCTURES = {
    "NaCl": Lattice("NaCl", _FACES, _SITES_OF_PAIR),
    "CsCl": Lattice(
        "CsCl",
        ((_CUBE_EDGE, 0.0, 0.0), (0.0, _CUBE_EDGE, 0.0), (0.0, 0.0, _CUBE_EDGE)),
        _SITES_OF_PAIR,
    ),
    "zincblende": Lattice("zincblende", DIAMOND.cell, DIAMOND.sites),
}


def _are_close(coordinates: Array, known_coordinates: Array) -> bool:
    """Return whether ``coordinates`` (n, d) are the ``known_coordinates`` (m, d), both in spacings,
    to the rounding at which balls still touch; they are not if n differs from m.
    """
    has_same_shape = coordinates.shape == known_coordinates.shape
    return has_same_shape and np.allclose(coordinates, known_coordinates, rtol=0.0, atol=TOUCH)


def register_lattice(lattice: Lattice) -> Lattice:
    """Make a lattice known by its name: to :class:`~granphon.Packing`, ``Crystal.on``, sweeps and
    scenes.

    Returns the ``lattice``; its lengths are in spacings of touching balls. A crystal of n kinds of
    balls takes a lattice whose cell has a multiple of n sites. Raises :class:`InputError` for an
    argument that is no :class:`Lattice`, and for a name that is taken.
    """
    if not isinstance(lattice, Lattice):
        raise InputError(f"{brief(lattice)} is no lattice", mend="Give a granphon.Lattice")
    if name_structure(lattice.name) is not None:
        raise InputError(
            f"the lattice {lattice.name!r} exists already, of granphon", mend="Give another name"
        )
    return LATTICES.add(lattice.name, lattice, lattice)


def find_lattice(lattice: str | Lattice, names: Iterable[str] = LATTICES) -> Lattice:
    """Return the lattice of a name, or a given :class:`Lattice` itself.

    Raises :class:`InputError` for an unknown name; the message lists the ``names``, by default
    those of all lattices.
    """
    if isinstance(lattice, Lattice):
        return lattice
    if is_one_of(lattice, LATTICES):
        return LATTICES[lattice]
    mend = "Use " + ", ".join(names) + ", or a granphon.Lattice"
    raise InputError(f"unknown lattice {brief(lattice)}", LATTICES.describe_failures(), mend)


def name_structure(name: Any) -> str | None:
    """Return which of NaCl, CsCl and zincblende a name is, in any case of letters; None for
    anything else.
    """
    if not isinstance(name, str):
        return None
    names = {structure.lower(): structure for structure in STRUCTURES}
    return names.get(name.lower())


def find_structure(name: str | Lattice) -> Lattice:
    """Return the lattice of a name, NaCl, CsCl and zincblende included, or a given
    :class:`Lattice` itself; :class:`InputError` for an unknown name.
    """
    structure_name = name_structure(name)
    if structure_name is None:
        return find_lattice(name, [*LATTICES, *STRUCTURES])
    return STRUCTURES[structure_name]


def as_direction(direction: ArrayLike, dimension: int = 2) -> Array:
    """Return ``direction`` as a Cartesian unit vector (d,), or as (n, d) unit vectors for (n, d)
    directions, one or more; d is the ``dimension``.

    Raises :class:`InputError` for another shape, a number that is not finite, or a direction of
    length zero.
    """
    vector = real_array("direction", direction)
    largest_component = np.zeros(1)
    if vector.ndim in (1, 2) and vector.size:
        largest_component = np.max(np.abs(vector), axis=-1, keepdims=True)
    is_direction = bool(np.all(np.isfinite(vector)) and np.all(largest_component > 0.0))
    if vector.shape[-1:] != (dimension,) or not is_direction:
        description, example = _DIRECTIONS[dimension - 1]
        raise InputError(
            f"direction is {brief(direction)}",
            f"A direction is {description}",
            f"Give {example}, or an array (n, {dimension}) of directions",
        )
    # squares of the numbers as they are may leave the floating range
    scaled_vector = vector / largest_component
    return np.asarray(scaled_vector / np.linalg.norm(scaled_vector, axis=-1, keepdims=True))


def one_direction(direction: ArrayLike, dimension: int = 2) -> Array:
    """Return ``direction`` as one Cartesian unit vector (d,).

    Raises :class:`InputError` for what :func:`as_direction` refuses, and for more than one
    direction.
    """
    unit_vector = as_direction(direction, dimension)
    if unit_vector.ndim > 1:
        _, example = _DIRECTIONS[dimension - 1]
        raise InputError(
            f"direction is {brief(direction)}",
            "This quantity is found along one direction at a time",
            f"Give {example}",
        )
    return unit_vector
