"""What a network of contacts must be: the checks that :class:`~granphon.networks.network.ContactNetwork` makes of itself."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from granphon.balls.motions import allowed_motions
from granphon.base.arguments import real_array
from granphon.base.errors import InputError, brief, message
from granphon.base.validation import require, truth

if TYPE_CHECKING:
    from granphon.networks.network import ContactNetwork

__all__ = ["LARGEST", "MOST_STEPS", "check_network", "read_periodic", "read_whole_numbers"]

Array = NDArray[np.float64]
Index = NDArray[np.intp]
#: deviation of the length of a normal from one, or of a normal from the plane, that is put down to rounding in a file
_UNIT = 1e-6
#: greatest difference, over the sum of the two arms, between these and the distance of the centres
_STRAY = 0.25
#: least volume of a periodic cell over the product of the lengths of its vectors
_FLAT = 1e-9
#: greatest number in SI, and the inverse of the least one: products of a few of them stay within the range of floats
LARGEST = 1e60
#: greatest number of cells between two balls
MOST_STEPS = 1_000_000_000
#: greatest part of a tangential force along the normal: the rounding in a file
_ALONG = 1e-2
_SPRINGS = ("shear_stiffness", "torsion_stiffness", "bending_stiffness")


def read_whole_numbers(name: str, values: Any) -> Index:
    """Return ``values`` as an array of whole numbers; floats are taken if they are whole.

    Raises :class:`~granphon.base.errors.InputError` for other values, and for numbers too large to be an index.
    """
    given = values if isinstance(values, np.ndarray) and values.dtype.kind == "i" else real_array(name, values)
    if given.dtype.kind == "i":
        return np.asarray(given, np.intp)
    fine = np.isfinite(given) & (given == np.rint(given)) & (np.abs(given) < 2.0**53)
    if not np.all(fine):
        wrong = given[~fine].ravel()[0]
        raise InputError(message(f"{name} of the network has the number {wrong!s} where a whole number is needed"))
    return np.asarray(given, np.intp)


def read_periodic(values: Any) -> tuple[bool, bool, bool]:
    """Return three truth values, for the three vectors of the cell; :class:`InputError` for something else."""
    plain = values.tolist() if isinstance(values, np.ndarray) else values
    if not isinstance(plain, Sequence) or isinstance(plain, str) or len(plain) != 3:
        what = f"pbc of the network is {brief(values)}"
        raise InputError(message(what, mend="Give three truth values, one for each vector of the cell"))
    one, two, three = (require("pbc", truth, value) for value in plain)
    return one, two, three


def check_network(network: ContactNetwork) -> None:
    """Raise :class:`~granphon.base.errors.InputError` for what the class does not allow; shapes have been checked."""
    motions = allowed_motions(network.dimension)
    if network.motions not in motions:
        what = f"a network in {network.dimension} dimensions has no motions {brief(network.motions)}"
        raise InputError(message(what, mend="Use " + ", ".join(motions)))
    if not network.n_balls:
        raise InputError(message("the network has no ball"))
    _check_balls(network)
    _check_cell(network)
    _check_contacts(network)
    _check_directions(network)
    _check_once(network)
    _check_range(network)
    _check_order(network)


def _require(network: ContactNetwork, name: str, fine: Any, what: str, wrong: str, mend: str = "") -> None:
    """Raise :class:`InputError` if a ball or contact is not ``fine``; the message names the first, and how many."""
    if not np.all(fine):
        bad = np.flatnonzero(~np.asarray(fine))
        value = np.asarray(getattr(network, name))[bad[0]]
        more = f" ({bad.size} in all)" if bad.size > 1 else ""
        found = f"{name} = {np.array2string(value)}"
        if what == "contact" and name not in ("i", "j"):
            found += f", between balls {network.i[bad[0]]} and {network.j[bad[0]]}"
        raise InputError(message(f"{what} {bad[0]} of the network {wrong}: {found}{more}", mend=mend))


def _check_balls(network: ContactNetwork) -> None:
    finite = np.all(np.abs(network.positions) < LARGEST, axis=1)
    _require(network, "positions", finite, "ball", f"is at a place that is not finite, or above {LARGEST:g} m")
    for name in ("radii", "masses", "inertias"):
        values = getattr(network, name)
        _require(network, name, values > 0.0, "ball", f"has {name} that are not above zero")
        if name != "masses":
            _require(
                network, name, (values < LARGEST) | ~network.moving, "ball", f"has {name} that are not finite, but moves",
                "A body that does not move has an infinite mass",
            )  # fmt: skip
    if network.labels is not None and np.unique(network.labels).size != network.n_balls:
        raise InputError(message("two balls of the network have the same label"))


def _check_cell(network: ContactNetwork) -> None:
    periods = network.cell[list(network.pbc)]
    for axis in np.flatnonzero(network.pbc):
        vector = network.cell[axis]
        if not (np.all(np.abs(vector) < LARGEST) and np.any(vector)):
            raise InputError(message(f"vector {axis} of the cell is {vector.tolist()} m, and periodic"))
        if axis >= network.dimension or np.any(vector[network.dimension :]):
            where = "the line" if network.dimension == 1 else "the plane"
            what = f"vector {axis} of the cell, {vector.tolist()} m, leaves {where} of a network in"
            raise InputError(message(f"{what} {network.dimension} dimensions, and is periodic"))
    if len(periods) > 1:
        size = np.linalg.norm(periods, axis=1, keepdims=True)
        if np.prod(np.linalg.svd(periods / size, compute_uv=False)) < _FLAT:
            raise InputError(message("the periodic vectors of the cell are not independent of each other"))


def _check_contacts(network: ContactNetwork) -> None:
    for name in ("i", "j"):
        values = getattr(network, name)
        there = (values >= 0) & (values < network.n_balls)
        _require(network, name, there, "contact", f"names a ball that is not there; balls are 0 to {network.n_balls - 1}")
    moved = np.any(network.shift[:, [not one for one in network.pbc]], axis=1)
    _require(network, "shift", ~moved, "contact", "crosses a side of the cell that is not periodic")
    near = np.all(np.abs(network.shift) <= MOST_STEPS, axis=1)
    _require(network, "shift", near, "contact", f"has a shift of more than {MOST_STEPS} cells")
    alone = (network.i == network.j) & ~np.any(network.shift, axis=1)
    _require(network, "i", ~alone, "contact", "joins a ball with itself")
    size = np.linalg.norm(np.clip(network.normal, -2.0, 2.0), axis=1)  # squares of larger numbers might overflow
    _require(network, "normal", np.abs(size - 1.0) <= _UNIT, "contact", "has a normal whose length is not one")
    for name, low in [("normal_force", False), ("normal_stiffness", True), *[(one, False) for one in _SPRINGS]]:
        values = getattr(network, name)
        inside = np.isfinite(values) & ((values > 0.0) if low else (values >= 0.0))
        pulls = "; forces that pull are not of elastic balls" if name == "normal_force" else ""
        what = "above zero" if low else "zero or above"
        _require(network, name, inside, "contact", f"has a {name} that is not {what}{pulls}")
    if network.tangential_force is not None:
        force = network.tangential_force
        fine = np.all(np.abs(force) < LARGEST, axis=1)
        wrong = f"has a tangential_force that is not finite, or above {LARGEST:g} N"
        _require(network, "tangential_force", fine, "contact", wrong)
        # among the least of all numbers rounding turns a force
        least = _ALONG * np.linalg.norm(force, axis=1) + np.finfo(float).tiny
        along = np.abs(np.einsum("ca,ca->c", force, network.normal)) <= least
        mend = "Leave the normal force out of it"
        _require(network, "tangential_force", along, "contact", "has a tangential_force that is not across its normal", mend)
    for name in ("arm_i", "arm_j"):
        fine = np.abs(getattr(network, name)) < LARGEST
        _require(network, name, fine, "contact", f"has an {name} that is not finite, or above {LARGEST:g} m")


def _check_directions(network: ContactNetwork) -> None:
    """Check that contacts lie in the plane, and lead from ball i to ball j; a wall may have any place."""
    flat = ~np.any(np.abs(network.normal[:, network.dimension :]) > _UNIT, axis=1)
    where = "the line along x" if network.dimension == 1 else "the plane"
    _require(network, "normal", flat, "contact", f"leaves {where} of a network in {network.dimension} dimensions")
    of_balls = network.moving[network.i] & network.moving[network.j]
    vector, arms = network.vector, network.arm_i + network.arm_j
    level = ~np.any(np.abs(vector[:, network.dimension :]) > _UNIT * np.abs(arms)[:, None], axis=1)
    _require(network, "i", level | ~of_balls, "contact", f"joins balls that are not both in {where}")
    ahead = np.einsum("ca,ca->c", network.normal, vector) > 0.0
    mend = "Normals lead from ball i to ball j displaced by shift cells"
    _require(network, "normal", ahead | ~of_balls, "contact", "has a normal that does not lead from ball i to ball j", mend)
    distance = np.linalg.norm(vector, axis=1)
    near = np.abs(distance - arms) <= _STRAY * np.abs(arms)
    mend = "Compare shift and cell with the positions"
    wrong = "joins balls whose distance is not the sum of the two arms"
    _require(network, "arm_i", near | ~of_balls, "contact", wrong, mend)


def _check_once(network: ContactNetwork) -> None:
    """Check that no contact is listed twice, from one end or from both; a wall may touch a ball at several places."""
    if not network.n_contacts:
        return
    i, j, shift = network.i, network.j, network.shift
    leading = np.take_along_axis(shift, np.argmax(shift != 0, axis=1)[:, None], axis=1)[:, 0]
    turned = (i > j) | ((i == j) & (leading < 0))
    first, second = np.where(turned, j, i), np.where(turned, i, j)
    step = np.where(turned[:, None], -shift, shift)
    low, high = step.min(axis=0), step.max(axis=0)
    if np.prod(1.0 + (high - low).astype(float)) * float(network.n_balls) ** 2 < 2.0**62:
        span = high - low + 1
        place = ((step[:, 0] - low[0]) * span[1] + step[:, 1] - low[1]) * span[2] + step[:, 2] - low[2]
        key: Any = (place * network.n_balls + first) * network.n_balls + second
        order = np.argsort(key, kind="stable")
        same = np.diff(key[order]) == 0
    else:  # shifts so large that no single number holds them
        keys = np.column_stack([first, second, step])
        order = np.lexsort(keys.T)
        same = ~np.any(np.diff(keys[order], axis=0), axis=1)
    before, after = order[:-1][same], order[1:][same]
    of_wall = ~(network.moving[i[after]] & network.moving[j[after]])
    sign = np.where(turned[before] == turned[after], 1.0, -1.0)[:, None]
    elsewhere = np.any(np.abs(network.normal[before] - sign * network.normal[after]) > _UNIT, axis=1)
    twice = ~(of_wall & elsewhere)
    if np.any(twice):
        one, other = int(before[twice][0]), int(after[twice][0])
        more = f" ({np.count_nonzero(twice)} such in all)" if np.count_nonzero(twice) > 1 else ""
        what = f"contacts {one} and {other} of the network are the same, between balls {i[one]} and {j[one]}{more}"
        raise InputError(message(what, "Every contact counts once", "List each contact from one of its ends only"))


def _check_range(network: ContactNetwork) -> None:
    """Check that numbers are of a size whose products stay within the range of floats."""
    said = f"beyond what can be reckoned with, {1.0 / LARGEST:g} to {LARGEST:g} in SI"
    for name in ("radii", "masses", "inertias"):
        values = getattr(network, name)
        fine = ((values >= 1.0 / LARGEST) & (values <= LARGEST)) | ~network.moving
        _require(network, name, fine, "ball", f"has {name} {said}")
    _require(network, "normal_stiffness", network.normal_stiffness >= 1.0 / LARGEST, "contact", f"has a stiffness {said}")
    for name in ("normal_force", "normal_stiffness", *_SPRINGS):
        _require(network, name, getattr(network, name) <= LARGEST, "contact", f"has a {name} {said}")


def _check_order(network: ContactNetwork) -> None:
    """Check that an array has the balls of all of its cells."""
    if network.lattice is None or network.shape is None:
        return
    balls = network.lattice.n_balls * int(np.prod(network.shape, dtype=float))
    if len(network.shape) != network.lattice.periods or balls != network.n_balls:
        what = f"{network.shape} cells of the {network.lattice.name} lattice have {balls} balls"
        raise InputError(message(f"{what}, and the network has {network.n_balls}"))
