"""The local-field factor of the effective medium: how stiffly a lattice holds the neighbours of a
ball.

The contacts of a ball are its *star*, and its neighbours the *corona*. Let a tension of one act in
every contact of the star, in a lattice without load. The deformations that contacts can have are
those that motions of balls make: the range of K^1/2 C. Therefore the response of the contacts to
the tensions t is the projection on that range,

    e = P t,    P = C D^-1 C^T K,    D^-1 the lattice's Green's function.

The mean elongation of the z contacts of the star, u_1 = t^T P t / z, gives Xi = 1/u_1 - 1 in any
lattice. In an array without friction the overlaps of contacts deviate from their mean, to first
order, by 1 - P times the deviations that they would have with balls held at their sites. So 1 - u_1
= Xi/(1 + Xi) is the part of the variance of overlaps that is left once the balls have moved, and
with it the second order of the force.

On the triangular lattice two more elongations give all results: those of the contacts between the
corona and the second neighbours on top of it and at its bridges. The tension of the star is
balanced on the central ball. This is the load with which the appendix of Velicky and Caroli (2002)
begins: unit radial forces on the corona, in the whole lattice with the contacts of the central
ball. That ball does not move, and u_1 is the radial displacement of the corona. Numbers are in
reduced units: length d, stiffness k. Equations of the kind (32) are those of that paper.
"""

from __future__ import annotations

from functools import lru_cache, partial
from typing import Any

import numpy as np
from numpy.typing import NDArray

from granphon.balls.lattices import TRIANGULAR, Lattice, find_lattice
from granphon.base.arrays import Array
from granphon.base.errors import MechanismError, PrecisionError
from granphon.base.results import Result, held, result_class
from granphon.base.validation import not_negative
from granphon.dynamics.contact_lattice import ContactLattice
from granphon.dynamics.zone_means import Operation, divide_zone, find_symmetries

#: numbers of points along each edge of the quadrature's triangles (two periods) and tetrahedra
#: (three), tried in turn until two successive results agree; with one period Xi is zero
_ORDERS = {2: (12, 16, 24, 36, 54, 81), 3: (6, 8, 11, 15, 20, 28)}
#: relative difference, by the number of periods, up to which two successive results agree; errors
#: fall geometrically, so that the error of the finer result is far smaller
_AGREEMENT = {2: 1e-9, 3: 1e-8}
#: least value of 1 - u_1 that double precision holds to the accuracy of :data:`_AGREEMENT`
_LEAST_DIFFERENCE = 1e-6
#: number of entries of C(q) that are computed at a time, few enough for the cache
_ENTRIES = 2**16
#: distance, in steps of the cell and in diameters across the periods, up to which two midpoints of
#: contacts are one point
_MIDPOINT_TOLERANCE = 1e-3
#: height of an equilateral triangle of side one
_TRIANGLE_HEIGHT = float(np.sqrt(3.0) / 2.0)


@result_class
class LocalField(Result):
    """Local-field factor, and the displacements that define it; pure numbers.

    Attributes
    ----------
    alpha, beta : radial displacements of the second neighbours of a ball that are on top of its
        neighbours and at their bridges, over the radial displacement of the neighbours, the corona
        (equations 32 and 43); None on lattices other than the triangular one.
    xi : Xi of equations (34) and (44), the stiffness with which the rest of the lattice holds the
        corona, in units of k.
    mindlin_ratio : eta, tangential over normal stiffness.
    lattice : name of the lattice.
    bending : stiffness of a contact against rolling, over k d^2.
    torsion : stiffness of a contact against twist, over k d^2.
    """

    alpha: float | None = held(float, "?", within="finite")
    beta: float | None = held(float, "?", within="finite")
    xi: float = held(float, within="finite")
    mindlin_ratio: float = held(float, within="zero or above")
    lattice: str = held(str)
    bending: float = held(float, within="zero or above", default=0.0)
    torsion: float = held(float, within="zero or above", default=0.0)

    @property
    def compliance(self) -> float:
        """Compliance u_1 = 1/(1 + Xi), 1/k: the mean elongation of the contacts of a ball under a
        tension of one in each; on the triangular lattice the radial displacement of the corona
        under unit radial forces.
        """
        return 1.0 / (1.0 + self.xi)

    @property
    def is_determinate(self) -> bool:
        """Whether Xi is zero. Then the load alone determines the force of every contact, whatever
        the diameters of the balls.
        """
        return self.xi == 0.0


