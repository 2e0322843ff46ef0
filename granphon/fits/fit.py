"""Fit the width of the distribution of diameters to measured sound velocities, as Section IV finds
W = 2.04 um.

The logarithm of each parameter is fitted by least squares, starting from several widths, with exact
derivatives (:mod:`granphon.fits.velocity_model`). Residuals, leverages and standard errors then say
how far the fit can be trusted.
"""

from __future__ import annotations

import math
import os
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import lru_cache
from pathlib import Path
from typing import Any, ClassVar, Self

import numpy as np
from numpy.typing import ArrayLike

from granphon.balls.lattices import one_direction
from granphon.balls.packing import PARAMETERS, Packing, given_packing
from granphon.base.arrays import Array
from granphon.base.errors import InputError
from granphon.base.results import Result, held, result_class
from granphon.base.scales import write_quantity
from granphon.base.staging import write_texts
from granphon.base.tables import table_text
from granphon.base.text import counted, dump_yaml, require_path, versions
from granphon.base.validation import finite_array, real_array, require, texts, truth
from granphon.fits.measurements import Measurements
from granphon.fits.velocity_model import VARIABLE, VelocityModel, Waves, require_fitted
from granphon.media.choice import MediumChoice, require_finite_overlap
from granphon.observables.validity import validity

#: a result whose probability is below this, or for chi-squared also above 1 minus this, is not
#: explained by chance
LEAST_CHANCE = 1e-3
#: least probability of the chi-squared of all data but one with which that datum is judged by the
#: given sigma, not by the scatter
_CHANCE_OF_AGREEMENT = 0.05
#: a datum of more than this leverage decides the fit almost alone
_DECIDING_LEVERAGE = 0.9
#: standard errors above this part of their parameter are beyond linear theory
LARGE_ERROR = 0.5
#: scatter below this part of the rounding of the data tells nothing
_SCATTER_OF_ROUNDING = 0.1
#: data count as not rounded if their last decimal is below this part of the largest of them
_FINEST_ROUNDING = 1e-11
#: exponent of the least power of ten that has all digits of double precision
_LOWEST_POWER = -307
#: f* at the least force of the data for the narrowest width that is tried: disorder has no effect
#: there
_SCALED_FORCE_OF_LEAST_WIDTH = 1e4
#: f* at the greatest force of the data for the widest width that is tried
_SCALED_FORCE_OF_LARGEST_WIDTH = 1e-2
#: widths that are tried for each factor of ten
_TRIALS_PER_DECADE = 2
#: relative error of a model's velocities; a sigma below this part of a velocity, or above its
#: inverse, is a mistake
_MODEL_ERROR = 1e-12
#: a pulse whose frequency is above this part of the highest of its branch counts as near the end of
#: the branch
_END_OF_BRANCH = 0.98
#: a pulse whose wave is longer than this many diameters has its frequency in another unit: no array
#: of balls is as long
_LONGEST_WAVE = 1000.0
#: geometric mean of velocities, over those of equal balls, below which, or above whose inverse,
#: units are taken for wrong: no array in which a width can be found is so slow, and a unit off by a
#: thousand is beyond it
_LEAST_RATIO = 0.03
#: the least ratio where the Young modulus is fitted too, which may itself be far off
_LEAST_RATIO_OF_MODULUS = 1e-6
#: relative changes at which the search for a minimum ends, and the most evaluations of the model
#: that it takes
_TOLERANCES: dict[str, Any] = {"ftol": 1e-12, "xtol": 1e-11, "gtol": 1e-14}
_MOST_EVALUATIONS = 100
#: parameters whose effects differ by less than this part cannot be told apart
SAME_EFFECT = 1e-6
#: number of times that samples are simulated at the parameters found last, where they do not serve
#: all
_MOST_SIMULATED = 12
#: largest effect of the width on a velocity, d log v / d log W, and largest relative excess of a
#: velocity over that of equal balls, that count as zero
_NO_EFFECT = 1e-9
#: what stands for 1 - leverage, and for a chi-squared, where these vanish but for rounding and are
#: divided by
_LEAST_DIVISOR = 1e-12
#: what stands for the norm of a derivative that is zero, where the norm is divided by
_LEAST_NORM = 1e-300
#: a minimum is reached if the step that is left is below the first number times the standard error
#: of the parameter, plus the second, the relative precision of the search
_REMAINING_STEP = (1e-3, 1e-9)
#: how much wider, in relation, a width is at which is tried whether a medium refuses wider ones
_PROBE_OF_WIDTH = 1e-2
#: what rounding leaves between a matrix of correlations and its transpose, between its diagonal and
#: one, and below zero of its eigenvalues
_ROUNDING_OF_CORRELATIONS = 1e-9
#: advice where the data do not determine the parameters
_MEASURE = "Measure more precisely, over a wider range of force, or fit fewer parameters"


def compute_probability(chi2: float, dof: int) -> float:
    """Return the probability that errors of the given sigma make a sum of squares above ``chi2``,
    by the chi-squared distribution with ``dof`` degrees of freedom; nan if these are 0.
    """
    from scipy.special import chdtrc

    return float(chdtrc(dof, chi2)) if dof else math.nan


def judge_residuals(chi2: float, dof: int, parameters: int) -> list[str]:
    """Return a list with a warning if ``chi2``, the sum of (residual/sigma)^2, is so large or so
    small that errors of the given sigma hardly explain the value, or if there are no degrees of
    freedom, ``dof``, by which to judge the fit; an empty list otherwise.

    ``parameters`` is the number of fitted parameters.
    """
    if dof == 0:
        fault = f"as many data as fitted parameters ({parameters}) leave 0 degrees of freedom"
        return [f"{fault}: nothing can be said of how well the model fits"]
    p = compute_probability(chi2, dof)
    if LEAST_CHANCE <= p <= 1.0 - LEAST_CHANCE:
        return []
    if p < LEAST_CHANCE:
        why = "the model does not fit, or sigma is too small"
    else:
        why = "sigma is too large, or the errors are not independent"
    return [
        f"the residuals are {math.sqrt(chi2 / dof):.3g} times what sigma says (chi^2 is"
        f" {chi2:.4g} for {counted(dof, 'degree')} of freedom, p = {p:.2g}): {why}"
    ]


def compute_leverages(matrix: Array) -> Array:
    """Return the leverage (n,) of each datum, from 0 to 1, which says how far the fit follows the
    datum: the diagonal of A (A^T A)^-1 A^T, of which A (n, p) is the ``matrix`` of the derivatives.
    The leverages sum to p.
    """
    directions, _ = np.linalg.qr(matrix / np.linalg.norm(matrix, axis=0))
    return np.asarray(np.sum(directions**2, axis=1))


def find_rounding(values: Array) -> float:
    """Return the unit of the last decimal of ``values`` (n,), one or more, all finite and above
    zero: the largest power of ten of which all values are multiples; 1e-11 of the largest value if
    they have more decimals, or are all below 1e-307.
    """
    largest = float(np.max(values))
    highest = math.floor(math.log10(largest))
    lowest = math.floor(math.log10(largest) + math.log10(_FINEST_ROUNDING))
    # lower powers of ten do not have all digits of double precision
    for power in range(highest, max(lowest, _LOWEST_POWER - 1), -1):
        steps = values / 10.0**power
        # a decimal number in double precision, and the division, are rounded
        if np.all(np.abs(steps - np.rint(steps)) <= 4.0 * np.finfo(float).eps * steps):
            return 10.0**power
    return _FINEST_ROUNDING * largest


