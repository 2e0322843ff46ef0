"""What a run keeps of the waves in each sample, and its means over samples with their standard errors.

:func:`require_waves` refuses what can be known to be impossible before anything is simulated.

Of a sample, :func:`record_waves` keeps arrays by name. :func:`average_waves` makes of those of several samples at one load
the observables that the catalogue lists under the costs "dos", "spectrum" and "pulse". What cannot be found in a state has
no entry there, and a note says why.
"""

from __future__ import annotations

import json
import math
from collections.abc import Callable, Mapping, Sequence
from functools import partial
from typing import Any, TypeVar

import numpy as np
from numpy.typing import NDArray

from granphon.array.sample import Sample, standard_error
from granphon.balls.loads import Load
from granphon.base.errors import GranphonError, InputError
from granphon.base.results import Result
from granphon.media.choice import ServingMedium
from granphon.media.cost import find_typical_force
from granphon.media.loaded_lattice import ideal_lattice
from granphon.media.mean_field import AveragedLattice
from granphon.networks.network import ContactNetwork
from granphon.waves.chebyshev import Kernel
from granphon.waves.operator import WaveOperator
from granphon.waves.path_spectra import find_path_points
from granphon.waves.plane_waves import find_polarisations
from granphon.waves.pulse_source import MARGIN, PulseSource, require_sendable, transmit
from granphon.waves.pulses import Pulse
from granphon.waves.settings import PulseSettings, WaveSettings
from granphon.waves.spectral_functions import find_attenuation, find_ioffe_regel, find_mean_free_path
from granphon.waves.waves import Waves

Array = NDArray[Any]
Record = Mapping[str, Array]
Kept = TypeVar("Kept", bound=Result)
#: what the names of whole results begin with
_WHOLE = "whole."
#: numbers of a pulse that are averaged, and what a pulse calls them
_PULSE = {"pulse_velocity": "velocity", "time_of_flight": "time_of_flight", "coherent_fraction": "coherent_fraction"}


# -- before anything is simulated -----------------------------------------------------------------------------------


def require_waves(serving_media: Sequence[ServingMedium], wanted: WaveSettings, most: float = np.inf) -> None:
    """Raise if what is ``wanted`` cannot be found in the arrays of a case, at any of its loads.

    Each array of up to ``most`` balls is looked at as one of equal balls at the same mean force, which takes no simulation:
    the wave vectors of its cell, the motions of its balls, the way of the pulse and how long it may be heard. What depends
    on the load is refused if it fails at the least and at the greatest.
    """
    if wanted.spectrum is None and wanted.pulse is None:
        return
    for medium, load in ((one, serving.load) for serving in serving_media for one in serving.arrays if one.balls <= most):
        errors = list[GranphonError]()
        forces = find_typical_force(medium.packing, load)
        ends = list(dict.fromkeys((float(np.min(forces)), float(np.max(forces)))))
        for number, force in enumerate(ends):
            ideal = AveragedLattice(medium.packing).at(Load.only(force=force))[0]
            network = ContactNetwork.from_state(ideal, medium.cells)
            if (settings := wanted.spectrum) is not None and not number:
                packing = medium.packing
                way = find_path_points(network, ideal_lattice(packing), packing.diameter, wanted.path, settings.points)
                operator = WaveOperator(network)
                # the bound of frequencies of equal balls is below that of differing ones, but for a little: it takes no
                # more moments
                Kernel.of(operator.top / (2.0 * math.pi * MARGIN), settings.resolution)
                for name in settings.polarisation:
                    find_polarisations(operator, way.q[0], name, None)
            try:
                if wanted.pulse is not None:
                    require_sendable(network, PulseSource.of(wanted.pulse, network, wanted.direction))
            except GranphonError as error:
                errors.append(error)
        if len(errors) == len(ends):
            raise errors[0]


# -- of one sample ------------------------------------------------------------------------------------------------------


