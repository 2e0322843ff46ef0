"""Figures of results: bands, Brillouin zones, densities of states, modes.

Every function draws on an Axes and returns it; units change only here. matplotlib's global state is left alone and no window
is needed: :func:`bands_figure` makes a plain ``matplotlib.figure.Figure``, which :func:`save_figure` saves. Translation is
dark blue and rotation orange throughout, on a scale that is uniform to the eye, in grey as well.
"""

from __future__ import annotations

import re
from fractions import Fraction
from typing import TYPE_CHECKING, Any

from granphon.base.arguments import real_array

# before matplotlib, whose door it is
from granphon.figures.scales import POLARISATION, ROTATION

# isort: split
import matplotlib
import numpy as np
from matplotlib import patheffects
from matplotlib.axes import Axes
from matplotlib.cm import ScalarMappable
from matplotlib.collections import LineCollection, PatchCollection, PolyCollection
from matplotlib.colors import Normalize
from matplotlib.figure import Figure
from matplotlib.patches import Circle, Polygon
from matplotlib.ticker import MaxNLocator
from numpy.typing import ArrayLike, NDArray

from granphon.base.errors import InputError, message
from granphon.base.scales import HertzPrefix
from granphon.dynamics.modes import ContactLattice
from granphon.figures.style import STYLE, save_figure
from granphon.observables.velocities import SoundVelocities
from granphon.phonons.bands import Bands
from granphon.phonons.dos import DensityOfStates

if TYPE_CHECKING:
    from granphon.phonons.phonons import Phonons

__all__ = [
    "STYLE", "bands_figure", "plot_asymptotes", "plot_bands", "plot_dos", "plot_mode", "plot_zone", "save_figure",
    "zone_polygon",
]  # fmt: skip

Array = NDArray[np.float64]
LongWaves = SoundVelocities | ContactLattice

_TRANSLATING, _ROTATING = ROTATION(0.0), ROTATION(1.0)
#: turning against and with the clock
_SPINS = ("#D55E00", "#0072B2")
_LINE, _GREY = 1.5, "0.75"
#: frequencies nearer than this part of the top one are one line on paper
_COINCIDENT = 1e-6
#: longest displacement, in diameters; spins are drawn on the same scale
_LARGEST = 0.4
_MARK = np.pi / 2.0  # angle of the mark of a ball at rest


def plot_bands(
    bands: Bands, ax: Axes, *, asymptotes: LongWaves | None = None, unit: HertzPrefix | None = None, colorbar: bool = True
) -> Axes:
    """Draw bands, each branch followed through its crossings and coloured by its rotational fraction.

    A LineCollection for each segment of the path and each branch: piece i runs through point i of the segment, and its
    colour is that of the point. Where branches coincide the lower one is drawn wider, so that all remain visible. Without
    friction nothing rotates: the colour is then the longitudinal fraction.

    Parameters
    ----------
    asymptotes : draw the long waves too, see :func:`plot_asymptotes`.
    unit : of frequency; by default the decimal unit of hertz in which the top frequency lies between 1 and 1000.
    colorbar : whether to draw the colour bar, above the axes.
    """
    unit = _unit_of(bands) if unit is None else unit
    rotates = bands.n_branches == 3 * len(bands.masses)
    part, colours, words = (
        (bands.rotational_fraction, ROTATION, "Rotational") if rotates
        else (bands.longitudinal_fraction, POLARISATION, "Longitudinal")
    )  # fmt: skip
    values, scale = bands.connected_frequencies / unit.hertz, Normalize(0.0, 1.0)
    fraction = np.take_along_axis(part, bands.connection, 2)
    for s, x in enumerate(bands.distances):
        widths = _widths(values[s], _COINCIDENT * values.max())
        for b in range(bands.n_branches):
            pieces = list(_pieces(x, values[s, :, b]))
            shades: dict[str, Any] = {"array": fraction[s, :, b], "cmap": colours, "norm": scale}
            lines = LineCollection(pieces, linewidths=widths[:, b], capstyle="round", gid=f"band-{s}-{b}", **shades)
            ax.add_collection(lines, autolim=False)
    corners = np.append(bands.distances[:, 0], bands.distances[-1, -1])
    for x in corners[1:-1]:
        ax.axvline(float(x), color=_GREY, linewidth=0.5, zorder=0.5)
    ax.axhline(0.0, color=_GREY, linewidth=0.5, zorder=0.5)
    slant: dict[str, Any] = {"rotation": 30, "ha": "right"} if max(map(len, bands.labels)) > 5 else {}
    ax.set_xticks(corners, list(map(_name, bands.labels)), **slant)
    ax.tick_params(axis="x", length=0)
    ax.set(xlabel="Wave vector", ylabel=f"Frequency ({_unit_name(unit)})")
    ax.set(xlim=corners[[0, -1]], ylim=(-0.02 * values.max(), 1.05 * values.max()))
    if asymptotes is not None:
        plot_asymptotes(bands, asymptotes, ax, unit=unit)
    if colorbar:
        figure: Any = ax.get_figure()
        bar = figure.colorbar(ScalarMappable(scale, colours), ax=ax, location="top", aspect=40, pad=0.02)
        bar.set_ticks([0.0, 0.5, 1.0], labels=["0", "0.5", "1"])
        bar.set_label(f"{words} part of the kinetic energy")
    return ax


