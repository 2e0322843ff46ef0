"""Dumps of LAMMPS: one of atoms and one of pairs that touch, at the same time step."""

from __future__ import annotations

import os
import re
import warnings
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from granphon.base.arrays import Array, Index
from granphon.base.errors import InputError, StoppedEarlyWarning, brief, message
from granphon.base.scales import Units
from granphon.base.tables import plain_float
from granphon.base.text import decode, list_names, read_bytes
from granphon.base.validation import choice, not_negative, positive, require, whole_number
from granphon.networks.building import (
    MOST_BYTES,
    Balls,
    Contacts,
    Source,
    find_rounding,
    read_whole_numbers,
)

#: length (m), mass (kg) and force (N) that are one in LAMMPS' styles of units
_STYLES = {
    "si": (1.0, 1.0, 1.0), "cgs": (1e-2, 1e-3, 1e-5), "micro": (1e-6, 1e-15, 1e-9),
    "nano": (1e-9, 1e-21, 1e-12),
}  # fmt: skip
#: greatest relative difference of boxes that are one: the dumps may be written with few digits
_SAME_BOX = 1e-5
_NAMES = ("i", "j", "force", "dx", "dy", "dz", "tx", "ty", "tz")
_IS_DUMP = "Is this a dump of LAMMPS, of style custom or local, as text?"
_WRITE_ATOMS = "Write it with: dump 1 all custom 1000 atoms.dump id x y z radius mass"
_NAME_PAIRS = (
    "Name them in LAMMPS, dump_modify 2 colname 1 i colname 2 j, or here: columns=['i', 'j',"
    " 'force', ...]"
)


@dataclass
class _Frame:
    """One time step of a dump, in the units of the dump: its number, the cell, the names of the
    columns, and the rows with their line numbers.
    """

    name: str
    step: int
    units: str = ""
    origin: Array = field(default_factory=lambda: np.zeros(3))
    cell: Array = field(default_factory=lambda: np.zeros((3, 3)))
    pbc: Array = field(default_factory=lambda: np.zeros(3, bool))
    names: tuple[str, ...] = ()
    rows: list[tuple[int, str]] = field(default_factory=list)

    def read(self, column: str) -> Array:
        """Return the numbers of a column, (rows,); InputError names the line of a cell that is no
        number.
        """
        index = self.names.index(column)
        numbers = np.empty(len(self.rows))
        for row, (line, text) in enumerate(self.rows):
            cells = text.split()
            try:
                numbers[row] = plain_float(cells[index])
            except (IndexError, ValueError):
                content = brief(cells[index], 40) if len(cells) > index else "nothing"
                raise InputError(
                    f"{self.name}:{line}: {column}: found {content}, where a number is needed"
                ) from None
        return numbers

    def find_vectors(self, *columns: str) -> Array | None:
        """The vectors (rows, 3) of three columns, or None without one of the columns."""
        if not {*columns} <= {*self.names}:
            return None
        return np.stack([self.read(column) for column in columns], axis=1)


def read_dumps(
    dump: str | os.PathLike[str],
    pairs: str | os.PathLike[str],
    units: str | Units | None,
    columns: Sequence[str] | None,
    step: int | None,
    normal_stiffness: float | None,
    shear_stiffness: float | None,
) -> Source:
    """Return the balls and contacts of two dumps of one time step and one box, in SI units; see
    ``ContactNetwork.from_lammps`` for the arguments and errors.
    """
    step = None if step is None else whole_number("step", step, 0)
    atoms = _read_frame(dump, step, "ATOMS")
    touching = _read_frame(pairs, step, "ENTRIES")
    if atoms.step != touching.step:
        fault = f"{dump} ends at the time step {atoms.step}, and {pairs} at {touching.step}"
        why = "Balls and contacts must be of one step"
        raise InputError(fault, why, "Give the step that both have")
    has_same_cell = np.allclose(atoms.cell, touching.cell, rtol=_SAME_BOX)
    if not has_same_cell or np.any(atoms.pbc != touching.pbc):
        fault = f"{dump} and {pairs} have different boxes"
        raise InputError(fault, mend="Are they of one simulation?")
    scales = _find_units(units, atoms, touching)
    if columns is not None:
        touching.names = _read_names(columns, touching)
    contacts = _read_contacts(touching, scales, normal_stiffness, shear_stiffness)
    balls = _read_balls(atoms, scales)
    length, _, _ = scales
    return Source(balls, contacts, length * atoms.cell, np.asarray(atoms.pbc, bool))


