"""The tasks of a sweep: one medium on one packing at all loads, or one sample of a simulation, load by load.

Tasks are plain data, see :mod:`granphon.sweeps.tasks`. Of each sample only the few numbers that are averaged are kept.
Their averages equal those of one simulation of all samples, to the last bit.
"""

from __future__ import annotations

import hashlib
import json
from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cache, cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray

from granphon.balls.loads import Load
from granphon.balls.packing import Packing
from granphon.base.errors import GranphonError, InputError
from granphon.base.results import plain
from granphon.base.text import versions
from granphon.media.acoustics import contact_lattice
from granphon.media.choice import MediumChoice, Rung
from granphon.media.equilibria import in_order
from granphon.media.simulation import DirectSimulation
from granphon.media.state import ContactState
from granphon.observables.catalogue import Analysis, find_all, missing_error
from granphon.observables.validity import Tally, validity
from granphon.sweeps.archive import SWEEP_SCHEMA
from granphon.sweeps.records import RecordedState, SampleRecord
from granphon.sweeps.tasks import TaskResult

__all__ = ["LATTICE_BANDS", "Job", "packages", "to_json", "tell_warnings"]

Array = NDArray[Any]
#: warning that goes with the bands of a simulation
LATTICE_BANDS = (
    "bands and densities of states are those of a regular lattice with the mean stiffness of the samples: "
    "the disorder of the contacts is in the velocities and moduli only"
)


def to_json(data: Any) -> str:
    """Return plain data as a JSON text; equal data give the same text."""
    return json.dumps(data, default=plain, sort_keys=True)


@cache
def packages() -> dict[str, str]:
    """Versions, by name, of the packages that determine the numbers."""
    return versions("numpy", "scipy")


