"""The scene: what to compute, read from a YAML file and checked before anything is computed; its
run, and its result.

Quantities have units ("8 mm") in the file only; a :class:`Scene` holds numbers in SI units. A
mistake in a file raises a :class:`~granphon.base.errors.SceneError` that names file, line and key,
what was found, what is allowed, and the likely intention.

A run computes everything first, and then writes it into one folder. Its result has the data set of
all states, of one state too, and the values of the outputs that the scene asks for: the rows of
:data:`granphon.scene.outputs.OUTPUTS`, which say what files a run writes, and when.
"""

from __future__ import annotations

import json
import os
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import AbstractContextManager, contextmanager, nullcontext
from dataclasses import dataclass, field, replace
from functools import cached_property, partial
from pathlib import Path
from typing import TYPE_CHECKING, Any, Self

from granphon.balls.packing import Axis
from granphon.base.errors import GranphonError, InputError, brief
from granphon.base.progress import Progress, require_progress, silent
from granphon.base.quantities import find_load_unit
from granphon.base.results import write_html
from granphon.base.scales import write_quantity
from granphon.base.staging import ResultFiles, is_whole
from granphon.base.text import (
    counted,
    dump_yaml,
    parse_yaml,
    read_yaml,
    require_path,
    suggest,
    versions,
)
from granphon.base.threads import require_executor
from granphon.base.validation import require, truth
from granphon.media.choice import ServingMedium
from granphon.media.cost import Cost
from granphon.media.state import ContactState
from granphon.observables.catalogue import (
    CATALOGUE,
    Analysis,
    Observable,
    entry_of,
)
from granphon.observables.validity import Validity
from granphon.observables.velocities import Moduli, SoundVelocities
from granphon.runs.execution import Means
from granphon.runs.finished_tasks import Store, open_store
from granphon.runs.plan import CostPart, Plan, keep_incomplete
from granphon.runs.tasks import Grid, Request, Written
from granphon.runs.workers import packages
from granphon.scene import file_keys
from granphon.scene.file import SceneSource
from granphon.scene.outputs import (
    OUTPUTS,
    SUMMARY_SCHEMA,
    Export,
    Results,
    every_file,
    list_files,
    list_outputs,
)
from granphon.scene.values import SceneValues
from granphon.waves.settings import NETWORK_BLOCKS

if TYPE_CHECKING:
    from concurrent.futures import Executor

    from granphon.dynamics.local_field import LocalField
    from granphon.inverse.design import Design
    from granphon.phonons.bands import Bands
    from granphon.phonons.dos import DensityOfStates
    from granphon.phonons.phonons import Phonons
    from granphon.phonons.surfaces import SurfaceSpectrum
    from granphon.runs.dataset import Dataset
    from granphon.scene.design import PosedDesign
    from granphon.scene.uncertainty import ErrorPropagation


#: the file, in the folder of the result, in which finished tasks are kept until the result has been
#: written
WORK_FILE = ".granphon-sweep"


