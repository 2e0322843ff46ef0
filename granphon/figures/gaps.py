"""Figures of frequencies of the states of a sweep over the load or a parameter: gaps, branches from
cut-off to cut-off, waves of an edge, and lowest modes.

As in :mod:`granphon.figures.multiples`, each combination of medium and parameters has a panel.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from textwrap import fill
from typing import Any

from granphon.figures.scales import add_legend, name_axis, scale_axis, styled_figure, thin_ticks

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patches import Patch

from granphon.base.arrays import Array
from granphon.base.errors import InputError
from granphon.base.scales import HertzPrefix
from granphon.figures.choices import MOST_COLUMNS, turn_over
from granphon.figures.curves import choose_x, describe_lines, read_values
from granphon.figures.style import BLUE, ORANGE, STYLE, pick_evenly, print_hertz
from granphon.figures.words import find_differing, join_facts
from granphon.observables.catalogue import axis_label
from granphon.runs.dataset import Dataset

#: greatest number of panels, and the height of a line of panels, and of the rest, inches
_MOST_PANELS = 12
_HEIGHT = 1.25
_HEIGHT_ALONE = 2.0
_MARGINS = 0.55
#: letters of a line of the title of a panel, by the number of columns
_LETTERS = {1: 60, 2: 26, 3: 16}
#: look of the top frequency
_TOP: dict[str, Any] = {"color": "black", "linewidth": 1.0}
_FIELD: dict[str, Any] = {"facecolor": BLUE, "alpha": 0.3, "linewidth": 0.0}
_DOTS: dict[str, Any] = {"color": ORANGE, "marker": "o", "markersize": 2.0, "linewidth": 0.8}

#: what draws a panel: from the states of a curve, the numbers on the axis of x (n,) and the unit
_DrawPanel = Callable[[Dataset, Axes, Array, HertzPrefix], None]


def sweep_gaps_figure(dataset: Dataset, x: str | None = None) -> Figure:
    """Draw a figure of the gaps of a sweep, one column wide: between its lower and its upper edge
    each gap is a field over ``x``, which is that of :func:`granphon.figures.curves.plot_sweep`, and
    the top frequency is a line.

    Gaps are told apart by the number of branches below. Each medium and combination of parameters
    has a panel; of more than twelve, twelve are drawn. Raises
    :class:`~granphon.base.errors.InputError` if the sweep has no gaps.
    """
    _require(dataset, "gap_lower", "gaps", "gaps")

    def draw(states: Dataset, ax: Axes, x_values: Array, unit: HertzPrefix) -> None:
        """Draw the gaps, and the top frequency, of the states of a panel."""
        _draw_fields(states, ("gap_lower", "gap_upper"), "gap", ax, x_values, unit)
        ax.plot(x_values, states["top_frequency"].values / unit.hertz, gid="top", **_TOP)

    handles: list[Any] = [Line2D([], [], label="top frequency", **_TOP)]
    if np.any(np.isfinite(dataset["gap_lower"].values)):
        handles.insert(0, Patch(label="gap", **_FIELD))
    return _draw_panels(dataset, x, "top_frequency", draw, handles)


def cutoffs_figure(dataset: Dataset, x: str | None = None) -> Figure:
    """Draw a figure of the branches of a sweep, one column wide: each is a field over ``x`` from
    its lowest to its highest frequency in the zone, as in :func:`sweep_gaps_figure`.

    Raises :class:`~granphon.base.errors.InputError` if the sweep has no cut-off frequencies.
    """
    _require(dataset, "cutoff_lower", "cut-off frequencies", "cutoffs")

    def draw(states: Dataset, ax: Axes, x_values: Array, unit: HertzPrefix) -> None:
        """Draw the branches of the states of a panel."""
        _draw_fields(states, ("cutoff_lower", "cutoff_upper"), "branch", ax, x_values, unit)

    handles = [Patch(label="branch, from its lowest to its highest frequency", **_FIELD)]
    return _draw_panels(dataset, x, "cutoff_upper", draw, handles)


def _draw_fields(
    states: Dataset,
    names: tuple[str, str],
    dimension: str,
    ax: Axes,
    x: Array,
    unit: HertzPrefix,
) -> None:
    """Draw, for each number of a ``dimension``, the field over ``x`` (n,) between the variables
    ``names`` of the ``states``, where they are known.
    """
    edges = [states[name].transpose("load", dimension).values / unit.hertz for name in names]
    for number, (lower, upper) in enumerate(zip(edges[0].T, edges[1].T, strict=True)):
        if np.any(np.isfinite(lower)):
            _draw_field(ax, x, lower, upper, f"{dimension}-{number}")


def _draw_field(ax: Axes, x: Array, lower: Array, upper: Array, gid: str) -> None:
    """Draw a field over ``x`` (n,) between its edges (n,); at a single point, or at one whose
    neighbours have no such field, a bar.
    """
    ax.fill_between(x, lower, upper, gid=gid, **_FIELD)
    is_known = np.isfinite(lower)
    has_neighbour = np.zeros(is_known.size, bool)
    has_neighbour[1:] |= is_known[:-1]
    has_neighbour[:-1] |= is_known[1:]
    alone = is_known & ~has_neighbour
    if np.any(alone):
        ax.vlines(x[alone], lower[alone], upper[alone], color=BLUE, alpha=0.3, linewidth=6.0)
    for edge in (lower, upper):
        ax.plot(x, edge, color=BLUE, linewidth=0.8, gid=f"{gid}-edge")


def sweep_surface_figure(dataset: Dataset, x: str | None = None) -> Figure:
    """Draw a figure of the undamped waves of an edge in a sweep, one column wide: their frequencies
    at the end of the path, from the lowest up, over ``x``, as in :func:`sweep_gaps_figure`.

    A panel without a wave says so. Raises :class:`~granphon.base.errors.InputError` if the sweep
    has no waves of an edge.
    """
    _require(dataset, "surface_frequency", "waves of an edge", "surface")
    words = "waves of the edge, at the end of the path"
    return _draw_lines(dataset, x, "surface_frequency", "surface_wave", words)


def modes_figure(dataset: Dataset, x: str | None = None) -> Figure:
    """Draw a figure of the lowest modes of the networks of a sweep, one column wide: their
    frequencies over ``x``, as in :func:`sweep_gaps_figure`.

    Raises :class:`~granphon.base.errors.InputError` if the sweep has no modes.
    """
    _require(dataset, "mode_frequency", "modes", "modes")
    return _draw_lines(dataset, x, "mode_frequency", "mode", "lowest modes")


def _draw_lines(dataset: Dataset, x: str | None, name: str, dimension: str, words: str) -> Figure:
    """Draw, for each number of a ``dimension``, the frequencies ``name`` over ``x``; ``words`` are
    those of the legend.
    """

    def draw(states: Dataset, ax: Axes, x_values: Array, unit: HertzPrefix) -> None:
        """Draw the lines of the states of a panel."""
        frequencies = states[name]
        if "surface_point" in frequencies.dims:
            frequencies = frequencies.isel(surface_point=-1)
        if not np.any(np.isfinite(frequencies)):
            ax.annotate("no wave", (0.5, 0.5), xycoords="axes fraction", ha="center", color="0.4")
        for number, line in enumerate(frequencies.transpose(dimension, "load").values):
            ax.plot(x_values, line / unit.hertz, gid=f"wave-{number}", **_DOTS)

    return _draw_panels(dataset, x, name, draw, [Line2D([], [], label=words, **_DOTS)])


def _require(dataset: Dataset, name: str, words: str, subject: str) -> None:
    """Raise InputError if a data set has no variable ``name``."""
    if name not in dataset:
        mend = f"Observe {subject} over several states"
        raise InputError(f"the sweep has no {words}", mend=mend)


def _draw_panels(
    dataset: Dataset, x: str | None, variable: str, draw: _DrawPanel, handles: list[Any]
) -> Figure:
    """Draw a panel for each medium and combination of parameters, with shared axes, of which that
    of y reaches to the greatest value of the ``variable``.
    """
    x_name = choose_x(dataset, x)
    turned = turn_over(dataset, x_name)
    values = turned[variable].values
    # without a value any height will do
    greatest = float(np.max(values[np.isfinite(values)], initial=0.0)) or 1.0
    unit = HertzPrefix.for_top(greatest)
    lines = describe_lines(turned, variable)
    chosen = [lines[number] for number in pick_evenly(len(lines), _MOST_PANELS)]
    differing, _ = find_differing([facts for facts, _ in chosen])
    n_rows = math.ceil(len(chosen) / MOST_COLUMNS)
    n_columns = math.ceil(len(chosen) / n_rows)
    height = n_rows * _HEIGHT if n_rows > 1 else _HEIGHT_ALONE
    all_x = np.asarray(read_values(turned, x_name), float)
    with styled_figure(height + _MARGINS) as figure:
        axes = figure.subplots(n_rows, n_columns, sharex=True, sharey=True, squeeze=False)
        for ax, (facts, index) in zip(axes.flat, chosen, strict=False):
            states = turned.isel(index, missing_dims="ignore")
            x_values = np.asarray(states[x_name].values, float)
            order = np.argsort(x_values, kind="stable")
            draw(states.isel(load=order), ax, x_values[order], unit)
            letters = _LETTERS[n_columns]
            title = join_facts([facts[kind] for kind in differing], letters)
            # a value may be parted from the kind of balls that has it
            parts = title.replace("\N{NO-BREAK SPACE}of", " of").splitlines()
            lines_of_title = [fill(part, letters, break_long_words=False) for part in parts]
            ax.set_title("\n".join(lines_of_title), pad=3.0)
            scale_axis(ax, "x", all_x)
            name_axis(
                ax.xaxis,
                float(np.max(np.abs(all_x))),
                axis_label(x_name, ""),
                str(turned[x_name].attrs.get("units", "")),
            )
            thin_ticks(ax)
            ax.set_ylim(0.0, 1.06 * greatest / unit.hertz)
        for ax in axes.flat[len(chosen) :]:
            ax.set_axis_off()
        for ax in axes[:-1].flat:
            ax.set_xlabel("")
        # the panels above empty places have the numbers of the axis
        for ax in axes.flat[max(0, len(chosen) - n_columns) : len(chosen)]:
            ax.tick_params(labelbottom=True)
        for ax in axes[:, 0]:
            ax.set_ylabel(f"Frequency ({print_hertz(unit)})")
        add_legend(figure, handles, 1)
        if len(chosen) < len(lines):
            remark = f"{len(chosen)} of {len(lines)} combinations"
            figure.suptitle(remark, fontsize=STYLE["axes.titlesize"])
    return figure
