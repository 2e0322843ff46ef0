"""The cases of a run, and its tasks.

A case is one medium on one packing at many loads. Each of its tasks is one medium at all loads that
it serves, or one sample of a simulation, load by load.

Tasks are plain data, see :mod:`granphon.runs.execution`. Of each sample only the few numbers that
are averaged are kept, and of a single state its balls too, for files and figures of them. The
averages equal those of one simulation of all samples, to the last bit.

A sample that is loaded with friction may not reach all loads of its path. Its task is then done as
far as it goes: the result has the loads that were reached, and as marks the indices of the others
and why the path ended. When all tasks are done, the run is an error, with the data set at the loads
that all tasks have reached.
"""

from __future__ import annotations

import hashlib
import json
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, fields, replace
from functools import cached_property, partial
from itertools import islice
from types import SimpleNamespace
from typing import Any, Self

import numpy as np
from numpy.typing import NDArray

from granphon.array.equilibrium import Equilibrium
from granphon.array.pressed_sample import PressedEquilibrium, PressedSample
from granphon.array.sample import Sample
from granphon.array.true_equilibrium import TrueEquilibrium
from granphon.balls.lattices import Lattice
from granphon.balls.loads import Load
from granphon.balls.packing import Axis, combine
from granphon.base.errors import ConvergenceError, GranphonError, InputError, MechanismError
from granphon.base.registry import list_added
from granphon.base.results import plain, read_only
from granphon.base.text import counted
from granphon.media.arrangement import Balls
from granphon.media.choice import MediumChoice, ServingMedium
from granphon.media.limits import Check
from granphon.media.loading import sort_by_load
from granphon.media.simulation import HISTORY_UNITS, DirectSimulation, SimulatedState
from granphon.media.state import ContactState
from granphon.observables.catalogue import Analysis, find_all, warn_of_missing_error
from granphon.observables.velocities import warn_of_free_branches
from granphon.phonons.paths import interpolate_path, special_points
from granphon.runs.execution import Task
from granphon.runs.store import TaskResult
from granphon.runs.workers import packages
from granphon.waves.settings import BandsSettings, SurfaceSettings, WaveSettings

Array = NDArray[Any]
#: warning that goes with the bands of a simulation
LATTICE_BANDS = (
    "bands and densities of states are those of a regular lattice with the mean stiffness of"
    " the samples, without "
    "disorder. Those of the disordered arrays are sample_dos and spectrum, of a sweep"
    " sweep_dos and sweep_spectra: "
    "observe [dos, spectrum]"
)
#: marks of a result: indices of the loads that were not reached, why the path ended, and the index
#: of the load at which the path ended
_MARKS = _MISSED, _WHY, _END = "path.missed", "path.why", "path.at"
#: the marks of a path that did not end early
_NONE = np.zeros(0)
#: numbers of any sample that its state averages
_AVERAGED = (
    "force",
    "boundary_force",
    "overlap",
    "normal_stiffness",
    "force_fluctuation",
    "contact_force_fluctuation",
    "elastic_tensor",
)
#: prefix of the names of numbers of waves in the result of a task
_WAVES = "waves."
#: prefix of the names of arrays of the balls in the result of a task
_BALLS = "balls."
#: version of the format of a sweep, attribute "schema" of its file; files of another one are
#: refused
SWEEP_SCHEMA = 1
#: attribute of a data set that says why it lacks loads
INCOMPLETE = "incomplete"


def to_json(data: Any) -> str:
    """Return plain data as a JSON text; equal data give the same text. An object of a user is its
    class and attributes.
    """

    def write(value: Any) -> Any:
        data = plain(value)
        if data is not value:
            return data
        return {"class": type(value).__qualname__} | getattr(value, "__dict__", {})

    return json.dumps(data, default=write, sort_keys=True)


# -- cases -----------------------------------------------------------------------------------------


