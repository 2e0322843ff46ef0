"""What a scene goes over: every medium at every combination of parameters, and the loads; counted before any is made."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass, replace

from granphon.balls.loads import Load
from granphon.balls.packing import Packing
from granphon.balls.parameters import Axis, combinations
from granphon.media.choice import MediumChoice
from granphon.media.cost import Cost, estimate
from granphon.media.simulation import DirectSimulation

__all__ = ["Plan"]

#: as many cases are looked at one by one; of more, those at the ends of the axes
MOST_CASES = 100


@dataclass(frozen=True)
class Plan:
    """The ``axes`` of a ``packing``, the ``media``, and the applied ``load``."""

    packing: Packing
    axes: tuple[Axis, ...]
    media: tuple[MediumChoice, ...]
    load: Load

    @property
    def cases(self) -> int:
        """How many: a medium at a combination of parameters each."""
        return len(self.media) * math.prod(len(axis.values) for axis in self.axes)

    @property
    def states(self) -> int:
        """How many: a case at a load each."""
        return self.cases * self.load.size

    def __iter__(self) -> Iterator[tuple[str, Packing, MediumChoice]]:
        """The cases: in words as sweeps call them, the packing, and the medium."""
        for where, packing in combinations(self.packing, self.axes):
            for choice in self.media:
                yield ", ".join(filter(None, (choice.label, where))), packing, choice

    @property
    def ends(self) -> Plan:
        """The least and the greatest of each axis: what a packing can be, it is between them if it is at all of them."""
        return replace(self, axes=tuple(axis.ends for axis in self.axes))

    @property
    def few(self) -> Plan:
        """The plan itself, or its :attr:`ends` if it has too many cases to be looked at one by one."""
        return self if self.cases <= MOST_CASES else self.ends

    def simulations(self, exponents: bool) -> Cost:
        """Of all of them, one after the other, with their local ``exponents`` if these are asked for.

        Of very many cases, of as many as the dearest at the ends of the axes.
        """
        few = self.few
        found = [
            estimate(medium, rung.load, exponents=exponents)
            for _, packing, choice in few
            if choice.simulates or choice.is_automatic
            for rung in choice.rungs(packing, self.load)
            if isinstance(medium := rung.medium.of(packing), DirectSimulation)
        ]
        if few is not self and found:
            return max(found, key=lambda cost: cost.work).times(len(found) * self.cases / few.cases)
        return sum(found, Cost())
