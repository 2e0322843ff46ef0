"""Vectors in space within compiled loops, as tuples of three numbers."""

from __future__ import annotations

from granphon.base.arrays import Array
from granphon.base.compiled import compiled

Vector = tuple[float, float, float]


@compiled
def get_row(vectors: Array, place: int) -> Vector:
    """Return the vector in the row ``place`` of ``vectors`` (n, 3)."""
    return vectors[place, 0], vectors[place, 1], vectors[place, 2]


@compiled
def set_row(vectors: Array, place: int, a: Vector) -> None:
    """Set the row ``place`` of ``vectors`` (n, 3) to ``a``."""
    vectors[place, 0] = a[0]
    vectors[place, 1] = a[1]
    vectors[place, 2] = a[2]


@compiled
def add_to_row(vectors: Array, place: int, factor: float, a: Vector) -> None:
    """Add the ``factor`` times ``a`` to the row ``place`` of ``vectors`` (n, 3)."""
    vectors[place, 0] += factor * a[0]
    vectors[place, 1] += factor * a[1]
    vectors[place, 2] += factor * a[2]


@compiled
def dot(a: Vector, b: Vector) -> float:
    """Return a.b."""
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]


@compiled
def cross(a: Vector, b: Vector) -> Vector:
    """Return a x b."""
    return a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]


@compiled
def add(a: Vector, factor: float, b: Vector) -> Vector:
    """Return a plus the ``factor`` times b."""
    return a[0] + factor * b[0], a[1] + factor * b[1], a[2] + factor * b[2]


@compiled
def scale(factor: float, a: Vector) -> Vector:
    """Return the ``factor`` times a."""
    return factor * a[0], factor * a[1], factor * a[2]
