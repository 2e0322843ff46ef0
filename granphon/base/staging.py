"""Result folders: files arrive whole and together, one run at a time, and the user's own files are never replaced.

Three hidden names may stand in a folder. ``.granphon-files`` lists the files that granphon wrote there
(:mod:`granphon.base.written_files`); all other files are the user's, and are never replaced or deleted.
``.granphon-lock`` is locked by the run that writes into the folder; the lock is released as soon as that process has ended,
however it ended. ``.granphon-staging-*`` holds new files until all of them are complete.

The exchange of old files for new ones is recorded before its first step. Old files leave before new ones arrive, so a folder
never shows files of two runs. If an exchange was cut off, the next run that looks at the folder completes it.
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
from collections.abc import Collection, Iterator, Sequence
from contextlib import contextmanager, suppress
from dataclasses import KW_ONLY, dataclass
from pathlib import Path
from typing import Any, Self

from granphon.base.errors import FileExistsInRunError, GranphonError, OutputError, message
from granphon.base.written_files import LIST, digest_file, is_written, read_record, read_written_files, write_list_text

__all__ = ["ResultFiles", "has_locks", "write_bytes", "write_text"]

#: the file that is locked by the run that writes into a folder
LOCK = ".granphon-lock"
#: how names of staging folders begin
PREFIX = ".granphon-staging-"
#: inside a staging folder: the record of its exchange
_RECORD = ".exchange"
#: inside a staging folder: the folder of the files that are being replaced
_REPLACED = ".replaced"
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


# -- a result in its folder ------------------------------------------------------------------------------------------


def _is_same_file(path: Path, other: StrPath) -> bool:
    with suppress(OSError):
        return os.path.samefile(path, other)
    return False


@dataclass(frozen=True)
class ResultFiles:
    """The files that a result consists of, in one folder, and what may make way for them.

    Parameters
    ----------
    folder : the folder of the results; it need not exist.
    names : the files to be written.
    force : files of these names may be replaced, if granphon wrote them and nobody has changed them since.
    earlier : files of an earlier result that are to be removed, if granphon wrote them; if one has been changed since, it
        may not be removed, and an error is raised.
    inputs : files that the run reads, which are never replaced.
    known : texts of files; a file with such a text counts as written by granphon, whatever the list of the folder says.
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
        FileExistsInRunError : a file exists and ``force`` is off, or it may not be replaced or removed at all.
        OutputError : the folder is a file, or may not be written to, or one of the ``names`` is a folder.
        """
        _recover_unless_locked(self._target)
        self._check()

    @contextmanager
    def open(self) -> Iterator[Self]:
        """Make the folder if need be, and lock it, so that no other run writes into it until the end of the block.

        Errors are those of :meth:`require_free`; also raises :class:`~granphon.base.errors.OutputError` if another run has
        the lock. Folders that were made here and are still empty at the end are removed again.
        """
        self.require_free()
        target, made = self._target, list[Path]()
        try:
            try:
                for missing in [p for p in (target, *target.parents) if not p.exists()][::-1]:
                    missing.mkdir(exist_ok=True)
                    made.append(missing)
            except OSError as error:
                raise _explain_failure(target, error) from None
            with _hold_lock(target) as alone:
                if alone:
                    _recover(target)
                # checked again: another run may have written files before the lock was taken
                self._check()
                yield self
        finally:
            for one in reversed(made):
                with suppress(OSError):  # a folder that holds a result is not empty, and stays
                    one.rmdir()

    @contextmanager
    def staging(self, optional: Sequence[str] = ()) -> Iterator[Path]:
        """Make a temporary folder for the files, which all move into their folder at the end of the block.

        The folder must be under lock, see :meth:`open`. Files that are also in ``optional`` need not be written. If anything
        fails, in the block or while files are exchanged, the folder is left as it was found. Raises
        :class:`~granphon.base.errors.OutputError` for any failure of the file system.
        """
        target, place = self._target, None
        try:
            place = Path(tempfile.mkdtemp(prefix=PREFIX, dir=target))
            yield place
            made = [name for name in self.names if name not in optional or os.path.lexists(place / name)]
            self._check()
            _exchange(place, target, made, [*self._stale, *(name for name in self.names if name not in made)])
        except OSError as error:
            raise _explain_failure(target, error) from None
        finally:
            # a record that is still there marks an exchange neither completed nor undone: the next run completes it
            if place is not None and not os.path.lexists(place / _RECORD):
                shutil.rmtree(place, ignore_errors=True)

    def _check(self) -> None:
        target = self._target
        try:
            if any("\0" in part for part in (str(target), *self.names)):
                raise OutputError(message(f"{str(target)!r} cannot be written: a null character is part of the name"))
            nearest = target
            while not os.path.lexists(nearest) and nearest != nearest.parent:
                nearest = nearest.parent
            if not nearest.is_dir():
                raise OutputError(message(f"{nearest} is not a folder", f"{target} cannot be made", "Choose another folder"))
            self._require_replaceable()
            if not os.access(nearest, os.W_OK | os.X_OK):
                what = f"there is no permission to write to {_name(nearest)}"
                raise OutputError(message(what, mend="Choose another folder"))
        except OSError as error:
            raise _explain_failure(target, error) from None

    def _require_replaceable(self) -> None:
        target = self._target
        there = [name for name in self.names if os.path.lexists(target / name)]
        folders = [name for name in there if (target / name).is_dir()]
        if folders:
            raise OutputError(message(f"{target / folders[0]} is a folder", "A file of that name is to be written"))
        written, known = (
            read_written_files(target),
            {hashlib.sha256(text.encode("utf-8")).hexdigest() for text in self.known},
        )
        kept = "Such a file is never replaced, not even with --force"
        for name in there:
            if self._is_read(name):
                what = f"{target / name} is read by this run, and would be overwritten"
                raise FileExistsInRunError(message(what, kept, "Choose another folder"))
            if not is_written(target / name, *known, *([written[name]] if name in written else [])):
                no_record = "there is no record that granphon wrote it"
                what = "granphon wrote it, and it has been changed since" if name in written else no_record
                what = f"{_name(target)} already holds {name}: {what}"
                raise FileExistsInRunError(message(what, kept, "Move it away, or choose another folder"))
        if there and not self.force:
            lost = [name for name in self.names if name in written and name not in there]
            missing = f", but not {', '.join(lost)}, which granphon wrote there too" if lost else ""
            raise FileExistsInRunError(
                message(
                    f"{_name(target)} already holds {', '.join(there)}{missing}",
                    "An existing result is not overwritten unless asked for",
                    "Use --force (force=True) to replace it, or choose another folder",
                )
            )
        for name in self._stale:
            read = self._is_read(name)
            if read or not is_written(target / name, written[name]):
                what = f"{_name(target)} holds {name} of an earlier run, and "
                what += "this run reads it" if read else "it has been changed since"
                why = "It would stand beside a result that it does not belong to, and granphon does not remove it"
                raise FileExistsInRunError(message(what, why, "Move it away, or choose another folder"))

    @property
    def _stale(self) -> list[str]:
        """Files of an earlier result, written by granphon, that the new result does not have."""
        target, written = self._target, read_written_files(self.folder)
        return [one for one in self.earlier if one in written and one not in self.names and os.path.lexists(target / one)]

    def _is_read(self, name: str) -> bool:
        return any(_is_same_file(self._target / name, one) for one in self.inputs)


def _name(folder: Path) -> Path:
    """Return a folder as messages name it: its whole path in the place of "." and "..", which say nothing in a sentence."""
    return folder.resolve() if folder.name in ("", "..") else folder


def _explain_failure(target: Path, error: OSError) -> GranphonError:
    if isinstance(error, GranphonError):
        return error
    mend = "Free some space, or choose another folder" if error.errno == errno.ENOSPC else "Choose another folder"
    what = f"{_name(target)} cannot be written: {error.strerror or error}"
    return OutputError(message(what, "It is left as it was", mend))


# -- the lock --------------------------------------------------------------------------------------------------------


@contextmanager
def _hold_lock(target: Path) -> Iterator[bool]:
    """Hold the lock during the block; yield whether it is certain that no other run is under way.

    On a file system that does not support locks, it is not.
    """
    descriptor = _lock_file(target / LOCK)
    try:
        yield descriptor is not None
    finally:
        if descriptor is not None:
            with suppress(OSError):  # where an open file cannot be removed, it stays
                (target / LOCK).unlink()
            os.close(descriptor)


def _lock_file(path: Path) -> int | None:
    """Lock the file, and return its descriptor; None on a file system that does not support locks."""
    while True:
        try:
            descriptor = os.open(path, os.O_RDWR | os.O_CREAT | getattr(os, "O_NOFOLLOW", 0), 0o666)
        except OSError as error:
            raise _explain_failure(path.parent, error) from None
        about = os.fstat(descriptor)
        if not stat.S_ISREG(about.st_mode) or about.st_size:
            os.close(descriptor)
            what = f"{path} is not a lock that granphon made"
            raise OutputError(message(what, "A lock of granphon is an empty file", "Move it away, or choose another folder"))
        try:
            _lock(descriptor)
        except OSError as error:
            os.close(descriptor)
            if error.errno in _NO_LOCKS:
                return None
            what, why = f"another run is writing into {_name(path.parent)}", "Two runs would mix their files"
            raise OutputError(message(what, why, "Wait until it ends, or choose another folder")) from None
        with suppress(OSError):
            # another run may have removed the file between opening and locking it here; then try again
            if os.path.samestat(os.fstat(descriptor), os.stat(path)):
                return descriptor
        os.close(descriptor)


# -- the exchange ---------------------------------------------------------------------------------------------------


def _exchange(place: Path, target: Path, names: Sequence[str], stale: Sequence[str]) -> None:
    """Move files from ``place`` into ``target``, and those of ``stale`` out of it; on failure restore what was there."""
    for name in names:
        with open(place / name, "r+b") as stream:
            os.fsync(stream.fileno())
    written = read_written_files(target)
    there = [name for name in (*names, *stale) if os.path.lexists(target / name)]
    old = {name: written.get(name) or digest_file(target / name) for name in there}  # a known text need not be in the list
    files = {name: digest for name, digest in written.items() if name not in stale}
    files |= {name: digest_file(place / name) for name in names}
    (place / LIST).write_text(write_list_text(files), encoding="utf-8")
    replaced = place / _REPLACED
    replaced.mkdir()
    draft = place / (_RECORD + ".draft")
    draft.write_text(json.dumps({"new": [*names, LIST], "old": old}), encoding="utf-8")
    if os.path.lexists(target / LIST):
        shutil.copy2(target / LIST, replaced / LIST)
    os.replace(draft, place / _RECORD)  # from here on the exchange is either completed or undone
    gone: list[str] = []
    come: list[str] = []
    try:
        # each name is noted before its file moves, as an interruption may come between the two
        for name in old:
            gone.append(name)
            os.replace(target / name, replaced / name)
        for name in (*names, LIST):
            come.append(name)
            os.replace(place / name, target / name)
        (place / _RECORD).unlink()
    except BaseException:
        if not os.path.lexists(place / _RECORD):  # interrupted after the last step: the exchange is complete
            raise
        for name in come:  # new files go back into the staging folder
            if not os.path.lexists(place / name):
                os.replace(target / name, place / name)
        for name in (*gone, LIST):
            with suppress(FileNotFoundError):
                os.replace(replaced / name, target / name)
        (place / _RECORD).unlink()
        raise


def _recover(target: Path) -> None:
    """Complete the exchanges of runs that were killed, and remove what such runs have left."""
    for place in target.glob(PREFIX + "*"):
        if place.is_symlink() or not place.is_dir():  # not made by granphon; a link may lead elsewhere
            continue
        if os.path.lexists(place / _RECORD):
            record = read_record(place / _RECORD)
            new, old = record.get("new"), record.get("old")
            if not isinstance(new, list) or not isinstance(old, dict) or not all(map(_is_name, [*new, *old])):
                continue  # not a record that granphon wrote
            waiting = [name for name in new if (place / name).is_file() and not (place / name).is_symlink()]
            with suppress(OSError):
                for name, digest in old.items():
                    if (name in waiting or name not in new) and is_written(target / name, str(digest)):
                        (target / name).unlink()
                for name in waiting:
                    # keep a file that the user has put there meanwhile
                    if name == LIST or not os.path.lexists(target / name):
                        os.replace(place / name, target / name)
        shutil.rmtree(place, ignore_errors=True)


def _recover_unless_locked(target: Path) -> None:
    """Call :func:`_recover` if a run has left a staging folder, and no run is under way."""
    with suppress(OSError, ValueError):  # the check that follows reports what is wrong with the folder
        if any(target.glob(PREFIX + "*")):
            with _hold_lock(target) as alone:
                if alone:
                    _recover(target)


def _is_name(name: Any) -> bool:
    """Tell whether ``name`` is a bare file name, which cannot lead into another folder."""
    return isinstance(name, str) and Path(name).name == name and name not in ("", ".", "..")


# -- single files ---------------------------------------------------------------------------------------------------


def write_bytes(path: StrPath, *parts: bytes | memoryview) -> None:
    """Write a file that consists of these parts, whole or not at all; its folder is made if need be.

    A file of that name is replaced. Raises :class:`~granphon.base.errors.OutputError` for any failure of the file system.
    """
    target = Path(path)
    place: Path | None = None
    try:
        if target.is_dir():
            raise OutputError(message(f"{target} is a folder", "A file of that name is to be written"))
        target.parent.mkdir(parents=True, exist_ok=True)
        place = Path(tempfile.mkdtemp(prefix=".granphon-", dir=target.parent))
        with open(place / target.name, "wb") as stream:
            stream.writelines(parts)
            stream.flush()
            os.fsync(stream.fileno())
        os.replace(place / target.name, target)
    except (OSError, ValueError) as error:  # ValueError: a null character in the name
        raise _explain_failure(target, error if isinstance(error, OSError) else OSError(str(error))) from None
    finally:
        if place is not None:
            shutil.rmtree(place, ignore_errors=True)


def write_text(path: StrPath, text: str) -> None:
    """Write a text in UTF-8, whole or not at all, as :func:`write_bytes` does."""
    write_bytes(path, text.encode("utf-8"))
