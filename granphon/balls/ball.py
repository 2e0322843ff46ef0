"""The ball: its material, size, mass and inertia; and the elastic constants of two bodies that
touch.

A flat wall is a body like a ball, of no curvature (:class:`Wall`), and of no compliance either if
it does not yield (:data:`RIGID_PLANE`).
"""

from __future__ import annotations

import itertools
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any, ClassVar, NamedTuple, Protocol

from granphon.balls.diameters import Discrete, Measured, Normal, Uniform, given_spread
from granphon.balls.material import LEAST_DENSITY, LEAST_YOUNG_MODULUS, Material
from granphon.base.errors import InputError, brief
from granphon.base.scales import write_quantity
from granphon.base.validation import is_one_of, label, positive, require

#: name of a wall that has none
_WALL_NAME = "wall"
#: reason given when a property of a ball is outside its limit
WRONG_UNIT = "the unit is probably wrong, SI units are expected"
#: conditions on balls, by name: the attribute of a ball or packing, the quantity in words, its SI
#: unit, its limit in this unit, and whether the limit is a least value (or else a greatest)
BALL_LIMITS = {
    "young_modulus": ("material.young_modulus", "Young modulus", "Pa", LEAST_YOUNG_MODULUS, True),
    "density": ("material.density", "density", "kg/m^3", LEAST_DENSITY, True),
    "high_density": ("material.density", "density", "kg/m^3", 3e4, False),
    "diameter": ("diameter", "diameter", "m", 1e-8, True),
    "large_diameter": ("diameter", "diameter", "m", 1.0, False),
}


class Body(Protocol):
    """What a contact law knows of each of the two bodies that touch.

    Messages call the body by its ``name``, and so do the pairs of kinds that have a law.
    """

    @property
    def name(self) -> str:
        """The name of the kind; empty if it has none."""
        ...

    @property
    def curvature(self) -> float:
        """One over the radius, 1/m; 0 of a plane."""
        ...

    @property
    def compliance(self) -> float:
        """(1 - sigma^2)/E, 1/Pa; 0 of a rigid body."""
        ...

    @property
    def shear_compliance(self) -> float:
        """(2 - sigma)/G, 1/Pa; 0 of a rigid body."""
        ...

    @property
    def twist_compliance(self) -> float:
        """1/G, 1/Pa; 0 of a rigid body."""
        ...


class _ElasticBody:
    """The compliances at a contact of a body of an elastic ``material``. As :attr:`solid` does,
    they raise InputError for a wall that has the name of a kind of balls in place of a material.
    """

    material: Material | str

    @property
    def solid(self) -> Material:
        """The material; InputError for a wall that has the name of a kind of balls in its place."""
        if isinstance(self.material, str):
            problem = f"the material of a wall is that of the kind {self.material!r}"
            raise InputError(problem, "A crystal or network that is cut knows it", "Cut it first")
        return self.material

    @property
    def compliance(self) -> float:
        """(1 - sigma^2)/E of the material, 1/Pa."""
        return 0.5 / self.solid.contact_modulus

    @property
    def shear_compliance(self) -> float:
        """(2 - sigma)/G of the material, 1/Pa."""
        return (2.0 - self.solid.poisson_ratio) / self.solid.shear_modulus

    @property
    def twist_compliance(self) -> float:
        """1/G of the material, 1/Pa."""
        return 1.0 / self.solid.shear_modulus


