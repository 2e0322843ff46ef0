"""Workers on other machines, by a scheduler of dask; the only module that imports ``distributed``, and only when asked to.

Whoever can connect to a scheduler of dask can run code in it and in its workers. A scheduler that is started here takes
only those who show the certificate that was made for it, which this process and its workers alone have. Its web servers have
no pages, and its folder is open to this user alone.

Before anything is sent, every worker must have this version of granphon, and memory for the largest task. Workers may come
and go: dask gives the tasks of one that is lost to others, and those that come later are asked too.
"""

from __future__ import annotations

import asyncio
import logging
import multiprocessing
import os
import pickle
import re
import sys
import tempfile
import threading
import time
import warnings
from collections.abc import Callable, Container, Iterator, Mapping, Sequence
from concurrent.futures import Executor, Future
from contextlib import contextmanager, suppress
from queue import Empty, SimpleQueue
from typing import TYPE_CHECKING, Any

from granphon.base.errors import GranphonError, InputError, message
from granphon.media.cost import available_memory
from granphon.sweeps import MOST_WORKERS
from granphon.sweeps.workers import (
    ANSWER_SECONDS,
    WorkerLost,
    hold_back_signals,
    mask_interrupts,
    packages,
    worker_processes,
)

if TYPE_CHECKING:
    from granphon.sweeps.tasks import Task

__all__ = ["adapt", "open_executor", "read_scheduler", "require_workers"]

#: time in which a scheduler must answer, s
_ANSWER_SECONDS = 5.0
#: time between two looks at the workers that there are, s
_LOOK_SECONDS = 2.0
#: longest time that closing the connection may take, s
_CLOSING_SECONDS = 1.0
#: an address: a protocol, if it is not TCP; a host; a port
_ADDRESS = re.compile(r"(?:(?:tcp|tls|ws|wss|ucx)://)?(?:\[[0-9a-fA-F:.]+\]|[^\s/:\[\]]+):([0-9]{1,5})")
#: options of a scheduler whose web server takes any free port of this machine alone
_NO_DASHBOARD = {"dashboard": False, "dashboard_address": "127.0.0.1:0"}
#: settings of dask for a local scheduler and its workers: a lost worker is told at once, and web servers have no pages
_SETTINGS: dict[str, Any] = {
    "distributed.scheduler.allowed-failures": 0, "distributed.scheduler.http.routes": [],
    "distributed.worker.http.routes": [],
}  # fmt: skip
#: what the names begin with that dask gives to worker processes
_WORKER_NAME = "Dask Worker process"
#: longest time without any worker process of a local scheduler, s: they take a second to start
_START_SECONDS = 120.0
#: what the error of a scheduler that has ended or an own one that is not there adds
_GO_ON = "What is finished is kept: run the same command again to continue"


def read_scheduler(text: str) -> str | int:
    """Read what ``--scheduler`` names: an address, or, as a number, the worker processes of "local:N".

    Raises :class:`~granphon.base.errors.InputError` if it is neither.
    """
    name, _, count = text.partition(":")
    if name == "local":
        if count.isascii() and count.isdigit() and 1 <= int(count) <= MOST_WORKERS:
            return int(count)
        what = f"--scheduler found {text!r}; allowed: local:N with N worker processes, 1 to {MOST_WORKERS}"
        raise InputError(message(what, mend="Give one such as local:4"))
    found = _ADDRESS.fullmatch(text)
    if found is None or not 0 < int(found[1]) < 65536:
        what = f"--scheduler found {text!r}; allowed: the address of a dask scheduler, or local:N"
        raise InputError(message(what, mend="Give one such as tcp://10.0.0.1:8786, as dask scheduler prints it, or local:4"))
    return text


def require_workers(workers: int | None, scheduler: str | None) -> str | int | None:
    """Raise InputError as :func:`open_executor` does; return what :func:`read_scheduler` does, None without a scheduler."""
    if scheduler is None:
        return None
    asked = read_scheduler(scheduler)
    if workers is not None:
        what = "both --workers and --scheduler are given"
        raise InputError(message(what, "The workers are those of the scheduler", "Leave one of them out"))
    try:
        import distributed  # noqa: F401

        if isinstance(asked, int):
            import cryptography  # noqa: F401
    except ImportError as error:
        package = (error.name or "").partition(".")[0]
        if package not in ("distributed", "dask", "cryptography"):
            raise
        what, why = "distributed is not installed", "A scheduler is one of dask.distributed"
        if package == "cryptography":
            what, why = "cryptography is not installed", "It makes the certificates that a local scheduler is closed with"
        raise InputError(message(what, why, "Install it: pip install 'granphon[distributed]'")) from None
    return asked


