"""Least squares in the logarithms of a packing's parameters: the best fit, its covariance, and why there may be none."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from functools import lru_cache
from typing import Self

import numpy as np
from numpy.typing import NDArray

from granphon.base.errors import InputError, message
from granphon.base.scales import write_quantity
from granphon.fits.measurements import Measurements
from granphon.fits.velocity_model import VARIABLE, VelocityModel
from granphon.media.choice import MediumChoice

Array = NDArray[np.float64]
#: f* at the least force of the data for the narrowest width that is tried: disorder has no effect there
_NARROWEST_AT = 1e4
#: f* at the greatest force of the data for the widest width that is tried
_WIDEST_AT = 1e-2
#: widths that are tried for each factor of ten
_TRIALS_PER_DECADE = 2
#: relative error of a model's velocities; a sigma below this part of a velocity, or above its inverse, is a mistake
_MODEL_ERROR = 1e-12
#: a pulse whose frequency is above this part of the highest of its branch counts as near the end of the branch
_NEAR_TOP = 0.98
#: geometric mean of velocities, over those of equal balls, below which, or above whose inverse, units are taken for wrong:
#: no array in which a width can be found is so slow, and a unit off by a thousand is beyond it
_LEAST_RATIO = 0.03
#: the same where the Young modulus is fitted too, which may itself be far off
_LEAST_RATIO_OF_MODULUS = 1e-6
#: parameters whose effects differ by less than this part cannot be told apart
_SAME_EFFECT = 1e-6
#: number of times that samples are simulated at the parameters found last, where they do not serve all
_MOST_SIMULATED = 12
#: effect of the width on a velocity, d log v / d log W, or relative excess of a velocity, that counts as none
_NO_EFFECT = 1e-9
#: what to do where the data do not determine the parameters
_MEASURE = "Measure more precisely, over a wider range of force, or fit fewer parameters"


@dataclass(frozen=True)
class FitProblem:
    """Measured velocities and the model that is fitted to them.

    ``velocity`` and ``sigma``, its standard error, are (n,), m/s; a sigma that is not given is 1 m/s until the scatter is
    known. Call the problem with the logarithms (p,) of the model's parameters to get residuals and derivatives.
    """

    model: VelocityModel
    velocity: Array
    sigma: Array

    @classmethod
    def of(cls, model: VelocityModel, data: Measurements) -> Self:
        """Set up the problem; :class:`~granphon.base.errors.InputError` if the data cannot be right, or are too few."""
        model.require_carried()
        with np.errstate(all="ignore"):
            ratio = data.velocity / model.equal_balls(model.find_start(1e-9 * model.packing.diameter))[0]
        least = _LEAST_RATIO_OF_MODULUS if "young_modulus" in model.names else _LEAST_RATIO
        if not least < math.exp(float(np.mean(np.log(ratio)))) < 1.0 / least:
            what = f"the velocities are {np.min(ratio):.3g} to {np.max(ratio):.3g} times those of equal balls"
            mend = "Check the units of force and velocity, and that their columns are not swapped"
            raise InputError(message(what, mend=mend))
        part = np.ones(1) if data.sigma is None else np.ravel(data.sigma / data.velocity)
        if np.any(part <= _MODEL_ERROR):
            what = f"sigma is as small as {np.min(part):.3g} times the velocity"
            why = f"The velocities of a model have relative errors of {_MODEL_ERROR:g}, and no fit can be better"
            raise InputError(message(what, why, "Check the units of sigma, or give the errors that the data have"))
        if np.any(part >= 1.0 / _MODEL_ERROR):
            what = f"sigma is as large as {np.max(part):.3g} times the velocity"
            raise InputError(message(what, "No measurement has such an error", "Check its units"))
        if len(data.force) < len(model.names) + (data.sigma is None):
            several = "s" if len(data.force) > 1 else ""
            what = f"found {len(data.force)} measurement{several}, to which {' and '.join(model.names)} cannot be fitted"
            why = "Without sigma one more is needed, to find the scatter" if data.sigma is None else ""
            raise InputError(message(what, why, "Measure more"))
        return cls(model, data.velocity, np.ones(data.force.shape) * (1.0 if data.sigma is None else data.sigma))

    @property
    def dof(self) -> int:
        """Degrees of freedom of the residuals."""
        return len(self.velocity) - len(self.model.names)

    @property
    def widths(self) -> Array:
        """Widths to try, m, ascending; the packing's own is one of them."""
        force, packing = self.model.force, self.model.packing
        units = np.array([np.min(force) / _NARROWEST_AT, np.max(force) / _WIDEST_AT])
        low, high = packing.law.overlap(units)
        count = math.ceil(_TRIALS_PER_DECADE * math.log10(high / low)) + 1
        return np.unique(np.append(np.geomspace(low, high, count), max(packing.width, low)))

    def __call__(self, logs: Array) -> tuple[Array, Array]:
        """Return residuals (n,) and derivatives (n, p) of velocities, in units of sigma; InputError if there are none."""
        velocities, slopes = self.model(logs)
        return (self.velocity - velocities) / self.sigma, slopes * (velocities / self.sigma)[:, None]

    def simulate_at(self, logs: Array) -> FitProblem:
        """Return the problem whose samples are those at ``logs``: itself if they serve there.

        Raises :class:`~granphon.base.errors.InputError` for a width so small that the data do not determine it.
        """
        model, where = self.model.simulate_at(logs), self.model.width_index
        if model is self.model:
            return self
        if where is not None and logs[where] < math.log(self.widths[0]):
            raise explain_undetermined(self, logs, np.where(np.arange(len(logs)) == where, np.inf, 0.0))
        return replace(self, model=model)