def _unit_of(result: Bands | DensityOfStates) -> HertzPrefix:
    """The decimal unit of hertz for the top frequency of the result."""
    there = result.frequencies if isinstance(result, Bands) else result.frequencies[result.total > 0.0]
    return HertzPrefix.for_top(float(there.max()))


def _unit_name(unit: HertzPrefix) -> str:
    return unit.name.replace("uHz", "µHz")


def _name(label: str) -> str:
    """The label as it is printed: Γ for G, an index lowered."""
    parts = [re.sub(r"^([A-Z])(\d+)$", r"$\\mathrm{\1}_{\2}$", part) for part in label.split("|")]
    return "|".join("Γ" if part in ("G", "GAMMA", "Gamma") else part for part in parts)


def _pieces(x: Array, y: Array) -> Array:
    """(p, 3, 2): the line through the points, cut half way between them; the middle vertex of each piece is its point."""
    points = np.stack([x, y], axis=1)
    middle = 0.5 * (points[:-1] + points[1:])
    return np.stack([np.vstack([points[:1], middle]), points, np.vstack([middle, points[-1:]])], axis=1)


def _widths(values: Array, tolerance: float) -> Array:
    """(p, b) line widths: wider by a step for each later branch that coincides here and at a neighbouring point."""
    close = np.abs(values[:, :, None] - values[:, None, :]) <= tolerance
    both = np.pad(close[1:] & close[:-1], ((1, 1), (0, 0), (0, 0)))
    later = np.triu(both[1:] | both[:-1], 1).sum(axis=2)
    return np.asarray(_LINE * (1.0 + np.minimum(later, 3)))


