"""The tasks of a run: one medium on one packing at all loads that it serves, or one sample of a simulation, load by load.

Tasks are plain data, see :mod:`granphon.sweeps.tasks`. Of each sample only the few numbers that are averaged are kept, and
of a single state its balls too, for files and figures of them. The averages equal those of one simulation of all samples, to
the last bit.
"""

from __future__ import annotations

import hashlib
import json
from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from itertools import islice
from typing import Any

import numpy as np
from numpy.typing import NDArray

from granphon.balls.loads import Load
from granphon.balls.packing import Packing
from granphon.base.errors import GranphonError, InputError, MechanismError
from granphon.base.results import plain
from granphon.media.cases import Case
from granphon.media.choice import ServingMedium
from granphon.media.cost import estimate
from granphon.media.equilibria import sort_by_load
from granphon.media.simulation import DirectSimulation, SimulatedState
from granphon.media.state import ContactState
from granphon.observables.catalogue import Analysis, find_all, warn_of_missing_error
from granphon.observables.validity import Tally
from granphon.observables.velocities import warn_of_free_branches
from granphon.sweeps.archive import SWEEP_SCHEMA
from granphon.sweeps.records import RecordedState, SampleRecord
from granphon.sweeps.samples import keep_balls, restore_sample
from granphon.sweeps.store import TaskResult
from granphon.sweeps.unfinished import end_early, find_reached, mark_as, spread, strip
from granphon.sweeps.workers import packages
from granphon.waves.settings import WaveSettings

Array = NDArray[Any]
#: warning that goes with the bands of a simulation
LATTICE_BANDS = (
    "bands and densities of states are those of a regular lattice with the mean stiffness of the samples, without "
    "disorder. Those of the disordered arrays are sample_dos and spectrum, of a sweep sweep_dos and sweep_spectra: "
    "observe [dos, spectrum]"
)


def to_json(data: Any) -> str:
    """Return plain data as a JSON text; equal data give the same text."""
    return json.dumps(data, default=plain, sort_keys=True)


@dataclass(frozen=True, eq=False)
class Asked:
    """What is asked of each state.

    Attributes
    ----------
    finite_overlap : whether terms of relative order delta/d are asked for.
    qpoints : (s, p, 3), the path of the bands; None without bands.
    direction : that of sound, one or many; None for x.
    waves : what is asked of the waves in each sample; None for nothing.
    exponents : whether the exponent is.
    sound : whether a lattice that has no velocities, a mechanism, is an error; otherwise they are left out.
    alone : whether it is the only state. The balls of its samples are kept, for files and figures of them, and messages need
        not say which state they are about.
    """

    finite_overlap: bool = False
    qpoints: Array | None = None
    direction: tuple[Any, ...] | None = None
    waves: WaveSettings | None = None
    exponents: bool = True
    sound: bool = True
    alone: bool = False


