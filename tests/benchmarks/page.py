"""The tables of docs/reference/benchmarks.md, from the numbers of a run.

    python tests/benchmarks --json docs/reference/benchmarks.json
    python tests/benchmarks/costs.py --json docs/reference/benchmarks.json
    python tests/benchmarks/page.py

``tests/test_benchmarks.py`` holds the page to the numbers beside it.
"""

from __future__ import annotations

import json
import math
import re
import sys
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import bench_arrays
import bench_calculator
import bench_compilation
import bench_crystals
import bench_effective
import bench_motion
import bench_ordered
import bench_pulses
import bench_sensitivities
import bench_simulation
import bench_statics
import bench_waves
from side_by_side import Row, line

PAGE = Path(__file__).resolve().parents[2] / "docs" / "reference" / "benchmarks.md"
NUMBERS = PAGE.with_suffix(".json")
#: the tables of the page, and the parts of the benchmarks in each
TABLES = {
    "ordered": (*bench_ordered.PARTS, *bench_crystals.PARTS),
    "calculator": tuple(bench_calculator.PARTS),
    "effective": tuple(bench_effective.PARTS),
    "simulation": (*bench_simulation.PARTS, *bench_arrays.PARTS),
    "statics": tuple(part for part in bench_statics.PARTS if part != "limit"),
    "compilation": tuple(bench_compilation.PARTS),
    "waves": (*bench_pulses.PARTS, *bench_waves.PARTS),
    "sensitivities": tuple(bench_sensitivities.PARTS),
    "motion": tuple(bench_motion.PARTS),
}
_HEAD = "| what | measured | | bound |\n|---|---|---|---|\n"
#: parts of many arrays at the same loads, of which each load is a column
_BY_LOAD = ("rests", "tensors", "doors")
#: what such a row says: the array, its load, perhaps its directions, and what was measured
_AT_LOAD = re.compile(
    r"(?P<array>.+), a\* = (?P<load>[\d.]+)(?:, (?P<directions>\w+) directions)?: (?P<what>.+)"
)


def rows(found: list[Mapping[str, Any]]) -> list[Row]:
    """The rows of a part, as they were before they were written."""
    return [
        Row(**{**one, "bound": math.inf if one["bound"] is None else one["bound"]}) for one in found
    ]


def table(parts: tuple[str, ...], numbers: Mapping[str, Any]) -> str:
    """A table of the page; the verdict is left out, as a bound that is missed ends the run with an
    error. Parts of many arrays at the same loads have tables of their own behind it.
    """
    lines = [
        line(*row.cells) + "\n"
        for part in parts
        if part not in _BY_LOAD
        for row in rows(numbers[part])
    ]
    by_load = [by_loads(rows(numbers[part])) for part in parts if part in _BY_LOAD]
    return (_HEAD + "".join([*lines, *by_load])).replace("a*", r"a\*").replace("f*", r"f\*")


def by_loads(found: list[Row]) -> str:
    """Tables with a row for each array and a column for each load: ratios, with their bounds."""
    tables: dict[str, dict[str, dict[str, str]]] = {}
    for row in found:
        parts = _AT_LOAD.fullmatch(row.what)
        assert parts is not None
        array = parts["array"]
        if parts["directions"]:
            array += f", {parts['directions']}"
        _, ratio, _, bound = row.cells
        ratios = tables.setdefault(parts["what"], {}).setdefault(array, {})
        ratios[parts["load"]] = f"{ratio} ({bound})"
    text = ""
    for what, arrays in tables.items():
        loads = next(iter(arrays.values()))
        heads = [f"{what}, at a* =", *loads]
        lines = [line(*heads), "|" + "---|" * len(heads)]
        lines += [line(array, *ratios.values()) for array, ratios in arrays.items()]
        text += "\n" + "\n".join(lines) + "\n"
    return text


def costs(found: Mapping[str, Any]) -> str:
    """What scenes cost, and on which machine."""
    heads = (
        "scene",
        "costly modules",
        "costly calls",
        "files",
        "time",
        "without figures",
        "memory over data",
    )
    lines = [line(*heads), "|" + "---|" * len(heads)]
    for one in found["scenes"]:
        calls = ", ".join(f"{name}: {count}" for name, count in one["calls"].items())
        scipy = [name.partition(".")[2] for name in one["modules"] if name.startswith("scipy.")]
        modules = [name for name in one["modules"] if "." not in name]
        modules += [f"scipy ({', '.join(scipy)})"] if scipy else []
        numpy = one.get("numpy", found["numpy"])  # a scene that was measured apart has its own
        times = [
            "" if seconds is None else f"{seconds / numpy:.3g}"
            for seconds in (one["seconds"], one["bare"])
        ]
        over = (
            ""
            if one["data"] is None
            else f"{one['grown'] / one['data']:.3g} ({one['data'] / 2**20:.3g} MiB)"
        )
        files = str(sum(not name.startswith(".") for name in one["files"]))
        lines.append(line(one["scene"], ", ".join(modules), calls, files, *times, over))
    after = "Counted, and neither timed nor weighed. "
    if found["repeats"]:
        after = (
            f"Medians of {found['repeats']}; a process that imports numpy alone:"
            f" {1e3 * found['numpy']:.0f} ms. "
        )
    return "\n".join(lines) + f"\n\n{after}{machine(found)}"


def machine(numbers: Mapping[str, Any]) -> str:
    """What the numbers depend on, in a line."""
    about = numbers["machine"]
    packages = ", ".join(
        f"{name} {about[name]}" for name in ("numpy", "scipy", "ase", "phonopy", "blas")
    )
    return f"{about['processor']}, {about['cores']} cores, Python {about['python']}, {packages}\n"


def written(text: str, numbers: Mapping[str, Any]) -> str:
    """The page with these numbers."""
    pieces = {name: table(parts, numbers) for name, parts in TABLES.items()}
    pieces |= {"machine": machine(numbers), "costs": costs(numbers["costs"])}
    for name, piece in pieces.items():
        mark = f"<!-- {name}: python tests/benchmarks/page.py -->\n"
        before, rest = text.split(mark)
        text = before + mark + piece + rest[rest.index("<!-- end -->") :]
    return text


def main() -> int:
    numbers = json.loads(NUMBERS.read_text(encoding="utf-8"))
    PAGE.write_text(written(PAGE.read_text(encoding="utf-8"), numbers), encoding="utf-8")
    return 0


if __name__ == "__main__":
    sys.exit(main())