def _read_contacts(
    pairs: _Frame,
    scales: tuple[float, float, float],
    normal_stiffness: float | None,
    shear_stiffness: float | None,
) -> Contacts:
    """Return the contacts of a dump of pairs, in SI units; ``scales`` are those of
    :func:`_find_units`, and the stiffnesses, N/m, those of each contact, if they are given.
    InputError without ids, and for stiffnesses out of range.
    """
    length, _mass, force = scales
    lacking = [name for name in ("i", "j") if name not in pairs.names]
    if lacking:
        fault = f"{pairs.name} has no column {' and no column '.join(lacking)}"
        raise InputError(fault, f"Its columns are {list_names(pairs.names)}", _NAME_PAIRS)
    i = _read_ids(pairs, "i")
    j = _read_ids(pairs, "j")
    # LAMMPS writes the vector from j to i, and the force on i: both are turned below
    vector = pairs.find_vectors("dx", "dy", "dz")
    tangential_force = pairs.find_vectors("tx", "ty", "tz")
    normal_force = force * pairs.read("force") if "force" in pairs.names else None
    n_contacts = len(pairs.rows)
    normal_springs = None
    if normal_stiffness is not None:
        number = positive("normal_stiffness", normal_stiffness, "N/m")
        normal_springs = np.full(n_contacts, number)
    shear_springs = None
    if shear_stiffness is not None:
        number = not_negative("shear_stiffness", shear_stiffness, "N/m")
        shear_springs = np.full(n_contacts, number)
    return Contacts(
        pairs.name,
        i,
        j,
        vector=None if vector is None else -length * vector,
        tangential_force=None if tangential_force is None else -force * tangential_force,
        normal_force=normal_force,
        normal_stiffness=normal_springs,
        shear_stiffness=shear_springs,
    )


def _read_balls(atoms: _Frame, scales: tuple[float, float, float]) -> Balls:
    """Return the balls of a dump of atoms, in SI units; ``scales`` are those of
    :func:`_find_units`. InputError without places, ids or sizes.
    """
    length, mass, _force = scales
    positions, rounding = _read_positions(atoms)
    lacking = list[str]()
    if "id" not in atoms.names:
        lacking.append("id")
    if "radius" not in atoms.names and "diameter" not in atoms.names:
        lacking.append("radius")
    if lacking:
        listed = f"Its columns are {list_names(atoms.names)}"
        raise InputError(f"{atoms.name} has no column {lacking[0]}", listed, _WRITE_ATOMS)
    radii = atoms.read("radius") if "radius" in atoms.names else 0.5 * atoms.read("diameter")
    masses = mass * atoms.read("mass") if "mass" in atoms.names else None
    kinds = _read_kinds(atoms)
    return Balls(
        atoms.name,
        length * (positions + atoms.origin),
        length * radii,
        masses,
        labels=_read_ids(atoms, "id"),
        rounding=length * rounding,
        radius_rounding=length * find_rounding(radii),
        kinds=kinds if len(set(kinds)) > 1 else None,
    )


def _find_units(
    units: str | Units | None, atoms: _Frame, touching: _Frame
) -> tuple[float, float, float]:
    """Return the length, m, mass, kg, and force, N, that are one in the files: those of the
    ``units``, or, if these are None, of the style that the files name, by default SI.

    InputError for an unknown style, for files of different styles, and for a style other than that
    of the files; :class:`~granphon.base.scales.Units` belong to the style "lj".
    """
    styles_of_files = {frame.units for frame in (atoms, touching) if frame.units}
    if len(styles_of_files) > 1:
        fault = f"{atoms.name} is in units {atoms.units}, and {touching.name} in others"
        raise InputError(fault, mend="Write both with the same units")
    if isinstance(units, Units):
        style = "lj"
        scales = (units.length, units.mass, units.force)
    else:
        requested = next(iter(styles_of_files), "si") if units is None else units
        style = require("units", lambda value: choice(value, [*_STYLES]), requested)
        scales = _STYLES[style]
    if styles_of_files and styles_of_files != {style}:
        raise InputError(
            f"{atoms.name} says that its units are {styles_of_files.pop()},"
            f" and units={style!r} is given",
            mend="Leave units out",
        )
    return scales


