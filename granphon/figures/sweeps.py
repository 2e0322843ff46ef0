"""Figures of sweeps: quantities over the load, a line for each medium and combination of parameters.

As in :mod:`granphon.figures.bands`, every function draws on an Axes and returns it, and matplotlib's global state is left
alone. Each medium has a colour, and each combination of parameters a shade of it; a line is dashed where its medium is not
valid.
"""

from __future__ import annotations

import itertools
from typing import TYPE_CHECKING, Any

from granphon.figures.scales import add_legend, scale_axis, styled_figure

import numpy as np
from matplotlib.axes import Axes
from matplotlib.colors import to_rgb
from matplotlib.figure import Figure
from matplotlib.lines import Line2D

from granphon.figures.curves import (
    Curve,
    Look,
    describe_lines,
    draw_curve,
    find_load,
    label_axes,
    make_handle,
    make_remarks,
    read_curve,
    read_values,
)
from granphon.figures.style import COLOURS, GUIDE, pick_evenly
from granphon.figures.words import find_differing, join_facts
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
    _, handles = _draw(dataset, ax, variable, x)
    if legend:
        ax.legend(handles=handles)
    return ax


def _draw(dataset: Dataset, ax: Axes, variable: str, x: str | None) -> tuple[list[Curve], list[Line2D]]:
    """Draw what :func:`plot_sweep` draws, and return its curves and the entries of its legend.

    These are the media, combinations of parameters, grey if there are several media, and what holds for all curves.
    """
    x, colours = x or find_load(dataset), itertools.cycle(COLOURS)
    read_values(dataset, variable)
    lines = sorted(describe_lines(dataset, variable), key=lambda line: line[1]["medium"])
    curves = [read_curve(dataset, variable, x, index, facts=facts) for facts, index in lines]
    count = len(lines) // dataset.sizes["medium"]
    groups = [curves[n : n + count] for n in range(0, len(curves), count)]
    media = [(Look(colour, 1.5), group) for colour, group in zip(colours, groups, strict=False)]
    shades = [shade for look, _ in media for shade in _make_shades(look.colour, count)]
    dashes, marker = _SLOW_DASHES if variable == _SLOW else None, _MARKERS.get(variable, "o")
    for curve, shade, width in zip(curves, shades, np.linspace(2.2, 1.0, len(lines) + 1)[1:], strict=True):
        draw_curve(ax, curve, Look(shade, width, dashes, marker), variable)
    label_axes(ax, curves, x, variable)
    simulated = [all(np.all(curve.simulated) and not curve.served for curve in group) for group in groups]
    several, handles = len(media) > 1, list[Line2D]()
    if several or count == 1:
        named = zip(media, simulated, strict=True)
        handles = [make_handle(look, group[0].facts["medium"], points) for (look, group), points in named]
    if count > 1:
        kinds, _ = find_differing([curve.facts for curve in groups[0]])
        grey, chosen = _make_shades("0.5" if several else COLOURS[0], count), pick_evenly(count, _MOST_NAMED)
        for n in chosen:
            words = ", ".join(groups[0][n].facts[kind] for kind in kinds)
            handles.append(make_handle(Look(grey[n], 1.5), words, all(simulated)))
        if len(chosen) < count:
            handles.append(Line2D([], [], linestyle="none", label=f"{len(chosen)} of {count} are named"))
    return curves, handles + make_remarks(curves)


def _make_shades(name: str, count: int) -> list[Any]:
    """Return ``count`` shades of a colour, from darker to lighter than itself; a single shade is the colour itself."""
    colour = np.array(to_rgb(name))
    change = np.linspace(-0.5, 0.6, count) if count > 1 else np.zeros(1)
    return [tuple(colour * (1.0 + min(t, 0.0)) + max(t, 0.0) * (1.0 - colour)) for t in change.tolist()]


def plot_exponent(dataset: Dataset, ax: Axes, x: str | None = None) -> Axes:
    """Draw the local exponent d log v_L / d log P of a sweep, with that of the ideal lattice, 1/6, and the popular 1/4.

    The exponent of v_T is the same, except in a simulation. The points of a simulation of several samples have bars of
    their standard errors. ``x`` is that of :func:`plot_sweep`. See :func:`granphon.local_exponent`.
    """
    plot_sweep(dataset, ax, "exponent", x, legend=False)
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
    velocities = {} if variable else velocities
    shown = list(velocities) or [variable or "normal_stiffness"]
    with styled_figure(4.0 if both else 2.6) as figure:
        ratios = [1.6, 1.0][: 1 + both]
        axes = figure.subplots(1 + both, sharex=True, squeeze=False, height_ratios=ratios)[:, 0]
        every = [_draw(dataset, axes[0], one, x) for one in shown]
        # of velocities some may be the same in all directions, which the legend of the others names
        curves, handles = max(every, key=lambda one: len(one[1]))
        if velocities:
            _name_velocities(axes[0], {velocities[one]: found for one, (found, _) in zip(shown, every, strict=True)})
        if both:
            plot_exponent(dataset, axes[1], x)
            axes[0].set_xlabel("")
        for ax in axes:
            ax.margins(x=0.08)
        medium, points = curves[0].facts["medium"], all(np.all(curve.simulated) and not curve.served for curve in curves)
        # what tells the slow transverse wave from the fast one, and the marks of pulses
        for name in [one for one in _MARKERS if one in velocities and (one == _PULSE or _SLOW in velocities)]:
            look = Look("0.3", 1.2, _SLOW_DASHES if name == _SLOW else None, _MARKERS[name])
            handles.append(make_handle(look, _VELOCITIES[name], points or name == _PULSE))
        alone = dataset.sizes["medium"] == 1 and handles[0].get_label() != medium
        # in lines for which a column has room
        title, *labels = (
            label if len(label) <= _LETTERS else join_facts([label], _LETTERS)
            for label in (medium, *(str(handle.get_label()) for handle in handles))
        )
        for handle, label in zip(handles, labels, strict=True):
            handle.set_label(label)
        add_legend(figure, handles, _LEGEND_ROWS, title if alone else None)
    return figure


def _name_velocities(ax: Axes, drawn: dict[str, list[Curve]]) -> None:
    """Write the symbols of velocities beside the right ends of their curves, one text where these are close."""
    curves = [curve for group in drawn.values() for curve in group]
    scale_axis(ax, "y", np.concatenate([curve.y for curve in curves]))
    ax.set_ylabel(f"Sound velocity ({CATALOGUE['longitudinal'].unit})")
    ends: dict[str, float] = {}
    for name, group in drawn.items():
        # a path may turn, and end anywhere
        right = [float(curve.y[np.argmax(curve.x)]) for curve in group]
        if name != _VELOCITIES[_PULSE] and (known := [value for value in right if np.isfinite(value)]):
            ends[name] = max(known)  # the legend names the marks of pulses, which are often near those of long waves
    to_axes, last = ax.transData - ax.transAxes, -np.inf
    together: dict[float, list[str]] = {}
    for name, value in sorted(ends.items(), key=lambda item: item[1]):
        height = float(to_axes.transform((ax.get_xlim()[0], value))[1])
        if height - last > _APART:
            last, together[value] = height, []
        together[max(together)].append(name)
    for value, names in together.items():
        _write_beside(ax, ", ".join(names), value)
