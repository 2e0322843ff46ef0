"""Fit the losses of contacts and balls to a measured transfer function: magnitude, and phase if it
is known, at given frequencies.

The model is the response of the network (:mod:`granphon.waves.response`). Where sigma is not given,
each complex value is taken to have the same relative error, so that the phase has it in radians; it
is found from the scatter. A resonance that is off by its width attracts nothing, so stiffnesses are
first searched with much damping, and then the damping; the best few are starting points of least
squares. In place of a restitution e its logarithm ln(1/e) is sought, which is zero without loss.
"""

from __future__ import annotations

import math
import os
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import lru_cache
from typing import Any, ClassVar, Self

import numpy as np
from numpy.typing import ArrayLike, NDArray

from granphon.balls import hertz
from granphon.balls.packing import LOSS_PARAMETERS, LOSSES, SECOND_LOSSES
from granphon.base.arrays import ROUNDING, Array, Flags
from granphon.base.errors import GranphonError, InputError, brief
from granphon.base.quantities import FREQUENCY, Quantity
from granphon.base.results import Result, held, result_class
from granphon.base.tables import Table
from granphon.base.text import counted, list_names
from granphon.base.validation import Low, finite_list, one_of, positive, require, texts, truth
from granphon.dynamics.damping import (
    LEAST_RESTITUTION,
    SMALL_LOSS,
    GivenLosses,
    Losses,
    find_reduced_masses,
)
from granphon.fits.fit import LARGE_ERROR, SAME_EFFECT, Fitted, WidthFit, judge_residuals
from granphon.fits.measurements import read_headings
from granphon.fits.pressed import PressedCrystal
from granphon.fits.trace_files import SAME_TIME
from granphon.fits.traces import Traces
from granphon.fits.velocity_model import require_fitted
from granphon.networks.network import ContactNetwork, given_network
from granphon.waves.response import OF_FORCE, QUANTITIES, Places
from granphon.waves.settings import RESPONSES
from granphon.waves.waves import Waves

#: residual, over its standard error, of which sums of squares and their products stay finite
_LARGEST_RESIDUAL = 1e70
#: name of the loss whose logarithm is sought
_RESTITUTION = "restitution"
#: what may be fitted, and its unit; of stiffness, load, springs to the ground and gain it is the
#: ratio to those of the network
PARAMETERS = {
    **{name: LOSSES[loss] or "1" for name, loss in LOSS_PARAMETERS.items()},
    "stiffness": "1",
    "load": "1",
    "on_site": "1",
    "wall_modulus": "Pa",
    "gain": "1",
}
#: the parameters that move resonances: where a ratio r of stiffnesses is tried, the ratio of such a
#: parameter is r to this power. r^3 times the load makes contacts r times stiffer, as stiffness
#: goes as the cubic root of the load. Springs to the ground, and the wall, move resonances less
#: than contacts do: their ratios are tried over a wider range.
_POWERS = {"stiffness": 1.0, "load": 3.0, "on_site": 2.0, "wall_modulus": 3.0}
#: loss factors from which the search starts
_LOSSES = np.geomspace(1e-3, 1.0, 10)
#: loss factor with which stiffnesses are searched
_SEARCH_LOSS = 0.1
#: least and largest loss factor up to which a loss that is nearly zero may err
_LEAST_LOSS = 1e-9
_LARGEST_LOSS = 10.0
#: least value of a scaled parameter that is no loss
_LEAST_SCALED = 1e-3
#: tolerances of scipy.optimize.least_squares: the least that it takes but for rounding
_TOLERANCES: dict[str, Any] = {"ftol": 1e-13, "xtol": 1e-13, "gtol": 1e-13}
#: ratios of the stiffness that are tried: their steps of 2.5 % move a resonance by 1.2 %, an eighth
#: of its breadth with the loss factor _SEARCH_LOSS
_STIFFNESS_RATIOS = np.geomspace(0.5, 2.0, 57)
#: number of these ratios that are followed to a minimum
_N_STARTS = 3
#: factors that convert the numbers of a table into 1 or radians
_NUMBERS = {"": 1.0, "1": 1.0, "%": 0.01, "N/N": 1.0, "m/m": 1.0}
_ANGLES = {"rad": 1.0, "deg": math.pi / 180.0, "°": math.pi / 180.0}
#: least number of samples of a segment of a record
_LEAST_SEGMENT = 16
#: probability with which noise alone exceeds the coherence of a frequency that is kept
_CHANCE_OF_NOISE = 0.01
#: warning of a fit of springs to the ground of a network whose crystal is not known
KEPT_FORCES = (
    "contacts keep their forces over the springs that are fitted, though springs bear a part of"
    " the load: give the crystal with its load, as pressure=20.0, in place of its state"
)
#: kinds of columns that a table may have
_COLUMNS = ("frequency", "magnitude", "phase", "real", "imag", "sigma", "phase_sigma")
#: quantities of the magnitudes of responses that have a unit
_MAGNITUDES = {
    "displacement": Quantity("receptance", "m/N", "2 um/N", "m/N, um/N, nm/N"),
    "velocity": Quantity("mobility", "m/s/N", "2 mm/s/N", "m/s/N, mm/s/N"),
    "acceleration": Quantity("accelerance", "m/s^2/N", "20 m/s^2/N", "m/s^2/N, 1/kg"),
    "stiffness": Quantity("dynamic stiffness", "N/m", "2 N/um", "N/m, N/um"),
}
#: units of sensors that are not calibrated: the factor to a response is not known
_RAW_UNITS = ("V/V", "V", "mV", "V/N", "mV/N", "N")


