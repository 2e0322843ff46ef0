"""The files that a run writes: their names, which scenes have them, and what writes or draws them.

=====================  =====================================================================================
file                   holds
=====================  =====================================================================================
scene.yaml             the scene with every default written out, in SI
summary.yaml           the numbers, under the names of the library's attributes, with units, versions, warnings
band.yaml              of a single state: bands, phonopy's format with eigenvectors
phonopy_params.yaml    force constants, for the phonopy command
dos.csv                density of states
sample.extxyz          of a simulation at one load: the first sample, its balls with positions, sizes and forces
sample_balls.csv       of a simulation with friction_history at one load: the network of the first sample, whose contacts
sample_contacts.csv    have their normal and tangential forces
forces.png             force chains of that sample, and the distribution of the forces in all samples
bands.png              bands, with the density of states beside them; dos.png if that alone was asked for
sweep.nc, sweep.csv    every state, with velocities, moduli and bands; sweep.csv leaves out the bands
sweep.png              of several states: velocities and exponents over the load, and the velocity of pulses
sweep_incomplete.*     of a sweep with a path of loads that ends early: .nc and .csv of the loads before, and nothing else
sweep_dos.*            of a sweep of simulations: densities of states of the arrays, .csv and .png
sweep_spectra.*        of such a sweep: frequency, width, mean free path of plane waves in the arrays, .csv and .png
sample_dos.*           of a simulation: density of states of the first sample; .json, .csv and .png of it
spectrum.*, pulse.*    spectral functions of the first sample along the path; a pulse through all samples
diameters.csv          the measured diameters, if they are too many for scene.yaml
=====================  =====================================================================================
"""

from __future__ import annotations

import json
from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from granphon.base.errors import InputError, message
from granphon.base.tables import Heading, table_text
from granphon.base.text import read_yaml, require_schema
from granphon.scene.plan import Plan
from granphon.scene.rules import DIAMETERS_FILE

#: version number of summary.yaml, its key "schema"
SUMMARY_SCHEMA = 1
#: the file, in the folder of the result, in which finished tasks are kept until the result has been written
WORK_FILE = ".granphon-sweep"
#: the loads of a sweep that were reached, where a path of loads has ended early
_INCOMPLETE_FILES = ("sweep_incomplete.nc", "sweep_incomplete.csv")
#: figures of the waves in simulated arrays of a sweep
SWEEP_FIGURES = ("sweep_dos.png", "sweep_spectra.png")
#: what a scene observes of the waves in the samples of one state, by the names of their files
SAMPLE_WAVES = {"sample_dos": "dos", "spectrum": "spectrum", "pulse": "pulse"}


class Output(NamedTuple):
    """Files of a run that are written together: their names, which plans have them, and what writes them into a folder.

    A figure is one file that is drawn: ``write`` then takes no folder, and returns the figure.
    """

    names: tuple[str, ...]
    is_asked: Callable[[Plan], bool]
    write: Callable[..., Any]


# -- numbers --------------------------------------------------------------------------------------------------------


def _observes(name: str, one: bool) -> Callable[[Plan], bool]:
    """Return what tells whether a plan of ``one`` state, or of several, observes something."""
    return lambda plan: plan.is_single == one and name in plan.scene.observe


def _samples(plan: Plan) -> bool:
    """Whether a plan has a single state that is simulated."""
    return plan.is_single and bool(plan.serving.arrays)


def _observes_in_samples(name: str, plan: Plan) -> bool:
    return _samples(plan) and name in plan.scene.observe


def _write_sweep(result: Any, place: Path) -> None:
    from granphon.runs.archive import write_sweep

    write_sweep(result.dataset, place / "sweep.nc")


def _write_sweep_waves(name: str) -> Callable[[Any, Path], None]:
    def write(result: Any, place: Path) -> None:
        from granphon.runs.archive import write_waves

        write_waves(result.dataset, place / name)

    return write


def _write_bands(result: Any, place: Path) -> None:
    result.bands.write(place / "band.yaml")
    result.phonons.save(place / "phonopy_params.yaml")


