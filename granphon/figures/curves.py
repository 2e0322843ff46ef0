"""Curves of figures over the load: how a data set holds them, what they are in words, and how they are drawn.

A data set of a sweep has a curve for each medium, combination of parameters and direction.
"""

from __future__ import annotations

import json
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any

from granphon.figures.scales import name_axis, scale_axis

import numpy as np
from matplotlib.axes import Axes
from matplotlib.lines import Line2D
from numpy.typing import NDArray

from granphon.balls.lattices import find_lattice
from granphon.balls.packing import Packing
from granphon.base.errors import FigureError, InputError, message
from granphon.base.quantities import LOAD_KINDS
from granphon.base.results import restore
from granphon.figures.style import COLOURS
from granphon.figures.words import MEDIA, describe_medium, describe_overlap, describe_parameter, list_facts
from granphon.media.choice import AutoMedium
from granphon.media.simulation import DirectSimulation
from granphon.observables.catalogue import axis_label
from granphon.runs.dataset import list_finite_overlap

if TYPE_CHECKING:
    from granphon.runs.dataset import Dataset


Array = NDArray[np.float64]
#: the largest number on an axis; matplotlib overflows where it draws margins and ticks beyond
_LARGEST = 1e280
#: dashes of lines that have the same colour, the first solid; none is that of a line outside its range
_DASHES = (None, (1.0, 1.4), (5.0, 1.6, 1.0, 1.6), (8.0, 2.5))
#: marks of points that have the same colour
_MARKERS = ("o", "s", "^", "D")
#: the most lines that colours and dashes tell apart
MOST_LOOKS = len(COLOURS) * len(_DASHES)
#: marks of the media that an automatic medium chose; a simulation has the mark of its points
_SERVING = {"ala": "s", "afa": "v", "ema": "^", "cluster": "D"}
#: such a line has at most about so many of these marks
_MOST_MARKS = 12
#: looks of a line, and of marks, where the medium is not valid
_OUTSIDE: dict[str, Any] = {"linewidth": 0.7, "dashes": (3.0, 1.5)}
_HOLLOW = {"markerfacecolor": "white"}
#: sizes of marks: of points, of those that say which medium served, and of those that are reached by a fall of the load
_SIZE, _SERVING_SIZE, _FALL_SIZE = 3.0, 3.6, 5.0
#: what points have in a legend, but colour and mark
POINTS: dict[str, Any] = {"markersize": _SIZE, "linestyle": "none"}


@dataclass(frozen=True)
class Look:
    """How a curve is drawn: colour, width of its line, dashes (None: solid), and the mark of its points."""

    colour: Any
    width: float = 1.2
    dashes: tuple[float, ...] | None = None
    marker: str = "o"


@dataclass(frozen=True, eq=False)
class Curve:
    """A quantity y over x, in order of x, or of the path that the loads take; arrays are (n,).

    Attributes
    ----------
    run : the name of the run that it belongs to, for messages.
    facts : what it is, in words by kind.
    x, y : the values; ``error`` are the standard errors of y, nan where there is none.
    valid : where the medium is valid.
    simulated : where a simulation gave the values: they are points, and the others a line.
    served : of an automatic medium the name of the medium that served each load; else empty.
    units : those of x and y.
    measured : whether it is data.
    path : whether the loads go up and down in the order of the values.
    """

    run: str
    facts: dict[str, str]
    x: Array
    y: Array
    error: Array
    valid: NDArray[np.bool_]
    simulated: NDArray[np.bool_]
    served: tuple[str, ...] = ()
    units: tuple[str, str] = ("", "")
    measured: bool = False
    path: bool = False

    def sorted(self) -> Curve:
        """Return the same curve in order of x; a path keeps its own."""
        if self.path:
            return self
        order = np.argsort(self.x, kind="stable")
        parts: dict[str, Any] = {name: getattr(self, name)[order] for name in ("x", "y", "error", "valid", "simulated")}
        return replace(self, **parts, served=tuple(self.served[n] for n in order.tolist()) if self.served else ())

    @property
    def as_points(self) -> bool:
        """Whether no line is drawn: all values are simulated or measured, or there is only one."""
        return bool(np.all(self.simulated)) or self.x.size == 1


