"""Elastic constants of a disordered array at rest: its linear response, with rotations and shear stiffness.

Every contact that carries load resists slip with eta times its normal stiffness. Under a small uniform strain each ball
moves and turns until it is in balance again, and what the contacts then store is the elastic energy. No effective medium,
no conjecture about friction: only the contacts, as they are.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from granphon.array.equilibrium import Equilibrium, linear_response, uniform_part
from granphon.array.stencils import Motion, Stencils, dot
from granphon.balls.lattices import TRIANGULAR
from granphon.balls.motions import select_motions
from granphon.dynamics.rows import contact_rows, strain_rows

__all__ = ["bulk_and_shear", "elasticity", "shears"]

Array = NDArray[np.float64]


def _strain(mindlin_ratio: float) -> Array:
    """(3 strains, rows): elongation n.e.n, then slip t.e.n, of each kind of contact under each unit strain."""
    table, motions = TRIANGULAR.contacts, select_motions(mindlin_ratio)
    rows = contact_rows(table.normal, table.arm_i, table.arm_j, motions, slip=mindlin_ratio)
    strains = np.array([[[1.0, 0.0], [0.0, 0.0]], [[0.0, 0.0], [0.0, 1.0]], [[0.0, 0.5], [0.5, 0.0]]])
    gradients = np.concatenate([strain_rows(row, table.vector, motions) for row in rows])
    return np.asarray(np.einsum("rij,sij->sr", gradients, strains))


def elasticity(state: Equilibrium, mindlin_ratio: float) -> Array:
    """(3, 3) the elastic tensor of the sample with shear springs eta k at every contact that carries load.

    In Voigt order xx, yy, xy, per area d^2, in units of the contacts' stiffness. An error of the linear response enters it
    squared. :class:`~granphon.base.errors.ConvergenceError` if that is not found.
    """
    stencils = Stencils(state.deviations.shape, mindlin_ratio, state.stencils.workers)
    normal = state.stiffnesses
    stiffness = stencils.weights(normal)
    affine = _strain(mindlin_ratio)[..., None, None]
    means = stencils.weights(np.full((3, 1, 1), uniform_part(normal)))
    motions = [linear_response(stencils, stiffness, (stiffness - means) * one) for one in affine]
    strains = [one - stencils.deformations(Motion(motion, 0.0)) for one, motion in zip(affine, motions, strict=True)]
    state.stencils.forget()  # of many samples that are kept
    area = TRIANGULAR.area * state.deviations.size
    return np.array([[dot(stiffness * a, b) for b in strains] for a in strains]) / area


def shears(tensor: Array) -> Array:
    """(..., 2) G of an elastic tensor (..., 3, 3) for the shear xx - yy, and for xy."""
    c = tensor
    return np.stack([(c[..., 0, 0] + c[..., 1, 1] - 2.0 * c[..., 0, 1]) / 4.0, c[..., 2, 2]], axis=-1)


def bulk_and_shear(tensor: Array) -> Array:
    """(..., 2) K and G of an elastic tensor (..., 3, 3), isotropic or nearly: G is the mean of its two orientations."""
    return np.stack([np.sum(tensor[..., :2, :2], axis=(-2, -1)) / 4.0, np.mean(shears(tensor), axis=-1)], axis=-1)