@contextmanager
def open_executor(workers: int | None = None, scheduler: str | None = None) -> Iterator[Executor | None]:
    """Yield the executor of ``workers`` processes, or of a ``scheduler``; None if one process, this one, does the work.

    ``scheduler`` is an address or "local:N", see :func:`read_scheduler`. All processes that were started here end with the
    block, and with this process however it ends.

    Raises
    ------
    InputError : ``scheduler`` is neither; there are ``workers`` besides; or distributed is not installed.
    GranphonError : the scheduler does not answer, or processes cannot be started.
    """
    asked = require_workers(workers, scheduler)
    if asked is None:
        with worker_processes(workers or 1) as executor:
            yield executor
        return
    with _silence():
        if isinstance(asked, int):
            with (
                _start_cluster(asked) as cluster,
                _connect(cluster.scheduler_address, "the local scheduler", cluster.security) as client,
            ):
                yield _OnScheduler(client, {}, asked)
        else:
            from distributed import Security

            with _connect(asked, f"the scheduler at {asked}", Security()) as client:  # that of the user's settings of dask
                yield _OnScheduler(client, {})


@contextmanager
def adapt(executor: Executor) -> Iterator[Executor]:
    """Yield an executor for tasks: one of a dask client is made to check its workers, others are used as they are."""
    dask = sys.modules.get("distributed.cfexecutor")
    if dask is None or not isinstance(executor, dask.ClientExecutor):
        yield executor
        return
    known: Any = executor
    own = _OnScheduler(known._client, known._kwargs)
    try:
        yield own
    finally:
        own.shutdown(wait=False)


@contextmanager
def _silence() -> Iterator[None]:
    """Keep what dask logs off the terminal: what matters is raised as an error."""
    names = [name for name in logging.root.manager.loggerDict if name.partition(".")[0] == "distributed"]
    before = {name: logging.getLogger(name).level for name in names}
    for name in names:
        logging.getLogger(name).setLevel(logging.CRITICAL + 1)
    try:
        yield
    finally:
        for name, level in before.items():
            logging.getLogger(name).setLevel(level)


@contextmanager
def _start_cluster(count: int) -> Iterator[Any]:
    """Start a scheduler in this process, and ``count`` worker processes, each with one thread and its part of the memory.

    They end with this process, however it ends: each has a pipe to it, and ends when that is closed. Who connects to one of
    them must show the certificate of ``security``, which stands in memory alone.
    """
    import dask
    from distributed import LocalCluster, Security, Status

    others = set(multiprocessing.active_children())
    free = available_memory()
    memory = int(free / count) if free < float("inf") else "auto"
    _start_tracker()
    with (
        # dask imports modules from its folder too; its own choice is one that another user may have made before
        tempfile.TemporaryDirectory(prefix="granphon-", ignore_cleanup_errors=True) as folder,
        dask.config.set(_SETTINGS | {"temporary-directory": folder}),
    ):
        try:
            # threads, and so processes, inherit the mask: a signal of the terminal stops this process alone, which ends them
            with hold_back_signals(), mask_interrupts():
                cluster = LocalCluster(
                    n_workers=0, threads_per_worker=1, processes=True, host="127.0.0.1", memory_limit=memory,
                    scheduler_kwargs=_NO_DASHBOARD, silence_logs=logging.CRITICAL + 1, security=Security.temporary(),
                )  # fmt: skip
        except (OSError, RuntimeError) as error:
            raise GranphonError(message(f"the local scheduler cannot be started: {error}")) from None
        try:
            cluster.scale(count)
            yield cluster
        finally:
            with hold_back_signals():
                for nanny in list(cluster.workers.values()):
                    nanny.auto_restart = False
                _kill_workers(others)
                with suppress(Exception):
                    cluster.close(timeout=_CLOSING_SECONDS)
                _kill_workers(others)  # one that was being started is not stopped by closing
                cluster.status = Status.closed  # if closing took too long: nothing of it is left, and dask is not to warn


def _start_tracker() -> None:
    """Start Python's process that removes semaphores of dask after a kill of this one, without its warning about them.

    If this process has started it before, the warning stays.
    """
    if os.name != "posix":
        return
    from multiprocessing import resource_tracker

    before = os.environ.get("PYTHONWARNINGS")
    os.environ["PYTHONWARNINGS"] = ",".join(filter(None, (before, "ignore:resource_tracker")))
    try:
        resource_tracker.ensure_running()
    finally:
        if before is None:
            del os.environ["PYTHONWARNINGS"]
        else:
            os.environ["PYTHONWARNINGS"] = before


