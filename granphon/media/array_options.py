"""The options of media that simulate arrays: the shape of a sample, and how it comes to its load,
at rest without friction, or loaded with friction from a start.

The fields of a :class:`FrictionHistory` are options of a :class:`~granphon.DirectSimulation`, and
some are options of an :class:`~granphon.AutoMedium` and of a trade-off. All three take the options
as flat keywords beside ``friction_history``, and scenes do too; :meth:`FrictionHistory.read` reads
them. What carries them out is in :mod:`granphon.media.loading` and
:mod:`granphon.media.simulation`, which these options do not need.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, fields, replace
from functools import partial
from typing import Any, Self

import numpy as np

from granphon.array.options import (
    GAS,
    REFINEMENT_TOLERANCE,
    SHEAR_RESPONSES,
    START_SPACING,
    ReducedLoad,
)
from granphon.balls.loads import Load
from granphon.balls.packing import Packing
from granphon.base.arrays import Array
from granphon.base.errors import InputError, Refused
from granphon.base.text import show
from granphon.base.validation import (
    choice,
    lengths,
    number,
    read_inside,
    real_number,
    require,
    truth,
)
from granphon.media.medium import Option

#: default numbers of cells of a sample, with one, two and three periods
DEFAULT_SHAPES = {1: (16_384,), 2: (128, 128), 3: (24, 24, 24)}
#: rule of validation for the numbers of cells in a scene; ``periods`` says how many there must be
read_cells = partial(lengths, low=1, high=20_000)
#: the attributes of a state that only samples with a history of friction have, with their units
HISTORY_UNITS = {
    "sliding_fraction": "1",
    "tangential_ratio": "1",
    "work": "J",
    "dissipated_energy": "J",
}
#: the attributes of a state that only states of samples have, with their units
SAMPLE_UNITS = {"contact_force_fluctuation": "1", **HISTORY_UNITS}
#: least and greatest reduced spacing a* that may be given as a start
_STARTS = (-1.0, 1e6)
#: the options of arrays that errors are measured against; such arrays are loaded from the default
#: start, in one direction
REFERENCE_OPTIONS = ("friction_history", "friction_coefficient", "shear_response")


# -- loads in reduced units -----------------------------------------------------------------------


def reduce_load(packing: Packing, load: Load) -> Array:
    """Return f* of each value of an applied load, or a* of a load that is given as an overlap, with
    the shape of the load. Their unit of length is the width or, of equal balls, the diameter.
    """
    units = packing.width_units
    with np.errstate(all="ignore"):  # beyond the floating range f* and a* are infinite
        if load.kind == "overlap":
            return np.asarray(units.reduced_spacing(load.array))
        forces = load.array
        if load.kind == "pressure":
            forces = load.array / packing.pressure_per_force
        return np.asarray(units.reduced_force(forces))


def prescribe(packing: Packing, load: Load, is_exact: bool = False) -> list[ReducedLoad]:
    """Return the loads that an applied ``load`` prescribes, one
    :class:`~granphon.array.options.ReducedLoad` for each value, in C order.

    An overlap stays an overlap, in units of the width W, or of the diameter of equal balls. A force
    is that of :func:`reduce_load`. A pressure becomes the force that has this pressure in a cell
    that keeps its size. In the exact geometry (``is_exact``) the boundary shrinks with the cell:
    such a load is marked as one ``on_boundary``.
    """
    if load.kind == "overlap":  # not a*, which would lose the digits of a small overlap
        overlaps = packing.width_units.reduced_overlap(load.array).ravel().tolist()
        return [ReducedLoad(overlap=overlap) for overlap in overlaps]
    on_boundary = is_exact and load.kind == "pressure"
    forces = reduce_load(packing, load).ravel().tolist()
    return [ReducedLoad(force=force, on_boundary=on_boundary) for force in forces]


def sort_by_load(prescribed: Sequence[ReducedLoad]) -> list[int]:
    """Return the indices of the loads, from the highest load down.

    In the directions of the lattice each equilibrium is found from that at the next higher load,
    which affects only digits beyond the tolerance. In the true geometry the starting point decides
    where loose balls come to rest: there no equilibrium is found from another.
    """
    return sorted(range(len(prescribed)), key=lambda index: prescribed[index], reverse=True)


# -- how samples come to their load ----------------------------------------------------------------


@dataclass(frozen=True)
class FrictionHistory:
    """How samples are loaded with friction; by default samples come to rest without friction.

    Attributes
    ----------
    friction_coefficient : mu of the contacts, zero to infinity; None of samples at rest without
        friction.
    shear_response : tangential stiffness under sound, one of
        :data:`~granphon.array.options.SHEAR_RESPONSES`.
    start : where the loading starts, at rest without friction: a reduced spacing a*, or a load; or
        "gas": balls apart on their sites.
    step_tolerance : relative change of f* below which steps of the load are not halved again.
    ordered : whether loads come in the order given; otherwise they rise from the start.

    Raises :class:`~granphon.base.errors.InputError` for a value out of range or of another kind.
    """

    friction_coefficient: float | None = None
    shear_response: str = SHEAR_RESPONSES[0]
    start: float | Load | str = START_SPACING
    step_tolerance: float = REFINEMENT_TOLERANCE
    ordered: bool = False

    def __post_init__(self) -> None:
        """Check each value by the rule of its option, and keep what the rule returns."""
        for option in fields(self):
            rule = HISTORY_OPTIONS[option.name].rule
            value = require(option.name, rule, getattr(self, option.name))
            object.__setattr__(self, option.name, value)  # the dataclass is frozen

    @classmethod
    def read(cls, options: Mapping[str, Any]) -> Self:
        """Return the history that is given among the ``options`` of a medium or a trade-off, by
        their names; options that are not those of a history are ignored.

        The method is a rule of :mod:`granphon.base.validation`: it raises
        :class:`~granphon.base.errors.Refused` for an option out of range, a history without a
        friction coefficient, and options of a history, other than their defaults, without
        ``friction_history``.
        """
        history_options: dict[str, Any] = {}
        for name, option in HISTORY_OPTIONS.items():
            if name in options:
                history_options[name] = read_inside(name, option.rule, options[name])
        has_history = history_options.pop("friction_history", False)
        if has_history and history_options.get("friction_coefficient") is None:
            raise Refused(
                "no friction_coefficient",
                "a number, zero or above, or inf",
                "Give a friction_coefficient too, such as 0.2: it is a property of the surfaces.",
                ("friction_coefficient",),
            )
        if has_history:
            return cls(**history_options)
        # without a history only defaults are allowed
        for name, value in history_options.items():
            if value != HISTORY_OPTIONS[name].default:
                value_in_words = str(value) if isinstance(value, Load) else show(options[name])
                raise Refused(
                    f"{value_in_words} without friction_history",
                    f"{name} together with friction_history: true",
                    "Samples then come to rest without friction.",
                    (name,),
                )
        return cls()

    @property
    def is_loaded(self) -> bool:
        """Whether samples are loaded with friction."""
        return self.friction_coefficient is not None

    @property
    def options(self) -> dict[str, Any]:
        """Every option of :data:`HISTORY_OPTIONS`, with its value."""
        options = {option.name: getattr(self, option.name) for option in fields(self)}
        return {"friction_history": self.is_loaded} | options

    @property
    def reference(self) -> Self:
        """The history of the arrays that errors are measured against: the same friction, loaded
        from the default start in one direction, see :data:`REFERENCE_OPTIONS`.
        """
        return type(self)(self.friction_coefficient, self.shear_response)

    @property
    def from_gas(self) -> bool:
        """Whether the loading starts at the gas: balls apart on their sites."""
        return isinstance(self.start, str)

    def reduce_start(self, packing: Packing, is_exact: bool) -> ReducedLoad | str:
        """Return the start in reduced units, or "gas".

        ``is_exact`` says whether balls have their exact geometry, in which a pressure acts on a
        boundary that shrinks.
        """
        if isinstance(self.start, Load):
            (start,) = prescribe(packing, self.start.applied, is_exact)
            return start
        if self.from_gas:
            return "gas"
        # the overlap in units of the width W is a* - 1/2
        return ReducedLoad(overlap=float(self.start) - 0.5)

    def sort(self, prescribed: Sequence[ReducedLoad]) -> list[int]:
        """Return the indices of the ``prescribed`` loads in the order in which they are applied: as
        given if the history is ordered, else from the lowest up.
        """
        indices = list(range(len(prescribed)))
        if not self.ordered:
            indices.sort(key=lambda index: prescribed[index])
        return indices

    @property
    def words(self) -> str:
        """How samples come to their load, in words."""
        mu = self.friction_coefficient
        if mu is None:
            return "at rest without friction"
        return f"loaded with friction, mu = {mu:g}, shear_response {self.shear_response}"

    def __str__(self) -> str:
        return f"arrays {self.words}"


def read_friction_coefficient(value: Any) -> float | None:
    """Return a friction coefficient: a number, zero or above, or infinity, also as a word. None is
    returned as it is, and means no history.

    The function is a rule of :mod:`granphon.base.validation`: it raises
    :class:`~granphon.base.errors.Refused` for another value.
    """
    if value is None:
        return None
    word = value.strip().lower() if isinstance(value, str) else ""
    is_infinite = word in ("inf", "infinite", "infinity")
    coefficient = math.inf if is_infinite else real_number(value)
    if not coefficient >= 0.0:
        raise Refused(show(value), "a number, zero or above, or inf")
    return abs(coefficient)  # a zero has no sign


def read_start(value: Any, load: Callable[[str, Any], float] | None = None) -> float | Load | str:
    """Return the start of a loading: a reduced spacing a*, a load, or "gas".

    ``value`` is a number from -1 to 1e6; a single :class:`~granphon.balls.loads.Load`; a block
    {force: ...}, {pressure: ...} or {overlap: ...}; the word "gas"; or None for the default start,
    a* = 1/2. The function ``load(kind, value)`` reads the value of a block and returns it in SI; if
    it is None, the value is a plain number in SI. Whether a packing bears the load is not known
    here: the simulation looks at that.

    The function is a rule of :mod:`granphon.base.validation`: it raises
    :class:`~granphon.base.errors.Refused` for another value.
    """
    if isinstance(value, Load):
        if value.size != 1:
            raise Refused(f"{value.size} loads", "one load")
        return replace(value, array=value.values[0])  # a list of one is a single load
    if value is None:
        return START_SPACING
    if isinstance(value, str) and value == GAS:
        return GAS
    if isinstance(value, Mapping):
        return _read_start_load(value, load)
    spacing = real_number(value)
    if not _STARTS[0] <= spacing <= _STARTS[1]:
        allowed = f"a reduced spacing a* such as 0.5, a load such as {{force: ...}}, or {GAS}"
        raise Refused(show(value), allowed)
    return spacing


def _read_start_load(
    block: Mapping[Any, Any], read_load: Callable[[str, Any], float] | None
) -> Load:
    """Return the start of a loading from a ``block`` {force: ...}, {pressure: ...} or {overlap:
    ...}, whose value ``read_load`` reads; without it the value is a plain number in SI.

    Raises :class:`~granphon.base.errors.Refused` for another block, or a value that is no load.
    """
    kinds = ("force", "pressure", "overlap")
    if len(block) != 1 or next(iter(block)) not in kinds:
        keys = " and ".join(map(str, block)) or "an empty block"
        raise Refused(keys, "one of " + ", ".join(f"{{{kind}: ...}}" for kind in kinds))
    [(kind, value)] = block.items()
    allowed = f"one {kind}" if read_load else f"one {kind} in SI, as a plain number"
    is_array = isinstance(value, np.ndarray) and value.ndim > 0
    if is_array or isinstance(value, list | tuple | Mapping):
        raise Refused(show(value), allowed, "A loading starts at one load.", (kind,))
    if read_load is None and not math.isfinite(real_number(value)):
        raise Refused(show(value), allowed, path=(kind,))
    try:
        size_of_load = real_number(value) if read_load is None else read_load(kind, value)
        return Load(kind, size_of_load)
    except Refused as refused:
        raise refused.under(kind) from None
    except InputError as error:
        raise Refused(show(value), allowed, str(error), (kind,)) from None


#: the options that say whether and how samples are loaded with friction
HISTORY_OPTIONS: Mapping[str, Option] = {
    "friction_history": Option(
        False,
        truth,
        "load the samples [with friction](../how-to/simulation.md#load-it-with-friction)",
    ),
    "friction_coefficient": Option(
        FrictionHistory.friction_coefficient,
        read_friction_coefficient,
        "of the contacts; needed with `friction_history`, and only then, as are those below",
        "required with `friction_history`",
    ),
    "start": Option(
        FrictionHistory.start,
        read_start,
        "where the loading starts, at rest without friction: a reduced spacing $a^*$ or a load; or"
        " `gas`, balls apart",
    ),
    "shear_response": Option(
        FrictionHistory.shear_response,
        partial(choice, options=SHEAR_RESPONSES),
        "tangential stiffness under sound: $\\eta k$ everywhere, none where a contact slides, or"
        " that of Mindlin's partial slip",
    ),
    "step_tolerance": Option(
        FrictionHistory.step_tolerance,
        partial(number, low=1e-9, high=1.0),
        "relative change of the force by which steps of the load may be wrong",
    ),
    "ordered": Option(
        FrictionHistory.ordered,
        truth,
        "take the loads in the order given, up and down; else from the lowest to the highest",
    ),
}
#: the history of samples at rest without friction
REST = FrictionHistory()


def no_finite_overlap(medium: str, can_be_exact: bool = True) -> InputError:
    """Return the error for terms of finite overlap in a ``medium`` that simulates arrays in the
    directions of the lattice. ``can_be_exact`` says whether these arrays may have the exact
    geometry instead.
    """
    exact = "simulate with geometry exact, " if can_be_exact else ""
    return InputError(
        f"the medium {medium!r} has no terms of finite overlap",
        "Its linear response is found in the limit of spread and overlap small against the"
        " diameter",
        f"Leave finite_overlap out, {exact}or take another medium",
    )
