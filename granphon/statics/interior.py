"""An interior-point method for arrays near their rigidity threshold, where half of the contacts or
more are open.

Newton's method on the energy is slow there: it learns only bit by bit which contacts open and
close. Here force f and gap s of every contact are unknowns of their own, both above zero,

    h = f^(2/3) - s,    f s = mu,    C^T f = 0

with the overlap h of :mod:`granphon.statics.grid_problem`. For mu = 0 this is rest: f = h_+^(3/2),
and s is the distance of balls that are apart. A step is one of Newton's method for the three
equations together (S. J. Wright, Primal-Dual Interior-Point Methods, SIAM 1997): without f and s it
is a linear system C^T K C with the stiffness

    K = 1 / ((2/3) f^(-1/3) + s/f)

in the place of (3/2) h_+^(1/2). From step to step mu is lowered. Balls that nothing holds come to
rest in the middle of their cages, where they touch no other.
"""

from __future__ import annotations

import math

import numpy as np

from granphon.balls import hertz
from granphon.base.arrays import Array
from granphon.statics.grid_problem import GridProblem, Unknowns
from granphon.statics.lattice_equations import LatticeEquations, Preconditioners

#: Newton steps, at most
_STEPS = 100
#: mean of f s, over the mean force to the power 5/3, at which the method ends: Newton's method goes
#: on from there
_CLOSE = 1e-9
#: largest force left on a ball, over the mean force, with which it then ends well
_BALANCED = 0.1
#: mean force at which the array counts as carrying no load
_LEAST_FORCE = 1e-10
#: mu of a step is the mean of f s, times the factor by which it fell in the step before, to this
#: power: it falls the faster the better it goes
_SPEED = 1.5
#: least factor by which mu is lowered in a step
_LEAST_FACTOR = 1e-2
#: largest factor by which mu is lowered in a step
_LARGEST_FACTOR = 0.2
#: mu is not lowered while the largest force left on a ball, over the mean force, is more than this
#: many times the root of mu over the mean force to the power 5/3
_TOO_FAR = 10.0
#: least fraction of its value that a step leaves of an f or s
_LEFT = 0.01
#: product f s of a contact after a step, over mu, at least: the smaller of f^(2/3) and s is moved
#: until it is
_LEAST_PRODUCT = 0.1
#: product f s of a contact after a step, over mu, at most
_LARGEST_PRODUCT = 100.0
#: tolerance of a linear system, as a fraction of the factor by which mu is lowered
_ACCURACY = 0.5
#: tolerance of a linear system, over its right side, at most
_LARGEST_ERROR = 0.1
#: tolerance of a linear system, over its right side, at least; it is that where mu is held
_LEAST_ERROR = 0.03
#: f^(2/3) and s of a contact with h = 0, over the standard deviation of h, where the start is the
#: sites of the lattice
_WIDTH = 1.0
#: the same where the start is an equilibrium
_WIDTH_NEAR = 0.03


def approach(
    equations: LatticeEquations,
    inverses: Preconditioners,
    balls: Array,
    strains: Array,
    is_fresh: bool,
) -> tuple[Array, Array, int, int] | None:
    """Return displacements (f, cells) and strains (s,) near rest, and the numbers of steps and
    iterations, from others.

    The result is None if no rest is near after 100 steps: it may be at the threshold itself, or
    there may be none. ``is_fresh`` says whether the balls begin on their sites, rather than at rest
    under another load.
    """
    problem = equations.problem
    cells = problem.grid.n_cells
    taken = 0
    before = math.inf
    h = _find_overlaps(problem, balls, strains)
    f, s = split(h, (_WIDTH if is_fresh else _WIDTH_NEAR) * float(np.std(h)))
    for step in range(_STEPS):
        product = float(np.mean(f * s))
        mean = float(np.mean(f))
        if mean < _LEAST_FORCE:  # too few balls touch to hold each other
            return None
        relative = product / (mean * float(hertz.overlap_of(mean)))
        left = problem.find_largest(problem.collect(f)) / mean
        if relative <= _CLOSE:
            return (balls, strains, step, taken) if left <= _BALANCED else None
        factor = _LARGEST_FACTOR
        if step:
            factor = max(_LEAST_FACTOR, (product / before) ** _SPEED)
            factor = min(_LARGEST_FACTOR, factor)
        if step and left > _TOO_FAR * math.sqrt(relative):
            factor = 1.0
        mu = factor * product
        before = product
        closed = hertz.overlap_of(f)
        stiffness = f / (closed / hertz.EXPONENT + s)
        change = h - closed + mu / f
        tension = f + stiffness * change
        push = np.zeros(len(strains))
        if len(push):
            # at first no less than a part of the mean force is asked for
            of_load = problem.work
            least = _LARGEST_FACTOR * mean * cells * np.sum(problem.strained, axis=0)
            of_load = -np.maximum(-of_load, least) if len(push) == 1 else of_load
            push = of_load + np.sum(tension, axis=1) @ problem.strained
        accuracy = max(_LEAST_ERROR, min(_ACCURACY * factor, _LARGEST_ERROR))
        if factor == 1.0:
            accuracy = _LEAST_ERROR
        motion, count = equations.solve(
            stiffness,
            Unknowns(problem.collect(tension), push),
            inverses.choose(stiffness),
            accuracy,
        )
        inverses.count(count)
        change -= problem.add_losses(problem.measure_losses(motion.balls), motion.strains)
        change *= stiffness
        widening = (mu - s * change) / f - s
        # a whole step, but for those f and s that it would make too small
        f = np.maximum(f + change, _LEFT * f)
        s = np.maximum(s + widening, _LEFT * s)
        # the smaller of f^(2/3) and s is moved where their product is too far from mu: a step that
        # leaves the products of some contacts far from the others' makes the next steps short or
        # wrong
        wanted = np.clip(f * s, _LEAST_PRODUCT * mu, _LARGEST_PRODUCT * mu)
        is_open = hertz.overlap_of(f) < s
        f, s = np.where(is_open, wanted / s, f), np.where(is_open, s, wanted / f)
        strains = strains + motion.strains
        balls = balls + motion.balls
        taken = taken + count
        h = _find_overlaps(problem, balls, strains)
    return None


def _find_overlaps(problem: GridProblem, balls: Array, strains: Array) -> Array:
    """Return the overlaps (kinds, cells)."""
    overlaps = problem.measure_losses(balls)
    np.subtract(problem.offset, overlaps, out=overlaps)
    overlaps += problem.find_common(strains)[:, None]
    return np.asarray(overlaps)


def split(h: Array, width: float) -> tuple[Array, Array]:
    """Return f and s above zero, with h = f^(2/3) - s; where h is zero both roots are ``width``."""
    root = np.hypot(0.5 * h, width)
    half = 0.5 * np.abs(h)
    larger = root + half
    less = width**2 / (root + half)
    closed = np.where(h > 0.0, larger, less)
    s = np.where(h > 0.0, less, larger)
    return hertz.press(closed)[0], s
