"""Worker processes that stop when they are told to, and do not outlive the process that has started
them.

Each is a pool of the standard library with one process, so that nothing is shared among workers:
one that is killed, at any moment, takes the work of no other with it, nor a lock for which others
would wait.

A scheduler of dask on other machines is one more executor, that of its client. Processors are
counted, and errors of killed workers are worded, in :mod:`granphon.base.threads`, as media need
both.
"""

from __future__ import annotations

import multiprocessing
import os
import pickle
import signal
import sys
import threading
from collections.abc import Callable, Iterator, Mapping
from concurrent.futures import Executor, Future, ProcessPoolExecutor
from concurrent.futures.process import BrokenProcessPool
from contextlib import contextmanager
from functools import cache
from multiprocessing.connection import wait
from typing import Any

from granphon.base.errors import GranphonError, InputError, require_installed
from granphon.base.text import versions
from granphon.base.threads import hold_back_signals

#: time in which a scheduler must answer, s
_ANSWER_SECONDS = 5.0
#: calls that are under way on an executor which does not say how many workers it has
_CALLS_ELSEWHERE = 256


@cache
def packages() -> dict[str, str]:
    """Return the versions, by name, of the packages that determine the numbers of a result; every
    worker must have the same versions. It is one dictionary at all calls, which no caller changes.
    """
    return versions("numpy", "scipy")


def require_packages(worker: str, package_versions: Mapping[str, str]) -> None:
    """Raise :class:`~granphon.base.errors.GranphonError`, with the name of the ``worker``, which is
    this process, if it has another version of a package than the ``package_versions`` by name.
    """
    installed = packages()
    for name, version in package_versions.items():
        if installed[name] != version:
            problem = (
                f"{worker} has {name} {installed[name]}, and the sweep was begun with {version}"
            )
            why = "Its numbers could be others"
            raise GranphonError(problem, why, "Install the same version on all machines")


def _start_resource_tracker() -> None:
    """Start multiprocessing's resource tracker with its warning about leaked semaphores off.

    The tracker removes the semaphores of pools if this process is killed. A tracker that runs
    already keeps its warning.
    """
    if os.name == "posix":
        from multiprocessing import resource_tracker

        # the tracker is spawned with these options
        sys.warnoptions.append("ignore:resource_tracker")
        try:
            resource_tracker.ensure_running()
        finally:
            sys.warnoptions.pop()


def _end_with_parent() -> None:
    """Have this process, a worker, end as soon as its parent process has ended, even if the parent
    was killed, and ignore interruptions, to which the parent answers. A thread waits for the
    parent's end.
    """
    # masks hold interruptions back already, but not on every system
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    parent: Any = multiprocessing.parent_process()

    def end_when_parent_has_ended() -> None:
        """Wait until the parent process has ended, and end this process."""
        wait([parent.sentinel])
        os._exit(0)

    threading.Thread(target=end_when_parent_has_ended, daemon=True).start()


def _call(fn: Callable[..., Any], *args: Any, **kwargs: Any) -> Any:
    """Return the result of ``fn`` in a worker process, or raise its error; in place of an error
    that cannot be pickled, RuntimeError with the text of the error.
    """
    try:
        return fn(*args, **kwargs)
    except Exception as error:
        try:
            pickle.loads(pickle.dumps(error))
        except Exception:
            raise RuntimeError(f"{type(error).__name__}: {error}") from error
        raise


def _kill(pool: Any) -> None:
    """Kill the processes of a pool."""
    for process in list((pool._processes or {}).values()):
        process.kill()


def _start_pool() -> Any:
    """Return a pool of one process, which has been started; raises OSError or RuntimeError if no
    process can be started.
    """
    spawning = multiprocessing.get_context("spawn")
    pool: Any = ProcessPoolExecutor(1, spawning, initializer=_end_with_parent)
    try:
        pool.submit(int)  # a pool starts its process with the first call
    except Exception:
        _kill(pool)
        raise
    # The worker alone holds these ends of its pipes: if it is killed while it sends a result, the
    # pipes close, and this process does not wait for the rest of the result.
    pool._result_queue._writer.close()
    pool._call_queue._reader.close()
    return pool


