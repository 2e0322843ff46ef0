"""Compiled loops over contacts whose balls move: how contacts deform in a step, what forces they
then have, and how these forces act on the balls.

The vector r leads from the centre of ball i to that of ball j, and n = r/|r|. The r of a free
contact follows the balls, and the arms of its balls are parts of r, which add up to one. The r of
any other contact is a unit vector that stays as it is at rest, and its arms are lengths: so it is
with flat walls, and with all contacts if they keep the directions of the network. Forces across a
contact make torques by the arms. Slip has the same levers, or, as in LAMMPS, the radii, which
exceed the arms by half of the overlap: then the law has no potential.

Slip and roll of a step are those across the mean of r before and after the step, and twist is that
about this mean. In true directions, forces across contacts turn with n in two rotations: the
smallest that takes n along, and one about n by the mean spin of the two balls. Forces turn to the
mean of r first, where the law adds what the step changes, and from there to r after the step.
Turning keeps |T|, and pairs of forces and torques keep momentum and angular momentum exactly.
Static normal forces press along n. In the directions of the network nothing turns: the loads that
hold the balls at rest balance static forces at any time, and changes of forces act alone.

A step is one pass over the contacts (:func:`follow`), in chunks. Motions of balls are gathered for
a chunk, and forces are scattered to balls. In between, a row of the chunk holds one number of each
of its contacts. The processor works on several contacts at a time in loops over one array without
branches and without indices of balls: so all rows lie in one array, at fixed places, where they do
not overlap. Functions of a chunk take this array, ``rows``, and the number ``n`` of contacts in the
chunk; the constants at the head of this module say where each row begins. A loop ends at
``min(n, CHUNK)``, which is n: it tells the compiler that an index, a constant plus a number up to
CHUNK, is not below zero, where it would count from the end.
"""

from __future__ import annotations

import math
from typing import NamedTuple, cast

import numpy as np
from numpy.typing import NDArray

from granphon.balls import hertz
from granphon.base.arrays import Array
from granphon.base.compiled import compiled
from granphon.contacts.vectors import Vector, add, cross, dot, scale

#: contacts of a chunk, whose rows stay in the processor's first cache
CHUNK = cast("int", np.int64(64))  # no Python int: Numba compiles a loop anew for each value of one
#: numbers in a line of the processor's cache. Rows begin with a line: the processor reads several
#: numbers at once from within a line faster than across two
_LINE = 8
#: least divisor: takes the place of a divisor that is zero, where the dividend is zero too
_LEAST_DIVISOR = hertz.LEAST_NORMAL
#: the stiffness of Hertz's law, over c h^(1/2)
_STIFFNESS = hertz.EXPONENT

# Where the rows of a chunk begin. Vectors have three; slip, twist and roll, or forces against
# these, seven.

#: what contacts are at rest: r, |r|, the distance by which balls that are apart have to approach
#: before they push, whether r follows the balls (one or zero), the arms of balls i and j over |r|,
#: and the normal force
REST = 0 * CHUNK
LENGTH = 3 * CHUNK
GAP = 4 * CHUNK
IS_FREE = 5 * CHUNK
ARM_I = 6 * CHUNK
ARM_J = 7 * CHUNK
FORCE = 8 * CHUNK
#: their law: stiffnesses of slip, twist and roll over those of flat punches as wide as the
#: contacts; dashpots, tau and c_0 of normal motion and of others, and alpha m*^1/2; Hertz's
#: coefficient, the elongation at which a contact opens, and the root of the overlap at rest
SLIP_RATIO = 9 * CHUNK
TWIST_RATIO = 10 * CHUNK
ROLL_RATIO = 11 * CHUNK
NORMAL_TIME = 12 * CHUNK
SIDE_TIME = 13 * CHUNK
NORMAL_DASHPOT = 14 * CHUNK
SIDE_DASHPOT = 15 * CHUNK
ROOT_DASHPOT = 16 * CHUNK
COEFFICIENT = 17 * CHUNK
OPENING = 18 * CHUNK
ROOT = 19 * CHUNK
#: radii of balls i and j if these are the levers of slip, or else zero; and where all columns end
LEVER_I = 20 * CHUNK
LEVER_J = 21 * CHUNK
COLUMNS_END = 22 * CHUNK
#: the columns of dashpots
DASHPOTS = (NORMAL_TIME, SIDE_TIME, NORMAL_DASHPOT, SIDE_DASHPOT, ROOT_DASHPOT)
#: displacement since rest of ball j less that of ball i, before and after the step; rotations in
#: the step
_MOVE_START = 22 * CHUNK
_MOVE_END = 25 * CHUNK
_TURN_I = 28 * CHUNK
_TURN_J = 31 * CHUNK
#: n before the step, along the mean of r, and after the step; r and |r| with which forces act; and
#: the mean of r before and after the step
_NORMAL_START = 34 * CHUNK
_NORMAL_MIDDLE = 37 * CHUNK
_NORMAL_END = 40 * CHUNK
_R = 43 * CHUNK
_R_LENGTH = 46 * CHUNK
_R_MIDDLE = 47 * CHUNK
#: elongations before and after the step
_E_START = 50 * CHUNK
_E = 51 * CHUNK
#: of the angle by which forces turn about n in half of the step: the tangent of half of the angle,
#: and one plus the cosine of the angle
_HALF_TANGENT = 52 * CHUNK
_ONE_PLUS_COSINE = 53 * CHUNK
#: slip, twist and roll of the step; forces against them: those before the step, first as they were
#: and then turned to its middle; those after it; and the mean of both
_SIDES = 54 * CHUNK
_PULL_START = 61 * CHUNK
_PULL = 68 * CHUNK
_PULL_MEAN = 75 * CHUNK
#: f - f_0; normal stiffnesses, and those of flat punches, before and after the step; and the work
#: of the step against slip, twist and roll
_CHANGE = 82 * CHUNK
_K_START = 83 * CHUNK
_K = 84 * CHUNK
_PUNCH_START = 85 * CHUNK
_PUNCH = 86 * CHUNK
_WORK = 87 * CHUNK
#: forces and torques on ball i, and on ball j
_ON_I = 88 * CHUNK
_ON_I_TORQUE = 91 * CHUNK
_ON_J = 94 * CHUNK
_ON_J_TORQUE = 97 * CHUNK
#: dashpots: rates of elongation, and of slip, twist and roll; forces before and after the step;
#: energy lost
_RATE = 100 * CHUNK
_RATES = 101 * CHUNK
_DASH_START = 108 * CHUNK
_DASH = 116 * CHUNK
_LOSS = 124 * CHUNK
#: the share of its constant viscosities with which the dashpot of a contact acts; the viscosity
#: against slip over the ratio of slip; and f - f_0 to which the dashpot adds
_SHARE = 125 * CHUNK
_VISCOSITY = 126 * CHUNK
_PRESSURE = 127 * CHUNK
_ROWS_END = 128 * CHUNK
#: where twist and roll begin, from where slip begins, and the length of all three
_TWIST = 3 * CHUNK
_ROLL = 4 * CHUNK
_SIDES_LENGTH = 7 * CHUNK


