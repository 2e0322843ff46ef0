"""The numbers that a run keeps of the waves in each sample or network, and their means over samples
with standard errors.

:func:`require_waves`, :func:`require_network` and :func:`require_friction` refuse what can be known
to be impossible before anything is simulated.

The record of a sample holds arrays by name, which :func:`record_waves` finds. From the records of
all samples at one load :func:`average_waves` finds the observables that the catalogue lists under
the costs "dos", "spectrum", "pulse" and "network". An observable that cannot be found in a state is
left out, and a note says why. A state without samples has one record, that of its network.

A block of a scene about the network of a state, such as ``response``, has settings, and a row of
:data:`RECORDS` with two functions. The first records: it takes a state, sample or network and the
settings, and returns arrays by name and functions by name. There is a function for each result that
a single state has in a file of its own; the function makes the bytes of the file. The second
averages: it takes the records at one load and the settings, and returns observables of the
catalogue by name, and notes.
"""

from __future__ import annotations

import io
import json
import math
import warnings
from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from itertools import pairwise, product
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple, Self

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from granphon.array.sample import Sample
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
from granphon.base.standard_errors import jackknife, standard_error
from granphon.base.tables import Heading, table_text
from granphon.base.text import counted
from granphon.base.validation import index_array
from granphon.media.choice import ServingMedium
from granphon.media.cost import estimate_contact_force
from granphon.media.crystal import CrystalState
from granphon.media.medium import AveragedLattice
from granphon.media.state import ContactState, NetworkState, ideal_lattice
from granphon.networks.network import ContactNetwork, given_network
from granphon.waves.chebyshev import Kernel
from granphon.waves.modes import require_motions
from granphon.waves.motion import Motion, fit_velocity
from granphon.waves.operator import WaveOperator
from granphon.waves.path_spectra import PathSpectra, find_packing_points, find_path_points
from granphon.waves.peaks import Peaks, find_peaks
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
from granphon.waves.response import Response, require_places
from granphon.waves.settings import (
    KEYS_OF_PLANES,
    RESPONSES,
    ModesSettings,
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
#: prefix of the names of the results of solvers in a record
_RESULT_PREFIX = "whole."
#: observables that are means over the pulses of samples, each with the attribute of a pulse that is
#: averaged
_PULSE = {
    "pulse_velocity": "velocity",
    "time_of_flight": "time_of_flight",
    "coherent_fraction": "coherent_fraction",
}
#: names in the catalogue of the numbers of a motion
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
#: names in the catalogue of the numbers of a motion at each time
OVER_TIME = tuple(
    f"motion_{name}"
    for name in ("kinetic", "translation", "rotation", "stored", "lost", "supplied", "force")
)
#: the numbers of a motion that have standard errors over samples
_NUMBERS_WITH_ERRORS = NUMBERS[:3]
#: least number of steps in a period of a shaker
_LEAST_STEPS_OF_PERIOD = 10
#: greatest part of the area under the table of a drive that may fall between steps
_MOST_LOST_SHARE = 0.1
#: least and greatest distance of the contacts to which a velocity is fitted, over the distance of
#: the farthest contact
_FIT_RANGE = (0.25, 0.75)


def require_waves(
    serving_media: Sequence[ServingMedium], settings: WaveSettings, most: float = np.inf
) -> None:
    """Raise GranphonError if the spectra or the pulse of the ``settings`` cannot be found in the
    arrays of a case, whose media are ``serving_media``, at any of its loads, or if a packing in
    files lacks the path of the spectra or their polarisations.

    An array of equal balls at the same mean force stands for each array of up to ``most`` balls, so
    that nothing is simulated. Its wave vectors, the motions of its balls, the path of the pulse and
    the time for which a pulse may be heard are looked at. A pulse, which depends on the load, is
    refused if it fails at the least load and at the greatest.
    """
    if settings.spectrum is None and settings.pulse is None:
        return
    if settings.spectrum is not None:
        _require_packing_spectra(serving_media, settings.spectrum, settings.path)
    arrays = [
        (medium, serving.load)
        for serving in serving_media
        for medium in serving.arrays
        if medium.balls <= most
    ]
    for medium, load in arrays:
        forces = estimate_contact_force(medium.packing, load)  # N, at each load
        extreme_forces = dict.fromkeys((float(np.min(forces)), float(np.max(forces))))
        networks = list[ContactNetwork]()
        for force in extreme_forces:
            ideal = AveragedLattice(medium.packing).at(Load.only(force=force))[0]
            networks.append(ideal.network.repeat(medium.cells))
        if settings.spectrum is not None:
            # wave vectors and polarisations are the same at all loads
            _require_spectrum(networks[0], medium.packing, settings.spectrum, settings.path)
        if settings.pulse is not None:
            _require_pulse(networks, settings.pulse, settings.direction)


def _require_packing_spectra(
    serving_media: Sequence[ServingMedium], spectrum: SpectrumSettings, path: Any
) -> None:
    """Raise GranphonError if a packing in files lacks a wave vector of the ``path`` or a
    polarisation of the ``spectrum``; others of the ``serving_media`` are not looked at.
    """
    for serving in serving_media:
        state = None if serving.arrays else find_typical_state(serving)
        if isinstance(state, NetworkState):  # a packing in files
            points = find_packing_points(state.network, path, spectrum.points)
            operator = WaveOperator(state.network)
            for polarisation in spectrum.polarisation:  # for the errors alone
                find_polarisations(operator, points.q[0], polarisation, None)


def _require_pulse(
    networks: Sequence[ContactNetwork], settings: PulseSettings, direction: Any
) -> None:
    """Raise GranphonError if the pulse of the ``settings`` along the ``direction`` can be sent
    through none of the ``networks``, which are those of one array at several loads; the error is
    that of the first.
    """
    errors = list[GranphonError]()
    for network in networks:
        try:
            require_sendable(network, PulseSource.of(settings, network, direction))
        except GranphonError as error:
            errors.append(error)
    if len(errors) == len(networks):
        raise errors[0]


def _require_spectrum(
    network: ContactNetwork, packing: Packing, spectrum: SpectrumSettings, path: Any
) -> None:
    """Raise GranphonError if the array of a ``packing``, for which a network of equal balls stands,
    lacks the wave vectors of a ``path`` or the polarisations of a ``spectrum``; also if the
    resolution of the spectrum takes too many moments.
    """
    points = find_path_points(
        network, ideal_lattice(packing), packing.diameter, path, spectrum.points
    )
    operator = WaveOperator(network)
    # The bound of frequencies of equal balls is below that of differing balls, or little above, so
    # that a kernel of equal balls takes no more moments.
    top_frequency = operator.top / (2.0 * math.pi * MARGIN)  # Hz
    # both for their errors alone
    Kernel.of(top_frequency, spectrum.resolution)
    for polarisation in spectrum.polarisation:
        find_polarisations(operator, points.q[0], polarisation, None)


def require_friction(
    cases: Sequence[Sequence[ServingMedium]], settings: MotionSettings, most: float = np.inf
) -> None:
    """Raise InputError if the ``settings`` have a coefficient of friction, and no contact of any of
    the ``cases``, each of which has its media, resists slip.

    Some of the cases may have no friction, as where a sweep compares balls with and without. As
    :func:`require_network` does, this one looks at no network of more than ``most`` balls, and at
    no crystal whose states take long; there the friction of the balls counts.
    """
    # imported here: other settings do not need nonlinear waves
    from granphon.waves.nonlinear import require_slip

    has_slip = any(_has_slip(serving, settings, most) for media in cases for serving in media)
    require_slip(_find_friction_coefficient(settings), has_slip=has_slip)


def _has_slip(serving: ServingMedium, settings: MotionSettings, most: float) -> bool:
    """Whether a contact of the networks of a medium, ``serving``, resists slip, as
    :func:`require_friction`, whose other arguments these are, finds it.
    """
    from granphon.waves.nonlinear import resists_slip

    sample = _find_typical_sample(serving, settings, most)
    if sample is not None:
        return resists_slip(settings.shape(given_network(sample)))
    return serving.packing.is_network or bool(serving.packing.friction)


def require_network(
    serving_media: Sequence[ServingMedium],
    settings: NetworkSettings,
    key: str,
    most: float = np.inf,
) -> None:
    """Raise GranphonError unless the networks of a case, whose media are ``serving_media``, have,
    repeated and cut, what one ``key`` of the ``settings`` names, such as the balls of "source" or
    the modes of "count".

    Networks of equal balls stand for those of packings, and the first load for all of them
    (:func:`find_typical_state`). Networks of more than ``most`` balls are not looked at, nor are
    crystals whose states take long.
    """
    # the key "repeat" is judged without the cut, whose errors belong to the key "cut"
    settings = replace(settings, cut=()) if key == "repeat" else settings
    for serving in serving_media:
        sample = _find_typical_sample(serving, settings, most)
        if sample is None:
            continue
        if isinstance(settings, MotionSettings) and key == "drive":
            # prepared for its errors alone; a state, unlike its network, knows the law of a crystal
            PreparedMotion(sample, settings)
            continue
        shaped_network = settings.shape(given_network(sample))
        if isinstance(settings, ModesSettings) and key == "count":
            motions = shaped_network.ball_motions.count
            require_motions(settings.count, motions * int(np.sum(shaped_network.moving)))
        if isinstance(settings, ResponseSettings) and key in ("source", "receiver"):
            places = [find_place(words) for words in getattr(settings, key)]
            options = _choose_plane(settings)
            require_places(shaped_network, key, places, settings.quantity, **options)


def _find_typical_sample(serving: ServingMedium, settings: NetworkSettings, most: float) -> Any:
    """Return what stands for the samples of a medium, ``serving``: of one that simulates arrays the
    network of an array of equal balls, of others the state of :func:`find_typical_state`.

    None for a crystal whose state takes long, and if the balls are more than ``most``, also after
    they are repeated and cut as the ``settings`` say.
    """
    array = next(iter(serving.arrays), None)
    if array is not None and array.balls > most:
        return None
    state = find_typical_state(serving)
    if state is None:
        return None
    n_balls = state.network.n_balls if array is None else array.balls
    if settings.count_balls(n_balls) > most:
        return None
    return state if array is None else state.network.repeat(array.cells)


def find_typical_state(serving: ServingMedium) -> Any:
    """Return a state that stands for all states of a medium, ``serving``: that at the first load.

    For a packing it is the state of equal balls at the mean contact force that is expected there
    (:func:`~granphon.media.cost.estimate_contact_force`), for a crystal its own state, and for a
    packing in files the only state. None for a crystal whose states take long to find.
    """
    if serving.packing.kind_names:  # a crystal, or a packing in files
        is_at_hand = serving.is_quick or serving.packing.is_network
        return serving.at(serving.load[0]) if is_at_hand else None
    force = float(np.ravel(estimate_contact_force(serving.packing, serving.load))[0])
    return AveragedLattice(serving.packing).at(Load.only(force=force))[0]


def _choose_plane(settings: ResponseSettings) -> dict[str, Any]:
    """Return the ``settings`` of planes of balls as source or receiver, by name: direction,
    polarisation and distance.
    """
    return {name: getattr(settings, name) for name in KEYS_OF_PLANES}


def record_waves(x: Any, settings: WaveSettings, whole: bool = False) -> dict[str, Array]:
    """Find the waves of the ``settings`` in ``x``, a sample or a state, and return the numbers that
    :func:`average_waves` averages, arrays in SI units by name.

    With ``whole`` the results of the solvers are among the arrays too, as JSON or as the bytes of
    a file, for :func:`restore_result` and :func:`restore_motion`.
    """
    numbers = dict[str, Array]()
    for name in settings.names:
        record, _average = SAMPLE_RECORDS[name]
        arrays, results = record(Waves(x), x, settings)
        numbers |= arrays
        if whole:
            for key, result in results.items():
                numbers[_RESULT_PREFIX + key] = np.array(json.dumps(result.to_dict()).encode())
    return numbers | _record_networks(x, settings, whole=whole)


def _record_dos(
    waves: Waves, sample: Sample, _settings: WaveSettings
) -> tuple[dict[str, Array], dict[str, Result]]:
    """Return the table ``dos`` (4, n) of the density of states of a ``sample`` with these
    ``waves``, and the result from which it is made, both by name. The rows of the table are
    frequencies, Hz, translational density, 1/Hz, rotational density, 1/Hz, and error of their sum,
    1/Hz.
    """
    # Random vectors differ from sample to sample, so that their noise is part of the standard error
    # over samples. A state has no seed, and a sample of given diameters has None.
    dos = waves.dos(seed=getattr(sample, "seed", 0) or 0)
    table = np.array([dos.frequencies, dos.translational, dos.rotational, dos.error])
    return {"dos": table}, {"dos": dos}


def _record_spectra(
    waves: Waves, sample: Sample | NetworkState, settings: WaveSettings
) -> tuple[dict[str, Array], dict[str, SpectralFunction]]:
    """Return the numbers of the spectral functions of a ``sample``, or of the state of a packing in
    files, along the path of the ``settings``, by name, and the functions by polarisation.

    ``lines`` (polarisations, 3, n) holds the peak, Hz, the width, Hz, and whether the line is
    resolved, at n wave vectors; ``wavenumber`` (n,), ``path_distance`` (n,) and ``path_corners``
    (m,), of m corners, are in 1/m.
    """
    spectrum = settings.spectrum
    assert spectrum is not None
    if isinstance(sample, NetworkState):
        points = find_packing_points(sample.network, settings.path, spectrum.points)
    else:
        lattice = ideal_lattice(sample.packing)
        spacing = sample.packing.diameter
        points = find_path_points(waves.network, lattice, spacing, settings.path, spectrum.points)
    spectra = {
        polarisation: waves.spectral_function(points.q, polarisation, spectrum.resolution)
        for polarisation in spectrum.polarisation
    }
    lines = [(function.peak, function.width, function.resolved) for function in spectra.values()]
    numbers = {
        "path_corners": points.corners,
        "path_distance": points.distances,
        "lines": np.array(lines, float),
        "wavenumber": spectra[spectrum.polarisation[0]].wavenumber,
    }
    return numbers, spectra


def _record_pulse(
    waves: Waves, _sample: Sample, settings: WaveSettings
) -> tuple[dict[str, Array], dict[str, Pulse]]:
    """Return the numbers ``pulse_velocity``, m/s, ``time_of_flight``, s, and ``coherent_fraction``
    of the pulse of the ``settings`` through a sample with these ``waves``, and the pulse, if one
    can be sent; both by name.

    Where the arrival of the pulse is not known, the first two are nan, and where no pulse can be
    sent all three; the text ``pulse_note`` says why, and is empty otherwise. The text
    ``pulse_echo`` holds all other warnings of the pulse, of which those of echoes are some.
    """
    numbers = dict.fromkeys(_PULSE, math.nan)
    pulses: dict[str, Pulse] = {}
    echo = ""
    assert settings.pulse is not None
    try:
        source = PulseSource.of(settings.pulse, waves.network, settings.direction)
        pulse = transmit(waves.network, source)
        pulses["pulse"] = pulse
        numbers = {name: getattr(pulse, attribute) for name, attribute in _PULSE.items()}
        note = pulse.why_unknown
        echo = " ".join(text for text in pulse.warnings if not note or note not in text)
    except GranphonError as error:
        # what could be known before the simulation has been refused by now
        note = str(error)
    arrays = {name: np.array(value) for name, value in numbers.items()}
    notes = {"pulse_note": np.array(note), "pulse_echo": np.array(echo)}
    return arrays | notes, pulses


def _record_networks(x: Any, settings: WaveSettings, *, whole: bool = False) -> dict[str, Array]:
    """Find the waves of the ``settings`` in the network of ``x``, a state or a sample, and return
    the numbers that :func:`average_waves` averages, arrays in SI units by name.

    With ``whole`` results that have a file of their own are among the arrays too, as the bytes of
    the file. A GranphonError has the name of its block of settings as ``block``.
    """
    numbers = dict[str, Array]()
    for block in settings.of_networks:
        record, _average = RECORDS[block.block]
        try:
            arrays, files = record(x, block)
        except GranphonError as error:
            error.block = (block.block,)
            raise
        numbers |= arrays
        if whole:
            for name, make_bytes in files.items():
                numbers[_RESULT_PREFIX + name] = np.frombuffer(make_bytes(), np.uint8)
    return numbers


# -- of one network


def _record_response(x: Any, settings: ResponseSettings) -> tuple[dict[str, Array], dict[str, Any]]:
    """Return the numbers of the response that the ``settings`` ask for, of the network of ``x``, a
    state, sample or network, by name, and no files.

    ``response`` (n_f, receivers) holds complex amplitudes at n_f frequencies; the amplitude of a
    plane is the mean over its balls. ``response_quantity`` is the name of the quantity, which
    depends on whether the motion of the source is given. ``response_peaks`` is the table of
    :func:`_list_peaks`, and ``response_note`` a text of the warnings.
    """
    sources = [find_place(words) for words in settings.source]
    receivers = [find_place(words) for words in settings.receiver]
    response: Response = Waves(settings.shape(given_network(x))).response(
        settings.frequencies,
        sources,
        receivers,
        quantity=settings.quantity,
        **settings.losses,
        **_choose_plane(settings),
    )
    # a receiver has one column of the response, but a plane, of which there is one at most, has one
    # for each of its balls
    n_plane = len(response.receivers) - len(receivers) + 1
    counts = [n_plane if receiver == "plane" else 1 for receiver in receivers]
    starts = np.cumsum([0, *counts])
    groups = [slice(start, end) for start, end in pairwise(starts.tolist())]
    means = [np.mean(response.values[:, group], axis=1) for group in groups]
    record = {
        "response": np.transpose(means),
        "response_quantity": np.array(response.quantity),
        "response_note": np.array(" ".join(response.warnings)),
        "response_peaks": _list_peaks(response.peaks_of_means(groups)),
    }
    return record, {}


def _list_peaks(peaks: Sequence[Peaks]) -> Array:
    """Return the table (3, receivers, n) of the frequencies, Hz, heights and Q of the ``peaks`` of
    each receiver, where n is the greatest number of peaks of a receiver; the entries of a receiver
    with fewer peaks are nan after these.
    """
    n_peaks = max(len(of_receiver.frequencies) for of_receiver in peaks)
    table = np.full((3, len(peaks), n_peaks), np.nan)
    for index, of_receiver in enumerate(peaks):
        table[:, index, : len(of_receiver.frequencies)] = of_receiver
    return table


def _average_responses(
    records: Sequence[Record], settings: ResponseSettings
) -> tuple[dict[str, Array], list[str]]:
    """Return the observables of the coherent response by name, and notes. The coherent response is
    the mean of the complex amplitudes over the samples of the ``records``.

    The observables are the absolute value and the phase, rad, of the response, both (n_f,
    receivers), the phase without jumps of a whole turn along the frequencies, and for several
    samples the standard error of the response. If there are peaks, the observables are also the
    frequency, the height and Q of the peaks of each receiver, (receivers, n); and, if the heights
    of all peaks of the first receiver are known, the same of the highest of these. The peaks of a
    single record were solved for between the frequencies of the settings; peaks of a mean are
    sought among these frequencies.

    The notes are the warnings of the records, and one that counts the peaks that are narrower than
    the step of the frequencies, whose heights are not known.
    """
    amplitudes = np.array([record["response"] for record in records])
    name = RESPONSES[str(records[0]["response_quantity"])]
    mean = np.mean(amplitudes, axis=0)
    observables = {name: np.abs(mean), "response_phase": np.unwrap(np.angle(mean), axis=0)}
    is_single = len(records) == 1
    if is_single:
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
        observables |= {f"peaks_{word}": table for word, table in tables.items()}
    if np.any(is_narrow):
        notes.append(_note_narrow_peaks(is_narrow, is_single=is_single))
    if np.any(is_peak[0]) and not np.any(is_narrow[0]):
        highest = np.nanargmax(tables[name][0])
        for word, table in tables.items():
            observables[f"peak_{word}"] = np.array(table[0, highest])
    if not is_single:
        observables[f"{name}_error"] = np.asarray(standard_error(amplitudes, axis=0))
    return observables, notes


def _note_narrow_peaks(is_narrow: Array, *, is_single: bool) -> str:
    """Return a note on peaks of a response that are narrower than the step of the frequencies.

    ``is_narrow`` (receivers, n) marks these peaks; the note counts those of the receiver that has
    most. The peaks of a single network, ``is_single``, were solved for, so that closer frequencies
    would not help.
    """
    n_narrow = int(np.max(np.sum(is_narrow, axis=1)))
    lines = counted(n_narrow, "peak of the response is", "peaks of the response are")
    mend = (
        "give a loss, such as a damping" if is_single else "give frequencies closer to each other"
    )
    return f"{lines} narrower than the step of the frequencies, and the height is not known: {mend}"


def _find_friction_coefficient(settings: MotionSettings) -> float:
    """Return the coefficient of friction of the ``settings``, infinite where none is given."""
    mu = settings.friction_coefficient
    return math.inf if mu is None else mu


def make_waves(x: Any, network: ContactNetwork, settings: MotionSettings) -> NonlinearWaves:
    """Return the nonlinear waves in a ``network``, which was made of the state, sample or network
    ``x``. The contacts of a crystal keep their law, and other contacts have Hertz's. Without a
    coefficient of friction in the ``settings`` contacts do not slide.

    Where no contact resists slip, as in those states of a sweep that have no friction, Coulomb's
    limit in the ``settings`` has no use.
    """
    # imported here: other tasks do not need nonlinear waves
    from granphon.waves.nonlinear import NonlinearWaves, resists_slip

    state = x.source if isinstance(x, NetworkState) else x
    law = state.crystal if isinstance(state, CrystalState) else None
    limit_of_slip = dict[str, Any]()
    if resists_slip(network):
        limit_of_slip["friction_coefficient"] = _find_friction_coefficient(settings)
        limit_of_slip["coulomb"] = settings.coulomb
    return NonlinearWaves(
        network,
        law,
        geometry=settings.geometry,
        viscous_pull=settings.viscous_pull,
        **limit_of_slip,
        **settings.losses,
    )


class PreparedMotion:
    """A motion that is ready to run: the balls of a state, sample or network, and the drives that
    move them.

    Raises :class:`~granphon.base.errors.InputError` for drives that
    :meth:`granphon.NonlinearWaves.run` refuses, for an impact on a body that is held or displaced,
    and for steps too long for a drive.

    Attributes
    ----------
    waves : the balls and their law.
    drives : :class:`~granphon.Drive`, in turn, without impacts.
    velocities : (n, 3) velocities that impacts give, m/s.
    notes : the warnings of the motion, in sentences; empty until :meth:`run` has returned.
    """

    def __init__(self, x: Any, settings: MotionSettings) -> None:
        """Prepare the motion of the network of ``x``, repeated and cut as the ``settings`` say."""
        # imported here: other tasks do not need nonlinear waves
        from granphon.waves.nonlinear import Drive, require_drives

        network = settings.shape(given_network(x))
        self.settings = settings
        self.notes = list[str]()
        self.waves = make_waves(x, network, settings)
        self.drives = list[Drive]()
        self.velocities = np.zeros((network.n_balls, 3))
        for drive in settings.drive:
            balls = index_array("balls of the drive", drive.find_balls(network), network.n_balls)
            components = drive.direction
            if components is None:
                components = np.eye(network.dimension)[0]  # x
            direction = read_vector("direction of the drive", components, network.dimension)
            require_moves("drive", direction, network)
            if drive.impact is None:
                displacement: Any = drive.shaker or drive.displacement
                self.drives.append(
                    Drive(balls, direction, displacement=displacement, force=drive.force)
                )
            else:
                self.velocities[balls] += drive.impact * direction
        self._require_free(network)
        require_drives(self.waves, self.drives)
        self._require_step()

    def _require_free(self, network: ContactNetwork) -> None:
        """Raise InputError for an impact on a body of the ``network`` that is held, or whose
        displacement is given.
        """
        displaced_balls = [drive.balls for drive in self.drives if drive.displacement is not None]
        held_balls = np.flatnonzero(~network.moving)
        led_balls = np.concatenate([held_balls, *displaced_balls])
        if np.any(self.velocities[led_balls]):
            problem = "an impact on a body that is held or displaced"
            raise InputError(problem, mend="Give it a shaker or a displacement")

    def _require_step(self) -> None:
        """Raise InputError if a period of a shaker has fewer than :data:`_LEAST_STEPS_OF_PERIOD`
        steps, or if more than :data:`_MOST_LOST_SHARE` of the area under the table of a drive falls
        between steps.
        """
        settings = self.settings
        shakers = [drive.shaker for drive in settings.drive if drive.shaker is not None]
        frequency = max((shaker.frequency for shaker in shakers), default=0.0)
        tables = [drive.force or drive.displacement for drive in settings.drive]
        if not shakers and not any(tables):
            return
        step = settings.step or self.waves.find_step(**settings.extremes)
        step = min(step, settings.duration / (settings.frames - 1))
        if step * frequency * _LEAST_STEPS_OF_PERIOD > 1.0:
            problem = f"a shaker has the frequency {frequency:.4g} Hz, and steps have {step:.3g} s"
            why = f"A period would have fewer than {_LEAST_STEPS_OF_PERIOD} steps"
            raise InputError(problem, why, "Give a shorter step")
        lost_fractions = [
            table.find_lost_share(step, settings.duration) for table in tables if table
        ]
        lost_fraction = max(lost_fractions, default=0.0)
        if lost_fraction > _MOST_LOST_SHARE:
            problem = (
                f"{100.0 * lost_fraction:.3g} % of the table of a drive are lost between steps of"
                f" {step:.3g} s"
            )
            raise InputError(problem, mend="Give a shorter step")

    def run(self) -> Motion:
        """Let the balls move for the duration of the settings, and return the motion; the warnings
        that are given meanwhile become the :attr:`notes`.

        Raises :class:`~granphon.base.errors.ConvergenceError` if the motion ends before its time,
        and KeyboardInterrupt if Ctrl-C stops it.
        """
        settings = self.settings
        with warnings.catch_warnings(record=True) as caught_warnings:
            warnings.simplefilter("always", LimitWarning)
            # the frames of a motion that ends early would not be those of other loads and samples
            warnings.simplefilter("error", StoppedEarlyWarning)
            try:
                motion = self.waves.run(
                    settings.duration,
                    velocities=self.velocities,
                    drive=self.drives,
                    frames=settings.frames,
                    step=settings.step,
                    scheme=settings.scheme,
                )
            except StoppedEarlyWarning as warning:
                if warning.interrupted:
                    raise KeyboardInterrupt from None
                mend = "Give a shorter duration, or a weaker drive"
                raise ConvergenceError(str(warning), mend=mend) from None
        self.notes = [str(warning.message) for warning in caught_warnings]
        return motion


def find_source(settings: MotionSettings, network: ContactNetwork) -> Index:
    """Return the indices, ascending and each once, of the balls and walls that the drives of the
    ``settings`` move; ``network`` is repeated and cut as the settings say.
    """
    return np.unique(np.concatenate([drive.find_balls(network) for drive in settings.drive]))


class Passage(NamedTuple):
    """Times at which the wave of a drive comes to each contact of a motion, and its velocities.

    The n contacts are those of the network, and then those that came about as balls met.

    Attributes
    ----------
    distances : (n,) distances of the contacts from the nearest ball or wall that is driven, or from
        its nearest image, m.
    arrivals : (n,) times, s, at which the front passes (:meth:`Motion.passages`); nan where the
        time is not known.
    peaks, heights : (n,) times, s, and sizes, N, of the greatest force. A time is nan if it is that
        of the first or the last frame of the motion, and where :meth:`Motion.passages` does not
        know when the peak passes.
    front, peak : velocities, m/s, of the front and of the peak (:func:`_find_velocity`).
    """

    distances: Array
    arrivals: Array
    peaks: Array
    heights: Array
    front: float
    peak: float

    @classmethod
    def of(cls, motion: Motion, source: Index) -> Self:
        """Return the passage of the wave of a ``motion`` that comes from the balls and walls
        ``source``, given by their numbers.
        """
        distances = _find_distances(motion, source)
        peak_times, heights = motion.peaks()
        front_passages = motion.passages("front")
        peak_passages = motion.passages()
        # a force that is greatest at an end of the motion may still rise, or may have fallen before
        peak_frames = np.argmax(motion.forces, axis=0)
        is_between_ends = (peak_frames > 0) & (peak_frames < len(motion.times) - 1)
        is_peak = np.isfinite(peak_passages) & is_between_ends
        return cls(
            distances=distances,
            arrivals=front_passages,
            peaks=np.where(is_peak, peak_times, np.nan),
            heights=heights,
            front=_find_velocity(distances, front_passages),
            peak=_find_velocity(distances, peak_passages),
        )


def _find_distances(motion: Motion, source: Index) -> Array:
    """Return the distances (n,), m, of the n contacts of a motion (see :class:`Passage`) from the
    nearest of the balls and walls ``source``, or of their images in the neighbouring cells.
    """
    network = motion.network
    shifts = [[-1, 0, 1] if is_periodic else [0] for is_periodic in network.pbc]
    cells = np.array(list(product(*shifts)))  # (n_cells, axes), whole numbers
    offsets = cells @ network.cell
    # a flat wall that balls touch is a plane, and the place by which it is given may be anywhere
    walls = set(source.tolist()) & set(network.walls)
    others = np.setdiff1d(source, list(walls))
    images = network.positions[others] + offsets[:, None]  # (n_cells, others, 3)
    distances = np.asarray(cKDTree(images.reshape(-1, 3)).query(motion.middles)[0])
    for wall in walls:
        point, normal = network.walls[wall]
        distances = np.minimum(distances, np.abs((motion.middles - point) @ normal))
    return distances


def _find_velocity(distances: Array, times: Array) -> float:
    """Return the velocity, m/s, of a wave that passes contacts at ``distances`` (n,), m, at the
    ``times`` (n,), s, where a time that is not known is nan.

    A straight line (:func:`fit_velocity`) is fitted to the contacts between a quarter and three
    quarters of the greatest distance with a known time. The velocity is nan for fewer than three
    such contacts, and if their times are no straight line that rises, as where dashpots are so
    strong that the force diffuses.
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
    """Run the motion of the ``settings`` in the network of ``x``, a state, sample or network, and
    return the numbers of the motion and the function that makes the bytes of its file, both by
    name.

    The numbers are :data:`NUMBERS`, in SI units; ``motion``, an array with a row (n_times,) for
    each of :data:`OVER_TIME`; and ``motion_note``, a text of the warnings.
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
        motion.translation + motion.rotation,
        motion.translation,
        motion.rotation,
        motion.stored,
        motion.lost,
        supplied,
        motion.forces.max(axis=1),
    )
    record = {name: np.array(float(value)) for name, value in numbers.items()}
    record["motion"] = np.array(over_time)
    record["motion_note"] = np.array(" ".join(prepared.notes))

    def make_bytes() -> bytes:
        """Return the bytes of the file of the motion."""
        stream = io.BytesIO()
        motion.write(stream)
        return stream.getvalue()

    return record, {"motion": make_bytes}


