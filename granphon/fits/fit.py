"""The width of the distribution of diameters from measured sound velocities, as Section IV finds W = 2.04 um.

The logarithm of each parameter is fitted by least squares, from several widths, with exact derivatives
(:mod:`granphon.fits.velocity_model`).
"""

from __future__ import annotations

import math
import os
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import lru_cache
from pathlib import Path
from typing import Any, Self

import numpy as np
from numpy.typing import ArrayLike, NDArray

from granphon.balls.lattices import one_direction
from granphon.balls.packing import Packing
from granphon.balls.parameters import PARAMETERS
from granphon.base.arguments import real_array, texts
from granphon.base.errors import InputError, message
from granphon.base.results import Result
from granphon.base.text import dump_yaml, versions
from granphon.fits.goodness import Goodness, leverages, probability
from granphon.fits.measurements import Measurements
from granphon.fits.velocity_model import VARIABLE, VelocityModel, Waves
from granphon.media.choice import MediumChoice
from granphon.observables.validity import validity

__all__ = ["FIT_FILES", "WidthFit", "fit_width", "force_of_pressure"]

Array = NDArray[np.float64]
#: widths are tried from f* = 1e4 at the least force, where nothing is left of disorder, to f* = 1e-2 at the largest
_NARROWEST, _WIDEST = 1e4, 1e-2
_TRIALS_PER_DECADE = 2
#: the velocities of a model are right to this part of them; errors above its inverse are taken for mistakes
_LEAST_ERROR = 1e-12
#: a pulse of more than this part of the highest frequency of its branch is near the end of it
_NEAR_TOP = 0.98
#: velocities below this part of those of equal balls, or above its inverse, are taken for mistakes
_LEAST_RATIO = 1e-6
#: parameters whose effects differ by less than this part cannot be told apart
_SAME = 1e-6
#: what stands in fit.yaml before the fields
_HEAD = ("versions", "medium", "width", "stderr", "std", "std_stderr", "p")


