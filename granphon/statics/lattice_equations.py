"""The linear equations of Newton's method on a grid whose contacts keep the directions of the
lattice, by conjugate gradients.

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

from granphon.contacts import grid_loops
from granphon.contacts.columns import Columns
from granphon.statics.green import GreenFunction
from granphon.statics.grid_problem import GridProblem, Unknowns
from granphon.statics.options import RestOptions
from granphon.statics.stiff_factors import factorise_stiff

Values = NDArray[Any]
#: finds about the motions (f, cells) of balls under forces (f, cells)
Inverse = Callable[[Values], Values]


class LatticeEquations:
    """The linear equations of a stiffness (kinds, cells) on a grid, for displacements of balls and
    strains of the cell, by conjugate gradients.
    """

    def __init__(self, problem: GridProblem, options: RestOptions) -> None:
        self.problem = problem
        self.options = options
        self.green = GreenFunction(problem.grid, options.workers, options.grid)
        self._runs = {
            np.dtype(float): problem.grid.runs,
            np.dtype(np.float32): problem.grid.runs.round(),
        }
        self._strained = {
            np.dtype(float): problem.strained,
            np.dtype(np.float32): problem.strained.astype(np.float32),
        }

    def precondition(self, stiffness: Values) -> Inverse:
        """Return an approximate inverse for displacements, as precise as the ``stiffness``.

        Each ball moves as if its neighbours were held, then all move by Green's function of the
        mean stiffness under what that leaves, and then each ball again. Green's function carries
        stress across the array; single balls take account of contacts that differ. Where contacts
        are nearly alike, Green's function alone is as good.
        """
        options = self.options
        numbers = options.grid
        mean = float(np.mean(stiffness))
        green = self.green
        softness = 1.0 / mean
        if float(np.std(stiffness)) <= options.even * mean:
            return lambda force: green.apply(force, softness)
        runs = self._runs[stiffness.dtype]
        d = len(self.problem.grid.shape)
        balls = self.problem.n_fields // d * self.problem.grid.n_cells
        blocks = np.zeros((d, d, balls))
        grid_loops.add_blocks(self._runs[np.dtype(float)], stiffness, blocks)
        alone = np.empty(blocks.shape, stiffness.dtype)
        grid_loops.invert_blocks(blocks, numbers.holding * mean, numbers.damped, alone)
        del blocks

        def apply(force: Values) -> Values:
            """Return the motion that the preconditioner makes of a ``force``, both (f, cells)."""
            motion = np.zeros(force.shape, force.dtype)
            remaining = np.empty_like(force)
            grid_loops.add_alone(alone, force, motion)
            grid_loops.leave(runs, stiffness, force, motion, remaining)
            motion += green.apply(remaining, softness)
            grid_loops.leave(runs, stiffness, force, motion, remaining)
            grid_loops.add_alone(alone, remaining, motion)
            return motion

        return apply

    def solve(
        self,
        stiffness: Values,
        force: Unknowns,
        inverse: Inverse,
        reduction: float,
    ) -> tuple[Unknowns, int]:
        """Return the motion of balls and strains under a ``force``, and the number of iterations.

        Iterations, preconditioned by ``inverse`` for balls, end where the force that is left has a
        norm of at most ``reduction`` times that of ``force``, at ``options.most_iterations``, or
        where a direction has no curvature above zero. The motion is then what has been found:
        Newton's method goes on from there. Vectors have the precision of the ``stiffness`` (kinds,
        cells).
        """
        precision = stiffness.dtype
        runs = self._runs[precision]
        strained = self._strained[precision]
        shape = force.balls.shape
        n = force.balls.size
        of_strains = np.zeros((0, 0))
        if len(force.strains):
            sums = np.sum(stiffness, axis=1, dtype=float)
            of_strains = (self.problem.strained.T * sums) @ self.problem.strained
            # a pseudoinverse: contacts along few directions may not resist every strain
            of_strains = np.linalg.pinv(of_strains) if len(of_strains) > 1 else 1.0 / of_strains
        remaining = np.empty(n + len(force.strains), precision)
        remaining[:n] = force.balls.reshape(-1)
        remaining[n:] = force.strains
        solution = np.zeros_like(remaining)
        way = np.zeros_like(remaining)
        change = np.empty_like(remaining)
        better = np.empty_like(remaining)
        square = grid_loops.multiply(remaining, remaining)
        aim = reduction**2 * square
        product = 0.0
        count = 0
        while square > aim and count < self.options.most_iterations:
            better[:n] = inverse(remaining[:n].reshape(shape)).reshape(-1)
            if len(of_strains):
                better[n:] = of_strains @ remaining[n:]
            product, curvature, square = grid_loops.go_on(
                runs,
                stiffness,
                strained,
                better,
                product,
                way,
                change,
                solution,
                remaining,
            )
            if curvature <= 0.0:
                break
            count += 1
        return Unknowns(solution[:n].reshape(shape), solution[n:]), count


class Preconditioners:
    """Preconditioners for the equations that a search poses one after the other.

    A matrix is factorised, or factorised anew, when the iterations since the last factorisation
    have cost more than another would. The caller reports iterations by :meth:`count`. Their numbers
    alone decide, never times, so that results are the same on any machine. Nothing is factorised
    where most contacts are stiff, as Green's function serves there.
    """

    def __init__(
        self, problem: GridProblem, equations: LatticeEquations, options: RestOptions
    ) -> None:
        self._problem = problem
        self._equations = equations
        self._options = options
        d = len(problem.grid.shape)
        #: whether the array is small enough for factors
        self.are_small = problem.grid.n_cells * problem.grid.n_balls <= options.most_factorised[d]
        self._most_stiff = options.most_stiff[d]
        self._factors: Inverse | None = None
        #: cost of the iterations since the last factorisation, in iterations with Green's function
        self._spent = 0
        #: iterations of the first equations with the factors
        self._first: int | None = None
        #: whether stiffnesses change so much that factors pay for each of the equations anew
        self._changing = False

    def choose(self, stiffness: Values) -> Inverse:
        """Return a preconditioner for a ``stiffness`` (kinds, cells): by factors, which are made
        now if they are due, or by Green's function if there are none.
        """
        options = self._options
        is_due = self._changing or self._spent >= options.patience_of_green
        if is_due and self.are_small:
            is_stiff = stiffness > options.stiff * float(np.mean(stiffness))
            if float(np.mean(is_stiff)) <= self._most_stiff:
                # old factors are freed before new ones are made
                self._factors = None
                self._spent = 0
                self._first = None
                self._factors = _factorise(self._problem, stiffness, options)
        return self._factors or self._equations.precondition(stiffness)

    def count(self, iterations: int) -> None:
        """Count the iterations that the preconditioner chosen last has taken."""
        options = self._options
        cost = options.cost_of_solution
        self._spent += iterations * (cost if self._factors else 1)
        if not self._factors:
            return
        if self._first is None:
            self._first = iterations
        additional = iterations - self._first
        if additional >= options.stale:
            # the factors no longer fit the stiffnesses: new ones are due
            self._spent = max(self._spent, options.patience_of_green)
            if cost * additional >= options.patience_of_green:
                self._changing = True


def _factorise(problem: GridProblem, stiffness: Values, options: RestOptions) -> Inverse:
    """Return an approximate inverse for the balls of a grid with a ``stiffness`` (kinds, cells), by
    factors of its stiff contacts.
    """
    grid = problem.grid
    d = len(grid.shape)
    cells = grid.n_cells
    normal = np.repeat(grid.normal, cells, axis=0)
    nothing = np.zeros(stiffness.size)
    none = np.zeros((0, 3))
    columns = Columns(
        *grid.ends,
        vector=normal,
        normal=normal,
        arm_i=nothing,
        arm_j=nothing,
        distance=nothing,
        normal_stiffness=stiffness.ravel().astype(float),
        shear_stiffness=nothing,
        torsion_stiffness=nothing,
        bending_stiffness=nothing,
        side_stiffness=nothing,
        tangential_force=none,
        origin=none,
    )
    solve = factorise_stiff(columns, np.arange(d), grid.n_balls * cells, options)

    def apply(force: Values) -> Values:
        """Return the motion under a ``force``, both (f, cells) and of one precision."""
        by_ball = force.reshape(grid.n_balls, d, cells).swapaxes(1, 2)
        motion = solve(by_ball.reshape(-1)).reshape(grid.n_balls, cells, d)
        return np.ascontiguousarray(motion.swapaxes(1, 2), force.dtype).reshape(force.shape)

    return apply