def _read_names(columns: Any, touching: _Frame) -> tuple[str, ...]:
    """Return the names of the columns of pairs from ``columns``, a list or a text of words;
    InputError unless there is one name for each column of the dump.
    """
    words: object = columns.split() if isinstance(columns, str) else columns
    names = tuple(words) if isinstance(words, Sequence) else ()
    are_texts = all(isinstance(name, str) for name in names)
    if are_texts and len(names) == len(touching.names):
        return names
    shown = f"{touching.name} has {len(touching.names)}: {list_names(touching.names)}"
    mend = f"Give a name for each; those that count are {', '.join(_NAMES)}"
    raise InputError(f"columns are {brief(columns)}, and {shown}", mend=mend)


def _read_positions(atoms: _Frame) -> tuple[Array, Array]:
    """Return the positions (n, 3) of balls from the origin of the box, and their greatest errors by
    rounding, (n, 3), in units of the dump; InputError without any of the columns.
    """
    # columns with "s" are fractions of the box, and those with "u" go on beyond its faces
    for suffix, is_scaled in (("", False), ("u", False), ("s", True), ("su", True)):
        names = [f"{axis}{suffix}" for axis in "xyz"]
        coordinates = atoms.find_vectors(*names)
        if coordinates is not None:
            rounding = find_rounding(coordinates)
            if is_scaled:
                return coordinates @ atoms.cell, rounding @ np.abs(atoms.cell)
            return coordinates - atoms.origin, rounding
    listed = f"Its columns are {list_names(atoms.names)}"
    raise InputError(f"{atoms.name} has no columns x, y and z", listed, _WRITE_ATOMS)


def _read_kinds(atoms: _Frame) -> tuple[str, ...]:
    """Return the elements of balls, or else their types, a name for each ball; none without such a
    column.
    """
    for name in ("element", "type"):
        if name in atoms.names:
            index = atoms.names.index(name)
            rows = [text.split() for _line, text in atoms.rows]
            return tuple(cells[index] for cells in rows if len(cells) > index)
    return ()


def _read_ids(frame: _Frame, column: str) -> Index:
    """Return the whole numbers (rows,) of a column; InputError names the dump."""
    try:
        return read_whole_numbers(column, frame.read(column))
    except InputError as error:
        text = str(error)
        if frame.name not in text:
            text = f"{frame.name}: {text}"
        raise InputError(text) from None


# -- the format ------------------------------------------------------------------------------------


def _read_frame(path: str | os.PathLike[str], step: int | None, kind: str) -> _Frame:
    """Return the frame at the time ``step``, or the last frame for None, of a dump whose lists are
    of the ``kind`` "ATOMS" or "ENTRIES"; of several with one time step the last. InputError if
    there is no such frame.

    A program that is killed leaves its last frame cut: an earlier frame that is requested is read,
    with a warning; without a requested step an error names the last one that can be read.
    """
    chosen: _Frame | None = None
    steps = list[int]()
    try:
        for frame in _split_frames(str(path), read_bytes(path, MOST_BYTES), kind):
            steps.append(frame.step)
            if step is None or frame.step == step:
                chosen = frame
    except InputError as error:
        if not steps:
            raise
        if step is None or chosen is None:
            why = f"The last time step that can be read is {steps[-1]}"
            raise InputError(str(error), why, f"Give step={steps[-1]}") from None
        fault = f"{path} is read at the time step {step}, and cannot be read to its end: {error}"
        warnings.warn(message(fault), StoppedEarlyWarning, stacklevel=4)
    if chosen is None:
        why = f"It has {_describe_steps(sorted({*steps}))}"
        raise InputError(f"{path} has no time step {brief(step)}", why)
    return chosen


def _describe_steps(steps: list[int]) -> str:
    """Return ascending time steps in words."""
    if not steps:
        return "none"
    if len(steps) == 1:
        return f"{steps[0]} alone"
    return f"{steps[0]} to {steps[-1]}, {len(steps)} in all"


