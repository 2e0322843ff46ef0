"""Fit the width of the distribution of diameters to measured sound velocities, as Section IV finds W = 2.04 um.

The logarithm of each parameter is fitted by least squares (:mod:`granphon.fits.least_squares`), starting from several
widths, with exact derivatives (:mod:`granphon.fits.velocity_model`).
"""

from __future__ import annotations

import math
import os
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, Self

import numpy as np
from numpy.typing import ArrayLike, NDArray

from granphon.balls.lattices import one_direction
from granphon.balls.packing import Packing
from granphon.balls.parameters import PARAMETERS
from granphon.base.errors import InputError, message
from granphon.base.results import Result
from granphon.base.staging import write_text
from granphon.base.tables import table_text
from granphon.base.text import dump_yaml, versions
from granphon.base.validation import real_array, require, texts, truth
from granphon.fits.goodness import are_errors_known, compute_leverages, compute_probability, find_warnings
from granphon.fits.least_squares import FitProblem, explain_undetermined, find_best, find_covariance
from granphon.fits.measurements import Measurements
from granphon.fits.velocity_model import VARIABLE, VelocityModel, Waves
from granphon.media.choice import MediumChoice
from granphon.observables.validity import validity

Array = NDArray[np.float64]
#: keys that stand in fit.yaml before the fields of the fit; they are ignored when a fit is read
_HEAD = ("versions", "medium", "width", "stderr", "std", "std_stderr", "p")


@dataclass(frozen=True, eq=False, repr=False)
class WidthFit(Result):
    """Parameters of a packing that fit measured velocities, and how well they are known.

    Attributes
    ----------
    packing : with the fitted parameters.
    choice : the medium that models the packing.
    waves : which waves were measured.
    parameters, values : names (p,) and SI values (p,) of the fitted parameters.
    covariance : covariance (p, p) of their errors, SI; nan if they are unknown, as the scatter is below the rounding of the
        data.
    force, velocity : the data, (n,), N and m/s.
    sigma : standard error of each velocity, (n,), m/s: as given, or from the scatter, (sum of residuals^2 / dof)^(1/2).
    sigma_given : whether sigma was given.
    velocities : velocities of the fit at these forces, (n,), m/s.
    chi2 : sum of (residual/sigma)^2, which equals ``dof`` where sigma is from the scatter.
    dof : degrees of freedom, n - p.
    warnings : reasons not to trust the fit.
    """

    units = {
        "width": "m", "stderr": "m", "std": "m", "std_stderr": "m", "p": "1",
        "force": "N", "velocity": "m/s", "sigma": "m/s", "velocities": "m/s",
    }  # fmt: skip
    _shapes = {
        "parameters": "p", "values": "p", "covariance": "p p", "force": "n", "velocity": "n", "sigma": "n",
        "velocities": "n",
    }  # fmt: skip

    _notebook_fields = ("width", "stderr")

    packing: Packing
    choice: MediumChoice
    waves: Waves
    parameters: tuple[str, ...]
    values: Array
    covariance: Array
    force: Array
    velocity: Array
    sigma: Array
    sigma_given: bool
    velocities: Array
    chi2: float
    dof: int
    warnings: tuple[str, ...]

    @property
    def width(self) -> float:
        """Width W of the distribution of diameters, m; the packing's own if it was not fitted."""
        return float(self.values[self.parameters.index("width")]) if "width" in self.parameters else self.packing.width

    @property
    def stderr(self) -> float:
        """Standard error of the width, m; 0 if it was not fitted."""
        return float(self.stderrs[self.parameters.index("width")]) if "width" in self.parameters else 0.0

    @property
    def stderrs(self) -> Array:
        """Standard error of each parameter, (p,), SI."""
        return np.sqrt(np.diag(self.covariance))

    @property
    def errors_are_known(self) -> bool:
        """Whether the standard errors rest on more than the rounding of the data; where not, they are nan."""
        return bool(np.all(np.isfinite(self.covariance)))

    @property
    def std(self) -> float:
        """Standard deviation of the fitted distribution of diameters, W/sqrt(12), m."""
        return self.width / math.sqrt(12.0)

    @property
    def std_stderr(self) -> float:
        """Standard error of :attr:`std`, m."""
        return self.stderr / math.sqrt(12.0)

    @property
    def p(self) -> float:
        """Probability that errors of the given sigma make a larger ``chi2``.

        If sigma and the model are right, all values from 0 to 1 are equally likely. nan with no degrees of freedom, or with
        sigma from the scatter.
        """
        return compute_probability(self.chi2, self.dof) if self.sigma_given else math.nan

    @property
    def residuals(self) -> Array:
        """Measured less fitted velocity, (n,), m/s."""
        return self.velocity - self.velocities

    @property
    def medium(self) -> str:
        """The medium in words."""
        return self.choice.label

    @property
    def is_isotropic(self) -> bool:
        """Whether long waves in the lattice have the same velocities in all directions."""
        return MediumChoice("ala").of(self.packing).at_force(float(self.force[0])).is_isotropic

    def velocity_at(self, force: ArrayLike, medium: str | None = None) -> Any:
        """Return the velocity of the fitted packing, m/s, at other forces, N; in another ``medium`` if one is named.

        Raises :class:`~granphon.base.errors.InputError` if every measured pulse had a frequency of its own.
        """
        if np.ndim(self.waves.frequency):
            mend = "Use .velocities, the velocities of the fit at the data"
            raise InputError(message("the measured pulses have many frequencies", mend=mend))
        choice = MediumChoice.parse(medium or self.choice)
        # samples in their exact geometry have finite overlap of themselves: nobody has asked for it of other media
        asked = self.waves.finite_overlap and not self.choice.is_exact
        waves = replace(self.waves, finite_overlap=choice.has_finite_overlap(asked))
        if choice.stand_in != choice:
            forces = real_array("force", force)
            model = VelocityModel(self.packing, ("width",), choice, forces.ravel(), waves)
            start = model.find_start(self.packing.width)
            return model.settle_geometry(start)(start)[0].reshape(forces.shape)[()]
        return waves.velocity(choice.of(self.packing).at_force(force, finite_overlap=waves.finite_overlap))[0][()]

    def _field_units(self) -> dict[str, str]:
        """Return units by name; those of ``values`` are separated by commas, the rows of ``covariance`` by semicolons."""
        each = [PARAMETERS[name] or "1" for name in self.parameters]
        rows = (", ".join(f"{a}^2" if a == b else f"{a} {b}" for b in each) for a in each)
        return super()._field_units() | {"values": ", ".join(each), "covariance": "; ".join(rows)}

    @classmethod
    def from_dict(cls, data: Mapping[str, Any]) -> Self:
        """Build a fit from plain data, SI; the keys that stand in fit.yaml before the fields are ignored."""
        mapping = isinstance(data, Mapping)
        return super().from_dict({n: v for n, v in data.items() if n not in _HEAD} if mapping else data)

    def _check(self) -> None:
        """Check the fields, and that the parameters can be fitted; raise InputError otherwise."""
        super()._check()
        if unknown := set(self.parameters) - set(VARIABLE):
            raise InputError(message(f"{', '.join(sorted(unknown))} cannot be fitted", mend="Use " + ", ".join(VARIABLE)))

    def write(self, folder: str | os.PathLike[str]) -> None:
        """Write fit.yaml, the whole fit, and fit.csv, the data with the fit, into a folder, which is made if need be."""
        numbers = {name: getattr(self, name) for name in _HEAD[2:]}
        head = {"versions": versions("numpy", "scipy"), "medium": self.medium, **numbers}
        write_text(Path(folder) / "fit.yaml", dump_yaml(head | self.to_dict()))
        columns = {
            "force (N)": self.force, "velocity (m/s)": self.velocity, "sigma (m/s)": self.sigma,
            "fit (m/s)": self.velocities, "residual (m/s)": self.residuals,
        }  # fmt: skip
        if self.waves.frequency is not None:
            columns["frequency (Hz)"] = np.broadcast_to(self.waves.frequency, self.force.shape)
        text = table_text(columns, np.stack(list(columns.values()), axis=1).tolist())
        write_text(Path(folder) / "fit.csv", text)


