"""Benchmarks of compiled loops: what the first process on a machine takes to compile all loops of
statics, response, friction and motion, and what each later process takes to load them.

Both are times of the processor, of Numba alone: what loops then compute, and imports, are left out.
"""

from __future__ import annotations

import json
import os
import tempfile
import time
import warnings
from collections.abc import Callable
from typing import Any

from side_by_side import Part, Row, run_alone

#: cells along each period of arrays, by lattice, and loads a* of these
SHAPES = {"triangular": (24, 24), "fcc": (6, 6, 6)}
SPACINGS = (1.0, 0.7, 0.45)


def _rest(gp: Any, steel: Any) -> None:
    """Find arrays and crystals at rest, and their elastic tensors."""
    width = 2.04e-6
    for lattice, shape in SHAPES.items():
        packing = gp.Packing(steel, 8e-3, lattice=lattice, spread=gp.Uniform(width))
        for geometry in ("lattice", "exact"):
            for boundary in ("isotropic", "stress"):
                array = gp.DirectSimulation(packing, shape, 0, geometry=geometry, boundary=boundary)
                for spacing in SPACINGS:
                    gp.moduli(array.at_overlap((spacing - 0.5) * width))
    ball = gp.Ball(steel, 8e-3)
    gp.moduli(gp.Crystal.on("fcc", [ball]).repeat((4, 4, 4)).remove(0).at_pressure(1e5))
    column = gp.Crystal.on("chain", [ball]).cut(0, 1000, edges=("floor", "free"))
    column.at_pressure(5.0, gravity=(-9.81,))
    smooth = gp.Packing(steel, 8e-3, spread=gp.Uniform(width), friction=False)
    gp.Hexagon(smooth, 8, seed=0).at_side_force(500.0)


def _load_with_friction(gp: Any, steel: Any) -> None:
    """Load arrays with friction."""
    width = 2.04e-6
    for lattice in SHAPES:
        packing = gp.Packing(steel, 8e-3, lattice=lattice, spread=gp.Uniform(width))
        shape = (16, 16) if lattice == "triangular" else (4, 4, 4)
        for geometry in ("lattice", "exact"):
            array = gp.DirectSimulation(
                packing,
                shape,
                0,
                friction_history=True,
                friction_coefficient=0.2,
                geometry=geometry,
                step_tolerance=1.0,
            )
            for state in array.path(overlap=[0.1 * width, 0.25 * width, 0.4 * width]):
                gp.moduli(state)


def _move(gp: Any, steel: Any) -> None:
    """Let balls move by both schemes, with losses and without."""
    import bench_motion

    for sides in ((8, 8), (4, 4, 4)):
        waves, velocities, step, _ = bench_motion.array(sides)
        for geometry in ("lattice", "exact"):
            for damping, scheme in ((0.0, "verlet"), (1e-7, "verlet"), (0.0, "midpoint")):
                moving = gp.NonlinearWaves(
                    waves.network, friction_coefficient=0.3, geometry=geometry, damping=damping
                )
                moving.run(10 * step, velocities=velocities, step=step, frames=2, scheme=scheme)


def alone() -> None:
    """Print the processor time in s that Numba takes to compile loops, or to load them from its
    cache, and to be imported.
    """
    start = time.process_time()
    from numba.core.dispatcher import Dispatcher

    spent = {"import": time.process_time() - start, "loops": 0.0}
    depth = 0
    compile_loop = Dispatcher.compile

    def compile_in_time(dispatcher: Any, signature: Any) -> Any:
        """Compile or load a loop, with the loops that it calls."""
        nonlocal depth
        begin = time.process_time()
        depth += 1
        try:
            return compile_loop(dispatcher, signature)
        finally:
            depth -= 1
            if not depth:
                spent["loops"] += time.process_time() - begin

    Dispatcher.compile = compile_in_time
    import granphon as gp

    steel = gp.Material(young_modulus=211.65e9, poisson_ratio=0.276, density=7840.0)
    works: tuple[Callable[[Any, Any], None], ...] = (_rest, _load_with_friction, _move)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        for work in works:
            work(gp, steel)
    print(json.dumps(spent))


def compilation(repeats: int) -> list[Row]:
    """Compile all loops in a cache of their own, and load them from there."""
    before = os.environ.get("NUMBA_CACHE_DIR")
    with tempfile.TemporaryDirectory() as cache:
        os.environ["NUMBA_CACHE_DIR"] = cache
        try:
            first = run_alone("bench_compilation.alone()")
            later = [run_alone("bench_compilation.alone()") for _ in range(min(repeats, 3))]
        finally:
            del os.environ["NUMBA_CACHE_DIR"]
            if before is not None:
                os.environ["NUMBA_CACHE_DIR"] = before
    what = "all loops of statics, response, friction and motion"
    best = min(later, key=lambda spent: float(spent["loops"]))
    return [
        Row(f"{what}: compiled, once on a machine", first["loops"], "s", 45.0),
        Row("the same, loaded from the cache", best["loops"], "s", 0.8),
        Row("import of Numba", best["import"], "s"),
    ]


PARTS: dict[str, Part] = {"compilation": compilation}
