"""Files of MercuryDPM: contacts in a file .fstat, and balls in a file .data or .restart.

The formats are those of MercuryDPM's documentation and source (``BaseInteraction::writeToFStat``,
``DPMBase::outputXBallsData``, ``BaseParticle::write``). A contact of two balls that move stands in
.fstat twice, once from each ball, and one with a fixed ball or a wall once.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import pairwise
from typing import Any

import numpy as np

from granphon.base.arrays import Array, Flags, Index
from granphon.base.errors import InconsistencyWarning, InputError, brief, message, warn_caller
from granphon.base.tables import plain_float
from granphon.base.text import counted, list_names
from granphon.base.validation import not_negative, require, truth
from granphon.networks.building import Source
from granphon.networks.dumps import Dump, Frame, Lines, open_lines, share_steps
from granphon.networks.lammps import Springs, add_wall, find_frozen, join_vectors, read_ids
from granphon.networks.sources import Balls, Contacts, find_rounding

#: columns of a contact in .fstat
_COLUMNS_OF_CONTACTS = (
    "time", "i", "j", "x", "y", "z", "delta", "slip", "fn", "ft", "nx", "ny", "nz", "tx", "ty",
    "tz",
)  # fmt: skip
#: columns of a ball in .data, in space and in a plane, by the number of bounds in the heading
_COLUMNS_OF_BALLS = {
    6: ("x", "y", "z", "vx", "vy", "vz", "radius", "a", "b", "c", "wx", "wy", "wz", "info"),
    4: ("x", "y", "vx", "vy", "radius", "a", "w", "info"),
}
#: number of lines of the heading of a time in .fstat
_N_HEADING_LINES = 3
#: no file has as many balls or contacts
_MOST_ROWS = 1e12
#: greatest relative difference of times that are one: files have some ten digits
_TIME_TOLERANCE = 1e-6


@dataclass(frozen=True)
class _State:
    """The balls of a file at one time.

    Attributes
    ----------
    name : the file in messages.
    time : s.
    balls : the balls, SI.
    cell : (3, 3) the vectors of the cell as rows, m.
    pbc : (3,) whether each of these is a period.
    notes : what has been passed over, and why.
    n_interactions : number of contacts that the file states; None if it states none.
    """

    name: str
    time: float
    balls: Balls
    cell: Array
    pbc: Flags
    notes: tuple[str, ...] = ()
    n_interactions: int | None = None


class _Times(Dump):
    """A file of MercuryDPM, whose frames have times, s, in place of the numbers of time steps."""

    word = "time"
    argument = "time"
    mend = "Is this a file of MercuryDPM?"

    def is_at(self, frame: Frame, step: float) -> bool:
        """Return whether a frame is of the time ``step``, s, but for rounding in the file."""
        return _is_same_time(frame.step, step)


class _Data(_Times):
    """A file .data, whose frames have balls."""

    def split(self, lines: Lines, kind: str) -> Iterator[Frame]:
        """Yield the frames of balls at each time; InputError where a heading is no heading.

        A heading has the number of balls, the time, and the bounds of the box: first the lower ones
        along each axis, and then the upper ones.
        """
        while not lines.is_at_end:
            number, *further_numbers = _read_numbers(lines)
            n_bounds = len(further_numbers) - 1
            is_count = 0.0 <= number < _MOST_ROWS and not number % 1.0
            are_finite = all(map(math.isfinite, further_numbers))
            if n_bounds not in _COLUMNS_OF_BALLS or not is_count or not are_finite:
                fault = f"{lines.where}: found {1 + len(further_numbers)} numbers"
                why = (
                    "A time begins with the number of balls, the time and the bounds of the box,"
                    " all finite"
                )
                raise InputError(
                    f"{fault}, where a heading is needed", why, "Is this a file .data?"
                )
            frame = Frame(lines.name, further_numbers[0], kind)
            lines.read_list(frame, _COLUMNS_OF_BALLS[n_bounds], int(number), kind)
            p = n_bounds // 2
            frame.cell[:p, :p] = np.diag(
                np.subtract(further_numbers[1 + p :], further_numbers[1 : 1 + p])
            )
            yield frame


class _Fstat(_Times):
    """A file .fstat, whose frames have contacts."""

    def split(self, lines: Lines, kind: str) -> Iterator[Frame]:
        """Yield the frames of contacts at each time; InputError for a heading without its time.

        A heading has three lines that begin with "#", the first of which has the time.
        """
        headings = np.flatnonzero(lines.begin_with("#"))
        # Between times without contacts there are no other lines: in a run of such lines each third
        # line begins a time.
        run_starts = headings[~np.isin(headings - 1, headings)]
        runs = np.searchsorted(run_starts, headings, side="right") - 1
        places_in_runs = headings - run_starts[runs]
        starts = headings[places_in_runs % _N_HEADING_LINES == 0]
        for start, end in pairwise([*starts.tolist(), len(lines)]):
            lines.place = start
            words = lines.read().lstrip("#").split()
            frame = Frame(lines.name, _read_time(lines, ["time", *words]), kind)
            lines.place = min(start + _N_HEADING_LINES, end)
            lines.read_list(frame, _COLUMNS_OF_CONTACTS, end - lines.place, kind)
            yield frame


def open_times(fstat: Any, particles: Any) -> tuple[list[float], Any, Any]:
    """Return the times, s, that the files .fstat and .data both have, ascending, and the two files,
    open: first that of contacts, ``fstat``, then that of balls, ``particles``.

    Warns if a file is cut, and removes its ``fault`` (:func:`share_steps`). InputError without a
    common time, and for a file .restart.
    """
    lines = open_lines(particles)
    if _is_restart(lines):
        raise InputError(f"{lines.name} has one time", "It is a file .restart", "Give the .data")
    times, balls, contacts = share_steps(_Data(particles, "atoms"), _Fstat(fstat, "entries"))
    return times, contacts, balls


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

    Balls of a file .data do not move if ``frozen`` says so, or, without it, if .fstat lists their
    contacts from the other ball alone. Each wall in .fstat is one more body.
    """
    time = None if time is None else not_negative("time", time, "s")
    state = _read_state(particles, time, pbc, frozen)
    if not len(state.balls.radii):
        raise InputError(f"{state.name} has no ball at the time {state.time:g} s")
    contact_frame = _Fstat.open(fstat, "entries").find(state.time)
    contacts, is_fixed = _read_contacts(contact_frame, state.balls, springs)
    balls = state.balls
    notes = [
        *state.notes,
        f"{contact_frame.name}: not read, as they play no part: time, x, y, z, slip.",
    ]
    if balls.masses is None:  # of a file .data
        if frozen is None and np.any(is_fixed):
            listed = list_names(map(str, np.flatnonzero(is_fixed).tolist()))
            notes.append(
                f"{contact_frame.name} has the contacts of some balls from the other ball alone:"
                f" these do not move: {listed}."
            )
            balls = replace(balls, still=is_fixed)
        notes.append(
            f"{contact_frame.name} does not say how many contacts it has: the file .restart does,"
            f" by which a file that is cut between two lines is told."
        )
    elif state.n_interactions is not None:
        _compare_number(contacts, state)
    for label in np.unique(contacts.j[contacts.j < 0])[::-1].tolist():
        balls = add_wall(balls, label, f"wall {-label - 1}")
    return Source(balls, (contacts,), state.cell, state.pbc, notes=tuple(notes))


