"""One line, or set of points, of a figure over the load: what it is in words, its values, and how it is drawn."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field, replace
from typing import Any

# before matplotlib, whose import this module guards
from granphon.figures.scales import name_axis, scale_axis

# isort: split
import numpy as np
from matplotlib.axes import Axes
from matplotlib.lines import Line2D
from numpy.typing import NDArray

from granphon.figures.style import COLOURS
from granphon.figures.words import MEDIA
from granphon.observables.catalogue import axis_label

Array = NDArray[np.float64]
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
    measured: bool = field(default=False)
    path: bool = field(default=False)

    @classmethod
    def of_points(cls, run: str, facts: dict[str, str], x: Any, y: Any, error: Any) -> Curve:
        """Make the curve of measured points from numbers or arrays, sorted by x; errors are nan where there is none."""
        across, along = np.atleast_1d(np.asarray(x, float)), np.atleast_1d(np.asarray(y, float))
        every = np.ones(across.shape, bool)
        spread = np.broadcast_to(np.asarray(error, float), across.shape)
        return cls(run, facts, across, along, spread, every, every, measured=True).sorted()

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

    def merge(self, other: Curve) -> Curve:
        """Return the points of this curve and of another as one."""
        parts: dict[str, Any] = {
            n: np.concatenate([getattr(self, n), getattr(other, n)]) for n in ("x", "y", "error", "valid", "simulated")
        }
        return replace(self, **parts, served=self.served + other.served).sorted()


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
            ax.plot(curve.x, np.where(_find_outside(curve.valid), curve.y, np.nan), gid=f"{gid}-outside", **thin)
            thin = {"linestyle": "none"}
    ax.plot(curve.x, curve.y, gid=f"{gid}-all", **thin)
    ax.plot(curve.x, np.where(curve.valid, curve.y, np.nan), gid=f"{gid}-valid", **solid)
    falls = np.diff(curve.x, prepend=curve.x[0]) < 0.0
    if curve.path and np.any(falls):
        fallen = solid | {"marker": "v", "markersize": _FALL_SIZE}
        ax.plot(curve.x[falls], np.where(curve.valid, curve.y, np.nan)[falls], gid=f"{gid}-falling", **fallen)
    if curve.served:
        _mark_media(ax, curve, look, gid)


def _find_outside(valid: NDArray[np.bool_]) -> NDArray[np.bool_]:
    """Return where a medium is not valid, and the ends of these stretches, from which their lines go."""
    outside = ~valid
    outside[1:] |= ~valid[:-1]
    outside[:-1] |= ~valid[1:]
    return outside


def _mark_media(ax: Axes, curve: Curve, look: Look, gid: str) -> None:
    """Mark on the curve of an automatic medium which medium served where: the ends of its loads, and some between."""
    n = curve.x.size
    named = np.array([one.partition("(")[0] for one in curve.served])
    step = max(1, -(-n // _MOST_MARKS))
    change = np.flatnonzero(named[1:] != named[:-1])
    shown = np.isin(np.arange(n), np.concatenate([np.arange(0, n, step), change, change + 1, [n - 1]])) | curve.simulated
    for name in dict.fromkeys(named.tolist()):
        for valid in (True, False):
            there = shown & (named == name) & (curve.valid == valid)
            style: dict[str, Any] = {"color": look.colour, "markersize": _SERVING_SIZE, "linestyle": "none"}
            style |= {} if valid else _HOLLOW
            if np.any(there):
                ax.plot(curve.x[there], curve.y[there], _SERVING.get(name, "o"), gid=f"{gid}-served-{name}", **style)


def label_axes(ax: Axes, curves: Sequence[Curve], x: str, y: str) -> None:
    """Scale the axes for curves of the quantity ``y`` over ``x``, and name them with their units."""
    for which, name, unit in zip("xy", (x, y), curves[0].units, strict=True):
        values = np.concatenate([getattr(curve, which) for curve in curves])
        scale_axis(ax, which, values)
        name_axis(ax, which, values, axis_label(name, ""), unit)


def make_handle(curve: Curve, look: Look, label: str) -> Line2D:
    """Return the entry of a curve in a legend."""
    if curve.as_points and not curve.served:
        return Line2D([], [], color=look.colour, marker=look.marker, label=label, **POINTS)
    dashes: dict[str, Any] = {"dashes": look.dashes} if look.dashes else {}
    return Line2D([], [], color=look.colour, linewidth=min(look.width, 1.6), label=label, **dashes)


def make_outside(points: bool) -> Line2D:
    """Return the entry of the legend for loads at which a medium is not valid."""
    hollow: dict[str, Any] = {"marker": "o"} | POINTS | _HOLLOW
    return Line2D([], [], color="0.3", label="outside its range", **(hollow if points else _OUTSIDE))


def make_serving(curves: Iterable[Curve]) -> list[Line2D]:
    """Return the entries of the legend for the media that automatic ones chose."""
    names = dict.fromkeys(one.partition("(")[0] for curve in curves for one in curve.served)
    style: dict[str, Any] = {"color": "0.3", "markersize": _SERVING_SIZE, "linestyle": "none"}
    return [
        Line2D([], [], marker=_SERVING.get(name, "o"), label=f"{MEDIA.get(name, name)} served", **style)
        for name in sorted(names, key=list(MEDIA).index)
    ]
