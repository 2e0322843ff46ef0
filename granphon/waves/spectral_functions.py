"""Spectral functions of finite networks: the frequencies of a plane wave in an array that is not perfect, and its line."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property, partial

import numpy as np
from numpy.typing import ArrayLike, NDArray

from granphon.base.errors import InputError, message
from granphon.base.validation import finite_list, positive
from granphon.observables.validity import check_network
from granphon.waves.chebyshev import Kernel, Moments, Refinable, keeps_vectors
from granphon.waves.operator import WaveOperator
from granphon.waves.plane_waves import find_polarisations, fold_wavevectors, make_plane_wave, read_wavevectors

Array = NDArray[np.float64]
#: a Lorentz curve of the full width L is broadened by a kernel of the width G to l L + ((1 - l)^2 L^2 + G^2)^1/2. With
#: l = 0.5346 that is Voigt's curve, of a Gaussian (Olivero and Longbothum, J. Quant. Spectrosc. Radiat. Transf. 17, 233
#: (1977)); for the Jackson kernel, which is not quite one, it holds to 3e-3 with
_LINEAR = 0.465
#: width of a line over that of the kernel, from which it counts as resolved
_RESOLVED = 0.2
#: greatest relative difference of the wave vectors of spectral functions that are averaged
_SAME = 1e-9
#: greatest relative difference of their resolutions
_ALIKE = 0.02


def find_mean_free_path(velocity: Array, width: Array) -> Array:
    """Return the mean free path of the energy of a wave, m: phase velocity over 2 pi width; infinite where that is zero."""
    found = np.full(np.shape(width), math.inf)
    np.divide(velocity, 2.0 * math.pi * width, out=found, where=width > 0.0)
    return found


def find_attenuation(velocity: Array, width: Array) -> Array:
    """Return the attenuation of the amplitude, 1/m: half the inverse mean free path; infinite where the velocity is zero."""
    found = np.full(np.shape(width), math.inf)
    np.divide(math.pi * width, velocity, out=found, where=velocity > 0.0)
    return found


def find_lines(kernel: Kernel, values: Array) -> tuple[Array, Array]:
    """Return the highest line of each of the spectra ``values`` (n, n_f), 1/Hz, at the points of ``kernel``.

    It is the ``peak`` (n,), Hz, and the full ``width`` (n,) at half its height, Hz. Between points, which are even in theta,
    the logarithm is a parabola at the peak and a straight line on the flanks: both are right for a Gaussian, as the kernel
    is one. The spectrum goes on evenly below zero.
    """
    step, peaks, widths = math.pi / (2 * kernel.count - 1), np.zeros(len(values)), np.zeros(len(values))
    for number, row in enumerate(values):
        n, log = int(np.argmax(row)), np.log(np.maximum(row, np.finfo(float).tiny))
        place, height = float(n), float(log[n])
        if n < kernel.count - 1:
            left, right = float(log[abs(n - 1)]), float(log[n + 1])
            curved = left - 2.0 * height + right
            shift = 0.0 if curved >= 0.0 else 0.5 * (left - right) / curved
            place += shift
            height -= 0.25 * (left - right) * shift
        peaks[number] = peak = kernel.top * math.sin(step * place)
        low, sides = height - math.log(2.0), list[float]()
        for way, flank in ((-1, log[n::-1]), (1, log[n:])):  # where each flank falls to half the height, if it does
            under = np.flatnonzero(flank < low)
            if under.size:
                k = int(under[0])
                fall = n + way * float(k - 1 + (flank[k - 1] - low) / (flank[k - 1] - flank[k]))
                sides.append(abs(kernel.top * math.sin(step * fall) - peak))
        widths[number] = sum(sides) if len(sides) == 2 else 2.0 * sides[0]
    return peaks, widths


def true_width(seen: Array, kernel: Array) -> Array:
    """Return the widths of Lorentz curves which a kernel of the width ``kernel`` has broadened to the widths ``seen``."""
    seen, square = np.maximum(seen, kernel), (1.0 - _LINEAR) ** 2
    a = square - _LINEAR**2
    found = (np.sqrt(square * seen**2 - a * kernel**2) - _LINEAR * seen) / a
    return np.asarray(np.maximum(found, 0.0))


def find_ioffe_regel(wavenumber: Array, peak: Array, width: Array, product: float = 1.0) -> float | None:
    """Return the frequency, Hz, from which ``wavenumber`` times the mean free path is below ``product``; None if never.

    See :meth:`granphon.waves.spectral_functions.SpectralFunction.ioffe_regel`.
    """
    level = math.log(positive("product", product))
    order = np.argsort(wavenumber, kind="stable")
    peak, width = peak[order], width[order]
    with np.errstate(divide="ignore"):
        above = np.log(peak) - np.log(width) - level
    if above[0] < 0.0:
        what = f"the wave of the least q, at {peak[0]:.4g} Hz, is already beyond the Ioffe-Regel frequency"
        raise InputError(message(what, mend="Give lesser wave vectors, which a larger network has"))
    below = np.flatnonzero(above < 0.0)
    if not below.size:
        return None
    n = int(below[0])
    share = 0.0 if math.isinf(above[n - 1]) else above[n - 1] / (above[n - 1] - above[n])
    return float(peak[n] if math.isinf(above[n - 1]) else peak[n - 1] + share * (peak[n] - peak[n - 1]))


@dataclass(frozen=True, eq=False, repr=False)
class SpectralFunction(Refinable):
    """A(q, f) of plane waves on a network: the spectrum of ``<s| delta(f - D^1/2 / 2 pi) |s>``, s the wave of norm one.

    It is exact for the network but for the kernel, which broadens each line. A plane wave that is no mode of the network
    scatters into other modes, and its line has a width.

    Attributes
    ----------
    q : (n, d) wave vectors, Cartesian, 1/m.
    polarisation : "longitudinal", "transverse", "rotational", or "given" by numbers.
    direction : the direction that was given, or the numbers of the polarisation; empty if none was given.
    frequencies : (n_f,) Hz, from zero; Chebyshev nodes, four within the standard deviation of the kernel.
    values : (n, n_f) 1/Hz; the integral over frequencies is 1.
    top : bound of all frequencies, Hz, on which the polynomials are made.
    moments : number of Chebyshev moments.
    shortest : (n, d) the shortest wave vectors, 1/m, in whose waves all balls of the lattice move as in those of q. They
        differ from q by reciprocal vectors G with exp(i G . t) = 1 for the steps t between all balls of a cell. With one
        ball in a cell these are all G, and the shortest lie in the first zone. None where the network has no lattice, and
        where the sites of the lattice are no multiples of a 24th, or of a larger part, of its vectors.
    warnings : one sentence for each limit of the contact law that the network exceeds.
    """

    units = {"q": "1/m", "shortest": "1/m", "frequencies": "Hz", "values": "1/Hz", "top": "Hz"}
    _shapes = {"q": "n d", "shortest": "n d?", "frequencies": "f", "values": "n f"}

    q: Array
    polarisation: str
    direction: tuple[float, ...]
    frequencies: Array
    values: Array
    top: float
    moments: int
    shortest: Array | None = None
    warnings: tuple[str, ...] = ()

    @property
    def integral(self) -> Array:
        """(n,) integrals over all frequencies: 1."""
        return self._kernel.integral(self.values)

    # -- lines ----------------------------------------------------------------------------------------------------------

    @cached_property
    def _lines(self) -> tuple[Array, Array]:
        return find_lines(self._kernel, self.values)

    @cached_property
    def _kernel_width(self) -> Array:
        """(n,) the full width at half maximum that the kernel alone gives to a line at each peak, Hz."""
        return find_lines(self._kernel, self._kernel.line(self.peak))[1]

    @property
    def peak(self) -> Array:
        """(n,) frequency of the highest maximum, Hz: the dispersion of the coherent wave."""
        return self._lines[0]

    @cached_property
    def width(self) -> Array:
        """(n,) full width at half maximum of the highest line, Hz, without that of the kernel.

        The kernel's part is taken off as from a Lorentz curve that the kernel has broadened; a line that is not wider than
        the kernel has the width zero. See :attr:`resolved`. Where the line falls to half its height on one side alone, the
        width is twice the half width of that side.
        """
        return true_width(self._lines[1], self._kernel_width)

    @property
    def resolved(self) -> NDArray[np.bool_]:
        """(n,) whether each line has a width of its own of a fifth of the kernel's or more; less is not to be relied on."""
        return np.asarray(self.width >= _RESOLVED * self._kernel_width)

    @property
    def wavenumber(self) -> Array:
        """(n,) ``|q|``, 1/m; that of :attr:`shortest`, where there is one, as all balls move as in that wave."""
        return np.asarray(np.linalg.norm(self.q if self.shortest is None else self.shortest, axis=1))

    @property
    def phase_velocity(self) -> Array:
        """(n,) 2 pi peak over the :attr:`wavenumber`, m/s.

        Raises :class:`~granphon.base.errors.InputError` for q = 0, and for a q at which all balls move as at q = 0.
        """
        if np.any(self.wavenumber <= _SAME * np.linalg.norm(self.q, axis=1)):
            why = "Where exp(i q . r) is the same at all sites of a lattice, all balls move together, as at q = 0"
            raise InputError(message("a wave with q = 0 has no velocity", why, "Give other wave vectors"))
        return np.asarray(2.0 * math.pi * self.peak / self.wavenumber)

    @property
    def mean_free_path(self) -> Array:
        """(n,) mean free path of the energy of a wave, m: phase velocity over 2 pi width; infinite where the width is zero.

        The energy of a coherent wave falls as exp(-2 pi width t). Where bands bend, its group velocity is not the phase
        velocity, and the path is so much longer or shorter.
        """
        return find_mean_free_path(self.phase_velocity, self.width)

    @property
    def attenuation(self) -> Array:
        """(n,) attenuation of the amplitude, 1/m (neper per metre): half the inverse mean free path."""
        return find_attenuation(self.phase_velocity, self.width)

    def ioffe_regel(self, product: float = 1.0) -> float | None:
        """Return the frequency, Hz, from which wavenumber times mean free path is below ``product``; None if never.

        With 1 the mean free path is the wavelength over 2 pi, and the width the frequency; with pi it is half the
        wavelength. It lies between two wave vectors, in the order of their lengths: the first that is above and the next
        below; the logarithm of peak/width is interpolated. If already the shortest wave vector is below, there is no such
        frequency, and that is an :class:`~granphon.base.errors.InputError`.
        """
        return find_ioffe_regel(self.wavenumber, self.peak, self.width, product)

    # -- more of it -----------------------------------------------------------------------------------------------------

    @classmethod
    def average(cls, found: Sequence[SpectralFunction]) -> SpectralFunction:
        """Return the mean over arrays of one shape, at the points of the array with the highest ``top``.

        The others are interpolated (cubic splines), to about 1e-3 of their peaks. The mean does not refine.

        Raises :class:`~granphon.base.errors.InputError` if wave vectors or polarisations differ, or resolutions by more
        than 2 %: give all of them the same ``resolution``.
        """
        from scipy.interpolate import CubicSpline

        if not found:
            raise InputError(message("there are no spectral functions to average"))
        first = max(found, key=lambda one: one.top)
        for one in found:
            same = one.q.shape == first.q.shape and np.allclose(
                one.q, first.q, rtol=_SAME, atol=_SAME * np.max(np.abs(first.q))
            )
            if not same or (one.polarisation, one.direction) != (first.polarisation, first.direction):
                raise InputError(message("spectral functions of other wave vectors or polarisations have no mean"))
            if abs(one.resolution - first.resolution) > _ALIKE * first.resolution:
                what = f"the spectral functions have resolutions of {one.resolution:.6g} and {first.resolution:.6g} Hz"
                raise InputError(message(what, mend="Give all of them the same resolution"))
        points, every = first.frequencies, list[Array]()
        for one in found:  # zero from its ``top`` on
            if np.array_equal(points, one.frequencies):
                every.append(one.values)
            else:
                spline = CubicSpline(one.frequencies, one.values, axis=1)
                every.append(np.where(points <= one.frequencies[-1], spline(points), 0.0))
        values = np.mean(every, axis=0)
        return replace(first, values=values / first._kernel.integral(values)[:, None])


