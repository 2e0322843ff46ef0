"""Tables of balls and of contacts: read from CSV files or arrays, and written as CSV files."""

from __future__ import annotations

import json
import math
import os
import re
import sys
from collections.abc import Iterator, Mapping, Sequence
from contextlib import suppress
from dataclasses import replace
from itertools import chain
from typing import Any

import numpy as np

from granphon.balls.contact_model import ContactModel
from granphon.balls.motions import ALL, allowed_motions
from granphon.balls.on_site import find_quantity, name_springs
from granphon.base.arrays import Array, Flags, Index
from granphon.base.errors import (
    InputError,
    UnverifiedFileWarning,
    brief,
    message,
    warn_caller,
)
from granphon.base.quantities import LENGTH, LOADS, STIFFNESS, TURN_STIFFNESS, Quantity
from granphon.base.results import plain, restore
from granphon.base.staging import write_texts
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
from granphon.networks.building import Source
from granphon.networks.sources import (
    MOST_BYTES,
    Balls,
    Contacts,
    find_rounding,
    read_whole_numbers,
    require_balls,
    require_readable_labels,
)

#: quantities of columns whose numbers have any sign, and of forces that press
_PLACE = replace(LENGTH, least="any")
_FORCE = replace(LOADS["force"], least="zero or above")
_SIGNED_FORCE = replace(_FORCE, least="any")
_SIGNED_TORQUE = replace(TURN_STIFFNESS, least="any")
#: columns of springs to the ground, by the names of these
_ON_SITE = {name: f"on_site_{name}" for name in name_springs(ALL)}
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
    **{column: find_quantity(name) for name, column in _ON_SITE.items()},
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
    "normal_stiffness": STIFFNESS,
    "shear_stiffness": STIFFNESS,
    "torsion_stiffness": TURN_STIFFNESS,
    "bending_stiffness": TURN_STIFFNESS,
    "arm_i": _PLACE,
    "arm_j": _PLACE,
    "tangential_x": _SIGNED_FORCE,
    "tangential_y": _SIGNED_FORCE,
    "tangential_z": _SIGNED_FORCE,
    "torque_x": _SIGNED_TORQUE,
    "torque_y": _SIGNED_TORQUE,
    "torque_z": _SIGNED_TORQUE,
    "force_x": _SIGNED_FORCE,
    "force_y": _SIGNED_FORCE,
    "force_z": _SIGNED_FORCE,
    "overlap": _PLACE,
}
_AXES = ("x", "y", "z")
_SHIFT = ("shift_1", "shift_2", "shift_3")
_TANGENTIAL_FORCE = tuple(f"tangential_{axis}" for axis in _AXES)
_TORQUE = tuple(f"torque_{axis}" for axis in _AXES)
_FORCE_VECTOR = tuple(f"force_{axis}" for axis in _AXES)
_COLUMNS_OF_SPRINGS = tuple(
    name for name in CONTACTS if name.endswith(("force", "stiffness")) or name.startswith("arm")
)
#: columns that may hold "inf": those of a body that does not move
_COLUMNS_WITH_INFINITY = ("radius", "diameter", "mass", "inertia")
#: most columns of a table whose names are compared with known names, as the comparison is slow:
#: tables of programs have some tens
_MOST_NAMES = 1000
#: rows of a table whose cells are in memory at one time
_MOST_ROWS = 100_000
#: ends of the names of files that hold a frame of extended XYZ
_FRAME_SUFFIXES = (".extxyz", ".xyz")
#: begins the line of a written table that holds the fields of the whole network
_REMARK_PREFIX = "# granphon network: "


