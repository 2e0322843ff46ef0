"""Files arrive whole and together, one run at a time, and nothing of the user's is replaced."""

from __future__ import annotations

import errno
import json
import multiprocessing
import os
import shutil
import signal
import stat
import sys
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st

from granphon.base.errors import FileExistsInRunError, InputError, OutputError
from granphon.base.staging import (
    LIST,
    LOCK,
    NEW,
    PREFIX,
    ResultFiles,
    put_beside,
    read_written_files,
    write_text,
    write_texts,
)
from tests.conftest import EXAMPLES, without_rights
from tests.waiting import HANGS
from tests.warm import Warm


def tree(folder: Path) -> dict[str, str]:
    """Every file with its text, but for the list of files that granphon wrote."""
    return {
        str(p.relative_to(folder)): p.read_text() if p.is_file() else ""
        for p in folder.rglob("*")
        if p.name != LIST
    }


@contextmanager
def staging(
    folder: Path, names: Sequence[str], force: bool = False, optional: Sequence[str] = ()
) -> Iterator[Path]:
    with ResultFiles(folder, names, force).open() as files, files.staging(optional) as place:
        yield place


def put(folder: Path, force: bool = False, **texts: str) -> None:
    with staging(folder, list(texts), force) as place:
        for name, text in texts.items():
            (place / name).write_text(text)


# -- whole, together -------------------------------------------------------------------------------


def test_files_arrive_together(tmp_path: Path) -> None:
    out = tmp_path / "new" / "deeper"
    with staging(out, ["a", "b"]) as place:
        for name in "ab":
            (place / name).write_text(name)
        assert {p.name for p in out.iterdir()} == {place.name, LOCK}
    assert tree(out) == {"a": "a", "b": "b"}
    assert list(read_written_files(out)) == ["a", "b"]


def test_files_have_the_usual_permissions(tmp_path: Path) -> None:
    (tmp_path / "usual").write_text("")
    write_text(tmp_path / "x", "text")
    put(tmp_path, y="text")
    for name in "xy":
        assert stat.S_IMODE((tmp_path / name).stat().st_mode) == stat.S_IMODE(
            (tmp_path / "usual").stat().st_mode
        )


def test_a_single_file_replaces_one_of_its_kind_alone(tmp_path: Path) -> None:
    file = tmp_path / "deeper" / "x"
    for text in ("head\nold", "head\nnew"):
        write_text(file, text)
    assert tree(tmp_path) == {"deeper": "", "deeper/x": "head\nnew"}
    for text in ("granphon", "another head", ""):  # nothing is left beside it either
        with pytest.raises(
            FileExistsInRunError,
            match="x is there",
        ):
            write_text(file, text)
        assert tree(tmp_path) == {"deeper": "", "deeper/x": "head\nnew"}
    for text in ("# granphon 1", "also of granphon"):
        write_text(file, text, replace=True)
        write_text(file, f"{text} 2")
    file.write_text("")
    write_text(file, "into an empty file")
    with pytest.raises(OutputError, match="is a folder"):
        write_text(tmp_path / "deeper", "text")
    with pytest.raises(OutputError, match="cannot be written"):
        write_text(tmp_path / "a\0b", "text")


@pytest.mark.parametrize(
    "failure",
    [OSError(errno.ENOSPC, "No space left on device"), KeyboardInterrupt(), RuntimeError("bug")],
)
def test_failure_leaves_nothing(tmp_path: Path, failure: BaseException) -> None:
    expected = OutputError if isinstance(failure, OSError) else type(failure)
    words = r"No space left.*Free|^bug$|^$"
    with pytest.raises(expected, match=words), staging(tmp_path / "new" / "deeper", ["a"]) as place:  # noqa: PT012
        (place / "a").write_text("half")
        raise failure
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize("bad", ["a", "b", LIST])
def test_a_failure_after_the_result_counts_is_completed_by_the_next_run(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, bad: str
) -> None:
    put(tmp_path, a="old a", c="old c")
    (tmp_path / "mine").write_text("kept")
    real = {name: getattr(os, name) for name in ("rename", "replace")}

    def failing(name: str) -> Callable[[Path, Path], None]:
        def move(source: Path, target: Path) -> None:
            if Path(target) == tmp_path / bad:
                raise OSError(errno.EIO, "Input/output error")
            real[name](source, target)

        return move

    with monkeypatch.context() as patch:
        for name in real:
            patch.setattr(os, name, failing(name))
        with pytest.raises(
            OutputError,
            match=f"Input/output .*{NEW}",
        ):
            put(tmp_path, force=True, a="new a", b="new b", c="new c")
    assert tree(tmp_path).keys() >= {"mine", NEW}
    ResultFiles(tmp_path, ["d"]).require_free()
    assert tree(tmp_path) == {"a": "new a", "b": "new b", "c": "new c", "mine": "kept"}
    put(tmp_path, force=True, a="third", b="third", c="third")