def compute_xi(alpha: float, beta: float, mindlin_ratio: float) -> float:
    """Return Xi from the equilibrium of a corona ball (equations 35 and 45) on the triangular
    lattice, with ``alpha`` and ``beta`` of :class:`LocalField`, at the ``mindlin_ratio`` eta.
    """
    bridge = _TRIANGLE_HEIGHT * beta
    return 2.5 - alpha - bridge + mindlin_ratio * (1.5 - bridge)


def paper_local_field(mindlin_ratio: float) -> LocalField:
    """Return the local field with the alpha and beta that Velicky and Caroli (2002) print (A14) and
    use at every ``mindlin_ratio`` eta; Xi follows from their equation (45).

    The two numbers do not satisfy their own definition (see the errata). They serve to reproduce
    the curves of that paper. Raises :class:`~granphon.base.errors.InputError` if eta is below zero
    or not finite.
    """
    eta = not_negative("mindlin_ratio", mindlin_ratio)
    alpha = 0.585405
    beta = 0.232971
    return LocalField(alpha, beta, compute_xi(alpha, beta, eta), eta, TRIANGULAR.name)


def local_field(
    lattice: str | Lattice = TRIANGULAR,
    mindlin_ratio: float = 0.0,
    bending: float = 0.0,
    torsion: float = 0.0,
) -> LocalField:
    """Return the local field of a lattice of equal balls, with all motions relaxed, to a relative
    accuracy of 1e-8 (1e-10 in the plane).

    Xi is the stiffness, in units of k, with which the rest of the lattice holds the neighbours of a
    ball. If the tension T acts in all contacts of a ball, in the lattice without load, these
    contacts lengthen by u_1 T/k in the mean, and Xi = 1/u_1 - 1.

    At eta = 0 the triangular lattice has closed forms: Xi = (2 pi + 3 sqrt(3)) / D, alpha = (12 pi
    - 39 sqrt(3)/2) / D, beta = (18 - 8 pi/sqrt(3)) / D, D = 4 pi - 3 sqrt(3). At eta = 1, u_1 = 5/6
    - sqrt(3)/pi; this form was not derived, but guessed from the number, with which it agrees to 13
    digits. On a chain Xi is exactly zero: all its contacts carry the same force. All motions that
    lengthen or shorten contacts take part, and those that contacts join to them: u_x on a line,
    u_x, u_y and phi_z in a plane, all six in space.

    Parameters
    ----------
    lattice : any lattice of equal balls, or its name. If contacts or balls are not equivalent, u_1
        is the mean over all contacts.
    mindlin_ratio : eta, zero or above.
    bending, torsion : stiffness of a contact against rolling and against twist, over k d^2. Without
        friction they change nothing, as the tensions of the contacts turn no ball. The torsion of a
        Hertz contact that does not slip is of the order delta/d, which the medium leaves out: take
        0 for it.

    Returns
    -------
    field : Xi, and on the triangular lattice, in any of its cells, alpha and beta of equations (32)
        and (43).

    Raises
    ------
    InputError : a stiffness is below zero or not finite, or the lattice is unknown.
    MechanismError : the lattice has a motion that costs no energy, or so little beside others that
        double precision does not tell, so that nothing holds the neighbours of a ball: sc, bcc,
        square, honeycomb, kagome and diamond without friction, honeycomb and diamond also with
        friction alone.
    PrecisionError : friction, torsion or bending is so weak, on a lattice that needs it, or so
        strong, that the integral over q does not settle.
    """
    return _compute_local_field(
        find_lattice(lattice),
        not_negative("mindlin_ratio", mindlin_ratio),
        not_negative("bending", bending),
        not_negative("torsion", torsion),
    )


