"""What the benchmarks share: calls timed in turns, results with the bound each is to keep, the
machine, the command line.

Nothing but the standard library is imported here, so that a process can be measured that imports
little else.
"""

from __future__ import annotations

import argparse
import json
import math
import os
import platform
import statistics
import subprocess
import sys
import time
from collections.abc import Callable, Mapping, Sequence
from importlib.metadata import version
from pathlib import Path
from typing import Any, NamedTuple, TypeVar

Found = TypeVar("Found")
#: takes the number of repeats
Part = Callable[[int], "list[Row]"]


class Row(NamedTuple):
    """A line of the table; ``bound`` is the most that ``value`` may be, or, with ``least``, the
    least.
    """

    what: str
    value: float
    unit: str = ""
    bound: float = math.inf
    least: bool = False
    note: str = ""

    @property
    def passed(self) -> bool:
        return self.value >= self.bound if self.least else self.value <= self.bound

    @property
    def cells(self) -> tuple[str, str, str, str]:
        """What was measured, the value, a note, and the bound."""
        bound = f"{'≥' if self.least else '≤'} {self.bound:g}" if math.isfinite(self.bound) else ""
        return self.what, f"{self.value:.3g} {self.unit}".strip(), self.note, bound

    def __str__(self) -> str:
        return line(*self.cells, self.verdict)

    @property
    def verdict(self) -> str:
        return ("pass" if self.passed else "FAIL") if math.isfinite(self.bound) else ""


def line(*cells: str) -> str:
    """A row of a table in Markdown."""
    return f"| {' | '.join(cells)} |"


def recorded(path: Path, numbers: Mapping[str, Any]) -> None:
    """Write numbers by name into a file of them; others in it stay."""
    before = json.loads(path.read_text(encoding="utf-8")) if path.is_file() else {}
    path.write_text(
        json.dumps(before | dict(numbers), indent=2, ensure_ascii=False) + "\n", encoding="utf-8"
    )


def alternate(
    repeats: int, clock: Callable[[], float] = time.perf_counter, **calls: Callable[[], object]
) -> dict[str, float]:
    """Median seconds of each call, taken in turns so that a busy machine slows all of them; by a
    ``clock``.
    """
    times: dict[str, list[float]] = {name: [] for name in calls}
    for call in calls.values():
        call()
    for _ in range(repeats):
        for name, call in calls.items():
            start = clock()
            call()
            times[name].append(clock() - start)
    return {name: statistics.median(values) for name, values in times.items()}


def peak() -> float:
    """Return the largest memory of this process so far, GiB; on Linux without what the process that
    started it had.
    """
    status = Path("/proc/self/status")
    if status.is_file():
        found = [
            line.split()[1]
            for line in status.read_text(encoding="utf-8").splitlines()
            if line.startswith("VmHWM")
        ]
        if found:
            return int(found[0]) / 2**20
    import resource

    return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 2**20


def spend(call: Callable[[], Found]) -> tuple[Found, dict[str, Any]]:
    """Return what a call finds, and what it takes: seconds by the clock and of the processor, and
    the peak of memory.
    """
    start = time.perf_counter()
    busy = time.process_time()
    found = call()
    return found, {
        "s": time.perf_counter() - start,
        "busy": time.process_time() - busy,
        "GiB": peak(),
    }


def run_alone(call: str) -> dict[str, Any]:
    """Return what a call prints as JSON, such as "bench_waves.alone(9)", in a process of its own:
    for its peak of memory.
    """
    command = [sys.executable, "-c", f"import {call.partition('.')[0]}; {call}"]
    done = subprocess.run(
        command, check=True, stdout=subprocess.PIPE, cwd=Path(__file__).resolve().parent
    )
    return dict(json.loads(done.stdout))


def over(
    what: str,
    seconds: Mapping[str, float],
    ours: str,
    other: str,
    bound: float = math.inf,
    least: bool = False,
    times: int = 1,
) -> Row:
    """The row of a ratio: ``times`` the time of one call over that of another."""
    note = " against ".join(
        f"{1e3 * s:.3g} ms" if s < 1.0 else f"{s:.3g} s" for s in (seconds[ours], seconds[other])
    )
    return Row(what, times * seconds[ours] / seconds[other], "", bound, least, note)


def bracketed(value: float, error: float) -> str:
    """A value with the standard error of its last digit, such as 0.3423(5)."""
    places = max(0, -math.floor(math.log10(error)))
    digit = round(error * 10.0**places)
    return f"{value:.{places}f}({digit})" if digit < 10 else f"{value:.{places - 1}f}(1)"


def measured(what: str, value: float, error: float, unit: str = "") -> Row:
    """The row of a number with its standard error."""
    return Row(what, float(value), unit, note=bracketed(float(value), float(error)))


def machine() -> dict[str, Any]:
    """What the numbers depend on."""
    import numpy as np

    name = platform.processor() or platform.machine()
    described = Path("/proc/cpuinfo")
    if described.is_file():
        lines = described.read_text(encoding="utf-8").splitlines()
        name = next(
            (line.partition(":")[2].strip() for line in lines if line.startswith("model name")),
            name,
        )
    config: Any = np.show_config(mode="dicts")
    blas = config["Build Dependencies"]["blas"]
    versions = {
        package: version(package)
        for package in ("numpy", "scipy", "ase", "phonopy", "matplotlib", "xarray")
    }
    return {
        "processor": name,
        "architecture": platform.machine(),
        "cores": os.cpu_count(),
        "load": os.getloadavg() if hasattr(os, "getloadavg") else None,
        "system": platform.system(),
        "python": platform.python_version(),
        "blas": f"{blas['name']} {blas['version']}",
        **versions,
    }


def command_line(
    description: str,
    parts: Mapping[str, Part],
    huge: Mapping[str, Part] | None = None,
    argv: Sequence[str] | None = None,
) -> int:
    """Run parts with as many repeats as the command line says; 1 if a bound is missed."""
    parser = argparse.ArgumentParser(description=description)
    parser.add_argument("--json", type=Path, help="also write the machine and the results here")
    parser.add_argument("--repeats", type=int, default=7)
    parser.add_argument(
        "--only",
        nargs="+",
        metavar="PART",
        choices=sorted({*parts, *(huge or ())}),
        help="these parts alone",
    )
    if huge:
        parser.add_argument(
            "--huge", action="store_true", help="ten million balls too: some minutes and some GiB"
        )
    options = parser.parse_args(argv)
    # first, as memory is measured in it
    chosen = {**((huge or {}) if getattr(options, "huge", False) else {}), **parts}
    results: dict[str, list[Row]] = {}
    about = machine()
    print(", ".join(f"{name} {value}" for name, value in about.items()))
    print("\n| what | measured | | bound | |\n|---|---|---|---|---|", flush=True)
    for name in options.only or chosen:
        results[name] = chosen[name](options.repeats)
        print(*results[name], sep="\n", flush=True)
    if options.json:
        rows = {
            name: [{**row._asdict(), "bound": row.bound if row.verdict else None} for row in found]
            for name, found in results.items()
        }
        recorded(options.json, {"machine": about, **rows})
    missed = [row.what for found in results.values() for row in found if not row.passed]
    for what in missed:
        print(f"missed: {what}", file=sys.stderr)
    return int(bool(missed))
