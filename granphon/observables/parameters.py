"""Logarithmic derivatives of a number X by the named parameters p of a scene: Young modulus,
density, load, ...

The derivative goes through the statics: at a given force contacts of a softer material overlap
more. For each parameter, the change of the balls at rest is found to first order, by one linear
solution with the factors at rest (:mod:`granphon.statics.rest_courses`), or from the derivative of
the law of a medium (:meth:`granphon.media.medium.LawMedium.follow`). The result is a course, which
gives the state at any small change of the parameter without solving anything; d ln X/d ln p is a
difference of the fourth order along the course.
"""

from __future__ import annotations

from collections.abc import Callable, Collection, Mapping, Sequence
from dataclasses import replace
from functools import lru_cache, partial
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from granphon.balls.loads import Load
from granphon.balls.packing import Packing, change_packing
from granphon.base.arrays import Array
from granphon.base.differences import Course
from granphon.base.errors import GranphonError, InputError, brief
from granphon.base.results import Result, held, result_class
from granphon.base.validation import real_array, require, texts, truth
from granphon.media.arrangement import Arrangement, Balls, given_balls
from granphon.media.choice import MediumChoice
from granphon.media.medium import SIMULATION, Change
from granphon.networks.network import given_network

#: the ratio of shear to normal stiffness, which no state has as a parameter: it is changed in the
#: network of the state
MINDLIN_RATIO = "mindlin_ratio"
#: function of a state and of the relative change of a parameter on which the balls at rest do not
#: depend; returns what is then examined in place of the state
StateChange = Callable[[Any, float], Any]
#: relative step of a parameter on which the statics do not depend
_STEP = 2e-4
#: greatest relative change of a parameter in any difference: twice the largest step, which is that
#: of media whose states are found anew
_REACH = 4e-3
#: number of changed media that are kept for each parameter: a difference visits its steps more than
#: once
_N_KEPT_MEDIA = 8