class _Columns:
    """The columns of a table of balls or contacts, in SI units, from a file or from arrays.

    Attributes
    ----------
    name : the table in messages.
    remark : the fields of the whole network, by name, that a table written by granphon has; empty
        for another table.
    sealed : whether the file has a digest, which then fits; None for arrays.
    lines : (rows,) the lines of the rows in a file; None for arrays.
    kinds : (rows,) the names in the column "kind"; None without that column.
    note : a sentence that names the columns that are not read; "" if all are read.
    """

    def __init__(
        self,
        subject: str,
        source: Any,
        known: Mapping[str, Quantity | None],
        columns: Mapping[str, str],
    ) -> None:
        """Read the table ``source``, the path of a file or arrays by name.

        ``subject`` is "balls" or "contacts". ``known`` has the quantities of the columns that are
        read, by name, None for numbers without a unit and for words; ``columns`` has the headings
        of columns that go by other names. InputError for a file that cannot be read, contacts in
        place of balls, a heading in ``columns`` that the table lacks, a name that seems misspelled,
        wrong units or cells, and columns of different lengths. Warns of a file without a digest
        that may be cut.
        """
        self.remark: dict[str, Any] = {}
        self.sealed: bool | None = None
        self.lines: Index | None = None
        self._arrays: dict[str, Any] = {}
        tables: Iterator[Table] = iter(())  # the pieces of a file, which is read piece by piece
        if isinstance(source, str | os.PathLike):
            self.name = str(source)
            tables = self._open_file(source, known)
            first_table = next(tables)
            tables = chain([first_table], tables)
            first_names: Table | list[str] = first_table
            names = [heading.name for heading in first_table.headings]
            self._headings = [str(heading) for heading in first_table.headings]
        else:
            self.name = f"the table of {subject}"
            self._arrays = self._read_arrays(source)
            names = list(self._arrays)
            first_names = names
            self._headings = names
        keys = [Heading.parse(name).key for name in names]
        require_balls(self.name, keys, known)
        self._require_headings(first_names, columns)
        self._require_spelling(names, keys, known, columns)
        self.note = self._note_columns(names, keys, known, columns)
        self._values: dict[str, Array] = {}
        self._units: dict[str, str] = {}
        self.kinds: tuple[str, ...] | None = None
        self._read_tables(tables, known, columns)
        for name, quantity in known.items():
            heading = columns.get(name, name)
            if heading in self._arrays and name == "kind":
                self._read_kinds(heading)
            elif heading in self._arrays:
                self._values[name] = self._read_array(name, heading, quantity)
        self._require_one_length()

    def _require_headings(self, names: Table | Sequence[str], columns: Mapping[str, str]) -> None:
        """Raise InputError unless all headings in ``columns`` are among the ``names`` of the table,
        or stand in its first piece.
        """
        for name, heading in columns.items():
            if heading not in names:
                fault = f"{self.name} has no column {heading!r}, which columns gives for {name!r}"
                listed = list_names(self._headings)
                raise InputError(f"{fault}; its columns are {listed}", mend="Mend the heading")

    def _require_one_length(self) -> None:
        """Raise InputError, which tells the length of each column, unless all have the same."""
        sizes = {name: len(values) for name, values in self._values.items()}
        if self.kinds is not None:
            sizes["kind"] = len(self.kinds)
        if len(set(sizes.values())) > 1:
            listed = ", ".join(f"{size} of {name}" for name, size in sizes.items())
            raise InputError(f"{self.name} has columns of different lengths: {listed}")

    def _open_file(
        self, path: str | os.PathLike[str], known: Mapping[str, Quantity | None]
    ) -> Iterator[Table]:
        """Return the pieces of the table in the file at ``path``, and set ``remark`` and
        ``sealed``; ``known`` are the quantities of columns by name. InputError for a file that
        cannot be read, or whose digest does not fit; warns if a CSV file without a digest has no
        line break at its end.
        """
        if _is_frame(path):
            from granphon.networks.extxyz import read_frame  # not needed for CSV

            self.remark, self.sealed, tables = read_frame(path, known, MOST_BYTES, _MOST_ROWS)
            return tables
        raw = read_bytes(path, MOST_BYTES)
        text = decode(self.name, raw).replace("\r\n", "\n")
        _text, self.sealed = open_seal(self.name, text)
        if not self.sealed and not text.endswith(("\n", "\r")):
            fault = f"the last line of {self.name} has no line break at its end"
            why = "The file may be cut there"
            warn_caller(
                message(fault, why, "End it with one if it is whole"), UnverifiedFileWarning
            )
        remark = re.search(f"^{re.escape(_REMARK_PREFIX)}.*$", text, re.MULTILINE)
        if remark:
            self.remark = self._read_remark(remark[0])
        return Table.parse_parts(self.name, raw, _MOST_ROWS)

    def _read_tables(
        self,
        tables: Iterator[Table],
        known: Mapping[str, Quantity | None],
        columns: Mapping[str, str],
    ) -> None:
        """Read the ``tables``, which are the pieces of a file one behind the other, and set the
        columns, their units, ``lines`` and ``kinds``. For arrays there are no pieces, and nothing
        is read. ``known`` and ``columns`` are those of :meth:`__init__`.
        """
        arrays_of_columns: dict[str, list[Any]] = {}
        lines = list[Index]()
        kinds = list[str]()
        for table in tables:
            lines.append(np.array(table.lines, np.intp))
            for name, quantity in known.items():
                heading = columns.get(name, name)
                if heading not in table:
                    continue
                if name == "kind":  # the only column of words, which may look like numbers
                    key = Heading.parse(heading).key
                    kinds += map(sys.intern, table.columns[table.keys.index(key)])
                    self.kinds = ()
                else:
                    # a table without rows is refused as cut, unless its digest says it is whole
                    is_empty = self.sealed and not table.lines
                    cells = np.zeros(0)
                    if not is_empty:
                        cells = _read_cells(table, name, heading, quantity)
                    arrays_of_columns.setdefault(name, []).append(cells)
                    self._units[name] = table.unit(heading)
        if lines:
            self.lines = np.concatenate(lines)
        if self.kinds is not None:
            self.kinds = tuple(kinds)
        self._values = {name: np.concatenate(arrays) for name, arrays in arrays_of_columns.items()}

    def _read_remark(self, line: str) -> dict[str, Any]:
        """Return the fields of the whole network in the ``line`` of a written table; InputError if
        the line has been damaged.
        """
        remark: Any = None
        with suppress(ValueError, RecursionError):
            remark = json.loads(line.removeprefix(_REMARK_PREFIX))
        if not isinstance(remark, dict):
            problem = f"{self.name}: the line {brief(line)} cannot be read"
            raise InputError(problem, mend="Leave it out")
        return remark

    def _read_arrays(self, source: Any) -> dict[str, Any]:
        """Return the columns of a mapping, a structured array or a data frame, by their names;
        InputError for anything else.
        """
        names = getattr(getattr(source, "dtype", None), "names", None)
        is_mapping = hasattr(source, "keys") and hasattr(source, "__getitem__")
        if names is None and not is_mapping:
            mend = (
                "Give the path of a file, a mapping of arrays, a structured array or a data frame"
            )
            raise InputError(f"{self.name} is {brief(source)}", mend=mend)
        keys = source.keys() if names is None else names
        return {str(name): source[name] for name in keys}

    def _require_spelling(
        self,
        names: Sequence[str],
        keys: Sequence[str],
        known: Mapping[str, Quantity | None],
        columns: Mapping[str, str],
    ) -> None:
        """Raise :class:`InputError` for a column whose name is nearly that of a known column which
        is missing: it is probably misspelled, and would not be read.

        ``names`` are those of the columns of the table, ``keys`` the same names as they are
        compared, without units; ``known`` and ``columns`` are those of :meth:`__init__`.
        """
        requested_keys = {Heading.parse(columns.get(name, name)).key for name in known}
        missing_names = [name for name in known if Heading.parse(name).key not in keys]
        if not missing_names:
            return
        for name, key in zip(names[:_MOST_NAMES], keys[:_MOST_NAMES], strict=True):
            is_expected = key in requested_keys or key in known
            if is_expected or len(key) <= 2:  # one or two letters are near to any name
                continue
            # the names of springs are long, and like those of other vectors
            options = known if "site" in key else set(known) - set(_ON_SITE.values())
            guess = closest(key, options)
            if guess in missing_names:
                problem = f"{self.name} has a column {brief(str(name))}"
                raise InputError(problem, mend=f"Did you mean {guess!r}?")

    def _note_columns(
        self,
        names: Sequence[str],
        keys: Sequence[str],
        known: Mapping[str, Quantity | None],
        columns: Mapping[str, str],
    ) -> str:
        """Return a sentence that names the columns that are not read; "" if all are read. The
        arguments are those of :meth:`_require_spelling`.
        """
        keys_read = {Heading.parse(columns.get(name, name)).key for name in known}
        other_names = [
            str(name) for name, key in zip(names, keys, strict=True) if key not in keys_read
        ]
        if not other_names:
            return ""
        listed = list_names(other_names)
        return (
            f"{self.name}: not read, as they go by no name that is known: {listed}."
            f" columns={{NAME: HEADING}} names one."
        )

    def _read_kinds(self, heading: str) -> None:
        """Set ``kinds`` from the array under a ``heading``; InputError for what is no list of
        names, and a row without a name.
        """
        mend = "Give a list of names"
        try:
            names = np.asanyarray(self._arrays[heading])  # a masked name stays masked: it is None
        except ValueError:  # rows of different lengths
            problem = f"kind of {self.name} is {brief(self._arrays[heading])}"
            raise InputError(problem, mend=mend) from None
        if names.ndim != 1:
            raise InputError(f"kind of {self.name} has the shape {names.shape}", mend=mend)
        for row, name in enumerate(names.tolist()):
            if name is None or name != name:  # nan, which is no number, as data frames have it
                raise InputError(f"kind of {self.name} has no name in row {row}", mend="Give one")
        self.kinds = tuple(map(str, names.tolist()))

    def _read_array(self, name: str, heading: str, quantity: Quantity | None) -> Array:
        """Return the numbers (rows,) of the column ``name``, whose array is called ``heading``, in
        SI units; InputError for a heading with another unit, and for what is no list of numbers.
        """
        unit = Heading.parse(heading).unit
        si_unit = "" if quantity is None else quantity.unit
        if unit and unit != si_unit:
            problem = f"{self.name}: the column {heading!r} is in {unit}, and arrays are in SI"
            raise InputError(problem, mend=f"Convert it, and call it {name!r}")
        values = real_array(f"{name} of {self.name}", self._arrays[heading])
        if values.ndim != 1:
            problem = f"{name} of {self.name} has the shape {values.shape}"
            raise InputError(problem, mend="Give a list of numbers")
        return values

    def __contains__(self, name: str) -> bool:
        """Return whether there is a column of numbers called ``name``."""
        return name in self._values

    def require(self, *names: str) -> None:
        """Raise :class:`InputError` unless there are columns of all these names."""
        missing_names = [name for name in names if name not in self]
        if missing_names:
            fault = f"{self.name} has no column {', '.join(map(repr, missing_names))}"
            mend = f"Name the column that is meant, as in columns={{{missing_names[0]!r}: 'NAME'}}"
            raise InputError(fault, f"Its columns are {list_names(self._headings)}", mend)

    def read(self, name: str) -> Array:
        """Return the numbers (rows,) of a column, in SI units; InputError if there is no such
        column.
        """
        self.require(name)
        return self._values[name]

    def find(self, name: str) -> Array | None:
        """Return the numbers (rows,) of a column, in SI units; None if there is no such column."""
        return self._values.get(name)

    def whole(self, name: str) -> Index:
        """Return the whole numbers (rows,) of a column; InputError, with the line if the table is a
        file, for another number, and if there is no such column.
        """
        values = self.read(name)
        try:
            return read_whole_numbers(name, values)
        except InputError as error:
            place = self.name
            if self.lines is not None:
                row = int(np.argmax(~(values == np.rint(values)) | ~(np.abs(values) < 2.0**53)))
                place = f"{self.name}:{self.lines[row]}"
            raise InputError(f"{place}: {error}") from None

    def vectors(self, *names: str, wide: bool = False) -> Array | None:
        """Return the columns ``names`` side by side, (rows, m), in SI units; None without any of
        them.

        Only names at the end may be lacking: m is the number of those that are present, or, with
        ``wide``, of all names, with zeros in place of the lacking columns. InputError if a name
        before one of the present columns is lacking, and for columns in different units.
        """
        names_present = [name for name in names if name in self]
        if not names_present:
            return None
        self.require(*names[: names.index(names_present[-1]) + 1])
        units = [self._units.get(name, "") for name in names_present]
        if len(set(units)) > 1 and all(units):
            pairs = zip(names_present, units, strict=True)
            shown = ", ".join(f"{name} ({unit})" for name, unit in pairs)
            problem = f"{self.name} has its coordinates in different units: {shown}"
            raise InputError(problem, mend="Use one unit")
        values = np.stack([self.read(name) for name in names_present], axis=1)
        if not wide:
            return values
        n_missing = len(names) - len(names_present)
        return np.pad(values, ((0, 0), (0, n_missing)))

    def rounding(self, *names: str) -> Array:
        """Return the greatest rounding errors of the m columns of balls that are present among
        ``names``, (rows, m), in SI units, see :func:`~granphon.networks.sources.find_rounding`. One
        of these columns at least must be present, and all must have one unit.
        """
        names_present = [name for name in names if name in self]
        quantity = BALLS[names_present[0]]
        unit = self._units.get(names_present[0], "")
        factor = 1.0
        if quantity is not None and unit:
            factor = quantity.factor(unit)
        # the digits are those of the numbers in the unit of the file
        numbers = np.stack([self.read(name) for name in names_present], axis=1) / factor
        return factor * find_rounding(numbers)


