"""Sweeps by the workers of a dask scheduler: the same numbers, what is refused, and what is lost when one is killed."""

from __future__ import annotations

import builtins
import os
import signal
import subprocess
import sys
import time
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import numpy as np
import pytest

import granphon as gp
from granphon.base.errors import ConvergenceError, GranphonError, InputError, MissingFileError, OutputError, SceneError
from granphon.cli.commands import main
from granphon.sweeps import schedulers, tasks
from granphon.sweeps.entries import read_entries
from granphon.sweeps.schedulers import open_executor, read_scheduler
from granphon.sweeps.store import Store
from granphon.sweeps.sweep import sweep
from granphon.sweeps.tasks import solve_all

distributed = pytest.importorskip("distributed")

SCENE = """\
material: {young_modulus: 211.65 GPa, poisson_ratio: 0.276, density: 7840 kg/m^3}
packing: {diameter: 8 mm, spread: {uniform: 2.04 um}}
load: {force: {from: 2 N, to: 20 N, points: 3}}
medium: [ala, simulation: {shape: 8 8, samples: 2}]
"""
ARGUMENTS = {
    "force": [18.446, 5.0], "media": ["ala", "afa", {"simulation": {"shape": (8, 8), "samples": 3}}], "width": [0.0, 1e-6],
}  # fmt: skip
posix = pytest.mark.skipif(os.name != "posix", reason="signals of POSIX")


class Nap:
    """A task that sleeps; the file of its number, if there is a folder, says that it has begun."""

    kind, steps = "nap", 1

    def __init__(self, number, seconds=0.0, memory=0.0, folder=None, deadly=False):
        self.number, self.seconds, self.memory, self.folder, self.deadly = number, seconds, memory, folder, deadly

    @property
    def name(self):
        return f"nap-{self.number}"

    where = name

    def done(self, part):
        return 1

    def solve(self, begun=None):
        if self.folder is not None:
            (self.folder / self.name).touch()
        if self.deadly:
            os.kill(os.getpid(), signal.SIGKILL)
        time.sleep(self.seconds)
        return {"x": np.array([self.number])}


@pytest.fixture(scope="session")
def client():
    """A client of two worker processes."""
    with (
        distributed.LocalCluster(
            n_workers=2, threads_per_worker=1, memory_limit="1 GB", scheduler_kwargs=schedulers._NO_DASHBOARD
        ) as cluster,
        distributed.Client(cluster, set_as_default=False) as client,
    ):
        yield client


@pytest.fixture
def packing(steel):
    return gp.Packing(steel, 8e-3, gp.Uniform(2.04e-6))


@pytest.mark.claim("machines-same-numbers")
def test_the_numbers_are_those_of_one_process(packing, client):
    assert sweep(packing, executor=client.get_executor(), **ARGUMENTS).identical(sweep(packing, **ARGUMENTS))


def test_results_are_in_the_order_of_the_tasks(client):
    naps = [Nap(n) for n in range(1000)]
    assert [part["x"].item() for part in solve_all("naps", naps, client.get_executor())] == list(range(1000))


def test_batches_are_bounded_in_time_and_number():
    sizes = []

    class Counted(ThreadPoolExecutor):
        size, under_way, most = 2, 0, 0

        def submit(self, call, orders):
            sizes.append(len(orders))
            self.under_way += 1
            self.most = max(self.most, self.under_way)
            future = super().submit(call, orders)
            future.add_done_callback(lambda _: setattr(self, "under_way", self.under_way - 1))
            return future

    with Counted(2) as executor:
        solve_all("naps", [Nap(n) for n in range(10_000)], executor)
    assert executor.most <= 2 * 2 + 1
    assert 100 < max(sizes) <= tasks.MOST_TOGETHER
    assert len(sizes) < 200
    # what takes longer than was thought ends its batch
    slow = [Nap(0), Nap(1, 0.02), Nap(2), Nap(3, 0.02), Nap(4)]
    done = tasks.carry_out([(nap, None) for nap in slow], limit=0.01)
    assert [tasks.decode(one.entry)["x"].item() for one in done] == [0, 1]


def _throw(error):
    raise error


class Failing(Nap):
    def solve(self, begun=None):
        raise InputError(f"{self.number} fails.")


def test_an_error_in_the_middle_of_a_batch_keeps_what_is_before_it(client, tmp_path):
    store = Store(tmp_path / "store")
    naps = [*(Nap(n, 0.001) for n in range(40)), Failing(40), *(Nap(n, 0.001) for n in range(41, 60))]
    with pytest.raises(InputError, match="40 fails"):
        solve_all("naps", naps, client.get_executor(), store=store)
    assert {f"nap-{n}" for n in range(30)} <= dict(read_entries(tmp_path / "store")).keys()


