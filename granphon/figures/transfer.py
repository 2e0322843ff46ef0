"""Figure of a fit to a transfer function: measured and fitted magnitude and phase over the frequency."""

from __future__ import annotations

import math

from granphon.figures.scales import styled_figure

import numpy as np
from matplotlib.figure import Figure

from granphon.base.scales import HertzPrefix
from granphon.figures.style import COLOURS, print_hertz
from granphon.fits.transfer import DampingFit
from granphon.waves.response import QUANTITIES


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
