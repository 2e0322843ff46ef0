"""Work that can run side by side, on any executor, and that an interruption does not undo.

A task is plain data that can be pickled, and its result a mapping of arrays that depends on the task alone; so tasks may
run anywhere and in any order. A long one is done in steps, and each step is kept. Short ones are sent to workers in batches,
which end after half a second; results come back as entries of the store, with their digests. If a batch is not to go on, its
worker hands over what it has finished, in the middle of its work.
"""

from __future__ import annotations

import os
import time
from collections import Counter, deque
from collections.abc import Sequence
from concurrent.futures import Executor, Future, wait
from contextlib import suppress
from dataclasses import dataclass, field
from queue import Empty, SimpleQueue
from threading import get_ident
from typing import NamedTuple, Protocol
from uuid import uuid4

from granphon.base.errors import GranphonError, OutputError, message
from granphon.base.progress import Progress, Step, silent
from granphon.sweeps.schedulers import adapt
from granphon.sweeps.store import HEAD, Store, TaskResult, decode, encode, name_of
from granphon.sweeps.workers import WorkerLost

__all__ = ["Done", "Task", "carry_out", "hand_over", "solve_all"]

#: time after which a worker begins nothing more of a batch, s
BATCH_SECONDS = 0.5
#: greatest number of tasks in a batch
MOST_TOGETHER = 2000
#: number of batches that are sent for each worker: one that it works at, and one that waits there
_AHEAD = 2
#: number of workers that are lost with a task before it counts as the reason; after two it is sent alone
MOST_LOSSES = 3
#: longest time for which a result is waited for before the executor is asked for its workers again, s
_LOOK_SECONDS = 2.0
#: longest time for which batches under way are waited for after an error or an interruption, s
_PATIENCE = 1.0


class Task(Protocol):
    """A piece of work, in one step or more."""

    @property
    def name(self) -> str:
        """Name under which the result is kept: one line, not empty; no task with another result has it."""
        ...

    @property
    def where(self) -> str:
        """Name of the task in messages."""
        ...

    @property
    def kind(self) -> str:
        """Tasks of one kind take similar times."""
        ...

    @property
    def memory(self) -> float:
        """Memory that a process needs for the task, about, bytes; 0 if it is little."""
        ...

    @property
    def steps(self) -> int:
        """Number of steps that the task takes."""
        ...

    def done(self, part: TaskResult) -> int:
        """Return the number of steps that ``part`` contains."""
        ...

    def solve(self, begun: TaskResult | None = None) -> TaskResult:
        """Do the next step after ``begun``, or the first, and return both together; after the last step, the result."""
        ...


# -- in a worker ----------------------------------------------------------------------------------------------------


class Done(NamedTuple):
    """What a worker has done of a task: the entry of its result, the number of steps in it, and s for each new step."""

    entry: bytes
    steps: int
    seconds: float


@dataclass
class _Batch:
    """What has been done of a batch, and the work that it belongs to; ``at`` is an unfinished task with its steps so far."""

    work: str
    done: list[Done] = field(default_factory=list)
    at: tuple[Task, TaskResult] | None = None
    stopped: bool = False


#: the batches that are under way in this process, by the thread that carries them out
_UNDER_WAY: dict[int, _Batch] = {}


def hand_over(work: str) -> list[tuple[str, bytes]]:
    """Return name and entry of what has been done of the batches of a work here, and let them begin nothing more."""
    found = list[tuple[str, bytes]]()
    for batch in list(_UNDER_WAY.values()):
        if batch.work == work:
            batch.stopped = True
            found += [(name_of(one.entry[HEAD:]), one.entry) for one in list(batch.done)]
            if (at := batch.at) is not None:
                found.append((at[0].name, encode(at[0].name, at[1])))
    return found