@result_class
class TransferFunction(Result):
    """A measured transfer function.

    Attributes
    ----------
    frequencies : (n,) Hz, above zero, in any order.
    magnitude : (n,) m/N, m/(N s) or 1, above zero.
    phase : (n,) rad, below zero where the receiver lags; None if it is not known.
    sigma, phase_sigma : (n,) standard errors of magnitude and phase; None if they are not known.
        Where that of the phase alone is not, it is that of the magnitude over the magnitude.
    calibrated : whether the magnitude is that of the response, and not only up to a factor, as
        volts of sensors are. A fit then needs the parameter "gain".

    Raises :class:`~granphon.base.errors.InputError` for numbers that are not finite, not above zero
    (but for the phase), or not as many as the frequencies; for a phase_sigma without phase or
    sigma; and for ``calibrated`` that is not true or false.
    """

    frequencies: Array = held(float, "n", "Hz")
    magnitude: Array = held(float, "n")
    phase: Array | None = held(float, "n?", "rad", default=None)
    sigma: Array | None = held(float, "n?", default=None)
    phase_sigma: Array | None = held(float, "n?", "rad", default=None)
    calibrated: bool = held(bool, default=True)

    def __post_init__(self) -> None:
        """Check the data, and put the arrays in place of the arguments."""
        for name in self._shapes:  # the frequencies are the first
            values: Any = getattr(self, name)
            if values is None and name not in ("frequencies", "magnitude"):
                continue
            low: Low = "" if name == "phase" else "above zero"
            numbers = np.array(finite_list(name, values, self.units.get(name, ""), low))
            object.__setattr__(self, name, numbers)
            if numbers.size != self.frequencies.size:
                words = counted(self.frequencies.size, "frequency", "frequencies")
                fault = f"found {counted(numbers.size, 'number')} of {name}, and {words}"
                raise InputError(fault, mend="Give the same number of each")
        require("calibrated", truth, self.calibrated)
        if self.phase_sigma is not None and (self.phase is None or self.sigma is None):
            words = "phase" if self.phase is None else "sigma of the magnitude"
            raise InputError(
                f"phase_sigma is given, and no {words}", mend="Give both, or leave phase_sigma out"
            )
        super().__post_init__()

    @classmethod
    def read(
        cls,
        path: str | os.PathLike[str],
        columns: Mapping[str, str] | None = None,
        quantity: str = "displacement",
    ) -> Self:
        """Read a table with a heading for each column, such as ``frequency (Hz),magnitude
        (um/N),phase (deg)``.

        Parameters
        ----------
        path : a file with the columns frequency and magnitude (or H) and, where known, phase (rad
            or deg), sigma and phase_sigma; or with real and imag in place of magnitude and phase. A
            magnitude may be in dB; sigma in the unit of the magnitude, in dB, or in % of it. A
            magnitude in V/V, V, mV, V/N, mV/N or, of a force, N is that of sensors that are not
            ``calibrated``.
        columns : headings of columns that go by other names, perhaps with a unit: {"magnitude": "H1
            (um/N)"}.
        quantity : "displacement", magnitudes in m/N; "velocity", in m/s/N; "acceleration", in
            m/s^2/N; "force", numbers or, where a wall is moved, N/m, in a column that may be named
            force; "stiffness", N/m; or "transmissibility", numbers.

        Raises :class:`~granphon.base.errors.InputError` for another quantity, ``columns`` that are
        no headings by kind, a file, line or cell that cannot be read, a column that is missing or
        has another unit, and what the constructor refuses.
        """
        chosen_quantity = one_of("quantity", quantity, QUANTITIES)
        names = read_headings(columns, _COLUMNS, "a transfer function")
        source = _SourceColumns.read(path, names, chosen_quantity)
        source.require("frequency")
        frequencies = source.table.column(source.headings["frequency"], FREQUENCY)
        is_complex = source.is_complex
        phase: Array | None
        if is_complex:
            magnitude, phase = source.read_complex()
        else:
            source.require("magnitude")
            magnitude = source.read_magnitude()
            phase = source.read_angle("phase")
        sigma = source.read_sigma(magnitude)
        phase_sigma = source.read_angle("phase_sigma")
        is_calibrated = not source.is_raw("real" if is_complex else "magnitude")
        try:
            return cls(frequencies, magnitude, phase, sigma, phase_sigma, is_calibrated)
        except InputError as error:
            raise InputError(f"{source.table.name}: {error}") from None

    @classmethod
    def from_traces(
        cls,
        drive: Traces,
        response: Traces,
        *,
        segment: float | None = None,
        band: tuple[float, float] | None = None,
    ) -> Self:
        """Return the transfer function from the ``drive`` to the ``response``, traces of one sensor
        each at the same times, by the method of Welch.

        The record is cut into segments that overlap by half, with Hann's window; the transfer
        function is the mean cross spectrum over the mean spectrum of the drive, so that noise of
        the response averages out. With the coherence C and n independent segments the relative
        standard error of the magnitude, and the error of the phase in radians, are
        ((1 - C)/(2 n C))^(1/2) (Bendat and Piersol, Random Data, 2010, equation 9.90).
        Frequencies are left out where the coherence may be that of noise alone, with a probability
        of a hundredth.

        Parameters
        ----------
        drive, response : the unit of the magnitude is that of the response over that of the drive;
            the result counts as ``calibrated``.
        segment : length of a segment, s; by default an eighth of the record. A resonance needs
            segments that are longer than it rings.
        band : lowest and highest frequency that are kept, Hz; by default all. Those up to two over
            the length of a segment, which lose their mean, are left out in any case.

        Raises
        ------
        InputError : the drive or the response is no :class:`~granphon.Traces`, or has several
            sensors; the two have different times; a trace does not change; ``segment`` is no number
            above zero, has less than 16 samples, or is longer than two thirds of the record; the
            record has less than 128 samples, and no ``segment`` is given;
            ``band`` is not two ascending frequencies from zero on, or holds no frequency that is
            kept; or nothing connects the drive and the response.
        """
        step = _require_pair(drive, response)
        n = drive.times.size
        n_segment = _choose_segment(n, step, segment)
        from scipy.signal import coherence, csd, welch

        options: dict[str, Any] = {"fs": 1.0 / step, "nperseg": n_segment}
        force = drive.signals[0]
        motion = response.signals[0]
        frequencies, spectrum = welch(force, **options)
        _, cross_spectrum = csd(force, motion, **options)
        _, coherences = coherence(force, motion, **options)
        n_independent = _count_independent(n, n_segment)
        edges = (0.0, math.inf) if band is None else _read_band(band)
        is_kept = _choose_frequencies(frequencies, coherences, n_independent, edges)
        transfer = cross_spectrum[is_kept] / spectrum[is_kept]
        coherences = np.minimum(coherences[is_kept], 1.0 - ROUNDING)
        relative_error = np.sqrt((1.0 - coherences) / (2.0 * n_independent * coherences))
        magnitude = np.abs(transfer)
        return cls(
            frequencies[is_kept],
            magnitude,
            np.unwrap(np.angle(transfer)),
            magnitude * relative_error,
            relative_error,
        )


def _read_band(band: Any) -> tuple[float, float]:
    """Return the lowest and the highest frequency of a ``band``, Hz; InputError for what is not two
    ascending frequencies, zero or above.
    """
    edges = finite_list("band", band, "Hz", "zero or above")
    if len(edges) != 2 or not edges[0] < edges[1]:
        raise InputError(f"band is {brief(band)}", mend="Give (lowest, highest), Hz")
    return edges[0], edges[1]


def _choose_frequencies(
    frequencies: Array, coherences: Array, n_independent: float, band: tuple[float, float]
) -> Flags:
    """Return which of the ``frequencies`` (n_f,) of segments, Hz, from zero on, are kept (n_f,):
    those in the ``band``, (lowest, highest), Hz, and above two over the length of a segment, at
    which noise alone would rarely have the ``coherences`` (n_f,) in a mean over ``n_independent``
    segments.

    Raises InputError if the band holds no frequency above two over the length of a segment, or if
    the coherences of those that it holds may all be those of noise.
    """
    low, high = band
    # segments have lost their means, and with these the frequencies of one window about zero: the
    # distance of two frequencies is one over the length of a segment
    is_whole = frequencies > 2.0 * frequencies[1]
    is_in_band = (frequencies >= low) & (frequencies <= high)
    if not np.any(is_whole & is_in_band):
        raise InputError(
            f"the band, {low:g} to {high:g} Hz, holds no frequency",
            f"Segments have frequencies from {frequencies[is_whole][0]:.6g} to"
            f" {frequencies[-1]:.6g} Hz, {frequencies[1]:.6g} Hz apart",
            "Give a wider band, or a longer segment",
        )
    is_coherent = coherences > _find_coherence_of_noise(_CHANCE_OF_NOISE, n_independent)
    is_kept = is_coherent & is_whole & is_in_band
    # Of many frequencies some exceed that limit by chance. At least one must exceed a higher limit,
    # which noise exceeds at any of them with the probability of a hundredth.
    least_coherence = _find_coherence_of_noise(_CHANCE_OF_NOISE / frequencies.size, n_independent)
    if not np.any(coherences[is_kept] > least_coherence):
        raise InputError(
            "nothing connects drive and response: no coherence is above"
            f" {least_coherence:.2g} in the band",
            mend="Look at the band, drive harder, or record for longer",
        )
    return np.asarray(is_kept)