def average_motions(
    records: Sequence[Mapping[str, Array]], _settings: MotionSettings
) -> tuple[dict[str, Array], list[str]]:
    """Return the means over samples of the arrays of :func:`record_motion`, by name, with the
    standard errors of the numbers :data:`_NUMBERS_WITH_ERRORS`, and notes.

    The mean and the error of a number are those of the samples in which the number is known. A mean
    is left out if the number is known in no sample, and an error if the number is known in fewer
    than two. Notes say in how many samples a number is not known. Another note quotes the warnings
    of the first sample that has any; for several samples the note says how many have warnings.
    """
    motions = np.mean([record["motion"] for record in records], axis=0)
    observables = dict(zip(OVER_TIME, motions, strict=True))
    texts = [str(record["motion_note"]) for record in records]
    warnings_of_samples = [text for text in texts if text]
    notes = warnings_of_samples[:1]
    if notes and len(records) > 1:
        share = f"in {len(warnings_of_samples)} of {len(records)} samples"
        notes = [f"{share}, as in the first of them: {warnings_of_samples[0]}"]
    for name in NUMBERS:
        numbers = np.array([float(record[name]) for record in records])
        known_numbers = numbers[np.isfinite(numbers)]
        n_unknown = numbers.size - known_numbers.size
        if known_numbers.size:
            observables[name] = np.array(np.mean(known_numbers))
        if known_numbers.size > 1 and name in _NUMBERS_WITH_ERRORS:
            observables[f"{name}_error"] = np.asarray(standard_error(known_numbers, axis=0))
        if n_unknown:  # a velocity: all other numbers of a motion are known
            samples = f" in {n_unknown} of {numbers.size} samples" if numbers.size > 1 else ""
            notes.append(
                f"the {name.replace('_', ' ')} is not known{samples}: the wave is known to come to"
                " fewer than three contacts, or their distances over the times at which it comes"
                " are no straight line that rises; run for longer, or with more frames"
            )
    return observables, notes


