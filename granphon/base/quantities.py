"""Quantities with their units, as people write them: "8 mm" is 0.008.

:meth:`Quantity.read` is a rule: it takes what stood in a file or on the command line and returns
the value in SI, or raises :class:`~granphon.base.errors.Refused`, which says what was found, what
is allowed, and what was probably meant. Units are read here and nowhere else; the rest of granphon
computes with plain floats.
"""

from __future__ import annotations

import itertools
import math
import re
from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass, replace
from fractions import Fraction
from functools import cache, lru_cache
from typing import TYPE_CHECKING, Any, Literal

from granphon.base.errors import Refused
from granphon.base.text import closest, show

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import NDArray


#: the units that a scene may use, by their names; exact, so that "8 mm" is the float nearest to
#: 0.008
_UNITS = {
    "m": "",
    "s": "",
    "g": "",
    "K": "",
    "meter metre": "1 m",
    "second": "1 s",
    "gram": "1 g",
    "kelvin degree_Celsius degC": "1 K",
    "minute": "60 s",
    "h hour": "3600 s",
    "Hz hertz": "1 1/s",
    "% percent": "0.01",
    "N newton": "1000 g*m/s^2",
    "Pa pascal": "1 N/m^2",
    "J joule": "1 N*m",
    "bar": "1e5 Pa",
    "atm": "101325 Pa",
    "inch inches": "0.0254 m",
    "ft foot feet": "0.3048 m",
    "yd yard": "0.9144 m",
    "mi mile": "1609.344 m",
    "angstrom Å": "1e-10 m",
    "mph mile_per_hour": "1 mi/h",
    "nmi nautical_mile": "1852 m",
    "knot": "1 nmi/h",
    "fps foot_per_second": "1 ft/s",
    "t tonne": "1e6 g",
    "lb pound": "453.59237 g",
    "lbf pound_force": "4.4482216152605 N",
    "psi": "1 lbf/inch^2",
    "kgf kilogram_force": "9.80665 N",
    "dyn dyne": "1e-5 N",
}
_NAMES = {name: value for names, value in _UNITS.items() for name in names.split()}
#: the powers of ten of the prefixes; the empty one comes first, as "ft" is a foot
_PREFIXES = {
    "": 0,
    "p": -12,
    "pico": -12,
    "n": -9,
    "nano": -9,
    "u": -6,
    "µ": -6,
    "μ": -6,
    "micro": -6,
    "m": -3,
    "milli": -3,
    "c": -2,
    "centi": -2,
    "k": 3,
    "kilo": 3,
    "M": 6,
    "mega": 6,
    "G": 9,
    "giga": 9,
    "T": 12,
    "tera": 12,
}
#: regular expression of a number without a unit
NUMBER = r"[-+]?(?:[0-9]+\.?[0-9]*|\.[0-9]+)(?:[eE][-+]?[0-9]+)?"
#: velocity of light, m/s, which no sound reaches: a velocity above it has another unit, or is a
#: mistake
LIGHT_VELOCITY = 299_792_458.0
#: longest text of a quantity, in characters; a longer one is refused
_MOST_SIGNS = 100
#: the least size of numbers that, up to the inverse of this size, stay far from the ends of the
#: floating range when any unit is applied to them
_LEAST_SAFE_SIZE = 1e-200
#: a number, the space behind it, and what follows
_QUANTITY = re.compile(rf"({NUMBER})(\s*)(.*)", re.DOTALL)
#: what stands between a quantity and its standard error, and both before the unit that they share
PLUS_MINUS = re.compile(r"\+-|\+/-|±")
#: a value and its error in brackets, and the unit behind them
_IN_BRACKETS = re.compile(r"\(([^()]*)\)\s*(.*)", re.DOTALL)
#: the unit of a standard error that is a part of its value
PERCENT = "%"
#: how the unit of a plain number is written
_NO_UNIT = ("", "1")
#: regular expression of a factor of a unit: its name and its power
_FACTOR = r"(?:%|[A-Za-zµμÅ_]+)(?:(?:\^|\*\*)?-?[1-9]|[²³])?"
#: one factor of a unit: what stands before it, its name, and its power
_FACTORS = re.compile(r"([*/·]?)\s*(%|[A-Za-zµμÅ_]+)(?:\^|\*\*)?(-?[1-9]|[²³])?")
#: number of letters of a name, above which a last s may be that of the plural
_MOST_LETTERS_OF_SINGULAR = 3
#: a whole unit: factors with signs between them, or one over such factors
_UNIT_PATTERN = re.compile(rf"(?:1/)?{_FACTOR}(?:\s*[*/·]\s*{_FACTOR})*")
_SUPERSCRIPTS = {"²": "2", "³": "3"}
#: what messages say of the numbers that are taken
_SIGN_WORDS = {"above zero": " above zero", "zero or above": ", zero or above,", "any": ""}


