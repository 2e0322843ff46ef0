"""The deformations of contacts, as coefficients of the motions of the two balls that touch.

A contact of normal n, at distances ``arm_i`` and ``arm_j`` from the centres of balls i and j,
deforms by

    elongation  (u_j - u_i).n
    slip        (1 - nn)(u_j - u_i) - (arm_i phi_i + arm_j phi_j) x n
    twist       (phi_j - phi_i).n
    roll        (1 - nn)(phi_j - phi_i)

Slip and roll have two components, along the tangents of
:func:`~granphon.balls.neighbours.contact_frames`. Each deformation is ``head . x_j - tail . x_i``,
where x_i and x_j are the motions of the two balls: one *row*. Everything linear in the dynamics of
contacts is made of these rows: C(q), force constants, strains, the stencils of an array.

In a wave the two balls of a contact move with phases that differ by q.(r_j - r_i). With phases
taken about the middle of the contact, a row of C(q) is a sum of the cosine and the sine of half
that angle: :class:`WaveRows`.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from granphon.balls.motions import Motions
from granphon.balls.neighbours import contact_frames
from granphon.base.arrays import Array
from granphon.base.errors import InputError
from granphon.networks.network import ContactNetwork

#: half angle below which sin h - h cos h is summed as a series
_LARGEST_OF_SERIES = 1.0
#: coefficients of (sin h - h cos h)/h^3 in powers of h^2; the next one is below rounding
_BEND = [(-1.0) ** k * (2 * k + 2) / math.factorial(2 * k + 3) for k in range(9)]
#: three components of vectors, along x, y and z, each (n_c,)
_Axes = list[Array]
#: kinds of the rows of springs to the ground, against displacements and against rotations
ANCHOR = "anchor"
ANCHORED_TURN = "anchored turn"
#: kind of the rows on which the growth of static tangential forces acts
GROWTH = "growth"
#: kind of the rows of slip by levers that exceed the arms
EXCESS = "excess"


class Row(NamedTuple):
    """One kind of deformation of all contacts: ``head . x_j - tail . x_i``, where x_i and x_j are
    the motions of the two balls.

    Attributes
    ----------
    kind : "elongation", "slip", "twist", "roll"; "push", a displacement across the contact; "turn",
        a sum of rotations; "carry" and "growth", what a static tangential force and its growth act
        on; "excess", a part of the slip by levers that exceed the arms; or "anchor" and "anchored
        turn", a displacement and a rotation of ball i against a spring to the ground.
    stiffness : stiffness against the deformation, a number or (n_c,), in the unit of the function
        that makes the row: over that of elongation in a lattice (eta for slip, in units of d^2 for
        twist and roll), in SI in :func:`network_rows`. Of rows on which static forces act it is 1,
        or the sign of their squares.
    head, tail : (n_c, motions) coefficients of the motions of ball j and of ball i.
    """

    kind: str
    stiffness: Any
    head: Array
    tail: Array


def contact_rows(
    normal: Array,
    arm_i: Array,
    arm_j: Array,
    motions: Motions,
    *,
    elongation: ArrayLike = 1.0,
    slip: ArrayLike = 0.0,
    twist: ArrayLike = 0.0,
    roll: ArrayLike = 0.0,
    gyration_i: ArrayLike = 1.0,
    gyration_j: ArrayLike = 1.0,
) -> list[Row]:
    """Return the rows of the deformations that contacts resist and that the motions can make:
    elongation, slip, twist, roll, in this order.

    Parameters
    ----------
    normal : (n_c, d) unit vectors from ball i to ball j, d = 1, 2 or 3.
    arm_i, arm_j : (n_c,) distances from the centres to the contact.
    motions : motions of each ball. Deformations that no motion makes in any contact are left out.
    elongation, slip, twist, roll : stiffness of the rows, each a number or (n_c,); kinds without
        stiffness are left out.
    gyration_i, gyration_j : (n_c,) radii of gyration R_g of the two balls, with which the rows are
        coefficients of w = R_g phi; by default they are those of phi.
    """
    n, t, b = contact_frames(normal)
    zeros = [np.zeros(len(normal))] * 3
    turn_i = 1.0 / np.asarray(gyration_i)
    turn_j = 1.0 / np.asarray(gyration_j)
    lever_i = arm_i * turn_i
    lever_j = arm_j * turn_j
    # each entry: kind, stiffness, vectors by which u and phi are multiplied, and the factors of
    # phi_j and phi_i. As b = n x t, (phi x n).t is phi.b, and (phi x n).b is -phi.t
    return _make_resisted_rows(
        [
            ("elongation", elongation, n, zeros, turn_j, turn_i),
            ("slip", slip, t, b, -lever_j, lever_i),
            ("slip", slip, b, t, lever_j, -lever_i),
            ("twist", twist, zeros, n, turn_j, turn_i),
            ("roll", roll, zeros, t, turn_j, turn_i),
            ("roll", roll, zeros, b, turn_j, turn_i),
        ],
        motions,
    )


def find_gyration(network: ContactNetwork) -> Array:
    """Return the radii of gyration (n,), m, of the balls of a ``network``; 1 for bodies that do not
    move.
    """
    ones = np.ones(network.n_balls)
    squares = np.divide(network.inertias, network.masses, out=ones, where=network.moving)
    return np.sqrt(squares)


def find_anchors(network: ContactNetwork) -> Array | None:
    """Return the stiffnesses (n, motions), N/m, of the springs to the ground of a ``network``,
    against u and w = R_g phi of each ball; zero for bodies that do not move. None if the network
    has no such springs.
    """
    if network.on_site is None:
        return None
    n_shifts = len(network.ball_motions.translations)
    springs = network.on_site.copy()
    springs[:, n_shifts:] /= find_gyration(network)[:, None] ** 2  # from phi, N m, to w, N/m
    return np.where(network.moving[:, None], springs, 0.0)


def anchor_rows(
    springs: Array, spring_motions: Motions, motions: Motions, n_contacts: int
) -> list[Row]:
    """Return the rows of n_g springs to the ground, the last n_g of ``n_contacts`` contacts, in
    each of which the ground holds ball i.

    The columns of ``springs`` (n_g, m) are the stiffnesses against u and w of the m
    ``spring_motions``. The rows are coefficients of ``motions``, which must contain those that
    springs resist. Entries of all other contacts are zero.
    """
    n_shifts = len(spring_motions.translations)
    n_others = n_contacts - len(springs)  # contacts that are no springs
    rows = []
    for number in np.flatnonzero(np.any(springs, axis=0)).tolist():
        if number < n_shifts:
            kind = ANCHOR
            column = motions.translations.index(spring_motions.translations[number])
        else:
            kind = ANCHORED_TURN
            turn = motions.rotations.index(spring_motions.rotations[number - n_shifts])
            column = len(motions.translations) + turn
        tail = np.zeros((n_contacts, motions.count))
        tail[n_others:, column] = -1.0
        stiffness = np.pad(springs[:, number], (n_others, 0))
        rows.append(Row(kind, stiffness, np.zeros_like(tail), tail))
    return rows


def network_rows(network: ContactNetwork) -> list[Row]:
    """Return the rows of the deformations that the contacts of a ``network`` resist, as
    coefficients of u and w = R_g phi of its balls, in SI.

    The stiffness of elongation and slip is in N/m. That of twist and roll is in N m, and their
    coefficients are in 1/m, as phi is w/R_g.

    Raises :class:`~granphon.base.errors.InputError` if the motions deform no contact.
    """
    rows = _make_network_rows(
        network,
        elongation=network.normal_stiffness,
        slip=network.shear_stiffness,
        twist=network.torsion_stiffness,
        roll=network.bending_stiffness,
    )
    if not rows:
        motions = network.ball_motions
        raise InputError(f"the motions {motions.name!r} deform no contact of this network")
    return rows


def network_unit_rows(network: ContactNetwork) -> list[Row]:
    """Return the rows of all deformations of contacts that the motions of a ``network`` can make,
    whether contacts resist them or not; as coefficients of u and w = R_g phi, as in
    :func:`network_rows`. With ``prestress`` those follow on which static normal forces, levers of
    slip that exceed the arms, and the growth of tangential forces act.
    """
    rows = _make_network_rows(network, elongation=1.0, slip=1.0, twist=1.0, roll=1.0)
    if not network.prestress:
        return rows
    rows += push_rows(network.normal[:, : network.dimension], network.ball_motions)
    tangential_force = network.static_forces[1]
    gyration = find_gyration(network)
    excesses = network.lever_excesses
    if excesses is not None:
        rows += excess_rows(
            network.normal[:, : network.dimension],
            (network.arm_i, network.arm_j),
            excesses,
            network.slip_stretch,
            network.ball_motions,
            (gyration[network.i], gyration[network.j]),
        )
    if np.any(network.tangential_growth) and np.any(tangential_force):
        rows += growth_rows(
            network.normal,
            tangential_force,
            (network.arm_i, network.arm_j),
            network.ball_motions,
            (gyration[network.i], gyration[network.j]),
        )
    return rows


def _make_network_rows(network: ContactNetwork, **stiffness: ArrayLike) -> list[Row]:
    """Return the rows of the contacts of a ``network``, with ``stiffness`` as the keyword arguments
    ``elongation``, ``slip``, ``twist`` and ``roll`` of :func:`contact_rows`.
    """
    gyration = find_gyration(network)
    return contact_rows(
        network.normal[:, : network.dimension],
        network.arm_i,
        network.arm_j,
        network.ball_motions,
        gyration_i=gyration[network.i],
        gyration_j=gyration[network.j],
        **stiffness,
    )


def push_rows(normal: Array, motions: Motions) -> list[Row]:
    """Return the rows of the displacements of ball j relative to ball i along both tangents of each
    contact, on which static normal forces act.

    ``normal`` (n_c, d) are unit vectors from ball i to ball j. The rows are coefficients of the
    ``motions`` of each ball; rows in which no motion takes part are left out.
    """
    _, t, b = contact_frames(normal)
    zeros = [np.zeros(len(normal))] * 3
    return _make_resisted_rows([("push", 1.0, axis, zeros, 1.0, 1.0) for axis in (t, b)], motions)


def carry_rows(
    normal: Array,
    force: Array,
    distance: Array,
    arms: tuple[Array, Array],
    motions: Motions,
    gyration: tuple[Array, Array],
    growth: Array,
    arm_rates: Array,
    *,
    turns: bool = False,
) -> list[tuple[Row, Row]]:
    """Return the stiffness that static tangential forces contribute, the sum of pull^T move, as
    pairs (pull, move) of rows.

    ``force`` (n_c, 3) is the tangential force T with which ball i acts on ball j. When the balls
    move, T turns with the normal n (n_c, 3), so that it stays perpendicular to n, and each of its
    two lever arms changes by c e, where e is the elongation, and c the ``arm_rates`` (n_c,), 1/2
    between balls. So the forces and moments on the balls change by

        dF_j = -dF_i = -(T.dn) n,    dM_i = -arm_i dn x T - c e n x T,    dn = v/r

    where v is the displacement across the contact and r the ``distance`` (n_c,) of the centres;
    dM_j is the same with arm_j. Such forces have no potential, so the stiffness is not symmetric.

    In some laws T also grows with the overlap, by dT = -g e T with the ``growth`` g (n_c,). If T
    ``turns`` with the balls, T also turns about n by the mean of their rotations phi about n:

        dT = (1/2) n.(phi_i + phi_j) n x T

    dT acts at the same arms as T. ``arms`` and radii of ``gyration`` are those of balls i and of
    balls j, each (n_c,); ``motions`` are as for :func:`contact_rows`.
    """
    n = normal
    turned_force = np.cross(normal, force)  # by a right angle about n
    arm_i, arm_j = arms
    turn_i = 1.0 / gyration[0]
    turn_j = 1.0 / gyration[1]
    zeros = list(np.zeros((3, len(n))))

    def push(vector: Array) -> Row:
        """Return the row of ``vector`` (n_c, 3) times dn, the change of the normal."""
        axes = list((vector / distance[:, None]).T)
        return _make_row("push", 1.0, axes, zeros, turn_j, turn_i, motions)

    def turn(vector: Array, lever_j: Array, lever_i: Array) -> Row:
        """Return the row of ``vector`` (n_c, 3) times lever_j phi_j + lever_i phi_i, with levers
        (n_c,).
        """
        axes = list(vector.T)
        return _make_row("turn", 1.0, zeros, axes, lever_j * turn_j, -lever_i * turn_i, motions)

    elongation = _make_row("elongation", 1.0, list(n.T), zeros, turn_j, turn_i, motions)
    ones = np.ones(len(n))
    pairs = [
        (elongation, push(force)),
        # dn x T is along n, with the length -(n x T).dn
        (turn(n, arm_j, arm_i), push(-turned_force)),
        (turn(arm_rates[:, None] * turned_force, ones, ones), elongation),
    ]
    if np.any(growth):
        slip = _slip_row(n, force, arms, motions, gyration)
        head = growth[:, None] * elongation.head
        tail = growth[:, None] * elongation.tail
        pairs.append((slip, Row("elongation", 1.0, head, tail)))
    if turns:
        slip = _slip_row(n, turned_force, arms, motions, gyration)
        pairs.append((slip, turn(-0.5 * n, ones, ones)))
    return pairs


def torque_pairs(
    normal: Array, torque: Array, distance: Array, motions: Motions, gyration: tuple[Array, Array]
) -> list[tuple[Row, Row]]:
    """Return the stiffness that static torques of rolling and twist contribute, the sum of pull^T
    move, as pairs (pull, move) of rows.

    ``torque`` (n_c, 3) is that with which ball i acts on ball j. Its part p across the normal n and
    its part m n along n keep their sizes and turn with n, so that the torques change by

        dM_j = -dM_i = -(p.dn) n + m dn,    dn = v/r

    where v is the displacement across the contact. As the tangential forces of :func:`carry_rows`,
    the torques have no potential. ``gyration`` are the radii of gyration of balls i and of balls j;
    the other arguments are those of :func:`carry_rows`.
    """
    n, t, b = contact_frames(normal)
    twist_torque = np.sum(torque * normal, axis=1)  # m
    roll_torque = torque - twist_torque[:, None] * normal  # p
    turn_i = 1.0 / gyration[0]
    turn_j = 1.0 / gyration[1]
    zeros = [np.zeros(len(normal))] * 3

    def turn(axis: list[Array]) -> Row:
        """Return the row of the rotation of ball j relative to ball i about an ``axis``."""
        return _make_row("turn", 1.0, zeros, axis, turn_j, turn_i, motions)

    def push(vector: Sequence[Array]) -> Row:
        """Return the row of the ``vector`` times dn."""
        axes = [component / distance for component in vector]
        return _make_row("push", 1.0, axes, zeros, turn_j, turn_i, motions)

    pairs = [(turn(n), push(list(roll_torque.T)))]
    for axis in (t, b):
        pairs.append((turn(axis), push([-twist_torque * component for component in axis])))
    return pairs


def growth_rows(
    normal: Array,
    force: Array,
    arms: tuple[Array, Array],
    motions: Motions,
    gyration: tuple[Array, Array],
) -> list[Row]:
    """Return two rows whose squares, times their stiffnesses, add up to the symmetric part of what
    the growth of static tangential forces adds to the stiffness: the last pair of
    :func:`carry_rows` for a growth of one and forces that do not turn about the normals. The
    arguments are those of :func:`carry_rows`.

    The stiffness of a row, 1 or -1, is the sign of its square.
    """
    zeros = list(np.zeros((3, len(normal))))
    elongation = _make_row("elongation", 1.0, list(normal.T), zeros, 1.0, 1.0, motions)
    slip = _slip_row(normal, force, arms, motions, gyration)
    pairs = split_pairs([(slip, elongation)])
    return [row._replace(kind=GROWTH, stiffness=sign) for row, sign in pairs]


def excess_pairs(
    normal: Array,
    arms: tuple[Array, Array],
    excesses: tuple[Array, Array],
    stretch: Array,
    motions: Motions,
    gyration: tuple[Array, Array],
) -> list[tuple[Row, Row]]:
    """Return what levers of slip that exceed the arms add to the stiffness, over the stiffness
    against slip, as pairs (pull, move) of rows: the sum of pull^T move.

    Slip has the levers arm + ``excesses``, and counts displacements across the contact 1 +
    ``stretch`` (n_c,) times. Its force makes torques with the ``arms``, so that the sum is not
    symmetric: pull is the slip by the arms, and move is what excesses and stretch add to this slip.
    ``arms``, ``excesses`` and ``gyration`` are those of balls i and of balls j, each (n_c,);
    ``normal`` (n_c, d) and ``motions`` are as for :func:`contact_rows`. Pairs without effect on the
    motions are left out.
    """
    _, t, b = contact_frames(normal)
    arm_levers = [arm / radius for arm, radius in zip(arms, gyration, strict=True)]
    excess_levers = [excess / radius for excess, radius in zip(excesses, gyration, strict=True)]
    pairs = []
    # as in contact_rows, (phi x n).t is phi.b, and (phi x n).b is -phi.t
    for shift_vector, turn_vector, sign in ((t, b, 1.0), (b, t, -1.0)):
        lever_i, lever_j = arm_levers
        pull = _make_row(
            "slip", 1.0, shift_vector, turn_vector, -sign * lever_j, sign * lever_i, motions
        )
        stretch_vector = [stretch * component for component in shift_vector]
        lever_i, lever_j = excess_levers
        move = _make_row(
            "slip", 1.0, stretch_vector, turn_vector, -sign * lever_j, sign * lever_i, motions
        )
        if np.any(move.head) or np.any(move.tail):
            pairs.append((pull, move))
    return pairs


def excess_rows(
    normal: Array,
    arms: tuple[Array, Array],
    excesses: tuple[Array, Array],
    stretch: Array,
    motions: Motions,
    gyration: tuple[Array, Array],
) -> list[Row]:
    """Return rows whose squares, times their stiffnesses, add up to the symmetric part of the sum
    of pull^T move over the pairs of :func:`excess_pairs`; the arguments are the same.

    The stiffness of a row, 1 or -1, is the sign of its square.
    """
    pairs = excess_pairs(normal, arms, excesses, stretch, motions, gyration)
    return [row._replace(kind=EXCESS, stiffness=sign) for row, sign in split_pairs(pairs)]


def _slip_row(
    normal: Array,
    force: Array,
    arms: tuple[Array, Array],
    motions: Motions,
    gyration: tuple[Array, Array],
) -> Row:
    """Return the row of T.slip, T = ``force`` (n_c, 3); the arguments are those of
    :func:`carry_rows`.
    """
    # T.(phi x n) is phi.(n x T)
    turned_force = np.cross(normal, force)
    factor_i = arms[0] / gyration[0]
    factor_j = -arms[1] / gyration[1]
    return _make_row("carry", 1.0, list(force.T), list(turned_force.T), factor_j, factor_i, motions)


def split_pairs(pairs: Sequence[tuple[Row, Row]]) -> list[tuple[Row, float]]:
    """Return two rows for each of the ``pairs`` (pull, move): (pull + move)/2 with the sign 1, and
    (pull - move)/2 with the sign -1.

    The sum of signs times squares of these rows is the symmetric part of the sum of pull^T move.
    """
    rows = []
    for pull, move in pairs:
        for sign in (1.0, -1.0):
            head = 0.5 * (pull.head + sign * move.head)
            tail = 0.5 * (pull.tail + sign * move.tail)
            rows.append((Row("carry", 1.0, head, tail), sign))
    return rows


def weigh_rows(rows: Sequence[Row], weights: NDArray[Any]) -> NDArray[Any]:
    """Return the weight (kinds, ..., n_c) of each of the ``rows``: the first of the two ``weights``
    (2, ..., n_c) for elongations, and the second for all other deformations.
    """
    return weights[[int(row.kind != "elongation") for row in rows]]


def strain_rows(row: Row, vector: Array, motions: Motions) -> Array:
    """Return the derivatives (n_c, n_u, d) of the deformations of a ``row`` with respect to the
    gradient du_a/dr_b of a uniform strain, in which the balls do not turn.

    ``vector`` (n_c, d) points from the centre of ball i to that of ball j. The n_u displacements
    u_a are those among the ``motions`` of a ball.
    """
    return np.asarray(row.head[:, motions.translating, None] * vector[:, None, :])


def _make_row(
    kind: str,
    stiffness: Any,
    shift_vector: _Axes,
    turn_vector: _Axes,
    factor_j: Any,
    factor_i: Any,
    motions: Motions,
) -> Row:
    """Return the row ``shift_vector.(u_j - u_i) + turn_vector.(factor_j phi_j - factor_i phi_i)``
    of a ``kind`` and a ``stiffness``, as coefficients of ``motions``.

    ``shift_vector`` and ``turn_vector`` are the x, y and z components of vectors, each (n_c,).
    ``factor_j`` and ``factor_i`` are numbers or (n_c,).
    """
    shifts = [shift_vector[axis] for axis in motions.translations]
    turns = [turn_vector[axis] for axis in motions.rotations]
    # the transposed array keeps the contacts of one motion contiguous in memory
    head = np.array(shifts + [factor_j * turn for turn in turns]).T
    tail = np.array(shifts + [factor_i * turn for turn in turns]).T
    return Row(kind, stiffness, head, tail)


def _make_resisted_rows(
    deformations: list[tuple[str, ArrayLike, _Axes, _Axes, Any, Any]], motions: Motions
) -> list[Row]:
    """Return the rows of those ``deformations`` that have a stiffness, and that one of the
    ``motions`` of balls makes in some contact.

    Each deformation is a tuple (kind, stiffness, shift_vector, turn_vector, factor_j, factor_i) of
    arguments of :func:`_make_row`. If there are no contacts at all, the second condition counts as
    met.
    """
    rows = []
    for kind, stiffness, shift_vector, turn_vector, factor_j, factor_i in deformations:
        if not np.any(stiffness):
            continue
        components = [shift_vector[axis] for axis in motions.translations]
        components += [turn_vector[axis] for axis in motions.rotations]
        has_effect = any(component.any() or not len(component) for component in components)
        if has_effect:
            row = _make_row(kind, stiffness, shift_vector, turn_vector, factor_j, factor_i, motions)
            rows.append(row)
    return rows


# -- rows in a wave --------------------------------------------------------------------------------


class WaveRows(NamedTuple):
    """Rows of C(q) as functions of the wave vector q: ``odd`` sin(h) + ``even`` cos(h), where
    h = q.(r_j - r_i)/2 is the half angle of a contact.

    Attributes
    ----------
    odd : (kinds, n_c, n) coefficients of the sine, an odd function of q.
    even : (kinds, n_c, n) coefficients of the cosine, an even function of q.
    half : (n_c, p) half vectors (r_j - r_i)/2, along the periods.
    """

    odd: NDArray[Any]
    even: NDArray[Any]
    half: Array

    def compute_rows(self, wavevectors: Array, wants_derivative: bool = False) -> NDArray[Any]:
        """Return the rows (n_q, kinds * n_c, n) at ``wavevectors`` (n_q, p), or if
        ``wants_derivative`` their derivatives with respect to the half angle.
        """
        angle = wavevectors @ self.half.T
        odd_factor = np.sin(angle)
        even_factor = np.cos(angle)
        if wants_derivative:
            odd_factor, even_factor = even_factor, -odd_factor
        # view complex numbers as pairs of reals: the factors are real, and a real product is
        # cheaper
        rows = odd_factor[:, None, :, None] * self.odd.view(np.float64)
        rows += even_factor[:, None, :, None] * self.even.view(np.float64)
        kinds, contacts, columns = self.odd.shape
        return rows.view(self.odd.dtype).reshape(len(angle), kinds * contacts, columns)

    def repeat_half_vectors(self) -> Array:
        """Return the half vectors (kinds * n_c, p) of the rows that :meth:`compute_rows` returns:
        the gradients of their half angles with respect to q.
        """
        return np.tile(self.half, (len(self.odd), 1))

    def find_effects(self) -> NDArray[np.bool_]:
        """Return (kinds, n_c, n) whether a motion takes part in a row at some wave vector."""
        return np.asarray((self.odd != 0.0) | (self.even != 0.0))

    def select(self, rows: NDArray[np.bool_], columns: NDArray[np.intp]) -> WaveRows:
        """Return the rows that are true in ``rows`` (kinds, n_c), for the motions of numbers
        ``columns`` (m,).

        If the kinds in which a row is true all have the same true contacts, the result has these
        kinds and contacts. Otherwise all true rows become one kind, with a half vector each.
        """
        if np.all(rows) and len(columns) == self.odd.shape[2]:
            return self
        kinds = np.any(rows, axis=1)
        contacts = np.any(rows, axis=0)
        is_full_table = np.all(rows[np.ix_(kinds, contacts)])
        if is_full_table:
            entries: Any = np.ix_(kinds, contacts, columns)
            odd = self.odd[entries]
            even = self.even[entries]
            half = self.half[contacts]
        else:
            odd = self.odd[rows][None, :, columns]
            even = self.even[rows][None, :, columns]
            half = self.half[np.nonzero(rows)[1]]
        # only contiguous complex numbers can be viewed as pairs of reals, as in compute_rows
        return WaveRows(np.ascontiguousarray(odd), np.ascontiguousarray(even), half)


def bend(angle: Array) -> Array:
    """Return sin h - h cos h of the ``angle`` h (...), rad, with all digits also at small angles,
    where the difference is h^3/3. Its derivative with respect to h is h sin h.
    """
    is_small = np.abs(angle) < _LARGEST_OF_SERIES
    small_angle = np.where(is_small, angle, 0.0)  # powers of large angles would overflow
    square = np.square(small_angle)
    series = np.zeros_like(angle)
    for coefficient in reversed(_BEND):  # Horner's rule
        series = series * square + coefficient
    difference = np.sin(angle) - angle * np.cos(angle)
    return np.asarray(np.where(is_small, small_angle * square * series, difference))