def record_waves(sample: Sample, wanted: WaveSettings, whole: bool = False) -> dict[str, Array]:
    """Find what is wanted of the waves in a sample, and return the numbers that are averaged, in SI units by name.

    With ``whole`` the results themselves are kept too, for :func:`read_whole`.
    """
    waves, out, results = Waves(sample), dict[str, Array](), dict[str, Result]()
    if wanted.dos:
        # random vectors differ from sample to sample, so that their noise is part of the standard error over samples
        found = waves.dos(seed=sample.seed or 0)
        parts = (found.frequencies, found.translational, found.rotational, found.error)
        out["dos"], results["dos"] = np.array(parts), found
    if (settings := wanted.spectrum) is not None:
        packing = sample.packing
        way = find_path_points(waves.network, ideal_lattice(packing), packing.diameter, wanted.path, settings.points)
        spectra = {name: waves.spectral_function(way.q, name, settings.resolution) for name in settings.polarisation}
        lines = [(one.peak, one.width, one.resolved) for one in spectra.values()]
        out |= {"path_corners": way.corners, "path_distance": way.distances, "lines": np.array(lines, float)}
        out["wavenumber"] = spectra[settings.polarisation[0]].wavenumber
        results |= spectra
    if wanted.pulse is not None:
        numbers, pulse = _record_pulse(waves, wanted.pulse, wanted.direction)
        out |= numbers
        results |= {} if pulse is None else {"pulse": pulse}
    if whole:
        out |= {_WHOLE + name: np.array(json.dumps(one.to_dict()).encode()) for name, one in results.items()}
    return out


def read_whole(record: Record, name: str, kind: type[Kept]) -> Kept | None:
    """Return a result that :func:`record_waves` has kept: "dos", "pulse" or a polarisation; None if there is none."""
    text = record.get(_WHOLE + name)
    return None if text is None else kind.from_dict(json.loads(text.item()))


def _record_pulse(waves: Waves, settings: PulseSettings, direction: Any) -> tuple[dict[str, Array], Pulse | None]:
    """Send a pulse. What cannot be known of it is nan, and the text ``pulse_note`` says why."""
    out, note, said, heard = dict.fromkeys(_PULSE, math.nan), "", "", None
    try:
        heard = transmit(waves.network, PulseSource.of(settings, waves.network, direction))
        out |= {name: getattr(heard, source) for name, source in _PULSE.items()}
        note = heard.why_unknown
        said = " ".join(text for text in heard.warnings if not note or note not in text)
    except GranphonError as error:  # what could be known before the simulation has been refused by now
        note = str(error)
    numbers = {name: np.array(value) for name, value in out.items()}
    return numbers | {"pulse_note": np.array(note), "pulse_echo": np.array(said)}, heard


# -- of several samples at one load -------------------------------------------------------------------------------------


def average_waves(records: Sequence[Record], wanted: WaveSettings) -> tuple[dict[str, Array], list[str]]:
    """Return the observables of waves of the samples at one load, by name, and notes on them.

    Standard errors are those over samples; a density of states of one sample has that of the random vectors.
    """
    out, notes = dict[str, Array](), list[str]()
    if wanted.dos:
        out |= _average_dos([one["dos"] for one in records])
    if wanted.spectrum is not None:
        found, said = _average_spectra(records, wanted.spectrum.polarisation)
        out, notes = out | found, notes + said
    if wanted.pulse is not None:
        found, said = _average_pulses(records)
        out, notes = out | found, notes + said
    return out, notes


def _average_dos(found: Sequence[Array]) -> dict[str, Array]:
    """Average densities at the points of the sample whose frequencies reach highest; others are interpolated."""
    from scipy.interpolate import CubicSpline

    points = max((one[0] for one in found), key=lambda one: float(one[-1]))

    def at(one: Array) -> Array:
        if np.array_equal(one[0], points):
            return one[1:]
        return np.where(points <= one[0, -1], np.maximum(CubicSpline(one[0], one[1:], axis=1)(points), 0.0), 0.0)

    every = np.array([at(one) for one in found])
    translational, rotational, own = np.mean(every, axis=0)
    total = every[:, 0] + every[:, 1]
    error = standard_error(total, axis=0) if len(found) > 1 else own
    return {
        "dos_frequency": points, "dos_total": translational + rotational, "dos_translational": translational,
        "dos_rotational": rotational, "dos_error": error,
    }  # fmt: skip


