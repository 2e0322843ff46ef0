"""Dumps of LAMMPS and LIGGGHTS, as text or YAML, also packed: files of frames, each of which has a
time step, a box, and a list of rows with named columns, of atoms or of local entries such as pairs.

Files of MercuryDPM are read as frames, too. Rows stay bytes until their numbers are needed.
"""

from __future__ import annotations

import os
import re
import sys
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from functools import cached_property
from typing import Any, ClassVar, Self, TypeVar

import numpy as np

from granphon.base.arrays import Array, Flags, Index
from granphon.base.errors import InputError, StoppedEarlyWarning, brief, message, warn_caller
from granphon.base.packed import unpack
from granphon.base.tables import read_rows
from granphon.base.text import decode, read_bytes
from granphon.networks.sources import MOST_BYTES

_ADVICE_ON_FORMAT = "Is this a dump of style custom, local or yaml?"
_REASON_OF_CUT = "The file is not whole"
#: what parts the cells of a row of YAML, "  - [ 1 , 0.5, ]": the dash becomes the first cell
_BRACKETS_TO_BLANKS = bytes.maketrans(b"[],", b"   ")
#: a file of frames, of one program
OneDump = TypeVar("OneDump", bound="Dump")
#: what follows the units of a dump that granphon has written, and is followed by options of the
#: reader, as " granphon slip_levers=arms"; other programs pass the rest of this line over
OWN_MARK = " granphon"


@dataclass
class Frame:
    """One time step of a dump, in the units of the dump.

    Attributes
    ----------
    name : the dump in messages.
    step : the number of the time step, or the time.
    kind : "atoms" or "entries", what the rows are.
    units : the style of units that the dump names; "" if it names none.
    options : what a dump of granphon's own says of the network, by the options of the reader.
    origin, cell : (3,) a corner of the box, and (3, 3) its vectors as rows.
    pbc : (3,) whether the box is periodic.
    names : the columns.
    lines : the lines of the dump.
    first, count : index of the line of the first row, and the number of rows.
    offset : number of cells of a row before the first column.
    """

    name: str
    step: float
    kind: str = ""
    units: str = ""
    options: dict[str, str] = field(default_factory=dict)
    origin: Array = field(default_factory=lambda: np.zeros(3))
    cell: Array = field(default_factory=lambda: np.zeros((3, 3)))
    pbc: Array = field(default_factory=lambda: np.zeros(3, bool))
    names: tuple[str, ...] = ()
    lines: Lines | None = None
    first: int = 0
    count: int = 0
    offset: int = 0

    def read(self, columns: Sequence[str]) -> dict[str, Array]:
        """Return the numbers (rows,) of each of some ``columns``, by name; InputError names the
        line of a cell that is lacking or no number.
        """
        places = [self.names.index(column) + self.offset for column in columns]
        rows = read_rows(self.name, self._body, places, columns, self.count, self.first + 1)
        return dict(zip(columns, rows.T, strict=True))

    def read_words(self, column: str) -> tuple[str, ...]:
        """Return the words (rows,) of a column; InputError names the line of a row that is too
        short.
        """
        place = self.names.index(column) + self.offset
        words = list[str]()
        for row, line in enumerate(self._body.splitlines()):
            cells = line.split(maxsplit=place + 1)
            if len(cells) <= place:
                where = f"{self.name}:{self.first + 1 + row}: {column}"
                raise InputError(f"{where}: found nothing, where a name is needed")
            words.append(sys.intern(cells[place].decode()))
        return tuple(words)

    def require_full_rows(self, why: str) -> None:
        """Raise :class:`InputError`, which names the line and says ``why``, for a row that has not
        as many cells as there are columns.
        """
        for row, line in enumerate(self._body.splitlines()):
            n_cells = len(line.split())
            if n_cells != len(self.names) + self.offset:
                fault = f"{self.name}:{self.first + 1 + row}: found {n_cells - self.offset} cells"
                raise InputError(f"{fault}, where {len(self.names)} are needed", why)

    @property
    def _body(self) -> bytes:
        """The rows, with cells parted by blanks."""
        assert self.lines is not None
        body = self.lines.take(self.first, self.count)
        return body.translate(_BRACKETS_TO_BLANKS) if self.offset else body


