"""The network, of those within bounds, that is best for a goal.

The search goes down exact derivatives: by limited-memory BFGS within bounds, by sequential
quadratic programming where sums are kept, and by Levenberg and Marquardt's least squares within a
trust region where frequencies are matched (all of SciPy). It begins at the given network, then at
random ones, and keeps the best that it meets.
"""

from __future__ import annotations

import warnings
from collections.abc import Callable, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, fields
from typing import Any

import numpy as np

from granphon.base.arrays import Array
from granphon.base.errors import GranphonError, InputError, brief, one_line
from granphon.base.progress import Progress, silent
from granphon.base.results import Result, held, result_class
from granphon.base.text import counted
from granphon.base.validation import finite_array, one_of, texts, whole_number
from granphon.dynamics.sensitivities import Sensitivities
from granphon.inverse.goals import Goal
from granphon.inverse.variables import Variables, read_bounds
from granphon.networks.network import ContactNetwork, given_network

#: relative change of the goal, and of variables, at which a search ends
_TOLERANCE = 1e-12
#: derivative by a variable, times its range, over the largest, up to which the goal does not depend
#: on it
_NO_EFFECT = 1e-12
#: step of differences by the parameters of a function, over their range
_STEP = 1e-5
#: distance of a start from its bounds, over their range, where a search needs one
_INSIDE = 1e-6
#: names of the derivatives that a goal may return
_DERIVATIVES = tuple(field.name for field in fields(Sensitivities))
#: most variables that a message names
_NAMED = 6


@result_class
class Design(Result):
    """The best network that a search has met.

    Attributes
    ----------
    network : the network.
    value : the goal of it, in ``unit``: of a gap its width on a mesh four times finer than that of
        the search, which is the certificate; 0 if it is closed there.
    unit : of the value.
    history : (h,) the goal at each evaluation of the best start, smooth where the goal is.
    variables : (n,) the values of the variables, SI.
    labels : (n,) what they are called.
    evaluations : number of evaluations of all starts.
    warnings : one sentence for each thing that went another way than was asked for.
    """

    network: ContactNetwork = held(ContactNetwork, repr=False)
    value: float = held(float)
    unit: str = held(str)
    history: Array = held(float, "h")
    variables: Array = held(float, "n")
    labels: tuple[str, ...] = held((str, ...))
    evaluations: int = held(int)
    warnings: tuple[str, ...] = held((str, ...), default=())


@dataclass(frozen=True)
class _Numbers(Variables):
    """Numbers of the balls and contacts of a network."""

    def differentiate(self, find: Callable[..., Any], values: Array) -> tuple[Any, Array]:
        """Return what ``find`` gives of a network, and its exact derivatives (..., n)."""
        network = self.make_network(values)
        value, slopes = _read_goal(find(network))
        return value, self.chain(network, slopes)


@dataclass(frozen=True)
class _Parameters:
    """Parameters of a function that makes a network, as a load of its statics."""

    make: Callable[..., Any]
    names: tuple[str, ...]
    low: Array
    high: Array
    start: Array

    @property
    def labels(self) -> list[str]:
        """What each variable is called."""
        return list(self.names)

    def make_network(self, values: Array) -> ContactNetwork:
        """Return the network of values (n,) of the parameters."""
        return given_network(self.make(**dict(zip(self.names, values.tolist(), strict=True))))

    def differentiate(self, find: Callable[..., Any], values: Array) -> tuple[Any, Array]:
        """Return what ``find`` gives of a network, and its derivatives (..., n), by differences
        through the statics, within the bounds.
        """
        value, _ = _read_goal(find(self.make_network(values)))
        columns = []
        for number, step in enumerate((_STEP * (self.high - self.low)).tolist()):
            upper = values.copy()
            upper[number] = min(values[number] + step, self.high[number])
            lower = values.copy()
            lower[number] = max(values[number] - step, self.low[number])
            above, _ = _read_goal(find(self.make_network(upper)))
            below, _ = _read_goal(find(self.make_network(lower)))
            columns.append((above - below) / (upper[number] - lower[number]))
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
_Space = _Numbers | _Parameters


