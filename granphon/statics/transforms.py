"""Fourier transforms of real fields on a grid, from cells to waves and back.

Fast transforms take some ten microseconds before they begin. On a short grid the product with a
matrix along each axis has ended by then. An iteration with Green's function needs two transforms.
"""

from __future__ import annotations

import math
from abc import ABC, abstractmethod
from functools import cache, lru_cache
from typing import Any

import numpy as np
from numpy.typing import NDArray

Values = NDArray[Any]
#: products of two numbers, at most, by which matrices transform a field: the cells times the sum of
#: the lengths of the grid, 29 cells along either axis of a plane. A fast transform of fewer takes
#: longer, as most of its time passes before it begins
_MOST_PRODUCTS = 50_000


class Transform(ABC):
    """Fourier transforms of real fields on a grid of the ``shape`` (L1, ..., Lp).

    The waves of a field are those of a real transform: all indices of waves along each axis but the
    last, and from zero to half of the length along the last one.
    """

    def __init__(self, shape: tuple[int, ...]) -> None:
        self._shape = shape
        self._shape_of_waves = count_waves(shape)

    @abstractmethod
    def find_waves(self, fields: Values) -> Values:
        """Return the amplitudes (..., waves) of the waves of real ``fields`` (..., cells)."""

    @abstractmethod
    def find_fields(self, waves: Values) -> Values:
        """Return the real fields (..., cells) whose waves have the amplitudes ``waves`` (...,
        waves), which may be overwritten.
        """


class FastTransform(Transform):
    """Fast Fourier transforms on a grid of the ``shape``, each shared by ``workers`` threads."""

    def __init__(self, shape: tuple[int, ...], workers: int) -> None:
        super().__init__(shape)
        self._workers = workers
        self._axes = tuple(range(-len(shape), 0))

    def find_waves(self, fields: Values) -> Values:
        """Return the amplitudes (..., waves) of ``fields`` (..., cells), in their precision."""
        on_grid = fields.reshape(*fields.shape[:-1], *self._shape)
        waves = load_transforms().rfftn(on_grid, axes=self._axes, workers=self._workers)
        return np.asarray(waves.reshape(*fields.shape[:-1], -1))

    def find_fields(self, waves: Values) -> Values:
        """Return the fields (..., cells) of ``waves`` (..., waves), in their precision; ``waves``
        are overwritten.
        """
        fields = load_transforms().irfftn(
            waves.reshape(*waves.shape[:-1], *self._shape_of_waves),
            self._shape,
            axes=self._axes,
            workers=self._workers,
            overwrite_x=True,
        )
        return np.asarray(fields.reshape(*waves.shape[:-1], -1))


class MatrixTransform(Transform):
    """Fourier transforms on a grid of the ``shape`` by the product with a matrix along each axis;
    fields are real numbers of a ``precision``.
    """

    def __init__(self, shape: tuple[int, ...], precision: np.dtype[Any]) -> None:
        super().__init__(shape)
        self._real = precision
        self._complex = np.result_type(precision, np.complex64)
        length = shape[-1]
        n_waves = self._shape_of_waves[-1]
        phases = _find_phases(length, n_waves)
        # a complex number is two real ones, which follow each other in memory
        self._last_to_waves = phases.view(float).astype(precision)
        # each wave but that of index zero and the shortest one stands for one of opposite sign too
        weights = np.full(n_waves, 2.0 / length)
        weights[0] = 1.0 / length
        if length % 2 == 0:
            weights[-1] = 1.0 / length
        self._last_to_cells = np.ascontiguousarray((phases * weights).view(float).T, precision)
        to_waves = [_find_phases(count, count) for count in shape[:-1]]
        #: for each axis but the last, the matrix to waves, that back to cells, and the number of
        #: entries that follow each other in memory for each index along the axis
        self._other_axes = [
            (
                matrix.astype(self._complex),
                (matrix.conj() / len(matrix)).astype(self._complex),
                math.prod(self._shape_of_waves[axis + 1 :]),
            )
            for axis, matrix in enumerate(to_waves)
        ]

    def find_waves(self, fields: Values) -> Values:
        """Return the amplitudes (..., waves) of ``fields`` (..., cells) of the precision."""
        along_last = fields.reshape(-1, self._shape[-1]) @ self._last_to_waves
        waves = along_last.view(self._complex)
        for matrix, _back, n_entries in self._other_axes:
            waves = matrix @ waves.reshape(-1, len(matrix), n_entries)
        return np.asarray(waves.reshape(*fields.shape[:-1], -1))

    def find_fields(self, waves: Values) -> Values:
        """Return the fields (..., cells), of the precision, of ``waves`` (..., waves)."""
        along_last = waves
        for _ahead, matrix, n_entries in self._other_axes:
            along_last = matrix @ along_last.reshape(-1, len(matrix), n_entries)
        pairs = along_last.reshape(-1, self._shape_of_waves[-1]).view(self._real)
        return np.asarray((pairs @ self._last_to_cells).reshape(*waves.shape[:-1], -1))


def _find_phases(length: int, n_waves: int) -> NDArray[np.complex128]:
    """Return the factors (length, n_waves) exp(-2 pi i j w / length) of cells j and waves w."""
    # whole periods are left out of the angle, whose rounding does not grow then
    turns = np.outer(np.arange(length), np.arange(n_waves)) % length
    return np.asarray(np.exp(-2j * np.pi / length * turns))


def count_waves(shape: tuple[int, ...]) -> tuple[int, ...]:
    """Return the numbers of waves (p,) of a real transform on a grid of the ``shape``, by axis."""
    return (*shape[:-1], shape[-1] // 2 + 1)


@lru_cache(maxsize=8)
def find_transform(shape: tuple[int, ...], precision: np.dtype[Any], workers: int = 1) -> Transform:
    """Return the transform of fields of a ``precision`` on a grid of the ``shape``, by matrices if
    the grid is short; otherwise a fast one, shared by ``workers`` threads. The transform is kept
    for further calls.
    """
    if math.prod(shape) * sum(shape) <= _MOST_PRODUCTS:
        return MatrixTransform(shape, precision)
    return FastTransform(shape, workers)


@cache
def load_transforms() -> Any:
    """Return SciPy's module of Fourier transforms, which is imported at the first call: media that
    are not simulated do not need SciPy, and an import in each transform would take a tenth of it.
    """
    from scipy import fft

    return fft
