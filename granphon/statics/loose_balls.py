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

import math
from functools import cached_property
from typing import Any

import numpy as np

from granphon.balls import hertz
from granphon.base.arrays import Array, Flags
from granphon.contacts.assembly import Assembly
from granphon.contacts.clusters import (
    choose_lengths,
    find_cluster_steps,
    join_balls,
    measure_slopes,
)
from granphon.contacts.deformation import add_forces, measure_turned
from granphon.dynamics.factors import factorise
from granphon.dynamics.linalg import find_nearest
from granphon.statics.configuration import Configuration
from granphon.statics.newton import Equations, find_strongest_push
from granphon.statics.options import RestOptions


def lead_loose_balls(
    configuration: Configuration, loose: Flags, least: float, options: RestOptions
) -> Configuration:
    """Return the configuration after the balls ``loose`` (n,) have come to rest while the others
    are held: no more force is left on a loose ball than ``least`` times the mean force of contacts.

    Clusters that do not come to rest are left where the last step has taken them.
    """
    moving = loose & bool(
        np.max(configuration.force_on_balls[loose]) > least * configuration.force_size
    )
    for _ in range(options.steps):
        if not np.any(moving):
            break
        configuration, moving = _lead_clusters(configuration, moving, least, options)
    return configuration


def _lead_clusters(
    configuration: Configuration, loose: Flags, least: float, options: RestOptions
) -> tuple[Configuration, Flags]:
    """Return the configuration in which more than three quarters of the ``loose`` balls have come
    to rest, and the balls (n,) that have not; none count as such once ``options.inner_steps`` have
    been taken.

    The other balls are held. A ball is at rest if no more force than ``least`` times the mean is
    left on any ball of its cluster. Springs to the ground, weaker as forces fall, shorten the
    steps. The caller goes on with the balls that are not at rest, in smaller clusters.
    """
    problem = configuration.problem
    assembly = problem.assembly
    d = assembly.dimension
    # of the loose balls alone
    held = assembly.cut_out(loose, configuration.current, configuration.overlap)
    unknowns = np.repeat(loose, d)
    of_loose = np.concatenate([unknowns, np.zeros(problem.size - len(unknowns), bool)])
    cluster = np.empty(held.n_balls, np.int64)
    count = join_balls(held.i, held.j, np.ones(held.n_contacts, bool), cluster)
    cages = _Cages(held, configuration.load_force[of_loose].reshape(-1, d), np.zeros(0))
    force_at_rest = least * configuration.force_size
    mean_stiffness = float(np.mean(configuration.stiffness))
    moves = np.ones(held.n_balls, bool)
    for _ in range(options.inner_steps):
        largest = np.zeros(count)
        np.maximum.at(largest, cluster, cages.size_of_pull)
        moves = (largest > force_at_rest)[cluster]
        if 4 * int(np.count_nonzero(moves)) < held.n_balls:
            break
        relative_force = np.minimum(1.0, largest[cluster] / configuration.force_size)
        springs = options.hold_loose + options.added * relative_force
        cages = cages.advance(mean_stiffness * springs, moves, force_at_rest, options)
    else:
        moves = np.zeros(held.n_balls, bool)
    x = configuration.x.copy()
    x[of_loose] += cages.displacement[:-1, :d].ravel()
    moving = loose.copy()
    moving[loose] = moves
    return configuration.move(x), moving