@dataclass(frozen=True, eq=False)
class Request:
    """The observables that are requested of each state, and how they are found.

    Attributes
    ----------
    finite_overlap : whether the terms of relative order delta/d are kept.
    path : path of the bands: letters or corners, points in a segment, and labels of the corners;
        None without bands.
    direction : direction of sound, Cartesian, one or many; None for x.
    waves : settings of the waves in each sample of a simulation; None without waves.
    surface : the edge whose waves are requested; None for none.
    bands : how contacts damp the bands; None for bands without loss alone.
    exponents : whether the exponents of the velocities are requested, for which a simulation solves
        two more equilibria at each load.
    sound : whether a lattice without velocities, a mechanism, is an error; otherwise velocities are
        left out.
    observe : the names of the observables, as in a scene; a registered observable among them must
        be found.
    alone : whether there is only one state. The balls of its samples are kept, for files and
        figures of them, and messages need not name the state.
    """

    finite_overlap: bool = False
    path: tuple[Any, int, Sequence[str] | None] | None = None
    direction: tuple[Any, ...] | None = None
    waves: WaveSettings | None = None
    surface: SurfaceSettings | None = None
    bands: BandsSettings | None = None
    exponents: bool = True
    sound: bool = True
    alone: bool = False
    observe: tuple[str, ...] = ("velocities",)

    def find_path(self, structure: Lattice) -> tuple[Array, tuple[str, ...]] | None:
        """Find the points along the path of the bands, (s, p, 3), and the labels of its corners;
        None without bands.
        """
        if self.path is None:
            return None
        corners, npoints, labels = self.path
        letters = special_points(structure.vectors) if isinstance(corners, str) else {}
        return interpolate_path(corners, npoints, letters, labels, structure.periods)


@dataclass(frozen=True, eq=False)
class Case:
    """One medium on one packing, at all values of an applied load, and the request of its states.

    ``where`` names the swept parameters of the packing with their values, in words; empty if none
    is swept.
    """

    where: str
    packing: Balls
    medium: MediumChoice
    load: Load
    request: Request = Request()

    @property
    def label(self) -> str:
        """Medium and swept parameters in words, as messages of sweeps name them."""
        return ", ".join(filter(None, (self.medium.label, self.where)))

    def name(self, serving: ServingMedium) -> str:
        """Return the label of one of the media that serve the loads; where the medium was chosen
        automatically, its own label follows that of the case.
        """
        if serving.chosen_automatically:
            return f"{self.label}: {serving.medium.label}"
        return self.label

    @cached_property
    def serving_media(self) -> list[ServingMedium]:
        """The media that serve the loads, each with its loads: the medium itself, or those that an
        automatic medium chooses.

        They are found once, for all who hold the case. :class:`~granphon.base.errors.InputError` if
        the packing has no such medium, or if none can be chosen.
        """
        return self.medium.choose(self.packing, self.load)

    @cached_property
    def media(self) -> list[MediumTask]:
        """A task for each medium that serves loads; an error names the case, and the load if the
        load is known.
        """
        try:
            serving_media = [
                serving
                for chosen in self.serving_media
                for serving in chosen.by_geometry(self.request.finite_overlap)
            ]
        except InputError as error:
            periods = self.packing.structure.periods
            raise _name_load(self.label, self.load, error.load_index, error, periods) from error
        # lattices have no waves but those of networks, and their exponents cost nothing
        networks = () if self.request.waves is None else self.request.waves.of_networks
        lattice_request = replace(
            self.request,
            waves=WaveSettings(of_networks=networks) if networks else None,
            exponents=True,
        )
        return [
            MediumTask(
                self.name(serving), serving, self.request if serving.arrays else lattice_request
            )
            for serving in serving_media
        ]

    @cached_property
    def tasks(self) -> list[MediumTask]:
        """The tasks that can run side by side: of a simulation one for each sample."""
        return [task for medium_task in self.media for task in medium_task.tasks]

    def join(self, results: Sequence[TaskResult]) -> TaskResult:
        """Join the results of the :attr:`tasks`; variables that only some of several media have are
        left out.
        """
        media = self.media
        remaining = iter(results)
        joined = [medium.join(list(islice(remaining, len(medium.tasks)))) for medium in media]
        if len(joined) == 1:
            return joined[0]
        loads = [medium.serving.loads for medium in media]
        marks = _join_marks(joined, loads)
        joined = [drop_marks(result) for result in joined]
        order = np.argsort(np.concatenate(loads))
        out: TaskResult = {"warnings": _join_notes(joined)}
        examples = dict[str, Array]()
        for result in joined:
            examples |= result
        del examples["warnings"]
        for name, example in examples.items():
            # arrays of one medium in two geometries have the same variables, of which some may be
            # known in one alone
            is_in_all = all(name in result for result in joined)
            if not is_in_all and media[0].serving.chosen_automatically:
                continue
            rows = []
            for result, medium in zip(joined, media, strict=True):
                unknown = np.full((medium.load.size, *example.shape[1:]), np.nan)
                rows.append(result.get(name, unknown))
            out[name] = np.concatenate(pad_alike(rows))[order]
        return out | marks

    def restore(self, results: Sequence[TaskResult]) -> SimulatedState:
        """Return the only state, that of a simulation, with the samples whose balls the
        :attr:`tasks` kept.
        """
        (serving,) = self.serving_media
        (medium,) = serving.arrays
        samples = [
            restore_sample(task.simulation, result)
            for task, result in zip(self.tasks, results, strict=True)
        ]
        state = SimulatedState.of(medium, samples, serving.load.applied[0])
        return replace(state, chosen_automatically=True) if serving.chosen_automatically else state


