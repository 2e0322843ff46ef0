"""Kinds of deformation of a lattice's contacts, as rows of C on the fields of an array.

A field is one motion of one ball of the cell. Displacements are projected on normals of contacts, so that many elongations
are plain differences; see :mod:`granphon.array.stencils`.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from granphon.dynamics.rows import Row

Array = NDArray[np.float64]
#: least sine of the angle between a normal and those before it, for displacements to be projected on it
_INDEPENDENT = 0.1


class ArrayRow(NamedTuple):
    """A kind of deformation of the contacts between balls one ``shift`` apart: head of ball j less tail of ball i.

    ``head`` and ``tail`` are pairs (field, coefficient). ``ratio`` is the stiffness over that of elongation.
    """

    shift: tuple[int, ...]
    head: tuple[tuple[int, float], ...]
    tail: tuple[tuple[int, float], ...]
    ratio: float


def find_basis(normal: Array) -> Array:
    """Return the first normals of contacts (n_c, p) that are independent, as the rows of a (p, p) matrix."""
    chosen: list[Array] = []
    for vector in normal:
        rest = vector - sum((unit @ vector * unit for unit in _orthonormal(chosen)), np.zeros_like(vector))
        if len(chosen) < len(vector) and np.linalg.norm(rest) > _INDEPENDENT:
            chosen.append(vector)
    return np.array(chosen)


def make_rows(kind: Row, shifts: Sequence[tuple[int, ...]], ends: Sequence[tuple[int, int]], basis: Array) -> list[ArrayRow]:
    """Return one ``kind`` of deformation for each kind of contact, which joins the balls ``ends`` of cells ``shifts`` apart.

    Displacements are those along the rows of the ``basis``.
    """
    m, p = np.shape(kind.head)[-1], len(basis)
    project = np.eye(m)
    project[:p, :p] = np.linalg.inv(basis)
    pairs = [
        [tuple((m * ball + at, c) for at, c in enumerate(line) if c) for ball, line in zip(balls, lines, strict=True)]
        for balls, lines in (
            ([j for _, j in ends], _round_coefficients(kind.head @ project).tolist()),
            ([i for i, _ in ends], _round_coefficients(kind.tail @ project).tolist()),
        )
    ]
    return [ArrayRow(shift, head, tail, float(kind.stiffness)) for shift, head, tail in zip(shifts, *pairs, strict=True)]


def stack_coefficients(rows: Sequence[ArrayRow], fields: int) -> Array:
    """Return (2, rows, fields) coefficients of the motions of ball j in each kind of deformation, then those of ball i."""
    found = np.zeros((2, len(rows), fields))
    for ends, name in zip(found, ("head", "tail"), strict=True):
        for line, row in zip(ends, rows, strict=True):
            for field, factor in getattr(row, name):
                line[field] = factor
    return found


def number_cells(shape: Sequence[int], shifts: Sequence[Sequence[int]]) -> NDArray[np.intp]:
    """Return (shifts, cells) numbers of the cells that are each shift away from each cell of a periodic array."""
    cells = np.arange(math.prod(shape)).reshape(shape)
    return np.stack([np.roll(cells, [-n for n in shift], range(cells.ndim)).ravel() for shift in shifts])


def _orthonormal(vectors: list[Array]) -> list[Array]:
    return list(np.linalg.qr(np.array(vectors).T)[0].T) if vectors else []


def _round_coefficients(coefficients: Array) -> Array:
    """Round coefficients that differ from whole numbers by rounding only, so that a product with one can be skipped."""
    near = np.rint(coefficients)
    return np.where(np.abs(coefficients - near) < 1e-12, near, coefficients)
