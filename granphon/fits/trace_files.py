"""Files of traces: tables, as oscilloscopes export them, and HDF5."""

from __future__ import annotations

import math
import os
import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from granphon.base.arrays import Array
from granphon.base.errors import InputError, MissingFileError, Refused, require_installed
from granphon.base.quantities import LENGTH, NUMBER, TIME, Quantity
from granphon.base.tables import Heading, Table
from granphon.base.text import counted, decode, list_names, read_bytes, require_path, suggest
from granphon.base.validation import finite_array, positive

#: times before a trigger, and distances on the other side of an origin, are below zero
TIMES = replace(TIME, least="any")
PLACES = replace(LENGTH, least="any")
#: difference, over a step, up to which the times of two records are the same
SAME_TIME = 0.01
#: ends of the names of HDF5 files
_HDF5 = (".h5", ".hdf5", ".hdf")
#: a line that gives the time between two samples: "# time step: 0.1 us", "Sample Interval,1e-7,s"
_STEP_LINE = re.compile(
    r"\s*#?\s*\"?(?:time step|step of time|(?:sample|sampling) interval|increment)\"?"
    rf"\s*[:=,;\t]\s*\"?({NUMBER})\"?\s*[,;\t]?\s*\"?(.*?)\"?\s*",
    re.IGNORECASE,
)
#: a name of a column that ends with, or is, the distance of its sensor: "bead 5 at 40 mm", "40 mm"
_AT = re.compile(rf"(?:(.*?)[\s,]+(?:at|@)\s+|)({NUMBER}\s*[A-Za-zµμ]+)", re.IGNORECASE)


@dataclass(frozen=True)
class Record:
    """What stands in one file of traces, or in several files of the same times.

    Attributes
    ----------
    where : the names of the files, for messages.
    times : (n,) s.
    signals : (m, n) in the units of the files, a row for each sensor.
    distances : (m,) of the sensors, m.
    names : (m,) of the sensors.
    """

    where: str
    times: Array
    signals: Array
    distances: Array
    names: tuple[str, ...]


@dataclass(frozen=True)
class _FileTraces:
    """What stands in one file: ``times`` (n,), s, or None; ``signals`` (m, n); ``distances`` (m,),
    m, each None if the file does not give it; ``names`` (m,).
    """

    name: str
    times: Array | None
    signals: Array
    distances: tuple[float | None, ...]
    names: tuple[str, ...]


def has_traces(table: Table) -> bool:
    """Whether a table has a column that is headed with the distance of a sensor."""
    return any(_split_heading(heading)[1] is not None for heading in table.headings)


def read_traces(
    paths: str | os.PathLike[str] | Sequence[str | os.PathLike[str]],
    distances: Sequence[float] | Mapping[str, float] | None,
    time_step: float | None,
) -> Record:
    """Return the traces of one file, or of several that have the same times, at ``paths``.

    ``distances`` of the sensors, m, in their order or by their names, replace those in the files.
    ``time_step``, s, is given if the files have no times. Raises InputError as
    :meth:`granphon.Traces.read` does.
    """
    given: Any = paths
    all_paths: list[Any] = list(given) if isinstance(given, list | tuple) else [given]
    for path in all_paths:
        require_path(path)
    if not all_paths:
        raise InputError("there is no file of traces", mend="Give one or more")
    step = None if time_step is None else positive("time_step", time_step, "s")
    files = [_read_file(path) for path in all_paths]
    times = _find_times(files[0], step)
    for file in files[1:]:
        _require_same_times(files[0], times, file, _find_times(file, step))
    where = ", ".join(file.name for file in files)
    names = tuple(name for file in files for name in file.names)
    file_distances = [distance for file in files for distance in file.distances]
    return Record(
        where=where,
        times=times,
        signals=np.concatenate([file.signals for file in files]),
        distances=_find_distances(where, names, file_distances, distances),
        names=names,
    )


