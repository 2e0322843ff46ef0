"""Benchmarks of balls in motion: steps of arrays with friction against LAMMPS, and a million balls,
a thousand steps.
"""

from __future__ import annotations

import json
import sys
import time
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
from side_by_side import Part, Row, alternate, over, run_alone, spend

#: steps of arrays that LAMMPS takes too, by the balls on each side
STEPS = {(32, 32): 2000, (200, 200): 400, (10, 10, 10): 1000, (30, 30, 30): 100}
#: balls on a side of the largest array, and its steps
LARGE = 1000
MANY = 1000
OVERLAP = 1e-5
MU = 0.3
D = 8e-3


def array(sides: tuple[int, ...]) -> tuple[Any, Any, float, Any]:
    """Return waves of a triangular or simple cubic array of steel balls with rotations and
    friction, random velocities, a step, and the steel.
    """
    import granphon as gp

    steel = gp.Material(young_modulus=193e9, poisson_ratio=0.30, density=8000.0)
    packing = gp.Packing(steel, D, lattice={2: "triangular", 3: "sc"}[len(sides)])
    network = gp.AveragedLattice(packing).at_overlap(OVERLAP * D).network.repeat(sides)
    own = float(np.sqrt(network.normal_stiffness[0] / network.masses[0]))
    velocities = np.zeros((network.n_balls, 3))
    axes = network.dimension
    velocities[:, :axes] = (
        OVERLAP * D * own * np.random.default_rng(0).standard_normal((network.n_balls, axes))
    )
    return gp.NonlinearWaves(network, friction_coefficient=MU), velocities, 0.02 / own, steel


def in_lammps(waves: Any, velocities: Any, step: float, steel: Any) -> Any:
    """Return an instance of LAMMPS with the same balls, which has made no step."""
    import ctypes

    sys.path.insert(0, str(Path(__file__).parents[2]))
    from tests import packings

    network = waves.network
    lmp = packings.start()
    cell = (1.0 - OVERLAP) * network.cell
    axes = network.dimension
    (a, _, _), (tilt, b, _), (_, _, c) = cell.tolist()
    places = np.zeros((network.n_balls, 3))
    inside = (1.0 - OVERLAP) * network.positions[:, :axes] @ np.linalg.inv(cell[:axes, :axes])
    places[:, :axes] = np.mod(inside + 0.01, 1.0) @ cell[:axes, :axes]
    low, high = (-D, D) if axes == 2 else (0.0, c)
    packings.fill(
        lmp, f"prism 0 {a!r} 0 {b!r} {low!r} {high!r} {tilt!r} 0 0", places, dimension=axes
    )
    nu = steel.poisson_ratio
    modulus = steel.young_modulus
    slip = f"mindlin_rescale/force {2.0 * modulus / (1.0 + nu) / (2.0 - nu)!r} 0 {MU}"
    lmp.commands_string(f"""
        set group all diameter {D!r} mass {float(network.masses[0])!r}
        pair_style granular
        pair_coeff * * hertz {2.0 / 3.0 * modulus / (1.0 - nu**2)!r} 0 tangential {slip} damping velocity
        neighbor 1e-3 bin
        fix move all nve/sphere
        timestep {step!r}""")
    lmp.scatter_atoms("v", 1, 3, (ctypes.c_double * velocities.size)(*velocities.ravel()))
    return lmp


def motion(repeats: int) -> list[Row]:
    """Steps against LAMMPS's on one core, in turns."""
    found = []
    for sides, steps in STEPS.items():
        waves, velocities, step, steel = array(sides)
        try:
            lmp = in_lammps(waves, velocities, step, steel)
        except (ImportError, OSError):
            print("LAMMPS cannot be loaded: motion is not compared", file=sys.stderr)
            break
        exact = type(waves)(waves.network, friction_coefficient=MU, geometry="exact")
        ours, true = (
            partial(one.run, steps * step, velocities=velocities, frames=2, step=step)
            for one in (waves, exact)
        )
        in_other = partial(lmp.command, f"run {steps} post no")
        seconds = alternate(repeats, time.process_time, ours=ours, true=true, lammps=in_other)
        what = f"{steps} steps of {'x'.join(map(str, sides))} balls with rotations and friction"
        found.append(
            over(f"{what}: over LAMMPS's pair granular, one core", seconds, "ours", "lammps", 1.0)
        )
        found.append(
            over(f"{what}, in true directions: over the same", seconds, "true", "lammps", 1.0)
        )
    return found


def million(_: int) -> list[Row]:
    """A million balls, once."""
    run = run_alone(f"bench_motion.alone({LARGE}, {MANY})")
    assert run["balance"] < 1e-3, "the sum of energies is wrong: the time would mean nothing"
    what = f"{MANY} steps of {LARGE}x{LARGE} balls with rotations and friction"
    return [
        Row(f"{what}: time of the processor", run["busy"], "s", 600.0),
        Row(f"{what}: peak memory of the process", run["GiB"], "GiB", 4.5),
    ]


def alone(side: int, steps: int) -> None:
    """Print what steps of a large array take."""
    waves, velocities, step, _ = array((side, side))
    run, spent = spend(lambda: waves.run(steps * step, velocities=velocities, frames=2, step=step))
    balance = abs(float((run.energy + run.lost)[-1] / run.energy[0]) - 1.0)
    print(json.dumps({**spent, "balance": balance}))


PARTS: dict[str, Part] = {"motion": motion, "million": million}
