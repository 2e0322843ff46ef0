"""Settings of waves: the blocks ``spectrum`` and ``pulse`` of a scene, of a simulated array,
``surface``, of an edge, and ``response`` and ``motion``, of the network of any state, with what
drives balls: impacts, shakers, forces over time.
"""

from __future__ import annotations

import math
import re
from collections.abc import Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any, ClassVar

import numpy as np

from granphon.balls.layers import EDGES, read_axis
from granphon.base.arrays import Array, Index
from granphon.base.errors import InputError, Refused
from granphon.base.quantities import (
    FREQUENCY,
    LENGTH,
    NUMBER,
    PUSH,
    SINCE,
    TIME,
    VELOCITY,
    WAY,
    Quantity,
)
from granphon.base.tables import Table
from granphon.base.text import show
from granphon.base.validation import (
    Rule,
    above_zero,
    block,
    choice,
    each,
    finite_list,
    fraction,
    frequencies,
    number,
    real_number,
    require,
    whole,
    zero_or_above,
)
from granphon.dynamics.damping import read_loss
from granphon.networks.network import ContactNetwork

#: results of the waves in a simulated array
WAVES = ("dos", "spectrum", "pulse")
#: polarisations of the waves of a spectrum
POLARISATIONS = ("longitudinal", "transverse", "rotational")
#: Chebyshev moments of a spectrum, if none are given: a resolution of 0.6 % of the top frequency
MOMENTS = 256
#: times of a motion that are kept, the start and the end among them, if no number is given
FRAMES = 201
#: readings of the signal of a pulse in a period of its burst
READINGS = 24
#: the two ends of a network
ENDS = ("free", "walls", "periodic")
#: directions of contacts in a motion, and schemes of its steps
GEOMETRIES = ("lattice", "exact")
SCHEMES = ("verlet", "midpoint")
_PUSHES = ("longitudinal", "transverse", "out_of_plane")
_SOURCES = ("plane", "ball")
#: quantities of a response, and the names of such responses
RESPONSES = {
    "displacement": "receptance",
    "velocity": "mobility",
    "transmissibility": "transmissibility",
}
_QUANTITIES: dict[str, Quantity] = {
    "resolution": FREQUENCY,
    "frequency": FREQUENCY,
    "distance": LENGTH,
    "damping": TIME,
    "duration": TIME,
    "step": TIME,
}
#: the faces of an array
FACES = ("lower", "upper")
#: kinds of drives of balls
DRIVES = ("impact", "shaker", "force", "displacement")


class _Block:
    """A block of a scene, whose values are checked when it is made."""

    block: ClassVar[str]

    def __post_init__(self) -> None:
        for name, rule in wave_rules(self.block, read=False).items():
            value = getattr(self, name)
            if value is not None:
                object.__setattr__(self, name, require(f"{self.block}.{name}", rule, value))


@dataclass(frozen=True)
class SpectrumSettings(_Block):
    """Spectral functions along the path of the bands.

    Attributes
    ----------
    polarisation : "longitudinal", "transverse", "rotational", one or more.
    resolution : standard deviation of the kernel, Hz; None for that of :data:`MOMENTS`, 0.6 % of
        the top frequency.
    points : wave vectors between two corners of the path, both counted.
    """

    block = "spectrum"

    polarisation: tuple[str, ...] = ("longitudinal",)
    resolution: float | None = None
    points: int = 21


@dataclass(frozen=True)
class PulseSettings(_Block):
    """A pulse through the array; see :meth:`granphon.waves.waves.Waves.transmit`.

    Attributes
    ----------
    frequency : Hz.
    distance : m; None for half the length of the array along the direction, a quarter where ends
        are periodic.
    cycles : periods of the burst.
    polarisation : "longitudinal", "transverse" or "out_of_plane".
    source : "plane" or "ball".
    ends : "free", "walls" or "periodic".
    damping : viscosity of a contact over its stiffness, s.
    """

    block = "pulse"

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

    block = "surface"

    axis: Any
    edge: str = "free"
    points: int = 31


