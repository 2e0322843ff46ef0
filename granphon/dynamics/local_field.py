"""The local-field factor of the effective medium: how stiffly a lattice carries one of its balls.

Put a unit tension on every contact of one ball, its *star*. The contacts of an unloaded lattice can take up only such
deformations as its balls can make by moving, the range of K^1/2 C, so the star responds by its projection on that range,

    e = P t,    P = C D^-1 C^T K,    D^-1 the lattice's Green's function.

Three elongations give all results: u_1 of the star itself, and those of the contacts between the corona and the second
neighbours on top of it and at its bridges. The tension of the star is balanced on the central ball. It is the load with
which the paper's appendix begins: unit radial forces on the corona, in the whole lattice with the contacts of the central
ball. That ball does not move, and u_1 is the radial displacement of the corona. Reduced units: length d, stiffness k.
"""

from __future__ import annotations

import itertools
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from functools import lru_cache
from typing import Any

import numpy as np
from numpy.typing import NDArray

from granphon.balls.contact_table import steps_within
from granphon.balls.lattices import TRIANGULAR, Lattice, find_lattice
from granphon.base.arguments import not_negative, whole_number
from granphon.base.errors import InputError, PrecisionError, message
from granphon.base.results import Result
from granphon.dynamics.modes import ContactLattice

__all__ = ["LocalField", "local_field", "local_field_on", "paper_local_field"]

Array = NDArray[np.float64]
#: numbers of points along each side of the quadrature's triangles, tried in turn until two successive results agree
_ORDERS = (12, 16, 24, 36, 54, 81)
#: required relative agreement of these results; errors fall geometrically, so the error of the finer one is far smaller
_AGREEMENT = 1e-9
#: least value of 1 - u_1 that doubles hold to that relative accuracy
_LEAST_HELD = 1e-6
#: number of wave vectors of a uniform grid that are worked on at a time
_PART = 2**14
#: height of an equilateral triangle of side one
_TRIANGLE_HEIGHT = float(np.sqrt(3.0) / 2.0)


@dataclass(frozen=True, eq=False, repr=False)
class LocalField(Result):
    """Local-field factor, and the displacements that define it; pure numbers.

    Attributes
    ----------
    alpha, beta : radial displacements of the on-top and the bridge second neighbours over that of the corona (equations 32
        and 43); None on lattices other than the triangular one.
    xi : Xi of equations (34) and (44), the stiffness with which the rest of the lattice holds the corona, in units of k.
    mindlin_ratio : eta, tangential over normal stiffness.
    lattice : name of the lattice.
    bending : stiffness of a contact against rolling, over k d^2.
    """

    added = ("bending",)

    alpha: float | None
    beta: float | None
    xi: float
    mindlin_ratio: float
    lattice: str
    bending: float = 0.0

    @property
    def compliance(self) -> float:
        """Compliance u_1 = 1/(1 + Xi), 1/k: the radial displacement of the corona under unit radial forces."""
        return 1.0 / (1.0 + self.xi)


def compute_xi(alpha: float, beta: float, mindlin_ratio: float) -> float:
    """Return Xi from the equilibrium of a corona ball (equations 35 and 45) on the triangular lattice."""
    bridge = _TRIANGLE_HEIGHT * beta
    return 2.5 - alpha - bridge + mindlin_ratio * (1.5 - bridge)


def paper_local_field(mindlin_ratio: float) -> LocalField:
    """Return the printed alpha and beta (A14), used at every eta as in the paper, with Xi from equation 45.

    They do not satisfy their own definition (see the errata); they are kept to reproduce the paper's curves.
    """
    eta = not_negative("mindlin_ratio", mindlin_ratio)
    alpha, beta = 0.585405, 0.232971
    return LocalField(alpha, beta, compute_xi(alpha, beta, eta), eta, TRIANGULAR.name)