class Columns(NamedTuple):
    """What loops read of n_c contacts.

    Attributes
    ----------
    i, j : (n_c,) numbers of the two balls.
    axes : (m,) axes of the motions of a ball, 0 to 2 of displacements, 3 to 5 of rotations.
    shared : (rows,) one number for each of the rows before ``COLUMNS_END``, which all contacts
        have; any number for rows in ``separate``.
    separate : (n_s, n_c) the numbers of the rows in which contacts differ.
    lines : (n_s,) where the rows of ``separate`` begin in a chunk.
    """

    i: NDArray[np.uint32]
    j: NDArray[np.uint32]
    axes: NDArray[np.int64]
    shared: Array
    separate: Array
    lines: NDArray[np.int64]


class Rules(NamedTuple):
    """Choices that hold for all contacts.

    Attributes
    ----------
    can_turn : whether the directions of contacts follow their balls, and are not those of rest.
    mu : friction coefficient of Coulomb's limit.
    can_pull : whether the force of the law and the dashpot together may pull.
    is_total : whether the forces of dashpots are added on both sides of Coulomb's limit: to the
        force against slip, and to the normal force.
    is_hertz : whether loops find normal forces by Hertz's law; otherwise they are known before the
        loop.
    """

    can_turn: bool
    mu: float
    can_pull: bool = True
    is_total: bool = False
    is_hertz: bool = False


class Moment(NamedTuple):
    """State of the balls and of their contacts at a moment.

    Attributes
    ----------
    motions : (n_balls, m) displacements, in metres, and rotations, rad, of all balls since rest.
    e : (n_c,) elongations since rest, m.
    pull : (4 or 8, n_c) change f - f_0 of normal forces, N, forces T against slip (3), N, and with
        8 rows torques against twist and against roll (3), N m.
    k, punch : (n_c,) normal stiffnesses, and those of flat punches as wide as the contacts, N/m.
    """

    motions: Array
    e: Array
    pull: Array
    k: Array
    punch: Array


class Step(NamedTuple):
    """A step in time: how long it is, which forces of it act on balls, and its dashpots.

    Attributes
    ----------
    length : length of the step, s; read only if there are both means and dashpots.
    mean : (n_c,) means of f - f_0 over the step: forces on balls are then the mean forces of the
        step, by which it keeps the energy. (0,) if forces on balls are to be those after the step,
        as they have to be where loops know Hertz's law.
    speeds : (n_balls, m) velocities of balls after the step, for dashpots; not read if there are
        means.
    dash : (4 or 8, n_c) forces of dashpots before the step, replaced by those after the step or, if
        there are means, by their means over the step; (4 or 8, 0) without dashpots.
    """

    length: float
    mean: Array
    speeds: Array
    dash: Array


# -- vectors ---------------------------------------------------------------------------------------


@compiled
def _turn_force(
    force: Vector, start: Vector, end: Vector, half_tangent: float, one_plus_cosine: float
) -> Vector:
    """Return a ``force`` across the unit vector ``start``, turned by two rotations: the smallest
    that takes ``start`` to the unit vector ``end``, and one about ``end`` by an angle.

    ``half_tangent`` is the tangent of half of the angle, and ``one_plus_cosine`` is one plus the
    cosine of the angle; the product of both is the sine.
    """
    # for a vector across the start, the smallest rotation is a mirror image across the bisector
    bisector = add(start, 1.0, end)
    mirrored_part = dot(bisector, force) / max(1.0 + dot(start, end), _LEAST_DIVISOR)
    image = add(force, -mirrored_part, bisector)
    sine = half_tangent * one_plus_cosine
    return add(scale(one_plus_cosine - 1.0, image), sine, cross(end, image))


@compiled
def _find_slip(
    move: Vector,
    turn_i: Vector,
    turn_j: Vector,
    levers: tuple[float, float],
    r: Vector,
    n: Vector,
) -> Vector:
    """Return the slip across the unit vector ``n`` of two balls whose centres are ``r`` apart. Ball
    j moves by ``move`` against ball i, and the balls turn by ``turn_i`` and ``turn_j`` about
    their centres. ``levers`` are those of balls i and j over |r|.
    """
    turn = add(scale(levers[0], turn_i), levers[1], turn_j)
    slip = add(move, -1.0, cross(turn, r))
    return add(slip, -dot(n, slip), n)


@compiled
def _get_vector(rows: Array, place: int) -> Vector:
    """Return the vector of a contact whose first component is at a ``place`` in the rows."""
    return rows[place], rows[place + CHUNK], rows[place + 2 * CHUNK]


@compiled
def _set_vector(rows: Array, place: int, a: Vector) -> None:
    """Set the vector of a contact to ``a``; its first component is at a ``place`` in the rows."""
    rows[place] = a[0]
    rows[place + CHUNK] = a[1]
    rows[place + 2 * CHUNK] = a[2]


@compiled
def _find_levers(rows: Array, c: int, r: Vector, n: Vector) -> tuple[float, float]:
    """Return the levers, over |r|, by which rotations of balls i and j of contact ``c`` make slip:
    the arms, or the radii where these are given. ``n`` is the direction of ``r``, a unit vector.
    """
    over_length = 1.0 / dot(n, r)
    lever_i = rows[LEVER_I + c]
    lever_j = rows[LEVER_J + c]
    return (
        lever_i * over_length if lever_i > 0.0 else rows[ARM_I + c],
        lever_j * over_length if lever_j > 0.0 else rows[ARM_J + c],
    )


# -- from arrays of contacts or balls to the rows of a chunk, n contacts from the first, and back --


