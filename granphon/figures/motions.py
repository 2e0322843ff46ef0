"""Figures of balls in motion: maps over position and time, balls at one time, energies, spectra,
harmonics.
"""

from __future__ import annotations

from typing import Any, Literal

from granphon.figures.scales import MOTION, add_bar, add_legend, draw_balls, styled_figure

import numpy as np
from matplotlib.axes import Axes
from matplotlib.colors import Normalize, TwoSlopeNorm
from matplotlib.figure import Figure

from granphon.base.arrays import Array
from granphon.base.errors import InputError, brief
from granphon.base.scales import HertzPrefix, prefixed
from granphon.figures.style import BLUE, COLOURS, PAGE_WIDTH, pick_evenly, print_hertz
from granphon.figures.waves import choose_states
from granphon.figures.words import write_unit
from granphon.runs.dataset import Dataset
from granphon.waves.motion import Motion

Show = Literal["velocities", "forces"]
#: part of the greatest amplitude of a spectrum at which its axis ends
_LEAST = 1e-6
#: the length of this number of radii chooses the unit of positions
_RADII = 20.0
#: layers are apart by more than this part of a radius
_LAYER = 0.1
#: least limit of a scale of colours or of an axis, where nothing moves
_TINY = 1e-300


def plot_motion(
    motion: Motion, ax: Axes, *, show: Show = "velocities", axis: int | None = None
) -> Axes:
    """Draw a map over position and time: velocities of balls along an axis, or changes of the
    forces of contacts.

    Positions are along ``axis``, 0 to 2, by default the first axis along which the array does not
    repeat. Positions and values are means over a layer of balls, or over the contacts from one
    layer to the next. An oblique cell is drawn as a rectangle.
    """
    network = motion.network
    if show not in ("velocities", "forces") or axis not in (None, 0, 1, 2):
        raise InputError(
            f"show is {brief(show)}, axis {brief(axis)}",
            mend="Give velocities or forces, 0, 1 or 2",
        )
    along = int(np.argmin(network.pbc)) % network.dimension if axis is None else axis
    is_ball = np.isfinite(network.radii)
    radius = float(np.mean(network.radii[is_ball]))
    # a ball at the edge of a period stays there when its position is rounded
    offset = _LAYER * radius
    ball_positions = network.positions[is_ball, along] + offset
    contact_positions = motion.middles[:, along] + offset
    length = network.cell[along, along]
    is_period = network.pbc[along] and abs(length) == np.linalg.norm(network.cell[along])
    if is_period:
        ball_positions = np.mod(ball_positions, abs(length))
        contact_positions = np.mod(contact_positions, abs(length))
    layers = _find_layers(ball_positions, radius)
    if show == "forces":
        coordinates = contact_positions
        values = motion.forces - motion.forces[0]
        si_unit = "N"
        quantity = "Change of force"
    else:
        coordinates = ball_positions
        values = motion.velocities[:, is_ball, along]
        si_unit = "m/s"
        quantity = f"Velocity along {'xyz'[along]}"
    positions, means = _average_layers(layers, coordinates, values)
    most = max(float(np.abs(means).max()), _TINY)
    scale, unit = prefixed(most, si_unit)
    seconds, unit_of_time = prefixed(float(motion.times[-1]), "s")
    metre, unit_of_length = prefixed(_RADII * radius, "m")
    drawn = ax.pcolormesh(
        (positions - positions[0]) / metre,
        motion.times / seconds,
        means / scale,
        cmap=MOTION,
        shading="nearest",
        rasterized=True,
        norm=TwoSlopeNorm(0.0, -most / scale, most / scale),
        gid="motion",
    )
    ax.set(
        xlabel=f"{'xyz'[along]} ({write_unit(unit_of_length)})",
        ylabel=f"Time ({write_unit(unit_of_time)})",
    )
    add_bar(ax, drawn, f"{quantity} ({write_unit(unit)})")
    return ax


def _find_layers(positions: Array, radius: float) -> Array:
    """Return where layers of balls begin, (n_layers,), m, from the ``positions`` (n,) of the balls,
    m; of balls without layers, slices a ``radius`` wide.
    """
    distance = _LAYER * radius
    ascending = np.sort(positions)
    layers = ascending[np.diff(ascending, prepend=-np.inf) > distance] - distance
    if len(layers) < 3 or 2 * len(layers) < np.ptp(positions) / radius - 2.0:
        return np.arange(layers[0], positions.max(), radius)
    return np.asarray(layers)


