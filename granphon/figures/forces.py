"""Figures of the contact forces of a simulated sample or a network: force chains, and the
distribution of forces.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any, Literal

from granphon.figures.scales import FORCES, ROW_HEIGHT, add_title, name_axis, styled_figure

import numpy as np
from matplotlib.axes import Axes
from matplotlib.collections import EllipseCollection, LineCollection, QuadMesh
from matplotlib.colors import Normalize
from matplotlib.figure import Figure
from matplotlib.patches import Rectangle
from matplotlib.ticker import MaxNLocator
from numpy.typing import NDArray

from granphon.array.sample import Sample
from granphon.base.arrays import Array
from granphon.base.errors import InputError, brief
from granphon.base.scales import prefixed
from granphon.base.text import counted
from granphon.base.validation import finite_array, one_of
from granphon.figures.style import BLUE, GUIDE, PAGE_WIDTH, STYLE, VERMILION, colour_kinds
from granphon.media.state import ContactState
from granphon.networks.network import ContactNetwork
from granphon.phonons.phonopy_atoms import number_kinds

#: colours of balls and of those that do not move, and of contacts without force and walls
_BALL = "0.95"
_STILL = "0.75"
_IDLE = "0.55"
#: colours of balls of several masses, whose kinds are not known
_TINTS = (_BALL, "#cfe3f3", "#f7dcc4", "#d5ead3", "#e4d9ee", "#f3e6b3")
#: largest distance of a ball from the layer that is drawn, in diameters
_LEVEL = 1e-6
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
) -> Axes:
    """Draw the contact forces of a sample or a network: a line from ball to ball, as wide and as
    dark as its force.

    Strong contacts are on top. Of a sample the forces are over their mean. Rows of the periodic
    array are moved by whole periods to fill a rectangle. A contact across its edge is drawn on both
    sides, and cut off there. Contacts that carry nothing are left out; small samples show their
    balls. Axes are in mean diameters. Balls are drawn at their sites, as displacements, of the
    order of the spread, would not be seen. Of an array in space one layer is drawn, through the
    first ball along a1 and a2; in fcc and hcp it is close-packed.

    Of a network the forces are in N and the axes in m, with prefixes. Balls have their radii; those
    that do not move are darker. A contact across the edge of a period ends on both sides where the
    balls touch; one with a flat wall ends at a short piece of the wall. Contacts without force are
    thin and grey. A network in space is seen along z. Balls of several kinds have the colours of a
    legend; if kinds are not known, those of each mass have a tint.

    Parameters
    ----------
    show : "all" contacts; those in a "window" of the array; the "density" of the force, which is
        the mean over the contacts in each square of a coarse grid, those that carry nothing among
        them; or "auto", all contacts of arrays of up to 48 diameters, and the density of larger
        ones, whose lines would be too thin to be told apart.
    window : the left, lower, right and upper edge of the window, in diameters, or m of a network;
        by default the 24 diameters in the middle.

    If ``ax`` is not given, a new figure, one column wide, is made. Raises
    :class:`~granphon.base.errors.InputError` for another word, for a window in which there is no
    ball, and for what is neither a sample nor a network.
    """
    one_of("show", show, _SHOWS)
    given: Any = sample
    if not isinstance(given, ContactNetwork | Sample):
        mend = "Give a sample, such as state.samples[0], or a gp.ContactNetwork"
        raise InputError(f"{brief(sample)} has no contact forces to draw", mend=mend)
    network = sample if isinstance(sample, ContactNetwork) else None
    layer = _find_layer(sample) if isinstance(sample, Sample) else _project(sample)
    if show == "auto":
        small = float(np.max(layer.size)) <= _MOST_DIAMETERS * layer.diameter
        show = "window" if window is not None else "all" if small else "density"
    edges = layer.edges if show != "window" else _choose_window(layer, window)
    if ax is None:
        height = layer.height if show != "window" or window is not None else 3.65
        with styled_figure(height + ROW_HEIGHT * min(4, -(-len(layer.kinds) // 2))) as new:
            return plot_forces(sample, new.subplots(), show=show, window=window)
    figure: Any = ax.get_figure()
    drawn: LineCollection | QuadMesh
    left, bottom, right, top = edges
    means = ""
    if show == "density":
        # squares of four diameters or more, forty along the array at most, over which forces are
        # averaged; a contact counts half at each of its balls, so that none is lost at an edge of a
        # periodic array
        side = max(4.0 * layer.diameter, float(np.max(layer.size)) / 40)
        (x, y) = layer.places.T
        numbers = np.maximum(1, np.round(layer.size / side)).astype(int)
        grid = [
            np.linspace(a, b, n + 1)
            for a, b, n in ((left, right, numbers[0]), (bottom, top, numbers[1]))
        ]
        total, count = (
            np.histogram2d(x, y, grid, weights=weights)[0] for weights in (layer.sums, layer.counts)
        )
        with np.errstate(invalid="ignore"):  # nan where no ball is
            density = total / count
        drawn = ax.pcolormesh(*grid, density.T, cmap=FORCES, gid="density", rasterized=True)
        size, name = (1.0, "$d$") if network is None else prefixed(float(np.max(layer.size)), "m")
        sides = sorted(
            {f"{float(coordinates[1] - coordinates[0]) / size:.2g}" for coordinates in grid}
        )
        means = f",\nmeans over {' x '.join(sides * (3 - len(sides)))} {name.replace('u', 'µ')}"
    else:
        drawn = _draw_chains(layer, ax, edges)
    ax.set(xlim=(left, right), ylim=(bottom, top), aspect="equal")
    add_title(
        ax,
        layer.title,
        layer.kinds
        if any(coordinates.get_gid() == "balls" for coordinates in ax.collections)
        else {},
    )
    for axis in (ax.xaxis, ax.yaxis):
        axis.set_major_locator(MaxNLocator(5, integer=network is None, steps=[1, 2, 5, 10]))
    if network is None:
        ax.set(xlabel=layer.axes[0], ylabel=layer.axes[1])
    else:
        for axis, name in zip((ax.xaxis, ax.yaxis)[: network.dimension], layer.axes, strict=False):
            name_axis(axis, float(np.max(layer.size)), name, "m", short=True)
    if top - bottom < 2.0 * layer.diameter:
        ax.set_yticks([0.0])
    if drawn.get_array() is not None:
        bar = figure.colorbar(drawn, ax=ax, location="bottom", aspect=40, pad=0.02).ax
        if network is None:
            bar.set_xlabel(f"Contact force over its mean{means}")
        else:
            name_axis(bar.xaxis, bar.get_xlim()[1], "Contact force", "N", short=True, more=means)
    return ax


def _choose_window(layer: _Map, given: Sequence[float] | None) -> tuple[float, ...]:
    """Return the edges of the window that is given, or of that in the middle; InputError if they
    are no edges.
    """
    if given is None:
        low, high = np.reshape(layer.edges, (2, 2))
        middle = (low + high) / 2.0
        half = np.minimum((high - low) / 2.0, 12.0 * layer.diameter)
        return (*(middle - half).tolist(), *(middle + half).tolist())
    numbers = finite_array("window", given)
    if numbers.shape != (4,) or not (numbers[0] < numbers[2] and numbers[1] < numbers[3]):
        raise InputError(
            f"window is {brief(given)}", mend="Give its left, lower, right and upper edge"
        )
    return tuple(numbers.tolist())


def _draw_chains(layer: _Map, ax: Axes, edges: tuple[float, ...]) -> LineCollection:
    """Draw the contacts between these edges, the left, lower, right and upper one, and their balls
    if there are few.
    """
    figure: Any = ax.get_figure()
    lines, forces = layer.find_lines()
    low = np.array(edges[:2])
    high = np.array(edges[2:])
    near = np.all((lines > low - layer.diameter) & (lines < high + layer.diameter), axis=(1, 2))
    order = np.argsort(forces[near], kind="stable")  # the strong on top
    segments = lines[near][order]
    forces = forces[near][order]
    reach = layer.radii[:, None]
    inside = np.all((layer.places + reach > low) & (layer.places - reach < high), axis=1)
    sites = layer.places[inside]
    sizes = 2.0 * layer.radii[inside]
    colours = layer.colours[inside].tolist()
    if not sites.size or not forces.size:
        mend = f"Give edges inside the array, in {'diameters' if layer.network is None else 'm'}"
        raise InputError("no ball of the array is in the window", mend=mend)
    # printed size of a diameter, in points, estimated because the layout is not known yet
    points = (
        float(np.min(72.0 * figure.get_size_inches() * ax.get_position().size / (high - low)))
        * layer.diameter
    )
    if len(sites) <= 700:  # more are not outlined
        style: dict[str, Any] = {
            "facecolors": colours,
            "edgecolors": "0.7",
            "linewidths": 0.4,
            "gid": "balls",
        }
        offsets = {"offsets": sites, "offset_transform": ax.transData}
        ax.add_collection(
            EllipseCollection(sizes, sizes, 0.0 * sizes, units="xy", **style, **offsets),
            autolim=False,
        )
    widths = forces  # of lines, in those of the mean force
    if (network := layer.network) is not None:
        # widths are a fifth of that of the mean force to four times it: one contact may carry all
        mean = float(np.mean(network.normal_force)) if network.n_contacts else 0.0
        widths = np.clip(forces / mean, 0.2, 4.0) if mean > 0.0 else np.full(len(forces), 0.2)
        # a piece of a flat wall at each contact with it
        is_wall = np.isinf(network.radii[network.j])
        touch = network.contact_places[is_wall, :2]
        normal = network.normal[is_wall, :2]
        across = (
            0.5
            * network.radii[network.i[is_wall], None]
            * np.stack([-normal[:, 1], normal[:, 0]], axis=1)
        )
        pieces = np.stack([touch - across, touch + across], axis=1)
        walls = LineCollection(list(pieces), colors=_IDLE, linewidths=1.0, gid="walls")
        ax.add_collection(walls, autolim=False)
    # more lines are pixels, in files of vectors too
    chains = LineCollection(
        list(segments), capstyle="round", gid="forces", rasterized=len(segments) > 20_000
    )
    # the line of a contact with the mean force is 0.15 diameters wide, or 1.5 points
    chains.set(linewidths=min(0.15 * points, 1.5) * widths)
    if forces[-1] > 0.0:
        chains.set(array=forces, cmap=FORCES, norm=Normalize(0.0, float(forces[-1])))
    else:
        chains.set(color=_IDLE)
    ax.add_collection(chains, autolim=False)
    return chains


@dataclass(frozen=True)
class _Map:
    """What is drawn: balls and contacts in a plane, whose lengths are in diameters for a sample, in
    m for a network.

    Attributes
    ----------
    places, radii, colours : of the balls (n, 2), (n,), in the order in which they are drawn.
    sums, counts : (n,) of each ball the sum of the forces of its contacts, and the number of these.
    edges : the left, lower, right and upper edge of all that is drawn.
    diameter : the mean diameter of the balls.
    height : that of a figure, in inches, in which all is 2.9 inches wide.
    axes : the labels of both axes, without the unit of a network.
    find_lines : returns the lines (m, 2, 2) of the contacts, and their forces (m,).
    network : the network, if it is one.
    kinds : the colours of kinds of balls, by their names.
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

    @property
    def size(self) -> Array:
        """Lengths of the sides, (2,)."""
        return np.asarray(np.subtract(self.edges[2:], self.edges[:2]))


