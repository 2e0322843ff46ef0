"""Benchmarks of the direct simulation: ratios, each measured side by side in one run, each with the
bound it is to keep.

``--huge`` adds ten million balls, some minutes and some GiB. Balls are spread
uniformly and rest under a given overlap; one thread throughout.
"""

from __future__ import annotations

import json
import time
from collections.abc import Callable
from functools import partial
from types import MappingProxyType
from typing import Any
from unittest import mock

import numpy as np
from numpy.typing import NDArray
from side_by_side import Part, Row, alternate, over, run_alone, spend

import granphon as gp
from granphon.array.equilibrium import REST_TOLERANCE, Equilibrium
from granphon.array.options import ReducedLoad
from granphon.array.rest import bring_to_rest
from granphon.array.stencils import Stencils
from granphon.balls.lattices import TRIANGULAR
from granphon.statics.lattice_equations import LatticeEquations
from granphon.statics.options import RestOptions
from tests.sparse_array import SparseArray

Array = NDArray[np.float64]
#: a*, tolerance, seconds of LAMMPS's FIRE on two cores (given numbers: LAMMPS is not run), times
#: faster
FIRE = ((1.0, 1e-9, 0.9, 10.0), (0.7, 1e-9, 32.0, 30.0), (0.5, 5e-8, 70.0, 20.0))
#: a*, times faster than Newton's method with a sparse LU
DIRECT = ((1.0, 15.0), (0.7, 4.0))
SEEDS = range(4)
#: balls on a side, of a million and of ten million
MILLION = 1000
HUGE = 3164
#: width of the spread of diameters, m
WIDTH = 2.04e-6
#: rigidity threshold, a*
THRESHOLD = 0.343


def balls(length: int, seed: int = 0) -> Array:
    x = gp.Uniform(1.0).sample((length, length), seed)
    return x - np.mean(x)


def residual(state: Equilibrium) -> float:
    """Largest force left on a ball over the mean contact force, from the contact forces alone."""
    forces, net = state.forces, np.zeros((2, *state.deviations.shape))
    for force, normal, shift in zip(
        forces, TRIANGULAR.contacts.normal, TRIANGULAR.contacts.shift, strict=True
    ):
        net += normal[:, None, None] * (np.roll(force, shift, (0, 1)) - force)
    return float(np.sqrt(np.max(np.sum(net**2, axis=0))) / np.mean(forces))


# -- Newton's method with a sparse LU --------------------------------------------------------------


def direct(repeats: int) -> list[Row]:
    """128 x 128 balls against the LU: same tolerance, same start; what both make once for the array
    is left out.
    """
    x = balls(128)
    rows = []
    stencils, other = Stencils(x.shape), SparseArray(x)
    for spacing, bound in DIRECT:
        load = ReducedLoad(overlap=spacing - 0.5)
        ours, theirs = bring_to_rest(x, load, stencils), other.forces(spacing - 0.5)
        apart = np.max(np.abs(ours.forces - theirs)) / ours.force
        assert apart < 1e-8, "the two disagree: the ratio would mean nothing"
        calls: dict[str, Callable[[], object]] = {
            "granphon": lambda load=load: bring_to_rest(x, load, stencils),
            "lu": lambda load=load: other.forces(load.overlap),
        }
        seconds = alternate(repeats, **calls)
        what = (
            f"128x128, a* = {spacing:g}, to 1e-10: times faster than Newton's method with sparse LU"
        )
        rows.append(over(what, seconds, "lu", "granphon", bound, least=True))
    return rows


# -- growth ----------------------------------------------------------------------------------------


def clocks() -> Array:
    """Wall and processor time, s."""
    return np.array([time.perf_counter(), time.process_time()])


def iterate(x: Array, stencils: Stencils) -> tuple[Equilibrium, Array]:
    """At a* = 1, and what an iteration of conjugate gradients cost on both clocks, its share of
    their beginning included.
    """
    solve, spent = LatticeEquations.solve, np.zeros(2)

    def timed(*arguments: Any, **more: Any) -> object:
        nonlocal spent
        start = clocks()
        found = solve(*arguments, **more)
        spent += clocks() - start
        return found

    with mock.patch.object(LatticeEquations, "solve", timed):
        state = bring_to_rest(x, ReducedLoad(overlap=0.5), stencils)
    return state, spent / state.conjugate