class Dump:
    """A file of frames, all of whose lists are of one kind, "atoms" or "entries".

    Attributes
    ----------
    name : the file in messages.
    frames : the frames that can be read, in the order of the file.
    fault : the error at the place from which on the file cannot be read; None if it is whole.
    """

    #: how messages call what tells frames apart, and the reader's argument for it
    word: ClassVar[str] = "time step"
    argument: ClassVar[str] = "step"
    #: advice for a file without frames
    mend: ClassVar[str] = _ADVICE_ON_FORMAT

    def __init__(self, path: str | os.PathLike[str], kind: str) -> None:
        """Read the frames of the file at ``path``, up to the first that cannot be read; InputError
        if there is none before it.
        """
        self.name = str(path)
        self.frames: list[Frame] = []
        self.fault: InputError | None = None
        try:
            for frame in self.split(open_lines(path), kind):
                self.frames.append(frame)
        except InputError as error:
            if not self.frames:
                raise
            self.fault = error
        if not self.frames:
            raise InputError(f"{self.name} has no {self.word}", mend=self.mend)

    @classmethod
    def open(cls, source: Any, kind: str) -> Self:
        """Return the file ``source``: read from its path, or, if it is open, as it is."""
        return source if isinstance(source, cls) else cls(source, kind)

    def split(self, lines: Lines, kind: str) -> Iterator[Frame]:
        """Yield the frames in the ``lines`` of a file, whose lists are of the ``kind``. InputError
        is raised at the first frame that cannot be read, after the frames before have been yielded.
        """
        yield from _split_frames(lines, kind)

    def is_at(self, frame: Frame, step: float) -> bool:
        """Return whether a frame is of the time ``step``."""
        return frame.step == step

    @cached_property
    def steps(self) -> list[float]:
        """The time steps of the frames, ascending, each once."""
        return sorted({frame.step for frame in self.frames})

    def find(self, step: float | None) -> Frame:
        """Return the frame at the time ``step``, the last one if there are several, or, for None,
        the last frame of the file. InputError if there is no such frame.

        A program that is killed leaves its last frame cut. An earlier frame of such a file is
        returned with a warning; for None there is an InputError that names the last step that can
        be read.
        """
        frames = [frame for frame in self.frames if step is None or self.is_at(frame, step)]
        if self.fault is not None:
            if step is None or not frames:
                last = self.frames[-1].step
                why = f"The last {self.word} that can be read is {last:.15g}"
                raise InputError(str(self.fault), why, f"Give {self.argument}={last:.15g}")
            fault = f"{self.name} is read at the {self.word} {step:.15g}, and cannot be read to its"
            text = message(f"{fault} end: {self.fault}")
            warn_caller(text, StoppedEarlyWarning)
        if not frames:
            why = f"It has {_describe_steps(self.steps)}"
            raise InputError(f"{self.name} has no {self.word} {step:.15g}", why)
        return frames[-1]


def open_series(dump: Any, pairs: Any) -> tuple[list[float], Dump, Dump]:
    """Return the time steps that a dump of atoms and one of pairs both have, ascending, and the two
    dumps, open; warnings and errors are those of :func:`share_steps`.
    """
    return share_steps(Dump.open(dump, "atoms"), Dump.open(pairs, "entries"))


def share_steps(balls: OneDump, contacts: OneDump) -> tuple[list[float], OneDump, OneDump]:
    """Return the time steps, or times, that two open files both have, ascending, and the two files.
    InputError without a common step.

    Warns if a file is cut; its ``fault`` is then removed, so that its frames are found without a
    further warning.
    """
    for file in (balls, contacts):
        if file.fault is not None:
            warn_caller(message(f"the series ends early: {file.fault}"), StoppedEarlyWarning)
            file.fault = None
    steps = [
        step for step in balls.steps if any(balls.is_at(frame, step) for frame in contacts.frames)
    ]
    if not steps:
        fault = f"{balls.name} and {contacts.name} have no {balls.word} in common"
        raise InputError(fault, mend="Write both at the same steps")
    return steps, balls, contacts


