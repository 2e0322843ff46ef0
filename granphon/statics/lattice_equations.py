"""The linear equations of a grid whose contacts keep the directions of the lattice, by conjugate
gradients: those of Newton's method, and those of small motions about a rest.

Where most contacts are closed, the lattice's Green's function preconditions: an iteration costs two
Fourier transforms, and few are needed. Near the rigidity threshold half of the contacts are open,
without order, and Green's function knows nothing of them. There the matrix of the closed contacts
is factorised, in single precision, which is enough for an approximation. It has few entries; in a
plane its factors have few too. They serve for all equations whose stiffnesses are not very
different.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
from numpy.typing import NDArray

from granphon.base.arrays import Array
from granphon.contacts import grid_loops
from granphon.contacts.columns import Columns
from granphon.contacts.grid import Grid
from granphon.statics.green import GreenFunction
from granphon.statics.grid_iteration import GridIteration, lay, list_balls
from granphon.statics.grid_problem import GridProblem, Unknowns, is_small
from granphon.statics.options import RestOptions
from granphon.statics.stiff_factors import factorise_stiff

Values = NDArray[Any]
#: returns approximate motions (f, cells) of balls under forces (f, cells), with the digits of
#: single precision
Inverse = Callable[[Values], Values]


class LatticeEquations:
    """The linear equations of contacts with a stiffness (kinds, cells) on a ``grid``, for
    displacements of balls and strains of the cell, by conjugate gradients; contacts lose
    ``strained`` (kinds, s) of their overlaps over each unknown of a strain.

    Attributes
    ----------
    options : the numbers of the search.
    green : Green's function of the grid.
    """

    def __init__(self, grid: Grid, strained: Array, options: RestOptions) -> None:
        self.options = options
        self.green = GreenFunction(grid, options.workers, options.grid)
        self._grid = grid
        self._runs = {
            np.dtype(float): grid.runs,
            np.dtype(np.float32): grid.runs.round(),
        }
        self._strained: dict[Any, Values] = {
            np.dtype(float): strained,
            np.dtype(np.float32): strained.astype(np.float32),
        }

    def precondition(self, stiffness: Values) -> Inverse:
        """Return an approximate inverse for displacements of contacts with a ``stiffness`` (kinds,
        cells); it works in single precision.

        Each ball moves as if its neighbours were held. Then all move by Green's function of the
        mean stiffness under the forces that are left, and then each ball again. Green's function
        carries stress across the array; single balls take account of contacts that differ. Where
        contacts are nearly alike, Green's function alone is as good, and is all that is returned.
        """
        options = self.options
        numbers = options.grid
        single = stiffness.astype(np.float32, copy=False)
        mean = float(np.mean(stiffness))
        green = self.green
        softness = 1.0 / mean
        if float(np.std(stiffness)) <= options.stiffness_spread * mean:
            return lambda force: green.apply(force.astype(np.float32, copy=False), softness)
        runs = self._runs[single.dtype]
        grid = self._grid
        d = len(grid.shape)
        blocks = np.zeros((d, d, grid.n_balls * grid.n_cells))
        grid_loops.add_blocks(self._runs[np.dtype(float)], single, blocks)
        inverse_blocks = np.empty(blocks.shape, np.float32)
        grid_loops.invert_blocks(blocks, numbers.spring * mean, numbers.damping, inverse_blocks)
        del blocks

        def apply(force: Values) -> Values:
            """Return the motion that the preconditioner makes of a ``force``, both (f, cells)."""
            pull = force.astype(np.float32, copy=False)
            motion = np.empty_like(pull)
            remaining = np.empty_like(pull)
            grid_loops.relax_balls(runs, single, inverse_blocks, pull, motion, remaining)
            motion += green.apply(remaining, softness)
            grid_loops.relax_balls_after(runs, single, inverse_blocks, pull, motion, remaining)
            return motion

        return apply

    def solve(
        self,
        stiffness: Values,
        force: Unknowns,
        inverse: Inverse,
        reduction: float,
    ) -> tuple[Unknowns, int]:
        """Return the motion of balls and strains under a ``force`` on them, and the number of
        iterations.

        Iterations, preconditioned by ``inverse`` for balls, end where the force that is left has a
        norm of at most ``reduction`` times that of ``force``, at ``options.most_iterations``, or
        where a direction has no curvature above zero. In each case the motion is that of the last
        iteration: Newton's method goes on from there. Vectors have the precision of the
        ``stiffness`` (kinds, cells).
        """
        precision = stiffness.dtype
        runs = self._runs[precision]
        strained = self._strained[precision]
        shape = force.balls.shape
        n = force.balls.size
        inverse_of_strains = self._invert_strains(stiffness)
        remaining = np.empty(n + len(force.strains), precision)
        remaining[:n] = force.balls.reshape(-1)
        remaining[n:] = force.strains
        solution = np.zeros_like(remaining)
        direction = np.zeros_like(remaining)
        # forces against a unit step along the direction
        resistance = np.empty_like(remaining)
        preconditioned = np.empty_like(remaining)
        square = grid_loops.find_scalar_product(remaining, remaining)
        largest_square = reduction**2 * square
        product = 0.0  # so that the first direction is the preconditioned force
        count = 0
        while square > largest_square and count < self.options.most_iterations:
            preconditioned[:n] = inverse(remaining[:n].reshape(shape)).reshape(-1)
            if len(inverse_of_strains):
                preconditioned[n:] = inverse_of_strains @ remaining[n:]
            product, curvature, square = grid_loops.take_conjugate_step(
                runs,
                stiffness,
                strained,
                preconditioned,
                product,
                direction,
                resistance,
                solution,
                remaining,
            )
            if curvature <= 0.0:
                break
            count += 1
        return Unknowns(solution[:n].reshape(shape), solution[n:]), count

    def _invert_strains(self, stiffness: Values) -> Array:
        """Return the inverse (s, s) of the forces on strains against strains while balls follow the
        strain, for contacts of a ``stiffness`` (kinds, cells).
        """
        strained = self._strained[np.dtype(float)]
        sums = np.sum(stiffness, axis=1, dtype=float)
        against_strains = (strained.T * sums) @ strained
        if len(against_strains) == 1:
            return np.asarray(1.0 / against_strains)
        # a pseudoinverse: contacts along few directions may not resist every strain
        return np.asarray(np.linalg.pinv(against_strains))


class LatticeIteration(GridIteration):
    """Conjugate gradients for the small motions of the balls of a ``grid`` whose contacts have a
    ``stiffness`` (kinds, cells) along their directions, of which none is spelled out. In fields,
    (f, k, cells), forces are over the mean stiffness.

    ``workers`` threads share each Fourier transform.
    """

    level = 1.0  # forces are over the mean stiffness here
    solves_together = False

    def __init__(self, grid: Grid, stiffness: Array, workers: int = 1) -> None:
        options = RestOptions(workers=workers)
        self._mean = float(np.mean(stiffness))
        self._grid = grid
        self._stiffness = stiffness / self._mean
        # over the mean, as single precision has no numbers below 1e-38
        single = self._stiffness.astype(np.float32)
        if may_factorise(grid, single, options):
            self._inverse = _factorise(grid, single, options)
        else:
            no_strains = np.zeros((grid.n_kinds, 0))
            self._inverse = LatticeEquations(grid, no_strains, options).precondition(single)

    def find_strain_forces(self, strains: Array) -> tuple[Array, Array]:
        """Return the forces (n, d, s) on balls, and those (s, s) on strains, against unit
        ``strains`` (s, 3, 3) of the cell.
        """
        grid = self._grid
        # n.E v, by which the contacts of each kind lengthen under each strain: (s, kinds)
        elongations = np.einsum("ka,sab,kb->sk", grid.normal, strains, grid.vector)
        sums = self._mean * np.sum(self._stiffness, axis=1)
        forces = np.empty((grid.n_balls * grid.n_cells, len(grid.shape), len(strains)))
        for number, elongation in enumerate(elongations):
            forces[..., number] = self.collect(self._stiffness * elongation[:, None])
        forces *= self._mean
        return forces, (elongations * sums) @ elongations.T

    def collect(self, force: Array) -> Array:
        """Return the forces (n, d) on balls that a ``force`` (kinds, cells) of contacts makes,
        above zero where balls are pushed apart.
        """
        grid = self._grid
        d = len(grid.shape)
        on_balls = np.zeros((grid.n_balls * d, grid.n_cells))
        grid_loops.add_forces(grid.runs, force, on_balls)
        return list_balls(on_balls[:, None], d)[..., 0]

    def measure(self, motions: Array) -> Array:
        """Return what contacts lose of their overlaps, (kinds, cells), by ``motions`` (n, d)."""
        grid = self._grid
        loss = np.empty(self._stiffness.shape)
        fields = lay(motions[..., None], grid.n_cells)[:, 0]
        grid_loops.measure_losses(grid.runs, fields, loss)
        return loss

    def lay_forces(self, forces: Array) -> Array:
        """Return ``forces`` (n, d, k) over the mean stiffness, in the order (f, k, cells)."""
        fields = lay(forces, self._grid.n_cells)
        fields /= self._mean
        return fields

    def list_forces(self, fields: Array) -> Array:
        """Return forces, ``fields`` (f, k, cells) over the mean stiffness, as (n, d, k)."""
        return self._mean * list_balls(fields, len(self._grid.shape))

    def list_motions(self, fields: Array) -> Array:
        """Return motions (f, k, cells) in the order (n, d, k)."""
        return list_balls(fields, len(self._grid.shape))

    def multiply(self, motions: Array, forces: Array) -> None:
        """Set ``forces`` (f, 1, cells) to those against ``motions`` (f, 1, cells), over the mean
        stiffness.
        """
        forces[:] = 0.0
        no_strains = np.zeros(0)
        balls = (motions[:, 0], no_strains, forces[:, 0], no_strains)
        grid_loops.resist(self._grid.runs, self._stiffness, *balls)

    def find_motions(self, forces: Array) -> Values:
        """Return approximate motions under ``forces`` over the mean stiffness, both (f, 1, cells),
        in single precision.
        """
        return self._inverse(forces[:, 0].astype(np.float32))[:, None]

    def find_way_down(self, search: Array | None) -> None:
        """Return None: springs along fixed directions only resist."""


def may_factorise(grid: Grid, stiffness: Values, options: RestOptions) -> bool:
    """Return whether factors of the stiff contacts are the preconditioner for a ``stiffness``
    (kinds, cells): where few contacts are stiff, if the array is small enough for factors.
    Elsewhere Green's function serves.
    """
    if not is_small(grid, options):
        return False
    is_stiff = stiffness > options.factor_stiffness * float(np.mean(stiffness))
    return float(np.mean(is_stiff)) <= options.stiff_part[len(grid.shape)]


class Preconditioners:
    """Preconditioners for the equations that a search poses one after the other.

    A matrix is factorised, or factorised anew, when the iterations since the last factorisation
    have cost more than another would. The caller reports iterations by :meth:`count`. Numbers of
    iterations alone decide, never times, so that results are the same on any machine. Nothing is
    factorised where most contacts are stiff, as Green's function serves there.
    """

    def __init__(
        self, problem: GridProblem, equations: LatticeEquations, options: RestOptions
    ) -> None:
        self._grid = problem.grid
        self._equations = equations
        self._options = options
        self._factors: Inverse | None = None
        #: cost of the iterations since the last factorisation, in iterations with Green's function
        self._spent = 0
        #: iterations of the first equations with the factors
        self._first_count: int | None = None
        #: whether stiffnesses change so much that factors pay for each of the equations anew
        self._is_changing = False

    def choose(self, stiffness: Values) -> Inverse:
        """Return a preconditioner for a ``stiffness`` (kinds, cells): by factors, which are made
        now if they are due, or by Green's function if there are none.
        """
        options = self._options
        is_due = self._is_changing or self._spent >= options.patience_of_green
        if is_due and may_factorise(self._grid, stiffness, options):
            # old factors are freed before new ones are made
            self._factors = None
            self._spent = 0
            self._first_count = None
            self._factors = _factorise(self._grid, stiffness, options)
        return self._factors or self._equations.precondition(stiffness)

    def count(self, iterations: int) -> None:
        """Count the ``iterations`` that the preconditioner chosen last has taken, and decide from
        them whether :meth:`choose` is to make new factors for the next equations.

        Factors that take many more iterations than at first are made anew. Where the additional
        iterations cost as much as factors, factors are made for each of the equations from then on.
        """
        options = self._options
        cost = options.cost_of_solution
        self._spent += iterations * (cost if self._factors else 1)
        if not self._factors:
            return
        if self._first_count is None:
            self._first_count = iterations
        n_additional = iterations - self._first_count
        if n_additional >= options.staleness:
            # the factors no longer fit the stiffnesses: new ones are due
            self._spent = max(self._spent, options.patience_of_green)
            if cost * n_additional >= options.patience_of_green:
                self._is_changing = True


def _factorise(grid: Grid, stiffness: Values, options: RestOptions) -> Inverse:
    """Return an approximate inverse for the balls of a grid with a ``stiffness`` (kinds, cells), by
    factors of the stiff contacts in single precision.
    """
    d = len(grid.shape)
    cells = grid.n_cells
    normal = np.repeat(grid.normal, cells, axis=0)
    zeros = np.zeros(stiffness.size)
    no_vectors = np.zeros((0, 3))
    columns = Columns(
        *grid.ends,
        vector=normal,  # only a strain of the cell would need its length
        normal=normal,
        arm_i=zeros,
        arm_j=zeros,
        distance=zeros,
        normal_stiffness=stiffness.ravel().astype(float),
        shear_stiffness=zeros,
        torsion_stiffness=zeros,
        bending_stiffness=zeros,
        side_stiffness=zeros,
        tangential_force=no_vectors,
        origin=no_vectors,
    )
    solve = factorise_stiff(columns, np.arange(d), grid.n_balls * cells, options)

    def apply(force: Values) -> Values:
        """Return the motion under a ``force``, both (f, cells) and of one precision."""
        by_ball = force.reshape(grid.n_balls, d, cells).swapaxes(1, 2)
        motion = solve(by_ball.reshape(-1)).reshape(grid.n_balls, cells, d)
        return np.ascontiguousarray(motion.swapaxes(1, 2), force.dtype).reshape(force.shape)

    return apply
