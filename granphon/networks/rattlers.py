"""Rattlers: balls that carry no load, as too few contacts hold them.

A ``network`` is a :class:`~granphon.networks.network.ContactNetwork`, which stands above this
module.
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import numpy as np

from granphon.balls.hertz import HOLDING_FORCE
from granphon.base.arrays import Flags, Index
from granphon.networks.consistency import BALANCE_LIMIT


def find_rattlers(network: Any, held_by: int | None = None) -> Index:
    """Return the indices (m,) of the balls that carry no load; for ``held_by`` see
    :meth:`granphon.networks.network.ContactNetwork.without_rattlers`.

    First the balls with too few contacts are found. Then the contacts of these balls are removed,
    ball by ball, and neighbours that have too few contacts after that are added, until there is no
    further one.
    """
    hold = _Hold(network, held_by)
    is_loose = ~hold.are_held(np.arange(network.n_balls))
    if not np.any(network.moving & ~is_loose):  # all balls that move are loose already
        return np.flatnonzero(is_loose)
    # loose balls whose contacts have not been removed yet
    waiting = np.flatnonzero(is_loose).tolist()
    while waiting:
        for neighbour in hold.release(waiting.pop()):
            if not is_loose[neighbour] and not hold.are_held(np.array([neighbour]))[0]:
                is_loose[neighbour] = True
                waiting.append(neighbour)
    return np.flatnonzero(is_loose)


def find_most_held_by(network: Any, most: int) -> int:
    """Return the greatest ``held_by``, up to ``most`` and to the number of contacts of the ball
    that has most, with which :func:`find_rattlers` leaves a ball that moves; 0 if there is no such
    number above 0.
    """
    counts = np.bincount(np.concatenate([network.i, network.j]), minlength=network.n_balls)
    low = 0
    high = min(most, int(np.max(counts, initial=0)))
    # bisection, as a ball that is held where more contacts are needed is held where fewer are
    while low < high:
        middle = (low + high + 1) // 2
        moving_and_held = np.delete(network.moving, find_rattlers(network, middle))
        if np.any(moving_and_held):
            low = middle
        else:
            high = middle - 1
    return low


class _Hold:
    """The counts and sums of forces by which the contacts that carry load hold each ball of a
    network; :meth:`release` removes the contacts of a ball from them.

    Attributes
    ----------
    needs_no_contacts : (n,) whether a ball is held without contacts: it does not move, or springs
        to the ground resist all of its displacements.
    i, j : (m,) the balls of the contacts that carry load; in an adhesive network of all contacts,
        which are stiff without a force, too.
    sizes : (m,) the magnitudes of the normal forces of these contacts, N, or 1 if no contact has a
        force.
    forces : (m, 3) these forces as vectors, of i on j.
    counts : (n,) number of these contacts that each ball has.
    total_sizes, total_forces : (n,) and (n, 3) the sums of the sizes, and of the vectors, of the
        forces on each ball.
    least_count : least number of contacts that hold a ball.
    rows_hold : whether two or more contacts whose forces are in balance, as along a straight row,
        hold a ball, too.
    """

    def __init__(self, network: Any, held_by: int | None) -> None:
        """Count the contacts of the network that carry load, at each ball.

        ``held_by`` is the least number of contacts that hold a ball. By default it is two if
        contacts resist slip; else it is one more than there are dimensions, and contacts in balance
        (``rows_hold``) hold a ball, too.
        """
        n = network.n_balls
        slips_freely = not np.any(network.shear_stiffness)
        self.needs_no_contacts = ~network.moving | network.is_anchored
        self.rows_hold = slips_freely and held_by is None
        n_needed = network.dimension + 1 if slips_freely else 2
        self.least_count = n_needed if held_by is None else held_by
        force = network.normal_force
        if not np.any(force):
            force = np.ones(network.n_contacts)
        is_loaded = np.ones(network.n_contacts, bool)
        if network.n_contacts and not network.adhesive:  # without contacts the mean would be nan
            is_loaded = force > HOLDING_FORCE * np.mean(force, where=force > 0.0)
        self.i = network.i[is_loaded]
        self.j = network.j[is_loaded]
        self.sizes = np.abs(force[is_loaded])
        self.forces = force[is_loaded, None] * network.normal[is_loaded]
        self.counts = np.bincount(self.i, minlength=n) + np.bincount(self.j, minlength=n)
        sizes_on_i = np.bincount(self.i, self.sizes, n)
        self.total_sizes = sizes_on_i + np.bincount(self.j, self.sizes, n)
        # the force of a contact acts on ball j, and the opposite force on ball i
        sums = [
            np.bincount(self.j, component, n) - np.bincount(self.i, component, n)
            for component in self.forces.T
        ]
        self.total_forces = np.stack(sums, axis=1)
        self._is_open = np.ones(len(self.i), bool)  # (m,) whether a contact is not released yet
        # The ends of contacts are numbered, first all ends i and then all ends j. In the order
        # _order they are sorted by their balls; those at ball b begin at _starts[b].
        ends = np.concatenate([self.i, self.j])
        self._order = np.argsort(ends, kind="stable")
        self._starts = np.searchsorted(ends[self._order], np.arange(n + 1))

    def are_held(self, balls: Index) -> Flags:
        """Return (m,) whether each of some ``balls``, (m,) indices, is held: by enough contacts
        that have not been released, by contacts in balance (``rows_hold``), or without contacts
        (``needs_no_contacts``).
        """
        counts = self.counts[balls]
        net_force = np.linalg.norm(self.total_forces[balls], axis=1)
        is_balanced = net_force <= BALANCE_LIMIT * self.total_sizes[balls]
        is_held_in_row = self.rows_hold & (counts >= 2) & is_balanced
        return np.asarray(
            (counts >= self.least_count) | is_held_in_row | self.needs_no_contacts[balls]
        )

    def release(self, ball: int) -> Iterator[int]:
        """Remove the contacts of a ``ball`` one by one, and yield the neighbour at each.

        When a neighbour is yielded, the contact has been taken from the count and the sums of the
        neighbour. Those of the ball itself are wrong from then on, and nothing reads them any more.
        """
        ends = self._order[self._starts[ball] : self._starts[ball + 1]]
        contacts = ends % len(self.i)  # the ends j of all contacts follow the ends i
        for contact in contacts[self._is_open[contacts]].tolist():
            self._is_open[contact] = False
            force = self.forces[contact]
            if self.i[contact] == ball:
                neighbour = int(self.j[contact])
                self.total_forces[neighbour] -= force
            else:
                neighbour = int(self.i[contact])
                self.total_forces[neighbour] += force
            self.counts[neighbour] -= 1
            self.total_sizes[neighbour] -= self.sizes[contact]
            yield neighbour
