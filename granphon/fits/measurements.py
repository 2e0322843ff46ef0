"""Measured sound velocities, from arrays or from a table."""

from __future__ import annotations

import os
import re
from collections.abc import Callable, Collection, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Self

import numpy as np

from granphon.base.arrays import Array
from granphon.base.errors import InputError, brief
from granphon.base.quantities import (
    FREQUENCY,
    LENGTH,
    LIGHT_VELOCITY,
    LOADS,
    TIME,
    Quantity,
    load_quantities,
)
from granphon.base.results import Result, held, result_class
from granphon.base.tables import Table
from granphon.base.text import list_names, suggest
from granphon.base.validation import finite_list, not_negative, positive, whole_number

#: velocity, m/s, read with any of its units
SPEED = Quantity("velocity", "m/s", "500 m/s", "m/s, km/s, mm/us")
#: errors may be given in per cent of the quantity
PERCENT = Quantity("relative error", "%", "1 %", "%, percent")
#: standard error of a velocity, m/s or per cent
_SIGMA = Quantity("velocity", "m/s", "5 m/s", "m/s, km/s, mm/us, %")
#: columns that a table of measurements may have, and their quantities
COLUMNS: Mapping[str, Quantity] = {
    "force": LOADS["force"],
    "side_force": LOADS["side_force"],
    "pressure": LOADS["pressure"],
    "velocity": SPEED,
    "time": TIME,
    "distance": LENGTH,
    "cutoff": FREQUENCY,
    "sigma": _SIGMA,
    "time_sigma": TIME,
    "cutoff_sigma": FREQUENCY,
    "frequency": FREQUENCY,
}

#: the column by which the relative error of another quantity is converted to that of a velocity
_MEASURED_OF_ERROR = {"time_sigma": "time", "cutoff_sigma": "cutoff"}


def _explain_column(kind: str) -> str:
    """Return how to name a column of a ``kind`` in the file, for ``granphon fit`` and in Python."""
    options = f"granphon fit also takes --column '{kind}=NAME', Python columns={{'{kind}': 'NAME'}}"
    return f"Head the column that is meant '{kind}'; {options}"


def read_headings(columns: Any, kinds: Collection[str], data: str) -> dict[str, str]:
    """Return the headings of a table by the kinds of its columns, from ``columns``, a mapping or
    None; the message says what ``data`` the table holds.

    Raises :class:`~granphon.base.errors.InputError` for what is no mapping from texts to texts, and
    for a kind that is not among the ``kinds``.
    """
    if columns is None:
        return {}
    are_texts = isinstance(columns, Mapping) and all(
        isinstance(word, str) for entry in columns.items() for word in entry
    )
    if not are_texts:
        raise InputError(
            f"columns is {brief(columns)}", mend="Give headings by kind, as {'frequency': 'f (Hz)'}"
        )
    unknown_kinds = [kind for kind in columns if kind not in kinds]
    if unknown_kinds:
        raise InputError(
            f"{unknown_kinds[0]!r} is not a kind of column of {data}",
            mend=suggest(unknown_kinds[0], kinds),
        )
    return dict(columns)


def read_sigma(text: str, velocity: Array) -> Any:
    """Return standard errors of velocities, m/s, from a ``text``: a number for "5 m/s", or for
    "1 %" that part of each ``velocity`` (n,), m/s.

    Raises :class:`~granphon.base.errors.Refused` for another text.
    """
    if re.search(r"(?:%|percent)\s*$", text):
        return velocity * (PERCENT.read(text) / 100.0)
    return _SIGMA.read(text)


