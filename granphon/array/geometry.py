"""Where the contacts of an array are in its true geometry. In the geometry of the lattice, the
limit of small spread, contacts are those of a grid (:mod:`granphon.contacts.grid`).

Units are those of :mod:`granphon.array.equilibrium`: displacements u in W; rotations phi in W/d;
lengths of the lattice in d. In the limit contacts keep the directions e of the lattice, and
overlaps h are linear: h = y + (x_i + x_j)/2 - e.(u_j - u_i), where x is the deviation (D - d)/W of
the diameter D of a ball from the mean.

In the true geometry directions, arms and overlaps follow from the positions of balls. A load
compresses the cell evenly, by the factor 1 - eps y with eps = W/d and y = (d - a)/W, where a is the
spacing of the lattice in the compressed cell. A contact whose direction on the lattice is e then
has the vector from centre to centre

    w = e + eps v,    v = u_j - u_i - y e

and the overlap

    h = (x_i + x_j)/2 - q,    q = (|w| - 1)/eps,

which the loops over contacts measure (:mod:`granphon.contacts.deformation`). The balls touch at the
distances |w|/2 -+ eps (x_j - x_i)/4 from the centres of ball i and ball j: each is the radius less
half of the overlap. The two distances add up to |w|, so that forces exert no torque on a pair. How
contacts slip is said in :mod:`granphon.contacts.slips`.

For eps = 0 all this is the linear map of the lattice. In both geometries the coefficient of Hertz's
law is that of the mean ball for all contacts: the radii of the two balls would change it by a part
of order eps.

A place is a configuration of an array: the motion of its balls, and where its contacts then are.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Protocol

import numpy as np

from granphon.array.options import LARGEST_RATIO, ReducedLoad
from granphon.array.stencils import OPTIONS, Stencils
from granphon.base.arrays import Array
from granphon.base.errors import InputError
from granphon.contacts.deformation import measure_along, measure_bends, measure_turned
from granphon.contacts.grid import find_lattice_grid

#: fraction by which Newton's method may miss a given mean force, both with friction and in the true
#: geometry
LOAD_TOLERANCE = OPTIONS.negligible_force


def require_small(ratio: float) -> None:
    """Raise :class:`~granphon.base.errors.InputError` unless the ``ratio`` W/d is from zero to
    :data:`LARGEST_RATIO`.
    """
    if not 0.0 <= ratio <= LARGEST_RATIO:
        problem = f"the exact geometry is not simulated of a width of {ratio:.9g} diameters"
        why = (
            "Contacts are those of neighbours on the lattice: of balls that differ much, others"
            " touch"
        )
        raise InputError(problem, why, f"Give a width from zero to {LARGEST_RATIO:g} diameters")


class ExactPlace:
    """Configuration of an array in its true geometry; d is the mean diameter of its balls.

    Parameters
    ----------
    stencils : stencils of the array without rotations, whose lattice has as many periods as
        dimensions.
    deviations : (L1, ..., Lp) or, with n balls in a cell, (n, L1, ..., Lp), x of the balls.
    ratio : eps = W/d. If it is zero, contacts keep their directions, and displacements count as
        small beside the diameter.
    balls : (n p, L1, ..., Lp) displacements in W, in the coordinates of the stencils.
    overlap : y.
    strain : (p, p) strain of the cell in units of W/d, added to the even one by y; None if there is
        no other.

    Attributes
    ----------
    vector : (contacts, 3) from centre to centre, in d, along the axes of space.
    normal : (contacts, 3) unit vectors n.
    size : (n_c, L1, ..., Lp) distances |w| of the centres, in d.
    uneven : (n_c, L1, ..., Lp) half of the difference of the radii of ball j and ball i, in d.
    differences : (n_c, L1, ..., Lp) differences h - y.
    overlaps : (n_c, L1, ..., Lp) overlaps h.

    Raises
    ------
    InputError : a ratio that is not from zero to :data:`LARGEST_RATIO`.
    """

    def __init__(
        self,
        stencils: Stencils,
        deviations: Array,
        ratio: float,
        balls: Array,
        overlap: float,
        strain: Array | None = None,
    ) -> None:
        require_small(ratio)
        self.stencils = stencils
        self.ratio = ratio
        self.strain = strain
        self.overlap = overlap
        self.uneven = find_unevenness(stencils, deviations, ratio)
        self._measure(stencils.average_pairs(deviations), balls)

    def _measure(self, means: Array, balls: Array) -> None:
        """Set the attributes over contacts but for ``uneven``, from the ``means`` (n_c, L1, ...,
        Lp) of x over the balls of each contact and the displacements ``balls`` (n p, L1, ..., Lp).
        """
        p = self.stencils.lattice.dimension
        grid = find_lattice_grid(self.stencils.shape, self.stencils.lattice)
        # vectors at touch are those of the evenly compressed cell: what contacts lose of their
        # overlaps then has no part y, from which digits would be lost in a subtraction
        spacing = 1.0 - self.ratio * self.overlap
        # where contacts keep their directions, displacements are not scaled: loops measure losses
        # of overlap in W, for which the length of contacts does not matter
        unit = self.ratio or 1.0
        is_flat = np.full(means.size, not self.ratio)
        vector = np.repeat(spacing * grid.vector, grid.n_cells, axis=0)
        displacement = np.zeros((grid.n_balls * grid.n_cells, 3))
        displacement[:, :p] = unit * list_displacements(self.stencils, balls)
        strain = np.zeros((3, 3))
        if self.strain is not None:
            strain[:p, :p] = unit / spacing * self.strain
        turned = measure_turned(*grid.ends, vector, is_flat, displacement, strain)
        self.vector = turned.current
        self.normal = turned.normal
        self.size = turned.distance.reshape(means.shape)
        self.differences = means - turned.loss.reshape(means.shape) / unit
        self.overlaps = self.overlap + self.differences

    @property
    def direction(self) -> Array:
        """(contacts, 3) unit vectors e of contacts on the lattice. They are made anew whenever they
        are asked for: the array takes much memory.
        """
        grid = find_lattice_grid(self.stencils.shape, self.stencils.lattice)
        return np.repeat(grid.normal, grid.n_cells, axis=0)

    @property
    def boundary(self) -> float:
        """Size of the boundary of the cell, over that at y = 0."""
        return shrink_boundary(self.ratio, self.overlap, len(self.stencils.shape))

    def press(self, forces: Array) -> float:
        """Return the force per contact, in c W^(3/2), that does the work of the load as y grows:
        the mean of f n.e over contacts, with the normal forces f, ``forces`` (n_c, L1, ..., Lp).
        """
        return float(np.mean(forces * self.lose(self.direction)))

    def press_sheared(self, forces: Array) -> float:
        """Return the mean contact force, in c W^(3/2), that has the same pressure in a cell that
        keeps its size; the cell of this configuration may have sheared.

        It is the mean of f |w| over contacts, divided by the size of the cell over that at y = 0;
        ``forces`` (n_c, L1, ..., Lp) are the normal forces f.
        """
        size = (1.0 - self.ratio * self.overlap) ** len(self.stencils.shape)
        return float(np.mean(forces * self.size)) / size

    def lose(self, displacements: Array) -> Array:
        """Return the losses (n_c, L1, ..., Lp) of overlap by small ``displacements`` (contacts, 3)
        of balls j against balls i.
        """
        loss = np.empty(len(displacements))
        measure_along(displacements, np.zeros(len(displacements)), self.normal, loss)
        return loss.reshape(self.size.shape)

    def curve(
        self, velocities: Array, forces: Array, stiffness: Array, slope: Array
    ) -> tuple[Array, Array]:
        """Return the second derivatives (n_c, L1, ..., Lp) of the overlaps, and (contacts, 3) of
        the forces f n, with respect to a parameter s along which balls move on straight lines.

        ``velocities`` (contacts, 3) are the derivatives with respect to s of the displacements of
        balls j against balls i, in W; ``forces`` f, ``stiffness`` df/dh and ``slope`` d^2f/dh^2 are
        (n_c, L1, ..., Lp).
        """
        bend = np.empty(len(velocities))
        push = np.empty_like(velocities)
        # in 1/W, as displacements are in W; zero if contacts keep their directions
        over_distance = self.ratio / self.size.ravel()
        law = (forces.ravel(), stiffness.ravel(), slope.ravel())
        measure_bends(self.normal, over_distance, velocities, *law, bend, push)
        return bend.reshape(self.size.shape), push


def find_unevenness(stencils: Stencils, deviations: Array, ratio: float) -> Array:
    """Return eps (x_j - x_i)/4 (n_c, L1, ..., Lp): half of the difference of the radii of ball j
    and ball i of each contact, over the mean diameter.

    ``deviations`` (L1, ..., Lp) or, with n balls in a cell, (n, L1, ..., Lp) are x of the balls,
    and ``ratio`` is eps = W/d.
    """
    by_ball = stencils.by_ball(deviations)
    deviations_i = np.stack([by_ball[i] for i, _ in stencils.ends])
    # (x_i + x_j)/2 - x_i is (x_j - x_i)/2
    return np.asarray(0.5 * ratio * (stencils.average_pairs(deviations) - deviations_i))


def list_displacements(stencils: Stencils, balls: Array) -> Array:
    """Return displacements (n cells, p) of balls along the axes of space. ``balls`` (n p, L1, ...,
    Lp) are the same displacements in the coordinates of the stencils, of n balls in a cell.
    """
    p = stencils.lattice.dimension
    return stencils.displacements(balls).reshape(p, -1).T


def shrink_boundary(ratio: float, overlap: float, periods: int) -> float:
    """Return (1 - eps y)^(p - 1): the size of the boundary of a cell with p ``periods`` at the
    ``overlap`` y, over that at y = 0. The ``ratio`` is eps = W/d.
    """
    return (1.0 - ratio * overlap) ** (periods - 1)


class LoadedPlace(Protocol):
    """Any configuration of an array that knows the size of its boundary, and the force of the load
    that belongs to forces of its contacts.
    """

    @property
    def boundary(self) -> float:
        """Size of the boundary of the cell, over that at y = 0."""

    @property
    def press(self) -> Callable[..., float]:
        """Function of the forces of contacts that returns the force per contact that does the work
        of the load as y grows.
        """


def find_boundary_force(place: LoadedPlace, *forces: Array) -> float:
    """Return the mean contact force f*, in c W^(3/2), that has the same pressure in a cell that
    keeps its size as ``forces`` have in the configuration ``place``.

    ``forces`` are the normal forces (n_c, L1, ..., Lp) of contacts; with friction, a second array
    has the tangential forces (n_s, n_c, L1, ..., Lp).
    """
    # where the cell has sheared, the work of an even strain is not that along the lattice
    if isinstance(place, ExactPlace) and place.strain is not None:
        return place.press_sheared(*forces)
    return place.press(*forces) / place.boundary


def find_lack(load: ReducedLoad, place: LoadedPlace, *forces: Array) -> float:
    """Return by how much a force is less than the ``load`` prescribes, in c W^(3/2); zero if the
    load is an overlap.

    If the load is on the boundary, this force is that per contact which does the work of the load;
    otherwise it is the mean contact force. ``forces`` are those of :func:`find_boundary_force`.
    """
    if load.overlap is not None:
        return 0.0
    if load.on_boundary:
        return load.force * place.boundary - place.press(*forces)
    return load.force - float(np.mean(forces[0]))
