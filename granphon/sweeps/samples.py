"""The samples of one simulated state as tasks: unlike in a sweep, their balls are kept, for files and figures of them."""

from __future__ import annotations

import json
from concurrent.futures import Executor
from dataclasses import dataclass, fields, replace
from typing import Any

import numpy as np

from granphon.array.equilibrium import Equilibrium
from granphon.array.pressed_sample import PressedEquilibrium, PressedSample
from granphon.array.sample import Sample
from granphon.array.true_equilibrium import TrueEquilibrium
from granphon.base.errors import GranphonError
from granphon.base.progress import Progress, silent
from granphon.base.results import read_only
from granphon.media.choice import Rung
from granphon.media.simulation import SimulatedState
from granphon.sweeps.jobs import Job, to_json
from granphon.sweeps.store import Store, TaskResult
from granphon.sweeps.tasks import solve_all
from granphon.sweeps.workers import packages

__all__ = ["solve_state"]

#: what of an equilibrium is not kept: the sample is drawn again from its seed
_DRAWN = ("deviations", "lattice")


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

    def solve(self, begun: TaskResult | None = None) -> TaskResult:
        """Find the balls at rest, without or with friction, and the elastic tensors."""
        try:
            (sample,) = self.piece.state(self.piece.load).samples
            rest, found = sample.equilibrium, {"elastic_tensor": sample.elastic_tensor}
            if self.piece.exponents:
                found["elastic_tensors_beside"] = sample.elastic_tensors_beside
        except GranphonError as error:
            error.load_index = 0 if error.option is None else None
            raise
        if not isinstance(sample, PressedSample):  # after a history they follow from the elastic tensors
            found["derivatives"] = np.array([rest.stiffness, rest.stiffness_slope])
        return found | {name: np.asarray(getattr(rest, name)) for name in _list_kept(type(rest))}

    def restore(self, part: TaskResult) -> Sample:
        """Return the sample, with what has been computed of it."""
        simulation: Any = self.piece.medium
        packing, seed, loading = simulation.packing, simulation.seed_of(0), simulation.loading
        kind = PressedEquilibrium if loading else TrueEquilibrium if simulation.ratio else Equilibrium
        given: dict[str, Any] = {name: part[name] for name in _list_kept(kind)}
        rest: Any = kind(deviations=read_only(simulation.deviations(0)), lattice=packing.structure, **given)
        if loading is None:
            vars(rest)["_derivatives"] = tuple(part["derivatives"].tolist())
        sample = PressedSample(packing, seed, rest, loading.shear_response) if loading else Sample(packing, seed, rest)
        vars(sample).update({name: one for name, one in part.items() if name.startswith("elastic_")})
        return sample


def _list_kept(kind: type[Equilibrium]) -> list[str]:
    """Return the names of the fields of an equilibrium that are kept."""
    return [one.name for one in fields(kind) if one.name not in _DRAWN]


def solve_state(
    rung: Rung, exponents: bool, executor: Executor | None = None, progress: Progress = silent, store: Store | None = None
) -> SimulatedState:
    """Return the state of a simulation at one load, as the medium itself does, with its samples solved as tasks.

    They are kept in the ``store``, which is claimed for this state; see :meth:`Store.claim`.
    """
    own = exponents and rung.packing.spread_matters
    whole = Job(rung.medium.label, rung, False, None, exponents=own)
    tasks = [_SampleTask(piece) for piece in whole.pieces]
    if store is not None:
        load, packing = rung.load.applied, json.loads(to_json(rung.packing))
        identity = {"state of": rung.medium.label, load.kind: load.array.tolist(), "packing": packing}
        store.claim(identity | {"versions": packages()}, lambda: [task.name for task in tasks])
    parts = solve_all("simulation", tasks, executor, progress, store)
    medium: Any = rung.medium.of(rung.packing)
    samples = [task.restore(part) for task, part in zip(tasks, parts, strict=True)]
    state = SimulatedState.of(medium, samples, rung.load.applied[0])
    return replace(state, chosen=True) if rung.chosen else state
