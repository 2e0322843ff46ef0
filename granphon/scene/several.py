"""Results of several runs, read from their folders or files, and drawn in one figure."""

from __future__ import annotations

import os
from collections.abc import Callable, Sequence
from contextlib import suppress
from pathlib import Path
from typing import TYPE_CHECKING, Any

from granphon.base.errors import InputError, MissingFileError, message
from granphon.base.reading import read_bytes
from granphon.base.staging import ResultFiles, read_written_files
from granphon.base.text import read_yaml
from granphon.scene.result_files import read_summary

if TYPE_CHECKING:
    from granphon.figures.runs import Run
    from granphon.fits.fit import WidthFit


_FORMATS = (".pdf", ".png", ".svg")
#: the figure of several runs, if it is given no name
_FIGURE = "comparison.png"

#: the files of results that are drawn over the load, as bands, and as densities of states
DRAWN = ("sweep.nc", "fit.yaml", "band.yaml", "dos.csv")
#: what a state of one load leaves
_SUMMARY, _SCENE = "summary.yaml", "scene.yaml"


def draw_together(
    sources: Sequence[str | os.PathLike[str]],
    out: str | os.PathLike[str] | None = None,
    force: bool = False,
    *,
    x: str | None = None,
    y: str | None = None,
    data: Sequence[str | os.PathLike[str]] = (),
    backend: str | None = None,
) -> Path:
    """Draw the results of several runs in one figure, and return the path of its file.

    Parameters
    ----------
    sources : folders of runs and of fits, or files of results in them.
    out : file of the figure, whose ending .pdf, .png or .svg is the format; by default comparison.png in the working folder.
    force : overwrite a file that granphon wrote and that was not changed since.
    x, y, data : as in :func:`granphon.figures.comparison.plot_together`.
    backend : matplotlib backend that draws.

    Raises
    ------
    MissingFileError : there is no such folder or file, or a file of a run is missing.
    InputError : the runs cannot share an axis, a file is damaged, or the format is unknown; nothing is written then.
    FigureError : matplotlib cannot draw it.
    FileExistsInRunError, OutputError : the figure cannot be written.
    """
    target = Path(_FIGURE if out is None else out)
    require_format(target.name)
    names = [str(source) for source in sources]
    if (double := next((name for name in names if names.count(name) > 1), None)) is not None:
        raise InputError(message(f"{double} is given twice", mend="Give each run once"))
    given = [Path(name) for name in (*names, *map(str, data))]
    with ResultFiles(target.parent, [target.name], force, inputs=[one for one in given if one.is_file()]).open() as locked:
        folders = [path for path in map(Path, names) if path.is_dir()]

        def draw() -> Any:
            from granphon.figures.comparison import comparison_figure

            runs = [read_run(name) for name in names]
            balls = _find_balls_per_side(names) if data else None
            return comparison_figure(runs, x=x, y=y, data=data, balls_per_side=balls)

        figure = read_unchanged(folders, draw)
        from granphon.figures.style import save_figure

        with locked.staging() as place:
            save_figure(figure, place / target.name, backend=backend)
    return target


def require_format(name: str) -> None:
    """Raise :class:`~granphon.base.errors.InputError` if the ending of a name names no format of figures."""
    if Path(name).suffix not in _FORMATS:
        raise InputError(message(f"{name} has an ending that names no figure format", mend="Use " + ", ".join(_FORMATS)))


def _require_folder(source: Path) -> None:
    """Raise :class:`~granphon.base.errors.MissingFileError` if there is no such folder."""
    if not source.is_dir():
        what = f"{source} is no folder" if os.path.lexists(source) else f"there is no folder {source}"
        raise MissingFileError(message(what, mend="Give the folder of a run"))


def find_results(source: Path) -> dict[str, Path]:
    """Return the files of the run in a folder that are drawn, by name.

    Raises :class:`~granphon.base.errors.MissingFileError` if there is no such folder, or a file is missing that a run wrote.
    """
    _require_folder(source)
    # whatever has the name is read, and a folder or a link to nothing is then an error
    have = {name: source / name for name in DRAWN if os.path.lexists(source / name)}
    if lost := [name for name in DRAWN if name not in have and name in _list_results(source)]:
        what = f"{source} holds no {' and no '.join(lost)}, though a run wrote it there"
        mend = "Run the scene again, or copy what is to be drawn into a folder of its own"
        raise MissingFileError(message(what, "The figure would leave it out", mend))
    return have