@dataclass(frozen=True)
class Quantity:
    """A kind of quantity: its name, its SI unit, an example, and the units to suggest.

    ``example`` is such a quantity as text, "8 mm", and ``common`` a list of its units, parted by
    commas, of which messages suggest the closest. ``least`` says which numbers are allowed: above
    zero, zero or above, or any. ``negative`` is the word that messages use for a number below zero.
    """

    name: str
    unit: str
    example: str
    common: str
    least: Literal["above zero", "zero or above", "any"] = "above zero"
    negative: str = "negative"

    @property
    def si_unit(self) -> str:
        """The SI unit as results and messages have it, with a space between its factors."""
        return self.unit.replace("*", " ")

    @property
    def allowed(self) -> str:
        """What may be written for such a quantity, in words for a message."""
        sign = _SIGN_WORDS[self.least]
        # a name with a point is that of a parameter of a kind or a wall, "A.density"
        owner, _, noun = self.name.rpartition(".")
        article = "an" if noun[0] in "aeiou" else "a"
        words = f"{article} {noun} of {owner}" if owner else f"{article} {noun}"
        unit = f"with its unit, such as '{self.example}' ({self.common})"
        return f"{words}{sign} {unit}"

    def read(self, value: Any) -> float:
        """Return the SI value of a text such as "8 mm": the float nearest to the exact number, in
        which a zero has no sign.

        Raises :class:`~granphon.base.errors.Refused` for anything else: a number without a unit, a
        unit of another kind, a number that ``least`` does not allow, or one that double precision
        cannot hold.
        """
        number, unit = self._split(value)
        factor = self._require_factor(value, number, unit)
        if not math.isfinite(float(number)):
            raise Refused(f"{show(value)}, which is not a finite number", self.allowed)
        if _is_zero(number):
            if self.least == "above zero":
                raise Refused(f"{show(value)}, which is zero", self.allowed)
            return 0.0
        if number.startswith("-") and self.least != "any":
            raise Refused(f"{show(value)}, which is {self.negative}", self.allowed)
        si_value = _round_product(number, factor)
        if not 0.0 < abs(si_value) < math.inf:
            raise Refused(
                f"{show(value)}, which is too small or too large for double precision", self.allowed
            )
        return si_value

    def _split(self, value: Any) -> tuple[str, str]:
        """Return the number and the unit that a text holds, as texts; :class:`Refused` if ``value``
        is no text, or the text is too long, does not begin with a number, or lacks a unit. Whether
        the number is finite, and the unit known, is not checked.
        """
        mend = f"Write the unit too, such as '{self.example}'."
        is_number = isinstance(value, int | float) and not isinstance(value, bool)
        if is_number:
            if isinstance(value, float) and not math.isfinite(value):
                raise Refused(f"{show(value)}, which is not a finite number", self.allowed)
            raise Refused(f"{show(value)}, without a unit", self.allowed, mend)
        if not isinstance(value, str):
            raise Refused(show(value), self.allowed)
        text = value.strip()
        if len(text) > _MOST_SIGNS:
            raise Refused(
                f"{show(value)}, a text of {len(text)} letters",
                f"{self.allowed}, in {_MOST_SIGNS} letters at most",
            )
        if re.match(r"[-+]?\.?(nan|inf|infinity)\b", text, re.IGNORECASE):
            raise Refused(f"{show(value)}, which is not a finite number", self.allowed)
        match = _QUANTITY.fullmatch(text)
        if match is None:
            raise Refused(f"{show(value)}, which does not start with a number", self.allowed)
        number, _, unit = match.groups()
        if not unit:
            raise Refused(f"{show(value)}, without a unit", self.allowed, mend)
        return number, unit

    def _require_factor(self, value: str, number: str, unit: str) -> Fraction:
        """Return the exact factor from ``unit`` to the SI unit; :class:`Refused` if ``unit`` is no
        unit of this kind of quantity.

        ``value`` is the whole text, which the message shows, and ``number`` its number.
        """
        try:
            return _find_factor(self, unit)
        except ValueError as error:
            has_error = PLUS_MINUS.search(value)
            reason = "with a standard error, which has no use here" if has_error else error
            mend = _suggest(number, unit, self.common.split(", "))
            raise Refused(f"{show(value)}, {reason}", self.allowed, mend) from None

    def read_many(self, numbers: Sequence[str], unit: str) -> NDArray[np.float64] | None:
        """Return the SI values (n,) of the texts of n ``numbers`` of one ``unit``, each the same as
        that of :meth:`read`, to the last bit.

        Where the unit is a power of ten times the SI unit, the decimal point of the text is
        shifted; other products are quotients of whole numbers. Both are exact before they are
        rounded. Returns None where only :meth:`read` will do: if ``unit`` is not of this kind of
        quantity; or if a text is no plain number or very long, or its number is to be refused, or
        is near the ends of the floating range.
        """
        import numpy as np  # here alone, so that the command's help needs no numpy

        # with the space between number and unit a text has one letter more
        length = max(map(len, numbers), default=0) + len(unit)
        are_short = length < _MOST_SIGNS
        if not are_short or not self.measures(unit) or not is_plain(numbers):
            return None
        try:
            values = np.array(_round_products(numbers, _find_factor(self, unit)))
        except (ValueError, OverflowError):
            return None
        sizes = np.abs(values)
        is_zero = sizes == 0.0
        texts_of_zeros = {numbers[index] for index in np.flatnonzero(is_zero).tolist()}
        if not all(_is_zero(text) for text in texts_of_zeros):
            return None  # a number below the floating range was rounded to zero
        is_far_from_ends = (sizes > _LEAST_SAFE_SIZE) & (sizes < 1.0 / _LEAST_SAFE_SIZE)
        if self.least == "above zero":
            is_allowed = values > 0.0
        elif self.least == "zero or above":
            is_allowed = values >= 0.0
        else:
            is_allowed = np.isfinite(values)
        if not np.all((is_zero | is_far_from_ends) & is_allowed):
            return None
        return values + 0.0  # -0.0 + 0.0 is 0.0: zeros lose their sign

    def measures(self, unit: str) -> bool:
        """Whether ``unit`` is one of this kind of quantity."""
        try:
            return bool(_find_factor(self, unit))
        except ValueError:
            return False

    def factor(self, unit: str) -> float:
        """Return the size of one ``unit`` in the SI unit; ValueError if ``unit`` is no unit of this
        kind of quantity.
        """
        return float(_find_factor(self, unit))

    def write(self, value: float) -> str:
        """Return the text of an SI value, from which :meth:`read` returns the same value, to the
        last bit, if such a quantity has a unit and may have the value; but zero loses its sign.
        """
        number = float(value)  # as the repr of NumPy's float64 is no text of a number
        return f"{number!r} {self.unit}"


