"""Eigenvectors of the dynamical matrix of a network, from frequency zero up or nearest to a frequency.

Small matrices are dense. Larger ones are factorised (sparse LU) at a shift, and Lanczos finds what is nearest to it; factors
also say, by Sylvester's law of inertia, how many eigenvalues are below a value, so that none is missed. Where factors would
be too large, a block of vectors is filtered by a bell around the frequency again and again until it holds the modes.
"""

from __future__ import annotations

import math
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from granphon.base.errors import ConvergenceError, InputError, InstabilityError, message
from granphon.waves.chebyshev import polynomials
from granphon.waves.operator import WaveOperator

__all__ = ["UNSTABLE", "Eigenpairs", "find_eigenpairs", "require_stable"]

Array = NDArray[np.float64]
#: frequency over the top frequency, at or below which a mode counts as one that costs no energy
ZERO = 1e-6
#: most motions of a dense matrix
_DENSE = 600
#: most motions of a matrix that is dense because many modes are wanted, or many cost no energy: 2 GB
_LARGEST = 10_000
#: most motions of a matrix that is factorised, for balls on a line, in a plane, in space: the factors take 1 GB at most
_FACTORED = {1: 1_000_000, 2: 300_000, 3: 12_000}
#: largest share of all modes that are found without all of them
_SHARE = 3
#: shift of the factors for the lowest modes, over top^2
_SHIFT = 1e-6
#: more vectors than are asked for
_SPARE = 8
#: largest |D x - omega^2 x| / top^2 of a mode x of norm one; the error of omega^2 is its square over the distance of others
_RESIDUAL = 1e-8
#: first standard deviation of the filter in theta, and most products of D with a vector
_FIRST, _PRODUCTS = 0.05, 100_000
#: number of terms of the filter, over the inverse of its standard deviation: what is left out is 1e-11
_TERMS = 3.5
#: distance of the farthest mode that is wanted, over the standard deviation of the filter
_REACH = 2.0
#: what to say of static forces
UNSTABLE = message(
    "the network is not stable: a squared frequency is below zero",
    "Its static forces exceed what its springs hold, so that it would buckle",
    "Bring it to rest first, or leave the static forces out (prestress=False)",
)


class Eigenpairs(NamedTuple):
    """Angular frequencies ``omega`` (m,), rad/s, ascending; ``vectors`` (size, m) of norm one; largest ``residual``/top^2.

    ``zeros`` is the number of modes of the network that cost no energy; None if they were not counted.
    """

    omega: Array
    vectors: Array
    residual: float
    zeros: int | None


def find_eigenpairs(operator: WaveOperator, count: int, target: float) -> Eigenpairs:
    """Return the ``count`` modes nearest to the angular frequency ``target``, rad/s, among those that cost energy.

    The network is to be stable, see :func:`require_stable`.
    """
    live = np.flatnonzero(np.diff(operator.matrix.indptr) > 0)
    problem = _Problem(operator, live)
    if count > live.size:
        raise _too_few(live.size, count)
    if live.size <= _DENSE or count * _SHARE > live.size:
        found = _find_dense(problem, count, target)
    elif live.size <= _FACTORED[operator.network.dimension]:
        found = _find_factored(problem, count, target)
    else:
        found = _find_filtered(problem, count, target)
    return found


def require_stable(operator: WaveOperator) -> None:
    """Raise :class:`~granphon.base.errors.InstabilityError` if a squared frequency is below zero.

    Only static forces make one. Networks too large to be factorised are left to the growth of their polynomials.
    """
    if operator.network.prestress and operator.size <= _FACTORED[operator.network.dimension]:
        problem = _Problem(operator, np.arange(operator.size))
        if problem.count_below(-((ZERO * operator.top) ** 2)) > 0:
            raise InstabilityError(UNSTABLE)


def _too_few(there: int, count: int) -> InputError:
    return InputError(message(f"{count} modes are asked for, and only {there} cost energy", mend="Ask for fewer"))


class _Problem:
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
        from scipy.sparse.linalg import splu

        for nudge in (0.0, 1e-9, -1e-7):
            try:
                return splu(
                    self.shifted(value + nudge * self.top**2), permc_spec="MMD_AT_PLUS_A", diag_pivot_thresh=0.0,
                    options={"SymmetricMode": True},
                )  # fmt: skip
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
            if squares[0] < -((ZERO * self.top) ** 2):
                raise InstabilityError(UNSTABLE)
            omega = np.sqrt(np.maximum(squares, 0.0))
        else:
            # the squares of R are those of A, whose rows are many more
            _, sizes, rows = np.linalg.svd(np.linalg.qr(operator.root @ whole, mode="r"))
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