def _describe_steps(steps: list[float]) -> str:
    """Return ascending time steps in words: the step, or the first, the last and the number."""
    if len(steps) == 1:
        return f"{steps[0]:.15g} alone"
    return f"{steps[0]:.15g} to {steps[-1]:.15g}, {len(steps)} in all"


class Lines:
    """The lines of a file, which are kept as bytes and are read one after the other.

    Attributes
    ----------
    name : the file in messages.
    place : index of the line that is read next.
    is_packed_whole : false for a packed file whose end is missing.
    is_broken : whether the file ends without a line break: a program ends each line with one, so
        that such a file is cut.
    """

    def __init__(self, name: str, raw: bytes, is_whole: bool) -> None:
        """Split ``raw``, the unpacked bytes of the file ``name``, into lines, without the empty
        lines at its end; ``is_whole`` is false for a packed file whose end is missing. InputError
        if the bytes are no text.
        """
        decode(name, raw)  # raises the error; the text itself is not needed
        raw = raw.removeprefix(b"\xef\xbb\xbf")  # the byte order mark of UTF-8
        if b"\r" in raw:
            raw = raw.replace(b"\r\n", b"\n").replace(b"\r", b"\n")
        self.name = name
        self.is_packed_whole = is_whole
        self.is_broken = not raw.rstrip(b" \t").endswith(b"\n")
        self.place = 0
        self._raw = raw
        breaks = np.flatnonzero(np.frombuffer(raw, np.uint8) == ord("\n"))
        #: index of the byte at which each line begins, and last the end of the last line
        self._starts: Index = np.unique(np.concatenate([[0], breaks + 1, [len(raw)]]))
        while len(self) and not self.take(len(self) - 1, 1).strip():
            self._starts = self._starts[:-1]

    def __len__(self) -> int:
        """Return the number of lines, without empty ones at the end of the file."""
        return len(self._starts) - 1

    @property
    def is_at_end(self) -> bool:
        """Whether all lines have been read."""
        return self.place >= len(self)

    @property
    def where(self) -> str:
        """File and line of the line that was read last."""
        return f"{self.name}:{self.place}"

    def take(self, first: int, count: int) -> bytes:
        """Return ``count`` lines from the index ``first`` on, with their line breaks."""
        return self._raw[self._starts[first] : self._starts[first + count]]

    def begin_with(self, character: str) -> Flags:
        """Return (lines,) whether the first byte of each line is the ASCII ``character``; space
        before it is not skipped.
        """
        first_bytes = np.frombuffer(self._raw, np.uint8)[self._starts[:-1]]
        return np.asarray(first_bytes == ord(character))

    def peek(self) -> str:
        """Return the line that is read next, without the space at its end, without moving on; ""
        at the end of the file.
        """
        return "" if self.is_at_end else self.take(self.place, 1).decode().rstrip()

    def read(self) -> str:
        """Return the next line, without the space around it, and move on to the line after it; ""
        at the end of the file.
        """
        text = self.peek().strip()
        self.place += 1
        return text

    def read_count(self, text: str | None = None) -> int:
        """Return the whole number in ``text``, of the line that was read last, or, for None, in the
        next line, which is read. InputError, with the line, for anything else.
        """
        digits = self.read() if text is None else text
        # 64 bits hold no number of more digits
        if not re.fullmatch("[0-9]{1,19}", digits):
            limit = " of at most 19 digits" if len(digits) > 19 else ""
            fault = (
                f"{self.where}: found {brief(digits, 40)}, where a whole number{limit} is needed"
            )
            raise InputError(fault)
        return int(digits)

    def read_list(self, frame: Frame, columns: Sequence[str], count: int, kind: str) -> None:
        """Make the next ``count`` lines the rows of a ``frame``, with the names ``columns``, and
        move on to the line after them.

        ``count`` is -1 if the file has not said how many rows there are. InputError for this; for a
        list of another ``kind`` than is needed; for a file that ends before the last row does, or
        that is cut there (:meth:`refuse_cut`); for a further row below the last one; and for the
        name of a column with other letters than programs write.
        """
        if frame.kind != kind:
            required = "atoms (dump custom)" if kind == "atoms" else "pairs (dump local)"
            fault = f"{self.name} is a dump of {frame.kind}, and a dump of {required} is needed"
            raise InputError(fault)
        n_below = len(self) - self.place
        if count < 0:
            fault = f"{self.where}: the number of {kind} is not given before"
            raise InputError(fault, mend=_ADVICE_ON_FORMAT)
        if count > n_below:
            fault = f"{self.name} ends before its {count} {kind} do: {n_below} are there"
            raise InputError(fault, _REASON_OF_CUT)
        for column in columns:
            if not column.isascii() or not column.isprintable():
                fault = f"{self.where}: found a column named {brief(column, 40)}"
                why = "The names of programs are of plain letters, digits and signs"
                raise InputError(fault, why)
        frame.names = tuple(columns)
        frame.lines = self
        frame.first = self.place
        frame.count = count
        self.place += count
        if self.is_at_end:
            self.refuse_cut(frame)
        next_line = self.peek()
        n_cells = len(next_line.split())
        if not next_line.startswith("ITEM:") and n_cells >= max(1, len(columns)) + frame.offset:
            fault = f"{self.name}:{self.place + 1}: a row follows the {count} {kind} of the list"
            raise InputError(fault, "The number of rows that the file says is another")

    def refuse_cut(self, frame: Frame) -> None:
        """Raise :class:`InputError` if the file is cut: its end is missing
        (:meth:`require_whole`), or its last line is the last row of the last ``frame`` and has too
        few cells.
        """
        where = f"{self.name}:{len(self)}"
        last_row = frame.first + frame.count
        if frame.count and last_row == len(self):
            n_cells = len(self.take(last_row - 1, 1).split())
            n_needed = len(frame.names) + frame.offset
            if frame.count > 1:
                # rows may be shorter than their heading, but not than the first of them
                n_needed = min(len(self.take(frame.first, 1).split()), n_needed)
            if n_cells < n_needed:
                fault = f"{where}: the last row has {n_cells} cells, and {n_needed} are needed"
                raise InputError(fault, _REASON_OF_CUT)
        self.require_whole()

    def require_whole(self) -> None:
        """Raise :class:`InputError` if the end of the file is missing: its last line break, or the
        end of a packed file.
        """
        where = f"{self.name}:{len(self)}"
        if self.is_broken:
            why = "The file is not whole: its last number may have lost digits"
            raise InputError(f"{where}: the last line has no line break at its end", why)
        if not self.is_packed_whole:
            why = "The file is not whole: what packs it ends before its end"
            raise InputError(f"{where}: the packed file is cut", why)


