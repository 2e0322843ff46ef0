"""Work that can run side by side, on any executor, and that an interruption does not undo.

A task is plain data that can be pickled, and its result a mapping of arrays that depends on the task alone; so tasks may
run anywhere and in any order.
"""

from __future__ import annotations

import hashlib
import io
import shutil
from collections.abc import Callable, Iterator, Mapping, Sequence
from concurrent.futures import Executor, Future, as_completed
from contextlib import contextmanager
from pathlib import Path
from typing import Any, Protocol
from zipfile import BadZipFile

import numpy as np
from numpy.typing import NDArray

from granphon.errors import InputError
from granphon.progress import Progress, silent
from granphon.reading import read_bytes
from granphon.staging import write_bytes

__all__ = ["Part", "Store", "Task", "kept", "solve_all"]

#: the result of a task; no array holds Python objects
Part = dict[str, NDArray[Any]]


class Task(Protocol):
    """A piece of work."""

    @property
    def name(self) -> str:
        """A file name that no task with another result has."""
        ...

    def solve(self) -> Part:
        """Do it."""
        ...


class Store:
    """The results of finished tasks, one file each in ``folder``, made when the first is kept; None keeps nothing."""

    def __init__(self, folder: Path | None = None) -> None:
        self.folder = folder

    def read(self, task: Task) -> Part | None:
        """The result of ``task``, or None if there is none, or one that is damaged or another task's."""
        if self.folder is None:
            return None
        try:
            raw = read_bytes(self.folder / task.name)
            digest, data = raw[:32], raw[32:]
            if digest != _digest(task, data):
                return None
            with np.load(io.BytesIO(data), allow_pickle=False) as arrays:
                return dict(arrays)
        except (InputError, BadZipFile, EOFError, KeyError, OSError, ValueError):
            return None

    def write(self, task: Task, part: Part) -> None:
        """Keep the result of ``task``; :class:`~granphon.errors.OutputError` if that fails."""
        if self.folder is None:
            return
        stream = io.BytesIO()
        np.savez(stream, **part)  # type: ignore[arg-type]  # no array is called allow_pickle
        write_bytes(self.folder / task.name, _digest(task, stream.getvalue()) + stream.getvalue())

    def clear(self) -> None:
        """Forget every result."""
        if self.folder is not None:
            shutil.rmtree(self.folder, ignore_errors=True)


@contextmanager
def kept(folder: Path | None, resume: bool) -> Iterator[Store]:
    """A store in ``folder`` that is cleared when the block has ended well; what a failure leaves is there to ``resume``.

    Without ``resume`` it begins empty.
    """
    store = Store(folder)
    if not resume:
        store.clear()
    yield store
    store.clear()


def _digest(task: Task, data: bytes) -> bytes:
    # of the name too: a file that was renamed is another task's
    return hashlib.sha256(task.name.encode() + data).digest()


def solve_all(
    label: str,
    tasks: Sequence[Task],
    executor: Executor | None = None,
    progress: Progress = silent,
    store: Store | None = None,
) -> list[Part]:
    """The results of ``tasks`` in their order, whichever is finished first.

    Parameters
    ----------
    label : what ``progress`` calls the work; it is told of each task when its result has been kept.
    tasks : those that ``store`` has are not done again.
    executor : any that follows :class:`concurrent.futures.Executor`; None does one task after the other. It is not shut
        down.
    store : where each result is kept as soon as it is there.

    An error of a task is raised as it is. Then, and on an interruption, tasks that have not begun are cancelled.
    """
    known = store or Store()
    parts = {i: part for i, task in enumerate(tasks) if (part := known.read(task)) is not None}
    missing = [i for i in range(len(tasks)) if i not in parts]
    with progress.step(label, len(tasks)) as step:
        step.advance(len(parts))

        def keep(index: int, part: Part) -> None:
            known.write(tasks[index], part)
            parts[index] = part
            step.advance()

        if executor is None:
            for i in missing:
                keep(i, tasks[i].solve())
        else:
            _spread_out({i: tasks[i] for i in missing}, executor, keep)
    return [parts[i] for i in range(len(tasks))]


def _spread_out(tasks: Mapping[int, Task], executor: Executor, keep: Callable[[int, Part], None]) -> None:
    futures: dict[Future[Part], int] = {}
    try:
        for index, task in tasks.items():
            futures[executor.submit(task.solve)] = index
        for future in as_completed(futures):
            keep(futures[future], future.result())
    finally:
        for future in futures:
            future.cancel()
