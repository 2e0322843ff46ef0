"""The linear equations of a step of Newton's method, with the tangent of the law of friction.

The tangent C^T D C is not symmetric where contacts slide, or where the shear stiffness changes with the overlap. GMRES
solves the equations in single precision. The preconditioner moves each ball as if its neighbours were held, and then all by
Green's function of the lattice under what that leaves. Balls that hold each other while nothing else holds them are found by
what GMRES leaves on them, and are then moved together (:mod:`granphon.array.patches`).
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from granphon.array.contact_operator import ContactHessian
from granphon.array.friction import Tangent
from granphon.array.geometry import Inverse, Product, multiply
from granphon.array.patches import Indices, Patches, Put
from granphon.array.residuals import Single, solve_by_minimal_residuals
from granphon.array.stencils import Motion, dot

Array = NDArray[np.float64]
#: largest number of iterations, and the number after which balls that are held weakly are looked for
_MOST_ITERATIONS, _FEW = 300, 15


class LinearSteps:
    """Solver of the equations of steps that follow each other; it keeps the patch of weakly held balls.

    ``damped`` arrays have dashpots: few of their balls touch.
    """

    def __init__(self, patches: Patches, damped: bool) -> None:
        self._stencils, self._patches, self._damped = patches.stencils, patches, damped
        self._weak: Indices = np.empty(0, np.intp)
        self._put: Put | None = None

    def solve(
        self, product: Product, tangent: Tangent, pull: Array, push: float | None, reduction: float
    ) -> tuple[Motion, int]:
        """Return the motion that takes all but the part ``reduction`` of a ``pull`` away, and the number of iterations.

        The mean stiffness of the ``tangent`` is one; its ``product`` is that of the geometry. Without a ``push``, the force
        that the contacts lack in sum, the overlap stays as it is.
        """
        # the product of the lattice serves as it is in the true geometry too, where its own takes longer
        near = product if isinstance(product, ContactHessian) else multiply(self._stencils, tangent)
        size, inverse = pull.size, self.invert(tangent, near)
        held = np.float32(1.0 / tangent.stiffness.size)

        def apply(vector: Single) -> Single:
            change, force = product(vector[:size].reshape(pull.shape), None if push is None else float(vector[size]))
            return np.ravel(change) if push is None else np.append(change, np.float32(force))

        def precondition(vector: Single) -> Single:
            balls = inverse(vector[:size].reshape(pull.shape)).astype(np.float32, copy=False)
            return np.ravel(balls) if push is None else np.append(balls, held * vector[size])

        right = np.ravel(pull) if push is None else np.append(pull, push)
        found, rest, taken, most, renewed = np.zeros_like(right), right, 0, _FEW, False
        goal = left = reduction * math.sqrt(dot(right, right))
        while taken < _MOST_ITERATIONS and (left := math.sqrt(dot(rest, rest))) > goal:
            change, count = solve_by_minimal_residuals(apply, precondition, rest, goal / left, most)
            found += change
            taken += count
            if count < most:
                break
            rest = right - apply(found.astype(np.float32))
            weak = self._patches.join(self._weak, self._patches.find_worst(rest[:size].reshape(pull.shape)))
            if weak.size == self._weak.size and (renewed or not weak.size):  # the patch has no more to give
                most = _MOST_ITERATIONS - taken
            else:
                self._weak, self._put, renewed = weak, self._patches.invert(weak, tangent), True
        return Motion(found[:size].reshape(pull.shape), 0.0 if push is None else float(found[size])), taken

    def invert(self, tangent: Tangent, product: Product) -> Inverse:
        """Return an approximate inverse of C^T D C, of which ``product`` is the product.

        The patch may be that of a tangent before: it is made anew only when it does not serve any more.
        """
        stencils = self._stencils
        stiffnesses = np.concatenate([tangent.stiffness, tangent.springs.reshape(-1, *stencils.shape)])
        springs: Single = stiffnesses.astype(np.float32)
        smooth = stencils.block_jacobi(springs)
        green = stencils.green_preconditioner(springs.dtype, float(np.mean(springs[: stencils.n_contacts])))

        def apply(force: Single) -> Single:
            motion = np.zeros_like(force)
            smooth(force, motion)
            if self._put is not None:
                self._put(force, motion)
            # where few balls touch, Green's function would pass on what each ball's own motion leaves too far
            moved = green(force if self._damped else force - product(motion, None)[0])
            moved += motion
            return moved

        return apply