def is_plain(texts: Sequence[str]) -> bool:
    """Whether texts consist only of digits, signs, points, "e" and "E": of such texts, ``float``
    reads those alone that match :data:`NUMBER`.
    """
    joined = "".join(texts)
    if not joined.isascii():
        return False
    other_letters = joined.encode().translate(None, b"0123456789+-.eE")
    return not other_letters


def _is_zero(number: str) -> bool:
    """Whether all digits of a number are zero, whatever its power of ten."""
    digits = re.split("[eE]", number)[0]
    return not re.search("[1-9]", digits)


def _round_product(number: str, factor: Fraction) -> float:
    """Return the float nearest to a number times a factor; infinity if the product is too large,
    and zero for a number below the floating range, whatever the factor.
    """
    if float(number) == 0.0:
        # not multiplied, as the exact power of ten of the number may be huge
        return 0.0
    try:
        return float(Fraction(number) * factor)
    except OverflowError:
        return math.inf


def _round_products(numbers: Sequence[str], factor: Fraction) -> list[float]:
    """Return the float nearest to each number times a factor; ValueError for a text that is no
    number. A product that is too large is infinite, or raises OverflowError; a number near the ends
    of the floating range may come without the factor, see :func:`_multiply`.
    """
    if factor == 1:
        return list(map(float, numbers))
    # the power of ten that the factor is, if it is one
    power = len(str(factor.numerator)) - len(str(factor.denominator))
    if factor == Fraction(10) ** power:
        return [_shift_point(text, power) for text in numbers]
    return [_multiply(text, factor) for text in numbers]


