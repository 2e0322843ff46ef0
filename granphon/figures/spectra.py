"""Figures of the spectra of networks: spectral functions along a path, attenuation, densities of states with errors."""

from __future__ import annotations

from functools import partial
from typing import Any

from granphon.figures.scales import SPECTRUM, draw_alone, draw_densities, scale_axis

import matplotlib
import numpy as np
from matplotlib.axes import Axes
from matplotlib.colors import LogNorm
from matplotlib.figure import Figure
from numpy.typing import NDArray

from granphon.base.scales import HertzPrefix
from granphon.figures.style import (
    BLUE,
    COLOURS,
    COLUMN_WIDTH,
    DPI,
    ORANGE,
    PURPLE,
    STYLE,
    VERMILION,
    print_hertz,
)  # fmt: skip
from granphon.figures.zones import name_corners
from granphon.waves.dos import SpectralDensity
from granphon.waves.path_spectra import PathSpectra
from granphon.waves.spectral_functions import SpectralFunction

Array = NDArray[np.float64]
#: ratio of the darkest to the lightest shade of a spectral function
_SHADES = 1e3
#: part of the range of frequencies above the highest band that is drawn
_ABOVE = 0.08
#: greatest number of frequencies that are drawn; more are averaged in groups
_MOST_ROWS = 600


