"""Running a scene: everything is computed first, and then written into one folder.

The result is a data set of all states, and of a single state its samples, bands and densities of states. A state is a sweep
of one: it has the same data set. Whatever is drawn or written is a view of that, or an export of the one state for other
programs. The files are those of :mod:`granphon.scene.result_files`.
"""

from __future__ import annotations

import json
import os
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from granphon.base.errors import GranphonError, InputError, message
from granphon.base.notebook import write_html
from granphon.base.progress import Progress, silent
from granphon.base.staging import ResultFiles, is_whole
from granphon.base.text import dump_yaml, read_yaml, versions
from granphon.dynamics.local_field import LocalField
from granphon.media.state import ContactState
from granphon.observables.catalogue import CATALOGUE, Analysis, Observable, entry_of, find_all
from granphon.observables.validity import Validity
from granphon.observables.velocities import Moduli, SoundVelocities
from granphon.runs.samples import SampleRecord
from granphon.runs.store import TaskResult, open_store
from granphon.runs.sweep import SweepRun, keep_incomplete
from granphon.runs.workers import packages
from granphon.scene import result_files
from granphon.scene.plan import Plan
from granphon.scene.reader import SceneSource
from granphon.scene.rules import DIAMETERS_FILE
from granphon.scene.specification import Specification
from granphon.waves.settings import POLARISATIONS

if TYPE_CHECKING:
    from concurrent.futures import Executor

    from granphon.phonons.bands import Bands
    from granphon.phonons.dos import DensityOfStates
    from granphon.phonons.phonons import Phonons
    from granphon.runs.dataset import Dataset
    from granphon.runs.wave_records import SampleWaves


#: variables of which the summary of several states lists the least and the greatest value
_EXTENTS = (
    "force", "overlap", "longitudinal", "transverse", "transverse_slow", "transverse_fast", "pulse_velocity",
    "time_of_flight", "coherent_fraction", *(f"ioffe_regel_{name}" for name in POLARISATIONS),
)  # fmt: skip
#: what the summary of one state says of the waves in its samples, where it is known
_OF_WAVES = [name for name, one in CATALOGUE.items() if one.cost in ("pulse", "spectrum") and not one.dims]


