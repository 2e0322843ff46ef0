"""Figures over load: sweeps of many states, and fits to measured velocities; and the force chains of a simulated sample.

As in :mod:`granphon.figures.bands`, whose style they share, every function draws on an Axes and returns it, and matplotlib's
global state is left alone. A medium has a colour, values of parameters a shade of it; where it is not valid its line is
dashed.
"""

from __future__ import annotations

import itertools
from typing import TYPE_CHECKING, Any

# before matplotlib, whose door it is
from granphon.figures.scales import scale_axis

# isort: split
import matplotlib
import numpy as np
from matplotlib import patheffects
from matplotlib.axes import Axes
from matplotlib.collections import EllipseCollection, LineCollection
from matplotlib.colors import Normalize, to_rgb
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.ticker import MaxNLocator
from numpy.typing import NDArray

from granphon.array.sample import Sample
from granphon.balls.lattices import TRIANGULAR
from granphon.base.errors import InputError, message
from granphon.base.scales import prefixed
from granphon.figures.style import STYLE
from granphon.fits.fit import WidthFit
from granphon.media.simulation import DirectSimulation, SimulatedState

if TYPE_CHECKING:
    from xarray import Dataset

__all__ = [
    "fit_figure", "forces_figure", "plot_exponent", "plot_fit", "plot_force_distribution", "plot_forces", "plot_sweep",
    "sweep_figure",
]  # fmt: skip

Array = NDArray[np.float64]
#: told apart by every eye, and in grey
_COLOURS = ("#0072B2", "#D55E00", "#009E73", "#CC79A7", "#E69F00", "#56B4E9")
_GREY = "0.6"
#: letters of a label of which no two stand side by side in a column
_LONG_LABEL = 24
_NAMES = {
    "force": "Contact force", "pressure": "Pressure", "overlap": "Overlap", "longitudinal": "Longitudinal velocity",
    "transverse": "Transverse velocity", "exponent": "d log $v_L$ / d log $P$", "reduced_force": "Force f*",
    "normal_stiffness": "Normal stiffness", "contact_fraction": "Fraction of contacts", "bulk": "Bulk modulus",
    "shear": "Shear modulus", "force_fluctuation": "Force fluctuation Δf/f", "stiffness_ratio": "k over the ideal lattice's",
}  # fmt: skip
_MEDIA = {"ala": "averaged lattice", "afa": "averaged force", "ema": "effective medium"}


# -- sweeps ---------------------------------------------------------------------------------------------------------


def plot_sweep(dataset: Dataset, ax: Axes, variable: str = "longitudinal", x: str = "force", *, legend: bool = True) -> Axes:
    """Draw a variable of a sweep, one line for each medium and combination of parameters, in order of ``x``.

    Parameters
    ----------
    dataset : of :func:`granphon.sweep`.
    variable, x : names of variables or coordinates over load.
    legend : whether to draw it, with no more than eight combinations in it.

    Axes are logarithmic where all values are above zero. Lines are solid where the medium is valid, thin and dashed
    elsewhere, and each is thinner than the one before, so that all remain visible where they coincide. A simulation has no
    line but points, open where it is not valid; of several samples they are means, with bars of their standard errors.

    Raises
    ------
    InputError : there is no such variable, it is not one number at each load, or it is nowhere finite.
    """
    across, along, lines = _values(dataset, variable), _values(dataset, x), _lines(dataset)
    for (colour, index), width in zip(lines, np.linspace(2.2, 1.0, len(lines) + 1)[1:], strict=True):
        horizontal, vertical, inside = (
            np.asarray(part.isel(index, missing_dims="ignore")) for part in (along, across, dataset["valid"])
        )
        order = np.argsort(horizontal, kind="stable")
        horizontal, vertical, inside = horizontal[order], vertical[order], inside[order]
        simulated = _simulated(dataset, index)
        style: dict[str, Any] = {"color": colour, "marker": "o" if simulated or order.size == 1 else "", "markersize": 3.0}
        thin, solid = (style | {"gid": f"{variable}-{which}"} for which in ("all", "valid"))
        thin |= {"markerfacecolor": "white"}
        if simulated:
            deviation = np.asarray(_errors(dataset, variable).isel(index, missing_dims="ignore"))[order]
            if np.any(deviation > 0.0):
                bars: dict[str, Any] = {"fmt": "none", "elinewidth": 0.8, "color": colour, "gid": f"{variable}-errors"}
                ax.errorbar(horizontal, vertical, deviation, **bars)
            thin |= {"linestyle": "none"}
            solid |= {"linestyle": "none"}
        else:
            thin |= {"linewidth": 0.7, "dashes": (3.0, 1.5)}
            solid |= {"linewidth": width}
        ax.plot(horizontal, vertical, **thin)
        ax.plot(horizontal, np.where(inside, vertical, np.nan), **solid)
    for which, values, name in (("x", along, x), ("y", across, variable)):
        scale_axis(ax, which, np.asarray(values))
        ax.set(**{f"{which}label": _label(dataset, name)})
    if legend:
        ax.legend(handles=_legend(dataset))
    return ax