def test_errors_come_back_as_they_are(client):
    for error in (MissingFileError("x"), OutputError("y"), SceneError("z"), ConvergenceError("w")):
        error.load_index = 3
        with pytest.raises(type(error), match=str(error)) as caught:
            client.submit(_throw, error).result()
        assert type(caught.value) is type(error)
        assert caught.value.load_index == 3


# -- what is refused ------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("package", "version", "told"),
    [
        ("granphon", "0.0.9", r"the worker tcp://[0-9.:]+ has granphon 0\.0\.9, and this process has granphon"),
        ("numpy", "1.0", r"the worker tcp://[0-9.:]+ has numpy 1\.0, and this process has numpy"),
    ],
)
def test_workers_of_another_version_are_refused_by_name(packing, client, tmp_path, package, version, told):
    def change(value):
        import importlib

        module = importlib.import_module(package)
        before, module.__version__ = module.__version__, value
        return before

    address = list(client.scheduler_info()["workers"])[1]
    (before,) = client.run(change, version, workers=[address]).values()
    try:
        with pytest.raises(GranphonError, match=told) as caught:
            sweep(packing, force=5.0, executor=client.get_executor(), path=tmp_path / "sweep.nc")
        assert address in str(caught.value)
    finally:
        client.run(change, before, workers=[address])
    assert list(tmp_path.iterdir()) == []  # nothing was begun
    sweep(packing, force=5.0, executor=client.get_executor())


def test_a_worker_that_has_another_version_when_work_comes_does_none():
    with pytest.raises(GranphonError, match=r"has granphon .*, and this process has granphon 9\.9"):
        schedulers._call(b"never read", schedulers.packages() | {"granphon": "9.9"})


def test_a_probe_tells_of_what_is_not_installed():
    assert schedulers._make_probe()(("granphon", "not_there")) == {"granphon": gp.__version__, "not_there": None}
    told = schedulers._describe_versions("the worker x", {"granphon": None}, {"granphon": "1"})
    assert told.startswith("the worker x has no granphon, and this process has granphon 1.")


def test_a_task_that_needs_more_memory_than_a_worker_has_is_refused_before_it_is_sent(client, tmp_path):
    naps = [Nap(0, folder=tmp_path), Nap(1, memory=3e9, folder=tmp_path)]
    with pytest.raises(GranphonError, match=r"nap-1 needs about 3 GB\. The worker tcp://[0-9.:]+ has 1 GB"):
        solve_all("naps", naps, client.get_executor())
    assert list(tmp_path.iterdir()) == []


def test_the_memory_of_a_task_is_that_of_its_array(packing, client):
    large = {"simulation": {"shape": (2000, 2000), "samples": 2}}
    with pytest.raises(GranphonError, match=r"simulation\(.*shape=2000 2000\), seed 0 needs about [2-9]"):
        sweep(packing, force=5.0, media=["ala", large], executor=client.get_executor())


@pytest.mark.parametrize(
    ("options", "code", "told"),
    [
        (["--scheduler", "local:0"], 2, "found 'local:0'; allowed: local:N with N worker processes, 1 to 1024"),
        (["--scheduler", "local"], 2, "found 'local'; allowed: local:N"),
        (["--scheduler", "local:2000"], 2, "1 to 1024"),
        (["--scheduler", "here"], 2, "found 'here'; allowed: the address of a dask scheduler, or local:N"),
        (["--scheduler", "tcp://here:port"], 2, "allowed: the address of a dask scheduler"),
        (["--scheduler", "tcp://here:99999"], 2, "allowed: the address of a dask scheduler"),
        (["--scheduler", ""], 2, "allowed: the address of a dask scheduler"),
        (["--scheduler", "local:2", "--workers", "1"], 2, "both --workers and --scheduler are given"),
        (["--scheduler", "tcp://127.0.0.1:9"], 1, "the scheduler at tcp://127.0.0.1:9 cannot be reached"),
    ],
)
def test_a_scheduler_that_is_not_there_is_an_error(tmp_path, monkeypatch, capsys, options, code, told):
    monkeypatch.setattr(schedulers, "_ANSWER_SECONDS", 0.3)
    monkeypatch.chdir(tmp_path)
    (tmp_path / "scene.yaml").write_text(SCENE)
    assert main(["run", "scene.yaml", "-o", "out", *options]) == code
    out, err = capsys.readouterr()
    assert (out, err.count("\n")) == ("", 1)
    assert err.startswith("granphon: error: ")
    assert told in err
    assert [path.name for path in tmp_path.iterdir()] == ["scene.yaml"]


@pytest.mark.parametrize("text", ["tcp://10.0.0.1:8786", "10.0.0.1:8786", "tls://node-7.cluster:8786", "tcp://[::1]:8786"])
def test_addresses(text):
    assert read_scheduler(text) == text


def test_without_distributed_the_message_says_what_to_install(monkeypatch):
    real = builtins.__import__

    def without(name, *args, **kwargs):
        if name.partition(".")[0] == "distributed":
            raise ModuleNotFoundError("no module", name=name)
        return real(name, *args, **kwargs)

    monkeypatch.setattr(builtins, "__import__", without)
    with pytest.raises(InputError, match=r"pip install 'granphon\[distributed\]'"), open_executor(scheduler="local:2"):
        pass


