"""Traces of sensors, as an oscilloscope writes them, and the sound velocity that they show.

Each trace gives the time of arrival of a pulse; a straight line through the times, over the
distances of the sensors, gives the velocity. A time of arrival is, to first order, a linear
functional of the samples of its trace: a random error e of the samples shifts the time by g.e, with
weights g that each method knows. White noise of the standard deviation sigma, which is found in the
quiet part of a trace before the pulse, therefore shifts it by sigma |g|, and with a low-pass filter
F by sigma |F g|, as a filter without phase is symmetric. The standard error of the velocity follows
from these shifts and from no other source: positions of sensors, and dispersion, are not in it.
"""

from __future__ import annotations

import math
import os
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property, partial
from typing import Any, ClassVar, Self

import numpy as np

from granphon.base.arrays import ROUNDING, Array, Flags
from granphon.base.errors import InputError
from granphon.base.results import Result, held, result_class
from granphon.base.text import counted, list_names
from granphon.base.validation import (
    finite_array,
    number,
    one_of,
    positive,
    require,
    texts,
)
from granphon.fits.fit import LEAST_CHANCE, compute_probability

#: share of its maximum at which a trace begins, by default
THRESHOLD = 0.1
#: methods by which a time of arrival is found
METHODS = ("threshold", "peak", "correlation", "phase")
#: least number of samples of a trace, and of its quiet part
_LEAST_SAMPLES = 16
#: relative difference of the steps of time up to which times are evenly spaced: those of files have
#: some six digits
_STEP_TOLERANCE = 1e-3
#: share of the greatest magnitude that the first maximum has at least, and at which a pulse has
#: arrived
_LEAST_PEAK = 0.5
#: number of standard deviations of the noise that a pulse, or a threshold, exceeds
_NOISE_FACTOR = 5.0
#: least number of equal samples at the end of the range of a trace that is clipped
_LEAST_CLIPPED_SAMPLES = 5
#: drop, in steps of the digits, from a flat top to the samples as far beside the top as it is long:
#: 9 for a parabola whose top is flat because of the digits, and more for a pulse whose top is cut
#: off
_LARGEST_DROP = 20.0
#: order of the low-pass filter, which acts forwards and backwards
_ORDER = 4
#: cut-off of the automatic filter over the highest frequency of the pulse
_CUTOFF_RATIO = 2.0
#: share of the highest frequency that samples hold, above which a low-pass filter has no effect
_LARGEST_CUTOFF = 0.9
#: periods of its cut-off frequency for which the low-pass filter remembers a signal
_MEMORY = 3.0
#: least number of samples per period of a frequency whose phase is sought
_SAMPLES_PER_PERIOD = 4.0


@result_class
class TraceVelocity(Result):
    """The sound velocity that traces show.

    Attributes
    ----------
    velocity, stderr : m/s; the standard error is that of the noise of the traces alone.
    method : "threshold", "peak", "correlation" or "phase".
    filter : the filter that the traces went through, in words; "none" without a filter.
    arrivals : (m,) time of arrival at each sensor, s. By correlation, times after that at the first
        sensor; by phase, up to whole periods that all have in common.
    arrival_errors : (m,) standard errors of these times, s.
    distances : (m,) of the sensors, m.
    start : the time at which the straight line through the arrivals has the distance zero, s,
        counted as the arrivals are.
    chi2, dof : sum of squares of the differences from the straight line over their errors, 0 for
        two sensors, and its degrees of freedom, m - 2.
    p : probability that noise makes a larger sum; nan for two sensors.
    warnings : what limits the velocity.
    """

    units: ClassVar[dict[str, str]] = {"p": "1"}

    velocity: float = held(float, unit="m/s")
    stderr: float = held(float, unit="m/s")
    method: str = held(str)
    filter: str = held(str)
    arrivals: Array = held(float, "m", "s")
    arrival_errors: Array = held(float, "m", "s")
    distances: Array = held(float, "m", "m")
    start: float = held(float, unit="s")
    chi2: float = held(float)
    dof: int = held(int)
    warnings: tuple[str, ...] = held((str, ...), default=())

    @property
    def p(self) -> float:
        """Probability, a ratio, that noise makes a larger sum of squares; nan for two sensors."""
        return compute_probability(self.chi2, self.dof)


