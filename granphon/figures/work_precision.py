"""Work-precision diagrams: the error of a method against its time, a curve for each method, its
knob beside each point.

As in :mod:`granphon.figures.bands`, whose style they share, every function draws on an Axes and
returns it.
"""

from __future__ import annotations

import itertools
import math
import textwrap
from typing import Any

from granphon.figures.scales import scale_axis, styled_figure, widen_axis

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from granphon.figures.style import BLUE, GREEN, ORANGE, PURPLE, VERMILION
from granphon.tradeoffs.measure import MeasuredPoint, TradeOff

#: size of a marker, in points
_MARKER = 4.0
#: limits of the axis of times if no point was run, s
_TIMES = 1e-3, 1e1
#: limits of the axis of relative errors if no point has an error
_ERRORS = 1e-8, 1e0


def plot_work_precision(result: TradeOff, ax: Axes) -> Axes:
    """Draw error against time of the points of a trade-off, on logarithmic axes.

    Markers are open where the reference is not a hundred times better. Bars are the spread of
    times, and the standard errors of the errors of random samples. The floor is the condition
    number times rounding; the scatter of random samples is in their errors instead. Points without
    an error, because there is no reference or no difference from it, are marks at the bottom.
    Points that were not run are counted above the axes, by method.
    """
    points = result.points
    ax.set(xscale="log", yscale="log", xlabel="Time (s)", ylabel="Relative error", title="Media")
    methods = list(dict.fromkeys(point.method for point in points))
    # the spreads of times as they are drawn, limited so that bars end above zero
    spreads = {id(point): min(point.spread, 0.9 * point.seconds) for point in points}
    slowest = max((point.seconds for point in points if point.ran), default=0.0)
    # told apart by every eye, and in grey by the marker
    looks = zip((BLUE, VERMILION, GREEN, PURPLE, ORANGE, "#000000"), "os^DvP", strict=True)
    for method, (colour, marker) in zip(methods, itertools.cycle(looks), strict=False):
        ran = [point for point in points if point.method == method and point.ran]
        drawn = [p for p in ran if p.error > 0.0]
        without_error = [p for p in ran if not p.error > 0.0]
        label = method
        if drawn:
            x = [p.seconds for p in drawn]
            y = [p.error for p in drawn]
            spread = [spreads[id(p)] for p in drawn]
            bars = [min(p.stderr, 0.9 * p.error) for p in drawn]
            style: dict[str, Any] = {
                "color": colour,
                "marker": marker,
                "ms": _MARKER,
                "lw": 0.9,
                "elinewidth": 0.6,
            }
            ax.errorbar(x, y, bars, spread, label=label, **style)[0].set_zorder(2.5)
            label = "_"
        if without_error:
            bottom: dict[str, Any] = {
                "transform": ax.get_xaxis_transform(),
                "clip_on": False,
                "gid": "without-error",
            }
            ax.plot(
                [p.seconds for p in without_error],
                [0.0] * len(without_error),
                marker,
                color=colour,
                ms=_MARKER,
                label=label,
                **bottom,
            )
        for point in drawn:
            if not point.resolved:
                ax.plot(
                    point.seconds,
                    point.error,
                    marker,
                    color=colour,
                    mfc="white",
                    ms=_MARKER,
                    mew=0.9,
                    zorder=3.0,
                )
        # of points that lie close together the first has a label, so that labels can be read
        labelled: list[MeasuredPoint] = []
        for point in drawn if len(drawn) > 1 else ():
            if any(
                abs(math.log10(point.seconds / other.seconds)) <= 0.25
                and abs(math.log10(point.error / other.error)) <= 0.6
                for other in labelled
            ):
                continue
            labelled.append(point)
            # above a curve, which falls to the right; below it near where the axes end
            side, place = (
                (-3.0, ("right", "top"))
                if point.seconds > 0.3 * slowest
                else (3.0, ("left", "bottom"))
            )
            ax.annotate(
                point.knob.replace(" x ", "×"),
                (point.seconds, point.error),
                (side, side),
                textcoords="offset points",
                ha=place[0],
                va=place[1],
                fontsize=7.0,
                color=colour,
            )
    ax.margins(0.14)
    ran = [point for point in points if point.ran]
    errors = [point.error for point in ran if point.error > 0.0]
    times = [p.seconds + side * spreads[id(p)] for p in ran for side in (-1.0, 1.0)]
    for which, values in (("x", np.array(times or _TIMES)), ("y", np.array(errors or _ERRORS))):
        scale_axis(ax, which, values, 100.0)  # plain small numbers take much room
        widen_axis(ax, which, values)
    if not ran:
        ax.set_xlim(*_TIMES)
    floor = max((p.floor for p in points if not p.failure and not p.random), default=0.0)
    if errors and floor > 1e-4 * min(p.error for p in points if p.error > 0.0):
        ax.axhline(floor, color="0.4", lw=0.8, ls=":", zorder=0)
        annotation = (1.0, floor), (-2.0, 2.0), ("axes fraction", "data"), "offset points"
        ax.annotate("rounding", *annotation, ha="right", color="0.4", fontsize=7.0)
    elif errors and floor:
        ax.annotate(
            f"rounding: {floor:.0e}, below",
            (0.02, 0.02),
            xycoords="axes fraction",
            color="0.4",
            fontsize=7.0,
        )
    elif not errors:
        ax.set_ylim(*_ERRORS)
        judged = any(not point.failure for point in ran)
        words = (
            "no error above rounding"
            if judged
            else "run, but without a reference"
            if ran
            else "nothing was run"
        )
        ax.annotate(words, (0.5, 0.5), xycoords="axes fraction", ha="center", color="0.4")
    if ran:
        below: dict[str, Any] = {
            "loc": "upper center",
            "bbox_to_anchor": (0.5, -0.17),
            "borderaxespad": 0.0,
        }
        ax.legend(ncols=2, handlelength=1.4, columnspacing=1.0, **below)
    missing = {method: sum(not p.ran for p in points if p.method == method) for method in methods}
    missing_words = ", ".join(f"{count} of {method}" for method, count in missing.items() if count)
    if missing_words:
        lines = textwrap.wrap(f"not run: {missing_words}", 54)
        if len(lines) > 1:
            lines = [f"not run: {sum(missing.values())} of {len(points)} points"]
        ax.set_title(ax.get_title(), pad=5.0 + 8.5 * len(lines))
        ax.annotate(
            "\n".join(lines),
            (0.5, 1.0),
            (0.0, 3.0),
            "axes fraction",
            "offset points",
            ha="center",
            fontsize=7.0,
        )
    return ax


def tradeoff_figure(result: TradeOff) -> Figure:
    """Draw a figure of the diagram of a trade-off, see :func:`plot_work_precision`."""
    with styled_figure(3.3, 3.5) as figure:
        plot_work_precision(result, figure.subplots())
        # the layout changes the width of the axes, and with it the ticks, whose labels the layout
        # is made for
        figure.draw_without_rendering()
    return figure
