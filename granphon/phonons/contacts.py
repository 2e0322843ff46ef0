"""Contacts of balls near the sites of a lattice: which pairs of balls they are, and how they are at rest.

Pairs are searched in a tree of the balls and of their periodic images (:class:`PairList`), in a list that is kept from call
to call while the balls move little. A pair counts as the contact of the lattice whose vector is nearest to its own
(:class:`ContactFinder`). Places are (N, m), where m is the number of coordinates of a ball that count; all lengths are in
mean diameters.
"""

from __future__ import annotations

from functools import cached_property
from typing import Any, NamedTuple

import numpy as np
from ase import Atoms
from numpy.typing import NDArray

from granphon.balls.contact_table import TOUCH, find_pairs
from granphon.base.errors import InputError
from granphon.media.state import ContactState

Array = NDArray[np.float64]
#: distance, in diameters, by which a list reaches beyond the cutoff. A list serves until a ball has moved by half of it. It
#: is small enough that a list does not reach the second neighbours of the lattices.
_SKIN = 0.3
#: length, area or volume, in diameters, below which a cell counts as one of none
_FLAT = 1e-12
#: greatest distance, in diameters, between the vector of a pair and a contact vector of the lattice for the pair to count as
#: that contact
_CATCH = 0.25
#: greatest rotation of the whole lattice that is accepted when energies are found. The measure is the overlap that the
#: rotation would add to contacts of fixed direction, over the overlap that they have
_TURN_PER_OVERLAP = 1e-2
#: the same when force constants are found, as added overlap over the spacing. It is larger, because positions then only tell
#: which balls touch
_TURN_PER_SPACING = 1e-4


# -- pairs ----------------------------------------------------------------------------------------------------------------


class Pairs(NamedTuple):
    """Pairs of balls, each once: indices ``i`` and ``j`` (n,), vectors (n, m) from i to j, in diameters.

    ``shift`` (n, m) is the number of whole cells by which the image of ball j is shifted. m is 1, 2 or 3, the number of
    coordinates of a ball.
    """

    i: NDArray[np.intp]
    j: NDArray[np.intp]
    shift: NDArray[np.intp]
    vector: Array


def keep_rows(kept: NDArray[np.bool_], *arrays: NDArray[Any]) -> tuple[NDArray[Any], ...]:
    """Return the rows of each array that are ``kept``; the arrays themselves if that is all of them, as it mostly is."""
    return arrays if kept.all() else tuple(values[kept] for values in arrays)


class PairList:
    """A search for pairs that keeps its list. The list reaches beyond the cutoff, and serves until it might miss a pair."""

    def __init__(self) -> None:
        self._kept: tuple[Pairs, Array, Array, tuple[bool, ...], float] | None = None

    def near(self, positions: Array, cell: Array, periodic: tuple[bool, ...], cutoff: float) -> Pairs:
        """Find the pairs nearer than ``cutoff``, in the order of (i, j, shift); all lengths are in diameters.

        ``positions`` are (N, m), ``cell`` is (m, m), with a row for each axis, periodic or not. A kept list gives the same
        numbers to the last digit as a new one. Raises :class:`~granphon.base.errors.InputError` for a periodic axis whose
        cell vector has no length, and for periods that are not independent of each other.
        """
        serves = False
        if self._kept is not None and positions.shape == self._kept[1].shape and periodic == self._kept[3]:
            _, old, last, _, reach = self._kept
            # a change of the cell maps every vector to vector F. A pair that was beyond the reach is then at least s times
            # the reach apart, where s is the smallest singular value of F, less what its two balls have moved besides
            stretch = 1.0
            if not np.array_equal(cell, last):
                change = np.linalg.solve(last, cell) if abs(np.linalg.det(last)) >= _FLAT else np.zeros_like(cell)
                stretch, old = float(np.linalg.svd(change, compute_uv=False)[-1]), old @ change
            moved = positions - old
            farthest = float(np.sqrt(np.max(np.einsum("na,na->n", moved, moved), initial=0.0)))
            serves = stretch * reach - 2.0 * farthest >= cutoff
        if self._kept is None or not serves:
            reach, axes = cutoff + _SKIN, np.flatnonzero(periodic)
            periods = cell[axes]
            if not np.all(np.any(periods, axis=1)):
                raise InputError("the balls are periodic along a cell vector of zero length", "The period is not known")
            if len(axes) and np.prod(np.linalg.svd(periods, compute_uv=False)) < _FLAT:
                what = f"the balls are periodic in a cell without {('a length', 'an area', 'a volume')[len(axes) - 1]}"
                raise InputError(what, f"Its vectors are {'parallel' if len(axes) == 2 else 'not independent'}")
            i, j, steps, vector = find_pairs(positions, periods, reach)
            shift = np.zeros((len(i), len(cell)), np.intp)
            shift[:, axes] = steps
            self._kept = Pairs(i, j, shift, vector), positions.copy(), cell.copy(), periodic, reach
        i, j, shift, _ = self._kept[0]
        vector = positions[j] - positions[i] + shift @ cell
        near = np.einsum("ca,ca->c", vector, vector) < cutoff**2
        return Pairs(*keep_rows(near, i, j, shift, vector))


