"""Results of a scene, of one state or of many: their numbers, warnings, files and figures."""

from __future__ import annotations

import json
from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING, Any, ClassVar

from granphon.array.atoms import write_extxyz
from granphon.array.pressed_sample import PressedSample
from granphon.base.errors import MechanismError
from granphon.base.progress import Step
from granphon.dynamics.local_field import LocalField
from granphon.media.choice import Rung
from granphon.media.state import ContactState
from granphon.observables.catalogue import CATALOGUE, Analysis, Observable, entry_of, find_all, warn_of_missing_error
from granphon.observables.validity import Validity
from granphon.observables.velocities import Moduli, SoundVelocities
from granphon.scene.notebook import Summarised
from granphon.scene.result_files import SAMPLE_TABLES, wave_figures
from granphon.sweeps.jobs import LATTICE_BANDS, describe_mechanism
from granphon.waves.settings import POLARISATIONS, WAVES

if TYPE_CHECKING:
    from granphon.phonons.phonons import Bands, DensityOfStates, Phonons
    from granphon.scene.sample_waves import SampleWaves
    from granphon.sweeps.dataset import Dataset

__all__ = ["RunResult", "SweepResult"]

#: variables of a sweep whose least and greatest values the summary lists
_EXTENTS = (
    "force", "overlap", "longitudinal", "transverse", "transverse_slow", "transverse_fast", "pulse_velocity",
    "time_of_flight", "coherent_fraction", *(f"ioffe_regel_{name}" for name in POLARISATIONS),
)  # fmt: skip


@dataclass(frozen=True)
class RunResult(Summarised):
    """Results of a scene of one state; those that the scene did not ask for are None.

    Attributes
    ----------
    folder, files : folder of the results, and the paths of the files written there.
    state : the state of the contacts.
    medium, load : label of the medium, and kind of the load: "force" (also for a side force), "pressure" or "overlap".
    validity : the conditions under which the model holds.
    velocities, moduli : sound velocities, m/s, and elastic constants, Pa.
    phonons : the source of ``bands`` and ``dos``.
    bands, dos : frequencies along the path, Hz, and their density of states, 1/Hz.
    local_field : local field of the effective medium; None in any other medium, and for equal balls.
    rung : the medium that an automatic medium has chosen, and its expected error; None if the scene names its medium.
    waves : what was asked for of the waves in the samples of a simulation; None if nothing was.
    failures : one sentence for each figure that could not be drawn, with the reason.
    """

    folder: Path
    state: ContactState
    medium: str
    load: str
    local_field: LocalField | None
    validity: Validity
    velocities: SoundVelocities | None
    moduli: Moduli | None
    phonons: Phonons | None
    bands: Bands | None
    dos: DensityOfStates | None
    files: tuple[Path, ...]
    rung: Rung | None = None
    waves: SampleWaves | None = None
    failures: tuple[str, ...] = ()

    @property
    def warnings(self) -> tuple[str, ...]:
        """One sentence for each limit of validity exceeded, each number unknown or left out, and each figure that failed."""
        spectra = self.phonons is not None and bool(self.state.samples)
        left_out = (LATTICE_BANDS,) if spectra else ()
        if self.velocities is None and self.mechanism is not None:
            left_out = (describe_mechanism(self.mechanism), *left_out)
        found = [text for one in (self.velocities, self.bands, self.dos) if one is not None for text in one.warnings]
        found += self.waves.warnings if self.waves is not None else ()
        own = tuple(dict.fromkeys((*self.validity.warnings, *found)))
        return own + warn_of_missing_error(self._exponents) + left_out + self.failures

    @property
    def finite_overlap(self) -> bool:
        """Whether the numbers have the terms of relative order delta/d."""
        return bool(self.state.finite_overlap)

    @cached_property
    def mechanism(self) -> MechanismError | None:
        """The error that the velocities of a mechanism raise; None if the lattice is rigid."""
        try:
            self.state.loaded_lattice.without_overlap.require_rigid()
        except MechanismError as error:
            return error
        return None

    def entry(self, name: str) -> Observable | None:
        """Return the entry of the catalogue for a number of the summary; None if it has none."""
        return entry_of(name, self.state.packing) if name in CATALOGUE else None

    @cached_property
    def _analysis(self) -> Analysis:
        return Analysis(self.state, None, self.velocities, self.moduli)

    @cached_property
    def _exponents(self) -> dict[str, Any]:
        """The local exponent, by name; empty for a simulation without velocities, as it needs two more equilibria there."""
        asked = self.velocities is not None or not self.state.samples
        return find_all(self._analysis, ("exponent",)) if asked else {}

    def summary(self) -> dict[str, Any]:
        """Return the numbers as plain data in SI units, under the names of the library's attributes."""
        out: dict[str, Any] = {"medium": self.medium}
        if self.rung is not None:
            out |= {"choice": self.rung.medium.label, "expected_error": float(self.rung.errors[0])}
            out["truth"] = str(self.rung.truth)
        out |= find_all(self._analysis, ("state",)) | self._exponents | find_all(self._analysis, ("packing",))
        if self.local_field is not None:
            out["local_field"] = {name: getattr(self.local_field, name) for name in ("alpha", "beta", "xi")}
        if self.velocities is not None:
            out |= find_all(self._analysis, ("velocities",))
        if self.bands is not None:
            out["top_frequency"] = float(self.bands.frequencies.max())
        if self.waves is not None:
            out |= self.waves.summary()
        return out

    @property
    def packages(self) -> tuple[str, ...]:
        """Names of the packages that the computation used, besides numpy and scipy."""
        return ("ase", "phonopy", "spglib") if self.phonons is not None else ("ase",) * bool(self.state.samples)

    def write(self, place: Path, step: Step) -> None:
        """Write the files of the bands, the density of states and the sample into the existing folder ``place``."""
        if self.state.samples:
            sample = self.state.samples[0]
            write_extxyz(place / "sample.extxyz", sample.atoms())
            step.advance()
            if isinstance(sample, PressedSample):
                sample.network.write_tables(*(place / name for name in SAMPLE_TABLES))
                step.advance(len(SAMPLE_TABLES))
        if self.bands is not None and self.phonons is not None:
            self.bands.write(place / "band.yaml")
            self.phonons.save(place / "phonopy_params.yaml")
            step.advance(2)
        if self.dos is not None:
            self.dos.write_csv(place / "dos.csv")
            step.advance()
        if self.waves is not None:
            self.waves.write(place, step)

    @property
    def left_out(self) -> tuple[str, ...]:
        """Names of files and figures that have nothing to hold, as no pulse could be sent."""
        if self.waves is None or "pulse.json" in self.waves.files:
            return ()
        return ("pulse.json", "pulse.csv", "pulse.png")

    def figure(self, name: str) -> Any:
        """Draw the matplotlib figure of the file ``name``."""
        if name == "forces.png":
            from granphon.figures.forces import forces_figure

            return forces_figure(self.state)
        if self.waves is not None and name in wave_figures(WAVES):
            return self.waves.figure(name)
        from granphon.figures.bands import bands_figure

        return bands_figure(bands=self.bands, dos=self.dos)