def _read_cells(table: Table, name: str, heading: str, quantity: Quantity | None) -> Array:
    """Return the numbers (rows,) of the column ``name``, which the ``table`` calls ``heading``, in
    SI units; bodies that do not move may have "inf". InputError for another unit, and for a cell
    that is no number or out of range.
    """
    if quantity is None:
        unit = table.unit(heading)
        if unit:
            raise InputError(
                f"{table.name}: the column {name!r} has the unit {brief(unit)}, and needs none"
            )
        try:
            return table.numbers(heading)
        except InputError as error:
            raise InputError(f"{table.name}: {error}") from None
    if name not in _COLUMNS_WITH_INFINITY:
        return table.column(heading, quantity)
    keys = [parsed.key for parsed in table.headings]
    index = keys.index(Heading.parse(heading).key)
    cells = table.columns[index]
    is_infinite = np.array([cell.lower() in ("inf", "infinity") for cell in cells], bool)
    if not np.any(is_infinite):
        return table.column(heading, quantity)
    # Table.column refuses infinite numbers: such cells are read as "1", and then set to infinity
    finite_cells = tuple(np.where(is_infinite, "1", cells).tolist())
    columns = (*table.columns[:index], finite_cells, *table.columns[index + 1 :])
    values = replace(table, columns=columns).column(heading, quantity)
    return np.where(is_infinite, math.inf, values)


