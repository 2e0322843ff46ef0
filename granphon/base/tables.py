"""Tables as text files: the one reader of tables that users give, and the one writer of tables that
granphon makes.

The first line heads the columns by their names and, in brackets, units: ``force (N), velocity
[m/s]``. Columns are parted by tabs if the first line has one, else by semicolons if it has one,
else by commas. Empty lines and lines that begin with # are skipped. granphon itself writes commas,
puts cells that hold a comma in quotes, and writes numbers with all digits.

Errors may quote the content of a table that the caller has named. They quote one that a scene has
named only if it is a table of quantities, with the wanted column and a unit for it: somebody else
may have written the scene, and a scene can name any file.
"""

from __future__ import annotations

import csv
import os
import re
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from functools import cached_property
from io import StringIO
from typing import Any, Self, TextIO

import numpy as np
from numpy.typing import NDArray

from granphon.base.errors import InputError, brief
from granphon.base.quantities import NUMBER, Quantity, is_plain
from granphon.base.text import closest, counted, decode, list_names, read_bytes

_POINT = "Write decimals with a point"
#: longest cell that csv reads, in characters
_LONGEST_CELL = csv.field_size_limit()


@dataclass(frozen=True)
class Heading:
    """The heading of a column: its ``name`` and its ``unit``, which is empty if none is given."""

    name: str
    unit: str

    @classmethod
    def parse(cls, text: str) -> Self:
        """Read ``name``, ``name (unit)``, ``name [unit]``, or one with its unit at the end,
        ``total_per_Hz`` of dos.csv. A unit may have brackets of its own, as m/(N s).
        """
        unit_text = r"(?:[^()\[\]]|\([^()\[\]]*\))*?"
        pattern = rf"(.*?)\s*(?:[(\[]\s*({unit_text})\s*[)\]])?"
        match = re.fullmatch(pattern, text.strip(), re.DOTALL)
        if match is None:
            return cls(text, "")
        name, unit = match.groups()
        if unit is None and name.endswith("_per_Hz"):
            return cls(name, "1/Hz")
        if unit is None and name.endswith("_Hz"):
            return cls(name, "Hz")
        return cls(name, unit or "")

    def __str__(self) -> str:
        return f"{self.name} ({self.unit})" if self.unit else self.name

    @property
    def key(self) -> str:
        """The name in the form in which names are compared: in lower case, words joined by
        underscores.
        """
        return re.sub(r"[\s_-]+", "_", self.name.lower())


