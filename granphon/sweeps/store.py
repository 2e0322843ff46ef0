"""The store of finished tasks: one file, to which the result of each task is appended as soon as it is found.

The file is a log of entries (:mod:`granphon.sweeps.entries`): results, and the identity of the work that they belong to.
The last sound entry of a name counts. Another process may read the file while it grows. Whatever damages it, be it a kill or
a crash of the machine in the middle of a write, the other entries are found, and what is lost is computed again.

It is a log, and no data base, because folders of results often stand on network file systems, on whose locks and shared
memory a data base cannot rely, and because one damaged page must not cost the others.
"""

from __future__ import annotations

import errno
import json
import os
import stat
import time
from collections.abc import Callable, Iterable, Iterator, Mapping
from contextlib import contextmanager, suppress
from io import FileIO
from pathlib import Path
from typing import Any

from granphon.base.errors import FileExistsInRunError, OutputError, message
from granphon.base.text import show
from granphon.sweeps.entries import (
    HEAD,
    IDENTITY,
    MARK,
    TaskResult,
    decode,
    name_of,
    read_body,
    read_bytes_at,
    read_part,
    scan,
    wrap,
)

__all__ = ["Store", "open_store"]

#: longest time for which entries are left to the system's memory before they are forced to the disk, s
_SYNC_SECONDS = 1.0
#: bytes of outdated entries from which the file is written anew without them, if they are more than the others
_MOST_OUTDATED = 64_000_000
#: largest number of differences between two works that a message names
_MOST_NAMED = 3


# -- the store ------------------------------------------------------------------------------------------------------


