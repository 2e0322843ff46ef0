"""The parameters of a packing by name: their units, and packings in which some of them have other values."""

from __future__ import annotations

import itertools
import math
from collections import Counter
from collections.abc import Hashable, Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any, TypeVar

import numpy as np

from granphon.balls.diameters import Discrete, Measured, Normal, Spread, Uniform
from granphon.balls.lattices import LATTICES, Lattice, find_lattice
from granphon.balls.packing import Packing
from granphon.base.errors import InputError, brief
from granphon.base.text import closest, counted
from granphon.base.validation import is_one_of, real_list

#: a packing, or what has kinds of balls that can be changed
BallsT = TypeVar("BallsT")
#: most packings of a sweep; more are taken for a mistake
MOST_COMBINATIONS = 100_000
_MATERIAL = {"young_modulus": "Pa", "poisson_ratio": "1", "density": "kg/m^3"}
#: where a lattice of one, two or three periods extends
_EXTENTS = {1: "along a line", 2: "in a plane", 3: "in space"}
#: the parameters of a packing and their SI units; None for parameters that are not numbers
PARAMETERS: Mapping[str, str | None] = {
    **_MATERIAL, "diameter": "m", "width": "m", "friction": None, "spread": None, "lattice": None, "motions": None,
    "torsion": "1", "bending": "1",
}  # fmt: skip
#: the parameters of each kind of ball of a crystal and their SI units; a sweep calls them by kind and name, "A.diameter"
KIND_PARAMETERS: Mapping[str, str] = {**_MATERIAL, "diameter": "m", "mass": "kg"}


def find_unit(name: str) -> str | None:
    """Return the SI unit of a parameter of packings, or of a kind of ball ("A.diameter"); None if it is not a number."""
    kind, _, own = name.rpartition(".")
    return KIND_PARAMETERS[own] if kind else PARAMETERS[name]


@dataclass(frozen=True)
class Axis:
    """One parameter of a packing and the values that it takes; made by :meth:`of`."""

    name: str
    values: tuple[Any, ...]

    @classmethod
    def of(cls, name: str, given: Any) -> Axis:
        """Make an axis from one value or a list of them; :class:`InputError` for an unknown name or a wrong value."""
        kind, _, own = name.rpartition(".")
        if own not in (KIND_PARAMETERS if kind else PARAMETERS):
            known = [f"{kind}.{one}" for one in KIND_PARAMETERS] if kind else list(PARAMETERS)
            guess = closest(name, known)
            raise InputError(
                f"{'a kind of ball' if kind else 'a packing'} has no parameter {name!r}",
                "It has " + ", ".join(known),
                f"Did you mean {guess}?" if guess else "Use one of these",
            )
        listed = given if isinstance(given, list | tuple) else (given,)
        if find_unit(name) is None or (name == "torsion" and any(isinstance(one, str) for one in listed)):
            plain = given.tolist() if isinstance(given, np.ndarray | np.generic) else given
            axis = cls(name, tuple(plain) if isinstance(plain, Iterable) and not isinstance(plain, str) else (plain,))
            if not axis.values:
                raise InputError(f"{name} is an empty list", mend="Give at least one value")
        else:
            axis = cls(name, real_list(name, given))
        if (double := find_double(axis.values)) is not None:
            what = f"the sweep has {axis.describe(brief(axis.values[double]))} twice"
            raise InputError(what, "Both would be the same states", "Give each value once")
        if name == "lattice":
            # unknown names of lattices are refused later
            given = [one for one in axis.values if isinstance(one, Lattice) or is_one_of(one, LATTICES)]
            first = {one.periods: one.name for one in map(find_lattice, reversed(given))}
            if len(first) > 1:
                found = " and ".join(f"{name}, {_EXTENTS[periods]}," for periods, name in sorted(first.items()))
                raise InputError(
                    f"lattices of different dimension in one sweep: {found.removesuffix(',')}",
                    "Their pressures, moduli and directions have different units and sizes",
                    "Make a sweep of each dimension",
                )
            if (double := find_double(axis.labels)) is not None:
                raise InputError(
                    f"two lattices of the sweep have the name {axis.labels[double]!r}",
                    "Their states could not be told apart",
                    "Give each a name of its own",
                )
        return axis

    @cached_property
    def unit(self) -> str | None:
        """SI unit of the values; None where they are not numbers: "mindlin" may be among those of torsion."""
        return None if any(isinstance(value, str) for value in self.values) else find_unit(self.name)

    @property
    def labels(self) -> tuple[Any, ...]:
        """A plain value for each of ``values``: numbers and booleans as they are, names of lattices and of spreads."""
        if self.name == "lattice":
            return tuple(find_lattice(value).name for value in self.values)
        if self.name == "spread":
            names, seen = [], Counter[str]()
            for spread in self.values:
                known = isinstance(spread, Spread)
                name = f"{type(spread).__name__}, W = {spread.width:.6g} m" if known else "equal balls"
                names.append(f"{name} #{seen[name] + 1}" if seen[name] else name)
                seen[name] += 1
            return tuple(names)
        if self.name == "motions":
            return tuple("default" if value is None else value for value in self.values)
        return self.values if self.name != "torsion" or self.unit else tuple(map(str, self.values))

    @property
    def ends(self) -> Axis:
        """The same axis with only the least and the greatest of its numbers; values that are not numbers are all kept."""
        if self.unit is None:
            return self
        return Axis(self.name, tuple(dict.fromkeys((min(self.values), max(self.values)))))

    def describe(self, label: Any) -> str:
        """A label with the name of the parameter and its unit, such as "width = 2e-06 m"."""
        return f"{self.name} = {label}" + (f" {self.unit}" if self.unit not in (None, "1") else "")


