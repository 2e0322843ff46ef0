"""Short commands: what the search for reference cycles costs.

    python tests/benchmarks --only commands

A command looks for reference cycles after more new objects than Python does by itself
(``granphon/__main__.py``). The same run is timed with the threshold of the command and with that of
Python, in processes that are started in turns; times are of the processor.
"""

from __future__ import annotations

import gc
import statistics
import subprocess
import sys
import tempfile
from pathlib import Path

from side_by_side import Part, Row

from granphon.__main__ import _COLLECTED

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


def measure(folder: str, threshold: int) -> float:
    """Processor time, s, of a process with the run."""
    words = [sys.executable, "-c", RUN, folder, str(threshold)]
    done = subprocess.run(words, capture_output=True, text=True, check=True)
    return float(done.stderr.splitlines()[-1])


def commands(repeats: int) -> list[Row]:
    thresholds = {"command": _COLLECTED, "python": gc.get_threshold()[0]}
    times: dict[str, list[float]] = {name: [] for name in thresholds}
    with tempfile.TemporaryDirectory() as folder:
        (Path(folder) / "scene.yaml").write_text(SCENE, encoding="utf-8")
        measure(folder, _COLLECTED)  # compiles modules
        for _ in range(repeats):
            for name, threshold in thresholds.items():
                times[name].append(measure(folder, threshold))
    ratios = [ours / default for ours, default in zip(*times.values(), strict=True)]
    ours, default = (statistics.median(times[name]) for name in times)
    note = f"{ours:.3g} s with {_COLLECTED:,}, {default:.3g} s with {thresholds['python']:,}"
    what = (
        "A short `granphon run` that looks for reference cycles less often, over one that does not"
    )
    return [Row(what, statistics.median(ratios), bound=1.0, note=note)]


PARTS: dict[str, Part] = {"commands": commands}
