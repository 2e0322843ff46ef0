"""Layers of a lattice across an axis: how a strip, slab or column is cut, for crystals, networks
and half spaces alike.
"""

from __future__ import annotations

import re
from dataclasses import dataclass
from functools import partial
from typing import Any

import numpy as np

from granphon.balls.ball import Wall
from granphon.balls.material import Material
from granphon.balls.neighbours import TOUCH, contact_frames
from granphon.base.arrays import Array, Flags, Index
from granphon.base.errors import InputError, Refused, brief
from granphon.base.text import counted, show
from granphon.base.validation import choice, each, is_one_of, is_whole, whole

#: how an edge may be held
EDGES = ("free", "clamped", "floor")
#: part of a period across the line or plane in which it lies, but for rounding
_TILT_ROUNDING = 1e-12
#: part of a layer by which sites at one height may differ
_HEIGHT_ROUNDING = 1e-9
#: largest Miller index, of either sign
_MOST_INDEX = 100
#: largest number of rounds in which two vectors are shortened; rounding may let two of one length
#: change places for ever
_MOST_REDUCTIONS = 100


@dataclass(frozen=True)
class Layers:
    """Layers that follow each other across an axis of a cell.

    Attributes
    ----------
    basis : (p, p) whole numbers that make vectors of the cell: those within a layer, and last that
        to the next layer.
    turn : (d, d) rotation after which the periods of a layer lie along x, or in the xy plane; with
        one period it may be a reflection of x, if the period leads to lower x.
    cell : (p - 1, d) periods of a layer, turned.
    stack : (d,) vector to the next layer, turned; its component along axis p - 1 is above zero.
    """

    basis: Index
    turn: Array
    cell: Array
    stack: Array

    @classmethod
    def across(cls, axis: Any, cell: Array) -> Layers:
        """Find the layers of a ``cell`` (p, d), whose periods lie along x, in the xy plane or in
        space.

        ``axis`` is the number of the vector along which layers follow each other, or integer Miller
        indices (p,) from -100 to 100; of a hexagonal cell in space also the four h, k, i, l. Raises
        :class:`~granphon.base.errors.InputError` for another ``axis``, and for a cell without
        periods.
        """
        p, d = cell.shape
        basis = _find_basis(axis, cell)
        vectors = basis @ cell
        turn = np.eye(d)

        def turn_upright() -> None:
            """Write to ``turn`` the rotation or reflection after which the periods of a layer lie
            along x, or in the xy plane, and each vector has a component above zero along its axis.
            """
            q, r = np.linalg.qr((basis @ cell)[:, :p].T)
            # each column of q gets the sign of the component of its vector
            turn[:p, :p] = (q * np.sign(np.diag(r))).T

        is_tilted = np.any(np.abs(vectors[:-1, p - 1 :]) > _TILT_ROUNDING * np.max(np.abs(vectors)))
        leads_down = vectors[-1, p - 1] < 0.0
        if is_tilted or leads_down:
            turn_upright()
        is_mirrored = np.linalg.det(turn) < 0.0
        if is_mirrored and p > 1:  # the opposite of a period within the layer makes it a rotation
            basis[0] = -basis[0]
            turn_upright()
        turned_vectors = basis @ cell @ turn.T
        layer_cell = turned_vectors[:-1]
        layer_cell[:, p - 1 :] = 0.0  # exactly, where rounding has left a little
        return cls(basis, turn, layer_cell, turned_vectors[-1])

    def split(self, shift: Index) -> tuple[Index, Index]:
        """Return by how many cells within a layer, (n_c, p - 1), and by how many layers, (n_c,),
        each contact leads that leads to another cell by ``shift`` (n_c, p).
        """
        steps = np.rint(shift @ np.linalg.inv(self.basis)).astype(np.intp)
        return steps[:, :-1], steps[:, -1]

    def gather(
        self, positions: Array, i: Index, j: Index, shift: Index, walls: Any = False
    ) -> tuple[Array, Index]:
        """Return positions (n, d) and shifts (n_c, p) of the same balls and contacts ``i``, ``j``
        (n_c,), with all sites within one layer.

        Sites that lie one layer or more above the lowest are moved down by whole layers; if there
        are none, the given arrays themselves are returned. ``walls`` (n,) says which of the n
        bodies are walls, which have no site and stay where they are.
        """
        p = len(self.basis)
        height = (positions @ self.turn.T)[:, p - 1] / self.stack[p - 1]  # in layers
        is_wall = np.broadcast_to(walls, height.shape)
        lowest = np.min(height, where=~is_wall, initial=np.inf)
        layers_down = np.where(is_wall, 0.0, np.floor(height - lowest + _HEIGHT_ROUNDING))
        if not np.any(layers_down):
            return positions, shift
        moved_positions = positions - layers_down[:, None] * (self.stack @ self.turn)
        # a contact of two balls leads as many layers higher as ball j is moved down more than i
        difference = layers_down[j] - layers_down[i]
        layers_up = np.where(is_wall[i] | is_wall[j], 0.0, difference).astype(np.intp)
        return moved_positions, shift + layers_up[:, None] * self.basis[-1]

    def unfold(
        self, i: Index, j: Index, shift: Index, n: int, count: int
    ) -> tuple[Index, Index, Index, Index]:
        """Return the contacts among ``count`` layers of ``n`` balls each, from those of a cell,
        ``shift`` (n_c, p).

        They are balls i and j (m,), numbered layer by layer, the row (m,) of each contact among
        those of the cell, and its cells (m, p - 1) within a layer.
        """
        cells_in_layer, rise = self.split(shift)
        # (count, n_c): the layer of ball j, where ball i is in each layer
        layer_of_j = np.arange(count)[:, None] + rise
        is_within = (layer_of_j >= 0) & (layer_of_j < count)
        layer, row = np.nonzero(is_within)
        unfolded_i = layer * n + i[row]
        unfolded_j = layer_of_j[layer, row] * n + j[row]
        return unfolded_i, unfolded_j, row, cells_in_layer[row]


