"""The table of contacts: which balls touch, and in what direction.

The table is the only description of the geometry of contacts: the dynamics of lattices, the
calculator and the simulation share it. A lattice of balls in contact must hang together. A lattice
that does not was probably written with too few digits: the errors then name the balls that miss
each other by little, or the pieces into which the lattice falls.
"""

from __future__ import annotations

import itertools
import math
from collections import defaultdict
from collections.abc import Mapping
from dataclasses import dataclass, field
from functools import cached_property
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
_CLOSING_GAP = 1e-3
#: most cells in which contacts are sought; more are searched only if vectors are oblique, or sites
#: far from each other
_MOST_CELLS = 5_000_000
#: most balls of a cell whose contacts are sought among all pairs; more are searched by a tree
_MOST_COMPARED = 40
#: units in which lengths are often given instead of m, and by what factor numbers are then too
#: large
_UNITS = {"cm": 1e2, "mm": 1e3, "um": 1e6}
#: lengths look like those of a unit if the distance of the nearest balls, over the sum of their
#: radii, is within this factor of the number of the unit in :data:`_UNITS`
_UNIT_TOLERANCE = 2.0
#: distance of two balls, over that at which they touch, below which diameters look like mm or a
#: finer unit: half of 1/100, so that cm are not taken for mm
_RATIO_OF_MM = 1.0 / 200.0
#: a unit normal with a larger component along z is too near to z for z x n; its tangents are made
#: from x instead
_MOST_Z = 0.9
#: what a piece that extends along none, one, two or three periods is called
_PIECES = ("clusters", "rows", "layers", "networks")
#: least square of the component of a vector along an axis, in distances of touching balls, from
#: which coordinates along the axis are scaled
_LEAST_SQUARE = 1e-2
#: distance, over that of touching balls, up to which pairs are listed
_SEARCH_RATIO = 1.0 + NEAR + 1e-9
#: a number of whole cells along each period
_Cells = tuple[int, ...]
#: for each ball the balls that it touches, with the whole cells by which they are displaced
_Neighbours = Mapping[int, list[tuple[int, _Cells]]]


@dataclass(frozen=True, eq=False)
class ContactTable:
    """One row for each contact: ball ``i`` touches ball ``j`` displaced by ``shift`` cells.

    Attributes
    ----------
    i, j : (n_c,) indices of the balls.
    shift : (n_c, p) whole cells between them.
    normal : (n_c, d) unit vector along which the contact is compressed, from i to j.
    vector : (n_c, d) from the centre of i to that of j. Phases of waves are computed from it, and
        around a period of the cell it adds up to that period; where balls sit off their sites it is
        not along the normal.
    arm_i, arm_j : (n_c,) distance from each centre to the contact.

    Lengths are in the unit of the positions: distances of touching balls in a lattice, mean
    diameters in the dynamics, m in a crystal.
    """

    i: Index = field(metadata={"kind": np.dtype(np.intp)})
    j: Index = field(metadata={"kind": np.dtype(np.intp)})
    shift: Index = field(metadata={"kind": np.dtype(np.intp)})
    normal: Array = field(metadata={"kind": np.dtype(float)})
    vector: Array = field(metadata={"kind": np.dtype(float)})
    arm_i: Array = field(metadata={"kind": np.dtype(float)})
    arm_j: Array = field(metadata={"kind": np.dtype(float)})

    def __len__(self) -> int:
        """Return the number n_c of contacts."""
        return len(self.i)

    def scale(self, factor: float) -> ContactTable:
        """Return the same contacts with every length multiplied by ``factor``, a pure number."""
        return ContactTable(
            i=self.i,
            j=self.j,
            shift=self.shift,
            normal=self.normal,
            vector=read_only(self.vector * factor),
            arm_i=read_only(self.arm_i * factor),
            arm_j=read_only(self.arm_j * factor),
        )

    def take(self, rows: Any, i: Any, j: Any, shift: Any, turn: Any = None) -> ContactTable:
        """Return the contacts (m,) of some ``rows``. Their vectors and normals are turned by
        ``turn`` (d, d), the rows of which are the new axes; None leaves them as they are.

        ``i``, ``j`` (m,) and ``shift`` (m, p) take the place of those of the rows.
        """
        normal = self.normal[rows]
        vector = self.vector[rows]
        if turn is not None:
            normal = normal @ turn.T
            vector = vector @ turn.T
        return freeze_contacts(i, j, shift, normal, vector, self.arm_i[rows], self.arm_j[rows])


