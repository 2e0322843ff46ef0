"""The frequency of a wave as a function of its amplitude, by perturbation to second order."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from granphon.base.arrays import Array, Complex
from granphon.base.errors import InputError
from granphon.base.memory import require_memory
from granphon.base.validation import real_array, whole_number
from granphon.contacts.motion_laws import Powers
from granphon.dynamics.compatibility import require_digits
from granphon.networks.network import ContactNetwork
from granphon.waves.nonlinear import NonlinearWaves
from granphon.waves.operator import WaveOperator

#: share of the highest squared frequency, or of the norm of a mode, up to which a number is zero
#: but for rounding
_ROUNDING = 1e-10
#: dense complex matrices of all motions that are held at a time
_N_MATRICES = 4.0


def amplitude_shift(x: Any, q: ArrayLike, branch: int = 0, law: Any = None) -> float:
    """Return how the frequency of a travelling wave changes with its amplitude, to second order.

    The shift, a number, is (d omega/omega) (delta/A)^2, where A is the largest displacement of a
    ball and delta the mean overlap. The cell keeps its size. Normal forces follow the contact law
    to third order in the elongation; the stiffness against slip, twist and rolling is that at rest.

    Parameters
    ----------
    x : a state at one load, or a network that repeats, without ``prestress``.
    q : (p,) or (3,), wave vector in fractions of the reciprocal vectors of the p periods, in their
        order; of three components those beyond the first p are zero.
    branch : number of the branch, from 0 on in ascending frequency.
    law : the law of normal forces, as for :class:`NonlinearWaves`.

    Raises :class:`~granphon.base.errors.InputError` for what :class:`NonlinearWaves` refuses, for a
    law that is no power of the overlap, and for contacts without an overlap; for a network that
    does not repeat, and for ``q`` of another shape, not finite, or with a component beyond the
    first p that is not zero; for a number that no branch has, and for a branch whose frequency at q
    is zero or that of another branch, or in which balls only turn; if a wave of wave vector 2 q has
    twice the frequency; and for a network whose dense matrices do not fit into memory. Raises
    :class:`~granphon.base.errors.PrecisionError` for ``q`` too far from Gamma.
    """
    waves = NonlinearWaves(x, law)
    if not isinstance(waves.normal, Powers):
        raise InputError(
            "the law of the contacts is no power", "Its second and third derivatives are not known"
        )
    if not np.all(waves.overlap > 0.0):
        raise InputError(
            "some contacts have no overlap",
            "The amplitude is told over the overlap",
            "Press the balls against each other first",
        )
    network = waves.network
    operator = WaveOperator(network)
    wavevector = _read_wavevector(network, q)
    number = whole_number("branch", branch, 0, operator.size - 1)
    memory = 16.0 * _N_MATRICES * float(operator.size) ** 2  # 16 bytes for each number
    require_memory(f"dense matrices of {operator.size:,} motions", memory, "Take fewer balls")
    matrix, rows = _compose_harmonic(operator, wavevector, 1)
    square, vector = _find_single_mode(matrix, number, operator.top**2)
    amplitude = _find_amplitude(operator, vector, number)
    k2, k3 = _find_tension_series(network.normal_stiffness, waves.overlap, waves.normal.exponent)
    # the wave stretches contacts by Re(e exp(-i omega t)); the tension k2 e^2 makes elongations of
    # order two: some are constant in time, the others have twice the frequency
    e = rows @ vector
    e_double = _find_double_elongation(operator, wavevector, square, 0.5 * k2 * e * e)
    e_mean = _find_mean_elongation(operator, wavevector, 0.5 * k2 * np.abs(e) ** 2)
    # the tension of order three that has the frequency of the wave, from k2 (e + e_mean +
    # e_double)^2 and k3 e^3: it changes omega^2 as a small stiffness does, by e^* . tension
    tension = 2.0 * k2 * e * e_mean + k2 * e.conj() * e_double
    tension += 0.75 * k3 * np.abs(e) ** 2 * e
    square_change = float((e.conj() @ tension).real)
    shift = square_change / (2.0 * square)
    return shift * (float(np.mean(waves.overlap)) / amplitude) ** 2


def _find_tension_series(k: Array, overlap: Array, exponent: float) -> tuple[Array, Array]:
    """Return k2 (n_c,), N/m^2, and k3 (n_c,), N/m^3, of contacts whose force is the power
    ``exponent`` of the overlap: a contact stretched by e has the tension k e + k2 e^2 + k3 e^3
    beyond that at rest, with the stiffness ``k`` (n_c,), N/m, and the ``overlap`` (n_c,), m, at
    rest.
    """
    k2 = -0.5 * k * (exponent - 1.0) / overlap
    k3 = k * (exponent - 1.0) * (exponent - 2.0) / (6.0 * overlap**2)
    return k2, k3


def _find_single_mode(matrix: Complex, number: int, top_square: float) -> tuple[float, Complex]:
    """Return omega^2, (rad/s)^2, and the mode (size,), of norm one, of the branch with this
    ``number``; ``matrix`` (size, size), (rad/s)^2, is D of the wave vector.

    Raises :class:`~granphon.base.errors.InputError` if, but for rounding, omega^2 is zero or equal
    to that of another branch; ``top_square``, (rad/s)^2, is a bound of all omega^2.
    """
    squares, vectors = np.linalg.eigh(matrix)
    rounding = _ROUNDING * top_square
    n_equal = np.count_nonzero(np.abs(squares - squares[number]) < rounding)
    if squares[number] < rounding or n_equal > 1:
        fault = f"branch {number} costs nothing at this wave vector, or touches another"
        raise InputError(fault, "Its wave is not known", "Take another wave vector or branch")
    return float(squares[number]), vectors[:, number]


def _read_wavevector(network: ContactNetwork, q: ArrayLike) -> Array:
    """Return the wave vector (p,), in fractions of the reciprocal cell, that ``q`` (p,) or (3,)
    gives: the first p components, of the p periods in their order.

    Raises :class:`~granphon.base.errors.InputError` for a network that does not repeat, for ``q``
    of another shape or not finite, and if the components of ``q`` beyond the first p are not zero;
    and :class:`~granphon.base.errors.PrecisionError` for ``q`` too far from Gamma.
    """
    p = int(np.count_nonzero(network.pbc))
    if p == 0:
        raise InputError("the network does not repeat", "Its waves have no wave vectors")
    wavevector = real_array("q", q)
    if wavevector.shape not in ((p,), (3,)):
        raise InputError(f"q has the shape {wavevector.shape}", mend=f"Give ({p},) fractions")
    if not np.all(np.isfinite(wavevector)):
        raise InputError("q is not finite", mend="Give finite numbers")
    require_digits(wavevector)
    if np.any(wavevector[p:]):
        raise InputError(
            f"q has a component beyond the first {p}",
            "The first ones are those of the periods, in their order",
            "Give 0 for all others",
        )
    return wavevector[:p]


def _compose_harmonic(
    operator: WaveOperator, wavevector: Array, harmonic: int
) -> tuple[Complex, Complex]:
    """Return D (size, size), (rad/s)^2, and the matrix (n_c, size) that maps mass-weighted motions
    to the elongations of contacts, of waves whose wave vector is ``harmonic`` times ``wavevector``
    (p,), in fractions of the reciprocal cell.
    """
    network = operator.network
    periods = np.flatnonzero(network.pbc)
    angle = 2.0j * np.pi * (network.shift[:, periods] @ wavevector)
    phase = np.exp(harmonic * angle)  # (n_c,) of the second ball of each contact
    deformations = operator.compose(operator.law_rows, phase)
    elongations = deformations[: network.n_contacts].toarray()  # rows of this kind come first
    return operator.weigh(phase=phase).toarray(), elongations


def _find_amplitude(operator: WaveOperator, vector: Complex, number: int) -> float:
    """Return the largest displacement of a ball, kg^-1/2, in the mode ``vector`` (size,),
    mass-weighted and of norm one, of the branch with this ``number``. Each ball moves on an
    ellipse, and half of the long axis of the ellipse counts.

    Raises :class:`~granphon.base.errors.InputError` for a mode in which balls only turn.
    """
    # (n_free, displacements), times the root of the mass of each ball
    translations = operator.values(vector)[:, operator.motions.translating]
    # of the ellipse Re(u exp(-i omega t)), half the long axis squared is (|u|^2 + |u . u|) / 2
    norm_squares = np.sum(np.abs(translations) ** 2, axis=1)
    squares = np.sum(translations**2, axis=1)
    weighted_axis_squares = 0.5 * (norm_squares + np.abs(squares))
    if np.sum(weighted_axis_squares) < _ROUNDING:
        raise InputError(
            f"balls only turn in branch {number}",
            "An amplitude is a displacement",
            "Take another branch",
        )
    masses = operator.network.masses[operator.balls]
    return float(np.sqrt(np.max(weighted_axis_squares / masses)))


def _find_double_elongation(
    operator: WaveOperator, wavevector: Array, square: float, tension: Complex
) -> Complex:
    """Return the elongations (n_c,), complex amplitudes, with which contacts answer a ``tension``
    (n_c,) at twice the frequency and twice the wave vector of a wave.

    The wave has omega^2 = ``square``, (rad/s)^2, and the ``wavevector`` q (p,), in fractions.
    Raises :class:`~granphon.base.errors.InputError` if a wave of wave vector 2 q has twice the
    frequency.
    """
    matrix, rows = _compose_harmonic(operator, wavevector, 2)
    double_square = 4.0 * square  # (2 omega)^2
    distances = np.abs(np.linalg.eigvalsh(matrix) - double_square)
    if np.min(distances) < _ROUNDING * operator.top**2:
        raise InputError(
            "twice the frequency is that of a wave of 2 q", "The two exchange energy", "Change q"
        )
    force = -rows.conj().T @ tension
    motion = np.linalg.solve(matrix - double_square * np.eye(len(matrix)), force)
    return np.asarray(rows @ motion)


def _find_mean_elongation(operator: WaveOperator, wavevector: Array, tension: Complex) -> Complex:
    """Return the elongations (n_c,) with which contacts answer a ``tension`` (n_c,) that is
    constant in time and the same in all cells, while the cell keeps its size; ``wavevector`` (p,)
    is that of the wave, in fractions.
    """
    # the wave vector is multiplied by zero: the same in all cells
    matrix, rows = _compose_harmonic(operator, wavevector, 0)
    force = -rows.conj().T @ tension
    # D is singular: motions that deform no contact, such as translations, are left out
    flexibility = np.linalg.pinv(matrix, rcond=_ROUNDING, hermitian=True)
    return np.asarray(rows @ (flexibility @ force))
