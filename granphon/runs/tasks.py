"""The cases of a run, and its tasks.

A case is one medium on one packing at many loads. Each of its tasks is one medium at all loads that
it serves, or one sample of a simulation, load by load.

Tasks are plain data, see :mod:`granphon.runs.execution`. Of each sample only the few numbers that
are averaged are kept; the one state of a sweep without axes is kept with its balls, for files and
figures. The averages equal those of one simulation of all samples, to the last bit.

A sample that is loaded with friction may not reach all loads of its path. Its task is then done as
far as it goes: the result has the loads that were reached, and as marks the indices of the others
and why the path ended. When all tasks are done, the run is an error, with the data set at the loads
that all tasks have reached.
"""

from __future__ import annotations

import hashlib
import json
import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property, partial
from itertools import islice
from types import SimpleNamespace
from typing import TYPE_CHECKING, Any, Self

import numpy as np
from numpy.typing import NDArray

from granphon.balls.ball import Ball
from granphon.balls.lattices import Lattice
from granphon.balls.loads import Load
from granphon.balls.packing import (
    LOSS_PARAMETERS,
    Axis,
    change_packing,
    combine,
    describe_combination,
)
from granphon.base.arrays import pad_columns
from granphon.base.errors import ConvergenceError, GranphonError, InputError, MechanismError
from granphon.base.registry import list_added
from granphon.base.results import plain
from granphon.base.text import counted
from granphon.media.array_options import HISTORY_UNITS, sort_by_load
from granphon.media.choice import MediumChoice, ServingMedium
from granphon.media.limits import Check
from granphon.media.newtons import write_newtons
from granphon.media.state import ContactState
from granphon.observables.catalogue import Analysis, explain_missing_error, find_all
from granphon.observables.velocities import explain_free_branches
from granphon.phonons.paths import BandPath, interpolate_path, special_points
from granphon.runs.execution import Task
from granphon.runs.finished_tasks import TaskResult
from granphon.runs.workers import packages
from granphon.waves.settings import (
    BandsSettings,
    SurfaceSettings,
    WaveSettings,
    is_of_wall,
)

if TYPE_CHECKING:
    from granphon.array.options import ReducedLoad
    from granphon.array.pressed_sample import PressedSample
    from granphon.array.sample import Sample
    from granphon.media.arrangement import Balls
    from granphon.media.simulation import DirectSimulation, SimulatedState
    from granphon.phonons.bands import Bands
    from granphon.phonons.phonons import Phonons

