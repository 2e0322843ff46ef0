"""The search for the best network from several starts: the networks that variables make, and the
descent from each start.

A search goes down exact derivatives: by limited-memory BFGS within bounds, by sequential quadratic
programming where sums are kept, and by Levenberg and Marquardt's least squares within a trust
region where frequencies are matched (all of SciPy). Each start is found from the seed and its
number alone, so that starts may be searched anywhere and in any order.
"""

from __future__ import annotations

import warnings
from collections.abc import Callable, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, fields
from typing import Any, NamedTuple, Self

import numpy as np

from granphon.base.arrays import Array
from granphon.base.errors import GranphonError, InputError, brief, one_line
from granphon.base.text import counted
from granphon.base.validation import finite_array, one_of, whole_number
from granphon.dynamics.sensitivities import Sensitivities
from granphon.inverse.variables import RESTARTS, SEED, STEPS, Variables, about, find_outside
from granphon.networks.network import ContactNetwork, given_network

#: relative change of the goal, and of variables, at which a search ends
_TOLERANCE = 1e-12
#: derivative by a variable, times its range, over the largest, up to which the goal does not depend
#: on it
_NO_EFFECT = 1e-12
#: step of differences by the parameters of a function, over their value; and the least value that
#: counts, over the range, as of a parameter that may be zero: below it rounding would
_STEP = 1e-5
_LEAST_VALUE = 1e-4
#: distance of a start from its bounds, over their range, where a search needs one
_INSIDE = 1e-6
#: names of the derivatives that a goal may return
_DERIVATIVES = tuple(field.name for field in fields(Sensitivities))
#: most variables that a message names
_NAMED = 6


@dataclass(frozen=True)
class Numbers(Variables):
    """Numbers of the balls and contacts of a network."""

    def differentiate(self, find: Callable[..., Any], values: Array) -> tuple[Any, Array]:
        """Return what ``find`` gives of a network, and its exact derivatives (..., n)."""
        network = self.make_network(values)
        value, slopes = _read_goal(find(network))
        return value, self.chain(network, slopes)


@dataclass(frozen=True)
class Parameters:
    """Parameters of a function that makes a network, as a load of its statics.

    Attributes
    ----------
    make : function of values (n,), SI, that returns a network, or what has one.
    labels : what each parameter is called.
    low, high, start : (n,) SI.
    """

    make: Callable[[Array], Any]
    labels: Sequence[str]
    low: Array
    high: Array
    start: Array

    def __post_init__(self) -> None:
        """Raise InputError for a start outside of its bounds."""
        outside = find_outside(self)
        if outside:
            raise InputError(outside[min(outside)], mend="Widen the bounds, or start elsewhere")

    def make_network(self, values: Array) -> ContactNetwork:
        """Return the network of values (n,) of the parameters."""
        with about("vary"):
            return given_network(self.make(values))

    def differentiate(self, find: Callable[..., Any], values: Array) -> tuple[Any, Array]:
        """Return what ``find`` gives of a network, and its derivatives (..., n), by differences
        through the statics, within the bounds.
        """
        value, _ = _read_goal(find(self.make_network(values)))
        columns = []
        span = self.high - self.low
        steps = _STEP * np.clip(np.abs(values), _LEAST_VALUE * span, span)
        for number, step in enumerate(steps.tolist()):
            ends = []
            for sign in (1.0, -1.0):
                shifted = values.copy()
                shifted[number] += sign * step
                shifted = np.clip(shifted, self.low, self.high)
                ends.append((shifted[number], _read_goal(find(self.make_network(shifted)))[0]))
            (high, above), (low, below) = ends
            columns.append((above - below) / (high - low))
        return value, np.stack(columns, axis=-1)


def _read_goal(found: Any) -> tuple[Array, Mapping[str, Any]]:
    """Return the value that a goal has ``found``, and its derivatives; InputError for anything but
    finite numbers and a mapping, as a goal of a user may return.
    """
    is_pair = isinstance(found, Sequence) and len(found) == 2 and isinstance(found[1], Mapping)
    if not is_pair:
        mend = 'Return a number and its derivatives by name, as value, {"mass": slopes}'
        raise InputError(f"the goal returns {brief(found)}", mend=mend)
    for name in found[1]:
        one_of("the derivatives of the goal", name, _DERIVATIVES)
    return finite_array("the value of the goal", found[0]), found[1]


