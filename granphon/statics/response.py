"""The linear response of balls at rest: their small motions under small forces or a strain of the
cell, and elastic tensors.

Under a unit strain E the forces B on balls are to vanish again once the balls have moved by u:
A u = -B, and the second derivative of the energy is S + B'u, with the matrices of
:mod:`granphon.contacts.tangent`. A is factorised, with a weak spring to the ground at each motion:
motions that cost nothing, of a ball that nothing holds, of balls that turn against each other like
gears, of the whole, would otherwise have no bound. The forces that the springs bear are then given
to the balls again until nothing is left of them (iterative refinement), so that no spring is left
in the result. The inertia of the factors says whether the balls are at a minimum.

Of a list that is a grid, conjugate gradients preconditioned in Fourier space
(:mod:`granphon.statics.grid_iteration`) take less time than factors, except near the rigidity
threshold. A grid may be too large for factors: conjugate gradients take less memory. Of a grid that
is not spelled out, they are the only way: the grid brings its product and its preconditioner as a
:class:`~granphon.statics.grid_iteration.GridIteration`.

Where static forces act across normals, A is not symmetric. Its antisymmetric part is about W/d of
the symmetric one: the forces that the motions of the symmetric part leave are solved for again, by
the same factors or conjugate gradients. Where balls are held by little else than forces that turn,
these rounds come no nearer, and GMRES solves the equations.
"""

from __future__ import annotations

import math
from abc import ABC, abstractmethod
from collections.abc import Callable, Iterator
from functools import cached_property
from typing import Any

import numpy as np

from granphon.base.arrays import Array
from granphon.base.errors import ConvergenceError
from granphon.contacts.contact_list import ContactList
from granphon.contacts.tangent import Tangent, find_tangent, unit_strains
from granphon.dynamics.elasticity import find_stress_part
from granphon.dynamics.factors import Factors
from granphon.statics.grid_iteration import GridIteration, TangentIteration
from granphon.statics.options import ResponseOptions


class LinearResponse(ABC):
    """Small motions of n balls at rest, with m motions each, under forces and s unit strains.

    Attributes
    ----------
    ahead : (n, m, s) B, forces on balls against unit strains.
    back : (n, m, s) B' transposed, forces on strains against unit motions.
    corner : (s, s) S, forces on strains against unit strains.

    Motions and stiffnesses are found when they are asked for.
    :class:`~granphon.base.errors.ConvergenceError` is raised if the balls are not at a minimum of
    the energy, or if the equations are not solved.
    """

    ahead: Array
    back: Array
    corner: Array

    def __init__(self, options: ResponseOptions | None) -> None:
        self._options = options or ResponseOptions()

    def find_motions(self, forces: Array) -> Array:
        """Return the motions (n, m, k) of balls under small ``forces`` (n, m, k) of k >= 1 right
        sides; the sum of the forces of each, on all balls, is zero but for rounding.
        """
        motions, _remaining = self._solve(forces, for_motions=True)
        return motions

    @property
    def motions(self) -> Array:
        """(n, m, s) motions of balls under the unit strains, beside those of the strain itself;
        found anew each time.
        """
        return self.find_motions(-self.ahead)

    @property
    def stiffness(self) -> Array:
        """(s, s) second derivatives of the energy by the strains, where balls move until they are
        in balance again; found anew each time. Of a tangent that is not symmetric, the symmetric
        part of the derivatives.
        """
        motions, remaining = self._solve(-self.ahead, for_motions=False)
        stiffness = self.corner + np.einsum("nmt,nms->ts", self.back, motions)
        # the error of the motions then enters squared, if the tangent is symmetric
        stiffness -= np.einsum("nmt,nms->ts", motions, remaining)
        return np.asarray(0.5 * (stiffness + stiffness.T))

    @abstractmethod
    def _solve(self, forces: Array, *, for_motions: bool) -> tuple[Array, Array]:
        """Return the motions under ``forces`` (n, m, k), and the forces that these leave, both of
        this shape. With ``for_motions`` the error is that which the options allow for motions;
        without, it is the larger one that they allow for an energy.
        """


