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
        """The numbers of a column, (rows,)."""
        index = self.names.index(column)
        numbers = np.empty(len(self.rows))
        for n, (line, text) in enumerate(self.rows):
            cells = text.split()
            try:
                numbers[n] = plain_float(cells[index])
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
    """Return the balls and contacts of two dumps; see ``ContactNetwork.from_lammps`` for the
    arguments.
    """
    step = None if step is None else whole_number("step", step, 0)
    atoms = _read_frame(dump, step, "ATOMS")
    touching = _read_frame(pairs, step, "ENTRIES")
    if atoms.step != touching.step:
        fault = f"{dump} ends at the time step {atoms.step}, and {pairs} at {touching.step}"
        raise InputError(
            fault, "Balls and contacts must be of one step", "Give the step that both have"
        )
    if not np.allclose(atoms.cell, touching.cell, rtol=1e-5) or np.any(atoms.pbc != touching.pbc):
        raise InputError(
            f"{dump} and {pairs} have different boxes", mend="Are they of one simulation?"
        )
    length, mass, force = _find_units(units, atoms, touching)
    if columns is not None:
        touching.names = _read_names(columns, touching)
    lacking = [name for name in ("i", "j") if name not in touching.names]
    if lacking:
        fault = f"{pairs} has no column {' and no column '.join(lacking)}"
        raise InputError(fault, f"Its columns are {list_names(touching.names)}", _NAME_PAIRS)
    i = _read_ids(touching, "i")
    j = _read_ids(touching, "j")
    # LAMMPS writes the vector from j to i, and the force on i
    vector = touching.find_vectors("dx", "dy", "dz")
    tangential = touching.find_vectors("tx", "ty", "tz")
    normal_force = force * touching.read("force") if "force" in touching.names else None
    count = len(touching.rows)
    normal_springs = shear_springs = None
    if normal_stiffness is not None:
        normal_springs = np.full(count, positive("normal_stiffness", normal_stiffness, "N/m"))
    if shear_stiffness is not None:
        shear_springs = np.full(count, not_negative("shear_stiffness", shear_stiffness, "N/m"))
    contacts = Contacts(
        touching.name,
        i,
        j,
        vector=None if vector is None else -length * vector,
        tangential_force=None if tangential is None else -force * tangential,
        normal_force=normal_force,
        normal_stiffness=normal_springs,
        shear_stiffness=shear_springs,
    )
    positions, rounding = _read_positions(atoms)
    for name, alternative in (("id", "id"), ("radius", "diameter")):
        if name not in atoms.names and alternative not in atoms.names:
            listed = f"Its columns are {list_names(atoms.names)}"
            raise InputError(f"{atoms.name} has no column {name}", listed, _WRITE_ATOMS)
    radii = atoms.read("radius") if "radius" in atoms.names else 0.5 * atoms.read("diameter")
    masses = mass * atoms.read("mass") if "mass" in atoms.names else None
    kinds = _read_kinds(atoms)
    balls = Balls(
        atoms.name,
        length * (positions + atoms.origin),
        length * radii,
        masses,
        labels=_read_ids(atoms, "id"),
        rounding=length * rounding,
        radius_rounding=length * find_rounding(radii),
        kinds=kinds if len(set(kinds)) > 1 else None,
    )
    return Source(balls, contacts, length * atoms.cell, np.asarray(atoms.pbc, bool))


def _find_units(
    units: str | Units | None, atoms: _Frame, touching: _Frame
) -> tuple[float, float, float]:
    """Return the length, m, mass, kg, and force, N, that are one in the files."""
    named_units = {frame.units for frame in (atoms, touching) if frame.units}
    if len(named_units) > 1:
        raise InputError(
            f"{atoms.name} is in units {atoms.units}, and {touching.name} in others",
            mend="Write both with the same units",
        )
    if isinstance(units, Units):
        style = "lj"
        scales = (units.length, units.mass, units.force)
    else:
        requested = next(iter(named_units), "si") if units is None else units
        style = require("units", lambda value: choice(value, [*_STYLES]), requested)
        scales = _STYLES[style]
    if named_units and named_units != {style}:
        raise InputError(
            f"{atoms.name} says that its units are {named_units.pop()},"
            f" and units={style!r} is given",
            mend="Leave units out",
        )
    return scales


