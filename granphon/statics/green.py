"""Green's function of an array whose contacts are all alike: the motions of its balls under forces,
by Fourier transforms.
"""

from __future__ import annotations

import math
from functools import lru_cache
from typing import Any

import numpy as np
from numpy.typing import NDArray

from granphon.base.compiled import compiled
from granphon.contacts.grid import Grid
from granphon.dynamics.linalg import invert_hermitian
from granphon.statics.options import GridOptions
from granphon.statics.transforms import count_waves, find_transform

Values = NDArray[Any]


class GreenFunction:
    """The inverse of the tangent of contacts on a ``grid``, all of stiffness one along their
    normals: from forces on balls to displacements.

    ``workers`` threads share each Fourier transform; ``options`` say whether the inverse is kept
    for other arrays on the same grid. The inverse is zero for translations of the whole array, and
    for other waves that deform no contact.
    """

    def __init__(self, grid: Grid, workers: int, options: GridOptions | None = None) -> None:
        numbers = options or GridOptions()
        self._workers = workers
        self._shape = grid.shape
        key = (
            grid.shape,
            grid.n_balls,
            tuple(grid.i.tolist()),
            tuple(grid.j.tolist()),
            tuple(grid.shift.ravel().tolist()),
            tuple(grid.normal[:, : len(grid.shape)].ravel().tolist()),
        )
        n_fields = len(grid.shape) * grid.n_balls
        memory = find_table_memory(grid.shape, n_fields, _choose_precision(grid.n_balls))
        is_kept = memory <= numbers.green_memory
        find = _find_table if is_kept else _find_table.__wrapped__
        #: (f, f, waves) inverse for each wave, f being the motions of the balls of a cell; real if
        #: the cell has one ball
        self._table = find(numbers.batch, *key)

    def apply(self, forces: Values, scale: float) -> Values:
        """Return ``scale`` times the motions (f, cells) under ``forces`` (f, cells), in the
        precision of the forces.
        """
        transform = find_transform(self._shape, forces.dtype, self._workers)
        waves = transform.find_waves(forces)
        waves_of_motions = multiply_waves(self._table, forces.dtype.type(scale), waves)
        return transform.find_fields(waves_of_motions)


def find_table_memory(shape: tuple[int, ...], n_fields: int, precision: Any) -> int:
    """Return the bytes of a table (f, f, waves) of numbers of a ``precision``, for the waves of a
    real Fourier transform on a grid of the ``shape`` and for ``n_fields`` f.
    """
    return int(n_fields**2 * math.prod(count_waves(shape)) * np.dtype(precision).itemsize)


def _choose_precision(n_balls: int) -> Any:
    """Return the type of the numbers of a table of :class:`GreenFunction` for cells of ``n_balls``
    balls: a preconditioner needs few digits, and the table of one ball is real.
    """
    return np.float32 if n_balls == 1 else np.complex64


