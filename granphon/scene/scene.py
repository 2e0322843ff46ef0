"""The scene: what to compute, read from a YAML file and checked before anything is computed; its
run, and its result.

Quantities have units ("8 mm") in the file only; a :class:`Scene` holds numbers in SI units. A
mistake in a file raises a :class:`~granphon.base.errors.SceneError` that names file, line and key,
what was found, what is allowed, and the likely intention.

A run computes everything first, and then writes it into one folder. The result is a data set of all
states, and of a single state its samples, bands and densities of states. A single state is a sweep
of one, with the same data set. Every figure and file is a view of the data set, or an export of the
single state for other programs. The files are these:

====================== ============================================================================
file                   holds
====================== ============================================================================
scene.yaml             the scene with its defaults written out, in SI
summary.yaml           the numbers, under the names of the library's attributes, with units,
                       versions, warnings
band.yaml              of a single state: bands, phonopy's format with eigenvectors
phonopy_params.yaml    force constants, for the phonopy command
dos.csv                density of states
surface.*              of a single state: spectrum of the outer layer at an edge, and its waves;
                       .json, .csv and .png
sample.extxyz          of a simulation at one load: the first sample, its balls with positions,
                       sizes and forces
sample_balls.csv       of a simulation with friction_history at one load: the network of the first
                       sample, whose contacts
sample_contacts.csv    have their normal and tangential forces
forces.png             force chains of that sample, and the distribution of the forces in all
                       samples
bands.png              bands, with the density of states beside them; dos.png if that alone was
                       asked for
sweep.nc, sweep.csv    every state, with velocities, moduli and bands; sweep.csv leaves out the
                       bands
sweep.png              of several states: velocities and exponents over the load, and the velocity
                       of pulses
sweep_incomplete.*     of a sweep with a path of loads that ends early: .nc and .csv of the loads
                       before, and nothing else
sweep_dos.*            of a sweep of simulations: densities of states of the arrays, .csv and .png
sweep_spectra.*        of such a sweep: frequency, width, mean free path of plane waves in the
                       arrays, .csv and .png
sample_dos.*           of a simulation: density of states of the first sample; .json, .csv and .png
                       of it
spectrum.*, pulse.*    spectral functions of the first sample along the path; a pulse through all
                       samples
damped_bands.csv       frequencies, decay and Q of bands whose contacts lose energy, if the block
                       bands asks for them
response.*             response in frequency of the network of each state: .csv and .png
motion.csv, .png       energies of balls in motion over time, and the greatest force, of each state
motion.nc              of a single state: the balls at all times; motion_contacts.csv, when the
                       wave comes to each contact
diameters.csv          the measured diameters, if they are too many for scene.yaml
====================== ============================================================================
"""

from __future__ import annotations

import json
import os
from collections.abc import Callable, Mapping, Sequence
from contextlib import nullcontext
from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING, Any, Self

import numpy as np

from granphon.array.atoms import write_extxyz
from granphon.base.errors import GranphonError, InputError
from granphon.base.progress import Progress, silent
from granphon.base.quantities import find_load_unit
from granphon.base.results import write_html
from granphon.base.scales import write_quantity
from granphon.base.staging import ResultFiles, is_whole
from granphon.base.tables import Heading, table_text
from granphon.base.text import (
    counted,
    dump_yaml,
    parse_yaml,
    read_yaml,
    require_schema,
    versions,
)
from granphon.dynamics.local_field import LocalField
from granphon.media.state import ContactState
from granphon.observables.catalogue import CATALOGUE, Analysis, Observable, entry_of, find_all
from granphon.observables.validity import Validity
from granphon.observables.velocities import Moduli, SoundVelocities
from granphon.runs.dataset import (
    SweepRun,
    list_finite_overlap,
    load_sweep,
    write_sweep,
    write_waves,
)
from granphon.runs.store import Store, TaskResult, open_store
from granphon.runs.sweep import keep_incomplete
from granphon.runs.tasks import SampleRecord
from granphon.runs.workers import packages
from granphon.scene.file import SceneSource
from granphon.scene.plan import Plan
from granphon.scene.rules import DIAMETERS_FILE
from granphon.waves.settings import NETWORK_BLOCKS, POLARISATIONS, RESPONSES