def _choose_segment(n: int, step: float, segment: float | None) -> int:
    """Return the number of samples of a segment of the length ``segment``, s, by default an eighth
    of a record of ``n`` samples, ``step`` s apart; InputError if the segment is too short, or if
    two segments that overlap by half do not fit into the record.
    """
    samples = n // 8 if segment is None else positive("segment", segment, "s") / step
    n_segment = round(min(samples, 2 * n))  # any length beyond the record is refused
    if n_segment < _LEAST_SEGMENT or 3 * n_segment > 2 * n:
        raise InputError(
            f"a segment of {samples:.6g} samples, in a record of {n}",
            f"It needs {_LEAST_SEGMENT} samples or more, and two must fit in",
            "Give another segment, or record for longer",
        )
    return n_segment


def _count_independent(n: int, n_segment: int) -> float:
    """Return how many independent segments would give a mean spectrum of the same variance as the
    segments of ``n_segment`` samples that overlap by half in a record of ``n`` samples.

    Under Hann's window the signals of neighbouring segments have a correlation of 1/6, and their
    spectra one of 1/36.
    """
    n_segments = (n - n_segment) // (n_segment - n_segment // 2) + 1
    relative_variance = (1.0 + 2.0 / 36.0 * (n_segments - 1) / n_segments) / n_segments
    return 1.0 / relative_variance


def _find_coherence_of_noise(chance: float, n_independent: float) -> float:
    """Return the coherence that noise alone exceeds with the probability ``chance``, in a mean over
    n = ``n_independent`` segments: 1 - chance^(1/(n - 1)) (G. C. Carter, C. H. Knapp and A. H.
    Nuttall, IEEE Trans. Audio Electroacoust. 21, 337, 1973). Fewer than two segments count as two.
    """
    exponent = 1.0 / max(n_independent - 1.0, 1.0)
    return float(1.0 - chance**exponent)


def _require_pair(drive: Traces, response: Traces) -> float:
    """Return the step of time, s, of ``drive`` and ``response``, traces of one sensor each at the
    same times; InputError for others, and for a trace that does not change.
    """
    trace: Any
    for name, trace in (("drive", drive), ("response", response)):
        if not isinstance(trace, Traces):
            mend = "Give gp.Traces(times, signal, 0.0)"
            raise InputError(f"{name} is {brief(trace)}", mend=mend)
    for name, traces in (("drive", drive), ("response", response)):
        if len(traces.signals) != 1:
            raise InputError(
                f"{name} has {len(traces.signals)} traces",
                mend="Give one of them: gp.Traces(times, signals[0], distances[0])",
            )
    has_same_times = drive.times.shape == response.times.shape and np.allclose(
        drive.times, response.times, rtol=0.0, atol=SAME_TIME * drive.time_step
    )
    if not has_same_times:
        raise InputError(
            "drive and response have different times", mend="Interpolate them at the same times"
        )
    for name, traces in (("drive", drive), ("response", response)):
        if not np.ptp(traces.signals):
            raise InputError(f"the trace of the {name} does not change", mend="Look at its channel")
    return drive.time_step


def _list_magnitudes(quantity: str) -> tuple[str, ...]:
    """Return the names under which a column of magnitudes of a ``quantity`` is found."""
    return ("magnitude", "H", "force") if quantity in OF_FORCE else ("magnitude", "H")


def has_transfer(table: Table, columns: Mapping[str, str], quantity: str) -> bool:
    """Whether a table has a column of a transfer function of a ``quantity``, which is empty if none
    is expected; ``columns`` are headings by kind, of columns that go by other names.
    """
    names = [columns.get(kind, kind) for kind in ("magnitude", "phase", "real", "imag")]
    if quantity:
        names += _list_magnitudes(quantity)
    return any(name in table for name in names)