def find_warnings(
    problem: FitProblem, logs: Array, errors: Array, sigma_given: bool, has_known_errors: bool
) -> list[str]:
    """Return the reasons not to trust a fit.

    Parameters
    ----------
    problem, logs : the problem, and the logarithms (p,) of the fitted parameters.
    errors : relative standard errors of the parameters, (p,).
    sigma_given : whether sigma was given, rather than found from the scatter.
    has_known_errors : whether standard errors rest on more than the rounding of the data.
    """
    names = problem.model.names
    dof = problem.dof
    residuals, matrix = problem(logs)
    leverages = compute_leverages(matrix)
    # sigma from the scatter is such that chi^2 is the number of degrees of freedom
    chi2 = float(residuals @ residuals) if sigma_given else float(dof)
    warnings = list[str]()
    if sigma_given or not dof:
        warnings += judge_residuals(chi2, dof, len(names))
    elif not has_known_errors:
        warnings.append(
            f"the scatter about the fit, {float(problem.sigma[0]):.2g} m/s, is below the rounding"
            f" of the data, {find_rounding(problem.velocity):.2g} m/s: standard errors are not"
            f" known; give sigma"
        )
    if "width" in names and dof:
        warnings += _judge_excess(problem, logs, sigma_given=sigma_given)
    warnings += _judge_waves(problem)
    if dof:
        warnings += _judge_leverage(problem, leverages)
    if has_known_errors and dof > 1:
        warnings += _judge_farthest(problem, residuals, leverages, chi2, sigma_given=sigma_given)
    if has_known_errors:
        warnings += [
            f"the standard error of {name} is {error:.2g} of its value: it can hardly be told from"
            f" zero"
            for name, error in zip(names, errors.tolist(), strict=True)
            if error > LARGE_ERROR
        ]
    return warnings


def _judge_waves(problem: FitProblem) -> list[str]:
    """Return a list with a warning if the wave of a pulse of the ``problem``, velocity over
    frequency, is longer than any array of balls, an empty one otherwise, and for long waves, which
    have no frequency.
    """
    frequency = problem.model.waves.frequency
    if frequency is None:
        return []
    wavelength = problem.velocity / frequency
    diameters = wavelength / problem.model.packing.diameter  # length of each wave in diameters
    longest = int(np.argmax(diameters))
    if diameters[longest] <= _LONGEST_WAVE:
        return []
    hertz = np.broadcast_to(frequency, problem.velocity.shape)[longest]
    length = f"{wavelength[longest]:.3g} m long, {diameters[longest]:.3g} diameters"
    fault = f"the wave of a pulse at {hertz:.4g} Hz is {length}"
    return [f"{fault}: its velocity is that of long waves. Is the frequency in Hz?"]


def _judge_leverage(problem: FitProblem, leverages: Array) -> list[str]:
    """Return a list with a warning if one datum of the ``problem`` decides the fit almost alone, an
    empty one otherwise; ``leverages`` (n,) are those of the data.
    """
    datum = int(np.argmax(leverages))
    if leverages[datum] <= _DECIDING_LEVERAGE:
        return []
    return [
        f"{problem.describe(datum)}, decides the fit almost alone: its leverage is"
        f" {leverages[datum]:.4g}, and cannot be above 1"
    ]


def _judge_excess(problem: FitProblem, logs: Array, *, sigma_given: bool) -> list[str]:
    """Return a list with a warning if data are above the velocity of equal balls by more than their
    noise, which no width explains, an empty one otherwise; ``logs`` are the logarithms (p,) of the
    fitted parameters, and ``sigma_given`` says whether the sigma of the ``problem`` was given.
    """
    from scipy.special import ndtr, stdtr

    velocity = problem.velocity
    equal_balls, _ = problem.model.equal_balls(logs)  # velocities (n,), m/s
    excess = velocity / equal_balls - 1.0
    # Data above equal balls bend the fit, so that the scatter about the fit does not measure their
    # noise; and a given sigma may be too small. The noise of neighbours has neither fault.
    noise = _find_noise(problem.model.force, velocity)
    if sigma_given:
        chances = ndtr(-excess / np.maximum(problem.sigma / equal_balls, noise))
    else:
        chances = stdtr(problem.dof, -excess / noise)
    # the more data there are, the more likely one of them is above by chance
    is_above = (excess > _NO_EFFECT) & (chances < LEAST_CHANCE / len(excess))
    count = np.count_nonzero(is_above)
    if not count:
        return []
    highest = int(np.argmax(excess))
    verb = "is" if count == 1 else "are"
    fault = f"{count} of {len(excess)} data {verb} above the velocity of equal balls at that load"
    amount = f"by up to {100.0 * excess[highest]:.2g} % ({problem.describe(highest)})"
    why = "a spread only slows sound, so that what is fitted is not a width"
    mend = "Check the Young modulus, diameter and density, or fit young_modulus as well"
    return [f"{fault}, {amount}: {why}. {mend}"]


def _find_noise(force: Array, velocity: Array) -> float:
    """Return the relative noise of a single velocity, estimated from velocities (n,), m/s, at
    forces (n,), N: from the rms distance of the logarithm of each velocity from the straight line
    through its two neighbours in force.

    The noise is rounding at least, and infinite for fewer than three data.
    """
    order = np.lexsort((velocity, force))
    log_force = np.log(force[order])
    log_velocity = np.log(velocity[order])
    # the position (n - 2,) of each datum between its two neighbours is 0 at the lower force, 1 at
    # the higher, and 1/2 where all three forces are equal
    gap_of_neighbours = log_force[2:] - log_force[:-2]
    are_apart = gap_of_neighbours > 0.0
    gap_below = log_force[1:-1] - log_force[:-2]
    position = np.where(are_apart, gap_below / np.where(are_apart, gap_of_neighbours, 1.0), 0.5)
    distances = (
        log_velocity[1:-1] - (1.0 - position) * log_velocity[:-2] - position * log_velocity[2:]
    )
    if not distances.size:
        return math.inf
    variance_of_distance = 1.0 + position**2 + (1.0 - position) ** 2
    mean_square = float(np.mean(distances**2 / variance_of_distance))
    return max(math.sqrt(mean_square), float(np.finfo(float).eps))