def read_axis(value: Any) -> Any:
    """Read the number of a vector of a cell, or Miller indices, as a scene has them; raises Refused
    for another value.
    """
    if is_whole(value) and 0 <= value <= 2:
        return int(value)
    indices = value
    if isinstance(value, str):
        words = value.split()
        # a word that is no number is refused below, in its own letters
        is_number = re.compile("-?[0-9]{1,9}").fullmatch
        indices = [int(word) if is_number(word) else word for word in words]
    if not isinstance(indices, list | tuple):
        allowed = (
            "the number of a vector of the cell, 0 to 2 (on a chain 0, in a layer 0 or 1), or"
            " Miller indices, as 1 1 0"
        )
        raise Refused(show(value), allowed)
    index_rule = partial(whole, low=-_MOST_INDEX, high=_MOST_INDEX)
    return each(indices, index_rule, "Miller indices")


def read_edges(value: Any) -> tuple[str | Wall, str | Wall]:
    """Read how the lower and the upper edge are held, from one word or wall for both or two; raises
    Refused for another value.
    """
    words = value.split() if isinstance(value, str) else value
    if isinstance(words, Wall):
        words = [words]
    if not isinstance(words, list | tuple) or len(words) not in (1, 2):
        raise Refused(
            show(value),
            f"one edge for both faces, or two for the lower and the upper: {', '.join(EDGES)}, or"
            " a wall of a material",
        )
    edges = [read_edge(word) for word in words]
    return edges[0], edges[-1]


def read_edge(value: Any) -> str | Wall:
    """Read how one edge is held, from a word or a wall; raises Refused for another value."""
    if isinstance(value, Wall):
        return value
    try:
        return choice(value, EDGES)
    except Refused as refused:
        allowed = f"{refused.allowed}, or a wall of a material"
        mend = refused.mend
        if isinstance(value, Material) or is_one_of(value, ("wall",)):
            mend = "Write gp.Wall(material), in a scene {wall: ...} with a material or a kind"
        raise Refused(refused.found, allowed, mend) from None