@result_class
class Traces(Result, array="signals"):
    """What sensors along a line measured, all at the same times.

    Attributes
    ----------
    times : (n,) s, evenly spaced, in ascending order.
    signals : (m, n) one row for each sensor, in any unit. Only ratios within a row count.
    distances : (m,) of the sensors from any point of the line, m, in ascending order.
    names : (m,) of the sensors; by default "1", "2", ...

    Raises :class:`~granphon.base.errors.InputError` for times that are not evenly spaced or do not
    rise, less than 16 of them, traces of other lengths, numbers that are not finite, distances that
    are not as many as traces or do not rise, names that are no texts or not as many, and a trace
    whose top or bottom is cut off.
    """

    times: Array = held(float, "n", "s")
    signals: Array = held(float, "m n")
    distances: Array = held(float, "m", "m")
    names: tuple[str, ...] = held((str, ...), default=())

    def __post_init__(self) -> None:
        """Check the traces, and put arrays of floats in place of the arguments: ``times`` (n,),
        ``signals`` (m, n), also of a single trace (n,), and ``distances`` (m,), also of a single
        number; and the tuple ``names`` (m,), by default "1", "2", ...
        """
        times = _require_even_steps(finite_array("times", self.times, "s"))
        signals = np.atleast_2d(_read_signals(self.signals))
        distances = np.atleast_1d(finite_array("distances", self.distances, "m"))
        n_sensors = len(signals)
        if signals.shape[1:] != times.shape:
            raise InputError(
                f"there are {times.size} times, and traces of {signals.shape[-1]} samples",
                mend="Give each trace a sample for each time: signals are (sensors, times)",
            )
        if distances.shape != (n_sensors,):
            given = counted(distances.size, "distance")
            if distances.ndim > 1:
                given = f"distances of the shape {distances.shape}"
            raise InputError(
                f"found {counted(n_sensors, 'trace')}, and {given}",
                mend="Give one distance for each sensor, in a list",
            )
        falls = np.flatnonzero(np.diff(distances) <= 0.0)
        if falls.size:
            nearer, farther = distances[falls[0] : falls[0] + 2].tolist()
            raise InputError(
                f"a sensor at {farther:.6g} m comes after one at {nearer:.6g} m",
                mend="Give the sensors in the order of their distances, each at its own",
            )
        default_names = tuple(str(number) for number in range(1, n_sensors + 1))
        names = texts("names", self.names) or default_names
        if len(names) != n_sensors:
            raise InputError(
                f"found {counted(n_sensors, 'trace')}, and {counted(len(names), 'name')}",
                mend="Give one name for each sensor",
            )
        for name, signal in zip(names, signals, strict=True):
            _require_unclipped(name, times, signal)
        object.__setattr__(self, "times", times)
        object.__setattr__(self, "signals", signals)
        object.__setattr__(self, "distances", distances)
        object.__setattr__(self, "names", names)
        super().__post_init__()

    @classmethod
    def read(
        cls,
        paths: str | os.PathLike[str] | Sequence[str | os.PathLike[str]],
        distances: Sequence[float] | Mapping[str, float] | None = None,
        time_step: float | None = None,
    ) -> Self:
        """Read one file, or several that have the same times.

        Parameters
        ----------
        paths : tables with a column ``time (us)`` and one for each sensor, headed with its distance
            such as ``bead 5 at 40 mm (V)`` or ``40 mm``; or HDF5 files (.h5, .hdf5, .hdf) with the
            data sets ``time`` (n,), ``signals`` (sensors, n) and ``distance`` (sensors,), of which
            time and distance have an attribute ``units``. A table may have no column of times, but
            a line ``# time step: 0.1 us`` or ``Sample Interval,1e-7,s`` above its headings; an HDF5
            file an attribute ``time_step``, s.
        distances : of the sensors, m, in the order of the columns or by their names, in place of
            those in the headings.
        time_step : s, where the file has no times.

        Raises :class:`~granphon.base.errors.InputError` for a file, line or cell that cannot be
        read, what is no path, times that are missing or given twice, distances that are missing,
        files whose times differ, and what the constructor refuses;
        :class:`~granphon.base.errors.MissingFileError` if there is no such file; and
        :class:`~granphon.base.errors.MissingPackageError` for a file of HDF5 if h5py is not
        installed.
        """
        from granphon.fits.trace_files import read_traces

        record = read_traces(paths, distances, time_step)
        try:
            return cls(record.times, record.signals, record.distances, record.names)
        except InputError as error:
            raise InputError(f"{record.where}: {error}") from None

    @property
    def time_step(self) -> float:
        """Time between two samples, s."""
        return float((self.times[-1] - self.times[0]) / (self.times.size - 1))

    def velocity(
        self,
        method: str = "threshold",
        *,
        threshold: float = THRESHOLD,
        frequency: float | None = None,
        lowpass: float | str | None = "auto",
        quiet: float | None = None,
    ) -> TraceVelocity:
        """Return the velocity, by a straight line through the times of arrival at the sensors.

        Parameters
        ----------
        method : how the time of arrival is found. "threshold": where the magnitude of the trace
            first has the share ``threshold`` of its first maximum. "peak": the first maximum of the
            magnitude that has half the height of the greatest. "correlation": where the
            cross-correlation with the first trace is greatest. "phase": from the phase at a
            ``frequency``, which gives the phase velocity; of the times that differ by periods, the
            nearest to that by correlation is taken.
        threshold : share of the maximum, between 0 and 1; for "threshold" alone.
        frequency : Hz; for "phase" alone, which needs it.
        lowpass : cut-off of the low-pass filter, Hz (Butterworth, order 4, forwards and backwards,
            so that nothing is delayed); None for no filter; "auto" for twice the highest frequency
            at which the spectrum of a trace stands out of its noise.
        quiet : time, s, up to which the traces are taken to be noise. By default each trace has its
            own: half way from its first sample to the one that first differs from its beginning by
            half of its greatest difference.

        Raises :class:`~granphon.base.errors.InputError` for less than two sensors, an unknown
        method, an option of another method or out of its range, "phase" without a frequency, a
        ``lowpass`` that is no number above zero, "auto" or None, is too high for the samples, or
        has a period longer than the record, a ``quiet`` outside of the record, a quiet part of less
        than 16 samples, a pulse or threshold that is not above five standard deviations of the
        noise, a trace that has no maximum, still rises at its end or begins above the threshold,
        traces that share no pulse, samples that are too far apart for the frequency, a frequency
        that the traces do not have, and arrivals that are not later at farther sensors.
        """
        chosen_method = one_of("method", method, METHODS)
        if len(self.signals) < 2:
            raise InputError(
                "there is one trace", "A velocity needs the arrivals at two sensors", "Give both"
            )
        share = positive("threshold", threshold)
        if share >= 1.0:
            raise InputError(f"threshold is {share:g}", mend="Give a share of the maximum, below 1")
        if share != THRESHOLD and chosen_method != "threshold":
            fault = f"threshold is given for the method {chosen_method!r}"
            raise InputError(fault, mend="Leave it out")
        if frequency is not None and chosen_method != "phase":
            fault = f"frequency is given for the method {chosen_method!r}"
            raise InputError(fault, mend="Leave it out")
        end_of_quiet = quiet
        if quiet is not None:
            in_record = partial(number, low=float(self.times[0]), high=float(self.times[-1]))
            end_of_quiet = require("quiet", in_record, quiet)
        pulses = _Pulses.of(self, end_of_quiet, lowpass)
        if chosen_method == "threshold":
            arrivals = pulses.find_crossings(share)
        elif chosen_method == "peak":
            arrivals = pulses.find_peaks()
        elif chosen_method == "correlation":
            arrivals = pulses.find_delays()
        else:
            if frequency is None:
                raise InputError("no frequency is given", mend="Give the frequency of the phase")
            arrivals = pulses.find_phases(positive("frequency", frequency, "Hz"))
        return self._fit_line(chosen_method, pulses, arrivals)

    def _fit_line(self, method: str, pulses: _Pulses, arrivals: _Arrivals) -> TraceVelocity:
        """Return the velocity of the straight line through the ``arrivals`` of ``pulses``, each
        weighted by the inverse of its error; ``method`` says how they were found.

        The line has two parameters: the time at which the pulse passes the mean distance, and its
        time of flight over the span of the distances.
        """
        distances = self.distances
        # distances from their mean, over their span: the two columns are then of one magnitude
        span = distances[-1] - distances[0]
        mean_distance = float(np.mean(distances))
        columns = np.stack([np.ones(distances.size), (distances - mean_distance) / span], axis=1)
        errors = np.sqrt(arrivals.variances)
        weighted_columns = columns / errors[:, None]
        weighted_times = arrivals.times / errors
        inverse = np.linalg.pinv(weighted_columns)
        mean_time, flight_time = inverse @ weighted_times
        flight_error = float(np.linalg.norm(inverse[1]))
        if not flight_time > 0.0:
            why = ""
            if method == "phase":
                why = "Of a tone without a beginning phases are known but for whole periods"
            raise InputError(
                "the pulse does not arrive later at farther sensors",
                why,
                "Look at the order of the distances, and at the traces by gp.plot",
            )
        residuals = weighted_times - weighted_columns @ np.array([mean_time, flight_time])
        velocity = float(span / flight_time)
        chi2 = float(residuals @ residuals)
        dof = distances.size - 2
        return TraceVelocity(
            velocity=velocity,
            stderr=velocity * flight_error / float(flight_time),
            method=method,
            filter=pulses.filter.name,
            arrivals=arrivals.times,
            arrival_errors=errors,
            distances=distances,
            start=float(mean_time - flight_time * mean_distance / span),
            chi2=chi2 if dof else 0.0,
            dof=dof,
            warnings=_judge_scatter(chi2, dof),
        )


