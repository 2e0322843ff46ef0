"""Worker processes that stop when they are told to, and do not outlive the process that has started
them.

Each is a pool of the standard library with one process, so that nothing is shared among workers:
one that is killed, at any moment, takes the work of no other with it, nor a lock for which others
would wait.

Whoever can connect to a scheduler of dask can run code in it and in its workers. A scheduler that
is started here takes only those who show the certificate that was made for it, which this process
and its workers alone have. Its web servers have no pages, and its folder is open to this user
alone. Workers may come and go: dask gives the tasks of one that is lost to others.
"""

from __future__ import annotations

import logging
import multiprocessing
import os
import pickle
import re
import signal
import sys
import tempfile
import threading
import warnings
from collections.abc import Callable, Container, Iterator, Mapping
from concurrent.futures import Executor, Future, ProcessPoolExecutor
from concurrent.futures.process import BrokenProcessPool
from contextlib import ExitStack, contextmanager, suppress
from functools import cache
from multiprocessing.connection import wait
from typing import Any, cast

from granphon.base.errors import GranphonError, InputError, require_installed
from granphon.base.memory import available_memory
from granphon.base.text import versions
from granphon.base.threads import hold_back_signals
from granphon.runs import MOST_WORKERS

#: time in which a scheduler must answer, s; and the longest time that closing the connection may
#: take
_ANSWER_SECONDS = 5.0
_CLOSING_SECONDS = 1.0
#: an address: a protocol, if it is not TCP; a host; a port
_ADDRESS = re.compile(
    r"(?:(?:tcp|tls|ws|wss|ucx)://)?(?:\[[0-9a-fA-F:.]+\]|[^\s/:\[\]]+):([0-9]{1,5})"
)
#: settings of dask for a local scheduler and its workers: a lost worker is told at once, and web
#: servers have no pages
_SETTINGS: dict[str, Any] = {
    "distributed.scheduler.allowed-failures": 0,
    "distributed.scheduler.http.routes": [],
    "distributed.worker.http.routes": [],
}


@cache
def packages() -> dict[str, str]:
    """Versions, by name, of the packages that determine the numbers: those of every worker must be
    the same.
    """
    return versions("numpy", "scipy")


def require_packages(worker: str, there: Mapping[str, str | None], here: Mapping[str, str]) -> None:
    """Raise :class:`~granphon.base.errors.GranphonError` if a worker has another version of a
    package than this process.
    """
    for name, version in here.items():
        if (found := there.get(name)) != version:
            has = f"has no {name}" if found is None else f"has {name} {found}"
            what = f"{worker} {has}, and this process has {name} {version}"
            why = "Its numbers could be others"
            raise GranphonError(what, why, "Install the same version on all machines")


def start_tracker() -> None:
    """Start Python's process that removes the semaphores of pools and of dask after a kill of this
    one, without its warning.

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
    """Have a worker process end with the one that has started it, and leave interruptions to that
    one.
    """
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # where signals cannot be masked
    parent: Any = multiprocessing.parent_process()
    threading.Thread(target=lambda: (wait([parent.sentinel]), os._exit(0)), daemon=True).start()


def _call(fn: Callable[..., Any], *args: Any, **kwargs: Any) -> Any:
    """Call ``fn`` in a worker process; an error that cannot come back as it is comes back as its
    text.
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
    for process in list((pool._processes or {}).values()):
        process.kill()


class Workers(Executor):
    """An executor of ``most`` processes, each of which is started when there is work that no other
    is free to do.

    So there are never more than calls. They are spawned, not forked, as numerical libraries may
    have started threads by now. If one is killed, its calls have the error BrokenProcessPool, and
    another one is started for the next call.
    """

    def __init__(self, most: int) -> None:
        self._max_workers = most
        self._pools = list[Any]()
        start_tracker()

    def submit(self, fn: Callable[..., Any], /, *args: Any, **kwargs: Any) -> Future[Any]:
        """Give ``fn`` to the worker with the fewest calls, and return the future of its result.

        Raises :class:`~granphon.base.errors.GranphonError` if a process is needed and cannot be
        started.
        """
        pool: Any = min(self._pools, key=lambda one: len(one._pending_work_items), default=None)
        if pool is None or (pool._pending_work_items and len(self._pools) < self._max_workers):
            try:
                with hold_back_signals():
                    pool = ProcessPoolExecutor(
                        1, multiprocessing.get_context("spawn"), _end_with_parent
                    )
                    try:
                        pool.submit(int)  # which starts the process
                    except Exception:
                        _kill(pool)
                        raise
                    # these ends of its pipes are the process's: if it is killed within a result,
                    # the rest is not waited for
                    pool._result_queue._writer.close()
                    pool._call_queue._reader.close()
                    self._pools.append(pool)
            except (OSError, RuntimeError) as error:  # too many processes, open files or threads
                why = getattr(error, "strerror", None) or error
                what = f"worker process {len(self._pools) + 1} cannot be started: {why}"
                raise GranphonError(what, mend="Take fewer --workers") from None
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


