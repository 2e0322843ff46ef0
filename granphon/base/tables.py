"""Tables as text files: the one reader of tables that users give, and the one writer of tables that
granphon makes.

The first line heads the columns by their names and, in brackets, units: ``force (N), velocity
[m/s]``. Columns are parted by tabs if the first line has one outside of quotes, else by semicolons
if it has one there, else by commas. Each row stands on one line. Empty lines and lines that begin
with # are skipped. granphon itself writes commas, numbers with all digits, and in quotes what would
be read otherwise without them: cells that hold a comma, and rows that would begin with #.

Errors may quote the content of a table that the caller has named. Of a table that a scene has named
they quote the content only if it is a table of quantities, with the requested column and a unit for
it: somebody else may have written the scene, and a scene can name any file.
"""

from __future__ import annotations

import csv
import os
import re
import sys
import warnings
from collections.abc import Iterable, Iterator, Sequence
from contextlib import suppress
from dataclasses import dataclass
from functools import cached_property
from io import BytesIO, StringIO, TextIOWrapper
from itertools import islice
from typing import Any, Self, TextIO

import numpy as np
from numpy.typing import NDArray

from granphon.base.errors import InputError, brief, one_line
from granphon.base.quantities import NUMBER, Quantity, is_plain
from granphon.base.text import closest, counted, decode, list_names, read_bytes

#: the advice where a decimal comma is the probable fault
_DECIMAL_ADVICE = "Write decimals with a point"
#: a unit in brackets at the end of a heading: letters, and brackets of its own that are closed
_UNIT_IN_BRACKETS = re.compile(r"[(\[]((?:[^()\[\]]|\([^()\[\]]*\))*)[)\]]\Z")
#: the most characters of a cell that a message quotes
_MOST_QUOTED_CHARACTERS = 40
#: number of rows that are written at a time, and in quotes if one of them needs quotes
_WRITTEN_ROWS = 1000
#: longest cell that csv reads, in characters
_LONGEST_CELL = csv.field_size_limit()