def test_a_failure_before_the_result_counts_leaves_what_was_there(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    put(tmp_path, a="old a", c="old c")
    before = tree(tmp_path), read_written_files(tmp_path)

    def fail(*_: object) -> None:
        raise OSError(errno.EIO, "Input/output error")

    for name in ("rename", "fsync"):
        with monkeypatch.context() as patch:
            patch.setattr(os, name, fail)
            with pytest.raises(OutputError, match="Input/output"):
                put(tmp_path, force=True, a="new a", b="new b", c="new c")
        assert (tree(tmp_path), read_written_files(tmp_path)) == before


def test_optional_files_need_not_be_written(tmp_path: Path) -> None:
    put(tmp_path, a="old", b="old")
    with staging(tmp_path, ["a", "b"], force=True, optional=["b"]) as place:
        (place / "a").write_text("new")
    assert tree(tmp_path) == {"a": "new"}
    assert list(read_written_files(tmp_path)) == ["a"]
    with pytest.raises(OutputError, match="No such file"), staging(tmp_path, ["c"]):
        pass


# -- whose files they are --------------------------------------------------------------------------


def test_force_replaces_and_removes_files_of_an_earlier_result(tmp_path: Path) -> None:
    put(tmp_path, a="old", stale="old")
    (tmp_path / "mine").write_text("mine")
    with (
        ResultFiles(
            tmp_path, ["a"], force=True, earlier=["stale", "mine", "absent"]
        ).open() as files,
        files.staging() as place,
    ):
        (place / "a").write_text("new")
    assert tree(tmp_path) == {"a": "new", "mine": "mine"}
    assert list(read_written_files(tmp_path)) == ["a"]


def test_nothing_is_overwritten_without_force(tmp_path: Path) -> None:
    put(tmp_path, a="old")
    with pytest.raises(FileExistsInRunError, match=r"already holds a\. .*--force"):
        put(tmp_path, a="new")
    assert tree(tmp_path) == {"a": "old"}


@pytest.mark.parametrize("force", [False, True])
def test_what_granphon_did_not_write_is_never_replaced(tmp_path: Path, force: bool) -> None:
    put(tmp_path, changed="old", linked="old", stale="old")
    (tmp_path / "changed").write_text("the user's")
    (tmp_path / "mine").write_text("mine")
    (tmp_path / "stale").write_text("the user's")
    (tmp_path / "linked").rename(tmp_path / "elsewhere")
    (tmp_path / "linked").symlink_to(tmp_path / "elsewhere")
    (tmp_path / "dangling").symlink_to(tmp_path / "nowhere")
    before = tree(tmp_path)
    for name, found in {
        "changed": "has been changed since",
        "mine": "no record that granphon",
        "linked": "changed since",
        "dangling": "no record that granphon",
    }.items():
        with pytest.raises(FileExistsInRunError, match=rf"holds {name}: .*{found}"):
            put(tmp_path, force, **{name: "new"})
    with pytest.raises(FileExistsInRunError, match=r"stale .*changed"):
        ResultFiles(tmp_path, ["new"], force, earlier=["stale"]).require_free()
    assert tree(tmp_path) == before


@pytest.mark.parametrize("force", [False, True])
def test_what_the_run_reads_is_never_replaced_or_removed(tmp_path: Path, force: bool) -> None:
    put(tmp_path, data="numbers")
    (tmp_path / "deeper").mkdir()
    os.link(tmp_path / "data", tmp_path / "same")
    for one in (tmp_path / "data", tmp_path / "deeper" / ".." / "data", tmp_path / "same"):
        with pytest.raises(FileExistsInRunError, match="is read"):
            ResultFiles(tmp_path, ["data"], force, inputs=[one]).require_free()
    # nor does a file of an earlier result stay beside another one, because it is read
    with pytest.raises(FileExistsInRunError, match=r"data .*reads"):
        ResultFiles(
            tmp_path,
            ["new"],
            force,
            earlier=["data"],
            inputs=[tmp_path / "data", tmp_path / "absent"],
        ).require_free()
    assert tree(tmp_path) == {"data": "numbers", "same": "numbers", "deeper": ""}


def test_a_file_that_appears_meanwhile_is_not_overwritten(tmp_path: Path) -> None:
    with pytest.raises(FileExistsInRunError), staging(tmp_path, ["a"], force=True) as place:  # noqa: PT012
        (place / "a").write_text("mine")
        (tmp_path / "a").write_text("another's")
    assert tree(tmp_path) == {"a": "another's"}


@pytest.mark.parametrize(
    "text",
    [
        "",
        "{",
        "[]",
        "null",
        '{"schema": 1}',
        '{"schema": 2, "files": {"a": "0"}}',
        '{"schema": 1, "files": [1]}',
        "\0",
    ],
)
def test_a_list_that_cannot_be_read_names_no_file(tmp_path: Path, text: str) -> None:
    put(tmp_path, a="old")
    (tmp_path / LIST).write_text(text)
    with pytest.raises(FileExistsInRunError, match="no record"):
        put(tmp_path, force=True, a="new")
    assert tree(tmp_path) == {"a": "old"}


def test_known_texts_may_be_replaced(tmp_path: Path) -> None:
    (tmp_path / "a").write_text("a preset")
    ResultFiles(tmp_path, ["a"], force=True, known_texts=["another", "a preset"]).require_free()
    with pytest.raises(FileExistsInRunError, match="--force"):
        ResultFiles(tmp_path, ["a"], known_texts=["a preset"]).require_free()
    (tmp_path / "a").write_text("a preset, edited")
    with pytest.raises(FileExistsInRunError, match="no record"):
        ResultFiles(tmp_path, ["a"], force=True, known_texts=["a preset"]).require_free()
    # what may be replaced when the folder is opened may be replaced at the end
    (tmp_path / "a").write_text("a preset")
    files = ResultFiles(tmp_path, ["a"], force=True, known_texts=["a preset"])
    with files.open(), files.staging() as place:
        (place / "a").write_text("new")
    assert (tree(tmp_path), list(read_written_files(tmp_path))) == ({"a": "new"}, ["a"])


def test_places_that_cannot_be_written(tmp_path: Path) -> None:
    (tmp_path / "file").write_text("")
    (tmp_path / "summary").mkdir()
    for folder, found in (
        (tmp_path / "file", "not a folder"),
        (tmp_path / "file" / "x", "not a folder"),
    ):
        with pytest.raises(OutputError, match=found):
            ResultFiles(folder, ["a"]).require_free()
    with pytest.raises(OutputError, match="is a folder"):
        ResultFiles(tmp_path, ["summary"], force=True).require_free()
    with pytest.raises(OutputError, match="null"):
        ResultFiles(tmp_path / "a\0b", ["a"]).require_free()
    with (
        without_rights(tmp_path),
        pytest.raises(OutputError, match="permission"),
    ):
        ResultFiles(tmp_path / "new", ["a"]).require_free()


# -- one run at a time -----------------------------------------------------------------------------


def test_a_second_run_is_refused_and_the_lock_goes_with_the_first(tmp_path: Path) -> None:
    with ResultFiles(tmp_path, ["a"]).open():
        with pytest.raises(OutputError, match="another run is writing"):
            put(tmp_path, b="b")
        assert (tmp_path / LOCK).exists()
    assert list(tmp_path.iterdir()) == []
    put(tmp_path, a="a")


def test_a_lock_that_is_removed_meanwhile_costs_nothing(tmp_path: Path) -> None:
    with staging(tmp_path, ["a"]) as place:
        (place / "a").write_text("a")
        (tmp_path / LOCK).unlink()
    assert tree(tmp_path) == {"a": "a"}


def _contend(
    folder: Path,
    mark: str,
    start: multiprocessing.synchronize.Barrier,
    done: multiprocessing.Queue[str],
) -> None:
    start.wait()
    try:
        put(folder, force=True, a=mark, b=mark)
        done.put(mark)
    except OutputError:
        done.put("")


def test_runs_that_contend_leave_the_files_of_one(tmp_path: Path) -> None:
    context = multiprocessing.get_context("fork" if sys.platform == "linux" else "spawn")
    for turn in range(2):
        barrier = context.Barrier(3)
        done = context.Queue()
        runs = [
            context.Process(target=_contend, args=(tmp_path, f"{turn}{m}", barrier, done))
            for m in "xyz"
        ]
        for run in runs:
            run.start()
        claims = {done.get(timeout=HANGS) for _ in runs} - {""}
        for run in runs:
            run.join()
        found = tree(tmp_path)
        assert found["a"] == found["b"]
        assert found["a"] in claims
        assert set(found) == {"a", "b"}


@pytest.mark.usefixtures("no_locks")
@pytest.mark.parametrize("no_locks", ["flock"], indirect=True)
def test_a_file_system_without_locks_is_written_all_the_same(tmp_path: Path) -> None:
    put(tmp_path, a="a")
    assert tree(tmp_path)["a"] == "a"


# -- killed runs -----------------------------------------------------------------------------------

#: a run that gets a signal before, or after, its n-th change of the folder
#: of a folder, a number of a change, a signal, and "before" or "after": the code of the end
Stop = Callable[[Path, int, int, str], int]
STOPPED = """
import os, signal, sys
from granphon.base.staging import ResultFiles
folder, last, number, after = sys.argv[1], int(sys.argv[2]), int(sys.argv[3]), sys.argv[4] == "after"
count = 0
def counted(real):
    def call(*words, **options):
        global count
        count += 1
        if count == last and not after:
            os.kill(os.getpid(), number)
        found = real(*words, **options)
        if count == last and after:
            os.kill(os.getpid(), number)
        return found
    return call
with ResultFiles(folder, ["a", "b", "new"], force=True, earlier=["stale"]).open() as files:
    with files.staging() as place:
        for name in ("a", "b", "new"):
            (place / name).write_text("second")
        os.rename, os.replace, os.unlink = counted(os.rename), counted(os.replace), counted(os.unlink)
"""
FIRST = {"a": "first", "b": "first", "stale": "first"}
SECOND = {"a": "second", "b": "second", "new": "second"}


@pytest.fixture(scope="module")
def stop(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Stop]:
    """Runs that program in a fork of a process that has loaded what it needs: how it ended."""
    if not hasattr(os, "fork"):
        pytest.skip("needs forks of a process")
    warm = Warm("granphon.base.staging")
    scratch = tmp_path_factory.mktemp("scratch")

    def stop_run(folder: Path, last: int, number: int, when: str) -> int:
        words = ["-c", str(folder), str(last), str(int(number)), when]
        return warm.run(scratch, scratch, words, STOPPED)[0]

    yield stop_run
    warm.close()


@pytest.fixture
def stopped(stop: Stop) -> Callable[..., tuple[int, dict[str, str]]]:
    """How a run that replaces the first result ended, and the files that can be seen then."""

    def replace(folder: Path, *words: Any) -> tuple[int, dict[str, str]]:
        put(folder, **FIRST)
        code = stop(folder, *words)
        return code, {name: text for name, text in tree(folder).items() if not name.startswith(".")}

    return replace


@pytest.mark.skipif(not hasattr(signal, "SIGKILL"), reason="the system has no SIGKILL")
@pytest.mark.parametrize("when", ["before", pytest.param("after", marks=pytest.mark.slow)])
def test_a_kill_at_any_moment_never_mixes_two_results_and_the_next_run_ends_it(
    tmp_path: Path, stopped: Callable[..., tuple[int, dict[str, str]]], when: str
) -> None:
    outcomes = []
    for last in range(1, 40):
        code, left = stopped(tmp_path / str(last), last, signal.SIGKILL, when)
        assert len(set(left.values())) <= 1, f"killed at change {last}, the folder holds {left}"
        # the same run again, as whoever was killed would do; it finds the folder as one of the two
        # has left it
        ResultFiles(tmp_path / str(last), [*SECOND], force=True, earlier=["stale"]).require_free()
        outcomes.append(
            {name: text for name, text in tree(tmp_path / str(last)).items() if name != LOCK}
        )
        assert outcomes[-1] in (FIRST, SECOND)
        assert set(read_written_files(tmp_path / str(last))) == set(outcomes[-1])
        put(tmp_path / str(last), force=True, a="third")
        if code == 0:
            break
    assert code == 0
    assert len(outcomes) > 6
    # the first change is the rename with which the new result counts
    assert outcomes[0] == (FIRST if when == "before" else SECOND)
    assert outcomes[-2] == SECOND


@pytest.mark.parametrize(
    ("when", "step"),
    [
        ("before", 2),
        pytest.param("before", 1, marks=pytest.mark.slow),
        pytest.param("after", 1, marks=pytest.mark.slow),
    ],
)
def test_an_interruption_at_any_moment_leaves_one_result_whole(
    tmp_path: Path, stopped: Callable[..., tuple[int, dict[str, str]]], when: str, step: int
) -> None:
    for last in range(1, 40, step):
        code, left = stopped(tmp_path / str(last), last, signal.SIGINT, when)
        assert left in (FIRST, SECOND), f"interrupted at change {last}, the folder holds {left}"
        if code == 0:
            break
    assert code == 0
    assert last > 6


def test_a_run_that_is_killed_in_a_new_folder_can_be_run_again(tmp_path: Path, stop: Stop) -> None:
    for last in range(1, 12):
        folder = tmp_path / str(last)
        code = stop(folder, last, signal.SIGKILL, "after")
        put(folder, force=True, **SECOND)
        assert tree(folder) == SECOND
        if code == 0:
            break
    assert code == 0


def test_what_a_dead_run_left_is_removed(tmp_path: Path) -> None:
    (tmp_path / (PREFIX + "dead")).mkdir()
    (tmp_path / (PREFIX + "dead") / "a").write_text("half")
    (tmp_path / LOCK).write_text("")
    put(tmp_path, b="b")
    assert tree(tmp_path) == {"b": "b"}


PLAIN = st.recursive(
    st.none() | st.integers() | st.text(max_size=5),
    lambda x: st.lists(x) | st.dictionaries(st.text(), x),
)


@settings(max_examples=EXAMPLES // 2)
@given(
    PLAIN
    | st.fixed_dictionaries({"schema": st.sampled_from([1, 2, None]), "files": PLAIN, "old": PLAIN})
)
@example(
    {
        "schema": 1,
        "files": {"b": "0", "../b": "0", "": "0", "mine": "0"},
        "old": {"mine": "0", "../mine": "0", "..": "0"},
    }
)
def test_a_damaged_list_of_a_new_result_moves_and_removes_nothing(
    tmp_path_factory: pytest.TempPathFactory, record: object
) -> None:
    folder = tmp_path_factory.mktemp("record") / "out"
    put(folder, a="a")
    for place in (folder, folder.parent):
        (place / "mine").write_text("mine")
    (folder / NEW).mkdir()
    (folder / NEW / "b").write_text("half")
    (folder / NEW / LIST).write_text(json.dumps(record))
    ResultFiles(folder, ["c"]).require_free()
    found = {name: text for name, text in tree(folder.parent).items() if NEW not in name}
    assert found in (
        {"out": "", "out/a": "a", "out/mine": "mine", "mine": "mine"} | more
        for more in ({}, {"out/b": "half"})
    )


@pytest.mark.parametrize(
    "text",
    ['{"new": [], "old": []}', "[" * 100_000, "null", '{"schema": 1, "files": {}, "old": 1}'],
)
def test_a_folder_of_that_name_that_is_none_of_ours_is_left_alone(
    tmp_path: Path, text: str
) -> None:
    (tmp_path / NEW).mkdir()
    (tmp_path / NEW / LIST).write_text(text)
    with pytest.raises(OutputError, match="cannot be written"):
        put(tmp_path, b="b")
    assert tree(tmp_path) == {NEW: ""}
    assert (tmp_path / NEW / LIST).read_text() == text


@pytest.mark.skipif(not hasattr(os, "mkfifo"), reason="the system has no pipes")
def test_pipes_and_links_in_the_place_of_our_files_are_not_followed(tmp_path: Path) -> None:
    folder = tmp_path / "out"
    victim = tmp_path / "victim"
    for one in (folder, victim):
        one.mkdir()
    (victim / "scene").write_text("precious")
    (victim / LIST).write_text('{"schema": 1, "files": {"scene": "0"}, "old": {}}')
    (folder / (PREFIX + "link")).symlink_to(victim)
    (folder / NEW).symlink_to(victim)
    os.mkfifo(folder / LIST)
    ResultFiles(folder, ["a"]).require_free()
    assert (victim / "scene").read_text() == "precious"
    for one in (LIST, NEW):
        (folder / one).unlink()
    (folder / NEW).mkdir()
    os.mkfifo(folder / NEW / LIST)
    ResultFiles(folder, ["a"]).require_free()
    shutil.rmtree(folder / NEW)
    put(folder, a="a")
    assert not (folder / "scene").exists()
    for make in ("link", "text", "pipe"):
        if make == "link":
            (folder / LOCK).symlink_to(tmp_path / "outside")
        elif make == "text":
            (folder / LOCK).write_text("the user's")
        else:
            os.mkfifo(folder / LOCK)
        with pytest.raises(OutputError, match=r"cannot be written|not a lock"):
            put(folder, b="b")
        assert os.path.lexists(folder / LOCK)
        (folder / LOCK).unlink()
    assert not (tmp_path / "outside").exists()


def test_a_folder_that_cannot_be_made(tmp_path: Path) -> None:
    with pytest.raises(OutputError, match="cannot be written"):
        put(tmp_path / ("b" * 300), a="a")


def test_an_error_of_the_input_is_not_told_as_one_of_the_file_system(tmp_path: Path) -> None:
    target = tmp_path / "a.txt"
    with pytest.raises(InputError, match="the input is wrong"), put_beside(target):
        raise InputError("the input is wrong")
    assert list(tmp_path.iterdir()) == []
    with pytest.raises(OutputError, match="null"), put_beside(tmp_path / "a\0b"):
        pass


def test_texts_that_belong_together_are_written_all_or_none(tmp_path):
    good = tmp_path / "good.txt"
    (tmp_path / "folder").mkdir()
    for bad in (f"{tmp_path}/a\0b", tmp_path / "folder"):
        for files in ([(bad, "x"), (good, "y")], [(good, "y"), (bad, "x")]):
            with pytest.raises(OutputError):
                write_texts(files)
    with pytest.raises(InputError, match=r"good\.txt"):
        write_texts([(good, "x"), (tmp_path / "folder" / ".." / "good.txt", "y")])
    assert [path.name for path in tmp_path.iterdir()] == ["folder"]
    write_texts([(good, "x"), (tmp_path / "other.txt", "y")])
    assert (good.read_text(), (tmp_path / "other.txt").read_text()) == ("x", "y")


@pytest.mark.skipif(not hasattr(os, "mkfifo"), reason="the system has no pipes")
def test_pipes_and_devices_are_never_replaced(tmp_path):
    pipe = tmp_path / "pipe"
    os.mkfifo(pipe)
    for replace in (False, True):
        with pytest.raises(OutputError, match="pipe"):
            write_text(pipe, "text", replace)
    with pytest.raises(OutputError, match="pipe"), put_beside(pipe) as beside:
        beside.touch()
    assert stat.S_ISFIFO(pipe.stat().st_mode)
    assert os.listdir(tmp_path) == ["pipe"]


def test_what_no_file_can_hold_or_be_called_is_refused(tmp_path):
    with pytest.raises(InputError, match="cannot be written"):
        write_text(tmp_path / "a", "\ud800")
    for write in (lambda: write_text(3, "text"), lambda: ResultFiles(3, ["a"])):
        with pytest.raises(InputError, match="the path is 3"):
            write()
    assert os.listdir(tmp_path) == []
