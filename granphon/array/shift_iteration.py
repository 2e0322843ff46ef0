"""Conjugate gradients for the small motions of a large array whose balls turn, and whose contacts
keep the directions of the lattice: no contact is spelled out.

The product is that of shifts of whole arrays (:mod:`granphon.contacts.shift_product`). The
preconditioner is the sum of Green's function of the lattice and of the inverted blocks of single
balls (:mod:`granphon.array.stencils`); if few contacts are stiff, it is made of the factors of the
matrix of these contacts. Conjugate gradients take less memory than a list of contacts, and for
large arrays less time than factors.
"""

from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np

from granphon.array.contact_lists import Springs, list_on_lattice
from granphon.array.stencils import Stencils
from granphon.base.arrays import Array
from granphon.contacts.grid import find_lattice_grid
from granphon.dynamics.elasticity import voigt_pairs
from granphon.statics.grid_iteration import GridIteration, Values
from granphon.statics.lattice_equations import may_factorise
from granphon.statics.options import RestOptions
from granphon.statics.stiff_factors import factorise_stiff


class ShiftIteration(GridIteration):
    """Conjugate gradients with C^T K C of the ``stencils`` of an array; the diagonal of K is
    ``springs`` (rows, L1, ..., Lp), zero where balls are apart.

    Fields (f, 1, cells) are motions or forces in the coordinates of the stencils, f of them in a
    cell; forces are over the mean stiffness. In lists, (n, m, 1), the n balls have m motions each
    along the axes of space.

    Attributes
    ----------
    ahead : (n, m, s) forces on balls against unit strains of the cell, in Voigt order.
    corner : (s, s) forces on strains against unit strains of the cell.
    """

    level = 1.0
    solves_together = False

    def __init__(self, stencils: Stencils, springs: Array) -> None:
        self._stencils = stencils
        self._mean_stiffness = float(np.mean(springs[: stencils.n_contacts]))
        p = len(stencils.shape)
        by_gradients = stencils.strains()
        # (s, rows) deformations by unit strains
        by_strains = np.array(
            [0.5 * (by_gradients[:, a, b] + by_gradients[:, b, a]) for a, b in voigt_pairs(p)]
        )
        n_balls = stencils.n_balls * math.prod(stencils.shape)
        self.ahead = np.empty((n_balls, stencils.motions.count, len(by_strains)))
        for strain, deformations in enumerate(by_strains):
            tension = springs * deformations[(..., *(None,) * p)]  # the same in all cells
            self.ahead[..., strain] = stencils.list_forces(stencils.forces(tension))
            del tension  # arrays of contacts are the largest ones
        spring_sums = np.sum(springs, axis=tuple(range(1, 1 + p)))
        self.corner = (by_strains * spring_sums) @ by_strains.T
        # over the mean stiffness: single precision has no numbers below 1e-38
        ratios = springs / self._mean_stiffness
        self._product = stencils.hessian(ratios)
        self._inverse = _find_inverse(stencils, ratios.astype(np.float32))

    def _shape(self, fields: Values) -> Values:
        """Return ``fields`` (f, 1, cells) as an array (f, L1, ..., Lp)."""
        return fields.reshape(-1, *self._stencils.shape)

    def _flatten(self, array: Values) -> Values:
        """Return an ``array`` (f, L1, ..., Lp) as fields (f, 1, cells)."""
        return array.reshape(len(array), 1, -1)

    def lay_forces(self, forces: Array) -> Array:
        """Return ``forces`` (n, m, 1) over the mean stiffness, as fields (f, 1, cells)."""
        return self._flatten(self._stencils.gather_forces(forces[..., 0] / self._mean_stiffness))

    def list_forces(self, fields: Array) -> Array:
        """Return forces, fields (f, 1, cells) over the mean stiffness, as (n, m, 1)."""
        return self._mean_stiffness * self._stencils.list_forces(self._shape(fields))[..., None]

    def list_motions(self, fields: Array) -> Array:
        """Return motions, fields (f, 1, cells), as (n, m, 1)."""
        return self._stencils.list_motions(self._shape(fields))[..., None]

    def multiply(self, motions: Array, forces: Array) -> None:
        """Set ``forces`` to C^T K C times ``motions``, over the mean stiffness, both (f, 1,
        cells).
        """
        products, _ = self._product(self._shape(motions))
        forces[:] = self._flatten(products)

    def find_motions(self, forces: Array) -> Values:
        """Return approximate motions under ``forces``, both (f, 1, cells): the preconditioner, in
        single precision.
        """
        return self._flatten(self._inverse(self._shape(forces).astype(np.float32)))

    def find_way_down(self, search: Array | None) -> None:
        """Return None: springs along fixed directions only resist."""


def _find_inverse(stencils: Stencils, springs: Values) -> Callable[[Values], Values]:
    """Return an approximate inverse of C^T K C: a function of forces (f, L1, ..., Lp) that returns
    motions (f, L1, ..., Lp), both in single precision.

    If few contacts are stiff and the array is small enough, the function solves with factors of the
    matrix of the stiff contacts; otherwise it is :meth:`Stencils.preconditioner`. ``springs``
    (rows, L1, ..., Lp) are the diagonal of K.
    """
    options = RestOptions()
    grid = find_lattice_grid(stencils.shape, stencils.lattice)
    if not may_factorise(grid, springs[: stencils.n_contacts], options):
        return stencils.preconditioner(springs)
    by_kind = Springs.of(*stencils.sort_springs(springs.astype(float)))
    contacts = list_on_lattice(stencils.shape, stencils.lattice, stencils.motions, by_kind)
    solve = factorise_stiff(contacts.columns, contacts.axes, contacts.n_balls, options)

    def apply(force: Values) -> Values:
        """Return approximate motions under a ``force``, both (f, L1, ..., Lp)."""
        motions = solve(stencils.list_forces(force).ravel())
        fields = stencils.gather_motions(motions.reshape(contacts.n_balls, -1))
        return fields.astype(np.float32)

    return apply