@dataclass(frozen=True)
class Heading:
    """The heading of a column: its ``name`` and its ``unit``, which is empty if none is given."""

    name: str
    unit: str

    @classmethod
    def parse(cls, text: str) -> Self:
        """Read the heading ``name``, ``name (unit)`` or ``name [unit]``, or a name that ends with
        its unit, as ``total_per_Hz`` of dos.csv. A unit may have brackets of its own, as m/(N s).
        Any other text is a name without a unit.
        """
        title = text.strip()
        in_brackets = _UNIT_IN_BRACKETS.search(title)
        if in_brackets is not None:
            return cls(title[: in_brackets.start()].rstrip(), in_brackets[1].strip())
        if title.endswith("_per_Hz"):
            return cls(title, "1/Hz")
        return cls(title, "Hz" if title.endswith("_Hz") else "")

    @property
    def of_error(self) -> Heading:
        """The heading of the standard errors of the column: "force_error (N)"."""
        return Heading(f"{self.name}_error", self.unit)

    def __str__(self) -> str:
        """Return the heading as granphon writes it in a file, "force (N)"."""
        return f"{self.name} ({self.unit})" if self.unit else self.name

    @property
    def key(self) -> str:
        """The name in the form in which names are compared: lower case, with words joined by
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
        """Return the table of a file in UTF-8.

        ``quoted`` says whether errors may quote the content of the file, whatever that is; False
        for a file that a scene has named. Raises :class:`~granphon.base.errors.InputError`, which
        names file and line, for a file that cannot be read as a table.
        """
        return cls.parse(str(path), read_bytes(path), quoted)

    @classmethod
    def parse(cls, name: str, raw: bytes, quoted: bool = True) -> Self:
        """Return the table in the bytes ``raw`` of a file called ``name``; errors and ``quoted`` as
        for :meth:`read`.
        """
        return next(cls.parse_parts(name, raw, sys.maxsize, quoted))

    @classmethod
    def parse_parts(
        cls, name: str, raw: bytes, most_rows: int, quoted: bool = True
    ) -> Iterator[Self]:
        """Yield the table in the bytes ``raw`` in parts of ``most_rows`` rows, one or more, all
        under the same headings, so that the cells of a large table are never all in memory; a table
        without rows is one part. The other arguments and the errors are those of :meth:`parse`.
        """
        lines = _list_lines(name, raw)
        head_number, head = next(lines, (0, ""))
        if not head:
            raise InputError(
                f"{name} is empty", mend="Give each column a heading, with numbers below it"
            )
        separator = _find_separator(head)
        headings = _read_headings(f"{name}:{head_number}", head, separator, quoted)
        is_first = True
        rows = list(islice(lines, most_rows))
        while rows or is_first:
            columns = _split_evenly([text for _, text in rows], separator, len(headings))
            if columns is None:
                columns = _split_columns(name, rows, separator, len(headings))
            yield cls(name, headings, tuple(number for number, _ in rows), columns, quoted)
            is_first = False
            rows = list(islice(lines, most_rows))

    def __contains__(self, name: str) -> bool:
        """Whether there is a column called ``name``, which may carry a unit."""
        return self._find_columns(name) != []

    def column(
        self, name: str, kind: Quantity, mend: str = "Name the column that is meant"
    ) -> NDArray[np.float64]:
        """Return the numbers of the column called ``name``, (rows,), converted to the SI unit of
        their ``kind``.

        ``name`` may carry a unit, ``"v (km/s)"``, which then replaces that of the heading. Names
        are compared by :attr:`Heading.key`: case does not matter. ``mend`` is the advice of the
        message if the column is not found. Raises
        :class:`~granphon.base.errors.InputError` if there is no such column or more than one, if
        the column has no unit or one of another kind, if there are no rows, or if the kind does not
        allow the text of a cell.
        """
        requested = Heading.parse(name)
        index = self._require_column(name, kind, mend)
        if not self.lines:
            raise InputError(
                f"{self.name} has no rows below its headings", mend="Write numbers there"
            )
        heading = self.headings[index]
        unit = requested.unit or heading.unit
        if not unit:
            raise InputError(
                f"{self.name}: the column {heading.name!r} has no unit",
                mend=f"Write the heading '{heading.name} ({kind.unit})', or with the unit that is"
                " meant",
            )
        # the unit that counts here is the file's own: a scene may have made up the requested one,
        # to have any file quoted
        may_quote = self.quoted or kind.measures(heading.unit)
        # where errors may quote, _read_cells refuses such a unit with the first cell
        if not may_quote and not kind.measures(unit):
            raise InputError(
                f"{self.name}: the column {requested.name!r} has a unit that is not a unit of"
                f" {kind.name}",
                mend=f"Write the heading '{requested.name} ({kind.unit})', or with another unit of"
                " this kind",
            )
        values = kind.read_many(self.columns[index], unit)
        if values is None:  # one by one all texts are read, and the error names the first bad cell
            values = self._read_cells(index, kind, unit, may_quote)
        return values

    def _require_column(self, name: str, kind: Quantity, mend: str) -> int:
        """Return the index of the column called ``name``, which may carry a unit; InputError, with
        the advice ``mend``, if there is no such column, or more than one.
        """
        indices = self._find_columns(name)
        if len(indices) == 1:
            return indices[0]
        requested = Heading.parse(name)
        names = [heading.name for heading in self.headings]
        guess = closest(requested.name, names)
        advice = f"Did you mean {guess!r}? {mend}" if guess and not indices else mend
        obligation = f"must be headed '{requested.name} ({kind.unit})'"
        if self.quoted:
            why = f"Its columns are {list_names(map(repr, names))}"
        elif len(names) == 1:
            why = f"It has one column, which {obligation}"
        else:
            why = f"It has {len(names)} columns, of which one {obligation}"
        raise InputError(
            f"{self.name} has {_count_columns(len(indices))} named {requested.name!r}", why, advice
        )

    def _read_cells(
        self, index: int, kind: Quantity, unit: str, may_quote: bool
    ) -> NDArray[np.float64]:
        """Return the numbers of the column of an ``index``, (rows,), SI, read one by one;
        InputError names the line of the first bad cell, and quotes the cell if it ``may_quote``.
        """
        values = []
        for line, cell in zip(self.lines, self.columns[index], strict=True):
            where = f"{self.name}:{line}: {self.headings[index].name}"
            if not re.fullmatch(NUMBER, cell):
                if not cell:
                    content = "found nothing"
                elif may_quote:
                    content = f"found {cell[:_MOST_QUOTED_CHARACTERS]!r}"
                else:
                    content = "found a text"
                mend = _mend_comma(cell)
                raise InputError(f"{where}: {content}, where a number is needed", mend=mend)
            try:
                values.append(kind.read(f"{cell} {unit}"))
            except ValueError as refused:
                raise InputError(f"{where}: {refused}") from None
        return np.array(values)

    def numbers(self, name: str) -> NDArray[np.float64]:
        """Return the numbers of the column called ``name``, (rows,), in the unit of its heading,
        whatever unit ``name`` carries; nan and inf are taken.

        Raises KeyError if there is no such column, :class:`~granphon.base.errors.InputError` if
        there are more than one, or if a cell is not a number. The error does not name the file, as
        callers do.
        """
        indices = self._find_columns(name)
        if not indices:
            raise KeyError(name)
        if len(indices) > 1:
            raise InputError(
                f"{_count_columns(len(indices))} are headed {Heading.parse(name).name!r}",
                mend="Give each column a heading of its own",
            )
        cells = self.columns[indices[0]]
        convert = float if is_plain(cells) else plain_float
        values: list[float] = []
        try:
            values.extend(map(convert, cells))
        except ValueError:
            # the numbers before the bad cell are in the list
            bad_row = len(values)
            cell = brief(cells[bad_row], _MOST_QUOTED_CHARACTERS)
            raise InputError(
                f"line {self.lines[bad_row]}, {name}: found {cell}, where a number is needed",
                mend=_mend_comma(cells[bad_row]),
            ) from None
        return np.array(values)

    def list_errors(self) -> dict[str, NDArray[np.float64]]:
        """Return the columns (rows,) of standard errors, "peak_error (Hz)" or "total_error_per_Hz",
        by the names of what they are the errors of, "peak" and "total"; nan is taken. Of columns
        "peak_error" and "peak_error_per_Hz" in one table the later one is returned.

        Raises :class:`~granphon.base.errors.InputError` as :meth:`numbers` does.
        """
        matches = [re.fullmatch(r"(.+)_error(_per_Hz)?", head.name) for head in self.headings]
        return {match[1]: self.numbers(match[0]) for match in matches if match}

    def unit(self, name: str) -> str:
        """Return the unit of the column called ``name``: the unit in ``name`` if there is one, else
        that of the first heading of that name. The unit is empty if there is no such heading, or if
        the heading has none.
        """
        requested_unit = Heading.parse(name).unit
        indices = self._find_columns(name)
        if requested_unit or not indices:
            return requested_unit
        return self.headings[indices[0]].unit

    @cached_property
    def keys(self) -> tuple[str, ...]:
        """The names of the columns in the form in which they are compared."""
        return tuple(heading.key for heading in self.headings)

    def _find_columns(self, name: str) -> list[int]:
        """Return the indices of the columns called ``name``, which may carry a unit."""
        requested_key = Heading.parse(name).key
        return [index for index, key in enumerate(self.keys) if key == requested_key]


def _count_columns(number: int) -> str:
    """Return the ``number`` of columns of one name, none or more than one, in words."""
    return {0: "no column", 2: "two columns"}.get(number, f"{number} columns")


def _mend_comma(cell: str) -> str:
    """Return the advice for a cell that is no number, empty unless that is due to a comma."""
    return _DECIMAL_ADVICE if re.fullmatch(NUMBER, cell.replace(",", ".", 1)) else ""


def plain_float(cell: str) -> float:
    """Return the number in a cell, nan and inf too; ValueError for a text that is no number, also
    for those that Python alone takes for numbers: 1_0, digits of other scripts.
    """
    if "_" in cell or not cell.isascii():
        raise ValueError(cell)
    return float(cell)


def read_rows(
    name: str,
    body: bytes,
    places: Sequence[int],
    columns: Sequence[str],
    count: int,
    first_line: int,
) -> NDArray[np.float64]:
    """Return the numbers (count, m) of rows whose cells are parted by white space; nan and inf are
    taken.

    ``body`` is text in UTF-8 of ``count`` lines, the first of which is line ``first_line`` of the
    file called ``name``; ``places`` (m,) are the indices of the cells of a line that are read, and
    ``columns`` (m,) name these cells. Raises :class:`~granphon.base.errors.InputError`, which names
    the line, for a cell that is no number, and for one that is missing, or whose line is.
    """
    if not count or not places:
        return np.empty((count, len(places)))
    # the line of a bad cell is found below
    with suppress(ValueError), warnings.catch_warnings():
        warnings.simplefilter("ignore", UserWarning)  # of a body of empty lines alone
        # parsed by NumPy's compiled reader, which skips empty lines
        rows = np.loadtxt(BytesIO(body), usecols=places, comments=None, ndmin=2, encoding="utf-8")
        if len(rows) == count:
            return rows
    numbers = np.empty((count, len(places)))
    lines = body.splitlines()
    for row in range(count):
        cells = [cell.decode() for cell in lines[row].split()] if row < len(lines) else []
        for column, place in enumerate(places):
            try:
                numbers[row, column] = plain_float(cells[place])
            except (IndexError, ValueError):
                content = (
                    brief(cells[place], _MOST_QUOTED_CHARACTERS)
                    if place < len(cells)
                    else "nothing"
                )
                where = f"{name}:{first_line + row}: {columns[column]}"
                raise InputError(f"{where}: found {content}, where a number is needed") from None
    return numbers


def write_table(
    stream: TextIO,
    headings: Iterable[Heading | str],
    rows: Iterable[Sequence[Any]],
    comments: Iterable[str] = (),
) -> None:
    """Write a table, the headings and then the rows, into an open text file; ``comments`` stand
    below the headings, each on a line that begins with #.

    :class:`Table` reads back what is written, but for the spaces around cells, if no cell holds a
    line feed, a carriage return or a null character.
    """
    writer = csv.writer(stream, lineterminator="\n")
    quoting_writer = csv.writer(stream, lineterminator="\n", quoting=csv.QUOTE_ALL)
    titles = [str(heading) for heading in headings]
    head_needs_quotes = _would_be_skipped([titles]) or _find_separator(",".join(titles)) != ","
    (quoting_writer if head_needs_quotes else writer).writerow(titles)
    stream.writelines(f"# {one_line(comment)}\n" for comment in comments)
    remaining_rows = iter(rows)
    while some_rows := list(islice(remaining_rows, _WRITTEN_ROWS)):
        needs_quotes = _would_be_skipped(some_rows)
        (quoting_writer if needs_quotes else writer).writerows(some_rows)


def _would_be_skipped(rows: Sequence[Sequence[Any]]) -> bool:
    """Whether :class:`Table` would skip one of the ``rows`` if its first cell had no quotes: as a
    comment, or as an empty line if its only cell is blank.
    """
    for row in rows:
        if not row or not isinstance(row[0], str):
            continue
        first_text = row[0].lstrip()
        is_blank = len(row) == 1 and not first_text
        if is_blank or first_text.startswith("#"):
            return True
    return False


def table_text(
    headings: Iterable[Heading | str], rows: Iterable[Sequence[Any]], comments: Iterable[str] = ()
) -> str:
    """Return the text of a table, as :func:`write_table` writes it."""
    stream = StringIO(newline="")
    write_table(stream, headings, rows, comments)
    return stream.getvalue()


def _list_lines(name: str, raw: bytes) -> Iterator[tuple[int, str]]:
    """Yield number, counted from 1, and text of each line that is not empty and no comment;
    InputError for bytes that are no text.
    """
    decode(name, raw)  # raises the error; the text itself is decoded line by line
    stream = TextIOWrapper(BytesIO(raw), encoding="utf-8-sig")
    for number, line in enumerate(stream, 1):
        if line.strip()[:1] not in ("", "#"):
            yield number, line.rstrip("\n")


def _find_separator(head: str) -> str:
    """Return the character that parts the columns of a table, from its first line ``head``: a tab
    if one stands there outside of quotes, else a semicolon if one does, else a comma.
    """
    without_quoted = re.sub('"[^"]*"', "", head)
    for separator in ("\t", ";"):
        if separator in without_quoted:
            return separator
    return ","


def _read_headings(where: str, head: str, separator: str, may_quote: bool) -> tuple[Heading, ...]:
    """Return the headings in the first line ``head`` of a table; InputError, which names the place
    ``where``, if the line cannot be split at the ``separator``, or if a heading is a number, which
    the message shows if it ``may_quote`` the file.
    """
    headings = tuple(Heading.parse(title) for title in _split_cells(where, head, separator))
    numbers = [heading.name for heading in headings if re.fullmatch(NUMBER, heading.name)]
    if numbers:
        content = f"the number {numbers[0]}" if may_quote else "a number"
        raise InputError(
            f"{where}: found {content} where the columns are headed",
            mend="Give each column a heading, such as 'force (N), velocity (m/s)'",
        )
    return headings


def _split_evenly(
    lines: list[str], separator: str, count: int
) -> tuple[tuple[str, ...], ...] | None:
    """Return ``count`` columns of cells, one cell for each line, split from all lines at once at
    the ``separator``, which is fast; None if a line has quotes, or another number of cells, or is
    so long that a cell may be too long.
    """
    joined = separator.join(lines)
    if '"' in joined:
        return None
    for line in lines:
        if line.count(separator) != count - 1 or len(line) >= _LONGEST_CELL:
            return None
    cells = joined.split(separator) if lines else []  # row by row
    return tuple(tuple(map(str.strip, cells[column::count])) for column in range(count))


def _split_columns(
    name: str, lines: list[tuple[int, str]], separator: str, count: int
) -> tuple[tuple[str, ...], ...]:
    """Return ``count`` columns of cells, split line by line at the ``separator``; ``lines`` are
    pairs of the number and the text of a line.

    A line with fewer cells is filled up with empty ones, and of a line with more cells empty ones
    are dropped; InputError names the file ``name`` and the line where a cell beyond is not empty.
    """
    rows = []
    for number, text in lines:
        cells = _split_cells(f"{name}:{number}", text, separator)
        has_cells_without_heading = any(cells[count:])
        if has_cells_without_heading:
            problem = (
                f"{name}:{number}: found {counted(len(cells), 'cell')} below"
                f" {counted(count, 'heading')}"
            )
            raise InputError(
                problem, mend=f"{_DECIMAL_ADVICE}, and separate all columns by the same character"
            )
        n_missing = max(count - len(cells), 0)
        rows.append((*cells[:count], *[""] * n_missing))
    if not rows:
        return tuple(() for _ in range(count))
    return tuple(zip(*rows, strict=True))


def _split_cells(where: str, line: str, separator: str) -> tuple[str, ...]:
    """Return the cells of a line, parted by the ``separator``, without spaces around them;
    InputError, which names the place ``where``, for a cell that is too long for csv, or whose
    quotes are not closed on the line.
    """
    if '"' not in line and len(line) < _LONGEST_CELL:
        # str.split gives the same cells as csv, at a tenth of the cost
        return tuple(map(str.strip, line.split(separator)))
    # csv asks for the second line if the quotes of a cell are still open at the end of the first
    reader = csv.reader([line, ""], delimiter=separator, skipinitialspace=True)
    try:
        cells = next(reader)
    except csv.Error as error:
        raise InputError(f"{where} cannot be split into columns", str(error)) from None
    if reader.line_num > 1:
        raise InputError(
            f"{where}: the quotes of a cell are not closed on its line",
            mend="Write each row on one line",
        )
    return tuple(cell.strip() for cell in cells)
