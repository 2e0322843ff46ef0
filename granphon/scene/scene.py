"""The scene: what to compute, read from a YAML file and checked before anything is computed; its
run, and its result.

Quantities have units ("8 mm") in the file only; a :class:`Scene` holds numbers in SI units. A
mistake in a file raises a :class:`~granphon.base.errors.SceneError` that names file, line and key,
what was found, what is allowed, and the likely intention.

A run computes everything first, and then writes it into one folder. The result is a data set of all
states, and of a single state its samples, bands and densities of states. A state is a sweep of one:
it has the same data set. Whatever is drawn or written is a view of that, or an export of the one
state for other programs. The files are these:

====================== ============================================================================
file                   holds
====================== ============================================================================
scene.yaml             the scene with every default written out, in SI
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
from granphon.base.results import write_html
from granphon.base.staging import ResultFiles, is_whole
from granphon.base.tables import Heading, table_text
from granphon.base.text import dump_yaml, parse_yaml, read_yaml, require_schema, versions
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
from granphon.runs.store import TaskResult, open_store
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
#: figures of the waves in simulated arrays of a sweep, and what they are of
SWEEP_FIGURES = {"sweep_dos.png": "dos", "sweep_spectra.png": "spectrum"}
#: what a scene observes of the waves in the samples of one state, by the names of their files
SAMPLE_WAVES = {"sample_dos": "dos", "spectrum": "spectrum", "pulse": "pulse"}
#: what is kept as a result in a file .json, with a figure of it
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
#: names of all files that a run may write
RESULT_FILES = (
    "scene.yaml",
    "summary.yaml",
    "sweep.nc",
    "sweep.csv",
    "sweep_dos.csv",
    "sweep_spectra.csv",
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
    *(f"ioffe_regel_{name}" for name in POLARISATIONS),
)


@dataclass(frozen=True)
class Scene(Plan):
    """What to compute, in SI units.

    Attributes
    ----------
    packing, load : the balls and their arrangement, and the load that presses them. Balls of
        several kinds are an
        :class:`~granphon.media.arrangement.Arrangement`.
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
        """Read a scene from a text, which messages call ``name``; raises as :meth:`from_yaml`.

        Files that it names are looked for in the working folder.
        """
        return cls._read(SceneSource(parse_yaml(text, name)))

    @classmethod
    def _read(cls, origin: SceneSource) -> Self:
        given = origin.read()
        with origin.at():
            scene = cls(**given)
        object.__setattr__(scene, "origin", origin)
        scene.require()
        return scene

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
        (names, drawn) = list_files(self)
        drawn = drawn if figures else ()
        every = (*names, *drawn)
        if resume and not force and is_complete(self, target):
            there = tuple(target / name for name in every if (target / name).exists())
            return RunResult(self, target, load_sweep(target / "sweep.nc"), files=there)
        self.require_waves()
        text = self.to_yaml()
        kept = target / WORK_FILE
        with (
            ResultFiles(
                target, every, force, earlier=RESULT_FILES, inputs=self.origin.inputs
            ).open() as locked,
            # a state that is found at once keeps no parts, but those of another run are not to
            # stand beside it
            open_store(kept, force)
            if self.has_tasks or os.path.lexists(kept)
            else nullcontext() as store,
        ):
            with self.place_errors():
                work = SweepRun.of(self.case_grid)
                parts = list[TaskResult]()
                try:
                    if self.has_tasks:
                        parts = work.do(executor, progress, store)
                    elif store is not None:
                        store.claim(None)
                    if not self.is_single:
                        result = RunResult(self, target, work.join(parts))
                    else:
                        # what only a single state has: its samples, bands and densities of states
                        state = work.grid.cases[0].restore(parts) if parts else self.state()
                        with self.origin.where_it_buckles():
                            result = _describe_alone(self, target, work, state, parts, progress)
                except GranphonError as error:
                    if error.reached is None or store is None:
                        raise
                    raise keep_incomplete(error, locked, "sweep.nc", store) from None
            others = (
                ("ase", "phonopy", "spglib")
                if result.phonons is not None
                else ("ase",) * (result.waves is not None)
            )
            used = versions("numpy", "scipy", "xarray", "h5netcdf", *others)
            every, drawn = (
                tuple(name for name in names if name not in result.left_out)
                for names in (every, drawn)
            )
            with (
                locked.staging((*drawn, *result.left_out)) as place,
                progress.step("writing", len(every)) as step,
            ):
                head = "".join(f"# {package} {number}\n" for package, number in used.items())
                (place / "scene.yaml").write_text(
                    f"# The scene as it was run, in SI units.\n{head}{text}", encoding="utf-8"
                )
                if self.diameters is not None:
                    (place / DIAMETERS_FILE).write_text(self.diameters, encoding="utf-8")
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


