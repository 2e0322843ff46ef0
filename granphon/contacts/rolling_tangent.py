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


@compiled
def _add_press_in_plane(
    ends: tuple[int, int],
    arms: tuple[float, float],
    law: _PlaneLaw,
    lattice_normal: tuple[float, float],
    n: Array,
    t: Array,
    ahead: Array,
    back: Array,
) -> float:
    """Add to ``ahead`` and ``back`` of :func:`fill_tangent` what a unit of the overlap y does at
    one contact in a plane; return by how much the unit changes the normal force.

    ``ends``, ``arms`` and ``law`` are those of the contact, ``lattice_normal`` are the components
    along n and t of the direction e at touch. ``n`` and ``t`` (2,) are the components along n and t
    of unit motions in each coordinate of displacements.
    """
    i, j = ends
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
    ahead[2, i] += arms[0] * change + torque
    ahead[2, j] += arms[1] * change + torque
    return k * e_n


@compiled
def _add_motions_in_plane(
    ends: tuple[int, int],
    place: int,
    arms: tuple[float, float],
    law: _PlaneLaw,
    n: Array,
    t: Array,
    diagonal: Array,
    forward_rows: Array,
    backward_rows: Array,
) -> None:
    """Add to ``diagonal`` of :func:`fill_tangent` what one contact in a plane does against motions
    of its balls, and set its blocks, at ``place`` in ``forward_rows`` and ``backward_rows`` (3, 3,
    _CHUNK).

    The other arguments are those of :func:`_add_press_in_plane`.
    """
    i, j = ends
    arm_i, arm_j = arms
    spring = law.spring
    for motion in range(2):
        # forces and torques on both balls against a displacement of either
        along, across, change, torque = _resist_in_plane(law, n[motion], t[motion])
        for line in range(2):
            push = n[line] * along + t[line] * across
            diagonal[line, motion, i] += push
            diagonal[line, motion, j] += push
            forward_rows[line, motion, place] = -push
            backward_rows[motion, line, place] = -push
        on_i = arm_i * change + torque
        on_j = arm_j * change + torque
        diagonal[2, motion, i] += on_i
        diagonal[2, motion, j] -= on_j
        forward_rows[2, motion, place] = -on_i
        backward_rows[motion, 2, place] = on_j
        # forces on both balls against rotations
        shear = spring * t[motion]
        diagonal[motion, 2, i] += arm_i * shear
        diagonal[motion, 2, j] -= arm_j * shear
        forward_rows[motion, 2, place] = arm_j * shear
        backward_rows[2, motion, place] = -arm_i * shear
    # torques against rotations
    diagonal[2, 2, i] += arm_i * arm_i * spring
    diagonal[2, 2, j] += arm_j * arm_j * spring
    forward_rows[2, 2, place] = arm_i * arm_j * spring
    backward_rows[2, 2, place] = arm_i * arm_j * spring