class Workers(Executor):
    """An executor of at most ``most`` worker processes, one or more.

    A process is started when a call comes and all others are at work, so that there are never more
    processes than calls. Processes are spawned, not forked, as numerical libraries may have started
    threads by now. If a process is killed, its calls have the error BrokenProcessPool, and another
    process is started for the next call.
    """

    def __init__(self, most: int) -> None:
        self._max_workers = most
        self._pools = list[Any]()
        _start_resource_tracker()

    def submit(self, fn: Callable[..., Any], /, *args: Any, **kwargs: Any) -> Future[Any]:
        """Give the call of ``fn`` to the worker with the fewest calls, or to a new one if none is
        free and there may be more, and return the future of its result.

        Raises :class:`~granphon.base.errors.GranphonError` if a process is needed and cannot be
        started.
        """
        pool: Any = min(self._pools, key=lambda pool: len(pool._pending_work_items), default=None)
        is_free = pool is not None and not pool._pending_work_items
        if not is_free and len(self._pools) < self._max_workers:
            pool = self._add_pool()
        try:
            future: Future[Any] = pool.submit(_call, fn, *args, **kwargs)
        except BrokenProcessPool:
            # the process of the pool was killed: the call goes to another pool
            self._pools.remove(pool)
            return self.submit(fn, *args, **kwargs)
        return future

    def _add_pool(self) -> Any:
        """Start one more pool, and return it; GranphonError if no process can be started."""
        try:
            with hold_back_signals():
                pool = _start_pool()
                self._pools.append(pool)
        except (OSError, RuntimeError) as error:  # too many processes, open files or threads
            why = getattr(error, "strerror", None) or error
            problem = f"worker process {len(self._pools) + 1} cannot be started: {why}"
            raise GranphonError(problem, mend="Take fewer --workers") from None
        return pool

    def shutdown(self, wait: bool = True, *, cancel_futures: bool = False) -> None:
        """Kill the processes at once, even in the middle of their work, whatever ``wait`` and
        ``cancel_futures`` say; calls that have not begun are cancelled. A later call would start a
        process again.
        """
        with hold_back_signals():
            for pool in self._pools:
                _kill(pool)
            for pool in self._pools:
                pool.shutdown(cancel_futures=True)
            self._pools.clear()


class InProcess(Executor):
    """Does each call at once, in this process, and raises its error there."""

    _max_workers = 0

    def submit(self, fn: Callable[..., Any], /, *args: Any, **kwargs: Any) -> Future[Any]:
        """Call ``fn`` now, and return a future that has its result; raise its error here."""
        future: Future[Any] = Future()
        future.set_result(fn(*args, **kwargs))
        return future


def require_workers(workers: int | None, scheduler: str | None) -> None:
    """Raise :class:`~granphon.base.errors.InputError` if both a number of ``workers`` and the
    address of a ``scheduler`` are given, and :class:`~granphon.base.errors.MissingPackageError` for
    a scheduler if dask is not installed.
    """
    if scheduler is None:
        return
    if workers is not None:
        problem = "both --workers and --scheduler are given"
        raise InputError(problem, "The workers are those of the scheduler", "Leave one of them out")
    require_installed("A scheduler", "distributed")


@contextmanager
def open_executor(
    workers: int | None = None, scheduler: str | None = None
) -> Iterator[Executor | None]:
    """Yield the executor of ``workers`` processes, or that of the dask scheduler at an address;
    None if one process, this one, does the work.

    Processes that are started here end with the block, and with this process however it ends.
    Raises what :func:`require_workers` raises, and :class:`~granphon.base.errors.GranphonError` if
    the scheduler cannot be reached or processes cannot be started.
    """
    require_workers(workers, scheduler)
    if scheduler is not None:
        with _connect(scheduler) as client:
            # not pure: dask would hash the arguments of each call to find calls that are equal
            yield client.get_executor(pure=False)
    elif workers is not None and workers > 1:
        with Workers(workers) as executor:
            yield executor
    else:
        yield None


def _connect(scheduler: str) -> Any:
    """Return the client of dask for the scheduler at an address; raise
    :class:`~granphon.base.errors.GranphonError` if the scheduler cannot be reached.
    """
    from distributed import Client

    try:
        return Client(scheduler, timeout=_ANSWER_SECONDS, set_as_default=False)
    # dask asserts, without words, that its own thread is up in time, which it is not on a machine
    # that has stalled; a thread that the system refuses is a RuntimeError
    except (OSError, ValueError, TypeError, AssertionError, RuntimeError) as error:
        problem = f"the scheduler at {scheduler} cannot be reached"
        why = str(error) or "This machine is too busy: the thread of the client has not started"
        mend = "Is it running, and is the address one such as tcp://10.0.0.1:8786?"
        raise GranphonError(problem, why, mend) from None


def count_calls(executor: Executor) -> int:
    """Return how many calls are to be under way on an ``executor``: one for each of its workers, or
    ``_CALLS_ELSEWHERE`` if it does not say how many it has; 0 if this process does the calls, one
    after the other.
    """
    return int(getattr(executor, "_max_workers", _CALLS_ELSEWHERE))
