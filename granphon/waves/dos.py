"""Densities of states of finite networks and of single balls.

The density of a small network is the sum over all its modes (:class:`AllModes`). That of a larger
network is estimated by random vectors (:class:`RandomVectors`), and that of a single ball by the
vectors in which the ball alone moves.
"""

from __future__ import annotations

import math
from functools import partial
from typing import NamedTuple, Self

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

#: memory, bytes, that a local density takes at one frequency, for each motion of the ball and once
#: more for the frequency itself
_LOCAL_BYTES = 40.0
#: most random vectors times moments of each: the densities of all vectors take 4 GiB
MOST_MOMENTS = 2**26
#: distance from frequency zero, in resolutions, from which the broadened line of modes without
#: energy is no longer seen
_ZERO_WIDTH = 4.0
#: most modes times moments that are computed together
_BLOCK = 2**22


@result_class
class LocalDensity(Result, array="values"):
    """Local density of states of a ball, one for each of its motions; ``np.asarray`` of it is
    ``values``.

    The density of a motion is the sum over all modes of the share of their kinetic energy that is
    in that motion, the line of each mode broadened by the Jackson kernel.

    Attributes
    ----------
    frequencies : (n_f,) Hz.
    values : (n_f, motions) 1/Hz; the integral of each column over all frequencies is 1.
    letters : names of the motions, one for each column.
    ball : index of the ball.
    resolution : standard deviation of the kernel at frequency zero, Hz; above zero the kernel is
        narrower.
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
    """Return the local density of states of a ``ball``, an index, at ``frequencies`` (n_f,), Hz, by
    a ``resolution``, Hz, or a number of ``moments``; see
    :meth:`granphon.waves.waves.Waves.local_dos`.

    Raises :class:`~granphon.base.errors.InputError` for a ball that is not there or does not move,
    for no frequency, frequencies that are not finite, below zero or of another shape, and more than
    memory holds; and what :meth:`Kernel.of` and :meth:`Moments.first` raise.
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
    """Return the first ``count`` moments, (motions, count), of the vectors in which only the
    ``ball``, an index, has one of its motions.
    """
    n_motions = operator.motions.count
    # one vector for each motion of the ball: (motions, n_free, motions)
    starts = np.zeros((n_motions, operator.balls.size, n_motions))
    index = np.searchsorted(operator.balls, ball)  # of the ball among those that move
    starts[:, index] = np.eye(n_motions)
    return Moments(operator, [partial(operator.vector, start) for start in starts]).first(count)


def _sum_series(kernel: Kernel, moments: Array, hertz: Array) -> Array:
    """Return the densities (n_f, motions), 1/Hz, of ``moments`` (motions, M) at any frequencies
    ``hertz`` (n_f,), Hz; zero from the top of the kernel on, above all frequencies.

    The series is that of the head of :mod:`granphon.waves.chebyshev`. :meth:`Kernel.densities` sums
    it by a fast transform, but only at the frequencies of the kernel.
    """
    is_below_top = hertz < kernel.top
    theta = np.arccos(hertz[is_below_top] / kernel.top)
    # mu_0 + 2 sum_n g_n mu_n cos(2 n theta), in which orders above zero count twice
    multiplicity = np.full(kernel.moments, 2.0)
    multiplicity[0] = 1.0
    coefficients = kernel.weights * moments * multiplicity
    densities = np.zeros((hertz.size, len(moments)))
    # cos(2 n theta) is the Chebyshev polynomial of order n of cos(2 theta)
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
    translational, rotational : (n,) 1/Hz, the density in which each mode counts with the share of
        its kinetic energy that is of translations, and of rotations.
    error, translational_error, rotational_error : (n,) 1/Hz, standard errors over the random
        vectors of the total and of the two parts; zero where all modes were found, nan if there is
        one vector. For few vectors they follow Student's t.
    top : bound of all frequencies, Hz, to which the polynomials are scaled.
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
        """(n,) the total density over f^(d-1), 1/Hz^d per ball, with the frequency f and the
        dimension d: constant where modes are plane waves of sound (Debye). In two and three
        dimensions it is infinite at zero frequency, or nan where the density is zero.
        """
        with np.errstate(divide="ignore", invalid="ignore"):  # of the division by zero at f = 0
            powers = self.frequencies ** (self.dimension - 1.0)
            return np.asarray(self.total / powers)

    @property
    def boson_peak(self) -> float:
        """The frequency, Hz, of the greatest :attr:`reduced` density, where modes exceed those of
        sound most.

        Only frequencies from four times the resolution on count, as modes without energy make a
        line of this width at zero. The peak is nan if the reduced density is greatest at the first
        of these frequencies, or if there are no such frequencies.
        """
        start = int(np.searchsorted(self.frequencies, _ZERO_WIDTH * self.resolution))
        reduced_densities = self.reduced[start:]
        peak = int(np.argmax(reduced_densities)) if reduced_densities.size else 0
        # a maximum at the first frequency is no peak: it may be the flank of the line at zero
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
        """Return the density from this number of random vectors; moments of vectors that this
        density has are not computed again.

        The density is the same, bit for bit, as if that number had been requested at once. A
        density by all modes, without random vectors, stays as it is. Raises
        :class:`~granphon.base.errors.InputError` if this result was read from data, for a number
        that is not whole or below 1, and for more than 2^26 moments of all random vectors.
        """
        return self._require_finder()(self.moments, vectors=whole_number("vectors", vectors, 1))


