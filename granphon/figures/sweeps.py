"""Figures of sweeps: quantities over the load, a line for each medium and combination of parameters.

As in :mod:`granphon.figures.bands`, every function draws on an Axes and returns it, and matplotlib's global state is left
alone. Each medium has a colour, and each combination of parameters a shade of it; a line is dashed where its medium is not
valid.
"""

from __future__ import annotations

import itertools
from typing import TYPE_CHECKING, Any

from granphon.figures.scales import add_legend, scale_axis

import matplotlib
import numpy as np
from matplotlib.axes import Axes
from matplotlib.colors import to_rgb
from matplotlib.figure import Figure
from matplotlib.lines import Line2D

from granphon.figures.curves import (
    POINTS,
    Look,
    draw_curve,
    drop_directions,
    find_load,
    is_simulated,
    label_axes,
    list_combinations,
    make_outside,
    make_serving,
    pick_evenly,
    read_curve,
    read_values,
    write_labels,
)  # fmt: skip
from granphon.figures.style import COLOURS, COLUMN_WIDTH, DPI, GUIDE, STYLE
from granphon.figures.words import join_facts
from granphon.observables.catalogue import CATALOGUE

if TYPE_CHECKING:
    from granphon.runs.dataset import Dataset


#: letters of a line of the legend, rows of it for which a figure has room, and the most combinations that it names
_LETTERS, _LEGEND_ROWS, _MOST_NAMED = 50, 4, 8
#: names that stand nearer than this one above the other, over the height of the axes, are written in one
_APART = 0.06
#: the velocity of pulses through simulated arrays
_PULSE = "pulse_velocity"
#: the velocities that a sweep may have, with their symbols
_VELOCITIES = {
    "transverse": "$v_T$", "transverse_slow": "$v_{T1}$", "transverse_fast": "$v_{T2}$", "longitudinal": "$v_L$",
    _PULSE: "velocity of pulses",
}  # fmt: skip
#: of the two transverse waves in space the fast one has an ordinary line, the slow one is dash-dotted; points differ too
_SLOW = "transverse_slow"
_SLOW_DASHES = (6.0, 1.5, 1.0, 1.5)
_MARKERS = {_SLOW: "v", "transverse_fast": "^", _PULSE: "s"}


def plot_sweep(
    dataset: Dataset, ax: Axes, variable: str = "longitudinal", x: str | None = None, *, legend: bool = True
) -> Axes:
    """Draw a variable of a sweep, one line for each medium and combination of parameters, in order of ``x``.

    Parameters
    ----------
    dataset : a data set made by :func:`granphon.sweep`.
    variable, x : names of variables or coordinates over load; ``x`` is by default the load that was given, a force, a
        pressure or an overlap.
    legend : whether to draw a legend; it names no more than eight combinations, and says of how many.

    Axes are logarithmic where all values are above zero. Lines are solid where the medium is valid, thin and dashed
    elsewhere, and each is thinner than the one before, so that all remain visible where they coincide. A simulation has no
    line but points, open where it is not valid; of several samples they are means, with bars of their standard errors.
    On an ordered path a line joins the points in its order, and triangles mark those that are reached by a fall of ``x``.
    Marks on the line of an automatic medium say which medium served where. The slow transverse wave in space has a
    dash-dotted line.

    Raises
    ------
    InputError : there is no such variable, it is not one number at each load, or it is nowhere finite.
    """
    x = x or find_load(dataset)
    lines, curves = _colour_lines(dataset), []
    dashes, marker = _SLOW_DASHES if variable == _SLOW else None, _MARKERS.get(variable, "o")
    for (colour, index), width in zip(lines, np.linspace(2.2, 1.0, len(lines) + 1)[1:], strict=True):
        if not index.get("direction") or "direction" in read_values(dataset, variable).dims:
            curves.append(read_curve(dataset, variable, x, index))
            draw_curve(ax, curves[-1], Look(colour, width, dashes, marker), variable)
        # else it is the same in all directions, and the line of the first one shows it
    label_axes(ax, curves, x, variable)
    if legend:
        ax.legend(handles=_make_legend(dataset))
    return ax


