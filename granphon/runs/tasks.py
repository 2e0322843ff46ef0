"""The cases of a run, and its tasks.

A case is one medium on one packing at many loads. Each of its tasks is one medium at all loads that
it serves, or one sample of a simulation, load by load.

Tasks are plain data, see :mod:`granphon.runs.execution`. Of each sample only the few numbers that
are averaged are kept, and of a single state its balls too, for files and figures of them. The
averages equal those of one simulation of all samples, to the last bit.

A sample that is loaded with friction may not reach all loads of its path. Its task is then done as
far as it goes: the result has the loads that were reached, and as marks the places of the others
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
#: in a result: places of the loads that were not reached, why the path ended, and the place of the
#: load at which it did
_MARKS = _MISSED, _WHY, _AT = "path.missed", "path.why", "path.at"
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
#: what the names of numbers of waves begin with in the result of a task
_WAVES = "waves."
#: what the names of arrays of the balls begin with in the result of a task
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
        found = plain(value)
        return (
            found
            if found is not value
            else {"class": type(value).__qualname__} | getattr(value, "__dict__", {})
        )

    return json.dumps(data, default=write, sort_keys=True)


# -- cases -----------------------------------------------------------------------------------------


@dataclass(frozen=True, eq=False)
class Asked:
    """What is asked of each state.

    Attributes
    ----------
    finite_overlap : whether terms of relative order delta/d are.
    path : that of the bands: letters or corners, points in a segment, and labels of the corners;
        None without bands.
    direction : that of sound, Cartesian, one or many; None for x.
    waves : what is asked of the waves in each sample of a simulation; None for nothing.
    surface : the edge whose waves are asked for; None for none.
    bands : how contacts damp the bands; None for bands without loss alone.
    exponents : whether those of the velocities are, for which a simulation solves two more
        equilibria at each load.
    sound : whether a lattice that has no velocities, a mechanism, is an error; otherwise they are
        left out.
    observe : the words for what is asked, as of a scene; a registered observable among them must be
        found.
    alone : whether it is the only state. The balls of its samples are kept, for files and figures
        of them, and messages need not say which state they are about.
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
    """One medium on one packing, at all values of an applied load, and what is asked of its states.

    ``where`` names the swept parameters of the packing with their values, in words; empty if none
    is swept.
    """

    where: str
    packing: Balls
    medium: MediumChoice
    load: Load
    asked: Asked = Asked()

    @property
    def label(self) -> str:
        """Medium and swept parameters in words, as messages of sweeps name them."""
        return ", ".join(filter(None, (self.medium.label, self.where)))

    def name(self, serving: ServingMedium) -> str:
        """Return the label of one of the media that serve the loads, with its own where it was
        chosen automatically.
        """
        return (
            f"{self.label}: {serving.medium.label}" if serving.chosen_automatically else self.label
        )

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
        """A task for each medium that serves loads; an error names the case, and the load if it is
        known.
        """
        try:
            serving_media = [
                one
                for serving in self.serving_media
                for one in serving.by_geometry(self.asked.finite_overlap)
            ]
        except InputError as error:
            at = error.load_index
            periods = self.packing.structure.periods
            raise _name_load(self.label, self.load, at, error, periods) from error
        # lattices have no waves of their own here, but for those of networks, and their exponents
        # cost nothing
        networks = () if self.asked.waves is None else self.asked.waves.of_networks
        ideal = replace(
            self.asked,
            waves=WaveSettings(of_networks=networks) if networks else None,
            exponents=True,
        )
        return [
            MediumTask(self.name(one), one, self.asked if one.arrays else ideal)
            for one in serving_media
        ]

    @cached_property
    def tasks(self) -> list[MediumTask]:
        """The tasks that can run side by side: of a simulation one for each sample."""
        return [task for one in self.media for task in one.tasks]

    def join(self, parts: Sequence[TaskResult]) -> TaskResult:
        """Put the results of the :attr:`tasks` together; variables that only some of several media
        have are left out.
        """
        left = iter(parts)
        found = list[TaskResult]()
        for one in self.media:
            found.append(one.join(list(islice(left, len(one.tasks)))))
        if len(found) == 1:
            return found[0]
        marks = _join_marks(found, [one.serving.loads for one in self.media])
        found = [drop_marks(part) for part in found]
        order = np.argsort(np.concatenate([one.serving.loads for one in self.media]))
        # notes on parts of the loads become notes on all of them: each condition and each sentence
        # appears once
        notes: dict[Any, Check | str] = {}
        for note in (_read_note(text) for part in found for text in part["warnings"].tolist()):
            key = (
                note
                if isinstance(note, str)
                else (note.name, note.limit, note.reason, note.at_least)
            )
            before = notes.get(key)
            notes[key] = (
                before.join(note) if isinstance(before, Check) and isinstance(note, Check) else note
            )
        out: TaskResult = {"warnings": _write_notes(notes.values())}
        named = {
            name: value for part in found for name, value in part.items() if name != "warnings"
        }
        for name, value in named.items():
            # arrays of one medium in two geometries have the same variables, of which some may be
            # known in one alone
            if (
                all(name in part for part in found)
                or not self.media[0].serving.chosen_automatically
            ):
                rows = [
                    part[name]
                    if name in part
                    else np.full((one.load.size, *value.shape[1:]), np.nan)
                    for part, one in zip(found, self.media, strict=True)
                ]
                out[name] = np.concatenate(pad_alike(rows))[order]
        return out | marks

    def restore(self, parts: Sequence[TaskResult]) -> SimulatedState:
        """Return the only state, that of a simulation, with the samples whose balls the
        :attr:`tasks` kept.
        """
        (serving,) = self.serving_media
        (medium,) = serving.arrays
        samples = [
            restore_sample(task.simulation, part)
            for task, part in zip(self.tasks, parts, strict=True)
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
    asked: Asked = Asked()

    @cached_property
    def cases(self) -> tuple[Case, ...]:
        """The cases, the media running fastest; :class:`~granphon.base.errors.InputError` for an
        impossible packing.
        """
        return tuple(
            Case(where, packing, medium, self.load, self.asked)
            for where, packing in combine(self.packing, self.axes)
            for medium in self.media
        )


def require_arrays(
    media: Sequence[MediumChoice], swept: Iterable[str], names: Iterable[str]
) -> None:
    """Raise :class:`~granphon.base.errors.InputError` if there are no arrays for the waves
    ``names``.

    These are "dos", "spectrum" and "pulse" of simulated arrays themselves. ``swept`` are the
    parameters that are swept.
    """
    wanted = list(names)
    for one in media if wanted else ():
        one.require_arrays(wanted[0])
    if "spectrum" not in wanted:
        return
    if changing := [name for name in swept if name in ("lattice", "motions")]:
        what = f"the spectra of a sweep over {changing[0]} do not fit into one array"
        raise InputError(what, "Their wave vectors or polarisations differ", "Make a scene of each")
    if len({one.settings.get("shape") for one in media}) > 1:
        what = "the spectra of arrays of several shapes do not fit into one array"
        raise InputError(what, "Their wave vectors differ", "Make a scene of each shape")


def pad_alike(arrays: Sequence[Array]) -> list[Array]:
    """Return arrays with as many columns each as the widest has; what one lacks is nan."""
    most = max(one.shape[-1] if one.ndim > 1 else 0 for one in arrays)
    return [
        np.pad(one, [(0, 0)] * (one.ndim - 1) + [(0, most - one.shape[-1])], constant_values=np.nan)
        if one.ndim > 1 and one.shape[-1] < most
        else one
        for one in arrays
    ]


def label_warnings(labelled: Iterable[tuple[str, str]]) -> list[str]:
    """Return warnings of cases, given as (label, text), each after the label of its case; a text of
    many is said once.

    A text that begins with the label, as one about a medium, stands alone.
    """
    labels: dict[str, list[str]] = {}
    for label, text in labelled:
        labels.setdefault(text, []).append(label)
    return [
        f"{first} and {len(others)} more: {text}"
        if others
        else text
        if text.startswith(f"{first} ")
        else f"{first}: {text}"
        for text, (first, *others) in labels.items()
    ]


# -- of a medium -----------------------------------------------------------------------------------


@dataclass(frozen=True, eq=False)
class MediumTask(Task):
    """One medium on one packing at all loads that it serves, which are solved together, in one
    step.
    """

    where: str
    serving: ServingMedium
    asked: Asked

    @property
    def load(self) -> Load:
        """The loads of the task."""
        return self.serving.load

    @property
    def simulation(self) -> DirectSimulation:
        """The simulation of the packing, if it is one."""
        (found,) = self.serving.arrays
        return found

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
            "asked": vars(self.asked),
            "chosen": serving.chosen_automatically,
            "schema": SWEEP_SCHEMA,
            "versions": packages(),
            "added": list_added("observable"),
        }
        return f"{serving.medium.name}-{hashlib.sha256(to_json(data).encode()).hexdigest()}"

    @property
    def kind(self) -> str:
        """Medium, size of an array and number of loads, on which the time depends most."""
        serving = self.serving
        return (
            f"{serving.medium.name} {serving.medium.settings.get('shape', '')} {len(serving.loads)}"
        )

    @property
    def tasks(self) -> list[MediumTask]:
        """The tasks that can run side by side: one for each sample of a simulation, or this task
        itself.
        """
        samples = self.serving.samples
        ends = [f", seed {one.medium.settings['seed']}" * (len(samples) > 1) for one in samples]
        # none is asked for of a sample
        asked = replace(self.asked, path=None, direction=None, surface=None, observe=())
        return [
            SampleTask(self.where + end, one, asked) for end, one in zip(ends, samples, strict=True)
        ] or [self]

    def join(self, parts: Sequence[TaskResult]) -> TaskResult:
        """Return the result of the :attr:`tasks`: samples are averaged, at the loads that all of
        them have reached.
        """
        if not self.serving.arrays:
            return parts[0]
        size = self.load.size
        places = find_reached(parts, self.load.size)
        own = [drop_marks(part) for part in parts]
        load = self.load if len(places) == size else self.load[places]
        records = [SampleRecord.from_part(part, index) for index in places for part in own]
        out = self.observe(
            Analysis(SimulatedState.of(self.simulation, records, load), self.asked.direction)
        )
        if self.asked.waves is not None:
            out = add_waves(out, self, load, records)
        return _expand_loads(out, places, size) | _join_marks(parts, [np.arange(size)] * len(parts))

    def state(self, load: Load) -> ContactState:
        """Return the state under ``load``, all or some of the loads of the task."""
        return self.serving.at(load, finite_overlap=self.asked.finite_overlap or None)

    def solve(self, begun: TaskResult | None = None) -> TaskResult:
        """Find every variable at every load, and the "warnings" that :func:`tell_warnings` reads.

        An error names its task and, if it is known, its load.
        """
        try:
            analysis = Analysis(self.state(self.load), self.asked.direction)
            out = self.observe(analysis)
        except GranphonError as error:
            raise self._locate(error) from error
        records = [] if self.serving.arrays else self.record_networks(analysis.state)
        return add_waves(out, self, self.load, records) if records else out

    def observe(self, analysis: Analysis) -> TaskResult:
        """Return the variables of a state, with an axis of loads, and its "warnings"."""
        state = analysis.state
        asked = self.asked
        # conditions that hold are kept only where another medium, at other loads, may not meet them
        notes: list[Check | str] = [
            one
            for one in analysis.validity.checks
            if one.failing or self.serving.chosen_automatically
        ]
        find = partial(find_all, analysis, swept=True, observed=asked.observe)
        out = find(("state",))
        try:
            # a floor or clamp holds the balls, which long waves move
            if asked.sound or (self.serving.packing.repeats and not self.serving.packing.is_held):
                out |= find(("velocities",))
                notes += warn_of_free_branches(state, analysis.velocities.velocities)
        except MechanismError as error:
            if asked.sound:
                raise
            notes.append(f"velocities and moduli are left out: {error}")
        out |= find(("exponent",)) if asked.exponents else {}
        notes += [*warn_of_missing_error(out), *analysis.failed.values()]
        found = {
            name: np.asarray(value)[None] if state.is_single else np.asarray(value)
            for name, value in out.items()
        }
        # in the paper's limit one dispersion relation serves all loads, unless the torsion is that
        # of a Hertz contact
        way = asked.find_path(self.serving.packing.structure)
        many = not state.is_single and (asked.surface is not None or way is not None)
        loads = [state[i] for i in range(len(state.force))] if many else [state]
        different = loads[:1] if state.has_one_lattice else loads
        if asked.surface is not None and state.n_samples:
            notes.append("waves of an edge are left out: those of a simulated array are not known")
        elif asked.surface is not None:
            # imported here: other runs do not need it
            from granphon.phonons.surfaces import (
                observe_surface,
            )

            of = asked.surface
            found |= observe_surface(loads, different, of.axis, of.edge, of.points)
        if way is not None:
            # the frequencies that phonopy gives, but from C(q), which needs no force constants
            lattices = [one.contact_lattice() for one in different]
            paths = [one.wavevectors(way[0].reshape(-1, 3)) for one in lattices]
            rows = np.array([one.frequencies(q) for one, q in zip(lattices, paths, strict=True)])
            hertz = np.array([one.scales.frequency for one in loads])
            found["frequencies"] = (hertz[:, None, None] * rows).reshape(
                len(loads), *way[0].shape[:2], -1
            )
            notes += [
                *lattices[0].free_branch_warnings,
                *lattices[0].soft_mode_warnings(paths[0], rows[0]),
            ]
            notes += [LATTICE_BANDS] * bool(state.n_samples)
            if (lossy := asked.bands) is not None:
                # imported here: other runs do not need phonopy
                from granphon.phonons.phonons import (
                    Phonons,
                )

                q, shape = way[0].reshape(-1, 3), (len(loads), *way[0].shape[:2], -1)
                damped = [Phonons(one).damped(q, lossy.damping, lossy.loss_factor) for one in loads]
                found["damped_frequency"] = np.array(
                    [one.frequencies.real for one in damped]
                ).reshape(shape)
                found["damped_decay"] = np.array([one.decay for one in damped]).reshape(shape)
                found["damped_quality"] = np.array([one.quality for one in damped]).reshape(shape)
        return found | {"warnings": _write_notes(notes)}

    def record_networks(self, state: ContactState, whole: bool = False) -> list[SampleRecord]:
        """Return what is asked of the network at each load, without samples; nothing if nothing is.
        Errors name the load.

        With ``whole`` the results themselves are kept too.
        """
        records = list[SampleRecord]()
        periods = self.serving.packing.structure.periods
        if self.asked.waves is None:
            return records
        # imported here: other runs do not need it
        from granphon.runs.wave_records import (
            record_networks,
        )

        for index in range(self.load.size):
            try:
                one = state if state.is_single else state[index]
                records.append(SampleRecord(of_waves=record_networks(one, self.asked.waves, whole)))
            except GranphonError as error:
                if self.asked.alone:
                    raise
                raise error.restate(
                    f"{self.where}, {self.load[index].describe(periods)}: {error}"
                ) from None
        return records

    def _locate(self, error: GranphonError) -> GranphonError:
        """Return an error whose message begins with the task and the load.

        It is ``error`` if its load is known, otherwise that of the first load which fails alone;
        its ``load_index`` is the index of that load in the sweep. If no load fails alone, ``error``
        is returned with the task only.
        """
        if self.asked.alone:
            error.load_index = 0 if error.option is None else None
            return error
        periods = self.serving.packing.structure.periods
        if error.option is not None:  # it is not about a load
            return _name_load(self.where, self.load, None, error, periods)
        at = error.load_index
        first = error  # an error of a simulation knows its load: nothing is simulated again
        for index in range(self.load.size) if at is None else ():
            try:
                self.observe(Analysis(self.state(self.load[[index]]), self.asked.direction))
            except GranphonError as alone:
                at = index
                first = alone
                break
        located = _name_load(self.where, self.load, at, first if at is not None else error, periods)
        located.load_index = error.load_index if at is None else int(self.serving.loads[at])
        return located