def _write_sample(result: Any, place: Path) -> None:
    from granphon.array.atoms import write_extxyz

    write_extxyz(place / "sample.extxyz", result.state.samples[0].atoms())


def _write_contacts(result: Any, place: Path) -> None:
    result.state.samples[0].network.write_tables(place / "sample_balls.csv", place / "sample_contacts.csv")


def _write_sample_waves(stem: str) -> Callable[[Any, Path], None]:
    """Return what writes a result of the waves in samples, whole as JSON, and as a table."""

    def write(result: Any, place: Path) -> None:
        found = result.waves.results[stem]
        (place / f"{stem}.json").write_text(json.dumps(found.to_dict()) + "\n", encoding="utf-8")
        if stem == "spectrum":
            found.write_csv(place / "spectrum.csv")
            return
        columns = [(Heading(name, unit), getattr(found, source)) for name, unit, source in _COLUMNS[stem]]
        rows = np.transpose([values for _, values in columns]).tolist()
        (place / f"{stem}.csv").write_text(table_text([heading for heading, _ in columns], rows), encoding="utf-8")

    return write


#: columns of a table: heading, unit, and the field of the result
_COLUMNS = {
    "sample_dos": [
        ("frequency", "Hz", "frequencies"),
        *((name, "1/Hz", name) for name in ("total", "translational", "rotational", "error")),
    ],
    "pulse": [
        ("time", "s", "times"), ("force_sent", "N", "sent"), ("coherent", "m/s", "coherent"),
        ("speckle", "m/s", "speckle_amplitude"),
    ],
}  # fmt: skip
_NUMBERS = (
    Output(("sweep.nc", "sweep.csv"), lambda plan: True, _write_sweep),
    Output(("sweep_dos.csv",), _observes("dos", one=False), _write_sweep_waves("sweep_dos.csv")),
    Output(("sweep_spectra.csv",), _observes("spectrum", one=False), _write_sweep_waves("sweep_spectra.csv")),
    Output(("band.yaml", "phonopy_params.yaml"), _observes("bands", one=True), _write_bands),
    Output(("dos.csv",), _observes("dos", one=True), lambda result, place: result.dos.write_csv(place / "dos.csv")),
    Output(("sample.extxyz",), _samples, _write_sample),
    Output(
        ("sample_balls.csv", "sample_contacts.csv"),
        lambda plan: _samples(plan) and plan.serving.arrays[0].friction_history,
        _write_contacts,
    ),
    *(
        Output(
            (f"{stem}.json", f"{stem}.csv"),
            partial(_observes_in_samples, name),
            _write_sample_waves(stem),
        )
        for stem, name in SAMPLE_WAVES.items()
    ),
)


# -- figures --------------------------------------------------------------------------------------------------------


def tell_undrawn(plan: Plan) -> str:
    """Say which figure of several states there is not, and why; an empty text if there is one."""
    scene = plan.scene
    varied = [name for name, values in (*scene.parameters, ("direction", scene.directions)) if len(values) > 1]
    if plan.is_single or len(varied) <= 1:
        return ""
    return f"sweep.png: its lines show one parameter, and {' and '.join(varied)} vary; sweep.csv has the numbers"


def draw_sweep(dataset: Any, name: str, variable: str | None = None) -> Any:
    """Draw the figure of a data set that the ``name`` of its file means, or that of one ``variable``."""
    stem = Path(name).stem
    if variable is None and f"{stem}.png" in SWEEP_FIGURES:
        from granphon.figures.sweep_waves import sweep_dos_figure, sweep_spectra_figure

        return sweep_dos_figure(dataset) if stem == "sweep_dos" else sweep_spectra_figure(dataset)
    from granphon.figures.sweeps import sweep_figure

    return sweep_figure(dataset) if variable is None else sweep_figure(dataset, variable=variable)


