"""The accuracy of each medium: its measured relative error at a load, from a table that comes with the package.

``tests/benchmarks/accuracy.py`` made the table. It compared the media with large samples of the disordered array, at rest
without friction, on the triangular lattice, fcc and hcp, for some distributions, values of eta, and loads. For each lattice
and family of distributions (uniform, normal, any) the table stores the largest error at a load, in reduced units, or at any
higher load. It adds a margin for what lies between the tabulated points: with listed diameters errors peak where the
contacts between two of the diameters open. An error of the table is therefore a bound for packings whose distribution is not
more skewed, and has no longer tails, than those that were tried, as far as such a choice of distributions can show. For a
simulation the table stores the statistical error: the standard deviation of a sample, which falls as the root of the number
of its balls.

The error is the largest relative error of the sound velocities and of the scale of frequencies (k/M)^(1/2). In the plane the
velocities are the longitudinal and the transverse one; in space, all three along the edges of the cube, the diagonals of its
faces and its own diagonal (in hcp in the layers, across them and between).

On a line all contacts carry the same force, so that Hertz's law, and every medium, is exact there.
"""

from __future__ import annotations

import json
import math
from collections.abc import Mapping, Sequence
from functools import cache
from importlib.resources import files
from typing import Any

import numpy as np
from numpy.typing import NDArray

from granphon.balls.distributions import NormalShape, Shape, UniformShape
from granphon.balls.lattices import LATTICES, Lattice
from granphon.balls.loads import Load
from granphon.balls.motions import IN_PLANE
from granphon.balls.packing import Packing
from granphon.base.errors import InputError, message

__all__ = ["DEVIATIONS", "Accuracy", "accuracy", "compute_form_coefficients"]

Array = NDArray[np.float64]
#: number of standard deviations of a sample that count as the expected error of a simulation; the standard deviations in the
#: table include a margin
DEVIATIONS = 2.5
#: of the form of the file
_SCHEMA = 2


def compute_form_coefficients(shape: Shape) -> tuple[float, float]:
    """Return skewness and excess kurtosis of a distribution; both are zero for a normal distribution without cutoff."""
    x, weights = shape.nodes(0.0, 64, whole=True)
    second, third, fourth = (float(np.sum(weights * x**n)) for n in (2, 3, 4))
    return third / second**1.5, fourth / second**2 - 3.0


