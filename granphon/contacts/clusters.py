"""Compiled loops over clusters of balls: the groups that contacts join, a step of Newton's method
for each group, and the slope of its energy along the step.

Arrays over balls are (n,) or (n, d), those over contacts (n_c,). The balls of a cluster are few, or
they have few closed contacts and make chains. If balls are ordered from neighbour to neighbour (E.
Cuthill and J. McKee, 1969), all entries of their matrix are near the diagonal, and a row of its
factor L in L D L^T begins where the row of the matrix begins.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from granphon.base.arrays import Array, Flags
from granphon.base.compiled import compiled


class Springs(NamedTuple):
    """Contacts as springs between bodies; bodies from number n on, the number of balls, are held.

    Attributes
    ----------
    i, j : (n_c,) numbers of the two bodies.
    normal : (n_c, 3) unit vectors from body i to body j.
    along, across : (n_c,) stiffnesses along normals and across them, zero or above; contacts with
        ``along`` zero are open.
    """

    i: NDArray[np.int64]
    j: NDArray[np.int64]
    normal: Array
    along: Array
    across: Array


class Pushes(NamedTuple):
    """Contacts that push bodies; bodies from number n on, the number of balls, do not move.

    Attributes
    ----------
    i, j : (n_c,) numbers of the two bodies.
    current : (n_c, 3) vectors from body i to body j.
    distance : (n_c,) lengths of these vectors.
    force : (n_c,) forces, above zero where contacts push.
    stiffness : (n_c,) stiffnesses.
    """

    i: NDArray[np.int64]
    j: NDArray[np.int64]
    current: Array
    distance: Array
    force: Array
    stiffness: Array


class Lengths(NamedTuple):
    """The search for the length of the step of each group.

    Attributes
    ----------
    length : (groups,) lengths that are tried.
    low, high : (groups,) lengths between which the work passes zero; ``high`` is infinite until a
        trial has gone too far. No trial is longer than one.
    is_done : (groups,) whether the search has ended.
    """

    length: Array
    low: Array
    high: Array
    is_done: Flags


@compiled
def _find_root(parents: NDArray[np.int64], ball: int) -> int:
    """Return the root of the group of a ``ball``: the ball that the chain of ``parents`` (n,) ends
    at. Every second ball on the way gets its grandparent as parent, so that the next search is
    shorter.
    """
    while parents[ball] != ball:
        parents[ball] = parents[parents[ball]]
        ball = parents[ball]
    return ball


@compiled
def join_balls(
    i: NDArray[np.int64], j: NDArray[np.int64], is_joining: Flags, group: NDArray[np.int64]
) -> int:
    """Set ``group`` (n,) to the number of the group of each ball, and return the number of groups.

    Balls ``i`` and ``j`` (n_c,) of each contact where ``is_joining`` (n_c,) is true are in the same
    group; a ball without such a contact is a group of its own. Contacts with bodies from number n
    on, which are not balls, join nothing.
    """
    n = len(group)
    parents = np.arange(n)
    # the root of a group is its ball of the least number, so that it is counted first below
    for contact in range(len(i)):
        if is_joining[contact] and i[contact] < n and j[contact] < n:
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
def find_largest(vectors: Array, group: NDArray[np.int64], largest: Array) -> None:
    """Set ``largest`` (groups,), which must be zeros before, to the greatest length of the
    ``vectors`` (n, d) of the balls of each group, or to nan if a vector of the group is nan.
    ``group`` (n,) is the number of the group of each ball.
    """
    n, d = vectors.shape
    for ball in range(n):
        square = 0.0
        for axis in range(d):
            square += vectors[ball, axis] * vectors[ball, axis]
        length = math.sqrt(square)
        if length > largest[group[ball]] or length != length:
            largest[group[ball]] = length


@compiled
def _order_balls(
    starts: NDArray[np.int64],
    neighbours: NDArray[np.int64],
    first: int,
    begin: int,
    order: NDArray[np.int64],
    place: NDArray[np.int64],
) -> int:
    """Write the cluster of the ball ``first`` into ``order`` from the index ``begin`` on.
    Return the index after its last ball.

    The order is that of a search level by level: first the neighbours of ``first``, then theirs.
    ``place`` (n,), the index of each ball in ``order``, is set for the balls of the cluster; before
    the call it must be -1 for them. ``starts`` and ``neighbours`` are those of
    :func:`_list_neighbours`.
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
def _multiply_stretches(values: Array, start: int, other_start: int, count: int) -> float:
    """Return the scalar product of two stretches of ``values``: ``count`` numbers from ``start``
    on, and as many from ``other_start`` on.
    """
    # four sums take less time than one: the processor adds to one while it still adds to another
    first = 0.0
    second = 0.0
    third = 0.0
    fourth = 0.0
    in_fours = count // 4 * 4
    for entry in range(0, in_fours, 4):
        first += values[start + entry] * values[other_start + entry]
        second += values[start + entry + 1] * values[other_start + entry + 1]
        third += values[start + entry + 2] * values[other_start + entry + 2]
        fourth += values[start + entry + 3] * values[other_start + entry + 3]
    for entry in range(in_fours, count):
        first += values[start + entry] * values[other_start + entry]
    return first + second + third + fourth


