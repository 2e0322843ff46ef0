"""The network of contacts of a sample at rest."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray

from granphon.balls.packing import Packing
from granphon.dynamics.compatibility import GYRATION
from granphon.networks.network import ContactNetwork

__all__ = ["make_network"]

Array = NDArray[np.float64]


def make_network(
    packing: Packing, positions: Array, diameters: Array, force: Array, stiffness: Array, shear: ArrayLike | None = None,
    tangential: Array | None = None,
) -> ContactNetwork:  # fmt: skip
    """Return the balls and the contacts that carry load; SI units. Contacts have the directions of the lattice.

    Masses, inertias and arms are those of the mean ball, as in the paper's limit.

    Parameters
    ----------
    packing : the packing of the sample.
    positions, diameters : (L1, ..., Lp, p) or (L1, ..., Lp, n, p), and (L1, ..., Lp) or (L1, ..., Lp, n), m.
    force, stiffness : (L1, ..., Lp, n_c), N and N/m; contacts without stiffness are left out.
    shear : ratio of the tangential to the normal stiffness, a number or (L1, ..., Lp, n_c); that of the packing if None.
    tangential : (L1, ..., Lp, n_c, p) tangential forces of ball i on ball j, N; None if contacts have none.
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
    arm_i, arm_j = (np.broadcast_to(d * arm, number.shape)[live] for arm in (table.arm_i, table.arm_j))
    carried, spring = (values.reshape(number.shape)[live] for values in (force, stiffness))
    eta = packing.mindlin_ratio if shear is None else shear
    ratio = np.broadcast_to(eta, (*shape, len(table))).reshape(number.shape)[live]
    across = None
    if tangential is not None:
        across = np.zeros((len(carried), 3))
        across[:, :p] = tangential.reshape(*number.shape, p)[live]
    mass, twist = np.full(len(places), packing.mass), packing.find_torsion(carried, spring)
    return ContactNetwork(
        cell=cell, pbc=(p > 0, p > 1, p > 2), positions=places, radii=0.5 * diameters.ravel(), masses=mass,
        inertias=(GYRATION * d) ** 2 * mass, i=(n * np.arange(len(cells))[:, None] + table.i)[live],
        j=(n * number + table.j)[live], shift=shift[live], normal=normal[live],
        normal_force=carried, normal_stiffness=spring,
        shear_stiffness=ratio * spring, torsion_stiffness=twist * d * d * spring,
        bending_stiffness=packing.bending * d * d * spring, arm_i=arm_i, arm_j=arm_j,
        motions=packing.named_motions.name, dimension=structure.dimension, lattice=structure, shape=shape,
        tangential_force=across,
    )  # fmt: skip
