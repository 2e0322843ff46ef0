"""Loops over the contacts of a list, compiled: the entries of its tangent.

A small motion of two balls that touch, under a small uniform strain E of the cell, moves their
contact by v = u_j - u_i + E w, where w joins the centres. The contact resists, with a stiffness
each,

    elongation  v.n
    slip        (1 - nn) v - (arm_i phi_i + arm_j phi_j) x n
    twist       (phi_j - phi_i).n
    roll        (1 - nn)(phi_j - phi_i)
    push        (1 - nn) v, which the static force along n resists with the stiffness -f/r

Each is a row of coefficients of the motions of ball i, those of ball j, and the strains. The
tangent is the sum of the squares of rows times their stiffness. A static force T across the normal,
with which ball i acts on ball j, turns with n, and about n as it is carried:

    dn = (1 - nn) v/r,    turn = n x dn + spin n
    force on ball j   turn x T,                                   on ball i the opposite
    torque on ball j  -(arm_j turn x (n x T) + (e/2) n x T),      on ball i with arm_i

where e is the elongation. This part has no potential, and is not symmetric.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from granphon.base.arrays import Array
from granphon.base.compiled import compiled
from granphon.contacts.columns import Columns

#: kinds of deformation of a contact, with their components: 1 elongation, 2 slips, 1 twist, 2 rolls
#: and 2 pushes
N_ROWS = 8


@compiled
def _set_frame(normals: Array, contact: int, frame: Array) -> None:
    """Set ``frame`` (3, 3) to the rows n, t and b = n x t; of a normal in the plane of x and y, b
    is along z.
    """
    x = normals[contact, 0]
    y = normals[contact, 1]
    z = normals[contact, 2]
    along_z = math.sqrt(x * x + y * y)
    along_x = math.sqrt(y * y + z * z)
    t = (-y / along_z, x / along_z, 0.0) if along_z > 0.5 else (0.0, z / along_x, -y / along_x)
    frame[0, 0] = x
    frame[0, 1] = y
    frame[0, 2] = z
    frame[1, 0] = t[0]
    frame[1, 1] = t[1]
    frame[1, 2] = t[2]
    frame[2, 0] = y * t[2] - z * t[1]
    frame[2, 1] = z * t[0] - x * t[2]
    frame[2, 2] = x * t[1] - y * t[0]


@compiled
def _set_row(
    rows: Array,
    row: int,
    frame: Array,
    move: int,
    moves: float,
    turn: int,
    turn_i: float,
    turn_j: float,
    axes: NDArray[np.int64],
    strained: Array,
) -> int:
    """Set a row: ``moves`` times the component of v along the line ``move`` of the frame, and those
    of turn_i phi_i + turn_j phi_j along the line ``turn``.

    ``strained`` (s, 3) is E w of each strain; ``axes`` are those of the motions of a ball, of
    rotations with 3 added. Returns the number of the next row: the same, if nothing takes part.
    """
    m = len(axes)
    size = 0.0
    for motion in range(m):
        axis = axes[motion]
        if axis < 3:
            part_j = moves * frame[move, axis]
            part_i = -part_j
        else:
            part_i = turn_i * frame[turn, axis - 3]
            part_j = turn_j * frame[turn, axis - 3]
        rows[row, motion] = part_i
        rows[row, m + motion] = part_j
        size += part_i * part_i + part_j * part_j
    for strain in range(strained.shape[0]):
        part = moves * (
            frame[move, 0] * strained[strain, 0]
            + frame[move, 1] * strained[strain, 1]
            + frame[move, 2] * strained[strain, 2]
        )
        rows[row, 2 * m + strain] = part
        size += part * part
    return row + 1 if size > 0.0 else row


@compiled
def _set_rows(
    columns: Columns,
    contact: int,
    axes: NDArray[np.int64],
    strained: Array,
    frame: Array,
    rows: Array,
    stiffness: Array,
) -> int:
    """Set the rows of a contact and their stiffnesses; return their number."""
    arm_i = columns.arm_i[contact]
    arm_j = columns.arm_j[contact]
    count = 0
    stiff = columns.normal_stiffness[contact]
    if stiff != 0.0:
        stiffness[count] = stiff
        count = _set_row(rows, count, frame, 0, 1.0, 0, 0.0, 0.0, axes, strained)
    stiff = columns.shear_stiffness[contact]
    if stiff != 0.0:
        # (phi x n).t = phi.b, and (phi x n).b = -phi.t
        stiffness[count] = stiff
        count = _set_row(rows, count, frame, 1, 1.0, 2, -arm_i, -arm_j, axes, strained)
        stiffness[count] = stiff
        count = _set_row(rows, count, frame, 2, 1.0, 1, arm_i, arm_j, axes, strained)
    stiff = columns.torsion_stiffness[contact]
    if stiff != 0.0:
        stiffness[count] = stiff
        count = _set_row(rows, count, frame, 0, 0.0, 0, -1.0, 1.0, axes, strained)
    stiff = columns.bending_stiffness[contact]
    if stiff != 0.0:
        for tangent in range(1, 3):
            stiffness[count] = stiff
            count = _set_row(rows, count, frame, 0, 0.0, tangent, -1.0, 1.0, axes, strained)
    stiff = columns.side_stiffness[contact]
    if stiff != 0.0:
        for tangent in range(1, 3):
            stiffness[count] = stiff
            count = _set_row(rows, count, frame, tangent, 1.0, 0, 0.0, 0.0, axes, strained)
    return count


@compiled
def _cross(one: Array, other: Array, out: Array) -> None:
    """Set ``out`` to the vector product of two vectors."""
    out[0] = one[1] * other[2] - one[2] * other[1]
    out[1] = one[2] * other[0] - one[0] * other[2]
    out[2] = one[0] * other[1] - one[1] * other[0]


@compiled
def _add_static_turn(
    columns: Columns,
    contact: int,
    axes: NDArray[np.int64],
    strained: Array,
    work: Array,
    block: Array,
) -> None:
    """Add to a ``block`` what the static force across the normal does as it turns; ``work`` (9, 3)
    is overwritten.
    """
    m = len(axes)
    normal = columns.normal[contact]
    distance = columns.distance[contact]
    force, beside, moved, turned, tilt, turn, push, torque, spare = work
    for axis in range(3):
        force[axis] = -columns.tangential_force[contact, axis]  # as the tangent resists
    _cross(normal, force, beside)
    for column in range(block.shape[1]):
        # v, and the sum of the rotations
        moved[:] = 0.0
        turned[:] = 0.0
        if column < 2 * m:
            axis = axes[column % m]
            if axis >= 3:
                turned[axis - 3] = 1.0
            else:
                moved[axis] = -1.0 if column < m else 1.0
        else:
            moved[:] = strained[column - 2 * m]
        elongation = normal[0] * moved[0] + normal[1] * moved[1] + normal[2] * moved[2]
        for axis in range(3):
            tilt[axis] = (moved[axis] - elongation * normal[axis]) / distance
        _cross(normal, tilt, turn)
        spin = 0.0
        if len(columns.origin):
            origin = columns.origin[contact]
            for axis in range(3):
                spin += 0.5 * turned[axis] * origin[axis]
            along = normal[0] * origin[0] + normal[1] * origin[1] + normal[2] * origin[2]
            for axis in range(3):
                spin -= turn[axis] * origin[axis] / (1.0 + along)
        for axis in range(3):
            turn[axis] += spin * normal[axis]
        _cross(turn, force, push)
        _cross(turn, beside, torque)
        for motion in range(m):
            axis = axes[motion]
            if axis < 3:
                block[motion, column] -= push[axis]
                block[m + motion, column] += push[axis]
            else:
                lever = 0.5 * elongation * beside[axis - 3]
                block[motion, column] -= columns.arm_i[contact] * torque[axis - 3] + lever
                block[m + motion, column] -= columns.arm_j[contact] * torque[axis - 3] + lever
        for strain in range(len(strained)):
            spare[:] = strained[strain]
            block[2 * m + strain, column] += (
                push[0] * spare[0] + push[1] * spare[1] + push[2] * spare[2]
            )


@compiled
def fill_tangent(
    columns: Columns,
    axes: NDArray[np.int64],
    strains: Array,
    places: NDArray[np.int64],
    data: Array,
    ahead: Array,
    back: Array,
    corner: Array,
) -> None:
    """Add the tangents of all contacts to the entries of a matrix, and to those of the strains.

    Parameters
    ----------
    columns : the contacts.
    axes : (m,) axes of the motions of a ball, 0 to 2 of displacements, 3 to 5 of rotations.
    strains : (s, 3, 3) unit strains, symmetric.
    places : (n_c, 4, 2) where the blocks of motions (i, i), (i, j), (j, i) and (j, j) of each
        contact begin in ``data``, and how far apart two columns of the block are.
    data : entries of the matrix, (m, m) for each two balls that touch.
    ahead : (n, m, s) forces on balls against unit strains.
    back : (n, m, s) forces on strains against unit motions of balls.
    corner : (s, s) forces on strains against unit strains.
    """
    m = len(axes)
    s = len(strains)
    size = 2 * m + s
    # a row more than a contact has: one to which nothing takes part is written over
    rows = np.zeros((N_ROWS + 1, size))
    stiffness = np.zeros(N_ROWS + 1)
    block = np.zeros((size, size))
    strained = np.zeros((s, 3))
    frame = np.zeros((3, 3))
    work = np.zeros((9, 3))
    static = len(columns.tangential_force) > 0
    vector = columns.vector
    for contact in range(len(columns.i)):
        for strain in range(s):
            for axis in range(3):
                strained[strain, axis] = (
                    strains[strain, axis, 0] * vector[contact, 0]
                    + strains[strain, axis, 1] * vector[contact, 1]
                    + strains[strain, axis, 2] * vector[contact, 2]
                )
        _set_frame(columns.normal, contact, frame)
        count = _set_rows(columns, contact, axes, strained, frame, rows, stiffness)
        if count == 0:
            continue
        for line in range(size):
            for column in range(size):
                block[line, column] = 0.0
        for row in range(count):
            for line in range(size):
                force = stiffness[row] * rows[row, line]
                for column in range(line + 1):
                    block[line, column] += force * rows[row, column]
        for line in range(size):
            for column in range(line):
                block[column, line] = block[line, column]
        if static:
            _add_static_turn(columns, contact, axes, strained, work, block)
        for end in range(2):
            ball = columns.i[contact] if end == 0 else columns.j[contact]
            for motion in range(m):
                line = end * m + motion
                for strain in range(s):
                    ahead[ball, motion, strain] += block[line, 2 * m + strain]
                    back[ball, motion, strain] += block[2 * m + strain, line]
        for line in range(s):
            for strain in range(s):
                corner[line, strain] += block[2 * m + line, 2 * m + strain]
        for pair in range(4):
            first = places[contact, pair, 0]
            apart = places[contact, pair, 1]
            down = (pair // 2) * m
            along = (pair % 2) * m
            for column in range(m):
                for line in range(m):
                    data[first + column * apart + line] += block[down + line, along + column]
