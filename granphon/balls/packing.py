"""The packing: the balls, their material, their lattice, whether there is friction; and its
parameters by name.
"""

from __future__ import annotations

import itertools
import math
from collections import Counter
from collections.abc import Callable, Hashable, Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import Any, ClassVar, TypeVar

import numpy as np
from numpy.typing import ArrayLike, NDArray

from granphon.balls.diameters import Discrete, Measured, Normal, Spread, Uniform, given_spread
from granphon.balls.hertz import HertzLaw, contact_radius_ratio, read_broadcast
from granphon.balls.lattices import Lattice, find_lattice
from granphon.balls.material import LEAST_YOUNG_MODULUS, Material
from granphon.balls.motions import Motions, allowed_motions, find_motions, select_motions
from granphon.balls.on_site import ON_SITE, SPRING_PARAMETERS
from granphon.base.errors import InputError, brief
from granphon.base.quantities import LENGTH, MASS, RATE, SINCE, VISCOSITY, WIDTH, Quantity
from granphon.base.results import write_html
from granphon.base.scales import WidthUnits, write_in
from granphon.base.settings import NEEDED, describe_settings, list_settings
from granphon.base.text import closest, counted
from granphon.base.validation import (
    is_one_of,
    not_negative,
    positive,
    real_list,
    require,
    truth,
)

#: the word for the torsional stiffness of a Hertz contact that does not slip
MINDLIN = "mindlin"
#: greatest torsion and bending, over k d^2: bands lose the digits of all other motions beside
#: stiffer ones
MOST_ROLLING = 1e6
#: digits of the values of parameters in words
_DIGITS = 6
#: no units of such values besides SI units with decimal prefixes
_NO_UNITS: Mapping[str, str] = {}
#: the scales of a packing, SI, must lie between this and its inverse: what is computed from them
#: stays in the floating range
_LEAST_SCALE = 1e-280