def carry_out(orders: Sequence[tuple[Task, TaskResult | None]], work: str = "", limit: float = BATCH_SECONDS) -> list[Done]:
    """Do tasks of a ``work``, each with its steps so far, in turn, and return what has been done of the first ones.

    After ``limit`` (s) nothing more is begun; the first step of the first task always is. An error of that step is raised.
    An error of a later one ends the batch before its task: it will come again, in a batch in which that task is the first.
    So does :func:`hand_over`, which another thread calls.
    """
    batch = _UNDER_WAY[get_ident()] = _Batch(work)
    try:
        _carry_out(orders, batch, limit)
    finally:
        del _UNDER_WAY[get_ident()]
    return batch.done


def _carry_out(orders: Sequence[tuple[Task, TaskResult | None]], batch: _Batch, limit: float) -> None:
    done, begun = batch.done, time.perf_counter()
    for task, part in orders:
        new, before = 0, time.perf_counter()
        while (before - begun <= limit and not batch.stopped) or not (done or new):
            try:
                part = task.solve(part)
            except Exception:
                if not (done or new):
                    raise
                limit = -1.0
                break
            new, now, batch.at = new + 1, time.perf_counter(), (task, part)
            if task.done(part) >= task.steps or now - begun > limit or batch.stopped:
                break
        if part is None or not new:
            break
        done.append(Done(encode(task.name, part), task.done(part), (time.perf_counter() - before) / new))
        batch.at = None


