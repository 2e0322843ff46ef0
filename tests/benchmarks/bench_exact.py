"""Benchmarks of the exact geometry: processor times over those on the lattice, side by side in one run, with their bounds.

    python tests/benchmarks/bench_exact.py [--json FILE] [--repeats N] [--only PART ...]

The exit code is 1 if a bound is missed. Balls of W/d = 2.55e-4, spread uniformly, rest under a given overlap. The time of an
exact equilibrium includes that of the lattice's from which it begins. The response is that of the stiffness. The part
``limit`` has W/d = 1e-7, where both have the same equilibria, and begins the exact one at the sites: its ratios, without a
bound, say what one solver for both geometries would cost.
"""

from __future__ import annotations

import statistics
import sys
import time
from collections.abc import Callable

import numpy as np
from side_by_side import Part, Row, command_line

import granphon as gp
from granphon.array.equilibrium import Equilibrium, equilibrate
from granphon.array.geometry import ReducedLoad
from granphon.array.stencils import Stencils
from granphon.array.true_equilibrium import equilibrate_exactly
from granphon.balls.lattices import find_lattice

SIZES = (64, 128, 256)
SPACINGS = (1.5, 1.0, 0.8, 0.7, 0.6, 0.5, 0.45, 0.4)
RATIO = 2.55e-4
#: least a* of the first bound, and times of the lattice's, from there up and below
DENSE, MOST = 0.7, (5.0, 15.0)


def measure(find: Callable[[], Equilibrium]) -> tuple[float, float]:
    """Seconds of the processor for an equilibrium and for its response."""
    start = time.process_time()
    state = find()
    there = time.process_time()
    assert state.stiffness > 0.0
    return there - start, time.process_time() - there


def compare(length: int) -> Part:
    def part(repeats: int) -> list[Row]:
        x = gp.Uniform(1.0).sample((length, length), 1)
        x, stencils, rows = x - np.mean(x), Stencils((length, length)), []
        equilibrate_exactly(x[:8, :8] - np.mean(x[:8, :8]), ReducedLoad(overlap=0.0), RATIO)  # imports what it needs
        for spacing in SPACINGS:
            load, times = ReducedLoad(overlap=spacing - 0.5), []
            calls = (
                lambda load=load: equilibrate(x, load, stencils),
                lambda load=load: equilibrate_exactly(x, load, RATIO, stencils),
            )
            measure(calls[0])
            for _ in range(repeats):
                times.append([second for call in calls for second in measure(call)])
            limit, follow, exact, respond = (statistics.median(one) for one in zip(*times, strict=True))
            bound = MOST[spacing < DENSE]
            for what, ours, other in (("equilibrium", exact, limit), ("response", respond, follow)):
                note = f"{ours:.3g} s against {other:.3g} s"
                rows.append(Row(f"{length}x{length}, a* = {spacing:g}: {what}", ours / other, "", bound, note=note))
        return rows

    return part


def compare_limit(repeats: int) -> list[Row]:
    """The exact solver alone, from the sites, in the limit of small width."""
    rows = []
    for lattice, shape in (("triangular", (64, 64)), ("triangular", (128, 128)), ("fcc", (12, 12, 12))):
        x, stencils = gp.Uniform(1.0).sample(shape, 0), Stencils(shape, lattice=find_lattice(lattice))
        x -= np.mean(x)
        for spacing in (1.0, 0.7):
            load, times = ReducedLoad(overlap=spacing - 0.5), []
            sites = Equilibrium(x, spacing - 0.5, np.zeros((stencils.n_fields, *shape)), lattice=stencils.lattice)
            for _ in range(repeats):
                marks = [time.process_time()]
                equilibrate(x, load, stencils)
                marks.append(time.process_time())
                equilibrate_exactly(x, load, 1e-7, stencils, sites)
                times.append(np.diff([*marks, time.process_time()]))
            limit, exact = np.median(times, axis=0).tolist()
            name = f"{lattice} {'x'.join(map(str, shape))}, a* = {spacing:g}: exact, from the sites"
            rows.append(Row(name, exact / limit, "", note=f"{exact:.3g} s against {limit:.3g} s"))
    return rows


PARTS: dict[str, Part] = {f"exact-{length}": compare(length) for length in SIZES} | {"limit": compare_limit}

if __name__ == "__main__":
    sys.exit(command_line("Benchmarks of the exact geometry", PARTS))