@dataclass(frozen=True, eq=False)
class Grid:
    """Every medium at every combination of the values of the ``axes`` of a packing, under an
    applied load.
    """

    packing: Balls
    axes: Sequence[Axis]
    media: Sequence[MediumChoice]
    load: Load
    request: Request = Request()

    @cached_property
    def cases(self) -> tuple[Case, ...]:
        """The cases, the media running fastest; :class:`~granphon.base.errors.InputError` for an
        impossible packing.
        """
        return tuple(
            Case(where, packing, medium, self.load, self.request)
            for where, packing in combine(self.packing, self.axes)
            for medium in self.media
        )


def require_arrays(
    media: Sequence[MediumChoice], swept: Iterable[str], names: Iterable[str]
) -> None:
    """Raise :class:`~granphon.base.errors.InputError` if there are no arrays for the waves
    ``names``.

    The waves "dos", "spectrum" and "pulse" are of simulated arrays themselves. ``swept`` are the
    parameters that are swept.
    """
    waves = list(names)
    for choice in media if waves else ():
        choice.require_arrays(waves[0])
    if "spectrum" not in waves:
        return
    for name in swept:
        if name in ("lattice", "motions"):
            problem = f"the spectra of a sweep over {name} do not fit into one array"
            why = "Their wave vectors or polarisations differ"
            raise InputError(problem, why, "Make a scene of each")
    if len({choice.settings.get("shape") for choice in media}) > 1:
        problem = "the spectra of arrays of several shapes do not fit into one array"
        raise InputError(problem, "Their wave vectors differ", "Make a scene of each shape")


def pad_alike(arrays: Sequence[Array]) -> list[Array]:
    """Return arrays with as many columns each as the widest has; columns that are added are nan."""
    most = max(array.shape[-1] if array.ndim > 1 else 0 for array in arrays)
    padded = list[Array]()
    for array in arrays:
        if array.ndim > 1 and array.shape[-1] < most:
            widths = [(0, 0)] * (array.ndim - 1) + [(0, most - array.shape[-1])]
            array = np.pad(array, widths, constant_values=np.nan)
        padded.append(array)
    return padded


def label_warnings(labelled: Iterable[tuple[str, str]]) -> list[str]:
    """Return warnings of cases, given as (label, text), each after the label of its case; a text of
    several cases appears once.

    A text that begins with the label, as one about a medium, stands alone.
    """
    labels_of_texts: dict[str, list[str]] = {}
    for label, text in labelled:
        labels_of_texts.setdefault(text, []).append(label)
    sentences = []
    for text, labels in labels_of_texts.items():
        if len(labels) > 1:
            sentences.append(f"{labels[0]} and {len(labels) - 1} more: {text}")
        elif text.startswith(f"{labels[0]} "):
            sentences.append(text)
        else:
            sentences.append(f"{labels[0]}: {text}")
    return sentences


# -- of a medium -----------------------------------------------------------------------------------


