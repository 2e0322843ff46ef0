"""What a simulation will need, before it runs: memory and time.

Memory follows from the arrays. Time is that of a small sample, found here and now, times what the load adds: the nearer the
rigidity threshold, the more steps each equilibrium takes. The powers were fitted to runs of 64^2 to 256^2 balls between
f* = 1e-3 and 30, of which the estimate is within a factor of three.
"""

from __future__ import annotations

import math
import os
from dataclasses import dataclass
from functools import cache
from time import perf_counter
from typing import Literal

import numpy as np
from numpy.typing import ArrayLike, NDArray

from granphon.diameters import uniform_numbers
from granphon.equilibrium import Load, equilibrate
from granphon.simulation import DirectSimulation

__all__ = ["Cost", "estimate", "machine_memory"]

Array = NDArray[np.float64]
#: what Python and its libraries take, bytes
_BASE = 80e6
#: bytes for each ball at work, without and with rotations; of each further sample and equilibrium that is kept
_WORKING, _TURNING, _SAMPLE, _KEPT = 450.0, 620.0, 8.0, 17.0
#: a* and f* of uniform diameters, between which loads given as overlaps are placed
_SPACING = np.array([0.345, 0.35, 0.363, 0.42, 0.5, 0.7, 1.0])
_FORCE = np.array([5e-5, 2e-4, 8.4e-4, 7.3e-3, 2.55e-2, 0.1163, 0.3678])
#: a linear response over its equilibrium, without and with rotations
_STILL, _TURNED = 0.8, 1.4
#: the small sample
_SHAPE, _AT = (96, 96), 1.0


@dataclass(frozen=True)
class Cost:
    """``memory`` in bytes, ``work`` in balls of the small sample, ``balls`` of one sample, and how many ``equilibria``."""

    memory: float
    work: float
    balls: int
    equilibria: int

    @property
    def seconds(self) -> float:
        """Of one processor of this machine, on which the small sample is tried when first asked."""
        return self.work * _second_per_ball()

    @property
    def text(self) -> str:
        """One line."""
        many = f", {self.equilibria} equilibria" if self.equilibria > 1 else ""
        memory = f"{self.memory / 1e9:.2g} GB" if self.memory >= 1e9 else f"{self.memory / 1e6:.0f} MB"
        return f"simulation of {self.balls:,} balls{many}: about {memory} and {_duration(self.seconds)}"


def machine_memory() -> float:
    """Of this machine, bytes; infinite where the system does not say."""
    names = ("SC_PHYS_PAGES", "SC_PAGE_SIZE")
    if not set(names) <= set(getattr(os, "sysconf_names", ())):
        return math.inf
    return math.prod(float(os.sysconf(name)) for name in names)


def _duration(seconds: float) -> str:
    for size, unit in ((86400.0, "days"), (3600.0, "h"), (60.0, "min")):
        if seconds >= 2.0 * size:
            return f"{seconds / size:.2g} {unit}"
    return f"{seconds:.0f} s" if seconds >= 10.0 else f"{seconds:.2g} s"


def estimate(
    simulation: DirectSimulation, kind: Literal["force", "pressure", "overlap"], values: ArrayLike, moduli: bool = True
) -> Cost:
    """Memory and time of the states at these loads (SI), and of their ``moduli``, on one processor of this machine.

    Meant for loads above the rigidity threshold: what lies below is taken to be at it.
    """
    loads = np.atleast_1d(np.asarray(values, float)).ravel()
    balls, count = int(np.prod(simulation.shape)), loads.size * simulation.samples
    packing = simulation.packing
    turning = moduli and packing.friction
    kept = _SAMPLE * (simulation.samples - 1) + _KEPT * (count - 1)
    memory = _BASE + balls * ((_TURNING if turning else _WORKING) + kept)
    if not packing.width:
        return Cost(memory, 0.1 * balls * count, balls, count)
    force = np.maximum(_reduced_force(simulation, kind, loads), _FORCE[0])
    rest = _steps(force)
    linear = rest * (_TURNED if turning else _STILL) if moduli else 0.0
    relative = float(np.sum(rest + linear) / _steps(np.interp(_AT, _SPACING, _FORCE)))
    return Cost(memory, relative * balls * simulation.samples, balls, count)


def _reduced_force(simulation: DirectSimulation, kind: str, loads: Array) -> Array:
    """f*, about."""
    packing = simulation.packing
    unit = packing.law.coefficient * packing.width**1.5
    if kind == "overlap":
        spacing = loads / packing.width + 0.5
        near = np.exp(np.interp(np.log(np.maximum(spacing, _SPACING[0])), np.log(_SPACING), np.log(_FORCE)))
        return np.asarray(np.where(spacing > _SPACING[-1], np.maximum(spacing - 0.5, 0.0) ** 1.5, near))
    if kind == "pressure":
        loads = loads * packing.diameter / packing.structure.pressure_factor
    return np.asarray(loads / unit)


def _steps(force: ArrayLike) -> Array:
    """What an equilibrium costs a ball, in arbitrary units, by the reduced force."""
    return np.asarray(1.0 + 0.37 * np.asarray(force, float) ** -0.7)


@cache
def _second_per_ball() -> float:
    """Of the small sample at a* = 1, with its stiffness, on this machine."""
    deviations = uniform_numbers(_SHAPE, 0) - 0.5
    deviations -= np.mean(deviations)
    times = []
    for _ in range(3):
        start = perf_counter()
        _ = equilibrate(deviations, Load(overlap=_AT - 0.5)).stiffness
        times.append(perf_counter() - start)
    return min(times) / deviations.size
