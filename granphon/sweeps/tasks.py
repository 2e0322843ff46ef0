"""Work that can run side by side, on any executor, and that an interruption does not undo.

A task is plain data that can be pickled, and its result a mapping of arrays that depends on the task alone; so tasks may
run anywhere and in any order. A long one is done in steps, and each step is kept.
"""

from __future__ import annotations

import hashlib
import io
import json
import os
import shutil
import stat
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from concurrent.futures import Executor, Future
from contextlib import contextmanager, suppress
from pathlib import Path
from queue import SimpleQueue
from typing import Any, Protocol
from zipfile import BadZipFile

import numpy as np
from numpy.typing import NDArray

from granphon.base.errors import FileExistsInRunError, InputError, OutputError, message
from granphon.base.progress import Progress, Step, silent
from granphon.base.reading import read_bytes
from granphon.base.staging import write_bytes
from granphon.base.text import show

__all__ = ["IDENTITY", "TaskResult", "Store", "Task", "open_store", "solve_all"]

#: the result of a task, or of its first steps; no array holds Python objects
TaskResult = dict[str, NDArray[Any]]
#: name of the file in a store that says which work its results belong to
IDENTITY = "identity.json"
#: largest number of differences between two works that a message names
_MOST_NAMED = 3


class Task(Protocol):
    """A piece of work, in one step or more."""

    @property
    def name(self) -> str:
        """Name of the file for the result: no task with another result has it, and it does not begin with a dot."""
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


# -- what is kept ---------------------------------------------------------------------------------------------------


