"""A preconditioner for the stiffness of 1e4 balls and more: each ball alone, and boxes of balls
that move as rigid bodies.

In a first step each ball moves alone, by the inverse of its own block of the stiffness. That
removes the part of a residual that changes from ball to ball, and leaves a smooth part. In a second
step boxes of some twenty balls follow the smooth part. Each box has the motions of a rigid body,
smoothed by one step of single balls. The matrix of the boxes is small and is factorised. A third
step, of single balls again, makes the preconditioner symmetric. This is smoothed aggregation with
two levels (P. Vanek, J. Mandel and M. Brezina, Computing 56, 179, 1996).
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from granphon.balls.motions import Motions
from granphon.base.arrays import Array, Index
from granphon.dynamics.factors import factorise
from granphon.dynamics.linalg import NO_ENERGY

#: number of balls in a box: half as many make the matrix of the boxes ten times as dear, and save a
#: tenth of the iterations
_BALLS_PER_BOX = 20.0
#: largest number of boxes whose factors take a gigabyte, by the number of axes along which boxes
#: follow each other
_MOST_BOXES = {1: 50_000, 2: 20_000, 3: 5_000}
#: thickness, in mean radii, above which balls are taken to lie in more than one layer: a layer of
#: equal balls is two radii thick, and two close-packed layers are 3.63
_SINGLE_LAYER = 3.0
#: eigenvalue of the products of the motions of a box, over the largest, up to which these motions
#: are dependent
_DEPENDENCE = 1e-6
#: bound of the eigenvalues of a stiffness, over its blocks of single balls: the energy of a contact
#: is at most twice the sum of its energies with one ball moving at a time
_BOUND = 2.0
#: length of the steps of single balls before and after that of the boxes, over 1/_BOUND
_STEP = 1.5
#: length of the step that smooths the motions of boxes, over 1/_BOUND (Vanek et al.)
_SMOOTHING = 4.0 / 3.0
#: multiple of the unit matrix, over the largest entry of the diagonal of the stiffness, that is
#: added to the matrix of the boxes, which is singular if balls are free to move together
_SHIFT = 1e-6


class BallFrame(NamedTuple):
    """Where balls are, and what they weigh, in any units.

    Attributes
    ----------
    positions : (n, 3) centres.
    cell : (p, 3) periods, as rows.
    radius : mean radius of the balls.
    masses : (n,) masses.
    gyration : (n,) radii of gyration.
    motions : motions of each ball.
    """

    positions: Array
    cell: Array
    radius: float
    masses: Array
    gyration: Array
    motions: Motions


class _Boxes(NamedTuple):
    """The division of balls into boxes.

    Attributes
    ----------
    box : (n,) number of the box of each ball.
    n_boxes : number of boxes.
    vector : (n, 3) vector from the middle of its box to each ball.
    cells : (n, p) numbers of periods by which each ball was moved into its box.
    side : typical length of the sides of boxes.
    """

    box: Index
    n_boxes: int
    vector: Array
    cells: Array
    side: float


def _find_boxes(frame: BallFrame) -> _Boxes:
    """Return the boxes of the balls of a ``frame``, of about :data:`_BALLS_PER_BOX` balls each, or
    of more balls if there would be more than :data:`_MOST_BOXES` boxes.

    Boxes divide the period evenly along axes with a period, and along the others the extent of the
    balls, from a mean radius below the lowest centre to one above the highest.
    """
    n = len(frame.positions)
    p = len(frame.cell)
    axes = _complete_axes(frame.cell)
    # coordinates (n, 3) of the balls along these axes, within the cell along the periods
    coordinates = frame.positions @ np.linalg.inv(axes)
    cells = -np.floor(coordinates[:, :p])
    coordinates[:, :p] += cells
    lengths = np.linalg.norm(axes, axis=1)
    has_period = np.arange(3) < p
    # where the boxes begin, and how far they reach: one period, or the extent of the balls
    lowest_coordinates = np.where(has_period, 0.0, coordinates.min(axis=0) - frame.radius)
    extents = np.where(has_period, 1.0, np.ptp(coordinates, axis=0) + 2.0 * frame.radius)
    sides = extents * lengths
    is_thick = sides > _SINGLE_LAYER * frame.radius
    # a single ball is thick along no axis, and counts as a line
    dimension = max(int(np.count_nonzero(is_thick)), 1)
    balls_per_box = max(_BALLS_PER_BOX, n / _MOST_BOXES[dimension])
    side = _find_side(sides, n / balls_per_box)
    # numbers (3,) of boxes along the axes, and the indices (n, 3) of the box of each ball
    numbers = np.maximum(np.rint(sides / side), 1.0)
    indices = np.floor((coordinates - lowest_coordinates) / extents * numbers)
    indices = np.clip(indices, 0.0, numbers - 1.0)
    middles = lowest_coordinates + (indices + 0.5) / numbers * extents
    keys = np.ravel_multi_index(
        tuple(indices.astype(np.intp).T), tuple(int(number) for number in numbers)
    )
    # boxes without balls are left out
    occupied_keys, box = np.unique(keys, return_inverse=True)
    return _Boxes(box, len(occupied_keys), (coordinates - middles) @ axes, cells, side)


def _complete_axes(cell: Array) -> Array:
    """Return three axes (3, 3), as rows: the periods of a ``cell`` (p, 3), and unit vectors
    perpendicular to all of them.
    """
    if not len(cell):
        return np.eye(3)
    _, _, directions = np.linalg.svd(cell, full_matrices=True)
    return np.concatenate([cell, directions[len(cell) :]])


def _find_side(lengths: Array, count: float) -> float:
    """Return the side of about ``count`` cubes that fill a cuboid with sides of ``lengths`` (3,).

    If the cuboid is thinner than the cubes along its shortest axes, these axes are not divided, and
    cubes fill a rectangle or a line.
    """
    side = 0.0
    for dimension in (3, 2, 1):
        longest_sides = np.sort(lengths)[3 - dimension :]
        side = float(np.prod(longest_sides) / count) ** (1.0 / dimension)
        if side <= float(longest_sides[0]):
            break
    return side


def compose_boxes(frame: BallFrame, q: Array | None = None) -> Any:
    """Return orthonormal, mass-weighted motions (n * motions, m) of the balls of a ``frame``, as
    columns of a matrix sparse by rows: in each a box of balls moves as a rigid body.

    With a wave vector ``q`` (p,), in fractions of the reciprocal cell, the balls of a box that were
    moved by periods have the phases of these periods.
    """
    from scipy.sparse import bsr_array

    boxes = _find_boxes(frame)
    motions = frame.motions
    n = len(boxes.box)
    # of the six motions of a ball in space those that balls have
    columns = [*motions.translations, *(3 + axis for axis in motions.rotations)]
    roots = np.sqrt(frame.masses)[:, None]
    # motions of each ball, u and w, in the six motions of its box as a rigid body. A rotation of a
    # box is about its middle, and counted as the angle times the side of a box
    effects = np.zeros((n, 6, 6))  # ball, its motion, motion of the box
    for axis, along in enumerate(np.eye(3)):
        effects[:, axis, axis] = roots[:, 0]
        effects[:, :3, 3 + axis] = roots * np.cross(along, boxes.vector) / boxes.side
        effects[:, 3 + axis, 3 + axis] = roots[:, 0] * frame.gyration / boxes.side
    effects = effects[:, columns]
    # combinations of the six that are independent are made orthonormal, box by box: products are
    # the sums over the balls n of a box, and over the motions k of each ball
    products = np.zeros((boxes.n_boxes, 6, 6))
    np.add.at(products, boxes.box, np.einsum("nki,nkj->nij", effects, effects))
    squares, vectors = np.linalg.eigh(products)
    is_motion = squares > _DEPENDENCE * squares[:, -1:]
    scale = np.divide(1.0, np.sqrt(np.abs(squares)), out=np.zeros_like(squares), where=is_motion)
    weights = vectors * scale[:, None, :]
    blocks = effects @ weights[boxes.box]  # (n, motions, 6)
    if q is not None:
        phase = np.exp(-2.0j * np.pi * (boxes.cells @ q))
        blocks = blocks * phase[:, None, None]
    shape = (n * motions.count, 6 * boxes.n_boxes)
    all_columns = bsr_array((blocks, boxes.box, np.arange(n + 1)), shape=shape).tocsc()
    return all_columns[:, np.flatnonzero(is_motion.ravel())].tocsr()


class TwoLevels:
    """An approximate inverse of a sparse Hermitian ``matrix`` (n * ``count``, n * ``count``)
    without negative eigenvalues; calling it multiplies vectors by this inverse.

    ``count`` is the number of motions of a ball, and ``box_motions`` are those that
    :func:`compose_boxes` returns.

    Attributes
    ----------
    ball_inverses : the inverse of the blocks of single balls, sparse.
    """

    def __init__(self, matrix: Any, count: int, box_motions: Any) -> None:
        """Invert the blocks of single balls, smooth the motions of boxes, and factorise the matrix
        of the boxes.
        """
        from scipy.sparse import eye_array

        self._matrix = matrix
        self.ball_inverses, _ = invert_blocks(matrix, count)
        self._step = (_STEP / _BOUND) * self.ball_inverses
        smoothing = self.ball_inverses @ (matrix @ box_motions)
        self._box_motions: Any = (box_motions - (_SMOOTHING / _BOUND) * smoothing).tocsr()
        self._to_boxes: Any = self._box_motions.conj().T.tocsr()
        box_matrix = (self._to_boxes @ (matrix @ self._box_motions)).tocsr()
        shift = _SHIFT * float(np.max(matrix.diagonal().real))
        shifted_matrix = box_matrix + shift * eye_array(box_matrix.shape[0])
        self._is_complex = np.iscomplexobj(shifted_matrix.data)
        self._factors = factorise(
            _make_real(shifted_matrix) if self._is_complex else shifted_matrix
        )

    def __call__(self, residual: NDArray[Any]) -> NDArray[Any]:
        """Return the approximate inverse times the ``residual`` (n * count, m)."""
        # single balls, then boxes, then single balls again
        motions = self._step @ residual
        forces_on_boxes = self._to_boxes @ (residual - self._matrix @ motions)
        motions += self._box_motions @ self._solve(forces_on_boxes)
        return np.asarray(motions + self._step @ (residual - self._matrix @ motions))

    def _solve(self, right: NDArray[Any]) -> NDArray[Any]:
        """Return the motions (k, m) of the boxes under the forces ``right`` (k, m) on them."""
        if not self._is_complex:
            return self._factors.solve(np.ascontiguousarray(right))
        solution = self._factors.solve(np.concatenate([right.real, right.imag]))
        real_part, imaginary_part = np.split(solution, 2)
        return np.asarray(real_part + 1.0j * imaginary_part)


def _make_real(matrix: Any) -> Any:
    """Return the real symmetric matrix (2 n, 2 n) that multiplies the real and the imaginary parts
    of a vector, one after the other, as a Hermitian ``matrix`` (n, n) multiplies the vector.

    The solver of symmetric matrices takes real matrices alone.
    """
    from scipy.sparse import block_array

    return block_array([[matrix.real, -matrix.imag], [matrix.imag, matrix.real]], format="csc")


def invert_blocks(matrix: Any, count: int) -> tuple[Any, Any]:
    """Return two sparse matrices: the inverse (size, size) of the diagonal blocks (``count``,
    ``count``) of single balls in a sparse Hermitian ``matrix`` (size, size), and orthonormal
    motions (size, m) of single balls that cost nothing, on which the inverse is zero.
    """
    from scipy.sparse import bsr_array, csr_array

    size = matrix.shape[0]
    n_balls = size // count
    entries = matrix.tocoo()
    is_in_block = entries.row // count == entries.col // count
    rows = entries.row[is_in_block]
    columns = entries.col[is_in_block]
    blocks = np.zeros((n_balls, count, count), entries.dtype)
    blocks[rows // count, rows % count, columns % count] = entries.data[is_in_block]
    stiffness, vectors = np.linalg.eigh(blocks)
    is_held = stiffness > NO_ENERGY * np.max(stiffness)
    inverse = np.divide(1.0, stiffness, out=np.zeros_like(stiffness), where=is_held)
    # the inverse of the block of each ball b, from its eigenvectors k
    inverses = np.einsum("bik,bk,bjk->bij", vectors, inverse, vectors.conj())
    pointers = np.arange(n_balls + 1)
    ball_inverses = bsr_array((inverses, np.arange(n_balls), pointers), shape=(size, size)).tocsr()
    balls, modes = np.nonzero(~is_held)
    lines = balls[:, None] * count + np.arange(count)
    numbers = np.broadcast_to(np.arange(len(balls))[:, None], lines.shape)
    free_motions = csr_array(
        (vectors[balls, :, modes].ravel(), (lines.ravel(), numbers.ravel())),
        shape=(size, len(balls)),
    )
    return ball_inverses, free_motions
