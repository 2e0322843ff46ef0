"""Contact laws of balls whose diameters differ: mean force, stiffness and energy of a contact
against the mean overlap.

Every medium has its own law, f(delta) with k = df/d(delta). Equal balls follow Hertz's law
(:class:`~granphon.balls.hertz.HertzLaw`). Balls whose diameters spread over a width W follow it
only at overlaps far above W. In the reduced units of Velicky and Caroli (2002, Section IV), y =
delta/W = a* - 1/2 and f* = f/(c W^(3/2)), their law depends only on the shape of the distribution
and on the medium. If all contacts are closed, the law is y^(3/2) times a power series in 1/y. The
series is used at large y: it costs nothing, loses no digits, and becomes the law of equal balls as
W goes to zero. Section and equation numbers in this module are those of that paper. F^Q and K^Q are
the mean force and stiffness of the contacts of a ball Q.
"""

from __future__ import annotations

import math
from abc import abstractmethod
from collections.abc import Callable
from dataclasses import dataclass, field
from functools import lru_cache, partial
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from granphon.balls.diameters import (
    NormalShape,
    PointShape,
    Shape,
    UniformShape,
    evaluate_in_blocks,
)
from granphon.balls.hertz import (
    ENERGY,
    FORCE,
    STIFFNESS,
    EnergyLaw,
    HertzLaw,
    high_pressure_overlap,
    read_overlap,
)
from granphon.base.arrays import ROUNDING, Array
from granphon.base.errors import InputError, PrecisionError
from granphon.base.results import read_only
from granphon.base.scales import WidthUnits
from granphon.base.validation import real_array

#: prefactors of the reduced energy of equal balls, (2/5) y^(5/2), and of its derivatives of order 1
#: to 3
_HERTZ_FACTORS = (0.4, 1.0, 1.5, 0.75)
#: overlap y, over the largest deviation x of a diameter, from which the series is used
_SERIES_START = 12.0
#: number of terms of the series
_TERMS = 16
#: depth y + max(x) above the first contact, over max(x), from which doubles hold eight digits of
#: the force
_LEAST_DEPTH = 1e-8
#: number of nodes, on either side of the middle, for the fraction of closed contacts, which has a
#: kink that the choice of nodes does not allow for
_COUNTING_NODES = 128
#: number of loads that are averaged over balls at once, which bounds the memory
_LOADS_AT_ONCE = 1024
#: largest number of iterations that find the overlap of a force by the series
_MOST_ROUNDS = 20
#: largest number of Newton steps for the overlap of the averaged force
_MOST_STEPS = 200
#: number of rows of the table of forces from which Newton's method starts
_TABLE_ROWS = 512


class Series(NamedTuple):
    """High-pressure series f* = y^(3/2) sum_n mean_n (scale/y)^n, for y from ``start`` on.

    Attributes
    ----------
    mean : (terms,) coefficients of the mean force f*.
    scale : the largest deviation x of a diameter, in units of W.
    start : y from which the series is used.
    balls : (terms, n_Q) coefficients of the force F^Q of each ball.
    weights : (n_Q,) weights of the balls.
    """

    mean: Array
    scale: float
    start: float
    balls: Array
    weights: Array

    def ratio(self, y: Array, order: int) -> Array:
        """Return the derivative of ``order`` 0 to 3 of the reduced energy at each overlap ``y``
        (any shape), divided by the same derivative for equal balls.
        """
        coefficients = self.mean * _compute_factors(order) / _HERTZ_FACTORS[order]
        return np.asarray(np.polynomial.polynomial.polyval(self.scale / y, coefficients))

    def value(self, y: float, order: int) -> float:
        """Return the derivative of ``order`` 0 to 3 of the reduced energy at the overlap ``y``."""
        return float(_HERTZ_FACTORS[order] * y ** (2.5 - order) * self.ratio(np.asarray(y), order))

    def excess(self, y: Array) -> tuple[Array, Array]:
        """Return (F^Q - f)/f and K^Q/k, each (n_y, n_Q), of each ball at the overlaps ``y`` (n_y,).

        The terms of order 0 of F^Q and f are equal. They are left out of F^Q - f, so that no digits
        are lost.
        """
        powers = (self.scale / y[:, None]) ** np.arange(_TERMS)
        stiffness_terms = powers * _compute_factors(STIFFNESS)
        differences = powers[:, 1:] @ (self.balls - self.mean[:, None])[1:]
        force_excess = differences / (powers @ self.mean)[:, None]
        stiffness_ratio = stiffness_terms @ self.balls / (stiffness_terms @ self.mean)[:, None]
        return force_excess, stiffness_ratio


