"""A disordered array by sparse matrices: the reference for the lists and grids of the simulation.

Balls, units and the measure of rest are those of :mod:`granphon.array.equilibrium`. The algorithm
is another: C is a matrix made from the table of contacts, Newton's method factorises (LU) at each
step, and one more factorisation gives the linear response with rotations. Loops over contacts,
stencils, Fourier transforms and conjugate gradients are not used.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any

import numpy as np
from numpy.typing import NDArray

from granphon.array.equilibrium import CARRIED_FORCE, REST_TOLERANCE, THRESHOLD_FORCE
from granphon.array.sparse_matrices import compose
from granphon.balls import hertz
from granphon.balls.lattices import TRIANGULAR, Lattice
from granphon.balls.motions import Motions, default_motions, select_motions
from granphon.base.arrays import Array
from granphon.base.errors import ConvergenceError
from granphon.dynamics.deformation_rows import Row, contact_rows, strain_rows
from granphon.dynamics.elasticity import voigt_pairs
from granphon.dynamics.factors import factorise
from granphon.statics.line_search import find_length
from granphon.statics.options import RestOptions

#: largest number of steps of Newton's method, each with an LU factorisation
_FACTORISATIONS = 200
#: residual force on a ball, over the mean contact force, that rounding may leave
_FORCE_ROUNDING = 1e-14
#: stiffness of the springs that hold motions which nothing else holds, over the largest stiffness
_HOLDING_STIFFNESS = 1e-12
#: number of solutions, each for the residual of the one before, that remove the effect of these
#: springs
_REFINEMENTS = 3
#: force left on a ball, over the mean, below which the stiffness that holds it is not lowered any
#: more
_LEAST_ADDED = 1e-7


class SparseArray:
    """Balls at rest on a periodic array, by sparse matrices; units of W and c W^(3/2) (Section IV).

    Parameters
    ----------
    deviations : (L1, ..., Lp) x = Delta/W, of mean zero; (n, L1, ..., Lp) of n > 1 balls in the
        cell.
    lattice : the lattice, which stands without friction.

    C, which does not depend on the load, is made once.
    """

    def __init__(self, deviations: Array, lattice: Lattice = TRIANGULAR) -> None:
        n = deviations.size
        table = lattice.contacts
        self.lattice = lattice
        d = lattice.periods
        self._d = d
        self.shape: tuple[int, ...] = deviations.shape[-d:]
        site = np.arange(n).reshape(-1, *self.shape)
        axes = tuple(range(d))
        self._i = np.concatenate([site[ball].ravel() for ball in table.i.tolist()])
        self._j = np.concatenate(
            [
                np.roll(site[ball], -step, axes).ravel()
                for ball, step in zip(table.j.tolist(), table.shift, strict=True)
            ]
        )
        self._means = 0.5 * (deviations.ravel()[self._i] + deviations.ravel()[self._j])
        self._c = self._make_compatibility(0.0)
        self._transposed = self._c.T.tocsr()
        self._free = np.arange(d, d * n)  # the first ball is pinned

    def _list_rows(self, mindlin_ratio: float) -> tuple[list[Row], Motions]:
        """Return the deformations of the contacts, and the motions of each ball."""
        table = self.lattice.contacts
        motions = select_motions(mindlin_ratio, 0.0, 0.0, default_motions(self._d))
        rows = contact_rows(table.normal, table.arm_i, table.arm_j, motions, slip=mindlin_ratio)
        return rows, motions

    def _make_compatibility(self, mindlin_ratio: float) -> Any:
        """Return C. Rows: each deformation of all contacts, kind by kind. Columns: the motions of
        ball after ball.
        """
        rows, motions = self._list_rows(mindlin_ratio)
        parts = []
        n = math.prod(self.shape)
        size = self._i.size
        count = motions.count
        for number, row in enumerate(rows):
            lines = number * size + np.arange(size)[:, None]
            for ends, coefficients in ((self._j, row.head), (self._i, -row.tail)):
                columns = count * ends[:, None] + np.arange(count)
                parts.append((lines, columns, np.repeat(coefficients, n, axis=0)))
        return compose(parts, (len(rows) * size, count * self.lattice.n_balls * n))

    # -- at rest -----------------------------------------------------------------------------------

    def forces(
        self,
        overlap: float,
        tolerance: float = REST_TOLERANCE,
        check: Callable[[], object] | None = None,
    ) -> Array:
        """Return (n_c, L1, ..., Lp) contact forces at rest at the common overlap y, in units of c
        W^(3/2).

        ``tolerance`` is the largest force left on a ball, over the mean contact force or the rms
        difference of contact forces, whichever is less; it is no smaller than 1e-14 of the mean.
        ``check``, if given, is called before each step. Raises
        :class:`~granphon.base.errors.ConvergenceError` if the tolerance is not reached, or too few
        balls touch to carry a load.
        """
        h = overlap + self._means
        for _ in range(_FACTORISATIONS):
            if check is not None:
                check()
            forces, root = hertz.press(h)
            mean = float(np.mean(forces))
            pull = self._transposed @ forces
            residual = self._find_largest(pull)
            scale = min(mean, float(np.std(forces)))
            if mean < THRESHOLD_FORCE and not np.all(root):
                break
            if residual <= max(tolerance * scale, _FORCE_ROUNDING * mean):
                return np.asarray(forces.reshape(-1, *self.shape))
            relative_residual = residual / scale
            stiffness = hertz.stiffness_of(root)
            # held by hardly anything, loose balls that all but touch others would move far under
            # what rounding leaves
            stiffness += (
                RestOptions().added_stiffness
                * min(1.0, max(relative_residual, _LEAST_ADDED))
                * np.mean(stiffness)
            )
            _, strain = find_step(self._c, self._transposed, stiffness, pull, self._free)
            h = h - find_step_length(h, strain) * strain
        raise ConvergenceError(
            f"the array has not come to rest at an overlap of {overlap:.6g} widths",
            f"A force of {residual:.2g} is left on a ball, and the mean contact force is"
            f" {mean:.2g}",
            "Raise the overlap",
        )

    def _find_largest(self, pull: Array) -> float:
        """Return the largest force on a ball, in units of c W^(3/2)."""
        return math.sqrt(float(np.max(np.sum(pull.reshape(-1, self._d) ** 2, axis=1))))

    # -- linear response ---------------------------------------------------------------------------

    def elastic_tensor(self, forces: Array, mindlin_ratio: float) -> Array:
        """Return the (n, n) elastic tensor with shear springs eta k at every contact that carries
        load.

        It is in Voigt order, in units of the contacts' stiffness. ``forces`` (n_c, L1, ..., Lp) are
        those at rest; a contact carries load if its force is above ten times the largest force that
        they leave on a ball. Motions that cost nothing (of the whole array, of balls that nothing
        holds, of contacts in line without friction) are held by springs of 1e-12 of the largest
        stiffness, and iteration removes their small effect.
        """
        from scipy.sparse import eye_array

        flat = np.asarray(forces, float).ravel()
        carried = flat > CARRIED_FORCE * self._find_largest(self._transposed @ flat)
        normal = hertz.stiffness_under(np.where(carried, flat, 0.0))
        c = self._make_compatibility(mindlin_ratio)
        rows, motions = self._list_rows(mindlin_ratio)
        stiffness = np.concatenate([row.stiffness * normal for row in rows])
        # deformations of every contact under each unit strain in Voigt order
        vectors = self.lattice.contacts.vector[:, : self._d]
        gradients = np.concatenate([strain_rows(row, vectors, motions) for row in rows])
        unit = [0.5 * (gradients[:, a, b] + gradients[:, b, a]) for a, b in voigt_pairs(self._d)]
        strained = np.repeat(np.stack(unit, axis=1), math.prod(self.shape), axis=0)
        transposed = c.T.tocsr()
        matrix = (transposed @ c.multiply(stiffness[:, None])).tocsc()
        hold = _HOLDING_STIFFNESS * float(np.max(stiffness)) * eye_array(c.shape[1], format="csc")
        factors = factorise(matrix + hold)
        motion = np.zeros((c.shape[1], strained.shape[1]))
        for _ in range(_REFINEMENTS):
            tension = stiffness[:, None] * (strained - c @ motion)
            motion += factors.solve(transposed @ tension)
        deformation = strained - c @ motion
        energies = deformation.T @ (stiffness[:, None] * deformation)
        return np.asarray(energies / (self.lattice.measure * math.prod(self.shape)))


def find_step(
    c: Any, transposed: Any, stiffness: Array, pull: Array, free: NDArray[np.intp]
) -> tuple[Array, Array]:
    """Return the step of Newton's method that takes the forces ``pull`` away, and the deformations
    C u by it.

    It solves C^T K C u = ``pull`` for the motions that are ``free``; the others are zero.
    """
    hessian = (transposed @ c.multiply(stiffness[:, None])).tocsc()
    step = np.zeros(pull.size)
    step[free] = factorise(hessian[free][:, free]).solve(pull[free])
    return step, c @ step


def find_step_length(h: Array, strain: Array, work: float = 0.0) -> float:
    """Find the step length at which the slope of the energy has a tenth of its first size, by
    bracketed Newton steps.

    The overlaps ``h`` change by ``-strain`` per length of the step, and loads do the ``work``.
    """

    def measure(length: float) -> tuple[float, Callable[[], float]]:
        forces, root = hertz.press(h - length * strain)
        return -float(strain @ forces) - work, lambda: hertz.stiffness_of(float(root @ strain**2))

    options = RestOptions()
    return find_length(measure, measure(0.0)[0], options.slope, options.slopes)
