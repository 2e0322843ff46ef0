"""The linear equations of Newton's method for balls, walls and a cell that come to rest.

With the tangent of the contacts, the forces left b ask for a step x of

    | A  B | | u |   | b_u |     balls
    | B' C | | g | = | b_g |     walls and strains, which act on many balls

Factors: the few unknowns g are eliminated last, by C - B' A^-1 B, so that the factors of A stay
sparse. The order in which balls are eliminated is found once for all steps. Balls in a line make a
band, which needs no order. Iterations: where factors take too much, conjugate gradients take the
blocks of single balls for their preconditioner; their products are loops over the contacts, and no
matrix is made.

A weak spring to the ground at each motion holds what nothing else holds.
"""

from __future__ import annotations

import math
from contextlib import suppress
from typing import Any, NamedTuple

import numpy as np

from granphon.balls.motions import Motions
from granphon.base.arrays import Array
from granphon.base.errors import ConvergenceError
from granphon.contacts.contact_list import ContactList
from granphon.contacts.deformation import add_blocks, invert_blocks, multiply_blocks
from granphon.contacts.loops import Blocks
from granphon.contacts.tangent import Tangent, fill_blocks, find_pattern
from granphon.dynamics.factors import Factors
from granphon.statics.configuration import Configuration, Problem
from granphon.statics.grid_iteration import TangentIteration
from granphon.statics.krylov import Map, conjugate_gradients
from granphon.statics.options import RestOptions


class Equations:
    """Newton's equations of a ``problem``, by factors: what does not change from step to step,
    which is where the entries stand, and the order of elimination.

    Attributes
    ----------
    problem, options : those that are given.
    axes : (d,) numbers of the axes along which balls move.
    pattern : where the entries of the tangent of all bodies stand.
    leading : where the entries of A stand, which is the leading part of that tangent.
    anchor : (n d,) springs against a drift of the whole, over the mean stiffness: one at the ball
        with most contacts along each axis along which all balls may move together.
    """

    def __init__(self, problem: Problem, options: RestOptions) -> None:
        assembly = problem.assembly
        self.problem = problem
        self.options = options
        d = assembly.dimension
        n_unknowns = problem.n_ball_unknowns
        self.axes = np.arange(d)
        self.pattern = find_pattern(assembly.i, assembly.j, assembly.n_bodies, d)
        self.leading = self.pattern.lead(n_unknowns)
        self.anchor = np.zeros(n_unknowns)
        if problem.free_axes:
            ball = int(np.argmax(assembly.n_touching))
            self.anchor[[d * ball + axis for axis in problem.free_axes]] = 1.0

    def linearise(
        self, configuration: Configuration, stiffness: Array, turning: float = 1.0
    ) -> Linearisation:
        """Return the equations at a ``configuration`` whose contacts have a ``stiffness`` (n_c,),
        N/m.

        The force f of a contact of length r that turns has a stiffness -f/r across the contact,
        which pushes balls aside. It is multiplied by ``turning``: 1 for the tangent, 0 to leave it
        out, and -1 to hold balls where the forces would push them aside.
        """
        problem = self.problem
        columns = configuration.list_columns(
            stiffness, _find_side_stiffness(configuration, turning)
        )
        n_bodies = problem.assembly.n_bodies
        blocks = fill_blocks(columns, self.axes, problem.unit_strains, n_bodies)
        return Linearisation(self, float(np.mean(stiffness)), blocks)

    def solve(
        self,
        configuration: Configuration,
        stiffness: Array,
        pull: Array,
        turning: float = 1.0,
        load_slope: Array | None = None,
    ) -> Array:
        """Return the step (size,), m, that takes the forces ``pull`` (size,), N, away, without a
        drift of the whole; see :meth:`linearise` and :meth:`Linearisation.invert` for the other
        arguments, and for what is raised.
        """
        linear = self.linearise(configuration, stiffness, turning)
        row = find_mean_row(configuration, stiffness)
        return self.problem.remove_drift(linear.invert(load_slope, row)(pull))