@dataclass(frozen=True, eq=False, repr=False)
class WidthFit(Result):
    """Parameters of a packing that fit measured velocities, and how well they are known.

    Attributes
    ----------
    packing : with the fitted parameters.
    choice : the medium that models it.
    waves : which waves were measured.
    parameters, values, covariance : names (p,), SI values (p,), covariance (p, p) of their errors; nan where these are not
        known, from a scatter below the rounding of the data.
    force, velocity : the data, (n,), N and m/s.
    sigma : standard error of each velocity, (n,), m/s: as given, or from the scatter, (sum of residuals^2 / dof)^(1/2).
    sigma_given : whether it was given.
    velocities : of the fit at these forces, (n,), m/s.
    chi2, dof : sum of (residual/sigma)^2, which is ``dof`` where sigma is from the scatter; n - p.
    warnings : where the fit is not to be trusted.
    """

    units = {
        "width": "m", "stderr": "m", "std": "m", "std_stderr": "m", "p": "1",
        "force": "N", "velocity": "m/s", "sigma": "m/s", "velocities": "m/s",
    }  # fmt: skip
    shapes = {
        "parameters": "p", "values": "p", "covariance": "p p", "force": "n", "velocity": "n", "sigma": "n",
        "velocities": "n",
    }  # fmt: skip

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
        """W, m."""
        return float(self.values[self.parameters.index("width")])

    @property
    def stderr(self) -> float:
        """Standard error of the width, m."""
        return float(self.stderrs[self.parameters.index("width")])

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
        """Probability that errors of the sigma given make a larger ``chi2``; of right errors and model any is as likely.

        nan with no degrees of freedom, or with sigma from the scatter.
        """
        return probability(self.chi2, self.dof) if self.sigma_given else math.nan

    @property
    def residuals(self) -> Array:
        """Measured less fitted velocity, (n,), m/s."""
        return self.velocity - self.velocities

    @property
    def medium(self) -> str:
        """The medium in words."""
        return self.choice.label

    def velocity_at(self, force: ArrayLike, medium: str | None = None) -> Any:
        """Velocity of the fitted packing at other forces (N), m/s; of another ``medium`` if one is named.

        :class:`~granphon.base.errors.InputError` if every measured pulse had a frequency of its own.
        """
        if np.ndim(self.waves.frequency):
            raise InputError(message("the measured pulses have many frequencies", mend="Use .velocities, at the data"))
        choice = MediumChoice.parse(medium or self.choice)
        if choice.simulates:
            forces = real_array("force", force)
            model = VelocityModel(self.packing, ("width",), choice, forces.ravel(), self.waves)
            return model(model.start(self.width))[0].reshape(forces.shape)[()]
        return self.waves.velocity(choice.of(self.packing).at_force(force, finite_overlap=self.waves.finite_overlap))[0][()]

    def said_units(self) -> dict[str, str]:
        """As of any result; units of ``values`` are parted by commas, those of ``covariance`` by semicolons between rows."""
        each = [PARAMETERS[name] or "1" for name in self.parameters]
        rows = (", ".join(f"{a}^2" if a == b else f"{a} {b}" for b in each) for a in each)
        return super().said_units() | {"values": ", ".join(each), "covariance": "; ".join(rows)}

    @classmethod
    def from_dict(cls, data: Mapping[str, Any]) -> Self:
        """As of any result; what heads fit.yaml besides is told again by the fields."""
        mapping = isinstance(data, Mapping)
        return super().from_dict({n: v for n, v in data.items() if n not in _HEAD} if mapping else data)

    def check(self) -> None:
        """Also that the parameters are some that can be fitted."""
        super().check()
        if unknown := set(self.parameters) - set(VARIABLE):
            raise InputError(message(f"{', '.join(sorted(unknown))} cannot be fitted", mend="Use " + ", ".join(VARIABLE)))

    def write(self, folder: str | os.PathLike[str]) -> None:
        """Write fit.yaml, everything, and fit.csv, data and fit, into a folder that is there."""
        numbers = {name: getattr(self, name) for name in _HEAD[2:]}
        head = {"versions": versions("numpy", "scipy"), "medium": self.medium, **numbers}
        (Path(folder) / "fit.yaml").write_text(dump_yaml(head | self.to_dict()), encoding="utf-8")
        columns = {
            "force (N)": self.force, "velocity (m/s)": self.velocity, "sigma (m/s)": self.sigma,
            "fit (m/s)": self.velocities, "residual (m/s)": self.residuals,
        }  # fmt: skip
        if self.waves.frequency is not None:
            columns["frequency (Hz)"] = np.broadcast_to(self.waves.frequency, self.force.shape)
        rows = [",".join(map(repr, row)) for row in np.stack(list(columns.values()), axis=1).tolist()]
        (Path(folder) / "fit.csv").write_text("\n".join([",".join(columns), *rows, ""]), encoding="utf-8")