@dataclass(frozen=True)
class BandsSettings(_Block):
    """How contacts damp the branches of bands; see :meth:`granphon.Phonons.damped`.

    Attributes
    ----------
    damping : s, of all motions of a contact, or of normal and of other motion.
    loss_factor : likewise.
    """

    block = "bands"

    damping: float | tuple[float, float] = 0.0
    loss_factor: float | tuple[float, float] = 0.0


@dataclass(frozen=True, kw_only=True)
class NetworkSettings(_Block):
    """Settings of a result for the network of each state, or of each sample of a simulation.

    Attributes
    ----------
    repeat : cells along each period of the network; empty for one.
    cut : axis, number of layers, and (lower, upper) edge of each cut of that network, in turn.
    """

    #: keys whose values a network may not have
    of_network: ClassVar[tuple[str, ...]] = ("repeat", "cut")

    repeat: tuple[int, ...] = ()
    cut: tuple[tuple[Any, int, tuple[str, str]], ...] = ()

    def count(self, number: int) -> int:
        """Return the number of balls, or of cells, of a network once it is repeated and cut;
        ``number`` is the number in the network as it is.
        """
        n_layers = math.prod(layers for _, layers, _ in self.cut)
        return number * math.prod(self.repeat) * n_layers

    def shape(self, network: Any) -> Any:
        """Return a network repeated and cut."""
        if self.repeat:
            network = network.repeat(self.repeat)
        for axis, layers, edges in self.cut:
            # a tuple has Miller indices, which a network takes as a list
            network = network.cut(list(axis) if isinstance(axis, tuple) else axis, layers, edges)
        return network

    @property
    def coordinates(self) -> dict[str, tuple[tuple[Any, ...], str]]:
        """Values and unit of each dimension of what is found, by name."""
        raise NotImplementedError


@dataclass(frozen=True)
class ResponseSettings(NetworkSettings):
    """The response at given frequencies; see :meth:`granphon.waves.waves.Waves.response`.

    Attributes
    ----------
    frequencies : (n_f,) Hz, ascending.
    source, receiver : "plane", or a ball and a direction, such as "12 x" or "12 0.6 0.8", one or
        more. What is heard on a plane is the mean over its balls.
    damping : s, of all motions of a contact, or of normal and of other motion.
    loss_factor : likewise.
    quantity : "displacement", "velocity" or "transmissibility".
    direction : across planes; None for the first axis along which the network does not repeat, or
        x.
    polarisation : "longitudinal", "transverse" or "out_of_plane".
    distance : m, of the receiving plane from the first; None for the last.
    """

    block = "response"
    of_network = ("repeat", "cut", "source", "receiver")

    frequencies: tuple[float, ...]
    source: tuple[str, ...]
    receiver: tuple[str, ...]
    damping: float | tuple[float, float] = 0.0
    loss_factor: float | tuple[float, float] = 0.0
    quantity: str = "displacement"
    direction: tuple[float, ...] | None = None
    polarisation: str = "longitudinal"
    distance: float | None = None

    @property
    def coordinates(self) -> dict[str, tuple[tuple[Any, ...], str]]:
        """Values and unit of each dimension of what is found, by name."""
        return {
            "response_frequency": (self.frequencies, FREQUENCY.unit),
            "receiver": (self.receiver, ""),
        }