class Bordering(NamedTuple):
    """What surrounds A in the equations of Newton's method under a load.

    Attributes
    ----------
    columns : (n d, m) forces on balls against unit motions of the m walls and strains, N/m.
    rows : (m, n d) forces on walls and strains against unit motions of balls, N/m.
    corner : (m, m) forces on walls and strains against unit motions of these, N/m.
    """

    columns: Array
    rows: Array
    corner: Array

    @classmethod
    def of(
        cls, border: Array, corner: Array, load_slope: Array | None, mean_row: Array | None
    ) -> Bordering:
        """Return what surrounds A where the contacts alone make B, the ``border`` (n d, m), and C,
        the ``corner`` (m, m), N/m.

        ``load_slope`` (size, m), N/m, are the derivatives of the load's forces by the unknowns of
        walls and strains, None where these forces do not change. ``mean_row`` (size,), N/m, is that
        of :func:`find_mean_row`: None unless contacts are given a mean force. Then the only unknown
        beside those of balls is one strain, and ``mean_row`` takes the place of its row.
        """
        n = len(border)
        columns = border
        rows = border.T
        if load_slope is not None:
            columns = columns - load_slope[:n]
            corner = corner - load_slope[n:]
        if mean_row is not None:
            rows = mean_row[None, :n]
            corner = mean_row[None, n:]
        return cls(columns, rows, corner)


class Linearisation:
    """Newton's equations at one configuration, made of the ``blocks`` of its tangent.

    Attributes
    ----------
    equations : the equations of the problem, with the options.
    level : mean stiffness of contacts, N/m.
    entries : entries of A that are stored, N/m.
    border : (n d, m) B, forces on balls against unit motions of the m walls and strains, N/m.
    corner : (m, m) C, forces on walls and strains against each other, N/m.
    """

    def __init__(self, equations: Equations, level: float, blocks: Blocks) -> None:
        self.equations = equations
        self.level = level
        self._hold = equations.options.spring * level
        #: entries of the tangent of all bodies, N/m
        self._data = equations.pattern.list_entries(blocks)
        self.entries = self._data[equations.leading.places]
        problem = equations.problem
        n = problem.n_ball_unknowns
        k = problem.assembly.n_walls
        m = k + len(blocks.corner)
        self.border = np.zeros((n, m))
        self.corner = np.zeros((m, m))
        of_balls = blocks.ahead[: problem.assembly.n_balls]
        self.border[:, k:] = of_balls.reshape(n, len(blocks.corner))
        self.corner[k:, k:] = blocks.corner
        if k:
            self._add_walls(blocks)

    def _add_walls(self, blocks: Blocks) -> None:
        """Enter the walls into :attr:`border` and :attr:`corner`, before the strains: the tangent
        of bodies that move along all axes, projected on the lines of the walls.
        """
        problem = self.equations.problem
        n = problem.n_ball_unknowns
        n_balls = problem.assembly.n_balls
        k = problem.assembly.n_walls
        lines = problem.wall_lines
        walls = slice(n, n + len(lines))
        against_walls = self.equations.pattern.make_matrix(self._data)[:, walls] @ lines
        self.border[:, :k] = against_walls[:n]
        self.corner[:k, :k] = lines.T @ against_walls[walls]
        of_strains = blocks.ahead[n_balls : n_balls + k].reshape(len(lines), -1)
        against_strains = lines.T @ of_strains
        self.corner[:k, k:] = against_strains
        self.corner[k:, :k] = against_strains.T

    @property
    def matrix(self) -> Any:
        """The sparse matrix A (n d, n d), N/m, stored by columns, without springs to the ground."""
        return self.equations.leading.make_matrix(self.entries)

    def factorise(self, springs: Array | float = 0.0) -> Factors:
        """Return the factors of A, with ``springs`` to the ground, N/m, (n d,) or the same at all
        motions, beside those that hold what nothing else holds.

        Raises :class:`~granphon.base.errors.ConvergenceError` if A is singular.
        """
        equations = self.equations
        data = self._data.copy()
        leading = equations.leading
        data[leading.diagonal] += self._hold + self.level * equations.anchor + springs
        matrix = leading.make_matrix(data[leading.places])
        try:
            return leading.elimination.factorise(matrix)
        except RuntimeError:
            words = equations.problem.load.words
            what = f"the equations of balls that come to rest under {words} are singular"
            raise ConvergenceError(what) from None

    def invert(
        self,
        load_slope: Array | None = None,
        mean_row: Array | None = None,
        factors: Factors | None = None,
    ) -> Map:
        """Return the inverse, a function from forces (size,), N, to the step (size,), m, that takes
        the forces away. A is factorised here, unless its ``factors`` are given.

        ``load_slope`` and ``mean_row`` are those of :meth:`Bordering.of`. Raises
        :class:`~granphon.base.errors.ConvergenceError` if A is singular.
        """
        n = len(self.border)
        solve_balls = factors.solve if factors else self._invert_balls()
        if not len(self.corner):
            return solve_balls
        held_corner = self.corner + self._hold * np.eye(len(self.corner))
        columns, rows, corner = Bordering.of(self.border, held_corner, load_slope, mean_row)
        motions = solve_balls(columns)
        # the inverse of C - B' A^-1 B, which is left for walls and strains once balls are
        # eliminated
        inverse_of_few = np.linalg.inv(corner - rows @ motions)

        def solve(pull: Array) -> Array:
            """Return the step (size,) that takes forces ``pull`` (size,) away."""
            of_balls = solve_balls(pull[:n])
            of_few = inverse_of_few @ (pull[n:] - rows @ of_balls)
            return np.concatenate([of_balls - motions @ of_few, of_few])

        return solve

    def _invert_balls(self) -> Map:
        """Return the map from forces on balls, (n d,) or (n d, m), N, to the motions of the balls,
        m, of the same shape, with walls and strains held.
        """
        if not len(self.border):
            return np.zeros_like
        if self.equations.leading.band == 1:
            from scipy.linalg import LinAlgError, cho_solve_banded, cholesky_banded

            # a band that is not positive definite has no Cholesky factors, but those of any matrix
            with suppress(LinAlgError):
                factor = cholesky_banded(self._make_band(), lower=True)
                return lambda forces: np.asarray(cho_solve_banded((factor, True), forces))
        return self.factorise().solve

    def _make_band(self) -> Array:
        """Return the diagonals of A from the main one down, (diagonals, n d), N/m, with the springs
        to the ground that hold what nothing else holds.
        """
        equations = self.equations
        band = equations.leading.make_band(self.entries)
        band[0] += self._hold + self.level * equations.anchor
        return band


