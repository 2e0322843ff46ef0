"""Balls of different diameters under some loads, by which media are judged, and what they observe."""

from __future__ import annotations

from contextlib import suppress
from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING, Any, cast

import numpy as np
from numpy.typing import NDArray

from granphon.balls.distributions import PointShape
from granphon.balls.loads import Load
from granphon.balls.packing import Packing
from granphon.base.errors import GranphonError
from granphon.laws.effective import solve_curve
from granphon.media.friction_history import REST, FrictionHistory
from granphon.media.mean_field import AveragedForce, EffectiveMedium
from granphon.media.simulation import DirectSimulation
from granphon.media.state import ContactState
from granphon.observables.velocities import local_exponent
from granphon.tradeoffs.ensemble import QUANTITIES, observe
from granphon.tradeoffs.study import SECONDS, Stopwatch

if TYPE_CHECKING:
    from granphon.balls.diameters import Spread


Array = NDArray[np.float64]
#: number of openings of listed diameters above which solving the effective medium takes noticeable time
MOST_OPENINGS = 40
#: diameters in the short list whose solution is timed to predict that of a long one
_TRIAL_DIAMETERS = 20
#: the time of a solution is proportional to this power of the number of openings
_TIME_POWER = 1.1


@dataclass(frozen=True)
class Disorder:
    """Balls of different diameters, their loads, and which of :data:`~granphon.tradeoffs.ensemble.QUANTITIES` are observed.

    ``truth`` says which simulated arrays media are judged by. Trial solutions are timed with ``stopwatch``.
    """

    packing: Packing
    load: Load
    quantities: tuple[str, ...]
    stopwatch: Stopwatch = SECONDS
    truth: FrictionHistory = REST

    @property
    def columns(self) -> list[int]:
        """Indices of the observed quantities."""
        return [QUANTITIES.index(name) for name in self.quantities]

    @property
    def shape(self) -> Any:
        """Shape of the distribution of diameters, which is not that of equal balls."""
        return cast("Spread", self.packing.spread).shape

    def state(self, medium: Any) -> ContactState:
        """State of a medium at the loads."""
        state: ContactState = medium.at(self.load)
        return state

    @cached_property
    def exact(self) -> list[int]:
        """Indices of the loads at which the arrays of the truth have their exact geometry."""
        simulation = DirectSimulation(self.packing, **self.truth.options)
        return [place for one, places in simulation.by_geometry(self.load) if one.is_exact for place in places]

    def observe(self, medium: Any) -> Array:
        """Return the observed quantities of a medium, (n_loads, n_observed), with finite overlap where the truth has it."""
        out = np.empty((self.load.size, len(QUANTITIES)))
        others = [place for place in range(self.load.size) if place not in self.exact]
        for places, finite in ((self.exact, True), (others, None)):
            if places:
                out[places] = observe(medium.at(self.load[places], finite_overlap=finite))
        return out[:, self.columns]

    @cached_property
    def solving(self) -> float:
        """Predicted time of solving the effective medium, s; zero up to ``MOST_OPENINGS`` openings."""
        shape = self.shape
        if shape.openings.size <= MOST_OPENINGS:
            return 0.0
        x = np.array(shape.positions)[np.unique(np.linspace(0, len(shape.positions) - 1, _TRIAL_DIAMETERS).astype(int))]
        few = PointShape(tuple(x.tolist()), (1.0 / x.size,) * x.size)
        begun = self.stopwatch.now()
        solve_curve(few, 1.0, 12, 1e-10)
        return float((self.stopwatch.now() - begun) * (shape.openings.size / few.openings.size) ** _TIME_POWER)

    @cached_property
    def condition(self) -> float:
        """Condition number of the velocities: the largest factor by which relative errors of load and width act on them."""
        state = self.state(AveragedForce(self.packing))
        if not self.solving:
            with suppress(GranphonError):  # the loads may be below those of the effective medium
                state = self.state(EffectiveMedium(self.packing))
        by_force = np.asarray(local_exponent(state))
        overlap = np.asarray(state.overlap)
        # v = f^(1/6) times a function of f/W^(3/2), or W^(1/4) times one of delta/W
        by_load = by_force if self.load.kind != "overlap" else by_force * overlap * state.normal_stiffness / state.force
        by_width = 1.5 * (by_force - 1.0 / 6.0) if self.load.kind != "overlap" else 0.25 - by_load
        return float(1.0 + np.max(np.abs(by_load) + np.abs(by_width)))
