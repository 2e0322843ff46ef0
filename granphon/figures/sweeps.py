"""Figures of sweeps: quantities over the load, a line for each medium and combination of parameters.

As in :mod:`granphon.figures.bands`, every function draws on an Axes and returns it, and matplotlib's global state is left
alone. Each medium has a colour, and each combination of parameters a shade of it; a line is dashed where its medium is not
valid.
"""

from __future__ import annotations

import itertools
import json
from typing import TYPE_CHECKING, Any

# before matplotlib, whose import this module guards
from granphon.figures.scales import scale_axis

# isort: split
import matplotlib
import numpy as np
from matplotlib import patheffects
from matplotlib.axes import Axes
from matplotlib.colors import to_rgb
from matplotlib.figure import Figure
from matplotlib.lines import Line2D

from granphon.base.errors import FigureError, InputError, message
from granphon.base.quantities import LOADS
from granphon.figures.style import COLOURS, COLUMN_WIDTH, DPI, GUIDE, STYLE, readable_unit
from granphon.media.simulation import DirectSimulation
from granphon.observables.catalogue import CATALOGUE, axis_label

if TYPE_CHECKING:
    from xarray import Dataset

__all__ = ["find_load", "list_combinations", "plot_exponent", "plot_sweep", "sweep_figure", "write_labels"]

#: the largest number on an axis; matplotlib overflows where it draws margins and ticks beyond
_LARGEST = 1e280

#: labels longer than this, in letters, do not stand side by side in a column
_LONG_LABEL = 24
#: rows of a legend for which a figure has room, and height that each further one adds, in inches
_LEGEND_ROWS, _ROW_HEIGHT = 4, 0.16
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
_FALLEN = "v"
_MARKERS = {_SLOW: "v", "transverse_fast": "^", _PULSE: "s"}
#: names of media in legends
_MEDIA = {"ala": "averaged lattice", "afa": "averaged force", "ema": "effective medium", "cluster": "cluster medium"}


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
    line but points, open where it is not valid; of several samples they are means, with bars of their standard errors. On an
    ordered path a line joins the points in its order, and triangles mark those that are reached by a fall of ``x``.
    The slow transverse wave in space has a dash-dotted line.

    Raises
    ------
    InputError : there is no such variable, it is not one number at each load, or it is nowhere finite.
    """
    x = x or find_load(dataset)
    across, along, lines = _read_values(dataset, variable), _read_values(dataset, x), _colour_lines(dataset)
    for (colour, index), width in zip(lines, np.linspace(2.2, 1.0, len(lines) + 1)[1:], strict=True):
        if index.get("direction") and "direction" not in across.dims:
            continue  # it is the same in all directions: the line of the first one shows it
        horizontal, vertical, inside = (
            np.asarray(part.isel(index, missing_dims="ignore")) for part in (along, across, dataset["valid"])
        )
        on_path = _is_path(dataset, index)
        order = np.arange(horizontal.size) if on_path else np.argsort(horizontal, kind="stable")
        horizontal, vertical, inside = horizontal[order], vertical[order], inside[order]
        simulated = _is_simulated(dataset, index)
        marker = _MARKERS.get(variable, "o") if simulated or order.size == 1 else ""
        style: dict[str, Any] = {"color": colour, "marker": marker, "markersize": 3.0}
        thin, solid = (style | {"gid": f"{variable}-{which}"} for which in ("all", "valid"))
        thin |= {"markerfacecolor": "white"}
        if simulated:
            deviation = np.asarray(_read_errors(dataset, variable).isel(index, missing_dims="ignore"))[order]
            if np.any(deviation > 0.0):
                bars: dict[str, Any] = {"fmt": "none", "elinewidth": 0.8, "color": colour, "gid": f"{variable}-errors"}
                ax.errorbar(horizontal, vertical, deviation, **bars)
            thin |= {"linestyle": "-", "linewidth": 0.6} if on_path else {"linestyle": "none"}
            solid |= {"linestyle": "none"}
        else:
            thin |= {"linewidth": 0.7, "dashes": (3.0, 1.5)}
            solid |= {"linewidth": width} | ({"dashes": _SLOW_DASHES} if variable == _SLOW else {})
        ax.plot(horizontal, vertical, **thin)
        ax.plot(horizontal, np.where(inside, vertical, np.nan), **solid)
        falls = np.diff(horizontal, prepend=horizontal[0]) < 0.0
        if on_path and np.any(falls):
            fallen = solid | {"marker": _FALLEN, "markersize": 5.0, "gid": f"{variable}-falling"}
            ax.plot(horizontal[falls], np.where(inside, vertical, np.nan)[falls], **fallen)
    for which, values, name in (("x", along, x), ("y", across, variable)):
        scale_axis(ax, which, np.asarray(values))
        ax.set(**{f"{which}label": axis_label(name, dataset[name].attrs.get("units", ""))})
    if legend:
        ax.legend(handles=_make_legend(dataset))
    return ax


def find_load(dataset: Dataset) -> str:
    """Return the name of the load that was given: a coordinate along the loads."""
    return next((str(name) for name in LOADS if name in dataset.coords and dataset[name].dims == ("load",)), "force")


def _is_simulated(dataset: Dataset, index: dict[str, int]) -> bool:
    """Return whether the medium at ``index`` is a simulation, by its label."""
    return str(dataset["medium"].values[index["medium"]]).partition("(")[0] == DirectSimulation.name


def _is_path(dataset: Dataset, index: dict[str, int]) -> bool:
    """Return whether the medium at ``index`` takes the loads in the order given, up and down."""
    options: dict[str, Any] = next(iter(json.loads(dataset.attrs.get("media", "[{}]"))[index["medium"]].values()), {})
    return bool(options.get("ordered"))


def _drop_directions(dataset: Dataset, variable: str) -> Dataset:
    """Return the sweep without its directions, if a variable is the same in all: its lines are those of the media."""
    same = variable in dataset and "direction" not in dataset[variable].dims
    return dataset.drop_dims("direction", errors="ignore") if same else dataset


def _read_errors(dataset: Dataset, variable: str) -> Any:
    """Return the standard errors of a variable; nan, drawn without a bar, where they are not known, as for one sample."""
    return dataset.get(f"{variable}_error", dataset[variable] * np.nan)


def _read_values(dataset: Dataset, name: str) -> Any:
    """Return a variable over the load; :class:`InputError` if it cannot be drawn, FigureError beyond matplotlib's axes."""
    if name not in dataset.variables:
        known = ", ".join(map(str, dataset.data_vars))
        raise InputError(message(f"the sweep has no variable {name!r}", f"It has {known}"))
    values = dataset[name]
    extra = set(values.dims) - {"load", "medium", *_list_parameters(dataset)}
    if "load" not in values.dims or values.dtype.kind not in "fiub" or extra:
        raise InputError(message(f"{name!r} is not one number at each load", mend="Draw another variable"))
    if not np.any(np.isfinite(values)):
        raise InputError(message(f"{name!r} has no finite value", mend="Draw another variable"))
    sizes = np.abs(np.asarray(values, float))
    far = (np.isfinite(sizes) & (sizes > _LARGEST)) | ((sizes > 0.0) & (sizes < 1.0 / _LARGEST))
    if np.any(far):
        what = f"{name!r} has the value {np.asarray(values)[far].flat[0]:g}"
        raise FigureError(
            message(what, f"Figures have axes from {1.0 / _LARGEST:g} to {_LARGEST:g}", "Draw another variable")
        )
    return values