def _read_file(path: str | os.PathLike[str]) -> _FileTraces:
    """Return the traces of the file ``path``: HDF5 by the ending of its name, else a table."""
    is_hdf5 = Path(path).suffix.lower() in _HDF5
    return _read_hdf5(path) if is_hdf5 else _read_table(path)


def _find_times(file: _FileTraces, step: float | None) -> Array:
    """Return the times of a file, (n,), s, from the file or from a ``step``, s, which begin at
    zero; InputError if they are missing, or given twice.
    """
    if file.times is not None and step is not None:
        raise InputError(
            f"{file.name} has times, and time_step is given", mend="Leave time_step out"
        )
    if file.times is not None:
        return file.times
    if step is None:
        raise InputError(
            f"{file.name} has no times",
            mend="Head their column 'time (s)', write '# time step: 0.1 us' above the headings, or"
            " give time_step",
        )
    return _count_steps(step, file.signals.shape[1])


def _count_steps(step: float, n: int) -> Array:
    """Return n times, a ``step``, s, apart, from zero on."""
    return np.asarray(step * np.arange(n), np.float64)


def _require_same_times(
    first: _FileTraces, times: Array, file: _FileTraces, other_times: Array
) -> None:
    """Raise InputError if the ``first`` file, with ``times`` (n,), s, and another ``file``, with
    ``other_times`` (m,), s, have different times, by more than a hundredth of a step.
    """
    if times.size != other_times.size:
        raise InputError(
            f"{first.name} has {times.size} samples, and {file.name} {other_times.size}",
            mend="Cut the longer record, so that all have the same times",
        )
    step = (times[-1] - times[0]) / max(times.size - 1, 1)
    differences = np.abs(times - other_times)
    if np.max(differences) > SAME_TIME * abs(step):
        sample = int(np.argmax(differences))
        raise InputError(
            f"{first.name} and {file.name} have different times: sample {sample + 1} is at"
            f" {times[sample]:.9g} s in one, and at {other_times[sample]:.9g} s in the other",
            mend="Trigger both records by the same signal, and interpolate them at the same times",
        )


def _find_distances(
    where: str,
    names: tuple[str, ...],
    file_distances: Sequence[float | None],
    given_distances: Sequence[float] | Mapping[str, float] | None,
) -> Array:
    """Return the distance of each sensor, (m,), m: that of the files, or in its place the given
    one. ``given_distances`` are in the order of the sensors, or by some of their ``names``.

    InputError, which names the files by ``where``, for the name of a sensor that is not there, for
    a number of distances that is not that of the sensors, and for a sensor without a distance;
    also for distances that are no finite numbers.
    """
    distances: list[float | None]
    if given_distances is None:
        distances = list(file_distances)
    elif isinstance(given_distances, Mapping):
        unknown_names = [name for name in given_distances if name not in names]
        if unknown_names:
            raise InputError(
                f"{where} has no sensor {unknown_names[0]!r}",
                f"Its sensors are {list_names(map(repr, names))}",
                suggest(unknown_names[0], names),
            )
        pairs = zip(names, file_distances, strict=True)
        distances = [given_distances.get(name, distance) for name, distance in pairs]
    else:
        distances = np.atleast_1d(finite_array("distances", given_distances, "m")).tolist()
        if len(distances) != len(names):
            raise InputError(
                f"{where} has {counted(len(names), 'trace')}, and"
                f" {counted(len(distances), 'distance')} given",
                mend="Give one distance for each sensor",
            )
    names_without_distance = [
        name for name, distance in zip(names, distances, strict=True) if distance is None
    ]
    if names_without_distance:
        name = names_without_distance[0]
        raise InputError(
            f"{where} does not say where the sensor {name!r} is",
            mend=f"Head its column '{name} at 40 mm', or give the distances",
        )
    return finite_array("distances", distances, "m")