#: networks by the values of variables
Space = Numbers | Parameters


class Found(NamedTuple):
    """What a search from one start has found.

    Attributes
    ----------
    history : (h,) the goal at each evaluation.
    best : (n,) the variables where it is best, SI.
    stopped : why the search ended early, or nothing.
    """

    history: Array
    best: Array
    stopped: str = ""


@dataclass(frozen=True)
class Problem:
    """A goal, and the networks among which the best is sought.

    Attributes
    ----------
    space : the networks.
    goals : of these start number s has the one of number s, in turn: gaps at several numbers of
        branches.
    sums : weights (n,) and total of each sum that is kept.
    count : number of starts, the first of which is the given network.
    seed : of the others.
    steps : most steps of a start.
    """

    space: Space
    goals: Sequence[Any]
    sums: Sequence[tuple[Array, float]]
    count: int
    seed: int
    steps: int

    @classmethod
    def of(
        cls,
        space: Space,
        goal: Any,
        sums: Sequence[tuple[Array, float]] = (),
        *,
        restarts: int = RESTARTS,
        seed: int = SEED,
        steps: int = STEPS,
    ) -> Self:
        """Return a problem; InputError for anything that is no goal, and what a gap raises where
        there is none.
        """
        count = 1 + whole_number("restarts", restarts, 0)
        most = whole_number("steps", steps, 1)
        whole_seed = whole_number("seed", seed, 0)
        has_value = callable(getattr(goal, "evaluate", None)) and hasattr(goal, "largest")
        if isinstance(goal, type) or not has_value:
            mend = "Give gp.WidestGap(), or an object with largest and evaluate"
            raise InputError(f"the goal is {brief(goal)}", mend=mend)
        goals = [goal]
        if hasattr(goal, "choose"):
            network = space.make_network(space.start)
            with about("goal"):
                goals = goal.choose(network, count)
        return cls(space, goals, sums, count, whole_seed, most)

    @property
    def start_value(self) -> float:
        """The goal at the given network, as the search sees it; InputError unless it is one
        number.
        """
        value, _ = _read_goal(self.goals[0].evaluate(self.space.make_network(self.space.start)))
        if np.ndim(value):
            raise InputError(f"the value of the goal is {brief(value)}", mend="Return one number")
        return float(value)

    def judge_effects(self) -> list[str]:
        """Return a sentence that names the variables without an effect, or none; InputError if none
        of them has one.

        A variable may have no effect at one place only: two are tried, of which the second may have
        no value.
        """
        space = self.space
        goal = self.goals[0]
        with about("goal"):
            value, slope = space.differentiate(goal.evaluate, space.start)
            if np.ndim(value):
                fault = f"the value of the goal is {brief(value)}"
                raise InputError(fault, mend="Return one number")
        sizes = np.abs(slope)
        with suppress(GranphonError):
            _, slope = space.differentiate(goal.evaluate, self._draw_start(0))
            sizes = np.maximum(sizes, np.abs(slope))
        sizes = sizes * (space.high - space.low)
        largest = float(np.max(sizes))
        if not largest > 0.0:
            first = ", ".join(space.labels[:_NAMED])
            fault = f"the goal depends on none of the variables: {first}"
            with about("vary"):
                raise InputError(fault, mend="Vary others")
        idle = np.flatnonzero(sizes <= _NO_EFFECT * largest)
        if not idle.size:
            return []
        named = ", ".join(space.labels[number] for number in idle[:_NAMED].tolist())
        ending = f" and {idle.size - _NAMED} more" if idle.size > _NAMED else ""
        return [f"the goal does not depend on {counted(idle.size, 'variable')}: {named}{ending}"]

    def _draw_start(self, number: int) -> Array:
        """Return a random place (n,) within the bounds, that of the start of a number from 1; 0 is
        another place.
        """
        random = np.random.default_rng((self.seed, number))
        return random.uniform(self.space.low, self.space.high)

    def find_goal(self, number: int) -> Any:
        """Return the goal of the start of a number."""
        return self.goals[number % len(self.goals)]

    def search(self, number: int) -> Found:
        """Search from the start of a number, of which 0 is the given network.

        What is met before a network has no value, as one that is not stable, is kept; of the given
        network the error is raised.
        """
        start = self._draw_start(number) if number else self.space.start
        search = _Search(self.space, self.find_goal(number), self.sums)
        search.run(start, self.steps, must_start=not number)
        return Found(np.array(search.history), search.best, search.stopped)


