"""The way to rest of balls on a grid in the directions of the lattice, of which no contact is
spelled out.

Of each force only the excess over y_+^(3/2) is added up on balls, with the overlap y that the
strain of the cell gives to all contacts of a kind. The common forces y_+^(3/2) balance, and need
not be subtracted from each other. The problem is convex; where many contacts are open, an
interior-point method (:mod:`granphon.statics.interior`) first goes near rest. Conjugate gradients
solve the linear equations of each step, no more accurately than the step needs, in single precision
as long as that serves; forces are found in double.
"""

from __future__ import annotations

import math
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray

from granphon.balls import hertz
from granphon.base.arrays import Array
from granphon.base.errors import ConvergenceError, GranphonError
from granphon.contacts import grid_loops
from granphon.contacts.assembly import ROUNDING
from granphon.statics.descent import Descent, Trail
from granphon.statics.explanation import explain
from granphon.statics.grid_problem import GridProblem, Unknowns
from granphon.statics.interior import approach
from granphon.statics.lattice_equations import LatticeEquations, Preconditioners
from granphon.statics.options import RestOptions
from granphon.statics.rest import Rest, find_unknowns

Values = NDArray[Any]


class GridPlace:
    """Balls on the way to rest, and their contacts, in the units of :class:`GridProblem`.

    Attributes
    ----------
    problem, options : the problem, and the numbers of the search.
    balls, strains : displacements (f, cells), and strains (s,).
    common : (kinds,) overlaps that the strains make, common to all contacts of a kind.
    excess : (kinds, cells) forces of contacts less the force at the common overlap.
    root : (kinds, cells) h_+^(1/2) of the overlaps h, in single precision; zero of open contacts.
    square : sum of the squares of ``excess``.
    """

    def __init__(
        self, problem: GridProblem, balls: Array, strains: Array, options: RestOptions
    ) -> None:
        self.problem = problem
        self.options = options
        self.balls = balls
        self.strains = strains
        self.common = problem.find_common(strains)
        # losses of overlap, in place of which the excess forces are then written
        self.excess = problem.measure_losses(balls)
        self.root: Values = np.empty(self.excess.shape, np.float32)
        self.square = 0.0
        #: (kinds, 2) sums of excess forces, and of roots
        self._sums = np.zeros((len(self.common), 2))
        self._find_forces()

    def _find_forces(self) -> None:
        """Replace the losses of overlap in :attr:`excess` by the excess forces, fill :attr:`root`,
        and add up :attr:`square` and the sums over the contacts of each kind.

        As many contacts are worked on at a time as stay in the cache, of several kinds together if
        these have one common overlap.
        """
        problem = self.problem
        batch = self.options.grid.batch
        kinds, cells = self.excess.shape
        step = max(1, batch // cells) if problem.is_even else 1
        for low in range(0, kinds, step):
            rows = slice(low, low + step)
            overlap = float(self.common[low])
            for first in range(0, cells, batch):
                columns = slice(first, first + batch)
                values = self.excess[rows, columns]
                np.subtract(problem.offset[rows, columns], values, out=values)
                # values: overlaps beyond the common one before, excess forces after
                _, root = hertz.press_further(overlap, values, values)
                self.root[rows, columns] = root
                self._sums[rows, 0] += np.sum(values, axis=1)
                self._sums[rows, 1] += np.sum(root, axis=1)
                self.square += float(np.einsum("kc,kc", values, values))

    @cached_property
    def common_force(self) -> Array:
        """(kinds,) forces of contacts with the common overlap."""
        return np.asarray(hertz.force_of(self.common))

    @cached_property
    def force(self) -> float:
        """Mean force of all contacts."""
        excess = float(np.sum(self._sums[:, 0])) / self.excess.size
        return float(np.mean(self.common_force)) + excess

    @cached_property
    def level(self) -> float:
        """Mean stiffness of all contacts, open ones included."""
        return float(hertz.stiffness_of(np.sum(self._sums[:, 1]))) / self.excess.size

    @cached_property
    def common_push(self) -> Array:
        """(s,) forces left on the strains by the load and the common forces."""
        problem = self.problem
        return np.asarray(
            problem.work + problem.grid.n_cells * self.common_force @ problem.strained
        )

    @cached_property
    def push(self) -> Array:
        """(s,) forces left on the strains; zero where they are rounding."""
        problem = self.problem
        if not problem.has_free_strains:
            return np.zeros(0)
        push = self.common_push + self._sums[:, 0] @ problem.strained
        # where overlaps are small, near the rigidity threshold and on a line, the spacing of
        # doubles at the common overlap and at the displacements is too coarse to meet the load
        largest = max(float(np.max(np.abs(self.common))), float(np.max(np.abs(self.balls))))
        rounding = 8.0 * math.ulp(self.force) + math.ulp(largest) * self.level
        return np.asarray(push * (np.abs(push) * problem.weight > rounding))

    @cached_property
    def uniform(self) -> Array | None:
        """(f,) forces on the balls of each cell by the common forces; None if they balance."""
        if self.problem.balances:
            return None
        uniform = self.common_force @ self.problem.pushes
        rounding = ROUNDING * float(np.max(self.common_force))
        return np.asarray(np.where(np.abs(uniform) > rounding, uniform, 0.0))

    @cached_property
    def pull(self) -> Array:
        """(f, cells) forces left on the balls along each axis."""
        pull = self.problem.collect(self.excess)
        if self.uniform is not None:
            pull += self.uniform[:, None]
        return pull

    @cached_property
    def largest_pull(self) -> float:
        """The size of the largest force left on a ball."""
        return self.problem.find_largest_force(self.pull)

    @cached_property
    def residual(self) -> float:
        """The largest force left on a ball, over the scale to which tolerances refer: the mean
        force of contacts, or the standard deviation of their forces if that is less, but at least
        that of ``options.least_difference``; where both are zero, the mean force. If the force left
        on the strains, over the mean force and the tolerance of the cell, is larger, the residual
        is that force. What is left on balls counts as zero where it is the rounding of
        displacements (:attr:`_has_rounded_pull`). Contacts must carry something.
        """
        problem = self.problem
        options = self.options
        mean_excess = float(np.sum(self._sums[:, 0])) / self.excess.size
        # rounding may make the difference less than zero
        variance = max(0.0, self.square / self.excess.size - mean_excess**2)
        least = self.level * options.least_difference * problem.spread
        scale = min(self.force, max(math.sqrt(variance), least)) or self.force
        push = float(np.max(np.abs(self.push), initial=0.0)) * problem.weight
        of_strains = push / (problem.problem.load.cell_tolerance * self.force) if push else 0.0
        of_balls = 0.0 if self._has_rounded_pull else self.largest_pull / scale
        return max(of_balls, of_strains)

    @property
    def _has_rounded_pull(self) -> bool:
        """Whether no force is left on balls, or, on a line, none but what the rounding of
        displacements explains: there displacements add up, as in a random walk.
        """
        is_line = len(self.problem.grid.shape) == 1
        largest = float(np.max(np.abs(self.balls))) if is_line else 0.0
        return self.largest_pull <= self.options.move_rounding * math.ulp(largest) * self.level

    @property
    def carries_nothing(self) -> bool:
        """Whether contacts carry nothing. Their mean force is then zero, or the rounding of the
        common forces, as where a load that they cannot bear deforms the cell without end. Where a
        strain is given and some contacts are open, a mean force below ``options.threshold`` is
        nothing too.
        """
        if self.force <= ROUNDING * float(np.max(self.common_force)):
            return True
        if not self.problem.has_given_strain or self.force >= self.options.threshold:
            return False
        return not np.all(self.root)

    def find_overlaps(self) -> Array:
        """Return the overlaps (kinds, cells)."""
        return self.problem.find_overlaps(self.balls, self.strains)

    def find_overlaps_at_rest(self) -> Array:
        """Return the overlaps (kinds, cells) of balls at rest. Where balls differ, that of a closed
        contact is zero if its force may be nothing but a residual: its stiffness would hold a ball
        that nothing holds.
        """
        overlap = self.find_overlaps()
        if self.problem.spread:
            least = float(hertz.overlap_of(self.options.open_force * self.largest_pull))
            np.minimum(overlap, 0.0, out=overlap, where=overlap <= least)
        return overlap


class GridWay:
    """The places along a ``step`` on a grid from its ``start``, a
    :class:`~granphon.statics.line_search.Way`; the energy falls by ``fall`` per length at the
    start.
    """

    longest = math.inf

    def __init__(self, start: GridPlace, step: Unknowns) -> None:
        problem = start.problem
        self._start = start
        self._step = step
        self._loss = problem.add_losses(problem.measure_losses(step.balls), step.strains)
        self.fall = _sum_products(start.pull, step.balls) + float(start.push @ step.strains)

    def go(self, length: float) -> GridPlace:
        """Return the place at a ``length``, 1 for a whole step."""
        start = self._start
        balls = start.balls + length * self._step.balls
        strains = start.strains + length * self._step.strains
        return GridPlace(start.problem, balls, strains, start.options)

    def find_slope(self, place: GridPlace) -> float:
        """Return the derivative of the energy by the length at a ``place`` of the way."""
        slope = -_sum_products(place.excess, self._loss)
        if place.uniform is not None:
            slope -= float(place.uniform @ np.sum(self._step.balls, axis=1))
        if place.problem.has_free_strains:
            slope -= float(self._step.strains @ place.common_push)
        return slope

    def find_rise(self, place: GridPlace) -> float:
        """Return the derivative of the slope by the length at a ``place`` of the way."""
        loss = self._loss.reshape(-1)
        sum_of_roots = float(np.einsum("i,i,i", place.root.reshape(-1), loss, loss))
        return float(hertz.stiffness_of(sum_of_roots))


class GridDescent(Descent[GridPlace]):
    """The way to rest on a grid.

    Attributes
    ----------
    problem : the problem, in units of its own.
    equations, inverses : the linear equations of steps, and preconditioners for these.
    """

    def __init__(self, problem: GridProblem, options: RestOptions) -> None:
        tolerance = options.grid_tolerance
        super().__init__(options, tolerance, max(tolerance, options.negligible_force))
        # places are large, and the last one is the nearest in the end
        self.trail = Trail(keeps_nearest=False)
        self.problem = problem
        self.equations = LatticeEquations(problem.grid, problem.strained, options)
        self.inverses = Preconditioners(problem, self.equations, options)
        #: whether the interior-point method has led near rest before Newton's method
        self._began_inside = False
        #: whether equations are solved in single precision: few digits are needed, and single
        #: precision takes half of the time
        self._is_single = True
        #: the residual before the last step, 0 at first
        self._last_residual = 0.0

    @property
    def needs_more_load(self) -> bool:
        """Whether the way is to begin at rest under a larger load."""
        return self.problem.needs_more_load(self.options)

    def begin(self, start: Rest | None) -> GridPlace:
        """Return the place at which the way begins.

        The balls are first put at the displacements and strains of ``start``. Without a start, or
        if the balls do not differ, they are put on their sites. Where the interior-point method
        serves, it leads from there to a place near rest, and its steps and iterations are counted;
        if it finds no rest, the first place stays. Where it does not serve, balls on their sites
        are moved by :meth:`_find_first_displacements`.
        """
        problem = self.problem
        balls = np.zeros((problem.n_fields, problem.grid.n_cells))
        strains = problem.find_strains()
        is_fresh = start is None or not problem.spread
        if start is not None and problem.spread:
            unknowns = find_unknowns(problem.problem, start)
            strains = unknowns[problem.problem.n_ball_unknowns :] / problem.unit
            balls = problem.lay(start.displacement)
        if problem.begins_inside(strains, self.options):
            nearby = approach(problem, self.equations, self.inverses, balls, strains, is_fresh)
            if nearby is not None:
                balls = nearby.balls
                strains = nearby.strains
                self.steps = nearby.steps
                self.iterations = nearby.iterations
                self._began_inside = self.steps > 0
                self._is_single = not self._began_inside
        elif is_fresh:
            balls = self._find_first_displacements(strains)
        return GridPlace(problem, balls, strains, self.options)

    def _is_stuck(self, place: GridPlace) -> bool:
        """Return whether contacts carry nothing, so that there is no rest under load, or the cell
        has deformed beyond the range of numbers, as under a load that contacts cannot bear.
        """
        return place.carries_nothing or not math.isfinite(place.force)

    def _advance(self, place: GridPlace) -> GridPlace:
        """Return the place after a step of Newton's method, of a length at which the slope of the
        energy is small.
        """
        options = self.options
        residual = place.residual
        step, n_iterations = self._find_step(place, self._choose_reduction(residual))
        self.inverses.count(n_iterations)
        # near rest, where the residual no longer falls, slopes are rounding, and a line search
        # would stay where it is
        is_rounding = residual < options.rounding_residual and self.trail.is_level
        part = 1.0 if is_rounding else options.slope
        ahead, length = self._follow(GridWay(place, step), part)
        self.iterations += n_iterations
        self._last_residual = residual
        # where balls that nothing holds move far, single precision may spoil a step
        self._is_single = self._is_single and length > options.single_length
        return ahead

    def _choose_reduction(self, residual: float) -> float:
        """Return the relative residual at which the linear equations of a step from a place with a
        ``residual`` end: the less the faster the residual falls, but no less than rest needs.
        """
        options = self.options
        reduction = options.largest_reduction
        if self._last_residual:
            reduction = (residual / self._last_residual) ** options.progress
        least = options.grid.margin * self.tolerance / residual
        return min(options.largest_reduction, max(reduction, least))

    def _finish(self, place: GridPlace) -> Rest:
        """Return the state of a place that is at rest."""
        return self._make_state(place, place.find_overlaps_at_rest())

    def _make_state(self, place: GridPlace, overlap: Array) -> Rest:
        """Return the state of a place, in SI units. The ``overlap`` (kinds, cells) of contacts, in
        the unit of the grid, is converted in place, and its array belongs to the state.
        """
        on_grid = self.problem
        problem = on_grid.problem
        assembly = problem.assembly
        overlap *= on_grid.unit
        closed_part = float(np.mean(overlap > 0.0))
        residual = math.inf
        # where contacts carry nothing, rounding may leave some of them closed
        if closed_part and place.force > 0.0:
            # over the mean force of closed contacts
            residual = place.largest_pull / place.force * closed_part
        p = assembly.periods
        strain = np.einsum("s,sab->ab", on_grid.unit * place.strains, problem.unit_strains)
        return Rest(
            displacement=on_grid.list_displacements(place.balls),
            wall_motion=np.zeros(0),
            strain=(strain + problem.given_strain)[:p, :p],
            overlap=overlap.ravel(),
            assembly=assembly,
            residual=residual,
            steps=self.steps,
            iterations=self.iterations,
        )

    def _explain_failure(self, place: GridPlace) -> GranphonError:
        """Return the error of a way that has not led to rest; a ConvergenceError has the state at
        its end as ``reached``.
        """
        rest = self._make_state(place, place.find_overlaps())
        problem = self.problem.problem
        error = explain(
            problem, self.options, is_open=place.carries_nothing, residual=rest.residual
        )
        if isinstance(error, ConvergenceError):
            error.reached = rest
        return error

    def _find_first_displacements(self, strains: Array) -> Array:
        """Return the displacements (f, cells) at which a way without a start begins, at ``strains``
        (s,) of the cell.

        Where all contacts are closed on the sites, these are the displacements at rest of equal
        springs in place of the contacts. Where some contacts are open, or balls do not differ, the
        displacements are zero: balls that nothing holds stay nearer to their sites if they begin
        there.
        """
        problem = self.problem
        common = problem.find_common(strains)
        is_closed = float(np.min(common + np.min(problem.offset, axis=1))) > 0.0
        if not (problem.spread and is_closed):
            return np.zeros((problem.n_fields, problem.grid.n_cells))
        return self.equations.green.apply(problem.collect(problem.offset), 1.0)

    def _find_step(self, place: GridPlace, reduction: float) -> tuple[Unknowns, int]:
        """Return a step of Newton's method from a ``place``, and the number of iterations. The
        iterations end where the part ``reduction`` of the right side of the equations is left.

        In single precision the stiffnesses are made where the roots of the place are stored, which
        are lost: a large array is not kept twice.
        """
        precision: type[Any] = np.float32 if self._is_single else np.float64
        prepare = self.inverses.choose if self._began_inside else self.equations.precondition
        stiffness = place.root.astype(precision, copy=False)
        stiffness *= hertz.stiffness_of(1.0) / place.level
        stiffness += self.options.added_stiffness * min(1.0, place.residual)
        # forces and stiffnesses near one: single precision has no numbers below 1e-38
        push = float(np.max(np.abs(place.push), initial=0.0)) * self.problem.weight
        size = max(float(np.max(np.abs(place.pull))), push)
        force = Unknowns((place.pull / size).astype(precision), place.push / size)
        step, n_iterations = self.equations.solve(stiffness, force, prepare(stiffness), reduction)
        scale = size / place.level
        balls = step.balls.astype(float)
        balls *= scale
        return Unknowns(balls, step.strains.astype(float) * scale), n_iterations


def _sum_products(first: Values, second: Values) -> float:
    """Return the sum of the products of the entries of two arrays of one shape."""
    return grid_loops.find_scalar_product(first.reshape(-1), second.reshape(-1))
