"""The media by name: what scenes, sweeps and fits choose from."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from functools import partial
from typing import Any

from granphon.blocks import Rule, block, choice, grid, inside, ruled, whole
from granphon.errors import InputError, message
from granphon.medium import AveragedForce, AveragedLattice, EffectiveMedium, Medium
from granphon.packing import Packing
from granphon.simulation import MOST_SEED, DirectSimulation

__all__ = ["MEDIA", "OPTIONS", "MediumChoice", "Option", "medium", "no_simulation"]


@dataclass(frozen=True)
class Option:
    """An option of a medium: its default, and the rule that reads its value."""

    default: Any
    rule: Rule


#: the rungs of the ladder by the names that scenes and sweeps use
MEDIA: Mapping[str, type[AveragedLattice | AveragedForce | EffectiveMedium | DirectSimulation]] = {
    rung.name: rung for rung in (AveragedLattice, AveragedForce, EffectiveMedium, DirectSimulation)
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
}


@dataclass(frozen=True)
class MediumChoice:
    """A medium by its name, with the options of its class, for a packing to be given later.

    :class:`~granphon.errors.InputError` for a name that is not in :data:`MEDIA`, an option that it does not have, or a value
    that the option does not take.
    """

    name: str
    options: tuple[tuple[str, Any], ...] = ()

    def __post_init__(self) -> None:
        name = ruled("medium", partial(choice, options=tuple(MEDIA)), self.name)
        given = ruled(f"medium.{name}", partial(_options, name), dict(self.options))
        # two choices are equal if they mean the same: a default is not kept
        kept = tuple(one for one in sorted(given.items()) if one[1] != OPTIONS[name][one[0]].default)
        object.__setattr__(self, "options", kept)

    @classmethod
    def parse(cls, value: str | Mapping[str, Mapping[str, Any] | None] | MediumChoice) -> MediumChoice:
        """From "ema", or {"ema": {"local_field": "paper"}}."""
        found: MediumChoice = ruled("medium", medium, value)
        return found

    @property
    def label(self) -> str:
        """The name, with the options in brackets."""
        options = ", ".join(f"{option}={_written(value)}" for option, value in self.options)
        return f"{self.name}({options})" if options else self.name

    @property
    def settings(self) -> dict[str, Any]:
        """Every option with its value, defaults included."""
        return {option: known.default for option, known in OPTIONS[self.name].items()} | dict(self.options)

    @property
    def simulates(self) -> bool:
        """Whether it is a :class:`~granphon.simulation.DirectSimulation`."""
        return self.name == DirectSimulation.name

    def of(self, packing: Packing) -> Medium:
        """The medium of this packing."""
        options: Any = dict(self.options)
        return MEDIA[self.name](packing, **options)


def medium(value: Any) -> MediumChoice:
    """The rule of a medium: its name, or {name: {option: value}}; see :mod:`granphon.blocks`."""
    if isinstance(value, MediumChoice):
        return value
    is_block = isinstance(value, Mapping) and len(value) == 1
    name, given = next(iter(value.items())) if is_block else (value, None)
    choice(name, tuple(MEDIA))
    options = {} if given is None else inside(name, partial(_options, name), given)
    return MediumChoice(name, tuple(options.items()))


def no_simulation(media: Iterable[MediumChoice]) -> None:
    """:class:`~granphon.errors.InputError` if one of the media is a simulation, which has no terms of finite overlap."""
    for one in media:
        if one.simulates:
            what = f"the medium {one.label!r} has no terms of finite overlap"
            why = "Its linear response is found in the limit of spread and overlap small against the diameter"
            raise InputError(message(what, why, "Leave finite_overlap out, or take another medium"))


def _options(name: str, given: Any) -> dict[str, Any]:
    return block(given, {option: known.rule for option, known in OPTIONS[name].items()})


def _written(value: Any) -> str:
    """As a scene may have it."""
    return " ".join(map(str, value)) if isinstance(value, tuple) else str(value)
