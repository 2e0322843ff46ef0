"""Compiled loops over the contacts of balls that slip and roll: the tangent of what contacts exert,
as blocks of a grid (:class:`~granphon.contacts.grid_product.GridProduct`).

Symbols are those of :mod:`granphon.contacts.slips`. A small motion changes the force f n - T on
ball j and the torque arm n x T on both balls by the law of the contact, and because n and the
tangents turn. With

    e = n.v,    dn = (1 - nn) eps v/|w|,    turn = n x dn + spin n

ball j is resisted by k e n + dT - f dn + turn x T, and both balls by the torques -arm (n x dT +
turn x (n x T)) - (eps/2) e (n x T). Here k is the stiffness of the normal force, eps the unit of
displacements over the diameter, and spin the angle about n by which tangents turn
(:mod:`granphon.contacts.slips`). This tangent has no potential, and is not symmetric.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from granphon.base.arrays import Array
from granphon.base.compiled import compiled
from granphon.contacts.friction import Configuration, RollingContacts
from granphon.contacts.sliding import SlipTangent
from granphon.contacts.slips import LEAST_DIVISOR
from granphon.contacts.vectors import Vector, cross, dot, get_row, set_row

#: number of contacts whose blocks are found before they are written, entry by entry
_CHUNK = 64


class TangentBlocks(NamedTuple):
    """The blocks of the tangent of n_c contacts of n_balls balls with m motions each, 3 in a plane
    and 6 in space. The overlap y is a motion too, or is held.

    Attributes
    ----------
    diagonal : (m, m, n_balls) forces on each ball against its own motions.
    forward : (m, m, n_c) forces on ball i of each contact against motions of ball j.
    backward : (m, m, n_c) forces on ball j of each contact (second axis) against motions of ball i
        (first axis).
    ahead : (m, n_balls) forces on balls against a unit of y; (m, 0) if the overlap is held.
    back : (m, n_balls) the change of the sum of normal forces by each unit motion; (m, 0) if the
        overlap is held.
    """

    diagonal: Array
    forward: NDArray[Any]
    backward: NDArray[Any]
    ahead: Array
    back: Array


class _Contact(NamedTuple):
    """Where one contact stands: the numbers of its balls i and j, their arms, and its place in a
    chunk.
    """

    i: int
    j: int
    arm_i: float
    arm_j: float
    place: int


@compiled
def _find_contact(contacts: RollingContacts, distance: float, c: int, start: int) -> _Contact:
    """Return where contact ``c`` stands, in a chunk that begins with the contact ``start``;
    ``distance`` is that of its centres, over the diameter.
    """
    half = 0.5 * distance
    uneven = contacts.uneven[c]
    return _Contact(contacts.i[c], contacts.j[c], half - uneven, half + uneven, c - start)


@compiled
def _write_rows(rows: Array, blocks: NDArray[Any], start: int, stop: int) -> None:
    """Set the ``blocks`` (m, m, n_c) of the contacts from ``start`` to before ``stop``, at most
    :data:`_CHUNK` of them, to ``rows`` (m, m, _CHUNK). For each entry of a block the loop goes
    through memory in order.
    """
    for line in range(len(rows)):
        for motion in range(len(rows)):
            row = rows[line, motion]
            entries = blocks[line, motion, start:stop]
            for place in range(stop - start):
                entries[place] = row[place]


class _PlaneLaw(NamedTuple):
    """Numbers by which one contact in a plane resists small motions.

    Attributes
    ----------
    k : stiffness of the normal force.
    spring : stiffness against slip.
    coupling : change of T by a unit of the overlap.
    side_stiffness : force along t against a unit motion of the centres along t: the stiffness
        against slip less eps f/|w|, as f turns.
    shear_stiffness : minus the force along n against a unit motion along t: eps T/|w|, as T turns.
    lever : torque on both balls against a unit motion along n: eps T/2.
    """

    k: float
    spring: float
    coupling: float
    side_stiffness: float
    shear_stiffness: float
    lever: float


@compiled
def _resist_in_plane(law: _PlaneLaw, v_n: float, v_t: float) -> tuple[float, float, float, float]:
    """Return four numbers of what resists a motion of centre j against centre i in a plane; the
    components of the motion along n and t are ``v_n`` and ``v_t``.

    The first two are the components along n and t of the force on ball j; the third is the change
    of T, which makes torques by the arms; the fourth is the torque on both balls that T makes as
    the contact elongates.
    """
    shear_change = -law.coupling * v_n  # as the overlap changes
    return (
        law.k * v_n - law.shear_stiffness * v_t,
        law.side_stiffness * v_t + shear_change,
        law.spring * v_t + shear_change,
        law.lever * v_n,
    )


class _PlaneRoom(NamedTuple):
    """Arrays that a loop over contacts in a plane sets anew for each contact.

    Attributes
    ----------
    n, t : (2,) components along n and t of a unit motion in each coordinate of displacements.
    forward, backward : (3, 3, _CHUNK) blocks of the contacts of a chunk, as those of
        :class:`TangentBlocks`.
    """

    n: Array
    t: Array
    forward: Array
    backward: Array


@compiled
def _add_press_in_plane(
    contact: _Contact,
    law: _PlaneLaw,
    lattice_normal: tuple[float, float],
    room: _PlaneRoom,
    ahead: Array,
    back: Array,
) -> float:
    """Add to ``ahead`` and ``back`` of :class:`TangentBlocks` what a unit of the overlap y does at
    one ``contact`` in a plane; return by how much the unit changes the normal force.

    ``lattice_normal`` are the components along n and t of the direction e at touch.
    """
    i = contact.i
    j = contact.j
    n = room.n
    t = room.t
    e_n, e_t = lattice_normal
    k = law.k
    # a unit of y moves centre j by -e against centre i; the signs below are those for +e
    along, across, change, torque = _resist_in_plane(law, e_n, e_t)
    for motion in range(2):
        push = n[motion] * along + t[motion] * across
        ahead[motion, i] += push
        ahead[motion, j] -= push
        back[motion, i] += k * n[motion]
        back[motion, j] -= k * n[motion]
    ahead[2, i] += contact.arm_i * change + torque
    ahead[2, j] += contact.arm_j * change + torque
    return k * e_n


@compiled
def _add_motions_in_plane(
    contact: _Contact, law: _PlaneLaw, room: _PlaneRoom, diagonal: Array
) -> None:
    """Add to ``diagonal`` of :class:`TangentBlocks` what one ``contact`` in a plane does against
    motions of its balls, and set its blocks in the ``room``.
    """
    i = contact.i
    j = contact.j
    arm_i = contact.arm_i
    arm_j = contact.arm_j
    place = contact.place
    n = room.n
    t = room.t
    forward = room.forward
    backward = room.backward
    spring = law.spring
    for motion in range(2):
        # forces and torques on both balls against a displacement of either
        along, across, change, torque = _resist_in_plane(law, n[motion], t[motion])
        for line in range(2):
            push = n[line] * along + t[line] * across
            diagonal[line, motion, i] += push
            diagonal[line, motion, j] += push
            forward[line, motion, place] = -push
            backward[motion, line, place] = -push
        on_i = arm_i * change + torque
        on_j = arm_j * change + torque
        diagonal[2, motion, i] += on_i
        diagonal[2, motion, j] -= on_j
        forward[2, motion, place] = -on_i
        backward[motion, 2, place] = on_j
        # forces on both balls against rotations
        shear = spring * t[motion]
        diagonal[motion, 2, i] += arm_i * shear
        diagonal[motion, 2, j] -= arm_j * shear
        forward[motion, 2, place] = arm_j * shear
        backward[2, motion, place] = -arm_i * shear
    # torques against rotations
    diagonal[2, 2, i] += arm_i * arm_i * spring
    diagonal[2, 2, j] += arm_j * arm_j * spring
    forward[2, 2, place] = arm_i * arm_j * spring
    backward[2, 2, place] = arm_i * arm_j * spring


@compiled
def _collect_plane_law(
    c: int, ratio: float, distance: float, tangent: SlipTangent, force: float, shears: Array
) -> _PlaneLaw:
    """Return the law of contact ``c`` in a plane. ``ratio`` is eps, ``distance`` that of the
    centres, ``tangent`` the derivatives and ``shears`` (1, n_c) the tangential forces of all
    contacts, and ``force`` the normal force.
    """
    q = tangent.sliding[0, c]
    spring = tangent.shear[c] * (1.0 - q * q) + tangent.drag
    tilt = ratio / distance
    return _PlaneLaw(
        k=tangent.stiffness[c],
        spring=spring,
        coupling=tangent.coupling[0, c],
        side_stiffness=spring - tilt * force,
        shear_stiffness=tilt * shears[0, c],
        lever=0.5 * ratio * shears[0, c],
    )


@compiled
def _fill_plane(
    contacts: RollingContacts,
    at: Configuration,
    tangent: SlipTangent,
    normal_force: Array,
    shears: Array,
    axes: Array,
    blocks: TangentBlocks,
) -> float:
    """Do what :func:`fill_tangent` does, with the same arguments, for balls in a plane: m is 3, two
    displacements and a rotation.
    """
    diagonal, forward, backward, ahead, back = blocks
    is_free = ahead.shape[1] > 0
    corner = 0.0
    count = len(normal_force)
    shape = (3, 3, _CHUNK)
    room = _PlaneRoom(np.empty(2), np.empty(2), np.empty(shape), np.empty(shape))
    n = room.n
    t = room.t
    for start in range(0, count, _CHUNK):
        stop = min(start + _CHUNK, count)
        for c in range(start, stop):
            x = at.normal[c, 0]
            y = at.normal[c, 1]
            distance = at.distance[c]
            contact = _find_contact(contacts, distance, c, start)
            law = _collect_plane_law(c, contacts.ratio, distance, tangent, normal_force[c], shears)
            for motion in range(2):
                n[motion] = x * axes[0, motion] + y * axes[1, motion]
                t[motion] = x * axes[1, motion] - y * axes[0, motion]
            if is_free:
                e_n = x * contacts.normal[c, 0] + y * contacts.normal[c, 1]
                e_t = x * contacts.normal[c, 1] - y * contacts.normal[c, 0]
                corner += _add_press_in_plane(contact, law, (e_n, e_t), room, ahead, back)
            _add_motions_in_plane(contact, law, room, diagonal)
        _write_rows(room.forward, forward, start, stop)
        _write_rows(room.backward, backward, start, stop)
    return corner


class _SpaceLaw(NamedTuple):
    """Numbers by which one contact in space resists small motions; tangential components are those
    along t and b = n x t.

    Attributes
    ----------
    k : stiffness of the normal force.
    coupling_t, coupling_b : changes of T by a unit of the overlap.
    spring_tt, spring_tb, spring_bb : stiffnesses against slip.
    tilt : eps/|w|, the angle by which n turns in a unit motion of the centres across n.
    prestress : eps f/|w| of the normal force f.
    lever : eps/2.
    shear_t, shear_b : components of the tangential force T.
    spin_t, spin_b : components of the direction e at touch over 1 + n.e: as n turns by a small dn,
        tangents spin about n by spin_t dn_b - spin_b dn_t.
    """

    k: float
    coupling_t: float
    coupling_b: float
    spring_tt: float
    spring_tb: float
    spring_bb: float
    tilt: float
    prestress: float
    lever: float
    shear_t: float
    shear_b: float
    spin_t: float
    spin_b: float


@compiled
def _resist_in_space(
    law: _SpaceLaw, v_n: float, v_t: float, v_b: float, r_t: float, r_b: float, ball_spin: float
) -> tuple[float, ...]:
    """Return eight components along n, t and b = n x t of what resists a small motion.

    The first three are those of the force k e n + dT - f dn + turn x T on ball j. The next three
    are those of n x dT + turn x (n x T), the torque over minus the arm. The last two are those of
    (eps/2) e (n x T) along t and b, which is subtracted from the torque on both balls.

    ``v_n``, ``v_t`` and ``v_b`` are components of the motion of centre j against centre i, ``r_t``
    and ``r_b`` those of arm_i phi_i + arm_j phi_j. ``ball_spin`` is the part of spin, the angle by
    which tangents turn about n, that rotations of the balls add; the vector turn is n x dn + spin
    n.
    """
    slip_t = v_t - r_b
    slip_b = v_b + r_t
    change_t = law.spring_tt * slip_t + law.spring_tb * slip_b - law.coupling_t * v_n
    change_b = law.spring_tb * slip_t + law.spring_bb * slip_b - law.coupling_b * v_n
    tilt_t = law.tilt * v_t
    tilt_b = law.tilt * v_b
    spin = ball_spin + law.spin_t * tilt_b - law.spin_b * tilt_t
    return (
        law.k * v_n - tilt_t * law.shear_t - tilt_b * law.shear_b,
        change_t - law.prestress * v_t - spin * law.shear_b,
        change_b - law.prestress * v_b + spin * law.shear_t,
        tilt_t * law.shear_b - tilt_b * law.shear_t,
        -change_b - spin * law.shear_t,
        change_t - spin * law.shear_b,
        -law.lever * v_n * law.shear_b,
        law.lever * v_n * law.shear_t,
    )


@compiled
def _collect_space_law(
    c: int,
    ratio: float,
    distance: float,
    tangent: SlipTangent,
    force: float,
    shears: Array,
    lattice_normal: Vector,
) -> _SpaceLaw:
    """Return the law of contact ``c`` in space. ``ratio`` is eps, ``distance`` that of the centres,
    ``tangent`` the derivatives and ``shears`` (2, n_c) the tangential forces of all contacts,
    ``force`` the normal force, and ``lattice_normal`` the components of e along n, t and b.
    """
    shear = tangent.shear[c]
    q_t = tangent.sliding[0, c]
    q_b = tangent.sliding[1, c]
    tilt = ratio / distance
    e_n, e_t, e_b = lattice_normal
    denominator = max(1.0 + e_n, LEAST_DIVISOR)
    return _SpaceLaw(
        k=tangent.stiffness[c],
        coupling_t=tangent.coupling[0, c],
        coupling_b=tangent.coupling[1, c],
        spring_tt=shear * (1.0 - q_t * q_t) + tangent.drag,
        spring_tb=-shear * q_t * q_b,
        spring_bb=shear * (1.0 - q_b * q_b) + tangent.drag,
        tilt=tilt,
        prestress=tilt * force,
        lever=0.5 * ratio,
        shear_t=shears[0, c],
        shear_b=shears[1, c],
        spin_t=e_t / denominator,
        spin_b=e_b / denominator,
    )


class _SpaceRoom(NamedTuple):
    """Arrays that a loop over contacts in space sets anew for each contact.

    Attributes
    ----------
    along, turning : (3, 3) the rows are n, t and b = n x t: in ``along`` in the coordinates of
        displacements, in ``turning`` along the axes of space.
    push : (3,) force on ball j, in the coordinates of displacements.
    torques : (2, 3) torques on balls i and j, along the axes of space.
    forward, backward : (6, 6, _CHUNK) blocks of the contacts of a chunk, as those of
        :class:`TangentBlocks`.
    """

    along: Array
    turning: Array
    push: Array
    torques: Array
    forward: Array
    backward: Array


@compiled
def _set_axes(along: Array, turning: Array, normal: Vector, tangent: Vector, axes: Array) -> None:
    """Set ``along`` and ``turning`` of :class:`_SpaceRoom` for a contact with the ``normal`` n and
    the ``tangent`` t. The matrix ``axes`` (3, 3) takes the coordinates of displacements to the axes
    of space.
    """
    set_row(turning, 0, normal)
    set_row(turning, 1, tangent)
    set_row(turning, 2, cross(normal, tangent))
    for row in range(3):
        for axis in range(3):
            along[row, axis] = (
                turning[row, 0] * axes[0, axis]
                + turning[row, 1] * axes[1, axis]
                + turning[row, 2] * axes[2, axis]
            )


@compiled
def _set_wrench(resistance: tuple[float, ...], contact: _Contact, room: _SpaceRoom) -> None:
    """Set ``push`` and ``torques`` of the ``room`` from the components of a ``resistance`` that
    :func:`_resist_in_space` returns.
    """
    f_n, f_t, f_b, w_n, w_t, w_b, l_t, l_b = resistance
    along = room.along
    turning = room.turning
    push = room.push
    torques = room.torques
    for axis in range(3):
        push[axis] = along[0, axis] * f_n + along[1, axis] * f_t + along[2, axis] * f_b
        wrench = turning[0, axis] * w_n + turning[1, axis] * w_t + turning[2, axis] * w_b
        lever = turning[1, axis] * l_t + turning[2, axis] * l_b
        torques[0, axis] = -contact.arm_i * wrench - lever
        torques[1, axis] = -contact.arm_j * wrench - lever


@compiled
def _add_press_in_space(
    contact: _Contact,
    law: _SpaceLaw,
    lattice_normal: Vector,
    room: _SpaceRoom,
    ahead: Array,
    back: Array,
) -> float:
    """Add to ``ahead`` and ``back`` of :class:`TangentBlocks` what a unit of the overlap y does at
    one ``contact`` in space; return by how much the unit changes the normal force.

    ``lattice_normal`` are the components along n, t and b of the direction e at touch.
    """
    i = contact.i
    j = contact.j
    along = room.along
    push = room.push
    torques = room.torques
    e_n, e_t, e_b = lattice_normal
    # a unit of y moves centre j by -e against centre i
    resistance = _resist_in_space(law, -e_n, -e_t, -e_b, 0.0, 0.0, 0.0)
    _set_wrench(resistance, contact, room)
    for axis in range(3):
        ahead[axis, i] -= push[axis]
        ahead[axis, j] += push[axis]
        ahead[3 + axis, i] += torques[0, axis]
        ahead[3 + axis, j] += torques[1, axis]
        back[axis, i] += law.k * along[0, axis]
        back[axis, j] -= law.k * along[0, axis]
    return law.k * e_n


@compiled
def _add_motion_of_i(
    contact: _Contact, motion: int, sign: float, room: _SpaceRoom, diagonal: Array
) -> None:
    """Add to ``diagonal`` of :class:`TangentBlocks` the forces and torques against a unit
    ``motion`` of ball i, 0 to 5, and set those on ball j in ``room.backward``. They are ``sign``
    times the ``push`` and the ``torques`` of the ``room``.
    """
    push = room.push
    torques = room.torques
    backward = room.backward
    for axis in range(3):
        diagonal[axis, motion, contact.i] -= sign * push[axis]
        diagonal[3 + axis, motion, contact.i] += sign * torques[0, axis]
        backward[motion, axis, contact.place] = sign * push[axis]
        backward[motion, 3 + axis, contact.place] = sign * torques[1, axis]


@compiled
def _add_motion_of_j(contact: _Contact, motion: int, room: _SpaceRoom, diagonal: Array) -> None:
    """Add to ``diagonal`` of :class:`TangentBlocks` the forces and torques against a unit
    ``motion`` of ball j, 0 to 5, and set those on ball i in ``room.forward``. They are the ``push``
    and the ``torques`` of the ``room``.
    """
    push = room.push
    torques = room.torques
    forward = room.forward
    for axis in range(3):
        diagonal[axis, motion, contact.j] += push[axis]
        diagonal[3 + axis, motion, contact.j] += torques[1, axis]
        forward[axis, motion, contact.place] = -push[axis]
        forward[3 + axis, motion, contact.place] = torques[0, axis]


@compiled
def _add_displacements_in_space(
    contact: _Contact, law: _SpaceLaw, room: _SpaceRoom, diagonal: Array
) -> None:
    """Add to ``diagonal`` of :class:`TangentBlocks` what one ``contact`` in space does against
    displacements of its balls, and set these columns of its blocks in the ``room``.
    """
    along = room.along
    for motion in range(3):
        resistance = _resist_in_space(
            law, along[0, motion], along[1, motion], along[2, motion], 0.0, 0.0, 0.0
        )
        _set_wrench(resistance, contact, room)
        _add_motion_of_j(contact, motion, room, diagonal)
        # a displacement of ball i moves the contact the other way
        _add_motion_of_i(contact, motion, -1.0, room, diagonal)


@compiled
def _add_rotations_in_space(
    contact: _Contact, law: _SpaceLaw, e: Vector, room: _SpaceRoom, diagonal: Array
) -> None:
    """Do what :func:`_add_displacements_in_space` does, for rotations of the balls about the axes
    of space; ``e`` is the direction of the contact at touch.
    """
    turning = room.turning
    arm_i = contact.arm_i
    arm_j = contact.arm_j
    for motion in range(3):
        # tangents turn about n with the mean rotation of both balls about e
        ball_spin = law.lever * e[motion]
        r_t = turning[1, motion]
        r_b = turning[2, motion]
        resistance = _resist_in_space(law, 0.0, 0.0, 0.0, arm_i * r_t, arm_i * r_b, ball_spin)
        _set_wrench(resistance, contact, room)
        _add_motion_of_i(contact, 3 + motion, 1.0, room, diagonal)
        resistance = _resist_in_space(law, 0.0, 0.0, 0.0, arm_j * r_t, arm_j * r_b, ball_spin)
        _set_wrench(resistance, contact, room)
        _add_motion_of_j(contact, 3 + motion, room, diagonal)


@compiled
def _fill_space(
    contacts: RollingContacts,
    at: Configuration,
    tangent: SlipTangent,
    normal_force: Array,
    shears: Array,
    axes: Array,
    blocks: TangentBlocks,
) -> float:
    """Do what :func:`fill_tangent` does, with the same arguments, for balls in space: m is 6, three
    displacements and three rotations.
    """
    diagonal, forward, backward, ahead, back = blocks
    is_free = ahead.shape[1] > 0
    corner = 0.0
    count = len(normal_force)
    shape = (6, 6, _CHUNK)
    room = _SpaceRoom(
        along=np.empty((3, 3)),
        turning=np.empty((3, 3)),
        push=np.empty(3),
        torques=np.empty((2, 3)),
        forward=np.empty(shape),
        backward=np.empty(shape),
    )
    for start in range(0, count, _CHUNK):
        stop = min(start + _CHUNK, count)
        for c in range(start, stop):
            n = get_row(at.normal, c)
            t = get_row(at.tangent, c)
            e = get_row(contacts.normal, c)
            distance = at.distance[c]
            contact = _find_contact(contacts, distance, c, start)
            _set_axes(room.along, room.turning, n, t, axes)
            components = (dot(n, e), dot(t, e), dot(cross(n, t), e))  # of e along n, t and b
            law = _collect_space_law(
                c, contacts.ratio, distance, tangent, normal_force[c], shears, components
            )
            if is_free:
                corner += _add_press_in_space(contact, law, components, room, ahead, back)
            _add_displacements_in_space(contact, law, room, diagonal)
            _add_rotations_in_space(contact, law, e, room, diagonal)
        _write_rows(room.forward, forward, start, stop)
        _write_rows(room.backward, backward, start, stop)
    return corner


def fill_tangent(
    contacts: RollingContacts,
    at: Configuration,
    tangent: SlipTangent,
    normal_force: Array,
    shears: Array,
    axes: Array,
    blocks: TangentBlocks,
) -> float:
    """Fill the ``blocks`` of the tangent, the forces on balls that resist small motions of balls.
    Return by how much a unit of the overlap y raises the sum of normal forces; zero if the overlap
    is held.

    Motions and forces are in the coordinates of :func:`~granphon.contacts.slips.list_motions` and
    :func:`~granphon.contacts.slips.collect_forces`.

    Parameters
    ----------
    contacts : the contacts.
    at : where balls and contacts are.
    tangent : derivatives of the forces by the law of friction.
    normal_force : (n_c,) normal forces f, which turn with their contacts.
    shears : (n_s, n_c) components of the tangential forces T, which turn too; n_s is p - 1.
    axes : (p, p) matrix that takes coordinates of displacements to the axes of space; p is 2 or 3,
        and the number m of motions of a ball is 3 or 6.
    blocks : ``forward`` and ``backward`` are set; the others are added to.
    """
    if len(axes) == 2:
        return _fill_plane(contacts, at, tangent, normal_force, shears, axes, blocks)
    return _fill_space(contacts, at, tangent, normal_force, shears, axes, blocks)
