"""The design of a scene: the networks that its variables make, and the search for the best of them.

Parameters of the scene are followed through its statics; numbers of its network have exact
derivatives. Each start of the search is a task, which the store of a run keeps.
"""

from __future__ import annotations

import hashlib
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property, partial
from typing import Any

import numpy as np

from granphon.balls.loads import Load
from granphon.balls.packing import change_packing
from granphon.base.text import counted
from granphon.inverse.design import Design, choose_best
from granphon.inverse.search import Found, Numbers, Parameters, Problem
from granphon.media import cost as costs
from granphon.networks.network import ContactNetwork, given_network
from granphon.observables.parameters import read_number
from granphon.runs.execution import Task
from granphon.runs.finished_tasks import TaskResult
from granphon.runs.tasks import Case, to_json
from granphon.runs.workers import packages
from granphon.scene.design_settings import DesignSettings, find_unit_of_variable, varies_parameters

#: most variables that a line names
_NAMED = 6


def _make_problem(case: Case, load: Load, settings: DesignSettings, of_parameters: bool) -> Problem:
    """Return the problem of the ``settings`` for the one state of a case; the ``load`` is that of
    the scene.
    """
    names = settings.names
    if not of_parameters:
        network = settings.shape(given_network(case.state))
        space = Numbers.of(network, names, dict(settings.vary), settings.per)
        sums = space.read_sums(dict(settings.constraints))
        return _pose(space, sums, settings)

    def make(values: Any) -> ContactNetwork:
        changes = dict(zip(names, values.tolist(), strict=True))
        changed_load = case.load
        if load.kind in changes:
            array = np.full(load.array.shape, changes.pop(load.kind))
            changed_load = replace(load, array=array).applied.flat
        changed = change_packing(case.packing, changes) if changes else case.packing
        state = replace(case, packing=changed, load=changed_load).state
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
    return _pose(Parameters(make, names, low, high, start), (), settings)


def _pose(space: Any, sums: Any, settings: DesignSettings) -> Problem:
    options = {"restarts": settings.restarts, "seed": settings.seed, "steps": settings.steps}
    return Problem.of(space, settings.make_goal(), sums, **options)


@dataclass(frozen=True)
class DesignTask(Task):
    """The search from one start of the design of a scene; see :func:`_make_problem`."""

    case: Case
    load: Load
    settings: DesignSettings
    of_parameters: bool
    number: int

    where = "design"
    kind = "design"

    @cached_property
    def name(self) -> str:
        """Name of the result: the number of the start, and a digest of what determines it."""
        data = {
            "packing": self.case.packing,
            "medium": self.case.medium,
            "load": self.load,
            "finite_overlap": self.case.request.finite_overlap,
            "design": vars(self.settings) | {"restarts": 0},
            "versions": packages(),
        }
        return f"design-{self.number}-{hashlib.sha256(to_json(data).encode()).hexdigest()}"

    def __getstate__(self) -> dict[str, Any]:
        """Return what a worker needs: it poses the problem itself."""
        return {name: value for name, value in vars(self).items() if name != "problem"}

    @cached_property
    def problem(self) -> Problem:
        """The problem of the design."""
        return _make_problem(self.case, self.load, self.settings, self.of_parameters)

    def solve(self, begun: TaskResult | None = None) -> TaskResult:
        """Search from the start."""
        found = self.problem.search(self.number)
        return {
            "history": found.history,
            "best": found.best,
            "stopped": np.array(found.stopped),
        }


@dataclass(frozen=True)
class PosedDesign:
    """The design of a scene before the search.

    Attributes
    ----------
    problem : the goal, and the networks.
    warnings : a sentence that names the variables without an effect, or none.
    tasks : one for each start.
    units : SI unit of each name that varies.
    """

    problem: Problem
    warnings: tuple[str, ...]
    tasks: tuple[DesignTask, ...]
    units: Mapping[str, str]

    @classmethod
    def of(cls, scene: Any) -> PosedDesign:
        """Return the design of a scene; errors are placed in the block."""
        settings = scene.design
        case = scene.plan.case.case
        of_parameters = varies_parameters(scene)
        _ = scene.state()  # first, so that its errors are placed at the load
        with scene.origin.at("design"):
            problem = _make_problem(case, scene.load, settings, of_parameters)
            warnings = tuple(problem.judge_effects())
        tasks = tuple(
            DesignTask(case, scene.load, settings, of_parameters, number)
            for number in range(problem.count)
        )
        for task in tasks:  # in this process the problem is posed once
            task.__dict__["problem"] = problem
        units = {name: find_unit_of_variable(scene, name) for name in settings.names}
        return cls(problem, warnings, tasks, units)

    @property
    def cost(self) -> costs.Cost:
        """Memory and time of the search, if each start takes all of its steps, and of the
        certificates of a gap at the start and at the end.
        """
        problem = self.problem
        space = problem.space
        goal = problem.goals[0]
        measure = partial(costs.time_once, lambda: space.differentiate(goal.evaluate, space.start))
        units = costs.Units(problem.count * problem.steps, measure)
        network = space.make_network(space.start)
        words = (
            f"design of {counted(len(space.labels), 'unknown')} from"
            f" {counted(problem.count, 'start')}, at most {problem.steps} steps each"
        )
        cost = costs.Cost(
            goal.estimate_memory(network),
            units=(units,),
            parts=(words,),
            libraries=costs.NUMBA_BYTES,
        )
        if hasattr(goal, "estimate_certificate"):
            of_both = goal.estimate_certificate(network).times(2.0)
            cost += replace(of_both, kept=0.0, working=of_both.kept, parts=())
        return cost

    def describe(self) -> list[tuple[str, Any, str]]:
        """Return names, values and SI units of what is sought."""
        problem = self.problem
        space = problem.space
        labels = space.labels
        named = ", ".join(labels[:_NAMED])
        more = f" and {len(labels) - _NAMED} more" if len(labels) > _NAMED else ""
        unit = getattr(problem.goals[0], "unit", "")
        return [
            ("unknowns of the design", f"{len(labels)}: {named}{more}", ""),
            ("goal at the start", problem.start_value, unit),
        ]

    def finish(self, results: Sequence[TaskResult]) -> Design:
        """Return the design of the results of all tasks."""
        found = [
            Found(result["history"], result["best"], str(result["stopped"])) for result in results
        ]
        return choose_best(self.problem, found, self.warnings)