def _average_spectra(records: Sequence[Record], polarisations: Sequence[str]) -> tuple[dict[str, Array], list[str]]:
    """Average peaks and widths; the other observables are those of the mean lines."""
    first = records[0]
    out = {name: first[name] for name in ("path_corners", "path_distance", "wavenumber")}
    every = np.array([one["lines"] for one in records])  # samples, polarisations, (peak, width, resolved), wave vectors
    q = out["wavenumber"]

    peak, width, resolved = np.moveaxis(np.mean(every, axis=0), 1, 0)
    velocity = 2.0 * np.pi * peak / q
    out |= {
        "line_frequency": peak, "line_width": width, "line_resolved": resolved, "phase_velocity": velocity,
        "attenuation": find_attenuation(velocity, width), "mean_free_path": find_mean_free_path(velocity, width),
    }  # fmt: skip
    if len(records) > 1:
        peaks, widths = every[:, :, 0], every[:, :, 1]
        out["line_frequency_error"] = standard_error(peaks, axis=0)
        out["line_width_error"] = standard_error(widths, axis=0)
        out["phase_velocity_error"] = 2.0 * np.pi * out["line_frequency_error"] / q
        out["attenuation_error"] = standard_error(find_attenuation(2.0 * np.pi * peaks / q, widths), axis=0)
    notes = []
    for number, name in enumerate(polarisations):
        try:
            found = find_ioffe_regel(q, peak[number], width[number])
        except InputError as error:
            notes.append(f"no Ioffe-Regel frequency of {name} waves: {error}")
            continue
        if found is None:
            why = "their mean free path is longer than 1/|q| all along the path"
            notes.append(f"no Ioffe-Regel frequency of {name} waves: {why}")
            continue
        out[f"ioffe_regel_{name}"] = np.array(found)
        if len(records) > 1:
            out[f"ioffe_regel_{name}_error"] = np.array(_jackknife(partial(_cross, q), every[:, number]))
    return out, notes


def _cross(q: Array, lines: Array) -> float:
    """Return the Ioffe-Regel frequency of lines (3, n), Hz; nan if there is none."""
    try:
        found = find_ioffe_regel(q, lines[0], lines[1])
    except InputError:
        return math.nan
    return math.nan if found is None else found


def _jackknife(of: Callable[[Array], float], every: Array) -> float:
    """Return the standard error of a function of the mean over the first axis, as samples are left out one by one."""
    count = len(every)
    without = [of(np.mean(np.delete(every, left, axis=0), axis=0)) for left in range(count)]
    return math.sqrt(count - 1) * float(np.std(without))


def _average_pulses(records: Sequence[Record]) -> tuple[dict[str, Array], list[str]]:
    """Average the pulses that could be read; notes say in how many samples they could not, and why."""
    out = dict[str, Array]()
    values = {name: np.array([float(one[name]) for one in records]) for name in _PULSE}
    for name, each in values.items():
        known = each[np.isfinite(each)]
        if known.size:
            out[name] = np.array(np.mean(known))
        if name == "pulse_velocity" and known.size > 1:
            out["pulse_velocity_error"] = np.asarray(standard_error(known, axis=0))
    notes = list(dict.fromkeys(str(one["pulse_echo"]) for one in records if str(one["pulse_echo"])))
    reasons = [str(one["pulse_note"]) for one in records if str(one["pulse_note"])]
    if reasons:
        where = "" if len(records) == 1 else f" in {len(reasons)} of {len(records)} samples"
        rest = ", and the mean is that of the others" if len(reasons) < len(records) else ""
        notes.append(f"the arrival of the pulse is not known{where}{rest}: {reasons[0]}")
    return out, notes
