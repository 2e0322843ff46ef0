"""The loads of a scene: what is pressed, how hard, and how often."""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import partial

import numpy as np

from granphon.base.arguments import positive, real_array
from granphon.base.errors import InputError, brief, message
from granphon.base.quantities import LOADS
from granphon.base.validation import ruled, whole

__all__ = ["Load", "balls_on_side", "force_of_frame"]

#: a rule: how many balls a side of a hexagonal frame is long
balls_on_side = partial(whole, low=1, high=1_000_000)


def force_of_frame(side_force: float, balls_per_side: int) -> float:
    """Contact force f, N, in a hexagonal frame whose sides are each pressed with ``side_force`` F onto n balls.

    f = F / (n sqrt 3). A side is as long as the n balls that lean on it, so that P = F/(n d), and P d = sqrt(3) f (equation
    20). Seen from one ball: it passes F/n on to two contacts at 30 degrees to the push. The overlap drops out.

    Section IV has n = 31 and "~990 N" for f = 18.446 N; the formula gives 18.438 N at 990 N, and 18.446 N at 990.4 N.
    """
    return side_force / (balls_per_side * math.sqrt(3.0))


@dataclass(frozen=True)
class Load:
    """The loads of a scene: ``kind`` (force, pressure, overlap, side_force), ``values`` in SI (N, N/m, m, N), one or more.

    ``balls_per_side`` belongs to a side force, and to no other. :class:`~granphon.base.errors.InputError` for a value that
    is not finite, or, unless it is an overlap, not above zero.
    """

    kind: str
    values: tuple[float, ...]
    balls_per_side: int | None = None

    def __post_init__(self) -> None:
        if not isinstance(self.kind, str) or self.kind not in LOADS:
            raise InputError(message(f"unknown kind of load {brief(self.kind)}", mend="Use " + ", ".join(LOADS)))
        given = np.atleast_1d(real_array(self.kind, self.values))
        if given.ndim != 1 or not given.size:
            raise InputError(message(f"{self.kind}: {self.values!r:.80}", mend="Give one number, or a list of them"))
        object.__setattr__(self, "values", tuple(self._checked(value) for value in given.tolist()))
        if (self.kind == "side_force") != (self.balls_per_side is not None):
            raise InputError(message("balls_per_side belongs to a side_force, and a side_force needs it"))
        if self.balls_per_side is not None:
            ruled("balls_per_side", balls_on_side, self.balls_per_side)

    def _checked(self, value: float) -> float:
        if self.kind == "overlap" and math.isfinite(value):
            return value  # where balls differ it may be negative
        return positive(self.kind, value, LOADS[self.kind].unit)

    @property
    def applied(self) -> tuple[str, tuple[float, ...]]:
        """What a medium is given: "force", "pressure" or "overlap", and values. A side force becomes that of contacts."""
        if self.balls_per_side is None:
            return self.kind, self.values
        count = self.balls_per_side
        return "force", tuple(force_of_frame(value, count) for value in self.values)
