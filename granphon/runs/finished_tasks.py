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

from granphon.base.errors import FileExistsInRunError, InputError, OutputError, brief
from granphon.base.staging import has_locks
from granphon.base.text import require_path, show

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
#: first bytes of the file, and its bytes from 68 and from 60 on: the kind of file, and the version
#: of its layout
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
#: time between two waits for the disk, s
_SYNC_SECONDS = 1.0
#: time for which a file that another process has locked is waited for, s
_BUSY_SECONDS = 60.0


def encode(name: str, result: TaskResult) -> bytes:
    """Return the entry of the result of the task ``name``: the SHA-256 of all that follows, a line
    with the name, a line with the layout, which is JSON, and the bytes of the arrays.

    Results with equal arrays in the same order give equal bytes. TypeError if an array holds Python
    objects, or has named fields, whose names the layout would lose; ValueError if the name has a
    line break.
    """
    if "\n" in name:
        raise ValueError(f"the name {name!r} of a task has a line break")
    for key, array in result.items():
        if array.dtype.hasobject or array.dtype.names:
            raise TypeError(f"the array {key!r} of a result holds {array.dtype}")
    layout = json.dumps([(key, array.dtype.str, array.shape) for key, array in result.items()])
    arrays = [array.tobytes() for array in result.values()]
    return _seal(name, f"{layout}\n".encode(), *arrays)


def _seal(name: str, *data: bytes) -> bytes:
    """Return the entry with a ``name`` and ``data``: the SHA-256 of all that follows, a line with
    the name, the data.
    """
    pieces = [f"{name}\n".encode(), *data]
    digest = hashlib.sha256()
    for piece in pieces:  # not joined before: results may be large
        digest.update(piece)
    return b"".join([digest.digest(), *pieces])


def decode(entry: bytes) -> TaskResult:
    """Return the result from the ``entry`` that :func:`encode` has made of it; the arrays are
    copies. The SHA-256 is not compared here.
    """
    layout_start = entry.index(b"\n", _HEAD) + 1
    offset = entry.index(b"\n", layout_start) + 1
    result = TaskResult()
    for key, kind, shape in json.loads(entry[layout_start:offset]):
        # Unlike numpy.ndarray, frombuffer refuses objects, whose addresses would be those in the
        # file.
        array = np.frombuffer(entry, kind, math.prod(shape), offset)
        result[key] = array.reshape(shape).copy()
        offset += array.nbytes
    return result


def read_entries(path: str | os.PathLike[str]) -> Iterator[tuple[str, TaskResult]]:
    """Yield name and result of every sound entry of the store in the file ``path``, in the order in
    which the entries were kept last.

    The store may be growing meanwhile. The entry of a task that is done in steps has the steps that
    were done. When the first entry is asked for, FileNotFoundError is raised if there is no file,
    and OutputError if the file cannot be read, is no store, or is damaged.
    """
    os.stat(path)  # raises FileNotFoundError, where a store would count as empty
    store = Store(path)
    try:
        for name in store.names:
            result = store.read(name)
            if result is not None:
                yield name, result
    finally:
        store.close()


def require_store(store: Any) -> None:
    """Raise InputError for a ``store``, the argument of a public call, that is no store."""
    if not isinstance(store, Store):
        mend = "Give a granphon.runs.finished_tasks.Store, or none"
        raise InputError(f"store is {brief(store)}", mend=mend)


