"""Loops over the contacts of a list, compiled: the blocks of its tangent.

A small motion of two balls that touch, under a small uniform strain E of the cell, moves their
contact by v = u_j - u_i + E w, where w joins the centres. The contact resists, with a stiffness
each,

    elongation  v.n
    slip        (1 - nn) v - (arm_i phi_i + arm_j phi_j) x n
    twist       (phi_j - phi_i).n
    roll        (1 - nn)(phi_j - phi_i)
    push        (1 - nn) v, which the static force along n resists with the stiffness -f/r

The tangent is the second derivative of the sum of half of the squares of these times their
stiffness: of two displacements a matrix of nn and 1 - nn; of a displacement and a rotation that of
phi x n, times an arm; of two rotations one of nn and 1 - nn again.

A static force T across the normal, with which ball i acts on ball j, turns with n, and about n as
it is carried:

    dn = (1 - nn) v/r,    turn = n x dn + spin n
    force on ball j   turn x T,                                   on ball i the opposite
    torque on ball j  -(arm_j turn x (n x T) + (e/2) n x T),      on ball i with arm_i

where e is the elongation. This part has no potential, and is not symmetric.

Blocks (m, m) of the m motions of two balls lie so that those of all contacts, or of all balls, of
one entry follow each other: what multiplies them goes through memory in order.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from granphon.base.arrays import Array
from granphon.base.compiled import compiled
from granphon.contacts.columns import Columns


@compiled
def _set_turning(normal: Array, turning: Array) -> None:
    """Set ``turning`` (3, 3) to the matrix that takes phi to phi x n; its diagonal is zero."""
    for axis in range(3):
        following = (axis + 1) % 3
        turning[axis, following] = normal[(axis + 2) % 3]
        turning[following, axis] = -normal[(axis + 2) % 3]


@compiled
def fill_tangent(
    columns: Columns,
    axes: NDArray[np.int64],
    strains: Array,
    diagonal: Array,
    forward: Array,
    ahead: Array,
    corner: Array,
) -> None:
    """Add the tangents of all contacts, but for static forces across normals, to zeros.

    Parameters
    ----------
    columns : the contacts.
    axes : (m,) axes of the motions of a ball, 0 to 2 of displacements, 3 to 5 of rotations.
    strains : (s, 3, 3) unit strains, symmetric.
    diagonal : (m, m, n) forces on each ball against motions of the same ball.
    forward : (m, m, n_c) forces on ball i of each contact against motions of ball j; the block of
        ball j and i is its transpose.
    ahead : (n, m, s) forces on balls against unit strains; those on strains against unit motions
        are the same.
    corner : (s, s) forces on strains against unit strains.
    """
    m = len(axes)
    s = len(strains)
    turning = np.zeros((3, 3))
    strained = np.zeros((s, 3))
    pull = np.zeros((s, 3))
    for contact in range(len(columns.i)):
        i = columns.i[contact]
        j = columns.j[contact]
        arm_i = columns.arm_i[contact]
        arm_j = columns.arm_j[contact]
        normal = columns.normal[contact]
        slip = columns.shear_stiffness[contact]
        torsion = columns.torsion_stiffness[contact]
        bending = columns.bending_stiffness[contact]
        # of displacements: across (1 - nn) + k nn
        across = slip + columns.side_stiffness[contact]
        along = columns.normal_stiffness[contact] - across
        if across == 0.0 and along == 0.0 and torsion == 0.0 and bending == 0.0:
            continue
        _set_turning(normal, turning)
        for line in range(m):
            row = axes[line]
            for column in range(m):
                axis = axes[column]
                if row < 3 and axis < 3:
                    near = along * normal[row] * normal[axis]
                    if row == axis:
                        near += across
                    far = near
                    between = -near
                elif row < 3:
                    cross = slip * turning[row, axis - 3]
                    near = arm_i * cross
                    far = -arm_j * cross
                    between = arm_j * cross
                elif axis < 3:
                    cross = slip * turning[axis, row - 3]
                    near = arm_i * cross
                    far = -arm_j * cross
                    between = -arm_i * cross
                else:
                    parallel = normal[row - 3] * normal[axis - 3]
                    beside = -parallel
                    if row == axis:
                        beside += 1.0
                    roll = torsion * parallel + bending * beside
                    near = arm_i * arm_i * slip * beside + roll
                    far = arm_j * arm_j * slip * beside + roll
                    between = arm_i * arm_j * slip * beside - roll
                diagonal[line, column, i] += near
                diagonal[line, column, j] += far
                forward[line, column, contact] = between
        for strain in range(s):
            elongation = 0.0
            for axis in range(3):
                strained[strain, axis] = 0.0
                for a in range(3):
                    strained[strain, axis] += strains[strain, axis, a] * columns.vector[contact, a]
                elongation += strained[strain, axis] * normal[axis]
            for axis in range(3):
                pull[strain, axis] = (
                    along * elongation * normal[axis] + across * strained[strain, axis]
                )
            for motion in range(m):
                axis = axes[motion]
                if axis < 3:
                    ahead[i, motion, strain] -= pull[strain, axis]
                    ahead[j, motion, strain] += pull[strain, axis]
                else:
                    slipped = 0.0
                    for a in range(3):
                        slipped += strained[strain, a] * turning[a, axis - 3]
                    ahead[i, motion, strain] -= arm_i * slip * slipped
                    ahead[j, motion, strain] -= arm_j * slip * slipped
        for one in range(s):
            for another in range(s):
                for axis in range(3):
                    corner[one, another] += strained[one, axis] * pull[another, axis]


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
    """Add to a ``block`` (2 m + s, 2 m + s) what the static force across the normal does as it
    turns: forces on the m motions of ball i, on those of ball j, and on the s strains, against the
    same. ``strained`` (s, 3) is what unit strains add to the vector; ``work`` (9, 3) is
    overwritten.
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
def add_static_turn(
    columns: Columns,
    axes: NDArray[np.int64],
    strains: Array,
    diagonal: Array,
    forward: Array,
    backward: Array,
    ahead: Array,
    back: Array,
    corner: Array,
) -> None:
    """Add what static forces across normals do as they turn.

    ``backward`` (m, m, n_c) are, of each motion of ball i of a contact, the forces on ball j, and
    ``back`` (n, m, s) forces on strains against unit motions of balls; see :func:`fill_tangent` for
    the others.
    """
    m = len(axes)
    s = len(strains)
    block = np.zeros((2 * m + s, 2 * m + s))
    strained = np.zeros((s, 3))
    work = np.zeros((9, 3))
    for contact in range(len(columns.i)):
        i = columns.i[contact]
        j = columns.j[contact]
        strained[:] = 0.0
        for strain in range(s):
            for axis in range(3):
                for a in range(3):
                    strained[strain, axis] += strains[strain, axis, a] * columns.vector[contact, a]
        block[:] = 0.0
        _add_static_turn(columns, contact, axes, strained, work, block)
        for line in range(m):
            for column in range(m):
                diagonal[line, column, i] += block[line, column]
                diagonal[line, column, j] += block[m + line, m + column]
                forward[line, column, contact] += block[line, m + column]
                backward[column, line, contact] += block[m + line, column]
            for strain in range(s):
                ahead[i, line, strain] += block[line, 2 * m + strain]
                ahead[j, line, strain] += block[m + line, 2 * m + strain]
                back[i, line, strain] += block[2 * m + strain, line]
                back[j, line, strain] += block[2 * m + strain, m + line]
        for one in range(s):
            for another in range(s):
                corner[one, another] += block[2 * m + one, 2 * m + another]


@compiled
def fill_entries(
    diagonal: Array,
    forward: Array,
    backward: Array,
    by_ball: NDArray[np.int64],
    by_contact: NDArray[np.int64],
    data: Array,
) -> None:
    """Add blocks to the entries ``data`` of a sparse matrix in columns, zeros.

    ``by_ball`` (n, 2) and ``by_contact`` (n_c, 2, 2) are where the block of each ball, and those of
    (i, j) and (j, i) of each contact, begin, and how far apart two columns of the block are.
    """
    m = len(diagonal)
    for column in range(m):
        for line in range(m):
            for ball in range(len(by_ball)):
                place = by_ball[ball, 0] + column * by_ball[ball, 1] + line
                data[place] += diagonal[line, column, ball]
            for contact in range(len(by_contact)):
                place = by_contact[contact, 0, 0] + column * by_contact[contact, 0, 1] + line
                data[place] += forward[line, column, contact]
                place = by_contact[contact, 1, 0] + column * by_contact[contact, 1, 1] + line
                data[place] += backward[column, line, contact]
