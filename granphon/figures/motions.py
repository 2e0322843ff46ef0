"""Figures of balls in motion: maps over position and time, balls at one time, energies, spectra,
harmonics.
"""

from __future__ import annotations

import itertools
from collections.abc import Mapping, Sequence
from typing import Any, Literal

from granphon.figures.scales import (
    LEAST_LIMIT,
    MOTION,
    add_bar,
    add_legend,
    draw_balls,
    draw_error_band,
    make_error_handle,
    name_errors,
    read_errors,
    styled_figure,
)

import numpy as np
from matplotlib.axes import Axes
from matplotlib.colors import Normalize, TwoSlopeNorm
from matplotlib.figure import Figure

from granphon.base.arrays import Array
from granphon.base.errors import InputError
from granphon.base.scales import HertzPrefix, prefixed
from granphon.base.validation import one_of, positive, whole_number
from granphon.figures.style import BLUE, COLOURS, PAGE_WIDTH, pick_evenly, write_hertz
from granphon.figures.waves import pick_states
from granphon.figures.words import write_unit
from granphon.runs.dataset import Dataset
from granphon.waves.motion import Motion

#: what a map may show
Show = Literal["velocities", "forces"]
_SHOWS = ("velocities", "forces")
#: the energies that are drawn, by the names of the attributes of a motion: label and colour
_ENERGIES = {
    "translation": ("translation", COLOURS[0]),
    "rotation": ("rotation", COLOURS[1]),
    "stored": ("contacts", COLOURS[2]),
    "lost": ("lost", "0.4"),
}
#: part of the greatest amplitude of a spectrum at which its axis ends
_LEAST_AMPLITUDE = 1e-6
#: the length of this number of radii chooses the unit of positions
_RADII = 20.0
#: layers are apart by more than this part of a radius
_LAYER = 0.1
#: an energy below this part of the unit of the axis is not drawn
_NO_ENERGY = 1e-9


def plot_motion(
    motion: Motion, ax: Axes, *, show: Show = "velocities", axis: int | None = None
) -> Axes:
    """Draw a map over position and time: velocities of balls along an axis, or changes of the
    forces of contacts.

    Positions are along ``axis``, 0 to 2, from the first layer on; by default the axis is the first
    of the array along which it does not repeat, or 0 if there is none. Positions and values are
    means over a layer of balls, or over the contacts from one layer to the next. An oblique cell is
    drawn as a rectangle. Raises :class:`~granphon.base.errors.InputError` for another word of
    ``show``, and another ``axis``.
    """
    network = motion.network
    one_of("show", show, _SHOWS)
    if axis is None:
        # argmin finds the first axis without a period, which may be one across a line or a plane
        drawn_axis = int(np.argmin(network.pbc)) % network.dimension
    else:
        drawn_axis = whole_number("axis", axis, 0, 2)
    letter = "xyz"[drawn_axis]
    positions, means = _average_motion(motion, drawn_axis, show)
    si_unit = "m/s"
    quantity = f"Velocity along {letter}"
    if show == "forces":
        si_unit = "N"
        quantity = "Change of force"
    greatest = max(float(np.abs(means).max()), LEAST_LIMIT)
    scale, unit = prefixed(greatest, si_unit)
    seconds, unit_of_time = prefixed(float(motion.times[-1]), "s")
    metres, unit_of_length = prefixed(_RADII * _find_mean_radius(motion), "m")
    mesh = ax.pcolormesh(
        (positions - positions[0]) / metres,
        motion.times / seconds,
        means / scale,
        cmap=MOTION,
        shading="nearest",
        rasterized=True,
        norm=TwoSlopeNorm(0.0, -greatest / scale, greatest / scale),
        gid="motion",
    )
    ax.set(
        xlabel=f"{letter} ({write_unit(unit_of_length)})",
        ylabel=f"Time ({write_unit(unit_of_time)})",
    )
    add_bar(ax, mesh, f"{quantity} ({write_unit(unit)})")
    return ax


def _find_mean_radius(motion: Motion) -> float:
    """Return the mean radius of the balls, m, without flat walls, whose radii are infinite."""
    radii = motion.network.radii
    return float(np.mean(radii[np.isfinite(radii)]))


def _average_motion(motion: Motion, axis: int, show: Show) -> tuple[Array, Array]:
    """Return the mean position (m,), m, of each of m layers along an ``axis``, and the means
    (n_times, m) in each layer at each time: of the velocities of balls along the axis, m/s, or if
    ``show`` is "forces", of the changes of the forces of contacts since the first frame, N.
    """
    radius = _find_mean_radius(motion)
    ball_positions, contact_positions = _find_positions(motion, axis, radius)
    layers = _find_layers(ball_positions, radius)
    if show == "forces":
        return _average_layers(layers, contact_positions, motion.forces - motion.forces[0])
    is_ball = np.isfinite(motion.network.radii)
    return _average_layers(layers, ball_positions, motion.velocities[:, is_ball, axis])