def _kill_workers(others: Container[Any]) -> None:
    """Kill the worker processes but ``others`` at once, even in the middle of their work: nobody waits for it any more."""
    for process in multiprocessing.active_children():
        if process.name.startswith(_WORKER_NAME) and process not in others:
            process.kill()


@contextmanager
def _connect(address: str, what: str, security: Any) -> Iterator[Any]:
    from distributed import Client

    options = security.get_connection_args("client")
    if address.startswith("tls://") and options["ssl_context"] is None:
        why = "The settings of dask name no certificates (distributed.comm.tls: ca-file, client.cert, client.key)"
        raise InputError(message(f"{what} cannot be reached", why, "Give those of the scheduler there"))
    try:
        asyncio.run(asyncio.wait_for(_greet(address, options), _ANSWER_SECONDS))
        with warnings.catch_warnings():  # of versions that differ, which are looked at here
            warnings.simplefilter("ignore")
            client = Client(address, timeout=_ANSWER_SECONDS, set_as_default=False, name="granphon", security=security)
    except (OSError, ValueError, TimeoutError, RuntimeError) as error:
        why = f"No scheduler has answered there within {_ANSWER_SECONDS:g} s ({type(error).__name__})"
        raise GranphonError(message(f"{what} cannot be reached", why, "Is it running, and is the address right?")) from None
    try:
        yield client
    finally:
        with hold_back_signals(), suppress(Exception):
            client.close(timeout=_CLOSING_SECONDS)


async def _greet(address: str, options: dict[str, Any]) -> None:
    """Ask who answers there: a client would wait for ever for another service that takes the connection and is silent."""
    from distributed.comm import connect

    comm = await connect(address, timeout=_ANSWER_SECONDS, **options)
    try:
        await comm.write({"op": "identity", "reply": True})
        answer = await comm.read()
    finally:
        comm.abort()
    if not isinstance(answer, dict) or answer.get("type") != "Scheduler":
        raise ValueError(answer)


# -- the executor ---------------------------------------------------------------------------------------------------


def _call(order: bytes, wanted: dict[str, str]) -> Any:
    """Do an order in a worker, which must have the versions that are ``wanted``."""
    if (here := packages()) != wanted:
        raise GranphonError(_describe_versions("a worker that came later", here, wanted))
    function, args = pickle.loads(order)
    return function(*args)


def _describe_versions(worker: str, there: Mapping[str, str | None], here: Mapping[str, str]) -> str:
    """Say which version of which package a worker has."""
    wrong = next(name for name, version in here.items() if there.get(name) != version)
    found = there.get(wrong)
    has = f"has no {wrong}" if found is None else f"has {wrong} {found}"
    why = "Its numbers could be others"
    return message(
        f"{worker} {has}, and this process has {wrong} {here[wrong]}", why, "Install the same version on all machines"
    )


def _make_probe() -> Callable[[tuple[str, ...]], dict[str, str | None]]:
    """Return a function that tells the versions of packages where it is called, which may be a machine without granphon."""

    def probe(names: tuple[str, ...]) -> dict[str, str | None]:  # sent as it is, and not as a name of this module
        import importlib

        found: dict[str, str | None] = {}
        for name in names:
            try:
                found[name] = str(importlib.import_module(name).__version__)
            except Exception:
                found[name] = None
        return found

    return probe


