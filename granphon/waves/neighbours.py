"""Balls that are near each other: pairs whose surfaces are closer than a margin, in any cell."""

from __future__ import annotations

import itertools

import numpy as np

from granphon.base.arrays import Array, Index


def find_neighbours(places: Array, radii: Array, periods: Array, margin: float) -> tuple[Index, Index, Index]:
    """Return i, j (m,) and the cells (m, p) by which ball j is displaced, of pairs with a gap below ``margin``.

    ``places`` (n, 3) may lie outside of the cell, whose vectors ``periods`` (p, 3) repeat. Pairs across the boundary
    are listed twice. i <= j.
    """
    from scipy.spatial import cKDTree

    p, reach = len(periods), 2.0 * float(np.max(radii)) + margin
    home = np.zeros((len(places), p), np.intp)
    if p:
        inverse = np.linalg.pinv(periods)  # (3, p)
        home = np.floor(places @ inverse).astype(np.intp)
        places = places - home @ periods
        steps = np.ceil(reach * np.linalg.norm(inverse, axis=0)).astype(int)  # reach over the width of the cell
    all_places, owner, cell = [places], [np.arange(len(places))], [np.zeros((len(places), p), np.intp)]
    low, high = places.min(axis=0) - reach, places.max(axis=0) + reach
    for shift in itertools.product(*(range(-steps[axis], steps[axis] + 1) for axis in range(p))):
        if any(shift):
            image = places + np.array(shift) @ periods
            inside = np.flatnonzero(np.all((image > low) & (image < high), axis=1))
            all_places.append(image[inside])
            owner.append(inside)
            cell.append(np.tile(np.array(shift, np.intp), (len(inside), 1)))
    points, ball, image_of = np.concatenate(all_places), np.concatenate(owner), np.concatenate(cell)
    pairs = cKDTree(points).query_pairs(reach, output_type="ndarray")
    pairs = pairs[pairs[:, 0] < len(places)]  # the first ball in the cell
    one, other = pairs.T
    gap = np.linalg.norm(points[other] - points[one], axis=1) - radii[ball[one]] - radii[ball[other]]
    one, other = one[gap < margin], other[gap < margin]
    i, j, shift_of = ball[one], ball[other], image_of[other] + home[ball[one]] - home[ball[other]]
    return orient(i, j, shift_of)


def leave_out(rows: Index, known: Index) -> Index:
    """Return the ``rows`` (m, k) that are not among those ``known``, each once, in ascending order."""
    both = np.concatenate([known, rows])
    order = np.lexsort(both.T[::-1])  # of equal ones the known stay in front
    both = both[order]
    new = np.append(True, np.any(both[1:] != both[:-1], axis=1)) & (order >= len(known))
    return both[new]


def orient(i: Index, j: Index, shift: Index) -> tuple[Index, Index, Index]:
    """Return pairs from their lower ball, or along the first axis of an image of the same ball."""
    leading = np.zeros(len(i), np.intp)
    for axis in reversed(range(shift.shape[1])):
        leading = np.where(shift[:, axis] != 0, shift[:, axis], leading)
    turned = (i > j) | ((i == j) & (leading < 0))
    return np.where(turned, j, i), np.where(turned, i, j), np.where(turned[:, None], -shift, shift)