@dataclass(frozen=True)
class Packing:
    """Balls of one material on the sites of a lattice.

    Parameters
    ----------
    material : the material of the balls.
    diameter : d, the mean diameter, m.
    spread : the distribution of diameters: :class:`~granphon.balls.diameters.Uniform`,
        :class:`~granphon.balls.diameters.Normal`, :class:`~granphon.balls.diameters.Discrete` or
        :class:`~granphon.balls.diameters.Measured`; None for equal balls, which is the limit of
        width zero.
    lattice : "chain", "triangular", "square", "honeycomb", "kagome", "sc", "bcc", "fcc", "hcp",
        "diamond", the name of a lattice that was registered, or a
        :class:`~granphon.balls.lattices.Lattice`.
    friction : whether contacts resist shear; without friction, torsion and bending the balls do not
        rotate.
    motions : the motions of each ball: "longitudinal" (u_x, on a line), "in_plane" (u_x, u_y,
        phi_z), "out_of_plane" (u_z, phi_x, phi_y) or "all" six. By default "longitudinal" on a
        line, "in_plane" in a plane, "all" in space.
    torsion : stiffness of a contact against twist about its normal, over k d^2; or "mindlin": the
        torsion of a Hertz contact that does not slip, which depends on the load: for equal balls
        (1 - sigma)/3 times overlap over diameter, with the Poisson ratio sigma. It needs motions
        with a rotation about the normal: "out_of_plane" or "all".
    bending : stiffness of a contact against rolling, over k d^2.

    Raises
    ------
    InputError : something else than a :class:`~granphon.Material`, a diameter that is not a finite
        number above zero, an unknown lattice, motions that the lattice does not have, a friction
        that is no truth value, a torsion or bending that is no number, negative or above 1e6,
        either of them where the motions have no rotation that it resists, something else than a
        spread, a spread with another mean than the diameter or with a ball of size zero or below,
        or scales beyond double precision.
    """

    material: Material = field(metadata={"kind": Material})
    diameter: float
    spread: Uniform | Normal | Discrete | Measured | None = field(
        default=None, metadata={"kind": Uniform | Normal | Discrete | Measured | None}
    )
    lattice: str | Lattice = field(default="triangular", metadata={"kind": str | Lattice})
    friction: bool = True
    motions: str | None = None
    torsion: float | str = 0.0
    bending: float = 0.0

    #: names of the kinds of balls: none, as all have one material and one distribution of diameters
    kind_names: ClassVar[tuple[str, ...]] = ()
    #: name of the one medium of such balls; empty where they have several
    medium_name: ClassVar[str] = ""
    #: whether the balls are those of a network in files, whose waves are its own
    is_network: ClassVar[bool] = False
    #: the balls repeat along a period, and no floor or clamp holds them
    repeats: ClassVar[bool] = True
    is_held: ClassVar[bool] = False

    def __post_init__(self) -> None:
        """Check all values, and keep the diameter, the friction, the torsion and the bending as
        plain Python values; a torsion may stay the word "mindlin".
        """
        if not isinstance(self.material, Material):
            raise InputError(f"material is {brief(self.material)}", mend="Give a granphon.Material")
        object.__setattr__(self, "diameter", positive("diameter", self.diameter, "m"))
        _ = self.structure  # a name must be that of a lattice
        if self.spread is not None:
            given_spread(self.spread).check_diameter(self.diameter)
        self._require_double_precision()
        object.__setattr__(self, "friction", require("friction", truth, self.friction))
        # the motions are checked too
        torsion, bending = read_rolling(
            f"the {self.structure.name} lattice",
            self.structure.dimension,
            self.motions,
            self.torsion,
            self.bending,
        )
        object.__setattr__(self, "torsion", torsion)
        object.__setattr__(self, "bending", bending)

    def _require_double_precision(self) -> None:
        """Raise :class:`InputError` if a scale of the packing is beyond double precision: the mass,
        the density, or the energy, the force, the stiffness and its slope, or the square of a
        velocity at the largest overlap.
        """
        with np.errstate(all="ignore"):  # whatever is not finite is refused
            law = self.law
            # the largest overlaps are as large as a ball, or as the width, their unit where balls
            # differ
            largest_overlap = max(self.diameter, self.width)
            mass = self.mass
            force = float(law.force(largest_overlap))
            velocity_squared = math.inf
            if mass:  # a mass below the floating range is zero, and refused
                velocity_squared = force / mass * largest_overlap
            scales = (
                float(law.energy(largest_overlap)),
                force,
                float(law.stiffness(largest_overlap)),
                float(law.stiffness_slope(largest_overlap)),
                mass,
                self.material.density,
                velocity_squared,
            )
        if all(_LEAST_SCALE <= scale <= 1.0 / _LEAST_SCALE for scale in scales):
            return
        material = f"{self.material.young_modulus:g} Pa and {self.material.density:g} kg/m^3"
        raise InputError(
            f"balls of {self.diameter:g} m of {material} are beyond double precision",
            "A scale, such as the mass, the density, a force, a stiffness, an energy or the square"
            f" of a velocity, is not between {_LEAST_SCALE:g} and {1 / _LEAST_SCALE:g} in SI",
            "Compare the units",
        )

    @property
    def named_motions(self) -> Motions:
        """The motions given by name, or by default the motions of the lattice."""
        return find_motions(self.structure.dimension, self.motions)

    @cached_property
    def ball_motions(self) -> Motions:
        """The motions of each ball: :attr:`named_motions`, without rotations if no contact resists
        them.
        """
        torsion = 1.0 if self.torsion else 0.0  # "mindlin" too: any number above zero
        return select_motions(self.mindlin_ratio, torsion, self.bending, self.named_motions)

    @cached_property
    def structure(self) -> Lattice:
        """The lattice as an object, also if it was given by name."""
        return find_lattice(self.lattice)

    @property
    def spread_matters(self) -> bool:
        """Whether contact forces differ because the diameters do. They do not among equal balls,
        nor on a line, where each ball passes its load on to the next.
        """
        return bool(self.width) and self.structure.periods > 1

    @cached_property
    def width(self) -> float:
        """Width W = sqrt(12) Delta_rms of the distribution of diameters, m; 0 for equal balls."""
        return 0.0 if self.spread is None else self.spread.width

    @property
    def width_units(self) -> WidthUnits:
        """Reduced units made with W; for equal balls, where W is zero, with the diameter in its
        place.
        """
        return WidthUnits(self.law.coefficient, self.width or self.diameter)

    @cached_property
    def mindlin_ratio(self) -> float:
        """Ratio eta = kappa / k of the shear to the normal stiffness of a contact (equation 4); 0
        without friction.
        """
        return self.material.mindlin_ratio if self.friction else 0.0

    def find_torsion(self, force: ArrayLike, stiffness: ArrayLike) -> NDArray[np.float64]:
        """Return the stiffness against twist, over k d^2, of contacts with a ``force``, N, and a
        normal ``stiffness`` k, N/m. The result has the shape to which both broadcast.

        With ``torsion="mindlin"`` the stiffness against twist is (8/3) G r^3, that of a Hertz
        contact of radius r that does not slip (R. D. Mindlin, J. Appl. Mech. 16, 259, 1949); r
        follows from the force. For equal balls the result is (1 - sigma)/3 times the overlap over
        the diameter, with the Poisson ratio sigma; it is zero where k is zero, and infinite beyond
        double precision.

        Raises :class:`InputError` for what is no number, for shapes that do not broadcast, and, if
        the torsion depends on the load, for a force that is negative or not finite.
        """
        f, k = read_broadcast(force=force, stiffness=stiffness)
        if self.torsion != MINDLIN:
            return np.full(f.shape, float(self.torsion))
        d = self.diameter
        overlap = self.law.overlap(f)
        radius_over_diameter = contact_radius_ratio(overlap, d) / 2.0
        ratio = np.zeros(f.shape)
        with np.errstate(over="ignore"):
            # (8/3) G r^3 over d^2, N/m
            twist_over_square = (
                8.0 / 3.0 * self.material.shear_modulus * d * radius_over_diameter**3
            )
            np.divide(twist_over_square, k, out=ratio, where=k != 0.0)
        return ratio

    @cached_property
    def mass(self) -> float:
        """Mass of a ball of the mean diameter, M = pi rho d^3 / 6, kg (equation 7)."""
        return self.material.ball_mass(self.diameter)

    @property
    def relative_width(self) -> float:
        """Width of the distribution over the mean diameter, W/d."""
        return self.width / self.diameter

    @cached_property
    def law(self) -> HertzLaw:
        """The contact law of two balls of the mean diameter."""
        return HertzLaw.between(self.material, self.diameter)

    @property
    def pressure_per_force(self) -> float:
        """Pressure over the contact force where the overlap is small: 1/m in the plane, 1/m^2 in
        space, a pure number on a line.

        Raises :class:`InputError` if the stress of the lattice is not a pressure.
        """
        return float(self.structure.pressure_per_force(self.diameter))

    @property
    def effective_density(self) -> float:
        """Density of the array, the one that belongs to its moduli.

        In the plane the density is rho~, the mass over the volume of a layer one diameter thick,
        kg/m^3 (equation 17: pi rho / 3 sqrt(3) on the triangular lattice). In space it is the
        density of the crystal, kg/m^3, and on a line the mass per length, kg/m.
        """
        measure_per_ball = self.structure.measure_per_ball  # in diameters to the power p
        if self.structure.periods == 1:
            return self.mass / (self.diameter * measure_per_ball)
        return self.material.ball_mass(1.0) / measure_per_ball

    def describe(self) -> list[tuple[str, Any, str]]:
        """Return the rows of the table of the packing in a notebook: name, value and SI unit of
        each quantity.
        """
        spread = "none" if self.spread is None else self.spread.kind
        rows: list[tuple[str, Any, str]] = [
            ("lattice", self.structure.name, ""),
            ("diameter", self.diameter, "m"),
            ("spread", spread, ""),
        ]
        if self.spread is not None:
            rows.append(("width of the spread", self.width, "m"))
        rows += [
            *describe_settings(self.material),
            ("mass of a ball", self.mass, "kg"),
            ("friction", self.friction, ""),
            ("shear over normal stiffness", self.mindlin_ratio, ""),
            ("motions", self.named_motions.name.replace("_", " "), ""),
        ]
        if self.torsion:
            rows.append(("torsion", self.torsion, "k d^2"))
        if self.bending:
            rows.append(("bending", self.bending, "k d^2"))
        return rows

    def _repr_html_(self) -> str:
        """Return the table that a notebook shows, in HTML."""
        return write_html("Packing", self.describe())


