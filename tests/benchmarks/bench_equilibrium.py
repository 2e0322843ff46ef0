"""Equilibria of arrays beside those of another commit: processor times in turns, for a change that is to make them faster.

    python tests/benchmarks/bench_equilibrium.py BEFORE [--repeats N]

BEFORE is a folder with the other commit (``git worktree add BEFORE COMMIT``). Printed are the medians of both, and the
median of the ratio of neighbouring turns, so that other work on the machine disturbs both alike. Cases are 192 x 192 balls
in a plane and 28^3 of the fcc lattice, without friction, and along a path of four loads with it. A path begins where balls
that nothing holds are few: where they lie is not unique, and the iterations depend on it.
"""

from __future__ import annotations

import argparse
import math
import os
import statistics
import subprocess
import sys
import time
from collections.abc import Callable
from pathlib import Path
from typing import IO

SHAPES = {"triangular": (192, 192), "fcc": (28, 28, 28)}
CASES = [f"{lattice} {what}" for lattice in SHAPES for what in ("1.0", "0.7", "friction")]


def make(lattice: str, what: str) -> Callable[[], object]:
    """What solves a case once; what is made once for an array is made here."""
    import granphon as gp
    from granphon.array.equilibrium import equilibrate
    from granphon.array.geometry import ReducedLoad
    from granphon.array.history import LoadingHistory
    from granphon.array.stencils import Stencils
    from granphon.balls.lattices import find_lattice

    shape, kind = SHAPES[lattice], find_lattice(lattice)
    x = gp.Uniform(1.0).sample(shape, 0)
    x, smooth = x - x.mean(), Stencils(shape, lattice=kind)
    if what != "friction":
        return lambda: equilibrate(x, ReducedLoad(overlap=float(what) - 0.5), smooth)
    start, rough = equilibrate(x, ReducedLoad(overlap=0.2), smooth), Stencils(shape, 0.82, lattice=kind)
    loads = [ReducedLoad(overlap=spacing - 0.5) for spacing in (0.8, 0.9, 1.0, 0.8)]
    return lambda: list(LoadingHistory(x, rough, 0.3, math.inf, start).path(loads))


def serve() -> None:
    """Solve the case that each line names, and print how long it took."""
    case, solve = "", None
    for line in sys.stdin:
        if line.strip() != case or solve is None:
            case = line.strip()
            solve = make(*case.split())
            solve()
        start = time.process_time()
        solve()
        print(time.process_time() - start, flush=True)


def ask(process: subprocess.Popen[str], case: str) -> float:
    pipes: tuple[IO[str], IO[str]] = process.stdin, process.stdout  # type: ignore[assignment]  # both are pipes
    pipes[0].write(f"{case}\n")
    pipes[0].flush()
    return float(pipes[1].readline())


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("before", nargs="?", type=Path)
    parser.add_argument("--repeats", type=int, default=9)
    options = parser.parse_args()
    if options.before is None:
        serve()
        return
    folders = options.before.resolve(), Path(__file__).resolve().parents[2]
    both = [
        subprocess.Popen(
            [sys.executable, __file__], stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True,
            env={**os.environ, "PYTHONPATH": str(folder), "OMP_NUM_THREADS": "1"},
        )
        for folder in folders
    ]  # fmt: skip
    for case in CASES:
        for process in both:
            ask(process, case)
        turns = [[ask(process, case) for process in both] for _ in range(options.repeats)]
        before, now = (statistics.median(times) for times in zip(*turns, strict=True))
        ratio = statistics.median(one / other for one, other in turns)
        print(f"{case:20s} before {before:.3f} s, now {now:.3f} s, {ratio:.2f} times as fast", flush=True)
    for process in both:
        process.communicate()


if __name__ == "__main__":
    main()
