"""Chebyshev polynomials of the dynamical matrix, and the kernel polynomial method for spectra of
frequencies.

The polynomials T_n(2 D / top^2 - 1) of D are the even polynomials T_2n(omega / top) of omega =
D^1/2. An expansion in these even polynomials, with a kernel made for omega, resolves frequencies
evenly down to zero; one made for D = omega^2 would not. A spectrum rho of frequencies f from 0 to
``top``, continued as an even function to -top, has the even moments

    mu_n = integral rho(f) T_2n(f/top) df,

and with f = top cos(theta) its density is

    rho(f) = 2 / (pi top sin(theta)) (mu_0 + 2 sum_n g_n mu_n cos(2 n theta)).

The Jackson kernel g (Weisse, Wellein, Alvermann, Fehske, Rev. Mod. Phys. 78, 275 (2006), Eq. 71)
broadens each line into a bell that is nowhere below zero and nearly a Gaussian, whose standard
deviation in theta is pi / 2M with M moments.
"""

from __future__ import annotations

import decimal
import math
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any, Self

import numpy as np
from numpy.typing import ArrayLike

from granphon.base.arrays import Array
from granphon.base.errors import InputError
from granphon.base.progress import Step, silent
from granphon.base.results import Result, read_only
from granphon.base.validation import positive, whole_number
from granphon.waves.operator import WaveOperator, explain_instability
from granphon.waves.settings import MOMENTS

#: most moments: a density of so many moments takes 32 MiB
_MOST_MOMENTS = 2**20
#: fewest moments that a given resolution may need
_LEAST_MOMENTS = 4
#: points of a density within the standard deviation of the kernel
_POINTS_PER_DEVIATION = 4
#: relative difference of frequencies, and of numbers of moments before they are rounded up, that is
#: rounding
_ROUNDING = 1e-12
#: most bytes of vectors that a result keeps, so that more moments go on from these vectors; a
#: result whose vectors would take more keeps none, and for more moments begins the recursion again
_MOST_KEPT_BYTES = 2**28
#: digits of a resolution in a message
_N_DIGITS = 3
#: share by which rounding may raise a moment above that of order zero, and the norm of T_n x above
#: that of x; greater ones have a squared frequency below zero
GROWTH = 1e-6