class Accuracy:
    """The table of relative errors of the media. ``data`` is the content of its file."""

    def __init__(self, data: Mapping[str, Any]) -> None:
        self.data = data

    def media(self) -> tuple[str, ...]:
        """Return the names of the media whose error is known, the cheapest first; the last is "simulation"."""
        return tuple(next(iter(self._parts.values()))["errors"]["any"]["force"])

    @property
    def _parts(self) -> Mapping[str, Any]:
        """The parts of the table, by the name of the lattice."""
        parts: Mapping[str, Any] = self.data["lattices"]
        return parts

    def _of(self, structure: Lattice) -> Mapping[str, Any] | None:
        """Return the part of a lattice, or None."""
        return self._parts.get(structure.name) if LATTICES.get(structure.name) == structure else None

    def explain_uncovered(self, packing: Packing) -> str | None:
        """Return the reason why the table does not cover a packing; None if it does."""
        if not packing.spread_matters:
            return None
        part = self._of(packing.structure)
        if part is None:
            known = ", ".join(self._parts)
            return f"none were measured on the {packing.structure.name} lattice; they were on {known}"
        if packing.structure.periods == 2 and packing.motions not in (None, IN_PLANE.name):
            return "the errors are those of balls that move in the plane alone"
        if packing.torsion or packing.bending:
            return "the errors are those of contacts that resist neither twist nor rolling"
        skewness, kurtosis = compute_form_coefficients(packing.spread.shape) if packing.spread else (0.0, 0.0)
        most = part["most"]
        if abs(skewness) > most["skewness"] or kurtosis > most["kurtosis"]:
            known = f"skewness up to {most['skewness']:.3g}, excess kurtosis up to {most['kurtosis']:.3g}"
            return f"the distribution of diameters has skewness {skewness:.3g} and excess kurtosis {kurtosis:.3g}; {known}"
        return None

    def least(self, packing: Packing, kind: str) -> float:
        """Return the least load from which errors are known: a* for the kind "overlap", f* for the others.

        It is zero where every medium is exact. The packing must be one that the table covers.
        """
        part = self._of(packing.structure)
        return float(part["loads"][_name_tabulated_kind(kind)][0]) if part is not None and packing.spread_matters else 0.0

    def reduced(self, packing: Packing, load: Load) -> Array:
        """Return f* of an applied load, or a* of a load that is given as an overlap."""
        values = load.array
        with np.errstate(all="ignore"):
            if load.kind == "overlap":
                return np.asarray(packing.width_units.reduced_spacing(values))
            if load.kind == "pressure":
                values = values * (packing.diameter ** (packing.structure.periods - 1) / packing.structure.pressure_factor)
            return np.asarray(packing.width_units.reduced_force(values))

    def error(self, medium: str, packing: Packing, load: Load, balls: int = 1) -> Array:
        """Return the largest expected relative error of velocities and frequencies, with the shape of an applied load.

        ``balls`` is the number of balls of a simulation, in all its samples. The error is zero for equal balls and on a
        line, and +inf for packings that the table does not cover and below its least load. Above its greatest load the error
        falls as the square of the spread over the overlap, which is the law of high loads.
        """
        if not packing.spread_matters:
            return np.zeros(load.shape)
        part = self._of(packing.structure)
        if part is None or self.explain_uncovered(packing) is not None:
            return np.full(load.shape, np.inf)
        table = _name_tabulated_kind(load.kind)
        at, known = np.array(part["loads"][table]), part["errors"][_name_family(packing)][table][medium]
        rows = np.array(known)[_select_rows(part["mindlin_ratios"], packing.mindlin_ratio)].max(axis=0)
        place = np.maximum(self.reduced(packing, load), 0.0)
        with np.errstate(over="ignore", divide="ignore"):
            found = np.exp(np.interp(np.log(place), np.log(at), np.log(rows)))
            times = (place / at[-1]) ** (2.0 / 3.0) if table == "force" else (place - 0.5) / (at[-1] - 0.5)
            found = np.where(place > at[-1], rows[-1] / np.maximum(times, 1.0) ** 2, found)
        if medium == "simulation":
            found = found * (DEVIATIONS / math.sqrt(balls))
        return np.asarray(np.where(place >= at[0], found, np.inf))


def _select_rows(known: Sequence[float], eta: float) -> list[int]:
    """Return the rows of the tabulated eta next below and above ``eta``, or the one row that has it."""
    above = min(int(np.searchsorted(known, eta)), len(known) - 1)
    beside = [max(above - 1, 0), above]
    return [row for row in beside if math.isclose(known[row], eta)] or beside


def _name_family(packing: Packing) -> str:
    """Return the family of the distribution of diameters: "uniform", "normal" or "any"."""
    shape = packing.spread.shape if packing.spread else None
    if isinstance(shape, UniformShape):
        return "uniform"
    return "normal" if isinstance(shape, NormalShape) and 2.0 <= shape.cutoff <= 6.0 else "any"


def _name_tabulated_kind(kind: str) -> str:
    return "overlap" if kind == "overlap" else "force"


@cache
def accuracy() -> Accuracy:
    """Read the table that comes with the package; it is read once."""
    data = json.loads((files("granphon") / "data" / "accuracy.json").read_text(encoding="utf-8"))
    if data["schema"] != _SCHEMA:
        raise InputError(message(f"accuracy.json has schema {data['schema']}, not {_SCHEMA}", mend="Install granphon anew"))
    return Accuracy(data)
