"""What a task keeps of a sample: a record of the numbers that are averaged, and of a single state the balls."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, fields
from typing import Any, Self

import numpy as np
from numpy.typing import NDArray

from granphon.array.equilibrium import Equilibrium
from granphon.array.pressed_sample import PressedEquilibrium, PressedSample
from granphon.array.sample import Sample
from granphon.array.true_equilibrium import TrueEquilibrium
from granphon.base.results import Result, read_only
from granphon.media.sampled_state import HISTORY_UNITS
from granphon.media.simulation import DirectSimulation, SimulatedState
from granphon.runs.store import TaskResult
from granphon.waves.settings import WaveSettings

Array = NDArray[np.float64]
#: what the names of numbers of waves begin with in the result of a task
_WAVES = "waves."
#: what the names of arrays of the balls begin with in the result of a task
_BALLS = "balls."
#: what of an equilibrium is not kept: the sample is drawn again from its seed
_DRAWN = ("deviations", "lattice")


@dataclass(frozen=True, eq=False, repr=False)
class SampleRecord(Result):
    """The numbers of a :class:`~granphon.array.sample.Sample` that a state averages, in SI units, under the sample's names.

    ``fraction`` is the sample's ``contact_fraction()``, and ``of_waves`` what
    :func:`~granphon.runs.wave_records.record_waves` found of its waves, if anything was asked for. The four before it are
    those of a history of friction, None without one.
    """

    units = {
        "force": "N", "boundary_force": "N", "overlap": "m", "normal_stiffness": "N/m", "force_fluctuation": "1",
        "contact_force_fluctuation": "1", "fraction": "1", "elastic_tensor": "Pa", "elastic_tensors_beside": "Pa",
        **HISTORY_UNITS,
    }  # fmt: skip
    _shapes = {"elastic_tensor": "3 3|6 6|1 1", "elastic_tensors_beside": "2 3 3?|2 6 6?|2 1 1?"}

    force: float
    boundary_force: float
    overlap: float
    normal_stiffness: float
    force_fluctuation: float
    contact_force_fluctuation: float
    fraction: float
    elastic_tensor: Array
    elastic_tensors_beside: Array | None = None
    sliding_fraction: float | None = None
    tangential_ratio: float | None = None
    work: float | None = None
    dissipated_energy: float | None = None
    of_waves: dict[str, Any] = field(default_factory=dict, repr=False)

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
        lost = {name: getattr(sample, name) for name in HISTORY_UNITS} if isinstance(sample, PressedSample) else {}
        return cls(
            sample.force, sample.boundary_force, sample.overlap, sample.normal_stiffness, sample.force_fluctuation,
            sample.contact_force_fluctuation, sample.contact_fraction(), sample.elastic_tensor,
            sample.elastic_tensors_beside if exponents and sample.packing.spread_matters else None, of_waves=found, **lost,
        )  # fmt: skip

    @classmethod
    def from_part(cls, part: TaskResult, index: int) -> Self:
        """Take the record at one of the loads from the result of a task."""
        own = {one.name for one in fields(cls)}
        numbers = {name: value[index] for name, value in part.items()}
        return cls(
            **{name: value for name, value in numbers.items() if name in own},
            of_waves={name.removeprefix(_WAVES): value for name, value in numbers.items() if name.startswith(_WAVES)},
        )

    @classmethod
    def to_part(cls, records: Sequence[Self]) -> TaskResult:
        """Stack the records at several loads as the result of a task: each number (n_loads, ...)."""
        own = [one.name for one in fields(cls) if one.name != "of_waves" and getattr(records[0], one.name) is not None]
        out = {name: np.array([getattr(record, name) for record in records]) for name in own}
        return out | {_WAVES + name: np.array([one.of_waves[name] for one in records]) for name in records[0].of_waves}

    def contact_fraction(self) -> float:
        """Return the fraction of the contacts that carry load, N_c / 6 on the triangular lattice."""
        return self.fraction


@dataclass(frozen=True, eq=False, repr=False)
class RecordedState(SimulatedState):
    """The state that averages records of the samples, which stand in their place in ``samples``."""

    samples: tuple[SampleRecord, ...] = field(default=(), repr=False)  # type: ignore[assignment]  # has what is averaged


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
