"""Balls in motion at a list of times: positions, forces, energies, and the waves that the balls
make.
"""

from __future__ import annotations

import json
import math
import os
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, fields
from pathlib import Path
from typing import Annotated, Any, BinaryIO, Literal, Self

import numpy as np
from numpy.typing import ArrayLike, NDArray

from granphon.balls.lattices import one_direction
from granphon.base.arrays import Array, Index
from granphon.base.errors import InputError, OutputError, brief
from granphon.base.records import RecordFile, hold, read_records
from granphon.base.results import Result, plain, restore
from granphon.base.staging import explaining, put_beside
from granphon.base.validation import index_array, number, one_of, positive, require, whole_number
from granphon.networks.network import ContactNetwork

#: format and schema in a file of a motion
_ABOUT = {"format": "granphon motion", "schema": "1"}
#: readings of a pulse that passes a contact
_PASSAGES = ("peak", "front")
#: change of a force, over the greatest change, below which nothing has come to a contact
_STILL = 1e-3
#: change of a force, over the greatest force at rest, below which the change may be rounding
_ROUNDING = 1e-10
#: change of a force, N, that counts as none
_NO_CHANGE = 1e-300
#: least correlation of a line
_STRAIGHT = 0.9
#: greatest change of the slope of a line along it, over the slope: a signal that diffuses, t ~ x^2,
#: has a half between quarters of the distance
_BENT = 0.25
#: least number of frames in a period of the highest harmonic
_PER_PERIOD = 2.5
#: least height of the frames beside a maximum, over the maximum: then three frames lie within the
#: width of the pulse at half of its height. Frames about a shorter pulse show any motions that
#: follow, and not when the pulse passes
_FLANK = 0.5
#: most multiples and periods: no run has as many frames
_MOST_MULTIPLES = 10**9
#: with what the names of the network's arrays begin in a file
_OF_NETWORK = "network_"
#: content of a file to which no more can be written
_KEPT = "It holds the frames that came before"