def _find_layer(sample: Sample) -> _Map:
    structure = sample.packing.structure
    p = len(sample.shape)
    rows, columns = (*sample.shape, 1)[:2]
    vectors = np.eye(3)
    vectors[:p, :p] = structure.vectors
    axes = np.linalg.qr(vectors.T)[0].T
    # rows: along a1, across it in the layer, across the layer
    axes *= np.sign(np.sum(axes * vectors, axis=1))[:, None]
    plane = axes[:2, :p].T
    layer_normal = axes[2, :p]
    table = structure.contacts
    balls = structure.positions
    is_in_layer = np.abs((balls - balls[0]) @ layer_normal) < _LEVEL
    is_contact_in_layer = (
        is_in_layer[table.i]
        & is_in_layer[table.j]
        & (np.abs(table.normal @ layer_normal) < _LEVEL)
        & np.all(table.shift[:, 2:] == 0, axis=1)
    )
    shown = np.flatnonzero(is_in_layer)
    flat = sample.sites.reshape(*sample.shape, -1, p)
    forces = np.moveaxis(sample.equilibrium.forces / sample.equilibrium.force, 0, -1)[
        ..., is_contact_in_layer
    ]
    if p == 3:
        flat = flat[:, :, 0]
        forces = forces[:, :, 0]
    # (L1, L2, n, 2) of the balls, moved by whole periods of a1 into a rectangle, and (L1, L2, n_c)
    # over the mean
    flat, forces = flat.reshape(rows, columns, -1, p), forces.reshape(rows, columns, -1)
    sites = flat[:, :, shown] @ plane
    length = rows * float(np.linalg.norm(vectors[0]))
    row_height = float(vectors[1] @ axes[1])
    sites[..., 0] = np.mod(sites[..., 0] + 1e-9, length) - 1e-9
    places = sites.reshape(-1, 2)
    # of each contact the vector, the numbers of its balls, and its force
    number = np.arange(len(places)).reshape(sites.shape[:3])
    shifts = np.pad(table.shift, ((0, 0), (0, max(0, 2 - p))))
    ball_i, ball_j = (
        np.searchsorted(shown, end[is_contact_in_layer]) for end in (table.i, table.j)
    )
    i = number[..., ball_i].ravel()
    steps = zip(ball_j.tolist(), shifts[is_contact_in_layer, :2].tolist(), strict=True)
    j = np.stack(
        [np.roll(number[..., ball], (-a, -b), (0, 1)) for ball, (a, b) in steps], axis=-1
    ).ravel()
    ways, force = (
        np.tile(table.normal[is_contact_in_layer] @ plane, (rows * columns, 1)),
        forces.ravel(),
    )

    def find_lines() -> tuple[Array, Array]:
        # of the contacts that carry load: one across an edge of the array has two lines, one at
        # each of its balls
        ends = places[i], places[j] - ways
        across = np.linalg.norm(ends[1] - ends[0], axis=1) > 0.5
        start, there = np.concatenate(ends), np.concatenate([force > 0.0, (force > 0.0) & across])
        way, double = np.concatenate([ways, ways]), np.concatenate([force, force])
        return np.stack([start, start + way], axis=1)[there], double[there]

    # half a row below the lowest, which is not at zero in every cell
    bottom = float(np.min(places[:, 1])) - 0.5 * row_height
    return _Map(
        places,
        np.full(len(places), 0.5),
        np.full(len(places), "none"),
        *_sum_forces(i, j, force, len(places)),
        (-0.25, bottom, length - 0.25, bottom + row_height * columns),
        1.0,
        1.15 + float(np.clip(2.5 * columns / rows, 1.6, 6.0)),
        _write_title(sample),
        ("$x/d$", "$y/d$")
        if p < 3
        else ("Along $a_1$, in $d$", "Across $a_1$ in the layer, in $d$"),
        find_lines,
    )