@dataclass(frozen=True, eq=False)
class RunResult:
    """Results of a scene.

    Attributes
    ----------
    plan : of the scene.
    folder, files : folder of the results, and the paths of the files written there.
    dataset : every state, with velocities, moduli and bands, as :func:`granphon.runs.sweep.sweep` returns it.
    given : of a single state, what has been found of it; None after reading it from its folder.
    phonons : of a single state, the source of ``bands`` and ``dos``; None if neither was asked for, as of several states,
        and after reading the result from its folder, where files hold these.
    bands, dos : of a single state, frequencies along the path, Hz, and their density of states, 1/Hz; likewise.
    waves : what was asked for of the waves in the samples of a single state; likewise.
    failures : one sentence for each figure that could not be drawn, with the reason.
    """

    plan: Plan
    folder: Path
    dataset: Dataset
    given: Analysis | None = None
    phonons: Phonons | None = None
    bands: Bands | None = None
    dos: DensityOfStates | None = None
    waves: SampleWaves | None = None
    files: tuple[Path, ...] = ()
    failures: tuple[str, ...] = ()

    @property
    def scene(self) -> Specification:
        """What was asked for."""
        return self.plan.scene

    # -- a single state -------------------------------------------------------------------------------------------------

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
        if not self.plan.scene.is_single:
            raise InputError(message("the result is that of a sweep", "It has no single state", "Take its dataset"))
        return Analysis(self.plan.state(), self.scene.direction) if self.given is None else self.given

    @property
    def velocities(self) -> SoundVelocities | None:
        """Sound velocities of the only state, m/s; None if they were not asked for."""
        return self._analysis.velocities if "velocities" in self.scene.observe else None

    @property
    def moduli(self) -> Moduli | None:
        """Elastic constants of the only state, Pa; None if velocities were not asked for, or it has none."""
        return self._analysis.moduli if "velocities" in self.scene.observe else None

    @property
    def local_field(self) -> LocalField | None:
        """Local field of the effective medium; None of another medium, and for equal balls."""
        medium = self.plan.serving.medium.of(self.scene.packing)
        return medium.local_field if self.scene.packing.width else None

    # -- numbers --------------------------------------------------------------------------------------------------------

    @property
    def warnings(self) -> tuple[str, ...]:
        """One sentence for each limit of validity exceeded, each number unknown or left out, and each figure that failed."""
        found = [text for one in (self.bands, self.dos) if one is not None for text in one.warnings]
        return tuple(dict.fromkeys((*json.loads(self.dataset.attrs["warnings"]), *found, *self.failures)))

    @property
    def finite_overlap(self) -> bool | list[bool]:
        """Whether the numbers have the terms of relative order delta/d; a list in the order of the media if they differ."""
        from granphon.runs.dataset import list_finite_overlap

        if self.plan.scene.is_single:
            return bool(self.state.finite_overlap)
        found = list_finite_overlap(self.dataset)
        return found if len(set(found)) > 1 else found[0]

    def entry(self, name: str) -> Observable | None:
        """Return the entry of the catalogue for a number of the summary; None if it has none."""
        return entry_of(name, self.scene.packing) if name in CATALOGUE else None

    def summary(self) -> dict[str, Any]:
        """Return the numbers as plain data in SI units, under the names of the library's attributes.

        Of several states these are the sizes of the dimensions, the number of states, the media, and the least and the
        greatest force, overlap and velocities; with the direction of sound, if it was given or velocities depend on it.
        """
        if not self.plan.scene.is_single:
            return self._summarise_states()
        out: dict[str, Any] = {"medium": self.scene.media[0].label}
        if (serving := self.plan.serving).chosen_automatically:
            out |= {"choice": serving.medium.label, "expected_error": float(serving.errors[0]), "truth": str(serving.truth)}
        of = self._analysis
        out |= find_all(of, ("state",)) | (find_all(of, ("exponent",)) if "exponent" in self.dataset else {})
        out |= find_all(of, ("packing",))
        if (field := self.local_field) is not None:
            out["local_field"] = {name: getattr(field, name) for name in ("alpha", "beta", "xi")}
        out |= find_all(of, ("velocities",)) if "velocities" in self.scene.observe else {}
        if self.bands is not None:
            out["top_frequency"] = float(self.bands.frequencies.max())
        if self.waves is not None and self.waves.pulse is not None:
            out["pulse_distance"] = self.waves.pulse.distance
        known = {name: self.dataset[name].item() for name in _OF_WAVES if name in self.dataset}
        return out | {name: value for name, value in known.items() if np.isfinite(value)}

    def _summarise_states(self) -> dict[str, Any]:
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

    def _repr_html_(self) -> str:
        numbers = self.summary()
        entries = {name: self.entry(name) for name in numbers}
        return write_html(
            type(self).__name__, ((name, numbers[name], one.unit if one else "") for name, one in entries.items())
        )

    # -- files ----------------------------------------------------------------------------------------------------------

    @property
    def left_out(self) -> tuple[str, ...]:
        """Names of files and figures that have nothing to hold, as no pulse could be sent."""
        if self.waves is None or "pulse" not in self.scene.observe or self.waves.pulse is not None:
            return ()
        return ("pulse.json", "pulse.csv", "pulse.png")

    def figure(self, name: str) -> Any:
        """Draw the matplotlib figure of the file ``name``."""
        stem = name.removesuffix(".png")
        if stem == "forces":
            from granphon.figures.forces import forces_figure

            return forces_figure(self.state)
        if self.waves is not None and stem in result_files.SAMPLE_WAVES:
            return result_files.draw_sample_waves(stem, self.waves.results[stem])
        return (
            result_files.draw_spectra(self.bands, self.dos)
            if stem in ("bands", "dos")
            else result_files.draw_sweep(self.dataset, name)
        )