@lru_cache(maxsize=256)
def _compute_local_field(
    structure: Lattice, eta: float, bending: float, torsion: float
) -> LocalField:
    """Return the local field of the lattice ``structure`` at the Mindlin ratio ``eta``, from
    arguments of :func:`local_field` that have been checked; the errors are as there.
    """
    medium = ContactLattice.of(structure, eta, torsion=torsion, bending=bending)
    try:
        medium.require_rigid()
    except MechanismError as error:
        raise MechanismError(
            f"Xi of lattice {medium.name!r} does not exist: Xi is the stiffness with which the"
            " lattice holds the neighbours of a ball, and some motions of the lattice cost nothing;"
            f" {error}"
        ) from None
    make_field = partial(
        LocalField,
        mindlin_ratio=eta,
        lattice=structure.name,
        bending=bending,
        torsion=torsion,
    )
    # if motions of balls can make any deformation of contacts, P is the unit matrix, and Xi is zero
    takes_any_deformation = all(block.rank == block.n_rows for block in medium.elongating_blocks)
    if takes_any_deformation:
        return make_field(alpha=None, beta=None, xi=0.0)
    elongations = _integrate_response(medium)
    if elongations is None:
        raise PrecisionError(
            f"the local field of lattice {medium.name!r} at mindlin_ratio {eta:g},"
            f" torsion {torsion:g}, bending {bending:g} does not converge",
            "Stiffnesses are so unequal that some of its motions cost almost no energy beside"
            " others",
            "Use stiffnesses nearer to that of compression",
        )
    star, *second_neighbours = elongations.tolist()
    xi = 1.0 / star - 1.0
    if not second_neighbours:
        return make_field(alpha=None, beta=None, xi=xi)
    # the elongations are u_alpha - u_1 on top, and (sqrt(3) u_beta - u_1)/2 at a bridge
    on_top, bridge = second_neighbours
    alpha = 1.0 + on_top / star
    beta = float((1.0 + 2.0 * bridge / star) / np.sqrt(3.0))
    return make_field(alpha=alpha, beta=beta, xi=xi)


def _integrate_response(medium: ContactLattice) -> Array | None:
    """Return the mean elongations (kinds,) of the kinds of contacts of :class:`_Response` on a
    lattice, ``medium``, under a unit tension of one ball's star; None if the integral over the zone
    does not settle, or leaves 1 - u_1 too small for double precision.
    """
    response = _Response(medium)
    operations = _find_operations(medium)
    last_elongations = np.full(1, np.inf)  # those of the order before
    for order in _ORDERS[medium.periods]:
        zone = divide_zone(medium.reciprocal, order, operations)
        elongations = np.asarray(sum(weights @ response(q) for q, weights in zone))
        # u_1 is small at strong friction and near one at weak friction. Both u_1 and Xi = 1/u_1 - 1
        # must be accurate, so 1 - u_1 must be well above rounding
        compliance = elongations[0]
        tolerance = _AGREEMENT[medium.periods] * compliance * (1.0 - compliance)
        has_settled = np.max(np.abs(elongations - last_elongations)) <= tolerance
        if has_settled and 1.0 - compliance > _LEAST_DIFFERENCE:
            return elongations
        last_elongations = elongations
    return None


# -- the response of the lattice -------------------------------------------------------------------


@lru_cache(maxsize=16)
def _find_operations(medium: ContactLattice) -> list[Operation]:
    """Return the operations on q that leave the response of a lattice, ``medium``, unchanged."""
    return find_symmetries(_Response(medium), medium.reciprocal)


