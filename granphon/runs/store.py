"""The store of finished tasks: one SQLite file, in which the result of each task is kept as soon as
it is found.

The table ``task`` has, by the name of the task, the entry of its result: a SHA-256, and the bytes
of its arrays with their types and shapes. Nothing that is read is ever executed. What is kept
survives a kill, on network file systems too, where SQLite's write-ahead log would not work: its
journal is a file. The disk, which takes a hundred times as long, is waited for once a second; so a
crash of the machine may lose the last second, or damage the file.
"""

from __future__ import annotations

import errno
import hashlib
import json
import math
import os
import sqlite3
import stat
import time
from collections.abc import Callable, Iterable, Iterator, Mapping
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from granphon.base.errors import FileExistsInRunError, OutputError
from granphon.base.staging import has_locks
from granphon.base.text import show

#: the result of a task, or of its first steps; no array holds Python objects
TaskResult = dict[str, NDArray[Any]]
#: bytes before the body of an entry: its SHA-256
_HEAD = 32
#: the table; entries longer than a piece, in bytes, take several rows, as no value of SQLite may
#: have more than 1 GB
_TABLE = "CREATE TABLE task (name TEXT, piece INTEGER, entry BLOB, PRIMARY KEY (name, piece))"
_PIECE = 2**28
#: name under which the identity of the work is kept, which no task has
_IDENTITY = ""
#: what the head of the file begins with, and its bytes from 68 and 60 on: the kind of file, and the
#: version of its layout
_SQLITE = b"SQLite format 3\0"
_KIND = b"gran"
_VERSION = b"\0\0\0\1"
_MAKE = (
    f"PRAGMA application_id = {int.from_bytes(_KIND)}",
    f"PRAGMA user_version = {int.from_bytes(_VERSION)}",
    _TABLE,
)
#: largest number of differences between two works that a message names
_MOST_NAMED = 3


def encode(name: str, part: TaskResult) -> bytes:
    """Return the entry of a result: SHA-256 of the rest, name, layout, arrays. Equal results give
    equal bytes.
    """
    layout = json.dumps([(key, one.dtype.str, one.shape) for key, one in part.items()])
    for key, one in part.items():
        if one.dtype.hasobject:
            raise TypeError(f"the array {key!r} of a result holds {one.dtype}")
    return _seal(name, f"{layout}\n".encode(), *(one.tobytes() for one in part.values()))


def _seal(name: str, *data: bytes) -> bytes:
    parts, digest = [f"{name}\n".encode(), *data], hashlib.sha256()
    for one in parts:  # joined once: results may be large
        digest.update(one)
    return b"".join([digest.digest(), *parts])


def decode(entry: bytes) -> TaskResult:
    """Return the result that :func:`encode` has made an entry of."""
    begin = entry.index(b"\n", _HEAD) + 1
    place = entry.index(b"\n", begin) + 1
    part = TaskResult()
    for key, kind, shape in json.loads(entry[begin:place]):
        # unlike numpy.ndarray, frombuffer refuses objects, whose addresses would be those in the
        # file
        part[key] = np.frombuffer(entry, kind, math.prod(shape), place).reshape(shape).copy()
        place += part[key].nbytes
    return part


def read_entries(path: str | os.PathLike[str]) -> Iterator[tuple[str, TaskResult]]:
    """Yield name and result of every sound entry of a store, in the order in which they were found.

    The store may be growing meanwhile. Of a task that is done in steps, the entry has those that
    were done.
    """
    os.stat(path)  # an error where there is no such file
    store = Store(Path(path))
    try:
        for name in store.names:
            if (part := store.read(name)) is not None:
                yield name, part
    finally:
        store.close()


