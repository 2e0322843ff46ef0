"""Dumps of LAMMPS: one of atoms and one of pairs that touch, at the same time step."""

from __future__ import annotations

import math
import os
import re
import warnings
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, field

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
    """One time step of a dump, in its own units: where it stands, its cell, the names of its
    columns, and the columns.
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
        place = self.names.index(column)
        out = np.empty(len(self.rows))
        for n, (line, text) in enumerate(self.rows):
            cells = text.split()
            try:
                out[n] = plain_float(cells[place])
            except (IndexError, ValueError):
                found = brief(cells[place], 40) if len(cells) > place else "nothing"
                raise InputError(
                    f"{self.name}:{line}: {column}: found {found}, where a number is needed"
                ) from None
        return out


def read_dumps(
    dump: str | os.PathLike[str],
    pairs: str | os.PathLike[str],
    units: str | Units | None,
    columns: Sequence[str] | None,
    step: int | None,
    normal_stiffness: float | None,
    shear_stiffness: float | None,
) -> Source:
    """Return what two dumps say of balls and contacts; see ``ContactNetwork.from_lammps`` for the
    arguments.
    """
    step = None if step is None else whole_number("step", step, 0)
    atoms = _read_frame(dump, step, "ATOMS")
    touching = _read_frame(pairs, step, "ENTRIES")
    if atoms.step != touching.step:
        what = f"{dump} ends at the time step {atoms.step}, and {pairs} at {touching.step}"
        raise InputError(
            what, "Balls and contacts must be of one step", "Give the step that both have"
        )
    if not np.allclose(atoms.cell, touching.cell, rtol=1e-5) or np.any(atoms.pbc != touching.pbc):
        raise InputError(
            f"{dump} and {pairs} have different boxes", mend="Are they of one simulation?"
        )
    # length, mass and force that are one in the files
    told = {frame.units for frame in (atoms, touching) if frame.units}
    if len(told) > 1:
        mend = "Write both with the same units"
        raise InputError(
            f"{atoms.name} is in units {atoms.units}, and {touching.name} in others", mend=mend
        )
    if isinstance(units, Units):
        style = "lj"
        (length, mass, force) = (units.length, units.mass, units.force)
    else:
        style = require(
            "units",
            lambda value: choice(value, [*_STYLES]),
            next(iter(told), "si") if units is None else units,
        )
        length, mass, force = _STYLES[style]
    if told and told != {style}:
        mend = "Leave units out"
        raise InputError(
            f"{atoms.name} says that its units are {told.pop()}, and units={style!r} is given",
            mend=mend,
        )
    if columns is not None:
        listed: object = columns.split() if isinstance(columns, str) else columns
        touching_names = tuple(listed) if isinstance(listed, Sequence) else ()
        if not all(isinstance(name, str) for name in touching_names) or len(touching_names) != len(
            touching.names
        ):
            there = f"{touching.name} has {len(touching.names)}: {list_names(touching.names)}"
            mend = f"Give a name for each; those that count are {', '.join(_NAMES)}"
            raise InputError(f"columns are {brief(columns)}, and {there}", mend=mend)
        touching.names = touching_names
    if missing := [name for name in ("i", "j") if name not in touching.names]:
        what = f"{pairs} has no column {' and no column '.join(missing)}"
        raise InputError(what, f"Its columns are {list_names(touching.names)}", _NAME_PAIRS)

    # LAMMPS gives the vector from j to i, and the force on i
    def vectors(scale: float, *names: str) -> Array | None:
        return (
            scale * np.stack([touching.read(name) for name in names], axis=1)
            if {*names} <= {*touching.names}
            else None
        )

    def springs(
        name: str, given: float | None, read: Callable[[str, float, str], float]
    ) -> Array | None:
        return None if given is None else np.full(len(touching.rows), read(name, given, "N/m"))

    contacts = Contacts(
        touching.name,
        _read_ids(touching, "i"),
        _read_ids(touching, "j"),
        vector=vectors(-length, "dx", "dy", "dz"),
        tangential_force=vectors(-force, "tx", "ty", "tz"),
        normal_force=force * touching.read("force") if "force" in touching.names else None,
        normal_stiffness=springs("normal_stiffness", normal_stiffness, positive),
        shear_stiffness=springs("shear_stiffness", shear_stiffness, not_negative),
    )
    listed = f"Its columns are {list_names(atoms.names)}"
    for ends, scaled in (("", False), ("u", False), ("s", True), ("su", True)):
        names = [f"{axis}{ends}" for axis in "xyz"]
        if set(names) <= set(atoms.names):
            places = np.stack([atoms.read(name) for name in names], axis=1)
            rounding = find_rounding(places)
            rounding = rounding @ np.abs(atoms.cell) if scaled else rounding
            places = places @ atoms.cell if scaled else places - atoms.origin
            break
    else:
        raise InputError(f"{atoms.name} has no columns x, y and z", listed, _WRITE_ATOMS)
    for name, other in (("id", "id"), ("radius", "diameter")):
        if name not in atoms.names and other not in atoms.names:
            raise InputError(f"{atoms.name} has no column {name}", listed, _WRITE_ATOMS)
    radii = atoms.read("radius") if "radius" in atoms.names else 0.5 * atoms.read("diameter")
    masses = mass * atoms.read("mass") if "mass" in atoms.names else None
    place = next(
        (atoms.names.index(name) for name in ("element", "type") if name in atoms.names), math.inf
    )
    kinds = tuple(cells[int(place)] for _, text in atoms.rows if len(cells := text.split()) > place)
    balls = Balls(
        atoms.name,
        length * (places + atoms.origin),
        length * radii,
        masses,
        labels=_read_ids(atoms, "id"),
        rounding=length * rounding,
        radius_rounding=length * find_rounding(radii),
        kinds=kinds if len(set(kinds)) > 1 else None,
    )
    return Source(balls, contacts, length * atoms.cell, np.asarray(atoms.pbc, bool))


def _read_ids(frame: _Frame, column: str) -> Index:
    try:
        return read_whole_numbers(column, frame.read(column))
    except InputError as error:
        raise InputError(
            str(error) if frame.name in str(error) else f"{frame.name}: {error}"
        ) from None


# -- the format ------------------------------------------------------------------------------------


def _read_frame(path: str | os.PathLike[str], step: int | None, kind: str) -> _Frame:
    """Read the frame at a time step, or the last one; ``kind`` is "ATOMS" or "ENTRIES", what is
    listed.

    A program that is killed leaves its last frame cut: a frame before it that is asked for is read,
    with a warning.
    """
    found: _Frame | None = None
    steps = list[int]()
    try:
        for frame in _split_frames(str(path), read_bytes(path, MOST_BYTES), kind):
            steps.append(frame.step)
            found = frame if step in (None, frame.step) else found
    except InputError as cut:
        if not steps:
            raise
        if step is None or found is None:
            raise InputError(
                str(cut),
                f"The last time step that can be read is {steps[-1]}",
                f"Give step={steps[-1]}",
            ) from None
        what = f"{path} is read at the time step {step}, and cannot be read to its end: {cut}"
        warnings.warn(message(what), StoppedEarlyWarning, stacklevel=4)
    if found is None:
        steps = sorted({*steps})
        shown = (
            f"{steps[0]} to {steps[-1]}, {len(steps)} in all"
            if steps[1:]
            else f"{steps[0]} alone"
            if steps
            else "none"
        )
        raise InputError(f"{path} has no time step {brief(step)}", f"It has {shown}")
    return found


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
                what = (
                    f"{name} ends before its {count} {kind.lower()} do: {len(lines) - n} are there"
                )
                raise InputError(what, "The file is not whole")
            if odd := next(
                (one for one in names if not (one.isascii() and one.isprintable())), None
            ):
                what = f"{name}:{n}: found a column named {brief(odd, 40)}"
                raise InputError(what, "The names of LAMMPS are of plain letters, digits and signs")
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
    there = f"{frame.name}:{len(lines)}"
    if frame.rows and frame.rows[-1][0] == len(lines):
        first, last = [len(frame.rows[row][1].split()) for row in (0, -1)]
        wanted = min(first, len(frame.names)) if frame.rows[1:] else len(frame.names)
        if last < wanted:
            raise InputError(
                f"{there}: the last row has {last} cells, and {wanted} are needed",
                "The file is not whole",
            )
    if broken:
        why = "The file is not whole: its last number may have lost digits"
        raise InputError(f"{there}: the last line has no line break at its end", why)


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
            frame.cell[1, 0], frame.cell[2, :2] = xy, (xz, yz)
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
        what = (
            f"{frame.name}:{n + axis + 1}: the box has the length {ends[axis]:g} along"
            f" {'xyz'[axis]}"
        )
        raise InputError(
            what, "Its lower bound must be below the upper one", "Are the two exchanged?"
        )
