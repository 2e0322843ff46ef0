"""The scales that tie reduced units to SI.

Inside, granphon measures length in the mean diameter d, stiffness in the normal contact stiffness k
and mass in the ball's mass M. A frozen :class:`Units` carries the three scales. Every object in
reduced units holds one, and only there are numbers converted between reduced units and SI.
"""

from __future__ import annotations

import math
import re
from bisect import bisect_right
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from granphon.base.errors import InputError
from granphon.base.quantities import find_factor
from granphon.base.text import require_schema, write_float

#: version number of the block at the head of files for phonopy
_HEADER_SCHEMA = 1
#: names under which the scales are stored in ``Atoms.info`` and in exported files
_INFO = {
    "length": "granphon_length_m",
    "stiffness": "granphon_stiffness_N_per_m",
    "mass": "granphon_mass_kg",
}
#: the least size of numbers that are written in the unit that a user has chosen, and the least size
#: above it of those that are not
_LEAST_CHOSEN_SIZE = 1e-3
_LEAST_SIZE_BEYOND = 1e4
#: sizes of the decimal prefixes, ascending; ``_PREFIXES`` holds their names in the same order
_SIZES = (
    1e-24, 1e-21, 1e-18, 1e-15, 1e-12, 1e-9, 1e-6, 1e-3, 1.0, 1e3, 1e6, 1e9, 1e12, 1e15, 1e18, 1e21,
    1e24,
)  # fmt: skip
_PREFIXES = ("y", "z", "a", "f", "p", "n", "u", "m", "", "k", "M", "G", "T", "P", "E", "Z", "Y")


def _find_multiple(value: float, unit: str) -> tuple[float, str]:
    """Return size and name of the decimal multiple of ``unit`` in which a ``value``, in that
    ``unit``, lies between 1 and 1000; the least or the greatest multiple for values beyond.
    """
    index = max(bisect_right(_SIZES, value) - 1, 0)
    return _SIZES[index], _PREFIXES[index] + unit


def prefixed(value: float, unit: str) -> tuple[float, str]:
    """Return size and name, such as 1e-6 and "um", of the decimal multiple of a ``unit`` in which
    people write a ``value``, a number in that ``unit``.

    A value that is below a multiple only by rounding (1e-8 of it) counts as that multiple. Zero,
    values beyond the range of the prefixes, and units that take none ("1", "1/m", "m^2", "kg/m^3")
    keep the ``unit`` itself, of size 1. So do times of a second and more.
    """
    magnitude = abs(value) * (1.0 + 1e-8)
    leading_unit = re.split(r"[ */]", unit)[0]
    is_long_time = leading_unit == "s" and magnitude >= 1.0
    takes_prefix = leading_unit.isalpha() and leading_unit != "kg" and not is_long_time
    is_in_range = _SIZES[0] <= magnitude < 1e3 * _SIZES[-1]
    if takes_prefix and is_in_range:
        return _find_multiple(magnitude, unit)
    return 1.0, unit


def write_quantity(value: float, unit: str, digits: int = 5) -> str:
    """Return the text of a value in the SI unit ``unit``, with ``digits`` significant digits and a
    decimal prefix, such as "8 mm".
    """
    # the prefix is that of the rounded value: 999.6 um are 1 mm in three digits
    rounded = float(f"{value:.{digits}g}")
    size, name = prefixed(rounded, unit)
    # fewer than three digits would be written with an exponent, as 9e+02 mm
    return f"{rounded / size:.{max(digits, 3)}g}{write_unit(name)}"


def write_in(value: float, unit: str, written: str = "", digits: int = 5) -> str:
    """Return the text of a value with ``digits`` significant digits, such as "0.5 mm", in the unit
    ``written`` that a user has chosen; ``value`` is in the SI ``unit``.

    The text is that of :func:`write_quantity`, with a decimal prefix, if ``written`` is empty, is
    not known or has another dimension than ``unit``, or if the rounded number in ``written`` is
    below 1e-3 or not below 1e4, but not zero.
    """
    factor = find_factor(unit, written) if written else None
    if factor is None:
        return write_quantity(value, unit, digits)
    rounded = float(f"{value * factor:.{digits}g}")
    if rounded and not _LEAST_CHOSEN_SIZE <= abs(rounded) < _LEAST_SIZE_BEYOND:
        return write_quantity(value, unit, digits)
    # fewer than four digits would be written with an exponent, as 1.2e+03 mm
    return f"{rounded:.{max(digits, 4)}g}{write_unit(written)}"


def write_error(error: float, value: float, unit: str) -> str:
    """Return the text of a standard ``error``, with two digits, in the multiple of the SI ``unit``
    in which the ``value`` beside the error is written. An error below a thousandth of that
    multiple, or of ten thousand and more once it is rounded, has a multiple of its own; so has any
    error if that multiple is none of those that :func:`~granphon.base.quantities.find_factor`
    knows, from pico to tera.
    """
    _size, name = prefixed(value, unit)
    return write_in(error, unit, name, 2)