def _simulated(dataset: Dataset, index: dict[str, int]) -> bool:
    """Whether the medium there is a simulation, by its label."""
    return str(dataset["medium"].values[index["medium"]]).partition("(")[0] == DirectSimulation.name


def _errors(dataset: Dataset, variable: str) -> Any:
    """Standard errors of a variable, where it has any; those of one sample are not known, and have no bar."""
    return dataset.get(f"{variable}_error", dataset[variable] * np.nan)


def _values(dataset: Dataset, name: str) -> Any:
    """A variable over load; :class:`InputError` if it cannot be drawn."""
    if name not in dataset.variables:
        known = ", ".join(map(str, dataset.data_vars))
        raise InputError(message(f"the sweep has no variable {name!r}", f"It has {known}"))
    values = dataset[name]
    extra = set(values.dims) - {"load", "medium", *_parameters(dataset)}
    if "load" not in values.dims or values.dtype.kind not in "fiub" or extra:
        raise InputError(message(f"{name!r} is not one number at each load", mend="Draw another variable"))
    if not np.any(np.isfinite(values)):
        raise InputError(message(f"{name!r} is nowhere finite", mend="Draw another variable"))
    return values


def _parameters(dataset: Dataset) -> list[str]:
    """Dimensions of the sweep besides load and medium."""
    return [str(name) for name in dataset["longitudinal"].dims if name not in ("load", "medium")]


def _combinations(dataset: Dataset) -> list[tuple[str, dict[str, int]]]:
    """Every combination of parameters: in words, of those that have several values, and its place."""
    names = _parameters(dataset)
    words = {name: [f"{name.replace('_', ' ')} {label}" for label in _labels(dataset, name)] for name in names}
    several = [name for name in names if dataset.sizes[name] > 1]
    places = [dict(zip(names, index, strict=True)) for index in np.ndindex(*(dataset.sizes[name] for name in names))]
    return [(", ".join(words[name][place[name]] for name in several), place) for place in places]


def _lines(dataset: Dataset) -> list[tuple[Any, dict[str, int]]]:
    """Colour and place of each line."""
    places = [place for _, place in _combinations(dataset)]
    colours = [_COLOURS[m % len(_COLOURS)] for m in range(dataset.sizes["medium"])]
    return [
        (shade, place | {"medium": m})
        for m, colour in enumerate(colours)
        for shade, place in zip(_shades(colour, len(places)), places, strict=True)
    ]


def _shades(name: str, count: int) -> list[Any]:
    """Of one colour, from darker than itself to lighter; one alone is the colour."""
    colour = np.array(to_rgb(name))
    change = np.linspace(-0.5, 0.6, count) if count > 1 else np.zeros(1)
    return [tuple(colour * (1.0 + min(t, 0.0)) + max(t, 0.0) * (1.0 - colour)) for t in change.tolist()]