@dataclass(frozen=True, eq=False, repr=False)
class Motion(Result):
    """Balls in motion, at a list of times. Vectors have three components; components along which
    balls do not move are zero.

    Attributes
    ----------
    times : (n_f,) s.
    displacements, velocities : (n_f, n, 3) from the places at rest, m, m/s. Velocities of balls
        that a drive moves are differences over two steps.
    rotations, spins : (n_f, n, 3) rad, rad/s.
    forces, shears : (n_f, n_c) normal force of each contact, zero where it is open, and size of its
        force of slip, N.
    translation, rotation : (n_f,) kinetic energies, J.
    stored : (n_f,) energy that contacts and the load have gained since rest, J.
    lost : (n_f,) energy that contacts have lost by friction, by dashpots, and by their law, as
        those that adhere do, J.
    work : (n_f,) of drives, J.
    step : s.
    network : the balls at rest, and their contacts.
    met : (n_m, 2) balls of contacts that came about beside those of the network: the last columns
        of ``forces``.
    """

    times: Annotated[Array, "f", "s"]
    displacements: Annotated[Array, "f n 3", "m"]
    velocities: Annotated[Array, "f n 3", "m/s"]
    rotations: Annotated[Array, "f n 3", "rad"]
    spins: Annotated[Array, "f n 3", "rad/s"]
    forces: Annotated[Array, "f c", "N"]
    shears: Annotated[Array, "f c", "N"]
    translation: Annotated[Array, "f", "J"]
    rotation: Annotated[Array, "f", "J"]
    stored: Annotated[Array, "f", "J"]
    lost: Annotated[Array, "f", "J"]
    work: Annotated[Array, "f", "J"]
    step: Annotated[float, "", "s"]
    network: ContactNetwork
    met: Annotated[Index, "m 2"] = field(default_factory=lambda: np.zeros((0, 2), np.intp))

    def __post_init__(self) -> None:
        # plain data do not keep the shape of an array without numbers
        object.__setattr__(self, "met", np.reshape(self.met, (-1, 2)))
        super().__post_init__()

    @classmethod
    def read(cls, path: str | os.PathLike[str] | BinaryIO, frames: slice = slice(None)) -> Self:
        """Return the motion in a file of a run or of :meth:`write`, or some of its ``frames``; the
        run may still go on.

        Arrays over frames stay in the file, as :class:`numpy.memmap`: frames are read when they are
        used, so that a motion may be larger than the memory. An open binary file is read at once.
        Of a file that was cut the whole frames are read, with a
        :class:`~granphon.base.errors.StoppedEarlyWarning`.

        Raises :class:`~granphon.base.errors.InputError` for a file that is not there, or that is of
        another kind or schema, and for ``frames`` that are none, or that run backwards.
        """
        if not isinstance(path, str | os.PathLike) and not hasattr(path, "read"):
            raise InputError(
                f"the file of a motion is {brief(path)}", mend="Give a path, or an open binary file"
            )
        _require_forward(frames)
        values, about = read_records(path, _ABOUT, frames)
        # a file that lacks times is damaged, which is found below
        if not len(values.get("times", [0])):
            raise InputError(
                f"frames is {brief(frames)}, and the file has none of them", mend="Give others"
            )
        try:
            network = _read_network(values, about)
            values = {
                name: array for name, array in values.items() if not name.startswith(_OF_NETWORK)
            }
            # a file of a motion without contacts that came about has no such array
            met: Any = values.pop("met", np.zeros((0, 2))).astype(np.intp)
            motion = cls(**values, network=network, met=met, step=float(about["step"]))
            motion._check()
        except (KeyError, TypeError, ValueError) as error:
            raise InputError(
                f"the file of a motion is damaged: {error}", mend="Run again"
            ) from None
        return motion

    def write(self, path: str | os.PathLike[str] | BinaryIO) -> None:
        """Write a netCDF file, or to an open binary file, for :meth:`read`. A motion at the path is
        replaced.

        Raises :class:`~granphon.base.errors.InputError` for what is no path, and
        :class:`~granphon.base.errors.OutputError` where something else than a motion is there, or
        cannot be written.
        """
        if not hasattr(path, "write"):
            _require_writable(path)
            with put_beside(Path(path)) as beside, open(beside, "wb") as stream:
                self.write(stream)
            return
        file = _begin_file(path, self.network, self.step, self.met, self._take_frame(0))
        for frame in range(len(self.times)):
            file.append(self._take_frame(frame))

    def _take_frame(self, frame: int) -> dict[str, Any]:
        """Return the values of all fields over frames in one of these."""
        names = [name for name, layout in self._shapes.items() if layout[0] == "f"]
        return {name: getattr(self, name)[frame] for name in names}

    @property
    def energy(self) -> Array:
        """(n_f,) kinetic and stored energy, J."""
        return self.translation + self.rotation + self.stored

    @property
    def positions(self) -> Array:
        """(n_f, n, 3) where the balls are, m."""
        return self.network.positions + self.displacements

    @property
    def middles(self) -> Array:
        """(n_c + n_met, 3) where the contacts are at rest, m: those of the network, then those that
        were met. Body j of a contact may be a wall.
        """
        network = self.network
        i, j = self.met.T
        start = network.positions[i]
        periods = network.cell[list(network.pbc)]
        vectors = network.positions[j] - start
        cells = np.rint(vectors @ np.linalg.pinv(periods))
        met_places = start + 0.5 * (vectors - cells @ periods)  # to the nearest image
        for wall, (point, inward) in network.walls.items():
            # a ball touches a flat wall at the foot of the perpendicular from its centre
            touches = j == wall
            heights = (point - start[touches]) @ inward
            met_places[touches] = start[touches] + np.outer(heights, inward)
        return np.concatenate([network.contact_places, met_places])

    def peaks(self) -> tuple[Array, Array]:
        """Return the times, s, and the heights, N, of the greatest normal force of each contact,
        each (n_c,).

        Both are those of a parabola through the greatest frame and its neighbours; where the first
        or the last frame is the greatest, those of that frame.
        """
        return self._find_tops(np.argmax(self.forces, axis=0))

    def _find_tops(self, frames: Index) -> tuple[Array, Array]:
        """Return times and heights of parabolas through the forces of contacts at ``frames`` (n_c,)
        and beside them.
        """
        last = len(self.times) - 1
        contacts = np.arange(self.forces.shape[1])
        previous = np.maximum(frames - 1, 0)
        following = np.minimum(frames + 1, last)
        low = self.forces[previous, contacts]
        most = self.forces[frames, contacts]
        high = self.forces[following, contacts]
        # differences first: a change by rounding then makes neither of the two zero
        bend = (low - most) + (high - most)
        tilt = low - high
        is_inside = following == previous + 2
        shift = np.divide(0.5 * tilt, bend, out=np.zeros_like(bend), where=is_inside)
        steps = self.times[following] - self.times[previous]
        return self.times[frames] + 0.5 * shift * steps, most - 0.25 * tilt * shift

    def arrivals(self, share: float = 0.5) -> Array:
        """Return the times, (n_c,), s, at which each force has changed by the part ``share`` of its
        first great change.

        That is the first maximum of the change with at least half of the greatest, so that a later
        echo does not count; or the greatest change, if it has no such maximum. Times between frames
        are interpolated linearly; the time is infinite where a force does not change.
        """
        share = require("share", lambda value: number(value, 1e-9, 1.0), share)
        change = np.abs(self.forces - self.forces[0])
        first = _find_first_maxima(change)
        top = np.where(first > 0, first, np.argmax(change, axis=0))
        contacts = np.arange(change.shape[1])
        level = share * change[top, contacts]
        following = np.clip(np.argmax(change >= level, axis=0), min(1, len(change) - 1), None)
        low = change[following - 1, contacts]
        high = change[following, contacts]
        fraction = np.divide(level - low, high - low, out=np.zeros_like(level), where=high > low)
        start = self.times[following - 1]
        times = start + fraction * (self.times[following] - start)
        return np.where(level > 0.0, times, np.inf)

    def passages(self, of: Literal["peak", "front"] = "peak", share: float = 0.5) -> Array:
        """Return the times, (n_c,), s, at which a pulse passes each contact: by its peak, or its
        front.

        The peak is the first maximum of the force above that at the start, with at least half of
        the greatest; the front is where the force has the part ``share`` of its first great change,
        as in :meth:`arrivals`. nan where hardly anything comes, where the force has no such
        maximum, as where it still rises at the end, and where a frame beside the maximum has less
        than half of its height: so few frames do not tell when the pulse passes.
        """
        times, is_resolved = self._find_passages(of, share)
        return np.where(is_resolved, times, np.nan)

    def _find_passages(
        self, of: Literal["peak", "front"], share: float
    ) -> tuple[Array, NDArray[np.bool_]]:
        """Return times (n_c,) as of :meth:`passages`, however few the frames, and whether these
        resolve the pulse.
        """
        rise = self.forces - self.forces[0]
        change = np.abs(rise)
        least = max(
            _STILL * float(change.max(initial=0.0)),
            _ROUNDING * float(self.forces[0].max(initial=0.0)),
            _NO_CHANGE,
        )
        height = rise if one_of("of", of, _PASSAGES) == "peak" else change
        first = _find_first_maxima(height)
        is_known = (change.max(axis=0, initial=0.0) > least) & (first > 0)
        times = self._find_tops(first)[0] if of == "peak" else self.arrivals(share)
        # contacts without a maximum have the frames of the start, and their times are not known
        previous = np.maximum(first - 1, 0)
        following = np.minimum(first + 1, len(height) - 1)
        contacts = np.arange(first.size)
        flank = np.minimum(height[previous, contacts], height[following, contacts])
        return np.where(is_known, times, np.nan), flank >= _FLANK * height[first, contacts]

    def pulse_velocity(
        self,
        contacts: Sequence[int],
        direction: ArrayLike | None = None,
        of: Literal["peak", "front"] = "peak",
        share: float | None = None,
    ) -> float:
        """Return the velocity, m/s, at which a pulse, by its peak or its front, :meth:`passes
        <passages>` ``contacts``.

        The front is where the force has the part ``share`` of its first great change, by default
        half. A straight line is fitted to distances over times (:func:`fit_velocity`). Distances
        are along the ``direction`` (3,), by default from the first contact to the last. Raises
        :class:`~granphon.base.errors.InputError` for fewer than two contacts, for a contact that
        the pulse does not pass within the run, for fewer than three frames within the width of the
        pulse at half of its height, for contacts that the pulse does not reach one after another
        along a straight line, and for a ``share`` of a peak.
        """
        chosen = index_array("contacts", contacts, self.forces.shape[1], "contacts")
        if chosen.size < 2:
            raise InputError(f"contacts are {brief(contacts)}", mend="Give two or more")
        if one_of("of", of, _PASSAGES) == "peak" and share is not None:
            raise InputError(
                f"share is {brief(share)}, and a peak has none", mend='Give of="front" too'
            )
        places = self.middles[chosen] - self.middles[chosen[0]]
        if direction is None and not np.any(places[-1]):
            raise InputError(
                f"contacts {brief(contacts)} begin and end at one place",
                mend="Give contacts along a way",
            )
        along = one_direction(places[-1] if direction is None else direction, 3)
        times, is_resolved = self._find_passages(of, 0.5 if share is None else share)
        times = times[chosen]
        self._require_passed(chosen, times, is_resolved[chosen])
        velocity, reason = fit_velocity(places @ along, times)
        if reason:
            mend = (
                "Give contacts in the order in which it comes to them, on one side of where it"
                " begins"
            )
            raise InputError(f"the pulse has no velocity along these contacts: {reason}", mend=mend)
        return velocity

    def _require_passed(
        self, contacts: Index, times: Array, is_resolved: NDArray[np.bool_]
    ) -> None:
        """Raise :class:`~granphon.base.errors.InputError` unless a pulse passes ``contacts`` (n,)
        at known ``times`` (n,), s, which frames resolve.
        """
        missed = contacts[np.isnan(times)]
        if missed.size:
            fault = f"the pulse does not pass contact {missed[0]}"
            further = f", nor {missed.size - 1} others" if missed.size > 1 else ""
            why = "Its force does not change much, or still rises at the end"
            mend = "Run for longer, keep more frames, or give contacts that it has passed"
            raise InputError(fault + further, why, mend)
        unresolved = contacts[~is_resolved]
        if unresolved.size:
            step = float(self.times[1] - self.times[0])
            fault = (
                f"the pulse at contact {unresolved[0]} is too short for frames {step:.3g} s apart"
            )
            why = "Fewer than three are within its width at half of its height"
            raise InputError(fault, why, "Keep more frames")

    def spectrum(self, ball: int, axis: int = 0) -> tuple[Array, Array]:
        """Return frequencies, Hz, and amplitudes, m, of the displacement of a ball along an
        ``axis``, each (n_f//2 + 1,).

        The mean is left out. A Hann window keeps frequencies apart; the amplitude is that of a
        steady motion at a frequency of the list, to 1 % from the second above zero to the third
        from the end. Raises
        :class:`~granphon.base.errors.InputError` for fewer than four frames.
        """
        ball = whole_number("ball", ball, 0, self.network.n_balls - 1)
        axis = whole_number("axis", axis, 0, 2)
        values = self.displacements[:, ball, axis]
        if len(values) < 4:
            raise InputError(f"{len(values)} frames have no spectrum", mend="Keep more frames")
        window = np.hanning(len(values))
        weighed = window * (values - np.average(values, weights=window))
        interval = float(self.times[1] - self.times[0])
        frequencies = np.asarray(np.fft.rfftfreq(len(values), interval), float)
        return frequencies, 2.0 / np.sum(window) * np.abs(np.fft.rfft(weighed))

    def harmonics(
        self, frequency: float, count: int = 3, axis: int = 0, periods: int = 10
    ) -> NDArray[np.complex128]:
        """Return the amplitudes of a steady motion at multiples of its ``frequency``, Hz: (count,
        n) complex, m.

        Re sum_m a_m exp(-2 pi i m f t) and a mean are fitted to displacements along an ``axis`` in
        the last ``periods``. Raises :class:`~granphon.base.errors.InputError` if the run has fewer
        periods, or if a period of the highest multiple has fewer than 2.5 frames.
        """
        f = positive("frequency", frequency, "Hz")
        frames = len(self.times)
        most = whole_number("count", count, 1, _MOST_MULTIPLES)
        fitted_to = whole_number("periods", periods, 1, _MOST_MULTIPLES)
        along = whole_number("axis", axis, 0, 2)
        run_periods = float(self.times[-1] - self.times[0]) * f
        frames_per_period = (frames - 1) / (run_periods * most) if run_periods > 0.0 else 0.0
        if fitted_to > run_periods * (1.0 + 1e-9) or frames_per_period < _PER_PERIOD:
            fault = (
                f"{frames_per_period:.3g} frames are in a period of multiple {most}, and"
                f" {run_periods:.3g} periods in the run"
            )
            raise InputError(
                fault, mend="Run for longer, keep more frames, or ask for fewer multiples"
            )
        last = self.times > self.times[-1] - fitted_to / f * (1.0 + 1e-9)
        angle = 2.0 * np.pi * f * self.times[last, None] * np.arange(1, most + 1)
        terms = np.hstack([np.ones((len(angle), 1)), np.cos(angle), np.sin(angle)])
        fitted: Any = np.linalg.lstsq(terms, self.displacements[last, :, along], rcond=None)[0]
        return np.asarray(fitted[1 : most + 1] + 1j * fitted[most + 1 :])


