"""Speed against accuracy, measured: what each medium, and each knob inside one, costs and is worth.

A study is one question: how good and how fast are the media? the grid of the Green's function? the solution of the effective
medium? the mesh of the density of states? Each has its points, a method with its knob, and a reference that another
algorithm has made. A point is run some times, all warm, and its error is that of what would be observed.
"""

from __future__ import annotations

import csv
import io
import math
import statistics
import time
import tracemalloc
from collections.abc import Sequence
from dataclasses import dataclass
from functools import partial
from typing import Any, ClassVar, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from granphon.balls.packing import Packing
from granphon.balls.parameters import numbers
from granphon.base.errors import GranphonError, InputError, message
from granphon.base.progress import Progress, silent
from granphon.base.results import Result
from granphon.base.validation import choice, each, number, ruled, truth, whole
from granphon.media.mean_field import compressive, finite
from granphon.tradeoffs.questions import Point, Reference, Study, studies

__all__ = ["TRADEOFF_FILES", "Measured", "TradeOff", "tradeoff"]

Array = NDArray[np.float64]
#: how many times better than a point its reference is to be
BETTER = 100.0
#: runs of a point, at least
LEAST_RUNS = 5
#: runs more than those that are timed: one to warm up, and one that is slower, as its memory is watched
_MORE_RUNS = 4.0
_OBSERVED = ("velocities", "bands", "dos")
#: part of the time of a study that its points may take
_FOR_POINTS = 0.4
#: part of the budget of the first of several studies: it is the question most are here for, and its reference takes long
_FOR_FIRST = 0.6
TRADEOFF_FILES = ("tradeoff.csv", "tradeoff.png")


