"""Carrying a scene out: everything is computed first, then written into one folder.

=====================  =====================================================================================
file                   holds
=====================  =====================================================================================
scene.yaml             the scene with every default written out, in SI
summary.yaml           the numbers, under the names of the library's attributes, with units, versions, warnings
band.yaml              bands, phonopy's format with eigenvectors
phonopy_params.yaml    force constants, for the phonopy command
dos.csv                density of states
bands.png              bands, with the density of states beside them; dos.png if that alone was asked for
=====================  =====================================================================================
"""

from __future__ import annotations

import os
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

from granphon.errors import InputError, message
from granphon.files import check_free, dump_yaml, staging, versions
from granphon.medium import ContactState
from granphon.observables import (
    Moduli,
    SoundVelocities,
    Validity,
    contact_lattice,
    moduli,
    sound_velocities,
    validity,
)
from granphon.progress import Progress, silent
from granphon.scene import Scene

if TYPE_CHECKING:
    from granphon.phonons import Bands, DensityOfStates, Phonons

__all__ = ["RESULT_FILES", "RunResult", "expected_files", "redraw", "run"]

SCHEMA = 1
#: every file that a run may write
RESULT_FILES = ("scene.yaml", "summary.yaml", "band.yaml", "phonopy_params.yaml", "dos.csv", "bands.png", "dos.png")
_UNITS = {
    "force": "N", "pressure": "N/m", "overlap": "m", "normal_stiffness": "N/m", "shear_stiffness": "N/m", "mass": "kg",
    "mindlin_ratio": "1", "relative_overlap": "1", "effective_density": "kg/m^3", "longitudinal": "m/s",
    "transverse": "m/s", "direction": "1", "bulk": "Pa", "shear": "Pa", "tensor": "Pa", "top_frequency": "Hz",
}  # fmt: skip


@dataclass(frozen=True)
class RunResult:
    """What a scene gave. What it did not ask for is None.

    ``files`` are the paths written, ``folder`` where they are.
    """

    folder: Path
    state: ContactState
    validity: Validity
    velocities: SoundVelocities | None
    moduli: Moduli | None
    bands: Bands | None
    dos: DensityOfStates | None
    files: tuple[Path, ...]

    @property
    def warnings(self) -> tuple[str, ...]:
        """One sentence for each condition of validity that fails."""
        return self.validity.warnings

    def summary(self) -> dict[str, Any]:
        """The numbers as plain data, under the names of the library's attributes."""
        state, packing = self.state, self.state.packing
        out: dict[str, Any] = {"medium": state.medium}
        for name in ("force", "pressure", "overlap", "relative_overlap", "normal_stiffness", "shear_stiffness"):
            out[name] = getattr(state, name)
        out |= {"effective_density": state.effective_density, "mindlin_ratio": packing.mindlin_ratio, "mass": packing.mass}
        if self.velocities is not None and self.moduli is not None:
            out |= {"longitudinal": self.velocities.longitudinal, "transverse": self.velocities.transverse}
            if self.moduli.isotropic:
                out |= {"bulk": self.moduli.bulk, "shear": self.moduli.shear}
            else:
                out["direction"] = self.velocities.direction
            out["tensor"] = self.moduli.tensor
        if self.bands is not None:
            out["top_frequency"] = float(self.bands.frequencies.max())
        return out


def expected_files(scene: Scene, figures: bool = True) -> tuple[str, ...]:
    """Names of the files that a run of ``scene`` writes."""
    names = ["scene.yaml", "summary.yaml"]
    if "bands" in scene.observe:
        names += ["band.yaml", "phonopy_params.yaml"]
    if "dos" in scene.observe:
        names.append("dos.csv")
    if figures and names[2:]:
        names.append(_figure_name("bands" in scene.observe))
    return tuple(names)


def _figure_name(bands: bool) -> str:
    return "bands.png" if bands else "dos.png"