def _read_state(
    particles: Any, time: float | None, pbc: Sequence[bool] | None, frozen: Mapping[str, Any] | None
) -> _State:
    """Return the balls at a ``time``, s, or for None at the last one, of ``particles``: the path of
    a file .data or .restart, or a file .data that is open.

    InputError if the file does not have the time.
    """
    if isinstance(particles, _Data):
        return _read_data(particles.find(time), pbc, frozen)
    lines = open_lines(particles)
    if not _is_restart(lines):
        return _read_data(_Data(particles, "atoms").find(time), pbc, frozen)
    state = _read_restart(lines, pbc, frozen)
    if time is not None and not _is_same_time(state.time, time):
        raise InputError(f"{state.name} is of the time {state.time:g}, and {time:g} is needed")
    return state


def _is_restart(lines: Lines) -> bool:
    """Whether the ``lines``, of which none has been read, are of a file .restart."""
    return lines.peek().partition(" ")[0] in ("restart_version", "MercuryDPM")


def _is_same_time(time: float, other_time: float) -> bool:
    """Whether two times, s, differ by no more than rounding in the files."""
    return abs(time - other_time) <= _TIME_TOLERANCE * max(abs(time), abs(other_time))


# -- balls -----------------------------------------------------------------------------------------


def _read_data(
    frame: Frame, pbc: Sequence[bool] | None, frozen: Mapping[str, Any] | None
) -> _State:
    """Return the balls in a frame of a file .data. The cell is the box of the file, along whose
    axes the network repeats where ``pbc`` says so.
    """
    axes = [axis for axis in "xyz" if axis in frame.names]
    columns = frame.read([*axes, "radius"])
    positions = join_vectors(columns, axes)
    kinds = frame.read_words("info")
    balls = Balls(
        frame.name,
        positions,
        columns["radius"],
        labels=np.arange(frame.count),
        rounding=find_rounding(positions),
        radius_rounding=find_rounding(columns["radius"]),
        kinds=kinds if len(set(kinds)) > 1 else None,
        still=None if frozen is None else find_frozen(frame, frozen),
        lines=frame.first + 1 + np.arange(frame.count),
    )
    note = f"{frame.name}: not read, as a network has no such quantities: velocities and angles."
    pbc_of_network = _read_pbc(pbc, np.zeros(3, bool))
    return _State(frame.name, frame.step, balls, frame.cell, pbc_of_network, (note,))


