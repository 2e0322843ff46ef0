"""Small motions of the balls of an array whose contacts keep the directions of the lattice, by
conjugate gradients on the grid.

They solve C^T K C u = f with the shifts and the Green's function of
:mod:`granphon.array.stencils`, which take less memory than a list of contacts. In single precision
an iteration takes half of the time; the residual of its solution is found in double precision, and
is the right side of the next iteration. Where this does not come nearer to the solution, as close
to the rigidity threshold, the iteration itself goes on in double precision.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable

import numpy as np

from granphon.array.contact_lists import Springs, list_on_lattice
from granphon.array.krylov import Single, conjugate_gradients
from granphon.array.stencils import Stencils, dot
from granphon.base.arrays import Array
from granphon.base.errors import ConvergenceError
from granphon.contacts.shift_product import ContactHessian
from granphon.dynamics.elasticity import voigt_pairs
from granphon.statics.options import RestOptions
from granphon.statics.stiff_factors import factorise_stiff

#: largest number of iterations for a linear response
_MOST_ITERATIONS = 60_000
#: least reduction of the error that one iteration in single precision is asked for
_SINGLE = 1e-4
#: square of the error after an iteration in single precision, over that before, from which such
#: iterations count as coming no nearer
_STALLED = 1e-2
#: fraction of a tension that rounding may leave unbalanced
_NOISE = 1e-14
#: relative error of the motions under a strain, which enters elastic constants squared
_ELASTIC = 1e-7


def find_tensor_on_grid(stencils: Stencils, springs: Array) -> Array:
    """Return the (n, n) elastic tensor of an array in Voigt order, per d^p of its cells.

    ``springs`` (rows, L1, ..., Lp) are the stiffnesses of all deformations of the ``stencils``, and
    the tensor is in the unit of these stiffnesses. Errors are those of
    :func:`find_linear_response`.
    """
    p = len(stencils.shape)
    gradients = stencils.strains()
    unit = np.array([0.5 * (gradients[:, a, b] + gradients[:, b, a]) for a, b in voigt_pairs(p)])
    affine = unit[(..., *(None,) * p)]
    mean = float(np.mean(springs[: stencils.n_contacts]))
    motions = []
    for strain in affine:
        tensions = float(np.sum(springs**2 * strain**2)) / mean**2
        forces = [stencils.forces(springs * strain)]
        motions += find_linear_response(stencils, springs, forces, _ELASTIC, tensions)
    tensor = np.zeros((len(affine), len(affine)))
    for a, motion in enumerate(motions):
        tension = springs * (affine[a] - stencils.operator.deform(motion))
        for b, other in enumerate(motions[: a + 1]):
            # found again for each pair: the deformations of all strains would take much memory
            deformation = affine[b] - stencils.operator.deform(other)
            tensor[a, b] = dot(tension, deformation)
            tensor[b, a] = tensor[a, b]
    return tensor / (stencils.lattice.measure * math.prod(stencils.shape))


def find_linear_response(
    stencils: Stencils,
    springs: Array,
    forces: Iterable[Array],
    reduction: float,
    tensions: float,
) -> list[Array]:
    """Return the motions u (fields, L1, ..., Lp) that solve C^T K C u = f for each of the
    ``forces`` f on balls, (fields, L1, ..., Lp) in the coordinates of motions.

    The stiffnesses ``springs`` are (rows, L1, ..., Lp), zero where balls are apart; such contacts
    exert no force. The error of u in the norm of the energy, as the preconditioner estimates it, is
    about ``reduction`` times u.
    ``tensions`` is the sum of the squares of the tensions of contacts that make the forces, over
    the square of the mean stiffness: forces as small as the rounding of these tensions count as
    zero. Raises :class:`~granphon.base.errors.ConvergenceError` if conjugate gradients do not
    converge.
    """
    mean = float(np.mean(springs[: stencils.n_contacts]))
    # divided by the mean, as single precision has no numbers below 1e-38
    single: Single = (springs / mean).astype(np.float32)
    product = stencils.hessian(single)
    inverse = _find_inverse(stencils, single, product)

    def resist(balls: Array) -> Array:
        """Return the forces on balls against motions, over the mean stiffness."""
        return stencils.forces(springs * stencils.operator.deform(balls)) / mean

    def precondition(force: Single) -> Single:
        """Return approximate motions under a ``force``, in the precision of the force."""
        return inverse(force.astype(np.float32, copy=False)).astype(force.dtype, copy=False)

    def solve(force: Array) -> Array:
        """Return the motions under forces on balls."""
        right = force / mean
        residual = right
        motion = np.zeros_like(residual)
        n_iterations = 0
        # squares of the error in the norm of the energy, as the preconditioner estimates it
        last_square = math.inf
        square = dot(residual, precondition(residual))
        aim = max(reduction**2 * square, _NOISE**2 * tensions)
        # in single precision, refined by residuals in double precision
        while aim < square < _STALLED * last_square:
            ahead = max(math.sqrt(aim / square), _SINGLE)
            rounded = residual.astype(np.float32)
            most = _MOST_ITERATIONS - n_iterations
            change, count = conjugate_gradients(
                lambda balls: product(balls)[0], precondition, rounded, ahead, most
            )
            motion = motion + change
            n_iterations = n_iterations + count
            residual = right - resist(motion)
            last_square = square
            square = dot(residual, precondition(residual))
        if square <= aim:
            return motion
        # in double precision where that has stalled
        most = _MOST_ITERATIONS - n_iterations
        ahead = math.sqrt(aim / square)
        change, count = conjugate_gradients(resist, precondition, residual, ahead, most)
        if count == most:
            raise ConvergenceError(
                f"the linear response of the sample is not found in {_MOST_ITERATIONS} steps",
                mend="Raise the load",
            )
        return motion + change

    return [solve(force) for force in forces]


def _find_inverse(
    stencils: Stencils, springs: Single, product: ContactHessian
) -> Callable[[Array], Array]:
    """Return an approximate inverse of C^T K C, a function of forces (fields, L1, ..., Lp).

    Where few contacts are stiff and the array is small enough, it consists of factors of the stiff
    contacts' matrix, otherwise of Green's function. ``springs`` are those of
    :func:`find_linear_response` over their mean, and ``product`` is that of C^T K C.
    """
    p = len(stencils.shape)
    options = RestOptions()
    normal = springs[: stencils.n_contacts].astype(float)
    stiff = float(np.mean(normal > options.stiff * np.mean(normal)))
    is_small = math.prod(stencils.ball_shape) <= options.most_factorised[p]
    if stiff > options.most_stiff[p] or not is_small:
        return stencils.preconditioner(springs, product)
    groups = stencils.sort_springs(springs.astype(float))
    contacts = list_on_lattice(
        stencils.shape, stencils.lattice, stencils.motions, Springs.of(*groups)
    )
    solve = factorise_stiff(contacts.columns, contacts.axes, contacts.n_balls, options)

    def apply(force: Array) -> Array:
        """Return approximate motions under a ``force``, both (fields, L1, ..., Lp)."""
        motions = solve(stencils.list_forces(force).ravel())
        return stencils.gather_motions(motions.reshape(contacts.n_balls, -1))

    return apply