def freeze_contacts(
    i: Index, j: Index, shift: Index, normal: Array, vector: Array, arm_i: Array, arm_j: Array
) -> ContactTable:
    """Return the table of contacts with these columns, (n_c,) or (n_c, d), those of
    :class:`ContactTable`, which become read-only.
    """
    return ContactTable(*map(read_only, (i, j, shift, normal, vector, arm_i, arm_j)))


def contact_frames(normal: Array) -> list[list[Array]]:
    """Return the right-handed unit vectors n, t and n x t of each contact, its normal and two
    tangents.

    They are three lists, one for each vector, of the components along x, y and z, each (n_c,).
    ``normal`` is (n_c, 1) on a line, (n_c, 2) in the plane and (n_c, 3) in space. The tangent t is
    along z x n, but for a normal that is nearly along z it is along x x n. The tangents of -n are
    -t and n x t.
    """
    count, dimension = normal.shape
    if dimension < 3:
        zero = np.zeros(count)
        x = normal[:, 0]
        y = normal[:, 1] if dimension == 2 else zero
        return [[x, y, zero], [-y, x, zero], [zero, zero, np.ones(count)]]
    is_upright = np.abs(normal[:, 2]) > _MOST_Z
    axis = np.where(is_upright[:, None], [1.0, 0.0, 0.0], [0.0, 0.0, 1.0])
    tangent = np.cross(axis, normal)
    tangent /= np.linalg.norm(tangent, axis=1, keepdims=True)
    second_tangent = np.cross(normal, tangent)
    return [list(vectors.T) for vectors in (normal, tangent, second_tangent)]


def repeat_contacts(
    i: Any, j: Any, shift: Any, n: int, counts: tuple[int, ...]
) -> tuple[Any, Any, Any, Any]:
    """Repeat the contacts of a cell: balls ``i``, ``j`` (n_c,), whole cells ``shift`` (n_c, p).

    Returns the m cells (m, p) of a supercell of ``counts`` (p,) cells of ``n`` balls each along the
    p periods, one or more, and i, j (m n_c,) and shift (m n_c, p), in whole supercells, of its
    contacts. Balls come in the order of cells, ball by ball of each cell, with the last period
    fastest; contacts come cell by cell.
    """
    p = len(counts)
    grid = np.meshgrid(*map(np.arange, counts), indexing="ij")
    cells = np.stack(grid, axis=-1).reshape(-1, p)
    # (m, n_c, p): the cell of ball j, which may lie beyond the supercell
    cells_of_j = cells[:, None] + shift
    cells_within = np.moveaxis(np.mod(cells_of_j, counts), -1, 0)
    number_of_j = np.ravel_multi_index(tuple(cells_within), counts)
    number_of_i = np.arange(len(cells))[:, None]
    repeated_i = (n * number_of_i + i).ravel()
    repeated_j = (n * number_of_j + j).ravel()
    repeated_shift = np.floor_divide(cells_of_j, counts).reshape(-1, p)
    return cells, repeated_i, repeated_j, repeated_shift


def steps_within(cell: Array, radius: float) -> Index:
    """Find the lattice vectors that are at most ``radius`` long.

    Returns (n, p) whole multiples of the p vectors of ``cell`` (p, d), sorted in ascending order,
    zero among them.
    """
    return _list_steps(cell, radius, _find_most_steps(cell, radius))


def _list_steps(cell: Array, radius: float, most_steps: Array) -> Index:
    """Return the lattice vectors of :func:`steps_within`, (n, p), at most ``radius`` long, that
    have at most ``most_steps`` (p,) steps along each vector of the ``cell``, to either side.
    """
    if not len(cell):
        return np.zeros((1, 0), np.intp)  # a cluster has no images
    ranges = [np.arange(-count, count + 1) for count in most_steps.astype(int)]
    steps = np.stack(np.meshgrid(*ranges, indexing="ij"), axis=-1).reshape(-1, len(cell))
    lengths = np.linalg.norm(steps @ cell, axis=1)
    return np.asarray(steps[lengths <= radius], np.intp)


def _find_most_steps(cell: Array, radius: float) -> Array:
    """Return (p,) the largest number of steps along each vector of ``cell`` that a lattice vector
    at most ``radius`` long can have.
    """
    # more than |b_k| radius steps along vector k leave the sphere, whatever the other steps; b_k
    # are the reciprocal vectors
    reciprocal_lengths = np.linalg.norm(np.linalg.pinv(cell), axis=0)
    rounding_factor = 1.0 + 1e-12  # a vector exactly as long as the radius counts
    return np.asarray(np.floor(radius * reciprocal_lengths * rounding_factor))