class GridResponse(LinearResponse):
    """Small motions of balls on a grid of which no contact is spelled out, by conjugate gradients.

    Parameters
    ----------
    iteration : the grid's product and preconditioner.
    ahead, corner : the forces (n, m, s) on balls and (s, s) on strains against unit strains; by
        default there are no strains, and :meth:`find_motions` alone is of use.
    options : the numbers of the response.
    """

    def __init__(
        self,
        iteration: GridIteration,
        ahead: Array | None = None,
        corner: Array | None = None,
        options: ResponseOptions | None = None,
    ) -> None:
        super().__init__(options)
        self._iteration = iteration
        self.ahead = np.zeros((0, 0, 0)) if ahead is None else ahead
        self.back = self.ahead
        self.corner = np.zeros((0, 0)) if corner is None else corner

    @property
    def stiffness(self) -> Array:
        """(s, s) as :attr:`LinearResponse.stiffness`, found one strain after the other, which takes
        less memory.
        """
        stiffness = self.corner.copy()
        motions: list[Array] = []
        for strain in range(len(stiffness)):
            motion, remaining = self._solve(-self.ahead[..., strain, None], for_motions=False)
            motions.append(motion)
            for earlier, earlier_motion in enumerate(motions):
                work = np.einsum("nm,nmk->", self.back[..., earlier], motion)
                # the error of the motions then enters squared
                work -= np.einsum("nmk,nmk->", earlier_motion, remaining)
                stiffness[earlier, strain] += work
                stiffness[strain, earlier] = stiffness[earlier, strain]
        return stiffness

    def _solve(self, forces: Array, *, for_motions: bool) -> tuple[Array, Array]:
        """Return motions and remaining forces as :meth:`LinearResponse._solve` does, by conjugate
        gradients.
        """
        options = self._options
        reduction = options.reduction_of_motions if for_motions else options.reduction
        solution = self._iteration.solve(forces, reduction, options.most_iterations, options.noise)
        if not solution.has_arrived:
            raise explain_failure(solution.way_down is None)
        return solution.motions, solution.remaining