if TYPE_CHECKING:
    from concurrent.futures import Executor

    from granphon.phonons.bands import Bands
    from granphon.phonons.dos import DensityOfStates
    from granphon.phonons.phonons import Phonons
    from granphon.phonons.surfaces import SurfaceSpectrum
    from granphon.runs.dataset import Dataset
    from granphon.runs.wave_records import SampleWaves


#: version number of summary.yaml, its key "schema"
SUMMARY_SCHEMA = 1
#: the file, in the folder of the result, in which finished tasks are kept until the result has been
#: written
WORK_FILE = ".granphon-sweep"
#: figures of the waves in simulated arrays of a sweep, each with its observable
SWEEP_FIGURES = {
    "sweep_dos.png": "dos",
    "sweep_spectra.png": "spectrum",
    "sweep_gaps.png": "gaps",
    "sweep_surface.png": "surface",
}
#: stems of these files
_SWEEP_STEMS = tuple(name.removesuffix(".png") for name in SWEEP_FIGURES)
#: observables of the waves in the samples of one state, by the stems of their files
SAMPLE_WAVES = {"sample_dos": "dos", "spectrum": "spectrum", "pulse": "pulse"}
#: results that are kept in a file .json and drawn in a figure, with their observables
KEPT = {**SAMPLE_WAVES, "surface": "surface"}
#: files of a motion of a single state besides those of every state
MOTION_FILES = ("motion.nc", "motion_contacts.csv")
#: columns of a table: heading, unit, and the field of the result
_COLUMNS = {
    "sample_dos": [
        ("frequency", "Hz", "frequencies"),
        *((name, "1/Hz", name) for name in ("total", "translational", "rotational", "error")),
    ],
    "pulse": [
        ("time", "s", "times"),
        ("force_sent", "N", "sent"),
        ("coherent", "m/s", "coherent"),
        ("speckle", "m/s", "speckle_amplitude"),
    ],
}
#: names of the files of a report about a folder, which a later run in the folder makes outdated
REPORT_FILES = ("report.html", "report.md")
#: names of all files that a run may write, or a report about it
RESULT_FILES = (
    "scene.yaml",
    "summary.yaml",
    "sweep.nc",
    "sweep.csv",
    "sweep_dos.csv",
    "sweep_spectra.csv",
    "sweep_gaps.csv",
    "sweep_surface.csv",
    "band.yaml",
    "damped_bands.csv",
    "phonopy_params.yaml",
    "dos.csv",
    "sample.extxyz",
    "sample_balls.csv",
    "sample_contacts.csv",
    *(f"{stem}.{ending}" for stem in KEPT for ending in ("json", "csv")),
    *(f"{name}.{ending}" for name in NETWORK_BLOCKS for ending in ("csv", "png")),
    *MOTION_FILES,
    "sweep.png",
    *SWEEP_FIGURES,
    "bands.png",
    "dos.png",
    "forces.png",
    *(f"{stem}.png" for stem in KEPT),
    "sweep_incomplete.nc",
    "sweep_incomplete.csv",
    DIAMETERS_FILE,
    *REPORT_FILES,
)
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
    *(f"ioffe_regel_{name}" for name in POLARISATIONS),
)


