"""Reference results from other algorithms than those of the package, to measure its errors; slower
than what they judge.

- :func:`integrate_local_field` integrates the lattice's Green's function by adaptive rules of scipy;
- :func:`integrate_curve` follows the effective medium's curve as a differential equation, by scipy's integrators;
- :func:`count_modes` counts modes along whole lines of wave vectors, between the roots of a determinant: no mesh, no
  interpolation of branches, no phonopy.
"""

from __future__ import annotations

import math
import warnings
from itertools import pairwise
from typing import Any, Literal

import numpy as np
from numpy.typing import ArrayLike, NDArray

from granphon.balls.diameters import PointShape, Shape
from granphon.balls.hertz import STIFFNESS
from granphon.base.errors import PrecisionError
from granphon.dynamics.contact_lattice import ContactLattice
from granphon.laws.spread import high_pressure_series

Array = NDArray[np.float64]
#: balls over which (36) sums: weights, F^Q, K^Q, and the derivative of K^Q by y or by a variable of
#: y; each (n_Q,)
BallSums = tuple[Array, Array, Array, Array]

# -- the local field -------------------------------------------------------------------------------

#: relative error asked of each integral
_ASKED_ERROR = 1e-13
#: angles of the contacts of the triangular lattice with a1, each direction once, rad
_ANGLES = np.pi / 3.0 * np.arange(3)
#: unit vectors along these contacts, (2, 3)
_NORMALS = np.stack([np.cos(_ANGLES), np.sin(_ANGLES)])
#: unit vectors across these contacts, (2, 3)
_TANGENTS = np.stack([-np.sin(_ANGLES), np.cos(_ANGLES)])


def integrate_local_field(mindlin_ratio: float) -> tuple[float, float]:
    """Return Xi of the triangular lattice and a bound on its error, by adaptive Gauss-Kronrod
    rules.

    u_1 = <F^T D^-1 F>/6 with F(q) the unit radial forces on the corona and D(q) the lattice's
    static stiffness, rotations eliminated: the definition that opens the paper's appendix. In polar
    coordinates around Gamma, where its limit depends on the direction, the integrand is smooth; its
    symmetry leaves a twelfth of the zone, 30 degrees from Gamma-M to Gamma-K.

    """
    from scipy.integrate import quad

    edge = 2.0 * math.pi / math.sqrt(3.0)
    error = 0.0  # |q| at M

    def along(angle: float) -> float:
        nonlocal error
        # Gamma-M, at angle 0, is perpendicular to a contact
        way = np.array([-math.sin(angle), math.cos(angle)])
        value, off, *_ = quad(
            lambda r: r * _compute_compliance(r * way, mindlin_ratio),
            0.0,
            edge / math.cos(angle),
            **options,
        )
        error = max(error, off)
        return float(value)

    options: dict[str, Any] = {"epsabs": 0.0, "epsrel": _ASKED_ERROR, "full_output": 1}
    third = math.pi / 6.0
    value, off, *_ = quad(along, 0.0, third, **options)
    scale = 12.0 * math.sqrt(3.0) / (8.0 * math.pi**2)  # twelve parts, over the area of the zone
    compliance = scale * value
    return 1.0 / compliance - 1.0, scale * (off + third * error) / compliance**2


def _compute_compliance(q: Array, eta: float) -> float:
    """Return F^T D^-1 F/6 at one wave vector (2,): the mean radial displacement of the corona under
    unit radial forces.
    """
    half = 0.5 * (q @ _NORMALS)
    sine = np.sin(half)
    cosine = np.cos(half)
    stiff = 4.0 * (_NORMALS * sine**2) @ _NORMALS.T
    if eta:
        # a slip is 2 sin(half) t.u - cos(half) phi, with phi such that no torque is left
        turned = _TANGENTS @ (sine * cosine)
        stiff += (
            4.0
            * eta
            * ((_TANGENTS * sine**2) @ _TANGENTS.T - np.outer(turned, turned) / np.sum(cosine**2))
        )
    force = 4.0 * _NORMALS @ (sine * cosine)
    (a, b), (_, c) = stiff
    x, y = force
    return float((c * x * x - 2.0 * b * x * y + a * y * y) / (a * c - b * b)) / 6.0


# -- the effective medium --------------------------------------------------------------------------

#: force at which the integration ends, over the least force that is asked for
_LAST_FORCE = 0.99
#: distance from the first contact at which the integration ends, over the length of the last
#: interval
_LAST_DISTANCE = 1e-9


