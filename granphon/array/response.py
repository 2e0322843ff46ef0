"""Elastic constants of a disordered array at rest: its linear response, with rotations and shear stiffness.

Every contact that carries load resists slip with eta times its normal stiffness, and twist and roll if so asked. Under a
small uniform strain each ball moves and turns until it is in balance again; the energy that the contacts then store is the
elastic energy. This rests on the contacts alone, without an effective medium or a conjecture about friction.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray

from granphon.array.equilibrium import Equilibrium, find_uniform_part
from granphon.array.linear_response import find_linear_response
from granphon.array.stencils import Stencils, dot
from granphon.dynamics.long_waves import voigt_pairs

Array = NDArray[np.float64]
#: relative error of linear responses; it enters squared, over the part of an affine strain's energy that is stored
_RESPONSE = 1e-7


def _strain_contacts(stencils: Stencils) -> Array:
    """Return (n strains, rows) deformations of each kind of contact under each unit strain, in Voigt order."""
    gradients = stencils.strains()
    return np.array([0.5 * (gradients[:, a, b] + gradients[:, b, a]) for a, b in voigt_pairs(len(stencils.shape))])


def elasticity(state: Equilibrium, shear: ArrayLike, torsion: ArrayLike = 0.0, bending: float = 0.0) -> Array:
    """Return the (n, n) elastic tensor of the sample, in Voigt order, with springs at every contact that carries load.

    Springs against slip, twist and roll have ``shear`` (eta), ``torsion`` and ``bending`` (over d^2) times the normal
    stiffness of their contact; shear and torsion are numbers, or one for each contact, (n_c, L1, ..., Lp). Energies are per
    d^p, and the unit is that of the contacts' stiffness. An error of the linear response enters squared. Raises
    :class:`~granphon.base.errors.ConvergenceError` if the response is not found.
    """
    own = state.stencils
    normal = state.stiffnesses
    # the array has one ratio for all contacts, on which its preconditioner is built: the mean, weighted by stiffness
    slip, twist = (np.asarray(ratio, float) for ratio in (shear, torsion))
    eta, mean = (float(np.sum(ratio * normal) / np.sum(normal)) if ratio.ndim else float(ratio) for ratio in (slip, twist))
    if not eta:  # only shear turns balls that are strained: without it twist and roll store nothing
        mean = bending = 0.0
    stencils = Stencils(own.shape, eta, own.workers, state.lattice, mean, bending)
    stiffness, n = stencils.weights(normal), stencils.n_contacts
    if twist.ndim and stencils.motions.twist and mean:
        first = len(stiffness) - (3 if bending else 1) * n  # the twist stands last, but for two rolls
        stiffness[first : first + n] = twist * normal
    if slip.ndim and eta:
        for first in range(n, n * len(state.lattice.vectors), n):  # one slip in a plane, two in space
            stiffness[first : first + n] = slip * normal
    affine = _strain_contacts(stencils)[(..., *(None,) * len(stencils.shape))]
    # tensions that are the same in all contacts of a kind are in balance if all balls are equivalent
    even = find_uniform_part(normal) if stencils.n_balls == 1 else 0.0
    means = stencils.weights(np.full((stencils.n_contacts, *(1,) * len(stencils.shape)), even))
    motions = find_linear_response(stencils, stiffness, ((stiffness - means) * one for one in affine), _RESPONSE)
    own.forget()  # many samples may be kept, each with a large Green's function
    measure = state.lattice.measure * np.prod(stencils.shape)
    tensor = np.zeros((len(affine), len(affine)))
    for a, motion in enumerate(motions):
        tension = stiffness * (affine[a] - stencils.operator.deform(motion))
        for at, other in enumerate(motions[: a + 1]):  # found again for each pair: all together would take much memory
            tensor[a, at] = tensor[at, a] = dot(tension, affine[at] - stencils.operator.deform(other))
    return tensor / measure