@dataclass(frozen=True)
class Scene(SceneValues):
    """What to compute, in SI units.

    Attributes
    ----------
    packing, load : the balls and their arrangement, and the load that presses them. Balls of
        several kinds are an :class:`~granphon.media.arrangement.Arrangement`, which a
        :class:`~granphon.Crystal` becomes, and a packing of another program
        :class:`~granphon.NetworkFiles`, whose own ``load`` this is.
    media : the ways to average over a spread of diameters, one or more; by default "ema" if the
        balls differ, else "ala". Balls of several kinds have "crystal" alone. May be given as names
        ("ala", "afa", "ema", "simulation", "auto") or mappings with options, alone or in a list.
    parameters : the swept parameters of the packing, each with its values; may be given as a
        mapping.
    finite_overlap : keep the terms of relative order delta/d. Simulations in their exact geometry
        have them whether asked or not, as :attr:`granphon.ContactState.finite_overlap` says. Of a
        packing of another program the files say it (``prestress``), whatever is given here.
    observe : which of "velocities", "bands", "gaps", "cutoffs", "onsets", "sensitivities", "dos",
        "surface", "spectrum", "pulse", "response", "motion", "modes", "design" to compute, and
        names of registered observables and outputs. A spectrum and a pulse are those of a simulated
        array, or of a packing of another program; these also have a density of states of their own.
    direction : Cartesian direction of sound, a number for each period of the lattice, or a tuple of
        such directions; None for x, on which velocities do not depend where sound is isotropic.
    band, band_points : path of the bands, None for that of the lattice, and number of points on
        each of its segments.
    mesh : numbers of wave vectors along the reciprocal vectors for the density of states, one for
        each period of the lattice; by default (1024,), (64, 64) or (32, 32, 32).
    surface : the edge whose waves are found, if the scene observes "surface".
    spectrum, pulse : what spectral functions to find, and what pulse to send, if the scene observes
        "spectrum" or "pulse".
    bands : how contacts damp the bands, if the scene observes "bands"; None for bands without loss
        alone.
    errors : of each parameter that has a standard error, the path of its key in the file, as
        ("material", "young_modulus"), and the error, SI; results have the errors that follow.
    correlations : the names of two such parameters, and the correlation of their errors; may be
        given as a mapping, as {"young_modulus, diameter": 0.3}.
    response, motion, modes : which response of the network of each state to find, how its balls
        move, and which of its lowest modes to find, if the scene observes it.
    design : what network is sought, from the state as its start, if the scene observes a design.
    dim : supercell of the exported force constants, a number for each period; None for the smallest
        that suffices.
    source : path of the file that the scene was read from; None for a scene made in Python.

    Raises
    ------
    InputError : a value that is not allowed.
    """

    @classmethod
    def from_yaml(
        cls, path: str | os.PathLike[str], values: Mapping[str, str] | None = None
    ) -> Self:
        """Read a scene file; :class:`~granphon.base.errors.SceneError` names the mistake in it.

        ``values`` stand in place of those in the file: texts, as in the file, by the keys that lead
        to them, as {"load.force": "18.4 +- 0.2 N"}. If there is no file, the error is a
        :class:`~granphon.base.errors.MissingFileError` too. InputError for ``values`` that are no
        mapping of texts, that are no YAML, or whose keys lead to nothing.
        """
        if values is not None:
            _require_texts(values)
        return cls._read(SceneSource.of_file(path, values))

    @classmethod
    def from_text(cls, text: str, name: str = "<scene>") -> Self:
        """Return the scene of a ``text``, which messages call ``name``; raises as
        :meth:`from_yaml`, and InputError for a ``text`` that is no str.

        Files that the text names are looked for in the working folder.
        """
        if not isinstance(text, str):
            raise InputError(f"the text of a scene is {brief(text)}", mend="Give a text")
        return cls._read(SceneSource(parse_yaml(text, name)))

    @classmethod
    def _read(cls, origin: SceneSource) -> Self:
        """Return the scene of the source ``origin``. The values, the plan and, if parameters have
        standard errors, the shifted scenes are checked; SceneError names the first mistake.
        """
        arguments = origin.read()
        with origin.at():
            scene = cls(**arguments)
        object.__setattr__(scene, "origin", origin)  # the dataclass is frozen
        scene.plan.require()
        if scene.errors:
            with origin.at():
                _ = scene.shifted  # made now, so that its errors are raised now
        return scene

    def __str__(self) -> str:
        """Return what the scene says, in three short lines; no state is computed."""
        packing = self.packing
        structure = packing.structure
        if packing.kind_names:
            balls = f"{structure.name} of {', '.join(packing.kind_names)}"
        else:
            balls = f"{structure.name} lattice of balls of {write_quantity(packing.diameter, 'm')}"
            if packing.width:
                balls += f" that differ by {write_quantity(packing.width, 'm')}"
        swept_texts = [
            counted(len(values), f"value of {name}", f"values of {name}")
            for name, values in self.parameters
        ]
        media = [choice.label for choice in self.media]
        name = "" if self.source is None else f" {self.source.name}"
        conditions = "; ".join([self._write_load(), ", ".join(media), *swept_texts])
        return f"Scene{name}: {balls}\n  {conditions}\n  observes {', '.join(self.observe)}"

    def _write_load(self) -> str:
        """Return the load in words: its kind, its least and greatest value, and of several loads
        their number.
        """
        structure = self.packing.structure
        values = self.load.values
        unit = find_load_unit(self.load.kind, structure.periods, structure.pressed_axes)
        # of equal ends one is written
        ends = dict.fromkeys([min(values), max(values)])
        words = f"{self.load.kind.replace('_', ' ')} "
        words += " to ".join(write_quantity(end, unit) for end in ends)
        return f"{words} ({len(values)} loads)" if len(values) > 1 else words

    def _repr_html_(self) -> str:
        """Return a table of what the scene says, in SI units; no state is computed."""
        return write_html("Scene", self.describe())

    def run(
        self,
        folder: str | os.PathLike[str],
        force: bool = False,
        progress: Progress = silent,
        figures: bool = True,
        resume: bool = False,
        executor: Executor | None = None,
    ) -> RunResult:
        """Compute what the scene observes, and only that, and write it into ``folder``.

        Parameters
        ----------
        folder : folder of the results, made if it does not exist. No other run can write into it
            meanwhile. If anything fails it is left as it was found, except that finished tasks stay
            in one file, from which the same scene goes on.
        force : replace an earlier result, remove its files that this scene does not write, and
            discard the finished part of another sweep. A file that granphon did not write, that was
            changed since, or that the scene reads is never replaced.
        progress : is told how far the work has come.
        figures : draw the figures of the outputs too, such as bands.png or sweep.png; one that
            cannot be drawn is a warning of the result.
        resume : if the result is complete (see :func:`is_complete`), read it, and compute and write
            nothing; without effect beside ``force``. A run that was cut off continues from its
            finished part with or without ``resume``.
        executor : does tasks side by side; the numbers do not depend on it. None for this process
            alone.

        Raises
        ------
        InputError : a ``folder``, ``progress`` or ``executor`` of another kind, or a flag that is
            no truth value; a registered observable whose name summary.yaml has for something else;
            a scene that takes more memory or time than :meth:`cost` allows, or that
            no file can hold (:meth:`to_yaml`).
        FileExistsInRunError : without ``force``, a file would be overwritten, or the finished part
            of another scene or version would be discarded; or a file may not be replaced at all.
            Raised before anything is computed, but for a file that is put there meanwhile.
        OutputError : the folder cannot be written, or another run is writing into it.
        GranphonError : the computation fails; then no result has been written. If a path of loads
            with friction ends early, the loads before it are in sweep_incomplete.nc and
            sweep_incomplete.csv, and ``reached`` of the error is their data set.
        """
        require_executor(executor)
        require_progress(progress)
        require_path(folder)
        for name, flag in (("force", force), ("figures", figures), ("resume", resume)):
            require(name, truth, flag)
        rows = list_outputs(self)
        self._add_costs(rows)  # raises if there is too little memory
        target = Path(folder)
        names = list_files(rows, figures=figures)
        if resume and not force and is_complete(self, target):
            return self._read_result(target, names)
        self.to_yaml()  # raises now if the scene cannot be written
        result_files = ResultFiles(
            target, names, force, earlier=every_file(), inputs=self.origin.inputs
        )
        opened_store = self._open_store(target / WORK_FILE, force=force)
        with result_files.open() as locked, opened_store as store:
            means = Means(executor, progress, store)
            with self.plan.place_errors():
                with _keeping_reached_loads(locked, store):
                    dataset = self._find_states(means)
                result = self._find_outputs(dataset, target, rows, means)
            return _write_result(result, locked, figures)

    def _read_result(self, folder: Path, names: Sequence[str]) -> RunResult:
        """Return the complete result in a ``folder``, with the paths of those of its files,
        ``names``, that exist: figures may be missing. Raises InputError if its data set cannot be
        read.
        """
        files = tuple(folder / name for name in names if (folder / name).exists())
        result = RunResult(folder, self, files=files)
        _ = result.dataset  # an error of its file is raised now
        return result

    def _open_store(self, path: Path, *, force: bool) -> AbstractContextManager[Store | None]:
        """Return a context that opens the store of finished tasks in the file ``path``, as
        :func:`~granphon.runs.finished_tasks.open_store` does, and gives None for a scene without
        tasks. If there is a file of another run, it is opened also by such a scene, so that it is
        refused, or with ``force`` removed.
        """
        if self.has_tasks or os.path.lexists(path):
            return open_store(path, force=force)
        return nullcontext()

    def _find_states(self, means: Means) -> Dataset:
        """Return the data set of all states, without the standard errors that parameters cause.
        Tasks are done by the ``means``.
        """
        # the state of a design is found at once: its store is for the starts of the search
        store = None if "design" in self.observe else means.store
        return self.plan.sweep(means.progress, means.executor, store=store)

    def _find_outputs(
        self, dataset: Dataset, target: Path, rows: Sequence[Export], means: Means
    ) -> RunResult:
        """Return the result of the scene, whose states are in the ``dataset``. It has the values of
        the outputs among the ``rows`` that have files, and standard errors if parameters have them.
        Tasks are done by the ``means``. The result names the folder ``target`` as its own, into
        which only the store of the ``means`` writes.
        """
        result = RunResult(target, self, tuple(rows), values={"states": dataset}, means=means)
        with self.origin.where_it_buckles():
            for row in rows:
                # an output without files is found when it is asked for
                if row.find is not None and row.files:
                    with means.progress.step(row.label):
                        result.values[row.name] = row.find_value(result)
        if self.errors:
            self._propagate_errors(result)
        return result

    def _propagate_errors(self, result: RunResult) -> None:
        """Add to the values of a ``result``, in place, the standard errors that follow from those
        of the parameters. They go to the data set of its states, with a warning that names what has
        no error; to the output "errors" of a single state; and to the columns of its tables
        (``column_errors``). All shifted scenes are computed for this.
        """
        from granphon.scene.uncertainty import warn_of_lacking

        pairs = self._compute_shifted(result)
        dataset, propagations = self._propagate_to_states(result, pairs)
        if OUTPUTS["errors"] in result.rows:
            propagations.append(self._propagate_to_summary(result, dataset, pairs))
        for row in result.rows:
            if row.columns is not None and result[row.name] is not None:
                propagations.append(self._propagate_to_table(row, result, pairs))
        result.values["states"] = warn_of_lacking(dataset, propagations)

    def _compute_shifted(self, result: RunResult) -> list[tuple[RunResult, RunResult]]:
        """Return for each parameter with a standard error the results of its two :attr:`shifted`
        scenes, with those outputs alone that have standard errors. The results name the folder of
        ``result`` as theirs, but nothing is written into the folder, and no finished task is kept.
        """
        means = Means(result.means.executor)

        def compute(scene: Scene) -> RunResult:
            """Return the result of a shifted ``scene``."""
            dataset = scene._find_states(means)
            return scene._find_outputs(dataset, result.folder, _list_uncertain(scene), means)

        pairs = []
        with result.means.progress.step("standard errors", len(self.errors)) as step:
            for lower, upper in self.shifted:
                pairs.append((compute(lower), compute(upper)))
                step.advance()
        return pairs

    def _propagate_to_states(
        self, result: RunResult, pairs: Sequence[tuple[RunResult, RunResult]]
    ) -> tuple[Dataset, list[ErrorPropagation]]:
        """Return the data set of the ``result`` with standard errors, and the propagations that
        found them: one from the results of the shifted scenes, ``pairs``, and, if the data set has
        waves of an edge, gaps or peaks, one from slightly shifted scenes, which are computed.
        """
        from granphon.scene.uncertainty import ErrorPropagation, is_by_small_change

        names = list(map(str, result.dataset.data_vars))
        by_whole_errors = ErrorPropagation.of(
            self, [(lower.dataset, upper.dataset) for lower, upper in pairs]
        )
        propagations = [by_whole_errors]
        dataset = by_whole_errors.add_to(
            result.dataset, [name for name in names if not is_by_small_change(name)]
        )
        names_by_small_changes = list(filter(is_by_small_change, names))
        if names_by_small_changes:
            executor = result.means.executor
            slight_pairs = [
                (lower.plan.sweep(executor=executor), upper.plan.sweep(executor=executor))
                for lower, upper in self._slightly_shifted
            ]
            by_small_changes = ErrorPropagation.of_small_changes(self, slight_pairs)
            propagations.append(by_small_changes)
            dataset = by_small_changes.add_to(dataset, names_by_small_changes)
        return dataset, propagations

    def _propagate_to_summary(
        self, result: RunResult, dataset: Dataset, pairs: Sequence[tuple[RunResult, RunResult]]
    ) -> ErrorPropagation:
        """Put the standard errors of the summary of a single state, among them those of numbers
        that no data set has, into the output "errors" of the ``result``, and return the propagation
        from the results of the shifted scenes, ``pairs``. Errors of waves of an edge, gaps and
        peaks are taken from the ``dataset`` with standard errors.
        """
        from granphon.scene.uncertainty import (
            ErrorPropagation,
            is_by_small_change,
            list_errors_by_small_changes,
        )

        numbers = result.summary()
        summaries = [(lower.summary(), upper.summary()) for lower, upper in pairs]
        propagation = ErrorPropagation.of(self, summaries)
        errors = propagation.summarise(
            {name: value for name, value in numbers.items() if not is_by_small_change(name)}
        )
        errors_of_dataset = list_errors_by_small_changes(dataset, numbers)
        sources = errors["errors_from"] | errors_of_dataset["errors_from"]
        result.values["errors"] = errors | errors_of_dataset | {"errors_from": sources}
        return propagation

    def _propagate_to_table(
        self, row: Export, result: RunResult, pairs: Sequence[tuple[RunResult, RunResult]]
    ) -> ErrorPropagation:
        """Put the standard errors of the tables of the output ``row`` into the ``column_errors`` of
        the ``result``, and return the propagation from the results of the shifted scenes,
        ``pairs``. The output's label stands behind the names of columns that have no error, as in
        "total of density of states".
        """
        from granphon.scene.uncertainty import ErrorPropagation

        assert row.columns is not None
        tables = [(_list_columns(row, lower), _list_columns(row, upper)) for lower, upper in pairs]
        propagation = ErrorPropagation.of(self, tables)
        errors = propagation.find_along(row.columns(result), row.along)
        result.column_errors[row.name] = errors
        propagation.lacking = {f"{name} of {row.label}": None for name in propagation.lacking}
        return propagation

    @cached_property
    def shifted(self) -> list[tuple[Self, Self]]:
        """For each parameter with a standard error, in the order of ``errors``, two scenes: the
        parameter is smaller by its error in the first, and larger in the second. Raises
        :class:`~granphon.base.errors.Refused` if one of the scenes is not valid, or if the sweep
        replaces a parameter.
        """
        from granphon.scene.uncertainty import shift_scene

        return [
            (shift_scene(self, keys, -error), shift_scene(self, keys, error))
            for keys, error in self.errors
        ]

    @cached_property
    def _slightly_shifted(self) -> list[tuple[Self, Self]]:
        """For each parameter with a standard error two scenes in which the parameter is a little
        smaller and a little larger. They observe nothing but what has waves of an edge, gaps or
        peaks; empty if the scene observes nothing of this kind. Raises as :attr:`shifted` does.
        """
        from granphon.scene.uncertainty import shift_slightly

        return shift_slightly(self)

    # -- the plan ----------------------------------------------------------------------------------

    @cached_property
    def plan(self) -> Plan:
        """The plan by which the states of the scene are checked and found: packing, swept
        parameters, media and loads, and what is asked of each state.
        """
        has_velocities = "velocities" in self.observe
        # what a network that resists no force, a mechanism, has although it has no velocities
        observables_of_mechanisms = {"bands", "gaps", "cutoffs", "onsets", "dos", "surface"}
        observables_of_mechanisms |= {"design", *NETWORK_BLOCKS}
        if "sensitivities" in self.observe:
            # all other derivatives are those of velocities and moduli
            observables_of_mechanisms &= file_keys.DIFFERENTIATED_OBSERVABLES
        path = None
        if "bands" in self.observe:
            path = (self.path.arrays, self.band_points, self.path.labels)
        request = Request(
            finite_overlap=self.finite_overlap,
            path=path,
            direction=self.direction,
            waves=self.waves,
            exponents=has_velocities,
            # a wall after a kind of balls keeps the name of the kind: derivatives change the kind
            surface=self.surface if "surface" in self.observe else None,
            bands=self.observed_settings("bands"),
            modes=path is not None,
            observe=self.observe,
            sound=has_velocities or observables_of_mechanisms.isdisjoint(self.observe),
        )
        axes = tuple(Axis(*axis) for axis in self.parameters)
        written_load = None if self.load.balls_per_side is None else self.load.flat
        written = Written(self.origin.written_units, written_load)
        grid = Grid(self.packing, axes, self.media, self.load.applied.flat, request, written)
        return Plan(grid, self.origin, self.load.kind)

    @property
    def n_states(self) -> int:
        """Number of states; a state is one case at one load."""
        return self.plan.n_states

    @property
    def serving(self) -> ServingMedium:
        """The medium of a scene of one state, see :attr:`granphon.runs.plan.Plan.serving`."""
        return self.plan.serving

    @property
    def has_tasks(self) -> bool:
        """Whether the work is cut into tasks, which an executor can do: the states of a sweep, the
        samples of one state, or the starts of its design.
        """
        return self.plan.has_tasks or "design" in self.observe

    @cached_property
    def posed_design(self) -> PosedDesign:
        """The design that the scene observes, before the search; errors of its goal and variables
        are placed in the block.
        """
        from granphon.scene.design import PosedDesign

        return PosedDesign.of(self)

    def state(self) -> ContactState:
        """Return the state of the contacts under the load.

        :class:`~granphon.base.errors.InputError` if the balls cannot carry the load, or if the
        scene is a sweep; :class:`~granphon.base.errors.ConvergenceError` if a computation does not
        reach the load.
        """
        return self.plan.state()

    def states(self, quick: bool = False) -> Iterator[tuple[str, ContactState]]:
        """Return an iterator over every medium at every combination of parameters, which gives its
        label and its state.

        Quantities of a state have the shape (n,) for the n loads that the medium serves, or () if
        the scene has one load. A state is solved when its turn comes; with ``quick`` simulations
        and effective media of long lists are left out.
        :class:`~granphon.base.errors.InputError` for a ``quick`` that is no truth value, and at the
        first medium that cannot carry the loads;
        :class:`~granphon.base.errors.ConvergenceError` at one that does not reach them.
        """
        return self.plan.states(require("quick", truth, quick))

    def sweep(
        self,
        progress: Progress = silent,
        executor: Executor | None = None,
        *,
        path: str | os.PathLike[str] | None = None,
        resume: bool = False,
        overwrite: bool = False,
        store: Store | None = None,
    ) -> Dataset:
        """Compute every state of the scene as one data set.

        All arguments are those of :func:`granphon.runs.sweep.sweep` of the same names, with the
        same errors. Raises :class:`~granphon.base.errors.InputError` for a load that cannot be
        carried, as a :class:`~granphon.base.errors.SceneError` if the scene was read from a file;
        and :class:`~granphon.base.errors.ConvergenceError` for a load that a computation does not
        reach.
        """
        return self.plan.sweep(
            progress, executor, path=path, resume=resume, overwrite=overwrite, store=store
        )

    @property
    def parts(self) -> list[CostPart]:
        """The parts of the work that may take much memory or time, on states and on outputs, each
        with its place in the file, how the user can make it smaller, and its cost.
        """
        return self._list_parts(list_outputs(self))

    def _list_parts(self, rows: Sequence[Export]) -> list[CostPart]:
        """Return the :attr:`parts` of the work, of which those on outputs are of the ``rows``."""
        # the two shifted scenes of each parameter with an error
        n_shifted = 2 * len(self.errors)
        counted_parts = [(part, 1 + n_shifted) for part in self.plan.parts]
        if n_shifted and self._slightly_shifted:
            # for waves of an edge, gaps and peaks two more of each, with a small change
            slight_scene = self._slightly_shifted[0][0]
            counted_parts += [(part, n_shifted) for part in slight_scene.plan.parts]
        for row in rows:
            if row.cost:
                count = 1 + n_shifted if _is_found_in_shifted(row) else 1
                counted_parts.append((row.estimate_cost(self), count))
        return [(path, mend, cost.times(count)) for (path, mend, cost), count in counted_parts]

    def cost(self) -> Cost | None:
        """Memory and time that the scene will take, its parts done one after the other; None if
        both are negligible.

        :class:`~granphon.base.errors.InputError` if more memory is needed than is available on this
        machine now, or more than 10,000 days on one processor.
        """
        return self._add_costs(list_outputs(self))

    def _add_costs(self, rows: Sequence[Export]) -> Cost | None:
        """Return the :meth:`cost` of the scene, whose outputs are the ``rows``."""
        return self.plan.add_costs(self._list_parts(rows))


