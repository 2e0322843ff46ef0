"""Compiled loops over the contacts of a list: the blocks of its tangent.

A small motion of two balls that touch, under a small uniform strain E of the cell, moves their
centres against each other by v = u_j - u_i + E w, where w joins the centres. The contact resists
five deformations, each with a stiffness of its own,

    elongation  v.n
    slip        (1 - nn) v - (arm_i phi_i + arm_j phi_j) x n
    twist       (phi_j - phi_i).n
    roll        (1 - nn)(phi_j - phi_i)
    push        (1 - nn) v, which the static force f along n resists with the stiffness -f/r, or
                f/r where the contact leans (ContactList.side_stiffness)

The tangent is the second derivative of the energy of these springs. Its block for two displacements
is made of nn and 1 - nn; that for a displacement and a rotation of the matrix of phi x n, times an
arm; that for two rotations of nn and 1 - nn again.

Ball i acts on ball j with a static force T across the normal. T turns with n, and about n by the
angle spin:

    dn = (1 - nn) v/r,    turn = n x dn + spin n
    force on ball j   turn x T,                                   on ball i the opposite
    torque on ball j  -(arm_j turn x (n x T) + (e/2) n x T),      on ball i with arm_i

where e is the elongation, r the distance of the centres, and spin the angle by which tangents turn
about n (:class:`~granphon.contacts.columns.Columns`, ``origin``). This part has no potential, and
is not symmetric.

Blocks (m, m) of the m motions of two balls lie so that those of all contacts, or of all balls, of
one entry follow each other: what multiplies them goes through memory in order.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from granphon.base.arrays import Array
from granphon.base.compiled import compiled
from granphon.contacts.columns import Columns
from granphon.contacts.vectors import Vector, add, cross, dot, get_row, scale, set_row


class Blocks(NamedTuple):
    """The tangent of contacts, block by block: A, B, B' and S of
    :mod:`granphon.contacts.tangent`, with m motions of each of n balls and s strains.

    Attributes
    ----------
    diagonal : (m, m, n) blocks of A: forces on each ball against motions of the same ball.
    forward : (m, m, n_c) blocks of A: forces on ball i of each contact against motions of ball j.
    backward : (m, m, n_c) blocks of A, transposed: forces on ball j of each contact (second axis)
        against motions of ball i (first axis). They are the array ``forward`` itself if A is
        symmetric.
    ahead : (n, m, s) B, forces on balls against unit strains.
    back : (n, m, s) B' transposed, forces on strains against unit motions of balls.
    corner : (s, s) S, forces on strains against unit strains.
    """

    diagonal: Array
    forward: Array
    backward: Array
    ahead: Array
    back: Array
    corner: Array

    def symmetrise(self) -> Blocks:
        """Return the blocks with A replaced by its symmetric part; B, B' and S stay as they are."""
        diagonal = 0.5 * (self.diagonal + self.diagonal.swapaxes(0, 1))
        forward = 0.5 * (self.forward + self.backward)
        return self._replace(diagonal=diagonal, forward=forward, backward=forward)


class _Resistance(NamedTuple):
    """Stiffnesses of one contact, and its arms.

    Attributes
    ----------
    along, across : the block for two displacements is across + along nn.
    slip, torsion, bending : stiffnesses against slip, twist and roll.
    arm_i, arm_j : the arms of balls i and j.
    """

    along: float
    across: float
    slip: float
    torsion: float
    bending: float
    arm_i: float
    arm_j: float


@compiled
def _set_turning(normal: Array, turning: Array) -> None:
    """Set ``turning`` (3, 3) to the matrix that takes phi to phi x n, with the ``normal`` n (3,);
    its diagonal must be zero before, and stays so.
    """
    for axis in range(3):
        following = (axis + 1) % 3
        turning[axis, following] = normal[(axis + 2) % 3]
        turning[following, axis] = -normal[(axis + 2) % 3]


@compiled
def _apply_strain(strains: Array, strain: int, w: Vector) -> Vector:
    """Return E w, with E the unit ``strain`` of that number in ``strains`` (s, 3, 3)."""
    return (
        strains[strain, 0, 0] * w[0] + strains[strain, 0, 1] * w[1] + strains[strain, 0, 2] * w[2],
        strains[strain, 1, 0] * w[0] + strains[strain, 1, 1] * w[1] + strains[strain, 1, 2] * w[2],
        strains[strain, 2, 0] * w[0] + strains[strain, 2, 1] * w[1] + strains[strain, 2, 2] * w[2],
    )