def list_contact_columns(motion: Motion, settings: MotionSettings) -> list[tuple[str, str, Any]]:
    """Return the columns of the table of the contacts of a ``motion`` with these ``settings``, each
    as a name, a unit and values (n,): the balls and the middle of each contact, the distance of the
    contact from what is driven, and when and how strongly it is pressed. The n contacts are those
    of :class:`Passage`.
    """
    passage = Passage.of(motion, find_source(settings, motion.network))
    network = motion.network
    ends = np.concatenate([np.column_stack([network.i, network.j]), motion.met])
    x, y, z = motion.middles.T
    return [
        ("ball_i", "", ends[:, 0]),
        ("ball_j", "", ends[:, 1]),
        ("x", "m", x),
        ("y", "m", y),
        ("z", "m", z),
        ("distance", "m", passage.distances),
        ("arrival", "s", passage.arrivals),
        ("peak", "s", passage.peaks),
        ("greatest_force", "N", passage.heights),
    ]


def write_contacts(
    motion: Motion,
    path: Path,
    settings: MotionSettings,
    errors: Mapping[str, Array] | None = None,
) -> None:
    """Write the table ``path`` of the contacts of a ``motion`` with these ``settings``: the columns
    of :func:`list_contact_columns`, and after these the ``errors``, columns of standard errors (n,)
    by the name of the column whose errors they are.
    """
    columns = list_contact_columns(motion, settings)
    headings = [Heading(name, unit) for name, unit, _ in columns]
    heading_of_name = {heading.name: heading for heading in headings}
    lists = [values.tolist() for _, _, values in columns]
    for name, values in (errors or {}).items():
        headings.append(heading_of_name[name].of_error)
        lists.append(values.tolist())
    rows = zip(*lists, strict=True)
    path.write_text(table_text(headings, rows), encoding="utf-8")