#: what a fit writes: :meth:`WidthFit.write`, and its figure
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
    direction: ArrayLike = (0.0, 1.0),
    finite_overlap: bool = False,
) -> WidthFit:
    """The width of the distribution of diameters at which ``medium`` gives the measured velocities.

    Parameters
    ----------
    packing : the balls. Its spread says the shape of the distribution, uniform where there is none; what is fitted starts
        from its values, the width from many others as well.
    force : mean contact forces, (n,), N.
    velocity : sound velocities, (n,), m/s.
    sigma : their standard errors, m/s, one or (n,). Left out, they are taken for equal and found from the scatter.
    frequency : of the pulses, Hz, one or (n,): velocities are then group velocities. Left out, they are those of long waves.
    medium : "afa", "ema", "simulation", or a name with its options. A simulation has the same balls at every width, their
        deviations in proportion. A dozen equilibria for a decade of force, interpolated, serve all widths.
    parameters : "width", and "young_modulus" or "diameter" if these are to be fitted too.
    branch : "longitudinal" or "transverse".
    direction : of propagation. (0, 1), across a row of touching balls, is from side to side of the paper's hexagonal frame.
    finite_overlap : keep the terms of relative order delta/d in the velocities; derivatives are those of the paper's limit.

    Returns
    -------
    :class:`WidthFit`. Standard errors are those of linear theory: of the sigma given, or of the scatter, when a parameter's
    error over its standard error follows Student's distribution with ``dof`` degrees of freedom. Its ``warnings`` say where
    a fit is not to be trusted: ``p`` below 0.001 or above 0.999, no degrees of freedom, a scatter below the rounding of the
    data, one datum that decides alone (leverage above 0.9) or lies far off, a standard error above half the value.

    Raises
    ------
    InputError : data that are not finite and above zero, of different lengths, or too few; data that cannot determine the
        parameters (a standard error above the parameter itself, parameters that have the same effect, velocities of equal
        balls or above); loads or a frequency that the medium cannot carry; the medium "auto".
    """
    data = Measurements(real_array("force", force), real_array("velocity", velocity), sigma, frequency)
    waves = Waves(branch, one_direction(direction), data.frequency, finite_overlap)
    names = texts("parameters", parameters)
    choice = MediumChoice.parse(medium)
    if choice.is_automatic:
        what, why = f"the medium {choice.label!r} is not fitted with", "It is another one at each load and width"
        raise InputError(message(what, why, "Name a medium"))
    problem = _Problem.of(VelocityModel(packing, names, choice, data.force, waves), data)
    logs = _best(problem)
    if data.sigma is None:
        problem = problem.scattered(logs)
    residuals, matrix = problem(logs)
    covariance, step = _covariance(problem, logs, residuals, matrix)
    errors = np.sqrt(np.diag(covariance))
    # where sigma is smaller than the scatter, the minimum is as sharp as that tells, and found as well
    scatter = max(1.0, math.sqrt(float(residuals @ residuals) / max(problem.dof, 1)))
    if np.any(errors > 1.0) or np.any(np.abs(step) > 1e-3 * scatter * errors + 1e-9):
        raise _undetermined(problem, logs, errors)
    fitted, values = problem.model.fitted(logs), np.exp(logs)
    found = Goodness(
        names, errors, data.force, data.velocity, residuals, leverages(matrix), problem.sigma, data.sigma is not None
    )
    if not found.errors_are_known:
        covariance = np.full(covariance.shape, np.nan)
    # what limits a simulation shows at the least and the greatest force
    loads = data.force[[np.argmin(data.force), np.argmax(data.force)]] if problem.model.choice.simulates else data.force
    state = problem.model.choice.of(fitted).at_force(loads, finite_overlap=finite_overlap)
    return WidthFit(
        fitted, problem.model.choice, waves, names, values, covariance * np.outer(values, values), data.force, data.velocity,
        problem.sigma, found.given, data.velocity - residuals * problem.sigma, found.chi2, found.dof,
        (*found.warnings, *validity(state).warnings),
    )  # fmt: skip


def force_of_pressure(
    packing: Packing,
    finite_overlap: bool,
    medium: str | Mapping[str, Mapping[str, Any] | None] | MediumChoice,
    fitted: Sequence[str],
    pressure: float,
) -> float:
    """Contact force, N, of a pressure, N/m: with finite overlap that of the ``medium`` at the packing's own width.

    :class:`~granphon.base.errors.InputError` if the diameter, by which it is in proportion, is among what is to be
    ``fitted``.
    """
    if "diameter" in fitted:
        why = "The contact force of a pressure is in proportion to the diameter"
        raise InputError(message("the diameter is fitted, and pressures are given", why, "Give contact forces"))
    # in the paper's limit the medium does not matter
    choice = MediumChoice.parse(medium) if finite_overlap else MediumChoice("ala")
    return float(choice.of(packing).at_pressure(pressure, finite_overlap=finite_overlap).force)


# -- least squares --------------------------------------------------------------------------------------------------