def _labels(dataset: Dataset, name: str) -> list[str]:
    """What the values of a dimension are called in a legend."""
    values = np.atleast_1d(dataset[name].values).tolist()
    if name == "medium":
        return [_MEDIA.get(value, str(value)) for value in values]
    if not all(isinstance(value, float) for value in values):
        return [str(value) for value in values]
    number, unit = _multiple(max(map(abs, values)), dataset[name].attrs.get("units", ""))
    return [f"{value / number:.4g} {unit}".rstrip() for value in values]


def _multiple(largest: float, unit: str) -> tuple[float, str]:
    """The size of a decimal multiple of ``unit`` that suits a value, and its name as it is printed."""
    if unit not in ("m", "Pa", "N", "Hz"):
        return 1.0, "" if unit == "1" else unit
    size, name = prefixed(largest, unit)
    return size, name.replace("u", "µ")


def _legend(dataset: Dataset) -> list[Line2D]:
    """An entry for each medium, and for combinations of parameters (in grey, unless there is one medium); and the dashes."""
    media = list(zip(itertools.cycle(_COLOURS), _labels(dataset, "medium"), strict=False))
    words = [word for word, _ in _combinations(dataset)]
    values: list[tuple[Any, str]] = []
    if len(words) > 1:
        shades = _shades(_COLOURS[0] if len(media) == 1 else "0.5", len(words))
        shown = np.unique(np.linspace(0, len(words) - 1, min(len(words), 8)).round().astype(int))
        values = [(shades[i], words[i]) for i in shown.tolist()]
    simulated = [_simulated(dataset, {"medium": m}) for m in range(len(media))]
    point: dict[str, Any] = {"marker": "o", "markersize": 3.0, "linestyle": "none"}
    entries = [] if values and len(media) == 1 else list(zip(media, simulated, strict=True))
    entries += [(value, all(simulated)) for value in values]
    lines = [Line2D([], [], color=colour, label=label, **(point if points else {})) for (colour, label), points in entries]
    if not np.all(dataset["valid"]):
        outside = point | {"markerfacecolor": "white"} if all(simulated) else {"linewidth": 0.7, "dashes": (3.0, 1.5)}
        lines.append(Line2D([], [], color="0.3", label="outside its range", **outside))
    return lines


def _label(dataset: Dataset, name: str) -> str:
    words = _NAMES.get(name, name.replace("_", " ").capitalize())
    unit = dataset[name].attrs.get("units", "")
    return words if unit in ("", "1") else f"{words} ({unit})"


def plot_exponent(dataset: Dataset, ax: Axes, x: str = "force") -> Axes:
    """Draw the local exponent d log v_L / d log P of a sweep, with that of the ideal lattice, 1/6, and the popular 1/4.

    That of v_T is the same, but for a simulation, whose points have bars of their standard errors if there are several
    samples; see :func:`granphon.local_exponent`.
    """
    plot_sweep(dataset, ax, "exponent", x, legend=False)
    ax.set_yscale("linear")
    for value, name in ((1.0 / 6.0, "1/6"), (0.25, "1/4")):
        ax.axhline(value, color=_GREY, linewidth=0.6, zorder=0.5)
        ax.annotate(
            name, (0.0, value), xycoords=ax.get_yaxis_transform(), xytext=(2, 1), textcoords="offset points", va="bottom",
            color="0.4", fontsize=7.0, path_effects=[patheffects.withStroke(linewidth=1.5, foreground="white")],
        )  # fmt: skip
    ax.margins(y=0.1)
    return ax


