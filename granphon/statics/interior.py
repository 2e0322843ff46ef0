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

Arrays of contacts are (kinds, cells). Displacements of the balls of all cells
are (fields, cells), and strains of the cell (n_strains,); the letters f and s stand for forces and
gaps alone.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from granphon.balls import hertz
from granphon.base.arrays import Array
from granphon.statics.grid_problem import GridProblem, Unknowns
from granphon.statics.lattice_equations import LatticeEquations, Preconditioners
from granphon.statics.options import InteriorOptions


class Nearby(NamedTuple):
    """What the interior-point method has found.

    Attributes
    ----------
    balls, strains : displacements (fields, cells), and strains (n_strains,), near rest.
    steps, iterations : numbers of steps that led there, and of iterations in them.
    """

    balls: Array
    strains: Array
    steps: int
    iterations: int


class _Point(NamedTuple):
    """An interior point.

    Attributes
    ----------
    balls, strains : displacements (fields, cells), and strains (n_strains,).
    h : (kinds, cells) overlaps at these.
    f, s : (kinds, cells) forces and gaps, above zero.
    """

    balls: Array
    strains: Array
    h: Array
    f: Array
    s: Array


def approach(
    problem: GridProblem,
    equations: LatticeEquations,
    inverses: Preconditioners,
    balls: Array,
    strains: Array,
    is_fresh: bool,
) -> Nearby | None:
    """Return displacements and strains near rest in a ``problem`` on a grid; the way begins at the
    displacements ``balls`` (fields, cells) and at ``strains`` (n_strains,).

    The ``equations`` are those of the problem, with the options, and the ``inverses`` precondition
    them and count the iterations. ``is_fresh`` says whether the balls begin on their sites, rather
    than at rest under another load.

    The result is None if no rest is near after ``inner_steps`` of the options, if the balls are not
    in balance where the method ends, or if the mean force falls to nothing: rest may be at the
    threshold itself, or there may be none.
    """
    numbers = equations.options.interior
    iterations = 0
    last_product = math.inf
    h = problem.find_overlaps(balls, strains)
    width = float(np.std(h)) * (1.0 if is_fresh else numbers.nearby_width)
    f, s = split(h, width)
    point = _Point(balls, strains, h, f, s)
    for step in range(equations.options.inner_steps):
        product = float(np.mean(point.f * point.s))
        mean = float(np.mean(point.f))
        if mean < equations.options.threshold:  # too few balls touch to hold each other
            return None
        # mean of f s over the mean force to the power 5/3, and the largest force left on a ball
        # over the mean force
        relative_product = product / (mean * float(hertz.overlap_of(mean)))
        imbalance = problem.find_largest_force(problem.collect(point.f)) / mean
        if relative_product <= numbers.gap:
            if imbalance > numbers.imbalance:
                return None
            return Nearby(point.balls, point.strains, step, iterations)
        factor = numbers.largest_factor
        if step:
            # forces must keep up with mu: it stays where they lag behind
            has_lagged = imbalance > numbers.lag * math.sqrt(relative_product)
            factor = 1.0 if has_lagged else _choose_factor(product / last_product, numbers)
        last_product = product
        point, count = _advance(point, factor, problem, equations, inverses)
        iterations += count
    return None