@dataclass(frozen=True)
class _Problem:
    """Least squares in the logarithms of the parameters of a model; ``sigma`` (n,) is 1 m/s until the scatter is known."""

    model: VelocityModel
    velocity: Array
    sigma: Array

    @classmethod
    def of(cls, model: VelocityModel, data: Measurements) -> Self:
        model.require_carried()
        with np.errstate(all="ignore"):
            ratio = data.velocity / model.equal_balls(model.start(1e-9 * model.packing.diameter))[0]
        if not (np.all(ratio > _LEAST_RATIO) and np.all(ratio < 1.0 / _LEAST_RATIO)):
            what = f"the velocities are {np.min(ratio):.3g} to {np.max(ratio):.3g} times those of equal balls"
            raise InputError(message(what, mend="Check the units of force and velocity"))
        part = np.ones(1) if data.sigma is None else np.ravel(data.sigma / data.velocity)
        if np.any(part <= _LEAST_ERROR):
            what = f"sigma is as little as {np.min(part):.3g} times the velocity"
            why = f"The velocities of a model are right to {_LEAST_ERROR:g} of themselves, and no fit is as good as that"
            raise InputError(message(what, why, "Check the units of sigma, or give the errors that the data have"))
        if np.any(part >= 1.0 / _LEAST_ERROR):
            what = f"sigma is as much as {np.max(part):.3g} times the velocity"
            raise InputError(message(what, "No measurement has such an error", "Check its units"))
        if len(data.force) < len(model.names) + (data.sigma is None):
            several = "s" if len(data.force) > 1 else ""
            what = f"found {len(data.force)} measurement{several}, to which {' and '.join(model.names)} cannot be fitted"
            why = "Without sigma one more is needed, for the scatter" if data.sigma is None else ""
            raise InputError(message(what, why, "Measure more"))
        return cls(model, data.velocity, np.ones(data.force.shape) * (1.0 if data.sigma is None else data.sigma))

    @property
    def dof(self) -> int:
        """Degrees of freedom of the residuals."""
        return len(self.velocity) - len(self.model.names)

    @property
    def widths(self) -> Array:
        """Widths to try, m, ascending; the packing's own is one."""
        force, packing = self.model.force, self.model.packing
        units = np.array([np.min(force) / _NARROWEST, np.max(force) / _WIDEST])
        low, high = np.cbrt(units / packing.law.coefficient) ** 2
        count = math.ceil(_TRIALS_PER_DECADE * math.log10(high / low)) + 1
        return np.unique(np.append(np.geomspace(low, high, count), max(packing.width, low)))

    def __call__(self, logs: Array) -> tuple[Array, Array]:
        """Residuals (n,) and derivatives (n, p) of the velocities, in units of sigma; InputError where there are none."""
        velocities, slopes = self.model(logs)
        return (self.velocity - velocities) / self.sigma, slopes * (velocities / self.sigma)[:, None]

    def of_medium(self, medium: str) -> _Problem:
        """The same in another medium."""
        return replace(self, model=replace(self.model, choice=MediumChoice(medium)))

    def scattered(self, logs: Array) -> _Problem:
        """The problem with sigma from the scatter about a fit."""
        residuals = self(logs)[0]
        # numbers in double precision scatter by their rounding at least
        least = np.finfo(float).eps * float(np.max(self.velocity))
        scatter = max(math.sqrt(float(residuals @ residuals) / self.dof), least)
        return replace(self, sigma=np.full(residuals.shape, scatter))


def _best(problem: _Problem) -> Array:
    """Logarithms at the least sum of squares. Of a simulation it is looked for near that of the effective medium."""
    if problem.model.choice.simulates:
        return _descended(problem, _best(problem.of_medium("ema")))
    found = (_descended(problem, start) for start in _starts(problem))
    return min(found, key=lambda logs: float(np.sum(problem(logs)[0] ** 2)))


def _starts(problem: _Problem) -> list[Array]:
    """Logarithms to start from: of each width at which the sum of squares is least among its neighbours.

    For each width the other parameters are taken at their best by one linear step. Widths so large that the medium refuses
    them are left out.
    """
    model, where = problem.model, problem.model.width_index
    others = np.arange(len(model.names)) != where
    starts: list[Array] = []
    squares, effect = [math.inf], 0.0
    for width in problem.widths.tolist():
        logs = model.start(width)
        try:
            residuals, matrix = problem(logs)
        except InputError:
            if not starts:  # so narrow a spread is not to blame
                raise
            break
        step = np.linalg.lstsq(matrix[:, others], residuals, rcond=_SAME)[0]
        starts.append(logs)
        squares.append(float(np.sum((residuals - matrix[:, others] @ step) ** 2)))
        effect = max(effect, float(np.max(np.abs(matrix[:, where] / (problem.velocity / problem.sigma - residuals)))))
    if effect < 1e-9:
        what = f"in the medium {model.choice.label!r} sound does not depend on the width of this spread"
        raise InputError(message(what, mend="Use another medium, such as ema, and a spread that has a shape"))
    squares.append(math.inf)
    return [start for i, start in enumerate(starts, 1) if squares[i] <= min(squares[i - 1], squares[i + 1])]


def _descended(problem: _Problem, start: Array) -> Array:
    """Logarithms at the minimum of the sum of squares that is reached from ``start``."""
    from scipy.optimize import least_squares

    @lru_cache(maxsize=2)
    def system(move: tuple[float, ...]) -> tuple[Array, Array]:
        return problem(start + np.array(move))

    def residuals(move: Array) -> Array:
        try:
            return system(tuple(move.tolist()))[0]
        except InputError:  # the trust region shrinks
            if not any(move):
                raise
            return np.full(problem.velocity.shape, np.inf)

    def jacobian(move: Array) -> Array:
        return -system(tuple(move.tolist()))[1]

    found = least_squares(residuals, np.zeros(start.shape), jacobian, ftol=1e-12, xtol=1e-11, gtol=1e-14, max_nfev=100)
    return np.asarray(start + found.x)


