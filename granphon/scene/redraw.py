"""Drawing the results of runs again from the files in their folders, without computing them."""

from __future__ import annotations

import os
from collections.abc import Callable, Collection, Sequence
from contextlib import suppress
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

from granphon.base.errors import InputError, MissingFileError
from granphon.base.staging import ResultFiles, read_written_files
from granphon.base.text import read_bytes, read_yaml
from granphon.scene.scene import KEPT, MOTION_FILES, SWEEP_FIGURES, draw_sweep, read_summary
from granphon.waves.settings import NETWORK_BLOCKS

if TYPE_CHECKING:
    from granphon.dynamics.contact_lattice import ContactLattice
    from granphon.figures.curves import Run


_FORMATS = (".pdf", ".png", ".svg")
#: the files of results that are drawn over the load, as bands, and as densities of states
DRAWN = ("sweep.nc", "fit.yaml", "band.yaml", "dos.csv")
#: stems of the files, each of one figure, of waves in the arrays of a sweep or in the networks of
#: states
_SWEEP_STEMS = {*(Path(name).stem for name in SWEEP_FIGURES), *NETWORK_BLOCKS}


def redraw(
    folder: str | os.PathLike[str],
    out: str | os.PathLike[str] | None = None,
    force: bool = False,
    asymptotes: bool = False,
    variable: str | None = None,
    backend: str | None = None,
) -> Path:
    """Draw the results in a run's folder again, in one figure, and return the path of its file.

    Parameters
    ----------
    folder : folder of the run, with sweep.nc, or fit.yaml, or band.yaml, dos.csv, or both.
    out : file of the figure, whose ending .pdf, .png or .svg is the format. A name surface means
        the waves of an edge, spectrum, pulse or sample_dos that result of a simulation, sweep_dos
        or sweep_spectra that of a sweep of simulations. By default sweep.png, fit.png, bands.png
        (dos.png without bands, surface.png of these waves alone) in the folder.
    force : overwrite a file that granphon wrote and that was not changed since.
    asymptotes : add to the bands the long waves (equations 13-15) of the scene in the folder.
    variable : name of the one variable of a sweep to draw.
    backend : matplotlib backend that draws, such as "pgf"; by default the one that belongs to the
        ending of ``out``.

    Raises
    ------
    MissingFileError : there is no such folder, or a file of the run that is drawn is missing there.
    InputError : the folder holds nothing to draw, its files are damaged, the format or the variable
        is unknown, or an option belongs to another kind of result.
    FigureError : matplotlib cannot draw it.
    FileExistsInRunError, OutputError : the figure cannot be written.
    """
    source = Path(folder)
    choice = _choose_results(source, None if out is None else Path(out).stem, variable)
    is_fit = "fit.yaml" in choice.files
    is_sweep = "sweep.nc" in choice.files
    if (is_sweep or is_fit) and asymptotes:
        problem = f"{source} holds a {'sweep' if is_sweep else 'fit'}"
        raise InputError(problem, "Long waves are drawn beside bands only", "Leave asymptotes out")
    if variable is not None and not is_sweep:
        raise InputError(
            f"{source} holds no sweep", "Only a sweep has variables to draw", "Leave variable out"
        )
    target = source / f"{choice.name}.png" if out is None else Path(out)

    def draw() -> Any:
        if choice.wave_file is not None:
            from granphon.figures.plot import plot
            from granphon.runs.wave_records import read_waves

            return plot(read_waves(choice.wave_file))
        if is_fit and not is_sweep:
            from granphon.figures.plot import plot
            from granphon.fits.transfer import read_fit

            return plot(read_fit(read_yaml(choice.files["fit.yaml"])))
        from granphon.figures.bands import bands_figure

        run = _read_files(str(source), choice.files)
        if run.dataset is not None:
            name = target.name if choice.name == "sweep" else choice.name
            return draw_sweep(run.dataset, name, variable)
        lattice = _find_lattice(source) if asymptotes and run.bands is not None else None
        gaps = read_summary(source).get("gaps") if (source / "summary.yaml").is_file() else None
        return bands_figure(run.bands, run.dos, asymptotes=lattice, gaps=gaps or None)

    return _draw(target, force, draw, [source], backend)


class _Choice(NamedTuple):
    """The results of a folder that are drawn.

    Attributes
    ----------
    name : the stem of the figure's file by default.
    files : the files over the load, of bands and of densities of states, by name.
    wave_file : the file of the one result of waves that is drawn in place of these; None for none.
    """

    name: str
    files: dict[str, Path]
    wave_file: Path | None = None


