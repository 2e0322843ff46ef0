"""How simulated samples come to their load: at rest without friction, or loaded with friction, step by step from a start.

:class:`FrictionHistory` holds it. Its fields are options of a :class:`~granphon.DirectSimulation`, some also of an
:class:`~granphon.AutoMedium` and of a trade-off, which take them as flat keywords beside ``friction_history``; so do scenes.
:meth:`FrictionHistory.read` reads all of these.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, fields
from functools import partial
from typing import Any, Self

import numpy as np

from granphon.array.geometry import ReducedLoad
from granphon.array.history import REFINEMENT_TOLERANCE, START_SPACING
from granphon.array.pressed_sample import SHEAR_RESPONSES
from granphon.array.stepper import GAS
from granphon.balls.loads import Load
from granphon.balls.packing import Packing
from granphon.base.errors import InputError, Refused
from granphon.base.text import show
from granphon.base.validation import choice, number, read_inside, real_number, truth
from granphon.media.equilibria import prescribe
from granphon.media.medium import Option

#: least and greatest reduced spacing a* that may be given as a start
_STARTS = (-1.0, 1e6)
#: the options of arrays that errors are measured against: they are loaded from the default start, in one direction
REFERENCE_OPTIONS = ("friction_history", "friction_coefficient", "shear_response")


@dataclass(frozen=True)
class FrictionHistory:
    """How samples are loaded with friction; the default is that they come to rest without friction.

    Attributes
    ----------
    friction_coefficient : mu of the contacts, zero to infinity; None of samples at rest without friction.
    shear_response : tangential stiffness under sound, one of :data:`~granphon.array.pressed_sample.SHEAR_RESPONSES`.
    start : where the loading starts, at rest without friction: a reduced spacing a*, or a load; or "gas": balls apart on
        their sites.
    step_tolerance : relative change of f* below which steps of the load are not halved again.
    ordered : whether loads come in the order given; otherwise they rise from the start.
    """

    friction_coefficient: float | None = None
    shear_response: str = SHEAR_RESPONSES[0]
    start: float | Load | str = START_SPACING
    step_tolerance: float = REFINEMENT_TOLERANCE
    ordered: bool = False

    @classmethod
    def read(cls, options: Mapping[str, Any]) -> Self:
        """Return the history that some options name, of a medium or a trade-off; it may have others too.

        It is a rule of :mod:`granphon.base.validation`: :class:`~granphon.base.errors.Refused` for an option out of range,
        a history without a friction coefficient, and options of a history without ``friction_history``.
        """
        given = {
            name: read_inside(name, known.rule, options[name]) for name, known in HISTORY_OPTIONS.items() if name in options
        }
        if given.pop("friction_history", False):
            if given.get("friction_coefficient") is None:
                mend = "Give a friction_coefficient too, such as 0.2: it is a property of the surfaces."
                raise Refused("no friction_coefficient", "a number, zero or above, or inf", mend, ("friction_coefficient",))
            return cls(**given)
        for name, value in given.items():
            if value != HISTORY_OPTIONS[name].default:
                found = f"{show(options[name])} without friction_history"
                mend = "Samples then come to rest without friction."
                raise Refused(found, f"{name} together with friction_history: true", mend, (name,))
        return cls()

    @property
    def is_loaded(self) -> bool:
        """Whether samples are loaded with friction."""
        return self.friction_coefficient is not None

    @property
    def options(self) -> dict[str, Any]:
        """Every option of :data:`HISTORY_OPTIONS`, with its value."""
        return {"friction_history": self.is_loaded} | {one.name: getattr(self, one.name) for one in fields(self)}

    @property
    def reference(self) -> Self:
        """The same friction in the arrays that errors are measured against, see :data:`REFERENCE_OPTIONS`."""
        return type(self)(self.friction_coefficient, self.shear_response)

    @property
    def from_gas(self) -> bool:
        """Whether the loading starts at the gas: balls apart on their sites."""
        return isinstance(self.start, str)

    def reduce_start(self, packing: Packing, is_exact: bool) -> ReducedLoad | str:
        """Return the start in reduced units, or "gas"; that of equal balls, which need none, is at the default a*.

        ``is_exact`` says whether balls have their exact geometry, in which a pressure acts on a boundary that shrinks.
        """
        if isinstance(self.start, Load):
            return prescribe(packing, self.start.applied, is_exact)[0]
        return self.start if isinstance(self.start, str) else ReducedLoad(overlap=self.start - 0.5)

    def sort(self, prescribed: Sequence[ReducedLoad]) -> list[int]:
        """Return the indices of the loads in the order in which they are applied."""
        places = range(len(prescribed))
        return list(places) if self.ordered else sorted(places, key=lambda place: prescribed[place])

    @property
    def words(self) -> str:
        """How samples come to their load, in words."""
        if self.friction_coefficient is None:
            return "at rest without friction"
        return f"loaded with friction, mu = {self.friction_coefficient:g}, shear_response {self.shear_response}"

    def __str__(self) -> str:
        return f"arrays {self.words}"


def read_friction_coefficient(value: Any) -> float | None:
    """Read a friction coefficient: a number, zero or above, infinity too; None is that of no history.

    It is a rule of :mod:`granphon.base.validation`.
    """
    if value is None:
        return None
    word = value.strip().lower() if isinstance(value, str) else ""
    found = math.inf if word in ("inf", "infinite", "infinity") else real_number(value)
    if not found >= 0.0:
        raise Refused(show(value), "a number, zero or above, or inf")
    return found


def read_start(value: Any, load: Callable[[str, Any], float] | None = None) -> float | Load | str:
    """Read the start of a loading: a reduced spacing a*, {force: ...}, {pressure: ...}, {overlap: ...}, or "gas".

    It is a rule of :mod:`granphon.base.validation`; ``load(kind, value)`` reads the value of a load. None is the default.
    """
    if isinstance(value, Load):
        if value.size != 1:
            raise Refused(f"{value.size} loads", "one load")
        return value
    if value is None or (isinstance(value, str) and value == GAS):
        return START_SPACING if value is None else GAS
    kinds = ("force", "pressure", "overlap")
    if isinstance(value, Mapping):
        if len(value) != 1 or next(iter(value)) not in kinds:
            told = " and ".join(map(str, value)) or "an empty block"
            raise Refused(told, "one of " + ", ".join(f"{{{kind}: ...}}" for kind in kinds))
        kind, given = next(iter(value.items()))
        one = f"one {kind}{'' if load else ' in SI, as a plain number'}"
        if isinstance(given, list | tuple | Mapping) or (isinstance(given, np.ndarray) and given.ndim):
            raise Refused(show(given), one, "A loading starts at one load.", (kind,))
        if load is None and not math.isfinite(real_number(given)):
            raise Refused(show(given), one, path=(kind,))
        try:
            return Load(kind, real_number(given) if load is None else load(kind, given))
        except Refused as refused:
            raise refused.under(kind) from None
        except InputError as error:
            raise Refused(show(given), one, str(error), (kind,)) from None
    found = real_number(value)
    if not _STARTS[0] <= found <= _STARTS[1]:
        raise Refused(show(value), f"a reduced spacing a* such as 0.5, a load such as {{force: ...}}, or {GAS}")
    return found


#: the options that say whether and how samples are loaded with friction
HISTORY_OPTIONS: Mapping[str, Option] = {
    "friction_history": Option(False, truth),
    "friction_coefficient": Option(FrictionHistory.friction_coefficient, read_friction_coefficient),
    "start": Option(FrictionHistory.start, read_start),
    "shear_response": Option(FrictionHistory.shear_response, partial(choice, options=SHEAR_RESPONSES)),
    "step_tolerance": Option(FrictionHistory.step_tolerance, partial(number, low=1e-9, high=1.0)),
    "ordered": Option(FrictionHistory.ordered, truth),
}
#: samples at rest without friction
REST = FrictionHistory()