def select_once(i: Index, j: Index, shift: Index) -> Flags:
    """Return (n,) whether to keep each row of a list in which every contact stands twice, once from
    each of its balls, so that it is kept once.

    A row says that ball ``i`` touches the image of ball ``j`` that is displaced by ``shift`` (n, p)
    cells. The row with the lower i is kept and, of a ball that touches its own images, the row
    whose first number of cells that is not zero is above zero.
    """
    if not shift.shape[1]:
        return i < j
    # the first number of cells that is not zero
    first_axis = np.argmax(shift != 0, axis=1)[:, None]
    first_number = np.take_along_axis(shift, first_axis, axis=1)[:, 0]
    return np.asarray((i < j) | ((i == j) & (first_number > 0)))


def find_contacts(
    cell: Array, positions: Array, name: str, radii: Array | None = None
) -> ContactTable:
    """Find the contacts of one cell of balls, each once, in the unit of the positions.

    ``cell`` (p, d) has the vectors of the p periods, and ``positions`` (n, d) are those of one ball
    or more, all finite. Balls touch where their distance is the sum of their ``radii`` (n,);
    without these they are the equal balls of a lattice, which touch at distance one.

    Raises :class:`~granphon.base.errors.InputError`, which calls the lattice ``name``, if balls
    overlap, a ball touches no other, balls nearly touch, contacts do not join all balls, or too
    many cells would have to be searched.
    """
    pairs = _NearPairs.find(cell, positions, name, radii)
    gap = pairs.describe_gap(cell)
    pairs.require_apart(gap)
    pairs.require_contacts(cell, positions, gap)
    if gap is not None and gap.ratio - 1.0 <= _CLOSING_GAP:
        raise _explain_closing(pairs, gap)
    ends = np.flatnonzero(pairs.deviation <= TOUCH)  # each contact twice, once from each end
    is_counted = select_once(pairs.i[ends], pairs.j[ends], pairs.shift[ends])
    contacts = ends[is_counted]
    i = pairs.i[contacts]
    j = pairs.j[contacts]
    shift = pairs.shift[contacts]
    why = "" if gap is None else gap.why
    mend = "" if gap is None else gap.mend
    require_joined(i, j, shift, len(positions), len(cell), pairs.subject, why=why, mend=mend)
    normal = pairs.vector[contacts] / pairs.distance[contacts][:, None]
    # exactly as long as touching balls are apart: the deviation is rounding of the positions
    vector = normal if radii is None else normal * pairs.touch[contacts][:, None]
    return freeze_contacts(i, j, shift, normal, vector, pairs.radii[i], pairs.radii[j])


@dataclass(frozen=True, eq=False)
class _Gap:
    """The gap, or the overlap, of two balls that nearly touch: ``ratio`` is their distance over
    that of touching balls; ``why`` and ``mend`` are sentences of a message: how far they are apart,
    and what makes them touch.
    """

    ratio: float
    why: str
    mend: str