def local_field(lattice: str | Lattice = TRIANGULAR, mindlin_ratio: float = 0.0, bending: float = 0.0) -> LocalField:
    """Find the local field of a lattice of equal balls, with rotations relaxed, to 1e-10 or better.

    At eta = 0 the triangular lattice has closed forms: Xi = (2 pi + 3 sqrt(3)) / D, alpha = (12 pi - 39 sqrt(3)/2) / D,
    beta = (18 - 8 pi/sqrt(3)) / D, D = 4 pi - 3 sqrt(3). At eta = 1, u_1 = 5/6 - sqrt(3)/pi (to 13 digits).

    Parameters
    ----------
    lattice : any lattice of equal balls. Where contacts or balls are not equivalent, u_1 is the mean over them.
    mindlin_ratio : eta, zero or above; at zero the tension of the star turns no ball.
    bending : stiffness of a contact against rolling over k d^2, which hinders the balls from turning. Torsion, and motions
        out of the plane, take no part.

    Returns
    -------
    Alpha and beta by equations (32) and (43) on the triangular lattice, in any of its cells; Xi = 1/u_1 - 1 on all lattices.

    Raises
    ------
    InputError : eta or the bending is below zero or not finite, or the lattice is unknown.
    MechanismError : the lattice has a motion that costs no energy.
    PrecisionError : friction is so weak, on a lattice that needs it, that the integral over q does not settle.
    """
    eta, roll = not_negative("mindlin_ratio", mindlin_ratio), not_negative("bending", bending)
    # without slip nothing turns the balls, so that they do not roll
    return _compute_local_field(find_lattice(lattice), eta, roll if eta else 0.0)


@lru_cache(maxsize=256)
def _compute_local_field(structure: Lattice, eta: float, bending: float) -> LocalField:
    if structure.periods != 2:
        what = f"the local field of the {structure.name} lattice is not known"
        raise InputError(message(what, "That of lattices in the plane is", "Use 'ala' or 'afa', or equal balls"))
    medium = ContactLattice.of(structure, eta, bending=bending)
    medium.require_rigid()
    star, *second = _find_elongations(medium, structure.name)
    xi = 1.0 / star - 1.0
    if not second:
        return LocalField(None, None, xi, eta, structure.name, bending)
    # the elongations are u_alpha - u_1 on top, and (sqrt(3) u_beta - u_1)/2 at a bridge
    on_top, bridge = second
    beta = (1.0 + 2.0 * bridge / star) / np.sqrt(3.0)
    return LocalField(1.0 + on_top / star, beta, xi, eta, structure.name, bending)


def local_field_on(points: int, mindlin_ratio: float, graded: bool) -> float:
    """Return Xi of the triangular lattice from one fixed quadrature over the Brillouin zone, without control of its error.

    Parameters
    ----------
    points : number of quadrature points along each side of its triangles, or of the zone.
    mindlin_ratio : eta, zero or above.
    graded : True for triangles graded towards the points q = -q, where the integrand depends on direction (that of
        :func:`local_field`, whose errors fall geometrically); False for the uniform grid of equal weights, half a step off
        Gamma, whose errors fall as ``points``^-4 (at eta = 1 as ``points``^-6).

    Raises
    ------
    InputError : ``points`` is below two, or eta is below zero or not finite.
    """
    points = whole_number("points", points, 2)
    medium = ContactLattice.of(TRIANGULAR, not_negative("mindlin_ratio", mindlin_ratio))
    return float(1.0 / _find_response(medium, points, _divide_zone if graded else _grid_zone)[0] - 1.0)


# -- the response of the lattice ------------------------------------------------------------------------------------


def _find_elongations(medium: ContactLattice, name: str) -> list[float]:
    """Find the mean elongations under a unit tension of one ball's star: of the star, then on top and at the bridges.

    Means are over the contacts of each kind and over the balls of the cell. Raises :class:`PrecisionError`.
    """
    before: Array = np.zeros(0)
    for order in _ORDERS:
        values = _find_response(medium, order)
        # u_1 is small at strong friction and near one at weak friction. Both u_1 and Xi = 1/u_1 - 1 must be accurate, so 1 -
        # u_1 must be well above rounding
        held = 1.0 - values[0]
        if before.size and held > _LEAST_HELD and np.max(np.abs(values - before)) <= _AGREEMENT * values[0] * held:
            return [float(value) for value in values]
        before = values
    raise PrecisionError(
        message(
            f"the local field of lattice {name!r} at mindlin_ratio {medium.mindlin_ratio:g} does not converge",
            "With so little shear stiffness some of its motions cost almost no energy",
            "Raise mindlin_ratio",
        )
    )


#: type of a quadrature over the zone: it takes reciprocal vectors and a number of points, and yields wave vectors and
#: weights
_Quadrature = Callable[[Array, int], Iterator[tuple[Array, Array]]]


