"""The contacts of balls near the sites of a lattice: which pairs of balls they are, and how they are at rest.

Places are (N, m), where m is the number of coordinates of a ball that count; all lengths are in mean diameters.
"""

from __future__ import annotations

from functools import cached_property
from typing import NamedTuple

import numpy as np
from ase import Atoms
from numpy.typing import NDArray

from granphon.balls.contact_table import TOUCH
from granphon.balls.lattices import Lattice
from granphon.balls.motions import ALL, IN_PLANE, LONGITUDINAL, OUT_OF_PLANE, Motions, allowed_motions
from granphon.balls.packing import Packing
from granphon.base.errors import InputError, brief, message
from granphon.phonons.neighbours import PairList, Pairs, keep_rows

Array = NDArray[np.float64]
#: greatest distance, in diameters, between the vector of a pair and a contact vector of the lattice for the pair to count as
#: that contact
_CATCH = 0.25
#: greatest rotation of the whole lattice that is accepted when energies are found. The measure is the overlap that the
#: rotation would add to contacts of fixed direction, over the overlap that they have
_TURN_PER_OVERLAP = 1e-2
#: the same when force constants are found, as added overlap over the spacing. It is larger, because positions then only tell
#: which balls touch
_TURN_PER_SPACING = 1e-4
#: sets of motions, by name, that force constants may be asked of
_SUBSETS = {one.name: one for one in (LONGITUDINAL, IN_PLANE, OUT_OF_PLANE, ALL)}


class Rest(NamedTuple):
    """Contacts in the reference state: directions (n, m), and overlaps and distances of the centres (n,), in diameters."""

    axis: Array
    overlap: Array
    distance: Array


class Deformations(NamedTuple):
    """Closed contacts in reduced units: vectors (n, m) from ball i to j, energies (n,), forces (n, m).

    The torques are (n,) about z, or about each of x, y and z.
    """

    i: NDArray[np.intp]
    j: NDArray[np.intp]
    vector: Array
    energy: Array
    force_on_j: Array
    torque_on_i: list[Array]
    torque_on_j: list[Array]


class ContactFinder:
    """A search for the contacts of balls of one lattice at one load.

    Parameters
    ----------
    lattice : the lattice, whose contact vectors are the reference of each contact.
    coordinates : m, the number of coordinates of a ball that count.
    overlap : delta/d of the state.
    apart : delta/d up to which all balls are apart; below zero where diameters differ, as the largest balls touch first.
    finite_overlap : whether contacts have the directions in which the balls are, at the spacing a = d - delta.
    free : whether balls need not be near the sites of the lattice, but may touch in any direction.
    """

    def __init__(
        self, lattice: Lattice, coordinates: int, overlap: float, apart: float, finite_overlap: bool, free: bool
    ) -> None:
        self.spacing = 1.0 - overlap if finite_overlap else 1.0
        self._coordinates, self._periods = coordinates, lattice.periods
        self._overlap, self._apart = overlap, apart
        self._finite_overlap, self._free, self._lattice = finite_overlap, free, lattice
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
        reach = self.spacing + self._overlap + extra - self._apart
        astray = ~near & (distance < reach)
        touching = near & (np.einsum("ca,ca->c", vector, normal) < reach)
        turn = _find_turn(normal, vector, distance, touching)
        turned = _TURN_PER_SPACING if at_sites else _TURN_PER_OVERLAP * (self._overlap - self._apart)
        if np.any(astray) or 0.5 * turn**2 > turned:
            what = f"contacts are turned against the lattice of the state, by {np.degrees(turn):.3g} degrees on average"
            if np.any(astray):
                what = "balls touch in directions that are not those of the lattice"
            raise InputError(
                message(
                    what,
                    "With friction, and in the paper's limit, contacts have the fixed directions of the lattice;"
                    " these balls are turned against the lattice, or were moved among each other",
                    "Leave them in the orientation of gp.atoms(state), or use a state of finite overlap without friction",
                )
            )
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
        overlap = self._overlap + 0.5 * (deviations[i] + deviations[j])
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


def find_motions(packing: Packing, name: str | None) -> Motions:
    """Return the motions that are named, or those of the packing; rotations count where the packing names them.

    Raises :class:`InputError` for a name of motions that its balls do not have.
    """
    own = allowed_motions(packing.structure.dimension)[packing.ball_motions.name]
    if name is None:
        return own
    had = {
        word: one for word, one in _SUBSETS.items()
        if set(one.translations) <= set(own.translations) and set(one.rotations) <= set(own.rotations)
    }  # fmt: skip
    if not isinstance(name, str) or name not in had:
        raise InputError(
            message(
                f"the state has no motions {brief(name)}",
                f"Its balls have the motions {own.name!r}",
                "Use " + ", ".join(had) + ", or make a state of a Packing with these motions",
            )
        )
    return had[name]
