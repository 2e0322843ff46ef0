"""The measured relative error of each medium at a load, from a table that comes with the package.

``tests/benchmarks/accuracy.py`` makes the table, ``granphon/data/accuracy.json``, from large
samples of the disordered array. A row belongs to a lattice, the friction of the arrays, a kind of
distribution, a kind of load and a medium. A row has for each reduced load the largest error of the
sound velocities and of the scale of frequencies (k/M)^(1/2), at that load or any higher one; the
row of a simulation has the standard deviation of one ball. The friction of arrays at rest is "none"
or "slip": whether their contacts resist slip under sound. That of arrays loaded with friction is
their response to sound.
"""

from __future__ import annotations

import json
import math
from collections.abc import Mapping
from functools import cache
from importlib.resources import files
from typing import Any

import numpy as np

from granphon.balls.diameters import NormalShape, Shape, UniformShape
from granphon.balls.hertz import overlap_of
from granphon.balls.lattices import LATTICES, Lattice
from granphon.balls.loads import Load
from granphon.balls.motions import IN_PLANE
from granphon.balls.packing import Packing
from granphon.base.arrays import Array
from granphon.media.loading import REST, FrictionHistory, reduce_load

#: the media of the table, the cheapest first
AVERAGES = ("ala", "afa", "ema")
SIMULATION = "simulation"
#: number of standard deviations of a sample that count as the expected error of a simulation
DEVIATIONS = 1.9


@cache
def read_table() -> Mapping[str, Any]:
    """Read the table that comes with the package, once."""
    path = files("granphon") / "data" / "accuracy.json"
    table: dict[str, Any] = json.loads(path.read_text(encoding="utf-8"))
    return table


def compute_form_coefficients(shape: Shape) -> tuple[float, float]:
    """Return skewness and excess kurtosis of a distribution; both are zero for a normal
    distribution without cutoff.
    """
    x, weights = shape.nodes(0.0, 64, whole=True)
    second, third, fourth = (float(np.sum(weights * x**n)) for n in (2, 3, 4))
    return third / second**1.5, fourth / second**2 - 3.0


def find_rows(structure: Lattice, truth: FrictionHistory = REST) -> Mapping[str, Any] | None:
    """Return the part of the table for a lattice and the arrays of a ``truth``; None if there is
    none.
    """
    lattices: Mapping[str, Any] = read_table()["loaded" if truth.is_loaded else "rest"]
    return lattices.get(structure.name) if LATTICES.get(structure.name) == structure else None


def explain_uncovered(packing: Packing, truth: FrictionHistory = REST) -> str | None:
    """Return the reason why the table does not cover a packing, or a truth; None if it does."""
    if not packing.spread_matters:
        return None
    rows = find_rows(packing.structure, truth)
    if rows is None:
        lattices = ", ".join(read_table()["loaded" if truth.is_loaded else "rest"])
        against = " against arrays loaded with friction" if truth.is_loaded else ""
        return (
            f"none were measured on the {packing.structure.name} lattice{against}; they were on"
            f" these: {lattices}"
        )
    shape = packing.spread.shape if packing.spread else None
    skewness, kurtosis = compute_form_coefficients(shape) if shape else (0.0, 0.0)
    most = rows["most"]
    is_out_of_plane = packing.structure.periods == 2 and packing.motions not in (
        None,
        IN_PLANE.name,
    )
    reasons = {
        "the errors are those of balls that move in the plane alone": is_out_of_plane,
        "the errors are those of contacts that resist neither twist nor rolling": bool(
            packing.torsion or packing.bending
        ),
        f"the distribution of diameters has skewness {skewness:.3g} and excess kurtosis"
        f" {kurtosis:.3g}; they are known up to {most['skewness']:.3g} and"
        f" {most['kurtosis']:.3g}": abs(skewness) > most["skewness"] or kurtosis > most["kurtosis"],
    }
    if truth.friction_coefficient is not None:
        low, high = rows["mindlin_ratios"]
        eta = packing.mindlin_ratio
        least = rows["friction_coefficient"]
        measured = "against arrays loaded with friction they were measured for"
        reasons |= {
            f"{measured} Mindlin ratios from {low:.3g} to {high:.3g}, not for {eta:.3g}": not (
                low * (1.0 - 1e-9) <= eta <= high * (1.0 + 1e-9)
            ),
            f"{measured} friction coefficients from {least:g} on, not for"
            f" {truth.friction_coefficient:g}": truth.friction_coefficient < least,
            f"{measured} shear_response {' and '.join(rows['errors'])} on this lattice, not for"
            f" {truth.shear_response}": truth.shear_response not in rows["errors"],
        }
    return next((reason for reason, applies in reasons.items() if applies), None)


def find_error(
    medium: str, packing: Packing, load: Load, balls: int = 1, truth: FrictionHistory = REST
) -> Array:
    """Return the largest expected relative error of velocities and frequencies, with the shape of a
    load.

    ``medium`` is one of :data:`AVERAGES`, or :data:`SIMULATION` for samples of the ``truth`` with
    so many ``balls`` in all. The error is zero for equal balls and on a line, where every medium is
    exact, and +inf for what the table does not cover. Above the greatest load of the table the
    error falls as the square of the spread over the overlap, the law of high loads; with partial
    slip, whose contacts are softer by |T|/(3 mu f), as the first power.
    """
    if not packing.spread_matters:
        return np.zeros(load.shape)
    rows = find_rows(packing.structure, truth)
    if rows is None or explain_uncovered(packing, truth) is not None:
        return np.full(load.shape, np.inf)
    axis = "overlap" if load.kind == "overlap" else "force"
    at_rest = "slip" if packing.mindlin_ratio else "none"
    friction = truth.shear_response if truth.is_loaded else at_rest
    shape = packing.spread.shape if packing.spread else None
    is_normal = isinstance(shape, NormalShape) and 2.0 <= shape.cutoff <= 6.0
    # errors of listed diameters peak where the contacts between two of the diameters open
    diameters = "smooth" if is_normal or isinstance(shape, UniformShape) else "listed"
    loads = np.array(rows["loads"][axis])
    errors = np.array(rows["errors"][friction][diameters][axis][medium])
    reduced = np.maximum(reduce_load(packing, load), 0.0)
    power = 1.0 if friction == "partial_slip" else 2.0
    with np.errstate(over="ignore", divide="ignore"):
        error = np.exp(np.interp(np.log(reduced), np.log(loads), np.log(errors)))
        # the overlap over that at the greatest load of the table, by the law of equal balls
        growth = (
            (reduced - 0.5) / (loads[-1] - 0.5)
            if axis == "overlap"
            else overlap_of(reduced / loads[-1])
        )
        error = error / np.maximum(growth, 1.0) ** power
    if medium == SIMULATION:
        error = error * (DEVIATIONS / math.sqrt(balls))
    return np.asarray(np.where(reduced >= loads[0], error, np.inf))


def find_least_load(packing: Packing, load: Load, truth: FrictionHistory = REST) -> float:
    """Return the least a* of loads given as overlaps, or else f*, from which errors are known; zero
    where every medium is exact.
    """
    rows = find_rows(packing.structure, truth)
    if rows is None or not packing.spread_matters:
        return 0.0
    return float(rows["loads"]["overlap" if load.kind == "overlap" else "force"][0])
