"""Work that can run side by side, on any executor, and that an interruption does not undo.

A task is plain data that can be pickled, and its result a mapping of arrays that depends on the
task alone; so tasks may run anywhere and in any order. A long task is done in steps: each step is a
call of its own, and its result is kept in the store as soon as it comes back. Short tasks share
calls of a tenth of a second.
"""

from __future__ import annotations

import math
import platform
import time
from collections import Counter
from collections.abc import Mapping, Sequence
from concurrent.futures import BrokenExecutor, CancelledError, Executor, Future, wait
from contextlib import closing, nullcontext, suppress
from dataclasses import dataclass
from heapq import heappop, heappush
from itertools import chain
from queue import SimpleQueue
from typing import Any, NamedTuple

from granphon.base.errors import GranphonError, OutputError
from granphon.base.progress import Progress, Step, silent
from granphon.base.registry import list_added
from granphon.base.threads import LOST_WORKER, naming_lost_workers
from granphon.runs.finished_tasks import Store, TaskResult, decode, encode
from granphon.runs.workers import (
    InProcess,
    count_calls,
    packages,
    require_packages,
)

#: time after which a worker begins nothing more of a call, s
CALL_SECONDS = 0.1
#: number of workers that are lost with a task before the task counts as the reason; the last worker
#: has nothing else to do
MOST_LOSSES = 3
#: time for which results of calls under way are waited for after an error or an interruption, s
_LAST_SECONDS = 0.5


class Task:
    """A piece of work, in one step or more.

    The result is kept under ``name``, one line, not empty, which no task with another result has.
    ``where`` names the task in messages. Tasks of one ``kind`` take similar times.
    """

    name: Any
    where: Any
    kind: Any

    @property
    def steps(self) -> int:
        """Number of steps that the task takes."""
        return 1

    def count_steps(self, result: TaskResult) -> int:
        """Return the number of steps that a ``result`` contains: all of a task in one step."""
        return 1

    def solve(self, begun: TaskResult | None = None) -> TaskResult:
        """Do one step, and return the result of all steps so far, which after the last step is that
        of the task. ``begun`` is the result of the steps before; without it the step is the first.
        """
        raise NotImplementedError


class StepResult(NamedTuple):
    """What a worker returns of a task after one more step.

    Attributes
    ----------
    entry : the steps of the task so far, as :func:`~granphon.runs.finished_tasks.encode` writes
        them.
    steps : number of these steps.
    seconds : time of the last step, s.
    """

    entry: bytes
    steps: int
    seconds: float


def advance(
    orders: Sequence[tuple[Task, bytes | None]],
    package_versions: Mapping[str, str],
    added: Sequence[str] = (),
) -> list[StepResult]:
    """Do, in a worker, the next step of each task in turn, and return the results of the steps that
    were done, in the order of the tasks.

    Each of the ``orders`` is a task and the entry of its steps so far, None for a task that is not
    begun. Once the call has taken ``CALL_SECONDS`` no further task is begun, and the list is
    shorter than ``orders``. An error of the first task is raised. An error of a later task ends the
    call before that task, which will be the first of another call.

    Raises :class:`~granphon.base.errors.GranphonError` if this process has packages of other
    versions than ``package_versions``, those of the process that began the work, or does not know
    an observable that was ``added`` there.
    """
    require_packages(f"the worker on {platform.node()}", package_versions)
    _require_observables(added)
    results = list[StepResult]()
    call_start = time.perf_counter()
    for task, entry in orders:
        start = time.perf_counter()
        if results and start - call_start > CALL_SECONDS:
            break
        try:
            begun = None if entry is None else decode(entry)
            result = task.solve(begun)
            new_entry = encode(task.name, result)
            seconds = time.perf_counter() - start
            results.append(StepResult(new_entry, task.count_steps(result), seconds))
        except Exception:
            if not results:
                raise
            break
    return results


