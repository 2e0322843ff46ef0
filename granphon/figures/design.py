"""Figure of a design: the goal during the search, and the network at its start and at its end."""

from __future__ import annotations

from typing import Any

from granphon.figures.scales import name_axis, styled_figure

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import MaxNLocator

from granphon.base.scales import HertzPrefix
from granphon.figures.bands import plot_bands
from granphon.figures.style import BLUE, GUIDE, PAGE_WIDTH, VERMILION
from granphon.inverse.design import Design
from granphon.networks.network import ContactNetwork
from granphon.phonons.bands import Bands
from granphon.phonons.phonons import Phonons

#: most branches of a network whose bands are drawn: of more, the variables are drawn in their place
_MOST_BRANCHES = 48
#: points on each segment of the path of these bands
_POINTS = 41
#: height of the figure, inches
_HEIGHT = 2.6
#: places of the lower and of the upper bound of a variable
_ENDS = (0.0, 1.0)


def design_figure(design: Design) -> Figure:
    """Draw a figure of a design across the page. On the left is the goal at each evaluation of the
    search that led to the best network, with the certified value of a gap as a dashed line. On the
    right are the bands and gaps of the given network and of the best one. For a network that does
    not repeat, or has many branches, the variables between their bounds take the place of the
    bands.
    """
    with styled_figure(_HEIGHT, PAGE_WIDTH) as figure:
        if not _has_bands(design.network):
            left, right = figure.subplots(1, 2)
            _draw_history(design, left)
            _draw_variables(design, right)
            return figure
        left, *panels = figure.subplots(1, 3)
        _draw_history(design, left)
        # bands and gaps at the start and at the end
        pairs: list[tuple[Bands, Any]] = []
        for network in (design.start, design.network):
            phonons = Phonons(network)
            pairs.append((phonons.bands(npoints=_POINTS), phonons.gaps()))
        top = max(float(bands.frequencies.max()) for bands, _gaps in pairs)
        unit = HertzPrefix.for_top(top)
        for ax, (bands, gaps), title in zip(panels, pairs, ("Start", "Best"), strict=True):
            plot_bands(bands, ax, gaps=gaps, unit=unit, colorbar=False)
            ax.set(title=title, ylim=(-0.02 * top / unit.hertz, 1.05 * top / unit.hertz))
        panels[1].set_ylabel("")
    return figure


def _has_bands(network: ContactNetwork) -> bool:
    """Whether the bands of a network are drawn: the network must repeat, and have at most
    ``_MOST_BRANCHES`` branches.
    """
    n_branches = network.ball_motions.count * int(np.count_nonzero(network.moving))
    return any(network.pbc) and n_branches <= _MOST_BRANCHES


def _draw_history(design: Design, ax: Axes) -> None:
    """Draw the goal at each evaluation. A goal in Hz is a gap: a dashed line shows the certified
    value of the gap. A goal without a unit has a logarithmic axis if all its values are above zero.
    """
    history = design.history
    ax.plot(np.arange(1, history.size + 1), history, color=BLUE, linewidth=1.0, marker=".")
    is_gap = design.unit == "Hz"
    if is_gap:
        ax.axhline(design.value, color=GUIDE, linewidth=0.8, dashes=(4.0, 2.0), label="certified")
        ax.legend(loc="lower right")
    if design.unit == "1" and np.all(history > 0.0):
        ax.set_yscale("log")
    ax.xaxis.set_major_locator(MaxNLocator(integer=True))
    start = f"random start {design.best_start}" if design.best_start else "the given network"
    ax.set(xlabel="Evaluation", title=f"Search from {start}")
    most = float(np.max(np.abs([*history, design.value]), initial=0.0))
    label = "Gap" if is_gap else "Goal"
    name_axis(ax.yaxis, most, label, design.unit, is_short=is_gap)


def _draw_variables(design: Design, ax: Axes) -> None:
    """Draw where each variable lies between its bounds, in the given network and in the best
    one.
    """
    low, high = design.bounds.T
    numbers = np.arange(len(low))
    for values, colour, fill, label in (
        (design.start_variables, GUIDE, "none", "start"),
        (design.variables, VERMILION, "full", "best"),
    ):
        places = (values - low) / (high - low)  # 0 at the lower bound, 1 at the upper one
        ax.plot(numbers, places, "o", color=colour, fillstyle=fill, markersize=3.0, label=label)
    ax.set(xlabel="Variable", ylabel="Place between the bounds", title="Variables")
    ax.set_yticks(_ENDS, ["least", "greatest"])
    ax.margins(y=0.08)
    ax.legend(loc="center left", bbox_to_anchor=(1.0, 0.5))