def _take_step(
    path: str | os.PathLike[str], lines: Sequence[str]
) -> tuple[list[str], float | None]:
    """Return the ``lines`` of a table, and the step of time, s, that one of them gives; None if no
    line does.

    The line that gives the step, and those above it, which describe the instrument, are replaced by
    comments: so they are not read as rows, and the other lines keep their numbers. InputError for a
    step that is no time, and for two lines that give different steps.
    """
    step: float | None = None
    lines_of_table = []
    for number, line in enumerate(lines, 1):
        match = _STEP_LINE.fullmatch(line)
        if match is None:
            lines_of_table.append(line)
            continue
        try:
            step_of_line = TIME.read(f"{match[1]} {match[2] or 's'}")
        except Refused as refused:
            raise InputError(f"{path}:{number}: time step: {refused}") from None
        if step is not None and not math.isclose(step, step_of_line):
            raise InputError(
                f"{path}:{number}: the time step is {step_of_line:.9g} s, and {step:.9g} s in a"
                " line above",
                mend="Keep one of the lines",
            )
        step = step_of_line
        lines_of_table = ["#"] * number
    return lines_of_table, step


def _read_table(path: str | os.PathLike[str]) -> _FileTraces:
    """Return the traces of a table: a column of times, or a line above the headings that gives the
    step of time, and a column for each sensor. Without either, the times are None.

    Raises MissingFileError if there is no file; InputError for a file that cannot be read or is no
    table, for a step that is no time, for lines with different steps, for times and a step, for
    times without a unit of time, for a cell that is no number, for two columns of one heading, and
    if there are no samples or no traces.
    """
    lines, step = _take_step(path, decode(str(path), read_bytes(path)).splitlines())
    table = Table.parse(str(path), "\n".join(lines).encode())
    if not table.lines:
        raise InputError(f"{path} has no samples", mend="Write numbers below its headings")
    has_times = "time" in table
    if has_times and step is not None:
        raise InputError(
            f"{path} has a column of times, and a step of time", mend="Leave one of them out"
        )
    times = table.column("time", TIMES) if has_times else None
    if step is not None:
        times = _count_steps(step, len(table.lines))
    names = []
    distances = []
    signals = []
    for heading in table.headings:
        if heading.key == "time":
            continue
        name, distance = _split_heading(heading)
        names.append(name)
        distances.append(distance)
        try:
            signals.append(table.numbers(heading.name))
        except InputError as error:
            raise InputError(f"{path}: {error}") from None
    if not signals:
        raise InputError(
            f"{path} has no trace", mend="Give each sensor a column, such as 'bead 5 at 40 mm (V)'"
        )
    return _FileTraces(str(path), times, np.array(signals), tuple(distances), tuple(names))


def _split_heading(heading: Heading) -> tuple[str, float | None]:
    """Return the name of the sensor of a column, and the distance of the sensor, m; None in place
    of a distance that the heading does not have.
    """
    match = _AT.fullmatch(heading.name.strip())
    if match is None:
        return heading.name, None
    try:
        distance = PLACES.read(match[2])
    except Refused:
        return heading.name, None
    return (match[1] or heading.name).strip(), distance


