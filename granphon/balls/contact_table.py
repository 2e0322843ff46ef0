"""The table of contacts: which balls touch, and in what direction.

It is the only description of the geometry of contacts: the dynamics of lattices, the calculator and the simulation share it.
A lattice of balls in contact must hang together. One that does not was probably written with too few digits: the errors then
name the balls that miss each other by little, or the pieces into which the lattice falls.
"""

from __future__ import annotations

import itertools
import math
from collections import defaultdict
from collections.abc import Iterable
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from granphon.base.errors import InputError, message
from granphon.base.results import read_only

Array = NDArray[np.float64]
#: two sites touch if their distance differs from one by no more than this, in spacings
TOUCH = 1e-6
#: balls nearly touch if their distance differs from one by no more than this, in spacings
NEAR = 1e-2
#: a gap above TOUCH that is no larger than this is refused: it would close under load, as balls overlap by as much
_CLOSING = 1e-3
#: most cells in which contacts are sought; more are searched only if vectors are oblique, or sites far from each other
_MOST_CELLS = 10_000_000
#: a unit normal with a larger component along z is too near to z for z x n; its tangents are made from x instead
_UPRIGHT = 0.9
#: what a piece that extends along none, one, two or three periods is called
_PIECES = ("clusters", "rows", "layers", "networks")


@dataclass(frozen=True, eq=False)
class ContactTable:
    """One row for each contact: ball ``i`` touches ball ``j`` displaced by ``shift`` cells.

    Attributes
    ----------
    i, j : (n_c,) indices of the balls.
    shift : (n_c, p) whole cells between them.
    normal : (n_c, d) unit vector along which the contact is compressed, from i to j.
    vector : (n_c, d) from the centre of i to that of j, in mean diameters. Phases of waves are computed from it, and around
        a period of the cell it adds up to that period; where balls sit off their sites it is not along the normal.
    arm_i, arm_j : (n_c,) distance from each centre to the contact, in mean diameters.
    """

    i: NDArray[np.intp]
    j: NDArray[np.intp]
    shift: NDArray[np.intp]
    normal: Array
    vector: Array
    arm_i: Array
    arm_j: Array

    def __len__(self) -> int:
        return len(self.i)

    def scale(self, factor: float) -> ContactTable:
        """The same contacts with every length multiplied by ``factor``, a pure number."""
        return ContactTable(
            self.i, self.j, self.shift, self.normal,
            read_only(self.vector * factor), read_only(self.arm_i * factor), read_only(self.arm_j * factor),
        )  # fmt: skip


def contact_frames(normal: Array) -> list[list[Array]]:
    """The right-handed unit vectors n, t and n x t of each contact: its normal and two tangents.

    Returns three lists, one for each vector, of the components along x, y and z, each (n_c,). On a line and in the plane,
    where ``normal`` is (n_c, 1) or (n_c, 2), and for every normal in space that is not nearly along z, t is along z x n. The
    tangents of -n are -t and n x t.
    """
    if normal.shape[1] < 3:
        zero = np.zeros(len(normal))
        x, y = normal.T if normal.shape[1] == 2 else (normal[:, 0], zero)
        return [[x, y, zero], [-y, x, zero], [zero, zero, np.ones(len(normal))]]
    axis = np.where((np.abs(normal[:, 2]) > _UPRIGHT)[:, None], [1.0, 0.0, 0.0], [0.0, 0.0, 1.0])
    across = np.cross(axis, normal)
    across /= np.linalg.norm(across, axis=1, keepdims=True)
    return [list(vectors.T) for vectors in (normal, across, np.cross(normal, across))]


def steps_within(cell: Array, radius: float) -> NDArray[np.intp]:
    """Find the lattice vectors that are at most ``radius`` long.

    Returns (n, p) whole multiples of the p vectors of ``cell`` (p, d), sorted in ascending order, zero among them.
    """
    return _list_steps(cell, radius, _reach(cell, radius))