@dataclass(frozen=True, eq=False)
class Work:
    """The work on one case: a job for each medium that serves its loads, with what is asked of each state."""

    case: Case
    asked: Asked = Asked()

    @cached_property
    def jobs(self) -> list[Job]:
        """The jobs; an error names the case, and the load if it is known."""
        case = self.case
        try:
            serving_media = [one for serving in case.serving_media for one in serving.by_geometry(case.finite_overlap)]
        except InputError as error:
            at = error.load_index
            periods = case.packing.structure.periods
            located = _name_task(case.label, error) if at is None else _name_load(case.label, case.load, at, error, periods)
            raise located from error
        wheres = [
            f"{case.label}: {serving.medium.label}" if serving.chosen_automatically else case.label
            for serving in serving_media
        ]
        # lattices have no waves of their own here, and their exponents cost nothing
        ideal = replace(self.asked, waves=None, exponents=True)
        return [
            _ArrayJob(where, serving, self.asked) if serving.arrays else Job(where, serving, ideal)
            for where, serving in zip(wheres, serving_media, strict=True)
        ]

    @cached_property
    def pieces(self) -> list[Job]:
        """The pieces of the jobs, which can run side by side."""
        return [piece for job in self.jobs for piece in job.pieces]

    def join(self, parts: Sequence[TaskResult]) -> TaskResult:
        """Put the results of the :attr:`pieces` together; variables that only some of several media have are left out."""
        left, found = iter(parts), list[TaskResult]()
        for job in self.jobs:
            found.append(job.join(list(islice(left, len(job.pieces)))))
        if len(found) == 1:
            return found[0]
        marks, found = mark_as(found, [job.serving.loads for job in self.jobs]), [strip(part) for part in found]
        order = np.argsort(np.concatenate([job.serving.loads for job in self.jobs]))
        out: TaskResult = {"warnings": _merge_notes([text for part in found for text in part["warnings"].tolist()])}
        named = {name: value for part in found for name, value in part.items() if name != "warnings"}
        for name, value in named.items():
            # arrays of one medium in two geometries have the same variables, of which some may be known in one alone
            if all(name in part for part in found) or not self.jobs[0].serving.chosen_automatically:
                rows = [
                    part[name] if name in part else np.full((job.load.size, *value.shape[1:]), np.nan)
                    for part, job in zip(found, self.jobs, strict=True)
                ]
                out[name] = np.concatenate(rows)[order]
        return out | marks

    def observe_alone(self, analysis: Analysis, records: Sequence[SampleRecord]) -> TaskResult:
        """Return the variables of the only state; ``records`` are those of its samples, if it has any."""
        (job,) = self.jobs
        out = job.observe(analysis)
        if job.asked.waves is None:
            return out
        return _add_waves(out, job.load, records, job.asked.waves, self.case.packing, True)

    def restore(self, parts: Sequence[TaskResult]) -> SimulatedState:
        """Return the only state, that of a simulation, with the samples whose balls the :attr:`pieces` kept."""
        (serving,) = self.case.serving_media
        (medium,) = serving.arrays
        alone = (one for piece in self.pieces for one in piece.serving.arrays)
        samples = [restore_sample(one, part) for one, part in zip(alone, parts, strict=True)]
        state = SimulatedState.of(medium, samples, serving.load.applied[0])
        return replace(state, chosen_automatically=True) if serving.chosen_automatically else state

    def choices(self) -> TaskResult:
        """Return the medium that serves each load, and its expected error, +inf where that is not known."""
        load = self.case.load
        choice, error = np.empty(load.size, object), np.empty(load.size)
        for serving in self.case.serving_media:
            choice[serving.loads], error[serving.loads] = serving.medium.label, serving.errors
        return {"choice": choice.astype(str), "expected_error": error}


@dataclass(frozen=True, eq=False)
class Job:
    """One medium on one packing at all loads that it serves; ``where`` names the job in messages."""

    where: str
    serving: ServingMedium
    asked: Asked

    @property
    def load(self) -> Load:
        """The loads of the job."""
        return self.serving.load

    @cached_property
    def name(self) -> str:
        """Name of the result: the medium, and a digest of everything that determines the numbers."""
        serving = self.serving
        data = {
            "packing": serving.packing, "medium": serving.medium, "load": serving.load, "asked": vars(self.asked),
            "chosen": serving.chosen_automatically, "schema": SWEEP_SCHEMA, "versions": packages(),
        }  # fmt: skip
        return f"{serving.medium.name}-{hashlib.sha256(to_json(data).encode()).hexdigest()}"

    @property
    def kind(self) -> str:
        """Medium, size of an array and number of loads, on which the time depends most."""
        serving = self.serving
        return f"{serving.medium.name} {serving.medium.settings.get('shape', '')} {len(serving.loads)}"

    @property
    def memory(self) -> float:
        """Estimated memory of the process that solves it, bytes; 0 of a medium without an array."""
        return 0.0

    def state(self, load: Load) -> ContactState:
        """Return the state under ``load``, all or some of the loads of the job."""
        return self.serving.at(load, finite_overlap=self.asked.finite_overlap or None)

    @property
    def pieces(self) -> list[Job]:
        """Jobs that can run side by side: one for each sample; the job itself if it cannot be cut."""
        return [self]

    def join(self, parts: Sequence[TaskResult]) -> TaskResult:
        """Put the results of the :attr:`pieces` together."""
        return parts[0]

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
            return self.observe(Analysis(self.state(self.load), self.asked.direction))
        except GranphonError as error:
            raise _locate(self, error) from error

    def observe(self, analysis: Analysis) -> TaskResult:
        """Return the variables of a state, with an axis of loads, and its "warnings"."""
        state, asked = analysis.state, self.asked
        # conditions that hold are kept only where another medium, at other loads, may not meet them
        notes: list[Tally | str] = [
            one for one in analysis.validity.tallies if one.failing or self.serving.chosen_automatically
        ]
        out = find_all(analysis, ("state",), swept=True)
        try:
            out |= find_all(analysis, ("velocities",), swept=True)
            notes += warn_of_free_branches(state, analysis.velocities.velocities)
        except MechanismError as error:
            if asked.sound:
                raise
            notes.append(describe_mechanism(error))
        out |= find_all(analysis, ("exponent",), swept=True) if asked.exponents else {}
        notes += warn_of_missing_error(out)
        found = {name: np.asarray(value)[None] if state.is_single else np.asarray(value) for name, value in out.items()}
        if asked.qpoints is not None:
            found["frequencies"], free = _compute_frequencies(state, asked.qpoints)
            notes += [*free, *[LATTICE_BANDS] * bool(state.n_samples)]
        return found | {"warnings": _write_notes(list(dict.fromkeys(notes)))}


