"""The design of a scene: the networks that its variables make, and the search for the best of them.

The variables are parameters of the scene, for each value of which its statics are solved anew, or
numbers of its network, by which the goal has exact derivatives. Each start of the search is a task,
whose result the store of a run keeps.
"""

from __future__ import annotations

import hashlib
import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

import numpy as np

from granphon.balls.loads import Load
from granphon.balls.packing import change_packing
from granphon.base.arrays import Array
from granphon.base.text import counted, list_names
from granphon.inverse.design import Design, choose_best
from granphon.inverse.goals import WidestGap
from granphon.inverse.search import Numbers, Parameters, Problem, SearchOutcome, Space
from granphon.media import cost as costs
from granphon.networks.network import ContactNetwork, given_network
from granphon.observables.parameters import read_number
from granphon.runs.execution import Task
from granphon.runs.finished_tasks import TaskResult
from granphon.runs.tasks import Case, to_json
from granphon.runs.workers import packages
from granphon.scene.design_settings import DesignSettings, find_unit_of_variable, varies_parameters

#: most unknowns that the description of a design names: they fill one line
_MOST_NAMES = 6


def _make_problem(
    case: Case, load: Load, settings: DesignSettings, has_varied_parameters: bool
) -> Problem:
    """Return the problem that the ``settings`` of a design pose. Its search starts at the network
    of the only state of ``case``.

    With ``has_varied_parameters`` parameters of the scene vary, and the load may be one of these;
    ``load`` is then the load as the file has it. Otherwise numbers of the balls and contacts of the
    network vary, and the sums that the settings give are kept; ``load`` is then not used.
    """
    space: Space
    sums: Sequence[tuple[Array, float]] = ()
    if has_varied_parameters:
        space = _make_parameters(case, load, settings)
    else:
        network = settings.shape(given_network(case.state))
        space = Numbers.of(network, settings.names, dict(settings.vary), settings.per)
        sums = space.read_sums(dict(settings.constraints))
    return Problem.of(
        space,
        settings.make_goal(),
        sums,
        restarts=settings.restarts,
        seed=settings.seed,
        steps=settings.steps,
    )


def _make_parameters(case: Case, load: Load, settings: DesignSettings) -> Parameters:
    """Return the parameters of a scene that vary, (n,), with their bounds and their values in the
    scene.

    The ``load`` is the one load of the scene as the file has it, maybe a side force; that of the
    ``case`` is the same load as it acts on contacts.
    """
    names = settings.names

    def make_network(values: Array) -> ContactNetwork:
        """Return the network of the state in which the parameters have the ``values`` (n,), SI; the
        state is solved anew.
        """
        changes = dict(zip(names, values.tolist(), strict=True))
        changed_load = case.load
        if load.kind in changes:
            array = np.full(load.array.shape, changes.pop(load.kind))
            changed_load = replace(load, array=array).applied.flat  # a case has its loads as (n,)
        changed_packing = change_packing(case.packing, changes) if changes else case.packing
        state = replace(case, packing=changed_packing, load=changed_load).state
        network: ContactNetwork = settings.shape(given_network(state))
        return network

    packing: Any = case.packing
    low, high = np.transpose([bounds for _, bounds in settings.vary])
    start = np.array(
        [
            float(np.ravel(load.array)[0]) if name == load.kind else read_number(packing, name)
            for name in names
        ]
    )
    return Parameters(make_network, names, low, high, start)


@dataclass(frozen=True)
class DesignTask(Task):
    """The search from one start of the design of a scene.

    Attributes
    ----------
    case, load, settings, has_varied_parameters : the arguments of :func:`_make_problem`.
    number : number of the start; 0 is the network of the scene, others are random.
    """

    case: Case
    load: Load
    settings: DesignSettings
    has_varied_parameters: bool
    number: int

    where = "design"
    kind = "design"

    @cached_property
    def name(self) -> str:
        """Name under which the result is stored: the number of the start, and a digest of all that
        determines the result.
        """
        data = {
            "packing": self.case.packing,
            "medium": self.case.medium,
            "load": self.load,
            "finite_overlap": self.case.request.finite_overlap,
            # the result of a start does not depend on the number of starts
            "design": vars(self.settings) | {"restarts": 0},
            "versions": packages(),
        }
        return f"design-{self.number}-{hashlib.sha256(to_json(data).encode()).hexdigest()}"

    def __getstate__(self) -> dict[str, Any]:
        """Return the attributes that are sent to a worker: all but the ``problem``, whose functions
        cannot be sent, so that the worker makes the problem itself.
        """
        return {name: value for name, value in vars(self).items() if name != "problem"}

    @cached_property
    def problem(self) -> Problem:
        """The goal of the design and the networks among which the best is sought; a problem that
        :meth:`PosedDesign.of` has made is shared by all tasks of this process.
        """
        return _make_problem(self.case, self.load, self.settings, self.has_varied_parameters)

    def solve(self, begun: TaskResult | None = None) -> TaskResult:
        """Search from the start, and return as "history" the goal at each evaluation, (h,), as
        "best" the best variables, (n,) SI, and as "stopped" the reason for an early end, a text
        that may be empty. A search is one step, so that ``begun`` is not used.
        """
        outcome = self.problem.search(self.number)
        return {
            "history": outcome.history,
            "best": outcome.best,
            "stopped": np.array(outcome.stopped),
        }


