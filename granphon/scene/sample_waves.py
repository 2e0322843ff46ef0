"""The waves in the samples of a simulated state, as a scene asks for them: density of states, spectrum, pulse."""

from __future__ import annotations

import json
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Self

from granphon.base.errors import InputError, message
from granphon.base.results import Result
from granphon.media.state import ContactState
from granphon.runs.samples import SampleRecord
from granphon.runs.wave_records import read_whole
from granphon.scene.specification import Specification
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

    @property
    def results(self) -> dict[str, Any]:
        """What was found, by the names of the files."""
        found = {"sample_dos": self.dos, "spectrum": self.spectra, "pulse": self.pulse}
        return {name: one for name, one in found.items() if one is not None}


#: the class of each result
WAVE_RESULTS: dict[str, type[Result]] = {"sample_dos": SpectralDensity, "spectrum": PathSpectra, "pulse": Pulse}


def read_waves(path: Path) -> Any:
    """Read the result in a file ``sample_dos.json``, ``spectrum.json`` or ``pulse.json``."""
    try:
        data = json.loads(path.read_text(encoding="utf-8"))
    except (ValueError, RecursionError):
        raise InputError(message(f"{path} is not JSON", mend="Run the scene again")) from None
    try:
        return WAVE_RESULTS[path.stem].from_dict(data)
    except InputError as error:
        raise InputError(f"{path}: {error}") from None
