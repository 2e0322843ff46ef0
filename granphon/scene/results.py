"""The results of a scene: a data set of all states, and of a single state its samples, bands and densities of states.

A state is a sweep of one: it has the same data set. Whatever is drawn or written is a view of that, or an export of the one
state for other programs.
"""

from __future__ import annotations

import json
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from granphon.base.errors import InputError, message
from granphon.base.notebook import write_html
from granphon.dynamics.local_field import LocalField
from granphon.media.state import ContactState
from granphon.observables.catalogue import CATALOGUE, Analysis, Observable, entry_of, find_all
from granphon.observables.validity import Validity
from granphon.observables.velocities import Moduli, SoundVelocities
from granphon.scene.plan import Plan
from granphon.scene.result_files import SAMPLE_WAVES, draw_sample_waves, draw_spectra, draw_sweep
from granphon.scene.specification import Specification
from granphon.waves.settings import POLARISATIONS

if TYPE_CHECKING:
    from granphon.phonons.bands import Bands
    from granphon.phonons.dos import DensityOfStates
    from granphon.phonons.phonons import Phonons
    from granphon.runs.dataset import Dataset
    from granphon.runs.wave_records import SampleWaves


#: variables of which the summary of several states lists the least and the greatest value
_EXTENTS = (
    "force", "overlap", "longitudinal", "transverse", "transverse_slow", "transverse_fast", "pulse_velocity",
    "time_of_flight", "coherent_fraction", *(f"ioffe_regel_{name}" for name in POLARISATIONS),
)  # fmt: skip
#: what the summary of one state says of the waves in its samples, where it is known
_OF_WAVES = [name for name, one in CATALOGUE.items() if one.cost in ("pulse", "spectrum") and not one.dims]


