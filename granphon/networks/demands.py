"""Demands that the entries of the fields of a network must meet, ball by ball and contact by
contact.

A ``network`` is a :class:`~granphon.networks.network.ContactNetwork`, which stands above this
module.
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import numpy as np

from granphon.networks.sources import (
    LARGEST_NUMBER,
    MOST_STEPS,
    UNIT_TOLERANCE,
    are_across,
    span_distance,
)

#: fields with one number for each ball
NUMBERS_OF_BALLS = ("radii", "masses", "inertias")
#: forces and stiffnesses of contacts, and their ranges
_SPRINGS = {
    "normal_force": "zero or above",
    "normal_stiffness": "above zero",
    **dict.fromkeys(("shear_stiffness", "torsion_stiffness", "bending_stiffness"), "zero or above"),
}
#: the name of a field, truth values that say whether each entry of the field meets the demand, the
#: fault of an entry that does not, in words, and words on how to mend the fault, "" for none
_Demand = tuple[str, Any, str, str]
#: what messages say of numbers that are too large, and of products that would be
_SIZE_FAULT = f"that is not finite, or above {LARGEST_NUMBER:g}"
_RANGE_FAULT = (
    f"beyond what can be reckoned with, {1.0 / LARGEST_NUMBER:g} to {LARGEST_NUMBER:g} in SI"
)


def list_demands(network: Any) -> Iterator[_Demand]:
    """Yield the demands on the balls and contacts of a network, see ``_Demand``; the truth values
    are (n,) of balls, or (n_c,) of contacts. A demand may rely on earlier demands being met.
    """
    yield from _list_demands_on_balls(network)
    yield from _list_demands_on_ends(network)
    yield from _list_demands_on_forces(network)
    yield from _list_demands_on_geometry(network)
    yield from _list_demands_on_range(network)


def _list_demands_on_balls(network: Any) -> Iterator[_Demand]:
    """Yield the demands that coordinates are finite and below ``LARGEST_NUMBER``, that radii,
    masses and moments of inertia are above zero, and that these three are finite for balls that
    move.
    """
    is_placed = np.all(np.abs(network.positions) < LARGEST_NUMBER, axis=1)
    yield "positions", is_placed, f"is at a place {_SIZE_FAULT} m", ""
    for name in NUMBERS_OF_BALLS:
        values = getattr(network, name)
        yield name, values > 0.0, f"has {name} that are not above zero", ""
        is_finite = np.isfinite(values) | ~network.moving
        mend = "A body that does not move has an infinite mass"
        yield name, is_finite, f"has {name} that are not finite, but moves", mend


def _list_demands_on_ends(network: Any) -> Iterator[_Demand]:
    """Yield the demands that the two balls of each contact are there, that its shift leads along
    periods only and not too far, and that the contact does not join a ball with itself, but for an
    image of it.
    """
    for name in ("i", "j"):
        index = getattr(network, name)
        exists = (index >= 0) & (index < network.n_balls)
        fault = f"names a ball that is not there; balls are 0 to {network.n_balls - 1}"
        yield name, exists, fault, ""
    is_edge = [not is_period for is_period in network.pbc]
    crosses = np.any(network.shift[:, is_edge], axis=1)
    yield "shift", ~crosses, "crosses a side of the cell that is not periodic", ""
    is_near = np.all(np.abs(network.shift) <= MOST_STEPS, axis=1)
    yield "shift", is_near, f"has a shift of more than {MOST_STEPS} cells", ""
    joins_two = (network.i != network.j) | np.any(network.shift, axis=1)
    yield "i", joins_two, "joins a ball with itself", ""


def _list_demands_on_forces(network: Any) -> Iterator[_Demand]:
    """Yield the demands that normals have the length one, that forces and stiffnesses are in their
    ranges, that tangential forces are across the normals, and that these, torques and arms are
    finite and below ``LARGEST_NUMBER``.
    """
    # squares of larger numbers might overflow
    length = np.linalg.norm(np.clip(network.normal, -2.0, 2.0), axis=1)
    is_unit = np.abs(length - 1.0) <= UNIT_TOLERANCE
    yield "normal", is_unit, "has a normal whose length is not one", ""
    for name, lower_limit in _SPRINGS.items():
        yield _make_demand_on_springs(network, name, lower_limit)
    tangential = network.tangential_force
    if tangential is not None:
        name = "tangential_force"
        is_finite = np.all(np.abs(tangential) < LARGEST_NUMBER, axis=1)
        yield name, is_finite, f"has a {name} {_SIZE_FAULT} N", ""
        is_across = are_across(tangential, network.normal, network.normal_force)
        fault = f"has a {name} that is not across its normal"
        yield name, is_across, fault, "Leave the normal force out of it"
    torque = network.contact_torque
    if torque is not None:
        name = "contact_torque"
        is_finite = np.all(np.abs(torque) < LARGEST_NUMBER, axis=1)
        yield name, is_finite, f"has a {name} {_SIZE_FAULT} N m", ""
    for name in ("arm_i", "arm_j"):
        is_finite = np.abs(getattr(network, name)) < LARGEST_NUMBER
        yield name, is_finite, f"has an {name} {_SIZE_FAULT} m", ""


def _make_demand_on_springs(network: Any, name: str, lower_limit: str) -> _Demand:
    """Return the demand that the forces or stiffnesses in the field ``name`` are finite, and "above
    zero" or "zero or above", whichever is the ``lower_limit``; adhesive forces have no limit.
    """
    values = getattr(network, name)
    is_finite = np.isfinite(values)
    is_force = name == "normal_force"
    if is_force and network.adhesive:
        return name, is_finite, f"has a {name} that is not finite", ""
    is_in_range = values > 0.0 if lower_limit == "above zero" else values >= 0.0
    fault = f"has a {name} that is not {lower_limit}"
    if is_force:
        fault += "; forces that pull are not of elastic balls"
    return name, is_finite & is_in_range, fault, ""


def _list_demands_on_geometry(network: Any) -> Iterator[_Demand]:
    """Yield the demands on the directions and lengths of contacts.

    Normals lie in the line or plane of the network. Of contacts between two balls that move, the
    vector from centre to centre lies there, too, the normal leads along it from ball i to ball j,
    and its length is the sum of the two arms, to a quarter of this sum. A body that does not move
    may have any place.
    """
    d = network.dimension
    where = "the line along x" if d == 1 else "the plane"
    # the components from d on are those that leave the line or the plane
    is_flat = ~np.any(np.abs(network.normal[:, d:]) > UNIT_TOLERANCE, axis=1)
    yield "normal", is_flat, f"leaves {where} of a network in {d} dimensions", ""
    has_still_end = ~(network.moving[network.i] & network.moving[network.j])
    vector = network.vector
    arms = network.arm_i + network.arm_j
    is_level = ~np.any(np.abs(vector[:, d:]) > UNIT_TOLERANCE * np.abs(arms)[:, None], axis=1)
    yield "i", is_level | has_still_end, f"joins balls that are not both in {where}", ""
    leads_to_j = np.einsum("ca,ca->c", network.normal, vector) > 0.0
    fault = "has a normal that does not lead from ball i to ball j"
    mend = "Normals lead from ball i to ball j displaced by shift cells"
    yield "normal", leads_to_j | has_still_end, fault, mend
    is_touching = span_distance(arms, vector)
    fault = "joins balls whose distance is not the sum of the two arms"
    mend = "Compare shift and cell with the positions"
    yield "arm_i", is_touching | has_still_end, fault, mend


def _list_demands_on_range(network: Any) -> Iterator[_Demand]:
    """Yield the demands that masses, radii and moments of inertia of balls that move, forces and
    stiffnesses, those of springs to the ground too, are so far from zero and infinity that products
    of a few of them stay within the range of floats. Forces, and stiffnesses other than the normal
    ones, may be zero or near to it.
    """
    for name in NUMBERS_OF_BALLS:
        values = getattr(network, name)
        is_in_range = (values >= 1.0 / LARGEST_NUMBER) & (values <= LARGEST_NUMBER)
        yield name, is_in_range | ~network.moving, f"has {name} {_RANGE_FAULT}", ""
    is_stiff = network.normal_stiffness >= 1.0 / LARGEST_NUMBER
    yield "normal_stiffness", is_stiff, f"has a stiffness {_RANGE_FAULT}", ""
    for name in _SPRINGS:
        is_in_range = np.abs(getattr(network, name)) <= LARGEST_NUMBER  # adhesive forces may pull
        yield name, is_in_range, f"has a {name} {_RANGE_FAULT}", ""
    if network.on_site is not None:
        is_in_range = np.all(network.on_site <= LARGEST_NUMBER, axis=1)
        yield "on_site", is_in_range, f"has springs to the ground {_RANGE_FAULT}", ""
