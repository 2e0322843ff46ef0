"""Tables of balls and of contacts: read from CSV files or arrays, and written as CSV files."""

from __future__ import annotations

import json
import math
import os
import sys
from collections.abc import Mapping, Sequence
from contextlib import suppress
from dataclasses import replace
from typing import Any

import numpy as np

from granphon.balls.contact_model import ContactModel
from granphon.base.arrays import Array, Flags, Index
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
_OF_SPRINGS = tuple(
    name for name in CONTACTS if name.endswith(("force", "stiffness")) or name.startswith("arm")
)
#: columns that may hold "inf": those of a body that does not move
_OF_WALLS = ("radius", "diameter", "mass", "inertia")
#: most columns whose names are compared with known names: programs write some tens, and the
#: comparison is slow
_MOST_NAMES = 1000
#: begins the line of a written table that holds the fields of the whole network
_REMARK = "# granphon network: "


class _Columns:
    """The columns of a table of balls or contacts, in SI, from a file or from arrays; ``name`` is
    the name of the table in messages.

    ``remark`` has the fields of the whole network in a written table; empty for a table from
    elsewhere. ``sealed`` says whether the file has a digest, which then fits; None for arrays.
    """

    def __init__(
        self,
        subject: str,
        source: Any,
        known: Mapping[str, Quantity | None],
        columns: Mapping[str, str],
    ) -> None:
        self.remark: dict[str, Any] = {}
        self.sealed: bool | None = None
        self._table: Table | None = None
        self._arrays: dict[str, Any] = {}
        if isinstance(source, str | os.PathLike):
            self.name = str(source)
            self._table = self._read_file(source)
            names = [heading.name for heading in self._table.headings]
            self._headings = [str(heading) for heading in self._table.headings]
        else:
            self.name = f"the table of {subject}"
            self._arrays = self._read_arrays(source)
            names = list(self._arrays)
            self._headings = names
        keys = [Heading.parse(name).key for name in names]
        self._require_spelling(names, keys, known, columns)
        self._values: dict[str, Array] = {}
        self._units: dict[str, str] = {}
        self.kinds: tuple[str, ...] | None = None
        for name, kind in known.items():
            heading = columns.get(name, name)
            if name == "kind":  # the only column of names, which may be numbers
                self._read_kinds(heading, keys)
            elif self._table is not None and heading in self._table:
                self._values[name] = _read_cells(self._table, name, heading, kind)
                self._units[name] = self._table.unit(heading)
            elif heading in self._arrays:
                self._values[name] = self._read_array(name, heading, kind)
        sizes = {name: len(values) for name, values in self._values.items()}
        if len(set(sizes.values())) > 1:
            shown = ", ".join(f"{size} of {name}" for name, size in sizes.items())
            raise InputError(f"{self.name} has columns of different lengths: {shown}")

    def _read_file(self, path: str | os.PathLike[str]) -> Table:
        """Return the table in a file, and set ``remark`` and ``sealed``."""
        raw = read_bytes(path, MOST_BYTES)
        text = decode(self.name, raw)
        _, self.sealed = open_seal(self.name, text.replace("\r\n", "\n"))
        table = Table.parse(self.name, raw)
        line = next((line for line in text.splitlines() if line.startswith(_REMARK)), None)
        if line is not None:
            remark: Any = None
            with suppress(ValueError, RecursionError):
                remark = json.loads(line.removeprefix(_REMARK))
            if not isinstance(remark, dict):
                raise InputError(
                    f"{self.name}: the line {brief(line)} cannot be read", mend="Leave it out"
                )
            self.remark = remark
        return table

    def _read_arrays(self, source: Any) -> dict[str, Any]:
        """Return the columns of a mapping, a structured array or a data frame, by their names."""
        fields = getattr(getattr(source, "dtype", None), "names", None)
        if fields is None and not (hasattr(source, "keys") and hasattr(source, "__getitem__")):
            raise InputError(
                f"{self.name} is {brief(source)}",
                mend="Give the path of a file, a mapping of arrays, a structured array or a data"
                " frame",
            )
        return {str(name): source[name] for name in (fields or source.keys())}

    def _require_spelling(
        self,
        names: Sequence[str],
        keys: Sequence[str],
        known: Mapping[str, Quantity | None],
        columns: Mapping[str, str],
    ) -> None:
        """Raise :class:`InputError` for a misspelled name of an optional column, which would be
        passed over.
        """
        requested = {Heading.parse(columns.get(name, name)).key for name in known}
        lacking = [name for name in known if Heading.parse(name).key not in keys]
        if not lacking:
            return
        for name, key in zip(names[:_MOST_NAMES], keys[:_MOST_NAMES], strict=True):
            is_strange = key not in requested and key not in known and len(key) > 2
            guess = closest(key, known) if is_strange else None
            if guess in lacking:
                raise InputError(
                    f"{self.name} has a column {brief(str(name))}", mend=f"Did you mean {guess!r}?"
                )

    def _read_kinds(self, heading: str, keys: Sequence[str]) -> None:
        """Set the names of the kinds of the balls, if the table has a column of them."""
        if self._table is not None and heading in self._table:
            cells = self._table.columns[keys.index(Heading.parse(heading).key)]
            self.kinds = tuple(map(sys.intern, cells))
        elif heading in self._arrays:
            try:
                self.kinds = tuple(map(str, np.asarray(self._arrays[heading]).ravel().tolist()))
            except ValueError as error:
                raise InputError(
                    f"kind of {self.name}: {error}", mend="Give a list of names"
                ) from None

    def _read_array(self, name: str, heading: str, kind: Quantity | None) -> Array:
        """Return the numbers (rows,) of a column of arrays, which are in SI."""
        unit = Heading.parse(heading).unit
        if unit and (kind is None or unit != kind.unit):
            raise InputError(
                f"{self.name}: the column {heading!r} is in {unit}, and arrays are in SI",
                mend=f"Convert it, and call it {name!r}",
            )
        values = real_array(f"{name} of {self.name}", self._arrays[heading])
        if values.ndim != 1:
            raise InputError(
                f"{name} of {self.name} has the shape {values.shape}", mend="Give a list of numbers"
            )
        return values

    def __contains__(self, name: str) -> bool:
        return name in self._values

    def require(self, *names: str) -> None:
        """Raise :class:`InputError` unless there are columns of all these names."""
        lacking = [name for name in names if name not in self]
        if lacking:
            fault = f"{self.name} has no column {', '.join(map(repr, lacking))}"
            mend = f"Name the column that is meant, as in columns={{{lacking[0]!r}: 'NAME'}}"
            raise InputError(fault, f"Its columns are {list_names(self._headings)}", mend)

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
        """The columns of some names side by side, or None without any of them.

        Only the last of the names may be lacking; ``wide`` puts zeros in their place.
        """
        present = [name for name in names if name in self]
        if not present:
            return None
        self.require(*names[: names.index(present[-1]) + 1])
        units = [self._units.get(name, "") for name in present]
        if len(set(units)) > 1 and all(units):
            pairs = zip(present, units, strict=True)
            shown = ", ".join(f"{name} ({unit})" for name, unit in pairs)
            raise InputError(
                f"{self.name} has its coordinates in different units: {shown}", mend="Use one unit"
            )
        values = np.stack([self.read(name) for name in present], axis=1)
        if not wide:
            return values
        return np.pad(values, ((0, 0), (0, len(names) - len(present))))

    def rounding(self, *names: str) -> Array:
        """Half a unit of the last digit of each number of those of some columns that are present,
        of one unit: (rows, m), SI.
        """
        present = [name for name in names if name in self]
        kind = BALLS[present[0]]
        unit = self._units.get(present[0], "")
        factor = kind.factor(unit) if kind is not None and unit else 1.0
        numbers = np.stack([self.read(name) for name in present], axis=1) / factor
        return factor * find_rounding(numbers)