def _list_steps(cell: Array, radius: float, reach: Array) -> NDArray[np.intp]:
    """:func:`steps_within`, of no more steps along each vector than ``reach`` (p,)."""
    ranges = [np.arange(-r, r + 1) for r in reach.astype(int)]
    steps = np.stack(np.meshgrid(*ranges, indexing="ij"), axis=-1).reshape(-1, len(cell))
    return np.asarray(steps[np.linalg.norm(steps @ cell, axis=1) <= radius], np.intp)


def _reach(cell: Array, radius: float) -> Array:
    """Return the steps along each vector of ``cell`` that a lattice vector at most ``radius`` long can have, (p,)."""
    # more than |b_k| radius steps along vector k leave the sphere, whatever the other steps; b_k: reciprocal vectors
    return np.asarray(np.floor(radius * np.linalg.norm(np.linalg.pinv(cell), axis=0) * (1.0 + 1e-12)))


def select_once(i: NDArray[np.intp], j: NDArray[np.intp], shift: NDArray[np.intp]) -> NDArray[np.bool_]:
    """(n,) whether to keep each row of a list in which every contact was found from both ends, so that each counts once."""
    leading = np.take_along_axis(shift, np.argmax(shift != 0, axis=1)[:, None], axis=1)[:, 0]
    return np.asarray((i < j) | ((i == j) & (leading > 0)))


def find_contacts(cell: Array, positions: Array, name: str) -> ContactTable:
    """Find the contacts of one cell of equal balls that touch at distance one, each once.

    Raises :class:`~granphon.base.errors.InputError`, which calls the lattice ``name``, if balls overlap, a ball touches no
    other, balls nearly touch, contacts do not join all balls, or too many cells would have to be searched.
    """
    n = len(positions)
    apart = positions[None] - positions[:, None]
    radius = 2.0 + float(np.linalg.norm(apart, axis=-1).max())
    reach = _reach(cell, radius)
    if np.prod(2.0 * reach + 1.0) > _MOST_CELLS:
        what = f"the cell of lattice {name!r} is too oblique, or its sites are too far from each other"
        raise InputError(message(what, mend="Give short lattice vectors, and sites from 0 to 1"))
    shifts = _list_steps(cell, radius, reach)
    delta = apart[:, :, None] + (shifts @ cell)[None, None]
    distance = np.linalg.norm(delta, axis=-1)
    same = np.eye(n, dtype=bool)[:, :, None] & np.all(shifts == 0, axis=1)[None, None]
    said, mend, closest = "Touching balls are 1 apart", "", math.inf
    off = np.abs(distance - 1.0)
    if np.any(near := (off > TOUCH) & (off <= NEAR)):
        # the pair of balls whose distance is nearest to one among those that do not touch
        one, other, step = np.unravel_index(np.argmin(np.where(near, off, np.inf)), off.shape)
        closest = float(distance[one, other, step])
        image = f" shifted by ({', '.join(map(str, shifts[step].tolist()))}) cells" if np.any(shifts[step]) else ""
        said = f"Ball {one} and ball {other}{image} are {closest:.9g} apart, where touching balls are 1 apart"
        rounded = "If numbers were rounded, write them with eight digits or more"
        mend = _scale_to_touch(cell, delta[near], delta[off <= TOUCH]) or rounded
    if np.any((distance < 1.0 - TOUCH) & ~same):
        least = float(distance[~same].min())
        why = f"Two sites are {least:.9g} apart, and touching balls are 1 apart"
        mend = mend if mend and least >= 1.0 - NEAR else "Move the sites apart"
        raise InputError(message(f"balls of lattice {name!r} overlap", why, mend))
    found: Any = np.nonzero(off <= TOUCH)
    i, j, s = found
    if len(set(i.tolist())) < n:
        raise InputError(message(f"a ball of lattice {name!r} touches no other", said, mend))
    if closest - 1.0 <= _CLOSING:
        why = f"{said}. A gap of {closest - 1.0:.2g} closes under load, so that it was probably rounded"
        mend = f"{mend}; for balls that do not touch, leave gaps above {_CLOSING:g}"
        raise InputError(message(f"balls of lattice {name!r} nearly touch", why, mend))
    first = select_once(i, j, shifts[s])
    i, j, s = i[first], j[first], s[first]
    parts = _find_pieces(i.tolist(), j.tolist(), map(tuple, shifts[s].tolist()), n)
    count, ranks = sum(index for _, index in parts), {rank for rank, _ in parts}
    whole = ranks == {len(cell)}  # pieces that extend along all periods: there are only so many of them
    if not whole or count > 1:
        pieces = f"{_PIECES[ranks.pop()] if len(ranks) == 1 else 'pieces'}, {count} in each cell"
        what = (
            f"lattice {name!r} falls into pieces that do not touch: {f'{count} {_PIECES[len(cell)]}' if whole else pieces}"
        )
        raise InputError(message(what, said if mend else "", mend or "Move them together, or give one of them alone"))
    normal = delta[i, j, s] / distance[i, j, s][:, None]
    arm = np.full(len(i), 0.5)
    return ContactTable(
        read_only(i), read_only(j), read_only(shifts[s]), read_only(normal), read_only(normal), read_only(arm),
        read_only(arm),
    )  # fmt: skip


