"""Modes of finite networks: the lowest, or those nearest to a frequency."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from granphon.base.arguments import not_negative, whole_number
from granphon.base.errors import InputError, message
from granphon.base.results import Result
from granphon.waves.eigenpairs import find_eigenpairs
from granphon.waves.operator import WaveOperator

Array = NDArray[np.float64]


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
    """

    units = {"frequencies": "Hz"}
    _shapes = {"frequencies": "m", "vectors": "m n c"}

    frequencies: Array
    vectors: Array
    displacements: int
    moving: int
    zero_modes: int | None
    residual: float

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
    """Return modes; see :meth:`granphon.waves.waves.Waves.modes`."""
    count = whole_number("count", count, 1)
    target = 0.0 if nearest is None else 2.0 * math.pi * not_negative("nearest", nearest, "Hz")
    if target > operator.top:
        top = operator.top / (2.0 * math.pi)
        raise InputError(message(f"the network has no modes near {nearest:g} Hz", f"All frequencies are below {top:.6g} Hz"))
    pairs = find_eigenpairs(operator, count, target)
    network, motions = operator.network, operator.motions
    vectors = np.zeros((count, network.n_balls, motions.count))
    vectors[:, operator.balls] = np.moveaxis(operator.values(pairs.vectors), -1, 0)
    largest = np.argmax(np.abs(pairs.vectors), axis=0)
    vectors *= np.sign(pairs.vectors[largest, np.arange(count)])[:, None, None]
    return NetworkModes(
        pairs.omega / (2.0 * math.pi), vectors, len(motions.translations), operator.balls.size, pairs.zeros, pairs.residual
    )
