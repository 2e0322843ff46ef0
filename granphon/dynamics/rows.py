"""The deformations of contacts, as coefficients of the motions of the two balls that touch.

A contact of normal n, whose ends i and j lie ``arm_i`` and ``arm_j`` from the centres, deforms by

    elongation  (u_j - u_i).n
    slip        (1 - nn)(u_j - u_i) - (arm_i phi_i + arm_j phi_j) x n
    twist       (phi_j - phi_i).n
    roll        (1 - nn)(phi_j - phi_i)

Slip and roll have two components, along the tangents of :func:`~granphon.balls.contact_table.contact_frames`. Each is
``head . x_j - tail . x_i``, x being the motions that balls have. Everything linear in the dynamics of contacts is made of
these rows: C(q), force constants, strains, the stencils of an array.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from granphon.balls.contact_table import contact_frames
from granphon.balls.motions import Motions

__all__ = ["Row", "contact_rows", "push_rows", "strain_rows"]

Array = NDArray[np.float64]


class Row(NamedTuple):
    """One deformation of every contact: ``head . x_j - tail . x_i``.

    Attributes
    ----------
    kind : "elongation", "slip", "twist", "roll"; or "push", the displacement across the contact.
    stiffness : over that of elongation: of slip eta, of twist and roll in units of d^2; a number, or one for each contact.
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
    """The deformations of contacts that are resisted and can be made: elongation, slip, twist and roll, in this order.

    Parameters
    ----------
    normal : (n_c, 2) or (n_c, 3) unit vectors from ball i to ball j.
    arm_i, arm_j : (n_c,) distances from the centres to the contact.
    motions : of each ball. Deformations that none of them makes in any contact are left out.
    elongation, slip, twist, roll : relative stiffness, each a number or (n_c,); kinds without stiffness are left out.
    gyration_i, gyration_j : radii of gyration R_g, (n_c,), for coefficients of w = R_g phi; by default those of phi.
    """
    n, t, b = contact_frames(normal)
    none = [np.zeros(len(normal))] * 3
    one_i, one_j = 1.0 / np.asarray(gyration_i), 1.0 / np.asarray(gyration_j)
    at_i, at_j = arm_i * one_i, arm_j * one_j
    # along which axis u moves the contact and about which phi turns it, times what. As b = n x t, (phi x n).t is phi.b,
    # and (phi x n).b is -phi.t
    return _keep_resisted(
        [
            ("elongation", elongation, n, none, one_j, one_i),
            ("slip", slip, t, b, -at_j, at_i), ("slip", slip, b, t, at_j, -at_i),
            ("twist", twist, none, n, one_j, one_i),
            ("roll", roll, none, t, one_j, one_i), ("roll", roll, none, b, one_j, one_i),
        ],
        motions,
    )  # fmt: skip


def push_rows(normal: Array, motions: Motions) -> list[Row]:
    """The displacements of ball j against ball i across each contact, along its tangents: what a static force acts on."""
    _, t, b = contact_frames(normal)
    none = [np.zeros(len(normal))] * 3
    return _keep_resisted([("push", 1.0, axis, none, 1.0, 1.0) for axis in (t, b)], motions)


def strain_rows(row: Row, vector: Array, motions: Motions) -> Array:
    """(n_c, n_u, d): a row's deformation of contacts between centres ``vector`` (n_c, d) apart, where u_a = x_b.

    The derivative with respect to the displacement gradient u_a,b, balls not turning; n_u counts the displacements.
    """
    return np.asarray(row.head[:, motions.translating, None] * vector[:, None, :])


#: components along x, y and z, each (n_c,)
_Axes = list[Array]


def _keep_resisted(deformations: list[tuple[str, ArrayLike, _Axes, _Axes, Any, Any]], motions: Motions) -> list[Row]:
    """Rows ``moved.(u_j - u_i) + turned.(at_j phi_j - at_i phi_i)`` in terms of the motions, but for those without effect.

    These have no stiffness, or none of the motions makes them in any contact; without contacts nothing is said of that.
    """
    rows = []
    for kind, stiffness, moved, turned, at_j, at_i in deformations:
        if not (stiffness.any() if isinstance(stiffness, np.ndarray) else stiffness):
            continue
        moves, turns = [moved[axis] for axis in motions.translations], [turned[axis] for axis in motions.rotations]
        if any(part.any() or not len(part) for part in moves + turns):
            # one motion after the other: contacts lie side by side
            head, tail = (np.array(moves + [at * turn for turn in turns]).T for at in (at_j, at_i))
            rows.append(Row(kind, stiffness, head, tail))
    return rows
