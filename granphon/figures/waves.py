"""Figures of waves in networks: spectral functions, attenuation, densities of states, pulses.

Other figures over the frequency are those of edges; of responses, in dB, with their phase and over
the load; of fits to transfer functions; of complex bands; and of the transmission of a strip
between crystals.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Mapping, Sequence
from functools import partial
from typing import Any, NamedTuple

from granphon.figures.scales import (
    LEAST_LIMIT,
    MOTION,
    SPECTRUM,
    add_bar,
    add_legend,
    draw_balls,
    draw_densities,
    draw_error_band,
    make_error_handle,
    name_errors,
    order_balls,
    read_errors,
    scale_axis,
    styled_figure,
)

import numpy as np
from matplotlib import colormaps
from matplotlib.axes import Axes
from matplotlib.colors import LogNorm, Normalize
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from numpy.typing import ArrayLike, NDArray

from granphon.base.arrays import Array
from granphon.base.errors import InputError
from granphon.base.scales import HertzPrefix, prefixed, write_quantity
from granphon.base.validation import number as in_range
from granphon.base.validation import (
    positive,
    real_array,
    require,
    require_instance,
    whole_number,
)
from granphon.figures.bands import name_corners
from granphon.figures.choices import choose_held, describe_value, list_parameters, require_axes
from granphon.figures.curves import describe_lines
from granphon.figures.style import (
    BLUE,
    COLOURS,
    COLUMN_WIDTH,
    GUIDE,
    ORANGE,
    PURPLE,
    VERMILION,
    pick_evenly,
    write_hertz,
)
from granphon.figures.words import find_differing, write_unit, write_value
from granphon.fits.transfer import DampingFit
from granphon.networks.network import ContactNetwork
from granphon.observables.catalogue import CATALOGUE, axis_label
from granphon.phonons.bands import ComplexBands
from granphon.phonons.surfaces import SurfaceBranches, SurfaceSpectrum
from granphon.runs.dataset import Dataset, find_load
from granphon.waves.dos import SpectralDensity
from granphon.waves.path_spectra import PathSpectra
from granphon.waves.pulses import Pulse
from granphon.waves.response import Response
from granphon.waves.scattering import Transmission
from granphon.waves.settings import RESPONSES
from granphon.waves.spectral_functions import SpectralFunction

#: ratio of the darkest to the lightest shade of a spectral function
_SHADES = 1e3
#: least number of rows of a map in which frequencies are grouped: many more cannot be told apart in
#: print
_LEAST_ROWS = 600
#: a spectrum ends at this multiple of the highest frequency of the bands
_TOP_OVER_BANDS = 1.08
#: a line below this part of the highest peak is not drawn
_LEAST_LINE = 1e-3
#: greatest height of a trace of a pulse, whose rows are 1 apart, so that a gap to the next is left
_HEIGHT = 0.45
#: a line counts as resolved if its width is resolved in this part of the samples
_LEAST_RESOLVED = 0.5
#: greatest magnitude of the power of a law of attenuation
_MOST_POWER = 100.0
#: greatest number of receivers of which each has a colour and an entry of the legend
_MOST_RECEIVERS = len(COLOURS)
#: greatest number of maps in a figure, and of receivers if several states are drawn
_MOST_PANELS = 4
#: greatest number of states in a figure
_MOST_STATES = 8
#: number of loads from which responses are maps over the load, and range of their colours, in dB
_LOADS_OF_MAP = 6
_DECIBELS = 80.0
#: decay from layer to layer, in units of pi, above which a wave is not drawn
_MOST_DECAY = 1.5
#: room beside the greatest wave numbers, in the same units
_BORDER = 0.06
#: least height of the axis of frequency, over the greatest frequency
_LEAST_HEIGHT = 1e-3


def plot_spectrum(
    spectra: PathSpectra, ax: Axes, number: int = 0, *, bands: bool = True, peaks: bool = True
) -> Axes:
    """Draw a spectral function along the path as a map, on a logarithmic scale of colours.

    The column of a wave vector of the cell reaches half way to its neighbours, but not beyond the
    corners around it. Legs of the path on which the cell has no wave vector are white. The bands of
    the mean lattice are dashed; peaks are dots, with bars as long as the width (full, at half
    maximum) where the width is resolved.

    Parameters
    ----------
    spectra : the spectral functions along the path.
    number : number of the polarisation, from 0.
    bands, peaks : whether to draw the bands and the peaks.

    Raises :class:`~granphon.base.errors.InputError` if there is no polarisation of this ``number``.
    """
    count = len(spectra.spectra)
    spectrum = spectra.spectra[whole_number("number", number, 0, count - 1)]
    order = np.argsort(spectra.distances, kind="stable")
    # a disordered packing has no mean lattice, and no bands
    has_bands = spectra.bands.size > 0
    highest = float(spectra.bands.max() if has_bands else spectrum.frequencies.max())
    unit = HertzPrefix.for_top(highest)
    x = spectra.distances[order]
    top = _TOP_OVER_BANDS * highest if has_bands else highest
    is_below_top = spectrum.frequencies <= top
    frequencies = spectrum.frequencies[is_below_top]
    edges_y, row_values = _group_rows(frequencies, spectrum.values[order][:, is_below_top])
    edges_y = edges_y / unit.hertz
    if edges_y[-1] < top / unit.hertz:  # the spectrum is zero above its highest frequency
        edges_y = np.append(edges_y, top / unit.hertz)
        row_values = np.pad(row_values, ((0, 0), (0, 1)))
    corners = spectra.corners
    edges_x, points = _find_columns(x, corners)
    has_point = points >= 0
    column_values = np.where(has_point[:, None], row_values[points], np.nan)  # nan is white
    _draw_map(
        ax,
        edges_x,
        edges_y,
        column_values,
        f"Spectral function, {spectrum.polarisation}",
        unit,
        gid="spectral-function",
    )
    if bands and has_bands:
        _draw_mean_bands(ax, spectra, unit)
    if peaks:
        _draw_peaks(ax, spectra.distances, spectrum, unit)
    name_corners(ax, corners, spectra.labels)
    ax.set(ylabel=f"Frequency ({write_hertz(unit)})", ylim=(0.0, top / unit.hertz))
    return ax


def _draw_peaks(ax: Axes, x: Array, spectrum: SpectralFunction, unit: HertzPrefix) -> None:
    """Draw the peak of a spectral function at each ``x`` (n,) as a dot, in this ``unit`` of
    frequency. Where the width is resolved, a bar is as long as the full width at half maximum.
    """
    half_widths = np.where(spectrum.resolved, 0.5 * spectrum.width, 0.0)
    dots, *_bars = ax.errorbar(
        x,
        spectrum.peak / unit.hertz,
        half_widths / unit.hertz,
        fmt="o",
        markersize=2.2,
        color=ORANGE,
        elinewidth=0.8,
        label="peak and width",
        markeredgecolor="black",
        markeredgewidth=0.3,
    )
    dots.set_clip_on(False)  # dots at the ends of the path are drawn whole


def _group_rows(frequencies: Array, values: Array) -> tuple[Array, Array]:
    """Return the rows of a map over ``frequencies`` (n_f,), Hz: their edges (r + 1,), Hz, and the
    greatest of the ``values`` (n, n_f) in each row, (n, r). A row has as many frequencies as leave
    ``_LEAST_ROWS`` rows or more, and at least one. Last frequencies that do not fill a row are left
    out. The edge between two rows is half way from the last frequency of the one to the first of
    the other; the outer edges are the lowest and the highest frequency in a row.
    """
    n_per_row = max(1, frequencies.size // _LEAST_ROWS)
    n_rows = frequencies.size // n_per_row
    rows = values[:, : n_rows * n_per_row].reshape(len(values), n_rows, n_per_row)
    row_frequencies = frequencies[: n_rows * n_per_row].reshape(n_rows, n_per_row)
    inner_edges = 0.5 * (row_frequencies[:-1, -1] + row_frequencies[1:, 0])
    edges = np.concatenate([row_frequencies[0, :1], inner_edges, row_frequencies[-1, -1:]])
    return edges, rows.max(axis=2)


def _draw_mean_bands(ax: Axes, spectra: PathSpectra, unit: HertzPrefix) -> None:
    """Draw the bands of the mean lattice along the path, dashed, with frequencies in this ``unit``.

    Each leg is a curve of its own, because wave vectors may jump at a corner.
    """
    n_legs = len(spectra.corners) - 1
    n_points = spectra.band_distances.size // n_legs
    for leg in range(n_legs):
        points = slice(leg * n_points, (leg + 1) * n_points)
        lines = ax.plot(
            spectra.band_distances[points],
            spectra.bands[points] / unit.hertz,
            color="0.35",
            linewidth=0.7,
            dashes=(3, 2),
        )
        lines[0].set_label("_" if leg else "bands of the mean lattice")


def _find_columns(x: Array, corners: Array) -> tuple[Array, NDArray[np.intp]]:
    """Return edges (m + 1,) of columns for points ``x`` (n,) along a path, in ascending order, and
    the number (m,) of the point in each column; -1 in a column for legs without a point.

    The edge between two points is half way, or at a corner of the path between them. Legs without a
    point reach from the first to the last of several such corners.
    """
    tolerance = 1e-9 * float(corners[-1])
    edges = [float(corners[0])]
    points = list[int]()
    corners_before = corners[1:][corners[1:] < x[0] - tolerance]
    if corners_before.size:
        edges.append(float(corners_before[-1]))
        points.append(-1)
    for n, (start, end) in enumerate(zip(x, [*x[1:], np.inf], strict=True)):
        points.append(n)
        corners_between = corners[(corners > start + tolerance) & (corners < end - tolerance)]
        if corners_between.size:
            edges.append(float(corners_between[0]))
        elif np.isfinite(end):
            edges.append(0.5 * float(start + end))
        else:  # the last point is at the end of the path
            edges.append(float(corners[-1]))
        if corners_between.size > 1:
            edges.append(float(corners_between[-1]))
            points.append(-1)
    return np.array(edges), np.array(points, np.intp)


def _draw_map(
    ax: Axes, x: Array, y: Array, values: Array, label: str, unit: HertzPrefix, **options: Any
) -> None:
    """Draw a spectrum ``values`` (n_x, n_y), 1/Hz, nan where there is none, as a map on a
    logarithmic scale, with its colour bar above the map.

    ``x`` and ``y`` are the edges of the cells of the map, (n_x + 1,) and (n_y + 1,), or with the
    option ``shading="nearest"`` their middles, (n_x,) and (n_y,); ``y`` is in this ``unit`` of
    frequency. ``options`` are those of matplotlib's ``pcolormesh``.
    """
    densities = values.T * unit.hertz
    # for a spectrum of zeros any scale will do
    lowest_density = (float(np.nanmax(densities)) or 1.0) / _SHADES
    norm = LogNorm(lowest_density, _SHADES * lowest_density)
    mesh = ax.pcolormesh(
        x,
        y,
        np.maximum(densities, lowest_density),
        norm=norm,
        cmap=SPECTRUM,
        rasterized=True,
        **options,
    )
    add_bar(ax, mesh, f"{label} (1/{write_hertz(unit)})")


def plot_surface(
    spectrum: SurfaceSpectrum,
    ax: Axes,
    *,
    branches: SurfaceBranches | None = None,
    errors: ArrayLike | None = None,
) -> Axes:
    """Draw the spectrum of the outer layer of a half space as a map, on a logarithmic scale, over
    the wave vectors in turn.

    Dashes are the edges of the crystal's bands. Dots are the ``branches`` at the same wave vectors,
    by default the waves of the spectrum: undamped waves are full dots, leaky waves hollow ones. The
    x axis is that of the path; without a path it is the first coordinate that changes, in fractions
    of the reciprocal cell. At one wave vector, as at the end of a chain, the spectrum of each
    motion is drawn over the frequency instead, with bands in grey and waves dotted. The standard
    ``errors`` (n,), Hz, of the frequencies of the waves, nan where unknown, are bars about the
    dots, and fields about dotted waves.

    Raises :class:`~granphon.base.errors.InputError` for one frequency, for several wave vectors
    that are all the same, for ``branches`` that are none or at other wave vectors, and for errors
    of another number than that of the waves.
    """
    unit = HertzPrefix.for_top(float(spectrum.edges.max()))
    q = spectrum.qpoints
    drawn_branches = spectrum.waves
    if branches is not None:
        _require_branches_at(q, branches)
        drawn_branches = branches
    n_waves = 0 if drawn_branches is None else len(drawn_branches.frequencies)
    wave_errors = np.zeros(n_waves)
    if errors is not None:
        wave_errors = np.nan_to_num(read_errors(errors, (n_waves,))) / unit.hertz
    y = spectrum.frequencies / unit.hertz
    if len(y) < 2:
        raise InputError("a map needs several frequencies", mend="Give more of them")
    if len(q) == 1:
        _draw_surface_curves(ax, spectrum, drawn_branches, unit, wave_errors)
        return ax
    varying_components = np.flatnonzero(np.ptp(q, axis=0) > 0.0)
    if not varying_components.size:
        raise InputError("a map needs several wave vectors", mend="Give more of them")
    component = int(varying_components[0])
    x = spectrum.distances if spectrum.labels else q[:, component]
    _draw_map(ax, x, y, spectrum.values, "Outer layer", unit, shading="nearest", gid="surface")
    edges = spectrum.edges / unit.hertz
    # each lower and each upper edge of a band is a curve over the wave vectors
    for number, edge in enumerate(edges.reshape(len(q), -1).T):
        label = "_" if number else "edges of bands"  # the legend has one entry for all
        ax.plot(x, edge, color="0.35", linewidth=0.5, dashes=(3, 2), label=label)
    if drawn_branches is not None:
        _draw_surface_branches(ax, x, drawn_branches, unit, wave_errors)
    if spectrum.labels:
        name_corners(ax, spectrum.corners, spectrum.labels)
    else:
        ax.set(xlabel=f"Wave vector $q_{component + 1}$ (reciprocal cell)")
    ax.set(ylabel=f"Frequency ({write_hertz(unit)})", xlim=(x.min(), x.max()), ylim=(0.0, y[-1]))
    ax.legend(loc="upper center", bbox_to_anchor=(0.5, -0.2), ncols=2)
    return ax


def _require_branches_at(q: Array, branches: SurfaceBranches) -> None:
    """Raise InputError unless ``branches`` are waves of an edge at the wave vectors ``q``
    (n_q, 3).
    """
    mend = "Give surface.branches of the wave vectors of the spectrum"
    require_instance("branches", branches, SurfaceBranches, mend)
    are_same = branches.qpoints.shape == q.shape and np.allclose(branches.qpoints, q, rtol=0.0)
    if not are_same:
        raise InputError("the branches are at other wave vectors than the spectrum", mend=mend)


def _draw_surface_curves(
    ax: Axes,
    spectrum: SurfaceSpectrum,
    branches: SurfaceBranches | None,
    unit: HertzPrefix,
    errors: Array,
) -> None:
    """Draw the spectrum of each motion of the outer layer over the frequency, in this ``unit``, at
    the only wave vector. Bands are grey, and the waves of ``branches`` are dotted, with fields of
    their standard ``errors`` (n,) in this unit.
    """
    frequencies = spectrum.frequencies / unit.hertz
    curves = spectrum.by_motion[0].T  # (motions, n_f), 1/Hz
    for colour, letter, density in zip(COLOURS, spectrum.letters, curves, strict=False):
        ax.plot(frequencies, density * unit.hertz, color=colour, linewidth=0.9, label=f"${letter}$")
    for low, high in spectrum.edges[0] / unit.hertz:
        ax.axvspan(low, high, color="0.9", linewidth=0.0, zorder=0.0)
    wave_frequencies = np.zeros(0) if branches is None else branches.frequencies / unit.hertz
    for number, frequency in enumerate(wave_frequencies):
        label = "_" if number else "wave of the edge"
        ax.axvline(frequency, color="0.2", linewidth=0.8, dashes=(1, 2), label=label)
        if errors[number] > 0.0:
            ends = frequency - errors[number], frequency + errors[number]
            ax.axvspan(*ends, color=ORANGE, alpha=0.3, linewidth=0.0, gid=f"error {number}")
    ax.set(
        xlim=(frequencies[0], frequencies[-1]),
        ylim=(0.0, None),
        xlabel=f"Frequency ({write_hertz(unit)})",
    )
    ax.set(ylabel=f"Outer layer (1/{write_hertz(unit)})")
    ax.legend()


def _draw_surface_branches(
    ax: Axes, x: Array, branches: SurfaceBranches, unit: HertzPrefix, errors: Array
) -> None:
    """Draw the waves of an edge as dots: undamped waves are full dots, leaky waves hollow ones,
    with bars of their standard ``errors``.

    ``x`` (n,) are the places of the wave vectors on the axis. Frequencies are drawn in this
    ``unit``, in which ``errors`` (m,), one for each of the m waves, are already. If no error is
    above zero, there are no bars.
    """
    if np.any(errors > 0.0):
        centres = branches.frequencies / unit.hertz
        ends = centres - errors, centres + errors
        ax.vlines(x[branches.place], *ends, color=ORANGE, linewidth=0.8, gid="errors")
    hollow = {"markerfacecolor": "none", "markeredgewidth": 0.4}
    is_leaky = branches.widths > 0.0
    for is_drawn, label, look in (
        (~is_leaky, "waves of the edge", {}),
        (is_leaky, "leaky waves", hollow),
    ):
        if np.any(is_drawn):  # a kind without a wave has no entry in the legend
            wave_vectors = x[branches.place[is_drawn]]
            frequencies = branches.frequencies[is_drawn] / unit.hertz
            style: dict[str, Any] = {"markersize": 1.6, "color": ORANGE, "label": label} | look
            ax.plot(wave_vectors, frequencies, "o", **style)


def spectrum_figure(spectra: PathSpectra, errors: Mapping[str, ArrayLike] | None = None) -> Figure:
    """Draw a figure of all polarisations of a path, one under the other, and of their attenuation,
    one column wide.

    A polarisation with fewer than two resolved lines of a width above zero has no attenuation, and
    the panel is left out if no polarisation has one. The standard ``errors`` of the numbers of all
    lines, by the names of :attr:`~granphon.waves.path_spectra.PathSpectra.numbers`, each for all
    polarisations in turn, are bars about the attenuations. Raises
    :class:`~granphon.base.errors.InputError` for errors of another number than that of the lines,
    and for ``errors`` that are no mapping.
    """
    count = len(spectra.spectra)
    # (number of the polarisation, spectral functions) of those with an attenuation to draw
    attenuated = [
        (number, spectrum)
        for number, spectrum in enumerate(spectra.spectra)
        if np.sum(spectrum.resolved & (spectrum.width > 0.0)) > 1
    ]
    n_lines = len(spectra.distances)
    tables = {
        name: read_errors(real_array("errors", table).ravel(), (count * n_lines,)).reshape(
            count, n_lines
        )
        for name, table in name_errors(errors).items()
    }
    height = 0.3 + 2.8 * count  # inches
    ratios = [1.4] * count
    if attenuated:
        height += 2.0
        ratios.append(1.0)
    with styled_figure(height) as figure:
        panels = figure.subplots(len(ratios), 1, squeeze=False, height_ratios=ratios)[:, 0]
        for number, ax in enumerate(panels[:count]):
            plot_spectrum(spectra, ax, number)
        # at most three: longitudinal, transverse and rotational
        for (number, spectrum), colour in zip(attenuated, (BLUE, VERMILION, PURPLE), strict=False):
            line_errors = {name: table[number] for name, table in tables.items()}
            plot_attenuation(spectrum, panels[-1], colour=colour, errors=line_errors)
        figure.legend(*panels[0].get_legend_handles_labels(), loc="outside lower center", ncols=2)
    return figure


def plot_attenuation(
    spectrum: SpectralFunction,
    ax: Axes,
    *,
    power: float | None = None,
    colour: str = BLUE,
    errors: Mapping[str, ArrayLike] | None = None,
) -> Axes:
    """Draw the attenuation of resolved lines over their frequency, with a power law through the
    line of the lowest frequency. Axes are logarithmic where a law is drawn.

    ``power``, from -100 to 100, is by default that of Rayleigh's scattering by small disorder:
    omega^(d+1) in d dimensions, where d is the number of components of q. Lines of rotations, which
    are no sound, have no law by default. Points and law have one ``colour``. The standard errors
    (n,) of frequencies, Hz, and of attenuations, 1/m, under "peak" and "attenuation" in ``errors``,
    nan where unknown, are bars; ``errors`` of other names are not drawn.

    Raises :class:`~granphon.base.errors.InputError` for errors of another shape, for ``errors``
    that are no mapping, and for another ``power``.
    """
    law_power = power
    if power is not None:
        law_power = require("power", partial(in_range, low=-_MOST_POWER, high=_MOST_POWER), power)
    is_drawn = spectrum.resolved & (spectrum.width > 0.0)
    unit = HertzPrefix.for_top(float(spectrum.peak.max()))
    frequencies = spectrum.peak[is_drawn] / unit.hertz
    attenuations = spectrum.attenuation[is_drawn]
    ax.plot(
        frequencies, attenuations, "o", markersize=3.0, color=colour, label=spectrum.polarisation
    )
    given_errors = name_errors(errors)
    if given_errors:
        zeros = np.zeros(is_drawn.shape)
        frequency_errors, attenuation_errors = (
            np.nan_to_num(read_errors(given_errors.get(name, zeros), is_drawn.shape))[is_drawn]
            for name in ("peak", "attenuation")
        )
        ax.errorbar(
            frequencies,
            attenuations,
            _limit_bars(attenuations, attenuation_errors),
            _limit_bars(frequencies, frequency_errors / unit.hertz),
            fmt="none",
            ecolor=colour,
            elinewidth=0.7,
        )
    is_rotation = spectrum.polarisation.startswith("rot")
    if law_power is None and not is_rotation:
        law_power = spectrum.q.shape[1] + 1.0
    if law_power is not None and frequencies.size > 1:
        _draw_power_law(ax, frequencies, attenuations, law_power, colour)
    ax.set(xlabel=f"Frequency ({write_hertz(unit)})", ylabel="Attenuation of the amplitude (1/m)")
    ax.legend()
    return ax


def _draw_power_law(ax: Axes, x: Array, y: Array, power: float, colour: str) -> None:
    """Draw the law y proportional to x^power through the point of the least ``x``, from the least
    to the greatest ``x``, dotted, and make the axes logarithmic. ``x`` and ``y`` (n,) are above
    zero, and in the units of the axes. Of laws of one power the first is named in the legend.
    """
    lowest = int(np.argmin(x))
    ends = np.array([x.min(), x.max()])
    label = f"$f^{{{power:g}}}$"
    _, labels_in_legend = ax.get_legend_handles_labels()
    style: dict[str, Any] = {
        "color": colour,
        "linewidth": 0.9,
        "linestyle": ":",
        "label": "_" if label in labels_in_legend else label,
    }
    ax.plot(ends, y[lowest] * (ends / x[lowest]) ** power, **style)
    ax.set(yscale="log")
    scale_axis(ax, "x", x)


def plot_lines(spectrum: SpectralFunction, ax: Axes) -> Axes:
    """Draw the spectral function over the frequency at six wave vectors, evenly picked, or at all
    of fewer.

    The axis of frequency ends above the highest frequency at which a line has a thousandth of the
    highest peak, or more.
    """
    drawn_numbers = pick_evenly(len(spectrum.q), len(COLOURS))
    values = spectrum.values[drawn_numbers]
    is_seen = values.max(axis=0) >= _LEAST_LINE * values.max()  # (n_f,), all if all are zero
    top = float(spectrum.frequencies[np.flatnonzero(is_seen)[-1]])
    unit = HertzPrefix.for_top(top)
    for colour, number in zip(COLOURS, drawn_numbers, strict=False):
        ax.plot(
            spectrum.frequencies / unit.hertz,
            spectrum.values[number] * unit.hertz,
            color=colour,
            linewidth=0.9,
            label=f"|q| = {spectrum.wavenumber[number]:.4g} /m",
        )
    ax.set(
        xlabel=f"Frequency ({write_hertz(unit)})",
        xlim=(0.0, 1.05 * top / unit.hertz),
        ylim=(0.0, None),
        ylabel=f"Spectral function, {spectrum.polarisation} (1/{write_hertz(unit)})",
    )
    ax.legend()
    return ax


def plot_sample_dos(
    dos: SpectralDensity, ax: Axes, *, errors: Mapping[str, ArrayLike] | None = None
) -> Axes:
    """Draw the density of states of a network per ball: the total and the parts of translation and
    rotation, with their standard errors as bands.

    ``errors`` are further standard errors (n,), 1/Hz, nan where unknown, by the names of the
    densities: those that errors of parameters cause, which add up in squares with the density's
    own. Raises :class:`~granphon.base.errors.InputError` for errors of another shape, and for
    ``errors`` that are no mapping.
    """
    frequencies = dos.frequencies
    densities = [("black", "total", dos.total, dos.error)]
    if np.any(dos.rotational > 0.0):
        translational = dos.translational, dos.translational_error
        densities.append((COLOURS[0], "translational", *translational))
        densities.append((ORANGE, "rotational", dos.rotational, dos.rotational_error))
    labels = {"translational": "translation", "rotational": "rotation"}
    given_errors = name_errors(errors)
    curves = []
    for colour, name, density, own_error in densities:
        error = own_error
        if name in given_errors:
            error_of_parameters = np.nan_to_num(read_errors(given_errors[name], density.shape))
            error = np.hypot(own_error, error_of_parameters)
        curves.append((colour, labels.get(name, name), frequencies, density, error))
    draw_densities(ax, curves)
    if any(np.any(error > 0.0) for *_, error in curves):
        ax.add_line(make_error_handle())
    ax.legend()
    return ax


def sweep_dos_figure(dataset: Dataset) -> Figure:
    """Draw a figure, one column wide, of the densities of states of the arrays of a sweep, with
    standard errors as bands.

    A state is a load, a medium and a combination of parameters, and has one colour. If there are
    more than eight states, at most eight are drawn: load, medium or some parameters are held at
    their first value. The legend then tells these values, and the number of all states. Raises
    :class:`~granphon.base.errors.InputError` if the sweep has no densities of states.
    """
    states, handles = pick_states(dataset, "dos_total", "densities of states of arrays")
    curves: list[tuple[Any, str, Array, Array, Array]] = []
    for colour, read_variable in states:
        frequencies = read_variable("dos_frequency")
        total = read_variable("dos_total")
        errors = read_variable("dos_error")
        if "dos_total_error" in dataset:
            # the errors of parameters and those of samples add up
            errors = np.hypot(errors, np.nan_to_num(read_variable("dos_total_error")))
        curves.append((colour, "", frequencies, total, errors))
    if any(np.any(errors > 0.0) for *_, errors in curves):
        handles.append(make_error_handle())
    with styled_figure(2.8) as figure:
        draw_densities(figure.subplots(), curves)
        add_legend(figure, handles, room=1)
    return figure


def sweep_spectra_figure(dataset: Dataset) -> Figure:
    """Draw a figure of the plane waves in the arrays of a sweep, one column wide; states are chosen
    as by :func:`sweep_dos_figure`.

    For each polarisation the upper panel has the frequencies along the path, with bars as long as
    the line is wide (full, at half maximum) where the width is resolved in at least half of the
    samples. The lower panel has the attenuation of the resolved lines over their frequency, both
    logarithmic, with bars of its standard error. Raises
    :class:`~granphon.base.errors.InputError` if the sweep has no spectra.
    """
    states, handles = pick_states(dataset, "line_frequency", "spectra of arrays")
    count = dataset.sizes["polarisation"]
    unit = HertzPrefix.for_top(float(np.nanmax(dataset["line_frequency"].values)))
    labels = [str(label) for label in dataset["labels_of_path"].values]
    has_errors = "attenuation_error" in dataset
    # corners over the length of the path are the same in all states: paths of balls of several
    # diameters differ in length alone
    _, read_first = states[0]
    corners = read_first("path_corners")
    relative_corners = corners / corners[-1]
    with styled_figure(0.4 + 4.2 * count) as figure:
        ratios = [1.2, 1.0] * count
        panels = figure.subplots(2 * count, 1, squeeze=False, height_ratios=ratios)[:, 0]
        for number, name in enumerate(dataset["polarisation"].values.tolist()):
            above, below = panels[2 * number : 2 * number + 2]
            frequencies = []  # those of the lines that each state has in the lower panel
            for colour, read_variable in states:
                _draw_line_frequencies(above, read_variable, number, colour, unit)
                frequencies.append(
                    _draw_attenuation(
                        below, read_variable, number, colour, unit, has_errors=has_errors
                    )
                )
            name_corners(above, relative_corners, labels)
            above.set(ylabel=f"Frequency, {name} ({write_hertz(unit)})", ylim=(0.0, None))
            _scale_attenuation(below, np.concatenate(frequencies))
            below.set(
                xlabel=f"Frequency ({write_hertz(unit)})", ylabel=f"Attenuation, {name} (1/m)"
            )
        add_legend(figure, handles, room=1)
    return figure


def _draw_line_frequencies(
    ax: Axes, read_variable: Callable[..., Array], number: int, colour: Any, unit: HertzPrefix
) -> None:
    """Draw the frequencies of the lines of one polarisation in a state over the path, whose length
    is 1. Where the width of a line is resolved, a bar has this width as its length.

    ``read_variable`` returns the values of a variable in the state; ``number`` is that of the
    polarisation.
    """
    x = read_variable("path_distance") / read_variable("path_corners")[-1]
    peak = read_variable("line_frequency", number) / unit.hertz
    width = read_variable("line_width", number) / unit.hertz
    is_resolved = read_variable("line_resolved", number) >= _LEAST_RESOLVED
    half_width = np.where(is_resolved, 0.5 * width, 0.0)
    style: dict[str, Any] = {"fmt": "o", "markersize": 2.4, "color": colour}
    dots, *_ = ax.errorbar(x, peak, half_width, elinewidth=0.8, zorder=3, **style)
    dots.set_clip_on(False)


def _draw_attenuation(
    ax: Axes,
    read_variable: Callable[..., Array],
    number: int,
    colour: Any,
    unit: HertzPrefix,
    *,
    has_errors: bool,
) -> Array:
    """Draw the attenuation of the resolved lines of one polarisation in a state over their
    frequency, with bars of the standard errors where these are known; return the frequencies (m,)
    of the lines in this ``unit``.

    ``read_variable`` and ``number`` are as in :func:`_draw_line_frequencies`; ``has_errors`` says
    whether the data set has standard errors.
    """
    attenuation = read_variable("attenuation", number)
    is_resolved = read_variable("line_resolved", number) >= _LEAST_RESOLVED
    is_drawn = is_resolved & (attenuation > 0.0)  # the axis is logarithmic
    frequencies = (read_variable("line_frequency", number) / unit.hertz)[is_drawn]
    bars = None
    if has_errors:
        errors = np.nan_to_num(read_variable("attenuation_error", number)[is_drawn])
        bars = _limit_bars(attenuation[is_drawn], errors)
    style: dict[str, Any] = {"fmt": "o", "markersize": 2.4, "color": colour}
    ax.errorbar(frequencies, attenuation[is_drawn], bars, elinewidth=0.7, **style)
    return frequencies


def _scale_attenuation(ax: Axes, frequencies: Array) -> None:
    """Make the axes of attenuation over ``frequencies`` (n,), in the unit of the axis, logarithmic;
    without a frequency, write that no line is resolved.
    """
    if frequencies.size:
        scale_axis(ax, "x", frequencies)
        # the limits of the data hold the ends of bars too
        scale_axis(ax, "y", np.asarray(ax.dataLim.intervaly))
        return
    style: dict[str, Any] = {"transform": ax.transAxes, "ha": "center", "va": "center"}
    ax.text(0.5, 0.5, "no line is resolved", color="0.4", **style)
    ax.set(xticks=[], yticks=[])


def _limit_bars(values: Array, errors: Array) -> Array:
    """Return the lengths (2, n) of the error bars below and above ``values`` (n,) on a logarithmic
    axis: a bar ends at a tenth of the value at the lowest, because the axis has no zero.
    """
    return np.array([np.minimum(errors, 0.9 * values), errors])


def pick_states(
    dataset: Dataset, name: str, words: str
) -> tuple[list[tuple[Any, Callable[..., Array]]], list[Line2D]]:
    """Return the states that are drawn, in order of load, and their legend; InputError, with the
    ``words`` for the variable, if the sweep has no variable ``name``, and for a data set without an
    axis of loads or of media.

    Each state is returned as a colour and a function ``read_variable(variable, polarisation=0)``,
    which returns the values of a variable in the state, for one polarisation if the variable has
    several. Of too many states at most eight are drawn: some dimensions are held at their first
    value, which the legend gives, and of the remaining states some are taken evenly.
    """
    if name not in dataset:
        raise InputError(f"the sweep has no {words}", mend="Draw another figure")
    require_axes(dataset)
    dimensions = ("load", "medium", *list_parameters(dataset))
    counts = {dim: dataset.sizes[dim] for dim in dimensions if dim in dataset[name].dims}
    held_dimensions = choose_held(counts, _MOST_STATES)
    remaining_states = dataset.isel({dim: [0] for dim in held_dimensions})
    labels, indices = _list_states(remaining_states, name)
    drawn_numbers = pick_evenly(len(labels), _MOST_STATES)
    # the light end of the colours is too pale; a single state has a colour of its dark end
    positions = np.linspace(0.0, 0.85, len(drawn_numbers)) if len(drawn_numbers) > 1 else [0.3]
    shades = colormaps["viridis"](positions)

    def read_variable(index: dict[str, int], variable: str, polarisation: int = 0) -> Array:
        """Return the values of a variable in the state with this ``index``."""
        # variables without polarisations have no such dimension
        state_index = index | {"polarisation": polarisation}
        values = remaining_states[variable].isel(state_index, missing_dims="ignore")
        return np.asarray(values, float)

    states = list[tuple[Any, Callable[..., Array]]]()
    handles = list[Line2D]()
    for shade, number in zip(shades.tolist(), drawn_numbers, strict=True):
        states.append((tuple(shade), partial(read_variable, indices[number])))
        handles.append(Line2D([], [], color=tuple(shade), label=labels[number]))
    n_states = math.prod(counts.values())
    if n_states > len(drawn_numbers):
        values = _describe_held_dimensions(remaining_states, name, held_dimensions)
        note = ", ".join([*values, f"{len(drawn_numbers)} of {n_states} are drawn"])
        handles.append(Line2D([], [], linestyle="none", label=note))
    return states, handles


def _describe_held_dimensions(dataset: Dataset, name: str, dimensions: Sequence[str]) -> list[str]:
    """Return in words the only value that each of these ``dimensions`` has in a data set; ``name``
    is a variable of the data set that has them.
    """
    # all lines of the variable have these values
    facts, _index = describe_lines(dataset, name)[0]
    texts = []
    for dimension in dimensions:
        if dimension == "load":
            _kind, text = describe_value(dataset, find_load(dataset), 0)
        else:
            # the fact of a medium or a parameter has the words of the legend
            kind, _text = describe_value(dataset, dimension, 0)
            text = facts[kind]
        texts.append(text)
    return texts


def _list_states(dataset: Dataset, name: str) -> tuple[list[str], list[dict[str, int]]]:
    """Return the label of each state in which a sweep has the variable ``name``, in order of load,
    and the index of each state by dimension.

    A label has the load, if the sweep has several, and the facts in which the states differ. A
    state that is alone has its load as the label.
    """
    load = find_load(dataset)
    loads = dataset[load].values
    unit = dataset[load].attrs.get("units", "")
    lines = describe_lines(dataset, name)
    kinds, _ = find_differing([facts for facts, _ in lines])
    labels = []
    indices = []
    for number in np.argsort(loads, kind="stable").tolist():
        load_text = write_value(float(loads[number]), unit)
        for facts, index in lines:
            texts = [facts[kind] for kind in kinds]
            if len(loads) > 1:
                texts.insert(0, load_text)
            labels.append(", ".join(texts) or load_text)
            indices.append(index | {"load": number})
    return labels, indices


def plot_seismogram(
    pulse: Pulse, ax: Axes, balls: int = 6, *, errors: Mapping[str, ArrayLike] | None = None
) -> Axes:
    """Draw over time the burst of the source, the coherent signal, and the signals of some single
    balls, one above the other.

    ``balls`` is the number of single balls; fewer are drawn if the pulse has fewer receivers. Means
    over further planes are drawn too, if the pulse has such planes. The burst is divided by its
    greatest absolute value, and all other traces by the greatest absolute value of all signals of
    balls; they are flat if all signals are zero. If the time of flight by the envelope is known, a
    mark stands at that time plus half of the duration of the burst, where the middle of the burst
    arrives. The standard errors (n_t,), m/s, under "coherent" in ``errors``, nan where unknown, are
    a band about the mean; ``errors`` of other names are not drawn.

    Raises :class:`~granphon.base.errors.InputError` if ``balls`` is no whole number from zero up,
    for errors of another shape, and for ``errors`` that are no mapping.
    """
    seconds, unit = prefixed(float(pulse.times[-1]), "s")
    times = pulse.times / seconds
    greatest_signal = max(float(np.max(np.abs(pulse.signals))), LEAST_LIMIT)
    drawn_balls = pick_evenly(len(pulse.signals), whole_number("balls", balls, 0))
    curves = _list_traces(pulse, drawn_balls, greatest_signal)
    heights_of_curves = [_HEIGHT * trace - row for row, (_, trace, _) in enumerate(curves)]
    for heights_of_curve, (_, _, colour) in zip(heights_of_curves, curves, strict=True):
        ax.plot(times, heights_of_curve, color=colour, linewidth=0.7)
    given_errors = name_errors(errors)
    if "coherent" in given_errors:
        mean_errors = read_errors(given_errors["coherent"], pulse.times.shape)
        heights_of_errors = _HEIGHT * mean_errors / greatest_signal
        draw_error_band(ax, times, heights_of_curves[1], heights_of_errors, BLUE, "errors")
    ax.set_yticks(-np.arange(len(curves)), [name for name, _, _ in curves])
    ax.tick_params(axis="y", length=0)
    arrival = ": its arrival is not known"
    if not pulse.why_unknown:
        time = pulse.time_of_flight
        middle = time + 0.5 * pulse.cycles / pulse.frequency  # of the burst when it arrives
        ax.axvline(middle / seconds, color="black", linewidth=0.6, dashes=(3, 2))
        arrival = f" in {time / seconds:.4g} {write_unit(unit)}: {pulse.distance / time:.4g} m/s"
    ax.set(xlabel=f"Time ({write_unit(unit)})", xlim=times[[0, -1]], ylim=(-len(curves) + 0.4, 0.6))
    ax.set_title(f"{write_unit(write_quantity(pulse.distance, 'm', 4))}{arrival}")
    return ax


def _list_traces(
    pulse: Pulse, drawn_balls: Sequence[int], greatest_signal: float
) -> list[tuple[str, Array, str]]:
    """Return the name, the values (n_t,) and the colour of each trace of a seismogram: the burst
    over its greatest absolute value, and over the ``greatest_signal``, m/s, the mean, the means
    over further planes and the signals of the ``drawn_balls``, which are numbers of receivers.
    """
    traces = [
        ("sent", pulse.sent / np.max(np.abs(pulse.sent)), GUIDE),
        ("mean", pulse.coherent / greatest_signal, BLUE),
    ]
    for distance, signal in zip(pulse.plane_distances, pulse.planes, strict=True):
        name = f"at {write_unit(write_quantity(distance, 'm', 3))}"
        traces.append((name, signal / greatest_signal, BLUE))
    for number in drawn_balls:
        name = f"ball {pulse.receivers[number]}"
        traces.append((name, pulse.signals[number] / greatest_signal, VERMILION))
    return traces


def pulse_figure(pulse: Pulse, errors: Mapping[str, ArrayLike] | None = None) -> Figure:
    """Draw a figure, one column wide: the seismogram, and the coherent part beside the speckle.

    The standard ``errors`` (n_t,), m/s, of the signals "coherent", "envelope" and "speckle" over
    time, nan where unknown, are bands; ``errors`` of other names are not drawn. Raises
    :class:`~granphon.base.errors.InputError` for errors of another shape, and for ``errors`` that
    are no mapping.
    """
    given_errors = name_errors(errors)
    with styled_figure(4.2) as figure:
        above, below = figure.subplots(2, 1, sharex=True, height_ratios=[1.9, 1.0])
        plot_seismogram(pulse, above, errors=given_errors)
        above.tick_params(axis="x", labelbottom=True)  # a shared axis would hide them
        highest = float(max(pulse.envelope.max(), pulse.speckle_amplitude.max()))
        scale, unit = prefixed(highest, "m/s")
        times = np.asarray(above.lines[0].get_xdata())  # in the unit of the axis
        for name, values, colour, label in (
            ("envelope", pulse.envelope, BLUE, "coherent, envelope"),
            ("speckle", pulse.speckle_amplitude, VERMILION, "speckle, rms"),
        ):
            below.plot(times, values / scale, color=colour, linewidth=1.0, label=label)
            if name in given_errors:
                heights = read_errors(given_errors[name], values.shape) / scale
                draw_error_band(below, times, values / scale, heights, colour, f"{name}-errors")
        if {"coherent", "envelope", "speckle"} & set(given_errors):
            below.add_line(make_error_handle())
        below.set(
            xlabel=above.get_xlabel(), ylabel=f"Velocity ({write_unit(unit)})", ylim=(0.0, None)
        )
        # the legend stands above the panel, in which no corner is always free
        below.legend(loc="lower center", bbox_to_anchor=(0.5, 1.0), ncols=2, borderaxespad=0.2)
    return figure


def plot_frame(
    network: ContactNetwork, pulse: Pulse, frame: int, ax: Axes, most: float | None = None
) -> Axes:
    """Draw the balls of a network, seen along z, coloured by their velocity along the polarisation
    at one of the frames.

    ``frame`` is counted from 0, and ``most`` is the velocity, m/s, of the strongest colour; by
    default the greatest velocity of the frame. Balls at rest have the colour in the middle, also if
    all are at rest. Raises :class:`~granphon.base.errors.InputError` if the pulse has no such
    frame, for a ``network`` of another number of balls than that of the pulse, and for a ``most``
    that is not above zero.
    """
    _require_frames(network, pulse)
    number = whole_number("frame", frame, 0, len(pulse.frames) - 1)
    velocities = pulse.velocities[number] @ pulse.polarisation
    if most is None:
        limit = max(float(np.max(np.abs(velocities))), LEAST_LIMIT)
    else:
        limit = positive("most", most, "m/s")
    draw_balls(network, velocities, ax, MOTION, Normalize(-limit, limit))
    ax.set_title(f"{1e3 * pulse.frames[number]:.3f} ms")
    return ax


def _require_frames(network: ContactNetwork, pulse: Pulse) -> None:
    """Raise InputError for a pulse that has no frames, and for a ``network`` that is none or has
    another number of balls and walls than that of the pulse.
    """
    mend = "Give the network in which the pulse runs"
    require_instance("network", network, ContactNetwork, mend)
    if not len(pulse.frames):
        raise InputError("the pulse has no frames", mend="Give transmit the times of frames")
    n_balls = pulse.velocities.shape[1]
    if network.n_balls != n_balls:
        problem = f"the pulse runs in {n_balls} balls, and the network has {network.n_balls}"
        raise InputError(problem, mend=mend)


def animate_pulse(
    network: ContactNetwork, pulse: Pulse, interval: float = 60.0, figure: Figure | None = None
) -> Any:
    """Return a ``matplotlib.animation.FuncAnimation`` of the wave that crosses the array, one
    picture for each frame.

    ``interval`` is the time between pictures, ms; ``figure`` is drawn on, by default a new figure.
    Raises :class:`~granphon.base.errors.InputError` for a pulse without frames, for a ``network``
    that :func:`plot_frame` refuses, and for an ``interval`` that is not above zero.
    """
    from matplotlib.animation import FuncAnimation

    _require_frames(network, pulse)
    milliseconds = positive("interval", interval, "ms")
    velocities = pulse.velocities @ pulse.polarisation  # (frames, n)
    with styled_figure(COLUMN_WIDTH, dpi=150) as new_figure:
        figure = new_figure if figure is None else figure
        ax = figure.subplots()
        # half of the greatest velocity has the strongest colour, so that weak waves are seen too
        limit = max(0.5 * float(np.max(np.abs(velocities))), LEAST_LIMIT)
        plot_frame(network, pulse, 0, ax, limit)
    (balls,) = ax.collections
    order = order_balls(network)

    def show(frame: int) -> Any:
        """Colour the balls by their velocities in a frame; return what has changed."""
        balls.set_array(velocities[frame][order])
        ax.set_title(f"{1e3 * pulse.frames[frame]:.3f} ms")
        return (balls,)

    draw: Callable[..., Any] = show  # the stubs know functions of other types only
    return FuncAnimation(figure, draw, frames=len(pulse.frames), interval=milliseconds, blit=False)


def _label_decibels(name: str) -> str:
    """Return the label of an axis of the variable ``name`` in decibels over one SI unit."""
    entry = CATALOGUE[name]
    reference = "" if entry.unit == "1" else f" re 1 {entry.unit}"
    return f"{entry.label} (dB{reference})"


def _find_decibels(magnitude: Array) -> Array:
    """Return a ``magnitude`` (...), SI, in decibels over one SI unit, nan for zero."""
    return 20.0 * np.log10(np.where(magnitude > 0.0, magnitude, np.nan))


def _draw_lines(
    above: Axes,
    below: Axes,
    frequencies: Array,
    name: str,
    lines: Iterable[tuple[Array, Array, Any, float, str]],
) -> None:
    """Draw over ``frequencies`` (n,), Hz, the magnitudes of the variable ``name``, in dB, on the
    Axes ``above``, and phases, in units of pi, on the Axes ``below``.

    ``lines`` are (magnitudes (n,), SI, phases (n,), rad, colour, width in points, label); a line
    with an empty label is not in the legend.
    """
    prefix = HertzPrefix.for_top(float(frequencies[-1]))
    shown_frequencies = frequencies / prefix.hertz
    for magnitude, phase, colour, width, label in lines:
        above.plot(
            shown_frequencies,
            _find_decibels(magnitude),
            color=colour,
            linewidth=width,
            label=label or None,
        )
        below.plot(shown_frequencies, phase / math.pi, color=colour, linewidth=width)
    above.set(ylabel=_label_decibels(name))
    below.set(
        xlabel=f"Frequency ({write_hertz(prefix)})",
        ylabel="Phase (π)",
        xlim=(shown_frequencies[0], shown_frequencies[-1] if len(shown_frequencies) > 1 else None),
    )


def _mark_peaks(ax: Axes, frequencies: Array, heights: Array, top: float, colour: Any) -> None:
    """Draw dots at the peaks of responses, at ``frequencies`` (m,), Hz, with ``heights`` (m,), SI.
    The greatest frequency of the responses, ``top``, Hz, decides the unit of the axis.
    """
    prefix = HertzPrefix.for_top(top)
    ax.scatter(frequencies / prefix.hertz, _find_decibels(heights), s=4.0, color=colour, zorder=3)


def plot_response(response: Response, above: Axes, below: Axes) -> tuple[Axes, Axes]:
    """Draw magnitudes, in dB over one SI unit, and phases, in units of pi, of all receivers over
    the frequency.

    Of more than six receivers, such as those of a plane, each is a thin grey line, and their mean
    is a strong line.
    """
    curves: list[tuple[NDArray[Any], Any, float, str]]  # responses, colour, width of line, label
    if len(response.receivers) <= _MOST_RECEIVERS:
        receivers = zip(response.values.T, COLOURS, response.names, strict=False)
        curves = [(values, colour, 1.2, name) for values, colour, name in receivers]
    else:
        curves = [(values, GUIDE, 0.4, "") for values in response.values.T]
        curves.append((response.coherent, COLOURS[0], 1.4, "mean"))
    lines: list[tuple[Array, Array, Any, float, str]] = []
    for values, colour, width, label in curves:
        phase = np.unwrap(np.angle(values))
        lines.append((np.abs(values), phase, colour, width, label))
    _draw_lines(above, below, response.frequencies, RESPONSES[response.quantity], lines)
    if len(response.receivers) > 1:
        above.legend()
    return above, below


def response_figure(response: Response) -> Figure:
    """Draw a figure, one column wide: magnitude above, phase below."""
    with styled_figure(3.6) as figure:
        above, below = figure.subplots(2, 1, sharex=True, height_ratios=[1.6, 1.0])
        plot_response(response, above, below)
    return figure


def responses_figure(dataset: Dataset) -> Figure:
    """Draw the responses in a data set of states, one column wide.

    For one state there are magnitude and phase of at most six receivers, each in a colour. For
    several states there are magnitude and phase of at most four receivers, each with a curve for
    each state; states are chosen as by :func:`sweep_dos_figure`. Dots are the peaks. For six loads
    or more the magnitude is a map over load and frequency, for each receiver and each medium and
    combination of parameters; at most four maps are drawn. Receivers and maps are taken evenly, and
    the figure gives the number of all if some are left out.

    Raises :class:`~granphon.base.errors.InputError` if the data set has no responses.
    """
    # without a response any name will do: pick_states raises
    name = next((quantity for quantity in RESPONSES.values() if quantity in dataset), "receptance")
    states, handles = pick_states(dataset, name, "responses")
    if dataset.sizes["load"] >= _LOADS_OF_MAP:
        return _map_figure(dataset, name)
    receivers = dataset["receiver"].values.astype(str).tolist()
    panels = _share_out_responses(states, receivers)
    with styled_figure(3.6 * len(panels)) as figure:
        ratios = [1.6, 1.0] * len(panels)
        axes = figure.subplots(2 * len(panels), 1, squeeze=False, height_ratios=ratios)[:, 0]
        for panel, above, below in zip(panels, axes[::2], axes[1::2], strict=True):
            above.sharex(below)
            above.tick_params(labelbottom=False)
            _draw_states(above, below, dataset, name, panel.curves)
            if panel.title:
                above.set_title(panel.title)
        if len(states) == 1:  # its curves differ in the receiver
            (panel,) = panels
            handles = [
                Line2D([], [], color=colour, label=receivers[number])
                for _read, number, colour in panel.curves
            ]
        drawn_receivers = {number for panel in panels for _read, number, _colour in panel.curves}
        if len(drawn_receivers) < len(receivers):
            words = f"{len(drawn_receivers)} of {len(receivers)} receivers are drawn"
            handles.append(Line2D([], [], linestyle="none", label=words))
        if f"{name}_error" in dataset:
            handles.append(make_error_handle())
        if len(handles) > 1:
            add_legend(figure, handles, room=1)
    return figure


class _ResponsePanel(NamedTuple):
    """A pair of axes of responses: its ``title``, empty for none, and its ``curves``, see
    :func:`_draw_states`.
    """

    title: str
    curves: list[tuple[Callable[..., Array], int, Any]]


def _share_out_responses(
    states: Sequence[tuple[Any, Callable[..., Array]]], receivers: Sequence[str]
) -> list[_ResponsePanel]:
    """Return the panels of the responses of ``states``, each a colour and the function that returns
    the values of a variable. One state has a panel with a curve for each receiver, at most
    ``_MOST_RECEIVERS``. Several states have a panel for each receiver, at most ``_MOST_PANELS``,
    with a curve for each state. ``receivers`` are the names of all; those drawn are taken evenly.
    """
    if len(states) == 1:
        ((_colour, read_variable),) = states
        pairs = zip(pick_evenly(len(receivers), _MOST_RECEIVERS), COLOURS, strict=False)
        curves = [(read_variable, receiver, colour) for receiver, colour in pairs]
        return [_ResponsePanel("", curves)]
    return [
        _ResponsePanel(
            receivers[receiver] if len(receivers) > 1 else "",
            [(read_variable, receiver, colour) for colour, read_variable in states],
        )
        for receiver in pick_evenly(len(receivers), _MOST_PANELS)
    ]


def _draw_states(
    above: Axes,
    below: Axes,
    dataset: Dataset,
    name: str,
    curves: Sequence[tuple[Callable[..., Array], int, Any]],
) -> None:
    """Draw the variable ``name``, a magnitude of responses, and their phases below, with dots at
    the peaks if the data set has peaks.

    ``curves`` are (function that returns the values of a variable in a state, number of the
    receiver, colour).
    """
    frequencies = dataset["response_frequency"].values
    lines: list[tuple[Array, Array, Any, float, str]] = []
    x = frequencies / HertzPrefix.for_top(float(frequencies[-1])).hertz
    for read_variable, receiver, colour in curves:
        magnitude = read_variable(name)[:, receiver]
        phase = read_variable("response_phase")[:, receiver]
        lines.append((magnitude, phase, colour, 1.2, ""))
        gid = f"errors-{receiver}"
        if f"{name}_error" in dataset:
            errors = _limit_bars(magnitude, read_variable(f"{name}_error")[:, receiver])
            draw_error_band(above, x, magnitude, errors, colour, gid, _find_decibels)
        if "response_phase_error" in dataset:
            errors = read_variable("response_phase_error")[:, receiver] / math.pi
            draw_error_band(below, x, phase / math.pi, errors, colour, gid)
    _draw_lines(above, below, frequencies, name, lines)
    if "peaks_frequency" not in dataset:
        return
    # a resonance narrower than the step of frequencies is higher than the drawn curve
    for read_variable, receiver, colour in curves:
        peaks = read_variable("peaks_frequency")[receiver]
        heights = read_variable(f"peaks_{name}")[receiver]
        _mark_peaks(above, peaks, heights, float(frequencies[-1]), colour)


def _map_figure(dataset: Dataset, name: str) -> Figure:
    """Draw the variable ``name``, a magnitude of responses, as maps over load and frequency, one
    column wide.

    Each medium, combination of parameters and receiver has a map; at most four, evenly taken, are
    drawn.
    """
    load = find_load(dataset)
    prefix = HertzPrefix.for_top(float(dataset["response_frequency"].values[-1]))
    order = np.argsort(dataset[load].values, kind="stable")
    x = dataset[load].values[order]
    y = dataset["response_frequency"].values / prefix.hertz
    lines = describe_lines(dataset, name)
    receivers = dataset["receiver"].values.astype(str).tolist()
    kinds, _ = find_differing([facts for facts, _ in lines])
    # (facts in words, index of the line in the data set, number of the receiver) of each map
    panels = [(facts, index, number) for facts, index in lines for number in range(len(receivers))]
    drawn_numbers = pick_evenly(len(panels), _MOST_PANELS)
    with styled_figure(0.3 + 2.7 * len(drawn_numbers)) as figure:
        axes = figure.subplots(len(drawn_numbers), 1, squeeze=False, sharex=True)[:, 0]
        chosen_panels = [panels[number] for number in drawn_numbers]
        for ax, (facts, index, receiver) in zip(axes, chosen_panels, strict=True):
            responses = dataset[name].isel(index | {"receiver": receiver}, missing_dims="ignore")
            _draw_decibel_map(ax, x, y, _find_decibels(responses.values[order]), name)
            ax.set(ylabel=f"Frequency ({write_hertz(prefix)})", ylim=(y[0], y[-1]))
            words = [facts[kind] for kind in kinds]
            if len(receivers) > 1:
                words.append(receivers[receiver])
            if words:
                ax.text(0.02, 0.97, ", ".join(words), transform=ax.transAxes, va="top")
        scale_axis(axes[-1], "x", x)
        axes[-1].set(xlabel=axis_label(load, dataset[load].attrs.get("units")), xlim=(x[0], x[-1]))
        if len(drawn_numbers) < len(panels):
            axes[-1].set_title(f"{len(drawn_numbers)} of {len(panels)} maps are drawn")
    return figure


def _draw_decibel_map(ax: Axes, x: Array, y: Array, decibels: Array, name: str) -> None:
    """Draw magnitudes (n_x, n_y) of the variable ``name``, dB, as a map over loads ``x`` (n_x,) and
    frequencies ``y`` (n_y,), with its colour bar.

    The colours reach from the greatest magnitude down to the least, but no further than
    ``_DECIBELS``. Magnitudes that are nan, where nothing moves, have no colour; if there are no
    others, the colours end at zero decibels.
    """
    finite_decibels = decibels[np.isfinite(decibels)]
    highest = float(finite_decibels.max()) if finite_decibels.size else 0.0
    lowest = max(highest - _DECIBELS, float(finite_decibels.min(initial=highest)))
    mesh = ax.pcolormesh(
        x,
        y,
        decibels.T,
        shading="nearest",
        cmap=SPECTRUM,
        rasterized=True,
        vmin=lowest,
        vmax=highest,
    )
    add_bar(ax, mesh, _label_decibels(name))


def transfer_fit_figure(fit: DampingFit) -> Figure:
    """Draw a figure, one column wide: data with their errors and the fit, magnitude above, phase in
    units of pi below.
    """
    data = fit.measured
    order = np.argsort(fit.measured.frequencies)
    prefix = HertzPrefix.for_top(float(np.max(data.frequencies)))
    unit = fit.unit
    frequencies = data.frequencies[order] / prefix.hertz
    look_of_data = {
        "fmt": "o",
        "color": COLOURS[1],
        "markersize": 2.2,
        "elinewidth": 0.6,
        "label": "data",
        "zorder": 1.0,
    }
    phase = np.unwrap(fit.phase[order])
    with styled_figure(3.6) as figure:
        above, below = figure.subplots(2, 1, sharex=True, height_ratios=[1.6, 1.0])
        errors = None if data.sigma is None else data.sigma[order]
        above.errorbar(frequencies, data.magnitude[order], errors, **look_of_data)
        if data.phase is not None and data.phase_sigma is not None:
            # a phase is known but for whole turns: the phase nearest to the fit is drawn
            difference = np.angle(np.exp(1j * (data.phase - fit.phase)))[order]
            errors = data.phase_sigma[order] / math.pi
            below.errorbar(frequencies, (phase + difference) / math.pi, errors, **look_of_data)
        for axes, values in ((above, fit.magnitude[order]), (below, phase / math.pi)):
            axes.plot(frequencies, values, color=COLOURS[0], linewidth=1.2, label="fit", zorder=2.0)
        label = "Magnitude" if unit == "1" else f"Magnitude ({unit})"
        above.set(yscale="log", ylabel=label)
        below.set(xlabel=f"Frequency ({write_hertz(prefix)})", ylabel="Phase (π)")
        if len(frequencies) > 1:  # one frequency has room to both sides
            below.set_xlim(frequencies[0], frequencies[-1])
        above.legend()
    return figure


def complex_bands_figure(bands: ComplexBands) -> Figure:
    """Draw the frequency over wave numbers: over real parts of running waves to the left, over the
    decay (the imaginary part) of all other waves to the right.

    Waves towards higher layers are drawn, in units of pi over the height h of a layer. Grey dots to
    the left are the real parts of waves that decay. Waves that decay faster than 1.5 pi/h are left
    out.
    """
    unit = HertzPrefix.for_top(float(bands.frequencies.max()))
    wave_numbers = bands.forward * bands.height / math.pi
    f = np.broadcast_to(bands.frequencies[:, None] / unit.hertz, wave_numbers.shape)
    # running waves stand first in each row
    is_running = np.arange(wave_numbers.shape[1]) < bands.running[:, None]
    is_decaying = ~is_running & (wave_numbers.imag < _MOST_DECAY)
    with styled_figure(2.8) as figure:
        left, right = figure.subplots(1, 2, sharey=True)
        dots = {"linestyle": "none", "marker": "o", "markersize": 1.4, "markeredgewidth": 0.0}
        left.plot(wave_numbers.real[is_decaying], f[is_decaying], color=GUIDE, **dots)
        left.plot(wave_numbers.real[is_running], f[is_running], color=BLUE, **dots)
        right.plot(wave_numbers.imag[is_decaying], f[is_decaying], color=VERMILION, **dots)
        # room for the dots at the border
        left.set(
            xlabel="Re $k$ ($\\pi/h$)",
            ylabel=f"Frequency ({write_hertz(unit)})",
            xlim=(-1.0 - _BORDER, 1.0 + _BORDER),
        )
        height = max(float(np.ptp(f)), _LEAST_HEIGHT * float(f.max()))
        border = 0.5 * _BORDER * height
        left.set_ylim(float(f.min()) - border, float(f.max()) + border)
        right.set(xlabel="Im $k$ ($\\pi/h$)", xlim=(-0.5 * _BORDER, _MOST_DECAY))
    return figure


def plot_transmission(result: Transmission, ax: Axes) -> Axes:
    """Draw the transmitted and the reflected part of the energy over the frequency, where a wave
    runs in; return ``ax``.

    Raises :class:`~granphon.base.errors.InputError` for one frequency.
    """
    if len(result.frequencies) < 2:
        raise InputError("a curve needs several frequencies", mend="Give more of them")
    unit = HertzPrefix.for_top(float(result.frequencies.max()))
    has_incoming = result.modes[:, 0] > 0
    frequencies = result.frequencies / unit.hertz
    for energy, colour, style, label in (
        (result.transmitted, BLUE, "-", "transmitted"),
        (result.reflected, VERMILION, "--", "reflected"),
    ):
        ax.plot(
            frequencies,
            np.where(has_incoming, energy, np.nan),
            style,
            color=colour,
            linewidth=1.0,
            label=label,
        )
    ax.set(
        xlabel=f"Frequency ({write_hertz(unit)})", ylabel="Part of the energy", ylim=(-0.02, 1.02)
    )
    ax.set_xlim(float(frequencies[0]), float(frequencies[-1]))
    ax.legend(loc="lower center", bbox_to_anchor=(0.5, 1.0), ncols=2, borderaxespad=0.2)
    return ax
