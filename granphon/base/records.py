"""Files of records that grow: netCDF's classic format, with offsets of 64 bits, which any reader of
netCDF opens.

The layout is that of the classic format specification of Unidata's netCDF documentation: a header,
the variables that do not grow, and then records, each with one entry of every variable that grows.
A record that is not yet whole does not count, so that a file can be read while it grows, and after
the program that wrote it was killed.
"""

from __future__ import annotations

import os
import struct
import warnings
from collections.abc import Mapping
from io import BytesIO
from pathlib import Path
from typing import Any, BinaryIO

import numpy as np
from numpy.typing import NDArray

from granphon.base.errors import (
    InputError,
    MissingFileError,
    OutputError,
    StoppedEarlyWarning,
    warn_caller,
)

#: where a file holds the number of its records, bytes from the beginning, and how
_COUNT_OFFSET = 4
_COUNT_FORMAT = ">i"
#: size of a number of a variable, bytes
_FLOAT_BYTES = 8


def lock_file(file: BinaryIO) -> None:
    """Lock an open ``file`` for one writer until the file is closed; without an effect on a system
    or a file system that has no such locks.

    Raises :class:`~granphon.base.errors.OutputError` if another process, or this one by a file that
    it has opened apart, has locked the file.
    """
    try:
        from fcntl import LOCK_EX, LOCK_NB, flock

        flock(file, LOCK_EX | LOCK_NB)
    except BlockingIOError:
        problem = f"another run is writing {file.name}"
        raise OutputError(
            problem, "Two runs would mix their records", "Wait until it ends, or give another file"
        ) from None
    except (ImportError, OSError):
        return


class RecordFile:
    """A file that is being written. A file that is at the path is emptied, and locked against other
    runs until :meth:`close`.

    Parameters
    ----------
    path : the path of the file, or an open binary file without content, which is not locked.
    fixed : for each variable that does not grow its array and the names of its dimensions, of which
        none is of size zero, and each has one size in all variables.
    growing : for each variable that grows the shape of its entry in one record, and the names of
        the dimensions of that entry, with the same rules.
    units : the SI unit of each variable that has one.
    about : texts about the file, by their names.

    Raises
    ------
    OSError : the file cannot be written.
    OutputError : another run is writing the file.
    """

    def __init__(
        self,
        path: str | os.PathLike[str] | BinaryIO,
        fixed: Mapping[str, tuple[NDArray[Any], tuple[str, ...]]],
        growing: Mapping[str, tuple[tuple[int, ...], tuple[str, ...]]],
        units: Mapping[str, str],
        about: Mapping[str, str],
    ) -> None:
        """Open and lock the file, unless it is open, and write its head, with no record yet."""
        self._count = 0
        self._growing = growing
        head = _write_head(fixed, growing, units, about)
        if isinstance(path, str | os.PathLike):
            # the file stays open until close is called
            self._file: BinaryIO = _open_locked(path)
        else:
            self._file = path
        self._file.write(_set_count(head, 0))
        self._file.flush()

    def append(self, values: Mapping[str, Any]) -> None:
        """Write a record: of each variable that grows its entry in ``values``. The record is in the
        file when the method returns.

        Raises KeyError and ValueError, before anything is written, if an entry is missing or has
        another shape than the constructor was given; OSError if the file cannot be written.
        """
        entries = [np.asarray(values[name]).astype(">f8") for name in self._growing]
        for entry, (name, (shape, _)) in zip(entries, self._growing.items(), strict=True):
            if entry.shape != shape:
                raise ValueError(f"{name} has the shape {entry.shape} instead of {shape}")
        self._file.write(b"".join(entry.tobytes() for entry in entries))
        # the count is raised after the record is in the file: readers see whole records alone
        self._file.flush()
        self._count += 1
        self._file.seek(_COUNT_OFFSET)
        self._file.write(struct.pack(_COUNT_FORMAT, self._count))
        self._file.seek(0, os.SEEK_END)
        self._file.flush()

    def close(self) -> None:
        """Close the file, also one that was open when the constructor was given it."""
        self._file.close()


def _open_locked(path: str | os.PathLike[str]) -> BinaryIO:
    """Open the file at ``path`` for writing, lock it and empty it, and return it. If another
    process has locked the file, raise OutputError and leave the file as it is.
    """

    def open_or_make(name: str, flags: int) -> int:
        """Return the descriptor of the file ``name``, which is made if there is none."""
        return os.open(name, flags | os.O_CREAT, 0o666)

    # the mode "wb" would cut off what another run may be writing
    file = open(path, "r+b", opener=open_or_make)  # noqa: SIM115  closed by the caller
    try:
        lock_file(file)
        file.truncate()
    except OSError:
        file.close()
        raise
    return file