def _read_numbers(lines: Lines) -> list[float]:
    """Read the next of the ``lines``, and return its numbers; InputError unless there is one number
    or more, and nothing else.
    """
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
    """Return the balls of a file .restart, with their masses; balls of zero inverse mass do not
    move.

    The cell has the vectors of the periodic boundaries of the file, and is zero along other axes;
    its vectors are periods unless ``pbc`` says otherwise. InputError for a file that is cut or
    lacks a number, and if ``frozen`` is given, as the file itself says which balls are fixed.
    """
    if frozen is not None:
        fault = f"{lines.name} says which balls are fixed, and frozen is given"
        raise InputError(fault, mend="Leave frozen out")
    lines.require_whole()
    time = 0.0
    is_plane = False
    cell = np.zeros((3, 3))
    notes = list[str]()
    while not lines.is_at_end:
        words = lines.read().split()
        if "timeMax" in words:
            time = _read_time(lines, words)
        if "particleDimensions" in words:
            is_plane = _read_numbers_after(lines, words, "particleDimensions")[0] == 2.0
        if words[:1] == ["PeriodicBoundary"]:
            shift = _read_numbers_after(lines, words, "shift", 3)
            # vectors of the cell are in the order x, y, z
            main_axis = int(np.argmax(np.abs(shift)))
            cell[main_axis] = shift
        elif words[:1] and words[0].endswith("Boundary"):
            notes.append(f"{lines.where}: not read, as the network has no such edge: {words[0]}.")
        if words[:1] == ["Particles"]:
            break
    else:
        raise InputError(f"{lines.name} ends before its particles", "The file is not whole")
    n_balls = _read_count(lines, words, "Particles")
    balls = _read_particles(lines, n_balls, is_plane=is_plane)
    words = lines.read().split()
    n_interactions = None
    if words[:1] == ["Interactions"]:
        n_interactions = _read_count(lines, words, "Interactions")
    pbc_of_network = _read_pbc(pbc, np.any(cell != 0.0, axis=1))
    return _State(lines.name, time, balls, cell, pbc_of_network, tuple(notes), n_interactions)


def _read_particles(lines: Lines, count: int, *, is_plane: bool) -> Balls:
    """Read the next ``count`` lines of a file .restart, and return them as balls; if the particles
    have two dimensions (``is_plane``), they have no z, and the moments of inertia of discs.

    InputError if there are fewer lines, and for a line that lacks the place, the radius or the
    inverse mass.
    """
    if count > len(lines) - lines.place:
        fault = f"{lines.name} ends before its {count} particles do: {len(lines) - lines.place} are"
        raise InputError(f"{fault} there", "The file is not whole")
    table = np.empty((count, 5))  # a row for each ball: x, y, z, radius, inverse mass
    first = lines.place + 1
    for row in table:
        words = lines.read().split()
        row[:3] = _read_numbers_after(lines, words, "position", 3)
        row[3] = _read_numbers_after(lines, words, "radius")[0]
        row[4] = _read_numbers_after(lines, words, "invMass")[0]
    positions = table[:, : 2 if is_plane else 3]
    radii = table[:, 3]
    # the mass of a fixed ball is infinite; other numbers out of range are refused later
    with np.errstate(all="ignore"):
        masses = 1.0 / table[:, 4]
        inertias = 0.5 * masses * radii**2 if is_plane else None
    return Balls(
        lines.name,
        positions,
        radii,
        masses=masses,
        inertias=inertias,
        labels=np.arange(count),
        rounding=find_rounding(positions),
        radius_rounding=find_rounding(radii),
        lines=first + np.arange(count),
    )


