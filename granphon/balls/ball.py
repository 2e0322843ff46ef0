"""The ball: its material, size, mass and inertia; and the elastic constants of two bodies that
touch.

A flat wall that does not yield is a body like a ball, of no curvature and no compliance
(:data:`RIGID_PLANE`).
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple, Protocol

from granphon.balls.diameters import Discrete, Measured, Normal, Uniform, given_spread
from granphon.balls.material import LEAST_DENSITY, LEAST_YOUNG_MODULUS, Material
from granphon.base.errors import InputError, brief
from granphon.base.validation import is_one_of, label, positive, require

#: reason given when a property of a ball is outside its limit
WRONG_UNIT = "the unit is probably wrong, SI units are expected"
#: conditions on balls, by name: the attribute of a ball or packing, what it is, its unit, the limit
#: (SI), whether that is a least value
BALL_LIMITS = {
    "young_modulus": ("material.young_modulus", "Young modulus", "Pa", LEAST_YOUNG_MODULUS, True),
    "density": ("material.density", "density", "kg/m^3", LEAST_DENSITY, True),
    "high_density": ("material.density", "density", "kg/m^3", 3e4, False),
    "diameter": ("diameter", "diameter", "m", 1e-8, True),
    "large_diameter": ("diameter", "diameter", "m", 1.0, False),
}


class Body(Protocol):
    """What a contact law knows of each of the two bodies that touch.

    ``name`` is what messages call it, and pairs of kinds are named with.
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


@dataclass(frozen=True)
class Ball:
    """A ball of a crystal.

    Parameters
    ----------
    material : the material, which says how contacts yield; and what the ball weighs, if no mass is
        given.
    diameter : m.
    mass : kg; by default the mass of a solid ball of the material. It is a number afterwards.
    inertia : moment of inertia about a diameter, kg m^2; by default (2/5) m R^2, as of a solid ball
        of this mass.
    name : what messages call the kind, and contact laws of a pair of kinds are named by. A crystal
        calls kinds without a name A, B, C, ... in the order in which they come.
    spread : how the diameters of balls of the kind differ, as for :class:`~granphon.Packing`, about
        the mean ``diameter``; None for equal ones. A crystal draws them in
        :meth:`~granphon.Crystal.sample`.

    Raises
    ------
    InputError : a diameter, mass or inertia that is not a finite number above zero; an inertia
        above 2/3 m R^2, the value of a thin shell; something else than a
        :class:`~granphon.Material`; a name that cannot be read; a spread with another mean than the
        diameter or with a ball of size zero or below.
    """

    material: Material
    diameter: float
    mass: float = None  # type: ignore[assignment]  # a number from the constructor on
    inertia: float = None  # type: ignore[assignment]
    name: str = ""
    spread: Uniform | Normal | Discrete | Measured | None = None

    def __post_init__(self) -> None:
        if not isinstance(self.material, Material):
            raise InputError(
                f"the material of a ball is {self.material!r}", mend="Give a granphon.Material"
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

    @property
    def compliance(self) -> float:
        """(1 - sigma^2)/E of the material, 1/Pa."""
        return 0.5 / self.material.contact_modulus

    @property
    def shear_compliance(self) -> float:
        """(2 - sigma)/G of the material, 1/Pa."""
        return (2.0 - self.material.poisson_ratio) / self.material.shear_modulus

    @property
    def twist_compliance(self) -> float:
        """1/G of the material, 1/Pa."""
        return 1.0 / self.material.shear_modulus


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
        """Return the constants of a pair; :class:`InputError` if one of both is no body, both are
        rigid, or both are flat.
        """
        attributes = ("curvature", "compliance", "shear_compliance", "twist_compliance")
        for body in (ball, other):
            if not all(hasattr(body, name) for name in attributes):
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
