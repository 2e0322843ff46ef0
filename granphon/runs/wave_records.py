"""The numbers that a run keeps of the waves in each sample or network, and their means over samples
with standard errors.

:func:`require_waves` and :func:`require_network` refuse what can be known to be impossible before
anything is simulated.

Of a sample, :func:`record_waves` keeps arrays by name. :func:`average_waves` makes of those of
several samples at one load the observables that the catalogue lists under the costs "dos",
"spectrum", "pulse" and "network". What cannot be found in a state has no entry there, and a note
says why.

A block of a scene about the network of a state, such as ``response``, has settings, and a row of
:data:`RECORDS` with two functions. The first takes a state, sample or network and the settings, and
returns arrays by name, and for each result that a single state has in a file of its own, a function
that makes its bytes. The second takes these of all samples at one load, one of a state without
samples, and the settings, and returns observables of the catalogue by name, and notes.
"""

from __future__ import annotations

import io
import json
import math
import warnings
from collections.abc import Callable, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from itertools import pairwise, product
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple, Self

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from granphon.array.sample import Sample, standard_error
from granphon.balls.loads import Load
from granphon.balls.packing import Packing
from granphon.base.arrays import Index
from granphon.base.errors import (
    ConvergenceError,
    GranphonError,
    InputError,
    LimitWarning,
    StoppedEarlyWarning,
)
from granphon.base.results import Result
from granphon.base.tables import Heading, table_text
from granphon.base.text import counted
from granphon.base.validation import index_array
from granphon.media.choice import ServingMedium
from granphon.media.cost import find_typical_force
from granphon.media.crystal import CrystalState
from granphon.media.medium import AveragedLattice
from granphon.media.state import ContactState, NetworkState, ideal_lattice
from granphon.networks.network import ContactNetwork, given_network
from granphon.phonons.surfaces import SurfaceSpectrum
from granphon.waves.chebyshev import Kernel
from granphon.waves.dos import SpectralDensity
from granphon.waves.motion import Motion, fit_velocity
from granphon.waves.operator import WaveOperator
from granphon.waves.path_spectra import PathSpectra, find_path_points
from granphon.waves.pulses import (
    MARGIN,
    Pulse,
    PulseSource,
    average_pulses,
    read_vector,
    require_moves,
    require_sendable,
    transmit,
)
from granphon.waves.response import Peaks, Response, find_peaks, require_places
from granphon.waves.settings import (
    RESPONSES,
    MotionSettings,
    NetworkSettings,
    PulseSettings,
    ResponseSettings,
    SpectrumSettings,
    WaveSettings,
    find_place,
)
from granphon.waves.spectral_functions import (
    SpectralFunction,
    find_attenuation,
    find_ioffe_regel,
    find_mean_free_path,
    find_polarisations,
)
from granphon.waves.waves import Waves

if TYPE_CHECKING:
    from granphon.waves.nonlinear import NonlinearWaves

Array = NDArray[Any]
Record = Mapping[str, Array]
#: prefix of the names of whole results
_WHOLE = "whole."
#: numbers of a pulse that are averaged, and their attributes of a pulse
_PULSE = {
    "pulse_velocity": "velocity",
    "time_of_flight": "time_of_flight",
    "coherent_fraction": "coherent_fraction",
}
#: numbers of a motion, numbers over time, and numbers with standard errors over samples, by the
#: names of the catalogue
NUMBERS = (
    "front_velocity",
    "peak_velocity",
    "greatest_force",
    "energy_translation",
    "energy_rotation",
    "energy_stored",
    "energy_lost",
    "energy_supplied",
)
OVER_TIME = tuple(
    f"motion_{name}" for name in ("translation", "rotation", "stored", "lost", "supplied", "force")
)
_WITH_ERRORS = NUMBERS[:3]
#: least number of steps in a period of a shaker
_PER_PERIOD = 10
#: most of the area under the table of a drive that may fall between steps
_MOST_LOST = 0.1
#: parts of the greatest distance between which velocities are fitted
_FIT_RANGE = (0.25, 0.75)


