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
from contextlib import nullcontext
from dataclasses import dataclass, field, replace
from functools import cached_property, partial
from pathlib import Path
from typing import TYPE_CHECKING, Any, Self

import numpy as np

from granphon.balls.packing import Axis
from granphon.base.errors import GranphonError, InputError
from granphon.base.progress import Progress, silent
from granphon.base.quantities import find_load_unit
from granphon.base.results import write_html
from granphon.base.scales import write_quantity
from granphon.base.staging import ResultFiles, is_whole
from granphon.base.text import counted, dump_yaml, parse_yaml, read_yaml, versions
from granphon.media.choice import ServingMedium
from granphon.media.cost import Cost
from granphon.media.state import ContactState
from granphon.observables.catalogue import (
    CATALOGUE,
    WAVE_COSTS,
    Analysis,
    Observable,
    entry_of,
    find_all,
)
from granphon.observables.validity import Validity
from granphon.observables.velocities import Moduli, SoundVelocities
from granphon.runs.dataset import list_finite_overlap
from granphon.runs.execution import Means
from granphon.runs.plan import Plan, keep_incomplete
from granphon.runs.store import Store, open_store
from granphon.runs.tasks import Grid, Request, Written
from granphon.runs.workers import packages
from granphon.scene.file import SceneSource
from granphon.scene.outputs import (
    OUTPUTS,
    SUMMARY_SCHEMA,
    Export,
    Results,
    every_file,
    expected_files,
    list_files,
    list_outputs,
)
from granphon.scene.values import SceneValues
from granphon.waves.settings import NETWORK_BLOCKS, POLARISATIONS

if TYPE_CHECKING:
    from concurrent.futures import Executor

    from granphon.dynamics.local_field import LocalField
    from granphon.inverse.design import Design
    from granphon.phonons.bands import Bands
    from granphon.phonons.dos import DensityOfStates
    from granphon.phonons.phonons import Phonons
    from granphon.phonons.surfaces import SurfaceSpectrum
    from granphon.runs.dataset import Dataset
    from granphon.runs.plan import CostPart
    from granphon.runs.wave_records import SampleWaves
    from granphon.scene.design import PosedDesign


#: the file, in the folder of the result, in which finished tasks are kept until the result has been
#: written
WORK_FILE = ".granphon-sweep"
#: variables of which the summary of several states lists the least and the greatest value
_EXTENTS = (
    "force",
    "overlap",
    "longitudinal",
    "transverse",
    "transverse_slow",
    "transverse_fast",
    "pulse_velocity",
    "time_of_flight",
    "coherent_fraction",
    "surface_velocity",
    "peak_frequency",
    "peak_quality",
    "front_velocity",
    "peak_velocity",
    "greatest_force",
    "energy_lost",
    "top_frequency",
    "onset_gap",
    *(f"ioffe_regel_{name}" for name in POLARISATIONS),
)


