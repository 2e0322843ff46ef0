"""Cases: one medium on one packing at many loads, and all of them over media and parameters of the packing."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any

from numpy.typing import NDArray

from granphon.balls.loads import Load
from granphon.balls.packing import Packing
from granphon.balls.parameters import Axis, combine
from granphon.base.errors import InputError, message
from granphon.media.choice import MediumChoice, ServingMedium
from granphon.waves.settings import WaveSettings


@dataclass(frozen=True, eq=False)
class Asked:
    """What is asked of each state.

    Attributes
    ----------
    finite_overlap : whether terms of relative order delta/d are.
    qpoints : (s, p, 3), the path of the bands; None without bands.
    direction : that of sound, Cartesian, one or many; None for x.
    waves : what is asked of the waves in each sample of a simulation; None for nothing.
    exponents : whether those of the velocities are, for which a simulation solves two more equilibria at each load.
    sound : whether a lattice that has no velocities, a mechanism, is an error; otherwise they are left out.
    alone : whether it is the only state. The balls of its samples are kept, for files and figures of them, and messages need
        not say which state they are about.
    """

    finite_overlap: bool = False
    qpoints: NDArray[Any] | None = None
    direction: tuple[Any, ...] | None = None
    waves: WaveSettings | None = None
    exponents: bool = True
    sound: bool = True
    alone: bool = False


@dataclass(frozen=True, eq=False)
class Case:
    """One medium on one packing, at all values of an applied load, and what is asked of its states.

    ``where`` names the swept parameters of the packing with their values, in words; empty if none is swept.
    """

    where: str
    packing: Packing
    medium: MediumChoice
    load: Load
    asked: Asked = Asked()

    @property
    def label(self) -> str:
        """Medium and swept parameters in words, as messages of sweeps name them."""
        return ", ".join(filter(None, (self.medium.label, self.where)))

    @cached_property
    def serving_media(self) -> list[ServingMedium]:
        """The media that serve the loads, each with its loads: the medium itself, or those that an automatic medium chooses.

        They are found once, for all who hold the case. :class:`~granphon.base.errors.InputError` if the packing has no such
        medium, or if none can be chosen.
        """
        return self.medium.choose(self.packing, self.load)


@dataclass(frozen=True, eq=False)
class Grid:
    """Every medium at every combination of the values of the ``axes`` of a packing, under an applied load."""

    packing: Packing
    axes: Sequence[Axis]
    media: Sequence[MediumChoice]
    load: Load
    asked: Asked = Asked()

    @cached_property
    def cases(self) -> tuple[Case, ...]:
        """The cases, the media running fastest; :class:`~granphon.base.errors.InputError` for an impossible packing."""
        return tuple(
            Case(where, packing, medium, self.load, self.asked)
            for where, packing in combine(self.packing, self.axes)
            for medium in self.media
        )


def require_arrays(media: Sequence[MediumChoice], swept: Iterable[str], names: Iterable[str]) -> None:
    """Raise :class:`~granphon.base.errors.InputError` if there are no arrays for the waves ``names``.

    These are "dos", "spectrum" and "pulse" of simulated arrays themselves. ``swept`` are the parameters that are swept.
    """
    wanted = list(names)
    if without := [one for one in media if wanted and not one.simulates]:
        what = f"{wanted[0]} is asked for, and the medium {without[0].label!r} has no balls that it runs through"
        raise InputError(message(what, mend="Take medium: simulation"))
    if "spectrum" not in wanted:
        return
    if changing := [name for name in swept if name in ("lattice", "motions")]:
        what = f"the spectra of a sweep over {changing[0]} do not fit into one array"
        raise InputError(message(what, "Their wave vectors or polarisations differ", "Make a scene of each"))
    if len({one.settings.get("shape") for one in media}) > 1:
        what = "the spectra of arrays of several shapes do not fit into one array"
        raise InputError(message(what, "Their wave vectors differ", "Make a scene of each shape"))


def label_warnings(labelled: Iterable[tuple[str, str]]) -> list[str]:
    """Return warnings of cases, given as (label, text), each after the label of its case; a text of many is said once.

    A text that begins with the label, as one about a medium, stands alone.
    """
    labels: dict[str, list[str]] = {}
    for label, text in labelled:
        labels.setdefault(text, []).append(label)
    return [
        f"{first} and {len(others)} more: {text}" if others else text if text.startswith(f"{first} ") else f"{first}: {text}"
        for text, (first, *others) in labels.items()
    ]
