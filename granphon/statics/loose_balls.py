"""Loose balls, saddles and mechanisms: what stands in the way of balls that differ in exact
directions.

Where most contacts of a ball are open, it leans on others, and a step of Newton's method for all
throws it far. Such loose balls are brought to rest first, while the others are held: in clusters of
those that touch, each with steps of its own length, and with the other sign of -f/r, by which a
step is about as long as a ball is far from the line between two others.

Balls at rest may be at a saddle of the energy. The inertia of the factors tells: no eigenvalue of
the tangent is below zero at a minimum. From a saddle the balls go downhill along the softest
motion.
"""

from __future__ import annotations

from functools import cached_property
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from granphon.balls import hertz
from granphon.base.arrays import Array, Flags
from granphon.contacts.assembly import Assembly
from granphon.contacts.clusters import (
    Lengths,
    Pushes,
    Springs,
    choose_lengths,
    find_cluster_steps,
    find_largest,
    join_balls,
    measure_slopes,
)
from granphon.contacts.deformation import add_forces
from granphon.dynamics.factors import factorise
from granphon.dynamics.linalg import find_nearest
from granphon.statics.configuration import Configuration, turn_contacts
from granphon.statics.newton import Equations, find_strongest_push
from granphon.statics.options import RestOptions


def lead_loose_balls(
    configuration: Configuration, loose: Flags, tolerance: float, options: RestOptions
) -> Configuration:
    """Return the configuration after the balls ``loose`` (n,) have come to rest while the others
    are held: no more force is left on a loose ball than ``tolerance`` times the size of the forces
    of contacts. The configuration itself is returned where that holds already.

    Clusters that do not come to rest are left where the last step has taken them.
    """
    largest = float(np.max(configuration.force_on_balls[loose], initial=0.0))
    if largest <= tolerance * configuration.force_size:
        return configuration
    problem = configuration.problem
    d = problem.assembly.dimension
    # the unknowns that are displacements of loose balls
    of_loose = np.flatnonzero(np.repeat(loose, d))
    load = configuration.load_force[of_loose].reshape(-1, d)
    loose_assembly = problem.assembly.cut_out(loose, configuration.current, configuration.overlap)
    cages = _Cages(loose_assembly, load, np.zeros((loose_assembly.n_bodies, 3)))
    sizes = _Sizes(
        force=configuration.force_size,
        stiffness=float(np.mean(configuration.stiffness)),
        force_at_rest=tolerance * configuration.force_size,
    )
    x = configuration.x.copy()
    while True:
        cages, moves = _lead_clusters(cages, sizes, options)
        x[of_loose] += cages.displacement[:-1, :d].ravel()
        if not np.any(moves):
            return configuration.move(x)
        cages = cages.cut_out(moves)
        of_loose = of_loose[np.repeat(moves, d)]


class _Sizes(NamedTuple):
    """The sizes by which what is done with loose balls is measured.

    Attributes
    ----------
    force : size of the forces of all contacts, N.
    stiffness : mean stiffness of all contacts, N/m.
    force_at_rest : largest force that may be left on a loose ball, N.
    """

    force: float
    stiffness: float
    force_at_rest: float


def _lead_clusters(cages: _Cages, sizes: _Sizes, options: RestOptions) -> tuple[_Cages, Flags]:
    """Return the cages in which more than three quarters of the balls have come to rest, and which
    balls (n,) still move: the caller goes on with them, in smaller clusters. After
    ``options.inner_steps`` the clusters that are left are given up, and none of their balls counts
    as moving.

    A ball is at rest if no more force than ``sizes.force_at_rest`` is left on any ball of its
    cluster. Springs to the ground, weaker as forces fall, shorten the steps.
    """
    assembly = cages.assembly
    n = assembly.n_balls
    all_contacts = np.ones(assembly.n_contacts, bool)
    cluster, n_clusters = cages.join(all_contacts)
    for _ in range(options.inner_steps):
        largest = cages.find_largest_pulls(cluster, n_clusters)
        moves = (largest > sizes.force_at_rest)[cluster]
        # a quarter: all assemblies that are cut out, one after the other, together have less than a
        # third of the balls of this one, and take little time
        if 4 * int(np.count_nonzero(moves)) < n:
            return cages, moves
        relative_force = np.minimum(1.0, largest[cluster] / sizes.force)
        springs = options.loose_spring + options.added_stiffness * relative_force
        cages = cages.advance(sizes.stiffness * springs, moves, sizes.force_at_rest, options)
    return cages, np.zeros(n, bool)


