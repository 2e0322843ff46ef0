"""The way down the energy to rest, step by step: one flow for all balls.

Newton's method finds each step, and the slope of the energy along it, that is forces, its length;
differences of energies would be rounding near rest. What a place is, and how its linear equations
are solved, depends on the balls: a list whose contacts keep the directions of the lattice
(:mod:`granphon.statics.list_descent`), a grid of such contacts, none of which is spelled out
(:mod:`granphon.statics.grid_descent`), and contacts that turn, among which there are loose balls
and saddles (:mod:`granphon.statics.turning_descent`).
"""

from __future__ import annotations

import math
from abc import ABC, abstractmethod
from typing import Generic, Protocol, TypeVar

from granphon.base.errors import GranphonError
from granphon.statics.line_search import Way, follow
from granphon.statics.options import RestOptions
from granphon.statics.rest import Rest


class Place(Protocol):
    """Where balls are on the way to rest."""

    @property
    def residual(self) -> float:
        """The largest force left, over the size of forces to which tolerances refer."""


P = TypeVar("P", bound=Place)


class Trail(Generic[P]):
    """What is remembered of the places on the way.

    ``keeps_nearest`` says whether the place with the least residual is kept; otherwise the last
    place is.

    Attributes
    ----------
    least_residual : least residual of all places; infinite at first.
    n_stalled : number of places since one has come nearer to rest than all before it, by
        :attr:`nearer_residual`.
    kept_place : the place that is kept; None at first.
    """

    def __init__(self, keeps_nearest: bool = True) -> None:
        self._keeps_nearest = keeps_nearest
        self.least_residual = math.inf
        self.n_stalled = 0
        self.kept_place: P | None = None

    @property
    def residual(self) -> float:
        """The residual of the place that is kept; infinite if there is none."""
        return math.inf if self.kept_place is None else self.kept_place.residual

    @property
    def nearer_residual(self) -> float:
        """Residual up to which a further place counts as nearer to rest: half of the least one."""
        # near rest a step of Newton's method leaves far less than half; where more is left, each
        # digit would take over three steps
        return 0.5 * self.least_residual

    @property
    def is_level(self) -> bool:
        """Whether the last three places or more have come no nearer to rest: what is left then is
        rounding if the residual is small.
        """
        # one step, or two, may gain nothing because a contact opens and closes again
        return self.n_stalled >= 3

    def add(self, place: P) -> None:
        """Enter the next ``place`` of the way."""
        residual = place.residual
        is_nearer = residual <= self.nearer_residual
        self.n_stalled = 0 if is_nearer else self.n_stalled + 1
        if residual < self.least_residual or not self._keeps_nearest:
            self.kept_place = place
        self.least_residual = min(self.least_residual, residual)


class Descent(ABC, Generic[P]):
    """The way of balls down their energy to rest.

    Attributes
    ----------
    options : numbers of the search.
    tolerance : residual at which balls are at rest.
    required : residual with which a way that comes no nearer may end.
    trail : what the way has passed.
    steps, iterations : numbers of steps of Newton's method, and of iterations in these steps.
    """

    def __init__(self, options: RestOptions, tolerance: float, required: float) -> None:
        self.options = options
        self.tolerance = tolerance
        self.required = required
        self.trail: Trail[P] = Trail()
        self.steps = 0
        self.iterations = 0

    @property
    def needs_more_load(self) -> bool:
        """Whether the way is to begin at rest under a larger load."""
        return False

    @abstractmethod
    def begin(self, start: Rest | None) -> P:
        """Return the place at which the way begins: that of ``start``, if there is one."""

    def run(self, start: Rest | None) -> Rest:
        """Return the state at rest to which the way leads from where it begins (:meth:`begin`, with
        the ``start``); raise the error of :meth:`_explain_failure` if the way does not lead to
        rest, or the error of a step that finds the reason before.

        Steps and iterations are counted, and places added to the trail. From rest at a saddle of
        the energy the way goes on downhill, with a new trail. After ``options.steps`` rounds, each
        a step or a way down from a saddle, or where the way is stuck, the place that the trail
        keeps counts as at rest if it has the required residual, and is not asked whether it is a
        saddle.
        """
        place = self.begin(start)
        for _ in range(self.options.steps):
            place = self._prepare(place)
            if self._is_stuck(place):
                break
            self.trail.add(place)
            if self._has_arrived:
                below = self._leave_saddle(self._kept_place)
                if below is None:
                    return self._finish(self._kept_place)
                place = below
                self.trail = Trail()
                continue
            place = self._advance(place)
            self.steps += 1
        if self.trail.residual <= self.required:
            return self._finish(self._kept_place)
        raise self._explain_failure(place)

    @property
    def _kept_place(self) -> P:
        """The place that the trail keeps: the nearest to rest, or the last one, as the trail is
        made.
        """
        assert self.trail.kept_place is not None
        return self.trail.kept_place

    @property
    def _has_arrived(self) -> bool:
        """Whether the balls are at rest, or, where steps leave nothing but rounding
        (:attr:`Trail.is_level`), near enough to it (``required``).
        """
        trail = self.trail
        is_near_enough = trail.residual <= self.required and trail.is_level
        return trail.residual <= self.tolerance or is_near_enough

    def _is_stuck(self, place: P) -> bool:
        """Return whether the way ends here without rest."""
        return False

    def _prepare(self, place: P) -> P:
        """Return the place from which the next step begins. A way that prepares its places
        otherwise says what else this changes, or raises.
        """
        return place

    @abstractmethod
    def _advance(self, place: P) -> P:
        """Return the place after a step."""

    def _follow(self, way: Way[P], part: float | None = None) -> tuple[P, float]:
        """Return the place along the ``way`` of a step at which the energy hardly falls any more,
        and the length of the step, 1 for a whole step. There the slope is at most a ``part`` of
        that at the start, by default ``options.slope``, unless ``options.slopes`` lengths find no
        such place or the energy still falls at the greatest length of the way.
        """
        options = self.options
        return follow(way, options.slope if part is None else part, options.slopes)

    def _leave_saddle(self, place: P) -> P | None:
        """Return a place of less energy than ``place``, which is at rest, if ``place`` is a saddle
        of the energy; None if it is a minimum.

        Here the result is None: the energy of contacts that keep their directions has no saddles.
        """
        return None

    @abstractmethod
    def _finish(self, place: P) -> Rest:
        """Return the state of a place that is at rest."""

    @abstractmethod
    def _explain_failure(self, place: P) -> GranphonError:
        """Return the error of a way that ends without rest at a ``place``."""