def _colour_lines(dataset: Dataset) -> list[tuple[Any, dict[str, int]]]:
    """Return the colour of each line, and its index in each dimension besides the load."""
    places = [place for _, place in list_combinations(dataset)]
    colours = [COLOURS[m % len(COLOURS)] for m in range(dataset.sizes["medium"])]
    return [
        (shade, place | {"medium": m})
        for m, colour in enumerate(colours)
        for shade, place in zip(_make_shades(colour, len(places)), places, strict=True)
    ]


def _make_shades(name: str, count: int) -> list[Any]:
    """Return ``count`` shades of a colour, from darker to lighter than itself; a single shade is the colour itself."""
    colour = np.array(to_rgb(name))
    change = np.linspace(-0.5, 0.6, count) if count > 1 else np.zeros(1)
    return [tuple(colour * (1.0 + min(t, 0.0)) + max(t, 0.0) * (1.0 - colour)) for t in change.tolist()]


def _make_legend(dataset: Dataset) -> list[Line2D]:
    """Return the entries of the legend: media, combinations of parameters, and the dashes of lines outside their range.

    Combinations are grey if there are several media. At most eight are named, and the last entry then says of how many.
    """
    media = list(zip(itertools.cycle(COLOURS), write_labels(dataset, "medium"), strict=False))
    words = [word for word, _ in list_combinations(dataset)]
    values: list[tuple[Any, str]] = []
    if len(words) > 1:
        shades = _make_shades(COLOURS[0] if len(media) == 1 else "0.5", len(words))
        values = [(shades[i], words[i]) for i in pick_evenly(len(words), _MOST_NAMED)]
    simulated = [is_simulated(dataset, {"medium": m}) for m in range(len(media))]
    point: dict[str, Any] = {"marker": "o"} | POINTS
    entries = [] if values and len(media) == 1 else list(zip(media, simulated, strict=True))
    entries += [(value, all(simulated)) for value in values]
    lines = [Line2D([], [], color=colour, label=label, **(point if points else {})) for (colour, label), points in entries]
    if len(values) < len(words) > 1:
        lines.append(Line2D([], [], linestyle="none", label=f"{len(values)} of {len(words)} are named"))
    if not np.all(dataset["valid"]):
        lines.append(make_outside(all(simulated)))
    chosen = [read_curve(dataset, "valid", find_load(dataset), index) for _, index in _colour_lines(dataset)]
    lines += make_serving(chosen)
    return lines


def plot_exponent(dataset: Dataset, ax: Axes, x: str | None = None) -> Axes:
    """Draw the local exponent d log v_L / d log P of a sweep, with that of the ideal lattice, 1/6, and the popular 1/4.

    The exponent of v_T is the same, except in a simulation. The points of a simulation of several samples have bars of
    their standard errors. ``x`` is that of :func:`plot_sweep`. See :func:`granphon.local_exponent`.
    """
    plot_sweep(drop_directions(dataset, "exponent"), ax, "exponent", x, legend=False)
    ax.set_yscale("linear")
    for value, name in ((1.0 / 6.0, "1/6"), (0.25, "1/4")):
        ax.axhline(value, color=GUIDE, linewidth=0.6, zorder=0.5)
        _write_beside(ax, name, value, color="0.4")
    ax.margins(y=0.16)
    return ax


def _write_beside(ax: Axes, text: str, value: float, **options: Any) -> None:
    """Write a text to the right of the panel, at a value of the y axis."""
    place: dict[str, Any] = {"xycoords": ax.get_yaxis_transform(), "xytext": (3, 0), "textcoords": "offset points"}
    ax.annotate(text, (1.0, value), va="center", annotation_clip=False, **place, **options)