def open_lines(path: str | os.PathLike[str]) -> Lines:
    """Return the lines of the file at ``path``, which may be packed; InputError if the file cannot
    be read or unpacked, or is no text.
    """
    name = str(path)
    raw, is_whole = unpack(name, read_bytes(path, MOST_BYTES), MOST_BYTES)
    return Lines(name, raw, is_whole)


def _split_frames(lines: Lines, kind: str) -> Iterator[Frame]:
    """Yield the frames of a dump as text or YAML, whose lists are of the ``kind``. InputError is
    raised at the first frame that cannot be read, or is cut, after the frames before have been
    yielded.
    """
    first_word = lines.peek().partition(":")[0]
    split = _split_yaml if first_word in ("---", "creator") else _split_text
    frame = None
    for frame in split(lines, kind):
        if frame.lines is not None:  # its list has been read
            yield frame
    if frame is None:
        return
    # the last frame may be cut
    if frame.lines is None:
        fault = f"{lines.name} ends before the {kind} of its time step {frame.step}"
        raise InputError(fault, _REASON_OF_CUT)
    lines.refuse_cut(frame)


# -- text ------------------------------------------------------------------------------------------


def _split_text(lines: Lines, kind: str) -> Iterator[Frame]:
    """Yield the frames of a dump as text; the last one has no rows if the file ends before its
    list.

    Units hold until a frame says others; the number of rows and the box are those of one frame.
    """
    units = ""
    options: dict[str, str] = {}
    label = ""  # of the list of the frame: ATOMS, ENTRIES, or what dump_modify label says
    n_rows = -1  # of the frame; not known yet
    frame: Frame | None = None  # whose list is not read yet
    while not lines.is_at_end:
        title = _read_title(lines)
        word, *names = title.split() or [""]
        if title == "UNITS":
            units, _own, own_words = lines.read().partition(OWN_MARK)
            options = dict(item.split("=", 1) for item in own_words.split() if "=" in item)
            if frame is not None:
                frame.units = units
                frame.options = options
        elif title == "TIMESTEP":
            frame = Frame(lines.name, lines.read_count(), units=units, options=options)
            label = ""
            n_rows = -1
        elif title.startswith("NUMBER OF"):
            label = title.removeprefix("NUMBER OF").strip()
            n_rows = lines.read_count()
        elif title.startswith("BOX BOUNDS") and frame is not None:
            words = title.removeprefix("BOX BOUNDS").split()
            boundaries, is_tilted = _read_box_words(lines.name, words)
            place = lines.place
            rows = [lines.read().split() for _ in range(3)]
            _set_box(frame, rows, boundaries, is_tilted, place)
        elif frame is not None and word and word in ("ATOMS", "ENTRIES", label):
            frame.kind = "atoms" if word == "ATOMS" else "entries"
            lines.read_list(frame, names, n_rows, kind)
            yield frame
            frame = None
        elif title:  # the line below another title, such as TIME, plays no part
            lines.read()
    if frame is not None:
        yield frame