def growth(repeats: int) -> list[Row]:
    """From 65,536 to 1,048,576 balls, in turns."""
    arrays = {length: Stencils((length, length)) for length in (256, 1024)}
    for length, stencils in arrays.items():
        iterate(balls(length), stencils)
    costs: dict[int, list[Array]] = {length: [] for length in arrays}
    counts = {length: [0] * len(SEEDS) for length in arrays}
    worst = 0.0
    for _ in range(repeats):
        for seed in SEEDS:
            for length, stencils in arrays.items():
                state, cost = iterate(balls(length, seed), stencils)
                costs[length].append(cost)
                counts[length][seed] = state.conjugate
                worst = max(worst, residual(state))
    small, large = (1e3 * np.median(costs[length], axis=0) for length in arrays)
    few, many = (float(np.mean(counts[length])) for length in arrays)
    of = "1024x1024 against 256x256, a* = 1"
    rows = [
        Row(
            f"{of}: cost of an iteration, {clock}",
            b / a,
            "",
            23.0,
            note=f"{b:.3g} ms against {a:.3g} ms",
        )
        for clock, a, b in zip(("wall time", "processor time"), small, large, strict=True)
    ]
    return [
        *rows,
        Row(
            f"{of}: iterations, mean of four seeds",
            many / few,
            "",
            1.5,
            note=f"{many:.4g} against {few:.4g}",
        ),
        Row(f"{of}: largest residual of all", worst, "", REST_TOLERANCE),
    ]


# -- alone in a process ----------------------------------------------------------------------------


def alone(length: int) -> None:
    """Print what a sample at a* = 1 takes: in a process of its own, as memory is counted from its
    beginning.
    """
    state, spent = spend(lambda: bring_to_rest(balls(length), ReducedLoad(overlap=0.5)))
    print(
        json.dumps(
            {
                **spent,
                "newton": state.newton,
                "conjugate": state.conjugate,
                "residual": residual(state),
            }
        )
    )


def memory(length: int, bound: float) -> Callable[[int], list[Row]]:
    """Once: the peak does not vary. To be run first, as a process also inherits the peak of the one
    that starts it.
    """

    def part(repeats: int) -> list[Row]:
        seen = run_alone(f"bench_simulation.alone({length})")
        of = f"{length}x{length}, a* = 1"
        took = (
            f"{seen['newton']} steps, {seen['conjugate']} iterations, {seen['busy']:.3g} s of"
            f" processor time"
        )
        return [
            Row(f"{of}: peak memory of the process", seen["GiB"], "GiB", bound),
            Row(f"{of}: time of the first sample", seen["s"], "s", note=took),
            Row(f"{of}: residual", seen["residual"], "", REST_TOLERANCE),
        ]

    return part


def alone_at_overlap(length: int) -> None:
    """Print what the state of a simulation at a* = 1 takes, with the exponents that it finds of its
    sample: in a process of its own, as memory is counted from its beginning.
    """
    steel = gp.Material(young_modulus=211.65e9, poisson_ratio=0.276, density=7840.0)
    packing = gp.Packing(steel, 8e-3, spread=gp.Uniform(WIDTH), friction=False)
    simulation = gp.DirectSimulation(packing, (length, length), 0, geometry="lattice")
    _, spent = spend(lambda: simulation.at_overlap(0.5 * WIDTH))
    print(json.dumps(spent))


def state_memory(_: int) -> list[Row]:
    """A million balls, once, as a user asks for them."""
    seen = run_alone(f"bench_simulation.alone_at_overlap({MILLION})")
    of = f"{MILLION}x{MILLION}, a* = 1: a state of DirectSimulation"
    return [
        Row(f"{of}, peak memory of the process", seen["GiB"], "GiB", 0.45),
        Row(f"{of}, processor time", seen["busy"], "s"),
    ]


# -- near the rigidity threshold -------------------------------------------------------------------


#: balls along a side, times faster
NEAR = ((128, 1.5), (256, 2.0))