@dataclass(frozen=True)
class Ball(_ElasticBody):
    """A ball of a crystal.

    Parameters
    ----------
    material : the material, whose elastic constants are those of the contacts. Its density gives
        the mass of the ball, unless a mass is given.
    diameter : m.
    mass : kg; by default the mass of a solid ball of the material. It is a number afterwards.
    inertia : moment of inertia about a diameter, kg m^2; by default (2/5) m R^2, as of a solid ball
        of this mass.
    name : the name of the kind, in messages and in the contact laws of pairs of kinds. A crystal
        calls kinds without a name A, B, C, ... in the order in which they come.
    spread : how the diameters of balls of the kind differ, as for :class:`~granphon.Packing`, about
        the mean ``diameter``; None for equal ones. A crystal draws them in
        :meth:`~granphon.Crystal.sample`.

    Raises
    ------
    InputError : a diameter, mass or inertia that is not a finite number above zero; an inertia
        above 2/3 m R^2, the value of a thin shell; something else than a
        :class:`~granphon.Material`; a name that is no printable text, or begins with a sign that
        makes it a formula to a spreadsheet (=, +, -, @); something else than a spread, a spread
        with another mean than the diameter, or one with a ball of size zero or below.
    """

    material: Material = field(metadata={"kind": Material})
    diameter: float
    mass: float = None  # type: ignore[assignment]  # a number from the constructor on
    inertia: float = None  # type: ignore[assignment]
    name: str = ""
    spread: Uniform | Normal | Discrete | Measured | None = field(
        default=None, metadata={"kind": Uniform | Normal | Discrete | Measured | None}
    )

    def __post_init__(self) -> None:
        """Check all values, and put numbers in place of a mass and an inertia not given."""
        if not isinstance(self.material, Material):
            raise InputError(
                f"the material of a ball is {brief(self.material)}", mend="Give a granphon.Material"
            )
        diameter = positive("diameter", self.diameter, "m")
        given_mass: float | None = self.mass
        if given_mass is None:
            given_mass = self.material.ball_mass(diameter)
        mass = positive("mass", given_mass, "kg")
        solid_inertia = 0.1 * mass * diameter * diameter  # (2/5) m R^2
        given_inertia: float | None = self.inertia
        if given_inertia is None:
            given_inertia = solid_inertia
        inertia = positive("inertia", given_inertia, "kg m^2")
        shell_inertia = 5.0 / 3.0 * solid_inertia  # (2/3) m R^2
        if inertia > shell_inertia * (1.0 + 1e-9):  # a shell's own number may be rounded
            why = f"That of a shell of this mass, the largest there is, is {shell_inertia:g} kg m^2"
            raise InputError(f"inertia is {inertia:g} kg m^2", why, "Compare the units")
        if not is_one_of(self.name, ("",)):
            require("the name of a ball", label, self.name)
        if self.spread is not None:
            given_spread(self.spread).check_diameter(diameter)
        for name, value in (("diameter", diameter), ("mass", mass), ("inertia", inertia)):
            object.__setattr__(self, name, value)

    @property
    def radius(self) -> float:
        """Half the diameter, m."""
        return 0.5 * self.diameter

    @property
    def curvature(self) -> float:
        """One over the radius, 1/m."""
        return 2.0 / self.diameter


@dataclass(frozen=True)
class Wall(_ElasticBody):
    """A flat elastic wall, thick and wide against the contacts of balls that touch it.

    A ball touches it by the laws of Hertz and Mindlin, as it touches a ball of infinite radius. A
    wall stands where a crystal or a network is cut, as
    ``crystal.cut(axis, layers, edges=(gp.Wall(steel), "free"))``; the edge "floor" is the limit of
    a wall that does not yield.

    Parameters
    ----------
    material : the material; or the name of the kind of balls of whose material the wall is.
    name : of the wall among the kinds of bodies, by which contact laws of pairs know it; by default
        "wall", or the first of "wall_2", "wall_3", ... that no other kind or wall has.

    Raises
    ------
    InputError : something else than a :class:`~granphon.Material` or a text; a name, of the wall or
        of a kind, that is no printable text, or begins with a sign that makes it a formula to a
        spreadsheet (=, +, -, @). Where a crystal or a network is cut: a material of a kind that
        there is not, and a name that another kind or wall has.
    """

    material: Material | str = field(metadata={"kind": Material | str})
    name: str = ""

    #: one over the radius, 1/m
    curvature: ClassVar[float] = 0.0

    def __post_init__(self) -> None:
        """Check the material and the name."""
        material: Any = self.material  # the caller may have given anything
        if not isinstance(material, Material | str):
            problem = f"the material of a wall is {brief(material)}"
            raise InputError(problem, mend="Give a granphon.Material")
        if isinstance(material, str):
            require("the kind of the material of a wall", label, material)
        if not is_one_of(self.name, ("",)):
            require("the name of a wall", label, self.name)

    def describe(self) -> str:
        """Return what the wall is made of in words: its Young modulus, or the kind of balls whose
        material it has.
        """
        if isinstance(self.material, str):
            return f"wall of the material of {self.material}"
        return f"wall with E = {write_quantity(self.material.young_modulus, 'Pa')}"


@dataclass(frozen=True)
class _RigidPlane:
    """A flat wall that does not yield, such as the floor of a column."""

    name: str = "floor"
    curvature: float = 0.0
    compliance: float = 0.0
    shear_compliance: float = 0.0
    twist_compliance: float = 0.0


#: the floor on which a crystal stands
RIGID_PLANE = _RigidPlane()


def find_wall(edge: Any) -> Body | None:
    """Return the flat body at an ``edge`` of a cut, which is a word or a :class:`Wall`: a wall
    itself, or the rigid plane for the word "floor"; None for any other word.
    """
    if isinstance(edge, Wall):
        return edge
    return RIGID_PLANE if is_one_of(edge, (RIGID_PLANE.name,)) else None