class DensityRequest(NamedTuple):
    """What is asked of a density of states: its ``kernel``, the number of random ``vectors``, and
    the ``seed`` from which they are drawn.
    """

    kernel: Kernel
    vectors: int
    seed: int

    @classmethod
    def read(
        cls,
        operator: WaveOperator,
        resolution: float | None,
        vectors: int,
        seed: int,
        moments: int | None,
    ) -> Self:
        """Return the request with these arguments of ``Waves.dos`` for the network of the
        ``operator``.

        Raises :class:`~granphon.base.errors.InputError` for numbers out of range, for more than
        :data:`MOST_MOMENTS` moments of all random vectors, and as :meth:`Kernel.of` does.
        """
        kernel = Kernel.of(operator.top / (2.0 * math.pi), resolution, moments)
        vectors = whole_number("vectors", vectors, 1, MOST_MOMENTS // kernel.moments)
        return cls(kernel, vectors, whole_number("seed", seed, 0))


class AllModes:
    """All modes of a network: their frequencies, and the shares of translations and of rotations in
    the kinetic energy of each, from which :meth:`find` makes the density of states.

    The constructor finds all modes by a dense matrix. The caller has made sure that the network is
    stable. ``seed`` is only passed on to the result.
    """

    def __init__(self, operator: WaveOperator, seed: int) -> None:
        squared_frequencies, modes = np.linalg.eigh(operator.matrix.toarray())
        self._top = operator.top / (2.0 * math.pi)
        self._seed = seed
        self._n_balls = operator.balls.size
        # squares of a stable network are below zero by rounding, by forces that do not quite
        # balance, or because D lacks the antisymmetric part of G (both of granphon.waves.operator):
        # all of these count as zero
        omega = np.sqrt(np.maximum(squared_frequencies, 0.0))
        self._frequencies = omega / (2.0 * math.pi)
        self._dimension = operator.network.dimension
        self._warnings = network_warnings(operator.network)
        # vectors are mass-weighted: the square of an entry is the share of its motion in the
        # kinetic energy of the mode
        energies = modes**2
        translations = np.sum(energies[~operator.is_rotation], axis=0)
        rotations = np.sum(energies[operator.is_rotation], axis=0)
        self._energy_shares = np.stack([translations, rotations])  # (2, modes)

    def find(self, moments: int, vectors: int) -> SpectralDensity:
        """Return the density by a number of ``moments``.

        ``vectors``, a number of random vectors, is not used: it is an argument because
        :meth:`RandomVectors.find` has it.
        """
        kernel = Kernel(self._top, moments)
        traces = np.zeros((2, moments))
        n_modes = self._frequencies.size
        # the moments of all modes at once, (modes, moments), would take too much memory
        n_blocks = 1 + n_modes * moments // _BLOCK
        for block in np.array_split(np.arange(n_modes), n_blocks):
            traces += self._energy_shares[:, block] @ kernel.moments_of(self._frequencies[block])
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
        )._with_finder(partial(self.find, vectors=0))