@dataclass(frozen=True)
class SweepResult(Summarised):
    """Results of a scene of many states.

    Attributes
    ----------
    folder, files : folder of the results, and the paths of the files written there.
    dataset : the data set that :func:`granphon.sweeps.sweep.sweep` returns.
    failures : one sentence for each figure that could not be drawn, with the reason.
    """

    #: names of the packages that the computation used, besides numpy and scipy
    packages: ClassVar[tuple[str, ...]] = ("xarray", "h5netcdf")
    #: names of files that have nothing to hold
    left_out: ClassVar[tuple[str, ...]] = ()

    folder: Path
    dataset: Dataset
    files: tuple[Path, ...]
    failures: tuple[str, ...] = ()

    @property
    def warnings(self) -> tuple[str, ...]:
        """One sentence for each condition of validity that fails, with medium and parameters, and for each failed figure."""
        return (*json.loads(self.dataset.attrs["warnings"]), *self.failures)

    @property
    def finite_overlap(self) -> bool | list[bool]:
        """Whether the numbers have the terms of relative order delta/d; a list in the order of the media if they differ."""
        from granphon.sweeps.dataset import list_finite_overlap  # here: a scene of one state does not need it

        found = list_finite_overlap(self.dataset)
        return found if len(set(found)) > 1 else found[0]

    def summary(self) -> dict[str, Any]:
        """Return the sizes of the dimensions, and the least and the greatest force, overlap and velocities in SI units.

        The direction of sound, if it was given or velocities depend on it, the number of states, the media, and whether all
        states are valid are added.
        """
        data = self.dataset
        along = ("direction",) * ("direction" in data.dims)
        sizes = {str(name): data.sizes[name] for name in (*data["valid"].dims, *along)}
        out: dict[str, Any] = {"sizes": sizes, "states": data["valid"].size, "medium": data["medium"].values}
        if "direction" in data.coords:
            out["direction"] = json.loads(data["direction"].attrs["values"])
        elif "tensor" in data:  # some lattice is not isotropic, and its velocities are along x
            out["direction"] = [1.0] + [0.0] * {3: 1, 6: 2}[data.sizes["voigt_row"]]
        for name in _EXTENTS:
            if name in data:
                out[name] = [float(data[name].min()), float(data[name].max())]
        return out | {"valid": bool(data["valid"].all())}

    def entry(self, name: str) -> Observable | None:
        """Return the entry of the catalogue for a number of the summary; None if it has none."""
        units = self.dataset[name].attrs if name in self.dataset else {}
        return replace(CATALOGUE[name], unit=units.get("units", CATALOGUE[name].unit)) if name in CATALOGUE else None

    def write(self, place: Path, step: Step) -> None:
        """Write the data set and its table into the existing folder ``place``."""
        from granphon.sweeps.archive import write_sweep, write_waves

        write_sweep(self.dataset, place / "sweep.nc")
        step.advance(2 + len(write_waves(self.dataset, place)))

    def figure(self, name: str) -> Any:
        """Draw the matplotlib figure of the file ``name``."""
        from granphon.scene.sweep_figures import draw_sweep

        return draw_sweep(self.dataset, name)
