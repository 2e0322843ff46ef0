"""Worker processes that stop when they are told to, and do not outlive the process that has started them."""

from __future__ import annotations

import multiprocessing
import os
import signal
import threading
from collections.abc import Iterator
from concurrent.futures import BrokenExecutor, Executor, ProcessPoolExecutor
from contextlib import contextmanager
from multiprocessing.context import SpawnContext, SpawnProcess
from typing import Any

from granphon.errors import GranphonError, message

__all__ = ["worker_processes"]


class _Worker(SpawnProcess):
    def start(self) -> None:
        """Start with the signals of the terminal held back, which are for the process that we are in.

        A process inherits what is held back, so that no moment is left in which it would end with a traceback.
        """
        if not hasattr(signal, "pthread_sigmask"):
            super().start()
            return
        before = signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT, signal.SIGTERM})
        try:
            super().start()
        finally:
            signal.pthread_sigmask(signal.SIG_SETMASK, before)


class _Context(SpawnContext):
    """Spawned, not forked: numerical libraries may have threads by now."""

    def __init__(self) -> None:
        super().__init__()
        self.started: list[_Worker] = []

    def Process(self, *args: Any, **kwargs: Any) -> _Worker:  # type: ignore[override]  # its name there
        worker = _Worker(*args, **kwargs)
        self.started.append(worker)
        return worker


def _begin() -> None:
    """What a worker does first."""
    # where signals cannot be held back; the process that has started us ends us
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    parent = multiprocessing.parent_process()
    if parent is not None:
        threading.Thread(target=_end_with, args=(parent,), daemon=True).start()


def _end_with(parent: Any) -> None:
    parent.join()
    os._exit(1)


@contextmanager
def worker_processes(count: int) -> Iterator[Executor | None]:
    """An executor of that many processes; None for one, which is this.

    Whatever ends the block early ends the processes at once, in the middle of what they do. They end too when this process
    does. :class:`~granphon.errors.GranphonError` if one has been killed.
    """
    if count == 1:
        yield None
        return
    context = _Context()
    executor = ProcessPoolExecutor(count, context, _begin)
    try:
        yield executor
    except BaseException as error:
        executor.shutdown(wait=False, cancel_futures=True)
        for worker in context.started:
            if worker.is_alive():
                worker.kill()
        if isinstance(error, BrokenExecutor):
            what, why = "a worker process has ended", "It was killed, or ran out of memory"
            raise GranphonError(message(what, why, "Take fewer --workers; the same command again goes on")) from None
        raise
    executor.shutdown()
