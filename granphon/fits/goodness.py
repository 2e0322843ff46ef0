"""How far a fit by least squares can be trusted, judged by its residuals, leverages and standard errors."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
#: a result whose probability is below this, or for chi-squared also above 1 minus this, is not explained by chance
_LEAST_CHANCE = 1e-3
#: one datum is judged by the given sigma, not by the scatter, if the chi-squared of the others has at least this probability
_CHANCE_OF_AGREEMENT = 0.05
#: a datum of more than this leverage decides the fit almost alone
_DECIDING_LEVERAGE = 0.9
#: standard errors above this part of their parameter are beyond linear theory
_LARGE_ERROR = 0.5
#: scatter below this part of the rounding of the data tells nothing
_SCATTER_OF_ROUNDING = 0.1
#: excess of a velocity over that of equal balls that is rounding of the model
_MODEL_ERROR = 1e-9
#: data count as not rounded if their last decimal is below this part of the largest of them
_FINEST_ROUNDING = 1e-11


def compute_probability(chi2: float, dof: int) -> float:
    """Return the probability that errors of the given sigma make a sum of squares above ``chi2``; nan if ``dof`` is 0."""
    from scipy.special import chdtrc

    return float(chdtrc(dof, chi2)) if dof else math.nan


def compute_leverages(matrix: Array) -> Array:
    """Return how far the fit follows each datum, (n,), sum p: the diagonal of A (A^T A)^-1 A^T, A (n, p) the derivatives."""
    left, _ = np.linalg.qr(matrix / np.linalg.norm(matrix, axis=0))
    return np.asarray(np.sum(left**2, axis=1))


def find_rounding(values: Array) -> float:
    """Return the unit of the last decimal of ``values``: the largest power of ten of which all are multiples."""
    largest = float(np.max(values))
    for power in range(math.floor(math.log10(largest)), math.floor(math.log10(_FINEST_ROUNDING * largest)), -1):
        steps = values / 10.0**power
        if np.all(np.abs(steps - np.rint(steps)) <= 4.0 * np.finfo(float).eps * steps):
            return 10.0**power
    return _FINEST_ROUNDING * largest


@dataclass(frozen=True)
class Goodness:
    """What a fit is judged by.

    Attributes
    ----------
    names, errors : names of the parameters, (p,), and their relative standard errors.
    force, velocity : the data, (n,), N and m/s.
    residuals : measured less fitted velocity, in units of sigma, (n,).
    leverages : how far the fit follows each datum, (n,).
    sigma : standard error of each velocity, m/s, (n,).
    given : whether sigma was given, rather than found from the scatter.
    equal_balls : velocities of equal balls with the fitted modulus and diameter, m/s, (n,).
    """

    names: tuple[str, ...]
    errors: Array
    force: Array
    velocity: Array
    residuals: Array
    leverages: Array
    sigma: Array
    given: bool
    equal_balls: Array

    @property
    def dof(self) -> int:
        """Degrees of freedom."""
        return len(self.velocity) - len(self.names)

    @property
    def chi2(self) -> float:
        """Sum of the squared residuals; ``dof`` where sigma is from the scatter."""
        return float(self.residuals @ self.residuals) if self.given else float(self.dof)

    @property
    def p(self) -> float:
        """Probability of a larger chi2; nan where sigma is from the scatter, or with no degrees of freedom."""
        return compute_probability(self.chi2, self.dof) if self.given else math.nan

    @property
    def errors_are_known(self) -> bool:
        """Whether standard errors rest on more than the rounding of the data."""
        return self.given or float(self.sigma[0]) >= _SCATTER_OF_ROUNDING * find_rounding(self.velocity)

    @property
    def warnings(self) -> tuple[str, ...]:
        """Reasons not to trust the fit."""
        return (*self._judge_residuals(), *self._judge_excess(), *self._judge_single_data(), *self._judge_errors())

    def _judge_residuals(self) -> list[str]:
        if self.dof == 0:
            what = f"as many data as fitted parameters ({len(self.names)}) leave 0 degrees of freedom"
            return [f"{what}: nothing can be said of how well the model fits"]
        if not self.errors_are_known:
            digits, scatter = find_rounding(self.velocity), float(self.sigma[0])
            return [
                f"the scatter about the fit, {scatter:.2g} m/s, is below the rounding of the data, {digits:.2g} m/s:"
                " standard errors are not known; give sigma"
            ]
        ratio = math.sqrt(self.chi2 / self.dof)
        found = f"the residuals are {ratio:.3g} times what sigma says"
        numbers = f"(chi^2 is {self.chi2:.4g} for {self.dof} degrees of freedom, p = {self.p:.2g})"
        if self.p < _LEAST_CHANCE:
            return [f"{found} {numbers}: the model does not fit, or sigma is too small"]
        if self.p > 1.0 - _LEAST_CHANCE:
            return [f"{found} {numbers}: sigma is too large, or the errors are not independent"]
        return []

    def _judge_excess(self) -> list[str]:
        """Count the data above the velocity of equal balls by more than their noise, which no width explains."""
        if "width" not in self.names or self.dof == 0:
            return []
        from scipy.special import ndtr, stdtr

        excess = self.velocity / self.equal_balls - 1.0
        # the scatter about a fit that such data bend is no measure of their noise, and a given sigma may be too small
        noise = max(self._estimate_noise(), np.finfo(float).eps)
        if self.given:
            chances = ndtr(-excess / np.maximum(self.sigma / self.equal_balls, noise))
        else:
            chances = stdtr(self.dof, -excess / noise)
        above = (excess > _MODEL_ERROR) & (chances < _LEAST_CHANCE / len(excess))
        if not np.any(above):
            return []
        most, count = int(np.argmax(excess)), np.count_nonzero(above)
        verb = "is" if count == 1 else "are"
        where = f"{count} of {len(above)} data {verb} above the velocity of equal balls at that load"
        by = f"by up to {100.0 * excess[most]:.2g} % ({self._describe(most).rstrip(',')})"
        why = "a spread only slows sound, so that what is fitted is not a width"
        return [f"{where}, {by}: {why}. Check the Young modulus, diameter and density, or fit young_modulus as well"]

    def _estimate_noise(self) -> float:
        """Return the relative noise of the velocities: their rms distance from lines through their neighbours in force."""
        order = np.lexsort((self.velocity, self.force))
        x, y = np.log(self.force[order]), np.log(self.velocity[order])
        reach = x[2:] - x[:-2]
        part = np.where(reach > 0.0, (x[1:-1] - x[:-2]) / np.where(reach > 0.0, reach, 1.0), 0.5)
        off = y[1:-1] - (1.0 - part) * y[:-2] - part * y[2:]
        return math.sqrt(float(np.mean(off**2 / (1.0 + part**2 + (1.0 - part) ** 2)))) if off.size else math.inf

    def _judge_single_data(self) -> list[str]:
        """Name a datum that alone decides the fit, and one that lies off the fit of the others."""
        if self.dof == 0:
            return []
        out, most = [], int(np.argmax(self.leverages))
        if self.leverages[most] > _DECIDING_LEVERAGE:
            out.append(
                f"{self._describe(most)} decides the fit almost alone: its leverage is {self.leverages[most]:.4g},"
                " and cannot be above 1"
            )
        if self.errors_are_known and self.dof > 1:
            from scipy.special import ndtr, stdtr

            # equal to the distance of the datum from a fit of the others, over the standard error of that distance
            r = np.abs(self.residuals) / np.sqrt(np.maximum(1.0 - self.leverages, 1e-12))
            off = int(np.argmax(r))
            others = max(self.chi2 - float(r[off]) ** 2, 1e-12)  # chi-squared of the others about a fit of their own
            if self.given and compute_probability(others, self.dof - 1) >= _CHANCE_OF_AGREEMENT:
                distance = float(r[off])
                one = float(ndtr(-distance))
            else:  # judged by the scatter of the others: Student's distribution
                distance = float(r[off]) * math.sqrt((self.dof - 1) / others)
                one = float(stdtr(self.dof - 1, -distance))
            chance = min(2.0 * len(r) * one, 1.0)  # any of the len(r) data may be the farthest
            if chance < _LEAST_CHANCE:
                where = f"{distance:.3g} standard errors off the fit of the others (p = {chance:.2g})"
                out.append(f"{self._describe(off)} lies {where}")
        return out

    def _judge_errors(self) -> list[str]:
        if not self.errors_are_known:
            return []
        return [
            f"the standard error of {name} is {error:.2g} of its value: it can hardly be told from zero"
            for name, error in zip(self.names, self.errors.tolist(), strict=True)
            if error > _LARGE_ERROR
        ]

    def _describe(self, place: int) -> str:
        return f"datum {place + 1}, {self.velocity[place]:.4g} m/s at {self.force[place]:.4g} N,"
