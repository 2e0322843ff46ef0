"""The contact law of the effective medium: equation (36) of Velicky and Caroli, solved once for each shape and Xi.

Averages over balls are quadratures if the diameters have a density, and sums if the diameters are listed.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

from granphon.balls.distributions import NormalShape, PointShape, Shape, UniformShape
from granphon.base.scales import WidthUnits
from granphon.laws.collocation import Averages, Block, solve_curve
from granphon.laws.effective_curve import VALID_FORCE, EffectiveCurve
from granphon.laws.listed import PointAverages
from granphon.laws.solved import CurveLaw

Array = NDArray[np.float64]
#: number of collocation (Radau) points on a step; its upper end is not counted
_STAGES = 16
#: tolerance of the last Chebyshev coefficients of k, relative to the least value of k on the step
_LAST_COEFFICIENTS = 1e-12
#: number of openings from which all steps are short, so that fewer points and a larger tolerance suffice
_MANY_OPENINGS = 100
#: number of collocation points on short steps
_STAGES_OF_SHORT = 12
#: tolerance of the last coefficients of k on short steps, relative to the least value of k
_LAST_OF_SHORT = 1e-10
#: upper bound on the rounding error of k that is allowed for, relative to k
_WORST_NOISE = 1e-8
#: nodes of the average over balls (see Shape.nodes)
_ORDER = 32


@lru_cache(maxsize=64)
def effective_curve(shape: Shape, xi: float) -> EffectiveCurve:
    """Solve equation (36) for a shape and Xi; force and stiffness are right to 1e-8 or better from f* = 1e-4 on.

    Results are cached.

    Raises :class:`~granphon.base.errors.PrecisionError` if the steps do not settle where the medium is valid.
    """
    stages, tolerance = _STAGES, _LAST_COEFFICIENTS
    if shape.openings.size >= _MANY_OPENINGS:
        stages, tolerance = _STAGES_OF_SHORT, _LAST_OF_SHORT
    return solve_curve(shape, xi, make_averages(shape, xi), stages, tolerance)


def make_averages(shape: Shape, xi: float) -> Averages:
    """Return the source of the averages in equation (36) over the balls of a shape."""
    return PointAverages(shape, xi) if isinstance(shape, PointShape) else DensityAverages(shape, xi, _ORDER)


@dataclass(frozen=True)
class DensityAverages:
    """Averages over the balls of a shape by quadrature of the given ``order``, for the local-field factor ``xi``."""

    shape: Shape
    xi: float
    order: int

    def count(self, block: Block) -> int:
        """Return one: steps are long and few, and a step that must be halved would make the work on those below useless."""
        return 1

    def balls(self, block: Block) -> DensityBalls:
        """Return the averages at the points of the block, from quadrature nodes of each point."""
        y = block.y
        nodes = self.shape.nodes(y, self.order)
        force, stiffness = (of(y[..., None], nodes.positions) for of in (self.shape.force, self.shape.stiffness))
        common, known = self.shape.force(y), self.shape.stiffness(y)
        mean = np.sum(nodes.weights * stiffness, axis=-1)
        # on a short step differentiation amplifies the rounding of y and of the forces, which are counted from their mean
        amplified = block.root.shape[1] ** 2 * (common / known + np.abs(y))[:, -1:] / (4.0 * block.middle * block.half)
        noise = np.minimum(16.0 * np.finfo(float).eps * amplified[:, 0], _WORST_NOISE)
        return DensityBalls(self.xi, nodes.weights, force - common[..., None], stiffness, mean, common, known, noise)


@dataclass(frozen=True, eq=False)
class DensityBalls:
    """Averages by quadrature, as :class:`granphon.laws.collocation.Balls`.

    Forces are counted from the mean force ``common``, whose derivative is ``known``.
    """

    xi: float
    weights: Array
    force: Array
    stiffness: Array
    mean: Array
    common: Array
    known: Array
    noise: Array

    def balance(self, k: Array) -> tuple[Array, Array, Array]:
        """Return what :meth:`granphon.laws.collocation.Balls.balance` describes."""
        part = 1.0 / (self.stiffness + self.xi * k[..., None])
        share = self.weights * part
        total = np.sum(share, axis=-1)
        force = np.sum(share * self.force, axis=-1) / total
        by_k = -self.xi * np.sum(share * part * (self.force - force[..., None]), axis=-1) / total
        return force, by_k, (self.common + force)[:, 0]


@dataclass(frozen=True)
class EffectiveLaw(CurveLaw):
    """Contact law of the effective medium: balls displace their neighbours, and equation (36) holds.

    ``coefficient`` c (N/m^(3/2)) of equal balls, ``width`` W (m), ``shape`` of the distribution, ``xi`` the local-field
    factor. Energy is counted from the start of the curve. Methods raise :class:`~granphon.base.errors.PrecisionError`
    between the first contact and the start of the curve.
    """

    coefficient: float
    width: float
    shape: UniformShape | NormalShape | PointShape
    xi: float

    @property
    def curve(self) -> EffectiveCurve:
        """Reduced law, in units of W and c W^(3/2)."""
        return effective_curve(self.shape, self.xi)

    @property
    def _energy_offset(self) -> float:
        return self.curve.energy_offset

    def least_valid_force(self, width: float) -> float:
        """Return the force, N, from which the medium is valid by Section IV (f* = 0.08), for the ``width`` W, m.

        The limit was found by comparison with simulations of the triangular lattice.
        """
        return VALID_FORCE * WidthUnits(self.coefficient, width).force

    @property
    def _below(self) -> tuple[str, str]:
        """Reason why there is no solution below the curve, and advice to the user."""
        if self.curve.stiffness_vanishes:
            return (
                "The stiffness is zero there, and equation (36) has no solution at smaller forces",
                "Raise the load",
            )
        return f"There the effective medium is not solved (it is valid from f* = {VALID_FORCE:g})", "Raise the load"
