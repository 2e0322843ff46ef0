"""Figures of traces of sensors over distance and time."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

from granphon.figures.scales import styled_figure

import numpy as np

from granphon.base.scales import prefixed, write_uncertain
from granphon.figures.style import BLUE, GUIDE, VERMILION
from granphon.figures.words import write_unit

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

    from granphon.fits.traces import Traces, TraceVelocity

#: height of the greatest signal over the distance between sensors that are nearest to each other
_HEIGHT = 0.8
#: most samples of a trace that are drawn one by one; of a longer trace only the least and the
#: greatest sample of each group are drawn
_MOST_SAMPLES = 4000


def plot_traces(traces: Traces, ax: Axes, velocity: TraceVelocity | None = None) -> Axes:
    """Draw each trace over the time, at the height of the distance of its sensor, and return
    ``ax``. A trace is drawn as its deviations from its median, over the greatest deviation. With a
    ``velocity`` the arrivals are drawn with their standard errors, and the straight line through
    the arrivals.
    """
    time_unit, time_name = prefixed(float(np.max(np.abs(traces.times))), "s")
    length_unit, length_name = prefixed(float(np.max(np.abs(traces.distances))), "m")
    gaps = np.diff(traces.distances)
    # a trace that is alone has any height
    height = _HEIGHT * float(np.min(gaps)) if gaps.size else 1.0
    for distance, signal in zip(traces.distances, traces.signals, strict=True):
        deviations = signal - np.median(signal)
        scaled = deviations / (np.max(np.abs(deviations)) or 1.0)  # a constant trace stays flat
        times, values = _reduce_samples(traces.times, distance + height * scaled)
        ax.plot(times / time_unit, values / length_unit, color=BLUE, linewidth=0.7)
    if velocity is not None:
        _draw_arrivals(velocity, ax, time_unit, length_unit)
    ax.set_xlabel(f"Time ({write_unit(time_name)})")
    ax.set_ylabel(f"Distance of the sensor ({write_unit(length_name)})")
    ax.margins(x=0.0)
    return ax


def _draw_arrivals(velocity: TraceVelocity, ax: Axes, time_unit: float, length_unit: float) -> None:
    """Draw the arrivals, with bars of their standard errors, and the straight line of the
    ``velocity``, with a legend; axes are in units of ``time_unit``, s, and ``length_unit``, m.
    """
    ends = velocity.distances[[0, -1]]
    ax.plot(
        (velocity.start + ends / velocity.velocity) / time_unit,
        ends / length_unit,
        color=GUIDE,
        linewidth=1.0,
        label=write_uncertain(velocity.velocity, velocity.stderr, "m/s").replace("+/-", "±"),
    )
    is_delay = velocity.method == "correlation"
    ax.errorbar(
        velocity.arrivals / time_unit,
        velocity.distances / length_unit,
        xerr=velocity.arrival_errors / time_unit,
        color=VERMILION,
        fmt="o",
        markersize=3.0,
        linewidth=0.8,
        capsize=2.0,
        label="delay after the first" if is_delay else "arrival",
    )
    # above the Axes, as traces may be anywhere in it
    ax.legend(loc="lower left", bbox_to_anchor=(0.0, 1.0), ncols=2)


def traces_figure(traces: Traces, velocity: TraceVelocity | None = None) -> Figure:
    """Draw a figure of traces, see :func:`plot_traces`; one column wide."""
    with styled_figure(2.8) as figure:
        plot_traces(traces, figure.subplots(), velocity)
    return figure


def _reduce_samples(times: np.ndarray, values: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return the ``times`` (n,) and ``values`` (n,) of a trace to draw. If there are more samples
    than can be seen, more than ``_MOST_SAMPLES``, they are grouped: the least and the greatest
    value of each group stand at the time of its first sample. The last samples are left out if they
    do not fill a group.
    """
    if times.size <= _MOST_SAMPLES:
        return times, values
    # each group leaves two points
    group_size = math.ceil(2 * times.size / _MOST_SAMPLES)
    n_groups = times.size // group_size
    groups = values[: n_groups * group_size].reshape(n_groups, group_size)
    extremes = np.stack([groups.min(axis=1), groups.max(axis=1)], axis=1)
    first_times = times[: n_groups * group_size : group_size]
    return np.repeat(first_times, 2), extremes.ravel()
