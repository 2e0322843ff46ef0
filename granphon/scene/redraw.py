"""Drawing the results of a run again from the files in its folder, without computing them."""

from __future__ import annotations

import os
from pathlib import Path
from typing import TYPE_CHECKING, Any

from granphon.base.errors import InputError, message
from granphon.base.staging import ResultFiles
from granphon.scene.result_files import SWEEP_FIGURES, draw_sweep, figure_name, read_summary, wave_files
from granphon.scene.several import find_results, read_fit, read_unchanged, require_format

if TYPE_CHECKING:
    from granphon.dynamics.contact_lattice import ContactLattice


#: what of the waves in samples is drawn
_WAVES = ("spectrum", "pulse", "dos")
#: the names of files that mean one figure: of a sweep, and of what a run holds
_OF_SWEEPS = {Path(name).stem for name in SWEEP_FIGURES}
_NAMED = _OF_SWEEPS | {Path(name).stem for name in wave_files(_WAVES)}


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
    out : file of the figure, whose ending .pdf, .png or .svg is the format. A name spectrum, pulse or sample_dos means that
        result of a simulation, sweep_dos or sweep_spectra that of a sweep of simulations. By default sweep.png, fit.png,
        bands.png (dos.png without bands) in the folder.
    force : overwrite a file that granphon wrote and that was not changed since.
    asymptotes : add to the bands the long waves (equations 13-15) of the scene in the folder.
    variable : name of the one variable of a sweep to draw.
    backend : matplotlib backend that draws, such as "pgf"; by default the one that belongs to the ending of ``out``.

    Raises
    ------
    MissingFileError : there is no such folder, or a file of the run that is drawn is missing there.
    InputError : the folder holds nothing to draw, its files are damaged, the format or the variable is unknown, or what is
        asked for belongs to another kind of result.
    FigureError : matplotlib cannot draw it.
    FileExistsInRunError, OutputError : the figure cannot be written.
    """
    source = Path(folder)
    have = find_results(source)
    waves = {name: source / name for name in wave_files(_WAVES) if name.endswith(".json") and (source / name).exists()}
    stem = None if out is None else Path(out).stem
    there = {Path(name).stem for name in waves} | {one for one in _OF_SWEEPS if (source / f"{one}.csv").exists()}
    if stem in _NAMED - there:
        raise InputError(message(f"{source} holds no {stem} to draw", mend="Give the figure another name"))
    # the one that the file's name says; without bands and the like, the first
    wave = next((name for name in waves if Path(name).stem == stem), None if have else next(iter(waves), None))
    if wave is not None:
        have = {wave: waves[wave]}
    if not have:
        what = f"{source} holds neither sweep.nc nor band.yaml nor dos.csv nor fit.yaml, and no waves of a simulation"
        why = "forces.png is drawn by 'granphon run' alone" if (source / "forces.png").is_file() else ""
        raise InputError(
            message(what, why, "Give a folder with bands, a density of states or a sweep that 'granphon run' wrote")
        )
    if wave is None and variable is None and not _OF_SWEEPS & {stem} and (spectra := {"band.yaml", "dos.csv"} & set(have)):
        have = {name: path for name, path in have.items() if name in spectra}  # of a single state they are the figure
    swept, fitted = "sweep.nc" in have, "fit.yaml" in have
    if (swept or fitted) and asymptotes:
        what = f"{source} holds a {'sweep' if swept else 'fit'}"
        raise InputError(message(what, "Long waves are drawn beside bands only", "Leave asymptotes out"))
    if variable is not None and not swept:
        raise InputError(message(f"{source} holds no sweep", "Only a sweep has variables to draw", "Leave variable out"))
    target = source if out is None else Path(out).parent
    name = "sweep.png" if swept else "fit.png" if fitted else figure_name("band.yaml" in have)
    name = name if wave is None else wave.replace(".json", ".png")
    name = name if out is None else Path(out).name
    require_format(name)
    # lock before anything is read, so that no run can replace the results while the figure of them is drawn
    with ResultFiles(target, [name], force).open() as locked:

        def draw() -> Any:
            if wave is not None:
                return _draw_waves(wave, have[wave])
            if swept:
                return _read_sweep(have["sweep.nc"], name, variable)
            return _draw_fit(have["fit.yaml"]) if fitted else _draw_spectra(source, have, asymptotes)

        figure = read_unchanged([source], draw)
        from granphon.figures.style import save_figure

        with locked.staging() as place:
            save_figure(figure, place / name, backend=backend)
    return target / name


def _read_sweep(path: Path, name: str, variable: str | None) -> Any:
    from granphon.sweeps.archive import load_sweep

    return draw_sweep(load_sweep(path), name, variable)


def _draw_fit(path: Path) -> Any:
    from granphon.figures.fits import fit_figure

    return fit_figure(read_fit(path))


def _draw_waves(name: str, path: Path) -> Any:
    from granphon.scene.sample_waves import draw_waves, read_waves

    return draw_waves(name.replace(".json", ".png"), read_waves(path))


def _draw_spectra(source: Path, have: dict[str, Path], asymptotes: bool) -> Any:
    from granphon.figures.bands import bands_figure
    from granphon.phonons.bands import Bands  # this module does not load phonopy
    from granphon.phonons.dos import DensityOfStates

    bands = Bands.read(have["band.yaml"]) if "band.yaml" in have else None
    dos = DensityOfStates.read_csv(have["dos.csv"]) if "dos.csv" in have else None
    lattice = None
    if asymptotes and bands is not None:
        lattice = _find_lattice(source)
    return bands_figure(bands=bands, dos=dos, asymptotes=lattice)


def _find_lattice(source: Path) -> ContactLattice:
    """Return the lattice of contacts of the one state of a run; no array is simulated again."""
    # imported here, as a figure without asymptotes does not need the media
    from granphon.media.loaded_lattice import ideal_lattice
    from granphon.media.state import ContactState
    from granphon.scene.scene import Scene

    scene = Scene.from_yaml(source / "scene.yaml")
    if not scene.finite_overlap:  # in the paper's limit the lattice in reduced units is the same under every load
        return ideal_lattice(scene.packing)
    if not scene.media[0].is_exact:
        return scene.state().contact_lattice()
    found = read_summary(source)
    numbers = {name: found[name] for name in ("force", "overlap", "normal_stiffness")}
    medium, law = scene.media[0].name, scene.packing.law
    return ContactState(scene.packing, medium, law, **numbers, finite_overlap=True).contact_lattice()
