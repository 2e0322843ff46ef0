"""The names of the files that a run writes."""

from __future__ import annotations

__all__ = ["DIAMETERS_FILE", "RESULT_FILES", "WAVE_FILES", "WORK_FOLDER", "figure_name", "wave_figures", "wave_files"]

#: table in which a run writes the diameters of a measured spread, if they are too many for the scene file
DIAMETERS_FILE = "diameters.csv"
#: what a scene observes of the waves in the samples of a simulation, with the files of numbers that it gives
WAVE_FILES: dict[str, tuple[str, ...]] = {
    "dos": ("sample_dos.json", "sample_dos.csv"), "spectrum": ("spectrum.json", "spectrum.csv"),
    "pulse": ("pulse.json", "pulse.csv"),
}  # fmt: skip
#: names of all files that a run may write
RESULT_FILES = (
    "scene.yaml", "summary.yaml", "band.yaml", "phonopy_params.yaml", "dos.csv", "sample.extxyz", "bands.png", "dos.png",
    "forces.png", *(name for names in WAVE_FILES.values() for name in (*names, names[0].replace(".json", ".png"))),
    "sweep.nc", "sweep.csv", "sweep.png", DIAMETERS_FILE,
)  # fmt: skip
#: the folder, inside that of the result, where the finished tasks of a sweep are kept until its result has been written
WORK_FOLDER = ".granphon-sweep"


def figure_name(bands: bool) -> str:
    """File name of the figure of bands, or, without ``bands``, of the density of states alone."""
    return "bands.png" if bands else "dos.png"


def wave_files(observe: tuple[str, ...]) -> list[str]:
    """Return the names of the files of numbers, of the waves in samples, for what a scene of a simulation observes."""
    return [name for one, names in WAVE_FILES.items() if one in observe for name in names]


def wave_figures(observe: tuple[str, ...]) -> list[str]:
    """Return the names of the figures of the waves in samples."""
    return [name.replace(".json", ".png") for name in wave_files(observe) if name.endswith(".json")]