def plot_asymptotes(
    bands: Bands, velocities: LongWaves, ax: Axes, *, unit: HertzPrefix | None = None, reach: float = 0.5
) -> Axes:
    """Draw the long waves near Gamma, dashed: omega = v q, and the optical branch omega^2 = omega_0^2 (1 - c q^2).

    ``velocities`` of sound, the same in every direction, at one load (:class:`~granphon.base.errors.InputError` for
    several); or the lattice itself (``Phonons.lattice``), which knows them for each direction, and its rotational branch if
    there is one ball in the cell. ``unit`` as in :func:`plot_bands`; ``reach`` in parts of the segment that starts or ends
    at Gamma.
    """
    unit = _unit_of(bands) if unit is None else unit
    if isinstance(velocities, SoundVelocities) and np.ndim(velocities.longitudinal):
        raise InputError(message("the velocities are those of several loads", mend="Give those of the load of the bands"))
    scales, label = bands.scales, "long waves"
    for s, near, far in ((s, *ends) for s in range(len(bands.qpoints)) for ends in ((0, -1), (-1, 0))):
        start = bands.qpoints[s, near]
        if not np.allclose(start, np.round(start), rtol=0.0, atol=1e-9):
            continue
        way = (bands.qpoints[s, far] - start)[:2] @ _reciprocal(bands)
        q = 2.0 * np.pi * reach * np.linalg.norm(way) * np.linspace(0.0, 1.0, 101)  # 1/d
        if isinstance(velocities, SoundVelocities):
            speeds = np.array([velocities.longitudinal, velocities.transverse]) / scales.velocity
        else:
            speeds = velocities.sound_velocities(way)[0]
        waves = {"longitudinal": speeds[0] * q, "transverse": speeds[1] * q}
        if isinstance(velocities, ContactLattice) and velocities.rotates and velocities.n_balls == 1:
            squared, curvature = velocities.optical_branch(way)
            inside = 1.0 - curvature * q**2
            waves["optical"] = np.sqrt(squared * np.where(inside >= 0.0, inside, np.nan))
        x = bands.distances[s, near] + np.sign(bands.distances[s, far] - bands.distances[s, near]) * q / (2.0 * np.pi)
        for name, y in waves.items():
            style: dict[str, Any] = {"color": "black", "linewidth": 0.8, "dashes": (3.5, 1.8), "zorder": 3.0}
            ax.plot(x, y * scales.frequency / unit.hertz, **style, label=label, gid=f"asymptote-{name}-{s}")
            label = "_"
    return ax


def _reciprocal(bands: Bands) -> Array:
    """(2, 2): reciprocal vectors as rows, 2 pi/d."""
    return np.asarray(np.linalg.inv(bands.cell[:2, :2]).T)


def zone_polygon(reciprocal: ArrayLike) -> Array:
    """Corners (n, 2) of the Brillouin zone, the Wigner-Seitz cell of the rows of ``reciprocal`` (2, 2), anticlockwise."""
    # here: a figure without a zone does not need it
    from ase.geometry.minkowski_reduction import minkowski_reduce

    cell = np.eye(3)
    cell[:2, :2] = reciprocal
    a, b = short = minkowski_reduce(cell, pbc=[True, True, False])[0][:2, :2]
    b = -b if a @ b > 0.0 else b
    # the neighbours of the origin in turn, at blunt angles or none; a corner is as far from two of them as from it
    g = np.array([a, a + b, b, -a, -a - b, -b])
    both = np.stack([g, np.roll(g, -1, axis=0)], axis=1)
    found = np.linalg.solve(both, 0.5 * np.sum(both**2, axis=2)[..., None])[..., 0]
    found = found[np.argsort(np.arctan2(found[:, 1], found[:, 0]))]
    apart = np.linalg.norm(found - np.roll(found, 1, axis=0), axis=1) > 1e-6 * np.linalg.norm(short)
    return np.asarray(found[apart])


def plot_zone(bands: Bands, ax: Axes) -> Axes:
    """Draw the Brillouin zone of the bands' cell, with the path and the names of its corners; axes in 2 pi/d, hidden."""
    reciprocal = _reciprocal(bands)
    corners = zone_polygon(reciprocal)
    ax.add_patch(Polygon(corners, closed=True, facecolor="white", edgecolor="0.3", linewidth=0.7, gid="zone"))
    ends = bands.qpoints[:, [0, -1], :2] @ reciprocal
    ax.add_collection(LineCollection(list(ends), colors="black", linewidths=1.2, gid="path"), autolim=False)
    names = {_name(bands.labels[s + e].split("|")[e - 1]): ends[s, e] for s in range(len(ends)) for e in (0, 1)}
    for name, place in names.items():
        ax.plot(*place, "o", color="black", markersize=2.2)
        away = place if np.linalg.norm(place) > 1e-9 else -ends.reshape(-1, 2).mean(axis=0)
        if not name.startswith("("):
            ax.annotate(
                name, place, 7.0 * away / max(float(np.linalg.norm(away)), 1e-9), textcoords="offset points", ha="center",
                va="center", path_effects=[patheffects.withStroke(linewidth=1.5, foreground="white")],
            )  # fmt: skip
    points = np.vstack([corners, *ends])
    low, high = points.min(axis=0), points.max(axis=0)
    _frame(ax, low - 0.2 * np.max(high - low), high + 0.2 * np.max(high - low))
    return ax


