"""The search for the best network from several starts: the networks that variables make, and the
descent from each start.

A search follows the exact derivatives of the goal, by a method of SciPy: limited-memory BFGS within
bounds; sequential quadratic programming where sums are kept; and least squares within a trust
region where the goal has residuals, as that of matched frequencies, and no sums are kept. The place
of each start follows from the seed and the number of the start alone, so that searches may be run
anywhere and in any order.
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
#: step of differences by a parameter of a function, over the value of the parameter, or over its
#: range if that is smaller
_STEP = 1e-5
#: least value by which such a step is measured, over the range of the parameter: with a smaller
#: step, as of a parameter that is zero, differences would be rounding
_LEAST_VALUE = 1e-4
#: distance of a start from its bounds, over their range, for least squares: SciPy begins only at a
#: place strictly inside of the bounds
_MARGIN = 1e-6
#: names of the derivatives that a goal may return
_DERIVATIVES = tuple(field.name for field in fields(Sensitivities))
#: distance of a sum from its total, over the greatest sum within the bounds, that is rounding
_ROUNDING = 1e-9
#: most variables that a message names
_MOST_NAMED = 6


@dataclass(frozen=True)
class Numbers(Variables):
    """Variables that are numbers of the balls and contacts of a network."""

    def differentiate(self, find: Callable[..., Any], values: Array) -> tuple[Any, Array]:
        """Return the value that ``find`` has at the network of these ``values`` (n,), SI, a number
        or (m,), and its exact derivatives by the variables, (n,) or (m, n).

        ``find(network)`` returns the value and its derivatives, as ``evaluate`` of a
        :class:`~granphon.inverse.goals.Goal`; InputError if it returns anything else, or
        derivatives of another shape.
        """
        network = self.make_network(values)
        value, slopes = _read_goal(find(network))
        return value, self.chain(network, slopes, np.shape(value))


@dataclass(frozen=True)
class Parameters:
    """Parameters of a function that makes a network, as a load of its statics.

    Attributes
    ----------
    make : function of values (n,), SI, that returns a network, or a state or sample that has one.
    labels : (n,) the name of each parameter.
    low, high, start : (n,) least and greatest values, and those at which the search begins, SI.
    """

    make: Callable[[Array], Any]
    labels: Sequence[str]
    low: Array
    high: Array
    start: Array

    def __post_init__(self) -> None:
        """Raise InputError for a start outside of its bounds."""
        clauses = find_outside(self)
        if clauses:
            raise InputError(clauses[min(clauses)], mend="Widen the bounds, or start elsewhere")

    def make_network(self, values: Array) -> ContactNetwork:
        """Return the network of ``values`` (n,) of the parameters, SI; InputError if the function
        returns nothing that has one.
        """
        with about("vary"):
            return given_network(self.make(values))

    def differentiate(self, find: Callable[..., Any], values: Array) -> tuple[Any, Array]:
        """Return the value that ``find`` has at the network of these ``values`` (n,), SI, a number
        or (m,), and its derivatives by the parameters, (n,) or (m, n).

        The derivatives are differences between networks that ``make`` makes anew, with a step of
        :data:`_STEP` up and down; a step that would pass a bound ends there, so that differences
        are lopsided near a bound and one-sided at it. ``find`` is that of
        :meth:`Numbers.differentiate`; the derivatives that it gives are those by the numbers of a
        network, and are not used.
        """
        value, _slopes = _read_goal(find(self.make_network(values)))
        columns = []
        span = self.high - self.low
        steps = _STEP * np.clip(np.abs(values), _LEAST_VALUE * span, span)
        for number, step in enumerate(steps.tolist()):
            ends = []
            for sign in (1.0, -1.0):
                shifted_values = values.copy()
                shifted_values[number] += sign * step
                shifted_values = np.clip(shifted_values, self.low, self.high)
                shifted_value, _slopes = _read_goal(find(self.make_network(shifted_values)))
                ends.append((shifted_values[number], shifted_value))
            (upper_end, value_above), (lower_end, value_below) = ends
            columns.append((value_above - value_below) / (upper_end - lower_end))
        return value, np.stack(columns, axis=-1)


def _read_goal(answer: Any) -> tuple[Array, Mapping[str, Any]]:
    """Return the value of a goal, a number or (m,), and its derivatives by name from the ``answer``
    that the goal gives.

    A user's own goal may give anything: InputError unless the answer is a pair, of a finite number
    or finite numbers (m,) and of a mapping of known names.
    """
    is_pair = isinstance(answer, Sequence) and len(answer) == 2 and isinstance(answer[1], Mapping)
    if not is_pair:
        mend = 'Return a number and its derivatives by name, as value, {"mass": slopes}'
        raise InputError(f"the goal returns {brief(answer)}", mend=mend)
    value, slopes = answer
    for name in slopes:
        one_of("the derivatives of the goal", name, _DERIVATIVES)
    values = finite_array("the value of the goal", value)
    if np.ndim(values) > 1:
        raise InputError(
            f"the value of the goal has the shape {np.shape(values)}",
            mend="Return one number, or a list of numbers",
        )
    return values, slopes


def _require_one_number(value: Array) -> float:
    """Return the ``value`` of a goal; InputError if it is an array of numbers."""
    if np.ndim(value):
        raise InputError(f"the value of the goal is {brief(value)}", mend="Return one number")
    return float(value)


def _is_match(goal: Any, sums: Sequence[tuple[Array, float]]) -> bool:
    """Whether the search for a ``goal`` is a match by least squares: the goal has residuals, and no
    ``sums`` are kept, which least squares cannot keep.
    """
    return hasattr(goal, "find_residuals") and not sums


#: networks by the values of variables
Space = Numbers | Parameters


class SearchOutcome(NamedTuple):
    """What a search from one start has found.

    Attributes
    ----------
    history : (h,) the goal's value at each evaluation.
    best : (n,) the variables at which the value was best, SI.
    stopped : why the search ended early; "" if it did not.
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
    goals : one goal; or several, gaps above different numbers of branches, which the starts take
        in turn.
    sums : weights (n,) and total of each sum over the variables that is kept.
    count : number of starts; start 0 is the given network, and the others are random. All are moved
        onto the sums, see :meth:`search`.
    seed : of the random starts.
    steps : most steps of the search from each start.
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
        """Return a problem with ``restarts`` random starts after the given network, whose ``space``
        and ``sums`` are those of the attributes.

        A goal that has to be chosen, as a gap, is replaced by several with fixed numbers of
        branches, at most one for each start. InputError for an object that is no goal, where the
        network has no such gap, and for ``restarts``, a ``seed`` or ``steps`` that are no whole
        numbers or too small.
        """
        count = 1 + whole_number("restarts", restarts, 0)
        most_steps = whole_number("steps", steps, 1)
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
        return cls(space, goals, sums, count, whole_seed, most_steps)

    @property
    def start_value(self) -> float:
        """The value of the first goal at the given network, which for a gap is its smooth width;
        InputError unless it is one number.
        """
        value, _slopes = self._evaluate(self.space.make_network(self.space.start))
        return value

    def _evaluate(self, network: ContactNetwork) -> tuple[float, Mapping[str, Any]]:
        """Return the value of the first goal at a ``network``, and its derivatives by name;
        InputError unless the value is one number.
        """
        value, slopes = _read_goal(self.goals[0].evaluate(network))
        return _require_one_number(value), slopes

    @property
    def begins_at_start(self) -> bool:
        """Whether the search from start 0 begins with the value of the given network itself: the
        network has the sums, and the search is no match, which moves off the bounds.
        """
        return self.keeps_sums(self.space.start) and not _is_match(self.goals[0], self.sums)

    def judge_effects(self) -> list[str]:
        """Return a list with one sentence, which names the variables on which the goal does not
        depend; an empty list if it depends on all. InputError if it depends on none, or if the
        value of the goal is not one number.

        The derivatives are found at the given network and at a random one, as a derivative may
        vanish at one place only; if the random network has no value, it does not count.
        """
        space = self.space
        with about("goal"):
            _value, slope = space.differentiate(self._evaluate, space.start)
        sizes = np.abs(slope)
        with suppress(GranphonError):
            _value, slope = space.differentiate(self._evaluate, self._draw_start(0))
            sizes = np.maximum(sizes, np.abs(slope))
        sizes = sizes * (space.high - space.low)
        largest_size = float(np.max(sizes))
        numbers = np.flatnonzero(sizes <= _NO_EFFECT * largest_size)
        if not numbers.size:
            return []
        names = ", ".join(space.labels[number] for number in numbers[:_MOST_NAMED].tolist())
        if numbers.size > _MOST_NAMED:
            names += f" and {numbers.size - _MOST_NAMED} more"
        if not largest_size > 0.0:
            fault = f"the goal depends on none of the variables: {names}"
            with about("vary"):
                raise InputError(fault, mend="Vary others")
        return [f"the goal does not depend on {counted(numbers.size, 'variable')}: {names}"]

    def _draw_start(self, number: int) -> Array:
        """Return random values (n,) of the variables within their bounds, SI, those at which start
        ``number`` begins, from 1 on. Start 0 begins at the given network; its random values are
        those at which :meth:`judge_effects` looks.
        """
        generator = np.random.default_rng((self.seed, number))
        return generator.uniform(self.space.low, self.space.high)

    def keeps_sums(self, values: Array) -> bool:
        """Return whether the ``values`` (n,) of the variables, SI, have the :attr:`sums`, but for
        rounding.
        """
        return all(
            abs(weights @ values - total) <= _ROUNDING * (weights @ self.space.high)
            for weights, total in self.sums
        )

    def _meet_sums(self, values: Array) -> Array:
        """Return the ``values`` (n,) of variables, SI, or, if these do not have the sums, values
        within the bounds that have them.

        The values that add up to a sum move towards their greatest values if the sum is too small,
        or else towards their least ones: each by the same fraction of its distance.
        """
        if self.keeps_sums(values):
            return values
        moved_values = values.copy()
        for weights, total in self.sums:  # no variable counts in two sums
            missing_sum = total - weights @ moved_values
            ends = self.space.high if missing_sum > 0.0 else self.space.low
            distances = np.where(weights > 0.0, ends - moved_values, 0.0)
            most_change = weights @ distances  # of the sum
            if most_change:
                moved_values += missing_sum / most_change * distances
        return moved_values

    def find_goal(self, number: int) -> Any:
        """Return the goal of the start of this ``number``."""
        return self.goals[number % len(self.goals)]

    def search(self, number: int) -> SearchOutcome:
        """Search from the start of this ``number``, and return what is found; start 0 is the given
        network. A start without the sums is first moved within the bounds until it has them, as
        only networks with the sums may be kept as the best.

        The search ends early where the goal has no value, for example at a network that is not
        stable, and what the search has found before is kept. If the goal has no value at start 0,
        the error is raised.
        """
        start = self._meet_sums(self._draw_start(number) if number else self.space.start)
        search = _Search(self.space, self.find_goal(number), self.sums)
        search.run(start, self.steps, must_start=not number)
        return SearchOutcome(np.array(search.history), search.best, search.stopped)


