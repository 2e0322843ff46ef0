"""The table of contacts: which balls touch, and in what direction.

It is the only description of the geometry of contacts: the dynamics of lattices, the calculator and
the simulation share it. A lattice of balls in contact must hang together. One that does not was
probably written with too few digits: the errors then name the balls that miss each other by little,
or the pieces into which the lattice falls.
"""

from __future__ import annotations

import itertools
import math
from collections import defaultdict
from dataclasses import dataclass
from typing import Any

import numpy as np

from granphon.base.arrays import Array, Flags, Index
from granphon.base.errors import InputError
from granphon.base.results import read_only

#: two sites touch if their distance differs from one by no more than this, in spacings
TOUCH = 1e-6
#: balls nearly touch if their distance differs from one by no more than this, in spacings
NEAR = 1e-2
#: a gap above TOUCH that is no larger than this is refused: it would close under load, as balls
#: overlap by as much
_CLOSING = 1e-3
#: most cells in which contacts are sought; more are searched only if vectors are oblique, or sites
#: far from each other
_MOST_CELLS = 5_000_000
#: most balls of a cell whose contacts are sought among all pairs; more are searched by a tree
_FEW = 40
#: units in which lengths are often given instead of m, and by what factor numbers are then too
#: large
_UNITS = {"cm": 1e2, "mm": 1e3, "um": 1e6}
#: distance of the nearest balls, over the sum of their radii, times or over this factor of a unit,
#: that looks like the unit
_LIKE = 2.0
#: a unit normal with a larger component along z is too near to z for z x n; its tangents are made
#: from x instead
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
    vector : (n_c, d) from the centre of i to that of j, in mean diameters. Phases of waves are
        computed from it, and around a period of the cell it adds up to that period; where balls sit
        off their sites it is not along the normal.
    arm_i, arm_j : (n_c,) distance from each centre to the contact, in mean diameters.
    """

    i: Index
    j: Index
    shift: Index
    normal: Array
    vector: Array
    arm_i: Array
    arm_j: Array

    def __len__(self) -> int:
        return len(self.i)

    def scale(self, factor: float) -> ContactTable:
        """The same contacts with every length multiplied by ``factor``, a pure number."""
        return ContactTable(
            self.i,
            self.j,
            self.shift,
            self.normal,
            read_only(self.vector * factor),
            read_only(self.arm_i * factor),
            read_only(self.arm_j * factor),
        )

    def take(self, rows: Any, i: Any, j: Any, shift: Any, turn: Any = None) -> ContactTable:
        """Return the contacts of some ``rows``, between other balls, with their vectors turned by
        ``turn`` (d, d).
        """
        normal, vector = (
            one[rows] if turn is None else one[rows] @ turn.T for one in (self.normal, self.vector)
        )
        return ContactTable(
            *map(read_only, (i, j, shift, normal, vector, self.arm_i[rows], self.arm_j[rows]))
        )


def contact_frames(normal: Array) -> list[list[Array]]:
    """The right-handed unit vectors n, t and n x t of each contact: its normal and two tangents.

    Returns three lists, one for each vector, of the components along x, y and z, each (n_c,). On a
    line and in the plane, where ``normal`` is (n_c, 1) or (n_c, 2), and for every normal in space
    that is not nearly along z, t is along z x n. The tangents of -n are -t and n x t.
    """
    if normal.shape[1] < 3:
        zero = np.zeros(len(normal))
        x, y = normal.T if normal.shape[1] == 2 else (normal[:, 0], zero)
        return [[x, y, zero], [-y, x, zero], [zero, zero, np.ones(len(normal))]]
    axis = np.where((np.abs(normal[:, 2]) > _UPRIGHT)[:, None], [1.0, 0.0, 0.0], [0.0, 0.0, 1.0])
    across = np.cross(axis, normal)
    across /= np.linalg.norm(across, axis=1, keepdims=True)
    return [list(vectors.T) for vectors in (normal, across, np.cross(normal, across))]


def repeat_contacts(
    i: Any, j: Any, shift: Any, n: int, full: tuple[int, ...]
) -> tuple[Any, Any, Any, Any]:
    """Return the cells (m, p) of a supercell of ``full`` cells of ``n`` balls each, and i, j, shift
    of its contacts.

    Balls come in the order of cells, ball by ball of each cell, with the last period fastest;
    contacts cell by cell.
    """
    cells = np.stack(np.meshgrid(*map(np.arange, full), indexing="ij"), axis=-1).reshape(
        -1, len(full)
    )
    steps = cells[:, None] + shift
    first = n * np.arange(len(cells))[:, None]
    number = np.ravel_multi_index(tuple(np.moveaxis(np.mod(steps, full), -1, 0)), full)
    return (
        cells,
        (first + i).ravel(),
        (n * number + j).ravel(),
        np.floor_divide(steps, full).reshape(-1, len(full)),
    )


def steps_within(cell: Array, radius: float) -> Index:
    """Find the lattice vectors that are at most ``radius`` long.

    Returns (n, p) whole multiples of the p vectors of ``cell`` (p, d), sorted in ascending order,
    zero among them.
    """
    return _list_steps(cell, radius, _reach(cell, radius))


def _list_steps(cell: Array, radius: float, reach: Array) -> Index:
    """:func:`steps_within`, of no more steps along each vector than ``reach`` (p,)."""
    if not len(cell):
        return np.zeros((1, 0), np.intp)  # a cluster has no images
    ranges = [np.arange(-r, r + 1) for r in reach.astype(int)]
    steps = np.stack(np.meshgrid(*ranges, indexing="ij"), axis=-1).reshape(-1, len(cell))
    return np.asarray(steps[np.linalg.norm(steps @ cell, axis=1) <= radius], np.intp)


def _reach(cell: Array, radius: float) -> Array:
    """Return the steps along each vector of ``cell`` that a lattice vector at most ``radius`` long
    can have, (p,).
    """
    # more than |b_k| radius steps along vector k leave the sphere, whatever the other steps; b_k:
    # reciprocal vectors
    return np.asarray(
        np.floor(radius * np.linalg.norm(np.linalg.pinv(cell), axis=0) * (1.0 + 1e-12))
    )


def select_once(i: Index, j: Index, shift: Index) -> Flags:
    """(n,) whether to keep each row of a list in which every contact was found from both ends, so
    that each counts once.
    """
    if not shift.shape[1]:
        return i < j
    leading = np.take_along_axis(shift, np.argmax(shift != 0, axis=1)[:, None], axis=1)[:, 0]
    return np.asarray((i < j) | ((i == j) & (leading > 0)))


def find_contacts(
    cell: Array, positions: Array, name: str, radii: Array | None = None
) -> ContactTable:
    """Find the contacts of one cell of balls, each once, in the unit of the positions.

    Balls touch where their distance is the sum of their ``radii`` (n,); without these they are the
    equal balls of a lattice, which touch at distance one.

    Raises :class:`~granphon.base.errors.InputError`, which calls the lattice ``name``, if balls
    overlap, a ball touches no other, balls nearly touch, contacts do not join all balls, or too
    many cells would have to be searched.
    """
    n = len(positions)
    has_radii = radii is not None
    called = f"crystal {name!r}" if has_radii else f"lattice {name!r}"
    size = np.full(n, 0.5) if radii is None else np.asarray(radii, float)
    i, j, shifts, delta = _find_near(cell, positions, size, called)
    touch = size[i] + size[j]
    distance = np.linalg.norm(delta, axis=-1)
    ratio = distance / touch
    said = (
        "Two balls touch where their radii add up to their distance"
        if has_radii
        else "Touching balls are 1 apart"
    )
    mend = ""
    closest = math.inf
    off = np.abs(ratio - 1.0)
    if np.any(near := (off > TOUCH) & (off <= NEAR)):
        # the pair of balls whose distance is nearest to that of touching ones among those that do
        # not touch
        worst = int(np.argmin(np.where(near, off, np.inf)))
        closest = float(ratio[worst])
        image = (
            f" shifted by ({', '.join(map(str, shifts[worst].tolist()))}) cells"
            if np.any(shifts[worst])
            else ""
        )
        sides = (
            f"{distance[worst]:.9g} m apart, and their radii add up to {touch[worst]:.9g} m"
            if has_radii
            else (f"{closest:.9g} apart, where touching balls are 1 apart")
        )
        said = f"Ball {i[worst]} and ball {j[worst]}{image} are {sides}"
        rounded = "If numbers were rounded, write them with eight digits or more"
        scaled = delta[near] / touch[near, None]
        held = delta[off <= TOUCH] / touch[off <= TOUCH, None]
        mend = _scale_to_touch(cell, scaled, held, has_radii) or rounded
    if np.any(ratio < 1.0 - TOUCH):
        worst = int(np.argmin(ratio))
        least = float(ratio[worst])
        why = f"Two sites are {least:.9g} apart, and touching balls are 1 apart"
        if has_radii:
            why = (
                f"Balls {i[worst]} and {j[worst]} are {distance[worst]:.9g} m apart, and"
                f" their radii add"
                f" up to {touch[worst]:.9g} m"
            )
        mend = mend if mend and least >= 1.0 - NEAR else "Move the sites apart"
        if has_radii and distance[worst] <= TOUCH * touch[worst]:
            mend = (
                "Give each site of the cell once; places that differ by vectors of the cell are"
                " one site"
            )
        elif has_radii and least * _LIKE < 1.0 / _UNITS["cm"]:
            mend = "Compare the units: diameters, cell and positions are in m"
        raise InputError(f"balls of {called} overlap", why, mend)
    touching = np.flatnonzero(off <= TOUCH)
    alone = np.setdiff1d(np.arange(n), i[touching])
    if alone.size:
        ball_in_words = f"ball {alone[0]} of {called}" if has_radii else f"a ball of {called}"
        if has_radii and closest == math.inf:
            # how far it is from the one that is nearest to touching it, and the unit that this
            # looks like
            ball = int(alone[0])
            steps = _list_steps(cell, math.inf, np.ones(len(cell)))
            inside = positions - np.floor(positions @ np.linalg.pinv(cell)) @ cell
            with np.errstate(over="ignore"):
                away = inside[:, None] + steps @ cell - inside[ball]
                gaps = np.linalg.norm(away, axis=-1) / (size + size[ball])[:, None]
            gaps[ball, ~np.any(steps, axis=1)] = np.inf
            neighbour, _ = np.unravel_index(np.argmin(gaps), gaps.shape)
            apart = float(np.min(gaps))
            sum_of_radii = float(size[neighbour] + size[ball])
            said = (
                f"The nearest, ball {neighbour}, is {apart * sum_of_radii:.6g} m away, and their"
                f" radii add up to"
            )
            said = f"{said} {sum_of_radii:.6g} m"
            mend = "Move them together, until their radii add up to their distance"
            unit = next(
                (unit for unit, many in _UNITS.items() if many / _LIKE < apart < many * _LIKE), ""
            )
            if unit:
                mend = f"Give cell and positions in m: they look like {unit}"
        raise InputError(f"{ball_in_words} touches no other", said, mend)
    if closest - 1.0 <= _CLOSING:
        gap = f"a gap of {closest - 1.0:.2g}" + " of that" * has_radii
        why = f"{said}. A{gap[1:]} closes under load, so that it was probably rounded"
        mend = (
            f"{mend}; for balls that do not touch, leave gaps above {_CLOSING:g}"
            + " of their distance" * has_radii
        )
        raise InputError(f"balls of {called} nearly touch", why, mend)
    first = touching[select_once(i[touching], j[touching], shifts[touching])]
    i = i[first]
    j = j[first]
    shifts = shifts[first]
    require_joined(i, j, shifts, n, len(cell), called, said if mend else "", mend)
    normal = delta[first] / distance[first][:, None]
    vector = normal if radii is None else normal * touch[first][:, None]
    return ContactTable(
        read_only(i),
        read_only(j),
        read_only(shifts),
        read_only(normal),
        read_only(vector),
        read_only(size[i]),
        read_only(size[j]),
    )


def _find_near(
    cell: Array, positions: Array, radii: Array, called: str
) -> tuple[Any, Any, Any, Array]:
    """Return the pairs of balls that are no farther apart than touching ones and a little, each
    from both of its ends.

    They are balls i and j (pairs,), whole cells (pairs, p) by which j is displaced and vectors
    (pairs, d), in the order of i, j, and these cells.
    """
    n = len(positions)
    reach_of = 1.0 + NEAR + 1e-9
    few = n <= _FEW
    longest = 2.0 * reach_of * float(radii.max())
    apart = positions[None] - positions[:, None] if few else np.zeros(1)
    radius = longest + float(np.linalg.norm(apart, axis=-1).max())
    reach = _reach(cell, radius) + (not few)
    if np.prod(2.0 * reach + 1.0) * (1 if few else n / _FEW) > _MOST_CELLS:
        problem = f"the cell of {called} is too oblique, or its sites are too far from each other"
        raise InputError(problem, mend="Give short lattice vectors, and sites from 0 to 1")
    if few:
        steps = _list_steps(cell, radius, reach)
        delta = apart[:, :, None] + (steps @ cell)[None, None]
        distance = np.linalg.norm(delta, axis=-1)
        near = distance <= reach_of * (radii[:, None] + radii)[:, :, None]
        found: Any = np.nonzero(
            near & ~(np.eye(n, dtype=bool)[:, :, None] & np.all(steps == 0, axis=1))
        )
        return found[0], found[1], steps[found[2]], delta[found]
    i, j, shift, delta = find_pairs(positions, cell, longest)
    near = np.linalg.norm(delta, axis=-1) <= reach_of * (radii[i] + radii[j])
    i = i[near]
    j = j[near]
    shift = shift[near]
    delta = delta[near]
    i, j = np.concatenate([i, j]), np.concatenate([j, i])
    shift = np.concatenate([shift, -shift])
    delta = np.concatenate([delta, -delta])
    order = np.lexsort((*shift.T[::-1], j, i))
    return i[order], j[order], shift[order], delta[order]


def find_pairs(positions: Array, periods: Array, cutoff: float) -> tuple[Any, Any, Any, Array]:
    """Find the pairs of places (n, d) not farther apart than ``cutoff``, each once, also of images
    along ``periods`` (p, d).

    Returns indices i and j (pairs,), the whole periods (pairs, p) by which the image of j is
    shifted, and the vectors (pairs, d) from i to it, in the order of i, j and these shifts. The
    search is in a tree of the places and of their images near the faces of the cell.
    """
    # imported here because it loads much of scipy, which lattices that have a name do not need
    from scipy.spatial import cKDTree

    # fractions of the periods: places are moved into the cell, then repeated as far as a pair can
    # reach beyond its faces
    n = len(positions)
    across = np.linalg.pinv(periods)
    place = positions @ across
    home = np.floor(place).astype(np.intp)
    ball = np.arange(n)
    step = np.zeros((n, len(periods)), np.intp)
    place -= home
    for axis, margin in enumerate(cutoff * np.linalg.norm(across, axis=0) * (1.0 + 1e-9)):
        reach = int(margin) + 1
        kept = [(ball, step)]  # the places themselves come first
        for steps in (*range(-reach, 0), *range(1, reach + 1)):
            away = place[ball, axis] + steps
            near = (away >= -margin) & (away <= 1.0 + margin)
            image_step = step[near]
            image_step[:, axis] = steps
            kept.append((ball[near], image_step))
        ball, step = (np.concatenate(parts) for parts in zip(*kept, strict=True))
    points = positions[ball] + (step - home[ball]) @ periods
    first, second = cKDTree(points).query_pairs(cutoff, output_type="ndarray").T
    # the first of a pair is the lower one, and a place of the cell comes before all images
    in_cell = first < n
    first = first[in_cell]
    second = second[in_cell]
    i = ball[first]
    j = ball[second]
    shift = step[second] - home[ball[second]] + home[ball[first]]
    once = (second < n) | select_once(i, j, shift)
    i = i[once]
    j = j[once]
    shift = shift[once]
    vector = points[second[once]] - points[first[once]]
    order = np.lexsort((*shift.T[::-1], j, i))
    return i[order], j[order], shift[order], vector[order]


def require_joined(
    i: Index,
    j: Index,
    shift: Index,
    n: int,
    periods: int,
    called: str,
    said: str = "",
    mend: str = "",
    held: Any = None,
) -> None:
    """Raise :class:`~granphon.base.errors.InputError` unless contacts join all ``n`` balls, and all
    their images.

    Balls that are ``held`` (n,) are one body, along all periods.
    """
    if held is not None and np.any(held):
        count = int(np.count_nonzero(~held))
        name = np.where(held, count, np.cumsum(~held) - 1)
        i, j = (np.append(name[end], np.full(periods, count)) for end in (i, j))
        shift = np.concatenate([shift, np.eye(periods, dtype=np.intp)])
        n = count + 1
    neighbours = defaultdict[int, list[tuple[int, tuple[int, ...]]]](list)
    for one, neighbour, step in zip(
        i.tolist(), j.tolist(), map(tuple, shift.tolist()), strict=True
    ):
        neighbours[one].append((neighbour, step))
        neighbours[neighbour].append((one, tuple(-x for x in step)))
    # along how many periods each set of balls that contacts join extends, and its copies. The whole
    # cells by which rings of contacts lead from a ball to its images make a lattice of integers:
    # its rank is the number of periods, and its index the number of copies of the piece that do not
    # touch
    places: dict[int, tuple[int, ...]] = {}
    parts = list[tuple[int, int]]()
    for first in range(n):
        if first in places:
            continue
        places[first], rings, queue = (0,) * periods, set[tuple[int, ...]](), [first]
        while queue:
            ball = queue.pop()
            for neighbour, step in neighbours[ball]:
                place_of_neighbour = tuple(map(sum, zip(places[ball], step, strict=True)))
                if neighbour not in places:
                    places[neighbour] = place_of_neighbour
                    queue.append(neighbour)
                rings.add(
                    tuple(a - b for a, b in zip(place_of_neighbour, places[neighbour], strict=True))
                )
        # rank and index of the lattice that these make: the index among integers in its own span
        rows = [list(one) for one in rings]
        basis = list[list[int]]()
        for column in range(periods):
            while (
                len(
                    live := sorted(
                        (row for row in rows if row[column]), key=lambda row: abs(row[column])
                    )
                )
                > 1
            ):
                for row in live[1:]:
                    times = row[column] // live[0][column]
                    row[:] = [a - times * b for a, b in zip(row, live[0], strict=True)]
            basis += live
            rows = [row for row in rows if not row[column]]
        minors = itertools.combinations(range(periods), len(basis))
        square = np.array(basis, float).reshape(len(basis), periods)
        parts.append(
            (
                len(basis),
                math.gcd(*(round(abs(np.linalg.det(square[:, columns]))) for columns in minors)),
            )
        )
    count = sum(index for _, index in parts)
    ranks = {rank for rank, _ in parts}
    # pieces that extend along all periods: there are only so many of them
    whole = ranks == {periods}
    if not whole or count > 1:
        cells = f"{count} in each cell" if periods else f"{count} of them"
        pieces = f"{', '.join(_PIECES[rank] for rank in sorted(ranks))}, {cells}"
        problem = (
            f"{called} falls into pieces that do not touch:"
            f" {f'{count} {_PIECES[periods]}' if whole else pieces}"
        )
        raise InputError(problem, said, mend or "Move them together, or give one of them alone")


def _scale_to_touch(cell: Array, near: Array, touching: Array, given: bool = False) -> str:
    """Say by what number to multiply the cell, or its coordinates along one axis, so that balls at
    ``near`` touch.

    ``near`` and ``touching`` are vectors (n, d) between balls, over the distance at which they
    touch; those that touch already must not change. With ``given`` positions these are to be
    multiplied too. The text is empty if no single number does it.
    """
    periods, dimension = cell.shape
    if not len(touching):
        factors = 1.0 / np.linalg.norm(near, axis=1)
        if np.ptp(factors) <= TOUCH:
            return f"Multiply the cell{' and the positions' * given} by {np.mean(factors):.12g}"
    if given:
        return ""
    for axis in range(periods):
        along = near[:, axis] ** 2
        across = np.sum(np.delete(near, axis, axis=1) ** 2, axis=1)
        if (
            np.any(np.abs(touching[:, axis]) > TOUCH)
            or np.any(along < NEAR)
            or np.any(across >= 1.0)
        ):
            continue
        factors = np.sqrt((1.0 - across) / along)
        if np.ptp(factors) <= TOUCH:
            old, new = next((x, x * np.mean(factors)) for x in np.abs(cell[:, axis]).tolist() if x)
            every = "" if dimension == 1 else f"every {'xyz'[axis]} of "
            return (
                f"Multiply {every}the cell by {np.mean(factors):.12g}, so that {old:.9g} becomes"
                f" {new:.12g}"
            )
    return ""


def touch_once_at_most(cell: Array, dim: tuple[int, ...], contact: float) -> bool:
    """Whether any two balls of the supercell, or a ball and its own image, touch in at most one
    way.

    That is so if all periods are longer than twice the length ``contact`` of a contact: the vectors
    to two images of a ball differ by a period, so that they cannot both be as short as a contact.
    """
    return len(steps_within(cell * np.array(dim)[:, None], 2.0 * (1.0 + 1e-6) * contact)) == 1
