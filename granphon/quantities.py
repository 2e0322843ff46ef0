"""Values as they are written in a scene: quantities with their units, choices, grids, paths.

Each rule takes what stood in the file and returns the value, or raises :class:`Refused`, which says what was found, what is
allowed, and the likely intention. Units are read here and on no other occasion; inside, everything is SI floats.
"""

from __future__ import annotations

import itertools
import math
import re
from collections.abc import Sequence
from dataclasses import dataclass
from decimal import Decimal
from fractions import Fraction
from functools import cache, partial
from typing import Any

from granphon.files import closest, shown
from granphon.geometry import LATTICES

__all__ = ["DENSITY", "LENGTH", "LOADS", "MEDIUM_NAMES", "MODULUS", "OBSERVABLES", "Quantity", "Refused"]

SCHEMA = 1
OBSERVABLES = ("velocities", "bands", "dos")
#: for equal balls each of these media is the averaged lattice
MEDIUM_NAMES = ("ala", "afa", "ema")


class Refused(ValueError):
    """A value that a rule does not take: what was found, what is allowed, and the likely intention."""

    def __init__(self, found: str, allowed: str, mend: str = "") -> None:
        super().__init__(f"found {found}; allowed: {allowed}." + (f" {mend}" if mend else ""))


# -- quantities -----------------------------------------------------------------------------------------------------

#: the units that a scene knows; small and exact, so that "8 mm" is the float nearest to 0.008
_UNITS = """
pico- = 1e-12 = p-\nnano- = 1e-9 = n-\nmicro- = 1e-6 = u- = µ- = μ-\nmilli- = 1e-3 = m-\ncenti- = 1e-2 = c-
kilo- = 1e3 = k-\nmega- = 1e6 = M-\ngiga- = 1e9 = G-\ntera- = 1e12 = T-
meter = [length] = m = metre\nsecond = [time] = s\ngram = [mass] = g\nkelvin = [temperature] = K
degree_Celsius = kelvin; offset: 273.15 = degC\nhertz = 1/second = Hz\njoule = newton*meter = J
newton = kilogram*meter/second**2 = N\npascal = newton/meter**2 = Pa\nbar = 1e5*pascal\natm = 101325*pascal
inch = 0.0254*meter\npound = 453.59237*gram = lb\npound_force = 4.4482216152605*newton = lbf\npsi = pound_force/inch**2
kilogram_force = 9.80665*newton = kgf\ndyne = 1e-5*newton = dyn\nangstrom = 1e-10*meter = Å\ntonne = 1e6*gram = t
"""
_NUMBER = r"[-+]?(?:[0-9]+\.?[0-9]*|\.[0-9]+)(?:[eE][-+]?[0-9]+)?"
_QUANTITY = re.compile(rf"({_NUMBER})(\s*)(.*)", re.DOTALL)
_FACTOR = r"[A-Za-zµμÅ_]+(?:(?:\^|\*\*)?-?[1-9]|[²³])?"
_UNIT = re.compile(rf"(?:1/)?{_FACTOR}(?:\s*[*/·]\s*{_FACTOR})*")


@cache
def _registry() -> Any:
    from pint import UnitRegistry

    registry: Any = UnitRegistry(None, non_int_type=Decimal)
    registry.load_definitions(_UNITS.strip().splitlines())
    return registry