def _name_load(
    where: str, load: Load, index: int | None, error: GranphonError, periods: int
) -> GranphonError:
    """Return ``error`` with the task, and the load number ``index`` if it is known, which it keeps,
    before its message.
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
    what is not known.

    A state without samples has one record at each load.

    An observable that is not known at some of the loads is nan there; one that is known at none is
    left out.
    """
    # imported here: a sweep without waves does not need it
    from granphon.runs.wave_records import (
        average_waves,
    )

    assert task.asked.waves is not None
    count = len(records) // load.size
    rows = list[dict[str, Array]]()
    said = dict[str, list[int]]()
    for index in range(load.size):
        row, texts = average_waves(
            [one.of_waves for one in records[index * count : (index + 1) * count]], task.asked.waves
        )
        rows.append(row)
        for text in texts:
            said.setdefault(text, []).append(index)
    known = {name: value for row in rows for name, value in row.items()}
    found = {
        name: np.array(pad_alike([row.get(name, np.full_like(one, np.nan)) for row in rows]))
        for name, one in known.items()
    }
    notes = []
    for text, indices in said.items():
        more = f" and {len(indices) - 1} more" if len(indices) > 1 else ""
        where = f"at {load[indices[0]].describe(task.serving.packing.structure.periods)}{more}, "
        # a note need not name the loads if they are all those of the medium
        notes.append(
            text if len(indices) == load.size and not task.serving.is_part else where + text
        )
    return out | found | {"warnings": np.concatenate([out["warnings"], _write_notes(notes)])}


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

    def done(self, part: TaskResult) -> int:
        """Return the number of steps that a result contains."""
        return 1 if self.simulation.friction_history else len(part["force"])

    def solve(self, begun: TaskResult | None = None) -> TaskResult:
        """Add one load to ``begun``; with the last, return every number of the sample that is
        averaged, (n_loads, ...).
        """
        simulation = self.simulation
        size = self.load.size
        if simulation.friction_history:
            try:
                return super().solve()
            except GranphonError as error:
                if error.reached is None:
                    raise
                # the path has ended early: the result is that at the loads before, marked with the
                # error
                history: Any = simulation.history
                order = history.sort(simulation.prescribed(self.load))
                places = sorted(order[: len(error.reached.force)])
                at = -1 if error.load_index is None else error.load_index
                marks = {
                    _MISSED: np.setdiff1d(np.arange(size), places),
                    _WHY: np.array([str(error)]),
                    _AT: np.array([at]),
                }
                return _expand_loads(self._record(error.reached.samples), places, size) | marks
        index: int | None = None
        try:
            loads = simulation.prescribed(self.load)
            order = sort_by_load(loads)
            so_far = dict(begun or {})
            before = (
                (so_far.pop("rest_overlap").item(), so_far.pop("rest_balls")) if so_far else None
            )
            index = order[self.done(so_far) if so_far else 0]
            sample = simulation.sample(loads[index], before)
            found = self._record([sample])
        except GranphonError as error:
            if index is not None:
                error.load_index = index
            raise self._locate(error) from error
        found = {
            name: np.concatenate([so_far[name], value]) if so_far else value
            for name, value in found.items()
        }
        if self.done(found) < len(order):
            rest = sample.equilibrium
            return found | {"rest_overlap": np.array(rest.overlap), "rest_balls": rest.balls}
        return {name: value[np.argsort(order)] for name, value in found.items()}

    def observe(self, analysis: Analysis) -> TaskResult:
        """Return every number of the samples that is averaged, (n_loads, ...), and the balls if
        they are kept.
        """
        return self._record(analysis.state.samples)

    def _record(self, samples: Sequence[Any]) -> TaskResult:
        asked = self.asked
        found = SampleRecord.to_part(
            [SampleRecord.of(one, asked.waves, asked.exponents, asked.alone) for one in samples]
        )
        if not asked.alone:
            return found
        # the balls at rest, each array after an axis of one load
        rest = samples[0].equilibrium
        kept = {name: np.asarray(getattr(rest, name)) for name in _list_kept(type(rest))}
        if not isinstance(samples[0], PressedSample):
            # after a history they follow from the elastic tensors
            kept["derivatives"] = np.array([rest.stiffness, rest.stiffness_slope])
        return found | {_BALLS + name: value[None] for name, value in kept.items()}