@dataclass(frozen=True)
class _SourceColumns:
    """The columns of a table that holds a transfer function of a ``quantity``, by their kinds.

    ``headings`` has the heading of each kind of :data:`_COLUMNS`, also of kinds that the table
    lacks.
    """

    table: Table
    headings: Mapping[str, str]
    quantity: str

    @classmethod
    def read(
        cls, path: str | os.PathLike[str], names: Mapping[str, str], quantity: str
    ) -> _SourceColumns:
        """Return the columns of the table at ``path``, which holds a transfer function of a
        ``quantity``. ``names`` are headings by kind, for kinds that go by other names; magnitudes
        are found under "H" too, and those of forces under "force".

        Raises :class:`~granphon.base.errors.InputError` for a table that cannot be read.
        """
        table = Table.read(path)
        headings = {kind: names.get(kind, kind) for kind in _COLUMNS}
        if headings["magnitude"] not in table and "magnitude" not in names:
            names_in_table = [name for name in _list_magnitudes(quantity) if name in table]
            headings["magnitude"] = names_in_table[0] if names_in_table else "magnitude"
        return cls(table, headings, quantity)

    @property
    def is_complex(self) -> bool:
        """Whether the table has real or imaginary parts, and no magnitudes; InputError if it has
        only one of both parts.
        """
        if self.has("magnitude") or not (self.has("real") or self.has("imag")):
            return False
        self.require("real")
        self.require("imag")
        return True

    def is_raw(self, kind: str) -> bool:
        """Whether the column of a ``kind`` has the unit of sensors that are not calibrated."""
        unit = self.table.unit(self.headings[kind])
        return unit in _RAW_UNITS and (unit != "N" or self.quantity in OF_FORCE)

    def has(self, kind: str) -> bool:
        """Whether the table has a column of this kind."""
        return self.headings[kind] in self.table

    def require(self, kind: str) -> None:
        """Raise InputError if the table has no column of this kind."""
        if self.has(kind):
            return
        listed = list_names(repr(str(heading)) for heading in self.table.headings)
        words = "'magnitude', or 'real' and 'imag'" if kind == "magnitude" else f"'{kind}'"
        mend = f"Head it {words}, or name it: --column '{kind}=NAME', columns={{'{kind}': 'NAME'}}"
        raise InputError(
            f"{self.table.name} has no column named {self.headings[kind]!r}",
            f"Its columns are {listed}",
            mend,
        )

    def convert(self, kind: str, factors: Mapping[str, float]) -> Array | None:
        """Return the numbers of the column of a ``kind``, (n,), times the factor of its unit; None
        if the table has no such column, or the unit is not among ``factors``, which are factors by
        unit. InputError for a cell that is no number.
        """
        unit = self.table.unit(self.headings[kind])
        if not self.has(kind) or unit not in factors:
            return None
        try:
            return factors[unit] * self.table.numbers(self.headings[kind])
        except InputError as error:
            raise InputError(f"{self.table.name}, {error}") from None

    def read_magnitude(self) -> Array:
        """Return the magnitudes, (n,), in the unit of :meth:`measure`, also of a column in dB;
        infinite or zero where decibels are beyond double precision.
        """
        decibels = self.convert("magnitude", {"dB": 1.0})
        if decibels is None:
            return self.measure("magnitude")
        with np.errstate(over="ignore", under="ignore"):  # the constructor refuses such magnitudes
            return np.asarray(10.0 ** (decibels / 20.0))

    def read_complex(self) -> tuple[Array, Array]:
        """Return the magnitudes, (n,), in the unit of :meth:`measure`, and the phases, (n,), rad,
        of real and imaginary parts; InputError if only one part has a unit of raw sensors.
        """
        if self.is_raw("real") != self.is_raw("imag"):
            units = list_names(repr(self.table.unit(self.headings[k])) for k in ("real", "imag"))
            raise InputError(
                f"{self.table.name}: the columns of real and imaginary parts have the units"
                f" {units.replace(', ', ' and ')}",
                mend="Give both the same unit",
            )
        real, imag = (self.measure(kind) for kind in ("real", "imag"))
        return np.hypot(real, imag), np.arctan2(imag, real)

    def read_sigma(self, magnitude: Array) -> Array | None:
        """Return the standard errors (n,) of magnitudes (n,), in the unit of the magnitudes; None
        if the table has no column of sigma. Errors in % or dB are relative to the magnitudes.
        """
        if not self.has("sigma"):
            return None
        percents = self.convert("sigma", {"%": 0.01})
        if percents is not None:
            return percents * magnitude
        decibels = self.convert("sigma", {"dB": math.log(10.0) / 20.0})
        return self.measure("sigma") if decibels is None else decibels * magnitude

    def read_angle(self, kind: str) -> Array | None:
        """Return the angles of the column of a ``kind``, (n,), rad; None if the table has no such
        column. Raises InputError for a column in another unit than rad or deg.
        """
        angle = self.convert(kind, _ANGLES)
        if angle is None and self.has(kind):
            fault = f"{self.table.name}: the column {self.headings[kind]!r} is not in rad or deg"
            raise InputError(fault, mend=f"Head it '{kind} (rad)'")
        return angle

    def measure(self, kind: str) -> Array:
        """Return the numbers (n,) of the column of a ``kind``, "magnitude", "real", "imag" or
        "sigma", in the SI unit of the response, such as m/N or m/s/N, or 1.

        Numbers of sensors that are not calibrated are returned in their own unit. Raises InputError
        for a column with the unit of another quantity, or without a unit if one is needed.
        """
        heading = self.headings[kind]
        unit = self.table.unit(heading)
        if self.is_raw(kind):
            numbers = self.convert(kind, {unit: 1.0})
            assert numbers is not None  # the column is there, and has this unit
            return numbers
        magnitude = _MAGNITUDES.get(self.quantity)
        if self.quantity == "force" and _MAGNITUDES["stiffness"].measures(unit):
            magnitude = _MAGNITUDES["stiffness"]
        if magnitude is None:
            return self._read_plain_numbers(kind)
        if kind in ("real", "imag"):
            magnitude = replace(magnitude, least="any")
        if unit in _NUMBERS:
            mend = (
                f"Head it '{kind} ({magnitude.unit})'; or if it is a transmissibility, give"
                f" quantity='transmissibility' (in a scene, response.quantity)"
            )
            fault = f"{self.table.name}: the column {heading!r} has no unit of {magnitude.name}"
            raise InputError(fault, mend=mend)
        return self.table.column(heading, magnitude)

    def _read_plain_numbers(self, kind: str) -> Array:
        """Return the numbers (n,) of the column of a ``kind`` of a response without a unit;
        InputError if the column has a unit that is no ratio.
        """
        numbers = self.convert(kind, _NUMBERS)
        if numbers is not None:
            return numbers
        heading = self.headings[kind]
        mend = "Leave the unit out, or use N/N, % or dB"
        if self.quantity == "force":
            mend += "; N/m of a wall that is moved; or V/V of sensors, and fit the gain"
        raise InputError(
            f"{self.table.name}: the column {heading!r} has the unit {self.table.unit(heading)!r}",
            f"A {RESPONSES[self.quantity].replace('_', ' ')} is a number",
            mend,
        )


@dataclass(frozen=True)
class _Model:
    """The transfer function of a network at (n,) frequencies, as a function of the parameters
    (p,), SI.

    ``given`` are the losses that are not fitted, and ``places`` the other arguments of
    :meth:`granphon.Waves.response`. ``pressed`` is the crystal of the network, if it is known.
    """

    network: ContactNetwork
    pressed: PressedCrystal | None
    names: tuple[str, ...]
    given: Mapping[str, Any]
    frequencies: Array
    places: dict[str, Any]

    def losses(self, values: Mapping[str, float]) -> dict[str, Any]:
        """Return the losses, SI, by the names of the arguments of :meth:`granphon.Waves.response`,
        at these ``values`` of the fitted parameters by name.

        Each loss is a pair: that of normal motion, or of displacements, and that of all other
        motion. A loss that is not fitted has its given value. If only the first of a pair is
        fitted, the second equals the first. The restitution e is no pair. Where e is fitted, the
        ``values`` hold ln(1/e) in place of e, and e is at least ``LEAST_RESTITUTION``.
        """
        losses: dict[str, Any] = {_RESTITUTION: self.given[_RESTITUTION]}
        if _RESTITUTION in values:
            losses[_RESTITUTION] = max(math.exp(-values[_RESTITUTION]), LEAST_RESTITUTION)
        for name, name_of_others in SECOND_LOSSES.items():
            given_loss, given_loss_of_others = _make_pair(self.given[name])
            loss = values.get(name, given_loss)
            default_of_others = loss if name in values else given_loss_of_others
            losses[name] = (loss, values.get(name_of_others, default_of_others))
        return losses

    def find_scale(self, name: str) -> float:
        """Return the typical value, SI, of the parameter called ``name``. For a loss it is the
        value (of ln(1/e) for the restitution e) that makes the loss factor about one at the median
        frequency, for the modulus of a wall the modulus that the wall has, and for ratios one.
        """
        network = self.network
        if name == "wall_modulus":
            return network.wall.solid.young_modulus
        omega = 2.0 * math.pi * float(np.median(self.frequencies))
        stiffness = float(np.mean(network.normal_stiffness))
        reduced_masses = find_reduced_masses(network.masses, network.i, network.j)
        impedance = math.sqrt(float(np.mean(reduced_masses)) * stiffness)  # kg/s
        scales = {
            "damping": 1.0 / omega,
            "drag": omega,
            "dashpot": stiffness / omega,
            _RESTITUTION: stiffness / (omega * impedance * SMALL_LOSS),
        }
        return scales.get(LOSS_PARAMETERS.get(name, name), 1.0)

    def _find_network(self, values: Mapping[str, float]) -> ContactNetwork:
        """Return the network whose springs to the ground and whose wall have these ``values`` of
        the fitted parameters, by name.

        If its crystal is known, the network comes to rest anew under the load; otherwise contacts
        keep the forces that they have. A wall that the crystal lacks was put in by a cut, and is
        changed in the network.
        """
        network = self.network
        ratio = values.get("on_site", 1.0)
        modulus = values.get("wall_modulus")
        pressed = self.pressed
        if pressed is not None:
            is_of_crystal = modulus is not None and bool(pressed.walls)
            network = pressed.find_network(ratio, modulus if is_of_crystal else None)
            if is_of_crystal:
                modulus = None
        elif network.on_site is not None:
            network = replace(network, on_site=ratio * network.on_site)
        if modulus is not None:
            material = replace(network.wall.solid, young_modulus=modulus)
            network = network.with_wall(material)
        return network

    def __call__(self, parameters: Array) -> NDArray[np.complex128]:
        """Return the complex transfer function (n,), in the unit of the measured one, at these
        ``parameters`` (p,), SI; nan where the pressed crystal with these parameters does not come
        to rest.
        """
        values = dict(zip(self.names, parameters.tolist(), strict=True))
        try:
            network = self._find_network(values)
        except GranphonError:
            if self.pressed is None:
                raise
            return np.full(self.frequencies.shape, np.nan, complex)
        load = values.get("load", 1.0)
        # Hertz's stiffness goes as the cubic root of the force
        stiffening = hertz.stiffness_under(load) / hertz.stiffness_under(1.0)
        factor = values.get("stiffness", 1.0) * stiffening
        scaled: dict[str, Any] = {
            "normal_stiffness": factor * network.normal_stiffness,
            "shear_stiffness": factor * network.shear_stiffness,
            "torsion_stiffness": factor * network.torsion_stiffness,
            "bending_stiffness": factor * network.bending_stiffness,
            "normal_force": load * network.normal_force,
        }
        if network.tangential_force is not None:
            scaled["tangential_force"] = load * network.tangential_force
        if network.contact_torque is not None:
            scaled["contact_torque"] = load * network.contact_torque
        # a frequency that was measured several times is solved once
        frequencies, inverse = np.unique(self.frequencies, return_inverse=True)
        response = Waves(replace(network, **scaled)).response(
            frequencies, **self.losses(values), **self.places
        )
        return np.asarray(values.get("gain", 1.0) * response.coherent[inverse])


