"""What a run keeps of the waves in each sample or network, and its means over samples with their
standard errors.

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
    ResponseSettings,
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
#: what the names of whole results begin with
_WHOLE = "whole."
#: numbers of a pulse that are averaged, and what a pulse calls them
_PULSE = {
    "pulse_velocity": "velocity",
    "time_of_flight": "time_of_flight",
    "coherent_fraction": "coherent_fraction",
}
#: what is found of a motion, and over time, by the names of the catalogue; and what has standard
#: errors over samples
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
#: how the height of a narrow peak becomes known, of a mean over samples, and of one network
_NARROW = ("give frequencies closer to each other", "give a damping or a loss_factor")
#: least number of steps in a period of a shaker
_PER_PERIOD = 10
#: most of the area under the table of a drive that may fall between steps
_MOST_LOST = 0.1
#: parts of the greatest distance between which velocities are read
_BETWEEN = (0.25, 0.75)


def require_waves(
    serving_media: Sequence[ServingMedium], wanted: WaveSettings, most: float = np.inf
) -> None:
    """Raise if what is ``wanted`` cannot be found in the arrays of a case, at any of its loads.

    Each array of up to ``most`` balls is looked at as one of equal balls at the same mean force,
    which takes no simulation: the wave vectors of its cell, the motions of its balls, the way of
    the pulse and how long it may be heard. What depends on the load is refused if it fails at the
    least and at the greatest.
    """
    if wanted.spectrum is None and wanted.pulse is None:
        return
    for medium, load in (
        (one, serving.load)
        for serving in serving_media
        for one in serving.arrays
        if one.balls <= most
    ):
        errors = list[GranphonError]()
        forces = find_typical_force(medium.packing, load)
        ends = list(dict.fromkeys((float(np.min(forces)), float(np.max(forces)))))
        for number, force in enumerate(ends):
            ideal = AveragedLattice(medium.packing).at(Load.only(force=force))[0]
            network = ideal.network.repeat(medium.cells)
            if (settings := wanted.spectrum) is not None and not number:
                packing = medium.packing
                way = find_path_points(
                    network, ideal_lattice(packing), packing.diameter, wanted.path, settings.points
                )
                operator = WaveOperator(network)
                # the bound of frequencies of equal balls is below that of differing ones, but for a
                # little: it takes no more moments
                Kernel.of(operator.top / (2.0 * math.pi * MARGIN), settings.resolution)
                for name in settings.polarisation:
                    find_polarisations(operator, way.q[0], name, None)
            try:
                if wanted.pulse is not None:
                    require_sendable(
                        network, PulseSource.of(wanted.pulse, network, wanted.direction)
                    )
            except GranphonError as error:
                errors.append(error)
        if len(errors) == len(ends):
            raise errors[0]


def require_network(
    serving_media: Sequence[ServingMedium], wanted: NetworkSettings, key: str, most: float = np.inf
) -> None:
    """Raise unless the networks of a case, repeated and cut, have what the ``key`` of the settings
    says of them.

    Those of packings are of equal balls at a typical force, and of arrays up to ``most`` balls;
    crystals that are not quickly loaded are left out.
    """
    wanted = replace(wanted, cut=()) if key == "repeat" else wanted
    for serving in serving_media:
        arrays = serving.arrays
        if (arrays and arrays[0].balls > most) or (state := find_typical_state(serving)) is None:
            continue
        if wanted.count(arrays[0].balls if arrays else state.network.n_balls) > most:
            continue
        network = state.network.repeat(arrays[0].cells) if arrays else state.network
        if isinstance(wanted, MotionSettings) and key == "drive":
            PreparedMotion(network if arrays else state, wanted)
            continue
        shaped = wanted.shape(network)
        if isinstance(wanted, ResponseSettings) and key in ("source", "receiver"):
            moved = wanted.quantity == "transmissibility" and key == "source"
            require_places(
                shaped,
                key,
                [find_place(one) for one in getattr(wanted, key)],
                moved,
                **_choose_plane(wanted),
            )


def find_typical_state(serving: ServingMedium) -> Any:
    """Return a state like the first of a case: of equal balls at a typical force, or a crystal's;
    None if it takes long.
    """
    if serving.packing.kind_names:
        return serving.at(serving.load[0]) if serving.is_quick else None
    force = float(np.ravel(find_typical_force(serving.packing, serving.load))[0])
    return AveragedLattice(serving.packing).at(Load.only(force=force))[0]


def _choose_plane(wanted: ResponseSettings) -> dict[str, Any]:
    return {name: getattr(wanted, name) for name in ("direction", "polarisation", "distance")}


def record_waves(sample: Sample, wanted: WaveSettings, whole: bool = False) -> dict[str, Array]:
    """Find what is wanted of the waves in a sample, and return the numbers that are averaged, in SI
    units by name.

    With ``whole`` the results themselves are kept too, for :class:`SampleWaves`.
    """
    waves = Waves(sample)
    out = dict[str, Array]()
    results = dict[str, Result]()
    if wanted.dos:
        # random vectors differ from sample to sample, so that their noise is part of the standard
        # error over samples
        found = waves.dos(seed=sample.seed or 0)
        parts = (found.frequencies, found.translational, found.rotational, found.error)
        out["dos"], results["dos"] = np.array(parts), found
    if (settings := wanted.spectrum) is not None:
        packing = sample.packing
        way = find_path_points(
            waves.network, ideal_lattice(packing), packing.diameter, wanted.path, settings.points
        )
        spectra = {
            name: waves.spectral_function(way.q, name, settings.resolution)
            for name in settings.polarisation
        }
        lines = [(one.peak, one.width, one.resolved) for one in spectra.values()]
        out |= {
            "path_corners": way.corners,
            "path_distance": way.distances,
            "lines": np.array(lines, float),
        }
        out["wavenumber"] = spectra[settings.polarisation[0]].wavenumber
        results |= spectra
    if wanted.pulse is not None:
        # what cannot be known of a pulse is nan, and the text ``pulse_note`` says why
        numbers = dict.fromkeys(_PULSE, math.nan)
        note = ""
        said = ""
        try:
            heard = transmit(
                waves.network, PulseSource.of(wanted.pulse, waves.network, wanted.direction)
            )
            numbers |= {name: getattr(heard, source) for name, source in _PULSE.items()}
            note = heard.why_unknown
            results["pulse"] = heard
            said = " ".join(text for text in heard.warnings if not note or note not in text)
        except (
            GranphonError
        ) as error:  # what could be known before the simulation has been refused by now
            note = str(error)
        out |= {name: np.array(value) for name, value in numbers.items()}
        out |= {"pulse_note": np.array(note), "pulse_echo": np.array(said)}
    if whole:
        out |= {
            _WHOLE + name: np.array(json.dumps(one.to_dict()).encode())
            for name, one in results.items()
        }
    return out | record_networks(sample, wanted, whole)


def record_networks(x: Any, wanted: WaveSettings, whole: bool = False) -> dict[str, Array]:
    """Find what is wanted of the network of a state or sample, and return what is averaged, in SI
    units by name.

    With ``whole`` results that have a file of their own are kept too, as its bytes. An error knows
    its block.
    """
    out = dict[str, Array]()
    for one in wanted.of_networks:
        record, _ = RECORDS[one.block]
        try:
            found, files = record(x, one)
        except GranphonError as error:
            error.block = (one.block,)
            raise
        out |= found | {
            _WHOLE + name: np.frombuffer(write(), np.uint8)
            for name, write in files.items()
            if whole
        }
    return out


# -- of one network


def _record_response(x: Any, wanted: ResponseSettings) -> tuple[dict[str, Array], dict[str, Any]]:
    """Find the response, (n_f, places of the receiver); that of a plane is the mean over its
    balls.
    """
    places = [find_place(one) for one in wanted.receiver]
    found: Response = Waves(wanted.shape(given_network(x))).response(
        wanted.frequencies,
        [find_place(one) for one in wanted.source],
        places,
        wanted.damping,
        wanted.loss_factor,
        quantity=wanted.quantity,
        **_choose_plane(wanted),
    )
    balls = len(found.receivers) - len(places) + 1
    starts = np.cumsum([0, *(balls if one == "plane" else 1 for one in places)])
    groups = [slice(first, end) for first, end in pairwise(starts.tolist())]
    means = [np.mean(found.values[:, group], axis=1) for group in groups]
    record = {"response": np.transpose(means), "response_note": np.array(" ".join(found.warnings))}
    return record | {"response_peaks": _list_peaks(found.peaks_of_means(groups))}, {}


def _list_peaks(peaks: Sequence[Peaks]) -> Array:
    """Return frequencies, heights and Q of the peaks at each place, (3, places, n), nan beyond
    those that there are.
    """
    table = np.full((3, len(peaks), max(len(one.frequencies) for one in peaks)), np.nan)
    for place, one in enumerate(peaks):
        table[:, place, : len(one.frequencies)] = one
    return table


def _average_responses(
    records: Sequence[Record], wanted: ResponseSettings
) -> tuple[dict[str, Array], list[str]]:
    """Return the coherent response, the mean of complex amplitudes, its peaks, and the highest at
    the first place.

    Peaks of one record are solved for between the frequencies; those of a mean are of the
    frequencies that there are.
    """
    every = np.array([one["response"] for one in records])
    name = RESPONSES[wanted.quantity]
    mean = np.mean(every, axis=0)
    out = {name: np.abs(mean), "response_phase": np.unwrap(np.angle(mean), axis=0)}
    alone = len(records) == 1
    peaks = (
        records[0]["response_peaks"]
        if alone
        else _list_peaks(find_peaks(np.array(wanted.frequencies), mean))
    )
    notes = list(
        dict.fromkeys(str(one["response_note"]) for one in records if str(one["response_note"]))
    )
    is_peak = np.isfinite(peaks[0])
    unknown = is_peak & np.isnan(peaks[1])
    words = ("frequency", name, "quality")
    if np.any(is_peak):
        out |= {f"peaks_{word}": table for word, table in zip(words, peaks, strict=True)}
    if np.any(unknown):
        lines = counted(
            int(np.max(np.sum(unknown, axis=1))),
            "peak of the response is",
            "peaks of the response are",
        )
        notes.append(
            f"{lines} narrower than the step of the frequencies, and the height is not known:"
            f" {_NARROW[alone]}"
        )
    if np.any(is_peak[0]) and not np.any(unknown[0]):
        highest = np.nanargmax(peaks[1, 0])
        out |= {
            f"peak_{word}": np.array(table[0, highest])
            for word, table in zip(words, peaks, strict=True)
        }
    if len(records) > 1:
        out[f"{name}_error"] = np.asarray(standard_error(every, axis=0))
    return out, notes


def make_waves(x: Any, network: ContactNetwork, settings: MotionSettings) -> NonlinearWaves:
    """Return the balls of a ``network``, made of the state, sample or network ``x``, with the law
    of its contacts.
    """
    from granphon.waves.nonlinear import NonlinearWaves  # imported here: other tasks do not need it

    state = x.source if isinstance(x, NetworkState) else x
    law = state.crystal if isinstance(state, CrystalState) else None
    mu = math.inf if settings.friction_coefficient is None else settings.friction_coefficient
    return NonlinearWaves(
        network, law, friction_coefficient=mu, damping=settings.damping, geometry=settings.geometry
    )


class PreparedMotion:
    """The balls of a state, or of a network, that move, and what drives them.

    Raises :class:`~granphon.base.errors.InputError` for what is known to be wrong before anything
    moves.

    Attributes
    ----------
    waves : the balls and their law.
    drives : :class:`~granphon.Drive`, in turn, without impacts.
    velocities : (n, 3) those that impacts give, m/s.
    notes : what the motion warned of, in sentences.
    """

    def __init__(self, x: Any, settings: MotionSettings) -> None:
        from granphon.waves.nonlinear import Drive  # imported here: other tasks do not need it

        network = settings.shape(given_network(x))
        self.settings = settings
        self.notes = list[str]()
        self.waves = make_waves(x, network, settings)
        self.drives = list[Drive]()
        self.velocities = np.zeros((network.n_balls, 3))
        for one in settings.drive:
            balls = index_array("balls of the drive", one.find_balls(network), network.n_balls)
            along = np.eye(network.dimension)[0] if one.direction is None else one.direction
            vector = read_vector("direction of the drive", along, network.dimension)
            require_moves("drive", vector, network)
            if one.impact is None:
                moved: Any = one.shaker or one.displacement
                self.drives.append(Drive(balls, vector, displacement=moved, force=one.force))
            else:
                self.velocities[balls] += one.impact * vector
        led = [
            np.flatnonzero(~network.moving),
            *(one.balls for one in self.drives if one.displacement is not None),
        ]
        if np.any(self.velocities[np.concatenate(led)]):
            raise InputError(
                "an impact on a body that is held or displaced",
                mend="Give it a shaker or a displacement",
            )
        shaken = max(
            (one.shaker.frequency for one in settings.drive if one.shaker is not None), default=0.0
        )
        signals = [one.force or one.displacement for one in settings.drive]
        if shaken or any(signals):
            step = settings.step or self.waves.find_step(
                float(np.linalg.norm(self.velocities, axis=1).max())
            )
            step = min(step, settings.duration / (settings.frames - 1))
            if step * shaken * _PER_PERIOD > 1.0:
                what = f"a shaker has the frequency {shaken:.4g} Hz, and steps have {step:.3g} s"
                raise InputError(
                    what,
                    f"A period would have fewer than {_PER_PERIOD} steps",
                    "Give a shorter step",
                )
            if (
                lost := max(
                    (one.lost(step, settings.duration) for one in signals if one), default=0.0
                )
            ) > _MOST_LOST:
                what = (
                    f"{100.0 * lost:.3g} % of the table of a drive are lost between steps of"
                    f" {step:.3g} s"
                )
                raise InputError(what, mend="Give a shorter step")

    def run(self) -> Motion:
        """Let the balls move; :class:`~granphon.base.errors.ConvergenceError` for a motion that
        ends before its time.
        """
        of = self.settings
        with warnings.catch_warnings(record=True) as told:
            warnings.simplefilter("always", LimitWarning)
            # its frames would not be those of other loads and samples
            warnings.simplefilter("error", StoppedEarlyWarning)
            try:
                motion = self.waves.run(
                    of.duration,
                    None,
                    self.velocities,
                    self.drives,
                    frames=of.frames,
                    step=of.step,
                    scheme=of.scheme,
                )
            except StoppedEarlyWarning as stopped:
                if stopped.interrupted:
                    raise KeyboardInterrupt from None
                raise ConvergenceError(
                    str(stopped), mend="Give a shorter duration, or a weaker drive"
                ) from None
        self.notes = [str(one.message) for one in told]
        return motion


def find_source(settings: MotionSettings, network: ContactNetwork) -> Index:
    """Return the numbers of all balls of a shaped network that are driven."""
    return np.unique(np.concatenate([one.find_balls(network) for one in settings.drive]))


class Passage(NamedTuple):
    """When what a drive sends comes to each contact, and how fast it goes.

    Attributes
    ----------
    distances : (n_c,) of contacts from the nearest ball or wall that is driven, or its nearest
        image, m.
    arrivals : (n_c,) times at which the front passes, s, as of :meth:`Motion.passages`; nan where
        it is not known.
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
        """Find what passes the contacts of a motion from the balls ``source``."""
        network = motion.network
        cells = np.array(list(product(*([-1, 0, 1] if one else [0] for one in network.pbc))))
        images = (network.positions[source] + (cells @ network.cell)[:, None]).reshape(-1, 3)
        distances = np.asarray(cKDTree(images).query(motion.middles)[0])
        for wall in set(source.tolist()) & set(network.walls):
            # a plane, which is nearer than the place that it is given at
            place, toward = network.walls[wall]
            distances = np.minimum(distances, np.abs((motion.middles - place) @ toward))
        peaks, heights = motion.peaks()
        greatest = np.argmax(motion.forces, axis=0)
        last = len(motion.times) - 1
        fronts = motion.passages("front")
        peaks = np.where(
            np.isfinite(motion.passages()) & (greatest > 0) & (greatest < last), peaks, np.nan
        )
        velocities = (_find_velocity(distances, one) for one in (fronts, motion.passages()))
        return cls(distances, fronts, peaks, heights, *velocities)


