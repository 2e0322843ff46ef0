"""Tables of balls and of contacts: read from CSV files or arrays, and written as CSV files."""

from __future__ import annotations

import json
import math
import os
import sys
from collections.abc import Mapping
from dataclasses import replace
from typing import Any

import numpy as np

from granphon.balls.contact_model import ContactModel
from granphon.base.arrays import Array, Index
from granphon.base.errors import InputError, brief
from granphon.base.quantities import LENGTH, LOADS, Quantity
from granphon.base.results import plain, restore
from granphon.base.staging import write_text
from granphon.base.tables import Heading, Table, table_text
from granphon.base.text import (
    closest,
    decode,
    list_names,
    open_seal,
    read_bytes,
    require_path,
    seal,
    warn_unverified,
)
from granphon.base.validation import real_array, require, truth
from granphon.networks.building import (
    MOST_BYTES,
    Balls,
    Contacts,
    Source,
    find_rounding,
    read_whole_numbers,
)

_PLACE = replace(LENGTH, least="any")
_FORCE = replace(LOADS["force"], least="zero or above")
_ACROSS = replace(_FORCE, least="any")
_STIFFNESS = Quantity("stiffness", "N/m", "3 MN/m", "N/m, kN/m, MN/m, N/um", "zero or above")
_ROLLING = Quantity("torque", "N*m", "1 N*mm", "N*m, N*mm", "zero or above")
#: columns of the table of balls, and of that of contacts, with their quantities; None: numbers
#: without a unit
BALLS: Mapping[str, Quantity | None] = {
    "id": None,
    "x": _PLACE,
    "y": _PLACE,
    "z": _PLACE,
    "radius": LENGTH,
    "diameter": LENGTH,
    "mass": Quantity("mass", "kg", "2 g", "kg, g, mg"),
    "inertia": Quantity("moment of inertia", "kg*m^2", "1 g*mm^2", "kg*m^2, g*mm^2"),
    "kind": None,
}
CONTACTS: Mapping[str, Quantity | None] = {
    "i": None,
    "j": None,
    "shift_1": None,
    "shift_2": None,
    "shift_3": None,
    "nx": None,
    "ny": None,
    "nz": None,
    "normal_force": _FORCE,
    "normal_stiffness": _STIFFNESS,
    "shear_stiffness": _STIFFNESS,
    "torsion_stiffness": _ROLLING,
    "bending_stiffness": _ROLLING,
    "arm_i": _PLACE,
    "arm_j": _PLACE,
    "tangential_x": _ACROSS,
    "tangential_y": _ACROSS,
    "tangential_z": _ACROSS,
}
_AXES = ("x", "y", "z")
_TANGENTIAL = tuple(f"tangential_{axis}" for axis in _AXES)
#: columns that may hold "inf": those of a body that does not move
_OF_WALLS = ("radius", "diameter", "mass", "inertia")
#: columns whose names are compared with those that are known: programs write some tens, and the
#: comparison is slow
_MOST_NAMES = 1000
#: what begins the line of a written table that holds what concerns all balls
_REMARK = "# granphon network: "