@dataclass(frozen=True)
class Quantity:
    """A kind of quantity: its name, its SI unit, an example, and the units to suggest."""

    name: str
    unit: str
    example: str
    common: str

    @property
    def allowed(self) -> str:
        """What may be written for it."""
        return f"a {self.name} above zero with its unit, such as '{self.example}' ({self.common})"

    def read(self, value: Any) -> float:
        """The SI value of a text such as "8 mm", the float nearest to it; raises :class:`Refused`."""
        tip = f"Write the unit too, such as '{self.example}'."
        if isinstance(value, int | float) and not isinstance(value, bool):
            if isinstance(value, float) and not math.isfinite(value):
                raise Refused(f"{shown(value)}, which is not a finite number", self.allowed)
            raise Refused(f"{shown(value)}, without a unit", self.allowed, tip)
        if not isinstance(value, str):
            raise Refused(shown(value), self.allowed)
        text = value.strip()
        if re.match(r"[-+]?\.?(nan|inf|infinity)\b", text, re.IGNORECASE):
            raise Refused(f"{shown(value)}, which is not a finite number", self.allowed)
        match = _QUANTITY.fullmatch(text)
        if match is None or len(text) > 100:
            raise Refused(f"{shown(value)}, which does not start with a number", self.allowed)
        number, _, unit = match.groups()
        if not unit:
            raise Refused(f"{shown(value)}, without a unit", self.allowed, tip)
        factor = self._factor(unit, number, value)
        return self._value(number, factor, value)

    def _factor(self, unit: str, number: str, value: str) -> Fraction:
        common = self.common.split(", ")
        meant = closest(unit, common)
        mend = f"Did you mean '{number} {meant}'?" if meant and meant != unit else ""
        if not _UNIT.fullmatch(unit):
            raise Refused(f"{shown(value)}, which is not one number and one unit", self.allowed, mend)
        registry = _registry()
        text = unit.replace("·", "*").replace("²", "^2").replace("³", "^3").removeprefix("1/")
        text = re.sub(r"(?<=[A-Za-zµμÅ])(-?[1-9])", r"^\1", text)
        try:
            parsed = registry.parse_units("1/" + text if unit.startswith("1/") else text)
        except Exception:  # pint raises AttributeError, TypeError, ValueError and tokenizer errors of its own
            raise Refused(f"{shown(value)}, whose unit is not known", self.allowed, mend) from None
        if parsed.dimensionality != registry.parse_units(self.unit).dimensionality:
            raise Refused(f"{shown(value)}, whose unit is not one of {self.name}", self.allowed, mend)
        return Fraction(registry.Quantity(Decimal(1), parsed).to(self.unit).magnitude)

    def _value(self, number: str, factor: Fraction, value: str) -> float:
        rough = float(number)
        if not math.isfinite(rough):
            raise Refused(f"{shown(value)}, which is not a finite number", self.allowed)
        if not re.search("[1-9]", re.split("[eE]", number)[0]):
            raise Refused(f"{shown(value)}, which is zero", self.allowed)
        if number.startswith("-"):
            raise Refused(f"{shown(value)}, which is {self._below_zero}", self.allowed)
        try:
            exact = float(Fraction(number) * factor) if rough else 0.0
        except OverflowError:
            exact = math.inf
        if not 0.0 < exact < math.inf:
            raise Refused(f"{shown(value)}, which is too small or too large for double precision", self.allowed)
        return exact

    @property
    def _below_zero(self) -> str:
        return "negative"


@dataclass(frozen=True)
class _LoadQuantity(Quantity):
    """A load: one only, and compressive."""

    def read(self, value: Any) -> float:
        if isinstance(value, list | dict):
            raise Refused(f"{shown(value)}, where one load is needed", self.allowed, ONE_LOAD)
        return super().read(value)

    @property
    def _below_zero(self) -> str:
        return "tensile (one-sided contacts carry no tension)"


ONE_LOAD = "This version knows one load to a scene."
LENGTH = Quantity("length", "m", "8 mm", "m, cm, mm, um, nm, inch")
MODULUS = Quantity("pressure", "Pa", "211.65 GPa", "Pa, kPa, MPa, GPa, bar, psi")
DENSITY = Quantity("density", "kg/m^3", "7840 kg/m^3", "kg/m^3, g/cm^3")
LOADS: dict[str, Quantity] = {
    "force": _LoadQuantity("force", "N", "18.446 N", "uN, mN, N, kN, kgf, lbf"),
    "pressure": _LoadQuantity("force per length", "N/m", "4 kN/m", "N/m, kN/m, N/mm, Pa*m"),
    "overlap": _LoadQuantity("length", "m", "2 um", "m, mm, um, nm"),
    "side_force": _LoadQuantity("force", "N", "990 N", "mN, N, kN, kgf, lbf"),
}


# -- rules for the other values -------------------------------------------------------------------------------------


def choice(value: Any, options: Sequence[str]) -> str:
    if isinstance(value, str) and value in options:
        return value
    meant = closest(value, options) if isinstance(value, str) else None
    raise Refused(shown(value), ", ".join(options), f"Did you mean {meant!r}?" if meant else "")


def lattice_name(value: Any) -> str:
    if value == "hexagonal":
        raise Refused("'hexagonal'", ", ".join(LATTICES), "Did you mean 'triangular', with six neighbours?")
    return choice(value, tuple(LATTICES))


def truth(value: Any) -> bool:
    if isinstance(value, bool):
        return value
    word = value.strip().lower() if isinstance(value, str) else None
    meant = "true" if word in ("yes", "on", "y", "true") else "false" if word in ("no", "off", "n", "false") else ""
    raise Refused(shown(value), "true or false", f"Did you mean {meant}?" if meant else "")


def poisson_ratio(value: Any) -> float:
    allowed = "a plain number, -1 < poisson_ratio <= 0.5"
    if not isinstance(value, int | float) or isinstance(value, bool):
        raise Refused(shown(value), allowed, "Write it without quotes or unit." if isinstance(value, str) else "")
    if not -1.0 < value <= 0.5:
        raise Refused(shown(value), allowed, "Outside it an isotropic solid is not stable.")
    return float(value)


def whole(value: Any, low: int, high: int) -> int:
    if isinstance(value, int) and not isinstance(value, bool) and low <= value <= high:
        return value
    raise Refused(shown(value), f"a whole number from {low} to {high}")


def schema_number(value: Any) -> int:
    if value == SCHEMA and isinstance(value, int) and not isinstance(value, bool):
        return SCHEMA
    newer = isinstance(value, int) and value > SCHEMA
    raise Refused(shown(value), str(SCHEMA), "The scene was written for a newer granphon." if newer else "")