@dataclass(frozen=True)
class Table:
    """A table as it stands in a file: cells are texts until :meth:`column` reads them.

    Attributes
    ----------
    name : the name of the file in messages.
    headings : one for each column.
    lines : the line number of each row in the file, counted from 1.
    columns : for each heading the cells below it, one for each row.
    quoted : whether errors may quote the content of the file, whatever that is.
    """

    name: str
    headings: tuple[Heading, ...]
    lines: tuple[int, ...]
    columns: tuple[tuple[str, ...], ...]
    quoted: bool = True

    @classmethod
    def read(cls, path: str | os.PathLike[str], quoted: bool = True) -> Self:
        """Read a file in UTF-8; :class:`~granphon.base.errors.InputError` names file and line of
        what cannot be read.

        ``quoted`` says whether errors may quote the content of the file, whatever that is; False
        for a file that a scene has named.
        """
        return cls.parse(str(path), read_bytes(path), quoted)

    @classmethod
    def parse(cls, name: str, raw: bytes, quoted: bool = True) -> Self:
        """The table in the bytes ``raw`` of a file called ``name``; errors and ``quoted`` as for
        :meth:`read`.
        """
        # the number and the text of each line that counts
        lines = [
            (number, line)
            for number, line in enumerate(decode(name, raw).splitlines(), 1)
            if line.strip()[:1] not in ("", "#")
        ]
        if not lines:
            raise InputError(
                f"{name} is empty", mend="Give each column a heading, with numbers below it"
            )
        number, head = lines.pop(0)
        mark = next((mark for mark in "\t;" if mark in head), ",")
        headings = _read_headings(f"{name}:{number}", head, mark, quoted)
        numbers = tuple(number for number, _ in lines)
        texts = [line for _, line in lines]
        columns = _split_evenly(texts, mark, len(headings))
        if columns is None:
            columns = _split_columns(name, lines, mark, len(headings))
        return cls(name, headings, numbers, columns, quoted)

    def __contains__(self, name: str) -> bool:
        return self._find_places(name) != []

    def column(
        self, name: str, kind: Quantity, mend: str = "Name the column that is meant"
    ) -> NDArray[np.float64]:
        """The numbers of the column called ``name``, (rows,), converted to the SI unit of their
        ``kind``.

        ``name`` may carry a unit, ``"v (km/s)"``, which then replaces that of the heading. Case
        does not matter. ``mend`` is the advice of the message if the column is not found. Raises
        :class:`~granphon.base.errors.InputError` if there is no such column or more than one, if it
        has no unit, if there are no rows, or if a cell is not what the kind allows.
        """
        requested = Heading.parse(name)
        place = self._require_one(name, kind, mend)
        if not self.lines:
            raise InputError(
                f"{self.name} has no rows below its headings", mend="Write numbers there"
            )
        heading = self.headings[place]
        unit = requested.unit or heading.unit
        if not unit:
            mend = (
                f"Write the heading '{heading.name} ({kind.unit})', or with the unit that is meant"
            )
            raise InputError(f"{self.name}: the column {heading.name!r} has no unit", mend=mend)
        quoted = self.quoted or kind.measures(heading.unit)
        if not quoted and not kind.measures(unit):
            problem = (
                f"{self.name}: the column {requested.name!r} has a unit that is not a unit of"
                f" {kind.name}"
            )
            mend = (
                f"Write the heading '{requested.name} ({kind.unit})', or with another unit of this"
                f" kind"
            )
            raise InputError(problem, mend=mend)
        values = kind.read_many(self.columns[place], unit)
        if values is None:  # read one by one, so that the error names the first bad cell
            values = self._read_cells(place, kind, unit, quoted)
        return values

    def _require_one(self, name: str, kind: Quantity, mend: str) -> int:
        """Return the place of the column with a name, which may carry a unit; InputError if there
        is none, or more than one.
        """
        places = self._find_places(name)
        if len(places) == 1:
            return places[0]
        requested = Heading.parse(name)
        names = [heading.name for heading in self.headings]
        guess = closest(requested.name, names)
        if guess and not places:
            mend = f"Did you mean {guess!r}? {mend}"
        headed = f"must be headed '{requested.name} ({kind.unit})'"
        if self.quoted:
            why = f"Its columns are {list_names(map(repr, names))}"
        elif len(names) == 1:
            why = f"It has one column, which {headed}"
        else:
            why = f"It has {len(names)} columns, of which one {headed}"
        count = "two columns" if places else "no column"
        raise InputError(f"{self.name} has {count} named {requested.name!r}", why, mend)

    def _read_cells(
        self, place: int, kind: Quantity, unit: str, quoted: bool
    ) -> NDArray[np.float64]:
        """Return the numbers of the column at a place, (rows,), SI, read one by one; InputError
        names the first bad cell, and quotes the cell if it may be ``quoted``.
        """
        values = []
        for line, cell in zip(self.lines, self.columns[place], strict=True):
            where = f"{self.name}:{line}: {self.headings[place].name}"
            if not re.fullmatch(NUMBER, cell):
                content = f"found {cell[:40]!r}" if quoted else "found a text"
                if not cell:
                    content = "found nothing"
                has_comma = re.fullmatch(NUMBER, cell.replace(",", ".", 1))
                mend = _POINT if has_comma else ""
                raise InputError(f"{where}: {content}, where a number is needed", mend=mend)
            try:
                values.append(kind.read(f"{cell} {unit}"))
            except ValueError as refused:
                raise InputError(f"{where}: {refused}") from None
        return np.array(values)

    def numbers(self, name: str) -> NDArray[np.float64]:
        """The numbers of the column called ``name``, (rows,), in the unit of its heading; nan and
        inf are taken.

        Raises KeyError if there is no such column, :class:`~granphon.base.errors.InputError` if a
        cell is not a number.
        """
        places = self._find_places(name)
        if not places:
            raise KeyError(name)
        cells = self.columns[places[0]]
        convert = float if is_plain(cells) else plain_float
        values: list[float] = []  # after an error it holds what was read before
        try:
            values.extend(map(convert, cells))
        except ValueError:
            line = self.lines[len(values)]
            cell = brief(cells[len(values)], 40)
            raise InputError(
                f"line {line}, {name}: found {cell}, where a number is needed"
            ) from None
        return np.array(values)

    def unit(self, name: str) -> str:
        """The unit of the column called ``name``: that in ``name`` if it carries one, else that of
        the heading.

        Empty if neither has a unit, or there is no such column.
        """
        unit = Heading.parse(name).unit
        places = self._find_places(name)
        if unit or not places:
            return unit
        return self.headings[places[0]].unit

    @cached_property
    def keys(self) -> tuple[str, ...]:
        """The names of the columns in the form in which they are compared."""
        return tuple(heading.key for heading in self.headings)

    def _find_places(self, name: str) -> list[int]:
        """Return the places of the columns with a name, which may carry a unit."""
        key_of_name = Heading.parse(name).key
        return [place for place, key in enumerate(self.keys) if key == key_of_name]


