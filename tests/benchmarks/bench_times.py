"""The time that ``granphon check`` tells, against the time that the run takes.

    python tests/benchmarks --only times

Each scene is planned, its time estimated from the small piece of its work that is timed here, and
run, after a first one that pays for imports. Times are of the processor, so that what else the
machine does hardly matters: a busy machine is slower in both. The ratio of both is to be between a
third and three, for scenes of seconds and, with ``--huge``, of minutes.
"""

from __future__ import annotations

import tempfile
import time
from pathlib import Path

from side_by_side import Part, Row

import granphon as gp

_STEEL = "material: {young_modulus: 211.65 GPa, poisson_ratio: 0.276, density: 7840 kg/m^3}\n"


def _describe(packing: str, load: str, *more: str) -> str:
    """Return the text of a scene."""
    balls = f"packing: {{diameter: 8 mm, spread: {{uniform: 2.04 um}}{packing}}}\n"
    return "".join([_STEEL, balls, f"load: {{force: {load}}}\n", *(line + "\n" for line in more)])


#: scenes by what they do, the quickest first
SCENES = {
    "one array": _describe("", "18.4 N", "medium: {simulation: {shape: 384 384}}"),
    "an array at low load": _describe("", "0.5 N", "medium: {simulation: {shape: 96 96}}"),
    "a sweep of arrays": _describe(
        "",
        "{from: 2 N, to: 200 N, points: 20}",
        "medium: {simulation: {shape: 96 96, samples: 6}}",
    ),
    "arrays in space": _describe(
        ", lattice: fcc", "18.4 N", "medium: {simulation: {shape: 40 40 40}}"
    ),
    "true directions": _describe(
        "", "4 N", "medium: {simulation: {shape: 96 96, geometry: exact, samples: 2}}"
    ),
    "a path with friction": _describe(
        "",
        "{from: 2 N, to: 40 N, points: 12}",
        "medium: {simulation: {shape: 48 48, friction_history: true, friction_coefficient: 0.2}}",
    ),
    "a density of states": _describe(
        "", "18.4 N", "observe: [dos]", "phonopy: {mesh: 1500 1500 1}"
    ),
    "a spectrum": _describe(
        "",
        "18.4 N",
        "medium: {simulation: {shape: 128 128}}",
        "observe: [spectrum]",
        "spectrum: {resolution: 100 Hz}",
    ),
    "a response": _describe(
        "",
        "18.4 N",
        "medium: {simulation: {shape: 60 60}}",
        "observe: [response]",
        "response: {source: 0 x, receiver: 900 x, loss_factor: 0.02,"
        " frequencies: {from: 1 kHz, to: 30 kHz, points: 200}}",
    ),
    "an impact": _describe(
        "",
        "18.4 N",
        "medium: {simulation: {shape: 100 100}}",
        "observe: [motion]",
        "motion: {drive: {balls: 0, impact: 0.1 m/s}, duration: 1 ms}",
    ),
}
HUGE = {
    "many arrays, minutes": _describe(
        "",
        "{from: 0.3 N, to: 200 N, points: 20}",
        "medium: {simulation: {shape: 160 160, samples: 4}}",
    ),
}


def compare(what: str, text: str) -> Row:
    """Run a scene, and return its processor time over the estimate."""
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "scene.yaml"
        path.write_text(text, encoding="utf-8")
        scene = gp.Scene.from_yaml(path)
        cost = scene.cost()
        estimate = cost.seconds
        begun = time.process_time()
        scene.run(Path(folder) / "out")
        taken = time.process_time() - begun
    ratio = taken / estimate
    note = f"{taken:.3g} s, told: {cost.text}"
    return Row(
        f"Time of {what}, over the estimate or under it",
        max(ratio, 1.0 / ratio),
        "",
        3.0,
        note=note,
    )


def times(_: int) -> list[Row]:
    compare("imports", SCENES["one array"].replace("384 384", "8 8"))
    return [compare(what, text) for what, text in SCENES.items()]


def long_times(_: int) -> list[Row]:
    return [compare(what, text) for what, text in HUGE.items()]


PARTS: dict[str, Part] = {"times": times}
HUGE_PARTS: dict[str, Part] = {"minutes": long_times}