@compiled
def _can_join(i: int, j: int, along: float, n: int) -> bool:
    """Return whether a contact of the bodies ``i`` and ``j`` with the stiffness ``along`` is closed
    and joins two balls: bodies from number ``n`` on are no balls, and a ball and its own image are
    one ball.
    """
    return along > 0.0 and i < n and j < n and i != j


@compiled
def _list_neighbours(contacts: Springs, n: int) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """Return ``starts`` (n + 2,) and ``neighbours``: the neighbours of ball b are
    ``neighbours[starts[b] : starts[b + 1]]``. The last number of ``starts`` is not used.

    Neighbours are balls that share one of the ``contacts``, if it is closed, once for each such
    contact. The ``n`` balls alone are neighbours, and a ball that touches its own image is none of
    its own.
    """
    i = contacts.i
    j = contacts.j
    along = contacts.along
    # starts[b + 2] first counts the neighbours of ball b. After the sums over balls, starts[b + 1]
    # is the start of ball b. It counts up as neighbours of ball b are written, and is the start of
    # ball b + 1 in the end
    starts = np.zeros(n + 2, np.int64)
    for contact in range(len(i)):
        if _can_join(i[contact], j[contact], along[contact], n):
            starts[i[contact] + 2] += 1
            starts[j[contact] + 2] += 1
    for ball in range(n):
        starts[ball + 2] += starts[ball + 1]
    neighbours = np.empty(starts[n + 1], np.int64)
    for contact in range(len(i)):
        if _can_join(i[contact], j[contact], along[contact], n):
            neighbours[starts[i[contact] + 1]] = j[contact]
            neighbours[starts[j[contact] + 1]] = i[contact]
            starts[i[contact] + 1] += 1
            starts[j[contact] + 1] += 1
    return starts, neighbours


@compiled
def _order_clusters(
    starts: NDArray[np.int64], neighbours: NDArray[np.int64], is_moving: Flags
) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """Return ``order``, the balls of all clusters cluster after cluster, and ``place`` (n,), the
    index of each ball in ``order``, which is -1 for balls of no cluster.

    A cluster is a ball where ``is_moving`` (n,) is true with all balls that closed contacts join to
    it, whether ``is_moving`` is true for these or not. Each cluster is ordered from one of its
    ends, which keeps the entries of its matrix near the diagonal. ``starts`` and ``neighbours`` are
    those of :func:`_list_neighbours`.
    """
    n = len(is_moving)
    order = np.empty(n, np.int64)
    place = np.full(n, -1)
    count = 0
    for ball in range(n):
        if is_moving[ball] and place[ball] < 0:
            # a search from any ball ends at an end of the cluster; the second search starts there
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
    """Return how the lower triangle of the matrix of all clusters is stored: ``first`` (rows,),
    ``row_starts`` (rows,) and the number of entries.

    Ball ``order[e]`` has the ``d`` rows from ``d * e`` on. Each row is stored from column
    ``first[row]`` to the diagonal. This column is the first one of the ball itself or, if that is
    earlier, of a neighbour. The entry of a column has the index ``row_starts[row] + column`` among
    all entries. ``starts`` and ``neighbours`` are those of :func:`_list_neighbours`, ``order`` and
    ``place`` those of :func:`_order_clusters`.
    """
    size = d * len(order)
    first = np.empty(size, np.int64)
    row_starts = np.empty(size, np.int64)
    length = 0
    for entry in range(len(order)):
        earliest = entry
        ball = order[entry]
        for index in range(starts[ball], starts[ball + 1]):
            earliest = min(earliest, place[neighbours[index]])
        for axis in range(d):
            row = d * entry + axis
            first[row] = d * earliest
            row_starts[row] = length - first[row]
            length += row + 1 - first[row]
    return first, row_starts, length


@compiled
def _add_contacts(
    contacts: Springs,
    place: NDArray[np.int64],
    row_starts: NDArray[np.int64],
    values: Array,
    d: int,
) -> None:
    """Add the stiffness matrix of each closed contact, ``along`` nn + ``across`` (1 - nn) with its
    normal n, to the entries ``values`` of the lower triangle.

    ``place`` (n,) is that of :func:`_order_clusters`, ``row_starts`` (rows,) that of
    :func:`_lay_rows`, and ``d`` the number of axes. A body without a place does not move: the
    contact then adds only the block of its other body. A contact of a ball with its own image
    resists no motion of the ball, and adds nothing.
    """
    i, j, normal, along, across = contacts
    n = len(place)
    for contact in range(len(i)):
        if not along[contact] > 0.0 or i[contact] == j[contact]:
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
    """Solve the equations of a symmetric positive definite matrix by its factors L D L^T.

    ``solution`` (rows,) holds the right side before and the solution after. ``values`` hold the
    lower triangle before and L, without its diagonal of ones, after; ``first`` and ``row_starts``
    (rows,) are those of :func:`_lay_rows`.
    """
    size = len(first)
    diagonal = np.empty(size)
    # row by row: the entries of L D, then those of L, and L^-1 times the right side
    for row in range(size):
        row_start = row_starts[row]
        begin = first[row]
        for column in range(begin, row):
            low = max(begin, first[column])
            products = _multiply_stretches(
                values, row_start + low, row_starts[column] + low, column - low
            )
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
    # L^-T times what D^-1 L^-1 makes of the right side
    for row in range(size - 1, -1, -1):
        for column in range(first[row], row):
            solution[column] -= values[row_starts[row] + column] * solution[row]


