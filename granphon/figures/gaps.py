"""Figures of frequencies of the states of a sweep over the load or a parameter: gaps, branches from
cut-off to cut-off, waves of an edge, and lowest modes.

Each combination of medium and parameters has a panel, see :mod:`granphon.figures.multiples`.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any

from granphon.figures.scales import draw_error_band, make_error_handle, name_axis, scale_axis

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patches import Patch
from matplotlib.ticker import MaxNLocator, NullLocator

from granphon.base.arrays import Array, Flags
from granphon.base.errors import InputError
from granphon.base.scales import HertzPrefix
from granphon.figures.choices import arrange, turn_over
from granphon.figures.curves import choose_x, describe_lines, read_values
from granphon.figures.multiples import Panel, draw_panels
from granphon.figures.style import BLUE, ORANGE, write_hertz
from granphon.observables.catalogue import axis_label
from granphon.runs.dataset import Dataset

#: look of the top frequency, whose markers stand where no line would be seen
_TOP: dict[str, Any] = {"color": "black", "linewidth": 1.0, "marker": "o", "markersize": 2.0}
_FIELD: dict[str, Any] = {"facecolor": BLUE, "alpha": 0.3, "linewidth": 0.0}
#: width of the field of a single state, points
_BAR = 6.0
_EDGE: dict[str, Any] = {
    "color": BLUE, "linewidth": 0.8, "marker": "_", "markersize": _BAR, "markeredgewidth": 0.4,
}  # fmt: skip
#: look of lines of frequencies; a point at 0 Hz stands whole on the axis
_DOTS: dict[str, Any] = {
    "color": ORANGE, "marker": "o", "markersize": 2.0, "linewidth": 0.8, "clip_on": False,
}  # fmt: skip

#: what draws a panel: from the states of a curve, the numbers on the axis of x (n,), None for a
#: single state, and the unit
_DrawPanel = Callable[[Dataset, Axes, Array | None, HertzPrefix], None]
#: for each dimension of frequencies the label of the axis of x of a single state, along which its
#: indices are counted, and the number of the first index, as in tables
_INDEX_AXES = {
    "gap": ("Branches below the gap", 0),
    "branch": ("Branch", 0),
    "mode": ("Mode", 1),
    "surface_wave": ("Wave of the edge", 0),
}


def sweep_gaps_figure(dataset: Dataset, **options: Any) -> Figure:
    """Draw a figure of the gaps of a sweep: between its lower and its upper edge each gap is a
    field over ``x``, and the top frequency is a line. Of a single state, over which no ``x``
    varies, each gap is a bar over the number of branches below.

    Gaps are told apart by the number of branches below. Each medium and combination of parameters
    has a panel. The ``options`` are ``x``, ``rows``, ``columns`` and ``tell``, which mean the same
    as in :func:`granphon.figures.curves.sweep_figure`. Where rows and columns of panels have no
    place for all combinations, some are drawn, of which ``tell`` is told. Raises
    :class:`~granphon.base.errors.InputError` if the sweep has no gaps, and for an ``x``, ``rows``
    or ``columns`` that ``sweep_figure`` refuses.
    """
    _require_variable(dataset, "gap_lower", "gaps", "gaps")

    def draw(states: Dataset, ax: Axes, x_values: Array | None, unit: HertzPrefix) -> None:
        """Draw the gaps, and the top frequency, of the states of a panel."""
        _draw_fields(states, ("gap_lower", "gap_upper"), "gap", ax, x_values, unit)
        top = states["top_frequency"].values / unit.hertz
        errors = _read_errors(states, "top_frequency") / unit.hertz
        if x_values is None:  # one line across the panel
            x_values = _find_span(states, "gap")
            top = np.repeat(top, 2)
            errors = np.repeat(errors, 2)
        draw_error_band(ax, x_values, top, errors, _TOP["color"], "top-errors")
        lonely_points = np.flatnonzero(_are_lonely(np.isfinite(top))).tolist()
        ax.plot(x_values, top, gid="top", markevery=lonely_points, **_TOP)

    look_in_legend = {**_TOP, "marker": ""}
    handles: list[Any] = [Line2D([], [], label="top frequency", **look_in_legend)]
    if np.any(np.isfinite(dataset["gap_lower"].values)):
        handles.insert(0, Patch(label="gap", **_FIELD))
    return _draw_panels(dataset, "top_frequency", "gap", draw, handles, **options)


def cutoffs_figure(dataset: Dataset, **options: Any) -> Figure:
    """Draw a figure of the branches of a sweep: each is a field over ``x`` from its lowest to its
    highest frequency in the zone; of a single state a bar over the number of the branch.

    The ``options`` are ``x``, ``rows``, ``columns`` and ``tell`` of :func:`sweep_gaps_figure`.
    Raises :class:`~granphon.base.errors.InputError` if the sweep has no cut-off frequencies, and
    for options that ``sweep_gaps_figure`` refuses.
    """
    _require_variable(dataset, "cutoff_lower", "cut-off frequencies", "cutoffs")

    def draw(states: Dataset, ax: Axes, x_values: Array | None, unit: HertzPrefix) -> None:
        """Draw the branches of the states of a panel."""
        _draw_fields(states, ("cutoff_lower", "cutoff_upper"), "branch", ax, x_values, unit)

    handles = [Patch(label="branch, from its lowest to its highest frequency", **_FIELD)]
    return _draw_panels(dataset, "cutoff_upper", "branch", draw, handles, **options)


def _draw_fields(
    states: Dataset,
    names: tuple[str, str],
    dimension: str,
    ax: Axes,
    x: Array | None,
    unit: HertzPrefix,
) -> None:
    """Draw for each index along a ``dimension`` of the ``states``, such as a gap or a branch, the
    field over ``x`` (n,) between its lower and its upper edge, which are the two variables
    ``names``, Hz; frequencies are drawn in this ``unit``. Where ``x`` is None, a single state has a
    bar at each index. Edges that are nan are not drawn.
    """
    edges = [states[name].transpose(dimension, "load").values / unit.hertz for name in names]
    errors = [_read_errors(states, name, dimension, "load") / unit.hertz for name in names]
    for number in range(states.sizes[dimension]):
        gid = f"{dimension}-{number}"
        places = _find_place(dimension, number) if x is None else x
        if np.any(np.isfinite(edges[0][number])):
            _draw_field(ax, places, edges[0][number], edges[1][number], gid)
            for edge, error in zip(edges, errors, strict=True):
                draw_error_band(ax, places, edge[number], error[number], BLUE, f"{gid}-errors")


def _find_place(dimension: str, number: int) -> Array:
    """Return the place (1,) on the axis of x at which the frequency of index ``number`` along a
    ``dimension`` stands at a single state: its number in tables.
    """
    _words, first = _INDEX_AXES[dimension]
    return np.array([float(first + number)])


def _find_span(states: Dataset, dimension: str) -> Array:
    """Return (2,) the ends of the axis of x, along which the indices of a ``dimension`` of a single
    state are counted.
    """
    _words, first = _INDEX_AXES[dimension]
    return np.array([first - 0.5, first + states.sizes[dimension] - 0.5])


def _read_errors(states: Dataset, name: str, *dims: str) -> Array:
    """Return the standard errors of the variable ``name``, in its unit; nan if the data set has
    none. ``dims`` is the order of the dimensions; without it they stay as they are.
    """
    errors = states.get(f"{name}_error", states[name] * np.nan)
    return np.asarray(errors.transpose(*dims) if dims else errors, float)


def _are_lonely(is_known: Flags) -> Flags:
    """Return (n,) whether each of n points of a curve is lonely: the point is known, and its
    neighbours are not, so that no line leads to the point. ``is_known`` (n,) says which are known.
    """
    has_neighbour = np.zeros(is_known.size, bool)
    has_neighbour[1:] |= is_known[:-1]
    has_neighbour[:-1] |= is_known[1:]
    return np.asarray(is_known & ~has_neighbour)


def _draw_field(ax: Axes, x: Array, lower: Array, upper: Array, gid: str) -> None:
    """Draw a field over ``x`` (n,) between its edges ``lower`` and ``upper`` (n,), nan where there
    is no field.

    A point whose neighbours have no field would have no area: there a bar is drawn, with marks at
    its ends, so that a short bar is seen. ``gid`` names the field in an SVG file, and begins the
    names of its edges.
    """
    ax.fill_between(x, lower, upper, gid=gid, **_FIELD)
    lonely_points = np.flatnonzero(_are_lonely(np.isfinite(lower))).tolist()
    if lonely_points:
        ends = lower[lonely_points], upper[lonely_points]
        ax.vlines(x[lonely_points], *ends, color=BLUE, alpha=0.3, linewidth=_BAR)
    for edge in (lower, upper):
        ax.plot(x, edge, markevery=lonely_points, gid=f"{gid}-edge", **_EDGE)


def sweep_surface_figure(dataset: Dataset, **options: Any) -> Figure:
    """Draw a figure of the undamped waves of an edge in a sweep: their frequencies at the end of
    the path over ``x``, or of a single state over the number of the wave, from the lowest up.

    The ``options`` are ``x``, ``rows``, ``columns`` and ``tell`` of :func:`sweep_gaps_figure`. A
    panel without a wave says so. Raises :class:`~granphon.base.errors.InputError` if the sweep has
    no waves of an edge, and for options that ``sweep_gaps_figure`` refuses.
    """
    _require_variable(dataset, "surface_frequency", "waves of an edge", "surface")
    words = "waves of the edge, at the end of the path"
    return _draw_lines(dataset, "surface_frequency", "surface_wave", words, **options)


def onsets_figure(dataset: Dataset, **options: Any) -> Figure:
    """Draw a figure of the cut-off frequencies of a sweep: those of each branch at Gamma over
    ``x``, or of a single state over the number of the branch.

    The ``options`` are ``x``, ``rows``, ``columns`` and ``tell`` of :func:`sweep_gaps_figure`.
    Raises :class:`~granphon.base.errors.InputError` if the sweep has no onsets, and for options
    that ``sweep_gaps_figure`` refuses.
    """
    _require_variable(dataset, "onset_frequency", "frequencies at Gamma", "onsets")
    return _draw_lines(dataset, "onset_frequency", "branch", "branches at Gamma", **options)


def modes_figure(dataset: Dataset, **options: Any) -> Figure:
    """Draw a figure of the lowest modes of the networks of a sweep: their frequencies over ``x``,
    or of a single state over the number of the mode.

    The ``options`` are ``x``, ``rows``, ``columns`` and ``tell`` of :func:`sweep_gaps_figure`.
    Raises :class:`~granphon.base.errors.InputError` if the sweep has no modes, and for options that
    ``sweep_gaps_figure`` refuses.
    """
    _require_variable(dataset, "mode_frequency", "modes", "modes")
    return _draw_lines(dataset, "mode_frequency", "mode", "lowest modes", **options)


def _draw_lines(dataset: Dataset, name: str, dimension: str, words: str, **options: Any) -> Figure:
    """Return a figure with a line for each index along a ``dimension``: the frequencies of the
    variable ``name`` over ``x``, or of a single state over the index; ``words`` are the entry of
    the legend, and ``options`` those of :func:`sweep_gaps_figure`.
    """

    def draw(states: Dataset, ax: Axes, x_values: Array | None, unit: HertzPrefix) -> None:
        """Draw the lines of the states of a panel."""
        if "surface_point" in states[name].dims:
            states = states.isel(surface_point=-1)
        lines = states[name].transpose(dimension, "load").values / unit.hertz
        errors = _read_errors(states, name, dimension, "load") / unit.hertz
        if not np.any(np.isfinite(lines)):
            ax.annotate("no wave", (0.5, 0.5), xycoords="axes fraction", ha="center", color="0.4")
        for number, line in enumerate(lines):
            gid = f"wave-{number}"
            places = _find_place(dimension, number) if x_values is None else x_values
            draw_error_band(ax, places, line, errors[number], ORANGE, f"{gid}-errors")
            ax.plot(places, line, gid=gid, **_DOTS)

    handle = Line2D([], [], label=words, **_DOTS)
    return _draw_panels(dataset, name, dimension, draw, [handle], **options)


def _require_variable(dataset: Dataset, name: str, words: str, subject: str) -> None:
    """Raise InputError if a data set has no variable ``name``. In the message, ``words`` say what
    is missing, and ``subject`` is the word by which a scene observes it.
    """
    if name not in dataset:
        mend = f"Observe {subject} over several states"
        raise InputError(f"the sweep has no {words}", mend=mend)


def _draw_panels(
    dataset: Dataset,
    variable: str,
    dimension: str,
    draw: _DrawPanel,
    handles: Sequence[Any],
    x: str | None = None,
    rows: str | None = None,
    columns: str | None = None,
    tell: Callable[[str], object] | None = None,
) -> Figure:
    """Return a figure with a panel for each medium and combination of parameters of a sweep, which
    ``draw`` draws, and with a legend of the ``handles``.

    The panels share their axes. The axis of y reaches to the greatest value of the ``variable``,
    Hz. The axis of x has ``x``; over a single value, at which each panel has one state, the axis
    counts the indices along the ``dimension`` instead. The other arguments are those of
    :func:`sweep_gaps_figure`.
    """
    x_name = choose_x(dataset, x)
    layout = arrange(dataset, variable, x_name, rows, columns, wants_single_curves=True)
    if layout.shown and tell is not None:
        tell(f"too many combinations for a panel of each: {layout.describe(dataset)}")
    values = dataset[variable].values
    # without a value any height will do
    greatest = float(np.max(values[np.isfinite(values)], initial=0.0)) or 1.0
    unit = HertzPrefix.for_top(greatest)
    if f"{variable}_error" in dataset:
        handles = [*handles, make_error_handle(values, dataset[f"{variable}_error"].values)]
    over_x = turn_over(dataset, x_name)
    all_x = np.asarray(read_values(over_x, x_name), float)
    x_unit = str(dataset[x_name].attrs.get("units", ""))
    # several states of a panel may have the same x, and stand above each other
    is_single_state = over_x.sizes["load"] == 1 and np.unique(all_x).size == 1

    def draw_panel(states: Dataset, ax: Axes) -> Panel:
        """Draw the states of one combination."""
        states_over_x = turn_over(states, x_name)
        ((facts, index),) = describe_lines(states_over_x, variable)  # a panel has one line
        states_of_line = states_over_x.isel(index, missing_dims="ignore")
        x_values = np.asarray(states_of_line[x_name].values, float)
        order = np.argsort(x_values, kind="stable")
        x_of_line = None if is_single_state else x_values[order]
        draw(states_of_line.isel(load=order), ax, x_of_line, unit)
        return Panel((), handles, facts)

    def label(ax: Axes, _curves: Sequence[Any]) -> None:
        """Scale and name the axes of a panel."""
        if is_single_state:
            ax.set(xlim=_find_span(dataset, dimension), xlabel=_INDEX_AXES[dimension][0])
            ax.xaxis.set_major_locator(MaxNLocator(integer=True))
            ax.xaxis.set_minor_locator(NullLocator())
        else:
            scale_axis(ax, "x", all_x)
            name_axis(ax.xaxis, float(np.max(np.abs(all_x))), axis_label(x_name, ""), x_unit)
        ax.set(ylim=(0.0, 1.06 * greatest / unit.hertz), ylabel=f"Frequency ({write_hertz(unit)})")

    return draw_panels(dataset, layout, draw_panel, label)
