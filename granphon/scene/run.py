"""Running a scene: everything is computed first, and then written into one folder.

The files are those of :mod:`granphon.scene.result_files`.
"""

from __future__ import annotations

import json
import os
from collections.abc import Mapping
from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING, Any, ClassVar

from granphon.array.atoms import write_extxyz
from granphon.array.pressed_sample import PressedSample
from granphon.base.errors import GranphonError, InputError, MechanismError
from granphon.base.progress import Progress, Step, silent
from granphon.base.staging import ResultFiles
from granphon.base.text import dump_yaml, parse_yaml, read_text, versions
from granphon.base.written_files import is_written, read_written_files
from granphon.dynamics.local_field import LocalField
from granphon.media.acoustics import lattice_without_overlap
from granphon.media.choice import Rung
from granphon.media.mean_field import EffectiveMedium
from granphon.media.state import ContactState
from granphon.observables.catalogue import CATALOGUE, Analysis, Observable, entry_of, find_all, warn_of_missing_error
from granphon.observables.validity import Validity, validity
from granphon.observables.velocities import Moduli, SoundVelocities, moduli
from granphon.scene.notebook import Summarised
from granphon.scene.reader import Origin
from granphon.scene.result_files import (
    DIAMETERS_FILE,
    RESULT_FILES,
    SAMPLE_TABLES,
    WAVE_FILES,
    WORK_FILE,
    expected_files,
    list_files,
    wave_figures,
)
from granphon.sweeps.jobs import LATTICE_BANDS, describe_mechanism
from granphon.sweeps.samples import solve_state
from granphon.sweeps.store import Store, open_store
from granphon.sweeps.workers import packages
from granphon.waves.settings import POLARISATIONS, WAVES

if TYPE_CHECKING:
    from concurrent.futures import Executor

    from xarray import Dataset

    from granphon.phonons.phonons import Bands, DensityOfStates, Phonons
    from granphon.scene.sample_waves import SampleWaves
    from granphon.scene.scene import Scene

__all__ = ["RunResult", "SweepResult", "expected_files", "is_complete", "run"]

#: version number of the layout of summary.yaml, its key "schema"
SUMMARY_SCHEMA = 1
#: variables of a sweep whose least and greatest values the summary lists
_EXTENTS = (
    "force", "overlap", "longitudinal", "transverse", "transverse_slow", "transverse_fast", "pulse_velocity",
    "time_of_flight", "coherent_fraction", *(f"ioffe_regel_{name}" for name in POLARISATIONS),
)  # fmt: skip