def _read_cells(table: Table, name: str, heading: str, kind: Quantity | None) -> Array:
    """Return the numbers (rows,) of a column in SI; bodies that do not move may have "inf"."""
    if kind is None:
        unit = table.unit(heading)
        if unit:
            raise InputError(
                f"{table.name}: the column {name!r} has the unit {brief(unit)}, and needs none"
            )
        try:
            return table.numbers(heading)
        except InputError as error:
            raise InputError(f"{table.name}: {error}") from None
    if name not in _OF_WALLS:
        return table.column(heading, kind)
    key = Heading.parse(heading).key
    index = next(n for n, parsed in enumerate(table.headings) if parsed.key == key)
    cells = table.columns[index]
    if "n" not in "".join(cells).lower():
        return table.column(heading, kind)
    # cells of bodies that do not move are read as "1", and become infinite then
    is_infinite = [cell.lower() in ("inf", "infinity") for cell in cells]
    finite = ["1" if infinite else cell for cell, infinite in zip(cells, is_infinite, strict=True)]
    columns = (*table.columns[:index], tuple(finite), *table.columns[index + 1 :])
    values = replace(table, columns=columns).column(heading, kind)
    return np.where(np.array(is_infinite, bool), math.inf, values)


def read_tables(
    balls: Any, contacts: Any, columns: Mapping[str, str], cell: Any, pbc: Any
) -> Source:
    """Return the balls and contacts of two tables; see ``ContactNetwork.from_table`` for the
    arguments.
    """
    _require_columns(columns)
    names_of_balls = {name: columns[name] for name in columns if name in BALLS}
    names_of_contacts = {name: columns[name] for name in columns if name in CONTACTS}
    of_balls = _Columns("balls", balls, BALLS, names_of_balls)
    remark = of_balls.remark
    quantities: Mapping[str, Quantity | None] = CONTACTS
    if remark.get("adhesive") is True:
        quantities = {**CONTACTS, "normal_force": _ACROSS}  # of either sign
    of_contacts = _Columns("contacts", contacts, quantities, names_of_contacts)
    if remark or of_balls.sealed or of_contacts.sealed:
        # granphon has written one of the two, and gives both a digest
        for table in (of_balls, of_contacts):
            if table.sealed is False:
                warn_unverified(table.name)
    if cell is None and pbc is None and "cell" in remark:
        cell = remark["cell"]
        pbc = remark.get("pbc")
    periods, is_period = _read_cell(cell, pbc)
    options: dict[str, Any] = {
        name: remark[name]
        for name in ("dimension", "motions", "prestress", "left_out", "adhesive")
        if name in remark
    }
    if "contact_model" in remark:
        options["contact_model"] = restore(remark["contact_model"], ContactModel, of_balls.name)
    return Source(_read_balls(of_balls), _read_contacts(of_contacts), periods, is_period, **options)


