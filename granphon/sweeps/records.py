"""Records of samples, which hold the numbers that a sweep averages and no balls; and the state that averages them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, fields
from typing import Self

import numpy as np
from numpy.typing import NDArray

from granphon.array.sample import Sample
from granphon.base.results import Result
from granphon.media.simulation import SimulatedState
from granphon.sweeps.tasks import TaskResult

__all__ = ["RecordedState", "SampleRecord"]

Array = NDArray[np.float64]


@dataclass(frozen=True, eq=False, repr=False)
class SampleRecord(Result):
    """The numbers of a :class:`~granphon.array.sample.Sample` that a state averages, in SI units, under the sample's names.

    ``fraction`` is the sample's ``contact_fraction()``.
    """

    units = {
        "force": "N", "overlap": "m", "normal_stiffness": "N/m", "force_fluctuation": "1", "contact_force_fluctuation": "1",
        "fraction": "1", "elastic_tensor": "Pa", "elastic_tensors_beside": "Pa",
    }  # fmt: skip
    shapes = {"elastic_tensor": "3 3|6 6|1 1", "elastic_tensors_beside": "2 3 3|2 6 6|2 1 1"}

    force: float
    overlap: float
    normal_stiffness: float
    force_fluctuation: float
    contact_force_fluctuation: float
    fraction: float
    elastic_tensor: Array
    elastic_tensors_beside: Array

    @classmethod
    def of(cls, sample: Sample) -> Self:
        """Record a sample; numbers that it has not computed yet are computed now."""
        return cls(
            sample.force, sample.overlap, sample.normal_stiffness, sample.force_fluctuation,
            sample.contact_force_fluctuation, sample.contact_fraction(), sample.elastic_tensor,
            sample.elastic_tensors_beside,
        )  # fmt: skip

    @classmethod
    def from_part(cls, part: TaskResult, index: int) -> Self:
        """Take the record at one of the loads from the result of a task."""
        return cls(**{one.name: part[one.name][index] for one in fields(cls)})

    @classmethod
    def to_part(cls, records: Sequence[Self]) -> TaskResult:
        """Stack the records at several loads as the result of a task: each number (n_loads, ...)."""
        return {one.name: np.array([getattr(record, one.name) for record in records]) for one in fields(cls)}

    def contact_fraction(self) -> float:
        """Return the fraction of the contacts that carry load, N_c / 6 on the triangular lattice."""
        return self.fraction


@dataclass(frozen=True, eq=False, repr=False)
class RecordedState(SimulatedState):
    """The state that averages records of the samples, which stand in their place in ``samples``."""

    samples: tuple[SampleRecord, ...] = field(default=(), repr=False)  # type: ignore[assignment]  # has what is averaged
