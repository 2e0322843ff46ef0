"""Balls in motion at a list of times: positions, forces, energies, and the waves that the balls
make.
"""

from __future__ import annotations

import json
import math
import os
from collections.abc import Mapping, Sequence
from dataclasses import fields, replace
from functools import cached_property
from pathlib import Path
from typing import Any, BinaryIO, Literal, Self

import numpy as np
from numpy.typing import ArrayLike, NDArray

from granphon.balls.lattices import one_direction
from granphon.base.arrays import Array, Index
from granphon.base.errors import InputError, OutputError, brief
from granphon.base.records import RecordFile, hold, read_records
from granphon.base.results import Result, held, plain, restore, result_class
from granphon.base.staging import explaining, put_beside
from granphon.base.validation import (
    index_array,
    is_one_of,
    number,
    one_of,
    positive,
    require,
    whole_number,
)
from granphon.networks.network import ContactNetwork
from granphon.waves.sensors import FLOOR, SensorPlaces, find_open_axis, is_contact

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
#: relative rounding of times: a run of ten periods has ten periods
_TIME_ROUNDING = 1e-9
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


@result_class
class Motion(Result):
    """Balls in motion, at a list of times. Vectors have three components; components along which
    balls do not move are zero.

    Attributes
    ----------
    times : (n_f,) s.
    displacements, velocities : (n_f, n, 3) from the places at rest, m, m/s. Velocities of balls
        that a drive moves are differences over two steps, over one at the start, and at the end if
        the drive is no number later.
    rotations, spins : (n_f, n, 3) rad, rad/s.
    forces, shears : (n_f, n_c) normal force of each contact, zero where it is open, and size of its
        force of slip, N.
    translation, rotation : (n_f,) kinetic energies, J.
    stored : (n_f,) energy that contacts and the load have gained since rest, J.
    lost : (n_f,) energy that contacts have lost by friction, by dashpots, and by their law, as
        those that adhere do, and balls by drag, J.
    work : (n_f,) of drives, J.
    step : s.
    network : the balls at rest, and their contacts.
    met : (n_m, 2) balls of contacts that came about beside those of the network: the last columns
        of ``forces``.
    """

    times: Array = held(float, "f", "s")
    displacements: Array = held(float, "f n 3", "m")
    velocities: Array = held(float, "f n 3", "m/s")
    rotations: Array = held(float, "f n 3", "rad")
    spins: Array = held(float, "f n 3", "rad/s")
    forces: Array = held(float, "f c", "N")
    shears: Array = held(float, "f c", "N")
    translation: Array = held(float, "f", "J")
    rotation: Array = held(float, "f", "J")
    stored: Array = held(float, "f", "J")
    lost: Array = held(float, "f", "J")
    work: Array = held(float, "f", "J")
    step: float = held(float, unit="s")
    network: ContactNetwork = held(ContactNetwork)
    met: Index = held(int, "m 2", default_factory=lambda: np.zeros((0, 2), np.intp))

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

        Raises :class:`~granphon.base.errors.InputError` for a file that is not there, that is of
        another kind or schema, or that is damaged, and for ``frames`` that are none, or that run
        backwards.
        """
        if not isinstance(path, str | os.PathLike) and not hasattr(path, "read"):
            raise InputError(
                f"the file of a motion is {brief(path)}", mend="Give a path, or an open binary file"
            )
        _require_forward(frames)
        arrays, about = read_records(path, _ABOUT, frames)
        # a file that lacks times is damaged: the field that is missing is an error below
        if "times" in arrays and not len(arrays["times"]):
            raise InputError(
                f"frames is {brief(frames)}, and the file has none of them", mend="Give others"
            )
        try:
            network = _read_network(arrays, about)
            fields_of_motion = {
                name: array for name, array in arrays.items() if not name.startswith(_OF_NETWORK)
            }
            # a file of a motion without contacts that came about has no such array
            met: Any = fields_of_motion.pop("met", np.zeros((0, 2))).astype(np.intp)
            motion = cls(**fields_of_motion, network=network, met=met, step=float(about["step"]))
            motion._check()
        except (KeyError, TypeError, ValueError) as error:
            raise InputError(
                f"the file of a motion is damaged: {error}", mend="Run again"
            ) from None
        return motion

    def write(self, path: str | os.PathLike[str] | BinaryIO) -> None:
        """Write the motion into a netCDF file at the path, or into an open binary file that can
        seek, for :meth:`read`. A motion that is at the path is replaced.

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
        """Return the values in one frame, by name, of all fields whose first axis is the frames."""
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
        """(n_c + n_met, 3) positions of the contacts at rest, m: those of the network, then those
        that were met. Body j of a contact may be a wall.
        """
        network = self.network
        i, j = self.met.T
        centres = network.positions[i]
        periods = network.cell[list(network.pbc)]
        vectors = network.positions[j] - centres
        cells = np.rint(vectors @ np.linalg.pinv(periods))
        to_nearest_image = vectors - cells @ periods
        met_positions = centres + 0.5 * to_nearest_image
        for wall, (point, inward) in network.walls.items():
            # a ball touches a flat wall at the foot of the perpendicular from its centre
            touches = j == wall
            distances = (point - centres[touches]) @ inward
            met_positions[touches] = centres[touches] + np.outer(distances, inward)
        return np.concatenate([network.contact_places, met_positions])

    def sensor(self, receiver: Any, direction: ArrayLike | None = None) -> Array:
        """Return the force that a sensor reads at all times, (n_f,) N.

        Parameters
        ----------
        receiver : a ball with a sensor in it, by its number: half of the sum of the normal forces
            of its contacts, each times the cosine of its normal at rest and the ``direction``, so
            the mean of two contacts of a chain. A body that is held bears the whole sum, as "floor"
            does, the one flat wall. Or the balls (i, j) of a contact.
        direction : (3,) axis of the sensor; by default the first axis along which the network does
            not repeat, or x, and of a flat wall its normal.

        Forces are those of springs: what dashpots add is not in :attr:`forces`. Raises
        :class:`~granphon.base.errors.InputError` for bodies that are not there, two balls without a
        contact or with several, a ball without a contact along the direction, and no floor, or
        several.
        """
        places = self._sensor_places
        if is_contact(receiver):
            chosen = places.at_contact(*receiver)
        elif is_one_of(receiver, (FLOOR,)):
            chosen = places.in_floor()
        else:
            body = whole_number("receiver", receiver, 0, self.network.n_balls - 1)
            axis = places.walls.get(body, find_open_axis(self.network))
            if direction is not None:
                axis = one_direction(direction, 3)
            chosen = places.in_body(body, axis)
        return np.asarray(self.forces[:, chosen.contacts] @ chosen.weights)

    @cached_property
    def _sensor_places(self) -> SensorPlaces:
        """Contacts of the network, and those that came about beside these, as they are at rest."""
        network = self.network
        of_network = SensorPlaces.of(network)
        i, j = self.met.T
        arms = self.middles[network.n_contacts :] - network.positions[i]
        lengths = np.linalg.norm(arms, axis=1, keepdims=True)
        return replace(
            of_network,
            i=np.append(of_network.i, i),
            j=np.append(of_network.j, j),
            normal=np.concatenate([of_network.normal, arms / lengths]),
        )

    def peaks(self) -> tuple[Array, Array]:
        """Return the times, s, and the heights, N, of the greatest normal force of each contact,
        each (n_c,).

        Both are those of a parabola through the greatest frame and its neighbours; where the first
        or the last frame is the greatest, those of that frame.
        """
        return self._find_tops(np.argmax(self.forces, axis=0))

    def _find_tops(self, frames: Index) -> tuple[Array, Array]:
        """Return the times (n_c,), s, and heights (n_c,), N, of the tops of parabolas through the
        forces of contacts at ``frames`` (n_c,) and at the frames beside these; of the first and the
        last frame, which lack one, the time and the force of the frame.
        """
        last = len(self.times) - 1
        contacts = np.arange(self.forces.shape[1])
        previous = np.maximum(frames - 1, 0)
        following = np.minimum(frames + 1, last)
        force_before = self.forces[previous, contacts]
        force = self.forces[frames, contacts]
        force_after = self.forces[following, contacts]
        # differences first: a change by rounding then makes neither of the two zero
        curvature = (force_before - force) + (force_after - force)
        fall = force_before - force_after
        is_inside = following == previous + 2  # a frame is on both sides
        # the top is this part of a step after the frame
        shift = np.divide(0.5 * fall, curvature, out=np.zeros_like(curvature), where=is_inside)
        two_steps = self.times[following] - self.times[previous]
        return self.times[frames] + 0.5 * shift * two_steps, force - 0.25 * fall * shift

    def arrivals(self, share: float = 0.5) -> Array:
        """Return the times, (n_c,), s, at which each force has changed by the part ``share`` of its
        first great change.

        The first great change is the first maximum of the change with at least half of the
        greatest, so that a later echo does not count; or the greatest change, if the change has no
        such maximum. Times between frames are interpolated linearly; the time is infinite where a
        force does not change. Raises :class:`~granphon.base.errors.InputError` for a ``share`` that
        is below 1e-9, or above 1.
        """
        share = require("share", lambda value: number(value, 1e-9, 1.0), share)
        change = np.abs(self.forces - self.forces[0])
        first_maximum = _find_first_maxima(change)
        great_change = np.where(first_maximum > 0, first_maximum, np.argmax(change, axis=0))
        contacts = np.arange(change.shape[1])
        level = share * change[great_change, contacts]
        # the frame that reaches the level first, and the one before it
        reaches_level = np.argmax(change >= level, axis=0)
        following = np.clip(reaches_level, min(1, len(change) - 1), None)
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
        """Return times (n_c,), s, as of :meth:`passages`, however few the frames, and whether the
        frames resolve the pulse at each contact (n_c,).
        """
        rise = self.forces - self.forces[0]
        change = np.abs(rise)
        least_change = max(
            _STILL * float(change.max(initial=0.0)),
            _ROUNDING * float(self.forces[0].max(initial=0.0)),
            _NO_CHANGE,
        )
        height = rise if one_of("of", of, _PASSAGES) == "peak" else change
        maximum = _find_first_maxima(height)  # its frame; 0 without one
        is_known = (change.max(axis=0, initial=0.0) > least_change) & (maximum > 0)
        if of == "peak":
            times, _ = self._find_tops(maximum)
        else:
            times = self.arrivals(share)
        # contacts without a maximum have the frames of the start, and their times are not known
        previous = np.maximum(maximum - 1, 0)
        following = np.minimum(maximum + 1, len(height) - 1)
        contacts = np.arange(maximum.size)
        flank = np.minimum(height[previous, contacts], height[following, contacts])
        is_resolved = flank >= _FLANK * height[maximum, contacts]
        return np.where(is_known, times, np.nan), is_resolved

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
        along a straight line, for a first and a last contact at one place without a ``direction``,
        and for a ``share`` of a peak.
        """
        chosen = index_array("contacts", contacts, self.forces.shape[1], "contacts")
        if chosen.size < 2:
            raise InputError(f"contacts are {brief(contacts)}", mend="Give two or more")
        if one_of("of", of, _PASSAGES) == "peak" and share is not None:
            raise InputError(
                f"share is {brief(share)}, and a peak has none", mend='Give of="front" too'
            )
        vectors = self.middles[chosen] - self.middles[chosen[0]]  # from the first contact, m
        if direction is None:
            direction = vectors[-1]
            if not np.any(direction):
                raise InputError(
                    f"contacts {brief(contacts)} begin and end at one place",
                    mend="Give contacts along a way",
                )
        unit_vector = one_direction(direction, 3)
        times, is_resolved = self._find_passages(of, 0.5 if share is None else share)
        times_of_chosen = times[chosen]
        self._require_passed(chosen, times_of_chosen, is_resolved[chosen])
        velocity, reason = fit_velocity(vectors @ unit_vector, times_of_chosen)
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
        displacements = self.displacements[:, ball, axis]
        n_frames = len(displacements)
        if n_frames < 4:
            raise InputError(f"{n_frames} frames have no spectrum", mend="Keep more frames")
        window = np.hanning(n_frames)
        mean = np.average(displacements, weights=window)
        windowed = window * (displacements - mean)
        interval = float(self.times[1] - self.times[0])
        frequencies = np.asarray(np.fft.rfftfreq(n_frames, interval), float)
        # half of the amplitude is at the negative frequency
        amplitudes = 2.0 / np.sum(window) * np.abs(np.fft.rfft(windowed))
        return frequencies, amplitudes

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
        n_multiples = whole_number("count", count, 1, _MOST_MULTIPLES)
        n_periods = whole_number("periods", periods, 1, _MOST_MULTIPLES)
        axis = whole_number("axis", axis, 0, 2)
        self._require_periods(f, n_multiples, n_periods)
        is_fitted = self.times > self.times[-1] - n_periods / f * (1.0 + _TIME_ROUNDING)
        multiples = np.arange(1, n_multiples + 1)
        angles = 2.0 * np.pi * f * self.times[is_fitted, None] * multiples
        # (frames, 1 + 2 count): a mean, cosines and sines
        terms = np.hstack([np.ones((len(angles), 1)), np.cos(angles), np.sin(angles)])
        coefficients: Any
        coefficients, *_ = np.linalg.lstsq(
            terms, self.displacements[is_fitted, :, axis], rcond=None
        )
        cosines = coefficients[1 : n_multiples + 1]
        sines = coefficients[n_multiples + 1 :]
        return np.asarray(cosines + 1j * sines)

    def _require_periods(self, frequency: float, n_multiples: int, n_periods: int) -> None:
        """Raise :class:`~granphon.base.errors.InputError` unless the run has ``n_periods`` of the
        ``frequency``, Hz, and enough frames in a period of its highest multiple.
        """
        run_periods = float(self.times[-1] - self.times[0]) * frequency
        frames_per_period = 0.0
        if run_periods > 0.0:
            frames_per_period = (len(self.times) - 1) / (run_periods * n_multiples)
        is_too_short = n_periods > run_periods * (1.0 + _TIME_ROUNDING)
        if is_too_short or frames_per_period < _PER_PERIOD:
            fault = (
                f"{frames_per_period:.3g} frames are in a period of the highest multiple,"
                f" {n_multiples}, and {run_periods:.3g} periods in the run"
            )
            why = f"{_PER_PERIOD:g} and {n_periods} are needed"
            mend = "Run for longer, keep more frames, or ask for fewer periods or multiples"
            raise InputError(fault, why, mend)


def _find_first_maxima(heights: Array) -> Index:
    """Return the frame (n_c,) of the first maximum of the ``heights`` (n_f, n_c) of each contact
    that is at least half as high as the greatest height; 0 without such a maximum.
    """
    if len(heights) < 3:
        return np.zeros(heights.shape[1], np.intp)
    inner = heights[1:-1]
    is_maximum = (inner > heights[:-2]) & (inner >= heights[2:])
    is_high = (inner >= 0.5 * heights.max(axis=0, initial=0.0)) & (inner > 0.0)
    is_high_maximum = is_maximum & is_high
    first = 1 + np.argmax(is_high_maximum, axis=0)  # inner frames begin with frame 1
    return np.where(np.any(is_high_maximum, axis=0), first, 0)


def fit_velocity(distances: Array, times: Array) -> tuple[float, str]:
    """Return the slope, m/s, of the line of least squares of distances (n,), m, over times (n,), s,
    and an empty text.

    Without a straight line that rises the slope is nan, and the text says why: times do not grow
    with the distance, scatter about the line (correlation of :data:`_STRAIGHT` or less), or lie on
    a line that bends, as those of a signal that diffuses.
    """
    # conditions are written so that nan fails them
    covariances = np.cov(times, distances)
    time_variance = covariances[0, 0]
    distance_variance = covariances[1, 1]
    covariance = covariances[0, 1]
    if not covariance > 0.0:
        return math.nan, "it comes no later to contacts that are farther away"
    if not covariance > _STRAIGHT * math.sqrt(time_variance * distance_variance):
        return math.nan, "times scatter about a straight line"
    farthest = float(np.max(np.abs(distances)))
    n_distances = len(np.unique(np.round(distances / farthest, 9)))
    if n_distances > 3:  # a parabola goes through three points, whatever their scatter
        relative = (distances - np.mean(distances)) / farthest
        curve, slope, _ = np.polyfit(relative, times, 2)
        if not abs(curve) * np.ptp(distances) / farthest <= _BENT * abs(slope):
            return math.nan, "distances over times are no straight line"
    return float(covariance / time_variance), ""


def _require_forward(frames: Any) -> None:
    """Raise :class:`~granphon.base.errors.InputError` unless ``frames`` is a slice that does not
    run backwards.
    """
    is_slice = isinstance(frames, slice)
    if not is_slice or (isinstance(frames.step, int) and frames.step < 0):
        raise InputError(f"frames is {brief(frames)}", mend="Give a slice, such as slice(0, 10)")


def _read_network(arrays: Mapping[str, Any], about: Mapping[str, str]) -> ContactNetwork:
    """Return the network of a motion from the ``arrays`` of its file, by name, and from the texts
    ``about`` the file, whose "network" has the plain values of the network.
    """
    network_arrays: dict[str, Any] = {
        name.removeprefix(_OF_NETWORK): array
        for name, array in arrays.items()
        if name.startswith(_OF_NETWORK)
    }
    for name in ("i", "j", "shift", "labels"):  # whole numbers, of a type that the file chose
        if name in network_arrays:
            network_arrays[name] = network_arrays[name].astype(np.intp)
    plain_values = json.loads(about["network"])
    data = {"class": "ContactNetwork", **plain_values, **network_arrays}
    network: ContactNetwork = restore(data, ContactNetwork)
    return network


class Frames:
    """The frames of a run as they come, in memory or in a file; a context.

    Parameters
    ----------
    network : the balls at rest.
    step : of the integration, s.
    path : of the file; None to keep the frames in memory.
    """

    def __init__(self, network: ContactNetwork, step: float, path: Any) -> None:
        if path is not None:
            _require_writable(path)
        self._network = network
        self.step = step
        self._path = None if path is None else Path(path)
        # the column of each contact beside those of the network, by (i, j, shift)
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
        """Keep a ``frame``: the values of its fields by name, and the normal ``forces`` and the
        ``shears`` of contacts (n_c + n_m,), N: those of the network, then those of the contacts
        ``met`` (i, j, shift).

        A contact that was met gets a column when it first pushes.
        """
        n_contacts = self._network.n_contacts
        has_new_column = False
        for pair, force in zip(met, forces[n_contacts:], strict=True):
            if force and pair not in self._columns:
                self._columns[pair] = n_contacts + len(self._columns)
                has_new_column = True
        full_frame: dict[str, Any] = dict(frame)
        full_frame["forces"] = self._lay_out(forces, met)
        full_frame["shears"] = self._lay_out(shears, met)
        if self._path is None:
            self._frames.append(full_frame)
        elif self._file is None or has_new_column:
            self._begin_again(self._path, full_frame)
        else:
            with explaining(self._path, _KEPT):
                self._file.append(full_frame)
        self._count = self._count + 1
        self.last_time = float(frame["times"])  # last, as Ctrl-C may come before a frame is kept

    def _lay_out(self, forces: Array, met: Sequence[tuple[int, ...]]) -> Array:
        """Return the ``forces`` (n_c + n_m,) of the contacts of the network, and then of ``met``
        ones, in the order of the columns of a frame.
        """
        n_contacts = self._network.n_contacts
        row = np.append(forces[:n_contacts], np.zeros(len(self._columns)))
        for pair, force in zip(met, forces[n_contacts:], strict=True):
            if pair in self._columns:
                row[self._columns[pair]] = force
        return row

    def _begin_again(self, path: Path, frame: Mapping[str, Any]) -> None:
        """Write the frames so far, and a ``frame`` with more columns, into a new file, as the
        number of columns of a file is fixed; the first frame begins the first file.

        The new file is written beside the earlier one, and then takes its place; it stays open, and
        held, for the frames that follow.
        """
        earlier_arrays = dict[str, Any]()
        shapes = {name: np.shape(field_values) for name, field_values in frame.items()}
        if self._file is not None:
            self._file.close()
            earlier_arrays, _ = read_records(path, _ABOUT)
        with put_beside(path) as beside:
            self._file = _begin_file(beside, self._network, self.step, self._met, frame)
            for number in range(self._count):
                earlier_frame = {
                    name: _pad(earlier_arrays[name][number], shapes[name]) for name in frame
                }
                self._file.append(earlier_frame)
            self._file.append(frame)
            del earlier_arrays  # the earlier file is not read any more as another takes its place

    @property
    def _met(self) -> Index:
        """(n_m, 2) balls of the contacts that came about beside those of the network."""
        return np.array([pair[:2] for pair in self._columns], np.intp).reshape(-1, 2)

    def join(self) -> Motion:
        """Return all frames as one motion; frames from before a contact came about have zeros for
        the contact.
        """
        if self._path is not None:
            return Motion.read(self._path)
        last = self._frames[-1]
        arrays: dict[str, Any] = {}
        for name in last:
            shape = np.shape(last[name])
            arrays[name] = np.array([_pad(frame[name], shape) for frame in self._frames])
        return Motion(**arrays, network=self._network, met=self._met, step=self.step)


def _require_writable(path: Any) -> None:
    """Raise unless a motion may be written to a path: no file is there, or a motion that nobody is
    writing.

    Raises :class:`~granphon.base.errors.InputError` for what is no path, and
    :class:`~granphon.base.errors.OutputError` for a file that is no motion, or that another run is
    writing.
    """
    is_path = isinstance(path, str | os.PathLike)
    if not is_path or not os.fspath(path) or "\0" in str(path):
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
    """Return a new file of a motion at ``path``, without frames, for frames with the fields and
    shapes of ``frame``; ``met`` (n_m, 2) are the balls of contacts beside those of the network.
    """
    network = network.storable()
    network_fields = {entry.name: getattr(network, entry.name) for entry in fields(network)}
    fixed = {}  # arrays that do not grow with the frames, each with the names of its axes
    plain_values = {}
    for name, value in network_fields.items():
        if isinstance(value, np.ndarray):
            fixed[_OF_NETWORK + name] = (value, _name_axes(name, ContactNetwork))
        else:
            plain_values[name] = plain(value)
    if len(met):  # a dimension of no length would be the one that grows
        fixed["met"] = (met, _name_axes("met", Motion))
    growing = {
        name: (np.shape(value), _name_axes(name, Motion)[1:]) for name, value in frame.items()
    }
    network_units = {_OF_NETWORK + name: unit for name, unit in ContactNetwork.units.items()}
    units = Motion.units | network_units
    about = _ABOUT | {"network": json.dumps(plain_values), "step": repr(step)}
    return RecordFile(path, fixed, growing, units, about)


def _name_axes(name: str, owner: type[Result]) -> tuple[str, ...]:
    """Return the names, in a file, of the axes of the field ``name`` of the class ``owner``."""
    names = {"f": "time", "n": "ball", "c": "contact", "3": "axis", "m": "met", "2": "end"}
    if owner is ContactNetwork:
        names["c"] = "network_contact"
    letters = owner._shapes[name].rstrip("?").split()
    return tuple(names[letter] for letter in letters)


def _pad(values: Any, shape: tuple[int, ...]) -> Array:
    """Return an array of the ``shape`` that has the ``values``, and zeros behind these along each
    axis.
    """
    if np.shape(values) == shape:
        return np.asarray(values, float)
    padded = np.zeros(shape)
    region = tuple(slice(size) for size in np.shape(values))
    padded[region] = values
    return padded