@dataclass(frozen=True)
class Scene(Plan):
    """What to compute, in SI units.

    Attributes
    ----------
    packing, load : the balls and their arrangement, and the load that presses them. Balls of
        several kinds are an :class:`~granphon.media.arrangement.Arrangement`.
    media : the ways to average over a spread of diameters, one or more; by default "ema" if the
        balls differ, else "ala". Balls of several kinds have "crystal" alone. May be given as names
        ("ala", "afa", "ema", "simulation", "auto") or mappings with options, alone or in a list.
    parameters : the swept parameters of the packing, each with its values; may be given as a
        mapping.
    finite_overlap : keep the terms of relative order delta/d; True if all media are simulations in
        their exact geometry, which always have them.
    observe : which of "velocities", "bands", "gaps", "dos", "surface", "spectrum", "pulse",
        "response", "motion" to compute; spectrum, pulse and the density of states of the array
        itself, of a simulation.
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
    response, motion : which response of the network of each state to find, and how its balls move,
        if the scene observes it.
    dim : supercell of the exported force constants, a number for each period; None for the smallest
        that suffices.
    source : path of the file that the scene was read from; None for a scene made in Python.

    Raises
    ------
    InputError : a value that is not allowed.
    """

    @classmethod
    def from_yaml(cls, path: str | os.PathLike[str]) -> Self:
        """Read a scene file; :class:`~granphon.base.errors.SceneError` names the mistake in it."""
        return cls._read(SceneSource.of_file(path))

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
        scene.require()
        return scene

    def __str__(self) -> str:
        """Return what the scene says, in three short lines; no state is computed."""
        packing = self.packing
        structure = packing.structure
        if packing.kind_names:
            balls = f"crystal of {', '.join(packing.kind_names)}"
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
        numbers, figure_files = list_files(self)
        figure_files = figure_files if figures else ()
        names = (*numbers, *figure_files)
        if resume and not force and is_complete(self, target):
            files = tuple(target / name for name in names if (target / name).exists())
            return RunResult(self, target, load_sweep(target / "sweep.nc"), files=files)
        self.require_waves()
        text = self.to_yaml()
        work_file = target / WORK_FILE
        # a state that is found at once keeps no parts, but the parts of another run are not to
        # stand beside its result
        has_store = self.has_tasks or os.path.lexists(work_file)
        opened_store = open_store(work_file, force) if has_store else nullcontext()
        result_files = ResultFiles(
            target, names, force, earlier=RESULT_FILES, inputs=self.origin.inputs
        )
        with result_files.open() as locked, opened_store as store:
            with self.place_errors():
                try:
                    result = self._compute(target, executor, progress, store)
                except GranphonError as error:
                    if error.reached is None or store is None:
                        raise
                    raise keep_incomplete(error, locked, "sweep.nc", store) from None
            return _write_result(result, locked, text, names, figure_files, progress)

    def _compute(
        self, target: Path, executor: Executor | None, progress: Progress, store: Store | None
    ) -> RunResult:
        """Return the result of the scene for the folder ``target``, into which nothing is written
        yet; the ``store`` keeps finished tasks, if the scene has any.
        """
        work = SweepRun.of(self.case_grid)
        results = list[TaskResult]()
        if self.has_tasks:
            results = work.do(executor, progress, store)
        elif store is not None:
            store.claim(None)
        if not self.is_single:
            return RunResult(self, target, work.join(results))
        # a single state alone has samples, bands and densities of states
        state = work.grid.cases[0].restore(results) if results else self.state()
        with self.origin.where_it_buckles():
            return _describe_alone(self, target, work, state, results, progress)


