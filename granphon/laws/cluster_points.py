"""Quasi-random realisations of what acts on a cluster: the misfits of its contacts, and the push of those outside.

A realisation is a point of the unit cube. Its first coordinates give the deviations of the balls of the cluster and of those
that touch it, by the quantiles of their distribution. The many balls farther off add up to normal deviates with what is left
of the covariance; so does the push of contacts outside, which is known up to its size
(:mod:`granphon.laws.cluster_balance`). The points are Sobol's, scrambled, each with its antithetic one. Independent
scrambles are kept apart, and from their differences follows the error of every mean.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from functools import lru_cache
from typing import Any

import numpy as np
from numpy.typing import NDArray

from granphon.balls.distributions import Shape
from granphon.base.errors import PrecisionError, message
from granphon.base.results import read_only
from granphon.dynamics.cluster_response import ClusterResponse

Array = NDArray[np.float64]
#: of single or double precision
Floats = NDArray[Any]
#: variance of the deviations in widths W, by the definition of W
_VARIANCE = 1.0 / 12.0
#: eigenvalues of a covariance below this are rounding
_LEAST = 1e-9
#: least number of points for each direction of the covariance: half of them are mirror images
_POINTS_PER_DIRECTION = 2.5
#: least variance of a direction before it is stretched, over what it is to be
_LEAST_VARIANCE = 0.02
#: binary digits of a coordinate
_DIGITS = 30
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


class PointSource:
    """Randomised sets of realisations for a cluster and a distribution.

    Each is scrambled by itself. Of ``many`` sets each is a random shift of the same points, in single precision: it takes a
    fraction of the time, and its scatter is hardly larger.
    """

    def __init__(self, response: ClusterResponse, shape: Shape, many: bool = False) -> None:
        from scipy.linalg import block_diag

        near = response.influence
        far = _root(_VARIANCE * (response.misfit - near @ near.T))
        push = _root(response.remote)
        self._contacts, self._near = near.shape
        exact = np.zeros((2 * self._contacts, 2 * self._contacts))
        exact[: self._contacts, : self._contacts] = _VARIANCE * response.misfit
        exact[self._contacts :, self._contacts :] = push @ push.T
        root = _root(exact)
        both = block_diag(np.hstack([np.sqrt(_VARIANCE) * near, far]), push)
        #: deviates give uncorrelated parts of the realisations, and these the realisations
        self._dtype: type[np.floating] = np.float32 if many else np.float64
        self._parts, self._root = (np.linalg.pinv(root) @ both).T.astype(self._dtype), root
        self._shape, self._randomise = shape, _shift if many else _scramble
        self.least = 2 ** math.ceil(math.log2(_POINTS_PER_DIRECTION * root.shape[1]))

    def draw(self, seed: int | list[int], points: int) -> tuple[Floats, Floats] | None:
        """Draw a set of ``points``, a power of two: misfits and pushes (n, n_c), or None if too few are of a rare kind."""
        from scipy.special import ndtri

        # in the middle of their cells: in the open cube
        cube = self._randomise(len(self._parts), points // 2, seed) + 0.5 ** (_DIGITS + 1)
        near = cube[:, : self._near]
        one, other = (self._shape.quantile(part) / np.sqrt(_VARIANCE) for part in (near, 1.0 - near))
        # of a point and its mirror image, half of the difference and of the sum: the sum of a symmetric distribution is zero
        odd = np.empty(cube.shape, self._dtype)
        odd[:, : self._near] = 0.5 * (one - other)
        odd[:, self._near :] = ndtri(cube[:, self._near :])
        even = 0.5 * (one + other)
        # uncorrelated parts of the realisations; where no ``even`` is left it is zero
        lopsided = even.astype(self._dtype) @ self._parts[: self._near] if np.any(np.abs(even) > _LEAST) else None
        odd = odd @ self._parts
        covariance = (odd.T @ odd).astype(float)
        if lopsided is not None:
            lopsided -= lopsided.mean(axis=0, dtype=float).astype(lopsided.dtype)
            covariance += lopsided.T @ lopsided
        covariance /= len(odd)
        try:
            # it has a factor if all directions vary more than that
            np.linalg.cholesky(covariance - _LEAST_VARIANCE * np.eye(len(covariance)))
        except np.linalg.LinAlgError:
            return None
        # so stretched that the covariance is root root^T: even + odd, then even - odd
        stretch = np.linalg.solve(np.linalg.cholesky(covariance).T, self._root.T).astype(odd.dtype)
        found = np.empty((2 * len(odd), len(self._root)), odd.dtype)
        np.matmul(odd, stretch, out=found[: len(odd)])
        np.negative(found[: len(odd)], out=found[len(odd) :])
        if lopsided is not None:
            found.reshape(2, len(odd), -1)[:] += lopsided @ stretch
        return found[:, : self._contacts], found[:, self._contacts :]

    def draw_enough(self, seeds: Sequence[int | list[int]], points: int) -> list[tuple[Floats, Floats]]:
        """Draw sets of ``points`` or more: a kind of balls that is rare asks for more.

        Raises :class:`~granphon.base.errors.PrecisionError` if it is so rare that even many more do not do.
        """
        points = max(points, self.least)
        most = max(points, _MOST_POINTS)
        while points <= most:
            sets = [one for seed in seeds if (one := self.draw(seed, points)) is not None]
            if len(sets) == len(seeds):
                return sets
            points *= 2
        what = "the cluster medium does not hold balls of so rare a kind"
        raise PrecisionError(message(what, mend="Use the effective medium, or leave the rarest diameters out"))


def draw_points(response: ClusterResponse, shape: Shape, points: int, scrambles: int, first: int = 0) -> ClusterPoints:
    """Draw ``scrambles`` sets of ``points`` realisations each, a power of two, half of them antithetic to the others.

    There are more, if as many do not fix the covariance. Scrambles are numbered, from ``first`` on: no two have the same
    points. Raises :class:`~granphon.base.errors.PrecisionError` for a distribution with so rare a kind of balls that even
    many more do not.
    """
    sets = PointSource(response, shape).draw_enough(range(first, first + scrambles), points)
    misfits, pushes = (read_only(np.concatenate(part)) for part in zip(*sets, strict=True))
    return ClusterPoints(misfits, pushes, scrambles)


def _scramble(dimensions: int, points: int, seed: int | list[int]) -> Array:
    """Return scrambled Sobol points (points, dimensions) of the unit cube, multiples of 2^-30."""
    from scipy.stats import qmc

    return np.asarray(qmc.Sobol(dimensions, scramble=True, bits=_DIGITS, seed=np.random.default_rng(seed)).random(points))


@lru_cache(maxsize=8)
def _find_net(dimensions: int, points: int) -> NDArray[np.uint32]:
    """Return the points that others are shifts of, (points, dimensions), as whole numbers of 30 binary digits."""
    return read_only((_scramble(dimensions, points, 0) * 2.0**_DIGITS).astype(np.uint32))


def _shift(dimensions: int, points: int, seed: int | list[int]) -> Array:
    """Return scrambled Sobol points (points, dimensions) with a random shift of their binary digits, multiples of 2^-30."""
    shift = np.random.default_rng(seed).integers(0, 2**_DIGITS, dimensions, dtype=np.uint32)
    return np.asarray((_find_net(dimensions, points) ^ shift) * 2.0**-_DIGITS)


def _root(covariance: Array) -> Array:
    """Return A (n, r) of full rank with A A^T = ``covariance``, the largest parts first."""
    values, vectors = np.linalg.eigh(covariance)
    kept = values > _LEAST
    return np.asarray((vectors[:, kept] * np.sqrt(values[kept]))[:, ::-1])