def _record_modes(x: Any, settings: ModesSettings) -> tuple[dict[str, Array], dict[str, Any]]:
    """Return the table ``modes`` (3, modes) of as many of the lowest modes of the network of ``x``,
    a state, sample or network, as the ``settings`` ask for, by name, and no files. The rows of the
    table are frequencies, Hz, participation ratios, and parts of the kinetic energy in rotations.
    """
    modes = Waves(settings.shape(given_network(x))).modes(settings.count)
    rows = [modes.frequencies, modes.participation_ratio, modes.rotational_fraction]
    return {"modes": np.array(rows)}, {}


def _average_modes(
    records: Sequence[Record], _settings: ModesSettings
) -> tuple[dict[str, Array], list[str]]:
    """Return the means over samples, whose ``records`` :func:`_record_modes` makes, of the numbers
    of the modes, by name, with the standard error of the frequencies if there are several samples;
    and no notes.
    """
    tables = np.array([record["modes"] for record in records])  # (samples, 3, modes)
    names = ("mode_frequency", "mode_participation", "mode_rotation")
    observables = dict(zip(names, np.mean(tables, axis=0), strict=True))
    if len(records) > 1:
        observables["mode_frequency_error"] = np.asarray(standard_error(tables[:, 0], axis=0))
    return observables, []