def _add_waves(
    out: TaskResult, load: Load, records: Sequence[SampleRecord], wanted: WaveSettings, packing: Packing, whole: bool
) -> TaskResult:
    """Return ``out`` with the means over samples of the waves, and notes on what is not known of them.

    ``whole`` says whether these are all loads of the medium, which a note need not name.

    An observable that is not known at some of the loads is nan there; one that is known at none is left out.
    """
    from granphon.sweeps.wave_records import average_waves  # imported here: a sweep without waves does not need it

    count = len(records) // load.size
    rows, said = list[dict[str, Array]](), dict[str, list[int]]()
    for index in range(load.size):
        row, texts = average_waves([one.of_waves for one in records[index * count : (index + 1) * count]], wanted)
        rows.append(row)
        for text in texts:
            said.setdefault(text, []).append(index)
    known = {name: value for row in rows for name, value in row.items()}
    found = {name: np.array([row.get(name, np.full_like(one, np.nan)) for row in rows]) for name, one in known.items()}
    periods = packing.structure.periods
    notes = [
        ("" if whole and len(indices) == load.size else _name_loads(load, indices, periods)) + text
        for text, indices in said.items()
    ]
    return out | found | {"warnings": np.concatenate([out["warnings"], _write_notes(notes)])}


def _name_loads(load: Load, indices: Sequence[int], periods: int) -> str:
    """Return the beginning of a note on some of the loads."""
    more = f" and {len(indices) - 1} more" if len(indices) > 1 else ""
    return f"at {load[indices[0]].describe(periods)}{more}, "


def describe_mechanism(error: MechanismError) -> str:
    """Return the warning that goes with the bands of a mechanism."""
    return f"velocities and moduli are left out: {error}"


def _write_notes(notes: Sequence[Tally | str]) -> NDArray[Any]:
    """Encode notes on a result, which are conditions over loads or sentences, as an array of JSON texts."""
    return np.array([json.dumps(note) for note in notes], "S")  # ASCII: one byte for each letter


def _read_note(text: bytes) -> Tally | str:
    note = json.loads(text)
    return note if isinstance(note, str) else Tally(*note)