def sweep_figure(dataset: Dataset, x: str | None = None, *, variable: str | None = None) -> Figure:
    """Draw a figure with velocities of a sweep above, their local exponent below, on one axis of ``x``; one column wide.

    ``x`` is by default the load that was given, a force, a pressure or an overlap.

    Velocities that are zero, of waves across a chain, are left out. A sweep without others, as of a mechanism, has the
    normal stiffness in their place. For a sweep without exponents (finite overlap), or for one ``variable``, there is the
    upper panel only. Raises what :func:`plot_sweep` raises.
    """
    both = variable is None and "exponent" in dataset
    velocities = {one: name for one, name in _VELOCITIES.items() if one in dataset and np.any(dataset[one] != 0.0)}
    if variable is not None or not velocities:
        dataset = drop_directions(dataset, variable or "normal_stiffness")
    with matplotlib.rc_context(STYLE):
        figure = Figure(figsize=(COLUMN_WIDTH, 4.0 if both else 2.6), dpi=DPI, layout="constrained")
        ratios = [1.6, 1.0][: 1 + both]
        axes = figure.subplots(1 + both, sharex=True, squeeze=False, height_ratios=ratios)[:, 0]
        if variable is not None or not velocities:
            plot_sweep(dataset, axes[0], variable or "normal_stiffness", x, legend=False)
        else:
            _plot_velocities(dataset, axes[0], x, velocities)
        if both:
            plot_exponent(dataset, axes[1], x)
            axes[0].set_xlabel("")
        for ax in axes:
            ax.margins(x=0.08)
        handles, media = _make_legend(dataset), write_labels(dataset, "medium")
        points = all(is_simulated(dataset, {"medium": m}) for m in range(dataset.sizes["medium"]))
        # what tells the slow transverse wave from the fast one
        for name in (_SLOW, "transverse_fast") if variable is None and _SLOW in velocities else ():
            style: dict[str, Any] = {"linewidth": 1.2} | ({"dashes": _SLOW_DASHES} if name == _SLOW else {})
            style = {"marker": _MARKERS[name]} | POINTS if points else style
            handles.append(Line2D([], [], color="0.3", label=_VELOCITIES[name], **style))
        if variable is None and _PULSE in velocities:
            label = _VELOCITIES[_PULSE]
            handles.append(Line2D([], [], color="0.3", marker=_MARKERS[_PULSE], label=label, **POINTS))
        alone = len(media) == 1 and handles[0].get_label() != media[0]
        # in lines for which a column has room
        title, *labels = (
            label if len(label) <= _LETTERS else join_facts([label], _LETTERS)
            for label in (media[0], *(str(handle.get_label()) for handle in handles))
        )
        for handle, label in zip(handles, labels, strict=True):
            handle.set_label(label)
        add_legend(figure, handles, _LEGEND_ROWS, title if alone else None)
    return figure


def _plot_velocities(dataset: Dataset, ax: Axes, x: str | None, drawn: dict[str, str]) -> None:
    """Draw the velocities ``drawn``, with their symbols beside the ends of the lines, one text where these are close."""
    ends: dict[str, float] = {}
    for variable, name in drawn.items():
        plot_sweep(dataset, ax, variable, x, legend=False)
        if variable == _PULSE:
            continue  # the legend names its marks, which are often near those of long waves
        # at the right end of each line: a path may turn, and end anywhere
        lines = [np.asarray(line.get_xydata()) for line in ax.lines if line.get_gid() == f"{variable}-all"]
        right = [float(line[np.argmax(line[:, 0]), 1]) for line in lines]
        if known := [value for value in right if np.isfinite(value)]:
            ends[name] = max(known)
    scale_axis(ax, "y", np.concatenate([np.asarray(dataset[name]).ravel() for name in drawn]))
    ax.set_ylabel(f"Sound velocity ({CATALOGUE['longitudinal'].unit})")
    to_axes, last = ax.transData - ax.transAxes, -np.inf
    together: dict[float, list[str]] = {}
    for name, value in sorted(ends.items(), key=lambda item: item[1]):
        height = float(to_axes.transform((ax.get_xlim()[0], value))[1])
        if height - last > _APART:
            last, together[value] = height, []
        together[max(together)].append(name)
    for value, names in together.items():
        _write_beside(ax, ", ".join(names), value)
