"""How the diameters of the balls differ: distributions in metres, and samples.

Section III.A of Velicky and Caroli, Phys. Rev. E 65, 021307 (2002). Deviations Delta are from the mean diameter; the width
is W = sqrt(12) Delta_rms, the full width of the uniform distribution (below (19) the root is on the wrong side).
"""

from __future__ import annotations

import math
from abc import ABC, abstractmethod
from collections.abc import Sequence
from dataclasses import dataclass, field
from functools import cached_property
from pathlib import Path
from typing import Any, Self

import numpy as np
from numpy.typing import NDArray

from granphon.balls.distributions import (
    GRAIN,
    NormalShape,
    PointShape,
    Shape,
    UniformShape,
    condense,
    cut_rms,
    find_quantiles,
    merge,
)
from granphon.base.arrays import Array
from granphon.base.errors import InputError, brief
from granphon.base.quantities import LENGTH
from granphon.base.tables import Table
from granphon.base.validation import finite_list, not_negative, positive, whole_number

#: smallest fraction of a kind of balls: with a rarer kind, W is so small against the kind's deviation that the laws lose
#: their digits
_RAREST = 1e-12
#: largest number of balls in one sample, far beyond what a machine holds
_MOST_NUMBERS = 2**48
#: tolerance for rounding, relative: of the mean against the packing's diameter, and of the sum of fractions against 1
_ROUNDED = 1e-9


def uniform_numbers(shape: int | Sequence[int], seed: int) -> Array:
    """Uniform random numbers in (0, 1) for the sites of an array: SplitMix64 of the seed, then of each index in turn.

    Integer arithmetic makes them the same on every machine. A site keeps its number when the array grows along any axis, so
    that a longer sample begins with a shorter one. Raises :class:`InputError` for lengths that are not whole numbers >= 0,
    for more than 2^48 sites, or for a seed that is not a whole number from 0 to 2^64 - 1.
    """
    given: Any = shape
    given = given.tolist() if isinstance(given, np.ndarray) else given
    lengths = tuple(given) if isinstance(given, Sequence) and not isinstance(given, bytes) else (given,)
    lengths = tuple(whole_number("shape", length, 0) for length in lengths)
    if not lengths or math.prod(lengths) > _MOST_NUMBERS:
        raise InputError(f"shape is {brief(shape)}", mend="Give one or more lengths, whose product is 2^48 balls or fewer")
    seed = whole_number("seed", seed, 0, 2**64 - 1)
    state: NDArray[np.uint64] = np.array(int(seed), np.uint64)
    for length in lengths:
        index: NDArray[np.uint64] = np.arange(1, int(length) + 1, dtype=np.uint64)
        state = state[..., np.newaxis] + index * np.uint64(0x9E3779B97F4A7C15)
        state = (state ^ (state >> np.uint64(30))) * np.uint64(0xBF58476D1CE4E5B9)
        state = (state ^ (state >> np.uint64(27))) * np.uint64(0x94D049BB133111EB)
        state = state ^ (state >> np.uint64(31))
    return ((state >> np.uint64(12)).astype(float) + 0.5) * 2.0**-52