def _find_first_maxima(values: Array) -> Index:
    """Return the frames (n_c,) of the first maxima of ``values`` (n_f, n_c) with half of the
    greatest; 0 without one.
    """
    if len(values) < 3:
        return np.zeros(values.shape[1], np.intp)
    inner = values[1:-1]
    is_top = (inner > values[:-2]) & (inner >= values[2:])
    is_top &= (inner >= 0.5 * values.max(axis=0, initial=0.0)) & (inner > 0.0)
    return np.where(np.any(is_top, axis=0), 1 + np.argmax(is_top, axis=0), 0)


def fit_velocity(distances: Array, times: Array) -> tuple[float, str]:
    """Return the slope of the line of least squares of distances, m, over times, s, and an empty
    text.

    Without a straight line that rises the slope is nan, and the text says why: times do not grow
    with the distance, scatter about the line (correlation of :data:`_STRAIGHT` or less), or lie on
    a line that bends, as those of a signal that diffuses.
    """
    covariances = np.cov(times, distances)
    of_times = covariances[0, 0]
    of_distances = covariances[1, 1]
    of_both = covariances[0, 1]
    if not of_both > 0.0:
        return math.nan, "it comes no later to those that are farther away"
    if not of_both > _STRAIGHT * math.sqrt(of_times * of_distances):
        return math.nan, "times scatter about a straight line"
    far = float(np.max(np.abs(distances)))
    if len(np.unique(np.round(distances / far, 9))) > 3:
        curve, slope, _ = np.polyfit((distances - np.mean(distances)) / far, times, 2)
        if not abs(curve) * np.ptp(distances) / far <= _BENT * abs(slope):
            return math.nan, "distances over times are no straight line"
    return float(of_both / of_times), ""