@result_class
class DampingFit(Fitted):
    """Parameters of a network whose response fits a measured transfer function, and how well they
    are known.

    Attributes
    ----------
    parameters, values : names (p,) and SI values (p,) of the fitted parameters: damping and
        tangential_damping, s; loss_factor and tangential_loss_factor; drag and rotational_drag,
        1/s; dashpot and tangential_dashpot, N s/m; restitution; stiffness, load, on_site and gain,
        ratios to those of the network; wall_modulus, Pa.
    covariance : covariance (p, p) of their errors, SI; the attribute ``correlation`` has their
        correlations.
    damping, loss_factor : (2,) of normal and of all other motion, s and 1, as ``Waves.response``
        takes them.
    measured : the data; its sigmas are as given, or from the scatter.
    quantity : of the data, as for ``Waves.response``.
    sigma_given : whether sigma was given.
    magnitude, phase : (n,) of the fit at the data, in the unit of the data, and rad.
    chi2 : sum of the squares of residuals over sigma, which equals ``dof`` where sigma is from the
        scatter.
    dof : degrees of freedom.
    warnings : reasons not to trust the fit.
    drag, dashpot : (2,) 1/s, of displacements and of rotations; and N s/m, of normal motion and of
        slip.
    restitution : of a collision; 1 without loss.

    Of a loss that was given for each contact, the attribute is the mean over the contacts.
    """

    units: ClassVar[dict[str, str]] = {"phase": "rad"} | {
        name: unit or "1" for name, unit in LOSSES.items()
    }
    _notebook_fields = ("stderrs",)
    _units_of_parameters = PARAMETERS

    parameters: tuple[str, ...] = held((str, ...), "p")
    values: Array = held(float, "p")
    covariance: Array = held(float, "p p")
    damping: Array = held(float, "2")
    loss_factor: Array = held(float, "2")
    measured: TransferFunction = held(TransferFunction)
    quantity: str = held(str)
    sigma_given: bool = held(bool)
    magnitude: Array = held(float, "n")
    phase: Array = held(float, "n")
    chi2: float = held(float)
    dof: int = held(int)
    warnings: tuple[str, ...] = held((str, ...))
    drag: Array = held(float, "2", default_factory=lambda: np.zeros(2))
    dashpot: Array = held(float, "2", default_factory=lambda: np.zeros(2))
    restitution: float = held(float, default=1.0)

    @property
    def unit(self) -> str:
        """The unit of the magnitudes: "1" of sensors that are not calibrated."""
        return QUANTITIES[self.quantity] if self.measured.calibrated else "1"

    def _field_units(self) -> dict[str, str]:
        """Return the SI unit of each field, with that of the measured magnitudes."""
        return super()._field_units() | {"magnitude": self.unit}

    def _list_columns(self) -> dict[str, Any]:
        """Return the columns of fit.csv, (n,), by their headings."""
        data = self.measured
        unit = self.unit
        columns: dict[str, Any] = {
            "frequency (Hz)": data.frequencies,
            f"magnitude ({unit})": data.magnitude,
            f"sigma ({unit})": data.sigma,
            f"fit ({unit})": self.magnitude,
            "fitted phase (rad)": self.phase,
        }
        if data.phase is not None:
            columns |= {"phase (rad)": data.phase, "phase_sigma (rad)": data.phase_sigma}
        return columns


def read_fit(data: Any) -> WidthFit | DampingFit:
    """Build the fit of either class from ``data``, the plain data of its fit.yaml. Raises
    :class:`~granphon.base.errors.InputError` for data of neither class.
    """
    is_damping = isinstance(data, Mapping) and data.get("class") == DampingFit.__name__
    return DampingFit.from_dict(data) if is_damping else WidthFit.from_dict(data)


def find_secant(
    compare: Callable[[Array], Array], values: Array, index: int, scatter: float, name: str
) -> Array:
    """Return the slope (n,) of the secant of the residuals along one loss, which takes the place of
    a derivative in a Jacobian: the change of the residuals over the step of the loss at which the
    norm of the change equals the ``scatter``.

    Where a loss is nearly zero, magnitudes depend on its square only, so that the derivative is
    about zero and says nothing of the error of the loss. The secant gives the error at which the
    misfit rises by that of one standard deviation.

    ``compare`` returns the residuals (n,) at parameters (p,) in units of typical values, and
    ``values`` (p,) are the best ones; ``index`` is the index of the loss among them, and ``name``
    its name in messages. The step is 1e-9 or more.

    Raises :class:`~granphon.base.errors.InputError` if none of the steps 1e-9, 2e-9, 4e-9 and so on
    up to 10 changes the residuals so much.
    """
    from scipy.optimize import brentq

    best_residuals = compare(values)
    direction = np.zeros(values.size)
    direction[index] = 1.0

    def change(step: float) -> Array:
        """Return the change of the residuals, (n,), when the loss rises by a step."""
        return compare(values + step * direction) - best_residuals

    def rise(logarithm: float) -> float:
        """Return by how much the change at a step, of this logarithm, exceeds the scatter."""
        return float(np.linalg.norm(change(math.exp(logarithm)))) - scatter

    # the loss is doubled until the residuals change by their scatter, then found between the last
    # two losses
    logarithm = math.log(_LEAST_LOSS)
    while rise(logarithm) < 0.0:
        logarithm += math.log(2.0)
        if logarithm > math.log(_LARGEST_LOSS):
            raise InputError(f"the data say nothing of {name}", mend="Measure nearer to resonances")
    if logarithm > math.log(_LEAST_LOSS):
        # three digits of the step do for a standard error
        logarithm = brentq(rise, logarithm - math.log(2.0), logarithm, xtol=1e-3)
    step = math.exp(logarithm)
    return change(step) / step