def _require_columns(columns: Any) -> None:
    """Raise :class:`InputError` unless ``columns`` maps known names to headings."""
    is_mapping = isinstance(columns, Mapping)
    if not is_mapping or not all(
        isinstance(name, str) and isinstance(heading, str) for name, heading in columns.items()
    ):
        raise InputError(
            f"columns are {brief(columns)}", mend="Give a mapping of names: {'radius': 'R (mm)'}"
        )
    all_names = [*BALLS, *CONTACTS]
    for name in columns:
        if name not in all_names:
            meant = closest(name, all_names)
            mend = f"Did you mean {meant!r}?" if meant else "Use " + ", ".join(all_names)
            raise InputError(f"{name!r} is not a column of balls or contacts", mend=mend)


def _read_cell(cell: Any, pbc: Any) -> tuple[Array, Flags]:
    """Return the vectors of the cell (3, 3), m, from lengths (p,) or vectors (p, d), and which of
    them are periods (3,).
    """
    vectors = np.zeros((3, 3))
    is_period = np.zeros(3, bool)
    if cell is not None:
        rows = real_array("cell", cell)
        if rows.ndim == 1 and 1 <= rows.size <= 3:
            rows = np.diag(rows)
        if rows.ndim != 2 or not 1 <= len(rows) <= rows.shape[1] <= 3:
            raise InputError(
                f"the cell has the shape {np.shape(cell)}",
                mend="Give the lengths of the periods, or their vectors as rows",
            )
        vectors[: len(rows), : rows.shape[1]] = rows
        is_period[: len(rows)] = np.any(rows != 0.0, axis=1)
    if pbc is not None:
        values = pbc.tolist() if isinstance(pbc, np.ndarray) else pbc
        flags = None
        if isinstance(values, list | tuple):
            flags = [require("pbc", truth, value) for value in values]
        if flags is None or len(flags) > 3 or (any(flags) and cell is None):
            raise InputError(
                f"pbc is {brief(pbc)}", mend="Give a truth value for each vector of the cell"
            )
        is_period[: len(flags)] = flags
        is_period[len(flags) :] = False
    return vectors, is_period


