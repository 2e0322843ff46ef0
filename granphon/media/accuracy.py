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
from granphon.media.array_options import REST, FrictionHistory, reduce_load
from granphon.media.medium import SIMULATION

#: the media of the table but simulations, the cheapest first
AVERAGES = ("ala", "afa", "ema")
#: number of standard deviations of a sample that count as the expected error of a simulation
DEVIATIONS = 1.9


@cache
def read_table() -> Mapping[str, Any]:
    """Return the table that comes with the package, which is read once; the module says what it
    holds.
    """
    path = files("granphon") / "data" / "accuracy.json"
    table: dict[str, Any] = json.loads(path.read_text(encoding="utf-8"))
    return table


def compute_form_coefficients(shape: Shape) -> tuple[float, float]:
    """Return the skewness and the excess kurtosis of a distribution of diameters that differ. Both
    are zero for a normal distribution without cutoff.
    """
    # 64 nodes in each part of the range give the moments to rounding; the mean of x is zero
    x, weights = shape.nodes(0.0, 64, whole=True)
    second_moment = float(np.sum(weights * x**2))
    third_moment = float(np.sum(weights * x**3))
    fourth_moment = float(np.sum(weights * x**4))
    skewness = third_moment / second_moment**1.5
    excess_kurtosis = fourth_moment / second_moment**2 - 3.0
    return skewness, excess_kurtosis


def find_rows(structure: Lattice, truth: FrictionHistory = REST) -> Mapping[str, Any] | None:
    """Return the part of the table for a lattice and the arrays of a ``truth``; None if the table
    has no such part, or if the lattice is not the registered one of its name.
    """
    is_registered = LATTICES.get(structure.name) == structure
    return _find_parts(truth).get(structure.name) if is_registered else None


def _find_parts(truth: FrictionHistory) -> Mapping[str, Any]:
    """Return the parts of the table for the arrays of a ``truth``, by the names of lattices."""
    parts: Mapping[str, Any] = read_table()["loaded" if truth.is_loaded else "rest"]
    return parts


def explain_uncovered(packing: Packing, truth: FrictionHistory = REST) -> str | None:
    """Return the reason, in words, why the table has no errors for a packing relative to the arrays
    of a ``truth``; None if it has them.
    """
    if not packing.spread_matters:
        return None
    rows = find_rows(packing.structure, truth)
    if rows is None:
        lattices = ", ".join(_find_parts(truth))
        against = " against arrays loaded with friction" if truth.is_loaded else ""
        return (
            f"none were measured on the {packing.structure.name} lattice{against}; they were on"
            f" these: {lattices}"
        )
    reason = _explain_balls(packing, rows["most"])
    if reason is None and truth.is_loaded:
        reason = _explain_friction(packing.mindlin_ratio, truth, rows)
    return reason


def _explain_balls(packing: Packing, measured_limits: Mapping[str, float]) -> str | None:
    """Return the reason why balls of a packing, which differ, were not measured; None if they were.

    ``measured_limits`` holds the largest skewness, of either sign, and the largest excess kurtosis
    of diameters that were measured.
    """
    moves_in_plane = packing.motions in (None, IN_PLANE.name)
    if packing.structure.periods == 2 and not moves_in_plane:
        return "the errors are those of balls that move in the plane alone"
    if packing.torsion or packing.bending:
        return "the errors are those of contacts that resist neither twist nor rolling"
    assert packing.spread is not None  # as balls whose contact forces differ have a spread
    skewness, kurtosis = compute_form_coefficients(packing.spread.shape)
    if abs(skewness) > measured_limits["skewness"] or kurtosis > measured_limits["kurtosis"]:
        return (
            f"the distribution of diameters has skewness {skewness:.3g} and excess kurtosis"
            f" {kurtosis:.3g}; they are known up to {measured_limits['skewness']:.3g} and"
            f" {measured_limits['kurtosis']:.3g}"
        )
    return None


def _explain_friction(eta: float, truth: FrictionHistory, rows: Mapping[str, Any]) -> str | None:
    """Return the reason why a Mindlin ratio ``eta`` or a ``truth`` with friction was not measured;
    None if both were. ``rows`` are those of :func:`find_rows`.
    """
    clause = "against arrays loaded with friction they were measured for"
    low, high = rows["mindlin_ratios"]
    is_measured_eta = low * (1.0 - 1e-9) <= eta <= high * (1.0 + 1e-9)  # allows for rounding
    if not is_measured_eta:
        return f"{clause} Mindlin ratios from {low:.3g} to {high:.3g}, not for {eta:.3g}"
    mu = truth.friction_coefficient
    least_mu = rows["friction_coefficient"]
    if mu is not None and mu < least_mu:
        return f"{clause} friction coefficients from {least_mu:g} on, not for {mu:g}"
    if truth.shear_response not in rows["errors"]:
        responses = " and ".join(rows["errors"])
        return (
            f"{clause} shear_response {responses} on this lattice, not for {truth.shear_response}"
        )
    return None