#: fields of the whole network that the remark of a written table may hold as they are
_WHOLE_FIELDS = (
    "dimension",
    "motions",
    "prestress",
    "left_out",
    "adhesive",
    "tangential_law",
    "slip_levers",
)


def read_tables(
    balls: Any, contacts: Any, columns: Mapping[str, str], cell: Any, pbc: Any
) -> Source:
    """Return the balls and contacts of two tables, in SI units; see ``ContactNetwork.from_table``
    for the arguments, warnings and errors.

    A table of balls that granphon has written has a remark, which gives further fields. The cell is
    that of the remark if no ``cell`` is given. The remark also says which vectors of its own cell
    are periods; this counts if neither ``cell`` nor ``pbc`` is given.
    """
    _require_columns(columns)
    headings_of_balls = {name: columns[name] for name in columns if name in BALLS}
    headings_of_contacts = {name: columns[name] for name in columns if name in CONTACTS}
    table_of_balls = _Columns("balls", balls, BALLS, headings_of_balls)
    remark = table_of_balls.remark
    quantities: Mapping[str, Quantity | None] = CONTACTS
    if remark.get("adhesive") is True:
        quantities = {**CONTACTS, "normal_force": _SIGNED_FORCE}  # of either sign
    table_of_contacts = _Columns("contacts", contacts, quantities, headings_of_contacts)
    is_own = bool(remark or table_of_balls.sealed or table_of_contacts.sealed)
    if is_own:  # granphon gives both of its tables a digest
        for table in (table_of_balls, table_of_contacts):
            if table.sealed is False:
                warn_unverified(table.name)
    if cell is None and "cell" in remark:
        cell = remark["cell"]
        pbc = remark.get("pbc") if pbc is None else pbc
    periods, is_period = _read_cell(cell, pbc)
    options = {name: remark[name] for name in _WHOLE_FIELDS if name in remark}
    if "tangential_law" in remark:  # levers that are the arms are not written
        options.setdefault("slip_levers", "arms")
    if "contact_model" in remark:
        model = restore(remark["contact_model"], ContactModel, table_of_balls.name)
        options["contact_model"] = model
    return Source(
        _read_balls(table_of_balls),
        (_read_contacts(table_of_contacts),),
        periods,
        is_period,
        notes=tuple(filter(None, (table_of_balls.note, table_of_contacts.note))),
        **options,
    )