def require_waves(
    serving_media: Sequence[ServingMedium], settings: WaveSettings, most: float = np.inf
) -> None:
    """Raise if the waves of the ``settings`` cannot be found in the arrays of a case, at any of its
    loads.

    Each array of up to ``most`` balls is looked at as one of equal balls at the same mean force,
    which takes no simulation: the wave vectors of its cell, the motions of its balls, the path of
    the pulse and the time for which a pulse may be heard. What depends on the load is refused if it
    fails at the least load and at the greatest.
    """
    if settings.spectrum is None and settings.pulse is None:
        return
    arrays = [
        (medium, serving.load)
        for serving in serving_media
        for medium in serving.arrays
        if medium.balls <= most
    ]
    for medium, load in arrays:
        errors = list[GranphonError]()
        forces = find_typical_force(medium.packing, load)
        ends = list(dict.fromkeys((float(np.min(forces)), float(np.max(forces)))))
        for number, force in enumerate(ends):
            ideal = AveragedLattice(medium.packing).at(Load.only(force=force))[0]
            network = ideal.network.repeat(medium.cells)
            if settings.spectrum is not None and not number:
                _require_spectrum(network, medium.packing, settings.spectrum, settings.path)
            try:
                if settings.pulse is not None:
                    source = PulseSource.of(settings.pulse, network, settings.direction)
                    require_sendable(network, source)
            except GranphonError as error:
                errors.append(error)
        if len(errors) == len(ends):
            raise errors[0]


def _require_spectrum(
    network: ContactNetwork, packing: Packing, spectrum: SpectrumSettings, path: Any
) -> None:
    """Raise if a network of equal balls, which stands for the array of a ``packing``, has not the
    wave vectors of a ``path``, the resolution or the polarisations of a spectrum.
    """
    points = find_path_points(
        network, ideal_lattice(packing), packing.diameter, path, spectrum.points
    )
    operator = WaveOperator(network)
    # the bound of frequencies of equal balls is below that of differing balls, or little above: a
    # kernel of equal balls takes no more moments
    Kernel.of(operator.top / (2.0 * math.pi * MARGIN), spectrum.resolution)
    for polarisation in spectrum.polarisation:
        find_polarisations(operator, points.q[0], polarisation, None)


def require_network(
    serving_media: Sequence[ServingMedium],
    settings: NetworkSettings,
    key: str,
    most: float = np.inf,
) -> None:
    """Raise unless the networks of a case, repeated and cut, have what the ``key`` of the settings
    says of them.

    Networks of packings are of equal balls at a typical force, and of arrays up to ``most`` balls;
    crystals that are not quickly loaded are left out.
    """
    settings = replace(settings, cut=()) if key == "repeat" else settings
    for serving in serving_media:
        array = next(iter(serving.arrays), None)
        is_too_large = array is not None and array.balls > most
        state = None if is_too_large else find_typical_state(serving)
        if state is None:
            continue
        n_balls = state.network.n_balls if array is None else array.balls
        if settings.count(n_balls) > most:
            continue
        network = state.network if array is None else state.network.repeat(array.cells)
        if isinstance(settings, MotionSettings) and key == "drive":
            PreparedMotion(state if array is None else network, settings)
            continue
        shaped = settings.shape(network)
        if isinstance(settings, ResponseSettings) and key in ("source", "receiver"):
            is_moved = settings.quantity == "transmissibility" and key == "source"
            places = [find_place(words) for words in getattr(settings, key)]
            require_places(shaped, key, places, is_moved, **_choose_plane(settings))


def find_typical_state(serving: ServingMedium) -> Any:
    """Return a state like the first of a case: of equal balls at a typical force, or a crystal's;
    None for a crystal whose state takes long.
    """
    if serving.packing.kind_names:
        return serving.at(serving.load[0]) if serving.is_quick else None
    force = float(np.ravel(find_typical_force(serving.packing, serving.load))[0])
    return AveragedLattice(serving.packing).at(Load.only(force=force))[0]


def _choose_plane(settings: ResponseSettings) -> dict[str, Any]:
    """Return the settings of the planes of balls that are driven and heard, by their names."""
    return {name: getattr(settings, name) for name in ("direction", "polarisation", "distance")}


