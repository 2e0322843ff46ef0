"""The media by name: what scenes, sweeps and fits choose from."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

from granphon.errors import InputError, message
from granphon.medium import AveragedForce, AveragedLattice, EffectiveMedium
from granphon.packing import Packing

__all__ = ["MEDIA", "MediumChoice"]

#: the rungs of the ladder by the names that scenes and sweeps use
MEDIA: Mapping[str, type[AveragedLattice | AveragedForce | EffectiveMedium]] = {
    medium.name: medium for medium in (AveragedLattice, AveragedForce, EffectiveMedium)
}


@dataclass(frozen=True)
class MediumChoice:
    """A medium by its name, with the options of its class, for a packing to be given later.

    :class:`~granphon.errors.InputError` for a name that is not in :data:`MEDIA`, or an option that it does not have.
    """

    name: str
    options: tuple[tuple[str, str], ...] = ()

    def __post_init__(self) -> None:
        if self.name not in MEDIA:
            raise InputError(message(f"unknown medium {self.name!r}", mend="Use " + ", ".join(MEDIA)))
        known = MEDIA[self.name].options
        for option, value in self.options:
            if option not in known:
                mend = "It has " + (", ".join(known) or "none")
                raise InputError(message(f"medium {self.name!r} has no option {option!r}", mend=mend))
            if value not in known[option]:
                raise InputError(message(f"{option} is {value!r}", mend="Use " + " or ".join(known[option])))
        # two choices are equal if they mean the same: a default is not kept
        kept = tuple((option, value) for option, value in sorted(self.options) if value != known[option][0])
        object.__setattr__(self, "options", kept)

    @classmethod
    def parse(cls, value: str | Mapping[str, Mapping[str, Any] | None] | MediumChoice) -> MediumChoice:
        """From "ema", or {"ema": {"local_field": "paper"}}."""
        if isinstance(value, MediumChoice):
            return value
        if isinstance(value, Mapping) and len(value) == 1:
            name, options = next(iter(value.items()))
            if options is None or isinstance(options, Mapping):
                return cls(name, tuple((options or {}).items()))
        if isinstance(value, str):
            return cls(value)
        raise InputError(message(f"medium is {value!r}", mend="Give a name, or a name and its options"))

    @property
    def label(self) -> str:
        """The name, with the options in brackets."""
        options = ", ".join(f"{option}={value}" for option, value in self.options)
        return f"{self.name}({options})" if options else self.name

    def of(self, packing: Packing) -> AveragedLattice | AveragedForce | EffectiveMedium:
        """The medium of this packing."""
        options: Any = dict(self.options)
        return MEDIA[self.name](packing, **options)