def read_rolling(
    subject: str, dimension: int, motions: Any, torsion: Any, bending: Any
) -> tuple[float | str, float]:
    """Return the ``torsion`` and the ``bending`` of contacts as floats, over k d^2, after a check
    of both and of the ``motions`` of the balls. A torsion may also be the word "mindlin".

    ``dimension`` is 1, 2 or 3 for balls on a line, in a plane or in space.

    Raises :class:`InputError` for motions that such balls do not have, for a stiffness that is no
    number, negative or too large, and for one that resists none of the motions. The message calls
    the lattice or crystal of the balls ``subject``.
    """
    motions_by_name = allowed_motions(dimension)
    if motions is not None and not is_one_of(motions, motions_by_name):
        extent = ("on a line", "in a plane", "in space")[dimension - 1]
        raise InputError(
            f"{subject} has no motions {brief(motions)}",
            f"It lies {extent}",
            "Use " + ", ".join(motions_by_name),
        )
    if not isinstance(torsion, str):
        torsion = not_negative("torsion", torsion)
    elif torsion != MINDLIN:
        raise InputError(f"torsion is {brief(torsion)}", mend=f"Give a number, or {MINDLIN}")
    bending = not_negative("bending", bending)
    for name, stiffness in (("torsion", torsion), ("bending", bending)):
        if isinstance(stiffness, float) and stiffness > MOST_ROLLING:
            raise InputError(
                f"{name} is {stiffness:g}",
                "It is a stiffness over k d^2; that of a contact is far below 1",
                f"Give a number up to {MOST_ROLLING:g}",
            )
    ball_motions = find_motions(dimension, motions)
    _require_resisted(
        subject, ball_motions, motions_by_name, has_torsion=bool(torsion), has_bending=bool(bending)
    )
    return torsion, bending


