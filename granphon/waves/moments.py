"""Chebyshev moments of the spectrum of a network, seen from given vectors, and the results that refine by more of them."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable, Iterator
from typing import Generic, Self, TypeVar

import numpy as np
from numpy.typing import NDArray

from granphon.base.errors import InputError, InstabilityError, message
from granphon.waves.chebyshev import polynomials
from granphon.waves.eigenproblem import UNSTABLE
from granphon.waves.operator import WaveOperator

#: what a result is refined with
Work = TypeVar("Work")
Array = NDArray[np.float64]
#: bytes of vectors that a result keeps, so that more moments go on from them; what would take more begins again
_KEPT = 2**28
#: share by which a moment may exceed that of order zero: rounding
_ROUNDING = 1e-6


def keeps_vectors(operator: WaveOperator, starts: int) -> bool:
    """Return whether the last two vectors of ``starts`` recursions are few enough to be kept."""
    return 2 * 8 * operator.size * starts <= _KEPT


class Moments:
    """The moments mu_n = <x| T_n(2 D / top^2 - 1) |x> of one vector x, found as far as they were asked for.

    Two of them cost one product: mu_2n = 2 <x_n|x_n> - mu_0 and mu_2n+1 = 2 <x_n+1|x_n> - mu_1 with x_n = T_n x.

    Parameters
    ----------
    operator : D.
    start : makes the vector, (size,).
    keep : whether to keep the last vectors. Without them more moments begin again, and are the same to the last bit.
    """

    def __init__(self, operator: WaveOperator, start: Callable[[], Array], *, keep: bool) -> None:
        self._operator, self._start, self._keep = operator, start, keep
        self._found: list[float] = []
        self._vectors: Iterator[Array] | None = None
        self._last: Array | None = None

    def first(self, count: int) -> Array:
        """Return the first ``count`` moments, (count,).

        Raises :class:`~granphon.base.errors.InstabilityError` if they grow: a squared frequency is below zero.
        """
        if len(self._found) < count:
            self._extend(count)
            if not self._keep:
                self._vectors = self._last = None
        return np.array(self._found[:count])

    def _extend(self, count: int) -> None:
        found = self._found
        if self._vectors is None:
            found.clear()
            self._vectors = polynomials(self._operator, self._start())
            x = next(self._vectors)
            found.append(float(np.vdot(x, x)))
            self._last = x
        vectors, last = self._vectors, self._last
        assert last is not None
        while len(found) < count:
            # the last vector is overwritten only after the one that comes now
            x = next(vectors)
            if len(found) == 1:
                found.append(float(np.vdot(x, last)))
            else:
                found.append(2.0 * float(np.vdot(x, last)) - found[1])
            found.append(2.0 * float(np.vdot(x, x)) - found[0])
            self._require_bounded(found[-1])
            last = self._last = x

    def _require_bounded(self, moment: float) -> None:
        if not abs(moment) <= (1.0 + _ROUNDING) * self._found[0]:
            raise InstabilityError(UNSTABLE)


class Refinable(ABC, Generic[Work]):
    """A frozen result that finds one with more moments. Plain data and pickles do not keep what it needs for that."""

    _work: Work | None = None

    @abstractmethod
    def _refine(self, resolution: float | None, moments: int | None) -> Self:
        """Return the result of a resolution, Hz, or of a number of moments."""

    def _with_work(self, work: Work) -> Self:
        object.__setattr__(self, "_work", work)
        return self

    def _known_work(self) -> Work:
        if self._work is None:
            name = type(self).__name__
            mend = "Ask gp.Waves(network) for it again"
            raise InputError(message(f"this {name} was read from data, which do not have the network", mend=mend))
        return self._work

    def with_moments(self, moments: int) -> Self:
        """Return the result of this number of moments; what has been found is not found again.

        It is the same, bit for bit, as one that is found with that number at once. Raises
        :class:`~granphon.base.errors.InputError` if this result was read from data.
        """
        return self._refine(None, moments)

    def with_resolution(self, resolution: float) -> Self:
        """Return the result of this resolution, Hz: as :meth:`with_moments`."""
        return self._refine(resolution, None)
