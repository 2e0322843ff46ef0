"""Worker processes that stop when they are told to, and do not outlive the process that has started them.

Each has a pipe to a thread of this process, and nothing is shared: no lock that a killed worker could hold, and no semaphore
that would be left behind. A worker ends when its pipe is closed, whoever closes it, even in the middle of its work. One
thread of a worker does the work, another one listens, and answers questions in the middle of it.
"""

from __future__ import annotations

import atexit
import multiprocessing
import os
import signal
import threading
import time
import traceback
from collections.abc import Callable, Iterator
from concurrent.futures import BrokenExecutor, Executor, Future
from contextlib import contextmanager, suppress
from functools import cache
from multiprocessing.connection import Connection
from queue import Empty, SimpleQueue
from typing import Any

from granphon.base.errors import GranphonError, message
from granphon.base.text import versions

__all__ = ["ANSWER_SECONDS", "WorkerLost", "hold_back_signals", "mask_interrupts", "packages", "worker_processes"]

#: longest time for which answers of workers to a question are waited for, s
ANSWER_SECONDS = 0.5
#: the future of a result, and the function with its arguments that gives it
_Order = tuple[Future[Any], tuple[Callable[..., Any], tuple[Any, ...], dict[str, Any]]]


class WorkerLost(BrokenExecutor):
    """A worker process has ended, ``times`` in all, with the call whose future has this error; others may still do it."""

    def __init__(self, times: int = 1) -> None:
        super().__init__("a worker process has ended")
        self.times = times


@cache
def packages() -> dict[str, str]:
    """Versions, by name, of the packages that determine the numbers: those of every worker must be the same."""
    return versions("numpy", "scipy")


# -- in a worker ----------------------------------------------------------------------------------------------------


def _serve(pipe: Connection) -> None:
    """Call the functions that come through the pipe, one after the other, and send back their results."""
    sending = threading.Lock()

    def send(answer: tuple[bool | None, Any]) -> None:
        with sending:
            pipe.send(answer)

    # for platforms on which signals cannot be masked: the process that started this one ends it
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    orders: SimpleQueue[Any] = SimpleQueue()
    threading.Thread(target=_listen, args=(pipe, orders, send), daemon=True).start()
    while True:
        try:
            function, args, kwargs = orders.get()
            answer = (True, function(*args, **kwargs))
        except BaseException as error:
            answer = (False, _note_place(error))
        try:
            send(answer)
        except OSError:  # the other end of the pipe is closed
            return
        except Exception as error:  # the answer cannot be pickled
            send((False, _note_place(RuntimeError(f"{type(error).__name__}: {error}"))))


def _listen(pipe: Connection, orders: SimpleQueue[Any], send: Callable[[tuple[None, Any]], None]) -> None:
    """Receive orders while others are carried out, and answer questions; end the process once the pipe is closed."""
    try:
        while True:
            question, order = pipe.recv()
            if question:
                function, args = order
                send((None, function(*args)))
            else:
                orders.put(order)
    except (OSError, EOFError):
        os._exit(0)
    except BaseException:
        traceback.print_exc()
        os._exit(1)


def _note_place(error: BaseException) -> BaseException:
    """Add the traceback to ``error`` as a note, as the traceback itself is not sent through the pipe."""
    error.add_note("In a worker process:\n" + "".join(traceback.format_tb(error.__traceback__)))
    return error


# -- in the process that has started them -----------------------------------------------------------------------------


#: signals with which a terminal or a batch system stops this process
_STOPS = (signal.SIGINT, signal.SIGTERM)


@contextmanager
def hold_back_signals() -> Iterator[None]:
    """Hold back the signals that stop this process until the end of the block."""
    if threading.current_thread() is not threading.main_thread():  # only the main thread handles signals
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
def mask_interrupts() -> Iterator[None]:
    """Block the signals that stop this process; processes started in the block inherit that, and are not stopped by them."""
    if not hasattr(signal, "pthread_sigmask"):
        yield
        return
    before = signal.pthread_sigmask(signal.SIG_BLOCK, _STOPS)
    try:
        yield
    finally:
        signal.pthread_sigmask(signal.SIG_SETMASK, before)