# -- what is killed -------------------------------------------------------------------------------------------------


def wait_for(condition):
    for _ in range(3000):
        if condition():
            return
        time.sleep(0.01)
    raise AssertionError


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
@pytest.mark.exhaustive
@pytest.mark.parametrize("how", [{"workers": 2}, {"scheduler": "local:2"}])
def test_a_killed_worker_costs_what_it_was_at(tmp_path, how):
    before = children()
    naps, store = [Nap(n, 0.05, folder=tmp_path) for n in range(60)], Store(tmp_path / "store")
    with open_executor(**how) as executor, ThreadPoolExecutor(1) as killer:

        def kill():
            wait_for(lambda: len(list(tmp_path.glob("nap-*"))) > 20)
            os.kill(min(children() - before), signal.SIGKILL)

        killed = killer.submit(kill)
        parts = solve_all("naps", naps, executor, store=store)
        killed.result()
    assert [part["x"].item() for part in parts] == list(range(60))
    wait_for(lambda: children() == before)


@posix
@pytest.mark.exhaustive
@pytest.mark.parametrize("how", [{"workers": 2}, {"scheduler": "local:2"}])
def test_a_task_that_kills_its_workers_is_named(tmp_path, how):
    before = children()
    naps, store = [Nap(n, deadly=n == 30) for n in range(40)], Store(tmp_path / "store")
    with (
        open_executor(**how) as executor,
        pytest.raises(GranphonError, match=r"^nap-30: the worker process that did it has ended, \d+ times"),
    ):
        solve_all("naps", naps, executor, store=store)
    assert len(dict(read_entries(tmp_path / "store"))) >= 10
    wait_for(lambda: children() == before)


@pytest.fixture
def remote(tmp_path):
    """A scheduler in a process of its own with one worker: its address, and the process."""
    environment = os.environ | {"PYTHONPATH": os.pathsep.join([str(Path(__file__).parent), *filter(None, sys.path)])}
    log = (tmp_path / "log").open("w")
    command = [
        sys.executable,
        "-m",
        "distributed.cli.dask_scheduler",
        "--host",
        "127.0.0.1",
        "--port",
        "0",
        "--no-dashboard",
    ]
    file = tmp_path / "scheduler.json"
    with log, subprocess.Popen([*command, "--scheduler-file", str(file)], env=environment, stderr=log) as scheduler:
        wait_for(file.exists)
        command = [sys.executable, "-m", "distributed.cli.dask_worker", "--nthreads", "1", "--no-nanny", "--no-dashboard"]
        command += ["--death-timeout", "2", "--scheduler-file", str(file), "--local-directory", str(tmp_path / "scratch")]
        with subprocess.Popen(command, env=environment, stderr=log) as worker:
            import json

            yield json.loads(file.read_text())["address"], scheduler
            for process in (worker, scheduler):
                process.kill()


@posix
@pytest.mark.claim("machines-lost")
@pytest.mark.exhaustive
def test_a_scheduler_that_dies_costs_what_was_under_way(tmp_path, remote):
    address, scheduler = remote
    naps, store = [Nap(n, 0.05, folder=tmp_path) for n in range(100)], Store(tmp_path / "store")
    with open_executor(scheduler=address) as executor, ThreadPoolExecutor(1) as killer:

        def kill():
            wait_for(lambda: (tmp_path / "store").exists() and len(dict(read_entries(tmp_path / "store"))) >= 3)
            scheduler.kill()

        killed = killer.submit(kill)
        with pytest.raises(GranphonError, match=r"the scheduler does not answer any more.*What is finished is kept"):
            solve_all("naps", naps, executor, store=store)
        killed.result()
    found = len(dict(read_entries(tmp_path / "store")))
    begun = len(list(tmp_path.glob("nap-*")))
    assert 3 <= found < 100
    assert begun - found <= 2 * tasks.BATCH_SECONDS / 0.05  # a batch, and what had begun of the next
    # and it goes on, here
    for path in tmp_path.glob("nap-*"):
        path.unlink()
    parts = solve_all("naps", naps, store=store)
    assert [part["x"].item() for part in parts] == list(range(100))
    assert len(list(tmp_path.glob("nap-*"))) == 100 - found


@pytest.mark.exhaustive
def test_the_command_with_a_local_scheduler(tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "scene.yaml").write_text(SCENE)
    before = children()
    for folder, options in (("one", []), ("two", ["--scheduler", "local:2"])):
        assert main(["run", "scene.yaml", "-o", folder, "-q", *options]) == 0
    assert capsys.readouterr().out == ""
    assert gp.load_sweep("one/sweep.nc").identical(gp.load_sweep("two/sweep.nc"))
    wait_for(lambda: children() == before)