def find_best(problem: FitProblem) -> tuple[FitProblem, Array]:
    """Find the logarithms (p,) of the parameters with the least sum of squares; the problem has the samples found there.

    For a simulation, the search starts from those of the effective medium. Else it starts from each width whose sum of
    squares is not above that of its neighbours; at each, one linear step brings the other parameters to their best. Widths
    so large that the medium refuses them are left out.
    """
    model, where = problem.model, problem.model.width_index
    if model.is_sampled:
        found = find_best(replace(problem, model=replace(model, choice=MediumChoice("ema"))))[1]
        problem = replace(problem, model=model.settle_geometry(found)).simulate_at(found)
        # the samples are simulated again until they belong to the minimum
        for _ in range(_MOST_SIMULATED):
            found = _descend(problem, found)
            again = problem.simulate_at(found)
            if again is problem:
                return problem, found
            problem = again
        names = " and ".join(model.names)
        what = (
            f"{names} still changed after {_MOST_SIMULATED} simulations, each of the packing that the one before has found"
        )
        mend = "Give the simulation more balls or samples, with a history a lower step_tolerance"
        raise InputError(message(what, "Forces of few balls jump when the width changes", mend))
    if where is None:
        return problem, _descend(problem, model.find_start(model.packing.width))
    others = np.arange(len(model.names)) != where
    starts: list[Array] = []
    squares, effect = [math.inf], 0.0
    for width in problem.widths.tolist():
        logs = model.find_start(width)
        try:
            residuals, matrix = problem(logs)
        except InputError:
            if not starts:  # even the narrowest width fails: the width is not the cause
                raise
            break
        step = np.linalg.lstsq(matrix[:, others], residuals, rcond=_SAME_EFFECT)[0]
        starts.append(logs)
        squares.append(float(np.sum((residuals - matrix[:, others] @ step) ** 2)))
        effect = max(effect, float(np.max(np.abs(matrix[:, where] / (problem.velocity / problem.sigma - residuals)))))
    if effect < _NO_EFFECT:
        what = f"in the medium {model.choice.label!r} sound does not depend on the width of this spread"
        if model.packing.structure.periods == 1:
            raise InputError(message(what, "On a line all contacts carry the same force", "Fit other parameters"))
        raise InputError(message(what, mend="Use another medium, such as ema, and a spread that has a shape"))
    squares.append(math.inf)
    low = [start for i, start in enumerate(starts, 1) if squares[i] <= min(squares[i - 1], squares[i + 1])]
    return problem, min((_descend(problem, start) for start in low), key=lambda logs: float(np.sum(problem(logs)[0] ** 2)))


def _descend(problem: FitProblem, start: Array) -> Array:
    """Find the minimum of the sum of squares that is reached from the logarithms ``start``."""
    from scipy.optimize import least_squares

    @lru_cache(maxsize=2)
    def system(move: tuple[float, ...]) -> tuple[Array, Array]:
        return problem(start + np.array(move))

    def residuals(move: Array) -> Array:
        try:
            return system(tuple(move.tolist()))[0]
        except InputError:  # an infinite residual makes the trust region shrink
            if not any(move):
                raise
            return np.full(problem.velocity.shape, np.inf)

    def jacobian(move: Array) -> Array:
        return -system(tuple(move.tolist()))[1]

    found = least_squares(residuals, np.zeros(start.shape), jacobian, ftol=1e-12, xtol=1e-11, gtol=1e-14, max_nfev=100)
    return np.asarray(start + found.x)