def make_looks(count: int) -> list[Look]:
    """Return looks of ``count`` curves: colours first, then dashes and marks; lines grow thinner, so that all are seen.

    Beyond :data:`MOST_LOOKS` they come again.
    """
    turns = [(n % len(COLOURS), n // len(COLOURS) % len(_DASHES)) for n in range(count)]
    widths = np.linspace(2.2, 1.0, count + 1)[1:].tolist() if count > 1 else [1.6]
    return [
        Look(COLOURS[colour], width, _DASHES[turn], _MARKERS[turn])
        for (colour, turn), width in zip(turns, widths, strict=True)
    ]


def draw_curve(ax: Axes, curve: Curve, look: Look, gid: str) -> None:
    """Draw a curve: solid where it is valid, thin and dashed elsewhere; of a simulation points with bars of their errors.

    A path joins its points, and triangles mark those that are reached by a fall of x. On an automatic medium each kind of
    mark says which medium served.
    """
    drawn = np.any(curve.error > 0.0)
    points = curve.as_points
    if drawn and (points or np.any(curve.simulated)):
        bars: dict[str, Any] = {"fmt": "none", "elinewidth": 0.8, "color": look.colour, "gid": f"{gid}-errors"}
        ax.errorbar(curve.x, curve.y, np.where(curve.error > 0.0, curve.error, np.nan), **bars)
    style: dict[str, Any] = {"color": look.colour, "markersize": _SIZE, "marker": look.marker if points else ""}
    if points and not curve.served:
        joined = {"linestyle": "-", "linewidth": 0.6} if curve.path else {"linestyle": "none"}
        thin, solid = style | joined | _HOLLOW, style | {"linestyle": "none"}
    else:
        style["marker"] = ""
        # thinner below marks, so that these are seen
        thin, solid = style | _OUTSIDE, style | {"linewidth": 0.8 if curve.served else look.width}
        if look.dashes:  # through whose gaps a thin line below would be seen
            solid |= {"dashes": look.dashes}
            outside = ~curve.valid  # and the ends of these stretches, from which their lines go
            outside[1:] |= ~curve.valid[:-1]
            outside[:-1] |= ~curve.valid[1:]
            ax.plot(curve.x, np.where(outside, curve.y, np.nan), gid=f"{gid}-outside", **thin)
            thin = {"linestyle": "none"}
    ax.plot(curve.x, curve.y, gid=f"{gid}-all", **thin)
    ax.plot(curve.x, np.where(curve.valid, curve.y, np.nan), gid=f"{gid}-valid", **solid)
    falls = np.diff(curve.x, prepend=curve.x[0]) < 0.0
    if curve.path and np.any(falls):
        fallen = solid | {"marker": "v", "markersize": _FALL_SIZE}
        ax.plot(curve.x[falls], np.where(curve.valid, curve.y, np.nan)[falls], gid=f"{gid}-falling", **fallen)
    # on an automatic medium, which medium served where: the ends of its loads, and some between
    n, named = curve.x.size, np.array([one.partition("(")[0] for one in curve.served])
    change = np.flatnonzero(named[1:] != named[:-1])
    some = np.concatenate([np.arange(0, n, max(1, -(-n // _MOST_MARKS))), change, change + 1, [n - 1]])
    shown = np.isin(np.arange(n), some) | curve.simulated
    for name in dict.fromkeys(named.tolist()):
        for valid in (True, False):
            there = shown & (named == name) & (curve.valid == valid)
            marks: dict[str, Any] = {"color": look.colour, "markersize": _SERVING_SIZE, "linestyle": "none"}
            marks |= {} if valid else _HOLLOW
            if np.any(there):
                ax.plot(curve.x[there], curve.y[there], _SERVING.get(name, "o"), gid=f"{gid}-served-{name}", **marks)


def label_axes(ax: Axes, curves: Sequence[Curve], x: str, y: str) -> None:
    """Scale the axes for curves of the quantity ``y`` over ``x``, and name them with their units."""
    for which, name, unit in zip("xy", (x, y), curves[0].units, strict=True):
        values = np.concatenate([getattr(curve, which) for curve in curves])
        scale_axis(ax, which, values)
        most = float(np.max(np.abs(values[np.isfinite(values)]), initial=0.0))
        name_axis(getattr(ax, f"{which}axis"), most, axis_label(name, ""), unit)


def make_handle(look: Look, label: str, points: bool) -> Line2D:
    """Return the entry of the legend for a curve with a look, as points or as a line."""
    line: dict[str, Any] = {"linewidth": min(look.width, 1.6)} | ({"dashes": look.dashes} if look.dashes else {})
    return Line2D([], [], color=look.colour, label=label, **({"marker": look.marker} | POINTS if points else line))


def make_remarks(curves: Sequence[Curve]) -> list[Line2D]:
    """Return the last entries of a legend: loads at which a medium is not valid, and media that automatic ones chose."""
    handles, grey = list[Line2D](), dict[str, Any](color="0.3")
    if not all(np.all(curve.valid) for curve in curves):
        points: dict[str, Any] = {"marker": "o"} | POINTS | _HOLLOW
        look = points if all(curve.as_points for curve in curves) else _OUTSIDE
        handles.append(Line2D([], [], label="outside its range", **grey, **look))
    names = {one.partition("(")[0] for curve in curves for one in curve.served}
    style = grey | {"markersize": _SERVING_SIZE, "linestyle": "none"}
    return handles + [
        Line2D([], [], marker=_SERVING.get(name, "o"), label=f"{MEDIA.get(name, name)} served", **style)
        for name in sorted(names, key=list(MEDIA).index)
    ]


# -- the curves of a data set


def find_load(dataset: Dataset) -> str:
    """Return the name of the load that was given: a coordinate along the loads."""
    return next((str(name) for name in LOAD_KINDS if name in dataset.coords and dataset[name].dims == ("load",)), "force")


def drop_directions(dataset: Dataset, variable: str) -> Dataset:
    """Return the sweep without its directions, if a variable is the same in all: its lines are those of the media."""
    same = variable in dataset and "direction" not in dataset[variable].dims
    return dataset.drop_dims("direction", errors="ignore") if same else dataset


def read_values(dataset: Dataset, name: str) -> Any:
    """Return a variable over the load; :class:`InputError` if it cannot be drawn, FigureError beyond matplotlib's axes."""
    if name not in dataset.variables:
        known = ", ".join(map(str, dataset.data_vars))
        raise InputError(message(f"the sweep has no variable {name!r}", f"It has {known}"))
    values = dataset[name]
    if name not in list_quantities(dataset, "fiub"):
        raise InputError(message(f"{name!r} is not one number at each load", mend="Draw another variable"))
    if not np.any(np.isfinite(values)):
        raise InputError(message(f"{name!r} has no finite value", mend="Draw another variable"))
    sizes = np.abs(np.asarray(values, float))
    far = (np.isfinite(sizes) & (sizes > _LARGEST)) | ((sizes > 0.0) & (sizes < 1.0 / _LARGEST))
    if np.any(far):
        what = f"{name!r} has the value {np.asarray(values)[far].flat[0]:g}"
        why = f"Figures have axes from {1.0 / _LARGEST:g} to {_LARGEST:g}"
        raise FigureError(message(what, why, "Draw another variable"))
    return values


def list_quantities(dataset: Dataset, kinds: str = "fiu") -> tuple[str, ...]:
    """Return the names of the variables that are one number, of these ``kinds`` of dtype, at each load."""
    dims = {"load", "medium", *list_parameters(dataset)}
    return tuple(
        str(name)
        for name, values in dataset.variables.items()
        if "load" in values.dims and set(values.dims) <= dims and values.dtype.kind in kinds
    )


def list_parameters(dataset: Dataset) -> list[str]:
    """Return the dimensions of the sweep besides load and medium: its parameters, and directions if there are many."""
    along = ("direction",) * ("direction" in dataset.dims)
    return [str(name) for name in (*dataset["valid"].dims, *along) if name not in ("load", "medium")]


def read_packing(dataset: Dataset) -> Packing | None:
    """Return the packing whose parameters a sweep varies; None if the data set does not tell it, as of a crystal."""
    told = json.loads(dataset.attrs.get("packing", "null"))
    if told is None or "kinds" in told:
        return None
    found: Packing = restore(told, Packing, "the packing of the sweep")
    return found


def read_curve(
    dataset: Dataset, variable: str, x: str, index: dict[str, int], run: str = "", facts: dict[str, str] | None = None
) -> Curve:
    """Return the curve of a variable over ``x`` at an index of each dimension besides the load."""

    def take(values: Any) -> Any:
        return np.asarray(values.isel(index, missing_dims="ignore"))

    across, along = read_values(dataset, x), read_values(dataset, variable)
    error = dataset.get(f"{variable}_error", dataset[variable] * np.nan)
    served: tuple[str, ...] = ()
    if _name_medium(dataset, index) == AutoMedium.name and "choice" in dataset:
        served = tuple(map(str, take(dataset["choice"]).tolist()))
    horizontal = take(across).astype(float)
    simulated = [one.partition("(")[0] == DirectSimulation.name for one in served] or (
        _name_medium(dataset, index) == DirectSimulation.name
    )
    simulated = dataset.attrs.get("points", simulated)  # a fit is a line, whatever its medium
    units = tuple(str(dataset[name].attrs.get("units", "")) for name in (x, variable))
    options: dict[str, Any] = next(iter(json.loads(dataset.attrs.get("media", "[{}]"))[index["medium"]].values()), {})
    return Curve(
        run, facts or {}, horizontal, take(along).astype(float), take(error).astype(float), take(dataset["valid"]),
        np.broadcast_to(np.asarray(simulated, bool), horizontal.shape), served, (units[0], units[1]),
        path=bool(options.get("ordered")),
    ).sorted()  # fmt: skip


def describe_lines(dataset: Dataset, variable: str) -> list[tuple[dict[str, str], dict[str, int]]]:
    """Return for each line of a variable what it is, in words by kind, and its index in each dimension besides the load."""
    packing = read_packing(dataset)
    finite = list_finite_overlap(dataset)
    base = {} if packing is None else list_facts(packing)
    told = json.loads(dataset.attrs.get("packing", "{}"))
    if "kinds" in told:
        base["lattice"] = (
            f"{told['lattice'] or 'crystal'} of {' '.join(told['order'] or [name for name, _ in told['kinds']])}"
        )
    found, names, media = [], list_parameters(drop_directions(dataset, variable)), _write_media(dataset)
    if "direction" in dataset.coords and "direction" not in names and dataset["direction"].ndim == 0:
        base["direction"] = f"along {dataset['direction'].item()}"
    for place in np.ndindex(*(dataset.sizes[name] for name in names)):
        at = dict(zip(names, place, strict=True))
        facts = dict(base)
        for name, number in at.items():
            value = dataset[name].values[number]
            value = value.item() if hasattr(value, "item") else value
            told = ("direction", f"along {value}") if name == "direction" else describe_parameter(name, value)
            facts[told[0]] = told[1]
        for m, medium in enumerate(media):
            overlap = {} if packing is None else {"overlap": describe_overlap(finite[m])}
            found.append((facts | overlap | {"medium": medium}, at | {"medium": m}))
    return found


def _name_medium(dataset: Dataset, index: dict[str, int]) -> str:
    """Return the name of the medium at ``index``, by its label."""
    return str(np.atleast_1d(dataset["medium"].values)[index["medium"]]).partition("(")[0]


def _write_media(dataset: Dataset) -> list[str]:
    """Return the media of a sweep in words; cells of a lattice that is not told, or varied, are called cells."""
    packing = read_packing(dataset)
    periods, balls = (2, 2) if packing is None else (packing.structure.periods, packing.structure.n_balls)
    if "lattice" in dataset.coords and packing is not None:
        names = [str(name) for name in np.atleast_1d(dataset["lattice"].values)]
        try:
            lattices = [find_lattice(name) for name in names]
            periods, balls = lattices[0].periods, max(one.n_balls for one in lattices)
        except InputError:  # a lattice of the user's own
            balls = 2
    return [describe_medium(str(label), periods, balls) for label in np.atleast_1d(dataset["medium"].values).tolist()]
