"""The beginning of a loading history from the gas: balls apart on their sites, pressed with friction until they stand.

Where too few balls touch, nothing holds them, and no equilibrium is unique. A real array then comes to rest by what damps
it, and so does this one: in each step of the load, dashpots between neighbours resist what these move against each other
since the step before, with :data:`DRAG` times the displacement over the step (in units of c W^(1/2)); slips meet eta times
as much. Balls that nothing pushes stay where they are. The overlap grows by :data:`STEP` at a time from the first contact
on. When the mean force has come to :data:`STANDING_FORCE`, the dashpots are weakened to nothing at the same overlap. If the
array then bears at least half of this force, in balance, it stands, and its history begins there; otherwise it is pressed
on.

The drag, the step and this force are conventions. What f* at higher loads owes to them is a matter of percents in small
arrays; the tests state it.
"""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

from granphon.array.steps import Prescribed
from granphon.base.errors import ConvergenceError, message

if TYPE_CHECKING:
    from granphon.array.history import LoadingHistory, PressedArray

__all__ = ["DRAG", "GAS", "STANDING_FORCE", "STEP", "press_gas"]

#: name of this start
GAS = "gas"
#: stiffness of dashpots within a step
DRAG = 1e-2
#: change of the overlap in a step
STEP = 0.0125
#: mean force at which an array that has been a gas has to stand
STANDING_FORCE = 5e-3
#: factors by which dashpots are weakened one after the other
_WEAKER = (0.1, 0.01, 0.0)
#: largest overlap at which an array of different balls is still a gas
_MOST_OVERLAP = 2.0


def press_gas(history: LoadingHistory) -> PressedArray:
    """Return the first state at which an array stands with friction, from balls that lie apart.

    Raises :class:`~granphon.base.errors.ConvergenceError` if it stands at no overlap below two widths.
    """
    means = history.stencils.average_pairs(history.deviations)
    sites = np.zeros((history.stencils.n_balls * len(history.stencils.shape), *history.stencils.shape))
    here = history.place(sites, -float(np.max(means)))
    damped = [replace(history, start=None, drag=DRAG * factor) for factor in (1.0, *_WEAKER)]
    while here.overlap < _MOST_OVERLAP:
        load = Prescribed(overlap=here.overlap + STEP)
        here = damped[0].step([here], load)
        if here.force < STANDING_FORCE:
            continue
        loose = here
        for weaker in damped[1:]:
            try:
                loose = weaker.step([loose], load)
            except ConvergenceError:
                break
        else:
            if loose.force >= 0.5 * STANDING_FORCE:
                return loose
    raise ConvergenceError(
        message(
            f"the balls still do not stand at an overlap of {here.overlap:.3g} widths",
            "Friction does not hold what the lattice leaves loose",
            "Raise the friction coefficient",
        )
    )
