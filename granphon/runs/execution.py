"""Work that can run side by side, on any executor, and that an interruption does not undo.

A task is plain data that can be pickled, and its result a mapping of arrays that depends on the
task alone; so tasks may run anywhere and in any order. A long one is done in steps: each is a call
of its own, and its result is kept in the store as soon as it comes back. Short ones share calls of
a tenth of a second.
"""

from __future__ import annotations

import math
import platform
import time
from collections import Counter
from collections.abc import Mapping, Sequence
from concurrent.futures import BrokenExecutor, CancelledError, Executor, Future, wait
from contextlib import closing, nullcontext, suppress
from heapq import heappop, heappush
from itertools import chain
from queue import SimpleQueue
from typing import Any, NamedTuple

from granphon.base.errors import GranphonError, OutputError
from granphon.base.progress import Progress, Step, silent
from granphon.base.registry import list_added
from granphon.base.threads import naming_lost_workers
from granphon.runs.store import Store, TaskResult, decode, encode
from granphon.runs.workers import (
    InProcess,
    count_calls,
    packages,
    require_packages,
)

#: time after which a worker begins nothing more of a call, s
CALL_SECONDS = 0.1
#: number of workers that are lost with a task before it counts as the reason; the last one has
#: nothing else to do
MOST_LOSSES = 3


class Task:
    """A piece of work, in one step or more.

    ``name`` is that under which the result is kept: one line, not empty; no task with another
    result has it. ``where`` names the task in messages. Tasks of one ``kind`` take similar times.
    """

    name: Any
    where: Any
    kind: Any

    @property
    def steps(self) -> int:
        """Number of steps that the task takes."""
        return 1

    def done(self, part: TaskResult) -> int:
        """Return the number of steps that ``part`` contains."""
        return 1

    def solve(self, begun: TaskResult | None = None) -> TaskResult:
        """Do the next step after ``begun``, or the first, and return both together; after the last
        step, the result.
        """
        raise NotImplementedError


class Result(NamedTuple):
    """What a worker has found of a task: the entry of its steps so far, their number, and the time
    of the last one, s.
    """

    entry: bytes
    steps: int
    seconds: float


def advance(
    orders: Sequence[tuple[Task, bytes | None]],
    wanted: Mapping[str, str],
    added: Sequence[str] = (),
) -> list[Result]:
    """Do, in a worker, the next step of each task after those in its entry, and return the results
    of the first tasks.

    Packages must have the versions that are ``wanted``, and observables that were ``added`` must be
    known. After ``CALL_SECONDS`` nothing more is begun. An error of the first task is raised; that
    of a later one ends the call before it, and it will come again as the first.
    """
    require_packages(f"the worker on {platform.node()}", wanted)
    if missing := set(added).difference(list_added("observable")):
        what = f"a worker does not know the observable {min(missing)!r}"
        why = "It was registered in the process that began the work"
        mend = (
            "Register it by an entry point of granphon.plugins, or in a script above its if"
            " __name__ == '__main__'"
        )
        raise GranphonError(what, why, mend)
    results = list[Result]()
    begun = time.perf_counter()
    for task, entry in orders:
        before = time.perf_counter()
        if results and before - begun > CALL_SECONDS:
            break
        try:
            part = task.solve(None if entry is None else decode(entry))
            results.append(
                Result(encode(task.name, part), task.done(part), time.perf_counter() - before)
            )
        except Exception:
            if not results:
                raise
            break
    return results


def solve_all(
    label: str,
    tasks: Sequence[Task],
    executor: Executor | None = None,
    progress: Progress = silent,
    store: Store | None = None,
) -> list[TaskResult]:
    """Do ``tasks`` and return their results in the order of the tasks, whichever is finished first.

    Parameters
    ----------
    label : name of the work for ``progress``, which is told of each step once its result has been
        kept.
    tasks : the tasks; those whose results ``store`` holds are not done again, nor are steps that it
        holds.
    executor : any executor with the interface of :class:`concurrent.futures.Executor`, that of a
        dask client among them; None does one task after the other. It is not shut down.
    store : where each result is kept as soon as it is found.

    An error of a task is raised as it is. A task whose worker is lost is done again; if that
    happens to it thrice, or if the executor takes no more work then,
    :class:`~granphon.base.errors.GranphonError` names it. After an error, and on an interruption,
    results that come within half a second are kept, and calls that have not begun by then are
    cancelled.
    """
    with closing(Store()) if store is None else nullcontext(store) as known:
        with progress.step(label, sum(task.steps for task in tasks)) as step:
            _Work(tasks, known, step).run(InProcess() if executor is None else executor)
        parts = list[TaskResult]()
        for task in tasks:
            part = known.read(task.name)
            while part is None or task.done(part) < task.steps:
                # it has been damaged meanwhile, and is found again
                part = task.solve(part)
            parts.append(part)
    return parts