@result_class
class Measurements(Result):
    """Sound velocities against the contact force.

    Attributes
    ----------
    force, velocity : (n,), N and m/s.
    sigma : standard error of each velocity, m/s, (n,) or one number for all; None if it is not
        known.
    frequency : frequency of the pulses, Hz, (n,) or one number; None for long waves.

    Raises
    ------
    InputError : a value is not a finite number above zero, a velocity is above that of light, there
        is no datum, or the arrays have different lengths: one number in a list is an array too.
    """

    force: Array = held(float, "*", "N")
    velocity: Array = held(float, "*", "m/s")
    sigma: Any = held(Any, unit="m/s", default=None)
    frequency: Any = held(Any, unit="Hz", default=None)

    def __post_init__(self) -> None:
        """Check the data, and put arrays, or floats where one number stands for all loads, in place
        of the arguments.
        """
        n_values = {}  # of each field
        for name in self.units:
            values = getattr(self, name)
            is_required = name in ("force", "velocity")
            if values is None and not is_required:
                continue
            array = np.array(finite_list(name, values, self.units[name], "above zero"))
            n_values[name] = array.size
            if name == "velocity" and np.max(array, initial=0.0) > LIGHT_VELOCITY:
                fault = f"velocity is {np.max(array):.6g} m/s, more than the velocity of light"
                raise InputError(fault, mend="Look at the unit, and at the number itself")
            is_array = is_required or bool(np.ndim(values))
            object.__setattr__(self, name, array if is_array else float(array[0]))
        n = n_values["force"]
        # one number stands for all loads, and has no axis
        optional_arrays = [values for values in (self.sigma, self.frequency) if np.ndim(values)]
        if n_values["velocity"] != n or any(np.size(values) != n for values in optional_arrays):
            words = ", ".join(f"{count} of {name}" for name, count in n_values.items())
            mend = "Give the same number of each; sigma and frequency may be one number"
            raise InputError(f"found {words}", mend=mend)
        super().__post_init__()

    @classmethod
    def read(
        cls,
        path: str | os.PathLike[str],
        columns: Mapping[str, str] | None = None,
        distance: float | tuple[float, float] | None = None,
        frame: Callable[[float], float] | None = None,
        pressed: Callable[[float], float] | None = None,
        periods: int = 2,
        carried: Callable[[Array, Array], Array] | None = None,
    ) -> Self:
        """Read a table, whose columns have their units in their headings, such as ``force (N)``.

        Parameters
        ----------
        path : a file with columns among :data:`COLUMNS`: force, side_force or pressure; velocity,
            or time and distance, or cutoff, the highest frequency of the branch; where known, sigma
            of the velocity, time_sigma or cutoff_sigma, perhaps in per cent, and the frequency of
            the pulse.
        columns : headings of columns that go by other names, perhaps with a unit: {"velocity": "v
            (km/s)"}.
        distance : distance that sound travels in each of the times, m, where no column gives it; or
            (distance, standard error): its relative error is added in quadrature to that of each
            velocity, as if the errors of the velocities were independent. If the table gives no
            errors, it is the only error of each velocity.
        frame : function of the force on a side of the hexagonal frame, N, that returns the force of
            a contact, N, such as :func:`~granphon.balls.loads.force_of_frame` with its number of
            balls; needed by a column side_force.
        pressed : function of the pressure that presses the packing, in the unit of ``periods``,
            that returns the force of a contact, N; needed by a column pressure.
        periods : number of periods of the lattice: a pressure is in N for 1, in N/m for 2, in Pa
            for 3.
        carried : function of the contact forces, N, and of the cut-off frequencies of the waves
            that the packing carries, Hz, both (n,), that returns the velocities of long waves, m/s,
            (n,); needed by a column cutoff.

        Raises
        ------
        InputError : a file, line or cell cannot be read; ``columns`` are no headings by kind, or
            ``periods`` not 1, 2 or 3; a column is missing; a quantity is given by two columns, or
            by a ``distance`` and a column of distances, velocities or cut-off frequencies; loads or
            cut-off frequencies are given without the function that converts them; cut-off
            frequencies are given beside frequencies of pulses; or a number is one that the class
            does not allow.
        """
        length, error_of_length = _read_distance(distance)
        names = read_headings(columns, COLUMNS, "measurements")
        p = whole_number("periods", periods, 1, 3)
        source = _SourceColumns.read(path, names, p)
        load = source.choose("force", "side_force", "pressure") or "force"
        _require_conversion(path, load, frame, pressed)
        measured = source.choose("velocity", "time", "cutoff") or "velocity"
        error = source.choose("sigma", "time_sigma", "cutoff_sigma")
        pulse = source.choose("frequency")
        if measured == "cutoff":
            _require_long_waves(path, can_convert=callable(carried), has_pulses=pulse is not None)
        required = [load, measured]
        if measured == "time" and distance is None:
            required.append("distance")
        if error in _MEASURED_OF_ERROR:
            required.append(_MEASURED_OF_ERROR[error])
        required += [kind for kind in (error, pulse) if kind]
        source.require(list(dict.fromkeys(required)))
        force = source.read_force(load, {"side_force": frame, "pressure": pressed}.get(load))
        if distance is not None:
            _require_no_second_distance(source, measured)
        if measured == "cutoff" and carried is not None:
            velocity = carried(force, source.column("cutoff"))
        else:
            velocity = source.read_velocity(measured, length)
        sigma = None if error is None else source.read_sigma(error, velocity)
        if length is not None and error_of_length:
            # the relative error of the distance is one of each velocity, beside its own
            relative_error = error_of_length / length
            sigma_of_length = velocity * relative_error
            sigma = sigma_of_length if sigma is None else np.hypot(sigma, sigma_of_length)
        frequency = None if pulse is None else source.column("frequency")
        try:
            return cls(force, velocity, sigma, frequency)
        except InputError as refusal:
            raise InputError(f"{path}: {refusal}") from None


