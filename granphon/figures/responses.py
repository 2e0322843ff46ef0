"""Figures over the frequency: responses, in dB, with their phase and over the load; fits to transfer functions; what passes.

What passes is told by complex bands, and by what passes a strip between crystals.
"""

from __future__ import annotations

import math
from collections.abc import Iterable
from typing import Any

from granphon.figures.scales import SPECTRUM, add_bar, add_legend, scale_axis, styled_figure

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from numpy.typing import NDArray

from granphon.base.errors import InputError
from granphon.base.scales import HertzPrefix
from granphon.figures.curves import describe_lines
from granphon.figures.style import BLUE, COLOURS, GUIDE, VERMILION, pick_evenly, print_hertz
from granphon.figures.waves import choose_states
from granphon.figures.words import find_differing
from granphon.fits.transfer import DampingFit
from granphon.observables.catalogue import CATALOGUE, axis_label
from granphon.phonons.complex_bands import ComplexBands
from granphon.runs.dataset import Dataset, find_load
from granphon.waves.response import QUANTITIES, Response
from granphon.waves.settings import RESPONSES
from granphon.waves.transmission import Transmission

Array = NDArray[np.float64]
#: number of receivers up to which each has a colour and an entry of the legend
_FEW = len(COLOURS)
#: greatest number of maps or of places
_PANELS = 4


def _label_decibels(name: str) -> str:
    unit = CATALOGUE[name].unit
    return f"{CATALOGUE[name].label} (dB{'' if unit == '1' else f' re 1 {unit}'})"


def _find_decibels(magnitude: Array) -> Array:
    """Return 20 log10 of magnitudes; nan of zero."""
    return 20.0 * np.log10(np.where(magnitude > 0.0, magnitude, np.nan))


def _draw_lines(
    above: Axes, below: Axes, frequencies: Array, name: str, lines: Iterable[tuple[Array, Array, Any, float, str]]
) -> None:
    """Draw magnitude and phase over frequencies, Hz: (magnitude, phase, colour, width, label) of each line."""
    prefix = HertzPrefix.for_top(float(frequencies[-1]))
    f = frequencies / prefix.hertz
    for magnitude, phase, colour, width, label in lines:
        above.plot(f, _find_decibels(magnitude), color=colour, linewidth=width, label=label or None)
        below.plot(f, phase / math.pi, color=colour, linewidth=width)
    above.set(ylabel=_label_decibels(name))
    below.set(xlabel=f"Frequency ({print_hertz(prefix)})", ylabel="Phase (π)", xlim=(f[0], f[-1] if len(f) > 1 else None))