class _Response:
    """The response of a lattice to unit tensions t in the contacts of one ball, its star: the mean
    elongation of the contacts of each kind, as a function of q to be averaged over the zone.

    The kinds are the star of the ball, and on the triangular lattice then the contacts between its
    neighbours and the second neighbours on top of these, and those at their bridges.
    """

    def __init__(self, medium: ContactLattice) -> None:
        """List the contacts of each kind, and the motions that lengthen or shorten contacts."""
        blocks = medium.elongating_blocks
        self.medium = medium
        self._kinds = _list_kinds(medium)
        self._counts = [sum(len(points) for points, _ in kind) for kind in self._kinds]
        self._columns = np.concatenate([block.columns for block in blocks])
        self._rank = sum(block.rank for block in blocks)
        entries = len(medium.rows) * len(medium.contacts) * len(self._columns)
        #: number of wave vectors for which C(q) is computed at a time
        self._chunk = max(1, _ENTRIES // entries)

    def __call__(self, q: Array) -> Array:
        """Return the response (n_q, kinds) at wave vectors q (n_q, p), 1/d."""
        starts = range(0, len(q), self._chunk)
        return np.concatenate([self._respond(q[start : start + self._chunk]) for start in starts])

    def _respond(self, q: Array) -> Array:
        """Return the response (n_q, kinds) at so few wave vectors q (n_q, p), 1/d, that C fits into
        the cache.
        """
        # with an orthonormal basis Q of the range, P = Q Q^H. Tensions act on elongations alone,
        # which come first among the rows
        basis = self._find_basis(q)
        adjoint = basis[:, : len(self.medium.contacts)].conj().swapaxes(1, 2)
        projections = []
        for kind in self._kinds:
            # the Fourier transforms (n_q, n_c, n_balls) of the tensions
            transforms = [np.exp(-1j * (q @ points.T)) @ contacts for points, contacts in kind]
            projections.append(adjoint @ np.stack(transforms, axis=2))
        star_projection = projections[0]
        # t^H P t of the star with each kind: sums over the rank r and the balls b
        sums = [
            np.einsum("qrb,qrb->q", projection.conj(), star_projection).real
            for projection in projections
        ]
        return np.stack(sums, axis=1) / self._counts

    def _find_basis(self, q: Array) -> NDArray[Any]:
        """Return an orthonormal basis (n_q, rows, rank) of the deformations that motions make at
        wave vectors q (n_q, p).
        """
        rows = self.medium.compatibility(q)[..., self._columns]
        if self._rank == rows.shape[2]:
            # Q of the QR decomposition does not depend on the lengths of the columns, which are
            # small near Gamma
            return np.linalg.qr(rows)[0]
        lengths = np.linalg.norm(rows, axis=1, keepdims=True)
        scaled_rows = rows / np.where(lengths > 0.0, lengths, 1.0)
        return np.linalg.svd(scaled_rows, full_matrices=False)[0][..., : self._rank]


def _list_kinds(medium: ContactLattice) -> list[list[tuple[Array, Array]]]:
    """Return, for each kind of contacts of :class:`_Response` on a lattice, ``medium``, and each
    ball of its cell, the contacts of that kind about the ball: their midpoints (m, p) along the
    periods, d, and a table (m, n_c) that is 1 where a midpoint is that of a contact of the lattice,
    up to periods, and else 0.

    Only the triangular lattice has more kinds than the star. This lattice is recognised, in any
    cell, as the lattice in the plane with three contacts per ball: on no other do equal balls touch
    six others each.
    """
    table = medium.contacts
    p = medium.periods
    is_triangular = medium.dimension == 2 and len(table) == 3 * medium.n_balls
    contact_midpoints = medium.positions[table.i] + 0.5 * table.vector
    inverse = np.linalg.inv(medium.cell[:, :p])
    n_kinds = 3 if is_triangular else 1
    kinds: list[list[tuple[Array, Array]]] = [[] for _ in range(n_kinds)]
    for ball, centre in enumerate(medium.positions):
        # vectors to the neighbours of the ball
        spokes = np.concatenate([table.vector[table.i == ball], -table.vector[table.j == ball]])
        offsets = [0.5 * spokes]
        if is_triangular:
            offsets += [1.5 * spokes, _list_bridges(spokes)]
        for kind, offset in zip(kinds, offsets, strict=True):
            midpoints = centre + offset
            separation = midpoints[:, None] - contact_midpoints
            steps = separation[..., :p] @ inverse
            # midpoints are compared up to whole steps of the cell
            remainder = np.concatenate([steps - np.rint(steps), separation[..., p:]], axis=-1)
            is_contact = np.max(np.abs(remainder), axis=-1) < _MIDPOINT_TOLERANCE
            kind.append((midpoints[:, :p], is_contact.astype(float)))
    return kinds


def _list_bridges(spokes: Array) -> Array:
    """Return the midpoints (2 n, 2), d, from the centre of a ball on the triangular lattice, of the
    contacts between its neighbours and the second neighbours at their bridges.

    ``spokes`` (n, 2), d, are the vectors from the ball to its neighbours.
    """
    # from a neighbour the second neighbours at its two bridges lie at 60 degrees from the spoke
    turned_spokes = np.stack([-spokes[:, 1], spokes[:, 0]], axis=1)
    sides = [0.5 * spokes + sign * _TRIANGLE_HEIGHT * turned_spokes for sign in (1.0, -1.0)]
    return np.concatenate([spokes + 0.5 * side for side in sides])
