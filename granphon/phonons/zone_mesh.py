"""Meshes of wave vectors over the Brillouin zone, and numbers of modes below a frequency.

The mesh is cut into simplices (segments, triangles, tetrahedra). In each the frequency of a branch
is interpolated linearly between the p + 1 corners, and so is the weight with which its modes are
counted, such as their rotational fraction. The weight at corner i then contributes the fraction
F(omega)/(p + 1) of itself to the count below omega. F is the distribution function of the B-spline
whose knots t are the frequencies of the corners, with that of corner i twice (H. B. Curry and I. J.
Schoenberg, J. d'Analyse Math. 17, 71, 1966). Like the spline it has a recursion without differences
of near-equal numbers, which starts from steps F_kk, zero below omega = t_k and one from there on:

    F_kl = ((omega - t_k) F_k,l-1 + (t_l - omega) F_k+1,l) / (t_l - t_k)
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Callable
from functools import partial
from typing import NamedTuple

import numpy as np
from ase import Atoms

from granphon.base.arrays import Array, Index
from granphon.base.errors import needing

#: number of simplices about points of the mesh, times frequencies, that are held in memory at a
#: time
_BATCH_SIZE = 2**20
#: width that stands for that between equal knots, far below any frequency that is not zero
_LEAST_WIDTH = 1e-200
#: distance, in diameters, up to which balls are at one position
_POSITION_TOLERANCE = 1e-5
#: relative difference of numbers that are equal but for rounding
_ROUNDING = 1e-10
#: wave vector without symmetry, fractions of the reciprocal cell, at whose images frequencies are
#: compared
_PROBE = np.array([0.1234, 0.2871, 0.3917])


def list_half_mesh(numbers: tuple[int, ...]) -> Array:
    """Return wave vectors (n_q, p), fractions of the reciprocal cell, of a mesh that contains Gamma
    and has ``numbers`` (p,) of points along the axes. Of most points q and -q, which have the same
    frequencies, one is left out: along the first axis the mesh ends at 1/2.
    """
    axes = [np.arange(number) / number for number in numbers]
    axes[0] = axes[0][: numbers[0] // 2 + 1]
    return np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1).reshape(-1, len(numbers))


class ZoneMesh(NamedTuple):
    """A mesh of wave vectors that contains Gamma, reduced by symmetry to irreducible points."""

    #: (p,) numbers of points of the mesh along the reciprocal vectors
    numbers: tuple[int, ...]
    #: (N,) number of the irreducible point that is equivalent to each of the N points of the mesh,
    #: whose coordinate along the first axis changes fastest
    irreducible: Index
    #: (n, p) irreducible points, fractions of the reciprocal cell
    qpoints: Array
    #: (n,) number of points of the mesh that are equivalent to each irreducible point
    weights: Index

    @classmethod
    def of(cls, numbers: tuple[int, ...], group: Index | None = None) -> ZoneMesh:
        """Return the mesh of these ``numbers`` (p,) of points, reduced by the rotations ``group``
        (g, p, p) of :func:`find_point_group` and by time reversal.

        The mesh is not reduced without a group, and if a rotation mixes axes with different numbers
        of points.
        """
        count = np.array(numbers)
        rotations = np.eye(len(numbers), dtype=int)[None]
        if group is not None:
            # entries of rotations between axes with different numbers of points
            mixing = group[:, count[:, None] != count]
            if not np.any(mixing):
                rotations = np.unique(np.concatenate([group, -group]), axis=0)
        # (p, N) coordinates of all N points, in steps of the mesh
        addresses = np.stack(np.unravel_index(np.arange(count.prod()), numbers, order="F"))
        # each point is represented by the one of its images that has the lowest number
        lowest = np.arange(count.prod())
        for rotation in rotations:
            image = rotation.T @ addresses % count[:, None]
            lowest = np.minimum(lowest, np.ravel_multi_index(tuple(image), numbers, order="F"))
        points, irreducible, weights = np.unique(lowest, return_inverse=True, return_counts=True)
        # fractions from -1/2 to 1/2
        is_upper = 2 * addresses[:, points] > count[:, None]
        centred = addresses[:, points] - count[:, None] * is_upper
        return cls(numbers, irreducible, (centred / count[:, None]).T, weights)

    def count_modes(
        self, reciprocal: Array, frequencies: Array, parts: Array, limits: Array
    ) -> Array:
        """Return the weighted number of modes per cell below each limit, (n_parts, n_limits), by
        the linear tetrahedron method.

        Parameters
        ----------
        reciprocal : (p, p) reciprocal vectors as rows; each cell of the mesh is cut along its
            shortest diagonal.
        frequencies : (n_q, n_branches), at the irreducible points.
        parts : (n_parts, n_q, n_branches), the weights with which each mode is counted, in each of
            n_parts counts.
        limits : (n_limits,), ascending, in the unit of the frequencies.
        """
        p = len(self.numbers)
        numbers = np.array(self.numbers)
        simplices = self._cut_cell(reciprocal)
        # a point belongs to p + 1 times as many simplices, as it may be any of their corners:
        # (n_steps, p + 1, p) steps from the point to their corners, and (n_steps,) the number of
        # the corner that is the point itself
        steps = np.concatenate([simplices - simplices[:, [corner]] for corner in range(p + 1)])
        corner_of_point = np.repeat(np.arange(p + 1), len(simplices))
        stride = np.concatenate([[1], np.cumprod(numbers[:-1])])
        addresses = np.rint(self.qpoints * numbers).astype(int)
        share = parts * self.weights[:, None] / (numbers.prod() * len(steps))
        counts = np.zeros((len(parts), len(limits) + 1))
        n_batches = math.ceil(len(addresses) * len(steps) * len(limits) / _BATCH_SIZE)
        for points in np.array_split(np.arange(len(addresses)), n_batches):
            corner_addresses = (addresses[points, None, None] + steps) % numbers
            corners = self.irreducible[corner_addresses @ stride]  # (n, n_steps, p + 1)
            point_itself = corners[:, np.arange(len(steps)), corner_of_point, None]
            # knots (n, n_steps, p + 2): those of all corners, and that of the point once more
            knot_points = np.concatenate([corners, point_itself], axis=2)
            for branch in range(frequencies.shape[1]):
                knots = np.sort(frequencies[knot_points, branch].reshape(-1, p + 2), axis=1)
                weights = np.repeat(share[:, points, branch], len(steps), axis=1)
                _add_counts(counts, limits, knots, weights)
        return counts[:, :-1]

    def _cut_cell(self, reciprocal: Array) -> Index:
        """Return the corners (p!, p + 1, p), in steps of the mesh, of the simplices into which a
        cell of the mesh is cut, all of them about its shortest diagonal.

        ``reciprocal`` (p, p) are the reciprocal vectors as rows.
        """
        p = len(self.numbers)
        numbers = np.array(self.numbers)
        # the diagonals, as signs (n, p) of the edges of the cell; the first of the shortest is used
        senses = np.array([np.ones(p), *(np.ones((p, p)) - 2.0 * np.eye(p))])
        lengths = np.linalg.norm(senses @ (reciprocal / numbers[:, None]), axis=1)
        is_shortest = lengths <= (1.0 + _ROUNDING) * lengths.min()
        sense = senses[np.argmax(is_shortest)].astype(int)
        # the corners of a simplex lie on a way along the edges of the cell, from one end of the
        # diagonal to the other; there is one simplex for each order of the axes
        axes = np.eye(p, dtype=int)
        edges = []
        for order in itertools.permutations(range(p)):
            edges.append([np.zeros(p, int), *axes[list(order)]])
        return np.asarray(np.cumsum(edges, axis=1) * sense)


def _add_counts(counts: Array, limits: Array, knots: Array, weights: Array) -> None:
    """Add to ``counts`` (n_parts, n_limits + 1), in place, the integrals of n B-splines up to each
    of the ``limits`` (n_limits,), times their ``weights`` (n_parts, n).

    The whole integral of a spline is one, and its ``knots`` (n, m) are ascending. The last column
    of ``counts`` is for splines that end above all limits.
    """
    # numbers (n,) of the limits below the first knot and below the last knot of each spline: all of
    # the spline is below the limits from the second number on, and the limits between the knots are
    # counted one by one
    n_below_first = np.searchsorted(limits, knots[:, 0])
    n_below_last = np.searchsorted(limits, knots[:, -1])
    n_between = n_below_last - n_below_first
    # pairs of a spline and a limit between its knots, spline after spline
    spline = np.repeat(np.arange(len(knots)), n_between)
    # the limits of the pairs of a spline have the numbers from n_below_first on, which are those of
    # the pairs less an offset
    offset = np.repeat(np.cumsum(n_between) - n_below_last, n_between)
    limit = np.arange(len(spline)) - offset
    part_below = _integrate_splines(limits[limit], knots[spline].T)
    for count, weight in zip(counts, weights, strict=True):
        count += np.cumsum(np.bincount(n_below_last, weight, len(count)))
        count += np.bincount(limit, weight[spline] * part_below, len(count))


def _integrate_splines(x: Array, knots: Array) -> Array:
    """Return the integrals (n,) up to ``x`` (n,) of n B-splines whose whole integral is one, by the
    recursion at the head of this module; ``knots`` (m, n) are ascending.
    """
    below = [(x >= knot).astype(float) for knot in knots]
    for degree in range(1, len(knots)):
        for k in range(len(knots) - degree):
            # between equal knots the spline is a step
            width = np.maximum(knots[k + degree] - knots[k], _LEAST_WIDTH)
            weight = np.clip((x - knots[k]) / width, 0.0, 1.0)
            below[k] = below[k + 1] + weight * (below[k] - below[k + 1])
    return np.asarray(below[0], float)


def find_point_group(
    atoms: Atoms, periods: int, frequencies: Callable[[Array], Array]
) -> Index | None:
    """Return rotations (g, p, p) that leave the frequencies unchanged and act on fractions q (p,)
    as q @ rotation; None if they are not known. On a line only the identity is returned.

    The rotations are those of the layer or space group of the ``atoms``, as spglib finds it.
    Spglib knows the positions and masses of the balls, but not the stiffness of contacts. So the
    frequencies are compared at all images of one wave vector; if they differ, None is returned.
    ``frequencies`` is a function that takes wave vectors (n, ``periods``), fractions, and returns
    (n, n_branches). On a line spglib is not needed. Elsewhere spglib raises its errors from this
    call on, in the whole process.
    """
    if periods == 1:
        return np.ones((1, 1, 1), int)
    with needing("A mesh that is reduced by symmetry"):
        import spglib
    spglib.error.OLD_ERROR_HANDLING = False  # as phonopy and ASE set it
    scalars = [atoms.get_masses(), atoms.arrays.get("diameter_deviations", np.zeros(len(atoms)))]
    _, kinds = np.unique(np.stack(scalars), axis=1, return_inverse=True)
    cell = (np.asarray(atoms.cell), atoms.get_scaled_positions(wrap=True), kinds.ravel() + 1)
    find_dataset = spglib.get_symmetry_dataset
    if periods == 2:
        find_dataset = partial(spglib.get_symmetry_layerdataset, aperiodic_dir=2)
    try:
        dataset = find_dataset(cell, symprec=_POSITION_TOLERANCE)
    except spglib.SpglibError:
        return None
    if dataset is None:
        return None
    rotations = np.unique(dataset.rotations[:, :periods, :periods], axis=0)
    at_images = frequencies(_PROBE[:periods] @ rotations)
    are_equal = np.ptp(at_images, axis=0).max() <= _ROUNDING * at_images.max()
    return rotations if are_equal else None