# -- contacts -------------------------------------------------------------------------------------------------------------


class Rest(NamedTuple):
    """Contacts in the reference state: directions (n, m), and overlaps and distances of the centres (n,), in diameters."""

    axis: Array
    overlap: Array
    distance: Array


class ContactFinder:
    """A search for the contacts of balls of one lattice at one load.

    Parameters
    ----------
    state : the state. The contact vectors of its lattice are the reference of each contact; with finite overlap contacts
        have the directions in which the balls are, at the spacing a = d - delta.
    coordinates : m, the number of coordinates of a ball that count.
    overlap : delta/d of the state.
    apart : delta/d up to which all balls are apart; below zero where diameters differ, as the largest balls touch first.
    spacing : of the sites, in diameters.
    free : whether balls need not be near the sites of the lattice, but may touch in any direction.
    """

    def __init__(
        self, state: ContactState, coordinates: int, overlap: float, apart: float, spacing: float, free: bool
    ) -> None:
        self.overlap, self.apart, self.spacing = overlap, apart, spacing
        self._finite_overlap, self._lattice = state.finite_overlap, state.packing.structure
        self._coordinates, self._periods, self._free = coordinates, self._lattice.periods, free
        self._near = PairList()

    def find_pairs(self, balls: Atoms, places: Array) -> Pairs:
        """Find the pairs of balls that are near enough to touch, each pair once."""
        largest = 1.0 + float(np.max(balls.arrays["diameter_deviations"], initial=0.0)) + _CATCH
        m, p = self._coordinates, self._periods
        cell = np.asarray(balls.cell)[:m, :m]
        if p < m:  # no vector across the periods counts
            cell = np.concatenate([cell[:p], np.eye(m)[p:]])
        return self._near.near(places, cell, tuple(balls.pbc[:m].tolist()), largest)

    @cached_property
    def _directions(self) -> Array:
        """(2 n_c, m) contact vectors of the lattice, both ways, at spacing one."""
        normal = self._lattice.contacts.normal
        return np.pad(np.concatenate([normal, -normal]), ((0, 0), (0, self._coordinates - normal.shape[1])))

    @cached_property
    def _midway(self) -> float:
        """Distance halfway from that of touching balls to that of second neighbours, if these are close."""
        cell, places = np.eye(3), np.zeros((self._lattice.n_balls, 3))
        cell[: self._periods, : self._lattice.dimension] = self._lattice.vectors
        places[:, : self._lattice.dimension] = self._lattice.positions
        pairs = PairList().near(places, cell, tuple(axis < self._periods for axis in range(3)), 1.0 + 2.0 * _CATCH)
        distance = np.linalg.norm(pairs.vector, axis=1)
        second = np.min(distance, where=distance > 1.0 + TOUCH, initial=1.0 + 2.0 * _CATCH)
        return 0.5 * self.spacing * (1.0 + float(second))

    def find_normals(self, vector: Array, extra: Array, at_sites: bool = False) -> tuple[Array, NDArray[np.bool_]]:
        """Find the direction of the lattice contact nearest to each pair, and whether the pair is near enough to be it.

        ``extra`` (n,) is what the diameters of the two balls add to the distance at which they touch. ``at_sites`` says that
        the vectors join the sites of the balls, and so only tell which balls touch.

        Raises :class:`InputError` if balls touch in another direction, or if the lattice is turned too far for contacts of
        fixed direction.
        """
        distance = np.linalg.norm(vector, axis=1)
        if self._free:
            near = np.abs(distance - self.spacing) < _CATCH
            return vector / distance[:, None], near & (distance < self._midway) if at_sites else near
        nearest = np.argmax(vector @ self._directions.T, axis=1)
        normal = self._directions[nearest]
        near = np.linalg.norm(vector - self.spacing * normal, axis=1) < _CATCH
        reach = self.spacing + self.overlap + extra - self.apart
        astray = ~near & (distance < reach)
        touching = near & (np.einsum("ca,ca->c", vector, normal) < reach)
        turn = _find_turn(normal, vector, distance, touching)
        turned = _TURN_PER_SPACING if at_sites else _TURN_PER_OVERLAP * (self.overlap - self.apart)
        if np.any(astray) or 0.5 * turn**2 > turned:
            what = f"contacts are turned against the lattice of the state, by {np.degrees(turn):.3g} degrees on average"
            if np.any(astray):
                what = "balls touch in directions that are not those of the lattice"
            why = "With friction, and in the limit of small overlap, contacts keep these"
            mend = "Keep the orientation of gp.atoms(state), or take a state of finite overlap without friction"
            raise InputError(what, why, mend)
        return normal, near

    def find_rest(self, balls: Atoms, i: NDArray[np.intp], j: NDArray[np.intp], normal: Array) -> Rest:
        """Find direction, overlap and distance of each contact in the reference state.

        There balls are displaced from their sites, which are one spacing apart in the direction ``normal``. In the paper's
        limit the contact keeps the direction of the sites. The overlap is found without adding displacements to the spacing,
        where it would lose its digits.
        """
        deviations = balls.arrays["diameter_deviations"]
        displacements = balls.arrays["displacements"][:, : self._coordinates]
        moved = displacements[j] - displacements[i]
        overlap = self.overlap + 0.5 * (deviations[i] + deviations[j])
        along = np.einsum("ca,ca->c", normal, moved)
        if not self._finite_overlap:
            return Rest(normal, overlap - along, np.full(len(normal), self.spacing))
        vector = self.spacing * normal + moved
        distance = np.linalg.norm(vector, axis=1)
        # |r| - a for r = a n + u, without the difference of two nearly equal numbers
        farther = (2.0 * self.spacing * along + np.einsum("ca,ca->c", moved, moved)) / (distance + self.spacing)
        return Rest(vector / distance[:, None], overlap - farther, distance)


def _find_turn(normal: Array, vector: Array, distance: Array, touching: NDArray[np.bool_]) -> float:
    """Return the angle, rad, by which contacts are turned against their normals on average; in the plane with its sign."""
    if normal.shape[1] == 1 or not np.any(touching):
        return 0.0
    if normal.shape[1] == 2:
        across, apart = keep_rows(touching, normal[:, 0] * vector[:, 1] - normal[:, 1] * vector[:, 0], distance)
        return float(np.mean(across / apart))
    normal, vector, distance = keep_rows(touching, normal, vector, distance)
    # a turn by omega gives n x v = (1 - nn) omega; along a single line of contacts omega has no part that could be seen
    across = np.sum(np.cross(normal, vector) / distance[:, None], axis=0)
    turn = np.linalg.pinv(len(normal) * np.eye(3) - normal.T @ normal, rcond=1e-9, hermitian=True) @ across
    return float(np.linalg.norm(turn))