@dataclass(frozen=True)
class Kernel:
    """The Jackson kernel of a number of moments, and the frequencies at which it gives densities.

    Attributes
    ----------
    top : a bound of all frequencies, Hz.
    moments : the number M of moments mu_0 to mu_(M-1), 2 or more.
    """

    top: float
    moments: int

    @classmethod
    def of(cls, top: float, resolution: float | None = None, moments: int | None = None) -> Kernel:
        """Return the kernel of a number of ``moments``, or the kernel with the fewest moments whose
        resolution is at least as fine as ``resolution``, Hz; without either, that of
        :data:`MOMENTS`.

        ``top`` is the bound of all frequencies, Hz. Raises
        :class:`~granphon.base.errors.InputError` if both are given, for a resolution that is not
        above zero, and if the number of moments is not whole, or would be too large or too small.
        """
        if resolution is None:
            count = MOMENTS if moments is None else moments
            return cls(top, whole_number("moments", count, 2, _MOST_MOMENTS))
        if moments is not None:
            raise InputError(
                "a resolution and a number of moments are given",
                "Each follows from the other",
                "Leave one of them out",
            )
        resolution = positive("resolution", resolution, "Hz")
        # the resolution of M moments is pi top / 2M
        least_count = math.pi * top / (2.0 * resolution)
        if least_count > _MOST_MOMENTS:
            finest_resolution = _round(cls(top, _MOST_MOMENTS).resolution, decimal.ROUND_CEILING)
            raise InputError(
                f"a resolution of {resolution:g} Hz takes {least_count:.3g} moments, as frequencies"
                f" go up to {top:g} Hz",
                mend=f"Give {finest_resolution:g} Hz or more",
            )
        if least_count < _LEAST_MOMENTS:
            coarsest_resolution = _round(cls(top, _LEAST_MOMENTS).resolution, decimal.ROUND_FLOOR)
            raise InputError(
                f"a resolution of {resolution:g} Hz tells no frequencies apart, as they go up to"
                f" {top:g} Hz",
                mend=f"Give {coarsest_resolution:g} Hz or less",
            )
        # a whole number that rounding lifted a little is not rounded up to the next one
        return cls(top, math.ceil(least_count * (1.0 - _ROUNDING)))

    @property
    def resolution(self) -> float:
        """Standard deviation of the kernel at frequency zero, Hz, where the kernel is broadest; at
        the frequency f = top cos(theta) it is this times sin(theta).
        """
        return math.pi * self.top / (2.0 * self.moments)

    @cached_property
    def weights(self) -> Array:
        """(M,) factors g_n of the moments: those of Jackson for 2M orders, at the even orders."""
        n_orders = 2.0 * self.moments  # even and odd orders
        angle = math.pi / n_orders
        orders = 2.0 * np.arange(self.moments)
        cosines = (n_orders - orders) * np.cos(orders * angle)
        sines = np.sin(orders * angle) / math.tan(angle)
        return read_only((cosines + sines) / n_orders)

    @property
    def count(self) -> int:
        """Number of points of a density."""
        return _POINTS_PER_DEVIATION * self.moments + 1

    @cached_property
    def angles(self) -> Array:
        """(n_f,) angles theta of the frequencies of a density, f = top cos(theta), in the order of
        ascending frequencies: from pi/2 down to nearly zero.
        """
        steps_from_top = self.count - 0.5 - np.arange(self.count)
        return read_only(math.pi * steps_from_top / (2 * self.count - 1))

    @cached_property
    def frequencies(self) -> Array:
        """(n_f,) frequencies of a density, Hz, ascending: the Chebyshev nodes from zero to the last
        one below ``top``.
        """
        # pi/2 - theta, of which the sine is exact at zero
        complements = math.pi * np.arange(self.count) / (2 * self.count - 1)
        return read_only(self.top * np.sin(complements))

    def densities(self, moments: ArrayLike) -> Array:
        """Return the densities (..., n_f), 1/Hz, at :attr:`frequencies`, of spectra with the
        ``moments`` (..., M).
        """
        from scipy.fft import dct

        moments = np.asarray(moments, float)
        # coefficients of the orders 0 to 2 n_f - 2 of a cosine series, which the transform sums at
        # the nodes from top down to -top; odd orders are zero, as the density is even
        coefficients = np.zeros((*moments.shape[:-1], 2 * self.count - 1))
        coefficients[..., : 2 * self.moments : 2] = self.weights * moments
        sums = dct(coefficients, type=3, axis=-1)[..., : self.count]
        ascending_sums = sums[..., ::-1]  # in the order of ascending frequencies
        # the factor before the sum over moments in the head of this module
        return np.asarray(ascending_sums * (2.0 / (math.pi * self.top * np.sin(self.angles))))

    def line(self, frequency: ArrayLike) -> Array:
        """Return the densities (..., n_f), 1/Hz, at :attr:`frequencies`, of single lines: the shape
        of the kernel around each ``frequency`` (...), Hz.
        """
        return self.densities(self.moments_of(frequency))

    def moments_of(self, frequency: ArrayLike) -> Array:
        """Return the moments (..., M) of single lines, one at each ``frequency`` (...), Hz, between
        0 and ``top``.
        """
        # rounding may have put a frequency beyond the bounds
        theta = np.arccos(np.clip(np.asarray(frequency, float) / self.top, 0.0, 1.0))
        return np.cos(2.0 * theta[..., None] * np.arange(self.moments))

    def integral(self, densities: Array) -> Array:
        """Return the integrals (...) over all frequencies of ``densities`` (..., n_f), 1/Hz, by the
        rule of Gauss and Chebyshev, which is exact for these densities but for rounding.
        """
        weights = np.sin(self.angles) * (math.pi * self.top / (2 * self.count - 1))  # Hz
        weights[0] *= 0.5  # half of the interval around the point at zero lies below zero
        return np.asarray(densities @ weights)

    def check_points(self, frequencies: Array) -> None:
        """Raise :class:`~granphon.base.errors.InputError` if ``frequencies``, Hz, of a result that
        was read from data, are not :attr:`frequencies`.
        """
        is_complete = frequencies.size == self.count
        if not is_complete or not np.allclose(frequencies, self.frequencies, _ROUNDING, 0.0):
            fault = f"the frequencies are not those of {self.moments} moments up to {self.top:g} Hz"
            raise InputError(fault, mend="Compute the spectrum again")


