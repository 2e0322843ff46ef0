"""Work-precision diagrams: the error of a method against its time, a curve for each method, its knob beside each point.

As in :mod:`granphon.plot`, whose style they share, every function draws on an Axes and returns it.
"""

from __future__ import annotations

import itertools
import math
import textwrap
from collections.abc import Sequence
from typing import Any

# before matplotlib, whatever backend the environment names
from granphon.style import STYLE

# isort: split
import matplotlib
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import NullFormatter

from granphon.errors import InputError, message
from granphon.tradeoffs import Measured, TradeOff

__all__ = ["plot_work_precision", "tradeoff_figure"]

#: colour and marker of each method: told apart by every eye, and in grey by the marker
_LOOKS = (
    ("#0072B2", "o"), ("#D55E00", "s"), ("#009E73", "^"), ("#CC79A7", "D"), ("#E69F00", "v"), ("#000000", "P"),
)  # fmt: skip
_SIZE = 4.0
#: of a line above the axes
_LETTERS = 54
#: columns of a figure of several studies
_COLUMNS = 2


def plot_work_precision(result: TradeOff, study: str, ax: Axes) -> Axes:
    """Log error against log time of the points of a study; open where the reference is not a hundred times better.

    Bars are the spread of times; the floor is condition times rounding, the chance in samples being in their errors. What
    was not run is counted above the axes, by method. :class:`~granphon.errors.InputError` for a study that is not there.
    """
    points = result.of(study)
    if not points:
        raise InputError(message(f"there is no study {study!r}", mend="Use one of " + ", ".join(result.studies)))
    ax.set(xscale="log", yscale="log", xlabel="Time (s)", ylabel="Relative error", title=study[0].upper() + study[1:])
    methods = list(dict.fromkeys(point.method for point in points))
    for method, (colour, marker) in zip(methods, itertools.cycle(_LOOKS), strict=False):
        drawn = [point for point in points if point.method == method and not point.failure and point.error > 0.0]
        if not drawn:
            continue
        x, y = [p.seconds for p in drawn], [p.error for p in drawn]
        spread = [min(p.spread, 0.9 * p.seconds) for p in drawn]
        line = ax.errorbar(x, y, xerr=spread, color=colour, marker=marker, ms=_SIZE, lw=0.9, elinewidth=0.6, label=method)
        line[0].set_zorder(2.5)
        for point in drawn:
            if not point.resolved:
                ax.plot(point.seconds, point.error, marker, color=colour, mfc="white", ms=_SIZE, mew=0.9, zorder=3.0)
        for point in _labelled(drawn) if len(drawn) > 1 else ():
            ax.annotate(
                point.knob.replace(" x ", "×"), (point.seconds, point.error), (3.0, 3.0), textcoords="offset points",
                fontsize=7.0, color=colour,
            )  # fmt: skip
    ax.margins(0.14)
    _draw_floor(points, ax)
    for axis in (ax.xaxis, ax.yaxis):
        axis.set_minor_formatter(NullFormatter())
    if ax.has_data():
        below: dict[str, Any] = {"loc": "upper center", "bbox_to_anchor": (0.5, -0.17), "borderaxespad": 0.0}
        ax.legend(ncols=2, handlelength=1.4, columnspacing=1.0, **below)
    else:
        ax.annotate("nothing was run", (0.5, 0.5), xycoords="axes fraction", ha="center", color="0.4")
        ax.set(xticks=[], yticks=[])
    missing = {method: sum(bool(p.failure) for p in points if p.method == method) for method in methods}
    told = ", ".join(f"{count} of {method}" for method, count in missing.items() if count)
    if told:
        lines = textwrap.wrap(f"not run: {told}", _LETTERS)
        ax.set_title(ax.get_title(), pad=5.0 + 8.5 * len(lines))
        ax.annotate("\n".join(lines), (0.5, 1.0), (0.0, 3.0), "axes fraction", "offset points", ha="center", fontsize=7.0)
    return ax


def _draw_floor(points: Sequence[Measured], ax: Axes) -> None:
    """That of rounding: a line if it is near, else words at the bottom."""
    floors = [p.floor for p in points if not p.failure and not p.random]
    errors = [p.error for p in points if not p.failure and p.error > 0.0]
    if not floors or not errors:
        return
    floor = max(floors)
    if floor > 1e-4 * min(errors):
        ax.axhline(floor, color="0.4", lw=0.8, ls=":", zorder=0)
        place = (1.0, floor), (-2.0, 2.0), ("axes fraction", "data"), "offset points"
        ax.annotate("rounding", *place, ha="right", color="0.4", fontsize=7.0)
    else:
        ax.annotate(f"rounding: {floor:.0e}, below", (0.02, 0.02), xycoords="axes fraction", color="0.4", fontsize=7.0)


def _labelled(points: list[Measured]) -> list[Measured]:
    """Those whose knobs can be read: of points that lie on each other the first."""
    kept: list[Measured] = []
    for point in points:
        if all(
            abs(math.log10(point.seconds / other.seconds)) > 0.25 or abs(math.log10(point.error / other.error)) > 0.6
            for other in kept
        ):
            kept.append(point)
    return kept


def tradeoff_figure(result: TradeOff) -> Figure:
    """The diagrams of all studies, see :func:`plot_work_precision`: one column wide for one, two for several."""
    studies = result.studies
    columns = min(_COLUMNS, len(studies))
    rows = -(-len(studies) // columns)
    with matplotlib.rc_context(STYLE):
        figure = Figure(figsize=(3.5 * columns, 3.3 * rows), dpi=300, layout="constrained")
        axes = figure.subplots(rows, columns, squeeze=False).ravel()
        for ax, study in zip(axes, studies, strict=False):
            plot_work_precision(result, study, ax)
        for ax in axes[len(studies) :]:
            ax.set_axis_off()
    return figure