def _judge_farthest(
    problem: FitProblem, residuals: Array, leverages: Array, chi2: float, *, sigma_given: bool
) -> list[str]:
    """Return a list with a warning if one datum is off the fit of the others, an empty one
    otherwise: by the given sigma where the others agree with theirs, else by the scatter of the
    others. The problem has two degrees of freedom or more.

    ``residuals`` (n,) are over sigma, ``chi2`` is the sum of their squares, and ``leverages`` (n,)
    say how far the fit follows each datum; ``sigma_given`` is that of :func:`find_warnings`.
    """
    from scipy.special import ndtr, stdtr

    dof = problem.dof
    # the distance of each datum from the fit of the others, over the standard error of the
    # distance: residual/(1 - leverage)^1/2
    distances = np.abs(residuals) / np.sqrt(np.maximum(1.0 - leverages, _LEAST_DIVISOR))
    farthest = int(np.argmax(distances))
    distance = float(distances[farthest])
    # what chi-squared of the others is about their own fit, which the datum does not bend
    chi2_of_others = max(chi2 - distance**2, _LEAST_DIVISOR)
    others_agree = compute_probability(chi2_of_others, dof - 1) >= _CHANCE_OF_AGREEMENT
    if sigma_given and others_agree:
        tail = float(ndtr(-distance))
    else:  # judged by the scatter of the others: Student's distribution
        distance *= math.sqrt((dof - 1) / chi2_of_others)
        tail = float(stdtr(dof - 1, -distance))
    chance = min(2.0 * len(distances) * tail, 1.0)  # any of the data may be the farthest
    if chance >= LEAST_CHANCE:
        return []
    return [
        f"{problem.describe(farthest)}, lies {distance:.3g} standard errors off the fit of the"
        f" others (p = {chance:.2g})"
    ]


@dataclass(frozen=True)
class FitProblem:
    """Measured velocities and the model that is fitted to them.

    ``velocity`` and ``sigma``, its standard error, are (n,), m/s; a sigma that is not given is 1
    m/s until the scatter is known. Call the problem with the logarithms (p,) of the model's
    parameters to get residuals and derivatives.
    """

    model: VelocityModel
    velocity: Array
    sigma: Array

    @classmethod
    def of(cls, model: VelocityModel, data: Measurements) -> Self:
        """Return the problem of a ``model`` and its ``data``;
        :class:`~granphon.base.errors.InputError` if the data cannot be right, or are too few.
        """
        model.require_carried()
        _require_units(model, data.velocity)
        relative_error = np.ones(1) if data.sigma is None else np.ravel(data.sigma / data.velocity)
        _require_plausible_errors(relative_error)
        _require_enough(model.names, len(data.force), sigma_given=data.sigma is not None)
        sigma = 1.0 if data.sigma is None else data.sigma
        return cls(model, data.velocity, np.ones(data.force.shape) * sigma)

    def describe(self, number: int) -> str:
        """Return in words which datum has the index ``number``, with its velocity and force."""
        velocity = self.velocity[number]
        force = self.model.force[number]
        return f"datum {number + 1}, {velocity:.4g} m/s at {force:.4g} N"

    @property
    def dof(self) -> int:
        """Degrees of freedom of the residuals."""
        return len(self.velocity) - len(self.model.names)

    @property
    def widths(self) -> Array:
        """Widths (w,), m, ascending, from which the search starts: from a width at which disorder
        has no effect on the data to one at which it dominates them. The packing's own width is one
        of them, unless it is narrower than all others.
        """
        force = self.model.force
        packing = self.model.packing
        forces = np.array(
            [
                np.min(force) / _SCALED_FORCE_OF_LEAST_WIDTH,
                np.max(force) / _SCALED_FORCE_OF_LARGEST_WIDTH,
            ]
        )
        low, high = packing.law.overlap(forces)
        count = math.ceil(_TRIALS_PER_DECADE * math.log10(high / low)) + 1
        return np.unique(np.append(np.geomspace(low, high, count), max(packing.width, low)))

    def __call__(self, logs: Array) -> tuple[Array, Array]:
        """Return residuals (n,), measured less fitted, and derivatives (n, p) of the fitted
        velocities by the logarithms ``logs`` (p,) of the parameters, both in units of sigma;
        InputError if the packing, or the medium at one of the forces, does not exist there.
        """
        velocities, slopes = self.model(logs)
        # derivatives of logarithms, times the velocities in units of sigma
        derivatives = slopes * (velocities / self.sigma)[:, None]
        return (self.velocity - velocities) / self.sigma, derivatives

    def simulate_at(self, logs: Array) -> FitProblem:
        """Return the problem whose samples are those at ``logs``: itself if its own samples serve
        there.

        Raises :class:`~granphon.base.errors.InputError` for a width so small that the data do not
        determine it.
        """
        model = self.model.simulate_at(logs)
        if model is self.model:
            return self
        index = self.model.width_index
        if index is not None and logs[index] < math.log(self.widths[0]):
            # the error of the width alone is without bound, as the data do not determine it
            errors = np.where(np.arange(len(logs)) == index, np.inf, 0.0)
            raise explain_undetermined(self, logs, errors)
        return replace(self, model=model)


def find_best(problem: FitProblem) -> tuple[FitProblem, Array]:
    """Return the problem, of a simulation with the samples at the minimum, and the logarithms (p,)
    of the parameters with the least sum of squares.

    For a simulation, the search starts from the best parameters in the effective medium; for
    another medium, if the width is not fitted, from those of the packing. Otherwise the search
    starts from each width whose sum of squares is not above that of its neighbours, with the other
    parameters of the packing; the sums compared are those to which one linear step of the other
    parameters leads. Widths so large that the medium refuses them are left out.

    Raises :class:`~granphon.base.errors.InputError` as :func:`_find_best_of_samples` and
    :func:`_try_widths` do, and where the medium refuses the start.
    """
    model = problem.model
    if model.is_sampled:
        return _find_best_of_samples(problem)
    if model.width_index is None:
        return problem, _descend(problem, model.find_start(model.packing.width))
    starts, squares = _try_widths(problem, model.width_index)
    # beyond the first and the last width the sum of squares counts as infinite
    squares_with_ends = [math.inf, *squares, math.inf]
    minima = []
    for trial, start in enumerate(starts):
        below, square, above = squares_with_ends[trial : trial + 3]
        if square <= min(below, above):
            minima.append(_descend(problem, start))

    def sum_squares(logs: Array) -> float:
        """Return the sum of squared residuals, over sigma, at these logarithms (p,)."""
        residuals, _ = problem(logs)
        return float(np.sum(residuals**2))

    return problem, min(minima, key=sum_squares)


def _find_best_of_samples(problem: FitProblem) -> tuple[FitProblem, Array]:
    """Return the problem with its last samples, and the logarithms (p,) of the parameters at the
    minimum, for a simulation: samples are simulated again until they belong to the minimum.

    Raises :class:`~granphon.base.errors.InputError` if the minimum still moves after a dozen
    simulations, or has a width that the data do not determine.
    """
    model = problem.model
    medium_problem = replace(problem, model=replace(model, choice=MediumChoice("ema")))
    _, best = find_best(medium_problem)
    problem = replace(problem, model=model.settle_geometry(best)).simulate_at(best)
    for _ in range(_MOST_SIMULATED):
        best = _descend(problem, best)
        renewed_problem = problem.simulate_at(best)
        if renewed_problem is problem:  # its samples serve for the minimum too
            return problem, best
        problem = renewed_problem
    names = " and ".join(model.names)
    fault = f"{names} still changed after {_MOST_SIMULATED} simulations"
    mend = "Take more balls or samples, and with a history a lower step_tolerance"
    raise InputError(fault, "Forces of few balls jump when the width changes", mend)


