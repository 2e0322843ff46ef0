"""Modes of finite networks: the lowest, or those nearest to a frequency.

Small matrices are dense. Larger ones are factorised (sparse LU) at a shift, and Lanczos finds the modes nearest to it; the
factors also say, by Sylvester's law of inertia, how many eigenvalues are below a value, so that none is missed. Where the
factors would be too large, modes are filtered out of random vectors (:mod:`granphon.waves.filtering`).
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

from granphon.array.sparse_matrices import factorise
from granphon.base.errors import InputError, InstabilityError, message
from granphon.base.results import Result
from granphon.base.validation import not_negative, whole_number
from granphon.dynamics.damping import ContactDamping, DampedModes, damp_evenly, damp_unevenly
from granphon.networks.network import ContactNetwork
from granphon.waves.eigenproblem import DENSE, RESIDUAL, UNSTABLE, ZERO, Eigenpairs, Problem, find_limit, make_too_few
from granphon.waves.filtering import find_filtered
from granphon.waves.operator import WaveOperator

Array = NDArray[np.float64]
#: most motions of a matrix that is dense because many modes are wanted, or many cost no energy: 2 GB
_LARGEST = 10_000
#: most motions of a matrix that is factorised, for balls on a line, in a plane, in space: the factors take 1 GB at most
LARGEST_FACTORS = {1: 1_000_000, 2: 300_000, 3: 12_000}
#: largest share of all modes that are found without all of them
_SHARE = 3
#: shift of the factors for the lowest modes, over top^2
_SHIFT = 1e-6
#: products with D that tell whether a network too large to be factorised is stable: eigenvalues are seen to 1e-5 of the top
_KRYLOV = 400
#: part of the largest entry of a column from which a pivot of a damped matrix is taken on the diagonal
PIVOT = 0.1
#: more vectors than are asked for
_SPARE = 8


@dataclass(frozen=True, eq=False, repr=False)
class NetworkModes(Result):
    """Modes of a network that cost energy.

    Attributes
    ----------
    frequencies : (m,) Hz, ascending.
    vectors : (m, n_balls, motions) the modes, real, of norm one, weighted with masses: M^1/2 times displacements u, and
        M^1/2 w, w = (I/M)^1/2 phi, of the rotations. Balls that do not move have zeros. The largest number is above zero.
        Modes of one frequency are any basis of their space.
    displacements : number of the motions that are displacements: the others are rotations.
    moving : number of the balls that move.
    zero_modes : number of modes of the network that cost no energy, at or below 1e-6 of the top frequency: of the whole at
        rest, of balls that nothing holds, of mechanisms. They are not among the modes. None if they were not counted,
        which is so in a network too large to be factorised, unless the lowest modes are asked for and balls held by contacts
        have few of them, about 48 or less.
    residual : largest ``|D x - omega^2 x|`` / top^2 of a mode x.
    network : the network whose modes these are.
    """

    units = {"frequencies": "Hz"}
    _shapes = {"frequencies": "m", "vectors": "m n c"}

    frequencies: Array
    vectors: Array
    displacements: int
    moving: int
    zero_modes: int | None
    residual: float
    network: ContactNetwork = field(repr=False)

    @property
    def _energies(self) -> Array:
        """(m, n_balls, 2) share of each ball in the kinetic energy of a mode: of displacements, and of rotations."""
        squares = self.vectors**2
        parts = (squares[..., : self.displacements], squares[..., self.displacements :])
        return np.stack([part.sum(axis=2) for part in parts], axis=-1)

    @property
    def participation_ratio(self) -> Array:
        """(m,) (sum e)^2 / (N sum e^2) of the kinetic energies e of the N balls that move: from 1/N, if one moves, to 1."""
        energies = self._energies.sum(axis=2)
        return np.asarray(energies.sum(axis=1) ** 2 / (self.moving * np.sum(energies**2, axis=1)))

    @property
    def rotational_fraction(self) -> Array:
        """(m,) share of rotations in the kinetic energy."""
        return np.asarray(self._energies[..., 1].sum(axis=1))


def find_modes(operator: WaveOperator, count: int, nearest: float | None) -> NetworkModes:
    """Return modes of a network that is stable, see :func:`require_stable`; for the rest see ``Waves.modes``."""
    count = whole_number("count", count, 1)
    target = 0.0 if nearest is None else 2.0 * math.pi * not_negative("nearest", nearest, "Hz")
    if target > operator.top:
        top = operator.top / (2.0 * math.pi)
        raise InputError(message(f"the network has no modes near {nearest:g} Hz", f"All frequencies are below {top:.6g} Hz"))
    problem = Problem(operator, np.flatnonzero(np.diff(operator.matrix.indptr) > 0))
    size = problem.live.size
    if count > size:
        raise make_too_few(size, count)
    if size <= DENSE or count * _SHARE > size:
        pairs = _find_dense(problem, count, target)
    elif size <= LARGEST_FACTORS[operator.network.dimension]:
        pairs = _find_factored(problem, count, target)
    else:
        pairs = find_filtered(problem, count, target) or _find_dense(problem, count, target)
    network, motions = operator.network, operator.motions
    vectors = np.zeros((count, network.n_balls, motions.count))
    vectors[:, operator.balls] = np.moveaxis(operator.values(pairs.vectors), -1, 0)
    largest = np.argmax(np.abs(pairs.vectors), axis=0)
    vectors *= np.sign(pairs.vectors[largest, np.arange(count)])[:, None, None]
    return NetworkModes(
        pairs.omega / (2.0 * math.pi),
        vectors,
        len(motions.translations),
        operator.balls.size,
        pairs.zeros,
        pairs.residual,
        network,
    )


def find_damped(
    operator: WaveOperator, count: int, nearest: float | None, damping: Any = 0.0, loss_factor: Any = 0.0
) -> DampedModes:
    """Return damped modes of a network that is stable; see :meth:`granphon.waves.waves.Waves.damped_modes`."""
    network, motions, damped = operator.network, operator.motions, ContactDamping.of(operator.network, damping, loss_factor)
    even = damped.find_even(network)
    if even is not None:
        modes = find_modes(operator, count, nearest)
        omega = damp_evenly(2.0 * math.pi * modes.frequencies, *even)
        return DampedModes(omega / (2.0 * math.pi), modes.vectors.astype(complex))
    count = whole_number("count", count, 1)
    target = 0.0 if nearest is None else 2.0 * math.pi * not_negative("nearest", nearest, "Hz")
    n, top, matrix = operator.size, operator.top, operator.matrix
    lost, viscous = (operator.weigh(one) for one in (damped.losses, damped.times))
    if 2 * n <= DENSE:  # the size of the matrix of first order
        omega, vectors = damp_unevenly((matrix + 1j * lost).toarray(), viscous.toarray())
    elif n <= LARGEST_FACTORS[network.dimension]:
        omega, vectors = _follow_damped((matrix + 1j * lost) / top**2, viscous / top, 2 * count + _SPARE, target / top)
        omega = omega * top
    else:
        mend = "Damp all contacts alike, or take a smaller network"
        raise InputError(message(f"{n:,} motions that are damped unevenly are too many", mend=mend))
    cost = np.flatnonzero((omega.real > ZERO * top) | (omega.imag > ZERO * top) & (omega.real > -ZERO * top))
    chosen = cost[np.argsort(np.abs(omega[cost].real - target), kind="stable")[:count]]
    if chosen.size < count:
        raise make_too_few(chosen.size, count)
    chosen = chosen[np.argsort(omega[chosen].real, kind="stable")]
    whole = np.zeros((count, network.n_balls, motions.count), complex)
    whole[:, operator.balls] = np.moveaxis(operator.values(vectors[:, chosen]), -1, 0)
    return DampedModes(omega[chosen] / (2.0 * math.pi), whole)


def _follow_damped(stiffness: Any, viscous: Any, wanted: int, target: float) -> tuple[Any, Any]:
    """Return omega (m,) nearest to ``target`` of x'' + G x' + D x = 0, and vectors (size, m), by Arnoldi at a shift.

    With y = x', ((0, 1), (-D, -G)) - s is solved by the factors of D + s G + s^2.
    """
    from scipy.sparse import eye_array
    from scipy.sparse.linalg import LinearOperator, eigs

    n, shift = stiffness.shape[0], math.sqrt(_SHIFT) + 1j * target
    unit: Any = eye_array(n)
    factors = factorise((stiffness + shift * viscous + shift**2 * unit).astype(complex), pivot=PIVOT)

    def apply(z: Any) -> Any:
        return np.concatenate([z[n:], -(stiffness @ z[:n]) - viscous @ z[n:]])

    def solve(z: Any) -> Any:
        x = -factors.solve(z[n:] + viscous @ z[:n] + shift * z[:n])
        return np.concatenate([x, z[:n] + shift * x])

    whole, inverse = (LinearOperator((2 * n, 2 * n), matvec=one, dtype=complex) for one in (apply, solve))
    start = np.random.default_rng(0).normal(size=2 * n).astype(complex)
    rates, vectors = eigs(whole, k=min(wanted, n), sigma=shift, OPinv=inverse, v0=start)
    return -1j * rates, vectors[:n] / np.linalg.norm(vectors[:n], axis=0)


def require_stable(operator: WaveOperator) -> None:
    """Raise :class:`~granphon.base.errors.InstabilityError` if a squared frequency is below zero.

    Only static forces make one. Of networks too large to be factorised the lowest Ritz value of a Krylov space decides.
    """
    if not operator.network.prestress:
        return
    limit = find_limit(operator)
    if operator.size <= LARGEST_FACTORS[operator.network.dimension]:
        stable = Problem(operator, np.arange(operator.size)).count_below(-limit) == 0
    else:  # Lanczos: the Krylov space of a random vector, whose lowest Ritz value is above the lowest eigenvalue
        from scipy.linalg import eigvalsh_tridiagonal

        x = np.random.default_rng(0).normal(size=operator.size)
        x /= np.linalg.norm(x)
        before, across, diagonal, beside = np.zeros(operator.size), 0.0, [], []
        for _ in range(_KRYLOV):
            y = operator @ x - across * before
            diagonal.append(float(x @ y))
            y -= diagonal[-1] * x
            across = float(np.linalg.norm(y))
            beside.append(across)
            before, x = x, y / across
        values = eigvalsh_tridiagonal(np.array(diagonal), np.array(beside[:-1]), select="i", select_range=(0, 0))
        stable = float(values[0]) >= -limit
    if not stable:
        raise InstabilityError(UNSTABLE)


def _find_dense(problem: Problem, count: int, target: float) -> Eigenpairs:
    from scipy.linalg import eigh

    if problem.live.size > _LARGEST:
        what = f"{count} modes of {problem.live.size} motions, with those without energy, are too many to be found"
        raise InputError(message(what, mend="Ask for fewer"))
    squares, vectors = eigh(problem.shifted(0.0).toarray())
    if squares[0] < -find_limit(problem.operator):
        raise InstabilityError(UNSTABLE)
    omega = np.sqrt(np.maximum(squares, 0.0))
    chosen = problem.choose(omega, count, target)
    if chosen.size < count:
        raise make_too_few(chosen.size, count)
    zeros = int(np.sum(omega <= ZERO * problem.top))
    omega, vectors, residual = problem.refine(vectors[:, chosen])
    return Eigenpairs(omega, vectors, float(residual.max()), problem.loose + zeros)


def _find_factored(problem: Problem, count: int, target: float) -> Eigenpairs:
    from scipy.sparse.linalg import LinearOperator, eigsh

    size, top = problem.live.size, problem.top
    zero = ZERO * top
    zeros = problem.count_below(zero**2)
    if count > size - zeros:
        raise make_too_few(size - zeros, count)
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
        if chosen.size == count and np.max(residual[chosen]) <= RESIDUAL:
            # all modes as near as the farthest one that was chosen, and no further ones, are to be there
            reach = np.max(np.abs(omega[chosen] - target)) * (1.0 - 1e-9)
            low, high = max(target - reach, zero), target + reach
            below = zeros if low == zero else problem.count_below(low**2)
            if problem.count_below(high**2) - below == np.sum((omega > low) & (omega < high)):
                return Eigenpairs(omega[chosen], vectors[:, chosen], float(residual[chosen].max()), problem.loose + zeros)
        wanted *= 2
    return _find_dense(problem, count, target)
