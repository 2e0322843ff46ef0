"""Damping of contacts: dashpots beside their springs, and loss factors; damped modes.

In a motion exp(i omega t) a contact resists a deformation e of stiffness k by the force (k (1 + i
eta) + i omega c) e. c is the viscosity of its dashpot, and eta the loss factor of its material,
which does not depend on the frequency (L. Cremer and M. Heckl, Structure-Borne Sound). With tau =
c/k, the dynamical matrix of a network becomes

    D(omega) = C^T K (1 + i eta + i omega tau) C + static forces.

Where tau and eta are the same in all deformations of all contacts, and no static forces act, this
is D times a number, and all motions follow from the undamped problem at complex omega^2.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import partial
from typing import Annotated, Any, Self

import numpy as np
from numpy.typing import NDArray

from granphon.base.arrays import Array, Complex, Index
from granphon.base.errors import InputError, PrecisionError, Refused, brief
from granphon.base.results import Result
from granphon.base.validation import Rule, finite_numbers, require
from granphon.networks.network import ContactNetwork

#: greatest loss factor, and damping, s, far above any of a contact: their powers stay within the
#: range of floats
LARGEST_LOSSES = {"damping": 1e30, "loss_factor": 1e6}
#: relative difference of times, or loss factors, that are the same but for rounding
_ALIKE = 1e-12
#: damping, over the square root of the largest stiffness, above which slow rates are less than the
#: rounding of fast ones
_STRONGEST = 3e4
#: part of the top frequency up to which a frequency, or its real part, is zero: the root of
#: rounding, as zeros come in pairs
_STILL = 1e-6


@dataclass(frozen=True, eq=False)
class ContactDamping:
    """The damping of all contacts of a network.

    Attributes
    ----------
    times : (2, n_c) tau, s: of normal motion, and of slip, twist and rolling.
    losses : (2, n_c) eta, likewise.
    """

    times: Array
    losses: Array

    @classmethod
    def of(cls, network: ContactNetwork, damping: Any = 0.0, loss_factor: Any = 0.0) -> Self:
        """Return the damping of the contacts of a ``network`` from the arguments of a public call.

        Parameters
        ----------
        damping : tau = c/k of all deformations, s, a number or (n_c,); or a tuple of that of normal
            motion and of others.
        loss_factor : eta, a number or (n_c,); or a tuple of that of normal motion, and of all
            other.

        Raises :class:`~granphon.base.errors.InputError` for numbers below zero or above
        :data:`LARGEST_LOSSES`, and for arrays of another length.
        """
        pairs = (("damping", damping, "s"), ("loss_factor", loss_factor, ""))
        contacts = network.n_contacts
        return cls(*(_read_pair(name, value, contacts, unit) for name, value, unit in pairs))

    @property
    def is_none(self) -> bool:
        """Whether no energy is lost."""
        return not (np.any(self.times) or np.any(self.losses))

    def find_warnings(self, highest: float) -> tuple[str, ...]:
        """Return one sentence if contacts are more viscous than stiff at the ``highest`` frequency
        in use, Hz; else nothing.

        A damping is a time. The product of the time and the angular frequency is above 1 where the
        number was meant as a loss factor. Of modes, give the frequency without losses: strong
        dashpots lower the frequency of a mode, down to zero.
        """
        viscous = 2.0 * np.pi * highest * float(np.max(self.times, initial=0.0))
        if viscous <= 1.0:
            return ()
        return (
            f"at {highest:.4g} Hz dashpots resist {viscous:.3g} times as much as springs: the"
            " damping is a time, in s, and no loss factor.",
        )

    def soften(self, omega: Array) -> tuple[Complex, Complex]:
        """Return the factors (n_f, n_c) of the stiffness against normal motion, and of that against
        all other motion, in a motion exp(-i omega t), ``omega`` (n_f,), rad/s.
        """
        normal, other = (
            1.0 - 1j * (omega[:, None] * tau + eta)
            for tau, eta in zip(self.times, self.losses, strict=True)
        )
        return normal, other

    def find_even(self, network: ContactNetwork) -> tuple[float, float] | None:
        """Return eta and tau, s, if both are the same in all deformations that contacts resist, and
        neither static forces act nor springs to the ground, which lose no energy; else None.
        """
        if self.is_none:
            return 0.0, 0.0
        resisted = np.stack([network.normal_stiffness > 0.0, network.shear_stiffness > 0.0])
        resisted[1] |= (network.torsion_stiffness > 0.0) | (network.bending_stiffness > 0.0)
        losses = self.losses[resisted]
        times = self.times[resisted]
        is_even = all(np.ptp(numbers) <= _ALIKE * np.max(numbers) for numbers in (losses, times))
        if not is_even or network.prestress or network.on_site is not None:
            return None
        return float(losses[0]), float(times[0])


def read_loss(name: str, value: Any, rule: Rule) -> Any:
    """Return a "damping" or a "loss_factor", one or more, as a rule reads ``value``; refuse numbers
    above :data:`LARGEST_LOSSES`.
    """
    losses = rule(value)
    highest = float(np.max(losses))
    largest = LARGEST_LOSSES[name]
    if highest > largest:
        unit = " s" if name == "damping" else ""
        raise Refused(f"{highest:g}", f"{name} up to {largest:g}{unit}")
    return losses


def _read_pair(name: str, value: Any, contacts: int, unit: str) -> Array:
    """Return numbers (2, n_c), zero or above, from a number or an array (n_c,), or a tuple of two
    numbers or arrays; ``contacts`` is n_c, and ``unit`` that of ``name`` in messages.
    """
    pair = value if isinstance(value, tuple) else (value, value)
    if len(pair) != 2:
        raise InputError(f"{name} is {brief(value)}", mend="Give a number, or (normal, tangential)")
    rule = partial(finite_numbers, unit=unit, low="zero or above")
    losses = np.empty((2, contacts))
    for row, losses_of_kind in zip(losses, pair, strict=True):
        numbers = require(name, partial(read_loss, name, rule=rule), losses_of_kind)
        if numbers.shape not in ((), (contacts,)):
            raise InputError(
                f"{name} has the shape {numbers.shape}, and there are {contacts} contacts",
                mend="Give a number, one for each contact, or a tuple (normal, tangential)",
            )
        row[:] = numbers
    return losses


@dataclass(frozen=True, eq=False, repr=False)
class DampedModes(Result, array="frequencies"):
    """Modes that lose energy, u exp(2 pi i f t) with complex f; ``np.asarray`` of it is
    ``frequencies``.

    Attributes
    ----------
    frequencies : (m,) complex Hz of a network, or (n_q, n_branches) of what repeats; ascending in
        their real part, and where these are equal in the imaginary one. A mode decays as exp(-2 pi
        Im f t); one that creeps has a real part of zero, and its slower rate. So modes that creep
        are the lowest, and the slowest of them is the first.
    vectors : (m, n_balls, motions) complex, of norm one, weighted with masses; None of what
        repeats.
    qpoints : (n_q, 3) wave vectors, fractions of the reciprocal cell; None of a network.
    warnings : one sentence where contacts are more viscous than stiff in the highest of the modes,
        as a damping is a time.
    """

    frequencies: Annotated[Complex, "q m|m", "Hz"]
    vectors: Annotated[Complex | None, "m n c?"] = None
    qpoints: Annotated[Array | None, "q 3?"] = None
    warnings: tuple[str, ...] = ()

    @property
    def quality(self) -> Array:
        """Q = Re f/(2 Im f), of the shape of the frequencies: infinite without loss, zero of a mode
        that creeps.
        """
        real = self.frequencies.real
        decay = 2.0 * self.frequencies.imag
        infinite = np.full(real.shape, np.inf)
        return np.asarray(np.divide(real, decay, out=infinite, where=decay > 0.0))

    @property
    def decay(self) -> Array:
        """2 pi Im f, 1/s, the rate at which the amplitude decays, of the shape of the
        frequencies.
        """
        return np.asarray(2.0 * np.pi * self.frequencies.imag)


def damp_evenly(omega: Array, loss_factor: float, time: float) -> Complex:
    """Return complex angular frequencies of damped modes, of the shape of ``omega``, those without
    damping; eta and tau, ``loss_factor`` and ``time``, are the same in all contacts.

    Units of ``omega`` and ``time`` are inverse to each other.
    """
    squared = omega**2 * (1.0 + 1j * loss_factor)
    creep = 0.5 * time * omega**2
    root = np.sqrt(squared - creep**2)
    damped = 1j * creep + root
    # a mode that creeps has two rates, whose product is the square: the slower one is taken
    creeps = (squared.real < creep**2) & (loss_factor == 0.0)
    slower = np.divide(-squared, damped, out=np.zeros_like(damped), where=creeps)
    return np.asarray(np.where(creeps, slower, damped))


def damp_unevenly(stiffness: NDArray[Any], viscous: NDArray[Any]) -> tuple[Complex, Complex]:
    """Return the modes of x'' + G x' + D x = 0 for stacks of matrices D = ``stiffness`` and G =
    ``viscous`` (..., n, n).

    Returns
    -------
    omega : (..., n) complex, of x exp(i omega t), ascending in their real part, then in the
        imaginary one: of each pair omega and -conj(omega) the one with a real part above zero, one
        of each pair of zeros, and the slowest of those that creep, whose real part is zero.
    vectors : (..., n, n) columns of norm one.

    Raises :class:`~granphon.base.errors.PrecisionError` for a damping so strong that modes which
    creep have no digit.
    """
    n = stiffness.shape[-1]
    scale = np.sqrt(np.max(np.abs(stiffness), axis=(-2, -1), keepdims=True))
    scale = np.where(scale > 0.0, scale, 1.0)
    # rates are up to G/scale in size, and those of modes that creep of the order scale/G
    strongest = float(np.max(np.abs(viscous) / scale, initial=0.0))
    if strongest > _STRONGEST:
        raise PrecisionError(
            f"dashpots are {strongest:.2g} times as stiff as springs at the highest frequency",
            "The modes that creep would have no digit",
            "Give less damping",
        )
    # with y = x'/scale, the eigenvalues of ((0, 1), (-D, -G)) are i omega / scale
    matrices = np.zeros((*stiffness.shape[:-2], 2 * n, 2 * n), complex)
    matrices[..., :n, n:] = np.eye(n)
    matrices[..., n:, :n] = -stiffness / scale**2
    matrices[..., n:, n:] = -viscous / scale
    rates, states = np.linalg.eig(matrices)
    omega, columns = _choose_half(-1j * rates)
    # the first half of a state (x, y) is the motion
    motions = np.take_along_axis(states[..., :n, :], columns[..., None, :], -1)
    vectors = motions / np.linalg.norm(motions, axis=-2, keepdims=True)
    return omega * scale[..., 0], np.asarray(vectors, complex)


def _choose_half(omega: Complex) -> tuple[Complex, Index]:
    """Return n of the 2 n roots ``omega`` (..., 2 n), which are over the root of the largest
    stiffness, in the order of :func:`damp_unevenly`, and their columns (..., n) among all.
    """
    n = omega.shape[-1] // 2
    is_zero = np.abs(omega) <= _STILL
    oscillates = omega.real > _STILL
    creeps = ~is_zero & (np.abs(omega.real) <= _STILL)
    roots = np.where(creeps, 1j * omega.imag, omega)
    # first roots of a positive real part, then zeros, those that creep, and last the mirror images
    kinds = np.select([oscillates, is_zero, creeps], [0, 1, 2], 3)
    # zeros whose rounding has a positive real part come first; roots that creep ascend in their
    # rate
    order = np.lexsort((np.where(is_zero, -roots.real, roots.imag), kinds))
    sorted_roots = np.take_along_axis(roots, order, -1)
    is_zero = np.take_along_axis(is_zero, order, -1)
    # zeros come in pairs, of which one is kept: the first half of all zeros, and of an odd number
    # the middle one too, as a motion with a dashpot and no spring has one zero and one root that
    # creeps
    zeros_so_far = np.cumsum(is_zero, axis=-1)
    n_zeros = np.sum(is_zero, axis=-1, keepdims=True)
    is_spare = is_zero & (2 * zeros_so_far > n_zeros + 1)
    half = np.argsort(is_spare, axis=-1, kind="stable")[..., :n]
    half_roots = np.take_along_axis(sorted_roots, half, -1)
    kept = np.take_along_axis(half, np.lexsort((half_roots.imag, half_roots.real)), -1)
    return np.take_along_axis(sorted_roots, kept, -1), np.take_along_axis(order, kept, -1)