class SampleRecord(SimpleNamespace):
    """The numbers of a :class:`~granphon.array.sample.Sample` that a state averages, in SI units,
    under the sample's names.

    It stands where the state has samples. ``fraction`` is the sample's ``contact_fraction()``, and
    ``of_waves`` what :func:`~granphon.runs.wave_records.record_waves` found of its waves, if
    anything was asked for. Numbers of a history of friction, and tensors at neighbouring loads, are
    there where the sample has them.
    """

    @classmethod
    def of(
        cls,
        sample: Sample | PressedSample,
        waves: WaveSettings | None = None,
        exponents: bool = True,
        whole: bool = False,
    ) -> Self:
        """Record a sample; what it has not computed yet is computed now, with the ``waves`` that
        are asked for.

        There are tensors at neighbouring loads for ``exponents`` of balls that differ. With
        ``whole`` the waves themselves are kept too.
        """
        found: dict[str, Any] = {}
        if waves is not None:
            # imported here: a sweep without waves does not need it
            from granphon.runs.wave_records import (
                record_waves,
            )

            found = record_waves(sample, waves, whole)
        beside = ("elastic_tensors_beside",) * bool(exponents and sample.packing.spread_matters)
        names = (*_AVERAGED, *beside, *(name for name in HISTORY_UNITS if hasattr(sample, name)))
        return cls(
            **{name: getattr(sample, name) for name in names},
            fraction=sample.contact_fraction(),
            of_waves=found,
        )

    @classmethod
    def from_part(cls, part: TaskResult, index: int) -> Self:
        """Take the record at one of the loads from the result of a task."""
        numbers = {name: value[index] for name, value in part.items()}
        waves = {
            name.removeprefix(_WAVES): value
            for name, value in numbers.items()
            if name.startswith(_WAVES)
        }
        return cls(
            **{name: value for name, value in numbers.items() if "." not in name}, of_waves=waves
        )

    @classmethod
    def to_part(cls, records: Sequence[Self]) -> TaskResult:
        """Stack the records at several loads as the result of a task: each number (n_loads,
        ...).
        """
        rows = [
            vars(one) | {_WAVES + name: value for name, value in one.of_waves.items()}
            for one in records
        ]
        return {
            name: np.array([row[name] for row in rows]) for name in rows[0] if name != "of_waves"
        }

    def contact_fraction(self) -> float:
        """Return the fraction of the contacts that carry load, N_c / 6 on the triangular
        lattice.
        """
        return float(self.fraction)