@dataclass(frozen=True)
class Spread(ABC):
    """A distribution of ball diameters: :class:`Uniform`, :class:`Normal`, :class:`Discrete` or :class:`Measured`."""

    @property
    @abstractmethod
    def rms(self) -> float:
        """Root mean square deviation Delta_rms, m (equation 19)."""

    @property
    @abstractmethod
    def shape(self) -> Shape:
        """The distribution of x = Delta/W."""

    @cached_property
    def width(self) -> float:
        """Width W = sqrt(12) Delta_rms, m; 0 for equal balls."""
        return math.sqrt(12.0) * self.rms

    @property
    def mean(self) -> float | None:
        """Mean diameter, m; None for a distribution of deviations only."""
        return None

    @property
    def smallest(self) -> float:
        """Smallest deviation, m."""
        return self.width * self.shape.bounds[0]

    @property
    def largest(self) -> float:
        """Largest deviation, m."""
        return self.width * self.shape.bounds[1]

    def check_diameter(self, diameter: float) -> None:
        """Raise :class:`InputError` if the mean diameter of the balls cannot be ``diameter`` (m).

        That is so if the distribution has a mean that differs from it by more than 1e-9 of it, or if the smallest ball would
        have a size at or below zero. A smaller difference has no effect, as deviations are taken from the distribution's own
        mean.
        """
        least = positive("diameter", diameter, "m") + self.smallest
        if self.mean is not None and abs(self.mean - diameter) > _ROUNDED * diameter:
            what = f"the mean of the diameters is {self.mean:.12g} m, the packing's diameter is {diameter:.12g} m"
            mend = f"Give the mean, {self.mean!r} m, as the diameter"
            raise InputError(what, "Deviations of diameters are counted from their mean", mend)
        if not least > 0.0:
            why = f"The smallest deviation from the mean is {self.smallest:g} m"
            raise InputError(f"the smallest ball has a diameter of {least:g} m", why, "Give a smaller spread")

    def sample(self, shape: int | Sequence[int], seed: int) -> Array:
        """Deviations Delta of an array of balls of this shape, m: the quantiles of :func:`uniform_numbers`.

        A larger sample keeps the balls of a smaller one. The mean of a sample is near zero, and is not shifted to zero here.
        """
        return self._compute_deviations(uniform_numbers(shape, seed))

    def _compute_deviations(self, probability: Array) -> Array:
        return self.width * np.asarray(self.shape.quantile(probability), float)


@dataclass(frozen=True)
class Uniform(Spread):
    """Deviations spread evenly over a width.

    Parameters
    ----------
    width : the full width W, m; zero for equal balls.

    Raises
    ------
    InputError : the width is negative or not finite.
    """

    width: float = field()

    def __post_init__(self) -> None:
        object.__setattr__(self, "width", not_negative("width", self.width, "m"))

    @property
    def rms(self) -> float:
        """Root mean square deviation W / sqrt(12), m."""
        return self.width / math.sqrt(12.0)

    @property
    def shape(self) -> UniformShape:
        """The distribution of x = Delta/W, the same for every width."""
        return UniformShape()


@dataclass(frozen=True)
class Normal(Spread):
    """Normal deviations without those larger than ``cutoff`` times ``std``.

    Parameters
    ----------
    std : standard deviation before the cut, m; ``rms`` is that after it.
    cutoff : largest deviation over ``std``.

    Raises
    ------
    InputError : a ``std`` that is negative or not finite, or a cutoff outside 0.001 ... 10 (below, the density is even to
        1e-6; above, nothing is cut).
    """

    std: float
    cutoff: float = 3.0

    def __post_init__(self) -> None:
        object.__setattr__(self, "std", not_negative("std", self.std, "m"))
        object.__setattr__(self, "cutoff", positive("cutoff", self.cutoff))
        if not 1e-3 <= self.cutoff <= 10.0:
            raise InputError(f"cutoff is {self.cutoff:g}", mend="Give 0.001 to 10 standard deviations, such as 3")

    @property
    def rms(self) -> float:
        """Root mean square deviation Delta_rms of the cut distribution, m."""
        return self.std * cut_rms(self.cutoff)

    @property
    def shape(self) -> NormalShape:
        """The distribution of x = Delta/W, which depends on the cutoff alone."""
        return NormalShape(self.cutoff)


