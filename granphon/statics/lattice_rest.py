"""Rest of balls on a grid in the directions of the lattice.

Forces are found as what they have beyond y_+^(3/2), with the overlap y that the strain of the cell
gives to all contacts of a kind: these common forces balance, and are not subtracted from each
other. The problem is convex. Newton's method finds the minimum of the energy; where many contacts
are open, an interior-point method (:mod:`granphon.statics.interior`) first goes near it. Conjugate
gradients solve the linear equations of each step, no more accurately than the step needs, in single
precision as long as that serves; forces are found in double. The length of a step is chosen from
the slope of the energy along it, never from the energy itself, a large sum in which rounding hides
the changes.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray

from granphon.balls import hertz
from granphon.base.arrays import Array
from granphon.contacts import grid_loops
from granphon.contacts.assembly import ROUNDING
from granphon.statics.grid_problem import GridProblem, Unknowns
from granphon.statics.interior import approach
from granphon.statics.lattice_equations import Inverse, LatticeEquations, Preconditioners
from granphon.statics.line_search import find_length
from granphon.statics.options import RestOptions

Values = NDArray[Any]


class Place:
    """Balls on the way to rest: what their place tells of the contacts.

    Attributes
    ----------
    balls, strains : displacements (f, cells), and strains (s,).
    common : (kinds,) overlaps by the strains.
    excess : (kinds, cells) forces of contacts less those with the common overlap.
    root : (kinds, cells) h_+^(1/2), in single precision.
    """

    def __init__(
        self, problem: GridProblem, balls: Array, strains: Array, options: RestOptions
    ) -> None:
        self.problem = problem
        self.options = options
        cached = options.cached
        self.balls = balls
        self.strains = strains
        self.common = problem.find_common(strains)
        differences = problem.measure_losses(balls)
        root: Values = np.empty(differences.shape, np.float32)
        kinds, cells = differences.shape
        #: (kinds, 2) sums of excess forces and of roots; the sum of the squares of the former
        sums = np.zeros((kinds, 2))
        self.square = 0.0
        step = max(1, cached // cells) if problem.is_even else 1
        for low in range(0, kinds, step):
            rows = slice(low, low + step)
            overlap = float(self.common[low])
            for first in range(0, cells, cached):
                columns = slice(first, first + cached)
                values = differences[rows, columns]
                np.subtract(problem.offset[rows, columns], values, out=values)
                _, contact = hertz.press_further(overlap, values, values)
                root[rows, columns] = contact
                sums[rows, 0] += np.sum(values, axis=1)
                sums[rows, 1] += np.sum(contact, axis=1)
                self.square += float(np.einsum("kc,kc", values, values))
        self.excess = differences
        self.root = root
        self._sums = sums

    @cached_property
    def common_force(self) -> Array:
        """(kinds,) forces of contacts with the common overlap."""
        return np.asarray(hertz.force_of(self.common))

    @cached_property
    def force(self) -> float:
        """Mean force of all contacts."""
        kinds = len(self.common)
        return float(np.mean(self.common_force)) + float(np.sum(self._sums[:, 0])) / (
            kinds * self.problem.grid.n_cells
        )

    @cached_property
    def level(self) -> float:
        """Mean stiffness of the contacts."""
        return float(hertz.stiffness_of(np.sum(self._sums[:, 1]))) / self.excess.size

    @cached_property
    def push(self) -> Array:
        """(s,) forces on the strains, zero where they are rounding."""
        problem = self.problem
        if not problem.is_free:
            return np.zeros(0)
        cells = problem.grid.n_cells
        push = problem.work + cells * self.common_force @ problem.strained
        push = push + self._sums[:, 0] @ problem.strained
        # where overlaps are small, near the rigidity threshold and on a line, the spacing of
        # doubles at the common overlap and at the displacements is too coarse to meet the load
        largest = max(float(np.max(self.common)), float(np.max(np.abs(self.balls))))
        rounding = self.options.load_rounding * self.force + math.ulp(largest) * self.level
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
        """(f, cells) forces left on balls."""
        pull = self.problem.collect(self.excess)
        if self.uniform is not None:
            pull += self.uniform[:, None]
        return pull

    @cached_property
    def left(self) -> float:
        """Largest force left on a ball."""
        return self.problem.find_largest(self.pull)

    @cached_property
    def distance(self) -> float:
        """Force left over the scale that tolerances are of: the mean force, or the rms difference
        of the forces if that is less.
        """
        problem = self.problem
        options = self.options
        mean = float(np.sum(self._sums[:, 0])) / self.excess.size
        square = self.square / self.excess.size
        least = self.level * options.least_difference * problem.spread
        scale = min(self.force, max(math.sqrt(max(0.0, square - mean**2)), least))
        # on a line displacements add up, as in a random walk, and all that is left in the end is
        # their rounding
        moved = float(np.max(np.abs(self.balls))) if len(problem.grid.shape) == 1 else 0.0
        is_rounding = self.left <= options.move_rounding * math.ulp(moved) * self.level
        push = float(np.max(np.abs(self.push), initial=0.0)) * problem.weight
        missed = push / (problem.problem.load.cell_tolerance * self.force) if push else 0.0
        return max(0.0 if is_rounding else self.left / scale, missed)

    @property
    def is_at_rest(self) -> bool:
        """Whether the balls are at rest, and carry something."""
        return not self.carries_nothing and self.distance <= self.options.grid_tolerance

    @property
    def carries_nothing(self) -> bool:
        """Whether contacts hardly touch under a given strain."""
        if self.problem.is_free or self.force >= self.options.threshold:
            return False
        return not np.all(self.root)

    def find_overlaps(self) -> Array:
        """Return the overlaps (kinds, cells); at rest those of light contacts of balls that differ
        are not above zero: their force may be a residual only, and their stiffness would hold a
        ball.
        """
        overlap = self.problem.measure_losses(self.balls)
        np.subtract(self.problem.offset, overlap, out=overlap)
        overlap += self.common[:, None]
        if self.problem.spread and self.is_at_rest:
            light = float(hertz.overlap_of(self.options.carried * self.left))
            np.minimum(overlap, 0.0, out=overlap, where=overlap <= light)
        return np.asarray(overlap)


class LatticeSearch:
    """The search for rest on a grid in the directions of the lattice."""

    def __init__(self, problem: GridProblem, options: RestOptions) -> None:
        self.problem = problem
        self.options = options
        self.equations = LatticeEquations(problem, options)
        self.inverses = Preconditioners(problem, self.equations, options)
        self.steps = 0
        self.iterations = 0

    def place(self, balls: Array, strains: Array) -> Place:
        """Return the balls with these displacements and strains."""
        return Place(self.problem, balls, strains, self.options)

    def run(self, balls: Array | None, strains: Array) -> Place:
        """Return the balls at rest, or where the search ends without rest.

        Parameters
        ----------
        balls : displacements (f, cells) at which the search begins; None for the sites.
        strains : (s,) at which the search begins.
        """
        options = self.options
        is_fresh = balls is None
        begun = 0
        if balls is None:
            balls = np.zeros((self.problem.n_fields, self.problem.grid.n_cells))
        if self._is_near(strains):
            nearby = approach(self.equations, self.inverses, balls, strains, is_fresh)
            if nearby is not None:
                balls, strains, begun, self.iterations = nearby
        elif is_fresh:
            balls = self._begin(balls, strains)
        # linear equations need few digits, and single precision takes half of the time
        single = not begun
        tolerance = options.grid_tolerance
        before = 0.0
        self.steps = begun
        here = self.place(balls, strains)
        while self.steps < options.most_grid_steps:
            if here.carries_nothing or here.distance <= tolerance:
                break
            distance = here.distance
            reduction = options.loosest
            if before:
                reduction = min(reduction, (distance / before) ** options.progress)
            reduction = max(reduction, options.accuracy * tolerance / distance)
            precision = np.float32 if single else np.float64
            prepare = self.inverses.choose if begun else self.equations.precondition
            step, taken = self._find_step(here, precision, prepare, min(options.loosest, reduction))
            self.inverses.count(taken)
            here, length = self._search(here, step)
            self.iterations += taken
            self.steps += 1
            before = distance
            # where balls that nothing holds move far, single precision may spoil a step
            single = single and length > options.spoilt
        return here

    def _begin(self, balls: Array, strains: Array) -> Array:
        """Return the displacements at which a search from the sites begins: where all contacts are
        closed there, those that springs which are alike would bring about.

        Where some are open, balls that nothing holds stay nearer to their sites if they begin
        there.
        """
        problem = self.problem
        common = problem.find_common(strains)
        is_closed = float(np.min(common + np.min(problem.offset, axis=1))) > 0.0
        if not (problem.spread and is_closed):
            return balls
        return self.equations.green.apply(problem.collect(problem.offset), 1.0)

    def _find_step(
        self,
        here: Place,
        precision: type[Any],
        prepare: Callable[[Values], Inverse],
        reduction: float,
    ) -> tuple[Unknowns, int]:
        """Return a step of Newton's method, and the number of iterations; the roots of the place
        become stiffnesses. ``prepare`` makes the preconditioner.
        """
        stiffness = here.root.astype(precision, copy=False)
        stiffness *= hertz.stiffness_of(1.0) / here.level
        stiffness += self.options.added * min(1.0, here.distance)
        # forces and stiffnesses near one: single precision has no numbers below 1e-38
        push = float(np.max(np.abs(here.push), initial=0.0)) * self.problem.weight
        size = max(float(np.max(np.abs(here.pull))), push)
        force = Unknowns((here.pull / size).astype(precision), here.push / size)
        step, taken = self.equations.solve(stiffness, force, prepare(stiffness), reduction)
        scale = size / here.level
        balls = step.balls.astype(float)
        balls *= scale
        return Unknowns(balls, step.strains.astype(float) * scale), taken

    def _is_near(self, strains: Array) -> bool:
        """Return whether the interior-point method comes before Newton's."""
        problem = self.problem
        options = self.options
        # in space that takes too many iterations without factors
        if not problem.spread or (len(problem.grid.shape) == 3 and not self.inverses.are_small):
            return False
        common = problem.find_common(strains)
        if not problem.is_free:
            closed = np.mean(common[:, None] + problem.offset > 0.0)
            return bool(closed < options.closed_on_sites)
        force = float(np.mean(hertz.force_of(common)))
        least, most = options.interior_forces
        return bool(least <= force <= most)

    def _search(self, here: Place, step: Unknowns) -> tuple[Place, float]:
        """Return the balls after a step, and its length, of :func:`find_length`."""
        problem = self.problem
        loss = problem.add_losses(problem.measure_losses(step.balls), step.strains)
        flat = loss.reshape(-1)
        ahead = here

        def measure(length: float) -> tuple[float, Callable[[], float]]:
            nonlocal ahead
            ahead = self.place(
                here.balls + length * step.balls, here.strains + length * step.strains
            )
            slope = -_multiply(ahead.excess, loss)
            if ahead.uniform is not None:
                slope -= float(ahead.uniform @ np.sum(step.balls, axis=1))
            if problem.is_free:
                cells = problem.grid.n_cells
                common = problem.work + cells * ahead.common_force @ problem.strained
                slope -= float(step.strains @ common)
            return slope, lambda: hertz.stiffness_of(
                float(np.einsum("i,i,i", ahead.root.reshape(-1), flat, flat))
            )

        fall = _multiply(here.pull, step.balls) + float(here.push @ step.strains)
        length = find_length(measure, fall)
        return ahead, length


def _multiply(first: Values, second: Values) -> float:
    """Return the sum of products of numbers."""
    return grid_loops.multiply(first.reshape(-1), second.reshape(-1))
