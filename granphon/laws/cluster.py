"""The contact law of the cluster medium: a cluster of random balls among random balls, all in Hertz
contact.

The equations are those of :mod:`granphon.laws.cluster_balance`. They are solved at some overlaps,
and the curve is fitted to these by a polynomial and a series.

In reduced units let f = (y + c)^(3/2): c is what the overlap of equal balls would have to be larger
by to carry the mean force. It is a polynomial in x = 1/(y + b), from x = 2 at the lowest overlap of
the curve to where all contacts are closed. From there on f is y^(3/2) times a series in 1/y, whose
second order is 3/8 <s^2>. Both are fitted to f and to k, so that k, its slope and the energy are
derivatives and the integral of one function.
"""

from __future__ import annotations

from copy import deepcopy
from dataclasses import dataclass, replace
from functools import cached_property, lru_cache

import numpy as np
from numpy.polynomial import chebyshev
from numpy.typing import ArrayLike

from granphon.balls.diameters import NormalShape, PointShape, Shape, UniformShape
from granphon.balls.hertz import ENERGY, FORCE, SLOPE, STIFFNESS
from granphon.balls.lattices import Lattice
from granphon.base.arrays import Array
from granphon.base.errors import PrecisionError
from granphon.base.results import read_only
from granphon.base.threads import single_products
from granphon.dynamics.cluster_response import cluster_response
from granphon.laws.cluster_balance import Balance, ClusterBalance, PointSource
from granphon.laws.cluster_descent import MOST_SETS, ClusterDescent
from granphon.laws.spread import TERMS, CurveLaw, Series

#: f* from which force and stiffness are within 2.5 % of the simulated array's, on the triangular
#: lattice and in fcc
VALID_FORCE = 0.03
#: f* down to which the curve is solved
LEAST_SOLVED_FORCE = 3e-3
#: degree of the polynomial: each overlap gives two numbers, force and stiffness
_DEGREE = 18
#: number of realisations of each scramble of the curve, for a cluster of 12 contacts
_POINTS = 1024
#: number of scrambles of the curve, for a cluster of 12 contacts
_SCRAMBLES = 8
#: relative standard error of the force that the quadrature may leave
_ERROR = 8e-5
#: f* below which it may leave more, as 1/f*^3
_ERROR_FORCE = 0.022
#: most that it may leave
_MOST_ERROR = 2.5e-3
#: part of that which the survey between the overlaps where it is found may add
_ROUGH_SHARE = 0.45
#: x at the lowest overlap
_MOST_X = 2.0


@dataclass(frozen=True)
class ClusterLaw(CurveLaw):
    """Contact law of a cluster medium.

    ``coefficient`` c (N/m^(3/2)) of equal balls, ``width`` W (m), ``shape`` of the distribution,
    the ``lattice``, its ``mindlin_ratio`` eta and ``bending`` (over k d^2), and the number of
    ``balls`` of the cluster. Energy is counted from the start of the curve. Methods raise
    :class:`~granphon.base.errors.PrecisionError` between the first contact and the start of the
    curve.
    """

    coefficient: float
    width: float
    shape: UniformShape | NormalShape | PointShape
    lattice: Lattice
    mindlin_ratio: float
    balls: int
    bending: float = 0.0

    _valid_force = VALID_FORCE
    _medium = "cluster medium"

    @property
    def curve(self) -> ClusterCurve:
        """Reduced law, in units of W and c W^(3/2)."""
        return cluster_curve(self.shape, self.lattice, self.mindlin_ratio, self.balls, self.bending)

    @property
    def _series(self) -> Series:
        return self.curve.far

    def quadrature_error(self, overlap: ArrayLike) -> ArrayLike:
        """Return the relative standard error of the force that is left by the quadrature, from its
        independent scrambles.
        """
        curve = self.curve
        return np.interp(np.asarray(overlap, float) / self.width, curve.nodes, curve.errors)[()]

    def force_fluctuation(self, overlap: ArrayLike) -> ArrayLike:
        """Return Delta f / f of Section IV: the rms deviation of the mean force on the ball in the
        middle, over the mean.
        """
        curve = self.curve
        depth = curve.nodes + curve.offset  # times y + b it is smooth

        def far(y: Array) -> Array:
            return np.asarray(curve.fluctuations[-1] * curve.nodes[-1] / y)

        def near(y: Array) -> Array:
            return curve.interpolate(y, curve.fluctuations * depth) / (y + curve.offset)

        return self._evaluate_joined(overlap, far, near)  # type: ignore[no-any-return]

    def contact_fraction(self, overlap: ArrayLike) -> ArrayLike:
        """Return the fraction of the contacts of the ball in the middle that carry force."""
        curve = self.curve
        return self._evaluate_joined(  # type: ignore[no-any-return]
            overlap, np.ones_like, lambda y: np.clip(curve.interpolate(y, curve.contacts), 0.0, 1.0)
        )


