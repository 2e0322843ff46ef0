"""A preconditioner for the stiffness of 1e4 balls and more: each ball alone, and boxes of balls
that move as rigid bodies.

Balls that are moved alone, each by the inverse of what holds it, take away the part of a residual
that changes from ball to ball. What is left is smooth: boxes of some twenty balls follow it, each
with the motions of a rigid body, smoothed by one step of the same kind. The matrix of the boxes is
small and is factorised. This is smoothed aggregation with two levels (P. Vanek, J. Mandel and
M. Brezina, Computing 56, 179, 1996), and the steps of single balls stand before and behind the
boxes, so that the preconditioner is symmetric.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from granphon.balls.motions import Motions
from granphon.base.arrays import Array, Index
from granphon.dynamics.factors import factorise
from granphon.dynamics.linalg import NO_ENERGY

#: balls of a box: half as many make the matrix of the boxes ten times as dear, and save a tenth of
#: the iterations
_BALLS_PER_BOX = 20.0
#: most boxes, by the dimension: their factors take a gigabyte
_MOST_BOXES = {1: 50_000, 2: 20_000, 3: 5_000}
#: eigenvalue of the products of the motions of a box, over the largest, from which they differ
_DEPENDENT = 1e-6
#: bound of the eigenvalues of a stiffness over what holds each ball alone: the energy of a contact
#: is at most twice the sum of its energies with one ball moving at a time
_BOUND = 2.0
#: lengths of the steps of single balls over the inverse of that bound: before and behind the boxes,
#: and to smooth the motions of boxes, as in the paper of the head of this module
_STEP = 1.5
_SMOOTHING = 4.0 / 3.0
#: added to the matrix of the boxes, over the bound of the whole: it is singular where balls are
#: free to move together
_SHIFT = 1e-6


class BallFrame(NamedTuple):
    """Where balls are, and what they weigh: positions (n, 3) in the ``cell`` (p, 3) of their
    periods, mean ``radius``, ``masses`` (n,), radii of ``gyration`` (n,), and their ``motions``.
    """

    positions: Array
    cell: Array
    radius: float
    masses: Array
    gyration: Array
    motions: Motions


class _Boxes(NamedTuple):
    """The box of each ball (n,), of ``total`` boxes, the vector (n, 3) from its middle to the ball,
    the cells (n, p) by which the ball was moved into the box, and the ``side`` of boxes.
    """

    box: Index
    total: int
    vector: Array
    cells: Array
    side: float


def _find_boxes(frame: BallFrame) -> _Boxes:
    """Return boxes of about :data:`_BALLS_PER_BOX` balls, which divide the cell evenly."""
    n = len(frame.positions)
    p = len(frame.cell)
    # axes across the periods, of length one, complete the cell
    across = np.linalg.svd(frame.cell, full_matrices=True)[2][p:] if p else np.eye(3)
    axes = np.concatenate([frame.cell, across])
    places = frame.positions @ np.linalg.inv(axes)
    cells = -np.floor(places[:, :p])
    places[:, :p] += cells
    lengths = np.linalg.norm(axes, axis=1)
    lows = np.where(np.arange(3) < p, 0.0, places.min(axis=0))
    # a layer of balls is as thick as a ball
    extents = np.where(np.arange(3) < p, 1.0, np.ptp(places, axis=0) + 2.0 * frame.radius)
    dimension = int(np.count_nonzero(extents * lengths > 3.0 * frame.radius))
    balls_per_box = max(_BALLS_PER_BOX, n / _MOST_BOXES[max(dimension, 1)])
    side = _find_side(extents * lengths, n / balls_per_box)
    numbers = np.maximum(np.rint(extents * lengths / side), 1.0)
    indices = np.floor((places - lows) / extents * numbers)
    indices = np.clip(indices, 0.0, numbers - 1.0)
    middles = lows + (indices + 0.5) / numbers * extents
    keys = np.ravel_multi_index(
        tuple(indices.astype(np.intp).T), tuple(int(number) for number in numbers)
    )
    boxes, box = np.unique(keys, return_inverse=True)
    return _Boxes(box, len(boxes), (places - middles) @ axes, cells, side)


def _find_side(lengths: Array, count: float) -> float:
    """Return the side of about ``count`` cubes that fill a cuboid with sides of ``lengths`` (3,)
    where it is longer than the cubes.
    """
    side = 0.0
    for used in (3, 2, 1):
        longest = np.sort(lengths)[3 - used :]
        side = float(np.prod(longest) / count) ** (1.0 / used)
        if side <= float(longest[0]):
            break
    return side


def compose_boxes(frame: BallFrame, q: Array | None = None) -> Any:
    """Return orthonormal, mass-weighted motions (n x motions, m) of boxes of balls that move as
    rigid bodies, sparse by rows; with a wave vector ``q`` (p,), in fractions, those of waves, in
    which a ball beyond a period has the phase of the period more.
    """
    from scipy.sparse import bsr_array

    boxes = _find_boxes(frame)
    motions = frame.motions
    n = len(boxes.box)
    chosen = [*motions.translations, *(3 + axis for axis in motions.rotations)]
    roots = np.sqrt(frame.masses)[:, None]
    effects = np.zeros((n, 6, 6))  # ball, its motion, motion of the box
    for axis, along in enumerate(np.eye(3)):
        effects[:, axis, axis] = roots[:, 0]
        effects[:, :3, 3 + axis] = roots * np.cross(along, boxes.vector) / boxes.side
        effects[:, 3 + axis, 3 + axis] = roots[:, 0] * frame.gyration / boxes.side
    effects = effects[:, chosen]
    products = np.zeros((boxes.total, 6, 6))
    np.add.at(products, boxes.box, np.einsum("nki,nkj->nij", effects, effects))
    sizes, vectors = np.linalg.eigh(products)
    is_motion = sizes > _DEPENDENT * sizes[:, -1:]
    scale = np.divide(1.0, np.sqrt(np.abs(sizes)), out=np.zeros_like(sizes), where=is_motion)
    weights = vectors * scale[:, None, :]
    blocks = np.einsum("nki,nij->nkj", effects, weights[boxes.box])
    if q is not None:
        phase = np.exp(-2.0j * np.pi * (boxes.cells @ q))
        blocks = blocks * phase[:, None, None]
    shape = (n * motions.count, 6 * boxes.total)
    every = bsr_array((blocks, boxes.box, np.arange(n + 1)), shape=shape).tocsc()
    return every[:, np.flatnonzero(is_motion.ravel())].tocsr()


class TwoLevels:
    """The inverse of a sparse Hermitian ``matrix`` (n x ``count``, n x ``count``) without negative
    eigenvalues, approximately; ``count`` is the number of motions of a ball, and ``boxes`` are
    those of :func:`compose_boxes`.

    Attributes
    ----------
    held : the inverse of what holds each ball alone, sparse.
    """

    def __init__(self, matrix: Any, count: int, boxes: Any) -> None:
        from scipy.sparse import eye_array

        self._matrix = matrix
        self.held, _ = invert_blocks(matrix, count)
        self._step = (_STEP / _BOUND) * self.held
        smoothing = self.held @ (matrix @ boxes)
        self._boxes: Any = (boxes - (_SMOOTHING / _BOUND) * smoothing).tocsr()
        self._to_boxes: Any = self._boxes.conj().T.tocsr()
        coarse = (self._to_boxes @ (matrix @ self._boxes)).tocsr()
        shift = _SHIFT * float(np.max(matrix.diagonal().real))
        shifted = coarse + shift * eye_array(coarse.shape[0])
        self._is_complex = np.iscomplexobj(shifted.data)
        self._factors = factorise(_make_real(shifted) if self._is_complex else shifted)

    def __call__(self, residual: NDArray[Any]) -> NDArray[Any]:
        """Return the motions (size, m) that take most of the ``residual`` (size, m) away."""
        motions = self._step @ residual
        motions += self._boxes @ self._solve(self._to_boxes @ (residual - self._matrix @ motions))
        return np.asarray(motions + self._step @ (residual - self._matrix @ motions))

    def _solve(self, right: NDArray[Any]) -> NDArray[Any]:
        """Return the motions of boxes under the forces ``right`` (n_boxes, m)."""
        if not self._is_complex:
            return self._factors.solve(np.ascontiguousarray(right))
        solution = self._factors.solve(np.concatenate([right.real, right.imag]))
        real, imaginary = np.split(solution, 2)
        return np.asarray(real + 1.0j * imaginary)


def _make_real(matrix: Any) -> Any:
    """Return the real symmetric matrix (2 n, 2 n) that acts on real and imaginary parts as a
    Hermitian one (n, n) does on their sum; factors of symmetric matrices keep half of the entries.
    """
    from scipy.sparse import block_array

    return block_array([[matrix.real, -matrix.imag], [matrix.imag, matrix.real]], format="csc")


def invert_blocks(matrix: Any, count: int) -> tuple[Any, Any]:
    """Return the inverses of the blocks of a sparse Hermitian ``matrix`` (n, n) that hold each ball
    alone, of ``count`` motions, and the orthonormal motions (n, m) of single balls that nothing
    holds; both sparse.
    """
    from scipy.sparse import bsr_array, csr_array

    size = matrix.shape[0]
    n_balls = size // count
    entries = matrix.tocoo()
    is_own = entries.row // count == entries.col // count
    rows, columns = entries.row[is_own], entries.col[is_own]
    blocks = np.zeros((n_balls, count, count), entries.dtype)
    blocks[rows // count, rows % count, columns % count] = entries.data[is_own]
    stiffness, vectors = np.linalg.eigh(blocks)
    is_held = stiffness > NO_ENERGY * np.max(stiffness)
    inverse = np.divide(1.0, stiffness, out=np.zeros_like(stiffness), where=is_held)
    inverses = np.einsum("bik,bk,bjk->bij", vectors, inverse, vectors.conj())
    pointers = np.arange(n_balls + 1)
    held = bsr_array((inverses, np.arange(n_balls), pointers), shape=(size, size)).tocsr()
    balls, modes = np.nonzero(~is_held)
    lines = balls[:, None] * count + np.arange(count)
    numbers = np.broadcast_to(np.arange(len(balls))[:, None], lines.shape)
    free = csr_array(
        (vectors[balls, :, modes].ravel(), (lines.ravel(), numbers.ravel())),
        shape=(size, len(balls)),
    )
    return held, free
