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

#: square of the slope of an angle whose series ends with the third term: the fourth is rounding
_SMALL = 1e-6
#: 1 + n.e of a contact that a step too long has turned round
ROUND = float(np.finfo(float).tiny)


@compiled
def list_motions(fields: NDArray[Any], axes: Array, displacement: Array, rotation: Array) -> None:
    """Set ``displacement`` and ``rotation`` (n, 3) of balls from ``fields`` (b, m, cells), the m
    motions of b balls of each cell.

    Displacements are the first p of m, multiplied by ``axes`` (p, p); a single rotation is that
    about the third axis. Components that no field sets keep their values.
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
    """Return the largest length of vectors (n, 3)."""
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
    from ``displacement`` and ``rotation`` (n, 3) of balls and the ``overlap`` y.
    """
    for c in range(len(overlaps)):
        i = contacts.i[c]
        j = contacts.j[c]
        nx = contacts.normal[c, 0]
        ny = contacts.normal[c, 1]
        nz = contacts.normal[c, 2]
        tx = contacts.tangent[c, 0]
        ty = contacts.tangent[c, 1]
        tz = contacts.tangent[c, 2]
        x = displacement[j, 0] - displacement[i, 0]
        y = displacement[j, 1] - displacement[i, 1]
        z = displacement[j, 2] - displacement[i, 2]
        # rotations move the surfaces at the contact against each other by r x n
        arm_i = 0.5 - contacts.uneven[c]
        arm_j = 0.5 + contacts.uneven[c]
        rx = arm_i * rotation[i, 0] + arm_j * rotation[j, 0]
        ry = arm_i * rotation[i, 1] + arm_j * rotation[j, 1]
        rz = arm_i * rotation[i, 2] + arm_j * rotation[j, 2]
        # the second tangent b = n x t
        bx = ny * tz - nz * ty
        by = nz * tx - nx * tz
        bz = nx * ty - ny * tx
        overlaps[c] = overlap + contacts.offset[c] - (nx * x + ny * y + nz * z)
        slips[0, c] = tx * x + ty * y + tz * z - (bx * rx + by * ry + bz * rz)
        if len(slips) == 2:
            slips[1, c] = bx * x + by * y + bz * z + (tx * rx + ty * ry + tz * rz)


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
        ex = contacts.normal[c, 0]
        ey = contacts.normal[c, 1]
        ez = contacts.normal[c, 2]
        # w = e + eps v joins the centres, in d
        x = displacement[j, 0] - displacement[i, 0] - overlap * ex
        y = displacement[j, 1] - displacement[i, 1] - overlap * ey
        z = displacement[j, 2] - displacement[i, 2] - overlap * ez
        wx = ex + eps * x
        wy = ey + eps * y
        wz = ez + eps * z
        size = math.sqrt(wx * wx + wy * wy + wz * wz)
        # |w| - 1, over eps: no two numbers that are nearly equal are subtracted
        grown = 2.0 * (ex * x + ey * y + ez * z) + eps * (x * x + y * y + z * z)
        overlaps[c] = contacts.offset[c] - grown / (1.0 + size)
        nx = wx / size
        ny = wy / size
        nz = wz / size
        normal[c, 0] = nx
        normal[c, 1] = ny
        normal[c, 2] = nz
        distance[c] = size
        if in_plane:
            tangent[c, 0] = -ny
            tangent[c, 1] = nx
            tangent[c, 2] = 0.0
            continue
        # the tangent goes along by the smallest rotation from e to n
        tx = contacts.tangent[c, 0]
        ty = contacts.tangent[c, 1]
        tz = contacts.tangent[c, 2]
        along = ex * nx + ey * ny + ez * nz
        factor = (tx * nx + ty * ny + tz * nz) / max(1.0 + along, ROUND)
        tx -= factor * (ex + nx)
        ty -= factor * (ey + ny)
        tz -= factor * (ez + nz)
        # and turns about n by the mean of the spins of both balls
        spin = (rotation[i, 0] + rotation[j, 0]) * ex
        spin += (rotation[i, 1] + rotation[j, 1]) * ey
        spin += (rotation[i, 2] + rotation[j, 2]) * ez
        cosine = math.cos(0.5 * eps * spin)
        sine = math.sin(0.5 * eps * spin)
        tangent[c, 0] = cosine * tx + sine * (ny * tz - nz * ty)
        tangent[c, 1] = cosine * ty + sine * (nz * tx - nx * tz)
        tangent[c, 2] = cosine * tz + sine * (nx * ty - ny * tx)


