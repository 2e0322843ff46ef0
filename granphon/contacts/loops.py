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

Vector = tuple[float, float, float]


@compiled
def _set_turning(normal: Array, turning: Array) -> None:
    """Set ``turning`` (3, 3) off its diagonal, which must be zero, to the matrix that takes phi to
    phi x n, with the ``normal`` n (3,).
    """
    for axis in range(3):
        following = (axis + 1) % 3
        turning[axis, following] = normal[(axis + 2) % 3]
        turning[following, axis] = -normal[(axis + 2) % 3]


@compiled
def _fill_displacements(
    columns: Columns, axes: NDArray[np.int64], diagonal: Array, forward: Array
) -> None:
    """Do what :func:`fill_tangent` does for balls that do not rotate, under no strains.

    The entries of a block are those of across (1 - nn) + k nn, for all contacts one after the
    other: a loop over the contacts goes through memory in order, but for the two balls.
    """
    n_contacts = len(columns.i)
    along = np.empty(n_contacts)
    across = np.empty(n_contacts)
    for contact in range(n_contacts):
        side = columns.shear_stiffness[contact] + columns.side_stiffness[contact]
        across[contact] = side
        along[contact] = columns.normal_stiffness[contact] - side
    for line in range(len(axes)):
        row = axes[line]
        for column in range(line + 1):
            axis = axes[column]
            near = diagonal[line, column]
            between = forward[line, column]
            added = 1.0 if line == column else 0.0
            for contact in range(n_contacts):
                entry = (
                    along[contact] * columns.normal[contact, row] * columns.normal[contact, axis]
                )
                entry += added * across[contact]
                near[columns.i[contact]] += entry
                near[columns.j[contact]] += entry
                between[contact] = -entry
            if column < line:
                diagonal[column, line] = near
                forward[column, line] = between


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
    """Add the tangents of all contacts to ``diagonal``, ``ahead`` and ``corner``, and set
    ``forward``, all of which must be zeros before. What static forces across normals do is left to
    :func:`add_static_turn`.

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
    rotates = False
    for motion in range(m):
        rotates = rotates or axes[motion] >= 3
    if not rotates:
        _fill_displacements(columns, axes, diagonal, forward)
        if s == 0:
            return
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
        # against displacements: across (1 - nn) + k nn = across 1 + along nn
        across = slip + columns.side_stiffness[contact]
        along = columns.normal_stiffness[contact] - across
        if across == 0.0 and along == 0.0 and torsion == 0.0 and bending == 0.0:
            continue
        _set_turning(normal, turning)
        # near: force on ball i against motions of i; far: of j on j; between: on i against j
        for line in range(m if rotates else 0):
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
        # a unit strain moves ball j against ball i by `strained`, which the contact pulls back
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
        for line in range(s):
            for column in range(s):
                for axis in range(3):
                    corner[line, column] += strained[line, axis] * pull[column, axis]


@compiled
def _cross(first: Vector, second: Vector) -> Vector:
    """Return the vector product of two vectors."""
    return (
        first[1] * second[2] - first[2] * second[1],
        first[2] * second[0] - first[0] * second[2],
        first[0] * second[1] - first[1] * second[0],
    )


@compiled
def _multiply(first: Vector, second: Vector) -> float:
    """Return the scalar product of two vectors."""
    return first[0] * second[0] + first[1] * second[1] + first[2] * second[2]


@compiled
def _set_row(table: Array, row: int, factor: float, vector: Vector) -> None:
    """Set a row of a ``table`` (rows, 3) to ``factor`` times a vector."""
    table[row, 0] = factor * vector[0]
    table[row, 1] = factor * vector[1]
    table[row, 2] = factor * vector[2]


@compiled
def _read(vectors: Array, row: int) -> Vector:
    """Return a row of ``vectors`` (rows, 3)."""
    return (vectors[row, 0], vectors[row, 1], vectors[row, 2])


@compiled
def _set_static_turn(
    normal: Vector,
    force: Vector,
    origin: Vector,
    over: float,
    axes: NDArray[np.int64],
    moved: Array,
    push: Array,
    torque: Array,
    lever: Array,
) -> None:
    """Set the rows of ``push``, ``torque`` and ``lever``, (m + s, 3) each, to the changes
    turn x T, turn x (n x T) and (e/2) n x T of the static ``force`` T across the normal n.

    The first m rows belong to unit motions of ball j along the ``axes``, 3 to 5 of which are
    rotations; the last s rows belong to strains. ``moved`` (m + s, 3) are the motions v of the
    contact, and ``over`` is 1/r with the distance r of the centres. Rotations turn T about n too:
    T is carried on the shortest way from the unit vector ``origin``, which is zero where T does not
    turn about n.
    """
    m = len(axes)
    beside = _cross(normal, force)
    share = over / (1.0 + _multiply(normal, origin))
    for column in range(len(push)):
        if column < m and axes[column] >= 3:
            half = 0.5 * origin[axes[column] - 3]
            _set_row(push, column, half, beside)
            _set_row(torque, column, half, _cross(normal, beside))
            _set_row(lever, column, 0.0, beside)
            continue
        v = _read(moved, column)
        tilt = _cross(normal, v)
        across = share * _multiply(tilt, origin)
        turn = (
            over * tilt[0] - across * normal[0],
            over * tilt[1] - across * normal[1],
            over * tilt[2] - across * normal[2],
        )
        _set_row(push, column, 1.0, _cross(turn, force))
        _set_row(torque, column, 1.0, _cross(turn, beside))
        _set_row(lever, column, 0.5 * _multiply(normal, v), beside)


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
    """Add to all blocks the changes that static forces across normals cause as they turn with their
    contacts.

    ``backward`` (m, m, n_c) are, for each motion of ball i of a contact, the forces on ball j.
    ``back`` (n, m, s) are the forces on strains against unit motions of balls. The other arguments
    are those of :func:`fill_tangent`.
    """
    m = len(axes)
    s = len(strains)
    # v by a unit of each motion of ball j, and of each strain
    moved = np.zeros((m + s, 3))
    for motion in range(m):
        if axes[motion] < 3:
            moved[motion, axes[motion]] = 1.0
    push, torque, lever = np.zeros((3, m + s, 3))
    spins = len(columns.origin) > 0
    for contact in range(len(columns.i)):
        held = _read(columns.tangential_force, contact)
        if held[0] == 0.0 and held[1] == 0.0 and held[2] == 0.0:
            continue
        i = columns.i[contact]
        j = columns.j[contact]
        arm_i = columns.arm_i[contact]
        arm_j = columns.arm_j[contact]
        # a unit strain moves the centres along all axes
        for strain in range(s):
            for axis in range(3):
                v = 0.0
                for a in range(3):
                    v += strains[strain, axis, a] * columns.vector[contact, a]
                moved[m + strain, axis] = v
        # numbers alone are passed on: to pass all columns takes longer than all else
        normal = _read(columns.normal, contact)
        force = (-held[0], -held[1], -held[2])  # as the tangent resists
        origin = _read(columns.origin, contact) if spins else (0.0, 0.0, 0.0)
        over = 1.0 / columns.distance[contact]
        _set_static_turn(normal, force, origin, over, axes, moved, push, torque, lever)
        for line in range(m):
            row = axes[line]
            for column in range(m + s):
                if row < 3:
                    on_i = -push[column, row]
                    on_j = push[column, row]
                else:
                    on_i = -arm_i * torque[column, row - 3] - lever[column, row - 3]
                    on_j = -arm_j * torque[column, row - 3] - lever[column, row - 3]
                if column >= m:
                    ahead[i, line, column - m] += on_i
                    ahead[j, line, column - m] += on_j
                    continue
                # ball i moves against v, and turns as ball j does
                sign = -1.0 if axes[column] < 3 else 1.0
                diagonal[line, column, i] += sign * on_i
                diagonal[line, column, j] += on_j
                forward[line, column, contact] += on_i
                backward[column, line, contact] += sign * on_j
        for strain in range(s):
            for column in range(m + s):
                work_done = (
                    push[column, 0] * moved[m + strain, 0]
                    + push[column, 1] * moved[m + strain, 1]
                    + push[column, 2] * moved[m + strain, 2]
                )
                if column >= m:
                    corner[strain, column - m] += work_done
                    continue
                back[i, column, strain] += -work_done if axes[column] < 3 else work_done
                back[j, column, strain] += work_done


@compiled
def fill_entries(
    diagonal: Array,
    forward: Array,
    backward: Array,
    by_ball: NDArray[np.int64],
    by_contact: NDArray[np.int64],
    data: Array,
) -> None:
    """Add the blocks of balls and contacts to the entries ``data`` of a sparse matrix in columns.

    ``diagonal`` (m, m, n), ``forward`` and ``backward`` (m, m, n_c) are those of
    :func:`add_static_turn`. ``by_ball`` (n, 2) has, for the block of each ball, the index of its
    first entry in ``data`` and the distance in ``data`` from one of its columns to the next;
    ``by_contact`` (n_c, 2, 2) has both for the blocks (i, j) and (j, i) of each contact.
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
