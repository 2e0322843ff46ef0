"""Loops over the contacts of balls that slip and roll, compiled: what contacts measure, and what
they exert.

Balls have displacements u and rotations phi, (n, 3), in a cell that the load compresses evenly by
an overlap y. Lengths are over the diameter but for u, y and overlaps, which are smaller by the
``ratio`` eps: see :class:`~granphon.contacts.friction.RollingContacts`. A contact whose direction
at touch is e moves by

    v = u_j - u_i - y e

If it keeps its direction, it loses e.v of its overlap, and slips by s = v - (arm_i phi_i + arm_j
phi_j) x e across e. Otherwise the vector of the centres is w = e + eps v, and the contact

    loses  (|w| - 1)/eps = (2 e.v + eps v.v)/(1 + |w|)
    slips by  ds = (1 - nn) dv - (arm_i dphi_i + arm_j dphi_j) x n,    n = w/|w|
    with the arms  |w|/2 -+ uneven

From one configuration to the next the slip is found with the angle by which n turns, exact, and
with the means of arms and tangents at both ends. It is of second order in the step; in a plane it
depends on the way by nothing but the change of arms.

Tangents turn with n on the shortest way from e, and about n with the mean rotation of both balls
about e.

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

#: square of the slope of an angle whose series ends with the third term: the fourth is rounding
_SMALL = 1e-6
#: 1 + n.e of a contact that a step too long has turned round
ROUND = float(np.finfo(float).tiny)


@compiled
def list_motions(fields: NDArray[Any], axes: Array, displacement: Array, rotation: Array) -> None:
    """Set ``displacement`` and ``rotation`` (n, 3) of balls from ``fields`` (b, m, cells), the m
    motions of b balls of each cell.

    The first p of the m motions are displacements, which the matrix ``axes`` (p, p) takes to the
    axes of space; the others are rotations about all three axes, or a single one about the third.
    Components that no motion sets keep their values.
    """
    p = len(axes)
    cells = fields.shape[2]
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
    :func:`list_motions`, from ``force`` and ``torque`` (n, 3) on balls; ``axes`` (p, p) are the
    same.
    """
    p = len(axes)
    cells = fields.shape[2]
    # rotations are about all axes, or about the third alone
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
def find_largest(vectors: Array) -> float:
    """Return the largest length of ``vectors`` (n, 3); zero if there are none."""
    largest = 0.0
    for place in range(len(vectors)):
        x = vectors[place, 0]
        y = vectors[place, 1]
        z = vectors[place, 2]
        largest = max(largest, x * x + y * y + z * z)
    return math.sqrt(largest)


@compiled
def measure_straight(
    contacts: RollingContacts,
    displacement: Array,
    rotation: Array,
    overlap: float,
    overlaps: Array,
    slips: Array,
) -> None:
    """Set the ``overlaps`` (n_c,) and ``slips`` (n_s, n_c) of contacts that keep their directions,
    from ``displacement`` and ``rotation`` (n, 3) of balls and the ``overlap`` y. In space, the
    second slip is that along normal x tangent.
    """
    for c in range(len(overlaps)):
        i = contacts.i[c]
        j = contacts.j[c]
        n = get_row(contacts.normal, c)
        t = get_row(contacts.tangent, c)
        b = cross(n, t)
        moved = add(get_row(displacement, j), -1.0, get_row(displacement, i))
        # rotations move the surfaces at the contact against each other by r x n
        r = scale(0.5 - contacts.uneven[c], get_row(rotation, i))
        r = add(r, 0.5 + contacts.uneven[c], get_row(rotation, j))
        overlaps[c] = overlap + contacts.offset[c] - dot(n, moved)
        slips[0, c] = dot(t, moved) - dot(b, r)
        if len(slips) == 2:
            slips[1, c] = dot(b, moved) + dot(t, r)


