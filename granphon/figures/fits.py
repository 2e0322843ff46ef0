"""Figures of fits to measured velocities: data, fit and residuals."""

from __future__ import annotations

from typing import Any

from granphon.figures.scales import scale_axis, styled_figure

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import MaxNLocator

from granphon.base.scales import write_uncertain
from granphon.figures.style import GUIDE, VERMILION
from granphon.figures.words import describe_medium, join_facts, write_value
from granphon.fits.fit import WidthFit
from granphon.observables.catalogue import axis_label

#: letters of a line of the legend
_LETTERS = 28
#: how measured points are drawn
_DATA_STYLE: dict[str, Any] = {
    "fmt": "o", "color": "black", "markersize": 2.6, "elinewidth": 0.7, "capsize": 0.0, "zorder": 2.0,
}  # fmt: skip


def plot_fit(fit: WidthFit, ax: Axes, residual_ax: Axes) -> tuple[Axes, Axes]:
    """Draw measured velocities with standard errors, the fit, and the ideal lattice; below, residuals in units of sigma.

    Where each pulse has a frequency of its own, the fit is drawn at the data only, and the ideal lattice is left out.
    """
    ax.errorbar(fit.force, fit.velocity, fit.sigma, **_DATA_STYLE, label="data", gid="data")
    structure = fit.packing.structure
    # in short lines, so that the legend has room below the curve
    label = join_facts([describe_medium(fit.medium, structure.periods, structure.n_balls)], _LETTERS)
    label += f":\nW = {write_width(fit)}" if "width" in fit.parameters else ""
    style: dict[str, Any] = {"color": VERMILION, "label": label, "gid": "fit", "zorder": 1.5}
    if np.ndim(fit.waves.frequency):
        ax.plot(fit.force, fit.velocities, "_", markersize=6.0, **style)
    else:
        force = np.geomspace(fit.force.min(), fit.force.max(), 200)
        ax.plot(force, fit.velocity_at(force), linewidth=1.2, **style)
        equal: dict[str, Any] = {"color": GUIDE, "label": "equal balls", "gid": "ideal", "zorder": 1.0}
        ax.plot(force, fit.velocity_at(force, "ala"), linewidth=0.8, **equal)
    residual_ax.axhline(0.0, color=VERMILION, linewidth=1.2, zorder=1.0)
    residual_ax.errorbar(fit.force, fit.residuals / fit.sigma, 1.0, **_DATA_STYLE, gid="residuals")
    for axes in (ax, residual_ax):
        scale_axis(axes, "x", fit.force)
    scale_axis(ax, "y", fit.velocity)
    ax.set_ylabel(axis_label(fit.waves.branch) if fit.waves.frequency is None else "Group velocity (m/s)")
    residual_ax.set(xlabel=axis_label("force"), ylabel="Residual / σ")
    residual_ax.yaxis.set_major_locator(MaxNLocator(5, integer=True))
    return ax, residual_ax


def write_width(fit: WidthFit) -> str:
    """Return the fitted width with its standard error, of which two digits are told, if it is known: "2.026 ± 0.021 µm"."""
    if not fit.errors_are_known:
        return write_value(fit.width, "m")
    return write_uncertain(fit.width, fit.stderr, "m").replace("+/-", "±").replace("u", "µ")


def fit_figure(fit: WidthFit) -> Figure:
    """Draw a figure of a fit above its residuals, see :func:`plot_fit`; one column wide."""
    with styled_figure(3.6) as figure:
        axes = figure.subplots(2, sharex=True, height_ratios=[3.0, 1.0])
        plot_fit(fit, axes[0], axes[1])
        handles, labels = axes[0].get_legend_handles_labels()
        order = [labels.index("data"), *(i for i, label in enumerate(labels) if label != "data")]
        # velocities rise with the force: this corner is free
        axes[0].legend([handles[i] for i in order], [labels[i] for i in order], loc="lower right")
    return figure
