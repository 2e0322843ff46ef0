"""Work-precision diagrams: the error of a method against its time, a curve for each method, with
the setting of the method beside each point.

As in :mod:`granphon.figures.bands`, whose style the diagrams share, every function draws on an Axes
and returns the Axes.
"""

from __future__ import annotations

import itertools
import math
import textwrap
from collections.abc import Sequence
from typing import Any

from granphon.figures.scales import scale_axis, styled_figure, widen_axis

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D

from granphon.figures.style import BLUE, GREEN, ORANGE, PURPLE, VERMILION
from granphon.tradeoffs.measure import MeasuredPoint, TradeOff

#: size of a marker, in points
_MARKER = 4.0
#: colours and markers of methods: every eye tells the colours apart, and markers differ in grey
_LOOKS = tuple(zip((BLUE, VERMILION, GREEN, PURPLE, ORANGE, "#000000"), "os^DvP", strict=True))
#: of points closer than these ratios of time and error, in decades, the first has a label
_CLOSE_TIMES = 0.25
_CLOSE_ERRORS = 0.6
#: a point that takes more than this part of the time of the slowest has its label to the left
_PART_OF_SLOWEST = 0.3
#: a bar goes down by this part of its value at most, because a logarithmic axis has no zero
_BAR = 0.9
#: the floor of rounding is drawn if it is above this part of the least error
_LEAST_FLOOR = 1e-4
#: letters of a line above the axes, and distance of the title from the axes that has room for the
#: line, points
_LETTERS = 54
_PAD_OVER_LINE = 13.5
#: limits of the axis of times without a point that was run, s
_TIMES = 1e-3, 1e1
#: limits of the axis of relative errors without a point with an error
_ERRORS = 1e-8, 1e0


def plot_work_precision(result: TradeOff, ax: Axes) -> Axes:
    """Draw error against time of the points of the trade-off ``result`` that were run, on
    logarithmic axes.

    Markers are open where the reference is less than a hundred times better than the point. Bars
    are the spread of times, and the standard errors of the errors of random samples. The floor,
    a dotted line, or a number if it is far below all errors, is the largest of the condition
    numbers times rounding of points that are not random. Points without an error, because there is
    no reference or no difference from the reference, are marks at the bottom. Points that were not
    run are counted above the axes, by method. Returns ``ax``.
    """
    points = result.points
    ax.set(xscale="log", yscale="log", xlabel="Time (s)", ylabel="Relative error", title="Media")
    points_run = [point for point in points if point.ran]
    slowest = max((point.seconds for point in points_run), default=0.0)
    methods = list(dict.fromkeys(point.method for point in points))
    for method, (colour, marker) in zip(methods, itertools.cycle(_LOOKS), strict=False):
        points_of_method = [point for point in points_run if point.method == method]
        _draw_method(ax, method, points_of_method, {"color": colour, "marker": marker})
        points_with_error = [point for point in points_of_method if point.error > 0.0]
        _label_points(ax, points_with_error, slowest, colour)
    ax.margins(0.14)
    errors = [point.error for point in points_run if point.error > 0.0]
    times = []  # the ends of the bars of time, s
    for point in points_run:
        spread = _limit_spread(point)
        times += [point.seconds - spread, point.seconds + spread]
    for axis, numbers in (("x", np.array(times or _TIMES)), ("y", np.array(errors or _ERRORS))):
        scale_axis(ax, axis, numbers, 100.0)  # plain small numbers take much room
        widen_axis(ax, axis, numbers)
    if not points_run:
        ax.set_xlim(*_TIMES)
    if errors:
        floors = [point.floor for point in points if not point.failure and not point.random]
        _draw_floor(ax, max(floors, default=0.0), min(errors))
    else:
        ax.set_ylim(*_ERRORS)
        look: dict[str, Any] = {"xycoords": "axes fraction", "ha": "center", "color": "0.4"}
        ax.annotate(_explain_no_errors(points_run), (0.5, 0.5), **look)
    if points_run:
        _add_legend_below(ax, points_run)
    counts_not_run = {
        method: sum(not point.ran for point in points if point.method == method)
        for method in methods
    }
    _write_not_run(ax, counts_not_run, len(points))
    return ax


def _add_legend_below(ax: Axes, points_run: Sequence[MeasuredPoint]) -> None:
    """Add below the axes the legend of the methods, and of the markers of the points that were
    run.
    """
    handles, _ = ax.get_legend_handles_labels()
    ax.legend(
        handles=[*handles, *_explain_markers(points_run)],
        ncols=2,
        handlelength=1.4,
        columnspacing=1.0,
        loc="upper center",
        bbox_to_anchor=(0.5, -0.17),
        borderaxespad=0.0,
    )


def _explain_markers(points_run: Sequence[MeasuredPoint]) -> list[Line2D]:
    """Return the entries of the legend for full and open markers; none if no marker of the points
    that were run is open, and none for full markers if all are open.
    """
    is_open = [point.error > 0.0 and not point.resolved for point in points_run]
    if not any(is_open):
        return []
    look: dict[str, Any] = {"marker": "o", "linestyle": "none", "color": "0.4", "ms": _MARKER}
    entries = [Line2D([], [], label="open: reference is little better", mfc="white", **look)]
    if not all(is_open):
        entries.insert(0, Line2D([], [], label="full: 100 times better", **look))
    return entries