#: for each block about networks, the function that records a network, and the function that
#: averages the records of samples
RECORDS: dict[
    str, tuple[Callable[..., tuple[dict[str, Array], dict[str, Any]]], Callable[..., Any]]
] = {
    "response": (_record_response, _average_responses),
    "motion": (record_motion, average_motions),
    "modes": (_record_modes, _average_modes),
}


def restore_result(record: Record, name: str, kind: type[Result]) -> Any:
    """Return the result of the ``kind`` that a record, made with ``whole``, keeps under a ``name``;
    None if the record keeps none.
    """
    text = record.get(_RESULT_PREFIX + name)
    return None if text is None else kind.from_dict(json.loads(text.item()))


def restore_spectra(
    records: Sequence[Record], settings: WaveSettings, state: ContactState | NetworkState
) -> PathSpectra:
    """Return the spectral functions of the first sample of a ``state`` along the path of the
    ``settings``, from the ``records`` of its samples.
    """
    record = records[0]
    assert settings.spectrum is not None
    polarisations = settings.spectrum.polarisation
    spectra = [restore_result(record, name, SpectralFunction) for name in polarisations]
    if isinstance(state, NetworkState):
        return PathSpectra.of_packing(
            spectra,
            record["path_corners"],
            record["path_distance"],
            list(map(np.array, settings.path)),
            settings.labels,
        )
    return PathSpectra.of(
        spectra,
        record["path_corners"],
        record["path_distance"],
        state.contact_lattice(),
        state.scales,
        list(map(np.array, settings.path)),
        settings.labels,
    )