class Store:
    """The results of finished tasks and steps, one file for each task in ``folder``; None keeps nothing.

    The folder is made when the first result is kept; its parent must exist. It belongs to one work, see :meth:`claim`;
    ``force`` lets another work discard its results. Files in it that hold no result are the user's, and stay.
    """

    def __init__(self, folder: Path | None = None, force: bool = False) -> None:
        self.folder, self.force = folder, force
        self._identity: bytes | None = None
        self._names: set[str] = set()
        self._home: tuple[int, int] | None = None

    def claim(self, identity: Mapping[str, Any] | None, names: Callable[[], Iterable[str]] = tuple) -> None:
        """Claim the store for the work that ``identity``, plain data, describes; None claims it for no work.

        Results that the store holds are used. Another work may have left them if all of them are among ``names``, the names
        of this work's tasks. They belong to this work once it keeps a result of its own.

        Raises
        ------
        OutputError : ``folder`` exists and is not a folder, or is a symbolic link.
        FileExistsInRunError : there is a result of another work that is not among ``names``, and ``force`` is off. If
            ``force`` is on, all results are discarded instead.
        """
        if self.folder is None:
            return
        self._check()
        self._home = _identify_folder(self.folder.parent)
        text = json.dumps(identity, sort_keys=True)
        mine, before, self._names = json.loads(text), self._read_identity(), set(names())
        if (identity is None or before != mine) and self._list_others():
            if not self.force:
                raise FileExistsInRunError(
                    message(
                        f"{self.folder} holds the finished part of another sweep, which was interrupted",
                        _explain_difference(before, mine),
                        "Run that sweep again to continue it, use --force (force=True, overwrite=True) to discard what it "
                        "has finished, or choose another folder",
                    )
                )
            self.clear()
        if identity is not None:
            data = {"digest": hashlib.sha256(text.encode()).hexdigest(), "sweep": mine}
            self._identity = json.dumps(data, indent=1).encode()

    def _check(self) -> None:
        """Raise OutputError if ``folder`` exists and is not a folder, or is a symbolic link."""
        if self.folder is None:
            return
        try:
            found = os.lstat(self.folder)
        except FileNotFoundError:
            return
        except OSError as error:
            raise OutputError(message(f"{self.folder} cannot be written: {error.strerror or error}")) from None
        if not stat.S_ISDIR(found.st_mode):
            what = "a symbolic link" if stat.S_ISLNK(found.st_mode) else "a file"
            why = "The finished parts of a sweep are kept in a folder of that name"
            raise OutputError(message(f"{self.folder} is {what}", why, "Move it away, or choose another folder"))

    def _read_identity(self) -> Any:
        """Return the identity of the work that left results there; None if it is not recorded, or is damaged."""
        with suppress(OSError, ValueError, KeyError, TypeError, RecursionError):
            data = json.loads(read_bytes(self.folder / IDENTITY)) if self.folder else {}
            if hashlib.sha256(json.dumps(data["sweep"], sort_keys=True).encode()).hexdigest() == data["digest"]:
                return data["sweep"]
        return None

    def _list_others(self) -> set[str]:
        """Return the names of the results that are there and are not this work's."""
        with suppress(OSError):
            there = set(os.listdir(self.folder)) if self.folder else set()
            return {name for name in there - self._names if self._read_data(name) is not None}
        return set()

    def _read_data(self, name: str) -> memoryview | None:
        """Return the content of the result of that name; None if there is none, or it is damaged."""
        if self.folder is None:
            return None
        try:
            raw = memoryview(read_bytes(self.folder / name))
        except (InputError, OSError):
            return None
        return raw[32:] if raw[:32] == _digest_result(name, raw[32:]) else None

    def read(self, task: Task) -> TaskResult | None:
        """Return the result of ``task`` or of its first steps; None if there is none, or it is damaged or another task's."""
        data = self._read_data(task.name)
        if data is None:
            return None
        try:
            with np.load(io.BytesIO(data), allow_pickle=False) as arrays:
                return dict(arrays)
        except (BadZipFile, EOFError, KeyError, OSError, ValueError):
            return None

    def write(self, task: Task, part: TaskResult) -> None:
        """Keep the result of ``task``, or of its first steps; :class:`~granphon.base.errors.OutputError` if that fails.

        It fails too if the parent of ``folder`` has been removed, or replaced by another folder: only the process that has
        locked that one may write there.
        """
        if self.folder is None:
            return
        stream = io.BytesIO()
        np.savez(stream, **part)  # type: ignore[arg-type]  # no array is called allow_pickle
        self._make()
        try:
            if self._identity is not None:
                write_bytes(self.folder / IDENTITY, self._identity)
                self._identity = None
            data = stream.getbuffer()  # no copy: results may be large
            write_bytes(self.folder / task.name, _digest_result(task.name, data), data)
        except BaseException:
            with suppress(OSError):  # a folder that is not empty stays
                self.folder.rmdir()
            raise

    def _make(self) -> None:
        """Make ``folder``, but not its parent."""
        if self.folder is None:
            return
        self._check()
        home = self.folder.parent
        try:
            if self._home not in (None, _identify_folder(home)):
                raise FileNotFoundError
            self.folder.mkdir(exist_ok=True)
        except FileNotFoundError:
            what, why = (
                f"{home} has been removed while a sweep was writing into it",
                "The parts that it had finished are gone",
            )
            raise OutputError(message(what, why, "Run the same command again: it starts from the beginning")) from None
        except OSError as error:
            raise OutputError(message(f"{self.folder} cannot be written: {error.strerror or error}")) from None

    def clear(self) -> None:
        """Delete every result, and the folder if nothing else is in it."""
        if self.folder is None or self.folder.is_symlink():
            return
        for name in self._names | self._list_others():
            _remove(self.folder / name)
        for left in self.folder.glob(".granphon-*/"):  # of a process that was killed while it wrote
            shutil.rmtree(left, ignore_errors=True)
        _remove(self.folder / IDENTITY)
        with suppress(OSError):  # it holds something of the user's
            self.folder.rmdir()


@contextmanager
def open_store(folder: Path | None, force: bool = False) -> Iterator[Store]:
    """Open a store in ``folder``, and clear it if the block ends well; after a failure its results stay, to go on from."""
    store = Store(folder, force)
    yield store
    store.clear()


def _digest_result(name: str, data: bytes | memoryview) -> bytes:
    # the name is part of it: the result of one task, renamed, does not pass for that of another
    found = hashlib.sha256(name.encode())
    found.update(data)
    return found.digest()


def _identify_folder(folder: Path) -> tuple[int, int] | None:
    """Return device and inode of a folder, which identify it whatever its name; None if it is not there."""
    with suppress(OSError):
        found = os.stat(folder)
        return found.st_dev, found.st_ino
    return None


def _remove(path: Path) -> None:
    with suppress(OSError):
        path.unlink()


