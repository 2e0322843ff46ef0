"""The eigenproblem of the dynamical matrix of a network: sparse factors, Ritz vectors, and what counts as solved."""

from __future__ import annotations

import math
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from granphon.array.sparse_matrices import factorise
from granphon.base.errors import ConvergenceError, InputError, InstabilityError, message
from granphon.base.text import counted
from granphon.waves.operator import WaveOperator

Array = NDArray[np.float64]
#: most motions of a network all of whose modes are found at once, by a dense matrix
DENSE = 600
#: frequency over the top frequency, at or below which a mode counts as one that costs no energy
ZERO = 1e-6
#: largest |D x - omega^2 x| / top^2 of a mode x of norm one; the error of omega^2 is its square over the distance of others
RESIDUAL = 1e-8
#: what to say of static forces
UNSTABLE = message(
    "the network is not stable: a squared frequency is below zero",
    "Its static forces exceed what its springs hold, so that it would buckle",
    "Bring it to rest first, give its tangential_force if it has friction, or leave the static forces out (prestress=False)",
)


class Eigenpairs(NamedTuple):
    """Angular frequencies ``omega`` (m,), rad/s, ascending; ``vectors`` (size, m) of norm one; largest ``residual``/top^2.

    ``zeros`` is the number of modes of the network that cost no energy; None if they were not counted.
    """

    omega: Array
    vectors: Array
    residual: float
    zeros: int | None


class Problem:
    """D on the motions ``live`` that some spring holds."""

    def __init__(self, operator: WaveOperator, live: NDArray[np.intp]) -> None:
        self.operator, self.live, self.top = operator, live, operator.top
        self.loose = operator.size - live.size

    def shifted(self, value: float) -> Any:
        """Return D - ``value``, sparse."""
        from scipy.sparse import eye_array

        held = self.operator.matrix[self.live][:, self.live] if self.loose else self.operator.matrix
        return (held - value * eye_array(self.live.size)).tocsc()

    def factors(self, value: float) -> Any:
        """Return the LU factors of D - ``value``, pivots on the diagonal."""
        for nudge in (0.0, 1e-9, -1e-7):
            try:
                return factorise(self.shifted(value + nudge * self.top**2))
            except RuntimeError:  # exactly singular: the value is an eigenvalue
                continue
        raise ConvergenceError(message("the matrix of the network cannot be factorised"))

    def count_below(self, value: float) -> int:
        """Return the number of eigenvalues below ``value``: that of the pivots below zero (Sylvester's law of inertia)."""
        factors = self.factors(value)
        if not np.array_equal(factors.perm_r, factors.perm_c):
            raise ConvergenceError(message("the factors of the matrix have pivots off the diagonal", "No modes are counted"))
        return int(np.sum(factors.U.diagonal() < 0.0))

    def refine(self, vectors: Array) -> tuple[Array, Array, Array]:
        """Return the frequencies, modes and residuals over top^2 within the space of ``vectors`` (live, m).

        Without static forces they are singular values and vectors of A, so that low frequencies lose no digits.
        """
        operator = self.operator
        whole = np.zeros((operator.size, vectors.shape[1]))
        whole[self.live] = np.linalg.qr(vectors)[0]
        pressed = operator.matrix @ whole
        if operator.network.prestress:
            squares, turned = np.linalg.eigh(whole.T @ pressed)
            if squares[0] < -find_limit(operator):
                raise InstabilityError(UNSTABLE)
            omega = np.sqrt(np.maximum(squares, 0.0))
        else:
            # the squares of R are those of A, whose rows are many more
            triangle = np.asarray(np.linalg.qr(operator.root @ whole, mode="r"))
            try:
                _, sizes, rows = np.linalg.svd(triangle)
            except np.linalg.LinAlgError:
                # LAPACK's fast method fails on some matrices with hundreds of singular values near zero; this does not
                from scipy.linalg import svd

                _, sizes, rows = svd(triangle, lapack_driver="gesvd")
            omega = np.zeros(len(rows))
            omega[: sizes.size] = sizes
            order = np.argsort(omega, kind="stable")
            omega, turned = omega[order], rows.T[:, order]
        whole, pressed = whole @ turned, pressed @ turned
        residual = np.linalg.norm(pressed - omega**2 * whole, axis=0) / self.top**2
        return omega, whole, residual

    def choose(self, omega: Array, count: int, target: float) -> NDArray[np.intp]:
        """Return the places of the ``count`` frequencies nearest to ``target`` that cost energy, ascending."""
        cost = np.flatnonzero(omega > ZERO * self.top)
        return np.sort(cost[np.argsort(np.abs(omega[cost] - target), kind="stable")[:count]])


def find_limit(operator: WaveOperator) -> float:
    """Return how far below zero a squared frequency of a stable network may be, (rad/s)^2.

    Static tangential forces set no limit: D, which lacks a part of them, lowers frequencies of zero.
    """
    return (ZERO * operator.top) ** 2 if operator.whole is None else math.inf


def make_too_few(there: int, count: int) -> InputError:
    """Return the error of ``count`` modes that are asked for where fewer are ``there``."""
    asked, among = counted(count, "mode is", "modes are"), f"only {there}" if there else "none"
    return InputError(message(f"{asked} asked for, and {among} cost energy", mend="Ask for fewer"))