@compiled
def _fill_plane(
    contacts: RollingContacts,
    at: Configuration,
    tangent: SlipTangent,
    normal_force: Array,
    shears: Array,
    axes: Array,
    diagonal: Array,
    forward: NDArray[Any],
    backward: NDArray[Any],
    ahead: Array,
    back: Array,
) -> float:
    """Do what :func:`fill_tangent` does, with the same arguments, for balls in a plane: m is 3, two
    displacements and a rotation.
    """
    is_free = ahead.shape[1] > 0
    eps = contacts.ratio
    corner = 0.0
    n = np.empty(2)
    t = np.empty(2)
    count = len(normal_force)
    forward_rows = np.empty((3, 3, _CHUNK))
    backward_rows = np.empty((3, 3, _CHUNK))
    for start in range(0, count, _CHUNK):
        stop = min(start + _CHUNK, count)
        for c in range(start, stop):
            ends = (contacts.i[c], contacts.j[c])
            x = at.normal[c, 0]
            y = at.normal[c, 1]
            distance = at.distance[c]
            arms = (0.5 * distance - contacts.uneven[c], 0.5 * distance + contacts.uneven[c])
            q = tangent.sliding[0, c]
            spring = tangent.shear[c] * (1.0 - q * q) + tangent.drag
            tilt = eps / distance
            law = _PlaneLaw(
                k=tangent.stiffness[c],
                spring=spring,
                coupling=tangent.coupling[0, c],
                side_stiffness=spring - tilt * normal_force[c],
                shear_stiffness=tilt * shears[0, c],
                lever=0.5 * eps * shears[0, c],
            )
            # components along n and t of a unit motion in each coordinate of displacements
            for motion in range(2):
                n[motion] = x * axes[0, motion] + y * axes[1, motion]
                t[motion] = x * axes[1, motion] - y * axes[0, motion]
            if is_free:
                e_n = x * contacts.normal[c, 0] + y * contacts.normal[c, 1]
                e_t = x * contacts.normal[c, 1] - y * contacts.normal[c, 0]
                corner += _add_press_in_plane(ends, arms, law, (e_n, e_t), n, t, ahead, back)
            _add_motions_in_plane(
                ends, c - start, arms, law, n, t, diagonal, forward_rows, backward_rows
            )
        _write_rows(forward_rows, forward, start, stop)
        _write_rows(backward_rows, backward, start, stop)
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
    law: _SpaceLaw, v_n: float, v_t: float, v_b: float, r_t: float, r_b: float, turn: float
) -> tuple[float, ...]:
    """Return eight components along n, t and b = n x t of what resists a small motion.

    The first three are those of the force k e n + dT - f dn + turn x T on ball j. The next three
    are those of n x dT + turn x (n x T), the torque over minus the arm. The last two are those of
    (eps/2) e (n x T) along t and b, which is subtracted from the torque on both balls.

    ``v_n``, ``v_t`` and ``v_b`` are components of the motion of centre j against centre i, ``r_t``
    and ``r_b`` those of arm_i phi_i + arm_j phi_j, and ``turn`` is the angle by which
    rotations of the balls turn the tangents about n.
    """
    slip_t = v_t - r_b
    slip_b = v_b + r_t
    change_t = law.spring_tt * slip_t + law.spring_tb * slip_b - law.coupling_t * v_n
    change_b = law.spring_tb * slip_t + law.spring_bb * slip_b - law.coupling_b * v_n
    tilt_t = law.tilt * v_t
    tilt_b = law.tilt * v_b
    spin = turn - law.spin_b * tilt_t + law.spin_t * tilt_b
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
def _collect_law(
    c: int,
    ratio: float,
    distance: float,
    tangent: SlipTangent,
    force: float,
    shears: Array,
    lattice_normal: Vector,
) -> _SpaceLaw:
    """Return the law of contact ``c``. ``ratio`` is eps, ``distance`` that of the centres,
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


@compiled
def _set_wrench(
    resistance: tuple[float, ...],
    along: Array,
    turning: Array,
    arms: tuple[float, float],
    push: Array,
    torques: Array,
) -> None:
    """Set ``push`` (3,) to the force on ball j in the coordinates of displacements, and ``torques``
    (2, 3) to the torques on balls i and j along the axes of space.

    ``resistance`` are the components that :func:`_resist_in_space` returns, ``along`` and
    ``turning`` (3, 3) those that :func:`_set_axes` sets; ``arms`` are those of balls i and j.
    """
    f_n, f_t, f_b, w_n, w_t, w_b, l_t, l_b = resistance
    arm_i, arm_j = arms
    for axis in range(3):
        push[axis] = along[0, axis] * f_n + along[1, axis] * f_t + along[2, axis] * f_b
        wrench = turning[0, axis] * w_n + turning[1, axis] * w_t + turning[2, axis] * w_b
        lever = turning[1, axis] * l_t + turning[2, axis] * l_b
        torques[0, axis] = -arm_i * wrench - lever
        torques[1, axis] = -arm_j * wrench - lever


@compiled
def _set_axes(along: Array, turning: Array, normal: Vector, tangent: Vector, axes: Array) -> None:
    """Set the rows of ``turning`` and of ``along``, (3, 3) each, to the ``normal`` n, the
    ``tangent`` t and b = n x t: in ``turning`` by their components along the axes of space, in
    ``along`` by those in the coordinates of displacements. The matrix ``axes`` (3, 3) takes these
    coordinates to the axes of space.
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
def _add_press_in_space(
    ends: tuple[int, int],
    arms: tuple[float, float],
    law: _SpaceLaw,
    lattice_normal: Vector,
    vectors: tuple[Array, Array],
    wrench: tuple[Array, Array],
    ahead: Array,
    back: Array,
) -> float:
    """Add to ``ahead`` and ``back`` of :func:`fill_tangent` what a unit of the overlap y does at
    one contact in space; return by how much the unit changes the normal force.

    ``ends``, ``arms`` and ``law`` are those of the contact, ``lattice_normal`` are the components
    along n, t and b of the direction e at touch, ``vectors`` are ``along`` and ``turning`` of
    :func:`_set_axes`, and ``wrench`` is room for ``push`` and ``torques`` of :func:`_set_wrench`.
    """
    i, j = ends
    e_n, e_t, e_b = lattice_normal
    along, turning = vectors
    push, torques = wrench
    # a unit of y moves centre j by -e against centre i
    resistance = _resist_in_space(law, -e_n, -e_t, -e_b, 0.0, 0.0, 0.0)
    _set_wrench(resistance, along, turning, arms, push, torques)
    for axis in range(3):
        ahead[axis, i] -= push[axis]
        ahead[axis, j] += push[axis]
        ahead[3 + axis, i] += torques[0, axis]
        ahead[3 + axis, j] += torques[1, axis]
        back[axis, i] += law.k * along[0, axis]
        back[axis, j] -= law.k * along[0, axis]
    return law.k * e_n