def _covariance(problem: _Problem, logs: Array, residuals: Array, matrix: Array) -> tuple[Array, Array]:
    """Covariance (p, p) of the logarithms, and the step (p,) to the minimum of the linear problem."""
    norms = np.linalg.norm(matrix, axis=0)
    left, singular, right = np.linalg.svd(matrix / np.maximum(norms, 1e-300), full_matrices=False)
    same = bool(np.all(norms > 0.0)) and singular[-1] < _SAME * singular[0]
    never = same and len(problem.model.names) == len(VARIABLE)  # whatever the data
    # were the others known, the standard error of a parameter would be one over its norm
    if not never and (np.any(norms < 1.0) or logs[problem.model.width_index] < math.log(problem.widths[0])):
        raise _undetermined(problem, logs, 1.0 / np.maximum(norms, 1e-300))
    if same:
        why = "Long waves know E/d and E d^(1/2) W^(3/2) only" if len(problem.model.names) == len(VARIABLE) else ""
        mend = "Measure over a wider range of force, or fit fewer parameters"
        raise InputError(message(f"the data cannot tell {' and '.join(problem.model.names)} apart", why, mend))
    root = (right / singular[:, None]).T / norms[:, None]
    return root @ root.T, root @ (left.T @ residuals)


def _undetermined(problem: _Problem, logs: Array, errors: Array) -> InputError:
    """Why the data do not determine the parameters, whose logarithms have the standard ``errors``."""
    model, sigma, worst = problem.model, problem.sigma, int(np.argmax(errors))
    width, error = float(np.exp(logs[model.width_index])), float(errors[model.width_index])
    ideal = model.equal_balls(logs)[0]
    excess = float(np.average(problem.velocity / ideal - 1.0, weights=(ideal / sigma) ** 2))
    if model.names == ("width",) and excess > 1e-9:
        if model.waves.frequency is not None:
            long = replace(model.equal_balls, waves=replace(model.waves, frequency=None))(logs)[0]
            if np.average(problem.velocity / long - 1.0, weights=(ideal / sigma) ** 2) <= 1e-9:
                what = f"the velocities are on average {100.0 * excess:.2g} % above those of pulses of equal balls"
                why = f"They are not above those of long waves. {model.equal_balls.nearest_to_top(logs)}"
                return InputError(message(what, why, "Check the frequency; leave it out for long waves"))
        return InputError(
            message(
                f"the velocities are on average {100.0 * excess:.2g} % above those of equal balls",
                "A spread of diameters slows sound, so that no width fits",
                "Check the Young modulus, diameter and density, or fit young_modulus as well",
            )
        )
    if model.names[worst] != "width" and errors[worst] > 1.0:
        what = f"the data do not determine {model.names[worst]}: its standard error is {errors[worst]:.3g} times its value"
        return InputError(message(what, mend="Measure more precisely, over a wider range of force, or fit fewer parameters"))
    if error > 1.0 or width < problem.widths[0]:
        best = f": the best is {width:.3g} m, its standard error {error * width:.3g} m"
        what = "the width cannot be told from zero" + (best if width > problem.widths[0] else "")
        least = float(np.min(model.force))
        why = f"From {least:.3g} N up the data show no slowing that grows as the force falls, beyond their errors"
        return InputError(message(what, why, "Measure at lower forces, or more precisely"))
    tops = None if model.waves.frequency is None else model.tops(logs)
    if tops is not None and np.any(model.waves.frequency > _NEAR_TOP * tops):
        what = f"no width fits: the sum of squares still falls at {width:.3g} m, where balls carry the frequency no longer"
        return InputError(message(what, model.nearest_to_top(logs), "Check the frequency and the velocities"))
    what = f"no width fits: the sum of squares still falls at {width:.3g} m, where the medium {model.choice.label!r} ends"
    why = "The velocities are too low, or do not rise with the force as in an array of balls"
    return InputError(message(what, why, "Check the units of the data, the Young modulus, diameter and density"))
