"""Measured sound velocities, from arrays or from a table."""

from __future__ import annotations

import os
import re
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Annotated, Any, Self

import numpy as np

from granphon.base.arrays import Array
from granphon.base.errors import InputError
from granphon.base.quantities import (
    FREQUENCY,
    LENGTH,
    LIGHT_VELOCITY,
    LOADS,
    TIME,
    Quantity,
    load_quantities,
)
from granphon.base.results import Result
from granphon.base.tables import Table
from granphon.base.text import list_names, suggest
from granphon.base.validation import finite_list, positive

#: quantities in measurements, read with any of their units: velocity, m/s; frequency, Hz; time of
#: flight, s
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


def _explain_column(kind: str) -> str:
    """Return how to name a column: in the file, for ``granphon fit``, and in Python."""
    options = f"granphon fit also takes --column '{kind}=NAME', Python columns={{'{kind}': 'NAME'}}"
    return f"Head the column that is meant '{kind}'; {options}"


def read_sigma(text: str, velocity: Array) -> Any:
    """Read standard errors of the velocities, m/s, from a text: "5 m/s" for all velocities, or "1
    %" of each.
    """
    if re.search(r"(?:%|percent)\s*$", text):
        return velocity * (PERCENT.read(text) / 100.0)
    return _SIGMA.read(text)