def find_double(values: Sequence[Any]) -> int | None:
    """Return the index of the first value that stands before already; None if there is none."""
    seen: list[Any] | set[Any] = set() if all(isinstance(one, Hashable) for one in values) else []
    for index, value in enumerate(values):
        if value in seen:
            return index
        seen.add(value) if isinstance(seen, set) else seen.append(value)
    return None


def change_width(spread: Spread | None, width: float) -> Uniform | Normal | Discrete | Measured:
    """The distribution of the same shape and mean whose width is W = ``width``, m; uniform if ``spread`` is None.

    Raises :class:`InputError` if the width is negative or not finite, if listed diameters are all the same, or if the
    distribution is not one of granphon's own.
    """
    uniform = Uniform(width)  # says what is wrong with the width
    if isinstance(spread, Normal):
        return Normal(uniform.width / Normal(1.0, spread.cutoff).width, spread.cutoff)
    if isinstance(spread, Discrete | Measured):
        if not spread.width:
            raise InputError("diameters that are all the same cannot be spread", mend="Give another spread")
        mean, scale = spread.mean, uniform.width / spread.width
        scaled = replace(spread, diameters=tuple(mean + (diameter - mean) * scale for diameter in spread.diameters))
        if uniform.width:
            # the old shape is kept: a shape that differs by rounding would have its law solved again
            scaled.__dict__["shape"] = spread.shape
        return scaled
    if spread is None or isinstance(spread, Uniform):
        return uniform
    what = f"a {type(spread).__name__} cannot be given another width"
    raise InputError(what, "The parameters of this class are not known", "Give the spreads themselves")


def change_packing(packing: BallsT, values: Mapping[str, Any]) -> BallsT:
    """The packing with other values of some of its :data:`PARAMETERS`, or of those of kinds of balls if it has these.

    A ``width`` scales the spread (:func:`change_width`); a ``diameter`` leaves the spread as it is. Raises
    :class:`InputError` if such a packing is not possible.
    """
    if not isinstance(packing, Packing):
        return packing.change(values)  # type: ignore[attr-defined, no-any-return]
    rest = dict(values)
    if unknown := [name for name in rest if name not in PARAMETERS]:
        raise InputError(f"a packing has no parameter {unknown[0]!r}", "It has " + ", ".join(PARAMETERS), "Use one")
    material = {name: rest.pop(name) for name in _MATERIAL if name in rest}
    if "width" in rest:
        rest["spread"] = change_width(rest.get("spread", packing.spread), rest.pop("width"))
    return replace(packing, material=replace(packing.material, **material), **rest)


def count_combinations(axes: Sequence[Axis]) -> int:
    """Count the combinations of values; raise :class:`InputError` if there are too many for a sweep."""
    count = math.prod(len(axis.values) for axis in axes)
    if count > MOST_COMBINATIONS:
        sides = " x ".join(f"{counted(len(axis.values), 'value')} of {axis.name}" for axis in axes)
        what = f"{sides} make {count} packings"
        raise InputError(what, f"A sweep has no more than {MOST_COMBINATIONS}", "Give fewer values")
    return count


def combine(packing: BallsT, axes: Sequence[Axis]) -> list[tuple[str, BallsT]]:
    """Make a packing for each combination of values; return pairs of the combination in words and its packing.

    The last axis runs fastest. :class:`InputError` names a combination that makes no packing, or says that there are too
    many.
    """
    count_combinations(axes)
    out = []
    for pairs in itertools.product(*(zip(axis.values, axis.labels, strict=True) for axis in axes)):
        where = ", ".join(axis.describe(label) for axis, (_, label) in zip(axes, pairs, strict=True))
        try:
            one = change_packing(packing, {axis.name: value for axis, (value, _) in zip(axes, pairs, strict=True)})
        except InputError as error:
            raise InputError(f"{where}: {error}") from error
        out.append((where, one))
    return out
