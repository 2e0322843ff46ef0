"""Contacts of balls whose places are given, rather than their motions from touch: how far they
overlap there, and what they exert.

A contact has the vector r from the centre of ball i to that of ball j, and the overlap

    o - (|r| - l)     along r
    o - (n.r - l)     along a direction n that does not turn

where o is the overlap at the distance l. The contact pushes along r or n by its law. It also
resists, as springs do, the deformations whose rows are those of
:mod:`granphon.dynamics.deformation_rows`. All arguments are in the units of the caller.
"""

from __future__ import annotations

import numpy as np

from granphon.balls.motions import Motions
from granphon.base.arrays import Array, Index
from granphon.contacts.deformation import (
    RowSprings,
    add_forces,
    add_row,
    measure_along,
    measure_distances,
)
from granphon.dynamics.deformation_rows import Row


def find_overlaps(
    vector: Array, length: float | Array, at_length: float | Array, normal: Array | None = None
) -> tuple[Array, Array]:
    """Return the overlaps (n_c,) of contacts, and the directions (n_c, d) along which contacts push
    balls j. The directions are ``normal`` if that is given. Otherwise they are unit vectors along
    ``vector``, and zero where centres coincide.

    Parameters
    ----------
    vector : (n_c, d) from the centre of ball i to that of ball j.
    length : distance l, a number or (n_c,).
    at_length : overlap o at that distance, a number or (n_c,).
    normal : (n_c, d) unit vectors along which contacts push if these do not turn with ``vector``.
    """
    loss = np.empty(len(vector))
    lengths = np.ascontiguousarray(np.broadcast_to(length, loss.shape))
    if normal is not None:
        measure_along(vector, lengths, normal, loss)
        return at_length - loss, normal
    directions = np.empty(vector.shape)
    measure_distances(vector, lengths, directions, loss)
    return at_length - loss, directions


class ContactForces:
    """Forces and torques of contacts on balls: zero at first; :meth:`press` and :meth:`resist` add
    to them.

    Parameters
    ----------
    i, j : (n_c,) numbers of the two balls of each contact.
    vector : (n_c, d) from the centre of ball i to that of ball j.
    count : number of balls, and of bodies that do not move.
    motions : the motions of each ball, displacements along some of the d axes and r rotations.

    Attributes
    ----------
    energy : energy of the springs that :meth:`resist` has added; the energy of the forces of
        :meth:`press` is not counted.
    pull : (n_c, d) forces on balls j.
    torque : (count, r) torques on balls.
    """

    def __init__(self, i: Index, j: Index, vector: Array, count: int, motions: Motions) -> None:
        """Begin with zero forces, torques and energy."""
        self._ends = (i, j)
        self._vector = vector
        self._motions = motions
        self._axes = np.array(motions.translations, np.int64)
        self.energy = 0.0
        self.pull = np.zeros(vector.shape)
        self.torque = np.zeros((count, len(motions.rotations)))

    def press(self, force: Array, normal: Array) -> None:
        """Add a ``force`` (n_c,) on ball j of each contact along its ``normal`` (n_c, d), and the
        opposite one on ball i.
        """
        self.pull += force[:, None] * normal

    def resist(self, row: Row, stiffness: Array, apart: Array, turns: Array) -> None:
        """Add the energy, the forces and the torques of springs of a ``stiffness`` (n_c,) that
        resist the deformation ``row``.

        ``apart`` (n_c, d) are the displacements of balls j less those of balls i, and ``turns``
        (count, r) are the rotations of the balls, in the coordinates of the row.
        """
        # the coefficients of one motion, which the loop reads contact after contact, have to follow
        # each other in memory
        head = np.ascontiguousarray(row.head.T)
        tail = np.ascontiguousarray(row.tail.T)
        springs = RowSprings(head, tail, stiffness)
        exerted = (self.pull, self.torque)
        self.energy += add_row(*self._ends, self._axes, springs, apart, turns, *exerted)

    def collect(self) -> tuple[Array, Array]:
        """Return the forces (count, 3) on balls, and the virial (3, 3): the sum over contacts of
        the force on ball j (first axis) times the vector (second axis). Torques are in
        :attr:`torque`.
        """
        return collect_pulls(self._ends, self._vector, self.pull, len(self.torque))


def collect_pulls(
    ends: tuple[Index, Index], vector: Array, pull: Array, count: int
) -> tuple[Array, Array]:
    """Return the forces (count, 3) on ``count`` balls, and the virial (3, 3): the sum over contacts
    of ``pull`` (first axis) times ``vector`` (second axis), both (n_c, d).

    Ball j of each contact bears the force ``pull``, of any direction, and ball i the opposite one.
    ``ends`` are the numbers (n_c,) of balls i and of balls j.
    """
    forces = np.zeros((count, 3))
    virial = np.zeros((3, 3))
    # the loop multiplies a force with a direction: here the pulls are the directions
    ones = np.ones(len(pull))
    add_forces(*ends, _put_in_space(vector), _put_in_space(pull), ones, forces, virial)
    return forces, virial


def _put_in_space(vectors: Array) -> Array:
    """Return ``vectors`` (n, d) as (n, 3), with zeros along the axes that are added."""
    if vectors.shape[1] == 3:
        return vectors
    in_space = np.zeros((len(vectors), 3))
    in_space[:, : vectors.shape[1]] = vectors
    return in_space
