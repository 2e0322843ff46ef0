"""Worker processes that stop when they are told to, and do not outlive the process that has started them.

Each has a pipe to a thread of this process, and nothing is shared: no lock that a killed one could keep, and no semaphore
that would be left behind. A worker ends when its pipe is closed, whoever closes it, in the middle of what it does.
"""

from __future__ import annotations

import atexit
import multiprocessing
import os
import signal
import threading
import traceback
from collections.abc import Callable, Iterator
from concurrent.futures import BrokenExecutor, Executor, Future
from contextlib import contextmanager
from multiprocessing.connection import Connection
from queue import SimpleQueue
from typing import Any

from granphon.base.errors import GranphonError, message

__all__ = ["worker_processes"]

#: a function with its arguments, and the future of its result
_Order = tuple[Future[Any], tuple[Callable[..., Any], tuple[Any, ...], dict[str, Any]]]


# -- in a worker ----------------------------------------------------------------------------------------------------


def _serve(pipe: Connection) -> None:
    """Do what comes through the pipe, one after the other."""
    # where signals cannot be held back; the process that has started us ends us
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    orders: SimpleQueue[Any] = SimpleQueue()
    threading.Thread(target=_listen, args=(pipe, orders), daemon=True).start()
    while True:
        try:
            function, args, kwargs = orders.get()
            answer = (True, function(*args, **kwargs))
        except BaseException as error:
            answer = (False, _note_place(error))
        try:
            pipe.send(answer)
        except OSError:  # nobody listens any more
            return
        except Exception as error:  # it cannot be pickled
            pipe.send((False, _note_place(RuntimeError(f"{type(error).__name__}: {error}"))))


def _listen(pipe: Connection, orders: SimpleQueue[Any]) -> None:
    """Take orders while others are carried out; end the process when no more can come."""
    try:
        while True:
            orders.put(pipe.recv())
    except (OSError, EOFError):
        os._exit(0)
    except BaseException:
        traceback.print_exc()
        os._exit(1)


def _note_place(error: BaseException) -> BaseException:
    """``error`` with a note of the place where it arose, which is not sent with it."""
    error.add_note("In a worker process:\n" + "".join(traceback.format_tb(error.__traceback__)))
    return error


# -- in the process that has started them -----------------------------------------------------------------------------


#: what a terminal or a batch system stops us with
_STOPS = (signal.SIGINT, signal.SIGTERM)


@contextmanager
def _held_back() -> Iterator[None]:
    """Let the signals that stop us wait until the end of the block."""
    if threading.current_thread() is not threading.main_thread():  # which alone is interrupted
        yield
        return
    come: list[int] = []
    before = {kind: handler for kind in _STOPS if (handler := signal.getsignal(kind)) is not None}
    try:
        for kind in before:
            signal.signal(kind, lambda number, _: come.append(number))
        yield
    finally:
        for kind, handler in before.items():
            signal.signal(kind, handler)
        for number in come[:1]:
            signal.raise_signal(number)


@contextmanager
def _mask_interrupts() -> Iterator[None]:
    """Let processes that are started in the block never be stopped by a signal that is meant for us: they inherit that."""
    if not hasattr(signal, "pthread_sigmask"):
        yield
        return
    before = signal.pthread_sigmask(signal.SIG_BLOCK, _STOPS)
    try:
        yield
    finally:
        signal.pthread_sigmask(signal.SIG_SETMASK, before)


class _Workers(Executor):
    """An executor of processes, which are spawned, not forked: numerical libraries may have threads by now."""

    def __init__(self) -> None:
        self._orders: SimpleQueue[_Order | None] = SimpleQueue()
        self._processes: list[Any] = []

    def start(self, count: int) -> None:
        """Start so many."""
        context = multiprocessing.get_context("spawn")
        atexit.register(self.shutdown)  # before multiprocessing waits for them, should an interruption keep us from it
        with _held_back(), _mask_interrupts():
            if os.name == "posix":
                # the first start of a process would start it, and let signals through again
                from multiprocessing import resource_tracker

                resource_tracker.ensure_running()
                signal.pthread_sigmask(signal.SIG_BLOCK, _STOPS)
            for _ in range(count):
                ours, theirs = context.Pipe()
                process = context.Process(target=_serve, args=(theirs,), daemon=True)
                process.start()
                theirs.close()
                self._processes.append(process)
                # nobody waits for a daemon at the end of the interpreter
                threading.Thread(target=self._lead, args=(ours,), daemon=True).start()

    def _lead(self, pipe: Connection) -> None:
        """Give one worker what is next, and its result to who has ordered it."""
        while (given := self._orders.get()) is not None:
            future, order = given
            if not future.set_running_or_notify_cancel():
                continue
            try:
                pipe.send(order)
                done, answer = pipe.recv()
            except (OSError, EOFError):
                future.set_exception(BrokenExecutor("a worker process has ended"))
            except BaseException as error:  # it cannot be pickled
                future.set_exception(error)
            else:
                if done:
                    future.set_result(answer)
                else:
                    future.set_exception(answer)
        pipe.close()

    def submit(self, fn: Callable[..., Any], /, *args: Any, **kwargs: Any) -> Future[Any]:
        """Have ``fn`` done by the next worker that is free."""
        future: Future[Any] = Future()
        self._orders.put((future, (fn, args, kwargs)))
        return future

    def shutdown(self, wait: bool = True, *, cancel_futures: bool = False) -> None:
        """End the processes at once, in the middle of what they do."""
        with _held_back():
            for process in self._processes:
                process.kill()
            for process in self._processes:
                process.join()
                self._orders.put(None)
            self._processes.clear()
        atexit.unregister(self.shutdown)


@contextmanager
def worker_processes(count: int) -> Iterator[Executor | None]:
    """An executor of that many processes; None for one, which is this.

    The end of the block ends the processes at once, in the middle of what they do. They end too when this process does.
    :class:`~granphon.base.errors.GranphonError` if one has been killed.
    """
    if count == 1:
        yield None
        return
    workers = _Workers()
    try:
        workers.start(count)
        yield workers
    except BrokenExecutor:
        what, why = "a worker process has ended", "It was killed, or ran out of memory"
        raise GranphonError(message(what, why, "Take fewer --workers; the same command again goes on")) from None
    finally:
        workers.shutdown()
