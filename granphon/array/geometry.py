"""Where the contacts of an array are: what a geometry says of them, and that of the lattice, the limit of small spread.

Units are those of :mod:`granphon.array.equilibrium`. In the limit contacts keep the directions of the lattice, and all is
linear: h = y + (x_i + x_j)/2 - e.(u_j - u_i), and slips are those of :class:`~granphon.array.stencils.Stencils`. The true
geometry is in :mod:`granphon.array.true_geometry`.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray

from granphon.array.conjugate_gradients import solve_for_motion
from granphon.array.contact_operator import ContactHessian
from granphon.array.friction import Tangent
from granphon.array.residuals import Single
from granphon.array.stencils import Motion, Stencils
from granphon.array.steps import ReducedLoad

Array = NDArray[np.float64]
#: changes of forces (-df, dT) that follow from a loss of overlap -dh and a slip ds
Law = Callable[[Array, Array], tuple[Array, Array]]
#: changes of the forces on balls and of the sum of forces, times -1, by a motion of balls and a change of y; without one, y
#: is held and the sum is not asked for
Product = Callable[[Single, float | None], tuple[Single, float]]
#: approximate inverse of C^T K C
Inverse = Callable[[Array], Array]


class Place(Protocol):
    """Configuration of an array: the motion of its balls, and where that leaves the contacts.

    Attributes
    ----------
    balls : (fields, L1, ..., Lp) displacements and rotations.
    overlap : y.
    overlaps : (n_c, L1, ..., Lp) overlaps h of the contacts.
    """

    balls: Array
    overlap: float

    @property
    def overlaps(self) -> Array:
        """(n_c, L1, ..., Lp) overlaps h of the contacts."""

    def slips(self, before: Place, slips: Array) -> Array:
        """Return (n_s, n_c, L1, ..., Lp) slips s here, if they are ``slips`` in the configuration ``before``."""

    def losses(self, motion: Motion) -> Array:
        """Return (n_c, L1, ..., Lp) losses of overlap by a small motion."""

    def pull(self, forces: Array, shears: Array) -> Array:
        """Return the forces on balls (fields, L1, ..., Lp) by normal forces f of contacts, and tangential ones T."""

    @property
    def boundary(self) -> float:
        """Size of the cell's boundary, over that with y = 0."""

    def press(self, forces: Array, shears: Array) -> float:
        """Return the force whose work on dy is that of the load: a mean over contacts."""

    def linearise(self, tangent: Tangent, forces: Array, shears: Array) -> Product:
        """Return the changes of :meth:`pull` and of the sum of forces by small motions in single precision, both times -1.

        They follow from the ``tangent`` of the law of friction; ``forces`` and ``shears`` are those that act here: they turn
        with their contacts.
        """


class Geometry(Protocol):
    """Geometry of an array of balls; ``ratio`` is eps = W/d, zero in the limit of small spread."""

    stencils: Stencils
    ratio: float

    def place(self, balls: Array, overlap: float) -> Place:
        """Return the configuration with these motions ``balls`` and the overlap y."""

    def weigh(self, stiffness: Array, forces: Array) -> Array:
        """Return (rows, L1, ..., Lp) stiffnesses for a preconditioner, from those of contacts and the forces that act."""

    def begin(self, balls: Array, overlap: float) -> tuple[Array, Array]:
        """Return the overlaps and slips of contacts at the beginning of a history."""

    def solve(
        self, place: Any, stiffness: Array, forces: Array, right: Motion, inverse: Inverse, reduction: float, free: bool
    ) -> tuple[Motion, int]:
        """Solve for a small motion that takes forces on balls away, without friction.

        The error falls by ``reduction``. ``forces`` act here, and turn with their contacts. If ``free`` is true, the
        compression is an unknown too. Returns the motion and the number of iterations. The stiffness by which forces push
        balls aside is taken with the other sign, so that there is always a solution.
        """


class LatticeGeometry:
    """Geometry of contacts that keep the directions of the lattice: the limit of spread and overlap small against d."""

    ratio = 0.0

    def __init__(self, stencils: Stencils, deviations: Array) -> None:
        self.stencils, self.means = stencils, stencils.average_pairs(deviations)

    def place(self, balls: Array, overlap: float) -> LatticePlace:
        """Return the configuration with these motions ``balls`` and the overlap y."""
        return LatticePlace(self, balls, overlap)

    def weigh(self, stiffness: Array, forces: Array) -> Array:
        """Return ``stiffness`` itself."""
        return stiffness

    def begin(self, balls: Array, overlap: float) -> tuple[Array, Array]:
        """Return the overlaps of contacts, and their slips from the sites."""
        place = self.place(balls, overlap)
        return place.overlaps, place.slips(place, place.overlaps)

    def solve(
        self, place: LatticePlace, stiffness: Array, forces: Array, right: Motion, inverse: Inverse, reduction: float,
        free: bool,
    ) -> tuple[Motion, int]:  # fmt: skip
        """Solve C^T K C u = ``right``; see :class:`Geometry`."""
        mean = float(np.mean(stiffness)) if free else None
        return solve_for_motion(self.stencils.hessian(stiffness), right, inverse, reduction, mean)


class LatticePlace:
    """Configuration of an array in its :class:`LatticeGeometry`."""

    boundary = 1.0

    def __init__(self, geometry: LatticeGeometry, balls: Array, overlap: float) -> None:
        self._stencils, self.balls, self.overlap = geometry.stencils, balls, overlap
        stencils, n = self._stencils, self._stencils.n_contacts
        rows = stencils.operator.deform(balls)
        self.overlaps = overlap + geometry.means - rows[:n]
        self._slips = rows[n:].reshape(-1, *self.overlaps.shape)

    def slips(self, before: Place, slips: Array) -> Array:
        """Return (n_s, n_c, L1, ..., Lp) slips from the sites."""
        return self._slips

    def losses(self, motion: Motion) -> Array:
        """Return (n_c, L1, ..., Lp) losses of overlap by a small motion."""
        return self._stencils.deformations(motion)[: self._stencils.n_contacts]

    def pull(self, forces: Array, shears: Array) -> Array:
        """Return the forces on balls."""
        return self._stencils.forces(forces, *-shears)

    def press(self, forces: Array, shears: Array) -> float:
        """Return the mean normal force."""
        return float(np.mean(forces))

    def linearise(self, tangent: Tangent, forces: Array, shears: Array) -> Product:
        """Return the changes of forces by motions in single precision, times -1; nothing turns."""
        return multiply(self._stencils, tangent)


def find_boundary_force(place: Place, forces: Array, shears: Array) -> float:
    """Return the mean contact force f* at which the pressure is the same where the cell keeps its size."""
    return place.press(forces, shears) / place.boundary


def find_lack(load: ReducedLoad, place: Place, forces: Array, shears: Array) -> float:
    """Return what the mean contact force lacks to a load; zero at a given overlap."""
    if load.overlap is not None:
        return 0.0
    if load.on_boundary:
        return load.force * place.boundary - place.press(forces, shears)
    return load.force - float(np.mean(forces))


def multiply(stencils: Stencils, tangent: Tangent) -> Product:
    """Return the product of C^T D C, D being the ``tangent`` of the law of friction, with motions in single precision."""
    coupling = {(1 + slip, 0): -one for slip, one in enumerate(tangent.coupling)}
    for one in -tangent.cross:
        coupling |= {(1, 2): one, (2, 1): one}
    return ContactHessian(stencils.operator, [tangent.stiffness, *tangent.springs], coupling)