class _Stopped(Exception):
    """Raised, with the error as its cause, where a network that a search meets has no value."""


class _Search:
    """A search from one start. Its methods take variables u, each over the largest magnitude within
    its bounds, so that all are of the size of one.

    Attributes
    ----------
    space, goal, sums : those that are given.
    sign : -1 for a goal that is to be largest, 1 for any other.
    history : the goal's value at each evaluation.
    least : the least value so far; of a goal that is to be largest, the least of the negative.
    best : (n,) the variables with this value, SI.
    stopped : why the search ended early; "" if it did not.
    """

    def __init__(self, space: Space, goal: Any, sums: Sequence[tuple[Array, float]]) -> None:
        """Prepare a search for the best value of a ``goal`` among the networks of a ``space``;
        ``sums`` are those of :class:`Problem`.
        """
        self.space = space
        self.goal = goal
        self.sums = sums
        self.sign = -1.0 if goal.largest else 1.0
        self.history: list[float] = []
        self.least = np.inf
        self.best = space.start
        self.stopped = ""
        self._size = 0.0  # of the goal or its largest derivative, whichever is larger, at the start
        self._scale = np.maximum(np.abs(space.low), np.abs(space.high))
        self._low = space.low / self._scale
        self._high = space.high / self._scale

    def run(self, start: Array, steps: int, must_start: bool) -> None:
        """Search from a ``start`` (n,), SI, in at most so many ``steps``; set ``history``, ``best``
        and ``stopped``.

        A goal with residuals is matched by least squares (:func:`_is_match`); with sums it is
        minimised as others are. The search ends early where the goal has no value, for example at a
        network that is not stable. If that is so at the first network and the search
        ``must_start``, the error is raised.
        """
        try:
            if _is_match(self.goal, self.sums):
                self._match(start, steps)
            else:
                self._descend(start, steps)
        except _Stopped as stop:
            if must_start and not self.history and stop.__cause__ is not None:
                raise stop.__cause__ from None
            self.stopped = str(stop)

    def _differentiate(self, find: Callable[..., Any], u: Array) -> tuple[Any, Array]:
        """Return the value of ``find`` at the variables u (n,), a number or (m,), and its
        derivatives by u, (n,) or (m, n). Raises ``_Stopped`` if there is no value.
        """
        scale = self._scale
        # rounding may lead u out of the bounds
        values = np.clip(u * scale, self.space.low, self.space.high)
        try:
            value, slope = self.space.differentiate(find, values)
        except GranphonError as error:
            raise _Stopped(one_line(str(error))) from error
        return value, slope * scale

    def _record(self, value: float, u: Array) -> None:
        """Add the goal's ``value`` at u (n,) to the history, and keep it if it is the best."""
        self.history.append(value)
        if self.sign * value < self.least:
            self.least = self.sign * value
            self.best = np.clip(u * self._scale, self.space.low, self.space.high)

    def _evaluate(self, u: Array) -> tuple[float, Array]:
        """Return the function of u (n,) that is minimised, and its derivatives (n,): the goal, or
        its negative if it is to be largest, scaled to the size of one at the first evaluation.
        Records the evaluation.
        """
        goal, slope = self._differentiate(self.goal.evaluate, u)
        value = float(goal)
        self._record(value, u)
        if not self._size:
            self._size = max(abs(value), float(np.max(np.abs(slope)))) or 1.0
        return self.sign * value / self._size, self.sign * slope / self._size

    def _descend(self, start: Array, steps: int) -> None:
        """Minimise the goal, or its negative, from a ``start`` (n,), SI, in at most so many
        ``steps``: by sequential quadratic programming if sums are kept, else by L-BFGS. The
        evaluations are recorded. The ``start`` must have the sums: then the variables of all
        evaluations have them too, as steps between places with the same linear sums keep the sums.
        """
        from scipy.optimize import LinearConstraint, minimize

        # each sum is over the greatest one within the bounds: its total may be zero
        constraints = []
        for weights, total in self.sums:
            greatest_sum = float(weights @ self.space.high)
            row = weights * self._scale / greatest_sum
            constraints.append(LinearConstraint(row, total / greatest_sum, total / greatest_sum))
        minimise: Any = minimize  # the types that SciPy gives it are narrower than what it takes
        with warnings.catch_warnings():
            # older versions of SciPy step out of the bounds by rounding, and clip the step
            warnings.filterwarnings("ignore", "Values in x were outside bounds", RuntimeWarning)
            minimise(
                self._evaluate,
                start / self._scale,
                jac=True,
                bounds=list(zip(self._low, self._high, strict=True)),
                method="SLSQP" if constraints else "L-BFGS-B",
                constraints=constraints,
                options={"maxiter": steps, "ftol": _TOLERANCE},
            )

    def _match(self, start: Array, steps: int) -> None:
        """Minimise the sum of the squares of the goal's residuals from a ``start`` (n,), SI, in at
        most so many ``steps``, by least squares. The evaluations are recorded.
        """
        from scipy.optimize import least_squares

        margin = _MARGIN * (self._high - self._low)
        # SciPy asks for the residuals and their derivatives at u one after the other, and both come
        # from one evaluation
        derivatives: dict[bytes, Array] = {}

        def find_residuals(u: Array) -> Array:
            """Return the residuals (m,) at u (n,); keep their derivatives, and record their sum of
            squares.
            """
            residuals, slope = self._differentiate(self.goal.find_residuals, u)
            derivatives[u.tobytes()] = slope
            self._record(float(residuals @ residuals), u)
            return np.asarray(residuals)

        def find_jacobian(u: Array) -> Array:
            """Return the derivatives (m, n) of the residuals at u (n,)."""
            return derivatives[u.tobytes()]

        least_squares(
            find_residuals,
            np.clip(start / self._scale, self._low + margin, self._high - margin),
            jac=find_jacobian,
            bounds=(self._low, self._high),
            max_nfev=steps,
            ftol=_TOLERANCE,
            xtol=_TOLERANCE,
            gtol=_TOLERANCE,
        )
