"""Benchmarks of the ordered lattice: ratios, each measured side by side in one run.

    python tests/benchmarks/bench_ordered.py [--json FILE] [--repeats N]

Nothing is asserted: machines are shared and noisy. The documentation quotes a run.
"""

from __future__ import annotations

import argparse
import json
import os
import platform
import statistics
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable
from pathlib import Path

import numpy as np

HEAD = "import phonopy, matplotlib.pyplot"

#: what a user without granphon would write: force constants of the contacts by hand, then phonopy
BARE = """
import numpy as np
from phonopy import Phonopy
from phonopy.structure.atoms import PhonopyAtoms

def bare(eta=0.839907192575406, n=101, mesh=64, dos=True):
    cell = np.array([[1, 0, 0], [-0.5, np.sqrt(0.75), 0], [0, 0, 1.0]])
    ph = Phonopy(PhonopyAtoms(symbols=["Fe"], cell=cell, scaled_positions=[[0, 0, 0]], masses=[1.0]),
                 np.diag([3, 3, 1]), primitive_matrix="P", is_symmetry=False)
    ph.unit_conversion_factor = 1.0
    positions = ph.supercell.positions
    inverse = np.linalg.inv(ph.supercell.cell)
    fc = np.zeros((9, 9, 3, 3))
    for angle in np.arange(6) * np.pi / 3:
        normal = np.array([np.cos(angle), np.sin(angle), 0]); tangent = np.array([-normal[1], normal[0], 0])
        e_i, e_j = -normal, normal
        s_i, s_j = -tangent - [0, 0, np.sqrt(2.5)], tangent - [0, 0, np.sqrt(2.5)]
        for i in range(9):
            gap = (positions - positions[i] - normal) @ inverse
            j = int(np.argmin(np.abs(gap - np.rint(gap)).sum(axis=1)))
            fc[i, i] += np.outer(e_i, e_i) + eta * np.outer(s_i, s_i)
            fc[i, j] += np.outer(e_i, e_j) + eta * np.outer(s_i, s_j)
    ph.force_constants = fc
    corners = np.array([[0, 0, 0], [1/3, 1/3, 0], [1/2, 0, 0], [0, 0, 0]])
    paths = [a + (b - a) * np.linspace(0, 1, n)[:, None] for a, b in zip(corners[:-1], corners[1:])]
    bands = ph.run_band_structure(paths, with_eigenvectors=True, with_group_velocities=True)
    if dos:
        ph.run_mesh([mesh, mesh, 1], is_gamma_center=True, with_eigenvectors=True, is_mesh_symmetry=False)
        ph.run_projected_dos(xyz_projection=True)
    return ph, bands
"""


def alternate(repeats: int, **calls: Callable[[], object]) -> dict[str, float]:
    """Median seconds of each call, taken in turns so that a busy machine slows all of them."""
    times: dict[str, list[float]] = {name: [] for name in calls}
    for call in calls.values():
        call()
    for _ in range(repeats):
        for name, call in calls.items():
            start = time.perf_counter()
            call()
            times[name].append(time.perf_counter() - start)
    return {name: statistics.median(values) for name, values in times.items()}


def bands(repeats: int) -> dict[str, float]:
    """Bands with eigenvectors and group velocities on the same q points."""
    import granphon as gp

    scope: dict[str, Callable[..., object]] = {}
    exec(BARE, scope)  # the text is also run as a script of its own below
    steel = gp.Material(211.65e9, 0.276, 7840.0)
    state = gp.AveragedLattice(gp.Packing(steel, 8e-3)).at_force(18.446)
    ours = gp.Phonons(state).bands("GKMG", npoints=101)
    _, theirs = scope["bare"](dos=False)  # type: ignore[misc]
    worst = np.max(np.abs(np.array(theirs.frequencies) * gp.Phonons(state).scales.frequency - ours.frequencies))
    assert worst < 1e-7 * ours.frequencies.max(), "the two engines disagree: the ratio would mean nothing"
    seconds = alternate(
        repeats, granphon=lambda: gp.Phonons(state).bands("GKMG", npoints=101), phonopy=lambda: scope["bare"](dos=False)
    )
    return {"granphon_s": seconds["granphon"], "bare_phonopy_s": seconds["phonopy"],
            "ratio": seconds["granphon"] / seconds["phonopy"]}  # fmt: skip


def command(repeats: int) -> dict[str, float]:
    """The command on the steel example, against the imports and the bare computation, as whole processes."""
    root = Path(__file__).resolve().parents[2]
    environment = {**os.environ, "MPLBACKEND": "Agg"}

    def process(*arguments: str) -> Callable[[], object]:
        return lambda: subprocess.run(arguments, check=True, capture_output=True, env=environment, cwd=root)

    with tempfile.TemporaryDirectory() as folder:
        out = str(Path(folder) / "out")
        granphon = [sys.executable, "-m", "granphon", "run", "examples/steel_hexagon.yaml", "-o", out, "--force"]
        seconds = alternate(
            repeats,
            granphon=process(*granphon),
            imports=process(sys.executable, "-c", HEAD),
            bare=process(sys.executable, "-c", f"{HEAD}\n{BARE}\nbare()"),
        )
    ratios = {"ratio_to_imports": seconds["granphon"] / seconds["imports"], "ratio": seconds["granphon"] / seconds["bare"]}
    return {**{f"{name}_s": value for name, value in seconds.items()}, **ratios}


def report(description: str, parts: dict[str, Callable[[int], object]], argv: list[str] | None = None) -> None:
    """Run each part with as many repeats as the command line says, and print and perhaps write what they give."""
    parser = argparse.ArgumentParser(description=description)
    parser.add_argument("--json", type=Path, help="also write the results here")
    parser.add_argument("--repeats", type=int, default=7)
    options = parser.parse_args(argv)
    results: dict[str, object] = {
        "machine": {"processor": platform.machine(), "cores": os.cpu_count(), "python": platform.python_version()},
        **{name: part(options.repeats) for name, part in parts.items()},
    }
    text = json.dumps(results, indent=2)
    print(text)
    if options.json:
        options.json.write_text(text + "\n", encoding="utf-8")


if __name__ == "__main__":
    report("Benchmarks of the ordered lattice", {"bands": bands, "command": command})