@dataclass(frozen=True)
class _LowPass:
    """A low-pass filter without phase for signals (..., n) with samples each ``time_step``, s;
    ``cutoff`` is in Hz, and infinite for no filter.
    """

    cutoff: float
    time_step: float

    @property
    def name(self) -> str:
        """The filter in words."""
        if math.isinf(self.cutoff):
            return "none"
        return (
            f"low-pass below {self.cutoff:.4g} Hz (Butterworth, order {_ORDER}, forwards and"
            " backwards)"
        )

    @cached_property
    def _sections(self) -> Array:
        """Coefficients (n_sections, 6) of the filter."""
        from scipy.signal import butter

        sections: Array = butter(_ORDER, self.cutoff, fs=1.0 / self.time_step, output="sos")
        return sections

    def __call__(self, signals: Array) -> Array:
        """Return filtered signals (..., n)."""
        if math.isinf(self.cutoff):
            return signals
        from scipy.signal import sosfiltfilt

        # signals are continued beyond their ends by as many samples as the filter remembers
        n_remembered = math.ceil(_MEMORY / (self.cutoff * self.time_step))
        n_continued = min(signals.shape[-1] - 1, n_remembered)
        filtered: Array = sosfiltfilt(self._sections, signals, axis=-1, padlen=n_continued)
        return filtered


