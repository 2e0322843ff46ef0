"""Approximate inverses of C^T K C for conjugate gradients, chosen by the state and the size of the array.

Where most contacts are closed, the lattice's Green's function serves: an iteration costs two Fourier transforms, and few are
needed. Near the rigidity threshold half of the contacts are open, without order, and Green's function knows nothing of them.
There the matrix of the closed contacts is factorised (sparse LU, in single precision, which is enough for an approximation).
It has few entries; in a plane its factors have few too. They serve for all systems whose stiffnesses are not very different.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any

import numpy as np
from numpy.typing import NDArray

from granphon.array.contact_operator import ContactHessian
from granphon.array.sparse_matrices import compose, factorise
from granphon.array.stencils import Stencils

Array = NDArray[np.float64]
Inverse = Callable[[Array], Array]
#: largest number of balls whose matrix is factorised, for lattices with 1, 2, 3 periods: the memory that factors take grows
#: faster than it, in three dimensions much faster
MOST_BALLS = (2**20, 2**18, 2**12)
#: fraction of contacts that are stiff, above which Green's function is kept, for lattices with 1, 2, 3 periods
_MOST_STIFF = (0.65, 0.65, 0.42)
#: stiffness, over the mean, from which a contact is stiff; softer ones enter the matrix by their part of the diagonal only
_STIFF = 1e-3
#: stiffness, over the mean, that holds balls which nothing else holds
_LEAST_DIAGONAL = 1e-5
#: added to the matrix, whose diagonal is scaled to one: without it rounding could make motions that cost nothing unstable
_HOLDING = 1e-5
#: iterations with Green's function after which, at most, the matrix is factorised; and the cost of an iteration with the
#: factors in iterations with Green's function. Measured in planes of 64 x 64 to 128 x 128 balls
_PATIENCE, _SOLUTION = 150, 3
#: iterations of a system, beyond those of the first with the same factors, from which these are made anew for the next
_STALE = 30


class Preconditioners:
    """Preconditioners for the systems that an equilibrium or a response of one array poses one after the other.

    They count iterations: the matrix is factorised, or factorised anew, when those since the last factorisation cost more
    than it would. Numbers of iterations alone decide, never times, so that results are the same on any machine. It is not
    factorised where more than the part ``most_stiff`` of the contacts is stiff.
    """

    def __init__(self, stencils: Stencils, most_stiff: float | None = None) -> None:
        self._stencils = stencils
        self._most_stiff = _MOST_STIFF[len(stencils.shape) - 1] if most_stiff is None else most_stiff
        self._factors: Inverse | None = None
        self._spent = 0
        self._first: int | None = None  # iterations of the first system with the factors
        self._changing = False  # whether stiffnesses change so much that factors pay for each system anew

    def choose(self, stiffness: Array, hard: bool = False, product: ContactHessian | None = None) -> Inverse:
        """Return a preconditioner for ``stiffness`` (rows, L1, ..., Lp); ``hard`` if many iterations are sure to follow.

        ``product`` is that with C^T K C, if it is at hand.
        """
        if (hard or self._changing or self._spent >= _PATIENCE) and self._may_factorise(stiffness):
            self._factors, self._spent, self._first = None, 0, None  # old factors are freed before new ones are made
            self._factors = self._factorise(stiffness)
        return self._factors or self._stencils.preconditioner(stiffness, product)

    def count(self, iterations: int) -> None:
        """Count the iterations that the preconditioner chosen last has taken."""
        self._spent += iterations * (_SOLUTION if self._factors else 1)
        if self._factors:
            self._first = iterations if self._first is None else self._first
            if iterations - self._first >= _STALE:
                self._changing |= _SOLUTION * (iterations - self._first) >= _PATIENCE
                self._spent = max(self._spent, _PATIENCE)

    def find_patience(self, stiffness: Array) -> int | None:
        """Return the iterations with the preconditioner chosen last that cost as much as factors; None without factors."""
        return _PATIENCE // (_SOLUTION if self._factors else 1) if self._may_factorise(stiffness) else None

    @property
    def are_small(self) -> bool:
        """Whether the array is small enough for factors."""
        return math.prod(self._stencils.shape) * self._stencils.n_balls <= MOST_BALLS[len(self._stencils.shape) - 1]

    def _may_factorise(self, stiffness: Array) -> bool:
        normal = stiffness[: self._stencils.n_contacts]
        return self.are_small and float(np.mean(normal > _STIFF * np.mean(normal))) <= self._most_stiff

    def _factorise(self, stiffness: Array) -> Inverse:
        i, j = self._stencils.ends_of_rows()
        head, tail = self._stencils.coefficients
        return factorise_contacts(i, j, head, tail, stiffness.reshape(len(stiffness), -1))


def compose_rows(
    i: NDArray[np.intp], j: NDArray[np.intp], head: Array, tail: Array, kind: NDArray[np.intp], contact: NDArray[np.intp]
) -> Any:
    """Return C as a sparse matrix, with a row for each deformation ``kind`` of a ``contact``.

    Other arguments are those of :func:`factorise_contacts`; columns are (fields, balls).
    """
    fields, balls, parts = head.shape[1], int(max(np.max(i), np.max(j))) + 1, []
    for ends, row in ((j, head), (i, -tail)):
        for field in range(fields):
            here = np.flatnonzero(row[kind, field])
            parts.append((here, balls * field + ends[kind[here], contact[here]], row[kind[here], field]))
    return compose(parts, (kind.size, fields * balls))


def factorise_contacts(i: NDArray[np.intp], j: NDArray[np.intp], head: Array, tail: Array, stiffness: Array) -> Inverse:
    """Return an approximate inverse of C^T K C of any network of contacts, in any dimension.

    The deformation c of kind k is ``head[k].x_j - tail[k].x_i``, x being the motions of balls i[k, c] and j[k, c], or of
    cells of several balls. The inverse takes forces (n, ...) and returns motions (n, ...); the other axes together count the
    balls. It is symmetric but for rounding, and positive definite.

    Parameters
    ----------
    i, j : (kinds, contacts) balls of each contact.
    head, tail : (kinds, n) rows of C.
    stiffness : (kinds, contacts), not negative.
    """
    from scipy.sparse import diags_array, eye_array  # imported here: most simulations do not need them

    fields, balls, mean = head.shape[1], int(max(np.max(i), np.max(j))) + 1, float(np.mean(stiffness))
    stiff = stiffness > _STIFF * mean
    kind, contact = np.nonzero(stiff)
    soft, diagonal = np.where(stiff, 0.0, stiffness), np.full((fields, balls), _LEAST_DIAGONAL * mean)
    for ends, row in ((j, head), (i, -tail)):
        for field in range(fields):
            diagonal[field] += np.bincount(ends.ravel(), (row[:, field, None] ** 2 * soft).ravel(), balls)
    c = compose_rows(i, j, head, tail, kind, contact)
    matrix = c.T @ (diags_array(stiffness[kind, contact]) @ c) + diags_array(diagonal.ravel())
    scale = 1.0 / np.sqrt(matrix.diagonal())
    matrix = diags_array(scale) @ matrix @ diags_array(scale) + _HOLDING * eye_array(scale.size)
    factors = factorise(matrix, approximate=True)

    def apply(force: Array) -> Array:
        scaled = scale * force.ravel()
        largest = float(np.max(np.abs(scaled))) or 1.0  # single precision has no numbers below 1e-38
        found = scale * factors.solve((scaled / largest).astype(np.float32)) * largest
        return np.asarray(found.reshape(force.shape))

    return apply