@dataclass(frozen=True, eq=False, repr=False)
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
    InputError : a value is not a finite number above zero, a velocity is above that of light, or
        the arrays have different lengths.
    """

    force: Annotated[Array, "", "N"]
    velocity: Annotated[Array, "", "m/s"]
    sigma: Annotated[Any, "", "m/s"] = None
    frequency: Annotated[Any, "", "Hz"] = None

    def __post_init__(self) -> None:
        counts = {}
        for name in self.units:
            values = getattr(self, name)
            is_required = name in ("force", "velocity")
            if values is None and not is_required:
                continue
            array = np.array(finite_list(name, values, self.units[name], "above zero"))
            counts[name] = array.size
            if name == "velocity" and np.max(array, initial=0.0) > LIGHT_VELOCITY:
                fault = f"velocity is {np.max(array):.6g} m/s, more than the velocity of light"
                raise InputError(fault, mend="Look at the unit, and at the number itself")
            is_array = is_required or bool(np.ndim(values))
            object.__setattr__(self, name, array if is_array else float(array[0]))
        n = counts["force"]
        optional = [values for values in (self.sigma, self.frequency) if np.ndim(values)]
        if counts["velocity"] != n or any(np.size(values) != n for values in optional):
            shown = ", ".join(f"{count} of {name}" for name, count in counts.items())
            mend = "Give the same number of each; sigma and frequency may be one number"
            raise InputError(f"found {shown}", mend=mend)
        super().__post_init__()

    @classmethod
    def read(
        cls,
        path: str | os.PathLike[str],
        columns: Mapping[str, str] | None = None,
        distance: float | None = None,
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
        distance : distance that sound travels in each of the times, m, where no column gives it.
        frame : converts a side force to the contact force, both in N.
        pressed : converts a pressure to the contact force, N.
        periods : number of periods of the lattice: a pressure is in N for 1, in N/m for 2, in Pa
            for 3.
        carried : converts contact forces, N, and cut-off frequencies, Hz, to velocities of long
            waves, m/s, (n,).

        Raises
        ------
        InputError : a file, line or cell cannot be read, a column is missing, or a quantity is
            given twice: by two columns, or by a ``distance`` and a column of distances or of
            velocities.
        """
        table = Table.read(path)
        named = dict(columns or {})
        unknown = [name for name in named if name not in COLUMNS]
        if unknown:
            raise InputError(
                f"{unknown[0]!r} is not a kind of column of measurements",
                mend=suggest(unknown[0], COLUMNS),
            )

        def choose(*kinds: str) -> str | None:
            """Return which of these kinds of column the table has; None if it has none of them."""
            present = [kind for kind in kinds if kind in named]
            if not present:
                present = [kind for kind in kinds if kind in table]
            if len(present) > 1:
                mend = f"Keep one of them. {_explain_column(present[0])}"
                raise InputError(f"{path} has both {' and '.join(present)}", mend=mend)
            return present[0] if present else None

        quantities = {**COLUMNS, **load_quantities(periods)}

        def read(kind: str) -> Array:
            return table.column(named.get(kind, kind), quantities[kind], _explain_column(kind))

        load = choose("force", "side_force", "pressure")
        if load == "side_force" and frame is None:
            why = "The contact forces depend on the number of balls on a side too"
            mend = "Give the scene's load as side_force and balls_per_side"
            raise InputError(f"{path} gives side forces", why, mend)
        if load == "pressure" and pressed is None:
            why = "The contact forces depend on the packing too"
            mend = "Give pressed, a function that returns the contact forces"
            raise InputError(f"{path} gives pressures", why, mend)
        measured = choose("velocity", "time", "cutoff") or "velocity"
        timed = measured == "time"
        error = choose("sigma", "time_sigma", "cutoff_sigma")
        pulsed = choose("frequency")
        if measured == "cutoff" and (carried is None or pulsed):
            why = "The velocities of long waves depend on the packing too"
            mend = "Give carried, a function that returns the velocities"
            if pulsed:
                why = "These are no pulses of a given frequency"
                mend = "Leave the frequency out"
            raise InputError(f"{path} gives cut-off frequencies", why, mend)
        required = [measured]
        if timed and distance is None:
            required.append("distance")
        # the error of a time or a cut-off is converted by that time or cut-off
        error_of = error.removesuffix("_sigma") if error and error != "sigma" else measured
        if error_of != measured:
            required.append(error_of)
        required += [kind for kind in (error, pulsed) if kind]
        heads = {kind: named.get(kind, kind) for kind in (load or "force", *required)}
        # columns that the table lacks, and those without a unit: one error says all
        lacking = [kind for kind, name in heads.items() if name not in table]
        unitless = [
            kind for kind, name in heads.items() if kind not in lacking and not table.unit(name)
        ]
        if lacking or unitless:
            lacks = [
                "no column named " + " and none named ".join(repr(heads[kind]) for kind in lacking)
            ] * bool(lacking)
            lacks += ["no unit for " + " and ".join(repr(heads[kind]) for kind in unitless)] * bool(
                unitless
            )
            first = next(kind for kind in heads if kind in lacking + unitless)
            headings = " and ".join(f"'{kind} ({quantities[kind].unit})'" for kind in heads)
            unit = quantities[first].unit
            mend = (
                f"Head the columns {headings}, each with its unit in brackets;"
                f" instead of a force there may be 'pressure ({quantities['pressure'].unit})'"
                f" or 'side_force (N)',"
                " instead of a velocity 'time (s)' and 'distance (m)', or 'cutoff (Hz)'. For"
                " other names, granphon fit takes"
                f" --column '{first}=NAME ({unit})', Python columns={{'{first}': 'NAME ({unit})'}}"
            )
            why = f"Its columns are {list_names(repr(str(heading)) for heading in table.headings)}"
            raise InputError(f"{table.name} has {', and '.join(lacks)}", why, mend)
        converted = {"side_force": frame, "pressure": pressed}.get(load or "force")
        force = read(load or "force")
        if converted is not None:
            force = np.array([converted(value) for value in force.tolist()])
        length_column = choose("distance" if timed else "velocity")
        if distance is not None and length_column is not None:
            why = (
                "A distance given beside the table is for times of flight only, and for all of them"
            )
            mend = "Leave it out" if timed else "Leave it out, or name the column of times"
            raise InputError(
                f"{path} has a {length_column} column, and a distance is given too", why, mend
            )
        if measured == "velocity":
            velocity = read("velocity")
        elif carried is not None and not timed:
            velocity = carried(force, read("cutoff"))
        elif distance is None:
            velocity = read("distance") / read("time")
        else:
            velocity = positive("distance", distance, "m") / read("time")
        sigma = None
        if error is not None:
            head = named.get(error, error)
            if PERCENT.measures(table.unit(head)):
                sigma = velocity * (table.column(head, PERCENT, _explain_column(error)) / 100.0)
            else:
                sigma = (
                    read("sigma") if error == "sigma" else velocity * read(error) / read(error_of)
                )
        frequency = read("frequency") if pulsed else None
        try:
            return cls(force, velocity, sigma, frequency)
        except InputError as error:
            raise InputError(f"{path}: {error}") from None