def _frame(ax: Axes, low: Array, high: Array) -> None:
    ax.set(xlim=(low[0], high[0]), ylim=(low[1], high[1]), aspect="equal")
    ax.set_axis_off()


def plot_dos(dos: DensityOfStates, ax: Axes, *, horizontal: bool = True, unit: HertzPrefix | None = None) -> Axes:
    """Draw the density of states per ball: its translational and rotational part filled, the total as a line.

    ``horizontal``: density to the right and frequency upwards, to stand beside bands; otherwise the other way round.
    ``unit`` of frequency as in :func:`plot_bands`. The lines are labelled for a legend. The axis of frequency has no label
    where it shares that of a neighbour, as in ``subplots(1, 2, sharey=True)``.
    """
    unit = _unit_of(dos) if unit is None else unit
    frequency, fill = dos.frequencies / unit.hertz, ax.fill_betweenx if horizontal else ax.fill_between
    parts = {"translation": (dos.translational, _TRANSLATING), "rotation": (dos.rotational, _ROTATING)}
    curves = {**(parts if np.any(dos.rotational > 0.0) else {}), "total": (dos.total, "black")}
    for name, (per_hertz, colour) in curves.items():
        density = per_hertz * unit.hertz
        if name != "total":
            fill(frequency, density, color=colour, alpha=0.25, linewidth=0.0)
        pair = (density, frequency) if horizontal else (frequency, density)
        ax.plot(*pair, color=colour, linewidth=0.7 if name == "total" else 1.0, label=name)
    along, across = ("y", "x") if horizontal else ("x", "y")
    name, gap = _unit_name(unit), "\n" if horizontal else " "
    numbered = getattr(ax, f"{along}axis").get_tick_params().get("labelleft" if horizontal else "labelbottom", True)
    ax.set(**{f"{along}label": f"Frequency ({name})" if numbered else "", f"{across}label": f"DOS per ball{gap}(1/{name})"})
    ax.set(**{f"{along}lim": (0.0, frequency[-1]), f"{across}lim": (0.0, 1.05 * float(dos.total.max()) * unit.hertz)})
    axis = ax.xaxis if horizontal else ax.yaxis
    axis.set_major_locator(MaxNLocator("auto" if horizontal else 5, steps=[1, 2, 5, 10]))
    axis.set_major_formatter(lambda value, _: f"{value:g}")  # narrow: 0, not 0.00
    return ax


def bands_figure(
    bands: Bands | None = None,
    dos: DensityOfStates | None = None,
    *,
    asymptotes: LongWaves | None = None,
    title: str | None = None,
) -> Figure:
    """Bands with the Brillouin zone inset, and the density of states beside them on the same frequency axis.

    One column wide. Either may be left out; ``asymptotes`` as in :func:`plot_asymptotes`. Raises
    :class:`~granphon.base.errors.InputError` if both are left out.
    """
    first = dos if bands is None else bands
    if first is None:
        raise InputError(message("there is nothing to draw", mend="Give bands, a density of states, or both"))
    unit, both = _unit_of(first), bands is not None and dos is not None
    with matplotlib.rc_context(STYLE):
        figure = Figure(figsize=(3.4, 2.4 if bands is None else 3.1), dpi=300, layout="constrained")
        axes = figure.subplots(1, 1 + both, sharey=both, width_ratios=[2.4, 1.0][: 1 + both], squeeze=False)[0]
        if dos is not None:
            plot_dos(dos, axes[-1], horizontal=bands is not None, unit=unit)
        if bands is not None:
            plot_bands(bands, axes[0], asymptotes=asymptotes, unit=unit)
            inset = axes[0].inset_axes(_free_place(axes[0]))
            inset.set_in_layout(False)
            plot_zone(bands, inset)
        if both:
            axes[1].axhline(0.0, color=_GREY, linewidth=0.5, zorder=0.5)
        entries = {name: h for ax in axes[::-1] for h, name in zip(*ax.get_legend_handles_labels(), strict=True)}
        if set(entries) - {"total"}:
            figure.legend(entries.values(), entries.keys(), loc="outside lower center", ncols=4, columnspacing=1.2)
        figure.suptitle(title or "")
    return figure


