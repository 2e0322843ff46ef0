"""Times of arrival of a signal, as experimenters read them: by its envelope, its beginning, or by cross-correlation."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from granphon.base.errors import ConvergenceError, InputError, brief, message

__all__ = ["METHODS", "find_arrivals", "find_envelope"]

Array = NDArray[np.float64]
#: ways to read a time of flight
METHODS = ("envelope", "first", "correlation")
#: an earlier maximum of the envelope counts if it has this part of the greatest
_HALF = 0.5
#: the maximum is that of a parabola through the envelope where it has this part of the greatest
_NEAR = 0.9
#: part of a reading within which a signal has not travelled
_AT_ONCE = 0.05
#: a record ends, unless it is told otherwise, before what runs the other way round a periodic network comes
_MEND = "Give a longer duration; in a periodic network fewer cycles, a longer array, or ends='free'"


def find_envelope(signals: Array) -> Array:
    """Return the envelopes (..., n_t) of ``signals``: the magnitudes of their analytic signals."""
    from scipy.fft import next_fast_len
    from scipy.signal import hilbert

    count = signals.shape[-1]
    # zeros behind the record: its end is not joined to its beginning
    return np.asarray(np.abs(hilbert(signals, next_fast_len(2 * count), axis=-1))[..., :count])


def find_arrivals(times: Array, signals: Array, sent: Array, method: str, threshold: float) -> Array:
    """Return the times (n,) by which ``signals`` (n, n_t) come after ``sent`` (n_t,), s; ``times`` (n_t,) are even.

    Parameters
    ----------
    method : "envelope": between the maxima of the envelopes, of which the first counts that has half the height of the
        greatest; "first": between the times at which the envelopes first reach ``threshold`` of that maximum;
        "correlation": where the cross-correlation of both signals is greatest.

    Raises
    ------
    InputError : an unknown method.
    ConvergenceError : a signal has not reached its maximum within the record, is zero, or does not come after the burst.
    """
    if method not in METHODS:
        raise InputError(message(f"the time of flight by {brief(method)} is not known", mend=f"Use {', '.join(METHODS)}"))
    if method == "correlation":
        found = np.array([_correlate(one, sent) for one in signals])
    else:
        find = _find_maximum if method == "envelope" else _find_beginning
        start, *arrived = (find(one, threshold) for one in find_envelope(np.vstack([sent, signals])))
        found = np.array(arrived) - start
    if np.any(found <= _AT_ONCE):
        raise ConvergenceError(
            message(
                "the signal comes not after the burst",
                "What is heard has not travelled: no waves of this frequency and polarisation do, the plane is too near, "
                "or the array is far shorter than the pulse",
                "Use another frequency, fewer cycles, a longer distance, or a longer array",
            )
        )
    return np.asarray(float(times[1] - times[0]) * found)


def _refine(values: Array, place: int) -> float:
    """Return where the parabola through the values around ``place`` has its extreme, as a fraction of an index."""
    low, middle, high = values[place - 1 : place + 2]
    return place + 0.5 * float((low - high) / (low - 2.0 * middle + high))


def _find_top(envelope: Array) -> int:
    """Return the index of the first maximum that has half the height of the greatest."""
    inner = envelope[1:-1]
    peaks = 1 + np.flatnonzero((inner > envelope[:-2]) & (inner >= envelope[2:]))
    high = peaks[envelope[peaks] >= _HALF * np.max(envelope)]
    if not high.size:
        raise ConvergenceError(
            message(
                "the pulse does not arrive within the record",
                "The signal is greatest where the record ends" if np.any(envelope) else "The signal is zero",
                _MEND,
            )
        )
    return int(high[0])


def _find_maximum(envelope: Array, threshold: float) -> float:
    """Return where the parabola has its top that fits the envelope where it is near its maximum."""
    place = _find_top(envelope)
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
    if not 0 < place < found.size - 1:
        raise ConvergenceError(
            message("the pulse does not arrive within the record", "The cross-correlation is greatest at one of its ends",
                    _MEND)
        )  # fmt: skip
    return _refine(found, place)
