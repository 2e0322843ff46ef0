"""Times of arrival of a signal, as experimenters read them: by its envelope, its beginning, or by cross-correlation."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from granphon.base.errors import InputError, brief, message

Array = NDArray[np.float64]
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
        shifts = [_correlate(one, sent) for one in signals]
    else:
        find = _find_maximum if method == "envelope" else _find_beginning
        start, *arrived = (find(one, threshold) for one in find_envelope(np.vstack([sent, signals])))
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


def find_delay(times: Array, signal: Array, hertz: float, middle: float, reach: float) -> float:
    """Return the group delay of a ``signal`` (n_t,) at one frequency, s: -d phase / d omega of its Fourier integral.

    It counts what comes within ``reach`` of the time ``middle``, s, fading out over the last third.
    """
    gate = _make_gate(times, middle, reach)
    turned = signal * gate * np.exp(-2j * np.pi * hertz * (times - middle))
    whole = np.sum(turned)
    return middle + float(np.real(np.sum((times - middle) * turned) / whole)) if abs(whole) > 0.0 else np.nan


def find_share(times: Array, signal: Array, sent: Array, hertz: float, middle: float, reach: float) -> float:
    """Return how much of the burst's own frequency is left in a ``signal`` (n_t,), over the most that is left of any other.

    It is 1 where waves of all frequencies travel alike. What counts is as in :func:`find_delay`.
    """
    wave = np.exp(-2j * np.pi * hertz * times)

    def compare(trace: Array) -> float:
        most = float(np.max(np.abs(np.fft.rfft(trace, 2 * trace.size))))
        return abs(complex(trace @ wave)) / most

    return compare(signal * _make_gate(times, middle, reach)) / compare(sent)


def _make_gate(times: Array, middle: float, reach: float) -> Array:
    """Return weights (n_t,): 1 within two thirds of ``reach`` of the time ``middle``, falling to 0 over the rest."""
    return np.asarray(np.clip(3.0 * (1.0 - np.abs(times - middle) / reach), 0.0, 1.0))


def _refine(values: Array, place: int) -> float:
    """Return where the parabola through the values around ``place`` has its extreme, as a fraction of an index."""
    low, middle, high = values[place - 1 : place + 2]
    return place + 0.5 * float((low - high) / (low - 2.0 * middle + high))


def _find_top(envelope: Array) -> int | None:
    """Return the index of the first maximum that has half the height of the greatest value; None if none has."""
    inner = envelope[1:-1]
    peaks = 1 + np.flatnonzero((inner > envelope[:-2]) & (inner >= envelope[2:]))
    high = peaks[envelope[peaks] >= _HALF * np.max(envelope)]
    return int(high[0]) if high.size else None


def _find_maximum(envelope: Array, threshold: float) -> float:
    """Return where the parabola has its top that fits the envelope where it is near its maximum."""
    place = _find_top(envelope)
    if place is None:
        return np.nan
    low = np.flatnonzero(envelope < _NEAR * envelope[place])
    split = int(np.searchsorted(low, place))
    first = min(place - 1, int(low[split - 1]) + 1 if split else 0)
    last = max(place + 1, int(low[split]) - 1 if split < low.size else envelope.size - 1)
    near = envelope[first : last + 1] / envelope[place]
    # weights that vanish at the ends: no reading counts more or less when the next one is left out
    weight = np.sqrt(np.maximum(near - _NEAR, 1e-9))
    curve, slope, _ = np.polyfit(np.arange(first, last + 1) - place, near, 2, w=weight)
    return float(np.clip(place - 0.5 * slope / curve, first, last))


def _find_beginning(envelope: Array, threshold: float) -> float:
    top = _find_top(envelope)
    if top is None:
        return np.nan
    level = threshold * envelope[top]
    place = int(np.argmax(envelope[: top + 1] >= level))
    if place == 0:
        return 0.0
    before, after = envelope[place - 1 : place + 1]
    return place - 1 + float((level - before) / (after - before))


def _correlate(signal: Array, sent: Array) -> float:
    from scipy.signal import correlate

    found = correlate(signal, sent)[sent.size - 1 :]  # lags from zero on
    place = int(np.argmax(found))
    return _refine(found, place) if 0 < place < found.size - 1 else np.nan
