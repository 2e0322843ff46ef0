"""What is expected of arrays before any is simulated, and the geometry that a simulation has if
none is named.

From the load follow the f* of a typical array at an a*, how many of its contacts are open, and what
a simulation in the directions of the lattice leaves out. In these directions, the limit of zero
width, a ball between two others in line is held by these two alone. In truth the ball leans on a
third one, with about W/d of the force. The stiffness of a shear spring at that contact goes as the
cube root of its force, so that the spring still adds to the shear modulus; forces, spacings and
normal stiffnesses hardly change. Without shear springs nothing is left out but terms of the order
of the overlap over the diameter, which ``finite_overlap`` names.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from granphon.array.options import LARGEST_RATIO
from granphon.balls.hertz import force_of
from granphon.balls.lattices import LATTICES
from granphon.balls.loads import Load
from granphon.balls.packing import Packing
from granphon.base.arrays import Array
from granphon.media.array_options import reduce_load

#: the geometries of contacts: directions are those of the lattice, or follow from the positions of
#: the balls
LATTICE = "lattice"
EXACT = "exact"
GEOMETRIES = (LATTICE, EXACT)
#: part of the shear modulus up to which the directions of the lattice may leave it out, if no
#: geometry is named
_CHOSEN_LIMIT = 1e-3
#: part of the shear modulus beyond which a simulation in the directions of the lattice is not valid
LEFT_OUT_LIMIT = 1e-2
#: simulated shear moduli with friction are too small by the part A o^3.5 (W/d)^0.3, where o is the
#: fraction of contacts that are open; A by the number of periods. Measured against the true
#: geometry of the same samples (triangular lattice, fcc; o from 0.15 to 0.5, W/d from 1e-7 to
#: 1e-3), to a factor of 1.5; what it is for more, or fewer, open contacts is not known
_DEFICITS = {2: 36.0, 3: 3.7}
#: factor by which more is left out after a history of friction: contacts that are loose at its
#: start bear tangential forces later. It is that of 32 x 32 balls of steel from a* = 1/2, with mu =
#: 0.2 and without sliding, at f* from 0.03 to 0.12
_BY_HISTORY = 3.0
#: exponents of o and W/d
_OPEN_POWER = 3.5
_WIDTH_POWER = 0.3
#: a* of uniform diameters in the plane and in space, between which the f* of loads given as
#: overlaps is interpolated, and f* at each of these a*; on a line the law is that of equal balls
_CURVES = {
    2: (
        np.array([0.345, 0.35, 0.363, 0.42, 0.5, 0.7, 1.0]),
        np.array([5e-5, 2e-4, 8.4e-4, 7.3e-3, 2.55e-2, 0.1163, 0.3678]),
    ),
    3: (
        np.array([0.3357, 0.3607, 0.3941, 0.4377, 0.4935, 0.6557, 0.9289]),
        np.array([3e-3, 5.33e-3, 9.49e-3, 1.69e-2, 3e-2, 9.49e-2, 0.3]),
    ),
}
#: lattices on which the fraction of open contacts was measured: triangular 48 x 48 balls, fcc and
#: hcp 10 diameters wide
_MEASURED_LATTICES = ("triangular", "fcc", "hcp")
#: f* at which that fraction is known, and the largest fraction there of 19 distributions (those of
#: tests/benchmarks/accuracy.py), in the plane and in space
_OPEN_FORCES = np.array([0.003, 0.01, 0.02, 0.03, 0.05, 0.08, 0.12, 0.18, 0.27, 0.4, 0.6, 0.9])
_OPEN_CONTACTS = {
    2: np.array([0.485, 0.387, 0.318, 0.266, 0.202, 0.137, 0.086, 0.047, 0.024, 0.007, 0.0, 0.0]),
    3: np.array([0.64, 0.536, 0.446, 0.386, 0.304, 0.208, 0.132, 0.069, 0.035, 0.012, 0.002, 0.0]),
}


def estimate_reduced_force(packing: Packing, load: Load) -> Array:
    """Return the approximate f* (n,) of each value of an applied load on balls that differ. At
    overlaps below the least a* of :data:`_CURVES` it is the f* of that a*; at overlaps above the
    greatest, and on a line, it is that of equal balls.
    """
    reduced_load = np.ravel(reduce_load(packing, load))  # f*, or a* of an overlap
    if load.kind != "overlap":
        return reduced_load
    # in units of W the overlap is a* - 1/2
    force_of_equal_balls = np.asarray(force_of(reduced_load - 0.5))
    if packing.structure.periods not in _CURVES:
        return force_of_equal_balls
    spacings, forces = _CURVES[packing.structure.periods]
    log_spacing = np.log(np.maximum(reduced_load, spacings[0]))
    interpolated_force = np.exp(np.interp(log_spacing, np.log(spacings), np.log(forces)))
    return np.where(reduced_load > spacings[-1], force_of_equal_balls, interpolated_force)


def estimate_open_contacts(packing: Packing, load: Load) -> Array:
    """Return the approximate fraction of open contacts (n,) at each value of an applied load,
    rather too large than too small.

    The fraction is known on the triangular lattice, in fcc and in hcp, at reduced forces f* of at
    least 0.003; at smaller forces it is taken to be 1. Any other lattice is compared with the known
    lattice of as many periods: the fraction is taken to be 1 at loads at which the known lattice
    has open contacts, and 0 at higher loads. It is zero for equal balls and on a line.
    """
    structure = packing.structure
    if structure.periods not in _OPEN_CONTACTS or not packing.spread_matters:
        return np.zeros(load.size)
    # a load may be beyond the floating range, where no contact is open; a load that no array bears
    # is refused elsewhere
    with np.errstate(all="ignore"):
        log_force = np.log(estimate_reduced_force(packing, load))
    open_fraction: Array = np.interp(
        log_force, np.log(_OPEN_FORCES), _OPEN_CONTACTS[structure.periods], left=1.0
    )
    has_measured_name = structure.name in _MEASURED_LATTICES
    if has_measured_name and LATTICES[structure.name] == structure:
        return open_fraction
    return np.where(open_fraction > 0.0, 1.0, 0.0)


def estimate_shear_deficit(
    contact_fraction: ArrayLike, ratio: float, periods: int, is_loaded: bool = False
) -> Array:
    """Return the part, at most 1, by which the shear modulus of an array with friction is expected
    to be too small if its contacts have the directions of the lattice, the limit W/d = 0. The part
    has the shape of ``contact_fraction``.

    Parameters
    ----------
    contact_fraction : fraction of contacts that carry load.
    ratio : W/d.
    periods : of the lattice, 2 or 3; contacts on a line do not shear.
    is_loaded : whether the array has been loaded with friction; otherwise it is at rest without
        friction.
    """
    amplitude = _DEFICITS[periods] * (_BY_HISTORY if is_loaded else 1.0)
    open_fraction = 1.0 - np.asarray(contact_fraction)
    deficit = amplitude * open_fraction**_OPEN_POWER * ratio**_WIDTH_POWER
    return np.asarray(np.minimum(deficit, 1.0))


def expect_shear_deficit(
    packing: Packing, load: Load, is_loaded: bool = False, ratio: float | None = None
) -> Array:
    """Return the part of the shear modulus that :func:`estimate_shear_deficit` gives, (n,) at each
    value of an applied load, for the expected fraction of open contacts: nothing is simulated.

    ``is_loaded`` says whether the array is loaded with friction. ``ratio`` is W/d, by default that
    of the packing. The part is zero for balls that resist no slip, for equal balls and on a line.
    """
    if not (packing.mindlin_ratio and packing.spread_matters):
        return np.zeros(load.size)
    contact_fraction = 1.0 - estimate_open_contacts(packing, load)
    ratio = packing.relative_width if ratio is None else ratio
    return estimate_shear_deficit(contact_fraction, ratio, packing.structure.periods, is_loaded)


def find_left_out(deficit: Array, geometry: str | None) -> Array:
    """Return the part (n,) of the shear modulus that arrays with a ``geometry`` leave out.

    ``deficit`` (n,) is the part that they leave out in the directions of the lattice; nothing is
    left out in the exact geometry. If no geometry is named (None), the exact one is chosen where
    the deficit is above :data:`_CHOSEN_LIMIT`.
    """
    if geometry == EXACT:
        return np.zeros_like(deficit)
    if geometry == LATTICE:
        return deficit
    return np.where(deficit > _CHOSEN_LIMIT, 0.0, deficit)


def can_be_exact(packing: Packing) -> bool:
    """Return whether a simulation of these balls may have the exact geometry: their diameters
    differ, they are not on a line, and the width W is a fifth of the diameter or less.
    """
    return packing.spread_matters and packing.width <= LARGEST_RATIO * packing.diameter


def choose_geometries(
    packing: Packing, load: Load, finite_overlap: bool | None = None
) -> list[str]:
    """Return the geometry, :data:`LATTICE` or :data:`EXACT`, that an array at rest without friction
    has at each of the n values of an applied load, a list of n, if the user names no geometry.

    If ``finite_overlap`` is given, it decides: with True all values are exact, with False none. If
    not, balls that cannot be exact (:func:`can_be_exact`) have LATTICE. Other balls have LATTICE at
    the values where the directions of the lattice are expected to leave out 1e-3 of the shear
    modulus or less (other results lose less), and EXACT at the others.
    """
    if finite_overlap is not None or not can_be_exact(packing):
        is_exact = np.full(load.size, bool(finite_overlap))
    else:
        is_exact = expect_shear_deficit(packing, load) > _CHOSEN_LIMIT
    return [EXACT if exact else LATTICE for exact in is_exact]
