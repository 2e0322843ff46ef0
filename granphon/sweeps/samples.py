"""The balls of a sample in the result of a task: a single state keeps them, for files and figures of them."""

from __future__ import annotations

from dataclasses import fields
from typing import Any

import numpy as np

from granphon.array.equilibrium import Equilibrium
from granphon.array.pressed_sample import PressedEquilibrium, PressedSample
from granphon.array.sample import Sample
from granphon.array.true_equilibrium import TrueEquilibrium
from granphon.base.results import read_only
from granphon.media.simulation import DirectSimulation
from granphon.sweeps.store import TaskResult

#: what the names of arrays of the balls begin with in the result of a task
_BALLS = "balls."
#: what of an equilibrium is not kept: the sample is drawn again from its seed
_DRAWN = ("deviations", "lattice")


def keep_balls(sample: Sample | PressedSample) -> TaskResult:
    """Return the balls of a sample at rest as arrays, each after an axis of one load."""
    rest = sample.equilibrium
    found = {name: np.asarray(getattr(rest, name)) for name in _list_kept(type(rest))}
    if not isinstance(sample, PressedSample):  # after a history they follow from the elastic tensors
        found["derivatives"] = np.array([rest.stiffness, rest.stiffness_slope])
    return {_BALLS + name: value[None] for name, value in found.items()}


def restore_sample(simulation: DirectSimulation, part: TaskResult) -> Sample | PressedSample:
    """Return the one sample of a simulation, with what a task has found of it and its balls."""
    packing, seed, history = simulation.packing, simulation.seed_of(0), simulation.history
    kind = PressedEquilibrium if history.is_loaded else TrueEquilibrium if simulation.ratio else Equilibrium
    given: dict[str, Any] = {name: part[_BALLS + name][0] for name in _list_kept(kind)}
    rest: Any = kind(deviations=read_only(simulation.deviations(0)), lattice=packing.structure, **given)
    if not history.is_loaded:
        vars(rest)["_derivatives"] = tuple(part[_BALLS + "derivatives"][0].tolist())
        sample: Sample | PressedSample = Sample(packing, seed, rest)
    else:
        sample = PressedSample(packing, seed, rest, history.shear_response)
    vars(sample).update({name: one[0] for name, one in part.items() if name.startswith("elastic_")})
    return sample


def _list_kept(kind: type[Equilibrium]) -> list[str]:
    """Return the names of the fields of an equilibrium that are kept."""
    return [one.name for one in fields(kind) if one.name not in _DRAWN]
