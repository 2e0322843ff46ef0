"""Result folders: files arrive whole and together, one run at a time, and the user's own files are
never replaced.

New files are collected in a hidden folder. One rename makes it ``.granphon-new``: from then on the
result counts. Then old files leave, and new ones move to their places; whoever looks at the folder
next completes that, if it was cut off. So a folder never shows files of two runs. The folder itself
is not renamed: it may hold the user's files, and be where one works.

``.granphon-files`` lists the files that granphon wrote into the folder, each with its SHA-256. A
file that is not listed, or has changed since, counts as the user's. ``.granphon-lock`` is locked by
the run that writes into the folder; the lock is released as soon as that process has ended, however
it ended.
"""

from __future__ import annotations

import errno
import hashlib
import json
import os
import shutil
import stat
import sys
import tempfile
from collections.abc import Collection, Iterator, Mapping, Sequence
from contextlib import contextmanager, suppress
from dataclasses import KW_ONLY, dataclass
from pathlib import Path
from typing import Self
from uuid import uuid4

from granphon.base.errors import FileExistsInRunError, GranphonError, OutputError, require_installed
from granphon.base.text import read_bytes

#: the list of the files that granphon wrote into a folder; a list of another version counts as
#: empty
LIST = ".granphon-files"
LIST_SCHEMA = 1
#: the file that is locked by the run that writes into a folder
LOCK = ".granphon-lock"
#: how much of a file is read to know its kind, bytes
_HEAD_BYTES = 1000
#: how names of folders begin in which new files are collected, and the name of such a folder when
#: it is complete
PREFIX = ".granphon-staging-"
NEW = ".granphon-new"
#: error numbers of a file system that does not support locks
_NO_LOCKS = {errno.ENOTSUP, errno.EOPNOTSUPP, errno.ENOLCK, errno.ENOSYS}

StrPath = str | os.PathLike[str]

if sys.platform == "win32":
    import msvcrt

    def _lock(descriptor: int) -> None:
        msvcrt.locking(descriptor, msvcrt.LK_NBLCK, 1)
else:
    import fcntl

    def _lock(descriptor: int) -> None:
        fcntl.flock(descriptor, fcntl.LOCK_EX | fcntl.LOCK_NB)


def has_locks(descriptor: int) -> bool:
    """Whether the file system of an open file supports the locks of POSIX, which SQLite uses."""
    try:
        if sys.platform != "win32":
            fcntl.lockf(descriptor, fcntl.LOCK_SH | fcntl.LOCK_NB)
    except OSError as error:
        return error.errno not in _NO_LOCKS
    return True


def read_written_files(folder: StrPath, what: str = "files") -> dict[str, str]:
    """Name and SHA-256 of each file that granphon wrote into ``folder``, from its list; empty if
    there is no list.

    With ``what`` = "old", of each file that is to leave the folder. Only bare names count: others
    lead into another folder.
    """
    with suppress(GranphonError, ValueError, TypeError, KeyError, AttributeError, RecursionError):
        data = json.loads(read_bytes(Path(folder) / LIST))
        if data["schema"] == LIST_SCHEMA:
            return {
                name: digest
                for name, digest in data[what].items()
                if isinstance(digest, str) and _is_bare(name)
            }
    return {}


def _is_bare(name: str) -> bool:
    """Whether a name is that of a file, and leads into no other folder."""
    return Path(name).name == name and name not in ("", ".", "..")


def _digest_file(path: Path) -> str:
    """Return the SHA-256 of a file."""
    with path.open("rb") as stream:
        return hashlib.file_digest(stream, "sha256").hexdigest()


def _is_written(path: Path, *digests: str) -> bool:
    """Whether ``path`` is a regular file, not a link, whose SHA-256 is one of ``digests``."""
    if not digests or not path.is_file() or path.is_symlink():
        return False
    return _digest_file(path) in digests


def is_whole(folder: StrPath, names: Sequence[str]) -> bool:
    """Whether ``folder`` holds files of all ``names`` as granphon has written them."""
    written = read_written_files(folder)
    if not all(name in written for name in names):
        return False
    return all(_is_written(Path(folder) / name, written[name]) for name in names)