def _suggest(number: str, unit: str, common_units: Sequence[str]) -> str:
    """Return how to mend a text whose ``unit`` is refused, as a sentence; empty if there is no
    guess.
    """
    # of "211,65 GPa" the number is "211" and the unit ",65 GPa"
    comma = re.match(r",\s*([0-9]+)(?![0-9,.])", unit)
    if comma and "." not in number:
        decimals = comma[1]
        unit_after_number = unit[comma.end() :]
        return f"Write decimals with a point: '{number}.{decimals}{unit_after_number}'."
    starts_as_unit = unit[0].isalpha() or unit[0] == "%"
    guess = closest(unit, common_units) if starts_as_unit else None
    if guess is None or guess == unit:
        return ""
    return f"Did you mean '{number} {guess}'?"


def _shift_point(text: str, power: int) -> float:
    """Return the float nearest to the number in a text times a power of ten."""
    if "e" not in text and "E" not in text:
        return float(f"{text}e{power}")
    digits, _, exponent = text.lower().partition("e")
    return float(f"{digits}e{int(exponent) + power}")


def _multiply(text: str, factor: Fraction) -> float:
    """Return the float nearest to the number in a text times a factor: Python rounds a quotient of
    whole numbers once. A number near the ends of the floating range is returned without the factor.
    """
    number = float(text)
    if not _LEAST_SAFE_SIZE < abs(number) < 1.0 / _LEAST_SAFE_SIZE:
        # read_many takes zero alone of such numbers; the exact power of ten of others may be huge
        return number
    digits, _, exponent = text.lower().partition("e")
    whole, _, decimals = digits.partition(".")
    # the number is int(whole + decimals) * 10**power
    power = int(exponent or 0) - len(decimals)
    numerator: int = int(whole + decimals) * factor.numerator * 10 ** max(power, 0)
    denominator: int = factor.denominator * 10 ** max(-power, 0)
    return numerator / denominator


@lru_cache(maxsize=256)  # all cells of a column have the same unit
def _find_factor(kind: Quantity, unit: str) -> Fraction:
    """Return the exact factor from a unit to the SI unit of a ``kind`` of quantity.

    Raises ValueError for a unit that is not one of that kind. Its text is a relative clause, with
    which the caller ends a sentence about the whole quantity.
    """
    if not _UNIT_PATTERN.fullmatch(unit):
        raise ValueError("which is not one number and one unit")
    try:
        factor, powers = _measure(unit)
        si_factor, si_powers = _measure(kind.unit)
    except KeyError:
        raise ValueError("whose unit is not known") from None
    if powers != si_powers:
        raise ValueError(f"whose unit is not a unit of {kind.name}")
    return factor / si_factor


def _measure(unit: str) -> tuple[Fraction, Counter[str]]:
    """Return the exact factor from a unit to base units (m, s, g, K), and the power of each base
    unit by its name; KeyError if a name is not known.
    """
    factor = Fraction(1)
    powers = Counter[str]()
    for sign, name, power in _FACTORS.findall(unit):
        exponent = int(_SUPERSCRIPTS.get(power, power) or 1)
        if sign == "/":
            exponent = -exponent
        unit_factor, unit_powers = _find_unit(name)
        factor *= unit_factor**exponent
        for base, count in unit_powers.items():
            powers[base] += count * exponent
    # powers of zero stay: counters that differ by zeros alone are equal
    return factor, powers


