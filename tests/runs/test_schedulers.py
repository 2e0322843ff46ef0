"""Sweeps by the workers of a dask scheduler: the same numbers, what is refused, and what is lost
when one is killed.
"""

from __future__ import annotations

import json
import os
import signal
import socket
import ssl
import subprocess
import sys
import threading
import time
import urllib.error
import urllib.request
from concurrent.futures import ProcessPoolExecutor, ThreadPoolExecutor
from contextlib import closing, contextmanager, nullcontext, suppress
from importlib.util import find_spec
from pathlib import Path

import numpy as np
import pytest

import granphon as gp
from granphon.base.errors import (
    ConvergenceError,
    GranphonError,
    InputError,
    MissingFileError,
    OutputError,
    SceneError,
)
from granphon.cli.commands import main
from granphon.runs import execution, workers
from granphon.runs.execution import solve_all
from granphon.runs.store import Store, read_entries
from granphon.runs.sweep import sweep
from granphon.runs.workers import (
    Workers,
    call_by,
    open_executor,
    packages,
    require_packages,
    require_workers,
)

distributed = pytest.importorskip("distributed")

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
LOCAL = pytest.param(
    {"scheduler": "local:2"},
    marks=pytest.mark.skipif(
        find_spec("cryptography") is None, reason="cryptography is not installed"
    ),
)
posix = pytest.mark.skipif(os.name != "posix", reason="signals of POSIX")


class Nap:
    """A task that sleeps; the file of its number, if there is a folder, says that it has begun."""

    kind = "nap"
    steps = 1

    def __init__(self, number, seconds=0.0, memory=0.0, folder=None, deadly=False):
        self.number = number
        self.seconds = seconds
        self.memory = memory
        self.folder = folder
        self.deadly = deadly

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


