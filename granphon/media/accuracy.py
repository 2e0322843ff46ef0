"""The accuracy of each medium: its measured relative error at a load, from a table that comes with
the package.

``tests/benchmarks/accuracy.py`` made the table. It compared the media with large samples of the
disordered array, at rest without friction, on the triangular lattice, fcc and hcp, for some
distributions, values of eta, and loads. For each lattice and family of distributions (uniform,
normal, any) the table stores the largest error at a load, in reduced units, or at any higher load.
It adds a margin for what lies between the tabulated points: with listed diameters errors peak where
the contacts between two of the diameters open. An error of the table is therefore a bound for
packings whose distribution is not more skewed, and has no longer tails, than those that were tried,
as far as such a choice of distributions can show. For a simulation the table stores the statistical
error: the standard deviation of a sample, which falls as the root of the number of its balls.

The error is the largest relative error of the sound velocities and of the scale of frequencies
(k/M)^(1/2). In the plane the velocities are the longitudinal and the transverse one; in space, all
three along the edges of the cube, the diagonals of its faces and its own diagonal (in hcp in the
layers, across them and between).

On a line all contacts carry the same force, so that Hertz's law, and every medium, is exact there.

On the triangular lattice and in fcc ``tests/benchmarks/accuracy_with_friction.py`` has measured the
same errors against another truth: arrays that were loaded with friction
(:class:`~granphon.media.loading.FrictionHistory`). Without a history their simulation is a medium
like the others, and its error is what friction in the statics does.
"""

from __future__ import annotations

import json
import math
from collections.abc import Mapping, Sequence
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

#: number of standard deviations of a sample that count as the expected error of a simulation; the
#: standard deviations in the table include a margin
DEVIATIONS = 2.5
#: name in the table of what the samples of a simulation at rest without friction are off from those
#: loaded with friction
FRICTIONLESS = "frictionless"
#: schema number of the file
_SCHEMA = 3


def compute_form_coefficients(shape: Shape) -> tuple[float, float]:
    """Return skewness and excess kurtosis of a distribution; both are zero for a normal
    distribution without cutoff.
    """
    x, weights = shape.nodes(0.0, 64, whole=True)
    second, third, fourth = (float(np.sum(weights * x**n)) for n in (2, 3, 4))
    return third / second**1.5, fourth / second**2 - 3.0