def _average_layers(layers: Array, coordinates: Array, values: Array) -> tuple[Array, Array]:
    """Return the means over each of the ``layers``, which begin at (n_layers,), m, of the
    ``coordinates`` (n,), m, and of the ``values`` (n_times, n); layers without a value are left
    out.
    """
    number = np.maximum(np.searchsorted(layers, coordinates, side="right") - 1, 0)
    order = np.argsort(number, kind="stable")
    starts = np.flatnonzero(np.diff(number[order], prepend=-1))
    counts = np.diff(starts, append=len(order))
    means = np.add.reduceat(values[:, order], starts, axis=1) / counts
    return np.add.reduceat(coordinates[order], starts) / counts, means


def plot_energies(motion: Motion, ax: Axes) -> Axes:
    """Draw kinetic energies of translation and rotation, the energy of contacts, and the lost
    energy over time.
    """
    scale, unit = prefixed(max(float((motion.energy + motion.lost).max()), _TINY), "J")
    seconds, time = prefixed(float(motion.times[-1]), "s")
    for label, values, colour in (
        ("translation", motion.translation, COLOURS[0]),
        ("rotation", motion.rotation, COLOURS[1]),
        ("contacts", motion.stored, COLOURS[2]),
        ("lost", motion.lost, "0.4"),
    ):
        if label in ("translation", "contacts") or np.any(values > 1e-9 * scale):
            ax.plot(motion.times / seconds, values / scale, color=colour, label=label)
    ax.set(
        xlabel=f"Time ({write_unit(time)})",
        ylabel=f"Energy ({write_unit(unit)})",
        ylim=(0.0, None),
        xlim=(0.0, None),
    )
    ax.legend(loc="lower center", bbox_to_anchor=(0.5, 1.0), ncols=2, borderaxespad=0.2)
    return ax


def plot_snapshot(motion: Motion, ax: Axes, frame: int = -1, *, most: float | None = None) -> Axes:
    """Draw the balls at one of the frames, coloured by their speed; an array in space is seen along
    z.

    ``most`` is the speed, m/s, of the darkest colour; by default the greatest speed of the frame.
    """
    if not -len(motion.times) <= frame < len(motion.times):
        raise InputError(
            f"the motion has no frame {frame}", mend=f"Give 0 to {len(motion.times) - 1}"
        )
    most = float(np.linalg.norm(motion.velocities[frame], axis=1).max()) if most is None else most
    drawn, label = _draw_speeds(motion, ax, frame, max(most, _TINY))
    add_bar(ax, drawn, label)
    return ax


def _draw_speeds(motion: Motion, ax: Axes, frame: int, most: float) -> tuple[Any, str]:
    """Draw the balls at a frame; return the drawn balls and the label of their colour bar."""
    scale, unit = prefixed(most, "m/s")
    seconds, time = prefixed(float(motion.times[-1]), "s")
    speeds = np.linalg.norm(motion.velocities[frame], axis=1) / scale
    drawn = draw_balls(motion.network, speeds, ax, "magma_r", Normalize(0.0, most / scale))
    if np.any(scale * speeds > most):  # faster balls have the darkest colour too
        drawn.cmap.colorbar_extend = "max"  # type: ignore[assignment]  # the stubs know truth values only
    ax.set_title(f"{motion.times[frame] / seconds:.3g} {write_unit(time)}")
    return drawn, f"Speed ({write_unit(unit)})"


def plot_ball_spectrum(motion: Motion, ax: Axes, ball: int, *, axis: int = 0) -> Axes:
    """Draw the amplitudes of the motion of a ball along an axis over frequency, on a logarithmic
    scale.
    """
    frequencies, amplitudes = motion.spectrum(ball, axis)
    most = max(float(amplitudes.max()), _TINY)
    top = float(frequencies[amplitudes > _LEAST * most][-1])
    prefix = HertzPrefix.for_top(top)
    scale, unit = prefixed(most, "m")
    ax.plot(
        frequencies / prefix.hertz,
        np.maximum(amplitudes, 1e-3 * _LEAST * most) / scale,
        color=BLUE,
        linewidth=0.9,
    )
    ax.set(
        xlabel=f"Frequency ({print_hertz(prefix)})",
        ylabel=f"Displacement of ball {ball} ({write_unit(unit)})",
        yscale="log",
    )
    ax.set(xlim=(0.0, top / prefix.hertz), ylim=(_LEAST * most / scale, 3.0 * most / scale))
    return ax


