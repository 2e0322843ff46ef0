"""A disordered array by sparse matrices: the reference for the stencils and conjugate gradients of the simulation.

Balls, units and the measure of rest are those of :mod:`granphon.array.equilibrium` and :mod:`granphon.array.response`. The
algorithm is another: C is a matrix made from the table of contacts, Newton's method factorises (LU) at each step, and one
more factorisation gives the linear response with rotations. Stencils, Fourier transforms and conjugate gradients are not
used.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any

import numpy as np
from numpy.typing import NDArray

from granphon.array.equilibrium import CARRIED_FORCE, REST_TOLERANCE, THRESHOLD_FORCE
from granphon.balls.lattices import TRIANGULAR
from granphon.base.errors import ConvergenceError, message

__all__ = ["SparseArray"]

Array = NDArray[np.float64]
#: largest number of steps of Newton's method, each with an LU factorisation
_FACTORISATIONS = 200
#: residual force on a ball, over the mean contact force, that rounding may leave
_FORCE_ROUNDING = 1e-14
#: stiffness added to each contact in a factorisation, as a fraction of the mean stiffness times the distance from
#: equilibrium
_SHIFT = 1e-2
#: stiffness of the springs that hold motions which nothing else holds, over the largest stiffness
_HOLDING_STIFFNESS = 1e-12
#: number of solutions, each for the residual of the one before, that remove the effect of these springs
_REFINEMENTS = 3
#: largest number of trials for the length of a step
_SLOPES = 30


class SparseArray:
    """Balls at rest on a periodic triangular array, by sparse matrices; units of W and c W^(3/2) (Section IV).

    Parameters
    ----------
    deviations : (L1, L2) x = Delta/W, of mean zero.

    Whatever does not depend on the load is made once: C, and the positions at which each contact's stiffness enters C^T K C.
    """

    def __init__(self, deviations: Array) -> None:
        from scipy.sparse import csc_array

        n, table = deviations.size, TRIANGULAR.contacts
        self.shape: tuple[int, ...] = deviations.shape
        site = np.arange(n).reshape(deviations.shape)
        self._i = np.tile(site.ravel(), len(table))
        self._j = np.concatenate([np.roll(site, (-a, -b), (0, 1)).ravel() for a, b in table.shift.tolist()])
        self._means = 0.5 * (deviations.ravel()[self._i] + deviations.ravel()[self._j])
        self._c = self._make_compatibility(0.0)
        self._transposed = self._c.T.tocsr()
        # the entries of C^T K C are a constant matrix times the stiffnesses; the first ball is pinned
        i, j, normal = self._i, self._j, np.repeat(table.normal, n, axis=0).T
        blocks = [
            (a, b, p, q, s) for a, b, s in ((i, i, 1), (j, j, 1), (i, j, -1), (j, i, -1)) for p in (0, 1) for q in (0, 1)
        ]
        row, column, factor = (
            np.concatenate(parts)
            for parts in zip(*((2 * a + p, 2 * b + q, s * normal[p] * normal[q]) for a, b, p, q, s in blocks), strict=True)
        )
        kept, self._size = (row > 1) & (column > 1), 2 * n - 2
        place, slot = np.unique((column[kept] - 2) * self._size + row[kept] - 2, return_inverse=True)
        contact = np.tile(np.arange(i.size), len(blocks))[kept]
        self._fill = csc_array((factor[kept], (slot, contact)), shape=(place.size, i.size)).tocsr()
        self._indices = (place % max(1, self._size)).astype(np.int32)
        self._starts = np.searchsorted(place, np.arange(self._size + 1) * self._size).astype(np.int32)

    def _make_compatibility(self, mindlin_ratio: float) -> Any:
        """Return C. Rows: elongations of all contacts, kind by kind, then slips. Columns: u of each ball, then its rotation.

        Slips and rotations are left out without friction.
        """
        from scipy.sparse import csc_array

        table, n = TRIANGULAR.contacts, self._i.size // len(TRIANGULAR.contacts)
        dofs = 3 if mindlin_ratio else 2
        rows, columns, entries = [], [], []

        def put(first: int, ball: NDArray[np.intp], dof: int, of_kind: Array) -> None:
            rows.append(first + np.arange(ball.size))
            columns.append(dofs * ball + dof)
            entries.append(np.repeat(of_kind, n))

        for block, axis in enumerate((table.normal, table.tangent)[: dofs - 1]):
            for dof in (0, 1):
                put(block * self._j.size, self._j, dof, axis[:, dof])
                put(block * self._i.size, self._i, dof, -axis[:, dof])
        if mindlin_ratio:
            put(self._j.size, self._j, 2, -table.arm_j)
            put(self._i.size, self._i, 2, -table.arm_i)
        where = np.concatenate(rows), np.concatenate(columns)
        return csc_array((np.concatenate(entries), where), shape=((dofs - 1) * self._i.size, dofs * n)).tocsr()

    # -- at rest ----------------------------------------------------------------------------------------------------

    def forces(self, overlap: float, tolerance: float = REST_TOLERANCE, check: Callable[[], object] | None = None) -> Array:
        """Return (3, L1, L2) contact forces at rest at the common overlap y, in units of c W^(3/2).

        ``tolerance`` is the largest force left on a ball, over the mean contact force or the rms difference of contact
        forces, whichever is less; it is no smaller than 1e-14 of the mean. ``check``, if given, is called before each step.
        Raises :class:`~granphon.base.errors.ConvergenceError` if the tolerance is not reached, or too few balls touch to
        carry a load.
        """
        h = overlap + self._means
        for _ in range(_FACTORISATIONS):
            if check is not None:
                check()
            closed = np.maximum(h, 0.0)
            root = np.sqrt(closed)
            forces = closed * root
            mean, pull = float(np.mean(forces)), self._transposed @ forces
            residual, scale = self._find_largest(pull), min(mean, float(np.std(forces)))
            if mean < THRESHOLD_FORCE and not np.all(closed):
                break
            if residual <= max(tolerance * scale, _FORCE_ROUNDING * mean):
                return np.asarray(forces.reshape(-1, *self.shape))
            left = residual / scale
            stiffness = 1.5 * root
            stiffness += _SHIFT * min(1.0, left) * np.mean(stiffness)
            strain = self._c @ self._step(stiffness, pull)
            h = h - self._find_step_length(h, strain) * strain
        raise ConvergenceError(
            message(
                f"the array has not come to rest at an overlap of {overlap:.6g} widths",
                f"A force of {residual:.2g} is left on a ball, and the mean contact force is {mean:.2g}",
                "Raise the overlap",
            )
        )

    @staticmethod
    def _find_largest(pull: Array) -> float:
        """Return the largest force on a ball, in units of c W^(3/2)."""
        return math.sqrt(float(np.max(pull[0::2] ** 2 + pull[1::2] ** 2)))

    def _step(self, stiffness: Array, force: Array) -> Array:
        from scipy.sparse import csc_array

        matrix = csc_array((self._fill @ stiffness, self._indices, self._starts), shape=(self._size, self._size))
        return np.concatenate([[0.0, 0.0], _factorise(matrix).solve(force[2:])])

    @staticmethod
    def _find_step_length(h: Array, strain: Array) -> float:
        """Find the step length at which the slope of the energy has a tenth of its first size, by bracketed Newton steps."""
        first, low, high, length = 0.0, 0.0, math.inf, 0.0
        for trial in range(_SLOPES):
            closed = np.maximum(h - length * strain, 0.0)
            root = np.sqrt(closed)
            slope, rise = -float(strain @ (closed * root)), 1.5 * float(root @ strain**2)
            if trial == 0:
                first, length = slope, 1.0
                continue
            if abs(slope) <= 0.1 * abs(first):
                break
            low, high = (length, high) if slope < 0.0 else (low, length)
            length = length - slope / rise if rise > 0.0 else math.inf
            if not low < length < high:
                length = 0.5 * (low + high) if high < math.inf else 2.0 * low
            length = min(length, 4.0 * low) if high == math.inf else length
        return length

    # -- linear response --------------------------------------------------------------------------------------------

    def elastic_tensor(self, forces: Array, mindlin_ratio: float) -> Array:
        """Return the (3, 3) elastic tensor with shear springs eta k at every contact that carries load.

        Voigt order is xx, yy, xy, and the unit c W^(1/2)/d^2. ``forces`` (3, L1, L2) are those at rest; a contact carries
        load if its force is above ten times the largest force that they leave on a ball. Motions that cost nothing (of the
        whole array, of balls that nothing holds, of contacts in line without friction) are held by springs of 1e-12 of the
        largest stiffness, and iteration removes their small effect.
        """
        from scipy.sparse import eye_array

        flat = np.asarray(forces, float).ravel()
        carried = flat > CARRIED_FORCE * self._find_largest(self._transposed @ flat)
        normal = 1.5 * np.cbrt(np.where(carried, flat, 0.0))
        stiffness = np.concatenate([normal, mindlin_ratio * normal]) if mindlin_ratio else normal
        c, strained = self._make_compatibility(mindlin_ratio), self._strain_contacts()[: stiffness.size]
        transposed = c.T.tocsr()
        matrix = (transposed @ c.multiply(stiffness[:, None])).tocsc()
        hold = _HOLDING_STIFFNESS * float(np.max(stiffness)) * eye_array(c.shape[1], format="csc")
        factors = _factorise((matrix + hold).tocsc())
        motion = np.zeros((c.shape[1], 3))
        for _ in range(_REFINEMENTS):
            motion += factors.solve(transposed @ (stiffness[:, None] * (strained - c @ motion)))
        left = strained - c @ motion
        return np.asarray(left.T @ (stiffness[:, None] * left) / (TRIANGULAR.measure * math.prod(self.shape)))

    def _strain_contacts(self) -> Array:
        """Return (6 L1 L2, 3) elongations n.e.n, then slips t.e.n, of every contact under each unit strain."""
        (nx, ny), (tx, ty) = TRIANGULAR.contacts.normal.T, TRIANGULAR.contacts.tangent.T
        rows = [np.stack([ax * nx, ay * ny, 0.5 * (ax * ny + ay * nx)], axis=1) for ax, ay in ((nx, ny), (tx, ty))]
        return np.repeat(np.concatenate(rows), math.prod(self.shape), axis=0)


def _factorise(matrix: Any) -> Any:
    """Return the LU factors of a symmetric positive definite matrix."""
    from scipy.sparse.linalg import splu

    return splu(matrix, permc_spec="MMD_AT_PLUS_A", diag_pivot_thresh=0.0, options={"SymmetricMode": True})