def _require_texts(values: Any) -> None:
    """Raise InputError unless ``values`` are a mapping of texts by texts."""
    if isinstance(values, Mapping) and all(
        isinstance(entry, str) for pair in values.items() for entry in pair
    ):
        return
    mend = 'Give a mapping of texts, as {"load.force": "18.4 N"}'
    raise InputError(f"the values of a scene are {brief(values)}", mend=mend)


def _list_uncertain(scene: Scene) -> list[Export]:
    """Return the rows of those outputs of a ``scene`` that have numbers for the summary or tables,
    whose standard errors are found.
    """
    return [row for row in list_outputs(scene) if _is_found_in_shifted(row)]


def _is_found_in_shifted(row: Export) -> bool:
    """Whether an output is found in the shifted scenes too: if it has numbers for the summary, or
    tables, whose standard errors are found from theirs. Errors of variables of the data set need no
    output.
    """
    return row.summarise is not None or row.columns is not None


def _list_columns(row: Export, result: RunResult) -> dict[str, Any]:
    """Return the numbers of the tables of the output ``row``, which has such ``columns``, by name;
    empty if a ``result`` has no value of the output.
    """
    assert row.columns is not None
    return {} if result[row.name] is None else row.columns(result)


@contextmanager
def _keeping_reached_loads(files: ResultFiles, store: Store | None) -> Iterator[None]:
    """Run a block that finds all states, and that may raise the error of a path of loads that ends
    early. The loads before are then written into the locked folder of ``files``, and the error
    names the new files, as :func:`~granphon.runs.plan.keep_incomplete` says. Without a ``store``
    there is no such path, as a path is a task.
    """
    try:
        yield
    except GranphonError as error:
        if error.reached is None or store is None:
            raise
        name = str(OUTPUTS["states"].source)
        raise keep_incomplete(error, files, name, store) from None