def find_covariance(problem: FitProblem, logs: Array, residuals: Array, matrix: Array) -> tuple[Array, Array]:
    """Return the covariance (p, p) of the logarithms, and the step (p,) to the minimum of the linear problem.

    :class:`~granphon.base.errors.InputError` if the data do not determine the parameters.
    """
    norms = np.linalg.norm(matrix, axis=0)
    left, singular, right = np.linalg.svd(matrix / np.maximum(norms, 1e-300), full_matrices=False)
    same = bool(np.all(norms > 0.0)) and singular[-1] < _SAME_EFFECT * singular[0]
    every = len(problem.model.names) == len(VARIABLE)  # no data can tell all three apart
    # if the others were known, the standard error of a parameter would be 1/norm
    where = problem.model.width_index
    vanishing = where is not None and logs[where] < math.log(problem.widths[0])
    if not (same and every) and (np.any(norms < 1.0) or vanishing):
        raise explain_undetermined(problem, logs, 1.0 / np.maximum(norms, 1e-300))
    if same:
        why = "The velocities of long waves depend on E/d and E d^(1/2) W^(3/2) only" if every else ""
        mend = "Measure over a wider range of force, or fit fewer parameters"
        raise InputError(message(f"the data cannot tell {' and '.join(problem.model.names)} apart", why, mend))
    root = (right / singular[:, None]).T / norms[:, None]
    return root @ root.T, root @ (left.T @ residuals)


def explain_undetermined(problem: FitProblem, logs: Array, errors: Array) -> InputError:
    """Return the error that says why the data do not determine the parameters; ``errors`` are those of the logarithms."""
    model, sigma, worst = problem.model, problem.sigma, int(np.argmax(errors))
    where = model.width_index
    if where is None:
        what = f"the data do not determine {' and '.join(model.names)}"
        why = f"The standard error of {model.names[worst]} is {errors[worst]:.3g} times its value"
        return InputError(message(what, why, _MEASURE))
    width, error = float(np.exp(logs[where])), float(errors[where])
    ideal = model.equal_balls(logs)[0]
    excess = float(np.average(problem.velocity / ideal - 1.0, weights=(ideal / sigma) ** 2))
    if model.names == ("width",) and excess > _NO_EFFECT:
        if model.waves.frequency is not None:
            long = replace(model.equal_balls, waves=replace(model.waves, frequency=None))(logs)[0]
            if np.average(problem.velocity / long - 1.0, weights=(ideal / sigma) ** 2) <= _NO_EFFECT:
                what = f"the velocities are on average {100.0 * excess:.2g} % above those of pulses of equal balls"
                why = f"They are not above those of long waves. {model.equal_balls.describe_nearest_to_top(logs)}"
                return InputError(message(what, why, "Check the frequency; leave it out for long waves"))
        what = f"the velocities are on average {100.0 * excess:.2g} % above those of equal balls"
        mend = "Check the Young modulus, diameter and density, or fit young_modulus as well"
        return InputError(message(what, "A spread of diameters slows sound, so that no width fits", mend))
    if model.names[worst] != "width" and errors[worst] > 1.0:
        what = f"the data do not determine {model.names[worst]}: its standard error is {errors[worst]:.3g} times its value"
        return InputError(message(what, mend=_MEASURE))
    if error > 1.0 or width < problem.widths[0]:
        best = f": the best is {write_quantity(width, 'm', 3)}, its standard error {write_quantity(error * width, 'm', 3)}"
        what = "the width cannot be told from zero" + (best if width > problem.widths[0] else "")
        least = float(np.min(model.force))
        why = f"Down to {least:.3g} N the data show no slowing of sound at low forces that exceeds their errors"
        return InputError(message(what, why, "Measure at lower forces, or more precisely"))
    falling = f"no width fits: the sum of squares still falls at {write_quantity(width, 'm', 3)}"
    tops = None if model.waves.frequency is None else model.find_tops(logs)
    if tops is not None and np.any(model.waves.frequency > _NEAR_TOP * tops):
        what = f"{falling}, beyond which the balls do not carry the frequency"
        return InputError(message(what, model.describe_nearest_to_top(logs), "Check the frequency and the velocities"))
    what = f"{falling}, beyond which the medium {model.choice.label!r} cannot be used"
    why = "The velocities are too low, or do not rise with the force as in an array of balls"
    return InputError(message(what, why, "Check the units of the data, the Young modulus, diameter and density"))
