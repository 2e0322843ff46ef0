"""The dynamical matrix of a finite network as a linear operator.

With the rows C of all contacts (:mod:`granphon.dynamics.deformation_rows`), the stiffnesses K and
the masses M,

    A = K^1/2 C M^-1/2,    D = A^T A - B^T (f/r) B.

The second term is the prestress, in networks that have it: f is the static normal force of a
contact, N, below zero where the contact pulls, and r the distance of its balls. B maps
mass-weighted motions to displacements across contacts. A spring to the ground is one more row of C,
of one motion of a ball. The eigenvalues of D are squared angular frequencies, (rad/s)^2, and
singular values of A are angular frequencies. A vector (size,) holds, for each ball that moves, its
mass-weighted motions: M^1/2 u and M^1/2 w of its displacement u and its rotation phi, with
w = (I/M)^1/2 phi.

A matrix G is added to this D by static tangential forces T
(:func:`granphon.dynamics.deformation_rows.carry_rows`), by static torques of contacts
(:func:`granphon.dynamics.deformation_rows.torque_pairs`), and by slip whose levers exceed the arms
of contacts (:func:`granphon.dynamics.deformation_rows.excess_pairs`). These forces follow the laws
of discrete elements. They have no potential, and so G is not symmetric. D has the symmetric part of
G. The antisymmetric part, which D lacks, changes an eigenvalue by a term of second order in T/(k r)
and in the overlap over r. This matters where an eigenvalue is zero: a ball with two contacts in
space turns freely about the line through the contacts, as its forces are along this line, but the
eigenvalue of D is a little less than zero. So :attr:`WaveOperator.whole`, D with the antisymmetric
part, tells whether the network is stable.

D of a large array of equal masses is applied without a matrix (:class:`ArrayOperator`, with
:mod:`granphon.contacts.shift_product`). For several vectors at once the sparse matrix is faster, as
it is read once for all vectors.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from functools import cached_property
from typing import TYPE_CHECKING, Any, ClassVar, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.sparse.linalg import LinearOperator

from granphon.array.sparse_matrices import estimate_factors
from granphon.balls.lattices import Lattice
from granphon.base.arrays import Array, Complex, Index
from granphon.base.errors import InputError, InstabilityError, message
from granphon.base.progress import Progress, silent
from granphon.contacts.shift_product import ContactHessian, ContactOperator
from granphon.dynamics.damping import ALIKE, Losses
from granphon.dynamics.deformation_rows import (
    Row,
    carry_rows,
    excess_pairs,
    find_anchors,
    find_gyration,
    network_rows,
    push_rows,
    torque_pairs,
    weigh_rows,
)
from granphon.networks.network import ContactNetwork

if TYPE_CHECKING:
    from scipy.sparse import csr_array


#: margin of the bound of all frequencies: the kernel of a spectrum has no width at the bound itself
_MARGIN = 1.01
#: number of balls below which a sparse matrix is faster than stencils
_LEAST_BALLS = 2500


def explain_instability(network: ContactNetwork) -> InstabilityError:
    """Return the error of a ``network`` that static forces make unstable. With prestress the
    message tells by how much these forces are out of balance.
    """
    why = "Its static forces exceed what its springs hold, so that it would buckle"
    fault = message("the network is not stable: a squared frequency is below zero", why)
    imbalance = network.describe_imbalance() if network.prestress else ""
    mend = (
        "Bring it to rest first, give its tangential_force if it has friction, or leave the static"
        " forces out (prestress=False)"
    )
    return InstabilityError(message(fault, imbalance, mend))


class Parts(NamedTuple):
    """D without G as three functions: R^T W R, with a matrix R (rows, size) and a diagonal W.

    ``deform(x)`` returns the deformations R x (rows,) of a vector x (size,), and ``pull(t)`` the
    forces R^T t (size,) of tensions t (rows,). ``weigh()`` returns the diagonal of W (rows,).
    ``weigh(weights)`` returns the diagonal of springs alone, each times its weight: ``weights``
    (2, n_c) are those of the elongation and of the other deformations.
    """

    deform: Callable[[NDArray[Any]], NDArray[Any]]
    pull: Callable[[NDArray[Any]], NDArray[Any]]
    weigh: Callable[..., Array]


class WaveOperator(LinearOperator):
    """D of a network, (rad/s)^2, as a linear operator on vectors (size,) of mass-weighted motions,
    made of sparse matrices; the head of this module defines both.

    Arrays and matrices are made when they are asked for first, and then kept: callers must not
    change them. The constructor raises :class:`~granphon.base.errors.InputError` if no ball moves,
    or there is no contact; and all that is made of :attr:`rows`, as D is, if the motions of balls
    deform no contact.

    Attributes
    ----------
    network : the network.
    motions : the motions that each ball has.
    balls : (n_free,) indices of the balls that move.
    progress : is told how far long work with D has come.
    """

    #: time of a product with a vector and of the sums for this vector in a Krylov space, s per
    #: motion, by the dimension of the network
    product_time: ClassVar = {1: 1.2e-8, 2: 3e-8, 3: 1e-7}
    #: number of vectors that share a product if there are many vectors: each vector then takes a
    #: third of the time, as the matrix is read once
    vectors_at_once: ClassVar = 10

    def __init__(self, network: ContactNetwork, progress: Progress = silent) -> None:
        self.network = network
        self.progress = progress
        self.motions = network.ball_motions
        self.balls = np.flatnonzero(network.moving)
        if not self.balls.size or not network.n_contacts:
            raise InputError(
                "no waves run in this network", "It has no ball that moves, or no contact"
            )
        size = self.balls.size * self.motions.count
        super().__init__(np.float64, (size, size))  # type: ignore[call-arg]  # the stubs do not know this constructor

    @property
    def size(self) -> int:
        """Number of motions of all balls that move."""
        return int(self.shape[0])

    def estimate_factors(self) -> tuple[float, float]:
        """Return the time, s, and the bytes of the factors of D less a complex multiple of the unit
        matrix; both are infinite if D is too large to be factorised.
        """
        contacts_per_ball = 2.0 * self.network.n_contacts / self.balls.size
        return estimate_factors(self.size, self.network.dimension, contacts_per_ball)

    # -- vectors and values of balls ---------------------------------------------------------------

    def vector(self, values: ArrayLike) -> NDArray[Any]:
        """Return the vector (size, ...) of values (n_free, motions, ...) of balls that move; it may
        share their memory.
        """
        values = np.asarray(values)
        return values.reshape(self.size, *values.shape[2:])

    def values(self, vector: ArrayLike) -> NDArray[Any]:
        """Return the values (n_free, motions, ...) of balls that move in a vector (size, ...); they
        may share its memory.
        """
        vector = np.asarray(vector)
        return vector.reshape(self.balls.size, self.motions.count, *vector.shape[1:])

    @cached_property
    def indices(self) -> NDArray[np.intp]:
        """(n, motions) index of each motion in a vector; -1 for balls that do not move."""
        indices = np.full((self.network.n_balls, self.motions.count), -1)
        indices[self.balls] = self.values(np.arange(self.size))
        return indices

    @cached_property
    def is_rotation(self) -> NDArray[np.bool_]:
        """(size,) whether each number of a vector belongs to a rotation."""
        shape = (self.balls.size, self.motions.count)
        return np.asarray(self.vector(np.broadcast_to(self.motions.is_rotation, shape)))

    @cached_property
    def flat_indices_and_scale(self) -> tuple[NDArray[np.uintp], Array]:
        """For each motion in a vector, its index (size,) in the flattened array (n, 6) of three
        displacements and three rotations of all balls, and the scale (size,), by which a
        mass-weighted motion becomes a displacement (kg^-1/2) or a rotation (kg^-1/2/m).
        """
        network = self.network
        rotation_columns = [3 + axis for axis in self.motions.rotations]
        columns = np.array([*self.motions.translations, *rotation_columns])
        masses = network.masses[self.balls, None]
        inertias = network.inertias[self.balls, None]
        is_displacement = columns < 3
        scale = 1.0 / np.sqrt(np.where(is_displacement, masses, inertias))
        indices = self.vector(6 * self.balls[:, None] + columns).astype(np.uintp)
        return indices, self.vector(scale)

    def to_balls(self, vector: Array) -> Array:
        """Return the three displacements, m, and the three rotations, rad, of each ball (n, 6) that
        the mass-weighted motions ``vector`` (size,) are; zero for motions that vectors do not have.
        """
        motions = np.zeros((self.network.n_balls, 6))
        indices, scale = self.flat_indices_and_scale
        motions.reshape(-1)[indices] = scale * vector
        return motions

    def push(self, balls: Index, direction: Array, weights: Array) -> Array:
        """Return the vector (size,) in which the displacements of each of the ``balls`` (k,),
        indices of balls that move, are the ``direction`` (3,) times the ball's entry of ``weights``
        (k,), and all other numbers are zero. Components along which balls do not move are left out.
        """
        vector = np.zeros(self.size)
        axes = list(self.motions.translations)  # displacements come first among the motions
        vector[self.indices[balls, : len(axes)]] = direction[axes] * weights[:, None]
        return vector

    # -- matrices ----------------------------------------------------------------------------------

    def _make_matrix(
        self, rows: list[Row], factors: Sequence[Any], phase: Any = 1.0
    ) -> csr_array[Any]:
        """Return the matrix (kinds x n_c, size) that maps a vector to deformations of contacts,
        kind by kind.

        Each of the ``rows`` is a kind of deformation of all n_c contacts. Its entry of ``factors``,
        a number or (n_c,), multiplies it. The factor ``phase``, 1 or (n_c,), multiplies the motions
        of balls j of contacts.
        """
        from scipy.sparse import csr_array  # imported here: most simulations do not need it

        network = self.network
        m = self.motions.count
        # from mass-weighted motions to motions; balls that are held are no part of vectors
        scale = np.where(network.moving, 1.0 / np.sqrt(network.masses), 0.0)
        scale_i = scale[network.i]
        scale_j = scale[network.j]
        # the motions of balls i, then those of balls j, of each contact
        columns = np.hstack([self.indices[network.i], self.indices[network.j]]).astype(np.int32)
        columns[columns < 0] = 0  # of balls that are held: their entries are zero
        entries = np.empty((len(rows), *columns.shape), np.result_type(phase, *factors))
        for kind_entries, row, row_factors in zip(entries, rows, factors, strict=True):
            tail_factors = (-row_factors * scale_i)[:, None]
            head_factors = (phase * row_factors * scale_j)[:, None]
            np.multiply(tail_factors, row.tail, out=kind_entries[:, :m])
            np.multiply(head_factors, row.head, out=kind_entries[:, m:])
        n_rows = len(rows) * network.n_contacts
        all_columns = np.tile(columns, (len(rows), 1)).ravel()
        starts = np.arange(n_rows + 1, dtype=np.int32) * np.int32(2 * m)
        matrix = csr_array((entries.ravel(), all_columns, starts), (n_rows, self.size))
        matrix.sum_duplicates()  # a ball may touch its own image beyond a period
        matrix.eliminate_zeros()
        return matrix

    @cached_property
    def rows(self) -> list[Row]:
        """The kinds of deformation of contacts by springs, each as coefficients of u and w of the
        balls of all contacts; see :func:`~granphon.dynamics.deformation_rows.network_rows`, which
        says what is raised.
        """
        return network_rows(self.network)

    @cached_property
    def law_rows(self) -> list[Row]:
        """The :attr:`rows`, the first of which is always the elongation: where no motion stretches
        contacts, as where balls move out of the plane, its coefficients are zero.
        """
        rows = self.rows
        if rows[0].kind == "elongation":
            return rows
        zeros = np.zeros_like(rows[0].head)
        return [Row("elongation", self.network.normal_stiffness, zeros, zeros), *rows]

    @cached_property
    def full_root(self) -> csr_array[Any]:
        """The matrix R (rows, size), rad/s, of D without G, which is R^T W R. The entries of the
        diagonal W, those of :meth:`row_weights`, are 1, -1 or 0.

        From the top to the bottom R has the rows K^1/2 C M^-1/2 of contacts, the rows (|f|/r)^1/2 B
        of static normal forces if the network has prestress, and one row for each spring to the
        ground.
        """
        return self._make_full_root()

    def _make_full_root(self, phase: Any = 1.0) -> csr_array[Any]:
        """Return :attr:`full_root` of waves, whose motions of balls j of contacts are multiplied by
        the complex factors ``phase`` (n_c,) of size one; 1 for the network as it is.
        """
        return self._add_anchors(self._make_matrix(*self._rows_and_factors, phase))

    def _add_anchors(self, contact_rows: csr_array[Any]) -> csr_array[Any]:
        """Return the matrix of ``contact_rows`` (rows, size), rad/s, and below these one row for
        each spring to the ground.
        """
        if not self._n_anchors:
            return contact_rows
        from scipy.sparse import diags_array, vstack

        anchor_rows = diags_array(np.sqrt(self.anchors)).tocsr()[np.flatnonzero(self.anchors)]
        rows: csr_array[Any] = vstack([contact_rows, anchor_rows], format="csr")
        return rows

    @cached_property
    def anchors(self) -> Array:
        """(size,) stiffness of the spring that ties each motion to the ground, over the mass,
        (rad/s)^2; zero without a spring.
        """
        stiffness = find_anchors(self.network)
        if stiffness is None:
            return np.zeros(self.size)
        masses = self.network.masses[self.balls, None]
        # the network may name rotations that no contact resists, and that balls do not have
        stiffness_of_motions = stiffness[self.balls, : self.motions.count]
        return np.asarray(self.vector(stiffness_of_motions / masses))

    @cached_property
    def _n_anchors(self) -> int:
        """Number of motions that springs tie to the ground."""
        return int(np.count_nonzero(self.anchors))

    @cached_property
    def root(self) -> csr_array[Any]:
        """A, (rows, size), rad/s: the rows of :attr:`full_root` without those of static forces."""
        if not self.network.prestress:
            return self.full_root
        return self._add_anchors(self.full_root[: len(self.rows) * self.network.n_contacts])

    @cached_property
    def _rows_and_factors(self) -> tuple[list[Row], list[Array]]:
        """The kinds of rows of :attr:`full_root` that contacts have, and for each kind the factors
        (n_c,), (N/m)^1/2: the roots of its stiffnesses, or of |f|/r for static normal forces.
        """
        network = self.network
        roots = [np.sqrt(row.stiffness) for row in self.rows]
        static_rows = self._static_rows
        if static_rows:
            normal_force, _ = network.static_forces
            static_root = np.sqrt(np.abs(normal_force) / network.distance)
            roots += [static_root for _ in static_rows]
        return self.rows + static_rows, roots

    @cached_property
    def _static_rows(self) -> list[Row]:
        """The kinds of displacements across contacts on which static normal forces act; none
        without prestress, and none where balls move only along a line.
        """
        network = self.network
        if not network.prestress:
            return []
        return push_rows(network.normal[:, : network.dimension], self.motions)

    def row_weights(self, weights: Array | None = None) -> Array:
        """Return the diagonal (rows,) of W in R^T W R, which is D without G, where R is
        :attr:`full_root`: one weight for each row of R.

        Rows of springs have the weight 1. Rows of static forces have -1 where contacts are pressed,
        1 where they pull, as tension holds contacts straight, and 0 where they exert no force.
        Given ``weights`` (2, n_c) are those of the elongation and of the other deformations: rows
        of springs of contacts then have these weights, and all other rows have 0.
        """
        network = self.network
        if weights is None:
            spring_weights = np.ones((2, network.n_contacts))
            static_weight = -np.sign(network.static_forces[0])
        else:
            spring_weights = weights
            static_weight = np.zeros(network.n_contacts)
        static_weights = [static_weight for _ in self._static_rows]
        anchor_weights = np.full(self._n_anchors, 1.0 if weights is None else 0.0)
        contact_weights = weigh_rows(self.rows, spring_weights)
        return np.concatenate([*contact_weights, *static_weights, anchor_weights])

    def weigh(self, weights: Array | None = None, phase: Any = None) -> csr_array[Any]:
        """Return R^H W R, (size, size), (rad/s)^2, with R of :attr:`full_root` and W of
        :meth:`row_weights` for ``weights`` (2, n_c); without weights this is D without G.

        With complex factors ``phase`` (n_c,), of size one, the matrix is that of waves, whose
        motions of balls j of contacts are multiplied by these factors.
        """
        root = self.full_root if phase is None else self._make_full_root(phase)
        weighed_root = root.multiply(self.row_weights(weights)[:, None]).tocsr()
        product: csr_array[Any] = (root.conj().T.tocsr() @ weighed_root).tocsr()
        return product

    def drag(self, losses: Losses) -> Array:
        """Return the drag (size,), 1/s, of each motion, the diagonal of Gamma of
        :mod:`granphon.dynamics.damping`; the drag is the same for all balls.
        """
        shape = (self.balls.size, self.motions.count)
        return self.vector(np.broadcast_to(losses.drag_of(self.motions), shape))

    def resist(self, losses: Losses, phase: Any = None) -> csr_array[Any]:
        """Return A^H tau A + Gamma, (size, size), 1/s, the matrix by which dashpots of the times
        tau, s, and the drag Gamma, 1/s, resist velocities. Springs to the ground have no dashpots.
        ``phase`` (n_c,) is that of :meth:`weigh`.
        """
        from scipy.sparse import diags_array

        viscous: csr_array[Any] = self.weigh(losses.times, phase)
        if not np.any(losses.drag):
            return viscous
        return (viscous + diags_array(self.drag(losses))).tocsr()

    @cached_property
    def matrix(self) -> csr_array[Any]:
        """D, (size, size), (rad/s)^2, with the symmetric part of G."""
        return self._add_carried(self.weigh(), self._carried)

    def at_wavevector(self, q: Array) -> csr_array[Any]:
        """Return D (size, size), complex, (rad/s)^2, of waves whose wave vector is ``q`` (p,), in
        fractions of the reciprocal vectors of the periods: a ball one period further along an axis
        moves with the factor exp(2 pi i q) of that axis.
        """
        axes = np.flatnonzero(self.network.pbc)
        phase = np.exp(2.0j * np.pi * (self.network.shift[:, axes] @ q))
        return self._add_carried(self.weigh(phase=phase), self._carry(phase))

    @staticmethod
    def _add_carried(springs: csr_array[Any], carried: csr_array[Any] | None) -> csr_array[Any]:
        """Return the sum of two matrices (size, size), (rad/s)^2: ``springs``, that of springs and
        normal forces, and the Hermitian part of ``carried``, G, if there is any.
        """
        if carried is None:
            return springs
        matrix: csr_array[Any] = (springs + 0.5 * (carried + carried.conj().T)).tocsr()
        return matrix

    def make_lossy_product(self, losses: Array) -> Callable[[Complex], Complex]:
        """Return the function that multiplies D + i A^T eta A, (rad/s)^2, by a vector (size,).

        The loss factors eta are ``losses`` (2, n_c) of the elongation and of the other deformations
        of contacts. Springs to the ground lose nothing.
        """
        matrix = (self.matrix + 1j * self.weigh(losses)).tocsr()
        return lambda x: np.asarray(matrix @ x)

    @cached_property
    def parts(self) -> Parts:
        """D without G as three functions; the rows are those of :attr:`full_root`."""
        root = self.full_root
        transposed_root = root.T.tocsr()
        return Parts(
            deform=lambda x: np.asarray(root @ x),
            pull=lambda tension: np.asarray(transposed_root @ tension),
            weigh=self.row_weights,
        )

    def store(self, x: Array) -> float:
        """Return the energy x D x / 2, J, that mass-weighted motions ``x`` (size,) store.

        The energy is summed over deformations: in the product D x a drift of all balls would cost
        digits.
        """
        double_energy = self.parts.weigh() @ self.parts.deform(x) ** 2
        if self._pairs:  # x G x, which is the same for the symmetric part of G
            pull, move = self._pairs
            pull_deformations = self._make_matrix(*pull) @ x
            move_deformations = self._make_matrix(*move) @ x
            double_energy = double_energy + pull_deformations @ move_deformations
        return 0.5 * float(double_energy)

    def stretch(
        self, moved: Array, rows_and_factors: tuple[list[Row], list[Array]] | None = None
    ) -> Array:
        """Return the deformations (kinds x n_c,) of contacts, each times the factor of its kind,
        when bodies that are held are moved.

        ``moved`` (n, motions) are the motions u and w of these bodies, m, and zero for balls that
        move. ``rows_and_factors`` are kinds of rows, and for each kind its factors (n_c,). By
        default all rows of :attr:`full_root` are taken, and the deformations are (rows,): those of
        springs to the ground are zero, as these tie balls that move.
        """
        moved_i = moved[self.network.i]
        moved_j = moved[self.network.j]
        rows, factors = rows_and_factors or self._rows_and_factors
        deformations = list[Array]()
        for row, row_factors in zip(rows, factors, strict=True):
            row_deformations = np.sum(row.head * moved_j - row.tail * moved_i, axis=1)
            deformations.append(row_factors * row_deformations)
        if rows_and_factors is None:
            deformations.append(np.zeros(self._n_anchors))
        return np.concatenate(deformations)

    def pull(self, moved: Array, weights: Array | None = None) -> Array:
        """Return the mass-weighted forces (size,), N/kg^1/2, that act on balls that move when
        bodies that are held are moved; ``moved`` (n, motions) is that of :meth:`stretch`.

        Springs and static forces act. With ``weights`` (2, n_c), those of :meth:`row_weights`, only
        the springs of contacts act, each times its weight.
        """
        tensions = self.row_weights(weights) * self.stretch(moved)
        forces = -(self.full_root.T @ tensions)
        if self._pairs and weights is None:
            # half of G and half of its transpose, as in D
            pull, move = self._pairs
            forces -= 0.5 * (self._make_matrix(*pull).T @ self.stretch(moved, move))
            forces -= 0.5 * (self._make_matrix(*move).T @ self.stretch(moved, pull))
        return np.asarray(forces)

    def compose(self, rows: list[Row], phase: Any = 1.0) -> csr_array[Any]:
        """Return C M^-1/2, (kinds x n_c, size), which maps mass-weighted motions to deformations of
        contacts, those of the kinds in ``rows``; ``phase``, 1 or (n_c,), is that of :meth:`weigh`.
        """
        return self._make_matrix(rows, [1.0 for _ in rows], phase)

    @cached_property
    def _pairs(self) -> tuple[tuple[list[Row], list[Array]], ...]:
        """The two matrices "pull" and "move" of G = pull^H move, each as kinds of rows with their
        factors (n_c,); an empty tuple if no static tangential forces or torques act, and no lever
        of slip exceeds its arm.
        """
        force_pairs = self._find_carried_pairs()
        lever_pairs = self._find_excess_pairs()
        pairs = force_pairs + lever_pairs
        if not pairs:
            return ()
        ones = np.ones(self.network.n_contacts)
        pull_factors = [ones for _ in force_pairs]
        pull_factors += [self.network.shear_stiffness for _ in lever_pairs]
        pull_rows = [pull for pull, _ in pairs]
        move_rows = [move for _, move in pairs]
        return (pull_rows, pull_factors), (move_rows, [ones for _ in pairs])

    def _find_excess_pairs(self) -> list[tuple[Row, Row]]:
        """Return the pairs (pull, move) of rows of slip by levers that exceed the arms of contacts,
        without the stiffness of slip; none if no lever exceeds its arm.
        """
        network = self.network
        if network.lever_excesses is None:
            return []
        gyration = find_gyration(network)
        return excess_pairs(
            network.normal[:, : network.dimension],
            (network.arm_i, network.arm_j),
            network.lever_excesses,
            network.slip_stretch,
            self.motions,
            (gyration[network.i], gyration[network.j]),
        )

    def _find_carried_pairs(self) -> list[tuple[Row, Row]]:
        """Return the pairs (pull, move) of rows of static torques and of static tangential forces;
        an empty list if there are no such torques and forces, and without prestress.
        """
        network = self.network
        if not network.prestress:
            return []
        gyration = find_gyration(network)
        gyration_i = gyration[network.i]
        gyration_j = gyration[network.j]
        pairs: list[tuple[Row, Row]] = []
        torque = network.contact_torque
        # motions within a line or a plane do not turn torques along the line or across the plane
        leaves_network = max(self.motions.translations) >= network.dimension
        turns_torques = network.dimension == 3 or leaves_network
        if torque is not None and np.any(torque) and turns_torques:
            pairs += torque_pairs(
                network.normal,
                torque,
                network.distance,
                network.ball_motions,
                (gyration_i, gyration_j),
            )
        _, tangential_force = network.static_forces
        if np.any(tangential_force):
            pairs += carry_rows(
                network.normal,
                tangential_force,
                network.distance,
                (network.arm_i, network.arm_j),
                network.ball_motions,
                (gyration_i, gyration_j),
                network.tangential_growth,
                network.arm_rates,
                turns=network.turns_with_balls,
            )
        return pairs

    @cached_property
    def _carried(self) -> csr_array[Any] | None:
        """G, (size, size), (rad/s)^2; None if all that acts has a potential."""
        return self._carry()

    def _carry(self, phase: Any = 1.0) -> csr_array[Any] | None:
        """Return G, (size, size), (rad/s)^2, of waves in which balls j of contacts move with a
        ``phase``, 1 or (n_c,); None if all that acts has a potential.
        """
        if not self._pairs:
            return None
        pull, move = self._pairs
        pull_matrix = self._make_matrix(*pull, phase)
        move_matrix = self._make_matrix(*move, phase)
        carried: csr_array[Any] = (pull_matrix.conj().T.tocsr() @ move_matrix).tocsr()
        return carried

    @cached_property
    def whole(self) -> csr_array[Any] | None:
        """D with the antisymmetric part of G too, (size, size), (rad/s)^2; None if all that acts
        has a potential, so that D is already whole.
        """
        if self._carried is None:
            return None
        antisymmetric_part = 0.5 * (self._carried - self._carried.T)
        whole: csr_array[Any] = (self.matrix + antisymmetric_part).tocsr()
        return whole

    @cached_property
    def ball_blocks(self) -> Array:
        """(n_free, motions, motions) block of D without G, (rad/s)^2, of each ball when it moves
        alone. The blocks are upper bounds: the static forces of pressed contacts, which lower D,
        are left out, and a contact of a ball with its own image counts twice, as one with each of
        two balls that rest.
        """
        network = self.network
        m = self.motions.count
        blocks = np.zeros((m, m, network.n_balls))
        normal_force, _ = network.static_forces
        pull = np.maximum(-normal_force, 0.0)
        static_stiffness = pull / network.distance
        stiffness_of_rows = [(row, row.stiffness) for row in self.rows]
        stiffness_of_rows += [(row, static_stiffness) for row in self._static_rows]
        for row, stiffness in stiffness_of_rows:
            for ball, coefficients in ((network.j, row.head), (network.i, row.tail)):
                for a, b in np.ndindex(m, m):
                    weights = stiffness * coefficients[:, a] * coefficients[:, b]
                    if np.any(weights):
                        blocks[a, b] += np.bincount(ball, weights, network.n_balls)
        masses = network.masses[self.balls, None, None]
        blocks_of_balls = np.asarray(blocks[:, :, self.balls].transpose(2, 0, 1) / masses)
        blocks_of_balls[:, np.arange(m), np.arange(m)] += self.values(self.anchors)
        return blocks_of_balls

    @cached_property
    def top(self) -> float:
        """An upper bound of all angular frequencies, rad/s, with a margin.

        The energy of a contact is at most twice the sum of its energies with one ball moving at a
        time. So omega^2 without G is at most twice the highest square of a ball that moves alone;
        static forces of pressed contacts lower D. G raises omega^2 by at most the largest sum over
        a row of |G + G^T| / 2.
        """
        highest_alone = float(np.max(np.linalg.eigvalsh(self.ball_blocks)))
        square_bound = 2.0 * highest_alone
        if self._carried is not None:
            double_symmetric_part = self._carried + self._carried.T
            row_sums = abs(double_symmetric_part).sum(axis=1)
            square_bound += 0.5 * float(np.max(row_sums))
        return _MARGIN * math.sqrt(square_bound)

    def advance(self, current: Array, previous: Array) -> Array:
        """Return T_n+1 x from ``current``, T_n x, and ``previous``, T_n-1 x, each (size,) or
        (size, m), where T_n are Chebyshev polynomials of 2 D / top^2 - 1.

        In terms of the angular frequency omega these are the even polynomials T_2n(omega / top).
        The caller may not use ``previous`` afterwards: it may be overwritten.
        """
        following: Array = self.matrix @ current
        following *= 4.0 / self.top**2
        following -= 2.0 * current
        following -= previous
        return following

    def _matvec(self, x: NDArray[Any]) -> NDArray[Any]:
        """Return D x, (size,) or (size, m): what ``operator @ x`` calls."""
        return np.asarray(self.matrix @ x)

    # bound to the function of this class: an array too multiplies several vectors by the matrix
    _matmat = _matvec

    def _adjoint(self) -> WaveOperator:
        """Return this operator, as D is symmetric."""
        return self


# -- arrays ----------------------------------------------------------------------------------------


def make_operator(network: ContactNetwork, progress: Progress = silent) -> WaveOperator:
    """Return D of a network: by stencils if the network has :data:`_LEAST_BALLS` balls or more and
    is an array that stencils describe (:func:`find_kinds`), else by a sparse matrix. ``progress``
    is told how far long work with D has come.
    """
    is_large = network.n_balls >= _LEAST_BALLS
    kinds = find_kinds(network) if is_large else None
    if kinds is None:
        return WaveOperator(network, progress)
    return ArrayOperator(network, kinds, progress)


def find_kinds(network: ContactNetwork) -> NDArray[np.intp] | None:
    """Return the kind (n_c,) of each contact, its row in the table of contacts of the lattice; None
    if the network is no array that stencils describe.

    The array must have all balls, at least one contact, three cells or more along each axis, and
    neither prestress nor springs to the ground. Masses must be equal, and so must moments of
    inertia. Contacts must have the directions of the lattice, each from ball i to ball j of the
    table, and arms in proportion to those of the lattice. No ball may touch another by two contacts
    of one kind.
    """
    lattice = network.lattice
    shape = network.shape
    if lattice is None or shape is None:
        return None
    is_short = min(shape) < 3  # along an axis of two cells a ball meets its neighbour twice
    is_full = network.n_balls == lattice.n_balls * math.prod(shape)
    has_contacts_alone = not network.prestress and network.on_site is None
    if is_short or not is_full or not has_contacts_alone or not network.n_contacts:
        return None
    if not _are_equal(network.masses) or not _are_equal(network.inertias):
        return None
    kinds = _find_table_rows(network, lattice, shape)
    if np.any(kinds < 0):
        return None
    # each pair of a kind and a ball i has its own number, which occurs twice if two contacts of a
    # kind begin at one ball
    kind_and_ball = kinds * network.n_balls + network.i
    if len(np.unique(kind_and_ball)) < kinds.size:
        return None
    return kinds if _is_as_tabulated(network, lattice, kinds) else None


def _is_as_tabulated(network: ContactNetwork, lattice: Lattice, kinds: NDArray[np.intp]) -> bool:
    """Return whether contacts have the directions of their ``kinds`` (n_c,) in the table of the
    ``lattice``, and arms in proportion to those of the table.
    """
    table = lattice.contacts
    normals = np.zeros((len(table), 3))
    normals[:, : table.normal.shape[1]] = table.normal
    if np.max(np.abs(network.normal - normals[kinds]), initial=0.0) > ALIKE:
        return False
    if not _are_equal(network.arm_i / table.arm_i[kinds]):
        return False
    return _are_equal(network.arm_j / table.arm_j[kinds])


def _find_table_rows(
    network: ContactNetwork, lattice: Lattice, shape: tuple[int, ...]
) -> NDArray[np.intp]:
    """Return the kind (n_c,) of each contact of an array of ``shape`` (p,) cells: the row of the
    table of contacts of the ``lattice`` that joins the same balls of the cell by the same step from
    cell to cell; -1 if no row does.
    """
    table = lattice.contacts
    n = lattice.n_balls
    tail_cells = np.stack(np.unravel_index(network.i // n, shape), axis=-1)
    head_cells = np.stack(np.unravel_index(network.j // n, shape), axis=-1)
    periods_crossed = network.shift[:, : lattice.periods]
    steps = head_cells + periods_crossed * np.array(shape) - tail_cells  # (n_c, p) cells
    kinds = np.full(network.n_contacts, -1)
    table_rows = zip(table.i.tolist(), table.j.tolist(), table.shift, strict=True)
    for kind, (i, j, shift) in enumerate(table_rows):
        joins_balls = (network.i % n == i) & (network.j % n == j)
        has_step = np.all(steps == shift, axis=1)
        kinds[joins_balls & has_step] = kind
    return kinds


def _are_equal(values: Array) -> bool:
    """Return whether all ``values`` (n,), at least one, are finite and equal but for rounding."""
    if not np.all(np.isfinite(values)):
        return False
    return bool(np.ptp(values) <= ALIKE * np.max(np.abs(values), initial=0.0))


class ArrayOperator(WaveOperator):
    """D of an array of equal masses by stencils, (rad/s)^2.

    A field is one motion of one ball of the cell, as a function of the cell. The numbers of a
    vector (size,) are in the order of fields, and within each field in the order of cells.
    ``kinds`` (n_c,) are the rows of contacts in the table of the lattice, of :func:`find_kinds`,
    which must not be None for the network.

    Attributes
    ----------
    lattice : the lattice of the array.
    cells : (p,) number of cells along each axis.
    """

    product_time: ClassVar = {1: 4e-9, 2: 1.2e-8, 3: 4e-8}
    #: stencils multiply one vector at a time, and so never need the matrix
    vectors_at_once: ClassVar = 1

    def __init__(
        self, network: ContactNetwork, kinds: NDArray[np.intp], progress: Progress = silent
    ) -> None:
        super().__init__(network, progress)
        assert network.lattice is not None  # find_kinds has required a lattice
        assert network.shape is not None  # and a shape
        self.lattice = network.lattice
        self.cells = network.shape
        self._kinds = kinds
        self._n_fields = self.lattice.n_balls * self.motions.count

    def vector(self, values: ArrayLike) -> NDArray[Any]:
        """Return the vector (size, ...) of values (n, motions, ...) of all balls, which move."""
        values = np.asarray(values)
        by_cell = values.reshape(-1, self._n_fields, *values.shape[2:])
        by_field = np.ascontiguousarray(by_cell.swapaxes(0, 1))
        return by_field.reshape(self.size, *values.shape[2:])

    def values(self, vector: ArrayLike) -> NDArray[Any]:
        """Return the values (n, motions, ...) of all balls in a vector (size, ...)."""
        vector = np.asarray(vector)
        by_cell = vector.reshape(self._n_fields, -1, *vector.shape[1:]).swapaxes(0, 1)
        return by_cell.reshape(-1, self.motions.count, *vector.shape[1:])

    @cached_property
    def _product(self) -> ContactHessian:
        """4 D / top^2 by stencils: a function of fields (fields, *cells)."""
        return self._make_product(np.ones((len(self.rows), self.network.n_contacts)))

    def _make_product(self, weights: NDArray[Any]) -> ContactHessian:
        """Return 4 A^T W A / top^2 by stencils, with the real or complex ``weights`` W (rows, n_c)
        of each kind of deformation.
        """
        springs = 4.0 / self.top**2 * self._spread_over_cells(weights)
        return ContactHessian(self._contacts, list(springs), precision=weights.dtype)

    @cached_property
    def _contacts_of_kind(self) -> list[NDArray[np.intp]]:
        """The indices of the contacts of each kind."""
        return [np.flatnonzero(self._kinds == kind) for kind in range(len(self.lattice.contacts))]

    @cached_property
    def _contacts(self) -> ContactOperator:
        """C as stencils, one for each kind of deformation and each kind of contact: the map from
        fields (fields, *cells) to deformations (stencils, *cells).
        """
        table = self.lattice.contacts
        m = self.motions.count
        n_kinds = len(table)
        # coefficients of fields (stencils, fields), of balls j in head and of balls i in tail
        head = np.zeros((len(self.rows) * n_kinds, self._n_fields))
        tail = np.zeros((len(self.rows) * n_kinds, self._n_fields))
        for number, row in enumerate(self.rows):
            table_rows = zip(
                table.i.tolist(), table.j.tolist(), self._contacts_of_kind, strict=True
            )
            for stencil, (i, j, contacts) in enumerate(table_rows, start=number * n_kinds):
                if contacts.size:  # all contacts of a kind have the coefficients of the first
                    fields_j = slice(m * j, m * (j + 1))
                    fields_i = slice(m * i, m * (i + 1))
                    head[stencil, fields_j] = row.head[contacts[0]]
                    tail[stencil, fields_i] = row.tail[contacts[0]]
        shifts = [tuple(steps) for steps in table.shift.tolist()]
        return ContactOperator(self.cells, shifts, head, tail)

    def _spread_over_cells(self, weights: NDArray[Any]) -> NDArray[Any]:
        """Return each stiffness of the contacts, times its weight among ``weights`` (rows, n_c),
        over the mass of a ball, (rad/s)^2, as an array (rows, kinds, *cells), where "rows" are
        kinds of deformation and "kinds" kinds of contact. Each contact stands at the cell of its
        ball i; the numbers are zero where two balls have no contact.
        """
        shape = (len(self.rows), len(self._contacts_of_kind), *self.cells)
        springs = np.zeros(shape, weights.dtype)
        cells = self.network.i // self.lattice.n_balls
        mass = float(self.network.masses[0])
        for number, row in enumerate(self.rows):
            stiffness = row.stiffness * weights[number] / mass
            for kind, contacts in enumerate(self._contacts_of_kind):
                springs[number, kind].reshape(-1)[cells[contacts]] = stiffness[contacts]
        return springs

    @cached_property
    def parts(self) -> Parts:
        """D as three functions; the rows (stencils x cells,) are in the order of stencils, and
        within each stencil in the order of cells.
        """
        contacts = self._contacts

        def deform(x: NDArray[Any]) -> NDArray[Any]:
            """Return the deformations (rows,) of a vector x (size,)."""
            return contacts.deform(x.reshape(self._n_fields, *self.cells)).ravel()

        def pull(tension: NDArray[Any]) -> NDArray[Any]:
            """Return the forces (size,) of the tensions (rows,) of all deformations."""
            return contacts.pull(tension.reshape(contacts.n_rows, *self.cells)).ravel()

        def weigh(weights: Array | None = None) -> Array:
            """Return the stiffnesses over the mass (rows,), (rad/s)^2, times ``weights`` (2, n_c)
            of the elongation and of the other deformations, if given.
            """
            if weights is None:
                weights = np.ones((2, self.network.n_contacts))
            weights_of_rows = np.asarray(weigh_rows(self.rows, weights))
            return self._spread_over_cells(weights_of_rows).ravel()

        return Parts(deform, pull, weigh)

    def advance(self, current: Array, previous: Array) -> Array:
        """Return T_n+1 x from ``current``, T_n x, and ``previous``, T_n-1 x: by stencils for one
        vector (size,), and by the sparse matrix of D for several (size, m); see
        :meth:`WaveOperator.advance`.
        """
        if current.ndim > 1:  # the matrix is faster, as it is read once for all vectors
            return super().advance(current, previous)
        # T_n+1 x = (4 D / top^2 - 2) T_n x - T_n-1 x
        product, _ = self._product(current.reshape(self._n_fields, *self.cells))
        following = product.ravel()
        following -= 2.0 * current
        following -= previous
        return following

    def _matvec(self, x: NDArray[Any]) -> NDArray[Any]:
        """Return D x of a real or complex vector x (size,)."""
        x = np.ravel(x)
        if np.iscomplexobj(x):
            return np.asarray(self._matvec(x.real) + 1j * self._matvec(x.imag))
        product, _ = self._product(x.reshape(self._n_fields, *self.cells))
        return np.asarray(0.25 * self.top**2 * product.ravel())  # the product is 4 D x / top^2

    def make_lossy_product(self, losses: Array) -> Callable[[Complex], Complex]:
        """Return the function that multiplies D + i A^T eta A by a vector; see
        :meth:`WaveOperator.make_lossy_product`.
        """
        weights = 1.0 + 1j * weigh_rows(self.rows, losses)
        # the product is of 4 A^T W A / top^2
        lossy_hessian = self._make_product(0.25 * self.top**2 * weights)

        def multiply(x: Complex) -> Complex:
            """Return (D + i A^T eta A) x of a vector x (size,)."""
            product, _ = lossy_hessian(x.reshape(self._n_fields, *self.cells))
            return np.asarray(product.ravel())

        return multiply
