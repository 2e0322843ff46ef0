"""Drawing the results of runs again from the files in their folders, without computing them."""

from __future__ import annotations

import os
from collections.abc import Callable, Collection, Sequence
from contextlib import suppress
from pathlib import Path
from typing import TYPE_CHECKING, Any

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
#: the names of files that mean one figure of waves in the arrays of a sweep, or in the networks of
#: states
_OF_SWEEPS = {*(Path(name).stem for name in SWEEP_FIGURES), *NETWORK_BLOCKS}


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
    folder : folder of the run; it holds sweep.nc, or fit.yaml, or band.yaml, dos.csv, or both.
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
        is unknown, or what is asked for belongs to another kind of result.
    FigureError : matplotlib cannot draw it.
    FileExistsInRunError, OutputError : the figure cannot be written.
    """
    source = Path(folder)
    have = _find_results(source)
    kept_in = {stem: source / f"{stem}.json" for stem in KEPT} | {
        "motion": source / MOTION_FILES[0]
    }
    waves = [stem for stem, path in kept_in.items() if path.exists()]
    stem = None if out is None else Path(out).stem
    there = {*waves, *(one for one in _OF_SWEEPS if (source / f"{one}.csv").exists())}
    if stem in {*kept_in, *_OF_SWEEPS} - there:
        raise InputError(f"{source} holds no {stem} to draw", mend="Give the figure another name")
    # the one that the file's name says; without bands and the like, the first
    alone = (
        waves in (["surface"], ["motion"])
        and set(have) == {"sweep.nc"}
        and stem != "sweep"
        and variable is None
    )
    wave = next(
        (name for name in waves if name == stem),
        next(iter(waves), None) if alone or not have else None,
    )
    if not (have or waves):
        what = f"{source} holds no result that can be drawn"
        why = (
            "forces.png is drawn by 'granphon run' alone"
            if (source / "forces.png").is_file()
            else ""
        )
        raise InputError(
            what, why, "Give a folder of 'granphon run' with bands, a density of states or a sweep"
        )
    if wave is not None:
        have = {}
    elif (
        variable is None
        and stem not in _OF_SWEEPS
        and (spectra := {"band.yaml", "dos.csv"} & set(have))
    ):
        # of a single state they are the figure
        have = {name: path for name, path in have.items() if name in spectra}
    swept = "sweep.nc" in have
    fitted = "fit.yaml" in have
    kept = "sweep"
    if (swept or fitted) and asymptotes:
        what = f"{source} holds a {'sweep' if swept else 'fit'}"
        raise InputError(what, "Long waves are drawn beside bands only", "Leave asymptotes out")
    if variable is not None and not swept:
        raise InputError(
            f"{source} holds no sweep", "Only a sweep has variables to draw", "Leave variable out"
        )
    block = next((name for name in NETWORK_BLOCKS if name in there), None)
    if (
        block
        and swept
        and stem not in ("sweep", *_OF_SWEEPS)
        and variable is None
        and "states" not in read_summary(source)
    ):
        kept = block  # a sweep of one state has no line
    kind = wave or (
        kept if swept else "fit" if fitted else "bands" if "band.yaml" in have else "dos"
    )
    target = source / f"{kind}.png" if out is None else Path(out)

    def draw() -> Any:
        if wave is not None:
            from granphon.figures.plot import plot
            from granphon.runs.wave_records import read_waves

            return plot(read_waves(kept_in[wave]))
        if fitted and not swept:
            from granphon.figures.plot import plot
            from granphon.fits.transfer import read_fit

            return plot(read_fit(read_yaml(have["fit.yaml"])))
        from granphon.figures.bands import bands_figure

        found = _read_files(str(source), have)
        if found.dataset is not None:
            return draw_sweep(found.dataset, target.name if kept == "sweep" else kept, variable)
        lattice = _find_lattice(source) if asymptotes and found.bands is not None else None
        gaps = read_summary(source).get("gaps") if (source / "summary.yaml").is_file() else None
        return bands_figure(found.bands, found.dos, asymptotes=lattice, gaps=gaps or None)

    return _draw(target, force, draw, [source], backend)


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
    if (double := next((name for name in names if names.count(name) > 1), None)) is not None:
        raise InputError(f"{double} is given twice", mend="Give each run once")

    def draw() -> Any:
        from granphon.figures.curves import comparison_figure

        runs, balls = [read_run(name) for name in names], set[Any]()
        if data:
            # their loads may be side forces on the hexagonal frame that the scenes of the runs tell
            from granphon.scene.scene import Scene

            scenes = [
                (path if path.is_dir() else path.parent) / "scene.yaml" for path in map(Path, names)
            ]
            balls = {
                Scene.from_yaml(scene).load.balls_per_side for scene in scenes if scene.is_file()
            } - {None}
        return comparison_figure(
            runs, x=x, y=y, data=data, balls_per_side=balls.pop() if len(balls) == 1 else None
        )

    given = [Path(name) for name in (*names, *map(str, data))]
    folders = [path for path in map(Path, names) if path.is_dir()]
    files = [one for one in given if one.is_file()]
    return _draw(
        Path("comparison.png" if out is None else out), force, draw, folders, backend, files
    )


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
        what = f"{target.name} has an ending that names no figure format"
        raise InputError(what, mend="Use " + ", ".join(_FORMATS))
    # lock before anything is read, so that no run can replace the results while the figure of them
    # is drawn
    with ResultFiles(target.parent, [target.name], force, inputs=inputs).open() as locked:
        before = [read_written_files(folder) for folder in folders]
        figure = draw()
        for folder, written in zip(folders, before, strict=True):
            if read_written_files(folder) != written:
                what = f"{folder} was written into while it was read"
                raise InputError(what, "The figure would mix two results", "Draw it again")
        from granphon.figures.style import save_figure

        with locked.staging() as place:
            save_figure(figure, place / target.name, backend=backend)
    return target


def read_run(source: str | os.PathLike[str]) -> Run:
    """Read the results in the folder of a run, or in one of its files.

    Raises :class:`~granphon.base.errors.MissingFileError` if there is nothing of that name, and
    :class:`~granphon.base.errors.InputError` if it holds no results, or damaged ones.
    """
    path, name = Path(source), str(source)
    if path.name == "summary.yaml" and path.is_file():
        read_summary(path.parent)
        path = path.with_name("sweep.nc")  # whose numbers it tells
    have = {_name_kind(path): path} if path.is_file() else _find_results(path)
    if not have:
        what = f"{name} holds no results to draw with others"
        raise InputError(
            what, mend="Give the folder of a run or of a fit, or one of its files, such as sweep.nc"
        )
    return _read_files(name, have)


def _read_files(name: str, have: dict[str, Path]) -> Run:
    """Read the files of a run or of a fit; beside a fit nothing else is read."""
    from granphon.figures.curves import Run

    if "fit.yaml" in have and "sweep.nc" not in have:
        from granphon.fits.transfer import read_fit

        return Run.of(name, read_fit(read_yaml(have["fit.yaml"])))
    dataset = bands = dos = None
    if "sweep.nc" in have:
        from granphon.runs.dataset import load_sweep

        dataset = load_sweep(have["sweep.nc"])
    if "band.yaml" in have:
        from granphon.phonons.bands import Bands

        bands = Bands.read(have["band.yaml"])
    if "dos.csv" in have:
        from granphon.phonons.dos import DensityOfStates

        dos = DensityOfStates.read_csv(have["dos.csv"])
    return Run(name, dataset=dataset, bands=bands, dos=dos)


def _find_results(source: Path) -> dict[str, Path]:
    """Return the files of the run in a folder that are drawn, by name.

    Raises :class:`~granphon.base.errors.MissingFileError` if there is no such folder, or a file is
    missing that a run wrote.
    """
    if not source.is_dir():
        what = (
            f"{source} is no folder" if os.path.lexists(source) else f"there is no folder {source}"
        )
        raise MissingFileError(what, mend="Give the folder of a run")
    # whatever has the name is read, and a folder or a link to nothing is then an error
    have = {name: source / name for name in DRAWN if os.path.lexists(source / name)}
    written = set(read_written_files(source))
    with suppress(InputError, AttributeError, TypeError):
        # without a summary that can be read, the hidden list alone counts
        written |= set(read_yaml(source / "summary.yaml").get("files", ()))
    if lost := [name for name in DRAWN if name not in have and name in written]:
        what = f"{source} holds no {' and no '.join(lost)}, though a run wrote it there"
        mend = "Run the scene again, or copy what is to be drawn into a folder of its own"
        raise MissingFileError(what, "The figure would leave it out", mend)
    return have


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
    found = read_summary(source)
    numbers = {name: found[name] for name in ("force", "overlap", "normal_stiffness")}
    medium = scene.media[0].name
    law = packing.law
    return ContactState(packing, medium, law, **numbers, finite_overlap=True).contact_lattice()