def _require_columns(columns: Any) -> None:
    """Raise :class:`InputError` unless ``columns`` maps known names to headings."""
    are_texts = isinstance(columns, Mapping) and all(
        isinstance(text, str) for text in (*columns.keys(), *columns.values())
    )
    if not are_texts:
        mend = "Give a mapping of names: {'radius': 'R (mm)'}"
        raise InputError(f"columns are {brief(columns)}", mend=mend)
    all_names = [*BALLS, *CONTACTS]
    for name in columns:
        if name not in all_names:
            guess = closest(name, all_names)
            mend = f"Did you mean {guess!r}?" if guess else "Use " + ", ".join(all_names)
            raise InputError(f"{name!r} is not a column of balls or contacts", mend=mend)


def _read_cell(cell: Any, pbc: Any) -> tuple[Array, Flags]:
    """Return the vectors of the cell (3, 3), m, from lengths (p,) or vectors (p, d), and which of
    them are periods (3,): by default, without ``pbc``, those that are not zero. InputError for
    another shape, and as :func:`_read_pbc`.
    """
    vectors = np.zeros((3, 3))
    is_period = np.zeros(3, bool)
    if cell is not None:
        rows = real_array("cell", cell)
        if rows.ndim == 1 and 1 <= rows.size <= 3:
            rows = np.diag(rows)
        if rows.ndim != 2 or not 1 <= len(rows) <= rows.shape[1] <= 3:
            mend = "Give the lengths of the periods, or their vectors as rows"
            raise InputError(f"the cell has the shape {np.shape(cell)}", mend=mend)
        vectors[: len(rows), : rows.shape[1]] = rows
        is_period[: len(rows)] = np.any(rows != 0.0, axis=1)
    if pbc is not None:
        flags = _read_pbc(pbc, has_cell=cell is not None)
        is_period[: len(flags)] = flags
        is_period[len(flags) :] = False
    return vectors, is_period


