"""Sensors of force: at a contact, in a wall, and in a ball.

A sensor adds up the normal forces of contacts, each times a weight. At a contact there is one
force, and its weight is one. In a wall the sensor reads the sum of the components of forces along
its axis a: a contact with the normal n has the weight |n.a|. In a ball, such as one with a disc of
piezoelectric ceramic between its halves, the sensor reads the mean of the forces on both halves: a
contact has the weight |n.a|/2. In a chain this is the mean of the two contacts (C. Daraio, V. F.
Nesterenko, E. B. Herbold and S. Jin, Phys. Rev. E 73, 026610 (2006)). The contact of a ball with
its own image beyond a period acts on the ball from both sides, and has twice the weight.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple, Self

import numpy as np
from numpy.typing import NDArray

from granphon.base.arrays import Array, Index
from granphon.base.errors import InputError
from granphon.base.validation import is_whole
from granphon.networks.network import ContactNetwork

#: word by which users name the one flat wall of a network
FLOOR = "floor"
#: word by which users name a plane of balls, or of held bodies
PLANE = "plane"
#: polarisation of the planes of a response for which none is given
DEFAULT_POLARISATION = "longitudinal"
#: component of a normal along a unit vector, as the axis of a sensor, or of a period along an axis,
#: over its length, up to which the component is zero but for rounding
LEAST_COSINE = 1e-9


class Sensor(NamedTuple):
    """A sensor of force.

    Attributes
    ----------
    body : index of the ball or wall with the sensor; at a contact, that of its first body.
    partner : index of the second body of a contact; -1 for a sensor in a ball or wall.
    direction : (3,) unit vector along the axis of the sensor; at a contact it is the normal from
        ``body`` to ``partner``.
    contacts : (k,) indices of the contacts whose normal forces are added up.
    weights : (k,) weights of these forces.
    """

    body: int
    partner: int
    direction: Array
    contacts: Index
    weights: Array


@dataclass(frozen=True, eq=False)
class SensorPlaces:
    """The contacts and bodies of a network in which sensors of force may be.

    Attributes
    ----------
    i, j : (n_c,) indices of the first and the second body of each contact.
    normal : (n_c, 3) unit vectors from the first to the second body.
    moving : (n,) whether each body can move; the others are held.
    walls : the normals (3,) of flat walls, by the indices of the walls.
    """

    i: Index
    j: Index
    normal: Array
    moving: NDArray[np.bool_]
    walls: dict[int, Array]

    @classmethod
    def of(cls, network: ContactNetwork) -> Self:
        """Return the contacts and bodies of a ``network``."""
        walls = {wall: normal for wall, (_, normal) in network.walls.items()}
        return cls(network.i, network.j, network.normal, network.moving, walls)

    def at_contact(self, i: int, j: int) -> Sensor:
        """Return the sensor at the contact of the bodies ``i`` and ``j``, two indices.

        Raises :class:`~granphon.base.errors.InputError` if they have no contact, or several.
        """
        is_joining = ((self.i == i) & (self.j == j)) | ((self.i == j) & (self.j == i))
        contacts = np.flatnonzero(is_joining)
        if not contacts.size:
            raise InputError(f"balls {i} and {j} have no contact", mend="Give two balls that touch")
        if contacts.size > 1:
            raise InputError(
                f"balls {i} and {j} have {contacts.size} contacts",
                mend="Repeat the network, so that balls touch once",
            )
        contact = contacts[0]
        outward = self.normal[contact] if self.i[contact] == i else -self.normal[contact]
        return Sensor(i, j, outward, contacts, np.ones(1))

    def in_body(self, body: int, direction: Array) -> Sensor:
        """Return the sensor in a ``body``, an index of the network, whose axis is the unit vector
        ``direction`` (3,). Weights have the factor 1/2 if the body moves, as it is then a ball; the
        sensor in a body that is held, ball or wall, reads the whole sum.

        Raises :class:`~granphon.base.errors.InputError` for a body without a contact along this
        axis.
        """
        n_ends = (self.i == body).astype(float) + (self.j == body)  # ends of contacts at the body
        contacts = np.flatnonzero(n_ends)
        cosines = np.abs(self.normal[contacts] @ direction)
        is_along = cosines > LEAST_COSINE
        if not np.any(is_along):
            raise InputError(
                f"body {body} has no contact along the direction of the sensor",
                "A sensor adds up the normal forces of the contacts of its ball or wall",
                "Give another body or direction",
            )
        share = 0.5 if self.moving[body] else 1.0
        weights = share * n_ends[contacts] * cosines
        return Sensor(body, -1, direction, contacts[is_along], weights[is_along])

    def in_floor(self) -> Sensor:
        """Return the sensor in the one flat wall, whose axis is the normal of the wall; raises what
        :meth:`find_floor` raises.
        """
        wall = self.find_floor()
        return self.in_body(wall, self.walls[wall])

    def find_floor(self) -> int:
        """Return the index of the one flat wall.

        Raises :class:`~granphon.base.errors.InputError` if there is none, or several.
        """
        if len(self.walls) != 1:
            number = f"{len(self.walls)} floors" if self.walls else "no floor"
            raise InputError(
                f"the network has {number}",
                mend="Give (body, direction), with the number of a wall or of a ball that is held",
            )
        return next(iter(self.walls))


def is_contact(value: Any) -> bool:
    """Return whether the ``value`` of a receiver names a contact: a tuple of two whole numbers, the
    indices of its bodies.
    """
    if not isinstance(value, tuple) or len(value) != 2:
        return False
    return all(map(is_whole, value))


def is_plane(value: Any) -> bool:
    """Whether the ``value`` of a source or receiver is a plane of balls."""
    return isinstance(value, str) and value == PLANE


def find_unused(sources: Sequence[Any], receivers: Sequence[Any], given: Mapping[str, Any]) -> str:
    """Return the name of the first argument ``given`` of planes that has no use for a response
    between ``sources`` and ``receivers``, lists of items; "" if there is none.

    ``given`` has the values of "direction", "polarisation" and "distance" by these names, None for
    one that is not given. A distance is that of a plane that receives; the others are those of any
    plane. The default polarisation counts as not given: scene files of earlier versions hold it.
    """
    is_heard = any(map(is_plane, receivers))
    has_plane = is_heard or any(map(is_plane, sources))
    for name, value in given.items():
        has_use = is_heard if name == "distance" else has_plane
        # a polarisation may also be a vector, which is compared with no word
        is_default_word = (
            name == "polarisation" and isinstance(value, str) and value == DEFAULT_POLARISATION
        )
        is_given = value is not None and not is_default_word
        if is_given and not has_use:
            return name
    return ""


def list_open_axes(network: ContactNetwork) -> list[int]:
    """Return the axes, 0 to 2 for x to z, of the space of a ``network`` along which the network
    does not repeat: those along which no period has a component but for rounding.
    """
    lengths = np.linalg.norm(network.cell, axis=1, keepdims=True)
    is_closed = np.any(np.abs(network.cell) > LEAST_COSINE * lengths, axis=0)
    return [axis for axis in range(network.dimension) if not is_closed[axis]]


def find_open_axis(network: ContactNetwork) -> Array:
    """Return the unit vector (3,) of the first of :func:`list_open_axes` of a ``network``, or of x
    if there is none.
    """
    open_axes = list_open_axes(network)
    axis = open_axes[0] if open_axes else 0
    return np.asarray(np.eye(3)[axis])