def find_mean_row(configuration: Configuration, stiffness: Array) -> Array | None:
    """Return the row (size,), N/m, of the equations of a cell whose contacts are given a mean
    force; None of other cells.

    The row takes a step of the unknowns to the fall of the mean force, times the root of the number
    of contacts as in :attr:`~granphon.statics.configuration.Configuration.pull`.
    """
    problem = configuration.problem
    if problem.load.mean_force is None:
        return None
    row = problem.collect_forces(configuration.normal, stiffness)
    return row / math.sqrt(problem.assembly.n_contacts)


def _find_side_stiffness(configuration: Configuration, turning: float) -> Array:
    """Return the stiffnesses (n_c,), N/m, across contacts: ``turning`` times -f/r, and zero of
    contacts that do not turn.
    """
    problem = configuration.problem
    if not problem.turns:
        return np.zeros(problem.assembly.n_contacts)
    side_stiffness = -turning * configuration.force / configuration.distance
    return np.where(problem.assembly.is_flat, 0.0, side_stiffness)


class GridStep(NamedTuple):
    """A step of Newton's method that iterations on a grid have found.

    Attributes
    ----------
    step : (size,) of the unknowns, m.
    has_arrived : whether the error has fallen as far as it should.
    way_down : (size,) a motion of balls along which the curvature of the energy is below zero; None
        if none was met.
    iterations : number of iterations.
    """

    step: Array
    has_arrived: bool
    way_down: Array | None
    iterations: int


