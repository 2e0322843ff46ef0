"""The accuracy of each medium: its measured relative error at a load, from a table that comes with
the package.

``tests/benchmarks/accuracy.py`` makes the table, ``granphon/data/accuracy.json``. It compares the
media with large samples of the disordered array. Each row of the table belongs to a lattice, a
friction, a kind of distribution, a kind of load and a medium, and has an error for each reduced
load: the largest relative error of the sound velocities and of the scale of frequencies
(k/M)^(1/2), at that load or any higher one, of all distributions that were tried. To the errors a
margin is added for what lies between these distributions and loads. The row of a simulation has the
standard deviation of one ball instead; the error of a sample falls as the root of the number of its
balls.

The friction is that of the arrays that the media are compared with: at rest without friction, with
contacts that resist slip under sound ("slip") or not ("none"), or loaded with a friction
coefficient of 0.1 or more, by their response to sound ("stick", "slide", "partial_slip").

On a line all contacts carry the same force, so that every medium is exact there.
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
from granphon.base.errors import InputError
from granphon.media.loading import REST, FrictionHistory, reduce_load

#: the media of the table, the cheapest first
AVERAGES = ("ala", "afa", "ema")
SIMULATION = "simulation"
#: number of standard deviations of a sample that count as the expected error of a simulation
DEVIATIONS = 1.9
#: schema number of the file
_SCHEMA = 4


@cache
def read_table() -> Mapping[str, Any]:
    """Read the table that comes with the package, once."""
    table: dict[str, Any] = json.loads(
        (files("granphon") / "data" / "accuracy.json").read_text(encoding="utf-8")
    )
    if table["schema"] != _SCHEMA:
        raise InputError(
            f"accuracy.json has schema {table['schema']}, not {_SCHEMA}",
            mend="Install granphon anew",
        )
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
    if packing.structure.periods == 2 and packing.motions not in (None, IN_PLANE.name):
        return "the errors are those of balls that move in the plane alone"
    if packing.torsion or packing.bending:
        return "the errors are those of contacts that resist neither twist nor rolling"
    skewness, kurtosis = (
        compute_form_coefficients(packing.spread.shape) if packing.spread else (0.0, 0.0)
    )
    most = rows["most"]
    if abs(skewness) > most["skewness"] or kurtosis > most["kurtosis"]:
        return (
            f"the distribution of diameters has skewness {skewness:.3g} and excess kurtosis"
            f" {kurtosis:.3g}; skewness is known up to {most['skewness']:.3g}, excess kurtosis up"
            f" to {most['kurtosis']:.3g}"
        )
    return _explain_friction(packing.mindlin_ratio, truth, rows) if truth.is_loaded else None


def _explain_friction(
    mindlin_ratio: float, truth: FrictionHistory, rows: Mapping[str, Any]
) -> str | None:
    """Return the reason why errors against arrays loaded with this friction are not known."""
    low, high = rows["mindlin_ratios"]
    coefficient = truth.friction_coefficient
    if mindlin_ratio == 0.0:
        return "the balls resist no slip, so that no friction loads them"
    if not low * (1.0 - 1e-9) <= mindlin_ratio <= high * (1.0 + 1e-9):
        known = f"Mindlin ratios from {low:.3g} to {high:.3g}, not for {mindlin_ratio:.3g}"
    elif coefficient is not None and coefficient < rows["friction_coefficient"]:
        least = rows["friction_coefficient"]
        known = f"friction coefficients from {least:g} on, not for {coefficient:g}"
    elif truth.shear_response not in rows["errors"]:
        responses = " and ".join(rows["errors"])
        known = f"shear_response {responses} on this lattice, not for {truth.shear_response}"
    else:
        return None
    return f"against arrays loaded with friction they were measured for {known}"


def find_least_load(packing: Packing, kind: str, truth: FrictionHistory = REST) -> float:
    """Return the least load from which errors are known: a* for the kind "overlap", f* for the
    others.

    It is zero where every medium is exact.
    """
    rows = find_rows(packing.structure, truth)
    if rows is None or not packing.spread_matters:
        return 0.0
    return float(rows["loads"]["overlap" if kind == "overlap" else "force"][0])


def find_error(
    medium: str, packing: Packing, load: Load, balls: int = 1, truth: FrictionHistory = REST
) -> Array:
    """Return the largest expected relative error of velocities and frequencies, with the shape of a
    load.

    ``medium`` is one of :data:`AVERAGES`, or :data:`SIMULATION` for samples of the ``truth`` with
    so many ``balls`` in all. The error is zero for equal balls and on a line, and +inf for packings
    and truths that the table does not cover and below its least load. Above the greatest load of
    the table the error falls as the square of the spread over the overlap, which is the law of high
    loads; against arrays that respond with partial slip, whose contacts are softer by |T|/(3 mu f),
    it falls as the spread over the overlap.
    """
    if not packing.spread_matters:
        return np.zeros(load.shape)
    rows = find_rows(packing.structure, truth)
    if rows is None or explain_uncovered(packing, truth) is not None:
        return np.full(load.shape, np.inf)
    axis = "overlap" if load.kind == "overlap" else "force"
    friction = "slip" if packing.mindlin_ratio else "none"
    if truth.is_loaded:
        friction = truth.shear_response
    diameters = _classify(packing.spread.shape if packing.spread else None)
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


def _classify(shape: Shape | None) -> str:
    """Return the kind of a distribution in the table: errors of listed diameters peak where the
    contacts between two of the diameters open.
    """
    is_normal = isinstance(shape, NormalShape) and 2.0 <= shape.cutoff <= 6.0
    return "smooth" if is_normal or isinstance(shape, UniformShape) else "listed"