def restore_pulse(records: Sequence[Record]) -> Pulse | None:
    """Return the mean of the pulses through the samples of the ``records``; None if no sample
    carries one.
    """
    results = [restore_result(record, "pulse", Pulse) for record in records]
    pulses = [pulse for pulse in results if pulse is not None]
    return average_pulses(pulses) if pulses else None


def restore_motion(record: Record) -> Motion | None:
    """Return the motion that a record keeps; None if it keeps none."""
    content = record.get(f"{_RESULT_PREFIX}motion")
    return None if content is None else Motion.read(io.BytesIO(content.tobytes()))


def average_waves(
    records: Sequence[Record], settings: WaveSettings
) -> tuple[dict[str, Array], list[str]]:
    """Return the observables of the waves of the ``settings`` from the ``records`` of the samples
    at one load, arrays in SI units by name, and notes on them.

    Standard errors are those over samples; a density of states of one sample has that of the random
    vectors.
    """
    observables = dict[str, Array]()
    notes = list[str]()
    averages = list[tuple[Callable[..., Any], Any]]()
    for name in settings.names:
        _record, average = SAMPLE_RECORDS[name]
        averages.append((average, settings))
    for block in settings.of_networks:
        _record, average = RECORDS[block.block]
        averages.append((average, block))
    for average, settings_of_average in averages:
        means, notes_on_means = average(records, settings_of_average)
        observables |= means
        notes += notes_on_means
    return observables, notes