@dataclass(frozen=True)
class Signal:
    """A quantity over time, linear between the ``times`` and constant before and after them.

    Attributes
    ----------
    times : s, ascending.
    values : a displacement, m, or a force, N, at each of them.
    """

    times: tuple[float, ...]
    values: tuple[float, ...]

    def __post_init__(self) -> None:
        """Raise :class:`Refused` unless each time has a value, and times begin at 0 s or later and
        ascend.
        """
        object.__setattr__(self, "times", finite_list("times", self.times, "s"))
        object.__setattr__(self, "values", finite_list("values", self.values, ""))
        if len(self.times) != len(self.values) or len(self.times) < 2:
            fault = f"{len(self.times)} times and {len(self.values)} values"
            raise Refused(fault, "two or more times, each with a value")
        # the first time is before 0 s, or a time is not after the time before
        is_early = np.diff(self.times, prepend=-math.inf) <= 0.0
        is_early[0] = self.times[0] < 0.0
        if np.any(is_early):
            row = int(np.argmax(is_early))
            raise Refused(
                f"the time {self.times[row]:g} s in row {row + 1}",
                "times from 0 s on, each after the one before",
            )

    def __call__(self, time: float) -> float:
        """Return the value at a time, s."""
        return float(np.interp(time, self.times, self.values))

    def lost(self, step: float, end: float) -> float:
        """Return the share of the area under the signal up to ``end``, s, that values at each
        ``step``, s, do not show: the area between the signal and the line through these values.
        """
        # of all samples, those beside the times of the signal: elsewhere the signal is straight
        step_numbers = np.floor(np.divide(self.times, step))
        sample_times = step * np.union1d(step_numbers, step_numbers + 1.0)
        times = np.union1d([*self.times, end], sample_times)
        signal = np.interp(times, self.times, self.values)
        samples = np.interp(sample_times, self.times, self.values)
        differences = signal - np.interp(times, sample_times, samples)
        # twice the areas, by the rule of trapezoids
        intervals = np.diff(times)
        difference_area = float(intervals @ np.abs(differences[1:] + differences[:-1]))
        signal_area = float(intervals @ np.abs(signal[1:] + signal[:-1]))
        return difference_area / signal_area if signal_area else 0.0


@dataclass(frozen=True)
class Shaker:
    """A displacement A r(t) sin(2 pi f t), whose factor r rises from 0 to 1 as half a cosine over
    the first periods.

    Attributes
    ----------
    amplitude : A, m.
    frequency : f, Hz.
    ramp : number of periods over which r rises.
    """

    amplitude: float
    frequency: float
    ramp: float = 5.0

    def __call__(self, time: float) -> float:
        """Return the displacement at a time, s; m."""
        turns = self.frequency * time
        rise = 0.5 - 0.5 * np.cos(np.pi * turns / self.ramp) if turns < self.ramp else 1.0
        return float(self.amplitude * rise * np.sin(2.0 * np.pi * turns))


@dataclass(frozen=True)
class DriveSettings:
    """A drive of some balls along a direction, of one of four kinds.

    Attributes
    ----------
    balls : numbers of the balls; or "lower" or "upper": the floor at this face of the array, its
        clamped balls, or its outer layer.
    direction : Cartesian; None for x.
    impact : velocity at the start, m/s.
    shaker : :class:`Shaker`.
    force, displacement : :class:`Signal` of the force on each ball, N, or of the displacement, m.
    """

    balls: tuple[int, ...] | str
    direction: tuple[float, ...] | None = None
    impact: float | None = None
    shaker: Shaker | None = None
    force: Signal | None = None
    displacement: Signal | None = None

    @property
    def kind(self) -> str:
        """Which of the four kinds the drive is."""
        return next(name for name in DRIVES if getattr(self, name) is not None)

    def find_balls(self, network: ContactNetwork) -> Index:
        """Return the numbers (n,) of the balls, or of the floor; raises :class:`InputError` where
        the network has no such face.
        """
        if not isinstance(self.balls, str):
            return np.array(self.balls, np.intp)
        axis = int(np.sum(network.pbc))  # the first axis across the periods
        if axis >= network.dimension:
            fault = f"the array has no {self.balls} face"
            raise InputError(
                fault,
                "It repeats along all its axes",
                "Cut it (motion.cut), or give numbers of balls",
            )
        sign = -1.0 if self.balls == FACES[0] else 1.0
        return _find_face(network, sign * network.positions[:, axis])


