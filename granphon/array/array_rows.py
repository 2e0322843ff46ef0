"""Kinds of deformation of a lattice's contacts, as rows of C on the fields of an array.

A field is one motion of one ball of the cell. Displacements are projected on normals of contacts; see
:mod:`granphon.array.stencils`.
"""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from granphon.dynamics.rows import Row

Array = NDArray[np.float64]
#: least sine of the angle between a normal and those before it, for displacements to be projected on it
_INDEPENDENT = 0.1


def find_basis(normal: Array) -> Array:
    """Return the first normals of contacts (n_c, p) that are independent, as the rows of a (p, p) matrix."""
    chosen: list[Array] = []
    for vector in normal:
        rest = vector - sum((unit @ vector * unit for unit in _orthonormal(chosen)), np.zeros_like(vector))
        if len(chosen) < len(vector) and np.linalg.norm(rest) > _INDEPENDENT:
            chosen.append(vector)
    return np.array(chosen)


def project_rows(kinds: Sequence[Row], ends: Sequence[tuple[int, int]], basis: Array, fields: int) -> Array:
    """Return (2, rows, fields) coefficients of motions in the cell of ball j, then in that of ball i.

    Each of the ``kinds`` comes for all contacts, between the balls ``ends`` (i, j) of the cell. Displacements are those
    along the rows of the ``basis``.
    """
    p, n, found = len(basis), len(ends), np.zeros((2, len(kinds) * len(ends), fields))
    for place, kind in enumerate(kinds):
        m = np.shape(kind.head)[-1]
        project = np.eye(m)
        project[:p, :p] = np.linalg.inv(basis)
        for at, coefficients in enumerate((kind.head @ project, kind.tail @ project)):
            for contact, (ball, line) in enumerate(zip(ends, _round_coefficients(coefficients), strict=True)):
                first = m * ball[1 - at]
                found[at, place * n + contact, first : first + m] = line
    return found


def number_cells(shape: Sequence[int], shifts: Sequence[Sequence[int]]) -> NDArray[np.intp]:
    """Return (shifts, cells) numbers of the cells that are each shift away from each cell of a periodic array."""
    cells = np.arange(math.prod(shape)).reshape(shape)
    return np.stack([np.roll(cells, [-n for n in shift], range(cells.ndim)).ravel() for shift in shifts])


def _orthonormal(vectors: list[Array]) -> list[Array]:
    return list(np.linalg.qr(np.array(vectors).T)[0].T) if vectors else []


def _round_coefficients(coefficients: Array) -> Array:
    """Round coefficients that differ from whole numbers by rounding only."""
    near = np.rint(coefficients)
    return np.where(np.abs(coefficients - near) < 1e-12, near, coefficients)
