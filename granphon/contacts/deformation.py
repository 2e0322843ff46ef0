"""Compiled loops over contacts: what contacts measure, and what they exert.

The bodies of an assembly have displacements (bodies, 3), its cell has a strain (3, 3), and the
vectors of its contacts at touch are (n_c, 3): see :mod:`granphon.contacts.assembly`. In fewer than
three dimensions the components along the other axes are zero: loops over three axes take half of
the time of loops over a number of axes that the compiler does not know.

Where the places of balls are given (:mod:`granphon.contacts.placed`), contacts have the vectors
(n_c, d) between centres, and the distances l (n_c,) from which losses of overlap are counted.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from granphon.base.arrays import Array, Flags
from granphon.base.compiled import compiled


class TurnedContacts(NamedTuple):
    """Contacts that have turned with their balls.

    Attributes
    ----------
    current : (n_c, 3) vectors from ball to ball.
    distance : (n_c,) lengths of these vectors.
    normal : (n_c, 3) unit vectors along these vectors.
    loss : (n_c,) what contacts have lost of their overlaps since touch.
    """

    current: Array
    distance: Array
    normal: Array
    loss: Array


class RowSprings(NamedTuple):
    """Springs that resist one deformation of each contact, ``head`` . x_j - ``tail`` . x_i, by t
    displacements and r rotations of its balls.

    Attributes
    ----------
    head, tail : (t + r, n_c) coefficients of the motions of ball j and of ball i. Those of
        displacements are the same in both; ``tail`` alone is read for them, since a spring to the
        ground has no ``head``.
    stiffness : (n_c,) force over deformation.
    """

    head: Array
    tail: Array
    stiffness: Array


@compiled
def measure_losses(
    i: NDArray[np.int64],
    j: NDArray[np.int64],
    vector: Array,
    normal: Array,
    displacement: Array,
    strain: Array,
    loss: Array,
) -> None:
    """Set ``loss`` (n_c,) to n.w: what contacts with the ``normal`` n (n_c, 3) lose of their
    overlaps, to first order in the motion.

    w = u_j - u_i + E v is made of the ``displacement`` u (bodies, 3) of the bodies ``i`` and ``j``
    (n_c,), the ``strain`` E (3, 3) of the cell, and the ``vector`` v (n_c, 3) of each contact.
    """
    for contact in range(len(i)):
        first = i[contact]
        second = j[contact]
        along = 0.0
        for axis in range(3):
            apart = displacement[second, axis] - displacement[first, axis]
            for period in range(3):
                apart += strain[axis, period] * vector[contact, period]
            along += normal[contact, axis] * apart
        loss[contact] = along


def measure_turned(
    i: NDArray[np.int64],
    j: NDArray[np.int64],
    vector: Array,
    is_flat: Flags,
    displacement: Array,
    strain: Array,
) -> TurnedContacts:
    """Return the contacts after a motion of their bodies: with v and w of :func:`measure_losses`,
    and with its arguments, their vectors are v + w, and they lose |v + w| - |v| of their overlaps.

    Flat contacts, where ``is_flat`` (n_c,) is true, keep their vectors, and lose v.w/|v|. The
    normal of a vector that becomes zero is nan; without Numba such a vector is a ZeroDivisionError.
    """
    count = len(vector)
    turned = TurnedContacts(
        current=np.empty((count, 3)),
        distance=np.empty(count),
        normal=np.empty((count, 3)),
        loss=np.empty(count),
    )
    _set_turned(i, j, vector, is_flat, displacement, strain, turned)
    return turned


@compiled
def _set_turned(
    i: NDArray[np.int64],
    j: NDArray[np.int64],
    vector: Array,
    is_flat: Flags,
    displacement: Array,
    strain: Array,
    turned: TurnedContacts,
) -> None:
    """Set the arrays of ``turned`` to what :func:`measure_turned` returns."""
    current, distance, normal, loss = turned
    for contact in range(len(i)):
        first = i[contact]
        second = j[contact]
        square_at_touch = 0.0
        square = 0.0
        square_change = 0.0
        for axis in range(3):
            apart = displacement[second, axis] - displacement[first, axis]
            for period in range(3):
                apart += strain[axis, period] * vector[contact, period]
            begin = vector[contact, axis]
            end = begin if is_flat[contact] else begin + apart
            current[contact, axis] = end
            square_at_touch += begin * begin
            square += end * end
            # |v + w|^2 - |v|^2, without a difference of squares, which would leave no digits;
            # 2 v.w of a flat contact
            square_change += (begin + end) * apart
        length = math.sqrt(square)
        distance[contact] = length
        loss[contact] = square_change / (math.sqrt(square_at_touch) + length)
        inverse_length = 1.0 / length
        for axis in range(3):
            normal[contact, axis] = inverse_length * current[contact, axis]


@compiled
def find_overlaps(offset: Array, loss: Array, rounding: float, overlap: Array) -> None:
    """Set the ``overlap`` of contacts (n_c,) to their ``offset`` on the sites less their ``loss``,
    (n_c,) each. Overlaps whose magnitude is at most ``rounding`` times the largest magnitude are
    set to zero.
    """
    largest = 0.0
    for contact in range(len(offset)):
        overlap[contact] = offset[contact] - loss[contact]
        largest = max(largest, abs(overlap[contact]))
    for contact in range(len(offset)):
        if abs(overlap[contact]) <= rounding * largest:
            overlap[contact] = 0.0


@compiled
def measure_distances(vector: Array, length: Array, normal: Array, loss: Array) -> None:
    """Set the ``normal`` of contacts (n_c, d) to the direction of their ``vector`` r (n_c, d), and
    the ``loss`` of overlaps (n_c,) to |r| - l, with the ``length`` l (n_c,). The normal is zero
    where r is zero.
    """
    d = vector.shape[1]
    for contact in range(len(vector)):
        square = 0.0
        for axis in range(d):
            square += vector[contact, axis] * vector[contact, axis]
        distance = math.sqrt(square)
        divisor = distance if distance > 0.0 else 1.0
        for axis in range(d):
            normal[contact, axis] = vector[contact, axis] / divisor
        loss[contact] = distance - length[contact]


@compiled
def measure_along(vector: Array, length: Array, normal: Array, loss: Array) -> None:
    """Set the ``loss`` of overlaps (n_c,) to n.r - l, for contacts with the ``vector`` r (n_c, d)
    and the ``length`` l (n_c,), whose ``normal`` n (n_c, d) does not turn with r.
    """
    for contact in range(len(vector)):
        along = 0.0
        for axis in range(vector.shape[1]):
            along += normal[contact, axis] * vector[contact, axis]
        loss[contact] = along - length[contact]


@compiled
def measure_resistance(
    normal: Array, move: Array, stiffness: Array, side_stiffness: Array, push: Array
) -> None:
    """Set ``push`` (n_c, 3) to the forces k (n.w) n + k' (w - (n.w) n) of contacts against small
    displacements w of balls j against balls i, ``move`` (n_c, 3); n is ``normal`` (n_c, 3), k is
    ``stiffness`` and k' ``side_stiffness``, (n_c,) each.
    """
    for contact in range(len(move)):
        loss = 0.0
        for axis in range(3):
            loss += normal[contact, axis] * move[contact, axis]
        side = side_stiffness[contact]
        along = (stiffness[contact] - side) * loss
        for axis in range(3):
            push[contact, axis] = along * normal[contact, axis] + side * move[contact, axis]


@compiled
def measure_bends(
    normal: Array,
    over_distance: Array,
    move: Array,
    force: Array,
    stiffness: Array,
    slope: Array,
    bend: Array,
    push: Array,
) -> None:
    """Set ``bend`` (n_c,) to the second derivative of the overlap h, and ``push`` (n_c, 3) to that
    of the force f(h) n, of contacts whose balls j move straight on against balls i.

    The balls move at the rate w, ``move`` (n_c, 3), and w' is the part of w across the normal n,
    ``normal`` (n_c, 3). Then

        h'' = -w'.w'/r,    (f n)'' = (c (n.w)^2 + k h'' - f w'.w'/r^2) n - 2 (k + f/r) (n.w) w'/r

    Here r is the distance of the balls, and ``over_distance`` (n_c,) is 1/r, zero for contacts that
    do not turn; f is ``force``, k = df/dh is ``stiffness`` and c = dk/dh is ``slope``, (n_c,) each.
    """
    for contact in range(len(move)):
        loss = 0.0
        for axis in range(3):
            loss += normal[contact, axis] * move[contact, axis]
        square = 0.0
        for axis in range(3):
            across = move[contact, axis] - loss * normal[contact, axis]
            square += across * across
        over = over_distance[contact]
        bend[contact] = -square * over
        along = slope[contact] * loss * loss + stiffness[contact] * bend[contact]
        along -= force[contact] * square * over * over
        aside = -2.0 * (stiffness[contact] + force[contact] * over) * loss * over
        for axis in range(3):
            across = move[contact, axis] - loss * normal[contact, axis]
            push[contact, axis] = along * normal[contact, axis] + aside * across


@compiled
def add_row(
    i: NDArray[np.int64],
    j: NDArray[np.int64],
    axes: NDArray[np.int64],
    springs: RowSprings,
    apart: Array,
    turns: Array,
    pull: Array,
    torque: Array,
) -> float:
    """Add the forces of ``springs`` to ``pull`` and their torques to ``torque``, and return the
    energy of the springs.

    Parameters
    ----------
    i, j : (n_c,) numbers of the two balls of each contact.
    axes : (t,) axes of displacements.
    springs : the springs.
    apart : (n_c, d) displacement of ball j against ball i.
    turns : (bodies, r) rotations.
    pull : (n_c, d) forces on balls j, added to.
    torque : (bodies, r) torques on all balls, added to.
    """
    head, tail, stiffness = springs
    t = len(axes)
    energy = 0.0
    for contact in range(len(i)):
        first = i[contact]
        second = j[contact]
        change = 0.0
        for line in range(t):
            change += tail[line, contact] * apart[contact, axes[line]]
        for line in range(t, len(head)):
            change += head[line, contact] * turns[second, line - t]
            change -= tail[line, contact] * turns[first, line - t]
        tension = stiffness[contact] * change
        energy += 0.5 * tension * change
        for line in range(t):
            pull[contact, axes[line]] -= tension * tail[line, contact]
        for line in range(t, len(head)):
            torque[first, line - t] += tension * tail[line, contact]
            torque[second, line - t] -= tension * head[line, contact]
    return energy


@compiled
def add_forces(
    i: NDArray[np.int64],
    j: NDArray[np.int64],
    vector: Array,
    normal: Array,
    force: Array,
    on_bodies: Array,
    virial: Array,
) -> None:
    """Add f n of each contact to the force ``on_bodies`` (bodies, 3) on its body j, and subtract
    f n from that on its body i; f is ``force`` (n_c,), and n is ``normal`` (n_c, 3).

    The sum over contacts of f n v is added to ``virial`` (3, 3), unless that is (0, 3); v is the
    ``vector`` (n_c, 3) from body i to body j.
    """
    sums_virial = len(virial) > 0
    for contact in range(len(i)):
        magnitude = force[contact]
        if magnitude == 0.0:
            continue
        first = i[contact]
        second = j[contact]
        for axis in range(3):
            component = magnitude * normal[contact, axis]
            on_bodies[first, axis] -= component
            on_bodies[second, axis] += component
            if sums_virial:
                for period in range(3):
                    virial[axis, period] += component * vector[contact, period]


@compiled
def add_blocks(
    i: NDArray[np.int64],
    j: NDArray[np.int64],
    normal: Array,
    stiffness: Array,
    blocks: Array,
) -> None:
    """Add k nn of each contact to the diagonal ``blocks`` (bodies, d, d) of its two bodies; k is
    its ``stiffness`` (n_c,), and n its ``normal`` (n_c, 3). A contact of a ball with its own image
    resists no motion of the ball, and adds nothing.
    """
    d = blocks.shape[1]
    for contact in range(len(i)):
        if i[contact] == j[contact]:
            continue
        for line in range(d):
            for column in range(d):
                entry = stiffness[contact] * normal[contact, line] * normal[contact, column]
                blocks[i[contact], line, column] += entry
                blocks[j[contact], line, column] += entry


@compiled
def invert_blocks(blocks: Array) -> None:
    """Replace symmetric positive definite ``blocks`` (n, d, d) by their inverses, by the
    elimination of Gauss and Jordan.
    """
    d = blocks.shape[1]
    for ball in range(len(blocks)):
        for pivot in range(d):
            scale = 1.0 / blocks[ball, pivot, pivot]
            blocks[ball, pivot, pivot] = 1.0
            for column in range(d):
                blocks[ball, pivot, column] *= scale
            for line in range(d):
                if line == pivot:
                    continue
                factor = blocks[ball, line, pivot]
                blocks[ball, line, pivot] = 0.0
                for column in range(d):
                    blocks[ball, line, column] -= factor * blocks[ball, pivot, column]


@compiled
def multiply_blocks(blocks: Array, vectors: Array, products: Array) -> None:
    """Set ``products`` (n, d) to ``blocks`` (n, d, d) times ``vectors`` (n, d)."""
    d = blocks.shape[1]
    for ball in range(len(blocks)):
        for line in range(d):
            total = 0.0
            for column in range(d):
                total += blocks[ball, line, column] * vectors[ball, column]
            products[ball, line] = total
