"""Compiled loops over the contacts of balls that slip and roll: what contacts measure and exert.

Balls have displacements u and rotations phi, (n_balls, 3), in a cell that the load compresses
evenly by an overlap y. The unit of u, y, slips and overlaps is the width W of the
diameters, and that of all other lengths the diameter: eps, the ``ratio`` of
:class:`~granphon.contacts.friction.RollingContacts`, is W over the diameter. The centres of a
contact whose direction at touch is e move against each other by

    v = u_j - u_i - y e

If the contact keeps its direction, it loses e.v of its overlap, and slips by s = v - (arm_i phi_i +
arm_j phi_j) x e across e. Otherwise w = e + eps v joins the centres, and the contact

    loses  (|w| - 1)/eps = (2 e.v + eps v.v)/(1 + |w|)
    slips by  ds = (1 - nn) dv - (arm_i dphi_i + arm_j dphi_j) x n,    n = w/|w|
    with the arms  |w|/2 -+ uneven

The slip from one configuration to the next is found with the exact angle by which n turns, and with
the means of the arms and of the tangents of both configurations. Its error is of second order in
the step. In a plane the slip depends on the way only as arms change along it.

The tangents of a contact turn from those at touch in two rotations: the smallest that takes e to n,
and one about n by the mean rotation of both balls about e.

The force on ball j is f n - T, and both balls bear the torque arm n x T. How a small motion changes
them is said in :mod:`granphon.contacts.rolling_tangent`.
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from numpy.typing import NDArray

from granphon.base.arrays import Array
from granphon.base.compiled import compiled
from granphon.contacts.friction import Configuration, RollingContacts
from granphon.contacts.vectors import Vector, add, add_to_row, cross, dot, get_row, scale, set_row

#: square of the tangent of an angle up to which the angle is the sum of the first three terms of
#: its series: the fourth is rounding
_SERIES_SQUARE = 1e-6
#: least divisor in place of 1 + n.e, which is zero if a step too long has turned a contact round
LEAST_DIVISOR = float(np.finfo(float).tiny)


@compiled
def list_motions(fields: NDArray[Any], axes: Array, displacement: Array, rotation: Array) -> None:
    """Set ``displacement`` and ``rotation`` (n_balls, 3) from ``fields`` (b, m, cells), the m
    motions of b balls of each cell.

    The first p of the m motions are displacements, which the matrix ``axes`` (p, p) takes to the
    axes of space; the others are rotations about all three axes, or a single one about the third.
    Components that no motion sets keep their values. The balls of all cells follow each other: ball
    b of cell c has the row b cells + c.
    """
    p = len(axes)
    cells = fields.shape[2]
    # the motion `first` is the rotation about the first axis, or would be if there were one:
    # rotations are about all axes, or about the third alone
    first = p if fields.shape[1] - p == 3 else p - 2
    for ball in range(len(fields)):
        place = ball * cells
        for axis in range(p):
            displacement[place : place + cells, axis] = 0.0
            for field in range(p):
                factor = axes[axis, field]
                for cell in range(cells):
                    displacement[place + cell, axis] += factor * fields[ball, field, cell]
        for field in range(p, fields.shape[1]):
            for cell in range(cells):
                rotation[place + cell, field - first] = fields[ball, field, cell]


@compiled
def collect_forces(force: Array, torque: Array, axes: Array, fields: NDArray[Any]) -> None:
    """Set ``fields`` (b, m, cells) to the forces that do work on the motions of
    :func:`list_motions`, from ``force`` and ``torque`` (n_balls, 3) on balls; ``axes`` (p, p) are
    those of that function.
    """
    p = len(axes)
    cells = fields.shape[2]
    # as in list_motions
    first = p if fields.shape[1] - p == 3 else p - 2
    for ball in range(len(fields)):
        place = ball * cells
        for field in range(p):
            fields[ball, field] = 0.0
            for axis in range(p):
                factor = axes[axis, field]
                for cell in range(cells):
                    fields[ball, field, cell] += factor * force[place + cell, axis]
        for field in range(p, fields.shape[1]):
            for cell in range(cells):
                fields[ball, field, cell] = torque[place + cell, field - first]


@compiled
def find_greatest_length(vectors: Array) -> float:
    """Return the greatest length among ``vectors`` (n, 3): zero if there are none, nan if a vector
    is nan.
    """
    greatest_square = 0.0
    for place in range(len(vectors)):
        vector = get_row(vectors, place)
        square = dot(vector, vector)
        if square > greatest_square or square != square:
            greatest_square = square
    return math.sqrt(greatest_square)


@compiled
def measure_straight(
    contacts: RollingContacts, at: Configuration, overlaps: Array, slips: Array
) -> None:
    """Set the ``overlaps`` (n_c,) and ``slips`` (n_s, n_c) of contacts that keep their directions,
    in the configuration ``at``. The first slip is that along the tangent t, and the second, in
    space, that along n x t.
    """
    overlap = at.overlap
    displacement = at.displacement
    rotation = at.rotation
    for c in range(len(overlaps)):
        i = contacts.i[c]
        j = contacts.j[c]
        n = get_row(contacts.normal, c)
        t = get_row(contacts.tangent, c)
        b = cross(n, t)
        # v but for -y n, which has no component across n
        across = add(get_row(displacement, j), -1.0, get_row(displacement, i))
        # the slip is that of v - turn x n
        turn = scale(0.5 - contacts.uneven[c], get_row(rotation, i))
        turn = add(turn, 0.5 + contacts.uneven[c], get_row(rotation, j))
        overlaps[c] = overlap + contacts.offset[c] - dot(n, across)
        slips[0, c] = dot(t, across) - dot(b, turn)
        if len(slips) == 2:
            slips[1, c] = dot(b, across) + dot(t, turn)


@compiled
def measure_turned(
    contacts: RollingContacts, at: Configuration, is_in_plane: bool, overlaps: Array
) -> None:
    """Set the ``overlaps`` (n_c,) of contacts that turn with their balls, and the arrays over
    contacts of the configuration ``at``, from its overlap y and its motions of balls.
    ``is_in_plane`` says whether balls stay in the plane of x and y.
    """
    overlap, displacement, rotation, normal, tangent, distance = at
    eps = contacts.ratio
    for c in range(len(overlaps)):
        i = contacts.i[c]
        j = contacts.j[c]
        e = get_row(contacts.normal, c)
        v = add(get_row(displacement, j), -1.0, get_row(displacement, i))
        v = add(v, -overlap, e)
        w = add(e, eps, v)
        length = math.sqrt(dot(w, w))
        # (w.w - 1)/eps, without a difference of numbers that are nearly equal
        square_change = 2.0 * dot(e, v) + eps * dot(v, v)
        overlaps[c] = contacts.offset[c] - square_change / (1.0 + length)
        n = (w[0] / length, w[1] / length, w[2] / length)
        set_row(normal, c, n)
        distance[c] = length
        if is_in_plane:
            set_row(tangent, c, (-n[1], n[0], 0.0))
            continue
        # the smallest rotation from e to n takes the tangent along
        t = get_row(contacts.tangent, c)
        t = add(t, -dot(t, n) / max(1.0 + dot(e, n), LEAST_DIVISOR), add(e, 1.0, n))
        # then the tangent turns about n by half of the sum of the rotations of both balls about e
        spin = dot(e, add(get_row(rotation, i), 1.0, get_row(rotation, j)))
        cosine = math.cos(0.5 * eps * spin)
        sine = math.sin(0.5 * eps * spin)
        set_row(tangent, c, add(scale(cosine, t), sine, cross(n, t)))


@compiled
def _find_angle(sine: float, cosine: float, eps: float) -> float:
    """Return an angle over ``eps``. ``sine`` is the sine of the angle over eps, and ``cosine`` the
    cosine of the angle; both may be multiplied by the same positive number.

    Small angles are found by the series of the arc tangent, so that ``eps`` may be zero. The cosine
    must not be zero.
    """
    slope = sine / cosine
    square = eps * eps * slope * slope
    if cosine > 0.0 and square < _SERIES_SQUARE:
        return slope * (1.0 - square / 3.0 + 0.2 * square * square)
    return math.atan2(eps * sine, cosine) / eps


def measure_slips(
    contacts: RollingContacts, before: Configuration, after: Configuration, slips: Array
) -> None:
    """Add to ``slips`` (n_s, n_c) those from the configuration ``before`` to the configuration
    ``after``, of contacts that turn with their balls. n_s is 1 in a plane; in space it is 2, and
    the second slip is that along n x t.
    """
    move = after.displacement - before.displacement
    turn = after.rotation - before.rotation
    overlap_change = after.overlap - before.overlap
    if len(slips) == 1:
        _measure_slips_in_plane(contacts, before, after, move, turn, overlap_change, slips[0])
    else:
        _measure_slips_in_space(contacts, before, after, move, turn, overlap_change, slips)


@compiled
def _measure_slips_in_plane(
    contacts: RollingContacts,
    before: Configuration,
    after: Configuration,
    move: Array,
    turn: Array,
    overlap_change: float,
    slips: Array,
) -> None:
    """Add to ``slips`` (n_c,) the slips of :func:`measure_slips` for balls in a plane.

    ``move`` and ``turn`` (n_balls, 3) are the changes of displacements and rotations, and
    ``overlap_change`` is that of y.
    """
    eps = contacts.ratio
    for c in range(len(slips)):
        i = contacts.i[c]
        j = contacts.j[c]
        # (x, y) is dv, and the directions before and after the step are (start_x, start_y) and
        # (end_x, end_y)
        x = move[j, 0] - move[i, 0] - overlap_change * contacts.normal[c, 0]
        y = move[j, 1] - move[i, 1] - overlap_change * contacts.normal[c, 1]
        start_x = before.normal[c, 0]
        start_y = before.normal[c, 1]
        end_x = after.normal[c, 0]
        end_y = after.normal[c, 1]
        mean_distance = 0.5 * (before.distance[c] + after.distance[c])
        # sine over eps and cosine of the angle by which n turns, times the distance after the step
        sine = start_x * y - start_y * x
        cosine = after.distance[c] * (start_x * end_x + start_y * end_y)
        slip = mean_distance * _find_angle(sine, cosine, eps)
        slip -= (0.5 * mean_distance - contacts.uneven[c]) * turn[i, 2]
        slip -= (0.5 * mean_distance + contacts.uneven[c]) * turn[j, 2]
        slips[c] += slip


@compiled
def _measure_slips_in_space(
    contacts: RollingContacts,
    before: Configuration,
    after: Configuration,
    move: Array,
    turn: Array,
    overlap_change: float,
    slips: Array,
) -> None:
    """Add to ``slips`` (2, n_c) the slips of :func:`measure_slips` for balls in space.

    ``move`` and ``turn`` (n_balls, 3) are the changes of displacements and rotations, and
    ``overlap_change`` is that of y.
    """
    eps = contacts.ratio
    for c in range(slips.shape[1]):
        i = contacts.i[c]
        j = contacts.j[c]
        change = add(get_row(move, j), -1.0, get_row(move, i))
        change = add(change, -overlap_change, get_row(contacts.normal, c))  # that of v
        start = get_row(before.normal, c)
        end = get_row(after.normal, c)
        mean_distance = 0.5 * (before.distance[c] + after.distance[c])
        # n turns about this axis; its length is the sine of the angle over eps, times the distance
        # after the step
        axis = cross(start, change)
        sine = math.sqrt(dot(axis, axis))
        factor = 0.0
        if sine > 0.0:
            cosine = after.distance[c] * dot(start, end)
            factor = mean_distance * _find_angle(sine, cosine, eps) / sine
        # the rotation of n times the distance, less the rotations of the balls times their arms;
        # the slip is that vector x n
        turn_of_surfaces = scale(factor, axis)
        arm_i = 0.5 * mean_distance - contacts.uneven[c]
        arm_j = 0.5 * mean_distance + contacts.uneven[c]
        turn_of_surfaces = add(turn_of_surfaces, -arm_i, get_row(turn, i))
        turn_of_surfaces = add(turn_of_surfaces, -arm_j, get_row(turn, j))
        tangent_before = get_row(before.tangent, c)
        tangent_after = get_row(after.tangent, c)
        # sums of each tangent before and after the step: twice their means
        tangents = add(tangent_before, 1.0, tangent_after)
        second_tangents = add(cross(start, tangent_before), 1.0, cross(end, tangent_after))
        slips[0, c] += 0.5 * dot(turn_of_surfaces, second_tangents)
        slips[1, c] -= 0.5 * dot(turn_of_surfaces, tangents)


@compiled
def _find_shear(n: Vector, t: Vector, shears: Array, c: int) -> Vector:
    """Return the tangential force T of the contact ``c`` along the axes of space; its components
    along the tangents ``t`` and n x t are in ``shears`` (n_s, n_c) of all contacts.
    """
    if len(shears) == 1:
        return scale(shears[0, c], t)
    return add(scale(shears[0, c], t), shears[1, c], cross(n, t))


@compiled
def add_forces(
    contacts: RollingContacts,
    at: Configuration,
    normal_force: Array,
    shears: Array,
    force: Array,
    torque: Array,
) -> None:
    """Add to ``force`` and ``torque`` (n_balls, 3) on balls the forces and torques of contacts in
    the configuration ``at``. ``normal_force`` (n_c,) are the normal forces f, and ``shears`` (n_s,
    n_c) the components of the tangential forces T.
    """
    for c in range(len(normal_force)):
        along_t = shears[0, c]
        along_b = shears[1, c] if len(shears) == 2 else 0.0
        if normal_force[c] == 0.0 and along_t == 0.0 and along_b == 0.0:
            continue
        i = contacts.i[c]
        j = contacts.j[c]
        n = get_row(at.normal, c)
        shear = _find_shear(n, get_row(at.tangent, c), shears, c)
        on_j = add(scale(normal_force[c], n), -1.0, shear)
        add_to_row(force, i, -1.0, on_j)
        add_to_row(force, j, 1.0, on_j)
        # the torque on either ball over its arm
        torque_per_arm = cross(n, shear)
        half = 0.5 * at.distance[c]
        add_to_row(torque, i, half - contacts.uneven[c], torque_per_arm)
        add_to_row(torque, j, half + contacts.uneven[c], torque_per_arm)


@compiled
def sum_works(
    contacts: RollingContacts, at: Configuration, normal_force: Array, shears: Array
) -> float:
    """Return the sum over contacts of (f n - T).e: the work of contacts per unit by which the
    overlap y falls, as balls j then move by e against balls i. ``normal_force`` (n_c,) are f, and
    ``shears`` (n_s, n_c) are the components of T.
    """
    total = 0.0
    for c in range(len(normal_force)):
        n = get_row(at.normal, c)
        shear = _find_shear(n, get_row(at.tangent, c), shears, c)
        on_j = add(scale(normal_force[c], n), -1.0, shear)
        total += dot(on_j, get_row(contacts.normal, c))
    return total


@compiled
def set_shear_vectors(at: Configuration, shears: Array, vectors: Array) -> None:
    """Set ``vectors`` (n_c, 3) to the tangential forces along the axes of space. Their components
    along the tangents t and n x t of the configuration ``at`` are ``shears`` (n_s, n_c).
    """
    for c in range(len(vectors)):
        n = get_row(at.normal, c)
        set_row(vectors, c, _find_shear(n, get_row(at.tangent, c), shears, c))
