"""The contact law of the cluster medium: a cluster of random balls among random balls, in the lattice that they make.

The equations are those of :mod:`granphon.laws.cluster_balance`; the curve is :mod:`granphon.laws.cluster_curve`.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from granphon.balls.distributions import NormalShape, PointShape, UniformShape
from granphon.balls.lattices import Lattice
from granphon.base.scales import WidthUnits
from granphon.laws.cluster_curve import ClusterCurve, cluster_curve
from granphon.laws.solved import CurveLaw
from granphon.laws.spread import Series

Array = NDArray[np.float64]
#: f* from which force and stiffness are within 2.5 % of the simulated array's, on the triangular lattice and in fcc
VALID_FORCE = 0.03


@dataclass(frozen=True)
class ClusterLaw(CurveLaw):
    """Contact law of a cluster medium.

    ``coefficient`` c (N/m^(3/2)) of equal balls, ``width`` W (m), ``shape`` of the distribution, the ``lattice``, its
    ``mindlin_ratio`` eta and ``bending`` (over k d^2), and the number of ``balls`` of the cluster. Energy is counted from
    the start of the curve. Methods raise :class:`~granphon.base.errors.PrecisionError` between the first contact and the
    start of the curve.
    """

    coefficient: float
    width: float
    shape: UniformShape | NormalShape | PointShape
    lattice: Lattice
    mindlin_ratio: float
    balls: int
    bending: float = 0.0

    @property
    def curve(self) -> ClusterCurve:
        """Reduced law, in units of W and c W^(3/2)."""
        return cluster_curve(self.shape, self.lattice, self.mindlin_ratio, self.balls, self.bending)

    @property
    def _series(self) -> Series:
        return self.curve.far

    @property
    def _energy_offset(self) -> float:
        return self.curve.energy_offset

    def least_valid_force(self, width: float) -> float:
        """Return the force, N, from which the medium is valid, f* = 0.03, for the ``width`` W, m."""
        return VALID_FORCE * WidthUnits(self.coefficient, width).force

    def quadrature_error(self, overlap: ArrayLike) -> ArrayLike:
        """Return the relative standard error of the force that is left by the quadrature, from its independent scrambles."""
        curve = self.curve

        def find(y: Array) -> Array:
            return np.asarray(np.interp(y, curve.nodes, curve.errors))

        return self._evaluate_joined(overlap, find, find)  # type: ignore[no-any-return]

    def force_fluctuation(self, overlap: ArrayLike) -> ArrayLike:
        """Return Delta f / f of Section IV: the rms deviation of the mean force on the ball in the middle, over the mean."""
        curve = self.curve

        def far(y: Array) -> Array:
            return np.asarray(curve.fluctuations[-1] * curve.nodes[-1] / y)

        def near(y: Array) -> Array:
            # times y + b it is smooth
            depth = curve.nodes + curve.offset
            return np.asarray(_interpolate(y, curve.nodes, curve.fluctuations * depth) / (y + curve.offset))

        return self._evaluate_joined(overlap, far, near)  # type: ignore[no-any-return]

    def contact_fraction(self, overlap: ArrayLike) -> ArrayLike:
        """Return the fraction of the contacts of the ball in the middle that carry force."""
        curve = self.curve

        def near(y: Array) -> Array:
            return np.clip(_interpolate(y, curve.nodes, curve.contacts), 0.0, 1.0)

        return self._evaluate_joined(overlap, np.ones_like, near)  # type: ignore[no-any-return]

    @property
    def _below(self) -> tuple[str, str]:
        """Reason why the curve ends, and advice to the user."""
        return f"There the cluster medium is not solved (it is valid from f* = {VALID_FORCE:g})", "Raise the load"


def _interpolate(y: Array, nodes: Array, values: Array) -> Array:
    """Interpolate between the nodes of a curve, without overshooting."""
    from scipy.interpolate import PchipInterpolator

    return np.asarray(PchipInterpolator(np.log(nodes - nodes[0] + 0.5), values)(np.log(y - nodes[0] + 0.5)))