def _advance(
    point: _Point,
    factor: float,
    problem: GridProblem,
    equations: LatticeEquations,
    inverses: Preconditioners,
) -> tuple[_Point, int]:
    """Return the point after a step of Newton's method to a mu of ``factor`` times the mean of f s,
    and the number of iterations; the other arguments are those of :func:`approach`.

    The step is whole, but for those f and s that it would make too small, or whose products it
    would make differ too much from mu.
    """
    numbers = equations.options.interior
    balls, strains, h, f, s = point
    mu = factor * float(np.mean(f * s))
    # Newton's equations without f and s: stiffness K, and forces of contacts that drive the motion
    overlap_of_f = hertz.overlap_of(f)  # f^(2/3)
    stiffness = f / (overlap_of_f / hertz.EXPONENT + s)
    # the overlap that f is short of
    shortfall = h - overlap_of_f + mu / f
    drive = f + stiffness * shortfall
    forces = Unknowns(problem.collect(drive), _find_push(problem, f, drive, numbers))
    motion, count = equations.solve(
        stiffness, forces, inverses.choose(stiffness), _choose_accuracy(factor, numbers)
    )
    inverses.count(count)
    # back from the motion to the changes of f and of s, from the equation f s = mu
    loss = problem.add_losses(problem.measure_losses(motion.balls), motion.strains)
    change_of_f = stiffness * (shortfall - loss)
    change_of_s = (mu - s * change_of_f) / f - s
    f = np.maximum(f + change_of_f, numbers.least_part * f)
    s = np.maximum(s + change_of_s, numbers.least_part * s)
    f, s = _bring_near(f, s, mu, numbers)
    strains = strains + motion.strains
    balls = balls + motion.balls
    return _Point(balls, strains, problem.find_overlaps(balls, strains), f, s), count


def _find_push(problem: GridProblem, f: Array, drive: Array, numbers: InteriorOptions) -> Array:
    """Return the forces (n_strains,) that drive the strains: those of the load, and those by forces
    ``drive`` (kinds, cells) of contacts. The result is empty where there are no unknown strains.

    A single strain is driven by no smaller load than one that presses contacts with the part
    ``largest_factor`` of their mean force ``f``: the mean force then falls in several steps.
    """
    of_load = problem.work
    if len(of_load) == 1:
        cells = problem.grid.n_cells
        force = numbers.largest_factor * float(np.mean(f))
        least = force * cells * np.sum(problem.strained, axis=0)
        of_load = -np.maximum(-of_load, least)
    return np.asarray(of_load + np.sum(drive, axis=1) @ problem.strained)


def _choose_accuracy(factor: float, numbers: InteriorOptions) -> float:
    """Return the tolerance of the linear equations of a step, over their right side, where mu is
    lowered by a ``factor``. Where mu stays, the step is to bring forces into balance, as exactly as
    any step.
    """
    if factor == 1.0:
        return numbers.least_error
    return max(numbers.least_error, numbers.accuracy * factor)


def _choose_factor(fall: float, numbers: InteriorOptions) -> float:
    """Return the factor by which mu is lowered in a step, if the step before has lowered the mean
    of f s by the factor ``fall``: mu falls the faster, the more that mean has fallen.
    """
    factor = math.pow(fall, numbers.speed)
    return min(numbers.largest_factor, max(numbers.least_factor, factor))


def _bring_near(f: Array, s: Array, mu: float, numbers: InteriorOptions) -> tuple[Array, Array]:
    """Return forces f and gaps s (kinds, cells) whose products are not far from ``mu``: where those
    of the given f and s are too far, the smaller of f^(2/3) and s is changed.

    Products of some contacts far from those of the others would make the next steps short or wrong.
    """
    product = np.clip(f * s, numbers.least_product * mu, numbers.largest_product * mu)
    is_open = hertz.overlap_of(f) < s
    return np.where(is_open, product / s, f), np.where(is_open, s, product / f)


def split(h: Array, width: float) -> tuple[Array, Array]:
    """Return forces f and gaps s above zero, of the shape of the overlaps ``h``, such that
    h = f^(2/3) - s and that f^(2/3) s is the square of ``width``, above zero.
    """
    # f^(2/3) and -s are the roots of x^2 - h x - width^2; no digits are lost by subtraction
    larger = np.hypot(0.5 * h, width) + 0.5 * np.abs(h)
    smaller = width**2 / larger
    closed = np.where(h > 0.0, larger, smaller)
    s = np.where(h > 0.0, smaller, larger)
    return hertz.press(closed)[0], s