def _find_response(medium: ContactLattice, order: int, quadrature: _Quadrature | None = None) -> Array:
    """Find the mean elongation of each kind of contact under a unit tension of the first: the zone mean of s^H P t."""
    total: Any = 0.0
    places = _place_contacts(medium)
    for wavevectors, weights in (quadrature or _divide_zone)(medium.reciprocal, order):
        # P = Q Q^H. The QR factor Q of K^1/2 C does not depend on the scale of the columns, which is small near Gamma or at
        # weak friction
        adjoint = np.linalg.qr(medium.compatibility(wavevectors))[0][:, : len(medium.contacts)].conj().swapaxes(1, 2)
        for kinds in places:
            moved = [(adjoint @ _transform_tension(medium, where, wavevectors)[..., None])[..., 0] for where in kinds]
            total = total + np.array([np.einsum("q,qb,qb->", weights, m.conj(), moved[0]).real for m in moved])
    return np.asarray(total / [sum(len(kinds[k]) for kinds in places) for k in range(len(places[0]))])


def _place_contacts(medium: ContactLattice) -> list[list[Array]]:
    """Find, for each ball of the cell, midpoints (n, 2) of the contacts of its star, on top and at the bridges.

    A lattice with six contacts at every ball is triangular, in whatever cell; for other lattices only the star is returned.
    """
    table = medium.contacts
    triangular = len(table) == 3 * medium.n_balls
    places = []
    for ball, centre in enumerate(medium.positions):
        spokes = np.concatenate([table.vector[table.i == ball], -table.vector[table.j == ball]])
        kinds = [0.5 * spokes]
        if triangular:
            across = np.stack([-spokes[:, 1], spokes[:, 0]], axis=1)
            sides = [0.5 * spokes + sign * _TRIANGLE_HEIGHT * across for sign in (1.0, -1.0)]
            kinds += [1.5 * spokes, np.concatenate([spokes + 0.5 * side for side in sides])]
        places.append([centre + kind for kind in kinds])
    return places


def _transform_tension(medium: ContactLattice, where: Array, wavevectors: Array) -> NDArray[np.complex128]:
    """Return the Fourier transform (n_q, n_c) of a unit tension on the contacts whose midpoints are ``where`` (n, 2)."""
    table = medium.contacts
    offset = (where[:, None] - (medium.positions[table.i] + 0.5 * table.vector)) @ np.linalg.inv(medium.cell)
    which = np.max(np.abs(offset - np.rint(offset)), axis=-1) < 1e-3
    return np.asarray(np.exp(-1j * (wavevectors @ where.T)) @ which)


def _divide_zone(reciprocal: Array, order: int) -> Iterator[tuple[Array, Array]]:
    """Yield wave vectors (n_q, 2) and weights (n_q,), in parts, for the mean of an even function over the Brillouin zone.

    The integrand is bounded but depends on direction at Gamma, and, where balls can roll like gears, at the other points
    q = -q. The zone is cut into triangles that have these four points as corners, and each triangle is the image of a
    square (q = corner + s (side + t across), Duffy's map), in which the integrand is smooth. Half of the triangles suffice,
    because q and -q are equivalent.
    """
    # find the shortest reciprocal vectors, whatever the cell; the given ones come first and win among equals
    longest = float(np.linalg.norm(reciprocal, axis=1).max())
    found = np.concatenate([reciprocal, steps_within(reciprocal, longest) @ reciprocal])
    lengths = np.round(np.linalg.norm(found, axis=1) / longest, 9)
    _, near, *rest = found[np.argsort(lengths, kind="stable")]
    far = next(v for v in rest if abs(near[0] * v[1] - near[1] * v[0]) > 1e-6 * (near @ near))
    points, gauss = np.polynomial.legendre.leggauss(order)
    s, t = np.meshgrid(0.5 + 0.5 * points, 0.5 + 0.5 * points, indexing="ij")
    weights = np.outer(gauss * (0.5 + 0.5 * points), gauss).ravel() / 32.0
    triangle = np.stack([s, s * t], axis=-1).reshape(-1, 2)
    for corner in np.ndindex(2, 2):
        for axes, sign in itertools.product(([0, 1], [1, 0]), (1.0, -1.0)):
            fractions = 0.5 * np.array(corner) + 0.25 * triangle[:, axes] * [1.0, sign]
            yield fractions @ np.stack([near, far]), weights


def _grid_zone(reciprocal: Array, points: int) -> Iterator[tuple[Array, Array]]:
    """Yield what :func:`_divide_zone` yields, on a grid of ``points``^2 points of equal weight, half a step off Gamma."""
    ticks = (np.arange(points) + 0.5) / points
    half = ticks[ticks <= 0.5]  # q and -q are equivalent
    grid = np.stack(np.meshgrid(half, ticks, indexing="ij"), axis=-1).reshape(-1, 2)
    for part in np.array_split(grid, -(-len(grid) // _PART)):
        yield part @ reciprocal, np.where(part[:, 0] < 0.5, 2.0, 1.0) / points**2