def _compute_factors(order: int) -> Array:
    """Return the factors (terms,) by which the coefficients of the force, whose terms are
    y^(3/2 - n), are multiplied to give those of the derivative of ``order`` 0 to 3 of the energy.
    """
    n = np.arange(_TERMS)
    return np.asarray([1.0 / (2.5 - n), np.ones(n.size), 1.5 - n, (1.5 - n) * (0.5 - n)][order])


@lru_cache(maxsize=128)
def high_pressure_series(shape: Shape, xi: float) -> Series:
    """Return the series of f* if all contacts are closed, by equation (36), for a ``shape`` and the
    local-field factor Xi = ``xi``; an infinite Xi gives the averaged force.

    To second order f* = y^(3/2) (1 + r/(64 y^2)) for symmetric shapes, with r = Xi/(1 + Xi).
    """
    scale = max(map(abs, shape.bounds)) or 1.0  # one if all diameters are equal
    x, weights = shape.nodes(_SERIES_START * scale)
    balls = _expand_forces(x / scale, weights)
    mean = balls @ weights if math.isinf(xi) else _solve_orders(balls, weights, xi)
    return Series(
        read_only(mean), scale, _SERIES_START * scale, read_only(balls), read_only(weights)
    )


def _expand_forces(x: Array, weights: Array) -> Array:
    """Return the coefficients (terms, n_Q) of the powers of z = scale/y in F^Q/y^(3/2), of balls
    with the deviations ``x`` (n_Q,) of their diameters from the mean, in units of the scale, and
    the ``weights`` (n_Q,).

    F^Q/y^(3/2) is the mean of (1 + z (x + x')/2)^(3/2) over the deviations x' of the neighbours.
    So the coefficient of z^m is a binomial coefficient, of 3/2 over m, times the mean of
    ((x + x')/2)^m.
    """
    orders = np.arange(_TERMS)
    moments = [float(np.sum(weights * x**m)) for m in orders]
    ratios = (1.5 - orders[:-1]) / (orders[:-1] + 1.0)
    binomial = np.cumprod(np.concatenate([[1.0], ratios]))
    coefficients = []
    for m in orders.tolist():
        mean_power = sum(math.comb(m, j) * moments[j] * x ** (m - j) for j in range(m + 1))
        coefficients.append(binomial[m] * 0.5**m * mean_power)
    return np.array(coefficients)


def _solve_orders(balls: Array, weights: Array, xi: float) -> Array:
    """Return the coefficients (terms,) of f* that solve equation (36), <(F^Q - f)/(K^Q + Xi k)> =
    0, order by order.

    ``balls`` (terms, n_Q) are the coefficients of F^Q, ``weights`` (n_Q,) the weights of the balls,
    and ``xi`` is the local-field factor. At leading order force and stiffness are the same for all
    balls. So a coefficient of f enters its own order of the equation linearly, and the coefficient
    of k that belongs to it enters higher orders only.
    """
    orders = np.arange(_TERMS)
    stiffness_factors = _compute_factors(STIFFNESS)
    mean = np.zeros(_TERMS)
    inverse = np.zeros_like(balls)  # coefficients of 1/(K^Q + Xi k)
    mean[0] = 1.0
    inverse[0] = 1.0 / (1.5 * (1.0 + xi))
    for m in orders[1:]:
        terms = [(balls[j] - mean[j]) * inverse[m - j] for j in orders[1:m]]
        mean[m] = weights @ sum(terms, balls[m] * inverse[0]) / inverse[0, 0]
        stiffnesses = [stiffness_factors[j] * (balls[j] + xi * mean[j]) for j in orders[1 : m + 1]]
        products = [stiffness * inverse[m - j] for j, stiffness in enumerate(stiffnesses, 1)]
        inverse[m] = -inverse[0] * sum(products)
    return mean