def _try_widths(problem: FitProblem, index: int) -> tuple[list[Array], list[float]]:
    """Return the logarithms (p,) of the parameters of a ``problem`` at each width that is tried,
    and the sum of squares to which one linear step brings the other parameters; ``index`` is that
    of the width.

    Raises :class:`~granphon.base.errors.InputError` if velocities do not depend on the width, or
    the medium refuses the least width.
    """
    is_not_width = np.arange(len(problem.model.names)) != index
    starts: list[Array] = []
    squares: list[float] = []
    effect = 0.0  # the greatest d log v / d log W at any datum and width
    for width in problem.widths.tolist():
        logs = problem.model.find_start(width)
        try:
            residuals, matrix = problem(logs)
        except InputError:
            if not starts:  # even the narrowest width fails: the width is not the cause
                raise
            break
        derivatives = matrix[:, is_not_width]
        step, *_ = np.linalg.lstsq(derivatives, residuals, rcond=SAME_EFFECT)
        starts.append(logs)
        squares.append(float(np.sum((residuals - derivatives @ step) ** 2)))
        # velocities of the model in units of sigma, as the derivatives are
        scaled_velocities = problem.velocity / problem.sigma - residuals
        effect = max(effect, float(np.max(np.abs(matrix[:, index] / scaled_velocities))))
    if effect < _NO_EFFECT:
        raise _explain_no_effect(problem.model)
    return starts, squares


def _explain_no_effect(model: VelocityModel) -> InputError:
    """Return the error that says that the velocities of a ``model`` do not depend on the width."""
    fault = (
        f"in the medium {model.choice.label!r} sound does not depend on the width of this spread"
    )
    if model.packing.structure.periods == 1:
        return InputError(
            fault,
            "On a line all contacts carry the same force",
            "Fit young_modulus without the width",
        )
    return InputError(fault, mend="Use another medium, such as ema, and a spread that has a shape")


def _descend(problem: FitProblem, start: Array) -> Array:
    """Return the logarithms (p,) of the parameters at the minimum of the sum of squares of a
    ``problem`` that is reached from ``start`` (p,).

    A search that ends at the greatest number of evaluations is accepted: whether its end is a
    minimum is found where the standard errors are (:func:`_find_covariance`). InputError if the
    medium refuses the start; where it refuses other places, the search goes around them.
    """
    from scipy.optimize import least_squares

    # scipy asks for residuals and derivatives one after the other: both are found at once
    @lru_cache(maxsize=2)
    def evaluate(move: tuple[float, ...]) -> tuple[Array, Array]:
        """Return the residuals (n,), and the derivatives (n, p) of the model over sigma, at a
        ``move`` (p,) from the start; a tuple can be the key of a cache.
        """
        return problem(start + np.array(move))

    def residuals(move: Array) -> Array:
        """Return the residuals (n,) at a ``move`` (p,) from the start."""
        try:
            residuals_there, _ = evaluate(tuple(move.tolist()))
            return residuals_there
        except InputError:
            if not any(move):  # there is no trust region yet: the start itself is refused
                raise
            # an infinite residual makes the trust region shrink
            return np.full(problem.velocity.shape, np.inf)

    def jacobian(move: Array) -> Array:
        """Return the derivatives (n, p) of the residuals at a ``move`` (p,) from the start."""
        _, slopes_of_model = evaluate(tuple(move.tolist()))
        # a residual is measured less fitted: it falls where the model rises
        return -slopes_of_model

    minimum = least_squares(
        residuals, np.zeros(start.shape), jacobian, **_TOLERANCES, max_nfev=_MOST_EVALUATIONS
    )
    return np.asarray(start + minimum.x)


def explain_undetermined(problem: FitProblem, logs: Array, errors: Array) -> InputError:
    """Return the error that says why the data do not determine the parameters: ``logs`` are their
    logarithms (p,), ``errors`` the standard errors (p,) of these, which are relative errors.
    """
    model = problem.model
    worst = int(np.argmax(errors))
    index = model.width_index
    if index is None:
        fault = f"the data do not determine {' and '.join(model.names)}"
        why = f"The standard error of {model.names[worst]} is {errors[worst]:.3g} times its value"
        return InputError(fault, why, _MEASURE)
    if model.names == ("width",):
        excess_error = _explain_excess(problem, logs)
        if excess_error is not None:
            return excess_error
    if model.names[worst] != "width" and errors[worst] > 1.0:
        fault = (
            f"the data do not determine {model.names[worst]}: its standard error is"
            f" {errors[worst]:.3g} times its value"
        )
        return InputError(fault, mend=_MEASURE)
    width = float(np.exp(logs[index]))
    error = float(errors[index])
    if error > 1.0 or width < problem.widths[0]:
        return _explain_no_width(problem, width, error)
    return _explain_widest(problem, logs, width)


def _explain_excess(problem: FitProblem, logs: Array) -> InputError | None:
    """Return the error that says that velocities are above those of equal balls on average; None if
    they are not. ``logs`` are the logarithms (p,) of the parameters.
    """
    model = problem.model
    equal_balls, _ = model.equal_balls(logs)  # velocities (n,), m/s
    weights = (equal_balls / problem.sigma) ** 2  # inverse variances of the relative excess
    excess = float(np.average(problem.velocity / equal_balls - 1.0, weights=weights))
    if excess <= _NO_EFFECT:
        return None
    fault_start = f"the velocities are on average {100.0 * excess:.2g} % above those"
    if model.waves.frequency is not None:
        long_wave_model = replace(model.equal_balls, waves=replace(model.waves, frequency=None))
        long_waves, _ = long_wave_model(logs)
        excess_over_long = np.average(problem.velocity / long_waves - 1.0, weights=weights)
        if excess_over_long <= _NO_EFFECT:
            why = (
                f"They are not above those of long waves."
                f" {model.equal_balls.describe_nearest_to_top(logs)}"
            )
            mend = "Check the frequency; leave it out for long waves"
            return InputError(f"{fault_start} of pulses of equal balls", why, mend)
    mend = "Check the Young modulus, diameter and density, or fit young_modulus as well"
    why = "A spread of diameters slows sound, so that no width fits"
    return InputError(f"{fault_start} of equal balls", why, mend)


def _explain_no_width(problem: FitProblem, width: float, error: float) -> InputError:
    """Return the error that says that the best ``width``, m, cannot be told from zero; ``error`` is
    its relative standard error.
    """
    fault = "the width cannot be told from zero"
    if width > problem.widths[0]:
        fault += (
            f": the best is {write_quantity(width, 'm', 3)}, its standard error"
            f" {write_quantity(error * width, 'm', 3)}"
        )
    lowest_force = float(np.min(problem.model.force))
    why = (
        f"Down to {lowest_force:.3g} N the data show no slowing of sound at low forces that exceeds"
        f" their errors"
    )
    return InputError(fault, why, "Measure at lower forces, or more precisely")


