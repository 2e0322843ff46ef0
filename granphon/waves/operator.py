"""The dynamical matrix of a finite network as a linear operator.

With the rows C of all contacts (:mod:`granphon.dynamics.rows`), the stiffnesses K and the masses M,

    A = K^1/2 C M^-1/2,    D = A^T A - B^T (f/r) B,

where the second term, B being displacements across contacts, is the prestress, if the network has it. The eigenvalues of D
are squared angular frequencies, (rad/s)^2, and singular values of A are angular frequencies. A vector holds, for each ball
that moves, its mass-weighted motions: M^1/2 u and M^1/2 w, w = (I/M)^1/2 phi.

Static tangential forces T add G (:func:`granphon.dynamics.rows.carry_rows`), which has no potential, as the law of discrete
elements has none. D has its symmetric part. What is left out changes an eigenvalue by a term of second order in T/(k r),
:attr:`WaveOperator.slack`.
It is seen where an eigenvalue is zero: a ball with two contacts in space turns freely about the line through them, along
which its forces are, and D makes a little less than zero of that.
"""

from __future__ import annotations

import math
from functools import cached_property
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.sparse.linalg import LinearOperator

from granphon.array.sparse_matrices import compose
from granphon.base.errors import InputError, message
from granphon.dynamics.rows import Row, carry_rows, contact_rows, push_rows
from granphon.networks.network import ContactNetwork

if TYPE_CHECKING:
    from scipy.sparse import csr_array


Array = NDArray[np.float64]
#: margin of the bound of all frequencies: the kernel of a spectrum has no width at the bound itself
_MARGIN = 1.01


