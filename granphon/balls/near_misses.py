"""The contact network of a lattice: the pieces into which it falls, and balls that miss each other by little.

A lattice of balls in contact must hang together. One that does not was probably written with too few digits.
"""

from __future__ import annotations

import itertools
import math
from collections import defaultdict
from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
#: balls nearly touch if their distance differs from one by no more than this, in spacings
NEAR = 1e-2
#: what a piece that extends along none, one, two or three periods is called
_PIECES = ("clusters", "rows", "layers", "networks")


# -- balls that nearly touch ----------------------------------------------------------------------------------------


@dataclass(frozen=True)
class NearMiss:
    """Two balls whose distance is nearly one: ``text`` names them, ``distance`` is in spacings, ``mend`` says what to do."""

    text: str
    distance: float
    mend: str


def find_near_miss(cell: Array, shifts: NDArray[np.intp], delta: Array, distance: Array, touch: float) -> NearMiss | None:
    """Find the pair of balls whose distance is nearest to one among those that do not touch; None if none is that near.

    Parameters
    ----------
    cell : (p, d) lattice vectors, in spacings.
    shifts : (n_s, p) whole cells by which the second ball may be displaced.
    delta, distance : (n, n, n_s, d) and (n, n, n_s) from the first ball to the second one, with each shift.
    touch : deviation of the distance from one up to which balls touch.
    """
    off = np.abs(distance - 1.0)
    near = (off > touch) & (off <= NEAR)
    if not np.any(near):
        return None
    i, j, s = np.unravel_index(np.argmin(np.where(near, off, np.inf)), off.shape)
    image = f" shifted by ({', '.join(map(str, shifts[s].tolist()))}) cells" if np.any(shifts[s]) else ""
    text = f"Ball {i} and ball {j}{image} are {distance[i, j, s]:.9g} apart, where touching balls are 1 apart"
    mend = _scale_to_touch(cell, delta[near], delta[off <= touch], touch)
    return NearMiss(text, float(distance[i, j, s]), mend or "If numbers were rounded, write them with eight digits or more")


def _scale_to_touch(cell: Array, near: Array, touching: Array, touch: float) -> str:
    """Say by what number to multiply the cell, or its coordinates along one axis, so that balls at ``near`` touch.

    ``near`` and ``touching`` are vectors (n, d) between balls; those that touch already must not change. The text is empty
    if no single number does it.
    """
    periods, dimension = cell.shape
    if not len(touching):
        factors = 1.0 / np.linalg.norm(near, axis=1)
        if np.ptp(factors) <= touch:
            return f"Multiply the cell by {np.mean(factors):.12g}"
    for axis in range(periods):
        along, across = near[:, axis] ** 2, np.sum(np.delete(near, axis, axis=1) ** 2, axis=1)
        if np.any(np.abs(touching[:, axis]) > touch) or np.any(along < NEAR) or np.any(across >= 1.0):
            continue
        factors = np.sqrt((1.0 - across) / along)
        if np.ptp(factors) <= touch:
            old, new = next((x, x * np.mean(factors)) for x in np.abs(cell[:, axis]).tolist() if x)
            every = "" if dimension == 1 else f"every {'xyz'[axis]} of "
            return f"Multiply {every}the cell by {np.mean(factors):.12g}, so that {old:.9g} becomes {new:.12g}"
    return ""


# -- pieces that do not touch ---------------------------------------------------------------------------------------


def describe_pieces(i: Iterable[int], j: Iterable[int], shift: Iterable[tuple[int, ...]], n: int, periods: int) -> str:
    """Say into what pieces contacts leave a lattice apart, such as "layers, 1 in each cell"; empty if they join all balls.

    Ball ``i`` touches ball ``j`` displaced by ``shift`` cells, for each contact; there are ``n`` balls in a cell.
    """
    pieces = _find_pieces(i, j, shift, n)
    count, ranks = sum(index for _, index in pieces), {rank for rank, _ in pieces}
    if ranks == {periods}:  # these extend along all periods: there are only so many of them
        return "" if count == 1 else f"{count} {_PIECES[periods]}"
    return f"{_PIECES[ranks.pop()] if len(ranks) == 1 else 'pieces'}, {count} in each cell"


def _find_pieces(i: Iterable[int], j: Iterable[int], shift: Iterable[tuple[int, ...]], n: int) -> list[tuple[int, int]]:
    """Return, for each set of balls of a cell that contacts join, along how many periods it extends, and its copies.

    The whole cells by which rings of contacts lead from a ball to its images make a lattice of integers. Its rank is the
    number of periods, and its index the number of copies of the piece that do not touch.
    """
    neighbours = defaultdict[int, list[tuple[int, tuple[int, ...]]]](list)
    for one, other, step in zip(i, j, shift, strict=True):
        neighbours[one].append((other, step))
        neighbours[other].append((one, tuple(-x for x in step)))
    periods = len(neighbours[0][0][1])
    places: dict[int, tuple[int, ...]] = {}
    out = []
    for first in range(n):
        if first in places:
            continue
        places[first], rings, left = (0,) * periods, set[tuple[int, ...]](), [first]
        while left:
            ball = left.pop()
            for other, step in neighbours[ball]:
                there = tuple(map(sum, zip(places[ball], step, strict=True)))
                if other not in places:
                    places[other] = there
                    left.append(other)
                rings.add(tuple(a - b for a, b in zip(there, places[other], strict=True)))
        out.append(_find_rank(rings, periods))
    return out


def _find_rank(vectors: Iterable[tuple[int, ...]], periods: int) -> tuple[int, int]:
    """Return rank and index of the lattice that vectors of integers make: the index among integers in its own span."""
    rows, basis = [list(one) for one in vectors], list[list[int]]()
    for column in range(periods):
        while len(live := sorted((row for row in rows if row[column]), key=lambda row: abs(row[column]))) > 1:
            for row in live[1:]:
                times = row[column] // live[0][column]
                row[:] = [a - times * b for a, b in zip(row, live[0], strict=True)]
        basis += live
        rows = [row for row in rows if not row[column]]
    minors = itertools.combinations(range(periods), len(basis))
    square = np.array(basis, float).reshape(len(basis), periods)
    return len(basis), math.gcd(*(round(abs(np.linalg.det(square[:, columns]))) for columns in minors))