def require_workers(workers: int | None, scheduler: str | None) -> str | int | None:
    """Return the address of a ``scheduler``, the number of processes of "local:N", or None without
    a scheduler.

    Raises what :func:`open_executor` raises.
    """
    if scheduler is None:
        return None
    name, _, count = scheduler.partition(":")
    local = (
        name == "local" and count.isascii() and count.isdigit() and 1 <= int(count) <= MOST_WORKERS
    )
    address = None if name == "local" else _ADDRESS.fullmatch(scheduler)
    if not local and (address is None or not 0 < int(address[1]) < 65536):
        what = (
            f"--scheduler found {scheduler!r}; allowed: the address of a dask scheduler, or local:N"
        )
        what += f" with N worker processes, 1 to {MOST_WORKERS}"
        raise InputError(
            what,
            mend="Give one such as tcp://10.0.0.1:8786, as dask scheduler prints it, or local:4",
        )
    if workers is not None:
        what = "both --workers and --scheduler are given"
        raise InputError(what, "The workers are those of the scheduler", "Leave one of them out")
    require_installed("A scheduler", "distributed", *("cryptography",) * local)
    return int(count) if local else scheduler


@contextmanager
def open_executor(
    workers: int | None = None, scheduler: str | None = None
) -> Iterator[Executor | None]:
    """Yield the executor of ``workers`` processes, or of a ``scheduler``; None if one process, this
    one, does the work.

    ``scheduler`` is the address of one of dask, or "local:N", which starts one with N worker
    processes. All processes that were started here end with the block, and with this process
    however it ends.

    Raises
    ------
    InputError : ``scheduler`` is neither, or there are ``workers`` besides.
    MissingPackageError : distributed is not installed, or for a local scheduler cryptography.
    GranphonError : the scheduler does not answer, or processes cannot be started.
    """
    asked = require_workers(workers, scheduler)
    with ExitStack() as stack:
        if asked is None:
            yield (
                stack.enter_context(Workers(workers))
                if workers is not None and workers > 1
                else None
            )
            return
        import dask
        from distributed import Security

        stack.callback(logging.disable, logging.root.manager.disable)
        logging.disable(logging.CRITICAL)  # what dask logs: what matters is raised as an error
        # of many balls
        stack.enter_context(
            dask.config.set({"distributed.admin.large-graph-warning-threshold": "1 TB"})
        )
        if isinstance(asked, str):  # the certificates are those of the user's settings of dask
            client = stack.enter_context(_connect(asked, f"the scheduler at {asked}", Security()))
        else:
            cluster = stack.enter_context(_start_cluster(asked))
            client = stack.enter_context(
                _connect(cluster.scheduler_address, "the local scheduler", cluster.security)
            )
            try:
                client.wait_for_workers(asked, 120.0)  # s; they take a second
            except TimeoutError:
                raise GranphonError(
                    "the worker processes of the local scheduler do not start"
                ) from None
        yield client.get_executor()


def client_of(executor: Executor) -> Any:
    """Return the client of dask whose executor this is; None of another one."""
    dask = sys.modules.get("distributed.cfexecutor")
    own = cast("Any", executor)
    return own._client if dask is not None and isinstance(executor, dask.ClientExecutor) else None


def call_by(client: Any, fn: Callable[..., Any], *args: Any) -> Future[Any]:
    """Have a worker of dask call ``fn``, and return the future of its result.

    That of dask's own executor never ends where a result was lost with its worker, and is an error
    when found again.
    """
    import asyncio

    # otherwise dask looks into the tasks for what it knows already
    theirs = client.submit(fn, *args, pure=False)

    async def find() -> Any:
        return await theirs.result()

    return asyncio.run_coroutine_threadsafe(find(), client.loop.asyncio_loop)


def count_calls(executor: Executor) -> int:
    """Return how many calls are to be under way: one for each worker, two if it is far away; 0 if
    this process does them.
    """
    if (client := client_of(executor)) is None:
        return int(getattr(executor, "_max_workers", os.cpu_count() or 1))
    with suppress(OSError):  # a scheduler that has ended is told by the calls that it has
        return 2 * sum(client.nthreads().values()) or 1 if client.status == "running" else 1
    return 1