@compiled
def measure_turned(
    contacts: RollingContacts,
    displacement: Array,
    rotation: Array,
    overlap: float,
    in_plane: bool,
    overlaps: Array,
    normal: Array,
    tangent: Array,
    distance: Array,
) -> None:
    """Set the ``overlaps`` and the ``distance`` (n_c,) of centres, and the unit vectors ``normal``
    and ``tangent`` (n_c, 3), of contacts that turn with their balls.

    ``displacement`` and ``rotation`` are (n, 3), and ``overlap`` is y. ``in_plane`` says whether
    balls stay in the plane of x and y.
    """
    eps = contacts.ratio
    for c in range(len(overlaps)):
        i = contacts.i[c]
        j = contacts.j[c]
        e = get_row(contacts.normal, c)
        v = add(get_row(displacement, j), -1.0, get_row(displacement, i))
        v = add(v, -overlap, e)
        # w joins the centres; its unit is the diameter
        w = add(e, eps, v)
        size = math.sqrt(dot(w, w))
        # (|w| - 1)/eps = grown/(1 + |w|), which subtracts no two numbers that are nearly equal
        grown = 2.0 * dot(e, v) + eps * dot(v, v)
        overlaps[c] = contacts.offset[c] - grown / (1.0 + size)
        n = (w[0] / size, w[1] / size, w[2] / size)
        set_row(normal, c, n)
        distance[c] = size
        if in_plane:
            set_row(tangent, c, (-n[1], n[0], 0.0))
            continue
        # the tangent goes along by the smallest rotation from e to n
        t = get_row(contacts.tangent, c)
        t = add(t, -dot(t, n) / max(1.0 + dot(e, n), ROUND), add(e, 1.0, n))
        # and turns about n by the mean of the spins of both balls
        spin = dot(e, add(get_row(rotation, i), 1.0, get_row(rotation, j)))
        cosine = math.cos(0.5 * eps * spin)
        sine = math.sin(0.5 * eps * spin)
        set_row(tangent, c, add(scale(cosine, t), sine, cross(n, t)))


@compiled
def _find_angle(sine: float, cosine: float, eps: float) -> float:
    """Return an angle over ``eps``. ``sine`` is the sine of the angle over eps, and ``cosine`` its
    cosine, both times the same positive number.

    Small angles are found by the series of the arc tangent, so that eps may be zero.
    """
    slope = sine / cosine
    square = eps * eps * slope * slope
    if cosine > 0.0 and square < _SMALL:
        return slope * (1.0 - square / 3.0 + 0.2 * square * square)
    return math.atan2(eps * sine, cosine) / eps


def measure_slips(
    contacts: RollingContacts, before: Configuration, after: Configuration, slips: Array
) -> None:
    """Add to ``slips`` (n_s, n_c) the slips of contacts, which turn with their balls, from the
    configuration ``before`` to the configuration ``after``; n_s is 1 in a plane, 2 in space.
    """
    moved = after.displacement - before.displacement
    turned = after.rotation - before.rotation
    overlap_change = after.overlap - before.overlap
    if len(slips) == 1:
        _measure_slips_in_plane(contacts, before, after, moved, turned, overlap_change, slips[0])
    else:
        _measure_slips_in_space(contacts, before, after, moved, turned, overlap_change, slips)


@compiled
def _measure_slips_in_plane(
    contacts: RollingContacts,
    before: Configuration,
    after: Configuration,
    moved: Array,
    turned: Array,
    overlap_change: float,
    slips: Array,
) -> None:
    """Add to ``slips`` (n_c,) the slips of :func:`measure_slips` of balls in a plane.

    ``moved`` and ``turned`` (n, 3) are the changes of displacements and rotations, and
    ``overlap_change`` is that of y.
    """
    eps = contacts.ratio
    for c in range(len(slips)):
        i = contacts.i[c]
        j = contacts.j[c]
        # (x, y) is dv, and the directions before and after the step are (start_x, start_y) and
        # (end_x, end_y)
        x = moved[j, 0] - moved[i, 0] - overlap_change * contacts.normal[c, 0]
        y = moved[j, 1] - moved[i, 1] - overlap_change * contacts.normal[c, 1]
        start_x = before.normal[c, 0]
        start_y = before.normal[c, 1]
        end_x = after.normal[c, 0]
        end_y = after.normal[c, 1]
        mean_distance = 0.5 * (before.distance[c] + after.distance[c])
        # sine over eps and cosine of the angle by which n turns, times the distance after the step
        sine = start_x * y - start_y * x
        cosine = after.distance[c] * (start_x * end_x + start_y * end_y)
        slip = mean_distance * _find_angle(sine, cosine, eps)
        slip -= (0.5 * mean_distance - contacts.uneven[c]) * turned[i, 2]
        slip -= (0.5 * mean_distance + contacts.uneven[c]) * turned[j, 2]
        slips[c] += slip