def _write_result(
    result: RunResult,
    locked: ResultFiles,
    text: str,
    names: Sequence[str],
    figure_files: Sequence[str],
    progress: Progress,
) -> RunResult:
    """Write the files ``names`` of a result, the ``figure_files`` among them, with ``text`` as its
    scene, and return the result with the paths of those that are written: not of those that it
    leaves out, nor of figures that cannot be drawn, whose ``failures`` it has.
    """
    scene = result.scene
    libraries: tuple[str, ...] = ()
    if result.phonons is not None:
        libraries = ("ase", "phonopy", "spglib")
    elif result.waves is not None:
        libraries = ("ase",)
    package_versions = versions("numpy", "scipy", "xarray", "h5netcdf", *libraries)
    names = tuple(name for name in names if name not in result.left_out)
    figure_files = tuple(name for name in figure_files if name not in result.left_out)
    with (
        locked.staging((*figure_files, *result.left_out)) as stage,
        progress.step("writing", len(names)) as step,
    ):
        head = "# The scene as it was run, in SI units.\n"
        for package, version in package_versions.items():
            head += f"# {package} {version}\n"
        (stage / "scene.yaml").write_text(head + text, encoding="utf-8")
        if scene.diameters is not None:
            (stage / DIAMETERS_FILE).write_text(scene.diameters, encoding="utf-8")
        write_numbers(result, stage, step.advance)
        failures: dict[str, str] = {}
        if figure_files:
            from granphon.figures.style import draw

            failures = draw(result.figure, figure_files, stage)
            step.advance(len(figure_files))
        files = tuple(result.folder / name for name in names if name not in failures)
        written_result = replace(result, files=files, failures=tuple(failures.values()))
        # the last file, as the summary names the files and the failures
        summary = _write_summary(written_result, package_versions)
        (stage / "summary.yaml").write_text(summary, encoding="utf-8")
    return written_result


def list_files(scene: Scene) -> tuple[tuple[str, ...], tuple[str, ...]]:
    """Return the names of the files of numbers, and the names of the figures, that a run of a
    ``scene`` writes.
    """
    observed = scene.observe
    names = ["scene.yaml", "summary.yaml"]
    if scene.diameters is not None:
        names.append(DIAMETERS_FILE)
    names += ["sweep.nc", "sweep.csv"]
    blocks = [name for name in NETWORK_BLOCKS if name in observed]
    names += [f"{name}.csv" for name in blocks]
    if scene.observed_settings("bands") is not None:
        names.append("damped_bands.csv")
    figures = [f"{name}.png" for name in blocks]
    if not scene.is_single:
        wave_figures = [name for name, subject in SWEEP_FIGURES.items() if subject in observed]
        names += [Path(name).with_suffix(".csv").name for name in wave_figures]
        figures += ["sweep.png", *wave_figures]
        return tuple(names), tuple(figures)
    names_alone, figures_alone = _list_files_alone(scene)
    return (*names, *names_alone), (*figures, *figures_alone)


def _list_files_alone(scene: Scene) -> tuple[list[str], list[str]]:
    """Return the names of the files of numbers, and names of the figures, that a run of a single
    state writes besides those of any run.
    """
    observed = scene.observe
    names: list[str] = []
    figures: list[str] = []
    if "motion" in observed:
        names += MOTION_FILES
    if "bands" in observed:
        names += ["band.yaml", "phonopy_params.yaml"]
    if "dos" in observed:
        names.append("dos.csv")
    if "surface" in observed:
        names += ["surface.json", "surface.csv"]
        figures.append("surface.png")
    if "bands" in observed:
        figures.append("bands.png")
    elif "dos" in observed:
        figures.append("dos.png")
    for medium in scene.serving.arrays:  # one at most
        names.append("sample.extxyz")
        if medium.friction_history:
            names += ["sample_balls.csv", "sample_contacts.csv"]
        figures.append("forces.png")
        for stem, subject in SAMPLE_WAVES.items():
            if subject in observed:
                names += [f"{stem}.json", f"{stem}.csv"]
                figures.append(f"{stem}.png")
    return names, figures


def expected_files(scene: Scene, figures: bool = True) -> tuple[str, ...]:
    """Return the names of the files that a run of a ``scene`` writes, with its ``figures`` or
    without.
    """
    numbers, figure_files = list_files(scene)
    return numbers + (figure_files if figures else ())


