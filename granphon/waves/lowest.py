"""The lowest modes of networks that are too large to be factorised, also at a wave vector.

A block of vectors is improved turn by turn until it holds the lowest modes
(:mod:`granphon.dynamics.lowest_modes`). Some fifty turns are enough, owing to a preconditioner with
two levels, each ball alone and boxes of balls (:mod:`granphon.dynamics.two_levels`).
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
#: turns of the block, and the time that a turn takes, its sums included, in products of D with a
#: vector for each vector of the block: measured with packings of 1e4 and 1e5 balls in space
_TURNS = 50.0
_PRODUCTS_OF_TURN = 10.0
#: memory at its peak, in copies of the block: vectors, their images, both for the space of a turn,
#: and the matrices of the preconditioner; measured with the same packings
_COPIES = 22.0


def estimate_lowest(operator: WaveOperator, together: int) -> tuple[float, float]:
    """Return an estimate of what the lowest modes take by a block of ``together`` vectors: a number
    of products of D with a vector, and bytes.
    """
    products = _TURNS * _PRODUCTS_OF_TURN * together
    return products, 8.0 * _COPIES * operator.size * together


def find_lowest(
    operator: WaveOperator, matrix: Any, count: int, known: Any = None, q: Array | None = None
) -> LowestModes:
    """Return the ``count`` lowest eigenvalues, (rad/s)^2, of a sparse ``matrix`` (size, size), and
    their vectors, in the order of motions of the ``operator``.

    The matrix is D, or with a wave vector ``q`` (p,), in fractions, D of waves. ``known`` (size, k)
    is a sparse array of orthonormal vectors whose eigenvalues are known; modes are sought among
    vectors orthogonal to these. Raises :class:`~granphon.base.errors.ConvergenceError` if the modes
    are not found.
    """
    # the preconditioner takes motions ball by ball; the operator of an array orders them by fields
    order = operator.indices[operator.balls].ravel()
    is_by_balls = bool(np.all(np.diff(order) == 1))
    by_balls = matrix if is_by_balls else matrix[order][:, order]
    known_by_balls = None if known is None else known.tocsr()[order]
    boxes = compose_boxes(_describe_balls(operator), q)
    precondition = TwoLevels(by_balls, operator.motions.count, boxes)
    tolerance = RESIDUAL * operator.top**2
    search = LowestSearch(by_balls, precondition, tolerance, known_by_balls, operator.progress)
    found = search.find(count)
    vectors = np.empty_like(found.vectors)
    vectors[order] = found.vectors
    return found._replace(vectors=vectors)


def _describe_balls(operator: WaveOperator) -> BallFrame:
    """Return the places, masses, gyration and motions of the balls that move."""
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