@dataclass(frozen=True)
class RunResult(Summarised):
    """Results of a scene of one state; those that the scene did not ask for are None.

    Attributes
    ----------
    folder, files : folder of the results, and the paths of the files written there.
    state : the state of the contacts.
    medium, load : label of the medium, and kind of the load: "force" (also for a side force), "pressure" or "overlap".
    validity : the conditions under which the model holds.
    velocities, moduli : sound velocities, m/s, and elastic constants, Pa.
    phonons : the source of ``bands`` and ``dos``.
    bands, dos : frequencies along the path, Hz, and their density of states, 1/Hz.
    local_field : local field of the effective medium; None in any other medium, and for equal balls.
    rung : the medium that an automatic medium has chosen, and its expected error; None if the scene names its medium.
    waves : what was asked for of the waves in the samples of a simulation; None if nothing was.
    failures : one sentence for each figure that could not be drawn, with the reason.
    """

    folder: Path
    state: ContactState
    medium: str
    load: str
    local_field: LocalField | None
    validity: Validity
    velocities: SoundVelocities | None
    moduli: Moduli | None
    phonons: Phonons | None
    bands: Bands | None
    dos: DensityOfStates | None
    files: tuple[Path, ...]
    rung: Rung | None = None
    waves: SampleWaves | None = None
    failures: tuple[str, ...] = ()

    @property
    def warnings(self) -> tuple[str, ...]:
        """One sentence for each limit of validity exceeded, each number unknown or left out, and each figure that failed."""
        spectra = self.phonons is not None and bool(self.state.samples)
        left_out = (LATTICE_BANDS,) if spectra else ()
        if self.velocities is None and self.mechanism is not None:
            left_out = (describe_mechanism(self.mechanism), *left_out)
        found = [text for one in (self.velocities, self.bands, self.dos) if one is not None for text in one.warnings]
        found += self.waves.warnings if self.waves is not None else ()
        own = tuple(dict.fromkeys((*self.validity.warnings, *found)))
        return own + warn_of_missing_error(self._exponents) + left_out + self.failures

    @property
    def finite_overlap(self) -> bool:
        """Whether the numbers have the terms of relative order delta/d."""
        return bool(self.state.finite_overlap)

    @cached_property
    def mechanism(self) -> MechanismError | None:
        """The error that the velocities of a mechanism raise; None if the lattice is rigid."""
        try:
            lattice_without_overlap(self.state).require_rigid()
        except MechanismError as error:
            return error
        return None

    def entry(self, name: str) -> Observable | None:
        """Return the entry of the catalogue for a number of the summary; None if it has none."""
        return entry_of(name, self.state.packing) if name in CATALOGUE else None

    @cached_property
    def _analysis(self) -> Analysis:
        return Analysis(self.state, None, self.velocities, self.moduli)

    @cached_property
    def _exponents(self) -> dict[str, Any]:
        """The local exponent, by name; empty for a simulation without velocities, as it needs two more equilibria there."""
        asked = self.velocities is not None or not self.state.samples
        return find_all(self._analysis, ("exponent",)) if asked else {}

    def summary(self) -> dict[str, Any]:
        """Return the numbers as plain data in SI units, under the names of the library's attributes."""
        out: dict[str, Any] = {"medium": self.medium}
        if self.rung is not None:
            out |= {"choice": self.rung.medium.label, "expected_error": float(self.rung.errors[0])}
            out["truth"] = str(self.rung.truth)
        out |= find_all(self._analysis, ("state",)) | self._exponents | find_all(self._analysis, ("packing",))
        if self.local_field is not None:
            out["local_field"] = {name: getattr(self.local_field, name) for name in ("alpha", "beta", "xi")}
        if self.velocities is not None:
            out |= find_all(self._analysis, ("velocities",))
        if self.bands is not None:
            out["top_frequency"] = float(self.bands.frequencies.max())
        if self.waves is not None:
            out |= self.waves.summary()
        return out

    @property
    def packages(self) -> tuple[str, ...]:
        """Names of the packages that the computation used, besides numpy and scipy."""
        return ("ase", "phonopy", "spglib") if self.phonons is not None else ("ase",) * bool(self.state.samples)

    def write(self, place: Path, step: Step) -> None:
        """Write the files of the bands, the density of states and the sample into the existing folder ``place``."""
        if self.state.samples:
            sample = self.state.samples[0]
            write_extxyz(place / "sample.extxyz", sample.atoms())
            step.advance()
            if isinstance(sample, PressedSample):
                sample.network.write_tables(*(place / name for name in SAMPLE_TABLES))
                step.advance(len(SAMPLE_TABLES))
        if self.bands is not None and self.phonons is not None:
            self.bands.write(place / "band.yaml")
            self.phonons.save(place / "phonopy_params.yaml")
            step.advance(2)
        if self.dos is not None:
            self.dos.write_csv(place / "dos.csv")
            step.advance()
        if self.waves is not None:
            self.waves.write(place, step)

    @property
    def left_out(self) -> tuple[str, ...]:
        """Names of files and figures that have nothing to hold, as no pulse could be sent."""
        if self.waves is None or "pulse.json" in self.waves.files:
            return ()
        return ("pulse.json", "pulse.csv", "pulse.png")

    def figure(self, name: str) -> Any:
        """Draw the matplotlib figure of the file ``name``."""
        if name == "forces.png":
            from granphon.figures.forces import forces_figure

            return forces_figure(self.state)
        if self.waves is not None and name in wave_figures(WAVES):
            return self.waves.figure(name)
        from granphon.figures.bands import bands_figure

        return bands_figure(bands=self.bands, dos=self.dos)