class Store:
    """The results of finished tasks and steps, by name: in one file, or in memory if ``path`` is None.

    The file is made when the first result is kept; its folder must exist, and be locked by the caller against other
    writers. It belongs to one work, see :meth:`claim`; ``force`` lets another work discard its results.
    """

    def __init__(self, path: Path | None = None, force: bool = False) -> None:
        self._stream: FileIO | None = None
        self.path, self.force = path, force
        #: entries that are held in memory, where there is no file
        self._held: dict[str, bytes] = {}
        #: place and length of the entries in the file, once it has been scanned
        self._places: dict[str, tuple[int, int]] | None = None
        #: end of the last sound entry, and bytes of those before it that a later one has replaced
        self._end, self._outdated = 0, 0
        #: body of the entry with the identity of the work that left results there; and the entry that is to be written first
        self._before = b""
        self._pending = b""
        self._home: tuple[int, int] | None = None
        self._synced = time.monotonic()

    def claim(self, identity: Mapping[str, Any] | None, names: Callable[[], Iterable[str]] = tuple) -> None:
        """Claim the store for the work that ``identity``, plain data, describes; None claims it for no work.

        Results that the store holds are used. Another work may have left them if all of them are among ``names``, the names
        of this work's tasks. They belong to this work once it keeps a result of its own.

        Raises
        ------
        OutputError : ``path`` exists and is no store, or may not be written to, and is not discarded.
        FileExistsInRunError : there is a result of another work that is not among ``names``, and ``force`` is off. If
            ``force`` is on, all results are discarded instead.
        """
        if self.path is None:
            return
        self._home = _identify_folder(self.path.parent)
        text = json.dumps(identity, sort_keys=True)
        there, mine = self._list(), json.loads(text)
        before = _read_identity(self._before)
        if (identity is None or before != mine) and there.keys() - set(names()):
            if not self.force:
                raise FileExistsInRunError(
                    message(
                        f"{self.path} holds the finished part of other work, which was interrupted",
                        _explain_difference(before, mine),
                        "Repeat that command to continue it, use --force (force=True, overwrite=True) to discard what it "
                        "has finished, or choose another folder",
                    )
                )
            self.clear()
        if there and self.path.exists() and not os.access(self.path, os.W_OK):
            raise self._explain(PermissionError(errno.EACCES, os.strerror(errno.EACCES)))
        if identity is not None:
            self._pending = b"" if before == mine else f"{IDENTITY}\n{text}".encode()

    def __contains__(self, name: str) -> bool:
        return name in (self._held if self.path is None else self._list())

    def read(self, name: str) -> TaskResult | None:
        """Return the result of the task of this name or of its first steps; None if there is none, or it is damaged."""
        if self.path is None:
            entry = self._held.get(name)
            return None if entry is None else decode(entry)
        place = self._list().get(name)
        if place is None:
            return None
        with suppress(OSError):
            stream = self._open(writing=False)
            body = read_body(stream, place[0], sum(place))
            if body is not None and name_of(body) == name:
                return read_part(body)
        return None

    def append(self, name: str, entry: bytes) -> None:
        """Keep the result of the task of this name, as :func:`~granphon.sweeps.entries.encode` has written it.

        Once this returns, a kill does not lose it.

        Raises :class:`~granphon.base.errors.OutputError` if the file cannot be written, or has been removed or replaced:
        only the process that has locked its folder may write there.
        """
        if self.path is None:
            self._held[name] = entry
            return
        places = self._list()
        stream = self._open(writing=True)
        whose = wrap(self._pending) if self._pending else b""  # in one write: no file holds the identity of work alone
        place = self._put(stream, whose + entry) + len(whose)
        self._before, self._pending = self._pending or self._before, b""
        self._outdated += places[name][1] if name in places else 0
        places[name] = (place, len(entry))
        if self._outdated > max(_MOST_OUTDATED, self._end - self._outdated):
            self._write_anew()
        elif (now := time.monotonic()) - self._synced > _SYNC_SECONDS:
            os.fsync(stream.fileno())
            self._synced = now

    def _put(self, stream: FileIO, entry: bytes) -> int:
        """Append an entry and return its place; if that fails, the file is left as it was."""
        place = self._require_same(stream)
        try:
            view = memoryview(entry)
            while view:
                view = view[stream.write(view) :]
        except OSError as error:
            with suppress(OSError):
                stream.truncate(place)
                if not place:
                    self._remove()
            raise self._explain(error) from None
        self._end = place + len(entry)
        return place

    def _require_same(self, stream: FileIO) -> int:
        """Return the size of the file; :class:`~granphon.base.errors.OutputError` if it is not at its path any more."""
        opened = os.fstat(stream.fileno())
        with suppress(OSError):
            if self.path is not None and os.path.samestat(opened, os.lstat(self.path)):
                return opened.st_size
        raise self._explain_loss()

    def _list(self) -> dict[str, tuple[int, int]]:
        """Return place and length of the sound entries by name; the file is scanned once."""
        if self._places is not None:
            return self._places
        self._places = {}
        if not self._check():
            return self._places
        try:
            stream = self._open(writing=False)
            for place, body in scan(stream):
                name, length = name_of(body), HEAD + len(body)
                self._end = place + length
                if name == IDENTITY:
                    self._before = body
                    continue
                self._outdated += self._places[name][1] if name in self._places else 0
                self._places[name] = (place, length)
            start = read_bytes_at(stream, 0, 1_000_000)
        except OSError as error:
            raise self._explain(error, "read") from None
        if not self._end and start.strip(b"\0") and not start.startswith(MARK[: len(start)]):
            self.close()
            newer = start.startswith(MARK.rstrip(b"\0"))
            raise self._explain_stranger("of another version of granphon" if newer else "no store of finished tasks")
        return self._places

    def _check(self) -> bool:
        """Return whether there is a file; :class:`~granphon.base.errors.OutputError` if something else is there."""
        try:
            found = os.lstat(str(self.path))
        except FileNotFoundError:
            return False
        except OSError as error:
            raise self._explain(error, "read") from None
        if not stat.S_ISREG(found.st_mode):
            kinds = {stat.S_IFLNK: "a symbolic link", stat.S_IFDIR: "a folder"}
            raise self._explain_stranger(kinds.get(stat.S_IFMT(found.st_mode), "not a file"))
        return True

    def _open(self, writing: bool) -> FileIO:
        """Return the open file; to write, it is made if need be, and what a kill has left at its end is cut off."""
        if self._stream is not None and (self._stream.writable() or not writing):
            return self._stream
        self.close()
        flags = getattr(os, "O_NOFOLLOW", 0) | getattr(os, "O_BINARY", 0)
        flags |= os.O_RDWR | os.O_APPEND | os.O_CREAT if writing else os.O_RDONLY
        try:
            if writing and self._home not in (None, _identify_folder(Path(str(self.path)).parent)):
                raise FileNotFoundError
            descriptor = os.open(str(self.path), flags, 0o666)
        except FileNotFoundError:
            raise self._explain_loss() from None
        except OSError as error:
            raise self._explain(error, "written" if writing else "read") from None
        self._stream = FileIO(descriptor, "a+" if writing else "r")
        if writing and os.fstat(descriptor).st_size > self._end:
            os.ftruncate(descriptor, self._end)
        return self._stream

    def _write_anew(self) -> None:
        """Write the file anew without the entries that later ones have replaced."""
        if self.path is None or self._places is None or self._stream is None:
            return
        draft, places, end = self._draft, dict[str, tuple[int, int]](), 0
        try:
            with open(draft, "wb") as stream:
                if self._before:
                    end += stream.write(wrap(self._before))
                for name, (place, length) in self._places.items():
                    places[name] = (end, length)
                    end += stream.write(read_bytes_at(self._stream, place, length))
                stream.flush()
                os.fsync(stream.fileno())
            self._require_same(self._stream)
            self.close()
            os.replace(draft, self.path)
        except OSError as error:
            raise self._explain(error) from None
        self._places, self._end, self._outdated = places, end, 0

    @property
    def _draft(self) -> str:
        return f"{self.path}.new"

    def _explain_stranger(self, kind: str) -> OutputError:
        why = "The finished parts of work under way are kept in a file of that name"
        return OutputError(message(f"{self.path} is {kind}", why, "Move it away, or choose another folder"))

    def _explain(self, error: OSError, done: str = "written") -> OutputError:
        if isinstance(error, OutputError):
            return error
        what, why = f"{self.path} cannot be {done}: {error.strerror or error}", "What was finished before is kept"
        mend = f"Run the same command again when it can be {done}"
        if error.errno == errno.ENOSPC:
            mend = "Free some space, and run the same command again"
        return OutputError(message(what, why, mend))

    def _explain_loss(self) -> OutputError:
        home = Path(str(self.path)).parent
        lost = self.path if self._home in (None, _identify_folder(home)) else home
        what, why = f"{lost} has been removed or replaced while it was written", "The parts that were finished are not there"
        return OutputError(message(what, why, "Run the same command again: it starts from the beginning"))

    def close(self) -> None:
        """Force what has been written to the disk, and close the file; it is opened again when it is needed."""
        if self._stream is not None:
            stream, self._stream = self._stream, None
            with stream, suppress(OSError):
                if stream.writable():
                    os.fsync(stream.fileno())

    def __del__(self) -> None:
        self.close()

    def clear(self) -> None:
        """Delete every result, and the file."""
        ours = bool(self._end) or self._stream is not None
        self.close()
        self._held, self._places, self._end, self._outdated = {}, None, 0, 0
        self._before = b""
        if self.path is not None and ours:
            self._remove()

    def _remove(self) -> None:
        for name in (str(self.path), self._draft):
            with suppress(OSError):
                os.unlink(name)