class _Columns:
    """The columns of a table of balls or contacts, in SI, from a file or from arrays; ``name`` is
    what messages call it.

    ``remark`` is what a written table says of all balls; empty for a table from elsewhere.
    ``sealed`` says whether the file has a digest, which is then that of the rest of it; None for
    arrays.
    """

    def __init__(
        self,
        what: str,
        source: Any,
        known: Mapping[str, Quantity | None],
        columns: Mapping[str, str],
    ) -> None:
        self.remark: dict[str, Any] = {}
        self.sealed: bool | None = None
        table: Table | None = None
        arrays: dict[str, Any] = {}
        if isinstance(source, str | os.PathLike):
            raw = read_bytes(source, MOST_BYTES)
            self.name = str(source)
            text = decode(self.name, raw)
            self.sealed = open_seal(self.name, text.replace("\r\n", "\n"))[1]
            table = Table.parse(self.name, raw)
            for line in [line for line in text.splitlines() if line.startswith(_REMARK)][:1]:
                try:
                    self.remark = json.loads(line.removeprefix(_REMARK))
                except (ValueError, RecursionError):
                    self.remark = None  # type: ignore[assignment]  # refused below
                if not isinstance(self.remark, dict):
                    raise InputError(
                        f"{self.name}: the line {brief(line)} cannot be read", mend="Leave it out"
                    )
            there = [heading.name for heading in table.headings]
        else:
            self.name = f"the table of {what}"
            named = getattr(getattr(source, "dtype", None), "names", None)
            if named is None and not (hasattr(source, "keys") and hasattr(source, "__getitem__")):
                mend = (
                    "Give the path of a file, a mapping of arrays, a structured array or a data"
                    " frame"
                )
                raise InputError(f"{self.name} is {brief(source)}", mend=mend)
            arrays = {str(name): source[name] for name in (named or source.keys())}
            there = list(arrays)
        keys = [Heading.parse(name).key for name in there]
        given = {Heading.parse(columns.get(name, name)).key for name in known}
        lacking = [name for name in known if Heading.parse(name).key not in keys]
        # an optional column with a misspelled name would be passed over
        for name, key in list(zip(there, keys, strict=True))[:_MOST_NAMES]:
            strange = key not in given and key not in known and len(key) > 2
            meant = closest(key, known) if strange and lacking else None
            if meant in lacking:
                raise InputError(
                    f"{self.name} has a column {brief(str(name))}", mend=f"Did you mean {meant!r}?"
                )
        self._headings = [
            str(heading) for heading in (table.headings if table is not None else there)
        ]
        self._values: dict[str, Array] = {}
        self._units: dict[str, str] = {}
        self.kinds: tuple[str, ...] | None = None
        for name, kind in known.items():
            wanted = columns.get(name, name)
            if name == "kind":  # the only column of names, which may be numbers
                if table is not None and wanted in table:
                    cells = table.columns[keys.index(Heading.parse(wanted).key)]
                    self.kinds = tuple(map(sys.intern, cells))
                elif wanted in arrays:
                    try:
                        self.kinds = tuple(map(str, np.asarray(arrays[wanted]).ravel().tolist()))
                    except ValueError as error:
                        raise InputError(
                            f"kind of {self.name}: {error}", mend="Give a list of names"
                        ) from None
            elif table is not None and wanted in table:
                self._values[name], self._units[name] = (
                    _read_cells(table, name, wanted, kind),
                    table.unit(wanted),
                )
            elif wanted in arrays:
                unit = Heading.parse(wanted).unit
                if unit and (kind is None or unit != kind.unit):
                    what = f"{self.name}: the column {wanted!r} is in {unit}, and arrays are in SI"
                    raise InputError(what, mend=f"Convert it, and call it {name!r}")
                values = self._values[name] = real_array(f"{name} of {self.name}", arrays[wanted])
                if values.ndim != 1:
                    raise InputError(
                        f"{name} of {self.name} has the shape {values.shape}",
                        mend="Give a list of numbers",
                    )
        sizes = {name: len(values) for name, values in self._values.items()}
        if len(set(sizes.values())) > 1:
            said = ", ".join(f"{size} of {name}" for name, size in sizes.items())
            raise InputError(f"{self.name} has columns of different lengths: {said}")

    def __contains__(self, name: str) -> bool:
        return name in self._values

    def require(self, *names: str) -> None:
        """Raise :class:`InputError` unless there are columns of all these names."""
        if missing := [name for name in names if name not in self]:
            what = f"{self.name} has no column {', '.join(map(repr, missing))}"
            mend = f"Name the column that is meant, as in columns={{{missing[0]!r}: 'NAME'}}"
            raise InputError(what, f"Its columns are {list_names(self._headings)}", mend)

    def read(self, name: str) -> Array:
        """The numbers of a column, (rows,)."""
        self.require(name)
        return self._values[name]

    def find(self, name: str) -> Array | None:
        """The numbers of a column; None if there is no such column."""
        return self._values.get(name)

    def whole(self, name: str) -> Index:
        """The whole numbers of a column."""
        values = self.read(name)
        try:
            return read_whole_numbers(name, values)
        except InputError as error:
            raise InputError(f"{self.name}: {error}") from None

    def vectors(self, *names: str, wide: bool = False) -> Array | None:
        """The columns of some names side by side, as many of the first as there are (zeros behind
        if ``wide``), or None.
        """
        there = [name for name in names if name in self]
        if not there:
            return None
        self.require(*names[: names.index(there[-1]) + 1])
        units = [self._units.get(name, "") for name in there]
        if len(set(units)) > 1 and all(units):
            said = ", ".join(f"{name} ({unit})" for name, unit in zip(there, units, strict=True))
            raise InputError(
                f"{self.name} has its coordinates in different units: {said}", mend="Use one unit"
            )
        found = np.stack([self.read(name) for name in there], axis=1)
        return np.pad(found, ((0, 0), (0, len(names) - len(there)))) if wide else found

    def rounding(self, *names: str) -> Array:
        """Half a unit of the last digit of each number of some columns, of one unit, that there
        are: (rows, m), SI.
        """
        there = [name for name in names if name in self]
        kind = BALLS[there[0]]
        unit = self._units.get(there[0], "")
        factor = kind.factor(unit) if kind is not None and unit else 1.0
        return factor * find_rounding(
            np.stack([self.read(name) for name in there], axis=1) / factor
        )