def _round(resolution: float, rounding: str) -> float:
    """Return a ``resolution`` to :data:`_N_DIGITS` significant digits, by a ``rounding`` of
    :mod:`decimal`.
    """
    context = decimal.Context(_N_DIGITS, rounding)
    return float(context.create_decimal_from_float(resolution))


def polynomials(operator: WaveOperator, start: Array) -> Iterator[Array]:
    """Yield T_n(2 D / top^2 - 1) x for n = 0, 1, 2, ... without end; x is ``start``, a vector
    (size,) or m vectors (size, m).

    Each array that is yielded holds its numbers until the next array has been yielded, and may then
    be overwritten: a caller that needs the numbers for longer copies them.
    """
    previous = np.array(start, float)
    yield previous
    current = 2.0 / operator.top**2 * (operator @ previous) - previous
    while True:
        yield current
        following = operator.advance(current, previous)
        previous = current
        current = following


def keeps_vectors(operator: WaveOperator, n_recursions: int) -> bool:
    """Return whether the last two vectors of each of ``n_recursions`` take few enough bytes to be
    kept with a result.
    """
    n_numbers = 2 * operator.size * n_recursions
    return 8 * n_numbers <= _MOST_KEPT_BYTES


class Moments:
    """The moments mu_n = <x| T_n(2 D / top^2 - 1) |x> of some vectors x.

    :meth:`first` computes moments when they are requested, and keeps them for later requests. Two
    moments cost one product of D with a vector: mu_2n = 2 <x_n|x_n> - mu_0 and mu_2n+1 =
    2 <x_n+1|x_n> - mu_1 with x_n = T_n x. Several vectors share each product, for which the matrix
    is read once (:attr:`WaveOperator.vectors_at_once`).

    Parameters
    ----------
    operator : D.
    starts : functions that make the vectors x, (size,) each.
    is_kept : whether the last two vectors T_n x of each recursion are kept, so that a request for
        more moments goes on from these vectors. Without them the recursion begins again; the
        moments are the same to the last bit.
    """

    def __init__(
        self,
        operator: WaveOperator,
        starts: Sequence[Callable[[], Array]],
        *,
        is_kept: bool = False,
    ) -> None:
        block_size = operator.vectors_at_once
        self._recursions = [
            _Recursion(operator, starts[first : first + block_size], is_kept)
            for first in range(0, len(starts), block_size)
        ]

    def first(self, count: int, step: Step = silent) -> Array:
        """Return the first ``count`` moments of each of the m vectors, (m, count); the progress
        ``step`` is told of each product with a vector.

        Raises :class:`~granphon.base.errors.InstabilityError` if moments exceed that of order zero,
        as where a squared frequency is below zero.
        """
        return np.vstack([recursion.first(count, step) for recursion in self._recursions])


class _Recursion:
    """The recursion T_n x of m vectors x that share each product with D, and the moments found so
    far; the parameters are those of :class:`Moments`.
    """

    def __init__(
        self, operator: WaveOperator, starts: Sequence[Callable[[], Array]], is_kept: bool
    ) -> None:
        self._operator = operator
        self._starts = starts
        self._is_kept = is_kept
        self._moments: list[Array] = []  # of each order, those of all vectors, (m,)
        self._vectors: Iterator[Array] | None = None  # yields T_n x; None before it has begun
        self._last: Array | None = None  # the T_n x that was yielded last

    def first(self, count: int, step: Step) -> Array:
        """Return the first ``count`` moments of each vector, (m, count).

        Moments that are not known are computed. If this needs the recursion and its vectors were
        not kept, known moments are dropped and the recursion begins again. The ``step`` is told of
        each product with a vector. Raises what :meth:`_add_two` raises.
        """
        moments = self._moments
        if len(moments) < count and self._vectors is None:
            moments.clear()
            starts = [start() for start in self._starts]
            vectors = starts[0] if len(starts) == 1 else np.stack(starts, axis=1)
            self._vectors = polynomials(self._operator, vectors)
            self._last = next(self._vectors)
            moments.append(_multiply(self._last, self._last))
        while len(moments) < count:
            self._add_two()
            step.advance(len(self._starts))
        if not self._is_kept:
            self._vectors = None
            self._last = None
        return np.array(moments[:count]).T

    def _add_two(self) -> None:
        """Append the next two moments, of an odd and of an even order, by one more product with D
        for each vector.

        Raises :class:`~granphon.base.errors.InstabilityError` if the moments grow.
        """
        assert self._vectors is not None
        assert self._last is not None
        moments = self._moments
        vectors = next(self._vectors)  # does not yet overwrite the last vectors
        products = _multiply(vectors, self._last)
        is_first_order = len(moments) == 1  # mu_1 is the product itself
        moments.append(products if is_first_order else 2.0 * products - moments[1])
        moments.append(2.0 * _multiply(vectors, vectors) - moments[0])
        self._last = vectors
        # nan compares as false, so that moments that overflowed are unstable, too
        is_bounded = np.abs(moments[-1]) <= (1.0 + GROWTH) * moments[0]
        if not np.all(is_bounded):
            raise explain_instability(self._operator.network)


