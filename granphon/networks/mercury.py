"""Files of MercuryDPM: contacts in a file .fstat, and balls in a file .data or .restart.

The formats are those of MercuryDPM's documentation and source (``BaseInteraction::writeToFStat``,
``DPMBase::outputXBallsData``, ``BaseParticle::write``). A contact of two balls that move stands in
.fstat twice, once from each ball, and one with a fixed ball or a wall once.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import pairwise
from typing import Any, NoReturn

import numpy as np

from granphon.base.arrays import Array, Flags, Index
from granphon.base.errors import InconsistencyWarning, InputError, brief, message, warn_caller
from granphon.base.packed import unpack
from granphon.base.tables import plain_float
from granphon.base.text import counted, list_names, read_bytes
from granphon.base.validation import not_negative, require, truth
from granphon.networks.building import Source
from granphon.networks.dumps import Frame, Lines
from granphon.networks.lammps import Springs, add_wall, find_frozen, join_vectors, read_ids
from granphon.networks.sources import MOST_BYTES, Balls, Contacts, find_rounding

#: columns of a contact in .fstat
_OF_CONTACTS = ("time", "i", "j", "x", "y", "z", "delta", "slip", "fn", "ft", "nx", "ny", "nz",
                "tx", "ty", "tz")  # fmt: skip
#: columns of a ball in .data, in space and in a plane, by the number of bounds in the heading
_OF_BALLS = {
    6: ("x", "y", "z", "vx", "vy", "vz", "radius", "a", "b", "c", "wx", "wy", "wz", "info"),
    4: ("x", "y", "vx", "vy", "radius", "a", "w", "info"),
}
#: lines of the heading of a time in .fstat
_HEADING = 3
#: greatest relative difference of times that are one: files have some ten digits
_SAME_TIME = 1e-6


@dataclass(frozen=True)
class _State:
    """The balls at one time: the ``cell`` (3, 3), m, and which of its vectors are periods (3,)."""

    name: str
    time: float
    balls: Balls
    cell: Array
    pbc: Flags
    notes: tuple[str, ...] = ()


def read_mercury(
    fstat: Any,
    particles: Any,
    *,
    time: float | None,
    pbc: Sequence[bool] | None,
    frozen: Mapping[str, Any] | None,
    springs: Springs,
) -> Source:
    """Return the balls and contacts of two files of MercuryDPM at one time, in SI units; see
    ``ContactNetwork.from_mercury`` for the arguments and errors.
    """
    time = None if time is None else not_negative("time", time, "s")
    lines = _open(particles)
    first_word = lines.peek().partition(" ")[0]
    is_restart = first_word in ("restart_version", "MercuryDPM")
    if is_restart:
        state = _read_restart(lines, pbc, frozen)
    else:
        state = _read_data(lines, time, pbc, frozen)
    if time is not None and not _is_same_time(state.time, time):
        raise InputError(f"{state.name} is of the time {state.time:g}, and {time:g} is needed")
    touching = _find_time(_open(fstat), state.time)
    contacts, fixed = _read_contacts(touching, state.balls, springs)
    balls = state.balls
    notes = [*state.notes, f"{touching.name}: not read, as they play no part: time, x, y, z, slip."]
    if not is_restart and frozen is None and np.any(fixed):
        listed = list_names(map(str, np.flatnonzero(fixed).tolist()))
        notes.append(
            f"{touching.name} has the contacts of some balls from the other ball alone: these do"
            f" not move: {listed}."
        )
        balls = replace(balls, still=fixed)
    for label in np.unique(contacts.j[contacts.j < 0])[::-1].tolist():
        balls = add_wall(balls, label, f"wall {-label - 1}")
    return Source(balls, (contacts,), state.cell, state.pbc, notes=tuple(notes))


def _open(path: Any) -> Lines:
    """Return the lines of a file, which may be packed."""
    raw, is_whole = unpack(str(path), read_bytes(path, MOST_BYTES), MOST_BYTES)
    return Lines(str(path), raw, is_whole)


def _is_same_time(one: float, other: float) -> bool:
    return abs(one - other) <= _SAME_TIME * max(abs(one), abs(other))


# -- balls -----------------------------------------------------------------------------------------


def _read_data(
    lines: Lines, time: float | None, pbc: Sequence[bool] | None, frozen: Mapping[str, Any] | None
) -> _State:
    """Return the balls of a file .data at a ``time``, by default the last one. The cell is the box
    of the file, along whose axes the network repeats where ``pbc`` says so.
    """
    chosen: tuple[float, list[float], Frame] | None = None
    times = list[float]()
    while not lines.at_end:
        number, *rest = _read_numbers(lines)
        n_bounds = len(rest) - 1
        if n_bounds not in _OF_BALLS or not 0.0 <= number < 1e12 or number % 1.0:
            fault = f"{lines.where}: found {1 + len(rest)} numbers"
            why = "A time begins with the number of balls, the time and the bounds of the box"
            raise InputError(f"{fault}, where a heading is needed", why, "Is this a file .data?")
        frame = Frame(lines.name, 0, "atoms")
        lines.read_list(frame, _OF_BALLS[n_bounds], int(number), "atoms")
        times.append(rest[0])
        if time is None or _is_same_time(rest[0], time):
            chosen = rest[0], rest[1:], frame
    if chosen is None:
        _refuse_time(lines.name, time, times)
    found_time, bounds, frame = chosen
    p = len(bounds) // 2
    cell = np.zeros((3, 3))
    cell[:p, :p] = np.diag(np.subtract(bounds[p:], bounds[:p]))
    columns = frame.read([*"xyz"[:p], "radius"])
    positions = join_vectors(columns, "xyz"[:p])
    kinds = frame.read_words("info")
    balls = Balls(
        lines.name,
        positions,
        columns["radius"],
        labels=np.arange(frame.count),
        rounding=find_rounding(positions),
        radius_rounding=find_rounding(columns["radius"]),
        kinds=kinds if len(set(kinds)) > 1 else None,
        still=None if frozen is None else find_frozen(frame, frozen),
        lines=frame.first + 1 + np.arange(frame.count),
    )
    note = f"{lines.name}: not read, as a network has no such quantity: velocities and angles."
    return _State(lines.name, found_time, balls, cell, _read_pbc(pbc, np.zeros(3, bool)), (note,))


def _read_numbers(lines: Lines) -> list[float]:
    """Read a line of numbers; InputError for another one."""
    cells = lines.read().split()
    try:
        numbers = [plain_float(cell) for cell in cells]
    except ValueError:
        numbers = []
    if not numbers:
        fault = f"{lines.where}: found {brief(' '.join(cells), 40)}, where numbers are needed"
        raise InputError(fault, mend="Is this a file of MercuryDPM?")
    return numbers


def _read_restart(
    lines: Lines, pbc: Sequence[bool] | None, frozen: Mapping[str, Any] | None
) -> _State:
    """Return the balls of a file .restart, with their masses; those of zero inverse mass do not
    move. Periods are those of its periodic boundaries.
    """
    if frozen is not None:
        fault = f"{lines.name} says which balls are fixed, and frozen is given"
        raise InputError(fault, mend="Leave frozen out")
    lines.require_whole()
    time = 0.0
    plane = False
    cell = np.zeros((3, 3))
    notes = list[str]()
    while not lines.at_end:
        words = lines.read().split()
        if "timeMax" in words:
            time = _read_word(lines, words, "time")[0]
        if "particleDimensions" in words:
            plane = _read_word(lines, words, "particleDimensions")[0] == 2.0
        if words[:1] == ["PeriodicBoundary"]:
            shift = _read_word(lines, words, "shift", 3)
            cell[int(np.argmax(np.abs(shift)))] = shift
        elif words[:1] and words[0].endswith("Boundary"):
            notes.append(f"{lines.where}: not read, as the network has no such edge: {words[0]}.")
        if words[:1] == ["Particles"]:
            break
    else:
        raise InputError(f"{lines.name} ends before its particles", "The file is not whole")
    count = int(_read_word(lines, words, "Particles")[0])
    if count > len(lines) - lines.place:
        fault = f"{lines.name} ends before its {count} particles do: {len(lines) - lines.place} are"
        raise InputError(f"{fault} there", "The file is not whole")
    table = np.empty((count, 5))
    first = lines.place + 1
    for row in table:
        words = lines.read().split()
        row[:3] = _read_word(lines, words, "position", 3)
        row[3] = _read_word(lines, words, "radius")[0]
        row[4] = _read_word(lines, words, "invMass")[0]
    with np.errstate(divide="ignore"):
        masses = 1.0 / table[:, 4]
    p = 2 if plane else 3
    balls = Balls(
        lines.name,
        table[:, :p],
        table[:, 3],
        masses=masses,
        inertias=0.5 * masses * table[:, 3] ** 2 if plane else None,  # of discs
        labels=np.arange(count),
        rounding=find_rounding(table[:, :p]),
        radius_rounding=find_rounding(table[:, 3]),
        lines=first + np.arange(count),
    )
    is_period = np.any(cell != 0.0, axis=1)
    return _State(lines.name, time, balls, cell, _read_pbc(pbc, is_period), tuple(notes))


def _read_word(lines: Lines, words: Sequence[str], name: str, count: int = 1) -> list[float]:
    """Return the numbers behind the word ``name`` in the line that was read last; InputError
    without them.
    """
    try:
        place = words.index(name) + 1
        numbers = [plain_float(word) for word in words[place : place + count]]
    except ValueError:
        numbers = []
    if len(numbers) < count:
        fault = f"{lines.where}: found no {name} with {count} numbers"
        raise InputError(fault, mend="Is this a file .restart of MercuryDPM, and whole?")
    return numbers


def _read_pbc(pbc: Any, default: Flags) -> Flags:
    """Return (3,) along which axes the network repeats; InputError for what is not up to three
    truth values.
    """
    if pbc is None:
        return default
    flags = list(pbc) if isinstance(pbc, Sequence | np.ndarray) else []
    if not 1 <= len(flags) <= 3:
        raise InputError(f"pbc is {brief(pbc)}", mend="Give a truth value for each axis")
    flags = [require("pbc", truth, flag) for flag in flags]
    return np.array(flags + [False] * (3 - len(flags)))


# -- contacts --------------------------------------------------------------------------------------


def _find_time(lines: Lines, time: float) -> Frame:
    """Return the contacts of a file .fstat at a ``time``; of several the last ones. InputError if
    there are none of this time, or if the file is cut there.
    """
    is_heading = lines.begin_with("#")
    headings = np.flatnonzero(is_heading)
    # a heading has three lines: times without contacts follow each other at once
    run_starts = headings[~np.isin(headings - 1, headings)]
    in_run = headings - run_starts[np.searchsorted(run_starts, headings, side="right") - 1]
    starts = headings[in_run % _HEADING == 0]
    times = list[float]()
    chosen: Frame | None = None
    for start, end in pairwise([*starts.tolist(), len(lines)]):
        lines.place = start
        words = lines.read().lstrip("#").split()
        times.append(_read_word(lines, ["time", *words], "time")[0])
        if _is_same_time(times[-1], time):
            first = min(start + _HEADING, end)
            chosen = Frame(lines.name, 0, "entries", names=_OF_CONTACTS)
            lines.place = first
            lines.read_list(chosen, _OF_CONTACTS, end - first, "entries")
    if chosen is None:
        _refuse_time(lines.name, time, times)
    return chosen


def _refuse_time(name: str, time: float | None, times: Sequence[float]) -> NoReturn:
    """Raise the InputError of a file that has not this ``time``, but others."""
    has = "It has none"
    if times:
        has = f"It has {times[0]:g} to {times[-1]:g}, {len(times)} in all"
    raise InputError(f"{name} has no time {'' if time is None else time}".rstrip(), has)


def _read_contacts(frame: Frame, balls: Balls, springs: Springs) -> tuple[Contacts, Flags]:
    """Return the contacts of .fstat, each once, and (n,) which balls have all of theirs from the
    other ball alone: these are fixed.

    The label of wall w is -1 - w.
    """
    columns = frame.read([name for name in _OF_CONTACTS if name not in ("time", "slip")])
    i = read_ids(frame, "i", columns)
    j = read_ids(frame, "j", columns)
    n_balls = len(balls.radii)
    is_wall = j < 0
    key = np.minimum(i, j) * n_balls + np.maximum(i, j)
    is_first = ~is_wall & (i < j)
    is_back = ~is_wall & (i > j)
    is_alone = (is_back & ~np.isin(key, key[is_first])) | (is_first & ~np.isin(key, key[is_back]))
    along = join_vectors(columns, ("nx", "ny", "nz"))
    # a ball that touches its own image is listed from both sides
    is_ahead = along[np.arange(len(i)), np.argmax(np.abs(along), axis=1)] > 0.0
    is_kept = is_wall | is_first | (is_back & is_alone) | (~is_wall & (i == j) & is_ahead)
    # normals lead from ball j to ball i, and from a ball to a wall; forces act on ball i, and on a
    # wall
    sign = np.where(is_wall, 1.0, -1.0)[:, None]
    across = columns["ft"][:, None] * join_vectors(columns, ("tx", "ty", "tz"))
    contacts = Contacts(
        frame.name,
        i,
        j,
        vector=_find_vectors(columns, balls, i, j, sign * along),
        normal=sign * along,
        tangential_force=sign * across,
        normal_force=columns["fn"],
        overlap=columns["delta"],
        lines=frame.first + 1 + np.arange(frame.count),
        **springs.of(frame.count),
    )
    is_fixed = balls.fixed.copy()
    if balls.masses is None and balls.still is None:
        is_owner = np.isin(np.arange(n_balls), i)
        is_fixed = np.isin(np.arange(n_balls), j[is_alone]) & ~is_owner
    lacks_other = is_alone & ~is_fixed[np.clip(j, 0, n_balls - 1)]
    if np.any(lacks_other):
        n_lacking = int(np.count_nonzero(lacks_other))
        first = contacts.describe(int(np.argmax(lacks_other)))
        fault = (
            f"{frame.name} has {counted(n_lacking, 'contact')} from one of two balls alone, though"
            f" the other one moves, as that of {first}"
        )
        warn_caller(message(fault, mend="Is the file whole?"), InconsistencyWarning)
    return contacts.select(is_kept), is_fixed


def _find_vectors(
    columns: Mapping[str, Array], balls: Balls, i: Index, j: Index, normal: Array
) -> Array:
    """Return the vectors (n_c, 3) from the centres of balls i to those of balls j, m, or to walls,
    along the normals and as long as radii and overlaps say.
    """
    last = len(balls.radii) - 1
    radii_j = np.where(j < 0, 0.0, balls.radii[np.clip(j, 0, last)])
    lengths = balls.radii[np.clip(i, 0, last)] + radii_j - columns["delta"]
    return np.asarray(lengths[:, None] * normal)
