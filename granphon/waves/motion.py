"""Balls in motion at a list of times: positions, forces, energies, and the waves that the balls
make.
"""

from __future__ import annotations

import json
import math
import os
import warnings
from collections.abc import Mapping, Sequence
from contextlib import suppress
from dataclasses import fields, replace
from functools import cached_property
from itertools import product
from pathlib import Path
from typing import Any, BinaryIO, Literal, Self

import numpy as np
from numpy.typing import ArrayLike, NDArray

from granphon.balls.lattices import one_direction
from granphon.base.arrays import Array, Index
from granphon.base.errors import InputError, OutputError, StoppedEarlyWarning, brief
from granphon.base.records import RecordFile, lock_file, read_records
from granphon.base.results import Result, held, plain, restore, result_class
from granphon.base.staging import explaining, put_beside
from granphon.base.text import counted
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
#: events by which the passage of a pulse through a contact is timed
_PASSAGES = ("peak", "front")
#: change of a force, over the greatest change of all forces, below which no pulse has come to a
#: contact
_LEAST_CHANGE = 1e-3
#: change of a force, over the greatest force in the first frame, below which the change may be
#: rounding
_ROUNDING = 1e-10
#: change of a force, N, up to which the change counts as none
_LEAST_FORCE = 1e-300
#: correlation of distances and times up to which they make no straight line
_LEAST_CORRELATION = 0.9
#: greatest change of the slope of a parabola fitted to times over distances, from the middle to an
#: end, over the slope in the middle: with more it is no straight line. For a signal that diffuses,
#: t ~ x^2, the number is 1, and a third if the first distance is half of the last
_MOST_BENDING = 0.25
#: least number of frames in a period of the highest harmonic
_FRAMES_PER_PERIOD = 2.5
#: relative rounding of times: a run of ten periods has ten periods
_TIME_ROUNDING = 1e-9
#: least height of the frames beside a maximum, over the maximum: if both have it, three frames lie
#: within the width of the pulse at half of its height. Fewer frames do not tell when the pulse
#: passes
_FLANK_HEIGHT = 0.5
#: most multiples and periods: no run has as many frames
_MOST_MULTIPLES = 10**9
#: prefix of the names of the network's arrays in a file
_NETWORK_PREFIX = "network_"
#: what an error says of a file to which no more frames can be written
_KEPT_FRAMES = "It holds the frames that came before"


