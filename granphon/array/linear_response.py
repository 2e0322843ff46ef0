"""Linear response of an array at rest: the small motions of balls by which they follow tensions of their contacts.

Conjugate gradients solve C^T K C u = C^T t. In single precision an iteration takes half of the time; what its solution
leaves is found in double precision, and solved for again. Where that does not come nearer, as close to the rigidity
threshold, the iteration itself goes on in double precision.
"""

from __future__ import annotations

import math
from collections.abc import Iterable

import numpy as np
from numpy.typing import NDArray

from granphon.array.conjugate_gradients import conjugate_gradients
from granphon.array.preconditioners import Preconditioners
from granphon.array.residuals import Single
from granphon.array.stencils import Motion, Stencils, dot
from granphon.base.errors import ConvergenceError, message

Array = NDArray[np.float64]
#: largest number of iterations for a linear response
_MOST_ITERATIONS = 60_000
#: the least reduction that is asked of single precision at a time
_SINGLE = 1e-4
#: part of the energy of what was left before, from which single precision comes no nearer
_STALLED = 1e-2
#: fraction of a tension that rounding may leave unbalanced
_NOISE = 1e-14


def find_linear_response(stencils: Stencils, stiffness: Array, tensions: Iterable[Array], reduction: float) -> list[Array]:
    """Return the motions u (fields, L1, ..., Lp) that solve C^T K C u = C^T t for each of the ``tensions`` t of contacts.

    ``stiffness`` and tensions are (rows, L1, ..., Lp). The stiffness is zero where balls are apart; there the tensions must
    be zero too. The error of u in the energy norm is about ``reduction`` times u. Raises
    :class:`~granphon.base.errors.ConvergenceError` if conjugate gradients do not converge.
    """
    response = _Response(stencils, stiffness)
    return [response.follow(tension, reduction) for tension in tensions]


class _Response:
    """The equations of an array whose contacts have these ``springs``."""

    def __init__(self, stencils: Stencils, springs: Array) -> None:
        n = stencils.n_contacts
        self._stencils, self._springs, self._mean = stencils, springs, float(np.mean(springs[:n]))
        single: Single = (springs / self._mean).astype(np.float32)  # which has no numbers below 1e-38
        self._product = stencils.hessian(single)
        self._inverse = Preconditioners(stencils).choose(single, hard=True, product=self._product)

    def follow(self, tension: Array, reduction: float) -> Array:
        """Return the motions by which balls follow a tension; see :func:`find_linear_response`."""
        rest = self._pull(tension)
        found, taken, before = np.zeros_like(rest), 0, math.inf
        left = dot(rest, self._precondition(rest))
        # a tension that is in balance except for rounding moves nothing; squares of the smallest ones would vanish
        aim = max(reduction**2 * left, _NOISE**2 * _square(tension / self._mean))
        while aim < left < _STALLED * before:
            ahead, given = max(math.sqrt(aim / left), _SINGLE), rest.astype(np.float32)
            change, count, _ = conjugate_gradients(
                self._multiply, self._precondition, given, ahead, _MOST_ITERATIONS - taken
            )
            found, taken = found + change, taken + count
            rest = self._pull(tension - self._springs * self._deform(found))
            before, left = left, dot(rest, self._precondition(rest))
        if left > aim:
            ahead, most = math.sqrt(aim / left), _MOST_ITERATIONS - taken
            change, count, _ = conjugate_gradients(self._multiply_exactly, self._precondition, rest, ahead, most)
            if count == most:
                what = f"the linear response of the sample is not found in {_MOST_ITERATIONS} steps"
                raise ConvergenceError(message(what, mend="Raise the load"))
            found += change
        return found

    def _pull(self, tension: Array) -> Array:
        """Return the forces on balls, over the mean stiffness."""
        return self._stencils.forces(tension) / self._mean

    def _deform(self, balls: Array) -> Array:
        return self._stencils.deformations(Motion(balls, 0.0))

    def _multiply(self, balls: Single) -> Single:
        return self._product(balls, None)[0]

    def _multiply_exactly(self, balls: Array) -> Array:
        return self._pull(self._springs * self._deform(balls))

    def _precondition(self, force: Single) -> Single:
        return self._inverse(force.astype(np.float32, copy=False)).astype(force.dtype, copy=False)


def _square(vector: Array) -> float:
    return dot(vector, vector)
