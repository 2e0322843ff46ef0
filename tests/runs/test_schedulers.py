"""Sweeps on executors, that of a dask client among them: the same numbers, and what is lost when a
worker is killed.
"""

from __future__ import annotations

import importlib.util
import json
import os
import signal
import subprocess
import sys
import threading
import time
from concurrent.futures import Future, ProcessPoolExecutor, ThreadPoolExecutor
from concurrent.futures.process import BrokenProcessPool
from contextlib import closing, contextmanager, nullcontext
from pathlib import Path

import numpy as np
import pytest

import granphon as gp
from granphon.base.errors import (
    ConvergenceError,
    GranphonError,
    MissingFileError,
    OutputError,
    SceneError,
)
from granphon.cli.main import main
from granphon.runs import execution, workers
from granphon.runs.execution import solve_all
from granphon.runs.finished_tasks import Store, read_entries
from granphon.runs.sweep import sweep
from granphon.runs.workers import Workers, open_executor, packages
from tests.waiting import HANGS, wait_for

if importlib.util.find_spec("distributed") is None:
    pytest.skip("needs distributed", allow_module_level=True)

SCENE = """\
material: {young_modulus: 211.65 GPa, poisson_ratio: 0.276, density: 7840 kg/m^3}
packing: {diameter: 8 mm, spread: {uniform: 2.04 um}}
load: {force: {from: 2 N, to: 20 N, points: 3}}
medium: [ala, simulation: {shape: 8 8, samples: 2}]
"""
ARGUMENTS = {
    "force": [18.446, 5.0],
    "media": ["ala", "afa", {"simulation": {"shape": (8, 8), "samples": 3}}],
    "width": [0.0, 1e-6],
}
posix = pytest.mark.skipif(os.name != "posix", reason="signals of POSIX")


class Nap:
    """A task that sleeps; the file of its number, if there is a folder, says that it has begun."""

    kind = "nap"
    steps = 1

    def __init__(self, number, seconds=0.0, folder=None, deadly=False):
        self.number = number
        self.seconds = seconds
        self.folder = folder
        self.deadly = deadly

    @property
    def name(self):
        return f"nap-{self.number}"

    where = name

    def count_steps(self, part):
        return 1

    def solve(self, begun=None):
        if self.folder is not None:
            (self.folder / self.name).touch()
        if self.deadly:
            os.kill(os.getpid(), signal.SIGKILL)
        time.sleep(self.seconds)
        return {"x": np.array([self.number])}


class Clock:
    """Stands for the module time: what passes is what tasks say they take."""

    def __init__(self):
        self.now = 0.0

    def perf_counter(self):
        return self.now


class Timed(Nap):
    """A task that takes its seconds of a clock."""

    def __init__(self, number, seconds, clock):
        super().__init__(number)
        self.takes = seconds
        self.clock = clock

    def solve(self, begun=None):
        self.clock.now += self.takes
        return super().solve(begun)


@pytest.fixture(scope="module")
def client():
    """A client of two worker processes; one that is killed is started again."""
    import distributed

    silent = {"dashboard": False, "dashboard_address": "127.0.0.1:0"}
    with (
        distributed.LocalCluster(
            n_workers=2, threads_per_worker=1, scheduler_kwargs=silent, silence_logs=100
        ) as cluster,
        distributed.Client(cluster, set_as_default=False) as client,
    ):
        yield client


@pytest.fixture
def impatient(monkeypatch):
    """A scheduler that does not answer is waited for no longer than this."""
    monkeypatch.setattr(workers, "_ANSWER_SECONDS", 0.5)


@pytest.fixture
def packing(steel):
    return gp.Packing(steel, 8e-3, gp.Uniform(2.04e-6))


@pytest.mark.claim("machines-same-numbers")
def test_the_numbers_are_those_of_one_process(packing, client):
    assert sweep(packing, executor=client.get_executor(), **ARGUMENTS).identical(
        sweep(packing, **ARGUMENTS)
    )