def _require_resisted(
    subject: str,
    ball_motions: Motions,
    motions_by_name: Mapping[str, Motions],
    *,
    has_torsion: bool,
    has_bending: bool,
) -> None:
    """Raise :class:`InputError` if a torsion or a bending resists no rotation of ``ball_motions``.

    ``motions_by_name`` are all sets of motions that these balls may have. The message calls the
    lattice or crystal of the balls ``subject``.
    """

    def list_idle(motions: Motions) -> list[str]:
        """Return the names of those of torsion and bending that resist none of the motions."""
        names = []
        if has_torsion and not motions.twist:
            names.append("torsion")
        if has_bending and not motions.rotate:
            names.append("bending")
        return names

    idle_stiffnesses = list_idle(ball_motions)
    if not idle_stiffnesses:
        return
    missing_motions = "rotations"
    why = "have no rotation that could be resisted"
    if ball_motions.rotate:
        missing_motions = "rotations about the normals of contacts"
        why = "turn balls across the normals only: no contact twists"
    suitable_names = [name for name, motions in motions_by_name.items() if not list_idle(motions)]
    pronoun = "it" if len(idle_stiffnesses) == 1 else "both"
    raise InputError(
        f"{' and '.join(idle_stiffnesses)} without {missing_motions}",
        f"The motions {ball_motions.name!r} of {subject} {why}",
        f"Use motions {', '.join(suitable_names)}, or leave {pronoun} out",
    )