def _write_head(
    fixed: Mapping[str, tuple[NDArray[Any], tuple[str, ...]]],
    growing: Mapping[str, tuple[tuple[int, ...], tuple[str, ...]]],
    units: Mapping[str, str],
    about: Mapping[str, str],
) -> bytes:
    """Return the bytes of a file before its first record; the arguments are those of
    :class:`RecordFile`.
    """
    from scipy.io import netcdf_file

    sizes: dict[str, int] = {}
    for array, dimensions in fixed.values():
        sizes |= zip(dimensions, array.shape, strict=True)
    for shape, dimensions in growing.values():
        sizes |= zip(dimensions, shape, strict=True)
    stream = BytesIO()
    file: Any = netcdf_file(stream, "w", version=2)
    file.createDimension("time", None)  # None: the dimension that grows
    for dimension, size in sizes.items():
        file.createDimension(dimension, size)
    for name, text in about.items():
        setattr(file, name, text)
    for name, (array, dimensions) in fixed.items():
        variable = file.createVariable(name, "d", dimensions)
        variable[...] = array
    for name, (shape, dimensions) in growing.items():
        variable = file.createVariable(name, "d", ("time", *dimensions))
        variable[0] = np.zeros(shape)
    for name, variable in file.variables.items():
        if name in units:
            variable.units = units[name]
    file.flush()
    # scipy finds the length of records from one that is written, which is cut off again
    numbers_in_record = sum(int(np.prod(shape, dtype=int)) for shape, _ in growing.values())
    data = stream.getvalue()
    return data[: len(data) - _FLOAT_BYTES * numbers_in_record]


def _set_count(data: bytes, count: int) -> bytes:
    """Return the bytes of a file with ``count`` as the number of records in its header."""
    after_count = _COUNT_OFFSET + struct.calcsize(_COUNT_FORMAT)
    return data[:_COUNT_OFFSET] + struct.pack(_COUNT_FORMAT, count) + data[after_count:]


def _mend(path: str | os.PathLike[str], name: str) -> BytesIO | None:
    """Return the data of a file that was cut, with a header that counts the whole records alone,
    and issue a :class:`~granphon.base.errors.StoppedEarlyWarning` that calls the file ``name``;
    None if the file was not cut, has no whole record, or is no file of records.
    """
    from scipy.io import netcdf_file

    try:
        data = Path(path).read_bytes()
        # with one record in the header, the size of a variable that grows is that of its entry
        with netcdf_file(BytesIO(_set_count(data, 1)), "r") as file:
            fixed_bytes = 0
            record_bytes = 0
            for variable in file.variables.values():
                if variable.isrec:
                    record_bytes += _FLOAT_BYTES * variable.data.size
                else:
                    fixed_bytes += _FLOAT_BYTES * variable.data.size
            # scipy goes back to the end of the header after it has read the data of a variable
            header_bytes = file.fp.tell()
            count = (len(data) - header_bytes - fixed_bytes) // record_bytes
        (stated_count,) = struct.unpack_from(_COUNT_FORMAT, data, _COUNT_OFFSET)
    except Exception:  # the data may be anything, and scipy raise anything
        return None
    was_cut = 0 < count < stated_count
    if not was_cut:
        return None
    problem = f"{name} was cut: {count} of its {stated_count} records are whole"
    warn_caller(problem, StoppedEarlyWarning)
    return BytesIO(_set_count(data, count))


def read_records(
    path: str | os.PathLike[str] | BinaryIO, about: Mapping[str, str], frames: slice = slice(None)
) -> tuple[dict[str, NDArray[Any]], dict[str, str]]:
    """Return the arrays of a file of records, and the texts about the file, both by their names.

    An array that grows has the records as its first axis, of which those of the slice ``frames``
    are returned. Such an array stays in the file: it is a :class:`numpy.memmap`, whose numbers are
    read as they are used. ``path`` may be an open binary file too, which is read into memory.

    ``about`` holds texts that the file must have, as :class:`RecordFile` was given them. Of a file
    that was cut the whole records are read into memory, and a
    :class:`~granphon.base.errors.StoppedEarlyWarning` is issued.

    Raises
    ------
    MissingFileError : there is no such file.
    InputError : the file is no file of records, cannot be read, or has other texts than those of
        ``about``; or it was cut, and is an open file or has no whole record.
    """
    name = os.fspath(path) if isinstance(path, str | os.PathLike) else "the data"
    try:
        return _read_whole(path, name, about, frames)
    except FileNotFoundError:
        raise MissingFileError(f"there is no file {name}") from None
    except InputError:  # which is a ValueError, and says what is wrong
        raise
    except MemoryError:
        raise
    except Exception as error:  # the content may be anything, and scipy raise anything
        mended = _mend(path, name) if isinstance(path, str | os.PathLike) else None
        if mended is not None:
            return read_records(mended, about, frames)
        raise InputError(f"{name} is not a file of records: {error}") from None


def _read_whole(
    path: str | os.PathLike[str] | BinaryIO, name: str, about: Mapping[str, str], frames: slice
) -> tuple[dict[str, NDArray[Any]], dict[str, str]]:
    """Return the arrays and the texts of a file that was not cut, both by name; ``frames`` and
    ``about`` are those of :func:`read_records`.

    Errors are those of scipy, or an InputError that calls the file ``name`` if its texts are not
    those of ``about``.
    """
    from scipy.io import netcdf_file

    with warnings.catch_warnings():
        # scipy warns of arrays that outlive the file, whose mapping lives as long as they do
        warnings.simplefilter("ignore", RuntimeWarning)
        with netcdf_file(path, "r") as file:
            stated = {key: getattr(file, key, b"").decode() for key in about}
            if stated != dict(about):
                problem = f"{name} is {stated}, not {dict(about)}"
                raise InputError(problem, mend="Give a file that this version has written")
            arrays: dict[str, NDArray[Any]] = {}
            for key, variable in file.variables.items():
                if variable.isrec:
                    arrays[key] = variable.data[frames].view(np.memmap)
                else:
                    arrays[key] = np.array(variable.data, float)
            texts = vars(file)["_attributes"]
            return arrays, {key: text.decode() for key, text in texts.items()}
