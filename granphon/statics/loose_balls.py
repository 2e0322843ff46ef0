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
from typing import Any

import numpy as np

from granphon.base.arrays import Array, Flags, Index
from granphon.contacts.assembly import Assembly
from granphon.dynamics.factors import factorise
from granphon.dynamics.linalg import find_nearest
from granphon.statics.configuration import AppliedLoad, Configuration, Problem
from granphon.statics.newton import Equations
from granphon.statics.options import RestOptions


def lead_loose_balls(
    configuration: Configuration, loose: Flags, least: float, options: RestOptions
) -> Configuration:
    """Bring ``loose`` balls (n,) to rest, while the others are held, until no more force than
    ``least`` of the mean is left on any, or for as many steps as ``options`` allow.
    """
    problem = configuration.problem
    assembly = problem.assembly
    d = assembly.dimension
    flat = assembly.is_flat[:, None]
    vector = np.where(flat, assembly.vector, configuration.current)
    held = assembly.cut_out(loose, vector, configuration.overlap)
    unknowns = np.repeat(loose, d)
    of_loose = np.concatenate([unknowns, np.zeros(problem.size - len(unknowns), bool)])
    load = AppliedLoad(
        force=configuration.load_force[of_loose],
        words=problem.load.words,
        stress=None,
        strain=np.zeros((0, 0)),
        pressure_force=np.zeros(d * held.n_balls),
    )
    own_problem = Problem(held, load, "exact", "stress")
    equations = Equations(own_problem, options)
    place = own_problem.start_at(np.zeros(own_problem.size))
    level = float(np.mean(configuration.stiffness))
    most = least * configuration.mean
    for _ in range(options.steps):
        left = place.force_on_balls
        if np.max(left) <= most:
            break
        springs = options.hold + options.added * np.minimum(1.0, left / configuration.mean)
        linear = equations.linearise(place, place.stiffness, -1.0)
        motion = linear.factorise(np.repeat(level * springs, d)).solve(place.pull)
        closed = (place.force > 0.0) | (place.move(place.x + motion).force > 0.0)
        place = _move_clusters(place, motion, _find_clusters(held, closed), most, options)
    x = configuration.x.copy()
    x[of_loose] += place.x
    return configuration.move(x)


def _find_clusters(assembly: Assembly, closed: Flags) -> Index:
    """Return the number (n,) of the cluster of each ball: balls are joined by contacts that are
    ``closed`` (n_c,).
    """
    from scipy.sparse import coo_array
    from scipy.sparse.csgraph import connected_components

    joined = closed & assembly.is_between_balls
    ends = (assembly.i[joined], assembly.j[joined])
    shape = (assembly.n_balls, assembly.n_balls)
    graph = coo_array((np.ones(len(ends[0])), ends), shape=shape)
    _, clusters = connected_components(graph, directed=False)
    return np.asarray(clusters, np.intp)


def _move_clusters(
    place: Configuration, motion: Array, cluster: Index, most: float, options: RestOptions
) -> Configuration:
    """Return the configuration after a step along a ``motion``, of a length for each cluster at
    which the slope of its energy is small; clusters with no more force than ``most`` on any ball
    stay.
    """
    d = place.problem.assembly.dimension
    count = int(np.max(cluster)) + 1
    left = np.zeros(count)
    np.maximum.at(left, cluster, place.force_on_balls)
    of_unknown = np.repeat(cluster, d)
    first = np.bincount(of_unknown, place.pull * motion, count)
    low = np.zeros(count)
    high = np.full(count, np.inf)
    is_done = left <= most
    length = np.where(is_done, 0.0, 1.0)
    ahead = place
    for _ in range(options.slopes):
        ahead = place.move(place.x + length[of_unknown] * motion)
        slope = np.bincount(of_unknown, ahead.pull * motion, count)
        low = np.where(slope > 0.0, length, low)
        high = np.where(slope < 0.0, length, high)
        is_small = np.abs(slope) <= options.slope * first
        # a whole step after which the energy still falls is kept
        is_done |= is_small | ((slope >= 0.0) & (high == np.inf))
        if np.all(is_done):
            break
        middle = 0.5 * (low + np.where(is_done, low, high))
        length = np.where(is_done, length, middle)
    return ahead


def find_way_down(configuration: Configuration, equations: Equations) -> Configuration | None:
    """Return where to go on from a saddle of the energy; None at a minimum."""
    options = equations.options
    problem = configuration.problem
    assembly = problem.assembly
    linear = equations.linearise(configuration, configuration.stiffness)
    # forces push no ball aside more than twice all that act on one
    aside = np.where(assembly.is_flat, 0.0, configuration.force / configuration.distance)
    parts = np.abs(configuration.normal[:, : assembly.dimension]) * aside[:, None]
    sums = np.zeros((assembly.n_bodies, assembly.dimension))
    np.add.at(sums, assembly.i, parts)
    np.add.at(sums, assembly.j, parts)
    strongest = 4.0 * float(np.max(sums[: assembly.n_balls], initial=0.0))
    if linear.factorise(options.curvature * strongest).n_below == 0:
        return None
    n = problem.n_ball_unknowns
    scaled = linear.matrix / linear.level
    most = strongest / linear.level
    solve = linear.factorise(strongest)
    value, vector = find_nearest(
        scaled,
        1,
        -most,
        lambda right: solve.solve(right) * linear.level,
        np.cos(np.arange(n) ** 2.0),
    )
    if value[0] > -options.curvature * most:
        return None
    way = np.zeros(problem.size)
    largest = float(np.max(np.abs(assembly.offset)))
    way[:n] = vector[:, 0] * options.descent * largest / float(np.max(np.abs(vector)))
    way *= math.copysign(1.0, float(configuration.pull @ way))
    below = configuration
    # as far as the energy falls, but not much farther than radii differ
    length = 1.0
    while length * options.descent < 1.0:
        ahead = configuration.move(configuration.x + length * way)
        if length > 1.0 and float(ahead.pull @ way) < 0.0:
            break
        below = ahead
        length *= 2.0
    return below


def has_soft_motions(equations: Equations) -> bool:
    """Return whether motions cost no energy while all contacts touch alike, beside those of the
    whole.

    Balls with no more contacts than dimensions are loose, and are left out.
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