def _find_dense(problem: _Problem, count: int, target: float) -> Eigenpairs:
    from scipy.linalg import eigh

    if problem.live.size > _LARGEST:
        raise InputError(
            message(f"{count} modes of {problem.live.size} motions, with those without energy, are too many to be found",
                    mend="Ask for fewer")
        )  # fmt: skip
    squares, vectors = eigh(problem.shifted(0.0).toarray())
    limit = (ZERO * problem.top) ** 2
    if squares[0] < -limit:
        raise InstabilityError(UNSTABLE)
    omega = np.sqrt(np.maximum(squares, 0.0))
    chosen = problem.choose(omega, count, target)
    if chosen.size < count:
        raise _too_few(chosen.size, count)
    zeros = int(np.sum(omega <= ZERO * problem.top))
    omega, vectors, residual = problem.refine(vectors[:, chosen])
    return Eigenpairs(omega, vectors, float(residual.max()), problem.loose + zeros)


def _find_factored(problem: _Problem, count: int, target: float) -> Eigenpairs:
    from scipy.sparse.linalg import LinearOperator, eigsh

    size, top = problem.live.size, problem.top
    zero = ZERO * top
    zeros = problem.count_below(zero**2)
    if count > size - zeros:
        raise _too_few(size - zeros, count)
    lowest = target <= zero
    shift = -_SHIFT * top**2 if lowest else target**2
    solve = problem.factors(shift).solve
    wanted = count + _SPARE + (zeros if lowest else 0)
    start = np.random.default_rng(0).normal(size=size)
    while wanted * _SHARE <= size:
        inverse = LinearOperator((size, size), matvec=solve, dtype=np.float64)
        _, vectors = eigsh(problem.shifted(0.0), k=wanted, sigma=shift, OPinv=inverse, v0=start)
        omega, vectors, residual = problem.refine(vectors)
        chosen = problem.choose(omega, count, target)
        if chosen.size == count and np.max(residual[chosen]) <= _RESIDUAL:
            # all modes as near as the farthest one that was chosen, and no further ones, are to be there
            reach = np.max(np.abs(omega[chosen] - target)) * (1.0 - 1e-9)
            low, high = max(target - reach, zero), target + reach
            below = zeros if low == zero else problem.count_below(low**2)
            if problem.count_below(high**2) - below == np.sum((omega > low) & (omega < high)):
                return Eigenpairs(omega[chosen], vectors[:, chosen], float(residual[chosen].max()), problem.loose + zeros)
        wanted *= 2
    return _find_dense(problem, count, target)


def _find_filtered(problem: _Problem, count: int, target: float) -> Eigenpairs:
    operator, top = problem.operator, problem.top
    vectors = np.random.default_rng(0).normal(size=(problem.live.size, count + max(_SPARE, count)))
    width, last, worst, left = _FIRST, np.zeros(0), math.inf, _PRODUCTS
    while (left := left - math.ceil(_TERMS / width) * vectors.shape[1]) >= 0:
        block = np.zeros((operator.size, vectors.shape[1]), order="F")
        block[problem.live] = vectors
        omega, whole, residual = problem.refine(_filtered(operator, block, target, width)[problem.live])
        vectors, chosen = whole[problem.live], problem.choose(omega, count, target)
        zeros = int(np.sum(omega <= ZERO * top))
        if zeros + count + _SPARE > vectors.shape[1]:  # modes that cost nothing take the places of those that are wanted
            if 2 * vectors.shape[1] * _SHARE > len(vectors):
                return _find_dense(problem, count, target)
            more = np.random.default_rng(vectors.shape[1]).normal(size=vectors.shape)
            vectors = np.concatenate([vectors, more], axis=1)
            continue
        worst = float(np.max(residual[chosen]))
        # the same twice: another round has found none that is nearer
        if worst <= _RESIDUAL and last.size == count and np.allclose(omega[chosen], last, rtol=0.0, atol=_RESIDUAL * top):
            counted = problem.loose + zeros if target <= ZERO * top else None
            return Eigenpairs(omega[chosen], whole[:, chosen], worst, counted)
        last, reach = omega[chosen], float(np.max(np.abs(omega[chosen] - target)))
        across = max(math.sqrt(max(1.0 - (target / top) ** 2, 0.0)), _FIRST)
        width = max(reach / (_REACH * top * across), 0.25 * width)
    raise ConvergenceError(
        message(f"the modes take more than {_PRODUCTS} products of D with a vector; so far their residuals are {worst:.1g}",
                "In a large network modes of one frequency range lie close together",
                "Take a smaller network, or its density of states")
    )  # fmt: skip


def _filtered(operator: WaveOperator, block: Array, target: float, width: float) -> Array:
    """Return a bell around ``target``, as a function of D, times the vectors of ``block``.

    It is a Gaussian in theta, omega = top cos(theta), of the standard deviation ``width``; it falls steadily on both sides.
    """
    order = np.arange(math.ceil(_TERMS / width))
    bell = np.where(order > 0, 2.0, 1.0) * np.exp(-2.0 * (order * width) ** 2)
    bell *= np.cos(2.0 * order * math.acos(min(target / operator.top, 1.0)))
    total = np.zeros_like(block)
    for factor, x in zip(bell.tolist(), polynomials(operator, block), strict=False):
        total += factor * x
    return total