class SpreadLaw(EnergyLaw):
    """Contact law f = c W^(3/2) f*(y), y = delta/W, of balls whose diameters differ.

    Methods take numbers or arrays of any shape; for a number they return a float. An ``overlap`` is
    delta in m, and a ``force`` is f in N. The energy is the integral of the force over the overlap,
    and zero if all contacts are open. A subclass gives the reduced law for y below the start of the
    series.

    Attributes
    ----------
    coefficient : c of Hertz's law of equal balls, N/m^(3/2).
    width : W, the width of the distribution of diameters, m.
    shape : the shape of the distribution, of diameters that differ.
    xi : the local-field factor Xi, above zero.
    """

    coefficient: float
    width: float
    shape: UniformShape | NormalShape | PointShape = field(
        metadata={"kind": UniformShape | NormalShape | PointShape}
    )

    #: Xi, the stiffness with which the rest of the lattice holds the neighbours of a ball, its
    #: corona, in units of k; infinite if balls stay at their sites
    xi: float

    @abstractmethod
    def _evaluate_near(self, y: Array, order: int) -> Array:
        """Return the derivative of ``order`` 0 to 3 of the reduced energy with respect to
        y, at each y (any shape) below the start of the series; zero if all contacts are open.
        """

    @abstractmethod
    def _find_near_overlap(self, force: Array) -> Array:
        """Return the reduced overlap y at each reduced force f*, ``force`` (any shape), below that
        at the start of the series.
        """

    @property
    def _series(self) -> Series:
        """The high-pressure series of the law."""
        return high_pressure_series(self.shape, self.xi)

    @property
    def _energy_offset(self) -> float:
        """Reduced energy to be added to that of the series."""
        return 0.0

    @property
    def least_overlap(self) -> float:
        """Overlap, m, up to which all contacts are open; below zero."""
        return -self.width * self.shape.bounds[1]

    def overlap(self, force: ArrayLike) -> Any:
        """Return the overlap delta, m, at a mean contact ``force`` above zero, N.

        Raises :class:`~granphon.base.errors.InputError` if a force is no real number, not above
        zero or infinite, and :class:`~granphon.base.errors.PrecisionError` if a force is so small
        that the law is not known there.
        """
        forces = real_array("force", force)
        if not np.all(forces > 0.0):
            raise InputError(
                "the mean force of the contacts is not above zero",
                "Contacts carry no tension, so no single overlap belongs to such a force",
            )

        def invert_near(force: Array) -> Array:
            """Return the overlaps, m, at forces below that at the start of the series, N."""
            reduced_force = np.asarray(self._units.reduced_force(force))
            return self.width * self._find_near_overlap(reduced_force)

        def invert_series(force: Array) -> Array:
            """Return the overlaps, m, at forces from that at the start of the series on, N."""
            hertz = HertzLaw(self.coefficient)
            delta = np.asarray(hertz.overlap(force))
            for _ in range(_MOST_ROUNDS):
                # the ratio is within 1 % of one, so that each iteration gains two digits or more
                ratio = self._series.ratio(delta / self.width, FORCE)
                next_delta = np.asarray(hertz.overlap(force / ratio))
                is_settled = np.all(np.abs(next_delta - delta) <= ROUNDING * next_delta)
                delta = next_delta
                if is_settled:
                    break
            return delta

        # W may be so small that the reduced load is above the floating range, where the series
        # holds
        with np.errstate(over="ignore", under="ignore"):
            force_at_start = self._series.value(self._series.start, FORCE)
            is_far = self._units.reduced_force(forces) >= force_at_start
            return self._evaluate_parts(forces, is_far, invert_series, invert_near)

    def force_fluctuation(self, overlap: ArrayLike) -> Any:
        """Return Delta f / f of Section IV at each ``overlap``, m: the rms deviation, over balls Q,
        of the force F^Q - K^Q u^Q from the mean force f, divided by f. The corona of a ball has
        been displaced by u^Q. The result is zero where all contacts are open.

        Raises :class:`~granphon.base.errors.InputError` for an overlap that
        :func:`~granphon.balls.hertz.read_overlap` refuses.
        """

        def compute_rms(force_excess: Array, stiffness_ratio: Array, weights: Array) -> Array:
            """Return the rms (n_y,), over balls, of (F^Q - K^Q u^Q - f)/f.

            ``force_excess`` is (F^Q - f)/f and ``stiffness_ratio`` is K^Q/k, both (n_y, n_Q);
            ``weights`` are (n_y, n_Q) or (n_Q,).
            """
            # F^Q - K^Q u^Q - f = (F^Q - f)/(1 + K^Q/(Xi k)), as u^Q = (F^Q - f)/(K^Q + Xi k)
            relaxed_excess = force_excess / (1.0 + stiffness_ratio / self.xi)
            return np.asarray(np.sqrt(np.sum(weights * relaxed_excess**2, axis=-1)))

        def find_far(y: Array) -> Array:
            """Return Delta f / f (n_y,) at overlaps y (n_y,), from the start of the series on."""
            force_excess, stiffness_ratio = self._series.excess(y)
            return compute_rms(force_excess, stiffness_ratio, self._series.weights)

        def find_near(y: Array) -> Array:
            """Return Delta f / f (n_y,) at overlaps y (n_y,) below the start of the series."""
            nodes = self.shape.nodes(y)
            force_excess, stiffness_ratio = self._compute_excesses(y, nodes.positions)
            return compute_rms(force_excess, stiffness_ratio, nodes.weights)

        return self._evaluate_joined(overlap, find_far, find_near)

    def contact_fraction(self, overlap: ArrayLike) -> Any:
        """Return the fraction of contacts that are closed (N_c of Section IV) at each ``overlap``,
        m, if the corona of each ball Q is displaced by u^Q = (F^Q - f)/(K^Q + Xi k).

        Raises :class:`~granphon.base.errors.InputError` for an overlap that
        :func:`~granphon.balls.hertz.read_overlap` refuses.
        """

        def find_near(y: Array) -> Array:
            """Return the fractions (n_y,) at overlaps y (n_y,) below the start of the series."""
            nodes = self.shape.nodes(y, _COUNTING_NODES, whole=True)
            force_excess, stiffness_ratio = self._compute_excesses(y, nodes.positions)
            force = self._evaluate_near(y, FORCE)
            k = self._evaluate_near(y, STIFFNESS)
            force_over_stiffness = force / np.where(k > 0.0, k, 1.0)
            # reduced displacement u^Q of the corona
            displacement = (
                force_over_stiffness[:, None] * force_excess / (stiffness_ratio + self.xi)
            )
            # the fraction of the contacts of each ball
            fractions = self.shape.average(y[:, None] - displacement, 0.0, nodes.positions)
            # the sum of the weights may be above one by rounding
            return np.asarray(np.minimum(np.sum(nodes.weights * fractions, axis=-1), 1.0))

        return self._evaluate_joined(overlap, np.ones_like, find_near)

    def _compute_excesses(self, y: Array, x: Array) -> tuple[Array, Array]:
        """Return (F^Q - f)/f and K^Q/k, each (n_y, n_Q), of balls with the reduced deviations ``x``
        (n_y, n_Q) of their diameters, at ``y`` (n_y,) below the start of the series.

        Both are zero if all contacts are open.
        """
        force = self._evaluate_near(y, FORCE)[:, None]
        k = self._evaluate_near(y, STIFFNESS)[:, None]
        has_force = force > 0.0
        # no division by zero where all contacts are open
        force_or_one = np.where(has_force, force, 1.0)
        k_or_one = np.where(has_force, k, 1.0)
        force_excess = self.shape.force(y[:, None], x) / force_or_one - 1.0
        stiffness_ratio = self.shape.stiffness(y[:, None], x) / k_or_one
        return force_excess * has_force, stiffness_ratio

    # -- between SI and reduced --------------------------------------------------------------------

    @property
    def _units(self) -> WidthUnits:
        """SI values of the reduced units of a distribution of width W."""
        return WidthUnits(self.coefficient, self.width)

    def _reduce_overlap(self, overlap: Array) -> Array:
        """Return y = overlap/W at each ``overlap``, m. Where the balls are farther apart than at
        the first contact, y is that of the first contact, as nothing changes from there on.
        """
        return np.asarray(np.maximum(overlap / self.width, -self.shape.bounds[1]))

    def _find_unit(self, order: int) -> float:
        """Return the SI value of the reduced unit of energy, force, stiffness or slope of the
        stiffness, for an ``order`` of 0 to 3.
        """
        units = self._units
        name = ("energy", "force", "stiffness", "stiffness_slope")[order]
        return float(getattr(units, name))

    def least_valid_force(self, width: float) -> float:
        """Return the force, N, from which the law is valid for a packing of ``width`` W, m: the
        force at high pressure.
        """
        return float(self.force(high_pressure_overlap(width)))

    def _evaluate(self, overlap: ArrayLike, order: int) -> Any:
        """Return the derivative of ``order`` 0 to 3 of the energy, J/m^order, at each
        ``overlap``, m: by the series at large overlaps, and by the reduced law of the subclass at
        others.
        """
        delta = np.asarray(overlap, float)
        hertz = HertzLaw(self.coefficient)
        offset = 0.0
        if order == ENERGY:
            offset = self._energy_offset * self._find_unit(ENERGY)

        def find_far(overlap: Array) -> Array:
            """Return the derivatives (n,) at ``overlap`` (n,), m, by the series."""
            ratio = self._series.ratio(overlap / self.width, order)
            return np.asarray(hertz._evaluate(overlap, order) * ratio + offset)

        def find_near(overlap: Array) -> Array:
            """Return the derivatives (n,) at ``overlap`` (n,), m, by the reduced law."""
            y = self._reduce_overlap(overlap)
            return self._find_unit(order) * self._evaluate_near(y, order)

        # W may be so small that y is above the floating range, where the series holds
        with np.errstate(over="ignore", under="ignore"):
            is_far = delta / self.width >= self._series.start
            return self._evaluate_parts(delta, is_far, find_far, find_near)

    @staticmethod
    def _evaluate_parts(
        arguments: Array,
        is_far: Any,
        find_far: Callable[[Array], Array],
        find_near: Callable[[Array], Array],
    ) -> Any:
        """Return the values of ``find_far`` at those ``arguments`` for which ``is_far`` is true,
        and of ``find_near`` at the others, in the shape of the arguments; a float for a number.

        A function is not called if no argument is left for it; ``find_far`` is called if there are
        no arguments at all.
        """
        if np.all(is_far):
            return find_far(arguments)[()]
        if not np.any(is_far):
            return find_near(arguments)[()]
        results = np.empty(arguments.shape)
        results[is_far] = find_far(arguments[is_far])
        results[~is_far] = find_near(arguments[~is_far])
        return results

    def _evaluate_joined(
        self,
        overlap: ArrayLike,
        find_far: Callable[[Array], Array],
        find_near: Callable[[Array], Array],
    ) -> Any:
        """Return the values of a function of y = overlap/W at each ``overlap``, m, in its shape;
        InputError for an overlap that :func:`~granphon.balls.hertz.read_overlap` refuses.

        The function is ``find_far`` from the start of the series on, and ``find_near`` below the
        start; both take an array of y (n,) and return (n,).
        """
        delta = read_overlap(overlap)
        far_in_blocks = partial(evaluate_in_blocks, find_far, size=_LOADS_AT_ONCE)
        near_in_blocks = partial(evaluate_in_blocks, find_near, size=_LOADS_AT_ONCE)
        # W may be so small that y is above the floating range, where the series holds
        with np.errstate(over="ignore", under="ignore"):
            y = self._reduce_overlap(delta)
            is_far = y >= self._series.start
            return self._evaluate_parts(y, is_far, far_in_blocks, near_in_blocks)


