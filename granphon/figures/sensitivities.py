"""Figures of what velocities, moduli, cut-off frequencies and waves of an edge depend on: a panel
for each, in which each parameter has a bar.
"""

from __future__ import annotations

import math
import re
from collections.abc import Callable, Sequence
from textwrap import fill

from granphon.figures.scales import styled_figure

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import MaxNLocator

from granphon.base.arrays import Array
from granphon.base.errors import InputError
from granphon.base.text import counted
from granphon.figures.style import BLUE, FRAME, STYLE, VERMILION
from granphon.observables.catalogue import axis_label
from granphon.runs.dataset import Dataset
from granphon.runs.sensitivities import EDGE_WAVE, spell_quantity

#: greatest number of panels, and of columns of panels
_MOST_PANELS = 12
_MOST_COLUMNS = 2
#: heights, inches: of a bar, of a panel without its bars, and of the name of the axis that panels
#: share
_BAR = 0.13
_MARGINS = 0.5
_SHARED_MARGIN = 0.2
#: greatest number of letters of a line of the title of a panel
_LETTERS = 16
#: most intervals between ticks of a panel
_MOST_TICKS = 5
#: part of the width of a panel within which a tick has no room for its number at either end
_ROOM = 0.05
#: part of its place that a bar fills
_WIDTH = 0.7


def sensitivities_figure(dataset: Dataset, tell: Callable[[str], object] | None = None) -> Figure:
    """Draw a figure of the logarithmic derivatives of a data set, one column wide: a panel for each
    quantity, in which each parameter has a bar, blue above zero and vermilion below. Of many states
    a bar is the mean, and a line reaches from the least to the greatest.

    Of more than twelve quantities, twelve are drawn: velocities and moduli, then the lowest waves
    of an edge, then the ends of the lowest branches. The title says so, and ``tell`` is told what
    is left out. Raises :class:`~granphon.base.errors.InputError` if the data set has no
    derivatives.
    """
    if "sensitivity" not in dataset:
        mend = "Observe them: observe: [sensitivities]"
        raise InputError("the results have no derivatives by parameters", mend=mend)
    quantities = dataset["sensitivity_of"].values.tolist()
    parameters = dataset["sensitivity_to"].values.tolist()
    table = dataset["sensitivity"].transpose(..., "sensitivity_of", "sensitivity_to").values
    by_state = table.reshape(-1, len(quantities), len(parameters))
    order = sorted(range(len(quantities)), key=lambda number: _find_rank(quantities[number]))
    names = [_name_quantity(quantities[number]) for number in order]
    n_panels = min(_MOST_PANELS, len(order))
    n_columns = min(_MOST_COLUMNS, n_panels)
    n_rows = math.ceil(n_panels / n_columns)
    height = n_rows * (_MARGINS + _BAR * len(parameters)) + _SHARED_MARGIN
    with styled_figure(height) as figure:
        axes = figure.subplots(n_rows, n_columns, sharex=True, sharey=True, squeeze=False)
        panels = axes.flat[:n_panels]
        for ax, number, name in zip(panels, order, names, strict=False):
            _draw_bars(ax, by_state[:, number])
            ax.grid(visible=True, axis="x", color=FRAME, linewidth=0.4)
            ax.set_axisbelow(True)
            ax.set_title(fill(name, _LETTERS), pad=3.0)
        axes[0, 0].set_yticks(range(len(parameters)), [axis_label(name, "") for name in parameters])
        axes[0, 0].invert_yaxis()
        for ax in axes.flat[n_panels:]:
            ax.set_axis_off()
        for ax in panels[-n_columns:]:  # the lowest panel of each column
            ax.tick_params(labelbottom=True)
        _set_ticks(axes[0, 0])
        words = "Logarithmic derivative"
        if len(by_state) > 1:
            words += "\nbars: mean of the states; lines: least to greatest"
        figure.supxlabel(words, fontsize=STYLE["axes.labelsize"])
        if n_panels < len(names):
            remark = f"The first {n_panels} of {len(names)} quantities"
            figure.suptitle(remark, fontsize=STYLE["axes.titlesize"])
    if tell is not None and n_panels < len(names):
        tell(_describe_left_out(names[n_panels:]))
    return figure


def _describe_left_out(names: Sequence[str]) -> str:
    """Return in words the number of the quantities that are left out, and the first and the last of
    their ``names``, of which there is one or more.
    """
    words = names[0]
    if len(names) > 1:
        words = f"from {names[0]!r} to {names[-1]!r}"
    return f"{counted(len(names), 'quantity', 'quantities')} left out, {words}"


def _set_ticks(ax: Axes) -> None:
    """Set a few ticks at round numbers on the axis of x, which all panels share, without ticks so
    near to its ends that their numbers would reach into the next panel.
    """
    low, high = ax.get_xlim()
    ticks = np.asarray(MaxNLocator(_MOST_TICKS, steps=[1, 2, 5, 10]).tick_values(low, high))
    room = _ROOM * (high - low)
    ax.set_xticks(ticks[(ticks > low + room) & (ticks < high - room)])
    ax.xaxis.set_major_formatter("{x:g}")


def _find_rank(name: str) -> tuple[int, int]:
    """Return the rank of the quantity ``name``, by which quantities are sorted: its group and its
    number in the group. Velocities and moduli come first, then waves of an edge and then branches,
    both from the lowest on.
    """
    if " " not in name:  # a velocity or a modulus
        return 0, 0
    entry, *_, number = name.split(" ")
    return (1 if entry == EDGE_WAVE else 2), int(number)


def _draw_bars(ax: Axes, derivatives: Array) -> None:
    """Draw a bar for each parameter, from ``derivatives`` (states, parameters): the mean over the
    states. Several states have a line from the least to the greatest derivative too. Numbers that
    are nan or infinite do not count.
    """
    finite_derivatives = np.ma.masked_invalid(derivatives)
    means = finite_derivatives.mean(axis=0).filled(np.nan)
    places = np.arange(len(means))
    colours = np.where(np.nan_to_num(means) < 0.0, VERMILION, BLUE).tolist()
    ax.barh(places, means, _WIDTH, color=colours, gid="bars")
    if len(derivatives) > 1:
        smallest = finite_derivatives.min(axis=0).filled(np.nan)
        largest = finite_derivatives.max(axis=0).filled(np.nan)
        ax.hlines(places, smallest, largest, color="black", linewidth=0.8, gid="extents")
    ax.axvline(0.0, color="black", linewidth=0.6)


def _name_quantity(name: str) -> str:
    """Return the name of a quantity in words, as the title of its panel."""
    if " " not in name:
        return axis_label(name, "")
    words = spell_quantity(name)
    # a title never breaks before a number or a corner
    unbroken_words = re.sub(" (?=[^ ]+( at |$))", "\N{NO-BREAK SPACE}", words)
    return unbroken_words[:1].upper() + unbroken_words[1:]
