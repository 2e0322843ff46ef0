"""Result folders: files arrive whole and together, one run at a time, and the user's own files are
never replaced.

New files are collected in a hidden folder inside the folder of the results. One rename makes it
``.granphon-new``: from then on the result counts. Then old files leave, and new ones move to their
places; the next run that looks at the folder completes that, if it was cut off. So a folder never
shows files of two runs. The folder of the results itself is not renamed: it may hold the user's
files, and may be where a terminal or a program works.

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
from contextlib import ExitStack, contextmanager, suppress
from dataclasses import KW_ONLY, dataclass
from itertools import combinations
from pathlib import Path
from typing import Self
from uuid import uuid4

from granphon.base.errors import (
    FileExistsInRunError,
    GranphonError,
    InputError,
    OutputError,
    require_installed,
)
from granphon.base.text import SEAL, read_bytes, require_path

#: the list of the files that granphon wrote into a folder; a list of another version counts as
#: empty
LIST = ".granphon-files"
LIST_SCHEMA = 1
#: the file that is locked by the run that writes into a folder
LOCK = ".granphon-lock"
#: length of the head of a file, by which the kind of the file is known, bytes
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
        """Lock an open file; OSError if another process has locked the file."""
        msvcrt.locking(descriptor, msvcrt.LK_NBLCK, 1)
else:
    import fcntl

    def _lock(descriptor: int) -> None:
        """Lock an open file; OSError if another process has locked the file, or if the file system
        has no locks.
        """
        fcntl.flock(descriptor, fcntl.LOCK_EX | fcntl.LOCK_NB)


def has_locks(descriptor: int) -> bool:
    """Whether the file system of an open file supports the locks of POSIX, which SQLite uses; true
    on Windows, where SQLite uses others.

    The shared lock that shows this stays on the file until this process closes any descriptor of
    the file.
    """
    try:
        if sys.platform != "win32":
            fcntl.lockf(descriptor, fcntl.LOCK_SH | fcntl.LOCK_NB)
    except OSError as error:
        return error.errno not in _NO_LOCKS
    return True


def read_written_files(folder: StrPath, what: str = "files") -> dict[str, str]:
    """Return the SHA-256 of each file that granphon wrote into ``folder``, by its name, from the
    list there; empty if there is no list that can be read.

    With ``what`` = "old", of the list in :data:`NEW`, the files are those that are to leave the
    folder of the results. Names that lead into another folder are left out.
    """
    # the content of the list may be anything
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
    """Whether ``folder`` holds files of all ``names``, each as granphon has written it."""
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
    names : the files to be written, each right in the folder.
    force : whether files of these names may be replaced, if granphon wrote them and nobody has
        changed them since.
    earlier : names that files of an earlier result may have. Those that granphon wrote are removed,
        unless they are among ``names``; if one has been changed since, or is read by the run, an
        error is raised.
    inputs : files that the run reads, which are never replaced or removed.
    known_texts : texts of files; a file of one of the ``names`` that has such a text counts as
        written by granphon, whatever the list of the folder says.

    Raises
    ------
    InputError : the folder is neither a text nor a path.
    """

    folder: StrPath
    names: Sequence[str]
    force: bool = False
    _: KW_ONLY
    earlier: Sequence[str] = ()
    inputs: Collection[StrPath] = ()
    known_texts: Collection[str] = ()

    def __post_init__(self) -> None:
        """Check that the folder is a path."""
        require_path(self.folder)

    @property
    def _target(self) -> Path:
        """The folder of the results."""
        return Path(self.folder)

    def require_free(self) -> None:
        """Raise an error if the files cannot be written, as far as can be told without writing. An
        earlier result that was cut off while its files moved is completed first, unless another run
        has the lock.

        Raises
        ------
        FileExistsInRunError : a file exists and ``force`` is off, or it may not be replaced or
            removed at all.
        MissingPackageError : a file is one of netCDF, and what writes it is not installed.
        OutputError : the folder is a file, or may not be written to; one of the ``names`` is a
            folder; or a name or the path of the folder has a null character.
        """
        if any(name.endswith(".nc") for name in self.names):
            require_installed("A netCDF file", "h5netcdf", "h5py")
        # errors are suppressed, as the check that follows reports what is wrong with the folder
        with suppress(OSError, ValueError):
            was_cut_off = (self._target / NEW).is_dir() or any(self._target.glob(PREFIX + "*"))
            if was_cut_off:
                with _hold_lock(self._target) as is_alone:
                    _finish(self._target, is_alone=is_alone)
        self._require_writable()

    @contextmanager
    def open(self) -> Iterator[Self]:
        """Make the folder if need be, and lock it, so that no other run writes into it until the
        end of the block.

        Errors are those of :meth:`require_free`; also raises
        :class:`~granphon.base.errors.OutputError` if another run has the lock, or if the file of
        the lock is not one that granphon makes. Folders that the method has made and that are still
        empty at the end are removed again.
        """
        self.require_free()
        target = self._target
        made_folders = list[Path]()
        try:
            with explaining(target):
                missing = [folder for folder in (target, *target.parents) if not folder.exists()]
                for folder in reversed(missing):  # the outermost first
                    folder.mkdir(exist_ok=True)
                    made_folders.append(folder)
            with _hold_lock(target) as is_alone:
                with explaining(target):
                    _finish(target, is_alone=is_alone)
                # checked again: another run may have written files before the lock was taken
                self._require_writable()
                yield self
        finally:
            for folder in reversed(made_folders):
                with suppress(OSError):  # a folder that holds a result is not empty, and stays
                    folder.rmdir()

    @contextmanager
    def staging(self, optional: Sequence[str] = ()) -> Iterator[Path]:
        """Make a temporary folder, into which the block writes the new files, and give its path;
        at the end of the block all of them move into the folder of the results.

        The folder of the results must be under lock, see :meth:`open`. Files that are also in
        ``optional`` need not be written. If the block fails, the folder of the results is left as
        it was found. If moving the files fails, the next run that looks at the folder moves those
        that are left. Raises :class:`~granphon.base.errors.OutputError` for any failure of the file
        system, also one in the block, and for files that the user has put in the way meanwhile.
        """
        target = self._target
        staging_folder = None
        with explaining(target):
            try:
                staging_folder = Path(tempfile.mkdtemp(prefix=PREFIX, dir=target))
                yield staging_folder
                self._require_writable()
                new_names = []
                for name in self.names:
                    if name not in optional or os.path.lexists(staging_folder / name):
                        new_names.append(name)
                self._write_list(staging_folder, new_names)
                for name in (*new_names, LIST):
                    with open(staging_folder / name, "r+b") as stream:
                        os.fsync(stream.fileno())
                os.rename(staging_folder, target / NEW)  # from here on the result counts
                _finish(target)
            except BaseException:
                # where a Ctrl-C has come while the files moved, those that are left are moved
                _finish(target)
                raise
            finally:
                if staging_folder is not None:
                    shutil.rmtree(staging_folder, ignore_errors=True)

    def _write_list(self, staging_folder: Path, new_names: Sequence[str]) -> None:
        """Write the list that the folder of the results is to have, with the digests of its files
        and of the old ones that make way, into the ``staging_folder``, which holds the files called
        ``new_names``.
        """
        target = self._target
        written = read_written_files(target)
        existing = [
            name for name in (*self.names, *self._stale_names) if os.path.lexists(target / name)
        ]
        # a file of a known text may make way too, though the list of the folder does not name it
        old = {name: written.get(name) or _digest_file(target / name) for name in existing}
        files = {name: digest for name, digest in written.items() if name not in old}
        files |= {name: _digest_file(staging_folder / name) for name in new_names}
        content = json.dumps({"schema": LIST_SCHEMA, "files": files, "old": old}, indent=1)
        (staging_folder / LIST).write_text(content, encoding="utf-8")

    def _require_writable(self) -> None:
        """Raise :class:`~granphon.base.errors.OutputError` if the files cannot be written into
        their folder, or would replace or remove files that they may not, as :meth:`require_free`
        lists them.
        """
        target = self._target
        _require_no_null_character(target, *self.names)
        with explaining(target):
            ancestor = _find_existing_ancestor(target)
            if not ancestor.is_dir():
                raise OutputError(
                    f"{ancestor} is not a folder",
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
                raise self._make_existing_error(existing, written)
            for name in self._stale_names:
                self._require_removable(name, written[name])
            if not os.access(ancestor, os.W_OK | os.X_OK):
                problem = f"there is no permission to write to {_show_folder(ancestor)}"
                raise OutputError(problem, mend="Choose another folder")

    def _require_own(self, existing: Sequence[str], written: Mapping[str, str]) -> None:
        """Raise :class:`FileExistsInRunError` if one of the ``existing`` files is read by this run,
        was not written by granphon, or has been changed since. A file with one of the
        ``known_texts`` counts as written. ``written`` holds the SHA-256 of each file that granphon
        wrote, by its name.
        """
        target = self._target
        why = "Such a file is never replaced, not even with --force"
        known_digests = [
            hashlib.sha256(text.encode("utf-8")).hexdigest() for text in self.known_texts
        ]
        for name in existing:
            if self._is_read(name):
                problem = f"{target / name} is read by this run, and would be overwritten"
                raise FileExistsInRunError(problem, why, "Choose another folder")
            digests = list(known_digests)
            reason = "there is no record that granphon wrote it"
            if name in written:
                digests.append(written[name])
                reason = "granphon wrote it, and it has been changed since"
            if not _is_written(target / name, *digests):
                problem = f"{_show_folder(target)} already holds {name}: {reason}"
                raise FileExistsInRunError(problem, why, "Move it away, or choose another folder")

    def _make_existing_error(
        self, existing: Sequence[str], written: Mapping[str, str]
    ) -> FileExistsInRunError:
        """Return the error that names the ``existing`` files of an earlier result, and those of its
        files that are missing; ``written`` is that of :meth:`_require_own`.
        """
        missing = [name for name in self.names if name in written and name not in existing]
        problem = f"{_show_folder(self._target)} already holds {', '.join(existing)}"
        if missing:
            problem += f", but not {', '.join(missing)}, which granphon wrote there too"
        mend = "Use --force (force=True) to replace it, or choose another folder"
        return FileExistsInRunError(
            problem, "An existing result is not overwritten unless asked for", mend
        )

    def _require_removable(self, name: str, digest: str) -> None:
        """Raise :class:`FileExistsInRunError` if a file of an earlier run is read by this run, or
        does not have the SHA-256 ``digest`` that it had when granphon wrote it.
        """
        target = self._target
        reason = ""
        if self._is_read(name):
            reason = "this run reads it"
        elif not _is_written(target / name, digest):
            reason = "it has been changed since"
        if reason:
            raise FileExistsInRunError(
                f"{_show_folder(target)} holds {name} of an earlier run, and {reason}",
                "It would stand beside a result that it does not belong to, and granphon"
                " does not remove it",
                "Move it away, or choose another folder",
            )

    @property
    def _stale_names(self) -> list[str]:
        """Files of an earlier result, written by granphon, that the new result does not have."""
        target = self._target
        written = read_written_files(self.folder)
        candidates = [name for name in self.earlier if name in written and name not in self.names]
        return [name for name in candidates if os.path.lexists(target / name)]

    def _is_read(self, name: str) -> bool:
        """Whether the file ``name`` of the folder is one that this run reads."""
        for path in self.inputs:
            with suppress(OSError):
                if os.path.samefile(self._target / name, path):
                    return True
        return False


def _find_existing_ancestor(path: Path) -> Path:
    """Return the path itself if it exists, or else the nearest one above it that exists, which may
    be that of a file.
    """
    ancestor = path
    while not os.path.lexists(ancestor) and ancestor != ancestor.parent:
        ancestor = ancestor.parent
    return ancestor


def _finish(target: Path, is_alone: bool = False) -> None:
    """Complete what this or an earlier run may have left unfinished in the folder ``target``: move
    the files of a complete result from the folder :data:`NEW` to their places.

    ``is_alone`` says that no other run is under way; then staging folders, which only killed runs
    leave behind, are removed too.
    """
    new_folder = target / NEW
    if new_folder.is_dir() and not new_folder.is_symlink():
        _move_files(new_folder, target)
    if not is_alone:
        return
    for staging_folder in target.glob(PREFIX + "*"):
        if staging_folder.is_dir() and not staging_folder.is_symlink():
            shutil.rmtree(staging_folder, ignore_errors=True)


def _move_files(new_folder: Path, target: Path) -> None:
    """Move the files of a ``new_folder`` into the folder ``target``, and remove the ``new_folder``.

    The old files in ``target`` that the list in the ``new_folder`` names are removed first, unless
    they have been changed since that list was written. Where a file of the user stands, the new
    file of that name is removed instead of moved. An earlier call may have been interrupted at any
    line: the files that it has moved are not in the ``new_folder`` any more.
    """
    new_digests = read_written_files(new_folder)
    old_digests = read_written_files(new_folder, "old")
    waiting_names = []
    for name in new_digests:
        path = new_folder / name
        if path.is_file() and not path.is_symlink():
            waiting_names.append(name)
    for name, digest in old_digests.items():
        # a new file that does not wait any more has been moved, and stays
        is_in_the_way = name in waiting_names or name not in new_digests
        if is_in_the_way and _is_written(target / name, digest):
            (target / name).unlink()
    for name in waiting_names:
        if os.path.lexists(target / name):  # the user has put a file of this name there meanwhile
            (new_folder / name).unlink()
        else:
            os.rename(new_folder / name, target / name)
    if new_digests or old_digests:
        os.replace(new_folder / LIST, target / LIST)
    with suppress(OSError):  # a folder with files of another program is not empty, and stays
        new_folder.rmdir()


def _show_folder(folder: Path) -> Path:
    """Return a folder as messages name it: by its whole path where it is "." or "..", which say
    nothing in a sentence.
    """
    return folder.resolve() if folder.name in ("", "..") else folder


@contextmanager
def explaining(target: Path, why: str = "It is left as it was") -> Iterator[None]:
    """Turn errors of the file system in the block, which writes ``target``, a file or a folder,
    into :class:`~granphon.base.errors.OutputError`; ``why`` says in what state the failure leaves
    ``target``.
    """
    try:
        yield
    except GranphonError:  # some are an OSError too
        raise
    except OSError as error:
        problem = f"{_show_folder(target)} cannot be written: {error.strerror or error}"
        if os.path.isdir(target / NEW):  # the result counts, and some of its files have not moved
            raise OutputError(
                problem,
                f"The files of the new result are in {NEW} there",
                "Any command that uses the folder moves them to their places",
            ) from None
        mend = "Choose another folder"
        if error.errno == errno.ENOSPC:
            mend = "Free some space, or choose another folder"
        raise OutputError(problem, why, mend) from None


@contextmanager
def _hold_lock(target: Path) -> Iterator[bool]:
    """Hold the lock of the folder ``target`` during the block, and give True; on a file system
    without locks give False, as another run may be under way there.

    Raises :class:`~granphon.base.errors.OutputError` if another run has the lock.
    """
    path = target / LOCK
    is_locked = False
    while not is_locked:
        descriptor = _open_lock(path)
        try:
            _lock(descriptor)
        except OSError as error:
            os.close(descriptor)
            if error.errno in _NO_LOCKS:
                yield False
                return
            problem = f"another run is writing into {_show_folder(path.parent)}"
            why = "Two runs would mix their files"
            raise OutputError(
                problem, why, "Wait until it ends, or choose another folder"
            ) from None
        # another run may have removed the file after it was opened here and before it was locked:
        # then the lock holds nobody back, and the loop tries again
        with suppress(OSError):
            is_locked = os.path.samestat(os.fstat(descriptor), os.stat(path))
        if not is_locked:
            os.close(descriptor)
    try:
        yield True
    finally:
        with suppress(OSError):  # where an open file cannot be removed, it stays
            path.unlink()
        os.close(descriptor)


def _open_lock(path: Path) -> int:
    """Open the file of a lock, which is made if need be, and return its descriptor; OutputError if
    the file cannot be opened, or is not an empty file, as granphon makes it.
    """
    flags = os.O_RDWR | os.O_CREAT | getattr(os, "O_NOFOLLOW", 0)
    with explaining(path.parent):
        descriptor = os.open(path, flags, 0o666)
    status = os.fstat(descriptor)
    is_empty_file = stat.S_ISREG(status.st_mode) and status.st_size == 0
    if is_empty_file:
        return descriptor
    os.close(descriptor)
    raise OutputError(
        f"{path} is not a lock that granphon made",
        "A lock of granphon is an empty file",
        "Move it away, or choose another folder",
    )


def write_text(path: StrPath, text: str, replace: bool = False) -> None:
    """Write a text in UTF-8, whole or not at all; its folder is made if need be.

    An existing file is replaced if it is empty, if ``replace`` is true, or if it is of the kind of
    the text. Where the head of the text names granphon or has a seal, the file must do one of these
    too; any other text and the file must begin with the same line.

    Raises
    ------
    FileExistsInRunError : a file of another kind is there, which is the user's.
    OutputError : a folder, a device or a pipe is there; or any other failure of the file system.
    InputError : the path is neither a text nor a path, or UTF-8 cannot hold the text.
    """
    write_texts([(path, text)], replace)


def write_texts(files: Sequence[tuple[StrPath, str]], replace: bool = False) -> None:
    """Write several ``files``, each a path and its text, that belong together, as
    :func:`write_text` writes one. All of them are checked, then written beside their places, and
    only then moved there: a fault of one of them before the moves leaves all places as they were.

    Errors are those of :func:`write_text`, and :class:`~granphon.base.errors.InputError` if two of
    the paths are one file.
    """
    for path, _text in files:
        require_path(path)
    targets = [Path(path) for path, _text in files]
    contents = [_encode(path, text) for path, text in files]
    _require_no_null_character(*targets)
    _require_different(targets)
    for target, content in zip(targets, contents, strict=True):
        with explaining(target):
            _require_replaceable(target, content[:_HEAD_BYTES], replace)
    with ExitStack() as places:
        for target, content in zip(targets, contents, strict=True):
            temporary = places.enter_context(put_beside(target))
            with explaining(target), open(temporary, "xb") as stream:
                stream.write(content)
                stream.flush()
                os.fsync(stream.fileno())


def _encode(path: StrPath, text: str) -> bytes:
    """Return the ``text`` of the file at ``path`` in UTF-8; InputError if UTF-8 cannot hold it."""
    try:
        return text.encode("utf-8")
    except UnicodeEncodeError as error:
        letter = text[error.start]
        raise InputError(
            f"{path} cannot be written: its text holds {letter!r}, half of a pair of UTF-16",
            mend="Take such letters out of the names in it",
        ) from None


def _require_different(targets: Sequence[Path]) -> None:
    """Raise :class:`~granphon.base.errors.InputError` if two of the ``targets`` are one file."""
    for first, second in combinations(targets, 2):
        is_same = False
        with suppress(OSError, ValueError):  # no such file, or a name that no file can have
            is_same = os.path.realpath(first) == os.path.realpath(second)
            is_same = is_same or os.path.samefile(first, second)
        if is_same:
            raise InputError(
                f"{second} is the name of two files that are to be written",
                "The second one would replace the first one",
                "Give two names",
            )


def _require_no_null_character(*paths: StrPath) -> None:
    """Raise :class:`~granphon.base.errors.OutputError` if one of the ``paths`` that are to be
    written, which may be names of files alone, has a null character.
    """
    for path in map(str, paths):
        if "\0" in path:
            raise OutputError(f"{path!r} cannot be written: a null character is part of the name")


def _require_regular_file(target: Path) -> None:
    """Raise :class:`~granphon.base.errors.OutputError` if ``target`` is a folder, a device or a
    pipe, whose place a file is not to take.
    """
    if target.is_dir():
        raise OutputError(f"{target} is a folder", "A file of that name is to be written")
    if target.exists() and not target.is_file():
        problem = f"{target} is a device or a pipe, where a file is to be written"
        raise OutputError(problem, mend="Give the name of a file")


def _require_replaceable(target: Path, new_head: bytes, replace: bool) -> None:
    """Raise :class:`~granphon.base.errors.OutputError` if ``target`` is no regular file or, unless
    it may ``replace`` any file, a file of another kind than the one that begins with ``new_head``;
    OSError if the file cannot be read.
    """
    _require_regular_file(target)
    if replace or not os.path.lexists(target):
        return
    with open(target, "rb") as stream:
        old_head = stream.read(_HEAD_BYTES)
    if old_head and not _are_of_one_kind(old_head, new_head):
        problem = f"{target} is there, and is another kind of file"
        raise FileExistsInRunError(problem, mend="Give another name")


def _is_own(head: bytes) -> bool:
    """Whether the ``head`` of a file, its first bytes, names granphon or has the line of a seal."""
    return b"granphon" in head or SEAL.encode() in head


def _are_of_one_kind(old_head: bytes, new_head: bytes) -> bool:
    """Whether two files, of which the first bytes are given, are of one kind. If the new head is
    granphon's own, the old one must be so too; otherwise both must begin with the same line.
    """
    if _is_own(new_head):
        return _is_own(old_head)
    old_line = old_head.split(b"\n")[0]
    new_line = new_head.split(b"\n")[0]
    return old_line == new_line


@contextmanager
def _name_errors_as_oserrors() -> Iterator[None]:
    """Raise OSError where the block, which takes a path, raises ValueError: the path has a
    character that no name of a file can have, such as a null character.
    """
    try:
        yield
    except ValueError as error:
        raise OSError(str(error)) from None


@contextmanager
def put_beside(target: Path) -> Iterator[Path]:
    """Give the path of a temporary file in the folder of ``target``: the file takes the place of
    ``target`` after the block, or is removed if the block fails.

    The folder is made if need be. Raises :class:`~granphon.base.errors.OutputError` if ``target``
    is a folder, a device or a pipe, and for a failure of the file system, also one in the block;
    other errors of the block pass as they are.
    """
    with explaining(target), _name_errors_as_oserrors():
        _require_regular_file(target)
    temporary = target.with_name(f".granphon-{uuid4().hex}")
    with explaining(target):
        try:
            with _name_errors_as_oserrors():
                target.parent.mkdir(parents=True, exist_ok=True)
            yield temporary
            with _name_errors_as_oserrors():
                os.replace(temporary, target)
        finally:
            with suppress(OSError, ValueError):
                temporary.unlink()