def given_packing(packing: Any) -> Packing:
    """Return ``packing``, the argument of a public call; raises :class:`InputError` if it is not a
    Packing.
    """
    if isinstance(packing, Packing):
        return packing
    why = ""
    mend = "Give a granphon.Packing"
    if hasattr(packing, "at_force"):  # a crystal, or a medium
        why = "Averages over diameters are those of Hertz's law and of one kind of ball"
        mend += ", or press this itself: .at_force(...)"
    if hasattr(packing, "deviations") and hasattr(packing, "sample"):  # of a crystal
        mend += "; balls that differ are drawn by crystal.sample(shape, seed)"
    raise InputError(f"packing is {brief(packing)}", why, mend)


def require_shallow(modulus: float, overlap: float, describe_load: Callable[[], str]) -> None:
    """Raise :class:`InputError` if balls overlap by their diameter or more; ``overlap`` is in
    diameters.

    ``describe_load`` returns what the message calls the load, and ``modulus`` is the least Young
    modulus of the balls, Pa.
    """
    if overlap < 1.0:
        return
    why = "Balls cannot overlap by their diameter or more, and the contact law fails long before"
    mend = "Lower the load"
    if modulus < LEAST_YOUNG_MODULUS:
        why += (
            f". The Young modulus is {modulus:g} Pa, probably a wrong unit, such as GPa given"
            f" for Pa"
        )
        mend = "Give the Young modulus in Pa (70 GPa are 70e9), or lower the load"
    problem = f"{describe_load()} presses the balls together by {overlap:.4g} diameters"
    raise InputError(problem, why, mend)


# -- parameters by name, and packings in which some have other values ------------------------------


#: a packing, or what has kinds of balls that can be changed
BallsT = TypeVar("BallsT")
#: what is made of the values of parameters
ChangedT = TypeVar("ChangedT")
#: most packings of a sweep; more are taken for a mistake
MOST_COMBINATIONS = 100_000
#: the numbers that every material has, and their SI units
_MATERIAL = {
    name: declaration.kind.unit or "1"
    for name, declaration in list_settings(Material).items()
    if declaration.default == NEEDED
}
#: the constants of a material on which a contact depends
_ELASTIC_CONSTANTS = ("young_modulus", "poisson_ratio")
#: where a lattice of one, two or three periods extends
_EXTENTS = {1: "along a line", 2: "in a plane", 3: "in space"}
#: the parameters of a packing and their SI units; None for parameters that are not numbers
PARAMETERS: Mapping[str, str | None] = {
    **_MATERIAL,
    "diameter": LENGTH.si_unit,
    "width": WIDTH.si_unit,
    "friction": None,
    "spread": None,
    "lattice": None,
    "motions": None,
    "torsion": "1",
    "bending": "1",
}
#: the parameters of each kind of ball of a crystal and their SI units; a sweep calls them by kind
#: and name, "A.diameter"
KIND_PARAMETERS: Mapping[str, str] = {
    **_MATERIAL,
    "diameter": LENGTH.si_unit,
    "mass": MASS.si_unit,
}
#: the parameters of each wall of a crystal and their SI units; a sweep calls them by the name of
#: the wall, "wall.young_modulus"
WALL_PARAMETERS: Mapping[str, str] = {name: _MATERIAL[name] for name in _ELASTIC_CONSTANTS}
#: the losses of contacts and balls by the names of arguments and settings, each with its quantity;
#: None for pure numbers
LOSS_QUANTITIES: Mapping[str, Quantity | None] = {
    "damping": SINCE,
    "loss_factor": None,
    "drag": RATE,
    "dashpot": VISCOSITY,
    "restitution": None,
}
#: the SI units of these losses; empty for pure numbers
LOSSES: Mapping[str, str] = {
    name: "" if quantity is None else quantity.si_unit for name, quantity in LOSS_QUANTITIES.items()
}
#: the losses for which two numbers may be given. The key names the first, which applies to all
#: motions if it stands alone. The entry names the second, which then applies to tangential motions
#: of contacts or, as a drag, to rotations
SECOND_LOSSES: Mapping[str, str] = {
    "damping": "tangential_damping",
    "loss_factor": "tangential_loss_factor",
    "drag": "rotational_drag",
    "dashpot": "tangential_dashpot",
}
#: the loss of which each parameter of losses is, by name
LOSS_PARAMETERS: Mapping[str, str] = {
    **{name: name for name in LOSSES},
    **{second: name for name, second in SECOND_LOSSES.items()},
}
#: the parameters of a sweep that are not those of a kind of ball or a wall, and their SI units
SWEEP_PARAMETERS: Mapping[str, str | None] = {
    **PARAMETERS,
    **SPRING_PARAMETERS,
    **{name: LOSSES[loss] or "1" for name, loss in LOSS_PARAMETERS.items()},
}


