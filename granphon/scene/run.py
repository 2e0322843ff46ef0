"""Running a scene: everything is computed first, and then written into one folder.

The files are those of :mod:`granphon.scene.result_files`.
"""

from __future__ import annotations

import os
from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

from granphon.base.errors import GranphonError, InputError
from granphon.base.progress import Progress, silent
from granphon.base.staging import ResultFiles, is_whole
from granphon.base.text import dump_yaml, read_yaml, versions
from granphon.observables.catalogue import Analysis
from granphon.runs.samples import SampleRecord
from granphon.runs.store import Store, TaskResult, open_store
from granphon.runs.sweep import SweepRun, keep_incomplete
from granphon.runs.workers import packages
from granphon.scene.plan import Plan
from granphon.scene.reader import SceneSource
from granphon.scene.result_files import (
    RESULT_FILES,
    SUMMARY_SCHEMA,
    WORK_FILE,
    expected_files,
    list_files,
    write_numbers,
)
from granphon.scene.results import RunResult
from granphon.scene.rules import DIAMETERS_FILE

if TYPE_CHECKING:
    from concurrent.futures import Executor


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
    scene, target, (names, drawn) = plan.scene, Path(folder), list_files(plan)
    drawn = drawn if figures else ()
    every = (*names, *drawn)
    if resume and not force and is_complete(plan, target):
        from granphon.runs.archive import load_sweep

        there = tuple(target / name for name in every if (target / name).exists())
        return RunResult(plan, target, load_sweep(target / "sweep.nc"), files=there)
    plan.require_waves()
    text = scene.to_yaml()
    with (
        ResultFiles(target, every, force, earlier=RESULT_FILES, inputs=scene.inputs).open() as locked,
        open_store(target / WORK_FILE, force) as store,
    ):
        with plan.place_errors():
            work = SweepRun.of(plan.grid, **scene.bands)
            try:
                if plan.is_single:
                    result = _run_alone(plan, target, work, progress, executor, store)
                else:
                    result = RunResult(plan, target, work.join(work.do(executor, progress, store)))
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
            write_numbers(result, place, step.advance)
            failures: dict[str, str] = {}
            if drawn:
                from granphon.figures.style import draw

                failures = draw(result.figure, drawn, place)
                step.advance(len(drawn))
            files = tuple(target / name for name in every if name not in failures)
            result = replace(result, files=files, failures=tuple(failures.values()))
            (place / "summary.yaml").write_text(_write_summary(result, used), encoding="utf-8")
    return result


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
    return is_whole(target, expected_files(plan, figures=False))


def _run_alone(
    plan: Plan, target: Path, work: SweepRun, progress: Progress, executor: Executor | None, store: Store
) -> RunResult:
    """Find a single state, and what only a single state has: its samples, bands and densities of states."""
    scene, waves, parts = plan.scene, None, list[TaskResult]()
    if plan.has_tasks:
        parts = work.do(executor, progress, store)
    else:
        store.claim(None)
    state = work.cases[0].restore(parts) if parts else plan.state()
    with plan.origin.where_it_buckles():
        analysis, records = Analysis(state, scene.direction), [SampleRecord.from_part(part, 0) for part in parts]
        dataset = work.join_alone(analysis, records)
        if records:
            from granphon.runs.wave_records import SampleWaves

            waves = SampleWaves.of(scene.waves, state, [one.of_waves for one in records])
        result = RunResult(plan, target, dataset, analysis, waves=waves)
        if not {"bands", "dos"} & set(scene.observe):
            return result
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
        return replace(result, phonons=phonons, bands=bands, dos=dos)


def _write_summary(result: RunResult, used: Mapping[str, str]) -> str:
    scene, numbers = result.scene, result.summary()
    limits: dict[str, Any] = {}
    if result.plan.is_single:
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
