"""Means over the Brillouin zone of functions of q that have no limit at the points q = -q (up to a
reciprocal vector), because their value depends on the direction of approach.

Projections on the motions of a lattice are such functions: bounded, and smooth except at these
points. Their value depends on the direction at Gamma and, if balls can roll like gears, at other
points of this kind. The zone is cut into simplices that have these points as corners: two segments,
eight triangles or 48 tetrahedra about each of the 2, 4 or 8 points. Each simplex is the image of a
cube in p dimensions (Duffy's map, q = corner + s (e_1 + t (e_2 + w e_3))). The function is smooth
in the cube, so that Gauss's rule converges geometrically. Lines from one corner to another along
the axes, on which a function may depend on the direction of approach as well, are resolved too,
such as that from M to R of sc.
"""

from __future__ import annotations

import itertools
from collections.abc import Callable, Iterator, Sequence
from functools import lru_cache
from typing import NamedTuple

import numpy as np

from granphon.balls.neighbours import steps_within
from granphon.base.arrays import Array

#: fractions of a wave vector without symmetry, at which functions are compared with their images
_PROBES = np.array(
    [[0.1376, 0.2891, -0.0643], [-0.3217, 0.0811, 0.4129], [0.2239, -0.4462, 0.1783]]
)
#: relative difference up to which two values are equal but for rounding
_VALUE_ROUNDING = 1e-10


class Operation(NamedTuple):
    """A rotation or reflection that maps the zone onto itself: the new coordinate k is ``signs[k]``
    times the old coordinate ``order[k]``.

    Coordinates are fractions of :func:`shortest_vectors`.
    """

    order: tuple[int, ...]
    signs: tuple[int, ...]

    def after(self, first: Operation) -> Operation:
        """Return the operation that first acts as ``first``, and then as this operation."""
        order = tuple(first.order[axis] for axis in self.order)
        signs = tuple(
            sign * first.signs[axis] for sign, axis in zip(self.signs, self.order, strict=True)
        )
        return Operation(order, signs)


#: a simplex of the zone: a corner and an operation. Its points are corner/2 + s/4, where the
#: operation has been applied to coordinates 1 > s_1 > s_2 > ... > 0 to give s
_Simplex = tuple[tuple[int, ...], Operation]


def shortest_vectors(reciprocal: Array) -> Array:
    """Return the p shortest independent vectors (p, p), as rows, of the lattice of the
    ``reciprocal`` vectors (p, p); of equally short vectors, those of ``reciprocal`` come first.
    """
    longest_length = float(np.linalg.norm(reciprocal, axis=1).max())
    vectors = np.concatenate([reciprocal, steps_within(reciprocal, longest_length) @ reciprocal])
    # nine decimals, so that rounding does not decide among equal lengths
    lengths = np.round(np.linalg.norm(vectors, axis=1) / longest_length, 9)
    basis: list[Array] = []
    for vector in vectors[np.argsort(lengths, kind="stable")]:
        rank = np.linalg.matrix_rank(np.array([*basis, vector]), tol=1e-6 * longest_length)
        if rank > len(basis):
            basis.append(vector)
        if len(basis) == len(reciprocal):
            break
    return np.array(basis)


def find_symmetries(function: Callable[[Array], Array], reciprocal: Array) -> list[Operation]:
    """Return a group of operations that leave a ``function`` of q unchanged; they are recognised by
    its values at wave vectors without symmetry.

    ``function`` takes wave vectors (n_q, p) and returns (n_q, ...); ``reciprocal`` (p, p) are
    reciprocal vectors as rows, of any cell.
    """
    basis = shortest_vectors(reciprocal)
    operations = _list_operations(len(basis))
    fractions = _PROBES[:, : len(basis)]
    images = np.stack([fractions[:, operation.order] * operation.signs for operation in operations])
    all_values = function(images.reshape(-1, len(basis)) @ basis)
    values = all_values.reshape(len(operations), len(fractions), -1)
    # the first operation is the identity
    is_equal = np.all(
        np.abs(values - values[0]) <= _VALUE_ROUNDING * np.abs(values[0]), axis=(1, 2)
    )
    symmetries = [operations[number] for number in np.flatnonzero(is_equal)]
    group = {operations[0]}
    for symmetry in symmetries:
        if symmetry in group:
            continue
        # if a lattice is symmetric only up to rounded numbers, some products of symmetries are no
        # symmetries; one is added to the group only if all products are
        larger_group = _close_group(group | {symmetry})
        if larger_group <= set(symmetries):
            group = larger_group
    return sorted(group)


