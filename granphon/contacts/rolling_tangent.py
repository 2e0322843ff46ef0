"""Loops over the contacts of balls that slip and roll, compiled: the tangent of what they exert, as
blocks of a grid (:class:`~granphon.contacts.grid_product.GridProduct`).

With the words of :mod:`granphon.contacts.slips`, a small motion changes the force f n - T on ball j
and the torque arm n x T on both balls by what the law of the contact says, and by what turns: with

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
from granphon.contacts.friction import Configuration, RollingContacts, SlipTangent
from granphon.contacts.slips import ROUND
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
    aside : stiffness of the force along t against motions of the centres along t: that against
        slip, less eps f/|w|.
    turned : minus the force along n by a unit motion along t, as T turns: eps T/|w|.
    lever : torque on both balls by a unit motion along n: eps T/2.
    """

    k: float
    spring: float
    coupling: float
    aside: float
    turned: float
    lever: float


@compiled
def _resist_in_plane(law: _PlaneLaw, v_n: float, v_t: float) -> tuple[float, float, float, float]:
    """Return what resists the motion of centre j against centre i in a plane, by its components
    ``v_n`` and ``v_t`` along n and t: the components along n and t of the force on ball j; the
    change of T, which makes torques by the arms; and the torque on both balls that T makes as the
    contact elongates.
    """
    coupled = -law.coupling * v_n
    return (
        law.k * v_n - law.turned * v_t,
        law.aside * v_t + coupled,
        law.spring * v_t + coupled,
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
    along n and t of the direction e on the lattice, and ``n`` and ``t`` (2,) those of unit motions
    in the coordinates of displacements.
    """
    i, j = ends
    e_n, e_t = lattice_normal
    k = law.k
    # a unit of y moves the centres by -e against each other
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
            place = c - start
            i = contacts.i[c]
            j = contacts.j[c]
            x = at.normal[c, 0]
            y = at.normal[c, 1]
            size = at.distance[c]
            over = eps / size
            arm_i = 0.5 * size - contacts.uneven[c]
            arm_j = 0.5 * size + contacts.uneven[c]
            q = tangent.sliding[0, c]
            spring = tangent.shear[c] * (1.0 - q * q) + tangent.drag
            law = _PlaneLaw(
                k=tangent.stiffness[c],
                spring=spring,
                coupling=tangent.coupling[0, c],
                aside=spring - over * normal_force[c],
                turned=over * shears[0, c],
                lever=0.5 * eps * shears[0, c],
            )
            # components along n and t of a unit motion in each coordinate of displacements
            for motion in range(2):
                n[motion] = x * axes[0, motion] + y * axes[1, motion]
                t[motion] = x * axes[1, motion] - y * axes[0, motion]
            if is_free:
                e_n = x * contacts.normal[c, 0] + y * contacts.normal[c, 1]
                e_t = x * contacts.normal[c, 1] - y * contacts.normal[c, 0]
                corner += _add_press_in_plane(
                    (i, j), (arm_i, arm_j), law, (e_n, e_t), n, t, ahead, back
                )
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
                slid = spring * t[motion]
                diagonal[motion, 2, i] += arm_i * slid
                diagonal[motion, 2, j] -= arm_j * slid
                forward_rows[motion, 2, place] = arm_j * slid
                backward_rows[2, motion, place] = -arm_i * slid
            # torques against rotations
            diagonal[2, 2, i] += arm_i * arm_i * spring
            diagonal[2, 2, j] += arm_j * arm_j * spring
            forward_rows[2, 2, place] = arm_i * arm_j * spring
            backward_rows[2, 2, place] = arm_i * arm_j * spring
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
    over : eps/|w|, by which n turns in a unit motion of the centres.
    pressed : eps f/|w| of the normal force f.
    lever : eps/2.
    held_t, held_b : the tangential force T.
    spin_t, spin_b : components of the direction e on the lattice over 1 + n.e, by which the contact
        spins as n turns along b and along t.
    """

    k: float
    coupling_t: float
    coupling_b: float
    spring_tt: float
    spring_tb: float
    spring_bb: float
    over: float
    pressed: float
    lever: float
    held_t: float
    held_b: float
    spin_t: float
    spin_b: float


@compiled
def _resist(
    law: _SpaceLaw, v_n: float, v_t: float, v_b: float, r_t: float, r_b: float, turn: float
) -> tuple[float, ...]:
    """Return eight components, along n, t and b = n x t, of what resists a small motion.

    The first three are those of the force k e n + dT - f dn + turn x T on ball j; the next three
    those of n x dT + turn x (n x T), the torque over minus the arm; the last two those along t and
    b of (eps/2) e (n x T), which is subtracted from the torque on both balls.

    ``v_n``, ``v_t`` and ``v_b`` are components of the motion of centre j against centre i, ``r_t``
    and ``r_b`` those of arm_i phi_i + arm_j phi_j, and ``turn`` is the part of the spin that
    follows from rotations alone.
    """
    slip_t = v_t - r_b
    slip_b = v_b + r_t
    change_t = law.spring_tt * slip_t + law.spring_tb * slip_b - law.coupling_t * v_n
    change_b = law.spring_tb * slip_t + law.spring_bb * slip_b - law.coupling_b * v_n
    tilt_t = law.over * v_t
    tilt_b = law.over * v_b
    spin = turn - law.spin_b * tilt_t + law.spin_t * tilt_b
    return (
        law.k * v_n - tilt_t * law.held_t - tilt_b * law.held_b,
        change_t - law.pressed * v_t - spin * law.held_b,
        change_b - law.pressed * v_b + spin * law.held_t,
        tilt_t * law.held_b - tilt_b * law.held_t,
        -change_b - spin * law.held_t,
        change_t - spin * law.held_b,
        -law.lever * v_n * law.held_b,
        law.lever * v_n * law.held_t,
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
    """Return the law of contact ``c``, with eps, ``ratio``, the ``distance`` of the centres, the
    normal ``force``, the ``shears`` (2, n_c) of all contacts, and the components
    ``lattice_normal`` of e along n, t and b.
    """
    shear = tangent.shear[c]
    q_t = tangent.sliding[0, c]
    q_b = tangent.sliding[1, c]
    over = ratio / distance
    e_n, e_t, e_b = lattice_normal
    denominator = max(1.0 + e_n, ROUND)
    return _SpaceLaw(
        k=tangent.stiffness[c],
        coupling_t=tangent.coupling[0, c],
        coupling_b=tangent.coupling[1, c],
        spring_tt=shear * (1.0 - q_t * q_t) + tangent.drag,
        spring_tb=-shear * q_t * q_b,
        spring_bb=shear * (1.0 - q_b * q_b) + tangent.drag,
        over=over,
        pressed=over * force,
        lever=0.5 * ratio,
        held_t=shears[0, c],
        held_b=shears[1, c],
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
    """Set ``push`` (3,), the force on ball j in the coordinates of displacements, and ``torques``
    (2, 3), those on balls i and j along the axes of space, from the components of a ``resistance``,
    which :func:`_resist` returns.

    The rows n, t and b of ``along`` (3, 3) and of ``turning`` (3, 3) have the coordinates of
    displacements and the axes of space; ``arms`` are those of balls i and j.
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
    """Set the rows of ``turning`` (3, 3) to n, t and b = n x t along the axes of space, from the
    ``normal`` n and the ``tangent`` t, and the rows of ``along`` (3, 3) to the same vectors in the
    coordinates of displacements, which the matrix ``axes`` (3, 3) takes to the axes of space.
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
    eps = contacts.ratio
    along = np.empty((3, 3))
    turning = np.empty((3, 3))
    push = np.empty(3)
    torques = np.empty((2, 3))
    corner = 0.0
    count = len(normal_force)
    forward_rows = np.empty((6, 6, _CHUNK))
    backward_rows = np.empty((6, 6, _CHUNK))
    for start in range(0, count, _CHUNK):
        stop = min(start + _CHUNK, count)
        for c in range(start, stop):
            place = c - start
            i = contacts.i[c]
            j = contacts.j[c]
            n = get_row(at.normal, c)
            t = get_row(at.tangent, c)
            e = get_row(contacts.normal, c)
            size = at.distance[c]
            arms = (0.5 * size - contacts.uneven[c], 0.5 * size + contacts.uneven[c])
            _set_axes(along, turning, n, t, axes)
            e_n = dot(n, e)
            e_t = dot(t, e)
            e_b = dot(cross(n, t), e)
            law = _collect_law(c, eps, size, tangent, normal_force[c], shears, (e_n, e_t, e_b))
            k = tangent.stiffness[c]
            if is_free:  # a unit of the overlap moves the centres against the lattice direction e
                resistance = _resist(law, -e_n, -e_t, -e_b, 0.0, 0.0, 0.0)
                _set_wrench(resistance, along, turning, arms, push, torques)
                corner += k * e_n
                for axis in range(3):
                    ahead[axis, i] -= push[axis]
                    ahead[axis, j] += push[axis]
                    ahead[3 + axis, i] += torques[0, axis]
                    ahead[3 + axis, j] += torques[1, axis]
                    back[axis, i] += k * along[0, axis]
                    back[axis, j] -= k * along[0, axis]
            # columns of displacements: those of ball j, which are minus those of ball i
            for motion in range(3):
                resistance = _resist(
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
            # columns of rotations, of ball i and of ball j
            for motion in range(3):
                spin = 0.5 * eps * contacts.normal[c, motion]
                r_t = turning[1, motion]
                r_b = turning[2, motion]
                resistance = _resist(law, 0.0, 0.0, 0.0, arms[0] * r_t, arms[0] * r_b, spin)
                _set_wrench(resistance, along, turning, arms, push, torques)
                for axis in range(3):
                    diagonal[axis, 3 + motion, i] -= push[axis]
                    backward_rows[3 + motion, axis, place] = push[axis]
                    diagonal[3 + axis, 3 + motion, i] += torques[0, axis]
                    backward_rows[3 + motion, 3 + axis, place] = torques[1, axis]
                resistance = _resist(law, 0.0, 0.0, 0.0, arms[1] * r_t, arms[1] * r_b, spin)
                _set_wrench(resistance, along, turning, arms, push, torques)
                for axis in range(3):
                    diagonal[axis, 3 + motion, j] += push[axis]
                    forward_rows[axis, 3 + motion, place] = -push[axis]
                    diagonal[3 + axis, 3 + motion, j] += torques[1, axis]
                    forward_rows[3 + axis, 3 + motion, place] = torques[0, axis]
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
    """Fill the blocks of the tangent: forces on balls that resist small motions of balls. Return
    the sum over contacts of the changes of normal forces by a unit of the overlap y; zero if the
    overlap is held.

    Motions and forces are in the coordinates of :func:`~granphon.contacts.slips.list_motions` and
    :func:`~granphon.contacts.slips.collect_forces`.

    Parameters
    ----------
    contacts, at : the contacts, and where they are.
    tangent : derivatives of the forces by the law of friction.
    normal_force : (n_c,) normal forces f, which turn with their contacts.
    shears : (n_s, n_c) components of the tangential forces T, which turn too; n_s is p - 1.
    axes : (p, p) matrix that takes coordinates of displacements to the axes of space; p is 2 or 3,
        and the number m of motions of a ball is 3 or 6.
    diagonal : (m, m, n) forces on each ball against its own motions, added to.
    forward, backward : (m, m, n_c) forces on ball i against the motions of ball j, and, for each
        motion of ball i, the forces on ball j; both are set.
    ahead : (m, n) forces on balls against a unit of y, added to; (m, 0) if the overlap is held.
    back : (m, n) minus the sums over contacts of the changes of normal forces by each motion, added
        to; (m, 0) if the overlap is held.
    """
    blocks = (diagonal, forward, backward, ahead, back)
    if len(axes) == 2:
        return _fill_plane(contacts, at, tangent, normal_force, shears, axes, *blocks)
    return _fill_space(contacts, at, tangent, normal_force, shears, axes, *blocks)