class PlaneWaves:
    """Moments of plane waves: of the cosine and the sine of each polarisation, which add up.

    The arguments are those of :meth:`granphon.waves.waves.Waves.spectral_function`.
    """

    def __init__(
        self, operator: WaveOperator, q: ArrayLike, polarisation: str | ArrayLike, direction: ArrayLike | None
    ) -> None:
        self._operator, self._q = operator, (q := read_wavevectors(operator.network, q))
        word = isinstance(polarisation, str)
        if word and polarisation == "longitudinal" and direction is not None and np.all(np.any(q, axis=1)):
            what = "a direction is given for a longitudinal wave, which moves along q"
            raise InputError(message(what, mend="Leave it out"))
        self._polarisation = str(polarisation) if word else "given"
        numbers = direction if word else polarisation
        self._direction = () if numbers is None else finite_list("direction", numbers)
        rows = [find_polarisations(operator, one, polarisation, direction) for one in q]
        waves = [
            (n, row, sine)
            for n, one in enumerate(rows)
            for row in one
            for sine in ((False, True) if any(q[n]) else (False,))
        ]
        keep = keeps_vectors(operator, len(waves))
        self._waves = [
            (n, Moments(operator, partial(make_plane_wave, operator, q[n], row, sine), keep=keep)) for n, row, sine in waves
        ]

    def find(self, moments: int) -> SpectralFunction:
        """Return the spectral function of this number of moments."""
        kernel = Kernel(self._operator.top / (2.0 * math.pi), moments)
        found = np.zeros((len(self._q), moments))
        for n, wave in self._waves:
            found[n] += wave.first(moments)
        if not np.all(found[:, 0] > 0.0):
            why = "The wave vector or the polarisation is wrong"
            raise InputError(message("no ball that touches others moves in this wave", why))
        return SpectralFunction(
            self._q, self._polarisation, self._direction, kernel.frequencies, kernel.densities(found / found[:, :1]),
            kernel.top, moments, fold_wavevectors(self._operator.network, self._q),
            check_network(self._operator.network).warnings,
        )._with_work(self.find)  # fmt: skip
