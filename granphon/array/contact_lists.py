"""Contacts of an array at rest as a list, in the directions of the lattice or in the true ones.

Lengths are over the diameter d. Stiffnesses are in the unit of those of the equilibrium, c W^(1/2),
so that forces are in c W^(1/2) d: forces of the equilibrium, in c W^(3/2), are multiplied by W/d.
In an array of C cells ball b of cell c has the number b C + c, and the contact of kind k that
starts in cell c has the number k C + c.
"""

from __future__ import annotations

import math
from functools import lru_cache
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from granphon.array.geometry import ExactPlace
from granphon.balls.lattices import Lattice
from granphon.balls.motions import Motions, default_motions, select_motions
from granphon.base.arrays import Array
from granphon.contacts.contact_list import ContactList
from granphon.contacts.grid import find_lattice_grid
from granphon.statics.options import GridOptions

#: number of balls up to which the contacts of an array are kept, which take 200 bytes each
_KEPT_BALLS = GridOptions().small_array


class Springs(NamedTuple):
    """Stiffnesses (n_c, L1, ..., Lp) of contacts against elongation, slip, twist and roll."""

    normal: Array
    shear: Array
    torsion: Array
    bending: Array

    @classmethod
    def of(cls, normal: Array, shear: ArrayLike, torsion: ArrayLike, bending: ArrayLike) -> Springs:
        """Return springs with the stiffness ``normal`` (n_c, L1, ..., Lp) of each contact; those
        against slip, twist and roll, ``shear``, ``torsion`` and ``bending``, have the same shape,
        or are numbers for all contacts.
        """
        others = (shear, torsion, bending)
        return cls(normal, *(np.broadcast_to(spring, normal.shape) for spring in others))


def select_resisted(
    lattice: Lattice, shear: ArrayLike, torsion: ArrayLike, bending: float
) -> Motions:
    """Return the motions of balls on a ``lattice``, without the rotations that nothing resists.

    ``shear``, ``torsion`` and ``bending`` are the stiffnesses against slip, twist and roll, in any
    unit: it matters only whether they are zero.
    """
    return select_motions(shear, torsion, bending, default_motions(lattice.periods))


def list_on_lattice(
    shape: tuple[int, ...], lattice: Lattice, motions: Motions, springs: Springs
) -> ContactList:
    """Return the contacts of an array of ``shape`` (L1, ..., Lp) cells of a ``lattice``, in the
    directions of the lattice and without static forces; balls have the ``motions``, and contacts
    the ``springs``.
    """
    grid = find_grid(shape, lattice)
    normal, shear, torsion, bending = (np.ravel(stiffness) for stiffness in springs)
    return ContactList(
        n_balls=lattice.n_balls * math.prod(shape),
        motions=motions,
        i=grid.i,
        j=grid.j,
        vector=grid.vector,
        normal=grid.normal,
        arm_i=grid.arm_i,
        arm_j=grid.arm_j,
        normal_stiffness=normal,
        shear_stiffness=shear,
        torsion_stiffness=torsion,
        bending_stiffness=bending,
        normal_force=np.zeros(normal.size),
        measure=float(lattice.measure) * math.prod(shape),
        dimension=lattice.periods,
        grid=shape,
    )


def list_in_true_directions(
    place: ExactPlace,
    motions: Motions,
    springs: Springs,
    forces: Array,
    leaning: NDArray[np.bool_],
    shears: Array | None = None,
) -> ContactList:
    """Return the contacts of an array in its true geometry, with the forces that act, in
    c W^(1/2) d, the unit of all lists of this module.

    Parameters
    ----------
    place : configuration of the balls.
    motions : motions of each ball.
    springs : stiffnesses of the contacts, c W^(1/2).
    forces : (n_c, L1, ..., Lp) normal forces of the equilibrium, c W^(3/2).
    leaning : (n_c, L1, ..., Lp) whether the normal force of a contact resists motions of its balls
        across the normal; at all other contacts it supports them.
    shears : (contacts, 3) tangential forces T along the axes of space, of ball j on ball i,
        c W^(3/2); None without friction.
    """
    lattice = place.stencils.lattice
    shape = place.stencils.shape
    p = lattice.periods
    cells = math.prod(shape)
    grid = find_grid(shape, lattice)
    eps = place.ratio  # W/d, which takes forces from c W^(3/2) to c W^(1/2) d
    normal, shear, torsion, bending = (np.ravel(stiffness) for stiffness in springs)
    # an empty array stands for no tangential forces
    tangential = origin = np.zeros((0, 3))
    if shears is not None and np.any(shears):
        tangential = -eps * shears  # of ball i on ball j
        origin = grid.normal  # from which tangents, and these forces, are carried
    return ContactList(
        n_balls=lattice.n_balls * cells,
        motions=motions,
        i=grid.i,
        j=grid.j,
        vector=place.vector,
        normal=place.normal,
        arm_i=np.ravel(0.5 * place.size - place.uneven),
        arm_j=np.ravel(0.5 * place.size + place.uneven),
        normal_stiffness=normal,
        shear_stiffness=shear,
        torsion_stiffness=torsion,
        bending_stiffness=bending,
        normal_force=eps * np.ravel(forces),
        leaning=np.ravel(leaning) if np.any(leaning) else np.zeros(0, bool),
        tangential_force=tangential,
        origin=origin,
        measure=float(lattice.measure) * cells * (1.0 - eps * place.overlap) ** p,
        dimension=p,
        grid=shape,
    )


class _Grid(NamedTuple):
    """The part of a :class:`~granphon.contacts.contact_list.ContactList` that arrays of one shape
    share: numbers of balls (contacts,), vectors and normals (contacts, 3), arms (contacts,) in d.
    """

    i: NDArray[np.int64]
    j: NDArray[np.int64]
    vector: Array
    normal: Array
    arm_i: Array
    arm_j: Array


def find_grid(shape: tuple[int, ...], lattice: Lattice) -> _Grid:
    """Return the balls, vectors, normals and arms of the contacts of an array of ``shape`` (L1,
    ..., Lp) cells of a ``lattice``; arrays are read-only.

    The contacts of the last 8 arrays of at most ``_KEPT_BALLS`` balls are kept for further calls.
    """
    if math.prod(shape) * lattice.n_balls <= _KEPT_BALLS:
        return _keep_grid(shape, lattice)
    return _keep_grid.__wrapped__(shape, lattice)  # without the cache


@lru_cache(maxsize=8)
def _keep_grid(shape: tuple[int, ...], lattice: Lattice) -> _Grid:
    """Return the contacts of :func:`find_grid`, in read-only arrays: calls with the same arguments
    share them.
    """
    table = lattice.contacts
    grid = find_lattice_grid(shape, lattice)
    cells = grid.n_cells
    contacts = _Grid(
        *grid.ends,
        np.repeat(grid.vector, cells, axis=0),
        np.repeat(grid.normal, cells, axis=0),
        np.repeat(table.arm_i, cells),
        np.repeat(table.arm_j, cells),
    )
    for values in contacts:
        values.flags.writeable = False
    return contacts