class _Cages:
    """The n loose balls of an ``assembly`` between others, which are held, at displacements
    (bodies, 3), m; zeros if ``displacement`` is empty.

    ``load`` (n, d) are forces on the balls, N, that do not change.
    """

    def __init__(self, assembly: Assembly, load: Array, displacement: Array) -> None:
        self.assembly = assembly
        self.load = load
        if not displacement.size:
            displacement = np.zeros((assembly.n_bodies, 3))
        self.displacement = displacement
        loss = np.empty(assembly.n_contacts)
        self.current = np.empty((assembly.n_contacts, 3))
        self.distance = np.empty(assembly.n_contacts)
        #: (n_c, 3) unit vectors of the contacts
        self.normal = np.empty((assembly.n_contacts, 3))
        ends = (assembly.i, assembly.j, assembly.vector, assembly.is_flat)
        places = (self.current, self.distance, self.normal)
        measure_turned(*ends, displacement, np.zeros((3, 3)), loss, *places)
        overlap = assembly.offset - loss
        self.force = assembly.laws.force(overlap)
        self.stiffness = assembly.laws.stiffness(overlap)

    @cached_property
    def pull(self) -> Array:
        """(n, d) the forces left on the balls, N."""
        assembly = self.assembly
        on_bodies = np.zeros((assembly.n_bodies, 3))
        ends = (assembly.i, assembly.j, assembly.vector, self.normal)
        add_forces(*ends, self.force, on_bodies, np.zeros((0, 3)))
        return np.asarray(self.load + on_bodies[:-1, : assembly.dimension])

    @property
    def size_of_pull(self) -> Array:
        """(n,) size of the force left on each ball, N."""
        return np.asarray(np.sqrt(np.einsum("na,na->n", self.pull, self.pull)))

    def advance(self, springs: Array, moves: Flags, most: float, options: RestOptions) -> _Cages:
        """Return the cages after a step of Newton's method of the balls ``moves`` (n,).

        Balls that touch now, or would after the whole step, are a group, and go the same part of
        the step: to where the energy of the group is about least, or all of it if the energy still
        falls there. Groups with no more force than ``most``, N, on any ball stay. ``springs`` (n,),
        N/m, hold the balls to the ground.
        """
        assembly = self.assembly
        n = assembly.n_balls
        d = assembly.dimension
        across = np.where(assembly.is_flat, 0.0, np.abs(self.force) / self.distance)
        steps = np.empty((n, d))
        ends = (assembly.i, assembly.j)
        of_contacts = (self.normal, self.stiffness, across)
        find_cluster_steps(*ends, *of_contacts, springs, moves, self.pull, steps)
        whole = np.zeros_like(self.displacement)
        whole[:n, :d] = steps
        ahead = _Cages(assembly, self.load, self.displacement + whole)
        group = np.empty(n, np.int64)
        touches = (self.stiffness > 0.0) | (ahead.stiffness > 0.0)
        count = join_balls(*ends, touches, group)

        def sum_work(forces: Array) -> Array:
            """Return the work of forces (n, d) on the balls of each group along the whole step."""
            work = np.einsum("na,na->n", forces, steps)
            return np.asarray(np.bincount(group, work, count), float)

        first = sum_work(self.pull)
        of_load = sum_work(self.load)
        largest = np.zeros(count)
        np.maximum.at(largest, group, self.size_of_pull)
        is_done = (largest <= most) | (first <= 0.0)
        length = np.where(is_done, 0.0, 1.0)
        low = np.zeros(count)
        high = np.full(count, np.inf)
        for trial in range(options.loose_slopes):
            if trial or np.any(is_done):
                part = self.displacement.copy()
                part[:n] += length[group, None] * whole[:n]
                ahead = _Cages(assembly, self.load, part)
            work = of_load.copy()
            rise = np.zeros(count)
            contacts = (ahead.current, ahead.distance, ahead.force, ahead.stiffness)
            measure_slopes(*ends, *contacts, steps, group, work, rise)
            slopes = (work, rise, first, hertz.EXPONENT, options.loose_slope)
            if choose_lengths(*slopes, length, low, high, is_done):
                break
        return ahead


def find_way_down(configuration: Configuration, equations: Equations) -> Configuration | None:
    """Return a configuration of less energy than ``configuration``, which is at rest, if that is a
    saddle of the energy; None at a minimum.

    No curvature of the energy is below minus the strongest push (:func:`find_strongest_push`). So
    the lowest curvature is that nearest to this bound, and is found by factors with the bound as a
    shift. The way down begins along its motion. A curvature that may be rounding counts as zero.
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
        """Return the solution of the equations of the shifted matrix over its level."""
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
    zero, in the direction in which the forces left push.

    Lengths are doubled from the part ``options.descent`` of the largest difference of radii, as
    long as the energy falls and the displacement is less than this difference.
    """
    largest = float(np.max(np.abs(configuration.problem.assembly.offset)))
    way = way * (options.descent * largest / float(np.max(np.abs(way))))
    way *= math.copysign(1.0, float(configuration.pull @ way))
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

    Balls with no more contacts than dimensions are loose anyway, and are held. Motions of the free
    strains of the cell count too.
    """
    options = equations.options
    problem = equations.problem
    assembly = problem.assembly
    d = assembly.dimension
    p = assembly.periods
    # the whole may move along axes that nothing hinders, and turn in each plane of two axes across
    # the periods
    n_still = len(assembly.free_axes) + (d - p) * (d - p - 1) // 2
    kept = np.flatnonzero(np.repeat(assembly.n_touching > d, d))
    if len(kept) <= n_still + 1:
        return False
    from scipy.sparse import eye_array

    start = problem.start_at(np.zeros(problem.size))
    linear = equations.linearise(start, np.ones(assembly.n_contacts), 0.0)
    matrix: Any = linear.matrix[kept][:, kept] - options.soft * eye_array(len(kept))
    factors = factorise(matrix.tocsc())
    n_soft = factors.n_below
    if len(linear.corner):
        border = linear.border[kept]
        corner = linear.corner - border.T @ np.reshape(factors.solve(border), border.shape)
        n_soft += int(np.sum(np.linalg.eigvalsh(corner) < options.soft))
    return n_soft > n_still