@dataclass(frozen=True, eq=False)
class RunResult:
    """Results of a scene.

    Attributes
    ----------
    scene : the scene that was run.
    folder, files : folder of the results, and the paths of the files written there.
    dataset : every state, with velocities, moduli and bands, as :func:`granphon.runs.sweep.sweep`
        returns it.
    given : the analysis of a single state; None after reading the result from its folder.
    phonons : of a single state, the source of ``bands`` and ``dos``; None if neither was asked for,
        as of several states, and after reading the result from its folder, where files hold these.
    bands, dos, gaps : of a single state, frequencies along the path, Hz, their density of states,
        1/Hz, and intervals without a branch, (n, 2) Hz; likewise.
    surface : of a single state, the spectrum of the outer layer at the edge, with its waves;
        likewise.
    waves : the waves in the samples of a single state; likewise.
    failures : one sentence for each figure that could not be drawn, with the reason.
    """

    scene: Scene
    folder: Path
    dataset: Dataset
    given: Analysis | None = None
    phonons: Phonons | None = None
    bands: Bands | None = None
    dos: DensityOfStates | None = None
    gaps: Any = None
    surface: SurfaceSpectrum | None = None
    waves: SampleWaves | None = None
    files: tuple[Path, ...] = ()
    failures: tuple[str, ...] = ()

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
        if not self.scene.is_single:
            problem = "the result is that of a sweep"
            raise InputError(problem, "It has no single state", "Take its dataset")
        if self.given is not None:
            return self.given
        return Analysis(self.scene.state(), self.scene.direction)

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
        for spectrum in (self.bands, self.dos):
            if spectrum is not None:
                sentences += spectrum.warnings
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
        if self.bands is not None:
            numbers["top_frequency"] = float(self.bands.frequencies.max())
        if self.gaps is not None:
            numbers["gaps"] = self.gaps.tolist()
        if self.waves is not None and self.waves.pulse is not None:
            numbers["pulse_distance"] = self.waves.pulse.distance
        if "response_phase" in self.dataset:
            numbers["peaks"] = self._list_peaks()
        return numbers | self._collect_wave_values()

    def _collect_wave_values(self) -> dict[str, float]:
        """Return the observables of waves that are one number, by name, in SI units; those that are
        not finite are left out.
        """
        costs = ("pulse", "spectrum", "surface", "network")
        values: dict[str, float] = {}
        for name, entry in CATALOGUE.items():
            is_number_of_waves = entry.cost in costs and not entry.dims
            if is_number_of_waves and name in self.dataset:
                value = self.dataset[name].item()
                if np.isfinite(value):
                    values[name] = value
        return values

    def _list_peaks(self) -> dict[str, list[dict[str, float]]]:
        """Return the peaks of the response at each receiver: frequency, Hz, height and Q."""
        data = self.dataset
        receivers = data["receiver"].values.tolist()
        peaks: dict[str, list[dict[str, float]]] = {receiver: [] for receiver in receivers}
        if "peaks_frequency" not in data:
            return peaks
        quantity = next(name for name in RESPONSES.values() if name in data)
        # (receivers, peaks), nan beyond the number of peaks
        shape = (len(peaks), -1)
        frequencies = data["peaks_frequency"].values.reshape(shape).tolist()
        heights = data[f"peaks_{quantity}"].values.reshape(shape).tolist()
        qualities = data["peaks_quality"].values.reshape(shape).tolist()
        for index, receiver in enumerate(peaks):
            rows = zip(frequencies[index], heights[index], qualities[index], strict=True)
            for frequency, height, quality in rows:
                if np.isfinite(frequency):
                    peak = {"frequency": frequency, "height": height, "quality": quality}
                    peaks[receiver].append(peak)
        return peaks

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
        return numbers | {"valid": bool(data["valid"].all())}

    def _repr_html_(self) -> str:
        """Return a table of the numbers of :meth:`summary` with their units."""
        rows = list[tuple[str, Any, str]]()
        for name, value in self.summary().items():
            entry = self.entry(name)
            rows.append((name, value, entry.unit if entry else ""))
        return write_html(type(self).__name__, rows)

    # -- files -------------------------------------------------------------------------------------

    @property
    def left_out(self) -> tuple[str, ...]:
        """Names of files and figures that have nothing to hold, as no pulse could be sent."""
        if self.waves is None or "pulse" not in self.scene.observe or self.waves.pulse is not None:
            return ()
        return ("pulse.json", "pulse.csv", "pulse.png")

    def figure(self, name: str) -> Any:
        """Return the matplotlib figure of the file ``name``."""
        stem = name.removesuffix(".png")
        waves = {} if self.waves is None else self.waves.results
        if stem in ("forces", "surface", *waves):
            from granphon.figures.plot import plot

            if stem == "forces":
                return plot(self.state)
            return plot(self.surface if stem == "surface" else waves[stem])
        if stem in ("bands", "dos"):
            from granphon.figures.bands import bands_figure

            return bands_figure(self.bands, self.dos, gaps=self.gaps)
        return draw_sweep(self.dataset, name)