@dataclass(frozen=True, eq=False)
class MediumTask(Task):
    """One medium on one packing at all loads that it serves, which are solved together, in one
    step.
    """

    where: str
    serving: ServingMedium
    request: Request

    @property
    def load(self) -> Load:
        """The loads of the task."""
        return self.serving.load

    @property
    def simulation(self) -> DirectSimulation:
        """The simulation of the packing, if it is one."""
        (simulation,) = self.serving.arrays
        return simulation

    @cached_property
    def name(self) -> str:
        """Name of the result: the medium, and a digest of everything that determines the
        numbers.
        """
        serving = self.serving
        data = {
            "packing": serving.packing,
            "medium": serving.medium,
            "load": serving.load,
            "asked": vars(self.request),  # the key is part of names of results that are kept
            "chosen": serving.chosen_automatically,
            "schema": SWEEP_SCHEMA,
            "versions": packages(),
            "added": list_added("observable"),
        }
        return f"{serving.medium.name}-{hashlib.sha256(to_json(data).encode()).hexdigest()}"

    @property
    def kind(self) -> str:
        """Medium, size of an array and number of loads, on which the time depends most."""
        medium = self.serving.medium
        return f"{medium.name} {medium.settings.get('shape', '')} {len(self.serving.loads)}"

    @property
    def tasks(self) -> list[MediumTask]:
        """The tasks that can run side by side: one for each sample of a simulation, or this task
        itself.
        """
        samples = self.serving.samples
        # bands, directions, edges and observables are found of the mean over samples
        request = replace(self.request, path=None, direction=None, surface=None, observe=())
        tasks: list[MediumTask] = []
        for sample in samples:
            seed = f", seed {sample.medium.settings['seed']}" if len(samples) > 1 else ""
            tasks.append(SampleTask(self.where + seed, sample, request))
        return tasks or [self]

    def join(self, results: Sequence[TaskResult]) -> TaskResult:
        """Return the result of the :attr:`tasks`: samples are averaged, at the loads that all of
        them have reached.
        """
        if not self.serving.arrays:
            return results[0]
        size = self.load.size
        reached = find_reached(results, size)
        samples = [drop_marks(result) for result in results]
        load = self.load if len(reached) == size else self.load[reached]
        records = [
            SampleRecord.from_result(sample, index) for index in reached for sample in samples
        ]
        state = SimulatedState.of(self.simulation, records, load)
        out = self.observe(Analysis(state, self.request.direction))
        if self.request.waves is not None:
            out = add_waves(out, self, load, records)
        marks = _join_marks(results, [np.arange(size)] * len(results))
        return _expand_loads(out, reached, size) | marks

    def state(self, load: Load) -> ContactState:
        """Return the state under ``load``, all or some of the loads of the task."""
        return self.serving.at(load, finite_overlap=self.request.finite_overlap or None)

    def solve(self, begun: TaskResult | None = None) -> TaskResult:
        """Find every variable at every load, and the "warnings" that :func:`tell_warnings` reads.

        An error names its task and, if it is known, its load.
        """
        try:
            analysis = Analysis(self.state(self.load), self.request.direction)
            out = self.observe(analysis)
        except GranphonError as error:
            raise self._locate(error) from error
        records = [] if self.serving.arrays else self.record_networks(analysis.state)
        return add_waves(out, self, self.load, records) if records else out

    def observe(self, analysis: Analysis) -> TaskResult:
        """Return the variables of a state, with an axis of loads, and its "warnings"."""
        state = analysis.state
        request = self.request
        # conditions that hold are kept only where another medium, at other loads, may not meet them
        notes: list[Check | str] = [
            check
            for check in analysis.validity.checks
            if check.failing or self.serving.chosen_automatically
        ]
        numbers, notes_on_numbers = self._observe_numbers(analysis)
        notes += notes_on_numbers
        variables = {name: np.asarray(value) for name, value in numbers.items()}
        if state.is_single:
            variables = {name: values[None] for name, values in variables.items()}
        path = request.find_path(self.serving.packing.structure)
        states = list[ContactState]()
        if request.surface is not None or path is not None:
            states = _split_loads(state)
        if request.surface is not None and state.n_samples:
            notes.append("waves of an edge are left out: those of a simulated array are not known")
        elif request.surface is not None:
            # imported here: other runs do not need surfaces
            from granphon.phonons.surfaces import observe_surface

            edge = request.surface
            distinct = _find_distinct(state, states)
            variables |= observe_surface(states, distinct, edge.axis, edge.edge, edge.points)
        if path is not None:
            bands, notes_on_bands = _observe_bands(state, states, path[0], request.bands)
            variables |= bands
            notes += notes_on_bands
        return variables | {"warnings": _write_notes(notes)}

    def _observe_numbers(self, analysis: Analysis) -> tuple[dict[str, Any], list[str]]:
        """Return the numbers of a state at each load, with velocities and exponents if they are
        requested and known, and notes on those that are not.
        """
        request = self.request
        packing = self.serving.packing
        find = partial(find_all, analysis, swept=True, observed=request.observe)
        notes = list[str]()
        out = find(("state",))
        # a floor or clamp holds the balls, which long waves move
        has_long_waves = packing.repeats and not packing.is_held
        try:
            if request.sound or has_long_waves:
                out |= find(("velocities",))
                notes += warn_of_free_branches(analysis.state, analysis.velocities.velocities)
        except MechanismError as error:
            if request.sound:
                raise
            notes.append(f"velocities and moduli are left out: {error}")
        if request.exponents:
            out |= find(("exponent",))
        return out, [*notes, *warn_of_missing_error(out), *analysis.failed.values()]

    def record_networks(self, state: ContactState, whole: bool = False) -> list[SampleRecord]:
        """Return the records of the network at each load, without samples; none if no waves are
        requested. Errors name the load.

        With ``whole`` the results themselves are kept too.
        """
        records = list[SampleRecord]()
        periods = self.serving.packing.structure.periods
        if self.request.waves is None:
            return records
        # imported here: other runs do not need waves
        from granphon.runs.wave_records import record_networks

        for index in range(self.load.size):
            try:
                single = state if state.is_single else state[index]
                waves = record_networks(single, self.request.waves, whole)
                records.append(SampleRecord(of_waves=waves))
            except GranphonError as error:
                if self.request.alone:
                    raise
                raise error.restate(
                    f"{self.where}, {self.load[index].describe(periods)}: {error}"
                ) from None
        return records

    def _locate(self, error: GranphonError) -> GranphonError:
        """Return an error whose message begins with the task and the load.

        If the load of ``error`` is not known, the error of the first load that fails alone is
        returned instead. The ``load_index`` is the index of the load in the sweep. If no load fails
        alone, ``error`` is returned with the task only.
        """
        if self.request.alone:
            error.load_index = 0 if error.option is None else None
            return error
        periods = self.serving.packing.structure.periods
        if error.option is not None:  # the error is not about a load
            return _name_load(self.where, self.load, None, error, periods)
        # an error of a simulation knows its load, so that nothing is simulated again
        index = error.load_index
        first_error = error
        for number in range(self.load.size) if index is None else ():
            try:
                state = self.state(self.load[[number]])
                self.observe(Analysis(state, self.request.direction))
            except GranphonError as error_alone:
                index = number
                first_error = error_alone
                break
        located = _name_load(self.where, self.load, index, first_error, periods)
        located.load_index = None if index is None else int(self.serving.loads[index])
        return located