def record_waves(sample: Sample, settings: WaveSettings, whole: bool = False) -> dict[str, Array]:
    """Find the waves of the ``settings`` in a sample, and return the numbers that are averaged, in
    SI units by name.

    With ``whole`` the results themselves are kept too, for :class:`SampleWaves`.
    """
    waves = Waves(sample)
    out = dict[str, Array]()
    results = dict[str, Result]()
    if settings.dos:
        # random vectors differ from sample to sample, so that their noise is part of the standard
        # error over samples
        dos = waves.dos(seed=sample.seed or 0)
        out["dos"] = np.array([dos.frequencies, dos.translational, dos.rotational, dos.error])
        results["dos"] = dos
    spectrum = settings.spectrum
    if spectrum is not None:
        packing = sample.packing
        points = find_path_points(
            waves.network,
            ideal_lattice(packing),
            packing.diameter,
            settings.path,
            spectrum.points,
        )
        spectra = {
            polarisation: waves.spectral_function(points.q, polarisation, spectrum.resolution)
            for polarisation in spectrum.polarisation
        }
        lines = [
            (function.peak, function.width, function.resolved) for function in spectra.values()
        ]
        out["path_corners"] = points.corners
        out["path_distance"] = points.distances
        out["lines"] = np.array(lines, float)
        out["wavenumber"] = spectra[spectrum.polarisation[0]].wavenumber
        results |= spectra
    if settings.pulse is not None:
        pulse, numbers = _record_pulse(waves.network, settings.pulse, settings.direction)
        out |= numbers
        if pulse is not None:
            results["pulse"] = pulse
    if whole:
        for name, result in results.items():
            out[_WHOLE + name] = np.array(json.dumps(result.to_dict()).encode())
    return out | record_networks(sample, settings, whole)


def _record_pulse(
    network: ContactNetwork, settings: PulseSettings, direction: Any
) -> tuple[Pulse | None, dict[str, Array]]:
    """Return a pulse through a network, None if none can be sent, and its numbers.

    A number that cannot be known is nan, and the text ``pulse_note`` says why; ``pulse_echo`` holds
    the other warnings of the pulse.
    """
    numbers = dict.fromkeys(_PULSE, math.nan)
    pulse = None
    echo = ""
    try:
        pulse = transmit(network, PulseSource.of(settings, network, direction))
        numbers = {name: getattr(pulse, source) for name, source in _PULSE.items()}
        note = pulse.why_unknown
        echo = " ".join(text for text in pulse.warnings if not note or note not in text)
    except GranphonError as error:
        # what could be known before the simulation has been refused by now
        note = str(error)
    arrays = {name: np.array(value) for name, value in numbers.items()}
    return pulse, arrays | {"pulse_note": np.array(note), "pulse_echo": np.array(echo)}


def record_networks(x: Any, settings: WaveSettings, whole: bool = False) -> dict[str, Array]:
    """Find the waves of the ``settings`` in the network of a state or sample, and return the
    numbers that are averaged, in SI units by name.

    With ``whole`` results that have a file of their own are kept too, as its bytes. An error knows
    its block.
    """
    out = dict[str, Array]()
    for block in settings.of_networks:
        record, _ = RECORDS[block.block]
        try:
            arrays, files = record(x, block)
        except GranphonError as error:
            error.block = (block.block,)
            raise
        out |= arrays
        if whole:
            for name, write in files.items():
                out[_WHOLE + name] = np.frombuffer(write(), np.uint8)
    return out


# -- of one network


def _record_response(x: Any, settings: ResponseSettings) -> tuple[dict[str, Array], dict[str, Any]]:
    """Find the response, (n_f, receivers); the response of a plane is the mean over its balls."""
    places = [find_place(words) for words in settings.receiver]
    response: Response = Waves(settings.shape(given_network(x))).response(
        settings.frequencies,
        [find_place(words) for words in settings.source],
        places,
        settings.damping,
        settings.loss_factor,
        quantity=settings.quantity,
        **_choose_plane(settings),
    )
    n_plane = len(response.receivers) - len(places) + 1
    starts = np.cumsum([0, *(n_plane if place == "plane" else 1 for place in places)])
    groups = [slice(first, end) for first, end in pairwise(starts.tolist())]
    means = [np.mean(response.values[:, group], axis=1) for group in groups]
    record = {
        "response": np.transpose(means),
        "response_note": np.array(" ".join(response.warnings)),
        "response_peaks": _list_peaks(response.peaks_of_means(groups)),
    }
    return record, {}


def _list_peaks(peaks: Sequence[Peaks]) -> Array:
    """Return frequencies, heights and Q of the peaks of each receiver, (3, receivers, n), nan
    beyond the number of its peaks.
    """
    most = max(len(of_receiver.frequencies) for of_receiver in peaks)
    table = np.full((3, len(peaks), most), np.nan)
    for index, of_receiver in enumerate(peaks):
        table[:, index, : len(of_receiver.frequencies)] = of_receiver
    return table


