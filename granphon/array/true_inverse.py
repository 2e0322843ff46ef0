"""Approximate inverses of the matrix of small motions of an array in its true geometry, with the forces that act.

A ball whose contacts all slide, or a row of balls that roll on each other, is held by no springs. What is left are the
forces that act and turn with their contacts, W/d of the others. The preconditioners of the lattice know nothing of these,
and iterations with them hardly come to an end. So what the forces do to each ball alone is added to the preconditioner of
the lattice. In space rows of balls roll, of which a ball alone knows nothing: there the whole matrix is factorised (sparse
LU). The matrix of a small array is factorised at once, which takes less time than iterations without factors; that of a
larger one where iterations do not come to an end.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from granphon.array import sparse_matrices
from granphon.array.geometry import Inverse
from granphon.array.preconditioners import compose_rows
from granphon.array.stencils import Stencils

Array = NDArray[np.float64]
#: largest number of balls, in a plane and in space, whose matrix is factorised at once: where factors take less
#: time than iterations without, by trial
_MOST_AT_ONCE = (2**10, 2**9)
#: the same where iterations without factors do not come to an end. In space the time grows as the power 2.5 of it: 1000
#: balls take about 2 s, 1728 about 10 s; in a plane 16,384 about 1 s
_MOST_BALLS = (2**14, 2**11)
#: stiffness that holds motions which nothing holds, over the mean stiffness: on some lattices balls turn against each other
#: like gears, and what is left of torques, rounding among it, would turn them without limit
HOLDING = 1e-10


def is_small(stencils: Stencils) -> bool:
    """Return whether an array is so small that factors of its matrix cost less than iterations without."""
    return can_factorise(stencils, _MOST_AT_ONCE)


def can_factorise(stencils: Stencils, most: Sequence[int] = _MOST_BALLS) -> bool:
    """Return whether an array has no more balls than ``most``, which is given for a plane and for space."""
    return math.prod(stencils.shape) * stencils.n_balls <= most[len(stencils.shape) - 2]


def compose(frame: Stencils, stiffness: float, tables: Iterable[Array]) -> Any:
    """Return the whole matrix, sparse, with what holds motions that nothing holds; fields are one after the other.

    ``tables`` are those of :meth:`~granphon.array.true_geometry.ExactPlace.tabulate`, for the deformations of the ``frame``;
    ``stiffness`` is the mean one of contacts.
    """
    from scipy.sparse import eye_array  # imported here: most simulations do not need it

    i, j = frame.ends_of_rows()
    number = np.arange(j.size)
    head, tail = frame.coefficients
    c = compose_rows(i, j, head, tail, number // j.shape[1], number % j.shape[1])
    columns = np.array([np.reshape(table, (len(table), -1)) for table in tables])
    of_contact = number.reshape(1, len(columns), -1)
    d = sparse_matrices.compose([(of_contact, of_contact.swapaxes(0, 1), columns)], (j.size, j.size))
    return (c.T.tocsr() @ (d @ c) + HOLDING * stiffness * eye_array(c.shape[1])).tocsr()


def factorise(frame: Stencils, matrix: Any, symmetric: bool = False) -> Inverse | None:
    """Return what finds the motions of balls (fields, L1, ..., Lp) from forces on them, by factors of the ``matrix``.

    If that is ``symmetric``, it has to be positive definite too; None is returned if its pivots are not all above zero.
    """
    factors = sparse_matrices.factorise(matrix, pivot=0.0 if symmetric else 0.1)
    if symmetric and not (np.array_equal(factors.perm_r, factors.perm_c) and np.all(factors.U.diagonal() > 0.0)):
        return None

    def hold(fields: Array) -> Array:
        """Return motions without that of the whole array, or forces without that on it: nothing resists it."""
        held = fields.reshape(frame.n_balls, frame.motions.count, *frame.shape).copy()
        moved = held[:, frame.motions.translating]
        moved -= np.mean(moved, axis=(0, *range(2, moved.ndim)), keepdims=True)
        return held.reshape(fields.shape)

    return lambda force: hold(np.asarray(factors.solve(hold(force).ravel())).reshape(force.shape))


def invert_balls(frame: Stencils, stiffness: float, tables: Iterable[Array]) -> Inverse:
    """Return what moves each ball under a force while its neighbours are held; arguments are those of :func:`compose`."""
    count, axes = frame.motions.count, range(1, 1 + len(frame.shape))
    head, tail = (one.reshape(-1, frame.n_contacts, frame.n_balls, count) for one in frame.coefficients)
    blocks = np.zeros((count, count, frame.n_balls, *frame.shape))
    for row, forces in enumerate(tables):
        for kind, (shift, (i, j)) in enumerate(zip(frame.shifts, frame.ends, strict=True)):
            for end, rows, step in ((i, tail[:, kind, i], (0,) * len(shift)), (j, head[:, kind, j], shift)):
                found = np.roll(np.tensordot(rows, forces[:, kind], (0, 0)), step, axes)
                blocks[:, :, end] += found[:, None] * rows[row].reshape(-1, *(1,) * len(shift))
    by_ball = np.moveaxis(blocks.reshape(count, count, -1), 2, 0)
    inverse = np.linalg.inv(by_ball + HOLDING * stiffness * np.eye(count))

    def apply(force: Array) -> Array:
        forces = force.reshape(frame.n_balls, count, -1).swapaxes(1, 2).reshape(-1, count, 1)
        return (inverse @ forces).reshape(frame.n_balls, -1, count).swapaxes(1, 2).reshape(force.shape)

    return apply