@dataclass(frozen=True, eq=False)
class _NearPairs:
    """Pairs of balls no farther apart than :data:`_SEARCH_RATIO` times the distance of touching
    balls, each from both of its ends.

    Attributes
    ----------
    subject : what messages call the crystal or the lattice.
    has_radii : whether balls have radii of their own; those of a lattice are 1/2.
    radii : (n,) of the balls, in the unit of the positions.
    i, j : (pairs,) indices of the balls.
    shift : (pairs, p) whole cells by which ball j is displaced.
    vector : (pairs, d) from the centre of i to that of j.
    """

    subject: str
    has_radii: bool
    radii: Array
    i: Any
    j: Any
    shift: Any
    vector: Array

    @classmethod
    def find(cls, cell: Array, positions: Array, name: str, radii: Array | None) -> _NearPairs:
        """Find the pairs; the arguments are those of :func:`find_contacts`."""
        has_radii = radii is not None
        subject = f"crystal {name!r}" if has_radii else f"lattice {name!r}"
        all_radii = np.full(len(positions), 0.5) if radii is None else np.asarray(radii, float)
        i, j, shift, vector = _find_near(cell, positions, all_radii, subject)
        return cls(subject, has_radii, all_radii, i, j, shift, vector)

    @cached_property
    def touch(self) -> Array:
        """(pairs,) distance at which the balls touch."""
        return np.asarray(self.radii[self.i] + self.radii[self.j])

    @cached_property
    def distance(self) -> Array:
        """(pairs,) distance of the centres."""
        return np.asarray(np.linalg.norm(self.vector, axis=-1))

    @cached_property
    def ratio(self) -> Array:
        """(pairs,) distance over that of touching balls."""
        return self.distance / self.touch

    @cached_property
    def deviation(self) -> Array:
        """(pairs,) size of the deviation of :attr:`ratio` from one."""
        return np.abs(self.ratio - 1.0)

    def describe_gap(self, cell: Array) -> _Gap | None:
        """Return the gap of the pair that is nearest to touching among those that do not touch;
        None if no pair is within :data:`NEAR`. The ``cell`` (p, d) is that of
        :func:`find_contacts`: to scale the cell may close the gap.
        """
        is_touching = self.deviation <= TOUCH
        is_near = ~is_touching & (self.deviation <= NEAR)
        if not np.any(is_near):
            return None
        pair = int(np.argmin(np.where(is_near, self.deviation, np.inf)))
        image = ""
        if np.any(self.shift[pair]):
            cells = ", ".join(map(str, self.shift[pair].tolist()))
            image = f" shifted by ({cells}) cells"
        balls = f"Ball {self.i[pair]} and ball {self.j[pair]}{image}"
        near_vectors = self.vector[is_near] / self.touch[is_near, None]
        touching_vectors = self.vector[is_touching] / self.touch[is_touching, None]
        mend = _scale_to_touch(cell, near_vectors, touching_vectors, with_positions=self.has_radii)
        if not mend:
            mend = "If numbers were rounded, write them with eight digits or more"
        why = f"{balls} are {self._describe_distance(pair)}"
        return _Gap(float(self.ratio[pair]), why, mend)

    def require_apart(self, gap: _Gap | None) -> None:
        """Raise :class:`~granphon.base.errors.InputError` if balls overlap; ``gap``, that of
        :meth:`describe_gap`, says how to mend an overlap of less than :data:`NEAR`.
        """
        if not np.any(self.ratio < 1.0 - TOUCH):
            return
        pair = int(np.argmin(self.ratio))
        raise InputError(
            f"balls of {self.subject} overlap",
            self._describe_overlap(pair),
            self._mend_overlap(pair, gap),
        )

    def _describe_overlap(self, pair: int) -> str:
        """Return the sentence of a message on the distance of a ``pair`` that overlaps."""
        if not self.has_radii:
            return f"Two sites are {self.ratio[pair]:.9g} apart, and touching balls are 1 apart"
        return f"Balls {self.i[pair]} and {self.j[pair]} are {self._describe_distance(pair)}"

    def _describe_distance(self, pair: int) -> str:
        """Return the distance of a ``pair`` in words, beside that of touching balls."""
        if not self.has_radii:
            return f"{self.ratio[pair]:.9g} apart, where touching balls are 1 apart"
        return (
            f"{self.distance[pair]:.9g} m apart, and their radii add up to {self.touch[pair]:.9g} m"
        )

    def _mend_overlap(self, pair: int, gap: _Gap | None) -> str:
        """Return the sentence of a message on how to mend the overlap of a ``pair``; ``gap`` is as
        in :meth:`require_apart`.
        """
        is_same_site = self.distance[pair] <= TOUCH * self.touch[pair]
        is_slight = self.ratio[pair] >= 1.0 - NEAR
        if self.has_radii and is_same_site:
            return (
                "Give each site of the cell once; places that differ by vectors of the cell are"
                " one site"
            )
        if self.has_radii and self.ratio[pair] < _RATIO_OF_MM:
            return "Compare the units: diameters, cell and positions are in m"
        if gap is not None and is_slight:
            return gap.mend
        return "Move the sites apart"

    def require_contacts(self, cell: Array, positions: Array, gap: _Gap | None) -> None:
        """Raise :class:`~granphon.base.errors.InputError` if a ball touches no other; ``cell`` and
        ``positions`` are those of :func:`find_contacts`, and ``gap`` is that of
        :meth:`describe_gap`.
        """
        touching_balls = self.i[self.deviation <= TOUCH]
        lone_balls = np.setdiff1d(np.arange(len(positions)), touching_balls)
        if not lone_balls.size:
            return
        ball = int(lone_balls[0])
        words = f"ball {ball} of {self.subject}" if self.has_radii else f"a ball of {self.subject}"
        problem = f"{words} touches no other"
        if gap is not None:
            raise InputError(problem, gap.why, gap.mend)
        if self.has_radii:
            raise InputError(problem, *_explain_lone_ball(cell, positions, self.radii, ball))
        raise InputError(problem, "Touching balls are 1 apart")