def sweep_figure(dataset: Dataset, x: str = "force", *, variable: str | None = None) -> Figure:
    """Velocities of a sweep above, their local exponent below, on one axis of ``x``; one column wide.

    A sweep without exponents (finite overlap) has the upper panel only; so has one ``variable`` that is asked for. Raises as
    :func:`plot_sweep`.
    """
    both = variable is None and "exponent" in dataset
    with matplotlib.rc_context(STYLE):
        figure = Figure(figsize=(3.4, 4.0 if both else 2.6), dpi=300, layout="constrained")
        ratios = [1.6, 1.0][: 1 + both]
        axes = figure.subplots(1 + both, sharex=True, squeeze=False, height_ratios=ratios)[:, 0]
        if variable is not None:
            plot_sweep(dataset, axes[0], variable, x, legend=False)
        else:
            _plot_velocities(dataset, axes[0], x)
        if both:
            plot_exponent(dataset, axes[1], x)
            axes[0].set_xlabel("")
        for ax in axes:
            ax.margins(x=0.08)
        handles, media = _legend(dataset), _labels(dataset, "medium")
        title = media[0] if len(media) == 1 and handles[0].get_label() != media[0] else None
        longest = max(len(str(handle.get_label())) for handle in handles)
        columns = 1 if longest > _LONG_LABEL else min(2, len(handles))
        figure.legend(handles=handles, loc="outside lower center", ncols=columns, title=title)
    return figure


def _plot_velocities(dataset: Dataset, ax: Axes, x: str) -> None:
    """Both velocities, each named at the end of its lines."""
    for variable, name in (("transverse", "$v_T$"), ("longitudinal", "$v_L$")):
        plot_sweep(dataset, ax, variable, x, legend=False)
        ends: Any = [np.asarray(line.get_xydata())[-1] for line in ax.lines if line.get_gid() == f"{variable}-all"]
        ax.annotate(name, np.max(ends, axis=0), xytext=(4, 0), textcoords="offset points", va="center")
    scale_axis(ax, "y", np.concatenate([np.asarray(dataset[name]).ravel() for name in ("longitudinal", "transverse")]))
    ax.set_ylabel("Sound velocity (m/s)")


# -- fits -----------------------------------------------------------------------------------------------------------


def plot_fit(fit: WidthFit, ax: Axes, residual_ax: Axes) -> tuple[Axes, Axes]:
    """Draw measured velocities with standard errors, the fit, and the ideal lattice; below, residuals in units of sigma.

    Where each pulse has a frequency of its own, the fit is drawn at the data only, and no ideal lattice.
    """
    ax.errorbar(fit.force, fit.velocity, fit.sigma, **_POINTS, label="data", gid="data")
    style: dict[str, Any] = {"color": _COLOURS[1], "label": _described(fit), "gid": "fit", "zorder": 1.5}
    if np.ndim(fit.waves.frequency):
        ax.plot(fit.force, fit.velocities, "_", markersize=6.0, **style)
    else:
        force = np.geomspace(fit.force.min(), fit.force.max(), 200)
        ax.plot(force, fit.velocity_at(force), linewidth=1.2, **style)
        equal: dict[str, Any] = {"color": _GREY, "label": "equal balls", "gid": "ideal", "zorder": 1.0}
        ax.plot(force, fit.velocity_at(force, "ala"), linewidth=0.8, **equal)
    residual_ax.axhline(0.0, color=_COLOURS[1], linewidth=1.2, zorder=1.0)
    residual_ax.errorbar(fit.force, fit.residuals / fit.sigma, 1.0, **_POINTS, gid="residuals")
    for axes in (ax, residual_ax):
        scale_axis(axes, "x", fit.force)
    scale_axis(ax, "y", fit.velocity)
    pulse = "Group velocity" if fit.waves.frequency is not None else f"{fit.waves.branch.capitalize()} velocity"
    ax.set_ylabel(f"{pulse} (m/s)")
    residual_ax.set(xlabel="Contact force (N)", ylabel="Residual / σ")
    residual_ax.yaxis.set_major_locator(MaxNLocator(5, integer=True))
    return ax, residual_ax


_POINTS: dict[str, Any] = {
    "fmt": "o", "color": "black", "markersize": 2.6, "elinewidth": 0.7, "capsize": 0.0, "zorder": 2.0,
}  # fmt: skip