def _choose_results(source: Path, stem: str | None, variable: str | None) -> _Choice:
    """Choose the results in a folder that are drawn, by the ``stem`` of the figure's file, None if
    the user names no file, and the ``variable`` of a sweep.
    """
    files = _find_results(source)
    wave_files = {name: source / f"{name}.json" for name in KEPT}
    wave_files["motion"] = source / MOTION_FILES[0]
    waves = [name for name, path in wave_files.items() if path.exists()]
    tables = [name for name in _SWEEP_STEMS if (source / f"{name}.csv").exists()]
    if stem in {*wave_files, *_SWEEP_STEMS} - {*waves, *tables}:
        raise InputError(f"{source} holds no {stem} to draw", mend="Give the figure another name")
    if not (files or waves):
        why = ""
        if (source / "forces.png").is_file():
            why = "forces.png is drawn by 'granphon run' alone"
        raise InputError(
            f"{source} holds no result that can be drawn",
            why,
            "Give a folder of 'granphon run' with bands, a density of states or a sweep",
        )
    if stem in waves:
        return _Choice(stem, {}, wave_files[stem])
    # the waves of an edge or a motion of one state are the figure of their run
    is_wave_run = waves in (["surface"], ["motion"]) and set(files) == {"sweep.nc"}
    if not files or (is_wave_run and stem != "sweep" and variable is None):
        return _Choice(waves[0], {}, wave_files[waves[0]])
    spectra = {name: path for name, path in files.items() if name in ("band.yaml", "dos.csv")}
    if spectra and variable is None and stem not in _SWEEP_STEMS:
        # of a single state bands and density of states are the figure
        return _Choice("bands" if "band.yaml" in spectra else "dos", spectra)
    if "sweep.nc" not in files:
        names = {"fit.yaml": "fit", "band.yaml": "bands", "dos.csv": "dos"}
        return _Choice(next(name for file, name in names.items() if file in files), files)
    blocks = [name for name in NETWORK_BLOCKS if name in {*waves, *tables}]
    if not blocks or variable is not None or stem in ("sweep", *_SWEEP_STEMS):
        return _Choice("sweep", files)
    # a sweep of one state has no line over the load
    return _Choice("sweep" if "states" in read_summary(source) else blocks[0], files)


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
    out : file of the figure, whose ending .pdf, .png or .svg is the format; by default
        comparison.png in the working folder.
    force : overwrite a file that granphon wrote and that was not changed since.
    x, y, data : as in :func:`granphon.figures.curves.plot_together`.
    backend : matplotlib backend that draws.

    Raises
    ------
    MissingFileError : there is no such folder or file, or a file of a run is missing.
    InputError : the runs cannot share an axis, a file is damaged, or the format is unknown; nothing
        is written then.
    FigureError : matplotlib cannot draw it.
    FileExistsInRunError, OutputError : the figure cannot be written.
    """
    names = [str(source) for source in sources]
    for name in names:
        if names.count(name) > 1:
            raise InputError(f"{name} is given twice", mend="Give each run once")

    def draw() -> Any:
        from granphon.figures.curves import comparison_figure

        runs = [read_run(name) for name in names]
        balls = set[Any]()
        if data:
            # measured loads may be side forces on a hexagonal frame, whose size the scenes tell
            from granphon.scene.scene import Scene

            scenes = [
                (path if path.is_dir() else path.parent) / "scene.yaml" for path in map(Path, names)
            ]
            balls = {
                Scene.from_yaml(scene).load.balls_per_side for scene in scenes if scene.is_file()
            } - {None}
        balls_per_side = balls.pop() if len(balls) == 1 else None
        return comparison_figure(runs, x=x, y=y, data=data, balls_per_side=balls_per_side)

    paths = [Path(name) for name in (*names, *map(str, data))]
    folders = [path for path in map(Path, names) if path.is_dir()]
    files = [path for path in paths if path.is_file()]
    target = Path("comparison.png" if out is None else out)
    return _draw(target, force, draw, folders, backend, files)


def _draw(
    target: Path,
    force: bool,
    draw: Callable[[], Any],
    folders: Sequence[Path],
    backend: str | None,
    inputs: Collection[Path] = (),
) -> Path:
    """Write the figure that ``draw`` draws of the results in ``folders`` into the file ``target``,
    and return its path.
    """
    if target.suffix not in _FORMATS:
        problem = f"{target.name} has an ending that names no figure format"
        raise InputError(problem, mend="Use " + ", ".join(_FORMATS))
    # lock before anything is read, so that no run can replace the results while they are drawn
    with ResultFiles(target.parent, [target.name], force, inputs=inputs).open() as locked:
        records = [read_written_files(folder) for folder in folders]
        figure = draw()
        for folder, record in zip(folders, records, strict=True):
            if read_written_files(folder) != record:
                problem = f"{folder} was written into while it was read"
                raise InputError(problem, "The figure would mix two results", "Draw it again")
        from granphon.figures.style import save_figure

        with locked.staging() as stage:
            save_figure(figure, stage / target.name, backend=backend)
    return target


def read_run(source: str | os.PathLike[str]) -> Run:
    """Read the results in the folder of a run, or in one of its files.

    Raises :class:`~granphon.base.errors.MissingFileError` if no folder or file has the name, and
    :class:`~granphon.base.errors.InputError` if ``source`` holds no results, or damaged ones.
    """
    path = Path(source)
    name = str(source)
    if path.name == "summary.yaml" and path.is_file():
        read_summary(path.parent)
        path = path.with_name("sweep.nc")  # the summary tells numbers of this file
    files = {_name_kind(path): path} if path.is_file() else _find_results(path)
    if not files:
        raise InputError(
            f"{name} holds no results to draw with others",
            mend="Give the folder of a run or of a fit, or one of its files, such as sweep.nc",
        )
    return _read_files(name, files)


def _read_files(name: str, files: dict[str, Path]) -> Run:
    """Read the files of a run or of a fit; beside a fit nothing else is read."""
    from granphon.figures.curves import Run

    if "fit.yaml" in files and "sweep.nc" not in files:
        from granphon.fits.transfer import read_fit

        return Run.of(name, read_fit(read_yaml(files["fit.yaml"])))
    dataset = bands = dos = None
    if "sweep.nc" in files:
        from granphon.runs.dataset import load_sweep

        dataset = load_sweep(files["sweep.nc"])
    if "band.yaml" in files:
        from granphon.phonons.bands import Bands

        bands = Bands.read(files["band.yaml"])
    if "dos.csv" in files:
        from granphon.phonons.dos import DensityOfStates

        dos = DensityOfStates.read_csv(files["dos.csv"])
    return Run(name, dataset=dataset, bands=bands, dos=dos)


def _find_results(source: Path) -> dict[str, Path]:
    """Return the files of the run in a folder that are drawn, by name.

    Raises :class:`~granphon.base.errors.MissingFileError` if there is no such folder, or a file is
    missing that a run wrote.
    """
    if not source.is_dir():
        is_file = os.path.lexists(source)
        problem_of_folder = f"{source} is no folder" if is_file else f"there is no folder {source}"
        raise MissingFileError(problem_of_folder, mend="Give the folder of a run")
    # whatever has the name is read, and a folder or a link to nothing is then an error
    files = {name: source / name for name in DRAWN if os.path.lexists(source / name)}
    written = set(read_written_files(source))
    with suppress(InputError, AttributeError, TypeError):
        # without a summary that can be read, the hidden list alone counts
        written |= set(read_yaml(source / "summary.yaml").get("files", ()))
    missing = [name for name in DRAWN if name not in files and name in written]
    if missing:
        problem = f"{source} holds no {' and no '.join(missing)}, though a run wrote it there"
        mend = "Run the scene again, or copy what is to be drawn into a folder of its own"
        raise MissingFileError(problem, "The figure would leave it out", mend)
    return files


def _name_kind(path: Path) -> str:
    """Return the name under which a file of results is known, by its ending where it was
    renamed.
    """
    if path.name in DRAWN:
        return path.name
    head = read_bytes(path) if path.suffix in (".csv", ".yaml") else b""
    if path.suffix == ".nc":
        return "sweep.nc"
    if path.suffix == ".csv" and head.startswith(b"frequency_Hz"):
        # other tables are for spreadsheets
        return "dos.csv"
    if path.suffix == ".yaml" and (b"class: WidthFit" in head or b"class: DampingFit" in head):
        return "fit.yaml"
    if path.suffix == ".yaml" and b"\nphonon:" in head:
        return "band.yaml"
    mend = (
        "Give the folder of a run or of a fit, or sweep.nc, fit.yaml, band.yaml or dos.csv of one"
    )
    raise InputError(f"{path} is no folder, and no file of results that is drawn", mend=mend)


def _find_lattice(source: Path) -> ContactLattice:
    """Return the lattice of contacts of the one state of a run; no array is simulated again."""
    # imported here, as a figure without asymptotes does not need the media
    from granphon.media.state import ContactState, ideal_lattice
    from granphon.scene.scene import Scene

    scene = Scene.from_yaml(source / "scene.yaml")
    packing: Any = scene.packing
    if not scene.serving.arrays:
        return scene.state().contact_lattice()
    if not scene.finite_overlap:
        # in the paper's limit the lattice in reduced units is the same under every load
        return ideal_lattice(packing)
    summary = read_summary(source)
    numbers = {name: summary[name] for name in ("force", "overlap", "normal_stiffness")}
    medium = scene.media[0].name
    law = packing.law
    return ContactState(packing, medium, law, **numbers, finite_overlap=True).contact_lattice()
