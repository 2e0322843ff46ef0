"""States of a loading path, and what lies between them: where the next one is looked for, and the middle of a step.

States that follow each other in one direction of the load lie on a smooth curve, but for contacts that open, close, stick or
slide. Polynomials in the load through the last states continue it, and fill it in.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from granphon.array.friction import Contacts, FrictionLaw, Tangent
from granphon.array.geometry import Place

Array = NDArray[np.float64]
#: largest force, or torque over the diameter, left on a ball, over the mean normal force
BALANCE_TOLERANCE = 1e-9
#: largest step of the load, over the one before, across which a polynomial is continued
_FARTHEST = 4.0


@dataclass(frozen=True, eq=False)
class PressedArray:
    """Array of balls at rest, with the forces that its history has left; in units of W and c W^(3/2).

    Attributes
    ----------
    overlap : y, common to all contacts.
    balls : (fields, L1, ..., Lp) displacements and rotations, in the coordinates of the stencils.
    contacts : state of the contacts.
    law : of the contacts.
    residual : largest force or torque (over the diameter) left on a ball, over the mean normal force.
    work : of the load since the start, a mean over contacts, in units of c W^(5/2).
    slid, loosened, damped : energies lost since the start by sliding, by the law of the tangential force, and to dashpots,
        between the gas and rest and where balls fall; as ``work``.
    steps, newton, krylov : numbers of steps of the load, of Newton's method and of GMRES since the start.
    """

    overlap: float
    balls: Array
    contacts: Contacts
    law: FrictionLaw
    residual: float = 0.0
    work: float = 0.0
    slid: float = 0.0
    loosened: float = 0.0
    damped: float = 0.0
    steps: int = 0
    newton: int = 0
    krylov: int = 0

    @cached_property
    def force(self) -> float:
        """Mean normal force f*, over all contacts, open ones included."""
        return float(np.mean(self.contacts.forces))

    @cached_property
    def stored(self) -> float:
        """Mean energy that a contact stores, in units of c W^(5/2)."""
        return self.law.stored(self.contacts)

    @property
    def dissipated(self) -> float:
        """Energy lost since the start, a mean over contacts, in units of c W^(5/2)."""
        return self.slid + self.loosened + self.damped

    def measure_motion(self, before: PressedArray) -> float:
        """Return the largest change of an overlap or a slip since another state, in W."""
        now, then = self.contacts, before.contacts
        return max(float(np.max(np.abs(a - b))) for a, b in ((now.overlaps, then.overlaps), (now.slips, then.slips)))

    @property
    def sliding_fraction(self) -> float:
        """Part of the contacts that carry load whose tangential force is at Coulomb's limit."""
        return self.law.sliding_fraction(self.contacts)


@dataclass(frozen=True, eq=False)
class Trial:
    """Motion tried in a step, and what it leaves: the ``pull`` on balls, ``push`` of the load, and their norms.

    ``linearise`` finds the tangent of the law, which few trials need.
    """

    place: Place
    balls: Array
    overlap: float
    contacts: Contacts
    linearise: Callable[[], Tangent]
    pull: Array
    push: float
    left: float
    missed: float
    size: float
    newton: int = 0
    krylov: int = 0

    @property
    def tangent(self) -> Tangent:
        """Derivatives of the contacts' forces; the law keeps them once they are found."""
        return self.linearise()

    def follow(self, other: Trial) -> Trial:
        """Return another trial that has taken the steps of this one."""
        return replace(other, newton=self.newton, krylov=self.krylov)


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


def integrate_last(loads: Sequence[float], values: Sequence[float]) -> float:
    """Return the integral of a function between the last two of two or three ``loads``, of which ``values`` are known.

    It is that of the parabola through three values; after a turn of the path, that of the straight line through two.
    """
    *_, (start, first), (end, last) = zip(loads, values, strict=True)
    straight = 0.5 * (first + last) * (end - start)
    if not goes_on(loads):
        return straight
    bend = ((last - first) / (end - start) - (first - values[0]) / (start - loads[0])) / (end - loads[0])
    return straight - bend * (end - start) ** 3 / 6.0