def _explain_lone_ball(cell: Array, positions: Array, radii: Array, ball: int) -> tuple[str, str]:
    """Return two sentences of a message: how far the ball number ``ball`` is from the ball that is
    nearest to touching it, and how to mend that: positions may be in another unit.

    ``cell``, ``positions`` and ``radii`` are those of :func:`find_contacts`, m.
    """
    steps = _list_steps(cell, math.inf, np.ones(len(cell)))
    moved_into_cell = positions - np.floor(positions @ np.linalg.pinv(cell)) @ cell
    with np.errstate(over="ignore"):
        # (n, steps, d) vectors to the images of all balls in the cells around
        vectors = moved_into_cell[:, None] + steps @ cell - moved_into_cell[ball]
        ratios = np.linalg.norm(vectors, axis=-1) / (radii + radii[ball])[:, None]
    is_no_step = ~np.any(steps, axis=1)
    ratios[ball, is_no_step] = np.inf  # the ball itself
    neighbour, _ = np.unravel_index(np.argmin(ratios), ratios.shape)
    ratio = float(np.min(ratios))
    touch = float(radii[neighbour] + radii[ball])
    why = (
        f"The nearest, ball {neighbour}, is {ratio * touch:.6g} m away, and their radii add up to"
        f" {touch:.6g} m"
    )
    for unit, factor in _UNITS.items():
        if factor / _UNIT_TOLERANCE < ratio < factor * _UNIT_TOLERANCE:
            return why, f"Give cell and positions in m: they look like {unit}"
    return why, "Move them together, until their radii add up to their distance"


def _explain_closing(pairs: _NearPairs, gap: _Gap) -> InputError:
    """Return the error of a ``gap`` of one of the ``pairs`` that is so small that it closes under
    load.
    """
    gap_in_words = f"A gap of {gap.ratio - 1.0:.2g}"
    least_in_words = f"{_CLOSING_GAP:g}"
    if pairs.has_radii:  # without radii the distance is 1
        gap_in_words += " of that"
        least_in_words += " of their distance"
    return InputError(
        f"balls of {pairs.subject} nearly touch",
        f"{gap.why}. {gap_in_words} closes under load, so that it was probably rounded",
        f"{gap.mend}; for balls that do not touch, leave gaps above {least_in_words}",
    )


def _find_near(
    cell: Array, positions: Array, radii: Array, subject: str
) -> tuple[Any, Any, Any, Array]:
    """Return the pairs of balls at ``positions`` (n, d) with ``radii`` (n,) that are no farther
    apart than :data:`_SEARCH_RATIO` times the distance of touching balls, each from both of its
    ends.

    They are balls i and j (pairs,), whole cells (pairs, p) by which j is displaced and vectors
    (pairs, d) from i to j, in the order of i, j, and these cells. Raises InputError, which calls
    the lattice or crystal ``subject``, if too many cells would have to be searched.
    """
    n = len(positions)
    if n <= _MOST_COMPARED:
        return _find_near_among_all(cell, positions, radii, subject)
    cutoff = 2.0 * _SEARCH_RATIO * float(radii.max())
    _require_few_cells(_find_most_steps(cell, cutoff) + 1.0, n / _MOST_COMPARED, subject)
    i, j, shift, vector = find_pairs(positions, cell, cutoff)
    is_near = np.linalg.norm(vector, axis=-1) <= _SEARCH_RATIO * (radii[i] + radii[j])
    i = i[is_near]
    j = j[is_near]
    shift = shift[is_near]
    vector = vector[is_near]
    # each pair from its other end too
    i_of_ends = np.concatenate([i, j])
    j_of_ends = np.concatenate([j, i])
    shift = np.concatenate([shift, -shift])
    vector = np.concatenate([vector, -vector])
    order = np.lexsort((*shift.T[::-1], j_of_ends, i_of_ends))
    return i_of_ends[order], j_of_ends[order], shift[order], vector[order]