def _find_face(network: ContactNetwork, heights: Array) -> Index:
    """Return the numbers of the bodies at the face of greatest height: of the floor, or else of the
    clamped balls, or else of the balls of the outer layer.

    ``heights`` (n,), m, are those of the balls and walls, from one face to the other.
    """
    is_ball = np.isfinite(network.radii)
    top = float(np.max(heights[is_ball]))
    floor = np.flatnonzero(~is_ball & (heights > top))
    if floor.size:
        return floor
    mean_radius = float(np.mean(network.radii[is_ball]))
    is_outer = is_ball & (heights > top - 0.5 * mean_radius)
    if np.any(network.moving[is_outer]):
        return np.flatnonzero(is_outer)
    # clamped balls move as a whole, however many layers they are
    middle = 0.5 * (top + float(np.min(heights[is_ball])))
    is_clamped = is_ball & ~network.moving & (heights > middle)
    return np.flatnonzero(is_clamped)


@dataclass(frozen=True)
class MotionSettings(NetworkSettings):
    """Balls that move by the whole of their contact law; see :class:`granphon.NonlinearWaves`.

    Attributes
    ----------
    duration : s.
    drive : one or more :class:`~granphon.waves.settings.DriveSettings`.
    friction_coefficient : of Coulomb's limit; None: contacts do not slide.
    damping : viscosity of contacts over their stiffness, s; or that of normal and of other motion.
    frames : number of times that are kept.
    step : s; None for one that the stiffest contact allows.
    geometry : "lattice" or "exact", the directions of contacts.
    scheme : "verlet" or "midpoint", of the steps.
    """

    block = "motion"
    of_network = ("repeat", "cut", "drive")

    duration: float
    drive: tuple[DriveSettings, ...]
    friction_coefficient: float | None = None
    damping: float | tuple[float, float] = 0.0
    frames: int = FRAMES
    step: float | None = None
    geometry: Any = "lattice"
    scheme: Any = "verlet"

    @property
    def coordinates(self) -> dict[str, tuple[tuple[Any, ...], str]]:
        """Values and unit of each dimension of what is found, by name."""
        times = self.duration / (self.frames - 1) * np.arange(self.frames)
        return {"motion_time": (tuple(times.tolist()), TIME.unit)}


#: the blocks about the network of a state, by the word with which a scene observes them
NETWORK_BLOCKS: dict[str, type[NetworkSettings]] = {
    "response": ResponseSettings,
    "motion": MotionSettings,
}


@dataclass(frozen=True)
class WaveSettings:
    """Settings of the waves in each sample of a simulation, and in the networks of any states;
    plain data.

    Attributes
    ----------
    dos : whether the density of states is requested.
    spectrum : the spectral functions along a path; None for none.
    path, labels : pieces of that path, corners in fractions of the reciprocal cell, and a label for
        each corner.
    pulse : a pulse; None for none.
    direction : of the pulse, Cartesian, (p,); None for x.
    of_networks : settings for the network of each state.
    """

    dos: bool = False
    spectrum: SpectrumSettings | None = None
    path: tuple[Any, ...] = ()
    labels: tuple[str, ...] = ()
    pulse: PulseSettings | None = None
    direction: tuple[Any, ...] | None = None
    of_networks: tuple[NetworkSettings, ...] = ()

    @property
    def names(self) -> tuple[str, ...]:
        """Those of "dos", "spectrum" and "pulse" that are requested."""
        return tuple(name for name in WAVES if getattr(self, name) not in (None, False))