def list_files(scene: Scene) -> tuple[tuple[str, ...], tuple[str, ...]]:
    """Names of the files of numbers, and names of the figures, that a run writes."""
    seen = scene.observe
    drawn = list[str]()
    names = [
        "scene.yaml",
        "summary.yaml",
        *[DIAMETERS_FILE] * (scene.diameters is not None),
        "sweep.nc",
        "sweep.csv",
    ]
    names += [f"{name}.csv" for name in NETWORK_BLOCKS if name in seen]
    names += ["damped_bands.csv"] * (scene._asked("bands") is not None)
    drawn += [f"{name}.png" for name in NETWORK_BLOCKS if name in seen]
    if not scene.is_single:
        names += ["sweep_dos.csv"] * ("dos" in seen) + ["sweep_spectra.csv"] * ("spectrum" in seen)
        drawn += ["sweep.png"] + [name for name, of in SWEEP_FIGURES.items() if of in seen]
        return tuple(names), tuple(drawn)
    names += MOTION_FILES if "motion" in seen else ()
    if "bands" in seen:
        names += ["band.yaml", "phonopy_params.yaml"]
    names += ["dos.csv"] * ("dos" in seen) + ["surface.json", "surface.csv"] * ("surface" in seen)
    drawn += ["surface.png"] * ("surface" in seen)
    drawn += ["bands.png"] if "bands" in seen else ["dos.png"] * ("dos" in seen)
    for medium in scene.serving.arrays:  # one at most
        waves = [stem for stem, of in SAMPLE_WAVES.items() if of in seen]
        names += [
            "sample.extxyz",
            *("sample_balls.csv", "sample_contacts.csv") * bool(medium.friction_history),
        ]
        names += [f"{stem}.{ending}" for stem in waves for ending in ("json", "csv")]
        drawn += ["forces.png", *(f"{stem}.png" for stem in waves)]
    return tuple(names), tuple(drawn)


def expected_files(scene: Scene, figures: bool = True) -> tuple[str, ...]:
    """Names of the files that a run writes."""
    numbers, drawn = list_files(scene)
    return numbers + (drawn if figures else ())