@dataclass(frozen=True)
class _SourceColumns:
    """The columns of a table of measurements, by their kinds, which are those of :data:`COLUMNS`.

    ``names`` has the headings of kinds that go by other names, and ``quantities`` the quantity of
    each kind.
    """

    path: str | os.PathLike[str]
    table: Table
    names: Mapping[str, str]
    quantities: Mapping[str, Quantity]

    @classmethod
    def read(
        cls, path: str | os.PathLike[str], names: Mapping[str, str], periods: int
    ) -> _SourceColumns:
        """Return the columns of the table at ``path``; ``names`` are headings by kind, ``periods``
        the number of periods of the lattice, which gives a pressure its unit.

        Raises :class:`~granphon.base.errors.InputError` for a table that cannot be read.
        """
        return cls(path, Table.read(path), names, {**COLUMNS, **load_quantities(periods)})

    def heading(self, kind: str) -> str:
        """Return the heading of the column of a kind."""
        return self.names.get(kind, kind)

    def choose(self, *kinds: str) -> str | None:
        """Return the one of these ``kinds`` of which the table has a column; None if there is no
        such column. A kind whose heading is given in ``names`` goes before the others, and counts
        as present whether the table has that heading or not.

        Raises InputError if there are columns of several kinds.
        """
        kinds_in_table = [kind for kind in kinds if kind in self.names]
        if not kinds_in_table:
            kinds_in_table = [kind for kind in kinds if kind in self.table]
        if len(kinds_in_table) > 1:
            mend = f"Keep one of them. {_explain_column(kinds_in_table[0])}"
            raise InputError(f"{self.path} has both {' and '.join(kinds_in_table)}", mend=mend)
        return kinds_in_table[0] if kinds_in_table else None

    def column(self, kind: str) -> Array:
        """Return the values of the column of a ``kind``, (n,), SI."""
        return self.table.column(self.heading(kind), self.quantities[kind], _explain_column(kind))

    def read_velocity(self, kind: str, distance: float | None) -> Array:
        """Return the velocities (n,), m/s, from the column of this ``kind``, "velocity" or "time".

        Times are those for a ``distance``, m, or if it is None those of the column of distances.
        """
        if kind == "velocity":
            return self.column("velocity")
        if distance is None:
            return self.column("distance") / self.column("time")
        return distance / self.column("time")

    def require(self, kinds: Sequence[str]) -> None:
        """Raise InputError if columns of these ``kinds`` are missing, or have no unit; the message
        names all that are at fault.
        """
        names = {kind: repr(self.heading(kind)) for kind in kinds}
        missing_kinds = [kind for kind in kinds if self.heading(kind) not in self.table]
        kinds_without_unit = [
            kind
            for kind in kinds
            if kind not in missing_kinds and not self.table.unit(self.heading(kind))
        ]
        if not missing_kinds and not kinds_without_unit:
            return
        lacks = []
        if missing_kinds:
            missing_names = " and none named ".join(names[kind] for kind in missing_kinds)
            lacks.append(f"no column named {missing_names}")
        if kinds_without_unit:
            lacks.append("no unit for " + " and ".join(names[kind] for kind in kinds_without_unit))
        headings = " and ".join(f"'{kind} ({self.quantities[kind].unit})'" for kind in kinds)
        example = next(kind for kind in kinds if kind in missing_kinds + kinds_without_unit)
        unit = self.quantities[example].unit
        mend = (
            f"Head the columns {headings}, each with its unit in brackets;"
            f" instead of a force there may be 'pressure ({self.quantities['pressure'].unit})'"
            f" or 'side_force (N)',"
            " instead of a velocity 'time (s)' and 'distance (m)', or 'cutoff (Hz)'. For"
            " other names, granphon fit takes"
            f" --column '{example}=NAME ({unit})', Python columns={{'{example}': 'NAME ({unit})'}}"
        )
        if "distance" in missing_kinds:
            mend = f"Give one distance for all rows: --distance, Python distance=. Or: {mend}"
        headings_of_table = list_names(repr(str(heading)) for heading in self.table.headings)
        raise InputError(
            f"{self.table.name} has {', and '.join(lacks)}",
            f"Its columns are {headings_of_table}",
            mend,
        )

    def read_force(self, load: str, convert: Callable[[float], float] | None) -> Array:
        """Return the contact forces, (n,), N, from the column of the kind ``load``.

        ``convert`` is a function of one load, SI, that returns the contact force, N; it is None for
        a column of forces.
        """
        values = self.column(load)
        if convert is None:
            return values
        return np.array([convert(value) for value in values.tolist()])

    def read_sigma(self, error: str, velocity: Array) -> Array:
        """Return the standard errors, (n,), m/s, of a ``velocity`` (n,), m/s, from the column of
        the kind ``error``: "sigma", "time_sigma" or "cutoff_sigma".

        A velocity has the same relative error as the time or the cut-off from which it follows.
        """
        heading = self.heading(error)
        if PERCENT.measures(self.table.unit(heading)):
            percents = self.table.column(heading, PERCENT, _explain_column(error))
            return velocity * (percents / 100.0)
        if error == "sigma":
            return self.column("sigma")
        return velocity * self.column(error) / self.column(_MEASURED_OF_ERROR[error])


