"""Complex bands: the wave numbers across the layers of a crystal that belong to given frequencies."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from granphon.base.errors import PrecisionError
from granphon.base.results import Result
from granphon.base.validation import frequency_array
from granphon.dynamics.bloch_waves import find_bloch_waves
from granphon.dynamics.damping import ContactDamping
from granphon.dynamics.half_space import HalfSpace
from granphon.networks.network import ContactNetwork

Array = NDArray[np.float64]
#: part of a wave that the next layer must have, at least: that of a wave number with three digits
_LEAST = 1e-12


@dataclass(frozen=True, eq=False, repr=False)
class ComplexBands(Result):
    """All waves across the layers of a crystal at given frequencies. ``np.asarray`` of it is ``wavenumbers``.

    A motion changes by exp(i k h) from layer to layer, in the time exp(-2 pi i f t). Waves of the first half of a row run or
    decay towards higher layers, waves of the second half towards lower layers. In each half running waves come first; the
    others follow, the slowest decay first. An imaginary part is infinite where a motion reaches no other layer at a
    frequency. The error of exp(i k h) is about 1e-15, so that of k h grows with the decay.

    Attributes
    ----------
    frequencies : (n_f,) Hz.
    wavenumbers : (n_f, 2 m) k, 1/m, complex; real parts from -pi/h to pi/h.
    running : (n_f,) number of waves that run towards higher layers.
    height : of a layer, h, m.
    """

    units = {"frequencies": "Hz", "wavenumbers": "1/m", "height": "m"}
    _shapes = {"frequencies": "f", "wavenumbers": "f k", "running": "f"}

    frequencies: Array
    wavenumbers: NDArray[np.complex128]
    running: NDArray[np.intp]
    height: float

    def __array__(self, dtype: Any = None, copy: bool | None = None) -> NDArray[Any]:
        return np.array(self.wavenumbers, dtype)

    @property
    def forward(self) -> NDArray[np.complex128]:
        """(n_f, m) the wave numbers of waves that run or decay towards higher layers, 1/m."""
        return self.wavenumbers[:, : self.wavenumbers.shape[1] // 2]

    @property
    def attenuation(self) -> Array:
        """(n_f,) decay of the wave that goes farthest, dB from layer to layer; zero in bands without losses."""
        return np.asarray(20.0 * math.log10(math.e) * self.height * np.min(self.forward.imag, axis=1))


def find_complex_bands(
    network: ContactNetwork, frequencies: ArrayLike, axis: Any, q: ArrayLike, damping: Any, loss_factor: Any
) -> ComplexBands:
    """Find the complex bands of a network; for the arguments see :meth:`Phonons.complex_bands`."""
    at = frequency_array("frequencies", frequencies, "above zero", in_order=False)
    space = HalfSpace(network, axis)
    damped = ContactDamping.of(space.cut, damping, loss_factor)
    along, omega = space.read_wavevector(q), at / space.units.frequency
    blocks = space.couplings(along, *(() if damped.is_none else damped.soften(2.0 * np.pi * at)))
    far = omega**2 * _LEAST > np.max(np.abs(blocks.inner))
    senses = [] if np.any(far) else find_bloch_waves(blocks, omega**2, space.size // space.reach)
    for n, pair in enumerate(senses):
        far[n] = any(np.any(np.abs(one.factors) ** sign < _LEAST) for one, sign in zip(pair, (1, -1), strict=True))
    if np.any(far):
        what = f"at {float(at[far][0]):g} Hz a wave decays by more than {1.0 / _LEAST:g} from layer to layer"
        raise PrecisionError(what, "Its wave number would have no digits", "Take other frequencies")
    size = space.size
    found = np.empty((len(at), 2, size), complex)
    for row, pair in zip(found, senses, strict=True):
        for half, waves, sign in zip(row, pair, (1.0, -1.0), strict=True):
            numbers = space.wavenumbers(waves.factors, along)
            numbers[: waves.running].imag = 0.0
            half[:] = complex(0.0, sign * np.inf)
            half[: len(numbers)] = numbers
    found = found[:, :, np.any(np.isfinite(found), axis=(0, 1))]  # what reaches no other layer at any frequency is no wave
    return ComplexBands(at, found.reshape(len(at), -1), np.array([one.running for one, _ in senses]), space.height)