def _read_hdf5(path: str | os.PathLike[str]) -> _FileTraces:
    """Return the traces of a file of HDF5: the data sets "signals" (m, n), "time" (n,) or the
    attribute "time_step", "distance" (m,) and "names" (m,), of which only the first is required.

    Raises MissingFileError if there is no file; InputError for a file or data set that cannot be
    read, numbers that are not finite or have the unit of another quantity, times that are given
    twice, and data sets that do not fit together; MissingPackageError if h5py is not installed.
    """
    require_installed("A file of HDF5", "h5py")
    import h5py

    try:
        file = h5py.File(path, "r")
    except OSError as error:
        if not Path(path).exists():
            raise MissingFileError(f"{path} cannot be read: there is no such file") from None
        raise InputError(f"{path} cannot be read: {error}") from None
    with file:
        if "signals" not in file:
            listed = list_names(map(repr, file)) or "none"
            raise InputError(
                f"{path} has no data set 'signals'",
                f"Its data sets are {listed}",
                "Write 'signals' (sensors, times), 'time' and 'distance'",
            )
        signals = np.atleast_2d(_read_numbers(path, file["signals"], "signals"))
        times = _read_times(path, file, signals.shape[1])
        distances: tuple[float | None, ...] = (None,) * len(signals)
        if "distance" in file:
            places = np.atleast_1d(_read_quantity(path, file["distance"], "distance", PLACES))
            distances = tuple(places.tolist())
        names = tuple(str(number) for number in range(1, len(signals) + 1))
        if "names" in file:
            names = _read_names(path, file["names"])
    if len(distances) != len(signals) or len(names) != len(signals):
        raise InputError(
            f"{path} has {counted(len(signals), 'trace')}, {counted(len(distances), 'distance')}"
            f" and {counted(len(names), 'name')}",
            mend="Write one of each for a sensor",
        )
    return _FileTraces(str(path), times, signals, distances, names)


def _read_times(path: str | os.PathLike[str], file: Any, n: int) -> Array | None:
    """Return the times (n,), s, of an open ``file`` of HDF5 at ``path``, from its data set or from
    its step of time; None if it has neither. InputError if it has both, or for what are no times.
    """
    if "time" in file and "time_step" in file.attrs:
        raise InputError(
            f"{path} has a data set of times, and a time_step", mend="Leave one of them out"
        )
    if "time" in file:
        return _read_quantity(path, file["time"], "time", TIMES)
    if "time_step" in file.attrs:
        return _count_steps(_read_step(path, file.attrs["time_step"]), n)
    return None


def _read_step(path: str | os.PathLike[str], data: Any) -> float:
    """Return the step of time, s, of ``data``, an attribute of HDF5; InputError, with the file at
    ``path``, for what is not one number above zero.
    """
    try:
        return positive("time_step", np.asarray(data), "s")
    except InputError as error:
        raise InputError(f"{path}: {error}") from None


def _read_names(path: str | os.PathLike[str], data: Any) -> tuple[str, ...]:
    """Return the names of sensors (m,) of ``data``, a data set of HDF5; InputError, with the file
    at ``path``, for bytes that are not UTF-8.
    """
    names = []
    for name in np.atleast_1d(data).tolist():
        try:
            names.append(name.decode() if isinstance(name, bytes) else str(name))
        except UnicodeDecodeError:
            raise InputError(
                f"{path}: names has {name!r}, which is not UTF-8",
                mend="Write the names of the sensors as texts of UTF-8",
            ) from None
    return tuple(names)


def _read_quantity(path: str | os.PathLike[str], data: Any, name: str, kind: Quantity) -> Array:
    """Return the numbers of ``data``, a data set of HDF5, converted to SI from the unit in the
    attribute ``units`` of the data set; without this attribute they are in the SI unit of the
    ``kind``. InputError, which names the file at ``path`` and the ``name`` of the data set, for a
    unit of another quantity, and for numbers that are not finite.
    """
    unit = data.attrs.get("units", kind.unit)
    text = unit.decode() if isinstance(unit, bytes) else str(unit)
    if not kind.measures(text):
        raise InputError(
            f"{path}: {name} has the units {text!r}", mend=f"Give it units of {kind.name}"
        )
    numbers: Array = kind.factor(text) * _read_numbers(path, data, name)
    return numbers


def _read_numbers(path: str | os.PathLike[str], data: Any, name: str) -> Array:
    """Return the finite numbers of ``data``, a data set or an attribute of HDF5; InputError, with
    the file at ``path`` and the ``name``, for others.
    """
    try:
        return finite_array(name, np.asarray(data))
    except InputError as error:
        raise InputError(f"{path}: {error}") from None