def _require_forward(frames: Any) -> None:
    """Raise :class:`~granphon.base.errors.InputError` unless ``frames`` is a slice that does not
    run backwards.
    """
    is_slice = isinstance(frames, slice)
    if not is_slice or (isinstance(frames.step, int) and frames.step < 0):
        raise InputError(f"frames is {brief(frames)}", mend="Give a slice, such as slice(0, 10)")


def _read_network(values: Mapping[str, Any], about: Mapping[str, str]) -> ContactNetwork:
    """Return the network of a motion, of the arrays and the plain values of its file."""
    arrays: dict[str, Any] = {
        name.removeprefix(_OF_NETWORK): array
        for name, array in values.items()
        if name.startswith(_OF_NETWORK)
    }
    for name in ("i", "j", "shift", "labels"):
        if name in arrays:
            arrays[name] = arrays[name].astype(np.intp)
    plain_values = json.loads(about["network"])
    data = {"class": "ContactNetwork", **plain_values, **arrays}
    network: ContactNetwork = restore(data, ContactNetwork)
    return network


class Frames:
    """The frames of a run as they come, in memory or in a file; a context.

    Parameters
    ----------
    network : the balls at rest.
    step : s.
    path : of the file, or None.
    """

    def __init__(self, network: ContactNetwork, step: float, path: Any) -> None:
        if path is not None:
            _require_writable(path)
        self._network = network
        self._step = step
        self._path = None if path is None else Path(path)
        self._columns: dict[tuple[int, ...], int] = {}
        self._frames: list[dict[str, Any]] = []
        self._file: RecordFile | None = None
        self._count = 0
        self.last_time = 0.0

    def __len__(self) -> int:
        return self._count

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        if self._file is not None and self._path is not None:
            with explaining(self._path, _KEPT):
                self._file.close()

    def keep(
        self, frame: Mapping[str, Any], forces: Array, shears: Array, met: Sequence[tuple[int, ...]]
    ) -> None:
        """Keep a frame. Contacts beyond those of the network, ``met`` (i, j, shift), get a column
        when they first push.
        """
        base = self._network.n_contacts
        has_new = False
        for pair, force in zip(met, forces[base:], strict=True):
            if force and pair not in self._columns:
                self._columns[pair] = base + len(self._columns)
                has_new = True
        whole: dict[str, Any] = dict(frame)
        whole["forces"] = self._lay_out(forces, met)
        whole["shears"] = self._lay_out(shears, met)
        if self._path is None:
            self._frames.append(whole)
        elif self._file is not None and not has_new:
            with explaining(self._path, _KEPT):
                self._file.append(whole)
        else:
            self._begin_again(self._path, whole)
        self._count = self._count + 1
        self.last_time = float(frame["times"])  # last, as Ctrl-C may come before a frame is kept

    def _lay_out(self, values: Array, met: Sequence[tuple[int, ...]]) -> Array:
        """Return ``values`` of the contacts of the network, and then of ``met`` ones, in the
        columns of contacts.
        """
        base = self._network.n_contacts
        row = np.append(values[:base], np.zeros(len(self._columns)))
        for pair, value in zip(met, values[base:], strict=True):
            if pair in self._columns:
                row[self._columns[pair]] = value
        return row

    def _begin_again(self, path: Path, frame: Mapping[str, Any]) -> None:
        """Write the frames so far, and a ``frame`` with more columns, into a new file, as the
        number of columns of a file is fixed.

        The new file is written beside the earlier one, and then replaces it.
        """
        earlier = dict[str, Any]()
        shapes = {name: np.shape(values) for name, values in frame.items()}
        if self._file is not None:
            self._file.close()
            earlier = read_records(path, _ABOUT)[0]
        with put_beside(path) as beside:
            self._file = _begin_file(beside, self._network, self._step, self._met, frame)
            for row in range(self._count):
                padded = {name: _pad(earlier[name][row], shapes[name]) for name in frame}
                self._file.append(padded)
            self._file.append(frame)
            del earlier  # some systems do not replace a file that is in use

    @property
    def _met(self) -> Index:
        """(n_m, 2) balls of the contacts that came about beside those of the network."""
        return np.array([pair[:2] for pair in self._columns], np.intp).reshape(-1, 2)

    def join(self) -> Motion:
        """Return all frames."""
        if self._path is not None:
            return Motion.read(self._path)
        last = self._frames[-1]
        stacked: dict[str, Any] = {}
        for name in last:
            shape = np.shape(last[name])
            stacked[name] = np.array([_pad(frame[name], shape) for frame in self._frames])
        return Motion(**stacked, network=self._network, met=self._met, step=self._step)