def test_calls_are_bounded_in_time_and_number(monkeypatch):
    """By a clock that tasks alone turn on: a machine that stalls does not."""
    sizes = []
    clock = Clock()
    monkeypatch.setattr(execution, "time", clock)

    class Counted(ThreadPoolExecutor):
        under_way = 0
        most = 0

        def submit(self, call, orders, *more):
            sizes.append(len(orders))
            self.under_way += 1
            self.most = max(self.most, self.under_way)
            future = super().submit(call, orders, *more)
            future.add_done_callback(lambda _: setattr(self, "under_way", self.under_way - 1))
            return future

    with Counted(2) as executor:
        solve_all("naps", [Timed(n, 1e-4, clock) for n in range(4000)], executor)
    assert executor.most <= 2
    assert max(sizes) > 100
    assert len(sizes) < 200
    # what takes longer than was thought ends its call
    long = 2.0 * execution.CALL_SECONDS
    slow = [Timed(n, long if n == 1 else 0.0, clock) for n in range(5)]
    done = execution.advance([(nap, None) for nap in slow], packages())
    assert [execution.decode(one.entry)["x"].item() for one in done] == [0, 1]


def interrupt_once(begun):
    """Interrupt the main thread, as Ctrl-C does, once something has begun."""
    wait_for(begun)
    time.sleep(0.2)
    signal.pthread_kill(threading.main_thread().ident, signal.SIGINT)


@posix
@pytest.mark.exhaustive
@pytest.mark.parametrize("how", ["workers", "scheduler"])
def test_an_interruption_loses_what_does_not_come_back_and_nothing_else(client, tmp_path, how):
    naps = [*(Nap(n, 0.002, folder=tmp_path) for n in range(150)), Nap(150, 5.0, folder=tmp_path)]
    naps += [Nap(n, 0.002, folder=tmp_path) for n in range(151, 170)]
    with nullcontext(client.get_executor()) if how == "scheduler" else Workers(2) as executor:
        store = Store(tmp_path / "store")
        threading.Thread(
            target=interrupt_once, args=((tmp_path / "nap-150").exists,), daemon=True
        ).start()
        with pytest.raises(KeyboardInterrupt):
            solve_all("naps", naps, executor, store=store)
    begun = {path.name for path in tmp_path.glob("nap-*")}
    lost = begun - dict(read_entries(tmp_path / "store")).keys()
    assert "nap-150" in lost
    # what came before it in its call, of a tenth of a second
    assert len(lost) <= 1 + execution.CALL_SECONDS / 0.002


def _throw(error):
    raise error


def test_errors_come_back_as_they_are(client):
    for error in (MissingFileError("x"), OutputError("y"), SceneError("z"), ConvergenceError("w")):
        error.load_index = 3
        with pytest.raises(type(error), match=str(error)) as caught:
            client.submit(_throw, error).result()
        assert type(caught.value) is type(error)
        assert caught.value.load_index == 3


# -- what is refused -------------------------------------------------------------------------------


def test_a_worker_that_has_another_version_when_work_comes_does_none(tmp_path):
    with pytest.raises(GranphonError, match=r"granphon .* 9\.9"):
        execution.advance([(Nap(0, folder=tmp_path), None)], packages() | {"granphon": "9.9"})
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize(
    ("options", "code", "words"),
    [
        (["--scheduler", "somewhere"], 1, "somewhere cannot be reached"),
        (["--scheduler", "http://127.0.0.1:8786"], 1, "http://127.0.0.1:8786 cannot be reached"),
        (["--scheduler", "tcp://127.0.0.1:9"], 1, "tcp://127.0.0.1:9 cannot be reached"),
        (["--scheduler", "tcp://127.0.0.1:9", "--workers", "1"], 2, "both --workers and"),
    ],
)
@pytest.mark.usefixtures("impatient")
def test_a_scheduler_that_is_not_there_is_an_error(
    tmp_path, monkeypatch, capsys, options, code, words
):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "scene.yaml").write_text(SCENE)
    assert main(["run", "scene.yaml", "-o", "out", "-q", *options]) == code
    out, err = capsys.readouterr()
    assert (out, err.count("\n")) == ("", 1)
    assert words in err
    assert [path.name for path in tmp_path.iterdir()] == ["scene.yaml"]