class _Workers(Executor):
    """An executor of ``most`` processes, each of which is started when there is work that no other is free to do.

    So there are never more than tasks. They are spawned, not forked, as numerical libraries may have started threads by now.
    """

    def __init__(self, most: int) -> None:
        self._most = most
        self._orders: SimpleQueue[_Order | None] = SimpleQueue()
        self._processes: list[Any] = []
        #: the pipes of workers that carry out an order, with the lock for sending; and their answers to a question
        self._busy: dict[Connection, threading.Lock] = {}
        self._answers: SimpleQueue[Any] = SimpleQueue()
        #: number of orders that are not carried out yet, and the lock of that number
        self._open, self._counting = 0, threading.Lock()
        atexit.register(self.shutdown)  # runs before multiprocessing waits for them, if an interruption skips the shutdown

    def _start(self) -> None:
        """Start one worker process; GranphonError if the system refuses it."""
        context = multiprocessing.get_context("spawn")
        try:
            with hold_back_signals(), mask_interrupts():
                if os.name == "posix":
                    # otherwise the first start of a process starts the tracker, which unblocks the signals
                    from multiprocessing import resource_tracker

                    resource_tracker.ensure_running()
                    signal.pthread_sigmask(signal.SIG_BLOCK, _STOPS)
                ours, theirs = context.Pipe()
                process = context.Process(target=_serve, args=(theirs,), daemon=True)
                process.start()
                theirs.close()
                self._processes.append(process)
                # the interpreter does not wait for a daemon thread when it ends
                threading.Thread(target=self._lead, args=(ours, process), daemon=True).start()
        except (OSError, RuntimeError) as error:  # too many processes, open files or threads
            why = getattr(error, "strerror", None) or error
            what = f"worker process {len(self._processes) + 1} cannot be started: {why}"
            raise GranphonError(message(what, mend="Take fewer --workers")) from None

    def _lead(self, pipe: Connection, process: Any) -> None:
        """Send one worker the next order, and set the result in the order's future; repeat until the order is None.

        If the worker ends, another one is started in its place when there is work for it.
        """
        while (given := self._orders.get()) is not None:
            future, order = given
            if not future.set_running_or_notify_cancel():
                self._count(-1)
                continue
            sending = threading.Lock()
            try:
                with sending:
                    self._busy[pipe] = sending
                    pipe.send((False, order))
                while (received := pipe.recv())[0] is None:
                    self._answers.put(received[1])
                done, answer = received
            except (OSError, EOFError):
                self._busy.pop(pipe, None)
                self._forget(process)
                future.set_exception(WorkerLost())
                break
            except BaseException as error:  # the order or the answer cannot be pickled
                done, answer = False, error
            self._busy.pop(pipe, None)
            self._count(-1)  # before the result is known, so that what is submitted then is left to this worker
            if done:
                future.set_result(answer)
            else:
                future.set_exception(answer)
        pipe.close()

    def _count(self, change: int) -> int:
        """Change the number of orders that are not carried out yet, and return it."""
        with self._counting:
            self._open += change
            return self._open

    def _forget(self, process: Any) -> None:
        """Leave out a worker that has ended; it is started anew when the next call is submitted."""
        process.join()
        with suppress(ValueError):  # all were killed by a shutdown
            self._processes.remove(process)
        self._count(-1)

    @property
    def size(self) -> int:
        """Greatest number of processes."""
        return self._most

    def ask(self, fn: Callable[..., Any], /, *args: Any) -> Iterator[Any]:
        """Call ``fn``, which must be quick, in every worker that is at work, beside its work, and yield the answers."""
        asked = 0
        for pipe, sending in list(self._busy.items()):
            with suppress(OSError), sending:
                pipe.send((True, (fn, args)))
                asked += 1
        end = time.monotonic() + ANSWER_SECONDS
        with suppress(Empty):
            for _ in range(asked):
                yield self._answers.get(timeout=max(end - time.monotonic(), 0.0))

    def submit(self, fn: Callable[..., Any], /, *args: Any, **kwargs: Any) -> Future[Any]:
        """Queue ``fn`` for the next worker that is free, and return the future of its result."""
        future: Future[Any] = Future()
        if self._count(1) > len(self._processes) < self._most:
            self._start()
        self._orders.put((future, (fn, args, kwargs)))
        return future

    def shutdown(self, wait: bool = True, *, cancel_futures: bool = False) -> None:
        """Kill the processes at once, even in the middle of their work."""
        with hold_back_signals():
            every = list(self._processes)
            for process in every:
                process.kill()
            for process in every:
                process.join()
                self._orders.put(None)
            self._processes.clear()
        atexit.unregister(self.shutdown)


@contextmanager
def worker_processes(most: int) -> Iterator[Executor | None]:
    """Yield an executor of ``most`` worker processes; None if ``most`` is 1, as this process does the work then.

    They are started as work is submitted: never more than there are tasks under way or waiting. At the end of the block they
    are killed at once, even in the middle of their work. They end too when this process ends. In the place of one that has
    been killed by others the next call starts another. Raises :class:`~granphon.base.errors.GranphonError` if one cannot be
    started.
    """
    if most == 1:
        yield None
        return
    workers = _Workers(most)
    try:
        yield workers
    finally:
        workers.shutdown()
