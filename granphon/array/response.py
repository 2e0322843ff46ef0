"""Elastic constants of a disordered array at rest: its linear response, with rotations and shear stiffness.

Every contact that carries load resists slip with eta times its normal stiffness. Under a small uniform strain each ball
moves and turns until it is in balance again; the energy that the contacts then store is the elastic energy. This rests on
the contacts alone, without an effective medium or a conjecture about friction.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from granphon.array.equilibrium import Equilibrium, find_linear_response, find_uniform_part
from granphon.array.stencils import Motion, Stencils, dot
from granphon.balls.lattices import TRIANGULAR
from granphon.balls.motions import select_motions
from granphon.dynamics.rows import contact_rows, strain_rows

__all__ = ["bulk_and_shear", "elasticity", "shears"]

Array = NDArray[np.float64]


def _strain_contacts(mindlin_ratio: float) -> Array:
    """Return (3 strains, rows) elongations n.e.n, then slips t.e.n, of each kind of contact under each unit strain."""
    table, motions = TRIANGULAR.contacts, select_motions(mindlin_ratio)
    rows = contact_rows(table.normal, table.arm_i, table.arm_j, motions, slip=mindlin_ratio)
    strains = np.array([[[1.0, 0.0], [0.0, 0.0]], [[0.0, 0.0], [0.0, 1.0]], [[0.0, 0.5], [0.5, 0.0]]])
    gradients = np.concatenate([strain_rows(row, table.vector, motions) for row in rows])
    return np.asarray(np.einsum("rij,sij->sr", gradients, strains))


def elasticity(state: Equilibrium, mindlin_ratio: float) -> Array:
    """Return the (3, 3) elastic tensor of the sample with shear springs eta k at every contact that carries load.

    Voigt order is xx, yy, xy; energies are per area d^2, and the unit is that of the contacts' stiffness. An error of the
    linear response enters squared. Raises :class:`~granphon.base.errors.ConvergenceError` if the response is not found.
    """
    stencils = Stencils(state.deviations.shape, mindlin_ratio, state.stencils.workers)
    normal = state.stiffnesses
    stiffness = stencils.weights(normal)
    affine = _strain_contacts(mindlin_ratio)[..., None, None]
    means = stencils.weights(np.full((3, 1, 1), find_uniform_part(normal)))
    motions = find_linear_response(stencils, stiffness, ((stiffness - means) * one for one in affine))
    strains = [one - stencils.deformations(Motion(motion, 0.0)) for one, motion in zip(affine, motions, strict=True)]
    state.stencils.forget()  # many samples may be kept, each with a large Green's function
    area = TRIANGULAR.measure * state.deviations.size
    return np.array([[dot(stiffness * a, b) for b in strains] for a in strains]) / area


def shears(tensor: Array) -> Array:
    """Return (..., 2) shear moduli G of an elastic tensor (..., 3, 3): for the shear xx - yy, then for xy."""
    c = tensor
    return np.stack([(c[..., 0, 0] + c[..., 1, 1] - 2.0 * c[..., 0, 1]) / 4.0, c[..., 2, 2]], axis=-1)


def bulk_and_shear(tensor: Array) -> Array:
    """Return (..., 2) K and G of a nearly isotropic elastic tensor (..., 3, 3); G is the mean over its two orientations."""
    return np.stack([np.sum(tensor[..., :2, :2], axis=(-2, -1)) / 4.0, np.mean(shears(tensor), axis=-1)], axis=-1)