def _read_cells(table: Table, name: str, wanted: str, kind: Quantity | None) -> Array:
    """Return the numbers (rows,) of a column in SI; bodies that do not move may have "inf"."""
    if kind is None:
        if unit := table.unit(wanted):
            raise InputError(
                f"{table.name}: the column {name!r} has the unit {brief(unit)}, and needs none"
            )
        try:
            return table.numbers(wanted)
        except InputError as error:
            raise InputError(f"{table.name}: {error}") from None
    if name not in _OF_WALLS:
        return table.column(wanted, kind)
    key = Heading.parse(wanted).key
    place = next(n for n, heading in enumerate(table.headings) if heading.key == key)
    if "n" not in "".join(table.columns[place]).lower():
        return table.column(wanted, kind)
    endless = np.array([cell.lower() in ("inf", "infinity") for cell in table.columns[place]], bool)
    finite = tuple(
        "1" if wall else cell for cell, wall in zip(table.columns[place], endless, strict=True)
    )
    columns = (*table.columns[:place], finite, *table.columns[place + 1 :])
    return np.where(endless, math.inf, replace(table, columns=columns).column(wanted, kind))


def read_tables(
    balls: Any, contacts: Any, columns: Mapping[str, str], cell: Any, pbc: Any
) -> Source:
    """Return what two tables say of balls and contacts; see ``ContactNetwork.from_table`` for the
    arguments.
    """
    named: object = columns
    if not isinstance(named, Mapping) or not all(
        isinstance(one, str) for pair in named.items() for one in pair
    ):
        raise InputError(
            f"columns are {brief(columns)}", mend="Give a mapping of names: {'radius': 'R (mm)'}"
        )
    for name in columns:
        if name not in BALLS and name not in CONTACTS:
            meant = closest(name, [*BALLS, *CONTACTS])
            mend = f"Did you mean {meant!r}?" if meant else "Use " + ", ".join([*BALLS, *CONTACTS])
            raise InputError(f"{name!r} is not a column of balls or contacts", mend=mend)
    of_balls = _Columns(
        "balls", balls, BALLS, {name: columns[name] for name in columns if name in BALLS}
    )
    said = of_balls.remark
    # of either sign
    known = {**CONTACTS, "normal_force": _ACROSS} if said.get("adhesive") is True else CONTACTS
    of_contacts = _Columns(
        "contacts", contacts, known, {name: columns[name] for name in columns if name in CONTACTS}
    )
    if said or of_balls.sealed or of_contacts.sealed:
        # granphon has written one of the two, and gives both a digest
        for table in (of_balls, of_contacts):
            if table.sealed is False:
                warn_unverified(table.name)
    if cell is None and pbc is None and "cell" in said:
        cell = said["cell"]
        pbc = said.get("pbc")
    # the vectors of the cell, m, from lengths (p,) or vectors (p, d), and whether each is a period
    periods = np.zeros((3, 3))
    periodic = np.zeros(3, bool)
    if cell is not None:
        given = real_array("cell", cell)
        if given.ndim == 1 and 1 <= given.size <= 3:
            given = np.diag(given)
        if given.ndim != 2 or not 1 <= len(given) <= given.shape[1] <= 3:
            what = f"the cell has the shape {np.shape(cell)}"
            raise InputError(what, mend="Give the lengths of the periods, or their vectors as rows")
        periods[: len(given), : given.shape[1]] = given
        periodic[: len(given)] = np.any(given != 0.0, axis=1)
    if pbc is not None:
        plain = pbc.tolist() if isinstance(pbc, np.ndarray) else pbc
        flags = (
            [require("pbc", truth, one) for one in plain]
            if isinstance(plain, list | tuple)
            else None
        )
        if flags is None or len(flags) > 3 or (any(flags) and cell is None):
            raise InputError(
                f"pbc is {brief(pbc)}", mend="Give a truth value for each vector of the cell"
            )
        periodic[: len(flags)] = flags
        periodic[len(flags) :] = False
    of_balls.require("x")
    if "radius" in of_balls and "diameter" in of_balls:
        raise InputError(
            f"{of_balls.name} has both radius and diameter", mend="Leave one of them out"
        )
    radii = 0.5 * of_balls.read("diameter") if "diameter" in of_balls else of_balls.read("radius")
    positions = of_balls.vectors(*_AXES)
    assert positions is not None
    labels = of_balls.whole("id") if "id" in of_balls else None
    sizes = of_balls.rounding("radius", "diameter")[:, 0] * (0.5 if "diameter" in of_balls else 1.0)
    found = Balls(
        of_balls.name,
        positions,
        radii,
        of_balls.find("mass"),
        of_balls.find("inertia"),
        labels,
        rounding=of_balls.rounding(*_AXES),
        radius_rounding=sizes,
        kinds=of_balls.kinds,
    )
    of_contacts.require("i", "j")
    i = of_contacts.whole("i")
    j = of_contacts.whole("j")
    steps = of_contacts.vectors("shift_1", "shift_2", "shift_3", wide=True)
    shift = None if steps is None else read_whole_numbers(f"shift of {of_contacts.name}", steps)
    springs = {
        name: of_contacts.find(name)
        for name in CONTACTS
        if name.endswith(("force", "stiffness")) or name.startswith("arm")
    }
    normal, across = (
        of_contacts.vectors(*names, wide=True) for names in (("nx", "ny", "nz"), _TANGENTIAL)
    )
    return Source(
        found,
        Contacts(of_contacts.name, i, j, shift, None, normal, across, **springs),
        periods,
        periodic,
        **{
            name: said[name]
            for name in ("dimension", "motions", "prestress", "left_out", "adhesive")
            if name in said
        },
        contact_model=restore(said["contact_model"], ContactModel, of_balls.name)
        if "contact_model" in said
        else None,
    )