def _require_observables(added: Sequence[str]) -> None:
    """Raise GranphonError if this process, a worker, does not know an observable that was
    ``added``.
    """
    missing = set(added).difference(list_added("observable"))
    if missing:
        problem = f"a worker does not know the observable {min(missing)!r}"
        why = "It was registered in the process that began the work"
        mend = (
            "Register it by an entry point of granphon.plugins, or in a script above its if"
            " __name__ == '__main__'"
        )
        raise GranphonError(problem, why, mend)


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
    label : name of the work for ``progress``.
    progress : is told of each step once its result has been kept.
    tasks : the tasks; those whose results ``store`` holds are not done again, nor are steps that it
        holds.
    executor : any executor with the interface of :class:`concurrent.futures.Executor`, such as that
        of a dask client, which is not shut down; None does one task after the other.
    store : where each result is kept as soon as it is found.

    An error of a task is raised as it is. A task whose worker is lost is done again; if three
    workers are lost with a task, or if the executor takes no more work then,
    :class:`~granphon.base.errors.GranphonError` names the task. A store that cannot be written
    raises :class:`~granphon.base.errors.OutputError`. After an error, and on an interruption,
    results that come within half a second are kept, and calls that have not begun by then are
    cancelled.
    """
    # A store of the caller stays open.
    opened_store = closing(Store()) if store is None else nullcontext(store)
    with opened_store as task_store:
        with progress.step(label, sum(task.steps for task in tasks)) as step:
            work = _Work(tasks, task_store, step)
            work.run(InProcess() if executor is None else executor)
        results = list[TaskResult]()
        for task in tasks:
            result = task_store.read(task.name)
            while result is None or task.count_steps(result) < task.steps:
                # the entry has been damaged meanwhile, and the result is found again
                result = task.solve(result)
            results.append(result)
    return results


@dataclass(frozen=True)
class Means:
    """The means by which the tasks of a run are done: the executor, the progress and the store that
    :func:`solve_all` takes.
    """

    executor: Executor | None = None
    progress: Progress = silent
    store: Store | None = None

    def solve(
        self, label: str, tasks: Sequence[Task], identity: Mapping[str, Any]
    ) -> list[TaskResult]:
        """Do ``tasks`` by :func:`solve_all`, and return their results in the order of the tasks.
        Before, the store is claimed for the work that ``identity``, plain data, describes, see
        :meth:`Store.claim`.
        """
        if self.store is not None:
            self.store.claim(identity, lambda: [task.name for task in tasks])
        return solve_all(label, tasks, self.executor, self.progress, self.store)


class _Work:
    """Tasks under way, by their indices: ``waiting`` is a heap of the tasks that are neither
    finished nor part of a call under way.
    """

    def __init__(self, tasks: Sequence[Task], store: Store, step: Step) -> None:
        """Read which steps of the ``tasks`` the ``store`` holds, count them as done in the progress
        ``step``, and let all tasks wait that are not finished.
        """
        self.tasks = tasks
        self.store = store
        self.step = step
        self.waiting = list[int]()
        #: tasks of each call under way
        self.running = dict[Future[list[StepResult]], list[int]]()
        #: entries, by the index of the task, of the steps of unfinished tasks that are done
        self.begun = dict[int, bytes]()
        #: number of workers that were lost with each task
        self.losses = Counter[int]()
        #: mean time of a step of each kind of task, s
        self.seconds: dict[str, float] = {}
        n_kept_steps = 0
        for index, task in enumerate(tasks):
            result = store.read(task.name) if task.name in store else None
            n_steps = 0 if result is None else task.count_steps(result)
            n_kept_steps += n_steps
            if result is not None and n_steps >= task.steps:
                continue
            self.waiting.append(index)
            if result is not None:
                self.begun[index] = encode(task.name, result)
        step.advance(n_kept_steps)  # also by zero: the clock of the progress begins here

    def run(self, executor: Executor) -> None:
        """Have all tasks done by ``executor``, with as many calls under way as it has workers.

        Results are kept as they come. Raises what :meth:`_send_call` and :meth:`_receive_results`
        raise, also KeyboardInterrupt; :meth:`_keep_finished` comes first.
        """
        ready = SimpleQueue[Future[list[StepResult]]]()
        n_calls = count_calls(executor)
        try:
            while self.waiting or self.running:
                # calls that have ended come first: their tasks may have further steps
                while self.waiting and ready.empty():
                    # one call at a time if this process does the calls (n_calls is 0), and so that
                    # a task that may be why workers were lost runs alone
                    most_running = 1 if self._has_suspect() else max(1, n_calls)
                    if len(self.running) >= most_running:
                        break
                    future = self._send_call(executor, self._take_next_tasks(n_calls))
                    future.add_done_callback(ready.put)
                future = ready.get()
                # the call counts as running until its results, or its loss, have been taken in
                self._receive_results(future, self.running[future])
                del self.running[future]
        finally:
            self._keep_finished()

    def _send_call(self, executor: Executor, indices: list[int]) -> Future[list[StepResult]]:
        """Give the next steps of the tasks ``indices`` to ``executor`` as one call, which then
        counts as running, and return the future of its results.

        Raises :class:`~granphon.base.errors.GranphonError`, with the task that may be the reason,
        if the executor takes no more work because workers were lost.
        """
        orders = [(self.tasks[index], self.begun.get(index)) for index in indices]
        added = list_added("observable")
        with naming_lost_workers(self._name_suspects(indices[0])):
            future = executor.submit(advance, orders, packages(), added)
        self.running[future] = indices
        return future

    def _keep_finished(self) -> None:
        """Keep the results of calls that come within ``_LAST_SECONDS``, after an error or an
        interruption, and cancel the calls that have not begun by then. Other calls are left alone.
        """
        wait(self.running, _LAST_SECONDS)
        for future, indices in self.running.items():
            # cancel() has no effect on a call that is running or done
            was_cancelled = future.cancel() or future.cancelled()
            is_done = not was_cancelled and future.done()
            if is_done and future.exception() is None:
                # An error of the store may be the very error that is being raised.
                with suppress(OutputError):
                    for index, result in zip(indices, future.result(), strict=False):
                        self.store.append(self.tasks[index].name, result.entry)

    def _has_suspect(self) -> bool:
        """Whether the next of the tasks that wait, of which there is one or more, or a task under
        way is a suspect: a task with which one worker less than :data:`MOST_LOSSES` has been lost,
        or more, and which is to run alone.
        """
        suspects = {index for index, losses in self.losses.items() if losses >= MOST_LOSSES - 1}
        return not suspects.isdisjoint(chain([self.waiting[0]], *self.running.values()))

    def _name_suspects(self, next_index: int) -> str:
        """Return words for the tasks with which workers were lost: the name of the first of them,
        and how many others there are. If no worker was lost, return the name of the task of the
        index ``next_index``.
        """
        suspects = sorted(self.losses) or [next_index]
        name = str(self.tasks[suspects[0]].where)
        n_others = len(suspects) - 1
        if not n_others:
            return name
        others = "another task" if n_others == 1 else f"one of {n_others} other tasks"
        return f"{name}, or {others}"

    def _take_next_tasks(self, n_calls: int) -> list[int]:
        """Remove the tasks of the next call from those that wait, and return their indices: a
        single task unless the tasks are known to be short and no worker was lost with them.

        ``n_calls`` calls are under way at a time; 0 if this process does the calls. A call takes at
        most half of the waiting tasks that each worker would have if they were shared out: calls
        become shorter towards the end, and all workers end at about the same time.
        """
        n_most = 1
        if n_calls:
            n_most = max(1, len(self.waiting) // (2 * n_calls))
        indices = list[int]()
        seconds = 0.0  # of all tasks of the call, infinite where a time is not known
        while self.waiting and len(indices) < n_most:
            index = self.waiting[0]
            if self.losses[index]:
                seconds = math.inf
            else:
                seconds += self.seconds.get(self.tasks[index].kind, math.inf)
            if indices and seconds > CALL_SECONDS:
                break
            indices.append(heappop(self.waiting))
        return indices

    def _receive_results(self, future: Future[list[StepResult]], indices: Sequence[int]) -> None:
        """Keep the results of the call ``future``, which was given the tasks ``indices``, count
        their steps (:meth:`_count_step`), and put back the tasks that the call has not come to: all
        of them if its worker was lost.

        Raises the error of a task; GranphonError if a scheduler does not answer, or if too many
        workers were lost (:meth:`_count_losses`); and OutputError if a result cannot be kept.
        """
        results: list[StepResult] = []
        try:
            results = future.result()
        except CancelledError:
            problem = "the scheduler does not answer any more"
            why = "It has ended, or the network has failed"
            mend = "What is finished is kept: run the same command again to continue"
            raise GranphonError(problem, why, mend) from None
        except Exception as error:  # BrokenProcessPool, or KilledWorker of dask
            if not isinstance(error, BrokenExecutor) and type(error).__name__ != "KilledWorker":
                raise
            # dask gives the call to allowed_failures more workers before it raises KilledWorker
            n_losses = getattr(error, "allowed_failures", 0) + 1
            self._count_losses(indices, n_losses)
        for index, result in zip(indices, results, strict=False):
            self.store.append(self.tasks[index].name, result.entry)
        # the call has ended before it came to the other tasks
        for index in indices[len(results) :]:
            heappush(self.waiting, index)
        for index, result in zip(indices, results, strict=False):
            self._count_step(index, result)

    def _count_losses(self, indices: Sequence[int], n_losses: int) -> None:
        """Add ``n_losses`` to the number of workers that were lost with each task of ``indices``;
        raise GranphonError if a single task is under way, and :data:`MOST_LOSSES` workers or more
        have been lost with it.
        """
        self.losses.update(dict.fromkeys(indices, n_losses))
        task_losses = self.losses[indices[0]]
        is_alone = len(self.running) == len(indices) == 1
        if is_alone and task_losses >= MOST_LOSSES:
            where = self.tasks[indices[0]].where
            problem = f"{where}: the worker process that did it has ended, {task_losses} times"
            mend = (
                "Give workers more memory, or take fewer --workers; run the same command"
                " again to continue"
            )
            raise GranphonError(problem, LOST_WORKER, mend) from None

    def _count_step(self, index: int, result: StepResult) -> None:
        """Take in the step of the task ``index`` that has given a ``result``: its time enters the
        mean of the task's kind, the task waits again if it has more steps, and the progress goes on
        by one.
        """
        task = self.tasks[index]
        # in this mean earlier steps count less and less, as the steps of a task take unequal times
        earlier_seconds = self.seconds.get(task.kind, result.seconds)
        self.seconds[task.kind] = 0.5 * (earlier_seconds + result.seconds)
        self.begun.pop(index, None)
        if result.steps < task.steps:
            self.begun[index] = result.entry
            heappush(self.waiting, index)
        self.step.advance()