class ListResponse(LinearResponse):
    """Small motions of the balls of a list of contacts.

    Parameters
    ----------
    contacts : the list.
    strains : (s, 3, 3) unit strains of the cell, by default those in Voigt order.
    options : the numbers of the response.
    """

    def __init__(
        self,
        contacts: ContactList,
        strains: Array | None = None,
        options: ResponseOptions | None = None,
    ) -> None:
        super().__init__(options)
        units = unit_strains(contacts.dimension) if strains is None else strains
        self._contacts = contacts
        self._is_symmetric = not contacts.has_tangential_force
        self._tangent = find_tangent(contacts, units)
        self.ahead = self._tangent.blocks.ahead
        self.back = self._tangent.blocks.back
        self.corner = self._tangent.blocks.corner

    def _solve(self, forces: Array, *, for_motions: bool) -> tuple[Array, Array]:
        """Return motions and remaining forces as :meth:`LinearResponse._solve` does.

        Conjugate gradients come first for a symmetric tangent of a grid; otherwise, and where they
        do not arrive, the motions are refined in rounds.
        """
        options = self._options
        right = forces.reshape(-1, forces.shape[-1])
        answer = None
        if self._may_iterate and self._is_symmetric:
            reduction = options.reduction_of_motions if for_motions else options.reduction
            answer = self._iterate(right, reduction)
        if answer is None:
            borne = options.spring_energy_of_motions if for_motions else options.spring_energy
            answer = self._refine(right, borne)
        motions, remaining = answer
        return motions.reshape(forces.shape), remaining.reshape(forces.shape)

    # -- refinement --------------------------------------------------------------------------------

    def _refine(self, right: Array, borne: float) -> tuple[Array, Array]:
        """Return the motions (n m, k) under forces ``right`` (n m, k), and the forces that these
        leave. The forces that the motions of one round leave are solved for in the next.

        The :meth:`_list_solvers` are taken one after the other, each from motions of zero, until
        the motions of one suffice. If those of none do, the motions of the last one are returned.
        Raises ConvergenceError if these leave more than the part ``options.remainder`` of the
        forces, and more than rounding.
        """
        largest_norm = 0.0 if self._is_symmetric else self._find_largest_norm(right)
        for solve in self._list_solvers(math.sqrt(borne), largest_norm):
            motions, remaining, suffices = self._refine_with(solve, right, borne)
            if suffices:
                return motions, remaining
        largest_remainder = self._options.remainder * float(np.linalg.norm(right))
        if np.linalg.norm(remaining) > max(largest_remainder, self._find_rounding(right.size)):
            raise explain_failure(True)
        return motions, remaining

    def _refine_with(
        self, solve: Callable[[Array], Array | None], right: Array, borne: float
    ) -> tuple[Array, Array, bool]:
        """Return the motions (n m, k) that rounds find under forces ``right`` (n m, k), the forces
        (n m, k) that the motions leave, and whether the motions suffice.

        Each round solves for the forces that the rounds before have left, by ``solve``, which is
        one of the :meth:`_list_solvers`. The rounds end when :meth:`_suffices` holds with
        ``borne``, when ``solve`` finds no motions, or after ``options.rounds``. They also end when
        a round after the first leaves hardly less than the one before: its motions are then not
        added.
        """
        matrix = self._tangent.matrix
        motions = np.zeros_like(right)
        remaining = right
        for count in range(self._options.rounds):
            change = solve(remaining)
            if change is None:
                break
            next_motions = motions + change
            next_remaining = right - matrix @ next_motions
            # forces along motions that cost nothing, as balls not quite at rest leave, stay
            stalled_norm = self._options.stalled_part * float(np.linalg.norm(remaining))
            if count and float(np.linalg.norm(next_remaining)) > stalled_norm:
                break
            motions = next_motions
            remaining = next_remaining
            if self._suffices(motions, remaining, right, borne):
                return motions, remaining, True
        return motions, remaining, False

    def _suffices(self, motions: Array, remaining: Array, right: Array, borne: float) -> bool:
        """Return whether the motions (n m, k) under forces ``right`` leave little enough of these,
        the forces ``remaining``: for a symmetric tangent, forces that bear at most the part
        ``borne`` of the energy; for others, a small part of their norm.
        """
        if self._is_symmetric:
            energy = abs(float(np.sum(motions * right)))
            return abs(float(np.sum(motions * remaining))) <= borne * energy
        return float(np.linalg.norm(remaining)) <= self._find_largest_norm(right)

    def _find_largest_norm(self, right: Array) -> float:
        """Return the largest norm of the forces that motions under forces ``right`` (n m, k) may
        leave where A is not symmetric.
        """
        relative = self._options.residual * float(np.linalg.norm(right))
        return max(relative, self._find_rounding(right.size))

    def _list_solvers(
        self, reduction: float, largest_norm: float
    ) -> Iterator[Callable[[Array], Array | None]]:
        """Yield functions that find approximate motions (n m, k) under forces (n m, k), the fastest
        first: each is for cases in which the rounds with the functions before come no nearer.

        The functions are conjugate gradients on a grid, factors, and GMRES for a tangent that is
        not symmetric. Conjugate gradients lower the error to the part ``reduction``, or, where that
        takes fewer iterations, until the forces left have about the ``largest_norm``; the function
        returns None where they do not arrive.
        """
        if self._may_iterate:

            def iterate(right: Array) -> Array | None:
                """Return the motions under forces ``right`` by conjugate gradients, or None."""
                size = float(np.linalg.norm(right))
                to_norm = 0.0
                if size > largest_norm:
                    to_norm = self._options.grid.margin * largest_norm / size
                answer = self._iterate(right, max(reduction, to_norm))
                return None if answer is None else answer[0]

            yield iterate
        if self._may_factorise:
            _spring, factors = self._factors_with_springs
            yield factors.solve
        if not self._is_symmetric:
            yield self._solve_by_gmres

    # -- iterations --------------------------------------------------------------------------------

    @property
    def _may_factorise(self) -> bool:
        """Whether the matrix may be factorised: always where the list is no grid, as there is no
        other way, and up to a number of balls where it is one.
        """
        contacts = self._contacts
        return not contacts.grid or contacts.n_balls <= self._options.most_balls[contacts.dimension]

    @property
    def _may_iterate(self) -> bool:
        """Whether conjugate gradients are tried: of a grid that is well held, or too large for
        factors.
        """
        contacts = self._contacts
        if not contacts.grid:
            return False
        n_slips = len(contacts.motions.translations) - 1
        n_resisted = int(np.count_nonzero(contacts.normal_stiffness))
        n_resisted += n_slips * int(np.count_nonzero(contacts.shear_stiffness))
        n_motions = contacts.n_balls * len(contacts.axes)
        return n_resisted >= self._options.grid.rigidity * n_motions or not self._may_factorise

    @cached_property
    def _symmetric_tangent(self) -> Tangent:
        """The tangent with the symmetric part of A in place of A."""
        return self._tangent if self._is_symmetric else self._tangent.symmetrise()

    @cached_property
    def _iteration(self) -> TangentIteration:
        """Conjugate gradients with the symmetric part of A."""
        return TangentIteration(self._symmetric_tangent, options=self._options.grid)

    def _iterate(self, right: Array, reduction: float) -> tuple[Array, Array] | None:
        """Return the motions (n m, k) that conjugate gradients find with the symmetric part of A
        under forces ``right`` (n m, k), and the forces that this part leaves; the error is lowered
        to the part ``reduction``.

        None if conjugate gradients do not arrive and another way is left; ConvergenceError if no
        other way is left.
        """
        most = self._options.grid.patience if self._may_factorise else self._options.most_iterations
        forces = right.reshape(self._contacts.n_balls, -1, right.shape[-1])
        solution = self._iteration.solve(forces, reduction, most, self._options.noise)
        if solution.has_arrived:
            return solution.motions.reshape(right.shape), solution.remaining.reshape(right.shape)
        if self._is_symmetric and not self._may_factorise:
            raise explain_failure(solution.way_down is None)
        return None

    # -- factors -----------------------------------------------------------------------------------

    @cached_property
    def _level(self) -> float:
        """Mean normal stiffness of contacts, N/m; one if there is none."""
        stiffness = self._contacts.normal_stiffness
        mean = float(np.mean(stiffness)) if stiffness.size else 0.0
        return mean if 0.0 < mean < math.inf else 1.0

    def _make_held_matrix(self, entries: Array, spring: float) -> Any:
        """Return the sparse matrix (n m, n m) with ``entries`` that stand as those of A do, and
        springs to the ground at all motions.

        The stiffness of a spring is ``spring`` times the mean stiffness of contacts, and the mean
        stiffness itself at motions that no contact resists; against a rotation it is multiplied by
        the square of the mean distance of balls. The ball that resists the most along the first
        axis is held against displacements with the mean stiffness too: nothing else resists a drift
        of the whole.
        """
        contacts = self._contacts
        pattern = self._tangent.pattern
        diagonal = entries[pattern.diagonal].reshape(contacts.n_balls, -1)
        is_rotation = contacts.axes >= 3
        unit = self._level * np.where(is_rotation, float(np.mean(contacts.distance)) ** 2, 1.0)
        springs = np.where(diagonal == 0.0, 1.0, spring) * unit
        springs[np.argmax(diagonal[:, 0])] += np.where(is_rotation, 0.0, unit)
        data = entries.copy()
        data[pattern.diagonal] += springs.ravel()
        return pattern.make_matrix(data)

    @cached_property
    def _factors_with_springs(self) -> tuple[float, Factors]:
        """The stiffness of springs to the ground, over the mean of contacts, and the factors of the
        symmetric part of A with these springs. They are the weakest springs of the options with
        which that matrix is not singular.

        ConvergenceError if the matrix is singular with the strongest springs, or if the factors of
        an A that is symmetric show that the balls are at no minimum.
        """
        for spring in self._options.springs:
            matrix = self._make_held_matrix(self._symmetric_tangent.data, spring)
            try:
                factors = self._tangent.pattern.elimination.factorise(matrix)
            except RuntimeError:  # singular to the last digit
                continue
            if self._is_symmetric and factors.n_below:
                raise explain_failure(False)
            return spring, factors
        raise explain_failure(True)

    def _solve_by_gmres(self, right: Array) -> Array:
        """Return the motions (n m, k) of balls that springs hold to the ground under forces
        ``right`` (n m, k), where A is not symmetric; ConvergenceError if they are not found.

        The preconditioner follows from the symmetric part of A: its factors with these springs, or,
        where the balls are too many for factors, the preconditioner of conjugate gradients.
        """
        from scipy.sparse.linalg import LinearOperator, gmres

        if self._may_factorise:
            spring, factors = self._factors_with_springs
            invert = factors.solve
        else:
            spring = self._options.springs[0]
            shape = (self._contacts.n_balls, -1, 1)

            def invert(vector: Array) -> Array:
                """Return approximate motions (n m,) under forces (n m,)."""
                return np.ravel(self._iteration.precondition(vector.reshape(shape)))

        matrix = self._make_held_matrix(self._tangent.data, spring)
        size = len(right)
        inverse = LinearOperator((size, size), matvec=invert, dtype=np.float64)
        motions = np.empty_like(right)
        for column, forces in enumerate(right.T):
            motions[:, column], failed = gmres(
                matrix,
                forces,
                rtol=self._options.residual_of_round,
                atol=self._find_rounding(size),
                restart=min(self._options.vectors, size),
                maxiter=self._options.cycles,
                M=inverse,
            )
            if failed:
                raise explain_failure(True)
        return motions

    def _find_rounding(self, size: int) -> float:
        """Return the norm of ``size`` forces under a unit strain that are nothing but rounding:
        where balls hardly differ, the forces of the contacts of a ball cancel to rounding.
        """
        return self._options.noise * self._level * math.sqrt(size)