@compiled
def _measure_slips_in_space(
    contacts: RollingContacts,
    before: Configuration,
    after: Configuration,
    moved: Array,
    turned: Array,
    overlap_change: float,
    slips: Array,
) -> None:
    """Add to ``slips`` (2, n_c) the slips of :func:`measure_slips` of balls in space.

    ``moved`` and ``turned`` (n, 3) are the changes of displacements and rotations, and
    ``overlap_change`` is that of y.
    """
    eps = contacts.ratio
    for c in range(slips.shape[1]):
        i = contacts.i[c]
        j = contacts.j[c]
        v = add(get_row(moved, j), -1.0, get_row(moved, i))
        v = add(v, -overlap_change, get_row(contacts.normal, c))
        start = get_row(before.normal, c)
        end = get_row(after.normal, c)
        mean_distance = 0.5 * (before.distance[c] + after.distance[c])
        # n turns about this axis; its length is the sine of the angle over eps, times the distance
        # after the step
        axis = cross(start, v)
        sine = math.sqrt(dot(axis, axis))
        factor = 0.0
        if sine > 0.0:
            cosine = after.distance[c] * dot(start, end)
            factor = mean_distance * _find_angle(sine, cosine, eps) / sine
        # the angle of n less those of the balls, each times its arm
        turn = scale(factor, axis)
        turn = add(turn, contacts.uneven[c] - 0.5 * mean_distance, get_row(turned, i))
        turn = add(turn, -contacts.uneven[c] - 0.5 * mean_distance, get_row(turned, j))
        first = get_row(before.tangent, c)
        last = get_row(after.tangent, c)
        # means of each tangent before and after the step, times two
        tangents = add(first, 1.0, last)
        second_tangents = add(cross(start, first), 1.0, cross(end, last))
        slips[0, c] += 0.5 * dot(turn, second_tangents)
        slips[1, c] -= 0.5 * dot(turn, tangents)


@compiled
def _find_shear(n: Vector, t: Vector, shears: Array, c: int) -> Vector:
    """Return T along the axes of space, the tangential force of the contact ``c`` whose components
    along the tangents t and n x t are in ``shears`` (n_s, n_c).
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
    """Add to ``force`` and ``torque`` (n, 3) on balls the forces and torques of contacts with the
    normal forces ``normal_force`` (n_c,) and the tangential forces ``shears`` (n_s, n_c), which are
    in the configuration ``at``.
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
    """Return the sum over contacts of (f n - T).e, the work of the forces on balls j along the
    directions e at touch; ``normal_force`` (n_c,) are f, and ``shears`` (n_s, n_c) the components
    of T.
    """
    total = 0.0
    for c in range(len(normal_force)):
        n = get_row(at.normal, c)
        shear = _find_shear(n, get_row(at.tangent, c), shears, c)
        on_j = add(scale(normal_force[c], n), -1.0, shear)
        total += dot(on_j, get_row(contacts.normal, c))
    return total


@compiled
def turn_shears(at: Configuration, shears: Array, vectors: Array) -> None:
    """Set ``vectors`` (n_c, 3) to the tangential forces along the axes of space whose components
    along the two tangents of each contact are ``shears`` (n_s, n_c).
    """
    for c in range(len(vectors)):
        n = get_row(at.normal, c)
        set_row(vectors, c, _find_shear(n, get_row(at.tangent, c), shears, c))