def _list_results(folder: Path) -> set[str]:
    """Return the names of the files of the run in ``folder``, as granphon's hidden list or summary.yaml tells them."""
    names = set(read_written_files(folder))
    with suppress(InputError, AttributeError, TypeError):  # without a summary that can be read, the list alone counts
        names |= set(read_yaml(folder / _SUMMARY).get("files", ()))
    return names


def read_unchanged(folders: Sequence[Path], read: Callable[[], Any]) -> Any:
    """Return what ``read`` returns; :class:`~granphon.base.errors.InputError` if a folder is written into meanwhile."""
    before = [read_written_files(folder) for folder in folders]
    found = read()
    for folder, written in zip(folders, before, strict=True):
        if read_written_files(folder) != written:
            what = f"{folder} was written into while it was read"
            raise InputError(message(what, "The figure would mix two results", "Draw it again"))
    return found


def read_run(source: str | os.PathLike[str]) -> Run:
    """Read the results in the folder of a run, or in one of its files.

    Raises :class:`~granphon.base.errors.MissingFileError` if there is nothing of that name, and
    :class:`~granphon.base.errors.InputError` if it holds no results, or damaged ones.
    """
    from granphon.figures.runs import Run

    path, name = Path(source), str(source)
    if path.name == _SUMMARY and path.is_file():
        read_summary(path.parent)
        path = path.with_name("sweep.nc")  # whose numbers it tells
    have = {_name_kind(path): path} if path.is_file() else find_results(path)
    if "fit.yaml" in have:
        return Run.of(name, read_fit(have["fit.yaml"]))
    dataset = bands = dos = None
    if "sweep.nc" in have:
        from granphon.sweeps.archive import load_sweep

        dataset = load_sweep(have["sweep.nc"])
    if "band.yaml" in have:
        from granphon.phonons.bands import Bands

        bands = Bands.read(have["band.yaml"])
    if "dos.csv" in have:
        from granphon.phonons.dos import DensityOfStates

        dos = DensityOfStates.read_csv(have["dos.csv"])
    if bands is None and dos is None and dataset is None:
        what = f"{name} holds no results to draw with others"
        raise InputError(message(what, mend="Give the folder of a run or of a fit, or one of its files, such as sweep.nc"))
    return Run(name, dataset=dataset, bands=bands, dos=dos)


def _name_kind(path: Path) -> str:
    """Return the name under which a file of results is known, by its ending where it was renamed."""
    if path.name in DRAWN:
        return path.name
    known = {".nc": "sweep.nc"}
    if path.suffix == ".csv" and read_bytes(path).startswith(b"frequency_Hz"):
        known[".csv"] = "dos.csv"  # other tables are for spreadsheets
    if path.suffix == ".yaml":
        raw = read_bytes(path)
        known |= (
            {".yaml": "fit.yaml"} if b"class: WidthFit" in raw else {".yaml": "band.yaml"} if b"\nphonon:" in raw else {}
        )
    if path.suffix not in known:
        mend = "Give the folder of a run or of a fit, or sweep.nc, fit.yaml, band.yaml or dos.csv of one"
        raise InputError(message(f"{path} is no folder, and no file of results that is drawn", mend=mend))
    return known[path.suffix]


def read_fit(path: Path) -> WidthFit:
    """Read the fit of a fit.yaml."""
    from granphon.fits.fit import WidthFit

    return WidthFit.from_dict(read_yaml(path))


def _find_balls_per_side(sources: Sequence[str | os.PathLike[str]]) -> int | None:
    """Return the number of balls on a side of the hexagonal frame that the scenes of runs tell; None if it is not one."""
    from granphon.scene.scene import Scene

    found = set[Any]()
    for source in map(Path, sources):
        place = (source if source.is_dir() else source.parent) / _SCENE
        if place.is_file():
            found.add(Scene.from_yaml(place).load.balls_per_side)
    found.discard(None)
    return int(found.pop()) if len(found) == 1 else None