def _average_responses(
    records: Sequence[Record], settings: ResponseSettings
) -> tuple[dict[str, Array], list[str]]:
    """Return the coherent response, the mean of complex amplitudes, its peaks, and the highest peak
    of the first receiver.

    Peaks of one record are solved for between the frequencies; peaks of a mean are of the
    frequencies that there are.
    """
    amplitudes = np.array([record["response"] for record in records])
    name = RESPONSES[settings.quantity]
    mean = np.mean(amplitudes, axis=0)
    out = {name: np.abs(mean), "response_phase": np.unwrap(np.angle(mean), axis=0)}
    is_alone = len(records) == 1
    if is_alone:
        peaks = records[0]["response_peaks"]
    else:
        peaks = _list_peaks(find_peaks(np.array(settings.frequencies), mean))
    texts = [str(record["response_note"]) for record in records]
    notes = list(dict.fromkeys(text for text in texts if text))
    is_peak = np.isfinite(peaks[0])  # (receivers, n)
    is_narrow = is_peak & np.isnan(peaks[1])
    # frequencies, heights and Q, each (receivers, n)
    tables = dict(zip(("frequency", name, "quality"), peaks, strict=True))
    if np.any(is_peak):
        out |= {f"peaks_{word}": table for word, table in tables.items()}
    if np.any(is_narrow):
        n_narrow = int(np.max(np.sum(is_narrow, axis=1)))
        lines = counted(n_narrow, "peak of the response is", "peaks of the response are")
        mend = (
            "give a damping or a loss_factor"
            if is_alone
            else "give frequencies closer to each other"
        )
        notes.append(
            f"{lines} narrower than the step of the frequencies, and the height is not known:"
            f" {mend}"
        )
    if np.any(is_peak[0]) and not np.any(is_narrow[0]):
        highest = np.nanargmax(tables[name][0])
        out |= {f"peak_{word}": np.array(table[0, highest]) for word, table in tables.items()}
    if not is_alone:
        out[f"{name}_error"] = np.asarray(standard_error(amplitudes, axis=0))
    return out, notes


def make_waves(x: Any, network: ContactNetwork, settings: MotionSettings) -> NonlinearWaves:
    """Return the balls of a ``network``, made of the state, sample or network ``x``, with the law
    of its contacts.
    """
    # imported here: other tasks do not need nonlinear waves
    from granphon.waves.nonlinear import NonlinearWaves

    state = x.source if isinstance(x, NetworkState) else x
    law = state.crystal if isinstance(state, CrystalState) else None
    mu = math.inf if settings.friction_coefficient is None else settings.friction_coefficient
    return NonlinearWaves(
        network, law, friction_coefficient=mu, damping=settings.damping, geometry=settings.geometry
    )