class _Cages:
    """The n loose balls of an ``assembly`` between the bodies that hold them, which do not move, at
    a ``displacement`` (n + 1, 3), m, of the balls and, last, of all that is held.

    Attributes
    ----------
    assembly, load, displacement : those that are given; ``load`` (n, d) are forces on the balls, N,
        that do not change.
    turned : the contacts at the displacement.
    overlap : (n_c,) overlaps of the contacts, m.
    force : (n_c,) forces of the contacts, N.
    stiffness : (n_c,) stiffnesses of the contacts along their normals, N/m.
    """

    def __init__(self, assembly: Assembly, load: Array, displacement: Array) -> None:
        self.assembly = assembly
        self.load = load
        self.displacement = displacement
        self.turned = turn_contacts(assembly, displacement, np.zeros((3, 3)))
        self.overlap = assembly.offset - self.turned.loss
        self.force, self.stiffness = assembly.laws.press(self.overlap)

    @cached_property
    def pull(self) -> Array:
        """(n, d) the forces left on the balls, N."""
        assembly = self.assembly
        on_bodies = np.zeros((assembly.n_bodies, 3))
        ends = (assembly.i, assembly.j, assembly.vector, self.turned.normal)
        add_forces(*ends, self.force, on_bodies, np.zeros((0, 3)))
        return np.asarray(self.load + on_bodies[:-1, : assembly.dimension])

    def join(self, joins: Flags) -> tuple[NDArray[np.int64], int]:
        """Return the number (n,) of the group of each ball, and the number of groups. Balls are in
        one group if contacts that ``joins`` (n_c,) marks lead from one to the other.
        """
        assembly = self.assembly
        group = np.empty(assembly.n_balls, np.int64)
        n_groups = join_balls(assembly.i, assembly.j, joins, group)
        return group, n_groups

    def find_largest_pulls(self, group: NDArray[np.int64], n_groups: int) -> Array:
        """Return the size (n_groups,) of the largest force left, N, on a ball of each group;
        ``group`` (n,) is the number of the group of each ball.
        """
        largest = np.zeros(n_groups)
        find_largest(self.pull, group, largest)
        return largest

    def _find_steps(self, springs: Array, moves: Flags) -> Array:
        """Return the steps (n, d), m, of Newton's method of the balls ``moves`` (n,) and of those
        that closed contacts join to them, zero of the others, with ``springs`` (n,), N/m, to the
        ground. The stiffness f/r across a contact has the sign with which the contact holds its
        balls.
        """
        assembly = self.assembly
        side_stiffness = np.where(assembly.is_flat, 0.0, np.abs(self.force) / self.turned.distance)
        steps = np.empty((assembly.n_balls, assembly.dimension))
        normal = self.turned.normal
        contacts = Springs(assembly.i, assembly.j, normal, self.stiffness, side_stiffness)
        find_cluster_steps(contacts, springs, moves, self.pull, steps)
        return steps

    def _go(self, steps: Array) -> _Cages:
        """Return the cages after ``steps`` (n, d), m, of the balls."""
        n, d = steps.shape
        displacement = self.displacement.copy()
        displacement[:n, :d] += steps
        return _Cages(self.assembly, self.load, displacement)

    def cut_out(self, balls: Flags) -> _Cages:
        """Return the cages of the chosen ``balls`` (n,) alone, which begin where the balls are; all
        other balls are held.
        """
        assembly = self.assembly.cut_out(balls, self.turned.current, self.overlap)
        return _Cages(assembly, self.load[balls], np.zeros((assembly.n_bodies, 3)))

    def advance(
        self, springs: Array, moves: Flags, force_at_rest: float, options: RestOptions
    ) -> _Cages:
        """Return the cages after a step of Newton's method of the balls ``moves`` (n,).

        Balls that touch now, or would after the whole step, are a group. All balls of a group go
        the same part of the step, to where the energy of the group is about least. They go all of
        the step if the energy still falls there. A group stays if no more force than
        ``force_at_rest``, N, is left on any of its balls, or if the energy does not fall along the
        step. ``springs`` (n,), N/m, hold the balls to the ground while the step is found.
        """
        steps = self._find_steps(springs, moves)
        ahead = self._go(steps)
        touches = (self.stiffness > 0.0) | (ahead.stiffness > 0.0)
        group, n_groups = self.join(touches)
        stays = self.find_largest_pulls(group, n_groups) <= force_at_rest
        return self._go_by_groups(steps, group, stays, ahead, options)

    def _go_by_groups(
        self,
        steps: Array,
        group: NDArray[np.int64],
        stays: Flags,
        ahead: _Cages,
        options: RestOptions,
    ) -> _Cages:
        """Return the cages after the part of ``steps`` (n, d), m, at which the energy of each group
        is about least, the whole at most.

        ``group`` (n,) is the number of the group of each ball. Groups that are to stay, ``stays``
        (groups,), and those whose energy does not fall take no part of the steps. ``ahead`` are the
        cages after the whole steps.
        """
        assembly = self.assembly
        n_groups = len(stays)

        # the work of all forces per unit of length where the step begins
        work_of_balls = np.einsum("na,na->n", self.pull, steps)
        first_work = np.asarray(np.bincount(group, work_of_balls, n_groups), float)
        is_done = stays | (first_work <= 0.0)
        length = np.where(is_done, 0.0, 1.0)
        lengths = Lengths(length, np.zeros(n_groups), np.full(n_groups, np.inf), is_done)
        work = np.empty(n_groups)
        fall_rate = np.empty(n_groups)
        for trial in range(options.loose_slopes):
            # the first lengths are those of whole steps, which lead to ``ahead`` unless a group
            # that is to stay would move
            if trial or np.any(steps[is_done[group]]):
                ahead = self._go(length[group, None] * steps)
            turned = ahead.turned
            contacts = Pushes(
                assembly.i,
                assembly.j,
                turned.current,
                turned.distance,
                ahead.force,
                ahead.stiffness,
            )
            measure_slopes(contacts, self.load, steps, group, work, fall_rate)
            slopes = (work, fall_rate, first_work, hertz.EXPONENT, options.loose_slope)
            # the lengths, their brackets and ``is_done`` are changed in place
            if choose_lengths(*slopes, lengths):
                break
        return ahead