@pytest.fixture(scope="module")
def client():
    """A client of two worker processes."""
    with (
        distributed.LocalCluster(
            n_workers=2,
            threads_per_worker=1,
            memory_limit="1 GB",
            scheduler_kwargs={"dashboard": False, "dashboard_address": "127.0.0.1:0"},
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


def test_calls_are_bounded_in_time_and_number():
    sizes = []

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
        solve_all("naps", [Nap(n) for n in range(4000)], executor)
    assert executor.most <= 2
    assert max(sizes) > 100
    assert len(sizes) < 200
    # what takes longer than was thought ends its call
    slow = [Nap(0), Nap(1, 2.0 * execution.CALL_SECONDS), Nap(2), Nap(3), Nap(4)]
    done = execution.advance([(nap, None) for nap in slow], packages())
    assert [execution.decode(one.entry)["x"].item() for one in done] == [0, 1]


def test_an_error_while_a_result_is_fetched_is_that_of_the_call(client, monkeypatch):
    # as where the worker that has a result is killed, and so is the one that is to find it again
    async def fetch(*_, **__):
        raise distributed.KilledWorker("nap", None, 0)

    monkeypatch.setattr(client, "_gather", fetch)
    with pytest.raises(distributed.KilledWorker):
        call_by(client, int).result(60.0)


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


def change_version(package, value):
    """Have a worker take a package for another version; returns that which it has."""
    import importlib.metadata

    from granphon.base import text

    before = text.versions(package)[package] if package != "granphon" else gp.__version__
    if package == "granphon":
        gp.__version__ = value
    else:
        real = importlib.metadata.version
        real = getattr(real, "real", real)
        importlib.metadata.version = lambda name: value if name == package else real(name)
        importlib.metadata.version.real = real
    return before


@pytest.mark.parametrize(("package", "version"), [("granphon", "0.0.9"), ("numpy", "1.0")])
def test_workers_of_another_version_are_refused_by_name(
    packing, client, tmp_path, package, version
):
    address = list(client.scheduler_info()["workers"])[1]
    (before,) = client.run(change_version, package, version, workers=[address]).values()
    told = (
        rf"^the worker {address} has {package} {version}, and this process has {package}"
        rf" {before}\. Its numbers could"
    )
    try:
        with pytest.raises(GranphonError, match=told):
            sweep(packing, force=5.0, executor=client.get_executor(), path=tmp_path / "sweep.nc")
    finally:
        client.run(change_version, package, before, workers=[address])
    assert list(tmp_path.iterdir()) == []  # nothing was begun
    sweep(packing, force=5.0, executor=client.get_executor())


def test_a_worker_that_has_another_version_when_work_comes_does_none(tmp_path):
    with pytest.raises(
        GranphonError,
        match=r"^the worker on .* has granphon .*, and this process has granphon 9\.9",
    ):
        execution.advance([(Nap(0, folder=tmp_path), None)], packages() | {"granphon": "9.9"})
    assert list(tmp_path.iterdir()) == []


def test_a_worker_without_granphon_is_told():
    with pytest.raises(
        GranphonError, match=r"^the worker x has no granphon, and this process has granphon 1\."
    ):
        require_packages("the worker x", {}, {"granphon": "1", "numpy": "2"})


def test_a_task_that_needs_more_memory_than_a_worker_has_is_refused_before_it_is_sent(
    client, tmp_path
):
    naps = [Nap(0, folder=tmp_path), Nap(1, memory=3e9, folder=tmp_path)]
    with pytest.raises(
        GranphonError, match=r"nap-1 needs about 3 GB\. The worker tcp://[0-9.:]+ has 1 GB"
    ):
        solve_all("naps", naps, client.get_executor())
    assert list(tmp_path.iterdir()) == []


def test_the_memory_of_a_task_is_that_of_its_array(packing, client):
    large = {"simulation": {"shape": (2000, 2000), "samples": 2}}
    with pytest.raises(
        GranphonError, match=r"simulation\(.*shape=2000 2000\), seed 0 needs about [2-9]"
    ):
        sweep(packing, force=5.0, media=["ala", large], executor=client.get_executor())


@pytest.mark.parametrize(
    ("options", "code", "told"),
    [
        (
            ["--scheduler", "local:0"],
            2,
            "found 'local:0'; allowed: the address of a dask scheduler, or local:N with N",
        ),
        (
            ["--scheduler", "here"],
            2,
            "found 'here'; allowed: the address of a dask scheduler, or local:N",
        ),
        (
            ["--scheduler", "http://127.0.0.1:8786"],
            2,
            "found 'http://127.0.0.1:8786'; allowed: the address of a dask",
        ),
        (
            ["--scheduler", "local:2", "--workers", "1"],
            2,
            "both --workers and --scheduler are given",
        ),
        (
            ["--scheduler", "tcp://127.0.0.1:9"],
            1,
            "the scheduler at tcp://127.0.0.1:9 cannot be reached",
        ),
    ],
)
@pytest.mark.usefixtures("impatient")
def test_a_scheduler_that_is_not_there_is_an_error(
    tmp_path, monkeypatch, capsys, options, code, told
):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "scene.yaml").write_text(SCENE)
    assert main(["run", "scene.yaml", "-o", "out", *options]) == code
    out, err = capsys.readouterr()
    assert (out, err.count("\n")) == ("", 1)
    assert err.startswith("granphon: error: ")
    assert told in err
    assert [path.name for path in tmp_path.iterdir()] == ["scene.yaml"]


@pytest.mark.parametrize(
    "text",
    ["tcp://10.0.0.1:8786", "10.0.0.1:8786", "tls://node-7.cluster:8786", "tcp://[::1]:8786"],
)
def test_addresses(text):
    assert require_workers(None, text) == text


# -- who else is on this machine -------------------------------------------------------------------


def first_words(address, context=None):
    """What a server of dask says to one who connects: it names its versions before it is asked."""
    heard = b""
    host, port = address.rpartition("://")[2].split(":")
    with (
        socket.create_connection((host, int(port)), timeout=20) as plain,
        suppress(ssl.SSLError, ConnectionError),
        plain if context is None else context.wrap_socket(plain) as stream,
    ):
        stream.sendall(b"who are you?")  # no greeting of TLS
        while b"pickle-protocol" not in heard and (more := stream.recv(4096)):
            heard += more
    return heard


@pytest.mark.claim("local-scheduler-closed")
def test_a_local_scheduler_takes_nobody_without_its_certificate():
    pytest.importorskip("cryptography")
    before = set(sys.path)
    with workers._start_cluster(2) as cluster:
        own, other = (
            one.get_connection_args("client")
            for one in (cluster.security, distributed.Security.temporary())
        )
        nameless = ssl.create_default_context()
        for context in (nameless, other["ssl_context"]):  # a stranger takes any server
            context.check_hostname = False
            context.verify_mode = ssl.CERT_NONE
        with workers._connect(
            cluster.scheduler_address, "the local scheduler", cluster.security
        ) as client:
            client.wait_for_workers(2, timeout=60)
            known = client.scheduler_info()["workers"]
            pages = [
                cluster.scheduler.http_server.port,
                *(one["services"]["dashboard"] for one in known.values()),
            ]
            addresses = [
                cluster.scheduler_address,
                *known,
                *(one["nanny"] for one in known.values()),
            ]
            assert len(addresses) == 5
            for address in addresses:
                assert address.startswith("tls://127.0.0.1:")
                assert b"pickle-protocol" in first_words(address, own["ssl_context"])
                for stranger in (None, nameless, other["ssl_context"]):
                    assert b"pickle-protocol" not in first_words(address, stranger)
            for port in pages:
                for page in (
                    "",
                    "health",
                    "info/main/workers.html",
                    "json/counts.json",
                    "metrics",
                    "proxy/22/127.0.0.1/",
                ):
                    with pytest.raises(urllib.error.HTTPError, match="404") as missing:
                        urllib.request.urlopen(f"http://127.0.0.1:{port}/{page}", timeout=20)
                    missing.value.close()
            # nobody else can put a module where these processes look for one first
            added = {*sys.path, *client.submit(lambda: __import__("sys").path).result()} - before
            folders = {
                Path(path.partition("dask-scratch-space")[0])
                for path in added
                if "dask-scratch-space" in path
            }
            assert len(folders) == 1
            assert os.name != "posix" or folders.pop().stat().st_mode & 0o777 == 0o700


@pytest.mark.usefixtures("impatient")
def test_a_scheduler_with_certificates_needs_those_of_the_settings_of_dask():
    told = (
        r"the scheduler at tls://127\.0\.0\.1:9 cannot be reached\. The settings of dask name no"
        r" certificates"
    )
    with pytest.raises(InputError, match=told), open_executor(scheduler="tls://127.0.0.1:9"):
        pass


# -- what is killed --------------------------------------------------------------------------------


def wait_for(condition, explain=lambda: "what was waited for did not happen"):
    """Wait until a condition holds; fail after a minute, which even a busy machine does not
    take.
    """
    end = time.monotonic() + 60.0
    while not condition():
        assert time.monotonic() < end, explain()
        time.sleep(0.01)


#: time that a test may take, s: far above what one takes on a busy machine
MOST_SECONDS = 150


@pytest.fixture(autouse=True)
def deadline(request):
    """Fail a test that waits for a process which does not answer, so that nothing waits for it."""
    if not hasattr(signal, "setitimer"):
        yield
        return

    def fail(*_):
        pytest.fail(f"{request.node.name} has not ended within {MOST_SECONDS} s")

    before = signal.signal(signal.SIGALRM, fail)
    # again, if closing something waits too
    signal.setitimer(signal.ITIMER_REAL, MOST_SECONDS, 10.0)
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
@pytest.mark.exhaustive
@pytest.mark.parametrize("how", [{"workers": 2}, LOCAL])
def test_a_killed_worker_costs_what_it_was_at(tmp_path, how):
    before = children()
    naps = [Nap(n, 0.05, folder=tmp_path) for n in range(60)]
    store = Store(tmp_path / "store")
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
@pytest.mark.parametrize(
    "how", [{"workers": 2}, pytest.param({"scheduler": "local:2"}, marks=pytest.mark.exhaustive)]
)
def test_a_task_that_kills_its_workers_is_named(tmp_path, how):
    before = children()
    naps = [Nap(n, deadly=n == 5) for n in range(8)]
    store = Store(tmp_path / "store")
    with (
        open_executor(**how) as executor,
        pytest.raises(
            GranphonError,
            match=r"^nap-5: the worker process that did it has ended, \d+ times\. It was killed, or"
            r" ",
        ),
    ):
        solve_all("naps", naps, executor, store=store)
    assert len(dict(read_entries(tmp_path / "store"))) >= 5
    wait_for(lambda: children() == before)


@posix
def test_an_executor_of_a_user_that_loses_a_worker_is_one_error(tmp_path):
    naps = [Nap(n, deadly=n == 5) for n in range(8)]
    with ProcessPoolExecutor(1) as executor, closing(Store(tmp_path / "store")) as store:
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
            f" --death-timeout 100"
        ).split()
        with started(
            [sys.executable, "-m", *words, "--local-directory", str(tmp_path / "scratch")],
            log,
            environment,
        ):
            with distributed.Client(address, set_as_default=False, timeout=60) as client:
                client.wait_for_workers(1, timeout=60)
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
        with pytest.raises(
            GranphonError, match=r"the scheduler does not answer any more.*What is finished is kept"
        ):
            solve_all("naps", naps, executor, store=store)
        killed.result()
    found = len(dict(read_entries(tmp_path / "store")))
    begun = len(list(tmp_path.glob("nap-*")))
    assert 3 <= found < 100
    # a call, and what had begun of the next
    assert begun - found <= 2 * execution.CALL_SECONDS / 0.05 + 2
    # and it goes on, here
    for path in tmp_path.glob("nap-*"):
        path.unlink()
    parts = solve_all("naps", naps, store=store)
    assert [part["x"].item() for part in parts] == list(range(100))
    assert len(list(tmp_path.glob("nap-*"))) == 100 - found


@pytest.mark.usefixtures("impatient")
def test_another_service_that_is_silent_is_one_clear_error():
    with socket.create_server(("127.0.0.1", 0)) as silent:
        address = f"tcp://127.0.0.1:{silent.getsockname()[1]}"
        with (
            pytest.raises(GranphonError, match=f"the scheduler at {address} cannot be reached"),
            workers.open_executor(scheduler=address),
        ):
            pass