def name_walls(
    edges: Iterable[str | Wall], kinds: Mapping[str, Ball], known_walls: Sequence[Wall]
) -> tuple[str | Wall, ...]:
    """Return the ``edges`` of a cut, in which each wall is replaced by one that has a
    :class:`~granphon.Material` and a name; other edges stay. A wall of the material of a known
    wall, or of the wall at an earlier edge, is that wall, unless it has another name.

    ``kinds`` are the balls by the names of their kinds, and ``known_walls`` the walls of earlier
    cuts. Raises :class:`InputError` for the material of a kind that there is not, and for a name
    that a kind, the floor, or a wall of another material has.
    """
    walls = list(known_walls)
    named_edges: list[str | Wall] = []
    for edge in edges:
        if isinstance(edge, Wall):
            wall = _name_wall(find_material(edge, kinds), kinds, walls)
            walls.append(wall)
            named_edges.append(wall)
        else:
            named_edges.append(edge)
    return tuple(named_edges)


def replace_walls(
    edges: tuple[str | Wall, str | Wall], walls: Mapping[str, Wall]
) -> tuple[str | Wall, str | Wall]:
    """Return the two edges of a cut, in which each wall whose name is a key of ``walls`` is
    replaced by the entry of this key.
    """
    lower, upper = (
        walls.get(edge.name, edge) if isinstance(edge, Wall) else edge for edge in edges
    )
    return lower, upper


def find_material(wall: Wall, kinds: Mapping[str, Ball]) -> Wall:
    """Return a wall with its material in place of the name of a kind of balls; InputError if there
    is no such kind.
    """
    if isinstance(wall.material, Material):
        return wall
    if wall.material not in kinds:
        problem = f"a wall is of the material of {wall.material!r}, and there is no such kind"
        names = ", ".join(kinds)
        mend = (
            f"Give a granphon.Material, or one of {names}" if names else "Give a granphon.Material"
        )
        raise InputError(problem, mend=mend)
    return replace(wall, material=kinds[wall.material].material)


def _name_wall(wall: Wall, kinds: Mapping[str, Ball], walls: Sequence[Wall]) -> Wall:
    """Return a wall that has a name. It is one of the known ``walls``, if that has the same
    material and no other name is given; else it has the given name or, without one, the first free
    name of "wall", "wall_2", "wall_3".

    Raises InputError if a kind of balls, the floor or another wall has the given name.
    """
    used_names = {*kinds, RIGID_PLANE.name, *(other.name for other in walls)}
    for other in walls:
        if other.material == wall.material and wall.name in ("", other.name):
            return other
    if not wall.name:
        names = (
            _WALL_NAME if number == 1 else f"{_WALL_NAME}_{number}" for number in itertools.count(1)
        )
        return replace(wall, name=next(name for name in names if name not in used_names))
    if wall.name in used_names:
        problem = f"a wall is called {wall.name!r}, as another kind or wall"
        raise InputError(problem, mend="Name it differently")
    return wall


class ContactConstants(NamedTuple):
    """The elastic constants of two bodies that touch (K. L. Johnson, Contact Mechanics, 1985,
    chapters 4 and 7).

    Attributes
    ----------
    modulus : E*, Pa: 1/E* is the sum of (1 - sigma^2)/E of both.
    radius : R, m: 1/R is the sum of both curvatures.
    mindlin_ratio : kappa/k = 4 G*/E* of a contact that does not slip: k = 2 E* a and kappa = 8 G* a
        have the contact radius a in common, whatever the law; 1/G* is the sum of (2 - sigma)/G of
        both.
    twist_modulus : the stiffness against twist is this number times a^3, Pa: 16/3 over the sum of
        1/G of both.
    """

    modulus: float
    radius: float
    mindlin_ratio: float
    twist_modulus: float

    @classmethod
    def of(cls, ball: Body, other: Body) -> ContactConstants:
        """Return the constants of the pair ``ball`` and ``other``; :class:`InputError` if one of
        the two is no body, or is a wall that names a kind of balls in place of its material; and if
        both are rigid, or both are flat.
        """
        attributes = ("curvature", "compliance", "shear_compliance", "twist_compliance")
        for body in (ball, other):
            if isinstance(body, type) or not all(hasattr(body, name) for name in attributes):
                raise InputError(
                    f"a body of a contact is {brief(body)}", mend="Give a granphon.Ball"
                )
        curvature = ball.curvature + other.curvature
        compliance = ball.compliance + other.compliance
        if not (curvature > 0.0 and compliance > 0.0):
            raise InputError(
                "two flat or rigid bodies make no elastic contact", mend="One must be a ball"
            )
        mindlin_ratio = 4.0 * compliance / (ball.shear_compliance + other.shear_compliance)
        twist_modulus = 16.0 / 3.0 / (ball.twist_compliance + other.twist_compliance)
        return cls(1.0 / compliance, 1.0 / curvature, mindlin_ratio, twist_modulus)
