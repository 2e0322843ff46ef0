"""Sweeps by two workers: what processes and the store cost beside the tasks themselves.

    python tests/benchmarks --only sweeps

The efficiency is that of tasks that sleep, so that it does not depend on what else the processors
do: the time that two workers would take if nothing but the tasks took any, over the time that they
take. Processes are started beforehand.
"""

from __future__ import annotations

import os
import tempfile
import time
from concurrent.futures import Executor
from pathlib import Path
from typing import Any

import numpy as np
from side_by_side import Part, Row

import granphon as gp
from granphon.runs.execution import solve_all
from granphon.runs.finished_tasks import Store
from granphon.runs.workers import open_executor

#: seconds of a task, number of tasks, least efficiency
TASKS = ((1.0, 8, 0.9), (0.01, 600, 0.7))
#: values of two parameters, whose combinations are the tasks of the averaged lattice
MANY = (250, 400)


class Nap:
    """A task that sleeps."""

    kind = "nap"
    steps = 1

    def __init__(self, number: int, seconds: float) -> None:
        self.number = number
        self.seconds = seconds

    @property
    def name(self) -> str:
        return f"nap-{self.seconds}-{self.number}"

    where = name

    def count_steps(self, part: dict[str, Any]) -> int:
        return 1

    def solve(self, begun: dict[str, Any] | None = None) -> dict[str, Any]:
        time.sleep(self.seconds)
        return {"x": np.array([self.number])}


def napping(executor: Executor, seconds: float, count: int) -> float:
    """The efficiency of two workers."""
    naps = [Nap(number, seconds) for number in range(count)]
    with tempfile.TemporaryDirectory() as folder:
        begun = time.perf_counter()
        solve_all("naps", naps, executor, store=Store(Path(folder) / "store"))
        return 0.5 * count * seconds / (time.perf_counter() - begun)


def efficiencies(repeats: int) -> list[Row]:
    rows = []
    with open_executor(workers=2) as executor:
        assert executor is not None
        solve_all("start", [Nap(-1 - number, 0.2) for number in range(6)], executor)
        for seconds, count, least in TASKS:
            runs = [napping(executor, seconds, count) for _ in range(max(1, repeats // 3))]
            what = f"Efficiency of `--workers 2`, {count} tasks of {seconds:g} s"
            rows.append(Row(what, float(np.median(runs)), bound=least, least=True))
    return rows


def many(_: int) -> list[Row]:
    """A sweep of the averaged lattice over two parameters, each combination a task, with a store.

    Its unit is half of the time that the tasks take in one process without files; some of them tell
    what one takes.
    """
    steel = gp.Material(young_modulus=211.65e9, poisson_ratio=0.276, density=7840.0)
    packing = gp.Packing(steel, diameter=8e-3, spread=gp.Uniform(2.04e-6))

    def solve(first: int, second: int, **how: Any) -> tuple[float, float]:
        widths, densities = np.linspace(1e-6, 3e-6, first), np.linspace(7000.0, 8000.0, second)
        begun, used = time.perf_counter(), time.process_time()
        ds = gp.sweep(packing, force=5.0, media="ala", width=widths, density=densities, **how)
        assert ds["longitudinal"].size == first * second
        return time.perf_counter() - begun, time.process_time() - used

    first, second = MANY
    solve(2, second)  # imports
    alone = 0.5 * first / 10 * solve(10, second)[0]
    with tempfile.TemporaryDirectory() as folder, open_executor(workers=2) as executor:
        seconds, used = solve(first, second, executor=executor, path=Path(folder) / "sweep.nc")
    load = f"load average {os.getloadavg()[0]:.1f}" if hasattr(os, "getloadavg") else ""
    note = (
        f"{seconds:.3g} s; {1e6 * used / (first * second):.0f} µs of each in the process that"
        f" sends them; {load}"
    )
    what = (
        f"{first * second:,} tasks of `ala`, two workers, with files: over half of the time of"
        f" one process without"
    )
    return [Row(what, seconds / alone, bound=2.5, note=note)]


PARTS: dict[str, Part] = {"sweeps": lambda repeats: [*efficiencies(repeats), *many(repeats)]}
