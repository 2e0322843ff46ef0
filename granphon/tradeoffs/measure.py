"""Measure speed against accuracy: time and error of each medium.

The study of the media (:mod:`granphon.tradeoffs.study`) is a task (:mod:`granphon.runs.execution`) with a budget of
time, and is kept once it is finished. Each of its points is timed several times after a run to warm up, and its error is
that of the quantities that a scene observes.
"""

from __future__ import annotations

import json
import math
import statistics
import tracemalloc
from collections.abc import Mapping, Sequence
from concurrent.futures import Executor
from dataclasses import asdict, dataclass, field
from functools import partial
from itertools import compress
from typing import Any, ClassVar, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from granphon.balls.loads import Load
from granphon.balls.packing import Packing, given_packing
from granphon.base.errors import GranphonError, InputError, message
from granphon.base.progress import Progress, silent
from granphon.base.results import Result
from granphon.base.scales import write_quantity
from granphon.base.tables import table_text
from granphon.base.text import digest
from granphon.base.validation import choice, each, number, require, truth, whole
from granphon.media.friction_history import REFERENCE_OPTIONS, REST, FrictionHistory
from granphon.media.simulation import DirectSimulation
from granphon.media.state import ideal_lattice
from granphon.runs.execution import solve_all
from granphon.runs.store import Store, TaskResult
from granphon.runs.tasks import to_json
from granphon.runs.workers import packages
from granphon.tradeoffs.study import QUANTITIES, SECONDS, Deadline, MediaStudy, Point, Reference, Stopwatch

Array = NDArray[np.float64]
#: a reference can judge a point if the error of the point is at least this many times that of the reference
BETTER = 100.0
#: least number of timed runs of a point
LEAST_RUNS = 5
#: time of the runs that are not timed, in runs: one warms up, and one is slower because its memory is watched
_MORE_RUNS = 4.0
#: largest number of runs from which the rms error of a random point is found
_MOST_DRAWS = 100
#: how much longer than the median a run may take
_MARGIN = 1.5
#: quantities whose errors can be measured, in the words of a scene
_OBSERVED = ("velocities", "bands", "dos")
#: part of the time of a study that its points may take
_FOR_POINTS = 0.4
#: files of a trade-off
TRADEOFF_FILES = ("tradeoff.csv", "tradeoff.png")


@dataclass(frozen=True, eq=False, repr=False)
class MeasuredPoint(Result):
    """Errors, times and memory of one point of a study.

    Attributes
    ----------
    study, method, knob : names of the study and the method, and the setting of the method's knob.
    errors : relative errors against the study's reference, (n_loads, n_observed).
    reference_errors : relative errors of that reference itself, (n_loads, n_observed).
    seconds, spread : median time of the warm runs, and half the range of their middle half, s.
    setup : median time of what is prepared before a run, s.
    memory : largest amount of memory that was allocated at one moment, bytes.
    floor : least relative error possible: condition number times rounding, or the scatter of runs if they are ``random``.
    random : whether every run draws other random numbers.
    failure : why the point was not run, or has no errors for want of a reference; otherwise empty.
    stderrs : standard errors of ``errors``, which are rms over runs if these are ``random``, (n_loads, n_observed); else 0.
    draws : number of runs that the errors are of.
    """

    units: ClassVar[dict[str, str]] = {
        "errors": "1", "reference_errors": "1", "stderrs": "1", "floor": "1", "seconds": "s", "spread": "s", "setup": "s",
        "memory": "B",
    }  # fmt: skip

    study: str
    method: str
    knob: str
    errors: Array
    reference_errors: Array
    seconds: float = 0.0
    spread: float = 0.0
    setup: float = 0.0
    memory: int = 0
    floor: float = 0.0
    random: bool = False
    failure: str = ""
    stderrs: Array = field(default_factory=lambda: np.zeros(0))
    draws: int = 0

    @property
    def ran(self) -> bool:
        """Whether the point was run, with or without a reference to judge it by."""
        return self.seconds > 0.0

    @property
    def error(self) -> float:
        """The largest of the errors, a relative error."""
        return float(np.max(self.errors, initial=0.0))

    @property
    def stderr(self) -> float:
        """Standard error of :attr:`error`: of the rms over random runs; 0 if they are not random."""
        return float(self.stderrs.flat[int(np.argmax(self.errors))]) if self.stderrs.size else 0.0

    @property
    def reference_error(self) -> float:
        """Relative error of the reference where the point's error is largest."""
        return float(self.reference_errors.flat[int(np.argmax(self.errors))]) if self.errors.size else 0.0

    @property
    def resolved(self) -> bool:
        """Whether the reference is at least a hundred times better than the point."""
        return not self.failure and self.error >= BETTER * self.reference_error

    @property
    def note(self) -> str:
        """Why the point failed, or how much better the reference is if it is not :attr:`resolved`; otherwise empty."""
        if self.failure:
            return self.failure
        if self.resolved:
            return ""
        if self.error <= self.reference_error:
            return "the error is not above that of the reference"
        return f"the reference is {self.error / self.reference_error:.2g} times better"