def restore_sample(simulation: DirectSimulation, part: TaskResult) -> Sample | PressedSample:
    """Return the one sample of a simulation, with what a task has found of it and its balls."""
    packing = simulation.packing
    seed = simulation.seed_of(0)
    history = simulation.history
    kind = (
        PressedEquilibrium
        if history.is_loaded
        else TrueEquilibrium
        if simulation.ratio
        else Equilibrium
    )
    given: dict[str, Any] = {name: part[_BALLS + name][0] for name in _list_kept(kind)}
    rest: Any = kind(
        deviations=read_only(simulation.deviations(0)), lattice=packing.structure, **given
    )
    if not history.is_loaded:
        vars(rest)["_derivatives"] = tuple(part[_BALLS + "derivatives"][0].tolist())
        sample: Sample | PressedSample = Sample(packing, seed, rest)
    else:
        sample = PressedSample(packing, seed, rest, history.shear_response)
    vars(sample).update({name: one[0] for name, one in part.items() if name.startswith("elastic_")})
    return sample


def _list_kept(kind: type[Equilibrium]) -> list[str]:
    # the sample is drawn again from its seed
    return [one.name for one in fields(kind) if one.name not in ("deviations", "lattice")]


# -- paths of loads that end early -----------------------------------------------------------------


def _expand_loads(part: TaskResult, places: Sequence[int], size: int) -> TaskResult:
    """Return a result at the loads in ``places`` with a row for each of all loads; the other rows
    mean nothing.
    """
    rows = np.zeros(size, int)
    rows[list(places)] = range(len(places))
    return {name: value if name == "warnings" else value[rows] for name, value in part.items()}