def _split_loads(state: ContactState) -> list[ContactState]:
    """Return the state at each load."""
    return [state] if state.is_single else [state[index] for index in range(len(state.force))]


def _find_distinct(state: ContactState, states: list[ContactState]) -> list[ContactState]:
    """Return the states whose lattices differ: in the paper's limit one dispersion relation serves
    all loads, unless the torsion is that of a Hertz contact.
    """
    return states[:1] if state.has_one_lattice else states


def _observe_bands(
    state: ContactState,
    states: list[ContactState],
    qpoints: Array,
    losses: BandsSettings | None,
) -> tuple[TaskResult, list[str]]:
    """Return the frequencies, Hz, at ``qpoints`` (s, p, 3) and each load, with decay and Q of the
    bands where contacts have ``losses``, and notes on them; ``states`` are those at each load.
    """
    # the frequencies that phonopy gives, but from C(q), which needs no force constants
    q = qpoints.reshape(-1, 3)
    shape = (len(states), *qpoints.shape[:2], -1)
    lattices = [distinct.contact_lattice() for distinct in _find_distinct(state, states)]
    paths = [lattice.wavevectors(q) for lattice in lattices]
    reduced = np.array(
        [lattice.frequencies(path) for lattice, path in zip(lattices, paths, strict=True)]
    )
    units = np.array([single.scales.frequency for single in states])  # Hz
    out: TaskResult = {"frequencies": (units[:, None, None] * reduced).reshape(shape)}
    notes = [
        *lattices[0].free_branch_warnings,
        *lattices[0].soft_mode_warnings(paths[0], reduced[0]),
    ]
    if state.n_samples:
        notes.append(LATTICE_BANDS)
    if losses is not None:
        # imported here: other runs do not need phonopy
        from granphon.phonons.phonons import Phonons

        damped = [
            Phonons(single).damped(q, losses.damping, losses.loss_factor) for single in states
        ]
        frequencies = np.array([bands.frequencies.real for bands in damped])
        out["damped_frequency"] = frequencies.reshape(shape)
        out["damped_decay"] = np.array([bands.decay for bands in damped]).reshape(shape)
        out["damped_quality"] = np.array([bands.quality for bands in damped]).reshape(shape)
    return out, notes


