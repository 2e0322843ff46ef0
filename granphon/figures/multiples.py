"""Small multiples: panels of one figure with shared axes, each for some of the states of a sweep.

The curves of the panels are drawn by the function that a figure gives; this module places the
panels, and writes what they share once.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Callable, Mapping, Sequence
from typing import Any, NamedTuple

from granphon.figures.scales import add_legend, find_axis, styled_figure, thin_ticks

from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D

from granphon.figures.choices import MOST_COLUMNS, Layout, describe_value, list_parameters
from granphon.figures.style import COLUMN_WIDTH, PAGE_WIDTH, STYLE
from granphon.figures.words import join_facts, wrap_fact
from granphon.runs.dataset import Dataset

#: heights, inches: of a panel in a figure of several lines of panels; of the panels if there is one
#: line, beside which the name of the axis must have room; and of all that stands above and below
#: the panels
_PANEL_HEIGHT = 1.05
_HEIGHT_ALONE = 1.75
_MARGINS = 0.55
#: height of the title of a panel that stands in a line with others, inches
_TITLE_HEIGHT = 0.12

#: greatest number of letters of a line of the title, and of one beside a row of panels
_LETTERS_OF_TITLE = 60
_LETTERS_OF_ROW = 14
#: letters in a line above a column of panels, per inch of the width of the column: so many that the
#: titles of neighbours stay apart
_LETTERS_PER_INCH = 13.0


class Panel(NamedTuple):
    """What was drawn in a panel: its curves, the entries of its legend, and the facts that its
    curves share, in words by kind.
    """

    curves: Sequence[Any]
    handles: Sequence[Line2D]
    facts: Mapping[str, str]


def draw_panels(
    dataset: Dataset,
    layout: Layout,
    draw: Callable[[Dataset, Axes], Panel],
    label: Callable[[Axes, list[Any]], None],
) -> Figure:
    """Draw a figure of the panels of a ``layout``, with shared axes and one legend.

    ``draw`` draws the states of a panel on its Axes, and returns what was drawn. ``label`` scales
    and names the axes of an Axes; it takes the Axes and the curves of all panels. With columns
    alone the panels stand in lines of three at most. The figure is one column wide, or as wide as a
    page if more than three panels stand side by side.
    """
    has_lines = layout.rows is None
    numbers_of_rows = layout.list_numbers(dataset, layout.rows)
    numbers_of_columns = layout.list_numbers(dataset, layout.columns)
    n_rows = len(numbers_of_rows)
    if has_lines:
        n_rows = math.ceil(len(numbers_of_columns) / MOST_COLUMNS)
    n_columns = math.ceil(len(numbers_of_rows) * len(numbers_of_columns) / n_rows)
    width = COLUMN_WIDTH if n_columns <= MOST_COLUMNS else PAGE_WIDTH
    height = n_rows * (_PANEL_HEIGHT + (_TITLE_HEIGHT if has_lines else 0.0))
    if n_rows == 1:
        height = _HEIGHT_ALONE
    with styled_figure(height + _MARGINS, width) as figure:
        axes = figure.subplots(n_rows, n_columns, sharex=True, sharey=True, squeeze=False)
        cells = iter(axes.flat)
        drawn_panels: list[tuple[Axes, Panel]] = []
        for row, column in itertools.product(numbers_of_rows, numbers_of_columns):
            ax = next(cells)
            drawn_panels.append((ax, draw(layout.select(dataset, row, column), ax)))
        for ax in cells:
            ax.set_axis_off()
        _label_shared(axes, drawn_panels, label)
        _name_panels(drawn_panels, dataset, layout, n_columns, width / n_columns)
        _write_shared(figure, drawn_panels, dataset, layout)
    return figure


def _label_shared(
    axes: Any, drawn_panels: Sequence[tuple[Axes, Panel]], label: Callable[[Axes, list[Any]], None]
) -> None:
    """Scale all panels of the grid ``axes`` (rows, columns) alike, and write the names of the
    shared axes once. ``drawn_panels`` are the Axes that have a panel, each with what was drawn
    there, and ``label`` is that of :func:`draw_panels`.
    """
    all_curves = [curve for _, panel in drawn_panels for curve in panel.curves]
    panels = [ax for ax, _ in drawn_panels]
    for ax in panels:
        label(ax, all_curves)
        ax.margins(x=0.08)
        thin_ticks(ax)
    x_label = panels[0].get_xlabel()
    y_label = panels[0].get_ylabel()
    for ax in panels:
        ax.set(xlabel="", ylabel="")
    # the lowest panel of each column, below which there may be empty places
    lowest = [[ax for ax in column if ax in panels][-1] for column in axes.T]
    for ax in lowest:
        ax.tick_params(labelbottom=True)
    _name_all(lowest, "x", x_label)
    _name_all(list(axes[::-1, 0]), "y", y_label)


def _name_all(panels: Sequence[Axes], which: str, label: str) -> None:
    """Write the ``label`` of the axis ``which``, "x" or "y", once for several ``panels`` that stand
    side by side, or above each other: at the middle of all of them.
    """
    middle = panels[(len(panels) - 1) // 2]
    is_between = len(panels) % 2 == 0
    axis = find_axis(middle, which)
    axis.set_label_text(label)
    # between two panels, half of the gap beyond the end of the first, in lengths of a panel
    axis.label.set(**{which: 1.06 if is_between else 0.5})
    if len(panels) > 1:
        # the label may be longer than its panel, which it must not push from the others; the empty
        # label of another panel keeps the room
        axis.label.set_in_layout(False)
        spare = panels[0] if middle is not panels[0] else panels[-1]
        find_axis(spare, which).set_label_text(" ")


def _name_panels(
    drawn_panels: Sequence[tuple[Axes, Panel]],
    dataset: Dataset,
    layout: Layout,
    n_columns: int,
    width: float,
) -> None:
    """Write the values of columns and rows beside the panels ``drawn_panels``, of which
    ``n_columns`` stand in a line, each ``width`` inches wide. The value of a column stands above
    the panel of the first row, or above each panel if panels stand in lines; the value of a row
    stands at the right of the last panel of the row.
    """
    for number, (ax, panel) in enumerate(drawn_panels):
        row, column = divmod(number, n_columns)
        if layout.columns is not None and (row == 0 or layout.rows is None):
            text = panel.facts[_find_kind(dataset, layout.columns)]
            ax.set_title(wrap_fact(text, int(_LETTERS_PER_INCH * width)), pad=3.0)
        if layout.rows is not None and column == n_columns - 1:
            ax.annotate(
                wrap_fact(panel.facts[_find_kind(dataset, layout.rows)], _LETTERS_OF_ROW),
                (1.0, 0.5),
                (4.0, 0.0),
                "axes fraction",
                "offset points",
                rotation=-90.0,
                ha="left",
                va="center",
                annotation_clip=False,
            )


def _find_kind(dataset: Dataset, name: str) -> str:
    """Return the key, in the facts of a curve, of the fact that the parameter ``name``, or
    "medium", gives.
    """
    return "medium" if name == "medium" else describe_value(dataset, name, 0)[0]


def _write_shared(
    figure: Figure, drawn_panels: Sequence[tuple[Axes, Panel]], dataset: Dataset, layout: Layout
) -> None:
    """Write below the panels ``drawn_panels`` one legend of the entries of all, each label once,
    and above the panels the facts of parameters that have one value in the figure; a direction
    without effect on the curves is not among their facts.
    """
    handles: dict[str, Line2D] = {}
    for _, panel in drawn_panels:
        for handle in panel.handles:
            handles.setdefault(str(handle.get_label()), handle)
    add_legend(figure, list(handles.values()))
    # parameters with a single value, and those of which a single value is drawn
    names = [name for name in list_parameters(dataset) if dataset[name].size == 1]
    names += [name for name, numbers in layout.shown.items() if len(numbers) == 1]
    _, panel = drawn_panels[0]
    kinds = [_find_kind(dataset, name) for name in names]
    facts = [panel.facts[kind] for kind in kinds if kind in panel.facts]
    if facts:
        figure.suptitle(join_facts(facts, _LETTERS_OF_TITLE), fontsize=STYLE["axes.titlesize"])