def drop_marks(part: TaskResult) -> TaskResult:
    """Return a result without its marks."""
    return {name: value for name, value in part.items() if name not in _MARKS}


def find_reached(parts: Sequence[TaskResult], size: int) -> list[int]:
    """Return the places of the loads, of ``size``, that all results have; raise the error of a path
    if there is none.
    """
    missed = {place for part in parts if _MISSED in part for place in part[_MISSED].tolist()}
    if len(missed) == size:
        raise explain_end(parts)
    return [place for place in range(size) if place not in missed]


def _join_marks(parts: Sequence[TaskResult], loads: Sequence[NDArray[Any]]) -> TaskResult:
    """Return the marks of what is made of several results, each at some of the ``loads``; nothing
    if no path ended early.
    """
    ended = [(part, own) for part, own in zip(parts, loads, strict=True) if _MISSED in part]
    if not ended:
        return {}
    missed = np.unique(np.concatenate([own[part[_MISSED]] for part, own in ended]))
    return {_MISSED: missed} | {
        name: np.concatenate([part[name] for part, _ in ended]) for name in (_WHY, _AT)
    }


def explain_end(parts: Sequence[TaskResult]) -> ConvergenceError:
    """Return the error of the first path that ended early."""
    whys, places = (
        [one for part in parts if name in part for one in part[name].tolist()]
        for name in (_WHY, _AT)
    )
    more = (
        ""
        if len(whys) == 1
        else f" {counted(len(whys) - 1, 'more path')} of the sweep ended early."
    )
    error = ConvergenceError(whys[0] + more)
    error.load_index = places[0] if places[0] >= 0 else None
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


def _read_note(text: bytes) -> Check | str:
    note = json.loads(text)
    return note if isinstance(note, str) else Check(*note)


def tell_warnings(part: TaskResult) -> list[str]:
    """Return the warnings of a result: a sentence for each condition that fails."""
    sentences = (
        note if isinstance(note, str) else note.warning
        for note in map(_read_note, part["warnings"].tolist())
    )
    return [sentence for sentence in sentences if sentence is not None]
