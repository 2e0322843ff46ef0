"""Typical arrays, before any is simulated: their f* at an a* and the reverse, and how many of their contacts are open."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from granphon.balls.lattices import LATTICES
from granphon.balls.loads import Load
from granphon.balls.packing import Packing
from granphon.media.equilibria import reduce_load

Array = NDArray[np.float64]
#: a* of uniform diameters in the plane and in space, between which the f* of loads given as overlaps is interpolated, and f*
#: at each of these a*; on a line the law is that of equal balls
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
#: f* at which the fraction of open contacts is known, and the largest fraction there of 19 distributions (those of
#: tests/benchmarks/accuracy.py), in the plane (triangular, 48 x 48 balls) and in space (fcc and hcp, 10 diameters wide)
_OPEN_FORCES = np.array([0.003, 0.01, 0.02, 0.03, 0.05, 0.08, 0.12, 0.18, 0.27, 0.4, 0.6, 0.9])
_OPEN_CONTACTS = {
    2: np.array([0.485, 0.387, 0.318, 0.266, 0.202, 0.137, 0.086, 0.047, 0.024, 0.007, 0.0, 0.0]),
    3: np.array([0.64, 0.536, 0.446, 0.386, 0.304, 0.208, 0.132, 0.069, 0.035, 0.012, 0.002, 0.0]),
}


def estimate_spacing(packing: Packing, load: Load) -> Array:
    """Return the approximate a* of each value of an applied load."""
    reduced = np.ravel(reduce_load(packing, load))
    return reduced if load.kind == "overlap" else find_spacing(packing, reduced)


def find_spacing(packing: Packing, force: Array) -> Array:
    """Return the approximate a* of reduced forces."""
    hertz = 0.5 + force ** (2.0 / 3.0)
    if packing.structure.periods not in _CURVES:
        return hertz
    known, forces = _CURVES[packing.structure.periods]
    return np.where(force > forces[-1], hertz, np.interp(force, forces, known))


def estimate_reduced_force(packing: Packing, load: Load) -> Array:
    """Return the approximate f* of each value of an applied load."""
    reduced = np.ravel(reduce_load(packing, load))
    return _find_force(packing, reduced) if load.kind == "overlap" else reduced


def _find_force(packing: Packing, spacing: Array) -> Array:
    """Return the approximate f* of reduced spacings."""
    hertz = np.asarray(np.maximum(spacing - 0.5, 0.0) ** 1.5)
    if packing.structure.periods not in _CURVES:
        return hertz
    known, forces = _CURVES[packing.structure.periods]
    near = np.exp(np.interp(np.log(np.maximum(spacing, known[0])), np.log(known), np.log(forces)))
    return np.where(spacing > known[-1], hertz, near)


def estimate_open_contacts(packing: Packing, load: Load) -> Array:
    """Return the approximate fraction of open contacts (n,) at each value of an applied load, rather too many than too few.

    It is known on the triangular lattice, in fcc and in hcp; on another lattice it is 1 where contacts are open on those.
    """
    structure = packing.structure
    with np.errstate(over="ignore"):  # of a load beyond the floating range, at which no contact is open
        force = estimate_reduced_force(packing, load)
    if structure.periods not in _OPEN_CONTACTS or not packing.spread_matters:
        return np.zeros_like(force)
    with np.errstate(all="ignore"):  # a load that no array bears is refused elsewhere
        found: Array = np.interp(np.log(force), np.log(_OPEN_FORCES), _OPEN_CONTACTS[structure.periods])
    if structure.name in ("triangular", "fcc", "hcp") and LATTICES[structure.name] == structure:
        return found
    return np.where(found > 0.0, 1.0, 0.0)
