"""Drawing the results of runs again from the files in their folders, without computing them."""

from __future__ import annotations

import os
from collections.abc import Callable, Collection, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, field, replace
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


@dataclass(frozen=True)
class View:
    """What a figure shows of a sweep.

    Attributes
    ----------
    where : the states that are drawn: texts of values by the name of a parameter, of the load, or
        "medium", as :func:`granphon.figures.choices.choose_states` takes them; empty for all.
    rows, columns : the parameters, or "medium", whose values have rows and columns of panels.
    """

    where: Mapping[str, Sequence[str]] = field(default_factory=dict)
    rows: str | None = None
    columns: str | None = None


#: all states of a sweep, in the panels that granphon chooses
WHOLE = View()


def _tell_nobody(sentence: str) -> None:
    """Ignore a sentence."""


def redraw(
    folder: str | os.PathLike[str],
    out: str | os.PathLike[str] | None = None,
    force: bool = False,
    asymptotes: bool = False,
    variable: str | None = None,
    backend: str | None = None,
    view: View = WHOLE,
    tell: Callable[[str], object] = _tell_nobody,
) -> Path:
    """Draw the results in a run's folder again, in one figure, and return the path of its file.

    Parameters
    ----------
    folder : folder of the run, with sweep.nc, or fit.yaml, or band.yaml, dos.csv, or both, or the
        file of a result of waves.
    out : file of the figure, whose ending .pdf, .png or .svg is the format. A name surface means
        the waves of an edge, spectrum, pulse or sample_dos that result of a simulation, sweep_dos
        or sweep_spectra that of a sweep of simulations, response or motion that of the networks.
        By default, in the folder, bands.png (dos.png without bands), fit.png or sweep.png; of one
        state without bands the png of its surface, response or motion.
    force : overwrite a file that granphon wrote and that was not changed since.
    asymptotes : add to the bands the long waves (equations 13-15) of the scene in the folder.
    variable : name of the one variable of a sweep to draw.
    backend : matplotlib backend that draws, such as "pgf"; by default the one that belongs to the
        ending of ``out``.
    view : which states of a sweep are drawn, and in which panels.
    tell : called with a sentence, if the curves of a sweep are shared out among panels that the
        ``view`` does not name.

    Raises
    ------
    MissingFileError : there is no such folder, or a file of the run that is drawn is missing there.
    InputError : the folder holds nothing to draw, its files are damaged, the format or the variable
        is unknown, or an option belongs to another kind of result.
    FigureError : matplotlib cannot draw it.
    FileExistsInRunError, OutputError : the figure cannot be written.
    """
    source = Path(folder)
    asks_for_sweep = variable is not None or view != WHOLE
    choice = _choose_results(source, None if out is None else Path(out).stem, asks_for_sweep)
    is_fit = "fit.yaml" in choice.files
    is_sweep = "sweep.nc" in choice.files
    if (is_sweep or is_fit) and asymptotes:
        result = "sweep" if is_sweep else "fit"
        problem = f"{source} holds a {result}"
        raise InputError(problem, "Long waves are drawn beside bands only", "Leave asymptotes out")
    if variable is not None and not is_sweep:
        why = "Only a sweep has variables to draw"
        raise InputError(f"{source} holds no sweep", why, "Leave variable out")
    if view != WHOLE and not is_sweep:
        why = "Only the states of a sweep are chosen, or have rows and columns"
        raise InputError(f"{source} is drawn as no sweep", why, "Leave where, rows and columns out")
    target = source / f"{choice.name}.png" if out is None else Path(out)
    # a figure of the sweep is that which the name of its file says
    figure_name = target.name if choice.name == "sweep" else choice.name

    def draw() -> Any:
        if is_sweep:
            dataset = _choose_of_run(_read_files(str(source), choice.files), view).dataset
            return draw_sweep(dataset, figure_name, variable, view.rows, view.columns, tell)
        return _draw_results(source, choice, asymptotes)

    return _draw(target, force, draw, [source], backend)


def _choose_of_run(run: Run, view: View) -> Run:
    """Return a run with the states of its data set that a ``view`` chooses."""
    if run.dataset is None or not view.where:
        return run
    from granphon.figures.choices import choose_states

    return replace(run, dataset=choose_states(run.dataset, view.where, run.name))