@dataclass(frozen=True)
class ResultFiles:
    """The files that a result consists of, in one folder, and what may make way for them.

    Parameters
    ----------
    folder : the folder of the results; it need not exist.
    names : the files to be written.
    force : files of these names may be replaced, if granphon wrote them and nobody has changed them
        since.
    earlier : files of an earlier result that are to be removed, if granphon wrote them; if one has
        been changed since, it may not be removed, and an error is raised.
    inputs : files that the run reads, which are never replaced.
    known : texts of files; a file with such a text counts as written by granphon, whatever the list
        of the folder says.
    """

    folder: StrPath
    names: Sequence[str]
    force: bool = False
    _: KW_ONLY
    earlier: Sequence[str] = ()
    inputs: Collection[StrPath] = ()
    known: Collection[str] = ()

    @property
    def _target(self) -> Path:
        return Path(self.folder)

    def require_free(self) -> None:
        """Raise if the files cannot be written, as far as can be told without writing.

        Raises
        ------
        FileExistsInRunError : a file exists and ``force`` is off, or it may not be replaced or
            removed at all.
        MissingPackageError : a file is one of netCDF, and what writes it is not installed.
        OutputError : the folder is a file, or may not be written to, or one of the ``names`` is a
            folder.
        """
        if any(name.endswith(".nc") for name in self.names):
            require_installed("A netCDF file", "h5netcdf", "h5py")
        with suppress(OSError, ValueError):
            # the check that follows reports what is wrong with the folder
            if (self._target / NEW).is_dir() or any(self._target.glob(PREFIX + "*")):
                with _hold_lock(self._target) as alone:
                    _finish(self._target, alone)
        self._check()

    @contextmanager
    def open(self) -> Iterator[Self]:
        """Make the folder if need be, and lock it, so that no other run writes into it until the
        end of the block.

        Errors are those of :meth:`require_free`; also raises
        :class:`~granphon.base.errors.OutputError` if another run has the lock. Folders that were
        made here and are still empty at the end are removed again.
        """
        self.require_free()
        target = self._target
        made = list[Path]()
        try:
            with explaining(target):
                missing = [folder for folder in (target, *target.parents) if not folder.exists()]
                for folder in reversed(missing):  # the outermost first
                    folder.mkdir(exist_ok=True)
                    made.append(folder)
            with _hold_lock(target) as alone:
                with explaining(target):
                    _finish(target, alone)
                # checked again: another run may have written files before the lock was taken
                self._check()
                yield self
        finally:
            for folder in reversed(made):
                with suppress(OSError):  # a folder that holds a result is not empty, and stays
                    folder.rmdir()

    @contextmanager
    def staging(self, optional: Sequence[str] = ()) -> Iterator[Path]:
        """Make a temporary folder for the files, which all move into their folder at the end of the
        block.

        The folder must be under lock, see :meth:`open`. Files that are also in ``optional`` need
        not be written. If the block fails, the folder is left as it was found. If what follows it
        fails, the next run that looks at the folder completes it. Raises
        :class:`~granphon.base.errors.OutputError` for any failure of the file system.
        """
        target = self._target
        place = None
        with explaining(target):
            try:
                place = Path(tempfile.mkdtemp(prefix=PREFIX, dir=target))
                yield place
                self._check()
                made = [
                    name
                    for name in self.names
                    if name not in optional or os.path.lexists(place / name)
                ]
                self._write_list(place, made)
                for name in (*made, LIST):
                    with open(place / name, "r+b") as stream:
                        os.fsync(stream.fileno())
                os.rename(place, target / NEW)  # from here on the result counts
                _finish(target)
            except BaseException:
                _finish(target)  # an interruption does not end it half way
                raise
            finally:
                if place is not None:
                    shutil.rmtree(place, ignore_errors=True)

    def _write_list(self, place: Path, made: Sequence[str]) -> None:
        """Write into the folder ``place``, beside the new files that were ``made``, the list of the
        folder as it is to be: digests of its files, and of the old ones that make way.
        """
        target = self._target
        # what has a known text may be absent there
        written = read_written_files(target)
        existing = [name for name in (*self.names, *self._stale) if os.path.lexists(target / name)]
        old = {name: written.get(name) or _digest_file(target / name) for name in existing}
        files = {name: digest for name, digest in written.items() if name not in old}
        files |= {name: _digest_file(place / name) for name in made}
        content = json.dumps({"schema": LIST_SCHEMA, "files": files, "old": old}, indent=1)
        (place / LIST).write_text(content, encoding="utf-8")

    def _check(self) -> None:
        """Raise :class:`~granphon.base.errors.OutputError` if the files cannot be written into
        their folder, or would replace files that are not an earlier result of granphon.
        """
        target = self._target
        if any("\0" in part for part in (str(target), *self.names)):
            raise OutputError(
                f"{str(target)!r} cannot be written: a null character is part of the name"
            )
        with explaining(target):
            nearest = target
            while not os.path.lexists(nearest) and nearest != nearest.parent:
                nearest = nearest.parent
            if not nearest.is_dir():
                raise OutputError(
                    f"{nearest} is not a folder",
                    f"{target} cannot be made",
                    "Choose another folder",
                )
            written = read_written_files(target)
            existing = [name for name in self.names if os.path.lexists(target / name)]
            folders = [name for name in existing if (target / name).is_dir()]
            if folders:
                raise OutputError(
                    f"{target / folders[0]} is a folder", "A file of that name is to be written"
                )
            self._require_own(existing, written)
            if existing and not self.force:
                self._refuse_existing(existing, written)
            for name in self._stale:
                self._require_removable(name, written[name])
            if not os.access(nearest, os.W_OK | os.X_OK):
                problem = f"there is no permission to write to {_name(nearest)}"
                raise OutputError(problem, mend="Choose another folder")

    def _require_own(self, existing: Sequence[str], written: Mapping[str, str]) -> None:
        """Raise :class:`FileExistsInRunError` if an existing file is read by this run, or is none
        that granphon wrote; ``written`` are the digests of files that granphon wrote.
        """
        target = self._target
        kept = "Such a file is never replaced, not even with --force"
        known_digests = [hashlib.sha256(text.encode("utf-8")).hexdigest() for text in self.known]
        for name in existing:
            if self._is_read(name):
                problem = f"{target / name} is read by this run, and would be overwritten"
                raise FileExistsInRunError(problem, kept, "Choose another folder")
            digests = list(known_digests)
            reason = "there is no record that granphon wrote it"
            if name in written:
                digests.append(written[name])
                reason = "granphon wrote it, and it has been changed since"
            if not _is_written(target / name, *digests):
                problem = f"{_name(target)} already holds {name}: {reason}"
                raise FileExistsInRunError(problem, kept, "Move it away, or choose another folder")

    def _refuse_existing(self, existing: Sequence[str], written: Mapping[str, str]) -> None:
        """Raise :class:`FileExistsInRunError` that names an earlier result, and what it lacks."""
        missing = [name for name in self.names if name in written and name not in existing]
        problem = f"{_name(self._target)} already holds {', '.join(existing)}"
        if missing:
            problem += f", but not {', '.join(missing)}, which granphon wrote there too"
        mend = "Use --force (force=True) to replace it, or choose another folder"
        raise FileExistsInRunError(
            problem, "An existing result is not overwritten unless asked for", mend
        )

    def _require_removable(self, name: str, digest: str) -> None:
        """Raise :class:`FileExistsInRunError` if a file of an earlier run is read by this run, or
        has another ``digest`` than when granphon wrote it.
        """
        target = self._target
        if self._is_read(name):
            reason = "this run reads it"
        elif not _is_written(target / name, digest):
            reason = "it has been changed since"
        else:
            return
        raise FileExistsInRunError(
            f"{_name(target)} holds {name} of an earlier run, and {reason}",
            "It would stand beside a result that it does not belong to, and granphon"
            " does not remove it",
            "Move it away, or choose another folder",
        )

    @property
    def _stale(self) -> list[str]:
        """Files of an earlier result, written by granphon, that the new result does not have."""
        target = self._target
        written = read_written_files(self.folder)
        candidates = [name for name in self.earlier if name in written and name not in self.names]
        return [name for name in candidates if os.path.lexists(target / name)]

    def _is_read(self, name: str) -> bool:
        """Whether a file of the folder is one that this run reads."""
        for path in self.inputs:
            with suppress(OSError):
                if os.path.samefile(self._target / name, path):
                    return True
        return False