def _list_parameters(dataset: Dataset) -> list[str]:
    """Return the dimensions of the sweep besides load and medium: its parameters, and directions if there are many."""
    along = ("direction",) * ("direction" in dataset.dims)
    return [str(name) for name in (*dataset["valid"].dims, *along) if name not in ("load", "medium")]


def list_combinations(dataset: Dataset) -> list[tuple[str, dict[str, int]]]:
    """Return every combination of parameters: the values of those that vary, in words, and the index of each parameter."""
    names = _list_parameters(dataset)
    words = {name: [f"{name.replace('_', ' ')} {label}" for label in write_labels(dataset, name)] for name in names}
    several = [name for name in names if dataset.sizes[name] > 1]
    places = [dict(zip(names, index, strict=True)) for index in np.ndindex(*(dataset.sizes[name] for name in names))]
    return [(", ".join(words[name][place[name]] for name in several), place) for place in places]


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


def write_labels(dataset: Dataset, name: str) -> list[str]:
    """Return the names of the values of a dimension in a legend."""
    values = np.atleast_1d(dataset[name].values).tolist()
    if name == "medium":
        return [_MEDIA.get(value, str(value)) for value in values]
    if not all(isinstance(value, float) for value in values):
        return [str(value) for value in values]
    number, unit = readable_unit(max(map(abs, values)), dataset[name].attrs.get("units", ""))
    return [f"{value / number:.4g} {unit}".rstrip() for value in values]