def _read_title(lines: Lines) -> str:
    """Read a line "ITEM: TITLE" and return the title; "" for an empty line. InputError for a line
    of another form.
    """
    line = lines.read()
    if line and not line.startswith("ITEM:"):
        fault = f"{lines.where}: found {brief(line, 40)}, where a line 'ITEM: ...' is needed"
        raise InputError(fault, mend=_ADVICE_ON_FORMAT)
    return line.removeprefix("ITEM:").strip()


def _read_box_words(name: str, words: list[str]) -> tuple[list[str], bool]:
    """Return the boundary conditions at the two faces across each axis, two letters as "pp", and
    whether the box is tilted, from the ``words`` of the heading of a box. InputError, with the
    ``name`` of the file, for a box of three general vectors.
    """
    if words[:1] == ["abc"]:
        fault = f"{name} has a box of three general vectors"
        why = "LAMMPS lists pairs in another frame, in which its box is tilted"
        raise InputError(fault, why, "Leave out dump_modify triclinic/general")
    # periodic, fixed or shrinking
    boundaries = [word for word in words if len(word) == 2 and set(word) <= set("pfsm")]
    return boundaries, words[:3] == ["xy", "xz", "yz"]


# -- YAML ------------------------------------------------------------------------------------------


def _split_yaml(lines: Lines, kind: str) -> Iterator[Frame]:
    """Yield the frames of a dump of style yaml, whose lines have the form that LAMMPS gives them;
    the last one has no rows if the file ends before its list.

    Units, names of columns and boundary conditions hold until a frame says others; the number of
    rows and the box are those of one frame.
    """
    units = ""
    n_rows = -1
    names: list[str] = []
    boundaries: list[str] = []
    frame: Frame | None = None
    while not lines.is_at_end:
        is_indented = lines.peek().startswith(" ")
        key, colon, value = lines.read().partition(":")
        if is_indented or (not colon and key in ("---", "...", "")):
            continue  # lists of other keys, such as thermo, play no part
        if not colon:
            raise InputError(
                f"{lines.where}: found {brief(key, 40)}, where 'key: value' is needed",
                mend=_ADVICE_ON_FORMAT,
            )
        words = [word.strip().strip("'\"") for word in value.strip(" []").split(",")]
        words = [word for word in words if word]
        if key == "timestep":
            frame = Frame(lines.name, lines.read_count(value.strip()), "atoms", units, offset=1)
            n_rows = -1
        elif key == "units":
            units = value.strip()
            if frame is not None:
                frame.units = units
        elif key == "natoms":
            n_rows = lines.read_count(value.strip())
        elif key == "boundary":
            boundaries = ["".join(pair) for pair in zip(words[::2], words[1::2], strict=False)]
        elif key == "box" and frame is not None:
            _read_yaml_box(lines, frame, boundaries)
        elif key == "keywords":
            names = words
        elif key == "data" and frame is not None:
            lines.read_list(frame, names, n_rows, kind)
            yield frame
            frame = None
    if frame is not None:
        yield frame


