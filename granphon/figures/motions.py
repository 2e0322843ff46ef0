"""The figure of balls in motion: forces of contacts, or velocities of balls, over place and time."""

from __future__ import annotations

from typing import Literal

from granphon.figures.scales import add_bar

import numpy as np
from matplotlib.axes import Axes
from matplotlib.colors import TwoSlopeNorm

from granphon.base.errors import InputError, brief
from granphon.base.scales import prefixed
from granphon.waves.motion import Motion


def plot_motion(motion: Motion, ax: Axes, *, show: Literal["velocities", "forces"] = "velocities", axis: int = 0) -> Axes:
    """Draw a map over time: of each ball its velocity along ``axis``, or of each contact the change of its force.

    Balls, or contacts, are in the order of the network: along a chain, from left to right.
    """
    if show not in ("velocities", "forces") or axis not in (0, 1, 2):
        raise InputError(f"show is {brief(show)}, axis {brief(axis)}", mend="Give velocities or forces, 0, 1 or 2")
    values, what = motion.velocities[:, :, axis], f"Velocity along {'xyz'[axis]}"
    scale, unit = prefixed(max(float(np.abs(values).max()), 1e-300), "m/s")
    if show == "forces":
        values, what = motion.forces - motion.forces[0], "Change of force"
        scale, unit = prefixed(max(float(np.abs(values).max()), 1e-300), "N")
    factor, seconds = prefixed(float(motion.times[-1]), "s")
    most = max(float(np.abs(values).max()), 1e-300) / scale
    drawn = ax.pcolormesh(
        np.arange(values.shape[1]), motion.times / factor, values / scale, cmap="RdBu_r", shading="nearest", rasterized=True,
        norm=TwoSlopeNorm(0.0, -most, most),
    )  # fmt: skip
    ax.set(xlabel="Contact" if show == "forces" else "Ball", ylabel=f"Time ({seconds})")
    add_bar(ax, drawn, f"{what} ({unit})")
    return ax