class _Work:
    """Tasks under way, by their indices: ``left`` are those that are not finished and not sent, a
    heap.
    """

    def __init__(self, tasks: Sequence[Task], store: Store, step: Step) -> None:
        self.tasks = tasks
        self.store = store
        self.step = step
        self.left = list[int]()
        #: tasks of each call under way; entries of tasks that have begun; how often a worker was
        #: lost with each
        self.running = dict[Future[list[Result]], list[int]]()
        self.begun = dict[int, bytes]()
        self.losses = Counter[int]()
        #: time of a step of each kind of task, s
        self.seconds: dict[str, float] = {}
        found = 0
        for index, task in enumerate(tasks):
            part = store.read(task.name) if task.name in store else None
            steps = 0 if part is None else task.done(part)
            found += steps
            if part is None or steps < task.steps:
                self.left.append(index)
                self.begun |= {} if part is None else {index: encode(task.name, part)}
        step.advance(found)  # also if nothing was: the clock of the progress begins here

    def run(self, executor: Executor) -> None:
        """Have the tasks done, by calls of which a few are under way for each worker."""
        ready = SimpleQueue[Future[list[Result]]]()
        most = count_calls(executor)
        try:
            while self.left or self.running:
                while self.left and ready.empty():
                    # the next task or one under way may be why workers were lost, and is then to be
                    # alone
                    suspects = {
                        index for index, times in self.losses.items() if times >= MOST_LOSSES - 1
                    }
                    alone = not suspects.isdisjoint(chain([self.left[0]], *self.running.values()))
                    if len(self.running) >= (1 if alone else most or 1):
                        break
                    indices = self._take(most)
                    orders = [(self.tasks[index], self.begun.get(index)) for index in indices]
                    with naming_lost_workers(self._name_lost(indices[0])):
                        future = executor.submit(
                            advance, orders, packages(), list_added("observable")
                        )
                    self.running[future] = indices
                    future.add_done_callback(ready.put)
                future = ready.get()
                self._receive(future, self.running[future])
                del self.running[future]
        finally:
            wait(self.running, 0.5)  # s, after an error or an interruption
            for future, indices in self.running.items():
                if (
                    not future.cancel()
                    and future.done()
                    and not future.cancelled()
                    and future.exception() is None
                ):
                    with suppress(OutputError):  # this may be the very error that is being raised
                        for index, result in zip(indices, future.result(), strict=False):
                            self.store.append(self.tasks[index].name, result.entry)

    def _name_lost(self, following: int) -> str:
        """Name the tasks with which workers were lost, or the ``following`` one where none were."""
        lost = sorted(self.losses) or [following]
        others = f", or one of {len(lost) - 1} tasks beside it" if len(lost) > 1 else ""
        return f"{self.tasks[lost[0]].where}{others}"

    def _take(self, calls: int) -> list[int]:
        """Take the tasks of the next of so many calls: one if it is not known to be short, or if a
        worker was lost with it.

        Towards the end calls become shorter, so that all workers end at about the same time.
        """
        most = max(1, len(self.left) // (2 * calls)) if calls else 1
        indices = list[int]()
        seconds = 0.0
        while self.left and len(indices) < most:
            index = self.left[0]
            seconds += (
                math.inf
                if self.losses[index]
                else self.seconds.get(self.tasks[index].kind, math.inf)
            )
            if indices and seconds > CALL_SECONDS:
                break
            indices.append(heappop(self.left))
        return indices

    def _receive(self, future: Future[list[Result]], indices: Sequence[int]) -> None:
        """Keep what a call has brought, and put back what is left of it; if its worker was lost,
        all of it.
        """
        results: list[Result] = []
        try:
            results = future.result()
        except CancelledError:
            what = "the scheduler does not answer any more"
            why = "It has ended, or the network has failed"
            mend = "What is finished is kept: run the same command again to continue"
            raise GranphonError(what, why, mend) from None
        except Exception as error:  # BrokenProcessPool, or KilledWorker of dask
            if not isinstance(error, BrokenExecutor) and type(error).__name__ != "KilledWorker":
                raise
            self.losses.update(dict.fromkeys(indices, getattr(error, "allowed_failures", 0) + 1))
            times = self.losses[indices[0]]
            where = self.tasks[indices[0]].where
            if len(self.running) == len(indices) == 1 and times >= MOST_LOSSES:
                what = f"{where}: the worker process that did it has ended, {times} times"
                mend = (
                    "Give workers more memory, or take fewer --workers; run the same command"
                    " again to continue"
                )
                raise GranphonError(what, "It was killed, or ran out of memory", mend) from None
        for index, result in zip(indices, results, strict=False):
            self.store.append(self.tasks[index].name, result.entry)
        for index in indices[len(results) :]:
            heappush(self.left, index)
        for index, result in zip(indices, results, strict=False):
            task = self.tasks[index]
            self.seconds[task.kind] = 0.5 * (
                self.seconds.get(task.kind, result.seconds) + result.seconds
            )
            self.begun.pop(index, None)
            if result.steps < task.steps:
                self.begun[index] = result.entry
                heappush(self.left, index)
            self.step.advance()
