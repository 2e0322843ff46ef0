"""Configurations of an array of balls that roll and slip: the overlaps and slips of its contacts,
and what contacts exert, in the directions of the lattice or in the true ones.

Units are those of :mod:`granphon.array.geometry`. The formulas, and the loops over contacts, are
those of :mod:`granphon.contacts.slips`. There are n balls, b in each cell, with m motions each.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import DTypeLike, NDArray

from granphon.array.contact_lists import find_grid
from granphon.array.geometry import find_unevenness, require_small, shrink_boundary
from granphon.array.stencils import Stencils
from granphon.balls.neighbours import contact_frames
from granphon.base.arrays import Array
from granphon.contacts import slips
from granphon.contacts.friction import Configuration, RollingContacts, Tangent, by_contact
from granphon.contacts.grid_product import GridProduct, invert_blocks, multiply_pressed
from granphon.contacts.rolling_tangent import TangentBlocks, fill_tangent
from granphon.contacts.slips import measure_slips


class PressedGeometry:
    """Contacts of an array of balls with rotations.

    Parameters
    ----------
    stencils : stencils of the array, of contacts that resist slip.
    deviations : (L1, ..., Lp) or, with b > 1 balls in a cell, (b, L1, ..., Lp), x of the balls.
    ratio : eps = W/d in the true geometry; zero if contacts keep the directions of the lattice.

    Raises
    ------
    InputError : a ratio that is not from zero to :data:`~granphon.array.options.LARGEST_RATIO`.
    """

    def __init__(self, stencils: Stencils, deviations: Array, ratio: float = 0.0) -> None:
        require_small(ratio)
        self.stencils = stencils
        self.ratio = ratio
        means = stencils.average_pairs(deviations)
        lattice = stencils.lattice
        grid = find_grid(stencils.shape, lattice)
        _, tangent, _ = contact_frames(lattice.contacts.normal[:, : lattice.periods])
        tangents = np.stack(tangent, axis=1)
        #: the list of the contacts
        self.contacts = RollingContacts(
            # copies: loops are compiled anew for read-only arrays, as those of the grid are
            i=grid.i.copy(),
            j=grid.j.copy(),
            normal=grid.normal.copy(),
            tangent=np.repeat(tangents, math.prod(stencils.shape), axis=0),
            offset=means.ravel(),
            uneven=np.ravel(find_unevenness(stencils, deviations, ratio)),
            ratio=float(ratio),
        )
        #: (p, p) matrix that takes the coordinates of displacements to the axes of space
        self.axes = np.ascontiguousarray(np.linalg.inv(stencils.basis), float)
        #: (contacts,) distances of centres, over the diameter, where contacts keep their directions
        self._distance = np.ones(means.size)

    @cached_property
    def product(self) -> GridProduct:
        """The contacts as loops that multiply tangents read them, with empty blocks."""
        return GridProduct.of(self.contacts.i, self.contacts.j, self.stencils.shape)

    def place(self, balls: Array, overlap: float) -> PressedPlace:
        """Return the configuration with the motions ``balls`` (fields, L1, ..., Lp) and the
        ``overlap`` y.
        """
        return PressedPlace(self, balls, overlap)

    def begin(self, balls: Array, overlap: float) -> tuple[Array, Array]:
        """Return the overlaps (n_c, L1, ..., Lp) and the slips (n_s, n_c, L1, ..., Lp) with which a
        history begins, at the motions ``balls`` (fields, L1, ..., Lp) and the ``overlap`` y.

        If contacts keep their directions, slips are those since balls were on their sites. If
        contacts turn, slips are zero: those of the history are counted from these motions.
        """
        place = self.place(balls, overlap)
        return place.overlaps, place.find_slips(place, np.zeros(self.slip_shape))

    @property
    def slip_shape(self) -> tuple[int, ...]:
        """Shape (n_s, n_c, L1, ..., Lp) of slips."""
        stencils = self.stencils
        return (len(stencils.shape) - 1, stencils.n_contacts, *stencils.shape)

    def list_motions(self, balls: Array) -> tuple[Array, Array]:
        """Return the displacements (n, 3), in W, and the rotations (n, 3), in W/d, of balls along
        the axes of space, from their motions ``balls`` (fields, L1, ..., Lp).
        """
        fields = balls.reshape(self.stencils.n_balls, self.stencils.motions.count, -1)
        displacement, rotation = np.zeros((2, fields.shape[0] * fields.shape[2], 3))
        slips.list_motions(fields, self.axes, displacement, rotation)
        return displacement, rotation

    def collect_forces(self, force: Array, torque: Array) -> Array:
        """Return the forces (fields, L1, ..., Lp) that do work on the motions of balls, from
        ``force`` and ``torque`` (n, 3) along the axes of space.
        """
        stencils = self.stencils
        fields = np.empty((stencils.n_balls, stencils.motions.count, *stencils.shape))
        by_ball = fields.reshape(*fields.shape[:2], -1)
        slips.collect_forces(force, torque, self.axes, by_ball)
        return fields.reshape(stencils.n_fields, *stencils.shape)

    def measure(self, balls: Array, overlap: float) -> tuple[Configuration, Array, Array | None]:
        """Return where balls and contacts are at the motions ``balls`` (fields, L1, ..., Lp) and
        the ``overlap`` y; the overlaps (contacts,); and the slips (n_s, contacts).

        If contacts turn, the slips are None: they depend on the way to these motions.
        """
        contacts = self.contacts
        displacement, rotation = self.list_motions(balls)
        overlaps = np.empty(contacts.offset.size)
        n_slips = len(self.stencils.shape) - 1
        if not self.ratio:
            frames = (contacts.normal, contacts.tangent, self._distance)
            at = Configuration(overlap, displacement, rotation, *frames)
            new_slips = np.empty((n_slips, overlaps.size))
            slips.measure_straight(contacts, at, overlaps, new_slips)
            return at, overlaps, new_slips
        normal, tangent = np.empty((2, overlaps.size, 3))
        distance = np.empty(overlaps.size)
        at = Configuration(overlap, displacement, rotation, normal, tangent, distance)
        slips.measure_turned(contacts, at, n_slips == 1, overlaps)
        return at, overlaps, None


class PressedPlace:
    """Configuration of an array of balls that roll and slip.

    Attributes
    ----------
    geometry : the array.
    balls : (fields, L1, ..., Lp) displacements and rotations.
    overlap : y.
    overlaps : (n_c, L1, ..., Lp) overlaps h of the contacts.
    configuration : what loops over contacts read.
    """

    def __init__(self, geometry: PressedGeometry, balls: Array, overlap: float) -> None:
        self.geometry = geometry
        self.balls = balls
        self.overlap = overlap
        self.configuration, overlaps, slips = geometry.measure(balls, float(overlap))
        self.overlaps = overlaps.reshape(geometry.slip_shape[1:])
        self._slips = None if slips is None else slips.reshape(geometry.slip_shape)

    def find_slips(self, before: PressedPlace, slips: Array) -> Array:
        """Return the slips (n_s, n_c, L1, ..., Lp) of contacts after a step from the configuration
        ``before``, in which slips are ``slips`` (n_s, n_c, L1, ..., Lp).

        If contacts keep their directions, slips follow from the motions alone, and neither argument
        is used.
        """
        if self._slips is not None:
            return self._slips
        new_slips = slips.copy(order="C")
        flat_slips = new_slips.reshape(len(new_slips), -1)
        contacts = self.geometry.contacts
        measure_slips(contacts, before.configuration, self.configuration, flat_slips)
        return new_slips

    def push(self, forces: Array, shears: Array) -> tuple[Array, Array]:
        """Return the forces (n, 3) and the torques (n, 3) on balls, along the axes of space, by
        the normal ``forces`` f (n_c, L1, ..., Lp) and the tangential forces T of contacts, whose
        components are ``shears`` (n_s, n_c, L1, ..., Lp).
        """
        configuration = self.configuration
        force, torque = np.zeros((2, *configuration.displacement.shape))
        tangential = by_contact(shears, len(shears))
        slips.add_forces(
            self.geometry.contacts, configuration, by_contact(forces), tangential, force, torque
        )
        return force, torque

    def pull(self, forces: Array, shears: Array) -> Array:
        """Return the forces and torques of :meth:`push` in the coordinates of motions, (fields, L1,
        ..., Lp).
        """
        return self.geometry.collect_forces(*self.push(forces, shears))

    def turn(self, shears: Array) -> Array:
        """Return the vectors (contacts, 3), along the axes of space, of tangential forces whose
        components along the n_s tangents of each contact are ``shears`` (n_s, n_c, L1, ..., Lp).
        """
        vectors = np.empty_like(self.configuration.normal)
        slips.set_shear_vectors(self.configuration, by_contact(shears, len(shears)), vectors)
        return vectors

    @property
    def boundary(self) -> float:
        """Size of the boundary of the cell, over that at y = 0."""
        return shrink_boundary(self.geometry.ratio, self.overlap, len(self.geometry.stencils.shape))

    def press(self, forces: Array, shears: Array) -> float:
        """Return the force per contact that does the work of the load as y grows: the mean of (f n
        - T).e over contacts. If contacts keep their directions, it is the mean of f.

        ``forces`` (n_c, L1, ..., Lp) are the normal forces f, and ``shears`` (n_s, n_c, L1, ...,
        Lp) the components of the tangential forces T.
        """
        if not self.geometry.ratio:
            return float(np.mean(forces))
        works = slips.sum_works(
            self.geometry.contacts,
            self.configuration,
            by_contact(forces),
            by_contact(shears, len(shears)),
        )
        return works / forces.size

    def linearise(
        self,
        tangent: Tangent,
        forces: Array,
        shears: Array,
        precision: DTypeLike = np.float32,
        is_free: bool = True,
    ) -> PressedTangent:
        """Return what resists small motions, in a ``precision``: minus the changes of the forces of
        :meth:`pull`, and the changes of the sum of the normal forces.

        The changes follow from the ``tangent`` of the law of friction. If contacts turn, they also
        follow from the forces that act: the normal ``forces`` (n_c, L1, ..., Lp) and the tangential
        ones, ``shears`` (n_s, n_c, L1, ..., Lp). ``is_free`` says whether the overlap y is a
        motion too; otherwise it is held.
        """
        geometry = self.geometry
        stencils = geometry.stencils
        balls = len(self.configuration.displacement)
        m = stencils.motions.count
        diagonal = np.zeros((m, m, balls))
        forward, backward = np.empty((2, m, m, len(geometry.contacts.i)), precision)
        ahead, back = np.zeros((2, m, balls if is_free else 0))
        corner = fill_tangent(
            geometry.contacts,
            self.configuration,
            tangent.flatten(),
            by_contact(forces),
            by_contact(shears, len(shears)),
            geometry.axes,
            TangentBlocks(diagonal, forward, backward, ahead, back),
        )
        return PressedTangent(
            geometry.product.fill(diagonal.astype(precision), forward, backward),
            diagonal,
            ahead.astype(precision),
            back.astype(precision),
            corner,
        )


@dataclass(frozen=True, eq=False)
class PressedTangent:
    """What resists small motions: minus the changes of the forces on balls, and the changes of the
    sum of the normal forces of contacts.

    Attributes
    ----------
    product : blocks of forces on balls against motions of balls, with the overlap held.
    diagonal : (m, m, n) the blocks of each ball and its own motions, in double precision.
    ahead : (m, n) forces on balls against a unit of the overlap; (m, 0) if the overlap is held.
    back : (m, n) the change of the sum by each motion; (m, 0) if the overlap is held.
    corner : the change of the sum by a unit of the overlap.
    """

    product: GridProduct
    diagonal: Array
    ahead: NDArray[Any]
    back: NDArray[Any]
    corner: float

    def resist(self, balls: NDArray[Any], press: float, forces: NDArray[Any]) -> float:
        """Set ``forces`` to minus the changes of forces on balls by motions ``balls`` and by a
        change ``press`` of the overlap y. Both arrays are (fields, L1, ..., Lp) or flat, in the
        precision of the tangent.

        Return the change of the sum of the normal forces. If the overlap is held, ``press``
        is not read, and zero is returned.
        """
        fields = (-1, 1, len(self.product.places))
        return multiply_pressed(
            self.product,
            self.ahead,
            self.back,
            self.corner,
            balls.reshape(fields),
            balls.dtype.type(press),
            forces.reshape(fields),
        )

    def invert_blocks_of_balls(self, spring: float) -> NDArray[Any]:
        """Return the inverses (m, m, n) of the blocks :attr:`diagonal`, in the precision of
        ``product``. The stiffness ``spring`` is first added to the diagonal of each block.
        """
        inverses = np.empty_like(self.product.diagonal)
        invert_blocks(self.diagonal, spring, 1.0, inverses)
        return inverses