class Store:
    """The results of finished parts of a sweep or trade-off, by name: in one file, or in memory if
    ``path`` is None.

    The file is made when the first result is kept; its folder must exist, and be locked by the
    caller against other writers. It belongs to one work, see :meth:`claim`; ``force`` lets another
    work discard its results.
    """

    def __init__(self, path: Path | None = None, force: bool = False) -> None:
        self.path = path
        self.force = force
        self._base: sqlite3.Connection | None = None
        #: the identity that is to be written with the next result, as JSON
        self._pending: str | None = None
        #: which folder was claimed, and which file is open
        self._home = (0, 0)
        self._file = (0, 0)
        #: when the disk was waited for, and whether something has been written since
        self._synced = time.monotonic()
        self._loose = False

    def claim(
        self, identity: Mapping[str, Any] | None, names: Callable[[], Iterable[str]] = tuple
    ) -> None:
        """Claim the store for the work that ``identity``, plain data, describes; None claims it for
        no work.

        Results that the store holds are used. Another work may have left them if all of them are
        among ``names``, the names of this work's tasks. They belong to this work once it keeps a
        result of its own.

        Raises
        ------
        OutputError : ``path`` exists and is no store, or may not be written to, or is damaged, and
            is not discarded.
        FileExistsInRunError : there is a result of another work that is not among ``names``, and
            ``force`` is off. If ``force`` is on, all results are discarded instead.
        """
        if self.path is None:
            return
        self._home = _identify(self.path.parent)
        text = json.dumps(identity, sort_keys=True)
        there = set(self.names)
        mine = json.loads(text)
        before = None
        with suppress(ValueError, TypeError, RecursionError):  # it cannot be read
            before = json.loads(self._read(_IDENTITY)[_HEAD:].partition(b"\n")[2])
        if (identity is None or before != mine) and there - set(names()):
            if not self.force:
                found = (
                    list(_find_differences(before, mine, "")) if before and mine is not None else []
                )
                more = [f"and {len(found) - _MOST_NAMED} more"] if len(found) > _MOST_NAMED else []
                why = f"They differ: {'; '.join(found[:_MOST_NAMED] + more)}"
                if mine is None:
                    why = (
                        "This work has no parts that are kept, and its result would stand beside it"
                    )
                elif not before:
                    why = "The file does not say which work it belongs to"
                mend = (
                    "Repeat that command, use --force (force=True, overwrite=True), or choose"
                    " another folder"
                )
                raise FileExistsInRunError(
                    f"{self.path} holds the finished part of other work", why, mend
                )
            self.clear()
        if there and self.path.exists() and not os.access(self.path, os.W_OK):
            raise self._explain(PermissionError(errno.EACCES, os.strerror(errno.EACCES)))
        self._pending = None if identity is None or (there and before == mine) else text

    @property
    def names(self) -> list[str]:
        """The names of the results that are kept, in the order in which they were found."""
        rows = self._ask(
            "SELECT name FROM task WHERE name <> ? AND piece = 0 ORDER BY rowid", _IDENTITY
        )
        return [str(name) for (name,) in rows]

    def __contains__(self, name: str) -> bool:
        return bool(self._ask("SELECT 1 FROM task WHERE name = ? LIMIT 1", name))

    def read(self, name: str) -> TaskResult | None:
        """Return the result of the task of this name or of its first steps; None if there is none,
        or it is damaged.
        """
        with suppress(Exception):  # whatever fails is in the file
            return decode(self._read(name))
        return None

    def _read(self, name: str) -> bytes:
        """Return a sound entry; ValueError if there is none."""
        entry = b"".join(
            part
            for (part,) in self._ask("SELECT entry FROM task WHERE name = ? ORDER BY piece", name)
        )
        sealed = hashlib.sha256(memoryview(entry)[_HEAD:]).digest() == entry[:_HEAD]
        if not sealed or not entry.startswith(f"{name}\n".encode(), _HEAD):
            raise ValueError
        return entry

    def append(self, name: str, entry: bytes) -> None:
        """Keep the result of the task of this name, as :func:`encode` has written it.

        Once this returns, a kill does not lose it.

        Raises :class:`~granphon.base.errors.OutputError` if the file cannot be written, or has been
        removed or replaced: only the process that has locked its folder may write there.
        """
        base = self._connect(make=True)
        now = time.monotonic()
        assert base is not None
        wait = now - self._synced > 1.0  # s, for which results are left to the system's memory
        whose = (
            {} if self._pending is None else {_IDENTITY: _seal(_IDENTITY, self._pending.encode())}
        )
        try:
            base.execute(f"PRAGMA synchronous = {'FULL' if wait else 'OFF'}")
            with base:  # all or nothing: no file holds the identity of work alone
                base.execute("BEGIN IMMEDIATE")
                for order in _MAKE if _is_empty(base) else ():
                    base.execute(order)
                for key, whole in (whose | {name: entry}).items():
                    pieces = [
                        (key, n, whole[n * _PIECE : (n + 1) * _PIECE])
                        for n in range(1 + len(whole) // _PIECE)
                    ]
                    base.execute("DELETE FROM task WHERE name = ?", (key,))
                    base.executemany("INSERT INTO task VALUES (?, ?, ?)", pieces)
        except sqlite3.Error as error:
            with suppress(OSError):
                if self.path is not None and not os.path.getsize(self.path):
                    self.clear()  # nothing was ever kept there
            raise self._explain(error) from None
        self._pending = None
        self._loose = not wait
        self._synced = now if wait else self._synced

    def _ask(self, question: str, name: str) -> list[tuple[Any, ...]]:
        """Return the rows that answer a question about a name; none if there is no file yet."""
        base = self._connect()
        try:
            return (
                []
                if base is None or _is_empty(base)
                else base.execute(question, (name,)).fetchall()
            )
        except sqlite3.Error as error:
            raise self._explain(error, "read") from None

    def _connect(self, make: bool = False) -> sqlite3.Connection | None:
        """Return the open data base; None if there is no file, unless it is to be made."""
        path = self.path
        try:
            if path is None:
                self._base = self._base or sqlite3.connect(
                    ":memory:", isolation_level=None, check_same_thread=False
                )
            elif self._base is not None:
                if make and _identify(path) != self._file:
                    raise FileNotFoundError
            elif self._is_there() or make:
                if make and self._home not in ((0, 0), _identify(path.parent)):
                    raise FileNotFoundError
                flags = (os.O_RDWR | os.O_CREAT if make else os.O_RDONLY) | getattr(
                    os, "O_NOFOLLOW", 0
                )
                descriptor = os.open(path, flags, 0o666)  # its errors say more than those of SQLite
                locks = has_locks(descriptor)
                os.close(descriptor)
                # without locks a reader would take the journal of a writer for that of a killed
                # one, and undo its work
                mode = "rw" if locks or make or self._home != (0, 0) else "ro"
                address = f"{path.absolute().as_uri()}?mode={mode}&nolock={int(not locks)}"
                base = sqlite3.connect(
                    address, timeout=60.0, isolation_level=None, check_same_thread=False, uri=True
                )
                try:
                    base.execute("PRAGMA trusted_schema = OFF")
                    # it must be empty, or have the one table that a store has, undamaged
                    found = [
                        order
                        for (order,) in base.execute(
                            "SELECT sql FROM sqlite_master WHERE sql IS NOT NULL"
                        )
                    ]
                    if found and found != [_TABLE]:
                        raise sqlite3.DatabaseError("it holds something else")
                    for (said,) in base.execute("PRAGMA integrity_check(1)").fetchall():
                        if said != "ok":
                            raise sqlite3.DatabaseError(said)
                except sqlite3.Error:
                    base.close()
                    raise
                self._base = base
                self._file = _identify(path)
        except (OSError, sqlite3.OperationalError) as error:
            raise self._explain(error, "written" if make else "read") from None
        except sqlite3.DatabaseError as error:
            if self.force:
                self.clear()
            if path is None or os.path.lexists(path):
                what = (
                    f"{path}, with the finished parts of work that was interrupted, is damaged:"
                    f" {error}"
                )
                mend = "Use --force (force=True, overwrite=True) to discard it, or move it away"
                raise OutputError(what, mend=mend) from None
            return self._connect(make)
        return self._base

    def _is_there(self) -> bool:
        """Return whether there is a file; :class:`~granphon.base.errors.OutputError` if something
        else is there.
        """
        path = Path(str(self.path))
        if not os.path.lexists(path):
            return False
        head = b"no file"
        if stat.S_ISREG(path.lstat().st_mode):
            with path.open("rb") as stream:
                head = stream.read(100)
        if head and (not head.startswith(_SQLITE) or head[60:64] + head[68:72] != _VERSION + _KIND):
            why = "The finished parts of work under way are kept in a file of that name"
            what = f"{path} is no store of finished tasks, or one of another version of granphon"
            raise OutputError(what, why, "Move it away, or choose another folder")
        return True

    def _explain(self, error: OSError | sqlite3.Error, done: str = "written") -> OutputError:
        if isinstance(error, OutputError):
            return error
        if isinstance(error, FileNotFoundError):
            what = f"{self.path}, or its folder, has been removed or replaced while it was written"
            mend = "Run the same command again: it starts from the beginning"
            return OutputError(what, "The parts that were finished are not there", mend)
        full = getattr(error, "sqlite_errorcode", None) == sqlite3.SQLITE_FULL
        number = errno.ENOSPC if full else getattr(error, "errno", None)
        what = f"{self.path} cannot be {done}: {os.strerror(number) if number else error}"
        mend = f"Run the same command again when it can be {done}"
        if number == errno.ENOSPC:
            mend = "Free some space, and run the same command again"
        return OutputError(what, "What was finished before is kept", mend)

    def close(self) -> None:
        """Force what has been written to the disk, and close the file; it is opened again when it
        is needed.
        """
        if self._base is not None:
            self._base.close()
            self._base = None
            if self._loose and self.path is not None:
                with suppress(OSError), open(self.path, "r+b") as stream:
                    os.fsync(stream.fileno())
            self._loose = False

    def __del__(self) -> None:
        if self._base is not None:
            self._base.close()

    def clear(self) -> None:
        """Delete every result, and the file."""
        ours = self.path is not None and (
            self._is_there() if self._base is None else _identify(self.path) == self._file
        )
        self.close()
        for name in (f"{self.path}", f"{self.path}-journal") if ours else ():
            with suppress(OSError):
                os.unlink(name)


@contextmanager
def open_store(path: Path | None, force: bool = False) -> Iterator[Store]:
    """Open a store at ``path``, and clear it if the block ends well; after a failure its results
    stay, to go on from.
    """
    store = Store(path, force)
    try:
        yield store
        store.clear()
    finally:
        store.close()


def _identify(place: Path) -> tuple[int, int]:
    """Return device and inode, which identify a folder or a file whatever its name; zeros if it is
    not there.
    """
    with suppress(OSError):
        found = os.lstat(place)
        return found.st_dev, found.st_ino
    return 0, 0


def _is_empty(base: sqlite3.Connection) -> bool:
    return not base.execute("SELECT 1 FROM sqlite_master LIMIT 1").fetchall()


def _find_differences(there: Any, here: Any, where: str) -> Iterator[str]:
    if isinstance(there, dict) and isinstance(here, dict):
        for key in there | here:
            name = f"{where}.{key}" if where else str(key)
            if key in there and key in here:
                yield from _find_differences(there[key], here[key], name)
            else:
                yield f"{name} is given {'there' if key in there else 'here'} only"
    elif isinstance(there, list) and isinstance(here, list):
        if len(there) != len(here):
            yield f"{where} has {len(there)} values there, and {len(here)} here"
        for index, (one, other) in enumerate(
            zip(there, here, strict=False) if len(there) == len(here) else ()
        ):
            yield from _find_differences(one, other, f"{where}[{index}]")
    elif there != here:
        yield f"{where} is {show(there)} there, and {show(here)} here"