def draw_spectra(bands: Any, dos: Any, asymptotes: Any = None) -> Any:
    """Draw the figure of bands, of a density of states, or of both."""
    from granphon.figures.bands import bands_figure

    return bands_figure(bands=bands, dos=dos, asymptotes=asymptotes)


def draw_sample_waves(stem: str, result: Any) -> Any:
    """Draw the figure of one of the :data:`SAMPLE_WAVES`."""
    if stem == "pulse":
        from granphon.figures.pulses import pulse_figure

        return pulse_figure(result)
    from granphon.figures.spectra import sample_dos_figure, spectrum_figure

    return spectrum_figure(result) if stem == "spectrum" else sample_dos_figure(result)


def _draw_sample(stem: str, result: Any) -> Any:
    return draw_sample_waves(stem, result.waves.results[stem])


def _draw_of_sweep(name: str, result: Any) -> Any:
    return draw_sweep(result.dataset, name)


def _draw_forces(result: Any) -> Any:
    from granphon.figures.forces import forces_figure

    return forces_figure(result.state)


_FIGURES = (
    Output(
        ("sweep.png",),
        lambda plan: not plan.is_single and not tell_undrawn(plan),
        partial(_draw_of_sweep, "sweep.png"),
    ),
    *(
        Output((name,), _observes(observed, one=False), partial(_draw_of_sweep, name))
        for name, observed in zip(SWEEP_FIGURES, ("dos", "spectrum"), strict=True)
    ),
    Output(("bands.png",), _observes("bands", one=True), lambda result: draw_spectra(result.bands, result.dos)),
    Output(
        ("dos.png",),
        lambda plan: _observes("dos", one=True)(plan) and "bands" not in plan.scene.observe,
        lambda result: draw_spectra(None, result.dos),
    ),
    Output(("forces.png",), _samples, _draw_forces),
    *(
        Output(
            (f"{stem}.png",),
            partial(_observes_in_samples, name),
            partial(_draw_sample, stem),
        )
        for stem, name in SAMPLE_WAVES.items()
    ),
)


# -- what a run writes ----------------------------------------------------------------------------------------------

#: names of all files that a run may write
RESULT_FILES = (
    "scene.yaml", "summary.yaml", *(name for one in (*_NUMBERS, *_FIGURES) for name in one.names), *_INCOMPLETE_FILES,
    DIAMETERS_FILE,
)  # fmt: skip


def list_files(plan: Plan) -> tuple[tuple[str, ...], tuple[str, ...]]:
    """Names of the files of numbers, and names of the figures, that a run writes."""
    names = ["scene.yaml", "summary.yaml"] + ([] if plan.scene.diameters is None else [DIAMETERS_FILE])
    names += [name for one in _NUMBERS if one.is_asked(plan) for name in one.names]
    return tuple(names), tuple(name for one in _FIGURES if one.is_asked(plan) for name in one.names)


def expected_files(plan: Plan, figures: bool = True) -> tuple[str, ...]:
    """Names of the files that a run writes."""
    numbers, drawn = list_files(plan)
    return numbers + (drawn if figures else ())


def write_numbers(result: Any, place: Path, advance: Callable[[int], None]) -> None:
    """Write the files of numbers of a result into the folder ``place``; ``advance`` is told how many there are by now."""
    for one in _NUMBERS:
        if one.is_asked(result.plan) and not set(one.names) & set(result.left_out):
            one.write(result, place)
            advance(len(one.names))


def draw_figure(result: Any, name: str) -> Any:
    """Draw the figure of the file ``name``."""
    (one,) = (one for one in _FIGURES if name in one.names)
    return one.write(result)


def read_summary(folder: Path) -> dict[str, Any]:
    """Read summary.yaml in the folder of a run; raises :class:`~granphon.base.errors.InputError` if it is not one."""
    path = folder / "summary.yaml"
    found = read_yaml(path)
    if not isinstance(found, dict):
        raise InputError(message(f"{path} holds no keys", "Granphon did not write it so", "Run the scene again"))
    require_schema(path, found.get("schema"), SUMMARY_SCHEMA)
    return found
