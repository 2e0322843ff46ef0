"""Short commands: what the search for reference cycles costs, what pages cost that rslab gives back
to the system, what threads cost that share small factors, what Fourier transforms on short grids
cost, and what README's beads cost.

    python tests/benchmarks --only commands pages threads transforms beads

A command looks for reference cycles after more new objects than Python does by itself, and lets
rslab keep the pages that it frees (``granphon/__main__.py``). The same run is timed with these
settings of the command and with those of Python and of rslab, in processes that are started in
turns; times are of the processor.

The beads of README are computed, drawn and written in this process, over a yardstick that does not
change with granphon: one factorisation by SuperLU of the tangent of as many balls as a plane of
64 x 64 has.
"""

from __future__ import annotations

import gc
import math
import os
import statistics
import subprocess
import sys
import tempfile
import time
from pathlib import Path

import numpy as np
from bench_statics import ETA, draw, factorise_list
from side_by_side import Part, Row, alternate, over

import granphon as gp
from granphon.__main__ import _ALLOCATION, _COLLECTION_THRESHOLD
from granphon.array.options import ReducedLoad
from granphon.array.rest import bring_to_rest
from granphon.contacts.tangent import find_tangent, unit_strains
from granphon.dynamics.factors import Elimination
from granphon.statics.transforms import FastTransform, find_transform

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
_MOST_OF_BEADS = 16.0


def measure(folder: str, threshold: int, allocation: dict[str, str]) -> float:
    """Processor time, s, of a process with the run, where rslab allocates as the variables
    ``allocation`` of the environment say.
    """
    words = [sys.executable, "-c", RUN, folder, str(threshold)]
    others = {name: value for name, value in os.environ.items() if name not in _ALLOCATION}
    done = subprocess.run(
        words, capture_output=True, text=True, check=True, env=others | allocation
    )
    return float(done.stderr.splitlines()[-1])


def take_turns(
    what: str, scene: str, settings: dict[str, tuple[int, dict[str, str]]], repeats: int
) -> Row:
    """The time of the run of a ``scene`` with the first of two ``settings``, by name, over that
    with the second; each is a threshold and variables of the environment.
    """
    times: dict[str, list[float]] = {name: [] for name in settings}
    with tempfile.TemporaryDirectory() as folder:
        (Path(folder) / "scene.yaml").write_text(scene, encoding="utf-8")
        measure(folder, *next(iter(settings.values())))  # compiles modules and loops
        for _ in range(repeats):
            for name, setting in settings.items():
                times[name].append(measure(folder, *setting))
    ratios = [ours / default for ours, default in zip(*times.values(), strict=True)]
    medians = {name: statistics.median(values) for name, values in times.items()}
    note = ", ".join(f"{median:.3g} s {name}" for name, median in medians.items())
    return Row(what, statistics.median(ratios), bound=1.0, note=note)


def commands(repeats: int) -> list[Row]:
    thresholds = (_COLLECTION_THRESHOLD, gc.get_threshold()[0])
    settings = {f"with {threshold:,}": (threshold, _ALLOCATION) for threshold in thresholds}
    what = (
        "A short `granphon run` that looks for reference cycles less often, over one that does not"
    )
    return [take_turns(what, SCENE, settings, repeats)]


def pages(repeats: int) -> list[Row]:
    settings = {
        "with pages that stay": (_COLLECTION_THRESHOLD, _ALLOCATION),
        "with pages that are given back": (_COLLECTION_THRESHOLD, dict[str, str]()),
    }
    what = "README's beads, a process in which rslab keeps its pages, over one in which it does not"
    return [take_turns(what, BEADS, settings, repeats)]


def threads(repeats: int) -> list[Row]:
    """Factors as they are found, by one thread, over those by as many as rslab chooses."""
    stencils, deviations = draw("triangular", 24)
    rest = bring_to_rest(deviations, ReducedLoad(overlap=0.5), stencils)
    matrix = find_tangent(rest._list_contacts(ETA), unit_strains(2)).matrix
    elimination = Elimination(matrix)
    seconds = alternate(
        repeats,
        time.process_time,
        one=lambda: [elimination.factorise(matrix) for _ in range(50)],
        chosen=lambda: [elimination._symbolic.factor(matrix) for _ in range(50)],
    )
    what = "50 factors of 24x24 balls that turn, by one thread: over as many threads as rslab takes"
    return [over(what, seconds, "one", "chosen", 1.0)]


def transforms(repeats: int) -> list[Row]:
    """Transforms as they are chosen for motions on short grids, and back, over fast ones."""
    return [_time_transforms(shape, repeats) for shape in ((24, 24), (28, 28), (8, 8, 8))]


def _time_transforms(shape: tuple[int, ...], repeats: int) -> Row:
    """The time of chosen transforms of motions on a grid of the ``shape``, over fast ones."""
    motions = np.ones((len(shape), math.prod(shape)), np.float32)
    chosen = find_transform(shape, motions.dtype)
    fast = FastTransform(shape, 1)
    seconds = alternate(
        repeats,
        time.process_time,
        chosen=lambda: [chosen.find_fields(chosen.find_waves(motions)) for _ in range(1000)],
        fast=lambda: [fast.find_fields(fast.find_waves(motions)) for _ in range(1000)],
    )
    balls = "x".join(map(str, shape))
    what = f"1000 transforms of the motions of {balls} balls, and back, by matrices: over fast ones"
    return over(what, seconds, "chosen", "fast", 1.0)


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


PARTS: dict[str, Part] = {
    "commands": commands,
    "pages": pages,
    "threads": threads,
    "transforms": transforms,
    "beads": beads,
}
