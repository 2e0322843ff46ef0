"""Short commands: what the search for reference cycles costs, and what README's beads cost.

    python tests/benchmarks --only commands beads

A command looks for reference cycles after more new objects than Python does by itself
(``granphon/__main__.py``). The same run is timed with the threshold of the command and with that of
Python, in processes that are started in turns; times are of the processor.

The beads of README are computed, drawn and written in this process, over a yardstick that does not
change with granphon: one factorisation by SuperLU of the tangent of as many balls as a plane of
64 x 64 has.
"""

from __future__ import annotations

import gc
import statistics
import subprocess
import sys
import tempfile
import time
from pathlib import Path

from bench_statics import ETA, draw, factorise_list
from side_by_side import Part, Row, alternate, over

import granphon as gp
from granphon.__main__ import _COLLECTION_THRESHOLD
from granphon.array.options import ReducedLoad
from granphon.array.rest import bring_to_rest

#: the run of a process: the folder, and the threshold, are its arguments
RUN = """\
import gc
import sys
import time
gc.set_threshold(int(sys.argv[2]))
from granphon.cli.main import main
assert main(["run", sys.argv[1] + "/scene.yaml", "-o", sys.argv[1] + "/out", "--force"]) == 0
print(time.process_time(), file=sys.stderr)
"""
SCENE = """\
material: {young_modulus: 211.65 GPa, poisson_ratio: 0.276, density: 7840 kg/m^3}
packing: {diameter: 8 mm}
load: {force: 18.4 N}
"""
#: the scene of README
BEADS = """\
material: {young_modulus: 70 GPa, poisson_ratio: 0.22, density: 2500 kg/m^3}
packing: {diameter: 1 mm, spread: {uniform: 4 um}}
load: {force: {from: 0.05 N, to: 10 N, points: 9}}
medium: [ema, {simulation: {shape: 24 24, samples: 4}}]
"""
#: largest time of the beads over the yardstick
_MOST_OF_BEADS = 22.0


def measure(folder: str, threshold: int) -> float:
    """Processor time, s, of a process with the run."""
    words = [sys.executable, "-c", RUN, folder, str(threshold)]
    done = subprocess.run(words, capture_output=True, text=True, check=True)
    return float(done.stderr.splitlines()[-1])


def commands(repeats: int) -> list[Row]:
    thresholds = {"command": _COLLECTION_THRESHOLD, "python": gc.get_threshold()[0]}
    times: dict[str, list[float]] = {name: [] for name in thresholds}
    with tempfile.TemporaryDirectory() as folder:
        (Path(folder) / "scene.yaml").write_text(SCENE, encoding="utf-8")
        measure(folder, _COLLECTION_THRESHOLD)  # compiles modules
        for _ in range(repeats):
            for name, threshold in thresholds.items():
                times[name].append(measure(folder, threshold))
    ratios = [ours / default for ours, default in zip(*times.values(), strict=True)]
    ours, default = (statistics.median(times[name]) for name in times)
    note = f"{ours:.3g} s with {_COLLECTION_THRESHOLD:,}, {default:.3g} s with {thresholds['python']:,}"
    what = (
        "A short `granphon run` that looks for reference cycles less often, over one that does not"
    )
    return [Row(what, statistics.median(ratios), bound=1.0, note=note)]


def beads(repeats: int) -> list[Row]:
    """README's beads after the first run of a process, figure and files included."""
    stencils, deviations = draw("triangular", 64)
    rest = bring_to_rest(deviations, ReducedLoad(overlap=0.5), stencils)
    with tempfile.TemporaryDirectory() as folder:
        scene = gp.Scene.from_text(BEADS)
        seconds = alternate(
            min(repeats, 5),
            time.process_time,
            beads=lambda: scene.run(Path(folder) / "out", force=True),
            unit=factorise_list(rest._list_contacts(ETA)),
        )
    what = "README's beads, 9 loads, 4 samples of 24x24 balls: over a factorisation by SuperLU"
    return [over(what, seconds, "beads", "unit", _MOST_OF_BEADS)]


PARTS: dict[str, Part] = {"commands": commands, "beads": beads}
