"""Peaks of a response over frequency, between the frequencies at which it was solved.

A mode over a constant background, B + R/(p - f^2), passes through the highest value and its two
neighbours, and has its pole p. Where this line is narrower than the step of the frequencies, the
three values lie too far from the line: the response is solved at the pole and half a width beside
it, and the pole found anew, until it stands.

The response of a network is a quotient of polynomials. So one of sixth degree over another, through
values at 13 frequencies between those at which the square of the magnitude is half of that of the
peak, differs there from the response by hardly more than rounding, however other modes overlap. Its
maximum is the peak, and its width at half the square gives Q. Where the magnitude rises again
before it has fallen so far, the peak has no width of its own, and no Q.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any, NamedTuple

import numpy as np
from numpy.polynomial import polynomial
from numpy.typing import NDArray

from granphon.base.arrays import Array, Complex, Index

#: most rounds in which a narrow line is approached: the distance from its pole falls as its square
_ROUNDS = 12
#: rounds after which the change of a pole must fall to a tenth from one to the next
_FREE_ROUNDS = 3
#: change of a pole, over its half width, at which the pole stands
_STANDS = 1e-6
#: greatest change of a pole, over that of the round before, with which the approach converges
_CONVERGES = 0.1
#: least half width of a line, Im p, over the step of the squares of frequencies, with which the
#: frequencies resolve the line: its width is then a step
_RESOLVED = 0.5
#: difference of the poles of two receivers, over the half width, up to which they hear one line
_SAME_LINE = 1e-2
#: least half width of a line over the square of its frequency, 1/Q: losses of a narrower line are
#: not told from rounding
_NARROWEST = 1e-9
#: degree of the polynomials whose quotient passes through a peak
_DEGREE = 6
#: most rounds in which a peak is solved anew in the window that the last round gives
_WINDOWS = 8
#: a window over the width of its peak at half the square
_MARGIN = 1.2
#: change of a peak from one round to the next at which it stands: of its frequency over the window,
#: of its height and of Q
_SETTLED = 1e-6
#: change of a frequency, over the frequency, at which it stands in any window
_ROUNDING = 1e-9
#: least height of a peak over the highest value that it was sought at
_LOWEST = 1.0 - 1e-9
#: singular value, over the largest, up to which a quotient of a degree passes through all values
_ROUNDED = 1e-13
#: error of a place in a window
_PLACE = 1e-14
#: number of places of a quotient at which its magnitude is looked at
_MESH = 401
#: a function that returns values (n, n_r) at ascending frequencies (n,), Hz
Solve = Callable[[Array], Complex]


class Peaks(NamedTuple):
    """Peaks of a magnitude over frequency.

    Attributes
    ----------
    frequencies : (n,) Hz, at which the magnitude is greatest.
    heights : (n,) magnitude at the peaks, in the unit of the response; nan of a line that is
        narrower than the step of the frequencies, where nothing is solved between them, or no line
        is found there.
    quality : (n,) Q factors, frequencies over the widths at half the square of the height; nan if
        the peak is not resolved, or the magnitude does not fall so low on both sides.
    """

    frequencies: Array
    heights: Array
    quality: Array


def find_peaks(
    frequencies: Array, values: Complex, solve: Solve | None = None
) -> tuple[Peaks, ...]:
    """Return the peaks of the magnitude of each receiver, inside of the ascending frequencies
    (n_f,), Hz.

    ``values`` (n_f, n_r) are complex amplitudes; ``solve`` returns those at other ascending
    frequencies. Without ``solve`` a peak is that of the mode through its three values: where these
    resolve it, its Q is Re p / Im p; else, or where no pole stands, its frequency is that of the
    highest value, and neither height nor Q are known. Where the pole is farther away than its
    width, the peak is not that of one mode: its frequency and height are those of the highest
    value, and Q is not known.
    """
    magnitude = np.abs(values)
    rows, is_top = _find_tops(magnitude)
    # three values about each row: before, on and after
    squares = np.array([frequencies[rows + step] ** 2 for step in (-1, 0, 1)])
    triples = np.array([values[rows + step] for step in (-1, 0, 1)])
    fits = _fit_peaks(squares[..., None], triples, magnitude[rows])
    if solve is not None and rows.size:
        windows = _find_windows(frequencies, magnitude, rows, is_top)
        starts = fits.squares.copy()
        is_narrow = is_top & ~fits.is_broad
        lines = np.flatnonzero(np.any(is_narrow, axis=1))
        if lines.size:
            solved = _solve_lines(squares[:, lines], triples[:, lines], is_narrow[lines], solve)
            # a line lower than the highest value is not the one that this value belongs to
            is_line = solved.is_line & (solved.heights >= magnitude[rows[lines]])
            starts[lines] = np.where(is_line, solved.squares[:, None], starts[lines])
            for place in np.flatnonzero(np.all(is_line | ~is_top[lines], axis=1)).tolist():
                windows.replace(int(lines[place]), solved.windows[:, place, None])
        refined, stands = _refine_peaks(fits._replace(squares=starts), windows, is_top, solve)
        is_better = stands & (refined.heights >= _LOWEST * magnitude[rows])
        fits = _PeakFits(*(np.where(is_better, *pair) for pair in zip(refined, fits, strict=True)))
    peaks = []
    for receiver, is_peak in enumerate(is_top.T):
        peak_frequencies = np.sqrt(fits.squares[is_peak, receiver])
        heights = fits.heights[is_peak, receiver]
        quality = fits.quality[is_peak, receiver]
        peaks.append(Peaks(peak_frequencies, heights, quality))
    return tuple(peaks)


def _find_tops(magnitude: Array) -> tuple[Index, NDArray[np.bool_]]:
    """Return the rows (n,) of ``magnitude`` (n_f, n_r) in which a receiver has a highest value, and
    which receivers have one there, (n, n_r).
    """
    inner = magnitude[1:-1]
    is_top = (inner > magnitude[:-2]) & (inner >= magnitude[2:])
    inner_rows = np.flatnonzero(np.any(is_top, axis=1))
    return 1 + inner_rows, is_top[inner_rows]


class _PeakFits(NamedTuple):
    """Peaks fitted to highest values: arrays (n, n_r), over rows and receivers.

    Attributes
    ----------
    squares : of the frequencies, Hz^2.
    heights : of the magnitude; nan of a line that is too narrow.
    quality : Q factors; nan where none is known.
    is_broad : whether the line is as wide as the step of the frequencies.
    """

    squares: Array
    heights: Array
    quality: Array
    is_broad: NDArray[np.bool_]


def _fit_peaks(x: Array, values: Complex, highest: Array) -> _PeakFits:
    """Return the peaks of modes over a constant background, B + R/(p - x), each fitted to three
    ``values`` (3, n, n_r) of a receiver.

    ``x`` (3, n, 1) are squares of frequencies, Hz^2, and ``highest`` (n, n_r) the magnitudes of the
    middle values.
    """
    two_steps = x[2] - x[0]
    with np.errstate(divide="ignore", invalid="ignore"):  # two equal values have no pole
        pole = _fit_pole(x, values)
        residue = (values[2] - values[0]) * (pole - x[0]) * (pole - x[2]) / two_steps
        background = values[1] - residue / (pole - x[1])
        fitted_height = np.abs(background + residue / (1j * pole.imag))  # at x = Re p
        is_broad = np.abs(pole.imag) >= 0.5 * _RESOLVED * two_steps
        is_near = np.abs(pole.real - x[1]) <= np.maximum(pole.imag, 0.5 * two_steps)
        is_mode = is_broad & (pole.imag > 0.0) & is_near
        height_of_value = np.where(is_broad, highest, np.nan)
        return _PeakFits(
            squares=np.where(is_mode, pole.real, x[1]),
            heights=np.where(is_mode, np.maximum(fitted_height, highest), height_of_value),
            quality=np.where(is_mode, pole.real / pole.imag, np.nan),
            is_broad=is_broad,
        )


class _SolvedLines(NamedTuple):
    """Narrow lines that were solved for: squares of their frequencies (n,), Hz^2, windows (2, n) of
    frequencies about these, Hz, heights (n, n_r), and whether each receiver hears the line,
    (n, n_r).
    """

    squares: Array
    windows: Array
    heights: Array
    is_line: NDArray[np.bool_]


def _solve_lines(x: Array, values: Complex, is_narrow: Any, solve: Solve) -> _SolvedLines:
    """Return lines (n,) that are narrower than the step of the frequencies, as the response that is
    solved there has them; the arguments are those of :func:`_approach_lines`, and ``is_narrow``
    (n, n_r) says which receivers may hear a line.
    """
    pole, points, line_values = _approach_lines(x, values, is_narrow, solve)
    receiver_poles = _fit_pole(points[..., None], line_values)
    difference = np.abs(receiver_poles - pole[:, None])
    is_same = difference <= _SAME_LINE * pole.imag[:, None]
    half_width = _MARGIN * pole.imag / (2.0 * np.sqrt(points[1]))
    return _SolvedLines(
        squares=points[1],
        windows=np.sqrt(points[1]) + half_width * np.array([[-1.0], [1.0]]),
        heights=np.abs(line_values[1]),
        is_line=is_narrow & is_same,
    )


def _fit_pole(x: Array, values: Complex, weights: Any = None) -> Any:
    """Return the poles p (n, n_r) of B + R/(p - x) through three ``values`` (3, n, n_r) at ``x``
    (3, n, 1).

    With ``weights`` (n, n_r), and ``x`` (3, n), the poles (n,) are those that the receivers have in
    common, by least squares.
    """
    rise = values[1] - values[0]
    following = values[2] - values[1]
    with np.errstate(divide="ignore", invalid="ignore"):  # equal values have no pole
        if weights is None:
            ratio_of_rises = rise / following
        else:
            overlap = np.sum(weights * rise * following.conj(), axis=-1)
            ratio_of_rises = overlap / np.sum(weights * np.abs(following) ** 2, axis=-1)
        # the ratio of the slopes is (p - x_2)/(p - x_0)
        ratio_of_slopes = ratio_of_rises * (x[2] - x[1]) / (x[1] - x[0])
        return (x[2] - ratio_of_slopes * x[0]) / (1.0 - ratio_of_slopes)


def _approach_lines(
    x: Array, values: Complex, heard: Any, solve: Solve
) -> tuple[Complex, Array, Complex]:
    """Solve at lines (n,) between three points until their poles stand.

    ``x`` (3, n) are squares of frequencies, Hz^2, ``values`` (3, n, n_r), and ``heard`` (n, n_r)
    says which receivers hear a line. Returns the poles (n,), Hz^2, nan of lines that are not found,
    and the last three points (3, n), Hz^2, and values (3, n, n_r) about each.
    """
    low = x[0]
    high = x[2]
    last_points = x.copy()
    last_values = values.copy()
    poles = np.full(len(low), np.nan + 0j)
    estimates = _fit_pole(x, values, heard)
    active = np.arange(len(low))  # numbers of the lines that are still approached
    last_change = np.full(len(low), np.inf)
    for number in range(_ROUNDS):
        active = active[np.isfinite(estimates[active])]
        if not active.size:
            break
        points = _place_points(estimates[active], low[active], high[active])
        last_points[:, active] = points
        frequencies, index = np.unique(np.sqrt(points), return_inverse=True)
        last_values[:, active] = solve(frequencies)[index.reshape(points.shape)]
        renewed = _fit_pole(points, last_values[:, active], heard[active])
        change = np.abs(renewed - estimates[active])
        is_above_rounding = renewed.imag > _NARROWEST * points[1]
        stands = (change <= _STANDS * renewed.imag) & is_above_rounding
        poles[active[stands]] = renewed[stands]
        estimates[active] = renewed
        # the pole of one mode converges faster than linearly; poles of several do not
        converges = (change < _CONVERGES * last_change[active]) | (number < _FREE_ROUNDS)
        last_change[active] = change
        active = active[~stands & converges]
    return poles, last_points, last_values


def _place_points(pole: Complex, low: Array, high: Array) -> Array:
    """Return three squares of frequencies, (3, n), Hz^2, about each ``pole`` (n,): that of the
    pole, between ``low`` and ``high`` (n,), and half a width to either side.
    """
    centre = np.clip(pole.real, np.maximum(low, _NARROWEST * high), high)
    widest = 0.5 * _RESOLVED * (high - low)
    half_width = np.clip(np.abs(pole.imag), _NARROWEST * centre, widest)
    half_width = np.minimum(half_width, 0.5 * centre)  # all squares are above zero
    return np.asarray(centre + half_width * np.array([[-1.0], [0.0], [1.0]]))


# -- between the frequencies -----------------------------------------------------------------------


class _Windows(NamedTuple):
    """Windows of frequencies about peaks: their ends ``low`` and ``high`` (n,), Hz, nan without
    one, and the ``least`` and the ``greatest`` that an end may have.
    """

    low: Array
    high: Array
    least: float
    greatest: float

    def widen(self, numbers: Index, ends: Array, is_wanted: NDArray[np.bool_]) -> None:
        """Let the windows of these ``numbers`` (m,) hold those with the ``ends`` (2, m), if they
        are wanted, (m,).
        """
        chosen = numbers[is_wanted]
        ends = np.clip(ends[:, is_wanted], self.least, self.greatest)
        self.low[chosen] = np.fmin(self.low[chosen], ends[0])
        self.high[chosen] = np.fmax(self.high[chosen], ends[1])

    def find_room(self, number: int) -> NDArray[np.bool_]:
        """Return at which sides, (2,), a window may become wider."""
        return np.array([self.low[number] > self.least, self.high[number] < self.greatest])

    def replace(self, number: int, ends: Array) -> None:
        """Let a window hold those with the ``ends`` (2, k), and no more."""
        self.low[number] = max(float(np.min(ends[0])), self.least)
        self.high[number] = min(float(np.max(ends[1])), self.greatest)


def _find_windows(
    frequencies: Array, magnitude: Array, rows: Index, is_peak: NDArray[np.bool_]
) -> _Windows:
    """Return windows about peaks in the ``rows`` (n,) of magnitudes (n_f, n_r), those of all
    receivers that have one, ``is_peak`` (n, n_r): from the frequency before to the one after, or to
    those at which the square of the magnitude has fallen to half.
    """
    low, high = np.full((2, rows.size), np.nan)
    windows = _Windows(low, high, float(frequencies[0]), float(frequencies[-1]))
    for number, receiver in zip(*np.nonzero(is_peak), strict=True):
        row = int(rows[number])
        sides = []
        for side in (-1, 1):
            falling = magnitude[row::side, receiver]
            steps, _ = _count_fall(falling, float(falling[0]) * math.sqrt(0.5))
            sides.append(frequencies[row + side * max(steps, 1)])
        windows.widen(np.array([number]), np.array(sides)[:, None], np.array([True]))
    return windows


def _count_fall(values: Array, level: float) -> tuple[int, bool]:
    """Return after how many steps values (n,) have fallen to a ``level``, 0 if they have not, and
    whether they still fall at their end, above the level.
    """
    rises = np.flatnonzero(np.diff(values) > 0.0)
    falling = values[: rises[0] + 1] if rises.size else values
    low = np.flatnonzero(falling <= level)
    if low.size:
        return int(low[0]), False
    return 0, not rises.size


def _refine_peaks(
    starts: _PeakFits, windows: _Windows, is_peak: NDArray[np.bool_], solve: Solve
) -> tuple[_PeakFits, NDArray[np.bool_]]:
    """Return the peaks, (n, n_r), of the response that is solved in their ``windows``, round by
    round, and which of them stand; ``starts`` are about where they are.

    In each round the response is solved at the nodes of Chebyshev of each window whose peaks do not
    yet stand. Through these values goes a quotient of polynomials, whose peak says where the next,
    narrower window is.
    """
    fits = starts._replace(
        squares=starts.squares.copy(), heights=starts.heights.copy(), quality=starts.quality.copy()
    )
    nodes = np.cos(np.pi * (np.arange(2 * _DEGREE + 1) + 0.5) / (2 * _DEGREE + 1))
    stands = ~is_peak
    may_widen = np.ones(is_peak.shape, bool)
    for _ in range(_WINDOWS):
        active = np.flatnonzero(~np.all(stands, axis=1))
        if not active.size:
            break
        middle = 0.5 * (windows.high[active] + windows.low[active])
        half = 0.5 * (windows.high[active] - windows.low[active])
        frequencies, index = np.unique(middle + half * nodes[:, None], return_inverse=True)
        samples = solve(frequencies)[index.reshape(nodes.size, active.size)]
        for place, number in enumerate(active.tolist()):
            window = middle[place], half[place]
            has_room = windows.find_room(number)
            ends = []
            for receiver in np.flatnonzero(is_peak[number]).tolist():
                peak = number, receiver
                quotient = _Quotient.through(nodes, samples[:, place, receiver])
                change = _set_peak(fits, peak, window, quotient, has_room & may_widen[peak])
                stands[peak] = change.stands
                may_widen[peak] &= change.may_widen
                ends.append(change.ends)
            windows.replace(number, np.transpose(ends))
    return fits, stands & is_peak


class _Change(NamedTuple):
    """Whether a peak stands after a round, the ``ends`` of its next window, Hz, and whether a
    window of it may become wider.
    """

    stands: bool
    ends: tuple[float, float]
    may_widen: bool


def _set_peak(
    fits: _PeakFits,
    index: tuple[int, int],
    window: tuple[float, float],
    quotient: _Quotient,
    may_widen: NDArray[np.bool_],
) -> _Change:
    """Set a peak of ``fits``, of this ``index``, to that of a ``quotient``, which runs over the
    ``window`` of this middle and half, Hz, and may become wider at the sides (2,) that
    ``may_widen``.
    """
    middle, half = window
    last_frequency = math.sqrt(fits.squares[index])
    last_quality = fits.quality[index]
    last_height = fits.heights[index]
    peak = quotient.find_peak((last_frequency - middle) / half, may_widen)
    if peak is None:
        return _Change(stands=False, ends=(middle - half, middle + half), may_widen=False)
    frequency = middle + half * peak.place
    quality = frequency / (half * (peak.high - peak.low))
    fits.squares[index] = frequency**2
    fits.heights[index] = peak.height
    fits.quality[index] = quality
    low, high = peak.next_ends
    settled = max(_SETTLED * (high - low) * half, _ROUNDING * frequency)
    stands = abs(frequency - last_frequency) <= settled
    stands &= abs(peak.height - last_height) <= _SETTLED * peak.height
    stands &= math.isnan(quality) or abs(quality - last_quality) <= _SETTLED * quality
    ends = middle + half * low, middle + half * high
    return _Change(
        bool(stands) and not peak.is_wider, ends, peak.is_wider or not math.isnan(quality)
    )


class _PeakShape(NamedTuple):
    """A peak of a quotient.

    Attributes
    ----------
    place, height : of its maximum.
    low, high : places at which the square of the magnitude is half of that of the peak; nan if it
        does not fall so low.
    next_ends : places of the ends of the next window.
    is_wider : whether the next window is wider, as the magnitude still falls at an end.
    """

    place: float
    height: float
    low: float
    high: float
    next_ends: tuple[float, float]
    is_wider: bool


class _Quotient(NamedTuple):
    """A quotient of polynomials over the places -1 to 1, times a ``scale``: the coefficients of its
    ``top`` and of its ``bottom``.
    """

    top: Complex
    bottom: Complex
    scale: float

    @classmethod
    def through(cls, nodes: Array, values: Complex) -> _Quotient:
        """Return the quotient of the least degree through complex ``values`` at ``nodes``,
        (2 degree + 1,): of a higher one, top and bottom would share a zero that is anywhere.
        """
        scale = float(np.max(np.abs(values)))
        scaled = values[:, None] / scale
        for degree in range(_DEGREE + 1):
            powers = polynomial.polyvander(nodes, degree)
            _, singular, right = np.linalg.svd(np.hstack([powers, -scaled * powers]))
            is_whole = degree == _DEGREE or singular[-1] <= _ROUNDED * singular[0]
            if is_whole:
                break
        coefficients = right[-1].conj()
        return cls(coefficients[: degree + 1], coefficients[degree + 1 :], scale)

    def find_square(self, place: Any) -> Any:
        """Return the square of the magnitude at places, over that of the scale."""
        value = polynomial.polyval(place, self.top) / polynomial.polyval(place, self.bottom)
        return np.abs(value) ** 2

    def _find_slope(self, place: float) -> float:
        """Return the slope of the logarithm of the magnitude, which is zero at a peak."""

        def find_rate(coefficients: Complex) -> Any:
            """Return p'/p of a polynomial p at the place."""
            slope = polynomial.polyval(place, polynomial.polyder(coefficients))
            return slope / polynomial.polyval(place, coefficients)

        return float((find_rate(self.top) - find_rate(self.bottom)).real)

    def find_peak(self, expected: float, may_widen: NDArray[np.bool_]) -> _PeakShape | None:
        """Return the peak nearest to the ``expected`` place; None if there is none. Its next window
        is wider only at sides (2,) at which it may be.
        """
        from scipy.optimize import brentq

        mesh = np.linspace(-1.0, 1.0, _MESH)
        squares = self.find_square(mesh)
        tops, _ = _find_tops(squares[:, None])
        if not tops.size:
            return None
        top = int(tops[np.argmin(np.abs(mesh[tops] - expected))])
        sides = mesh[top - 1], mesh[top + 1]
        # where top and bottom have a zero in common but for rounding, there is no maximum
        if not self._find_slope(sides[0]) > 0.0 > self._find_slope(sides[1]):
            return None
        place = brentq(self._find_slope, *sides, xtol=_PLACE)
        half = 0.5 * float(self.find_square(place))
        ends = [math.nan, math.nan]
        is_open = [False, False]
        for number, side in enumerate((-1, 1)):
            steps, still_falls = _count_fall(squares[top::side], half)
            is_open[number] = still_falls and bool(may_widen[number])
            if steps:
                bracket = mesh[top + side * (steps - 1)], mesh[top + side * steps]
                ends[number] = brentq(
                    lambda end: float(self.find_square(end)) - half, *bracket, xtol=_PLACE
                )
        has_end = np.isfinite(ends)
        is_wider = bool(np.any(is_open) and np.all(has_end | is_open))
        if np.all(has_end):
            reach = 0.5 * (_MARGIN - 1.0) * (ends[1] - ends[0])
            next_ends = ends[0] - reach, ends[1] + reach
        elif is_wider:
            next_ends = (-1.0 - 2.0 * is_open[0], 1.0 + 2.0 * is_open[1])
        else:  # the magnitude rises again: half of the window holds the maximum
            next_ends = place - 0.5, place + 0.5
        height = self.scale * math.sqrt(2.0 * half)
        return _PeakShape(place, height, ends[0], ends[1], next_ends, is_wider)