@dataclass(frozen=True, eq=False)
class RunResult:
    """Results of a scene.

    Attributes
    ----------
    scene : what was asked for.
    folder, files : folder of the results, and the paths of the files written there.
    dataset : every state, with velocities, moduli and bands, as :func:`granphon.runs.sweep.sweep`
        returns it.
    given : of a single state, what has been found of it; None after reading it from its folder.
    phonons : of a single state, the source of ``bands`` and ``dos``; None if neither was asked for,
        as of several states, and after reading the result from its folder, where files hold these.
    bands, dos, gaps : of a single state, frequencies along the path, Hz, their density of states,
        1/Hz, and intervals without a branch, (n, 2) Hz; likewise.
    surface : of a single state, the spectrum of the outer layer at the edge, with its waves;
        likewise.
    waves : what was asked for of the waves in the samples of a single state; likewise.
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
        if not self.scene.is_single:
            raise InputError(
                "the result is that of a sweep", "It has no single state", "Take its dataset"
            )
        return (
            Analysis(self.scene.state(), self.scene.direction) if self.given is None else self.given
        )

    @property
    def velocities(self) -> SoundVelocities | None:
        """Sound velocities of the only state, m/s; None if they were not asked for."""
        return self._analysis.velocities if "velocities" in self.scene.observe else None

    @property
    def moduli(self) -> Moduli | None:
        """Elastic constants of the only state, Pa; None if velocities were not asked for, or it has
        none.
        """
        return self._analysis.moduli if "velocities" in self.scene.observe else None

    @property
    def local_field(self) -> LocalField | None:
        """Local field of the effective medium; None of another medium, and for equal balls."""
        return (
            self.scene.serving.medium.of(self.scene.packing).local_field
            if self.scene.packing.width
            else None
        )

    # -- numbers -----------------------------------------------------------------------------------

    @property
    def warnings(self) -> tuple[str, ...]:
        """One sentence for each limit of validity exceeded, each number unknown or left out, and
        each figure that failed.
        """
        found = [text for one in (self.bands, self.dos) if one is not None for text in one.warnings]
        return tuple(
            dict.fromkeys((*json.loads(self.dataset.attrs["warnings"]), *found, *self.failures))
        )

    @property
    def finite_overlap(self) -> bool | list[bool]:
        """Whether the numbers have the terms of relative order delta/d; a list in the order of the
        media if they differ.
        """
        if self.scene.is_single:
            return bool(self.state.finite_overlap)
        found = list_finite_overlap(self.dataset)
        return found if len(set(found)) > 1 else found[0]

    def entry(self, name: str) -> Observable | None:
        """Return the entry of the catalogue for a number of the summary; None if it has none."""
        return entry_of(name, self.scene.packing) if name in CATALOGUE else None

    def summary(self) -> dict[str, Any]:
        """Return the numbers as plain data in SI units, under the names of the library's
        attributes.

        Of several states these are the sizes of the dimensions, the number of states, the media,
        and the least and the greatest force, overlap and velocities; with the direction of sound,
        if it was given or velocities depend on it.
        """
        if not self.scene.is_single:
            return self._summarise_states()
        out: dict[str, Any] = {"medium": self.scene.media[0].label}
        if (serving := self.scene.serving).chosen_automatically:
            out |= {
                "choice": serving.medium.label,
                "expected_error": float(serving.errors[0]),
                "truth": str(serving.truth),
            }
        of = self._analysis
        out |= find_all(of, ("state",)) | (
            find_all(of, ("exponent",)) if "exponent" in self.dataset else {}
        )
        out |= find_all(of, ("packing",))
        if (field := self.local_field) is not None:
            out["local_field"] = {name: getattr(field, name) for name in ("alpha", "beta", "xi")}
        out |= find_all(of, ("velocities",)) if "velocities" in self.scene.observe else {}
        if self.bands is not None:
            out["top_frequency"] = float(self.bands.frequencies.max())
        if self.gaps is not None:
            out["gaps"] = self.gaps.tolist()
        if self.waves is not None and self.waves.pulse is not None:
            out["pulse_distance"] = self.waves.pulse.distance
        if "response_phase" in self.dataset:
            out["peaks"] = self._list_peaks()
        # of the waves in its samples, in its network or at its edge, what is known
        costs = ("pulse", "spectrum", "surface", "network")
        of_waves = [name for name, one in CATALOGUE.items() if one.cost in costs and not one.dims]
        known = {name: self.dataset[name].item() for name in of_waves if name in self.dataset}
        return out | {name: value for name, value in known.items() if np.isfinite(value)}

    def _list_peaks(self) -> dict[str, list[dict[str, float]]]:
        data = self.dataset
        words = ("frequency", "height", "quality")
        name = next(one for one in RESPONSES.values() if one in data)
        found: dict[str, list[dict[str, float]]] = {
            place: [] for place in data["receiver"].values.tolist()
        }
        if "peaks_frequency" in data:
            tables = [
                data[f"peaks_{word}"].values.reshape(len(found), -1)
                for word in ("frequency", name, "quality")
            ]
            for place, *rows in zip(found, *tables, strict=True):
                peaks = [
                    peak
                    for peak in zip(*map(np.ndarray.tolist, rows), strict=True)
                    if np.isfinite(peak[0])
                ]
                found[place] = [dict(zip(words, peak, strict=True)) for peak in peaks]
        return found

    def _summarise_states(self) -> dict[str, Any]:
        data = self.dataset
        along = ("direction",) * ("direction" in data.dims)
        sizes = {str(name): data.sizes[name] for name in (*data["valid"].dims, *along)}
        out: dict[str, Any] = {
            "sizes": sizes,
            "states": data["valid"].size,
            "medium": data["medium"].values,
        }
        if "direction" in data.coords:
            out["direction"] = json.loads(data["direction"].attrs["values"])
        elif "tensor" in data:  # some lattice is not isotropic, and its velocities are along x
            out["direction"] = [1.0] + [0.0] * {3: 1, 6: 2}[data.sizes["voigt_row"]]
        for name in _EXTENTS:
            if name in data and data[name].notnull().any():
                out[name] = [float(data[name].min()), float(data[name].max())]
        return out | {"valid": bool(data["valid"].all())}

    def _repr_html_(self) -> str:
        numbers = self.summary()
        entries = {name: self.entry(name) for name in numbers}
        rows = ((name, numbers[name], one.unit if one else "") for name, one in entries.items())
        return write_html(type(self).__name__, rows)

    # -- files -------------------------------------------------------------------------------------

    @property
    def left_out(self) -> tuple[str, ...]:
        """Names of files and figures that have nothing to hold, as no pulse could be sent."""
        if self.waves is None or "pulse" not in self.scene.observe or self.waves.pulse is not None:
            return ()
        return ("pulse.json", "pulse.csv", "pulse.png")

    def figure(self, name: str) -> Any:
        """Draw the matplotlib figure of the file ``name``."""
        stem = name.removesuffix(".png")
        waves = {} if self.waves is None else self.waves.results
        if stem in ("forces", "surface", *waves):
            from granphon.figures.plot import plot

            return plot(
                self.state
                if stem == "forces"
                else self.surface
                if stem == "surface"
                else waves[stem]
            )
        if stem in ("bands", "dos"):
            from granphon.figures.bands import bands_figure

            return bands_figure(self.bands, self.dos, gaps=self.gaps)
        return draw_sweep(self.dataset, name)


def _describe_alone(
    scene: Scene,
    target: Path,
    work: SweepRun,
    state: ContactState,
    parts: Sequence[TaskResult],
    progress: Progress,
) -> RunResult:
    waves = bands = dos = gaps = surface = None
    analysis = Analysis(state, scene.direction)
    records = [SampleRecord.from_part(part, 0) for part in parts]
    if not records:
        with (
            progress.step("networks")
            if scene.waves is not None and scene.waves.of_networks
            else nullcontext()
        ):
            (task,) = work.grid.cases[0].media
            records = task.record_networks(state, whole=True)
    if (edge := scene._asked("surface")) is not None:
        from granphon.phonons.surfaces import Surface

        with progress.step("surface"):
            surface = state.cached(Surface, edge.axis, edge.edge).map(edge.points)
    dataset = work.join_alone(analysis, records)
    if records:
        from granphon.runs.wave_records import SampleWaves

        waves = SampleWaves.of(scene.waves, state, [one.of_waves for one in records])
    result = RunResult(scene, target, dataset, analysis, waves=waves, surface=surface)
    if not {"bands", "dos", "gaps"} & set(scene.observe):
        return result
    from granphon.phonons.phonons import Phonons

    with progress.step("force constants"):
        phonons = Phonons(state, dim=scene.dim)
        if "bands" in scene.observe:
            _ = phonons.phonopy
    if "bands" in scene.observe:
        with progress.step("bands"):
            bands = phonons.bands(
                scene.path.arrays, npoints=scene.band_points, labels=scene.path.labels
            )
    if "dos" in scene.observe:
        with progress.step("density of states"):
            dos = phonons.dos(mesh=scene.mesh)
    if "gaps" in scene.observe:
        with progress.step("gaps"):
            gaps = phonons.gaps()
    return replace(result, phonons=phonons, bands=bands, dos=dos, gaps=gaps)


def is_complete(scene: Scene, folder: str | os.PathLike[str]) -> bool:
    """Whether ``folder`` holds every file but figures of a run, made with the installed versions of
    packages.

    A file that was changed after the run counts as missing.
    """
    target = Path(folder)
    try:
        made = read_yaml(target / "summary.yaml")["versions"]
        if (
            type(scene)(**SceneSource.of_file(target / "scene.yaml").read()) != scene
            or made != made | packages()
        ):
            return False
    except (InputError, KeyError, TypeError):
        return False
    return is_whole(target, expected_files(scene, figures=False))


def write_numbers(result: Any, place: Path, advance: Callable[[int], None]) -> None:
    """Write the files of numbers of a result into the folder ``place``; ``advance`` is told of
    each.

    Those of the scene, its diameters and the summary are written by the run, and told of here.
    Files that are ``left_out`` are neither written nor told of.
    """
    for name in list_files(result.scene)[0]:
        path = place / name
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
                # imported here: other runs do not need it
                from granphon.runs.wave_records import (
                    write_contacts,
                )

                write_contacts(result.waves.motion, path, result.scene.motion)
            case _ if stem in ("sweep_dos", "sweep_spectra", "damped_bands", *NETWORK_BLOCKS):
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
                result.state.samples[0].network.write_tables(path, place / "sample_contacts.csv")
            case "spectrum.csv":
                result.waves.spectra.write_csv(path)
            case "sample_dos.csv" | "pulse.csv":
                found = result.waves.results[stem]
                columns = [
                    (Heading(name, unit), getattr(found, source))
                    for name, unit, source in _COLUMNS[stem]
                ]
                rows = np.transpose([values for _, values in columns]).tolist()
                path.write_text(
                    table_text([heading for heading, _ in columns], rows), encoding="utf-8"
                )
            case "surface.json":
                path.write_text(json.dumps(result.surface.to_dict()) + "\n", encoding="utf-8")
            case "surface.csv":
                result.surface.write_csv(path)
            case "sample_dos.json" | "spectrum.json" | "pulse.json":
                path.write_text(
                    json.dumps(result.waves.results[stem].to_dict()) + "\n", encoding="utf-8"
                )
        advance(1)


def _write_summary(result: RunResult, used: Mapping[str, str]) -> str:
    scene = result.scene
    numbers = result.summary()
    limits: dict[str, Any] = {}
    if result.scene.is_single:
        checks = [
            {
                "name": c.name,
                "meaning": c.meaning,
                "value": c.value,
                "limit": c.limit,
                "ok": bool(c.ok),
            }
            for c in result.validity.checks
        ]
        limits = {"ok": bool(result.validity.ok), "validity": checks}
    entries = {name: result.entry(name) for name in numbers}
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
            "units": {
                name: one.unit for name, one in entries.items() if one is not None and one.unit
            },
        }
    )


def read_summary(folder: Path) -> dict[str, Any]:
    """Read summary.yaml in the folder of a run; raises :class:`~granphon.base.errors.InputError` if
    it is not one.
    """
    path = folder / "summary.yaml"
    found = read_yaml(path)
    if not isinstance(found, dict):
        raise InputError(
            f"{path} holds no keys", "Granphon did not write it so", "Run the scene again"
        )
    require_schema(path, found.get("schema"), SUMMARY_SCHEMA)
    return found


# -- figures ---------------------------------------------------------------------------------------


def draw_sweep(dataset: Any, name: str, variable: str | None = None) -> Any:
    """Draw the figure of a data set that the ``name`` of its file means, or that of one
    ``variable``.
    """
    stem = Path(name).stem
    if variable is None and stem in NETWORK_BLOCKS:
        from granphon.figures.plot import draw_states

        return draw_states(dataset, stem)
    if variable is None and f"{stem}.png" in SWEEP_FIGURES:
        from granphon.figures.waves import sweep_dos_figure, sweep_spectra_figure

        return sweep_dos_figure(dataset) if stem == "sweep_dos" else sweep_spectra_figure(dataset)
    from granphon.figures.curves import sweep_figure

    return sweep_figure(dataset, variable=variable)