def _finish(target: Path, alone: bool = False) -> None:
    """Move the files of a result that counts to their places; if no run is under way, remove what
    killed ones have left.
    """
    new = target / NEW
    if new.is_dir() and not new.is_symlink():
        _move_files(new, target)
    if not alone:
        return
    for place in target.glob(PREFIX + "*"):
        if place.is_dir() and not place.is_symlink():
            shutil.rmtree(place, ignore_errors=True)


def _move_files(new: Path, target: Path) -> None:
    """Move the files of the folder ``new`` into the folder ``target``, where old ones make way, and
    remove ``new``.
    """
    files = read_written_files(new)
    old = read_written_files(new, "old")
    waiting = [name for name in files if (new / name).is_file() and not (new / name).is_symlink()]
    for name, digest in old.items():
        is_replaced = name in waiting or name not in files
        if is_replaced and _is_written(target / name, digest):
            (target / name).unlink()
    for name in waiting:
        if os.path.lexists(target / name):  # the user has put it there meanwhile
            (new / name).unlink()
        else:
            os.rename(new / name, target / name)
    if files or old:
        os.replace(new / LIST, target / LIST)
    with suppress(OSError):  # what granphon did not put there stays
        new.rmdir()


def _name(folder: Path) -> Path:
    """Return a folder as messages name it: its whole path in the place of "." and "..", which say
    nothing in a sentence.
    """
    return folder.resolve() if folder.name in ("", "..") else folder