@dataclass(frozen=True, eq=False, repr=False)
class TradeOff(Result):
    """Results of the studies of a trade-off.

    Attributes
    ----------
    points : all points, including those that were not run.
    kind, loads : kind of the loads at which errors were measured ("force", "pressure", "overlap"), and their values, SI.
    observed : for each study, the names of the quantities whose errors were measured, in the order of the errors.
    references : for each study, how its reference was made.
    runs : number of timed runs of each point.
    seconds : time that all studies took together, s.
    budget : time that they could take, s.
    """

    units: ClassVar[dict[str, str]] = {"seconds": "s", "budget": "s"}

    points: tuple[MeasuredPoint, ...]
    kind: str
    loads: tuple[float, ...]
    observed: dict[str, tuple[str, ...]]
    references: dict[str, str]
    runs: int
    seconds: float
    budget: float

    @property
    def studies(self) -> tuple[str, ...]:
        """Names of the studies."""
        return tuple(dict.fromkeys(point.study for point in self.points))

    def of(self, study: str) -> tuple[MeasuredPoint, ...]:
        """The points of one study."""
        return tuple(point for point in self.points if point.study == study)

    def csv(self) -> str:
        """Return a table (CSV) with one row for each point, load and observed quantity.

        A point without errors has one row, with the reason.
        """
        headings = (
            "study", "method", "knob", self.kind, "observed", "error (1)", "error_stderr (1)", "draws",
            "reference_error (1)", "resolved", "seconds (s)", "spread (s)", "setup (s)", "memory (B)", "floor (1)",
            "failure",
        )  # fmt: skip
        rows: list[list[Any]] = []
        for point in self.points:
            cost = [point.seconds, point.spread, point.setup, point.memory, point.floor, ""]
            head = [point.study, point.method, point.knob]
            if point.failure:
                rows.append([*head, *[""] * 7, *(cost[:-1] if point.ran else [""] * 5), point.failure])
                continue
            for load, *found in zip(self.loads, point.errors, point.stderrs, point.reference_errors, strict=True):
                for name, error, stderr, limit in zip(self.observed[point.study], *found, strict=True):
                    resolved = bool(error >= BETTER * limit)
                    own = [float(error), float(stderr), point.draws, float(limit), resolved]
                    rows.append([*head, load, name, *own, *cost])
        return table_text(headings, rows)