def find_faces(
    heights: Array, radii: Array, edges: tuple[Any, Any], n: int, slack: float = 0.0
) -> tuple[Index, Index]:
    """Return the indices of the balls of the lower and the upper face of layers of ``n`` balls
    each. Their ``heights`` and ``radii``, m, are (count n,), layer by layer; walls have infinite
    radii.

    The balls of a clamped face are all of the outer layer; those of another face are the balls that
    a plane would touch, or come nearer to than ``slack``, m. ``edges`` says how the lower and the
    upper face are held.
    """
    is_ball = np.isfinite(radii)  # walls are no balls
    margin = TOUCH * radii[is_ball].max()

    def find_face(edge: Any, outward: float, first_of_layer: int) -> Index:
        """Return the balls of the face on the side of ``outward``, -1 or 1, by its ``edge``;
        ``first_of_layer`` is the number of the first ball of its outer layer.
        """
        if edge == "clamped":
            return first_of_layer + np.arange(n)
        outer_heights = np.where(is_ball, outward * heights + radii, -np.inf)
        is_touched = outer_heights >= outer_heights.max() - slack - margin
        return np.flatnonzero(is_touched)

    lower_face = find_face(edges[0], -1.0, 0)
    upper_face = find_face(edges[1], 1.0, len(heights) - n)
    return lower_face, upper_face


def find_outer(heights: Array) -> Flags:
    """Return (2, n) whether each ball, with its centre at one of the ``heights`` (n,), m, lies in
    the lowest quarter of a cut, and whether it lies in the highest.
    """
    low = float(heights.min())
    high = float(heights.max())
    quarter = 0.25 * (1.0 + _HEIGHT_ROUNDING) * (high - low)
    return np.stack([heights <= low + quarter, heights >= high - quarter])


def _find_basis(axis: Any, cell: Array) -> Index:
    """Return (p, p) whole numbers that make vectors of a cell: those within a layer, and last that
    to the next layer. ``axis`` is as for :meth:`Layers.across`, and so are the errors.
    """
    periods = len(cell)
    if not periods:
        raise InputError(
            "there is no period across which layers could follow each other",
            mend="Give balls that repeat",
        )
    basis = np.eye(periods, dtype=np.intp)
    if is_whole(axis) and 0 <= axis < periods:
        return np.concatenate([np.delete(basis, axis, axis=0), basis[axis : axis + 1]])
    basis_of_layer, stack = _split_by_plane(_read_miller_indices(axis, cell))
    basis_of_layer = _shorten(basis_of_layer, cell)
    if len(basis_of_layer):
        # whole vectors of the plane are taken from the stack, so that it stands as upright as
        # possible
        components, *_ = np.linalg.lstsq((basis_of_layer @ cell).T, stack @ cell, rcond=None)
        stack = stack - np.rint(components).astype(np.intp) @ basis_of_layer
    return np.concatenate([basis_of_layer, stack[None]])


def _read_miller_indices(axis: Any, cell: Array) -> Index:
    """Return the Miller indices (p,) of a plane, of a ``cell`` (p, d); InputError if ``axis`` is
    not a list of such indices, if all are zero, or one is beyond :data:`_MOST_INDEX`.
    """
    periods = len(cell)
    entries = axis.tolist() if isinstance(axis, np.ndarray) else axis
    if not isinstance(entries, list | tuple) or not all(map(is_whole, entries)):
        entries = ()  # refused below
    indices = np.array(entries)
    if indices.shape == (4,) and periods == 3:
        indices = _read_four_indices(indices, cell)
    is_plane = indices.shape == (periods,) and bool(np.any(indices))
    if not is_plane or np.max(np.abs(indices)) > _MOST_INDEX:
        count = counted(periods, "Miller index", "Miller indices")
        raise InputError(
            f"axis is {brief(axis)}",
            mend=f"Give the number of a vector of the cell, 0 to {periods - 1}, or {count}"
            f" from -{_MOST_INDEX} to {_MOST_INDEX}, not all zero",
        )
    return np.asarray(indices)


