"""The media by name: what scenes, sweeps and fits choose from, or have chosen for them."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, replace
from functools import cached_property, partial
from typing import Any, ClassVar

import numpy as np
from numpy.typing import ArrayLike, NDArray

from granphon.balls.distributions import PointShape
from granphon.balls.loads import Load
from granphon.balls.packing import Packing
from granphon.base.errors import InputError, message
from granphon.base.validation import Rule, block, choice, grid, number, read_inside, require, whole
from granphon.media.accuracy import accuracy
from granphon.media.cost import estimate
from granphon.media.mean_field import AveragedForce, AveragedLattice, EffectiveMedium
from granphon.media.medium import Loaded, Medium
from granphon.media.sampled_balls import MOST_SEED
from granphon.media.simulation import DirectSimulation, no_finite_overlap
from granphon.media.state import ContactState, overlap_flag

__all__ = [
    "MEDIA",
    "OPTIONS",
    "AutoMedium",
    "MediumChoice",
    "Option",
    "Rung",
    "expected_error",
    "medium",
    "no_simulation",
    "solving_time",
]

Array = NDArray[np.float64]
#: sides of the samples that are chosen among
_SIDES = (16, 24, 32, 48, 64, 96, 128, 192, 256, 384, 512, 768, 1024)
#: a rule: a relative error
relative_error: Rule = partial(number, low=1e-12, high=0.99)
#: s; about what the effective medium takes for a density of diameters
_DENSITY_TIME = 0.03
#: s; about what the effective medium takes for 64 listed diameters
_LIST_TIME = 0.25
#: openings of the pairs of 64 listed diameters
_LIST_OPENINGS = 2080.0
#: power of the openings with which the time of a list grows
_LIST_POWER = 1.25
#: s; about what a simulation takes beside the time of its balls
_SIMULATION_TIME = 0.04
#: s; about what each ball of a simulation takes
_BALL_TIME = 3e-6
#: s; what takes less is done where a scene is only looked at
_MOMENT = 0.1


@dataclass(frozen=True)
class Option:
    """An option of a medium: its default, and the rule that reads its value."""

    default: Any
    rule: Rule


@dataclass(frozen=True)
class AutoMedium(Loaded[ContactState]):
    """The cheapest medium whose expected error is within a tolerance.

    Errors are those of :mod:`granphon.media.accuracy`, relative, of velocities and frequencies at the load that is given. A
    simulation has one sample (seed 0) of as many balls as it needs, up to 1024 x 1024. ``at_*`` take scalars or arrays, and
    give the state of the one medium that serves all of these loads; :meth:`rungs` has the choice for each.

    Parameters
    ----------
    packing : the balls.
    tolerance : largest expected relative error.

    Raises
    ------
    InputError : a tolerance that is not between 1e-12 and 0.99. ``at_*`` and :meth:`rungs`: a load at which no medium is
        within the tolerance, which says what can be had; one below those that the errors are known for; a packing that they
        are not known for, another lattice or a distribution too skewed; and finite overlap, which a simulation has not.
    """

    name: ClassVar[str] = "auto"

    packing: Packing
    tolerance: float = 1e-3

    def __post_init__(self) -> None:
        if not isinstance(self.packing, Packing):
            raise InputError(message(f"packing is {self.packing!r}", mend="Give a granphon.Packing"))
        object.__setattr__(self, "tolerance", require("tolerance", relative_error, self.tolerance))

    def rungs(self, kind: str, loads: ArrayLike) -> list[Rung]:
        """The media that serve loads of a ``kind`` ("force", "pressure", "overlap"; SI), the cheapest first."""
        load = Load(kind, loads).flat
        options, errors = self._errors(load)
        first = np.argmax(errors <= self.tolerance, axis=0)
        places = [np.flatnonzero(first == i) for i in range(len(options))]
        return [
            Rung(option, place, self.packing, load[place], chosen=True)
            for option, place in zip(options, places, strict=True)
            if place.size
        ]

    def serving(self, kind: str, loads: ArrayLike) -> MediumChoice:
        """The one medium, the cheapest, that serves all loads of a ``kind``."""
        options, errors = self._errors(Load(kind, loads).flat)
        serves = np.flatnonzero(np.max(errors, axis=1) <= self.tolerance)
        # the largest simulation is better than any other medium wherever that would do
        return options[serves[0]] if serves.size else max(options, key=lambda option: option.settings.get("shape", (0,)))

    def _errors(self, load: Load) -> tuple[list[MediumChoice], Array]:
        """What is chosen among, the cheapest first, and the expected errors (n_options, n_loads): one at least serves."""
        if (why := accuracy().uncovered(self.packing)) is not None:
            raise InputError(message(f"the errors of the media are not known here: {why}", mend="Name a medium"))
        options = _options_by_cost(self.packing, load)
        errors = np.array([expected_error(option, self.packing, load) for option in options])
        best = np.min(errors, axis=0)
        if np.any(best > self.tolerance):
            worst = int(np.argmax(best))
            unmet = self._unmet(load[worst], float(best[worst]))
            unmet.load_index = worst
            raise unmet
        return options, errors

    def _unmet(self, load: Load, best: float) -> InputError:
        where = f"{load} {load.unit}"
        if np.isfinite(best):
            what = f"no medium is within {self.tolerance:g} at {where}"
            why = f"The best that can be had there is {best:.2g}, by a simulation of {_SIDES[-1]} x {_SIDES[-1]} balls"
            return InputError(message(what, why, "Raise the tolerance, or simulate more samples by hand"))
        name = "a*" if load.kind == "overlap" else "f*"
        at, least = float(accuracy().reduced(self.packing, load)), accuracy().least(load.kind)
        what = f"the errors of the media are not known at {where}, {name} = {at:.3g}"
        return InputError(message(what, f"They are from {name} = {least:g} on", "Raise the load, or name a medium"))

    def at(self, load: Load, *, finite_overlap: bool | None = None) -> ContactState:
        """State at a load, in the one medium that serves all of its values."""
        if overlap_flag(finite_overlap)[0]:
            raise no_finite_overlap(self.name)
        load = load.applied
        serving = self.serving(load.kind, load.array).of(self.packing)
        return replace(serving.at(load, finite_overlap=finite_overlap), chosen=True)


#: the rungs of the ladder by the names that scenes and sweeps use
MEDIA: Mapping[str, type[AveragedLattice | AveragedForce | EffectiveMedium | DirectSimulation | AutoMedium]] = {
    rung.name: rung for rung in (AveragedLattice, AveragedForce, EffectiveMedium, DirectSimulation, AutoMedium)
}
#: the options of each
OPTIONS: Mapping[str, Mapping[str, Option]] = {name: {} for name in MEDIA} | {
    EffectiveMedium.name: {
        option: Option(words[0], partial(choice, options=words)) for option, words in EffectiveMedium.options.items()
    },
    DirectSimulation.name: {
        "shape": Option(DirectSimulation.shape, partial(grid, low=1, high=20_000, example="128 128")),
        "seed": Option(DirectSimulation.seed, partial(whole, low=0, high=MOST_SEED)),
        "samples": Option(DirectSimulation.samples, partial(whole, low=1, high=10_000)),
    },
    AutoMedium.name: {"tolerance": Option(AutoMedium.tolerance, relative_error)},
}


@dataclass(frozen=True)
class MediumChoice:
    """A medium by its name, with the options of its class, for a packing to be given later.

    :class:`~granphon.base.errors.InputError` for a name that is not in :data:`MEDIA`, an option that it does not have, or a
    value that the option does not take.
    """

    name: str
    options: tuple[tuple[str, Any], ...] = ()

    def __post_init__(self) -> None:
        name = require("medium", partial(choice, options=tuple(MEDIA)), self.name)
        given = require(f"medium.{name}", partial(_options, name), dict(self.options))
        # two choices are equal if they mean the same: a default is not kept
        kept = tuple(one for one in sorted(given.items()) if one[1] != OPTIONS[name][one[0]].default)
        object.__setattr__(self, "options", kept)

    @classmethod
    def parse(cls, value: str | Mapping[str, Mapping[str, Any] | None] | MediumChoice) -> MediumChoice:
        """From "ema", or {"ema": {"local_field": "paper"}}."""
        found: MediumChoice = require("medium", medium, value)
        return found

    @property
    def label(self) -> str:
        """The name, with the options in brackets."""
        options = ", ".join(f"{option}={_write_option(value)}" for option, value in self.options)
        return f"{self.name}({options})" if options else self.name

    @property
    def settings(self) -> dict[str, Any]:
        """Every option with its value, defaults included."""
        return {option: known.default for option, known in OPTIONS[self.name].items()} | dict(self.options)

    @property
    def simulates(self) -> bool:
        """Whether it is a :class:`~granphon.media.simulation.DirectSimulation`."""
        return self.name == DirectSimulation.name

    @property
    def is_automatic(self) -> bool:
        """Whether it is an :class:`AutoMedium`, which leaves the choice to the load."""
        return self.name == AutoMedium.name

    def of(self, packing: Packing) -> Medium:
        """The medium of this packing."""
        options: Any = dict(self.options)
        return MEDIA[self.name](packing, **options)

    def rungs(self, packing: Packing, load: Load) -> list[Rung]:
        """What serves which values of an applied load: this medium all of them, unless it is an :class:`AutoMedium`."""
        medium = self.of(packing)
        if isinstance(medium, AutoMedium):
            return medium.rungs(load.kind, load.array)
        return [Rung(self, np.arange(load.size), packing, load)]


@dataclass(frozen=True, eq=False)
class Rung:
    """A medium that serves some of many loads: ``loads`` (n,) are their places, and ``load`` has their values.

    ``chosen``: whether the medium was chosen for its expected error, by an :class:`AutoMedium`.
    """

    medium: MediumChoice
    loads: NDArray[np.intp]
    packing: Packing
    load: Load
    chosen: bool = False

    @property
    def is_quick(self) -> bool:
        """Whether its states are found in a moment: it is no simulation, and no effective medium of a long list."""
        if self.medium.name == EffectiveMedium.name:
            return solving_time(self.packing) < _MOMENT
        return not self.medium.simulates

    @cached_property
    def errors(self) -> Array:
        """(n,) expected relative error, worked out when asked for: a scene that names its medium does not need it."""
        return expected_error(self.medium, self.packing, self.load).ravel()


def solving_time(packing: Packing) -> float:
    """About how many seconds the effective medium takes for the distribution of a packing, at any number of loads."""
    shape = packing.spread.shape if packing.spread and packing.width else None
    listed = _LIST_TIME * (shape.openings.size / _LIST_OPENINGS) ** _LIST_POWER if isinstance(shape, PointShape) else 0.0
    return max(_DENSITY_TIME, listed) if shape else 0.0


def _options_by_cost(packing: Packing, load: Load) -> list[MediumChoice]:
    """What an :class:`AutoMedium` chooses among, the cheapest at these loads first."""
    if not packing.width:
        return [MediumChoice(AveragedLattice.name)]  # exact
    media = [MediumChoice(name) for name in accuracy().media() if name != DirectSimulation.name]
    least = load[int(np.argmin(load.array))]
    simulations = [MediumChoice(DirectSimulation.name, (("shape", (side, side)),)) for side in _SIDES]

    def seconds(option: MediumChoice) -> float:
        medium = option.of(packing)
        if isinstance(medium, DirectSimulation):
            return _SIMULATION_TIME + _BALL_TIME * estimate(medium, least).work
        return solving_time(packing) if isinstance(medium, EffectiveMedium) else 0.0

    return sorted([*media, *simulations], key=seconds)


def expected_error(choice: MediumChoice, packing: Packing, load: Load) -> Array:
    """Expected relative error of a medium's velocities and frequencies, of the shape of the load; +inf if not known."""
    settings = choice.settings
    if choice.name not in accuracy().media() or settings.get("local_field") == "paper":
        return np.full(load.shape, np.inf)
    balls = int(np.prod(settings["shape"])) * settings["samples"] if choice.simulates else 1
    return accuracy().error(choice.name, packing, load, balls)


def medium(value: Any) -> MediumChoice:
    """The rule of a medium: its name, or {name: {option: value}}; see :mod:`granphon.base.validation`."""
    if isinstance(value, MediumChoice):
        return value
    is_block = isinstance(value, Mapping) and len(value) == 1
    name, given = next(iter(value.items())) if is_block else (value, None)
    choice(name, tuple(MEDIA))
    options = {} if given is None else read_inside(name, partial(_options, name), given)
    return MediumChoice(name, tuple(options.items()))


def no_simulation(media: Iterable[MediumChoice]) -> None:
    """:class:`~granphon.base.errors.InputError` if a medium is, or may be, a simulation, which has no terms of finite
    overlap.
    """
    for one in media:
        if one.simulates or one.is_automatic:
            raise no_finite_overlap(one.label)


def _options(name: str, given: Any) -> dict[str, Any]:
    return block(given, {option: known.rule for option, known in OPTIONS[name].items()})


def _write_option(value: Any) -> str:
    """As a scene may have it."""
    return " ".join(map(str, value)) if isinstance(value, tuple) else str(value)