class GridProbe(NamedTuple):
    """What a search for a curvature below zero has found.

    Attributes
    ----------
    way_down : (size,) a motion of balls along which the curvature of the energy is below zero; None
        if none was met.
    has_arrived : whether the response to the random forces was found, so that there is no such
        motion.
    iterations : number of iterations.
    """

    way_down: Array | None
    has_arrived: bool
    iterations: int


class GridEquations:
    """Newton's equations of balls whose contacts are a grid, by conjugate gradients with Green's
    function (:mod:`granphon.statics.grid_iteration`).
    """

    def __init__(self, problem: Problem, options: RestOptions) -> None:
        self.problem = problem
        self.options = options
        axes = tuple(range(problem.assembly.dimension))
        self.motions = Motions("", axes)
        #: the stiffnesses (n_c,) of contacts before the last step, and the iteration that found the
        #: step; None unless that step was near rest, with -f/r as it is
        self._last: tuple[Array, TangentIteration] | None = None
        #: the iteration that was made last, whose Green's function serves the next; None at first
        self._earlier: TangentIteration | None = None

    def solve(
        self,
        configuration: Configuration,
        stiffness: Array,
        pull: Array,
        turning: float,
        reduction: float,
        most: int,
        load_slope: Array | None = None,
    ) -> GridStep:
        """Return the step that takes the forces ``pull`` (size,), N, away, with an error that has
        fallen to the part ``reduction``, or that ``most`` iterations leave; see
        :meth:`Equations.solve` for the other arguments.

        The iteration of a step near rest is kept for :meth:`probe`, and its Green's function for
        the next step.
        """
        problem = self.problem
        n = problem.n_ball_unknowns
        blocks = self._fill_blocks(configuration, stiffness, turning)
        iteration = self._iterate(configuration, stiffness, blocks)
        is_near = turning == 1.0 and configuration.residual <= self.options.near_residual
        self._last = (configuration.stiffness, iteration) if is_near else None
        mean_row = find_mean_row(configuration, stiffness)
        border = blocks.ahead.reshape(n, -1)
        columns, rows, corner = Bordering.of(border, blocks.corner, load_slope, mean_row)
        # nothing resists a motion of the whole: that the forces left push it is rounding
        on_balls = problem.remove_drift(pull)[:n]
        # motions under the forces of unit strains are found together with those under the pull
        right = np.column_stack([on_balls, columns])
        right = right.reshape(problem.assembly.n_balls, len(self.motions.translations), -1)
        solution = iteration.solve(right, reduction, most, 0.0)
        motions = solution.motions.reshape(n, -1)
        step = motions[:, 0]
        if len(corner):
            of_cell = np.linalg.solve(corner - rows @ motions[:, 1:], pull[n:] - rows @ step)
            step = np.concatenate([step - motions[:, 1:] @ of_cell, of_cell])
        return GridStep(
            step=problem.remove_drift(step),
            has_arrived=solution.has_arrived,
            way_down=self._extend(solution.way_down),
            iterations=solution.iterations,
        )

    def probe(self, configuration: Configuration, most: int) -> GridProbe:
        """Look for a motion along which the curvature of the energy is below zero, and return what
        was found in at most ``most`` iterations with each tangent. Conjugate gradients for the
        response to random forces meet such a motion if there is one.

        The tangent of the last step serves if the stiffnesses have hardly changed since. If they
        have, or if such a motion was met with that tangent, the tangent is made anew, with weak
        springs at each ball, so that a curvature that is rounding does not count.
        """
        options = self.options
        assembly = self.problem.assembly
        forces = _draw_forces(configuration)
        right = forces.reshape(assembly.n_balls, assembly.dimension, 1)
        n_iterations = 0
        solution = None
        if self._last is not None:
            stiffness, iteration = self._last
            if has_hardly_changed(configuration, stiffness, options):
                solution = iteration.solve(right, options.probe_reduction, most, 0.0)
                n_iterations = solution.iterations
        if solution is None or solution.way_down is not None:
            blocks = self._fill_blocks(configuration, configuration.stiffness, 1.0)
            axes = np.arange(assembly.dimension)
            blocks.diagonal[axes, axes] += options.curvature * find_strongest_push(configuration)
            iteration = self._iterate(configuration, configuration.stiffness, blocks)
            solution = iteration.solve(right, options.probe_reduction, most, 0.0)
            n_iterations += solution.iterations
        return GridProbe(self._extend(solution.way_down), solution.has_arrived, n_iterations)

    def _extend(self, way_down: Array | None) -> Array | None:
        """Return the unknowns (size,) of a motion of balls (n, d), with zeros for the strains; None
        for None.
        """
        if way_down is None:
            return None
        motion = np.zeros(self.problem.size)
        motion[: self.problem.n_ball_unknowns] = way_down.ravel()
        return motion

    def _fill_blocks(
        self, configuration: Configuration, stiffness: Array, turning: float
    ) -> Blocks:
        """Return the blocks of the tangent of contacts of a ``stiffness`` (n_c,), N/m, with
        ``turning`` as in :meth:`Equations.linearise`.
        """
        assembly = self.problem.assembly
        columns = configuration.list_columns(
            stiffness, _find_side_stiffness(configuration, turning)
        )
        axes = np.arange(assembly.dimension)
        return fill_blocks(columns, axes, self.problem.unit_strains, assembly.n_balls)

    def _iterate(
        self, configuration: Configuration, stiffness: Array, blocks: Blocks
    ) -> TangentIteration:
        """Return the iteration with the tangent ``blocks`` of contacts of a ``stiffness`` (n_c,),
        N/m. The iteration is kept: the next one takes its Green's function.
        """
        assembly = self.problem.assembly
        assert assembly.grid is not None
        zeros = np.zeros(assembly.n_contacts)
        contacts = ContactList(
            n_balls=assembly.n_balls,
            motions=self.motions,
            i=assembly.i,
            j=assembly.j,
            vector=assembly.vector,
            normal=assembly.normal,
            arm_i=zeros,
            arm_j=zeros,
            normal_stiffness=stiffness,
            shear_stiffness=zeros,
            torsion_stiffness=zeros,
            bending_stiffness=zeros,
            normal_force=configuration.force,
            measure=assembly.measure,
            dimension=assembly.dimension,
            grid=assembly.grid.shape,
        )
        self._earlier = TangentIteration(
            Tangent(contacts, blocks),
            is_uniform=True,
            earlier=self._earlier,
            options=self.options.grid,
        )
        return self._earlier


