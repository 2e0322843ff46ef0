"""What a notebook shows of a scene."""

from __future__ import annotations

from typing import Any

from granphon.balls.packing import describe_packing
from granphon.balls.parameters import PARAMETERS
from granphon.base.notebook import write_html
from granphon.base.quantities import load_quantities
from granphon.scene.specification import Specification


def write_scene(scene: Specification) -> str:
    """Return a table of what a scene says, in SI units; no state is computed."""
    from granphon.figures.words import describe_medium

    load, periods = scene.load, scene.packing.structure.periods
    rows: list[tuple[str, Any, str]] = [
        *describe_packing(scene.packing),
        (load.kind.replace("_", " "), load.array, load_quantities(periods)[load.kind].unit),
        *([("balls per side", load.balls_per_side, "")] if load.balls_per_side is not None else []),
        *(("medium", describe_medium(one.label, periods, scene.packing.structure.n_balls), "") for one in scene.media),
        *((f"sweep of {name.replace('_', ' ')}", values, PARAMETERS[name] or "") for name, values in scene.parameters),
        ("finite overlap", scene.finite_overlap, ""),
        ("observe", scene.observe, ""),
        *(("direction", one, "") for one in scene.directions[:4]),
    ]
    if {"bands", "spectrum"} & set(scene.observe):
        path = scene.path
        rows.append(("path", " ".join(path.labels) if path.labels else str(path), ""))
    if "dos" in scene.observe:
        rows.append(("mesh", " x ".join(map(str, scene.grid)), ""))
    return write_html("Scene", rows)