def find_unit(name: str) -> str | None:
    """Return the SI unit of a parameter of a sweep: of packings, of springs to the ground, of
    losses, or of a kind of ball or a wall ("A.diameter"); None if it is not a number. What stands
    before the last point of the name is not checked. Raises KeyError for any other name.
    """
    if name in SWEEP_PARAMETERS:
        return SWEEP_PARAMETERS[name]
    return KIND_PARAMETERS[name.rpartition(".")[2]]


@dataclass(frozen=True)
class Axis:
    """One parameter of a packing and the values that it takes; made by :meth:`of`."""

    name: str
    values: tuple[Any, ...]

    @classmethod
    def of(cls, name: str, argument: Any) -> Axis:
        """Make the axis of the parameter ``name`` from an ``argument``, one value or a list of
        values.

        Raises :class:`InputError` for an unknown name, an empty list, an entry that is no number
        where numbers are needed, a value that stands twice, unknown lattices, and lattices of
        different dimension or of one name. Other wrong values are refused where packings are made
        of them.
        """
        _require_parameter(name)
        entries = argument if isinstance(argument, list | tuple) else (argument,)
        # among numbers a torsion may be the word "mindlin", which a list of numbers would refuse
        has_word = name == "torsion" and any(isinstance(entry, str) for entry in entries)
        if find_unit(name) is None or has_word:
            axis = cls(name, _list_values(argument))
            if not axis.values:
                raise InputError(f"{name} is an empty list", mend="Give at least one value")
        else:
            axis = cls(name, real_list(name, argument))
        double_index = find_double(axis.values)
        if double_index is not None:
            value = axis.values[double_index]
            value_in_words = axis.describe(value if isinstance(value, float) else brief(value))
            raise InputError(
                f"the sweep has {value_in_words} twice",
                "Both would be the same states",
                "Give each value once",
            )
        if name == "lattice":
            axis._require_comparable_lattices()
        return axis

    def _require_comparable_lattices(self) -> None:
        """Raise :class:`InputError` for unknown lattices, and for lattices with different numbers
        of periods or of the same name.
        """
        lattices = [find_lattice(value) for value in self.values]
        examples: dict[int, str] = {}  # the name of the first lattice of each number of periods
        for lattice in lattices:
            examples.setdefault(lattice.periods, lattice.name)
        if len(examples) > 1:
            extents = [f"{name}, {_EXTENTS[periods]}" for periods, name in sorted(examples.items())]
            raise InputError(
                f"lattices of different dimension in one sweep: {', and '.join(extents)}",
                "Their pressures, moduli and directions have different units and sizes",
                "Make a sweep of each dimension",
            )
        double_index = find_double(self.labels)
        if double_index is not None:
            raise InputError(
                f"two lattices of the sweep have the name {self.labels[double_index]!r}",
                "Their states could not be told apart",
                "Give each a name of its own",
            )

    @cached_property
    def unit(self) -> str | None:
        """SI unit of the values; None if a value is no number, as the torsion "mindlin"."""
        has_word = any(isinstance(value, str) for value in self.values)
        return None if has_word else find_unit(self.name)

    @property
    def labels(self) -> tuple[Any, ...]:
        """A plain value for each of ``values``: numbers and booleans as they are, names of lattices
        and of spreads, names of motions with "default" for None, and texts of torsions if one of
        them is a word.
        """
        if self.name == "lattice":
            return tuple(find_lattice(value).name for value in self.values)
        if self.name == "spread":
            return _label_spreads(self.values)
        if self.name == "motions":
            return tuple("default" if value is None else value for value in self.values)
        if self.name == "torsion" and not self.unit:
            return tuple(map(str, self.values))
        return self.values

    @property
    def ends(self) -> Axis:
        """The same axis with only the least and the greatest of its numbers; values that are not
        numbers are all kept.
        """
        if self.unit is None:
            return self
        smallest = min(self.values)
        greatest = max(self.values)
        return Axis(self.name, (smallest,) if smallest == greatest else (smallest, greatest))

    def describe(self, label: Any) -> str:
        """Return a ``label`` (:attr:`labels`) in words, with the name of the parameter and the unit
        of its values, such as "width = 2 um".
        """
        return f"{self.name} = {self.write(label)}"

    def write(self, label: Any, chosen_unit: str = "") -> str:
        """Return a ``label`` with its unit, such as "2 um"; in the ``chosen_unit`` if that is not
        empty. A label that is no number, or has no unit, is returned as a text alone.
        """
        if self.unit in (None, "1") or not isinstance(label, float):
            return str(label)
        return write_in(label, str(self.unit), chosen_unit, _DIGITS)


