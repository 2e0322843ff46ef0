"""Parts of a network: balls that carry no load, and pieces that do not touch."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

if TYPE_CHECKING:
    from granphon.networks.network import ContactNetwork

__all__ = ["LEAST_LOAD", "find_pieces", "find_rattlers", "number_pieces"]

Array = NDArray[np.float64]
Index = NDArray[np.intp]
#: force, over the mean of all contacts that are pressed, up to which a contact carries no load
LEAST_LOAD = 1e-6
#: sum of the forces on a ball, over the sum of their sizes, up to which they are in balance
_BALANCED = 1e-3


def find_rattlers(network: ContactNetwork, held_by: int | None = None) -> Index:
    """Find the balls that carry no load: those with fewer contacts than can hold them, then those that these leave so.

    A contact counts if its force is above :data:`LEAST_LOAD` of the mean of all; if no contact of the network has a force,
    all contacts count, as if their forces were equal. A ball is held by ``held_by`` contacts or more: by default by two
    where contacts resist slip, and by one more than there are dimensions where they do not. By default, a ball that slips
    is also held by two contacts or more whose forces are in balance, as along a straight row. A wall is no rattler.
    """
    force = network.normal_force
    pressed = force > 0.0
    weight = force if np.any(pressed) else np.ones(network.n_contacts)
    live = weight > LEAST_LOAD * np.mean(weight, where=weight > 0.0) if len(weight) else np.zeros(0, bool)
    slips = not np.any(network.shear_stiffness)
    least = (network.dimension + 1 if slips else 2) if held_by is None else held_by
    i, j, n = network.i[live], network.j[live], network.n_balls
    weights = weight[live]
    push = weights[:, None] * network.normal[live]
    count = np.bincount(i, minlength=n) + np.bincount(j, minlength=n)
    total = np.bincount(i, weights, n) + np.bincount(j, weights, n)
    pull = np.stack([np.bincount(j, one, n) - np.bincount(i, one, n) for one in push.T], axis=1)

    def is_held(balls: Index) -> NDArray[np.bool_]:
        balanced = np.linalg.norm(pull[balls], axis=1) <= _BALANCED * total[balls]
        in_row = slips & (held_by is None) & (count[balls] >= 2) & balanced
        return np.asarray((count[balls] >= least) | in_row | ~network.moving[balls])

    # contacts of each ball, one list after the other
    ends = np.concatenate([i, j])
    order = np.argsort(ends, kind="stable")
    first = np.searchsorted(ends[order], np.arange(n + 1))
    loose = ~is_held(np.arange(n))
    left, open_contacts = np.flatnonzero(loose).tolist(), np.ones(len(i), bool)
    while left:
        ball = left.pop()
        contacts = order[first[ball] : first[ball + 1]] % len(i)
        for contact in contacts[open_contacts[contacts]].tolist():
            open_contacts[contact] = False
            from_i = i[contact] == ball
            other = int(j[contact] if from_i else i[contact])
            count[other] -= 1
            total[other] -= weights[contact]
            pull[other] -= push[contact] if from_i else -push[contact]
            if not loose[other] and not is_held(np.array([other]))[0]:
                loose[other] = True
                left.append(other)
    return np.flatnonzero(loose)


def number_pieces(network: ContactNetwork) -> Index:
    """Number the sets of balls that contacts join: (n,) the number of the set of each ball. A wall joins none."""
    from scipy.sparse import coo_array
    from scipy.sparse.csgraph import connected_components

    both = network.moving[network.i] & network.moving[network.j]
    ends = network.i[both], network.j[both]
    graph = coo_array((np.ones(len(ends[0])), ends), shape=(network.n_balls, network.n_balls))
    return np.asarray(connected_components(graph, directed=False)[1], np.intp)


def find_pieces(network: ContactNetwork) -> list[Index]:
    """Find the sets of balls that contacts join, the largest first; a wall joins none, and is in each that it touches."""
    moving, piece = network.moving, number_pieces(network)
    members = np.flatnonzero(moving)
    order = members[np.argsort(piece[members], kind="stable")]
    sets = np.split(order, np.flatnonzero(np.diff(piece[order])) + 1) if order.size else []
    walls = ~(moving[network.i] & moving[network.j])
    one = np.where(moving[network.i], network.i, network.j)[walls]
    wall = np.where(moving[network.i], network.j, network.i)[walls]
    if one.size:
        touched = piece[one]
        sets = [np.unique(np.append(balls, wall[touched == piece[balls[0]]])) for balls in sets]
    return sorted(sets, key=len, reverse=True)
