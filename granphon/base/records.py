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

from granphon.base.errors import InputError, MissingFileError, OutputError, StoppedEarlyWarning

Array = NDArray[Any]


def hold(file: BinaryIO) -> None:
    """Lock a file for one writer until it is closed, where the system can.

    Raises :class:`~granphon.base.errors.OutputError` where another has it.
    """
    try:
        from fcntl import LOCK_EX, LOCK_NB, flock

        flock(file, LOCK_EX | LOCK_NB)
    except BlockingIOError:
        problem = f"another run is writing {file.name}"
        raise OutputError(
            problem, "Two would mix their frames", "Wait until it ends, or give another file"
        ) from None
    except (ImportError, OSError):
        return


class RecordFile:
    """A file that is being written. What is at the path is replaced.

    Parameters
    ----------
    path : or an open binary file.
    fixed : arrays that do not grow, with the names of their dimensions.
    growing : shapes of the entries of variables that grow, with the names of their dimensions.
    units : of variables.
    about : texts about the file.

    Raises :class:`OSError` where the file cannot be written, and
    :class:`~granphon.base.errors.OutputError` where another run is writing it.
    """

    def __init__(
        self,
        path: str | os.PathLike[str] | BinaryIO,
        fixed: Mapping[str, tuple[Array, tuple[str, ...]]],
        growing: Mapping[str, tuple[tuple[int, ...], tuple[str, ...]]],
        units: Mapping[str, str],
        about: Mapping[str, str],
    ) -> None:

        self._count = 0
        self._growing = growing
        start = _write_head(fixed, growing, units, about)
        # it is open as long as the object is
        self._file = open(path, "wb") if isinstance(path, str | os.PathLike) else path  # noqa: SIM115
        if self._file is not path:
            hold(self._file)
        self._file.write(_set_count(start, 0))
        self._file.flush()

    def append(self, values: Mapping[str, Any]) -> None:
        """Write a record; it is in the file when this returns."""
        numbers = [np.asarray(values[name]).astype(">f8") for name in self._growing]
        self._file.write(b"".join(array.tobytes() for array in numbers))
        self._file.flush()
        self._count += 1
        self._file.seek(4)
        self._file.write(struct.pack(">i", self._count))
        self._file.seek(0, os.SEEK_END)
        self._file.flush()

    def close(self) -> None:
        """Close the file."""
        self._file.close()


def _write_head(
    fixed: Mapping[str, tuple[Array, tuple[str, ...]]],
    growing: Mapping[str, tuple[tuple[int, ...], tuple[str, ...]]],
    units: Mapping[str, str],
    about: Mapping[str, str],
) -> bytes:
    """Return the bytes of a file without records; the arguments are those of the class."""
    from scipy.io import netcdf_file

    sizes: dict[str, int] = {}
    for array, names in fixed.values():
        sizes |= zip(names, array.shape, strict=True)
    for shape, names in growing.values():
        sizes |= zip(names, shape, strict=True)
    head = BytesIO()
    layout: Any = netcdf_file(head, "w", version=2)
    for name, size in {"time": None, **sizes}.items():
        layout.createDimension(name, size)
    for name, text in about.items():
        setattr(layout, name, text)
    for name, (array, names) in fixed.items():
        layout.createVariable(name, "d", names)[...] = array
    for name, (shape, names) in growing.items():
        layout.createVariable(name, "d", ("time", *names))[0] = np.zeros(shape)
    for name, variable in layout.variables.items():
        if name in units:
            variable.units = units[name]
    layout.flush()
    # one record is written, because scipy finds from it how long records are, and cut off again
    numbers_of_record = sum(int(np.prod(shape, dtype=int)) for shape, _ in growing.values())
    return head.getvalue()[: -8 * numbers_of_record]


def _set_count(data: bytes, count: int) -> bytes:
    """Return the bytes of a file whose header says that there are so many records."""
    return data[:4] + struct.pack(">i", count) + data[8:]


def _mend(path: str | os.PathLike[str], name: str) -> BytesIO | None:
    """Return the data of a file that was cut, with a header that counts the records that are whole;
    None of others.
    """
    from scipy.io import netcdf_file

    try:
        data = Path(path).read_bytes()
        with netcdf_file(BytesIO(_set_count(data, 1)), "r") as file:
            variables = file.variables.values()
            size = sum(8 * variable.data.size for variable in variables if not variable.isrec)
            size_of_record = sum(8 * variable.data.size for variable in variables if variable.isrec)
            count = (len(data) - file.fp.tell() - size) // size_of_record
        (said,) = struct.unpack(">i", data[4:8])
    except Exception:  # of data that may be anything
        return None
    if not 0 < count < said:
        return None
    warnings.warn(
        f"{name} was cut: {count} of its {said} records are whole",
        StoppedEarlyWarning,
        stacklevel=4,
    )
    return BytesIO(_set_count(data, count))


def read_records(
    path: str | os.PathLike[str] | BinaryIO, about: Mapping[str, str], frames: slice = slice(None)
) -> tuple[dict[str, Array], dict[str, str]]:
    """Return the arrays of a file of records, those that grow at the ``frames`` alone, and all that
    it says about itself.

    Arrays that grow stay in the file: they are :class:`numpy.memmap`, whose numbers are read as
    they are used. ``path`` may be an open binary file too, which is read into memory.

    Raises :class:`~granphon.base.errors.InputError` for a file that is not there, that is no such
    file, or about which its texts say something else than ``about``. Of a file that was cut the
    records that are whole are read into memory, with a
    :class:`~granphon.base.errors.StoppedEarlyWarning`.
    """
    from scipy.io import netcdf_file

    name = os.fspath(path) if isinstance(path, str | os.PathLike) else "the data"
    try:
        with warnings.catch_warnings():
            # of arrays that outlive the file: its mapping lives with them
            warnings.simplefilter("ignore", RuntimeWarning)
            with netcdf_file(path, "r") as file:
                attributes = {key: getattr(file, key, b"").decode() for key in about}
                if attributes != dict(about):
                    problem = f"{name} is {attributes}, not {dict(about)}"
                    raise InputError(problem, mend="Give a file that this version has written")
                arrays: dict[str, Array] = {}
                for key, variable in file.variables.items():
                    if variable.isrec:
                        arrays[key] = variable.data[frames].view(np.memmap)
                    else:
                        arrays[key] = np.array(variable.data, float)
                words = vars(file)["_attributes"]
                return arrays, {key: value.decode() for key, value in words.items()}
    except FileNotFoundError:
        raise MissingFileError(f"there is no file {name}") from None
    except (
        OSError,
        TypeError,
        ValueError,
        KeyError,
        AttributeError,
        IndexError,
        struct.error,
    ) as error:
        if isinstance(error, InputError):
            raise
        whole = _mend(path, name) if isinstance(path, str | os.PathLike) else None
        if whole is not None:
            return read_records(whole, about, frames)
        raise InputError(f"{name} is not a file of records: {error}") from None