def _read_names(columns: Any, touching: _Frame) -> tuple[str, ...]:
    """Return the names of the columns of pairs, one for each."""
    listed: object = columns.split() if isinstance(columns, str) else columns
    names = tuple(listed) if isinstance(listed, Sequence) else ()
    if all(isinstance(name, str) for name in names) and len(names) == len(touching.names):
        return names
    shown = f"{touching.name} has {len(touching.names)}: {list_names(touching.names)}"
    mend = f"Give a name for each; those that count are {', '.join(_NAMES)}"
    raise InputError(f"columns are {brief(columns)}, and {shown}", mend=mend)


def _read_positions(atoms: _Frame) -> tuple[Array, Array]:
    """Return the positions (n, 3) of balls from the origin of the box, and their greatest errors by
    rounding, in units of the dump.
    """
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
    """Return the elements of balls, or else their types; none without such a column."""
    for name in ("element", "type"):
        if name in atoms.names:
            index = atoms.names.index(name)
            rows = [text.split() for _, text in atoms.rows]
            return tuple(cells[index] for cells in rows if len(cells) > index)
    return ()


def _read_ids(frame: _Frame, column: str) -> Index:
    try:
        return read_whole_numbers(column, frame.read(column))
    except InputError as error:
        text = str(error)
        raise InputError(text if frame.name in text else f"{frame.name}: {text}") from None


# -- the format ------------------------------------------------------------------------------------


def _read_frame(path: str | os.PathLike[str], step: int | None, kind: str) -> _Frame:
    """Read the frame at a time step, or the last one, of a list of the ``kind`` "ATOMS" or
    "ENTRIES".

    A program that is killed leaves its last frame cut: an earlier frame that is requested is read,
    with a warning.
    """
    last: _Frame | None = None
    steps = list[int]()
    try:
        for frame in _split_frames(str(path), read_bytes(path, MOST_BYTES), kind):
            steps.append(frame.step)
            last = frame if step in (None, frame.step) else last
    except InputError as cut:
        if not steps:
            raise
        if step is None or last is None:
            raise InputError(
                str(cut),
                f"The last time step that can be read is {steps[-1]}",
                f"Give step={steps[-1]}",
            ) from None
        fault = f"{path} is read at the time step {step}, and cannot be read to its end: {cut}"
        warnings.warn(message(fault), StoppedEarlyWarning, stacklevel=4)
    if last is None:
        steps = sorted({*steps})
        shown = "none"
        if len(steps) == 1:
            shown = f"{steps[0]} alone"
        elif steps:
            shown = f"{steps[0]} to {steps[-1]}, {len(steps)} in all"
        raise InputError(f"{path} has no time step {brief(step)}", f"It has {shown}")
    return last


def _split_frames(name: str, raw: bytes, kind: str) -> Iterator[_Frame]:
    """Yield the frames of a dump.

    LAMMPS ends each line with a line break: a file that ends without it, or with a row of too few
    cells, is cut there.
    """
    text = decode(name, raw)
    lines = text.splitlines()
    while lines and not lines[-1].strip():
        lines.pop()
    broken = not text.rstrip(" \t").endswith(("\n", "\r"))
    n = 0
    units = ""
    frame: _Frame | None = None
    count = -1
    begun = False
    while n < len(lines):
        head = lines[n].strip()
        if not head:
            n += 1
            continue
        if not head.startswith("ITEM:"):
            raise InputError(
                f"{name}:{n + 1}: found {brief(head, 40)}, where a line 'ITEM: ...' is needed",
                mend=_IS_DUMP,
            )
        title = head.removeprefix("ITEM:").strip()
        n += 1
        if title == "UNITS":
            units = lines[n].strip() if n < len(lines) else ""
            n = n + 1
        elif title == "TIMESTEP":
            frame = _Frame(name, _read_count(name, lines, n), units)
            n = n + 1
            begun = True
        elif title.startswith("NUMBER OF"):
            count = _read_count(name, lines, n)
            n = n + 1
        elif title.startswith("BOX BOUNDS") and frame is not None:
            _read_box(frame, title.removeprefix("BOX BOUNDS").split(), lines, n)
            n += 3
        elif title.split()[:1] in (["ATOMS"], ["ENTRIES"]) and frame is not None:
            listed, *names = title.split()
            if listed != kind:
                want = "atoms (dump custom)" if kind == "ATOMS" else "pairs (dump local)"
                raise InputError(
                    f"{name} is a dump of {listed.lower()}, and a dump of {want} is needed"
                )
            if count < 0 or n + count > len(lines):
                fault = (
                    f"{name} ends before its {count} {kind.lower()} do: {len(lines) - n} are there"
                )
                raise InputError(fault, "The file is not whole")
            odd = [column for column in names if not (column.isascii() and column.isprintable())]
            if odd:
                fault = f"{name}:{n}: found a column named {brief(odd[0], 40)}"
                raise InputError(
                    fault, "The names of LAMMPS are of plain letters, digits and signs"
                )
            frame.names = tuple(names)
            frame.rows = list(enumerate(lines[n : n + count], n + 1))
            n += count
            if n == len(lines):
                _refuse_cut(frame, lines, broken)
            begun = False
            yield frame
        else:  # such as TIME
            n += 1
    if frame is None:
        raise InputError(f"{name} has no time step", mend=_IS_DUMP)
    if begun:
        raise InputError(
            f"{name} ends before the {kind.lower()} of its time step {frame.step}",
            "The file is not whole",
        )
    if broken:
        _refuse_cut(frame, lines, broken)