def wave_rules(block: str, read: bool = True) -> dict[str, Rule]:
    """Return the rules of a ``block`` about waves, by key: of texts with units as in a file
    (``read``), or of numbers in SI units.
    """
    quantity = partial(_find_rule, read=read)
    loss_factor = partial(read_loss, "loss_factor", rule=zero_or_above)
    losses: dict[str, Rule] = {
        "damping": partial(_read_for_motions, rule=quantity("damping")),
        "loss_factor": partial(_read_for_motions, rule=loss_factor),
    }
    rules: dict[str, dict[str, Rule]] = {
        "surface": {
            "axis": read_axis,
            "edge": partial(choice, options=EDGES),
            "points": partial(whole, low=2, high=10_000),
        },
        "spectrum": {
            "polarisation": _read_polarisations,
            "resolution": quantity("resolution"),
            "points": partial(whole, low=2, high=10_000),
        },
        "bands": losses,
        "response": {
            **losses,
            "frequencies": lambda value: tuple(frequencies(value).tolist()),
            "source": _read_places,
            "receiver": _read_places,
            "quantity": partial(choice, options=tuple(RESPONSES)),
            "direction": read_direction,
            "polarisation": partial(choice, options=_PUSHES),
            "distance": quantity("distance"),
        },
        "motion": {
            "duration": quantity("duration"),
            "drive": partial(read_drives, read=read),
            "friction_coefficient": zero_or_above,
            "damping": losses["damping"],
            "frames": partial(whole, low=2, high=1_000_000),
            "step": quantity("step"),
            "geometry": partial(choice, options=GEOMETRIES),
            "scheme": partial(choice, options=SCHEMES),
        },
        "pulse": {
            "frequency": quantity("frequency"),
            "distance": quantity("distance"),
            "cycles": partial(number, low=1.0, high=1e4),
            "polarisation": partial(choice, options=_PUSHES),
            "source": partial(choice, options=_SOURCES),
            "ends": partial(choice, options=ENDS),
            "damping": quantity("damping"),
        },
    }
    return rules[block]


def _find_rule(name: str, read: bool) -> Rule:
    """Return the rule of the quantity of this ``name``, in a file (``read``) or in SI."""
    kind = _QUANTITIES[name]
    if name != "damping":
        return _make_rule(kind, read)
    # a damping is a time, or zero without a unit
    rule = _read_time if read else partial(zero_or_above, unit=kind.unit)
    return partial(read_loss, name, rule=rule)


def _read_time(value: Any) -> float:
    """Read a time, zero or above; zero may be without a unit."""
    is_zero = value == 0 and not isinstance(value, bool)
    return 0.0 if is_zero else SINCE.read(value)


def _read_polarisations(value: Any) -> tuple[str, ...]:
    """Return polarisations, read from one or from a list; raise :class:`Refused` for one that is
    given twice.
    """
    rule = partial(choice, options=POLARISATIONS)
    if not isinstance(value, list | tuple):
        return (rule(value),)
    names: tuple[str, ...] = each(value, rule, "polarisations")
    if len(set(names)) < len(names):
        raise Refused(show(value), f"{', '.join(POLARISATIONS)}, each once")
    return names


def _read_places(value: Any) -> tuple[str, ...]:
    """Return the places of a source or receiver, read from one or from a list: texts "plane", or a
    ball and its direction, such as "12 x"; raise :class:`Refused` for one that is given twice.
    """
    if not isinstance(value, list | tuple):
        return (_read_place(value),)
    places: tuple[str, ...] = each(value, _read_place, "places")
    if len(set(places)) < len(places):
        raise Refused(show(value), "each place once")
    return places


def _read_place(value: Any) -> str:
    """Return one place of a source or receiver, with single spaces between its words."""
    words = value.split() if isinstance(value, str) else []
    if words == ["plane"]:
        return "plane"
    if len(words) > 1 and words[0].isdecimal():
        direction = words[1:]
        is_axis = len(direction) == 1 and direction[0] in ("x", "y", "z")
        if is_axis or _is_vector(direction):
            return " ".join(words)
    raise Refused(
        show(value),
        "plane, or the number of a ball and its direction, such as 12 x or 12 0.6 0.8, or a"
        " list of these",
    )


def find_place(text: str) -> Any:
    """Return the place of a source or receiver that a ``text`` of a scene names, as an argument of
    ``Waves.response``: "plane", or (ball, direction).
    """
    ball, *direction = text.split()
    if not direction:
        return text
    if direction[0] in "xyz":
        return int(ball), direction[0]
    return int(ball), [float(component) for component in direction]