def plot_response(response: Response, above: Axes, below: Axes) -> tuple[Axes, Axes]:
    """Draw magnitudes, in dB over one SI unit, and phases, in units of pi, of all receivers over frequency.

    Of more than six receivers, those of a plane say, each is a thin grey line, and their mean is a strong one.
    """
    few = len(response.receivers) <= _FEW
    balls = zip(response.values.T, COLOURS if few else [GUIDE] * len(response.receivers), response.receivers, strict=False)
    lines = [(values, colour, 1.2 if few else 0.4, f"ball {ball}" if few else "") for values, colour, ball in balls]
    lines += [] if few else [(response.coherent, COLOURS[0], 1.4, "mean")]
    shown = ((np.abs(one), np.unwrap(np.angle(one)), *style) for one, *style in lines)
    _draw_lines(above, below, response.frequencies, RESPONSES[response.quantity], shown)
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

    Of one state they are magnitude and phase of each receiver. Of several states magnitude and phase are drawn for each
    receiver, a state in each colour; of six loads and more the magnitude is a map over load and frequency, for each
    receiver and each medium and combination of parameters. Of more than eight states, and four
    receivers or maps, so many are drawn, evenly taken, and the figure says so.

    Raises :class:`~granphon.base.errors.InputError` if the data set has no responses.
    """
    name = next((one for one in RESPONSES.values() if one in dataset), "receptance")
    states, handles = choose_states(dataset, name, "responses")
    if dataset.sizes["load"] >= 6:
        return _map_figure(dataset, name)
    places, f = dataset["receiver"].values.astype(str).tolist(), dataset["response_frequency"].values
    chosen = pick_evenly(len(places), _FEW if len(states) == 1 else _PANELS)
    with styled_figure(3.6 * (1 if len(states) == 1 else len(chosen))) as figure:
        groups = [chosen] if len(states) == 1 else [[number] for number in chosen]
        panels = figure.subplots(2 * len(groups), 1, squeeze=False, height_ratios=[1.6, 1.0] * len(groups))[:, 0]
        for at, group in enumerate(groups):
            above, below = panels[2 * at : 2 * at + 2]
            above.sharex(below)
            above.tick_params(labelbottom=False)
            rows = [(take, number, COLOURS[row] if len(states) == 1 else colour)
                    for colour, take in states for row, number in enumerate(group)]  # fmt: skip
            lines = ((take(name)[:, n], take("response_phase")[:, n], colour, 1.2, "") for take, n, colour in rows)
            _draw_lines(above, below, f, name, lines)
            if len(states) > 1 and len(places) > 1:
                above.set_title(places[group[0]])
        if len(states) == 1:
            told = zip(COLOURS, (places[number] for number in chosen), strict=False)
            handles = [Line2D([], [], color=colour, label=place) for colour, place in told]
        if len(chosen) < len(places):
            handles.append(Line2D([], [], linestyle="none", label=f"{len(chosen)} of {len(places)} receivers are drawn"))
        if len(handles) > 1:
            add_legend(figure, handles, room=1)
    return figure


def _map_figure(dataset: Dataset, name: str) -> Figure:
    load, prefix = find_load(dataset), HertzPrefix.for_top(float(dataset["response_frequency"].values[-1]))
    order = np.argsort(dataset[load].values, kind="stable")
    x, y = dataset[load].values[order], dataset["response_frequency"].values / prefix.hertz
    lines, places = describe_lines(dataset, name), dataset["receiver"].values.astype(str).tolist()
    kinds, _ = find_differing([facts for facts, _ in lines])
    panels = [(facts, at, number) for facts, at in lines for number in range(len(places))]
    chosen = pick_evenly(len(panels), _PANELS)
    with styled_figure(0.3 + 2.7 * len(chosen)) as figure:
        axes = figure.subplots(len(chosen), 1, squeeze=False, sharex=True)[:, 0]
        for ax, (facts, at, number) in zip(axes, (panels[one] for one in chosen), strict=True):
            shown = _find_decibels(dataset[name].isel(at | {"receiver": number}, missing_dims="ignore").values[order])
            most = float(np.nanmax(shown))
            mesh = ax.pcolormesh(
                x, y, shown.T, shading="nearest", cmap=SPECTRUM, rasterized=True,
                vmin=max(most - 80.0, float(np.nanmin(shown))), vmax=most,  # 80 dB
            )  # fmt: skip
            add_bar(ax, mesh, _label_decibels(name))
            ax.set(ylabel=f"Frequency ({print_hertz(prefix)})", ylim=(y[0], y[-1]))
            told = [facts[kind] for kind in kinds] + [places[number]] * (len(places) > 1)
            if told:
                ax.text(0.02, 0.97, ", ".join(told), transform=ax.transAxes, va="top")
        scale_axis(axes[-1], "x", x)
        axes[-1].set(xlabel=axis_label(load, dataset[load].attrs.get("units")), xlim=(x[0], x[-1]))
        if len(chosen) < len(panels):
            axes[-1].set_title(f"{len(chosen)} of {len(panels)} maps are drawn")
    return figure


def transfer_fit_figure(fit: DampingFit) -> Figure:
    """Draw a figure, one column wide: data with their errors and the fit, magnitude above, phase in units of pi below."""
    data, order = fit.measured, np.argsort(fit.measured.frequencies)
    prefix, unit = HertzPrefix.for_top(float(np.max(data.frequencies))), QUANTITIES[fit.quantity]
    f = data.frequencies[order] / prefix.hertz
    points = {"fmt": "o", "color": COLOURS[1], "markersize": 2.2, "elinewidth": 0.6, "label": "data", "zorder": 1.0}
    turns = np.unwrap(fit.phase[order])
    with styled_figure(3.6) as figure:
        above, below = figure.subplots(2, 1, sharex=True, height_ratios=[1.6, 1.0])
        above.errorbar(f, data.magnitude[order], None if data.sigma is None else data.sigma[order], **points)
        if data.phase is not None and data.phase_sigma is not None:
            # a phase is known but for whole turns: that nearest to the fit
            off = np.angle(np.exp(1j * (data.phase - fit.phase)))[order]
            below.errorbar(f, (turns + off) / math.pi, data.phase_sigma[order] / math.pi, **points)
        for axes, values in ((above, fit.magnitude[order]), (below, turns / math.pi)):
            axes.plot(f, values, color=COLOURS[0], linewidth=1.2, label="fit", zorder=2.0)
        above.set(yscale="log", ylabel="Magnitude" + ("" if unit == "1" else f" ({unit})"))
        below.set(xlabel=f"Frequency ({print_hertz(prefix)})", ylabel="Phase (π)", xlim=(f[0], f[-1]))
        above.legend()
    return figure


def complex_bands_figure(bands: ComplexBands) -> Figure:
    """Draw wave numbers over frequency: real parts of waves that run to the left, decay of all others to the right.

    Shown are the waves towards higher layers, in units of pi over the height of a layer. Grey dots to the left are the real
    parts of waves that decay.
    """
    unit = HertzPrefix.for_top(float(bands.frequencies.max()))
    number = bands.forward * bands.height / math.pi
    f = np.broadcast_to(bands.frequencies[:, None] / unit.hertz, number.shape)
    runs = np.arange(number.shape[1]) < bands.running[:, None]
    decays = ~runs & (number.imag < 1.5)  # larger decay from layer to layer, in pi, is not drawn
    with styled_figure(2.8) as figure:
        left, right = figure.subplots(1, 2, sharey=True)
        dots = {"linestyle": "none", "marker": "o", "markersize": 1.4, "markeredgewidth": 0.0}
        left.plot(number.real[decays], f[decays], color=GUIDE, **dots)
        left.plot(number.real[runs], f[runs], color=BLUE, **dots)
        right.plot(number.imag[decays], f[decays], color=VERMILION, **dots)
        left.set(xlabel="Re $k$ ($\\pi/h$)", ylabel=f"Frequency ({print_hertz(unit)})", xlim=(-1.0, 1.0))
        left.set_ylim(float(f.min()), float(f.max()))
        right.set(xlabel="Im $k$ ($\\pi/h$)", xlim=(0.0, 1.5))
    return figure


def plot_transmission(result: Transmission, ax: Axes) -> Axes:
    """Draw the parts of the energy that pass, and that are sent back, over frequency; where no wave runs in, nothing."""
    if len(result.frequencies) < 2:
        raise InputError("a curve needs several frequencies", mend="Give more of them")
    unit, runs = HertzPrefix.for_top(float(result.frequencies.max())), result.modes[:, 0] > 0
    f = result.frequencies / unit.hertz
    for values, colour, style, label in (
        (result.transmitted, BLUE, "-", "transmitted"), (result.reflected, VERMILION, "--", "reflected"),
    ):  # fmt: skip
        ax.plot(f, np.where(runs, values, np.nan), style, color=colour, linewidth=1.0, label=label)
    ax.set(xlabel=f"Frequency ({print_hertz(unit)})", ylabel="Part of the energy", ylim=(-0.02, 1.02))
    ax.set_xlim(float(f[0]), float(f[-1]))
    ax.legend(loc="center right")
    return ax
