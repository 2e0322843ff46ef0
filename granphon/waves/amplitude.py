"""The frequency of a wave over its amplitude, by perturbation to second order."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from granphon.base.arrays import Array, Complex
from granphon.base.errors import InputError
from granphon.base.validation import real_array, whole_number
from granphon.contacts.motion_laws import Powers
from granphon.dynamics.compatibility import require_digits
from granphon.networks.network import ContactNetwork
from granphon.waves.nonlinear import NonlinearWaves
from granphon.waves.operator import WaveOperator

#: difference of squared frequencies, over the highest, up to which the two are equal but for
#: rounding
_ALONE = 1e-10


def amplitude_shift(x: Any, q: ArrayLike, branch: int = 0, law: Any = None) -> float:
    """Return how the frequency of a travelling wave changes with its amplitude, to second order.

    The shift is (d omega/omega) (delta/A)^2, where A is the largest displacement of a ball and
    delta the mean overlap. The cell keeps its size. Normal forces follow the whole law; the
    stiffness against slip, twist and rolling is that at rest.

    Parameters
    ----------
    x : a state at one load, or a network that repeats, without ``prestress``.
    q : (p,) or (3,), wave vector in fractions of the reciprocal cell.
    branch : number of the branch, in ascending frequency.
    law : as for :class:`NonlinearWaves`.

    Raises :class:`~granphon.base.errors.InputError` for a law that is no power, for a branch that
    others touch at q, or that costs nothing or displaces no ball, and where twice its frequency is
    that of a wave of 2 q.
    """
    waves = NonlinearWaves(x, law)
    if not isinstance(waves.normal, Powers):
        raise InputError(
            "the law of the contacts is no power", "Its second and third derivatives are not known"
        )
    network = waves.network
    operator = WaveOperator(network)
    wavevector = _read_wavevector(network, q)
    number = whole_number("branch", branch, 0, operator.size - 1)
    matrix, rows = _find_harmonic(operator, wavevector, 1)
    square, vector = _take_single_branch(matrix, number, operator.top**2)
    amplitude = _find_amplitude(operator, vector, number)
    # the tension of a contact is k e + second e^2 + third e^3 of its elongation e
    a = waves.normal.exponent
    k = network.normal_stiffness
    delta = waves.overlap
    second = -0.5 * k * (a - 1.0) / delta
    third = k * (a - 1.0) * (a - 2.0) / (6.0 * delta**2)
    # the wave makes elongations of order two: at twice its frequency, and constant ones
    e = rows @ vector
    e_double = _follow_double(operator, wavevector, square, second * e * e)
    e_mean = _follow_mean(operator, wavevector, second * np.abs(e) ** 2)
    # the tension of order three at the frequency of the wave, which shifts the frequency
    tension = 2.0 * second * e * e_mean + second * e.conj() * e_double
    tension += 0.75 * third * np.abs(e) ** 2 * e
    shift = float((e.conj() @ tension).real) / (2.0 * square)
    return shift * (float(np.mean(delta)) / amplitude) ** 2


def _take_single_branch(matrix: Complex, number: int, top_square: float) -> tuple[float, Complex]:
    """Return omega^2, (rad/s)^2, and the vector (size,) of the branch of this ``number`` of D,
    ``matrix`` (size, size).

    Raises :class:`~granphon.base.errors.InputError` if omega^2 is zero, or that of another branch,
    but for rounding; ``top_square`` is a bound of all omega^2.
    """
    squares, vectors = np.linalg.eigh(matrix)
    rounding = _ALONE * top_square
    n_equal = np.count_nonzero(np.abs(squares - squares[number]) < rounding)
    if squares[number] < rounding or n_equal > 1:
        fault = f"branch {number} costs nothing at this wave vector, or touches another"
        raise InputError(fault, "Its wave is not known", "Take another wave vector or branch")
    return float(squares[number]), vectors[:, number]


def _read_wavevector(network: ContactNetwork, q: ArrayLike) -> Array:
    """Return the wave vector (p,) in fractions of the reciprocal cell, from (p,) or (3,).

    Raises :class:`~granphon.base.errors.InputError` for a network that does not repeat, another
    shape, numbers that are not finite, and a wave vector with a component across the periods.
    """
    p = int(np.count_nonzero(network.pbc))
    if p == 0:
        raise InputError("the network does not repeat", "Its waves have no wave vectors")
    wavevector = real_array("q", q)
    if wavevector.shape not in ((p,), (3,)):
        raise InputError(f"q has the shape {wavevector.shape}", mend=f"Give ({p},) fractions")
    if not np.all(np.isfinite(wavevector)):
        raise InputError("q is not finite")
    require_digits(wavevector)
    if np.any(wavevector[p:]):
        raise InputError("q has a component across the periods", mend="Give 0 for it")
    return wavevector[:p]


def _find_harmonic(
    operator: WaveOperator, wavevector: Array, harmonic: int
) -> tuple[Complex, Complex]:
    """Return D (size, size), (rad/s)^2, and the rows (n_c, size) that make elongations of contacts
    of a vector, for waves of ``harmonic`` times the wave vector (p,), in fractions.
    """
    network = operator.network
    periods = np.flatnonzero(network.pbc)
    angle = 2.0j * np.pi * (network.shift[:, periods] @ wavevector)
    phase = np.exp(harmonic * angle)  # (n_c,) of the second ball of each contact
    deformations = operator.compose(operator.law_rows, phase).toarray()
    return operator.weigh(phase=phase).toarray(), deformations[: network.n_contacts]


def _find_amplitude(operator: WaveOperator, vector: Complex, number: int) -> float:
    """Return the largest displacement of a ball in a mode ``vector`` (size,), the branch of this
    ``number``: half the long axis of its ellipse.

    Raises :class:`~granphon.base.errors.InputError` for a mode in which balls only turn.
    """
    # (n_free, displacements), times the root of the mass of each ball
    translations = operator.values(vector)[:, operator.motions.translating]
    # the square of half the long axis of the ellipse of each ball, times its mass
    norm_squares = np.sum(np.abs(translations) ** 2, axis=1)
    half_axes = 0.5 * (norm_squares + np.abs(np.sum(translations**2, axis=1)))
    masses = operator.network.masses[operator.balls]
    amplitude = float(np.sqrt(np.max(half_axes / masses)))
    if np.sum(half_axes) < _ALONE:
        raise InputError(
            f"balls only turn in branch {number}",
            "An amplitude is a displacement",
            "Take another branch",
        )
    return amplitude


def _follow_double(
    operator: WaveOperator, wavevector: Array, square: float, tension: Complex
) -> Complex:
    """Return the elongations (n_c,) at twice the frequency of a wave that its ``tension`` (n_c,) of
    second order makes; ``square`` is omega^2 of the wave, (rad/s)^2.

    Raises :class:`~granphon.base.errors.InputError` if a wave of 2 q has twice the frequency.
    """
    matrix, rows = _find_harmonic(operator, wavevector, 2)
    double_square = 4.0 * square
    distances = np.abs(np.linalg.eigvalsh(matrix) - double_square)
    if np.min(distances) < _ALONE * operator.top**2:
        raise InputError(
            "twice the frequency is that of a wave of 2 q", "The two exchange energy", "Change q"
        )
    force = -0.5 * rows.conj().T @ tension
    motion = np.linalg.solve(matrix - double_square * np.eye(len(matrix)), force)
    return np.asarray(rows @ motion)


def _follow_mean(operator: WaveOperator, wavevector: Array, tension: Complex) -> Complex:
    """Return the constant elongations (n_c,) of a wave that its ``tension`` (n_c,) of second order
    makes, while the cell keeps its size.
    """
    matrix, rows = _find_harmonic(operator, wavevector, 0)
    force = -0.5 * rows.conj().T @ tension
    # D is singular: motions that deform no contact, such as translations, are left out
    flexibility = np.linalg.pinv(matrix, rcond=_ALONE, hermitian=True)
    return np.asarray(rows @ (flexibility @ force))