def plot_harmonics(
    motion: Motion, ax: Axes, frequency: float, *, count: int = 3, axis: int = 0, periods: int = 10
) -> Axes:
    """Draw the amplitudes of the motion at multiples of the ``frequency`` of a drive, over the
    position along an axis.

    Options are those of :meth:`granphon.Motion.harmonics`.
    """
    amplitudes = np.abs(motion.harmonics(frequency, count, axis, periods))
    places = motion.network.positions[:, axis]
    metre, length = prefixed(_RADII * float(np.median(motion.network.radii)), "m")
    scale, unit = prefixed(float(amplitudes.max()), "m")
    order = np.argsort(places, kind="stable")
    for number, (values, colour) in enumerate(zip(amplitudes, COLOURS, strict=False), 1):
        label = f"{number} f" if number > 1 else "f"
        ax.plot(
            (places - places.min())[order] / metre,
            values[order] / scale,
            ".-",
            color=colour,
            ms=2.5,
            lw=0.7,
            label=label,
        )
    ax.set(
        xlabel=f"{'xyz'[axis]} ({write_unit(length)})",
        ylabel=f"Displacement ({write_unit(unit)})",
        yscale="log",
        xlim=(0.0, None),
    )
    ax.legend(ncols=3)
    return ax


def motion_figure(motion: Motion, *, show: Show | None = None, axis: int | None = None) -> Figure:
    """Draw a figure across the page: the motion, and its energies over time.

    Of a chain, and with ``show``, the motion is a map over position and time, see
    :func:`plot_motion`; of any other array the balls are drawn at three times.
    """
    if motion.network.dimension == 1 or show is not None:
        with styled_figure(2.7, PAGE_WIDTH) as figure:
            left, right = figure.subplots(1, 2, width_ratios=[1.35, 1.0])
            plot_motion(motion, left, show=show or "velocities", axis=axis)
            plot_energies(motion, right)
        return figure
    speeds = np.linalg.norm(motion.velocities, axis=2).max(axis=1)
    frames = pick_evenly(len(motion.times), 4)[1:]
    # balls of more than half of the greatest speed have the darkest colour
    most = max(0.5 * float(speeds[frames].max()), _TINY)
    with styled_figure(2.3, PAGE_WIDTH) as figure:
        *shots, energies = figure.subplots(
            1, len(frames) + 1, width_ratios=[1.0] * len(frames) + [1.25]
        )
        for ax, frame in zip(shots, frames, strict=True):
            drawn, label = _draw_speeds(motion, ax, frame, most)
            ax.set_ylabel("y (mm)" if ax is shots[0] else "")
        figure.colorbar(drawn, ax=shots, location="bottom", aspect=50, extend="max", label=label)
        plot_energies(motion, energies)
    return figure


def motions_figure(dataset: Dataset) -> Figure:
    """Draw the greatest force and the kinetic energy of the motion of each state of a data set over
    time, one column wide.

    Of more than eight states eight are drawn, evenly taken. Raises
    :class:`~granphon.base.errors.InputError` for a data set without motions.
    """
    states, handles = choose_states(dataset, "motion_force", "motions")
    seconds, time = prefixed(float(dataset["motion_time"].values[-1]), "s")
    with styled_figure(3.6) as figure:
        above, below = figure.subplots(2, 1, sharex=True, height_ratios=[1.3, 1.0])
        for ax, names, label, unit in (
            (above, ("motion_force",), "Greatest force", "N"),
            (below, ("motion_translation", "motion_rotation"), "Kinetic energy", "J"),
        ):
            lines = [(colour, sum(take(name) for name in names)) for colour, take in states]
            scale, name = prefixed(max(float(np.max(values)) for _, values in lines), unit)
            for colour, values in lines:
                ax.plot(
                    dataset["motion_time"].values / seconds,
                    values / scale,
                    color=colour,
                    linewidth=1.0,
                )
            ax.set(ylabel=f"{label} ({write_unit(name)})", ylim=(0.0, None))
        below.set(xlabel=f"Time ({write_unit(time)})", xlim=(0.0, None))
        if len(handles) > 1:
            add_legend(figure, handles, room=1)
    return figure