@compiled
def _find_angle(sine: float, cosine: float, eps: float) -> float:
    """Return an angle over eps; ``cosine`` is the cosine of the angle, and ``sine`` its sine over
    eps, both times the same positive number.

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
    configuration ``before`` to the configuration ``after``.
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
        x = moved[j, 0] - moved[i, 0] - overlap_change * contacts.normal[c, 0]
        y = moved[j, 1] - moved[i, 1] - overlap_change * contacts.normal[c, 1]
        px = before.normal[c, 0]
        py = before.normal[c, 1]
        nx = after.normal[c, 0]
        ny = after.normal[c, 1]
        size = 0.5 * (before.distance[c] + after.distance[c])
        cosine = px * nx + py * ny
        slid = size * _find_angle(px * y - py * x, after.distance[c] * cosine, eps)
        slid -= (0.5 * size - contacts.uneven[c]) * turned[i, 2]
        slid -= (0.5 * size + contacts.uneven[c]) * turned[j, 2]
        slips[c] += slid


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
        x = moved[j, 0] - moved[i, 0] - overlap_change * contacts.normal[c, 0]
        y = moved[j, 1] - moved[i, 1] - overlap_change * contacts.normal[c, 1]
        z = moved[j, 2] - moved[i, 2] - overlap_change * contacts.normal[c, 2]
        px = before.normal[c, 0]
        py = before.normal[c, 1]
        pz = before.normal[c, 2]
        nx = after.normal[c, 0]
        ny = after.normal[c, 1]
        nz = after.normal[c, 2]
        size = 0.5 * (before.distance[c] + after.distance[c])
        arm_i = 0.5 * size - contacts.uneven[c]
        arm_j = 0.5 * size + contacts.uneven[c]
        # the vector of the rotation that turns one direction into the other, over eps
        turn_x = py * z - pz * y
        turn_y = pz * x - px * z
        turn_z = px * y - py * x
        cosine = px * nx + py * ny + pz * nz
        sine = math.sqrt(turn_x * turn_x + turn_y * turn_y + turn_z * turn_z)
        scale = 0.0
        if sine > 0.0:
            scale = size * _find_angle(sine, after.distance[c] * cosine, eps) / sine
        gone_x = scale * turn_x - arm_i * turned[i, 0] - arm_j * turned[j, 0]
        gone_y = scale * turn_y - arm_i * turned[i, 1] - arm_j * turned[j, 1]
        gone_z = scale * turn_z - arm_i * turned[i, 2] - arm_j * turned[j, 2]
        qx = before.tangent[c, 0]
        qy = before.tangent[c, 1]
        qz = before.tangent[c, 2]
        tx = after.tangent[c, 0]
        ty = after.tangent[c, 1]
        tz = after.tangent[c, 2]
        # twice the mean of the second tangents n x t at both ends
        bx = py * qz - pz * qy + ny * tz - nz * ty
        by = pz * qx - px * qz + nz * tx - nx * tz
        bz = px * qy - py * qx + nx * ty - ny * tx
        slips[0, c] += 0.5 * (gone_x * bx + gone_y * by + gone_z * bz)
        slips[1, c] -= 0.5 * (gone_x * (qx + tx) + gone_y * (qy + ty) + gone_z * (qz + tz))


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
    normal forces ``normal_force`` (n_c,) and the tangential forces ``shears`` (n_s, n_c).
    """
    for c in range(len(normal_force)):
        size = normal_force[c]
        along_t = shears[0, c]
        along_b = shears[1, c] if len(shears) == 2 else 0.0
        if size == 0.0 and along_t == 0.0 and along_b == 0.0:
            continue
        i = contacts.i[c]
        j = contacts.j[c]
        nx = at.normal[c, 0]
        ny = at.normal[c, 1]
        nz = at.normal[c, 2]
        tx = at.tangent[c, 0]
        ty = at.tangent[c, 1]
        tz = at.tangent[c, 2]
        bx = ny * tz - nz * ty
        by = nz * tx - nx * tz
        bz = nx * ty - ny * tx
        # the force f n - T on ball j
        x = size * nx - along_t * tx - along_b * bx
        y = size * ny - along_t * ty - along_b * by
        z = size * nz - along_t * tz - along_b * bz
        force[i, 0] -= x
        force[i, 1] -= y
        force[i, 2] -= z
        force[j, 0] += x
        force[j, 1] += y
        force[j, 2] += z
        arm_i = 0.5 * at.distance[c] - contacts.uneven[c]
        arm_j = 0.5 * at.distance[c] + contacts.uneven[c]
        # n x T, times the arm the torque on either ball
        x = along_t * bx - along_b * tx
        y = along_t * by - along_b * ty
        z = along_t * bz - along_b * tz
        torque[i, 0] += arm_i * x
        torque[i, 1] += arm_i * y
        torque[i, 2] += arm_i * z
        torque[j, 0] += arm_j * x
        torque[j, 1] += arm_j * y
        torque[j, 2] += arm_j * z


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
        size = normal_force[c]
        along_t = shears[0, c]
        along_b = shears[1, c] if len(shears) == 2 else 0.0
        nx = at.normal[c, 0]
        ny = at.normal[c, 1]
        nz = at.normal[c, 2]
        tx = at.tangent[c, 0]
        ty = at.tangent[c, 1]
        tz = at.tangent[c, 2]
        x = size * nx - along_t * tx - along_b * (ny * tz - nz * ty)
        y = size * ny - along_t * ty - along_b * (nz * tx - nx * tz)
        z = size * nz - along_t * tz - along_b * (nx * ty - ny * tx)
        ex = contacts.normal[c, 0]
        ey = contacts.normal[c, 1]
        ez = contacts.normal[c, 2]
        total += x * ex + y * ey + z * ez
    return total


@compiled
def turn_shears(at: Configuration, shears: Array, vectors: Array) -> None:
    """Set ``vectors`` (n_c, 3) to the tangential forces along the axes of space whose components
    along the two tangents of each contact are ``shears`` (n_s, n_c).
    """
    for c in range(len(vectors)):
        along_t = shears[0, c]
        along_b = shears[1, c] if len(shears) == 2 else 0.0
        nx = at.normal[c, 0]
        ny = at.normal[c, 1]
        nz = at.normal[c, 2]
        tx = at.tangent[c, 0]
        ty = at.tangent[c, 1]
        tz = at.tangent[c, 2]
        vectors[c, 0] = along_t * tx + along_b * (ny * tz - nz * ty)
        vectors[c, 1] = along_t * ty + along_b * (nz * tx - nx * tz)
        vectors[c, 2] = along_t * tz + along_b * (nx * ty - ny * tx)