def _require_writable(path: Any) -> None:
    """Raise unless a motion may be written to a path: no file exists, or a motion that nobody is
    writing.
    """
    if not isinstance(path, str | os.PathLike) or not os.fspath(path) or "\0" in str(path):
        raise InputError(f"the file of a motion is {brief(path)}", mend="Give a path")
    if os.path.exists(path):
        try:
            read_records(path, _ABOUT)
        except InputError:
            raise OutputError(
                f"{os.fspath(path)} is there, and is no motion of granphon", mend="Give another"
            ) from None
        with open(path, "rb") as file:
            hold(file)


def _begin_file(
    path: Any, network: ContactNetwork, step: float, met: Index, frame: Mapping[str, Any]
) -> RecordFile:
    """Return a file of a motion, without frames, for frames like ``frame``."""
    network = network.storable()
    values = {entry.name: getattr(network, entry.name) for entry in fields(network)}
    arrays = {name: value for name, value in values.items() if isinstance(value, np.ndarray)}
    plain_values = {name: plain(value) for name, value in values.items() if name not in arrays}
    fixed = {
        _OF_NETWORK + name: (value, _name_axes(name, ContactNetwork))
        for name, value in arrays.items()
    }
    if len(met):  # a dimension of no length would be the one that grows
        fixed["met"] = (met, _name_axes("met", Motion))
    growing = {
        name: (np.shape(value), _name_axes(name, Motion)[1:]) for name, value in frame.items()
    }
    network_units = {_OF_NETWORK + name: unit for name, unit in ContactNetwork.units.items()}
    units = Motion.units | network_units
    return RecordFile(
        path,
        fixed,
        growing,
        units,
        _ABOUT | {"network": json.dumps(plain_values), "step": repr(step)},
    )


def _name_axes(name: str, owner: type[Result]) -> tuple[str, ...]:
    """Return names of the axes of a field in a file."""
    names = {"f": "time", "n": "ball", "c": "contact", "3": "axis", "m": "met", "2": "end"}
    if owner is ContactNetwork:
        names["c"] = "network_contact"
    letters = owner._shapes[name].rstrip("?").split()
    return tuple(names[letter] for letter in letters)


def _pad(values: Any, shape: tuple[int, ...]) -> Array:
    """Return an array of a ``shape``, with zeros behind the ``values``."""
    if np.shape(values) == shape:
        return np.asarray(values, float)
    out = np.zeros(shape)
    out[tuple(slice(size) for size in np.shape(values))] = values
    return out