def write_tables(
    fields: Mapping[str, Any], balls: str | os.PathLike[str], contacts: str | os.PathLike[str]
) -> None:
    """Write the fields of a network as two CSV files; see ``ContactNetwork.write_tables``."""
    names = fields["labels"]
    ends = [one if names is None else names[one] for one in (fields["i"], fields["j"])]
    of_balls = {
        **({} if names is None else {"id": names}),
        **dict(zip(_AXES, fields["positions"].T, strict=True)),
        "radius": fields["radii"],
        "mass": fields["masses"],
        "inertia": fields["inertias"],
        **({} if fields["kinds"] is None else {"kind": np.array(fields["kinds"])}),
    }
    steps = zip(("shift_1", "shift_2", "shift_3"), fields["shift"].T, strict=True)
    of_contacts = {
        "i": ends[0],
        "j": ends[1],
        **dict(steps),
        **dict(zip(("nx", "ny", "nz"), fields["normal"].T, strict=True)),
        **{
            name: fields[name]
            for name in CONTACTS
            if name.endswith(("force", "stiffness")) or "arm" in name
        },
    }
    if fields["tangential_force"] is not None:
        of_contacts |= dict(zip(_TANGENTIAL, fields["tangential_force"].T, strict=True))
    about = {
        name: fields[name] for name in ("pbc", "dimension", "motions", "prestress", "left_out")
    }
    about |= {"adhesive": True} if fields["adhesive"] else {}
    if fields["contact_model"] is not None:
        about["contact_model"] = plain(fields["contact_model"])
    remark = _REMARK.removeprefix("# ") + json.dumps({"cell": fields["cell"].tolist(), **about})
    for path, table, known, comments in (
        (balls, of_balls, BALLS, [remark]),
        (contacts, of_contacts, CONTACTS, []),
    ):
        require_path(path)
        headings = [Heading(name, kind.unit if (kind := known[name]) else "") for name in table]
        rows = zip(*(column.tolist() for column in table.values()), strict=True)
        write_text(path, seal(table_text(headings, rows, comments).split("\n")[:-1], 1))
