"""Parts of a network: balls that carry no load, and pieces that do not touch."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
Bools = NDArray[np.bool_]
Index = NDArray[np.intp]
#: force, over the mean of all contacts that are pressed, up to which a contact carries no load
LEAST_LOAD = 1e-6
#: sum of the forces on a ball, over the sum of their sizes, up to which they are in balance
_BALANCED = 1e-3


def find_rattlers(
    i: Index, j: Index, moving: Bools, force: Array, normal: Array, held_by: int, in_rows: bool = False
) -> Index:
    """Find the balls that carry no load: those with fewer contacts than can hold them, then those that these leave so.

    A contact counts if its force is above :data:`LEAST_LOAD` of the mean of all; if no contact of the network has a force,
    all contacts count, as if their forces were equal. A wall is no rattler.

    Parameters
    ----------
    i, j : (n_c,) the two balls of each contact.
    moving : (n,) whether each ball moves; a wall does not.
    force, normal : (n_c,) N, and (n_c, 3) from i to j.
    held_by : least number of contacts that hold a ball.
    in_rows : whether two contacts or more whose forces are in balance, as along a straight row, also hold a ball.
    """
    weight = force if np.any(force > 0.0) else np.ones(len(i))
    live = weight > LEAST_LOAD * np.mean(weight, where=weight > 0.0) if len(weight) else np.zeros(0, bool)
    i, j, n = i[live], j[live], len(moving)
    weights = weight[live]
    push = weights[:, None] * normal[live]
    count = np.bincount(i, minlength=n) + np.bincount(j, minlength=n)
    total = np.bincount(i, weights, n) + np.bincount(j, weights, n)
    pull = np.stack([np.bincount(j, one, n) - np.bincount(i, one, n) for one in push.T], axis=1)

    def is_held(balls: Index) -> Bools:
        balanced = np.linalg.norm(pull[balls], axis=1) <= _BALANCED * total[balls]
        in_row = in_rows & (count[balls] >= 2) & balanced
        return np.asarray((count[balls] >= held_by) | in_row | ~moving[balls])

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


def number_pieces(i: Index, j: Index, moving: Bools) -> Index:
    """Number the sets of balls that contacts join: (n,) the number of the set of each ball. A wall joins none."""
    from scipy.sparse import coo_array
    from scipy.sparse.csgraph import connected_components

    both, n = moving[i] & moving[j], len(moving)
    graph = coo_array((np.ones(np.count_nonzero(both)), (i[both], j[both])), shape=(n, n))
    return np.asarray(connected_components(graph, directed=False)[1], np.intp)


def find_pieces(i: Index, j: Index, moving: Bools) -> list[Index]:
    """Find the sets of balls that contacts join, the largest first; a wall joins none, and is in each that it touches."""
    piece = number_pieces(i, j, moving)
    members = np.flatnonzero(moving)
    order = members[np.argsort(piece[members], kind="stable")]
    sets = np.split(order, np.flatnonzero(np.diff(piece[order])) + 1) if order.size else []
    walls = ~(moving[i] & moving[j])
    ball, wall = np.where(moving[i], i, j)[walls], np.where(moving[i], j, i)[walls]
    if ball.size:
        sets = [np.unique(np.append(balls, wall[piece[ball] == piece[balls[0]]])) for balls in sets]
    return sorted(sets, key=len, reverse=True)
