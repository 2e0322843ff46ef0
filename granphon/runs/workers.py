"""Worker processes that stop when they are told to, and do not outlive the process that has started them.

Each is a pool of the standard library with one process, so that nothing is shared among workers: one that is killed, at any
moment, takes the work of no other with it, nor a lock for which others would wait.
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

from granphon.base.errors import GranphonError, message
from granphon.base.text import versions

#: signals with which a terminal or a batch system stops this process
_STOPS = (signal.SIGINT, signal.SIGTERM)


@cache
def packages() -> dict[str, str]:
    """Versions, by name, of the packages that determine the numbers: those of every worker must be the same."""
    return versions("numpy", "scipy")


def require_packages(worker: str, there: Mapping[str, str | None], here: Mapping[str, str]) -> None:
    """Raise :class:`~granphon.base.errors.GranphonError` if a worker has another version of a package than this process."""
    for name, version in here.items():
        if (found := there.get(name)) != version:
            has = f"has no {name}" if found is None else f"has {name} {found}"
            what, why = f"{worker} {has}, and this process has {name} {version}", "Its numbers could be others"
            raise GranphonError(message(what, why, "Install the same version on all machines"))


@contextmanager
def hold_back_signals() -> Iterator[None]:
    """Hold back the signals that stop this process until the end of the block; processes started in it never take them."""
    come, before = list[int](), dict[int, Any]()
    if threading.current_thread() is threading.main_thread():  # which alone handles signals
        before = {kind: handler for kind in _STOPS if (handler := signal.getsignal(kind)) is not None}
    mask = signal.pthread_sigmask(signal.SIG_BLOCK, ()) if hasattr(signal, "pthread_sigmask") else None
    try:
        for kind in before:
            signal.signal(kind, lambda number, _: come.append(number))
        if mask is not None:  # threads and processes inherit it
            signal.pthread_sigmask(signal.SIG_BLOCK, _STOPS)
        yield
    finally:
        if mask is not None:
            signal.pthread_sigmask(signal.SIG_SETMASK, mask)
        for kind, handler in before.items():
            signal.signal(kind, handler)
        for number in come[:1]:
            signal.raise_signal(number)


def start_tracker() -> None:
    """Start Python's process that removes the semaphores of pools and of dask after a kill of this one, without its warning.

    If this process has started it before, the warning stays; it is harmless, as they are removed.
    """
    if os.name == "posix":
        from multiprocessing import resource_tracker

        sys.warnoptions.append("ignore:resource_tracker")  # with which that process is started
        try:
            resource_tracker.ensure_running()
        finally:
            sys.warnoptions.pop()


def _end_with_parent() -> None:
    """Have a worker process end with the one that has started it, and leave interruptions to that one."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # where signals cannot be masked
    parent: Any = multiprocessing.parent_process()
    threading.Thread(target=lambda: (wait([parent.sentinel]), os._exit(0)), daemon=True).start()


def _call(fn: Callable[..., Any], *args: Any, **kwargs: Any) -> Any:
    """Call ``fn`` in a worker process; an error that cannot come back as it is comes back as its text."""
    try:
        return fn(*args, **kwargs)
    except Exception as error:
        try:
            pickle.loads(pickle.dumps(error))
        except Exception:
            raise RuntimeError(f"{type(error).__name__}: {error}") from error
        raise


def _kill(pool: Any) -> None:
    for process in list((pool._processes or {}).values()):
        process.kill()


class Workers(Executor):
    """An executor of ``most`` processes, each of which is started when there is work that no other is free to do.

    So there are never more than calls. They are spawned, not forked, as numerical libraries may have started threads by now.
    If one is killed, its calls have the error BrokenProcessPool, and another one is started for the next call.
    """

    def __init__(self, most: int) -> None:
        self._max_workers, self._pools = most, list[Any]()
        start_tracker()

    def submit(self, fn: Callable[..., Any], /, *args: Any, **kwargs: Any) -> Future[Any]:
        """Give ``fn`` to the worker with the fewest calls, and return the future of its result.

        Raises :class:`~granphon.base.errors.GranphonError` if a process is needed and cannot be started.
        """
        pool: Any = min(self._pools, key=lambda one: len(one._pending_work_items), default=None)
        if pool is None or (pool._pending_work_items and len(self._pools) < self._max_workers):
            try:
                with hold_back_signals():
                    pool = ProcessPoolExecutor(1, multiprocessing.get_context("spawn"), _end_with_parent)
                    try:
                        pool.submit(int)  # which starts the process
                    except Exception:
                        _kill(pool)
                        raise
                    # these ends of its pipes are the process's: if it is killed within a result, the rest is not waited for
                    pool._result_queue._writer.close()
                    pool._call_queue._reader.close()
                    self._pools.append(pool)
            except (OSError, RuntimeError) as error:  # too many processes, open files or threads
                why = getattr(error, "strerror", None) or error
                what = f"worker process {len(self._pools) + 1} cannot be started: {why}"
                raise GranphonError(message(what, mend="Take fewer --workers")) from None
        try:
            future: Future[Any] = pool.submit(_call, fn, *args, **kwargs)
        except BrokenProcessPool:  # it was killed
            self._pools.remove(pool)
            return self.submit(fn, *args, **kwargs)
        return future

    def shutdown(self, wait: bool = True, *, cancel_futures: bool = False) -> None:
        """Kill the processes at once, even in the middle of their work."""
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
        """Return the result of ``fn`` in a future."""
        future: Future[Any] = Future()
        future.set_result(fn(*args, **kwargs))
        return future