@pytest.mark.parametrize(
    "error",
    [
        AssertionError(),
        TimeoutError("no answer"),
        ConnectionRefusedError("refused"),
        RuntimeError("can't start new thread"),
    ],
    ids=lambda error: type(error).__name__,
)
def test_whatever_keeps_a_client_from_its_scheduler_is_one_error(monkeypatch, error):
    import distributed

    def refuse(*_, **__):
        raise error

    monkeypatch.setattr(distributed, "Client", refuse)
    with pytest.raises(GranphonError) as caught, open_executor(scheduler="tcp://127.0.0.1:9"):
        pass
    assert "tcp://127.0.0.1:9 cannot be reached" in str(caught.value)
    assert (str(error) or "busy") in str(caught.value)


# -- what is killed --------------------------------------------------------------------------------


@pytest.fixture(autouse=True)
def deadline(request):
    """Fail a test that waits for a process which does not answer, so that nothing waits for it."""
    if not hasattr(signal, "setitimer"):
        yield
        return

    def fail(*_):
        pytest.fail(f"{request.node.name} has not ended within {2.0 * HANGS} s")

    before = signal.signal(signal.SIGALRM, fail)
    # again, if closing something waits too
    signal.setitimer(signal.ITIMER_REAL, 2.0 * HANGS, 10.0)
    yield
    signal.setitimer(signal.ITIMER_REAL, 0.0)
    signal.signal(signal.SIGALRM, before)


def children():
    """Ids of the worker processes of this process."""
    found = []
    for path in Path("/proc").glob("[0-9]*/stat"):
        try:
            words = path.read_text().rpartition(")")[2].split()
            command = path.with_name("cmdline").read_bytes()
        except OSError:
            continue
        if int(words[1]) == os.getpid() and b"spawn_main" in command:
            found.append(int(path.parent.name))
    return set(found)


@posix
@pytest.mark.claim("machines-lost")
@pytest.mark.parametrize(
    "how", ["scheduler", pytest.param("workers", marks=pytest.mark.exhaustive)]
)
def test_a_killed_worker_costs_what_it_was_at(client, tmp_path, how):
    before = children()
    naps = [Nap(number, 0.02, folder=tmp_path) for number in range(60)]
    options = {"workers": 2} if how == "workers" else {"scheduler": client.scheduler.address}

    def kill():
        wait_for(lambda: len(list(tmp_path.glob("nap-*"))) > 20)
        of_dask = client.run(os.getpid).values()
        os.kill(min(of_dask if how == "scheduler" else children() - before), signal.SIGKILL)

    with open_executor(**options) as executor, ThreadPoolExecutor(1) as killer:
        killed = killer.submit(kill)
        parts = solve_all("naps", naps, executor, store=Store(tmp_path / "store"))
        killed.result()
    assert [part["x"].item() for part in parts] == list(range(60))
    if how == "workers":
        wait_for(lambda: children() == before)


@posix
@pytest.mark.parametrize(
    "how", ["workers", pytest.param("scheduler", marks=pytest.mark.exhaustive)]
)
def test_a_task_that_kills_its_workers_is_named(client, tmp_path, how):
    before = children()
    naps = [Nap(number, deadly=number == 5) for number in range(8)]
    store = Store(tmp_path / "store")
    options = {"workers": 2} if how == "workers" else {"scheduler": client.scheduler.address}
    with (
        open_executor(**options) as executor,
        pytest.raises(GranphonError, match=r"^nap-5\b.* \d+ times"),
    ):
        solve_all("naps", naps, executor, store=store)
    assert len(dict(read_entries(tmp_path / "store"))) >= 5
    if how == "workers":
        wait_for(lambda: children() == before)


class Losing(ThreadPoolExecutor):
    """An executor of threads that says what one of processes says when a task ends its worker."""

    is_broken = False

    def submit(self, call, orders, *more):
        if self.is_broken:
            raise BrokenProcessPool("a worker was lost")
        self.is_broken = any(task.deadly for task, _ in orders)
        if not self.is_broken:
            return super().submit(call, orders, *more)
        future = Future()
        future.set_exception(BrokenProcessPool("a worker was lost"))
        return future