def _read_pbc(pbc: Any, has_cell: bool) -> list[bool]:
    """Return whether each of the vectors of the cell, three at most, is a period; InputError for
    other values, and for a period without a cell.
    """
    values = pbc.tolist() if isinstance(pbc, np.ndarray) else pbc
    flags = list[bool]()
    is_list = isinstance(values, list | tuple)
    if is_list:
        flags += [require("pbc", truth, value) for value in values]
    lacks_cell = any(flags) and not has_cell
    if not is_list or len(flags) > 3 or lacks_cell:
        mend = "Give a truth value for each vector of the cell"
        raise InputError(f"pbc is {brief(pbc)}", mend=mend)
    return flags


def _read_balls(columns: _Columns) -> Balls:
    """Return the balls of a table, in SI units; InputError if the table has no places, no sizes, or
    both radii and diameters, for ids that are no whole numbers, and as :meth:`_Columns.vectors`.
    """
    columns.require("x")
    has_diameter = "diameter" in columns
    if "radius" in columns and has_diameter:
        problem = f"{columns.name} has both radius and diameter"
        raise InputError(problem, mend="Leave one of them out")
    if has_diameter:
        radii = 0.5 * columns.read("diameter")
        radius_rounding = 0.5 * columns.rounding("diameter")[:, 0]
    else:
        radii = columns.read("radius")
        radius_rounding = columns.rounding("radius")[:, 0]
    positions = columns.vectors(*_AXES)
    assert positions is not None
    return Balls(
        columns.name,
        positions,
        radii,
        masses=columns.find("mass"),
        inertias=columns.find("inertia"),
        labels=columns.whole("id") if "id" in columns else None,
        rounding=columns.rounding(*_AXES),
        radius_rounding=radius_rounding,
        kinds=columns.kinds,
        on_site={
            name: columns.read(column) for name, column in _ON_SITE.items() if column in columns
        },
        lines=columns.lines,
    )


