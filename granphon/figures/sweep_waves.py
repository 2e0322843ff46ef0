"""Figures of the waves in the simulated arrays of a sweep: densities of states, and the lines of plane waves, over loads.

A state, which is a load, a medium and a combination of parameters, has one colour. Of more than eight states eight are
drawn, evenly taken, and the legend says of how many.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from granphon.figures.scales import add_legend, draw_densities, scale_axis

import matplotlib
import numpy as np
from matplotlib import colormaps
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from numpy.typing import NDArray

from granphon.base.errors import InputError, message
from granphon.base.scales import HertzPrefix
from granphon.figures.curves import find_load, list_combinations, pick_evenly, write_labels
from granphon.figures.style import COLUMN_WIDTH, DPI, STYLE, print_hertz
from granphon.figures.zones import name_corners

if TYPE_CHECKING:
    from granphon.runs.dataset import Dataset


Array = NDArray[np.float64]
#: greatest number of states that are drawn
_MOST = 8
#: part of the colour map that is used: its ends are too pale on paper
_SHADES = (0.0, 0.85)
#: part of the samples in which a line must be resolved, for its width to be drawn
_RESOLVED = 0.5

#: a state that is drawn: its colour, its words in the legend, and its index in each dimension of the sweep
_State = tuple[Any, str, dict[str, int]]


def _choose_states(dataset: Dataset) -> tuple[list[_State], int]:
    """Return the states that are drawn, in order of load, and the number of all of them."""
    load = find_load(dataset)
    loads, media = write_labels(dataset, load), write_labels(dataset, "medium")
    found = []
    for at in np.argsort(dataset[load].values, kind="stable").tolist():
        for m, medium in enumerate(media):
            for words, place in list_combinations(dataset):
                parts = [loads[at]] * (len(loads) > 1) + [medium] * (len(media) > 1) + [words] * bool(words)
                found.append((", ".join(parts) or loads[at], place | {"medium": m, "load": at}))
    chosen = pick_evenly(len(found), _MOST)
    shades = colormaps["viridis"](np.linspace(*_SHADES, len(chosen)) if len(chosen) > 1 else [0.3])
    return [(tuple(shade), *found[n]) for shade, n in zip(shades.tolist(), chosen, strict=True)], len(found)


def _take(dataset: Dataset, name: str, place: dict[str, int], **more: int) -> Array:
    """Return the values of a variable in one state."""
    return np.asarray(dataset[name].isel(place | more, missing_dims="ignore"), float)


def _require(dataset: Dataset, name: str, what: str) -> None:
    if name not in dataset:
        raise InputError(message(f"the sweep has no {what} of arrays", mend="Draw another figure"))


def plot_sweep_dos(dataset: Dataset, ax: Axes) -> Axes:
    """Draw the densities of states of the arrays of a sweep, with their standard errors as bands, a colour for each state.

    Raises :class:`~granphon.base.errors.InputError` if the sweep has none.
    """
    _require(dataset, "dos_total", "densities of states")
    curves = [
        (colour, words, *(_take(dataset, f"dos_{name}", at) for name in ("frequency", "total", "error")))
        for colour, words, at in _choose_states(dataset)[0]
    ]
    draw_densities(ax, curves)
    return ax


def plot_sweep_dispersion(dataset: Dataset, ax: Axes, polarisation: int = 0) -> Axes:
    """Draw the frequencies of plane waves in the arrays of a sweep along the path, a colour for each state.

    Bars are as long as the line is wide (full, at half maximum) where it is resolved in at least half of the samples.
    ``polarisation`` is the number of that along the dimension. Raises :class:`~granphon.base.errors.InputError` if the sweep
    has no spectra.
    """
    _require(dataset, "line_frequency", "spectra")
    unit = HertzPrefix.for_top(float(np.nanmax(dataset["line_frequency"].values)))
    corners = np.zeros(0)
    for colour, _, place in _choose_states(dataset)[0]:
        ends, along = _take(dataset, "path_corners", place), _take(dataset, "path_distance", place)
        corners = ends / ends[-1]  # paths of balls of several diameters differ in length alone
        peak, width, resolved = (
            _take(dataset, f"line_{name}", place, polarisation=polarisation) for name in ("frequency", "width", "resolved")
        )
        bars = np.where(resolved >= _RESOLVED, 0.5 * width, 0.0) / unit.hertz
        style: dict[str, Any] = {"fmt": "o", "markersize": 2.4, "elinewidth": 0.8, "color": colour, "zorder": 3}
        dots, *_ = ax.errorbar(along / ends[-1], peak / unit.hertz, bars, **style)
        dots.set_clip_on(False)
    name_corners(ax, corners, [str(label) for label in dataset["labels_of_path"].values])
    name = str(dataset["polarisation"].values[polarisation])
    ax.set(ylabel=f"Frequency, {name} ({print_hertz(unit)})", ylim=(0.0, None))
    return ax


def plot_sweep_attenuation(dataset: Dataset, ax: Axes, polarisation: int = 0) -> Axes:
    """Draw the attenuation of plane waves over their frequency, both logarithmic, with bars of its standard error.

    Lines that are resolved in fewer than half of the samples are left out. Arguments and errors are those of
    :func:`plot_sweep_dispersion`.
    """
    _require(dataset, "line_frequency", "spectra")
    unit, shown = HertzPrefix.for_top(float(np.nanmax(dataset["line_frequency"].values))), [np.ones(1)]
    for colour, _, place in _choose_states(dataset)[0]:
        names = ["line_frequency", "attenuation", "line_resolved"] + ["attenuation_error"] * ("attenuation_error" in dataset)
        f, alpha, resolved, *error = (_take(dataset, one, place, polarisation=polarisation) for one in names)
        there = (resolved >= _RESOLVED) & (alpha > 0.0)
        bars = error[0][there] if error and np.all(np.isfinite(error[0])) else None
        if bars is not None:  # down to a tenth of the value at most, as there is no zero on the axis
            bars = np.array([np.minimum(bars, 0.9 * alpha[there]), bars])
        style: dict[str, Any] = {"fmt": "o", "markersize": 2.4, "elinewidth": 0.7, "color": colour}
        ax.errorbar(f[there] / unit.hertz, alpha[there], bars, **style)
        shown.append(f[there] / unit.hertz)
    values = np.concatenate(shown[1:])
    if values.size:
        ax.set_yscale("log")
        scale_axis(ax, "x", values)
    else:
        ax.text(0.5, 0.5, "no line is resolved", transform=ax.transAxes, ha="center", va="center", color="0.4")
        ax.set(xticks=[], yticks=[])
    name = str(dataset["polarisation"].values[polarisation])
    ax.set(xlabel=f"Frequency ({print_hertz(unit)})", ylabel=f"Attenuation, {name} (1/m)")
    return ax


def sweep_dos_figure(dataset: Dataset) -> Figure:
    """Draw a figure, one column wide, of the densities of states of a sweep; see :func:`plot_sweep_dos`."""
    with matplotlib.rc_context(STYLE):
        figure = Figure((COLUMN_WIDTH, 2.8), dpi=DPI, layout="constrained")
        plot_sweep_dos(dataset, figure.subplots())
        _add_legend(figure, dataset)
    return figure


def sweep_spectra_figure(dataset: Dataset) -> Figure:
    """Draw a figure of the plane waves of a sweep, one column wide: for each polarisation dispersion and attenuation."""
    _require(dataset, "line_frequency", "spectra")
    count = dataset.sizes["polarisation"]
    with matplotlib.rc_context(STYLE):
        figure = Figure((COLUMN_WIDTH, 0.4 + 4.2 * count), dpi=DPI, layout="constrained")
        panels = figure.subplots(2 * count, 1, squeeze=False, height_ratios=[1.2, 1.0] * count)[:, 0]
        for number in range(count):
            plot_sweep_dispersion(dataset, panels[2 * number], number)
            plot_sweep_attenuation(dataset, panels[2 * number + 1], number)
        _add_legend(figure, dataset)
    return figure


def _add_legend(figure: Figure, dataset: Dataset) -> None:
    states, count = _choose_states(dataset)
    lines = [Line2D([], [], color=colour, label=words) for colour, words, _ in states]
    if count > len(states):
        lines.append(Line2D([], [], linestyle="none", label=f"{len(states)} of {count} are drawn"))
    add_legend(figure, lines, room=1)
