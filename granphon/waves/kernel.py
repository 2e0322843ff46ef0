"""The kernel polynomial method in the frequency: from Chebyshev moments of a spectrum to its density.

A spectrum of frequencies f from 0 to ``top``, continued as an even function to -top, has the even moments

    mu_n = integral rho(f) T_2n(f/top) df,

and with f = top cos(theta) its density is

    rho(f) = 2 / (pi top sin(theta)) (mu_0 + 2 sum_n g_n mu_n cos(2 n theta)).

The Jackson kernel g (Weisse, Wellein, Alvermann, Fehske, Rev. Mod. Phys. 78, 275 (2006), Eq. 71) makes of each line a bell
that is nowhere below zero and nearly a Gaussian, whose standard deviation in theta is pi / 2M with M moments.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import ArrayLike, NDArray

from granphon.base.arguments import positive, whole_number
from granphon.base.errors import InputError, message

Array = NDArray[np.float64]
#: number of moments, if none is given: a resolution of 0.6 % of the top frequency
MOMENTS = 256
#: most moments: their densities alone are 32 MiB
_MOST = 2**20
#: fewest moments of a given resolution
_LEAST = 4
#: points of a density within the standard deviation of the kernel
_POINTS = 4
#: share of a moment that counts for rounding
_ROUNDING = 1e-12


@dataclass(frozen=True)
class Kernel:
    """The Jackson kernel of a number of moments.

    Attributes
    ----------
    top : a bound of all frequencies, Hz.
    moments : the number M of moments mu_0 to mu_(M-1), 2 or more.
    """

    top: float
    moments: int

    @classmethod
    def of(cls, top: float, resolution: float | None = None, moments: int | None = None) -> Kernel:
        """Return the kernel of a ``resolution``, Hz, or of a number of ``moments``; of :data:`MOMENTS` without either.

        Raises :class:`~granphon.base.errors.InputError` if both are given, or if there would be too many moments,
        or too few.
        """
        if resolution is None:
            return cls(top, whole_number("moments", MOMENTS if moments is None else moments, 2, _MOST))
        if moments is not None:
            raise InputError(message("a resolution and a number of moments are given", "Each follows from the other"))
        wanted = math.pi * top / (2.0 * positive("resolution", resolution, "Hz"))
        if wanted > _MOST:
            least = math.pi * top / (2.0 * _MOST)
            raise InputError(
                message(
                    f"a resolution of {resolution:g} Hz takes {wanted:.3g} moments, as frequencies go up to {top:g} Hz",
                    mend=f"Give {least:.3g} Hz or more",
                )
            )
        if wanted < _LEAST:
            most = math.pi * top / (2.0 * _LEAST)
            raise InputError(
                message(f"a resolution of {resolution:g} Hz tells no frequencies apart, as they go up to {top:g} Hz",
                        mend=f"Give {most:.3g} Hz or less")
            )  # fmt: skip
        return cls(top, max(math.ceil(wanted * (1.0 - _ROUNDING)), 2))

    @property
    def resolution(self) -> float:
        """Standard deviation of the kernel at frequency zero, where it is largest, Hz; at f it is that times sin(theta)."""
        return math.pi * self.top / (2.0 * self.moments)

    @cached_property
    def weights(self) -> Array:
        """(M,) factors g_n of the moments."""
        angle = math.pi / (2.0 * self.moments)
        order = 2.0 * np.arange(self.moments)
        falling = (2.0 * self.moments - order) * np.cos(order * angle) + np.sin(order * angle) / math.tan(angle)
        return np.asarray(falling / (2.0 * self.moments))

    @property
    def count(self) -> int:
        """Number of points of a density."""
        return _POINTS * self.moments + 1

    @cached_property
    def angles(self) -> Array:
        """(n_f,) theta of the points of a density, in the order of ascending frequencies: from pi/2 down to nearly zero."""
        return np.asarray(math.pi * (self.count - 0.5 - np.arange(self.count)) / (2 * self.count - 1))

    @cached_property
    def frequencies(self) -> Array:
        """(n_f,) points of a density, Hz: zero, and on to the last Chebyshev node below ``top``."""
        return np.asarray(self.top * np.sin(math.pi * np.arange(self.count) / (2 * self.count - 1)))

    def densities(self, moments: ArrayLike) -> Array:
        """Return the densities (..., n_f), 1/Hz, of the ``moments`` (..., M)."""
        from scipy.fft import dct

        moments = np.asarray(moments, float)
        series = np.zeros((*moments.shape[:-1], 2 * self.count - 1))
        series[..., : 2 * self.moments : 2] = self.weights * moments
        summed = dct(series, type=3, axis=-1)[..., : self.count]
        return np.asarray(summed[..., ::-1] * (2.0 / (math.pi * self.top * np.sin(self.angles))))

    def line(self, frequency: ArrayLike) -> Array:
        """Return the densities (..., n_f), 1/Hz, of single lines at frequencies (...), Hz: the kernel itself."""
        return self.densities(self.moments_of(frequency))

    def moments_of(self, frequency: ArrayLike) -> Array:
        """Return the moments (..., M) of single lines at frequencies (...), Hz, from 0 to ``top``."""
        theta = np.arccos(np.clip(np.asarray(frequency, float) / self.top, 0.0, 1.0))
        return np.cos(2.0 * theta[..., None] * np.arange(self.moments))

    def integral(self, densities: Array) -> Array:
        """Return the integrals (...) of ``densities`` (..., n_f): by Gauss and Chebyshev's rule, exact to rounding."""
        weights = np.sin(self.angles) * (math.pi * self.top / (2 * self.count - 1))
        weights[0] *= 0.5  # the point at zero stands for both sides
        return np.asarray(densities @ weights)

    def check_points(self, frequencies: Array) -> None:
        """Raise :class:`~granphon.base.errors.InputError` if ``frequencies`` are not the points of a density."""
        if frequencies.size != self.count or not np.allclose(frequencies, self.frequencies, rtol=_ROUNDING, atol=0.0):
            raise InputError(
                message(f"the frequencies are not those of {self.moments} moments up to {self.top:g} Hz",
                        mend="Compute the spectrum again")
            )  # fmt: skip