def _find_positions(motion: Motion, axis: int, radius: float) -> tuple[Array, Array]:
    """Return the positions of the balls, without flat walls, (n,), and of the contacts, (n_c,),
    along an ``axis``, m; ``radius`` is the mean radius of the balls, m. All positions are moved by
    the part ``_LAYER`` of the radius. Positions are folded into one period if the array repeats
    along the axis by a vector of the cell that is parallel to the axis.
    """
    network = motion.network
    # a ball at the edge of a period stays there when its position is rounded
    offset = _LAYER * radius
    is_ball = np.isfinite(network.radii)
    ball_positions = network.positions[is_ball, axis] + offset
    contact_positions = motion.middles[:, axis] + offset
    length = abs(network.cell[axis, axis])
    # a period that is oblique to the axis takes a ball off its row: its places are not folded
    has_period = network.pbc[axis] and length == np.linalg.norm(network.cell[axis])
    if has_period:
        ball_positions = np.mod(ball_positions, length)
        contact_positions = np.mod(contact_positions, length)
    return ball_positions, contact_positions


def _find_layers(positions: Array, radius: float) -> Array:
    """Return the positions (n_layers,), m, at which layers of balls begin, from the ``positions``
    (n,) of the balls, m. If the balls stand in no layers, return the starts of slices that are one
    ``radius``, m, wide.
    """
    distance = _LAYER * radius
    ascending = np.sort(positions)
    is_first = np.diff(ascending, prepend=-np.inf) > distance  # of a layer
    starts = ascending[is_first] - distance
    # layers are apart by up to two radii; disordered balls run into few wide layers
    n_radii = np.ptp(positions) / radius
    has_layers = len(starts) >= 3 and 2 * len(starts) >= n_radii - 2.0
    if not has_layers:
        return np.arange(starts[0], positions.max(), radius)
    return np.asarray(starts)


def _average_layers(layers: Array, coordinates: Array, values: Array) -> tuple[Array, Array]:
    """Return for each layer the mean of the ``coordinates`` (n,), m, of the balls or contacts in
    the layer, and the means of their ``values`` (n_times, n): arrays (m,) and (n_times, m) for the
    m layers that are not empty.

    ``layers`` (n_layers,), m, are the coordinates at which layers begin.
    """
    numbers = np.maximum(np.searchsorted(layers, coordinates, side="right") - 1, 0)
    order = np.argsort(numbers, kind="stable")
    starts = np.flatnonzero(np.diff(numbers[order], prepend=-1))
    counts = np.diff(starts, append=len(order))
    mean_coordinates = np.add.reduceat(coordinates[order], starts) / counts
    mean_values = np.add.reduceat(values[:, order], starts, axis=1) / counts
    return mean_coordinates, mean_values


def plot_energies(motion: Motion, ax: Axes, errors: Mapping[str, Array] | None = None) -> Axes:
    """Draw the kinetic energies of translation and rotation, the energy of contacts, and the lost
    energy over time. Rotation and loss are left out where they never exceed a billionth of the unit
    of the axis.

    ``errors`` are standard errors (n,), J, by the names of the attributes of the motion,
    "translation", "rotation", "stored" and "lost"; each that is given is drawn as a band. Raises
    :class:`~granphon.base.errors.InputError` for errors of another name or shape.
    """
    energy_errors = {}
    for name, values in name_errors(errors).items():
        one_of("name of errors", name, _ENERGIES)
        energy_errors[name] = read_errors(values, motion.times.shape)
    greatest = max(float((motion.energy + motion.lost).max()), LEAST_LIMIT)
    scale, unit = prefixed(greatest, "J")
    seconds, unit_of_time = prefixed(float(motion.times[-1]), "s")
    for name, (label, colour) in _ENERGIES.items():
        values = getattr(motion, name)
        is_always_drawn = name in ("translation", "stored")
        if not (is_always_drawn or np.any(values > _NO_ENERGY * scale)):
            continue
        times = motion.times / seconds
        if name in energy_errors:
            heights = energy_errors[name] / scale
            draw_error_band(ax, times, values / scale, heights, colour, f"{name}-errors")
        ax.plot(times, values / scale, color=colour, label=label)
    if energy_errors:
        ax.add_line(make_error_handle())
    ax.set(
        xlabel=f"Time ({write_unit(unit_of_time)})",
        ylabel=f"Energy ({write_unit(unit)})",
        ylim=(0.0, None),
        xlim=(0.0, None),
    )
    ax.legend(loc="lower center", bbox_to_anchor=(0.5, 1.0), ncols=2, borderaxespad=0.2)
    return ax