def _draw_results(source: Path, choice: _Choice, asymptotes: bool) -> Any:
    """Return the figure of the results ``choice``, no sweep, in the folder ``source``; with
    ``asymptotes`` the long waves are drawn beside bands.
    """
    if choice.wave_file is not None:
        from granphon.figures.plot import plot
        from granphon.runs.wave_records import read_waves

        return plot(read_waves(choice.wave_file))
    if "fit.yaml" in choice.files and "sweep.nc" not in choice.files:
        from granphon.figures.plot import plot
        from granphon.fits.transfer import read_fit

        return plot(read_fit(read_yaml(choice.files["fit.yaml"])))
    from granphon.figures.bands import bands_figure

    run = _read_files(str(source), choice.files)
    lattice = None
    if asymptotes and run.bands is not None:
        lattice = _find_lattice(source)
    gaps = None
    if (source / "summary.yaml").is_file():
        gaps = read_summary(source).get("gaps") or None
    return bands_figure(run.bands, run.dos, asymptotes=lattice, gaps=gaps)


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


def _choose_results(source: Path, stem: str | None, wants_sweep: bool) -> _Choice:
    """Return the results in the folder ``source`` that are drawn, by the ``stem`` of the figure's
    file, None if the user names no file, and whether an option of sweeps is given; InputError if
    the folder has no result, or not that of the name.
    """
    files = _find_results(source)
    wave_files = {name: source / f"{name}.json" for name in KEPT}
    wave_files["motion"] = source / MOTION_FILES[0]
    waves = [name for name, path in wave_files.items() if path.exists()]
    tables = [name for name in _SWEEP_STEMS if (source / f"{name}.csv").exists()]
    missing_names = {*wave_files, *_SWEEP_STEMS} - {*waves, *tables}
    if stem in missing_names:
        raise InputError(f"{source} holds no {stem} to draw", mend="Give the figure another name")
    if not files and not waves:
        raise _explain_no_result(source)
    if stem in waves:
        return _Choice(stem, {}, wave_files[stem])
    # the waves of an edge or a motion of one state are the figure of their run
    is_wave_run = waves in (["surface"], ["motion"]) and set(files) == {"sweep.nc"}
    asks_for_sweep = stem == "sweep" or wants_sweep
    if not files or (is_wave_run and not asks_for_sweep):
        return _Choice(waves[0], {}, wave_files[waves[0]])
    spectra = {name: path for name, path in files.items() if name in ("band.yaml", "dos.csv")}
    if spectra and not wants_sweep and stem not in _SWEEP_STEMS:
        # of a single state bands and density of states are the figure
        return _Choice("bands" if "band.yaml" in spectra else "dos", spectra)
    if "sweep.nc" not in files:
        names = {"fit.yaml": "fit", "band.yaml": "bands", "dos.csv": "dos"}
        name = next(name for file, name in names.items() if file in files)
        return _Choice(name, files)
    blocks = [name for name in NETWORK_BLOCKS if name in {*waves, *tables}]
    if not blocks or asks_for_sweep or stem in _SWEEP_STEMS:
        return _Choice("sweep", files)
    # a sweep of one state has no line over the load
    has_several_states = "states" in read_summary(source)
    return _Choice("sweep" if has_several_states else blocks[0], files)


def _explain_no_result(source: Path) -> InputError:
    """Return the error of a folder without a result that can be drawn."""
    why = ""
    if (source / "forces.png").is_file():
        why = "forces.png is drawn by 'granphon run' alone"
    mend = "Give a folder of 'granphon run' with bands, a density of states or a sweep"
    return InputError(f"{source} holds no result that can be drawn", why, mend)


