"""Compiled loops: interruptions, and what numba keeps of them, which ends no run."""

import builtins
import itertools
import signal
import warnings
from contextlib import contextmanager
from pathlib import Path

import pytest

from granphon.base import compiled as module
from granphon.base.compiled import compiled
from granphon.base.errors import CacheWarning
from tests.conftest import only


def halve(x):
    return 0.5 * x


@pytest.fixture
def kept(tmp_path, monkeypatch):
    """A folder with what numba has kept of a loop; what this process has said about it is said
    anew.
    """
    numba = pytest.importorskip("numba")
    monkeypatch.setattr(numba.config, "CACHE_DIR", str(tmp_path))
    monkeypatch.setattr(module, "_issued_warnings", [])
    assert compiled(halve)(3.0) == 1.5
    return tmp_path


def call(*warned):
    """Compile two loops as a new process does; the words of the one warning."""
    with warnings.catch_warnings(record=True) as told:
        warnings.simplefilter("always")
        loops = [compiled(halve), compiled(halve)]
        assert [loop(3.0) for loop in loops] == [1.5, 1.5]
    assert [one.category for one in told] == [CacheWarning] * len(warned)
    for one, words in zip(told, warned, strict=True):
        assert words in str(one.message)
    return sum(sum(loop.dispatcher.stats.cache_hits.values()) for loop in loops)


@pytest.mark.parametrize(
    ("left", "ending"),
    only(
        [(0.0, "nbi"), (0.5, "nbi"), (0.99, "nbc")],
        itertools.product([0.0, 0.02, 0.5, 0.99], ["nbi", "nbc"]),
    ),
)
def test_what_is_cut_is_compiled_and_kept_anew(kept, monkeypatch, ending, left):
    assert call() == 2
    (file,) = kept.rglob(f"*.{ending}")
    data = file.read_bytes()
    file.write_bytes(data[: int(left * len(data))])
    assert call(str(kept)) == 1
    assert file.stat().st_size > int(left * len(data))
    monkeypatch.setattr(module, "_issued_warnings", [])
    assert call() == 2


def test_the_first_loop_that_is_compiled_says_so_and_one_that_is_read_does_not(
    kept, monkeypatch, capsys
):
    monkeypatch.setattr(module, "_announcements", [])
    assert call() == 2
    assert capsys.readouterr().err == ""
    for file in kept.rglob("*.nb?"):
        file.unlink()
    loops = [compiled(halve), compiled(halve)]
    assert [loop(3) for loop in loops] == [1.5, 1.5]
    assert capsys.readouterr().err == module.COMPILING + "\n"


def test_numba_fills_its_inference_of_types_for_a_loop_that_is_compiled_alone(kept, monkeypatch):
    from numba.core.cpu import CPUContext

    filled = []
    really = CPUContext.refresh
    monkeypatch.setattr(CPUContext, "refresh", lambda one: (filled.append(one), really(one))[1])
    assert call() == 2
    assert not filled
    for file in kept.rglob("*.nb?"):
        file.unlink()
    assert compiled(halve)(3) == 1.5
    assert filled


@contextmanager
def full_disk(part):
    """Writing to files whose name has this part finds no space."""
    really = builtins.open

    def open_there(at, mode):
        return really("/dev/full" if "w" in mode and part in at else at, mode)

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("numba.core.caching.open", open_there, raising=False)
        yield


@pytest.mark.skipif(not Path("/dev/full").exists(), reason="there is no full device")
@pytest.mark.parametrize("part", [".nbi", ".nbc"])
def test_a_full_disk_keeps_nothing_and_ends_no_run(kept, monkeypatch, part):
    (index,), (data,) = kept.rglob("*.nbi"), kept.rglob("*.nbc")
    index.unlink()
    data.write_bytes(b"of an older loop, which the new index must not name")
    with full_disk(part):
        assert call("No space left") == 0
    assert not index.exists()
    monkeypatch.setattr(module, "_issued_warnings", [])
    assert call() == 1


def test_where_no_folder_can_be_written_loops_are_compiled_in_each_process(kept, monkeypatch):
    from numba.core import caching

    def refuse(locator):
        raise OSError

    monkeypatch.setattr(caching._CacheLocator, "ensure_cache_path", refuse)
    assert call("no folder") == 0


def test_ctrl_c_while_numba_compiles_comes_when_it_is_done(tmp_path, monkeypatch):
    numba = pytest.importorskip("numba")
    monkeypatch.setattr(numba.config, "CACHE_DIR", str(tmp_path))

    loop = compiled(halve).dispatcher
    parts = []
    compile_part = loop._compiler.compile

    def interrupted(*arguments):
        signal.raise_signal(signal.SIGINT)
        parts.append(compile_part(*arguments))
        return parts[-1]

    monkeypatch.setattr(loop._compiler, "compile", interrupted)
    with pytest.raises(KeyboardInterrupt):
        loop(3.0)
    assert len(parts) == len(loop.signatures) == 1
    assert loop(3.0) == 1.5


@pytest.mark.parametrize(
    ("error", "words"),
    [
        (ModuleNotFoundError("No module named 'numba'", name="numba"), "numba is not installed"),
        (ImportError("Numba needs NumPy 2.3 or less"), "Numba needs NumPy 2.3 or less"),
        (ModuleNotFoundError("No module named 'llvmlite'", name="llvmlite"), "llvmlite"),
    ],
)
def test_why_loops_are_not_compiled(monkeypatch, error, words):
    import_as_ever = builtins.__import__

    def import_but_numba(name, *arguments, **options):
        if name == "numba":
            raise error
        return import_as_ever(name, *arguments, **options)

    monkeypatch.setattr(builtins, "__import__", import_but_numba)
    assert words in module.find_why_uncompiled.__wrapped__()
