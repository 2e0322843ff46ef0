"""How far a fit by least squares can be trusted: what its residuals, leverages and errors say, each with its number."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

__all__ = ["Goodness", "leverages", "probability", "rounding"]

Array = NDArray[np.float64]
#: a chi-squared whose probability is less, or more than one less this, is not believed to be chance
_CHANCE = 1e-3
#: the others agree with their sigma, to judge one datum by it, if so large a chi-squared has this probability
_AGREES = 0.05
#: a datum with more than this part of what decides a parameter decides it alone
_ALONE = 0.9
#: standard errors above this part of their parameter are beyond linear theory
_LARGE = 0.5
#: scatter below this part of the rounding of the data is none; data of more digits than the least are not rounded
_PART, _LEAST = 0.1, 1e-11


def probability(chi2: float, dof: int) -> float:
    """That errors as given make a sum of squares above ``chi2``; nan with no degrees of freedom."""
    from scipy.special import chdtrc

    return float(chdtrc(dof, chi2)) if dof else math.nan


def leverages(matrix: Array) -> Array:
    """(n,) diagonal of A (A^T A)^-1 A^T for the derivatives A (n, p): how far the fit follows each datum, their sum is p."""
    left, _ = np.linalg.qr(matrix / np.linalg.norm(matrix, axis=0))
    return np.asarray(np.sum(left**2, axis=1))


def rounding(values: Array) -> float:
    """The unit of the last decimal of ``values``: the largest power of ten of which all are multiples."""
    largest = float(np.max(values))
    for power in range(math.floor(math.log10(largest)), math.floor(math.log10(_LEAST * largest)), -1):
        steps = values / 10.0**power
        if np.all(np.abs(steps - np.rint(steps)) <= 4.0 * np.finfo(float).eps * steps):
            return 10.0**power
    return _LEAST * largest


@dataclass(frozen=True)
class Goodness:
    """What a fit is judged by.

    Attributes
    ----------
    names, errors : of the parameters, (p,), and their standard errors as parts of them.
    force, velocity : the data, (n,), N and m/s.
    residuals, leverages : in units of sigma, and how far the fit follows each datum, (n,).
    sigma : m/s, (n,); ``given``, or from the scatter.
    """

    names: tuple[str, ...]
    errors: Array
    force: Array
    velocity: Array
    residuals: Array
    leverages: Array
    sigma: Array
    given: bool

    @property
    def dof(self) -> int:
        """Degrees of freedom."""
        return len(self.velocity) - len(self.names)

    @property
    def chi2(self) -> float:
        """Sum of squares of the residuals over sigma; ``dof`` where sigma is from the scatter."""
        return float(self.residuals @ self.residuals) if self.given else float(self.dof)

    @property
    def p(self) -> float:
        """Probability of a larger chi2; nan where sigma is from the scatter, or nothing is left to judge by."""
        return probability(self.chi2, self.dof) if self.given else math.nan

    @property
    def errors_are_known(self) -> bool:
        """Whether standard errors rest on more than rounding."""
        return self.given or float(self.sigma[0]) >= _PART * rounding(self.velocity)

    @property
    def warnings(self) -> tuple[str, ...]:
        """Where the fit is not to be trusted."""
        return (*self._of_residuals(), *self._of_single_data(), *self._of_errors())

    def _of_residuals(self) -> list[str]:
        if self.dof == 0:
            what = f"{len(self.names)} to be fitted and as many data leave 0 degrees of freedom"
            return [f"{what}: nothing can be said of how well the model fits"]
        if not self.errors_are_known:
            digits, scatter = rounding(self.velocity), float(self.sigma[0])
            return [
                f"the scatter about the fit, {scatter:.2g} m/s, is below the rounding of the data, {digits:.2g} m/s:"
                " standard errors are not known; give sigma"
            ]
        ratio = math.sqrt(self.chi2 / self.dof)
        found = f"the residuals are {ratio:.3g} times what sigma says"
        numbers = f"(chi^2 is {self.chi2:.4g} for {self.dof} degrees of freedom, p = {self.p:.2g})"
        if self.p < _CHANCE:
            return [f"{found} {numbers}: the model does not fit, or sigma is too small"]
        if self.p > 1.0 - _CHANCE:
            return [f"{found} {numbers}: sigma is too large, or the errors are not independent"]
        return []

    def _of_single_data(self) -> list[str]:
        """A datum that the fit follows alone, and one that lies off the fit of the others."""
        if self.dof == 0:
            return []
        out, most = [], int(np.argmax(self.leverages))
        if self.leverages[most] > _ALONE:
            out.append(
                f"{self._datum(most)} decides the fit almost alone: its leverage is {self.leverages[most]:.4g},"
                " and cannot be above 1"
            )
        if self.errors_are_known and self.dof > 1:
            from scipy.special import ndtr, stdtr

            # a residual over its own standard error is the distance from the fit of the others, over that of it
            r = np.abs(self.residuals) / np.sqrt(np.maximum(1.0 - self.leverages, 1e-12))
            off = int(np.argmax(r))
            others = max(self.chi2 - float(r[off]) ** 2, 1e-12)  # their chi-squared, about a fit of their own
            if self.given and probability(others, self.dof - 1) >= _AGREES:
                distance = float(r[off])
                one = float(ndtr(-distance))
            else:  # by the scatter of the others, and then it is Student's
                distance = float(r[off]) * math.sqrt((self.dof - 1) / others)
                one = float(stdtr(self.dof - 1, -distance))
            chance = min(2.0 * len(r) * one, 1.0)  # of the farthest of so many
            if chance < _CHANCE:
                where = f"{distance:.3g} standard errors off the fit of the others (p = {chance:.2g})"
                out.append(f"{self._datum(off)} lies {where}")
        return out

    def _of_errors(self) -> list[str]:
        if not self.errors_are_known:
            return []
        return [
            f"the standard error of {name} is {error:.2g} of its value: it is hardly told from zero"
            for name, error in zip(self.names, self.errors.tolist(), strict=True)
            if error > _LARGE
        ]

    def _datum(self, place: int) -> str:
        return f"datum {place + 1}, {self.velocity[place]:.4g} m/s at {self.force[place]:.4g} N,"