def _described(fit: WidthFit) -> str:
    size, unit = _multiple(fit.width, "m")
    if not fit.errors_are_known:
        return f"{fit.medium}: W = {fit.width / size:.5g} {unit}"
    digits = min(max(0, 1 - int(np.floor(np.log10(fit.stderr / size)))), 6)  # two of the standard error
    return f"{fit.medium}: W = {fit.width / size:.{digits}f} ± {fit.stderr / size:.{digits}f} {unit}"


def fit_figure(fit: WidthFit) -> Figure:
    """A fit above its residuals, see :func:`plot_fit`; one column wide."""
    with matplotlib.rc_context(STYLE):
        figure = Figure(figsize=(3.4, 3.6), dpi=300, layout="constrained")
        axes = figure.subplots(2, sharex=True, height_ratios=[3.0, 1.0])
        plot_fit(fit, axes[0], axes[1])
        handles, labels = axes[0].get_legend_handles_labels()
        order = [labels.index("data"), *(i for i, label in enumerate(labels) if label != "data")]
        axes[0].legend([handles[i] for i in order], [labels[i] for i in order], loc="upper left")
    return figure


# -- force chains ---------------------------------------------------------------------------------------------------

#: light for contacts that carry little, dark for those that carry much, uniform to every eye
_CHAINS = matplotlib.colormaps["cividis_r"]
#: width of the line of a contact with the mean force: in diameters, but no more than so many points
_WIDTH, _WIDEST = 0.15, 1.5
#: balls are outlined in samples of no more
_OUTLINED = 400


def plot_forces(sample: Sample, ax: Axes | None = None) -> Axes:
    """Draw the contact forces of a sample: a line from site to site, as wide and as dark as f/<f>; strong ones on top.

    Rows of the periodic array are moved by whole periods to fill a rectangle. A contact across its edge is drawn on both
    sides, and cut off there. Contacts that carry nothing are left out; small samples show their balls. Axes are in mean
    diameters: displacements, of the order of the spread, would not be seen.

    ``ax``: of a new figure, one column wide, if it is not given.
    """
    if ax is None:
        with matplotlib.rc_context(STYLE):
            return plot_forces(sample, Figure((3.4, _height(sample)), dpi=300, layout="constrained").subplots())
    figure: Any = ax.get_figure()
    rows, columns = sample.equilibrium.deviations.shape
    sites, step = _sites(sample), float(TRIANGULAR.vectors[1, 1])
    segments, forces = _lines_of(sites, np.moveaxis(sample.equilibrium.forces / sample.equilibrium.force, 0, -1))
    # of a diameter on paper, as near as is known before the layout
    points = float(np.min(72.0 * figure.get_size_inches() * ax.get_position().size / [rows, step * columns]))
    if rows * columns <= _OUTLINED:
        size, style = np.ones(rows * columns), {"facecolors": "none", "edgecolors": "0.7", "linewidths": 0.4}
        place: dict[str, Any] = {"offsets": sites.reshape(-1, 2), "offset_transform": ax.transData, "gid": "balls"}
        ax.add_collection(EllipseCollection(size, size, 0.0 * size, units="xy", **style, **place), autolim=False)
    chains = LineCollection(list(segments), array=forces, cmap=_CHAINS, norm=Normalize(0.0, float(forces[-1])), gid="forces")
    chains.set(linewidths=min(_WIDTH * points, _WIDEST) * forces, capstyle="round")
    ax.add_collection(chains, autolim=False)
    ax.set(xlim=(-0.25, rows - 0.25), ylim=(-0.5 * step, (columns - 0.5) * step), aspect="equal")
    ax.set(xlabel="$x/d$", ylabel="$y/d$", title=_load_of(sample))
    for axis in (ax.xaxis, ax.yaxis):
        axis.set_major_locator(MaxNLocator(5, integer=True, steps=[1, 2, 5, 10]))
    figure.colorbar(chains, ax=ax, location="bottom", aspect=40, pad=0.02, label="Contact force over its mean")
    return ax


