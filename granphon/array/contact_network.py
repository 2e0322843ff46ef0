"""The network of contacts of a sample at rest."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from granphon.array.true_geometry import ExactPlace
from granphon.balls.contact_table import contact_frames
from granphon.balls.packing import Packing
from granphon.dynamics.compatibility import GYRATION
from granphon.networks.network import ContactNetwork

Array = NDArray[np.float64]


def turn_frames(packing: Packing, vectors: tuple[Any, Any, Any], shape: tuple[int, ...]) -> Array:
    """Return vectors of contacts in space, (L1, ..., Lp, n_c, 3).

    They are given by their components along each contact's direction on the lattice and its two tangents there, each a
    number or (n_c, L1, ..., Lp).
    """
    frames = np.array(contact_frames(packing.structure.contacts.normal))  # (3, 3, n_c)
    parts = np.array([np.broadcast_to(part, (frames.shape[2], *shape)) for part in vectors])
    return np.asarray(np.einsum("kc...,kxc->...cx", parts, frames))


def make_network(
    packing: Packing, positions: Array, diameters: Array, force: Array, stiffness: Array, shear: ArrayLike | None = None,
    tangential: Array | None = None, place: ExactPlace | None = None,
) -> ContactNetwork:  # fmt: skip
    """Return the balls and the contacts that carry load; SI units.

    Contacts have the directions of the lattice. Masses, inertias and arms are those of the mean ball, as in the paper's
    limit. In the true geometry directions and arms are the contacts' own, and static forces act (prestress).

    Parameters
    ----------
    packing : the packing of the sample.
    positions, diameters : (L1, ..., Lp, p) or (L1, ..., Lp, n, p), and (L1, ..., Lp) or (L1, ..., Lp, n), m.
    force, stiffness : (L1, ..., Lp, n_c), N and N/m; contacts without stiffness are left out.
    shear : ratio of the tangential to the normal stiffness, a number or (L1, ..., Lp, n_c); that of the packing if None.
    tangential : (L1, ..., Lp, n_c, p) tangential forces of ball i on ball j, N; None if contacts have none, which are
        zeros under prestress.
    place : configuration in the true geometry; None where contacts keep the directions of the lattice.
    """
    structure, table, d = packing.structure, packing.structure.contacts, packing.diameter
    n, p, shape = structure.n_balls, structure.periods, force.shape[:-1]
    cells = np.stack(np.meshgrid(*map(np.arange, shape), indexing="ij"), axis=-1).reshape(-1, 1, p)
    steps = cells + table.shift  # (cells, n_c, p) cell of ball j
    number = np.ravel_multi_index(tuple(np.moveaxis(np.mod(steps, shape), -1, 0)), shape)
    live = stiffness.reshape(number.shape) > 0.0
    shift, normal = np.zeros((*number.shape, 3), int), np.zeros((*number.shape, 3))
    shift[..., :p], normal[..., : structure.dimension] = np.floor_divide(steps, shape), table.normal
    places, cell = np.zeros((diameters.size, 3)), np.zeros((3, 3))
    places[:, :p], cell[:p, :p] = positions.reshape(-1, p), d * structure.vectors[:, :p] * np.array(shape)[:, None]
    arms = [np.broadcast_to(d * arm, number.shape) for arm in (table.arm_i, table.arm_j)]
    if place is not None:
        cell *= 1.0 - place.geometry.ratio * place.overlap
        normal = turn_frames(packing, place.normal, shape).reshape(normal.shape)
        reach = [0.5 * place.size + sign * place.geometry.uneven for sign in (-1.0, 1.0)]
        arms = [d * np.moveaxis(arm, 0, -1).reshape(number.shape) for arm in reach]
    arm_i, arm_j = (arm[live] for arm in arms)
    carried, spring = (values.reshape(number.shape)[live] for values in (force, stiffness))
    eta = packing.mindlin_ratio if shear is None else shear
    ratio = np.broadcast_to(eta, (*shape, len(table))).reshape(number.shape)[live]
    across = None
    if tangential is not None or place is not None:
        across = np.zeros((len(carried), 3))
    if tangential is not None and across is not None:
        across[:, :p] = tangential.reshape(*number.shape, p)[live]
    mass, twist = np.full(len(places), packing.mass), packing.find_torsion(carried, spring)
    return ContactNetwork(
        cell=cell, pbc=(p > 0, p > 1, p > 2), positions=places, radii=0.5 * diameters.ravel(), masses=mass,
        inertias=(GYRATION * d) ** 2 * mass, i=(n * np.arange(len(cells))[:, None] + table.i)[live],
        j=(n * number + table.j)[live], shift=shift[live], normal=normal[live],
        normal_force=carried, normal_stiffness=spring,
        shear_stiffness=ratio * spring, torsion_stiffness=twist * d * d * spring,
        bending_stiffness=packing.bending * d * d * spring, arm_i=arm_i, arm_j=arm_j,
        motions=packing.named_motions.name, dimension=structure.dimension, prestress=place is not None,
        lattice=structure if place is None else None, shape=shape if place is None else None,
        tangential_force=across,
    )  # fmt: skip