def _scale_to_touch(cell: Array, near: Array, touching: Array) -> str:
    """Say by what number to multiply the cell, or its coordinates along one axis, so that balls at ``near`` touch.

    ``near`` and ``touching`` are vectors (n, d) between balls; those that touch already must not change. The text is empty
    if no single number does it.
    """
    periods, dimension = cell.shape
    if not len(touching):
        factors = 1.0 / np.linalg.norm(near, axis=1)
        if np.ptp(factors) <= TOUCH:
            return f"Multiply the cell by {np.mean(factors):.12g}"
    for axis in range(periods):
        along, across = near[:, axis] ** 2, np.sum(np.delete(near, axis, axis=1) ** 2, axis=1)
        if np.any(np.abs(touching[:, axis]) > TOUCH) or np.any(along < NEAR) or np.any(across >= 1.0):
            continue
        factors = np.sqrt((1.0 - across) / along)
        if np.ptp(factors) <= TOUCH:
            old, new = next((x, x * np.mean(factors)) for x in np.abs(cell[:, axis]).tolist() if x)
            every = "" if dimension == 1 else f"every {'xyz'[axis]} of "
            return f"Multiply {every}the cell by {np.mean(factors):.12g}, so that {old:.9g} becomes {new:.12g}"
    return ""


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
        # rank and index of the lattice that these make: the index among integers in its own span
        rows, basis = [list(one) for one in rings], list[list[int]]()
        for column in range(periods):
            while len(live := sorted((row for row in rows if row[column]), key=lambda row: abs(row[column]))) > 1:
                for row in live[1:]:
                    times = row[column] // live[0][column]
                    row[:] = [a - times * b for a, b in zip(row, live[0], strict=True)]
            basis += live
            rows = [row for row in rows if not row[column]]
        minors = itertools.combinations(range(periods), len(basis))
        square = np.array(basis, float).reshape(len(basis), periods)
        out.append((len(basis), math.gcd(*(round(abs(np.linalg.det(square[:, columns]))) for columns in minors))))
    return out


def touch_once_at_most(cell: Array, dim: tuple[int, ...], contact: float) -> bool:
    """Whether any two balls of the supercell, or a ball and its own image, touch in at most one way.

    That is so if all periods are longer than twice the length ``contact`` of a contact: the vectors to two images of a ball
    differ by a period, so that they cannot both be as short as a contact.
    """
    return len(steps_within(cell * np.array(dim)[:, None], 2.0 * (1.0 + 1e-6) * contact)) == 1