def _find_near_among_all(
    cell: Array, positions: Array, radii: Array, subject: str
) -> tuple[Any, Any, Any, Array]:
    """Return balls i and j (pairs,), whole cells (pairs, p) and vectors (pairs, d) as
    :func:`_find_near` does from the same arguments, for a few balls: all pairs are compared.
    """
    within_cell = positions[None] - positions[:, None]  # (n, n, d) from i to j of the same cell
    largest_distance = float(np.linalg.norm(within_cell, axis=-1).max())
    radius = 2.0 * _SEARCH_RATIO * float(radii.max()) + largest_distance
    most_steps = _find_most_steps(cell, radius)
    _require_few_cells(most_steps, 1.0, subject)
    steps = _list_steps(cell, radius, most_steps)
    vectors = within_cell[:, :, None] + (steps @ cell)[None, None]  # (n, n, steps, d)
    touch = radii[:, None] + radii  # (n, n)
    is_near = np.linalg.norm(vectors, axis=-1) <= _SEARCH_RATIO * touch[:, :, None]
    is_same_ball = np.eye(len(positions), dtype=bool)[:, :, None]
    is_itself = is_same_ball & np.all(steps == 0, axis=1)
    i, j, step = np.nonzero(is_near & ~is_itself)
    return i, j, steps[step], vectors[i, j, step]


def _require_few_cells(most_steps: Array, cell_weight: float, subject: str) -> None:
    """Raise :class:`~granphon.base.errors.InputError`, which calls the lattice or crystal
    ``subject``, if too many cells are to be searched: those up to ``most_steps`` (p,) cells along
    each vector to either side. A cell counts ``cell_weight`` times.
    """
    if np.prod(2.0 * most_steps + 1.0) * cell_weight > _MOST_CELLS:
        problem = f"the cell of {subject} is too oblique, or its sites are too far from each other"
        raise InputError(problem, mend="Give short lattice vectors, and sites from 0 to 1")


def find_pairs(positions: Array, periods: Array, cutoff: float) -> tuple[Any, Any, Any, Array]:
    """Find the pairs of places, ``positions`` (n, d), not farther apart than ``cutoff``, zero or
    above, each once, also of images along ``periods`` (p, d).

    Returns the indices i and j (pairs,), the whole periods (pairs, p) by which the image of j is
    shifted, and the vectors (pairs, d) from i to this image. Pairs are sorted by i, then by j, and
    then by the shift. The search is in a tree of the places and of their images near the faces of
    the cell.
    """
    # imported here because it loads much of scipy, which lattices that have a name do not need
    from scipy.spatial import cKDTree

    n = len(positions)
    ball, step = _list_images(positions, periods, cutoff)
    points = positions[ball] + step @ periods
    first, second = cKDTree(points).query_pairs(cutoff, output_type="ndarray").T
    # the first of a pair is the lower one, and a place of the cell comes before all images
    in_cell = first < n
    first = first[in_cell]
    second = second[in_cell]
    i = ball[first]
    j = ball[second]
    shift = step[second] - step[first]
    # a pair within the cell is found once, a pair with an image from both of its ends
    is_counted = (second < n) | select_once(i, j, shift)
    i = i[is_counted]
    j = j[is_counted]
    shift = shift[is_counted]
    vector = points[second[is_counted]] - points[first[is_counted]]
    order = np.lexsort((*shift.T[::-1], j, i))
    return i[order], j[order], shift[order], vector[order]


def _list_images(positions: Array, periods: Array, cutoff: float) -> tuple[Index, Index]:
    """Return the places, ``positions`` (n, d), moved into the cell, and their images as far as
    ``cutoff`` beyond its faces: their numbers (m,) and the whole ``periods`` (m, p) by which they
    are moved.

    The places themselves come first, in their order.
    """
    reciprocal = np.linalg.pinv(periods)  # (d, p)
    fractions = positions @ reciprocal
    home_cells = np.floor(fractions).astype(np.intp)
    fractions -= home_cells
    ball = np.arange(len(positions))
    step = np.zeros((len(positions), len(periods)), np.intp)
    # the cutoff in fractions of each period, with room for rounding
    margins = cutoff * np.linalg.norm(reciprocal, axis=0) * (1.0 + 1e-9)
    for axis, margin in enumerate(margins):
        reach = int(margin) + 1
        balls = [ball]
        steps_of_balls = [step]
        for cells in (*range(-reach, 0), *range(1, reach + 1)):
            image_fractions = fractions[ball, axis] + cells
            is_near = (image_fractions >= -margin) & (image_fractions <= 1.0 + margin)
            image_step = step[is_near]
            image_step[:, axis] = cells
            balls.append(ball[is_near])
            steps_of_balls.append(image_step)
        # images along the next axis are those of all places and images so far
        ball = np.concatenate(balls)
        step = np.concatenate(steps_of_balls)
    return ball, step - home_cells[ball]