# -- in the process that has them done ------------------------------------------------------------------------------


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
    label : name of the work for ``progress``, which is told of each step once its result has been kept.
    tasks : the tasks; those whose results ``store`` holds are not done again, nor are steps that it holds.
    executor : any executor with the interface of :class:`concurrent.futures.Executor`, that of a dask client among them;
        None does one task after the other. It is not shut down.
    store : where each result is kept as soon as it is found.

    An error of a task is raised as it is. A task whose worker is lost is done again; if that happens to it thrice,
    :class:`~granphon.base.errors.GranphonError` names it. After an error, and on an interruption, tasks that have not begun
    are cancelled, workers hand over what they have finished of a batch, and results that come within a second are kept.
    """
    known = store or Store()
    with progress.step(label, sum(task.steps for task in tasks)) as step:
        work = _Work(tasks, known, step)
        if executor is None:
            work.run_in_turn()
        else:
            with adapt(executor) as adapted:
                work.run_side_by_side(adapted)
    return [_read(task, known) for task in tasks]


def _read(task: Task, store: Store) -> TaskResult:
    """Return the result of a finished task; if it has been damaged meanwhile, it is found again."""
    part = store.read(task.name)
    while part is None or task.done(part) < task.steps:
        part = task.solve(part)
    return part


def count_workers(executor: Executor) -> int:
    """Return the number of workers that an executor has now, at least 1; that of the processors if it does not say."""
    known = getattr(executor, "size", getattr(executor, "_max_workers", None))
    return max(int(known), 1) if isinstance(known, int) else os.cpu_count() or 1


class _Work:
    """Tasks under way: ``left`` are those that are not finished and not sent, and ``begun`` the steps so far of some."""

    def __init__(self, tasks: Sequence[Task], store: Store, step: Step) -> None:
        self.tasks, self.store, self.step = tasks, store, step
        self.left, self.begun = deque[int](), dict[int, TaskResult]()
        #: time of a step of each kind of task, s; and how often a worker was lost with a task
        self._seconds: dict[str, float] = {}
        self._losses = Counter[int]()
        found = 0
        for index, task in enumerate(tasks):
            part = store.read(task.name) if task.name in store else None
            steps = 0 if part is None else task.done(part)
            found += steps
            if part is None or steps < task.steps:
                self.left.append(index)
                self.begun |= {} if part is None else {index: part}
        step.advance(found)  # also if nothing was: the clock of the progress begins here

    def run_in_turn(self) -> None:
        """Do one task after the other, here."""
        while self.left:
            index = self.left.popleft()
            task, part = self.tasks[index], self.begun.pop(index, None)
            while part is None or task.done(part) < task.steps:
                part = task.solve(part)
                entry = encode(task.name, part)
                try:
                    self.store.append(task.name, entry)
                    self.step.advance()
                except BaseException:
                    self._rescue(index, entry)
                    raise

    def _rescue(self, index: int, entry: bytes) -> None:
        """Keep a result that was finished when an error or an interruption came."""
        with suppress(OutputError):  # this may be the very error that is being raised
            self.store.append(self.tasks[index].name, entry)

    def run_side_by_side(self, executor: Executor) -> None:
        """Have the tasks done side by side, in batches of which a few are under way for each worker."""
        running: dict[Future[list[Done]], list[int]] = {}
        ready: SimpleQueue[Future[list[Done]]] = SimpleQueue()
        if (require := getattr(executor, "require", None)) is not None:
            require([self.tasks[index] for index in self.left])
        work = uuid4().hex
        try:
            while self.left or running:
                workers = count_workers(executor)
                while self.left and len(running) < _AHEAD * workers + 1:
                    indices = self._take(workers)
                    orders = [(self.tasks[index], self.begun.get(index)) for index in indices]
                    try:
                        future = executor.submit(carry_out, orders, work)
                    except BaseException:
                        self.left.extendleft(reversed(indices))
                        raise
                    running[future] = indices
                    future.add_done_callback(ready.put)
                try:
                    future = ready.get(timeout=_LOOK_SECONDS)
                except Empty:
                    continue  # and look at the workers again
                indices = running[future]
                try:
                    self._keep(indices, future.result())
                except WorkerLost as loss:
                    self._send_again(indices, loss)
                del running[future]
        finally:
            for future in running:
                future.cancel()
            late, end = [future for future in running if not future.cancelled()], time.monotonic() + _PATIENCE
            if late and (ask := getattr(executor, "ask", None)) is not None:
                waiting = {self.tasks[index].name: index for future in late for index in running[future]}
                for name, entry in (one for found in ask(hand_over, work) for one in found):
                    if name in waiting:
                        self._rescue(waiting[name], entry)
            wait(late, max(end - time.monotonic(), 0.0))
            for future in late:
                if future.done() and future.exception() is None:
                    for index, one in zip(running[future], future.result(), strict=False):
                        self._rescue(index, one.entry)

    def _take(self, workers: int) -> list[int]:
        """Take the tasks of the next batch: as many as half a second is enough for, and one alone if that is not known.

        Towards the end batches become smaller, so that all workers end at about the same time.
        """
        most = min(MOST_TOGETHER, max(1, len(self.left) // (_AHEAD * workers)))
        batch, seconds = list[int](), 0.0
        while self.left and len(batch) < most and seconds < BATCH_SECONDS:
            index = self.left[0]
            task = self.tasks[index]
            about = self._seconds.get(task.kind)
            alone = about is None or self._losses[index] > 1
            if batch and alone:
                break
            batch.append(self.left.popleft())
            if about is None or alone:
                break
            part = self.begun.get(index)
            seconds += about * (task.steps - (0 if part is None else task.done(part)))
        return batch

    def _keep(self, indices: Sequence[int], done: Sequence[Done]) -> None:
        """Keep what a batch has brought, and put back what is left of it."""
        for index, one in zip(indices, done, strict=False):
            self.store.append(self.tasks[index].name, one.entry)
        self.left.extendleft(reversed(indices[len(done) :]))
        for index, one in zip(indices, done, strict=False):
            task, part = self.tasks[index], self.begun.pop(index, None)
            self._seconds[task.kind] = 0.5 * (self._seconds.get(task.kind, one.seconds) + one.seconds)
            if one.steps < task.steps:
                self.begun[index] = decode(one.entry)
                self.left.append(index)
            self.step.advance(one.steps - (0 if part is None else task.done(part)))

    def _send_again(self, indices: Sequence[int], loss: WorkerLost) -> None:
        """Put back the tasks of a batch whose worker was lost; raise if it was so thrice, and one of them was alone."""
        self._losses.update(dict.fromkeys(indices, loss.times))
        index = indices[0]
        if len(indices) == 1 and self._losses[index] >= MOST_LOSSES:
            what = f"{self.tasks[index].where}: the worker process that did it has ended, {self._losses[index]} times"
            mend = "Give workers more memory, or take fewer --workers; run the same command again to continue"
            raise GranphonError(message(what, "It was killed, or ran out of memory", mend))
        self.left.extendleft(reversed(indices))
