"""The design of a network: of all networks whose numbers are within bounds, the one that is best
for a goal.

One search (:mod:`granphon.inverse.search`) begins at the given network, others begin at random
ones, and the best network that any of them meets is kept. For a goal that is a gap a certificate
decides, the gap on a finer mesh: if the gap of the best search is closed there, that of the next
best is taken.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from inspect import signature
from typing import Any, NamedTuple

import numpy as np

from granphon.base.arrays import Array
from granphon.base.errors import InputError, brief
from granphon.base.progress import Progress, require_progress, silent
from granphon.base.results import Result, held, result_class
from granphon.base.validation import one_of, texts
from granphon.inverse.goals import Goal
from granphon.inverse.search import Numbers, Parameters, Problem, SearchOutcome
from granphon.inverse.variables import PER, RESTARTS, SEED, STEPS, read_bounds
from granphon.networks.network import ContactNetwork, given_network


@result_class
class Design(Result):
    """The best network that a search has met.

    Attributes
    ----------
    network : the best network.
    value : the goal's value for this network, in ``unit``. For a gap it is the certificate: the
        width on a mesh four times finer than that of the search, 0 if the gap is closed there.
    unit : the unit of the value.
    history : (h,) the goal's value at each evaluation of the start that is kept, in ``unit``; for a
        gap its smooth width.
    variables : (n,) the values of the variables in this network, SI.
    labels : (n,) the names of the variables in messages.
    evaluations : number of evaluations of all starts.
    start, start_value, start_variables : the given network, or that of a function in the middle of
        the bounds; its goal, in ``unit``, for a gap the certificate; and its variables.
    bounds : (n, 2) the least and the greatest value of each variable.
    best_start : number of the start that is kept; 0 is the given network, others are random. Starts
        are first moved onto the sums of ``constraints``.
    starts : (s,) the best value of the goal, in ``unit``, that each start has met, of those starts
        that met a network with a value; for a gap its smooth width. If several agree, there is
        probably no better one.
    warnings : one sentence for each thing that went another way than was asked for.
    """

    network: ContactNetwork = held(ContactNetwork, repr=False)
    value: float = held(float)
    unit: str = held(str)
    history: Array = held(float, "h")
    variables: Array = held(float, "n")
    labels: tuple[str, ...] = held((str, ...))
    evaluations: int = held(int)
    start: ContactNetwork = held(ContactNetwork, repr=False)
    start_value: float = held(float)
    start_variables: Array = held(float, "n")
    bounds: Array = held(float, "n 2")
    best_start: int = held(int)
    starts: Array = held(float, "s")
    warnings: tuple[str, ...] = held((str, ...), default=())


def design(
    x: Any,
    goal: Goal,
    vary: Any = "mass",
    bounds: Any = None,
    constraints: Mapping[str, float] | None = None,
    *,
    per: str = "each",
    restarts: int = RESTARTS,
    seed: int = SEED,
    steps: int = STEPS,
    progress: Progress = silent,
) -> Design:
    """Return the best design for a goal that some searches among networks within bounds have found.

    Parameters
    ----------
    x : a network, or a state or sample that has one; or a function whose keywords are the names in
        ``vary`` and that returns one of these, as ``lambda force: crystal.at_force(force)``.
    goal : :class:`~granphon.WidestGap`, :class:`~granphon.MatchFrequencies`,
        :class:`~granphon.LowestVelocity`, :class:`~granphon.ResponseAt`, or an object of your own
        with ``largest`` and ``evaluate``, see :class:`~granphon.inverse.goals.Goal`.
    vary : one name or several: "mass" (kg, with the moment of inertia in proportion), "inertia",
        "stiffness" (N/m of the normal stiffness, all others of the contact in proportion),
        "normal_stiffness", "shear_stiffness" (N/m), "torsion", "bending" (N m), "on_site" (N/m of
        the springs to the ground against all displacements of a ball).
    bounds : needed: (low, high) of all variables of a name, SI, 0 <= low < high; of several names a
        mapping {name: (low, high)}.
    constraints : {name: sum}, SI: the values of this name, added up over all balls that move, or
        over all contacts, keep this sum. Searches begin at networks that have it: a given network,
        or a random one, that does not is changed first.
    per : "each": every ball or contact has a variable of its own. "kind": all balls of a kind, or
        all contacts of a pair of kinds, have one variable together; not for a function.
    restarts : number of searches from random starts. They follow the first search, which begins at
        the given network or, for a function, in the middle of the bounds.
    seed : of the random starts.
    steps : most steps of the search from each start.
    progress : told how many searches are over.

    The ``warnings`` of the design name variables without an effect, a goal that is not reached, and
    a gap that closes on the way.

    Raises
    ------
    InputError : an ``x`` without a network, unknown names or none, names that vary the same
        numbers, nothing in the network that has a name, no bounds or other ones than ``bounds``
        says, bounds that begin at zero where a network must be above zero, bounds that exclude the
        network or a sum, ``constraints`` of other names or that are no numbers, another ``per``,
        constraints or ``per="kind"`` with a function, a function that cannot be called with the
        names, an object that is no goal, a goal that the network does not have or
        that gives no finite numbers, a goal that depends on none of the variables, ``restarts``, a
        ``seed`` or ``steps`` that are no whole numbers or too small, and a ``progress`` without
        ``step``.
    GranphonError : the goal has no value for the given network, as one that is not stable.
    """
    require_progress(progress)
    space: Numbers | Parameters
    sums: Sequence[tuple[Array, float]] = ()
    if callable(x) and not hasattr(x, "network"):
        space = _read_parameters(x, vary, bounds)
        if constraints is not None:
            raise InputError("a function of parameters has no sums", mend="Leave constraints out")
        if one_of("per", per, PER) != PER[0]:
            raise InputError("a function of parameters has no kinds", mend="Leave per out")
    else:
        space = Numbers.of(given_network(x), vary, bounds, per)
        sums = space.read_sums(constraints)
    problem = Problem.of(space, goal, sums, restarts=restarts, seed=seed, steps=steps)
    warnings = problem.judge_effects()
    searches = []
    with progress.step("design", total=problem.count) as step:
        for number in range(problem.count):
            searches.append(problem.search(number))
            step.advance()
    return choose_best(problem, searches, warnings)


def _read_parameters(make: Any, vary: Any, bounds: Any) -> Parameters:
    """Return the parameters, named in ``vary``, of a function ``make`` of keywords that makes
    networks; the search begins in the middle of their ``bounds``, which are those of
    :func:`design`. InputError for names that are none, that are given twice, or with which the
    function cannot be called, and for bounds that
    :func:`~granphon.inverse.variables.read_bounds` refuses.
    """
    names = texts("vary", vary)
    if not names or len(set(names)) < len(names):
        mend = "Name keywords of the function, each once"
        raise InputError(f"vary is {brief(vary)}", mend=mend)
    try:
        signature(make).bind(**dict.fromkeys(names))
    except (TypeError, ValueError) as error:  # ValueError: a builtin that tells no signature
        problem = f"the function cannot be called with {', '.join(names)}: {error}"
        raise InputError(problem, mend="Name its keywords in vary") from None
    pairs = np.array([read_bounds(name, bounds, names) for name in names])

    def make_with(values: Array) -> Any:
        """Return what ``make`` returns for these values (n,) of the parameters, SI."""
        return make(**dict(zip(names, values.tolist(), strict=True)))

    return Parameters(make_with, names, pairs[:, 0], pairs[:, 1], pairs.mean(axis=1))


class _Choice(NamedTuple):
    """The network that is kept of several searches.

    Attributes
    ----------
    number : the number of its start.
    variables : (n,) the values of the variables in it, SI.
    value : the goal's value, for a gap the certificate.
    start_value : that of the given network.
    sentences : why it was kept, where that is not plain.
    """

    number: int
    variables: Array
    value: float
    start_value: float
    sentences: list[str]


def choose_best(
    problem: Problem, searches: Sequence[SearchOutcome], warnings: Sequence[str]
) -> Design:
    """Return the design whose network is the best that the searches of a ``problem`` have found.

    ``searches`` holds what each search has found, in the order of their starts, and ``warnings``
    the sentences before those of the searches. The best start is that with the best value, or, for
    a goal with certificates, the best one whose certificate holds (:func:`_choose_certified`).
    """
    space = problem.space
    sign = -1.0 if problem.goals[0].largest else 1.0
    # the best value of each start that has met a network with a value
    best_values = {
        number: sign * float(np.min(sign * search.history))
        for number, search in enumerate(searches)
        if search.history.size
    }
    order = sorted(best_values, key=lambda number: sign * best_values[number])
    start = space.make_network(space.start)
    if hasattr(problem.goals[0], "certify"):
        choice = _choose_certified(problem, searches, order, start)
    else:
        begins_at_start = problem.begins_at_start
        start_value = float(searches[0].history[0]) if begins_at_start else problem.start_value
        best = searches[order[0]].best
        choice = _Choice(order[0], best, best_values[order[0]], start_value, [])
    search = searches[choice.number]
    goal = problem.find_goal(choice.number)
    network = space.make_network(choice.variables)
    sentences = [*warnings, *choice.sentences]
    if search.stopped:
        sentences.append(f"the search ended early, and its best is kept: {search.stopped}")
    if hasattr(goal, "judge_history"):
        sentences.append(goal.judge_history(search.history, choice.value))
    if hasattr(goal, "judge"):
        sentences.append(goal.judge(network, choice.value))
    return Design(
        network=network,
        value=choice.value,
        unit=getattr(goal, "unit", ""),
        history=search.history,
        variables=choice.variables,
        labels=tuple(space.labels),
        evaluations=sum(one_search.history.size for one_search in searches),
        start=start,
        start_value=choice.start_value,
        start_variables=space.start,
        bounds=np.column_stack([space.low, space.high]),
        best_start=choice.number,
        starts=np.array([best_values[number] for number in sorted(best_values)]),
        warnings=tuple(filter(None, sentences)),  # a goal without a complaint returns ""
    )


def _choose_certified(
    problem: Problem, searches: Sequence[SearchOutcome], order: Sequence[int], start: ContactNetwork
) -> _Choice:
    """Return the network that is kept for a ``problem`` whose goal is a gap; its width, Hz, is that
    on the finer mesh.

    The ``searches`` are tried in the ``order`` of their starts: the first one is kept whose gap is
    open on the finer mesh, and no narrower than that of ``start``, the given network, if this has
    the sums that are to be kept. If there is none, that network is kept if it has these sums and an
    open gap, and else the first start of the order with the width 0.
    """
    space = problem.space
    start_value = float(problem.goals[0].certify(start))
    # a network without the sums may not be kept, however wide its gap
    least_width = start_value if problem.keeps_sums(space.start) else 0.0
    for number in order:
        variables = searches[number].best
        value = float(problem.find_goal(number).certify(space.make_network(variables)))
        if value > 0.0 and value >= least_width:
            sentences = []
            if number != order[0]:
                sentences.append(
                    "on the finer mesh the gap of a better start is closed, or narrower than that"
                    " of the given network"
                )
            return _Choice(number, variables, value, start_value, sentences)
    if least_width > 0.0:
        sentence = "no start widens the gap of the given network, which is kept"
        return _Choice(0, space.start, start_value, start_value, [sentence])
    return _Choice(order[0], searches[order[0]].best, 0.0, start_value, [])