@dataclass(frozen=True)
class _Arrivals:
    """Times of arrival (m,), s, and the variances (m,) of their errors, s^2; the errors are
    independent of each other.
    """

    times: Array
    variances: Array


@dataclass(frozen=True)
class _Pulses:
    """The pulses of ``traces``: filtered signals (m, n), less their means before the pulse, and the
    standard deviations (m,) of the noise of single samples before the filter. Signal and noise of
    each sensor are over the greatest magnitude of its trace.
    """

    traces: Traces
    filter: _LowPass
    signals: Array
    noise: Array

    @classmethod
    def of(cls, traces: Traces, quiet: float | None, lowpass: float | str | None) -> Self:
        """Return the pulses of ``traces``; ``quiet``, s, and ``lowpass`` are the options of
        :meth:`Traces.velocity`, whose errors of a quiet part, a pulse and a cut-off are raised.
        """
        offsets = []
        noise = []
        # only ratios within a trace count: squares of very large or small numbers have no digits
        magnitudes = np.max(np.abs(traces.signals), axis=1, keepdims=True)
        scaled_signals = traces.signals / np.where(magnitudes > 0.0, magnitudes, 1.0)
        for name, signal in zip(traces.names, scaled_signals, strict=True):
            samples = signal[: _count_quiet_samples(traces, name, signal, quiet)]
            offsets.append(np.mean(samples))
            # noise below the rounding of the samples is that rounding
            noise.append(max(np.std(samples, ddof=1), ROUNDING * np.max(np.abs(signal))))
        signals = scaled_signals - np.array(offsets)[:, None]
        deviations = np.array(noise)
        lowpass_filter = _choose_filter(traces, signals, deviations, lowpass)
        pulses = cls(traces, lowpass_filter, lowpass_filter(signals), deviations)
        pulses._require_pulses()
        return pulses

    def _require_pulses(self) -> None:
        """Raise InputError if a pulse is not above the noise, or still rises at the end."""
        filtered_noise = self.filtered_noise
        heights = np.max(np.abs(self.signals), axis=1)
        silent_sensors = np.flatnonzero(heights <= _NOISE_FACTOR * filtered_noise)
        if silent_sensors.size:
            sensor = int(silent_sensors[0])
            name = self.traces.names[sensor]
            ratio = heights[sensor] / filtered_noise[sensor]
            raise InputError(
                f"no pulse arrives at sensor {name}: the trace reaches {ratio:.3g} standard"
                " deviations of its noise",
                mend="Record for longer, average several pulses, or leave the sensor out",
            )
        for name, signal, noise in zip(
            self.traces.names, self.signals, filtered_noise, strict=True
        ):
            if _still_rises(np.abs(signal), float(noise)):
                raise InputError(
                    f"the trace of sensor {name} still rises at its end",
                    "The greatest magnitude of its pulse is not known",
                    "Record for longer",
                )

    @cached_property
    def filtered_noise(self) -> Array:
        """(m,) standard deviation of the noise of single samples after the filter."""
        impulse = np.zeros(self.signals.shape[1])
        impulse[impulse.size // 2] = 1.0
        deviations: Array = self.noise * np.linalg.norm(self.filter(impulse))
        return deviations

    def find_crossings(self, share: float) -> _Arrivals:
        """Return where the magnitude of each signal, linear between samples, first has the
        ``share`` of its first maximum.

        The error of a sample shifts the crossing by its size over the slope; that of the maximum,
        times the share, shifts it the other way. Raises InputError for a signal without a maximum,
        for one that begins above the threshold, and for a threshold in the noise.
        """
        places = []
        weights = []
        for sensor, signal in enumerate(self.signals):
            magnitudes = np.abs(signal)
            top = self._find_top(sensor)
            level = share * magnitudes[top]
            name = self.traces.names[sensor]
            level_of_noise = _NOISE_FACTOR * self.filtered_noise[sensor]
            if level <= level_of_noise:
                raise InputError(
                    f"the threshold {share:g} is in the noise of sensor {name}",
                    mend=f"Give a threshold above {level_of_noise / magnitudes[top]:.2g}, a lower"
                    " cut-off of the filter, or the method 'correlation'",
                )
            crossing = int(np.argmax(magnitudes >= level))  # the first sample at the level or above
            if crossing == 0:
                raise InputError(
                    f"the trace of sensor {name} begins above the threshold",
                    mend="Start the record earlier, before the pulse",
                )
            rise = magnitudes[crossing] - magnitudes[crossing - 1]
            fraction = (level - magnitudes[crossing - 1]) / rise
            places.append(crossing - 1 + fraction)
            weight = np.zeros(signal.size)
            weight[crossing - 1] = -(1.0 - fraction) / rise * np.sign(signal[crossing - 1])
            weight[crossing] = -fraction / rise * np.sign(signal[crossing])
            weight[top] += share / rise * np.sign(signal[top])
            weights.append(weight)
        return self._make_arrivals(np.array(places), np.array(weights), self.first_time)

    def find_peaks(self) -> _Arrivals:
        """Return the first maximum of the magnitude of each signal that has half of the greatest
        height, by the parabola through three samples; the error of the slope there shifts the
        maximum by its size over the curvature. Raises InputError for a signal without a maximum.
        """
        places = []
        weights = []
        for sensor, signal in enumerate(self.signals):
            top = self._find_top(sensor)
            sign = np.sign(signal[top])
            previous, at_top, following = sign * signal[top - 1 : top + 2]
            curvature = previous - 2.0 * at_top + following
            shift = 0.5 * (previous - following) / curvature
            places.append(top + shift)
            weight = np.zeros(signal.size)
            # derivatives of the shift by the three samples
            weight[top - 1] = sign * (0.5 - shift) / curvature
            weight[top] = sign * 2.0 * shift / curvature
            weight[top + 1] = sign * (-0.5 - shift) / curvature
            weights.append(weight)
        return self._make_arrivals(np.array(places), np.array(weights), self.first_time)

    def find_delays(self) -> _Arrivals:
        """Return the delay of each signal after the first, zero for the first itself: the shift at
        which the cross-correlation of both signals is greatest in magnitude, by the parabola
        through three of its values.

        The slope of the correlation there is the product of one signal with the derivative of the
        other: an error of either is weighed with the derivative of the other, over the curvature.
        The errors of the first signal are in every delay. Raises InputError for signals whose
        correlation is greatest at its ends: they share no pulse.
        """
        from scipy.signal import correlate

        reference = self.signals[0]
        n = reference.size
        n_sensors = len(self.signals)
        places = np.zeros(n_sensors)
        weights = np.zeros((n_sensors, n))
        for sensor in range(1, n_sensors):
            signal = self.signals[sensor]
            correlation = correlate(signal, reference, mode="full", method="fft")
            top = int(np.argmax(np.abs(correlation)))
            if not 0 < top < correlation.size - 1:
                raise InputError(
                    f"the traces of sensors {self.traces.names[0]} and"
                    f" {self.traces.names[sensor]} share no pulse",
                    mend="Use another method, or look at the traces by gp.plot",
                )
            # the parabola through the greatest value and its neighbours
            previous, at_top, following = correlation[top - 1 : top + 2]
            curvature = previous - 2.0 * at_top + following
            whole_shift = top - (n - 1)  # samples; the middle of the correlation is no shift
            places[sensor] = whole_shift + 0.5 * (previous - following) / curvature
            slope_of_reference = np.gradient(_shift(reference, whole_shift))
            slope_of_signal = np.gradient(_shift(signal, -whole_shift))
            weights[sensor] = slope_of_reference / curvature
            # all delays have the same error of the first signal, if the pulse keeps its shape
            weights[0] += slope_of_signal / curvature / (n_sensors - 1)
        return self._make_arrivals(places, weights, 0.0)

    def find_phases(self, frequency: float) -> _Arrivals:
        """Return the times of arrival of the phase at a ``frequency``, Hz: -phase / (2 pi f) of the
        Fourier integral of each signal. Whole periods are added to the times so that they agree
        best with the delays of :meth:`find_delays`.

        Raises InputError for a frequency at which a period has too few samples or is longer than
        the record, for a signal that has nothing above its noise at the frequency, and for signals
        that share no pulse.
        """
        traces = self.traces
        step = traces.time_step
        samples_per_period = 1.0 / (frequency * step)
        if samples_per_period < _SAMPLES_PER_PERIOD:
            raise InputError(
                f"there are {samples_per_period:.3g} samples in a period of {frequency:.6g} Hz",
                f"The phase needs {_SAMPLES_PER_PERIOD:g}",
                f"Ask for a frequency below {1.0 / (_SAMPLES_PER_PERIOD * step):.4g} Hz",
            )
        duration = step * traces.times.size
        if frequency * duration < 1.0:
            raise InputError(
                f"the record of {duration:.4g} s is shorter than a period of {frequency:.6g} Hz",
                mend=f"Ask for a frequency above {1.0 / duration:.4g} Hz",
            )
        omega = 2.0 * math.pi * frequency
        waves = np.exp(-1j * omega * step * np.arange(traces.times.size))
        amplitudes = self.signals @ waves
        # noise in the real part of an amplitude, whose variance is half of that of the amplitude
        noise_amplitudes = self.noise * np.linalg.norm(self.filter(waves.real))
        silent_sensors = np.flatnonzero(np.abs(amplitudes) <= _NOISE_FACTOR * noise_amplitudes)
        if silent_sensors.size:
            name = traces.names[silent_sensors[0]]
            raise InputError(
                f"the trace of sensor {name} has nothing above its noise at {frequency:.6g} Hz",
                mend="Ask for a frequency of the pulse",
            )
        phase_times = -np.angle(amplitudes) / omega
        # Delays and times of phases are counted from the first sensor: neither when the record
        # begins, nor the unknown whole periods of the first phase, decides how many periods lie
        # between two sensors.
        delays = self.find_delays().times
        periods = np.rint(frequency * (delays - (phase_times - phase_times[0])))
        weights = -np.imag(waves / amplitudes[:, None]) / omega / step
        places = (phase_times + periods / frequency) / step
        return self._make_arrivals(places, weights, self.first_time)

    def _find_top(self, sensor: int) -> int:
        """Return the index of the sample at which the magnitude of the signal of a ``sensor``, an
        index too, has its first maximum of at least half the greatest height; InputError if there
        is no maximum.
        """
        magnitudes = np.abs(self.signals[sensor])
        inner = magnitudes[1:-1]
        is_maximum = (inner > magnitudes[:-2]) & (inner >= magnitudes[2:])
        is_high = inner >= _LEAST_PEAK * np.max(magnitudes)
        tops = 1 + np.flatnonzero(is_maximum & is_high)
        if not tops.size:
            raise InputError(
                f"the trace of sensor {self.traces.names[sensor]} has no maximum",
                mend="Record the whole pulse, from before its arrival to after its maximum",
            )
        return int(tops[0])

    @property
    def first_time(self) -> float:
        """The time of the first sample, s."""
        return float(self.traces.times[0])

    def _make_arrivals(self, places: Array, weights: Array, start: float) -> _Arrivals:
        """Return the arrivals at ``places`` (m,), counted in samples from the time ``start``, s.

        ``weights`` (m, n) are the derivatives of the places by the samples of the filtered signals:
        the error of a place is the sum of the errors of the samples, each times its weight. Errors
        of different samples are independent before the filter.
        """
        step = self.traces.time_step
        # the filter is symmetric: errors of the samples before the filter have filtered weights
        errors = self.noise * np.linalg.norm(self.filter(weights), axis=1)
        return _Arrivals(start + step * places, (step * errors) ** 2)


def _read_signals(values: Any) -> Array:
    """Return traces (m, n) or one trace (n,) as an array; InputError for traces of different
    lengths, and numbers that are not finite.
    """
    lengths = []
    if isinstance(values, list | tuple):
        lengths = [len(trace) for trace in values if hasattr(trace, "__len__")]
    if len(set(lengths)) > 1:
        raise InputError(
            f"the traces have {list_names(map(str, lengths))} samples",
            mend="Give each trace a sample for each time",
        )
    return finite_array("signals", values)


def _require_even_steps(times: Array) -> Array:
    """Return ``times`` (n,), s; InputError if they are few, do not rise, or are not evenly
    spaced.
    """
    if times.ndim != 1 or times.size < _LEAST_SAMPLES:
        raise InputError(
            f"there are {times.size} times", mend=f"Give {_LEAST_SAMPLES} or more, in a list"
        )
    steps = np.diff(times)
    falls = np.flatnonzero(steps <= 0.0)
    if falls.size:
        earlier, later = times[falls[0] : falls[0] + 2].tolist()
        raise InputError(
            f"the time {later:.9g} s comes after {earlier:.9g} s (sample {falls[0] + 2})",
            mend="Give times in ascending order, each once",
        )
    mean_step = float((times[-1] - times[0]) / steps.size)
    even_times = times[0] + mean_step * np.arange(times.size)
    farthest = int(np.argmax(np.abs(times - even_times)))
    # digits of a file are cut off from the times, not from their steps
    if abs(times[farthest] - even_times[farthest]) > _STEP_TOLERANCE * mean_step:
        raise InputError(
            f"the times are not evenly spaced: sample {farthest + 1} is at"
            f" {times[farthest]:.9g} s, not at {even_times[farthest]:.9g} s",
            mend="Interpolate the traces at even times, or give times of more digits",
        )
    return times


def _judge_scatter(chi2: float, dof: int) -> tuple[str, ...]:
    """Return a warning if the arrivals lie farther from a straight line than their errors explain,
    from ``chi2`` of ``dof`` degrees of freedom; none without a degree of freedom.
    """
    if not dof or compute_probability(chi2, dof) >= LEAST_CHANCE:
        return ()
    return (
        f"the arrivals scatter {math.sqrt(chi2 / dof):.3g} times as much about a straight line as"
        " noise alone makes them: the velocity changes with the distance, or the pulse with its"
        " way; the standard error does not hold that",
    )


def _require_unclipped(name: str, times: Array, signal: Array) -> None:
    """Raise InputError if the top or bottom of a trace, ``signal`` (n,) at ``times`` (n,), s, of
    the sensor ``name`` is cut off: flat, and steep beside it.
    """
    levels = np.unique(signal)
    if levels.size < 2:
        return
    digit = float(np.min(np.diff(levels)))
    for extreme in (levels[0], levels[-1]):
        start, length = _find_longest_run(signal == extreme)
        # as far before and behind the flat piece as this is long
        sample_before = start - length
        sample_after = start + 2 * length - 1
        if length < _LEAST_CLIPPED_SAMPLES or sample_before < 0 or sample_after >= signal.size:
            continue
        drop = min(abs(signal[sample_before] - extreme), abs(signal[sample_after] - extreme))
        if drop > _LARGEST_DROP * digit:
            raise InputError(
                f"the trace of sensor {name} is cut off at {extreme:.6g} for {length} samples from"
                f" {times[start]:.6g} s",
                mend="Record with a larger range",
            )


def _find_longest_run(flags: Flags) -> tuple[int, int]:
    """Return the start and the length of the longest run of true ``flags`` (n,), of which one is
    true at least.
    """
    flags_with_ends = np.concatenate([[False], flags, [False]])
    edges = np.flatnonzero(np.diff(flags_with_ends.astype(np.int8)))  # a start and an end in turn
    starts = edges[::2]
    lengths = edges[1::2] - starts
    longest = int(np.argmax(lengths))
    return int(starts[longest]), int(lengths[longest])


def _count_quiet_samples(traces: Traces, name: str, signal: Array, quiet: float | None) -> int:
    """Return how many samples at the start of a ``signal`` (n,) hold no pulse: those before the
    time ``quiet``, s, or, if that is None, half of those before the signal first differs from its
    beginning by half of its greatest difference.

    Raises InputError for a signal that does not change, and for fewer than 16 quiet samples; both
    messages name the sensor ``name``.
    """
    spread = float(np.std(signal))
    if not spread:
        raise InputError(
            f"no pulse arrives at sensor {name}: the trace does not change",
            mend="Look at its channel, or leave the sensor out",
        )
    if quiet is not None:
        count = int(np.count_nonzero(traces.times < quiet))
        content = f"it has {counted(count, 'sample')} before {quiet:.6g} s"
        mend = "Start the record earlier, or give a later quiet, the time until which it is noise"
    else:
        magnitudes = np.abs(signal - np.mean(signal[:_LEAST_SAMPLES]))
        rise = int(np.argmax(magnitudes >= _LEAST_PEAK * np.max(magnitudes)))
        count = rise // 2
        ratio = float(np.max(magnitudes)) / spread
        content = (
            f"it has half of its greatest magnitude, {ratio:.3g} standard deviations of the whole,"
            f" after {rise} samples"
        )
        mend = "Start the record earlier, or give quiet, the time until which it is noise"
    if count < _LEAST_SAMPLES:
        raise InputError(
            f"the trace of sensor {name} has no quiet part before a pulse, or no pulse: {content}",
            f"Its noise is found from {_LEAST_SAMPLES} samples or more",
            mend,
        )
    return count


def _still_rises(magnitudes: Array, noise: float) -> bool:
    """Return whether a record ends while its pulse still rises. ``magnitudes`` (n,) are those of
    the samples, and ``noise`` is the standard deviation of their noise.

    The end of the record is seen in two stretches, each as long as a quarter of the rise so far,
    and of two samples at least. The pulse still rises if the greatest sample lies in the last
    stretch, and the mean over this stretch exceeds the mean over the one before by more than five
    times the noise. In a record that is shorter than both stretches no pulse rises.
    """
    top = int(np.argmax(magnitudes))
    rise = top - int(np.argmax(magnitudes >= THRESHOLD * magnitudes[top]))
    quarter = max(rise // 4, 2)
    if magnitudes.size - top > quarter or magnitudes.size < 2 * quarter:
        return False
    late_rise = np.mean(magnitudes[-quarter:]) - np.mean(magnitudes[-2 * quarter : -quarter])
    return bool(late_rise > _NOISE_FACTOR * noise)


def _choose_filter(
    traces: Traces, signals: Array, noise: Array, lowpass: float | str | None
) -> _LowPass:
    """Return the low-pass filter for ``signals`` (m, n) with the standard deviations ``noise``
    (m,); ``lowpass`` is that of :meth:`Traces.velocity`. InputError for a cut-off that is no number
    above zero, is too high for the samples, or has a period longer than the record.

    A value of the spectrum of noise of the variance sigma^2 is above n sigma^2 x with the
    probability exp(-x): above 2 n sigma^2 ln n, noise has none of n values but once in n records.
    """
    step = traces.time_step
    highest_of_samples = 0.5 / step
    if lowpass is None:
        return _LowPass(math.inf, step)
    is_automatic = isinstance(lowpass, str) and lowpass == "auto"
    if not is_automatic:
        cutoff = positive("lowpass", lowpass, "Hz")
        if cutoff >= highest_of_samples:
            raise InputError(
                f"lowpass is {cutoff:.6g} Hz, and samples each {step:.4g} s hold frequencies below"
                f" {highest_of_samples:.6g} Hz",
                mend="Give a lower cut-off, or None for no filter",
            )
        duration = step * traces.times.size
        if cutoff * duration < 1.0:
            raise InputError(
                f"lowpass is {cutoff:.6g} Hz, whose period is longer than the record of"
                f" {duration:.4g} s",
                "The filter would leave nothing of a pulse",
                f"Give a cut-off above {1.0 / duration:.4g} Hz, or None for no filter",
            )
        return _LowPass(cutoff, step)
    n = signals.shape[1]
    spectra = np.abs(np.fft.rfft(signals, axis=1)) ** 2
    is_above_noise = spectra > 2.0 * math.log(n) * n * noise[:, None] ** 2
    frequencies = np.fft.rfftfreq(n, step)
    highest_of_pulse = float(np.max(frequencies[np.any(is_above_noise, axis=0)], initial=0.0))
    cutoff = _CUTOFF_RATIO * highest_of_pulse
    has_effect = 0.0 < cutoff < _LARGEST_CUTOFF * highest_of_samples
    return _LowPass(cutoff if has_effect else math.inf, step)


def _shift(signal: Array, samples: int) -> Array:
    """Return a ``signal`` (n,) that is later by a number of ``samples``, or earlier if the number
    is below zero. Zeros come in at the start of the later one, and at the end of the earlier one.
    """
    result = np.zeros_like(signal)
    if samples >= 0:
        result[samples:] = signal[: signal.size - samples]
    else:
        result[:samples] = signal[-samples:]
    return result
