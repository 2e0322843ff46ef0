"""A pulse through a simulated sample, by its settings."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from granphon.waves.planes import Course
from granphon.waves.pulses import Pulse
from granphon.waves.settings import PulseSettings
from granphon.waves.waves import Waves

__all__ = ["send"]


def send(sample: Any, settings: PulseSettings, direction: ArrayLike | None = None) -> Pulse:
    """Send a pulse through a sample along ``direction``, Cartesian, (p,); None for x.

    Without a distance in the settings the receiving plane is half a period of the array away. Raises what
    :meth:`~granphon.waves.waves.Waves.transmit` raises.
    """
    waves = Waves(sample)
    periods = sum(waves.network.pbc)
    along = np.eye(periods)[0] if direction is None else np.asarray(direction, float)
    distance = settings.distance
    if distance is None:
        unit = np.zeros(3)
        unit[:periods] = along / np.linalg.norm(along)
        distance = 0.5 * Course.along(waves.network, unit).period
    return waves.transmit(
        settings.frequency, along, distance, settings.cycles, settings.polarisation, source=settings.source,
        ends=settings.ends, damping=settings.damping,
    )  # fmt: skip