def balance(balls: BallSums, k: Any, xi: float, rise: float = 1.0) -> tuple[Any, Any, Any]:
    """Return G(y, k), dG/dt where dy/dt = ``rise``, and dG/dk, like k; f = G(y, k) solves equation
    (36).
    """
    weights, force, stiffness, slope = balls
    held = stiffness + xi * np.asarray(k)[..., None]
    part = weights / held
    total = np.sum(part, axis=-1)
    f = np.sum(part * force, axis=-1) / total
    bent = part / held * (force - f[..., None])
    by_place = (rise * np.sum(part * stiffness, axis=-1) - np.sum(bent * slope, axis=-1)) / total
    return f, by_place, -xi * np.sum(bent, axis=-1) / total


def integrate_curve(
    shape: Shape,
    xi: float,
    force: ArrayLike,
    tolerance: float = 1e-13,
    method: Literal["LSODA", "Radau"] = "LSODA",
) -> tuple[Array, Array]:
    """Return y and k of the effective medium at reduced forces f*, by integrating k' = (k -
    dG/dy)/(dG/dk).

    The integration goes downwards from the high-pressure series and starts anew at each opening.
    Its variable is the square root of the distance to the opening below. From f* = 1e-4 to 100, for
    densities and for up to ten listed diameters, y agrees with
    :func:`~granphon.laws.effective.effective_curve` to 1e-13 and k to 4e-12 (1e-13 except near
    openings, where the integrator interpolates); at a tolerance of 1e-11, to 2e-12 and 6e-11.

    Parameters
    ----------
    shape, xi : of the medium.
    force : (n,) f*, above zero, in any order.
    tolerance : relative tolerance of a step.
    method : of :func:`scipy.integrate.solve_ivp`. Radau's is of fixed order: k to 4e-9 at 1e-8, to
        1e-10 at 1e-10.

    Raises
    ------
    PrecisionError : the stiffness falls to zero above the least force, the integrator fails, or
        loads are so high that the differences of diameters are lost in rounding.
    """
    from scipy.integrate import solve_ivp
    from scipy.optimize import brentq

    wanted = np.asarray(force, float)
    far = high_pressure_series(shape, xi)
    top = max(far.start, 1.1 * float(np.max(wanted)) ** (2.0 / 3.0))
    k, first, least = (
        far.value(top, STIFFNESS),
        float(shape.openings[0]),
        _LAST_FORCE * float(np.min(wanted)),
    )
    overlaps = np.empty(wanted.size)
    stiffnesses = np.empty(wanted.size)
    missing = np.ones(wanted.size, bool)
    for origin, end in reversed(list(pairwise([*shape.openings.tolist(), top]))):

        def state(root: float, k: float, origin: float = origin) -> tuple[float, float, float]:
            return balance(_sum_balls(shape, origin, root), k, xi, 2.0 * root)

        def slope(root: float, k: Array) -> list[float]:
            _, by_root, by_k = state(root, float(k[0]))
            if not by_k:
                raise PrecisionError(
                    "the differences of diameters are lost in rounding", mend="Lower the load"
                )
            return [(2.0 * root * float(k[0]) - by_root) / by_k]

        def excess(root: float, k: Array) -> float:
            return math.log(max(state(root, float(k[0]))[0], 1e-300) / least)

        def positive(root: float, k: Array) -> float:
            return float(k[0])

        for event in (excess, positive):
            event.terminal = True  # type: ignore[attr-defined]
        high = math.sqrt(end - origin)
        span = high, _LAST_DISTANCE * high if origin == first else 0.0
        with warnings.catch_warnings():  # warnings of failures, which the result reports too
            warnings.simplefilter("ignore", UserWarning)
            out: Any = solve_ivp(
                slope,
                span,
                [k],
                method,
                events=(excess, positive),
                dense_output=True,
                rtol=tolerance,
                atol=0.0,
            )
        forces = np.array([state(root, one)[0] for root, one in zip(out.t, out.y[0], strict=True)])
        for place in np.flatnonzero(missing & (wanted >= forces[-1])):
            # the last step whose end is below the force
            step = min(max(int(np.searchsorted(-forces, -wanted[place])), 1), len(forces) - 1)

            def miss(
                root: float, within: Any = out.sol, goal: float = float(wanted[place])
            ) -> float:
                return state(root, float(within(root)[0]))[0] - goal

            low = out.t[step]
            root = out.t[step - 1]
            if miss(root) > 0.0:  # else rounding has put the force between two intervals
                root = float(brentq(miss, low, root, xtol=1e-15, rtol=1e-15))
            overlaps[place], stiffnesses[place], missing[place] = (
                origin + root**2,
                out.sol(root)[0],
                False,
            )
        k = float(out.y[0, -1])
        if out.status:  # an event has ended the integration, or it failed
            break
    if np.any(missing):
        raise PrecisionError(
            f"the curve was not followed down to f* = {np.min(wanted):.3g}", out.message
        )
    return overlaps, stiffnesses