def _sum_forces(
    i: NDArray[np.intp], j: NDArray[np.intp], force: Array, count: int
) -> tuple[Array, Array]:
    ends = np.concatenate([i, j])
    sums = np.bincount(ends, np.concatenate([force, force]), count)
    return np.asarray(sums, float), np.bincount(ends, minlength=count).astype(float)


def _project(network: ContactNetwork) -> _Map:
    sums, counts = _sum_forces(network.i, network.j, network.normal_force, network.n_balls)
    # balls, and no flat walls; the lowest come first
    shown = np.flatnonzero(np.isfinite(network.radii))
    shown = shown[np.argsort(network.positions[shown, 2], kind="stable")]
    places = network.positions[shown, :2]
    radii = network.radii[shown]
    low = np.min(places - radii[:, None], axis=0)
    high = np.max(places + radii[:, None], axis=0)
    diameter = float(2.0 * np.mean(radii))
    margin = max(0.1 * diameter, 0.02 * float(np.max(high - low)))
    width, tall = (high - low + 2.0 * margin).tolist()
    # balls of each kind have a colour; of each mass a tint, if there are few masses
    moving = network.moving[shown]
    colours = np.full(len(shown), _STILL, dtype=object)
    kind_names = np.array(network.kinds or [""] * network.n_balls, object)
    if kinds := colour_kinds(kind_names[network.moving]):
        colours[moving] = [kinds[name] for name in kind_names[shown][moving]]
    else:
        colours[moving] = [
            _TINTS[kind % len(_TINTS)] for kind in number_kinds(network.masses[shown][moving])
        ]
    along = ", seen along $z$" if network.dimension == 3 else ""

    def find_lines() -> tuple[Array, Array]:
        # of all contacts: one across the edge of a period, or with a flat wall, ends where its
        # balls touch
        i = network.i
        j = network.j
        centres = network.positions
        flat = np.isinf(network.radii[j])
        apart = np.any(network.shift != 0, axis=1) | flat
        lines = [np.stack([centres[i], centres[j]], axis=1)[~apart]]
        forces = [network.normal_force[~apart]]
        for end, arm, is_cut in ((i, network.arm_i, apart), (j, -network.arm_j, apart & ~flat)):
            lines.append(
                np.stack([centres[end], centres[end] + arm[:, None] * network.normal], axis=1)[
                    is_cut
                ]
            )
            forces.append(network.normal_force[is_cut])
        return np.concatenate(lines)[..., :2], np.concatenate(forces)

    return _Map(
        places,
        radii,
        colours,
        sums[shown],
        counts[shown],
        (*(low - margin).tolist(), *(high + margin).tolist()),
        diameter,
        1.3 + float(np.clip(2.75 * tall / width, 0.35, 6.0)),
        f"{counted(len(shown), 'ball')}, {counted(network.n_contacts, 'contact')}{along}",
        ("$x$", "$y$"),
        find_lines,
        network,
        kinds,
    )