@compiled
def find_cluster_steps(
    contacts: Springs, grounds: Array, is_moving: Flags, forces: Array, steps: Array
) -> None:
    """Set ``steps`` (n, d) to the displacements of balls that ``forces`` (n, d) cause: the steps of
    Newton's method. Balls where ``is_moving`` (n,) is false stay, unless a closed contact joins
    them to a cluster of balls that move.

    Parameters
    ----------
    contacts : the contacts.
    grounds : (n,) stiffnesses, above zero, of springs that hold balls to the ground.
    is_moving : (n,) whether each ball moves.
    forces, steps : (n, d) forces on balls, and displacements, set.
    """
    n, d = forces.shape
    steps[:] = 0.0
    starts, neighbours = _list_neighbours(contacts, n)
    order, place = _order_clusters(starts, neighbours, is_moving)
    first, row_starts, length = _lay_rows(starts, neighbours, order, place, d)
    values = np.zeros(length)
    solution = np.empty(len(first))
    for entry in range(len(order)):
        ball = order[entry]
        for axis in range(d):
            row = d * entry + axis
            values[row_starts[row] + row] = grounds[ball]
            solution[row] = forces[ball, axis]
    _add_contacts(contacts, place, row_starts, values, d)
    _solve(first, row_starts, values, solution)
    for entry in range(len(order)):
        for axis in range(d):
            steps[order[entry], axis] = solution[d * entry + axis]


@compiled
def measure_slopes(
    contacts: Pushes,
    load: Array,
    steps: Array,
    group: NDArray[np.int64],
    work: Array,
    fall_rate: Array,
) -> None:
    """Set ``work`` (groups,) to the work of the forces ``load`` (n, d) on balls and of the forces
    of contacts per unit of the length of each group's step, and ``fall_rate`` (groups,) to the
    rate at which ``work`` falls with the length.

    A ball moves by the length of its group's step times ``steps`` (n, d); ``group`` (n,) is the
    number of the group of each ball. A contact with a force or a stiffness must have a ball, and
    two balls of it must be in one group. The rate leaves out that directions change.
    """
    i, j, current, distance, force, stiffness = contacts
    n, d = steps.shape
    work[:] = 0.0
    fall_rate[:] = 0.0
    for ball in range(n):
        for axis in range(d):
            work[group[ball]] += load[ball, axis] * steps[ball, axis]
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
        fall_rate[group[min(first, second)]] += stiffness[contact] * (ahead - behind) ** 2


@compiled
def choose_lengths(
    work: Array, fall_rate: Array, first: Array, exponent: float, slope: float, lengths: Lengths
) -> bool:
    """Set the length of the step that each group tries next; return whether all groups are done.

    Groups that are done before are left as they are.

    Parameters
    ----------
    work, fall_rate : (groups,) work at the present length, and the rate at which it falls with the
        length: those of :func:`measure_slopes`.
    first : (groups,) work at length zero, zero or above.
    exponent : exponent of the force of a contact as a function of its overlap. If a single contact
        closes as the step grows, the work is first - c (length - closing length)^exponent: where
        the work is below zero, the root of this function is the next trial.
    slope : a group is done if the magnitude of its work is at most ``slope`` times ``first``.
    lengths : the search. ``length`` is set to the next lengths, ``low`` and ``high`` are narrowed,
        and ``is_done`` is set to true where a group is done by ``slope``, or where its work is not
        below zero and no trial of the group has gone too far: its energy still falls at the present
        length.
    """
    length, low, high, is_done = lengths
    all_done = True
    for group in range(len(work)):
        if is_done[group]:
            continue
        trial = length[group]
        if work[group] > 0.0:
            low[group] = trial
        elif work[group] < 0.0:
            high[group] = trial
        has_end = high[group] < np.inf
        if abs(work[group]) <= slope * first[group] or not (work[group] < 0.0 or has_end):
            is_done[group] = True
            continue
        all_done = False
        if not fall_rate[group] > 0.0:
            # the work does not change here, and tells nothing about the root: the next trial is as
            # near to this one as the interval allows
            root = trial
        elif work[group] < 0.0:
            # beyond the root Newton's step would be too short: the root of the power instead
            fall = first[group] - work[group]
            excess = exponent * fall * (1.0 - (first[group] / fall) ** (1.0 / exponent))
            root = trial - excess / fall_rate[group]
        else:
            root = trial + work[group] / fall_rate[group]  # Newton's step
        # a trial stays a tenth of the interval away from either end, so that each trial narrows the
        # interval by at least a tenth
        least = 0.9 * low[group] + 0.1 * high[group]
        most = 0.1 * low[group] + 0.9 * high[group]
        length[group] = min(max(root, least), most)
    return all_done