def has_hardly_changed(
    configuration: Configuration, stiffness: Array, options: RestOptions
) -> bool:
    """Return whether the contacts of a ``configuration`` have about the ``stiffness`` (n_c,), N/m,
    of an earlier configuration, whose tangent then serves. Contacts whose force may be nothing but
    what the tolerance leaves do not count: they are those of balls that nothing holds.
    """
    least_force = options.open_force * options.tolerance * configuration.force_size
    change = np.abs(configuration.stiffness - stiffness)
    is_close = change <= options.stiffness_change * stiffness
    return bool(np.all(is_close | (np.abs(configuration.force) <= least_force)))


def find_strongest_push(configuration: Configuration) -> float:
    """Return a bound, N/m, of the stiffness with which the forces of contacts push balls aside: no
    curvature of the energy is below minus this bound.

    A force f of a contact of length r that presses pushes its balls aside with the stiffness f/r,
    and |u_j - u_i|^2 is at most 2 |u_i|^2 + 2 |u_j|^2. The bound is therefore twice the largest sum
    of f/r over the contacts of a ball that press.
    """
    assembly = configuration.problem.assembly
    push = np.maximum(configuration.force, 0.0) / configuration.distance
    push = np.where(assembly.is_flat, 0.0, push)
    ends = np.concatenate([assembly.i, assembly.j])
    sums = np.bincount(ends, np.tile(push, 2), assembly.n_bodies)
    return 2.0 * float(np.max(sums[: assembly.n_balls], initial=0.0))


