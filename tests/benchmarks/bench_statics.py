"""Benchmarks of the linear response of arrays: time of the processor over one factorisation of the
same matrix by SuperLU, a yardstick that does not change with granphon.
"""

from __future__ import annotations

import time

import numpy as np
from scipy.sparse import eye_array
from scipy.sparse.linalg import splu
from side_by_side import Part, Row, alternate, over

from granphon.array.geometry import ReducedLoad
from granphon.array.rest import equilibrate
from granphon.array.stencils import Stencils
from granphon.balls.lattices import FCC, TRIANGULAR
from granphon.contacts.tangent import find_tangent, unit_strains

#: lattice, cells along each period, and the bound of the ratio for any load, in the directions of
#: the lattice and in the true ones. It is reached at low load, where SuperLU leaves out contacts
#: that are open
CASES = ((TRIANGULAR, 24, 2.2), (TRIANGULAR, 64, 1.3), (FCC, 6, 2.0))
SPACINGS = (1.0, 0.7, 0.45)
#: shear over normal stiffness, and width over diameter
ETA = 0.84
RATIO = 2.55e-4


def tensors(repeats: int) -> list[Row]:
    rows = []
    for lattice, side, bound in CASES:
        shape = (side,) * lattice.periods
        stencils = Stencils(shape, lattice=lattice)
        x = np.random.default_rng(0).uniform(-0.5, 0.5, shape)
        x -= np.mean(x)
        for spacing in SPACINGS:
            load = ReducedLoad(overlap=spacing - 0.5)
            limit = equilibrate(x, load, stencils)
            exact = equilibrate(x, load, stencils, start=limit, ratio=RATIO)
            matrix = find_tangent(limit._list_contacts(ETA), unit_strains(lattice.periods)).matrix
            held = matrix + 1e-8 * eye_array(matrix.shape[0], format="csc")
            seconds = alternate(
                repeats,
                time.process_time,
                lattice=lambda rest=limit: rest.find_elasticity(ETA),
                exact=lambda rest=exact: rest.find_elasticity(ETA),
                superlu=lambda held=held: splu(
                    held, "MMD_AT_PLUS_A", diag_pivot_thresh=0.0, options={"SymmetricMode": True}
                ),
            )
            for geometry in ("lattice", "exact"):
                what = (
                    f"{lattice.name}, {side}^{lattice.periods}, a* = {spacing:g}, {geometry}"
                    f" directions: elastic tensor over a factorisation by SuperLU"
                )
                rows.append(over(what, seconds, geometry, "superlu", bound))
    return rows


PARTS: dict[str, Part] = {"tensors": tensors}