def _is_vector(words: list[Any]) -> bool:
    """Return whether ``words`` are one to three finite numbers, not all zero."""
    components: list[Any] = []
    for word in words:
        is_number = isinstance(word, str) and re.fullmatch(NUMBER, word)
        components.append(float(word) if is_number else word)
    if not 1 <= len(components) <= 3 or not any(components):
        return False
    return all(math.isfinite(real_number(component)) for component in components)


def _read_for_motions(value: Any, rule: Rule) -> Any:
    """Return what the ``rule`` reads for all motions of a contact, or, from a list of two, for
    normal motion and for all other.
    """
    if isinstance(value, list | tuple):
        if len(value) != 2:
            raise Refused(show(value), "one value, or two: of normal motion, and of all other")
        return each(value, rule, "values")
    return rule(value)


def write_setting(name: str, value: Any) -> Any:
    """Return a value of one of the blocks as a scene file holds it, in SI units."""
    if isinstance(value, tuple):
        return [write_setting(name, entry) for entry in value]
    if name in _QUANTITIES and value:
        return _QUANTITIES[name].write(value)
    return value


# -- drives, as they are read and written ----------------------------------------------------------


def _make_rule(kind: Quantity, read: bool) -> Rule:
    """Return the rule of a quantity in a file (``read``), or in SI."""
    if read:
        return kind.read
    if kind.least == "any":
        return partial(number, low=-1e300, high=1e300)  # any finite number
    rule = above_zero if kind.least == "above zero" else zero_or_above
    return partial(rule, unit=kind.unit)


def read_drives(value: Any, read: bool = True, folder: Path = Path()) -> tuple[DriveSettings, ...]:
    """Read a drive or a list of them: of a file (``read``), whose tables lie in ``folder``, or in
    numbers in SI.
    """
    rule = partial(_read_drive, read=read, folder=folder)
    return each(value, rule, "drives") if isinstance(value, list | tuple) else (rule(value),)


def _read_drive(value: Any, read: bool, folder: Path) -> DriveSettings:
    """Return one drive, read from settings or from a block of a scene; see :func:`read_drives`."""
    if isinstance(value, DriveSettings):
        drive_block: Any = {name: field for name, field in vars(value).items() if field is not None}
    else:
        drive_block = value
    read_signal = partial(_read_signal, read=read, folder=folder)
    rules: dict[str, Rule] = {
        "balls": _read_balls,
        "direction": read_direction,
        "impact": _make_rule(VELOCITY, read),
        "shaker": partial(_read_shaker, read=read),
        "force": partial(read_signal, name="force", kind=PUSH),
        "displacement": partial(read_signal, name="displacement", kind=WAY),
    }
    kinds = []
    if isinstance(drive_block, dict):
        kinds = [name for name in DRIVES if name in drive_block]
    if len(kinds) > 1:
        raise Refused(" and ".join(kinds), f"exactly one of {', '.join(DRIVES)}")
    fields = block(drive_block, rules, ("balls",))
    if not kinds:
        raise Refused("balls alone", f"exactly one of {', '.join(DRIVES)}")
    return DriveSettings(**fields)


def read_direction(value: Any) -> tuple[float, ...]:
    """Return the one to three components of a Cartesian vector, read from a list of numbers or
    fractions, or from a text of these.
    """
    words: Any = value.split() if isinstance(value, str) else value
    if not isinstance(words, list | tuple):
        words = [words]
    components = each(words, partial(fraction, largest=1e3), "numbers")
    if len(components) > 3 or not any(components):
        raise Refused(show(value), "one to three numbers, not all zero, such as 0 1")
    return components


def _list_words(value: Any) -> Any:
    """Return the entries of a text, with whole numbers as such, or of a list; else one entry."""
    if isinstance(value, str):
        return [int(word) if word.isdecimal() else word for word in value.split()]
    return value if isinstance(value, list | tuple) else [value]


def _read_balls(value: Any) -> tuple[int, ...] | str:
    """Return the word of a face, or numbers of balls; raise :class:`Refused` for a ball that is
    given twice.
    """
    if isinstance(value, str) and not value[:1].isdecimal():
        return choice(value, FACES)
    rule = partial(whole, low=0, high=100_000_000)
    balls = each(_list_words(value), rule, "numbers of balls")
    if len(set(balls)) < len(balls):
        raise Refused(show(value), "each ball once")
    return balls


