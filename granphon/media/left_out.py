"""What a simulation in the directions of the lattice leaves out, and the geometry that a simulation has if none is named.

In the directions of the lattice, the limit of zero width, a ball between two others in line is held by these two alone. In
truth it leans on a third, with about W/d of the force. The stiffness of a shear spring there goes as the cube root of that,
so that it still adds to the shear modulus; forces, spacings and normal stiffnesses hardly change. Without shear springs
nothing is left out but terms of the order of the overlap over the diameter, which ``finite_overlap`` names.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray

from granphon.array.geometry import LARGEST_RATIO
from granphon.balls.loads import Load
from granphon.balls.packing import Packing
from granphon.media.typical_arrays import estimate_open_contacts

Array = NDArray[np.float64]
#: the geometries of contacts: directions are those of the lattice, or follow from the positions of the balls
LATTICE, EXACT = GEOMETRIES = "lattice", "exact"
#: part of the shear modulus up to which the directions of the lattice may leave it out, if no geometry is named
_CHOSEN_LIMIT = 1e-3
#: part of the shear modulus beyond which a simulation in the directions of the lattice is not valid
LEFT_OUT_LIMIT = 1e-2
#: simulated shear moduli with friction are too small by the part A o^3.5 (W/d)^0.3, where o is the fraction of contacts that
#: are open; A by the number of periods. Measured against the true geometry of the same samples (triangular lattice, fcc; o
#: from 0.15 to 0.5, W/d from 1e-7 to 1e-3), to a factor of 1.5; what it is for more, or fewer, open contacts is not known
_DEFICITS = {2: 36.0, 3: 3.7}
#: factor by which more is left out after a history of friction: contacts that are loose at its start bear tangential forces
#: later. It is that of 32 x 32 balls of steel from a* = 1/2, with mu = 0.2 and without sliding, at f* from 0.03 to 0.12
_BY_HISTORY = 3.0
#: exponents of o and W/d
_OPEN_POWER, _WIDTH_POWER = 3.5, 0.3


def estimate_shear_deficit(contact_fraction: ArrayLike, ratio: float, periods: int, history: bool = False) -> Array:
    """Return the part, at most 1, by which a shear modulus with friction is expected to be too small in the limit W/d = 0.

    Parameters
    ----------
    contact_fraction : fraction of contacts that carry load.
    ratio : W/d.
    periods : of the lattice, 2 or 3; contacts on a line do not shear.
    history : whether the array has been loaded with friction; otherwise it is at rest without.
    """
    share = _DEFICITS[periods] * (_BY_HISTORY if history else 1.0)
    opened = 1.0 - np.asarray(contact_fraction)
    return np.asarray(np.minimum(share * opened**_OPEN_POWER * ratio**_WIDTH_POWER, 1.0))


def expect_shear_deficit(packing: Packing, load: Load, history: bool = False, ratio: float | None = None) -> Array:
    """Return :func:`estimate_shear_deficit` (n,) at each value of an applied load, before anything is simulated.

    ``ratio`` is W/d, by default that of the packing. It is zero of balls that resist no slip, of equal balls and on a line.
    """
    if not (packing.mindlin_ratio and packing.spread_matters):
        return np.zeros(load.size)
    closed = 1.0 - estimate_open_contacts(packing, load)
    own = packing.relative_width if ratio is None else ratio
    return estimate_shear_deficit(closed, own, packing.structure.periods, history)


def find_left_out(deficit: Array, geometry: str | None) -> Array:
    """Return the part of the shear modulus that arrays leave out; ``deficit`` is that in the directions of the lattice.

    It is zero in the exact geometry, which a geometry that is not named (None) is where the deficit is too large.
    """
    if geometry == EXACT:
        return np.zeros_like(deficit)
    return deficit if geometry == LATTICE else np.where(deficit > _CHOSEN_LIMIT, 0.0, deficit)


def can_be_exact(packing: Packing) -> bool:
    """Whether the exact geometry is that of these balls: they differ, but not by more than a fifth of their diameter."""
    return packing.spread_matters and packing.width <= LARGEST_RATIO * packing.diameter


def choose_geometries(packing: Packing, load: Load, finite_overlap: bool | None = None) -> list[str]:
    """Return the geometry of an array at rest without friction at each value of an applied load, if none is named.

    It is :data:`LATTICE` where its directions are expected to leave out less than 1e-3 of the shear modulus (of other
    results that is less), else :data:`EXACT`. With ``finite_overlap`` it is exact, and where that is False, and not None, it
    is not.
    """
    if finite_overlap is not None or not can_be_exact(packing):
        return [EXACT if finite_overlap else LATTICE] * load.size
    return [EXACT if deficit > _CHOSEN_LIMIT else LATTICE for deficit in expect_shear_deficit(packing, load).tolist()]
