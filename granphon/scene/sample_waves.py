"""The waves in the samples of a simulated state, as a scene asks for them: density of states, spectrum, pulse."""

from __future__ import annotations

import json
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np

from granphon.base.errors import GranphonError, InputError, message
from granphon.base.progress import Progress, Step
from granphon.base.results import Result
from granphon.base.tables import Heading, write_table
from granphon.media.state import ContactState
from granphon.scene.specification import Specification
from granphon.waves.dos import SpectralDensity
from granphon.waves.path_spectra import PathSpectra, find_path_spectra
from granphon.waves.pulses import Pulse, average_pulses
from granphon.waves.sending import Sending, transmit
from granphon.waves.settings import PulseSettings
from granphon.waves.waves import Waves

__all__ = ["SampleWaves", "draw_waves", "find_sample_waves"]


@dataclass(frozen=True)
class SampleWaves:
    """Waves in the samples; what the scene did not ask for is None.

    ``dos`` and ``spectra`` are those of the first sample, ``pulse`` of all samples through which one could be sent, and
    ``notes`` say where none could.
    """

    dos: SpectralDensity | None = None
    spectra: PathSpectra | None = None
    pulse: Pulse | None = None
    notes: tuple[str, ...] = ()

    @cached_property
    def _results(self) -> dict[str, Any]:
        found = {"sample_dos": self.dos, "spectrum": self.spectra, "pulse": self.pulse}
        return {name: one for name, one in found.items() if one is not None}

    @property
    def warnings(self) -> tuple[str, ...]:
        """What is to be known of the results, and what of them is not known, and why."""
        return (() if self.pulse is None else self.pulse.warnings) + self.notes

    def summary(self) -> dict[str, Any]:
        """Return numbers of the results, by name, in SI units; those that are not known are left out."""
        sent = self.pulse
        if sent is None:
            return {}
        out = {"pulse_distance": sent.distance, "coherent_fraction": sent.coherent_fraction}
        if not sent.why_unknown:
            out |= {"time_of_flight": sent.time_of_flight, "pulse_velocity": sent.velocity}
        return out

    @property
    def files(self) -> tuple[str, ...]:
        """Names of the files and figures that there is something to write into."""
        return tuple(f"{name}{ending}" for name in self._results for ending in (".json", ".csv", ".png"))

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


def find_sample_waves(scene: Specification, state: ContactState, progress: Progress) -> SampleWaves | None:
    """Find what the scene observes of the waves in the samples of the state; None if that is nothing."""
    wanted = {"dos", "spectrum", "pulse"} & set(scene.observe)
    if not (wanted and state.samples):
        return None
    waves = Waves(state.samples[0])
    dos, spectra, pulse, notes = None, None, None, tuple[str, ...]()
    if "dos" in wanted:
        with progress.step("density of states of the sample"):
            dos = waves.dos()
    if "spectrum" in wanted:
        with progress.step("spectrum"):
            settings, path = scene.spectrum, scene.path
            spectra = find_path_spectra(
                waves, state.contact_lattice(), state.scales, path.arrays, path.names,
                points=settings.points, polarisations=settings.polarisation, resolution=settings.resolution,
            )  # fmt: skip
    if "pulse" in wanted and scene.pulse is not None:
        with progress.step("pulse"):
            pulse, notes = _send(state.samples, scene.pulse, scene.directions[0] if scene.directions else None)
    return SampleWaves(dos, spectra, pulse, notes)


def _send(samples: Sequence[Any], settings: PulseSettings, along: Any) -> tuple[Pulse | None, tuple[str, ...]]:
    """Send a pulse through each sample; None if it can be sent through none, and notes on those through which it cannot.

    What can be known before a simulation is refused before it: here are forces of contacts that no one knew.
    """
    sent, failures = list[Pulse](), list[str]()
    for one in samples:
        try:
            sent.append(transmit(one.network, Sending.of(settings, one.network, along)))
        except GranphonError as error:
            failures.append(str(error))
    where = f"{len(failures)} of {len(samples)} samples" if len(samples) > 1 else "the array"
    notes = (f"no pulse could be sent through {where}: {failures[0]}",) if failures else ()
    return (average_pulses(sent) if sent else None), notes
