"""What compiled loops read of a list of contacts. This module needs no Numba."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from granphon.base.arrays import Array


class Columns(NamedTuple):
    """What loops read of a list of n_c contacts.

    Attributes
    ----------
    i, j : (n_c,) numbers of the two balls.
    vector : (n_c, 3) from the centre of ball i to that of ball j.
    normal : (n_c, 3) its direction, a unit vector.
    arm_i, arm_j : (n_c,) distances from the centres to the contact.
    distance : (n_c,) of the centres.
    normal_stiffness, shear_stiffness : (n_c,) force over elongation and over slip.
    torsion_stiffness, bending_stiffness : (n_c,) torque over twist and over roll.
    side_stiffness : (n_c,) stiffness against displacements across the normal that the static force
        along the normal makes; see
        :attr:`~granphon.contacts.contact_list.ContactList.side_stiffness`.
    tangential_force : (n_c, 3) static force of ball i on ball j across the normal; (0, 3) if there
        is none.
    origin : (n_c, 3) unit normals from which the tangents have turned, and with them the static
        force T across the normal. Tangents turn in two rotations: the smallest that takes the
        origin to the present normal, and one about the normal by the mean rotation of both balls
        about the origin. (0, 3) if T does not turn about the normal.
    """

    i: NDArray[np.int64]
    j: NDArray[np.int64]
    vector: Array
    normal: Array
    arm_i: Array
    arm_j: Array
    distance: Array
    normal_stiffness: Array
    shear_stiffness: Array
    torsion_stiffness: Array
    bending_stiffness: Array
    side_stiffness: Array
    tangential_force: Array
    origin: Array

    def freeze(self) -> Columns:
        """Return read-only views of all columns.

        A compiled loop is compiled anew for each combination of writable and read-only arguments;
        with views that are all read-only it is compiled once.
        """
        views = {name: column.view() for name, column in self._asdict().items()}
        for view in views.values():
            view.flags.writeable = False
        return self._replace(**views)