def _name_load(
    where: str, load: Load, index: int | None, error: GranphonError, periods: int
) -> GranphonError:
    """Return ``error`` with the task before its message, and the load number ``index`` if it is
    known; the error keeps this number.
    """
    if index is None:
        return error.restate(f"{where}: {error}")
    located = error.restate(f"{where}, {load[index].describe(periods)}: {error}")
    located.load_index = index
    return located


def add_waves(
    out: TaskResult, task: MediumTask, load: Load, records: Sequence[SampleRecord]
) -> TaskResult:
    """Return ``out`` with the means over samples of the waves at the loads of a task, and notes on
    observables that are not known.

    A state without samples has one record at each load. An observable is nan at a load at which it
    is not known, and left out if it is known at no load.
    """
    # imported here: a sweep without waves does not need them
    from granphon.runs.wave_records import average_waves

    assert task.request.waves is not None
    count = len(records) // load.size
    rows = list[dict[str, Array]]()
    indices_of_texts = dict[str, list[int]]()
    for index in range(load.size):
        samples = [record.of_waves for record in records[index * count : (index + 1) * count]]
        row, texts = average_waves(samples, task.request.waves)
        rows.append(row)
        for text in texts:
            indices_of_texts.setdefault(text, []).append(index)
    examples = {name: value for row in rows for name, value in row.items()}
    waves = {
        name: np.array(pad_alike([row.get(name, np.full_like(example, np.nan)) for row in rows]))
        for name, example in examples.items()
    }
    periods = task.serving.packing.structure.periods
    notes = []
    for text, indices in indices_of_texts.items():
        # a note need not name the loads if they are all those of the medium
        if len(indices) < load.size or task.serving.is_part:
            further = f" and {len(indices) - 1} more" if len(indices) > 1 else ""
            text = f"at {load[indices[0]].describe(periods)}{further}, {text}"
        notes.append(text)
    warnings = np.concatenate([out["warnings"], _write_notes(notes)])
    return out | waves | {"warnings": warnings}


# -- of a sample -----------------------------------------------------------------------------------


class SampleTask(MediumTask):
    """One sample of a simulation at all loads, one load in each step.

    The highest load comes first, and the search for each equilibrium starts from the one before, as
    in a simulation that is not cut into tasks. An unfinished result has its loads in this order,
    and the balls at rest under the last of them. With a history of friction all loads are one step.
    """

    @property
    def steps(self) -> int:
        """Number of steps: one for each load, or one for a whole path."""
        return 1 if self.simulation.friction_history else self.load.size

    def done(self, result: TaskResult) -> int:
        """Return the number of steps that a result contains."""
        return 1 if self.simulation.friction_history else len(result["force"])

    def solve(self, begun: TaskResult | None = None) -> TaskResult:
        """Add one load to ``begun``; with the last, return every number of the sample that is
        averaged, (n_loads, ...).
        """
        simulation = self.simulation
        if simulation.friction_history:
            return self._solve_path()
        index: int | None = None
        try:
            loads = simulation.prescribed(self.load)
            order = sort_by_load(loads)
            earlier = dict(begun or {})  # the numbers at the loads before
            start = None
            if earlier:
                start = (earlier.pop("rest_overlap").item(), earlier.pop("rest_balls"))
            index = order[self.done(earlier) if earlier else 0]
            sample = simulation.sample(loads[index], start)
            result = self._record([sample])
        except GranphonError as error:
            if index is not None:
                error.load_index = index
            raise self._locate(error) from error
        if earlier:
            result = {
                name: np.concatenate([earlier[name], value]) for name, value in result.items()
            }
        if self.done(result) < len(order):
            equilibrium = sample.equilibrium
            return result | {
                "rest_overlap": np.array(equilibrium.overlap),
                "rest_balls": equilibrium.balls,
            }
        return {name: value[np.argsort(order)] for name, value in result.items()}

    def _solve_path(self) -> TaskResult:
        """Return every number of a sample along its path of loads with friction; if the path ends
        early, those of the loads before, with marks.
        """
        try:
            return super().solve()
        except GranphonError as error:
            if error.reached is None:
                raise
            size = self.load.size
            history: Any = self.simulation.history
            order = history.sort(self.simulation.prescribed(self.load))
            reached = sorted(order[: len(error.reached.force)])
            marks = {
                _MISSED: np.setdiff1d(np.arange(size), reached),
                _WHY: np.array([str(error)]),
                _END: np.array([-1 if error.load_index is None else error.load_index]),
            }
            return _expand_loads(self._record(error.reached.samples), reached, size) | marks

    def observe(self, analysis: Analysis) -> TaskResult:
        """Return every number of the samples that is averaged, (n_loads, ...), and the balls if
        they are kept.
        """
        return self._record(analysis.state.samples)

    def _record(self, samples: Sequence[Any]) -> TaskResult:
        """Return the numbers of a sample at one or several loads that are averaged, (n_loads, ...),
        and its balls at rest, (1, ...), if they are kept.
        """
        request = self.request
        records = [
            SampleRecord.of(sample, request.waves, request.exponents, request.alone)
            for sample in samples
        ]
        result = SampleRecord.to_result(records)
        if not request.alone:
            return result
        # the balls at rest, each array after an axis of one load
        equilibrium = samples[0].equilibrium
        kept = {
            name: np.asarray(getattr(equilibrium, name))
            for name in _list_kept_fields(type(equilibrium))
        }
        if not isinstance(samples[0], PressedSample):
            # after a history the derivatives follow from the elastic tensors
            kept["derivatives"] = np.array([equilibrium.stiffness, equilibrium.stiffness_slope])
        return result | {_BALLS + name: value[None] for name, value in kept.items()}