def find_written_unit(text: Any) -> str:
    """Return the unit of a quantity as text, such as "8 mm", whether the unit is known or not;
    empty for another value, also for a text that goes on after the unit.
    """
    match = _QUANTITY.fullmatch(text.strip()) if isinstance(text, str) else None
    unit = match.group(3).strip() if match else ""
    return unit if _UNIT_PATTERN.fullmatch(unit) else ""


def split_error(text: str) -> tuple[Any, str] | None:
    """Split a text such as "211.65 +- 2 GPa", "(211.65 +- 2) GPa", "8 mm +- 4 um" or "8 mm +- 1 %"
    into its value and its standard error.

    Returns the value in the form in which it would stand alone, "8 mm" or a plain number, which is
    infinite if it is too large for a float, and the error as a text with its unit, if it has one,
    "4 um" or "1 %".
    Neither is checked further. None for a text of another form, or in which either is longer than a
    quantity may be.
    """
    in_brackets = _IN_BRACKETS.fullmatch(text.strip())
    common_unit = in_brackets[2] if in_brackets else ""
    parts = PLUS_MINUS.split(in_brackets[1] if in_brackets else text)
    matches = [_QUANTITY.fullmatch(part.strip()) for part in parts]
    if len(matches) != 2 or matches[0] is None or matches[1] is None:
        return None
    if any(len(part) > _MOST_SIGNS for part in parts):
        return None
    number, _, own_unit = matches[0].groups()
    error, _, unit_of_error = matches[1].groups()
    if in_brackets and (own_unit or unit_of_error):
        return None
    if unit_of_error == PERCENT:
        unit = own_unit.strip()
    else:
        unit = own_unit.strip() or unit_of_error or common_unit
        unit_of_error = unit_of_error or unit
    error_text = f"{error} {unit_of_error}".strip()
    if unit:
        return f"{number} {unit}", error_text
    is_whole_number = re.fullmatch("[-+]?[0-9]+", number) is not None
    return int(number) if is_whole_number else float(number), error_text


def read_with_error(text: str, quantity: Quantity) -> tuple[float, float]:
    """Return the value of a ``quantity`` and its standard error, SI, of a text such as "8 mm +- 4
    um"; the error of "8 mm" is zero. :class:`~granphon.base.errors.Refused` for another text, and
    for an error that is below zero or beyond double precision.
    """
    parts = split_error(text)
    if parts is None:
        return quantity.read(text), 0.0
    value = quantity.read(parts[0])
    error = parts[1]
    if error.endswith(PERCENT):
        size = abs(value) * _PART.read(error)
        if math.isinf(size):
            raise Refused(
                f"{show(text)}, whose error is too large for double precision", quantity.allowed
            )
        return value, size
    of_error = replace(quantity, least="zero or above", negative="negative")
    return value, of_error.read(error)


def find_factor(unit: str, target: str) -> float | None:
    """Return the factor from a ``unit`` to the unit ``target``; None if a text is no unit that is
    known, or if the dimensions of the two differ. The unit of a plain number is "" or "1".
    """
    try:
        factor, powers = _measure_written(unit)
        target_factor, target_powers = _measure_written(target)
    except KeyError:
        return None
    return float(factor / target_factor) if powers == target_powers else None


def _measure_written(unit: str) -> tuple[Fraction, Counter[str]]:
    """Return what :func:`_measure` does of a unit as people and results write it, "kg m^2" or
    "m/(N s)"; KeyError for a text that is no unit, in which :func:`_measure` would pass over what
    is no factor.
    """
    joined = _join_factors(unit)
    if joined in _NO_UNIT:
        return Fraction(1), Counter()
    if not _UNIT_PATTERN.fullmatch(joined):
        raise KeyError(unit)
    return _measure(joined)