def _refuse_cut(frame: _Frame, lines: list[str], broken: bool) -> None:
    """Raise :class:`InputError` if the last line of a dump is ``broken``, or a row of too few
    cells.
    """
    place = f"{frame.name}:{len(lines)}"
    if frame.rows and frame.rows[-1][0] == len(lines):
        first, last = [len(frame.rows[row][1].split()) for row in (0, -1)]
        needed_cells = min(first, len(frame.names)) if frame.rows[1:] else len(frame.names)
        if last < needed_cells:
            raise InputError(
                f"{place}: the last row has {last} cells, and {needed_cells} are needed",
                "The file is not whole",
            )
    if broken:
        why = "The file is not whole: its last number may have lost digits"
        raise InputError(f"{place}: the last line has no line break at its end", why)


def _read_count(name: str, lines: list[str], n: int) -> int:
    text = lines[n].strip() if n < len(lines) else ""
    if not re.fullmatch("[0-9]{1,19}", text):
        most = " of at most 19 digits" if len(text) > 19 else ""
        raise InputError(
            f"{name}:{n + 1}: found {brief(text, 40)}, where a whole number{most} is needed"
        )
    return int(text)


def _read_box(frame: _Frame, words: list[str], lines: list[str], n: int) -> None:
    """Read the three lines of a box below its heading ``words``: orthogonal or tilted."""
    if words[:1] == ["abc"]:
        why = "LAMMPS lists pairs in another frame, in which its box is tilted"
        raise InputError(
            f"{frame.name} has a box of three general vectors",
            why,
            "Leave out dump_modify triclinic/general",
        )
    try:
        rows = np.array(
            [[plain_float(cell) for cell in lines[n + axis].split()] for axis in range(3)]
        )
        flags = [word for word in words if len(word) == 2 and set(word) <= set("pfsm")]
        if words[:3] == ["xy", "xz", "yz"]:
            xy, xz, yz = rows[:, 2]
            low = rows[:, 0] - [min(0.0, xy, xz, xy + xz), min(0.0, yz), 0.0]
            high = rows[:, 1] - [max(0.0, xy, xz, xy + xz), max(0.0, yz), 0.0]
            frame.origin = low
            frame.cell = np.diag(high - low)
            frame.cell[1, 0] = xy
            frame.cell[2, :2] = (xz, yz)
        else:
            frame.origin = rows[:, 0]
            frame.cell = np.diag(rows[:, 1] - rows[:, 0])
        frame.pbc = np.array([flag == "pp" for flag in flags] or [False] * 3)
        if frame.pbc.shape != (3,) or not np.all(np.isfinite(frame.cell)):
            raise ValueError
    except (IndexError, ValueError):
        raise InputError(f"{frame.name}:{n + 1}: the bounds of the box cannot be read") from None
    ends = np.diag(frame.cell)
    if not np.all(ends > 0.0):
        axis = int(np.argmin(ends > 0.0))
        fault = (
            f"{frame.name}:{n + axis + 1}: the box has the length {ends[axis]:g} along"
            f" {'xyz'[axis]}"
        )
        raise InputError(
            fault, "Its lower bound must be below the upper one", "Are the two exchanged?"
        )