def _describe_alone(
    scene: Scene,
    target: Path,
    work: SweepRun,
    state: ContactState,
    results: Sequence[TaskResult],
    progress: Progress,
) -> RunResult:
    """Return the result, for the folder ``target``, of a single ``state`` with all that its scene
    observes; ``results`` are those of its samples, if it has any.
    """
    analysis = Analysis(state, scene.direction)
    records = [SampleRecord.from_result(result, 0) for result in results]
    if not records:
        has_networks = scene.waves is not None and bool(scene.waves.of_networks)
        with progress.step("networks") if has_networks else nullcontext():
            (task,) = work.grid.cases[0].media
            records = task.record_networks(state, whole=True)
    surface = None
    surface_settings = scene.observed_settings("surface")
    if surface_settings is not None:
        from granphon.phonons.surfaces import Surface

        with progress.step("surface"):
            half_space = state.cached(Surface, surface_settings.axis, surface_settings.edge)
            surface = half_space.map(surface_settings.points)
    dataset = work.join_alone(analysis, records)
    waves = None
    if records:
        from granphon.runs.wave_records import SampleWaves

        waves = SampleWaves.of(scene.waves, state, [record.of_waves for record in records])
    result = RunResult(scene, target, dataset, analysis, waves=waves, surface=surface)
    if {"bands", "dos", "gaps"}.isdisjoint(scene.observe):
        return result
    return _add_phonons(result, state, progress)


def _add_phonons(result: RunResult, state: ContactState, progress: Progress) -> RunResult:
    """Return the ``result`` of a single ``state`` with its phonons, and with the bands, the density
    of states and the gaps that its scene observes.
    """
    from granphon.phonons.phonons import Phonons

    scene = result.scene
    with progress.step("force constants"):
        phonons = Phonons(state, dim=scene.dim)
        if "bands" in scene.observe:
            _ = phonons.phonopy  # found within this step, and kept
    result = replace(result, phonons=phonons)
    if "bands" in scene.observe:
        with progress.step("bands"):
            path = scene.path
            bands = phonons.bands(path.arrays, npoints=scene.band_points, labels=path.labels)
        result = replace(result, bands=bands)
    if "dos" in scene.observe:
        with progress.step("density of states"):
            result = replace(result, dos=phonons.dos(mesh=scene.mesh))
    if "gaps" in scene.observe:
        with progress.step("gaps"):
            result = replace(result, gaps=phonons.gaps())
    return result


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


