"""The files that a run writes: their names, which scenes have them, and what writes and draws them.

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
from pathlib import Path
from typing import Any

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
#: figures of the waves in simulated arrays of a sweep, and what they are of
SWEEP_FIGURES = {"sweep_dos.png": "dos", "sweep_spectra.png": "spectrum"}
#: what a scene observes of the waves in the samples of one state, by the names of their files
SAMPLE_WAVES = {"sample_dos": "dos", "spectrum": "spectrum", "pulse": "pulse"}
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
#: names of all files that a run may write
RESULT_FILES = (
    "scene.yaml", "summary.yaml", "sweep.nc", "sweep.csv", "sweep_dos.csv", "sweep_spectra.csv", "band.yaml",
    "phonopy_params.yaml", "dos.csv", "sample.extxyz", "sample_balls.csv", "sample_contacts.csv",
    *(f"{stem}.{ending}" for stem in SAMPLE_WAVES for ending in ("json", "csv")),
    "sweep.png", *SWEEP_FIGURES, "bands.png", "dos.png", "forces.png", *(f"{stem}.png" for stem in SAMPLE_WAVES),
    "sweep_incomplete.nc", "sweep_incomplete.csv", DIAMETERS_FILE,
)  # fmt: skip


def list_files(plan: Plan) -> tuple[tuple[str, ...], tuple[str, ...]]:
    """Names of the files of numbers, and names of the figures, that a run writes."""
    seen, drawn = plan.scene.observe, list[str]()
    names = ["scene.yaml", "summary.yaml", *[DIAMETERS_FILE] * (plan.scene.diameters is not None), "sweep.nc", "sweep.csv"]
    if not plan.scene.is_single:
        names += ["sweep_dos.csv"] * ("dos" in seen) + ["sweep_spectra.csv"] * ("spectrum" in seen)
        drawn += ["sweep.png"] * (not tell_undrawn(plan)) + [name for name, of in SWEEP_FIGURES.items() if of in seen]
        return tuple(names), tuple(drawn)
    if "bands" in seen:
        names += ["band.yaml", "phonopy_params.yaml"]
    names += ["dos.csv"] * ("dos" in seen)
    drawn += ["bands.png"] if "bands" in seen else ["dos.png"] * ("dos" in seen)
    for medium in plan.serving.arrays:  # one at most
        waves = [stem for stem, of in SAMPLE_WAVES.items() if of in seen]
        names += ["sample.extxyz", *("sample_balls.csv", "sample_contacts.csv") * bool(medium.friction_history)]
        names += [f"{stem}.{ending}" for stem in waves for ending in ("json", "csv")]
        drawn += ["forces.png", *(f"{stem}.png" for stem in waves)]
    return tuple(names), tuple(drawn)


def expected_files(plan: Plan, figures: bool = True) -> tuple[str, ...]:
    """Names of the files that a run writes."""
    numbers, drawn = list_files(plan)
    return numbers + (drawn if figures else ())


def write_numbers(result: Any, place: Path, advance: Callable[[int], None]) -> None:
    """Write the files of numbers of a result into the folder ``place``; ``advance`` is told of each.

    Those of the scene and the summary are not among them, nor those that are ``left_out``.
    """
    for name in list_files(result.plan)[0]:
        path, stem = place / name, name.partition(".")[0]
        match name:
            case "scene.yaml" | "summary.yaml" | "diameters.csv":
                continue
            case _ if name in result.left_out:
                continue
            case "sweep.nc":  # and sweep.csv beside it
                from granphon.runs.archive import write_sweep

                write_sweep(result.dataset, path)
            case "sweep_dos.csv" | "sweep_spectra.csv":
                from granphon.runs.archive import write_waves

                write_waves(result.dataset, path)
            case "band.yaml":
                result.bands.write(path)
            case "phonopy_params.yaml":
                result.phonons.save(path)
            case "dos.csv":
                result.dos.write_csv(path)
            case "sample.extxyz":
                from granphon.array.atoms import write_extxyz

                write_extxyz(path, result.state.samples[0].atoms())
            case "sample_balls.csv":  # and sample_contacts.csv
                result.state.samples[0].network.write_tables(path, place / "sample_contacts.csv")
            case "spectrum.csv":
                result.waves.spectra.write_csv(path)
            case "sample_dos.csv" | "pulse.csv":
                found = result.waves.results[stem]
                columns = [(Heading(name, unit), getattr(found, source)) for name, unit, source in _COLUMNS[stem]]
                rows = np.transpose([values for _, values in columns]).tolist()
                path.write_text(table_text([heading for heading, _ in columns], rows), encoding="utf-8")
            case "sample_dos.json" | "spectrum.json" | "pulse.json":
                path.write_text(json.dumps(result.waves.results[stem].to_dict()) + "\n", encoding="utf-8")
        advance(1)


# -- figures --------------------------------------------------------------------------------------------------------


def tell_undrawn(plan: Plan) -> str:
    """Say which figure of several states there is not, and why; an empty text if there is one."""
    scene = plan.scene
    varied = [name for name, values in (*scene.parameters, ("direction", scene.directions)) if len(values) > 1]
    if plan.scene.is_single or len(varied) <= 1:
        return ""
    return f"sweep.png: its lines show one parameter, and {' and '.join(varied)} vary; sweep.csv has the numbers"


def draw_sweep(dataset: Any, name: str, variable: str | None = None) -> Any:
    """Draw the figure of a data set that the ``name`` of its file means, or that of one ``variable``."""
    stem = Path(name).stem
    if variable is None and f"{stem}.png" in SWEEP_FIGURES:
        from granphon.figures.spectra import sweep_dos_figure, sweep_spectra_figure

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


def read_summary(folder: Path) -> dict[str, Any]:
    """Read summary.yaml in the folder of a run; raises :class:`~granphon.base.errors.InputError` if it is not one."""
    path = folder / "summary.yaml"
    found = read_yaml(path)
    if not isinstance(found, dict):
        raise InputError(message(f"{path} holds no keys", "Granphon did not write it so", "Run the scene again"))
    require_schema(path, found.get("schema"), SUMMARY_SCHEMA)
    return found