def fit_damping(
    x: Any,
    measured: TransferFunction,
    source: Any,
    receiver: Any,
    *,
    parameters: Sequence[str] = ("damping",),
    damping: Any = 0.0,
    loss_factor: Any = 0.0,
    drag: Any = 0.0,
    dashpot: Any = 0.0,
    restitution: Any = 1.0,
    quantity: str = "displacement",
    direction: ArrayLike | None = None,
    polarisation: str | ArrayLike | None = None,
    distance: float | None = None,
    finite_overlap: bool | None = None,
    **load: float,
) -> DampingFit:
    """Find the losses of contacts and balls at which the response of a network is a measured
    transfer function.

    Parameters
    ----------
    x : a state, a sample or a network, as for :class:`granphon.Waves`, finite or cut as in the
        experiment; or a :class:`granphon.Crystal`, with its load.
    measured : the transfer function, :class:`TransferFunction`.
    source, receiver, quantity, direction, polarisation, distance : as for
        :meth:`granphon.Waves.response`; of several receivers, those of a plane say, the mean is
        compared.
    parameters : one or more of "damping", s; "loss_factor"; "drag", 1/s; "dashpot", N s/m;
        "tangential_damping", "tangential_loss_factor" and "tangential_dashpot", of slip, twist and
        rolling, which are otherwise those of normal motion; "rotational_drag", otherwise that of
        displacements; "restitution"; "stiffness", by which all stiffnesses are multiplied; "load",
        by which static forces are, and stiffnesses by its cubic root, as in Hertz's law; "on_site",
        by which springs to the ground are; "wall_modulus", the Young modulus of the wall, Pa; and
        "gain", by which the whole response is, where sensors are not calibrated.
    damping, loss_factor, drag, dashpot, restitution : losses that are not fitted, as for
        :meth:`granphon.Waves.response`.
    load, finite_overlap : of a crystal, the load by its kind, as ``pressure=20.0`` (N), and whether
        its overlap is finite, as for its states. The crystal then comes to rest anew over springs,
        or on a wall, that are fitted. Contacts of a state or network keep their forces, and a
        warning says so of springs.

    Returns
    -------
    :class:`DampingFit`. Standard errors are those of linear theory, from the given sigma or from
    the scatter. A loss whose error exceeds its value has the error at which the misfit has risen by
    that of one standard deviation.

    Raises :class:`~granphon.base.errors.InputError` for data that are no
    :class:`TransferFunction`, or are of sensors that are not calibrated and no gain is fitted;
    parameters that cannot be fitted or told apart, too few data, losses of which the data say
    nothing, data far beyond the response, a receiver that no wave reaches, a load of what is no
    crystal, a crystal without a load, a ``finite_overlap`` without a load, and what
    :meth:`granphon.Waves.response` refuses.
    """
    names = texts("parameters", parameters)
    pressed = x if isinstance(x, PressedCrystal) else None
    if load:
        pressed = PressedCrystal.of(x, load, finite_overlap)
    elif finite_overlap is not None:
        problem = f"finite_overlap is given for {brief(x)}, and no load"
        why = "Its contacts have their overlaps"
        raise InputError(problem, why, "Leave finite_overlap out, or give a crystal with its load")
    network = given_network(x if pressed is None else pressed)
    _require_fittable(names, network, measured)
    # wrong values are refused before the fit
    fixed_losses = {
        "damping": damping,
        "loss_factor": loss_factor,
        "drag": drag,
        "dashpot": dashpot,
        _RESTITUTION: restitution,
    }
    given_losses = Losses.of(network, GivenLosses(**fixed_losses))
    places = {
        "source": source,
        "receiver": receiver,
        "quantity": quantity,
        "direction": direction,
        "polarisation": polarisation,
        "distance": distance,
    }
    model = _Model(network, pressed, names, fixed_losses, measured.frequencies, places)
    comparison = _Comparison(model, measured)
    _require_data(comparison.dof, len(names), sigma_given=measured.sigma is not None)
    warnings = given_losses.find_warnings(float(np.max(measured.frequencies)))
    quantity_of_data = Places(network, direction, polarisation, distance).find_quantity(
        quantity, source
    )
    return _make_fit(comparison, quantity_of_data, warnings)


def _make_fit(
    comparison: _Comparison, quantity: str, warnings_of_losses: Iterable[str]
) -> DampingFit:
    """Return the fit at the lowest minimum of a ``comparison``; its warnings are those on the
    losses that are given, and on the fit itself. ``quantity`` is the word of
    :meth:`granphon.Waves.response` for what is compared, or "stiffness" in place of "force" if the
    source is held. The comparison must have one degree of
    freedom or more, or zero or more if sigma is given (:func:`_require_data`).

    Raises InputError as the methods of the comparison do.
    """
    model = comparison.model
    measured = comparison.measured
    names = comparison.names
    dof = comparison.dof
    sigma_given = measured.sigma is not None
    best = comparison.find_best()
    chi2 = 2.0 * float(best.cost)  # scipy's cost is half the sum of squares
    scatter = 1.0 if sigma_given else max(math.sqrt(chi2 / dof), float(np.finfo(float).eps))
    jacobian = comparison.find_jacobian(best, scatter)
    covariance = comparison.find_covariance(jacobian, scatter)
    values = best.x * comparison.scale
    warnings = list(warnings_of_losses)
    if sigma_given:
        warnings += judge_residuals(chi2, dof, len(names))
    warnings += _judge_errors(names, values, np.sqrt(np.diag(covariance)))
    if "on_site" in names and model.pressed is None:
        warnings.append(KEPT_FORCES)
    losses = model.losses(dict(zip(names, values.tolist(), strict=True)))
    values, covariance = _find_restitution(names, values, covariance)
    with_errors = replace(
        measured,
        sigma=comparison.sigma * scatter,
        phase_sigma=None if measured.phase is None else comparison.phase_sigma * scatter,
    )
    return DampingFit(
        parameters=names,
        values=values,
        covariance=covariance,
        **{name: _average_contacts(losses[name]) for name in SECOND_LOSSES},
        restitution=float(np.mean(losses[_RESTITUTION])),
        measured=with_errors,
        quantity=quantity,
        sigma_given=sigma_given,
        magnitude=np.abs(comparison.respond(best.x)),
        phase=comparison.find_phases(best.x),
        chi2=chi2 if sigma_given else float(dof),
        dof=dof,
        warnings=tuple(warnings),
    )


