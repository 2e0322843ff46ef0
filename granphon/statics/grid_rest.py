"""Rest in the directions of the lattice of an array whose contacts are a grid.

The overlap of a contact is h = y + o - n.(u_j - u_i), with y by the strain of the cell, which all
contacts of a kind share, and the overlap o on the sites. Forces are found as what they have beyond
y_+^(3/2): these common forces balance, and are not subtracted from each other. No contact is
spelled out (:mod:`granphon.contacts.grid_loops`).

Newton's method finds the minimum of the energy; where many contacts are open, an interior-point
method (:mod:`granphon.statics.interior`) first goes near it. Conjugate gradients solve the linear
equations of each step, no more accurately than the step needs, in single precision as long as that
serves; forces are found in double. The length of a step is chosen from the slope of the energy
along it, never from the energy itself, a large sum in which rounding hides the changes.

Lengths are over a power of two near the spread of the overlaps on the sites, forces over those of
Hertz's law for this overlap.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from functools import cached_property
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from granphon.balls import hertz
from granphon.base.arrays import Array
from granphon.contacts import grid_loops
from granphon.contacts.columns import Columns
from granphon.contacts.grid import Grid
from granphon.contacts.tangent import fill_blocks, find_pattern
from granphon.dynamics.factors import factorise
from granphon.statics.configuration import Problem
from granphon.statics.green import GreenFunction
from granphon.statics.interior import approach
from granphon.statics.options import RestOptions

Values = NDArray[Any]
#: rms of the overlaps on the sites of a plane of balls whose diameters are spread evenly over a
#: width, times which it is that width
_WIDTH_OVER_RMS = math.sqrt(24.0)


def dot(first: Values, second: Values) -> float:
    """Return the sum of products, without BLAS: its threads wait for each other, and their number
    changes the last digit.
    """
    return float(np.einsum("i,i", first.reshape(-1), second.reshape(-1)))


class Unknowns(NamedTuple):
    """Displacements of balls (f, cells), and strains (s,) of the cell; or the forces on them."""

    balls: Values
    strains: Values


class GridProblem:
    """A problem on a grid, in its own units.

    Attributes
    ----------
    offset : (kinds, cells) overlaps on the sites.
    given : (kinds,) overlaps that a given strain makes.
    strained : (kinds, s) what contacts lose of their overlaps by unit strains.
    work : (s,) forces of the load on strains.
    unit : of lengths, m.
    """

    def __init__(self, problem: Problem, coefficient: float) -> None:
        assembly = problem.assembly
        grid = assembly.lattice_grid
        self.problem = problem
        self.grid: Grid = grid
        self.n_fields = grid.n_balls * len(grid.shape)
        offset = assembly.offset.reshape(grid.n_kinds, grid.n_cells)
        self.spread = float(np.std(offset))
        normal = grid.normal
        strained = np.einsum("ka,sab,kb->ks", normal, problem.unit_strains, grid.vector)
        given = -np.einsum("ka,ab,kb->k", normal, problem.given_strain, grid.vector)
        stress = problem.load.stress
        work = np.zeros(strained.shape[1])
        if stress is not None:
            work = problem.find_work(stress)
        if problem.load.mean_force is not None:
            work = -problem.load.mean_force * grid.n_cells * np.sum(strained, axis=0)
        length = _WIDTH_OVER_RMS * self.spread
        if not length:
            length = float(np.max(given, initial=0.0))
            if len(work):
                force = float(np.max(np.abs(work) / (grid.n_cells * np.sum(strained, axis=0))))
                length = (force / coefficient) ** (1.0 / hertz.EXPONENT)
        self.unit = 2.0 ** round(math.log2(length)) if 0.0 < length < math.inf else 1.0
        self.force_unit = coefficient * self.unit**hertz.EXPONENT
        self.offset = offset if self.unit == 1.0 else offset / self.unit
        self.spread /= self.unit
        self.given = given / self.unit
        self.strained = strained
        self.work = work / self.force_unit
        self.is_free = len(work) > 0
        #: directions in which the kinds of contacts push the balls of a cell, (kinds, f)
        pushes = np.zeros((grid.n_kinds, grid.n_balls, len(grid.shape)))
        kinds = np.arange(grid.n_kinds)
        along = normal[:, : len(grid.shape)]
        np.add.at(pushes, (kinds, grid.j), along)
        np.add.at(pushes, (kinds, grid.i), -along)
        self.pushes = pushes.reshape(grid.n_kinds, -1)

    @property
    def n_contacts(self) -> int:
        """Number of contacts."""
        return self.offset.size

    @cached_property
    def weight(self) -> float:
        """What makes the force on a strain one on each contact."""
        if not self.is_free:
            return 0.0
        return 1.0 / (self.grid.n_cells * float(np.max(np.sum(np.abs(self.strained), axis=0))))

    def find_common(self, strains: Array) -> Array:
        """Return the overlaps (kinds,) that strains (s,) make."""
        return np.asarray(self.given - self.strained @ strains)

    def measure_losses(self, balls: Values) -> Values:
        """Return (kinds, cells) losses of overlap by displacements (f, cells)."""
        loss = np.empty(self.offset.shape, balls.dtype)
        grid_loops.measure_losses(self.grid.runs, balls, loss)
        return loss

    def add_losses(self, loss: Values, strains: Array) -> Values:
        """Add to losses (kinds, cells) those by strains (s,)."""
        if len(strains):
            loss += (self.strained @ strains)[:, None]
        return loss

    def collect(self, force: Values) -> Values:
        """Return the forces on balls (f, cells) by those of contacts (kinds, cells)."""
        on_balls = np.zeros((self.n_fields, self.grid.n_cells), force.dtype)
        grid_loops.add_forces(self.grid.runs, force, on_balls)
        return on_balls

    def find_largest(self, on_balls: Values) -> float:
        """Return the size of the largest of the forces (f, cells) on balls."""
        d = len(self.grid.shape)
        squares = np.einsum("bac,bac->bc", *(2 * [on_balls.reshape(-1, d, self.grid.n_cells)]))
        return math.sqrt(float(np.max(squares)))

    def centre(self, balls: Array) -> Array:
        """Return displacements (f, cells) less their mean."""
        fields = balls.reshape(self.grid.n_balls, -1, self.grid.n_cells)
        return np.asarray((fields - np.mean(fields, axis=(0, 2), keepdims=True)).reshape(balls.shape))


class GridEquations:
    """The linear equations of a stiffness (kinds, cells) on a grid, for displacements of balls and
    strains of the cell, by conjugate gradients.
    """

    def __init__(self, problem: GridProblem, options: RestOptions) -> None:
        self._problem = problem
        self._options = options
        self.green = GreenFunction(problem.grid)
        self._runs = {
            np.dtype(float): problem.grid.runs,
            np.dtype(np.float32): problem.grid.runs.round(),
        }
        self._strained = {
            np.dtype(float): problem.strained,
            np.dtype(np.float32): problem.strained.astype(np.float32),
        }

    def precondition(self, stiffness: Values) -> Callable[[Values], Values]:
        """Return an approximate inverse for displacements, as precise as the ``stiffness``.

        Each ball moves as if its neighbours were held, then all move by Green's function of the
        mean stiffness under what that leaves, and then each ball again. Green's function carries
        stress across the array; single balls take account of contacts that differ. Where contacts
        are nearly alike, Green's function alone is as good.
        """
        options = self._options
        mean = float(np.mean(stiffness))
        green = self.green
        softness = 1.0 / mean
        if float(np.std(stiffness)) <= options.even * mean:
            return lambda force: green.apply(force, softness)
        runs = self._runs[stiffness.dtype]
        d = len(self._problem.grid.shape)
        balls = self._problem.n_fields // d * self._problem.grid.n_cells
        blocks = np.zeros((d, d, balls))
        grid_loops.add_blocks(self._runs[np.dtype(float)], stiffness, blocks)
        alone = np.empty(blocks.shape, stiffness.dtype)
        grid_loops.invert_blocks(blocks, options.hold_single * mean, options.damped, alone)
        del blocks

        def apply(force: Values) -> Values:
            motion = np.empty_like(force)
            remaining = np.empty_like(force)
            grid_loops.move_alone(runs, stiffness, alone, force, motion, remaining)
            motion += green.apply(remaining, softness)
            grid_loops.move_again(runs, stiffness, alone, force, motion, remaining)
            return motion

        return apply

    def solve(
        self,
        stiffness: Values,
        force: Unknowns,
        inverse: Callable[[Values], Values],
        reduction: float,
    ) -> tuple[Unknowns, int]:
        """Return the motion under a ``force``, with a residual that has fallen by ``reduction``, and
        the number of iterations; vectors have the precision of the ``stiffness``.

        Where iterations end at their largest number, Newton's method goes on from there.
        """
        precision = stiffness.dtype
        runs = self._runs[precision]
        strained = self._strained[precision]
        shape = force.balls.shape
        n = force.balls.size
        of_strains = np.zeros((0, 0))
        if len(force.strains):
            sums = np.sum(stiffness, axis=1, dtype=float)
            of_strains = np.linalg.inv((self._problem.strained.T * sums) @ self._problem.strained)
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
        while square > aim and count < self._options.most_on_grid:
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


class Place:
    """Balls on the way to rest: what their place tells of the contacts.

    Attributes
    ----------
    balls, strains : displacements (f, cells), and strains (s,).
    common : (kinds,) overlaps by the strains.
    excess : (kinds, cells) forces of contacts less those with the common overlap.
    root : (kinds, cells) h_+^(1/2), in single precision.
    """

    def __init__(self, problem: GridProblem, balls: Array, strains: Array, cached: int) -> None:
        self.problem = problem
        self.balls = balls
        self.strains = strains
        self.common = problem.find_common(strains)
        differences = problem.measure_losses(balls)
        root: Values = np.empty(differences.shape, np.float32)
        kinds, cells = differences.shape
        #: (kinds, 2) sums of excess forces and of roots; the sum of the squares of the former
        sums = np.zeros((kinds, 2))
        self.square = 0.0
        step = max(1, cached // cells) if not np.ptp(self.common) else 1
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
        rounding = _LOAD_ROUNDING * self.force + math.ulp(largest) * self.level
        return push * (np.abs(push) * problem.weight > rounding)

    @cached_property
    def pull(self) -> Array:
        """(f, cells) forces left on balls."""
        problem = self.problem
        pull = problem.collect(self.excess)
        uniform = self.common_force @ problem.pushes
        largest = float(np.max(self.common_force))
        if float(np.max(np.abs(uniform))) > _LOAD_ROUNDING * 1e3 * largest:
            d = len(problem.grid.shape)
            pull.reshape(-1, problem.grid.n_cells)[:] += uniform.reshape(-1, d).ravel()[:, None]
        return pull

    @cached_property
    def left(self) -> float:
        """Largest force left on a ball."""
        return self.problem.find_largest(self.pull)

    def find_distance(self, least: float, move_rounding: float) -> float:
        """Return the force left over the scale that tolerances are of; forces no larger than the
        stiffness times ``least`` count as that.
        """
        problem = self.problem
        mean = float(np.sum(self._sums[:, 0])) / self.excess.size
        square = self.square / self.excess.size
        scale = min(self.force, max(math.sqrt(max(0.0, square - mean**2)), self.level * least))
        # on a line displacements add up, as in a random walk, and all that is left in the end is
        # their rounding
        moved = float(np.max(np.abs(self.balls))) if len(problem.grid.shape) == 1 else 0.0
        at_rest = self.left <= move_rounding * math.ulp(moved) * self.level
        # the load itself is met to more digits: it is a number that the user gave
        push = float(np.max(np.abs(self.push), initial=0.0)) * problem.weight
        missed = push / (problem.problem.load.cell_tolerance * self.force) if push else 0.0
        return max(0.0 if at_rest else self.left / scale, missed)


_LOAD_ROUNDING = 1e-15


class GridInverses:
    """Preconditioners for the equations that a search poses one after the other.

    They count iterations: the matrix is factorised, or factorised anew, when those since the last
    factorisation cost more than it would. Numbers of iterations alone decide, never times, so that
    results are the same on any machine. It is not factorised where most contacts are stiff.
    """

    def __init__(
        self, problem: GridProblem, equations: GridEquations, options: RestOptions
    ) -> None:
        self._problem = problem
        self._equations = equations
        self._options = options
        d = len(problem.grid.shape)
        #: whether the array is small enough for factors
        self.are_small = (
            problem.grid.n_cells * problem.grid.n_balls <= options.most_factorised[d]
        )
        self._most_stiff = options.most_stiff[d]
        self._factors: Callable[[Values], Values] | None = None
        self._spent = 0
        #: iterations of the first equations with the factors
        self._first: int | None = None
        #: whether stiffnesses change so much that factors pay for each of the equations anew
        self._changing = False

    def choose(self, stiffness: Values) -> Callable[[Values], Values]:
        """Return a preconditioner for a ``stiffness`` (kinds, cells)."""
        options = self._options
        is_due = self._changing or self._spent >= options.patience_of_green
        if is_due and self.are_small:
            is_stiff = stiffness > options.stiff * float(np.mean(stiffness))
            if float(np.mean(is_stiff)) <= self._most_stiff:
                # old factors are freed before new ones are made
                self._factors = None
                self._spent = 0
                self._first = None
                self._factors = factorise_stiff(self._problem, stiffness, is_stiff, options)
        return self._factors or self._equations.precondition(stiffness)

    def count(self, iterations: int) -> None:
        """Count the iterations that the preconditioner chosen last has taken."""
        options = self._options
        cost = options.cost_of_solution
        self._spent += iterations * (cost if self._factors else 1)
        if self._factors:
            self._first = iterations if self._first is None else self._first
            more = iterations - self._first
            if more >= options.stale:
                self._changing |= cost * more >= options.patience_of_green
                self._spent = max(self._spent, options.patience_of_green)


def factorise_stiff(
    problem: GridProblem, stiffness: Values, is_stiff: NDArray[np.bool_], options: RestOptions
) -> Callable[[Values], Values]:
    """Return an approximate inverse of the tangent of a ``stiffness`` (kinds, cells), by factors of
    the contacts that are stiff; others enter by their part of the diagonal only.

    It is symmetric but for rounding, and positive definite. Forces and motions are (f, cells).
    """
    grid = problem.grid
    d = len(grid.shape)
    cells = grid.n_cells
    count = grid.n_balls * cells
    mean = float(np.mean(stiffness))
    i, j = grid.list_ends()
    chosen = np.flatnonzero(is_stiff)
    i = i[chosen]
    j = j[chosen]
    normal = np.zeros((len(chosen), 3))
    normal[:] = grid.normal[chosen // cells]
    blocks = np.zeros((d, d, count))
    soft = np.where(is_stiff, 0.0, stiffness)
    grid_loops.add_blocks(grid.runs, soft, blocks)
    axes = np.arange(d)
    springs = blocks[axes, axes] + options.hold_diagonal * mean
    nothing = np.zeros(len(chosen))
    none = np.zeros((0, 3))
    columns = Columns(
        i=i,
        j=j,
        vector=normal,
        normal=normal,
        arm_i=nothing,
        arm_j=nothing,
        distance=nothing,
        normal_stiffness=stiffness.ravel()[chosen].astype(float),
        shear_stiffness=nothing,
        torsion_stiffness=nothing,
        bending_stiffness=nothing,
        side_stiffness=nothing,
        tangential_force=none,
        origin=none,
    )
    tangent = fill_blocks(columns, axes, np.zeros((0, 3, 3)), count)
    tangent.diagonal[axes, axes] += springs
    pattern = find_pattern(i, j, count, d)
    data = tangent.list_entries(pattern)
    scale = 1.0 / np.sqrt(data[pattern.diagonal])
    matrix = pattern.make_matrix(data)
    widths = np.diff(matrix.indptr)
    matrix.data *= scale[matrix.indices] * np.repeat(scale, widths)
    matrix.data[pattern.diagonal] += options.hold_scaled
    factors = factorise(matrix, approximate=True)

    def apply(force: Values) -> Values:
        by_ball = force.reshape(grid.n_balls, d, cells).swapaxes(1, 2).ravel()
        scaled = scale * by_ball
        # single precision has no numbers below 1e-38
        largest = float(np.max(np.abs(scaled))) or 1.0
        found = scale * factors.solve((scaled / largest).astype(np.float32)) * largest
        moved = found.reshape(grid.n_balls, cells, d).swapaxes(1, 2)
        return np.ascontiguousarray(moved, force.dtype).reshape(force.shape)

    return apply


class GridSearch:
    """The search for rest on a grid."""

    def __init__(self, problem: GridProblem, options: RestOptions) -> None:
        self.problem = problem
        self.options = options
        self.equations = GridEquations(problem, options)
        self.inverses = GridInverses(problem, self.equations, options)
        self.least = options.least_difference * problem.spread
        self.tolerance = options.tolerance
        self.steps = 0
        self.iterations = 0

    def place(self, balls: Array, strains: Array) -> Place:
        """Return the balls with these displacements and strains."""
        return Place(self.problem, balls, strains, self.options.cached)

    def find_strains(self, force: float) -> Array:
        """Return the strains (s,) under which equal contacts have a mean ``force``."""
        problem = self.problem
        strained = problem.strained
        wanted = problem.given - float(hertz.overlap_of(force))
        strains, *_ = np.linalg.lstsq(strained, wanted, rcond=None)
        return np.asarray(strains)

    def run(self, balls: Array | None, strains: Array) -> Place:
        """Return the balls at rest, from displacements (f, cells) and strains; None of displacements
        is a fresh start.
        """
        problem = self.problem
        options = self.options
        is_fresh = balls is None
        if balls is None:
            balls = np.zeros((problem.n_fields, problem.grid.n_cells))
        begun = 0
        if self._is_near(strains):
            found = approach(self, balls, strains, is_fresh)
            if found is not None:
                balls, strains, begun, self.iterations = found
        elif is_fresh and problem.spread:
            common = problem.find_common(strains)
            if float(np.min(common + np.min(problem.offset, axis=1))) > 0.0:
                # all contacts are closed on the sites: begin where springs that are alike would
                # bring the balls. Where some are open, balls that nothing holds stay nearer to
                # their sites if they begin there
                balls = self.equations.green.apply(problem.collect(problem.offset), 1.0)
        # linear equations need few digits, and single precision takes half of the time
        single = not begun
        before = 0.0
        self.steps = begun
        here = self.place(balls, strains)
        while True:
            self.check(here)
            distance = here.find_distance(self.least, options.move_rounding)
            if distance <= self.tolerance:
                return here
            if self.steps >= options.most_grid_steps:
                raise self.explain(here)
            reduction = max(
                options.accuracy * self.tolerance / distance,
                (distance / before) ** options.progress if before else math.inf,
            )
            reduction = min(options.loosest, reduction)
            stiffness = here.root if single else here.root.astype(float)
            stiffness *= hertz.stiffness_of(1.0) / here.level
            stiffness += options.added * min(1.0, distance)
            inverse = (self.inverses.choose if begun else self.equations.precondition)(stiffness)
            # forces and stiffnesses near one: single precision has no numbers below 1e-38
            size = max(
                float(np.max(np.abs(here.pull))),
                float(np.max(np.abs(here.push), initial=0.0)) * problem.weight,
            )
            force = Unknowns(
                (here.pull / size).astype(stiffness.dtype), here.push / size
            )
            step, taken = self.equations.solve(stiffness, force, inverse, reduction)
            scale = size / here.level
            step = Unknowns(step.balls.astype(float) * scale, step.strains.astype(float) * scale)
            self.inverses.count(taken)
            here, length = self._search(here, step)
            self.iterations += taken
            self.steps += 1
            before = distance
            # where balls that nothing holds move far, single precision may spoil a step
            single = single and length > options.spoilt

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
        return least <= force <= most

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
            slope = -dot(ahead.excess, loss)
            if problem.is_free:
                cells = problem.grid.n_cells
                common = problem.work + cells * ahead.common_force @ problem.strained
                slope -= float(step.strains @ common)
            return slope, lambda: hertz.stiffness_of(
                float(np.einsum("i,i,i", ahead.root.reshape(-1), flat, flat))
            )

        fall = dot(here.pull, step.balls) + float(here.push @ step.strains)
        length = find_length(measure, fall, self.options)
        return ahead, length


def find_length(
    measure: Callable[[float], tuple[float, Callable[[], float]]],
    first: float,
    options: RestOptions,
) -> float:
    """Return the length of a step at which the slope of the energy has at most a tenth of its
    ``first`` size.

    ``measure`` returns the slope at a length, below zero at first, and what finds its derivative.
    Lengths are tried by Newton's method in one dimension, within brackets.
    """
    low = 0.0
    high = math.inf
    length = 1.0
    for _ in range(options.slopes):
        slope, find_rise = measure(length)
        if abs(slope) <= options.slope * abs(first):
            break
        low, high = (length, high) if slope < 0.0 else (low, length)
        rise = find_rise()
        length = length - slope / rise if rise > 0.0 else math.inf
        if not low < length < high:
            length = 0.5 * (low + high) if high < math.inf else 2.0 * low
        length = min(length, 4.0 * low) if high == math.inf else length
    return length