def draw_together(
    sources: Sequence[str | os.PathLike[str]],
    out: str | os.PathLike[str] | None = None,
    force: bool = False,
    *,
    x: str | None = None,
    y: str | None = None,
    data: Sequence[str | os.PathLike[str]] = (),
    distance: float | None = None,
    backend: str | None = None,
    view: View = WHOLE,
    tell: Callable[[str], object] = _tell_nobody,
) -> Path:
    """Draw the results of several runs in one figure, and return the path of its file.

    Parameters
    ----------
    sources : folders of runs and of fits, or files of results in them.
    out : file of the figure, whose ending .pdf, .png or .svg is the format; by default
        comparison.png in the working folder.
    force : overwrite a file that granphon wrote and that was not changed since.
    x, y, data, distance : as in :func:`granphon.figures.curves.plot_together`.
    backend : matplotlib backend that draws.
    view : which states of the runs are drawn; those that are swept over none of its names are drawn
        whole. Panels are those of a single sweep.
    tell : as in :func:`redraw`.

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

        runs = _choose_of_runs([read_run(name) for name in names], view)
        # measured loads may be side forces on a hexagonal frame
        balls_per_side = _find_balls_per_side(names) if data else None
        return comparison_figure(
            runs,
            x=x,
            y=y,
            data=data,
            balls_per_side=balls_per_side,
            distance=distance,
            rows=view.rows,
            columns=view.columns,
            tell=tell,
        )

    paths = [Path(name) for name in (*names, *map(str, data))]
    folders = [path for path in map(Path, names) if path.is_dir()]
    files = [path for path in paths if path.is_file()]
    target = Path("comparison.png" if out is None else out)
    return _draw(target, force, draw, folders, backend, files)


def _choose_of_runs(runs: Sequence[Run], view: View) -> list[Run]:
    """Return several runs with the states that a ``view`` chooses. A run that is swept over none of
    the names is whole, as a fit; InputError if that holds for all runs, or if a run is swept over
    some of the names only.
    """
    from granphon.figures.choices import find_dimension

    chosen = []
    for run in runs:
        is_swept = run.dataset is not None and any(
            find_dimension(run.dataset, name) is not None and run.dataset[name].size > 1
            for name in view.where
        )
        chosen.append(_choose_of_run(run, view) if is_swept or len(runs) == 1 else run)
    if view.where and all(run is earlier for run, earlier in zip(chosen, runs, strict=True)):
        names = ", ".join(view.where)
        raise InputError(f"none of the runs is swept over {names}", mend="Leave --where out")
    return chosen


def _find_balls_per_side(names: Sequence[str]) -> int | None:
    """Return the number of balls on a side of the hexagonal frame, in which the scenes of the runs
    ``names``, folders or files in them, agree; None for no such number, or several.
    """
    from granphon.scene.scene import Scene

    numbers = set[Any]()
    for path in map(Path, names):
        folder = path if path.is_dir() else path.parent
        scene_file = folder / "scene.yaml"
        if scene_file.is_file():
            numbers.add(Scene.from_yaml(scene_file).load.balls_per_side)
    numbers.discard(None)
    return numbers.pop() if len(numbers) == 1 else None


def _draw(
    target: Path,
    force: bool,
    draw: Callable[[], Any],
    folders: Sequence[Path],
    backend: str | None,
    inputs: Collection[Path] = (),
) -> Path:
    """Write the figure that ``draw`` returns of the results in ``folders`` and of the files
    ``inputs`` into the file ``target``, which ``force`` may overwrite, and return its path.

    InputError if the results change while they are drawn.
    """
    if target.suffix not in _FORMATS:
        problem = f"{target.name} has an ending that names no figure format"
        raise InputError(problem, mend="Use " + ", ".join(_FORMATS))
    # the folder is locked before anything is read, so that no run replaces the results meanwhile
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
    """Return the results in ``source``, the folder of a run or one of its files.

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
        mend = "Give the folder of a run or of a fit, or one of its files, such as sweep.nc"
        raise InputError(f"{name} holds no results to draw with others", mend=mend)
    return _read_files(name, files)


def _read_files(name: str, files: dict[str, Path]) -> Run:
    """Return the results in the ``files``, by their kind, of the run or fit ``name``; a fit is read
    alone, unless it stands beside a sweep.
    """
    from granphon.figures.curves import Run

    if "fit.yaml" in files and "sweep.nc" not in files:
        from granphon.fits.transfer import read_fit

        return Run.of(name, read_fit(read_yaml(files["fit.yaml"])))
    dataset = None
    bands = None
    dos = None
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
        problem = f"there is no folder {source}"
        if os.path.lexists(source):
            problem = f"{source} is no folder"
        raise MissingFileError(problem, mend="Give the folder of a run")
    # A folder, or a link to nothing, with the name of a result is an error when it is read.
    files = {name: source / name for name in DRAWN if os.path.lexists(source / name)}
    written_names = set(read_written_files(source))
    # without a summary that can be read, the hidden list of written files alone counts
    with suppress(InputError, AttributeError, TypeError):
        written_names |= set(read_yaml(source / "summary.yaml").get("files", ()))
    missing_names = [name for name in DRAWN if name not in files and name in written_names]
    if missing_names:
        names = " and no ".join(missing_names)
        problem = f"{source} holds no {names}, though a run wrote it there"
        mend = "Run the scene again, or copy what is to be drawn into a folder of its own"
        raise MissingFileError(problem, "The figure would leave it out", mend)
    return files


def _name_kind(path: Path) -> str:
    """Return the one of :data:`DRAWN` that says what a file of results holds: its own name, or, if
    it was renamed, by its ending and content. InputError for any other file.
    """
    if path.name in DRAWN:
        return path.name
    content = read_bytes(path) if path.suffix in (".csv", ".yaml") else b""
    if path.suffix == ".nc":
        return "sweep.nc"
    if path.suffix == ".csv" and content.startswith(b"frequency_Hz"):
        # other tables are for spreadsheets
        return "dos.csv"
    is_fit = b"class: WidthFit" in content or b"class: DampingFit" in content
    if path.suffix == ".yaml" and is_fit:
        return "fit.yaml"
    if path.suffix == ".yaml" and b"\nphonon:" in content:
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
    state = ContactState(packing, medium, packing.law, **numbers, finite_overlap=True)
    return state.contact_lattice()