def _read_balls(columns: _Columns) -> Balls:
    """Return the balls of a table; InputError if the table lacks places or sizes, or has radii and
    diameters.
    """
    columns.require("x")
    has_diameter = "diameter" in columns
    if "radius" in columns and has_diameter:
        raise InputError(
            f"{columns.name} has both radius and diameter", mend="Leave one of them out"
        )
    radii = 0.5 * columns.read("diameter") if has_diameter else columns.read("radius")
    positions = columns.vectors(*_AXES)
    assert positions is not None
    labels = columns.whole("id") if "id" in columns else None
    radius_rounding = columns.rounding("radius", "diameter")[:, 0] * (0.5 if has_diameter else 1.0)
    return Balls(
        columns.name,
        positions,
        radii,
        columns.find("mass"),
        columns.find("inertia"),
        labels,
        rounding=columns.rounding(*_AXES),
        radius_rounding=radius_rounding,
        kinds=columns.kinds,
    )


def _read_contacts(columns: _Columns) -> Contacts:
    """Return the contacts of a table; InputError if the table does not name their balls."""
    columns.require("i", "j")
    i = columns.whole("i")
    j = columns.whole("j")
    steps = columns.vectors("shift_1", "shift_2", "shift_3", wide=True)
    shift = None if steps is None else read_whole_numbers(f"shift of {columns.name}", steps)
    springs = {name: columns.find(name) for name in _OF_SPRINGS}
    normal = columns.vectors("nx", "ny", "nz", wide=True)
    tangential = columns.vectors(*_TANGENTIAL, wide=True)
    return Contacts(columns.name, i, j, shift, None, normal, tangential, **springs)


def write_tables(
    fields: Mapping[str, Any], balls: str | os.PathLike[str], contacts: str | os.PathLike[str]
) -> None:
    """Write the fields of a network as two CSV files; see ``ContactNetwork.write_tables``."""
    about = {
        name: fields[name] for name in ("pbc", "dimension", "motions", "prestress", "left_out")
    }
    if fields["adhesive"]:
        about["adhesive"] = True
    if fields["contact_model"] is not None:
        about["contact_model"] = plain(fields["contact_model"])
    remark = _REMARK.removeprefix("# ") + json.dumps({"cell": fields["cell"].tolist(), **about})
    _write_columns(balls, _list_columns_of_balls(fields), BALLS, [remark])
    _write_columns(contacts, _list_columns_of_contacts(fields), CONTACTS, [])


def _list_columns_of_balls(fields: Mapping[str, Any]) -> dict[str, Array]:
    """Return the columns (n,) of the balls of a network by their names, SI."""
    columns: dict[str, Any] = {}
    if fields["labels"] is not None:
        columns["id"] = fields["labels"]
    columns |= zip(_AXES, fields["positions"].T, strict=True)
    columns |= {"radius": fields["radii"], "mass": fields["masses"], "inertia": fields["inertias"]}
    if fields["kinds"] is not None:
        columns["kind"] = np.array(fields["kinds"])
    return columns


def _list_columns_of_contacts(fields: Mapping[str, Any]) -> dict[str, Array]:
    """Return the columns (n_c,) of the contacts of a network by their names, SI; balls are named by
    their labels.
    """
    labels = fields["labels"]
    columns: dict[str, Any] = {}
    for name in ("i", "j"):
        columns[name] = fields[name] if labels is None else labels[fields[name]]
    columns |= zip(("shift_1", "shift_2", "shift_3"), fields["shift"].T, strict=True)
    columns |= zip(("nx", "ny", "nz"), fields["normal"].T, strict=True)
    for name in _OF_SPRINGS:
        columns[name] = fields[name]
    if fields["tangential_force"] is not None:
        columns |= zip(_TANGENTIAL, fields["tangential_force"].T, strict=True)
    return columns


def _write_columns(
    path: str | os.PathLike[str],
    columns: Mapping[str, Array],
    quantities: Mapping[str, Quantity | None],
    comments: Sequence[str],
) -> None:
    """Write a table of columns (rows,) in SI, with a digest."""
    require_path(path)
    headings = []
    for name in columns:
        kind = quantities[name]
        headings.append(Heading(name, "" if kind is None else kind.unit))
    rows = zip(*(column.tolist() for column in columns.values()), strict=True)
    lines = table_text(headings, rows, comments).split("\n")[:-1]
    write_text(path, seal(lines, 1))
