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
from granphon.base.staging import ResultFiles
from granphon.base.text import dump_yaml, parse_yaml, read_text, versions
from granphon.base.written_files import is_written, read_written_files
from granphon.media.mean_field import EffectiveMedium
from granphon.media.state import ContactState
from granphon.observables.catalogue import Analysis
from granphon.observables.validity import validity
from granphon.observables.velocities import moduli
from granphon.scene.fields import DIAMETERS_FILE
from granphon.scene.plan import Plan
from granphon.scene.reader import Origin
from granphon.scene.result_files import (
    RESULT_FILES,
    WAVE_FILES,
    WORK_FILE,
    expected_files,
    list_files,
)
from granphon.scene.results import RunResult, SweepResult
from granphon.scene.specification import Specification
from granphon.sweeps.samples import solve_state
from granphon.sweeps.store import Store, open_store
from granphon.sweeps.workers import packages

if TYPE_CHECKING:
    from concurrent.futures import Executor

    from granphon.phonons.phonons import Bands, DensityOfStates, Phonons

__all__ = ["is_complete", "run"]

#: version number of the layout of summary.yaml, its key "schema"
SUMMARY_SCHEMA = 1


def run(
    plan: Plan,
    folder: str | os.PathLike[str],
    *,
    force: bool = False,
    progress: Progress = silent,
    figures: bool = True,
    resume: bool = False,
    executor: Executor | None = None,
) -> RunResult | SweepResult:
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
    scene, target, (names, drawn) = plan.scene, Path(folder), list_files(plan)
    drawn = drawn if figures else ()
    every = (*names, *drawn)
    if resume and not force and scene.is_sweep and is_complete(plan, target):
        from granphon.sweeps.archive import load_sweep

        there = tuple(target / name for name in every if (target / name).exists())
        return SweepResult(target, load_sweep(target / "sweep.nc"), there)
    if not scene.is_sweep:
        plan.require_waves()
    text = scene.to_yaml()
    result: RunResult | SweepResult
    with (
        ResultFiles(target, every, force, earlier=RESULT_FILES, inputs=scene.inputs).open() as locked,
        open_store(target / WORK_FILE, force) as store,
    ):
        if scene.is_sweep:
            try:
                result = SweepResult(target, plan.sweep(progress, executor, store=store), ())
            except GranphonError as error:
                if error.reached is None:
                    raise
                from granphon.sweeps.unfinished import keep_incomplete  # imported here: it needs what only a sweep needs

                raise keep_incomplete(error, locked, "sweep.nc", store) from None
        else:
            state = _find_state(plan, progress, executor, store)
            with plan.origin.where_it_buckles():
                result = _observe(plan, state, target, progress)
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


def is_complete(plan: Plan, folder: str | os.PathLike[str]) -> bool:
    """Whether ``folder`` holds every file but figures of a run, made with the installed versions of packages.

    A file that was changed after the run counts as missing.
    """
    target, written = Path(folder), read_written_files(folder)
    if not all(name in written for name in expected_files(plan, figures=False)):
        return False
    try:
        made = parse_yaml(read_text(target / "summary.yaml"), "summary.yaml").data["versions"]
        if type(plan.scene)(**Origin.of_file(target / "scene.yaml").read()) != plan.scene or made != made | packages():
            return False
    except (InputError, KeyError, TypeError):
        return False
    return all(is_written(target / name, written[name]) for name in expected_files(plan, figures=False))


def _find_state(plan: Plan, progress: Progress, executor: Executor | None, store: Store) -> ContactState:
    """Find the state of a scene that has one; the samples of a simulation are tasks, whose results the store keeps."""
    if not plan.has_tasks:
        store.claim(None)
        return plan.state()
    with plan.place_errors():
        return solve_state(plan.rung, "velocities" in plan.scene.observe, executor, progress, store)


def _observe(plan: Plan, state: ContactState, target: Path, progress: Progress) -> RunResult:
    """Compute what a scene observes of its one state; none of the files is written yet."""
    scene, report = plan.scene, validity(state)
    velocities, constants = None, None
    if "velocities" in scene.observe:
        constants = moduli(state) if "longitudinal" in state.wave_names else None
        velocities = Analysis(state, scene.direction).velocities
    phonons, bands, dos = _compute_spectra(scene, state, progress)
    waves = None
    if state.samples and WAVE_FILES.keys() & set(scene.observe):
        from granphon.scene.sample_waves import find_sample_waves

        waves = find_sample_waves(scene, state, progress)
    rung = plan.rung
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
    scene: Specification, state: ContactState, progress: Progress
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


def _write_summary(result: RunResult | SweepResult, scene: Specification, used: Mapping[str, str]) -> str:
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