def _read_distance(distance: Any) -> tuple[float | None, float]:
    """Return the distance that sound travels, m, None if a column gives it, and its standard error,
    m, from a ``distance`` or a tuple of both; InputError for anything else.
    """
    if distance is None:
        return None, 0.0
    pair = distance if isinstance(distance, tuple) else (distance, 0.0)
    if len(pair) != 2:
        raise InputError(
            f"distance is {brief(distance)}", mend="Give a number, or (distance, standard error), m"
        )
    return positive("distance", pair[0], "m"), not_negative("error of distance", pair[1], "m")


def _require_conversion(
    path: Any,
    load: str,
    force_of_side_force: Callable[[float], float] | None,
    force_of_pressure: Callable[[float], float] | None,
) -> None:
    """Raise InputError if the table at ``path`` has a ``load`` of side forces or pressures, and
    ``force_of_side_force`` or ``force_of_pressure``, which converts these to contact forces, is
    no function.
    """
    if load == "side_force" and not callable(force_of_side_force):
        why = "The contact forces depend on the number of balls on a side too"
        mend = (
            "Give the scene's load as side_force and balls_per_side, or in Python frame, a function"
            " that returns the contact forces"
        )
        raise InputError(f"{path} gives side forces", why, mend)
    if load == "pressure" and not callable(force_of_pressure):
        why = "The contact forces depend on the packing too"
        mend = "Give pressed, a function that returns the contact forces"
        raise InputError(f"{path} gives pressures", why, mend)


def _require_long_waves(path: Any, *, can_convert: bool, has_pulses: bool) -> None:
    """Raise InputError for a table of cut-off frequencies at ``path`` that also ``has_pulses``,
    frequencies of pulses, or of which no function ``can_convert`` the cut-off frequencies to
    velocities.
    """
    if has_pulses:
        why = "These are no pulses of a given frequency"
        raise InputError(f"{path} gives cut-off frequencies", why, "Leave the frequency out")
    if not can_convert:
        why = "The velocities of long waves depend on the packing too"
        mend = "Give carried, a function that returns the velocities"
        raise InputError(f"{path} gives cut-off frequencies", why, mend)


def _require_no_second_distance(source: _SourceColumns, measured: str) -> None:
    """Raise InputError if the table of the ``source`` has a column that contradicts a distance
    given beside the table: distances beside times, or the ``measured`` kind if that is not "time".
    """
    has_times = measured == "time"
    column = source.choose("distance") if has_times else measured
    if column is None:
        return
    why = "A distance given beside the table is for times of flight only, and for all of them"
    mend = "Leave it out" if has_times else "Leave it out, or name the column of times"
    raise InputError(f"{source.path} has a {column} column, and a distance is given too", why, mend)