def _free_place(ax: Axes) -> tuple[float, float, float, float]:
    """x, y, width, height, in parts of the axes, of a square clear of every line; the axes grow upwards if none is."""
    curves = [np.asarray(c.get_segments())[:, 1] for c in ax.collections if isinstance(c, LineCollection)]
    curves += [np.column_stack(line.get_data())[:-1] for line in ax.lines if str(line.get_gid()).startswith("asymptote")]
    (left, right), (bottom, top) = ax.get_xlim(), ax.get_ylim()
    points = (np.concatenate(curves) - [left, bottom]) / [right - left, top - bottom]
    points = points[np.all(np.isfinite(points), axis=1)]
    for size in (0.3, 0.25):
        corners = 0.05 + (0.9 - size) * np.stack(np.meshgrid(*[np.linspace(0.0, 1.0, 31)] * 2), axis=-1).reshape(-1, 2)
        away = [np.abs(points - corner - size / 2.0).max(axis=1).min() - size / 2.0 for corner in corners]
        if max(away) > 0.01:
            x, y = corners[int(np.argmax(np.minimum(away, 0.06)))].tolist()
            return x, y, size, size
    # at the top, above the lowest stretch of the highest line, with no more room than it takes there
    size, margin = 0.22, 0.05
    starts = np.linspace(margin, 1.0 - margin - size, 31)
    beneath = [points[np.abs(points[:, 0] - start - size / 2.0) < size / 2.0 + 0.02, 1].max() for start in starts]
    ax.set_ylim(bottom, bottom + (top - bottom) * max(1.0, (min(beneath) + 0.02) / (1.0 - margin - size)))
    return float(starts[int(np.argmin(beneath))]), 1.0 - margin - size, size, size


def plot_mode(
    phonons: Phonons,
    q: ArrayLike,
    branch: int,
    ax: Axes,
    *,
    cells: tuple[int, int] = (4, 4),
    phase: float = 0.0,
    direction: ArrayLike | None = None,
) -> Axes:
    """Draw the mode of branch ``branch`` at ``q`` on balls at their real size; axes in mean diameters, hidden.

    Each ball at r has the displacement Re(e M^-1/2 exp(i q.r + i phase)), an arrow from its centre, and is turned by the
    angle phi = w/R_g: the sector between the upright and its mark, in vermilion against the clock and in blue with it.
    Displacements and w have one scale, on which the largest of them in a period is 0.4 d. The free phase of the eigenvector
    is such that the largest of its components is real and positive, so that nothing stands still at phase 0.

    Parameters
    ----------
    q : (2,) or (3,), fractions of the reciprocal cell.
    branch : counted from 0, in ascending frequency.
    cells : how many to draw along each lattice vector.
    phase : rad; at time t it is -omega t.
    direction : where branches touch, and at Gamma (required), as in ``Phonons.modes``.
    """
    modes = phonons.modes([real_array("q", q)], direction)
    count = modes.frequencies.shape[1]
    if not 0 <= branch < count:
        raise InputError(message(f"there is no branch {branch}", mend=f"Count from 0 to {count - 1}"))
    lattice = phonons.lattice
    n = lattice.n_balls
    motion = modes.eigenvectors[0, :, branch].reshape(n, -1) / np.sqrt(lattice.masses)[:, None]
    largest = motion.ravel()[np.argmax(np.round(np.abs(motion).ravel() / np.abs(motion).max(), 6))]
    motion = motion * (abs(largest) / largest) * _LARGEST / _amplitude(motion)
    steps = np.array(list(np.ndindex(*cells)))
    places = (steps @ lattice.cell)[:, None] + lattice.positions
    wave = np.exp(1j * (places @ (modes.wavevectors[0] * phonons.scales.length) + phase))
    now = (motion[None] * wave[..., None]).real.reshape(len(steps) * n, -1)
    centres = places.reshape(-1, 2)
    radius = np.tile(phonons.atoms.arrays.get("radius", np.full(n, 0.5)), len(steps))
    balls = [Circle((x, y), r) for (x, y), r in zip(centres, radius, strict=True)]
    ax.add_collection(PatchCollection(balls, facecolor="0.94", edgecolor="0.45", linewidth=0.6, zorder=1.0, gid="balls"))
    if lattice.rotates:
        _draw_spins(ax, centres, radius, now[:, 2] / np.tile(lattice.gyration, len(steps)))
    ax.quiver(
        *centres.T, now[:, 0], now[:, 1], angles="xy", scale_units="xy", scale=1.0, units="xy", width=0.055, headwidth=3.6,
        headlength=4.0, headaxislength=3.6, minlength=0.0, minshaft=1.5, color="black", zorder=3.0, gid="displacements",
    )  # fmt: skip
    low, high = (centres - radius[:, None]).min(axis=0), (centres + radius[:, None]).max(axis=0)
    _frame(ax, low - 0.1, high + 0.1)
    hertz = float(modes.frequencies[0, branch])
    unit = HertzPrefix.for_top(hertz)
    near = [(float(x), Fraction(float(x)).limit_denominator(24)) for x in np.asarray(q, float)[:2]]
    fractions = ", ".join(str(ratio) if abs(x - ratio) < 1e-9 else f"{x:.4g}" for x, ratio in near)
    part = f", rotation {100.0 * float(modes.rotational_fraction[0, branch]):.0f} %" if lattice.rotates else ""
    # of the highest, rounding leaves as much of one that is zero
    zero = hertz <= count * np.finfo(float).eps * float(modes.frequencies.max())
    ax.set_title(f"q = ({fractions})\n{'zero frequency' if zero else f'{hertz / unit.hertz:.1f} {_unit_name(unit)}'}{part}")
    return ax