def _interpolate_densities(table: Array, points: Array) -> Array:
    """Return the densities (3, n_f), 1/Hz, of a ``table`` (4, n) at the frequencies ``points``
    (n_f,), Hz. The first row of the table is its n frequencies, Hz, and the others are its
    densities, 1/Hz.

    A cubic spline interpolates, and goes on below the first frequency of the table. Densities that
    the spline puts below zero become zero, and so do those above the last frequency.
    """
    from scipy.interpolate import CubicSpline

    frequencies = table[0]
    densities = table[1:]
    if np.array_equal(frequencies, points):
        return densities
    spline = CubicSpline(frequencies, densities, axis=1)
    # between steep nodes a spline may fall below zero
    interpolated = np.maximum(spline(points), 0.0)
    return np.where(points <= frequencies[-1], interpolated, 0.0)


def _average_densities(
    records: Sequence[Record], _settings: WaveSettings
) -> tuple[dict[str, Array], list[str]]:
    """Return the mean over samples of densities of states, arrays (n_f,) by name, and no notes.

    The record of each sample has a table (4, n) of frequencies, Hz, translational and rotational
    density, 1/Hz, and the error of their sum, 1/Hz. The mean is taken at the frequencies of the
    sample that reaches highest, where the densities of the other samples are interpolated. The
    error of a single sample is that of its table; that of several is the standard error of their
    sums.
    """
    tables = [record["dos"] for record in records]
    points = max((table[0] for table in tables), key=lambda frequencies: float(frequencies[-1]))
    densities = [_interpolate_densities(table, points) for table in tables]
    translational, rotational, error = np.mean(densities, axis=0)
    if len(tables) > 1:
        totals = [rows[0] + rows[1] for rows in densities]
        error = standard_error(np.array(totals), axis=0)
    densities_of_states = {
        "dos_frequency": points,
        "dos_total": translational + rotational,
        "dos_translational": translational,
        "dos_rotational": rotational,
        "dos_error": error,
    }
    return densities_of_states, []