def _join_factors(unit: str) -> str:
    """Return a unit with a sign between its factors, without spaces and brackets: pint's "meter /
    second ** 2" as "meter/second**2", "kg m^2" as "kg*m^2", and "m/(N s)" as "m/N/s". Brackets that
    hold another division stay.
    """

    def divide_by_each(divisor: re.Match[str]) -> str:
        """Return "/N/s" for the match of "/(N s)"."""
        factors = re.split(r" |(?<!\*)\*(?!\*)", divisor[1].strip())  # not at the ** of a power
        return "".join(f"/{factor}" for factor in factors)

    without_spaces = re.sub(r"\s*(\*\*|[*/^])\s*", r"\1", unit.strip())
    without_brackets = re.sub(r"/\(([^()/]*)\)", divide_by_each, without_spaces)
    return without_brackets.replace(" ", "*")


def is_si(unit: str, dimension: str = "") -> bool:
    """Whether a text is a unit without a factor to SI, as "m/(N s)" or "1", not "kN", and of the
    dimension of the unit ``dimension``; where that is empty, of any dimension. A radian counts as a
    plain number if it stands alone, and as an unknown unit in products such as "rad/s".
    """
    if _join_factors(unit) in (*_NO_UNIT, "rad", "radian", "dimensionless"):
        return dimension in (*_NO_UNIT, "rad")
    try:
        factor, powers = _measure_written(unit)
        if factor != Fraction(1000) ** powers["g"]:  # the SI unit of mass is 1000 g
            return False
        if not dimension:
            return True
        _, powers_of_dimension = _measure_written(dimension)
    except KeyError:
        return False
    return powers == powers_of_dimension


@cache
def _find_unit(name: str) -> tuple[Fraction, Counter[str]]:
    """Return the factor and the powers, as :func:`_measure` does, of the unit ``name``, which may
    have a prefix and be in the plural; raise KeyError if the name is not known. The powers are kept
    for the next call, and must not be changed.
    """
    singular = name.removesuffix("s") if len(name) > _MOST_LETTERS_OF_SINGULAR else name
    spellings = dict.fromkeys((name, singular))  # in this order, each once
    for spelling, (prefix, power) in itertools.product(spellings, _PREFIXES.items()):
        unit_name = spelling.removeprefix(prefix)
        is_known = unit_name in _NAMES and spelling == prefix + unit_name
        if not is_known:
            continue
        prefix_factor = Fraction(10) ** power
        definition = _NAMES[unit_name]
        if not definition:  # a base unit
            return prefix_factor, Counter([unit_name])
        number, _, unit = definition.partition(" ")
        factor, powers = _measure(unit)
        return prefix_factor * Fraction(number) * factor, powers
    raise KeyError(name)