class PreparedMotion:
    """The balls of a state, or of a network, that move, and the drives that move them.

    Raises :class:`~granphon.base.errors.InputError` for settings that are known to be wrong before
    anything moves.

    Attributes
    ----------
    waves : the balls and their law.
    drives : :class:`~granphon.Drive`, in turn, without impacts.
    velocities : (n, 3) velocities that impacts give, m/s.
    notes : the warnings of the motion, in sentences.
    """

    def __init__(self, x: Any, settings: MotionSettings) -> None:
        # imported here: other tasks do not need nonlinear waves
        from granphon.waves.nonlinear import Drive

        network = settings.shape(given_network(x))
        self.settings = settings
        self.notes = list[str]()
        self.waves = make_waves(x, network, settings)
        self.drives = list[Drive]()
        self.velocities = np.zeros((network.n_balls, 3))
        for drive in settings.drive:
            balls = index_array("balls of the drive", drive.find_balls(network), network.n_balls)
            direction = np.eye(network.dimension)[0] if drive.direction is None else drive.direction
            vector = read_vector("direction of the drive", direction, network.dimension)
            require_moves("drive", vector, network)
            if drive.impact is None:
                moved: Any = drive.shaker or drive.displacement
                self.drives.append(Drive(balls, vector, displacement=moved, force=drive.force))
            else:
                self.velocities[balls] += drive.impact * vector
        displaced = [drive.balls for drive in self.drives if drive.displacement is not None]
        led_balls = np.concatenate([np.flatnonzero(~network.moving), *displaced])
        if np.any(self.velocities[led_balls]):
            raise InputError(
                "an impact on a body that is held or displaced",
                mend="Give it a shaker or a displacement",
            )
        self._require_step()

    def _require_step(self) -> None:
        """Raise if steps are too long for a shaker, or for the table of a drive."""
        settings = self.settings
        shakers = [drive.shaker for drive in settings.drive if drive.shaker is not None]
        frequency = max((shaker.frequency for shaker in shakers), default=0.0)
        tables = [drive.force or drive.displacement for drive in settings.drive]
        if not shakers and not any(tables):
            return
        impact = float(np.linalg.norm(self.velocities, axis=1).max())
        step = settings.step or self.waves.find_step(impact)
        step = min(step, settings.duration / (settings.frames - 1))
        if step * frequency * _PER_PERIOD > 1.0:
            problem = f"a shaker has the frequency {frequency:.4g} Hz, and steps have {step:.3g} s"
            why = f"A period would have fewer than {_PER_PERIOD} steps"
            raise InputError(problem, why, "Give a shorter step")
        lost_fraction = max(
            (table.lost(step, settings.duration) for table in tables if table), default=0.0
        )
        if lost_fraction > _MOST_LOST:
            problem = (
                f"{100.0 * lost_fraction:.3g} % of the table of a drive are lost between steps of"
                f" {step:.3g} s"
            )
            raise InputError(problem, mend="Give a shorter step")

    def run(self) -> Motion:
        """Let the balls move; :class:`~granphon.base.errors.ConvergenceError` for a motion that
        ends before its time.
        """
        settings = self.settings
        with warnings.catch_warnings(record=True) as caught:
            warnings.simplefilter("always", LimitWarning)
            # the frames of a motion that ends early would not be those of other loads and samples
            warnings.simplefilter("error", StoppedEarlyWarning)
            try:
                motion = self.waves.run(
                    settings.duration,
                    None,
                    self.velocities,
                    self.drives,
                    frames=settings.frames,
                    step=settings.step,
                    scheme=settings.scheme,
                )
            except StoppedEarlyWarning as stopped:
                if stopped.interrupted:
                    raise KeyboardInterrupt from None
                raise ConvergenceError(
                    str(stopped), mend="Give a shorter duration, or a weaker drive"
                ) from None
        self.notes = [str(warning.message) for warning in caught]
        return motion


def find_source(settings: MotionSettings, network: ContactNetwork) -> Index:
    """Return the numbers of all balls of a shaped network that are driven."""
    return np.unique(np.concatenate([drive.find_balls(network) for drive in settings.drive]))


class Passage(NamedTuple):
    """Times at which the wave of a drive comes to each contact, and its velocities.

    Attributes
    ----------
    distances : (n_c,) of contacts from the nearest ball or wall that is driven, or its nearest
        image, m.
    arrivals : (n_c,) times at which the front passes, s, as of :meth:`Motion.passages`; nan where
        the time is not known.
    peaks, heights : (n_c,) times, s, and sizes, N, of the greatest force; a time is nan at the ends
        of the motion.
    front, peak : velocities, m/s, at which the front and the peak of :meth:`Motion.passages` pass
        the contacts between a quarter and three quarters of the greatest distance
        (:func:`fit_velocity`). nan without a straight line, as where dashpots are so strong that
        the force diffuses.
    """

    distances: Array
    arrivals: Array
    peaks: Array
    heights: Array
    front: float
    peak: float

    @classmethod
    def of(cls, motion: Motion, source: Index) -> Self:
        """Find the wave that passes the contacts of a motion from the balls ``source``."""
        network = motion.network
        shifts = [[-1, 0, 1] if periodic else [0] for periodic in network.pbc]
        cells = np.array(list(product(*shifts)))
        images = (network.positions[source] + (cells @ network.cell)[:, None]).reshape(-1, 3)
        distances = np.asarray(cKDTree(images).query(motion.middles)[0])
        for wall in set(source.tolist()) & set(network.walls):
            # a plane, which is nearer than the point by which the wall is given
            point, normal = network.walls[wall]
            distances = np.minimum(distances, np.abs((motion.middles - point) @ normal))
        peaks, heights = motion.peaks()
        frames = np.argmax(motion.forces, axis=0)
        fronts = motion.passages("front")
        passages = motion.passages()
        is_within = (frames > 0) & (frames < len(motion.times) - 1)
        peaks = np.where(np.isfinite(passages) & is_within, peaks, np.nan)
        front = _find_velocity(distances, fronts)
        peak = _find_velocity(distances, passages)
        return cls(distances, fronts, peaks, heights, front, peak)


