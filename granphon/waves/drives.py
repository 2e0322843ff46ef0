"""What drives balls in a scene: an impact, a shaker, a force or a displacement over time."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from granphon.base.arrays import Index
from granphon.base.errors import InputError, Refused
from granphon.base.quantities import FREQUENCY, LENGTH, PUSH, SINCE, VELOCITY, WAY, Quantity
from granphon.base.tables import Table
from granphon.base.text import show
from granphon.base.validation import Rule, above_zero, block, choice, each, fraction, number, whole, zero_or_above
from granphon.networks.network import ContactNetwork

#: the faces of an array
FACES = ("lower", "upper")
#: what may be done to balls, and in words
DRIVES = ("impact", "shaker", "force", "displacement")


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
        if len(self.times) != len(self.values) or len(self.times) < 2:
            what = f"{len(self.times)} times and {len(self.values)} values"
            raise Refused(what, "two or more times, each with a value")
        if self.times[0] < 0.0 or np.any(np.diff(self.times) <= 0.0):
            place = 0 if self.times[0] < 0.0 else int(np.argmax(np.diff(self.times) <= 0.0)) + 1
            raise Refused(
                f"the time {self.times[place]:g} s in row {place + 1}", "times from 0 s on, each after the one before"
            )

    def __call__(self, time: float) -> float:
        """Return the value at a time, s."""
        return float(np.interp(time, self.times, self.values))


@dataclass(frozen=True)
class Shaker:
    """A displacement A r(t) sin(2 pi f t), whose size r rises from 0 to 1 as half a cosine over the first periods.

    Attributes
    ----------
    amplitude : A, m.
    frequency : f, Hz.
    ramp : number of periods over which it rises.
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
    """What drives some balls, along a direction: one of four.

    Attributes
    ----------
    balls : their numbers; or "lower" or "upper": the floor at this face of the array, or its outer layer of balls.
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
        """Which of the four it is."""
        return next(name for name in DRIVES if getattr(self, name) is not None)

    def find_balls(self, network: ContactNetwork) -> Index:
        """Return the numbers of the balls, or of the floor; raises :class:`InputError` where there is no such face."""
        if not isinstance(self.balls, str):
            return np.array(self.balls, np.intp)
        axis = int(np.sum(network.pbc))
        if axis >= network.dimension:
            what = f"the array has no {self.balls} face"
            raise InputError(what, "It repeats along all its axes", "Cut it (motion.cut), or give numbers of balls")
        heights = network.positions[:, axis] * (-1.0 if self.balls == FACES[0] else 1.0)
        balls = np.isfinite(network.radii)
        top = float(np.max(heights[balls]))
        floor = np.flatnonzero(~balls & (heights > top))
        return floor if floor.size else np.flatnonzero(balls & (heights > top - 0.5 * float(np.mean(network.radii[balls]))))


# -- how they are read and written ------------------------------------------------------------------------------------


def _quantity(kind: Quantity, read: bool) -> Rule:
    if read:
        return kind.read
    if kind.least == "any":
        return partial(number, low=-1e300, high=1e300)
    return partial(above_zero if kind.least == "above zero" else zero_or_above, unit=kind.unit)


def read_drives(value: Any, read: bool = True, folder: Path = Path()) -> tuple[DriveSettings, ...]:
    """Read a drive or a list of them: of a file (``read``), whose tables lie in ``folder``, or in numbers in SI."""
    rule = partial(_read_drive, read=read, folder=folder)
    return each(value, rule, "drives") if isinstance(value, list | tuple) else (rule(value),)


def _read_drive(value: Any, read: bool, folder: Path) -> DriveSettings:
    if isinstance(value, DriveSettings):
        value = {name: one for name, one in vars(value).items() if one is not None}
    rules: dict[str, Rule] = {
        "balls": _read_balls,
        "direction": read_direction,
        "impact": _quantity(VELOCITY, read),
        "shaker": partial(_read_shaker, read=read),
        "force": partial(_read_signal, name="force", kind=PUSH, read=read, folder=folder),
        "displacement": partial(_read_signal, name="displacement", kind=WAY, read=read, folder=folder),
    }
    given = [name for name in DRIVES if isinstance(value, dict) and name in value]
    if len(given) > 1:
        raise Refused(" and ".join(given), f"exactly one of {', '.join(DRIVES)}")
    found = block(value, rules, ("balls",))
    if not given:
        raise Refused("balls alone", f"exactly one of {', '.join(DRIVES)}")
    return DriveSettings(**found)


def read_direction(value: Any) -> tuple[float, ...]:
    """Read a Cartesian vector, a list of numbers or a text of them."""
    words = value.split() if isinstance(value, str) else value if isinstance(value, list | tuple) else [value]
    found = each(words, partial(fraction, largest=1e3), "numbers")
    if len(found) > 3 or not any(found):
        raise Refused(show(value), "one to three numbers, not all zero, such as 0 1")
    return found


def _read_balls(value: Any) -> tuple[int, ...] | str:
    """Read the word of a face, or numbers of balls, each once."""
    if isinstance(value, str) and not value[:1].isdecimal():
        return choice(value, FACES)
    words = [int(one) if one.isdecimal() else one for one in value.split()] if isinstance(value, str) else value
    listed = words if isinstance(words, list | tuple) else [words]
    found = each(listed, partial(whole, low=0, high=100_000_000), "numbers of balls")
    if len(set(found)) < len(found):
        raise Refused(show(value), "each ball once")
    return found


def _read_shaker(value: Any, read: bool) -> Shaker:
    if isinstance(value, Shaker):
        value = vars(value)
    amplitude, frequency = _quantity(LENGTH, read), _quantity(FREQUENCY, read)
    rules: dict[str, Rule] = {"amplitude": amplitude, "frequency": frequency, "ramp": partial(number, low=0.0, high=1e6)}
    return Shaker(**block(value, rules, ("amplitude", "frequency")))


def _read_signal(value: Any, name: str, kind: Quantity, read: bool, folder: Path) -> Signal:
    """Read a table of the columns time and ``name``, by its name, or as a block of two lists."""
    if isinstance(value, str) and read:
        try:
            table = Table.read(folder / value, quoted=False)
            return Signal(tuple(table.column("time", SINCE).tolist()), tuple(table.column(name, kind).tolist()))
        except Refused:
            raise
        except InputError as error:
            raise Refused(show(value), f"a table with the columns time and {name}", str(error)) from None
    given = {"time": value.times, name: value.values} if isinstance(value, Signal) else value
    kinds = {"time": SINCE, name: kind}
    rules: dict[str, Rule] = {one: partial(each, rule=_quantity(of, read), what="values") for one, of in kinds.items()}
    found = block(given, rules, ("time", name))
    return Signal(found["time"], found[name])


def write_drives(drives: Sequence[DriveSettings]) -> Any:
    """Return drives as a scene file holds them, in SI units."""
    out = []
    for one in drives:
        row: dict[str, Any] = {"balls": one.balls if isinstance(one.balls, str) else list(one.balls)}
        row |= {} if one.direction is None else {"direction": list(one.direction)}
        if one.impact is not None:
            row["impact"] = VELOCITY.write(one.impact)
        if (s := one.shaker) is not None:
            row["shaker"] = {
                "amplitude": LENGTH.write(s.amplitude),
                "frequency": FREQUENCY.write(s.frequency),
                "ramp": s.ramp,
            }
        for name, kind in (("force", PUSH), ("displacement", WAY)):
            if (signal := getattr(one, name)) is not None:
                times, values = map(SINCE.write, signal.times), map(kind.write, signal.values)
                row[name] = {"time": list(times), name: list(values)}
        out.append(row)
    return out if len(out) > 1 else out[0]


def named_tables(drives: Any) -> list[str]:
    """Return the names of the tables that drives of a valid scene file take their signals from."""
    rows = drives if isinstance(drives, list) else [drives]
    return [row[name] for row in rows for name in ("force", "displacement") if isinstance(row.get(name), str)]
