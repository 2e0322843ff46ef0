"""The names of the files that a run writes.

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

from pathlib import Path
from typing import Any

from granphon.base.errors import InputError, message
from granphon.base.text import read_yaml, require_schema
from granphon.scene.plan import Plan
from granphon.scene.rules import DIAMETERS_FILE
from granphon.scene.specification import Specification

#: tables of the balls and contacts of a sample that was loaded with friction
SAMPLE_TABLES = ("sample_balls.csv", "sample_contacts.csv")
#: what a scene observes of the waves in the samples of a simulation, with the files of numbers that it gives
WAVE_FILES: dict[str, tuple[str, ...]] = {
    "dos": ("sample_dos.json", "sample_dos.csv"), "spectrum": ("spectrum.json", "spectrum.csv"),
    "pulse": ("pulse.json", "pulse.csv"),
}  # fmt: skip
#: what a sweep observes of the waves in simulated arrays, with the table that it gives
SWEEP_TABLES = {"dos": "sweep_dos.csv", "spectrum": "sweep_spectra.csv"}
#: names of their figures
SWEEP_FIGURES = tuple(name.replace(".csv", ".png") for name in SWEEP_TABLES.values())
#: the loads of a sweep that were reached, where a path of loads has ended early
INCOMPLETE_FILES = ("sweep_incomplete.nc", "sweep_incomplete.csv")
#: names of all files that a run may write
RESULT_FILES = (
    "scene.yaml", "summary.yaml", "band.yaml", "phonopy_params.yaml", "dos.csv", "sample.extxyz", *SAMPLE_TABLES,
    "bands.png", "dos.png",
    "forces.png", *(name for names in WAVE_FILES.values() for name in (*names, names[0].replace(".json", ".png"))),
    "sweep.nc", "sweep.csv", "sweep.png", *INCOMPLETE_FILES,
    *(name for pair in zip(SWEEP_TABLES.values(), SWEEP_FIGURES, strict=True) for name in pair), DIAMETERS_FILE,
)  # fmt: skip
#: version number of summary.yaml, its key "schema"
SUMMARY_SCHEMA = 1
#: the file, in the folder of the result, in which finished tasks are kept until the result has been written
WORK_FILE = ".granphon-sweep"


def read_summary(folder: Path) -> dict[str, Any]:
    """Read summary.yaml in the folder of a run; raises :class:`~granphon.base.errors.InputError` if it is not one."""
    path = folder / "summary.yaml"
    found = read_yaml(path)
    if not isinstance(found, dict):
        raise InputError(message(f"{path} holds no keys", "Granphon did not write it so", "Run the scene again"))
    require_schema(path, found.get("schema"), SUMMARY_SCHEMA)
    return found


def figure_name(bands: bool) -> str:
    """File name of the figure of bands, or, without ``bands``, of the density of states alone."""
    return "bands.png" if bands else "dos.png"


def wave_files(observe: tuple[str, ...]) -> list[str]:
    """Return the names of the files of numbers, of the waves in samples, for what a scene of a simulation observes."""
    return [name for one, names in WAVE_FILES.items() if one in observe for name in names]


def wave_figures(observe: tuple[str, ...]) -> list[str]:
    """Return the names of the figures of the waves in samples."""
    return [name.replace(".json", ".png") for name in wave_files(observe) if name.endswith(".json")]


def expected_files(plan: Plan, figures: bool = True) -> tuple[str, ...]:
    """Names of the files that a run writes."""
    numbers, drawn = list_files(plan)
    return numbers + (drawn if figures else ())


def tell_undrawn(scene: Specification) -> str:
    """Say which figure a sweep has not, and why; an empty text if it has all."""
    varied = [name for name, values in (*scene.parameters, ("direction", scene.directions)) if len(values) > 1]
    if not scene.is_sweep or len(varied) <= 1:
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


def list_files(plan: Plan) -> tuple[tuple[str, ...], tuple[str, ...]]:
    """Names of the files of numbers, and names of the figures, that a run writes."""
    scene = plan.scene
    names = ["scene.yaml", "summary.yaml"] + ([] if scene.diameters is None else [DIAMETERS_FILE])
    names += ["sweep.nc", "sweep.csv"]
    drawn = []
    if scene.is_sweep:
        if not tell_undrawn(scene):
            drawn.append("sweep.png")
        tables = [table for name, table in SWEEP_TABLES.items() if name in scene.observe]
        names += tables
        drawn += [table.replace(".csv", ".png") for table in tables]
        return tuple(names), tuple(drawn)
    if "bands" in scene.observe:
        names += ["band.yaml", "phonopy_params.yaml"]
    if "dos" in scene.observe:
        names.append("dos.csv")
    if {"bands", "dos"} & set(scene.observe):
        drawn.append(figure_name("bands" in scene.observe))
    for arrays in plan.serving.arrays:
        names.append("sample.extxyz")
        names += SAMPLE_TABLES if arrays.friction_history else ()
        drawn.append("forces.png")
        names += wave_files(scene.observe)
        drawn += wave_figures(scene.observe)
    return tuple(names), tuple(drawn)