# -- the curve -------------------------------------------------------------------------------------


@lru_cache(maxsize=16)
@single_products()
def cluster_curve(
    shape: Shape,
    lattice: Lattice,
    mindlin_ratio: float,
    balls: int,
    bending: float = 0.0,
    seed: int = 0,
) -> ClusterCurve:
    """Solve the cluster medium for a shape, a lattice with its eta and bending, and a number of
    balls; it is cached.

    Solutions of seeds that are 8 or more apart share no realisation.

    Raises :class:`~granphon.base.errors.PrecisionError` if it does not settle.
    """
    response = cluster_response(lattice, mindlin_ratio, balls, bending)
    points = _POINTS
    scrambles = _SCRAMBLES
    # a realisation of a larger cluster takes more time, and says more
    if (larger := 2 ** max(0, round(1.3 * float(np.log2(len(response.response) / 12.0))))) > 1:
        points = points // 2
        scrambles = max(1, scrambles // larger)
    # the series at high load begins here, in widths W
    top = max(2.0, 2.5 * max(map(abs, shape.bounds)))
    # <s^2> in units of W^2
    second = float(np.mean(np.diag(response.misfit)[response.central])) / 12.0

    def guess(y: float) -> tuple[float, float, float]:
        # the effective lattice at high load, to second order in 1/y
        off = second / y**2
        return y**1.5 * (1.0 + 0.375 * off), 1.5 * y**0.5 * (1.0 - 0.2 * off), 0.4 * second / y

    # few realisations find the overlap at which f* falls to the least that is solved
    source = PointSource(response, shape)
    balance = ClusterBalance(response, source.draw([0], 256))
    now = balance.solve(top, guess(top))
    least = LEAST_SOLVED_FORCE ** (2.0 / 3.0)
    share = 0.5
    while now.force > 1.001 * LEAST_SOLVED_FORCE:
        # f^(2/3) is nearly linear in y; a step takes off no more than half of it
        root = now.force ** (2.0 / 3.0)
        slope = root * now.stiffness / (1.5 * now.force)
        trial = deepcopy(balance)
        try:
            now = trial.step(now, now.y - min(share * root, root - least) / slope)
            balance = trial
        except PrecisionError:
            share *= 0.5
            if share > 0.02:
                continue
            # there the conditions may have no solution below, and the curve ends; above f* = 0.02
            # it may not
            if now.force > 0.02:
                raise
            break
    lowest = now.y
    offset = 1.0 / _MOST_X - lowest
    balance = ClusterBalance(response, source.draw(range(seed, seed + scrambles), points))
    far = [balance.solve(top * part, guess(top * part)) for part in (6.0, 3.0, 1.8, 1.3, 1.0)]
    near = [far[-1]]
    # from the top to the lowest overlap, at 23 nodes with the ends included
    x = 1.0 / (top + offset) + (_MOST_X - 1.0 / (top + offset)) * 0.5 * (
        1.0 - np.cos(np.linspace(0.0, np.pi, 23))
    )
    overlaps = 1.0 / x[1:] - offset
    if lowest < 0.0:
        overlaps[np.argmin(np.abs(overlaps[:-1]))] = 0.0  # that of touching balls is one of them
    for y in overlaps.tolist():
        near.append(balance.step(near[-1], y))
    near = _refine(near, ClusterDescent(balance, shape, seed), offset)
    # the series at high load: orders three to nine of f/y^(3/2) in 1/y, relative to equal balls,
    # over the second
    y, force, k = np.array([(one.y, one.force, one.stiffness) for one in far]).T
    start = float(y[-1])
    known = 0.375 * second / y**2
    orders = np.arange(3, 10)
    powers = (start / y[:, None]) ** orders
    goal = [force / y**1.5 - 1.0 - known, k / (1.5 * y**0.5) - 1.0 + known / 3.0]
    mean = np.zeros(TERMS)
    mean[0], mean[2] = 1.0, 0.375 * second / start**2
    rows = [powers, (1.0 - orders / 1.5) * powers]
    mean[orders] = np.linalg.lstsq(np.concatenate(rows), np.concatenate(goal), rcond=None)[0]
    series = Series(read_only(mean), start, start, np.zeros((TERMS, 1)), np.ones(1))
    # the polynomial below it, fitted to f and k
    y, force, k, errors = np.array([(one.y, one.force, one.stiffness, one.error) for one in near]).T
    root = np.cbrt(force)
    basis, slopes, bends = _make_basis(y, start, offset)
    # forces that are known well, against the 2e-5 that a polynomial is off, weigh more; by the root
    # only, so that others still hold the curve at low load. Stiffnesses weigh less, as their
    # quadrature error is larger
    weight = np.sqrt(2e-5 / np.hypot(2e-5, errors)) / root**2
    steep = 0.01 * root / k
    # c = f^(2/3) - y, and at the top its value and first two derivatives are those of the series,
    # which weigh most
    f0, f1, f2 = (series.value(start, order) for order in (FORCE, STIFFNESS, SLOPE))
    third = np.cbrt(f0)
    joins = [
        third**2 - start,
        2.0 / 3.0 * f1 / third - 1.0,
        2.0 / 3.0 * (f2 - f1**2 / (3.0 * f0)) / third,
    ]
    rows = [
        weight[:, None] * basis,
        steep[:, None] * slopes,
        100.0 * np.stack([basis[0], slopes[0], bends[0]]),
    ]
    goal = [weight * (root**2 - y), steep * (2.0 / 3.0 * k / root - 1.0), 100.0 * np.array(joins)]
    coefficients = np.linalg.lstsq(np.concatenate(rows), np.concatenate(goal), rcond=None)[0]
    # what the polynomial is off, relative to f, is an error of the law as well
    off = 1.5 * (basis @ coefficients - (root**2 - y)) / root**2
    errors = np.hypot(errors, off)
    tables = (
        y,
        errors,
        *([getattr(one, name) for one in near] for name in ("fluctuation", "contacts")),
    )
    return ClusterCurve(
        offset,
        read_only(coefficients),
        series,
        *(read_only(np.array(table)[::-1]) for table in tables),
    )


def _refine(found: list[Balance], descent: ClusterDescent, offset: float) -> list[Balance]:
    """Take the quadrature error off solutions in descending order of y.

    At every other one it is taken off whole. Between them means are those of the cubic polynomial
    through the nearest four, and what a survey says that they are off it. Its points are the same
    everywhere, so that their error is a smooth function of y and hardly matters. How rough it is
    follows from the scatter between sets of points, of which there are so many that the standard
    error comes down to a part of the goal. What is taken off the stiffness is the slope of what is
    taken off the force. Errors of the whole ones count as independent: they share a few points of
    their long descents, and few else.
    """
    from scipy.interpolate import CubicSpline, krogh_interpolate

    n = len(found)
    x, forces = np.array([(1.0 / (one.y + offset), one.force) for one in found]).T
    # the relative standard error that the force is to have: larger below where the medium is valid
    goals = np.minimum(_ERROR * np.maximum(1.0, _ERROR_FORCE / forces) ** 3, _MOST_ERROR)
    # whole: every other place from that of the last y above zero on, either way, and both ends
    places = np.arange(n)
    touching = sum(one.y >= 0.0 for one in found) - 1
    whole = np.flatnonzero(((places - touching) % 2 == 0) | (places == 0) | (places == n - 1))
    # weights (n, whole) that values at x[whole] have at x in the polynomials
    weights = np.zeros((n, len(whole)))
    for i, at in enumerate(x):
        near = slice(
            begin := int(np.clip(np.searchsorted(whole, i) - 2, 0, len(whole) - 4)), begin + 4
        )
        weights[i, near] = krogh_interpolate(x[whole[near]], np.eye(4), at)
    weights[whole] = np.eye(len(whole))
    better, whole_errors, surveys = zip(
        *(descent.refine(found[i], goals[i], 1 + i) for i in whole.tolist()), strict=True
    )
    first = np.empty((n, *surveys[0].shape))
    first[whole] = surveys
    rest = np.setdiff1d(places, whole)
    first[rest] = [descent.evaluate_first(found[i])[..., :4] for i in rest.tolist()]

    def find_off(means: Array) -> Array:
        # how far means (n, sets, 4) are off the polynomials through those of the whole: (sets, n,
        # 4)
        return np.asarray(means - np.einsum("iw,swm->sim", weights, means[:, whole]))

    middle, long = np.moveaxis(first, 0, 2)
    wanted = np.ceil(
        np.square(
            np.std(find_off(middle)[..., 0], axis=0, ddof=1) / (_ROUGH_SHARE * goals * forces)
        )
    )
    counts = np.clip(wanted, len(middle), MOST_SETS).astype(int)
    # a set serves at a place if all solutions of its polynomial have it
    drawn = counts.copy()
    drawn[whole] = np.max(np.where(weights != 0.0, counts[:, None], 0), axis=0)
    start = find_off(np.concatenate([middle, descent.survey(found, drawn.tolist(), len(middle))]))
    end = find_off(long - middle)
    off, variances = np.mean(end, axis=0), np.var(end[..., 0], axis=0, ddof=1) / len(end)
    for i, count in enumerate(counts.tolist()):
        off[i] += np.mean(start[:count, i], axis=0)
        variances[i] += np.var(start[:count, i, 0], ddof=1) / count
    means = weights @ better + off
    errors = np.sqrt(np.square(weights) @ np.square(whole_errors) + variances)
    slope = CubicSpline(x, means[:, 0] - forces)(x, 1)
    return [
        replace(
            one,
            force=force,
            stiffness=one.stiffness - float(at**2 * change),
            error=float(error / force),
            fluctuation=float(np.sqrt(max(square / ball**2 - 1.0, 0.0))),
            contacts=contacts,
        )
        for one, at, change, error, (force, ball, square, contacts) in zip(
            found, x, slope, errors, means.tolist(), strict=True
        )
    ]


@dataclass(frozen=True, eq=False)
class ClusterCurve:
    """Solution of the cluster medium, as f* over y from ``start`` on.

    ``offset`` is b, ``coefficients`` are those of c as a Chebyshev series over the range of x, and
    ``far`` is the series at high load. ``nodes`` (n,) are the overlaps at which it was solved,
    ascending, with the ``errors`` of f*, the relative standard errors of the quadrature with what
    the polynomial is off, ``fluctuations`` and ``contacts`` there.
    """

    offset: float
    coefficients: Array
    far: Series
    nodes: Array
    errors: Array
    fluctuations: Array
    contacts: Array

    @cached_property
    def start(self) -> float:
        """Reduced overlap at the start of the curve."""
        return float(self.nodes[0])

    @cached_property
    def least_force(self) -> float:
        """Reduced force at the start of the curve."""
        return float(self.value(np.array(self.start), FORCE))

    def interpolate(self, y: Array, values: Array) -> Array:
        """Interpolate between values at the nodes, without overshooting."""
        from scipy.interpolate import PchipInterpolator

        depth = np.log(self.nodes - self.start + 0.5)
        return np.asarray(PchipInterpolator(depth, values)(np.log(y - self.start + 0.5)))

    def value(self, y: Array, order: int) -> Array:
        """Return a derivative of the energy, counted from the start of the curve, at y between
        there and ``far.start``.
        """
        if order == ENERGY:
            nodes, weights = np.polynomial.legendre.leggauss(64)
            # over the logarithm of y + b
            low = np.log(self.start + self.offset)
            high = np.log(y + self.offset)[..., None]
            depth = np.exp(low + 0.5 * (high - low) * (1.0 + nodes))
            part = weights * depth * self.value(depth - self.offset, FORCE)
            return np.asarray(np.sum(0.5 * (high - low) * part, axis=-1))
        overlap, slope, bend = self._find_equal_overlap(y)
        root = np.sqrt(overlap)
        if order == FORCE:
            return np.asarray(overlap * root)
        if order == STIFFNESS:
            return np.asarray(1.5 * root * slope)
        return np.asarray(0.75 * slope**2 / root + 1.5 * root * bend)

    def _find_equal_overlap(self, y: Array) -> tuple[Array, Array, Array]:
        """Return the overlap y + c of equal balls with the same force, and its first two
        derivatives with y.
        """
        c, slope, bend = (
            table @ self.coefficients for table in _make_basis(y, self.far.start, self.offset)
        )
        return np.asarray(y + c), np.asarray(1.0 + slope), np.asarray(bend)

    def overlap(self, force: Array) -> Array:
        """Return y at forces on the curve, by Newton's method for y + c, which is nearly linear."""
        wanted = np.asarray(np.cbrt(force) ** 2)
        table = np.linspace(self.start, self.far.start, 256)
        y = np.interp(wanted, self._find_equal_overlap(table)[0], table)
        for _ in range(20):
            found, slope, _ = self._find_equal_overlap(y)
            change = (wanted - found) / slope
            y = np.clip(y + change, self.start, self.far.start)
            if np.all(np.abs(change) <= 1e-15 * (1.0 + np.abs(y))):
                break
        return np.asarray(y)


def _make_basis(y: Array, top: float, offset: float) -> tuple[Array, Array, Array]:
    """Return the Chebyshev polynomials of x at y, and their first two derivatives with y, (...,
    degree + 1).
    """
    x = 1.0 / (y + offset)
    least = 1.0 / (top + offset)
    scale = 2.0 / (_MOST_X - least)
    t = scale * (x - least) - 1.0
    value, first, second = (
        scale**n
        * np.moveaxis(chebyshev.chebval(t, chebyshev.chebder(np.eye(_DEGREE + 1), n)), 0, -1)
        for n in range(3)
    )
    x = np.asarray(x)[..., None]
    return (
        np.asarray(value),
        np.asarray(-(x**2) * first),
        np.asarray(x**4 * second + 2.0 * x**3 * first),
    )
