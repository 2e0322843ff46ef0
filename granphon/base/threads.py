"""Threads and workers: pieces of numerical work that do not depend on each other, on all processors
that this process may use; and the signals that stop this process.

Other threads go on while numpy works on a large array. The libraries of linear algebra behind numpy
start threads of their own for each product, which wait for each other longer than a small product
takes: :func:`single_products` holds each library to one thread.
"""

from __future__ import annotations

import multiprocessing
import os
import signal
import threading
from collections.abc import Callable, Iterable, Iterator
from concurrent.futures import BrokenExecutor, ThreadPoolExecutor
from contextlib import ExitStack, contextmanager, suppress
from typing import Any, TypeVar

from granphon.base.errors import GranphonError, InputError, brief

Item = TypeVar("Item")
Result = TypeVar("Result")

#: why a worker process ends before its work is done
LOST_WORKER = "It was killed, or ran out of memory"
#: signals with which a terminal or a batch system stops this process
_STOPS: tuple[int, ...] = (signal.SIGINT, signal.SIGTERM)


def count_processors() -> int:
    """Return the number of processors that this process may use: one in a worker process, because
    other workers use the other processors.
    """
    if multiprocessing.parent_process() is not None:
        return 1
    if hasattr(os, "sched_getaffinity"):
        return len(os.sched_getaffinity(0))
    return os.cpu_count() or 1


def share_out(function: Callable[[Item], Result], items: Iterable[Item]) -> list[Result]:
    """Return the results of a function for all items, in the order of the items. The items are
    shared by at most as many threads as there are processors that this process may use. Where one
    thread would do, no thread is started. If the function fails, the error of the first of the
    failing items is raised, and items that no thread has begun are left out.
    """
    all_items = list(items)
    n_threads = min(count_processors(), len(all_items))
    if n_threads < 2:
        return [function(item) for item in all_items]
    with ThreadPoolExecutor(n_threads) as executor:
        return list(executor.map(function, all_items))


def require_executor(executor: Any) -> None:
    """Raise :class:`~granphon.base.errors.InputError` for an ``executor``, the argument of a public
    call, that is neither None nor has the method ``submit``.
    """
    if executor is not None and not callable(getattr(executor, "submit", None)):
        problem = f"executor is {brief(executor)}"
        raise InputError(problem, mend="Give a concurrent.futures.Executor, or none")


@contextmanager
def naming_lost_workers(where: str) -> Iterator[None]:
    """Raise :class:`~granphon.base.errors.GranphonError` where an executor that the user gave has
    lost a worker in the block, and is broken.

    ``where`` names the work in the message.
    """
    try:
        yield
    except BrokenExecutor:
        problem = f"{where}: a worker of the executor has ended, and with it all others"
        mend = "Give workers more memory, or take fewer"
        raise GranphonError(problem, LOST_WORKER, mend) from None


@contextmanager
def single_products() -> Iterator[None]:
    """Hold the libraries of linear algebra to one thread during the block, in all threads of this
    process; without threadpoolctl the block runs as it is.
    """
    with ExitStack() as stack:
        with suppress(ImportError):
            from threadpoolctl import threadpool_limits

            stack.enter_context(threadpool_limits(1))
        yield


@contextmanager
def hold_back_signals() -> Iterator[None]:
    """Hold back the signals that stop this process until the end of the block, where the first of
    them takes its usual course. Where the system has masks of signals, processes started in the
    block never take these signals.

    The mask of this thread does not suffice: another thread, with an open mask, may take the
    signal, and Python then runs the handler in the main thread. So the handlers are replaced too,
    which the main thread alone may do: in another thread the mask is all there is.
    """
    arrived_signals = list[int]()
    handlers = dict[int, Any]()
    if threading.current_thread() is threading.main_thread():  # no other thread may set handlers
        for number in _STOPS:
            handler = signal.getsignal(number)
            if handler is not None:  # None: a handler that Python has not set, and cannot restore
                handlers[number] = handler
    has_masks = hasattr(signal, "pthread_sigmask")
    old_mask = signal.pthread_sigmask(signal.SIG_BLOCK, ()) if has_masks else None
    try:
        for number in handlers:
            signal.signal(number, lambda arrived, _: arrived_signals.append(arrived))
        if old_mask is not None:  # threads and processes that are started now inherit the new mask
            signal.pthread_sigmask(signal.SIG_BLOCK, _STOPS)
        yield
    finally:
        if old_mask is not None:
            signal.pthread_sigmask(signal.SIG_SETMASK, old_mask)
        for number, handler in handlers.items():
            signal.signal(number, handler)
        if arrived_signals:  # raised once, however many came
            signal.raise_signal(arrived_signals[0])