def _explain_widest(problem: FitProblem, logs: Array, width: float) -> InputError:
    """Return the error that says that the sum of squares still falls at the widest ``width``, m,
    that can be computed; ``logs`` are the logarithms (p,) of the parameters there.
    """
    model = problem.model
    fault_start = (
        f"no width fits: the sum of squares still falls at {write_quantity(width, 'm', 3)}"
    )
    frequency = model.waves.frequency
    tops = None if frequency is None else model.find_tops(logs)
    if tops is not None and np.any(frequency > _END_OF_BRANCH * tops):
        fault = f"{fault_start}, beyond which the balls do not carry the frequency"
        return InputError(
            fault, model.describe_nearest_to_top(logs), "Check the frequency and the velocities"
        )
    fault = f"{fault_start}, beyond which the medium {model.choice.label!r} cannot be used"
    why = "The velocities are too low, or do not rise with the force as in an array of balls"
    return InputError(
        fault, why, "Check the units of the data, the Young modulus, diameter and density"
    )


def _require_units(model: VelocityModel, velocity: Array) -> None:
    """Raise InputError if velocities (n,), m/s, are so far from those of equal balls that a unit is
    wrong.
    """
    start = model.find_nearly_equal()
    with np.errstate(all="ignore"):  # a ratio beyond all floats is refused below
        equal_balls, _ = model.equal_balls(start)
        ratio = velocity / equal_balls
    least_ratio = _LEAST_RATIO_OF_MODULUS if "young_modulus" in model.names else _LEAST_RATIO
    mean_ratio = math.exp(float(np.mean(np.log(ratio))))
    if least_ratio < mean_ratio < 1.0 / least_ratio:
        return
    fault = (
        f"the velocities are {np.min(ratio):.3g} to {np.max(ratio):.3g} times those of equal balls"
    )
    mend = "Check the units of force and velocity, and that their columns are not swapped"
    raise InputError(fault, mend=mend)


def _require_plausible_errors(relative_error: Array) -> None:
    """Raise InputError for a ``relative_error``, standard errors over velocities, (n,) or (1,),
    that no measurement has.
    """
    if np.any(relative_error <= _MODEL_ERROR):
        fault = f"sigma is as small as {np.min(relative_error):.3g} times the velocity"
        why = f"Those of a model have relative errors of {_MODEL_ERROR:g}"
        raise InputError(
            fault, why, "Check the units of sigma, or give the errors that the data have"
        )
    if np.any(relative_error >= 1.0 / _MODEL_ERROR):
        fault = f"sigma is as large as {np.max(relative_error):.3g} times the velocity"
        raise InputError(fault, "No measurement has such an error", "Check its units")


def _require_enough(names: Sequence[str], count: int, *, sigma_given: bool) -> None:
    """Raise InputError if the ``count`` of measurements is too small for the parameters ``names``.

    Each parameter takes one measurement; unless ``sigma_given`` the scatter takes one more.
    """
    n_needed = len(names) if sigma_given else len(names) + 1
    if count >= n_needed:
        return
    measurements = counted(count, "measurement")
    fault = f"found {measurements}, to which {' and '.join(names)} cannot be fitted"
    why = "" if sigma_given else "Without sigma one more is needed, to find the scatter"
    raise InputError(fault, why, "Measure more, or fit fewer parameters")


class Fitted(Result):
    """A fit: what follows from the covariance of the fitted parameters, and from the sum of
    squares; its files.
    """

    #: the SI unit of each parameter that may be fitted; None of a number
    _units_of_parameters: ClassVar[Mapping[str, str | None]]
    #: attributes that fit.yaml has before the fields of the fit, besides versions, by name: they
    #: follow from the fields, and are ignored when a fit is read
    _head: ClassVar[tuple[str, ...]] = ("p",)

    parameters: tuple[str, ...]
    covariance: Array
    sigma_given: bool
    chi2: float
    dof: int

    @property
    def units_of_values(self) -> list[str]:
        """SI unit of each parameter, (p,); "1" of a number."""
        return [self._units_of_parameters[name] or "1" for name in self.parameters]

    @property
    def stderrs(self) -> Array:
        """Standard error of each parameter, (p,), SI; nan where the errors are not known."""
        return np.sqrt(np.diag(self.covariance))

    @property
    def correlation(self) -> Array:
        """Correlations (p, p) of the errors of the parameters, from -1 to 1; nan where the errors
        are not known.
        """
        return np.asarray(self.covariance / np.outer(self.stderrs, self.stderrs))

    def with_input_errors(self, changes: ArrayLike, correlation: ArrayLike) -> Self:
        """Return the fit whose covariance holds the standard errors of inputs too, to first order.

        ``changes`` (inputs, p) are by how much the values change when each of the inputs is larger
        by its standard error, and ``correlation`` (inputs, inputs) the correlations of the inputs.

        Raises :class:`~granphon.base.errors.InputError` for arrays of other shapes, for no inputs,
        for numbers that are not finite, and for what is no matrix of correlations.
        """
        changes_of_values = finite_array("changes", changes)
        n_parameters = len(self.covariance)
        if changes_of_values.ndim != 2 or changes_of_values.shape[1] != n_parameters:
            fault = f"changes have the shape {changes_of_values.shape}"
            raise InputError(fault, mend=f"Give (inputs, {n_parameters})")
        correlations = _read_correlations(correlation, len(changes_of_values))
        from_inputs = changes_of_values.T @ correlations @ changes_of_values
        fields: dict[str, Any] = {"covariance": self.covariance + from_inputs}
        return replace(self, **fields)

    @property
    def p(self) -> float:
        """Probability that errors of the given sigma make a larger ``chi2``.

        If sigma and the model are right, all values from 0 to 1 are equally likely. nan with no
        degrees of freedom, or with sigma from the scatter.
        """
        return compute_probability(self.chi2, self.dof) if self.sigma_given else math.nan

    def _field_units(self) -> dict[str, str]:
        """Return the SI units of the fields by name; those of ``values`` are separated by commas,
        the rows of ``covariance``, products of two units, by semicolons.
        """
        units = self.units_of_values
        rows = []
        for unit in units:
            products = [f"{unit}^2" if unit == factor else f"{unit} {factor}" for factor in units]
            rows.append(", ".join(products))
        return super()._field_units() | {"values": ", ".join(units), "covariance": "; ".join(rows)}

    @classmethod
    def from_dict(cls, data: Mapping[str, Any]) -> Self:
        """Build a fit from plain data, SI; the keys that stand in fit.yaml before the fields are
        ignored.
        """
        if isinstance(data, Mapping):
            ignored = ("versions", *cls._head)
            data = {name: value for name, value in data.items() if name not in ignored}
        return super().from_dict(data)

    def _check(self) -> None:
        """Raise InputError also unless the fit has one or more parameters, each at most once, that
        may be fitted.
        """
        super()._check()
        require_fitted(self.parameters, self._units_of_parameters)

    def _list_columns(self) -> dict[str, Any]:
        """Return the columns of fit.csv, (n,), by their headings."""
        raise NotImplementedError

    def write(self, folder: str | os.PathLike[str]) -> None:
        """Write fit.yaml, the whole fit, and fit.csv, the data with the fit, into a ``folder``,
        which is made if need be: both, or neither where one of them is refused. The files of an
        earlier fit are replaced if its fit.csv has the same columns.

        Raises :class:`~granphon.base.errors.InputError` for what is no path,
        :class:`~granphon.base.errors.FileExistsInRunError` if other files of these names are there,
        such as a fit.csv with other columns, and :class:`~granphon.base.errors.OutputError` if the
        file system refuses a file.
        """
        require_path(folder)
        head: dict[str, Any] = {"versions": versions("numpy", "scipy")}
        for name in self._head:
            head[name] = getattr(self, name)
        text_of_fit = dump_yaml(head | self.to_dict())
        columns = self._list_columns()
        rows = np.stack(list(columns.values()), axis=1).tolist()
        text_of_data = table_text(columns, rows)
        target = Path(folder)
        write_texts([(target / "fit.yaml", text_of_fit), (target / "fit.csv", text_of_data)])