class SampleRecord(SimpleNamespace):
    """The numbers of a :class:`~granphon.array.sample.Sample` that a state averages, in SI units,
    under the sample's names.

    A record stands where a state has samples. ``fraction`` is the sample's ``contact_fraction()``,
    and ``of_waves`` are the arrays that :func:`~granphon.runs.wave_records.record_waves` keeps of
    its waves, if any were requested. A record has the numbers of a history of friction, and tensors
    at neighbouring loads, where the sample has them.
    """

    @classmethod
    def of(
        cls,
        sample: Sample | PressedSample,
        waves: WaveSettings | None = None,
        exponents: bool = True,
        whole: bool = False,
    ) -> Self:
        """Record a sample, whose numbers are computed now unless they are known, with the ``waves``
        that are requested.

        Tensors at neighbouring loads are recorded for ``exponents`` of balls that differ. With
        ``whole`` the waves themselves are kept too.
        """
        of_waves: dict[str, Any] = {}
        if waves is not None:
            # imported here: a sweep without waves does not need them
            from granphon.runs.wave_records import record_waves

            of_waves = record_waves(sample, waves, whole)
        names = [*_AVERAGED]
        if exponents and sample.packing.spread_matters:
            names.append("elastic_tensors_beside")
        names += [name for name in HISTORY_UNITS if hasattr(sample, name)]
        numbers = {name: getattr(sample, name) for name in names}
        return cls(**numbers, fraction=sample.contact_fraction(), of_waves=of_waves)

    @classmethod
    def from_result(cls, result: TaskResult, index: int) -> Self:
        """Take the record at one of the loads from the result of a task."""
        values = {name: value[index] for name, value in result.items()}
        numbers = {name: value for name, value in values.items() if "." not in name}
        waves = {
            name.removeprefix(_WAVES): value
            for name, value in values.items()
            if name.startswith(_WAVES)
        }
        return cls(**numbers, of_waves=waves)

    @classmethod
    def to_result(cls, records: Sequence[Self]) -> TaskResult:
        """Stack the records at several loads as the result of a task: each number (n_loads,
        ...).
        """
        rows = [
            vars(record) | {_WAVES + name: value for name, value in record.of_waves.items()}
            for record in records
        ]
        return {
            name: np.array([row[name] for row in rows]) for name in rows[0] if name != "of_waves"
        }

    def contact_fraction(self) -> float:
        """Return the fraction of the contacts that carry load, N_c / 6 on the triangular
        lattice.
        """
        return float(self.fraction)


def restore_sample(simulation: DirectSimulation, result: TaskResult) -> Sample | PressedSample:
    """Return the one sample of a simulation, with the numbers and balls in the ``result`` of its
    task.
    """
    packing = simulation.packing
    seed = simulation.seed_of(0)
    history = simulation.history
    kind: type[Equilibrium] = TrueEquilibrium if simulation.ratio else Equilibrium
    if history.is_loaded:
        kind = PressedEquilibrium
    arrays: dict[str, Any] = {name: result[_BALLS + name][0] for name in _list_kept_fields(kind)}
    equilibrium: Any = kind(
        deviations=read_only(simulation.deviations(0)), lattice=packing.structure, **arrays
    )
    if history.is_loaded:
        response = history.shear_response
        sample: Sample | PressedSample = PressedSample(packing, seed, equilibrium, response)
    else:
        vars(equilibrium)["_derivatives"] = tuple(result[_BALLS + "derivatives"][0].tolist())
        sample = Sample(packing, seed, equilibrium)
    tensors = {name: rows[0] for name, rows in result.items() if name.startswith("elastic_")}
    vars(sample).update(tensors)
    return sample