@posix
@pytest.mark.parametrize(
    "pool", [Losing, pytest.param(ProcessPoolExecutor, marks=pytest.mark.slow)]
)
def test_an_executor_of_a_user_that_loses_a_worker_is_one_error(tmp_path, pool):
    naps = [Nap(n, deadly=n == 5) for n in range(8)]
    with pool(1) as executor, closing(Store(tmp_path / "store")) as store:
        with pytest.raises(GranphonError, match=r"^nap-[3-5]\b.* executor"):
            solve_all("naps", naps, executor, store=store)
        with pytest.raises(GranphonError, match=r"^nap-0: .* executor"):  # it takes no more work
            solve_all("naps", naps, executor)
    assert 1 <= len(dict(read_entries(tmp_path / "store"))) <= 5


@contextmanager
def started(command, log, environment):
    """A process that is killed at the end of the block, however that ends: nobody waits for one
    that goes on.
    """
    with subprocess.Popen(command, env=environment, stdout=log, stderr=log) as process:
        try:
            yield process
        finally:
            process.kill()


def read_address(file):
    """The address in a scheduler's file; None while the file is not there, or not yet written
    whole.
    """
    try:
        return json.loads(file.read_text())["address"]
    except (OSError, ValueError):
        return None


@pytest.fixture
def remote(tmp_path):
    """A scheduler in a process of its own with one worker: its address, and the process."""
    import distributed

    environment = os.environ | {
        "PYTHONPATH": os.pathsep.join([str(Path(__file__).parents[2]), *filter(None, sys.path)])
    }
    path = tmp_path / "log"
    file = tmp_path / "scheduler.json"
    main = [
        sys.executable,
        "-m",
        "distributed.cli.dask_scheduler",
        "--host",
        "127.0.0.1",
        "--port",
        "0",
        "--no-dashboard",
    ]
    with (
        path.open("w") as log,
        started([*main, "--scheduler-file", str(file)], log, environment) as scheduler,
    ):
        wait_for(
            lambda: read_address(file), lambda: f"the scheduler has no address:\n{path.read_text()}"
        )
        address = read_address(file)
        # a worker that gave up on a slow machine would never come
        words = (
            f"distributed.cli.dask_worker {address} --nthreads 1 --no-nanny --no-dashboard"
            f" --death-timeout {HANGS:.0f}"
        ).split()
        with started(
            [sys.executable, "-m", *words, "--local-directory", str(tmp_path / "scratch")],
            log,
            environment,
        ):
            with distributed.Client(address, set_as_default=False, timeout=HANGS) as client:
                client.wait_for_workers(1, timeout=HANGS)
            yield address, scheduler


@posix
@pytest.mark.claim("machines-lost")
@pytest.mark.exhaustive
def test_a_scheduler_that_dies_costs_what_was_under_way(tmp_path, remote):
    address, scheduler = remote
    naps = [Nap(n, 0.05, folder=tmp_path) for n in range(100)]
    store = Store(tmp_path / "store")
    with open_executor(scheduler=address) as executor, ThreadPoolExecutor(1) as killer:

        def kill():
            wait_for(
                lambda: (
                    (tmp_path / "store").exists()
                    and len(dict(read_entries(tmp_path / "store"))) >= 3
                )
            )
            scheduler.kill()

        killed = killer.submit(kill)
        with pytest.raises(GranphonError, match=r"scheduler .*kept"):
            solve_all("naps", naps, executor, store=store)
        killed.result()
    found = len(dict(read_entries(tmp_path / "store")))
    begun = len(list(tmp_path.glob("nap-*")))
    assert 3 <= found < 100
    # the calls whose results had not come back
    assert begun - found <= 10
    # and it goes on, here
    for path in tmp_path.glob("nap-*"):
        path.unlink()
    parts = solve_all("naps", naps, store=store)
    assert [part["x"].item() for part in parts] == list(range(100))
    assert len(list(tmp_path.glob("nap-*"))) == 100 - found