def plot_spectrum(spectra: PathSpectra, ax: Axes, number: int = 0, *, bands: bool = True, peaks: bool = True) -> Axes:
    """Draw a spectral function along the path as a map, on a logarithmic scale of colours.

    A column for each wave vector of the cell reaches half way to its neighbours, and not beyond the corners around it. Legs
    of the path on which the cell has no wave vector are left white. The bands of the mean lattice
    are dashed; peaks are dots, with bars as long as the width (full, at half maximum) where it is resolved.

    Parameters
    ----------
    spectra : along the path.
    number : which of the polarisations.
    bands, peaks : whether to draw these.
    """
    one, order = spectra.spectra[number], np.argsort(spectra.distances, kind="stable")
    unit = HertzPrefix.for_top(float(spectra.bands.max()))
    x, top = spectra.distances[order], (1.0 + _ABOVE) * float(spectra.bands.max())
    inside = one.frequencies <= top
    values, frequencies = one.values[order][:, inside], one.frequencies[inside]
    group = max(1, frequencies.size // _MOST_ROWS)
    rows = frequencies.size // group
    values = values[:, : rows * group].reshape(len(x), rows, group).max(axis=2)
    edges_y = np.append(frequencies[: rows * group : group], frequencies[rows * group - 1]) / unit.hertz
    if edges_y[-1] < top / unit.hertz:  # nothing is above the highest frequency
        edges_y, values = np.append(edges_y, top / unit.hertz), np.pad(values, ((0, 0), (0, 1)))
    corners = spectra.corners
    edges_x, owner = _find_columns(x, corners)
    most = float(values.max()) * unit.hertz
    norm = LogNorm(most / _SHADES, most)
    shades = np.maximum(values[owner].T * unit.hertz, most / _SHADES)
    shades[:, owner < 0] = np.nan
    mesh = ax.pcolormesh(edges_x, edges_y, shades, norm=norm, cmap=SPECTRUM, rasterized=True, gid="spectral-function")
    if bands:
        label = "bands of the mean lattice"
        per = spectra.band_distances.size // (len(corners) - 1)
        for leg in range(len(corners) - 1):
            part = slice(leg * per, (leg + 1) * per)
            lines = ax.plot(
                spectra.band_distances[part], spectra.bands[part] / unit.hertz, color="0.35", linewidth=0.7, dashes=(3, 2)
            )
            lines[0].set_label(label if not leg else "_")
    if peaks:
        wide = np.where(one.resolved, 0.5 * one.width, 0.0)[order] / unit.hertz
        dots, *_ = ax.errorbar(
            x, one.peak[order] / unit.hertz, wide, fmt="o", markersize=2.2, color=ORANGE, elinewidth=0.8,
            label="peak and width", markeredgecolor="black", markeredgewidth=0.3,
        )  # fmt: skip
        dots.set_clip_on(False)  # those at the ends of the path are drawn whole
    name_corners(ax, corners, spectra.labels)
    ax.set(ylabel=f"Frequency ({print_hertz(unit)})", ylim=(0.0, top / unit.hertz))
    figure: Any = ax.get_figure()
    bar = figure.colorbar(mesh, ax=ax, location="top", aspect=40, pad=0.02)
    bar.set_label(f"Spectral function, {one.polarisation} (1/{print_hertz(unit)})")
    return ax


def _find_columns(x: Array, corners: Array) -> tuple[Array, NDArray[np.intp]]:
    """Return the edges (n + 1,) of columns along a path, and for each column (n,) which of the points ``x`` it shows.

    -1 stands for none: no point lies on that leg.
    """
    near = 1e-9 * float(corners[-1])
    edges, owner = [float(corners[0])], []
    for n, (here, after) in enumerate(zip(x, [*x[1:], np.inf], strict=True)):
        if not n and (before := corners[1:][corners[1:] < here - near]).size:
            edges.append(float(before[-1]))
            owner.append(-1)
        owner.append(n)
        between = corners[(corners > here + near) & (corners < after - near)]
        if not between.size:  # the last point may be at the end of the path
            edges.append(0.5 * float(here + after) if np.isfinite(after) else float(corners[-1]))
            continue
        edges.append(float(between[0]))
        if between.size > 1:
            edges.append(float(between[-1]))
            owner.append(-1)
    return np.array(edges), np.array(owner)


def spectrum_figure(spectra: PathSpectra) -> Figure:
    """Draw a figure of all polarisations of a path, one under the other, and of their attenuation, one column wide.

    The attenuation is left out if fewer than two lines are resolved.
    """
    count = len(spectra.spectra)
    resolved = [one for one in spectra.spectra if np.sum(one.resolved & (one.width > 0.0)) > 1]
    with matplotlib.rc_context(STYLE):
        figure = Figure((COLUMN_WIDTH, 0.3 + 2.8 * count + 2.0 * bool(resolved)), dpi=DPI, layout="constrained")
        ratios = [1.4] * count + [1.0] * bool(resolved)
        panels = figure.subplots(len(ratios), 1, squeeze=False, height_ratios=ratios)[:, 0]
        for number, ax in enumerate(panels[:count]):
            plot_spectrum(spectra, ax, number)
        for one, colour in zip(resolved, (BLUE, VERMILION, PURPLE), strict=False):
            plot_attenuation(one, panels[-1], colour=colour)
        figure.legend(*panels[0].get_legend_handles_labels(), loc="outside lower center", ncols=2)
    return figure


def plot_attenuation(spectrum: SpectralFunction, ax: Axes, *, power: float | None = None, colour: str = BLUE) -> Axes:
    """Draw the attenuation of resolved lines over their frequency, both logarithmic, with a power law beside it.

    ``power`` is by default that of Rayleigh's scattering by small disorder: omega^(d+1) in d dimensions, as d is the number
    of components of q.
    """
    there = spectrum.resolved & (spectrum.width > 0.0)
    unit = HertzPrefix.for_top(float(spectrum.peak.max()))
    f, a = spectrum.peak[there] / unit.hertz, spectrum.attenuation[there]
    ax.plot(f, a, "o", markersize=3.0, color=colour, label=spectrum.polarisation)
    if f.size > 1 and not (power is None and spectrum.polarisation.startswith("rot")):
        exponent = spectrum.q.shape[1] + 1.0 if power is None else power
        first = int(np.argmin(f))
        line = np.array([f.min(), f.max()])
        label = f"$f^{{{exponent:g}}}$"
        known = ax.get_legend_handles_labels()[1]
        style: dict[str, Any] = {
            "color": colour, "linewidth": 0.9, "linestyle": ":", "label": "_" if label in known else label,
        }  # fmt: skip
        ax.plot(line, a[first] * (line / f[first]) ** exponent, **style)
        ax.set(yscale="log")
        scale_axis(ax, "x", f)
    ax.set(xlabel=f"Frequency ({print_hertz(unit)})", ylabel="Attenuation of the amplitude (1/m)")
    ax.legend()
    return ax


def plot_lines(spectrum: SpectralFunction, ax: Axes) -> Axes:
    """Draw the spectral function over frequency at each wave vector, up to six of them evenly taken.

    The axis of frequency ends above the highest frequency at which a line has a thousandth of the highest peak.
    """
    chosen = np.unique(np.linspace(0, len(spectrum.q) - 1, len(COLOURS)).round().astype(int))
    values = spectrum.values[chosen]
    top = float(spectrum.frequencies[np.flatnonzero(values.max(axis=0) > 1e-3 * values.max())[-1]])
    unit = HertzPrefix.for_top(top)
    for colour, n in zip(COLOURS, chosen.tolist(), strict=False):
        ax.plot(
            spectrum.frequencies / unit.hertz, spectrum.values[n] * unit.hertz, color=colour, linewidth=0.9,
            label=f"|q| = {spectrum.wavenumber[n]:.4g} /m",
        )  # fmt: skip
    ax.set(
        xlabel=f"Frequency ({print_hertz(unit)})", xlim=(0.0, 1.05 * top / unit.hertz), ylim=(0.0, None),
        ylabel=f"Spectral function, {spectrum.polarisation} (1/{print_hertz(unit)})",
    )  # fmt: skip
    ax.legend()
    return ax


def lines_figure(spectrum: SpectralFunction) -> Figure:
    """Draw a figure, one column wide, of a spectral function at its wave vectors; see :func:`plot_lines`."""
    return draw_alone(partial(plot_lines, spectrum), 2.6)


def plot_sample_dos(dos: SpectralDensity, ax: Axes) -> Axes:
    """Draw the density of states of a network per ball: total with its standard error as a band, and its two parts."""
    f = dos.frequencies
    curves: list[tuple[Any, str, Array, Array, Array]] = [("black", "total", f, dos.total, dos.error)]
    if np.any(dos.rotational > 0.0):
        curves.append((COLOURS[0], "translation", f, dos.translational, dos.translational_error))
        curves.append((COLOURS[4], "rotation", f, dos.rotational, dos.rotational_error))
    draw_densities(ax, curves)
    ax.legend()
    return ax


def sample_dos_figure(dos: SpectralDensity) -> Figure:
    """Draw a figure, one column wide, of the density of states of a network; see :func:`plot_sample_dos`."""
    return draw_alone(partial(plot_sample_dos, dos), 2.4)