@result_class
class Motion(Result):
    """Balls in motion, at a list of times. Vectors have three components; components along which
    balls do not move are zero.

    Attributes
    ----------
    times : (n_f,) times of the frames, s.
    displacements, velocities : (n_f, n, 3) displacements from the places at rest, m, and
        velocities, m/s. Velocities of balls that a drive moves are differences of displacements
        over two steps; over one step at the start, and at the end if the drive is not finite later.
    rotations, spins : (n_f, n, 3) rotations since rest, rad, and angular velocities, rad/s.
    forces, shears : (n_f, n_c + n_m) normal force of each contact, zero where it is open, and size
        of its force of slip, N; first of the contacts of the network, then of those in ``met``.
    translation, rotation : (n_f,) kinetic energies, J.
    stored : (n_f,) energy that contacts and the load have gained since rest, J.
    lost : (n_f,) energy that was lost since the start: by contacts through friction, dashpots, and
        jumps of the force, as of contacts that adhere, and by balls through drag, J.
    work : (n_f,) work of drives since the start, J.
    step : time step of the integration, s.
    network : the balls at rest, and their contacts.
    met : (n_m, 2) balls of the contacts that came about beside those of the network.
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
        """Give ``met`` its shape (n_m, 2), also if it is empty, and make arrays read-only."""
        # plain data do not keep the shape of an array without numbers
        object.__setattr__(self, "met", np.reshape(self.met, (-1, 2)))
        super().__post_init__()

    @classmethod
    def read(cls, path: str | os.PathLike[str] | BinaryIO, frames: slice = slice(None)) -> Self:
        """Return the motion in the file at ``path``, which :meth:`NonlinearWaves.run` or
        :meth:`write` has made, or only the ``frames`` of a slice; the run may still go on.

        Arrays over frames stay in the file, as :class:`numpy.memmap`: frames are read when they are
        used, so that a motion may be larger than the memory. If ``path`` is an open binary file,
        the file is read at once. If a file was cut off within a frame, the whole frames before are
        read, with a :class:`~granphon.base.errors.StoppedEarlyWarning`.

        Raises :class:`~granphon.base.errors.InputError` for a file that is not there, that is of
        another kind or schema, or that is damaged; for what is no path and no open binary file; and
        for ``frames`` that are no slice of whole numbers, that run backwards, or of which the file
        has none.
        """
        if not isinstance(path, str | os.PathLike) and not hasattr(path, "read"):
            raise InputError(
                f"the file of a motion is {brief(path)}", mend="Give a path, or an open binary file"
            )
        _require_forward(frames)
        arrays, about = read_records(path, _ABOUT, frames)
        # if the file lacks times, it is damaged, and the missing field raises the error below
        if "times" in arrays and not len(arrays["times"]):
            raise InputError(
                f"frames is {brief(frames)}, and the file has none of them", mend="Give others"
            )
        try:
            network = _read_network(arrays, about)
            fields_of_motion = {
                name: array
                for name, array in arrays.items()
                if not name.startswith(_NETWORK_PREFIX)
            }
            # the file of a motion in which no further contacts came about does not have this array
            met: Any = fields_of_motion.pop("met", np.zeros((0, 2))).astype(np.intp)
            motion = cls(**fields_of_motion, network=network, met=met, step=float(about["step"]))
            motion._check()
        except (KeyError, TypeError, ValueError) as error:
            raise InputError(
                f"the file of a motion is damaged: {error}", mend="Run again"
            ) from None
        return motion

    def write(self, path: str | os.PathLike[str] | BinaryIO) -> None:
        """Write the motion into a netCDF file at ``path``, or into an open binary file that is
        empty and can seek, for :meth:`read`. The file of an earlier motion at the path is replaced;
        the folder of the path is made if need be.

        Raises :class:`~granphon.base.errors.InputError` if ``path`` is neither a path nor such a
        file, and :class:`~granphon.base.errors.OutputError` if the file at the path is no motion,
        or is being written by a run, or if the file cannot be written.
        """
        if hasattr(path, "write"):
            stream: Any = path
            try:
                _require_stream(stream)
                self._write_frames(stream)
            except OSError as error:
                raise OutputError(
                    f"{brief(path)} cannot be written: {error.strerror or error}",
                    "It may hold a part of the motion",
                    "Give another",
                ) from None
            return
        _require_writable(path)
        with put_beside(Path(path)) as beside, open(beside, "wb") as file:
            self._write_frames(file)

    def _write_frames(self, stream: BinaryIO) -> None:
        """Write the motion into a ``stream``, an open binary file that is empty and can seek."""
        file = _begin_file(stream, self.network, self.step, self.met, self._take_frame(0))
        for frame in range(len(self.times)):
            file.append(self._take_frame(frame))

    def _take_frame(self, frame: int) -> dict[str, Any]:
        """Return the values of one ``frame``, a number, by the names of the fields; they are those
        fields whose first axis is over frames.
        """
        names = [name for name, layout in self._shapes.items() if layout[0] == "f"]
        return {name: getattr(self, name)[frame] for name in names}

    @property
    def energy(self) -> Array:
        """(n_f,) sum of the kinetic energies and of the energy stored since rest, J."""
        return self.translation + self.rotation + self.stored

    @property
    def positions(self) -> Array:
        """(n_f, n, 3) positions of the balls, m."""
        return self.network.positions + self.displacements

    @property
    def middles(self) -> Array:
        """(n_c + n_m, 3) positions of the contacts, m, with balls at their places at rest: first
        of the contacts of the network, then of those in :attr:`met`. A contact that came about
        between two balls is halfway between the centres of their nearest images; that of a ball and
        a flat wall is at the foot of the perpendicular from the ball.
        """
        network = self.network
        i, j = self.met.T
        centres = network.positions[i]
        periods = network.cell[list(network.pbc)]
        to_nearest_image = _shorten(network.positions[j] - centres, periods)
        met_positions = centres + 0.5 * to_nearest_image
        for wall, (point, normal) in network.walls.items():
            is_at_wall = j == wall
            distances = (point - centres[is_at_wall]) @ normal
            met_positions[is_at_wall] = centres[is_at_wall] + np.outer(distances, normal)
        return np.concatenate([network.contact_places, met_positions])

    def sensor(self, receiver: Any, direction: ArrayLike | None = None) -> Array:
        """Return the force that a sensor reads at all times, (n_f,) N.

        Parameters
        ----------
        receiver : where the sensor is. The index of a ball: half of the sum of the normal forces of
            its contacts is read, each times the size of the cosine between its normal at rest and
            the ``direction``; in a chain this is the mean of both contacts. The index of a body
            that is held, or "floor", the one flat wall: the whole of this sum is read. A tuple
            (i, j) of the balls of a contact: its normal force is read.
        direction : (3,) axis of a sensor in a ball or body that is given by its index; of other
            sensors it is not used. The default is the first axis along which the network does not
            repeat, or x if there is none; of a flat wall it is the normal.

        Forces are those of springs: what dashpots add is not in :attr:`forces`. Raises
        :class:`~granphon.base.errors.InputError` for a ``receiver`` of another kind, a body that is
        not there, two balls without a contact or with several, a body without a contact along the
        direction, a ``direction`` that is not three finite numbers, or zero, and for "floor" unless
        the network has exactly one flat wall.
        """
        places = self._sensor_places
        if is_contact(receiver):
            sensor = places.at_contact(*receiver)
        elif is_one_of(receiver, (FLOOR,)):
            sensor = places.in_floor()
        else:
            body = whole_number("receiver", receiver, 0, self.network.n_balls - 1)
            axis = places.walls.get(body, find_open_axis(self.network))
            if direction is not None:
                axis = one_direction(direction, 3)
            sensor = places.in_body(body, axis)
        return np.asarray(self.forces[:, sensor.contacts] @ sensor.weights)

    @cached_property
    def _sensor_places(self) -> SensorPlaces:
        """Where sensors may be: in the contacts of the network and in those of :attr:`met`, whose
        normals are those between balls at their places at rest.
        """
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
        """Return the times (n_c + n_m,), s, and the heights (n_c + n_m,), N, of the greatest normal
        force of each contact, in the order of :attr:`forces`.

        Both are those of the top of a parabola through the frame of the greatest force and the
        frames beside it. If the force is greatest in the first or the last frame, the time of this
        frame and its force are returned.
        """
        return self._find_tops(np.argmax(self.forces, axis=0))

    def _find_tops(self, frames: Index) -> tuple[Array, Array]:
        """Return the times, s, and the heights, N, of the tops of parabolas, (n_c + n_m,) each. The
        parabola of a contact goes through its forces at its frame of ``frames`` (n_c + n_m,) and at
        both frames beside.

        The first and the last frame lack a frame beside them: there the time and the force of the
        frame are returned.
        """
        last = len(self.times) - 1
        contacts = np.arange(self.forces.shape[1])
        previous = np.maximum(frames - 1, 0)
        following = np.minimum(frames + 1, last)
        force_before = self.forces[previous, contacts]
        force = self.forces[frames, contacts]
        force_after = self.forces[following, contacts]
        # differences first: forces that differ by rounding then still have a curvature
        curvature = (force_before - force) + (force_after - force)
        fall = force_before - force_after
        is_inside = following == previous + 2  # there is a frame on both sides
        # time from the frame to the top, over the interval of frames
        shift = np.divide(0.5 * fall, curvature, out=np.zeros_like(curvature), where=is_inside)
        two_steps = self.times[following] - self.times[previous]
        return self.times[frames] + 0.5 * shift * two_steps, force - 0.25 * fall * shift

    def arrivals(self, share: float = 0.5) -> Array:
        """Return the times (n_c + n_m,), s, at which the change of each normal force since the
        first frame comes to the part ``share`` of its first great change; in the order of
        :attr:`forces`.

        The first great change is the first maximum of the change that is at least half of the
        greatest change, so that a later echo does not count. If there is no such maximum, it is the
        greatest change. Times between frames are interpolated linearly; the time is infinite where
        a force does not change. Raises :class:`~granphon.base.errors.InputError` for a ``share``
        that is no number from 1e-9 to 1.
        """
        share = require("share", lambda value: number(value, 1e-9, 1.0), share)
        change = np.abs(self.forces - self.forces[0])
        first_maximum = _find_first_maxima(change)
        great_frame = np.where(first_maximum > 0, first_maximum, np.argmax(change, axis=0))
        contacts = np.arange(change.shape[1])
        level = share * change[great_frame, contacts]
        # the frame that reaches the level first, but not frame 0, which has no frame before it
        frame_at_level = np.argmax(change >= level, axis=0)
        following = np.clip(frame_at_level, min(1, len(change) - 1), None)
        low = change[following - 1, contacts]
        high = change[following, contacts]
        fraction = np.divide(level - low, high - low, out=np.zeros_like(level), where=high > low)
        start = self.times[following - 1]
        times = start + fraction * (self.times[following] - start)
        return np.where(level > 0.0, times, np.inf)

    def passages(self, of: Literal["peak", "front"] = "peak", share: float = 0.5) -> Array:
        """Return the times (n_c + n_m,), s, at which the peak or the front of a pulse passes each
        contact, in the order of :attr:`forces`.

        The time of the peak is that of the first maximum of the force above its value at the start
        that is at least half as high as the greatest. The time of the front is that of
        :meth:`arrivals`, when the force has changed by the part ``share`` of its first great
        change.

        A time is nan in three cases: the force changes by less than a thousandth of the greatest
        change of all forces, or by rounding alone; it has no such maximum, as when it still rises
        at the end; or a frame beside the maximum has less than half of its height, so that frames
        are too few to tell when the pulse passes.

        Raises :class:`~granphon.base.errors.InputError` for another word than "peak" and "front",
        and for a ``share`` of a front that is no number from 1e-9 to 1; for a peak the share is not
        used.
        """
        times, is_resolved = self._find_passages(of, share)
        return np.where(is_resolved, times, np.nan)

    def _find_passages(
        self, of: Literal["peak", "front"], share: float
    ) -> tuple[Array, NDArray[np.bool_]]:
        """Return the times of :meth:`passages`, s, and for each contact whether the frames resolve
        the pulse, (n_c + n_m,) each. Where they do not, times here are not nan. Arguments, and what
        is raised, are those of :meth:`passages`.
        """
        rise = self.forces - self.forces[0]
        change = np.abs(rise)
        least_change = max(
            _LEAST_CHANGE * float(change.max(initial=0.0)),
            _ROUNDING * float(self.forces[0].max(initial=0.0)),
            _LEAST_FORCE,
        )
        height = rise if one_of("of", of, _PASSAGES) == "peak" else change
        maximum = _find_first_maxima(height)  # a frame of each contact; 0 without a maximum
        is_known = (change.max(axis=0, initial=0.0) > least_change) & (maximum > 0)
        if of == "peak":
            times, _ = self._find_tops(maximum)
        else:
            times = self.arrivals(share)
        # where there is no maximum, frame 0 stands for it: what follows from this frame means
        # nothing, and is left out by is_known
        previous = np.maximum(maximum - 1, 0)
        following = np.minimum(maximum + 1, len(height) - 1)
        contacts = np.arange(maximum.size)
        flank = np.minimum(height[previous, contacts], height[following, contacts])
        is_resolved = flank >= _FLANK_HEIGHT * height[maximum, contacts]
        return np.where(is_known, times, np.nan), is_resolved

    def pulse_velocity(
        self,
        contacts: Sequence[int],
        direction: ArrayLike | None = None,
        of: Literal["peak", "front"] = "peak",
        share: float | None = None,
    ) -> float:
        """Return the velocity, m/s, of the peak or the front of a pulse along ``contacts`` (n,),
        indices in :attr:`forces`, in the order in which the pulse passes these contacts.

        The velocity is the slope of a straight line fitted to distances over the times of
        :meth:`passages` (:func:`fit_velocity`). Distances are along the ``direction`` (3,), by
        default from the first contact to the last. The front is where the force has changed by the
        part ``share`` of its first great change, by default half.

        Raises :class:`~granphon.base.errors.InputError` for fewer than two contacts, an index that
        no contact has, and one that is given twice; for a contact that the pulse does not pass
        within the run; for fewer than three frames within the width of the pulse at half of its
        height; if distances over times are no straight line that rises; if the first and the last
        contact are at one place and no ``direction`` is given; for a ``direction`` that is not
        three numbers, or zero; for what :meth:`passages` refuses; and for a ``share`` together with
        a peak.
        """
        indices = index_array("contacts", contacts, self.forces.shape[1], "contacts")
        if indices.size < 2:
            raise InputError(f"contacts are {brief(contacts)}", mend="Give two or more")
        if one_of("of", of, _PASSAGES) == "peak" and share is not None:
            raise InputError(
                f"share is {brief(share)}, and a peak has none", mend='Give of="front" too'
            )
        vectors = self.middles[indices] - self.middles[indices[0]]  # from the first contact, m
        if direction is None:
            direction = vectors[-1]
            if not np.any(direction):
                raise InputError(
                    f"contacts {brief(contacts)} begin and end at one place",
                    mend="Give contacts along a way",
                )
        unit_vector = one_direction(direction, 3)
        times, is_resolved = self._find_passages(of, 0.5 if share is None else share)
        self._require_passed(indices, times[indices], is_resolved[indices])
        velocity, reason = fit_velocity(vectors @ unit_vector, times[indices])
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
        """Raise :class:`~granphon.base.errors.InputError` unless a pulse passes each of the
        ``contacts`` (n,), indices, within the run, and frames resolve it there.

        ``times`` (n,), s, are those at which the pulse passes, nan if it does not, and
        ``is_resolved`` (n,) says whether frames resolve the pulse.
        """
        missed_contacts = contacts[np.isnan(times)]
        n_missed = missed_contacts.size
        if n_missed:
            fault = f"the pulse does not pass contact {missed_contacts[0]}"
            others = f", nor {counted(n_missed - 1, 'other')}" if n_missed > 1 else ""
            why = "Its force does not change much, or still rises at the end"
            mend = "Run for longer, keep more frames, or give contacts that it has passed"
            raise InputError(fault + others, why, mend)
        unresolved_contacts = contacts[~is_resolved]
        if unresolved_contacts.size:
            step = float(self.times[1] - self.times[0])
            fault = (
                f"the pulse at contact {unresolved_contacts[0]} is too short for frames"
                f" {step:.3g} s apart"
            )
            why = "Fewer than three are within its width at half of its height"
            raise InputError(fault, why, "Keep more frames")

    def spectrum(self, ball: int, axis: int = 0) -> tuple[Array, Array]:
        """Return the spectrum of the displacement of a ``ball``, an index, along an ``axis``, 0 to
        2: frequencies (n_f//2 + 1,), Hz, and amplitudes (n_f//2 + 1,), m.

        The mean displacement is left out. A Hann window keeps frequencies apart. A steady motion at
        one of the frequencies has its amplitude there to 1 %, from the second frequency above zero
        to the third from the end. Raises :class:`~granphon.base.errors.InputError` for fewer than
        four frames, and for a ``ball`` or an ``axis`` that is not there.
        """
        ball = whole_number("ball", ball, 0, self.network.n_balls - 1)
        axis = whole_number("axis", axis, 0, 2)
        displacements = self.displacements[:, ball, axis]
        n_frames = len(displacements)
        if n_frames < 4:
            raise InputError(
                f"the motion has {counted(n_frames, 'frame')}, and a spectrum needs 4",
                mend="Keep more frames",
            )
        window = np.hanning(n_frames)
        mean = np.average(displacements, weights=window)
        windowed_displacements = window * (displacements - mean)
        interval = float(self.times[1] - self.times[0])
        frequencies = np.asarray(np.fft.rfftfreq(n_frames, interval), float)
        # half of the amplitude is at the negative frequency
        amplitudes = 2.0 / np.sum(window) * np.abs(np.fft.rfft(windowed_displacements))
        return frequencies, amplitudes

    def harmonics(
        self, frequency: float, count: int = 3, axis: int = 0, periods: int = 10
    ) -> NDArray[np.complex128]:
        """Return the complex amplitudes a_k (count, n), in m, of a steady motion of all balls at
        the multiples k = 1 to ``count`` of its ``frequency`` f, Hz.

        The sum Re sum_k a_k exp(-2 pi i k f t) and a mean are fitted, by least squares, to
        displacements along an ``axis``, 0 to 2, in the last ``periods`` of the run. Raises
        :class:`~granphon.base.errors.InputError` if the run has fewer periods, or if a period of
        the highest multiple has fewer than 2.5 frames; and for a frequency that is not above zero,
        a ``count`` or ``periods`` that are no whole number of 1 or more, and another axis.
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
        if is_too_short or frames_per_period < _FRAMES_PER_PERIOD:
            fault = (
                f"{frames_per_period:.3g} frames are in a period of the highest multiple,"
                f" {n_multiples}, and {run_periods:.3g} periods in the run"
            )
            why = f"{_FRAMES_PER_PERIOD:g} and {n_periods} are needed"
            mend = "Run for longer, keep more frames, or ask for fewer periods or multiples"
            raise InputError(fault, why, mend)


def _shorten(vectors: Array, periods: Array) -> Array:
    """Return the shortest vectors (m, 3) that differ from ``vectors`` (m, 3) by whole ``periods``
    (p, 3), m.
    """
    vectors = vectors - np.rint(vectors @ np.linalg.pinv(periods)) @ periods
    # in a tilted cell the shortest vector may be one period beside the one that rounding finds;
    # that one comes first, so that it stays where others are as short
    steps = np.array(list(product((0.0, 1.0, -1.0), repeat=len(periods))))
    candidates = vectors[:, None] + steps @ periods  # (m, 3^p, 3)
    shortest = np.argmin(np.linalg.norm(candidates, axis=2), axis=1)
    return np.asarray(candidates[np.arange(len(vectors)), shortest])


def _find_first_maxima(heights: Array) -> Index:
    """Return for each contact the frame (n_c,) of the first maximum of its ``heights`` (n_f, n_c)
    that is at least half as high as its greatest height; 0 if there is no such maximum.
    """
    if len(heights) < 3:
        return np.zeros(heights.shape[1], np.intp)
    inner = heights[1:-1]
    is_maximum = (inner > heights[:-2]) & (inner >= heights[2:])
    is_high = (inner >= 0.5 * heights.max(axis=0, initial=0.0)) & (inner > 0.0)
    is_high_maximum = is_maximum & is_high
    first_frame = 1 + np.argmax(is_high_maximum, axis=0)  # inner frames begin with frame 1
    return np.where(np.any(is_high_maximum, axis=0), first_frame, 0)


def fit_velocity(distances: Array, times: Array) -> tuple[float, str]:
    """Return the slope, m/s, of the line of least squares of ``distances`` (n,), m, over ``times``
    (n,), s, and an empty text; n is 2 or more.

    If the points are on no straight line that rises, the slope is nan, and the text is the reason:
    times do not grow with the distance, or one is nan; they scatter about the line, with a
    correlation of :data:`_LEAST_CORRELATION` or less; or they lie on a line that bends, as those of
    a signal that diffuses do.
    """
    # each condition is negated, so that nan does not pass as a straight line
    covariances = np.cov(times, distances)
    time_variance = covariances[0, 0]
    distance_variance = covariances[1, 1]
    covariance = covariances[0, 1]
    if not covariance > 0.0:
        return math.nan, "it comes no later to contacts that are farther away"
    if not covariance > _LEAST_CORRELATION * math.sqrt(time_variance * distance_variance):
        return math.nan, "times scatter about a straight line"
    greatest_distance = float(np.max(np.abs(distances)))
    n_distances = len(np.unique(np.round(distances / greatest_distance, 9)))
    if n_distances > 3:  # a parabola goes through three points, whatever their scatter
        # times = curvature s^2 + slope s + constant, where s are relative distances
        relative_distances = (distances - np.mean(distances)) / greatest_distance
        curvature, slope, _ = np.polyfit(relative_distances, times, 2)
        if not abs(curvature) * np.ptp(distances) / greatest_distance <= _MOST_BENDING * abs(slope):
            return math.nan, "distances over times are no straight line"
    return float(covariance / time_variance), ""


def _require_forward(frames: Any) -> None:
    """Raise :class:`~granphon.base.errors.InputError` unless ``frames`` is a slice of whole numbers
    that does not run backwards.
    """
    is_forward = False
    if isinstance(frames, slice):
        # a slice of what are no whole numbers has no indices, nor has one with the step zero
        with suppress(TypeError, ValueError):
            _, _, step = frames.indices(0)
            is_forward = step > 0
    if not is_forward:
        raise InputError(f"frames is {brief(frames)}", mend="Give a slice, such as slice(0, 10)")


def _read_network(arrays: Mapping[str, Any], about: Mapping[str, str]) -> ContactNetwork:
    """Return the network of a motion from its file: from the ``arrays`` of the file, by name, and
    from its texts, ``about``, of which "network" holds those values of the network that are no
    arrays.

    Raises KeyError, TypeError or ValueError for a damaged file, or
    :class:`~granphon.base.errors.InputError` for values that a network cannot have.
    """
    network_arrays: dict[str, Any] = {
        name.removeprefix(_NETWORK_PREFIX): array
        for name, array in arrays.items()
        if name.startswith(_NETWORK_PREFIX)
    }
    for name in ("i", "j", "shift", "labels"):  # whole numbers, of a type that the file chose
        if name in network_arrays:
            network_arrays[name] = network_arrays[name].astype(np.intp)
    plain_values = json.loads(about["network"])
    data = {"class": "ContactNetwork", **plain_values, **network_arrays}
    network: ContactNetwork = restore(data, ContactNetwork)
    return network


class Frames:
    """The frames of a run as they come, kept in memory or in a file; a context manager that closes
    the file. Its length is the number of frames.

    Parameters
    ----------
    network : the balls at rest.
    step : time step of the integration, s.
    path : path of the file; None to keep the frames in memory.

    Attributes
    ----------
    last_time : time of the last frame, s; zero without one.

    Raises what :func:`_require_writable` raises.
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
        """Return the number of frames that are kept."""
        return self._count

    def __enter__(self) -> Self:
        """Return these frames."""
        return self

    def __exit__(self, *_: object) -> None:
        """Close the file, if there is one."""
        if self._file is not None and self._path is not None:
            with explaining(self._path, _KEPT_FRAMES):
                self._file.close()

    def keep(
        self, frame: Mapping[str, Any], forces: Array, shears: Array, met: Sequence[tuple[int, ...]]
    ) -> None:
        """Keep a ``frame``, the values of all fields of a :class:`Motion` but forces and shears, by
        name.

        ``forces`` and ``shears`` (n_c + n_p,), N, are the normal forces and the forces of slip of
        the contacts of the network, and then of the n_p pairs in ``met``, (i, j, shift) each, which
        may be others in each frame. A pair gets a column of its own, in all frames, when it first
        has a normal force. For a new column the whole file is written anew.
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
            with explaining(self._path, _KEPT_FRAMES):
                self._file.append(full_frame)
        self._count += 1
        # set last: Ctrl-C may come before the frame is kept
        self.last_time = float(frame["times"])

    def _lay_out(self, forces: Array, met: Sequence[tuple[int, ...]]) -> Array:
        """Return forces, N, in the order of the columns of a frame, from ``forces`` (n_c + n_p,) of
        the contacts of the network and then of the pairs in ``met``; pairs without a column are
        left out, and columns of other pairs are zero.
        """
        n_contacts = self._network.n_contacts
        row = np.append(forces[:n_contacts], np.zeros(len(self._columns)))
        for pair, force in zip(met, forces[n_contacts:], strict=True):
            if pair in self._columns:
                row[self._columns[pair]] = force
        return row

    def _begin_again(self, path: Path, frame: Mapping[str, Any]) -> None:
        """Write the frames so far, and then a ``frame`` with more columns, into a new file at
        ``path``, as the number of columns of a file is fixed; or begin the first file with the
        first frame.

        The new file is written beside the earlier one, and then takes its place. It stays open, and
        locked against other programs that write, for the frames that follow.
        """
        earlier_arrays = dict[str, Any]()
        shapes = {name: np.shape(field_values) for name, field_values in frame.items()}
        if self._file is not None:
            self._file.close()
            earlier_arrays, _ = read_records(path, _ABOUT)
        with put_beside(path) as beside:
            self._file = _begin_file(
                beside, self._network, self.step, self._balls_of_columns, frame
            )
            for number in range(self._count):
                earlier_frame = {
                    name: _pad(earlier_arrays[name][number], shapes[name]) for name in frame
                }
                self._file.append(earlier_frame)
            self._file.append(frame)
            del earlier_arrays  # the earlier file is not read any more as another takes its place

    @property
    def _balls_of_columns(self) -> Index:
        """(n_m, 2) balls of the contacts that came about beside those of the network, one pair for
        each further column.
        """
        return np.array([pair[:2] for pair in self._columns], np.intp).reshape(-1, 2)

    def join(self) -> Motion:
        """Return all frames, one or more, as one motion; frames from before a contact came about
        have zeros for the contact.
        """
        if self._path is not None:
            return Motion.read(self._path)
        last_frame = self._frames[-1]  # it has the most columns
        arrays: dict[str, Any] = {}
        for name, values in last_frame.items():
            shape = np.shape(values)
            arrays[name] = np.array([_pad(frame[name], shape) for frame in self._frames])
        return Motion(**arrays, network=self._network, met=self._balls_of_columns, step=self.step)


def _require_stream(stream: Any) -> None:
    """Raise :class:`~granphon.base.errors.InputError` unless ``stream`` is an open binary file that
    is empty and can seek to where it has been written. A stream that can seek is set to its end.
    """
    is_usable = False
    # text files, closed ones, those that are read alone, and pipes raise one of these errors
    with suppress(AttributeError, TypeError, ValueError):
        stream.write(b"")
        # what is written to a file that appends goes to its end, wherever the file has been set
        is_appended = "a" in str(getattr(stream, "mode", ""))
        is_usable = stream.seek(0, os.SEEK_END) == 0 and not is_appended
    if not is_usable:
        raise InputError(
            f"the file of a motion is {brief(stream)}",
            mend="Give a path, or an open binary file that is empty and can seek",
        )


def _require_writable(path: Any) -> None:
    """Raise :class:`~granphon.base.errors.InputError` if ``path`` is no path, and
    :class:`~granphon.base.errors.OutputError` if the file there is no motion, or if another run is
    writing it. A path without a file, and the file of a motion that no run is writing, may be
    written to; the file may also have been cut off, if a whole frame is left of it.
    """
    is_path = isinstance(path, str | os.PathLike)
    if not is_path or not os.fspath(path) or "\0" in str(path):
        raise InputError(f"the file of a motion is {brief(path)}", mend="Give a path")
    if os.path.exists(path):
        try:
            with warnings.catch_warnings():
                # that the file was cut off is of no interest, as it is replaced
                warnings.simplefilter("ignore", StoppedEarlyWarning)
                read_records(path, _ABOUT)
        except InputError:
            raise OutputError(
                f"{os.fspath(path)} is there, and is no motion of granphon", mend="Give another"
            ) from None
        with open(path, "rb") as file:
            lock_file(file)  # raises the error if another run holds the file


def _begin_file(
    file: str | os.PathLike[str] | BinaryIO,
    network: ContactNetwork,
    step: float,
    met: Index,
    frame: Mapping[str, Any],
) -> RecordFile:
    """Begin the file of a motion and return it, open. It holds the ``network``; the ``step`` of the
    integration, s; and ``met`` (n_m, 2), the balls of contacts beside those of the network. It
    takes frames with the fields and shapes of ``frame``, which itself is not written.

    The ``file`` is a path, where a file is made, or emptied and locked, or it is an open binary
    stream that is empty and can seek. Raises the errors of :class:`RecordFile`.
    """
    network = network.storable()
    network_fields = {entry.name: getattr(network, entry.name) for entry in fields(network)}
    fixed_arrays = {}  # arrays that do not grow with the frames, each with the names of its axes
    plain_values = {}
    for name, value in network_fields.items():
        if isinstance(value, np.ndarray):
            fixed_arrays[_NETWORK_PREFIX + name] = (value, _name_axes(name, ContactNetwork))
        else:
            plain_values[name] = plain(value)
    if len(met):  # a dimension of no length would be the one that grows
        fixed_arrays["met"] = (met, _name_axes("met", Motion))
    growing_arrays = {
        name: (np.shape(value), _name_axes(name, Motion)[1:]) for name, value in frame.items()
    }
    network_units = {_NETWORK_PREFIX + name: unit for name, unit in ContactNetwork.units.items()}
    units = Motion.units | network_units
    about = _ABOUT | {"network": json.dumps(plain_values), "step": repr(step)}
    return RecordFile(file, fixed_arrays, growing_arrays, units, about)


def _name_axes(name: str, owner: type[Result]) -> tuple[str, ...]:
    """Return the names, in a file, of the axes of the field ``name`` of the class ``owner``."""
    names = {"f": "time", "n": "ball", "c": "contact", "3": "axis", "m": "met", "2": "end"}
    if owner is ContactNetwork:
        # of these letters the class means contacts before others came about, and motions of a ball
        names |= {"c": "network_contact", "m": "motion"}
    letters = owner._shapes[name].rstrip("?").split()
    return tuple(names[letter] for letter in letters)


def _pad(values: Any, shape: tuple[int, ...]) -> Array:
    """Return an array of the ``shape`` that has the ``values``, and zeros behind these along each
    axis.
    """
    if np.shape(values) == shape:
        return np.asarray(values, float)
    padded_array = np.zeros(shape)
    region = tuple(slice(size) for size in np.shape(values))
    padded_array[region] = values
    return padded_array
