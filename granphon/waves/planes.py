"""Planes of balls across a direction: where balls are along it, how the network closes on itself, and its ends."""

from __future__ import annotations

import itertools
import math
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Self

import numpy as np
from numpy.typing import NDArray

from granphon.base.errors import InputError, message
from granphon.networks.network import ContactNetwork

Array = NDArray[np.float64]
Index = NDArray[np.intp]
#: relative length below which the part of a period along a direction is zero but for rounding
_FLAT = 1e-9
#: greatest distance of the balls of one plane from it, in mean diameters, in a lattice
_THICK = 0.25
#: the same in a network of no lattice
_THICKER = 0.45
#: greatest number of directions that are compared for a message
_MANY = 40_000


@dataclass(frozen=True)
class Course:
    """The balls of a network in the order in which a plane wave along ``direction`` meets them.

    Attributes
    ----------
    network : the network.
    direction : (3,) unit vector.
    period : distance after which planes across the direction meet themselves, m; infinity if they never do.
    origin : coordinate along the direction at which places begin, m.
    face : place from which distances are counted where the network has been given ends, m; else nan.
    """

    network: ContactNetwork
    direction: Array
    period: float
    origin: float = 0.0
    face: float = math.nan

    @classmethod
    def along(cls, network: ContactNetwork, direction: Array) -> Self:
        """Follow ``direction`` (3,), a unit vector, through the network from its first plane on."""
        periods = network.cell[list(network.pbc)]
        sizes = np.linalg.norm(periods, axis=1)
        heights = np.abs(periods @ direction)
        period = math.inf
        for height, size in zip(heights, sizes, strict=True):
            if height > _FLAT * size:
                least = _FLAT * float(np.max(sizes))
                if math.isinf(period):
                    period = float(height)
                    continue
                # the greatest length that measures both, by Euclid's algorithm; lengths below ``least`` are rounding
                rest = float(height)
                while rest > least:
                    period, rest = rest, abs(period - rest * round(period / rest))
        # places begin halfway between two planes of balls, where a cut meets no ball
        course = cls(network, direction, period)
        if math.isinf(period):
            return replace(course, origin=float(np.min(course.heights[network.moving])) - 0.5 * course.spacing)
        # planes lie within a diameter; the widest gap among the balls there is the one between two of them
        every = course._wrap(course.heights)
        near = np.sort(every)
        near = near[: max(2, int(np.searchsorted(near, course.spacing)) + 1)]
        gaps = np.diff(near, prepend=np.max(every) - period)
        last = int(np.argmax(gaps > (1.0 - _THICK) * np.max(gaps)))
        return replace(course, origin=float(near[last] - 0.5 * gaps[last]))

    @cached_property
    def spacing(self) -> float:
        """Mean diameter of the balls that move, m."""
        return 2.0 * float(np.mean(self.network.radii[self.network.moving]))

    @cached_property
    def heights(self) -> Array:
        """(n,) coordinates along the direction, m."""
        return np.asarray(self.network.positions @ self.direction)

    @cached_property
    def places(self) -> Array:
        """(n,) distance of balls behind the beginning, m, below :attr:`period`."""
        return self._wrap(self.heights - self.origin)

    def _wrap(self, lengths: Array) -> Array:
        return lengths if math.isinf(self.period) else np.mod(lengths, self.period)

    def require_period(self, least: float, why: str) -> None:
        """Raise :class:`~granphon.base.errors.InputError` if planes across it meet themselves before ``least``."""
        if self.period >= least * (1.0 - _FLAT):
            return
        shown = ", ".join(f"{one:.6g}" for one in self.direction[: self.network.dimension])
        heights = np.abs(self.network.cell[list(self.network.pbc)] @ self.direction)
        sides = " and ".join(f"{one:.6g}" for one in heights if one > _FLAT * float(np.max(heights)))
        # the two directions nearest to this one whose planes have a period of ``least``, with the period, m
        periods, found = self.network.cell[list(self.network.pbc)], []
        dual = np.linalg.pinv(periods).T  # rows b with b_i . a_j = delta_ij
        most = np.floor(np.linalg.norm(periods, axis=1) / least).astype(int)
        most = np.minimum(most, int(0.5 * (_MANY ** (1.0 / len(periods)) - 1.0)))
        for whole in itertools.product(*(range(-n, n + 1) for n in most)):
            if math.gcd(*whole) == 1:
                vector = np.array(whole) @ dual
                size = 1.0 / float(np.linalg.norm(vector))
                if size >= least:
                    found.append((float(vector @ self.direction) * size, (size * vector).tolist(), size))
        best = sorted(found, key=lambda one: -round(one[0], 9))[:2]
        better = [([round(x, 12) + 0.0 for x in one[: self.network.dimension]], size) for _, one, size in best]
        offer = " or ".join(f"({', '.join(f'{x:.6g}' for x in one)}), with {size:.6g} m" for one, size in better)
        closes = f"come back to themselves after {self.period:.6g} m" if self.period > self.spacing else "do not close"
        cell = f". The cell is {sides} m long along it, and the greatest common measure counts" if " and " in sides else ""
        # where vectors of the cell go equally far along the direction, that length is the period
        longer = "a longer array" if not cell else "an array whose numbers of cells make these lengths equal"
        what, why = f"planes across ({shown}) {closes} in this periodic network", f"{why}: {least:.6g} m are needed{cell}"
        mend = f"{longer}, or the direction {offer}" if better else f"or {longer}"
        raise InputError(message(what, why, f"Take a shorter distance, {mend}"))

    @cached_property
    def crossings(self) -> NDArray[np.intp]:
        """(n_c,) how often each contact, from ball i to ball j, passes the beginning: 1 from the end, -1 towards it."""
        if math.isinf(self.period):
            return np.zeros(self.network.n_contacts, int)
        network = self.network
        step = self.places[network.j] - self.places[network.i]
        # of balls, and not of lines of contacts: their true distance along the direction
        return np.rint((network.vector @ self.direction - step) / self.period).astype(int)

    def with_ends(self, ends: str) -> Course:
        """Return the course through the network with ``ends``, see :data:`~granphon.waves.settings.ENDS`."""
        if ends == "periodic" or (ends == "free" and math.isinf(self.period)):
            return self
        if math.isinf(self.period):
            what = "there is no place for walls: the network has no period along this direction"
            mend = "Leave ends out: the network then has the ends that it has"
            raise InputError(message(what, "Walls are made where a period is cut", mend))
        network, cut = self.network, self.crossings != 0
        if ends == "free":
            kept = {name: getattr(network, name)[~cut] for name in network.contact_fields}
            return replace(self, network=replace(network, **kept), face=0.0)
        held = np.unique(np.where(self.crossings[cut] > 0, network.i[cut], network.j[cut]))
        masses = np.array(network.masses)
        masses[held] = math.inf
        # the wall in front of the first balls is the one behind the last, a period earlier
        face = float(np.max(self.places[held])) - self.period
        return replace(self, network=replace(network, masses=masses), face=face)

    def find_plane(self, place: float, what: str) -> Index:
        """Return the balls that move within a quarter of a diameter of the ball nearest to ``place``, along the direction.

        Where there is no lattice, and so no planes, within nine twentieths.

        Raises :class:`~granphon.base.errors.InputError` if none is within a diameter.
        """
        moving = np.flatnonzero(self.network.moving)
        away = self._find_offset(self.places[moving] - place)
        nearest = int(np.argmin(np.round(np.abs(away) / self.spacing, 6)))
        if abs(away[nearest]) > self.spacing:
            low, high = float(np.min(self.places[moving])), float(np.max(self.places[moving]))
            why = f"Balls lie from {low:.6g} to {high:.6g} m along the direction"
            mend = "Take a shorter distance, or a longer array"
            raise InputError(message(f"there is no plane of balls for the {what} at {place:.6g} m", why, mend))
        thick = (_THICKER if self.network.lattice is None else _THICK) * self.spacing
        return moving[np.abs(self._find_offset(away - away[nearest])) <= thick]

    @property
    def _is_closed(self) -> bool:
        """Whether the last balls are neighbours of the first."""
        return math.isfinite(self.period) and math.isnan(self.face)

    def _find_offset(self, lengths: Array) -> Array:
        """Return lengths as the shortest of those that differ by whole periods, if there are no ends."""
        return lengths - self.period * np.rint(lengths / self.period) if self._is_closed else lengths

    def find_place(self, balls: Index) -> float:
        """Return the mean place of ``balls``, which lie near each other along the direction."""
        places = self.places[balls]
        return float(places[0] + np.mean(self._find_offset(places - places[0])))

    def find_distance(self, start: float, balls: Index) -> float:
        """Return the mean distance of ``balls`` ahead of the place ``start``, m."""
        ahead = self.find_place(balls) - start
        return float(np.mod(ahead, self.period)) if self._is_closed else ahead

    def find_echo(self, start: float, balls: Index) -> float:
        """Return how much longer the way of the first echo from an end is than that from ``start`` to ``balls``, m.

        Balls within a diameter of an end send or hear the pulse and its reflection there as one. Without ends the way is
        that of the pulse that runs the other way round.
        """
        if self._is_closed:
            return self.period - 2.0 * self.find_distance(start, balls)
        moving = self.places[self.network.moving]
        first, last = (0.0, self.period) if math.isfinite(self.period) else (float(np.min(moving)), float(np.max(moving)))
        ways = (2.0 * (start - first), 2.0 * (last - self.find_place(balls)))
        return min((one for one in ways if one > 2.0 * self.spacing), default=2.0 * (last - first))