def _write_result(result: RunResult, locked: ResultFiles, figures: bool) -> RunResult:
    """Write the files of the outputs of a ``result`` into its ``locked`` folder, those of figures
    only if ``figures``, and summary.yaml last.

    Return the result with the paths of the files written, the reasons for which figures could not
    be drawn, and the remarks of the figures. An output whose value is None has no files.
    """
    written_rows = [
        row
        for row in result.rows
        if row.files and (row.find is None or result[row.name] is not None)
    ]
    names = list_files(written_rows, figures=figures)
    # All files are staged first, and come into the folder together. None is required: an output
    # without a value has no files, and neither has a figure that cannot be drawn.
    with (
        locked.staging(locked.names) as stage,
        result.means.progress.step("writing", len(names)) as step,
    ):
        for row in written_rows:
            row.write_numbers(result, stage)
            step.advance(len(row.numbers))
        figure_files = [row.figure for row in written_rows if figures and row.figure]
        failures, remarks = _draw_figures(result, figure_files, stage)
        step.advance(len(figure_files))
        files = tuple(result.folder / name for name in names if name not in failures)
        written_result = replace(
            result, files=files, failures=tuple(failures.values()), remarks=tuple(remarks)
        )
        # the last file, as the summary names the files and the failures
        (stage / "summary.yaml").write_text(
            _write_summary(written_result, result.package_versions), encoding="utf-8"
        )
    return written_result