def plot_snapshot(motion: Motion, ax: Axes, frame: int = -1, *, most: float | None = None) -> Axes:
    """Draw the balls at one of the frames, coloured by their speed; an array in space is seen along
    z.

    ``frame`` is counted from 0; below 0 it is counted from the end, -1 for the last frame. ``most``
    is the speed, m/s, of the darkest colour, by default the greatest speed of the frame. Raises
    :class:`~granphon.base.errors.InputError` if the motion has no such frame, and for a ``most``
    that is not above zero.
    """
    n_frames = len(motion.times)
    number = whole_number("frame", frame, -n_frames, n_frames - 1)
    if most is None:
        limit = float(np.linalg.norm(motion.velocities[number], axis=1).max())
    else:
        limit = positive("most", most, "m/s")
    balls, label = _draw_speeds(motion, ax, number, max(limit, LEAST_LIMIT))
    add_bar(ax, balls, label)
    return ax


def _draw_speeds(motion: Motion, ax: Axes, frame: int, limit: float) -> tuple[Any, str]:
    """Draw the balls at a frame, coloured by their speed, with the darkest colour at the ``limit``,
    m/s; return the drawn balls and the label of their colour bar.
    """
    scale, unit = prefixed(limit, "m/s")
    seconds, unit_of_time = prefixed(float(motion.times[-1]), "s")
    speeds = np.linalg.norm(motion.velocities[frame], axis=1) / scale
    balls = draw_balls(motion.network, speeds, ax, "magma_r", Normalize(0.0, limit / scale))
    if np.any(scale * speeds > limit):  # faster balls have the darkest colour too
        balls.cmap.colorbar_extend = "max"  # type: ignore[assignment]  # the stubs know truth values only
    ax.set_title(f"{motion.times[frame] / seconds:.3g} {write_unit(unit_of_time)}")
    return balls, f"Speed ({write_unit(unit)})"


def plot_ball_spectrum(motion: Motion, ax: Axes, ball: int, *, axis: int = 0) -> Axes:
    """Draw the amplitudes of the motion of a ball along an axis, 0 to 2, over frequency, on a
    logarithmic scale, up to the highest frequency with a millionth of the greatest amplitude.

    ``ball`` and ``axis``, and what is raised, are those of :meth:`granphon.Motion.spectrum`.
    """
    frequencies, amplitudes = motion.spectrum(ball, axis)
    greatest = max(float(amplitudes.max()), LEAST_LIMIT)
    # of a ball that stays where it is, all amplitudes are zero, and all frequencies are shown
    is_seen = amplitudes >= _LEAST_AMPLITUDE * float(amplitudes.max())
    top = float(frequencies[is_seen][-1])
    prefix = HertzPrefix.for_top(top)
    scale, unit = prefixed(greatest, "m")
    # a logarithmic axis has no zero: smaller amplitudes are drawn far below the axes
    heights = np.maximum(amplitudes, 1e-3 * _LEAST_AMPLITUDE * greatest)
    ax.plot(frequencies / prefix.hertz, heights / scale, color=BLUE, linewidth=0.9)
    ax.set(
        xlabel=f"Frequency ({write_hertz(prefix)})",
        ylabel=f"Displacement of ball {ball} ({write_unit(unit)})",
        yscale="log",
    )
    ax.set_xlim(0.0, top / prefix.hertz)
    ax.set_ylim(_LEAST_AMPLITUDE * greatest / scale, 3.0 * greatest / scale)
    return ax


def plot_harmonics(
    motion: Motion, ax: Axes, frequency: float, *, count: int = 3, axis: int = 0, periods: int = 10
) -> Axes:
    """Draw the amplitudes of the motion of the balls at multiples of the ``frequency`` of a drive,
    over the position along an axis, from the first ball on. Flat walls are left out.

    Options, and what is raised, are those of :meth:`granphon.Motion.harmonics`;
    :class:`~granphon.base.errors.InputError` too if no ball moves along the axis.
    """
    is_ball = np.isfinite(motion.network.radii)  # a flat wall may have any place
    amplitudes = np.abs(motion.harmonics(frequency, count, axis, periods))[:, is_ball]  # m
    if not np.any(amplitudes):
        raise InputError(f"no ball moves along {'xyz'[axis]}", mend="Give another axis")
    positions = motion.network.positions[is_ball, axis]
    metres, unit_of_length = prefixed(_RADII * _find_mean_radius(motion), "m")
    scale, unit = prefixed(float(amplitudes.max()), "m")
    order = np.argsort(positions, kind="stable")
    distances = (positions - positions.min())[order]
    colours = itertools.cycle(COLOURS)
    for number, (amplitude, colour) in enumerate(zip(amplitudes, colours, strict=False), 1):
        label = f"{number} f" if number > 1 else "f"
        ax.plot(
            distances / metres,
            amplitude[order] / scale,
            ".-",
            color=colour,
            ms=2.5,
            lw=0.7,
            label=label,
        )
    ax.set(
        xlabel=f"{'xyz'[axis]} ({write_unit(unit_of_length)})",
        ylabel=f"Displacement ({write_unit(unit)})",
        yscale="log",
        xlim=(0.0, None),
    )
    ax.legend(ncols=3)
    return ax