@contextmanager
def explaining(target: Path, why: str = "It is left as it was") -> Iterator[None]:
    """Turn errors of the file system into :class:`~granphon.base.errors.OutputError`; ``why`` says
    what the file is now.
    """
    try:
        yield
    except GranphonError:
        raise
    except OSError as error:
        problem = f"{_name(target)} cannot be written: {error.strerror or error}"
        if os.path.isdir(target / NEW):
            why_half = f"The files of the new result are in {NEW} there"
            mend_half = "Any command that uses the folder moves them to their places"
            raise OutputError(problem, why_half, mend_half) from None
        mend = "Choose another folder"
        if error.errno == errno.ENOSPC:
            mend = "Free some space, or choose another folder"
        raise OutputError(problem, why, mend) from None


@contextmanager
def _hold_lock(target: Path) -> Iterator[bool]:
    """Hold the lock during the block; yield whether it is certain that no other run is under way.

    On a file system that does not support locks, it is not.
    """
    path = target / LOCK
    is_own = False
    while not is_own:
        descriptor = _open_lock(path)
        try:
            _lock(descriptor)
        except OSError as error:
            os.close(descriptor)
            if error.errno in _NO_LOCKS:
                yield False
                return
            problem = f"another run is writing into {_name(path.parent)}"
            why = "Two runs would mix their files"
            raise OutputError(
                problem, why, "Wait until it ends, or choose another folder"
            ) from None
        with suppress(OSError):
            # another run may have removed the file between opening and locking it here; then try
            # again
            is_own = os.path.samestat(os.fstat(descriptor), os.stat(path))
        if not is_own:
            os.close(descriptor)
    try:
        yield True
    finally:
        with suppress(OSError):  # where an open file cannot be removed, it stays
            path.unlink()
        os.close(descriptor)


def _open_lock(path: Path) -> int:
    """Open the file of a lock, which is made if need be, and return its descriptor; OutputError if
    granphon did not make that file.
    """
    with explaining(path.parent):
        descriptor = os.open(path, os.O_RDWR | os.O_CREAT | getattr(os, "O_NOFOLLOW", 0), 0o666)
    status = os.fstat(descriptor)
    if stat.S_ISREG(status.st_mode) and not status.st_size:
        return descriptor
    os.close(descriptor)
    raise OutputError(
        f"{path} is not a lock that granphon made",
        "A lock of granphon is an empty file",
        "Move it away, or choose another folder",
    )


def write_text(path: StrPath, text: str, replace: bool = False) -> None:
    """Write a text in UTF-8, whole or not at all; its folder is made if need be.

    A file that is there makes way for another of its kind: one whose head names granphon too or, if
    the new one's does not, begins with the same line. With ``replace`` any file does.

    Raises
    ------
    FileExistsInRunError : another file is there, which is the user's.
    OutputError : for any other failure of the file system.
    """
    target = Path(path)
    data = text.encode("utf-8")
    with explaining(target):
        if target.is_dir():
            raise OutputError(f"{target} is a folder", "A file of that name is to be written")
        if not replace and os.path.lexists(target):
            with open(target, "rb") as stream:
                old_head = stream.read(_HEAD_BYTES)
            if old_head and not _are_alike(old_head, data[:_HEAD_BYTES]):
                problem = f"{target} is there, and is no such file of granphon"
                raise FileExistsInRunError(problem, mend="Give another name")
        with put_beside(target) as place, open(place, "xb") as stream:
            stream.write(data)
            stream.flush()
            os.fsync(stream.fileno())


def _are_alike(old_head: bytes, new_head: bytes) -> bool:
    """Whether the heads of two files are of one kind: both name granphon or, if the new one does
    not, begin with the same line.
    """
    if b"granphon" in new_head:
        return b"granphon" in old_head
    return old_head.split(b"\n")[0] == new_head.split(b"\n")[0]


@contextmanager
def put_beside(target: Path) -> Iterator[Path]:
    """Give the path of a file that takes the place of ``target`` after the block, or is removed if
    that fails.

    The folder is made if need be. Raises :class:`~granphon.base.errors.OutputError` for a failure
    of the file system.
    """
    place = target.with_name(f".granphon-{uuid4().hex}")
    with explaining(target):
        try:
            target.parent.mkdir(parents=True, exist_ok=True)
            yield place
            os.replace(place, target)
        except ValueError as error:  # a null character in the name
            raise OSError(str(error)) from None
        finally:
            with suppress(OSError, ValueError):
                place.unlink()