class Accuracy:
    """The table of relative errors of the media. ``data`` is the content of its file."""

    def __init__(self, data: Mapping[str, Any]) -> None:
        self.data = data

    def media(self) -> tuple[str, ...]:
        """Return the names of the media whose error is known, the cheapest first; the last is
        "simulation".
        """
        return tuple(next(iter(self.data["lattices"].values()))["errors"]["any"]["force"])

    def _of(self, structure: Lattice, truth: FrictionHistory) -> Mapping[str, Any] | None:
        """Return the part of a lattice, or None."""
        parts: Mapping[str, Any] = self.data["loaded" if truth.is_loaded else "lattices"]
        return parts.get(structure.name) if LATTICES.get(structure.name) == structure else None

    def explain_uncovered(self, packing: Packing, truth: FrictionHistory = REST) -> str | None:
        """Return the reason why the table does not cover a packing, or a truth; None if it does."""
        if not packing.spread_matters:
            return None
        part = self._of(packing.structure, truth)
        if part is None:
            *others, last = self.data["loaded" if truth.is_loaded else "lattices"]
            known = f"{', '.join(others)} and {last} lattices" if others else f"{last} lattice"
            against = " against arrays loaded with friction" if truth.is_loaded else ""
            return (
                f"none were measured on the {packing.structure.name} lattice{against}; they were"
                f" on the {known}"
            )
        if packing.structure.periods == 2 and packing.motions not in (None, IN_PLANE.name):
            return "the errors are those of balls that move in the plane alone"
        if packing.torsion or packing.bending:
            return "the errors are those of contacts that resist neither twist nor rolling"
        skewness, kurtosis = (
            compute_form_coefficients(packing.spread.shape) if packing.spread else (0.0, 0.0)
        )
        most = part["most"]
        if abs(skewness) > most["skewness"] or kurtosis > most["kurtosis"]:
            known = (
                f"skewness up to {most['skewness']:.3g}, excess kurtosis up to"
                f" {most['kurtosis']:.3g}"
            )
            return (
                f"the distribution of diameters has skewness {skewness:.3g} and excess kurtosis"
                f" {kurtosis:.3g}; {known}"
            )
        mu = truth.friction_coefficient
        eta = packing.mindlin_ratio
        if mu is None:
            return None
        low = min(part["mindlin_ratios"])
        high = max(part["mindlin_ratios"])
        least = min(float(one["friction_coefficient"]) for one in part["truths"])
        responses = list(dict.fromkeys(one["shear_response"] for one in part["truths"]))
        if eta == 0.0:
            return "the balls resist no slip, so that no friction loads them"
        if not low * (1.0 - 1e-9) <= eta <= high * (1.0 + 1e-9):
            found = (
                f"with friction in the statics they were measured for Mindlin ratios from"
                f" {low:.3g} to {high:.3g}"
            )
            return f"{found}, not for {eta:.3g}"
        if mu < least:
            return f"they were measured for friction coefficients from {least:g} on, not for {mu:g}"
        if truth.shear_response not in responses:
            found = (
                f"they were measured for shear_response {' and '.join(responses)} on this lattice"
            )
            return f"{found}, not for {truth.shear_response}"
        return None

    def ratio(self, packing: Packing, truth: FrictionHistory = REST) -> float:
        """Return W/d of the arrays that the errors of a packing were measured of; zero in the
        directions of the lattice.
        """
        return float((self._of(packing.structure, truth) or {}).get("ratio", 0.0))

    def least(self, packing: Packing, kind: str, truth: FrictionHistory = REST) -> float:
        """Return the least load from which errors are known: a* for the kind "overlap", f* for the
        others.

        It is zero where every medium is exact. The packing must be one that the table covers.
        """
        part = self._of(packing.structure, truth)
        table = "overlap" if kind == "overlap" else "force"
        return (
            float(part["loads"][table][0]) if part is not None and packing.spread_matters else 0.0
        )

    def error(
        self,
        medium: str,
        packing: Packing,
        load: Load,
        balls: int = 1,
        truth: FrictionHistory = REST,
    ) -> Array:
        """Return the largest expected relative error of velocities and frequencies, with the shape
        of an applied load.

        ``medium`` is one of :meth:`media`, of which the simulation is one of the ``truth`` itself;
        or, of arrays loaded with friction, :data:`FRICTIONLESS`. ``balls`` is the number of balls
        of a simulation, in all its samples. The error is zero for equal balls and on a line, and
        +inf for packings and truths that the table does not cover and below its least load. Between
        friction coefficients of the table the larger error counts. Above its greatest load the
        error falls as the square of the spread over the overlap, which is the law of high loads;
        against arrays that respond with partial slip, whose contacts are softer by |T|/(3 mu f), it
        falls as the spread over the overlap.
        """
        if not packing.spread_matters:
            return np.zeros(load.shape)
        part = self._of(packing.structure, truth)
        if part is None or self.explain_uncovered(packing, truth) is not None:
            return np.full(load.shape, np.inf)
        table = "overlap" if load.kind == "overlap" else "force"
        shape = packing.spread.shape if packing.spread else None
        family = "uniform" if isinstance(shape, UniformShape) else "any"
        if isinstance(shape, NormalShape) and 2.0 <= shape.cutoff <= 6.0:
            family = "normal"
        loads = np.array(part["loads"][table])
        rows = _select_rows(part["mindlin_ratios"], packing.mindlin_ratio)
        truths = [part]
        if truth.friction_coefficient is not None:  # both neighbours of its friction coefficient
            truths = [
                one for one in part["truths"] if one["shear_response"] == truth.shear_response
            ]
            known = [float(one["friction_coefficient"]) for one in truths]
            truths = [truths[row] for row in _select_rows(known, truth.friction_coefficient)]
        beside = [np.array(one["errors"][family][table][medium])[rows] for one in truths]
        largest = np.concatenate(beside).max(axis=0)
        power = 1.0 if truth.is_loaded and truth.shear_response == "partial_slip" else 2.0
        place = np.maximum(reduce_load(packing, load), 0.0)
        with np.errstate(over="ignore", divide="ignore"):
            found = np.exp(np.interp(np.log(place), np.log(loads), np.log(largest)))
            # the overlap over that at the greatest load of the table, by the law of equal balls
            further = (
                overlap_of(place / loads[-1])
                if table == "force"
                else (place - 0.5) / (loads[-1] - 0.5)
            )
            found = np.where(
                place > loads[-1], largest[-1] / np.maximum(further, 1.0) ** power, found
            )
        if medium == "simulation":
            found = found * (DEVIATIONS / math.sqrt(balls))
        return np.asarray(np.where(place >= loads[0], found, np.inf))


def _select_rows(known: Sequence[float], value: float) -> list[int]:
    """Return the rows of the tabulated values next below and above ``value``, or the one row that
    has it.
    """
    above = min(int(np.searchsorted(known, value)), len(known) - 1)
    beside = [max(above - 1, 0), above]
    return [row for row in beside if math.isclose(known[row], value)] or beside


@cache
def accuracy() -> Accuracy:
    """Read the table that comes with the package; it is read once."""
    data = json.loads((files("granphon") / "data" / "accuracy.json").read_text(encoding="utf-8"))
    if data["schema"] != _SCHEMA:
        raise InputError(
            f"accuracy.json has schema {data['schema']}, not {_SCHEMA}",
            mend="Install granphon anew",
        )
    return Accuracy(data)
