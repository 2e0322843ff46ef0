"""Pulses that a plane of balls receives: signals, their coherent part, and times of flight as experimenters read them."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray

from granphon.base.errors import InputError, brief, message
from granphon.base.results import Result, read_only
from granphon.base.scales import write_quantity
from granphon.base.validation import positive

Array = NDArray[np.float64]
Index = NDArray[np.intp]
#: ways to read a time of flight
METHODS = ("envelope", "first", "correlation")
#: an earlier maximum of the envelope counts if it has this part of the greatest
_HALF = 0.5
#: the maximum is that of a parabola through the envelope where it has this part of the greatest
_NEAR = 0.9
#: part of a reading within which a signal has not travelled
_AT_ONCE = 0.05
#: why a signal has no time of flight
_SHORT = (
    "the record ends before the pulse is over: use a longer duration; in a periodic network a longer array, a shorter "
    "distance, fewer cycles, a higher frequency, or ends: free"
)
_EARLY = (
    "the signal comes not after the burst: what is heard has not travelled, as no waves of this frequency and polarisation "
    "do, the plane is too near, or the array is far shorter than the pulse"
)
#: part of the envelope at which a signal begins
_BEGINS = 0.1
#: damping ratio of a wave of the pulse's frequency from which what arrives tells no velocity of sound
_MOST_DAMPING = 0.3
#: relative excess of a velocity over that of the fastest wave that is left to the reading of the record
_FASTER = 0.02
#: how much is left of the frequency of the burst, compared with others of it, below which those others are what arrives
_LEAST_SHARE = 0.5
#: relative error of a velocity above which it is told
_UNSURE = 0.03
#: relative error of a velocity from which it is none
_UNKNOWN = 0.5
#: what is looked at around the height of a pulse, in durations of the burst: all of one that keeps its shape, and a margin
_REACH = 0.75
_DAMPED = "waves of the frequency of the pulse hardly swing, so much are they damped: what arrives has no velocity of sound"


def find_envelope(signals: Array) -> Array:
    """Return the envelopes (..., n_t) of ``signals``: the magnitudes of their analytic signals."""
    from scipy.fft import next_fast_len
    from scipy.signal import hilbert

    count = signals.shape[-1]
    # zeros behind the record: its end is not joined to its beginning
    return np.asarray(np.abs(hilbert(signals, next_fast_len(2 * count), axis=-1))[..., :count])


def find_arrivals(
    times: Array, signals: Array, sent: Array, duration: float, method: str, threshold: float
) -> tuple[Array, list[str]]:
    """Return the times (n,) by which ``signals`` (n, n_t) come after ``sent`` (n_t,), s; ``times`` (n_t,) are even.

    Parameters
    ----------
    duration : of what was sent, s: a record is to hold it, and the time of flight before it.
    method : "envelope": between the maxima of the envelopes, of which the first counts that has half the height of the
        greatest; "first": between the times at which the envelopes first reach ``threshold`` of that maximum;
        "correlation": where the cross-correlation of both signals is greatest.

    Returns
    -------
    times : nan of a signal that is zero, does not come after the burst, or is not over when the record ends.
    reasons : for each signal why its time is nan; empty if it is not.

    Raises :class:`~granphon.base.errors.InputError` for an unknown method.
    """
    if method not in METHODS:
        raise InputError(message(f"the time of flight by {brief(method)} is not known", mend=f"Use {', '.join(METHODS)}"))
    step = float(times[1] - times[0])
    if method == "correlation":
        from scipy.signal import correlate

        shifts = []
        for one in signals:
            found = correlate(one, sent)[sent.size - 1 :]  # lags from zero on
            place = int(np.argmax(found))
            shifts.append(np.nan)
            if 0 < place < found.size - 1:  # the extreme of the parabola through the values around the greatest
                low, middle, high = found[place - 1 : place + 2]
                shifts[-1] = place + 0.5 * float((low - high) / (low - 2.0 * middle + high))
    else:
        start, *arrived = (_read(one, method, threshold) for one in find_envelope(np.vstack([sent, signals])))
        shifts = [one - start for one in arrived]
    reasons = []
    for signal, shift in zip(signals, shifts, strict=True):
        reason = ""
        if not np.any(signal):
            reason = "the signal is zero"
        elif not step * shift + duration <= times[-1] + step:  # nan too: the burst or the signal has no maximum
            reason = _SHORT
        elif shift <= _AT_ONCE:
            reason = _EARLY
        reasons.append(reason)
    found = np.where([bool(one) for one in reasons], np.nan, step * np.asarray(shifts))
    return found, reasons


def _read(envelope: Array, method: str, threshold: float) -> float:
    """Return where an envelope is highest, or first has the part ``threshold`` of that, in readings, or nan."""
    # the first maximum that has half the height of the greatest value
    inner = envelope[1:-1]
    peaks = 1 + np.flatnonzero((inner > envelope[:-2]) & (inner >= envelope[2:]))
    high = peaks[envelope[peaks] >= _HALF * np.max(envelope)]
    if not high.size:
        return np.nan
    place = int(high[0])
    if method == "first":
        level = threshold * envelope[place]
        begin = int(np.argmax(envelope[: place + 1] >= level))
        if begin == 0:
            return 0.0
        before, after = envelope[begin - 1 : begin + 1]
        return begin - 1 + float((level - before) / (after - before))
    # the top of the parabola that fits the envelope where it is near its maximum
    low = np.flatnonzero(envelope < _NEAR * envelope[place])
    split = int(np.searchsorted(low, place))
    first = min(place - 1, int(low[split - 1]) + 1 if split else 0)
    last = max(place + 1, int(low[split]) - 1 if split < low.size else envelope.size - 1)
    near = envelope[first : last + 1] / envelope[place]
    # weights that vanish at the ends: no reading counts more or less when the next one is left out
    weight = np.sqrt(np.maximum(near - _NEAR, 1e-9))
    curve, slope, _ = np.polyfit(np.arange(first, last + 1) - place, near, 2, w=weight)
    return float(np.clip(place - 0.5 * slope / curve, first, last))


@dataclass(frozen=True, eq=False, repr=False)
class Pulse(Result):
    """What was heard of a pulse; SI units. Signals are velocities along the polarisation.

    Attributes
    ----------
    frequency, cycles : of the burst sin(omega (t - P/2)) (1 - cos(2 pi t/P))/2 that pushes the source; P = cycles/frequency.
    direction, polarisation : (3,) unit vectors.
    damping, tangential_damping : s, the viscosity of each contact over its stiffness, in normal motion and in all other.
    distance : m, of the receiving plane from the source, along the direction.
    times : (n_t,) s, from the beginning of the burst.
    sent : (n_t,) force on each ball of the source, N.
    sources, receivers : indices of the balls that are pushed, and of those of the receiving plane.
    samples : (n_r,) the number of the sample that each receiver belongs to; zeros for a single one.
    signals : (n_r, n_t) velocity of each receiver, m/s.
    energies : (2,) J, kinetic and elastic, when the source has ended and at the end of the record, from the displacements
        and velocities of all balls; means over samples.
    plane_distances : (n_p,) m, of further planes, if there are any.
    planes : (n_p, n_t) mean velocity on each of them, m/s; (0,) without any.
    frames : (n_f,) s, if there are any.
    velocities : (n_f, n, 3) of all balls at the times ``frames``, m/s; (0,) without any.
    warnings : one sentence for each limit of the model that the network exceeds, why the time of flight is not known, and
        how sure the velocity is if its error is above 3 percent.
    echo : m, how much longer the way of the first echo from an end is than the distance, or the way round a periodic network
        in the other direction.
    fastest : (2,) m/s, bounds of the velocity of long waves: of those of this polarisation, and of all.
    """

    units = {
        "frequency": "Hz", "damping": "s", "tangential_damping": "s", "distance": "m", "times": "s", "sent": "N",
        "signals": "m/s", "plane_distances": "m", "planes": "m/s", "frames": "s", "velocities": "m/s", "energies": "J",
        "echo": "m", "fastest": "m/s",
    }  # fmt: skip
    _shapes = {
        "direction": "3", "polarisation": "3", "times": "t", "sent": "t", "sources": "s", "receivers": "r", "samples": "r",
        "signals": "r t", "plane_distances": "p", "planes": "p t|p", "frames": "f", "velocities": "f n 3|f", "energies": "2",
        "fastest": "2",
    }  # fmt: skip

    frequency: float
    cycles: float
    direction: Array
    polarisation: Array
    damping: float
    tangential_damping: float
    distance: float
    times: Array
    sent: Array
    sources: Index
    receivers: Index
    samples: Index
    signals: Array
    energies: Array
    plane_distances: Array
    planes: Array
    frames: Array
    velocities: Array
    warnings: tuple[str, ...] = ()
    echo: float = math.inf
    fastest: Array = field(default_factory=lambda: np.full(2, math.inf))

    def __post_init__(self) -> None:
        # plain data do not keep the shape of an array without numbers
        if not self.planes.size:
            object.__setattr__(self, "planes", np.zeros((len(self.plane_distances), self.times.size)))
        if not self.velocities.size:
            object.__setattr__(self, "velocities", np.zeros((len(self.frames), 0, 3)))
        super().__post_init__()

    @cached_property
    def coherent(self) -> Array:
        """(n_t,) mean velocity of the receiving plane, over all samples, m/s."""
        return read_only(np.mean(self.signals, axis=0))

    @cached_property
    def speckle(self) -> Array:
        """(n_r, n_t) what is left of the signal of each ball without the coherent part, m/s."""
        return read_only(self.signals - self.coherent)

    @cached_property
    def speckle_amplitude(self) -> Array:
        """(n_t,) root of the mean square of the speckle over the balls of the plane, m/s."""
        return read_only(np.sqrt(np.mean(self.speckle**2, axis=0)))

    @property
    def coherent_fraction(self) -> float:
        """Part of the integral over time of the mean square of the signals that is coherent."""
        whole = float(np.sum(np.mean(self.signals**2, axis=0)))
        return float(np.sum(self.coherent**2)) / whole if whole else 0.0

    @property
    def envelope(self) -> Array:
        """(n_t,) envelope of the coherent signal, m/s."""
        return find_envelope(self.coherent)

    @property
    def damping_ratio(self) -> float:
        """zeta = pi times the frequency and the :attr:`damping`: over the critical one; a period leaves exp(-2 pi zeta)."""
        return math.pi * self.damping * self.frequency

    @property
    def loss(self) -> float:
        """Part of the energy that is lost from the end of the source to the end of the record."""
        start, end = self.energies
        return float(1.0 - end / start)

    def arrival(self, method: str = "envelope", threshold: float = _BEGINS) -> float:
        """Return the time of flight of the coherent signal, s; nan where there is none, see :attr:`time_of_flight`.

        Parameters
        ----------
        method : "envelope": from the maximum of the envelope of the burst to that of the signal, whose first maximum counts
            that has half the height of the greatest. "first": between the times at which the two envelopes first have the
            part ``threshold`` of that maximum. "correlation": the shift at which the cross-correlation of the signal and the
            burst is greatest; it follows single waves under the envelope, so for long pulses it tells the phase, up to whole
            periods.
        threshold : for "first".

        Raises :class:`~granphon.base.errors.InputError` for an unknown method, and a threshold that is not between 0 and 1.
        """
        found = float(self._find_arrivals(self.coherent[None], method, threshold)[0][0])
        return math.nan if self.why_unknown else found

    def arrivals(self, method: str = "envelope", threshold: float = _BEGINS) -> Array:
        """Return the time of flight (n_r,) of the signal of each ball, s; nan where there is none.

        ``method`` and ``threshold`` are those of :meth:`arrival`.
        """
        found = self._find_arrivals(self.signals, method, threshold)[0]
        return np.full(found.shape, math.nan) if self._find_echo() else found

    def _find_arrivals(self, signals: Array, method: str, threshold: float) -> tuple[Array, list[str]]:
        threshold = positive("threshold", threshold)
        if threshold >= 1.0:
            raise InputError(message(f"threshold is {threshold:g}", mend="Give a part of the maximum, below 1"))
        return find_arrivals(self.times, signals, self.sent, self.cycles / self.frequency, method, threshold)

    @cached_property
    def _flight(self) -> tuple[float, float, str]:
        """Time of flight by the envelope, s, its error, s, and why both are nan; empty if they are not."""
        (time,), (why,) = self._find_arrivals(self.coherent[None], "envelope", _BEGINS)
        hertz, fastest, error, why = self.frequency, float(self.fastest[1]), math.nan, self._find_echo() or why
        if not why and self.distance > (1.0 + _FASTER) * fastest * time:
            why = (
                f"the signal is highest {write_quantity(time, 's', 4)} after the burst, and the fastest waves of the "
                f"network, of {fastest:.4g} m/s at most, take longer: use a longer distance, another frequency or more"
                " cycles"
            )
        if not why:
            # when the pulse is at its height, and how far around that nothing else comes
            duration = self.cycles / self.frequency
            middle = time + 0.5 * duration
            reach = min(_REACH * duration, time + self.echo / float(self.fastest[0]) - middle)
            # what comes there counts, fading out over the last third
            after = self.times - middle
            gated = self.coherent * np.clip(3.0 * (1.0 - np.abs(after) / reach), 0.0, 1.0)
            # the group delay at the frequency of the burst, -d phase / d omega of the Fourier integral; of the burst, which
            # is even about its middle, it is that middle
            turned = gated * np.exp(-2j * np.pi * hertz * after)
            whole = np.sum(turned)
            error = abs(float(np.real(np.sum(after * turned) / whole))) if abs(whole) > 0.0 else math.nan
            # how much of that frequency is left, over the most of any other: as in the burst if all travel alike
            wave = np.exp(-2j * np.pi * hertz * self.times)
            left, given = (
                abs(complex(trace @ wave)) / float(np.max(np.abs(np.fft.rfft(trace, 2 * trace.size))))
                for trace in (gated, self.sent)
            )
            if left / given < _LEAST_SHARE or not error < _UNKNOWN * time:
                why = (
                    f"what arrives are other waves of the burst than those of its frequency, {hertz:.6g} Hz, which are "
                    "held back more than these: use another frequency, such as one of a band, more cycles, or a shorter "
                    "distance"
                )
        return (math.nan, math.nan, why) if why else (float(time), error, "")

    def _find_echo(self) -> str:
        """Return why an echo makes times of flight unknown, if one may come before the pulse is at its height."""
        needed = 0.5 * self.cycles / self.frequency * float(self.fastest[0])
        if self.echo >= needed:
            return ""
        return (
            "an echo from an end, or what runs round a periodic network the other way, may come before the pulse is at "
            f"its height: its way is {self.echo:.4g} m longer, and {needed:.4g} m are needed. Use a longer array, a "
            "shorter distance, a higher frequency or fewer cycles"
        )

    def judge(self) -> tuple[str, ...]:
        """Return why the time of flight is not known, or how sure the velocity is if its error is above 3 percent."""
        damping = max(self.damping, self.tangential_damping)
        said = [_DAMPED] if math.pi * self.frequency * damping > _MOST_DAMPING else []
        if self.why_unknown:
            said.append(f"the arrival of the pulse is not known: {self.why_unknown}")
        elif (unsure := self.velocity_error / self.velocity) > _UNSURE:
            said.append(
                f"the pulse changes its shape on the way, and its velocity is known to {100.0 * unsure:.0f} % only: use "
                "more cycles, a longer distance or a lower frequency"
            )
        return tuple(said)

    @property
    def time_of_flight(self) -> float:
        """Time of flight by the envelope of the coherent signal, s.

        It is nan, and :attr:`warnings` say why, if the record ends before the pulse is over; if an echo may come before the
        pulse is at its height; if the velocity would be above that of the fastest wave; and if what arrives are other
        frequencies of the burst than its own, as in a gap.
        """
        return self._flight[0]

    @property
    def why_unknown(self) -> str:
        """Why the time of flight is nan; empty if it is not."""
        return self._flight[2]

    @property
    def velocity(self) -> float:
        """Distance over the time of flight by the envelope, m/s; nan where that is none."""
        return self.distance / self.time_of_flight

    @property
    def velocity_error(self) -> float:
        """How far the velocity may be from the group velocity at the frequency of the burst, as its shape changes, m/s.

        It is the difference from the velocity by the group delay at that frequency, -d phase / d omega of the signal around
        the pulse. Where an echo comes soon only a part of the pulse counts, and the error is a lower bound.
        """
        return self.velocity * self._flight[1] / self.time_of_flight


def average_pulses(pulses: Sequence[Pulse]) -> Pulse:
    """Return one pulse with the receivers of several, of as many samples: its coherent part is the mean over all of them.

    Records of different lengths end with the shortest. Frames are left out, as they are of one sample.

    Raises :class:`~granphon.base.errors.InputError` for no pulse, or for pulses that were not sent alike.
    """
    if not pulses:
        raise InputError(message("there is no pulse to average"))
    first, count = pulses[0], min(one.times.size for one in pulses)
    for one in pulses[1:]:
        same = ("frequency", "cycles", "direction", "polarisation", "damping", "tangential_damping")
        unlike = [name for name in same if not np.array_equal(getattr(one, name), getattr(first, name))]
        if len(one.planes) != len(first.planes):
            unlike.append("plane_distances")
        if not unlike and abs(one.distance / first.distance - 1.0) > 0.1:
            unlike.append("distance")
        if not unlike and not np.allclose(one.sent[:count], first.sent[:count], atol=1e-12 * np.max(np.abs(first.sent))):
            unlike.append("sent")
        if unlike:
            what = f"the pulses differ in {', '.join(unlike)}"
            raise InputError(message(what, mend="Average pulses that were sent alike"))
    samples, last = [], 0
    for one in pulses:
        samples.append(one.samples + last)
        last = int(np.max(samples[-1])) + 1
    weights = [float(np.max(one.samples)) + 1.0 for one in pulses]

    def mean(name: str) -> Any:
        values = [getattr(one, name) for one in pulses]
        return np.average([one[..., :count] if name == "planes" else one for one in values], axis=0, weights=weights)

    mean_pulse = replace(
        first, distance=float(mean("distance")), times=first.times[:count], sent=first.sent[:count],
        sources=np.concatenate([one.sources for one in pulses]), receivers=np.concatenate([one.receivers for one in pulses]),
        samples=np.concatenate(samples), signals=np.concatenate([one.signals[:, :count] for one in pulses]),
        energies=mean("energies"), plane_distances=mean("plane_distances"), planes=mean("planes"), frames=np.zeros(0),
        velocities=np.zeros(0), echo=min(one.echo for one in pulses),
        fastest=np.max([one.fastest for one in pulses], axis=0), warnings=(),
    )  # fmt: skip
    # what was said of each pulse alone is not true of their mean
    kept = dict.fromkeys(text for one in pulses for text in one.warnings if text not in one.judge())
    return replace(mean_pulse, warnings=(*kept, *mean_pulse.judge()))
