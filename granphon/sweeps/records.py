"""Records of samples, which hold the numbers that a sweep averages and no balls; and the state that averages them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, fields
from typing import Any, Self

import numpy as np
from numpy.typing import NDArray

from granphon.array.pressed_sample import PressedSample
from granphon.array.sample import Sample
from granphon.base.results import Result
from granphon.media.sampled_state import HISTORY_UNITS
from granphon.media.simulation import SimulatedState
from granphon.sweeps.store import TaskResult
from granphon.waves.settings import WaveSettings

Array = NDArray[np.float64]
#: what the names of numbers of waves begin with in the result of a task
_WAVES = "waves."


@dataclass(frozen=True, eq=False, repr=False)
class SampleRecord(Result):
    """The numbers of a :class:`~granphon.array.sample.Sample` that a state averages, in SI units, under the sample's names.

    ``fraction`` is the sample's ``contact_fraction()``, and ``of_waves`` what
    :func:`~granphon.sweeps.wave_records.record_waves` found of its waves, if anything was asked for. The four before it are
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
            from granphon.sweeps.wave_records import record_waves  # imported here: a sweep without waves does not need it

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