def _read_four_indices(indices: Any, cell: Array) -> Any:
    """Return h, k and l of the four indices h, k, i, l of a hexagonal ``cell`` (3, d), where
    i = -(h + k); InputError for another cell, or another i.
    """
    a, b, c = cell
    problem = f"axis is {brief(indices.tolist())}"
    square = float(a @ a)
    # differences of the products of the vectors from those of a hexagonal cell
    deviations = [b @ b - square, a @ b + 0.5 * square, a @ c, b @ c]
    if np.max(np.abs(deviations)) > TOUCH * (square + float(c @ c)):
        why = (
            "Four Miller indices belong to a hexagonal cell: two equal vectors at 120"
            " degrees, and one across them"
        )
        raise InputError(problem, why, "Give three, one for each vector of the cell")
    h, k, third, last = indices.tolist()
    if h + k + third != 0:
        why = "The third of four Miller indices is minus the sum of the first two"
        raise InputError(problem, why, f"Give {[h, k, -(h + k), last]}")
    return indices[[0, 1, 3]]


def _split_by_plane(indices: Index) -> tuple[Index, Index]:
    """Return whole numbers (p - 1, p) that make vectors within the plane of Miller indices (p,),
    and whole numbers (p,) that make a vector to the next plane: Euclid's algorithm.
    """
    basis = np.eye(len(indices), dtype=np.intp)
    # the number of planes that each vector of the basis rises
    rises = (indices // np.gcd.reduce(indices)).astype(np.intp)
    while np.count_nonzero(rises) > 1:
        rising_vectors = np.flatnonzero(rises)
        flattest = rising_vectors[np.argmin(np.abs(rises[rising_vectors]))]
        for vector in rising_vectors:
            if vector != flattest:
                quotient = int(np.rint(rises[vector] / rises[flattest]))
                rises[vector] -= quotient * rises[flattest]
                basis[vector] -= quotient * basis[flattest]
    rising_vector = int(np.flatnonzero(rises)[0])  # the only one that is left
    stack = basis[rising_vector] * int(np.sign(rises[rising_vector]))
    return np.delete(basis, rising_vector, axis=0), stack


def _shorten(basis: Index, cell: Array) -> Index:
    """Return whole numbers (p - 1, p) that make the shortest vectors of the plane of the vectors
    that ``basis`` (p - 1, p) makes: Gauss's reduction of two vectors.
    """
    if len(basis) < 2:
        return basis
    for _ in range(_MOST_REDUCTIONS):
        previous_basis = basis.copy()
        lengths = np.linalg.norm(basis @ cell, axis=1)
        basis = basis[np.argsort(lengths, kind="stable")]
        shorter = basis[0] @ cell
        longer = basis[1] @ cell
        quotient = int(np.rint(longer @ shorter / (shorter @ shorter)))
        basis[1] -= quotient * basis[0]
        if np.array_equal(previous_basis, basis):
            break
    return basis


def find_axes(periods: Array) -> Array:
    """Return unit vectors (d, d), rows, of which the first p span the ``periods`` (p, d), one or
    more.

    They are x, y, z where the periods lie along x, or in the xy plane, already; else the first is
    along the first period.
    """
    p, d = periods.shape
    is_tilted = np.any(np.abs(periods[:, p:]) > _TILT_ROUNDING * np.max(np.abs(periods)))
    if not is_tilted:
        return np.eye(d)
    first_axis = periods[0] / np.linalg.norm(periods[0])
    if p == 1:
        frames = np.array(contact_frames(first_axis[None]))  # (3, 3, 1): vectors, components
        return frames[:d, :d, 0]
    normal = np.cross(periods[0], periods[1])
    normal /= np.linalg.norm(normal)
    return np.array([first_axis, np.cross(normal, first_axis), normal])