def motion_figure(
    motion: Motion,
    *,
    show: Show | None = None,
    axis: int | None = None,
    errors: Mapping[str, Array] | None = None,
) -> Figure:
    """Draw a figure across the page: the motion, and its energies over time, with the ``errors`` of
    :func:`plot_energies`.

    Of a chain, and with ``show`` or ``axis``, the motion is a map over time and the position along
    the axis, see :func:`plot_motion`. Of any other array the balls are drawn at three frames after
    the first, or at all of these if the motion has fewer than four frames; a frame that is alone is
    drawn itself. Raises what :func:`plot_motion` and :func:`plot_energies` raise.
    """
    is_map = motion.network.dimension == 1 or show is not None or axis is not None
    if is_map:
        with styled_figure(2.7, PAGE_WIDTH) as figure:
            left, right = figure.subplots(1, 2, width_ratios=[1.35, 1.0])
            plot_motion(motion, left, show="velocities" if show is None else show, axis=axis)
            plot_energies(motion, right, errors)
        return figure
    greatest_speeds = np.linalg.norm(motion.velocities, axis=2).max(axis=1)  # of each frame
    frames = pick_evenly(len(motion.times), 4)[1:] or [0]  # the first frame shows little motion
    # balls of more than half of the greatest speed have the darkest colour
    limit = max(0.5 * float(greatest_speeds[frames].max()), LEAST_LIMIT)
    widths = [1.0] * len(frames) + [1.25]
    with styled_figure(2.3, PAGE_WIDTH) as figure:
        *snapshots, energies = figure.subplots(1, len(widths), width_ratios=widths)
        for ax, frame in zip(snapshots, frames, strict=True):
            balls, label = _draw_speeds(motion, ax, frame, limit)
            ax.set_ylabel("y (mm)" if ax is snapshots[0] else "")
        # all snapshots have the same colours
        figure.colorbar(
            balls, ax=snapshots, location="bottom", aspect=50, extend="max", label=label
        )
        plot_energies(motion, energies, errors)
    return figure


def motions_figure(dataset: Dataset) -> Figure:
    """Draw the greatest force and the kinetic energy of the motion of each state of a data set over
    time, one column wide, with standard errors as bands.

    States are chosen as by :func:`granphon.figures.waves.sweep_dos_figure`. Raises
    :class:`~granphon.base.errors.InputError` for a data set without motions.
    """
    states, handles = pick_states(dataset, "motion_force", "motions")
    times = dataset["motion_time"].values  # s
    seconds, unit_of_time = prefixed(float(times[-1]), "s")
    with styled_figure(3.6) as figure:
        above, below = figure.subplots(2, 1, sharex=True, height_ratios=[1.3, 1.0])
        has_band = False
        for ax, variable, label, si_unit in (
            (above, "motion_force", "Greatest force", "N"),
            (below, "motion_kinetic", "Kinetic energy", "J"),
        ):
            has_errors = f"{variable}_error" in dataset
            curves = []
            for colour, read_variable in states:
                errors = read_variable(f"{variable}_error") if has_errors else None
                if errors is not None:
                    has_band = has_band or bool(np.any(errors > 0.0))
                curves.append((colour, read_variable(variable), errors))
            _draw_courses(ax, times / seconds, curves, label, si_unit)
        below.set(xlabel=f"Time ({write_unit(unit_of_time)})", xlim=(0.0, None))
        if has_band:
            handles.append(make_error_handle())
        if len(handles) > 1 or has_band:
            add_legend(figure, handles, room=1)
    return figure


def _draw_courses(
    ax: Axes,
    times: Array,
    curves: Sequence[tuple[Any, Array, Array | None]],
    label: str,
    si_unit: str,
) -> None:
    """Draw a quantity of several states over the ``times`` (n,), in the unit of the axis of x. The
    axis of y has a ``label``, begins at zero, and is in a decimal multiple of the SI unit.

    ``curves`` are (colour, values (n,), their standard errors (n,) or None), in ``si_unit``.
    """
    scale, unit = prefixed(max(float(np.max(values)) for _, values, _ in curves), si_unit)
    for colour, values, errors in curves:
        if errors is not None:
            draw_error_band(ax, times, values / scale, errors / scale, colour, "errors")
        ax.plot(times, values / scale, color=colour, linewidth=1.0)
    ax.set(ylabel=f"{label} ({write_unit(unit)})", ylim=(0.0, None))
