"""What a number depends on, by the named parameters of a scene: Young modulus, density, load, ...

The balls come to rest anew at each value of a parameter, so that the derivative goes through the
statics: at a given force contacts of a softer material overlap more. The logarithmic derivative
d ln X/d ln p is a difference of the fourth order, of states at four values of the parameter.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from granphon.balls.loads import Load
from granphon.balls.packing import KIND_PARAMETERS, Packing, change_packing
from granphon.base.arrays import Array
from granphon.base.errors import InputError, brief
from granphon.base.results import Result
from granphon.base.validation import real_array, texts
from granphon.media.arrangement import Arrangement, given_balls
from granphon.media.choice import MediumChoice
from granphon.networks.network import given_network

#: the ratio of shear to normal stiffness, which no state has as a parameter: it is changed in the
#: network of the state
MINDLIN_RATIO = "mindlin_ratio"
#: relative step of a parameter: the error goes as its fourth power, and rounding as its inverse
_STEP = 2e-3
#: steps, and weights of a derivative of the fourth order
_STEPS = ((1.0, 8.0 / 12.0), (-1.0, -8.0 / 12.0), (2.0, -1.0 / 12.0), (-2.0, 1.0 / 12.0))


@dataclass(frozen=True, eq=False, repr=False)
class ParameterSensitivities(Result):
    """Logarithmic derivatives of a number, or of an array of numbers, by named parameters.

    Attributes
    ----------
    names : (n_p,) names of the parameters.
    slopes : (n_p, ...) d ln X/d ln p, without a unit; nan where X is zero.
    value : X, an array of any shape, in its own unit.
    """

    names: tuple[str, ...]
    slopes: Array
    value: Any

    def __getitem__(self, name: str) -> Any:
        """Return the derivatives by the parameter of a ``name``; InputError if it has none."""
        if name not in self.names:
            mend = f"There are {', '.join(self.names)}"
            raise InputError(f"nothing is known of the parameter {brief(name)}", mend=mend)
        return self.slopes[self.names.index(name)][()]


def parameter_sensitivities(
    x: Any,
    find: Callable[[Any], ArrayLike],
    parameters: str | Sequence[str] | None = None,
    *,
    medium: str | None = None,
    finite_overlap: bool = False,
    **load: float,
) -> ParameterSensitivities:
    """Return the logarithmic derivatives of what ``find`` returns of a state, by the parameters of
    its balls and load.

    Parameters
    ----------
    x : a :class:`~granphon.Packing` or a :class:`~granphon.Crystal`.
    find : function of a state, or of a network, that returns a number or an array, such as ``lambda
        s: gp.Phonons(s).frequencies([[0.5, 0]])`` (Hz).
    parameters : names, as a sweep has them, "young_modulus", of a crystal with the kind of ball,
        "A.young_modulus"; the kind of the load, "force"; and "mindlin_ratio", the ratio of shear to
        normal stiffness of all contacts. All of them by default.
    medium : name of the medium of a packing; "ema" by default.
    finite_overlap : as for the state.
    load : the load by its kind, as ``force=18.4`` (N).

    Raises :class:`~granphon.base.errors.InputError` for unknown names, parameters that are no
    numbers, several loads, and arrays of ``find`` whose shape changes; and what the states and
    ``find`` raise.
    """
    balls = given_balls(x)
    given: Any = find
    if not callable(given):
        mend = "Give a function of a state, as lambda s: gp.moduli(s).bulk"
        raise InputError(f"find is {brief(given)}", mend=mend)
    applied = _read_load(load)
    names = _list_names(balls, applied) if parameters is None else texts("parameters", parameters)
    default_medium = "ema" if isinstance(balls, Packing) else "crystal"
    choice = MediumChoice(medium or default_medium)

    def find_at(name: str, factor: float) -> Array:
        """Return the numbers with the parameter of a ``name`` times a ``factor``."""
        changed: Packing | Arrangement = balls
        load_there = applied
        if name == applied.kind:
            load_there = replace(applied, array=factor * applied.array)
        elif name and name != MINDLIN_RATIO:
            changed = change_packing(balls, {name: factor * _read_number(balls, name)})
        flat = replace(load_there, array=np.ravel(load_there.array)[0])
        state: Any = choice.of(changed).at(flat, finite_overlap=finite_overlap or None)
        if name == MINDLIN_RATIO:
            network = given_network(state)
            state = replace(network, shear_stiffness=factor * network.shear_stiffness)
        return real_array("what find returns", find(state))

    value = find_at("", 1.0)
    divisor = np.where(value == 0.0, np.nan, _STEP * value)  # what is zero has no logarithm
    slopes = []
    for name in names:
        difference: Any = 0.0
        for step, weight in _STEPS:
            changed_value = find_at(name, 1.0 + step * _STEP)
            if changed_value.shape != value.shape:
                fault = f"find returns the shape {value.shape}, and {changed_value.shape}"
                mend = "Return as many numbers of every state"
                raise InputError(f"{fault} where {name} is changed by {step * _STEP:g}", mend=mend)
            difference += weight * changed_value
        slopes.append(difference / divisor)
    return ParameterSensitivities(names, np.array(slopes), value)


def _read_load(load: Mapping[str, Any]) -> Load:
    """Return the load of one kind and one value; InputError for none or several."""
    if not load:
        raise InputError("there is no load", mend="Give one by its kind, as force=18.4")
    applied = Load.only(**load)
    if applied.size != 1:
        kind = applied.kind
        raise InputError(f"{kind} has {applied.size} values", mend=f"Give one {kind} at a time")
    return applied


def _list_names(balls: Packing | Arrangement, load: Load) -> tuple[str, ...]:
    """Return the names of all parameters of balls under a load that are numbers above zero."""
    if isinstance(balls, Packing):
        candidates = ["young_modulus", "poisson_ratio", "density", "diameter", "width"]
        candidates += ["torsion", "bending"]
        friction = balls.friction
    else:
        parameters = [name for name in KIND_PARAMETERS if name not in ("yield_strength", "mass")]
        if balls.given is not None and balls.given.periods:
            parameters.remove("diameter")  # places follow from diameters on a named lattice alone
        candidates = [f"{kind}.{name}" for kind in balls.kind_names for name in parameters]
        friction = balls.friction
    names = [name for name in candidates if _is_number(_read_value(balls, name))]
    return (*names, load.kind, *([MINDLIN_RATIO] if friction else []))


def _is_number(value: Any) -> bool:
    """Return whether the value of a parameter is a number other than zero."""
    return isinstance(value, float | int) and value != 0.0


def _read_number(balls: Packing | Arrangement, name: str) -> float:
    """Return the value of a parameter, SI; InputError unless it is a number."""
    value = _read_value(balls, name)
    if isinstance(value, bool) or not isinstance(value, float | int):
        raise InputError(f"the parameter {name!r} is {brief(value)}, no number", mend="Use others")
    return value


def _read_value(balls: Packing | Arrangement, name: str) -> Any:
    """Return the value of a parameter, SI; InputError for a name that the balls do not have."""
    kind, _, parameter = name.rpartition(".")
    owner: Any = balls
    if kind:
        owner = None if isinstance(balls, Packing) else dict(balls.kinds).get(kind)
    for candidate in (owner, getattr(owner, "material", None)):
        if hasattr(candidate, parameter):
            return getattr(candidate, parameter)
    mend = "Use a name of a sweep, the kind of the load, or mindlin_ratio"
    raise InputError(f"the balls have no parameter {brief(name)}", mend=mend)