def _merge_notes(texts: Sequence[bytes]) -> NDArray[Any]:
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
    index of that load in the sweep. If no load fails alone, ``error`` is returned with the task only.
    """
    if job.asked.alone:
        error.load_index = 0 if error.option is None else None
        return error
    if error.option is not None:  # it is not about a load
        return _name_task(job.where, error)
    at, first = error.load_index, error  # an error of a simulation knows its load: nothing is simulated again
    for index in range(job.load.size) if at is None else ():
        try:
            job.observe(Analysis(job.state(job.load[[index]]), job.asked.direction))
        except GranphonError as alone:
            at, first = index, alone
            break
    if at is None:
        return _name_task(job.where, error)
    located = _name_load(job.where, job.load, at, first, job.serving.packing.structure.periods)
    located.load_index = int(job.serving.loads[at])
    return located


def _name_load(where: str, load: Load, index: int, error: GranphonError, periods: int) -> GranphonError:
    """Return ``error`` with the task and the load number ``index`` before its message; its ``load_index`` is that number."""
    located = error.restate(f"{where}, {load[index].describe(periods)}: {error}")
    located.load_index = index
    return located


def _name_task(where: str, error: GranphonError) -> GranphonError:
    """Return ``error`` with the task before its message."""
    return error.restate(f"{where}: {error}")


def _compute_frequencies(state: ContactState, qpoints: Array) -> tuple[Array, tuple[str, ...]]:
    """Compute the frequencies along the path, (n_loads, s, p, n_branches), Hz, and the warnings on those that cost nothing.

    They are those that phonopy gives, but computed from C(q), which needs no force constants. In the paper's limit one
    dispersion relation serves all loads, unless the torsion is that of a Hertz contact.
    """
    loads = [state] if state.is_single else [state[i] for i in range(len(state.force))]
    lattices = [one.contact_lattice() for one in (loads[:1] if state.loaded_lattice.is_one else loads)]
    paths = [one.wavevectors(qpoints.reshape(-1, 3)) for one in lattices]
    rows = np.array([one.frequencies(q) for one, q in zip(lattices, paths, strict=True)])
    hertz = np.array([one.scales.frequency for one in loads])
    out: Array = (hertz[:, None, None] * rows).reshape(len(loads), *qpoints.shape[:2], -1)
    return out, (*lattices[0].free_branch_warnings, *lattices[0].soft_mode_warnings(paths[0], rows[0]))


# -- samples --------------------------------------------------------------------------------------------------------


class _ArrayJob(Job):
    """A simulation at all loads, whose samples are averaged."""

    @property
    def simulation(self) -> DirectSimulation:
        """The simulation of the packing."""
        (found,) = self.serving.arrays
        return found

    @property
    def memory(self) -> float:
        """Estimated memory of the process that solves it, bytes."""
        return estimate(self.simulation, self.load, exponents=self.asked.exponents).memory

    @property
    def pieces(self) -> list[Job]:
        """Jobs that can run side by side: one for each sample."""
        alone = self.serving.samples
        ends = [f", seed {one.medium.settings['seed']}" * (len(alone) > 1) for one in alone]
        asked = replace(self.asked, qpoints=None, direction=None)  # neither is asked for of a sample
        return [_SampleJob(self.where + end, one, asked) for end, one in zip(ends, alone, strict=True)]

    def join(self, parts: Sequence[TaskResult]) -> TaskResult:
        """Average the results of the :attr:`pieces`, at the loads that all of them have reached."""
        size, places, own = self.load.size, find_reached(parts, self.load.size), [strip(part) for part in parts]
        load = self.load if len(places) == size else self.load[places]
        records = [SampleRecord.from_part(part, index) for index in places for part in own]
        out = self.observe(Analysis(RecordedState.of(self.simulation, records, load), self.asked.direction))
        if self.asked.waves is not None:
            out = _add_waves(out, load, records, self.asked.waves, self.serving.packing, not self.serving.is_part)
        return spread(out, places, size) | mark_as(parts, [np.arange(size)] * len(parts))


class _SampleJob(_ArrayJob):
    """One sample of a simulation at all loads, one load in each step.

    The highest load comes first, and the search for each equilibrium starts from the one before, as in a simulation that is
    not cut into tasks. An unfinished result has its loads in this order, and the balls at rest under the last of them.
    With a history of friction all loads are one step.
    """

    @property
    def steps(self) -> int:
        """Number of steps: one for each load, or one for a whole path."""
        return 1 if self.simulation.friction_history else self.load.size

    def done(self, part: TaskResult) -> int:
        """Return the number of steps that a result contains."""
        return 1 if self.simulation.friction_history else len(part["force"])

    def solve(self, begun: TaskResult | None = None) -> TaskResult:
        """Add one load to ``begun``; with the last, return every number of the sample that is averaged, (n_loads, ...)."""
        if self.simulation.friction_history:
            return self._follow_path()
        index: int | None = None
        try:
            simulation = self.simulation
            loads = simulation.prescribed(self.load)
            order = sort_by_load(loads)
            so_far = dict(begun or {})
            before = (so_far.pop("rest_overlap").item(), so_far.pop("rest_balls")) if so_far else None
            index = order[self.done(so_far) if so_far else 0]
            sample = simulation.sample(loads[index], before)
            found = self._record([sample])
        except GranphonError as error:
            if index is not None:
                error.load_index = index
            raise _locate(self, error) from error
        found = {name: np.concatenate([so_far[name], value]) if so_far else value for name, value in found.items()}
        if self.done(found) < len(order):
            rest = sample.equilibrium
            return found | {"rest_overlap": np.array(rest.overlap), "rest_balls": rest.balls}
        return {name: value[np.argsort(order)] for name, value in found.items()}

    def _follow_path(self) -> TaskResult:
        """Return what is averaged at all loads of a path; or at those before the path ends, if it ends early."""
        simulation: Any = self.simulation
        try:
            return super().solve()
        except GranphonError as error:
            if error.reached is None:
                raise
            order, count = simulation.history.sort(simulation.prescribed(self.load)), len(error.reached.force)
            return end_early(self._record(error.reached.samples), sorted(order[:count]), self.load.size, error)

    def observe(self, analysis: Analysis) -> TaskResult:
        """Return every number of the samples that is averaged, (n_loads, ...), and the balls if they are kept."""
        return self._record(analysis.state.samples)

    def _record(self, samples: Sequence[Any]) -> TaskResult:
        asked = self.asked
        found = SampleRecord.to_part([SampleRecord.of(one, asked.waves, asked.exponents, asked.alone) for one in samples])
        return found | keep_balls(samples[0]) if asked.alone else found