def require_joined(
    i: Index,
    j: Index,
    shift: Index,
    n: int,
    periods: int,
    subject: str,
    *,
    why: str = "",
    mend: str = "",
    held: Any = None,
) -> None:
    """Raise :class:`~granphon.base.errors.InputError` unless contacts join all ``n`` balls, one or
    more, and all their images.

    ``i``, ``j`` are (n_c,), ``shift`` is (n_c, periods) cells. Balls that are ``held`` (n,) are one
    body, along all periods. The message calls the crystal or network ``subject``, and says ``why``
    it falls into pieces and how to ``mend`` that.
    """
    if held is not None and np.any(held):
        i, j, shift, n = _merge_held(i, j, shift, held, periods)
    pieces = _find_pieces(_list_neighbours(i, j, shift), n, periods)
    count = sum(copies for _, copies in pieces)
    ranks = {rank for rank, _ in pieces}
    is_full_rank = ranks == {periods}  # each piece extends along all periods
    if is_full_rank and count == 1:
        return
    if is_full_rank:  # so are the clusters of a network without periods
        words = f"{count} {_PIECES[periods]}"
    else:
        kinds = ", ".join(_PIECES[rank] for rank in sorted(ranks))
        words = f"{kinds}, {count} in each cell"
    problem = f"{subject} falls into pieces that do not touch: {words}"
    raise InputError(problem, why, mend or "Move them together, or give one of them alone")


def _merge_held(
    i: Index, j: Index, shift: Index, held: Flags, periods: int
) -> tuple[Index, Index, Index, int]:
    """Replace all ``held`` balls (n,) by one body, which comes after the other balls and touches
    its own images along all p ``periods``.

    Returns the contacts i, j (n_c + p,) and shift (n_c + p, p), and the number of the other balls
    plus one.
    """
    free_count = int(np.count_nonzero(~held))
    body = free_count
    new_index = np.where(held, body, np.cumsum(~held) - 1)
    body_ends = np.full(periods, body)
    i = np.append(new_index[i], body_ends)
    j = np.append(new_index[j], body_ends)
    shift = np.concatenate([shift, np.eye(periods, dtype=np.intp)])
    return i, j, shift, free_count + 1


def _list_neighbours(i: Index, j: Index, shift: Index) -> _Neighbours:
    """Return for each ball the balls that it touches, with the whole cells by which they are
    displaced, from contacts ``i``, ``j`` (n_c,) and ``shift`` (n_c, p).
    """
    neighbours = defaultdict[int, list[tuple[int, _Cells]]](list)
    steps = map(tuple, shift.tolist())
    for ball, neighbour, step in zip(i.tolist(), j.tolist(), steps, strict=True):
        neighbours[ball].append((neighbour, step))
        neighbours[neighbour].append((ball, tuple(-cells for cells in step)))
    return neighbours


def _find_pieces(neighbours: _Neighbours, n: int, periods: int) -> list[tuple[int, int]]:
    """Return two numbers for each piece, a set of balls that contacts join: along how many of the
    ``periods`` the piece extends, and how many of its copies do not touch each other.

    ``neighbours`` are those of each of the ``n`` balls. The whole cells by which rings of contacts
    lead from a ball to its images make a lattice of integers: its rank is the first number, and its
    index the second.
    """
    cells: dict[int, _Cells] = {}  # of each ball that was visited; _walk adds them
    pieces = []
    for ball in range(n):
        if ball in cells:
            continue
        rings = _walk(ball, neighbours, cells, periods)
        basis = _reduce_rows([list(ring) for ring in rings], periods)
        pieces.append((len(basis), _find_lattice_index(basis, periods)))
    return pieces


def _walk(
    start: int, neighbours: _Neighbours, cells: dict[int, _Cells], periods: int
) -> set[_Cells]:
    """Visit all balls that contacts join to ``start``, and add the cell in which each is met first
    to ``cells``.

    Returns the whole cells by which rings of contacts lead from a ball to its images.
    """
    cells[start] = (0,) * periods
    rings = set[_Cells]()
    unvisited = [start]
    while unvisited:
        ball = unvisited.pop()
        for neighbour, step in neighbours[ball]:
            cell = tuple(a + b for a, b in zip(cells[ball], step, strict=True))
            if neighbour not in cells:
                cells[neighbour] = cell
                unvisited.append(neighbour)
            first_cell = cells[neighbour]
            rings.add(tuple(a - b for a, b in zip(cell, first_cell, strict=True)))
    return rings


