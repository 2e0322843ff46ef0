"""Peaks of a response over frequency, between the frequencies at which it was solved.

A peak is first described by a mode over a constant background, B + R/(p - f^2), with the pole p and
the residue R, through the highest value and its two neighbours. If this line is narrower than the
step of the frequencies, the three values lie too far from the line: the response is then solved at
the pole and half a width to either side, and the pole is found anew, until it no longer changes.

The response of a network is a quotient of polynomials. So a quotient of two polynomials of sixth
degree is put through values at 13 frequencies, between those at which the square of the magnitude
is half of that of the peak: there it differs from the response by hardly more than rounding,
however other modes overlap. The maximum of this quotient is the peak, and its width at half the
square gives Q. Where the magnitude rises again before it has fallen so far, the peak has no width
of its own, and no Q.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any, NamedTuple

import numpy as np
from numpy.polynomial import polynomial
from numpy.typing import NDArray

from granphon.base.arrays import Array, Complex, Index
from granphon.base.results import read_only

#: most rounds in which a narrow line is approached: with each round the distance from its pole, in
#: half widths, becomes about its square
_ROUNDS = 12
#: rounds after which the change of a pole must fall to a tenth from one to the next
_FREE_ROUNDS = 3
#: greatest change of a pole, over its half width, with which the pole is settled
_POLE_CHANGE = 1e-6
#: greatest change of a pole, over that of the round before, with which the approach converges
_CONVERGENCE = 0.1
#: least half width of a line, Im p, over the step of the squares of frequencies, with which the
#: frequencies resolve the line: the width of the line is then one step
_LEAST_STEPS = 0.5
#: difference of the pole of a receiver from that of all receivers, over the half width, up to which
#: the receiver has this line
_POLE_DIFFERENCE = 1e-2
#: least half width of a line over the square of its frequency, 1/Q: losses of a narrower line are
#: not told from rounding
_LEAST_WIDTH = 1e-9
#: degree of the polynomials whose quotient passes through a peak
_DEGREE = 6
#: most rounds in which the response is solved in a window about a peak; each round gives the next
#: window
_WINDOW_ROUNDS = 8
#: width of a window over the width of its peak at half the square
_MARGIN = 1.2
#: greatest change of a peak from one round to the next with which it is settled: of its frequency
#: over the width of the peak, and relative changes of its height and of Q
_PEAK_CHANGE = 1e-6
#: relative change of a frequency that is rounding, and with which it is settled in any window
_ROUNDING = 1e-9
#: least height of a refined peak over the highest given value from which its search began
_LEAST_HEIGHT = 1.0 - 1e-9
#: smallest singular value, over the largest, up to which a quotient of some degree passes through
#: all values
_RANK_TOLERANCE = 1e-13
#: error of a position in a window, of which the ends are at -1 and 1
_POSITION_ERROR = 1e-14
#: number of positions in a window at which the magnitude of a quotient is computed
_N_MESH = 401
#: a function that returns values (n, n_r) at ascending frequencies (n,), Hz
Solve = Callable[[Array], Complex]


class Peaks(NamedTuple):
    """Peaks of a magnitude over frequency; arrays are read-only.

    Attributes
    ----------
    frequencies : (n,) Hz, of the maxima of the magnitude.
    heights : (n,) magnitude at the peaks, in the unit of the response; nan if the line is narrower
        than the step of the frequencies, and the response was not solved between them or no line
        was found there.
    quality : (n,) Q factors, frequencies over the widths at half the square of the height; nan if
        the peak is not resolved, or if the magnitude does not fall so low on both sides.
    """

    frequencies: Array
    heights: Array
    quality: Array


def find_peaks(
    frequencies: Array, values: Complex, solve: Solve | None = None
) -> tuple[Peaks, ...]:
    """Return for each receiver the peaks of its magnitude that lie inside of the ascending
    ``frequencies`` (n_f,), Hz.

    ``values`` (n_f, n_r) are the complex amplitudes at these frequencies, and ``solve`` returns
    those at other ascending frequencies. With ``solve``, each peak is found as the head of this
    module says; if it does not settle, it stays as it would be without ``solve``.

    Without ``solve`` there are three cases for the mode through the highest value and its
    neighbours. If these values resolve the mode, the peak is that of the mode, and Q is
    Re p / Im p. If the mode is narrower than a step, the frequency is that of the highest value,
    and neither height nor Q is known. Else the peak is not that of one mode: its frequency and
    height are those of the highest value, and Q is not known. So it is where the pole is farther
    from the highest value than a step and half of its width, where it is that of a mode that grows,
    and where two of the values are equal, so that there is no pole.
    """
    magnitude = np.abs(values)
    rows, is_top = _find_tops(magnitude)
    tops = _Tops(
        rows=rows,
        is_top=is_top,
        # the values in each row of a maximum, and in the rows before and after it
        squares=np.array([frequencies[rows + step] ** 2 for step in (-1, 0, 1)]),
        values=np.array([values[rows + step] for step in (-1, 0, 1)]),
        heights=magnitude[rows],
    )
    fits = _fit_peaks(tops.squares[..., None], tops.values, tops.heights)
    if solve is not None and rows.size:
        windows = _find_windows(frequencies, magnitude, rows, is_top)
        starts = _place_starts(tops, fits, windows, solve)
        refined_fits, is_settled = _refine_peaks(starts, windows, is_top, solve)
        is_better = is_settled & (refined_fits.heights >= _LEAST_HEIGHT * tops.heights)
        fits = fits.replace_where(is_better, refined_fits)
    peaks = []
    for receiver, is_peak in enumerate(is_top.T):
        peak_frequencies = read_only(np.sqrt(fits.squares[is_peak, receiver]))
        heights = read_only(fits.heights[is_peak, receiver])
        quality = read_only(fits.quality[is_peak, receiver])
        peaks.append(Peaks(peak_frequencies, heights, quality))
    return tuple(peaks)


def _find_tops(magnitude: Array) -> tuple[Index, NDArray[np.bool_]]:
    """Return the rows (n,) of ``magnitude`` (n_f, n_r) in which some receiver has a maximum, and
    which receivers have one there, (n, n_r); the first and the last row have none.
    """
    inner = magnitude[1:-1]
    is_top = (inner > magnitude[:-2]) & (inner >= magnitude[2:])
    inner_rows = np.flatnonzero(np.any(is_top, axis=1))
    return 1 + inner_rows, is_top[inner_rows]


class _Tops(NamedTuple):
    """Maxima of a magnitude at the given frequencies.

    Attributes
    ----------
    rows : (n,) indices of the frequencies at which some receiver has a maximum.
    is_top : (n, n_r) which receivers have one there.
    squares : (3, n) squares of the frequencies before, at and after each row, Hz^2.
    values : (3, n, n_r) complex amplitudes there.
    heights : (n, n_r) magnitudes at the rows.
    """

    rows: Index
    is_top: NDArray[np.bool_]
    squares: Array
    values: Complex
    heights: Array


class _PeakFits(NamedTuple):
    """Peaks fitted to maxima: arrays (n, n_r) over rows, in each of which some receiver has a
    maximum, and receivers. Numbers of receivers without a maximum there mean nothing.

    Attributes
    ----------
    squares : squares of the frequencies, Hz^2.
    heights : magnitudes; nan if the line is narrower than the step of the frequencies.
    quality : Q factors; nan if not known.
    is_broad : whether the line is as wide as the step of the frequencies, or wider, or two of the
        three values are equal, so that they have no pole.
    """

    squares: Array
    heights: Array
    quality: Array
    is_broad: NDArray[np.bool_]

    def replace_where(self, is_replaced: NDArray[np.bool_], fits: _PeakFits) -> _PeakFits:
        """Return these peaks, with those of ``fits`` where ``is_replaced`` (n, n_r) is true."""
        return _PeakFits(
            squares=np.where(is_replaced, fits.squares, self.squares),
            heights=np.where(is_replaced, fits.heights, self.heights),
            quality=np.where(is_replaced, fits.quality, self.quality),
            is_broad=np.where(is_replaced, fits.is_broad, self.is_broad),
        )


def _place_starts(tops: _Tops, fits: _PeakFits, windows: _Windows, solve: Solve) -> _PeakFits:
    """Return the ``fits`` of the maxima ``tops``. Fits of lines narrower than the step of the
    frequencies are moved to the lines that ``solve`` finds.

    If all receivers with a maximum in a row have one narrow line, the window of the row in
    ``windows`` is replaced by a window about this line.
    """
    is_narrow = tops.is_top & ~fits.is_broad
    lines = np.flatnonzero(np.any(is_narrow, axis=1))  # indices of rows with a narrow line
    if not lines.size:
        return fits
    solved_lines = _solve_lines(
        tops.squares[:, lines], tops.values[:, lines], is_narrow[lines], solve
    )
    # a line lower than the highest value is not the line of this value
    is_line = solved_lines.is_line & (solved_lines.heights >= tops.heights[lines])
    is_line_of_all = np.all(is_line | ~tops.is_top[lines], axis=1)
    for number in np.flatnonzero(is_line_of_all).tolist():
        windows.replace(int(lines[number]), solved_lines.windows[:, number, None])
    squares = fits.squares.copy()
    squares[lines] = np.where(is_line, solved_lines.squares[:, None], squares[lines])
    return fits._replace(squares=squares)


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
        # negated, so that values without a pole, of which two are equal, are no narrow line
        is_broad = ~(np.abs(pole.imag) < 0.5 * _LEAST_STEPS * two_steps)
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
    """Narrow lines at which the response was solved.

    Attributes
    ----------
    squares : (n,) squares of their frequencies, Hz^2.
    windows : (2, n) lower and upper frequencies of windows about them, Hz.
    heights : (n, n_r) magnitudes of receivers there.
    is_line : (n, n_r) whether each receiver has the line.
    """

    squares: Array
    windows: Array
    heights: Array
    is_line: NDArray[np.bool_]


def _solve_lines(
    x: Array, values: Complex, is_narrow: NDArray[np.bool_], solve: Solve
) -> _SolvedLines:
    """Return n lines that are narrower than the step of the frequencies, after the response was
    solved at them; the arguments are those of :func:`_approach_lines`. No receiver has a line that
    was not found.
    """
    pole, points, line_values = _approach_lines(x, values, is_narrow, solve)
    receiver_poles = _fit_pole(points[..., None], line_values)
    difference = np.abs(receiver_poles - pole[:, None])
    is_same = difference <= _POLE_DIFFERENCE * pole.imag[:, None]
    half_width = _MARGIN * pole.imag / (2.0 * np.sqrt(points[1]))
    return _SolvedLines(
        squares=points[1],
        windows=np.sqrt(points[1]) + half_width * np.array([[-1.0], [1.0]]),
        heights=np.abs(line_values[1]),
        is_line=is_narrow & is_same,
    )


def _fit_pole(x: Array, values: Complex) -> Complex:
    """Return the complex poles p (n, n_r), Hz^2, of B + R/(p - x) through three ``values``
    (3, n, n_r) at ``x`` (3, n, 1), Hz^2; not finite where values are equal.
    """
    with np.errstate(divide="ignore", invalid="ignore"):  # equal values have no pole
        return _locate_pole(x, (values[1] - values[0]) / (values[2] - values[1]))


def _fit_common_pole(x: Array, values: Complex, is_fitted: NDArray[np.bool_]) -> Complex:
    """Return the poles (n,), Hz^2, of B + R/(p - x) that the receivers for which ``is_fitted``
    (n, n_r) is true have in common, by least squares, from three ``values`` (3, n, n_r) at ``x``
    (3, n), Hz^2; not finite where values are equal.
    """
    first_rise: Complex = np.where(is_fitted, values[1] - values[0], 0.0)
    second_rise: Complex = np.where(is_fitted, values[2] - values[1], 0.0)
    overlap = np.sum(first_rise * second_rise.conj(), axis=-1)
    square = np.sum(np.abs(second_rise) ** 2, axis=-1)
    with np.errstate(divide="ignore", invalid="ignore"):  # equal values have no pole
        return _locate_pole(x, overlap / square)


def _locate_pole(x: Array, ratio_of_rises: Complex) -> Complex:
    """Return the pole p (...), Hz^2, of the line B + R/(p - x). ``x`` (3, ...) are squares of
    frequencies, Hz^2, and ``ratio_of_rises`` (...) is the rise of the line from x[0] to x[1] over
    that from x[1] to x[2].
    """
    # the ratio of the slopes is (p - x_2)/(p - x_0)
    ratio_of_slopes = ratio_of_rises * (x[2] - x[1]) / (x[1] - x[0])
    return np.asarray((x[2] - ratio_of_slopes * x[0]) / (1.0 - ratio_of_slopes))


def _approach_lines(
    x: Array, values: Complex, is_narrow: NDArray[np.bool_], solve: Solve
) -> tuple[Complex, Array, Complex]:
    """Solve the response about n narrow lines, round by round, until their poles settle.

    ``x`` (3, n) are three squares of frequencies, Hz^2, between which each line lies, ``values``
    (3, n, n_r) the amplitudes there, and ``is_narrow`` (n, n_r) says which receivers may have the
    line, one or more. Returns the poles (n,), Hz^2, nan of lines that are not found, and the last
    three points (3, n), Hz^2, and values (3, n, n_r) about each line.
    """
    low = x[0]
    high = x[2]
    last_points = x.copy()
    last_values = values.copy()
    poles = np.full(len(low), np.nan + 0j)
    estimates = _fit_common_pole(x, values, is_narrow)
    lines = np.arange(len(low))  # indices of those whose poles are not settled yet
    last_change = np.full(len(low), np.inf)
    for number in range(_ROUNDS):
        lines = lines[np.isfinite(estimates[lines])]
        if not lines.size:
            break
        points = _place_points(estimates[lines], low[lines], high[lines])
        last_points[:, lines] = points
        frequencies, index = np.unique(np.sqrt(points), return_inverse=True)
        last_values[:, lines] = solve(frequencies)[index.reshape(points.shape)]
        new_poles = _fit_common_pole(points, last_values[:, lines], is_narrow[lines])
        change = np.abs(new_poles - estimates[lines])
        is_above_rounding = new_poles.imag > _LEAST_WIDTH * points[1]
        is_settled = (change <= _POLE_CHANGE * new_poles.imag) & is_above_rounding
        poles[lines[is_settled]] = new_poles[is_settled]
        estimates[lines] = new_poles
        # the pole of one mode converges faster than linearly; poles of several do not
        is_converging = (change < _CONVERGENCE * last_change[lines]) | (number < _FREE_ROUNDS)
        last_change[lines] = change
        lines = lines[~is_settled & is_converging]
    return poles, last_points, last_values


def _place_points(pole: Complex, low: Array, high: Array) -> Array:
    """Return three squares of frequencies, (3, n), Hz^2, about each ``pole`` (n,), complex: its
    real part, clipped to the interval from ``low`` to ``high`` (n,), and half a width of its line
    to either side, but no more than a quarter of the interval.
    """
    centre = np.clip(pole.real, np.maximum(low, _LEAST_WIDTH * high), high)
    widest = 0.5 * _LEAST_STEPS * (high - low)
    half_width = np.clip(np.abs(pole.imag), _LEAST_WIDTH * centre, widest)
    half_width = np.minimum(half_width, 0.5 * centre)  # all squares are above zero
    return np.asarray(centre + half_width * np.array([[-1.0], [0.0], [1.0]]))


# -- between the frequencies -----------------------------------------------------------------------


class _Windows(NamedTuple):
    """Windows of frequencies about peaks; :meth:`widen` and :meth:`replace` change them in place.

    Attributes
    ----------
    low, high : (n,) ends of the windows, Hz; nan before the first :meth:`widen`.
    least, greatest : lowest and highest frequency that an end may have, Hz.
    """

    low: Array
    high: Array
    least: float
    greatest: float

    def widen(self, number: int, low: float, high: float) -> None:
        """Make the window of this ``number`` wider, in place, so that it holds the frequencies from
        ``low`` to ``high``, Hz, as far as they are not below :attr:`least` or above
        :attr:`greatest`.
        """
        # fmin and fmax ignore the nan at the ends of a new window
        self.low[number] = np.fmin(self.low[number], max(low, self.least))
        self.high[number] = np.fmax(self.high[number], min(high, self.greatest))

    def find_room(self, number: int) -> NDArray[np.bool_]:
        """Return whether the window of this ``number`` may become wider at its lower and at its
        upper end, (2,).
        """
        return np.array([self.low[number] > self.least, self.high[number] < self.greatest])

    def replace(self, number: int, ends: Array) -> None:
        """Replace the window of this ``number`` by the smallest that holds k windows with the
        lower and upper ``ends`` (2, k), Hz, as far as these are not below :attr:`least` or above
        :attr:`greatest`.
        """
        self.low[number] = max(float(np.min(ends[0])), self.least)
        self.high[number] = min(float(np.max(ends[1])), self.greatest)


def _find_windows(
    frequencies: Array, magnitude: Array, rows: Index, is_peak: NDArray[np.bool_]
) -> _Windows:
    """Return a window about the peaks in each of the ``rows`` (n,) of ``magnitude`` (n_f, n_r) over
    ``frequencies`` (n_f,), Hz; ``is_peak`` (n, n_r) says which receivers have a peak there.

    To either side the window ends at the first of the frequencies at which the square of the
    magnitude has fallen to half; or if it rises before or does not fall so far, at the frequency
    next to the peak. A window holds those of all receivers with a peak in its row.
    """
    low, high = np.full((2, rows.size), np.nan)
    windows = _Windows(low, high, float(frequencies[0]), float(frequencies[-1]))
    for number, receiver in zip(*np.nonzero(is_peak), strict=True):
        row = int(rows[number])
        ends = []
        for side in (-1, 1):
            from_peak = magnitude[row::side, receiver]
            steps, _ = _count_fall(from_peak, float(from_peak[0]) * math.sqrt(0.5))
            ends.append(float(frequencies[row + side * max(steps, 1)]))
        windows.widen(int(number), *ends)
    return windows


def _count_fall(values: Array, level: float) -> tuple[int, bool]:
    """Return after how many steps ``values`` (n,), which begin at a maximum, have fallen to a
    ``level``, and whether they still fall at their end without having come to it.

    The number is 0 if they do not come to the level, or rise again before.
    """
    rises = np.flatnonzero(np.diff(values) > 0.0)
    falling_values = values[: rises[0] + 1] if rises.size else values
    low_steps = np.flatnonzero(falling_values <= level)
    if low_steps.size:
        return int(low_steps[0]), False
    return 0, not rises.size


def _refine_peaks(
    starts: _PeakFits, windows: _Windows, is_peak: NDArray[np.bool_], solve: Solve
) -> tuple[_PeakFits, NDArray[np.bool_]]:
    """Return the peaks (n, n_r) of the response as it is solved in their ``windows``, and which of
    them are settled, (n, n_r).

    ``starts`` are first estimates of the peaks, and ``is_peak`` (n, n_r) says which receivers have
    one. In each round the response is solved at Chebyshev's nodes of each window whose peaks are
    not all settled. A quotient of polynomials is put through these values, and its peak says where
    the next window is. The windows are changed.
    """
    fits = starts._replace(
        squares=starts.squares.copy(), heights=starts.heights.copy(), quality=starts.quality.copy()
    )
    nodes = np.cos(np.pi * (np.arange(2 * _DEGREE + 1) + 0.5) / (2 * _DEGREE + 1))
    is_settled = ~is_peak
    can_widen = np.ones(is_peak.shape, bool)
    for _ in range(_WINDOW_ROUNDS):
        # of the windows whose peaks are not all settled
        numbers = np.flatnonzero(~np.all(is_settled, axis=1))
        if not numbers.size:
            break
        middle = 0.5 * (windows.high[numbers] + windows.low[numbers])
        half_width = 0.5 * (windows.high[numbers] - windows.low[numbers])
        frequencies, index = np.unique(middle + half_width * nodes[:, None], return_inverse=True)
        samples = solve(frequencies)[index.reshape(nodes.size, numbers.size)]
        for column, number in enumerate(numbers.tolist()):
            window = middle[column], half_width[column]
            has_room = windows.find_room(number)
            ends = []
            for receiver in np.flatnonzero(is_peak[number]).tolist():
                peak = number, receiver
                quotient = _Quotient.through(nodes, samples[:, column, receiver])
                change = _set_peak(fits, peak, window, quotient, has_room & can_widen[peak])
                is_settled[peak] = change.is_settled
                can_widen[peak] &= change.can_widen
                ends.append(change.ends)
            windows.replace(number, np.transpose(ends))
    return fits, is_settled & is_peak


class _Change(NamedTuple):
    """The outcome of a round for a peak.

    Attributes
    ----------
    is_settled : whether the peak no longer changes.
    ends : lower and upper end of its next window, Hz.
    can_widen : whether a later window of the peak may become wider than the one before.
    """

    is_settled: bool
    ends: tuple[float, float]
    can_widen: bool


def _set_peak(
    fits: _PeakFits,
    index: tuple[int, int],
    window: tuple[float, float],
    quotient: _Quotient,
    can_widen: NDArray[np.bool_],
) -> _Change:
    """Set the peak of ``fits`` with this ``index``, of a row and a receiver, to the peak of the
    ``quotient``, and return what this changes; without a peak of the quotient, ``fits`` stay.

    The quotient runs over the ``window``, given by its middle and its half width, Hz; the next
    window may be wider at those ends for which ``can_widen`` (2,) is true.
    """
    middle, half_width = window
    last_frequency = math.sqrt(fits.squares[index])
    last_quality = fits.quality[index]
    last_height = fits.heights[index]
    peak = quotient.find_peak((last_frequency - middle) / half_width, can_widen)
    if peak is None:
        same_window = middle - half_width, middle + half_width
        return _Change(is_settled=False, ends=same_window, can_widen=False)
    frequency = middle + half_width * peak.position
    quality = frequency / (half_width * (peak.high - peak.low))
    fits.squares[index] = frequency**2
    fits.heights[index] = peak.height
    fits.quality[index] = quality
    low, high = peak.next_ends
    tolerance = max(_PEAK_CHANGE * (high - low) * half_width, _ROUNDING * frequency)
    is_settled = abs(frequency - last_frequency) <= tolerance
    is_settled &= abs(peak.height - last_height) <= _PEAK_CHANGE * peak.height
    is_settled &= math.isnan(quality) or abs(quality - last_quality) <= _PEAK_CHANGE * quality
    return _Change(
        is_settled=bool(is_settled) and not peak.is_wider,
        ends=(middle + half_width * low, middle + half_width * high),
        # a peak whose magnitude rises again has no width, and looks for one no more
        can_widen=peak.is_wider or not math.isnan(quality),
    )


class _PeakShape(NamedTuple):
    """A peak of a quotient over a window, in which positions run from -1 to 1.

    Attributes
    ----------
    position, height : those of its maximum.
    low, high : positions at which the square of the magnitude is half of that of the peak; nan if
        it does not fall so low.
    next_ends : positions of the ends of the next window.
    is_wider : whether the next window is wider, as the magnitude still falls at an end.
    """

    position: float
    height: float
    low: float
    high: float
    next_ends: tuple[float, float]
    is_wider: bool


class _Quotient(NamedTuple):
    """A quotient of polynomials over positions from -1 to 1: a ``scale`` times a ``numerator`` over
    a ``denominator``, both given by their coefficients (degree + 1,), lowest power first.
    """

    numerator: Complex
    denominator: Complex
    scale: float

    @classmethod
    def through(cls, nodes: Array, values: Complex) -> _Quotient:
        """Return the quotient of the least degree that passes through complex ``values`` at
        ``nodes``, both (2 :data:`_DEGREE` + 1,).

        In a quotient of a higher degree numerator and denominator would have a common zero at an
        arbitrary position.
        """
        scale = float(np.max(np.abs(values)))
        scaled_values = values[:, None] / scale
        for degree in range(_DEGREE + 1):
            powers = polynomial.polyvander(nodes, degree)
            # numerator - values denominator = 0 at all nodes: the last singular vector solves it
            matrix = np.hstack([powers, -scaled_values * powers])
            _, singular_values, right_rows = np.linalg.svd(matrix)
            if singular_values[-1] <= _RANK_TOLERANCE * singular_values[0]:
                break
        coefficients = right_rows[-1].conj()
        return cls(coefficients[: degree + 1], coefficients[degree + 1 :], scale)

    def find_square(self, position: Any) -> Any:
        """Return the square of the magnitude, over that of the scale, at a ``position``, a number
        or an array (...), in the same shape.
        """
        numerator = polynomial.polyval(position, self.numerator)
        denominator = polynomial.polyval(position, self.denominator)
        return np.abs(numerator / denominator) ** 2

    def _find_slope(self, position: float) -> float:
        """Return the slope of the logarithm of the magnitude at a ``position``; it is zero at a
        peak.
        """

        def find_rate(coefficients: Complex) -> Any:
            """Return p'/p at the position, of the polynomial p with these coefficients."""
            slope = polynomial.polyval(position, polynomial.polyder(coefficients))
            return slope / polynomial.polyval(position, coefficients)

        return float((find_rate(self.numerator) - find_rate(self.denominator)).real)

    def find_peak(
        self, expected_position: float, can_widen: NDArray[np.bool_]
    ) -> _PeakShape | None:
        """Return the peak nearest to the ``expected_position``; None if there is no maximum within
        -1 and 1, or if the nearest one is that of a zero which numerator and denominator have in
        common but for rounding.

        The next window of the peak holds the positions at which the square of the magnitude is half
        of that of the peak, with a margin. If the magnitude still falls at an end of this window,
        and has not come to the half, the next window is wider at this end, provided that
        ``can_widen`` (2,) is true there. If the magnitude rises again before it comes to the half,
        the next window is half as wide as this one.
        """
        from scipy.optimize import brentq

        mesh = np.linspace(-1.0, 1.0, _N_MESH)
        squares = self.find_square(mesh)
        tops, _ = _find_tops(squares[:, None])
        if not tops.size:
            return None
        top = int(tops[np.argmin(np.abs(mesh[tops] - expected_position))])
        sides = mesh[top - 1], mesh[top + 1]
        # a zero that numerator and denominator have in common but for rounding is no maximum
        if not self._find_slope(sides[0]) > 0.0 > self._find_slope(sides[1]):
            return None
        position = brentq(self._find_slope, *sides, xtol=_POSITION_ERROR)
        half_square = 0.5 * float(self.find_square(position))
        low, falls_below = self._find_end(mesh[top::-1], squares[top::-1], half_square)
        high, falls_above = self._find_end(mesh[top:], squares[top:], half_square)
        has_end = np.isfinite([low, high])
        is_open = np.array([falls_below, falls_above]) & can_widen
        is_wider = bool(np.any(is_open) and np.all(has_end | is_open))
        if np.all(has_end):
            margin = 0.5 * (_MARGIN - 1.0) * (high - low)
            next_ends = low - margin, high + margin
        elif is_wider:  # by the width of this window at each open end
            next_ends = -1.0 - 2.0 * float(is_open[0]), 1.0 + 2.0 * float(is_open[1])
        else:  # the magnitude rises again: half of the window, about the maximum
            next_ends = position - 0.5, position + 0.5
        height = self.scale * math.sqrt(2.0 * half_square)
        return _PeakShape(position, height, low, high, next_ends, is_wider)

    def _find_end(self, mesh: Array, squares: Array, half_square: float) -> tuple[float, bool]:
        """Return the position at which the square of the magnitude has fallen to ``half_square``,
        nan if it does not fall so far, and whether it still falls at the end of the window.

        ``squares`` (n,) are those at the positions ``mesh`` (n,), from the maximum of the peak to
        one end of the window.
        """
        from scipy.optimize import brentq

        steps, still_falls = _count_fall(squares, half_square)
        if not steps:
            return math.nan, still_falls

        def find_excess(position: float) -> float:
            """Return by how much the square at a ``position`` exceeds ``half_square``."""
            return float(self.find_square(position)) - half_square

        end = brentq(find_excess, mesh[steps - 1], mesh[steps], xtol=_POSITION_ERROR)
        return float(end), still_falls