def _find_velocity(distances: Array, times: Array) -> float:
    """Return the velocity, m/s, of a wave that passes contacts at ``times``, s, fitted between a
    quarter and three quarters of the greatest distance; nan for fewer than three contacts.
    """
    is_fitted = np.isfinite(times)
    greatest = float(np.max(distances, initial=0.0, where=is_fitted))
    low, high = _FIT_RANGE
    is_fitted &= (distances >= low * greatest) & (distances <= high * greatest)
    if np.count_nonzero(is_fitted) < 3:
        return math.nan
    return fit_velocity(distances[is_fitted], times[is_fitted])[0]


def record_motion(
    x: Any, settings: MotionSettings
) -> tuple[dict[str, Array], dict[str, Callable[[], bytes]]]:
    """Let the array of a state, sample or network move; return the arrays that are kept, and by
    name the function that makes the bytes of the file of the motion.
    """
    prepared = PreparedMotion(x, settings)
    motion = prepared.run()
    passage = Passage.of(motion, find_source(settings, motion.network))
    supplied = motion.work + motion.energy[0]
    numbers = {
        "front_velocity": passage.front,
        "peak_velocity": passage.peak,
        "greatest_force": motion.forces.max(),
        "energy_translation": motion.translation[-1],
        "energy_rotation": motion.rotation[-1],
        "energy_stored": motion.stored[-1],
        "energy_lost": motion.lost[-1],
        "energy_supplied": supplied[-1],
    }
    over_time = (
        motion.translation,
        motion.rotation,
        motion.stored,
        motion.lost,
        supplied,
        motion.forces.max(axis=1),
    )
    kept = {name: np.array(float(value)) for name, value in numbers.items()}
    kept["motion"] = np.array(over_time)  # (len(OVER_TIME), n_times)
    kept["motion_note"] = np.array(" ".join(prepared.notes))

    def write() -> bytes:
        stream = io.BytesIO()
        motion.write(stream)
        return stream.getvalue()

    return kept, {"motion": write}


def average_motions(
    records: Sequence[Mapping[str, Array]], _: MotionSettings
) -> tuple[dict[str, Array], list[str]]:
    """Return means over samples of the arrays of :func:`record_motion`, standard errors, and
    notes.
    """
    motions = np.mean([record["motion"] for record in records], axis=0)
    out = dict(zip(OVER_TIME, motions, strict=True))
    texts = [str(record["motion_note"]) for record in records]
    texts = [text for text in texts if text]
    notes = texts[:1]
    if notes and len(records) > 1:
        notes = [f"{len(texts)} of {len(records)} samples, such as one: {texts[0]}"]
    for name in NUMBERS:
        numbers = np.array([float(record[name]) for record in records])
        finite = numbers[np.isfinite(numbers)]
        if finite.size:
            out[name] = np.array(np.mean(finite))
        if finite.size > 1 and name in _WITH_ERRORS:
            out[f"{name}_error"] = np.asarray(standard_error(finite, axis=0))
        if finite.size < numbers.size:
            samples = ""
            if numbers.size > 1:
                samples = f" in {numbers.size - finite.size} of {numbers.size} samples"
            notes.append(
                f"the {name.replace('_', ' ')} is not known{samples}: distances of contacts over"
                " the times at which the wave comes are no straight line that rises; run for"
                " longer, or with more frames"
            )
    return out, notes


def write_contacts(motion: Motion, path: Path, settings: MotionSettings) -> None:
    """Write a table of the contacts: where they are, and when and how strongly they are pressed."""
    passage = Passage.of(motion, find_source(settings, motion.network))
    network = motion.network
    ends = np.concatenate([np.column_stack([network.i, network.j]), motion.met])
    columns: list[tuple[str, str, Any]] = [
        ("ball_i", "", ends[:, 0]),
        ("ball_j", "", ends[:, 1]),
        *((axis, "m", middles) for axis, middles in zip("xyz", motion.middles.T, strict=True)),
        ("distance", "m", passage.distances),
        ("arrival", "s", passage.arrivals),
        ("peak", "s", passage.peaks),
        ("greatest_force", "N", passage.heights),
    ]
    headings = [Heading(name, unit) for name, unit, _ in columns]
    rows = zip(*(values.tolist() for _, _, values in columns), strict=True)
    path.write_text(table_text(headings, rows), encoding="utf-8")


#: for each block about networks, the function that records a network, and the function that
#: averages the records of samples
RECORDS: dict[
    str, tuple[Callable[..., tuple[dict[str, Array], dict[str, Any]]], Callable[..., Any]]
] = {
    "response": (_record_response, _average_responses),
    "motion": (record_motion, average_motions),
}