def _reduce_rows(rows: list[list[int]], periods: int) -> list[list[int]]:
    """Return a basis, a list of rows, of the lattice that integer rows of length ``periods`` make:
    Euclid's algorithm, column by column. The given rows are changed.
    """
    basis = list[list[int]]()
    for column in range(periods):
        nonzero_rows = _sort_nonzero(rows, column)
        while len(nonzero_rows) > 1:
            pivot_row = nonzero_rows[0]
            for row in nonzero_rows[1:]:
                quotient = row[column] // pivot_row[column]
                row[:] = [a - quotient * b for a, b in zip(row, pivot_row, strict=True)]
            nonzero_rows = _sort_nonzero(rows, column)
        basis += nonzero_rows
        rows = [row for row in rows if not row[column]]
    return basis


def _sort_nonzero(rows: list[list[int]], column: int) -> list[list[int]]:
    """Return the rows whose number in a column is not zero, by the size of that number."""
    return sorted((row for row in rows if row[column]), key=lambda row: abs(row[column]))


def _find_lattice_index(basis: list[list[int]], periods: int) -> int:
    """Return the index of the lattice of a ``basis``, rows of length ``periods``, among the
    integers in its span: the greatest common divisor of the minors of its full rank.
    """
    matrix = np.array(basis, float).reshape(len(basis), periods)
    minors = [
        round(abs(np.linalg.det(matrix[:, columns])))
        for columns in itertools.combinations(range(periods), len(basis))
    ]
    return math.gcd(*minors)


def _scale_to_touch(
    cell: Array, near_vectors: Array, touching_vectors: Array, *, with_positions: bool
) -> str:
    """Return the sentence of a message that says by what number to multiply the cell, or its
    coordinates along one axis, so that balls that nearly touch do touch.

    ``near_vectors`` (n, d) join balls that nearly touch, and ``touching_vectors`` (m, d) join those
    that touch already and must not change; both are over the distance at which the balls touch.
    ``with_positions`` says that positions are to be multiplied too. The text is empty if no single
    number makes all balls touch.
    """
    if not len(touching_vectors):
        factors = 1.0 / np.linalg.norm(near_vectors, axis=1)
        if np.ptp(factors) <= TOUCH:
            lengths = "the cell and the positions" if with_positions else "the cell"
            return f"Multiply {lengths} by {np.mean(factors):.12g}"
    if with_positions:
        return ""  # a factor along one axis would change the gaps between the positions too
    for axis in range(len(cell)):
        factor = _scale_axis(near_vectors, touching_vectors, axis)
        if factor is None:
            continue
        length = next(size for size in np.abs(cell[:, axis]).tolist() if size)
        coordinates = "" if cell.shape[1] == 1 else f"every {'xyz'[axis]} of "
        return (
            f"Multiply {coordinates}the cell by {factor:.12g}, so that {length:.9g} becomes"
            f" {length * factor:.12g}"
        )
    return ""


def _scale_axis(near_vectors: Array, touching_vectors: Array, axis: int) -> float | None:
    """Return the factor of the coordinates along an ``axis`` at which the balls of all
    ``near_vectors`` (n, d) touch; None if no factor does that, or if it would part the balls of
    ``touching_vectors`` (m, d). Both are those of :func:`_scale_to_touch`.
    """
    if np.any(np.abs(touching_vectors[:, axis]) > TOUCH):
        return None
    # squares of the components along the axis and across
    along_squared = near_vectors[:, axis] ** 2
    across_squared = np.sum(np.delete(near_vectors, axis, axis=1) ** 2, axis=1)
    # a component along the axis of less than a tenth of the distance does not tell its factor, and
    # no factor brings a component across of one or more to touch
    if np.any(along_squared < _LEAST_SQUARE) or np.any(across_squared >= 1.0):
        return None
    factors = np.sqrt((1.0 - across_squared) / along_squared)
    is_common = np.ptp(factors) <= TOUCH
    return float(np.mean(factors)) if is_common else None


def touch_once_at_most(cell: Array, dim: tuple[int, ...], contact: float) -> bool:
    """Return whether all periods of a supercell of ``dim`` (p,) cells, of the lattice ``cell`` (p,
    d), are longer than twice the length ``contact`` of a contact.

    Any two balls, or a ball and its own image, then touch in at most one way: the vectors to two
    images of a ball differ by a period, so that they cannot both be as short as a contact. Where a
    period is shorter they may touch in several ways.
    """
    supercell = cell * np.array(dim)[:, None]
    short_periods = steps_within(supercell, 2.0 * (1.0 + TOUCH) * contact)
    return len(short_periods) == 1  # only the zero vector