class _Listed(Spread):
    """Diameters given one by one."""

    diameters: tuple[float, ...]

    def _compute_shares(self) -> Array:
        return np.full(len(self.diameters), 1.0 / len(self.diameters))

    @cached_property
    def _table(self) -> tuple[float, Array, Array]:
        """Mean diameter, m; deviations of the different diameters, m, ascending; their probabilities."""
        places, weights = merge(np.array(self.diameters), self._compute_shares())
        off = places - places[0]  # exact if diameters differ by less than a factor of 2, so that equal balls have width 0
        mean = math.fsum(weights * off)
        return float(places[0]) + mean, off - mean, weights

    def _compute_deviations(self, probability: Array) -> Array:
        return self._table[1][find_quantiles(self._table[2], probability)]

    @property
    def mean(self) -> float:
        """Mean diameter, m."""
        return self._table[0]

    @cached_property
    def rms(self) -> float:
        """Root mean square deviation Delta_rms, m."""
        scale = float(np.max(np.abs(self._table[1]))) or 1.0
        return scale * math.sqrt(math.fsum(self._table[2] * (self._table[1] / scale) ** 2))

    @cached_property
    def shape(self) -> PointShape:
        """The distribution of x = Delta/W: each different diameter, rounded to 2^-40 W, condensed to at most 192 points."""
        x = np.round(self._table[1] / (self.width or 1.0) / GRAIN) * GRAIN
        positions, weights = condense(*merge(x, self._table[2]))
        return PointShape(tuple(positions.tolist()), tuple(weights.tolist()))


@dataclass(frozen=True)
class Discrete(_Listed):
    """Kinds of balls, each with its diameter and its fraction of all balls (equation 18).

    Parameters
    ----------
    diameters : (n,) diameters d^Q of the kinds, m.
    fractions : (n,) fractions c^Q of the kinds, 0 to 1, which sum to 1 within 1e-9.

    Raises
    ------
    InputError : a diameter that is not finite and above zero, a fraction that is negative or between zero and 1e-12,
        fractions with another sum, or unequal numbers of diameters and fractions.
    """

    diameters: tuple[float, ...]
    fractions: tuple[float, ...]

    def __post_init__(self) -> None:
        object.__setattr__(self, "diameters", finite_list("diameters", self.diameters, "m", "above zero"))
        object.__setattr__(self, "fractions", finite_list("fractions", self.fractions, low="zero or above"))
        if len(self.fractions) != len(self.diameters):
            what = f"there are {len(self.diameters)} diameters and {len(self.fractions)} fractions"
            raise InputError(what, mend="Give one fraction for each diameter")
        rarest = min((part for part in self.fractions if part), default=1.0)
        if rarest < _RAREST:
            mend = "Leave it out, or give the fraction 0"
            raise InputError(f"a fraction is {rarest:g}", f"A kind rarer than {_RAREST:g} is not resolved", mend)
        over = math.fsum(self.fractions) - 1.0
        if abs(over) > _ROUNDED:
            what = f"the fractions sum to {1.0 + over:.12g}, {abs(over):.3g} {'above' if over > 0.0 else 'below'} 1"
            raise InputError(what, "They are parts of a whole", "Divide them by their sum")

    def _compute_shares(self) -> Array:
        return np.array(self.fractions) / math.fsum(self.fractions)


@dataclass(frozen=True)
class Measured(_Listed):
    """The measured diameters of a lot of balls, all equally likely.

    Parameters
    ----------
    diameters : (n,) diameters, m; their order does not matter.

    Raises
    ------
    InputError : there are none, or one is not finite and above zero.
    """

    diameters: tuple[float, ...]

    def __post_init__(self) -> None:
        object.__setattr__(self, "diameters", finite_list("diameters", self.diameters, "m", "above zero"))

    @classmethod
    def from_csv(cls, path: str | Path, column: str | None = None, quoted: bool = True) -> Self:
        """Read diameters from a column of a table, headed as in ``ball,diameter (mm)``.

        ``column`` is the name of the column, whose unit the first line must give; by default it is "diameter", or the only
        column of the table. ``quoted`` says whether errors may quote the table, as in
        :meth:`~granphon.base.tables.Table.read`. :class:`InputError` names the line that cannot be read.
        """
        table, name = Table.read(path, quoted), column or "diameter"
        if column is None and len(table.headings) == 1 and (quoted or LENGTH.measures(table.headings[0].unit)):
            name = table.headings[0].name
        return cls(tuple(table.column(name, LENGTH).tolist()))


def given_spread(spread: Any) -> Spread:
    """Return ``spread``, the argument of a public call; raises :class:`InputError` if it is not a :class:`Spread`."""
    if not isinstance(spread, Spread):
        raise InputError(f"spread is {spread!r}", mend="Give a granphon.Uniform, Normal, Discrete or Measured")
    return spread