def find_way_down(configuration: Configuration, equations: Equations) -> Configuration | None:
    """Return a configuration of less energy than ``configuration``, which is at rest, if that is a
    saddle of the energy; None at a minimum.

    No curvature of the energy is below minus the strongest push (:func:`find_strongest_push`). So
    the lowest curvature is that nearest to this bound, and is found by factors with the bound as a
    shift. The way down begins along its motion. A curvature that may be rounding counts as zero.
    The curvature is that of the tangent with the springs of
    :meth:`~granphon.statics.newton.Linearisation.factorise`: weak ones, and those that hold one
    ball against a drift of the whole.
    """
    options = equations.options
    problem = configuration.problem
    linear = equations.linearise(configuration, configuration.stiffness)
    strongest = find_strongest_push(configuration)
    if linear.factorise(options.curvature * strongest).n_below == 0:
        return None
    n = problem.n_ball_unknowns
    bound = strongest / linear.level
    factors = linear.factorise(strongest)

    def solve(right: Array) -> Array:
        """Return the product (n,) of a right side ``right`` (n,) and the inverse of the shifted
        matrix, in which stiffnesses are over ``linear.level``.
        """
        return np.asarray(factors.solve(right) * linear.level)

    start = np.cos(np.arange(n) ** 2.0)  # the same at each call, and with a part of every motion
    curvatures, vectors = find_nearest(linear.matrix / linear.level, 1, -bound, solve, start)
    if curvatures[0] > -options.curvature * bound:
        return None
    direction = np.zeros(problem.size)
    direction[:n] = vectors[:, 0]
    return go_down(configuration, direction, options)


def go_down(configuration: Configuration, way: Array, options: RestOptions) -> Configuration:
    """Return a configuration along a ``way`` (size,) on which the energy has a curvature below
    zero, in the direction in which the forces left push, or forward if none does.

    The largest displacement of a ball along an axis is at first the part ``options.descent`` of the
    largest offset of contacts. The length is doubled as long as the energy falls and this
    displacement is less than the offset.
    """
    largest = float(np.max(np.abs(configuration.problem.assembly.offset)))
    way = way * (options.descent * largest / float(np.max(np.abs(way))))
    if float(configuration.pull @ way) < 0.0:
        way = -way
    below = configuration
    length = 1.0
    while length * options.descent < 1.0:
        ahead = configuration.move(configuration.x + length * way)
        if length > 1.0 and float(ahead.pull @ way) < 0.0:
            break
        below = ahead
        length *= 2.0
    return below


def has_soft_motions(equations: Equations) -> bool:
    """Return whether there are motions, other than those of the whole, that cost no energy while
    all contacts have the same stiffness.

    Balls with no more contacts than axes along which balls move are loose anyway, and are held. If
    these are all balls, there are no such motions. Motions of the free strains of the cell count
    too. Turning of the whole counts as free even where a body that is held resists it: as many
    other motions may then be missed.
    """
    options = equations.options
    problem = equations.problem
    assembly = problem.assembly
    d = assembly.dimension
    p = assembly.periods
    # the whole may move along axes that nothing hinders, and turn in each plane of two axes across
    # the periods
    n_still = len(assembly.free_axes) + (d - p) * (d - p - 1) // 2
    # numbers of the motions of balls that are not held
    motions = np.flatnonzero(np.repeat(assembly.n_touching > d, d))
    if not len(motions):
        return False
    from scipy.sparse import eye_array

    start = problem.start_at(np.zeros(problem.size))
    linear = equations.linearise(start, np.ones(assembly.n_contacts), 0.0)
    shift = options.soft_stiffness * eye_array(len(motions))
    matrix: Any = linear.matrix[motions][:, motions] - shift
    factors = factorise(matrix.tocsc())
    # eigenvalues below zero once the least stiffness that counts is taken away
    n_soft = factors.n_below
    if len(linear.corner):
        border = linear.border[motions]
        corner = linear.corner - border.T @ np.reshape(factors.solve(border), border.shape)
        n_soft += int(np.sum(np.linalg.eigvalsh(corner) < options.soft_stiffness))
    return n_soft > n_still