Array = NDArray[Any]
#: warning that goes with the bands of a simulation
LATTICE_BANDS = (
    "bands, their edges and densities of states are those of a regular lattice with the mean"
    " stiffness of the samples, without disorder. Those of the disordered arrays are sample_dos and"
    " spectrum, of a sweep sweep_dos and sweep_spectra: observe [dos, spectrum]"
)
#: the observables that are sought in the whole zone of wave vectors
OF_ZONE = ("gaps", "cutoffs", "onsets")
#: name of the mark of a result that holds the indices of the loads that were not reached
_MISSED = "path.missed"
#: name of the mark that says why the path ended, a text
_WHY = "path.why"
#: name of the mark that holds the index of the load at which the path ended, -1 if it is not known
_END = "path.at"
_MARKS = (_MISSED, _WHY, _END)
#: what stands for a mark of a path that did not end early
_NO_MARKS = np.zeros(0)
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
    """Return ``data`` as a JSON text; equal data of the same types give the same text. An object of
    a user is the name of its class and the attributes in its ``__dict__``, without which objects of
    one class cannot be told apart.
    """

    def simplify(value: Any) -> Any:
        """Return plain data for a ``value`` that is none: what :func:`plain` makes of the value,
        or, of an object that :func:`plain` does not know, the name of its class and its attributes.
        """
        plain_value = plain(value)
        if plain_value is not value:
            return plain_value
        return {"class": type(value).__qualname__} | getattr(value, "__dict__", {})

    return json.dumps(data, default=simplify, sort_keys=True)


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
        be found, and derivatives by parameters are those of cut-off frequencies and of waves of an
        edge too if these are among them.
    kept : whether states are kept whole, for files and figures of them: with the balls of their
        samples, and the results of the solvers of waves. A :class:`Grid` keeps the state of a sweep
        without axes.
    modes : whether a state that is kept has bands with eigenvectors, for its files; the data set
        then has the frequencies of these bands. The path of the bands is then a list of arrays.
    """

    finite_overlap: bool = False
    path: tuple[Any, int, Sequence[str] | None] | None = None
    direction: tuple[Any, ...] | None = None
    waves: WaveSettings | None = None
    surface: SurfaceSettings | None = None
    bands: BandsSettings | None = None
    exponents: bool = True
    sound: bool = True
    kept: bool = False
    modes: bool = False
    observe: tuple[str, ...] = ("velocities",)

    @property
    def of_zone(self) -> tuple[str, ...]:
        """The names of the observables that are sought in the whole zone of wave vectors."""
        return tuple(name for name in OF_ZONE if name in self.observe)

    def with_losses(self, losses: Mapping[str, float]) -> Request:
        """Return the request with other ``losses``, by name, in all settings that have them."""
        waves = self.waves and self.waves.with_losses(losses)
        return replace(self, waves=waves, bands=self.bands and self.bands.with_losses(losses))

    def with_walls(self, values: Mapping[str, float], kinds: Mapping[str, Ball]) -> Request:
        """Return the request with other ``values`` of the parameters of walls at which networks and
        surfaces end; ``kinds`` are the kinds of balls.
        """
        waves = self.waves and self.waves.with_walls(values, kinds)
        surface = self.surface and self.surface.with_walls(values, kinds)
        return replace(self, waves=waves, surface=surface)

    def find_bands(self, state: ContactState) -> Bands:
        """Return the bands of a kept state along the path, with eigenvectors; the state keeps them.
        Only for a request of ``modes``.
        """
        # imported here: other runs do not need phonons
        from granphon.phonons.phonons import find_bands

        assert self.path is not None
        pieces, npoints, labels = self.path
        path = BandPath(pieces, None if labels is None else tuple(labels))
        return state.cached(find_bands, path, npoints)

    def find_path(self, structure: Lattice) -> tuple[Array, tuple[str, ...]] | None:
        """Return the points along the path of the bands in the zone of a ``structure``, (s, p, 3)
        for p points in each of s segments, fractions of the reciprocal cell, and the labels
        (s + 1,) of its corners; None without bands. Raises what
        :func:`~granphon.phonons.paths.interpolate_path` raises.
        """
        if self.path is None:
            return None
        corners, npoints, labels = self.path
        letters = special_points(structure.vectors) if isinstance(corners, str) else {}
        return interpolate_path(corners, npoints, letters, labels, structure.periods)


@dataclass(frozen=True, eq=False)
class Written:
    """How a user wrote the values of a sweep, for messages.

    Attributes
    ----------
    units : the unit of the load and of each parameter, by name; SI units with decimal prefixes
        where there is none.
    load : the load as it was given, such as a side force; None if that is the load of contacts.
    """

    units: Mapping[str, str] = field(default_factory=dict)
    load: Load | None = None


@dataclass(frozen=True, eq=False)
class Case:
    """One medium on one packing, at all values of an applied load, and the request of its states.

    ``values`` holds the names of the swept parameters of the packing and their values as texts;
    empty if none is swept. ``written`` says how a user wrote the load and the values.
    """

    values: tuple[tuple[str, str], ...]
    packing: Balls
    medium: MediumChoice
    load: Load
    request: Request = Request()
    written: Written = Written()

    @property
    def where(self) -> str:
        """The swept parameters with their values, in words; empty if none is swept."""
        return describe_combination(self.values)

    @property
    def label(self) -> str:
        """Medium and swept parameters in words, as messages of sweeps name them."""
        return ", ".join(filter(None, (self.medium.label, self.where)))

    def name(self, serving: ServingMedium) -> str:
        """Return the label of ``serving``, one of the media that serve the loads: the label of the
        case, and behind it, where the medium was chosen automatically, that of the medium itself.
        """
        if serving.chosen_automatically:
            return f"{self.label}: {serving.medium.label}"
        return self.label

    @cached_property
    def serving_media(self) -> list[ServingMedium]:
        """The media that serve the loads, each with its loads: the medium itself, or those that an
        automatic medium chooses.

        The media are chosen once for a case. :class:`~granphon.base.errors.InputError` if the
        packing has no such medium, or if none can be chosen.
        """
        return self.medium.choose(self.packing, self.load)

    @cached_property
    def state(self) -> ContactState:
        """The state under the first load. Where states are kept, :meth:`join` replaces the state of
        a simulation by the one that is made from the results of its samples, with their balls.
        """
        return self.solve(0)

    def solve(self, index: int) -> ContactState:
        """Return the state under the load number ``index``; InputError if double precision does not
        hold its scales.
        """
        serving = next(serving for serving in self.serving_media if index in serving.loads)
        with np.errstate(all="ignore"):  # what overflows is refused
            state = serving.at(self.load[index], finite_overlap=self.request.finite_overlap)
        for scale in (state.scales.frequency, state.scales.velocity):
            if not 0.0 < scale < math.inf:
                raise InputError("the frequencies or velocities are beyond double precision")
        return state

    @cached_property
    def serving_in_geometry(self) -> list[ServingMedium]:
        """The media that serve the loads, each split by the geometries that it has at its loads,
        see :meth:`~granphon.media.choice.ServingMedium.by_geometry`. The message of an InputError
        names the case and, if it is known, the load.
        """
        try:
            return [
                serving
                for serving_all in self.serving_media
                for serving in serving_all.by_geometry(self.request.finite_overlap)
            ]
        except InputError as error:
            lattice = self.packing.structure
            raise _name_load(self.label, self.load, error.load_index, error, lattice) from error

    @property
    def finite_overlaps(self) -> Array:
        """Whether the state at each load has the terms of relative order delta/d, (loads,); the
        states need not be solved for that. Errors are those of :attr:`serving_in_geometry`.
        """
        finite_overlaps = np.empty(self.load.size, bool)
        for serving in self.serving_in_geometry:
            is_finite = serving.has_finite_overlap(self.request.finite_overlap)
            finite_overlaps[serving.loads] = is_finite
        return finite_overlaps

    @cached_property
    def media(self) -> list[MediumTask]:
        """A task for each medium of :attr:`serving_in_geometry`. Raises the errors of that property
        and, where states are kept, those of :attr:`state`.
        """
        # lattices, but for packings in files, have no waves but those of networks, and their
        # exponents cost nothing
        lattice_waves = self.request.waves
        if lattice_waves is not None and not self.packing.is_network:
            networks = lattice_waves.of_networks
            lattice_waves = WaveSettings(of_networks=networks) if networks else None
        lattice_request = replace(self.request, waves=lattice_waves, exponents=True)
        tasks = list[MediumTask]()
        for serving in self.serving_in_geometry:
            request = self.request
            state = None
            if not serving.arrays:
                request = lattice_request
                # a state that is kept has been found by the check of its case
                state = self.state if request.kept else None
            tasks.append(MediumTask(self.name(serving), serving, request, state))
        return tasks

    @cached_property
    def tasks(self) -> list[MediumTask]:
        """The tasks that can run side by side, medium by medium: of a simulation one for each
        sample, of another medium one.
        """
        return [task for medium_task in self.media for task in medium_task.tasks]

    def join(self, results: Sequence[TaskResult]) -> TaskResult:
        """Return the result of the case, arrays (loads, ...) by name, from the ``results`` of the
        :attr:`tasks`.

        Of media that were chosen automatically, variables that only some have are left out. Of a
        named medium in two geometries, variables that one geometry alone has are nan in the other.
        Where states are kept, the state of a simulation, with the balls of its samples, is made
        from the results, replaces :attr:`state`, and is what the variables are found from.
        """
        media = self.media
        if self.request.kept and media[0].known_state is None:
            vars(self)["state"] = self._restore(results)
            return replace(media[0], known_state=self.state).solve()
        remaining = iter(results)
        of_media = [medium.join(list(islice(remaining, len(medium.tasks)))) for medium in media]
        if len(of_media) == 1:
            return of_media[0]
        loads = [medium.serving.loads for medium in media]
        marks = _join_marks(of_media, loads)
        of_media = [drop_marks(result) for result in of_media]
        order = np.argsort(np.concatenate(loads))
        joined: TaskResult = {"warnings": _join_notes(of_media)}
        examples = dict[str, Array]()
        for result in of_media:
            examples |= result
        del examples["warnings"]
        names = list(examples)
        if media[0].serving.chosen_automatically:
            # media that differ are compared in what all of them have; arrays of one medium in two
            # geometries have the same variables, of which some may be known in one alone
            names = [name for name in names if all(name in result for result in of_media)]
        for name in names:
            example = examples[name]
            blocks = list[Array]()
            for result, medium in zip(of_media, media, strict=True):
                unknown = np.full((medium.load.size, *example.shape[1:]), np.nan)
                blocks.append(result.get(name, unknown))
            joined[name] = np.concatenate(pad_columns(blocks))[order]
        return joined | marks

    def _restore(self, results: Sequence[TaskResult]) -> SimulatedState:
        """Return the only state of the case, that of a simulation, from the ``results`` of the
        :attr:`tasks`, each with the balls of one sample.
        """
        (serving,) = self.serving_media
        (medium,) = serving.arrays
        samples = [
            restore_sample(task.simulation, result)
            for task, result in zip(self.tasks, results, strict=True)
        ]
        return _average_samples(serving, medium, samples, serving.load.applied[0])


@dataclass(frozen=True, eq=False)
class Grid:
    """Every medium at every combination of the values of the ``axes`` of a packing, under an
    applied load, with the ``request`` of the states; ``written`` says how a user wrote the values.
    """

    packing: Balls
    axes: Sequence[Axis]
    media: Sequence[MediumChoice]
    load: Load
    request: Request = Request()
    written: Written = Written()

    @cached_property
    def swept(self) -> dict[str, int]:
        """The axes along which states lie, see :func:`list_swept`."""
        return list_swept(self.load, self.media, [(axis.name, axis.values) for axis in self.axes])

    @cached_property
    def cases(self) -> tuple[Case, ...]:
        """The cases, the media running fastest; :class:`~granphon.base.errors.InputError` for an
        impossible packing.
        """
        return tuple(
            Case(values, packing, medium, self.load, request, self.written)
            for values, (packing, request) in combine(self.change, self.axes, self.written.units)
            for medium in self.media
        )

    def change(self, values: Mapping[str, Any]) -> tuple[Balls, Request]:
        """Return the packing and the request with other ``values`` of parameters, by name; the
        request keeps states if the grid has one state alone.

        Values of losses and of walls change the request, and all others the packing.
        """
        loss_values = {name: value for name, value in values.items() if name in LOSS_PARAMETERS}
        wall_values = {name: value for name, value in values.items() if is_of_wall(name)}
        request_names = loss_values | wall_values
        ball_values = {name: value for name, value in values.items() if name not in request_names}
        packing = change_packing(self.packing, ball_values)
        request = replace(self.request, kept=not self.swept)
        if loss_values:
            request = request.with_losses(loss_values)
        if wall_values:
            from granphon.media.arrangement import find_kinds  # other sweeps have no kinds

            request = request.with_walls(wall_values, find_kinds(packing))
        return packing, request


def list_swept(
    load: Load, media: Sequence[Any], parameters: Iterable[tuple[str, Sequence[Any]]]
) -> dict[str, int]:
    """Return the axes along which the states of a sweep lie, each with the number of its values:
    "load" and "medium" where the values of the ``load`` or the ``media`` are several, and each of
    the swept ``parameters``, pairs of a name and values. One state has no axes.
    """
    counts = {"load": load.size, "medium": len(media)}
    axes = {name: count for name, count in counts.items() if count > 1}
    return axes | {name: len(values) for name, values in parameters}


def require_arrays(
    media: Sequence[MediumChoice], lattice: Lattice, swept: Iterable[str], names: Iterable[str]
) -> None:
    """Raise :class:`~granphon.base.errors.InputError` if one of the ``media`` is no simulation. Of
    spectra also raise it for arrays of several shapes, and for a sweep over lattices or motions.

    ``names`` are those of the waves of simulated arrays that are requested, "dos", "spectrum" and
    "pulse"; without names nothing is raised. ``swept`` are the names of the parameters that are
    swept, and the ``lattice`` gives the shape of an array that is not named.
    """
    wave_names = list(names)
    if not wave_names:
        return
    for choice in media:
        choice.require_arrays(wave_names[0])
    if "spectrum" not in wave_names:
        return
    for parameter in swept:
        if parameter in ("lattice", "motions"):
            problem = f"the spectra of a sweep over {parameter} do not fit into one array"
            why = "Their wave vectors or polarisations differ"
            raise InputError(problem, why, "Make a scene of each")
    shapes = {choice.settings_on(lattice)["shape"] for choice in media}
    if len(shapes) > 1:
        problem = "the spectra of arrays of several shapes do not fit into one array"
        raise InputError(problem, "Their wave vectors differ", "Make a scene of each shape")


# -- of a medium -----------------------------------------------------------------------------------


@dataclass(frozen=True, eq=False)
class MediumTask(Task):
    """One medium on one packing at all loads that it serves, which are solved together, in one
    step.

    Attributes
    ----------
    where : the task in words, for messages.
    serving : the medium with its packing and its loads.
    request : what is found of the state at each load.
    known_state : the state at the loads, if it was found before; None if the task is to find it.
    """

    where: str
    serving: ServingMedium
    request: Request
    known_state: ContactState | None = None

    @property
    def load(self) -> Load:
        """The loads of the task."""
        return self.serving.load

    @cached_property
    def simulation(self) -> DirectSimulation:
        """The simulation that is the medium of the task; ValueError if the medium is another."""
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
        """Words for the medium, the shape of an array and the number of loads: tasks of one kind
        take similar times.
        """
        medium = self.serving.medium
        return f"{medium.name} {medium.settings.get('shape', '')} {len(self.serving.loads)}"

    @property
    def tasks(self) -> list[MediumTask]:
        """The tasks that can run side by side: one for each sample of a simulation; for another
        medium, and where the state is known, this task alone.
        """
        samples = self.serving.samples if self.known_state is None else []
        # what is left out here is found in join, from the mean over samples
        request = replace(
            self.request,
            path=None,
            direction=None,
            surface=None,
            observe=(),
        )
        tasks: list[MediumTask] = []
        for sample in samples:
            seed = sample.medium.settings["seed"]
            where = f"{self.where}, seed {seed}" if len(samples) > 1 else self.where
            tasks.append(SampleTask(where, sample, request))
        return tasks or [self]

    def join(self, results: Sequence[TaskResult]) -> TaskResult:
        """Return the result of the medium, arrays (loads, ...) by name, from the ``results`` of the
        :attr:`tasks`.

        The variables are those of the mean over samples, at the loads that all samples have
        reached. At the other loads the rows mean nothing, and the result has marks that name these
        loads. Raises ConvergenceError if there is no load that all samples have reached.
        """
        if self.known_state is not None or not self.serving.arrays:
            return results[0]
        n_loads = self.load.size
        reached = find_reached(results, n_loads)
        samples = [drop_marks(result) for result in results]
        load = self.load if len(reached) == n_loads else self.load[reached]
        records = [
            SampleRecord.from_result(sample, index) for index in reached for sample in samples
        ]
        state = _average_samples(self.serving, self.simulation, records, load)
        averages = self._observe_under(load, state)
        marks = _join_marks(results, [np.arange(n_loads)] * len(results))
        return _expand_loads(averages, reached, n_loads) | marks

    def state(self, load: Load) -> ContactState:
        """Return the state under ``load``, all or some of the loads of the task; a known state is
        returned as it is, under all loads.
        """
        if self.known_state is not None:
            return self.known_state
        return self.serving.at(load, finite_overlap=self.request.finite_overlap)

    def solve(self, begun: TaskResult | None = None) -> TaskResult:
        """Find the state at the loads, and return its variables (loads, ...) by name, with the
        "warnings" that :func:`read_notes` reads. ``begun`` is not used, as the task has one step.

        The message of a GranphonError names the task and, if it is known, the load.
        """
        try:
            state = self.state(self.load)
            return self._observe_under(self.load, state)
        except GranphonError as error:
            raise self._locate(error) from error

    def _observe_under(self, load: Load, state: ContactState) -> TaskResult:
        """Return the variables of a state at its ``load``, with its waves and its derivatives by
        the parameters, if these are requested.
        """
        variables = self.observe(state)
        request = self.request
        if "sensitivities" in request.observe:
            # imported here: other runs do not need derivatives
            from granphon.runs.sensitivities import observe_sensitivities

            derivatives, notes = observe_sensitivities(
                self.serving,
                load,
                request.direction,
                finite_overlap=request.finite_overlap,
                has_cutoffs="cutoffs" in request.observe,
                surface=request.surface,
            )
            warnings = np.concatenate([variables["warnings"], _write_notes(notes)])
            variables |= derivatives | {"warnings": warnings}
        return self._add_waves(variables, state, load)

    def _add_waves(self, variables: TaskResult, state: ContactState, load: Load) -> TaskResult:
        """Return the ``variables`` of a state at its ``load`` with its waves, if waves are
        requested.
        """
        if self.request.waves is None:
            return variables
        return add_waves(variables, self, load, self.list_records(state))

    def observe(self, state: ContactState) -> TaskResult:
        """Return the variables of a state (loads, ...) by name, and its "warnings".

        Waves of an edge are left out of simulated arrays, and bands are those of a lattice with the
        mean stiffness: notes say so. Conditions of validity that hold are among the notes where a
        medium was chosen automatically.
        """
        request = self.request
        # a known state outlives the task, and keeps its analysis for others who ask for it
        make_analysis = Analysis if self.known_state is None else find_analysis
        analysis = make_analysis(state, request.direction)
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
        if request.surface is not None and state.n_samples:
            notes.append("waves of an edge are left out: those of a simulated array are not known")
        elif request.surface is not None:
            from granphon.media.arrangement import find_kinds  # other runs have no kinds

            kinds = find_kinds(self.serving.packing)
            variables |= _observe_edge(state, request.surface.with_materials(kinds))
        if request.of_zone:
            variables |= _observe_zone(state, request)
            if state.n_samples:
                notes.append(LATTICE_BANDS)
        path = request.find_path(self.serving.packing.structure)
        if path is not None:
            qpoints, _labels = path
            has_modes = request.modes and self.known_state is not None
            known_bands = request.find_bands(state) if has_modes else None
            bands, notes_on_bands = _observe_bands(state, qpoints, request.bands, known_bands)
            variables |= bands
            notes += notes_on_bands
        return variables | {"warnings": _write_notes(notes)}

    def _observe_numbers(self, analysis: Analysis) -> tuple[dict[str, Any], list[str]]:
        """Return the numbers of the state of an ``analysis`` by name, at each load (loads, ...) or,
        of a single state, without this axis, and notes on numbers that are not known.

        The numbers are the attributes of the state; velocities and moduli if long waves move all
        balls, or if a lattice without velocities is an error (``sound`` of the request); and
        exponents if these are requested. Raises MechanismError if such a lattice is an error;
        otherwise a note says that velocities and moduli are left out.
        """
        request = self.request
        packing = self.serving.packing
        find_numbers = partial(find_all, analysis, swept=True, observed=request.observe)
        notes = list[str]()
        numbers = find_numbers(("state",))
        # long waves move all balls, of which a floor or a clamp holds some
        has_long_waves = packing.repeats and not packing.is_held
        try:
            if request.sound or has_long_waves:
                numbers |= find_numbers(("velocities",))
                notes += explain_free_branches(analysis.state, analysis.velocities.velocities)
        except MechanismError as error:
            if request.sound:
                raise
            notes.append(f"velocities and moduli are left out: {error}")
        if request.exponents:
            numbers |= find_numbers(("exponent",))
        notes += explain_missing_error(numbers)
        notes += analysis.failed.values()
        return numbers, notes

    def list_records(self, state: ContactState) -> Sequence[Any]:
        """Return the records of the waves of a state: those of each sample at each load, or, of a
        state without samples, that of its network at each load.

        Where states are kept, the records of networks hold the results of the solvers too, and the
        state keeps them. A GranphonError about a network has the ``load_index`` of its load.
        """
        if state.n_samples:
            return state.samples
        # imported here: other runs do not need waves
        from granphon.runs.wave_records import record_waves

        records = list[SampleRecord]()
        request = self.request
        for index, single in enumerate(_split_loads(state)):
            try:
                # kept, as the data set and the files of a state need the same
                waves = single.cached(record_waves, request.waves, request.kept)
                records.append(SampleRecord(of_waves=waves))
            except GranphonError as error:
                error.load_index = index
                raise
        return records

    def _locate(self, error: GranphonError) -> GranphonError:
        """Return the ``error`` of the task with the task and its load before the message, and
        forces in newton.

        If the load is not known, the loads are solved again one by one, and the error of the first
        that fails alone is taken. The ``load_index`` of the returned error is that in the sweep. It
        is None, and the message begins with the task alone, if no load fails alone or if the error
        is about an option.
        """
        # an error of a simulation knows its load, so that nothing is simulated again
        index = error.load_index
        if error.option is not None:
            index = None
        elif index is None:
            index, error = self._find_failing_load(error)
        packing = self.serving.packing
        error_in_newtons = write_newtons(error, packing)
        located = _name_load(self.where, self.load, index, error_in_newtons, packing.structure)
        located.load_index = None if index is None else int(self.serving.loads[index])
        return located

    def _find_failing_load(self, error: GranphonError) -> tuple[int | None, GranphonError]:
        """Return the index, among the loads of the task, of the first load that fails alone, and
        its error; None and ``error`` if no load fails alone.
        """
        for index in range(self.load.size):
            try:
                self.observe(self.state(self.load[[index]]))
            except GranphonError as error_alone:
                return index, error_alone
        return None, error


def find_analysis(state: ContactState, direction: tuple[Any, ...] | None) -> Analysis:
    """Return the analysis of a ``state`` along a ``direction``, as a :class:`Request` has it, with
    the results that several observables share; the state keeps it.
    """
    return state.cached(Analysis, direction)


def _average_samples(
    serving: ServingMedium, simulation: DirectSimulation, samples: Sequence[Any], load: Load
) -> SimulatedState:
    """Return the state of a ``simulation`` under a ``load``, the mean over its ``samples``, or over
    records of these; the state has the word of ``serving`` on whether its medium was chosen
    automatically.
    """
    state = simulation.average(samples, load)
    return replace(state, chosen_automatically=serving.chosen_automatically)


def _split_loads(state: ContactState) -> list[ContactState]:
    """Return a list of the single states of a ``state``, one for each load."""
    return [state] if state.is_single else [state[index] for index in range(len(state.force))]


def _find_distinct(state: ContactState, states: list[ContactState]) -> list[ContactState]:
    """Return those of the ``states`` whose lattices differ: the first alone, or all. The ``states``
    are the single states of ``state`` at its loads.

    In the limit of small overlaps one reduced dispersion relation serves all loads, unless the
    torsion is that of a Hertz contact.
    """
    return states[:1] if state.has_one_lattice else states


def _observe_edge(state: ContactState, settings: SurfaceSettings) -> TaskResult:
    """Return the variables of the waves of the edge that the ``settings`` describe, at each load of
    a ``state``, as :func:`~granphon.phonons.surfaces.observe_surface` names them.
    """
    # imported here: other runs do not need surfaces
    from granphon.phonons.surfaces import observe_surface

    states = _split_loads(state)
    distinct_states = _find_distinct(state, states)
    return observe_surface(states, distinct_states, settings.axis, settings.edge, settings.points)


def _observe_zone(state: ContactState, request: Request) -> TaskResult:
    """Return the variables at each load of a ``state`` (loads, ...) of what the ``request`` seeks
    in the whole zone, as :func:`_find_in_zone` names them; where one lattice serves all loads, the
    zone is searched once.
    """
    # imported here: other runs do not need phonons
    from granphon.phonons.phonons import find_phonons

    states = _split_loads(state)
    distinct_states = _find_distinct(state, states)
    numbers_of_states = [_find_in_zone(find_phonons(single), request) for single in distinct_states]
    # from the frequencies of the distinct states to those of all states; curvatures go as
    # frequencies do, as lattices that serve all loads have one length
    scales = np.array([single.scales.frequency for single in states])
    ratios = scales / [single.scales.frequency for single in distinct_states]
    variables: TaskResult = {}
    for name in numbers_of_states[0]:
        values = np.array([numbers[name] for numbers in numbers_of_states])
        single_axes = (1,) * (values.ndim - 1)
        variables[name] = np.asarray(ratios.reshape(-1, *single_axes) * values)
    return variables


def _find_in_zone(phonons: Phonons, request: Request) -> dict[str, Array]:
    """Return the variables of one state, whose ``phonons`` have b branches, that the ``request``
    seeks in the whole zone.

    Gaps give the lower and the upper edges (b,), Hz, by the number of branches below the gap, nan
    where there is no gap, and the top frequency, Hz. Cut-offs give the lowest and the highest
    frequency of each branch (b,), Hz; the edges of gaps are then taken from these. Onsets give the
    frequencies (b,), Hz, at Gamma, the curvatures (b,) along the direction, m^2/s, and the gap
    below all branches, Hz.
    """
    # imported here: other runs do not need phonons
    from granphon.phonons.phonons import find_gaps_between

    variables = dict[str, Array]()
    cutoffs = phonons.cutoffs() if "cutoffs" in request.observe else None
    if "gaps" in request.observe:
        edges = np.full((2, phonons.lattice.n_branches), np.nan)
        branches, gaps = phonons.find_gaps() if cutoffs is None else find_gaps_between(cutoffs)
        edges[:, branches] = gaps.T
        variables["gap_lower"], variables["gap_upper"] = edges
        top = phonons.lattice.top_frequency * phonons.scales.frequency
        variables["top_frequency"] = np.array(top)
    if cutoffs is not None:
        variables["cutoff_lower"], variables["cutoff_upper"] = cutoffs.T
    if "onsets" in request.observe:
        onset = phonons.onset(request.direction)
        variables["onset_frequency"] = onset.frequencies
        variables["onset_curvature"] = onset.curvatures
        variables["onset_gap"] = np.array(onset.gap)
    return variables


def _observe_bands(
    state: ContactState,
    qpoints: Array,
    losses: BandsSettings | None,
    known_bands: Bands | None = None,
) -> tuple[TaskResult, list[str]]:
    """Return the variables of the bands, each (loads, s, p, branches) at ``qpoints`` (s, p, 3),
    fractions of the reciprocal cell, and notes on branches and modes whose frequencies vanish at
    the first load. The frequencies of a single state may be known, from its ``known_bands`` at
    these points.

    The variables are the frequencies, Hz, and, where contacts have ``losses``, the frequencies, Hz,
    decay and Q of the damped bands.
    """
    states = _split_loads(state)
    q = qpoints.reshape(-1, 3)
    shape = (len(states), *qpoints.shape[:2], -1)
    # the frequencies that phonopy gives, but from C(q), which needs no force constants
    lattices = [single.contact_lattice() for single in _find_distinct(state, states)]
    paths = [lattice.wavevectors(q) for lattice in lattices]
    scales = np.array([single.scales.frequency for single in states])  # Hz
    # reduced frequencies are (lattices, s p, branches), in units of the scale of each state
    if known_bands is None:
        reduced = np.array(
            [lattice.frequencies(path) for lattice, path in zip(lattices, paths, strict=True)]
        )
        frequencies = scales[:, None, None] * reduced
    else:
        frequencies = known_bands.frequencies
        reduced = frequencies.reshape(1, len(q), -1) / scales[:, None, None]
    variables: TaskResult = {"frequencies": frequencies.reshape(shape)}
    notes = [
        *lattices[0].free_branch_warnings,
        *lattices[0].soft_mode_warnings(paths[0], reduced[0]),
    ]
    if state.n_samples:
        notes.append(LATTICE_BANDS)
    if losses is not None:
        # imported here: other runs do not need phonons
        from granphon.phonons.phonons import find_phonons

        damped = [find_phonons(single).damped(q, **losses.losses) for single in states]
        damped_frequencies = np.array([bands.frequencies.real for bands in damped])
        decays = np.array([bands.decay for bands in damped])
        qualities = np.array([bands.quality for bands in damped])
        variables["damped_frequency"] = damped_frequencies.reshape(shape)
        variables["damped_decay"] = decays.reshape(shape)
        variables["damped_quality"] = qualities.reshape(shape)
    return variables, notes


def _name_load(
    where: str, load: Load, index: int | None, error: GranphonError, lattice: Lattice
) -> GranphonError:
    """Return ``error`` with words for its place before its message: ``where``, which names the
    task, and the load number ``index``, unless that is None, not known. The index becomes the
    ``load_index`` of the error.

    The unit of the load depends on the ``lattice``.
    """
    if index is None:
        return error.restate(f"{where}: {error}")
    load_in_words = load[index].describe(lattice.periods, lattice.pressed_axes)
    located = error.restate(f"{where}, {load_in_words}: {error}")
    located.load_index = index
    return located


def add_waves(
    result: TaskResult, task: MediumTask, load: Load, records: Sequence[SampleRecord]
) -> TaskResult:
    """Return the ``result`` of a task with the means over samples of the waves at each ``load``,
    (loads, ...), and with notes on observables that are not known.

    The ``records`` are those of all samples at the first load, then at the next; a state without
    samples has one record at each load. An observable is nan at a load at which it is not known,
    and left out if it is known at no load.
    """
    # imported here: a sweep without waves does not need them
    from granphon.runs.wave_records import average_waves

    assert task.request.waves is not None
    n_samples = len(records) // load.size
    rows = list[dict[str, Array]]()
    indices_of_texts = dict[str, list[int]]()
    for index in range(load.size):
        records_at_load = records[index * n_samples : (index + 1) * n_samples]
        waves_at_load = [record.of_waves for record in records_at_load]
        row, texts = average_waves(waves_at_load, task.request.waves)
        rows.append(row)
        for text in texts:
            indices_of_texts.setdefault(text, []).append(index)
    examples = {name: value for row in rows for name, value in row.items()}
    waves: TaskResult = {}
    for name, example in examples.items():
        unknown = np.full_like(example, np.nan)
        waves[name] = np.array(pad_columns([row.get(name, unknown) for row in rows]))
    notes = list[str]()
    for text, indices in indices_of_texts.items():
        # a note need not name the loads if they are all those of the medium
        names_loads = len(indices) < load.size or task.serving.is_part
        notes.append(_place_note(text, task, load, indices) if names_loads else text)
    warnings = np.concatenate([result["warnings"], _write_notes(notes)])
    return result | waves | {"warnings": warnings}


def _place_note(text: str, task: MediumTask, load: Load, indices: Sequence[int]) -> str:
    """Return a note of a ``task``, ``text``, with words before it for the loads at which it holds:
    the first of the ``indices`` of a ``load``, and how many more there are.
    """
    lattice = task.serving.packing.structure
    load_in_words = load[indices[0]].describe(lattice.periods, lattice.pressed_axes)
    further = f" and {len(indices) - 1} more" if len(indices) > 1 else ""
    return f"at {load_in_words}{further}, {text}"


# -- of a sample -----------------------------------------------------------------------------------


class SampleTask(MediumTask):
    """One sample of a simulation at all loads, one load in each step.

    The highest load comes first. The search for an equilibrium starts where it starts in a
    simulation that is not cut into tasks: at the equilibrium of the step before, or, in the exact
    geometry and where the cell shears, at the lattice. An unfinished result has its loads in this
    order, and the overlap and the balls at rest under the last of them. With a history of friction
    all loads are one step.
    """

    @property
    def steps(self) -> int:
        """Number of steps: one for each load, or one for a whole path."""
        return 1 if self.simulation.friction_history else self.load.size

    def count_steps(self, result: TaskResult) -> int:
        """Return the number of steps that a result, of one step or more, contains."""
        return 1 if self.simulation.friction_history else len(result["force"])

    def solve(self, begun: TaskResult | None = None) -> TaskResult:
        """Find the sample at one more load, and return its numbers that are averaged, (loads, ...)
        by name, at the loads of ``begun`` and at this load. Where states are kept, the balls of the
        sample are among them.

        Until the last load is done, the loads stand in the order in which they are taken, and the
        result has the overlap and the balls at rest under the last of them, for the next step. The
        result of the last step has the order of the task's loads, without these. With a history of
        friction one step takes the whole path, see :meth:`_solve_path`.

        The message of a GranphonError names the task and, if it is known, the load.
        """
        if self.simulation.friction_history:
            return self._solve_path()
        try:
            loads = self.simulation.prescribed(self.load)
        except GranphonError as error:
            raise self._locate(error) from error
        order = sort_by_load(loads)
        earlier = dict(begun or {})  # the numbers at the loads that are done
        start = None
        n_done = 0
        if earlier:
            start = (earlier.pop("rest_overlap").item(), earlier.pop("rest_balls"))
            n_done = self.count_steps(earlier)
        sample, numbers = self._find_sample(loads, order[n_done], start)
        result = numbers
        if earlier:
            # loads may have unequal numbers of peaks
            result = {
                name: np.concatenate(pad_columns([earlier[name], value]))
                for name, value in numbers.items()
            }
        if n_done + 1 == len(order):
            return {name: value[np.argsort(order)] for name, value in result.items()}
        equilibrium = sample.equilibrium
        rest = {"rest_overlap": np.array(equilibrium.overlap), "rest_balls": equilibrium.balls}
        return result | rest

    def _find_sample(
        self, loads: Sequence[ReducedLoad], index: int, start: tuple[float, Array] | None
    ) -> tuple[Sample, TaskResult]:
        """Return the sample at the load number ``index`` of the reduced ``loads``, and its numbers
        that are averaged, (1, ...) by name. ``start`` holds the overlap and the balls of an earlier
        equilibrium, None for none. The message of a GranphonError names the task and the load.
        """
        try:
            sample = self.simulation.sample(loads[index], start)
            return sample, self._record([sample], [index])
        except GranphonError as error:
            error.load_index = index
            raise self._locate(error) from error

    def _solve_path(self) -> TaskResult:
        """Return the numbers of a sample that are averaged, (loads, ...) by name, along its path of
        loads with friction.

        If the path ends early, the rows of the loads that were not reached mean nothing, and the
        result has marks, which name these loads and say why the path ended. A path that reaches no
        load raises its GranphonError, with the task and the load in the message.
        """
        try:
            return self.observe(self.state(self.load))
        except GranphonError as reduced_error:
            error = self._locate(reduced_error)
            if error.reached is None:
                raise error from reduced_error
            n_loads = self.load.size
            history: Any = self.simulation.history
            order = history.sort(self.simulation.prescribed(self.load))
            reached = sorted(order[: len(error.reached.force)])
            end = -1 if error.load_index is None else error.load_index
            marks = {
                _MISSED: np.setdiff1d(np.arange(n_loads), reached),
                _WHY: np.array([str(error)]),
                _END: np.array([end]),
            }
            try:
                result = self._record(error.reached.samples, reached)
            except GranphonError as error_of_sample:
                raise self._locate(error_of_sample) from error_of_sample
            return _expand_loads(result, reached, n_loads) | marks

    def observe(self, state: ContactState) -> TaskResult:
        """Return the numbers of the sample that are averaged, (n_loads, ...) by name, and its balls
        if states are kept; ``state`` has the sample at each of n_loads loads.
        """
        return self._record(state.samples, range(len(state.samples)))

    def _record(self, samples: Sequence[Any], indices: Sequence[int]) -> TaskResult:
        """Return the numbers that are averaged, (n_loads, ...) by name, of one sample at n_loads
        loads, the ``samples``; if states are kept, also its balls at rest, (1, ...).

        The ``indices`` are those of the loads of the samples; a GranphonError has that of its
        sample as its ``load_index``.
        """
        request = self.request
        records = list[SampleRecord]()
        for index, sample in zip(indices, samples, strict=True):
            try:
                records.append(
                    SampleRecord.of(sample, request.waves, request.exponents, request.kept)
                )
            except GranphonError as error:
                error.load_index = index
                raise
        result = SampleRecord.to_result(records)
        if not request.kept:
            return result
        balls = self.simulation.list_balls(samples[0])
        # a request that keeps balls has one load, whose axis comes first
        return result | {_BALLS + name: values[None] for name, values in balls.items()}


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
        """Return the record of a ``sample``, with the ``waves`` that are requested; numbers that
        the sample does not know yet are computed.

        Tensors at neighbouring loads are recorded for ``exponents`` of balls that differ. With
        ``whole`` the results of the solvers of waves are kept too.
        """
        of_waves: dict[str, Any] = {}
        if waves is not None:
            # imported here: a sweep without waves does not need them
            from granphon.runs.wave_records import record_waves

            of_waves = record_waves(sample, waves, whole=whole)
        names = [*_AVERAGED]
        if exponents and sample.packing.spread_matters:
            names.append("elastic_tensors_beside")
        names += [name for name in HISTORY_UNITS if hasattr(sample, name)]
        numbers = {name: getattr(sample, name) for name in names}
        return cls(**numbers, fraction=sample.contact_fraction(), of_waves=of_waves)

    @classmethod
    def from_result(cls, result: TaskResult, index: int) -> Self:
        """Return the record at the load of ``index`` from the ``result`` of a task, arrays
        (loads, ...) by name.
        """
        numbers = dict[str, Any]()
        waves = dict[str, Any]()
        for name, values in result.items():
            if name.startswith(_WAVES):
                waves[name.removeprefix(_WAVES)] = values[index]
            elif "." not in name:  # other names with a point are those of balls
                numbers[name] = values[index]
        return cls(**numbers, of_waves=waves)

    @classmethod
    def to_result(cls, records: Sequence[Self]) -> TaskResult:
        """Return the result of a task, arrays (loads, ...) by name, from its records, one at each
        load. Where loads have unequal numbers of values, as of peaks, nan fills the last axis.
        """
        rows = list[dict[str, Any]]()
        for record in records:
            row = dict(vars(record))
            waves = row.pop("of_waves")
            rows.append(row | {_WAVES + name: value for name, value in waves.items()})
        return {
            name: np.array(pad_columns([np.asarray(row[name]) for row in rows])) for name in rows[0]
        }

    def contact_fraction(self) -> float:
        """Return the fraction of the contacts that carry load: on the triangular lattice N_c / 6,
        where N_c is the mean number of such contacts of a ball.
        """
        return float(self.fraction)


def restore_sample(simulation: DirectSimulation, result: TaskResult) -> Sample | PressedSample:
    """Return the one sample of a ``simulation`` at its one load, with the balls, the elastic
    tensors and the waves in the ``result`` of its task; deviations of diameters are drawn again
    from the seed.
    """
    balls = {
        name.removeprefix(_BALLS): rows[0]
        for name, rows in result.items()
        if name.startswith(_BALLS)
    }
    sample = simulation.restore_sample(balls)
    tensors = {name: rows[0] for name, rows in result.items() if name.startswith("elastic_")}
    waves = SampleRecord.from_result(result, 0).of_waves
    # tensors are cached properties of a sample: set here, they are not computed again
    vars(sample).update(tensors, of_waves=waves)
    return sample


# -- paths of loads that end early -----------------------------------------------------------------


def _expand_loads(result: TaskResult, reached: Sequence[int], size: int) -> TaskResult:
    """Return a ``result``, whose rows are those of the loads ``reached``, indices of loads, with a
    row for each of ``size`` loads. At a load that was not reached the row is that of another load,
    and means nothing; its "warnings" stay as they are.
    """
    rows = np.zeros(size, int)
    rows[list(reached)] = range(len(reached))
    return {name: value if name == "warnings" else value[rows] for name, value in result.items()}


def drop_marks(result: TaskResult) -> TaskResult:
    """Return a ``result`` without the marks of a path that ended early: a new mapping of the same
    arrays.
    """
    return {name: value for name, value in result.items() if name not in _MARKS}


def find_reached(results: Sequence[TaskResult], size: int) -> list[int]:
    """Return the indices, below ``size``, of the loads that all results have reached, ascending.

    Raises the ConvergenceError of the first path that ended early if no load is reached by all.
    """
    missed_loads = set[int]()
    for result in results:
        missed_loads.update(result.get(_MISSED, _NO_MARKS).tolist())
    if len(missed_loads) == size:
        raise explain_end(results)
    return [index for index in range(size) if index not in missed_loads]


def _join_marks(results: Sequence[TaskResult], loads: Sequence[NDArray[Any]]) -> TaskResult:
    """Return the marks of several results together; empty if no path ended early.

    The loads that a result has not reached are counted among its own loads; each of the ``loads``
    holds the indices that the loads of one result have among all loads, in which the returned marks
    count. The index of the load at which a path ended is that among all loads already.
    """
    missed_loads = list[Array]()
    reasons = list[Array]()
    ends = list[Array]()
    for result, indices in zip(results, loads, strict=True):
        if _MISSED in result:
            missed_loads.append(indices[result[_MISSED]])
            reasons.append(result[_WHY])
            ends.append(result[_END])
    if not missed_loads:
        return {}
    return {
        _MISSED: np.unique(np.concatenate(missed_loads)),
        _WHY: np.concatenate(reasons),
        _END: np.concatenate(ends),
    }


def explain_end(results: Sequence[TaskResult]) -> ConvergenceError:
    """Return the error of the first path that ended early, by the marks of the ``results``, of
    which one at least has marks; the message counts the other paths that did. The ``load_index`` of
    the error is None where the load is not known.
    """
    reasons = [reason for result in results for reason in result.get(_WHY, _NO_MARKS).tolist()]
    indices = [index for result in results for index in result.get(_END, _NO_MARKS).tolist()]
    message = reasons[0]
    if len(reasons) > 1:
        message += f" {counted(len(reasons) - 1, 'more path')} of the sweep ended early."
    error = ConvergenceError(message)
    error.load_index = indices[0] if indices[0] >= 0 else None
    return error


# -- notes -----------------------------------------------------------------------------------------


def _write_notes(notes: Iterable[Check | str]) -> NDArray[Any]:
    """Return ``notes`` on a result, conditions over loads or sentences, as an array (notes,) of
    JSON texts in bytes; equal notes are one.
    """
    texts = list[str]()
    for note in notes:
        content = note if isinstance(note, str) else list(vars(note).values())
        texts.append(to_json(content))
    return np.array(list(dict.fromkeys(texts)), "S")  # one byte a letter, as JSON is ASCII


def _join_notes(results: Iterable[TaskResult]) -> NDArray[Any]:
    """Return the notes on all ``results``, which are those of different loads, in the form of
    :func:`_write_notes`: each sentence once, and once each condition that has the same limit and
    reason in all results, with its values at the loads of all of them.
    """
    notes: dict[Any, Check | str] = {}
    for result in results:
        for note in read_notes(result):
            if isinstance(note, str):
                notes[note] = note
                continue
            # two notes of one condition are about different loads
            key = (note.name, note.limit, note.reason, note.at_least)
            earlier = notes.get(key)
            notes[key] = earlier.join(note) if isinstance(earlier, Check) else note
    return _write_notes(notes.values())


def _read_note(text: bytes) -> Check | str:
    """Decode a note, a condition over loads or a sentence, from its JSON text."""
    note = json.loads(text)
    return note if isinstance(note, str) else Check(*note)


def read_notes(result: TaskResult) -> list[Check | str]:
    """Return the notes on a ``result``: conditions over its loads, and sentences."""
    return [_read_note(text) for text in result["warnings"].tolist()]