def _draw_figures(
    result: RunResult, files: Sequence[str], folder: Path
) -> tuple[dict[str, str], list[str]]:
    """Draw the figures of a ``result`` that are called ``files`` into a ``folder``. Return one
    sentence with the reason for each figure that cannot be drawn, by its name, and the remarks of
    the figures, each behind the name of its figure.
    """
    if not files:
        return {}, []
    from granphon.figures.style import draw  # a run without figures does not need matplotlib

    remarks: list[str] = []
    failures = draw(partial(result.figure, tell=remarks.append), files, folder)
    return failures, remarks


@dataclass(frozen=True, eq=False)
class RunResult(Results):
    """Results of a scene. ``result["bands"]`` is the value of the output of this name, one of
    :data:`granphon.scene.outputs.OUTPUTS`; after reading the result from its folder, the value is
    read from its file.

    Attributes
    ----------
    scene : the scene that was run.
    folder, files : folder of the results, and the paths of the files of the run in it.
    values : the values of outputs that were found or read so far, by their names.
    column_errors : the standard errors of tables that were found or read so far, by the names of
        outputs and then by those of columns.
    rows : the outputs of the run; empty if the result was read from its folder.
    failures : one sentence for each figure that could not be drawn, with the reason.
    remarks : one sentence for each figure that shares out its states among panels, or leaves some
        out.
    means : the executor, the progress and the store by which tasks are done while outputs are
        found.
    """

    scene: Scene
    rows: tuple[Export, ...] = field(default=(), repr=False)
    files: tuple[Path, ...] = ()
    failures: tuple[str, ...] = ()
    remarks: tuple[str, ...] = ()
    means: Means = field(default=Means(), repr=False)

    def __getitem__(self, name: str) -> Any:
        """Return the value of the output ``name``, and keep it in ``values``; None if a run of the
        scene does not have the output, and KeyError if there is no such output.

        In the result of a run, a value that is not known yet is found, and never read from the
        folder, which may hold that of an earlier run. In a result that was read from its folder,
        the value is read, and None if the output is not read, as force constants. The output of
        another command, such as "fit", is read in either case.
        """
        if name in self.values:
            return self.values[name]
        row = OUTPUTS[name]
        is_of_run = row in self.rows if self.rows else row.is_of(self.scene)
        if not is_of_run and row.command == "run":
            return None
        if is_of_run and self.rows:
            self.values[name] = row.find_value(self)
        return super().__getitem__(name)

    def find_errors(self, name: str) -> dict[str, Any]:
        """Return the standard errors of the numbers in the table of the output ``name``, as
        :meth:`Results.find_errors` does; the result of a run has them in ``column_errors``, and
        they are never read from its folder.
        """
        return self.column_errors.get(name, {}) if self.rows else super().find_errors(name)

    @property
    def bands(self) -> Bands | None:
        """Frequencies along the path, Hz, of a single state; None for a sweep, also for one over
        parameters of one value each, and if they were not asked for.
        """
        return self["bands"]  # type: ignore[no-any-return]

    @property
    def dos(self) -> DensityOfStates | None:
        """The density of states of the phonons of a single state, 1/Hz; for a simulation it is that
        of the mean lattice. None for a sweep, also for one over parameters of one value each, for a
        packing of another program, and if it was not asked for. That of the first simulated array,
        or of such a packing, is ``result["sample_dos"]``.
        """
        return self["dos"]  # type: ignore[no-any-return]

    @property
    def gaps(self) -> Any:
        """Intervals of frequencies without a branch, (n, 2) Hz, of the only state, also if it is
        that of a sweep over parameters of one value each; None for several states, and if they were
        not asked for.
        """
        return self["gaps"]

    @property
    def design(self) -> Design | None:
        """Of a single state, the best network that was met; None if it was not asked for. A sweep
        has no design.
        """
        return self["design"]  # type: ignore[no-any-return]

    @property
    def surface(self) -> SurfaceSpectrum | None:
        """Of a single state, the spectrum of the outer layer at the edge, with its waves; None for
        a sweep, and if it was not asked for.
        """
        return self["surface"]  # type: ignore[no-any-return]

    @cached_property
    def phonons(self) -> Phonons | None:
        """The source of ``bands``, ``dos`` and ``gaps`` of the only state; None if the result has
        none of these. InputError if the scene is a sweep that observes gaps.
        """
        if not any(OUTPUTS[name].is_of(self.scene) for name in ("bands", "dos", "gaps")):
            return None
        from granphon.phonons.phonons import find_phonons

        return find_phonons(self.state, self.scene.dim)

    # -- of one state ------------------------------------------------------------------------------

    @property
    def state(self) -> ContactState:
        """The only state; :class:`~granphon.base.errors.InputError` if the scene is a sweep, also
        one of a single value.
        """
        return self.analysis.state

    @property
    def validity(self) -> Validity:
        """The conditions under which the model holds, of the only state; InputError if the scene is
        a sweep.
        """
        return self.analysis.validity

    @cached_property
    def analysis(self) -> Analysis:
        """The analysis of the only state, which is solved again after reading the result from its
        folder; InputError if the scene is a sweep.
        """
        return self.scene.plan.analysis

    @property
    def records(self) -> list[Mapping[str, Any]]:
        """What is kept of the waves of the only state, arrays by name: a mapping for each sample,
        or one for the network of a state without samples. Empty if the scene observes no waves of
        samples and networks. InputError if the scene is a sweep.
        """
        plan = self.scene.plan
        _ = plan.case  # raises for a sweep
        return [] if self.scene.waves is None else plan.records

    @property
    def velocities(self) -> SoundVelocities | None:
        """Sound velocities of the only state, m/s; None if they were not asked for. Otherwise
        InputError if the scene is a sweep.
        """
        return self.analysis.velocities if "velocities" in self.scene.observe else None

    @property
    def moduli(self) -> Moduli | None:
        """Elastic constants of the only state, Pa; None if the scene does not observe velocities,
        or the state has none. InputError if the scene is a sweep that observes velocities.
        """
        return self.analysis.moduli if "velocities" in self.scene.observe else None

    @property
    def local_field(self) -> LocalField | None:
        """Local field of the effective medium; None for another medium, and for equal balls.
        InputError if the scene is a sweep of balls that differ, or over how they differ.
        """
        if not self.scene.balls_differ:
            return None
        return self.scene.serving.medium.of(self.scene.packing).local_field

    # -- numbers -----------------------------------------------------------------------------------

    @property
    def warnings(self) -> tuple[str, ...]:
        """One sentence for each limit of validity exceeded, each number unknown or left out, and
        each figure that failed.
        """
        sentences = json.loads(self.dataset.attrs["warnings"])
        for value in (self.bands, self.dos, self.design):
            if value is not None:
                sentences += value.warnings
        return tuple(dict.fromkeys((*sentences, *self.failures)))

    def entry(self, name: str) -> Observable | None:
        """Return the entry of the catalogue for the number ``name`` of the summary, with the unit
        that it has for the balls of the scene; None if the catalogue has no such name.
        """
        return entry_of(name, self.scene.packing) if name in CATALOGUE else None

    def summary(self) -> dict[str, Any]:
        """Return the numbers of all outputs of the scene in SI units, by name as the attributes of
        the library are named: those of a single state are numbers, words, lists, arrays and
        mappings.

        For a sweep they are whether the overlap is finite, the sizes of the dimensions, the number
        of states, the media, the least and the greatest of each number that is known, and whether
        all states are valid; also the direction of sound, if it was given or if velocities depend
        on it.
        """
        numbers: dict[str, Any] = {}
        for row in self.rows or list_outputs(self.scene):
            if row.summarise is not None:
                numbers |= row.collect_numbers(self)
        return numbers

    def _repr_html_(self) -> str:
        """Return a table of the numbers of :meth:`summary` with their units."""
        rows = list[tuple[str, Any, str]]()
        for name, value in self.summary().items():
            rows.append((name, value, _find_unit(self, name)))
        return write_html(type(self).__name__, rows)

    # -- files -------------------------------------------------------------------------------------

    @cached_property
    def package_versions(self) -> dict[str, str]:
        """The installed versions of the packages by which the results are made, by name."""
        rows = self.rows or list_outputs(self.scene)
        libraries = sorted({name for row in rows for name in row.packages})
        return versions("numpy", "scipy", "xarray", "h5netcdf", *libraries)

    def figure(self, name: str, tell: Callable[[str], object] | None = None) -> Any:
        """Return the matplotlib figure that the file ``name`` of a run shows, such as "bands.png";
        InputError for a name that no figure has, and if there is nothing to draw. ``tell`` is
        called with a sentence, behind the name, that says which panels the figure has chosen, if it
        chooses any.
        """
        rows = {row.figure: row for _name, row in OUTPUTS.items() if row.figure}
        given_name: Any = name
        if not isinstance(given_name, str) or name not in rows:
            raise InputError(f"no figure is called {brief(name)}", mend=suggest(str(name), rows))
        if tell is None:
            return rows[name].make_figure(self)
        return rows[name].make_figure(self, lambda sentence: tell(f"{name}: {sentence}"))


