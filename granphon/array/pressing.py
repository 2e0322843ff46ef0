"""Between the states of a loading path: where the next one is looked for, and what lies half-way to it.

States that follow each other in one direction of the load lie on a smooth curve, but for contacts that open, close, stick or
slide. Polynomials in the load through the last states continue it, and fill it in.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

__all__ = ["continue_polynomial", "goes_on", "weigh_states"]

Array = NDArray[np.float64]
#: largest step of the load, over the one before, across which a polynomial is continued
_FARTHEST = 4.0


def continue_polynomial(loads: Sequence[float], load: float) -> list[float]:
    """Return weights of the states at the last ``loads``, at most three of them, for the state at the next ``load``.

    There is one for each of the last states that are used. After a turn of the path only the last state is.
    """
    steps = np.diff([*loads[-3:], load])
    count = 1
    for step in steps[-2::-1]:
        if step * steps[-1] <= 0.0 or abs(steps[-1]) > _FARTHEST * abs(step):
            break
        count += 1
    return weigh_states(loads[-count:], load)


def goes_on(loads: Sequence[float]) -> bool:
    """Return whether the last of three ``loads`` continues the way of the first two, by a step of similar length."""
    steps = np.diff(loads)
    return len(loads) == 3 and bool(steps[0] * steps[1] > 0.0 and 1.0 / _FARTHEST <= steps[1] / steps[0] <= _FARTHEST)


def weigh_states(loads: Sequence[float], load: float) -> list[float]:
    """Return the weights of the states at ``loads`` in Lagrange's polynomial, at another load."""
    weights = []
    for one in loads:
        others = [other for other in loads if other != one]
        weights.append(float(np.prod([(load - other) / (one - other) for other in others])))
    return weights