def _sum_balls(shape: Shape, origin: float, root: float) -> BallSums:
    """The balls at y = ``origin`` + ``root``^2, above the opening ``origin``, with the derivative
    of K^Q by the root.
    """
    if not isinstance(shape, PointShape):
        y = origin + root * root
        x, weights = shape.nodes(y)
        return (
            weights,
            shape.force(y, x),
            shape.stiffness(y, x),
            2.0 * root * shape.stiffness_slope(y, x),
        )
    # sums over pairs; the same pairs are closed in the whole interval, so that no digit is lost
    # near the opening
    x = np.array(shape.positions)
    weights = np.array(shape.weights)
    rest = origin + 0.5 * (x[:, None] + x)
    side = np.sqrt(np.where(rest >= 0.0, rest + root * root, 0.0))
    share = np.divide(root, side, out=np.where(rest == 0.0, 1.0, 0.0), where=side > 0.0)
    return weights, side**3 @ weights, 1.5 * side @ weights, 1.5 * share @ weights


# -- density of states -----------------------------------------------------------------------------

#: number of lines in a panel, the order of the Gauss rule
_GAUSS_LINES = 8
#: lines whose matrices are in memory together, in a lattice of one ball with three degrees of
#: freedom
_LINES_TOGETHER = 2**13
#: rounds in which panels are split
_SPLITTING_ROUNDS = 12
#: halvings of the interval that holds a kink
_KINK_HALVINGS = 40
#: panels that are not longer than this part of the reciprocal vector are not split
_SHORTEST_PANEL = 1e-9
#: largest imaginary part of a root that counts as real, and largest distance between two roots that
#: counts as zero
_REAL_ROOT = 1e-7