@dataclass(frozen=True)
class SampleWaves:
    """Waves in the samples of a single state; a result that was not requested is None.

    Attributes
    ----------
    dos : density of states of the first sample.
    spectra : spectral functions of the first sample along the path.
    pulse : mean of the pulses through all samples that carry one.
    motion : that of the first sample, or of the state if it has none.
    """

    dos: SpectralDensity | None = None
    spectra: PathSpectra | None = None
    pulse: Pulse | None = None
    motion: Motion | None = None

    @classmethod
    def of(
        cls, settings: WaveSettings | None, state: ContactState, records: Sequence[Record]
    ) -> Self:
        """Take the waves from the records of :func:`record_waves` of the samples of a state."""

        def read(record: Record, name: str, kind: type[Result]) -> Any:
            text = record.get(_WHOLE + name)
            return None if text is None else kind.from_dict(json.loads(text.item()))

        first = records[0]
        spectra = None
        if settings is not None and settings.spectrum is not None:
            polarisations = settings.spectrum.polarisation
            spectra = PathSpectra.of(
                [read(first, name, SpectralFunction) for name in polarisations],
                first["path_corners"],
                first["path_distance"],
                state.contact_lattice(),
                state.scales,
                list(map(np.array, settings.path)),
                settings.labels,
            )
        pulses = [read(record, "pulse", Pulse) for record in records]
        pulses = [pulse for pulse in pulses if pulse is not None]
        motion = None
        if f"{_WHOLE}motion" in first:
            motion = Motion.read(io.BytesIO(first[f"{_WHOLE}motion"].tobytes()))
        dos = read(first, "dos", SpectralDensity)
        return cls(dos, spectra, average_pulses(pulses) if pulses else None, motion)

    @property
    def results(self) -> dict[str, Any]:
        """Results that exist, by the names of their files; each has :attr:`units`."""
        results = {
            "sample_dos": self.dos,
            "spectrum": self.spectra,
            "pulse": self.pulse,
            "motion": self.motion,
        }
        return {name: result for name, result in results.items() if result is not None}


def read_waves(path: Path) -> Any:
    """Read the result in a file ``sample_dos.json``, ``spectrum.json``, ``pulse.json``,
    ``surface.json``, ``motion.nc``.
    """
    if path.suffix == ".nc":
        return Motion.read(path)
    kinds: dict[str, type[Result]] = {
        "sample_dos": SpectralDensity,
        "spectrum": PathSpectra,
        "pulse": Pulse,
        "surface": SurfaceSpectrum,
    }
    try:
        data = json.loads(path.read_text(encoding="utf-8"))
    except (ValueError, RecursionError):
        raise InputError(f"{path} is not JSON", mend="Run the scene again") from None
    try:
        return kinds[path.stem].from_dict(data)
    except InputError as error:
        raise InputError(f"{path}: {error}") from None


def average_waves(
    records: Sequence[Record], settings: WaveSettings
) -> tuple[dict[str, Array], list[str]]:
    """Return the observables of waves of the samples at one load, by name, and notes on them.

    Standard errors are those over samples; a density of states of one sample has that of the random
    vectors.
    """
    out = dict[str, Array]()
    notes = list[str]()
    if settings.dos:
        out |= _average_densities([record["dos"] for record in records])
    if settings.spectrum is not None:
        spectra, notes_on_spectra = _average_spectra(records, settings.spectrum)
        out |= spectra
        notes += notes_on_spectra
    if settings.pulse is not None:
        pulses, notes_on_pulses = _average_pulse_numbers(records)
        out |= pulses
        notes += notes_on_pulses
    for block in settings.of_networks:
        _, average = RECORDS[block.block]
        means, notes_on_block = average(records, block)
        out |= means
        notes += notes_on_block
    return out, notes


def _interpolate_densities(table: Array, points: Array) -> Array:
    """Return the rows of a ``table`` below that of its frequencies, at the frequencies ``points``
    (n_f,), Hz; zero above the last frequency of the table.
    """
    from scipy.interpolate import CubicSpline

    if np.array_equal(table[0], points):
        return table[1:]
    spline = CubicSpline(table[0], table[1:], axis=1)
    return np.where(points <= table[0, -1], np.maximum(spline(points), 0.0), 0.0)