@dataclass(frozen=True, eq=False)
class Job:
    """One medium on one packing at all loads.

    ``where`` names the job in messages. ``qpoints`` (s, p, 3) is the path of the bands; None without bands. ``places`` are
    the indices of its loads among those of the sweep if an automatic medium gave it some of them; otherwise None.
    """

    where: str
    packing: Packing
    medium: MediumChoice
    load: Load
    finite_overlap: bool
    qpoints: Array | None
    places: tuple[int, ...] | None = None

    def state(self, load: Load) -> ContactState:
        """Return the state under ``load``, all or some of the loads of the job."""
        state = self.medium.of(self.packing).at(load, finite_overlap=self.finite_overlap)
        return replace(state, chosen=self.places is not None)

    @cached_property
    def name(self) -> str:
        """Name of the file for its result: the medium, and a digest of everything that determines the numbers."""
        data = {**plain(self), "where": "", "places": "", "schema": SWEEP_SCHEMA, "versions": packages()}
        return f"{self.medium.name}-{hashlib.sha256(to_json(data).encode()).hexdigest()}"

    @cached_property
    def rungs(self) -> list[Rung]:
        """The media that serve the loads, each with its loads; an error names the task, and the load if it is known."""
        try:
            return self.medium.rungs(self.packing, self.load)
        except InputError as error:
            raise (_locate if error.load_index is not None else _name_task)(self, error) from error

    def _delegate(self) -> list[tuple[Job, Rung]]:
        """Return the jobs that an automatic medium leaves to other media, each with its rung of the ladder."""
        out = []
        for rung in self.rungs:
            places = tuple(rung.loads.tolist())
            where = f"{self.where}: {rung.medium.label}"
            out.append((replace(self, where=where, medium=rung.medium, load=rung.load, places=places), rung))
        return out

    @property
    def pieces(self) -> list[Job]:
        """Jobs that can run side by side: one for each chosen medium or sample; the job itself if it cannot be cut."""
        if self.medium.is_automatic:
            return [piece for job, _ in self._delegate() for piece in job.pieces]
        try:
            medium = self.medium.of(self.packing)
        except InputError as error:
            raise _name_task(self, error) from error
        if not isinstance(medium, DirectSimulation):
            return [self]
        out: list[Job] = []
        for seed in range(medium.seed, medium.seed + medium.samples):
            # the number of samples is left out: a sample is then the same piece, however many there are
            alone = MediumChoice(self.medium.name, (("shape", medium.shape), ("seed", seed)))
            where = self.where if medium.samples == 1 else f"{self.where}, seed {seed}"
            out.append(_SampleJob(where, self.packing, alone, self.load, self.finite_overlap, None, self.places))
        return out

    def join(self, parts: Sequence[TaskResult]) -> TaskResult:
        """Put the results of the :attr:`pieces` together."""
        if self.medium.is_automatic:
            return self._merge(parts)
        medium = self.medium.of(self.packing)
        if not isinstance(medium, DirectSimulation):
            return parts[0]
        records = [SampleRecord.from_part(part, index) for index in range(self.load.size) for part in parts]
        return self.observe(RecordedState.of(medium, records, self.load))

    def _merge(self, parts: Sequence[TaskResult]) -> TaskResult:
        """Merge the results of the chosen media, each at its loads; variables that only some of them have are left out."""
        left, found = list(parts), []
        for job, rung in self._delegate():
            count = len(job.pieces)
            found.append((job.join(left[:count]), rung))
            del left[:count]
        out: TaskResult = {"warnings": _merge_notes([text for part, _ in found for text in part["warnings"].tolist()])}
        for name in [name for name in found[0][0] if name != "warnings" and all(name in part for part, _ in found)]:
            values = np.concatenate([part[name] for part, _ in found])
            order = np.argsort(np.concatenate([rung.loads for _, rung in found]))
            out[name] = values[order]
        return out

    def choices(self) -> TaskResult:
        """Return the medium that serves each load, and its expected error, +inf where that is not known."""
        choice, error = np.empty(self.load.size, object), np.empty(self.load.size)
        for rung in self.rungs:
            choice[rung.loads], error[rung.loads] = rung.medium.label, rung.errors
        return {"choice": choice.astype(str), "expected_error": error}

    @property
    def steps(self) -> int:
        """Number of steps: one, as all loads are solved together."""
        return 1

    def done(self, part: TaskResult) -> int:
        """Return the number of steps that a result contains."""
        return 1

    def solve(self, begun: TaskResult | None = None) -> TaskResult:
        """Find every variable at every load, and the "warnings" that :func:`tell_warnings` reads.

        An error names its task and, if it is known, its load.
        """
        try:
            return self.observe(self.state(self.load))
        except GranphonError as error:
            raise _locate(self, error) from error

    def observe(self, state: ContactState) -> TaskResult:
        """Return the variables of a state, and its "warnings"."""
        out = find_all(Analysis(state), ("state", "velocities", "exponent"), swept=True)
        notes: list[Tally | str] = [check.tally for check in validity(state).checks]
        notes += missing_error(out)
        if self.qpoints is not None:
            out["frequencies"] = _frequencies(state, self.qpoints)
            notes += [LATTICE_BANDS] if state.n_samples else []
        return {name: np.asarray(value) for name, value in out.items()} | {"warnings": _write_notes(notes)}


def _write_notes(notes: Sequence[Tally | str]) -> NDArray[Any]:
    """Encode notes on a result, which are conditions over loads or sentences, as an array of JSON texts."""
    return np.array([json.dumps(note) for note in notes], str)


def _read_note(text: str) -> Tally | str:
    note = json.loads(text)
    return note if isinstance(note, str) else Tally(*note)


def _merge_notes(texts: Sequence[str]) -> NDArray[Any]:
    """Merge notes on parts of the loads into notes on all of them: each condition and each sentence appears once."""
    found: dict[Any, Tally | str] = {}
    for note in map(_read_note, texts):
        key = note if isinstance(note, str) else note[:4]
        before = found.get(key)
        found[key] = before.join(note) if isinstance(before, Tally) and isinstance(note, Tally) else note
    return _write_notes(list(found.values()))


