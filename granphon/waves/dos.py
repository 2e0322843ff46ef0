"""Densities of states of finite networks: of small ones by their modes, of others by random
vectors; of single balls.
"""

from __future__ import annotations

import math
from functools import partial

import numpy as np
from numpy.typing import ArrayLike

from granphon.balls.diameters import uniform_numbers
from granphon.base.arrays import Array
from granphon.base.errors import InputError
from granphon.base.memory import require_memory
from granphon.base.results import Result, held, result_class
from granphon.base.standard_errors import standard_error
from granphon.base.validation import finite_array, whole_number
from granphon.observables.validity import network_warnings
from granphon.waves.chebyshev import Kernel, Moments, Refinable, keeps_vectors
from granphon.waves.operator import WaveOperator

#: memory of a local density at one frequency, of one motion of the ball and of the frequency
#: itself, bytes
_LOCAL_BYTES = 40.0
#: most numbers of moments of all random vectors: their densities are 4 GiB
MOST_MOMENTS = 2**26
#: distance from zero, in resolutions, beyond which the line of modes without energy is not seen
_BEYOND_ZERO = 4.0
#: most numbers of moments of modes that are worked out together
_BLOCK = 2**22


@result_class
class LocalDensity(Result, array="values"):
    """Local density of states of a ball, by its motions; ``np.asarray`` of it is ``values``.

    The density of a motion is the sum over all modes of their kinetic energy in that motion, each
    line broadened by the Jackson kernel.

    Attributes
    ----------
    frequencies : (n_f,) Hz.
    values : (n_f, motions) 1/Hz; the integral of each over all frequencies is 1.
    letters : names of the motions.
    ball : index of the ball.
    resolution : standard deviation of the kernel at frequency zero, Hz; above zero it is finer.
    moments : number of Chebyshev moments.
    """

    frequencies: Array = held(float, "f", "Hz")
    values: Array = held(float, "f m", "1/Hz")
    letters: tuple[str, ...] = held((str, ...))
    ball: int = held(int)
    resolution: float = held(float, unit="Hz")
    moments: int = held(int)


def find_local_density(
    operator: WaveOperator,
    ball: int,
    frequencies: ArrayLike,
    resolution: float | None,
    moments: int | None,
) -> LocalDensity:
    """Return the local density of states of a ball; see
    :meth:`granphon.waves.waves.Waves.local_dos`.
    """
    network = operator.network
    kernel = Kernel.of(operator.top / (2.0 * math.pi), resolution, moments)
    hertz = np.atleast_1d(finite_array("frequencies", frequencies, "Hz", "zero or above"))
    if hertz.ndim != 1:
        raise InputError(f"the frequencies have the shape {hertz.shape}", mend="Give a list")
    memory = _LOCAL_BYTES * hertz.size * (1.0 + operator.motions.count)
    require_memory(
        f"local densities of states at {hertz.size:,} frequencies", memory, "Take fewer frequencies"
    )
    ball = whole_number("ball", ball, 0, network.n_balls - 1)
    if not network.moving[ball]:
        raise InputError(f"ball {ball} does not move", "Its mass is infinite", "Give another ball")
    moments_of_motions = _find_ball_moments(operator, ball, kernel.moments)
    densities = _sum_series(kernel, moments_of_motions, hertz)
    return LocalDensity(
        frequencies=hertz,
        values=densities,
        letters=operator.motions.letters,
        ball=ball,
        resolution=kernel.resolution,
        moments=kernel.moments,
    )


def _find_ball_moments(operator: WaveOperator, ball: int, count: int) -> Array:
    """Return the first ``count`` moments of each motion of a ball, (motions, count)."""
    n_motions = operator.motions.count
    # one vector for each motion of the ball: (motions, n_free, motions)
    starts = np.zeros((n_motions, operator.balls.size, n_motions))
    starts[:, np.searchsorted(operator.balls, ball)] = np.eye(n_motions)
    return Moments(operator, [partial(operator.vector, start) for start in starts]).first(count)


def _sum_series(kernel: Kernel, moments: Array, hertz: Array) -> Array:
    """Return the densities (n_f, motions), 1/Hz, of ``moments`` (motions, M) at the frequencies
    ``hertz`` (n_f,), Hz; zero from the top of the kernel on.
    """
    is_below_top = hertz < kernel.top
    theta = np.arccos(hertz[is_below_top] / kernel.top)
    # mu_0 + 2 sum_n g_n mu_n T_n(cos 2 theta): orders above zero count twice
    multiplicity = np.full(kernel.moments, 2.0)
    multiplicity[0] = 1.0
    coefficients = kernel.weights * moments * multiplicity
    densities = np.zeros((hertz.size, len(moments)))
    series = np.polynomial.chebyshev.chebval(np.cos(2.0 * theta), coefficients.T).T
    densities[is_below_top] = series
    densities[is_below_top] *= (2.0 / (math.pi * kernel.top * np.sin(theta)))[:, None]
    return densities


