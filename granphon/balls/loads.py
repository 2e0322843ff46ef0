"""Loads: what presses the balls (a force, a pressure or an overlap), and how hard."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from functools import cached_property, partial
from typing import Any, Self

import numpy as np
from numpy.typing import ArrayLike, NDArray

from granphon.balls.hertz import NO_STIFFNESS, NO_TENSION
from granphon.base.errors import InputError, brief
from granphon.base.memory import require_memory
from granphon.base.quantities import LOAD_KINDS, TENSORS, find_load_unit
from granphon.base.results import read_only
from granphon.base.text import counted
from granphon.base.validation import (
    finite_array,
    finite_list,
    one_of,
    real_list,
    require,
    whole,
)

#: memory of the state at one load, bytes, of which no medium takes less; and of loads that are
#: listed, as for a sweep
_LOAD_BYTES = 110.0
_LISTED_BYTES = 850.0
#: numbers of the components of a symmetric tensor of one, two and three periods
_VOIGT_SIZES = (1, 3, 6)
#: a rule (:mod:`granphon.base.validation`) for the length of a side of a hexagonal frame, in balls
balls_on_side = partial(whole, low=1, high=1_000_000)


def force_of_frame(side_force: Any, balls_per_side: int) -> Any:
    """Return the contact force f, N, in a hexagonal frame, each side of which is pressed with
    ``side_force`` F, N, onto n = ``balls_per_side`` balls.

    f = F / (n sqrt 3). A side is as long as the n balls that lean on it, so that P = F/(n d), and P
    d = sqrt(3) f (equation 20). Each ball passes F/n on to two contacts at 30 degrees to the push.
    The overlap drops out.

    Section IV has n = 31 and "~990 N" for f = 18.446 N; the formula gives 18.438 N at 990 N, and
    18.446 N at 990.4 N.
    """
    return side_force / (balls_per_side * math.sqrt(3.0))


@dataclass(frozen=True, eq=False)
class Load:
    """What presses the balls, and how hard.

    Parameters
    ----------
    kind : "force" (f of a contact), "pressure" (P on the boundary), "overlap" (delta = d - a of a
        contact), "side_force" (F on each side of a hexagonal frame); of a crystal also "stress" or
        "strain".
    array : one value or many, of any shape, kept as a read-only array. Forces are in N, overlaps in
        m, pressures and stresses in N/m in the plane, Pa in space and N on a line. Overlaps may be
        negative, as balls may differ; forces and pressures are above zero, of a crystal with
        gravity also zero. Of a stress or strain they are the sizes that multiply the tensor, above
        zero.
    balls_per_side : length of a side of the frame in balls, for a side force only.
    tensor : the stress or strain of size one in Voigt order, 1, 3 or 6 components; tension and
        extension are positive.
    gravity : of a crystal, the acceleration towards the face that is held, m/s^2, or down the last
        axis where springs to the ground alone hold the balls; the other way where below zero.

    Raises
    ------
    InputError : another kind; a value that is not a finite number, or not above zero where it must
        be; more values than memory holds; a side force without ``balls_per_side``, a stress or
        strain without ``tensor``, or another kind of load with either; a ``balls_per_side`` that is
        no whole number from 1 to 1e6, a tensor that has not 1, 3 or 6 finite components, and a
        gravity that is not a finite number.
    """

    kind: str
    array: Any
    balls_per_side: int | None = None
    tensor: tuple[float, ...] | None = None
    gravity: float | None = None

    def __post_init__(self) -> None:
        """Check all values, and keep those of the load as a read-only array, the tensor as a tuple
        and gravity as a float.
        """
        one_of("kind", self.kind, LOAD_KINDS)
        if self.gravity is not None:
            object.__setattr__(self, "gravity", _read_gravity(self.gravity))
        _require_memory(self.array, _LOAD_BYTES)
        object.__setattr__(self, "array", read_only(finite_array(self.kind, self.array)))
        # an overlap may be negative, and balls under gravity need no other load
        may_be_zero = self.gravity is not None and np.all(self.array >= 0.0)
        if self.kind != "overlap" and not may_be_zero:
            require_compressive(self.kind, self.array)
        needs_tensor = self.kind in TENSORS
        has_tensor = self.tensor is not None
        if needs_tensor != has_tensor:
            raise InputError("a stress or strain has a tensor, and no other load has one")
        if self.tensor is not None:
            object.__setattr__(self, "tensor", _read_tensor(self.tensor))
        needs_side = self.kind == "side_force"
        has_side = self.balls_per_side is not None
        if needs_side != has_side:
            raise InputError("balls_per_side belongs to a side_force, and a side_force needs it")
        if self.balls_per_side is not None:
            require("balls_per_side", balls_on_side, self.balls_per_side)

    @classmethod
    def only(cls, **values_of_kinds: ArrayLike | None) -> Self:
        """Make a load from the one of the keywords ``values_of_kinds`` that is not None: its name
        is the kind, its value a number or a list of n numbers, in the SI unit of the kind. The
        array of the load is (n,), of a number (1,).

        Raises :class:`~granphon.base.errors.InputError` if all keywords are None or several are
        not, if the value is neither a number nor a list of numbers, and where the class does.
        """
        kinds = [kind for kind, values in values_of_kinds.items() if values is not None]
        if len(kinds) != 1:
            problem = "there is no load"
            if kinds:
                problem = f"the loads are given as {' and '.join(kinds)}"
            raise InputError(problem, mend="Give one of " + ", ".join(values_of_kinds))
        kind = kinds[0]
        values = values_of_kinds[kind]
        _require_memory(values, _LISTED_BYTES)
        return cls(kind, np.array(real_list(kind, values)))

    def __eq__(self, other: object) -> bool:
        """Whether ``other`` is the same load; a single value is the same load as a list of one."""
        if not isinstance(other, Load):
            return NotImplemented
        return self._key == other._key

    def __hash__(self) -> int:
        """Return the hash of what :meth:`__eq__` compares."""
        return hash(self._key)

    @property
    def _key(self) -> tuple[Any, ...]:
        """What is compared and hashed; a single value is the same load as a list of one."""
        shape = self.shape if self.size > 1 else ()
        return self.kind, shape, self.values, self.balls_per_side, self.tensor, self.gravity

    def __getitem__(self, index: Any) -> Self:
        """Return the load with some of its values, selected by an index as of an array. Raises
        InputError for an index that selects none, and IndexError for one outside of the values.
        """
        return replace(self, array=self.array[index])

    @property
    def shape(self) -> tuple[int, ...]:
        """Shape of the array of values; () of a number, (1,) of a list of one."""
        return np.shape(self.array)

    @cached_property
    def size(self) -> int:
        """Number of values."""
        return int(np.size(self.array))

    @cached_property
    def values(self) -> tuple[float, ...]:
        """Values as plain numbers in SI, in C order."""
        return tuple(np.ravel(self.array).tolist())

    @property
    def flat(self) -> Self:
        """The same load with its values as an array of shape (n,)."""
        return replace(self, array=np.ravel(self.array))

    def describe(self, periods: int, pressed_axes: int | None = None) -> str:
        """Return the load in words, with its SI unit on a lattice of 1, 2 or 3 ``periods``. The
        unit of a pressure is that of the number of axes along which the pressure acts,
        ``pressed_axes``, by default as many as there are periods.
        """
        return f"{self} {find_load_unit(self.kind, periods, pressed_axes)}".rstrip()

    @property
    def applied(self) -> Self:
        """The load as it acts on contacts: a side force becomes the force of a contact, other kinds
        stay.
        """
        if self.balls_per_side is None:
            return self
        return replace(
            self,
            kind="force",
            array=force_of_frame(self.array, self.balls_per_side),
            balls_per_side=None,
        )

    def __str__(self) -> str:
        """The load in words for a message, without a unit: that of a pressure depends on the
        lattice.
        """
        # a text of more numbers would be cut: the first are enough
        numbers = self.array[:64] if self.shape else self.array
        return f"{self.kind} = {brief(np.asarray(numbers).tolist())}"


def _read_gravity(gravity: Any) -> float:
    """Return an acceleration, m/s^2, as a float; InputError unless it is one finite number."""
    array = finite_array("gravity", gravity, "m/s^2")
    if array.ndim:
        problem = f"gravity is {brief(gravity)}"
        raise InputError(problem, mend="Give one number, towards the face that is held")
    return float(array)


def _read_tensor(components: Any) -> tuple[float, ...]:
    """Return the components of a stress or strain in Voigt order as a tuple of 1, 3 or 6 floats, of
    one to three periods; InputError for other numbers.
    """
    tensor = finite_list("tensor", components)
    if len(tensor) not in _VOIGT_SIZES:
        problem = f"tensor has {counted(len(tensor), 'component')}"
        raise InputError(problem, mend="Give 1, 3 or 6, for one, two or three periods")
    return tensor


def _require_memory(loads: Any, bytes_of_load: float) -> None:
    """Raise :class:`InputError` if the states at a number, list or array of ``loads`` do not fit
    into memory.
    """
    count = 1
    if isinstance(loads, np.ndarray):
        count = loads.size
    elif isinstance(loads, list | tuple):
        count = len(loads)
    require_memory(f"states at {count:,} loads", bytes_of_load * count, "Take fewer loads")


def given_load(load: Any) -> Load:
    """Return ``load``, the argument of a public call, if it is a :class:`Load`; raise
    :class:`InputError` for anything else.
    """
    if not isinstance(load, Load):
        raise InputError(f"load is {brief(load)}", mend="Give a Load, or call at_force")
    return load


def require_of_packing(load: Load) -> None:
    """Raise :class:`InputError` for something that is no :class:`Load`, and for a ``load`` that
    crystals alone bear: a stress or a strain, or a load with a gravity that is not zero.
    """
    problem = ""
    if given_load(load).tensor is not None:
        problem = f"a packing is not loaded by a {load.kind}"
    elif load.gravity:
        problem = "a packing has no gravity"
    if problem:
        raise InputError(
            problem,
            "All contacts of its lattice carry one mean force",
            "Give a force, pressure or overlap alone, or press a gp.Crystal",
        )


def require_compressive(name: str, loads: NDArray[np.float64]) -> None:
    """Raise :class:`InputError`, which calls the ``loads`` (any shape) by ``name``, if one of them
    is negative or zero.
    """
    if np.any(loads < 0.0):
        problem = f"{name} is {brief(loads.tolist())}: tensile"
        raise InputError(problem, NO_TENSION, "Give a load above zero")
    if np.any(loads == 0.0):
        raise InputError(f"{name} is zero", NO_STIFFNESS, "Press the balls")