def _read_numbers_after(
    lines: Lines, words: Sequence[str], name: str, count: int = 1
) -> list[float]:
    """Return the ``count`` numbers that follow the word ``name`` among the ``words`` of the line
    that was read last; InputError if the word or a number is not there.
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


def _read_time(lines: Lines, words: Sequence[str]) -> float:
    """Return the time, s, that follows the word "time" among the ``words`` of the line that was
    read last; InputError if it is not there, or not finite.
    """
    time = _read_numbers_after(lines, words, "time")[0]
    if not math.isfinite(time):
        raise InputError(f"{lines.where}: found the time {time:g} s", mend="Run it again")
    return time


def _read_count(lines: Lines, words: Sequence[str], name: str) -> int:
    """Return the whole number, zero or above, that follows the word ``name`` among the ``words`` of
    the line that was read last; InputError if it is not there, or another number.
    """
    number = _read_numbers_after(lines, words, name)[0]
    if not 0.0 <= number < _MOST_ROWS or number % 1.0:
        fault = f"{lines.where}: found {name} {number:g}, where a whole number is needed"
        raise InputError(fault, mend="Is this a file .restart of MercuryDPM, and whole?")
    return int(number)


def _read_pbc(pbc: Any, default: Flags) -> Flags:
    """Return (3,) along which axes the network repeats: as ``pbc`` says, one to three truth values,
    false along further axes; for None the ``default``. InputError for another ``pbc``.
    """
    if pbc is None:
        return default
    values = pbc.tolist() if isinstance(pbc, np.ndarray) else pbc
    flags = list(values) if isinstance(values, Sequence) else []
    if not 1 <= len(flags) <= 3:
        raise InputError(f"pbc is {brief(pbc)}", mend="Give a truth value for each axis")
    flags = [require("pbc", truth, flag) for flag in flags]
    return np.array(flags + [False] * (3 - len(flags)))


# -- contacts --------------------------------------------------------------------------------------


def _compare_number(contacts: Contacts, state: _State) -> None:
    """Warn if .fstat has fewer contacts than .restart says: .fstat is then cut between two lines.

    A contact across a periodic boundary may count twice in the number of .restart, once for each
    image.
    """
    last_ball = len(state.balls.radii) - 1
    # walls have negative labels, which are no indices; is_across leaves them out
    i = np.clip(contacts.i, 0, last_ball)
    j = np.clip(contacts.j, 0, last_ball)
    assert contacts.vector is not None
    # the difference of the listed places less the vector of the contact: periods, if the contact is
    # across a boundary, else zero but for rounding
    with np.errstate(all="ignore"):  # numbers out of range are refused later
        periods = state.balls.positions[j] - state.balls.positions[i]
        periods -= contacts.vector[:, : periods.shape[1]]
        sum_of_radii = state.balls.radii[i] + state.balls.radii[j]
        is_across = (contacts.j >= 0) & (np.linalg.norm(periods, axis=1) > sum_of_radii)
    n_most = len(contacts) + int(np.count_nonzero(is_across))
    if state.n_interactions is not None and state.n_interactions > n_most:
        fault = (
            f"{contacts.name} has {counted(len(contacts), 'contact')}, and {state.name} says that"
            f" there are {state.n_interactions}"
        )
        warn_caller(message(fault, mend="Is the file whole?"), InconsistencyWarning)


def _read_contacts(frame: Frame, balls: Balls, springs: Springs) -> tuple[Contacts, Flags]:
    """Return the contacts of a frame of .fstat, each once, in SI units, and (n,) which balls are
    fixed; warn of contacts of two balls that move that are listed from one of them alone.

    The label of wall w is -1 - w. Balls of a file .restart, or with ``frozen``, are fixed as
    ``balls`` say. Otherwise a ball is fixed if it lists no contact itself, and another ball lists
    one with it.
    """
    frame.require_full_rows("Lines may have run together, or the file is of another program")
    columns = frame.read([name for name in _COLUMNS_OF_CONTACTS if name not in ("time", "slip")])
    i = read_ids(frame, "i", columns)
    j = read_ids(frame, "j", columns)
    normals = join_vectors(columns, ("nx", "ny", "nz"))
    is_kept, is_alone = _select_rows(i, j, normals)
    is_wall = j < 0
    # In the file normals lead from ball j to ball i, and from a ball to a wall; forces act on ball
    # i, and on a wall. In Contacts normals lead from i to j, and forces act on j.
    sign = np.where(is_wall, 1.0, -1.0)[:, None]
    with np.errstate(all="ignore"):  # numbers out of range are refused later
        across = columns["ft"][:, None] * join_vectors(columns, ("tx", "ty", "tz"))
    contacts = Contacts(
        frame.name,
        i,
        j,
        vector=_find_vectors(columns, balls, i, j, sign * normals),
        normal=sign * normals,
        tangential_force=sign * across,
        normal_force=columns["fn"],
        overlap=columns["delta"],
        lines=frame.first + 1 + np.arange(frame.count),
        **springs.of(frame.count),
    )
    is_fixed = balls.fixed.copy()
    n_balls = len(balls.radii)
    if balls.masses is None and balls.still is None:
        lists_contacts = np.isin(np.arange(n_balls), i)
        is_fixed = np.isin(np.arange(n_balls), j[is_alone]) & ~lists_contacts
    _warn_of_half_contacts(contacts, is_alone & ~is_fixed[np.clip(j, 0, n_balls - 1)])
    return contacts.select(is_kept), is_fixed


def _select_rows(i: Index, j: Index, normals: Array) -> tuple[Flags, Flags]:
    """Return (rows,) whether each row of .fstat is kept, so that each contact is there once, and
    (rows,) whether the row is the only one of a contact of two balls.

    ``i`` and ``j`` (rows,) are the balls of the rows, below zero for walls, and ``normals``
    (rows, 3) the normals in the file.
    """
    is_wall = j < 0
    n_labels = int(np.max(np.maximum(i, j), initial=0)) + 1
    pair = np.minimum(i, j) * n_labels + np.maximum(i, j)  # a number of the two balls
    # A contact of two balls is listed from both, or from one of them alone. It is kept as listed
    # from the ball with the lower index, or else from the other ball.
    is_from_lower = ~is_wall & (i < j)
    is_from_higher = ~is_wall & (i > j)
    lacks_higher = is_from_lower & ~np.isin(pair, pair[is_from_higher])
    lacks_lower = is_from_higher & ~np.isin(pair, pair[is_from_lower])
    # A ball that touches its own image is listed from both sides: the row is kept whose normal has
    # a positive component along the axis along which it is largest.
    main_axes = np.argmax(np.abs(normals), axis=1)
    is_ahead = normals[np.arange(len(i)), main_axes] > 0.0
    is_own_image = ~is_wall & (i == j) & is_ahead
    is_kept = is_wall | is_from_lower | lacks_lower | is_own_image
    return is_kept, lacks_lower | lacks_higher


def _warn_of_half_contacts(contacts: Contacts, is_half: Flags) -> None:
    """Warn of the contacts that ``is_half`` (n,) marks: the file has them from one of their balls
    alone, though the other ball moves.
    """
    n_half = int(np.count_nonzero(is_half))
    if n_half:
        example = contacts.describe(int(np.argmax(is_half)))
        fault = (
            f"{contacts.name} has {counted(n_half, 'contact')} from one of two balls alone, though"
            f" the other one moves, as that of {example}"
        )
        warn_caller(message(fault, mend="Is the file whole?"), InconsistencyWarning)


def _find_vectors(
    columns: Mapping[str, Array], balls: Balls, i: Index, j: Index, normal: Array
) -> Array:
    """Return the vectors (n_c, 3), m, from the centres of balls i to those of balls j, or to walls.

    The vectors lie along the ``normal`` (n_c, 3), and are as long as the sum of the radii less the
    overlap in the ``columns``.
    """
    last_ball = len(balls.radii) - 1
    # indices that no ball has are refused later, and walls, below zero, have no radius
    radii_j = np.where(j < 0, 0.0, balls.radii[np.clip(j, 0, last_ball)])
    lengths = balls.radii[np.clip(i, 0, last_ball)] + radii_j - columns["delta"]
    with np.errstate(all="ignore"):  # numbers out of range are refused later
        return np.asarray(lengths[:, None] * normal)
