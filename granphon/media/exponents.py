"""The local exponent of simulated samples, from differences between equilibria at neighbouring loads."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray

from granphon.array.sample import STEP, jackknife
from granphon.dynamics.tensors import longitudinal_modulus

Array = NDArray[np.float64]


def mean_exponent(tensors: Array, beside: Array, force: ArrayLike = 1.0, stiffness: ArrayLike = 1.0) -> Array:
    """Return d log v_L / d log P, (...), of the mean M over samples, which all have the same force or the same overlap.

    Parameters
    ----------
    tensors : (..., n_samples, n, n) elastic tensors, Pa.
    beside : (..., n_samples, 2, n, n) those below and above, at :data:`~granphon.array.sample.STEP` of log f to either side.
    force, stiffness : (..., n_samples), N and N/m, of samples at the same overlap, over which the mean force is an average.
    """
    return _compute_exponent(np.mean(_compute_terms(tensors, beside, force, stiffness), axis=-2))


def exponent_error(tensors: Array, beside: Array, force: ArrayLike = 1.0, stiffness: ArrayLike = 1.0) -> Array:
    """Return the standard error of :func:`mean_exponent`, (...); it needs two samples or more."""
    return jackknife(_compute_exponent, _compute_terms(tensors, beside, force, stiffness))


def _compute_exponent(means: Array) -> Array:
    """Return f M'/2kM, (...), from ``means`` (..., 4) over samples of M' = dM/d(delta), of M, k and f.

    If all samples have the same force, the four are dM/d log f, M, 1 and 1.
    """
    rise, modulus, stiffness, force = np.moveaxis(means, -1, 0)
    return np.asarray(0.5 * force * rise / (stiffness * modulus))


def _compute_terms(tensors: Array, beside: Array, force: ArrayLike, stiffness: ArrayLike) -> Array:
    """Return the terms of each sample whose means :func:`_compute_exponent` takes, (..., n_samples, 4)."""
    low, high = np.moveaxis(longitudinal_modulus(beside), -1, 0)
    modulus = longitudinal_modulus(tensors)
    rise = modulus * np.log(high / low) / (2.0 * STEP)  # dM / d log f
    f, k = (np.broadcast_to(values, modulus.shape) for values in (force, stiffness))
    return np.stack([rise * k / f, modulus, k, f], axis=-1)