@dataclass(frozen=True)
class Scene(SceneValues):
    """What to compute, in SI units.

    Attributes
    ----------
    packing, load : the balls and their arrangement, and the load that presses them. Balls of
        several kinds are an :class:`~granphon.media.arrangement.Arrangement`, and a packing of
        another program :class:`~granphon.NetworkFiles`, whose own ``load`` this is.
    media : the ways to average over a spread of diameters, one or more; by default "ema" if the
        balls differ, else "ala". Balls of several kinds have "crystal" alone. May be given as names
        ("ala", "afa", "ema", "simulation", "auto") or mappings with options, alone or in a list.
    parameters : the swept parameters of the packing, each with its values; may be given as a
        mapping.
    finite_overlap : keep the terms of relative order delta/d; True if all media are simulations in
        their exact geometry, which always have them.
    observe : which of "velocities", "bands", "gaps", "cutoffs", "onsets", "sensitivities", "dos",
        "surface", "spectrum", "pulse", "response", "motion", "modes", "design" to compute;
        spectrum, pulse and the density of states of the array itself, of a simulation.
    direction : Cartesian direction of sound, a number for each period of the lattice, or a tuple of
        such directions; None for x, on which velocities do not depend where sound is isotropic.
    band, band_points : path of the bands, None for that of the lattice, and number of points on
        each of its segments.
    mesh : numbers of wave vectors along the reciprocal vectors for the density of states, one for
        each period of the lattice; by default (1024,), (64, 64) or (32, 32, 32).
    surface : the edge whose waves are found, if the scene observes them.
    spectrum, pulse : what spectral functions to find, and what pulse to send, if the scene observes
        them.
    bands : how contacts damp the bands, if the scene observes them; None for bands without loss
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
        to them, as {"load.force": "18.4 +- 0.2 N"}.
        """
        return cls._read(SceneSource.of_file(path, values))

    @classmethod
    def from_text(cls, text: str, name: str = "<scene>") -> Self:
        """Return the scene of a ``text``, which messages call ``name``; raises as
        :meth:`from_yaml`.

        Files that the text names are looked for in the working folder.
        """
        return cls._read(SceneSource(parse_yaml(text, name)))

    @classmethod
    def _read(cls, origin: SceneSource) -> Self:
        """Return the scene of a document, checked; SceneError names the first mistake."""
        arguments = origin.read()
        with origin.at():
            scene = cls(**arguments)
        object.__setattr__(scene, "origin", origin)
        scene.plan.require()
        if scene.errors:
            with origin.at():
                _ = scene.shifted
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
        unit = find_load_unit(self.load.kind, structure.periods, structure.pressed_axes)
        ends = dict.fromkeys([min(self.load.values), max(self.load.values)])
        loads = f"{self.load.kind.replace('_', ' ')} "
        loads += " to ".join(write_quantity(end, unit) for end in ends)
        if len(self.load.values) > 1:
            loads += f" ({len(self.load.values)} loads)"
        swept = [
            counted(len(values), f"value of {name}", f"values of {name}")
            for name, values in self.parameters
        ]
        media = [choice.label for choice in self.media]
        name = "" if self.source is None else f" {self.source.name}"
        return (
            f"Scene{name}: {balls}\n  {'; '.join([loads, ', '.join(media), *swept])}\n"
            f"  observes {', '.join(self.observe)}"
        )

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
        figures : draw bands.png (dos.png, sweep.png, forces.png) too; one that cannot be drawn is a
            warning of the result.
        resume : if the result is complete (see :func:`is_complete`), read it, and compute and write
            nothing. A run that was cut off continues from its finished part with or without this.
        executor : does tasks side by side; the numbers do not depend on it.

        Raises
        ------
        FileExistsInRunError : without ``force``, a file would be overwritten, or the finished part
            of another scene or version would be discarded; or a file may not be replaced at all.
            Raised before anything is computed.
        OutputError : the folder cannot be written, or another run is writing into it.
        GranphonError : the computation fails; then no result has been written. If a path of loads
            with friction ends early, the loads before it are in sweep_incomplete.nc and
            sweep_incomplete.csv, and ``reached`` of the error is their data set.
        """
        self.cost()  # raises if there is too little memory
        target = Path(folder)
        rows = list_outputs(self)
        names = list_files(rows, figures=figures)
        if resume and not force and is_complete(self, target):
            files = tuple(target / name for name in names if (target / name).exists())
            result = RunResult(target, self, files=files)
            _ = result.dataset  # an error of its file is raised now
            return result
        self.to_yaml()  # raises now if the scene cannot be written
        work_file = target / WORK_FILE
        # a state that is found at once keeps no parts, but the parts of another run are not to
        # stand beside its result
        has_store = self.has_tasks or os.path.lexists(work_file)
        opened_store = open_store(work_file, force=force) if has_store else nullcontext()
        result_files = ResultFiles(
            target, names, force, earlier=every_file(), inputs=self.origin.inputs
        )
        with result_files.open() as locked, opened_store as store:
            with self.plan.place_errors():
                try:
                    result = self._compute(target, rows, executor, progress, store)
                except GranphonError as error:
                    if error.reached is None or store is None:
                        raise
                    name = str(OUTPUTS["states"].source)
                    raise keep_incomplete(error, locked, name, store) from None
            return _write_result(result, locked, rows, figures, progress)

    def _compute(
        self,
        target: Path,
        rows: Sequence[Export],
        executor: Executor | None,
        progress: Progress,
        store: Store | None,
    ) -> RunResult:
        """Return the result of the scene for the folder ``target``, into which nothing is written
        yet, with the values of the outputs of the ``rows``; the ``store`` keeps finished tasks, if
        the scene has any.
        """
        # the starts of a design, whose state is found at once, have a store of their own
        has_design = "design" in self.observe
        dataset = self.plan.sweep(progress, executor, store=None if has_design else store)
        means = Means(executor, progress, store)
        result = RunResult(target, self, tuple(rows), values={"states": dataset}, means=means)
        with self.origin.where_it_buckles():
            for row in rows:
                if row.find is not None:
                    with progress.step(row.label):
                        result.values[row.name] = row.find_value(result)
        if self.errors:
            self._spread_errors(result, executor, progress)
        return result

    def _spread_errors(
        self, result: RunResult, executor: Executor | None, progress: Progress
    ) -> None:
        """Put the standard errors that follow from those of the parameters into the values of a
        ``result``.
        """
        from granphon.scene.uncertainty import Spread, warn_of_lacking

        # the folder may have the errors of an earlier run, which would count as errors of sampling
        result.values["errors"] = {}
        shifted = []
        with progress.step("standard errors", len(self.errors)) as step:
            for lower, upper in self.shifted:
                pair = [
                    scene._compute(result.folder, list_outputs(scene), executor, silent, None)
                    for scene in (lower, upper)
                ]
                shifted.append(pair)
                step.advance()
        datasets = [(lower.dataset, upper.dataset) for lower, upper in shifted]
        spreads = [Spread.of(self, datasets)]
        dataset = spreads[0].add_to(result.dataset)
        if self.is_single:
            summaries = [(lower.summary(), upper.summary()) for lower, upper in shifted]
            spreads.append(Spread.of(self, summaries))
            result.values["errors"] = spreads[1].summarise(result.summary())
        result.values["states"] = warn_of_lacking(dataset, spreads)

    @cached_property
    def shifted(self) -> list[tuple[Self, Self]]:
        """For each parameter with a standard error the scenes in which the parameter is smaller and
        larger by it; :class:`~granphon.base.errors.Refused` if a value is not allowed there.
        """
        from granphon.scene.uncertainty import shift_scene

        return [
            (shift_scene(self, keys, -error), shift_scene(self, keys, error))
            for keys, error in self.errors
        ]

    # -- the plan ----------------------------------------------------------------------------------

    @cached_property
    def plan(self) -> Plan:
        """How the states of the scene are checked and found."""
        has_velocities = "velocities" in self.observe
        # a mechanism has other observables, but no velocities
        of_mechanisms = {"bands", "gaps", "cutoffs", "onsets", "dos", "surface", "design"}
        of_mechanisms |= {*NETWORK_BLOCKS}
        path = None
        if "bands" in self.observe:
            path = (self.path.arrays, self.band_points, self.path.labels)
        request = Request(
            finite_overlap=self.finite_overlap,
            path=path,
            direction=self.direction,
            waves=self.waves,
            exponents=has_velocities,
            surface=self.observed_settings("surface"),
            gaps="gaps" in self.observe,
            cutoffs="cutoffs" in self.observe,
            onsets="onsets" in self.observe,
            sensitivities="sensitivities" in self.observe,
            bands=self.observed_settings("bands"),
            observe=self.observe,
            sound=has_velocities or of_mechanisms.isdisjoint(self.observe),
            whole=self.is_single,
        )
        axes = tuple(Axis(*axis) for axis in self.parameters)
        written_load = None if self.load.balls_per_side is None else self.load.flat
        written = Written(self.origin.written_units, written_load)
        grid = Grid(self.packing, axes, self.media, self.load.applied.flat, request, written)
        return Plan(grid, self.origin, self.load.kind, self.mesh, self.dim)

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
        """Whether the work is cut into tasks, which can be done elsewhere: a sweep, or the samples
        or the starts of the design of one state.
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
        scene is a sweep.
        """
        return self.plan.state()

    def states(self, quick: bool = False) -> Iterator[tuple[str, ContactState]]:
        """Return label and state of every medium at every combination of parameters, one after the
        other.

        Quantities of a state have the shape (n,) for the n loads that the medium serves, or () if
        the scene has one load. A state is solved when its turn comes; with ``quick`` simulations
        and effective media of long lists are left out.
        :class:`~granphon.base.errors.InputError` at the first medium that cannot carry the loads.
        """
        return self.plan.states(quick)

    def sweep(
        self, progress: Progress = silent, executor: Executor | None = None, **options: Any
    ) -> Dataset:
        """Compute every state of the scene as one data set.

        ``options`` are keywords of :func:`granphon.runs.sweep.sweep` besides those that the scene
        answers: ``path``, ``resume``, ``overwrite`` and ``store``. A load that cannot be carried
        raises :class:`~granphon.base.errors.SceneError` if the scene was read from a file, and one
        that a computation does not reach :class:`~granphon.base.errors.ConvergenceError`.
        """
        return self.plan.sweep(progress, executor, **options)

    def cost(self) -> Cost | None:
        """Memory and time that the scene will take, its parts done one after the other; None if
        both are negligible.

        :class:`~granphon.base.errors.InputError` if more memory is needed than is available on this
        machine now, or more than 10,000 days on one processor.
        """
        more: list[CostPart] = []
        if "design" in self.observe:
            mend = "Take fewer balls, steps or restarts"
            more = [(("design",), mend, self.posed_design.cost)]
        cost = self.plan.cost(more)
        count = 1.0 + 2.0 * len(self.errors)
        return cost if cost is None or not self.errors else cost.times(count)


def _write_result(
    result: RunResult,
    locked: ResultFiles,
    rows: Sequence[Export],
    figures: bool,
    progress: Progress,
) -> RunResult:
    """Write the files of the outputs of the ``rows`` of a result, with their ``figures`` or
    without. Return the result with the paths of the files that are written: outputs without a value
    have none, nor have figures that cannot be drawn, which are in ``failures``.
    """
    written_rows = [row for row in rows if row.find is None or result[row.name] is not None]
    names = list_files(written_rows, figures=figures)
    figure_files = [row.figure for row in written_rows if figures and row.figure]
    # each row has written its numbers, or says which are missing
    with (
        locked.staging(locked.names) as stage,
        progress.step("writing", len(names)) as step,
    ):
        for row in written_rows:
            row.write_numbers(result, stage)
            step.advance(len(row.numbers))
        failures: dict[str, str] = {}
        remarks: list[str] = []
        if figure_files:
            from granphon.figures.style import draw

            failures = draw(partial(result.figure, tell=remarks.append), figure_files, stage)
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


@dataclass(frozen=True, eq=False)
class RunResult(Results):
    """Results of a scene. ``result["bands"]`` is the value of the output of this name, one of
    :data:`granphon.scene.outputs.OUTPUTS`; after reading the result from its folder, the value is
    read from its file.

    Attributes
    ----------
    scene : the scene that was run.
    folder, files : folder of the results, and the paths of the files written there.
    values : the values of outputs by their names.
    rows : the outputs that were found; empty after reading the result from its folder.
    failures : one sentence for each figure that could not be drawn, with the reason.
    remarks : one sentence for each figure that shares out its states among panels, or leaves some
        out.
    means : by what tasks are done while outputs are found.
    """

    scene: Scene
    rows: tuple[Export, ...] = field(default=(), repr=False)
    files: tuple[Path, ...] = ()
    failures: tuple[str, ...] = ()
    remarks: tuple[str, ...] = ()
    means: Means = field(default=Means(), repr=False)

    @property
    def bands(self) -> Bands | None:
        """Of a single state, frequencies along the path, Hz; None if they were not asked for."""
        return self._value("bands")  # type: ignore[no-any-return]

    @property
    def dos(self) -> DensityOfStates | None:
        """Of a single state, the density of states, 1/Hz; None if it was not asked for."""
        return self._value("dos")  # type: ignore[no-any-return]

    @property
    def gaps(self) -> Any:
        """Of a single state, intervals without a branch, (n, 2) Hz; None if they were not asked
        for.
        """
        return self._value("gaps")

    @property
    def design(self) -> Design | None:
        """Of a single state, the best network that was met; None if it was not asked for."""
        return self._value("design")  # type: ignore[no-any-return]

    @property
    def surface(self) -> SurfaceSpectrum | None:
        """Of a single state, the spectrum of the outer layer at the edge, with its waves; None if
        it was not asked for.
        """
        return self._value("surface")  # type: ignore[no-any-return]

    def _value(self, name: str) -> Any:
        """Return the value of an output; None if the scene does not ask for it."""
        if name in self.values:
            return self.values[name]
        return self[name] if OUTPUTS[name].is_of(self.scene) else None

    @cached_property
    def phonons(self) -> Phonons | None:
        """Of a single state, the source of ``bands``, ``dos`` and ``gaps``; None if none of these
        was asked for.
        """
        if not any(OUTPUTS[name].is_of(self.scene) for name in ("bands", "dos", "gaps")):
            return None
        from granphon.phonons.phonons import find_phonons

        return find_phonons(self.state, self.scene.dim)

    @cached_property
    def waves(self) -> SampleWaves | None:
        """The waves in the samples of a single state, or in its network; None without samples and
        networks.
        """
        scene = self.scene
        has_networks = scene.waves is not None and bool(scene.waves.of_networks)
        if not (scene.is_single and (has_networks or scene.serving.arrays)):
            return None
        from granphon.runs.wave_records import SampleWaves

        return SampleWaves(
            dos=self._value("sample_dos"),
            spectra=self._value("spectrum"),
            pulse=self._value("pulse"),
            motion=self._value("balls_in_motion"),
        )

    # -- a single state ----------------------------------------------------------------------------

    @property
    def state(self) -> ContactState:
        """The only state; :class:`~granphon.base.errors.InputError` if there are several."""
        return self._analysis.state

    @property
    def validity(self) -> Validity:
        """The conditions under which the model holds, of the only state."""
        return self._analysis.validity

    @cached_property
    def _analysis(self) -> Analysis:
        """The analysis of the only state, which is solved again after reading the result from its
        folder; InputError if there are several states.
        """
        return self.scene.plan.analysis

    @property
    def records(self) -> list[Mapping[str, Any]]:
        """Of each sample of the only state, or of its network, what is kept of its waves, arrays by
        name.
        """
        return self.scene.plan.records

    @property
    def velocities(self) -> SoundVelocities | None:
        """Sound velocities of the only state, m/s; None if they were not asked for."""
        return self._analysis.velocities if "velocities" in self.scene.observe else None

    @property
    def moduli(self) -> Moduli | None:
        """Elastic constants of the only state, Pa; None if the scene does not observe velocities,
        or the state has none.
        """
        return self._analysis.moduli if "velocities" in self.scene.observe else None

    @property
    def local_field(self) -> LocalField | None:
        """Local field of the effective medium; None of another medium, and for equal balls."""
        if not self.scene.packing.width:
            return None
        return self.scene.serving.medium.of(self.scene.packing).local_field

    # -- numbers -----------------------------------------------------------------------------------

    @property
    def warnings(self) -> tuple[str, ...]:
        """One sentence for each limit of validity exceeded, each number unknown or left out, and
        each figure that failed.
        """
        sentences = json.loads(self.dataset.attrs["warnings"])
        for found in (self.bands, self.dos, self.design):
            if found is not None:
                sentences += found.warnings
        return tuple(dict.fromkeys((*sentences, *self.failures)))

    @property
    def finite_overlap(self) -> bool | list[bool]:
        """Whether the numbers have the terms of relative order delta/d; a list in the order of the
        media if they differ.
        """
        if self.scene.is_single:
            return bool(self.state.finite_overlap)
        of_media = list_finite_overlap(self.dataset)
        return of_media if len(set(of_media)) > 1 else of_media[0]

    def entry(self, name: str) -> Observable | None:
        """Return the entry of the catalogue for a number of the summary; None if it has none."""
        return entry_of(name, self.scene.packing) if name in CATALOGUE else None

    def summary(self) -> dict[str, Any]:
        """Return the numbers as plain data in SI units, under the names of the library's
        attributes.

        Of several states these are the sizes of the dimensions, the number of states, the media,
        the least and the greatest of each variable of ``_EXTENTS`` that is known (forces, overlaps,
        velocities, and numbers of waves), and whether all states are valid; with the direction of
        sound, if it was given or velocities depend on it.
        """
        if not self.scene.is_single:
            return self._summarise_states()
        observed = self.scene.observe
        analysis = self._analysis
        serving = self.scene.serving
        numbers: dict[str, Any] = {"medium": self.scene.media[0].label}
        if serving.chosen_automatically:
            numbers |= {
                "choice": serving.medium.label,
                "expected_error": float(serving.errors[0]),
                "truth": str(serving.truth),
            }
        numbers |= find_all(analysis, ("state",))
        if "exponent" in self.dataset:
            numbers |= find_all(analysis, ("exponent",))
        numbers |= find_all(analysis, ("packing",))
        local_field = self.local_field
        if local_field is not None:
            numbers["local_field"] = {
                name: getattr(local_field, name) for name in ("alpha", "beta", "xi")
            }
        if "velocities" in observed:
            numbers |= find_all(analysis, ("velocities",))
        for row in self.rows or list_outputs(self.scene):
            numbers |= row.collect_numbers(self)
        data = self.dataset
        for name, entry in CATALOGUE.items():
            if entry.cost in WAVE_COSTS and not entry.dims and name in data:
                value = data[name].item()
                if np.isfinite(value):
                    numbers.setdefault(name, value)
        return numbers

    def _summarise_states(self) -> dict[str, Any]:
        """Return the numbers of several states, see :meth:`summary`."""
        data = self.dataset
        dims = [*data["valid"].dims]
        if "direction" in data.dims:
            dims.append("direction")
        sizes = {str(name): data.sizes[name] for name in dims}
        numbers: dict[str, Any] = {
            "sizes": sizes,
            "states": data["valid"].size,
            "medium": data["medium"].values,
        }
        if "direction" in data.coords:
            numbers["direction"] = json.loads(data["direction"].attrs["values"])
        elif "tensor" in data:  # some lattice is not isotropic, and its velocities are along x
            is_plane = data.sizes["voigt_row"] == 3
            numbers["direction"] = [1.0, 0.0] if is_plane else [1.0, 0.0, 0.0]
        for name in _EXTENTS:
            is_known = name in data and data[name].notnull().any()
            if is_known:
                numbers[name] = [float(data[name].min()), float(data[name].max())]
        if self.scene.errors:
            from granphon.scene.uncertainty import collect_errors

            numbers |= collect_errors(data, _EXTENTS)
        return numbers | {"valid": bool(data["valid"].all())}

    def _repr_html_(self) -> str:
        """Return a table of the numbers of :meth:`summary` with their units."""
        rows = list[tuple[str, Any, str]]()
        for name, value in self.summary().items():
            rows.append((name, value, _find_unit(self, name)))
        return write_html(type(self).__name__, rows)

    # -- files -------------------------------------------------------------------------------------

    @cached_property
    def package_versions(self) -> dict[str, str]:
        """The installed versions of the packages of which the results are made, by name."""
        libraries: tuple[str, ...] = ()
        if self.phonons is not None:
            libraries = ("ase", "phonopy", "spglib")
        elif self.waves is not None:
            libraries = ("ase",)
        return versions("numpy", "scipy", "xarray", "h5netcdf", *libraries)

    def figure(self, name: str, tell: Callable[[str], object] | None = None) -> Any:
        """Return the matplotlib figure of the file ``name``; the curves over the load for a file
        that no output has. ``tell`` is told which panels the figure has chosen.
        """
        rows = [row for _name, row in OUTPUTS.items() if row.figure == name]
        row = rows[0] if rows else OUTPUTS["sweep"]
        if tell is None:
            return row.make_figure(self)
        return row.make_figure(self, lambda sentence: tell(f"{name}: {sentence}"))


def is_complete(scene: Scene, folder: str | os.PathLike[str]) -> bool:
    """Whether ``folder`` holds every file but figures of a run, made with the installed versions of
    packages.

    A file that was changed after the run counts as missing.
    """
    target = Path(folder)
    try:
        run_versions = read_yaml(target / "summary.yaml")["versions"]
        run_scene = type(scene)(**SceneSource.of_file(target / "scene.yaml").read())
        has_same_versions = run_versions == run_versions | packages()
    except (InputError, KeyError, TypeError):
        return False
    if run_scene != scene or not has_same_versions:
        return False
    return is_whole(target, expected_files(scene, figures=False))


def _find_unit(result: RunResult, name: str) -> str:
    """Return the SI unit of a number of the summary, or of its standard error; "" for none."""
    entry = result.entry(name) or result.entry(name.removesuffix("_error"))
    return entry.unit if entry else ""


def _write_summary(result: RunResult, package_versions: Mapping[str, str]) -> str:
    """Return the text of summary.yaml, with the numbers, their units, and the
    ``package_versions`` by name.
    """
    scene = result.scene
    numbers = result.summary()
    limits = _describe_limits(result.validity) if scene.is_single else {}
    units = {name: unit for name in numbers if (unit := _find_unit(result, name))}
    return dump_yaml(
        {
            "schema": SUMMARY_SCHEMA,
            "versions": package_versions,
            "source": None if scene.source is None else scene.source.name,
            "observe": scene.observe,
            "finite_overlap": result.finite_overlap,
            **numbers,
            **limits,
            "warnings": result.warnings,
            "files": [path.name for path in result.files],
            "units": units,
        }
    )


def _describe_limits(validity: Validity) -> dict[str, Any]:
    """Return the conditions under which the model holds as plain data."""
    checks = [
        {
            "name": check.name,
            "meaning": check.meaning,
            "value": check.value,
            "limit": check.limit,
            "ok": bool(check.ok),
        }
        for check in validity.checks
    ]
    return {"ok": bool(validity.ok), "validity": checks}