def _find_velocity(distances: Array, times: Array) -> float:
    """Return the velocity of what passes contacts between a quarter and three quarters of the way,
    m/s, or nan.
    """
    known = np.isfinite(times)
    far = float(np.max(distances, initial=0.0, where=known))
    known &= (distances >= _BETWEEN[0] * far) & (distances <= _BETWEEN[1] * far)
    return (
        fit_velocity(distances[known], times[known])[0]
        if np.count_nonzero(known) >= 3
        else math.nan
    )


def record_motion(
    x: Any, settings: MotionSettings
) -> tuple[dict[str, Array], dict[str, Callable[[], bytes]]]:
    """Let the array of a state, sample or network move; return what is kept of it, and what makes
    the bytes of its file.
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
    kept = {name: np.array(float(value)) for name, value in numbers.items()} | {
        "motion": np.array(over_time)
    }
    kept["motion_note"] = np.array(" ".join(prepared.notes))

    def write() -> bytes:
        stream = io.BytesIO()
        motion.write(stream)
        return stream.getvalue()

    return kept, {"motion": write}


def average_motions(
    records: Sequence[Mapping[str, Array]], _: MotionSettings
) -> tuple[dict[str, Array], list[str]]:
    """Return means over samples of what :func:`record_motion` keeps, standard errors, and notes."""
    out = dict(zip(OVER_TIME, np.mean([one["motion"] for one in records], axis=0), strict=True))
    said = [str(one["motion_note"]) for one in records if str(one["motion_note"])]
    of = f"{len(said)} of {len(records)} samples, such as one: " if len(records) > 1 else ""
    notes = [of + one for one in said[:1]]
    for name in NUMBERS:
        every = np.array([float(one[name]) for one in records])
        known = every[np.isfinite(every)]
        if known.size:
            out[name] = np.array(np.mean(known))
        if known.size > 1 and name in _WITH_ERRORS:
            out[f"{name}_error"] = np.asarray(standard_error(known, axis=0))
        if known.size < every.size:
            where = (
                f" in {every.size - known.size} of {every.size} samples" if every.size > 1 else ""
            )
            notes.append(
                f"the {name.replace('_', ' ')} is not known{where}: distances of contacts"
                f" over the times at which the wave"
                " comes are no straight line that rises; run for longer, or with more frames"
            )
    return out, notes


def write_contacts(motion: Motion, path: Path, settings: MotionSettings) -> None:
    """Write a table of the contacts: where they are, and when and how strongly they are pressed."""
    passage = Passage.of(motion, find_source(settings, motion.network))
    network = motion.network
    ends = np.concatenate([np.column_stack([network.i, network.j]), motion.met])
    columns: list[tuple[str, str, Any]] = [("ball_i", "", ends[:, 0]), ("ball_j", "", ends[:, 1])]
    columns += [(axis, "m", one) for axis, one in zip("xyz", motion.middles.T, strict=True)]
    columns += [
        ("distance", "m", passage.distances),
        ("arrival", "s", passage.arrivals),
        ("peak", "s", passage.peaks),
    ]
    columns.append(("greatest_force", "N", passage.heights))
    rows = zip(*(values.tolist() for _, _, values in columns), strict=True)
    path.write_text(
        table_text([Heading(name, unit) for name, unit, _ in columns], rows), encoding="utf-8"
    )


#: for each block about networks, what is kept of a network, and how that of samples is averaged
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
        cls, wanted: WaveSettings | None, state: ContactState, records: Sequence[Record]
    ) -> Self:
        """Take the waves from what :func:`record_waves` has kept of the samples of a state."""

        def read(record: Record, name: str, kind: type[Result]) -> Any:
            text = record.get(_WHOLE + name)
            return None if text is None else kind.from_dict(json.loads(text.item()))

        first = records[0]
        path = None
        if wanted is not None and wanted.spectrum is not None:
            spectra = [read(first, name, SpectralFunction) for name in wanted.spectrum.polarisation]
            ends = first["path_corners"]
            way = first["path_distance"]
            path = PathSpectra.of(
                spectra,
                ends,
                way,
                state.contact_lattice(),
                state.scales,
                list(map(np.array, wanted.path)),
                wanted.labels,
            )
        sent = [one for record in records if (one := read(record, "pulse", Pulse)) is not None]
        moved = (
            Motion.read(io.BytesIO(first[f"{_WHOLE}motion"].tobytes()))
            if f"{_WHOLE}motion" in first
            else None
        )
        return cls(
            read(first, "dos", SpectralDensity), path, average_pulses(sent) if sent else None, moved
        )

    @property
    def results(self) -> dict[str, Any]:
        """Results that exist, by the names of their files; each has :attr:`units`."""
        found = {
            "sample_dos": self.dos,
            "spectrum": self.spectra,
            "pulse": self.pulse,
            "motion": self.motion,
        }
        return {name: one for name, one in found.items() if one is not None}


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
    records: Sequence[Record], wanted: WaveSettings
) -> tuple[dict[str, Array], list[str]]:
    """Return the observables of waves of the samples at one load, by name, and notes on them.

    Standard errors are those over samples; a density of states of one sample has that of the random
    vectors.
    """
    out = dict[str, Array]()
    notes = list[str]()
    several = len(records) > 1
    if wanted.dos:
        from scipy.interpolate import CubicSpline

        # at the points of the sample whose frequencies reach highest; the densities of the others
        # are interpolated
        found = [one["dos"] for one in records]
        points = max((one[0] for one in found), key=lambda one: float(one[-1]))
        densities = [
            one[1:]
            if np.array_equal(one[0], points)
            else np.where(
                points <= one[0, -1],
                np.maximum(CubicSpline(one[0], one[1:], axis=1)(points), 0.0),
                0.0,
            )
            for one in found
        ]
        translational, rotational, own = np.mean(densities, axis=0)
        totals = [one[0] + one[1] for one in densities]
        out |= {
            "dos_frequency": points,
            "dos_total": translational + rotational,
            "dos_translational": translational,
            "dos_rotational": rotational,
            "dos_error": standard_error(np.array(totals), axis=0) if several else own,
        }
    if wanted.spectrum is not None:
        # peaks and widths are averaged; the other observables are those of the mean lines
        out |= {name: records[0][name] for name in ("path_corners", "path_distance", "wavenumber")}
        # samples, polarisations, (peak, width, resolved), wave vectors
        every = np.array([one["lines"] for one in records])
        q = out["wavenumber"]
        peak, width, resolved = np.moveaxis(np.mean(every, axis=0), 1, 0)
        velocity = 2.0 * np.pi * peak / q
        out |= {
            "line_frequency": peak,
            "line_width": width,
            "line_resolved": resolved,
            "phase_velocity": velocity,
            "attenuation": find_attenuation(velocity, width),
            "mean_free_path": find_mean_free_path(velocity, width),
        }
        if several:
            peaks = every[:, :, 0]
            widths = every[:, :, 1]
            out["line_frequency_error"] = standard_error(peaks, axis=0)
            out["line_width_error"] = standard_error(widths, axis=0)
            out["phase_velocity_error"] = 2.0 * np.pi * out["line_frequency_error"] / q
            out["attenuation_error"] = standard_error(
                find_attenuation(2.0 * np.pi * peaks / q, widths), axis=0
            )
        for number, name in enumerate(wanted.spectrum.polarisation):
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
            if several:
                out[f"ioffe_regel_{name}_error"] = np.array(_jackknife(q, every[:, number]))
    if wanted.pulse is not None:
        # pulses that could be read are averaged; notes say in how many samples they could not, and
        # why
        for name in _PULSE:
            each = np.array([float(one[name]) for one in records])
            known = each[np.isfinite(each)]
            if known.size:
                out[name] = np.array(np.mean(known))
            if name == "pulse_velocity" and known.size > 1:
                out["pulse_velocity_error"] = np.asarray(standard_error(known, axis=0))
        notes += dict.fromkeys(str(one["pulse_echo"]) for one in records if str(one["pulse_echo"]))
        if reasons := [str(one["pulse_note"]) for one in records if str(one["pulse_note"])]:
            where = f" in {len(reasons)} of {len(records)} samples" if several else ""
            rest = ", and the mean is that of the others" if len(reasons) < len(records) else ""
            notes.append(f"the arrival of the pulse is not known{where}{rest}: {reasons[0]}")
    for one in wanted.of_networks:
        _, average = RECORDS[one.block]
        means, said = average(records, one)
        out = out | means
        notes = notes + said
    return out, notes


def _jackknife(q: Array, lines: Array) -> float:
    """Return the standard error of the Ioffe-Regel frequency, Hz, as the lines (samples, 3, n) are
    left out one by one.

    It is nan where the lines that are left have none.
    """
    found = []
    for left in range(len(lines)):
        peak, width, _ = np.mean(np.delete(lines, left, axis=0), axis=0)
        with suppress(InputError):
            found.append(find_ioffe_regel(q, peak, width))
    unknown = len(found) < len(lines) or None in found
    return (
        math.nan if unknown else math.sqrt(len(lines) - 1) * float(np.std(np.array(found, float)))
    )
