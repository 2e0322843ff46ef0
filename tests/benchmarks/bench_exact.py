"""Benchmarks of the exact geometry: processor times over those on the lattice, side by side in one
run.

Balls of W/d = 1e-7, where both have the same equilibria, rest under a given overlap; the exact
equilibrium begins at the sites. The ratios, without a bound, say what one solver for both
geometries would cost.
"""

from __future__ import annotations

import time

import numpy as np
from side_by_side import Part, Row

import granphon as gp
from granphon.array.equilibrium import Equilibrium
from granphon.array.geometry import ReducedLoad
from granphon.array.rest import equilibrate
from granphon.array.stencils import Stencils
from granphon.balls.lattices import find_lattice


def compare_limit(repeats: int) -> list[Row]:
    """The exact solver alone, from the sites, in the limit of small width."""
    rows = []
    for lattice, shape in (
        ("triangular", (64, 64)),
        ("triangular", (128, 128)),
        ("fcc", (12, 12, 12)),
    ):
        x = gp.Uniform(1.0).sample(shape, 0)
        stencils = Stencils(shape, lattice=find_lattice(lattice))
        x -= np.mean(x)
        for spacing in (1.0, 0.7):
            load = ReducedLoad(overlap=spacing - 0.5)
            times = []
            sites = Equilibrium(
                x, spacing - 0.5, np.zeros((stencils.n_fields, *shape)), lattice=stencils.lattice
            )
            for _ in range(repeats):
                marks = [time.process_time()]
                equilibrate(x, load, stencils)
                marks.append(time.process_time())
                equilibrate(x, load, stencils, sites, ratio=1e-7)
                times.append(np.diff([*marks, time.process_time()]))
            limit, exact = np.median(times, axis=0).tolist()
            name = f"{lattice} {'x'.join(map(str, shape))}, a* = {spacing:g}: exact, from the sites"
            rows.append(Row(name, exact / limit, "", note=f"{exact:.3g} s against {limit:.3g} s"))
    return rows


PARTS: dict[str, Part] = {"limit": compare_limit}