def tradeoff(
    packing: Packing,
    *,
    force: ArrayLike | None = None,
    pressure: ArrayLike | None = None,
    overlap: ArrayLike | None = None,
    observe: Sequence[str] = ("velocities",),
    finite_overlap: bool = False,
    friction_history: bool = False,
    friction_coefficient: float | None = REST.friction_coefficient,
    shear_response: str = REST.shear_response,
    budget: float = 180.0,
    most_loads: int = 3,
    runs: int = LEAST_RUNS,
    progress: Progress = silent,
    stopwatch: Stopwatch = SECONDS,
    executor: Executor | None = None,
    store: Store | None = None,
) -> TradeOff:
    """Measure time and error of the media, of simulations of several sizes among them.

    Parameters
    ----------
    packing : the balls.
    force, pressure, overlap : the loads, N, N/m (Pa in space) or m; one of the three.
    observe : "velocities", "bands", "dos": the quantities whose errors are measured. For bands and densities of states,
        media are judged by the scale of frequencies.
    finite_overlap : is refused: media are compared in the paper's limit only.
    friction_history, friction_coefficient, shear_response : whether media are judged by arrays loaded with friction, and
        how, as of a :class:`~granphon.DirectSimulation`; by default by arrays at rest without friction.
    budget : time that measuring may take, s. What does not fit is listed as not run.
    most_loads : largest number of loads; of more than that the least, the greatest, and some between are taken. If it is
        one, the least is taken, where media differ most.
    runs : how often each point is timed, five or more.
    progress : is told what is under way.
    stopwatch : measures all times; give a subclass of :class:`~granphon.tradeoffs.study.Stopwatch` to count work instead
        of seconds.
    executor : does the study, a task that measures time where it runs. Times are those of a machine that does nothing else.
    store : where the finished study is kept. One that it holds of the same trade-off is used; the caller clears it.

    Returns
    -------
    :class:`TradeOff`.

    Raises
    ------
    InputError : no load, or one that is not valid; equal balls, as all media are exact then; balls on a line, on a lattice
        that is not simulated, or with finite overlap, where media have no reference; a history without a friction
        coefficient, or the reverse; fewer runs than five, a budget of no seconds, an unknown word in ``observe``.
    FileExistsInRunError : ``store`` holds finished studies of another trade-off, or tasks of a sweep.
    """
    applied = Load.only(force=force, pressure=pressure, overlap=overlap)
    given_packing(packing)
    for name, value, low in (("runs", runs, LEAST_RUNS), ("most_loads", most_loads, 1)):
        require(name, partial(whole, low=low, high=1000), value)
    budget = require("budget", partial(number, low=1e-3, high=1e9), budget)
    observe = require("observe", partial(each, rule=partial(choice, options=_OBSERVED), what="words"), observe)
    require("finite_overlap", truth, finite_overlap)
    given = dict(zip(REFERENCE_OPTIONS, (friction_history, friction_coefficient, shear_response), strict=True))
    against = require("tradeoff", FrictionHistory.read, given)
    loads = np.unique(applied.array)
    if loads.size > most_loads:
        loads = loads[np.unique(np.rint(np.linspace(0, loads.size - 1, most_loads)).astype(int))]
    if not packing.width:
        why = "All media are exact for them, and equally fast"
        raise InputError(message("equal balls leave nothing to compare", why, "Give the packing a spread"))
    # balls that differ need a simulated array by which media are judged
    structure = packing.structure
    where, mend, why = f"on the {structure.name} lattice", "Use another lattice, or leave the spread out", ""
    if finite_overlap:
        where, mend = "with finite overlap", "Leave finite_overlap out, or the spread"
        why = "Their reference is the simulated array, which has the paper's limit only"
    elif structure.periods == 1:
        why = "On a line all contacts carry the same force, and every medium is exact"
    else:
        try:
            DirectSimulation(packing, (1,) * structure.periods, **against.options)
        except GranphonError as error:
            told = f"Their reference is the simulated array: {error}"
            raise InputError(message(f"media are not compared {where}", told)) from None
        if structure.periods == 2 and not ideal_lattice(packing).is_isotropic:
            why = "In the plane velocities are compared where sound is isotropic"
    if why:
        raise InputError(message(f"media are not compared {where}", why, mend))
    asked = ["velocities" in observe, "velocities" in observe, bool({"bands", "dos"} & set(observe))]
    study = MediaStudy(packing, Load(applied.kind, loads), tuple(compress(QUANTITIES, asked)), stopwatch, against)
    identity = {
        "trade-off of": packing, applied.kind: loads, "observe": observe, "finite_overlap": finite_overlap,
        "against": asdict(against), "budget": budget, "runs": runs, "versions": packages(),
    }  # fmt: skip
    return carry_out(study, budget, runs, progress, executor, store, json.loads(to_json(identity)))


def carry_out(
    study: MediaStudy,
    budget: float,
    runs: int = LEAST_RUNS,
    progress: Progress = silent,
    executor: Executor | None = None,
    store: Store | None = None,
    identity: Mapping[str, Any] | None = None,
) -> TradeOff:
    """Carry out a study within a ``budget`` (s, as its stopwatch tells it), by an ``executor``.

    Once it is finished it is kept in a ``store``, which is claimed for the ``identity`` of the trade-off: plain data that
    say which it is.
    """
    told = progress if executor is None else silent
    task = _StudyTask(study, f"study-{digest(identity)}-{study.name}", budget, runs, told)
    if store is not None:
        store.claim(identity, lambda: [task.name])
    label, shown = (task.where, silent) if executor is None else ("trade-off", progress)
    (found,) = solve_all(label, [task], executor, shown, store)
    points = tuple(MeasuredPoint.from_dict(json.loads(text)) for text in found["points"].tolist())
    references = {study.name: found["made"].item()} if found["made"].size else {}
    observed, seconds, load = {study.name: study.quantities}, float(found["seconds"].item()), study.load
    return TradeOff(points, load.kind, load.values, observed, references, runs, seconds, float(budget))


class _Runs(NamedTuple):
    """The runs of a point: their outcomes, times of solving and preparing (s), and memory (bytes)."""

    outcomes: list[Any]
    seconds: list[float]
    setups: list[float]
    memory: int = 0


class _BudgetError(GranphonError):
    """The time left is too short to run a point."""