@dataclass(frozen=True)
class SweepResult(Summarised):
    """Results of a scene of many states.

    Attributes
    ----------
    folder, files : folder of the results, and the paths of the files written there.
    dataset : the data set that :func:`granphon.sweeps.sweep.sweep` returns.
    failures : one sentence for each figure that could not be drawn, with the reason.
    """

    #: names of the packages that the computation used, besides numpy and scipy
    packages: ClassVar[tuple[str, ...]] = ("xarray", "h5netcdf")
    #: names of files that have nothing to hold
    left_out: ClassVar[tuple[str, ...]] = ()

    folder: Path
    dataset: Dataset
    files: tuple[Path, ...]
    failures: tuple[str, ...] = ()

    @property
    def warnings(self) -> tuple[str, ...]:
        """One sentence for each condition of validity that fails, with medium and parameters, and for each failed figure."""
        return (*json.loads(self.dataset.attrs["warnings"]), *self.failures)

    @property
    def finite_overlap(self) -> bool | list[bool]:
        """Whether the numbers have the terms of relative order delta/d; a list in the order of the media if they differ."""
        from granphon.sweeps.dataset import list_finite_overlap  # here: a scene of one state does not need it

        found = list_finite_overlap(self.dataset)
        return found if len(set(found)) > 1 else found[0]

    def summary(self) -> dict[str, Any]:
        """Return the sizes of the dimensions, and the least and the greatest force, overlap and velocities in SI units.

        The direction of sound, if it was given or velocities depend on it, the number of states, the media, and whether all
        states are valid are added.
        """
        data = self.dataset
        along = ("direction",) * ("direction" in data.dims)
        sizes = {str(name): data.sizes[name] for name in (*data["valid"].dims, *along)}
        out: dict[str, Any] = {"sizes": sizes, "states": data["valid"].size, "medium": data["medium"].values}
        if "direction" in data.coords:
            out["direction"] = json.loads(data["direction"].attrs["values"])
        elif "tensor" in data:  # some lattice is not isotropic, and its velocities are along x
            out["direction"] = [1.0] + [0.0] * {3: 1, 6: 2}[data.sizes["voigt_row"]]
        for name in _EXTENTS:
            if name in data:
                out[name] = [float(data[name].min()), float(data[name].max())]
        return out | {"valid": bool(data["valid"].all())}

    def entry(self, name: str) -> Observable | None:
        """Return the entry of the catalogue for a number of the summary; None if it has none."""
        units = self.dataset[name].attrs if name in self.dataset else {}
        return replace(CATALOGUE[name], unit=units.get("units", CATALOGUE[name].unit)) if name in CATALOGUE else None

    def write(self, place: Path, step: Step) -> None:
        """Write the data set and its table into the existing folder ``place``."""
        from granphon.sweeps.archive import write_sweep, write_waves

        write_sweep(self.dataset, place / "sweep.nc")
        step.advance(2 + len(write_waves(self.dataset, place)))

    def figure(self, name: str) -> Any:
        """Draw the matplotlib figure of the file ``name``."""
        from granphon.scene.sweep_figures import draw_sweep

        return draw_sweep(self.dataset, name)


def run(
    scene: Scene,
    folder: str | os.PathLike[str],
    *,
    force: bool = False,
    progress: Progress = silent,
    figures: bool = True,
    resume: bool = False,
    executor: Executor | None = None,
) -> RunResult | SweepResult:
    """Compute what ``scene`` observes, and only that, and write it into ``folder``.

    Parameters
    ----------
    scene : what to compute.
    folder : folder of the results, made if it does not exist. No other run can write into it meanwhile. If anything fails it
        is left as it was found, except that finished tasks stay in one file, from which the same scene goes on.
    force : replace an earlier result, remove its files that this scene does not write, and discard the finished part of
        another sweep. A file that granphon did not write, that was changed since, or that the scene reads is never replaced.
    progress : is told how far the work has come.
    figures : draw bands.png (dos.png, sweep.png, forces.png) too; a figure that cannot be drawn is a warning of the result.
    resume : if the sweep is complete (see :func:`is_complete`), read it, and compute and write nothing. A sweep that was
        cut off continues from its finished part with or without this.
    executor : does tasks side by side: those of a sweep, or the samples of one state; the numbers do not depend on it.

    Returns
    -------
    :class:`SweepResult` if the scene is a sweep, else :class:`RunResult`.

    Raises
    ------
    FileExistsInRunError : without ``force``, a file would be overwritten, or the finished part of another scene or version
        would be discarded; or a file may not be replaced at all. Raised before anything is computed.
    OutputError : the folder cannot be written, or another run is writing into it.
    GranphonError : the computation fails; then no result has been written. If a path of loads with friction ends early, the
        loads before it are in sweep_incomplete.nc and sweep_incomplete.csv, and ``reached`` of the error is their data set.
    """
    target, (names, drawn) = Path(folder), list_files(scene)
    drawn = drawn if figures else ()
    every = (*names, *drawn)
    if resume and not force and scene.is_sweep and is_complete(scene, target):
        from granphon.sweeps.archive import load_sweep

        there = tuple(target / name for name in every if (target / name).exists())
        return SweepResult(target, load_sweep(target / "sweep.nc"), there)
    if not scene.is_sweep:
        scene.plan.require_waves()
    text = scene.to_yaml()
    result: RunResult | SweepResult
    with (
        ResultFiles(target, every, force, earlier=RESULT_FILES, inputs=scene.inputs).open() as locked,
        open_store(target / WORK_FILE, force) as store,
    ):
        if scene.is_sweep:
            try:
                result = SweepResult(target, scene.sweep(progress, executor, store=store), ())
            except GranphonError as error:
                if error.reached is None:
                    raise
                from granphon.sweeps.unfinished import keep_incomplete  # imported here: it needs what only a sweep needs

                raise keep_incomplete(error, locked, "sweep.nc", store) from None
        else:
            state = _find_state(scene, progress, executor, store)
            with scene.plan.origin.where_it_buckles():
                result = _observe(scene, state, target, progress)
        used = versions("numpy", "scipy", *result.packages)
        every, drawn = (tuple(name for name in names if name not in result.left_out) for names in (every, drawn))
        with locked.staging((*drawn, *result.left_out)) as place, progress.step("writing", len(every)) as step:
            head = "".join(f"# {package} {number}\n" for package, number in used.items())
            _write(place / "scene.yaml", f"# The scene as it was run, in SI units.\n{head}{text}")
            if scene.diameters is not None:
                _write(place / DIAMETERS_FILE, scene.diameters)
            result.write(place, step)
            failures: dict[str, str] = {}
            if drawn:
                from granphon.figures.style import draw

                failures = draw(result.figure, drawn, place)
                step.advance(len(drawn))
            files = tuple(target / name for name in every if name not in failures)
            result = replace(result, files=files, failures=tuple(failures.values()))
            _write(place / "summary.yaml", _write_summary(result, scene, used))
    return result