class RandomVectors:
    """The density of states of a network from the moments of random vectors.

    The product <r|T|r> has the mean Tr T if the numbers of r are signs drawn at random. Each random
    vector r is cut into its translations and its rotations: the product of each part gives the
    trace over its own motions, and the sum of the two products lacks the noise of the terms between
    translations and rotations.

    Moments that were computed are kept for later calls of :meth:`find`. The last vectors of the
    recursions are kept too if they take little memory, which is judged by ``vectors``, the number
    of random vectors of the first call.
    """

    def __init__(self, operator: WaveOperator, seed: int, vectors: int) -> None:
        self._operator = operator
        self._seed = seed
        # of each part of a vector, whether the part has the rotations or the translations
        self._has_rotations = (False, True) if operator.motions.rotate else (False,)
        n_parts = len(self._has_rotations)
        self._is_kept = keeps_vectors(operator, vectors * n_parts)
        # most random vectors in a group, whose parts share products with D
        self._group_size = max(operator.vectors_at_once // n_parts, 1)
        # of each group, the number of its random vectors, and their moments
        self._groups: list[tuple[int, Moments]] = []

    def _draw(self, number: int, has_rotations: bool) -> Array:
        """Return one part (size,) of the random vector with this ``number``: +1 or -1 by chance in
        all rotations if it ``has_rotations``, else in all translations, and zero in all other
        motions.
        """
        operator = self._operator
        # each vector has a seed of its own, so that it does not depend on how many others are
        # drawn: 2^52 times a random number between 0 and 1, made a whole number
        seed = int(uniform_numbers(number + 1, self._seed)[number] * 2.0**52)
        shape = (operator.balls.size, operator.motions.count)
        signs = np.sign(uniform_numbers(shape, seed) - 0.5)
        is_in_other_part = operator.motions.is_rotation != has_rotations
        signs[:, is_in_other_part] = 0.0
        return np.asarray(operator.vector(signs))

    def _group_moments(self, n_vectors: int) -> list[Moments]:
        """Return the moments of the first ``n_vectors`` random vectors, in groups whose vectors
        share products with D.

        Groups are kept. A kept group is replaced by a new one if the number of its vectors is now
        another, as may happen to the last group.
        """
        groups = []
        for number, first in enumerate(range(0, n_vectors, self._group_size)):
            size = min(self._group_size, n_vectors - first)
            is_new = number == len(self._groups)
            if is_new or self._groups[number][0] != size:
                draws = [
                    partial(self._draw, vector, has_rotations)
                    for vector in range(first, first + size)
                    for has_rotations in self._has_rotations
                ]
                group = size, Moments(self._operator, draws, is_kept=self._is_kept)
                self._groups[number : number + 1] = [group]  # appends, or replaces
            _, group_moments = self._groups[number]
            groups.append(group_moments)
        return groups

    def find(self, moments: int, vectors: int) -> SpectralDensity:
        """Return the density by these numbers of ``moments`` and of random ``vectors``.

        The density and its error are the mean over the random vectors and the standard error of the
        mean. Raises :class:`~granphon.base.errors.InputError` for more vectors than
        :data:`MOST_MOMENTS` allows, and what :meth:`Moments.first` raises.
        """
        vectors = whole_number("vectors", vectors, 1, MOST_MOMENTS // moments)
        kernel = Kernel(self._operator.top / (2.0 * math.pi), moments)
        n_parts = len(self._has_rotations)
        n_products = vectors * n_parts * (moments // 2)
        with self._operator.progress.step("density of states", n_products) as step:
            moments_of_groups = [
                group.first(moments, step) for group in self._group_moments(vectors)
            ]
        traces = np.concatenate(moments_of_groups).reshape(vectors, n_parts, moments)
        # (vectors, 2, n_f) 1/Hz, of translations and rotations; zero where balls do not turn
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
        )._with_finder(partial(self.find, vectors=vectors))


def _find_error(densities: Array) -> Array:
    """Return the standard error (n_f,) of the mean over vectors of ``densities`` (vectors, n_f);
    nan for one vector, as its error is not known.
    """
    if len(densities) == 1:
        return np.full(densities.shape[1:], math.nan)
    return standard_error(densities, axis=0)