def _read_correlations(correlation: ArrayLike, n_inputs: int) -> Array:
    """Return the matrix (n_inputs, n_inputs) of a ``correlation`` of inputs; InputError for another
    shape, and for numbers that no correlations have.
    """
    matrix = finite_array("correlation", correlation)
    if matrix.shape != (n_inputs, n_inputs):
        fault = f"correlation has the shape {matrix.shape}"
        raise InputError(fault, mend=f"Give {(n_inputs, n_inputs)}")
    asymmetry = float(np.max(np.abs(matrix - matrix.T)))
    error_of_diagonal = float(np.max(np.abs(np.diag(matrix) - 1.0)))
    smallest_eigenvalue = float(np.linalg.eigvalsh(matrix)[0])
    if max(asymmetry, error_of_diagonal, -smallest_eigenvalue) > _ROUNDING_OF_CORRELATIONS:
        fault = "correlation is no matrix of correlations"
        why = "That is symmetric, with ones on its diagonal and no eigenvalue below zero"
        raise InputError(fault, why, "Give np.eye(n) for n independent inputs")
    return matrix


@result_class
class WidthFit(Fitted):
    """Parameters of a packing that fit measured velocities, and how well they are known.

    Attributes
    ----------
    packing : with the fitted parameters.
    choice : the medium that models the packing.
    waves : which waves were measured.
    parameters, values : names (p,) and SI values (p,) of the fitted parameters.
    covariance : covariance (p, p) of their errors, SI; nan if they are unknown, as the scatter is
        below the rounding of the data.
    force, velocity : the data, (n,), N and m/s.
    sigma : standard error of each velocity, (n,), m/s: as given, or from the scatter, (sum of
        residuals^2 / dof)^(1/2).
    sigma_given : whether sigma was given.
    velocities : velocities of the fit at these forces, (n,), m/s.
    chi2 : sum of (residual/sigma)^2, which equals ``dof`` where sigma is from the scatter.
    dof : degrees of freedom, n - p.
    warnings : reasons not to trust the fit.
    """

    units = {"width": "m", "stderr": "m", "std": "m", "std_stderr": "m", "p": "1"}
    _notebook_fields = ("width", "stderr")
    _units_of_parameters = {name: PARAMETERS[name] for name in VARIABLE}
    _head = ("medium", "width", "stderr", "std", "std_stderr", "p")

    packing: Packing = held(Packing)
    choice: MediumChoice = held(MediumChoice)
    waves: Waves = held(Waves)
    parameters: tuple[str, ...] = held((str, ...), "p")
    values: Array = held(float, "p")
    covariance: Array = held(float, "p p")
    force: Array = held(float, "n", "N")
    velocity: Array = held(float, "n", "m/s")
    sigma: Array = held(float, "n", "m/s")
    sigma_given: bool = held(bool)
    velocities: Array = held(float, "n", "m/s")
    chi2: float = held(float)
    dof: int = held(int)
    warnings: tuple[str, ...] = held((str, ...))

    @property
    def width(self) -> float:
        """Width W of the distribution of diameters, m; the packing's own if it was not fitted."""
        if "width" not in self.parameters:
            return self.packing.width
        return float(self.values[self.parameters.index("width")])

    @property
    def stderr(self) -> float:
        """Standard error of the width, m; 0 if it was not fitted, nan if it is not known."""
        if "width" not in self.parameters:
            return 0.0
        return float(self.stderrs[self.parameters.index("width")])

    @property
    def errors_are_known(self) -> bool:
        """Whether the standard errors rest on more than the rounding of the data; where not, they
        are nan.
        """
        return bool(np.all(np.isfinite(self.covariance)))

    @property
    def std(self) -> float:
        """Standard deviation of the fitted distribution of diameters, W/sqrt(12), m. Of a normal
        distribution it is that of the diameters within the cutoff, which is below the ``std`` of
        :class:`granphon.Normal`.
        """
        return self.width / math.sqrt(12.0)

    @property
    def std_stderr(self) -> float:
        """Standard error of :attr:`std`, m."""
        return self.stderr / math.sqrt(12.0)

    @property
    def residuals(self) -> Array:
        """Measured less fitted velocity, (n,), m/s."""
        return self.velocity - self.velocities

    @property
    def medium(self) -> str:
        """The label of the medium: its name, with the options that are not the defaults."""
        return self.choice.label

    @property
    def is_isotropic(self) -> bool:
        """Whether long waves in the lattice have the same velocities in all directions; of the
        lattice alone, whatever the medium of the fit.
        """
        # no load changes this, and the averaged lattice is known at every force, as the effective
        # medium is not
        state = MediumChoice("ala").of(self.packing).at_force(float(self.force[0]))
        return bool(state.is_isotropic)

    def velocity_at(self, force: ArrayLike, medium: str | None = None) -> Any:
        """Return the velocity of the fitted packing, m/s, at another ``force``, N, a number or an
        array (...), in its shape; in another ``medium`` if one is named. Of equal balls every
        medium is the averaged lattice.

        Raises :class:`~granphon.base.errors.InputError` if the measured pulses have one frequency
        each, for forces or a medium that do not fit the packing, and for what is no medium.
        """
        if np.ndim(self.waves.frequency):
            mend = "Use .velocities, the velocities of the fit at the data"
            raise InputError("the measured pulses have many frequencies", mend=mend)
        choice = self.choice if medium is None else MediumChoice.parse(medium)
        if not self.packing.width:
            choice = MediumChoice("ala")
        # samples in their exact geometry always have finite overlap, which is no request for other
        # media
        requested = self.waves.finite_overlap and not self.choice.is_exact
        has_finite_overlap = choice.has_finite_overlap(self.packing, requested)
        waves = replace(self.waves, finite_overlap=has_finite_overlap)
        if choice.stand_in != choice:  # velocities in samples follow from a curve, as in the fit
            forces = real_array("force", force, "N")
            model = VelocityModel(self.packing, ("width",), choice, forces.ravel(), waves)
            start = model.find_start(self.packing.width)
            velocities, _ = model.settle_geometry(start)(start)
            return velocities.reshape(forces.shape)[()]
        state = choice.of(self.packing).at_force(force, finite_overlap=waves.finite_overlap)
        velocities, _ = waves.velocity(state)
        return velocities[()]

    def _list_columns(self) -> dict[str, Any]:
        """Return the columns of fit.csv, (n,), by their headings."""
        columns = {
            "force (N)": self.force,
            "velocity (m/s)": self.velocity,
            "sigma (m/s)": self.sigma,
            "fit (m/s)": self.velocities,
            "residual (m/s)": self.residuals,
        }
        if self.waves.frequency is not None:
            columns["frequency (Hz)"] = np.broadcast_to(self.waves.frequency, self.force.shape)
        return columns


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
    """Find the width of the distribution of diameters, or other parameters, at which ``medium``
    gives measured velocities.

    Parameters
    ----------
    packing : the balls. Its spread gives the shape of the distribution, which is uniform if there
        is no spread. The fit starts from the values of the packing, and from many other widths as
        well.
    force : mean contact forces, (n,), N.
    velocity : sound velocities, (n,), m/s.
    sigma : standard errors of the velocities, m/s, one number or (n,). If left out, they are
        assumed equal and found from the scatter.
    frequency : frequency of the pulses, Hz, one number or (n,): velocities are then group
        velocities. If left out, they are velocities of long waves.
    medium : "afa", "ema", "simulation", or a name with its options. A simulation has the same balls
        at every width, with deviations in proportion to it. A dozen equilibria for a decade of
        force serve all widths, by interpolation. In the exact geometry, and for a history that
        starts at a load, they serve one width: they are solved again at the fitted parameters until
        those change by less than 1e-3 of them.
    parameters : "width", and "young_modulus" or "diameter" if these are to be fitted too; without
        "width" the packing keeps its spread. If its balls are equal then, every medium is the
        averaged lattice.
    branch : "longitudinal" or "transverse"; in space "transverse_slow" or "transverse_fast" instead
        of the latter.
    direction : direction of propagation, (p,) for a lattice with p periods; by default along its
        last axis. In the plane that is (0, 1), across a row of touching balls, from side to side of
        the paper's hexagonal frame.
    finite_overlap : keep the terms of relative order delta/d in the velocities, as the exact
        geometry of a simulation always does. Standard errors in the exact geometry are those at
        constant W/d.

    Returns
    -------
    :class:`WidthFit`. Standard errors follow from linear theory, with the given sigma or the
    scatter. If from the scatter, a parameter's error over its standard error follows Student's
    distribution with ``dof`` degrees of freedom. The ``warnings`` say why a fit is not to be
    trusted: ``p`` below 0.001 or above 0.999, no degrees of freedom, a scatter below the rounding
    of the data, data above the velocity of equal balls, one datum that decides the fit alone
    (leverage above 0.9) or lies far off, a standard error above half the value.

    Raises
    ------
    InputError : data that are not finite and above zero, of different lengths, or too few; data
        that cannot determine the parameters (a standard error above the parameter itself,
        parameters that have the same effect, velocities equal to those of equal balls or higher);
        velocities so far from those of equal balls that a unit is wrong; loads or a frequency that
        the medium cannot carry; the medium "auto"; a lattice without such waves, or without such a
        medium for balls that differ; samples of so few balls that the parameters of round after
        round differ; what is no packing, and names of parameters, a ``branch``, a ``medium``, a
        ``direction`` or a ``finite_overlap`` that there is not.
    """
    data = Measurements(
        real_array("force", force, "N"), real_array("velocity", velocity, "m/s"), sigma, frequency
    )
    names = texts("parameters", parameters)
    choice = MediumChoice.parse(medium, given_packing(packing).structure)
    if "width" not in names and not packing.width:
        choice = MediumChoice("ala")
    requested = require("finite_overlap", truth, finite_overlap)
    if requested:
        require_finite_overlap([choice])
    waves = Waves(
        branch,
        _read_direction(packing, direction),
        data.frequency,
        choice.has_finite_overlap(packing, requested),
    )
    choice.require_fixed("a fit")
    problem = FitProblem.of(VelocityModel(packing, names, choice, data.force, waves), data)
    problem, logs = find_best(problem)
    return _make_fit(problem, logs, data)