def tell_warnings(part: TaskResult) -> list[str]:
    """Return the warnings of a result: a sentence for each condition that fails."""
    sentences = (note if isinstance(note, str) else note.warning for note in map(_read_note, part["warnings"].tolist()))
    return [sentence for sentence in sentences if sentence is not None]


def _locate(job: Job, error: GranphonError) -> GranphonError:
    """Return an error whose message begins with the task and the load.

    It is ``error`` if its load is known, otherwise that of the first load which fails alone; its ``load_index`` is the
    index of that load. If no load fails alone, ``error`` is returned with the task only.
    """

    def at(index: int, error: GranphonError) -> GranphonError:
        located = type(error)(f"{job.where}, {job.load[index]} {job.load.unit}: {error}")
        located.load_index = index if job.places is None else job.places[index]
        return located

    if error.load_index is not None:  # an error of a simulation knows its load: nothing is simulated again
        return at(error.load_index, error)
    for index in range(job.load.size):
        try:
            job.observe(job.state(job.load[[index]]))
        except GranphonError as alone:
            return at(index, alone)
    return _name_task(job, error)


def _name_task(job: Job, error: GranphonError) -> GranphonError:
    """Return ``error`` with the task before its message."""
    return type(error)(f"{job.where}: {error}")


def _frequencies(state: ContactState, qpoints: Array) -> Array:
    """Frequencies along the path, (n_loads, s, p, n_branches), Hz: those of phonopy, but computed from C(q).

    phonopy's threads do not survive the fork of a worker process. In the paper's limit one dispersion relation serves all
    loads.
    """
    loads = [state[i] for i in range(len(state.force))]
    lattices = [contact_lattice(one) for one in (loads if state.finite_overlap else loads[:1])]
    rows = np.array([one.frequencies(one.wavevectors(qpoints.reshape(-1, 3))) for one in lattices])
    hertz = np.array([one.scales.frequency for one in loads])
    out: Array = (hertz[:, None, None] * rows).reshape(len(loads), *qpoints.shape[:2], -1)
    return out


# -- samples --------------------------------------------------------------------------------------------------------


class _SampleJob(Job):
    """One sample of a simulation at all loads, one load in each step.

    The highest load comes first, and the search for each equilibrium starts from the one before, as in a simulation that is
    not cut into tasks. An unfinished result has its loads in this order, and the balls at rest under the last of them.
    """

    @property
    def steps(self) -> int:
        """Number of steps: one for each load."""
        return self.load.size

    def done(self, part: TaskResult) -> int:
        """Return the number of loads that a result contains."""
        return len(part["force"])

    def solve(self, begun: TaskResult | None = None) -> TaskResult:
        """Add one load to ``begun``; with the last, return every number of the sample that is averaged, (n_loads, ...)."""
        index: int | None = None
        try:
            simulation: Any = self.medium.of(self.packing)
            loads = simulation.prescribed(self.load)
            order = in_order(loads)
            so_far = dict(begun or {})
            before = (so_far.pop("rest_overlap").item(), so_far.pop("rest_balls")) if so_far else None
            index = order[self.done(so_far) if so_far else 0]
            sample = simulation.sample(loads[index], before)
            found = SampleRecord.to_part([SampleRecord.of(sample)])
        except GranphonError as error:
            if index is not None:
                error.load_index = index
            raise _locate(self, error) from error
        found = {name: np.concatenate([so_far[name], value]) if so_far else value for name, value in found.items()}
        if self.done(found) < len(order):
            rest = sample.equilibrium
            return found | {"rest_overlap": np.array(rest.overlap), "rest_balls": rest.balls}
        return {name: value[np.argsort(order)] for name, value in found.items()}

    def observe(self, state: ContactState) -> TaskResult:
        """Return every number of the samples that is averaged, (n_loads, ...)."""
        return SampleRecord.to_part([SampleRecord.of(sample) for sample in state.samples])