def plain_float(cell: str) -> float:
    """The number in a cell, nan and inf too; ValueError for what only Python takes for one: 1_0,
    digits of other scripts.
    """
    if "_" in cell or not cell.isascii():
        raise ValueError(cell)
    return float(cell)


def write_table(
    stream: TextIO,
    headings: Iterable[Heading | str],
    rows: Iterable[Sequence[Any]],
    comments: Iterable[str] = (),
) -> None:
    """Write a table into an open text file; ``comments`` stand below the headings, each on a line
    that begins with #.
    """
    table = csv.writer(stream, lineterminator="\n")
    table.writerow([str(heading) for heading in headings])
    stream.writelines(f"# {comment}\n" for comment in comments)
    table.writerows(rows)


def table_text(
    headings: Iterable[Heading | str], rows: Iterable[Sequence[Any]], comments: Iterable[str] = ()
) -> str:
    """The text of a table, as :func:`write_table` writes it."""
    stream = StringIO(newline="")
    write_table(stream, headings, rows, comments)
    return stream.getvalue()


def _read_headings(where: str, head: str, mark: str, quoted: bool) -> tuple[Heading, ...]:
    """Return the headings in the first line of a table; InputError if one is a number, which the
    message shows if the line may be ``quoted``.
    """
    headings = tuple(Heading.parse(title) for title in _split_cells(where, head, mark))
    numbers = [heading.name for heading in headings if re.fullmatch(NUMBER, heading.name)]
    if numbers:
        number = f"the number {numbers[0]}" if quoted else "a number"
        raise InputError(
            f"{where}: found {number} where the columns are headed",
            mend="Give each column a heading, such as 'force (N), velocity (m/s)'",
        )
    return headings


def _split_evenly(texts: list[str], mark: str, count: int) -> tuple[tuple[str, ...], ...] | None:
    """Return ``count`` columns of cells, split from all lines at once; None if lines have quotes,
    other numbers of cells, or may be too long.
    """
    joined = mark.join(texts)
    if '"' in joined:
        return None
    if any(text.count(mark) != count - 1 or len(text) >= _LONGEST_CELL for text in texts):
        return None
    cells = joined.split(mark) if texts else []
    return tuple(tuple(map(str.strip, cells[place::count])) for place in range(count))


def _split_columns(
    name: str, lines: list[tuple[int, str]], mark: str, count: int
) -> tuple[tuple[str, ...], ...]:
    """Return ``count`` columns of cells, split line by line; InputError names the line that has too
    many. ``lines`` are pairs of a number and a text.

    A short line is filled with empty cells; of a long one, only empty cells are dropped.
    """
    rows = []
    for number, text in lines:
        row = _split_cells(f"{name}:{number}", text, mark)
        if any(row[count:]):
            problem = (
                f"{name}:{number}: found {counted(len(row), 'cell')} below"
                f" {counted(count, 'heading')}"
            )
            raise InputError(
                problem, mend=f"{_POINT}, and separate all columns by the same character"
            )
        rows.append(row[:count] + ("",) * (count - len(row)))
    return tuple(zip(*rows, strict=True)) or ((),) * count


def _split_cells(where: str, line: str, mark: str) -> tuple[str, ...]:
    """Return the cells of a line, without spaces around them; InputError for wrong quotes."""
    if '"' not in line and len(line) < _LONGEST_CELL:
        # gives the same cells as csv, at a tenth of the cost
        return tuple(map(str.strip, line.split(mark)))
    try:
        cells = next(csv.reader([line], delimiter=mark, skipinitialspace=True))
    except csv.Error as error:
        raise InputError(f"{where} cannot be split into columns", str(error)) from None
    return tuple(cell.strip() for cell in cells)