@dataclass(frozen=True)
class PosedDesign:
    """The design of a scene before the search.

    Attributes
    ----------
    problem : the goal, and the networks among which the best is sought.
    warnings : one sentence, which names the variables without an effect; empty if there are none.
    tasks : the search from each start, in the order of the starts.
    units : SI unit of each variable by its name in the settings, such as "mass".
    """

    problem: Problem
    warnings: tuple[str, ...]
    tasks: tuple[DesignTask, ...]
    units: Mapping[str, str]

    @classmethod
    def of(cls, scene: Any) -> PosedDesign:
        """Return the design of a scene; its state is solved.

        Errors of the goal and of the variables are placed at the block "design" of the file, those
        of the keys "repeat" and "cut" of this block at these keys, and errors of the state at the
        load.
        """
        settings = scene.design
        case = scene.plan.case.case
        has_varied_parameters = varies_parameters(scene)
        _ = scene.state()  # solved first, so that errors of the state are placed at the load
        network = given_network(case.state)
        # the steps are taken one by one, each alone, so that its errors are placed at its key
        with scene.origin.at("design", "repeat"):
            repeated_network = replace(settings, cut=()).shape(network)
        with scene.origin.at("design", "cut"):
            replace(settings, repeat=()).shape(repeated_network)
        with scene.origin.at("design"):
            problem = _make_problem(case, scene.load, settings, has_varied_parameters)
            warnings = tuple(problem.judge_effects())
        tasks = tuple(
            DesignTask(case, scene.load, settings, has_varied_parameters, number)
            for number in range(problem.count)
        )
        for task in tasks:
            # tasks that are done in this process share the problem; it is put into the dictionary,
            # where a cached property keeps its value, as the dataclass is frozen
            task.__dict__["problem"] = problem
        units = {name: find_unit_of_variable(scene, name) for name in settings.names}
        return cls(problem, warnings, tasks, units)

    @property
    def cost(self) -> costs.Cost:
        """Memory and time of the search if each start takes all of its steps. A goal with
        certificates, such as a gap, adds those of the given and of the best network. When the time
        is first asked for, the evaluation of the goal with its derivatives is timed; its time is
        kept for later.
        """
        problem = self.problem
        space = problem.space
        goal = problem.goals[0]
        # a unit is a whole evaluation, whose time has no limit: so it is always timed
        units = costs.Units(
            problem.count * problem.steps, lambda: self._evaluation_seconds, math.inf
        )
        network = space.make_network(space.start)
        description = (
            f"design of {counted(len(space.labels), 'unknown')} from"
            f" {counted(problem.count, 'start')}, at most {problem.steps} steps each"
        )
        cost = costs.Cost(
            goal.estimate_memory(network),
            units=(units,),
            parts=(description,),
            libraries=costs.NUMBA_BYTES,
        )
        if hasattr(goal, "estimate_certificate"):
            # of the given and of the best network; the text names the search alone
            cost += replace(goal.estimate_certificate(network).times(2.0), parts=())
        return cost

    @cached_property
    def _evaluation_seconds(self) -> float:
        """Processor time of one evaluation of the goal with its derivatives at the start of the
        search, s.
        """
        space = self.problem.space
        goal = self.problem.goals[0]
        return costs.time_once(lambda: space.differentiate(goal.evaluate, space.start))

    def describe(self) -> list[tuple[str, Any, str]]:
        """Return two rows (name, value, SI unit): the number and names of the unknowns, and the
        value of the goal at the start of the search. The value of the widest gap is its smooth
        width, or words where that gap is closed.
        """
        labels = self.problem.space.labels
        unknowns = f"{len(labels)}: {list_names(labels, _MOST_NAMES)}"
        goal = self.problem.goals[0]
        name = "goal at the start"
        value: Any = self.problem.start_value
        unit = getattr(goal, "unit", "")
        if isinstance(goal, WidestGap):
            name = "smooth gap at the start"
            words_of_closed_gap = goal.tell_closed(value)
            if words_of_closed_gap:
                value = words_of_closed_gap
                unit = ""
        return [("unknowns of the design", unknowns, ""), (name, value, unit)]

    def finish(self, results: Sequence[TaskResult]) -> Design:
        """Return the best of the designs that the tasks have found, whose ``results`` are in the
        order of the tasks.
        """
        searches = [
            SearchOutcome(result["history"], result["best"], str(result["stopped"]))
            for result in results
        ]
        return choose_best(self.problem, searches, self.warnings)
