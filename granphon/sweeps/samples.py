"""The samples of one simulated state as tasks: unlike in a sweep, their balls are kept, for files and figures of them."""

from __future__ import annotations

import json
from collections.abc import Sequence
from concurrent.futures import Executor
from dataclasses import dataclass
from typing import Any

import numpy as np

from granphon.array.equilibrium import Equilibrium
from granphon.array.sample import Sample
from granphon.array.true_equilibrium import TrueEquilibrium
from granphon.base.progress import Progress, silent
from granphon.base.results import read_only
from granphon.media.choice import Rung
from granphon.media.simulation import DirectSimulation, SimulatedState
from granphon.sweeps.entries import TaskResult
from granphon.sweeps.jobs import Job, to_json
from granphon.sweeps.store import Store
from granphon.sweeps.tasks import solve_all
from granphon.sweeps.workers import packages

__all__ = ["has_sample_tasks", "identify_state", "solve_state"]

#: numbers of an equilibrium that are kept beside the displacements of its balls
_NUMBERS = ("overlap", "residual", "newton", "conjugate")


@dataclass(frozen=True, eq=False)
class _SampleTask:
    """One sample under one load with its elastic tensors, those at neighbouring loads included with ``exponents``."""

    piece: Job

    steps = 1

    @property
    def name(self) -> str:
        return f"balls-{int(self.piece.exponents)}-{self.piece.name}"

    @property
    def where(self) -> str:
        return self.piece.where

    @property
    def kind(self) -> str:
        return self.piece.kind

    @property
    def memory(self) -> float:
        return self.piece.memory

    def done(self, part: TaskResult) -> int:
        return 1

    @property
    def _simulation(self) -> Any:
        return self.piece.medium

    def solve(self, begun: TaskResult | None = None) -> TaskResult:
        """Find the displacements of the balls at rest, the derivatives of the mean force, and the elastic tensors."""
        simulation = self._simulation
        sample = simulation.sample(simulation.prescribed(self.piece.load)[0])
        rest: Any = sample.equilibrium
        found = {name: np.array(getattr(rest, name)) for name in _NUMBERS}
        found |= {"balls": rest.balls, "derivatives": np.array([rest.stiffness, rest.stiffness_slope])}
        found["elastic_tensor"] = sample.elastic_tensor
        return found | ({"elastic_tensors_beside": sample.elastic_tensors_beside} if self.piece.exponents else {})

    def restore(self, part: TaskResult) -> Sample:
        """Return the sample, with what has been computed of it."""
        simulation, numbers = self._simulation, {name: part[name].item() for name in _NUMBERS}
        packing, deviations = simulation.packing, read_only(simulation.deviations(0))
        given = {"balls": part["balls"], "lattice": packing.structure} | numbers
        rest: Equilibrium = Equilibrium(deviations, **given)
        if simulation.ratio:
            rest = TrueEquilibrium(deviations, ratio=simulation.ratio, **given)
        vars(rest)["_derivatives"] = tuple(part["derivatives"].tolist())
        sample = Sample(packing, None if simulation.diameters is not None else simulation.seed, rest)
        vars(sample).update({name: one for name, one in part.items() if name.startswith("elastic_")})
        return sample


def has_sample_tasks(rung: Rung) -> bool:
    """Whether the medium simulates several samples, each of which is a task: not with a history of friction."""
    medium = rung.medium.of(rung.packing) if rung.medium.simulates else None
    return isinstance(medium, DirectSimulation) and medium.samples > 1 and medium.loading is None


def _make_tasks(rung: Rung, exponents: bool) -> list[_SampleTask]:
    whole = Job(rung.medium.label, rung, False, None, exponents=exponents and rung.packing.spread_matters)
    return [_SampleTask(piece) for piece in whole.pieces]


def identify_state(rung: Rung, exponents: bool) -> tuple[dict[str, Any], list[str]]:
    """Return plain data that say which state it is, and the names of its tasks, for :meth:`Store.claim`."""
    names = [task.name for task in _make_tasks(rung, exponents)]
    load, packing = rung.load.applied, json.loads(to_json(rung.packing))
    return {"state of": rung.medium.label, load.kind: load.array.tolist(), "packing": packing, "versions": packages()}, names


def solve_state(
    rung: Rung, exponents: bool, executor: Executor | None = None, progress: Progress = silent, store: Store | None = None
) -> SimulatedState:
    """Return the state of a simulation at one load, as the medium itself does, with its samples solved as tasks."""
    tasks: Sequence[_SampleTask] = _make_tasks(rung, exponents)
    parts = solve_all("simulation", tasks, executor, progress, store)
    medium: Any = rung.medium.of(rung.packing)
    samples = [task.restore(part) for task, part in zip(tasks, parts, strict=True)]
    return SimulatedState.of(medium, samples, rung.load.applied[0])
