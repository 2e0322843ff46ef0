"""Loops over clusters of balls, compiled: the groups that contacts join, a step of Newton's method
for each group, and the slope of its energy along the step.

Balls of a cluster are few, or have few contacts that are closed, so that they make chains: ordered
from neighbour to neighbour (E. Cuthill and J. McKee, 1969) their matrix has all entries near the
diagonal, and its factors L D L^T have entries between the first of a row and the diagonal alone.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from granphon.base.arrays import Array, Flags
from granphon.base.compiled import compiled


@compiled
def _find_root(parents: NDArray[np.int64], ball: int) -> int:
    """Return the ball that stands for the group of a ``ball``, and shorten the way there."""
    while parents[ball] != ball:
        parents[ball] = parents[parents[ball]]
        ball = parents[ball]
    return ball


@compiled
def join_balls(
    i: NDArray[np.int64], j: NDArray[np.int64], joining: Flags, group: NDArray[np.int64]
) -> int:
    """Set ``group`` (n,) to the numbers of the groups of balls between which contacts are
    ``joining`` (n_c,), and return how many groups there are.

    Bodies from number n on join nothing.
    """
    n = len(group)
    parents = np.arange(n)
    for contact in range(len(i)):
        if joining[contact] and i[contact] < n and j[contact] < n:
            first = _find_root(parents, i[contact])
            second = _find_root(parents, j[contact])
            parents[max(first, second)] = min(first, second)
    count = 0
    for ball in range(n):
        root = _find_root(parents, ball)
        if root == ball:
            group[ball] = count
            count += 1
        else:
            group[ball] = group[root]
    return count


@compiled
def _order_balls(
    starts: NDArray[np.int64],
    neighbours: NDArray[np.int64],
    first: int,
    begin: int,
    order: NDArray[np.int64],
    place: NDArray[np.int64],
) -> int:
    """Set ``order`` from ``begin`` on to the balls that contacts join to the ``first``, level by
    level, and ``place`` to where they stand; return where they end.
    """
    order[begin] = first
    place[first] = begin
    end = begin + 1
    visited = begin
    while visited < end:
        ball = order[visited]
        visited += 1
        for entry in range(starts[ball], starts[ball + 1]):
            neighbour = neighbours[entry]
            if place[neighbour] < 0:
                place[neighbour] = end
                order[end] = neighbour
                end += 1
    return end


@compiled
def _multiply(values: Array, start: int, other_start: int, count: int) -> float:
    """Return the sum of the products of ``count`` values from ``start`` on and as many from
    ``other_start`` on.
    """
    # four sums at a time: an addition need not wait for the last one
    first = 0.0
    second = 0.0
    third = 0.0
    fourth = 0.0
    quarter = count // 4 * 4
    for entry in range(0, quarter, 4):
        first += values[start + entry] * values[other_start + entry]
        second += values[start + entry + 1] * values[other_start + entry + 1]
        third += values[start + entry + 2] * values[other_start + entry + 2]
        fourth += values[start + entry + 3] * values[other_start + entry + 3]
    for entry in range(quarter, count):
        first += values[start + entry] * values[other_start + entry]
    return first + second + third + fourth


@compiled
def _list_neighbours(
    i: NDArray[np.int64], j: NDArray[np.int64], along: Array, n: int
) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """Return where the neighbours of each ball begin, (n + 2,), and the neighbours, ball after
    ball: those at its contacts that are closed, with a stiffness ``along`` (n_c,) above zero.
    """
    starts = np.zeros(n + 2, np.int64)
    for contact in range(len(i)):
        if along[contact] > 0.0 and i[contact] < n and j[contact] < n:
            starts[i[contact] + 2] += 1
            starts[j[contact] + 2] += 1
    for ball in range(n):
        starts[ball + 2] += starts[ball + 1]
    neighbours = np.empty(starts[n + 1], np.int64)
    # each start moves on to that of the next ball as neighbours are written
    for contact in range(len(i)):
        if along[contact] > 0.0 and i[contact] < n and j[contact] < n:
            neighbours[starts[i[contact] + 1]] = j[contact]
            neighbours[starts[j[contact] + 1]] = i[contact]
            starts[i[contact] + 1] += 1
            starts[j[contact] + 1] += 1
    return starts, neighbours


@compiled
def _order_clusters(
    starts: NDArray[np.int64], neighbours: NDArray[np.int64], moves: Flags
) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """Return the balls of all clusters of balls that ``moves`` (n,) names, cluster after cluster,
    each from one of its ends; and the place (n,) of each ball among these, -1 of others.
    """
    n = len(moves)
    order = np.empty(n, np.int64)
    place = np.full(n, -1)
    count = 0
    for ball in range(n):
        if moves[ball] and place[ball] < 0:
            # from the last of a first order, at an end of the group
            end = _order_balls(starts, neighbours, ball, count, order, place)
            last = order[end - 1]
            for entry in range(count, end):
                place[order[entry]] = -1
            count = _order_balls(starts, neighbours, last, count, order, place)
    return order[:count], place


@compiled
def _lay_rows(
    starts: NDArray[np.int64],
    neighbours: NDArray[np.int64],
    order: NDArray[np.int64],
    place: NDArray[np.int64],
    d: int,
) -> tuple[NDArray[np.int64], NDArray[np.int64], int]:
    """Return how the lower triangle of a matrix (rows, rows) is stored, each row from its first
    entry to the diagonal: the column of its first entry, and the index that its column zero would
    have among all entries, (rows,) each; and the number of entries.
    """
    size = d * len(order)
    first = np.empty(size, np.int64)
    row_starts = np.empty(size, np.int64)
    length = 0
    for entry in range(len(order)):
        earliest = entry
        ball = order[entry]
        for neighbour in range(starts[ball], starts[ball + 1]):
            earliest = min(earliest, place[neighbours[neighbour]])
        for axis in range(d):
            row = d * entry + axis
            first[row] = d * earliest
            row_starts[row] = length - first[row]
            length += row + 1 - first[row]
    return first, row_starts, length


@compiled
def _add_contacts(
    ends: tuple[NDArray[np.int64], NDArray[np.int64]],
    normal: Array,
    along: Array,
    across: Array,
    place: NDArray[np.int64],
    row_starts: NDArray[np.int64],
    values: Array,
    d: int,
) -> None:
    """Add the stiffnesses of contacts to the entries ``values`` of the lower triangle."""
    i, j = ends
    n = len(place)
    for contact in range(len(i)):
        if not along[contact] > 0.0:
            continue
        at_i = d * place[i[contact]] if i[contact] < n else -1
        at_j = d * place[j[contact]] if j[contact] < n else -1
        later = max(at_i, at_j)
        if later < 0:
            continue
        earlier = min(at_i, at_j)
        for line in range(d):
            for column in range(d):
                stiffness = (along[contact] - across[contact]) * (
                    normal[contact, line] * normal[contact, column]
                )
                if line == column:
                    stiffness += across[contact]
                if column <= line:
                    values[row_starts[later + line] + later + column] += stiffness
                    if earlier >= 0:
                        values[row_starts[earlier + line] + earlier + column] += stiffness
                if earlier >= 0:
                    values[row_starts[later + line] + earlier + column] -= stiffness


@compiled
def _solve(
    first: NDArray[np.int64], row_starts: NDArray[np.int64], values: Array, solution: Array
) -> None:
    """Set ``solution`` (rows,), the right side, to the solution, by factors L D L^T of the lower
    triangle, whose entries ``values`` become those of L.
    """
    size = len(first)
    diagonal = np.empty(size)
    # factors row by row, and L^-1 of the right side along with them
    for row in range(size):
        row_start = row_starts[row]
        begin = first[row]
        for column in range(begin, row):
            low = max(begin, first[column])
            products = _multiply(values, row_start + low, row_starts[column] + low, column - low)
            values[row_start + column] -= products
        pivot = values[row_start + row]
        for column in range(begin, row):
            factor = values[row_start + column] / diagonal[column]
            pivot -= factor * values[row_start + column]
            values[row_start + column] = factor
            solution[row] -= factor * solution[column]
        diagonal[row] = pivot
    for row in range(size):
        solution[row] /= diagonal[row]
    for row in range(size - 1, -1, -1):
        for column in range(first[row], row):
            solution[column] -= values[row_starts[row] + column] * solution[row]


@compiled
def find_cluster_steps(
    i: NDArray[np.int64],
    j: NDArray[np.int64],
    normal: Array,
    along: Array,
    across: Array,
    springs: Array,
    moves: Flags,
    forces: Array,
    steps: Array,
) -> None:
    """Set ``steps`` (n, d) to the motions under ``forces`` (n, d) of the balls that ``moves`` (n,)
    names; others stay.

    Parameters
    ----------
    i, j : (n_c,) numbers of the two bodies of each contact; those from n on are held.
    normal : (n_c, 3) unit vectors.
    along, across : (n_c,) stiffnesses along normals and across them, zero or above; contacts
        without the first are open.
    springs : (n,) stiffnesses, above zero, that hold balls to the ground.
    """
    n, d = forces.shape
    steps[:] = 0.0
    starts, neighbours = _list_neighbours(i, j, along, n)
    order, place = _order_clusters(starts, neighbours, moves)
    first, row_starts, length = _lay_rows(starts, neighbours, order, place, d)
    values = np.zeros(length)
    solution = np.empty(len(first))
    for entry in range(len(order)):
        ball = order[entry]
        for axis in range(d):
            row = d * entry + axis
            values[row_starts[row] + row] = springs[ball]
            solution[row] = forces[ball, axis]
    _add_contacts((i, j), normal, along, across, place, row_starts, values, d)
    _solve(first, row_starts, values, solution)
    for entry in range(len(order)):
        for axis in range(d):
            steps[order[entry], axis] = solution[d * entry + axis]


@compiled
def measure_slopes(
    i: NDArray[np.int64],
    j: NDArray[np.int64],
    current: Array,
    distance: Array,
    force: Array,
    stiffness: Array,
    steps: Array,
    group: NDArray[np.int64],
    work: Array,
    rise: Array,
) -> None:
    """Add to ``work`` (groups,) that of the forces of contacts along the steps (n, d) of each group
    of balls, and to ``rise`` (groups,) what contacts make it fall by, over the length of a step.

    ``current`` (n_c, 3) and ``distance`` (n_c,) are vectors from body to body, and their lengths.
    """
    n, d = steps.shape
    for contact in range(len(i)):
        if force[contact] == 0.0 and stiffness[contact] == 0.0:
            continue
        first = i[contact]
        second = j[contact]
        behind = 0.0
        ahead = 0.0
        for axis in range(d):
            component = current[contact, axis] / distance[contact]
            if first < n:
                behind += component * steps[first, axis]
            if second < n:
                ahead += component * steps[second, axis]
        if first < n:
            work[group[first]] -= force[contact] * behind
        if second < n:
            work[group[second]] += force[contact] * ahead
        rise[group[min(first, second)]] += stiffness[contact] * (ahead - behind) ** 2


@compiled
def choose_lengths(
    work: Array,
    rise: Array,
    first: Array,
    exponent: float,
    slope: float,
    length: Array,
    low: Array,
    high: Array,
    is_done: Flags,
) -> bool:
    """Set the lengths (groups,) of steps that are tried next, between ``low`` and ``high``, which
    are narrowed; return whether all groups are done.

    A group is done where its energy still falls at the end of the step, or the ``work`` is at most
    ``slope`` times the ``first``. Of one contact that closes on the way the work is first - c
    (length - place)^exponent.
    """
    all_done = True
    for group in range(len(work)):
        if is_done[group]:
            continue
        trial = length[group]
        if work[group] > 0.0:
            low[group] = trial
        elif work[group] < 0.0:
            high[group] = trial
        is_open = high[group] == np.inf
        if abs(work[group]) <= slope * first[group] or (work[group] >= 0.0 and is_open):
            is_done[group] = True
            continue
        all_done = False
        change = -work[group]
        if change > 0.0:
            fall = first[group] + change
            change = exponent * fall * (1.0 - (first[group] / fall) ** (1.0 / exponent))
        near = trial - change / rise[group] if rise[group] > 0.0 else trial
        end = min(high[group], 1.0)
        least = 0.9 * low[group] + 0.1 * end
        length[group] = min(max(near, least), 0.1 * low[group] + 0.9 * end)
    return all_done
