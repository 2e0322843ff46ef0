"""Benchmarks of the effective medium: ratios, each measured side by side in one run."""

from __future__ import annotations

import math
import statistics
import time
from collections.abc import Callable

import numpy as np
from scipy.integrate import solve_ivp
from side_by_side import Part, Row, alternate, over

import granphon as gp
from granphon.balls.diameters import NormalShape, Shape, UniformShape
from granphon.balls.hertz import FORCE, STIFFNESS
from granphon.dynamics.local_field import _compute_local_field, _find_operations, local_field
from granphon.laws.effective import effective_curve
from granphon.laws.spread import high_pressure_series
from tests.references import balance

XI = local_field(mindlin_ratio=0.84).xi
SHAPES: dict[str, Shape] = {"uniform": UniformShape(), "normal": NormalShape(3.0)}
LOADS = 200_000
#: numbers of diameters, and how many times that of the uniform spread they may take
LOTS = ((16, 6.0), (64, 50.0), (100, 100.0))
#: lattice, Mindlin ratio, torsion and bending of local fields
FIELDS = (
    ("sc", 0.84, 0.0), ("bcc", 0.84, 0.0), ("fcc", 0.0, 0.0), ("fcc", 0.84, 0.0), ("fcc", 0.84, 0.05), ("hcp", 0.0, 0.0),
    ("hcp", 0.84, 0.0), ("hcp", 0.84, 0.05), ("diamond", 0.84, 0.05),
)  # fmt: skip
#: f* at the lower end of the integration
LEAST = 1e-4


def plain(shape: Shape) -> tuple[float, float]:
    """y and k at f* = 1e-4 by scipy alone: k' = (k - G_y)/G_k with the same averages, downwards
    from the same start.
    """
    start = high_pressure_series(shape, XI).start

    def state(y: float, k: float) -> tuple[float, float, float]:
        x, weights = shape.nodes(y)
        return balance(
            (weights, shape.force(y, x), shape.stiffness(y, x), shape.stiffness_slope(y, x)), k, XI
        )

    def slope(y: float, k: np.ndarray) -> list[float]:
        _, by_y, by_k = state(y, k[0])
        return [(k[0] - by_y) / by_k]

    def least(y: float, k: np.ndarray) -> float:
        return math.log(state(y, k[0])[0] / LEAST)

    least.terminal = True  # type: ignore[attr-defined]
    k = high_pressure_series(shape, XI).value(start, STIFFNESS)
    # no absolute tolerance: k falls by three decades
    out = solve_ivp(
        slope, (start, shape.openings[0]), [k], "Radau", rtol=1e-8, atol=0.0, events=least
    )
    return float(out.t[-1]), float(out.y[0, -1])


def cold(shape: Shape) -> object:
    """The curve, with nothing kept."""
    effective_curve.cache_clear()
    high_pressure_series.cache_clear()
    return effective_curve(shape, XI)


def curves(repeats: int) -> list[Row]:
    """A cold solution against a plain Radau integration of the same equation over the same
    range.
    """
    rows = []
    for name, shape in SHAPES.items():
        y, k = plain(shape)
        curve = effective_curve(shape, XI)
        found = (
            float(curve.value(np.array([y]), FORCE)[0]),
            float(curve.value(np.array([y]), STIFFNESS)[0]),
        )
        assert np.allclose(found, (LEAST, k), rtol=1e-6), (
            "the two disagree: the ratio would mean nothing"
        )
        calls: dict[str, Callable[[], object]] = {
            "granphon": lambda shape=shape: cold(shape),
            "radau": lambda shape=shape: plain(shape),
        }
        seconds = alternate(repeats, **calls)
        what = f"the curve f*(a*), nothing kept, {name}: over scipy's Radau"
        rows.append(over(what, seconds, "granphon", "radau", 0.2))
    return rows


def lots(repeats: int) -> list[Row]:
    """A cold solution for random lots of balls, each diameter another, against that of the uniform
    spread.
    """
    rows = []
    for n, bound in LOTS:
        shape = gp.Measured(tuple(8e-3 + 1e-6 * np.random.default_rng(n).normal(size=n))).shape
        calls: dict[str, Callable[[], object]] = {
            "lot": lambda shape=shape: cold(shape),
            "uniform": lambda: cold(SHAPES["uniform"]),
        }
        seconds = alternate(repeats, **calls)
        what = f"the curve of {n} balls, each diameter another: over that of the uniform spread"
        rows.append(over(what, seconds, "lot", "uniform", bound))
    return rows


def printed(y: np.ndarray) -> np.ndarray:
    """The averaged force of the uniform distribution in powers, as one would type it: loses digits
    at large y.
    """
    sides = (np.maximum(y + s, 0.0) ** 3.5 for s in (0.5, 0.0, -0.5))
    above, middle, below = sides
    return 16.0 / 35.0 * (above - 2.0 * middle + below)


def loads(repeats: int) -> list[Row]:
    """200,000 loads through the medium, the curve known, against one evaluation of the averaged
    force on the same loads.
    """
    steel = gp.Material(211.65e9, 0.276, 7840.0)
    packing = gp.Packing(steel, 8e-3, spread=gp.Uniform(2.04e-6))
    effective, average = gp.EffectiveMedium(packing), gp.AveragedForce(packing)
    forces = (
        packing.law.coefficient * math.sqrt(packing.width) ** 3 * np.geomspace(1e-3, 1e3, LOADS)
    )
    overlaps = effective.at_force(forces).overlap
    seconds = alternate(
        repeats,
        granphon=lambda: effective.at_force(forces),
        averaged=lambda: average.law.force(overlaps),
        printed=lambda: printed(overlaps / packing.width),
    )
    what = (
        "200,000 loads, f* = 1e-3 to 1e3, the curve known: over one evaluation of the averaged"
        " force"
    )
    return [
        over(what, seconds, "granphon", "averaged", 2.0),
        over(f"{what}, as printed powers", seconds, "granphon", "printed", 10.0),
    ]


def fields(repeats: int) -> list[Row]:
    """Processor time of Xi in space, to 1e-8, nothing kept: no more than 5 s."""
    rows = []
    for name, eta, rolling in FIELDS:
        seconds = []
        for _ in range(min(repeats, 3)):
            _compute_local_field.cache_clear()
            _find_operations.cache_clear()
            start = time.process_time()
            local_field(name, eta, torsion=rolling, bending=rolling)
            seconds.append(time.process_time() - start)
        what = f"Ξ of {name}, η = {eta:g}" + f", torsion and bending {rolling:g}" * bool(rolling)
        rows.append(Row(what, statistics.median(seconds), "s", 5.0))
    return rows


PARTS: dict[str, Part] = {"curves": curves, "lots": lots, "loads": loads, "fields": fields}