@dataclass(frozen=True, eq=False, repr=False)
class Measured(Result):
    """A point of a study.

    Attributes
    ----------
    study, method, knob : which one.
    errors : (n_loads, n_observed), relative, each against the study's reference, whose own are ``reference_errors``.
    seconds, spread : median time of the warm runs, and half the range of their middle half.
    setup : median time of what is made ready once, before.
    memory : largest sum of what was allocated at a time, bytes.
    floor : relative; the error cannot be below: condition times rounding, or the chance of the draws, if it is ``random``.
    failure : why it was not run, or has no reference and no errors; empty if neither.
    """

    units: ClassVar[dict[str, str]] = {
        "errors": "1", "reference_errors": "1", "floor": "1", "seconds": "s", "spread": "s", "setup": "s", "memory": "B",
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

    @property
    def ran(self) -> bool:
        """Whether it was run, with or without a reference to judge it by."""
        return self.seconds > 0.0

    @property
    def error(self) -> float:
        """The largest of all."""
        return float(np.max(self.errors, initial=0.0))

    @property
    def reference_error(self) -> float:
        """That of the reference, where the error is largest."""
        return float(self.reference_errors.flat[int(np.argmax(self.errors))]) if self.errors.size else 0.0

    @property
    def resolved(self) -> bool:
        """Whether the reference is at least a hundred times better than the point."""
        return not self.failure and self.error >= BETTER * self.reference_error

    @property
    def note(self) -> str:
        """What has to be said of it: why it failed, or how good the reference is."""
        if self.failure:
            return self.failure
        if self.resolved:
            return ""
        if self.error <= self.reference_error:
            return "no worse than the reference is known"
        return f"the reference is {self.error / self.reference_error:.2g} times better"


@dataclass(frozen=True, eq=False, repr=False)
class TradeOff(Result):
    """What the studies found.

    Attributes
    ----------
    points : every one, those that were not run among them.
    kind, loads : of the scene, those at which errors were measured, SI.
    observed : the quantities of each study, in the order of its points' errors.
    references : of each study, how its reference was made.
    runs : how often each point was timed.
    seconds : that it took in all, of the ``budget``.
    """

    units: ClassVar[dict[str, str]] = {"seconds": "s", "budget": "s"}

    points: tuple[Measured, ...]
    kind: str
    loads: tuple[float, ...]
    observed: dict[str, tuple[str, ...]]
    references: dict[str, str]
    runs: int
    seconds: float
    budget: float

    @property
    def studies(self) -> tuple[str, ...]:
        """Their names."""
        return tuple(dict.fromkeys(point.study for point in self.points))

    def of(self, study: str) -> tuple[Measured, ...]:
        """The points of one study."""
        return tuple(point for point in self.points if point.study == study)

    def csv(self) -> str:
        """One row for each point, load and observed quantity; a point that was not run has one row, with the reason."""
        out = io.StringIO()
        table = csv.writer(out, lineterminator="\n")
        table.writerow([
            "study", "method", "knob", self.kind, "observed", "error (1)", "reference_error (1)", "resolved", "seconds (s)",
            "spread (s)", "setup (s)", "memory (B)", "floor (1)", "failure",
        ])  # fmt: skip
        for point in self.points:
            cost = [point.seconds, point.spread, point.setup, point.memory, point.floor, ""]
            head = [point.study, point.method, point.knob]
            if point.failure:
                table.writerow([*head, *[""] * 5, *(cost[:-1] if point.ran else [""] * 5), point.failure])
                continue
            # a density of states is that at the greatest load alone
            loads = self.loads[-len(point.errors) :]
            for load, errors, known in zip(loads, point.errors, point.reference_errors, strict=True):
                for name, error, limit in zip(self.observed[point.study], errors, known, strict=True):
                    resolved = bool(error >= BETTER * limit)
                    table.writerow([*head, repr(load), name, float(error), float(limit), resolved, *cost])
        return out.getvalue()


def tradeoff(
    packing: Packing,
    *,
    force: ArrayLike | None = None,
    pressure: ArrayLike | None = None,
    overlap: ArrayLike | None = None,
    observe: Sequence[str] = ("velocities",),
    finite_overlap: bool = False,
    budget: float = 180.0,
    most_loads: int = 3,
    runs: int = LEAST_RUNS,
    progress: Progress = silent,
) -> TradeOff:
    """Measure what the media, and the knobs inside them, cost and are worth.

    Parameters
    ----------
    packing : the balls.
    force, pressure, overlap : the loads, N, N/m or m; one of the three. Of more than ``most_loads`` these are taken: the
        least, the greatest, and as many between.
    observe : "velocities", "bands", "dos": what errors are of. Bands and densities of states scale with the frequency.
    finite_overlap : of the density of states; media are compared in the paper's limit only.
    budget : seconds that measuring may take. What does not fit is listed as not run.
    runs : how often each point is timed, five or more.
    progress : told what is under way.

    Returns
    -------
    :class:`TradeOff`.

    Raises
    ------
    InputError : no load, or one that is none; equal balls of which nothing but velocities or bands is observed, as all
        media are exact then; balls that differ on another lattice than the triangular one, or with finite overlap, where
        media have no reference; fewer runs than five, a budget of no seconds, an unknown word in ``observe``.
    """
    given = {"force": force, "pressure": pressure, "overlap": overlap}
    kinds = [kind for kind, values in given.items() if values is not None]
    if len(kinds) != 1:
        raise InputError(message("a trade-off takes loads of one kind", mend="Give one of " + ", ".join(given)))
    if not isinstance(packing, Packing):
        raise InputError(message(f"packing is {packing!r}", mend="Give a granphon.Packing"))
    for name, value, low in (("runs", runs, LEAST_RUNS), ("most_loads", most_loads, 1)):
        ruled(name, partial(whole, low=low, high=1000), value)
    budget = ruled("budget", partial(number, low=1e-3, high=1e9), budget)
    observe = ruled("observe", partial(each, rule=partial(choice, options=_OBSERVED), what="words"), observe)
    ruled("finite_overlap", truth, finite_overlap)
    checked = finite if kinds[0] == "overlap" else compressive
    loads = np.unique(checked(kinds[0], numbers(kinds[0], given[kinds[0]])))
    if loads.size > most_loads:
        loads = loads[np.unique(np.rint(np.linspace(0, loads.size - 1, most_loads)).astype(int))]
    asked = studies(packing, kinds[0], tuple(loads.tolist()), tuple(observe), finite_overlap)
    begun = time.perf_counter()
    points: list[Measured] = []
    references: dict[str, str] = {}
    for place, study in enumerate(asked):
        # the others share the rest evenly; what a study leaves of its part is for those after it
        left = budget - (time.perf_counter() - begun)
        part = _FOR_FIRST if place == 0 and len(asked) > 1 else 1.0 / (len(asked) - place)
        points += _carried_out(study, time.perf_counter() + part * left, runs, progress, references)
    observed = {study.name: study.observed for study in asked}
    taken = time.perf_counter() - begun
    return TradeOff(tuple(points), kinds[0], asked[0].loads, observed, references, runs, taken, float(budget))


class _Runs(NamedTuple):
    """The runs of a point: outcomes, and what they cost."""

    point: Point
    outcomes: list[Any]
    seconds: list[float]
    setups: list[float]
    memory: int


def _carried_out(study: Study, until: float, runs: int, progress: Progress, references: dict[str, str]) -> list[Measured]:
    """The points of a study, measured before the time ``until``: a part of it for them, and the rest for the reference."""
    points = study.points()
    failures: dict[Point, str] = {}
    done: list[_Runs] = []
    halfway = time.perf_counter() + _FOR_POINTS * (until - time.perf_counter())
    with progress.step(study.name, len(points)) as step:
        taken: dict[str, float] = {}
        for point in points:
            try:
                # a knob that is turned further takes longer
                done.append(_timed(point, runs, halfway, max(point.seconds, taken.get(point.method, 0.0))))
                taken[point.method] = statistics.median(done[-1].seconds)
            except _BudgetError as error:
                failures[point], taken[point.method] = str(error), math.inf
            except GranphonError as error:
                failures[point] = str(error)
            step.advance()

    def better(reference: Reference) -> bool:
        """Whether the reference is good enough for every point."""
        found = [(study.errors(one.outcomes, reference), reference.errors) for one in done]
        return all(np.max(e) >= BETTER * r.flat[int(np.argmax(e))] for e, r in found)

    reference, problem = None, "no point was run"
    if done:
        with progress.step(f"{study.name}: reference") as step:
            try:
                reference = study.reference(until, better, step)
                references[study.name] = reference.made
            except GranphonError as error:
                problem = f"there is no reference: {error}"
    measured = []
    nothing = np.zeros(0)
    known = {one.point: one for one in done}
    for point in points:
        one = known.get(point)
        if one is None:
            why = failures.get(point, problem)
            measured.append(Measured(study.name, point.method, point.knob, nothing, nothing, failure=why))
            continue
        errors, known_errors, floor = nothing, nothing, 0.0
        if reference is not None:
            errors, floor = study.errors(one.outcomes, reference), study.floor(point, one.outcomes)
            known_errors = np.broadcast_to(reference.errors, errors.shape).copy()
        low, middle, high = statistics.quantiles(one.seconds, n=4)
        measured.append(Measured(
            study.name, point.method, point.knob, errors, known_errors, middle, 0.5 * (high - low),
            statistics.median(one.setups), one.memory, floor, point.random,
            "" if reference is not None else problem,
        ))  # fmt: skip
    return measured


class _BudgetError(GranphonError):
    """There is no time for a point."""


def _timed(point: Point, runs: int, until: float, about: float) -> _Runs:
    """Run a point, warm; :class:`_BudgetError` if that would not be over at the time ``until``, ``about`` s a run."""

    def fits(seconds: float) -> None:
        if time.perf_counter() + (runs + _MORE_RUNS) * seconds > until:
            long = f": {runs} runs of some {seconds:.2g} s" if 1e-3 < seconds < math.inf else ""
            raise _BudgetError(f"not run, beyond the budget{long}")

    fits(about)
    begun = time.perf_counter()
    point.solve(point.prepare(0))
    fits(time.perf_counter() - begun)
    outcomes, seconds, setups = [], [], []
    for run in range(1, runs + 1):
        begun = time.perf_counter()
        ready = point.prepare(run)
        between = time.perf_counter()
        outcomes.append(point.solve(ready))
        seconds.append(time.perf_counter() - between)
        setups.append(between - begun)
    tracemalloc.start()
    try:
        point.solve(point.prepare(0))
        memory = tracemalloc.get_traced_memory()[1]
    finally:
        tracemalloc.stop()
    return _Runs(point, outcomes, seconds, setups, memory)