def check_workers(client: Any, memory: float, where: str) -> None:
    """Raise if a worker has another version of granphon, numpy, scipy or Python, or too little
    memory for the largest task.

    It is named in the message. That task needs about ``memory``, bytes, and is named by ``where``.
    """
    workers = client.scheduler_info(n_workers=-1)["workers"]
    found = client.run(_find_versions, on_error="return") if workers else {}
    for address, there in found.items():  # an error if granphon cannot be imported there
        require_packages(
            f"the worker {address}", there if isinstance(there, dict) else {}, _find_versions()
        )
    for address, one in workers.items():
        limit = one["memory_limit"] or 0
        threads = one["nthreads"]
        if limit and memory * threads > limit:
            at_once = f" for {threads} tasks at once" if threads > 1 else ""
            what = f"{where} needs about {memory / 1e9:.2g} GB"
            why = f"The worker {address} has {limit / 1e9:.2g} GB{at_once}"
            raise GranphonError(what, why, "Give workers more memory, or take fewer balls")


def _find_versions() -> dict[str, str]:
    return packages.__wrapped__() | {"python": f"{sys.version_info[0]}.{sys.version_info[1]}"}


@contextmanager
def _start_cluster(count: int) -> Iterator[Any]:
    """Start a scheduler in this process, and ``count`` worker processes, each with one thread and
    its part of the memory.

    They end with this process, however it ends: each has a pipe to it, and ends when that is
    closed. Who connects to one of them must show the certificate of ``security``, which stands in
    memory alone.
    """
    import dask
    from distributed import LocalCluster, Security, Status

    others = set(multiprocessing.active_children())
    free = available_memory()
    memory = int(free / count) if free < float("inf") else "auto"
    start_tracker()
    with (
        # dask imports modules from its folder too; its own choice is one that another user may have
        # made before
        tempfile.TemporaryDirectory(prefix="granphon-", ignore_cleanup_errors=True) as folder,
        dask.config.set(_SETTINGS | {"temporary-directory": folder}),
    ):
        try:
            with hold_back_signals():
                # a signal of the terminal stops this process alone, which ends the workers
                cluster = LocalCluster(
                    n_workers=0,
                    threads_per_worker=1,
                    processes=True,
                    host="127.0.0.1",
                    memory_limit=memory,
                    # no dashboard; and the web server takes any free port of this machine alone
                    scheduler_kwargs={"dashboard": False, "dashboard_address": "127.0.0.1:0"},
                    silence_logs=logging.CRITICAL + 1,
                    security=Security.temporary(),
                )
        except (OSError, RuntimeError) as error:
            raise GranphonError(f"the local scheduler cannot be started: {error}") from None
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
                # if closing took too long: nothing of it is left, and dask is not to warn
                cluster.status = Status.closed


def _kill_workers(others: Container[Any]) -> None:
    """Kill the worker processes of dask but ``others`` at once, even in the middle of their
    work.
    """
    for process in multiprocessing.active_children():
        if process.name.startswith("Dask Worker process") and process not in others:
            process.kill()


@contextmanager
def _connect(address: str, what: str, security: Any) -> Iterator[Any]:
    import asyncio

    from distributed import Client
    from distributed.comm import connect

    async def greet() -> None:
        """Ask who answers: a client would wait for ever for another service that takes the
        connection and is silent.
        """
        comm = await connect(address, timeout=_ANSWER_SECONDS, **options)
        try:
            await comm.write({"op": "identity", "reply": True})
            answer = await comm.read()
        finally:
            comm.abort()
        if not isinstance(answer, dict) or answer.get("type") != "Scheduler":
            raise ValueError(answer)

    options = security.get_connection_args("client")
    if address.startswith("tls://") and options["ssl_context"] is None:
        why = (
            "The settings of dask name no certificates (distributed.comm.tls: ca-file,"
            " client.cert, client.key)"
        )
        raise InputError(f"{what} cannot be reached", why, "Give those of the scheduler there")
    try:
        asyncio.run(asyncio.wait_for(greet(), _ANSWER_SECONDS))
        with warnings.catch_warnings():  # of versions that differ, which are looked at here
            warnings.simplefilter("ignore")
            client = Client(
                address,
                timeout=_ANSWER_SECONDS,
                set_as_default=False,
                name="granphon",
                security=security,
            )
    except (OSError, ValueError, TimeoutError, RuntimeError) as error:
        why = (
            f"No scheduler has answered there within {_ANSWER_SECONDS:g} s ({type(error).__name__})"
        )
        raise GranphonError(
            f"{what} cannot be reached", why, "Is it running, and is the address right?"
        ) from None
    try:
        yield client
    finally:
        with hold_back_signals(), suppress(Exception):
            client.close(timeout=_CLOSING_SECONDS)