@result_class
class SpectralDensity(Refinable):
    """Density of states of a network, 1/Hz per ball that moves, each line broadened by the Jackson
    kernel.

    The density of a network of up to 600 motions is exact. That of a larger network is an estimate
    by random vectors, whose integral is exact: the number of motions of a ball.

    Attributes
    ----------
    frequencies : (n,) Hz, from zero; Chebyshev nodes, four within the standard deviation of the
        kernel.
    translational, rotational : (n,) 1/Hz, the density with each mode weighted by that part of its
        kinetic energy.
    error, translational_error, rotational_error : (n,) 1/Hz, standard errors over the random
        vectors of the total and of the two parts; zero without any, nan if there is one vector. For
        few vectors they follow Student's t.
    top : bound of all frequencies, Hz, on which the polynomials are made.
    moments : number of Chebyshev moments.
    vectors : number of random vectors; 0 where all modes were found.
    seed : from which they are drawn.
    dimension : 1, 2 or 3 for balls on a line, in a plane, in space.
    warnings : one sentence for each limit of the contact law that the network exceeds.
    """

    _schema = 2
    units = {"total": "1/Hz"}

    frequencies: Array = held(float, "n", "Hz")
    translational: Array = held(float, "n", "1/Hz")
    rotational: Array = held(float, "n", "1/Hz")
    error: Array = held(float, "n", "1/Hz")
    translational_error: Array = held(float, "n", "1/Hz")
    rotational_error: Array = held(float, "n", "1/Hz")
    top: float = held(float, unit="Hz")
    moments: int = held(int)
    vectors: int = held(int)
    seed: int = held(int)
    dimension: int = held(int)
    warnings: tuple[str, ...] = held((str, ...), default=())

    @property
    def reduced(self) -> Array:
        """(n,) the total over f^(d-1), 1/Hz^d per ball, with the frequency f and the dimension d:
        constant where modes are plane waves of sound (Debye). At zero infinite, or nan.
        """
        with np.errstate(divide="ignore", invalid="ignore"):
            powers = self.frequencies ** (self.dimension - 1.0)
            return np.asarray(self.total / powers)

    @property
    def boson_peak(self) -> float:
        """The frequency, Hz, of the greatest :attr:`reduced` density above the line at zero, four
        times the resolution: where modes exceed those of sound most; nan where the density falls
        from there on, and where the resolution leaves nothing above the line.
        """
        start = int(np.searchsorted(self.frequencies, _BEYOND_ZERO * self.resolution))
        reduced = self.reduced[start:]
        peak = int(np.argmax(reduced)) if reduced.size else 0
        # where the density falls at once the line at zero is not left behind
        return float(self.frequencies[start + peak]) if peak else math.nan

    @property
    def total(self) -> Array:
        """(n,) translational plus rotational density, 1/Hz."""
        return self.translational + self.rotational

    @property
    def integral(self) -> float:
        """Integral of the total over all frequencies: the number of motions of a ball."""
        return float(self._kernel.integral(self.total))

    def with_vectors(self, vectors: int) -> SpectralDensity:
        """Return the density from this number of random vectors; work done for earlier vectors is
        kept.

        The density is the same, bit for bit, as if that number had been requested at once; without
        random vectors it is this one. Raises :class:`~granphon.base.errors.InputError` if this
        result was read from data.
        """
        return self._known_work()(self.moments, vectors=whole_number("vectors", vectors, 1))


class AllModes:
    """All modes of a network: their frequencies, and how much of the energy of each is of
    translations and of rotations.
    """

    def __init__(self, operator: WaveOperator, seed: int) -> None:
        squared_frequencies, modes = np.linalg.eigh(operator.matrix.toarray())
        self._top = operator.top / (2.0 * math.pi)
        self._seed = seed
        self._n_balls = operator.balls.size
        # rounding may leave zeros below zero
        omega = np.sqrt(np.maximum(squared_frequencies, 0.0))
        self._frequencies = omega / (2.0 * math.pi)
        self._dimension = operator.network.dimension
        self._warnings = network_warnings(operator.network)
        energies = modes**2
        translations = np.sum(energies[~operator.is_rotation], axis=0)
        rotations = np.sum(energies[operator.is_rotation], axis=0)
        # (2, modes): the parts of translations and rotations in the energy of each mode
        self._energy_parts = np.stack([translations, rotations])

    def find(self, moments: int, vectors: int) -> SpectralDensity:
        """Return the density by a number of moments.

        ``vectors`` is not used: it is there because :class:`RandomVectors` has the same method.
        """
        kernel = Kernel(self._top, moments)
        traces = np.zeros((2, moments))
        n_modes = self._frequencies.size
        n_blocks = 1 + n_modes * moments // _BLOCK
        for modes in np.array_split(np.arange(n_modes), n_blocks):
            traces += self._energy_parts[:, modes] @ kernel.moments_of(self._frequencies[modes])
        translational, rotational = kernel.densities(traces / self._n_balls)
        no_error = np.zeros(kernel.count)
        return SpectralDensity(
            frequencies=kernel.frequencies,
            translational=translational,
            rotational=rotational,
            error=no_error,
            translational_error=no_error,
            rotational_error=no_error,
            top=kernel.top,
            moments=moments,
            vectors=0,
            seed=self._seed,
            dimension=self._dimension,
            warnings=self._warnings,
        )._with_work(partial(self.find, vectors=0))