def _multiply(left: Array, right: Array) -> Array:
    """Return the scalar products (m,) of the columns of two arrays (size, m), or the one product
    (1,) of two vectors (size,).
    """
    if left.ndim == 1:
        return np.array([np.vdot(left, right)])
    return np.asarray(np.einsum("nm,nm->m", left, right))


class Refinable(Result):
    """A frozen spectrum, broadened by the Jackson kernel, that can be computed again with more
    moments or a finer resolution.

    More moments are computed from the network, which plain data and pickles do not keep, and means
    of spectra do not have: a spectrum from data, or that is a mean, stays as it is.

    Attributes
    ----------
    frequencies : (n_f,) Hz, the points of the kernel; see :attr:`Kernel.frequencies`.
    top : bound of all frequencies, Hz.
    moments : number of Chebyshev moments.
    """

    frequencies: Array
    top: float
    moments: int
    #: the function that finds the result of a number of moments; None in a result from data, and in
    #: a mean of results
    _finder: Callable[..., Any] | None = None

    def _check(self) -> None:
        """Raise :class:`~granphon.base.errors.InputError` unless shapes fit together and the
        frequencies are those of the kernel of this number of moments.
        """
        super()._check()
        self._kernel.check_points(self.frequencies)

    @cached_property
    def _kernel(self) -> Kernel:
        """The kernel by which lines are broadened."""
        return Kernel.of(self.top, moments=self.moments)

    @property
    def resolution(self) -> float:
        """Standard deviation of the kernel at frequency zero, Hz; at the frequency f it is this
        times (1 - (f/top)^2)^1/2.
        """
        return self._kernel.resolution

    def _with_finder(self, finder: Callable[..., Self]) -> Self:
        """Keep ``finder``, the function that finds the result of a number of moments, in this
        result, and return this result.
        """
        object.__setattr__(self, "_finder", finder)  # the result is frozen for everyone else
        return self

    def _require_finder(self) -> Callable[..., Self]:
        """Return the function that finds the result of a number of moments.

        Raises :class:`~granphon.base.errors.InputError` if this result was read from data, or is a
        mean.
        """
        if self._finder is None:
            name = type(self).__name__
            raise InputError(
                f"this {name} was read from data, or is a mean",
                "Then it does not have the network",
                "Ask gp.Waves(network) for it again; of a mean, for each of its parts",
            )
        return self._finder

    def with_moments(self, moments: int) -> Self:
        """Return the result of this number of moments. Moments that are known are not computed
        again, unless more are requested and the vectors were too large to be kept.

        The result is the same, bit for bit, as if that number had been requested at once. Raises
        :class:`~granphon.base.errors.InputError` if this result was read from data, or is a mean;
        for a number that is not whole or out of range; and for more moments than memory, or the
        limit on the moments of all random vectors, allows.
        """
        return self._require_finder()(Kernel.of(self.top, moments=moments).moments)

    def with_resolution(self, resolution: float) -> Self:
        """Return the result whose resolution is at least as fine as ``resolution``, Hz, with the
        fewest moments; see :meth:`with_moments`, which also says what is raised.

        Raises :class:`~granphon.base.errors.InputError` also for a resolution that is not above
        zero, or takes fewer than four moments.
        """
        return self._require_finder()(Kernel.of(self.top, resolution).moments)