def _read_shaker(value: Any, read: bool) -> Shaker:
    """Return a shaker, read from one or from a block of a file (``read``) or of numbers in SI."""
    shaker_block = vars(value) if isinstance(value, Shaker) else value
    rules: dict[str, Rule] = {
        "amplitude": _make_rule(LENGTH, read),
        "frequency": _make_rule(FREQUENCY, read),
        "ramp": partial(number, low=0.0, high=1e6),
    }
    fields = block(shaker_block, rules, ("amplitude", "frequency"))
    return Shaker(**fields)


def _read_signal(value: Any, name: str, kind: Quantity, read: bool, folder: Path) -> Signal:
    """Return the signal of a table with the columns time and ``name``, a quantity of this ``kind``:
    read from the name of a file in the ``folder``, from a block of two lists, or from a signal.
    """
    if isinstance(value, str) and read:
        return _read_table(folder, value, name, kind)
    lists = {"time": value.times, name: value.values} if isinstance(value, Signal) else value
    rules: dict[str, Rule] = {
        "time": partial(each, rule=_make_rule(SINCE, read), what="values"),
        name: partial(each, rule=_make_rule(kind, read), what="values"),
    }
    columns = block(lists, rules, ("time", name))
    return Signal(columns["time"], columns[name])


def _read_table(folder: Path, file: str, name: str, kind: Quantity) -> Signal:
    """Return the signal of the columns time and ``name``, a quantity of this ``kind``, of a table,
    a ``file`` of a ``folder``.
    """
    try:
        table = Table.read(folder / file, quoted=False)
        times = table.column("time", SINCE)
        values = table.column(name, kind)
    except Refused:  # of a value: its message names the row
        raise
    except InputError as error:  # of the file
        allowed = f"a table with the columns time and {name}"
        raise Refused(show(file), allowed, str(error)) from None
    return Signal(tuple(times.tolist()), tuple(values.tolist()))


def write_drives(drives: Sequence[DriveSettings]) -> Any:
    """Return drives as a scene file holds them, in SI units."""
    rows = [_write_drive(drive) for drive in drives]
    return rows if len(rows) > 1 else rows[0]


def _write_drive(drive: DriveSettings) -> dict[str, Any]:
    """Return the block of a drive as a scene file holds it, in SI units."""
    balls = drive.balls
    drive_block: dict[str, Any] = {"balls": balls if isinstance(balls, str) else list(balls)}
    if drive.direction is not None:
        drive_block["direction"] = list(drive.direction)
    if drive.impact is not None:
        drive_block["impact"] = VELOCITY.write(drive.impact)
    shaker = drive.shaker
    if shaker is not None:
        drive_block["shaker"] = {
            "amplitude": LENGTH.write(shaker.amplitude),
            "frequency": FREQUENCY.write(shaker.frequency),
            "ramp": shaker.ramp,
        }
    if drive.force is not None:
        drive_block["force"] = _write_signal(drive.force, "force", PUSH)
    if drive.displacement is not None:
        drive_block["displacement"] = _write_signal(drive.displacement, "displacement", WAY)
    return drive_block


def _write_signal(signal: Signal, name: str, kind: Quantity) -> dict[str, Any]:
    """Return a signal as a block of two lists, time and ``name``."""
    times = [SINCE.write(time) for time in signal.times]
    return {"time": times, name: [kind.write(value) for value in signal.values]}


def named_tables(drives: Any) -> list[str]:
    """Return the names of the files with signals in the ``drives`` of a valid scene file: one block
    or a list of blocks.
    """
    drive_blocks = drives if isinstance(drives, list) else [drives]
    names = []
    for drive_block in drive_blocks:
        for kind in ("force", "displacement"):
            signal = drive_block.get(kind)
            if isinstance(signal, str):
                names.append(signal)
    return names
