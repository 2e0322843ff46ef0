"""Benchmarks of the loading with friction: ratios, each measured side by side in one run.

There are three units. One is the same path without friction: equilibria at the same loads, each
found from the one before. It tells what friction costs. The next is the mean of these equilibria,
each found anew, of which a path is to take at most forty. The last is one of them, that at a* = 1,
found a second time: the first call also imports what it needs. Equilibria at lower loads cost more:
the path without friction already takes some eighty of it. The path starts at rest without friction
at a* = 1/2, which is part of its cost, and its steps are refined as by default.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray
from side_by_side import Part, Row, alternate, over

STEPS = 40
ETA = 0.82


def draw(side: int) -> NDArray[np.float64]:
    """Deviations of uniformly spread balls, of mean zero."""
    import granphon as gp

    x = gp.Uniform(1.0).sample((side, side), 0)
    return np.asarray(x - np.mean(x))


def press(x: NDArray[np.float64], mu: float) -> float:
    """Return f* at the end of the path."""
    from granphon.array.history import LoadingHistory
    from granphon.array.options import ReducedLoad
    from granphon.array.stencils import Stencils

    history = LoadingHistory(x, Stencils(x.shape, ETA), mu)
    loads = [ReducedLoad(overlap=float(y)) for y in np.linspace(0.0, 0.5, STEPS + 1)[1:]]
    states = list(history.path(loads))
    assert all(state.residual <= 1e-9 for state in states)
    return states[-1].force


def sweep(x: NDArray[np.float64], overlaps: NDArray[np.float64]) -> None:
    """Find equilibria without friction, from that at a* = 1/2 on each from the one before."""
    from granphon.array.options import ReducedLoad
    from granphon.array.rest import bring_to_rest
    from granphon.array.stencils import Stencils

    stencils = Stencils(x.shape)
    state = bring_to_rest(x, ReducedLoad(overlap=0.0), stencils)
    for overlap in overlaps:
        state = bring_to_rest(x, ReducedLoad(overlap=float(overlap)), stencils, state)


def paths(repeats: int) -> list[Row]:
    """64 x 64 balls, in units of the same path without friction, of the mean of its equilibria, and
    of its last one.
    """
    from granphon.array.options import ReducedLoad
    from granphon.array.rest import bring_to_rest

    x, overlaps = draw(64), np.linspace(0.0, 0.5, STEPS + 1)[1:]
    bring_to_rest(x, ReducedLoad(overlap=0.5))
    rows = []
    for mu in (math.inf, 0.5, 0.2, 0.1):
        seconds = alternate(
            min(repeats, 3),
            path=lambda mu=mu: press(x, mu),
            sweep=lambda: sweep(x, overlaps),
            rests=lambda: [bring_to_rest(x, ReducedLoad(overlap=float(y))) for y in overlaps],
            rest=lambda: bring_to_rest(x, ReducedLoad(overlap=0.5)),
        )
        what = (
            f"path of {STEPS} loads, a* = 1/2 to 1, 64 x 64 balls, mu = {mu:g}: over the same"
            f" without friction"
        )
        rows += [
            # equilibria without friction take 0.6 of the time for which the bound was three
            over(what, seconds, "path", "sweep", 5.0),
            over(
                f"the same, mu = {mu:g}: over the mean equilibrium without friction at its loads",
                seconds,
                "path",
                "rests",
                40.0,
                times=STEPS,
            ),
            over(
                f"the same, mu = {mu:g}: over one equilibrium without friction at a* = 1",
                seconds,
                "path",
                "rest",
            ),
        ]
    rows.append(
        over("path without friction: over one equilibrium at a* = 1", seconds, "sweep", "rest")
    )
    return rows


PARTS: dict[str, Part] = {"paths": paths}