@dataclass(frozen=True, eq=False)
class RunResult:
    """Results of a scene.

    Attributes
    ----------
    plan : of the scene.
    folder, files : folder of the results, and the paths of the files written there.
    dataset : every state, with velocities, moduli and bands, as :func:`granphon.runs.sweep.sweep` returns it.
    given : of a single state, what has been found of it; None after reading it from its folder.
    phonons : of a single state, the source of ``bands`` and ``dos``; None if neither was asked for, as of several states,
        and after reading the result from its folder, where files hold these.
    bands, dos : of a single state, frequencies along the path, Hz, and their density of states, 1/Hz; likewise.
    waves : what was asked for of the waves in the samples of a single state; likewise.
    failures : one sentence for each figure that could not be drawn, with the reason.
    """

    plan: Plan
    folder: Path
    dataset: Dataset
    given: Analysis | None = None
    phonons: Phonons | None = None
    bands: Bands | None = None
    dos: DensityOfStates | None = None
    waves: SampleWaves | None = None
    files: tuple[Path, ...] = ()
    failures: tuple[str, ...] = ()

    @property
    def scene(self) -> Specification:
        """What was asked for."""
        return self.plan.scene

    # -- a single state -------------------------------------------------------------------------------------------------

    @property
    def state(self) -> ContactState:
        """The only state; :class:`~granphon.base.errors.InputError` if there are several."""
        return self._analysis.state

    @property
    def validity(self) -> Validity:
        """The conditions under which the model holds, of the only state."""
        return self._analysis.validity

    @cached_property
    def _analysis(self) -> Analysis:
        if not self.plan.is_single:
            raise InputError(message("the result is that of a sweep", "It has no single state", "Take its dataset"))
        return Analysis(self.plan.state(), self.scene.direction) if self.given is None else self.given

    @property
    def velocities(self) -> SoundVelocities | None:
        """Sound velocities of the only state, m/s; None if they were not asked for."""
        return self._analysis.velocities if "velocities" in self.scene.observe else None

    @property
    def moduli(self) -> Moduli | None:
        """Elastic constants of the only state, Pa; None if velocities were not asked for, or it has none."""
        return self._analysis.moduli if "velocities" in self.scene.observe else None

    @property
    def local_field(self) -> LocalField | None:
        """Local field of the effective medium; None of another medium, and for equal balls."""
        medium = self.plan.serving.medium.of(self.scene.packing)
        return medium.local_field if self.scene.packing.width else None

    # -- numbers --------------------------------------------------------------------------------------------------------

    @property
    def warnings(self) -> tuple[str, ...]:
        """One sentence for each limit of validity exceeded, each number unknown or left out, and each figure that failed."""
        found = [text for one in (self.bands, self.dos) if one is not None for text in one.warnings]
        return tuple(dict.fromkeys((*json.loads(self.dataset.attrs["warnings"]), *found, *self.failures)))

    @property
    def finite_overlap(self) -> bool | list[bool]:
        """Whether the numbers have the terms of relative order delta/d; a list in the order of the media if they differ."""
        from granphon.runs.dataset import list_finite_overlap

        if self.plan.is_single:
            return bool(self.state.finite_overlap)
        found = list_finite_overlap(self.dataset)
        return found if len(set(found)) > 1 else found[0]

    def entry(self, name: str) -> Observable | None:
        """Return the entry of the catalogue for a number of the summary; None if it has none."""
        return entry_of(name, self.scene.packing) if name in CATALOGUE else None

    def summary(self) -> dict[str, Any]:
        """Return the numbers as plain data in SI units, under the names of the library's attributes.

        Of several states these are the sizes of the dimensions, the number of states, the media, and the least and the
        greatest force, overlap and velocities; with the direction of sound, if it was given or velocities depend on it.
        """
        if not self.plan.is_single:
            return self._summarise_states()
        out: dict[str, Any] = {"medium": self.scene.media[0].label}
        if (serving := self.plan.serving).chosen_automatically:
            out |= {"choice": serving.medium.label, "expected_error": float(serving.errors[0]), "truth": str(serving.truth)}
        of = self._analysis
        out |= find_all(of, ("state",)) | (find_all(of, ("exponent",)) if "exponent" in self.dataset else {})
        out |= find_all(of, ("packing",))
        if (field := self.local_field) is not None:
            out["local_field"] = {name: getattr(field, name) for name in ("alpha", "beta", "xi")}
        out |= find_all(of, ("velocities",)) if "velocities" in self.scene.observe else {}
        if self.bands is not None:
            out["top_frequency"] = float(self.bands.frequencies.max())
        if self.waves is not None and self.waves.pulse is not None:
            out["pulse_distance"] = self.waves.pulse.distance
        known = {name: self.dataset[name].item() for name in _OF_WAVES if name in self.dataset}
        return out | {name: value for name, value in known.items() if np.isfinite(value)}

    def _summarise_states(self) -> dict[str, Any]:
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

    def _repr_html_(self) -> str:
        numbers = self.summary()
        entries = {name: self.entry(name) for name in numbers}
        return write_html(
            type(self).__name__, ((name, numbers[name], one.unit if one else "") for name, one in entries.items())
        )

    # -- files ----------------------------------------------------------------------------------------------------------

    @property
    def left_out(self) -> tuple[str, ...]:
        """Names of files and figures that have nothing to hold, as no pulse could be sent."""
        if self.waves is None or "pulse" not in self.scene.observe or self.waves.pulse is not None:
            return ()
        return ("pulse.json", "pulse.csv", "pulse.png")

    def figure(self, name: str) -> Any:
        """Draw the matplotlib figure of the file ``name``."""
        stem = name.removesuffix(".png")
        if stem == "forces":
            from granphon.figures.forces import forces_figure

            return forces_figure(self.state)
        if self.waves is not None and stem in SAMPLE_WAVES:
            return draw_sample_waves(stem, self.waves.results[stem])
        return draw_spectra(self.bands, self.dos) if stem in ("bands", "dos") else draw_sweep(self.dataset, name)