# -- the averaged force ----------------------------------------------------------------------------


@dataclass(frozen=True)
class AveragedLaw(SpreadLaw):
    """Contact law of balls held at the sites of the lattice: the mean over pairs of their forces, f
    = <F^QQ'> (equation 25).

    Attributes
    ----------
    coefficient : c of Hertz's law of equal balls, N/m^(3/2).
    width : W, the width of the distribution of diameters, m.
    shape : the shape of the distribution.
    """

    coefficient: float
    width: float
    shape: UniformShape | NormalShape | PointShape = field(
        metadata={"kind": UniformShape | NormalShape | PointShape}
    )

    xi = math.inf

    def _evaluate_near(self, y: Array, order: int) -> Array:
        """Return the mean over pairs of the derivative of ``order`` 0 to 3 of the reduced
        energy, at each y (any shape).
        """
        return np.asarray(_HERTZ_FACTORS[order] * self.shape.average(y, 2.5 - order))

    def _find_near_overlap(self, force: Array) -> Array:
        """Return the reduced overlap y at each reduced force f*, ``force`` (any shape), below that
        at the start of the series, by Newton's method.

        Raises :class:`~granphon.base.errors.PrecisionError` for a force so small that doubles do
        not hold eight digits of it, and if Newton's method does not end.
        """
        log_depths, log_forces = _tabulate_force(self.shape)
        first_contact = -self.shape.bounds[1]  # y up to which all contacts are open
        with np.errstate(divide="ignore"):  # a force below the floating range is refused below
            log_force = np.log(force)
        if np.any(log_force < log_forces[0]):
            raise PrecisionError(
                f"a mean contact force of f* = {float(np.min(force)):.3g} is too small",
                "So near the first contact an overlap in double precision does not give the"
                " force to eight digits",
                "Raise the load",
            )
        # Newton's method starts from the next larger force of the table: as the force is convex in
        # y, the method then descends to the root, past any kink. The index is limited because
        # rounding may put a force just below the start of the series beyond the table
        index = np.minimum(np.searchsorted(log_forces, log_force), log_forces.size - 1)
        y = np.ravel(first_contact + np.exp(log_depths[index]))
        target = np.ravel(force)
        is_active = np.ones(y.shape, bool)
        for _ in range(_MOST_STEPS):
            residual = np.asarray(self.shape.force(y[is_active])) - target[is_active]
            step = residual / np.asarray(self.shape.stiffness(y[is_active]))
            # a value is settled when its step is negative, or no larger than rounding
            is_settled = step <= 0.5 * ROUNDING * np.abs(y[is_active])
            y[is_active] -= np.where(is_settled, 0.0, step)
            is_active[is_active] = ~is_settled
            if not np.any(is_active):
                return y.reshape(np.shape(force))
        raise PrecisionError(
            "the overlap of the averaged force does not converge", mend="Give a less uneven spread"
        )

    def contact_fraction(self, overlap: ArrayLike) -> Any:
        """Return the fraction of pairs that overlap, at each ``overlap`` of mean balls, m.

        Raises :class:`~granphon.base.errors.InputError` for an overlap that
        :func:`~granphon.balls.hertz.read_overlap` refuses.
        """

        def find_near(y: Array) -> Array:
            """Return the fractions (n_y,) at overlaps y (n_y,) below the start of the series."""
            # the sum of the weights may be above one by rounding
            return np.asarray(np.minimum(self.shape.average(y, 0.0), 1.0))

        return self._evaluate_joined(overlap, np.ones_like, find_near)


@lru_cache(maxsize=128)
def _tabulate_force(shape: Shape) -> tuple[Array, Array]:
    """Return a table of the averaged force of a ``shape``: natural logarithms (rows,) of the depth
    y + max(x) above the first contact, and of the reduced force f* there, both ascending up to the
    start of the series.
    """
    start = high_pressure_series(shape, math.inf).start
    first_contact = -shape.bounds[1]
    log_least = math.log(_LEAST_DEPTH * abs(first_contact))
    log_most = math.log(start - first_contact)
    log_depths = np.linspace(log_least, log_most, _TABLE_ROWS)
    log_forces = np.log(shape.force(first_contact + np.exp(log_depths)))
    return read_only(log_depths), read_only(log_forces)