@dataclass(frozen=True, eq=False)
class _StudyTask:
    """A study with the time that it may take, s, as a task; its result holds the points as JSON texts, and its time."""

    study: MediaStudy
    name: str
    seconds: float
    runs: int
    progress: Progress = silent

    steps: ClassVar[int] = 1
    memory: ClassVar[float] = 0.0

    @property
    def where(self) -> str:
        return f"study {self.study.name}"

    kind = where

    def done(self, part: TaskResult) -> int:
        return 1

    def solve(self, begun: TaskResult | None = None) -> TaskResult:
        """Measure the points of the study in a part of its time, from now on, and find its reference in the rest."""
        study, now = self.study, self.study.stopwatch.now
        start = now()
        deadline = Deadline(study.stopwatch, start + self.seconds)
        halfway = Deadline(study.stopwatch, now() + _FOR_POINTS * deadline.left)
        points, failures, done, taken = study.make_points(), dict[Point, str](), dict[Point, _Runs](), dict[str, float]()

        def require_time(seconds: float) -> None:
            """Raise :class:`_BudgetError` if the runs of a point, of so many s each, would not end by the deadline."""
            if (self.runs + _MORE_RUNS) * seconds > halfway.left:
                about = write_quantity(seconds, "s", 2) if 1e-3 < seconds < math.inf else ""
                raise _BudgetError("not run, beyond the budget" + (f": {self.runs} runs of about {about}" if about else ""))

        with self.progress.step(study.name, len(points)) as step:
            for point in points:
                ran = _Runs([], [], [])
                try:
                    # a knob that is turned further takes longer; a run to warm up tells how long
                    require_time(max(point.seconds, taken.get(point.method, 0.0)))
                    begin = now()
                    point.solve(point.prepare(0))
                    require_time(now() - begin)
                    for run in range(1, self.runs + 1):
                        begin = now()
                        ready = point.prepare(run)
                        between = now()
                        ran.outcomes.append(point.solve(ready))
                        ran.seconds.append(now() - between)
                        ran.setups.append(between - begin)
                    # one more run, which is slower because its memory is watched
                    tracemalloc.start()
                    try:
                        point.solve(point.prepare(0))
                        done[point] = ran._replace(memory=tracemalloc.get_traced_memory()[1])
                    finally:
                        tracemalloc.stop()
                    taken[point.method] = statistics.median(ran.seconds)
                except _BudgetError as error:
                    failures[point], taken[point.method] = str(error), math.inf
                except GranphonError as error:
                    failures[point] = str(error)
                step.advance()
            # few runs do not tell the rms error of a random point: it is run more often, untimed, in half of the time left
            random = [point for point in done if point.random]
            until = now() + 0.5 * halfway.left
            for place, point in enumerate(random):
                long = statistics.median(done[point].seconds) + statistics.median(done[point].setups)
                end, outcomes = now() + (until - now()) / (len(random) - place), done[point].outcomes
                while len(outcomes) < _MOST_DRAWS and now() + _MARGIN * long < end:
                    outcomes.append(point.solve(point.prepare(len(outcomes) + 1)))

        def square(point: Point, reference: Reference) -> Array:
            """Return the squares of the relative errors of all runs of a point, (n, n_loads, n_observed)."""
            return np.asarray(np.square(np.array(done[point].outcomes) / reference.values - 1.0))

        def better(reference: Reference) -> bool:
            """Return whether the reference is good enough for every point."""
            found = (np.sqrt(np.mean(square(point, reference), axis=0)) for point in done)
            return all(np.max(e) >= BETTER * reference.errors.flat[int(np.argmax(e))] for e in found)

        reference, problem = None, "no point was run"
        if done:
            with self.progress.step(f"{study.name}: reference") as step:
                try:
                    reference = study.find_reference(deadline, better, step)
                except GranphonError as error:
                    problem = f"there is no reference: {error}"
        measured, nothing = list[MeasuredPoint](), np.zeros(0)
        for point in points:
            if point not in done:
                why = failures.get(point, problem)
                measured.append(MeasuredPoint(study.name, point.method, point.knob, nothing, nothing, failure=why))
                continue
            ran = done[point]
            errors, known_errors, stderrs, floor = nothing, nothing, nothing, 0.0
            if reference is not None:
                squares = square(point, reference)
                errors, known_errors = np.sqrt(np.mean(squares, axis=0)), reference.errors
                stderrs, floor = np.zeros_like(errors), float(np.finfo(float).eps) * study.condition
                if point.random:
                    stderrs = np.std(squares, axis=0, ddof=1) / math.sqrt(len(squares)) / (2.0 * errors)
                    floor = float(np.max(np.std(ran.outcomes, axis=0, ddof=1) / np.mean(ran.outcomes, axis=0)))
            low, middle, high = statistics.quantiles(ran.seconds, n=4)
            measured.append(MeasuredPoint(
                study.name, point.method, point.knob, errors, known_errors, middle, 0.5 * (high - low),
                statistics.median(ran.setups), ran.memory, floor, point.random,
                "" if reference is not None else problem, stderrs, len(ran.outcomes),
            ))  # fmt: skip
        texts, made = [json.dumps(point.to_dict()) for point in measured], [reference.made] if reference else []
        return {"points": np.array(texts, str), "made": np.array(made, str), "seconds": np.array(now() - start)}
