"""The lowest modes of networks that are too large to be factorised, also at a wave vector.

A block of vectors is improved by iterations until it holds the lowest modes
(:mod:`granphon.dynamics.lowest_modes`). Some fifty iterations are enough, owing to a preconditioner
with two levels, each ball alone and boxes of balls (:mod:`granphon.dynamics.two_levels`).
"""

from __future__ import annotations

from typing import Any

import numpy as np

from granphon.base.arrays import Array
from granphon.dynamics.deformation_rows import find_gyration
from granphon.dynamics.lowest_modes import LowestModes, LowestSearch
from granphon.dynamics.two_levels import BallFrame, TwoLevels, compose_boxes
from granphon.waves.operator import WaveOperator

#: largest |D x - omega^2 x| / top^2 of a mode x of norm one; the error of omega^2 is the square of
#: this residual over the distance of other modes
RESIDUAL = 1e-8
#: iterations of the block: measured with packings of 1e4 and 1e5 balls in space
_ITERATIONS = 50.0
#: time of an iteration for each vector of the block, its sums included, over that of a product of D
#: with a vector; measured with the same packings
_PRODUCTS_OF_ITERATION = 10.0
#: memory at its peak, in copies of the block: vectors, their images, both for the space of an
#: iteration, and the matrices of the preconditioner; measured with the same packings
_COPIES = 22.0


def estimate_lowest(operator: WaveOperator, block_size: int) -> tuple[float, float]:
    """Return an estimate of what the lowest modes take by a block of ``block_size`` vectors: a
    number of products of D with a vector, and bytes.
    """
    products = _ITERATIONS * _PRODUCTS_OF_ITERATION * block_size
    return products, 8.0 * _COPIES * operator.size * block_size


def find_lowest(
    operator: WaveOperator,
    matrix: Any,
    count: int,
    known_modes: Any = None,
    q: Array | None = None,
) -> LowestModes:
    """Return the ``count`` lowest eigenvalues, (rad/s)^2, of a sparse ``matrix`` (size, size), and
    their vectors, in the order of motions of the ``operator``, with the norms of their residuals.

    The matrix is D, or with a wave vector ``q`` (p,), in fractions, D of waves. ``known_modes``
    (size, k) is a sparse array of orthonormal eigenvectors that are known already: all others are
    sought, orthogonal to these. If it is None, none is known. The progress of the ``operator`` is
    told how far the search has come. Raises :class:`~granphon.base.errors.ConvergenceError` if the
    modes are not found.
    """
    # the preconditioner takes motions ball by ball; the operator of an array orders them by fields
    order = operator.indices[operator.balls].ravel()
    is_by_balls = bool(np.all(np.diff(order) == 1))
    by_balls = matrix if is_by_balls else matrix[order][:, order]
    known_by_balls = None if known_modes is None else known_modes.tocsr()[order]
    boxes = compose_boxes(_describe_balls(operator), q)
    precondition = TwoLevels(by_balls, operator.motions.count, boxes)
    tolerance = RESIDUAL * operator.top**2
    search = LowestSearch(by_balls, precondition, tolerance, known_by_balls, operator.progress)
    modes = search.find(count)
    vectors = np.empty_like(modes.vectors)
    vectors[order] = modes.vectors
    return modes._replace(vectors=vectors)


def _describe_balls(operator: WaveOperator) -> BallFrame:
    """Return the places, masses, gyration and motions of the balls that move, and the periods and
    mean radius, for the division into boxes.
    """
    network = operator.network
    balls = operator.balls
    return BallFrame(
        network.positions[balls],
        network.cell[np.flatnonzero(network.pbc)],
        float(np.mean(network.radii[balls])),
        network.masses[balls],
        find_gyration(network)[balls],
        operator.motions,
    )
