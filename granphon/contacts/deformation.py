"""Loops over the contacts of an assembly, compiled: what contacts measure, and what they exert.

Bodies have the displacements (bodies, 3), the cell has a strain (3, 3), and vectors at touch are
(n_c, 3): see :mod:`granphon.contacts.assembly`. On axes that there are not, all is zero: loops of
three turns take half of the time of loops whose length is not known.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from granphon.base.arrays import Array, Flags
from granphon.base.compiled import compiled


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
    """Set ``loss`` (n_c,) to n.w: what contacts lose of their overlaps along their normals."""
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


@compiled
def measure_turned(
    i: NDArray[np.int64],
    j: NDArray[np.int64],
    vector: Array,
    is_flat: Flags,
    displacement: Array,
    strain: Array,
    loss: Array,
    current: Array,
    distance: Array,
) -> None:
    """Set the ``loss`` |v + w| - |v| of overlaps (n_c,), and the ``current`` vectors v + w (n_c, 3)
    and their ``distance`` (n_c,).

    Flat contacts keep their vectors, and lose n.w.
    """
    for contact in range(len(i)):
        first = i[contact]
        second = j[contact]
        touching = 0.0
        grown = 0.0
        product = 0.0
        for axis in range(3):
            apart = displacement[second, axis] - displacement[first, axis]
            for period in range(3):
                apart += strain[axis, period] * vector[contact, period]
            begin = vector[contact, axis]
            end = begin if is_flat[contact] else begin + apart
            current[contact, axis] = end
            touching += begin * begin
            grown += end * end
            # |v + w|^2 - |v|^2 without the squares, which would leave no digits; 2 v.w if flat
            product += (begin + end) * apart
        distance[contact] = math.sqrt(grown)
        loss[contact] = product / (math.sqrt(touching) + distance[contact])


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
    """Add the forces along the normals to those on bodies (bodies, 3), and f n v to the ``virial``
    (3, 3).
    """
    for contact in range(len(i)):
        size = force[contact]
        if size == 0.0:
            continue
        first = i[contact]
        second = j[contact]
        for axis in range(3):
            component = size * normal[contact, axis]
            on_bodies[first, axis] -= component
            on_bodies[second, axis] += component
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
    """Add k nn of each contact to the ``blocks`` (bodies, d, d) of its two bodies alone."""
    d = blocks.shape[1]
    for contact in range(len(i)):
        if i[contact] == j[contact]:  # a ball and its own image
            continue
        for line in range(d):
            for column in range(d):
                entry = stiffness[contact] * normal[contact, line] * normal[contact, column]
                blocks[i[contact], line, column] += entry
                blocks[j[contact], line, column] += entry


@compiled
def invert_blocks(blocks: Array) -> None:
    """Replace symmetric positive definite ``blocks`` (n, d, d) by their inverses, by Gauss and
    Jordan.
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