def _split_frames(name: str, raw: bytes, kind: str) -> Iterator[_Frame]:
    """Yield the frames of the dump ``name``, whose lists are of the ``kind`` "ATOMS" or "ENTRIES",
    from its bytes; InputError where the dump cannot be read, when the frames before have been
    yielded.

    Units hold until a frame says others; the number of rows and the box are those of one frame.
    """
    lines = _Lines.of(name, raw)
    units = ""
    frame: _Frame | None = None
    n_rows = -1  # of the frame; not known yet
    is_open = False  # whether the list of the frame has not been read yet
    while not lines.at_end:
        title = lines.read_title()
        if title is None:
            continue
        words = title.split()
        if title == "UNITS":
            units = lines.read_text()
        elif title == "TIMESTEP":
            frame = _Frame(name, lines.read_count(), units)
            n_rows = -1
            is_open = True
        elif title.startswith("NUMBER OF"):
            n_rows = lines.read_count()
        elif title.startswith("BOX BOUNDS") and frame is not None:
            words_of_box = title.removeprefix("BOX BOUNDS").split()
            _read_box(frame, words_of_box, lines.texts, lines.place)
            lines.place += 3
        elif words[:1] in (["ATOMS"], ["ENTRIES"]) and frame is not None:
            _require_kind(name, words[0], kind)
            lines.read_rows(frame, words[1:], n_rows, kind)
            is_open = False
            yield frame
        else:  # the line below another title, such as TIME, plays no part
            lines.place += 1
    if frame is None:
        raise InputError(f"{name} has no time step", mend=_IS_DUMP)
    if is_open:
        fault = f"{name} ends before the {kind.lower()} of its time step {frame.step}"
        raise InputError(fault, "The file is not whole")
    if lines.is_broken:
        lines.refuse_cut(frame)


def _require_kind(name: str, found: str, kind: str) -> None:
    """Raise :class:`InputError` if a dump has a list of another kind than needed."""
    if found != kind:
        required = "atoms (dump custom)" if kind == "ATOMS" else "pairs (dump local)"
        raise InputError(f"{name} is a dump of {found.lower()}, and a dump of {required} is needed")


@dataclass
class _Lines:
    """The lines of a dump, read one after the other.

    LAMMPS ends each line with a line break: a file that ends without one, or with a row of too few
    cells, is cut there.

    Attributes
    ----------
    name : the dump in messages.
    texts : the lines, without empty ones at the end.
    is_broken : whether the last line has no line break at its end.
    place : index of the line that is read next.
    """

    name: str
    texts: list[str]
    is_broken: bool
    place: int = 0

    @classmethod
    def of(cls, name: str, raw: bytes) -> _Lines:
        """Return the lines of the dump ``name`` from its bytes."""
        text = decode(name, raw)
        lines = text.splitlines()
        while lines and not lines[-1].strip():
            lines.pop()
        has_last_break = text.rstrip(" \t").endswith(("\n", "\r"))
        return cls(name, lines, is_broken=not has_last_break)

    @property
    def at_end(self) -> bool:
        """Whether all lines have been read."""
        return self.place >= len(self.texts)

    def read_title(self) -> str | None:
        """Read a line "ITEM: ..." and return what follows the word; None for an empty line, and
        InputError for another one.
        """
        line = self.texts[self.place].strip()
        if not line:
            self.place += 1
            return None
        if not line.startswith("ITEM:"):
            raise InputError(
                f"{self.name}:{self.place + 1}: found {brief(line, 40)}, where a line 'ITEM: ...'"
                f" is needed",
                mend=_IS_DUMP,
            )
        self.place += 1
        return line.removeprefix("ITEM:").strip()

    def read_text(self) -> str:
        """Read a line; "" at the end of the file."""
        text = "" if self.at_end else self.texts[self.place].strip()
        self.place += 1
        return text

    def read_count(self) -> int:
        """Read a line that holds a whole number."""
        count = _read_count(self.name, self.texts, self.place)
        self.place += 1
        return count

    def read_rows(self, frame: _Frame, columns: list[str], count: int, kind: str) -> None:
        """Put the names of ``columns`` and the next ``count`` rows into a ``frame``; ``count`` is
        -1 if the file has not said how many there are.

        InputError, in which ``kind`` names the rows, for a count that is not known, a file that
        ends before, or in the last row, and a name of a column that LAMMPS does not write.
        """
        n_below = len(self.texts) - self.place
        if count < 0:
            fault = f"{self.name}:{self.place}: the number of {kind.lower()} is not given before"
            raise InputError(fault, mend=_IS_DUMP)
        if count > n_below:
            fault = f"{self.name} ends before its {count} {kind.lower()} do: {n_below} are there"
            raise InputError(fault, "The file is not whole")
        for column in columns:
            if not column.isascii() or not column.isprintable():
                fault = f"{self.name}:{self.place}: found a column named {brief(column, 40)}"
                why = "The names of LAMMPS are of plain letters, digits and signs"
                raise InputError(fault, why)
        frame.names = tuple(columns)
        rows = self.texts[self.place : self.place + count]
        frame.rows = list(enumerate(rows, self.place + 1))
        self.place += count
        if self.at_end:
            self.refuse_cut(frame)

    def refuse_cut(self, frame: _Frame) -> None:
        """Raise :class:`InputError` if the last line is broken, or is the last row of the last
        ``frame`` with too few cells.
        """
        last_line = len(self.texts)
        where = f"{self.name}:{last_line}"
        if frame.rows:
            line_of_row, row = frame.rows[-1]
            n_cells = len(row.split())
            n_needed = len(frame.names)
            if len(frame.rows) > 1:
                # rows may be shorter than their heading, but not than the first of them
                _line, first_row = frame.rows[0]
                n_needed = min(len(first_row.split()), n_needed)
            if line_of_row == last_line and n_cells < n_needed:
                fault = f"{where}: the last row has {n_cells} cells, and {n_needed} are needed"
                raise InputError(fault, "The file is not whole")
        if self.is_broken:
            why = "The file is not whole: its last number may have lost digits"
            raise InputError(f"{where}: the last line has no line break at its end", why)