class _Stopped(Exception):
    """The network of a search has no value."""


class _Search:
    """A search from one start; variables are over their largest magnitudes.

    Attributes
    ----------
    history : the goal at each evaluation.
    least, best : the least goal, or the least of its negative, and the variables there.
    stopped : why the search ended early, or nothing.
    """

    def __init__(self, space: Space, goal: Any, sums: Sequence[tuple[Array, float]]) -> None:
        self.space = space
        self.goal = goal
        self.sums = sums
        self.sign = -1.0 if goal.largest else 1.0
        self.history: list[float] = []
        self.least = np.inf
        self.best = space.start
        self.stopped = ""
        self._size = 0.0
        self._scale = np.maximum(np.abs(space.low), np.abs(space.high))
        self._low = space.low / self._scale
        self._high = space.high / self._scale

    def run(self, start: Array, steps: int, must_start: bool) -> None:
        """Search from a ``start`` (n,), SI, with at most so many ``steps``.

        What is met before a network has no value, as one that is not stable, is kept; unless the
        search ``must_start``: the error at its start is raised then.
        """
        try:
            if hasattr(self.goal, "find_residuals") and not self.sums:
                self._match(start, steps)
            else:
                self._descend(start, steps)
        except _Stopped as stop:
            if must_start and not self.history and stop.__cause__ is not None:
                raise stop.__cause__ from None
            self.stopped = str(stop)

    def _differentiate(self, find: Callable[..., Any], u: Array) -> tuple[Any, Array]:
        """Return a value and its derivatives by the variables u (n,), over their magnitudes."""
        scale = self._scale
        values = np.clip(u * scale, self.space.low, self.space.high)
        try:
            value, slope = self.space.differentiate(find, values)
        except GranphonError as error:
            raise _Stopped(one_line(str(error))) from error
        return value, slope * scale

    def _record(self, value: float, u: Array) -> None:
        """Keep the goal's ``value`` at u (n,)."""
        self.history.append(value)
        if self.sign * value < self.least:
            self.least = self.sign * value
            self.best = np.clip(u * self._scale, self.space.low, self.space.high)

    def _evaluate(self, u: Array) -> tuple[float, Array]:
        """Return what is made least, of the size of one, and its derivatives (n,)."""
        value, slope = self._differentiate(self.goal.evaluate, u)
        self._record(float(value), u)
        if not self._size:
            self._size = max(abs(float(value)), float(np.max(np.abs(slope)))) or 1.0
        return self.sign * value / self._size, self.sign * slope / self._size

    def _descend(self, start: Array, steps: int) -> None:
        from scipy.optimize import LinearConstraint, minimize

        constraints = [
            LinearConstraint(weights * self._scale / total, 1.0, 1.0)
            for weights, total in self.sums
        ]
        search: Any = minimize
        with warnings.catch_warnings():
            # older versions of SciPy step out of the bounds by rounding, and clip the step
            warnings.filterwarnings("ignore", "Values in x were outside bounds", RuntimeWarning)
            search(
                self._evaluate,
                start / self._scale,
                jac=True,
                bounds=list(zip(self._low, self._high, strict=True)),
                method="SLSQP" if constraints else "L-BFGS-B",
                constraints=constraints,
                options={"maxiter": steps, "ftol": _TOLERANCE},
            )

    def _match(self, start: Array, steps: int) -> None:
        from scipy.optimize import least_squares

        margin = _INSIDE * (self._high - self._low)
        jacobian: dict[bytes, Array] = {}

        def find(u: Array) -> Array:
            residuals, slope = self._differentiate(self.goal.find_residuals, u)
            jacobian[u.tobytes()] = slope
            self._record(float(residuals @ residuals), u)
            return np.asarray(residuals)

        def find_jacobian(u: Array) -> Array:
            return jacobian[u.tobytes()]

        least_squares(
            find,
            np.clip(start / self._scale, self._low + margin, self._high - margin),
            jac=find_jacobian,
            bounds=(self._low, self._high),
            max_nfev=steps,
            ftol=_TOLERANCE,
            xtol=_TOLERANCE,
            gtol=_TOLERANCE,
        )