def _amplitude(motion: NDArray[Any]) -> float:
    """The largest displacement, or w, of any ball in a period: of an ellipse, its longer half axis."""
    u = motion[:, :2]
    longest = np.sqrt(0.5 * (np.sum(np.abs(u) ** 2, axis=1) + np.abs(np.sum(u * u, axis=1))))
    return float(max(longest.max(), np.abs(motion[:, 2:]).max(initial=0.0)))


def _draw_spins(ax: Axes, centres: Array, radius: Array, angles: Array) -> None:
    """For each ball the sector from the upright to its mark, the arc with its head, and the diameter through the mark."""

    def at(distance: Array, angle: Array) -> Array:
        arms = distance[:, None, None] * np.stack([np.cos(angle), np.sin(angle)], axis=-1)
        return np.asarray(centres[:, None] + arms)

    colours = [_SPINS[0] if angle >= 0.0 else _SPINS[1] for angle in angles]
    rim, end = 0.72 * radius, _MARK + angles[:, None]
    marks = at(radius, end + np.array([0.0, np.pi]))
    arcs = at(rim, _MARK + angles[:, None] * np.linspace(0.0, 1.0, 33))
    # a head as long as the arc allows, pointing along it
    head = np.sign(angles) * np.minimum(0.47, 0.8 * np.abs(angles))
    back = at(rim, end - head[:, None])
    wing = 0.5 * (arcs[:, -1:] - back) @ np.array([[0.0, 1.0], [-1.0, 0.0]])
    heads = np.concatenate([arcs[:, -1:], back + wing, back - wing], axis=1)
    sectors = np.concatenate([centres[:, None], arcs], axis=1)
    ax.add_collection(PolyCollection(list(sectors), facecolors=colours, alpha=0.25, linewidths=0.0, zorder=1.5))
    ax.add_collection(LineCollection(list(marks), colors="0.45", linewidths=0.6, gid="marks"))
    ax.add_collection(LineCollection(list(arcs), colors=colours, linewidths=1.0, gid="spins"))
    ax.add_collection(PolyCollection(list(heads), facecolors=colours, linewidths=0.0, zorder=2.1))