@lru_cache(maxsize=8)
def _find_table(
    batch: int,
    shape: tuple[int, ...],
    n_balls: int,
    first: tuple[int, ...],
    second: tuple[int, ...],
    shifts: tuple[int, ...],
    normals: tuple[float, ...],
) -> Values:
    """Return the table (f, f, waves) of :class:`GreenFunction`, for the waves of a real Fourier
    transform. At most ``batch`` matrices are inverted at a time, but always all of one index along
    the first axis.

    ``shape`` are the cells along each axis, and ``n_balls`` the balls of a cell. Of each kind of
    contact, ``first`` and ``second`` are its balls in the cell, ``shifts`` the steps from the cell
    of the first to that of the second, and ``normals`` its direction, the last two flattened. All
    arguments are hashable, as tables are kept.
    """
    d = len(shape)
    n_fields = d * n_balls
    contacts = list(zip(first, second, np.reshape(shifts, (-1, d)), strict=True))
    directions = np.reshape(normals, (-1, d))
    counts = count_waves(shape)
    table = np.zeros((n_fields, n_fields, *counts), _choose_precision(n_balls))
    translations = np.zeros((n_fields, n_fields))  # projection on translations of the whole array
    for axis in range(d):
        translations[axis::d, axis::d] = 1.0 / n_balls
    step = max(1, batch * counts[0] // math.prod(counts))
    for low in range(0, counts[0], step):
        waves = [np.arange(count) for count in counts]
        waves[0] = waves[0][low : low + step]
        matrix = _find_matrices(n_fields, contacts, directions, list_phases(shape, waves))
        if low == 0:  # nothing resists translations: unit springs make the matrix invertible
            matrix[(0,) * d] += translations
        inverse = invert_hermitian(matrix)
        if low == 0:
            inverse[(0,) * d] -= translations
        table[:, :, low : low + step] = np.moveaxis(inverse, (-2, -1), (0, 1))
    flat = table.reshape(n_fields, n_fields, -1)
    flat.flags.writeable = False
    return flat


def _find_matrices(
    n_fields: int, contacts: list[tuple[int, int, Values]], directions: Values, phases: list[Values]
) -> Values:
    """Return the tangents (..., f, f) of contacts of stiffness one for waves with the ``phases``
    (...), rad, from one cell to the next along each axis; f is ``n_fields``.

    ``contacts`` are the balls i and j of each kind of contact, and the steps (d,) from the cell of
    ball i to that of ball j; ``directions`` (kinds, d) are unit vectors. Of cells with one ball the
    tangents are real: with each contact at a ball there is the same one on its other side, and
    their phases, of opposite sign, have a real sum.
    """
    is_real = n_fields == directions.shape[1]
    matrix = np.zeros((*phases[0].shape, n_fields, n_fields), float if is_real else complex)
    for (i, j, steps), direction in zip(contacts, directions, strict=True):
        angle = sum(count * phase for count, phase in zip(steps.tolist(), phases, strict=True))
        projection = np.outer(direction, direction)
        if is_real:
            # |exp(i angle) - 1|^2
            matrix += (4.0 * np.sin(0.5 * angle) ** 2)[..., None, None] * projection
        else:
            _add_contact(projection, i, j, angle, matrix)
    return matrix


def _add_contact(projection: Values, i: int, j: int, angle: Any, matrix: Values) -> None:
    """Add to the ``matrix`` (..., f, f) of all waves the tangent of a contact of stiffness one from
    ball ``i`` of a cell to ball ``j``, with the ``projection`` (d, d) on its direction; ``angle``
    (...), rad, is the phase of each wave from the cell of the first to that of the second.
    """
    d = len(projection)
    at_i = slice(d * i, d * (i + 1))
    at_j = slice(d * j, d * (j + 1))
    ahead = np.exp(1j * angle)[..., None, None] * projection
    matrix[..., at_i, at_i] += projection
    matrix[..., at_j, at_j] += projection
    matrix[..., at_i, at_j] -= ahead
    matrix[..., at_j, at_i] -= np.conj(ahead)


def list_phases(shape: tuple[int, ...], waves: list[Any]) -> list[Any]:
    """Return, for each axis of a grid of the ``shape``, the phases, rad, of waves from one cell to
    the next along the axis. ``waves`` are the indices (w,) of the waves along each axis; each array
    of phases has the shape of the waves along all axes.
    """
    along = [2.0 * np.pi / length * index for length, index in zip(shape, waves, strict=True)]
    return list(np.meshgrid(*along, indexing="ij"))


def multiply_waves(table: Values, scale: Any, waves: Values) -> Values:
    """Return ``scale`` times the products of matrices ``table`` (f, f, waves), one for each wave,
    and the ``waves`` (f, ...) of f motions, or of several right sides (f, k, ...) of them.
    """
    out = np.empty_like(waves)
    flat = (len(waves), -1, table.shape[-1])
    _multiply(table, scale, waves.reshape(flat), out.reshape(flat))
    return out


@compiled
def _multiply(table: Values, scale: float, waves: Values, out: Values) -> None:
    """Set ``out`` (f, k, waves) to what :func:`multiply_waves` returns."""
    out[:] = 0.0
    for line in range(len(table)):
        for field in range(len(table)):
            factor = table[line, field]
            for k in range(waves.shape[1]):
                column = waves[field, k]
                sums = out[line, k]
                for wave in range(len(factor)):
                    sums[wave] += scale * factor[wave] * column[wave]