def _make_legend(dataset: Dataset) -> list[Line2D]:
    """Return the entries of the legend: media, combinations of parameters, and the dashes of lines outside their range.

    Combinations are grey if there are several media. At most eight are named, and the last entry then says of how many.
    """
    media = list(zip(itertools.cycle(COLOURS), write_labels(dataset, "medium"), strict=False))
    words = [word for word, _ in list_combinations(dataset)]
    values: list[tuple[Any, str]] = []
    if len(words) > 1:
        shades = _make_shades(COLOURS[0] if len(media) == 1 else "0.5", len(words))
        shown = np.unique(np.linspace(0, len(words) - 1, min(len(words), 8)).round().astype(int))
        values = [(shades[i], words[i]) for i in shown.tolist()]
    simulated = [_is_simulated(dataset, {"medium": m}) for m in range(len(media))]
    point: dict[str, Any] = {"marker": "o", "markersize": 3.0, "linestyle": "none"}
    entries = [] if values and len(media) == 1 else list(zip(media, simulated, strict=True))
    entries += [(value, all(simulated)) for value in values]
    lines = [Line2D([], [], color=colour, label=label, **(point if points else {})) for (colour, label), points in entries]
    if len(values) < len(words) > 1:
        lines.append(Line2D([], [], linestyle="none", label=f"{len(values)} of {len(words)} are named"))
    if not np.all(dataset["valid"]):
        outside = point | {"markerfacecolor": "white"} if all(simulated) else {"linewidth": 0.7, "dashes": (3.0, 1.5)}
        lines.append(Line2D([], [], color="0.3", label="outside its range", **outside))
    return lines


def _name_transverse(dataset: Dataset) -> list[Line2D]:
    """Return the entries of the legend that tell the slow transverse wave from the fast one."""
    points = all(_is_simulated(dataset, {"medium": m}) for m in range(dataset.sizes["medium"]))
    entries = []
    for name, dashes in ((_SLOW, _SLOW_DASHES), ("transverse_fast", None)):
        style: dict[str, Any] = {"linewidth": 1.2} | ({"dashes": dashes} if dashes else {})
        if points:
            style = {"marker": _MARKERS[name], "markersize": 3.0, "linestyle": "none"}
        entries.append(Line2D([], [], color="0.3", label=_VELOCITIES[name], **style))
    return entries


def plot_exponent(dataset: Dataset, ax: Axes, x: str | None = None) -> Axes:
    """Draw the local exponent d log v_L / d log P of a sweep, with that of the ideal lattice, 1/6, and the popular 1/4.

    The exponent of v_T is the same, except in a simulation. The points of a simulation of several samples have bars of
    their standard errors. ``x`` is that of :func:`plot_sweep`. See :func:`granphon.local_exponent`.
    """
    plot_sweep(_drop_directions(dataset, "exponent"), ax, "exponent", x, legend=False)
    ax.set_yscale("linear")
    for value, name in ((1.0 / 6.0, "1/6"), (0.25, "1/4")):
        ax.axhline(value, color=GUIDE, linewidth=0.6, zorder=0.5)
        ax.annotate(
            name, (0.0, value), xycoords=ax.get_yaxis_transform(), xytext=(2, 1), textcoords="offset points", va="bottom",
            color="0.4", fontsize=7.0, path_effects=[patheffects.withStroke(linewidth=1.5, foreground="white")],
        )  # fmt: skip
    ax.margins(y=0.16)
    return ax


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
        dataset = _drop_directions(dataset, variable or "normal_stiffness")
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
        if variable is None and _SLOW in velocities:
            handles += _name_transverse(dataset)
        if variable is None and _PULSE in velocities:
            style: dict[str, Any] = {"marker": _MARKERS[_PULSE], "markersize": 3.0, "linestyle": "none"}
            handles.append(Line2D([], [], color="0.3", label=_VELOCITIES[_PULSE], **style))
        title = media[0] if len(media) == 1 and handles[0].get_label() != media[0] else None
        longest = max(len(str(handle.get_label())) for handle in handles)
        columns = 1 if longest > _LONG_LABEL else min(2, len(handles))
        # a long legend does not take the room of the panels
        more = max(0, -(-len(handles) // columns) - _LEGEND_ROWS) * _ROW_HEIGHT
        figure.set_size_inches(figure.get_figwidth(), figure.get_figheight() + more)
        figure.legend(handles=handles, loc="outside lower center", ncols=columns, title=title)
    return figure


def _plot_velocities(dataset: Dataset, ax: Axes, x: str | None, drawn: dict[str, str]) -> None:
    """Draw the velocities ``drawn``, with their symbols beside the ends of the lines, one text where these are close."""
    ends: dict[str, float] = {}
    for variable, name in drawn.items():
        plot_sweep(dataset, ax, variable, x, legend=False)
        if variable == _PULSE:
            continue  # the legend names its marks, which are often near those of long waves
        last_values = [float(np.asarray(line.get_ydata())[-1]) for line in ax.lines if line.get_gid() == f"{variable}-all"]
        if known := [value for value in last_values if np.isfinite(value)]:
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
        ax.annotate(
            ", ".join(names), (1.0, value), xycoords=ax.get_yaxis_transform(), xytext=(3, 0), textcoords="offset points",
            va="center", annotation_clip=False,
        )  # fmt: skip