def run(
    scene: Scene,
    folder: str | os.PathLike[str],
    *,
    force: bool = False,
    progress: Progress = silent,
    figures: bool = True,
) -> RunResult:
    """Compute what ``scene`` observes, and nothing else, and write it into ``folder``.

    Parameters
    ----------
    scene : what to compute.
    folder : made if it is not there; on any failure it is left as it was found.
    force : replace an earlier result, its files that this scene does not write included.
    progress : told how far the work has come.
    figures : draw bands.png (dos.png) too.

    Raises
    ------
    FileExistsInRunError : a file would be overwritten and ``force`` is off; found out before anything is computed.
    OutputError : the folder cannot be written.
    GranphonError : the computation fails; nothing has been written then.
    """
    names, target = expected_files(scene, figures), Path(folder)
    check_free(target, names, force)
    state, finite = scene.state(), scene.finite_overlap
    velocities, constants = None, None
    if "velocities" in scene.observe:
        constants = moduli(state, finite_overlap=finite)
        direction = None if constants.isotropic else (1.0, 0.0)
        velocities = sound_velocities(state, direction, finite_overlap=finite)
    phonons, bands, dos = _spectra(scene, state, progress)
    result = RunResult(
        target, state, validity(state, finite_overlap=finite), velocities, constants, bands, dos,
        tuple(target / name for name in names),
    )  # fmt: skip
    stale = [name for name in RESULT_FILES if name not in names] if os.path.lexists(target / "summary.yaml") else []
    used = versions("numpy", "scipy", *(("ase", "phonopy", "spglib") if phonons is not None else ()))
    with staging(target, names, force, stale) as place:
        head = "".join(f"# {package} {number}\n" for package, number in used.items())
        _write(place / "scene.yaml", f"# The scene as it was run, in SI units.\n{head}{scene.to_yaml()}")
        _write(place / "summary.yaml", _summary(result, scene, used))
        with progress.step("writing", len(names)) as step:
            if bands is not None and phonons is not None:
                bands.write(place / "band.yaml")
                phonons.save(place / "phonopy_params.yaml")
                step.advance(2)
            if dos is not None:
                dos.write_csv(place / "dos.csv")
                step.advance()
            if figures and phonons is not None:
                from granphon.plot import bands_figure

                bands_figure(bands=bands, dos=dos).savefig(place / _figure_name(bands is not None))
                step.advance()
    return result


def _spectra(
    scene: Scene, state: ContactState, progress: Progress
) -> tuple[Phonons | None, Bands | None, DensityOfStates | None]:
    if not {"bands", "dos"} & set(scene.observe):
        return None, None, None
    from granphon.phonons import Phonons

    bands = dos = None
    with progress.step("force constants"):
        phonons = Phonons(state, finite_overlap=scene.finite_overlap, dim=scene.dim)
        _ = phonons.phonopy
    if "bands" in scene.observe:
        with progress.step("bands"):
            bands = phonons.bands(scene.path.arrays, npoints=scene.band_points, labels=scene.path.labels)
    if "dos" in scene.observe:
        with progress.step("density of states"):
            dos = phonons.dos(mesh=scene.mesh)
    return phonons, bands, dos


def _summary(result: RunResult, scene: Scene, used: Mapping[str, str]) -> str:
    numbers = result.summary()
    checks = [
        {"name": c.name, "meaning": c.meaning, "value": c.value, "limit": c.limit, "ok": bool(c.ok)}
        for c in result.validity.checks
    ]
    return dump_yaml(
        {
            "schema": SCHEMA,
            "versions": used,
            "source": None if scene.source is None else scene.source.name,
            "observe": scene.observe,
            "finite_overlap": scene.finite_overlap,
            **numbers,
            "valid": bool(result.validity.ok),
            "validity": checks,
            "warnings": result.warnings,
            "files": [path.name for path in result.files],
            "units": {name: unit for name, unit in _UNITS.items() if name in numbers},
        }
    )


def _write(path: Path, text: str) -> None:
    path.write_text(text, encoding="utf-8")


def redraw(
    folder: str | os.PathLike[str],
    out: str | os.PathLike[str] | None = None,
    force: bool = False,
    asymptotes: bool = False,
) -> Path:
    """Draw the results in a run's folder again, in one figure.

    Parameters
    ----------
    folder : where band.yaml, dos.csv or both are.
    out : where to, in the format of its ending; by default bands.png (dos.png without bands) in the folder.
    force : overwrite.
    asymptotes : add the long waves (equations 13-15) of the scene that the folder holds.

    Returns
    -------
    The path written.

    Raises
    ------
    InputError : the folder holds nothing to draw, its files are damaged, or the format is unknown.
    FileExistsInRunError, OutputError : the figure cannot be written.
    """
    source = Path(folder)
    have = {name: source / file for name, file in (("bands", "band.yaml"), ("dos", "dos.csv")) if (source / file).is_file()}
    if not have:
        raise InputError(
            message(f"{source} holds neither band.yaml nor dos.csv", mend="Give a folder that 'granphon run' wrote")
        )
    target = source if out is None else Path(out).parent
    names = [_figure_name("bands" in have) if out is None else Path(out).name]
    check_free(target, names, force)
    from granphon.phonons import Bands, DensityOfStates
    from granphon.plot import bands_figure

    try:
        bands = Bands.read(have["bands"]) if "bands" in have else None
        dos = DensityOfStates.read_csv(have["dos"]) if "dos" in have else None
    except OSError as error:
        raise InputError(message(f"{error.filename} cannot be read: {error.strerror}")) from None
    lattice = None
    if asymptotes and bands is not None:
        scene = Scene.from_yaml(source / "scene.yaml")
        lattice = contact_lattice(scene.state(), scene.finite_overlap)
    figure = bands_figure(bands=bands, dos=dos, asymptotes=lattice)
    known, ending = ("pdf", "png", "svg"), Path(names[0]).suffix
    if ending.removeprefix(".") not in known:
        raise InputError(message(f"{names[0]} has an ending that names no figure format", mend="Use ." + ", .".join(known)))
    with staging(target, names, force) as place:
        figure.savefig(place / names[0])
    return target / names[0]