class WaveOperator(LinearOperator[np.float64]):
    """D of a network, as sparse matrices, (rad/s)^2.

    Attributes
    ----------
    network : the network.
    motions : of each ball.
    balls : (n_free,) indices of the balls that move.
    """

    def __init__(self, network: ContactNetwork) -> None:
        self.network, self.motions = network, network.ball_motions
        self.balls = np.flatnonzero(network.moving)
        if not self.balls.size or not network.n_contacts:
            raise InputError(message("no waves run in this network", "It has no ball that moves, or no contact"))
        size = self.balls.size * self.motions.count
        super().__init__(np.float64, (size, size))  # type: ignore[call-arg]  # the stubs do not know this constructor

    @property
    def size(self) -> int:
        """Number of motions of all balls that move."""
        return int(self.shape[0])

    # -- vectors and values of balls ----------------------------------------------------------------------------------

    def vector(self, values: ArrayLike) -> NDArray[Any]:
        """Return the vector (size, ...) of values (n_free, motions, ...) of balls that move."""
        values = np.asarray(values)
        return values.reshape(self.size, *values.shape[2:])

    def values(self, vector: ArrayLike) -> NDArray[Any]:
        """Return the values (n_free, motions, ...) of balls that move in a vector (size, ...)."""
        vector = np.asarray(vector)
        return vector.reshape(self.balls.size, self.motions.count, *vector.shape[1:])

    @cached_property
    def _places(self) -> NDArray[np.intp]:
        """(n, motions) the place of each motion in a vector; -1 of balls that do not move."""
        places = np.full((self.network.n_balls, self.motions.count), -1)
        places[self.balls] = self.values(np.arange(self.size))
        return places

    @cached_property
    def is_rotation(self) -> NDArray[np.bool_]:
        """(size,) whether each number of a vector belongs to a rotation."""
        return np.asarray(self.vector(np.broadcast_to(self.motions.is_rotation, (self.balls.size, self.motions.count))))

    # -- matrices -------------------------------------------------------------------------------------------------------

    def _make_matrix(self, rows: list[Row], root: list[Array]) -> csr_array[Any]:
        """Return the rows, each times its ``root`` (n_c,), over the root of the masses: (kinds x n_c, size)."""
        network, count, parts = self.network, self.network.n_contacts, []
        for kind, (row, weight) in enumerate(zip(rows, root, strict=True)):
            for ball, coefficients, sign in ((network.j, row.head, 1.0), (network.i, row.tail, -1.0)):
                line = np.flatnonzero(network.moving[ball])
                scale = (sign * weight / np.sqrt(network.masses[ball]))[line, None]
                parts.append(((kind * count + line)[:, None], self._places[ball[line]], scale * coefficients[line]))
        return compose(parts, (len(rows) * count, self.size))

    @cached_property
    def _gyration(self) -> Array:
        """(n,) radii of gyration, m; one of balls that do not move."""
        network = self.network
        return np.sqrt(np.divide(network.inertias, network.masses, out=np.ones(network.n_balls), where=network.moving))

    @cached_property
    def rows(self) -> list[Row]:
        """Deformations of the contacts, as coefficients of u and w of their balls; their stiffness is in N/m."""
        network, of_ball = self.network, self._gyration
        rows = contact_rows(
            network.normal[:, : network.dimension], network.arm_i, network.arm_j, self.motions,
            elongation=network.normal_stiffness, slip=network.shear_stiffness, twist=network.torsion_stiffness,
            roll=network.bending_stiffness, gyration_i=of_ball[network.i], gyration_j=of_ball[network.j],
        )  # fmt: skip
        if not rows:
            raise InputError(message(f"the motions {self.motions.name!r} deform no contact of this network"))
        return rows

    @cached_property
    def root(self) -> csr_array[Any]:
        """A = K^1/2 C M^-1/2, (rows, size), rad/s."""
        return self._make_matrix(self.rows, [np.sqrt(row.stiffness) for row in self.rows])

    @cached_property
    def matrix(self) -> csr_array[Any]:
        """D, (size, size), (rad/s)^2."""
        found: csr_array[Any] = (self.root.T.tocsr() @ self.root).tocsr()
        network = self.network
        rows = push_rows(network.normal[:, : network.dimension], self.motions) if network.prestress else []
        if rows:  # balls that move along a line alone make none
            pushed = np.sqrt(network.normal_force / network.distance)
            across = self._make_matrix(rows, [pushed] * len(rows))
            found = (found - across.T.tocsr() @ across).tocsr()
        if self._carried is None:
            return found
        held: csr_array[Any] = (found + 0.5 * (self._carried + self._carried.T)).tocsr()
        return held

    @cached_property
    def _carried(self) -> csr_array[Any] | None:
        """G, (size, size), (rad/s)^2, of static tangential forces; None if none act."""
        network, of_ball = self.network, self._gyration
        force = network.tangential_force
        if not network.prestress or force is None or not np.any(force):
            return None
        pairs = carry_rows(
            network.normal, force, network.distance, network.arm_i, network.arm_j, self.motions, of_ball[network.i],
            of_ball[network.j],
        )  # fmt: skip
        unit = [np.ones(network.n_contacts)] * len(pairs)
        pull, move = (self._make_matrix(list(rows), unit) for rows in zip(*pairs, strict=True))
        found: csr_array[Any] = (pull.T.tocsr() @ move).tocsr()
        return found

    @cached_property
    def slack(self) -> float:
        """Squared frequency, (rad/s)^2, by which one of zero may be lowered as D leaves out a part N of G.

        It is 4 N^2 / top^2, where N is the largest sum of a row. That is no bound: it takes the motions into which N turns
        one of zero frequency to have a quarter of the squared frequency of the top, as in nearly all arrays that were tried.
        """
        if self._carried is None:
            return 0.0
        return (float(np.max(abs(self._carried - self._carried.T).sum(axis=1))) / self.top) ** 2

    @cached_property
    def _blocks(self) -> Array:
        """(n_free, motions, motions) what springs make of D for each ball that moves alone, (rad/s)^2."""
        network, m = self.network, self.motions.count
        own = np.zeros((m, m, network.n_balls))
        for row in self.rows:
            for ball, part in ((network.j, row.head), (network.i, row.tail)):
                for a, b in np.ndindex(m, m):
                    if np.any(weights := row.stiffness * part[:, a] * part[:, b]):
                        own[a, b] += np.bincount(ball, weights, network.n_balls)
        return np.asarray(own[:, :, self.balls].transpose(2, 0, 1) / network.masses[self.balls, None, None])

    @cached_property
    def top(self) -> float:
        """A bound of all angular frequencies, rad/s: 2^1/2 times the highest at which a ball moves alone, and a margin.

        The energy of a contact is at most twice what it would be if its two balls moved one at a time. Normal forces lower
        D, and tangential ones add at most the largest sum of a row.
        """
        most = 2.0 * float(np.max(np.linalg.eigvalsh(self._blocks)))
        if self._carried is not None:
            most += 0.5 * float(np.max(abs(self._carried + self._carried.T).sum(axis=1)))
        return _MARGIN * math.sqrt(most)

    @cached_property
    def _step(self) -> csr_array[Any]:
        """4 D / top^2 - 2: twice the matrix whose eigenvalues lie between -1 and 1, see :meth:`advance`."""
        from scipy.sparse import eye_array

        return (4.0 / self.top**2 * self.matrix - 2.0 * eye_array(self.size)).tocsr()

    def advance(self, current: Array, previous: Array) -> Array:
        """Return T_n+1 x from T_n x and T_n-1 x, Chebyshev polynomials of 2 D / top^2 - 1; ``previous`` may be overwritten.

        In terms of the angular frequency omega these are the even polynomials T_2n(omega / top).
        """
        following: Array = self._step @ current
        following -= previous
        return following

    def _matvec(self, x: NDArray[Any]) -> NDArray[Any]:
        return np.asarray(self.matrix @ x)

    _matmat = _matvec

    def _adjoint(self) -> WaveOperator:
        return self