class _OnScheduler(Executor):
    """An executor of the workers of a dask ``client``.

    ``options`` are those of ``client.get_executor``, and ``count`` is the number of workers that will come, if it is known.
    """

    def __init__(self, client: Any, options: dict[str, Any], count: int = 0) -> None:
        self._client, self._inner = client, client.get_executor(**{"pure": False} | options)
        self._count, self._looked = count, -_LOOK_SECONDS
        self._threads, self._known = 0, set[str]()
        #: when there was a worker last
        self._seen = time.monotonic()
        #: memory that the largest task needs, bytes, and its name
        self._need, self._largest = 0.0, ""

    @property
    def size(self) -> int:
        """Number of threads of all workers, and at least one; those that have come since are asked for their versions."""
        now = time.monotonic()
        if now - self._looked > _LOOK_SECONDS:
            self._look()
            self._looked = now
        if self._threads or not self._count:
            self._seen = now
        elif now - self._seen > _START_SECONDS:
            raise GranphonError(message("the worker processes of the local scheduler do not start", mend=_GO_ON))
        return max(self._threads, self._count, 1)

    def require(self, tasks: Sequence[Task]) -> None:
        """Raise if a worker has another version of granphon, numpy or scipy, or too little memory for one of the tasks.

        Each is named in the message. Workers that come later are looked at as they come.
        """
        largest = max(tasks, key=lambda task: task.memory, default=None)
        if largest is not None:
            self._need, self._largest = largest.memory, largest.where
        self._known.clear()
        self._look()

    def _look(self) -> None:
        """Look at the workers that there are."""
        try:
            workers = self._client.scheduler_info(n_workers=-1)["workers"]
            new = [address for address in workers if address not in self._known]
            self._require_versions(new)
        except OSError:
            raise self._explain_loss() from None
        for address in new:
            limit, threads = workers[address]["memory_limit"] or 0, workers[address]["nthreads"]
            if limit and self._need * threads > limit:
                at_once = f" for {threads} tasks at once" if threads > 1 else ""
                what = f"{self._largest} needs about {self._need / 1e9:.2g} GB"
                why = f"The worker {address} has {limit / 1e9:.2g} GB{at_once}"
                raise GranphonError(message(what, why, "Give workers more memory, or take fewer balls"))
        self._known.update(new)
        self._threads = sum(one["nthreads"] for one in workers.values())

    def _require_versions(self, addresses: Sequence[str]) -> None:
        if not addresses:
            return
        wanted = {"python": f"{sys.version_info[0]}.{sys.version_info[1]}"} | packages()
        every = self._client.get_versions()["workers"]
        pythons = {address: every[address]["packages"]["python"] for address in addresses if address in every}
        same = dict[str, dict[str, str | None]]()
        for address, version in pythons.items():
            there = ".".join(str(version).split(".")[:2])
            if there != wanted["python"]:
                raise GranphonError(_describe_versions(f"the worker {address}", {"python": there}, wanted))
            same[address] = {"python": there}
        names = tuple(packages())
        found = self._client.run(_make_probe(), names, workers=list(same), on_error="ignore") if same else {}
        for address, there in found.items():
            if (known := same[address] | there) != wanted:
                raise GranphonError(_describe_versions(f"the worker {address}", known, wanted))

    def _explain_loss(self) -> GranphonError:
        what, why = "the scheduler does not answer any more", "It has ended, or the network has failed"
        return GranphonError(message(what, why, _GO_ON))

    def submit(self, fn: Callable[..., Any], /, *args: Any, **kwargs: Any) -> Future[Any]:
        """Send a call to the scheduler, and return the future of its result."""
        with warnings.catch_warnings():
            warnings.filterwarnings("ignore", "Sending large graph", UserWarning)
            inner = self._inner.submit(_call, pickle.dumps((fn, args), pickle.HIGHEST_PROTOCOL), packages())
        outer: Future[Any] = Future()
        outer.set_running_or_notify_cancel()  # whether a worker is at it is not known: it may still bring a result
        inner.add_done_callback(lambda done: self._pass_on(done, outer))
        return outer

    def ask(self, fn: Callable[..., Any], /, *args: Any) -> Iterator[Any]:
        """Call ``fn``, which must be quick, in every worker, beside its work, and yield the answers that come in time."""
        answers: SimpleQueue[Any] = SimpleQueue()

        def gather() -> None:
            found: dict[str, Any] = {}
            with suppress(Exception):
                found = self._client.run(fn, *args, workers=list(self._known), on_error="ignore")
            answers.put(list(found.values()))

        threading.Thread(target=gather, daemon=True).start()
        with suppress(Empty):
            yield from answers.get(timeout=ANSWER_SECONDS)

    def _pass_on(self, inner: Future[Any], outer: Future[Any]) -> None:
        """Set the result or the error of the scheduler's future in the one that was given out."""
        if inner.cancelled():
            outer.set_exception(self._explain_loss())
        elif (error := inner.exception()) is None:
            outer.set_result(inner.result())
        elif type(error).__name__ == "KilledWorker":
            outer.set_exception(WorkerLost(getattr(error, "allowed_failures", 0) + 1))
        else:
            outer.set_exception(error)

    def shutdown(self, wait: bool = True, *, cancel_futures: bool = False) -> None:
        """Have the scheduler forget what was sent and is not finished; the client stays open."""
        with suppress(Exception):
            self._inner.shutdown(wait=wait)