def write_unit(unit: str) -> str:
    """Return the ``unit`` as the text of a quantity ends, after a space; nothing for "1"."""
    return "" if unit in ("", "1") else f" {unit}"


def write_uncertain(value: float, error: float, unit: str) -> str:
    """Return the text of a value with its standard error, both in the SI unit ``unit``, such as
    "1.11180 +/- 0.00039 km/s": the error has two digits, three from a hundred multiples on.

    Value and error have one multiple of the unit, that of the larger of the two. Each has a
    multiple of its own if the error is at most a millionth of the value, if one of the two is nan,
    or if the unit takes no larger multiple and the error is a thousand units or more.
    """
    # the multiple is that of the rounded error: 999.6 m are 1.0 km
    rounded_error = float(f"{error:.3g}")
    size, name = prefixed(max(abs(value), rounded_error), unit)
    is_tiny = not 1e-6 * abs(value) < error  # true also if one of the two is nan
    if is_tiny or rounded_error >= 1e3 * size:
        return f"{write_quantity(value, unit)} +/- {write_quantity(error, unit, 2)}"
    two_digits = float(f"{error / size:.1e}")  # 0.0996 has become 0.10
    decimals = max(1 - math.floor(math.log10(two_digits)), 0)
    rounded = round(value / size, decimals) + 0.0  # -0.0 becomes 0.0
    return f"{rounded:.{decimals}f} +/- {error / size:.{decimals}f}{write_unit(name)}"


@dataclass(frozen=True)
class HertzPrefix:
    """A decimal unit of hertz.

    Attributes
    ----------
    name : the symbol of the unit, such as "kHz".
    hertz : the unit, Hz, such as 1000.0.
    """

    name: str
    hertz: float

    @classmethod
    def for_top(cls, frequency: float) -> HertzPrefix:
        """Return the unit in which a ``frequency``, Hz, such as that of the top of bands, lies
        between 1 and 1000.

        The unit is yHz for all lower frequencies, also for zero, and YHz for all higher ones.
        """
        hertz, name = _find_multiple(frequency, "Hz")
        return cls(name, hertz)

    @classmethod
    def named(cls, name: str) -> HertzPrefix:
        """Return the unit called ``name``, such as "kHz"; raises :class:`InputError` if there is no
        such unit.
        """
        sizes = {prefix + "Hz": size for size, prefix in zip(_SIZES, _PREFIXES, strict=True)}
        if name not in tuple(sizes):  # of a file a name may be anything, also a list
            raise InputError(
                f"{name!r} is no decimal unit of hertz", mend="Use one of " + ", ".join(sizes)
            )
        return cls(name, sizes[name])


@dataclass(frozen=True)
class Units:
    """The scales of reduced units, in SI.

    Multiply a reduced quantity by the property of its name to get SI: a reduced force times
    :attr:`force` is in newtons.

    Parameters
    ----------
    length : the unit of length, m.
    stiffness : the unit of stiffness, N/m.
    mass : the unit of mass, kg.

    Raises
    ------
    InputError : a scale that is not a finite number above zero.
    """

    length: float
    stiffness: float
    mass: float

    def __post_init__(self) -> None:
        """Check that each scale is a finite number above zero, and keep it as a plain float."""
        # here alone, so that the command's help needs no numpy
        from granphon.base.validation import positive

        for name, unit in (("length", "m"), ("stiffness", "N/m"), ("mass", "kg")):
            object.__setattr__(self, name, positive(name, getattr(self, name), unit))

    @property
    def angular_frequency(self) -> float:
        """Scale of angular frequency (k/M)^(1/2), rad/s."""
        # k/M itself may be beyond the floating range where its root is not
        return math.sqrt(self.stiffness) / math.sqrt(self.mass)

    @property
    def frequency(self) -> float:
        """Frequency, Hz, that belongs to a reduced angular frequency of one: (k/M)^(1/2) / 2 pi."""
        return self.angular_frequency / (2.0 * math.pi)

    @property
    def velocity(self) -> float:
        """Scale of velocity d (k/M)^(1/2), m/s."""
        return self.length * self.angular_frequency

    @property
    def force(self) -> float:
        """Scale of force k d, N."""
        return self.stiffness * self.length

    @property
    def energy(self) -> float:
        """Scale of energy k d^2, J, and of torque, N m."""
        return self.stiffness * self.length**2

    @property
    def modulus(self) -> float:
        """Scale of modulus k / d, Pa: the scale of stress in a layer one diameter thick."""
        return self.stiffness / self.length

    def to_info(self) -> dict[str, float]:
        """Return the three scales, SI, by their names in ``Atoms.info`` and in exported files."""
        return {key: getattr(self, name) for name, key in _INFO.items()}

    @classmethod
    def from_info(cls, info: Mapping[str, Any]) -> Units:
        """Read the scales, SI, from a mapping that has the entries of :meth:`to_info`, such as the
        ``info`` of Atoms that :func:`~granphon.atoms` made.

        Raises :class:`InputError` if a scale is missing, or is not a finite number above zero.
        """
        missing = [key for key in _INFO.values() if key not in info]
        if missing:
            problem = f"the scales {', '.join(missing)} are missing"
            mend = "Make the object with granphon, or add the missing entries"
            raise InputError(problem, "Objects in reduced units carry their scales with them", mend)
        return cls(**{name: info[key] for name, key in _INFO.items()})