def design(
    x: Any,
    goal: Goal,
    vary: Any = "mass",
    bounds: Any = None,
    constraints: Mapping[str, float] | None = None,
    *,
    per: str = "each",
    restarts: int = 2,
    seed: int = 0,
    steps: int = 200,
    progress: Progress = silent,
) -> Design:
    """Return the network whose goal is best, of those whose numbers are within bounds.

    Parameters
    ----------
    x : a network, or what has one; or a function of keywords, the names in ``vary``, that returns
        one, as ``lambda force: crystal.at_force(force)``.
    goal : :class:`~granphon.WidestGap`, :class:`~granphon.MatchFrequencies`,
        :class:`~granphon.LowestVelocity`, :class:`~granphon.ResponseAt`, or an object of your own
        with ``largest`` and ``evaluate``, see :class:`~granphon.inverse.goals.Goal`.
    vary : one name or several: "mass" (kg, with the moment of inertia in proportion), "inertia",
        "stiffness" (N/m of the normal stiffness, all others of the contact in proportion),
        "normal_stiffness", "shear_stiffness" (N/m), "torsion", "bending" (N m).
    bounds : (low, high) of each variable, in SI; of several names a mapping.
    constraints : {name: sum}, the sum over all balls or contacts that a name keeps, SI.
    per : "each" ball or contact has a variable of its own, or each "kind" (pair of kinds).
    restarts : number of random starts after the given network.
    seed : of these.
    steps : most steps of a start.
    progress : told how many starts are over.

    Raises
    ------
    InputError : unknown names, bounds that exclude the network or a sum, and a goal that depends on
        none of the variables. Variables without an effect are named in ``warnings``, as is a goal
        that is not reached.
    """
    space: _Space
    if callable(x) and not hasattr(x, "network"):
        space = _read_parameters(x, vary, bounds)
        sums = []
        if constraints:
            raise InputError("a function of parameters has no sums", mend="Leave constraints out")
    else:
        numbers = _Numbers.of(given_network(x), vary, bounds, per)
        sums = numbers.read_sums(constraints)
        space = numbers
    count = 1 + whole_number("restarts", restarts, 0)
    n_steps = whole_number("steps", steps, 1)
    random = np.random.default_rng(whole_number("seed", seed, 0))
    has_value = callable(getattr(goal, "evaluate", None)) and hasattr(goal, "largest")
    if isinstance(goal, type) or not has_value:
        mend = "Give gp.WidestGap(), or an object with largest and evaluate"
        raise InputError(f"the goal is {brief(goal)}", mend=mend)
    choose: Any = getattr(goal, "choose", lambda network, most: [goal])
    goals = choose(space.make_network(space.start), count)
    warnings = _judge_effects(space, goals[0], random)
    searches = []
    with progress.step("design", total=count) as step:
        for number in range(count):
            start = space.start if number == 0 else random.uniform(space.low, space.high)
            search = _Search(space, goals[number % len(goals)], sums)
            search.run(start, n_steps, must_start=number == 0)
            searches.append(search)
            step.advance()
    best = min((search for search in searches if search.history), key=lambda one: one.least)
    return _finish(space, best, sum(len(search.history) for search in searches), warnings)


def _read_parameters(make: Callable[..., Any], vary: Any, bounds: Any) -> _Parameters:
    """Return the parameters of a function that makes networks; the search begins in the middle of
    their bounds.
    """
    names = texts("vary", vary)
    if not names or len(set(names)) < len(names):
        mend = "Name keywords of the function, each once"
        raise InputError(f"vary is {brief(vary)}", mend=mend)
    pairs = np.array([read_bounds(name, bounds, names) for name in names])
    return _Parameters(make, names, pairs[:, 0], pairs[:, 1], pairs.mean(axis=1))


def _judge_effects(space: _Space, goal: Goal, random: np.random.Generator) -> list[str]:
    """Return a sentence that names the variables without an effect, or none; InputError if none of
    them has one.

    A variable may have no effect at one place only: two are tried, of which the second may have no
    value.
    """
    value, slope = space.differentiate(goal.evaluate, space.start)
    if np.ndim(value):
        raise InputError(f"the value of the goal is {brief(value)}", mend="Return one number")
    sizes = np.abs(slope)
    with suppress(GranphonError):
        _, slope = space.differentiate(goal.evaluate, random.uniform(space.low, space.high))
        sizes = np.maximum(sizes, np.abs(slope))
    sizes = sizes * (space.high - space.low)
    largest = float(np.max(sizes))
    if not largest > 0.0:
        first = ", ".join(space.labels[:_NAMED])
        raise InputError(f"the goal depends on none of the variables: {first}", mend="Vary others")
    idle = np.flatnonzero(sizes <= _NO_EFFECT * largest)
    if not idle.size:
        return []
    named = ", ".join(space.labels[number] for number in idle[:_NAMED].tolist())
    ending = f" and {idle.size - _NAMED} more" if idle.size > _NAMED else ""
    return [f"the goal does not depend on {counted(idle.size, 'variable')}: {named}{ending}"]


class _Stopped(Exception):
    """The network of a search has no value."""