@compiled
def _add_displacements_in_space(
    ends: tuple[int, int],
    place: int,
    arms: tuple[float, float],
    law: _SpaceLaw,
    vectors: tuple[Array, Array],
    wrench: tuple[Array, Array],
    diagonal: Array,
    forward_rows: Array,
    backward_rows: Array,
) -> None:
    """Add to ``diagonal`` of :func:`fill_tangent` what one contact in space does against
    displacements of its balls, and set these columns of its blocks, at ``place`` in
    ``forward_rows`` and ``backward_rows`` (6, 6, _CHUNK).

    The other arguments are those of :func:`_add_press_in_space`.
    """
    i, j = ends
    along, turning = vectors
    push, torques = wrench
    for motion in range(3):
        # forces against a displacement of ball j: minus those against a displacement of ball i
        resistance = _resist_in_space(
            law, along[0, motion], along[1, motion], along[2, motion], 0.0, 0.0, 0.0
        )
        _set_wrench(resistance, along, turning, arms, push, torques)
        for axis in range(3):
            diagonal[axis, motion, i] += push[axis]
            diagonal[axis, motion, j] += push[axis]
            forward_rows[axis, motion, place] = -push[axis]
            backward_rows[motion, axis, place] = -push[axis]
            diagonal[3 + axis, motion, i] -= torques[0, axis]
            diagonal[3 + axis, motion, j] += torques[1, axis]
            forward_rows[3 + axis, motion, place] = torques[0, axis]
            backward_rows[motion, 3 + axis, place] = -torques[1, axis]


@compiled
def _add_rotations_in_space(
    ends: tuple[int, int],
    place: int,
    arms: tuple[float, float],
    law: _SpaceLaw,
    e: Vector,
    vectors: tuple[Array, Array],
    wrench: tuple[Array, Array],
    diagonal: Array,
    forward_rows: Array,
    backward_rows: Array,
) -> None:
    """Do what :func:`_add_displacements_in_space` does, for rotations of the balls of a contact
    with the direction ``e`` at touch, along the axes of space.
    """
    i, j = ends
    arm_i, arm_j = arms
    along, turning = vectors
    push, torques = wrench
    for motion in range(3):
        # tangents turn about n with the mean rotation of both balls about e
        spin = law.lever * e[motion]
        r_t = turning[1, motion]
        r_b = turning[2, motion]
        resistance = _resist_in_space(law, 0.0, 0.0, 0.0, arm_i * r_t, arm_i * r_b, spin)
        _set_wrench(resistance, along, turning, arms, push, torques)
        for axis in range(3):
            diagonal[axis, 3 + motion, i] -= push[axis]
            backward_rows[3 + motion, axis, place] = push[axis]
            diagonal[3 + axis, 3 + motion, i] += torques[0, axis]
            backward_rows[3 + motion, 3 + axis, place] = torques[1, axis]
        resistance = _resist_in_space(law, 0.0, 0.0, 0.0, arm_j * r_t, arm_j * r_b, spin)
        _set_wrench(resistance, along, turning, arms, push, torques)
        for axis in range(3):
            diagonal[axis, 3 + motion, j] += push[axis]
            forward_rows[axis, 3 + motion, place] = -push[axis]
            diagonal[3 + axis, 3 + motion, j] += torques[1, axis]
            forward_rows[3 + axis, 3 + motion, place] = torques[0, axis]