def observed(value: Any) -> tuple[str, ...]:
    allowed = "a list of one or more of " + ", ".join(OBSERVABLES)
    if not isinstance(value, list | tuple) or not value:
        mend = f"Did you mean [{value}]?" if isinstance(value, str) and value in OBSERVABLES else ""
        raise Refused(shown(value) if value != [] else "an empty list", allowed, mend)
    names = tuple(choice(name, OBSERVABLES) for name in value)
    double = [name for name in names if names.count(name) > 1]
    if double:
        raise Refused(f"{double[0]!r} twice", allowed + ", each once")
    return tuple(name for name in OBSERVABLES if name in names)


def medium_name(value: Any) -> str:
    if isinstance(value, dict) and len(value) == 1:
        (name, options), allowed = next(iter(value.items())), ", ".join(MEDIUM_NAMES)
        name = medium_name(name)
        if options:
            listed = ", ".join(map(str, options)) if isinstance(options, dict) else shown(options)
            raise Refused(f"options of {name!r} ({listed[:60]!r})", f"{allowed}, which have no options in this version")
        return name
    if value == "simulation":
        raise Refused("'simulation'", ", ".join(MEDIUM_NAMES), "This version has no simulation.")
    return choice(value, MEDIUM_NAMES)


def no_spread(value: Any) -> None:
    raise Refused(shown(value), "no spread: this version knows equal balls only", "Leave spread out.")


def grid(value: Any, low: int, high: int, example: str) -> tuple[int, int]:
    """Two whole numbers, from "64 64 1" or [64, 64, 1], or (64, 64)."""
    allowed = f"two whole numbers from {low} to {high} and a 1, such as {example}"
    words: Any = value.split() if isinstance(value, str) else value
    if not isinstance(words, list | tuple) or len(words) not in (2, 3):
        raise Refused(shown(value), allowed)
    if isinstance(value, str):
        words = [int(w) if re.fullmatch(r"[0-9]{1,9}", w) else w for w in words]
    if not all(isinstance(w, int) and not isinstance(w, bool) for w in words):
        raise Refused(shown(value), allowed)
    if len(words) == 3 and words[2] != 1:
        raise Refused(f"{shown(value)}, whose third number is {words[2]}", allowed, "The packing is one layer.")
    if not all(low <= w <= high for w in words[:2]):
        raise Refused(shown(value), allowed)
    return words[0], words[1]


supercell = partial(grid, low=2, high=100, example="3 3 1")
mesh_numbers = partial(grid, low=1, high=4096, example="64 64 1")
segment_points = partial(whole, low=2, high=100_000)
balls_on_side = partial(whole, low=1, high=1_000_000)


def band_paths(value: Any) -> tuple[tuple[tuple[float, float, float], ...], ...]:
    """Paths of points, from "0 0 0 1/3 1/3 0, 1/2 0 0 0 0 0"; a comma parts paths that do not join."""
    allowed = "points of three numbers or fractions each, such as '0 0 0 1/3 1/3 0 1/2 0 0'; a comma parts separate paths"
    if not isinstance(value, str):
        raise Refused(shown(value), allowed, "Write the points as one line of text.")
    paths = []
    for part in value.split(","):
        numbers = [_fraction(word, value, allowed) for word in part.split()]
        if len(numbers) % 3 or len(numbers) < 6:
            found = f"{shown(value)}, with {len(numbers)} numbers in a path"
            raise Refused(found, allowed, "A path has two points or more.")
        points = tuple((numbers[n], numbers[n + 1], numbers[n + 2]) for n in range(0, len(numbers), 3))
        if any(point[2] != 0.0 for point in points):
            raise Refused(f"{shown(value)}, with a third number that is not 0", allowed, "The packing is one layer.")
        if any(one == two for one, two in itertools.pairwise(points)):
            raise Refused(f"{shown(value)}, with the same point twice in a row", allowed)
        paths.append(points)
    return tuple(paths)


def _fraction(word: str, value: str, allowed: str) -> float:
    if re.fullmatch(r"[-+]?[0-9]{1,9}/0*[1-9][0-9]{0,8}", word):
        return float(Fraction(word))
    number = float(word) if re.fullmatch(_NUMBER, word) else math.nan
    if not abs(number) <= 1e3:
        raise Refused(f"{shown(word)} in {shown(value)}", allowed)
    return number + 0.0


def label_words(value: Any) -> tuple[str, ...]:
    words = value.split() if isinstance(value, str) else value
    if (
        not isinstance(words, list | tuple)
        or not words
        or not all(isinstance(w, str) and re.fullmatch(r"[^\s'\"|]{1,40}", w) and w.isprintable() for w in words)
    ):
        allowed = "a short label for each point of the band, such as G K M G, without quotes, spaces or |"
        raise Refused(shown(value), allowed)
    return tuple(words)