def _write_title(sample: Sample) -> str:
    state = sample.equilibrium
    contacts = f"$N_c$ = {sample.contact_fraction():.3f}"
    if not sample.packing.width:
        return f"$f$ = {sample.force:.4g} N, {contacts}"
    return f"$f^*$ = {state.force:.3g}, $a^*$ = {state.overlap + 0.5:.4g}, {contacts}"


def plot_force_distribution(state: ContactState, ax: Axes) -> Axes:
    """Draw the probability density of f/<f> of the contacts that carry load, averaged over the
    samples, on a log scale.

    Bins are a quarter of the rms fluctuation wide. Raises :class:`~granphon.base.errors.InputError`
    for several loads.
    """
    _ = state.scales  # one load only
    forces = [sample.equilibrium.forces / sample.equilibrium.force for sample in state.samples]
    least = min(float(np.min(forces_of_sample)) for forces_of_sample in forces)
    largest = max(float(np.max(forces_of_sample)) for forces_of_sample in forces)
    width = max(
        float(np.mean([sample.contact_force_fluctuation for sample in state.samples])) / 4.0, 1e-12
    )
    bins = int(np.clip((largest - least) / width, 20, 400))
    margin = (largest - least) / (2.0 * bins)
    if largest - least < 1e-10:  # this is only rounding
        bins = 21
        margin = 0.05
    histograms = [
        sample.force_distribution(bins, largest + margin, max(least - margin, 0.0))
        for sample in state.samples
    ]
    edges = histograms[0][0]
    density = np.mean([each for _, each in histograms], axis=0)
    first, last = np.flatnonzero(density)[[0, -1]].tolist()
    ax.stairs(
        density[first : last + 1], edges[first : last + 2], baseline=None, color=BLUE, gid="density"
    )
    ax.axvline(1.0, color=GUIDE, linewidth=0.6, zorder=0.5)
    ax.set(yscale="log", xlabel="Contact force over its mean", ylabel="Probability density")
    return ax


