"""Figures of the contact forces of a simulated sample or a network: force chains, and the
distribution of forces over sizes and directions.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import partial
from typing import Any, Literal

from granphon.figures.scales import (
    FORCES,
    ROW_HEIGHT,
    add_title,
    name_axis,
    order_balls,
    styled_figure,
)

import numpy as np
from matplotlib.axes import Axes
from matplotlib.cm import ScalarMappable
from matplotlib.collections import EllipseCollection, LineCollection, QuadMesh
from matplotlib.colors import Normalize
from matplotlib.figure import Figure
from matplotlib.patches import Rectangle
from matplotlib.ticker import MaxNLocator
from numpy.typing import NDArray

from granphon.array.sample import Sample
from granphon.balls.lattices import Lattice
from granphon.base.arrays import Array
from granphon.base.errors import InputError, brief
from granphon.base.scales import prefixed
from granphon.base.text import counted
from granphon.base.validation import finite_array, one_of, require_instance
from granphon.figures.style import (
    BLUE,
    GUIDE,
    PAGE_WIDTH,
    POINTS_PER_INCH,
    STYLE,
    VERMILION,
    colour_kinds,
)
from granphon.figures.words import write_unit, write_value
from granphon.media.state import ContactState
from granphon.networks.network import ContactNetwork
from granphon.observables.nonaffine import find_nonaffine
from granphon.phonons.phonopy_atoms import number_kinds

#: colours of balls that move, of balls that do not, and of walls and contacts without force
_BALL = "0.95"
_FIXED_BALL = "0.75"
_WALL = "0.55"
#: colours of balls of several masses, whose kinds are not known
_TINTS = (_BALL, "#cfe3f3", "#f7dcc4", "#d5ead3", "#e4d9ee", "#f3e6b3")
#: largest distance of a ball from the layer that is drawn, in diameters
_LEVEL = 1e-6
#: density of the force: least side of its squares, in diameters, and greatest number along an array
_SQUARE = 4.0
_MOST_SQUARES = 40
#: half of the side of a window that is not given, in diameters
_HALF_WINDOW = 12.0
#: height of the figure of a window, in inches
_WINDOW_HEIGHT = 3.65
#: greatest number of balls in a window that are outlined, and of contacts that are drawn as vectors
_MOST_BALLS = 700
_MOST_VECTORS = 20_000
#: width of the line of a contact that carries the mean force, in diameters, and at most in points
_LINE = 0.15
_WIDEST_LINE = 1.5
#: greatest number of rows of a legend for which a figure is made higher
_MOST_LEGEND_ROWS = 4
#: rounding of a site, in diameters
_ROUNDING = 1e-9
#: distance of the left edge of a layer from its first balls, in diameters
_LEFT_MARGIN = 0.25
#: widths of the bins of a distribution of forces: per rms fluctuation, and the least
_BINS_PER_FLUCTUATION = 4.0
_LEAST_BIN = 1e-12
#: least and greatest number of these bins
_LEAST_BINS = 20
_MOST_BINS = 400
#: number of bins of the directions of contacts, over half a turn
_BINS_OF_DIRECTIONS = 18
#: range of forces over their mean below which the forces differ by rounding only; then the number
#: of bins, and the margin on both sides
_EQUAL_FORCES = 1e-10
_BINS_OF_EQUAL_FORCES = 21
_MARGIN_OF_EQUAL_FORCES = 0.05
#: least and greatest width of a line of a network, in widths of the line of the mean force: a
#: single contact may carry nearly all of the force
_WIDTHS = (0.2, 4.0)
#: what of the contacts may be shown
Show = Literal["auto", "all", "window", "density"]
_SHOWS = ("all", "window", "density", "auto")
#: the greatest length of an array whose contacts are all drawn, in diameters
_MOST_DIAMETERS = 48.0


def plot_forces(
    sample: Sample | ContactNetwork,
    ax: Axes | None = None,
    *,
    show: Show = "auto",
    window: Sequence[float] | None = None,
    color: Any = None,
) -> Axes:
    """Draw the contact forces of a sample or a network: a line from ball to ball, as wide and as
    dark as its force.

    Strong contacts are on top. Forces of a sample are over their mean. Rows of the periodic array
    are moved by whole periods to fill a rectangle. A contact across an edge of the array is drawn
    at both edges, and cut off there. Contacts without force are left out; small samples show their
    balls. Axes are in mean diameters. Balls are drawn at their sites, because displacements are of
    the order of the spread and would not be seen. Of an array in space one layer is drawn, through
    the first ball along a1 and a2; in fcc and hcp this layer is close-packed.

    Forces of a network are in N and the axes in m, with prefixes. Balls have their radii; balls
    that do not move are darker. A contact across the edge of a period ends on both sides where the
    balls touch; a contact with a flat wall ends at a short piece of the wall. Contacts without
    force are thin and grey. A network in space is seen along z. Balls of several kinds have the
    colours of a legend; if the kinds are not known, balls of up to six masses have a tint for each.

    Parameters
    ----------
    show : "all" contacts; the contacts in a "window" of the array; the "density" of the force,
        which is the mean over all contacts in each square of a coarse grid, with or without force;
        or "auto", all contacts of arrays of up to 48 diameters, and the density of larger arrays,
        whose lines would be too thin to be told apart.
    window : the left, lower, right and upper edge of the window, in diameters, or m of a network;
        by default the 24 diameters in the middle. It has no effect if all contacts or the density
        are shown.
    color : what the balls of a network are coloured by; None for their kinds. "force" is the mean
        normal force of the contacts of each ball, "contacts" their number, and "overlap" their mean
        overlap, found from the places of balls; the overlap with a flat wall, which places do not
        show, does not count. "nonaffine" is the length of :func:`~granphon.find_nonaffine` under a
        shear of one, and "spin" the rotation about z under this shear. Or (n,) numbers of your own,
        one for each ball and wall, as those of a mode. A bar says what colours mean: large numbers
        are dark, as large forces of contacts are; if numbers have both signs, those below zero are
        blue and those above zero red.

    If ``ax`` is not given, a new figure, one column wide, is made. Raises
    :class:`~granphon.base.errors.InputError` for another word of ``show`` or ``color``, a color of
    a sample, numbers that are not finite or not one of each ball, "spin" of balls that do not turn
    about z, a ``window`` that is not four edges in order, a window without a ball or a contact, a
    network without a contact whose density is not shown, and an object that is neither a sample nor
    a network; and what :func:`~granphon.find_nonaffine` raises for the colors that need it.
    """
    one_of("show", show, _SHOWS)
    source: Any = sample
    if not isinstance(source, ContactNetwork | Sample):
        mend = "Give a sample, such as state.samples[0], or a gp.ContactNetwork"
        raise InputError(f"{brief(sample)} has no contact forces to draw", mend=mend)
    layer = (
        _find_map_of_sample(sample) if isinstance(sample, Sample) else _find_map_of_network(sample)
    )
    values = None
    if color is not None:
        if isinstance(sample, Sample):
            mend = "Give its network: plot(sample.network, color=...)"
            raise InputError("the balls of a sample have no colours", mend=mend)
        values = _BallValues.of(sample, color).take(layer.indices)
        layer = replace(layer, colours=values.find_colours(), kinds={})
    view = _choose_view(layer, window) if show == "auto" else show
    edges_of_window = _choose_window(layer, window)  # refuses a wrong window in all views
    edges = edges_of_window if view == "window" else layer.edges
    if ax is None:
        is_default_window = view == "window" and window is None
        with styled_figure(_find_height(layer, is_default_window=is_default_window)) as new_figure:
            # the same call with Axes: its style is set by now
            axes = new_figure.subplots()
            return plot_forces(sample, axes, show=view, window=window, color=color)
    remark = ""  # the end of the label of the colours
    artist: LineCollection | QuadMesh
    if view == "density":
        artist, sides = _draw_density(layer, ax, edges)
        remark = f",\nmeans over {_write_sides(layer, sides)}"
    else:
        artist = _draw_chains(layer, ax, edges)
    has_balls = any(collection.get_gid() == "balls" for collection in ax.collections)
    add_title(ax, layer.title, layer.kinds if has_balls else {})
    _set_axes(layer, ax, edges)
    if artist.get_array() is not None:
        _add_bar(layer, ax, artist, remark)
    if values is not None:
        values.add_bar(ax)
    return ax


@dataclass(frozen=True)
class _BallValues:
    """Numbers (n,) by which balls are coloured, with their name and unit, and the scale of the
    colours: a diverging one where numbers have both signs.
    """

    numbers: Array
    name: str
    unit: str

    @classmethod
    def of(cls, network: ContactNetwork, color: Any) -> _BallValues:
        """Return the numbers of a ``color`` of :func:`plot_forces`, one of each ball and wall.

        Raises InputError for another word, and for numbers that are not finite or not one of each;
        and what the functions of :data:`_COLOURED_BY` raise, as :func:`_find_spin`.
        """
        if not isinstance(color, str):
            numbers = finite_array("color", color)
            if numbers.shape != (network.n_balls,):
                fault = f"color has the shape {numbers.shape}"
                raise InputError(fault, mend=f"Give one of each of the {network.n_balls} balls")
            return cls(numbers, "Value", "")
        find_numbers, name, unit = _COLOURED_BY[one_of("color", color, _COLOURED_BY)]
        return cls(find_numbers(network), name, unit)

    def take(self, indices: NDArray[np.intp]) -> _BallValues:
        """Return the numbers (m,) of the balls with these ``indices`` (m,), by which alone the
        scale of the colours is chosen: a flat wall has many contacts, and is not coloured.
        """
        return replace(self, numbers=self.numbers[indices])

    @property
    def mapping(self) -> ScalarMappable:
        """The map from numbers to colours: diverging about zero where numbers have both signs."""
        low = float(np.min(self.numbers))
        high = float(np.max(self.numbers))
        if low < 0.0 < high:
            greatest = max(-low, high)
            return ScalarMappable(Normalize(-greatest, greatest), "RdBu_r")
        # dark where numbers are large, as the colours of forces are
        return ScalarMappable(Normalize(low, high if high > low else low + 1.0), "cividis_r")

    def find_colours(self) -> Any:
        """Return the colours (n,) of the balls, each a tuple of red, green, blue and opacity."""
        colours = np.empty(len(self.numbers), object)
        colours[:] = [tuple(colour) for colour in self.mapping.to_rgba(self.numbers)]
        return colours

    def add_bar(self, ax: Axes) -> None:
        """Add a bar of the colours beside the axes."""
        figure: Any = ax.get_figure()
        bar = figure.colorbar(self.mapping, ax=ax, location="right", aspect=40, pad=0.02).ax
        if self.unit:
            greatest = float(np.max(np.abs(self.numbers)))
            name_axis(bar.yaxis, greatest, self.name, self.unit, is_short=True)
        else:
            bar.set_ylabel(self.name)


def _find_mean_force(network: ContactNetwork) -> Array:
    """Return the mean normal force (n,), N, of the contacts of each ball; zero without contacts."""
    sums, counts = _sum_over_contacts(network.i, network.j, network.normal_force, network.n_balls)
    return sums / np.maximum(counts, 1)


def _find_mean_overlap(network: ContactNetwork) -> Array:
    """Return the mean overlap (n,), m, of the contacts of each ball with other balls; zero without
    such contacts.
    """
    # the overlap with a flat wall, whose centre is infinitely far, does not follow from places
    has_centres = np.isfinite(network.distance)
    i = network.i[has_centres]
    j = network.j[has_centres]
    overlaps = network.radii[i] + network.radii[j] - network.distance[has_centres]
    sums, counts = _sum_over_contacts(i, j, overlaps, network.n_balls)
    return sums / np.maximum(counts, 1)


def _count_contacts(network: ContactNetwork) -> Array:
    """Return the number (n,) of contacts of each ball."""
    _sums, counts = _sum_over_contacts(network.i, network.j, network.normal_force, network.n_balls)
    return counts


def _find_displacement(network: ContactNetwork) -> Array:
    """Return the length (n,), m, of the non-affine displacement of each ball under a shear of
    one.
    """
    return find_nonaffine(network).sizes


def _find_spin(network: ContactNetwork) -> Array:
    """Return the rotation (n,), rad, about z of each ball under a shear of one. InputError if the
    balls do not turn about z, or have no motions under a strain in their plane.
    """
    motions = find_nonaffine(network)  # first: its errors say what balls of a plane need
    if 2 not in network.ball_motions.rotations:
        mend = 'Colour them by "nonaffine", or read the network with friction'
        raise InputError("the balls of the network do not turn about z", mend=mend)
    return motions.rotations[:, 2]


#: what the balls of a network may be coloured by: the function of the numbers, their name and unit
_COLOURED_BY: dict[str, tuple[Callable[[ContactNetwork], Array], str, str]] = {
    "force": (_find_mean_force, "Mean contact force", "N"),
    "overlap": (_find_mean_overlap, "Mean overlap", "m"),
    "contacts": (_count_contacts, "Contacts", ""),
    "nonaffine": (_find_displacement, "Non-affine displacement per shear", "m"),
    "spin": (_find_spin, "Rotation per shear", "rad"),
}


def _find_height(layer: _Map, *, is_default_window: bool) -> float:
    """Return the height, inches, of a figure of a ``layer``, or of the window that is shown by
    default, with a legend of two kinds of balls in each row.
    """
    height = _WINDOW_HEIGHT if is_default_window else layer.height
    rows_of_legend = min(_MOST_LEGEND_ROWS, math.ceil(len(layer.kinds) / 2))
    return height + ROW_HEIGHT * rows_of_legend


def _set_axes(layer: _Map, ax: Axes, edges: tuple[float, ...]) -> None:
    """Limit the axes by the ``edges``, left, lower, right and upper, in the lengths of a ``layer``,
    and name the axes. The axis of y of a single row of balls has its tick at the row alone.
    """
    left, bottom, right, top = edges
    network = layer.network
    ax.set(xlim=(left, right), ylim=(bottom, top), aspect="equal")
    for axis in (ax.xaxis, ax.yaxis):
        axis.set_major_locator(MaxNLocator(5, integer=network is None, steps=[1, 2, 5, 10]))
    if network is None:
        ax.set(xlabel=layer.axes[0], ylabel=layer.axes[1])
    else:
        largest = float(np.max(layer.size))
        # a network on a line has a name along the line alone
        for axis, name in zip((ax.xaxis, ax.yaxis)[: network.dimension], layer.axes, strict=False):
            name_axis(axis, largest, name, "m", is_short=True)
    is_single_row = top - bottom < 2.0 * layer.diameter
    if is_single_row:
        ax.set_yticks([float(np.mean(layer.places[:, 1]))])


def _add_bar(layer: _Map, ax: Axes, artist: LineCollection | QuadMesh, remark: str) -> None:
    """Add a bar of the colours of forces below the axes; its label ends with the ``remark``."""
    figure: Any = ax.get_figure()
    bar = figure.colorbar(artist, ax=ax, location="bottom", aspect=40, pad=0.02).ax
    if layer.network is None:
        bar.set_xlabel(f"Contact force over its mean{remark}")
    else:
        _, greatest_force = bar.get_xlim()
        name_axis(bar.xaxis, greatest_force, "Contact force", "N", is_short=True, more=remark)


def _choose_view(layer: _Map, window: Sequence[float] | None) -> Show:
    """Return what of the contacts is shown for "auto": a ``window`` if one is given, else all
    contacts of a small array, or the density of a large one.
    """
    if window is not None:
        return "window"
    is_small = float(np.max(layer.size)) <= _MOST_DIAMETERS * layer.diameter
    return "all" if is_small else "density"


def _draw_density(layer: _Map, ax: Axes, edges: tuple[float, ...]) -> tuple[QuadMesh, list[float]]:
    """Draw means of the contact forces over squares between these edges, the left, lower, right and
    upper one; return the map, and the two sides of a square, the shorter first, in the unit of the
    layer.

    Each contact enters at both of its balls, with half its weight; the half cancels in the mean. So
    no contact is lost at an edge of a periodic array.
    """
    left, bottom, right, top = edges
    longest = float(np.max(layer.size))
    side = max(_SQUARE * layer.diameter, longest / _MOST_SQUARES)
    n_columns, n_rows = np.maximum(1, np.round(layer.size / side)).astype(int)
    # the edges of the squares along x (n_columns + 1,) and y (n_rows + 1,)
    grid = [np.linspace(left, right, n_columns + 1), np.linspace(bottom, top, n_rows + 1)]
    x, y = layer.places.T
    sum_of_forces, _, _ = np.histogram2d(x, y, grid, weights=layer.sums)
    n_contacts, _, _ = np.histogram2d(x, y, grid, weights=layer.counts)
    with np.errstate(invalid="ignore"):  # a square without a ball has the mean nan
        density = sum_of_forces / n_contacts
    mesh = ax.pcolormesh(*grid, density.T, cmap=FORCES, gid="density", rasterized=True)
    sides = sorted(float(ticks[1] - ticks[0]) for ticks in grid)
    return mesh, sides


def _write_sides(layer: _Map, sides: list[float]) -> str:
    """Return the ``sides`` of the squares of a density, in the unit of the layer, in words."""
    size_of_unit = 1.0
    unit = "$d$"
    if layer.network is not None:
        size_of_unit, unit = prefixed(float(np.max(layer.size)), "m")
    numbers = [f"{side / size_of_unit:.2g}" for side in sides]
    return f"{' x '.join(numbers)} {write_unit(unit)}"


def _choose_window(layer: _Map, window: Sequence[float] | None) -> tuple[float, ...]:
    """Return the left, lower, right and upper edge of a ``window``, or of a window in the middle if
    that is None, in the unit of the layer; InputError if ``window`` has no four edges in order.
    """
    if window is None:
        low, high = np.reshape(layer.edges, (2, 2))
        middle = (low + high) / 2.0
        half = np.minimum((high - low) / 2.0, _HALF_WINDOW * layer.diameter)
        return (*(middle - half).tolist(), *(middle + half).tolist())
    edges = finite_array("window", window)
    are_in_order = edges.shape == (4,) and edges[0] < edges[2] and edges[1] < edges[3]
    if not are_in_order:
        raise InputError(
            f"window is {brief(window)}", mend="Give its left, lower, right and upper edge"
        )
    return tuple(edges.tolist())


def _draw_chains(layer: _Map, ax: Axes, edges: tuple[float, ...]) -> LineCollection:
    """Draw the contacts between these ``edges``, the left, lower, right and upper one, and the
    balls if there are few; return the lines of the contacts. InputError if there is no contact at
    all, and if no ball, or no contact within a diameter, is between the edges.
    """
    lines, forces_of_lines = layer.find_lines()
    if not forces_of_lines.size:
        raise InputError("there is no contact to draw", mend="Give balls that touch")
    low = np.array(edges[:2])
    high = np.array(edges[2:])
    is_near = np.all((lines > low - layer.diameter) & (lines < high + layer.diameter), axis=(1, 2))
    order = np.argsort(forces_of_lines[is_near], kind="stable")  # strong contacts are drawn last
    segments = lines[is_near][order]
    forces = forces_of_lines[is_near][order]
    radii = layer.radii[:, None]
    is_inside = np.all((layer.places + radii > low) & (layer.places - radii < high), axis=1)
    if not np.any(is_inside) or not forces.size:
        unit = "diameters" if layer.network is None else "m"
        thing = "contact" if np.any(is_inside) else "ball"
        problem = f"no {thing} of the array is in the window"
        raise InputError(problem, mend=f"Give edges inside the array, in {unit}")
    if np.count_nonzero(is_inside) <= _MOST_BALLS:
        _draw_balls(layer, is_inside, ax)
    if layer.network is not None:
        _draw_walls(layer.network, ax)
    # many lines are pixels in files of vectors too, which would be slow to show otherwise
    is_raster = len(segments) > _MOST_VECTORS
    chains = LineCollection(list(segments), capstyle="round", gid="forces", rasterized=is_raster)
    width_of_mean_force = min(_LINE * _estimate_diameter(layer, ax, high - low), _WIDEST_LINE)
    chains.set(linewidths=width_of_mean_force * _find_widths(layer.network, forces))
    greatest_force = float(forces[-1])
    if greatest_force > 0.0:
        chains.set(array=forces, cmap=FORCES, norm=Normalize(0.0, greatest_force))
    else:
        chains.set(color=_WALL)
    ax.add_collection(chains, autolim=False)
    return chains


def _estimate_diameter(layer: _Map, ax: Axes, size: Array) -> float:
    """Return the printed size of a mean diameter, in points, where the axes show a part of the
    layer of a ``size`` (2,): an estimate, because the layout is not known yet.
    """
    figure: Any = ax.get_figure()
    points_of_axes = POINTS_PER_INCH * figure.get_size_inches() * ax.get_position().size
    return float(np.min(points_of_axes / size)) * layer.diameter


def _find_widths(network: ContactNetwork | None, forces: Array) -> Array:
    """Return the widths (n,) of the lines of contacts, over that of the mean force, from their
    ``forces`` (n,): those of a sample are over their mean, those of a ``network`` in N. The lines
    of a network have widths within ``_WIDTHS``, and the least if the mean force is not above zero.
    """
    if network is None:
        return forces
    thinnest, widest = _WIDTHS
    mean = float(np.mean(network.normal_force)) if network.n_contacts else 0.0
    if not mean > 0.0:
        return np.full(len(forces), thinnest)
    return np.clip(forces / mean, thinnest, widest)


def _draw_balls(layer: _Map, is_drawn: NDArray[np.bool_], ax: Axes) -> None:
    """Draw the outlines of the balls for which ``is_drawn`` (n,) is true, in their colours."""
    diameters = 2.0 * layer.radii[is_drawn]
    balls = EllipseCollection(
        diameters,
        diameters,
        np.zeros_like(diameters),
        units="xy",
        facecolors=layer.colours[is_drawn].tolist(),
        edgecolors="0.7",
        linewidths=0.4,
        gid="balls",
        offsets=layer.places[is_drawn],
        offset_transform=ax.transData,
    )
    ax.add_collection(balls, autolim=False)


def _draw_walls(network: ContactNetwork, ax: Axes) -> None:
    """Draw a piece of the wall, as long as the ball's radius, at each contact of a ball with a flat
    wall; of a wall that the viewer sees from the front the piece is a point.
    """
    is_flat = np.isinf(network.radii)  # a flat wall is a ball of infinite radius
    is_wall = is_flat[network.j] & ~is_flat[network.i]
    touch = network.contact_places[is_wall, :2]
    normal = network.normal[is_wall, :2]
    along_wall = np.stack([-normal[:, 1], normal[:, 0]], axis=1)
    half = 0.5 * network.radii[network.i[is_wall], None] * along_wall
    pieces = np.stack([touch - half, touch + half], axis=1)
    walls = LineCollection(list(pieces), colors=_WALL, linewidths=1.0, gid="walls")
    ax.add_collection(walls, autolim=False)


@dataclass(frozen=True)
class _Map:
    """Balls and contacts in a plane; lengths are in diameters for a sample, in m for a network.

    Attributes
    ----------
    places, radii, colours : (n, 2), (n,), (n,) of the balls, in the order in which balls are drawn.
    sums, counts : (n,) for each ball the sum of the forces of its contacts, and the number of its
        contacts.
    edges : the left, lower, right and upper edge of the drawing.
    diameter : the mean diameter of the balls.
    height : height of a figure, in inches, in which the drawing is 2.9 inches wide.
    title : the title of the drawing.
    axes : the labels of both axes, without the unit of a network.
    find_lines : returns the lines (m, 2, 2) of the contacts, and their forces (m,).
    network : the network; None for a sample.
    kinds : the colours of kinds of balls, by their names.
    indices : (n,) of these balls among all balls and walls of a network.
    """

    places: Array
    radii: Array
    colours: Any
    sums: Array
    counts: Array
    edges: tuple[float, ...]
    diameter: float
    height: float
    title: str
    axes: tuple[str, str]
    find_lines: Callable[[], tuple[Array, Array]]
    network: ContactNetwork | None = None
    kinds: Mapping[str, str] = field(default_factory=dict)
    indices: NDArray[np.intp] = field(default_factory=lambda: np.zeros(0, np.intp))

    @property
    def size(self) -> Array:
        """Lengths of the sides, (2,)."""
        return np.asarray(np.subtract(self.edges[2:], self.edges[:2]))


def _find_map_of_sample(sample: Sample) -> _Map:
    """Return balls and contacts of the layer of a sample along a1 and a2 through the first ball,
    with L1 cells along a1 and L2 along a2, as they are drawn: in a rectangle whose x axis is along
    a1, lengths in diameters and forces over their mean.
    """
    structure = sample.packing.structure
    p = len(sample.shape)  # number of periods
    n_along, n_across = (*sample.shape, 1)[:2]  # L1, L2
    vectors, axes = _find_layer_axes(structure)
    plane = axes[:2, :p].T  # (p, 2)
    balls, contacts = _choose_in_layer(structure, axes[2, :p])
    length = n_along * float(np.linalg.norm(vectors[0]))
    places = _find_places_in_layer(sample, balls, plane, length)
    i, j = _number_ends(structure, balls, contacts, (n_along, n_across))
    arms = np.tile(structure.contacts.normal[contacts] @ plane, (n_along * n_across, 1))
    forces = _find_forces_in_layer(sample, contacts)
    sums, counts = _sum_over_contacts(i, j, forces, len(places))
    row_height = float(vectors[1] @ axes[1])
    # half a row below the lowest row, whose height is not zero in every cell
    bottom = float(np.min(places[:, 1])) - 0.5 * row_height
    labels = ("$x/d$", "$y/d$")
    if p == 3:
        labels = ("Along $a_1$, in $d$", "Across $a_1$ in the layer, in $d$")
    return _Map(
        places=places,
        radii=np.full(len(places), 0.5),
        colours=np.full(len(places), "none"),
        sums=sums,
        counts=counts,
        edges=(-_LEFT_MARGIN, bottom, length - _LEFT_MARGIN, bottom + row_height * n_across),
        diameter=1.0,
        height=1.15 + float(np.clip(2.5 * n_across / n_along, 1.6, 6.0)),
        title=_write_title(sample),
        axes=labels,
        find_lines=partial(_find_lines_of_layer, places[i], places[j], arms, forces),
    )


def _find_places_in_layer(
    sample: Sample, balls: NDArray[np.intp], plane: Array, length: float
) -> Array:
    """Return the places (m, 2) of the ``balls`` of each cell, indices (n,), in the layer of a
    sample whose axes are the columns of ``plane`` (p, 2), in diameters, cell by cell. Balls are
    moved by whole periods of the ``length`` along the first axis, to between zero and the length.
    """
    p = len(sample.shape)
    n_along, n_across = (*sample.shape, 1)[:2]
    sites = sample.sites.reshape(*sample.shape, -1, p)
    if p == 3:  # the first layer of cells along a3
        sites = sites[:, :, 0]
    places = sites.reshape(n_along, n_across, -1, p)[:, :, balls] @ plane  # (L1, L2, n, 2)
    # a site just below zero by rounding stays there
    places[..., 0] = np.mod(places[..., 0] + _ROUNDING, length) - _ROUNDING
    return np.asarray(places.reshape(-1, 2))


def _find_forces_in_layer(sample: Sample, contacts: NDArray[np.intp]) -> Array:
    """Return the forces (m,) of the ``contacts`` of each cell, indices (n,), in the layer of a
    sample, over the mean force of the sample, cell by cell.
    """
    forces = np.moveaxis(sample.equilibrium.forces, 0, -1)[..., contacts]
    if len(sample.shape) == 3:  # the first layer of cells along a3
        forces = forces[:, :, 0]
    return np.asarray(forces.ravel() / sample.equilibrium.force)


def _find_layer_axes(structure: Lattice) -> tuple[Array, Array]:
    """Return the vectors of the cell, (3, 3), with unit vectors where it does not repeat, and the
    axes of its layer, rows (3, 3): along a1, across a1 in the layer, across the layer.
    """
    p = structure.periods
    vectors = np.eye(3)
    vectors[:p, :p] = structure.vectors
    orthogonal, _ = np.linalg.qr(vectors.T)
    axes = orthogonal.T
    # the signs of a QR factorisation are arbitrary: each axis points along its vector
    axes *= np.sign(np.sum(axes * vectors, axis=1))[:, None]
    return vectors, axes


def _choose_in_layer(
    structure: Lattice, normal: Array
) -> tuple[NDArray[np.intp], NDArray[np.intp]]:
    """Return the indices of the balls of a cell, and of their contacts, in the layer through the
    first ball whose normal is ``normal`` (p,).
    """
    table = structure.contacts
    positions = structure.positions
    is_in_layer = np.abs((positions - positions[0]) @ normal) < _LEVEL
    joins_layer = is_in_layer[table.i] & is_in_layer[table.j]
    is_flat = np.abs(table.normal @ normal) < _LEVEL
    stays_in_cells = np.all(table.shift[:, 2:] == 0, axis=1)  # reaches no other cell along a3
    is_contact_of_layer = joins_layer & is_flat & stays_in_cells
    return np.flatnonzero(is_in_layer), np.flatnonzero(is_contact_of_layer)


def _number_ends(
    structure: Lattice,
    balls: NDArray[np.intp],
    contacts: NDArray[np.intp],
    shape: tuple[int, int],
) -> tuple[NDArray[np.intp], NDArray[np.intp]]:
    """Return the numbers (m,) of the first and of the second ball of each contact in a periodic
    array of ``shape`` (L1, L2) cells. Contacts come cell by cell.

    ``balls`` and ``contacts`` are the indices in a cell of those that are drawn; the drawn balls
    are numbered cell by cell.
    """
    table = structure.contacts
    numbers = np.arange(math.prod(shape) * len(balls)).reshape(*shape, len(balls))
    missing_axes = max(0, 2 - structure.periods)  # a chain has no shift along a2
    shifts = np.pad(table.shift, ((0, 0), (0, missing_axes)))
    i = numbers[..., np.searchsorted(balls, table.i[contacts])]  # (L1, L2, contacts)
    j = np.empty_like(i)
    second_balls = np.searchsorted(balls, table.j[contacts])
    for n, (ball, contact) in enumerate(zip(second_balls, contacts, strict=True)):
        cells_along, cells_across = shifts[contact, :2].tolist()
        # the ball of the cell to which the contact of each cell reaches
        j[..., n] = np.roll(numbers[..., ball], (-cells_along, -cells_across), (0, 1))
    return i.ravel(), j.ravel()


def _find_lines_of_layer(
    first: Array, second: Array, arms: Array, forces: Array
) -> tuple[Array, Array]:
    """Return the lines (n, 2, 2) of contacts under load, and their forces (n,).

    ``first`` and ``second`` are the places of the balls of all contacts, ``arms`` the vectors from
    ball to ball, each (m, 2), in diameters. A contact across an edge of the array has a line at
    each of its two balls.
    """
    images_of_first = second - arms  # where the first ball would be beside the second
    is_loaded = forces > 0.0
    # the image of a ball is the ball itself, or whole periods away from it
    is_across = is_loaded & (np.linalg.norm(images_of_first - first, axis=1) > 0.5)
    starts = np.concatenate([first[is_loaded], images_of_first[is_across]])
    arms_of_lines = np.concatenate([arms[is_loaded], arms[is_across]])
    forces_of_lines = np.concatenate([forces[is_loaded], forces[is_across]])
    lines = np.stack([starts, starts + arms_of_lines], axis=1)
    return lines, forces_of_lines


def _sum_over_contacts(
    i: NDArray[np.intp], j: NDArray[np.intp], values: Array, n_balls: int
) -> tuple[Array, Array]:
    """Return, for each ball, the sum of the values of its contacts, and the number of its contacts,
    both (n_balls,).

    Each of m contacts joins the balls ``i`` and ``j``, (m,), and has one of the ``values`` (m,),
    such as its force.
    """
    balls = np.concatenate([i, j])
    sums = np.bincount(balls, np.concatenate([values, values]), n_balls)
    n_contacts = np.bincount(balls, minlength=n_balls)
    return np.asarray(sums, float), n_contacts.astype(float)


def _find_map_of_network(network: ContactNetwork) -> _Map:
    """Return the balls and contacts of a network, seen along z."""
    sums, counts = _sum_over_contacts(network.i, network.j, network.normal_force, network.n_balls)
    indices = order_balls(network)
    places = network.positions[indices, :2]
    radii = network.radii[indices]
    low = np.min(places - radii[:, None], axis=0)
    high = np.max(places + radii[:, None], axis=0)
    diameter = float(2.0 * np.mean(radii))
    margin = max(0.1 * diameter, 0.02 * float(np.max(high - low)))
    width, height = (high - low + 2.0 * margin).tolist()
    kinds, colours = _colour_balls(network, indices)
    title = f"{counted(len(indices), 'ball')}, {counted(network.n_contacts, 'contact')}"
    if network.dimension == 3:
        title += ", seen along $z$"
    return _Map(
        places=places,
        radii=radii,
        colours=colours,
        sums=sums[indices],
        counts=counts[indices],
        edges=(*(low - margin).tolist(), *(high + margin).tolist()),
        diameter=diameter,
        height=1.3 + float(np.clip(2.75 * height / width, 0.35, 6.0)),
        title=title,
        axes=("$x$", "$y$"),
        find_lines=partial(_find_lines_of_network, network),
        network=network,
        kinds=kinds,
        indices=indices,
    )


def _colour_balls(network: ContactNetwork, indices: NDArray[np.intp]) -> tuple[dict[str, str], Any]:
    """Return the colours of the kinds of balls that move, by name, and the colours (n,) of the
    balls with these ``indices`` (n,). Without kinds, balls of several masses have a tint for
    each mass, by which the colours are named, unless there are more masses than tints.
    """
    is_moving = network.moving[indices]
    colours = np.full(len(indices), _FIXED_BALL, dtype=object)
    names = np.array(network.kinds or [""] * network.n_balls, object)
    colours_of_kinds = colour_kinds(names[network.moving])
    if colours_of_kinds:
        names_of_moving = names[indices][is_moving]
        colours[is_moving] = [colours_of_kinds[name] for name in names_of_moving]
        return colours_of_kinds, colours
    masses = network.masses[indices][is_moving]
    numbers = number_kinds(masses)
    n_masses = len(set(numbers))
    if not 1 < n_masses <= len(_TINTS):
        colours[is_moving] = _BALL
        return {}, colours
    colours[is_moving] = [_TINTS[number] for number in numbers]
    tints_of_masses = {
        write_value(1e3 * mass, "g"): _TINTS[number]
        for mass, number in zip(masses, numbers, strict=True)
    }
    return tints_of_masses, colours


def _find_lines_of_network(network: ContactNetwork) -> tuple[Array, Array]:
    """Return the lines (n, 2, 2) of all contacts of balls, m, and their forces (n,), N.

    The line of a contact across the edge of a period, or with a flat wall, goes from the centre of
    the ball to the point of contact; across an edge each of both balls has such a line.
    """
    i = network.i
    j = network.j
    centres = network.positions
    has_ball = np.isfinite(network.radii[i])  # a contact of two flat walls has no place
    is_wall = np.isinf(network.radii[j])
    is_cut = has_ball & (np.any(network.shift != 0, axis=1) | is_wall)
    whole_lines = np.stack([centres[i], centres[j]], axis=1)
    lines = [whole_lines[has_ball & ~is_cut]]
    forces = [network.normal_force[has_ball & ~is_cut]]
    # the normal of a contact points from its first ball to the second; a wall is always second
    for ball, arm, is_drawn in (
        (i, network.arm_i, is_cut),
        (j, -network.arm_j, is_cut & ~is_wall),
    ):
        touch = centres[ball] + arm[:, None] * network.normal
        lines_to_touch = np.stack([centres[ball], touch], axis=1)
        lines.append(lines_to_touch[is_drawn])
        forces.append(network.normal_force[is_drawn])
    return np.concatenate(lines)[..., :2], np.concatenate(forces)


def _write_title(sample: Sample) -> str:
    """Return the title of a sample, with its fraction of contacts. Equal balls have the force in N,
    others the reduced force f* and the reduced spacing a*.
    """
    equilibrium = sample.equilibrium
    contacts = f"$N_c$ = {sample.contact_fraction():.3f}"
    if not sample.packing.width:
        return f"$f$ = {sample.force:.4g} N, {contacts}"
    # the overlap is in units of the width W, and a* = (d + W/2 - a)/W
    reduced_spacing = equilibrium.overlap + 0.5
    return f"$f^*$ = {equilibrium.force:.3g}, $a^*$ = {reduced_spacing:.4g}, {contacts}"


def _list_samples(state: ContactState) -> tuple[Sample, ...]:
    """Return the samples of a state; InputError for several loads, and for a state that has none,
    as that of a medium with a contact law.
    """
    state.require_single()
    if not state.samples:
        raise InputError(
            "the state has no samples",
            "All of its contacts have one force",
            "Give a state of gp.DirectSimulation",
        )
    return state.samples


def plot_force_distribution(state: ContactState, ax: Axes) -> Axes:
    """Draw the probability density of f/<f> of the contacts that carry load, averaged over the
    samples, on a log scale. The mean force <f> of a sample is that of all its contacts, open ones
    included.

    Bins are a quarter of the rms fluctuation wide, but there are at least 20 and at most 400 of
    them; empty bins at the ends are left out. Raises :class:`~granphon.base.errors.InputError` for
    several loads, and for a state without samples.
    """
    samples = _list_samples(state)
    n_bins, low, high = _choose_bins(samples)
    # all samples have the same bins
    histograms = [sample.force_distribution(n_bins, high, low) for sample in samples]
    edges = histograms[0][0]
    density = np.mean([density_of_sample for _, density_of_sample in histograms], axis=0)
    # empty bins at the ends are left out: a log scale has no zero
    first_bin, last_bin = np.flatnonzero(density)[[0, -1]].tolist()
    shown_density = density[first_bin : last_bin + 1]
    shown_edges = edges[first_bin : last_bin + 2]
    ax.stairs(shown_density, shown_edges, baseline=None, color=BLUE, gid="density")
    ax.axvline(1.0, color=GUIDE, linewidth=0.6, zorder=0.5)
    ax.set(yscale="log", xlabel="Contact force over its mean", ylabel="Probability density")
    return ax


def _choose_bins(samples: Sequence[Sample]) -> tuple[int, float, float]:
    """Return the number of the bins of the distribution of the contact forces of all samples, over
    their means, and the lower edge of the first and the upper edge of the last bin. The edges are
    about half a bin beyond the forces, but not below zero; equal forces have a bin in the middle.
    """
    forces = [sample.equilibrium.forces / sample.equilibrium.force for sample in samples]
    smallest = min(float(np.min(forces_of_sample)) for forces_of_sample in forces)
    largest = max(float(np.max(forces_of_sample)) for forces_of_sample in forces)
    extent = largest - smallest
    fluctuation = float(np.mean([sample.contact_force_fluctuation for sample in samples]))
    width = max(fluctuation / _BINS_PER_FLUCTUATION, _LEAST_BIN)
    n_bins = int(np.clip(extent / width, _LEAST_BINS, _MOST_BINS))
    margin = extent / (2.0 * n_bins)  # half a bin
    if extent < _EQUAL_FORCES:
        n_bins = _BINS_OF_EQUAL_FORCES
        margin = _MARGIN_OF_EQUAL_FORCES
    return n_bins, max(smallest - margin, 0.0), largest + margin


def plot_directions(network: ContactNetwork, ax: Axes | None = None) -> Axes:
    """Draw the angular density of the contacts of a network in a plane, and that in which each
    contact counts as its force, over the density without a preferred direction.

    Dashed lines are the second orders, 1 + a cos 2(theta - theta_0), which the tensors
    ``network.fabric`` and ``network.force_fabric`` give. If ``ax`` is not given, a new figure, one
    column wide, is made. Raises :class:`~granphon.base.errors.InputError` for what is no network,
    and for a network on a line or in space, without contacts, or without forces.
    """
    require_instance("network", network, ContactNetwork, "Give a gp.ContactNetwork")
    if network.dimension != 2:
        fault = f"the balls of the network are in {counted(network.dimension, 'dimension')}"
        raise InputError(fault, "One angle is the direction of a contact in a plane")
    # found before a figure is made, as they raise if there are no contacts or no forces
    tensors = (network.fabric, network.force_fabric)
    if ax is None:
        with styled_figure(2.4) as figure:
            return plot_directions(network, figure.subplots())
    angles = np.degrees(np.arctan2(network.normal[:, 1], network.normal[:, 0])) % 180.0
    edges = np.linspace(0.0, 180.0, _BINS_OF_DIRECTIONS + 1)
    directions = np.linspace(0.0, 180.0, 181)
    units = np.stack([np.cos(np.radians(directions)), np.sin(np.radians(directions))], axis=1)
    weights = (np.ones(network.n_contacts), network.normal_force)
    curves = zip(("contacts", "forces"), (BLUE, VERMILION), weights, tensors, strict=True)
    for name, colour, weight, tensor in curves:
        sums, _edges = np.histogram(angles, edges, weights=weight)
        density = sums * _BINS_OF_DIRECTIONS / np.sum(weight)
        ax.stairs(density, edges, baseline=None, color=colour, label=name)
        # the density 1 + a cos 2(theta - theta_0), over its mean, whose mean <nn> is the tensor T:
        # it is 4 u.T u - 1 in the direction of each unit vector u
        second_order = 4.0 * np.einsum("da,ab,db->d", units, tensor, units) - 1.0
        ax.plot(directions, second_order, color=colour, linestyle="--", linewidth=0.8)
    ax.set(xlim=(0.0, 180.0), xlabel="Direction of contacts (°)", ylabel="Density over its mean")
    ax.set_ylim(bottom=0.0)
    ax.set_xticks(np.arange(0, 181, 45))
    ax.legend()
    return ax


def forces_figure(state: ContactState) -> Figure:
    """Draw a figure of the force chains of the first sample beside the distribution of forces in
    all samples; two columns wide.

    Of a sample longer than 48 diameters the chains in a window of 24 diameters are drawn, and
    before them the density of the force in the whole array, with the window marked.

    See :func:`plot_forces` and :func:`plot_force_distribution`, whose errors are raised.
    """
    sample = _list_samples(state)[0]
    layer = _find_map_of_sample(sample)
    is_large = float(np.max(layer.size)) > _MOST_DIAMETERS
    height = 3.1 if is_large else layer.height
    n_panels = 3 if is_large else 2
    with styled_figure(height, PAGE_WIDTH) as figure:
        *panels, distribution = figure.subplots(1, n_panels)
        if is_large:
            edges = _choose_window(layer, None)
            _draw_array_and_window(sample, panels[0], panels[1], edges)
            figure.suptitle(_write_title(sample), fontsize=STYLE["axes.titlesize"])
        else:
            plot_forces(sample, panels[0], show="all")
        plot_force_distribution(state, distribution)
    return figure


def _draw_array_and_window(
    sample: Sample, ax_of_array: Axes, ax_of_window: Axes, edges: tuple[float, ...]
) -> None:
    """Draw the density of the force in a whole array, with a window marked, on ``ax_of_array``, and
    the chains in the window on ``ax_of_window``.

    ``edges`` are the left, lower, right and upper edge of the window, in diameters.
    """
    left, bottom, right, top = edges
    outline = Rectangle(
        (left, bottom),
        right - left,
        top - bottom,
        fill=False,
        color=VERMILION,
        linewidth=1.0,
        gid="window",
    )
    plot_forces(sample, ax_of_array, show="density")
    ax_of_array.add_patch(outline)
    ax_of_array.set(title="whole array")
    plot_forces(sample, ax_of_window, window=edges)
    ax_of_window.set(title="window", ylabel="")
    for spine in ax_of_window.spines.values():
        spine.set(color=VERMILION, linewidth=1.0)