def count_modes(lattice: ContactLattice, edges: ArrayLike, points: int = 512) -> Array:
    """Count the modes per ball below each frequency, exactly in one direction of the wave vector.

    On a line of wave vectors along a reciprocal vector det(D(q) - omega^2) is a trigonometric
    polynomial. Between its roots no branch crosses omega, so that the lengths between them, times
    the number of eigenvalues below, are the number of modes on that line. As a function of the
    other component of q it is smooth except for kinks, square roots or steps, where the line
    touches a contour. They are found by bisection, and Gauss rules are graded towards the ends of
    the panels between them.

    Parameters
    ----------
    lattice : a lattice of few balls, prestressed or not, with 2 or 3 branches for each ball.
    edges : (n,) angular frequencies, (k/M)^1/2.
    points : number of lines for each frequency, before panels are split at kinks.

    Returns
    -------
    Modes per ball, (n,): 0 at and below zero, 2 or 3 above the top. Errors come from contours so
    small that they fall between lines. They are below 5/``points``^2 at single frequencies near the
    edge of a branch, in all that was tried, and 1e-7 or less elsewhere. The difference from twice
    the points is a fair estimate.

    """
    values = np.asarray(edges, float)
    lines = _Lines(lattice)
    squared = np.where(values > 0.0, values, 0.0) ** 2
    gauss, weights = np.polynomial.legendre.leggauss(_GAUSS_LINES)
    half = 0.5 * (gauss + 1.0)
    # the map s^2 (3 - 2s) makes square roots at either end smooth; q and -q are one
    places = half * half * (3.0 - 2.0 * half)
    weights = weights * 6.0 * half * (1.0 - half)
    ends = np.linspace(0.0, 0.5, -(-points // _GAUSS_LINES) + 1)
    above = np.flatnonzero(squared)
    panels = np.array(
        [(edge, low, high) for edge in above for low, high in pairwise(ends)]
    ).reshape(-1, 3)
    total = np.zeros(values.size)
    for left in reversed(range(_SPLITTING_ROUNDS)):
        found = []
        for part in (
            np.array_split(panels, -(-len(panels) * _GAUSS_LINES // lines.most))
            if len(panels)
            else []
        ):
            edge = part[:, 0].astype(int)
            low = part[:, 1:2]
            length = part[:, 2:] - part[:, 1:2]
            q = low + length * places
            counts, kinds = (
                x.reshape(q.shape)
                for x in lines.count(q.ravel(), np.repeat(squared[edge], _GAUSS_LINES))
            )
            split = (
                np.any(kinds != kinds[:, :1], axis=1)
                & (length[:, 0] > _SHORTEST_PANEL)
                & (left > 0)
            )
            total += np.bincount(
                edge, np.where(split, 0.0, (counts * length) @ weights), values.size
            )
            found += _split(lines, squared, part[split], q[split], kinds[split])
        panels = np.array(found).reshape(-1, 3)
    return total / lattice.n_balls


def _split(
    lines: _Lines, squared: Array, panels: Array, q: Array, kinds: NDArray[np.intp]
) -> list[tuple[float, float, float]]:
    """Cut the panels wherever the kind of line changes between neighbouring ``q`` (n_panels,
    order).
    """
    row, place = np.nonzero(np.diff(kinds, axis=1))
    low = q[row, place]
    high = q[row, place + 1]
    kind = kinds[row, place]
    for _ in range(_KINK_HALVINGS if row.size else 0):
        middle = 0.5 * (low + high)
        same = lines.count(middle, squared[panels[row, 0].astype(int)])[1] == kind
        low = np.where(same, middle, low)
        high = np.where(same, high, middle)
    kinks = 0.5 * (low + high)
    return [
        (edge, *pair)
        for i, (edge, first, last) in enumerate(panels.tolist())
        for pair in pairwise([first, *kinks[row == i].tolist(), last])
    ]


class _Lines:
    """Lines of wave vectors along the reciprocal vector in which the determinant has the lower
    degree.
    """

    def __init__(self, lattice: ContactLattice) -> None:
        reach = np.max(np.abs(lattice.contacts.shift), axis=0)
        self.lattice = lattice
        self.axis = int(np.argmin(reach))
        # number of lines whose roots are found together
        self.most = max(_GAUSS_LINES, _LINES_TOGETHER * 27 // lattice.n_branches**3)
        self.degree = max(1, int(reach[self.axis])) * lattice.n_branches
        # exp(i k theta) (1 + t^2)^m = (1 + it)^(m + k) (1 - it)^(m - k), t = tan(theta/2): its
        # powers of t for k = -m ... m
        up = np.polynomial.Polynomial([1.0, 1.0j])
        down = np.polynomial.Polynomial([1.0, -1.0j])
        m = self.degree
        self.powers = np.array([(up ** (m + k) * down ** (m - k)).coef for k in range(-m, m + 1)])

    def compute_matrices(self, along: Array, across: Array) -> NDArray[np.complex128]:
        """Return D, (..., n_branches, n_branches), at these fractions of the reciprocal vectors,
        which broadcast.
        """
        fractions = np.stack(
            np.broadcast_arrays(*((along, across) if self.axis == 0 else (across, along))), axis=-1
        )
        matrices = self.lattice.dynamical_matrix(self.lattice.wavevectors(fractions.reshape(-1, 2)))
        return matrices.reshape(*fractions.shape[:-1], *matrices.shape[1:])

    def count(self, across: Array, squared: Array) -> tuple[Array, NDArray[np.intp]]:
        """Return the modes below omega^2 (n,) on each line (n,), and a number for its kind, which
        changes at a kink.
        """
        m = self.degree
        n = len(across)
        ticks = np.arange(2 * m + 1) / (2 * m + 1)
        unit = np.eye(self.lattice.n_branches)
        shifted = (
            self.compute_matrices(ticks, across[:, None]) - squared[:, None, None, None] * unit
        )
        samples = np.linalg.det(shifted).real
        # t is infinite where the determinant is largest, so that the leading coefficient is not
        # small
        turn = ticks[np.argmax(np.abs(samples), axis=1)] + 0.5
        k = np.arange(-m, m + 1)
        series = np.fft.fftshift(np.fft.fft(samples, axis=1), axes=1) * np.exp(
            2j * np.pi * k * turn[:, None]
        )
        polynomial = (series @ self.powers).real
        leading = np.where(polynomial[:, -1:] == 0.0, 1.0, polynomial[:, -1:])
        companion = np.zeros((n, 2 * m, 2 * m))
        companion[:, 1:, :-1] = np.eye(2 * m - 1)
        companion[:, :, -1] = -polynomial[:, :-1] / leading
        roots = np.linalg.eigvals(companion)
        # cut at the real parts of complex roots too: an additional cut does no harm
        inner = np.sort(np.arctan(roots.real) / np.pi, axis=1)
        cuts = np.concatenate([np.full((n, 1), -0.5), inner, np.full((n, 1), 0.5)], axis=1)
        length = np.diff(cuts, axis=1)
        line, place = np.nonzero(length > 0.0)
        length = length[line, place]
        middle = cuts[line, place] + 0.5 * length + turn[line]
        below = np.sum(
            np.linalg.eigvalsh(self.compute_matrices(middle, across[line])) < squared[line, None],
            axis=1,
        )
        crossings = np.sum(np.abs(roots.imag) < _REAL_ROOT * (1.0 + np.abs(roots) ** 2), axis=1)
        fewest = np.full(n, self.lattice.n_branches)
        most = np.zeros(n, int)
        seen = length > _REAL_ROOT
        np.minimum.at(fewest, line[seen], below[seen])
        np.maximum.at(most, line[seen], below[seen])
        size = self.lattice.n_branches + 1
        kind: NDArray[np.intp] = (crossings * size + fewest) * size + most
        return np.asarray(np.bincount(line, below * length, n), float), kind