@compiled
def _fill_displacements(
    columns: Columns, axes: NDArray[np.int64], diagonal: Array, forward: Array
) -> None:
    """Do what :func:`_fill_motions` does, for balls that do not rotate.

    A block is across (1 - nn) + k nn. Each of its entries is found for all contacts one after the
    other: but for the numbers of the balls, the loop goes through memory in order.
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
            identity = 1.0 if line == column else 0.0  # entry of the matrix 1
            for contact in range(n_contacts):
                entry = (
                    along[contact] * columns.normal[contact, row] * columns.normal[contact, axis]
                )
                entry += identity * across[contact]
                near[columns.i[contact]] += entry
                near[columns.j[contact]] += entry
                between[contact] = -entry
            if column < line:
                diagonal[column, line] = near
                forward[column, line] = between


@compiled
def _find_entries(
    law: _Resistance, normal: Array, turning: Array, row: int, axis: int
) -> tuple[float, float, float]:
    """Return an entry of three blocks of a contact: force on ball i against motions of ball i, on
    ball j against those of j, and on ball i against those of j.

    ``row`` is the axis of the force and ``axis`` that of the motion, 0 to 2 of displacements, 3 to
    5 of rotations; ``normal`` n (3,) is that of the contact, and ``turning`` that of
    :func:`_set_turning`.
    """
    arm_i = law.arm_i
    arm_j = law.arm_j
    if row < 3 and axis < 3:
        entry = law.along * normal[row] * normal[axis]
        if row == axis:
            entry += law.across
        return entry, entry, -entry
    if row < 3:
        sheared = law.slip * turning[row, axis - 3]
        return arm_i * sheared, -arm_j * sheared, arm_j * sheared
    if axis < 3:
        sheared = law.slip * turning[axis, row - 3]
        return arm_i * sheared, -arm_j * sheared, -arm_i * sheared
    # entries of nn and of 1 - nn
    parallel = normal[row - 3] * normal[axis - 3]
    perpendicular = -parallel
    if row == axis:
        perpendicular += 1.0
    roll = law.torsion * parallel + law.bending * perpendicular
    return (
        arm_i * arm_i * law.slip * perpendicular + roll,
        arm_j * arm_j * law.slip * perpendicular + roll,
        arm_i * arm_j * law.slip * perpendicular - roll,
    )


@compiled
def _fill_motions(
    columns: Columns, axes: NDArray[np.int64], diagonal: Array, forward: Array
) -> None:
    """Add the blocks of balls to ``diagonal`` and set those of contacts in ``forward``: forces
    against motions along the ``axes`` of :func:`fill_tangent`. Blocks of contacts that resist
    nothing are left as they are.
    """
    m = len(axes)
    turning = np.zeros((3, 3))
    for contact in range(len(columns.i)):
        i = columns.i[contact]
        j = columns.j[contact]
        normal = columns.normal[contact]
        slip = columns.shear_stiffness[contact]
        torsion = columns.torsion_stiffness[contact]
        bending = columns.bending_stiffness[contact]
        # against displacements: across (1 - nn) + k nn = across 1 + along nn
        across = slip + columns.side_stiffness[contact]
        along = columns.normal_stiffness[contact] - across
        if across == 0.0 and along == 0.0 and torsion == 0.0 and bending == 0.0:
            continue
        arms = (columns.arm_i[contact], columns.arm_j[contact])
        law = _Resistance(along, across, slip, torsion, bending, *arms)
        _set_turning(normal, turning)
        for line in range(m):
            for column in range(m):
                on_i, on_j, between = _find_entries(law, normal, turning, axes[line], axes[column])
                diagonal[line, column, i] += on_i
                diagonal[line, column, j] += on_j
                forward[line, column, contact] = between


@compiled
def _fill_strains(
    columns: Columns, axes: NDArray[np.int64], strains: Array, ahead: Array, corner: Array
) -> None:
    """Add the forces against unit ``strains`` to ``ahead`` and ``corner`` of :class:`Blocks`;
    ``axes`` and ``strains`` are those of :func:`fill_tangent`.
    """
    s = len(strains)
    moves = np.zeros((s, 3))
    pulls = np.zeros((s, 3))
    for contact in range(len(columns.i)):
        i = columns.i[contact]
        j = columns.j[contact]
        normal = get_row(columns.normal, contact)
        w = get_row(columns.vector, contact)
        slip = columns.shear_stiffness[contact]
        across = slip + columns.side_stiffness[contact]
        along = columns.normal_stiffness[contact] - across
        if across == 0.0 and along == 0.0:
            continue
        for strain in range(s):
            # a unit strain moves ball j against ball i, which the contact pulls back
            move = _apply_strain(strains, strain, w)
            pull = add(scale(along * dot(move, normal), normal), across, move)
            turn = cross(normal, move)
            set_row(moves, strain, move)
            set_row(pulls, strain, pull)
            for motion in range(len(axes)):
                axis = axes[motion]
                if axis < 3:
                    ahead[i, motion, strain] -= pull[axis]
                    ahead[j, motion, strain] += pull[axis]
                else:
                    ahead[i, motion, strain] -= columns.arm_i[contact] * slip * turn[axis - 3]
                    ahead[j, motion, strain] -= columns.arm_j[contact] * slip * turn[axis - 3]
        for line in range(s):
            for column in range(s):
                for axis in range(3):
                    corner[line, column] += moves[line, axis] * pulls[column, axis]


@compiled
def fill_tangent(columns: Columns, axes: NDArray[np.int64], strains: Array, blocks: Blocks) -> None:
    """Set ``diagonal``, ``forward``, ``ahead`` and ``corner`` of the ``blocks`` to the tangent of
    all contacts; all four must be zeros before. Static forces across normals are not in it:
    :func:`add_static_turn` adds what these do. Without them ``backward`` and ``back`` are the same
    numbers as ``forward`` and ``ahead``.

    Parameters
    ----------
    columns : the contacts.
    axes : (m,) axes of the motions of a ball, 0 to 2 of displacements, 3 to 5 of rotations.
    strains : (s, 3, 3) unit strains, symmetric.
    blocks : the blocks; ``backward`` and ``back`` are not set.
    """
    can_rotate = False
    for motion in range(len(axes)):
        can_rotate = can_rotate or axes[motion] >= 3
    if can_rotate:
        _fill_motions(columns, axes, blocks.diagonal, blocks.forward)
    else:
        _fill_displacements(columns, axes, blocks.diagonal, blocks.forward)
    if len(strains):
        _fill_strains(columns, axes, strains, blocks.ahead, blocks.corner)


class _Turn(NamedTuple):
    """The changes turn x T, turn x (n x T) and (e/2) n x T, (m + s, 3) each, that a static force T
    of a contact makes as the contact turns.

    The first m rows belong to unit motions of ball j, and the last s rows to unit strains.
    """

    push: Array
    torque: Array
    lever: Array


@compiled
def _set_static_turn(
    normal: Vector,
    force: Vector,
    origin: Vector,
    over_distance: float,
    axes: NDArray[np.int64],
    moves: Array,
    changes: _Turn,
) -> None:
    """Set the ``changes`` that the static ``force`` T across the ``normal`` n makes.

    ``axes`` (m,) are those of the motions of ball j, 3 to 5 of rotations. ``moves`` (m + s, 3) are
    the motions v of the contact, and ``over_distance`` is 1/r with the distance r of the centres. T
    turns about n as the tangents do that the smallest rotation carries from the unit vector
    ``origin`` to n, and that the mean rotation of both balls about ``origin`` turns; if ``origin``
    is zero, T does not turn about n.
    """
    push, torque, lever = changes
    m = len(axes)
    moment = cross(normal, force)
    spin_factor = over_distance / (1.0 + dot(normal, origin))
    for column in range(len(push)):
        if column < m and axes[column] >= 3:
            # the mean rotation of both balls about the origin, of which one turns
            spin = 0.5 * origin[axes[column] - 3]
            set_row(push, column, scale(spin, moment))
            set_row(torque, column, scale(spin, cross(normal, moment)))
            set_row(lever, column, scale(0.0, moment))
            continue
        v = get_row(moves, column)
        tilt = cross(normal, v)
        spin = -spin_factor * dot(tilt, origin)
        turn = add(scale(over_distance, tilt), spin, normal)
        set_row(push, column, cross(turn, force))
        set_row(torque, column, cross(turn, moment))
        set_row(lever, column, scale(0.5 * dot(normal, v), moment))


@compiled
def _add_turn_of_strains(
    i: int,
    j: int,
    axes: NDArray[np.int64],
    moves: Array,
    push: Array,
    back: Array,
    corner: Array,
) -> None:
    """Add to ``back`` and ``corner`` the work that a contact of balls ``i`` and ``j`` does in unit
    strains. The changes of its force on ball j are ``push`` (m + s, 3), and its motions v by unit
    strains are ``moves`` (s, 3). ``axes`` (m,) are those of the motions of a ball; ``back`` and
    ``corner`` are those of :class:`Blocks`.
    """
    m = len(axes)
    for strain in range(len(moves)):
        motion = get_row(moves, strain)
        for column in range(len(push)):
            work = dot(get_row(push, column), motion)
            if column >= m:
                corner[strain, column - m] += work
                continue
            # ball i moves against v, and turns as ball j does
            back[i, column, strain] += -work if axes[column] < 3 else work
            back[j, column, strain] += work


@compiled
def _add_turn_of_balls(
    contact: int,
    i: int,
    j: int,
    arms: tuple[float, float],
    axes: NDArray[np.int64],
    changes: _Turn,
    blocks: Blocks,
) -> None:
    """Add the forces and torques on the balls ``i`` and ``j`` of a ``contact`` to the ``blocks`` of
    balls, of the contact and of strains. They are made of the ``changes`` of
    :func:`_set_static_turn` and of the ``arms`` of balls i and j; ``axes`` (m,) are those of the
    motions of a ball.
    """
    push, torque, lever = changes
    diagonal, forward, backward, ahead, _, _ = blocks
    m = len(axes)
    arm_i, arm_j = arms
    for line in range(m):
        row = axes[line]
        for column in range(len(push)):
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


@compiled
def add_static_turn(
    columns: Columns, axes: NDArray[np.int64], strains: Array, blocks: Blocks
) -> None:
    """Add to all ``blocks`` the changes that static forces across normals cause as they turn with
    their contacts. The arguments are those of :func:`fill_tangent`.
    """
    m = len(axes)
    # v by a unit of each motion of ball j, and of each strain
    moves = np.zeros((m + len(strains), 3))
    moves_by_strain = moves[m:]
    for motion in range(m):
        if axes[motion] < 3:
            moves[motion, axes[motion]] = 1.0
    push, torque, lever = np.zeros((3, m + len(strains), 3))
    changes = _Turn(push, torque, lever)
    turns_about_normal = len(columns.origin) > 0
    for contact in range(len(columns.i)):
        # the tangent holds the forces that resist: minus those that act
        force = scale(-1.0, get_row(columns.tangential_force, contact))
        if force[0] == 0.0 and force[1] == 0.0 and force[2] == 0.0:
            continue
        i = columns.i[contact]
        j = columns.j[contact]
        arms = (columns.arm_i[contact], columns.arm_j[contact])
        normal = get_row(columns.normal, contact)
        w = get_row(columns.vector, contact)
        for strain in range(len(strains)):
            set_row(moves_by_strain, strain, _apply_strain(strains, strain, w))
        origin = get_row(columns.origin, contact) if turns_about_normal else (0.0, 0.0, 0.0)
        over_distance = 1.0 / columns.distance[contact]
        # numbers are passed on, not all columns: to pass these takes longer than all else
        _set_static_turn(normal, force, origin, over_distance, axes, moves, changes)
        _add_turn_of_balls(contact, i, j, arms, axes, changes, blocks)
        if len(strains):
            _add_turn_of_strains(i, j, axes, moves_by_strain, push, blocks.back, blocks.corner)


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

    ``diagonal`` (m, m, n), ``forward`` and ``backward`` (m, m, n_c) are those of :class:`Blocks`.
    ``by_ball`` (n, 2) has, for the block of each ball, the index of its first entry in ``data`` and
    the distance in ``data`` from one of its columns to the next; ``by_contact`` (n_c, 2, 2) has
    both for the blocks (i, j) and (j, i) of each contact.
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
