"""How far a fit by least squares can be trusted, judged by its residuals, leverages and standard errors."""

from __future__ import annotations

import math
from collections.abc import Sequence

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


def are_errors_known(given: bool, sigma: Array, velocity: Array) -> bool:
    """Return whether standard errors rest on a ``given`` sigma, m/s, or on more scatter than the rounding of the data."""
    return given or float(sigma[0]) >= _SCATTER_OF_ROUNDING * find_rounding(velocity)


def find_warnings(
    names: Sequence[str], errors: Array, force: Array, velocity: Array, residuals: Array, leverages: Array, sigma: Array,
    given: bool, equal_balls: Array,
) -> list[str]:  # fmt: skip
    """Return the reasons not to trust a fit.

    Parameters
    ----------
    names, errors : names of the parameters, (p,), and their relative standard errors.
    force, velocity : the data, (n,), N and m/s.
    residuals : measured less fitted velocity, in units of sigma, (n,).
    leverages : how far the fit follows each datum, (n,).
    sigma : standard error of each velocity, m/s, (n,).
    given : whether sigma was given, rather than found from the scatter.
    equal_balls : velocities of equal balls with the fitted modulus and diameter, m/s, (n,).
    """
    from scipy.special import ndtr, stdtr

    def describe(place: int) -> str:
        return f"datum {place + 1}, {velocity[place]:.4g} m/s at {force[place]:.4g} N,"

    dof, known, out = len(velocity) - len(names), are_errors_known(given, sigma, velocity), list[str]()
    chi2 = float(residuals @ residuals) if given else float(dof)
    # residuals
    p = compute_probability(chi2, dof) if given else math.nan
    if dof == 0:
        what = f"as many data as fitted parameters ({len(names)}) leave 0 degrees of freedom"
        out.append(f"{what}: nothing can be said of how well the model fits")
    elif not known:
        out.append(
            f"the scatter about the fit, {float(sigma[0]):.2g} m/s, is below the rounding of the data,"
            f" {find_rounding(velocity):.2g} m/s: standard errors are not known; give sigma"
        )
    elif p < _LEAST_CHANCE or p > 1.0 - _LEAST_CHANCE:
        small = "the model does not fit, or sigma is too small"
        large = "sigma is too large, or the errors are not independent"
        out.append(
            f"the residuals are {math.sqrt(chi2 / dof):.3g} times what sigma says (chi^2 is {chi2:.4g} for {dof} degrees of"
            f" freedom, p = {p:.2g}): {small if p < _LEAST_CHANCE else large}"
        )
    # data above the velocity of equal balls by more than their noise, which no width explains
    excess = velocity / equal_balls - 1.0
    if "width" in names and dof:
        # the scatter about a fit that such data bend is no measure of their noise, and a given sigma may be too small
        noise = max(_estimate_noise(force, velocity), np.finfo(float).eps)
        chances = ndtr(-excess / np.maximum(sigma / equal_balls, noise)) if given else stdtr(dof, -excess / noise)
        count = np.count_nonzero((excess > _MODEL_ERROR) & (chances < _LEAST_CHANCE / len(excess)))
        if count:
            most, verb = int(np.argmax(excess)), "is" if count == 1 else "are"
            where = f"{count} of {len(excess)} data {verb} above the velocity of equal balls at that load"
            by = f"by up to {100.0 * excess[most]:.2g} % ({describe(most).rstrip(',')})"
            why = "a spread only slows sound, so that what is fitted is not a width"
            mend = "Check the Young modulus, diameter and density, or fit young_modulus as well"
            out.append(f"{where}, {by}: {why}. {mend}")
    # a datum that alone decides the fit
    most = int(np.argmax(leverages))
    if dof and leverages[most] > _DECIDING_LEVERAGE:
        out.append(
            f"{describe(most)} decides the fit almost alone: its leverage is {leverages[most]:.4g}, and cannot be above 1"
        )
    # a datum off the fit of the others: r is its distance from that fit over the standard error of that distance
    if known and dof > 1:
        r = np.abs(residuals) / np.sqrt(np.maximum(1.0 - leverages, 1e-12))
        off = int(np.argmax(r))
        distance = float(r[off])
        others = max(chi2 - distance**2, 1e-12)  # chi-squared of the others about a fit of their own
        if given and compute_probability(others, dof - 1) >= _CHANCE_OF_AGREEMENT:
            one = float(ndtr(-distance))
        else:  # judged by the scatter of the others: Student's distribution
            distance *= math.sqrt((dof - 1) / others)
            one = float(stdtr(dof - 1, -distance))
        chance = min(2.0 * len(r) * one, 1.0)  # any of the len(r) data may be the farthest
        if chance < _LEAST_CHANCE:
            out.append(f"{describe(off)} lies {distance:.3g} standard errors off the fit of the others (p = {chance:.2g})")
    out += [
        f"the standard error of {name} is {error:.2g} of its value: it can hardly be told from zero"
        for name, error in zip(names, errors.tolist(), strict=True)
        if known and error > _LARGE_ERROR
    ]
    return out


def _estimate_noise(force: Array, velocity: Array) -> float:
    """Return the relative noise of the velocities: their rms distance from lines through their neighbours in force."""
    order = np.lexsort((velocity, force))
    x, y = np.log(force[order]), np.log(velocity[order])
    reach = x[2:] - x[:-2]
    part = np.where(reach > 0.0, (x[1:-1] - x[:-2]) / np.where(reach > 0.0, reach, 1.0), 0.5)
    off = y[1:-1] - (1.0 - part) * y[:-2] - part * y[2:]
    return math.sqrt(float(np.mean(off**2 / (1.0 + part**2 + (1.0 - part) ** 2)))) if off.size else math.inf