def is_complete(scene: Scene, folder: str | os.PathLike[str]) -> bool:
    """Whether ``folder`` holds every file but figures of a run of ``scene``, made with the installed versions of packages.

    A file that was changed after the run counts as missing.
    """
    target, written = Path(folder), read_written_files(folder)
    if not all(name in written for name in expected_files(scene, figures=False)):
        return False
    try:
        made = parse_yaml(read_text(target / "summary.yaml"), "summary.yaml").data["versions"]
        if type(scene)(**Origin.of_file(target / "scene.yaml").read()) != scene or made != made | packages():
            return False
    except (InputError, KeyError, TypeError):
        return False
    return all(is_written(target / name, written[name]) for name in expected_files(scene, figures=False))


def _find_state(scene: Scene, progress: Progress, executor: Executor | None, store: Store) -> ContactState:
    """Find the state of a scene that has one; the samples of a simulation are tasks, whose results the store keeps."""
    if not scene.has_tasks:
        store.claim(None)
        return scene.state()
    with scene.plan.place_errors():
        return solve_state(scene.rung, "velocities" in scene.observe, executor, progress, store)


def _observe(scene: Scene, state: ContactState, target: Path, progress: Progress) -> RunResult:
    """Compute what a scene observes of its one state; none of the files is written yet."""
    report = validity(state)
    velocities, constants = None, None
    if "velocities" in scene.observe:
        constants = moduli(state) if "longitudinal" in state.wave_names else None
        velocities = Analysis(state, scene.direction).velocities
    phonons, bands, dos = _compute_spectra(scene, state, progress)
    waves = None
    if state.samples and WAVE_FILES.keys() & set(scene.observe):
        from granphon.scene.sample_waves import find_sample_waves

        waves = find_sample_waves(scene, state, progress)
    rung = scene.rung
    medium = rung.medium.of(scene.packing)
    field = medium.local_field if isinstance(medium, EffectiveMedium) and scene.packing.width else None
    load = scene.load.applied.kind
    automatic = rung if scene.media[0].is_automatic else None
    label = scene.media[0].label
    return RunResult(
        folder=target, state=state, medium=label, load=load, local_field=field, validity=report, velocities=velocities,
        moduli=constants, phonons=phonons, bands=bands, dos=dos, files=(), rung=automatic,
        waves=waves,
    )  # fmt: skip


def _compute_spectra(
    scene: Scene, state: ContactState, progress: Progress
) -> tuple[Phonons | None, Bands | None, DensityOfStates | None]:
    if not {"bands", "dos"} & set(scene.observe):
        return None, None, None
    from granphon.phonons.phonons import Phonons

    bands = dos = None
    with progress.step("force constants"):
        phonons = Phonons(state, dim=scene.dim)
        _ = phonons.phonopy
    if "bands" in scene.observe:
        with progress.step("bands"):
            bands = phonons.bands(scene.path.arrays, npoints=scene.band_points, labels=scene.path.labels)
    if "dos" in scene.observe:
        with progress.step("density of states"):
            dos = phonons.dos(mesh=scene.grid)
    return phonons, bands, dos


def _write_summary(result: RunResult | SweepResult, scene: Scene, used: Mapping[str, str]) -> str:
    numbers = result.summary()
    limits: dict[str, Any] = {}
    if isinstance(result, RunResult):
        checks = [
            {"name": c.name, "meaning": c.meaning, "value": c.value, "limit": c.limit, "ok": bool(c.ok)}
            for c in result.validity.checks
        ]
        limits = {"ok": bool(result.validity.ok), "validity": checks}
    return dump_yaml(
        {
            "schema": SUMMARY_SCHEMA,
            "versions": used,
            "source": None if scene.source is None else scene.source.name,
            "observe": scene.observe,
            "finite_overlap": result.finite_overlap,
            **numbers,
            **limits,
            "warnings": result.warnings,
            "files": [path.name for path in result.files],
            "units": {name: one.unit for name in numbers if (one := result.entry(name)) is not None and one.unit},
        }
    )


def _write(path: Path, text: str) -> None:
    path.write_text(text, encoding="utf-8")
