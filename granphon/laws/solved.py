"""Contact laws that are solved as a curve below the start of the high-pressure series, down to a least force."""

from __future__ import annotations

from abc import abstractmethod
from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray

from granphon.base.errors import PrecisionError, message
from granphon.laws.spread import SpreadLaw

Array = NDArray[np.float64]


class _Curve(Protocol):
    """A reduced law f*(y) from the overlap ``start``, of the force ``least_force``, on."""

    @property
    def start(self) -> float: ...

    @property
    def least_force(self) -> float: ...

    def value(self, y: Array, order: int) -> Any: ...

    def overlap(self, force: Array) -> Any: ...


class CurveLaw(SpreadLaw):
    """A law of balls that differ whose reduced law is a curve; below its least force it is a :class:`PrecisionError`."""

    @property
    @abstractmethod
    def curve(self) -> _Curve:
        """Reduced law, in units of W and c W^(3/2)."""

    @property
    @abstractmethod
    def _below(self) -> tuple[str, str]:
        """Reason why there is no solution below the curve, and advice to the user."""

    def _evaluate_near(self, y: Array, order: int) -> Array:
        closed, curve = y > -self.shape.bounds[1], self.curve
        if np.any(closed & (y < curve.start)):
            what = f"an overlap of {float(np.min(y[closed])):.6g} widths is below that of f* = {curve.least_force:.6g}"
            raise PrecisionError(message(what, *self._below))
        out = np.zeros(y.shape)
        out[closed] = curve.value(y[closed], order)
        return out

    def _find_near_overlap(self, force: Array) -> Array:
        curve = self.curve
        if np.any(force < curve.least_force):
            what = f"a mean contact force of f* = {float(np.min(force)):.3g} is below {curve.least_force:.6g}"
            raise PrecisionError(message(what, *self._below))
        return np.asarray(curve.overlap(force))