@compiled
def _make_rows(shared: Array) -> Array:
    """Return new rows of a chunk: first those of ``shared`` (rows,), each with the one number that
    all contacts have, then those that a step sets, with zeros.
    """
    numbers = np.zeros(_ROWS_END + _LINE)
    # the rows begin at the first address in `numbers` where a line of the cache begins
    rows = numbers[(-numbers.ctypes.data // numbers.itemsize) % _LINE :]
    for row in range(0, COLUMNS_END, CHUNK):
        for c in range(CHUNK):
            rows[row + c] = shared[row // CHUNK]
    return rows


@compiled
def _find_line(rows: Array, row: int, n: int) -> Array:
    """Return the n numbers of a ``row``, as a view.

    The index ``row + c`` would take more time: unless the row is a constant, the compiler does not
    know that the index is not below zero, where it would count from the end.
    """
    return rows[row : row + n]


@compiled
def _read_separate(
    rows: Array, separate: Array, lines: NDArray[np.int64], first: int, n: int
) -> None:
    """Set the rows that begin at ``lines`` (n_s,) to the numbers ``separate`` (n_s, n_c) of n
    contacts from the ``first`` on.
    """
    for line in range(len(lines)):
        _read(rows, lines[line], separate[line], first, n)


@compiled
def _read(rows: Array, row: int, values: Array, first: int, n: int) -> None:
    """Set a row to the ``values`` (n_c,) of n contacts from the ``first`` on."""
    block = values[first : first + n]
    line = _find_line(rows, row, n)
    for c in range(n):
        line[c] = block[c]


@compiled
def _write(rows: Array, row: int, values: Array, first: int, n: int) -> None:
    """Set the ``values`` (n_c,) of n contacts from the ``first`` on to a row."""
    block = values[first : first + n]
    line = _find_line(rows, row, n)
    for c in range(n):
        block[c] = line[c]


@compiled
def _read_lines(rows: Array, row: int, values: Array, start: int, first: int, n: int) -> None:
    """Set rows that follow each other, the first of which is ``row``, to the ``values`` (lines,
    n_c) of n contacts from the ``first`` on, without the lines before ``start``.
    """
    for line in range(start, len(values)):
        _read(rows, row + (line - start) * CHUNK, values[line], first, n)


@compiled
def _write_lines(rows: Array, row: int, values: Array, start: int, first: int, n: int) -> None:
    """Set the ``values`` (lines, n_c) of n contacts from the ``first`` on, without the lines before
    ``start``, to rows that follow each other, the first of which is ``row``.
    """
    for line in range(start, len(values)):
        _write(rows, row + (line - start) * CHUNK, values[line], first, n)


@compiled
def _gather(
    rows: Array,
    ends: tuple[NDArray[np.uint32], NDArray[np.uint32]],
    before: Array,
    after: Array,
    axes: NDArray[np.int64],
    first: int,
    n: int,
) -> None:
    """Set the rows of the displacement of ball j less that of ball i, before and after the step,
    and of the rotations of both balls in the step.

    ``before`` and ``after`` (n_balls, m) are the motions of all balls along ``axes`` (m,), 0 to 2
    of displacements, 3 to 5 of rotations. ``ends`` are the numbers (n_c,) of balls i and balls j.
    """
    balls_i = ends[0][first : first + n]
    balls_j = ends[1][first : first + n]
    for motion in range(len(axes)):
        axis = axes[motion]
        if axis < 3:
            start = _find_line(rows, _MOVE_START + axis * CHUNK, n)
            end = _find_line(rows, _MOVE_END + axis * CHUNK, n)
            for c in range(n):
                i = balls_i[c]
                j = balls_j[c]
                start[c] = before[j, motion] - before[i, motion]
                end[c] = after[j, motion] - after[i, motion]
        else:
            of_i = _find_line(rows, _TURN_I + (axis - 3) * CHUNK, n)
            of_j = _find_line(rows, _TURN_J + (axis - 3) * CHUNK, n)
            for c in range(n):
                i = balls_i[c]
                j = balls_j[c]
                of_i[c] = after[i, motion] - before[i, motion]
                of_j[c] = after[j, motion] - before[j, motion]


@compiled
def _gather_speeds(
    rows: Array,
    ends: tuple[NDArray[np.uint32], NDArray[np.uint32]],
    speeds: Array,
    axes: NDArray[np.int64],
    first: int,
    n: int,
) -> None:
    """Set the rows of displacements before the step to the velocity of ball j less that of ball i,
    and the rows of rotations to the spins of both balls. ``speeds`` (n_balls, m) are those of all
    balls; ``ends`` and ``axes`` are those of :func:`_gather`.
    """
    balls_i = ends[0][first : first + n]
    balls_j = ends[1][first : first + n]
    for motion in range(len(axes)):
        axis = axes[motion]
        for c in range(n):
            speed_i = speeds[balls_i[c], motion]
            speed_j = speeds[balls_j[c], motion]
            if axis < 3:
                rows[_MOVE_START + axis * CHUNK + c] = speed_j - speed_i
            else:
                rows[_TURN_I + (axis - 3) * CHUNK + c] = speed_i
                rows[_TURN_J + (axis - 3) * CHUNK + c] = speed_j


@compiled
def _scatter(
    rows: Array,
    ends: tuple[NDArray[np.uint32], NDArray[np.uint32]],
    forces: Array,
    axes: NDArray[np.int64],
    first: int,
    n: int,
) -> None:
    """Add the rows of forces and torques on balls i and j to the ``forces`` (n_balls, m) on all
    balls; ``ends`` and ``axes`` are those of :func:`_gather`.
    """
    balls_i = ends[0][first : first + n]
    balls_j = ends[1][first : first + n]
    for motion in range(len(axes)):
        on_i = _find_line(rows, _ON_I + axes[motion] * CHUNK, n)
        on_j = _find_line(rows, _ON_J + axes[motion] * CHUNK, n)
        for c in range(n):
            forces[balls_i[c], motion] += on_i[c]
            forces[balls_j[c], motion] += on_j[c]


# -- a chunk of n contacts -------------------------------------------------------------------------


@compiled
def _deform_straight(rows: Array, n: int) -> None:
    """Find the elongations before and after the step, and the slips of the step, of contacts that
    keep their directions; forces act along these.
    """
    for c in range(min(n, CHUNK)):
        normal = _get_vector(rows, REST + c)
        gap = rows[GAP + c]
        start = _get_vector(rows, _MOVE_START + c)
        end = _get_vector(rows, _MOVE_END + c)
        # the arms: other levers, which _find_levers gives, come only with contacts that turn
        levers = (rows[ARM_I + c], rows[ARM_J + c])
        turn_i = _get_vector(rows, _TURN_I + c)
        turn_j = _get_vector(rows, _TURN_J + c)
        rows[_E_START + c] = gap + dot(normal, start)
        rows[_E + c] = gap + dot(normal, end)
        move = add(end, -1.0, start)
        _set_vector(rows, _SIDES + c, _find_slip(move, turn_i, turn_j, levers, normal, normal))
        _set_vector(rows, _R + c, normal)


@compiled
def _lengthen(length: float, is_free: float, square: float) -> tuple[float, float, float]:
    """Return |r|, 1/|r| and the elongation ``square``/(|r| + |r_0|), without a difference of
    near-equal lengths.

    ``length`` is |r_0|, the length of r at rest. r is r_0 + ``is_free`` w, with ``is_free`` one or
    zero, and ``square`` is (r_0 + r).w. If r is free, the elongation is |r| - |r_0|; otherwise it
    is r_0.w, as r is then a unit vector.
    """
    r_length = math.sqrt(length * length + is_free * square)
    # both results from one division
    total_length = length + r_length
    quotient = 1.0 / (r_length * total_length)
    return r_length, total_length * quotient, square * (r_length * quotient)


# Of the next three functions each is so short that compilers put all that it calls into its loop.


@compiled
def _find_starts(rows: Array, n: int) -> None:
    """Find the directions and elongations before the step of contacts that turn. For later, the row
    of the |r| with which forces act is set to |r| before the step, and that of the mean of r to r
    before the step.
    """
    for c in range(min(n, CHUNK)):
        r_at_rest = _get_vector(rows, REST + c)
        is_free = rows[IS_FREE + c]
        move = _get_vector(rows, _MOVE_START + c)
        r = add(r_at_rest, is_free, move)
        square = dot(add(r_at_rest, 1.0, r), move)
        length, over, elongation = _lengthen(rows[LENGTH + c], is_free, square)
        rows[_E_START + c] = rows[GAP + c] + elongation
        _set_vector(rows, _NORMAL_START + c, scale(over, r))
        _set_vector(rows, _R_MIDDLE + c, r)
        rows[_R_LENGTH + c] = length


@compiled
def _find_ends(rows: Array, n: int, is_mean: bool) -> None:
    """Find r, its directions and the elongations after the step of contacts that turn, after
    :func:`_find_starts`; forces will act with the mean of |r| if ``is_mean``.
    """
    for c in range(min(n, CHUNK)):
        r_at_rest = _get_vector(rows, REST + c)
        is_free = rows[IS_FREE + c]
        move = _get_vector(rows, _MOVE_END + c)
        r = add(r_at_rest, is_free, move)
        square = dot(add(r_at_rest, 1.0, r), move)
        length, over, elongation = _lengthen(rows[LENGTH + c], is_free, square)
        rows[_E + c] = rows[GAP + c] + elongation
        _set_vector(rows, _NORMAL_END + c, scale(over, r))
        _set_vector(rows, _R + c, r)
        mean_length = 0.5 * (rows[_R_LENGTH + c] + length)
        rows[_R_LENGTH + c] = mean_length if is_mean else length


@compiled
def _find_middles(rows: Array, n: int) -> None:
    """Find the means of r before and after the step, and their directions, after
    :func:`_find_ends`.
    """
    for c in range(min(n, CHUNK)):
        start = _get_vector(rows, _R_MIDDLE + c)
        middle = scale(0.5, add(start, 1.0, _get_vector(rows, _R + c)))
        normal = scale(1.0 / math.sqrt(dot(middle, middle)), middle)
        _set_vector(rows, _NORMAL_MIDDLE + c, normal)
        _set_vector(rows, _R_MIDDLE + c, middle)


@compiled
def _find_directions(rows: Array, n: int, is_mean: bool) -> None:
    """Find r, its directions and the elongations, before and after the step, of contacts that turn.

    Forces will act with the mean of r if ``is_mean``, and otherwise with r after the step.
    """
    _find_starts(rows, n)
    _find_ends(rows, n, is_mean)
    _find_middles(rows, n)
    if is_mean:
        for axis in range(3):
            _copy(rows, n, _R_MIDDLE + axis * CHUNK, _R + axis * CHUNK)


@compiled
def _slip_turning(rows: Array, n: int) -> None:
    """Find the slips of the step, and the angles by which forces turn about n in half of it, of
    contacts that turn.
    """
    for c in range(min(n, CHUNK)):
        turn_i = _get_vector(rows, _TURN_I + c)
        turn_j = _get_vector(rows, _TURN_J + c)
        normal = _get_vector(rows, _NORMAL_MIDDLE + c)
        r = _get_vector(rows, _R_MIDDLE + c)
        levers = _find_levers(rows, c, r, normal)
        move = add(_get_vector(rows, _MOVE_END + c), -1.0, _get_vector(rows, _MOVE_START + c))
        _set_vector(rows, _SIDES + c, _find_slip(move, turn_i, turn_j, levers, r, normal))
        # the mean spin of both balls, over four: half of the angle in half of the step. It is taken
        # for the tangent of itself, from which the cosine follows without a loop of angles
        half_tangent = 0.125 * dot(normal, add(turn_i, 1.0, turn_j))
        rows[_HALF_TANGENT + c] = half_tangent
        rows[_ONE_PLUS_COSINE + c] = 2.0 / (1.0 + half_tangent * half_tangent)


@compiled
def _turn_to_middle(rows: Array, place: int, c: int) -> None:
    """Turn a vector across contact c, whose first component is at a ``place`` of the rows, with the
    contact from the start of the step to its middle; see :func:`_turn_force`.
    """
    start = _get_vector(rows, _NORMAL_START + c)
    middle = _get_vector(rows, _NORMAL_MIDDLE + c)
    force = _get_vector(rows, place)
    _set_vector(
        rows,
        place,
        _turn_force(force, start, middle, rows[_HALF_TANGENT + c], rows[_ONE_PLUS_COSINE + c]),
    )


@compiled
def _turn_to_end(rows: Array, place: int, c: int) -> None:
    """Turn a vector across contact c, whose first component is at a ``place`` of the rows, with the
    contact from the middle of the step to its end; see :func:`_turn_force`.
    """
    middle = _get_vector(rows, _NORMAL_MIDDLE + c)
    end = _get_vector(rows, _NORMAL_END + c)
    force = _get_vector(rows, place)
    _set_vector(
        rows,
        place,
        _turn_force(force, middle, end, rows[_HALF_TANGENT + c], rows[_ONE_PLUS_COSINE + c]),
    )


@compiled
def _turn_held(rows: Array, n: int, can_roll: bool) -> None:
    """Turn the forces against slip, and against roll if ``can_roll``, from the start of the step to
    its middle.
    """
    for c in range(min(n, CHUNK)):
        _turn_to_middle(rows, _PULL_START + c, c)
    if can_roll:
        for c in range(min(n, CHUNK)):
            _turn_to_middle(rows, _PULL_START + _ROLL + c, c)


@compiled
def _turn_pull(rows: Array, n: int, can_roll: bool) -> None:
    """Turn the forces against slip, and against roll if ``can_roll``, from the middle of the step
    to its end.
    """
    for c in range(min(n, CHUNK)):
        _turn_to_end(rows, _PULL + c, c)
    if can_roll:
        for c in range(min(n, CHUNK)):
            _turn_to_end(rows, _PULL + _ROLL + c, c)


@compiled
def _deform_turning(rows: Array, n: int, is_mean: bool, can_roll: bool) -> None:
    """Find how contacts that turn deform in the step, and turn the forces against slip, and against
    roll if ``can_roll``, to its middle. ``is_mean`` is that of :func:`_find_directions`.
    """
    _find_directions(rows, n, is_mean)
    _slip_turning(rows, n)
    _turn_held(rows, n, can_roll)


@compiled
def _roll(rows: Array, n: int, can_turn: bool) -> None:
    """Find the twists and rolls of the step, about and across n in the middle of the step if
    contacts turn (``can_turn``), and otherwise n at rest.
    """
    for c in range(min(n, CHUNK)):
        normal = _get_vector(rows, _NORMAL_MIDDLE + c) if can_turn else _get_vector(rows, REST + c)
        roll = add(_get_vector(rows, _TURN_J + c), -1.0, _get_vector(rows, _TURN_I + c))
        twist = dot(normal, roll)
        rows[_SIDES + _TWIST + c] = twist
        _set_vector(rows, _SIDES + _ROLL + c, add(roll, -twist, normal))


@compiled
def _find_hertz_forces(rows: Array, n: int) -> None:
    """Find f - f_0 after the step by Hertz's law, without a difference of near-equal forces; the
    stiffnesses after the step; and the stiffness of a flat punch before the step.
    """
    for c in range(min(n, CHUNK)):
        coefficient = rows[COEFFICIENT + c]
        overlap = rows[OPENING + c]
        loss = min(rows[_E + c], overlap)  # of the overlap, until the contact opens
        root = math.sqrt(overlap - loss)
        # (y^(3/2) - h^(3/2))/(y - h) = h^(1/2) + y/(h^(1/2) + y^(1/2)), y being the overlap at rest
        # and h that after the step
        factor = root + overlap / (root + rows[ROOT + c])
        rows[_CHANGE + c] = -coefficient * (loss * factor)
        stiffness = coefficient * _STIFFNESS * root
        rows[_K + c] = stiffness
        rows[_PUNCH + c] = stiffness
        root = math.sqrt(max(overlap - rows[_E_START + c], 0.0))
        rows[_PUNCH_START + c] = coefficient * _STIFFNESS * root


@compiled
def _find_shears(rows: Array, n: int, mu: float, is_total: bool) -> None:
    """Find the forces T against slip at the end of the step, and the work that slip takes up in the
    step. Forces before and after the step are both turned to its middle. ``mu`` and ``is_total``
    are those of :class:`Rules`.

    The law is that of :mod:`granphon.contacts.motion`: dT = k_t ds while a contact widens, and
    T/k_t is kept while it narrows. T beyond Coulomb's limit is shortened to the limit. If
    ``is_total``, the sum of T and the dashpot's force is shortened in place of T, and the limit
    includes the force of the normal dashpot. The sum is left as it is where a contact is open after
    the step: there T is zero, and only the dashpot may act, for the part of the step before.
    """
    can_slide = mu < math.inf
    for c in range(min(n, CHUNK)):
        start_punch = rows[_PUNCH_START + c]
        punch = rows[_PUNCH + c]
        least = min(punch, start_punch)
        # the share of the force before the step that the law keeps: all of it where the contact
        # widens, in proportion to the stiffness where it narrows, nothing where it was open
        kept_share = least / max(start_punch, _LEAST_DIVISOR)
        # the mean stiffness of a step in which the contact widens; that at its end otherwise
        stiffness = 0.5 * (least + punch) * rows[SLIP_RATIO + c]
        sides = _get_vector(rows, _SIDES + c)
        held = _get_vector(rows, _PULL_START + c)
        pull = add(scale(kept_share, held), stiffness, sides)
        if can_slide and not is_total:
            limit = mu * max(rows[_CHANGE + c] + rows[FORCE + c], 0.0)
            size = math.sqrt(dot(pull, pull))
            pull = scale(limit / size if size > limit else 1.0, pull)
        if can_slide and is_total:
            limit = mu * abs(rows[_CHANGE + c] + rows[FORCE + c] + rows[_DASH + c])
            dash = _get_vector(rows, _DASH + CHUNK + c)
            total = add(pull, 1.0, dash)
            size = math.sqrt(dot(total, total))
            if size > limit and punch > 0.0:
                pull = add(scale(limit / size, total), -1.0, dash)
        _set_vector(rows, _PULL + c, pull)
        rows[_WORK + c] = 0.5 * dot(add(pull, 1.0, held), sides)


@compiled
def _find_roll_torques(rows: Array, n: int) -> None:
    """Find the torques against twist and roll at the end of the step, by the law of
    :func:`_find_shears` without a limit, and add the work that twist and roll take up.
    """
    for c in range(min(n, CHUNK)):
        start_punch = rows[_PUNCH_START + c]
        punch = rows[_PUNCH + c]
        least = min(punch, start_punch)
        kept_share = least / max(start_punch, _LEAST_DIVISOR)
        stiffness = 0.5 * (least + punch)
        twist = rows[_SIDES + _TWIST + c]
        held_twist = rows[_PULL_START + _TWIST + c]
        pull_twist = kept_share * held_twist + stiffness * rows[TWIST_RATIO + c] * twist
        roll = _get_vector(rows, _SIDES + _ROLL + c)
        held = _get_vector(rows, _PULL_START + _ROLL + c)
        pull = add(scale(kept_share, held), stiffness * rows[ROLL_RATIO + c], roll)
        rows[_PULL + _TWIST + c] = pull_twist
        _set_vector(rows, _PULL + _ROLL + c, pull)
        work = (pull_twist + held_twist) * twist + dot(add(pull, 1.0, held), roll)
        rows[_WORK + c] = rows[_WORK + c] + 0.5 * work


@compiled
def _find_means(rows: Array, n: int) -> None:
    """Find the means of the forces against slip, twist and roll before and after the step, both
    turned to its middle.
    """
    for row in range(0, _SIDES_LENGTH, CHUNK):
        for c in range(min(n, CHUNK)):
            held = rows[_PULL_START + row + c]
            rows[_PULL_MEAN + row + c] = 0.5 * (held + rows[_PULL + row + c])


@compiled
def _take_mean(rows: Array, n: int) -> None:
    """Set the rows of forces that act to the means of :func:`_find_means`."""
    for row in range(0, _SIDES_LENGTH, CHUNK):
        for c in range(min(n, CHUNK)):
            rows[_PULL + row + c] = rows[_PULL_MEAN + row + c]


@compiled
def _take_mean_rates(rows: Array, n: int, step: float) -> None:
    """Find the mean rates of elongation, slip, twist and roll in a ``step``, s."""
    for c in range(min(n, CHUNK)):
        rows[_RATE + c] = (rows[_E + c] - rows[_E_START + c]) / step
    for row in range(0, _SIDES_LENGTH, CHUNK):
        for c in range(min(n, CHUNK)):
            rows[_RATES + row + c] = rows[_SIDES + row + c] / step


@compiled
def _take_rates(rows: Array, n: int, can_turn: bool) -> None:
    """Find the rates of elongation, slip, twist and roll after the step, from the velocities and
    spins of :func:`_gather_speeds`; ``can_turn`` is that of :class:`Rules`.
    """
    for c in range(min(n, CHUNK)):
        r = _get_vector(rows, _R + c)
        normal = _get_vector(rows, _NORMAL_END + c) if can_turn else r
        velocity = _get_vector(rows, _MOVE_START + c)
        spin_i = _get_vector(rows, _TURN_I + c)
        spin_j = _get_vector(rows, _TURN_J + c)
        levers = _find_levers(rows, c, r, normal)
        rows[_RATE + c] = dot(normal, velocity)
        _set_vector(rows, _RATES + c, _find_slip(velocity, spin_i, spin_j, levers, r, normal))
        roll = add(spin_j, -1.0, spin_i)
        twist = dot(normal, roll)
        rows[_RATES + _TWIST + c] = twist
        _set_vector(rows, _RATES + _ROLL + c, add(roll, -twist, normal))


@compiled
def _set_dash_shares(rows: Array, n: int, is_mean: bool, can_pull: bool) -> None:
    """Set the share of its constant viscosities with which the dashpot of each contact acts: one
    where the contact stays closed, zero where it stays open. If ``is_mean``, the share is that of
    the mean force of the step, and otherwise that of the force after the step; ``can_pull`` is that
    of :class:`Rules`.

    A contact that opens or closes is closed in a part s of the step, which is the share of the mean
    force. The force after the step acts in the last half of the step and in the first half of the
    next step, and is to do what a force does that jumps as the contact opens or closes. Where the
    contact closes, the share is s + 1/2: s for the step, 1/2 for the next. Where the contact opens,
    it is s - 1/2: the force before the step has acted in the first half. It is zero where a contact
    opens and the dashpot must not pull.
    """
    for c in range(min(n, CHUNK)):
        was_closed = rows[_PUNCH_START + c] > 0.0
        is_closed = rows[_PUNCH + c] > 0.0
        closed_travel = max(rows[OPENING + c] - min(rows[_E_START + c], rows[_E + c]), 0.0)
        travel = abs(rows[_E + c] - rows[_E_START + c])
        share = min(closed_travel / max(travel, _LEAST_DIVISOR), 1.0)
        if not is_mean:
            share += 0.5 if is_closed else -0.5
            share = share if is_closed or can_pull else 0.0
        steady_share = 1.0 if is_closed else 0.0
        rows[_SHARE + c] = steady_share if was_closed == is_closed else share


@compiled
def _find_dash(rows: Array, n: int, is_mean: bool, can_pull: bool) -> None:
    """Find the forces of dashpots after the step, or their means over the step if ``is_mean``.
    Unless ``can_pull``, the pull of the normal dashpot is at most the push of the law.
    """
    for c in range(min(n, CHUNK)):
        k = 0.5 * (rows[_K_START + c] + rows[_K + c]) if is_mean else rows[_K + c]
        punch = 0.5 * (rows[_PUNCH_START + c] + rows[_PUNCH + c]) if is_mean else rows[_PUNCH + c]
        root = rows[ROOT_DASHPOT + c] * math.sqrt(k)
        normal_constant = root + rows[_SHARE + c] * rows[NORMAL_DASHPOT + c]
        dash = -(rows[NORMAL_TIME + c] * k + normal_constant) * rows[_RATE + c]
        if not can_pull:
            dash = max(dash, -max(rows[_PRESSURE + c] + rows[FORCE + c], 0.0))
        rows[_DASH + c] = dash
        ratio = rows[SLIP_RATIO + c]
        side_constant = root + rows[_SHARE + c] * rows[SIDE_DASHPOT + c]
        # a contact that does not resist slip has no dashpot against it
        over_ratio = side_constant / ratio if ratio > 0.0 else 0.0
        rows[_VISCOSITY + c] = rows[SIDE_TIME + c] * punch + over_ratio
    for row in range(0, _SIDES_LENGTH, CHUNK):
        if row < _TWIST:
            ratio_row = SLIP_RATIO
        elif row < _ROLL:
            ratio_row = TWIST_RATIO
        else:
            ratio_row = ROLL_RATIO
        for c in range(min(n, CHUNK)):
            viscosity = rows[_VISCOSITY + c] * rows[ratio_row + c]
            rows[_DASH + CHUNK + row + c] = viscosity * rows[_RATES + row + c]


@compiled
def _add_dash(rows: Array, n: int, is_mean: bool) -> None:
    """Add the forces of dashpots to the forces that act, and find the energy that dashpots take up
    in the step. The force that takes it up is the mean force of the step if ``is_mean``, and
    otherwise the mean of the forces before and after the step.
    """
    for c in range(min(n, CHUNK)):
        dash = rows[_DASH + c]
        rows[_CHANGE + c] = rows[_CHANGE + c] + dash
        mean = dash if is_mean else 0.5 * (rows[_DASH_START + c] + dash)
        rows[_LOSS + c] = mean * (rows[_E_START + c] - rows[_E + c])
    for row in range(0, _SIDES_LENGTH, CHUNK):
        for c in range(min(n, CHUNK)):
            dash = rows[_DASH + CHUNK + row + c]
            mean = dash if is_mean else 0.5 * (rows[_DASH_START + CHUNK + row + c] + dash)
            rows[_PULL + row + c] += dash
            rows[_LOSS + c] += mean * rows[_SIDES + row + c]


@compiled
def _find_ball_forces(rows: Array, n: int, can_turn: bool, can_roll: bool) -> None:
    """Find the forces and torques on both balls of each contact, from the normal force and the
    forces against slip and, if ``can_roll``, against twist and roll. The normal force is the whole
    one if contacts turn (``can_turn``), and its change f - f_0 otherwise.
    """
    for c in range(min(n, CHUNK)):
        r = _get_vector(rows, _R + c)
        pull = _get_vector(rows, _PULL + c)
        push = rows[_CHANGE + c]
        if can_turn:
            push = (push + rows[FORCE + c]) / rows[_R_LENGTH + c]
        force = add(scale(push, r), -1.0, pull)
        moment = cross(r, pull)
        _set_vector(rows, _ON_I + c, scale(-1.0, force))
        _set_vector(rows, _ON_J + c, force)
        _set_vector(rows, _ON_I_TORQUE + c, scale(rows[ARM_I + c], moment))
        _set_vector(rows, _ON_J_TORQUE + c, scale(rows[ARM_J + c], moment))
        if can_roll:
            twist = rows[_PULL + _TWIST + c] / math.sqrt(dot(r, r))
            roll = add(_get_vector(rows, _PULL + _ROLL + c), twist, r)
            _set_vector(rows, _ON_I_TORQUE + c, add(_get_vector(rows, _ON_I_TORQUE + c), 1.0, roll))
            _set_vector(
                rows, _ON_J_TORQUE + c, add(_get_vector(rows, _ON_J_TORQUE + c), -1.0, roll)
            )


@compiled
def _copy(rows: Array, n: int, row: int, copy: int) -> None:
    """Set the row ``copy`` to the numbers of the row ``row``."""
    line = _find_line(rows, row, n)
    line_of_copy = _find_line(rows, copy, n)
    for c in range(n):
        line_of_copy[c] = line[c]


@compiled
def _sum(rows: Array, n: int, row: int, sums: Array) -> None:
    """Add the numbers of a row to ``sums`` (CHUNK,)."""
    line = _find_line(rows, row, n)
    for c in range(n):
        sums[c] += line[c]


@compiled
def _add_up(numbers: Array) -> float:
    """Return the sum of the ``numbers`` (n,), which are added one after the other."""
    total = 0.0
    for place in range(len(numbers)):
        total += numbers[place]
    return total


@compiled
def _keep_greatest(rows: Array, n: int, row: int, greatest: Array) -> None:
    """Replace each number of ``greatest`` (CHUNK,) by that of a row where this is greater."""
    line = _find_line(rows, row, n)
    for c in range(n):
        greatest[c] = max(greatest[c], line[c])


# -- parts of a step of n contacts, from the first on ----------------------------------------------


@compiled
def _deform(rows: Array, n: int, can_turn: bool, is_mean: bool, can_roll: bool) -> None:
    """Find elongations, the slips of the step and, if ``can_roll``, its twists and rolls; turn the
    forces before the step to its middle if contacts turn (``can_turn``). ``is_mean`` is that of
    :func:`_find_directions`.
    """
    if can_turn:
        _deform_turning(rows, n, is_mean, can_roll)
    else:
        _deform_straight(rows, n)
    if can_roll:
        _roll(rows, n, can_turn)


@compiled
def _read_mean_rates(rows: Array, mean: Array, k: Array, length: float, first: int, n: int) -> None:
    """Set what dashpots need for their mean forces in a step of a ``length``, s: the mean rates,
    the ``mean`` (n_c,) of f - f_0, and the normal stiffnesses ``k`` (n_c,) before the step.
    """
    _read(rows, _K_START, k, first, n)
    _read(rows, _PRESSURE, mean, first, n)
    _take_mean_rates(rows, n, length)


@compiled
def _read_rates(
    rows: Array,
    ends: tuple[NDArray[np.uint32], NDArray[np.uint32]],
    speeds: Array,
    axes: NDArray[np.int64],
    can_turn: bool,
    first: int,
    n: int,
) -> None:
    """Set what dashpots need for their forces after the step: the rates, and f - f_0. ``speeds``,
    ``ends`` and ``axes`` are those of :func:`_gather_speeds`, and ``can_turn`` is that of
    :class:`Rules`.
    """
    _copy(rows, n, _CHANGE, _PRESSURE)
    _gather_speeds(rows, ends, speeds, axes, first, n)
    _take_rates(rows, n, can_turn)


@compiled
def _replace_dash(
    rows: Array, dash: Array, is_mean: bool, can_pull: bool, first: int, n: int
) -> None:
    """Replace the forces of dashpots before the step in ``dash`` (4 or 8, n_c) by those after the
    step, or by their means over the step if ``is_mean``. The rows of both are set too. ``can_pull``
    is that of :class:`Rules`.
    """
    _read_lines(rows, _DASH_START, dash, 0, first, n)
    _set_dash_shares(rows, n, is_mean, can_pull)
    _find_dash(rows, n, is_mean, can_pull)
    _write_lines(rows, _DASH, dash, 0, first, n)


@compiled
def _resist(rows: Array, n: int, mu: float, is_total: bool, can_roll: bool) -> None:
    """Find the forces against slip at the end of the step and, if ``can_roll``, the torques against
    twist and roll, and the work that all of these take up. ``mu`` and ``is_total`` are those of
    :class:`Rules`.
    """
    _find_shears(rows, n, mu, is_total)
    if can_roll:
        _find_roll_torques(rows, n)


# -- all contacts ----------------------------------------------------------------------------------


@compiled
def measure(contacts: Columns, motions: Array, can_turn: bool, e: Array) -> None:
    """Set ``e`` (n_c,) to the elongations since rest of ``contacts`` whose balls have the
    ``motions`` (n_balls, m) since rest; ``can_turn`` is that of :class:`Rules`.
    """
    ends = (contacts.i, contacts.j)
    rows = _make_rows(contacts.shared)
    for first in range(0, len(e), CHUNK):
        n = min(CHUNK, len(e) - first)
        _read_separate(rows, contacts.separate, contacts.lines, first, n)
        _gather(rows, ends, motions, motions, contacts.axes, first, n)
        if can_turn:
            _find_directions(rows, n, False)
        else:
            _deform_straight(rows, n)
        _write(rows, _E, e, first, n)


@compiled
def follow(
    contacts: Columns, rules: Rules, before: Moment, after: Moment, step: Step, forces: Array
) -> tuple[float, float, float]:
    """Set the forces across contacts after a step, and the forces on balls. Return three numbers:
    the energy, J, that slip, twist and roll take up in the step; the energy, J, that dashpots take
    up; and the greatest stiffness, N/m, of a flat punch after the step, zero without contacts.

    Parameters
    ----------
    contacts, rules : the contacts, and what holds for all of them.
    before, after : moments before and after the step. The motions of both are read, and the forces
        across contacts before the step. Forces across contacts after the step are set; both moments
        may share the array ``pull``. Unless loops know Hertz's law, normal forces and stiffnesses
        after the step are read, and stiffnesses of punches before the step. With means and
        dashpots, normal stiffnesses before the step are read too. Nothing else is set.
    step : the step; its ``dash`` is replaced.
    forces : (n_balls, m) forces and torques on balls, set.
    """
    ends = (contacts.i, contacts.j)
    # arrays of a tuple are taken out of it before the loop: in the loop this takes time
    axes = contacts.axes
    separate = contacts.separate
    lines = contacts.lines
    motions_before = before.motions
    motions_after = after.motions
    pull_before = before.pull
    pull_after = after.pull
    mean = step.mean
    speeds = step.speeds
    dash = step.dash
    is_mean = len(mean) > 0
    is_damped = dash.shape[1] > 0
    # behind the rows of the normal force and of the forces against slip are those of torques
    can_roll = len(pull_before) > 4
    rows = _make_rows(contacts.shared)
    work = np.zeros(CHUNK)
    loss = np.zeros(CHUNK)
    stiffest = np.zeros(CHUNK)
    forces[:] = 0.0
    n_contacts = len(contacts.i)
    for first in range(0, n_contacts, CHUNK):
        n = min(CHUNK, n_contacts - first)
        _read_separate(rows, separate, lines, first, n)
        _gather(rows, ends, motions_before, motions_after, axes, first, n)
        _read_lines(rows, _PULL_START, pull_before, 1, first, n)
        _deform(rows, n, rules.can_turn, is_mean, can_roll)
        if rules.is_hertz:
            _find_hertz_forces(rows, n)
        else:
            _read(rows, _CHANGE, pull_after[0], first, n)
            _read(rows, _K, after.k, first, n)
            _read(rows, _PUNCH_START, before.punch, first, n)
            _read(rows, _PUNCH, after.punch, first, n)
        _keep_greatest(rows, n, _PUNCH, stiffest)
        if is_damped:
            if is_mean:
                _read_mean_rates(rows, mean, before.k, step.length, first, n)
            else:
                _read_rates(rows, ends, speeds, axes, rules.can_turn, first, n)
            _replace_dash(rows, dash, is_mean, rules.can_pull, first, n)
        _resist(rows, n, rules.mu, rules.is_total, can_roll)
        _sum(rows, n, _WORK, work)
        if is_mean:
            _find_means(rows, n)
        if rules.can_turn:
            _turn_pull(rows, n, can_roll)
        _write_lines(rows, _PULL, pull_after, 1, first, n)
        if is_mean:
            _read(rows, _CHANGE, mean, first, n)
            _take_mean(rows, n)
        if is_damped:
            _add_dash(rows, n, is_mean)
            _sum(rows, n, _LOSS, loss)
        _find_ball_forces(rows, n, rules.can_turn, can_roll)
        _scatter(rows, ends, forces, axes, first, n)
    return _add_up(work), _add_up(loss), np.max(stiffest)


# -- all balls -------------------------------------------------------------------------------------


@compiled
def spread(x: Array, places: NDArray[np.int64], weights: Array, motions: Array) -> None:
    """Set the entries of ``motions`` (n_balls, m) at ``places`` in the flat array to the
    coordinates x times ``weights``; places, coordinates and weights are (size,).
    """
    flat = motions.reshape(motions.size)
    for place in range(len(x)):
        flat[places[place]] = weights[place] * x[place]


@compiled
def drift(
    x: Array, v: Array, acceleration: Array, step: float, x_after: Array, v_mean: Array
) -> None:
    """Set ``v_mean`` to the velocity v + a dt/2 in the middle of a ``step`` dt, s, and ``x_after``
    to the coordinates x + v_mean dt after it; all are (size,).
    """
    for place in range(len(x)):
        mean = v[place] + 0.5 * step * acceleration[place]
        v_mean[place] = mean
        x_after[place] = x[place] + step * mean


@compiled
def gather(
    forces: Array, places: NDArray[np.int64], weights: Array, steady: Array, acceleration: Array
) -> None:
    """Set ``acceleration`` to the entries of ``forces`` (n_balls, m) at ``places`` in the flat
    array, times ``weights``, plus the accelerations ``steady``; all but the forces are (size,).
    """
    flat = forces.reshape(forces.size)
    for place in range(len(acceleration)):
        acceleration[place] = weights[place] * flat[places[place]] + steady[place]


@compiled
def kick(v: Array, acceleration: Array, step: float) -> None:
    """Add ``acceleration`` times a ``step``, s, to the velocities v, (size,) each."""
    for place in range(len(v)):
        v[place] += step * acceleration[place]