def _require_fittable(names: Sequence[str], network: ContactNetwork, measured: Any) -> None:
    """Raise InputError unless ``measured`` is a transfer function to which the parameters ``names``
    of the network can be fitted.
    """
    if not isinstance(measured, TransferFunction):
        raise InputError(
            "the data are no transfer function",
            mend="Give a gp.TransferFunction(frequencies, magnitude)",
        )
    require_fitted(names, PARAMETERS)
    if {"stiffness", "load"} <= set(names) and not network.prestress:
        why = "Without prestress a load does no more than scale stiffnesses"
        raise InputError("the data cannot tell stiffness and load apart", why, "Fit one of them")
    if "on_site" in names and network.on_site is None:
        mend = "Give them to the crystal: gp.Crystal(..., on_site=...), crystal.on_site"
        raise InputError("there are no springs to the ground to fit", mend=mend)
    if not measured.calibrated and "gain" not in names:
        raise InputError(
            "the sensors are not calibrated",
            "The data have the unit of a sensor, and not of a response",
            'Fit the gain too: parameters=("damping", "gain"), --parameter gain',
        )


class _Comparison:
    """A measured transfer function beside that of a model, whose parameters are scaled.

    Attributes
    ----------
    scale : (p,) typical values of the parameters, SI. "Scaled" parameters are SI values over these.
    is_loss : (p,) whether a parameter is a loss.
    sigma : (n,) standard errors of magnitudes, in their unit; the magnitudes themselves, relative
        errors of 1, if they are not known.
    phase_sigma : (n,) standard errors of phases, rad.
    phasor : (n,) exp(i phase) of the measured phases; 1 if these are not known.
    """

    def __init__(self, model: _Model, measured: TransferFunction) -> None:
        """Set up the comparison of a ``model`` with the ``measured`` transfer function."""
        self.model = model
        self.measured = measured
        self.names = model.names
        magnitude = measured.magnitude
        self.sigma = magnitude if measured.sigma is None else measured.sigma
        self.phase_sigma = self.sigma / magnitude
        if measured.phase_sigma is not None:
            self.phase_sigma = measured.phase_sigma
        self.phasor: Any = np.ones(magnitude.size)
        if measured.phase is not None:
            self.phasor = np.exp(1j * measured.phase)
        self.scale = np.array([model.find_scale(name) for name in self.names])
        self.is_loss = np.array([name in LOSS_PARAMETERS for name in self.names])
        self._respond = lru_cache(maxsize=16)(self._find_response)

    @property
    def dof(self) -> int:
        """Degrees of freedom: magnitudes and phases less parameters."""
        magnitudes = self.measured.magnitude.size
        numbers = magnitudes if self.measured.phase is None else 2 * magnitudes
        return numbers - len(self.names)

    def _find_response(self, parameters: tuple[float, ...]) -> NDArray[np.complex128]:
        """Return the transfer function (n,) of the model; a tuple of ``parameters``, SI, can be the
        key of a cache.
        """
        return self.model(np.array(parameters))

    def respond(self, scaled: Array) -> NDArray[np.complex128]:
        """Return the complex transfer function (n,) of the model at ``scaled`` parameters (p,).

        The last few responses of the network are kept: another gain needs no other response.
        """
        parameters = scaled * self.scale
        if "gain" not in self.names:
            return self._respond(tuple(parameters.tolist()))
        index = self.names.index("gain")
        gain = float(parameters[index])
        parameters[index] = 1.0
        return np.asarray(gain * self._respond(tuple(parameters.tolist())))

    def compare(self, scaled: Array) -> Array:
        """Return the residuals of magnitudes, and of phases if they are known, over sigma, (n,) or
        (2 n,), at ``scaled`` parameters (p,).
        """
        response = self.respond(scaled)
        residuals = (self.measured.magnitude - np.abs(response)) / self.sigma
        if self.measured.phase is None:
            return np.asarray(residuals)
        phase_differences = np.angle(self.phasor / response)
        return np.concatenate([residuals, phase_differences / self.phase_sigma])

    def compare_logarithms(self, scaled: Array) -> Array:
        """Return the differences of logarithms of magnitudes, and of phases, rad, if they are
        known, (n,) or (2 n,), at ``scaled`` parameters (p,): infinite and nan where the model does
        not respond.
        """
        response = self.respond(scaled)
        with np.errstate(divide="ignore", invalid="ignore"):
            differences = np.log(self.measured.magnitude / np.abs(response))
            if self.measured.phase is None:
                return np.asarray(differences)
            return np.concatenate([differences, np.angle(self.phasor / response)])

    def find_start(self, loss: float, stiffer: float = 1.0) -> tuple[float, Array]:
        """Return the sum of squares of :meth:`compare_logarithms`, infinite where the model does
        not respond, and the scaled parameters (p,), with the gain that fits best.

        The losses add up to ``loss``. A parameter of :data:`_POWERS` is ``stiffer`` to the power
        that it has there: where the stiffness or the load is fitted, contacts are ``stiffer`` times
        as stiff as those of the network; where both are, they are ``stiffer`` squared times as
        stiff.
        """
        ratios = np.array([stiffer ** _POWERS.get(name, 0.0) for name in self.names])
        scaled = np.where(self.is_loss, loss / max(int(np.sum(self.is_loss)), 1), ratios)
        differences = self.compare_logarithms(scaled)
        if not np.all(np.isfinite(differences)):  # no balls come to rest, or none respond
            return math.inf, scaled
        if "gain" in self.names:
            # the gain that fits best is the mean ratio of magnitudes, in logarithms
            differences_of_magnitudes = differences[: self.measured.magnitude.size]
            gain = math.exp(float(np.mean(differences_of_magnitudes)))
            scaled[self.names.index("gain")] = gain
            differences = self.compare_logarithms(scaled)
        return float(differences @ differences), scaled

    def list_starts(self) -> list[Array]:
        """Return the scaled parameters (p,) from which minima are sought, the best first.

        Raises :class:`~granphon.base.errors.InputError` if at none of the parameters that are tried
        the model responds, be it that contacts do not connect source and receiver, or that no balls
        come to rest over the springs.
        """
        ratios = [1.0]
        if _POWERS.keys() & set(self.names):
            ratios = self._find_best_ratios()
        losses = _LOSSES.tolist() if np.any(self.is_loss) else [0.0]
        starts = [self.find_start(loss, ratio) for ratio in ratios for loss in losses]
        starts.sort(key=lambda misfit_and_parameters: misfit_and_parameters[0])
        best = starts[: len(ratios)]
        # the misfit is infinite where the model does not respond or no balls come to rest
        starts_of_descent = [parameters for misfit, parameters in best if math.isfinite(misfit)]
        if not starts_of_descent:
            problem = "the model has no response at the receiver"
            why = ""
            mend = "Look at source and receiver: contacts must connect them"
            if "on_site" in self.names:
                why = "Contacts do not connect it with the source, or no balls come to rest"
                mend = "Look at source and receiver, and at the springs to the ground"
            raise InputError(problem, why, mend)
        return starts_of_descent

    def _find_best_ratios(self) -> list[float]:
        """Return the three ratios of :data:`_STIFFNESS_RATIOS`, as ``stiffer`` of
        :meth:`find_start`, at which the response with a large loss factor fits best, the best
        first. The loss makes resonances so broad that one that is off by its width is still found.
        """
        misfits = []
        for ratio in _STIFFNESS_RATIOS.tolist():
            misfit, _ = self.find_start(_SEARCH_LOSS, ratio)
            misfits.append((misfit, ratio))
        misfits.sort()
        return [ratio for _, ratio in misfits[:_N_STARTS]]

    def find_best(self) -> Any:
        """Return scipy's result of least squares at the lowest minimum: ``x`` (p,) scaled,
        ``cost``, ``jac``. InputError for data so far from the response that squares overflow.
        """
        starts = self.list_starts()
        with np.errstate(over="ignore"):
            largest = max(float(np.max(np.abs(self.compare(start)))) for start in starts)
        if largest > _LARGEST_RESIDUAL:
            problem = f"the response is up to {largest:.1g} standard errors from the data"
            raise InputError(problem, mend="Look at the units of the data, and of sigma")
        fits = [self._descend(start) for start in starts]
        return min(fits, key=lambda fit: float(fit.cost))

    def _descend(self, start: Array) -> Any:
        """Return scipy's result at the minimum that is reached from the scaled parameters ``start``
        (p,).
        """
        from scipy.optimize import least_squares

        # a loss may vanish. Any other parameter keeps a thousandth of its scale, because a
        # stiffness, a load or a gain of zero has no response
        low = np.where(self.is_loss, 0.0, _LEAST_SCALED)
        # a gain of sensors may have any size: its scale is its start, and its bound a thousandth of
        # the start where that is below one
        is_gain = np.array([name == "gain" for name in self.names])
        low[is_gain] *= np.minimum(start[is_gain], 1.0)
        high = np.full(low.shape, np.inf)
        return least_squares(
            self.compare,
            start,
            "3-point",
            (low, high),
            x_scale=np.where(is_gain, start, np.maximum(start, _LEAST_SCALED)),
            **_TOLERANCES,
        )

    def find_jacobian(self, best: Any, scatter: float) -> Array:
        """Return the derivatives of residuals by scaled parameters, (n, p), or (2 n, p) with
        phases, at a minimum ``best`` of :meth:`find_best`.

        ``scatter`` is the standard deviation of the residuals. A loss so near to zero that, by its
        derivative, to put it to zero would change the residuals by less than the scatter has a
        secant in place of the derivative, see :func:`find_secant`. InputError if the data say
        nothing of such a loss.
        """
        jacobian = np.array(best.jac)
        change_to_zero = np.linalg.norm(jacobian, axis=0) * best.x
        for index in np.flatnonzero(self.is_loss & (change_to_zero < scatter)).tolist():
            jacobian[:, index] = find_secant(
                self.compare, best.x, index, scatter, self.names[index]
            )
        return jacobian

    def find_covariance(self, jacobian: Array, scatter: float) -> Array:
        """Return the covariance (p, p) of the parameters, SI, from the ``jacobian`` of
        :meth:`find_jacobian`: the derivatives, (n, p) or (2 n, p), of residuals by scaled
        parameters. ``scatter`` is the standard deviation of the residuals.

        InputError if a parameter has no effect, or if the effects of the parameters are linearly
        dependent.
        """
        norms = np.linalg.norm(jacobian, axis=0)
        if np.any(norms == 0.0):
            name = self.names[int(np.argmin(norms))]
            raise InputError(f"the data say nothing of {name}", mend="Fit fewer parameters")
        _, singular_values, right_vectors = np.linalg.svd(jacobian / norms, full_matrices=False)
        if singular_values[-1] < SAME_EFFECT * singular_values[0]:
            fault = f"the data cannot tell {' and '.join(self.names)} apart"
            raise InputError(fault, mend="Measure a wider range, or fit fewer parameters")
        # J diag(1/norms) is U S V^T, so that (J^T J)^-1 of the derivatives J is R R^T with the root
        # R (p, p) = diag(1/norms) V S^-1
        scaled_root = (right_vectors / singular_values[:, None]).T / norms[:, None]
        root = scaled_root * self.scale[:, None] * scatter
        return np.asarray(root @ root.T)

    def find_phases(self, scaled: Array) -> Array:
        """Return the phases (n,) of the model, rad, at ``scaled`` parameters (p,): no more than
        half a turn from the measured phases, if these are known, else from -pi to pi.
        """
        response = self.respond(scaled)
        if self.measured.phase is None:
            return np.angle(response)
        return np.asarray(self.measured.phase - np.angle(self.phasor / response))