def write_numbers(result: Any, folder: Path, advance: Callable[[int], None]) -> None:
    """Write the files of numbers of a result into a ``folder``, and call ``advance`` after each.

    The run itself writes the scene, its diameters and the summary, which are counted here. Files
    that are ``left_out`` are neither written nor counted.
    """
    for name in list_files(result.scene)[0]:
        path = folder / name
        stem = name.partition(".")[0]
        match name:
            case "scene.yaml" | "summary.yaml" | "diameters.csv":
                pass
            case _ if name in result.left_out:
                continue
            case "sweep.nc":  # and sweep.csv beside it
                write_sweep(result.dataset, path)
            case "motion.nc":
                result.waves.motion.write(path)
            case "motion_contacts.csv":
                # imported here: other runs do not need motions
                from granphon.runs.wave_records import write_contacts

                write_contacts(result.waves.motion, path, result.scene.motion)
            case _ if stem in ("damped_bands", *_SWEEP_STEMS, *NETWORK_BLOCKS):
                write_waves(result.dataset, path)
            case "band.yaml":
                result.bands.write(path)
            case "phonopy_params.yaml":
                result.phonons.save(path)
            case "dos.csv":
                result.dos.write_csv(path)
            case "sample.extxyz":
                write_extxyz(path, result.state.samples[0].atoms())
            case "sample_balls.csv":  # and sample_contacts.csv
                result.state.samples[0].network.write_tables(path, folder / "sample_contacts.csv")
            case "spectrum.csv":
                result.waves.spectra.write_csv(path)
            case "sample_dos.csv" | "pulse.csv":
                _write_columns(result.waves.results[stem], stem, path)
            case "surface.json":
                _write_json(result.surface, path)
            case "surface.csv":
                result.surface.write_csv(path)
            case "sample_dos.json" | "spectrum.json" | "pulse.json":
                _write_json(result.waves.results[stem], path)
        advance(1)


def _write_columns(waves: Any, stem: str, path: Path) -> None:
    """Write the table ``path`` of the fields of ``waves``, arrays (n,), that :data:`_COLUMNS` lists
    for the ``stem`` of a file.
    """
    headings = [Heading(name, unit) for name, unit, _ in _COLUMNS[stem]]
    columns = [getattr(waves, field) for _, _, field in _COLUMNS[stem]]
    rows = np.transpose(columns).tolist()
    path.write_text(table_text(headings, rows), encoding="utf-8")


def _write_json(result: Any, path: Path) -> None:
    """Write a whole result as one line of JSON."""
    path.write_text(json.dumps(result.to_dict()) + "\n", encoding="utf-8")


def _write_summary(result: RunResult, package_versions: Mapping[str, str]) -> str:
    """Return the text of summary.yaml, with the numbers, their units, and the
    ``package_versions`` by name.
    """
    scene = result.scene
    numbers = result.summary()
    limits = _describe_limits(result.validity) if scene.is_single else {}
    units = {}
    for name in numbers:
        entry = result.entry(name)
        if entry is not None and entry.unit:
            units[name] = entry.unit
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


def read_summary(folder: Path) -> dict[str, Any]:
    """Return the content of summary.yaml in the ``folder`` of a run; raises
    :class:`~granphon.base.errors.InputError` if the file is no summary.
    """
    path = folder / "summary.yaml"
    summary = read_yaml(path)
    if not isinstance(summary, dict):
        why = "Granphon did not write it so"
        raise InputError(f"{path} holds no keys", why, "Run the scene again")
    require_schema(path, summary.get("schema"), SUMMARY_SCHEMA)
    return summary


# -- figures ---------------------------------------------------------------------------------------


def draw_sweep(
    dataset: Any,
    name: str,
    variable: str | None = None,
    rows: str | None = None,
    columns: str | None = None,
    tell: Callable[[str], object] | None = None,
) -> Any:
    """Return the matplotlib figure of one ``variable`` of a data set. Without a variable the
    ``name`` of the figure's file chooses: a block about networks, or one of ``SWEEP_FIGURES``; any
    other name means the curves of :func:`~granphon.figures.curves.sweep_figure`, which takes the
    other arguments.
    """
    stem = Path(name).stem
    if variable is None and stem in NETWORK_BLOCKS:
        from granphon.figures.plot import draw_states

        return draw_states(dataset, stem)
    if variable is None and f"{stem}.png" in SWEEP_FIGURES:
        from granphon.figures.plot import draw_waves_of_sweep

        return draw_waves_of_sweep(dataset, stem)
    from granphon.figures.curves import sweep_figure

    return sweep_figure(dataset, variable=variable, rows=rows, columns=columns, tell=tell)