class RandomVectors:
    """Moments of random vectors: of their translations and of their rotations, each by itself.

    <r|T|r> of vectors of random signs has the mean Tr T. If r is cut into translations and
    rotations, each of the two gives the trace over its own motions, and the sum lacks the noise of
    the terms between the two.
    """

    def __init__(self, operator: WaveOperator, seed: int, vectors: int) -> None:
        self._operator = operator
        self._seed = seed
        # whether a part of a vector is that of the rotations
        self._rotations_of_parts = (False, True) if operator.motions.rotate else (False,)
        n_parts = len(self._rotations_of_parts)
        self._keep = keeps_vectors(operator, vectors * n_parts)
        #: vectors that share products, and the moments of each such group, with the number of its
        #: vectors
        self._group_size = max(operator.vectors_at_once // n_parts, 1)
        self._groups: list[tuple[int, Moments]] = []

    def _draw(self, number: int, rotations: bool) -> Array:
        """Return the vector (size,) of this ``number``: +1 or -1 by chance in the rotations, or
        else in the translations, and zero in the others.
        """
        operator = self._operator
        # a seed of its own makes a vector independent of how many others are drawn; 2^52 makes
        # whole numbers of the digits of a random number between 0 and 1
        seed = int(uniform_numbers(number + 1, self._seed)[number] * 2.0**52)
        shape = (operator.balls.size, operator.motions.count)
        signs = np.sign(uniform_numbers(shape, seed) - 0.5)
        is_in_other_part = operator.motions.is_rotation != rotations
        signs[:, is_in_other_part] = 0.0
        return np.asarray(operator.vector(signs))

    def _group(self, vectors: int) -> list[Moments]:
        """Return the moments of the first ``vectors`` random vectors, in groups that share
        products; only the last group is made anew if it has got more.
        """
        groups = []
        for number, first in enumerate(range(0, vectors, self._group_size)):
            size = min(self._group_size, vectors - first)
            if number == len(self._groups) or self._groups[number][0] != size:
                draws = [
                    partial(self._draw, vector, turns)
                    for vector in range(first, first + size)
                    for turns in self._rotations_of_parts
                ]
                group = size, Moments(self._operator, draws, keep=self._keep)
                self._groups[number : number + 1] = [group]
            groups.append(self._groups[number][1])
        return groups

    def find(self, moments: int, vectors: int) -> SpectralDensity:
        """Return the density by these numbers of moments and of random vectors."""
        vectors = whole_number("vectors", vectors, 1, MOST_MOMENTS // moments)
        kernel = Kernel(self._operator.top / (2.0 * math.pi), moments)
        n_parts = len(self._rotations_of_parts)
        n_products = vectors * n_parts * (moments // 2)
        with self._operator.progress.step("density of states", n_products) as step:
            rows = [group.first(moments, step) for group in self._group(vectors)]
        traces = np.concatenate(rows).reshape(vectors, n_parts, moments)
        # (vectors, 2, n_f) 1/Hz; zero in rotations where balls do not turn
        densities = np.zeros((vectors, 2, kernel.count))
        densities[:, : traces.shape[1]] = kernel.densities(traces / self._operator.balls.size)
        translational, rotational = densities.mean(axis=0)
        return SpectralDensity(
            frequencies=kernel.frequencies,
            translational=translational,
            rotational=rotational,
            error=_find_error(densities.sum(axis=1)),
            translational_error=_find_error(densities[:, 0]),
            rotational_error=_find_error(densities[:, 1]),
            top=kernel.top,
            moments=moments,
            vectors=vectors,
            seed=self._seed,
            dimension=self._operator.network.dimension,
            warnings=network_warnings(self._operator.network),
        )._with_work(partial(self.find, vectors=vectors))


def _find_error(densities: Array) -> Array:
    """Return the standard error (n_f,) of the mean of ``densities`` (vectors, n_f); nan for one
    vector.
    """
    if len(densities) == 1:
        return np.full(densities.shape[1:], math.nan)
    return standard_error(densities, axis=0)
