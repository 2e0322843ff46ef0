"""The highest line of a spectrum: its peak, its width, and the width without the kernel's part."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from granphon.base.arguments import positive
from granphon.base.errors import InputError, message
from granphon.waves.kernel import Kernel

Array = NDArray[np.float64]
#: a Lorentz curve of the full width L is broadened by a kernel of the width G to l L + ((1 - l)^2 L^2 + G^2)^1/2. With
#: l = 0.5346 that is Voigt's curve, of a Gaussian (Olivero and Longbothum, J. Quant. Spectrosc. Radiat. Transf. 17, 233
#: (1977)); for the Jackson kernel, which is not quite one, it holds to 3e-3 with
_LINEAR = 0.465


class Lines(NamedTuple):
    """The ``peak`` (n,) of each spectrum, Hz, and the full ``width`` (n,) at half its height, Hz."""

    peak: Array
    width: Array


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


def find_lines(kernel: Kernel, values: Array) -> Lines:
    """Return the highest line of each of the spectra ``values`` (n, n_f), 1/Hz, at the points of ``kernel``."""
    found = [_find_line(kernel, row) for row in values]
    return Lines(np.array([one[0] for one in found]), np.array([one[1] for one in found]))


def _find_line(kernel: Kernel, row: Array) -> tuple[float, float]:
    """Return the peak and the full width at half maximum of one spectrum.

    Between points, which are even in theta, the logarithm is a parabola at the peak and a straight line on the flanks: both
    are right for a Gaussian, as the kernel is one. The spectrum goes on evenly below zero.
    """
    tiny = np.finfo(float).tiny
    n = int(np.argmax(row))
    log = np.log(np.maximum(row, tiny))
    step, place, height = math.pi / (2 * kernel.count - 1), float(n), float(log[n])
    if n < kernel.count - 1:
        left, right = float(log[abs(n - 1)]), float(log[n + 1])
        curved = left - 2.0 * height + right
        shift = 0.0 if curved >= 0.0 else 0.5 * (left - right) / curved
        place += shift
        height -= 0.25 * (left - right) * shift
    peak = kernel.top * math.sin(step * place)
    low = height - math.log(2.0)
    sides = [
        abs(kernel.top * math.sin(step * fall) - peak)
        for fall in (_find_fall(log, n, -1, low), _find_fall(log, n, 1, low))
        if fall is not None
    ]
    return peak, sum(sides) if len(sides) == 2 else 2.0 * sides[0]


def _find_fall(log: Array, n: int, way: int, low: float) -> float | None:
    """Return the place, in points, where ``log`` falls to ``low`` on the ``way`` from n, 1 or -1; None if it does not."""
    side = log[n:] if way > 0 else log[n::-1]
    under = np.flatnonzero(side < low)
    if not under.size:
        return None
    k = int(under[0])
    return n + way * float(k - 1 + (side[k - 1] - low) / (side[k - 1] - side[k]))


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
        raise InputError(
            message(
                f"the wave of the least q, at {peak[0]:.4g} Hz, is already beyond the Ioffe-Regel frequency",
                mend="Give lesser wave vectors, which a larger network has",
            )
        )
    below = np.flatnonzero(above < 0.0)
    if not below.size:
        return None
    n = int(below[0])
    share = 0.0 if math.isinf(above[n - 1]) else above[n - 1] / (above[n - 1] - above[n])
    return float(peak[n] if math.isinf(above[n - 1]) else peak[n - 1] + share * (peak[n] - peak[n - 1]))