def _list_kept_fields(kind: type[Equilibrium]) -> list[str]:
    """Return the names of the arrays of an equilibrium that are kept in the result of a task."""
    # the sample is drawn again from its seed
    return [field.name for field in fields(kind) if field.name not in ("deviations", "lattice")]


# -- paths of loads that end early -----------------------------------------------------------------


def _expand_loads(result: TaskResult, reached: Sequence[int], size: int) -> TaskResult:
    """Return a result at the loads of the indices ``reached`` with a row for each of all loads; the
    other rows mean nothing.
    """
    rows = np.zeros(size, int)
    rows[list(reached)] = range(len(reached))
    return {name: value if name == "warnings" else value[rows] for name, value in result.items()}


def drop_marks(result: TaskResult) -> TaskResult:
    """Return a result without its marks."""
    return {name: value for name, value in result.items() if name not in _MARKS}


def find_reached(results: Sequence[TaskResult], size: int) -> list[int]:
    """Return the indices of the loads, of ``size``, that all results have; raise the error of a
    path if no load is reached by all.
    """
    missed = set[int]()
    for result in results:
        missed.update(result[_MISSED].tolist() if _MISSED in result else ())
    if len(missed) == size:
        raise explain_end(results)
    return [index for index in range(size) if index not in missed]


def _join_marks(results: Sequence[TaskResult], loads: Sequence[NDArray[Any]]) -> TaskResult:
    """Return the marks of the join of several results, each at some of the ``loads``; empty if no
    path ended early.
    """
    missed = [
        indices[result[_MISSED]]
        for result, indices in zip(results, loads, strict=True)
        if _MISSED in result
    ]
    if not missed:
        return {}
    ended = [result for result in results if _MISSED in result]
    marks = {name: np.concatenate([result[name] for result in ended]) for name in (_WHY, _END)}
    return {_MISSED: np.unique(np.concatenate(missed))} | marks


def explain_end(results: Sequence[TaskResult]) -> ConvergenceError:
    """Return the error of the first path that ended early."""
    reasons = [reason for result in results for reason in result.get(_WHY, _NONE).tolist()]
    indices = [index for result in results for index in result.get(_END, _NONE).tolist()]
    message = reasons[0]
    if len(reasons) > 1:
        message += f" {counted(len(reasons) - 1, 'more path')} of the sweep ended early."
    error = ConvergenceError(message)
    error.load_index = indices[0] if indices[0] >= 0 else None
    return error


# -- notes -----------------------------------------------------------------------------------------


def _write_notes(notes: Iterable[Check | str]) -> NDArray[Any]:
    """Encode notes on a result, conditions over loads or sentences, as an array of JSON texts, each
    once.
    """
    texts = [
        to_json(note if isinstance(note, str) else list(vars(note).values())) for note in notes
    ]
    return np.array(list(dict.fromkeys(texts)), "S")  # ASCII: one byte for each letter


def _join_notes(results: Iterable[TaskResult]) -> NDArray[Any]:
    """Return the notes on parts of the loads as notes on all of them: each condition and each
    sentence once.
    """
    notes: dict[Any, Check | str] = {}
    for result in results:
        for note in map(_read_note, result["warnings"].tolist()):
            if isinstance(note, str):
                notes[note] = note
                continue
            key = (note.name, note.limit, note.reason, note.at_least)
            check = notes.get(key)
            notes[key] = check.join(note) if isinstance(check, Check) else note
    return _write_notes(notes.values())


def _read_note(text: bytes) -> Check | str:
    """Decode a note, a condition over loads or a sentence, from its JSON text."""
    note = json.loads(text)
    return note if isinstance(note, str) else Check(*note)


def tell_warnings(result: TaskResult) -> list[str]:
    """Return the warnings of a result: a sentence for each condition that fails."""
    sentences = (
        note if isinstance(note, str) else note.warning
        for note in map(_read_note, result["warnings"].tolist())
    )
    return [sentence for sentence in sentences if sentence is not None]
