"""Figures of pulses through a network: the seismogram, and the wave that crosses the array."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from granphon.figures.scales import MOTION, styled_figure

import matplotlib
import numpy as np
from matplotlib.axes import Axes
from matplotlib.collections import EllipseCollection
from matplotlib.colors import Normalize
from matplotlib.figure import Figure
from numpy.typing import NDArray

from granphon.base.errors import InputError, message
from granphon.figures.style import BLUE, COLUMN_WIDTH, DPI, GUIDE, STYLE, VERMILION, pick_evenly
from granphon.networks.network import ContactNetwork
from granphon.waves.pulses import Pulse

Array = NDArray[np.float64]
#: number of single balls whose signals a seismogram shows
_BALLS = 6


def plot_seismogram(pulse: Pulse, ax: Axes, balls: int = _BALLS) -> Axes:
    """Draw the burst that was sent, the coherent signal, and the signals of some single balls, one above the other.

    Means over further planes are drawn too, if the pulse has them. Each trace is over time, ms; those of balls and of means
    are in proportion to the greatest signal. A mark shows the time of flight by the envelope, if it
    can be read.
    """
    t = 1e3 * pulse.times
    most = float(np.max(np.abs(pulse.signals)))
    chosen = pick_evenly(len(pulse.signals), balls)
    traces = [("sent", pulse.sent / np.max(np.abs(pulse.sent)), GUIDE), ("mean", pulse.coherent / most, BLUE)]
    traces += [
        (f"at {1e3 * distance:.3g} mm", trace / most, BLUE)
        for distance, trace in zip(pulse.plane_distances, pulse.planes, strict=True)
    ]
    traces += [(f"ball {pulse.receivers[n]}", pulse.signals[n] / most, VERMILION) for n in chosen]
    for row, (_, trace, colour) in enumerate(traces):
        ax.plot(t, 0.45 * trace - row, color=colour, linewidth=0.7)
    ax.set_yticks(-np.arange(len(traces)), [name for name, _, _ in traces])
    ax.tick_params(axis="y", length=0)
    told = ": its arrival is not known"
    if not pulse.why_unknown:
        time = pulse.time_of_flight
        ax.axvline(1e3 * (time + 0.5 * pulse.cycles / pulse.frequency), color="black", linewidth=0.6, dashes=(3, 2))
        told = f" in {1e3 * time:.4g} ms: {pulse.distance / time:.4g} m/s"
    ax.set(xlabel="Time (ms)", xlim=t[[0, -1]], ylim=(-len(traces) + 0.4, 0.6))
    ax.set_title(f"{1e3 * pulse.distance:.4g} mm{told}")
    return ax


def pulse_figure(pulse: Pulse) -> Figure:
    """Draw a figure, one column wide: the seismogram, and the coherent part beside the speckle."""
    with styled_figure(4.2) as figure:
        above, below = figure.subplots(2, 1, sharex=True, height_ratios=[1.9, 1.0])
        plot_seismogram(pulse, above)
        above.tick_params(axis="x", labelbottom=True)
        t, size = 1e3 * pulse.times, 1e6
        below.plot(t, size * pulse.envelope, color=BLUE, linewidth=1.0, label="coherent, envelope")
        below.plot(t, size * pulse.speckle_amplitude, color=VERMILION, linewidth=1.0, label="speckle, rms")
        below.set(xlabel="Time (ms)", ylabel="Velocity (µm/s)", ylim=(0.0, None))
        # above the panel: within it the two curves leave no place that is always free
        below.legend(loc="lower center", bbox_to_anchor=(0.5, 1.0), ncols=2, borderaxespad=0.2)
    return figure


def plot_frame(network: ContactNetwork, pulse: Pulse, frame: int, ax: Axes, most: float | None = None) -> Axes:
    """Draw the balls of a network in the plane, coloured by their velocity along the polarisation at one of the frames.

    ``most`` is the velocity, m/s, of the strongest colour; by default the greatest of this frame.
    """
    if not 0 <= frame < len(pulse.frames):
        what = f"the pulse has no frame {frame}; it has {len(pulse.frames)}"
        raise InputError(message(what, mend="Give transmit the times of frames"))
    along = pulse.velocities[frame] @ pulse.polarisation
    limit = float(np.max(np.abs(along))) if most is None else most
    there = np.isfinite(network.radii)
    sizes, places = 2e3 * network.radii[there], 1e3 * network.positions[there, :2]
    if network.pbc[0] and not np.any(network.cell[0, 1:]):  # an oblique cell is drawn as a rectangle
        places[:, 0] = np.mod(places[:, 0], 1e3 * network.cell[0, 0])
    balls = EllipseCollection(
        sizes, sizes, 0.0 * sizes, units="xy", offsets=places, offset_transform=ax.transData, array=along[there],
        cmap=MOTION, norm=Normalize(-limit, limit), gid="balls",
    )  # fmt: skip
    ax.add_collection(balls, autolim=False)
    low, high = places.min(axis=0) - sizes.max(), places.max(axis=0) + sizes.max()
    ax.set(xlim=(low[0], high[0]), ylim=(low[1], high[1]), aspect="equal", xlabel="x (mm)", ylabel="y (mm)")
    ax.set_title(f"{1e3 * pulse.frames[frame]:.3f} ms")
    return ax


def animate_pulse(network: ContactNetwork, pulse: Pulse, interval: float = 60.0, figure: Figure | None = None) -> Any:
    """Return a ``matplotlib.animation.FuncAnimation`` of the wave that crosses the array, one picture for each frame.

    ``interval`` is the time between pictures, ms; ``figure`` is drawn on, by default a new one. Raises
    :class:`~granphon.base.errors.InputError` for a pulse without frames.
    """
    from matplotlib.animation import FuncAnimation
    from matplotlib.backends.backend_agg import FigureCanvasAgg

    if not len(pulse.frames):
        raise InputError(message("the pulse has no frames", mend="Give transmit the times of frames"))
    with matplotlib.rc_context(STYLE):
        if figure is None:
            figure = Figure((COLUMN_WIDTH, COLUMN_WIDTH), dpi=DPI // 2, layout="constrained")
            FigureCanvasAgg(figure)
        ax = figure.subplots()
        most = 0.5 * float(np.max(np.abs(pulse.velocities @ pulse.polarisation), initial=0.0))
        plot_frame(network, pulse, 0, ax, most)
    (balls,) = ax.collections
    there = np.isfinite(network.radii)

    def show(frame: int) -> Any:
        balls.set_array((pulse.velocities[frame] @ pulse.polarisation)[there])
        ax.set_title(f"{1e3 * pulse.frames[frame]:.3f} ms")
        return (balls,)

    draw: Callable[..., Any] = show
    return FuncAnimation(figure, draw, frames=len(pulse.frames), interval=interval, blit=False)