def _draw_forces(configuration: Configuration) -> Array:
    """Return random forces (n d,) on balls, (N/m)^(1/2), the same at each call for the same
    contacts: each contact pushes its balls along its direction by the root of its stiffness, and
    along each axis by the root of |f|/r, both times random numbers from -1/2 to 1/2.
    """
    problem = configuration.problem
    assembly = problem.assembly
    d = assembly.dimension
    draw = np.random.default_rng(0).random((assembly.n_contacts, d), np.float32) - np.float32(0.5)
    side = np.sqrt(np.abs(configuration.force) / configuration.distance)
    push = (np.sqrt(configuration.stiffness) * draw[:, 0])[:, None] * configuration.normal
    push[:, :d] += side[:, None] * draw
    forces = problem.collect_forces(push, np.ones(assembly.n_contacts))
    return forces[: problem.n_ball_unknowns]


class IteratedEquations:
    """Newton's equations of a ``problem``, by conjugate gradients.

    The stiffness -f/r by which forces push balls aside is left out: over the stiffness along a
    contact it is about the overlap over r.
    """

    def __init__(self, problem: Problem, options: RestOptions) -> None:
        self.problem = problem
        self.options = options

    def solve(
        self,
        configuration: Configuration,
        stiffness: Array,
        pull: Array,
        reduction: float,
        most: int,
        precondition: Map | None = None,
    ) -> tuple[Array, bool]:
        """Return the step (size,), m, that takes the forces ``pull`` (size,), N, away but for the
        part ``reduction`` or rounding, and whether ``most`` iterations find the step; otherwise the
        step is that of the last iteration.

        Parameters
        ----------
        configuration : where the contacts are.
        stiffness : (n_c,) of the contacts, N/m.
        precondition : an approximate inverse, from forces (size,) to unknowns (size,); by default
            that in which each ball moves while the others are held.
        """
        problem = self.problem
        normal = configuration.normal
        inverse = precondition or self._invert_alone(normal, stiffness)

        def apply(motion: Array) -> Array:
            """Return the forces (size,) against a ``motion`` (size,)."""
            loss = problem.measure_losses(motion, normal)
            return problem.collect_forces(normal, stiffness * loss)

        def find_motion(force: Array) -> Array:
            """Return an approximate motion (size,) under a ``force`` (size,), without a drift."""
            return problem.remove_drift(inverse(force))

        # the norm of forces left that are about the spacing of doubles at the forces of contacts
        rounding = 2.0 * float(np.finfo(np.float64).eps)
        floor = float(np.sqrt(len(pull))) * rounding * configuration.force_size
        right = problem.remove_drift(pull)
        return conjugate_gradients(apply, find_motion, right, reduction, floor, most)

    def _invert_alone(self, normal: Array, stiffness: Array) -> Map:
        """Return a function from forces (size,), N, to the motions (size,), m, of each ball, wall
        or strain while all others are held; contacts along ``normal`` (n_c, 3) have a
        ``stiffness`` (n_c,), N/m.
        """
        problem = self.problem
        options = self.options
        assembly = problem.assembly
        d = assembly.dimension
        n = problem.n_ball_unknowns
        level = float(np.mean(stiffness))
        blocks = np.zeros((assembly.n_bodies, d, d))
        add_blocks(assembly.i, assembly.j, normal, stiffness, blocks)
        lines = assembly.directions
        of_walls = blocks[assembly.n_balls : assembly.n_balls + assembly.n_walls]
        losses = problem.find_unit_losses(normal)
        # the stiffness against each wall along its line, and against each strain
        against_walls = np.einsum("wa,wab,wb->w", lines, of_walls, lines)
        against_strains = np.einsum("cs,c,cs->s", losses, stiffness, losses)
        diagonal = np.concatenate([against_walls, against_strains]) + options.spring * level
        inverse_blocks = blocks[: assembly.n_balls] + options.grid.spring * level * np.eye(d)
        invert_blocks(inverse_blocks)  # in place

        def solve(force: Array) -> Array:
            """Return the motion (size,) under a ``force`` (size,), each unknown alone."""
            motion = np.empty_like(force)
            on_balls = force[:n].reshape(-1, d)
            multiply_blocks(inverse_blocks, on_balls, motion[:n].reshape(-1, d))
            motion[n:] = force[n:] / diagonal
            return motion

        return solve
