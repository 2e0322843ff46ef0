"""The scales that tie reduced units to SI.

Inside, granphon measures length in the mean diameter d, stiffness in the normal contact stiffness k and
mass in the ball's mass M. A frozen :class:`Units` carries the three scales; it travels with every object
in reduced units, and is the only place where numbers change units.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

from granphon.errors import InputError, message

__all__ = ["HertzPrefix", "Units"]

#: names under which the scales are stored in ``Atoms.info`` and in exported files
_INFO = {
    "length": "granphon_length_m",
    "stiffness": "granphon_stiffness_N_per_m",
    "mass": "granphon_mass_kg",
}

_PREFIXES = (
    (1e-24, "yHz"), (1e-21, "zHz"), (1e-18, "aHz"), (1e-15, "fHz"), (1e-12, "pHz"), (1e-9, "nHz"),
    (1e-6, "uHz"), (1e-3, "mHz"), (1.0, "Hz"), (1e3, "kHz"), (1e6, "MHz"), (1e9, "GHz"), (1e12, "THz"),
    (1e15, "PHz"), (1e18, "EHz"), (1e21, "ZHz"), (1e24, "YHz"),
)  # fmt: skip


@dataclass(frozen=True)
class HertzPrefix:
    """A decimal unit of hertz: its ``name`` ("kHz") and its ``hertz`` (1000.0)."""

    name: str
    hertz: float

    @classmethod
    def for_top(cls, frequency: float) -> HertzPrefix:
        """The unit in which ``frequency`` (Hz) lies between 1 and 1000.

        Beyond yHz and YHz the nearest of the two is taken.
        """
        best = _PREFIXES[0]
        for hertz, name in _PREFIXES:
            if frequency >= hertz:
                best = (hertz, name)
        return cls(name=best[1], hertz=best[0])

    @classmethod
    def named(cls, name: str) -> HertzPrefix:
        """The unit called ``name``; :class:`InputError` if there is none."""
        for hertz, known in _PREFIXES:
            if known == name:
                return cls(name=known, hertz=hertz)
        raise InputError(
            message(f"{name!r} is no decimal unit of hertz", mend="Use one of " + ", ".join(p[1] for p in _PREFIXES))
        )


@dataclass(frozen=True)
class Units:
    """The scales of reduced units, in SI: ``length`` (m), ``stiffness`` (N/m), ``mass`` (kg).

    A quantity in reduced units times the property of its name is the quantity in SI.
    """

    length: float
    stiffness: float
    mass: float

    @property
    def angular_frequency(self) -> float:
        """(k/M)^(1/2), rad/s."""
        # the quotient is taken after the roots, so that it neither overflows nor underflows
        return math.sqrt(self.stiffness) / math.sqrt(self.mass)

    @property
    def frequency(self) -> float:
        """(k/M)^(1/2) / 2 pi, Hz: what a reduced angular frequency of one is in hertz."""
        return self.angular_frequency / (2.0 * math.pi)

    @property
    def velocity(self) -> float:
        """d (k/M)^(1/2), m/s."""
        return self.length * self.angular_frequency

    @property
    def force(self) -> float:
        """k d, N."""
        return self.stiffness * self.length

    @property
    def energy(self) -> float:
        """k d^2, J (also the unit of torque, N m)."""
        return self.stiffness * self.length**2

    @property
    def modulus(self) -> float:
        """k / d, Pa: the unit of stress in a layer one diameter thick."""
        return self.stiffness / self.length

    def to_info(self) -> dict[str, float]:
        """The scales under the names they have in ``Atoms.info`` and in exported files."""
        return {key: float(getattr(self, name)) for name, key in _INFO.items()}

    @classmethod
    def from_info(cls, info: Mapping[str, Any]) -> Units:
        """Read the scales back; :class:`InputError` if they are not all there."""
        missing = [key for key in _INFO.values() if key not in info]
        if missing:
            raise InputError(
                message(
                    f"the scales {', '.join(missing)} are missing",
                    "Objects in reduced units carry their scales with them",
                    "Make the object with granphon, or add the missing entries",
                )
            )
        return cls(**{name: float(info[key]) for name, key in _INFO.items()})
