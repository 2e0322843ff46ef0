"""Balls in motion at a list of times: where they are, what forces act, where the energy is, and what waves they make."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, Literal

import numpy as np
from numpy.typing import ArrayLike, NDArray

from granphon.base.errors import InputError, brief
from granphon.base.results import Result
from granphon.base.validation import number, positive, require, whole_number
from granphon.networks.network import ContactNetwork

Array = NDArray[np.float64]
#: least number of frames in a period of the highest harmonic
_PER_PERIOD = 2.5


@dataclass(frozen=True, eq=False, repr=False)
class Motion(Result):
    """Balls in motion, at a list of times. Vectors have three components; what does not move is zero.

    Attributes
    ----------
    times : (n_f,) s.
    displacements, velocities : (n_f, n, 3) from the places at rest, m, m/s. Velocities of balls that a drive moves are
        differences between frames.
    rotations, spins : (n_f, n, 3) rad, rad/s.
    forces, shears : (n_f, n_c) normal force of each contact, zero where it is open, and size of its force of slip, N.
    translation, rotation : (n_f,) kinetic energies, J.
    stored : (n_f,) energy that contacts and the load have gained since rest, J.
    lost : (n_f,) energy that contacts have lost by friction, by dashpots, and by their law, J.
    work : (n_f,) of drives, J.
    step : s.
    network : the balls at rest, and their contacts.
    """

    units = {
        "times": "s", "displacements": "m", "velocities": "m/s", "rotations": "rad", "spins": "rad/s", "forces": "N",
        "shears": "N", "translation": "J", "rotation": "J", "stored": "J", "lost": "J", "work": "J", "step": "s",
    }  # fmt: skip
    _shapes = {
        "times": "f", "displacements": "f n 3", "velocities": "f n 3", "rotations": "f n 3", "spins": "f n 3",
        "forces": "f c", "shears": "f c", "translation": "f", "rotation": "f", "stored": "f", "lost": "f", "work": "f",
    }  # fmt: skip

    times: Array
    displacements: Array
    velocities: Array
    rotations: Array
    spins: Array
    forces: Array
    shears: Array
    translation: Array
    rotation: Array
    stored: Array
    lost: Array
    work: Array
    step: float
    network: ContactNetwork

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
        """(n_c, 3) places of the contacts at rest, m."""
        network = self.network
        return np.asarray(network.positions[network.i] + network.arm_i[:, None] * network.normal)

    def peaks(self) -> tuple[Array, Array]:
        """Return the times, s, and the heights, N, of the greatest normal force of each contact, each (n_c,).

        Both are those of a parabola through the greatest frame and its neighbours.
        """
        top = np.clip(np.argmax(self.forces, axis=0), 1, len(self.times) - 2)
        low, most, high = (self.forces[top + shift, np.arange(len(top))] for shift in (-1, 0, 1))
        bend, tilt = low - 2.0 * most + high, low - high
        shift = np.clip(np.divide(0.5 * tilt, bend, out=np.zeros_like(bend), where=bend < 0.0), -1.0, 1.0)
        return self.times[top] + shift * (self.times[1] - self.times[0]), most - 0.25 * tilt * shift

    def arrivals(self, share: float = 0.5) -> Array:
        """Return the times, (n_c,), s, at which each force has changed by the part ``share`` of its greatest change.

        Times between frames are interpolated linearly; the time is infinite where a force does not change.
        """
        change = np.abs(self.forces - self.forces[0])
        level = require("share", lambda value: number(value, 1e-9, 1.0), share) * change.max(axis=0)
        after = np.maximum(np.argmax(change >= level, axis=0), 1)
        low, high = (change[at, np.arange(len(level))] for at in (after - 1, after))
        part = np.divide(level - low, high - low, out=np.zeros_like(level), where=high > low)
        return np.where(level > 0.0, self.times[after - 1] + part * (self.times[after] - self.times[after - 1]), np.inf)

    def pulse_velocity(
        self, contacts: Sequence[int], direction: ArrayLike | None = None, of: Literal["peak", "front"] = "peak",
        share: float = 0.5,
    ) -> float:  # fmt: skip
        """Return the velocity, m/s, at which the greatest force, or the front of :meth:`arrivals`, passes ``contacts``.

        The front is where the force has the part ``share`` of its greatest change. A straight line is fitted to distances
        over times. Distances are along the ``direction`` (3,), by default from the first contact to the last. Raises
        :class:`~granphon.base.errors.InputError` for fewer than two contacts, and for contacts that it does not reach one
        after another.
        """
        at = np.asarray(contacts)
        if at.ndim != 1 or at.size < 2 or at.dtype.kind not in "iu" or np.any((at < 0) | (at >= self.network.n_contacts)):
            what = f"contacts are {brief(contacts)}"
            raise InputError(what, mend=f"Give two or more of the numbers 0 to {self.network.n_contacts - 1}")
        if of not in ("peak", "front"):
            raise InputError(f"of is {brief(of)}", mend='Give "peak" or "front"')
        places = self.middles[at] - self.middles[at[0]]
        along = places[-1] if direction is None else np.asarray(direction, float)
        if along.shape != (3,) or not 0.0 < (size := float(np.linalg.norm(along))) < np.inf:
            raise InputError(f"direction is {brief(direction)}", mend="Give three numbers, not all zero")
        times = (self.peaks()[0] if of == "peak" else self.arrivals(share))[at]
        spread = times - np.mean(times)
        if not np.all(np.isfinite(times)) or not np.any(spread):
            raise InputError("the pulse does not pass these contacts one after another", mend="Run for longer")
        return float(spread @ (places @ along / size) / (spread @ spread))

    def spectrum(self, ball: int, axis: int = 0) -> tuple[Array, Array]:
        """Return frequencies, Hz, and amplitudes, m, of the displacement of a ball along an ``axis``, each (n_f//2 + 1,).

        The mean is left out. A Hann window keeps frequencies apart; the amplitude is that of a steady motion at a frequency
        of the list.
        """
        values = self.displacements[
            :, whole_number("ball", ball, 0, self.network.n_balls - 1), whole_number("axis", axis, 0, 2)
        ]
        window = np.hanning(len(values))
        weighed = window * (values - np.average(values, weights=window))
        spacing = float(self.times[1] - self.times[0])
        frequencies: Array = np.asarray(np.fft.rfftfreq(len(values), spacing), float)
        return frequencies, 2.0 / np.sum(window) * np.abs(np.fft.rfft(weighed))

    def harmonics(self, frequency: float, count: int = 3, axis: int = 0, periods: int = 10) -> NDArray[np.complex128]:
        """Return the amplitudes of a steady motion at multiples of its ``frequency``, Hz: (count, n) complex, m.

        They are those of displacements along an ``axis``, Re sum_m a_m exp(-2 pi i m f t), with a mean, fitted to the last
        ``periods``. Raises :class:`~granphon.base.errors.InputError` if these are not in the run, or if a period of the
        highest multiple has fewer than 2.5 frames.
        """
        f, most = positive("frequency", frequency, "Hz"), whole_number("count", count, 1)
        span = whole_number("periods", periods, 1) / f
        last = self.times > self.times[-1] - span * (1.0 + 1e-9)
        per = (1.0 / f / most) / float(self.times[1] - self.times[0])
        if span > float(self.times[-1]) * (1.0 + 1e-9) or per < _PER_PERIOD:
            what = f"{per:.3g} frames are in a period of multiple {most}, and {self.times[-1] * f:.3g} periods in the run"
            raise InputError(what, mend="Run for longer, keep more frames, or ask for fewer multiples")
        angle = 2.0 * np.pi * f * self.times[last, None] * np.arange(1, most + 1)
        terms = np.hstack([np.ones((len(angle), 1)), np.cos(angle), np.sin(angle)])
        fitted: Any = np.linalg.lstsq(terms, self.displacements[last, :, whole_number("axis", axis, 0, 2)], rcond=None)[0]
        return np.asarray(fitted[1 : most + 1] + 1j * fitted[most + 1 :])
