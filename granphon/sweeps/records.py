"""Records of samples, which hold the numbers that a sweep averages and no balls; and the state that averages them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, fields
from typing import TYPE_CHECKING, Any, ClassVar, Self

import numpy as np
from numpy.typing import NDArray

from granphon.array.pressed_sample import PressedSample
from granphon.array.sample import Sample, standard_error
from granphon.base.results import Result
from granphon.media.simulation import SimulatedState
from granphon.sweeps.tasks import TaskResult

if TYPE_CHECKING:
    from granphon.waves.settings import PulseSettings

__all__ = ["RecordedState", "SampleRecord"]

Array = NDArray[np.float64]


@dataclass(frozen=True, eq=False, repr=False)
class SampleRecord(Result):
    """The numbers of a :class:`~granphon.array.sample.Sample` that a state averages, in SI units, under the sample's names.

    ``fraction`` is the sample's ``contact_fraction()``. Three are those of a pulse, None if none was sent; the last four are
    those of a history of friction, None without one.
    """

    added: ClassVar[tuple[str, ...]] = (
        "pulse_velocity", "time_of_flight", "coherent_fraction", "sliding_fraction", "tangential_ratio", "work",
        "dissipated_energy",
    )  # fmt: skip
    units = {
        "force": "N", "overlap": "m", "normal_stiffness": "N/m", "force_fluctuation": "1", "contact_force_fluctuation": "1",
        "fraction": "1", "elastic_tensor": "Pa", "elastic_tensors_beside": "Pa", "pulse_velocity": "m/s",
        "time_of_flight": "s", "coherent_fraction": "1", "sliding_fraction": "1", "tangential_ratio": "1", "work": "J",
        "dissipated_energy": "J",
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
    pulse_velocity: float | None = None
    time_of_flight: float | None = None
    coherent_fraction: float | None = None
    sliding_fraction: float | None = None
    tangential_ratio: float | None = None
    work: float | None = None
    dissipated_energy: float | None = None

    @classmethod
    def of(
        cls, sample: Sample | PressedSample, pulse: PulseSettings | None = None, direction: tuple[Any, ...] | None = None
    ) -> Self:
        """Record a sample; what it has not computed yet is computed now, and a ``pulse`` is sent along ``direction``."""
        heard: dict[str, float] = {}
        if pulse is not None:
            from granphon.waves.sending import send  # imported here: a sweep without pulses does not need it

            found = send(sample, pulse, direction)
            heard = {
                "pulse_velocity": found.velocity, "time_of_flight": found.time_of_flight,
                "coherent_fraction": found.coherent_fraction,
            }  # fmt: skip
        names = ("sliding_fraction", "tangential_ratio", "work", "dissipated_energy")
        lost = {name: getattr(sample, name) for name in names} if isinstance(sample, PressedSample) else {}
        return cls(
            sample.force, sample.overlap, sample.normal_stiffness, sample.force_fluctuation,
            sample.contact_force_fluctuation, sample.contact_fraction(), sample.elastic_tensor,
            sample.elastic_tensors_beside, **heard, **lost,
        )  # fmt: skip

    @classmethod
    def from_part(cls, part: TaskResult, index: int) -> Self:
        """Take the record at one of the loads from the result of a task."""
        return cls(**{one.name: part[one.name][index] for one in fields(cls) if one.name in part})

    @classmethod
    def to_part(cls, records: Sequence[Self]) -> TaskResult:
        """Stack the records at several loads as the result of a task: each number (n_loads, ...)."""
        every = {one.name: [getattr(record, one.name) for record in records] for one in fields(cls)}
        return {name: np.array(values) for name, values in every.items() if values[0] is not None}

    def contact_fraction(self) -> float:
        """Return the fraction of the contacts that carry load, N_c / 6 on the triangular lattice."""
        return self.fraction


@dataclass(frozen=True, eq=False, repr=False)
class RecordedState(SimulatedState):
    """The state that averages records of the samples, which stand in their place in ``samples``."""

    samples: tuple[SampleRecord, ...] = field(default=(), repr=False)  # type: ignore[assignment]  # has what is averaged

    def find_of_pulses(self, name: str) -> Array | None:
        """Return the mean over samples of a number of the pulses; None if none was sent."""
        if getattr(self.samples[0], name) is None:
            return None
        return np.asarray(np.mean(self.over_samples(lambda one: getattr(one, name)), axis=-1))

    def find_pulse_error(self) -> Array | None:
        """Return the standard error over samples of the velocity of pulses, m/s; None without pulses or for one sample."""
        if self.n_samples < 2 or self.samples[0].pulse_velocity is None:
            return None
        return standard_error(self.over_samples(lambda one: one.pulse_velocity), axis=-1)