def forces_figure(state: ContactState) -> Figure:
    """Draw a figure of the force chains of the first sample beside the distribution of forces in
    all; two columns wide.

    Of a sample longer than 48 diameters, the chains are those of a window of 24, and the density of
    the force in the whole array stands before them, with the window marked.

    See :func:`plot_forces` and :func:`plot_force_distribution`. Raises
    :class:`~granphon.base.errors.InputError` for several loads.
    """
    _ = state.scales  # one load only
    sample = state.samples[0]
    layer = _find_layer(sample)
    large = float(np.max(layer.size)) > _MOST_DIAMETERS
    with styled_figure(3.1 if large else layer.height, PAGE_WIDTH) as figure:
        *arrays, last = figure.subplots(1, 2 + large)
        if large:
            edges = _choose_window(layer, None)
            plot_forces(sample, arrays[0], show="density")
            left, bottom, right, top = edges
            marked: dict[str, Any] = {
                "fill": False,
                "color": VERMILION,
                "linewidth": 1.0,
                "gid": "window",
            }
            arrays[0].add_patch(Rectangle((left, bottom), right - left, top - bottom, **marked))
            plot_forces(sample, arrays[1], window=edges)
            arrays[0].set(title="whole array")
            arrays[1].set(title="window", ylabel="")
            figure.suptitle(_write_title(sample), fontsize=STYLE["axes.titlesize"])
            for spine in arrays[1].spines.values():
                spine.set(color=VERMILION, linewidth=1.0)
        else:
            plot_forces(sample, arrays[0], show="all")
        plot_force_distribution(state, last)
    return figure