def _read_yaml_box(lines: Lines, frame: Frame, boundaries: list[str]) -> None:
    """Read the rows of a box, three of bounds, and a fourth one of tilts if the box is tilted, and
    set the box of the ``frame``; ``boundaries`` and errors are those of :func:`_set_box`.
    """
    place = lines.place
    rows: list[list[str]] = []
    while lines.peek().startswith(" ") and len(rows) < 4:
        rows.append(lines.read().strip("- ").translate(str.maketrans("[],", "   ")).split())
    is_tilted = len(rows) == 4
    if is_tilted:  # the tilts become third cells, as dumps as text have them
        tilts = rows.pop()
        rows = [[*row, *tilts[axis : axis + 1]] for axis, row in enumerate(rows)]
    _set_box(frame, rows, boundaries, is_tilted, place)


# -- the box ---------------------------------------------------------------------------------------


def _set_box(
    frame: Frame, rows: list[list[str]], boundaries: list[str], is_tilted: bool, place: int
) -> None:
    """Set ``origin``, ``cell`` and ``pbc`` of a ``frame`` from the cells of the three ``rows`` of
    its box, which begin at the line of index ``place``: bounds, and tilts if the box
    ``is_tilted``.

    ``boundaries`` has two letters for each axis, which repeats if they are "pp"; without any
    nothing repeats. InputError for cells that are no bounds, and for a length of zero or below.
    """
    try:
        # Python also reads other digits, and digits with "_" between them, as numbers
        if not all(cell.isascii() and "_" not in cell for row in rows for cell in row):
            raise ValueError
        bounds = np.array([[float(cell) for cell in row] for row in rows])
        with np.errstate(all="ignore"):  # vectors that are not finite are refused below
            frame.origin, frame.cell = _tilt_box(bounds) if is_tilted else _make_box(bounds)
        if boundaries:
            frame.pbc = np.array([boundary == "pp" for boundary in boundaries])
        has_three_axes = frame.cell.shape == (3, 3) and frame.pbc.shape == (3,)
        if not has_three_axes or not np.all(np.isfinite(frame.cell)):
            raise ValueError
    except (IndexError, ValueError):
        fault = f"{frame.name}:{place + 1}: the bounds of the box cannot be read"
        raise InputError(fault) from None
    lengths = np.diag(frame.cell)
    if not np.all(lengths > 0.0):
        axis = int(np.argmin(lengths > 0.0))
        fault = (
            f"{frame.name}:{place + axis + 1}: the box has the length {lengths[axis]:g} along"
            f" {'xyz'[axis]}"
        )
        why = "Its lower bound must be below the upper one"
        raise InputError(fault, why, "Are the two exchanged?")


def _make_box(bounds: Array) -> tuple[Array, Array]:
    """Return the origin (3,) and the vectors (3, 3) of an orthogonal box, whose ``bounds`` (3, 2)
    are the lower and the upper ends.
    """
    return bounds[:, 0], np.diag(bounds[:, 1] - bounds[:, 0])


def _tilt_box(bounds: Array) -> tuple[Array, Array]:
    """Return the origin (3,) and the vectors (3, 3) of a tilted box.

    The rows of ``bounds`` (3, 3) are the lower and the upper end, along x, y and z, of the
    orthogonal box around the tilted one, and a tilt: xy, xz and yz.
    """
    xy, xz, yz = bounds[:, 2]
    low = bounds[:, 0] - [min(0.0, xy, xz, xy + xz), min(0.0, yz), 0.0]
    high = bounds[:, 1] - [max(0.0, xy, xz, xy + xz), max(0.0, yz), 0.0]
    cell = np.diag(high - low)
    cell[1, 0] = xy
    cell[2, :2] = (xz, yz)
    return low, cell