def _limit_spread(point: MeasuredPoint) -> float:
    """Return the spread of the times of a point, s, limited so that its bar ends above zero."""
    return min(point.spread, _BAR * point.seconds)


def _draw_method(
    ax: Axes, method: str, points: Sequence[MeasuredPoint], look: dict[str, Any]
) -> None:
    """Draw the curve of a method through its ``points``. Markers are open where the reference is
    not much better than the point, and points without an error stand at the bottom.

    ``look`` has matplotlib's colour and marker of the method.
    """
    points_with_error = [point for point in points if point.error > 0.0]
    # an error that is not known is nan, which is not above zero
    points_without_error = [point for point in points if not point.error > 0.0]
    label = method
    if points_with_error:
        bars = ax.errorbar(
            [point.seconds for point in points_with_error],
            [point.error for point in points_with_error],
            [min(point.stderr, _BAR * point.error) for point in points_with_error],
            [_limit_spread(point) for point in points_with_error],
            label=label,
            ms=_MARKER,
            lw=0.9,
            elinewidth=0.6,
            **look,
        )
        bars[0].set_zorder(2.5)
        label = "_"  # the legend has one entry for the method
    if points_without_error:
        ax.plot(
            [point.seconds for point in points_without_error],
            [0.0] * len(points_without_error),
            linestyle="none",
            ms=_MARKER,
            label=label,
            transform=ax.get_xaxis_transform(),
            clip_on=False,
            gid="without-error",
            **look,
        )
    points_with_open_marker = [point for point in points_with_error if not point.resolved]
    ax.plot(
        [point.seconds for point in points_with_open_marker],
        [point.error for point in points_with_open_marker],
        linestyle="none",
        mfc="white",
        ms=_MARKER,
        mew=0.9,
        zorder=3.0,
        **look,
    )


def _label_points(ax: Axes, points: Sequence[MeasuredPoint], slowest: float, colour: str) -> None:
    """Write the settings of several ``points`` of a method, which have errors above zero, beside
    the points; of points that are close together the first has a label, so that labels can be read.
    A single point has none.

    ``slowest`` is the longest time of all methods, s, and ``colour`` that of the method.
    """
    if len(points) < 2:  # a method without a setting to choose
        return
    points_with_label: list[MeasuredPoint] = []
    for point in points:
        is_close = any(
            abs(math.log10(point.seconds / neighbour.seconds)) <= _CLOSE_TIMES
            and abs(math.log10(point.error / neighbour.error)) <= _CLOSE_ERRORS
            for neighbour in points_with_label
        )
        if is_close:
            continue
        points_with_label.append(point)
        # The label stands to the right and above, as a curve falls to the right. Near the right
        # end of the axes it would not have room, and stands to the left and below.
        is_slow = point.seconds > _PART_OF_SLOWEST * slowest
        offset = -3.0 if is_slow else 3.0
        ax.annotate(
            point.knob.replace(" x ", "×"),  # a shape, "32 x 32", takes less room
            (point.seconds, point.error),
            (offset, offset),
            textcoords="offset points",
            ha="right" if is_slow else "left",
            va="top" if is_slow else "bottom",
            fontsize=7.0,
            color=colour,
        )


def _explain_no_errors(points_run: Sequence[MeasuredPoint]) -> str:
    """Return in words why none of the points that were run has an error above zero."""
    if not points_run:
        return "nothing was run"
    if any(not point.failure for point in points_run):
        return "no error above rounding"
    return "run, but without a reference"


def _draw_floor(ax: Axes, floor: float, least_error: float) -> None:
    """Draw the ``floor`` of rounding as a line or, if it is far below the ``least_error``, write
    its value at the bottom of the axes; a floor of zero is none. Both are relative errors.
    """
    style: dict[str, Any] = {"color": "0.4", "fontsize": 7.0}
    if floor > _LEAST_FLOOR * least_error:
        ax.axhline(floor, color="0.4", lw=0.8, ls=":", zorder=0)
        ax.annotate(
            "rounding",
            (1.0, floor),
            (-2.0, 2.0),
            ("axes fraction", "data"),
            "offset points",
            ha="right",
            **style,
        )
    elif floor > 0.0:
        text = f"rounding: {floor:.0e}, below"
        ax.annotate(text, (0.02, 0.02), xycoords="axes fraction", **style)


def _write_not_run(ax: Axes, counts: dict[str, int], n_points: int) -> None:
    """Write above the axes how many of ``n_points`` points were not run: the ``counts`` by method,
    or their sum alone if these take more than a line. Nothing is written if all were run.
    """
    words = ", ".join(f"{count} of {method}" for method, count in counts.items() if count)
    if not words:
        return
    text = f"not run: {words}"
    if len(textwrap.wrap(text, _LETTERS)) > 1:
        text = f"not run: {sum(counts.values())} of {n_points} points"
    ax.set_title(ax.get_title(), pad=_PAD_OVER_LINE)
    ax.annotate(
        text,
        (0.5, 1.0),
        (0.0, 3.0),
        "axes fraction",
        "offset points",
        ha="center",
        fontsize=7.0,
    )


def tradeoff_figure(result: TradeOff) -> Figure:
    """Draw a figure of the diagram of a trade-off, see :func:`plot_work_precision`."""
    with styled_figure(3.3, 3.5) as figure:
        plot_work_precision(result, figure.subplots())
        # the layout changes the width of the axes, the width changes the ticks, and the layout has
        # room for their labels
        figure.draw_without_rendering()
    return figure