@result_class
class ParameterSensitivities(Result):
    """Logarithmic derivatives of a number, or of an array of numbers, by named parameters.

    Attributes
    ----------
    names : (n_p,) names of the parameters.
    slopes : (n_p, ...) d ln X/d ln p, without a unit; nan where X is zero or nan.
    value : X, an array of any shape, in its own unit.
    """

    names: tuple[str, ...] = held((str, ...))
    slopes: Array = held(float, "*")
    value: Any = held(Any)

    def __getitem__(self, name: str) -> Any:
        """Return the derivatives (...) by the parameter of this ``name``, a number if X is a
        number; InputError for a name that is not among ``names``.
        """
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
    parameters : names as a sweep has them: "young_modulus", of a crystal with the kind of ball,
        "A.young_modulus", and of walls and springs to the ground, "wall.young_modulus" and
        "on_site". Also the kind of the load, "force", and "mindlin_ratio", the ratio of shear to
        normal stiffness of all contacts, which gives ``find`` a network in place of a state. By
        default all that are numbers other than zero and may change alone, no two of which change
        the same number: a kind whose mass is given has "A.mass", others "A.density". The ratio is
        among these only if contacts resist slip, the state has no simulated samples, each of which
        has a network of its own, and ``find`` takes a network, unlike ``lambda s: s.force``. The
        derivative by a parameter that is zero is zero.
    medium : name of the medium of a packing; "ema" by default. A crystal has the medium "crystal".
    finite_overlap : True for states with terms of the relative order of overlap over diameter; with
        False, the default, the medium or the crystal decides.
    load : the load by its kind, as ``force=18.4`` (N).

    Raises :class:`~granphon.base.errors.InputError` for balls of another kind, a ``find`` that
    cannot be called or returns no real numbers, an empty list of names, unknown names, parameters
    that are no numbers, the ratio of simulated samples, no load, several loads, a medium that the
    balls do not have, a ``finite_overlap`` that is no truth value, arrays of ``find`` whose shape
    changes, and the ratio by name where ``find`` does not take a network; and what the states and
    ``find`` raise.
    """
    balls = given_balls(x)
    function: Any = find
    if not callable(function):
        mend = "Give a function of a state, as lambda s: gp.moduli(s).bulk"
        raise InputError(f"find is {brief(function)}", mend=mend)
    applied = read_load(load)
    if medium is None:
        medium = "ema" if isinstance(balls, Packing) else "crystal"
    choice = MediumChoice(medium)
    require("finite_overlap", truth, finite_overlap)
    names = None if parameters is None else texts("parameters", parameters)
    if names is not None and not names:
        mend = f"Use {', '.join(list_parameters(balls, applied))}, or leave parameters out"
        raise InputError("parameters is an empty list", mend=mend)
    return find_parameter_sensitivities(choice, balls, applied, find, names, finite_overlap or None)


def find_parameter_sensitivities(
    choice: MediumChoice,
    balls: Packing | Arrangement,
    load: Load,
    find: Callable[[Any], ArrayLike],
    names: Sequence[str] | None,
    finite_overlap: bool | None = None,
    changes_of_states: Mapping[str, StateChange] | None = None,
) -> ParameterSensitivities:
    """Return the logarithmic derivatives of the number or array that ``find`` returns for a state,
    by the parameters called ``names``, or by all parameters if that is None.

    The state is that of ``balls`` under a single ``load``, in the medium of this ``choice``, with
    terms of finite overlap if ``finite_overlap`` is true; None lets the medium decide.
    ``changes_of_states`` are further parameters, on which the balls at rest do not depend, by name;
    ``find`` must take what these return. Raises what :func:`parameter_sensitivities` raises.
    """
    single_load = replace(load, array=np.ravel(load.array)[0])
    state_changes = {MINDLIN_RATIO: change_ratio} | dict(changes_of_states or {})
    if names is not None and MINDLIN_RATIO in names:
        _refuse_samples(choice, balls, single_load)  # before the statics, which take long
    all_names = list_parameters(balls, single_load) if names is None else names
    names_of_statics = [name for name in all_names if name not in state_changes]
    changes = [_change_parameter(choice, balls, single_load, name) for name in names_of_statics]
    # the state, and for each change the state as a function of the relative change
    state, courses = choice.of(balls).follow(single_load, changes, finite_overlap)
    course_of = dict(zip(names_of_statics, courses, strict=True))
    value = real_array("what find returns", find(state))
    if names is None and has_ratio(balls) and not getattr(state, "samples", ()):
        network = state_changes[MINDLIN_RATIO](state, 0.0)
        if _has_shape(find, network, value.shape):
            all_names = (*all_names, MINDLIN_RATIO)
    for name in state_changes.keys() & {*all_names}:
        course_of[name] = Course(partial(state_changes[name], state), _STEP)
    divisor = np.where(value == 0.0, np.nan, value)  # what is zero has no logarithm
    slopes = [_find_slope(find, course_of[name], name, value.shape) / divisor for name in all_names]
    return ParameterSensitivities(tuple(all_names), np.array(slopes), value)


def _refuse_samples(choice: MediumChoice, balls: Balls, load: Load) -> None:
    """Raise InputError if the medium of a ``choice`` simulates samples of the ``balls`` at the
    ``load``: each sample has a network of its own, so that the state has none whose ratio of
    stiffnesses could change.
    """
    if any(serving.medium.name == SIMULATION for serving in choice.choose(balls, load)):
        raise InputError(
            f"the states of a simulation have no parameter {MINDLIN_RATIO}",
            "Each sample has a network of its own",
            "Leave it out, or take another medium",
        )


def _change_parameter(
    choice: MediumChoice, balls: Packing | Arrangement, load: Load, name: str
) -> Change:
    """Return the function that changes the parameter called ``name``, of the balls or the kind of
    the ``load``: it takes the relative change of the parameter, and returns the medium of the
    balls, of this ``choice``, and the load, of which one is changed. Raises InputError for a
    parameter that is unknown or no number.
    """
    if name == load.kind:
        medium = choice.of(balls)
        return lambda step: (medium, replace(load, array=(1.0 + step) * load.array))
    number = read_number(balls, name)

    @lru_cache(maxsize=_N_KEPT_MEDIA)
    def change(step: float) -> tuple[Any, Load]:
        """Return the medium whose parameter is 1 + ``step`` times the given one, and the load."""
        return choice.of(change_packing(balls, {name: (1.0 + step) * number})), load

    return change


def has_ratio(balls: Packing | Arrangement) -> bool:
    """Return whether contacts of ``balls`` have a ratio of shear to normal stiffness other than
    zero: they resist slip only with friction.
    """
    return bool(balls.friction)


def change_ratio(state: Any, step: float) -> Any:
    """Return the network of a ``state``, with a ratio of shear to normal stiffness that is 1 +
    ``step`` times the ratio of the state: all shear stiffnesses change in proportion, and nothing
    else does.
    """
    network = given_network(state)
    return replace(network, shear_stiffness=(1.0 + step) * network.shear_stiffness)


def _has_shape(find: Callable[[Any], ArrayLike], network: Any, shape: tuple[int, ...]) -> bool:
    """Return whether ``find``, a function of states, takes a ``network`` too, and returns an array
    of this ``shape``. ``find`` does not take a network for which it raises AttributeError,
    LookupError or an error of granphon; other errors are its own, and are raised.
    """
    try:
        return np.shape(find(network)) == shape
    except (AttributeError, LookupError, GranphonError):
        # a network has other attributes and conditions, and no contact law
        return False


def _find_slope(
    find: Callable[[Any], ArrayLike], course: Course[Any], name: str, shape: tuple[int, ...]
) -> Array:
    """Return the derivative of what ``find`` returns, an array of this ``shape``, along the
    ``course`` of the parameter called ``name``; InputError if ``find`` returns another shape, or
    takes no changed state.
    """

    def find_shaped(state: Any) -> Array:
        """Return what ``find`` returns of a ``state``, (...); InputError if the shape is not
        ``shape``, or if ``find`` does not take the ``state``.
        """
        try:
            value = real_array("what find returns", find(state))
        except (AttributeError, LookupError) as error:
            # find has taken the first state: the changed one is of another class
            mend = "Use what both have, or name other parameters"
            raise InputError(f"find fails where {name} is changed: {error}", mend=mend) from None
        if value.shape != shape:
            fault = f"find returns the shape {shape}, and {value.shape} where {name} is changed"
            raise InputError(f"{fault} by {course.step:g}", mend="Return as many of every state")
        return value

    return np.asarray(course.differentiate(find_shaped))


def read_load(load: Mapping[str, Any]) -> Load:
    """Return the load whose kind and value the one entry of ``load`` gives; InputError for no
    entry, several entries or several values.
    """
    if not load:
        raise InputError("there is no load", mend="Give one by its kind, as force=18.4")
    applied = Load.only(**load)
    if applied.size != 1:
        kind = applied.kind
        raise InputError(f"{kind} has {applied.size} values", mend=f"Give one {kind} at a time")
    return applied


def list_parameters(
    balls: Packing | Arrangement, load: Load, candidates: Sequence[str] | None = None
) -> tuple[str, ...]:
    """Return the names of the parameters of ``balls`` that are numbers other than zero and may
    change while all others stay, and last the kind of the ``load``. The diameter of a kind may not
    change alone if its balls would then miss others. The parameters are among the ``candidates``,
    by default all that :func:`name_parameters` names.
    """
    all_candidates = name_parameters(balls) if candidates is None else candidates
    return (*(name for name in all_candidates if _may_change(balls, name)), load.kind)


def name_parameters(balls: Balls, kinds_of_walls: Collection[str] = ()) -> tuple[str, ...]:
    """Return the names of the parameters of ``balls`` that may be numbers, no two of which change
    the same number. Those of a packing have plain names, "density". Those of an arrangement are
    the names of :meth:`Arrangement.list_own_parameters`, such as "A.density" of a kind.
    ``kinds_of_walls`` are kinds after whose materials further walls of an arrangement are made,
    such as that of a half space.
    """
    if isinstance(balls, Arrangement):
        return balls.list_own_parameters(kinds_of_walls)
    return ("young_modulus", "poisson_ratio", "density", "diameter", "width", "torsion", "bending")


def _may_change(balls: Packing | Arrangement, name: str) -> bool:
    """Return whether the parameter called ``name`` is a number other than zero, and ``balls`` may
    have the parameter larger and smaller by the part :data:`_REACH` while all others stay.
    """
    try:
        number = read_number(balls, name)
        if number == 0.0:
            return False
        for change in (-_REACH, _REACH):
            change_packing(balls, {name: (1.0 + change) * number})
    except InputError:
        return False
    return True


def read_number(balls: Packing | Arrangement, name: str) -> float:
    """Return the value of the parameter called ``name``, SI; InputError if the ``balls`` do not
    have the parameter, or if the value is no number.
    """
    value = _read_value(balls, name)
    if isinstance(value, bool) or not isinstance(value, float | int):
        problem = f"the parameter {name!r} is {brief(value)}, no number"
        raise InputError(problem, mend="Leave it out")
    return value


def _read_value(balls: Packing | Arrangement, name: str) -> Any:
    """Return the value of the attribute called ``name`` of the ``balls`` or of their material, SI,
    which may be no parameter and no number; InputError if neither has the attribute.
    """
    if isinstance(balls, Arrangement):
        return balls.read(name)
    for candidate in (balls, balls.material):
        if hasattr(candidate, name):
            return getattr(candidate, name)
    mend = "Use a name of a sweep, the kind of the load, or mindlin_ratio"
    raise InputError(f"the balls have no parameter {brief(name)}", mend=mend)