def _average_densities(tables: Sequence[Array]) -> dict[str, Array]:
    """Return the mean of densities of states: each of the ``tables`` has, of one sample, rows of
    frequencies, translational and rotational density and their error.
    """
    # at the points of the sample whose frequencies reach highest, where the densities of the other
    # samples are interpolated
    points = max((table[0] for table in tables), key=lambda frequencies: float(frequencies[-1]))
    densities = [_interpolate_densities(table, points) for table in tables]
    translational, rotational, error = np.mean(densities, axis=0)
    if len(tables) > 1:
        totals = [rows[0] + rows[1] for rows in densities]
        error = standard_error(np.array(totals), axis=0)
    return {
        "dos_frequency": points,
        "dos_total": translational + rotational,
        "dos_translational": translational,
        "dos_rotational": rotational,
        "dos_error": error,
    }


def _average_spectra(
    records: Sequence[Record], settings: SpectrumSettings
) -> tuple[dict[str, Array], list[str]]:
    """Return the means of the lines of plane waves, and notes: peaks and widths are averaged, and
    the other observables are those of the mean lines.
    """
    notes = list[str]()
    out = {name: records[0][name] for name in ("path_corners", "path_distance", "wavenumber")}
    # samples, polarisations, (peak, width, resolved), wave vectors
    lines = np.array([record["lines"] for record in records])
    q = out["wavenumber"]
    peak, width, resolved = np.moveaxis(np.mean(lines, axis=0), 1, 0)
    velocity = 2.0 * np.pi * peak / q
    out |= {
        "line_frequency": peak,
        "line_width": width,
        "line_resolved": resolved,
        "phase_velocity": velocity,
        "attenuation": find_attenuation(velocity, width),
        "mean_free_path": find_mean_free_path(velocity, width),
    }
    has_errors = len(records) > 1
    if has_errors:
        peaks = lines[:, :, 0]
        widths = lines[:, :, 1]
        attenuations = find_attenuation(2.0 * np.pi * peaks / q, widths)
        out["line_frequency_error"] = standard_error(peaks, axis=0)
        out["line_width_error"] = standard_error(widths, axis=0)
        out["phase_velocity_error"] = 2.0 * np.pi * out["line_frequency_error"] / q
        out["attenuation_error"] = standard_error(attenuations, axis=0)
    for number, name in enumerate(settings.polarisation):
        why = "their mean free path is longer than 1/|q| all along the path"
        crossing = None
        try:
            crossing = find_ioffe_regel(q, peak[number], width[number])
        except InputError as error:
            why = str(error)
        if crossing is None:
            notes.append(f"no Ioffe-Regel frequency of {name} waves: {why}")
            continue
        out[f"ioffe_regel_{name}"] = np.array(crossing)
        if has_errors:
            out[f"ioffe_regel_{name}_error"] = np.array(_jackknife(q, lines[:, number]))
    return out, notes


def _average_pulse_numbers(records: Sequence[Record]) -> tuple[dict[str, Array], list[str]]:
    """Return the means of the numbers of pulses that could be read, and notes, which say in how
    many samples they could not, and why.
    """
    out = dict[str, Array]()
    for name in _PULSE:
        numbers = np.array([float(record[name]) for record in records])
        finite = numbers[np.isfinite(numbers)]
        if finite.size:
            out[name] = np.array(np.mean(finite))
        if name == "pulse_velocity" and finite.size > 1:
            out["pulse_velocity_error"] = np.asarray(standard_error(finite, axis=0))
    echoes = [str(record["pulse_echo"]) for record in records]
    notes = [echo for echo in dict.fromkeys(echoes) if echo]
    reasons = [str(record["pulse_note"]) for record in records]
    reasons = [reason for reason in reasons if reason]
    if reasons:
        samples = f" in {len(reasons)} of {len(records)} samples" if len(records) > 1 else ""
        mean = ", and the mean is that of the others" if len(reasons) < len(records) else ""
        notes.append(f"the arrival of the pulse is not known{samples}{mean}: {reasons[0]}")
    return out, notes


def _jackknife(q: Array, lines: Array) -> float:
    """Return the standard error of the Ioffe-Regel frequency, Hz, as the lines (samples, 3, n) are
    left out one by one; nan where the other lines have no such frequency.
    """
    frequencies = []
    for sample in range(len(lines)):
        peak, width, _ = np.mean(np.delete(lines, sample, axis=0), axis=0)
        with suppress(InputError):
            frequencies.append(find_ioffe_regel(q, peak, width))
    if len(frequencies) < len(lines) or None in frequencies:
        return math.nan
    return math.sqrt(len(lines) - 1) * float(np.std(np.array(frequencies, float)))
