"""Settings of waves: the blocks ``spectrum`` and ``pulse`` of a scene, of a simulated array, and ``surface``, of an edge."""

from __future__ import annotations

from dataclasses import dataclass
from functools import partial
from typing import Any, ClassVar

from granphon.balls.layers import EDGES, read_axis
from granphon.base.errors import Refused
from granphon.base.quantities import FREQUENCY, LENGTH, TIME, Quantity
from granphon.base.text import show
from granphon.base.validation import Rule, above_zero, choice, each, number, require, whole, zero_or_above

#: what may be asked of the waves in a simulated array
WAVES = ("dos", "spectrum", "pulse")
#: polarisations of the waves of a spectrum
POLARISATIONS = ("longitudinal", "transverse", "rotational")
#: Chebyshev moments of a spectrum, if none are given: a resolution of 0.6 % of the top frequency
MOMENTS = 256
#: readings of the signal of a pulse in a period of its burst
READINGS = 24
#: what stands at the two ends of a network
ENDS = ("free", "walls", "periodic")
_PUSHES = ("longitudinal", "transverse", "out_of_plane")
_SOURCES = ("plane", "ball")
_QUANTITIES: dict[str, Quantity] = {"resolution": FREQUENCY, "frequency": FREQUENCY, "distance": LENGTH, "damping": TIME}


class _Block:
    """A block of a scene, whose values are checked when it is made."""

    _name: ClassVar[str]

    def __post_init__(self) -> None:
        for name, rule in wave_rules(self._name, read=False).items():
            if getattr(self, name) is not None:
                object.__setattr__(self, name, require(f"{self._name}.{name}", rule, getattr(self, name)))


@dataclass(frozen=True)
class SpectrumSettings(_Block):
    """Spectral functions along the path of the bands.

    Attributes
    ----------
    polarisation : "longitudinal", "transverse", "rotational", one or more.
    resolution : standard deviation of the kernel, Hz; None for a hundredth of the top frequency, about.
    points : wave vectors between two corners of the path, both counted.
    """

    _name = "spectrum"

    polarisation: tuple[str, ...] = ("longitudinal",)
    resolution: float | None = None
    points: int = 21


@dataclass(frozen=True)
class PulseSettings(_Block):
    """A pulse through the array; see :meth:`granphon.waves.waves.Waves.transmit`.

    Attributes
    ----------
    frequency : Hz.
    distance : m; None for half the length of the array along the direction, a quarter where ends are periodic.
    cycles : periods of the burst.
    polarisation : "longitudinal", "transverse" or "out_of_plane".
    source : "plane" or "ball".
    ends : "free", "walls" or "periodic".
    damping : viscosity of a contact over its stiffness, s.
    """

    _name = "pulse"

    frequency: float
    distance: float | None = None
    cycles: float = 5.0
    polarisation: str = "longitudinal"
    source: str = "plane"
    ends: str = "free"
    damping: float = 0.0


@dataclass(frozen=True)
class SurfaceSettings(_Block):
    """Waves of an edge, along the path of its own zone; see :class:`granphon.Surface`.

    Attributes
    ----------
    axis : across the edge: the number of a vector of the cell, or integer Miller indices.
    edge : "free", "clamped" or "floor".
    points : wave vectors between two corners of the path, both counted.
    """

    _name = "surface"

    axis: Any
    edge: str = "free"
    points: int = 31


@dataclass(frozen=True)
class WaveSettings:
    """What is asked of the waves in each sample of a simulation; plain data.

    Attributes
    ----------
    dos : whether the density of states is.
    spectrum : the spectral functions along a path; None for none.
    path, labels : pieces of that path, corners in fractions of the reciprocal cell, and a label for each corner.
    pulse : a pulse; None for none.
    direction : in which the pulse goes, Cartesian, (p,); None for x.
    """

    dos: bool = False
    spectrum: SpectrumSettings | None = None
    path: tuple[Any, ...] = ()
    labels: tuple[str, ...] = ()
    pulse: PulseSettings | None = None
    direction: tuple[Any, ...] | None = None

    @property
    def names(self) -> tuple[str, ...]:
        """What of "dos", "spectrum" and "pulse" is asked for."""
        return tuple(name for name in WAVES if getattr(self, name) not in (None, False))


def wave_rules(block: str, read: bool = True) -> dict[str, Rule]:
    """Return the rules of a ``block``, "spectrum", "pulse" or "surface": of a file (``read``), or of numbers in SI."""

    def quantity(name: str) -> Rule:
        kind = _QUANTITIES[name]
        if name == "damping":  # zero, without a unit, is one too
            return _read_damping if read else partial(zero_or_above, unit=kind.unit)
        return kind.read if read else partial(above_zero, unit=kind.unit)

    if block == "surface":
        return {"axis": read_axis, "edge": partial(choice, options=EDGES), "points": partial(whole, low=2, high=10_000)}
    if block == "spectrum":
        return {
            "polarisation": _read_polarisations, "resolution": quantity("resolution"),
            "points": partial(whole, low=2, high=10_000),
        }  # fmt: skip
    return {
        "frequency": quantity("frequency"), "distance": quantity("distance"), "cycles": partial(number, low=1.0, high=1e4),
        "polarisation": partial(choice, options=_PUSHES), "source": partial(choice, options=_SOURCES),
        "ends": partial(choice, options=ENDS), "damping": quantity("damping"),
    }  # fmt: skip


def _read_damping(value: Any) -> float:
    """Read a time, zero or above."""
    return 0.0 if value == 0 and not isinstance(value, bool) else TIME.read(value)


def _read_polarisations(value: Any) -> tuple[str, ...]:
    """Read one polarisation, or a list of them, each once."""
    rule = partial(choice, options=POLARISATIONS)
    found: tuple[str, ...] = each(value, rule, "polarisations") if isinstance(value, list | tuple) else (rule(value),)
    if len(set(found)) < len(found):
        raise Refused(show(value), f"{', '.join(POLARISATIONS)}, each once")
    return found


def write_setting(name: str, value: Any) -> Any:
    """Return a value of one of the blocks as a scene file holds it, in SI units."""
    return _QUANTITIES[name].write(value) if name in _QUANTITIES and value else value
