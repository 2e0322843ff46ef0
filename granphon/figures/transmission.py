"""Figures at given frequencies: complex bands, and what passes a strip between crystals."""

from __future__ import annotations

import math

from granphon.figures.scales import styled_figure

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from granphon.base.errors import InputError
from granphon.base.scales import HertzPrefix
from granphon.figures.style import BLUE, GUIDE, VERMILION, print_hertz
from granphon.phonons.complex_bands import ComplexBands
from granphon.waves.transmission import Transmission

#: largest decay from layer to layer that is drawn, in pi
_DECAY = 1.5


def complex_bands_figure(bands: ComplexBands) -> Figure:
    """Draw wave numbers over frequency: real parts of waves that run to the left, decay of all others to the right.

    Shown are the waves towards higher layers, in units of pi over the height of a layer. Grey dots to the left are the real
    parts of waves that decay.
    """
    unit = HertzPrefix.for_top(float(bands.frequencies.max()))
    number = bands.forward * bands.height / math.pi
    f = np.broadcast_to(bands.frequencies[:, None] / unit.hertz, number.shape)
    runs = np.arange(number.shape[1]) < bands.running[:, None]
    decays = ~runs & (number.imag < _DECAY)
    with styled_figure(2.8) as figure:
        left, right = figure.subplots(1, 2, sharey=True)
        dots = {"linestyle": "none", "marker": "o", "markersize": 1.4, "markeredgewidth": 0.0}
        left.plot(number.real[decays], f[decays], color=GUIDE, **dots)
        left.plot(number.real[runs], f[runs], color=BLUE, **dots)
        right.plot(number.imag[decays], f[decays], color=VERMILION, **dots)
        left.set(xlabel="Re $k$ ($\\pi/h$)", ylabel=f"Frequency ({print_hertz(unit)})", xlim=(-1.0, 1.0))
        left.set_ylim(float(f.min()), float(f.max()))
        right.set(xlabel="Im $k$ ($\\pi/h$)", xlim=(0.0, _DECAY))
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