def _height(sample: Sample) -> float:
    """Of a figure, in inches, with the array 2.9 inches wide."""
    rows, columns = sample.equilibrium.deviations.shape
    return 1.15 + float(np.clip(2.5 * columns / rows, 1.6, 6.0))


def _sites(sample: Sample) -> Array:
    """(L1, L2, 2) the sites, in diameters, moved by whole periods of a1 into a rectangle."""
    sites = sample.sites
    sites[..., 0] = np.mod(sites[..., 0], len(sites))
    return sites


def _lines_of(sites: Array, forces: Array) -> tuple[Array, Array]:
    """(n, 2, 2) lines and (n,) forces, rising, of contacts that carry any; across an edge one at each of the two balls."""
    table = TRIANGULAR.contacts
    others = np.stack([np.roll(sites, (-p, -q), (0, 1)) for p, q in table.shift.tolist()], axis=2)
    way, own = np.broadcast_to(table.normal, others.shape), np.broadcast_to(sites[:, :, None], others.shape)
    lines = np.stack([np.stack([own, own + way], axis=-2), np.stack([others - way, others], axis=-2)])
    shown = np.stack([forces > 0.0, (forces > 0.0) & (np.linalg.norm(others - own - way, axis=-1) > 0.5)])
    values = np.stack([forces, forces])[shown]
    order = np.argsort(values, kind="stable")
    return lines[shown][order], values[order]


def _load_of(sample: Sample) -> str:
    """f*, a* (of equal balls the force), and N_c."""
    state, contacts = sample.equilibrium, f"$N_c$ = {sample.contact_fraction():.3f}"
    if not sample.packing.width:
        return f"$f$ = {sample.force:.4g} N, {contacts}"
    return f"$f^*$ = {state.force:.3g}, $a^*$ = {state.overlap + 0.5:.4g}, {contacts}"


def plot_force_distribution(state: SimulatedState, ax: Axes) -> Axes:
    """Draw the probability density of f/<f> over the contacts that carry load, mean over the samples, on a log scale.

    Bins are a quarter of the rms fluctuation wide. Raises :class:`~granphon.base.errors.InputError` for several loads.
    """
    _ = state.scales  # one load only
    forces = [sample.equilibrium.forces / sample.equilibrium.force for sample in state.samples]
    least, largest = min(float(np.min(one)) for one in forces), max(float(np.max(one)) for one in forces)
    width = max(state.contact_force_fluctuation / 4.0, 1e-12)
    bins = int(np.clip((largest - least) / width, 20, 400))
    margin = max((largest - least) / bins, 1e-12) / 2.0
    found = [sample.force_distribution(bins, largest + margin, max(least - margin, 0.0)) for sample in state.samples]
    edges, density = found[0][0], np.mean([each for _, each in found], axis=0)
    first, last = np.flatnonzero(density)[[0, -1]].tolist()
    ax.stairs(density[first : last + 1], edges[first : last + 2], baseline=None, color=_COLOURS[0], gid="density")
    ax.axvline(1.0, color=_GREY, linewidth=0.6, zorder=0.5)
    ax.set(yscale="log", xlabel="Contact force over its mean", ylabel="Probability density")
    return ax


def forces_figure(state: SimulatedState) -> Figure:
    """Force chains of the first sample, and beside them the distribution of forces in all; two columns wide.

    See :func:`plot_forces` and :func:`plot_force_distribution`. :class:`~granphon.base.errors.InputError` for several loads.
    """
    _ = state.scales  # one load only
    with matplotlib.rc_context(STYLE):
        figure = Figure(figsize=(7.0, _height(state.sample)), dpi=300, layout="constrained")
        left, right = figure.subplots(1, 2)
        plot_forces(state.sample, left)
        plot_force_distribution(state, right)
    return figure
