"""Which balls the samples of a simulation have: their number, their diameters, and where these come from."""

from __future__ import annotations

from concurrent.futures import Executor
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from granphon.balls.diameters import Measured
from granphon.balls.lattices import TRIANGULAR
from granphon.balls.packing import Packing
from granphon.base.arguments import finite_array, whole_number
from granphon.base.errors import InputError, brief, message
from granphon.base.results import read_only

__all__ = ["MOST_SEED", "SampledBalls"]

Array = NDArray[np.float64]
#: the largest seed of a sample
MOST_SEED = 2**64 - 1
#: balls along a side of a sample, of which no machine holds a millionth
_MOST_SIDE = 2**31
#: samples, of which no machine holds a millionth
_MOST_SAMPLES = 2**31
#: least width over diameter: where overlaps are more widths than this some samples do not come to rest
_LEAST_WIDTH = 1e-20


@dataclass(frozen=True, eq=False)
class SampledBalls:
    """The balls of one or more samples; the base of :class:`granphon.DirectSimulation`, which describes the fields.

    ``executor`` and ``workers`` do not change the numbers, and are not compared.
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
        shape = tuple(whole_number("shape", length, 1, _MOST_SIDE) for length in _pair(self.shape))
        object.__setattr__(self, "shape", shape)
        if self.diameters is not None:
            self._take(self.diameters)
        if 0.0 < self.packing.width < _LEAST_WIDTH * self.packing.diameter:
            what = f"the width of the diameters is {self.packing.width / self.packing.diameter:.3g} of their mean"
            raise InputError(message(what, f"Below {_LEAST_WIDTH:g} a sample is not simulated", "Leave the spread out"))
        object.__setattr__(self, "samples", whole_number("samples", self.samples, 1, _MOST_SAMPLES))
        object.__setattr__(self, "seed", whole_number("seed", self.seed, 0, MOST_SEED + 1 - self.samples))
        whole_number("workers", self.workers, 1)
        if self.diameters is not None and self.samples > 1:
            raise InputError(message("diameters are those of one sample", mend="Leave samples out"))
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
        """All that determines the numbers, but for given diameters."""
        return self.packing, self.shape, self.seed, self.samples, self.diameters is None

    def _take(self, diameters: ArrayLike) -> None:
        """Given diameters: their shape, and their spread if the packing has none."""
        array = read_only(finite_array("diameters", diameters, "m", "above zero"))
        if array.ndim != 2:
            raise InputError(message(f"diameters have the shape {array.shape}", mend="Give an array (L1, L2)"))
        packing = self.packing
        if packing.spread is None and np.ptp(array):
            # the mean of the list, which its own rounding may move, is the packing's
            spread = Measured(tuple((packing.diameter + (array - np.mean(array))).ravel().tolist()))
            packing = replace(packing, spread=spread, diameter=spread.mean)
        object.__setattr__(self, "packing", packing)
        object.__setattr__(self, "diameters", array)
        if self.shape not in (SampledBalls.shape, array.shape):
            what = f"shape is {self.shape!r}, and the diameters have {array.shape}"
            raise InputError(message(what, "A sample of given balls has their shape", "Leave shape out"))
        object.__setattr__(self, "shape", array.shape)

    def deviations(self, index: int) -> Array:
        """(L1, L2) x = Delta/W of a sample, of mean zero."""
        packing = self.packing
        if packing.spread is None:
            return np.zeros(self.shape)
        given = self.diameters if self.diameters is not None else packing.spread.sample(self.shape, self.seed + index)
        # twice: the mean of what is left is then zero to its own rounding
        off = given - np.mean(given)
        return np.asarray((off - np.mean(off)) / packing.width_units.width)


def _pair(shape: Any) -> tuple[Any, Any]:
    try:
        first, second = shape
    except (TypeError, ValueError):
        raise InputError(message(f"shape is {brief(shape)}", mend="Give two whole numbers, (L1, L2)")) from None
    return first, second