@dataclass(frozen=True)
class WidthUnits:
    """Reduced units of balls that differ: the width W of the diameters, and the force of equal
    balls at an overlap of W. They are those of Section IV of Velicky and Caroli, Phys. Rev. E 65,
    021307 (2002); there d is the mean diameter, and a the spacing of the balls.

    ``coefficient`` is c of Hertz's law, N/m^(3/2), and ``width`` is W, m, both finite and above
    zero. Multiply a number in these units by the property of its name to get SI. Powers of W are
    taken from mantissas and exponents apart: a power may be beyond the floating range where its
    unit, or a number in that unit, is not. A unit below the range is the nearest float, zero at
    last; a unit above the range raises :class:`InputError`.
    """

    coefficient: float
    width: float

    @property
    def energy(self) -> float:
        """Unit of energy c W^(5/2), J."""
        return self._value(5)

    @property
    def force(self) -> float:
        """Unit of force c W^(3/2), N."""
        return self._value(3)

    @property
    def stiffness(self) -> float:
        """Unit of stiffness c W^(1/2), N/m."""
        return self._value(1)

    @property
    def stiffness_slope(self) -> float:
        """Unit of the derivative of stiffness by overlap, c W^(-1/2), N/m^2."""
        return self._value(-1)

    def _split(self, n: int) -> tuple[float, int]:
        """Return c W^(n/2) as the number m, of the order of one, and the exponent e of m 2^e: both
        are in the floating range, where the product may not be.
        """
        root_mantissa, root_exponent = math.frexp(math.sqrt(self.width))
        mantissa, exponent = math.frexp(self.coefficient)
        return mantissa * root_mantissa**n, exponent + n * root_exponent

    def _value(self, n: int) -> float:
        """Return the unit c W^(n/2) in SI; :class:`InputError` if the unit is above the floating
        range.
        """
        mantissa, exponent = self._split(n)
        try:
            return math.ldexp(mantissa, exponent)
        except OverflowError:
            problem = f"a width of {self.width:g} m is beyond double precision"
            why = f"c W^({n}/2) is above the largest number, at c = {self.coefficient:g} N/m^(3/2)"
            mend = "Give a smaller width" if n > 0 else "Give a larger width"
            raise InputError(problem, why, mend) from None

    def reduced_force(self, force: Any) -> Any:
        """Return the reduced force f* of Section IV; ``force`` in N, a number or an array."""
        from numpy import ldexp  # here alone, so that the command's help needs no numpy

        mantissa, exponent = self._split(3)
        return ldexp(force / mantissa, -exponent)

    def reduced_overlap(self, overlap: Any) -> Any:
        """Reduced overlap y = (d - a)/W; ``overlap`` in m, a number or an array."""
        return overlap / self.width

    def reduced_spacing(self, overlap: Any) -> Any:
        """Reduced spacing a* = (d + W/2 - a)/W of Section IV; ``overlap`` in m, a number or an
        array.
        """
        return overlap / self.width + 0.5


def file_header(unit: HertzPrefix, scales: Units, coordinates: Sequence[str]) -> list[str]:
    """Return the lines of the block ``granphon`` at the head of files for phonopy, YAML without
    line feeds: the ``unit`` of frequency, the names of the ``coordinates`` of a ball, and the
    ``scales`` in SI.
    """
    return [
        "granphon:",
        f"  schema: {_HEADER_SCHEMA}",
        f"  frequency_unit: {unit.name}",
        f"  hertz: {write_float(unit.hertz)}",
        f"  coordinates: [{', '.join(coordinates)}]",
        *(f"  {key}: {write_float(value)}" for key, value in scales.to_info().items()),
    ]


def read_header(path: object, block: Mapping[str, Any]) -> tuple[float, Units]:
    """Return the size of the unit of frequency, Hz, and the scales from the ``block`` of the file
    ``path`` that :func:`file_header` made.

    Raises :class:`~granphon.base.errors.SchemaError` for another schema,
    :class:`~granphon.base.errors.InputError` for a frequency unit or scales that are missing or not
    valid, but KeyError if the schema, the name of the unit or its size is missing.
    """
    require_schema(path, block["schema"], _HEADER_SCHEMA)
    hertz = HertzPrefix.named(block["frequency_unit"]).hertz
    scales = Units.from_info(block)
    if block["hertz"] != hertz:
        raise InputError(f"hertz is not the size of the frequency_unit, {hertz:g}")
    return hertz, scales
