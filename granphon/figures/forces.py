"""Figures of the contact forces of a simulated sample: force chains, and the distribution of forces."""

from __future__ import annotations

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
from granphon.balls.lattices import TRIANGULAR
from granphon.figures.style import BLUE, COLUMN_WIDTH, DPI, GUIDE, PAGE_WIDTH, STYLE
from granphon.media.state import ContactState

__all__ = ["forces_figure", "plot_force_distribution", "plot_forces"]

Array = NDArray[np.float64]
#: width of the line of a contact with the mean force, in diameters
_MEAN_WIDTH = 0.15
#: the greatest width of that line, in points
_MOST_POINTS = 1.5
#: the largest sample, in balls, whose balls are outlined
_MOST_OUTLINED = 400


def plot_forces(sample: Sample, ax: Axes | None = None) -> Axes:
    """Draw the contact forces of a sample: a line from site to site, as wide and as dark as f/<f>; strong ones on top.

    Rows of the periodic array are moved by whole periods to fill a rectangle. A contact across its edge is drawn on both
    sides, and cut off there. Contacts that carry nothing are left out; small samples show their balls. Axes are in mean
    diameters. Balls are drawn at their sites, as displacements, of the order of the spread, would not be seen.

    If ``ax`` is not given, a new figure, one column wide, is made.
    """
    if ax is None:
        with matplotlib.rc_context(STYLE):
            return plot_forces(
                sample, Figure((COLUMN_WIDTH, _choose_height(sample)), dpi=DPI, layout="constrained").subplots()
            )
    figure: Any = ax.get_figure()
    rows, columns = sample.equilibrium.deviations.shape
    sites, step = _place_sites(sample), float(TRIANGULAR.vectors[1, 1])
    segments, forces = _make_lines(sites, np.moveaxis(sample.equilibrium.forces / sample.equilibrium.force, 0, -1))
    # printed size of a diameter, in points, estimated because the layout is not known yet
    points = float(np.min(72.0 * figure.get_size_inches() * ax.get_position().size / [rows, step * columns]))
    if rows * columns <= _MOST_OUTLINED:
        size, style = np.ones(rows * columns), {"facecolors": "none", "edgecolors": "0.7", "linewidths": 0.4}
        place: dict[str, Any] = {"offsets": sites.reshape(-1, 2), "offset_transform": ax.transData, "gid": "balls"}
        ax.add_collection(EllipseCollection(size, size, 0.0 * size, units="xy", **style, **place), autolim=False)
    chains = LineCollection(list(segments), array=forces, cmap=FORCES, norm=Normalize(0.0, float(forces[-1])), gid="forces")
    chains.set(linewidths=min(_MEAN_WIDTH * points, _MOST_POINTS) * forces, capstyle="round")
    ax.add_collection(chains, autolim=False)
    ax.set(xlim=(-0.25, rows - 0.25), ylim=(-0.5 * step, (columns - 0.5) * step), aspect="equal")
    ax.set(xlabel="$x/d$", ylabel="$y/d$", title=_write_title(sample))
    for axis in (ax.xaxis, ax.yaxis):
        axis.set_major_locator(MaxNLocator(5, integer=True, steps=[1, 2, 5, 10]))
    figure.colorbar(chains, ax=ax, location="bottom", aspect=40, pad=0.02, label="Contact force over its mean")
    return ax


def _choose_height(sample: Sample) -> float:
    """Return the height of a figure, in inches, in which the array is 2.9 inches wide."""
    rows, columns = sample.equilibrium.deviations.shape
    return 1.15 + float(np.clip(2.5 * columns / rows, 1.6, 6.0))


def _place_sites(sample: Sample) -> Array:
    """Return the sites (L1, L2, 2), in diameters, moved by whole periods of a1 into a rectangle."""
    sites = sample.sites
    sites[..., 0] = np.mod(sites[..., 0], len(sites))
    return sites


def _make_lines(sites: Array, forces: Array) -> tuple[Array, Array]:
    """Return lines (n, 2, 2) and forces (n,), ascending, of contacts that carry load.

    A contact across an edge has two lines, one at each of its balls.
    """
    table = TRIANGULAR.contacts
    others = np.stack([np.roll(sites, (-p, -q), (0, 1)) for p, q in table.shift.tolist()], axis=2)
    way, own = np.broadcast_to(table.normal, others.shape), np.broadcast_to(sites[:, :, None], others.shape)
    lines = np.stack([np.stack([own, own + way], axis=-2), np.stack([others - way, others], axis=-2)])
    shown = np.stack([forces > 0.0, (forces > 0.0) & (np.linalg.norm(others - own - way, axis=-1) > 0.5)])
    values = np.stack([forces, forces])[shown]
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
    margin = max((largest - least) / bins, 1e-12) / 2.0
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