def _make_fit(problem: FitProblem, logs: Array, data: Measurements) -> WidthFit:
    """Return the fit of a ``problem`` to the ``data``, from the logarithms ``logs`` (p,) of the
    parameters at the minimum. A sigma that is not given is found from the scatter. If the scatter
    is no more than the rounding of the data, the covariance is nan.

    Raises :class:`~granphon.base.errors.InputError` as :func:`_find_covariance` does, and the
    errors of the medium at the fitted parameters.
    """
    sigma_given = data.sigma is not None
    if not sigma_given:
        problem = _set_sigma_to_scatter(problem, logs)
    covariance = _find_covariance(problem, logs)
    errors = np.sqrt(np.diag(covariance))
    residuals, _ = problem(logs)
    chi2 = float(residuals @ residuals)
    least_scatter = _SCATTER_OF_ROUNDING * find_rounding(data.velocity)
    has_known_errors = sigma_given or float(problem.sigma[0]) >= least_scatter
    warnings = find_warnings(problem, logs, errors, sigma_given, has_known_errors)
    if not has_known_errors:
        covariance = np.full(covariance.shape, np.nan)
    fitted_packing = problem.model.fit_packing(logs)
    values = np.exp(logs)
    # the validity of a simulation is decided at the least and the greatest force
    loads = data.force
    if problem.model.is_sampled:
        loads = loads[[np.argmin(loads), np.argmax(loads)]]
    # the geometry of samples is settled now, and with it whether overlap is finite
    waves = problem.model.waves
    medium_of_fit = problem.model.choice.of(fitted_packing)
    state = medium_of_fit.at_force(loads, finite_overlap=waves.finite_overlap)
    return WidthFit(
        packing=fitted_packing,
        choice=problem.model.choice,
        waves=waves,
        parameters=problem.model.names,
        values=values,
        covariance=covariance * np.outer(values, values),  # from that of the logarithms
        force=data.force,
        velocity=data.velocity,
        sigma=problem.sigma,
        sigma_given=sigma_given,
        velocities=data.velocity - residuals * problem.sigma,
        chi2=chi2 if sigma_given else float(problem.dof),
        dof=problem.dof,
        warnings=(*warnings, *validity(state).warnings),
    )


def _set_sigma_to_scatter(problem: FitProblem, logs: Array) -> FitProblem:
    """Return the problem with one sigma for all data, m/s: the scatter about the fit at ``logs``,
    or the rounding of the velocities in double precision if that is larger. Until now the sigma of
    the problem must be 1 m/s.
    """
    residuals, _ = problem(logs)  # m/s, as sigma is 1 m/s
    scatter = math.sqrt(float(residuals @ residuals) / problem.dof)
    # numbers in double precision scatter by their rounding at least
    rounding = np.finfo(float).eps * float(np.max(problem.velocity))
    return replace(problem, sigma=np.full(residuals.shape, max(scatter, rounding)))


