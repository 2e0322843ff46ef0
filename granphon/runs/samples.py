"""What a task keeps of a sample: a record of the numbers that are averaged, and of a single state the balls."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import fields
from types import SimpleNamespace
from typing import Any, Self

import numpy as np

from granphon.array.equilibrium import Equilibrium
from granphon.array.pressed_sample import PressedEquilibrium, PressedSample
from granphon.array.sample import Sample
from granphon.array.true_equilibrium import TrueEquilibrium
from granphon.base.results import read_only
from granphon.media.sampled_state import HISTORY_UNITS
from granphon.media.simulation import DirectSimulation
from granphon.runs.store import TaskResult
from granphon.waves.settings import WaveSettings

#: numbers of any sample that its state averages
_AVERAGED = (
    "force", "boundary_force", "overlap", "normal_stiffness", "force_fluctuation", "contact_force_fluctuation",
    "elastic_tensor",
)  # fmt: skip
#: what the names of numbers of waves begin with in the result of a task
_WAVES = "waves."
#: what the names of arrays of the balls begin with in the result of a task
_BALLS = "balls."
#: what of an equilibrium is not kept: the sample is drawn again from its seed
_DRAWN = ("deviations", "lattice")


class SampleRecord(SimpleNamespace):
    """The numbers of a :class:`~granphon.array.sample.Sample` that a state averages, in SI units, under the sample's names.

    It stands where the state has samples. ``fraction`` is the sample's ``contact_fraction()``, and ``of_waves`` what
    :func:`~granphon.runs.wave_records.record_waves` found of its waves, if anything was asked for. Numbers of a history of
    friction, and tensors at neighbouring loads, are there where the sample has them.
    """

    @classmethod
    def of(
        cls, sample: Sample | PressedSample, waves: WaveSettings | None = None, exponents: bool = True, whole: bool = False
    ) -> Self:
        """Record a sample; what it has not computed yet is computed now, with the ``waves`` that are asked for.

        There are tensors at neighbouring loads for ``exponents`` of balls that differ. With ``whole`` the waves themselves
        are kept too.
        """
        found: dict[str, Any] = {}
        if waves is not None:
            from granphon.runs.wave_records import record_waves  # imported here: a sweep without waves does not need it

            found = record_waves(sample, waves, whole)
        beside = ("elastic_tensors_beside",) * bool(exponents and sample.packing.spread_matters)
        names = (*_AVERAGED, *beside, *(name for name in HISTORY_UNITS if hasattr(sample, name)))
        numbers = {name: getattr(sample, name) for name in names}
        return cls(**numbers, fraction=sample.contact_fraction(), of_waves=found)

    @classmethod
    def from_part(cls, part: TaskResult, index: int) -> Self:
        """Take the record at one of the loads from the result of a task."""
        numbers = {name: value[index] for name, value in part.items()}
        waves = {name.removeprefix(_WAVES): value for name, value in numbers.items() if name.startswith(_WAVES)}
        return cls(**{name: value for name, value in numbers.items() if "." not in name}, of_waves=waves)

    @classmethod
    def to_part(cls, records: Sequence[Self]) -> TaskResult:
        """Stack the records at several loads as the result of a task: each number (n_loads, ...)."""
        rows = [vars(one) | {_WAVES + name: value for name, value in one.of_waves.items()} for one in records]
        return {name: np.array([row[name] for row in rows]) for name in rows[0] if name != "of_waves"}

    def contact_fraction(self) -> float:
        """Return the fraction of the contacts that carry load, N_c / 6 on the triangular lattice."""
        return float(self.fraction)


# -- balls ----------------------------------------------------------------------------------------------------------


def keep_balls(sample: Sample | PressedSample) -> TaskResult:
    """Return the balls of a sample at rest as arrays, each after an axis of one load."""
    rest = sample.equilibrium
    found = {name: np.asarray(getattr(rest, name)) for name in _list_kept(type(rest))}
    if not isinstance(sample, PressedSample):  # after a history they follow from the elastic tensors
        found["derivatives"] = np.array([rest.stiffness, rest.stiffness_slope])
    return {_BALLS + name: value[None] for name, value in found.items()}


def restore_sample(simulation: DirectSimulation, part: TaskResult) -> Sample | PressedSample:
    """Return the one sample of a simulation, with what a task has found of it and its balls."""
    packing, seed, history = simulation.packing, simulation.seed_of(0), simulation.history
    kind = PressedEquilibrium if history.is_loaded else TrueEquilibrium if simulation.ratio else Equilibrium
    given: dict[str, Any] = {name: part[_BALLS + name][0] for name in _list_kept(kind)}
    rest: Any = kind(deviations=read_only(simulation.deviations(0)), lattice=packing.structure, **given)
    if not history.is_loaded:
        vars(rest)["_derivatives"] = tuple(part[_BALLS + "derivatives"][0].tolist())
        sample: Sample | PressedSample = Sample(packing, seed, rest)
    else:
        sample = PressedSample(packing, seed, rest, history.shear_response)
    vars(sample).update({name: one[0] for name, one in part.items() if name.startswith("elastic_")})
    return sample


def _list_kept(kind: type[Equilibrium]) -> list[str]:
    """Return the names of the fields of an equilibrium that are kept."""
    return [one.name for one in fields(kind) if one.name not in _DRAWN]
