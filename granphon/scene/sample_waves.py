"""The waves in the samples of a simulated state, as a scene asks for them: density of states, spectrum, pulse."""

from __future__ import annotations

import json
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any, Self

import numpy as np

from granphon.base.errors import InputError, message
from granphon.base.progress import Step
from granphon.base.results import Result
from granphon.base.tables import Heading, write_table
from granphon.media.state import ContactState
from granphon.scene.specification import Specification
from granphon.sweeps.records import SampleRecord
from granphon.sweeps.wave_records import read_whole
from granphon.waves.dos import SpectralDensity
from granphon.waves.path_spectra import PathSpectra
from granphon.waves.pulses import Pulse, average_pulses
from granphon.waves.spectral_functions import SpectralFunction


@dataclass(frozen=True)
class SampleWaves:
    """Waves in the samples; what the scene did not ask for is None.

    ``dos`` and ``spectra`` are those of the first sample, and ``pulse`` of all samples through which one could be sent.
    """

    dos: SpectralDensity | None = None
    spectra: PathSpectra | None = None
    pulse: Pulse | None = None

    @classmethod
    def of(cls, scene: Specification, state: ContactState, records: Sequence[SampleRecord]) -> Self:
        """Take the waves from what was found of the samples of a state."""
        kept = [one.of_waves for one in records]
        sent = [one for record in kept if (one := read_whole(record, "pulse", Pulse)) is not None]
        found = [read_whole(kept[0], name, SpectralFunction) for name in scene.spectrum.polarisation]
        spectra, path = [one for one in found if one is not None], None
        if spectra:
            ends, way = (kept[0][name] for name in ("path_corners", "path_distance"))
            path = PathSpectra.of(
                spectra, ends, way, state.contact_lattice(), state.scales, scene.path.arrays, scene.path.names
            )
        dos = read_whole(kept[0], "dos", SpectralDensity)
        return cls(dos, path, average_pulses(sent) if sent else None)

    @cached_property
    def _results(self) -> dict[str, Any]:
        found = {"sample_dos": self.dos, "spectrum": self.spectra, "pulse": self.pulse}
        return {name: one for name, one in found.items() if one is not None}

    def write(self, place: Path, step: Step) -> None:
        """Write the files of numbers into the existing folder ``place``."""
        for name, one in self._results.items():
            (place / f"{name}.json").write_text(json.dumps(one.to_dict()) + "\n", encoding="utf-8")
            _TABLES[name](one, place / f"{name}.csv")
            step.advance(2)

    def figure(self, name: str) -> Any:
        """Draw the figure of the file ``name``."""
        return draw_waves(name, self._results[Path(name).stem])


def _write_dos(result: SpectralDensity, path: Path) -> None:
    names = ("total", "translational", "rotational", "error")
    columns = (result.frequencies, *(getattr(result, name) for name in names))
    with path.open("w", encoding="utf-8") as stream:
        headings = [Heading("frequency", "Hz"), *(Heading(name, "1/Hz") for name in names)]
        write_table(stream, headings, np.transpose(columns).tolist())


def _write_pulse(result: Pulse, path: Path) -> None:
    headings = [Heading("time", "s"), Heading("force_sent", "N"), Heading("coherent", "m/s"), Heading("speckle", "m/s")]
    columns = (result.times, result.sent, result.coherent, result.speckle_amplitude)
    with path.open("w", encoding="utf-8") as stream:
        write_table(stream, headings, np.transpose(columns).tolist())


#: what writes the table of each result
_TABLES: dict[str, Callable[[Any, Path], None]] = {
    "sample_dos": _write_dos, "spectrum": PathSpectra.write_csv, "pulse": _write_pulse,
}  # fmt: skip
#: the class of each result
WAVE_RESULTS: dict[str, type[Result]] = {"sample_dos": SpectralDensity, "spectrum": PathSpectra, "pulse": Pulse}


def read_waves(path: Path) -> Any:
    """Read the result in a file of :attr:`granphon.scene.result_files.WAVE_FILES` that ends in ".json"."""
    try:
        data = json.loads(path.read_text(encoding="utf-8"))
    except (ValueError, RecursionError):
        raise InputError(message(f"{path} is not JSON", mend="Run the scene again")) from None
    try:
        return WAVE_RESULTS[path.stem].from_dict(data)
    except InputError as error:
        raise InputError(f"{path}: {error}") from None


def draw_waves(name: str, result: Any) -> Any:
    """Draw the figure of the file ``name`` from its result."""
    if name == "pulse.png":
        from granphon.figures.pulses import pulse_figure

        return pulse_figure(result)
    from granphon.figures.spectra import sample_dos_figure, spectrum_figure

    return spectrum_figure(result) if name == "spectrum.png" else sample_dos_figure(result)