def near_threshold(repeats: int) -> list[Row]:
    """Half of the contacts open: against Newton's method with Green's function only, same
    tolerance.
    """
    rows = []
    for length, bound in NEAR:
        x, load = balls(length), ReducedLoad(overlap=THRESHOLD + 0.02 - 0.5)
        stencils = Stencils(x.shape)

        def before(of: Callable[[], Any]) -> Any:
            stiff_part = MappingProxyType({1: -1.0, 2: -1.0, 3: -1.0})
            options = partial(RestOptions, closed_part=0.0, stiff_part=stiff_part)
            with (
                mock.patch("granphon.array.rest.RestOptions", options),
                mock.patch("granphon.statics.lattice_equations.RestOptions", options),
            ):
                return of()

        def solve(
            x: Array = x, load: ReducedLoad = load, stencils: Stencils = stencils
        ) -> Equilibrium:
            return bring_to_rest(x, load, stencils)

        ours, theirs = solve(), before(solve)
        apart = np.max(np.abs(ours.forces - theirs.forces)) / ours.force
        assert apart < 1e-8, "the two disagree: the ratio would mean nothing"
        calls: dict[str, dict[str, Callable[[], object]]] = {
            "equilibrium": {
                "now": solve,
                "before": lambda before=before, solve=solve: before(solve),
            },
            "stiffness of the sample": {
                "now": ours.response,
                "before": lambda before=before, ours=ours: before(ours.response),
            },
        }
        took = (
            f"{ours.newton} steps, {ours.conjugate} iterations against {theirs.newton},"
            f" {theirs.conjugate}"
        )
        for what, pair in calls.items():
            seconds = alternate(min(repeats, 3), **pair)
            of = (
                f"{length}x{length}, a* = {THRESHOLD + 0.02:g}: {what}, times faster than with"
                f" Green's function only"
            )
            row = over(of, seconds, "before", "now", bound, least=True)
            rows.append(row._replace(note=f"{took}, {row.note}") if what == "equilibrium" else row)
    return rows


# -- seconds ---------------------------------------------------------------------------------------


def fire(repeats: int) -> list[Row]:
    """128 x 128 balls against given times of another method."""
    x = balls(128)
    rows = []
    for spacing, tolerance, given, bound in FIRE:
        load = ReducedLoad(overlap=spacing - 0.5)
        state = bring_to_rest(x, load, tolerance=tolerance)
        assert residual(state) <= tolerance, "not at rest: the ratio would mean nothing"
        (seconds,) = alternate(
            repeats, granphon=lambda load=load, t=tolerance: bring_to_rest(x, load, tolerance=t)
        ).values()
        what = (
            f"128x128, a* = {spacing:g}, to {tolerance:g}: times faster than LAMMPS's FIRE on two"
            f" cores"
        )
        rows.append(
            Row(
                what,
                given / seconds,
                "",
                bound,
                least=True,
                note=f"{seconds:.3g} s against a given {given:g} s",
            )
        )
    return rows


def seconds(repeats: int) -> list[Row]:
    """Whole solutions, nothing kept; fewer repeats, as they are long."""
    rows = []
    for length, spacing in ((512, 1.0), (256, THRESHOLD + 0.02)):
        x, load = balls(length), ReducedLoad(overlap=spacing - 0.5)
        state = bring_to_rest(x, load)
        (median,) = alternate(
            min(repeats, 3), granphon=lambda x=x, load=load: bring_to_rest(x, load)
        ).values()
        of = f"{length}x{length}, a* = {spacing:g}"
        took = f"{state.newton} steps, {state.conjugate} iterations"
        rows.append(Row(f"{of}, to 1e-10", median, "s", note=took))
        rows.append(Row(f"{of}: residual", residual(state), "", REST_TOLERANCE))
    return rows


#: memory first: it is measured in a process that inherits the peak of this one
PARTS: dict[str, Part] = {
    "memory": memory(1024, 0.45),
    "state-memory": state_memory,
    "direct": direct,
    "growth": growth,
    "near": near_threshold,
    "fire": fire,
    "seconds": seconds,
}
HUGE_PARTS: dict[str, Part] = {"huge": memory(HUGE, 24.0)}
