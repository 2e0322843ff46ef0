"""Quasi-random realisations of what acts on a cluster: the misfits of its contacts, and the push of those outside.

A realisation is a point of the unit cube. Its first coordinates give the deviations of the balls of the cluster and of those
that touch it, by the quantiles of their distribution. The many balls farther off add up to normal deviates with what is left
of the covariance; so does the push of contacts outside, which is known up to its size
(:mod:`granphon.laws.cluster_balance`). The points are Sobol's, scrambled, each with its antithetic one. Independent
scrambles are kept apart, and from their differences follows the error of every mean. The points do not depend on the load.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from granphon.balls.distributions import Shape
from granphon.base.errors import PrecisionError, message
from granphon.base.results import read_only
from granphon.dynamics.cluster_response import ClusterResponse

__all__ = ["ClusterPoints", "draw_points"]

Array = NDArray[np.float64]
#: variance of the deviations in widths W, by the definition of W
_VARIANCE = 1.0 / 12.0
#: eigenvalues of a covariance below this are rounding
_LEAST = 1e-9
#: least number of points for each direction of the covariance: half of them are mirror images
_POINTS_PER_DIRECTION = 2.5
#: least variance of a direction before it is stretched, over what it is to be
_LEAST_VARIANCE = 0.02
#: most points of a scramble
_MOST_POINTS = 2**13


@dataclass(frozen=True, eq=False)
class ClusterPoints:
    """Realisations, those of one scramble after those of another: ``misfits`` and ``pushes`` (n, n_c), ``scrambles`` (R).

    Misfits are in widths W; pushes have the covariance ``remote`` of the response, and must be multiplied by their size. In
    each scramble the mean is zero, and the covariance that of the infinite array, exactly.
    """

    misfits: Array
    pushes: Array
    scrambles: int


def draw_points(response: ClusterResponse, shape: Shape, points: int, scrambles: int, first: int = 0) -> ClusterPoints:
    """Draw ``scrambles`` sets of ``points`` realisations each, a power of two, half of them antithetic to the others.

    There are more, if as many do not fix the covariance. Scrambles are numbered, from ``first`` on: no two have the same
    points. Raises :class:`~granphon.base.errors.PrecisionError` for a distribution with so rare a kind of balls that even
    many more do not.
    """
    near = response.influence
    far = _root(_VARIANCE * (response.misfit - near @ near.T))
    push = _root(response.remote)
    spread = np.sqrt(_VARIANCE) * near
    n_c, n_far = len(near), far.shape[1]
    both = np.zeros((2 * n_c, near.shape[1] + n_far + push.shape[1]))
    both[:n_c, : near.shape[1]], both[:n_c, near.shape[1] : near.shape[1] + n_far] = spread, far
    both[n_c:, near.shape[1] + n_far :] = push
    exact = np.zeros((2 * n_c, 2 * n_c))
    exact[:n_c, :n_c], exact[n_c:, n_c:] = _VARIANCE * response.misfit, push @ push.T
    root = _root(exact)
    while points < _POINTS_PER_DIRECTION * root.shape[1]:
        points *= 2

    def draw(seed: int, points: int) -> Array | None:
        cube = _scramble(both.shape[1], points // 2, seed)
        cube = np.concatenate([cube, 1.0 - cube])
        deviates = _to_normal(cube)
        deviates[:, : near.shape[1]] = shape.quantile(cube[:, : near.shape[1]]) / np.sqrt(_VARIANCE)
        return _match(deviates @ both.T, root)

    while True:
        # of a rare kind of balls there may be too few at a place
        sets = [one for seed in range(first, first + scrambles) if (one := draw(seed, points)) is not None]
        if len(sets) == scrambles:
            break
        points *= 2
        if points > _MOST_POINTS:
            what = "the cluster medium does not hold balls of so rare a kind"
            raise PrecisionError(message(what, mend="Use the effective medium, or leave the rarest diameters out"))
    found = np.concatenate(sets)
    return ClusterPoints(read_only(found[:, :n_c].copy()), read_only(found[:, n_c:].copy()), scrambles)


def _scramble(dimensions: int, points: int, seed: int) -> Array:
    """Return scrambled Sobol points (points, dimensions) of the open unit cube."""
    from scipy.stats import qmc

    found = qmc.Sobol(dimensions, scramble=True, seed=np.random.default_rng(seed)).random(points)
    return np.asarray(np.clip(found, 2.0**-40, 1.0 - 2.0**-40))


def _to_normal(cube: Array) -> Array:
    from scipy.special import ndtri

    return np.asarray(ndtri(cube))


def _root(covariance: Array) -> Array:
    """Return A (n, r) of full rank with A A^T = ``covariance``, the largest parts first."""
    values, vectors = np.linalg.eigh(covariance)
    kept = values > _LEAST
    return np.asarray((vectors[:, kept] * np.sqrt(values[kept]))[:, ::-1])


def _match(found: Array, root: Array) -> Array | None:
    """Return the rows of ``found``, shifted and stretched so that their mean is zero and their covariance root root^T.

    It is None if a direction is nearly missing, as where no ball of a rare kind is at a place.
    """
    parts = found @ np.linalg.pinv(root).T
    parts = parts - parts.mean(axis=0)
    values, vectors = np.linalg.eigh(parts.T @ parts / len(parts))
    if values[0] < _LEAST_VARIANCE:
        return None
    return np.asarray(parts @ ((vectors / np.sqrt(values)) @ vectors.T) @ root.T)