def _require_parameter(name: str) -> None:
    """Raise :class:`InputError` unless ``name`` is a parameter of packings, of springs to the
    ground, of losses, or, as "A.diameter", of a kind of ball or a wall. Whether there is such a
    kind or wall is not checked.
    """
    if name in SWEEP_PARAMETERS:
        return
    kind, _, _ = name.rpartition(".")
    if kind == ON_SITE:
        owner = "a crystal"
        parameters = list(SPRING_PARAMETERS)
    elif kind:
        owner = "a kind of ball"
        parameters = [f"{kind}.{parameter}" for parameter in KIND_PARAMETERS]
    else:
        owner = "a packing"
        parameters = [*PARAMETERS, *LOSS_PARAMETERS]
    if name in parameters:
        return
    guess = closest(name, parameters)
    raise InputError(
        f"{owner} has no parameter {name!r}",
        "It has " + ", ".join(parameters),
        f"Did you mean {guess}?" if guess else "Use one of these",
    )


def _list_values(argument: Any) -> tuple[Any, ...]:
    """Return the values of an ``argument`` that is one value or several; a text is one value."""
    values = argument.tolist() if isinstance(argument, np.ndarray | np.generic) else argument
    if isinstance(values, Iterable) and not isinstance(values, str):
        return tuple(values)
    return (values,)


def _label_spreads(spreads: Sequence[Any]) -> tuple[str, ...]:
    """Return a name for each spread: its class and width, or "equal balls" for None. The second
    spread of the same name has #2 behind it, the third #3, and so on.
    """
    labels = []
    counts = Counter[str]()
    for spread in spreads:
        name = "equal balls"
        if isinstance(spread, Spread):
            name = f"{type(spread).__name__}, W = {spread.width:.6g} m"
        counts[name] += 1
        labels.append(name if counts[name] == 1 else f"{name} #{counts[name]}")
    return tuple(labels)