def find_elastic_tensor(contacts: ContactList, options: ResponseOptions | None = None) -> Array:
    """Return the elastic tensor (s, s) of balls at rest in a cell with p periods, s = p (p + 1)/2,
    in Voigt order, in the unit of stiffness over that of length to the power p - 2.

    Under a small uniform strain each ball moves and turns until it is in balance again; the energy
    that the contacts then store is the elastic energy. With static forces it is the change of the
    Cauchy stress with strain, as
    :meth:`granphon.dynamics.contact_lattice.ContactLattice.elastic_tensor` has it, of which the
    symmetric part is kept. ``options`` are the numbers of the response. Errors are those of
    :class:`LinearResponse`.
    """
    stiffness = ListResponse(contacts, options=options).stiffness / contacts.measure
    tensor = stiffness + find_stress_part(contacts.find_stress())
    return np.asarray(0.5 * (tensor + tensor.T))


def explain_failure(may_be_stable: bool) -> ConvergenceError:
    """Return the error of a response that is not found; ``may_be_stable`` says whether the balls
    may be at a minimum of the energy, and the error says so if they are not.
    """
    why = ""
    if not may_be_stable:
        why = "The forces push balls aside more than the contacts hold them: it is not stable"
    return ConvergenceError("the linear response of the sample is not found", why, "Raise the load")