def _read_contacts(columns: _Columns) -> Contacts:
    """Return the contacts of a table, in SI units; InputError if the table does not name the two
    balls of each contact, for ids and shifts that are no whole numbers, and as
    :meth:`_Columns.vectors`.
    """
    columns.require("i", "j")
    shift: Any = columns.vectors(*_SHIFT, wide=True)
    if shift is not None:
        for name in _SHIFT:
            if name in columns:
                columns.whole(name)  # refuses other numbers, by their line
        shift = shift.astype(np.intp)
    springs: dict[str, Any] = {name: columns.find(name) for name in _COLUMNS_OF_SPRINGS}
    return Contacts(
        columns.name,
        columns.whole("i"),
        columns.whole("j"),
        shift=shift,
        normal=columns.vectors("nx", "ny", "nz", wide=True),
        tangential_force=columns.vectors(*_TANGENTIAL_FORCE, wide=True),
        contact_torque=columns.vectors(*_TORQUE, wide=True),
        force=columns.vectors(*_FORCE_VECTOR, wide=True),
        overlap=columns.find("overlap"),
        lines=columns.lines,
        **springs,
    )


def _is_frame(path: Any) -> bool:
    """Return whether the file at ``path`` holds a frame of extended XYZ, by its name."""
    return str(path).lower().endswith(_FRAME_SUFFIXES)


def write_tables(
    network: Any, balls: str | os.PathLike[str], contacts: str | os.PathLike[str]
) -> None:
    """Write a network as the two files ``balls`` and ``contacts``; see
    :meth:`~granphon.networks.network.ContactNetwork.write_tables`.
    """
    if network.labels is not None:
        require_readable_labels(network.labels)
    fields = vars(network)
    fields_of_whole = _list_fields_of_whole(fields)
    columns_of_balls = _list_columns_of_balls(fields)
    columns_of_contacts = _list_columns_of_contacts(fields)
    for path in (balls, contacts):
        require_path(path)
    if _is_frame(balls):
        from granphon.networks.extxyz import frame_text  # not needed for CSV

        shown = _show_balls(network)
        text_of_balls = frame_text(columns_of_balls | shown, network, fields_of_whole)
    else:
        _require_readable_kinds(network.kinds or ())
        # the text of a table begins each comment with "# "
        remark = _REMARK_PREFIX.removeprefix("# ") + json.dumps(fields_of_whole)
        text_of_balls = _columns_text(columns_of_balls, BALLS, [remark])
    if _is_frame(contacts):
        from granphon.networks.extxyz import frame_text  # not needed for CSV

        shown_contacts = _show_contacts(network)
        text_of_contacts = frame_text(shown_contacts | columns_of_contacts, network, {})
    else:
        text_of_contacts = _columns_text(columns_of_contacts, CONTACTS, [])
    write_texts([(balls, text_of_balls), (contacts, text_of_contacts)])


def _list_fields_of_whole(fields: Mapping[str, Any]) -> dict[str, Any]:
    """Return the fields of the whole network that the remark of a table holds, by name, as plain
    data; ``fields`` are all fields of the network. Levers that are the arms, contacts that do not
    adhere, and a contact model of None are not written.
    """
    fields_of_whole: dict[str, Any] = {"cell": fields["cell"].tolist()}
    for name in ("pbc", "dimension", "motions", "prestress", "left_out", "tangential_law"):
        fields_of_whole[name] = fields[name]
    if fields["slip_levers"] != "arms":
        fields_of_whole["slip_levers"] = fields["slip_levers"]
    if fields["adhesive"]:
        fields_of_whole["adhesive"] = True
    if fields["contact_model"] is not None:
        fields_of_whole["contact_model"] = plain(fields["contact_model"])
    return fields_of_whole