def _require_effects(
    problem: FitProblem, logs: Array, norms: Array, *, have_same_effect: bool
) -> None:
    """Raise InputError if the data do not determine a parameter at the minimum ``logs``, or if
    parameters ``have_same_effect``. ``norms`` (p,) are those of the derivatives of residuals by the
    logarithms of the parameters.
    """
    names = problem.model.names
    are_all_fitted = len(names) == len(VARIABLE)  # no data can tell all three apart
    index = problem.model.width_index
    has_no_width = index is not None and logs[index] < math.log(problem.widths[0])
    # if the other parameters were known, the standard error of a parameter would be 1/norm times
    # the parameter: with more than the whole of it nothing is known
    is_undetermined = np.any(norms < 1.0) or has_no_width
    if is_undetermined and not (have_same_effect and are_all_fitted):
        raise explain_undetermined(problem, logs, 1.0 / np.maximum(norms, _LEAST_NORM))
    if have_same_effect:
        why = ""
        if are_all_fitted:
            why = "The velocities of long waves depend on E/d and E d^(1/2) W^(3/2) only"
        mend = "Measure over a wider range of force, or fit fewer parameters"
        raise InputError(f"the data cannot tell {' and '.join(names)} apart", why, mend)


def _find_covariance(problem: FitProblem, logs: Array) -> Array:
    """Return the covariance (p, p) of the logarithms of the parameters, at their minimum ``logs``;
    InputError if the data do not determine them or tell them apart, or if ``logs`` is no minimum.

    The problem must have the sigma of the data, given or from the scatter.
    """
    residuals, matrix = problem(logs)
    norms = np.linalg.norm(matrix, axis=0)
    # the left singular vectors (n, p), the singular values (p,), and the right vectors as rows
    left_vectors, singular_values, right_vectors = np.linalg.svd(
        matrix / np.maximum(norms, _LEAST_NORM), full_matrices=False
    )
    is_flat = singular_values[-1] < SAME_EFFECT * singular_values[0]
    have_same_effect = bool(np.all(norms > 0.0)) and bool(is_flat)
    _require_effects(problem, logs, norms, have_same_effect=have_same_effect)
    # (A^T A)^-1 of the derivatives A from their singular values: (p, p) root times its transpose
    root = (right_vectors / singular_values[:, None]).T / norms[:, None]
    covariance = root @ root.T
    errors = np.sqrt(np.diag(covariance))
    # the step to the minimum of the linear problem: where the given sigma is smaller than the
    # scatter, the step is compared with errors that the scatter would give
    step = root @ (left_vectors.T @ residuals)
    chi2 = float(residuals @ residuals)
    scatter = max(1.0, math.sqrt(chi2 / max(problem.dof, 1)))
    of_error, of_value = _REMAINING_STEP
    is_off = np.abs(step) > of_error * scatter * errors + of_value
    if np.any(errors > 1.0):
        raise explain_undetermined(problem, logs, errors)
    if np.any(is_off):
        raise _explain_no_minimum(problem, logs, step, errors)
    return np.asarray(covariance)


def _explain_no_minimum(problem: FitProblem, logs: Array, step: Array, errors: Array) -> InputError:
    """Return the error that says why ``logs`` (p,) is no minimum: that of velocities above those of
    equal balls, where the width alone is fitted; that of :func:`explain_undetermined`, where the
    medium refuses wider widths; else that the search has not ended at a minimum.

    ``step`` (p,) leads to the minimum of the linear problem, and ``errors`` (p,) are the standard
    errors; both are of logarithms, and relative therefore.
    """
    names = problem.model.names
    index = problem.model.width_index
    if names == ("width",):
        excess_error = _explain_excess(problem, logs)
        if excess_error is not None:
            return excess_error
    if index is not None and step[index] > 0.0:
        # a search that the medium stops ends just below the widths that the medium refuses
        wider = logs + np.where(np.arange(len(logs)) == index, _PROBE_OF_WIDTH, 0.0)
        try:
            problem(wider)
        except InputError:
            return explain_undetermined(problem, logs, errors)
    worst = int(np.argmax(np.abs(step) / errors))
    fault = f"the search for {' and '.join(names)} has not ended at a minimum"
    why = (
        f"From {names[worst]} {np.exp(logs[worst]):.4g} a linear step still changes it by"
        f" {100.0 * step[worst]:.2g} %"
    )
    mend = "Give a packing nearer to the balls of the experiment, or fit fewer parameters"
    return InputError(fault, why, mend)


def convert_pressure(
    packing: Packing,
    finite_overlap: bool,
    medium: str | Mapping[str, Mapping[str, Any] | None] | MediumChoice,
    fitted: Sequence[str],
    pressure: float,
) -> float:
    """Return the contact force, N, of a ``packing`` under a ``pressure`` (N on a line, N/m in the
    plane, Pa in space).

    With ``finite_overlap``, and in the exact geometry of a simulation, the force follows from the
    ``medium`` at the packing's own width. A simulation is replaced by the effective medium, whose
    overlaps differ from the overlaps of samples by less than W/100.

    Raises :class:`~granphon.base.errors.InputError` if the diameter is among the parameters to be
    ``fitted`` in the plane or in space, where the force depends on the diameter; and for a medium
    or a pressure that the packing cannot have.
    """
    if "diameter" in fitted and packing.structure.periods > 1:
        why = "The contact force under a pressure depends on the diameter"
        raise InputError(
            "the diameter is fitted, and pressures are given", why, "Give contact forces"
        )
    choice = MediumChoice.parse(medium)
    has_finite_overlap = choice.has_finite_overlap(packing, finite_overlap)
    if not has_finite_overlap:  # in the paper's limit the medium does not matter
        choice = MediumChoice("ala")
    return float(
        choice.stand_in.of(packing).at_pressure(pressure, finite_overlap=has_finite_overlap).force
    )


def convert_cutoff(
    packing: Packing,
    branch: str,
    direction: ArrayLike | None,
    finite_overlap: bool,
    fitted: Sequence[str],
    force: Array,
    cutoff: Array,
) -> Array:
    """Return the velocities of long waves, (n,), m/s, of a ``packing`` at each contact ``force``
    (n,), N, that belong to the frequencies ``cutoff`` (n,), Hz; ``finite_overlap`` is that of
    :func:`fit_width`.

    A cut-off is the highest frequency of the ``branch`` along the ``direction``, both as in
    :func:`fit_width`. The ratio of velocity to cut-off is taken from the lattice of equal balls; it
    is the same in every medium but a simulation.

    Raises :class:`~granphon.base.errors.InputError` if the diameter is among the parameters to be
    ``fitted``, to which the ratio is proportional, if the lattice has no such branch, and for a
    direction that is zero, not finite or of another shape.
    """
    if "diameter" in fitted:
        why = "The velocity at a cut-off frequency is proportional to the diameter"
        raise InputError(
            "the diameter is fitted, and cut-off frequencies are given", why, "Give velocities"
        )
    waves = Waves(branch, _read_direction(packing, direction), None, finite_overlap)
    equal_balls = VelocityModel(packing, ("young_modulus",), MediumChoice("ala"), force, waves)
    start = equal_balls.find_start(packing.width)
    velocities, _ = equal_balls(start)
    tops = equal_balls.find_tops(start)
    return np.asarray(cutoff * velocities / tops)


def _read_direction(packing: Packing, direction: ArrayLike | None) -> Array:
    """Return the unit vector (p,) of the ``direction`` of sound in a ``packing``, by default the
    last axis of its lattice; InputError for a direction that is zero, not finite or of another
    shape.
    """
    periods = packing.structure.periods
    return one_direction(np.eye(periods)[-1] if direction is None else direction, periods)