def _average_spectra(
    records: Sequence[Record], settings: WaveSettings
) -> tuple[dict[str, Array], list[str]]:
    """Return the observables of the mean lines of plane waves by name, and notes. Those of lines
    are (polarisations, n) at n wave vectors; ``path_distance`` and ``wavenumber`` are (n,),
    ``path_corners`` is (m,), of m corners, and ``ioffe_regel_*`` and their errors are scalars ().

    The path and the wave numbers are those of the first sample: in exact geometry those of other
    samples differ by their cells.

    Peaks and widths, Hz, are averaged over samples, and the other observables are found from their
    means; ``line_resolved`` is the part of the samples whose line is resolved. Several samples have
    standard errors too (:func:`_find_line_errors`), those of Ioffe-Regel frequencies by the
    jackknife. A note says of which polarisation there is no such frequency, and why.
    """
    notes = list[str]()
    along_path = ("path_corners", "path_distance", "wavenumber")
    observables = {name: records[0][name] for name in along_path}
    # samples, polarisations, (peak, width, resolved), wave vectors
    lines = np.array([record["lines"] for record in records])
    q = observables["wavenumber"]
    peak, width, resolved = np.moveaxis(np.mean(lines, axis=0), 1, 0)
    velocity = 2.0 * np.pi * peak / q
    observables |= {
        "line_frequency": peak,
        "line_width": width,
        "line_resolved": resolved,
        "phase_velocity": velocity,
        "attenuation": find_attenuation(velocity, width),
        "mean_free_path": find_mean_free_path(velocity, width),
    }
    has_errors = len(records) > 1
    if has_errors:
        observables |= _find_line_errors(q, lines)
    assert settings.spectrum is not None
    for index, name in enumerate(settings.spectrum.polarisation):
        crossing, why = _find_crossing(q, peak[index], width[index])
        if crossing is None:
            notes.append(f"no Ioffe-Regel frequency of {name} waves: {why}")
            continue
        observables[f"ioffe_regel_{name}"] = np.array(crossing)
        if has_errors:
            crossing_error = _find_crossing_error(q, lines[:, index])
            observables[f"ioffe_regel_{name}_error"] = np.array(crossing_error)
    return observables, notes


def _find_line_errors(q: Array, lines: Array) -> dict[str, Array]:
    """Return the standard errors (polarisations, n) over samples of the lines of plane waves, by
    name: of peaks, Hz, widths, Hz, phase velocities, m/s, and attenuations, 1/m. The attenuations
    are those that each sample has by itself.

    ``q`` (n,) are wave numbers, 1/m, and ``lines`` (samples, polarisations, 3, n) the peak, Hz, the
    width, Hz, and whether the line is resolved.
    """
    peaks = lines[:, :, 0]
    widths = lines[:, :, 1]
    attenuations = find_attenuation(2.0 * np.pi * peaks / q, widths)
    peak_error = standard_error(peaks, axis=0)
    return {
        "line_frequency_error": peak_error,
        "line_width_error": standard_error(widths, axis=0),
        "phase_velocity_error": 2.0 * np.pi * peak_error / q,
        "attenuation_error": standard_error(attenuations, axis=0),
    }


def _find_crossing(q: Array, peak: Array, width: Array) -> tuple[float | None, str]:
    """Return the Ioffe-Regel frequency, Hz, of waves with the peaks ``peak`` and the widths
    ``width``, both (n,), Hz, at wave vectors of the length ``q`` (n,), 1/m; None if there is no
    such frequency. The second value is a text that says why there is none, and means nothing
    otherwise.
    """
    try:
        crossing = find_ioffe_regel(q, peak, width)
    except InputError as error:
        return None, str(error)
    return crossing, "their mean free path is longer than 1/|q| all along the path"


def _average_pulses(
    records: Sequence[Record], _settings: WaveSettings
) -> tuple[dict[str, Array], list[str]]:
    """Return the observables of pulses, in SI units by name, and notes. The observables are the
    means over samples of velocity, time of flight and coherent fraction, and the standard error of
    the velocity, ``pulse_velocity_error``.

    The mean of a number is that of the samples in which the number is known. If a pulse is heard,
    and its arrival is not known, its coherent fraction is known all the same. A mean is left out if
    the number is known in no sample, and the error if the velocity is known in fewer than two. The
    notes are the warnings of the pulses, and one that says in how many samples the arrival is not
    known, with the reason in the first of these samples.
    """
    means = dict[str, Array]()
    for name in _PULSE:
        numbers = np.array([float(record[name]) for record in records])
        known_numbers = numbers[np.isfinite(numbers)]
        if known_numbers.size:
            means[name] = np.array(np.mean(known_numbers))
        if name == "pulse_velocity" and known_numbers.size > 1:
            means["pulse_velocity_error"] = np.asarray(standard_error(known_numbers, axis=0))
    texts = [str(record["pulse_echo"]) for record in records]
    notes = [text for text in dict.fromkeys(texts) if text]
    pulse_notes = [str(record["pulse_note"]) for record in records]
    reasons = [text for text in pulse_notes if text]
    if reasons:
        samples = f" in {len(reasons)} of {len(records)} samples" if len(records) > 1 else ""
        remark = ""
        if len(reasons) < len(records):
            remark = ", and the mean velocity and time of flight are those of the others"
        notes.append(f"the arrival of the pulse is not known{samples}{remark}: {reasons[0]}")
    return means, notes


def _find_crossing_error(q: Array, lines: Array) -> float:
    """Return the standard error of the Ioffe-Regel frequency, Hz, of the mean lines of two samples
    or more, by the jackknife; nan if there is no such frequency without one of the samples.

    ``q`` (n,) are wave numbers, 1/m. ``lines`` (samples, 3, n) are the peak, Hz, and the width, Hz,
    of each sample, and whether the line is resolved.
    """

    def find_frequencies(rows: Array) -> Array:
        """Return the Ioffe-Regel frequency of each of the mean lines, ``rows`` (samples, 3 n), Hz,
        nan where there is none.
        """
        frequencies = list[float | None]()
        for row in rows:
            peak, width, _resolved = row.reshape(3, -1)
            frequencies.append(_find_crossing(q, peak, width)[0])
        return np.array(frequencies, float)

    return float(jackknife(find_frequencies, lines.reshape(len(lines), -1)))


#: for each result of the waves in samples, the function that records a sample, and the function
#: that averages the records of samples
SAMPLE_RECORDS: dict[
    str, tuple[Callable[..., tuple[dict[str, Array], dict[str, Any]]], Callable[..., Any]]
] = {
    "dos": (_record_dos, _average_densities),
    "spectrum": (_record_spectra, _average_spectra),
    "pulse": (_record_pulse, _average_pulses),
}