def run(
    plan: Plan,
    folder: str | os.PathLike[str],
    *,
    force: bool = False,
    progress: Progress = silent,
    figures: bool = True,
    resume: bool = False,
    executor: Executor | None = None,
) -> RunResult:
    """Compute what a scene observes, and only that, and write it into ``folder``.

    Parameters
    ----------
    plan : of the scene.
    folder : folder of the results, made if it does not exist. No other run can write into it meanwhile. If anything fails it
        is left as it was found, except that finished tasks stay in one file, from which the same scene goes on.
    force : replace an earlier result, remove its files that this scene does not write, and discard the finished part of
        another sweep. A file that granphon did not write, that was changed since, or that the scene reads is never replaced.
    progress : is told how far the work has come.
    figures : draw bands.png (dos.png, sweep.png, forces.png) too; a figure that cannot be drawn is a warning of the result.
    resume : if the result is complete (see :func:`is_complete`), read it, and compute and write nothing. A run that was
        cut off continues from its finished part with or without this.
    executor : does tasks side by side; the numbers do not depend on it.

    Raises
    ------
    FileExistsInRunError : without ``force``, a file would be overwritten, or the finished part of another scene or version
        would be discarded; or a file may not be replaced at all. Raised before anything is computed.
    OutputError : the folder cannot be written, or another run is writing into it.
    GranphonError : the computation fails; then no result has been written. If a path of loads with friction ends early, the
        loads before it are in sweep_incomplete.nc and sweep_incomplete.csv, and ``reached`` of the error is their data set.
    """
    scene, target, (names, drawn) = plan.scene, Path(folder), result_files.list_files(plan)
    drawn = drawn if figures else ()
    every = (*names, *drawn)
    if resume and not force and is_complete(plan, target):
        from granphon.runs.archive import load_sweep

        there = tuple(target / name for name in every if (target / name).exists())
        return RunResult(plan, target, load_sweep(target / "sweep.nc"), files=there)
    plan.require_waves()
    text = scene.to_yaml()
    with (
        ResultFiles(target, every, force, earlier=result_files.RESULT_FILES, inputs=scene.inputs).open() as locked,
        open_store(target / result_files.WORK_FILE, force) as store,
    ):
        with plan.place_errors():
            work, parts = SweepRun.of(plan.grid, **scene.bands), list[TaskResult]()
            try:
                if plan.has_tasks:
                    parts = work.do(executor, progress, store)
                else:
                    store.claim(None)
                if not scene.is_single:
                    result = RunResult(plan, target, work.join(parts))
                else:
                    # what only a single state has: its samples, bands and densities of states
                    state = work.cases[0].restore(parts) if parts else plan.state()
                    with plan.origin.where_it_buckles():
                        result = _describe_alone(plan, target, work, state, parts, progress)
            except GranphonError as error:
                if error.reached is None:
                    raise
                raise keep_incomplete(error, locked, "sweep.nc", store) from None
        others = ("ase", "phonopy", "spglib") if result.phonons is not None else ("ase",) * (result.waves is not None)
        used = versions("numpy", "scipy", "xarray", "h5netcdf", *others)
        every, drawn = (tuple(name for name in names if name not in result.left_out) for names in (every, drawn))
        with locked.staging((*drawn, *result.left_out)) as place, progress.step("writing", len(every)) as step:
            head = "".join(f"# {package} {number}\n" for package, number in used.items())
            (place / "scene.yaml").write_text(f"# The scene as it was run, in SI units.\n{head}{text}", encoding="utf-8")
            if scene.diameters is not None:
                (place / DIAMETERS_FILE).write_text(scene.diameters, encoding="utf-8")
            result_files.write_numbers(result, place, step.advance)
            failures: dict[str, str] = {}
            if drawn:
                from granphon.figures.style import draw

                failures = draw(result.figure, drawn, place)
                step.advance(len(drawn))
            files = tuple(target / name for name in every if name not in failures)
            result = replace(result, files=files, failures=tuple(failures.values()))
            (place / "summary.yaml").write_text(_write_summary(result, used), encoding="utf-8")
    return result


def _describe_alone(
    plan: Plan, target: Path, work: SweepRun, state: ContactState, parts: Sequence[TaskResult], progress: Progress
) -> RunResult:
    """Return what a scene observes of a single state; ``parts`` are what was found of its samples."""
    scene, waves, bands, dos = plan.scene, None, None, None
    analysis, records = Analysis(state, scene.direction), [SampleRecord.from_part(part, 0) for part in parts]
    dataset = work.join_alone(analysis, records)
    if records:
        from granphon.runs.wave_records import SampleWaves

        waves = SampleWaves.of(scene.waves, state, [one.of_waves for one in records])
    result = RunResult(plan, target, dataset, analysis, waves=waves)
    if not {"bands", "dos"} & set(scene.observe):
        return result
    from granphon.phonons.phonons import Phonons

    with progress.step("force constants"):
        phonons = Phonons(state, dim=scene.dim)
        _ = phonons.phonopy
    if "bands" in scene.observe:
        with progress.step("bands"):
            bands = phonons.bands(scene.path.arrays, npoints=scene.band_points, labels=scene.path.labels)
    if "dos" in scene.observe:
        with progress.step("density of states"):
            dos = phonons.dos(mesh=scene.grid)
    return replace(result, phonons=phonons, bands=bands, dos=dos)


def is_complete(plan: Plan, folder: str | os.PathLike[str]) -> bool:
    """Whether ``folder`` holds every file but figures of a run, made with the installed versions of packages.

    A file that was changed after the run counts as missing.
    """
    target = Path(folder)
    try:
        made = read_yaml(target / "summary.yaml")["versions"]
        if type(plan.scene)(**SceneSource.of_file(target / "scene.yaml").read()) != plan.scene or made != made | packages():
            return False
    except (InputError, KeyError, TypeError):
        return False
    return is_whole(target, result_files.expected_files(plan, figures=False))


def _write_summary(result: RunResult, used: Mapping[str, str]) -> str:
    scene, numbers = result.scene, result.summary()
    limits: dict[str, Any] = {}
    if result.plan.scene.is_single:
        checks = [
            {"name": c.name, "meaning": c.meaning, "value": c.value, "limit": c.limit, "ok": bool(c.ok)}
            for c in result.validity.checks
        ]
        limits = {"ok": bool(result.validity.ok), "validity": checks}
    return dump_yaml(
        {
            "schema": result_files.SUMMARY_SCHEMA,
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
