"""Figures of responses in frequency: magnitude and phase, one above the other."""

from __future__ import annotations

import math

from granphon.figures.scales import styled_figure

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from granphon.base.scales import HertzPrefix
from granphon.figures.style import COLOURS, GUIDE, print_hertz
from granphon.waves.response import QUANTITIES, Response

#: number of receivers up to which each has a colour and an entry of the legend
_FEW = len(COLOURS)
#: name of each quantity on an axis
_NAMES = {"displacement": "Receptance", "velocity": "Mobility", "transmissibility": "Transmissibility"}


def plot_response(response: Response, above: Axes, below: Axes) -> tuple[Axes, Axes]:
    """Draw magnitudes, on a logarithmic scale, and phases, in units of pi, of all receivers over frequency.

    Of more than six receivers, those of a plane say, each is a thin grey line, and their mean is a strong one.
    """
    prefix, count = HertzPrefix.for_top(float(response.frequencies[-1])), len(response.receivers)
    f, few = response.frequencies / prefix.hertz, count <= _FEW
    balls = zip(response.values.T, COLOURS if few else [GUIDE] * count, response.receivers, strict=False)
    lines = [(values, colour, 1.2 if few else 0.4, f"ball {ball}" if few else "") for values, colour, ball in balls]
    for values, colour, width, label in lines if few else [*lines, (response.coherent, COLOURS[0], 1.4, "mean")]:
        above.plot(f, np.abs(values), color=colour, linewidth=width, label=label or None)
        below.plot(f, np.unwrap(np.angle(values)) / math.pi, color=colour, linewidth=width)
    unit = QUANTITIES[response.quantity]
    above.set(yscale="log", ylabel=_NAMES[response.quantity] + ("" if unit == "1" else f" ({unit})"))
    below.set(xlabel=f"Frequency ({print_hertz(prefix)})", ylabel="Phase (π)", xlim=(f[0], f[-1] if len(f) > 1 else None))
    if count > 1:
        above.legend()
    return above, below


def response_figure(response: Response) -> Figure:
    """Draw a figure, one column wide: magnitude above, phase below."""
    with styled_figure(3.6) as figure:
        above, below = figure.subplots(2, 1, sharex=True, height_ratios=[1.6, 1.0])
        plot_response(response, above, below)
    return figure