#: a standard error as a part of its value
_PART = Quantity("standard error", "1", "1 %", PERCENT, "zero or above")
LENGTH = Quantity("length", "m", "8 mm", "m, cm, mm, um, nm, inch")
MODULUS = Quantity("pressure", "Pa", "211.65 GPa", "Pa, kPa, MPa, GPa, bar, psi")
DENSITY = Quantity("density", "kg/m^3", "7840 kg/m^3", "kg/m^3, g/cm^3")
#: width of the distribution of diameters; zero for equal balls
WIDTH = Quantity("length", "m", "2.04 um", "m, mm, um, nm", "zero or above")
FREQUENCY = Quantity("frequency", "Hz", "6.5 kHz", "Hz, kHz, MHz")
TIME = Quantity("time", "s", "0.5 ms", "s, ms, us, minutes, hours")
#: of a motion: a time since its start, a velocity, a force, and a displacement (or a place)
SINCE = replace(TIME, least="zero or above")
VELOCITY = Quantity("velocity", "m/s", "0.3 m/s", "m/s, mm/s, um/s, km/h")
PUSH = Quantity("force", "N", "2 N", "mN, N, kN", "any")
WAY = Quantity("length", "m", "8 mm", "m, mm, um, nm", "any")
#: losses of balls and of contacts
RATE = Quantity("rate", "1/s", "40 1/s", "1/s, 1/ms", "zero or above")
VISCOSITY = Quantity("viscosity", "N*s/m", "2 N*s/m", "N*s/m, kg/s", "zero or above")
_TENSILE = "tensile (one-sided contacts carry no tension)"
#: the quantity of each kind of load on a layer; where balls differ an overlap may be negative, and
#: the medium checks that
LOADS: dict[str, Quantity] = {
    "force": Quantity("force", "N", "18.446 N", "uN, mN, N, kN, kgf, lbf", negative=_TENSILE),
    "pressure": Quantity(
        "force per length", "N/m", "4 kN/m", "N/m, kN/m, N/mm, Pa*m", negative=_TENSILE
    ),
    "overlap": Quantity("length", "m", "2 um", "m, mm, um, nm", "any"),
    "side_force": Quantity("force", "N", "990 N", "mN, N, kN, kgf, lbf", negative=_TENSILE),
}
#: the quantity of a component of each tensor that loads a crystal of two periods
TENSORS: dict[str, Quantity] = {
    "stress": Quantity("force per length", "N/m", "-4 kN/m", "N/m, kN/m, N/mm, Pa*m", "any"),
    "strain": Quantity("strain", "1", "-1e-4", "", "any"),
}
#: the kinds of load by name, of packings and of crystals
LOAD_KINDS = (*LOADS, *TENSORS)
MASS = Quantity("mass", "kg", "28.84 g", "kg, g, mg")
#: stiffness against displacements, and against rotations
STIFFNESS = Quantity("stiffness", "N/m", "3 MN/m", "N/m, kN/m, MN/m, N/um", "zero or above")
TURN_STIFFNESS = Quantity("torque", "N*m", "1 N*mm", "N*m, N*mm", "zero or above")
INERTIA = Quantity("moment of inertia", "kg*m^2", "1.1e-6 kg*m^2", "kg*m^2, g*cm^2")
ACCELERATION = Quantity("acceleration", "m/s^2", "9.81 m/s^2", "m/s^2", "any")
ADHESION = Quantity("energy per area", "J/m^2", "50 mJ/m^2", "J/m^2, mJ/m^2", "zero or above")
#: what a pressure is on a line and in space: a force, and a force per area
_PRESSURES = {
    1: Quantity("force", "N", "18.446 N", "uN, mN, N, kN, kgf, lbf", negative=_TENSILE),
    3: Quantity("force per area", "Pa", "10 kPa", "Pa, kPa, MPa, bar, N/mm^2", negative=_TENSILE),
}


def load_quantities(periods: int) -> dict[str, Quantity]:
    """Return the quantity of each kind of load, by its name, on balls along a line, in a layer or
    in space (1, 2, 3 ``periods``).

    A pressure is a force on a line, a force per length of the boundary of a layer, and a force per
    area in space. The mapping may be :data:`LOADS` itself, and must not be changed.
    """
    return LOADS if periods == 2 else LOADS | {"pressure": _PRESSURES[periods]}


def tensor_quantities(periods: int) -> dict[str, Quantity]:
    """Return the quantity of a component of the "stress" and of the "strain" on balls along a line,
    in a layer or in space (1, 2, 3 ``periods``).

    A stress is a pressure of any sign, in the units of :func:`load_quantities`. The mapping may be
    :data:`TENSORS` itself, and must not be changed.
    """
    if periods == 2:
        return TENSORS
    pressure = _PRESSURES[periods]
    example = f"-{pressure.example}"
    stress = replace(pressure, example=example, least="any", negative="negative")
    return TENSORS | {"stress": stress}


def find_load_unit(kind: str, periods: int, pressed_axes: int | None = None) -> str:
    """Return the SI unit of a ``kind`` of load, one of ``LOAD_KINDS``; empty if the kind has none.

    ``periods`` is the number of periods of the packing, and ``pressed_axes`` the number of axes
    along which a pressure acts; None if these are the same.
    """
    quantities = load_quantities(pressed_axes or periods) | tensor_quantities(periods)
    return quantities[kind].unit.removeprefix("1")