def is_complete(scene: Scene, folder: str | os.PathLike[str]) -> bool:
    """Whether ``folder`` holds the result of a run of an equal ``scene``: every file that the run
    wrote but the figures, made with the installed versions of those packages that determine the
    numbers. False if the folder, its summary or its scene is not there or cannot be read.
    InputError for what is no path.

    A file that was changed after the run counts as missing.
    """
    require_path(folder)
    target = Path(folder)
    try:
        summary = read_yaml(target / "summary.yaml")
        written_names = set(summary["files"])
        run_versions = summary["versions"]
        run_scene = type(scene)(**SceneSource.of_file(target / "scene.yaml").read())
        # the packages that determine the numbers have the versions of the run
        has_same_versions = run_versions == run_versions | packages()
    except (InputError, KeyError, TypeError):
        return False
    if run_scene != scene or not has_same_versions:
        return False
    rows = list_outputs(scene)
    # an output without a value has no files, as a pulse that no sample carries
    rows_with_files = [
        row
        for row in rows
        if row.find is None
        or OUTPUTS.is_added(row.name)
        or not written_names.isdisjoint(row.numbers)
    ]
    return is_whole(target, list_files(rows_with_files, figures=False))


def _find_unit(result: RunResult, name: str) -> str:
    """Return the SI unit of the number ``name`` of the summary, or of the number whose standard
    error ``name`` is; "" if there is none.
    """
    entry = result.entry(name)
    if entry is None and name.endswith("_error"):
        entry = result.entry(name.removesuffix("_error"))
    return entry.unit if entry else ""


def _write_summary(result: RunResult, package_versions: Mapping[str, str]) -> str:
    """Return the text of summary.yaml: the numbers of a ``result`` and their units, the limits of
    the model at a single state, the warnings, the files, and the ``package_versions`` by name.
    """
    scene = result.scene
    numbers = result.summary()
    units = {name: unit for name in numbers if (unit := _find_unit(result, name))}
    return dump_yaml(
        {
            "schema": SUMMARY_SCHEMA,
            "versions": package_versions,
            "source": None if scene.source is None else scene.source.name,
            "observe": scene.observe,
            **numbers,
            **(result["limits"] or {}),
            "warnings": result.warnings,
            "files": [path.name for path in result.files],
            "units": units,
        }
    )