#: files of a fit: those of :meth:`WidthFit.write`, and its figure
FIT_FILES = ("fit.yaml", "fit.csv", "fit.png")


def fit_width(
    packing: Packing,
    force: ArrayLike,
    velocity: ArrayLike,
    sigma: ArrayLike | None = None,
    frequency: ArrayLike | None = None,
    *,
    medium: str | Mapping[str, Mapping[str, Any] | None] | MediumChoice = "ema",
    parameters: Sequence[str] = ("width",),
    branch: str = "longitudinal",
    direction: ArrayLike | None = None,
    finite_overlap: bool = False,
) -> WidthFit:
    """Find the width of the distribution of diameters, or other parameters, at which ``medium`` gives measured velocities.

    Parameters
    ----------
    packing : the balls. Its spread gives the shape of the distribution, which is uniform if there is no spread. The fit
        starts from the values of the packing, and from many other widths as well.
    force : mean contact forces, (n,), N.
    velocity : sound velocities, (n,), m/s.
    sigma : standard errors of the velocities, m/s, one number or (n,). If left out, they are assumed equal and found from
        the scatter.
    frequency : frequency of the pulses, Hz, one number or (n,): velocities are then group velocities. If left out, they are
        velocities of long waves.
    medium : "afa", "ema", "simulation", or a name with its options. A simulation has the same balls at every width, with
        deviations in proportion to it. A dozen equilibria for a decade of force serve all widths, by interpolation. In the
        exact geometry, and for a history that starts at a load, they serve one width: they are solved again at the fitted
        parameters until those change by less than 1e-3 of them.
    parameters : "width", and "young_modulus" or "diameter" if these are to be fitted too; without "width" the packing keeps
        its spread. If its balls are equal then, every medium is the averaged lattice.
    branch : "longitudinal" or "transverse"; in space "transverse_slow" or "transverse_fast" instead of the latter.
    direction : direction of propagation, (p,) for a lattice with p periods; by default along its last axis. In the plane
        that is (0, 1), across a row of touching balls, from side to side of the paper's hexagonal frame.
    finite_overlap : keep the terms of relative order delta/d in the velocities, as the exact geometry of a simulation always
        does. Standard errors in the exact geometry are those at constant W/d.

    Returns
    -------
    :class:`WidthFit`. Standard errors are those of linear theory, from the given sigma or from the scatter. If from the
    scatter, a parameter's error over its standard error follows Student's distribution with ``dof`` degrees of freedom.
    The ``warnings`` say why a fit is not to be trusted: ``p`` below 0.001 or above 0.999, no degrees of freedom, a scatter
    below the rounding of the data, data above the velocity of equal balls, one datum that decides the fit alone
    (leverage above 0.9) or lies far off, a standard error above half the value.

    Raises
    ------
    InputError : data that are not finite and above zero, of different lengths, or too few; data that cannot determine the
        parameters (a standard error above the parameter itself, parameters that have the same effect, velocities equal
        to those of equal balls or higher); velocities so far from those of equal balls that a unit is wrong; loads or a
        frequency that the medium cannot carry; the medium "auto"; a lattice without such waves, or without such a medium
        for balls that differ; samples of so few balls that the parameters of round after round differ.
    """
    data = Measurements(real_array("force", force), real_array("velocity", velocity), sigma, frequency)
    periods = packing.structure.periods
    along = np.eye(periods)[-1] if direction is None else direction
    names = texts("parameters", parameters)
    choice = MediumChoice.parse(medium, packing.structure)
    if "width" not in names and not packing.width:
        choice = MediumChoice("ala")
    asked = require("finite_overlap", truth, finite_overlap)
    waves = Waves(branch, one_direction(along, periods), data.frequency, choice.has_finite_overlap(asked))
    choice.require_fixed("a fit")
    problem = FitProblem.of(VelocityModel(packing, names, choice, data.force, waves), data)
    problem, logs = find_best(problem)
    waves = problem.model.waves  # the geometry of samples is settled, and with it whether overlap is finite
    if data.sigma is None:
        # numbers in double precision scatter by their rounding at least
        off, least = problem(logs)[0], np.finfo(float).eps * float(np.max(data.velocity))
        problem = replace(problem, sigma=np.full(off.shape, max(math.sqrt(float(off @ off) / problem.dof), least)))
    residuals, matrix = problem(logs)
    covariance, step = find_covariance(problem, logs, residuals, matrix)
    errors = np.sqrt(np.diag(covariance))
    # where the given sigma is smaller than the scatter, the step is compared with errors that the scatter would give
    chi2, given = float(residuals @ residuals), data.sigma is not None
    scatter = max(1.0, math.sqrt(chi2 / max(problem.dof, 1)))
    if np.any(errors > 1.0) or np.any(np.abs(step) > 1e-3 * scatter * errors + 1e-9):
        raise explain_undetermined(problem, logs, errors)
    fitted, values = problem.model.fit_packing(logs), np.exp(logs)
    warnings = find_warnings(
        names, errors, data.force, data.velocity, residuals, compute_leverages(matrix), problem.sigma, given,
        problem.model.equal_balls(logs)[0],
    )  # fmt: skip
    if not are_errors_known(given, problem.sigma, data.velocity):
        covariance = np.full(covariance.shape, np.nan)
    # the validity of a simulation is decided at the least and the greatest force
    loads = data.force[[np.argmin(data.force), np.argmax(data.force)]] if problem.model.is_sampled else data.force
    state = problem.model.choice.of(fitted).at_force(loads, finite_overlap=waves.finite_overlap)
    return WidthFit(
        fitted, problem.model.choice, waves, names, values, covariance * np.outer(values, values), data.force, data.velocity,
        problem.sigma, given, data.velocity - residuals * problem.sigma, chi2 if given else float(problem.dof), problem.dof,
        (*warnings, *validity(state).warnings),
    )  # fmt: skip


def convert_pressure(
    packing: Packing,
    finite_overlap: bool,
    medium: str | Mapping[str, Mapping[str, Any] | None] | MediumChoice,
    fitted: Sequence[str],
    pressure: float,
) -> float:
    """Return the contact force, N, under a pressure (N on a line, N/m in the plane, Pa in space).

    With finite overlap, which the exact geometry of a simulation has too, it is that in the ``medium`` at the packing's own
    width; for a simulation in the effective medium, whose overlaps differ from those of samples by less than W/100.

    Raises :class:`~granphon.base.errors.InputError` if the diameter is among the parameters to be ``fitted``, as the force
    is proportional to it.
    """
    if "diameter" in fitted:
        why = "The contact force under a pressure is proportional to the diameter"
        raise InputError(message("the diameter is fitted, and pressures are given", why, "Give contact forces"))
    choice = MediumChoice.parse(medium)
    finite = choice.has_finite_overlap(finite_overlap)
    if not finite:  # in the paper's limit the medium does not matter
        choice = MediumChoice("ala")
    return float(choice.stand_in.of(packing).at_pressure(pressure, finite_overlap=finite).force)
