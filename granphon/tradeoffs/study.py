"""Parts of a study of speed against accuracy: its points, its reference, and the stopwatch that times them.

A study asks one question. Each of its points is a method with a knob, such as a grid with so many points; the reference is
what another algorithm finds, and the error of a point is its distance from the reference.
"""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from granphon.base.errors import GranphonError
from granphon.media.cost import Cost

Array = NDArray[np.float64]
#: relative distance between neighbouring double-precision numbers at 1
EPSILON = float(np.finfo(float).eps)


class Stopwatch:
    """Measures time and predicts what work will take, both in seconds.

    Everything in a trade-off that depends on time asks one of these. A subclass that counts work instead of seconds makes
    budgets, and therefore results, independent of how busy the machine is.
    """

    def now(self) -> float:
        """Time since some fixed moment, s."""
        return time.perf_counter()

    def predict(self, cost: Cost) -> float:
        """Return how long work of this estimated cost takes, s."""
        return cost.seconds


#: the stopwatch used unless another is given
SECONDS = Stopwatch()


@dataclass(frozen=True)
class Deadline:
    """The moment ``until`` (s, as ``stopwatch`` tells it) at which some work must be over."""

    stopwatch: Stopwatch
    until: float

    @property
    def left(self) -> float:
        """Time left, s; negative once the deadline has passed."""
        return self.until - self.stopwatch.now()

    def check(self) -> None:
        """Raise :class:`~granphon.base.errors.GranphonError` if no time is left."""
        if self.left < 0.0:
            raise GranphonError("it does not fit into the budget.")


@dataclass(frozen=True)
class Point:
    """A method with one setting of its knob.

    Attributes
    ----------
    method, knob : the method, and the setting, in words.
    prepare : takes the number of a run and returns what ``solve`` needs; not part of the time of a run.
    solve : finds what is compared with the reference.
    seconds : predicted time of a run, s; zero if nothing is known of it.
    random : whether every run draws other random numbers.
    """

    method: str
    knob: str
    prepare: Callable[[int], Any]
    solve: Callable[[Any], Any]
    seconds: float = 0.0
    random: bool = False


class Reference(NamedTuple):
    """A reference: its ``values``, their relative ``errors``, and a description of how they were ``made``."""

    values: Any
    errors: Array
    made: str
