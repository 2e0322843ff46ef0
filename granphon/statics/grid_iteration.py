"""Conjugate gradients for the linear response of a list that is a grid, preconditioned in Fourier
space.

Where nearly all contacts of an array are closed, its matrix is near that of equal contacts, whose
inverse, the Green's function of the lattice, is a product in Fourier space. It carries forces
across the array; each ball alone takes account of contacts that differ. Some ten iterations for all
right sides at once then take less time than factors. The preconditioner is in single precision.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from functools import lru_cache
from typing import Any

import numpy as np
from numpy.typing import NDArray

from granphon.balls.motions import Motions
from granphon.base.arrays import Array
from granphon.base.compiled import compiled
from granphon.contacts.contact_list import ContactList
from granphon.contacts.tangent import Tangent, find_tangent

Values = NDArray[Any]
#: stiffness, over the mean, that the preconditioner adds to each motion: motions that cost nothing,
#: such as that of the whole, have no inverse
_HOLDING = 1e-5
#: decimals of the mean stiffnesses, over the mean of all, and of the mean directions of a kind of
#: contact: Green's function need not be exact, and samples of a packing share one
_DIGITS = 2
#: balls of a grid, at most, whose Green's function is kept
_KEPT_BALLS = 2**13


class GridPreconditioner:
    """Approximate inverse of the tangent of a list that is a grid, in single precision.

    It sums the motions under Green's function of equal contacts, the means over each kind, and
    those of each ball alone while its neighbours are held. It is symmetric and positive definite.
    """

    def __init__(self, contacts: ContactList, tangent: Tangent) -> None:
        self._shape = contacts.grid
        self._cells = math.prod(contacts.grid)
        self._in_cell = contacts.n_balls // self._cells
        self._n_motions = len(contacts.axes)
        self._green = _find_green(contacts)
        pattern = tangent.pattern
        blocks = tangent.data[pattern.by_ball]
        least = _HOLDING * float(np.mean(contacts.normal_stiffness))
        alone = np.linalg.inv(blocks + least * np.eye(self._n_motions))
        self._alone = alone.astype(np.float32)

    def __call__(self, forces: Values) -> Values:
        """Return motions (n m, k) under forces (n m, k)."""
        from scipy import fft  # imported here: media that are not simulated do not need it

        columns = forces.shape[-1]
        single = forces.astype(np.float32)
        # the axes of cells first: one transform for all motions, and for all right sides
        axes = tuple(range(len(self._shape)))
        by_cell = single.reshape(self._in_cell, *self._shape, -1)
        if self._in_cell > 1:
            by_cell = np.moveaxis(by_cell, 0, -2)
        waves = fft.rfftn(by_cell.reshape(*self._shape, -1), axes=axes)
        by_wave = waves.reshape(len(self._green), -1, columns)
        moved = np.empty_like(by_wave)
        _multiply_waves(self._green, by_wave, moved)
        motions = fft.irfftn(moved.reshape(waves.shape), self._shape, axes=axes, overwrite_x=True)
        if self._in_cell > 1:
            motions = np.moveaxis(motions.reshape(*self._shape, self._in_cell, -1), -2, 0)
        by_ball = np.ascontiguousarray(motions).reshape(-1, self._n_motions, columns)
        _add_alone(self._alone, single.reshape(by_ball.shape), by_ball)
        return by_ball.reshape(forces.shape)


def _find_green(contacts: ContactList) -> NDArray[Any]:
    """Return (waves, f, f) inverses in Fourier space for equal contacts of each kind; f are the
    motions of the balls of a cell.
    """
    shape = contacts.grid
    cells = math.prod(shape)
    kinds = contacts.n_contacts // cells
    level = float(np.mean(contacts.normal_stiffness)) or 1.0

    def average(values: Array, scale: float = 1.0) -> tuple[Any, ...]:
        """Return the mean of each kind, to few digits, so that samples of a packing have the
        same.
        """
        means = np.mean(values.reshape(kinds, cells, -1), axis=1) / scale
        return tuple(np.round(means, _DIGITS).ravel().tolist())

    find = _find_equal_green if contacts.n_balls <= _KEPT_BALLS else _find_equal_green.__wrapped__
    green = find(
        shape,
        contacts.motions,
        tuple(divmod(ball, cells) for ball in contacts.i[::cells].tolist()),
        tuple(divmod(ball, cells) for ball in contacts.j[::cells].tolist()),
        average(contacts.vector),
        average(contacts.normal),
        average(contacts.arm_i),
        average(contacts.arm_j),
        average(contacts.normal_stiffness, level),
        average(contacts.shear_stiffness, level),
        average(contacts.torsion_stiffness, level),
        average(contacts.bending_stiffness, level),
    )
    return np.asarray(green / np.float32(level))


@lru_cache(maxsize=8)
def _find_equal_green(
    shape: tuple[int, ...],
    motions: Motions,
    ends_i: tuple[tuple[int, int], ...],
    ends_j: tuple[tuple[int, int], ...],
    vector: tuple[float, ...],
    normal: tuple[float, ...],
    *each: tuple[float, ...],
) -> NDArray[Any]:
    """Return (waves, f, f) inverses in Fourier space of the tangent of contacts of these kinds.

    ``ends_i`` and ``ends_j`` are the ball of the cell, and the cell, of either end of each kind;
    ``each`` are arms and stiffnesses.
    """
    kinds = len(ends_i)
    m = motions.count
    arm_i, arm_j, stiffness, shear, torsion, bending = (np.array(values) for values in each)
    directions = np.array(normal).reshape(kinds, 3)
    # the kinds alone, each between two balls of its own
    balls = 2 * np.arange(kinds)
    equal = ContactList(
        n_balls=2 * kinds,
        motions=motions,
        i=balls,
        j=balls + 1,
        vector=np.array(vector).reshape(kinds, 3),
        normal=directions / np.linalg.norm(directions, axis=1)[:, None],
        arm_i=arm_i,
        arm_j=arm_j,
        normal_stiffness=stiffness,
        shear_stiffness=shear,
        torsion_stiffness=torsion,
        bending_stiffness=bending,
        normal_force=np.zeros(kinds),
        measure=1.0,
        dimension=len(shape),
    )
    pairs = find_tangent(equal, np.zeros((0, 3, 3))).matrix.toarray()
    waves = (*shape[:-1], shape[-1] // 2 + 1)
    ticks = np.meshgrid(
        *(
            2.0 * np.pi / length * np.arange(count)
            for length, count in zip(shape, waves, strict=True)
        ),
        indexing="ij",
    )
    fields = m * (1 + max(ball for ball, _ in ends_i + ends_j))
    matrix = np.zeros((*waves, fields, fields), complex)
    for kind, ((i, start), (j, end)) in enumerate(zip(ends_i, ends_j, strict=True)):
        first = slice(2 * m * kind, 2 * m * kind + m)
        second = slice(2 * m * kind + m, 2 * m * (kind + 1))
        steps = np.subtract(np.unravel_index(end, shape), np.unravel_index(start, shape))
        angle = sum(step * tick for step, tick in zip(steps, ticks, strict=True))
        ahead = np.exp(1j * angle)[..., None, None]
        at_i = slice(m * i, m * (i + 1))
        at_j = slice(m * j, m * (j + 1))
        matrix[..., at_i, at_i] += pairs[first, first]
        matrix[..., at_i, at_j] += ahead * pairs[first, second]
        matrix[..., at_j, at_i] += np.conj(ahead) * pairs[second, first]
        matrix[..., at_j, at_j] += pairs[second, second]
    level = float(np.mean(np.diagonal(pairs)))
    matrix += _HOLDING * level * np.eye(fields)
    matrix[(0,) * len(waves)] += level * np.eye(fields)
    return np.linalg.inv(matrix).reshape(-1, fields, fields).astype(np.complex64)


def iterate(
    tangent: Tangent,
    precondition: Callable[[Values], Values],
    forces: Array,
    reduction: float,
    most: int,
    floor: float,
) -> tuple[Array, bool, bool]:
    """Solve for the motions (n m, k) under ``forces`` (n m, k) by conjugate gradients.

    Returns the motions, whether their error in the norm of the energy has fallen by ``reduction``
    within ``most`` iterations, and whether all curvatures met were above zero. ``floor`` is the
    square of the norm below which the rest is rounding.
    """
    matrix = tangent.matrix.T  # a matrix in rows is multiplied sooner; this one is symmetric
    motions = np.zeros_like(forces)
    remaining = forces.copy()
    way = np.zeros_like(forces)
    products = np.zeros(forces.shape[1])
    aim = math.inf
    for count in range(most + 1):
        better = precondition(remaining)
        last = products
        products = _multiply_columns(remaining, better)
        total = float(np.sum(products))
        aim = reduction**2 * total if count == 0 else aim
        if total <= max(aim, floor):
            return motions, True, True
        _turn(way, better, np.divide(products, last, out=np.zeros_like(last), where=last > 0.0))
        change = matrix @ way
        curvatures = _multiply_columns(way, change)
        if np.any(curvatures < 0.0):
            return motions, False, False
        moving = curvatures > 0.0
        lengths = np.divide(products, curvatures, out=np.zeros_like(last), where=moving)
        _advance(motions, remaining, way, change, lengths)
    return motions, False, True


@compiled
def _multiply_columns(one: Values, other: Values) -> Array:
    """Return the sums (k,) of products of the entries of each column."""
    sums = np.zeros(one.shape[1])
    for line in range(one.shape[0]):
        for column in range(one.shape[1]):
            sums[column] += one[line, column] * other[line, column]
    return sums


@compiled
def _turn(way: Array, better: Values, part: Array) -> None:
    """Multiply each column of ``way`` by its ``part`` of the way before, and add ``better``."""
    for line in range(way.shape[0]):
        for column in range(way.shape[1]):
            way[line, column] = part[column] * way[line, column] + better[line, column]


@compiled
def _advance(motions: Array, remaining: Array, way: Array, change: Array, lengths: Array) -> None:
    """Go the ``lengths`` of each column along ``way``, by which forces ``change``."""
    for line in range(way.shape[0]):
        for column in range(way.shape[1]):
            motions[line, column] += lengths[column] * way[line, column]
            remaining[line, column] -= lengths[column] * change[line, column]


@compiled
def _multiply_waves(green: Values, waves: Values, out: Values) -> None:
    """Set ``out`` (waves, f, k) to products of matrices (waves, f, f) and columns (waves, f, k)."""
    for wave in range(waves.shape[0]):
        for line in range(green.shape[1]):
            for column in range(waves.shape[2]):
                out[wave, line, column] = 0.0
            for field in range(green.shape[2]):
                factor = green[wave, line, field]
                for column in range(waves.shape[2]):
                    out[wave, line, column] += factor * waves[wave, field, column]


@compiled
def _add_alone(blocks: Values, forces: Values, motions: Values) -> None:
    """Add to ``motions`` (n, m, k) those of each ball under ``forces`` while its neighbours are
    held; ``blocks`` (n, m, m).
    """
    for ball in range(forces.shape[0]):
        for line in range(blocks.shape[1]):
            for motion in range(blocks.shape[2]):
                factor = blocks[ball, line, motion]
                for column in range(forces.shape[2]):
                    motions[ball, line, column] += factor * forces[ball, motion, column]