def find_double(values: Sequence[Any]) -> int | None:
    """Return the index of the first value that equals an earlier one; None if all differ."""
    if all(isinstance(value, Hashable) for value in values):  # a set needs no pairwise comparison
        earlier_values = set[Any]()
        for index, value in enumerate(values):
            if value in earlier_values:
                return index
            earlier_values.add(value)
        return None
    for index, value in enumerate(values):
        if value in values[:index]:
            return index
    return None


def change_packing(packing: BallsT, values: Mapping[str, Any]) -> BallsT:
    """Return the packing with the ``values`` of some of its :data:`PARAMETERS`, by name, in SI; a
    crystal with those of parameters of its kinds, walls and springs.

    A ``width`` scales the spread (:meth:`Spread.with_width
    <granphon.balls.diameters.Spread.with_width>`); a ``diameter`` leaves the spread as it is.
    Raises :class:`InputError` for an unknown name, and if such a packing is not possible.
    """
    if not isinstance(packing, Packing):
        return packing.change(values)  # type: ignore[attr-defined, no-any-return]
    unknown_name = next((name for name in values if name not in PARAMETERS), None)
    if unknown_name is not None:
        mend = "Use one of these"
        if unknown_name in SPRING_PARAMETERS:
            mend = "Springs to the ground are those of a gp.Crystal(..., on_site=...)"
        raise InputError(
            f"a packing has no parameter {unknown_name!r}",
            "It has " + ", ".join(PARAMETERS),
            mend,
        )
    material_values = {name: value for name, value in values.items() if name in _MATERIAL}
    packing_values = {name: value for name, value in values.items() if name not in _MATERIAL}
    if "width" in packing_values:
        width = packing_values.pop("width")
        spread = packing_values.get("spread", packing.spread) or Uniform(0.0)
        packing_values["spread"] = given_spread(spread).with_width(width)
    material = replace(packing.material, **material_values)
    return replace(packing, material=material, **packing_values)


def count_combinations(axes: Sequence[Axis]) -> int:
    """Return the number of combinations of the values of all ``axes``; raise :class:`InputError`
    if there are too many for a sweep.
    """
    count = math.prod(len(axis.values) for axis in axes)
    if count > MOST_COMBINATIONS:
        sides = [f"{counted(len(axis.values), 'value')} of {axis.name}" for axis in axes]
        raise InputError(
            f"{' x '.join(sides)} make {count} packings",
            f"A sweep has no more than {MOST_COMBINATIONS}",
            "Give fewer values",
        )
    return count


def describe_combination(values: Sequence[tuple[str, str]]) -> str:
    """Return the values of parameters in words, from pairs of a name and a text."""
    return ", ".join(f"{name} = {text}" for name, text in values)


def combine(
    change: Callable[[Mapping[str, Any]], ChangedT],
    axes: Sequence[Axis],
    units: Mapping[str, str] = _NO_UNITS,
) -> list[tuple[tuple[tuple[str, str], ...], ChangedT]]:
    """Return one pair for each combination of the values of all ``axes``, of which the last runs
    fastest. The first entry of a pair is the combination in words: the name of each parameter with
    the text of its value. The second is the object that ``change`` returns for the values by name.

    ``units`` are the units of the texts, by the name of the parameter; by default they are SI units
    with decimal prefixes. Raises :class:`InputError` if there are too many combinations, and, with
    the combination in its message, if ``change`` raises it.
    """
    count_combinations(axes)
    names = [axis.name for axis in axes]
    all_values = itertools.product(*(axis.values for axis in axes))
    all_labels = itertools.product(*(axis.labels for axis in axes))
    combinations = []
    for values, labels in zip(all_values, all_labels, strict=True):
        words = [
            axis.write(label, units.get(axis.name, ""))
            for axis, label in zip(axes, labels, strict=True)
        ]
        combination = tuple(zip(names, words, strict=True))
        try:
            changed_object = change(dict(zip(names, values, strict=True)))
        except InputError as error:
            raise InputError(f"{describe_combination(combination)}: {error}") from error
        combinations.append((combination, changed_object))
    return combinations