def find_error(
    medium: str, packing: Packing, load: Load, balls: int = 1, truth: FrictionHistory = REST
) -> Array:
    """Return the largest expected relative error of velocities and frequencies, with the shape of a
    load.

    ``medium`` is one of :data:`AVERAGES`, or "simulation" for samples with the friction of the
    ``truth`` and so many ``balls`` in all. The error is zero for equal balls and on a line, where
    every medium is exact, and +inf for what the table does not cover, also below its least load.
    Above the greatest load of the table the error falls as the square of the spread over the
    overlap, the law of high loads. With partial slip the error falls as the first power: a
    tangential force T softens the contact, of normal force f and friction coefficient mu, by the
    part |T|/(3 mu f), to first order, and T/f falls as the spread over the overlap.
    """
    if not packing.spread_matters:
        return np.zeros(load.shape)
    rows = find_rows(packing.structure, truth)
    if rows is None or explain_uncovered(packing, truth) is not None:
        return np.full(load.shape, np.inf)
    axis = _find_axis(load)
    table_loads = np.array(rows["loads"][axis])
    table_errors = _find_row(rows, medium, packing, axis, truth)
    reduced_load = np.maximum(reduce_load(packing, load), 0.0)
    power = 1.0 if _find_response(packing, truth) == "partial_slip" else 2.0
    # a load of zero has the logarithm -inf: the error of the least load is found, and replaced by
    # +inf below
    with np.errstate(over="ignore", divide="ignore"):
        table_error = _interpolate(reduced_load, table_loads, table_errors)
        growth = _find_growth_of_overlap(reduced_load, table_loads[-1], axis)
        error = table_error / growth**power
    if medium == SIMULATION:
        # the table has the standard deviation of one ball
        error = error * (DEVIATIONS / math.sqrt(balls))
    return np.asarray(np.where(reduced_load >= table_loads[0], error, np.inf))


def _find_axis(load: Load) -> str:
    """Return the axis of the table on which a load is found: "overlap" (values are a*) for an
    overlap, "force" (values are f*) for a force or a pressure.
    """
    return "overlap" if load.kind == "overlap" else "force"


def _find_response(packing: Packing, truth: FrictionHistory) -> str:
    """Return the key of the table for the friction of the arrays. For arrays loaded with friction
    the key is their response to sound; for arrays at rest it is "slip" or "none", as contacts
    resist slip under sound or not.
    """
    if truth.is_loaded:
        return truth.shear_response
    return "slip" if packing.mindlin_ratio else "none"


def _find_row(
    rows: Mapping[str, Any], medium: str, packing: Packing, axis: str, truth: FrictionHistory
) -> Array:
    """Return the errors (n,) of a medium at the loads of the table for an ``axis``, "force" or
    "overlap", from the ``rows`` that :func:`find_rows` has for the lattice of a packing and the
    arrays of a ``truth``.
    """
    shape = packing.spread.shape if packing.spread else None
    is_uniform = isinstance(shape, UniformShape)
    # normal distributions were measured with cutoffs of 2, 3 and 6 standard deviations
    is_normal = isinstance(shape, NormalShape) and 2.0 <= shape.cutoff <= 6.0
    # anything else takes the row of listed diameters, whose errors are larger: they peak where the
    # contacts between two of the diameters open
    is_smooth = is_uniform or is_normal
    response_key = _find_response(packing, truth)
    diameters = "smooth" if is_smooth else "listed"
    return np.array(rows["errors"][response_key][diameters][axis][medium])


def _interpolate(reduced_load: Array, table_loads: Array, table_errors: Array) -> Array:
    """Return the error at each ``reduced_load``, linear in logarithms between the errors of the
    table (n,) at its loads (n,); beyond these it is the error of the nearest.
    """
    log_errors = np.interp(np.log(reduced_load), np.log(table_loads), np.log(table_errors))
    return np.exp(log_errors)


def _find_growth_of_overlap(reduced_load: Array, greatest_load: float, axis: str) -> Array:
    """Return the overlap at each ``reduced_load`` over that at the ``greatest_load`` of the table,
    by the law of equal balls; 1 within the table.

    Both loads are a* for the ``axis`` "overlap", and f* for "force".
    """
    if axis == "overlap":  # in units of W the overlap is a* - 1/2
        growth = (reduced_load - 0.5) / (greatest_load - 0.5)
    else:
        growth = np.asarray(overlap_of(reduced_load / greatest_load))
    return np.maximum(growth, 1.0)


def find_least_load(packing: Packing, load: Load, truth: FrictionHistory = REST) -> float:
    """Return the least reduced load from which errors are known: an a* if ``load`` is an overlap,
    else an f*. It is zero where every medium is exact, and for lattices on which no error is known.
    """
    rows = find_rows(packing.structure, truth)
    if rows is None or not packing.spread_matters:
        return 0.0
    return float(rows["loads"][_find_axis(load)][0])