class _Search:
    """A search from one start; variables are over their largest values.

    Attributes
    ----------
    history : the goal at each evaluation.
    least, best : the least goal, or the least of its negative, and the variables there.
    stopped : why the search ended early, or nothing.
    """

    def __init__(self, space: _Space, goal: Any, sums: list[tuple[Array, float]]) -> None:
        """Set up a search in a ``space`` of variables for a ``goal``; ``sums`` are weights (n,) of
        variables, each with the sum that the weighted variables keep.
        """
        self.space = space
        self.goal = goal
        self.sums = sums
        self.sign = -1.0 if goal.largest else 1.0
        self.history: list[float] = []
        self.least = np.inf
        self.best = space.start
        self.stopped = ""
        self._size = 0.0

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
        """Return a value and its derivatives by the variables u (n,), over their largest values."""
        scale = self.space.high
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
            self.best = np.clip(u * self.space.high, self.space.low, self.space.high)

    def _evaluate(self, u: Array) -> tuple[float, Array]:
        """Return the number that is made least, at the variables u (n,), and its derivatives (n,):
        the goal or its negative, over its size at the start, so that it is of the order of one.
        """
        value, slope = self._differentiate(self.goal.evaluate, u)
        self._record(float(value), u)
        if not self._size:
            self._size = max(abs(float(value)), float(np.max(np.abs(slope)))) or 1.0
        factor = self.sign / self._size
        return factor * value, factor * slope

    def _descend(self, start: Array, steps: int) -> None:
        """Search for the least value of the goal from a ``start`` (n,), SI, with at most so many
        ``steps``, within the bounds and at the given sums of variables.
        """
        from scipy.optimize import LinearConstraint, minimize

        scale = self.space.high
        constraints = [
            LinearConstraint(weights * scale / total, 1.0, 1.0) for weights, total in self.sums
        ]
        search: Any = minimize
        with warnings.catch_warnings():
            # older versions of SciPy step out of the bounds by rounding, and clip the step
            warnings.filterwarnings("ignore", "Values in x were outside bounds", RuntimeWarning)
            search(
                self._evaluate,
                start / scale,
                jac=True,
                bounds=list(zip(self.space.low / scale, np.ones(len(scale)), strict=True)),
                method="SLSQP" if constraints else "L-BFGS-B",
                constraints=constraints,
                options={"maxiter": steps, "ftol": _TOLERANCE},
            )

    def _match(self, start: Array, steps: int) -> None:
        """Search for least squares of the residuals of the goal from a ``start`` (n,), SI, with at
        most so many evaluations, ``steps``.
        """
        from scipy.optimize import least_squares

        low = self.space.low / self.space.high
        margin = _INSIDE * (1.0 - low)
        # the derivatives, which are found with the residuals, by the bytes of the variables
        jacobians: dict[bytes, Array] = {}

        def find_residuals(u: Array) -> Array:
            """Return the residuals at the variables u (n,), and keep their derivatives."""
            residuals, jacobian = self._differentiate(self.goal.find_residuals, u)
            jacobians[u.tobytes()] = jacobian
            self._record(float(residuals @ residuals), u)
            return np.asarray(residuals)

        def find_jacobian(u: Array) -> Array:
            """Return the derivatives that were kept with the residuals at u (n,)."""
            return jacobians[u.tobytes()]

        least_squares(
            find_residuals,
            np.clip(start / self.space.high, low + margin, 1.0 - margin),
            jac=find_jacobian,
            bounds=(low, np.ones(len(low))),
            max_nfev=steps,
            ftol=_TOLERANCE,
            xtol=_TOLERANCE,
            gtol=_TOLERANCE,
        )


def _finish(space: _Space, best: _Search, evaluations: int, warnings: list[str]) -> Design:
    """Return the design of the ``best`` of several searches in a ``space``, with the number of
    their ``evaluations``, and with the ``warnings`` so far and its own.

    A goal that can ``certify`` finds its value anew, without what made it smooth in the search; one
    that can ``judge`` says in a sentence what is wrong with a value, if anything is.
    """
    goal = best.goal
    network = space.make_network(best.best)
    value = best.sign * best.least
    if hasattr(goal, "certify"):
        value = float(goal.certify(network))
    all_warnings = list(warnings)
    if best.stopped:
        all_warnings.append(f"the search ended early, and its best is kept: {best.stopped}")
    if hasattr(goal, "judge"):
        verdict = goal.judge(network, value)
        if verdict:
            all_warnings.append(verdict)
    return Design(
        network=network,
        value=value,
        unit=getattr(goal, "unit", ""),
        history=np.array(best.history),
        variables=best.best,
        labels=tuple(space.labels),
        evaluations=evaluations,
        warnings=tuple(all_warnings),
    )