@contextmanager
def open_store(path: Path | None, force: bool = False) -> Iterator[Store]:
    """Open a store at ``path``, and clear it if the block ends well; after a failure its results stay, to go on from."""
    store = Store(path, force)
    try:
        yield store
        store.clear()
    finally:
        store.close()


def _identify_folder(folder: Path) -> tuple[int, int] | None:
    """Return device and inode of a folder, which identify it whatever its name; None if it is not there."""
    with suppress(OSError):
        found = os.stat(folder)
        return found.st_dev, found.st_ino
    return None


# -- whose results they are -----------------------------------------------------------------------------------------


def _read_identity(body: bytes) -> Any:
    """Return the identity in the body of its entry; None if there is none."""
    with suppress(ValueError, RecursionError):
        return json.loads(body.partition(b"\n")[2])
    return None


def _explain_difference(there: Any, here: Any) -> str:
    """Say how the work there differs from the one here."""
    if here is None:
        return "This work has no parts that are kept, and its result would stand beside it"
    differences = "; ".join(_describe_differences(there, here))
    return f"They differ: {differences}" if there else "The file does not say which work it belongs to"


def _describe_differences(there: Any, here: Any) -> list[str]:
    """Describe the first few places where plain data differ."""
    found = list(_find_differences(there, here, ""))
    more = len(found) - _MOST_NAMED
    return found[:_MOST_NAMED] + ([f"and {more} more"] if more > 0 else [])


def _find_differences(there: Any, here: Any, where: str) -> Iterator[str]:
    if isinstance(there, dict) and isinstance(here, dict):
        for key in [*there, *(key for key in here if key not in there)]:
            name = f"{where}.{key}" if where else str(key)
            if key not in here or key not in there:
                yield f"{name} is given {'there' if key in there else 'here'} only"
            else:
                yield from _find_differences(there[key], here[key], name)
    elif isinstance(there, list) and isinstance(here, list):
        if len(there) != len(here):
            yield f"{where} has {len(there)} values there, and {len(here)} here"
        else:
            for index, (one, other) in enumerate(zip(there, here, strict=True)):
                yield from _find_differences(one, other, f"{where}[{index}]")
    elif there != here:
        yield f"{where} is {show(there)} there, and {show(here)} here"