def _find_restitution(
    names: Sequence[str], values: Array, covariance: Array
) -> tuple[Array, Array]:
    """Return the fitted ``values`` (p,) of the parameters ``names`` and their ``covariance``
    (p, p), in which the restitution e takes the place of ln(1/e), the number that the fit seeks.
    The other parameters are unchanged.
    """
    is_logarithm = np.array([name == _RESTITUTION for name in names])
    restitution = np.exp(-np.where(is_logarithm, values, 0.0))
    slope = np.where(is_logarithm, -restitution, 1.0)
    return np.where(is_logarithm, restitution, values), covariance * np.outer(slope, slope)


def _make_pair(loss: Any) -> tuple[Any, Any]:
    """Return the loss of normal motion and that of all other motion: ``loss`` is a tuple of both,
    or one loss that holds for both.
    """
    return (loss[0], loss[1]) if isinstance(loss, tuple) else (loss, loss)


def _average_contacts(pair: tuple[Any, Any]) -> Array:
    """Return the means (2,) over the contacts of a pair of losses, of which each is a number or
    (n_c,).
    """
    return np.array([float(np.mean(losses)) for losses in pair])


def _require_data(dof: int, n_parameters: int, *, sigma_given: bool) -> None:
    """Raise InputError if there are too few measured numbers for ``n_parameters``: ``dof``, the
    difference of both, must be zero or above, and one or above unless ``sigma_given``, because the
    scatter takes one more.
    """
    n_needed = 0 if sigma_given else 1
    if dof >= n_needed:
        return
    n_numbers = dof + n_parameters
    numbers = counted(n_numbers, "measured number")
    parameters = counted(n_parameters, "parameter")
    fault = f"{parameters} cannot be fitted to {numbers}"
    why = "" if sigma_given else "Without sigma one more is needed, to find the scatter"
    raise InputError(fault, why, "Measure more, or fit fewer parameters")


def _judge_errors(names: Sequence[str], values: Array, errors: Array) -> list[str]:
    """Return a warning for each of the parameters ``names`` whose standard error is above half its
    value; ``values`` and ``errors`` are (p,), SI, and those of ln(1/e) for the restitution e.
    """
    words = {_RESTITUTION: "ln(1/restitution)"}
    return [
        f"the standard error of {words.get(name, name)} is {error:.2g}, and its value {value:.2g}:"
        f" it can hardly be told from zero"
        for name, value, error in zip(names, values.tolist(), errors.tolist(), strict=True)
        if error > LARGE_ERROR * value
    ]