@compiled
def _fill_space(
    contacts: RollingContacts,
    at: Configuration,
    tangent: SlipTangent,
    normal_force: Array,
    shears: Array,
    axes: Array,
    diagonal: Array,
    forward: NDArray[Any],
    backward: NDArray[Any],
    ahead: Array,
    back: Array,
) -> float:
    """Do what :func:`fill_tangent` does, with the same arguments, for balls in space: m is 6, three
    displacements and three rotations.
    """
    is_free = ahead.shape[1] > 0
    along = np.empty((3, 3))
    turning = np.empty((3, 3))
    vectors = (along, turning)
    wrench = (np.empty(3), np.empty((2, 3)))
    corner = 0.0
    count = len(normal_force)
    forward_rows = np.empty((6, 6, _CHUNK))
    backward_rows = np.empty((6, 6, _CHUNK))
    rows = (forward_rows, backward_rows)
    for start in range(0, count, _CHUNK):
        stop = min(start + _CHUNK, count)
        for c in range(start, stop):
            place = c - start
            ends = (contacts.i[c], contacts.j[c])
            n = get_row(at.normal, c)
            t = get_row(at.tangent, c)
            e = get_row(contacts.normal, c)
            distance = at.distance[c]
            arms = (0.5 * distance - contacts.uneven[c], 0.5 * distance + contacts.uneven[c])
            _set_axes(along, turning, n, t, axes)
            components = (dot(n, e), dot(t, e), dot(cross(n, t), e))  # of e along n, t and b
            law = _collect_law(
                c, contacts.ratio, distance, tangent, normal_force[c], shears, components
            )
            if is_free:
                corner += _add_press_in_space(
                    ends, arms, law, components, vectors, wrench, ahead, back
                )
            _add_displacements_in_space(ends, place, arms, law, vectors, wrench, diagonal, *rows)
            _add_rotations_in_space(ends, place, arms, law, e, vectors, wrench, diagonal, *rows)
        _write_rows(forward_rows, forward, start, stop)
        _write_rows(backward_rows, backward, start, stop)
    return corner


def fill_tangent(
    contacts: RollingContacts,
    at: Configuration,
    tangent: SlipTangent,
    normal_force: Array,
    shears: Array,
    axes: Array,
    diagonal: Array,
    forward: NDArray[Any],
    backward: NDArray[Any],
    ahead: Array,
    back: Array,
) -> float:
    """Fill the blocks of the tangent, the forces on balls that resist small motions of balls.
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
    diagonal : (m, m, n_balls) forces on each ball against its own motions, added to.
    forward : (m, m, n_c) forces on ball i of each contact against motions of ball j; set.
    backward : (m, m, n_c) forces on ball j of each contact (second axis) against motions of ball i
        (first axis); set.
    ahead : (m, n_balls) forces on balls against a unit of y, added to; (m, 0) if the overlap is
        held.
    back : (m, n_balls) minus the change of the sum of normal forces by each unit motion, added to;
        (m, 0) if the overlap is held.
    """
    blocks = (diagonal, forward, backward, ahead, back)
    if len(axes) == 2:
        return _fill_plane(contacts, at, tangent, normal_force, shears, axes, *blocks)
    return _fill_space(contacts, at, tangent, normal_force, shears, axes, *blocks)
