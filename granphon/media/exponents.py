"""The local exponent of simulated samples, from differences between equilibria at neighbouring loads."""

from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from granphon.array.sample import STEP, Sample, jackknife
from granphon.dynamics.tensors import longitudinal_modulus

if TYPE_CHECKING:
    from granphon.media.simulation import SimulatedState

__all__ = ["exponent_error", "mean_exponent"]

Array = NDArray[np.float64]


def mean_exponent(state: SimulatedState) -> Array:
    """Return d log v_L / d log P, with the shape of the load, from the mean M of the samples of a state."""
    return _compute_exponent(np.mean(_compute_terms(state), axis=-2))


def exponent_error(state: SimulatedState) -> Array:
    """Return the standard error of :func:`mean_exponent`, with the shape of the load; it needs two samples or more."""
    return jackknife(_compute_exponent, _compute_terms(state))


def _compute_exponent(means: Array) -> Array:
    """Return f M'/2kM, (...), from ``means`` (..., 4) over samples of M' = dM/d(delta), of M, k and f.

    If all samples have the same force, the four are dM/d log f, M, 1 and 1.
    """
    rise, modulus, stiffness, force = np.moveaxis(means, -1, 0)
    return np.asarray(0.5 * force * rise / (stiffness * modulus))


def _compute_terms(state: SimulatedState) -> Array:
    """Return the terms of each sample whose means :func:`_compute_exponent` takes, (..., n_samples, 4)."""
    low, high = np.moveaxis(_compute_longitudinal_modulus(state, lambda sample: sample.elastic_tensors_beside), -1, 0)
    modulus = _compute_longitudinal_modulus(state, lambda sample: sample.elastic_tensor)
    force, stiffness = np.ones_like(modulus), np.ones_like(modulus)
    if state.spaced:  # samples have the same overlap, so the mean force is an average over them
        force = state.over_samples(lambda sample: sample.force)
        stiffness = state.over_samples(lambda sample: sample.normal_stiffness)
    rise = modulus * np.log(high / low) / (2.0 * STEP)  # dM / d log f
    return np.stack([rise * stiffness / force, modulus, stiffness, force], axis=-1)


def _compute_longitudinal_modulus(state: SimulatedState, of: Callable[[Sample], Array]) -> Array:
    """Return the modulus M of longitudinal waves, of the elastic tensor or tensors that ``of`` finds for every sample."""
    return longitudinal_modulus(state.over_samples(of))
