"""Parts of a study of speed against accuracy: its points, its reference, and the stopwatch that times them.

A study asks one question. Each of its points is a method with a knob, such as a grid with so many points; the reference is
what another algorithm finds, and the error of a point is its distance from the reference.
"""

from __future__ import annotations

import time
from abc import ABC, abstractmethod
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any, ClassVar, NamedTuple

import numpy as np
from numpy.typing import NDArray

from granphon.base.errors import GranphonError
from granphon.base.progress import Step
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


class Study(ABC):
    """One question of speed against accuracy; errors are relative, of shape (n_loads, n_observed)."""

    name: ClassVar[str]

    @property
    @abstractmethod
    def observed(self) -> tuple[str, ...]:
        """Names of the quantities whose errors are measured."""

    @property
    @abstractmethod
    def loads(self) -> tuple[float, ...]:
        """Loads at which errors are measured, SI."""

    @abstractmethod
    def make_points(self) -> list[Point]:
        """Return the points: for each method, the cheapest setting of its knob first."""

    @abstractmethod
    def find_reference(self, deadline: Deadline, better: Callable[[Reference], bool], step: Step) -> Reference:
        """Find the reference before the deadline, and stop improving it once ``better`` accepts it.

        Raises :class:`~granphon.base.errors.GranphonError` if it cannot be found.
        """

    @abstractmethod
    def compute_errors(self, outcomes: Sequence[Any], reference: Reference) -> Array:
        """Return the errors of a point from the outcomes of its runs: their rms if the runs are random."""

    @abstractmethod
    def find_floor(self, point: Point, outcomes: Sequence[Any]) -> float:
        """Return the least error that the point can have: condition number times rounding, or the scatter of random runs."""
