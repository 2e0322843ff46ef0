"""The names of the files that a run writes."""

from __future__ import annotations

__all__ = ["DIAMETERS_FILE", "RESULT_FILES", "WORK_FOLDER", "figure_name"]

#: table in which a run writes the diameters of a measured spread, if they are too many for the scene file
DIAMETERS_FILE = "diameters.csv"
#: names of all files that a run may write
RESULT_FILES = (
    "scene.yaml", "summary.yaml", "band.yaml", "phonopy_params.yaml", "dos.csv", "sample.extxyz", "bands.png", "dos.png",
    "forces.png", "sweep.nc", "sweep.csv", "sweep.png", DIAMETERS_FILE,
)  # fmt: skip
#: the folder, inside that of the result, where the finished tasks of a sweep are kept until its result has been written
WORK_FOLDER = ".granphon-sweep"


def figure_name(bands: bool) -> str:
    """File name of the figure of bands, or, without ``bands``, of the density of states alone."""
    return "bands.png" if bands else "dos.png"