class Store:
    """The results of finished parts of a sweep or trade-off, by name: in one file, or in memory if
    ``path`` is None.

    The file is made when the first result is kept; its folder must exist, and be locked by the
    caller against other writers. It belongs to one work, see :meth:`claim`; ``force`` lets another
    work discard its results. What reads or writes results raises OutputError for a file that is no
    store, cannot be read or is damaged, but for :meth:`read`, which returns None.
    """

    def __init__(self, path: str | os.PathLike[str] | None = None, force: bool = False) -> None:
        """Set up a store, which opens no file yet; raises
        :class:`~granphon.base.errors.InputError` for what is no path.
        """
        self._base: sqlite3.Connection | None = None
        if path is not None:
            require_path(path)
        self.path = None if path is None else Path(path)
        self.force = force
        #: the identity that is to be written with the next result, as JSON
        self._pending: str | None = None
        #: device and inode of the folder that was claimed, and of the file that is open
        self._home = (0, 0)
        self._file = (0, 0)
        #: time at which the disk was waited for, s, and whether something has been written since
        self._synced = time.monotonic()
        self._is_unsynced = False

    def claim(
        self, identity: Mapping[str, Any], names: Callable[[], Iterable[str]] = tuple
    ) -> None:
        """Claim the store for the work that ``identity``, plain data, describes.

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
        plain_identity = json.loads(text)
        kept_names = set(self.names)
        kept_identity = self._read_identity()
        is_same_work = kept_identity == plain_identity
        if not is_same_work and kept_names - set(names()):
            if not self.force:
                raise self._explain_other_work(kept_identity, plain_identity)
            self.clear()
        is_to_grow = bool(kept_names) and self.path.exists()
        if is_to_grow and not os.access(self.path, os.W_OK):
            raise self._explain(PermissionError(errno.EACCES, os.strerror(errno.EACCES)))
        is_written = bool(kept_names) and is_same_work
        self._pending = None if is_written else text

    def _read_identity(self) -> Any:
        """Return the identity, plain data, of the work that the store holds; None if the file does
        not say.
        """
        with suppress(ValueError, TypeError, RecursionError):
            _name, _newline, text = self._read(_IDENTITY)[_HEAD:].partition(b"\n")
            return json.loads(text)
        return None

    def _explain_other_work(self, kept: Any, claimed: Any) -> FileExistsInRunError:
        """Return the error of a store of other work. ``kept`` is the identity of the work whose
        results the store holds, and ``claimed`` that of the work that claims the store.
        """
        mend = (
            "Repeat the command of that work, use --force (force=True, overwrite=True), or choose"
            " another folder"
        )
        problem = f"{self.path} holds the finished part of other work"
        return FileExistsInRunError(problem, _explain_difference(kept, claimed), mend)

    @property
    def names(self) -> list[str]:
        """The names of the results, in the order in which they were kept; a result that replaces
        another of its name is then the last.
        """
        rows = self._query(
            "SELECT name FROM task WHERE name <> ? AND piece = 0 ORDER BY rowid", _IDENTITY
        )
        return [str(name) for (name,) in rows]

    def __contains__(self, name: str) -> bool:
        """Whether there is an entry of this name, which may be damaged."""
        return bool(self._query("SELECT 1 FROM task WHERE name = ? LIMIT 1", name))

    def read(self, name: str) -> TaskResult | None:
        """Return the result of the task of this name or of its first steps; None for no result, for
        a damaged one, and if the file cannot be read.
        """
        with suppress(Exception):  # whatever fails is in the file
            return decode(self._read(name))
        return None

    def _read(self, name: str) -> bytes:
        """Return the entry of a name, joined from its pieces; ValueError if there is none, or if
        its SHA-256 or its name is another, and OutputError as :meth:`_query`.
        """
        rows = self._query("SELECT entry FROM task WHERE name = ? ORDER BY piece", name)
        entry = b"".join(piece for (piece,) in rows)
        digest = hashlib.sha256(memoryview(entry)[_HEAD:]).digest()
        has_name = entry.startswith(f"{name}\n".encode(), _HEAD)
        if digest != entry[:_HEAD] or not has_name:
            raise ValueError
        return entry

    def append(self, name: str, entry: bytes) -> None:
        """Keep the ``entry`` that :func:`encode` has made of the result of the task ``name``, which
        is not empty; from then on a kill of the process does not lose the result.

        Raises :class:`~granphon.base.errors.OutputError` if the file cannot be written, or has been
        removed or replaced: only the process that has locked its folder may write there.
        """
        base = self._connect(make=True)
        assert base is not None
        now = time.monotonic()
        # the disk is slow: between two waits the results are left to the system's memory
        waits_for_disk = now - self._synced > _SYNC_SECONDS
        entries = {name: entry}
        if self._pending is not None:
            # the first result of new work brings the identity of the work with it
            entries = {_IDENTITY: _seal(_IDENTITY, self._pending.encode()), name: entry}
        try:
            base.execute(f"PRAGMA synchronous = {'FULL' if waits_for_disk else 'OFF'}")
            with base:  # all or nothing: no file holds the identity of work alone
                base.execute("BEGIN IMMEDIATE")
                _write_entries(base, entries)
        except sqlite3.Error as error:
            with suppress(OSError):
                if self.path is not None and not os.path.getsize(self.path):
                    self.clear()  # the file is new, and no result was ever kept in it
            raise self._explain(error) from None
        self._pending = None
        self._is_unsynced = not waits_for_disk
        if waits_for_disk:
            self._synced = now

    def _query(self, question: str, name: str) -> list[tuple[Any, ...]]:
        """Return the rows that answer ``question``, SQL with one place for the ``name``; no rows if
        there is no file yet, or an empty one. OutputError if the file cannot be read, and as
        :meth:`_connect`.
        """
        base = self._connect()
        try:
            if base is None or _is_empty(base):
                return []
            return base.execute(question, (name,)).fetchall()
        except sqlite3.Error as error:
            raise self._explain(error, "read") from None

    def _connect(self, make: bool = False) -> sqlite3.Connection | None:
        """Return the open data base; None if there is no file, and ``make`` is off.

        With ``make``, which is for writing, a file that is missing is made, and OutputError is
        raised if the file, or the folder that was claimed, has been removed or replaced. A damaged
        file is discarded if ``force`` is on, and is an OutputError if not. OutputError too for a
        file that cannot be opened, or is no store.
        """
        path = self.path
        try:
            if path is None:
                self._base = self._base or sqlite3.connect(
                    ":memory:", isolation_level=None, check_same_thread=False
                )
            elif self._base is not None:
                is_replaced = _identify(path) != self._file
                if make and is_replaced:
                    raise FileNotFoundError
            elif self._has_file() or make:
                is_claimed = self._home != (0, 0)
                if make and is_claimed and _identify(path.parent) != self._home:
                    raise FileNotFoundError
                self._base = self._open(path, make=make)
                self._file = _identify(path)
        except (OSError, sqlite3.OperationalError) as error:
            raise self._explain(error, "written" if make else "read") from None
        except sqlite3.DatabaseError as error:
            if self.force:
                self.clear()
            if path is None or os.path.lexists(path):
                raise self._explain_damage(error) from None
            return self._connect(make)
        return self._base

    def _explain_damage(self, error: sqlite3.DatabaseError) -> OutputError:
        """Return the error of a file that is no data base, or a damaged one."""
        kept = f"{self.path}, with the finished parts of work that was interrupted"
        mend = "Use --force (force=True, overwrite=True) to discard it, or move it away"
        return OutputError(f"{kept}, is damaged: {error}", mend=mend)

    def _open(self, path: Path, *, make: bool) -> sqlite3.Connection:
        """Return the data base in the file ``path``, which is made if it is missing and ``make`` is
        on; DatabaseError unless the base is empty, or has the one table of a store, undamaged.
        """
        flags = os.O_RDWR | os.O_CREAT if make else os.O_RDONLY
        flags |= getattr(os, "O_NOFOLLOW", 0)
        # opened here first, as errors of the system say more than those of SQLite
        descriptor = os.open(path, flags, 0o666)
        has_file_locks = has_locks(descriptor)
        os.close(descriptor)
        is_writer = make or self._home != (0, 0)
        # Without locks a reader would take the journal of a writer for that of a killed one, and
        # undo its work.
        mode = "rw" if has_file_locks or is_writer else "ro"
        address = f"{path.absolute().as_uri()}?mode={mode}&nolock={int(not has_file_locks)}"
        base = sqlite3.connect(
            address,
            timeout=_BUSY_SECONDS,
            isolation_level=None,
            check_same_thread=False,
            uri=True,
        )
        try:
            _require_sound(base)
        except sqlite3.Error:
            base.close()
            raise
        return base

    def _has_file(self) -> bool:
        """Return whether the file of a store with a ``path`` exists;
        :class:`~granphon.base.errors.OutputError` if the path is that of something else.
        """
        assert self.path is not None
        path = self.path
        if not os.path.lexists(path):
            return False
        if not _is_store(path):
            problem = f"{path} is no store of finished tasks, or one of another version of granphon"
            why = "The finished parts of work under way are kept in a file of that name"
            raise OutputError(problem, why, "Move it away, or choose another folder")
        return True

    def _explain(self, error: OSError | sqlite3.Error, use: str = "written") -> OutputError:
        """Return the error of a file that cannot be put to a ``use``, "read" or "written", from an
        ``error`` of the system or of SQLite; an ``error`` that is an OutputError is returned as it
        is.
        """
        if isinstance(error, OutputError):
            return error
        if isinstance(error, FileNotFoundError):
            problem = (
                f"{self.path}, or its folder, has been removed or replaced while it was in use"
            )
            mend = "Run the same command again: it starts from the beginning"
            return OutputError(problem, "The parts that were finished are not there", mend)
        is_full = getattr(error, "sqlite_errorcode", None) == sqlite3.SQLITE_FULL
        error_number = errno.ENOSPC if is_full else getattr(error, "errno", None)
        reason = os.strerror(error_number) if error_number else str(error)
        problem = f"{self.path} cannot be {use}: {reason}"
        why = "What was finished before is kept"
        if error_number == errno.ENOSPC:
            return OutputError(problem, why, "Free some space, and run the same command again")
        return OutputError(problem, why, f"Run the same command again when it can be {use}")

    def close(self) -> None:
        """Wait until all results are on the disk, and close the file; the next call that needs the
        file opens it again. A store in memory loses its results.
        """
        if self._base is not None:
            self._base.close()
            self._base = None
            if self._is_unsynced and self.path is not None:
                with suppress(OSError), open(self.path, "r+b") as stream:
                    os.fsync(stream.fileno())
            self._is_unsynced = False

    def __del__(self) -> None:
        """Close the file of a store that nobody has closed, without waiting for the disk."""
        if self._base is not None:
            self._base.close()

    def clear(self) -> None:
        """Close the store and delete its file, with every result; a file that has replaced it
        stays. A store in memory loses its results. OutputError if the file is not open, and its
        path is that of something else than a store.
        """
        if self.path is None:
            has_own_file = False
        elif self._base is None:
            has_own_file = self._has_file()
        else:
            has_own_file = _identify(self.path) == self._file
        self.close()
        if not has_own_file:
            return
        for name in (f"{self.path}", f"{self.path}-journal"):
            with suppress(OSError):
                os.unlink(name)


@contextmanager
def open_store(path: Path | None, *, force: bool = False) -> Iterator[Store]:
    """Open a store, and clear it if the block ends well; after a failure its results stay, so that
    a later run can go on from them. ``path`` and ``force`` are those of :class:`Store`.
    """
    store = Store(path, force)
    try:
        yield store
        store.clear()
    finally:
        store.close()


def _identify(path: Path) -> tuple[int, int]:
    """Return device and inode, which identify a folder or a file whatever its name; zeros if
    ``path`` names nothing.
    """
    with suppress(OSError):
        status = os.lstat(path)
        return status.st_dev, status.st_ino
    return 0, 0


def _is_store(path: Path) -> bool:
    """Whether ``path`` is an ordinary file that is empty, or whose head is that of a store."""
    if not stat.S_ISREG(path.lstat().st_mode):
        return False
    with path.open("rb") as stream:
        head = stream.read(100)  # bytes: the head of a file of SQLite
    if not head:
        return True
    return head.startswith(_SQLITE) and head[60:64] == _VERSION and head[68:72] == _KIND


def _require_sound(base: sqlite3.Connection) -> None:
    """Raise DatabaseError unless a data base is empty, or has the one table of a store,
    undamaged.
    """
    # the base may come from anywhere: functions that its schema calls are not to be run
    base.execute("PRAGMA trusted_schema = OFF")
    rows = base.execute("SELECT sql FROM sqlite_master WHERE sql IS NOT NULL")
    tables = [table for (table,) in rows]
    if tables and tables != [_TABLE]:
        raise sqlite3.DatabaseError("it holds something else")
    for (verdict,) in base.execute("PRAGMA integrity_check(1)").fetchall():
        if verdict != "ok":
            raise sqlite3.DatabaseError(verdict)


def _write_entries(base: sqlite3.Connection, entries: Mapping[str, bytes]) -> None:
    """Write ``entries``, by name, in place of those of the same names; make the table first if
    there is none. An entry is cut into pieces of :data:`_PIECE` bytes, one a row; the last piece
    is shorter, and may be empty.
    """
    if _is_empty(base):
        for command in _MAKE:
            base.execute(command)
    for name, entry in entries.items():
        n_pieces = 1 + len(entry) // _PIECE
        rows = [
            (name, piece, entry[piece * _PIECE : (piece + 1) * _PIECE]) for piece in range(n_pieces)
        ]
        base.execute("DELETE FROM task WHERE name = ?", (name,))
        base.executemany("INSERT INTO task VALUES (?, ?, ?)", rows)


def _is_empty(base: sqlite3.Connection) -> bool:
    """Whether a data base has no table."""
    return not base.execute("SELECT 1 FROM sqlite_master LIMIT 1").fetchall()


def _explain_difference(kept: Any, claimed: Any) -> str:
    """Return a sentence on how two works differ, by their identities, which are plain data:
    ``kept``, of the work whose results are in a store, and ``claimed``, of the work that claims the
    store.
    """
    if not kept:
        return "The file does not say which work it belongs to"
    differences = list(_find_differences(kept, claimed, ""))
    clauses = differences[:_MOST_NAMED]
    if len(differences) > _MOST_NAMED:
        clauses.append(f"and {len(differences) - _MOST_NAMED} more")
    return f"They differ: {'; '.join(clauses)}"


def _find_differences(kept: Any, claimed: Any, where: str) -> Iterator[str]:
    """Yield the differences of two identities, in words: "there" is the identity ``kept`` in the
    store, "here" the ``claimed`` one; ``where`` names the part of the identities.
    """
    if isinstance(kept, dict) and isinstance(claimed, dict):
        for key in kept | claimed:
            name = f"{where}.{key}" if where else str(key)
            if key in kept and key in claimed:
                yield from _find_differences(kept[key], claimed[key], name)
            else:
                place = "there" if key in kept else "here"
                yield f"{name} is given {place} only"
    elif isinstance(kept, list) and isinstance(claimed, list):
        if len(kept) != len(claimed):
            yield f"{where} has {len(kept)} values there, and {len(claimed)} here"
            return
        for index in range(len(kept)):
            yield from _find_differences(kept[index], claimed[index], f"{where}[{index}]")
    elif kept != claimed:
        yield f"{where} is {show(kept)} there, and {show(claimed)} here"
