"""Losses of contacts and balls: dashpots beside springs, loss factors, drag; damped modes.

In a motion exp(i omega t) a contact resists a deformation e of stiffness k by the force (k (1 + i
eta) + i omega c) e. The viscosity c is that of its dashpots, and eta is the loss factor of its
material, which does not depend on the frequency (L. Cremer and M. Heckl, Structure-Borne Sound).
Drag resists the motion of a ball itself, by the force -gamma m v and the torque -gamma' I Omega.
With tau = c/k, the equations of a network are D(omega) x + i omega Gamma x = omega^2 x, with

    D(omega) = C^T K (1 + i eta + i omega tau) C + static forces.

A contact has three dashpots side by side, c = tau k + c_0 + alpha (m* k)^(1/2), where 1/m* =
1/m_i + 1/m_j. The first dashpot is in proportion to the stiffness, and the second does not depend
on the force. The third is that of Y. Tsuji, T. Tanaka and T. Ishida (Powder Technol. 71, 239,
1992). With it, and with Hertz's stiffness k ~ h^(1/2), a collision obeys m* h'' + c h' + (2/3) k h
= 0. In terms of the velocity and the 5/4th power of the overlap h this is the equation of a damped
oscillator, with the damping ratio alpha (3/10)^(1/2). All collisions that end with no overlap then
have the same restitution e, with

    alpha(e) = (10/3)^(1/2) ln(1/e) / (pi^2 + ln(e)^2)^(1/2).

In slip the first dashpot has a time tau of its own, the second a viscosity c_0 of its own, and the
third the same viscosity as in normal motion. Twist and rolling are damped with the time c/k of
slip. A contact that does not resist slip has no dashpot against it.

Losses are *even* if tau, eta and gamma are the same in all deformations of all contacts, and in all
motions. If they are even and no static forces act, all motions follow from the undamped problem at
complex omega^2. With drag alone the same holds under static forces too.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import cached_property, partial
from typing import Any, Self

import numpy as np
from numpy.typing import ArrayLike, NDArray

from granphon.balls.motions import Motions
from granphon.balls.packing import LOSSES
from granphon.base.arrays import Array, Complex, Index
from granphon.base.errors import InputError, PrecisionError, Refused, brief
from granphon.base.results import Result, held, read_only, result_class
from granphon.base.validation import Rule, finite_numbers, require
from granphon.networks.network import ContactNetwork

#: greatest losses that are allowed, in SI: far above those of any contact or ball, and so small
#: that their powers stay within the range of floats
LARGEST_LOSSES = {"damping": 1e30, "loss_factor": 1e6, "drag": 1e30, "dashpot": 1e30}
#: least restitution of a collision that is allowed: below it the dashpot is nearly the critical one
LEAST_RESTITUTION = 1e-6
#: alpha of the dashpot of Tsuji over ln(1/e), for a restitution e near one
SMALL_LOSS = math.sqrt(10.0 / 3.0) / math.pi
#: relative difference of numbers that are the same but for rounding
ALIKE = 1e-12
#: largest entry of the viscous matrix, over the square root of the largest stiffness, above which
#: the rates of slow modes are less than the rounding of fast ones
_LARGEST_VISCOUS_RATIO = 3e4
#: part of the top frequency up to which a frequency, or its real part, is zero: the root of
#: rounding, as zeros come in pairs
_ZERO_ROUNDING = 1e-6


@dataclass(frozen=True, eq=False)
class GivenLosses:
    """Losses as a call gives them, of any network; :meth:`Losses.of` makes those of one network.

    Attributes
    ----------
    damping : tau = c/k, s, of all deformations, a number or (n_c,); or a tuple of two, of normal
        motion and of all other motion.
    loss_factor : eta of all deformations, a number or (n_c,); or a tuple of two, of normal motion
        and of all other motion.
    drag : gamma, 1/s, of all motions, a number; or a tuple of two, of displacements and of
        rotations.
    dashpot : c_0, N s/m, a number or (n_c,); or a tuple of two, of normal motion and of slip.
    restitution : e of a collision, the velocity after it over that before, a number or (n_c,).
    """

    damping: Any = 0.0
    loss_factor: Any = 0.0
    drag: Any = 0.0
    dashpot: Any = 0.0
    restitution: Any = 1.0

    def with_tangential(self, damping: float | None) -> Self:
        """Return the losses with another ``damping``, s, of all other than normal motion; None
        leaves it as it is.

        Raises :class:`~granphon.base.errors.InputError` if the losses have a pair of values of
        their damping, the second of which would be dropped.
        """
        if damping is None:
            return self
        if isinstance(self.damping, tuple):
            raise InputError(
                f"damping is {brief(self.damping)}, and tangential_damping is {brief(damping)}",
                "The second of the pair is that of slip, twist and rolling too",
                "Give damping=(normal, tangential) alone, or one number with tangential_damping",
            )
        return replace(self, damping=(self.damping, damping))


#: what is given of contacts and balls that lose nothing
NO_LOSSES = GivenLosses()


@dataclass(frozen=True, eq=False)
class Losses:
    """Losses of energy in the contacts and in the motion of the balls of a network.

    Attributes
    ----------
    network : the network.
    damping : (2, n_c) tau, s, of dashpots in proportion to stiffness: of normal motion, and of
        slip, twist and rolling.
    factors : (2, n_c) loss factors eta, of normal motion, and of slip, twist and rolling.
    drag : (2,) gamma, 1/s, of displacements, and of rotations.
    dashpot : (2, n_c) c_0, N s/m, of normal motion, and of slip.
    tsuji : (n_c,) alpha of the dashpot of Tsuji, which gives collisions their restitution.
    """

    network: ContactNetwork
    damping: Array
    factors: Array
    drag: Array
    dashpot: Array
    tsuji: Array

    @classmethod
    def of(cls, network: ContactNetwork, given_losses: GivenLosses = NO_LOSSES) -> Self:
        """Return the losses of a ``network``, from ``given_losses`` of a public call.

        Raises :class:`~granphon.base.errors.InputError` for what is no finite number, for numbers
        below zero or above :data:`LARGEST_LOSSES`, for a restitution not between
        :data:`LEAST_RESTITUTION` and 1, for arrays of another shape, and for tuples of another
        length than two.
        """
        count = network.n_contacts
        collisions = require("restitution", _read_restitution, given_losses.restitution)
        mend = "Give a number, or one for each contact"
        return cls(
            network,
            _read_pair("damping", given_losses.damping, count),
            _read_pair("loss_factor", given_losses.loss_factor, count),
            _read_pair("drag", given_losses.drag, 1, "of displacements, of rotations")[:, 0],
            _read_pair("dashpot", given_losses.dashpot, count),
            find_tsuji(_broadcast("restitution", collisions, count, mend)),
        )

    @property
    def is_none(self) -> bool:
        """Whether no energy is lost."""
        return not (self.has_dashpots or np.any(self.factors) or np.any(self.drag))

    @property
    def has_dashpots(self) -> bool:
        """Whether some contact has a dashpot."""
        return bool(np.any(self.damping) or np.any(self.dashpot) or np.any(self.tsuji))

    @cached_property
    def times(self) -> Array:
        """(2, n_c) tau = c/k, s, with the sum c of all three dashpots and the stiffness k at rest.
        The first row is of normal motion, the second of slip, twist and rolling.

        The ``damping`` is a time c/k as it is given; the other two dashpots are given as c.
        """
        network = self.network
        stiffness = np.stack([network.normal_stiffness, network.shear_stiffness])
        masses = find_reduced_masses(network.masses, network.i, network.j)
        viscosity = self.dashpot + self.tsuji * np.sqrt(masses * network.normal_stiffness)
        times = np.divide(viscosity, stiffness, out=np.zeros_like(viscosity), where=stiffness > 0.0)
        return read_only(self.damping + times)

    @cached_property
    def dashpots(self) -> Array:
        """(5, n_c) dashpots of the contacts: tau, s, of normal motion and of all other motion, c_0,
        N s/m, of normal motion and of slip, and alpha m*^1/2, kg^1/2. The network has contacts.
        """
        no_balls = np.zeros(0, np.intp)
        return self.list_dashpots(no_balls, no_balls)

    def list_dashpots(self, i: Index, j: Index) -> Array:
        """Return the :attr:`dashpots` (5, n) of the contacts of the network, followed by those of
        further pairs of its balls ``i`` and ``j``, each (m,), which may come into contact.

        A further pair has the means over all contacts of tau, c_0 and alpha, which only a network
        with contacts has.
        """
        network = self.network
        numbers = np.concatenate([self.damping, self.dashpot, [self.tsuji]])
        means = np.repeat(np.mean(numbers, axis=1, keepdims=True), len(i), axis=1)
        dashpots = np.concatenate([numbers, means], axis=1)
        ends = np.append(network.i, i), np.append(network.j, j)
        dashpots[-1] *= np.sqrt(find_reduced_masses(network.masses, *ends))
        return np.asarray(dashpots)

    def drag_of(self, motions: Motions) -> Array:
        """Return gamma (m,), 1/s, of the ``motions`` of a ball."""
        return np.asarray(np.where(motions.is_rotation, self.drag[1], self.drag[0]))

    def find_warnings(self, highest_frequency: float) -> tuple[str, ...]:
        """Return one sentence if at the ``highest_frequency`` in use, Hz, the dashpots of
        :attr:`damping` resist more than the springs; else an empty tuple.

        A damping is a time. If the product of the time and the angular frequency is above 1, the
        number may have been meant as a loss factor. For modes, give the highest frequency without
        losses: strong dashpots lower the frequency of a mode, down to zero.
        """
        longest_time = float(np.max(self.damping, initial=0.0))
        # the force of the dashpot over that of the spring
        ratio = 2.0 * np.pi * highest_frequency * longest_time
        if ratio <= 1.0:
            return ()
        return (
            f"at {highest_frequency:.4g} Hz dashpots resist {ratio:.3g} times as much as springs:"
            " the damping is a time, in s, and no loss factor.",
        )

    def find_stiffness_factors(self, omega: Array) -> tuple[Complex, Complex]:
        """Return the factors (n_f, n_c) by which losses multiply the stiffness against normal
        motion, and that against all other motion, in a motion exp(-i omega t), ``omega`` (n_f,),
        rad/s.
        """
        products = omega[:, None, None] * self.times  # (n_f, 2, n_c)
        stiffness_factors: Complex = np.asarray(1.0 - 1j * (products + self.factors), complex)
        return stiffness_factors[:, 0], stiffness_factors[:, 1]

    def find_even(self) -> tuple[float, float, float] | None:
        """Return the numbers eta, tau, s, and gamma, 1/s, of even losses; None if losses are not
        even. All motions with even losses follow from those without.

        Losses are even if eta and tau are the same in all deformations that contacts resist, and
        gamma in all motions. If contacts lose energy, there must also be no static forces and no
        springs to the ground, because these lose no energy.
        """
        if self.is_none:
            return 0.0, 0.0, 0.0
        network = self.network
        is_resisted = np.stack([network.normal_stiffness > 0.0, network.shear_stiffness > 0.0])
        is_resisted[1] |= (network.torsion_stiffness > 0.0) | (network.bending_stiffness > 0.0)
        is_resisted[1] &= network.ball_motions.count > 1  # balls that move along a line do not slip
        loss_factor = _find_common(self.factors[is_resisted])
        time = _find_common(self.times[is_resisted])
        drag = _find_common(self.drag_of(network.ball_motions))
        if loss_factor is None or time is None or drag is None:
            return None
        has_lossless = network.prestress or network.on_site is not None
        if has_lossless and (loss_factor or time):
            return None
        return loss_factor, time, drag


def _find_common(numbers: Array) -> float | None:
    """Return the number that all ``numbers`` (n,), zero or above, are but for rounding; None if
    they differ, and zero if there are none, as contacts that are not there lose nothing.
    """
    if not numbers.size:
        return 0.0
    is_common = np.ptp(numbers) <= ALIKE * np.max(numbers)
    return float(numbers[0]) if is_common else None


def find_tsuji(restitution: ArrayLike) -> Array:
    """Return alpha (...) of the dashpot of Tsuji with which a collision of balls with Hertz's law
    has the ``restitution`` e (...), above zero, at any velocity:
    (10/3)^(1/2) ln(1/e)/(pi^2 + ln(e)^2)^(1/2).
    """
    logarithm = -np.log(restitution) + 0.0  # no minus zero
    return np.asarray(SMALL_LOSS * np.pi * logarithm / np.hypot(np.pi, logarithm))


def find_reduced_masses(masses: Array, i: Index, j: Index) -> Array:
    """Return m* (n_c,), kg, of balls ``i`` and ``j`` (n_c,), 1/m* = 1/m_i + 1/m_j; zero for two
    bodies that do not move, whose ``masses`` (n,) are infinite.
    """
    inverse = 1.0 / masses[i] + 1.0 / masses[j]
    return np.divide(1.0, inverse, out=np.zeros_like(inverse), where=inverse > 0.0)


def read_loss(name: str, value: Any, rule: Rule) -> Any:
    """Return the numbers of a loss, one or more, as ``rule`` reads them from ``value``.

    ``name`` is that of the loss in :data:`LARGEST_LOSSES`. Raises
    :class:`~granphon.base.errors.Refused` for numbers above the largest, and for what ``rule``
    refuses.
    """
    losses = rule(value)
    highest_loss = float(np.max(losses))
    largest_allowed = LARGEST_LOSSES[name]
    if highest_loss > largest_allowed:
        unit = f" {LOSSES[name]}".rstrip()
        raise Refused(f"{highest_loss:g}", f"{name} up to {largest_allowed:g}{unit}")
    return losses


def _read_restitution(value: Any) -> NDArray[Any]:
    """Return the numbers of a restitution, one or more, from ``value``.

    Raises :class:`~granphon.base.errors.Refused` for what is no finite number, and for numbers
    below :data:`LEAST_RESTITUTION` or above 1.
    """
    restitution = finite_numbers(value)
    is_outside = (restitution < LEAST_RESTITUTION) | (restitution > 1.0)
    if np.any(is_outside):
        first_outside = restitution[is_outside][0]
        allowed_values = (
            f"the velocity after a collision over that before, {LEAST_RESTITUTION:g} to 1"
        )
        raise Refused(f"{first_outside:g}", allowed_values)
    return restitution


def _broadcast(name: str, numbers: NDArray[Any], count: int, mend: str) -> Array:
    """Return ``numbers``, one or (count,), as an array (count,).

    Raises :class:`~granphon.base.errors.InputError`, with the argument's ``name`` and the remedy
    ``mend``, for another shape.
    """
    if numbers.shape not in ((), (count,)):
        raise InputError(f"{name} has the shape {numbers.shape}, and not ({count},)", mend=mend)
    return np.array(np.broadcast_to(numbers, count))


def _read_pair(name: str, value: Any, count: int, parts: str = "normal, tangential") -> Array:
    """Return the numbers (2, count) of a loss, from ``value``: a number or an array (count,) for
    both, or a tuple of two numbers or arrays.

    ``name`` is that of the loss in :data:`LARGEST_LOSSES`, and messages call the two ``parts``.
    Raises :class:`~granphon.base.errors.InputError` for what is no finite number, for numbers below
    zero or above the largest, for another shape, and for a tuple of another length than two.
    """
    pair = value if isinstance(value, tuple) else (value, value)
    if len(pair) != 2:
        raise InputError(f"{name} is {brief(value)}", mend=f"Give a number, or ({parts})")
    for_contacts = ", one for each contact" if count > 1 else ""
    mend = f"Give a number{for_contacts}, or a tuple ({parts})"
    rule = partial(finite_numbers, unit=LOSSES[name], low="zero or above")
    read: Callable[[Any], Any] = partial(read_loss, name, rule=rule)
    return np.stack([_broadcast(name, require(name, read, losses), count, mend) for losses in pair])


@result_class
class DampedModes(Result, array="frequencies"):
    """Modes that lose energy, u exp(2 pi i f t) with complex f; ``np.asarray`` of it is
    ``frequencies``.

    Attributes
    ----------
    frequencies : (m,) complex, Hz, of a network, or (n_q, n_branches) of a periodic lattice;
        ascending in their real part, and modes of equal real part in their imaginary part. A mode
        decays as exp(-2 pi Im f t). A mode that creeps has a real part of zero and two rates, of
        which the slower is given. So modes that creep are the lowest, and the slowest is the first.
    vectors : (m, n_balls, motions) complex, mass-weighted, of norm one; None for a lattice.
    qpoints : (n_q, 3) wave vectors of a lattice, fractions of the reciprocal cell; None for a
        network.
    warnings : one sentence if at the highest of the modes dashpots resist more than springs, as a
        damping is a time, and was perhaps meant as a loss factor; else empty.
    """

    frequencies: Complex = held(complex, "q m|m", "Hz")
    vectors: Complex | None = held(complex, "m n c?", default=None)
    qpoints: Array | None = held(float, "q 3?", default=None)
    warnings: tuple[str, ...] = held((str, ...), default=())

    @property
    def quality(self) -> Array:
        """Q = Re f/(2 Im f), an array of the shape of the frequencies: infinite for a mode without
        loss, and zero for a mode that creeps.
        """
        frequency = self.frequencies.real
        decay = 2.0 * self.frequencies.imag
        quality = np.full(frequency.shape, np.inf)
        np.divide(frequency, decay, out=quality, where=decay > 0.0)
        return quality

    @property
    def decay(self) -> Array:
        """2 pi Im f, 1/s, the rate at which the amplitude of each mode decays, an array of the
        shape of the frequencies.
        """
        return np.asarray(2.0 * np.pi * self.frequencies.imag)


def damp_evenly(omega: Array, loss_factor: float, time: float, drag: float = 0.0) -> Complex:
    """Return the complex angular frequencies z (...) of damped modes from ``omega`` (...), the
    angular frequencies without losses. Losses are even: the ``loss_factor`` eta, the ``time`` tau
    and the ``drag`` gamma.

    The z solve z^2 - i z (tau omega^2 + gamma) = omega^2 (1 + i eta). Of a mode that creeps the
    slower of its two rates is returned. The units of ``omega`` and ``time`` are inverse to each
    other, and ``drag`` has the unit of ``omega``.
    """
    squared_omega = omega**2 * (1.0 + 1j * loss_factor)
    creep = 0.5 * (time * omega**2 + drag)
    root = np.sqrt(squared_omega - creep**2)
    damped = 1j * creep + root
    # the product of both solutions is -squared_omega, which gives the slower rate without
    # cancellation. With a loss factor both solutions have a real part, unless omega is zero
    is_creeping = (squared_omega.real < creep**2) & ((loss_factor == 0.0) | (omega == 0.0))
    slower_rates = np.divide(-squared_omega, damped, out=np.zeros_like(damped), where=is_creeping)
    return np.asarray(np.where(is_creeping, slower_rates, damped) + 0.0, complex)  # no minus zero


def damp_unevenly(stiffness: NDArray[Any], viscous: NDArray[Any]) -> tuple[Complex, Complex]:
    """Return n of the 2 n modes of x'' + G x' + D x = 0, for stacks of matrices D = ``stiffness``
    and G = ``viscous`` (..., n, n).

    Returns
    -------
    omega : (..., n) complex, of motions x exp(i omega t), ascending in their real part, then in the
        imaginary part. Three kinds of roots are returned: of each pair omega and -conj(omega) that
        with a real part above zero; one zero for each motion without a spring; and, to make n
        roots, the slowest of those of modes that creep, whose real part is zero.
    vectors : (..., n, n) motions x, columns of norm one.

    Raises
    ------
    PrecisionError : dashpots or drag are so strong that the modes that creep would have no digit.
    """
    n = stiffness.shape[-1]
    scale = np.sqrt(np.max(np.abs(stiffness), axis=(-2, -1), keepdims=True))
    scale = np.where(scale > 0.0, scale, 1.0)
    # rates are up to G/scale in size, and those of modes that creep of the order scale/G
    largest_ratio = float(np.max(np.abs(viscous) / scale, initial=0.0))
    if largest_ratio > _LARGEST_VISCOUS_RATIO:
        raise PrecisionError(
            f"dashpots or drag resist {largest_ratio:.2g} times as much as springs at the highest"
            " frequency",
            "The modes that creep would have no digit",
            "Give less damping, dashpot or drag",
        )
    # with y = x'/scale, the eigenvalues of ((0, 1), (-D, -G)) are i omega / scale
    matrices = np.zeros((*stiffness.shape[:-2], 2 * n, 2 * n), complex)
    matrices[..., :n, n:] = np.eye(n)
    matrices[..., n:, :n] = -stiffness / scale**2
    matrices[..., n:, n:] = -viscous / scale
    rates, states = np.linalg.eig(matrices)
    # a motion without a spring has the rate zero twice, or once if drag resists it
    values = np.linalg.svd(stiffness / scale**2, compute_uv=False)
    n_without_spring = np.sum(values <= _ZERO_ROUNDING**2, axis=-1)
    omega, columns = _choose_half(-1j * rates, n_without_spring)
    # the first half of a state (x, y) is the motion
    motions = np.take_along_axis(states[..., :n, :], columns[..., None, :], -1)
    vectors = motions / np.linalg.norm(motions, axis=-2, keepdims=True)
    return omega * scale[..., 0], np.asarray(vectors, complex)


def _choose_half(omega: Complex, n_without_spring: Index) -> tuple[Complex, Index]:
    """Return n of the 2 n roots ``omega`` (..., 2 n), those that :func:`damp_unevenly` returns, and
    their indices (..., n) among all; ascending in their real part, then in the imaginary part.

    The n roots are those with a positive real part, as many zeros as motions without a spring,
    ``n_without_spring`` (...,), and the slowest of the roots that creep. Roots are in units of the
    square root of the largest stiffness.
    """
    n = omega.shape[-1] // 2
    is_zero = np.abs(omega) <= _ZERO_ROUNDING
    is_oscillating = omega.real > _ZERO_ROUNDING
    is_creeping = ~is_zero & (np.abs(omega.real) <= _ZERO_ROUNDING)
    roots = np.where(is_creeping, 1j * omega.imag, omega)
    # first roots of a positive real part, then zeros, those that creep, and last the mirror images
    kinds = np.select([is_oscillating, is_zero, is_creeping], [0, 1, 2], 3)
    # zeros whose rounding has a positive real part come first; roots that creep ascend in their
    # rate
    order = np.lexsort((np.where(is_zero, -roots.real, roots.imag), kinds))
    sorted_roots = np.take_along_axis(roots, order, -1)
    is_sorted_zero = np.take_along_axis(is_zero, order, -1)
    zeros_so_far = np.cumsum(is_sorted_zero, axis=-1)
    is_spare = is_sorted_zero & (zeros_so_far > n_without_spring[..., None])
    # the first n roots, once the spare zeros have moved to the end; then in the order of the result
    half = np.argsort(is_spare, axis=-1, kind="stable")[..., :n]
    half_roots = np.take_along_axis(sorted_roots, half, -1)
    in_order = np.take_along_axis(half, np.lexsort((half_roots.imag, half_roots.real)), -1)
    return np.take_along_axis(sorted_roots, in_order, -1), np.take_along_axis(order, in_order, -1)