def _close_group(operations: set[Operation]) -> set[Operation]:
    """Return the group that ``operations`` generate: the operations, their products, the products
    of these, and so on.
    """
    products = {last.after(first) for last in operations for first in operations}
    return operations if products <= operations else _close_group(operations | products)


def _list_operations(periods: int) -> list[Operation]:
    """Return all changes of order and signs of ``periods`` coordinates; the first is the
    identity.
    """
    orders = itertools.permutations(range(periods))
    return [
        Operation(order, signs)
        for order in orders
        for signs in itertools.product((1, -1), repeat=periods)
    ]


@lru_cache(maxsize=64)
def _find_distinct_simplices(
    symmetries: tuple[Operation, ...], periods: int
) -> list[tuple[_Simplex, int]]:
    """Return pairs (simplex, size) for a zone in as many dimensions as ``periods``: one simplex of
    each set of simplices that the ``symmetries`` map onto each other, and the number of simplices
    in the set.
    """
    corners = itertools.product((0, 1), repeat=periods)
    simplices = itertools.product(corners, _list_operations(periods))
    # a dictionary without values, because a set would not keep the order
    unassigned_simplices: dict[_Simplex, None] = dict.fromkeys(simplices)
    distinct_simplices = []
    while unassigned_simplices:
        simplex = next(iter(unassigned_simplices))
        corner, operation = simplex
        # a change of sign takes a corner, whose coordinates are 0 or 1/2, to an equivalent one
        images = {
            (tuple(corner[axis] for axis in symmetry.order), symmetry.after(operation))
            for symmetry in symmetries
        }
        for image in images:
            del unassigned_simplices[image]
        distinct_simplices.append((simplex, len(images)))
    return distinct_simplices


def divide_zone(
    reciprocal: Array, order: int, symmetries: Sequence[Operation] | None = None
) -> Iterator[tuple[Array, Array]]:
    """Yield pairs of wave vectors (n_q, p) and weights (n_q,); the sum over all pairs of weights
    times the values of a function is its mean over the Brillouin zone.

    Parameters
    ----------
    reciprocal : (p, p) reciprocal vectors as rows, of any cell.
    order : number of points along each edge of the cube that is mapped to a simplex; two or more in
        space, where the weights of a single point would not add up to one.
    symmetries : the group of operations that leave the function unchanged; by default those of an
        even function.
    """
    basis = shortest_vectors(reciprocal)
    periods = len(basis)
    if symmetries is None:
        axes = tuple(range(periods))
        identity = Operation(axes, (1,) * periods)
        inversion = Operation(axes, (-1,) * periods)
        symmetries = [identity, inversion]
    points, gauss_weights = np.polynomial.legendre.leggauss(order)
    # (n^p, p), all combinations of points from 0 to 1, and of their weights
    cube = _combine(0.5 * points, periods) + 0.5
    gauss = _combine(0.5 * gauss_weights, periods)
    # distances s_1 > s_2 > ... from the corner along the axes; the product of all but the last is
    # the Jacobian of Duffy's map
    distances = np.cumprod(cube, axis=1)
    weights = np.prod(gauss, axis=1) * np.prod(distances[:, :-1], axis=1)
    for simplex, count in _find_distinct_simplices(tuple(symmetries), periods):
        corner, operation = simplex
        steps = distances[:, operation.order] * operation.signs
        fractions = 0.5 * np.array(corner) + 0.25 * steps
        yield fractions @ basis, weights * (count / 4.0**periods)


def _combine(numbers: Array, count: int) -> Array:
    """Return all combinations (n^count, count) of ``count`` of the ``numbers`` (n,)."""
    return np.stack(np.meshgrid(*[numbers] * count, indexing="ij"), axis=-1).reshape(-1, count)