def _read_count(name: str, lines: list[str], n: int) -> int:
    """Return the whole number in line ``n`` of the dump ``name``, counted from 0."""
    text = lines[n].strip() if n < len(lines) else ""
    # 64 bits hold no number of more digits
    if not re.fullmatch("[0-9]{1,19}", text):
        limit = " of at most 19 digits" if len(text) > 19 else ""
        raise InputError(
            f"{name}:{n + 1}: found {brief(text, 40)}, where a whole number{limit} is needed"
        )
    return int(text)


def _read_box(frame: _Frame, words: list[str], lines: list[str], n: int) -> None:
    """Read the three lines of a box from line ``n`` on, counted from 0, into a frame: orthogonal or
    tilted, as the ``words`` of its heading say. Without boundary conditions nothing repeats.

    InputError for three general vectors, for lines that are no bounds, and for a length of zero or
    below.
    """
    if words[:1] == ["abc"]:
        fault = f"{frame.name} has a box of three general vectors"
        why = "LAMMPS lists pairs in another frame, in which its box is tilted"
        raise InputError(fault, why, "Leave out dump_modify triclinic/general")
    # the boundary conditions at the two faces across each axis: periodic, fixed or shrinking
    boundaries = [word for word in words if len(word) == 2 and set(word) <= set("pfsm")]
    is_tilted = words[:3] == ["xy", "xz", "yz"]
    try:
        rows = [[plain_float(cell) for cell in lines[n + axis].split()] for axis in range(3)]
        bounds = np.array(rows)
        frame.origin, frame.cell = _tilt_box(bounds) if is_tilted else _make_box(bounds)
        if boundaries:
            frame.pbc = np.array([boundary == "pp" for boundary in boundaries])
        if frame.pbc.shape != (3,) or not np.all(np.isfinite(frame.cell)):
            raise ValueError
    except (IndexError, ValueError):
        raise InputError(f"{frame.name}:{n + 1}: the bounds of the box cannot be read") from None
    lengths = np.diag(frame.cell)
    if not np.all(lengths > 0.0):
        axis = int(np.argmin(lengths > 0.0))
        fault = (
            f"{frame.name}:{n + axis + 1}: the box has the length {lengths[axis]:g} along"
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
