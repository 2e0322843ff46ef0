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

from collections.abc import Iterator
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
    head, tail : (n_c, motions) coefficients of the motions of ball j and of ball i; rotations in radians.
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
    slip: ArrayLike = 0.0,
    twist: ArrayLike = 0.0,
    roll: ArrayLike = 0.0,
) -> list[Row]:
    """The deformations of contacts that are resisted, elongation first.

    Parameters
    ----------
    normal : (n_c, 2) or (n_c, 3) unit vectors from ball i to ball j.
    arm_i, arm_j : (n_c,) distances from the centres to the contact.
    motions : of each ball. Deformations that none of them makes in any contact are left out.
    slip, twist, roll : stiffness over that of elongation, each a number or (n_c,); kinds without stiffness are left out.
    """
    n, t, b = contact_frames(normal)
    at_i, at_j = arm_i[:, None], arm_j[:, None]

    def deformations() -> Iterator[tuple[str, ArrayLike, Array | None, Array | None, Array | None]]:
        # kind, stiffness, coefficients of u_j - u_i, of phi_j, and of -phi_i. As b = n x t, (phi x n).t is phi.b
        yield "elongation", 1.0, n, None, None
        if np.any(slip):
            yield "slip", slip, t, -at_j * b, at_i * b
            yield "slip", slip, b, at_j * t, -at_i * t
        if np.any(twist):
            yield "twist", twist, None, n, n
        if np.any(roll):
            yield "roll", roll, None, t, t
            yield "roll", roll, None, b, b

    rows = (
        Row(kind, stiffness, _project(moving, turning_j, motions), _project(moving, turning_i, motions))
        for kind, stiffness, moving, turning_j, turning_i in deformations()
    )
    # without contacts nothing can be told of them
    return [row for row in rows if not len(normal) or np.any(row.head) or np.any(row.tail)]


def push_rows(normal: Array, motions: Motions) -> list[Row]:
    """The displacements of ball j against ball i across each contact, along its tangents: what a static force acts on."""
    _, t, b = contact_frames(normal)
    across = (_project(tangent, None, motions) for tangent in (t, b))
    return [Row("push", 1.0, axis, axis) for axis in across if np.any(axis)]


def strain_rows(row: Row, vector: Array, motions: Motions) -> Array:
    """(n_c, n_u, d): a row's deformation of contacts between centres ``vector`` (n_c, d) apart, where u_a = x_b.

    The derivative with respect to the displacement gradient u_a,b, balls not turning; n_u counts the displacements.
    """
    return np.asarray(row.head[:, motions.translating, None] * vector[:, None, :])


def _project(moving: Array | None, turning: Array | None, motions: Motions) -> Array:
    """(n_c, motions): coefficients of the motions, from those of u and of phi (n_c, 3)."""
    found = moving if moving is not None else turning
    assert found is not None
    out = np.zeros((len(found), motions.count))
    for part, axes, which in (
        (moving, motions.translations, motions.translating), (turning, motions.rotations, motions.turning)
    ):  # fmt: skip
        if part is not None:
            out[:, which] = part[:, axes]
    return out