def _explain_difference(there: Any, here: Any) -> str:
    """Say how the work there differs from the one here."""
    if here is None:
        return "The result of a single state would stand beside it"
    differences = "; ".join(_describe_differences(there, here))
    return f"They differ: {differences}" if there else "The folder does not say which sweep it belongs to"


def _describe_differences(there: Any, here: Any) -> list[str]:
    """Describe the first few places where plain data differ."""
    found = list(_find_differences(there, here, ""))
    more = len(found) - _MOST_NAMED
    return found[:_MOST_NAMED] + ([f"and {more} more"] if more > 0 else [])


def _find_differences(there: Any, here: Any, where: str) -> Iterator[str]:
    if isinstance(there, dict) and isinstance(here, dict):
        for key in [*there, *(key for key in here if key not in there)]:
            name = f"{where}.{key}" if where else str(key)
            if key not in here or key not in there:
                yield f"{name} is {'given' if key in there else 'not given'} there, and {'' if key in here else 'not '}here"
            else:
                yield from _find_differences(there[key], here[key], name)
    elif isinstance(there, list) and isinstance(here, list):
        if len(there) != len(here):
            yield f"{where} has {len(there)} values there, and {len(here)} here"
        else:
            for index, (one, other) in enumerate(zip(there, here, strict=True)):
                yield from _find_differences(one, other, f"{where}[{index}]")
    elif there != here:
        yield f"{where} is {show(there)} there, and {show(here)} here"


# -- doing it -------------------------------------------------------------------------------------------------------


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
    executor : any executor with the interface of :class:`concurrent.futures.Executor`; None does one task after the other.
        It is not shut down.
    store : where each result is kept as soon as it is found.

    An error of a task is raised as it is. Then, and on an interruption, tasks that have not begun are cancelled, and results
    of finished ones are kept.
    """
    known = store or Store()
    parts = {i: part for i, task in enumerate(tasks) if (part := known.read(task)) is not None}
    with progress.step(label, sum(task.steps for task in tasks)) as step:
        step.advance(sum(tasks[i].done(part) for i, part in parts.items()))
        work = _Work(tasks, parts, known, step)
        if executor is None:
            work.run_in_turn()
        else:
            work.run_side_by_side(executor)
    return [parts[i] for i in range(len(tasks))]


class _Work:
    """Tasks under way; ``parts`` are their results so far, by index."""

    def __init__(self, tasks: Sequence[Task], parts: dict[int, TaskResult], store: Store, step: Step) -> None:
        self.tasks, self.parts, self.store, self.step = tasks, parts, store, step

    def _is_left(self, index: int) -> bool:
        return index not in self.parts or self.tasks[index].done(self.parts[index]) < self.tasks[index].steps

    def _keep(self, index: int, part: TaskResult) -> None:
        self.store.write(self.tasks[index], part)
        self.parts[index] = part
        self.step.advance()

    def _rescue(self, index: int, part: TaskResult) -> None:
        """Keep a result that was finished when an error or an interruption came."""
        with suppress(OutputError):  # this may be the very error that is being raised
            self.store.write(self.tasks[index], part)

    def run_in_turn(self) -> None:
        """Do one task after the other, here."""
        for index, task in enumerate(self.tasks):
            while self._is_left(index):
                part = task.solve(self.parts.get(index))
                try:
                    self._keep(index, part)
                except BaseException:
                    self._rescue(index, part)
                    raise

    def run_side_by_side(self, executor: Executor) -> None:
        """Have the tasks done side by side; the next step of a task is submitted once the one before is kept."""
        running: dict[Future[TaskResult], int] = {}
        ready: SimpleQueue[Future[TaskResult]] = SimpleQueue()

        def submit(index: int) -> None:
            future = executor.submit(self.tasks[index].solve, self.parts.get(index))
            running[future] = index
            future.add_done_callback(ready.put)

        try:
            for index in filter(self._is_left, range(len(self.tasks))):
                submit(index)
            while running:
                future = ready.get()
                index = running[future]
                self._keep(index, future.result())
                del running[future]
                if self._is_left(index):
                    submit(index)
        finally:
            for future in running:
                future.cancel()
            for future, index in running.items():
                if future.done() and not future.cancelled() and future.exception() is None:
                    self._rescue(index, future.result())