def _require_readable_kinds(kinds: Sequence[str]) -> None:
    """Raise :class:`InputError` for names of ``kinds`` (n,) that a CSV file could not give back:
    spaces at the ends of its cells are not read.
    """
    for name in dict.fromkeys(kinds):
        if name != name.strip():
            why = "Spaces at the ends of a name could not be read again from a CSV file"
            mend = "Give another name, or write a file of extended XYZ"
            raise InputError(f"a kind of the network is called {name!r}", why, mend)


def _show_balls(network: Any) -> dict[str, Array]:
    """Return the columns (n,) of balls for viewers alone: the masses as ASE names them, the sum of
    the normal forces on each ball, N, and whether the ball is a rattler, 1 or 0.
    """
    load = np.zeros(network.n_balls)
    for end in (network.i, network.j):
        np.add.at(load, end, network.normal_force)
    is_rattler = np.isin(np.arange(network.n_balls), network.rattlers)
    return {"masses": network.masses, "load": load, "rattler": is_rattler.astype(int)}


def _show_contacts(network: Any) -> dict[str, Array]:
    """Return the columns (n_c,) of contacts for viewers alone: places, m, and the whole static
    force with which ball i acts on ball j, N.
    """
    normal_force, tangential_force = network.static_forces
    force = normal_force[:, None] * network.normal + tangential_force
    columns = dict(zip(_AXES, network.contact_places.T, strict=True))
    return columns | dict(zip(_FORCE_VECTOR, force.T, strict=True))


def _list_columns_of_balls(fields: Mapping[str, Any]) -> dict[str, Array]:
    """Return the columns (n,) of the balls of a network by their names, SI."""
    columns: dict[str, Any] = {}
    if fields["labels"] is not None:
        columns["id"] = fields["labels"]
    columns |= zip(_AXES, fields["positions"].T, strict=True)
    columns |= {"radius": fields["radii"], "mass": fields["masses"], "inertia": fields["inertias"]}
    if fields["kinds"] is not None:
        columns["kind"] = np.array(fields["kinds"])
    if fields["on_site"] is not None:
        names = name_springs(allowed_motions(fields["dimension"])[fields["motions"]])
        columns |= {
            _ON_SITE[name]: springs
            for name, springs in zip(names, fields["on_site"].T, strict=True)
        }
    return columns


def _list_columns_of_contacts(fields: Mapping[str, Any]) -> dict[str, Array]:
    """Return the columns (n_c,) of the contacts of a network by their names, SI; balls are named by
    their labels.
    """
    labels = fields["labels"]
    columns: dict[str, Any] = {}
    for name in ("i", "j"):
        columns[name] = fields[name] if labels is None else labels[fields[name]]
    columns |= zip(_SHIFT, fields["shift"].T, strict=True)
    columns |= zip(("nx", "ny", "nz"), fields["normal"].T, strict=True)
    for name in _COLUMNS_OF_SPRINGS:
        columns[name] = fields[name]
    if fields["tangential_force"] is not None:
        columns |= zip(_TANGENTIAL_FORCE, fields["tangential_force"].T, strict=True)
    if fields["contact_torque"] is not None:
        columns |= zip(_TORQUE, fields["contact_torque"].T, strict=True)
    return columns


def _columns_text(
    columns: Mapping[str, Array],
    quantities: Mapping[str, Quantity | None],
    comments: Sequence[str],
) -> str:
    """Return the text of a table of ``columns`` (rows,), in SI units, by name, with ``comments`` at
    its head and a digest.
    """
    headings = []
    for name in columns:
        quantity = quantities[name]
        headings.append(Heading(name, "" if quantity is None else quantity.unit))
    rows = zip(*(column.tolist() for column in columns.values()), strict=True)
    lines = table_text(headings, rows, comments).split("\n")[:-1]
    return seal(lines, 1)
