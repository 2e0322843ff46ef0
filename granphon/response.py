"""Elastic constants of a disordered array at rest: its linear response, with rotations and shear stiffness.

Every contact that carries load resists slip with eta times its normal stiffness. Under a small uniform strain each ball
moves and turns until it is in balance again, and what the contacts then store is the elastic energy. No effective medium,
no conjecture about friction: only the contacts, as they are.
"""

from __future__ import annotations

from functools import cache
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from granphon.equilibrium import Equilibrium, linear_response, uniform_part
from granphon.geometry import TRIANGULAR
from granphon.stencils import Motion, Stencils, dot

__all__ = ["Elasticity", "elasticity"]

Array = NDArray[np.float64]


class Elasticity(NamedTuple):
    """``tensor`` (3, 3) in Voigt order xx, yy, xy, and its derivative by y; per area d^2, in units of the contacts'."""

    tensor: Array
    slope: Array


@cache
def _strained() -> tuple[Array, Array]:
    """(3 strains, 3 contacts): elongation n.e.n and slip t.e.n of each kind of contact under each unit strain."""
    table = TRIANGULAR.contacts
    strains = np.array([[[1.0, 0.0], [0.0, 0.0]], [[0.0, 0.0], [0.0, 1.0]], [[0.0, 0.5], [0.5, 0.0]]])
    return (
        np.einsum("ci,sij,cj->sc", table.normal, strains, table.normal),
        np.einsum("ci,sij,cj->sc", table.tangent, strains, table.normal),
    )


def elasticity(state: Equilibrium, mindlin_ratio: float) -> Elasticity:
    """The elastic tensor of the sample with shear springs eta k at every contact that carries load.

    The slope takes it that the springs change along the sample's own equilibria. An error of the linear response enters the
    tensor squared, and the slope once. :class:`~granphon.errors.ConvergenceError` if that is not found.
    """
    stencils = Stencils(state.deviations.shape, mindlin_ratio, state.stencils.workers)
    normal = state.stiffnesses
    stiffness, changes = stencils.weights(normal), stencils.weights(state.stiffness_slopes * state.response())
    affine = np.concatenate(_strained()[: 1 + (mindlin_ratio > 0.0)], axis=1)[..., None, None]
    means = stencils.weights(np.full((3, 1, 1), uniform_part(normal)))
    motions = [linear_response(stencils, stiffness, (stiffness - means) * one) for one in affine]
    strains = [one - stencils.deformations(Motion(motion, 0.0)) for one, motion in zip(affine, motions, strict=True)]
    state.stencils.forget()  # of many samples that are kept
    area = TRIANGULAR.area * state.deviations.size
    tensor, slope = (
        np.array([[dot(weight * a, b) for b in strains] for a in strains]) / area for weight in (stiffness, changes)
    )
    return Elasticity(tensor, slope)
