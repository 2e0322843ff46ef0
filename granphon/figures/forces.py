"""Figures of the contact forces of a simulated sample: force chains, and the distribution of forces."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

# before matplotlib, whose import this module guards
from granphon.figures.scales import FORCES

# isort: split
import matplotlib
import numpy as np
from matplotlib.axes import Axes
from matplotlib.collections import EllipseCollection, LineCollection
from matplotlib.colors import Normalize
from matplotlib.figure import Figure
from matplotlib.ticker import MaxNLocator
from numpy.typing import NDArray

from granphon.array.sample import Sample
from granphon.figures.style import BLUE, COLUMN_WIDTH, DPI, GUIDE, PAGE_WIDTH, STYLE
from granphon.media.state import ContactState

__all__ = ["forces_figure", "plot_force_distribution", "plot_forces"]

Array = NDArray[np.float64]
#: width of the line of a contact with the mean force, in diameters
_MEAN_WIDTH = 0.15
#: the greatest width of that line, in points
_MOST_POINTS = 1.5
#: difference of forces, over their mean, that is only rounding
_SAME = 1e-10
#: largest distance of a ball from the layer that is drawn, in diameters
_LEVEL = 1e-6
#: the largest sample, in balls, whose balls are outlined
_MOST_OUTLINED = 400


def plot_forces(sample: Sample, ax: Axes | None = None) -> Axes:
    """Draw the contact forces of a sample: a line from site to site, as wide and as dark as f/<f>; strong ones on top.

    Rows of the periodic array are moved by whole periods to fill a rectangle. A contact across its edge is drawn on both
    sides, and cut off there. Contacts that carry nothing are left out; small samples show their balls. Axes are in mean
    diameters. Balls are drawn at their sites, as displacements, of the order of the spread, would not be seen. Of an array
    in space one layer is drawn, through the first ball along a1 and a2; in fcc and hcp it is close-packed.

    If ``ax`` is not given, a new figure, one column wide, is made.
    """
    if ax is None:
        with matplotlib.rc_context(STYLE):
            return plot_forces(
                sample, Figure((COLUMN_WIDTH, _choose_height(sample)), dpi=DPI, layout="constrained").subplots()
            )
    figure: Any = ax.get_figure()
    layer = _Layer.of(sample)
    segments, forces = layer.make_lines()
    # printed size of a diameter, in points, estimated because the layout is not known yet
    points = float(np.min(72.0 * figure.get_size_inches() * ax.get_position().size / layer.size))
    sites = layer.sites
    if sites[..., 0].size <= _MOST_OUTLINED:
        size, style = np.ones(sites[..., 0].size), {"facecolors": "none", "edgecolors": "0.7", "linewidths": 0.4}
        place: dict[str, Any] = {"offsets": sites.reshape(-1, 2), "offset_transform": ax.transData, "gid": "balls"}
        ax.add_collection(EllipseCollection(size, size, 0.0 * size, units="xy", **style, **place), autolim=False)
    chains = LineCollection(list(segments), array=forces, cmap=FORCES, norm=Normalize(0.0, float(forces[-1])), gid="forces")
    chains.set(linewidths=min(_MEAN_WIDTH * points, _MOST_POINTS) * forces, capstyle="round")
    ax.add_collection(chains, autolim=False)
    length, height = layer.size
    # half a row below the lowest, which is not at zero in every cell
    bottom = float(np.min(sites[..., 1])) - 0.5 * layer.step
    ax.set(xlim=(-0.25, length - 0.25), ylim=(bottom, bottom + height), aspect="equal")
    along, across = (
        ("$x/d$", "$y/d$") if len(sample.shape) < 3 else ("Along $a_1$, in $d$", "Across $a_1$ in the layer, in $d$")
    )
    ax.set(xlabel=along, ylabel=across, title=_write_title(sample))
    for axis in (ax.xaxis, ax.yaxis):
        axis.set_major_locator(MaxNLocator(5, integer=True, steps=[1, 2, 5, 10]))
    if height < 2.0:
        ax.set_yticks([0.0])
    figure.colorbar(chains, ax=ax, location="bottom", aspect=40, pad=0.02, label="Contact force over its mean")
    return ax


def _choose_height(sample: Sample) -> float:
    """Return the height of a figure, in inches, in which the array is 2.9 inches wide."""
    rows, columns, *_ = (*sample.shape, 1)
    return 1.15 + float(np.clip(2.5 * columns / rows, 1.6, 6.0))


@dataclass(frozen=True)
class _Layer:
    """The balls of a sample that are drawn, in a plane, with the contacts between them.

    ``sites`` (L1, L2, n, 2) are moved by whole periods of a1 into a rectangle of ``size``, whose rows are ``step`` apart. Of
    each kind of contact ``ends`` are the indices of its balls i and j, ``shifts`` (n_c, 2) the cells between them, ``ways``
    (n_c, 2) the vectors; ``forces`` (L1, L2, n_c) are over their mean.
    """

    sites: Array
    ends: list[tuple[int, int]]
    shifts: list[list[int]]
    ways: Array
    forces: Array
    size: Array
    step: float

    @classmethod
    def of(cls, sample: Sample) -> _Layer:
        structure, p = sample.packing.structure, len(sample.shape)
        rows, columns = (*sample.shape, 1)[:2]
        vectors = np.eye(3)
        vectors[:p, :p] = structure.vectors
        axes = np.linalg.qr(vectors.T)[0].T
        axes *= np.sign(np.sum(axes * vectors, axis=1))[:, None]  # rows: along a1, across it in the layer, across the layer
        plane, up = axes[:2, :p].T, axes[2, :p]
        table, balls = structure.contacts, structure.positions
        level = np.abs((balls - balls[0]) @ up) < _LEVEL
        inside = (
            level[table.i] & level[table.j] & (np.abs(table.normal @ up) < _LEVEL) & np.all(table.shift[:, 2:] == 0, axis=1)
        )
        shown = np.flatnonzero(level).tolist()
        flat = sample.sites.reshape(*sample.shape, -1, p)
        forces = np.moveaxis(sample.equilibrium.forces / sample.equilibrium.force, 0, -1)[..., inside]
        if p == 3:
            flat, forces = flat[:, :, 0], forces[:, :, 0]
        flat, forces = flat.reshape(rows, columns, -1, p), forces.reshape(rows, columns, -1)
        sites = flat[:, :, shown] @ plane
        length, step = rows * float(np.linalg.norm(vectors[0])), float(vectors[1] @ axes[1])
        sites[..., 0] = np.mod(sites[..., 0] + 1e-9, length) - 1e-9
        pairs = zip(table.i[inside].tolist(), table.j[inside].tolist(), strict=True)
        steps = np.pad(table.shift, ((0, 0), (0, max(0, 2 - p))))[inside, :2]
        ends = [(shown.index(i), shown.index(j)) for i, j in pairs]
        ways, size = table.normal[inside] @ plane, np.array([length, step * columns])
        return cls(sites, ends, steps.tolist(), ways, forces, size, step)

    def make_lines(self) -> tuple[Array, Array]:
        """Return lines (n, 2, 2) and forces (n,), ascending, of contacts that carry load.

        A contact across an edge has two lines, one at each of its balls.
        """
        pairs = list(zip(self.ends, self.shifts, strict=True))
        own = np.stack([self.sites[:, :, i] for (i, _), _ in pairs], axis=2)
        others = np.stack([np.roll(self.sites[:, :, j], (-a, -b), (0, 1)) for (_, j), (a, b) in pairs], axis=2)
        way = np.broadcast_to(self.ways, others.shape)
        lines = np.stack([np.stack([own, own + way], axis=-2), np.stack([others - way, others], axis=-2)])
        carries = self.forces > 0.0
        shown = np.stack([carries, carries & (np.linalg.norm(others - own - way, axis=-1) > 0.5)])
        values = np.stack([self.forces, self.forces])[shown]
        order = np.argsort(values, kind="stable")
        return lines[shown][order], values[order]


def _write_title(sample: Sample) -> str:
    """Return the title: f* and a* (for equal balls the force, N), and N_c."""
    state, contacts = sample.equilibrium, f"$N_c$ = {sample.contact_fraction():.3f}"
    if not sample.packing.width:
        return f"$f$ = {sample.force:.4g} N, {contacts}"
    return f"$f^*$ = {state.force:.3g}, $a^*$ = {state.overlap + 0.5:.4g}, {contacts}"


def plot_force_distribution(state: ContactState, ax: Axes) -> Axes:
    """Draw the probability density of f/<f> of the contacts that carry load, averaged over the samples, on a log scale.

    Bins are a quarter of the rms fluctuation wide. Raises :class:`~granphon.base.errors.InputError` for several loads.
    """
    _ = state.scales  # one load only
    forces = [sample.equilibrium.forces / sample.equilibrium.force for sample in state.samples]
    least, largest = min(float(np.min(one)) for one in forces), max(float(np.max(one)) for one in forces)
    width = max(float(np.mean([sample.contact_force_fluctuation for sample in state.samples])) / 4.0, 1e-12)
    bins = int(np.clip((largest - least) / width, 20, 400))
    margin = (largest - least) / (2.0 * bins)
    if largest - least < _SAME:
        bins, margin = 21, 0.05
    found = [sample.force_distribution(bins, largest + margin, max(least - margin, 0.0)) for sample in state.samples]
    edges, density = found[0][0], np.mean([each for _, each in found], axis=0)
    first, last = np.flatnonzero(density)[[0, -1]].tolist()
    ax.stairs(density[first : last + 1], edges[first : last + 2], baseline=None, color=BLUE, gid="density")
    ax.axvline(1.0, color=GUIDE, linewidth=0.6, zorder=0.5)
    ax.set(yscale="log", xlabel="Contact force over its mean", ylabel="Probability density")
    return ax


def forces_figure(state: ContactState) -> Figure:
    """Draw a figure of the force chains of the first sample beside the distribution of forces in all; two columns wide.

    See :func:`plot_forces` and :func:`plot_force_distribution`. Raises :class:`~granphon.base.errors.InputError` for several
    loads.
    """
    _ = state.scales  # one load only
    with matplotlib.rc_context(STYLE):
        figure = Figure(figsize=(PAGE_WIDTH, _choose_height(state.samples[0])), dpi=DPI, layout="constrained")
        left, right = figure.subplots(1, 2)
        plot_forces(state.samples[0], left)
        plot_force_distribution(state, right)
    return figure
