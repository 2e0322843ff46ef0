"""The balls in the samples of a simulation: their number, and their diameters, given or drawn from a seed."""

from __future__ import annotations

from concurrent.futures import Executor
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from granphon.balls.diameters import Measured
from granphon.balls.lattices import TRIANGULAR
from granphon.balls.motions import IN_PLANE
from granphon.balls.packing import Packing
from granphon.base.arguments import finite_array, whole_number
from granphon.base.errors import InputError, brief, message
from granphon.base.results import read_only

__all__ = ["MOST_SEED", "SampledBalls"]

Array = NDArray[np.float64]
#: the largest seed of a sample
MOST_SEED = 2**64 - 1
#: greatest number of balls along a side of a sample, far beyond what fits into memory
_MOST_SIDE = 2**31
#: greatest number of samples, far beyond what fits into memory
_MOST_SAMPLES = 2**31
#: least width over diameter: where overlaps are more than 1e20 widths, some samples find no equilibrium
_LEAST_WIDTH = 1e-20


@dataclass(frozen=True, eq=False)
class SampledBalls:
    """The balls of one or more samples; the base class of :class:`granphon.DirectSimulation`, which describes the fields.

    ``executor`` and ``workers`` do not change results, so that comparisons leave them out.
    """

    packing: Packing
    shape: tuple[int, int] = (128, 128)
    seed: int = 0
    samples: int = 1
    diameters: Array | None = None
    executor: Executor | None = field(default=None, compare=False, repr=False)
    workers: int = field(default=1, compare=False, repr=False)

    def __post_init__(self) -> None:
        if not isinstance(self.packing, Packing):
            raise InputError(message(f"packing is {self.packing!r}", mend="Give a granphon.Packing"))
        if self.packing.structure != TRIANGULAR:
            raise InputError(
                message(
                    f"the {self.packing.structure.name} lattice is not simulated",
                    "Without friction, only the triangular lattice holds its shape",
                    "Use another medium, or the triangular lattice",
                )
            )
        if self.packing.motions not in (None, IN_PLANE.name) or self.packing.bending:
            what = "bending" if self.packing.bending else f"the motions {self.packing.motions!r}"
            raise InputError(
                message(
                    f"balls with {what} are not simulated",
                    "Simulated balls move in the plane, and their contacts resist compression and shear",
                    "Use another medium, or leave it out",
                )
            )
        shape = tuple(whole_number("shape", length, 1, _MOST_SIDE) for length in _read_shape(self.shape))
        object.__setattr__(self, "shape", shape)
        if self.diameters is not None:
            self._take(self.diameters)
        if 0.0 < self.packing.width < _LEAST_WIDTH * self.packing.diameter:
            what = f"the width of the diameters is {self.packing.width / self.packing.diameter:.3g} of their mean"
            raise InputError(message(what, f"Samples are simulated from {_LEAST_WIDTH:g} on", "Leave the spread out"))
        object.__setattr__(self, "samples", whole_number("samples", self.samples, 1, _MOST_SAMPLES))
        object.__setattr__(self, "seed", whole_number("seed", self.seed, 0, MOST_SEED + 1 - self.samples))
        whole_number("workers", self.workers, 1)
        if self.diameters is not None and self.samples > 1:
            raise InputError(message("diameters are given, which make one sample", mend="Leave samples out"))
        if self.executor is not None and not hasattr(self.executor, "submit"):
            raise InputError(message(f"executor is {self.executor!r}", mend="Give a concurrent.futures.Executor, or none"))

    def __eq__(self, other: object) -> bool:
        if not isinstance(other, SampledBalls):
            return NotImplemented
        return self._key == other._key and bool(np.all(np.asarray(self.diameters) == np.asarray(other.diameters)))

    def __hash__(self) -> int:
        return hash(self._key)

    @property
    def _key(self) -> tuple[Any, ...]:
        """Everything that determines the results, except the values of given diameters."""
        return self.packing, self.shape, self.seed, self.samples, self.diameters is None

    def _take(self, diameters: ArrayLike) -> None:
        """Store given diameters (m); the sample takes their shape, and the packing their spread if it has none."""
        array = read_only(finite_array("diameters", diameters, "m", "above zero"))
        if array.ndim != 2:
            raise InputError(message(f"diameters have the shape {array.shape}", mend="Give an array (L1, L2)"))
        packing = self.packing
        if packing.spread is None and np.ptp(array):
            # the packing takes the mean of the shifted list, which rounding may have changed
            spread = Measured(tuple((packing.diameter + (array - np.mean(array))).ravel().tolist()))
            packing = replace(packing, spread=spread, diameter=spread.mean)
        object.__setattr__(self, "packing", packing)
        object.__setattr__(self, "diameters", array)
        if self.shape not in (SampledBalls.shape, array.shape):
            what = f"shape is {self.shape!r}, and the diameters have the shape {array.shape}"
            raise InputError(message(what, "The diameters determine the shape of the sample", "Leave shape out"))
        object.__setattr__(self, "shape", array.shape)

    def deviations(self, index: int) -> Array:
        """Return the reduced deviations x = Delta/W of the diameters of a sample, (L1, L2), with mean zero."""
        packing = self.packing
        if packing.spread is None:
            return np.zeros(self.shape)
        given = self.diameters if self.diameters is not None else packing.spread.sample(self.shape, self.seed + index)
        # the mean is subtracted twice, so that what remains is zero to the rounding of the deviations, not of the diameters
        off = given - np.mean(given)
        return np.asarray((off - np.mean(off)) / packing.width_units.width)


def _read_shape(shape: Any) -> tuple[Any, Any]:
    try:
        first, second = shape
    except (TypeError, ValueError):
        raise InputError(message(f"shape is {brief(shape)}", mend="Give two whole numbers, (L1, L2)")) from None
    return first, second
